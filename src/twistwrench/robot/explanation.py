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
"""M ddq; terms with dq_i²; terms with dq_i dq_j; g."""


NEGLIGIBLE_PART = "·"
"""Text of a part that is too small to be shown."""


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
        contribution = self.parts[..., self.causes.index(cause), :]
        if term is None:
            return np.asarray(contribution.sum(axis=-2))
        return np.asarray(contribution[..., self.terms.index(term), :])

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
        name = f"({name})" if name in self.causes else name
        parts = np.pad(self.parts, [(0, 0)] * (self.parts.ndim - 3) + [(0, 1), (0, 1), (0, 0)])
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
        parts, heads = self._columns(joint)
        least = 1e-12 * max(float(np.abs(self.torque).max(initial=0.0)), 1.0)
        shown = [
            [cause, *_cells(row, least)]
            for cause, row in zip(self.causes, parts, strict=True)
            if np.abs(row).max(initial=0.0) > least
        ]
        return [["caused by", *heads], *shown, ["together", *_cells(parts.sum(axis=0), least)]]

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
        name_width, *widths = (max(map(len, column)) for column in zip(*rows, strict=True))
        lines = []
        for name, *cells in rows:
            aligned = [cell.rjust(width) for cell, width in zip(cells, widths, strict=True)]
            lines.append("  ".join([name.ljust(name_width), *aligned]).rstrip())
        return "\n".join(lines)

    def _columns(self, joint: str | None) -> tuple[Array, list[str]]:
        """Numbers of the table (causes, columns), and the column headings."""
        require_one_state(self)
        if joint is None:
            return self.by_cause, [f"{name} [{unit}]" for name, unit in zip(self.joints, self.units, strict=True)]
        if joint not in self.joints:
            raise UnknownNameError.from_choices("joint", joint, self.joints)
        k = self.joints.index(joint)
        rows = self.parts[:, :, k].T
        whole = np.concatenate([rows, rows.sum(axis=1, keepdims=True)], axis=1)
        return whole, [*self.terms, f"together [{self.units[k]}]"]

    def __repr__(self) -> str:
        batch = f" of states {self.parts.shape[:-3]}" if self.parts.ndim > 3 else ""
        return f"<Explanation{batch}: {', '.join(self.terms)} of {', '.join(self.causes)}>"

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


def _cells(row: Array, least: float) -> list[str]:
    return [NEGLIGIBLE_PART if abs(x) <= least else number(x) for x in row.tolist()]


def explain_torques(
    model: Model,
    regressor: Callable[[Array, Array, Array], Array],
    state: tuple[Array, Array, Array],
    other_torques: Mapping[str, Array],
) -> Explanation:
    """Split the torques at ``state``; ``other_torques``: torques without an inertia as cause, (..., nv) by name."""
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in (*state, *other_torques.values())))
    bodies = _causes(model)
    columns = np.array(list(bodies.values())).reshape(len(bodies), 10 * len(model.bodies))

    def torques(q: Array, dq: Array, ddq: Array) -> Array:
        return np.swapaxes(regressor(q, dq, ddq) @ columns.T, -1, -2)  # (..., causes, nv)

    parts = _motion_parts(torques, *(np.broadcast_to(x, (*batch, x.shape[-1])) for x in state))
    units = units_of("tau", (turns for b in model.leaders for turns in b.joint.turning))
    why = Explanation(MOTION_TERMS, tuple(bodies), model.velocity_names, units, parts)
    for name, tau in other_torques.items():
        why = why.with_term(name, tau)
    return why


def _motion_parts(torques: Callable[..., Array], q: Array, dq: Array, ddq: Array) -> Array:
    """Motion terms (..., 4, causes, nv) from a function of the state that is linear in each body's parameters.

    Velocity products are a quadratic form in dq; the squares are the products of each velocity with itself.
    """
    zero = np.zeros_like(dq)
    gravity = torques(q, zero, zero)
    inertia = torques(q, zero, ddq) - gravity
    velocity = torques(q, dq, zero) - gravity
    squares = np.zeros_like(gravity)
    for e in np.eye(dq.shape[-1]):
        squares += torques(q, dq * e, zero) - gravity
    return np.stack([inertia, squares, velocity - squares, gravity], axis=-3)


def _causes(model: Model) -> dict[str, Array]:
    """Bodies, rotors and payloads by name, with their parameters in the columns of the carrying body; (10 nbodies,)."""
    causes: dict[str, Array] = {}

    def count(name: str, body: int, parameters: Array) -> None:
        if body != BASE and parameters.any():
            columns = causes.setdefault(name, np.zeros(10 * len(model.bodies)))
            columns[10 * body : 10 * body + 10] += parameters

    payloads: dict[str, Array] = {}
    for name, payload in model.payloads:
        payloads[name] = payloads.get(name, np.zeros(10)) + payload.parameters
    for name, frame in model.all_frames.items():
        inertia = model.link_inertias.get(name)  # sites have none
        own = np.zeros(10) if inertia is None else inertia.parameters - payloads.get(name, np.zeros(10))
        own = np.where(np.abs(own) <= 1e-15 * np.abs(payloads.get(name, own)), 0.0, own)
        count(name, frame.body, _transform(own, frame.pose))
        count(f"payload at {name}", frame.body, _transform(payloads.get(name, np.zeros(10)), frame.pose))
    for i, body in enumerate(model.bodies):
        if not body.joint.moves_body:
            count(body.link, i, body.inertia.parameters)
            if is_in_link_mass(model, body):  # then its link was counted above
                count(body.link, body.parent, -_transform(body.inertia.parameters, body.placement))
    total = sum(causes.values(), start=np.zeros(10 * len(model.bodies)))
    for i, body in enumerate(model.bodies):  # differences by repaired inertias or fused rotors
        difference = body.inertia.parameters - total[10 * i : 10 * i + 10]
        if np.abs(difference).max() > 1e-12 * max(1e-300, float(np.abs(body.inertia.parameters).max())):
            count(f"{body.link} (other)", i, difference)
    return causes


def _transform(parameters: Array, T: Array) -> Array:
    """Inertial parameters transformed from frame {b} to {a}; linear, so that differences can be transformed too."""
    from ..mechanics.bodies.inertia import SpatialInertia

    return SpatialInertia.from_parameters(parameters).in_frame(T).parameters


complete(globals())
