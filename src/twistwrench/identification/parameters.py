"""Parameters of a robot: ten of each moving body, motor inertia, friction and offset of each joint, and base parameters.

Row j of τ = W x, with Y the regressor of the bodies (Atkeson, An and Hollerbach, 1986) and v_0 the Coulomb smoothing
speed:

    τ_j = Y_j π + Ia_j ddq_j + fv_j dq_j + (fc_j + fs_j exp(-(dq_j / v_s)²)) tanh(dq_j / v_0j) + off_j

with fs the static friction in excess of Coulomb friction, and v_s the Stribeck speed, if requested (Armstrong-Hélouvry,
Dupont and Canudas de Wit, "A survey of models, analysis tools and compensation methods for the control of machines with
friction", Automatica 30(7), 1994).

A motor k that turns with several joints has the rate s_k · dq, with s_k (nv,) 1 for its own joint. It adds to the torques of
these joints

    s_k (Ia_k s_k·ddq + fv_k s_k·dq + fc_k tanh(s_k·dq / v_0))
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..core.errors import ModelError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number
from ..core.text import argument
from ..core.typing import Array
from ..mechanics.algorithms.inverse_dynamics import PARAMETER_NAMES
from ..mechanics.joints.units import units_of
from ..mechanics.model.couplings import without_couplings
from ..mechanics.model.model import BASE, Model
from ..robot import Robot
from ..robot.base import require_robot

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
_DRY_FRICTION = ("coulomb", "stribeck")
"""Kinds of parameters of dry friction."""
PARAMETER_UNITS = {
    "m": ("kg",),
    **dict.fromkeys(("mcx", "mcy", "mcz"), ("kg m",)),
    **dict.fromkeys(("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"), ("kg m^2",)),
    "motor_inertia": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    **dict.fromkeys(("coulomb", "stribeck", "offset"), units_of("tau", (True, False))),
}
"""SI units of each kind of parameter: at revolute joints, at prismatic joints; one unit if these are equal."""


def parameter_unit(kind: str, *, turning: bool) -> str:
    """SI unit of a kind of parameter, at a revolute or a prismatic joint."""
    units = PARAMETER_UNITS[kind]
    return units[0] if turning else units[-1]


def without_coupled_motors(robot: Robot) -> Robot:
    """Robot without its coupled motors; the same robot if no motors are coupled."""
    if not robot.model.couplings:
        return robot
    return Robot(without_couplings(robot.model))


def turning_joints(model: Model) -> Array:
    """Mask (nv,) of joints that turn."""
    return np.array([body.joint.turning[0] for body in model.leaders], bool)


def group_units(groups: Sequence[str], model: Model) -> tuple[str, ...]:
    """SI units of groups of parameters: the units of their first parameters."""
    sliding = {body.joint.name for body in model.bodies if not any(body.joint.turning)}
    units: list[str] = []
    for name in first_parameters(groups):
        owner, _, kind = name.rpartition(".")
        units.append(parameter_unit(kind, turning=owner not in sliding))
    return tuple(units)


def first_parameters(groups: Sequence[str]) -> list[str]:
    """First parameter of each of some groups, by their names."""
    return [name.split(" ")[0] for name in groups]


_BODY_PARAMETERS = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "mcx", "mcy", "mcz", "m")
"""Order of the ten parameters of a body in the choice of base parameters: moments first, as in papers on base parameters."""
_MIN_LENGTH = 0.05
"""Least typical length of a robot [m]."""
_MIN_MASS = 1e-3
"""Least typical mass of a robot [kg]."""


@dataclass(frozen=True, eq=False)
class UnknownParameters:
    """Unknown parameters of a robot, and their columns in the torques.

    Parameters
    ----------
    robot : Robot
        Every joint must have one degree of freedom. The robot's friction and armature are treated as unknown.
    motor_inertia : bool, a motor inertia for each joint, reflected to the joint
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
        _check_identifiable(robot)
        if robot.model.couplings:
            if self.motor_side is not None and len(self.motor_side.coupled_rates):
                raise ModelError("couplings are in the robot's model and in motor_side. Give them once.")
            from .payload import MotorSide

            object.__setattr__(self, "motor_side", MotorSide.of_couplings(robot.model))
        has_drives = robot.model.armature.any() or robot.actuators or robot.model.couplings
        if has_drives:  # they are unknown, and parameters of their own
            model_without_drives = replace(without_couplings(robot.model), armature=np.zeros(robot.nv), actuators={})
            object.__setattr__(self, "robot", Robot(model_without_drives))
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
        """Indices of the bodies that are links; a massless body between two joints of one link is left out."""
        return tuple(i for i, body in enumerate(self.model.bodies) if body.link in self.model.link_inertias)

    @cached_property
    def coupled(self) -> Array:
        """Rates s_k (k, nv) of motors that turn with several joints, for a unit rate of each joint; 1 for its own joint."""
        if self.motor_side is None:
            return np.zeros((0, self.model.nv))
        return self.motor_side.coupled_rates

    @cached_property
    def _entries(self) -> tuple[tuple[str, str, int], ...]:
        """Name, kind and index of each parameter.

        The index is a column of the regressor for a body, a joint for its drive, and a coupled motor for kinds such as
        ``coupled viscous``.
        """
        model = self.model
        entries = list[tuple[str, str, int]]()
        drive_kinds = [kind for kind in DRIVE[1:] if kind in self.friction]
        if self.motor_inertia:
            drive_kinds.insert(0, "motor_inertia")
        for i, body in enumerate(model.bodies):
            if i in self.bodies:
                first_column = 10 * i
                for kind in _BODY_PARAMETERS:
                    entries.append((f"{body.link}.{kind}", kind, first_column + PARAMETER_NAMES.index(kind)))
            if not body.follows:
                entries += [(f"{body.joint.name}.{kind}", kind, body.v_index) for kind in drive_kinds]
        for k, rates in enumerate(self.coupled):
            motor = self.motor_side.coupled_motors[k] if self.motor_side is not None else ""
            if not motor:  # a motor without a name is named by its joints
                motor = "+".join(model.velocity_names[j] for j in np.flatnonzero(rates))
            entries += [(f"{motor}.{kind}", f"coupled {kind}", k) for kind in drive_kinds if kind != "offset"]
        return tuple(entries)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, such as ``link_2.Ixx`` and ``joint_2.coulomb``, from the base outward."""
        return tuple(name for name, _, _ in self._entries)

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each parameter: m, mcx, …, Izz, motor_inertia, viscous, coulomb, stribeck or offset."""
        return tuple(kind.removeprefix("coupled ") for _, kind, _ in self._entries)

    @cached_property
    def of_bodies(self) -> Array:
        """Column (p,) of the regressor for each parameter; -1 for parameters of drives."""
        return np.array([column if kind in PARAMETER_NAMES else -1 for _, kind, column in self._entries])

    @cached_property
    def file_values(self) -> Array:
        """Values (p,) of the robot file, 0 for drives; known values replace them."""
        is_body = self.of_bodies >= 0
        values = np.where(is_body, self.robot.parameters[self.of_bodies], 0.0)
        for k in np.flatnonzero(self.held):
            values[k] = self.known[self.names[k]]
        return values

    @cached_property
    def held(self) -> Array:
        """Mask (p,) of parameters with known values."""
        return np.isin(self.names, list(self.known))

    @cached_property
    def lengths(self) -> tuple[float, float]:
        """Mass [kg] and reach [m] of the whole robot, for weak priors and scales."""
        model = self.model
        distances = np.zeros(len(model.bodies))  # of each joint from the first one, along the links
        length = _MIN_LENGTH
        for i, body in enumerate(model.bodies):
            if body.parent != BASE:
                distances[i] = distances[body.parent] + float(np.linalg.norm(body.placement[:3, 3]))
            length = max(length, float(distances[i] + np.linalg.norm(body.inertia.com)))
        mass = 1.0  # of a robot file without masses
        if model.moving_mass > 0:
            mass = max(model.moving_mass, _MIN_MASS)
        return mass, length

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
        inertia_scale = mass * length**2
        body_scales = {"m": mass, **dict.fromkeys(("mcx", "mcy", "mcz"), mass * length)}
        drive_scales = {  # (nv,) each
            "motor_inertia": torque / acceleration,
            "viscous": torque / speed,
            "coulomb": torque,
            "stribeck": torque,
            "offset": torque,
        }
        scales = []
        for _, kind, index in self._entries:
            drive_kind = kind.removeprefix("coupled ")
            if drive_kind not in DRIVE:
                scales.append(body_scales.get(kind, inertia_scale))
            elif drive_kind == kind:
                scales.append(float(drive_scales[kind][index]))
            else:  # coupled motor: the largest of its joints
                is_own_joint = self.coupled[index] != 0
                scales.append(float(drive_scales[drive_kind][is_own_joint].max()))
        return np.array(scales)

    def columns(
        self,
        which: Array,
        q: Array,
        dq: Array,
        ddq: Array,
        friction_speed: Array,
        gravity: Array | None = None,
    ) -> Array:
        """Columns of some of the parameters in the torques.

        Parameters
        ----------
        which : (k,) array, indices of the parameters
        q, dq, ddq : (n, nv) arrays
        friction_speed : (nv,) array, v_0
        gravity : (3,) array, optional, replaces the robot's

        Returns
        -------
        W : (n, nv, k) array
        """
        if gravity is None:
            gravity = self.model.gravity
        W = np.zeros((*dq.shape, len(which)))
        regressor_columns = self.of_bodies[which]
        of_bodies = np.flatnonzero(regressor_columns >= 0)  # positions in ``which``
        if of_bodies.size:
            Y = self.regressor(q, dq, ddq, gravity)
            W[:, :, of_bodies] = Y[..., regressor_columns[of_bodies]]
        of_drives = np.flatnonzero(regressor_columns < 0)
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
        columns = []
        for column, parameter in enumerate(which):
            _, kind, index = self._entries[int(parameter)]
            if kind in _DRY_FRICTION:
                columns.append((column, np.arange(self.model.nv) == index))
            elif kind.removeprefix("coupled ") in _DRY_FRICTION:
                columns.append((column, self.coupled[index] != 0))
        return columns

    @cached_property
    def shares(self) -> Array:
        """Column (p, nv) of each drive parameter at the joints, divided by its factor; 0 for parameters of bodies."""
        shares = np.zeros((len(self._entries), self.model.nv))
        for row, (_, kind, index) in zip(shares, self._entries, strict=True):
            if kind in DRIVE:
                row[index] = 1.0
            elif kind.startswith("coupled "):
                row[:] = self.coupled[index]
        return shares

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
        kinds = np.array(self.kinds)[which]
        shares = self.shares[which]
        rates = dq @ shares.T  # of the motors
        # columns of each kind
        inertia = np.flatnonzero(kinds == "motor_inertia")
        viscous = np.flatnonzero(kinds == "viscous")
        dry = np.flatnonzero(np.isin(kinds, _DRY_FRICTION))
        stribeck = np.flatnonzero(kinds == "stribeck")
        smoothing_speeds = friction_speed[[speed_owner(shares[k]) for k in dry]]
        factors = np.ones((len(dq), len(which)))  # factors of offsets stay 1
        factors[:, inertia] = ddq @ shares[inertia].T
        factors[:, viscous] = rates[:, viscous]
        factors[:, dry] = np.tanh(rates[:, dry] / smoothing_speeds)
        factors[:, stribeck] *= np.exp(-((rates[:, stribeck] / self.stribeck_speed) ** 2))
        return factors


def _check_identifiable(robot: Robot) -> None:
    """Raise ModelError if a robot has no joints, joints of several degrees of freedom, or rotors already."""
    for body in robot.model.leaders:
        if body.joint.nv != 1:
            raise ModelError(
                f"joint {body.joint.name!r} of {robot.name!r} has several degrees of freedom, whose forces no motor measures. "
                "Identify the robot on a stand: load it without a floating base."
            )
    if robot.nv == 0:
        raise ModelError(f"robot {robot.name!r} has no joint that moves, so there is nothing to identify.")
    if any(actuator.rotor is not None for actuator in robot.actuators.values()):
        raise ModelError(
            f"robot {robot.name!r} has actuators already, and motor inertia and friction are what is sought. Give the "
            f"robot without them, and their file as {argument('actuators')}."
        )


def speed_owner(joints: Array) -> int:
    """Index of the joint whose friction speed applies to a column of dry friction: the last in the mask ``joints`` (nv,)."""
    return int(np.flatnonzero(joints)[-1])


def check_speed(value: float) -> float:
    """Return a friction speed or cut-off if it is a number above 0; otherwise raise ValueRangeError."""
    if not (np.isfinite(value) and value > 0):
        raise ValueRangeError(
            f"{value!r} is not a valid speed or frequency. Give a number above 0, or leave it to the program."
        )
    return float(value)


# ── Base parameters: the identifiable groups, for any motion

# Columns of W on random states are linearly dependent. From the base outward, a column is kept if it is independent of the kept
# columns before it. With the kept columns W_b and the others W_d = W_b B, τ = W_b (x_b + B x_d): the groups are x_b + B x_d.
#
# Source: Gautier, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8(4), 1991. The
# rank is determined on random states with an absolute scale, because in a log, columns of rounding errors look like all others.

_MAX_ROUNDING = 1e-9  # length of a column that consists of rounding errors, as a share of the longest column's
_MAX_DEPENDENT_REMAINDER = 1e3 * _MAX_ROUNDING  # remainder of a dependent column, as a share of its length
_ROWS_PER_COLUMN = 3  # equations of random states for each parameter
_ADDITIONAL_STATES = 8  # random states beside these
_KNOWN_ERROR = 1e-7  # allowed error of a known value, as a share of its size
_MIN_COEFFICIENT = 1e-7  # coefficients below this are rounding errors, in units of the columns' lengths


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
        state_count = -(-_ROWS_PER_COLUMN * p // nv) + _ADDITIONAL_STATES  # -(-a // b) rounds a / b up
        q = robot.random_configuration(rng, state_count)
        # joints that turn get any angle: limits do not change which parameters are identifiable
        any_angles = rng.uniform(-np.pi, np.pi, q.shape)
        q = np.where(turning_joints(unknown.model), any_angles, q)
        dq, ddq = rng.normal(size=(2, state_count, nv)) * 2.0
        ones = np.ones(nv)
        W = unknown.columns(np.arange(p), q, dq, ddq, 0.5 * ones, gravity)
        scale = unknown.scales(ones, ones, ones)
        free = np.flatnonzero(~unknown.held)  # parameters without known values
        scaled_columns = (W * scale)[..., free].reshape(state_count * nv, len(free))
        kept_of_free, B = _independent_columns(scaled_columns)
        free_kept = free[kept_of_free]
        # B is of the scaled columns W S, with x = S z: the groups z_b + B z_d become x_b + S_b B S_d⁻¹ x_d.
        grouping = np.eye(p)  # a known parameter is a group by itself
        B = _without_rounding_errors(B)
        grouping[np.ix_(free_kept, free)] = B * scale[free_kept][:, None] / scale[None, free]
        kept = np.sort(np.concatenate([free_kept, np.flatnonzero(unknown.held)]))
        felt = (W[..., kept] != 0).any(axis=0)
        return cls(unknown, kept, grouping[kept], felt)

    @property
    def held(self) -> Array:
        """Mask (r,) of groups that consist of one parameter with a known value."""
        return np.asarray(self.unknown.held[self.kept])

    @property
    def drives(self) -> Array:
        """Indices (k,) of the groups whose kept parameter belongs to a drive: friction, motor inertia or offset."""
        return np.flatnonzero(self.unknown.of_bodies[self.kept] < 0)

    def weak_sizes(self, sizes: Array) -> Array:
        """Largest plausible sizes of the groups, for sizes (p,) of the parameters; almost zero for known groups.

        Returns
        -------
        sizes : (r,) array
        """
        group_sizes = np.sqrt(self.grouping**2 @ sizes**2)
        return group_sizes * np.where(self.held, _KNOWN_ERROR, 1.0)

    @property
    def count(self) -> int:
        """Number of groups."""
        return len(self.kept)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the groups, such as ``link_2.mcx + 0.225 link_3.m``, with the kept parameter first."""
        return tuple(map(self._name, range(self.count)))

    def project(self, values: Array) -> Array:
        """Values of the groups for given parameters.

        Returns
        -------
        groups : (r,) array
        """
        return np.asarray(self.grouping @ values)

    def _name(self, row: int) -> str:
        """Name of the group in a row of ``grouping``, with the kept parameter first."""
        coefficients = self.grouping[row].tolist()
        first = int(self.kept[row])
        others = np.flatnonzero(self.grouping[row]).tolist()
        if first in others:
            others.remove(first)
        text = "-" if coefficients[first] < 0 else ""
        text += self._term(row, first)
        for k in others:
            value = coefficients[k]
            text += (" - " if value < 0 else " + ") + self._term(row, k)
        return text

    def _term(self, row: int, k: int) -> str:
        """Magnitude of a coefficient and name of its parameter; a magnitude of 1 is left out."""
        magnitude = abs(float(self.grouping[row, k]))
        if abs(magnitude - 1.0) < 1e-6:
            return self.unknown.names[k]
        return f"{number(magnitude, 6)} {self.unknown.names[k]}"


def _independent_columns(W: Array) -> tuple[Array, Array]:
    """Indices (r,) of columns that are independent of the columns before them, and coefficients (r, p) of all columns in these.

    Uses the Gram-Schmidt process, twice for each column to limit rounding errors.
    """
    row_count, p = W.shape
    lengths = np.linalg.norm(W, axis=0)
    longest = float(lengths.max(initial=0.0))
    Q = np.zeros((row_count, p))  # its first columns are an orthonormal basis of the kept columns
    kept: list[int] = []
    for k in range(p):
        if lengths[k] <= _MAX_ROUNDING * longest:
            continue
        basis = Q[:, : len(kept)]
        remainder = W[:, k].copy()
        for _ in range(2):
            remainder -= basis @ (basis.T @ remainder)
        remaining_length = float(np.linalg.norm(remainder))
        if remaining_length > _MAX_DEPENDENT_REMAINDER * lengths[k]:
            Q[:, len(kept)] = remainder / remaining_length
            kept.append(k)
    columns = np.array(kept, int)
    coefficients = np.zeros((0, p))
    if kept:
        coefficients, *_ = np.linalg.lstsq(W[:, columns], W, rcond=None)
    # size of a coefficient of 1 between two columns of unit length
    length_ratios = lengths[None, :] / np.maximum(lengths[columns][:, None], 1e-300)
    is_rounding = np.abs(coefficients) < _MIN_COEFFICIENT * np.maximum(length_ratios, 1e-6)
    coefficients[is_rounding] = 0.0
    coefficients[:, columns] = np.eye(len(columns))
    return columns, coefficients


def _without_rounding_errors(grouping: Array) -> Array:
    """Coefficients of a grouping, with rounding errors set to zero."""
    return np.where(np.abs(grouping) < 1e-12, 0.0, grouping)


complete(globals())
