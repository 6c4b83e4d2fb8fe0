"""Joint limits with their tolerance, and joint friction. Modern Robotics section 8.9.4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from ...core.numbers import TOLERANCE
from ...core.typing import Array

__all__ = [
    "BEARINGS",
    "BEARING_UNITS",
    "FASTEST_TURN",
    "Limits",
    "StatedLimits",
    "bears",
    "known_velocities",
]


BEARING_UNITS = {"axial": "N", "radial": "N", "tilting": "N m"}
"""Units of the limits of bearings by kind: force along the axis, force across it, moment across it."""
BEARINGS = tuple(BEARING_UNITS)
"""Kinds of limits of bearings."""

FASTEST_TURN = 60.0
"""Velocity limit [rad/s] from which it is a placeholder or in another unit; joints of quadrupeds reach 52 rad/s."""
FASTEST_SLIDE = 100.0
"""Velocity limit [m/s] from which it is a placeholder or in another unit."""


def known_velocities(velocity: Array, turning: Array) -> Array:
    """Velocity limits of joints; inf for missing limits, and for placeholders far above the speeds of joints.

    Parameters
    ----------
    velocity : (n,) array, limits [rad/s, m/s]
    turning : (n,) array of bool, True for joints that turn

    Returns
    -------
    known : (n,) array

    Examples
    --------
    >>> known_velocities(np.array([3.0, 1e9]), np.array([True, False])).tolist()
    [3.0, inf]
    """
    smallest_placeholder = np.where(turning, FASTEST_TURN, FASTEST_SLIDE)
    return np.where(velocity < smallest_placeholder, velocity, np.inf)


def bears(limits: Limits) -> bool:
    """True if a bearing of some joint has a limit.

    Parameters
    ----------
    limits : Limits

    Returns
    -------
    found : bool

    Examples
    --------
    >>> bears(Limits(*np.ones((4, 2))))
    False
    """
    return any(np.isfinite(getattr(limits, kind)).any() for kind in BEARINGS)


@dataclass(frozen=True, eq=False)
class Limits:
    """Joint limits, one entry per velocity, (nv,) each; inf if not given.

    If only acceleration or deceleration is given, it is used for both.

    Examples
    --------
    >>> limits = Limits(np.array([0.0]), np.array([1.5]), np.array([np.inf]), np.array([np.inf]))
    >>> limits.exceeded([[-1e-7], [-1e-5]])
    array([[False],
           [ True]])
    >>> Limits(limits.lower, limits.upper, limits.velocity, limits.effort, np.array([5.0])).deceleration.tolist()
    [5.0]
    """

    lower: Array
    """Smallest positions [rad or m]."""
    upper: Array
    """Largest positions [rad or m]."""
    velocity: Array
    """Largest velocities [rad/s or m/s]."""
    effort: Array
    """Largest torques [N m or N]."""
    acceleration: Array = None  # type: ignore[assignment]
    """Largest accelerations of a joint that speeds up [rad/s² or m/s²]."""
    deceleration: Array = None  # type: ignore[assignment]
    """Largest decelerations of a joint that slows down [rad/s² or m/s²]."""
    jerk: Array = None  # type: ignore[assignment]
    """Largest jerks [rad/s³ or m/s³]."""
    axial: Array = None  # type: ignore[assignment]
    """Largest forces on the bearings along the axes of turning joints [N]."""
    radial: Array = None  # type: ignore[assignment]
    """Largest forces on the bearings across the axes [N]."""
    tilting: Array = None  # type: ignore[assignment]
    """Largest moments on the bearings across the axes; for sliding joints about any axis [N m]."""

    if not TYPE_CHECKING:  # type checkers reject it

        def __getitem__(self, kind: str) -> NoReturn:
            """Raise TypeError: limits are attributes."""
            attribute = kind if kind in vars(self) else "effort"  # an example, if there is no such kind
            raise TypeError(f"Limits has attributes, not keys: use robot.limits.{attribute}")

    def __post_init__(self) -> None:
        infinite = np.full(np.shape(self.velocity), np.inf)
        acceleration = infinite if self.acceleration is None else self.acceleration
        deceleration = infinite if self.deceleration is None else self.deceleration
        object.__setattr__(self, "acceleration", np.where(np.isinf(acceleration), deceleration, acceleration))
        object.__setattr__(self, "deceleration", np.where(np.isinf(deceleration), acceleration, deceleration))
        for name in ("jerk", *BEARINGS):
            if getattr(self, name) is None:
                object.__setattr__(self, name, infinite)

    @property
    def tolerance(self) -> Array:
        """Largest excess over a position limit at which a joint still counts as at the limit, (nv,) [rad or m].

        :data:`TOLERANCE` times the larger finite position limit of the joint, or times 1 if both are infinite or zero.
        """
        sizes = np.abs(np.stack([self.lower, self.upper]))
        finite_sizes = np.where(np.isfinite(sizes), sizes, 0.0)
        larger_size = np.max(finite_sizes, axis=0)
        scale = np.where(larger_size > 0.0, larger_size, 1.0)
        return np.asarray(TOLERANCE * scale)

    def exceeded(self, positions: Any) -> Array:
        """True for each joint beyond a position limit by more than :attr:`tolerance`.

        Parameters
        ----------
        positions : (..., nv) array_like, coordinate of each velocity [rad or m], see :meth:`Model.positions`

        Returns
        -------
        exceeded : (..., nv) array of bool; False for NaN
        """
        x = np.asarray(positions, float)
        tolerance = self.tolerance
        return np.asarray((x < self.lower - tolerance) | (x > self.upper + tolerance))

    def select(self, indices: Sequence[int] | slice | Array) -> Limits:
        """Limits of selected velocities, in that order.

        Parameters
        ----------
        indices : (k,) ints, or slice

        Returns
        -------
        limits : Limits, of k velocities

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().limits.select([5, 0]).effort.tolist()
        [28.0, 150.0]
        """
        return Limits(*(getattr(self, limit.name)[indices] for limit in fields(Limits)))

    def has_unit(self, kind: str) -> Array:
        """True for each joint whose limit of a kind was given with its unit; limits of files are given without.

        Parameters
        ----------
        kind : str, such as ``"effort"``

        Returns
        -------
        found : (nv,) array of bool

        Examples
        --------
        >>> Limits(*np.ones((4, 2))).has_unit("effort").tolist()
        [False, False]
        """
        return np.zeros(np.shape(getattr(self, kind)), bool)

    def acceleration_at(self, dq: Array, ddq: Array) -> Array:
        """Acceleration limit at a state: for a joint that slows down the deceleration limit, at rest the larger of the two.

        Parameters
        ----------
        dq, ddq : (..., nv) arrays

        Returns
        -------
        limit : (..., nv) array [rad/s² or m/s²]

        Examples
        --------
        >>> free = np.full(1, np.inf)
        >>> limits = Limits(-free, free, free, free, np.array([2.0]), np.array([5.0]))
        >>> limits.acceleration_at(np.array([[1.0], [1.0], [0.0]]), np.array([[1.0], [-1.0], [1.0]])).tolist()
        [[2.0], [5.0], [5.0]]
        """
        speed = np.abs(dq)
        batch_axes = tuple(range(speed.ndim - 1))
        largest_speed = speed.max(initial=0.0, axis=batch_axes)  # of each joint
        is_at_rest = speed <= TOLERANCE * largest_speed
        larger_limit = np.maximum(self.acceleration, self.deceleration)
        limit_in_motion = np.where(dq * ddq < 0, self.deceleration, self.acceleration)
        return np.where(is_at_rest, larger_limit, limit_in_motion)


@dataclass(frozen=True, eq=False)
class StatedLimits(Limits):
    """Limits, some of them given by the user."""

    stated: Array = field(kw_only=True)
    """(nv,) of bool: joints with an effort given by the user."""
    with_unit: Array = field(kw_only=True)
    """(kinds, nv) of bool, in the order of the fields of :class:`Limits`: limits that the user gave with their unit."""
    of_locked: tuple[str, ...] = field(default=(), kw_only=True)
    """Names of the locked joints whose limits were given; these limits are ignored."""

    def has_unit(self, kind: str) -> Array:
        """True for each joint whose limit of a kind was given with its unit, so that the unit is not doubted.

        Parameters
        ----------
        kind : str, such as ``"effort"``

        Returns
        -------
        found : (nv,) array of bool

        Examples
        --------
        >>> limits = StatedLimits(*np.ones((4, 1)), stated=np.array([True]), with_unit=np.eye(10, 1, -3, dtype=bool))
        >>> limits.has_unit("effort").tolist(), limits.has_unit("velocity").tolist()
        ([True], [False])
        """
        kinds = [limit.name for limit in fields(Limits)]
        return np.asarray(self.with_unit[kinds.index(kind)])


# ── Joint friction as data: viscous, Coulomb, static, Stribeck, load-dependent. Modern Robotics section 8.9.4

NONE_GIVEN = "friction is requested, but the robot file has none; add it with robot.with_actuators"
"""Warning if friction is requested and the robot has none."""


@dataclass(frozen=True, eq=False)
class Friction:
    """Joint friction, (nv,) each: parameters of the torque that keeps a joint moving at the velocity ``dq``.

    ``viscous dq + sign(dq) (coulomb + (static - coulomb) exp(-(dq / stribeck)²) + load |torque carried|)``.

    At rest it is 0, and friction balances a load up to ``static``.
    """

    viscous: Array
    """Viscous coefficient [N m s/rad or N s/m]."""
    coulomb: Array
    """Coulomb friction [N m or N]."""
    static: Array
    """Breakaway torque [N m or N], at least ``coulomb``."""
    stribeck: Array
    """Stribeck speed, of the transition from static to Coulomb friction, above 0 [rad/s or m/s]."""
    load: Array
    """Friction per carried torque, below 1."""

    def __post_init__(self) -> None:
        for parameter in fields(self):
            getattr(self, parameter.name).setflags(write=False)

    def __setstate__(self, state: dict[str, Array]) -> None:
        vars(self).update(state)
        self.__post_init__()  # unpickled arrays are writable

    @classmethod
    def plain(cls, viscous: Array, coulomb: Array) -> Friction:
        """Viscous and Coulomb friction only, as in robot files."""
        viscous = np.array(viscous, float)
        coulomb = np.array(coulomb, float)
        return cls(viscous, coulomb, static=coulomb.copy(), stribeck=np.ones_like(coulomb), load=np.zeros_like(coulomb))

    def select(self, indices: Sequence[int] | Array) -> Friction:
        """Friction of selected velocities, in that order."""
        return Friction(*(getattr(self, name)[indices] for name in LAWS))

    def replaced(self, index: int, **values: float) -> Friction:
        """Friction with other values for the velocity at an index."""
        arrays = {name: getattr(self, name).copy() for name in LAWS}
        for name, value in values.items():
            arrays[name][index] = value
        return Friction(**arrays)

    def extended(self) -> Friction:
        """Friction with one more velocity, free of friction, at the end."""
        frictionless = Friction.plain(np.zeros(1), np.zeros(1))
        return Friction(*(np.append(getattr(self, name), getattr(frictionless, name)) for name in LAWS))

    def moved(self, index: int, to: int) -> Friction:
        """Friction with the entry of one velocity moved to another index; the old index is left without friction."""
        moved_values = {name: float(getattr(self, name)[index]) for name in LAWS}
        no_friction = dict.fromkeys(LAWS, 0.0) | {"stribeck": 1.0}
        return self.replaced(to, **moved_values).replaced(index, **no_friction)

    @property
    def any(self) -> bool:
        """True if any joint has friction."""
        return bool(self.viscous.any() or self.static.any() or self.load.any())


LAWS = tuple(parameter.name for parameter in fields(Friction))
"""Names of the friction parameters, in the order of the fields of :class:`Friction`; also their names in actuator files."""
