"""Parameters of a robot: ten of each moving body, motor inertia, friction and offset of each joint, and base parameters.

Row j of τ = W x, with Y the regressor of the bodies (Atkeson, An and Hollerbach, 1986) and v_0 the Coulomb smoothing
speed:

    τ_j = Y_j π + Ia_j ddq_j + fv_j dq_j + (fc_j + fs_j exp(-(dq_j / v_s)²)) tanh(dq_j / v_0j) + off_j

with fs the static friction in excess of Coulomb friction, and v_s the Stribeck speed, if requested (Armstrong-Hélouvry,
Dupont and Canudas de Wit, "A survey of models, analysis tools and compensation methods for the control of machines with
friction", Automatica 30(7), 1994).

A motor k that turns with several joints has the rate s_k · dq; s_k is 1 for its own joint. It adds s_k (Ia_k s_k·ddq +
fv_k s_k·dq + fc_k tanh(s_k·dq / v_0)) to the torques of these joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..core.doubts import undetermined_table
from ..core.errors import ModelError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, percent
from ..core.text import argument, listed, spell_out
from ..core.typing import Array
from ..mechanics.algorithms.inverse_dynamics import PARAMETER_NAMES
from ..mechanics.joints.units import units_of
from ..mechanics.model.couplings import without_couplings
from ..mechanics.model.model import BASE, Model
from ..robot import Robot
from ..robot.task_space_methods import require_robot

if TYPE_CHECKING:
    from .payload import MotorSide

DRIVE = ("motor_inertia", "viscous", "coulomb", "stribeck", "offset")
"""Parameters of a drive, in the order of the columns."""
FrictionLaws: TypeAlias = Sequence[str]
"""Names of friction parameters."""
FRICTION = ("viscous", "coulomb", "offset")
"""Default friction parameters."""
STRIBECK_SPEED = 0.1
"""Default Stribeck speed [rad/s or m/s]."""
_DRY = ("coulomb", "stribeck")
PARAMETER_UNITS = {
    "m": ("kg",),
    **dict.fromkeys(("mcx", "mcy", "mcz"), ("kg m",)),
    **dict.fromkeys(("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"), ("kg m^2",)),
    "motor_inertia": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    **dict.fromkeys(("coulomb", "stribeck", "offset"), units_of("tau", (True, False))),
}
"""SI units of each kind of parameter: revolute joints first, then prismatic joints."""


def parameter_unit(kind: str, *, turning: bool) -> str:
    """SI unit of a kind of parameter, at a revolute or a prismatic joint."""
    units = PARAMETER_UNITS[kind]
    return units[0] if turning else units[-1]


def uncoupled(robot: Robot) -> Robot:
    """Robot without its coupled motors; the same robot if no motors are coupled."""
    return Robot(without_couplings(robot.model)) if robot.model.couplings else robot


def group_units(groups: Sequence[str], model: Model) -> tuple[str, ...]:
    """SI units of groups of parameters: those of their first parameters."""
    kinds = [name.split(" ")[0].rpartition(".") for name in groups]
    sliding = {body.joint.name for body in model.bodies if not any(body.joint.turning)}
    return tuple(PARAMETER_UNITS[kind][-1 if owner in sliding else 0] for owner, _, kind in kinds)


_BODY = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "mcx", "mcy", "mcz", "m")
"""Order of the ten parameters of a body in the choice of base parameters: moments first, as in papers on base parameters."""
_SMALLEST_LENGTH, _SMALLEST_MASS = 0.05, 1e-3


@dataclass(frozen=True, eq=False)
class UnknownParameters:
    """Unknown parameters of a robot, and their columns in the torques.

    Parameters
    ----------
    robot : Robot
        Every joint must have one degree of freedom. The robot's friction and armature are treated as unknown.
    motor_inertia : bool, a motor inertia for each joint, seen at the joint
    friction : sequence of str, ``viscous``, ``coulomb``, ``stribeck``, ``offset``
    motor_side : MotorSide, optional; motors that turn with several joints have parameters of their own
    known : mapping, values of known parameters by name
    stribeck_speed : float, v_s of all joints [rad/s or m/s]

    Raises
    ------
    ModelError
        A joint has several degrees of freedom, or the robot already has rotors.
    UnknownNameError
        ``friction`` or ``known`` contains another name.
    ValueRangeError
        A known value is not a number, or nothing remains unknown.

    Examples
    --------
    >>> import twistwrench as tw
    >>> unknown = UnknownParameters(tw.robots.pendulum())
    >>> unknown.names[-1], unknown.scales(*np.ones((3, 1))).shape
    ('hinge.offset', (14,))
    >>> unknown.columns(np.arange(14), *np.zeros((3, 5, 1)), np.ones(1)).shape
    (5, 1, 14)
    >>> unknown.coulomb_columns(np.arange(14))
    [(12, array([ True]))]
    >>> unknown.drives([11], np.full((1, 1), 2.0), np.zeros((1, 1)), np.ones(1)), unknown.shares[11]
    (array([[2.]]), array([1.]))
    """

    robot: Robot
    motor_inertia: bool = True
    friction: Sequence[str] = FRICTION
    motor_side: MotorSide | None = None
    known: Mapping[str, float] = field(default_factory=dict)
    stribeck_speed: float = STRIBECK_SPEED

    def __post_init__(self) -> None:
        robot = require_robot(self.robot, "identification")
        for name in self.friction:
            if name not in DRIVE[1:]:
                raise UnknownNameError.from_choices("friction column", name, DRIVE[1:])
        check_speed(self.stribeck_speed)
        wide = [b.joint.name for b in robot.model.leaders if b.joint.nv != 1]
        if wide:
            raise ModelError(
                f"joint {wide[0]!r} of {robot.name!r} has several degrees of freedom, whose forces no motor measures. Identify "
                "the robot on a stand: load it without a floating base."
            )
        if robot.nv == 0:
            raise ModelError(f"robot {robot.name!r} has no joint that moves, so there is nothing to identify.")
        if any(actuator.rotor is not None for actuator in robot.actuators.values()):
            raise ModelError(
                f"robot {robot.name!r} has actuators already, and motor inertia and friction are what is sought. Give the "
                f"robot without them, and their file as {argument('actuators')}."
            )
        if robot.model.couplings:
            if self.motor_side is not None and len(self.motor_side.coupled_rates):
                raise ModelError("couplings are in the robot's model and in motor_side. Give them once.")
            from .payload import MotorSide

            object.__setattr__(self, "motor_side", MotorSide.of_couplings(robot.model))
        if robot.model.armature.any() or robot.actuators or robot.model.couplings:
            bare = replace(without_couplings(robot.model), armature=np.zeros(robot.nv), actuators={})
            object.__setattr__(self, "robot", Robot(bare))
        for name, value in self.known.items():
            if name not in self.names:
                raise UnknownNameError.from_choices("parameter", name, self.names)
            if not np.isfinite(value):
                raise ValueRangeError(f"{name} is known to be {value!r}, which is not a finite number.")
        if self.held.all():
            raise ValueRangeError("all parameters are known, so there is nothing to identify.")

    @property
    def model(self) -> Model:
        """The robot's model, without armature."""
        return self.robot.model

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """Bodies that are links; a massless body between two joints of one link is left out."""
        return tuple(i for i, body in enumerate(self.model.bodies) if body.link in self.model.link_inertias)

    @cached_property
    def coupled(self) -> Array:
        """(k, nv) rate of each motor that turns with several joints, per rate of each joint; 1 for its own."""
        nv = self.model.nv
        return np.zeros((0, nv)) if self.motor_side is None else self.motor_side.coupled_rates

    @cached_property
    def _entries(self) -> tuple[tuple[str, str, int], ...]:
        """Name, kind and index (column of the regressor, joint or coupled motor) of each parameter."""
        model, found = self.model, list[tuple[str, str, int]]()
        drive = (["motor_inertia"] if self.motor_inertia else []) + [f for f in DRIVE[1:] if f in self.friction]
        for i, body in enumerate(model.bodies):
            if i in self.bodies:
                found += [(f"{body.link}.{p}", p, 10 * i + PARAMETER_NAMES.index(p)) for p in _BODY]
            if not body.follows:
                found += [(f"{body.joint.name}.{kind}", kind, body.v_index) for kind in drive]
        names = model.velocity_names
        for k, rates in enumerate(self.coupled):
            own = [] if self.motor_side is None else self.motor_side.coupled_motors
            who = own[k] or "+".join(names[j] for j in np.flatnonzero(rates))
            found += [(f"{who}.{kind}", f"coupled {kind}", k) for kind in drive if kind != "offset"]
        return tuple(found)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, such as ``link_2.Ixx`` and ``joint_2.coulomb``, from the base outward."""
        return tuple(name for name, _, _ in self._entries)

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds: ``m``, ``mcx``, …, ``Izz``, ``motor_inertia``, ``viscous``, ``coulomb``, ``stribeck``, ``offset``."""
        return tuple(kind.removeprefix("coupled ") for _, kind, _ in self._entries)

    @cached_property
    def of_bodies(self) -> Array:
        """(p,) column of the regressor of each parameter; -1 for parameters of drives."""
        return np.array([place if kind in PARAMETER_NAMES else -1 for _, kind, place in self._entries])

    @cached_property
    def file_values(self) -> Array:
        """(p,) values of the robot file, 0 for drives; known values replace them."""
        own = self.robot.parameters
        found = np.where(self.of_bodies >= 0, own[self.of_bodies], 0.0)
        found[self.held] = [self.known[name] for name in np.array(self.names)[self.held]]
        return found

    @cached_property
    def held(self) -> Array:
        """(p,) bool, True for parameters with known values."""
        return np.isin(self.names, list(self.known))

    @cached_property
    def lengths(self) -> tuple[float, float]:
        """Typical mass [kg] and length [m] of the whole robot, for weak priors and scales."""
        model = self.model
        reach = np.zeros(len(model.bodies))
        for i, body in enumerate(model.bodies):
            base = 0.0 if body.parent == BASE else reach[body.parent]
            reach[i] = base + (float(np.linalg.norm(body.placement[:3, 3])) if body.parent != BASE else 0.0)
        coms = [float(np.linalg.norm(body.inertia.com)) for body in model.bodies]
        length = float(max((reach + coms).max(), _SMALLEST_LENGTH))
        mass = model.moving_mass
        return max(mass, _SMALLEST_MASS) if mass > 0 else 1.0, length

    def scales(self, torque: Array, speed: Array, acceleration: Array) -> Array:
        """Largest plausible size of each parameter, from the robot's mass and reach and the measured torques.

        Parameters
        ----------
        torque, speed, acceleration : (nv,) array, typical values of the log, above 0

        Returns
        -------
        scales : (p,) array
        """
        mass, length = self.lengths
        by_kind = {"m": mass, **dict.fromkeys(("mcx", "mcy", "mcz"), mass * length)}
        of_drive = {
            "motor_inertia": torque / acceleration,
            "viscous": torque / speed,
            "coulomb": torque,
            "stribeck": torque,
            "offset": torque,
        }
        found = []
        for _, kind, place in self._entries:
            plain = kind.removeprefix("coupled ")
            if plain not in DRIVE:
                found.append(by_kind.get(kind, mass * length**2))
            elif plain != kind:
                found.append(float(of_drive[plain][self.coupled[place] != 0].max()))
            else:
                found.append(float(of_drive[plain][place]))
        return np.array(found)

    def columns(
        self,
        which: Array,
        q: Array,
        dq: Array,
        ddq: Array,
        friction_speed: Array,
        gravity: Array | None = None,
    ) -> Array:
        """Columns of some of the parameters in the torques, under ``gravity`` instead of the robot's.

        Returns
        -------
        W : (n, nv, k) array
        """
        W = np.zeros((*dq.shape, len(which)))
        places = self.of_bodies[which]
        mine = np.flatnonzero(places >= 0)
        if mine.size:
            W[:, :, mine] = self.regressor(q, dq, ddq, self.model.gravity if gravity is None else gravity)[
                ..., places[mine]
            ]
        of_drives = np.flatnonzero(places < 0)
        factors = self.drives(which[of_drives], dq, ddq, friction_speed)
        W[:, :, of_drives] = factors[:, None] * self.shares[which[of_drives]].T
        return W

    @cached_property
    def regressor(self) -> Any:
        """Kernel of the regressor Y (nv, 10 nbodies) of the bodies, as a function of q, dq, ddq and gravity."""
        return self.robot.kernel("regressor", gravity="input")

    def coulomb_columns(self, which: Array) -> list[tuple[int, Array]]:
        """Columns of dry friction (Coulomb and Stribeck) among some of the parameters.

        Returns
        -------
        found : list of (column, joints), with (nv,) bool, True for joints at which the column is not zero
        """
        found = []
        for c, k in enumerate(which):
            _, kind, place = self._entries[int(k)]
            if kind in _DRY:
                found.append((c, np.arange(self.model.nv) == place))
            elif kind.removeprefix("coupled ") in _DRY:
                found.append((c, self.coupled[place] != 0))
        return found

    @cached_property
    def shares(self) -> Array:
        """(p, nv) column of a drive's parameter at each joint, per unit of its factor; 0 for parameters of bodies."""
        found = np.zeros((len(self._entries), self.model.nv))
        for row, (_, kind, place) in zip(found, self._entries, strict=True):
            if kind.removeprefix("coupled ") in DRIVE:
                row[:] = self.coupled[place] if kind.startswith("coupled ") else np.arange(self.model.nv) == place
        return found

    def drives(self, which: Sequence[int] | Array, dq: Array, ddq: Array, friction_speed: Array) -> Array:
        """Factors of the columns of some drive parameters; the columns are factors times :attr:`shares`.

        Parameters
        ----------
        which : (k,) sequence of int, indices of the parameters

        Returns
        -------
        factors : (n, k) array
        """
        which = np.asarray(which, int)
        kinds, shares = np.array(self.kinds)[which], self.shares[which]
        found, rates = np.ones((len(dq), len(which))), dq @ shares.T
        motor, viscous, dry, fading = (
            np.flatnonzero(np.isin(kinds, kind)) for kind in ("motor_inertia", "viscous", _DRY, "stribeck")
        )
        found[:, motor] = ddq @ shares[motor].T
        found[:, viscous] = rates[:, viscous]
        found[:, dry] = np.tanh(rates[:, dry] / friction_speed[[speed_owner(shares[k]) for k in dry]])
        found[:, fading] *= np.exp(-((rates[:, fading] / self.stribeck_speed) ** 2))
        return found


def speed_owner(joints: Array) -> int:
    """Joint whose friction speed applies to a column of dry friction: the last of its joints (nv,)."""
    return int(np.flatnonzero(joints)[-1])


def check_speed(value: float) -> float:
    """Return a friction speed or cut-off if it is a number above 0; otherwise raise ValueRangeError."""
    if not (np.isfinite(value) and value > 0):
        raise ValueRangeError(
            f"{value!r} is not a valid speed or frequency. Give a number above 0, or leave it to the program."
        )
    return float(value)


# ── Base parameters: the identifiable groups, for any motion

# Columns of W on random states are linearly dependent. Columns are kept in order from the base outward; with the kept
# columns W_b and the others W_d = W_b B, τ = W_b (x_b + B x_d): the groups are x_b + B x_d.
#
# Source: Gautier, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8(4), 1991. The
# rank is determined on random states with an absolute scale, because in a log, columns of rounding errors look like any
# other.

_NOTHING = 1e-9  # unspanned share of a column's length, or of the longest's, below which it is rounding error
_ROWS_PER_COLUMN = 3
_HELD = 1e-7  # allowed error of a known value, as a share of its size
_EXACT = 1e-7  # coefficients below this are rounding errors, in units of the columns' lengths


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Base parameters of a robot: the kept parameters and their groups.

    Attributes
    ----------
    unknown : UnknownParameters
    kept : (r,) array, indices of the kept parameters
    grouping : (r, p) array; the groups are ``grouping @ x``
    felt : (nv, r) bool array, True if a kept column is not zero in the torque of a joint

    Examples
    --------
    >>> import twistwrench as tw
    >>> base = BaseParameters.from_unknowns(UnknownParameters(tw.robots.pendulum(), friction=(), known={"rod.mcx": 0.0}))
    >>> base.names
    ('rod.Iyy + hinge.motor_inertia', 'rod.mcx', 'rod.mcz')
    >>> base.weak_sizes(np.ones(11)).round(3).tolist(), base.project(base.unknown.file_values).shape
    ([1.414, 0.0, 1.0], (3,))
    """

    unknown: UnknownParameters
    kept: Array
    grouping: Array
    felt: Array

    @classmethod
    def from_unknowns(
        cls, unknown: UnknownParameters, *, seed: int = 0, gravity: Array | None = None
    ) -> BaseParameters:
        """Base parameters from random states.

        Parameters
        ----------
        unknown : UnknownParameters
        seed : int, seed of the random states
        gravity : (3,) array, optional, replaces the robot's

        Returns
        -------
        base : BaseParameters
        """
        robot, p = unknown.robot, len(unknown.names)
        nv = robot.nv
        rng = np.random.default_rng(seed)
        states = -(-_ROWS_PER_COLUMN * p // nv) + 8
        q = robot.random_configuration(rng, states)
        turning = np.array([b.joint.turning[0] for b in unknown.model.leaders])
        q = np.where(turning, rng.uniform(-np.pi, np.pi, q.shape), q)
        dq, ddq = rng.normal(size=(2, states, nv)) * 2.0
        ones = np.ones(nv)
        W = unknown.columns(np.arange(p), q, dq, ddq, 0.5 * ones, gravity)
        scale = unknown.scales(ones, ones, ones)
        free = np.flatnonzero(~unknown.held)
        kept, found = _independent_columns((W * scale)[..., free].reshape(states * nv, len(free)))
        # W S z with x = S z: z_b + B z_d is the group, in units of x its kept parameter's.
        grouping = np.eye(p)  # a known parameter is a group by itself
        grouping[np.ix_(free[kept], free)] = _rounded(found) * scale[free[kept]][:, None] / scale[None, free]
        kept = np.sort(np.concatenate([free[kept], np.flatnonzero(unknown.held)]))
        return cls(unknown, kept, grouping[kept], (W[..., kept] != 0).any(axis=0))

    @property
    def held(self) -> Array:
        """(r,) bool, True for groups that consist of one parameter with a known value."""
        return np.asarray(self.unknown.held[self.kept])

    @property
    def drives(self) -> Array:
        """(k,) groups whose kept parameter belongs to a drive: friction, motor inertia or offset."""
        return np.flatnonzero(self.unknown.of_bodies[self.kept] < 0)

    def weak_sizes(self, sizes: Array) -> Array:
        """Largest plausible sizes of the groups, for sizes (p,) of the parameters; almost zero for known groups.

        Returns
        -------
        sizes : (r,) array
        """
        return np.sqrt(self.grouping**2 @ sizes**2) * np.where(self.held, _HELD, 1.0)

    @property
    def count(self) -> int:
        """Number of groups."""
        return len(self.kept)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the groups, such as ``link_2.mcx + 0.225 link_3.m``, with the kept parameter first."""
        return tuple(self._name(k) for k in range(self.count))

    def project(self, values: Array) -> Array:
        """Values of the groups for given parameters.

        Returns
        -------
        groups : (r,) array
        """
        return np.asarray(self.grouping @ values)

    def _name(self, row: int) -> str:
        names, text = self.unknown.names, ""
        first = int(self.kept[row])
        order = [first, *(k for k in np.flatnonzero(self.grouping[row]).tolist() if k != first)]
        for k in order:
            value = float(self.grouping[row, k])
            size = "" if abs(abs(value) - 1.0) < 1e-6 else f"{number(abs(value), 6)} "
            sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
            text += f"{sign}{size}{names[k]}"
        return text


def _independent_columns(W: Array) -> tuple[Array, Array]:
    """Indices of columns (r,) that are independent of those before them, and coefficients of all columns in them (r, p).

    Uses the Gram-Schmidt process, twice for each column to limit rounding errors.
    """
    rows, p = W.shape
    lengths = np.linalg.norm(W, axis=0)
    longest = float(lengths.max(initial=0.0))
    Q = np.zeros((rows, p))
    kept: list[int] = []
    for k in range(p):
        if lengths[k] <= _NOTHING * longest:
            continue
        rest = W[:, k].copy()
        for _ in range(2):
            rest -= Q[:, : len(kept)] @ (Q[:, : len(kept)].T @ rest)
        size = float(np.linalg.norm(rest))
        if size > 1e3 * _NOTHING * lengths[k]:
            Q[:, len(kept)] = rest / size
            kept.append(k)
    which = np.array(kept, int)
    solved = np.linalg.lstsq(W[:, which], W, rcond=None)[0] if kept else np.zeros((0, p))
    relative = lengths[None, :] / np.maximum(lengths[which][:, None], 1e-300)
    solved[np.abs(solved) < _EXACT * np.maximum(relative, 1e-6)] = 0.0
    solved[:, which] = np.eye(len(which))
    return which, solved


def _rounded(grouping: Array) -> Array:
    return np.where(np.abs(grouping) < 1e-12, 0.0, grouping)


# ── Quantities that no log determines

_FED_FORWARD, _SPANNED = 1e-3, 1e-6
"""Residual, as a share of the torques, below that of any sensor; share of torques not spanned by other columns."""
_TURN, _GAIN = 0.3, 1.2


def undetermined(base: BaseParameters, left: float) -> dict[str, str]:
    """Sentences by name on quantities that no log determines; ``left`` is the residual as a share of the torques."""
    unknown, names = base.unknown, base.unknown.model.velocity_names
    kinds, held = np.array(unknown.kinds), unknown.held
    gain, zeros, signs = _spanned(base)
    here = {
        "gain-of-all": gain,
        "zero": bool(zeros),
        "clock-rate": bool(((kinds == "motor_inertia") & ~held).any()),
        "sign-of-both": bool(signs),
        "base-about-vertical": bool(np.any(unknown.model.gravity)),
        "asymmetric-friction": {"coulomb", "offset"} <= set(kinds[~held].tolist()),
        "fed-forward": left < _FED_FORWARD,
    }
    joints = {name: listed([names[k] for k in which]) for name, which in (("zero", zeros), ("sign-of-both", signs))}
    return {
        name: " ".join(spell_out(text).format(joints=joints.get(name), left=percent(left, 2)) for text in texts if text)
        for name, texts in undetermined_table().items()
        if here[name]
    }


def _spanned(base: BaseParameters) -> tuple[bool, list[int], list[int]]:
    """Errors of logs that other parameters of the robot can fully explain: a common gain, zeros, signs of position and torque.

    Torques of random states with such an error lie in the span of the columns without it; for signs, after a half turn
    of a joint.
    """
    unknown, model, free = base.unknown, base.unknown.model, ~base.held
    turning = [k for k in range(model.nv) if model.leaders[k].joint.turning[0]]
    rng, unit, speed = np.random.default_rng(0), np.eye(model.nv), np.ones(model.nv)
    q, dq, ddq = rng.normal(size=(3, 20 + 3 * base.count // model.nv, model.nv))
    x = np.where(free, rng.normal(size=base.count), base.project(unknown.file_values))

    def columns(turn: Array, sign: Array = speed) -> Array:
        return unknown.columns(base.kept, sign * q + turn, sign * dq, sign * ddq, speed)

    def spans(W: Array) -> Callable[[Array], bool]:
        known = W[:, :, ~free] @ x[~free]
        basis = np.linalg.qr(W[:, :, free].reshape(known.size, -1))[0]

        def spanned(tau: Array) -> bool:
            rest = (tau - known).ravel()
            return bool(np.linalg.norm(rest - basis @ (basis.T @ rest)) < _SPANNED * np.linalg.norm(tau))

        return spanned

    W = columns(0.0 * speed)
    as_it_is, halves = spans(W), [spans(columns(np.pi * unit[k])) for k in turning]
    zeros = [k for k in turning if as_it_is(columns(_TURN * unit[k]) @ x)]
    turned = {k: speed - 2.0 * unit[k] for k in turning}
    signs = [k for k, s in turned.items() if any(half(s * (columns(0.0 * s, s) @ x)) for half in halves)]
    return as_it_is(_GAIN * (W @ x)), zeros, signs


complete(globals())
