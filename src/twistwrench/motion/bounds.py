"""Limits of a motion, and their violations: excess over the limit, and time of the largest excess."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import TOLERANCE, margin, number, printed
from ..core.typing import Array
from ..mechanics.joints.units import Part, unit_of
from ..mechanics.model.couplings import drive_turns, motor_torques
from ..mechanics.model.joint_loads import follower_torques
from ..mechanics.model.limits import Limits
from ..robot.base import require_robot
from .coordinates import Coordinates

if TYPE_CHECKING:
    from ..mechanics.model.model import Model
    from ..robot import Robot


_EQUAL = 1e-12
"""Relative difference up to which two values of a motion are equal but for rounding."""


def first_largest(values: Array) -> Array:
    """Row of the largest value in each column (n, ...); of values that are equal but for rounding, the first."""
    largest = values.max(axis=0)
    least = largest - _EQUAL * np.abs(np.nan_to_num(largest))
    return np.asarray((values >= least).argmax(axis=0))


def bounds_or_own(robot: Robot, bounds: Limits | None) -> Limits:
    """Return the given bounds, or the robot's limits for None; raises ValueRangeError for other types."""
    if bounds is None:
        return robot.limits
    if not isinstance(bounds, Limits):
        raise ValueRangeError(
            f"bounds is {arguments.value_text(bounds)}: give tw.trajectories.bounds_of(robot, velocity=…), or None for "
            "the robot's own."
        )
    return bounds


def bounds_of(
    robot: Robot,
    *,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    effort: ArrayLike | None = None,
    deceleration: ArrayLike | None = None,
    jerk: ArrayLike | None = None,
) -> Limits:
    """Limits of a robot, with some replaced.

    Parameters
    ----------
    velocity : (nv,) array_like or float, optional [rad/s, m/s]
    acceleration : (nv,) array_like or float, optional; also the default of ``deceleration`` [rad/s², m/s²]
    effort : (nv,) array_like or float, optional [N m, sliding joints: N]
    deceleration : (nv,) array_like or float, optional [rad/s², m/s²]
    jerk : (nv,) array_like or float, optional [rad/s³, m/s³]

    Returns
    -------
    bounds : Limits

    Examples
    --------
    >>> import twistwrench as tw
    >>> bounds_of(tw.robots.planar_2r(), velocity=2.0).velocity.tolist()
    [2.0, 2.0]
    """
    require_robot(robot, "bounds_of")
    given_limits = {
        "velocity": velocity, "acceleration": acceleration, "deceleration": deceleration, "effort": effort, "jerk": jerk,
    }  # fmt: skip
    new_limits = {}
    for name, values in given_limits.items():
        if values is None:
            continue
        real_values = arguments.real(values, name, names=robot.model.velocity_names)
        array = np.asarray(real_values, float)
        if array.shape not in ((), (robot.nv,)):
            raise ShapeError(
                f"{name} has shape {array.shape}: give one number, or {robot.nv}, one for each of "
                f"{', '.join(robot.model.velocity_names[:_MAX_LISTED_JOINTS])}."
            )
        is_positive = array > 0
        if not is_positive.all():
            first_wrong = array[~is_positive].flat[0]
            raise ValueRangeError(f"{name} has {printed(first_wrong)}: a limit is above 0, inf for none.")
        new_limits[name] = np.broadcast_to(array, (robot.nv,)).copy()
    if "acceleration" in new_limits:
        new_limits.setdefault("deceleration", new_limits["acceleration"])
    return replace(robot.limits, **new_limits)


_TIME_BESIDE_END = 1e-9
"""Time [s] from an end of a motion to the velocity whose sign its friction has; too short to change other terms."""


def velocities_inside(time: Array, dq: Array, ddq: Array, begin: float, end: float) -> Array:
    """Velocities (..., nv) in which zeros at ``begin`` and ``end`` of a motion are replaced by the velocities just inside.

    At exactly zero speed, friction has no direction. But friction helps to brake a joint until the end of its motion, and acts
    against a joint from the start of its motion.

    >>> velocities_inside(np.array([0.0, 1.0]), np.zeros((2, 1)), np.array([[4.0], [-4.0]]), 0.0, 1.0).tolist()
    [[4e-09], [4e-09]]
    """
    if begin >= end:
        return dq
    is_start, is_end = time <= begin, time >= end
    inwards = 1.0 * is_start - 1.0 * is_end  # 1 at the start, -1 at the end, 0 between them
    dq_inside = _TIME_BESIDE_END * inwards[..., None] * ddq
    return np.where(dq == 0.0, dq_inside, dq)


_PARTS: dict[str, Part] = {"position": "q", "velocity": "dq", "acceleration": "ddq", "jerk": "dddq", "torque": "tau"}
"""Quantity of each kind of limit."""
KINDS = tuple(_PARTS)
"""Kinds of limits."""
_MAX_LISTED_JOINTS = 12
"""Largest number of joints that an error message lists."""


@dataclass(frozen=True)
class Violation:
    """Violation of a limit, at the time of its largest excess."""

    joint: str
    """Name of the joint."""
    kind: str
    """``position``, ``velocity``, ``acceleration``, ``jerk`` or ``torque``."""
    value: float
    """Value at that time, in ``unit``."""
    limit: float
    """Limit in ``unit``. If it bounds a magnitude, it has the sign of the value."""
    time: float
    """Time of the largest excess [s]."""
    unit: str = ""
    """Unit of value and limit."""

    @property
    def by(self) -> float:
        """Excess over the limit, positive [unit of the limit]."""
        return abs(self.value - self.limit)

    def __str__(self) -> str:
        limit = f"{number(self.limit, 5)} {self.unit}".rstrip()
        return f"{self.joint}: {self.kind} {number(self.value, 5)} beyond {limit} at {number(self.time)} s"

    def in_degrees(self) -> Violation:
        """The same violation with angles in degrees.

        Returns
        -------
        violation : Violation

        Examples
        --------
        >>> print(Violation("elbow", "velocity", 3.2, 3.0, 0.5, "rad/s").in_degrees())
        elbow: velocity 183.35 beyond 171.89 °/s at 0.5 s
        """
        if "rad" not in self.unit:
            return self
        unit = self.unit.replace("rad", "°")
        return replace(self, value=math.degrees(self.value), limit=math.degrees(self.limit), unit=unit)


class Extrema(NamedTuple):
    """Maximum of each column of a table of values; all arrays are (columns,)."""

    value: Array
    """Maximum; -inf for a column without numbers."""
    time: Array
    """First time of the maximum [s]; nan for a column without numbers."""
    signed: Array
    """Number with a sign, whose magnitude or excess over a limit is the maximum; 0 for a column without numbers."""

    @classmethod
    def from_rows(cls, time: Array, values: Array, signed: Array) -> Extrema:
        """Maxima of values (n, columns) at times (n,); ``signed`` (n, columns) has the signed numbers behind the values."""
        column_count = values.shape[1]
        if not len(values):
            no_maxima, no_times = np.full(column_count, -np.inf), np.full(column_count, np.nan)
            return cls(no_maxima, no_times, np.zeros(column_count))
        time_table = np.broadcast_to(time[:, None], values.shape)
        return cls._from_tables(time_table, values, signed)

    @classmethod
    def merge(cls, parts: Sequence[Extrema]) -> Extrema:
        """Maxima of all rows, from the maxima of consecutive parts."""
        values = np.stack([part.value for part in parts])
        times = np.stack([part.time for part in parts])
        signed = np.stack([part.signed for part in parts])
        return cls._from_tables(times, values, signed)

    @classmethod
    def _from_tables(cls, time: Array, values: Array, signed: Array) -> Extrema:
        """Maxima of values (n, columns), each with its own time and signed value; n ≥ 1."""
        rows = first_largest(values)
        columns = np.arange(values.shape[1])
        maxima = values.max(axis=0)
        is_known = maxima > -np.inf
        return cls(
            np.where(is_known, maxima, -np.inf),
            np.where(is_known, time[rows, columns], np.nan),
            np.where(is_known, signed[rows, columns], 0.0),
        )


class LimitCheck:
    """Running check of states against limits.

    Joints with several coordinates have infinite position limits. An excess below the tolerance is not a violation.
    """

    def __init__(self, model: Model, bounds: Limits) -> None:
        self.model, self.bounds = model, bounds
        self._followers = [model.bodies[i] for i in model.limited_followers]
        no_times = np.zeros(0)
        no_rows = np.zeros((0, model.nv))
        no_follower_rows = np.zeros((0, len(self._followers)))
        self._excesses = {kind: Extrema.from_rows(no_times, no_rows, no_rows) for kind in KINDS}
        """Largest excess of each kind so far; columns are velocities."""
        self._follower_torques = Extrema.from_rows(no_times, no_follower_rows, no_follower_rows)
        """Torque of largest magnitude of each mimic joint so far."""

    def _add(self, kind: str, time: Array, excess: Array, values: Array) -> None:
        """Add excesses (n, nv) of values (n, nv) at times (n,) over their limits of a kind."""
        extrema = Extrema.from_rows(time, excess, values)
        self._excesses[kind] = Extrema.merge([self._excesses[kind], extrema])

    def add(self, time: Array, q: Array, dq: Array, ddq: Array | None = None, tau: Array | None = None) -> None:
        """Check states at times (n,): q (n, nq), dq, ddq and torques (n, nv); None is skipped."""
        bounds = self.bounds
        positions = self.model.positions(q)
        position_excess = np.maximum(positions - bounds.upper, bounds.lower - positions)
        self._add("position", time, position_excess, positions)
        limit_of_kind = {"velocity": bounds.velocity, "torque": bounds.effort}
        if dq is not None and ddq is not None:
            limit_of_kind["acceleration"] = bounds.acceleration_at(dq, ddq)
        if tau is not None:
            tau = motor_torques(self.model, tau)
        for kind, values in (("velocity", dq), ("acceleration", ddq), ("torque", tau)):
            if values is not None:
                self._add(kind, time, np.abs(values) - limit_of_kind[kind], values)

    def add_jerk(self, time: Array, ddq: Array) -> None:
        """Check the slopes of accelerations (n, nv), n ≥ 3, of a motion from rest to rest.

        Accelerations that are not zero at the ends are jumps there, which count as slopes over one time step.
        """
        jerk = np.gradient(ddq, time, axis=0, edge_order=2)
        is_nonzero = np.abs(ddq) > TOLERANCE * np.abs(ddq).max(axis=0)
        steps_inward = {0: time[1] - time[0], -1: time[-2] - time[-1]}  # by row; negative at the end
        for end_row, step in steps_inward.items():
            jump_slope = ddq[end_row] / step
            jerk[end_row] = np.where(is_nonzero[end_row], jump_slope, jerk[end_row])
        self._add("jerk", time, np.abs(jerk) - self.bounds.jerk, jerk)

    def add_dynamics(self, robot: Robot, time: Array, q: Array, dq: Array, ddq: Array) -> None:
        """Check the torques of mimic joints with an effort limit in the given states, without friction."""
        if self._followers:
            wrenches = np.asarray(robot.joint_wrenches(q, dq, ddq))
            self.add_borne(time, follower_torques(self.model, wrenches))

    def add_borne(self, time: Array, torques: Array) -> None:
        """Check the torques (n, k) of the k mimic joints with an effort limit at times (n,)."""
        extrema = Extrema.from_rows(time, np.abs(torques), torques)
        self._follower_torques = Extrema.merge([self._follower_torques, extrema])

    def violations(self) -> tuple[Violation, ...]:
        """Violations, sorted by the ratio of the excess to the tolerance, largest first."""
        rated_violations = []  # with their ratios
        for kind, largest in self._excesses.items():
            names = self.model.velocity_names
            is_turning = Coordinates.from_model(self.model).angular_velocity.tolist()
            if kind == "torque":
                names = self.model.drive_labels
                is_turning = drive_turns(self.model)
            for k, value in enumerate(largest.signed.tolist()):
                excess = float(largest.value[k])
                limit = self._limit(kind, k, value, excess)
                tolerance = float(margin(abs(limit)))
                if kind == "position":
                    tolerance = float(self.bounds.tolerance[k])
                if not excess > tolerance:  # also for an excess of nan
                    continue
                ratio = np.inf
                if tolerance > 0:
                    ratio = excess / tolerance
                unit = unit_of(_PARTS[kind], bool(is_turning[k]))
                violation = Violation(names[k], kind, value, limit, float(largest.time[k]), unit)
                rated_violations.append((ratio, violation))
        for i, body in enumerate(self._followers):
            value = float(self._follower_torques.signed[i])
            excess = float(self._follower_torques.value[i] - body.effort)
            tolerance = float(margin(body.effort))
            if excess > tolerance:
                limit = float(np.copysign(body.effort, value))
                time = float(self._follower_torques.time[i])
                unit = unit_of("tau", bool(body.joint.turning[0]))
                violation = Violation(body.joint.name, "torque", value, limit, time, unit)
                rated_violations.append((excess / tolerance, violation))
        rated_violations.sort(key=lambda rated: -rated[0])  # by decreasing ratio
        return tuple(violation for _, violation in rated_violations)

    def _limit(self, kind: str, k: int, value: float, excess: float) -> float:
        """Limit of the velocity with index k that the value exceeds by ``excess``, with the sign of the value."""
        bounds = self.bounds
        if kind == "position":
            if value > bounds.upper[k]:
                return float(bounds.upper[k])
            return float(bounds.lower[k])
        limits_of_kind = {
            "velocity": [bounds.velocity],
            "torque": [bounds.effort],
            "jerk": [bounds.jerk],
            "acceleration": [bounds.acceleration, bounds.deceleration],  # to speed up, to brake
        }
        candidates = [float(limits[k]) for limits in limits_of_kind[kind]]
        exceeded = abs(value) - excess  # the limit, up to rounding
        nearest = min(candidates, key=lambda limit: abs(exceeded - limit))
        return float(np.copysign(nearest, value))


_MIN_SIGMAS = 3.0
"""Excess of a measured torque over its limit, in standard deviations of its noise, from which it is above the limit."""

# Shorter peaks above a limit are impacts, or allowed by gears with a peak rating.
_MIN_ROWS = 3
"""Least number of consecutive rows for which a torque stays above its limit."""
_MIN_TIME = 0.01
"""Least time for which a torque stays above its limit [s]."""


class TimeAbove(NamedTuple):
    """Longest run of consecutive rows in which measured torques are above their limits; arrays (nv,)."""

    rows: Array
    """Number of rows of the run; 0 if the torque is never above."""
    length: Array
    """Time from the first row of the run to its last [s]."""
    at: Array
    """Time at which the run begins [s]; nan if the torque is never above."""

    @classmethod
    def from_rows(cls, time: Array, is_above: Array) -> TimeAbove:
        """Longest run of True in each column of a mask (n, nv) at times (n,); the first run if several are equally long."""
        runs = [_longest_run(time, np.flatnonzero(column)) for column in is_above.T]
        row_counts, lengths, begins = np.array(runs).reshape(-1, 3).T  # also without columns
        return cls(row_counts.astype(int), lengths, begins)

    def is_lasting(self, step: float) -> Array:
        """Mask (nv,) of torques that stay above for at least three rows and 10 ms; each row lasts one ``step`` [s]."""
        is_long = self.length + step >= _MIN_TIME * (1 - 1e-6)  # also at exactly 10 ms, with rounded times
        return np.asarray((self.rows >= _MIN_ROWS) & is_long)


def _longest_run(time: Array, rows: Array) -> tuple[int, float, float]:
    """Number of rows, duration [s] and beginning [s] of the longest run of consecutive indices in ``rows``.

    Without rows, these are 0, 0 and nan.
    """
    run_starts = np.flatnonzero(np.diff(rows) > 1) + 1
    longest = max(np.split(rows, run_starts), key=len)
    if not len(longest):
        return 0, 0.0, np.nan
    begin = float(time[longest[0]])
    end = float(time[longest[-1]])
    return len(longest), end - begin, begin


def above_limits(tau: Array, limits: Array, sigma: Array) -> Array:
    """Mask (n, nv) of measured torques above their limits (nv,) by more than their noise (nv,)."""
    return np.asarray(np.abs(tau) > limits + _MIN_SIGMAS * sigma)


complete(globals())
