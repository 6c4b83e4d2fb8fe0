"""Contradictions within a motion: angles in the wrong unit, omitted turns, rates unlike positions, jumps, unit of time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.numbers import number, printed, seconds
from ..core.text import listed
from ..joints.units import unit_of
from ..typing import Array
from .rate_checks import OVERLAP, RateLag, RateScale, SingleRowGlitches, near, scale_words, segments

if TYPE_CHECKING:
    from ..model.limits import Limits
    from ..motion.columns import MimicJointColumn
    from ..motion.coordinates import Coordinates
    from ..motion.motion import Motion
    from ..motion.motion_log import LogRows

_FAR, _MANY_TURNS = 3.0, 4 * math.pi
"""Times the reach of a joint's limits, or a full turn, and an angle [rad], that no joint with limits turns to."""
_WITHIN = 1.1
"""Times its reach that a joint in the right unit may turn to."""
_FULL_TURN, _SURE_MOVE = math.tau, 0.3
"""Number that no angle in radians of a joint with limits is above, and one that a joint which moves for certain passes."""
_FEWEST = 3
"""Joints that do not all stay within six degrees of zero for the whole of a motion."""
_DEGREE = math.radians(1.0)


def angle_doubts(
    names: Sequence[str], least: Array, most: Array, limits: tuple[Array, Array], factor: Array, known: Array
) -> tuple[list[str], list[str]]:
    """Doubts about the unit of angles: contradictions, where it is wrong for near certain, and hints.

    Of the turning joints (k,) each: what is read of them [rad], their limits, infinite where there are none, the factor from
    the file's numbers to radians, and whether the file gives that unit.
    """
    size, reach = np.maximum(np.abs(least), np.abs(most)), np.maximum(np.abs(limits[0]), np.abs(limits[1]))
    bounded = np.isfinite(reach) & (reach > 0) & (factor == 1.0) & ~known
    far = bounded & (size > _FAR * np.maximum(np.where(bounded, reach, 1.0), _FULL_TURN / _FAR))
    wound = size > _MANY_TURNS
    degrees, written = (factor == _DEGREE) & ~known, size / factor
    moves = (most - least) / factor > _SURE_MOVE
    if degrees.any() and (written[degrees] <= _FULL_TURN).all() and moves[degrees].any():
        small = [
            f"read in degrees, no angle is beyond {printed(written[degrees].max(), 3)} degrees: the file seems to be in "
            "radians. Leave --degrees out, or name the unit of its columns, as 'JOINT [deg]'"
        ]
    else:
        small = []
    if far.any() and 2 * far.sum() >= bounded.sum() and 2 * (far & wound).sum() > far.sum():
        return [_too_far(names, size, limits, reach, far)], []
    if small and degrees.sum() >= _FEWEST:
        return small, []
    if 2 * wound.sum() > len(names) and not known.any() and (factor == 1.0).all():
        return [], [_too_far(names, size, limits, reach, wound)]
    return [], [_too_far(names, size, limits, reach, far)] if far.any() else small


def _too_far(names: Sequence[str], size: Array, limits: tuple[Array, Array], reach: Array, far: Array) -> str:
    """Sentence on angles that are ``far`` (k,) out."""
    k = int(np.flatnonzero(far)[(size / np.where(np.isfinite(reach), reach, 1.0))[far].argmax()])
    lower, upper = (printed(limit[k], 3) for limit in limits)
    limit = f", and its limits are at {lower} and {upper}" if np.isfinite(reach[k]) else ""
    degrees = bool((size[far] * _DEGREE <= _WITHIN * reach[far]).all())
    others = int(far.sum()) - 1
    more = f", and {others} more joint{'s are' if others > 1 else ' is'} as far out" if others else ""
    question = "Did you mean --degrees? Or are" if degrees else "Are"
    counts = "" if degrees else ", or counts of an encoder"
    return (
        f"{names[k]} goes to {printed(size[k], 4)} rad{limit}{more}: the angles seem to be in another unit. "
        f"{question} they those of the motors, before their gears{counts}? Positions are those of the joints, in radians, "
        "or in the unit that a column names, as 'JOINT [deg]'"
    )


# ── Angles logged within one turn, unwrapped and held against the limits


class AngleWrapping:
    """A tally over the angles (n, k) of joints, which come in any portions; turns are added to joints that are ``counted``."""

    def __init__(self, counted: NDArray[np.bool_], size: tuple[float, float]) -> None:
        """``size`` are the least and the largest step [rad] that is taken for a full turn."""
        self._counted, self._size = counted, size
        self._turned = np.zeros(len(counted))
        self._lowest, self._highest = np.full(len(counted), math.inf), np.full(len(counted), -math.inf)

    def add(self, q: Array, moved: Array) -> None:
        """Angles (n, k) that begin with the last of those before, and the steps (n - 1, k) between them."""
        size = np.abs(moved)
        turns = np.where((size > self._size[0]) & (size < self._size[1]) & self._counted, -np.sign(moved), 0.0)
        turned = self._turned + np.concatenate([np.zeros((1, len(self._turned))), np.cumsum(turns, axis=0)])
        self._turned = turned[-1]
        there = q + math.tau * turned
        self._lowest = np.minimum(self._lowest, there.min(axis=0))
        self._highest = np.maximum(self._highest, there.max(axis=0))

    def sentences(
        self, wrapped: NDArray[np.bool_], places: NDArray[np.int_], names: Sequence[str], limits: Limits
    ) -> list[str]:
        """A sentence for each joint that was ``wrapped`` (k,) and is within its limits after no whole number of turns.

        ``places`` (k,) are those of the joints among ``names`` and limits.
        """
        said = []
        for k in np.flatnonzero(wrapped).tolist():
            j, low, high = int(places[k]), float(self._lowest[k]), float(self._highest[k])
            lower, upper, slack = (float(x[j]) for x in (limits.lower, limits.upper, limits.tolerance))
            if not (math.isfinite(lower) and math.isfinite(upper)):
                continue
            first = math.ceil((lower - slack - low) / math.tau)
            if high + math.tau * first > upper + slack:
                said.append(
                    f"{names[j]} steps by about a full turn, as angles do that are logged within one turn; it then turns by "
                    f"{printed(high - low, 4)} rad in all, which its limits, {printed(lower, 4)} to {printed(upper, 4)}, do "
                    "not allow: log the angle without wrapping"
                )
        return said


# ── Rates against positions, jumps, and steps of time

_ALLOWED = {"velocity": (0.85, 1.15), "acceleration": (0.75, 1.3)}
"""Times the slope of what it belongs to that a measured rate may be: filters and delays cost less (measured velocities of
real logs are 0.94 to 1.02 times the slope), a wrong unit, ratio or clock more."""
_WRAP = (1.5 * math.pi, 2.5 * math.pi)
"""A step of an angle between these [rad] is taken for a turn that the log left out, where the log keeps within a turn."""
_SPILL = 0.01 * math.pi
_TOO_FAST = 3.0
"""Times the greatest speed elsewhere, or the velocity limit, from which a step of more than half a turn is a jump."""
_LONG_STEP, _SHORT_MOVE, _SOME_MOVE, _FEWEST_ROWS = 1.0, 0.1, 0.05, 20
"""A step of time [s] so long, with moves [rad, m] so short in every one, is in ms: else the motion would be sampled far
more finely than it is slow."""

_BEYOND, _NO_ROBOT = 1.5, 30.0
"""Times its limit, and rad/s or m/s without one, that no joint moves at: times are not in a unit that would make it so fast."""
_SLOW_STEP, _SLOW_SHARE = 0.1, 1 / 300
"""A step of time [s] so long in a motion that never goes faster than that share of its limits is in ms: robots are built for
their limits, and loggers for steps of 0.1 ms and more."""


class Contradictions:
    """A tally over the rows of a motion, which come in portions."""

    def __init__(
        self,
        coordinates: Coordinates,
        *,
        time_stated: bool = True,
        angle: Array | None = None,
        angle_stated: Array | None = None,
    ) -> None:
        """Factors ``angle`` (nq,) from the file's angles to radians; ``angle_stated`` (nq,): the file gives that unit."""
        count = len(coordinates.names)
        self._factor = np.ones(count) if angle is None else angle
        self._stated = np.zeros(count, bool) if angle_stated is None else angle_stated
        self._names = coordinates.velocity_names
        self._angular = coordinates.angular_velocity
        self._single = np.flatnonzero(coordinates.position_of >= 0)
        self.places = coordinates.position_of[self._single]
        """(k,) the entries of q that are checked: those of joints with one."""
        self._turns = coordinates.angular[self.places]
        self._bounded = self._turns & ~coordinates.endless[self.places]
        self._time_stated = time_stated
        count = len(self._single)
        self._velocity, self._acceleration = RateScale(count), RateScale(len(self._names))
        self._derived = RateScale(count)
        self._delay = RateLag(count)
        self.glitches = SingleRowGlitches(count, self._turns)
        """Rows at which a joint leaves its path alone."""
        self._least, self._greatest = np.full(count, math.inf), np.full(count, -math.inf)
        self._wraps = np.zeros(count, int)
        self._turned = AngleWrapping(self._bounded, _WRAP)
        self._jumps: dict[int, tuple[float, float, float]] = {}
        """Fastest step beyond half a turn of each joint: speed, time before, size."""
        self._wrapped: dict[int, tuple[float, float, float]] = {}
        """First step of each joint that may be an omitted turn: speed, time before, size."""
        self._speed, self._move = np.zeros(count), np.zeros(count)
        self._usual: list[float] = []
        """Median step of time of each portion [s]."""
        self._steps = 0

    def add(self, motion: LogRows | Motion, before: int = 0) -> None:
        """Take in consecutive rows, the first of which were the last ``before``: as many as ``OVERLAP``, or as there were."""
        t, q = motion.time, motion.q[:, self.places]
        self.add_steps(t[max(0, before - 1) :], q[max(0, before - 1) :])
        self.glitches.add(t[max(0, before - OVERLAP) :], q[max(0, before - OVERLAP) :])
        self.add_rates(motion, before, delays=True)

    def add_rates(self, motion: LogRows | Motion, before: int = 0, *, delays: bool = False) -> None:
        """Take in velocities and accelerations beside the slopes of what they belong to, after the first ``before`` rows."""
        t, curves = motion.time[before:], motion.q[before:, self.places]
        dq, ddq = (None if rate is None else rate[before:] for rate in (motion.dq, motion.ddq))
        curves[:, self._turns] = np.unwrap(curves[:, self._turns], axis=0)
        if delays and dq is not None:
            self._delay.add(t, curves, dq[:, self._single])
        for s in segments(t) if dq is not None or ddq is not None else ():
            if dq is not None:
                self._velocity.add(t[s], curves[s], dq[s][:, self._single])
            if ddq is not None and dq is not None:
                self._acceleration.add(t[s], dq[s], ddq[s])
            elif ddq is not None:
                self._derived.add(t[s], np.gradient(curves[s], t[s], axis=0), ddq[s][:, self._single])

    def add_steps(self, t: Array, q: Array) -> None:
        """Take in times (n,) and coordinates ``places`` (n, k), and the steps between them."""
        self._least, self._greatest = np.minimum(self._least, q.min(axis=0)), np.maximum(self._greatest, q.max(axis=0))
        h, moved = np.diff(t), np.diff(q, axis=0)
        self._turned.add(q, moved)
        if not len(h):
            return
        self._steps += len(h)
        self._usual.append(float(np.median(h)))
        size = np.abs(moved)
        far = (size > math.pi) & self._bounded
        speed = np.where(far | (size > math.pi) & self._turns, 0.0, size / h[:, None])
        self._speed = np.maximum(self._speed, speed.max(axis=0))
        self._move = np.maximum(self._move, np.where((size > math.pi) & self._turns, 0.0, size).max(axis=0))
        for row, k in np.argwhere(far).tolist():
            found = float(size[row, k] / h[row]), float(t[row]), float(moved[row, k])
            if _WRAP[0] < size[row, k] < _WRAP[1]:
                self._wraps[k] += 1
                self._wrapped.setdefault(k, found)
            elif k not in self._jumps or found[0] > self._jumps[k][0]:
                self._jumps[k] = found

    def _within_a_turn(self) -> Array:
        about_zero = (self._least >= -math.pi - _SPILL) & (self._greatest <= math.pi + _SPILL)
        return np.asarray(about_zero | ((self._least >= -_SPILL) & (self._greatest <= math.tau + _SPILL)))

    def notes(self) -> list[str]:
        """Notes on corrections that were made."""
        found = np.flatnonzero((self._wraps > 0) & self._within_a_turn())
        return [
            f"{self._names[self._single[k]]} steps by a full turn {self._wraps[k]} time{'s' if self._wraps[k] > 1 else ''}, "
            f"first at t = {seconds(self._wrapped[k][1], 4)} s: the log keeps within a turn, so it is taken to turn on."
            for k in found.tolist()
        ]

    def sentences(self, limits: Limits | None = None, *, glitches: bool = True) -> tuple[str, ...]:
        """Contradictions, a sentence each; velocity limits help to distinguish a jump from a fast motion."""
        time, (angles, _) = self._of_time(limits), self._angle_doubts(limits)
        jumps: list[str] = []
        if not angles:
            jumps = self._of_jumps(limits)
            if limits is not None:
                wrapped = (self._wraps > 0) & self._within_a_turn()
                jumps += self._turned.sentences(wrapped, self._single, self._names, limits)
            if glitches:
                names = [self._names[k] for k in self._single.tolist()]
                jumps += [f"{said}: remove the row" for said in self.glitches.sentences(names, self._turns)]
        delays = np.zeros(len(self._single)) if time else self._delay.result()
        rates = self.of_rates(time_doubted=bool(time), late=delays != 0.0)
        return (*time, *angles, *jumps, *rates, *self._of_delays(delays))

    def hints(self, limits: Limits | None = None) -> tuple[str, ...]:
        """A sentence for each thing that is odd, and may yet be meant."""
        _, found = self._angle_doubts(limits)
        step = float(np.median(self._usual)) if self._usual else 0.0
        if step >= _LONG_STEP and not self._time_stated and not self._of_time(limits):
            found.append(f"the usual time step is {printed(step, 4)} s. Is time in ms? It is taken to be in seconds")
        return tuple(found)

    def _angle_doubts(self, limits: Limits | None) -> tuple[list[str], list[str]]:
        """Contradictions and hints of :func:`angle_doubts`."""
        turns = self._turns
        k, places, bounded = self._single[turns], self.places[turns], self._bounded[turns]
        lower = np.where(bounded, -np.inf if limits is None else limits.lower[k], -np.inf)
        upper = np.where(bounded, np.inf if limits is None else limits.upper[k], np.inf)
        names = [self._names[j] for j in k.tolist()]
        factor, known = self._factor[places], self._stated[places]
        return angle_doubts(names, self._least[turns], self._greatest[turns], (lower, upper), factor, known)

    def _of_time(self, limits: Limits | None) -> list[str]:
        if self._time_stated or (found := self.slow_steps(limits)) is None:
            return []
        why, unit = found
        return [
            f"{why}: time seems to be in {unit}. Say its unit in the column's name, time [{unit}] or time [s], or by --columns "
            f"'time=COLUMN [{unit}]'"
        ]

    def slow_steps(self, limits: Limits | None) -> tuple[str, str] | None:
        """Why the steps of time are too long for how little the joints move in them, and the unit it may be in."""
        step = float(np.median(self._usual)) if self._usual else 0.0
        moving = self._greatest - self._least > _SOME_MOVE
        if self._steps + 1 < _FEWEST_ROWS or not moving.any():
            return None
        unit, factor = ("ms", 1e3) if step < 500 else ("us", 1e6) if step < 5e5 else ("ns", 1e9)
        velocity = np.full(len(self._single), np.inf) if limits is None else limits.velocity[self._single]
        if (factor * self._speed > np.where(np.isfinite(velocity), _BEYOND * velocity, _NO_ROBOT)).any():
            return None  # in that unit the motion would be too fast for the robot
        usual = f"the usual step of time is {printed(step, 4)} s"
        if step >= _LONG_STEP and self._move.max(initial=0.0) < _SHORT_MOVE:
            return f"{usual}, and within one no joint moves by more than {printed(self._move.max(), 2)} rad or m", unit
        if limits is not None and step >= _SLOW_STEP:
            shares = self._speed[moving] / limits.velocity[self._single[moving]]
            if np.isfinite(limits.velocity[self._single[moving]]).all() and shares.max() < _SLOW_SHARE:
                return (
                    f"{usual}, and no joint moves faster than {printed(100 * shares.max(), 2)} % of its limit of velocity",
                    unit,
                )
        return None

    def _of_delays(self, delays: Array) -> list[str]:
        said = []
        for way, found in (("late", delays > 0.0), ("early", delays < 0.0)):
            if found.any():
                names = listed([self._names[self._single[k]] for k in np.flatnonzero(found).tolist()])
                late = np.abs(delays[found])
                size = seconds(late.min()) + (f" to {seconds(late.max())}" if np.ptp(late) > 5e-4 else "")
                said.append(
                    f"{names}: the velocity column is {size} s {way} against the positions: shift it, or leave it out, then it "
                    "is derived"
                )
        return said

    def _of_jumps(self, limits: Limits | None) -> list[str]:
        said, whole = [], self._within_a_turn()
        for k, joint in enumerate(self._single.tolist()):
            jump = self._jumps.get(k) or (None if whole[k] else self._wrapped.get(k))
            if jump is None:
                continue
            known = float(limits.velocity[joint]) if limits is not None else math.inf
            if jump[0] > _TOO_FAST * (known if math.isfinite(known) else float(self._speed[k])):
                said.append(
                    f"{self._names[joint]} jumps by {printed(jump[2], 4)} rad after t = {seconds(jump[1], 4)} s, at "
                    f"{printed(jump[0], 3)} rad/s, and is not a joint that turns for ever: remove the rows, or add the "
                    "turns that the log left out"
                )
        return said

    def of_rates(self, *, time_doubted: bool = False, late: Array | None = None) -> list[str]:
        """A sentence for each rate that is not the slope of what it belongs to.

        ``late`` (k,) bool: the velocity is that of another time, so that its size is not compared.
        """
        every, found = np.arange(len(self._names)), []
        cases = (
            (self._velocity, self._single, "velocity", "positions", "/s"),
            (self._acceleration, every, "acceleration", "velocities", "/s^2"),
            (self._derived, self._single, "acceleration", "positions' velocities", "/s^2"),
        )
        for tally, joints, rate, base, per in cases:
            angular = self._angular[joints]
            gains = tally.result(angular)
            if tally is self._velocity and late is not None:
                gains = np.where(late, 1.0, gains)
            said: dict[str, list[str]] = {}
            least, most = _ALLOWED[rate]
            for k in np.flatnonzero(~((gains > least) & (gains < most))).tolist():
                if time_doubted and math.isfinite(gains[k]) and any(near(gains[k], f) for f in _UNITS):
                    continue
                what = scale_words(float(gains[k]), bool(angular[k]), base, per)
                said.setdefault(what, []).append(self._names[joints[k]])
            found += [f"{listed(names)}: the {rate} column {what}" for what, names in said.items()]
        return found


# ── Times in milliseconds or less, given without a unit

_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns"}


def time_doubt(coordinates: Coordinates, time: Array, q: Array, dq: Array | None, limits: Limits) -> str:
    """Doubt about times (n,) in seconds, of positions (n, nq) and velocities (n, nv) or None; "" without a doubt.

    With velocities: the way that they make in these times is 1000 (or 1000², 1000³) times the way of the positions. Without:
    joints hardly move within steps that are long.
    """
    if dq is None:
        found = Contradictions(coordinates)
        found.add_steps(time, q[:, found.places])
        slow = found.slow_steps(limits)
        return "" if slow is None else f"{slow[0]}: time seems to be in {slow[1]}"
    single = np.flatnonzero(coordinates.position_of >= 0)
    steps = np.abs(np.diff(q[:, coordinates.position_of[single]], axis=0))
    steps = np.where(coordinates.angular_velocity[single] & (steps > np.pi), 0.0, steps)  # a turn that was left out
    speeds = np.abs(dq[:, single])
    moved, summed = steps.sum(axis=0), (0.5 * (speeds[1:] + speeds[:-1]) * np.diff(time)[:, None]).sum(axis=0)
    moving = moved > _SOME_MOVE
    gains = (summed[moving] / moved[moving]).tolist()
    for factor, unit in _UNITS.items():
        if gains and all(near(gain, factor) for gain in gains):
            times = f"{printed(factor)} times the way of the positions"
            return f"velocities make {times} in these times: time seems to be in {unit}"
    return ""


# ── Columns of mimic joints, checked against those of their leaders, and columns that are not used

_SHARE = 0.1
"""Share of a joint's travel; less is play, and the error of a coupling."""
_LEAST = {True: 0.02, False: 0.002}
"""Least deviation that is reported, of turning [rad] and sliding [m] joints."""


def mimic_doubts(columns: Sequence[MimicJointColumn], portions: Iterable[tuple[LogRows, Array]]) -> list[str]:
    """A sentence for each mimic joint whose column goes elsewhere than its leader takes it.

    ``portions`` are rows of the log, and the table that they are from.
    """
    least, most = np.full(len(columns), math.inf), np.full(len(columns), -math.inf)
    off = [(0.0, 0.0)] * len(columns)  # the largest distance of each, and when
    for motion, table in portions if columns else ():
        for k, (follower, column, factor) in enumerate(columns):
            logged, led = factor * table[:, column], follower.ratio * motion.q[:, follower.leader] + follower.offset
            least[k] = min(least[k], logged.min(), led.min())
            most[k] = max(most[k], logged.max(), led.max())
            distance = np.abs(logged - led)
            row = int(distance.argmax())
            off[k] = max(off[k], (float(distance[row]), float(motion.time[row])))
    return [
        f"{follower.name} is {number(distance)} {unit_of('q', follower.angular)} from where its leader takes it, at t = "
        f"{seconds(when)} s: correct its <mimic>, or load the robot with its mimic joints independent"
        for k, ((follower, _, _), (distance, when)) in enumerate(zip(columns, off, strict=True))
        if distance > max(_LEAST[follower.angular], _SHARE * float(most[k] - least[k]))
    ]


def unused_doubt(unused: Sequence[str], held: Sequence[str], checked: int) -> str:
    """Doubt about columns that vary and are not used, while joints are held still for want of one."""
    return (
        f"{checked} of {checked + len(held)} joints checked: {listed(held, 6)} held still for want of a column, while "
        f"columns that vary are not used, {listed(unused, 6)}. Say which they are with --columns"
    )
