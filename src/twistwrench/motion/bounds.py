"""Limits of a motion, and limit check: violations with their excess and the time of the largest excess."""

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
    limits = {"velocity": velocity, "acceleration": acceleration, "deceleration": deceleration}
    limits |= {"effort": effort, "jerk": jerk}
    replaced = {}
    for name, values in limits.items():
        if values is None:
            continue
        array = np.asarray(arguments.real(values, name, names=robot.model.velocity_names), float)
        if array.shape not in ((), (robot.nv,)):
            raise ShapeError(
                f"{name} has shape {array.shape}: give one number, or {robot.nv}, one for each of "
                f"{', '.join(robot.model.velocity_names[:12])}."
            )
        if not (array > 0).all():
            raise ValueRangeError(
                f"{name} has {printed(array[~(array > 0)].flat[0])}: a limit is above 0, inf for none."
            )
        replaced[name] = np.broadcast_to(array, (robot.nv,)).copy()
    if "acceleration" in replaced:
        replaced.setdefault("deceleration", replaced["acceleration"])
    return replace(robot.limits, **replaced)


_TIME_BESIDE_END = 1e-9
"""Time [s] from an end of a motion at which its friction is taken: long enough for a sign, too short for any other term."""


def velocities_inside(time: Array, dq: Array, ddq: Array, begin: float, end: float) -> Array:
    """Velocities (..., nv) with zeros at ``begin`` and ``end`` of a motion replaced by those just inside.

    A joint that arrives with its braking acceleration slides until it stands, so that friction still helps to brake it; one
    that leaves with an acceleration has friction against it from the start. At exactly zero speed, neither is defined.

    >>> velocities_inside(np.array([0.0, 1.0]), np.zeros((2, 1)), np.array([[4.0], [-4.0]]), 0.0, 1.0).tolist()
    [[4e-09], [4e-09]]
    """
    if begin >= end:
        return dq
    direction = 1.0 * (time <= begin) - 1.0 * (time >= end)
    return np.where(dq == 0.0, _TIME_BESIDE_END * direction[..., None] * ddq, dq)


_PARTS: dict[str, Part] = {"position": "q", "velocity": "dq", "acceleration": "ddq", "jerk": "dddq", "torque": "tau"}
"""Quantity of each kind of limit."""
KINDS = tuple(_PARTS)


@dataclass(frozen=True)
class Violation:
    """Violation of a limit, at the time of its largest excess."""

    joint: str
    """Name of the joint."""
    kind: str
    """``position``, ``velocity``, ``acceleration``, ``jerk`` or ``torque``."""
    value: float
    """Value [unit of the limit]."""
    limit: float
    """Limit; if it bounds a magnitude, with the sign of the value."""
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
        value, limit = math.degrees(self.value), math.degrees(self.limit)
        return replace(self, value=value, limit=limit, unit=self.unit.replace("rad", "°"))


class Extrema(NamedTuple):
    """Maximum of each column of a table, (columns,) each; -inf at the time nan without a number above it."""

    value: Array
    time: Array
    """Time of the maximum, of the first one if several are equal [s]."""
    signed: Array
    """Signed value whose magnitude or excess is the maximum."""

    @classmethod
    def from_rows(cls, time: Array, values: Array, signed: Array) -> Extrema:
        """Maxima of values (n, columns) at times (n,); ``signed`` (n, columns) has the numbers behind the values."""
        count = values.shape[1]
        if not len(values):
            return cls(np.full(count, -np.inf), np.full(count, np.nan), np.zeros(count))
        return cls._of(np.broadcast_to(time[:, None], values.shape), values, signed)

    @classmethod
    def merge(cls, parts: Sequence[Extrema]) -> Extrema:
        """Maxima of consecutive rows from those of their parts."""
        value, time, signed = map(np.stack, zip(*parts, strict=True))
        return cls._of(time, value, signed)

    @classmethod
    def _of(cls, time: Array, values: Array, signed: Array) -> Extrema:
        rows, columns = values.argmax(axis=0), np.arange(values.shape[1])
        value = values[rows, columns]
        known = value > -np.inf
        return cls(
            np.where(known, value, -np.inf),
            np.where(known, time[rows, columns], np.nan),
            np.where(known, signed[rows, columns], 0.0),
        )


class LimitCheck:
    """Running check of states against limits.

    Joints with several coordinates have infinite position limits. An excess below the tolerance is not a violation.
    """

    def __init__(self, model: Model, bounds: Limits) -> None:
        self.model, self.bounds = model, bounds
        none = np.zeros(0)
        self._worst = {kind: Extrema.from_rows(none, *np.zeros((2, 0, model.nv))) for kind in KINDS}
        self._followers = [model.bodies[i] for i in model.limited_followers]
        self._borne = Extrema.from_rows(none, *np.zeros((2, 0, len(self._followers))))

    def _add(self, kind: str, time: Array, beyond: Array, values: Array) -> None:
        self._worst[kind] = Extrema.merge([self._worst[kind], Extrema.from_rows(time, beyond, values)])

    def add(self, time: Array, q: Array, dq: Array, ddq: Array | None = None, tau: Array | None = None) -> None:
        """Check states at times (n,): q (n, nq), dq, ddq and torques (n, nv); None is skipped."""
        b, x = self.bounds, self.model.positions(q)
        self._add("position", time, np.maximum(x - b.upper, b.lower - x), x)
        largest = {"velocity": b.velocity, "torque": b.effort}
        if dq is not None and ddq is not None:
            largest["acceleration"] = b.acceleration_at(dq, ddq)
        if tau is not None:
            tau = motor_torques(self.model, tau)
        for kind, values in (("velocity", dq), ("acceleration", ddq), ("torque", tau)):
            if values is not None:
                self._add(kind, time, np.abs(values) - largest[kind], values)

    def add_jerk(self, time: Array, ddq: Array) -> None:
        """Check the slopes of accelerations (n, nv), n ≥ 3, of a motion from rest to rest, with jumps at its ends."""
        jerk = np.gradient(ddq, time, axis=0, edge_order=2)
        jumps = np.abs(ddq) > TOLERANCE * np.abs(ddq).max(axis=0)
        for end, step in ((0, time[1] - time[0]), (-1, time[-2] - time[-1])):
            jerk[end] = np.where(jumps[end], ddq[end] / step, jerk[end])
        self._add("jerk", time, np.abs(jerk) - self.bounds.jerk, jerk)

    def add_dynamics(self, robot: Robot, time: Array, q: Array, dq: Array, ddq: Array) -> None:
        """Check the torques of mimic joints with an effort limit in the given states, without friction."""
        if self._followers:
            self.add_borne(time, follower_torques(self.model, np.asarray(robot.joint_wrenches(q, dq, ddq))))

    def add_borne(self, time: Array, borne: Array) -> None:
        """Check the torques (n, k) of these mimic joints at times (n,)."""
        self._borne = Extrema.merge([self._borne, Extrema.from_rows(time, np.abs(borne), borne)])

    def violations(self) -> tuple[Violation, ...]:
        """Violations, sorted by their ratio to the tolerance, largest first."""
        excesses = []
        for kind, worst in self._worst.items():
            names, turns = self.model.velocity_names, Coordinates.from_model(self.model).angular_velocity.tolist()
            if kind == "torque":
                names, turns = self.model.drive_labels, drive_turns(self.model)
            for k, value in enumerate(worst.signed.tolist()):
                beyond = float(worst.value[k])
                limit = self._limit(kind, k, value, beyond)
                allowed = float(margin(abs(limit)))
                if kind == "position":
                    allowed = float(self.bounds.tolerance[k])
                if not beyond > allowed:
                    continue
                share = np.inf
                if allowed > 0:
                    share = beyond / allowed
                unit = unit_of(_PARTS[kind], bool(turns[k]))
                excesses.append((share, Violation(names[k], kind, value, limit, float(worst.time[k]), unit)))
        for i, body in enumerate(self._followers):
            value, beyond = float(self._borne.signed[i]), float(self._borne.value[i] - body.effort)
            allowed = float(margin(body.effort))
            if beyond > allowed:
                limit, time = float(np.copysign(body.effort, value)), float(self._borne.time[i])
                unit = unit_of("tau", bool(body.joint.turning[0]))
                excesses.append((beyond / allowed, Violation(body.joint.name, "torque", value, limit, time, unit)))
        excesses.sort(key=lambda excess: -excess[0])
        return tuple(violation for _, violation in excesses)

    def _limit(self, kind: str, k: int, value: float, beyond: float) -> float:
        """Limit that the value exceeds."""
        b = self.bounds
        if kind == "position":
            if value > b.upper[k]:
                return float(b.upper[k])
            return float(b.lower[k])
        limits = {"velocity": [b.velocity], "torque": [b.effort], "jerk": [b.jerk]}
        limits["acceleration"] = [b.acceleration, b.deceleration]
        candidates = [float(limit[k]) for limit in limits[kind]]
        size = min(candidates, key=lambda limit: abs(abs(value) - beyond - limit))
        return float(np.copysign(size, value))


_MIN_SIGMAS, _MIN_ROWS, _MIN_TIME = 3.0, 3, 0.01
"""Noise [standard deviations], rows in a row, and time [s] above which a measured torque stays above its limit. Shorter peaks
are those of impacts, and of gears with a peak rating."""


class TimeAbove(NamedTuple):
    """Longest run of consecutive rows in which measured torques are above their limits, (nv,) each."""

    rows: Array
    """Number of rows; 0 if the torque is never above."""
    length: Array
    """Time from the first of them to the last [s]."""
    at: Array
    """Time of the first [s]; nan if the torque is never above."""

    @classmethod
    def from_rows(cls, time: Array, above: Array) -> TimeAbove:
        """Longest runs of True in each column of ``above`` (n, nv), rows at times (n,); the first of equally long ones."""
        runs = [_longest_run(time, np.flatnonzero(column)) for column in above.T]
        rows, length, begin = np.array(runs).reshape(-1, 3).T
        return cls(rows.astype(int), length, begin)

    def is_lasting(self, step: float) -> Array:
        """Mask (nv,) of torques that stay above for at least three rows and 10 ms; each row lasts one ``step`` [s]."""
        return np.asarray((self.rows >= _MIN_ROWS) & (self.length + step >= _MIN_TIME * (1 - 1e-6)))


def _longest_run(time: Array, rows: Array) -> tuple[int, float, float]:
    """Number of rows, duration and beginning of the longest run of consecutive numbers in ``rows``."""
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    longest = max(runs, key=len)
    if not len(longest):
        return 0, 0.0, np.nan
    begin, end = float(time[longest[0]]), float(time[longest[-1]])
    return len(longest), end - begin, begin


def above_limits(tau: Array, limits: Array, sigma: Array) -> Array:
    """Mask (n, nv) of measured torques above their limits (nv,) by more than their noise (nv,)."""
    return np.asarray(np.abs(tau) > limits + _MIN_SIGMAS * sigma)


complete(globals())
