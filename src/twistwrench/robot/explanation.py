"""Explanation of a joint torque: τ split by term, and by the link, rotor or payload that causes it.

Torques are linear in the inertial parameters, τ = Y(q, dq, ddq) π. The contribution of a body is Y's columns of that
body times its parameters. The split is exact: its parts add up to τ.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.errors import ShapeError, UnknownNameError
from ..core.glossary import complete
from ..core.numbers import number
from ..core.typing import Array
from ..mechanics.joints.units import units_of
from ..mechanics.model.actuation import is_in_link_mass
from ..mechanics.model.model import BASE, Model
from .doors import ExplanationDoors

MOTION_TERMS = ("inertia", "centripetal", "Coriolis", "gravity")
"""Terms of τ in this order: M ddq; terms with squares dq_i²; terms with products dq_i dq_j, i ≠ j; g(q)."""
NEGLIGIBLE_PART = "·"
"""Text of a part that is too small to be shown."""
_NEGLIGIBLE_SHARE = 1e-12
"""Torque or parameter, as a share of the largest, up to which it is a rounding error."""
_PARAMETERS = 10
"""Number of inertial parameters of a body."""


@dataclass(frozen=True, eq=False, repr=False)
class Explanation(ExplanationDoors):
    """Joint torques τ split by term and by cause; parts without a body (friction, springs, wrenches) count as both.

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> why = tw.robots.planar_2r().explain([0, 0], [0, 1], [0, 0])
    >>> why.contribution("link2", "gravity").round(2).tolist()
    [19.62, 9.81]
    >>> why.with_term("cable", np.array([1.0, 0.0])).rows()[0]
    ['caused by', 'joint1 [N m]', 'joint2 [N m]']
    >>> print(why.table("joint1"))
    caused by  inertia  centripetal  Coriolis  gravity  together [N m]
    link1            ·            ·         ·     9.81            9.81
    link2            ·            ·         ·    19.62           19.62
    together         ·            ·         ·    29.43           29.43
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     why.plot(f"{folder}/why.svg").name
    'why.svg'
    """

    terms: tuple[str, ...]
    """Names of the terms: inertia, centripetal, Coriolis, gravity, and those without a body."""
    causes: tuple[str, ...]
    """Names of the causes: links, rotors, payloads, and the terms without a body."""
    joints: tuple[str, ...]
    """A name for each entry of τ."""
    units: tuple[str, ...]
    """Unit of each joint: N m, or N for sliding joints."""
    parts: Array
    """Contributions, (..., terms, causes, nv)."""

    @property
    def torque(self) -> Array:
        """τ, the sum of all parts; (..., nv), N m (sliding joints: N)."""
        return np.asarray(self.parts.sum(axis=(-3, -2)))

    @property
    def by_term(self) -> Array:
        """Torques by term, summed over causes; (..., terms, nv), N m (sliding joints: N)."""
        return np.asarray(self.parts.sum(axis=-2))

    @property
    def by_cause(self) -> Array:
        """Torques by cause, summed over terms; (..., causes, nv), N m (sliding joints: N)."""
        return np.asarray(self.parts.sum(axis=-3))

    def contribution(self, cause: str, term: str | None = None) -> Array:
        """Torque that one cause contributes at each joint.

        Parameters
        ----------
        cause : str, one of ``causes``
        term : str, optional, one of ``terms``; None: sum of all terms

        Returns
        -------
        tau : (..., nv) array [N m, sliding joints: N]
        """
        for kind, name, choices in (("cause", cause, self.causes), ("term", term, self.terms)):
            if name is not None and name not in choices:
                raise UnknownNameError.from_choices(kind, name, choices)
        torques_by_term = self.parts[..., self.causes.index(cause), :]
        if term is None:
            return np.asarray(torques_by_term.sum(axis=-2))
        return np.asarray(torques_by_term[..., self.terms.index(term), :])

    def with_term(self, name: str, tau: Array) -> Explanation:
        """Explanation with additional torques without a body, as a term and a cause of their own.

        Parameters
        ----------
        name : str, name of the term and the cause; put in brackets if a body has the same name
        tau : (..., nv) array [N m, sliding joints: N]

        Returns
        -------
        explanation : Explanation
        """
        if name in self.causes:
            name = f"({name})"
        batch_axes = [(0, 0)] * (self.parts.ndim - 3)
        parts = np.pad(self.parts, [*batch_axes, (0, 1), (0, 1), (0, 0)])  # one more term, one more cause
        parts[..., -1, -1, :] = tau
        return replace(self, terms=(*self.terms, name), causes=(*self.causes, name), parts=parts)

    def rows(self, joint: str | None = None) -> list[list[str]]:
        """Cells of :meth:`table`, header first; causes without torque are omitted.

        Parameters
        ----------
        joint : str, optional, split this joint's torque by term; None: all joints

        Returns
        -------
        rows : list of rows of str
        """
        torques_by_cause, headings = self._columns(joint)
        largest_torque = float(np.abs(self.torque).max(initial=0.0))
        negligible_torque = _NEGLIGIBLE_SHARE * max(largest_torque, 1.0)  # [N m or N], also if all torques are small
        rows = [["caused by", *headings]]
        for cause, torques in zip(self.causes, torques_by_cause, strict=True):
            if np.abs(torques).max(initial=0.0) > negligible_torque:
                rows.append([cause, *_cells(torques, negligible_torque)])
        rows.append(["together", *_cells(torques_by_cause.sum(axis=0), negligible_torque)])
        return rows

    def table(self, joint: str | None = None) -> str:
        """Table as plain text: a row per cause, with a column per joint or, for one joint, a column per term.

        Parameters
        ----------
        joint : str, optional, split this joint's torque by term; None: all joints

        Returns
        -------
        text : str, of one state
        """
        rows = self.rows(joint)
        table_columns = zip(*rows, strict=True)
        name_width, *widths = [max(map(len, column)) for column in table_columns]
        lines = []
        for name, *cells in rows:
            aligned = [cell.rjust(width) for cell, width in zip(cells, widths, strict=True)]
            lines.append("  ".join([name.ljust(name_width), *aligned]).rstrip())
        return "\n".join(lines)

    def _columns(self, joint: str | None) -> tuple[Array, list[str]]:
        """Torques of the table (causes, columns), and the column headings."""
        require_one_state(self)
        if joint is None:
            headings = [f"{name} [{unit}]" for name, unit in zip(self.joints, self.units, strict=True)]
            return self.by_cause, headings
        if joint not in self.joints:
            raise UnknownNameError.from_choices("joint", joint, self.joints)
        k = self.joints.index(joint)
        torques = self.parts[:, :, k].T  # (causes, terms)
        sums = torques.sum(axis=1, keepdims=True)
        headings = [*self.terms, f"together [{self.units[k]}]"]
        return np.concatenate([torques, sums], axis=1), headings

    def __repr__(self) -> str:
        batch_text = ""
        if self.parts.ndim > 3:
            batch_text = f" of states {self.parts.shape[:-3]}"
        return f"<Explanation{batch_text}: {', '.join(self.terms)} of {', '.join(self.causes)}>"

    def __str__(self) -> str:
        if self.parts.ndim != 3:
            return f"<Explanation of states {self.parts.shape[:-3]}: {', '.join(self.terms)}>"
        return self.table()


def require_one_state(why: Explanation) -> None:
    """Raise ShapeError for a batch of states."""
    if why.parts.ndim != 3:
        raise ShapeError(
            f"this explains a batch of states of shape {why.parts.shape[:-3]}; a table or a picture is of one. "
            "Explain that state alone, or look at .parts."
        )


def _cells(torques: Array, negligible_torque: float) -> list[str]:
    """Texts of torques; a negligible one is :data:`NEGLIGIBLE_PART`."""
    return [NEGLIGIBLE_PART if abs(tau) <= negligible_torque else number(tau) for tau in torques.tolist()]


def explain_torques(
    model: Model,
    regressor: Callable[[Array, Array, Array], Array],
    state: tuple[Array, Array, Array],
    other_torques: Mapping[str, Array],
) -> Explanation:
    """Split the torques at the state (q, dq, ddq).

    ``regressor`` returns Y(q, dq, ddq). ``other_torques``: torques (..., nv) that no inertia causes, by name.
    """
    batch_shape = np.broadcast_shapes(*(x.shape[:-1] for x in (*state, *other_torques.values())))
    q, dq, ddq = (np.broadcast_to(x, (*batch_shape, x.shape[-1])) for x in state)
    parameters_by_cause = _parameters_by_cause(model)
    causes = tuple(parameters_by_cause)
    parameters = np.array(list(parameters_by_cause.values())).reshape(len(causes), _PARAMETERS * len(model.bodies))

    def torques_by_cause(q: Array, dq: Array, ddq: Array) -> Array:
        return np.swapaxes(regressor(q, dq, ddq) @ parameters.T, -1, -2)  # (..., causes, nv)

    parts = _motion_parts(torques_by_cause, q, dq, ddq)
    turning: list[bool] = []  # of each velocity
    for body in model.leaders:
        turning += body.joint.turning
    units = units_of("tau", turning)
    explanation = Explanation(MOTION_TERMS, causes, model.velocity_names, units, parts)
    for name, tau in other_torques.items():
        explanation = explanation.with_term(name, tau)
    return explanation


def _motion_parts(torques: Callable[..., Array], q: Array, dq: Array, ddq: Array) -> Array:
    """Motion terms (..., 4, causes, nv), ordered as :data:`MOTION_TERMS`; ``torques`` returns the torques by cause at a state.

    Torques due to velocities are a quadratic form in dq. If a single joint moves, only the square of its velocity is left.
    """
    zero = np.zeros_like(dq)
    gravity = torques(q, zero, zero)
    inertia = torques(q, zero, ddq) - gravity
    velocity_torques = torques(q, dq, zero) - gravity
    centripetal = np.zeros_like(gravity)
    for unit_vector in np.eye(dq.shape[-1]):
        centripetal += torques(q, dq * unit_vector, zero) - gravity
    coriolis = velocity_torques - centripetal
    return np.stack([inertia, centripetal, coriolis, gravity], axis=-3)


def _parameters_by_cause(model: Model) -> dict[str, Array]:
    """Parts (10 nbodies,) of the inertial parameters of all bodies, by the link, rotor or payload that causes them.

    The parameters of a cause stand in the ten entries of the body that carries it.
    """
    parameters_by_cause: dict[str, Array] = {}

    def entries_of(body_index: int) -> slice:
        """Entries of a body among the parameters of all bodies."""
        return slice(_PARAMETERS * body_index, _PARAMETERS * (body_index + 1))

    def add_contribution(cause: str, body_index: int, parameters: Array) -> None:
        """Add parameters (10,) of a body to those of a cause; the base and zeros are left out."""
        if body_index != BASE and parameters.any():
            total = parameters_by_cause.setdefault(cause, np.zeros(_PARAMETERS * len(model.bodies)))
            total[entries_of(body_index)] += parameters

    payload_parameters: dict[str, Array] = {}  # (10,) by frame
    for name, payload in model.payloads:
        payload_parameters[name] = payload_parameters.get(name, np.zeros(_PARAMETERS)) + payload.parameters
    for name, frame in model.all_frames.items():
        inertia = model.link_inertias.get(name)  # with the payload; None for sites
        link_parameters = np.zeros(_PARAMETERS)  # without the payload
        if inertia is not None:
            link_parameters = inertia.parameters - payload_parameters.get(name, np.zeros(_PARAMETERS))
        if name in payload_parameters:
            # the difference of two numbers has the rounding error of the larger one
            is_rounding = np.abs(link_parameters) <= 1e-15 * np.abs(payload_parameters[name])
            link_parameters = np.where(is_rounding, 0.0, link_parameters)
        add_contribution(name, frame.body, _transform(link_parameters, frame.pose))
        if name in payload_parameters:
            add_contribution(f"payload at {name}", frame.body, _transform(payload_parameters[name], frame.pose))
    for i, body in enumerate(model.bodies):
        if not body.joint.moves_body:  # a rotor
            add_contribution(body.link, i, body.inertia.parameters)
            if is_in_link_mass(model, body):  # then the loop above has counted it in the link
                add_contribution(body.link, body.parent, -_transform(body.inertia.parameters, body.placement))
    total = sum(parameters_by_cause.values(), start=np.zeros(_PARAMETERS * len(model.bodies)))
    for i, body in enumerate(model.bodies):  # repaired inertias and fused rotors differ from the sum of the causes
        difference = body.inertia.parameters - total[entries_of(i)]
        largest_parameter = max(1e-300, float(np.abs(body.inertia.parameters).max()))  # above zero
        if np.abs(difference).max() > _NEGLIGIBLE_SHARE * largest_parameter:
            add_contribution(f"{body.link} (other)", i, difference)
    return parameters_by_cause


def _transform(parameters: Array, T: Array) -> Array:
    """Inertial parameters in frame {a}, from those in {b} and T = T_ab; linear, so that differences can be transformed too."""
    from ..mechanics.bodies.inertia import SpatialInertia

    return SpatialInertia.from_parameters(parameters).in_frame(T).parameters


complete(globals())
