"""Doubts about a motion without a model: units of angles and time, omitted turns, jumps, inconsistent rates, sampling."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.doubts import Doubt, Level, doubt, doubt_table
from ..core.estimation.logged_rates import rate_delays, rate_scales
from ..core.estimation.sampling import Gap, LatePositions, dropouts, gaps, late_by_turns, new_rows, spikes
from ..core.estimation.single_row_glitches import OVERLAP, SingleRowGlitches
from ..core.numbers import number, percent, printed, seconds
from ..core.text import Argument, Placeholder, listed, spell
from ..core.typing import Array
from ..mechanics.model.limits import known_velocities

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from .coordinates import Coordinates
    from .motion import Motion
    from .motion_log import LogRows


_MAX_REACH_RATIO, _MANY_TURNS = 3.0, 4 * math.pi
"""Multiple of the reach of a joint's limits (or of a full turn) and angle [rad] that indicate another unit."""
_REACH_TOLERANCE = 1.1
"""Multiple of its reach up to which a joint may turn in the right unit."""
_FULL_TURN, _SURE_MOVE = math.tau, 0.3
"""Angle in radians that no joint with limits exceeds, and angle that a moving joint certainly exceeds."""
_MIN_JOINTS_IN_DEGREES = 3
"""Minimum number of joints that indicates a wrong unit: three joints rarely all stay within six degrees of zero."""
_DEGREE = math.radians(1.0)


def angle_doubts(
    names: Sequence[str],
    extent: Array,
    limits: tuple[Array, Array],
    factor: Array,
    known: Array,
    origin: str = "either",
) -> list[Doubt]:
    """Doubts about the unit of angles, or notes if the unit may be intended.

    For the revolute joints (k,): least and largest angles as read [rad], limits (infinite if there are none), the
    factor from the file's numbers to radians, and True if the file states that unit. ``origin``: plan, log or either.
    """
    size, reach = np.abs(extent).max(axis=0), np.maximum(np.abs(limits[0]), np.abs(limits[1]))
    bounded = np.isfinite(reach) & (reach > 0) & (factor == 1.0) & ~known
    far = bounded & (size > _MAX_REACH_RATIO * np.maximum(np.where(bounded, reach, 1.0), _FULL_TURN / _MAX_REACH_RATIO))
    wound = size > _MANY_TURNS
    degrees, written = (factor == _DEGREE) & ~known, size / factor
    moves = np.ptp(extent, axis=0) / factor > _SURE_MOVE
    small = degrees.any() and (written[degrees] <= _FULL_TURN).all() and moves[degrees].any()
    if far.any() and 2 * far.sum() >= bounded.sum() and 2 * (far & wound).sum() > far.sum():
        return [_too_far(names, size, limits, reach, far)]
    beyond_stops = _stop_doubts(names, extent, limits, (factor == 1.0) & ~known, origin)
    if beyond_stops:
        return beyond_stops
    if not (small and degrees.sum() >= _MIN_JOINTS_IN_DEGREES):
        if 2 * wound.sum() > len(names) and not known.any() and (factor == 1.0).all():
            return [_too_far(names, size, limits, reach, wound, level="note")]
        if far.any():
            return [_too_far(names, size, limits, reach, far, level="note")]
    if not small:
        return []
    level: Level | None = None
    if degrees.sum() < _MIN_JOINTS_IN_DEGREES:
        level = "note"
    return [doubt("degrees-option", level=level, angle=printed(written[degrees].max(), 3))]


_BEYOND_STOP = math.radians(20.0)
"""Angle beyond a stop that play, elasticity and the tolerance of a stop do not explain."""
_MILLI, _STROKES = 1e-3, 10.0
"""Factor from millimetres to metres, and strokes beyond a stop from which a position is in millimetres: at least 1 % of the
stroke. Nearer ones are those of another zero."""


def _stop_doubts(
    names: Sequence[str], extent: Array, limits: tuple[Array, Array], radians: Array, origin: str
) -> list[Doubt]:
    """Doubt about angles far beyond the stops of joints that have two, or about joints that are wound by a turn."""
    lower, upper = limits
    stopped = radians & np.isfinite(lower) & np.isfinite(upper) & (upper > lower)
    past = np.where(stopped, np.maximum(lower - extent[0], extent[1] - upper), 0.0)
    beyond = past > _BEYOND_STOP
    if origin == "plan" or not beyond.any():
        return []
    middle = 0.5 * (np.where(stopped, lower, 0.0) + np.where(stopped, upper, 0.0))
    turns = np.sign(middle - extent.mean(axis=0)) * math.tau
    within = (extent[0] + turns >= lower) & (extent[1] + turns <= upper)
    wound, read_as_degrees = beyond & within, extent * _DEGREE
    least, largest = read_as_degrees
    inside = ~stopped | ((least >= lower - _BEYOND_STOP) & (largest <= upper + _BEYOND_STOP))
    unexplained = beyond & ~wound
    if not unexplained.any():
        joints = names_of(names, beyond)
        level: Level = "unsure"
        if origin == "log":
            level = "note"
        return [doubt("wound", joints, joints_=listed(joints, 6), level=level)]
    joints = names_of(names, unexplained)
    words = _stop_words(names, extent, limits, past)
    words |= {"past": f"{printed(math.degrees(past.max()), 3)} degrees", "unit": "rad"}
    if beyond.sum() > 1 and inside.all():
        return [doubt("degrees-inside", joints, count=f"{beyond.sum()}", **words)]
    return [doubt("zero-or-direction", joints, **words)]


def length_doubts(names: Sequence[str], extent: Array, limits: tuple[Array, Array], origin: str) -> list[Doubt]:
    """Doubt about sliding joints (k,) that leave their stops by more than the whole range."""
    lower, upper = limits
    stopped = np.isfinite(lower) & np.isfinite(upper) & (upper > lower)
    range_ = np.where(stopped, upper - lower, np.inf)
    past = np.where(stopped, np.maximum(lower - extent[0], extent[1] - upper), 0.0)
    beyond = past > range_
    if origin == "plan" or not beyond.any():
        return []
    least, largest = extent * _MILLI
    inside = ~stopped | ((least >= lower - 0.1 * range_) & (largest <= upper + 0.1 * range_))
    words = _stop_words(names, extent, limits, past)
    words |= {"past": f"{printed(past.max(), 3)} m", "unit": "m"}
    many_strokes = (past[beyond] > _STROKES * range_[beyond]).any()
    kind = "zero-or-direction"
    if many_strokes and inside.all():
        kind = "millimetres-inside"
    return [doubt(kind, names_of(names, beyond), **words)]


def names_of(names: Sequence[str], which: Array) -> list[str]:
    """Names of the joints in a mask (k,)."""
    return [names[k] for k in np.flatnonzero(which).tolist()]


def _stop_words(names: Sequence[str], extent: Array, limits: tuple[Array, Array], past: Array) -> dict[str, Any]:
    """Name, farthest position and stops of the joint that is farthest beyond."""
    k = int(past.argmax())
    farthest = float(extent[:, k][np.abs(extent[:, k]).argmax()])
    words: dict[str, Any] = {"joint": names[k], "position": printed(farthest, 4)}
    return words | {"lower": printed(limits[0][k], 3), "upper": printed(limits[1][k], 3)}


def _too_far(
    names: Sequence[str], size: Array, limits: tuple[Array, Array], reach: Array, far: Array, **level: Any
) -> Doubt:
    """Doubt about joints whose angles are ``far`` (k,) too large."""
    ratios = size / np.where(np.isfinite(reach), reach, 1.0)
    k = int(np.flatnonzero(far)[ratios[far].argmax()])
    limit, more, question, counts = "", "", "Are", ", or counts of an encoder"
    if np.isfinite(reach[k]):
        limit = f", and its limits are at {printed(limits[0][k], 3)} and {printed(limits[1][k], 3)}"
    others = int(far.sum()) - 1
    if others == 1:
        more = ", and 1 more joint is as far out"
    elif others:
        more = f", and {others} more joints are as far out"
    if (size[far] * _DEGREE <= _REACH_TOLERANCE * reach[far]).all():
        question, counts = f"Did you mean {spell(Argument('degrees', True))}? Or are", ""
    return doubt(
        "angle-unit", [names[k]], joint=names[k], angle=printed(size[k], 4), limit=limit, more=more,
        question=question, counts=counts, **level,
    )  # fmt: skip


_MAX_LISTED_TIMES = 3


def row_doubts(glitches: SingleRowGlitches, names: Sequence[str], *, left_out: bool = False) -> list[Doubt]:
    """Doubts about glitches of each joint and wrong time stamps; notes if the rows are ``left_out``."""
    doubts = []
    for k, joint_glitches in glitches.result():
        in_position = [glitch for glitch in joint_glitches if not glitch.late]
        if in_position:
            size = in_position[0].size
            text = f"{printed(size, 3)} m"
            if glitches.turns[k]:
                text = f"{printed(math.degrees(size), 3)} degrees"
            words = {"joint": names[k], "size": text, "when": _times_text(glitch.time for glitch in in_position)}
            doubts.append(_row_doubt("single-row", [names[k]], words, left_out=left_out))
    return [*doubts, *stamp_doubts(glitches.stamps(), left_out=left_out)]


def stamp_doubts(stamps: Mapping[float, float], *, left_out: bool = False) -> list[Doubt]:
    """Doubt about wrong time stamps, given as a mapping from time to delay [s]; empty if there are none."""
    if not stamps:
        return []
    delay = max(stamps.values(), key=abs)
    rows, direction = "1 row", "early"
    if len(stamps) > 1:
        rows = f"{len(stamps)} rows"
    if delay > 0:
        direction = "late"
    words = {"rows": rows, "when": _times_text(stamps), "late": seconds(abs(delay)), "way": direction}
    return [_row_doubt("stamp", [], words, left_out=left_out)]


def _times_text(times: Iterable[float]) -> str:
    """First times [s] of a list."""
    return listed((f"{seconds(time, 4)} s" for time in times), _MAX_LISTED_TIMES)


def _row_doubt(kind: str, joints: Sequence[str], words: Mapping[str, Any], *, left_out: bool) -> Doubt:
    """Doubt of that kind, or a note that its rows are left out."""
    if not left_out:
        return doubt(kind, joints, **words)
    return doubt("rows-left-out", joints, what=doubt_table()[kind].sentence.format(**words).rstrip(":"))


_DEGREES_PER_RADIAN, _RPM, _FACTOR_TOLERANCE = math.degrees(1.0), 30 / math.pi, 0.1
"""Factors between units, and relative tolerance of a match."""
_CLOCKS = {1e3: "ms", 1e6: "us", 1e9: "ns"}
_NEGLIGIBLE_GAIN = 0.02


def scale_words(gain: float, angular: bool, base: str, per: str) -> str:
    """Text on a rate column by its scale against the slope of ``base``; ``per`` is the suffix of the unit, such as /s."""
    slope = f"the slope of the {base}"
    causes = {}
    for factor, unit in _CLOCKS.items():
        causes[factor] = printed(factor), f"time seems to be in {unit}"
    causes[1e-3] = "1/1000", "time, or the column, seems to be in another unit"
    if angular:
        in_degrees = f"it seems to be in deg{per}; name the unit, as in 'JOINT [deg{per}]'"
        base_in_degrees = "the positions seem to be in degrees; name the unit, as in 'JOINT [deg]'"
        causes[_DEGREES_PER_RADIAN] = "57.3", in_degrees
        causes[1 / _DEGREES_PER_RADIAN] = "1/57.3", base_in_degrees
        if per == "/s":
            causes[_RPM] = "9.55", "it seems to be in rpm; name the unit, as in 'JOINT [rpm]'"
    else:
        causes[1e3] = "1000", f"time seems to be in ms, or the column in mm{per}"
    for factor, (text, reason) in causes.items():
        if _is_about(gain, factor):
            return f"is {text} times {slope}: {reason}"
    if math.isinf(gain):
        return f"moves, and the {base} stand"
    if abs(gain) < _NEGLIGIBLE_GAIN:
        return f"is next to nothing, and the {base} move: leave the column out, then it is derived"
    if _is_about(gain, -1.0):
        return f"has the opposite sign of {slope}"
    return f"is not {slope}, but some {printed(gain, 2)} times it"


def _is_about(gain: float, factor: float) -> bool:
    """True if a gain is a factor between units."""
    return abs(gain / factor - 1.0) < _FACTOR_TOLERANCE


def _is_of_clock(gain: float) -> bool:
    """True if time in another unit explains a gain."""
    return math.isfinite(gain) and any(_is_about(gain, factor) for factor in _CLOCKS)


_ALLOWED_GAINS = {"velocity": (0.85, 1.15), "acceleration": (0.75, 1.3)}
"""Allowed ratios of a measured rate to the slope of the integrated quantity. Filters and delays reduce it little (measured
velocities of real logs: 0.94 to 1.02); a wrong unit, ratio or clock changes it more."""
_STEP_OF_TURN = (1.5 * math.pi, 2.5 * math.pi)
"""Step of an angle [rad] that counts as a turn omitted by the log, if the log stays within one turn."""
_TURN_TOLERANCE = 0.01 * math.pi
TOO_FAST = 3.0
"""Multiple of a velocity limit that no robot reaches, as drives are stopped long before; without a limit, of the largest speed
elsewhere for a step over half a turn."""
_LONG_STEP, _SHORT_MOVE, _SOME_MOVE, _FEWEST_ROWS = 1.0, 0.1, 0.05, 20
"""Minimum time step [s], and maximum displacement per step [rad, m], of a log in ms: otherwise the sampling would be far too
fine for so slow a motion."""
_MAX_SPEED_OF_LIMIT, _MAX_SPEED = 1.5, 30.0
"""Multiple of the velocity limit, and speed [rad/s, m/s] without a limit, that excludes a unit of time as too fast."""
_SLOWEST_RATE = 10.0
"""Rate [Hz] from which logs are recorded whose time may count rows."""
_SLOW_STEP, _SLOW_SHARE = 0.1, 1 / 300
"""Minimum time step [s], and maximum share of the velocity limits, of a log in ms: robots are built for their limits, and
loggers for steps of 0.1 ms and more."""
_MAX_SHARE_OF_SPIKES = 0.01
"""Share of rows with spikes from which a doubt is raised."""


class Contradictions:
    """Statistics accumulated over the rows of a motion in portions; rates and sampling are evaluated on its :attr:`runs`."""

    def __init__(
        self,
        coordinates: Coordinates,
        *,
        time_stated: bool = True,
        may_count_rows: bool = False,
        angle: Array | None = None,
        angle_stated: Array | None = None,
        runs: Sequence[LogRows | Motion] = (),
    ) -> None:
        """Factors ``angle`` (nq,) from the file's angles to radians; ``angle_stated`` (nq,): the file states the unit.

        ``may_count_rows``: the column of time neither names a unit nor counts from 1970.
        """
        count = len(coordinates.names)
        self._factor, self._stated = np.ones(count), np.zeros(count, bool)
        if angle is not None:
            self._factor = angle
        if angle_stated is not None:
            self._stated = angle_stated
        self._names = np.array(coordinates.velocity_names, object)
        self._angular = coordinates.angular_velocity
        self._single = np.flatnonzero(coordinates.position_of >= 0)
        self._own = self._names[self._single].tolist()
        """Names of the checked entries."""
        self.places = coordinates.position_of[self._single]
        """(k,) indices in q of the checked entries: joints with one coordinate."""
        self._turns = coordinates.angular[self.places]
        self._bounded = self._turns & ~coordinates.endless[self.places]
        self._time_stated = time_stated
        self.runs = runs
        """Runs of rows, the whole motion or excerpts of a long one."""
        count = len(self._single)
        self.glitches = SingleRowGlitches(count, self._turns)
        """Rows in which a single joint leaves its path."""
        self._range = np.array([[math.inf], [-math.inf]]).repeat(count, axis=1)
        self._unwrapped = self._range.copy()
        """Least and largest angles, as logged and with omitted turns added."""
        self._turned, self._wraps = np.zeros(count), np.zeros(count, int)
        self._jumps: dict[int, tuple[float, float, float]] = {}
        """Fastest step beyond half a turn of each joint: speed, time before, size."""
        self._wrapped: dict[int, tuple[float, float, float]] = {}
        """First step of each joint that may be an omitted turn: speed, time before, size."""
        self._speed, self._move = np.zeros(count), np.zeros(count)
        self._usual: list[float] = []
        """Median time step of each portion [s]."""
        self._steps = 0
        self._counts_rows = may_count_rows
        """True if each step of time is exactly 1, from a whole number on."""

    def add(self, t: Array, q: Array, before: int = 0) -> None:
        """Add times (n,) and coordinates (n, nq); the first ``before`` (at most OVERLAP) repeat the end of the last portion."""
        q = q[:, self.places]
        self.glitches.add(t[max(0, before - OVERLAP) :], q[max(0, before - OVERLAP) :])
        t, q = t[max(0, before - 1) :], q[max(0, before - 1) :]
        h, moved = np.diff(t), np.diff(q, axis=0)
        size = np.abs(moved)
        wraps = (size > _STEP_OF_TURN[0]) & (size < _STEP_OF_TURN[1]) & self._bounded
        turned = self._turned + np.cumsum(np.pad(np.where(wraps, -np.sign(moved), 0.0), ((1, 0), (0, 0))), axis=0)
        self._turned = turned[-1]
        for extent, x in ((self._range, q), (self._unwrapped, q + math.tau * turned)):
            extent[:] = np.minimum(extent[0], x.min(axis=0)), np.maximum(extent[1], x.max(axis=0))
        if not len(h):
            return
        self._steps += len(h)
        self._counts_rows &= bool((h == 1.0).all()) and float(t[0]).is_integer()
        self._usual.append(float(np.median(h)))
        over = (size > math.pi) & self._turns
        self._speed = np.maximum(self._speed, np.where(over, 0.0, size / h[:, None]).max(axis=0))
        self._move = np.maximum(self._move, np.where(over, 0.0, size).max(axis=0))
        self._wraps += wraps.sum(axis=0)
        for row, k in np.argwhere(over & self._bounded).tolist():
            speed, start, step = float(size[row, k] / h[row]), float(t[row]), float(moved[row, k])
            if wraps[row, k]:
                self._wrapped.setdefault(k, (speed, start, step))
            elif k not in self._jumps or speed > self._jumps[k][0]:
                self._jumps[k] = speed, start, step

    def doubts(self, limits: Limits | None = None, *, glitches: bool = True, origin: str = "either") -> list[Doubt]:
        """All doubts and notes; velocity limits distinguish a jump from a fast motion. ``origin``: plan, log or either."""
        time_doubts = self.time_doubts(limits)
        unit_doubts = self._angle_doubts(limits, origin) + self._length_doubts(limits, origin)
        doubts = time_doubts + unit_doubts
        if not any(found.refuses for found in unit_doubts):
            doubts += [*self._jump_doubts(limits), *self._turn_doubts(limits)]
            if glitches:
                doubts += row_doubts(self.glitches, self._own)
        delays = np.zeros(len(self._single))
        if not time_doubts:
            delays = self._delays
        doubts += self.rate_doubts(time_doubted=bool(time_doubts), late=delays != 0.0)
        doubts += self._delay_doubts(delays)
        if not time_doubts:
            doubts += self._step_doubts(limits, origin)
        return doubts + self._sampling

    def _length_doubts(self, limits: Limits | None, origin: str) -> list[Doubt]:
        slides = self._single[~self._turns]
        if limits is None or not slides.size:
            return []
        stops = limits.lower[slides], limits.upper[slides]
        return length_doubts(self._names[slides].tolist(), self._range[:, ~self._turns], stops, origin)

    def _angle_doubts(self, limits: Limits | None, origin: str) -> list[Doubt]:
        turns = self._turns
        places, bounded = self.places[turns], self._bounded[turns]
        lower, upper = np.full(len(places), -np.inf), np.full(len(places), np.inf)
        if limits is not None:
            bounded_joints = self._single[turns][bounded]
            lower[bounded], upper[bounded] = limits.lower[bounded_joints], limits.upper[bounded_joints]
        names = self._names[self._single[turns]].tolist()
        stated = self._stated[places]
        return angle_doubts(names, self._range[:, turns], (lower, upper), self._factor[places], stated, origin)

    def time_doubts(self, limits: Limits | None) -> list[Doubt]:
        """Doubt about the unit of time, if time steps are too long for the displacements in them."""
        step = self._usual_step
        moving = self._range[1] - self._range[0] > _SOME_MOVE
        if self._time_stated or self._steps + 1 < _FEWEST_ROWS or not moving.any():
            return []
        unit, factor = "ns", 1e9
        if step < 500:
            unit, factor = "ms", 1e3
        elif step < 5e5:
            unit, factor = "us", 1e6
        if not self._keeps_speed(factor, limits):
            return []  # in that unit the motion would exceed the robot's limits
        velocity, share = self._velocity_limits(limits)[moving], math.inf
        if np.isfinite(velocity).all():
            share = float((self._speed[moving] / velocity).max())
        if step >= _LONG_STEP and self._move.max(initial=0.0) < _SHORT_MOVE:
            why = f"within one no joint moves by more than {printed(self._move.max(), 2)} rad or m"
        elif step >= _SLOW_STEP and share < _SLOW_SHARE:
            why = f"no joint moves faster than {printed(100 * share, 2)} % of its limit of velocity"
        else:
            return []
        why = f"the usual step of time is {printed(step, 4)} s, and {why}"
        rate = ""
        if self._counts_rows:
            rate = f"; if it counts rows, give their rate by {spell(Argument('rate', Placeholder('HZ')))}"
        return [
            doubt("time-unit", why=why, unit=unit, rate=rate, column=Argument("columns", {"time": f"COLUMN [{unit}]"}))
        ]

    def _step_doubts(self, limits: Limits | None, origin: str) -> list[Doubt]:
        """Doubt about a time that may count rows, or note on long steps: seconds of a slow log look alike.

        Time is in seconds if velocities were logged, whose scale is compared with it, or if ten rows per second would need more
        than the robot's speed. A plan may have points at whole seconds.
        """
        if self._time_stated or self._usual_step < _LONG_STEP:
            return []
        confirmed = origin == "plan" or any(rows.dq is not None for rows in self.runs)
        counts_rows = self._counts_rows and self._steps + 1 >= _FEWEST_ROWS and not confirmed
        if counts_rows and self._keeps_speed(_SLOWEST_RATE, limits):
            return [doubt("row-numbers", rows=self._steps + 1)]
        return [doubt("time-step", step=printed(self._usual_step, 4))]

    def _keeps_speed(self, factor: float, limits: Limits | None) -> bool:
        """True if no joint is faster than a robot's can be when its speeds are multiplied by ``factor``."""
        velocity = self._velocity_limits(limits)
        max_speed = np.where(np.isfinite(velocity), _MAX_SPEED_OF_LIMIT * velocity, _MAX_SPEED)
        return bool((factor * self._speed <= max_speed).all())

    def _velocity_limits(self, limits: Limits | None) -> Array:
        """Velocity limits (k,) of the checked entries, infinite if none is known."""
        velocity = np.full(len(self._single), np.inf)
        if limits is not None:
            velocity = limits.velocity[self._single]
        return known_velocities(velocity, self._turns)

    @property
    def _usual_step(self) -> float:
        """Median time step [s]; 0 without rows."""
        if not self._usual:
            return 0.0
        return float(np.median(self._usual))

    def _stays_in_a_turn(self) -> Array:
        least, most = self._range
        about_zero = (least >= -math.pi - _TURN_TOLERANCE) & (most <= math.pi + _TURN_TOLERANCE)
        return np.asarray(about_zero | ((least >= -_TURN_TOLERANCE) & (most <= math.tau + _TURN_TOLERANCE)))

    def _jump_doubts(self, limits: Limits | None) -> Iterator[Doubt]:
        in_a_turn = self._stays_in_a_turn()
        for k, joint in enumerate(self._single.tolist()):
            jump = self._jumps.get(k)
            if jump is None and not in_a_turn[k]:
                jump = self._wrapped.get(k)
            if jump is None:
                continue
            speed, time, size = jump
            usual_speed = float(self._speed[k])
            if limits is not None and math.isfinite(limits.velocity[joint]):
                usual_speed = float(limits.velocity[joint])
            if speed > TOO_FAST * usual_speed:
                words: dict[str, Any] = {
                    "angle": printed(size, 4),
                    "time": seconds(time, 4),
                    "speed": printed(speed, 3),
                }
                yield doubt("jump", [self._own[k]], joint=self._own[k], **words)

    def _turn_doubts(self, limits: Limits | None) -> Iterator[Doubt]:
        """Notes on added turns, and doubts about joints that exceed their limits with any number of turns."""
        for k in np.flatnonzero((self._wraps > 0) & self._stays_in_a_turn()).tolist():
            name, count = self._own[k], "1 time"
            if self._wraps[k] > 1:
                count = f"{self._wraps[k]} times"
            yield doubt("turned-on", [name], joint=name, count=count, time=seconds(self._wrapped[k][1], 4))
            if limits is None:
                continue
            joint = self._single[k]
            lower, upper, slack = float(limits.lower[joint]), float(limits.upper[joint]), float(limits.tolerance[joint])
            if not (math.isfinite(lower) and math.isfinite(upper)):
                continue
            low, high = self._unwrapped[:, k].tolist()
            if high + math.tau * math.ceil((lower - slack - low) / math.tau) > upper + slack:
                words: dict[str, Any] = {
                    "angle": printed(high - low, 4),
                    "lower": printed(lower, 4),
                    "upper": printed(upper, 4),
                }
                yield doubt("wrapped", [name], joint=name, **words)

    @cached_property
    def _curves(self) -> list[Array]:
        """Positions (n, k) of each run, with omitted turns added."""
        all_curves = [rows.q[:, self.places] for rows in self.runs]
        for curves in all_curves:
            curves[:, self._turns] = np.unwrap(curves[:, self._turns], axis=0)
        return all_curves

    def _beside(self, rate: str) -> list[tuple[Array, Array, Array]]:
        """Time, curves and rates of each run with these rates; ``derived``: accelerations with positions but no velocities."""
        runs_with_rates = []
        for rows, curves in zip(self.runs, self._curves, strict=True):
            if rate == "velocity" and rows.dq is not None:
                runs_with_rates.append((rows.time, curves, rows.dq[:, self._single]))
            elif rate == "acceleration" and rows.dq is not None and rows.ddq is not None:
                runs_with_rates.append((rows.time, rows.dq, rows.ddq))
            elif rate == "derived" and rows.dq is None and rows.ddq is not None and len(curves) > 1:
                runs_with_rates.append((rows.time, np.gradient(curves, rows.time, axis=0), rows.ddq[:, self._single]))
        return runs_with_rates

    @cached_property
    def _delays(self) -> Array:
        return rate_delays(self._beside("velocity"), len(self._single))

    def _delay_doubts(self, delays: Array) -> Iterator[Doubt]:
        for direction, shifted in (("late", delays > 0.0), ("early", delays < 0.0)):
            if shifted.any():
                sizes = np.abs(delays[shifted])
                text = seconds(sizes.min())
                if np.ptp(sizes) > 5e-4:
                    text += f" to {seconds(sizes.max())}"
                yield doubt("rate-late", names_of(self._own, shifted), late=text, way=direction)

    @cached_property
    def _scales(self) -> list[tuple[str, str, list[str], Array, Array]]:
        """Name of each kind of rates, name of the integrated quantity, joints, True for revolute joints, and scales."""
        all_joints, scales = np.arange(len(self._names)), []
        for kind, joints, base in (
            ("velocity", self._single, "positions"),
            ("acceleration", all_joints, "velocities"),
            ("derived", self._single, "positions' velocities"),
        ):
            angular, rate = self._angular[joints], "acceleration"
            if kind == "velocity":
                rate = "velocity"
            names = self._names[joints].tolist()
            scales.append((rate, base, names, angular, rate_scales(self._beside(kind), angular)))
        return scales

    def rate_doubts(self, *, time_doubted: bool = False, late: Array | None = None) -> list[Doubt]:
        """Doubts about rates that differ from the slope of the integrated quantity.

        ``late`` (k,) bool: True if the velocity is shifted in time, so that its scale is not compared.
        """
        doubts = []
        for rate, base, names, angular, scales in self._scales:
            gains, per = scales, "/s^2"
            if rate == "velocity":
                per = "/s"
                if late is not None:
                    gains = np.where(late, 1.0, scales)
            least, largest = _ALLOWED_GAINS[rate]
            joints_of: dict[str, list[str]] = {}  # by the text on their gain
            for k in np.flatnonzero(~((gains > least) & (gains < largest))).tolist():
                if time_doubted and _is_of_clock(gains[k]):
                    continue
                text = scale_words(float(gains[k]), bool(angular[k]), base, per)
                joints_of.setdefault(text, []).append(names[k])
            for text, joints in joints_of.items():
                doubts.append(doubt("rate", joints, rate=rate, what=text))
        return doubts

    @cached_property
    def _sampling(self) -> list[Doubt]:
        """Doubts about repeated rows, or else deviations from the paths, and about spikes."""
        times = [rows.time for rows in self.runs]
        new_rows_of_runs = []
        for curves in self._curves:
            if not curves.size:
                continue
            rows = new_rows(curves)
            if rows is not None:
                new_rows_of_runs.append(rows)
        if 2 * len(new_rows_of_runs) > len(times):
            return [self._repetition_doubt(times, new_rows_of_runs), *self._torque_doubts()]
        deviations: list[Gap] = []
        for time, curves in zip(times, self._curves, strict=True):
            deviations += gaps(time, curves)
        return [*_gap_doubts(deviations, times), *self._torque_doubts()]

    def _repetition_doubt(self, times: Sequence[Array], new_rows_of_runs: Sequence[Array]) -> Doubt:
        """Doubt about positions that repeat in several rows, from the masks (n,) of rows with new ones."""
        step = float(np.median(np.concatenate(list(map(np.diff, times)))))
        rows_apart = [np.diff(np.flatnonzero(rows)) for rows in new_rows_of_runs]
        apart = step * float(np.median(np.concatenate(rows_apart)))
        return doubt(
            "repeated", rate=number(1 / apart, 3), rows=number(1 / step, 3), apart=seconds(apart, 3),
            found={"value": 1 / apart, "unit": "Hz"},
        )  # fmt: skip

    def _torque_doubts(self) -> Iterator[Doubt]:
        """Doubts about torques with spikes, or with a constant value for a while."""
        for k, (begin, length) in self._dropouts().items():
            words: dict[str, Any] = {"from_": seconds(begin, 4), "length": number(length, 3)}
            yield doubt("dropout", [self._own[k]], found={"value": length, "unit": "s"}, **words)
        masks = [spikes(rows.tau) for rows in self.runs if rows.tau is not None]
        if not masks:
            return
        has_spike = np.concatenate(masks)
        rows = int(has_spike.any(axis=1).sum())
        if rows:
            joint = self._names[int(has_spike.sum(axis=0).argmax())]
            level: Level = "note"
            if rows > _MAX_SHARE_OF_SPIKES * len(has_spike):
                level = "unsure"
            value = {"value": float(rows), "unit": "rows"}
            yield doubt(
                "spikes", [joint], level=level, rows=percent(rows / len(has_spike), 2), joint=joint, found=value
            )

    def _dropouts(self) -> dict[int, tuple[float, float]]:
        """Begin [s] and duration [s] of constant torques, by index among the checked joints."""
        durations = dict[int, tuple[float, float]]()
        for run, curves in zip(self.runs, self._curves, strict=True):
            tau = np.zeros((0, len(self._single)))
            if run.tau is not None:
                tau = run.tau[:, self._single]
            constant = dropouts(run.time, tau, curves)
            for k in np.flatnonzero(constant.any(axis=0)).tolist():
                begin, length = durations.get(k, (float(run.time[constant[:, k].argmax()]), 0.0))
                durations[k] = begin, length + float(np.diff(run.time)[constant[1:, k]].sum())
        return durations


def _share_text(late: LatePositions) -> str:
    """Share of the time in percent: a range if changes were not seen."""
    least, largest = percent(late.min_share), percent(late.max_share)
    return largest if least == largest else f"{least.removesuffix(' %')} to {largest}"


def _gap_doubts(deviations: Sequence[Gap], times: Sequence[Array]) -> Iterator[Doubt]:
    """Doubts about simultaneous deviations of all joints from their paths: buffered or missing rows."""
    if not deviations:
        return
    late = None
    if len(times) == 1:
        late = late_by_turns(deviations, times[0][0], times[0][-1])
    if late is not None:
        delay = 1e3 * late.delay  # ms
        yield doubt(
            "buffered", found={"value": delay, "unit": "ms"}, share=_share_text(late), late=number(delay, 3),
            count=len(deviations), time=seconds(deviations[0].time, 4),
        )  # fmt: skip
        return
    time, held_rows, delays = np.array([(gap.time, gap.held, gap.late) for gap in deviations]).T
    repeated = held_rows > 0
    if repeated.any():
        rows = int(held_rows.max())
        yield doubt("held", found={"value": float(rows), "unit": "rows"}, when=_times_text(time[repeated]), rows=rows)
    pauses = ~repeated
    if not pauses.any():
        return
    why = "rows are missing there, and the stamps were closed up"
    if (delays[pauses] > 0).all():  # where rows are missing, positions are early
        why = f"positions are {number(1e3 * delays[pauses][0], 2)} ms late from there on: a clock was shifted"
    yield doubt("pause", when=_times_text(time[pauses]), why=why, found={"value": float(time[pauses][0]), "unit": "s"})
