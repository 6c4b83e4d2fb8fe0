"""Doubts about a motion without a model: units of angles and time, omitted turns, jumps, inconsistent rates, sampling."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

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


_MAX_REACH_RATIO = 3.0
"""Multiple of the reach of a joint's limits above which the unit is another, if the angle is also above a full turn."""
_MANY_TURNS = 4 * math.pi
"""Angle [rad] above which the unit may be another."""
_REACH_TOLERANCE = 1.1
"""Multiple of its reach up to which a joint may turn in the right unit."""
_FULL_TURN = math.tau
"""Angle [rad] that no joint with limits exceeds."""
_SURE_MOVE = 0.3
"""Range of angles that a moving joint certainly exceeds [rad]."""
_MIN_JOINTS_IN_DEGREES = 3
"""Minimum number of joints that indicates a wrong unit: three joints rarely all stay within six degrees of zero."""
_DEGREE = math.radians(1.0)
"""Radians in a degree."""
_MAX_LISTED_JOINTS = 6
"""Number of joints that a message names."""


def angle_doubts(
    names: Sequence[str],
    extent: Array,
    limits: tuple[Array, Array],
    factor: Array,
    is_stated: Array,
    origin: str = "either",
) -> list[Doubt]:
    """Doubts about the unit of angles, or notes if the unit may be intended.

    The joints (k,) are the revolute ones. ``extent`` (2, k): least and largest angles as read [rad]; ``limits``:
    infinite if there are none; ``factor``: from the file's numbers to radians; ``is_stated``: the file states this
    unit; ``origin``: plan, log or either.
    """
    lower, upper = limits
    largest_angle = np.abs(extent).max(axis=0)
    reach = np.maximum(np.abs(lower), np.abs(upper))  # largest angle within the limits
    is_in_radians = (factor == 1.0) & ~is_stated
    is_in_degrees = (factor == _DEGREE) & ~is_stated
    has_limits = np.isfinite(reach) & (reach > 0) & is_in_radians
    known_reach = np.where(has_limits, reach, 1.0)
    allowed_angle = _MAX_REACH_RATIO * np.maximum(known_reach, _FULL_TURN / _MAX_REACH_RATIO)
    is_far = has_limits & (largest_angle > allowed_angle)
    has_many_turns = largest_angle > _MANY_TURNS
    half_are_far = is_far.any() and is_far.sum() >= 0.5 * has_limits.sum()
    most_of_them_turn_often = (is_far & has_many_turns).sum() > 0.5 * is_far.sum()
    if half_are_far and most_of_them_turn_often:
        return [_too_far(names, largest_angle, limits, reach, is_far)]
    stop_doubts = _stop_doubts(names, extent, limits, is_in_radians, origin)
    if stop_doubts:
        return stop_doubts
    written_angle = largest_angle / factor  # number in the file
    moves = np.ptp(extent, axis=0) / factor > _SURE_MOVE
    are_small = is_in_degrees.any() and (written_angle[is_in_degrees] <= _FULL_TURN).all()
    seem_radians = are_small and moves[is_in_degrees].any()
    several_in_degrees = is_in_degrees.sum() >= _MIN_JOINTS_IN_DEGREES
    if not (seem_radians and several_in_degrees):
        most_turn_often = has_many_turns.sum() > 0.5 * len(names)
        all_in_radians = (factor == 1.0).all() and not is_stated.any()
        if most_turn_often and all_in_radians:
            return [_too_far(names, largest_angle, limits, reach, has_many_turns, level="note")]
        if is_far.any():
            return [_too_far(names, largest_angle, limits, reach, is_far, level="note")]
    if not seem_radians:
        return []
    level: Level | None = None if several_in_degrees else "note"
    return [doubt("degrees-option", level=level, angle=printed(written_angle[is_in_degrees].max(), 3))]


_BEYOND_STOP = math.radians(20.0)
"""Angle beyond a stop that play, elasticity and the tolerance of a stop do not explain."""
_METRES_PER_MILLIMETRE = 1e-3
_STROKE_TOLERANCE = 0.1
"""Share of the stroke by which a position read as millimetres may lie beyond a stop."""
_MANY_STROKES = 10.0
"""Number of strokes beyond a stop from which a position is in millimetres: it is then at least 1 % of the stroke in metres.

Nearer positions have another zero.
"""


def _stop_doubts(
    names: Sequence[str], extent: Array, limits: tuple[Array, Array], is_in_radians: Array, origin: str
) -> list[Doubt]:
    """Doubt about angles far beyond the stops of joints with two stops, or about joints that are wound by a turn.

    Only joints for which ``is_in_radians`` is True are checked.
    """
    lower, upper = limits
    has_stops = is_in_radians & np.isfinite(lower) & np.isfinite(upper) & (upper > lower)
    excess = np.where(has_stops, np.maximum(lower - extent[0], extent[1] - upper), 0.0)
    is_beyond = excess > _BEYOND_STOP
    if origin == "plan" or not is_beyond.any():
        return []
    middle = 0.5 * (np.where(has_stops, lower, 0.0) + np.where(has_stops, upper, 0.0))
    turn_to_middle = np.sign(middle - extent.mean(axis=0)) * math.tau
    is_inside_after_turn = (extent[0] + turn_to_middle >= lower) & (extent[1] + turn_to_middle <= upper)
    is_wound = is_beyond & is_inside_after_turn
    least, largest = extent * _DEGREE  # the same numbers read as degrees
    is_inside_as_degrees = ~has_stops | ((least >= lower - _BEYOND_STOP) & (largest <= upper + _BEYOND_STOP))
    is_unexplained = is_beyond & ~is_wound
    if not is_unexplained.any():
        joints = names_of(names, is_beyond)
        level: Level = "note" if origin == "log" else "unsure"
        return [doubt("wound", joints, joints_=listed(joints, _MAX_LISTED_JOINTS), level=level)]
    joints = names_of(names, is_unexplained)
    words = _stop_words(names, extent, limits, excess)
    words |= {"past": f"{printed(math.degrees(excess.max()), 3)} degrees", "unit": "rad"}
    if is_beyond.sum() > 1 and is_inside_as_degrees.all():
        return [doubt("degrees-inside", joints, count=f"{is_beyond.sum()}", **words)]
    return [doubt("zero-or-direction", joints, **words)]


def length_doubts(names: Sequence[str], extent: Array, limits: tuple[Array, Array], origin: str) -> list[Doubt]:
    """Doubt about sliding joints (k,) that leave their stops by more than the whole range."""
    lower, upper = limits
    has_stops = np.isfinite(lower) & np.isfinite(upper) & (upper > lower)
    stroke = np.where(has_stops, upper - lower, np.inf)
    excess = np.where(has_stops, np.maximum(lower - extent[0], extent[1] - upper), 0.0)
    is_beyond = excess > stroke
    if origin == "plan" or not is_beyond.any():
        return []
    least, largest = extent * _METRES_PER_MILLIMETRE
    margin = _STROKE_TOLERANCE * stroke
    is_inside_as_millimetres = ~has_stops | ((least >= lower - margin) & (largest <= upper + margin))
    words = _stop_words(names, extent, limits, excess)
    words |= {"past": f"{printed(excess.max(), 3)} m", "unit": "m"}
    is_far_beyond = (excess[is_beyond] > _MANY_STROKES * stroke[is_beyond]).any()
    kind = "zero-or-direction"
    if is_far_beyond and is_inside_as_millimetres.all():
        kind = "millimetres-inside"
    return [doubt(kind, names_of(names, is_beyond), **words)]


def names_of(names: Sequence[str], mask: Array) -> list[str]:
    """Names of the joints for which a mask (k,) is True."""
    return [names[k] for k in np.flatnonzero(mask).tolist()]


def _stop_words(names: Sequence[str], extent: Array, limits: tuple[Array, Array], excess: Array) -> dict[str, Any]:
    """Name, farthest position and stops of the joint that is farthest beyond a stop."""
    lower, upper = limits
    k = int(excess.argmax())
    joint_extent = extent[:, k]
    farthest_position = float(joint_extent[np.abs(joint_extent).argmax()])
    words: dict[str, Any] = {"joint": names[k], "position": printed(farthest_position, 4)}
    return words | {"lower": printed(lower[k], 3), "upper": printed(upper[k], 3)}


def _too_far(
    names: Sequence[str], largest_angle: Array, limits: tuple[Array, Array], reach: Array, is_far: Array, **level: Any
) -> Doubt:
    """Doubt about joints whose angles are too large, for which ``is_far`` (k,) is True."""
    lower, upper = limits
    ratios = largest_angle / np.where(np.isfinite(reach), reach, 1.0)
    far_joints = np.flatnonzero(is_far)
    k = int(far_joints[ratios[is_far].argmax()])
    limit_text = ""
    if np.isfinite(reach[k]):
        limit_text = f", and its limits are at {printed(lower[k], 3)} and {printed(upper[k], 3)}"
    others_text = ""
    other_count = int(is_far.sum()) - 1
    if other_count == 1:
        others_text = ", and 1 more joint is as far out"
    elif other_count:
        others_text = f", and {other_count} more joints are as far out"
    fit_as_degrees = (largest_angle[is_far] * _DEGREE <= _REACH_TOLERANCE * reach[is_far]).all()
    if fit_as_degrees:
        question = f"Did you mean {spell(Argument('degrees', True))}? Or are"
        counts = ""
    else:
        question = "Are"
        counts = ", or counts of an encoder"
    return doubt(
        "angle-unit", [names[k]], joint=names[k], angle=printed(largest_angle[k], 4), limit=limit_text, more=others_text,
        question=question, counts=counts, **level,
    )  # fmt: skip


_MAX_LISTED_TIMES = 3
"""Number of times that a message names."""


def row_doubts(glitches: SingleRowGlitches, names: Sequence[str], *, left_out: bool = False) -> list[Doubt]:
    """Doubts about glitches of each joint and wrong time stamps; notes if the rows are ``left_out``."""
    doubts = []
    for k, joint_glitches in glitches.result():
        position_glitches = [glitch for glitch in joint_glitches if not glitch.late]
        if not position_glitches:
            continue
        largest_size = position_glitches[0].size  # the largest come first
        size_text = f"{printed(largest_size, 3)} m"
        if glitches.turns[k]:
            size_text = f"{printed(math.degrees(largest_size), 3)} degrees"
        when = _times_text(glitch.time for glitch in position_glitches)
        words = {"joint": names[k], "size": size_text, "when": when}
        doubts.append(_row_doubt("single-row", [names[k]], words, left_out=left_out))
    return [*doubts, *stamp_doubts(glitches.stamps(), left_out=left_out)]


def stamp_doubts(stamps: Mapping[float, float], *, left_out: bool = False) -> list[Doubt]:
    """Doubt about wrong time stamps, given as a mapping from time to delay [s]; empty if there are none."""
    if not stamps:
        return []
    largest_delay = max(stamps.values(), key=abs)
    rows_text = "1 row" if len(stamps) == 1 else f"{len(stamps)} rows"
    direction = "late" if largest_delay > 0 else "early"
    words = {"rows": rows_text, "when": _times_text(stamps), "late": seconds(abs(largest_delay)), "way": direction}
    return [_row_doubt("stamp", [], words, left_out=left_out)]


def _times_text(times: Iterable[float]) -> str:
    """Text of the first few times [s]."""
    return listed((f"{seconds(time, 4)} s" for time in times), _MAX_LISTED_TIMES)


def _row_doubt(kind: str, joints: Sequence[str], words: Mapping[str, Any], *, left_out: bool) -> Doubt:
    """Doubt of a kind about some rows; with ``left_out``, a note that these rows are left out."""
    if not left_out:
        return doubt(kind, joints, **words)
    sentence = doubt_table()[kind].sentence.format(**words)
    return doubt("rows-left-out", joints, what=sentence.rstrip(":"))


_DEGREES_PER_RADIAN = math.degrees(1.0)
_RPM_PER_RADIAN_PER_SECOND = 30 / math.pi
_FACTOR_TOLERANCE = 0.1
"""Relative tolerance of a gain that is a factor between units."""
_TIME_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns"}
"""Units of time by their number in a second."""
_NEGLIGIBLE_GAIN = 0.02
"""Gain below which a rate does not follow the slope at all."""


def scale_words(gain: float, angular: bool, base: str, per: str) -> str:
    """Text on a column of rates that are ``gain`` times the slope of the ``base``: "positions" or "velocities".

    ``per`` is the suffix of the rate's unit, such as /s.
    """
    slope = f"the slope of the {base}"
    causes = {}  # texts of factor and cause by factor
    for factor, unit in _TIME_UNITS.items():
        causes[factor] = (printed(factor), f"time seems to be in {unit}")
    causes[1e-3] = ("1/1000", "time, or the column, seems to be in another unit")
    if angular:
        in_degrees = f"it seems to be in deg{per}; name the unit, as in 'JOINT [deg{per}]'"
        base_in_degrees = "the positions seem to be in degrees; name the unit, as in 'JOINT [deg]'"
        causes[_DEGREES_PER_RADIAN] = ("57.3", in_degrees)
        causes[1 / _DEGREES_PER_RADIAN] = ("1/57.3", base_in_degrees)
        if per == "/s":
            in_rpm = "it seems to be in rpm; name the unit, as in 'JOINT [rpm]'"
            causes[_RPM_PER_RADIAN_PER_SECOND] = ("9.55", in_rpm)
    else:
        causes[1e3] = ("1000", f"time seems to be in ms, or the column in mm{per}")
    for factor, (factor_text, reason) in causes.items():
        if _is_about(gain, factor):
            return f"is {factor_text} times {slope}: {reason}"
    if math.isinf(gain):
        return f"moves, and the {base} stand"
    if abs(gain) < _NEGLIGIBLE_GAIN:
        return f"is next to nothing, and the {base} move: leave the column out, then it is derived"
    if _is_about(gain, -1.0):
        return f"has the opposite sign of {slope}"
    return f"is not {slope}, but some {printed(gain, 2)} times it"


def _is_about(gain: float, factor: float) -> bool:
    """True if a gain is near a factor between units."""
    return abs(gain / factor - 1.0) < _FACTOR_TOLERANCE


def _is_time_factor(gain: float) -> bool:
    """True if a gain is near a factor between units of time."""
    return math.isfinite(gain) and any(_is_about(gain, factor) for factor in _TIME_UNITS)


_ALLOWED_GAINS = {"velocity": (0.85, 1.15), "acceleration": (0.75, 1.3)}
"""Allowed ratios of a measured rate to the slope of the integrated quantity.

Filters and delays reduce the ratio little: measured velocities of real logs have 0.94 to 1.02. A wrong unit, gear ratio
or clock changes it more.
"""
_OMITTED_TURN_STEPS = (1.5 * math.pi, 2.5 * math.pi)
"""Range of steps of an angle [rad] that count as an omitted turn, if the log stays within one turn."""
_TURN_TOLERANCE = 0.01 * math.pi
"""Angle [rad] by which a log may leave one turn."""
TOO_FAST = 3.0
"""Multiple of a velocity limit that no robot reaches, as drives are stopped long before.

For a step over half a turn of a joint without a limit, it is a multiple of the largest speed elsewhere.
"""
_LONG_STEP = 1.0
"""Time step [s] from which time may be in a smaller unit, if the motion is slow."""
_SHORT_MOVE = 0.1
"""Displacement per step [rad, m] below which the motion is too slow for so long a step."""
_SOME_MOVE = 0.05
"""Range of positions [rad, m] above which a joint moves."""
_MIN_ROWS = 20
"""Number of rows from which time is judged."""
_MAX_SHARE_OF_LIMIT = 1.5
"""Multiple of the velocity limit that excludes a unit of time as too fast."""
_MAX_SPEED = 30.0
"""Speed [rad/s, m/s] of a joint without a limit that excludes a unit of time as too fast."""
_MIN_LOGGING_RATE = 10.0
"""Lowest rate [Hz] of a log whose time may count rows."""
_MAX_STEP_IN_MS = 500.0
"""Time step, as a number, below which it is in ms: loggers have steps of some ms."""
_MAX_STEP_IN_US = 5e5
"""Time step, as a number, below which it is in us."""
_MIN_DELAY_RANGE = 5e-4
"""Range of delays [s] above which both ends are printed; delays are printed in ms."""
_SLOW_STEP = 0.1
"""Time step [s] from which time may be in ms, if speeds in ms are within known limits: loggers have 0.1 ms and more."""
_MAX_SHARE_OF_SPIKES = 0.01
"""Share of rows with spikes from which a doubt is raised."""


class _LongStep(NamedTuple):
    """Step of an angle beyond half a turn."""

    speed: float
    """Speed of the step [rad/s]."""
    time: float
    """Time before the step [s]."""
    displacement: float
    """Displacement with its sign [rad]."""


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
        coordinate_count = len(coordinates.names)
        self._factor = np.ones(coordinate_count) if angle is None else angle
        self._is_stated = np.zeros(coordinate_count, bool) if angle_stated is None else angle_stated
        self._names = np.array(coordinates.velocity_names, object)
        self._is_angular_velocity = coordinates.angular_velocity
        self._checked = np.flatnonzero(coordinates.position_of >= 0)
        """(k,) indices in dq of the checked entries: joints with one coordinate."""
        self._checked_names = self._names[self._checked].tolist()
        """Names of the checked entries."""
        self.places = coordinates.position_of[self._checked]
        """(k,) indices in q of the checked entries."""
        self._is_angle = coordinates.angular[self.places]
        """(k,) True for angles."""
        self._is_bounded = self._is_angle & ~coordinates.endless[self.places]
        """(k,) True for angles of joints that do not turn without end."""
        self._time_stated = time_stated
        self.runs = runs
        """Runs of rows, the whole motion or excerpts of a long one."""
        checked_count = len(self._checked)
        self.glitches = SingleRowGlitches(checked_count, self._is_angle)
        """Rows in which a single joint leaves its path."""
        self._range = np.array([[math.inf], [-math.inf]]).repeat(checked_count, axis=1)
        """(2, k) least and largest positions as logged; infinite before the first row."""
        self._unwrapped_range = self._range.copy()
        """(2, k) least and largest positions with omitted turns added."""
        self._added_turns = np.zeros(checked_count)
        """Number of turns that are added to the last position."""
        self._wrap_counts = np.zeros(checked_count, int)
        """Number of steps that may be omitted turns."""
        self._jumps: dict[int, _LongStep] = {}
        """Fastest step beyond half a turn of each joint, unless it may be an omitted turn."""
        self._first_wraps: dict[int, _LongStep] = {}
        """First step of each joint that may be an omitted turn."""
        self._largest_speed = np.zeros(checked_count)
        """Largest speed, without steps beyond half a turn."""
        self._largest_distance = np.zeros(checked_count)
        """Largest displacement in a step, without steps beyond half a turn."""
        self._median_steps: list[float] = []
        """Median time step of each portion [s]."""
        self._step_count = 0
        self._counts_rows = may_count_rows
        """True if each step of time is exactly 1, from a whole number on."""

    def add(self, t: Array, q: Array, before: int = 0) -> None:
        """Add times (n,) and coordinates (n, nq); the first ``before`` (at most OVERLAP) repeat the end of the last portion."""
        q = q[:, self.places]
        first_for_glitches = max(0, before - OVERLAP)
        self.glitches.add(t[first_for_glitches:], q[first_for_glitches:])
        last_known = max(0, before - 1)  # the last row of the last portion, from which the first new step begins
        t = t[last_known:]
        q = q[last_known:]
        h = np.diff(t)
        displacement = np.diff(q, axis=0)
        distance = np.abs(displacement)
        shortest_turn, longest_turn = _OMITTED_TURN_STEPS
        is_wrap = (distance > shortest_turn) & (distance < longest_turn) & self._is_bounded
        turns_of_steps = np.where(is_wrap, -np.sign(displacement), 0.0)
        turns_of_rows = np.pad(turns_of_steps, ((1, 0), (0, 0)))  # the first row adds none
        added_turns = self._added_turns + np.cumsum(turns_of_rows, axis=0)
        self._added_turns = added_turns[-1]
        _extend_range(self._range, q)
        _extend_range(self._unwrapped_range, q + math.tau * added_turns)
        if not len(h):
            return
        self._step_count += len(h)
        self._counts_rows &= bool((h == 1.0).all()) and float(t[0]).is_integer()
        self._median_steps.append(float(np.median(h)))
        exceeds_half_turn = (distance > math.pi) & self._is_angle
        speed = np.where(exceeds_half_turn, 0.0, distance / h[:, None])
        self._largest_speed = np.maximum(self._largest_speed, speed.max(axis=0))
        distance_within_half_turn = np.where(exceeds_half_turn, 0.0, distance)
        self._largest_distance = np.maximum(self._largest_distance, distance_within_half_turn.max(axis=0))
        self._wrap_counts += is_wrap.sum(axis=0)
        for row, k in np.argwhere(exceeds_half_turn & self._is_bounded).tolist():
            speed_of_step = float(distance[row, k] / h[row])
            step = _LongStep(speed_of_step, time=float(t[row]), displacement=float(displacement[row, k]))
            if is_wrap[row, k]:
                self._first_wraps.setdefault(k, step)
            elif k not in self._jumps or step.speed > self._jumps[k].speed:
                self._jumps[k] = step

    def doubts(self, limits: Limits | None = None, *, glitches: bool = True, origin: str = "either") -> list[Doubt]:
        """All doubts and notes; velocity limits distinguish a jump from a fast motion. ``origin``: plan, log or either."""
        time_doubts = self.time_doubts(limits)
        unit_doubts = self._angle_doubts(limits, origin) + self._length_doubts(limits, origin)
        doubts = time_doubts + unit_doubts
        if not any(unit_doubt.refuses for unit_doubt in unit_doubts):
            doubts += [*self._jump_doubts(limits), *self._turn_doubts(limits)]
            if glitches:
                doubts += row_doubts(self.glitches, self._checked_names)
        if time_doubts:  # delays have no unit then
            delays = np.zeros(len(self._checked))
        else:
            delays = self._delays
        doubts += self.rate_doubts(time_doubted=bool(time_doubts), late=delays != 0.0)
        doubts += self._delay_doubts(delays)
        if not time_doubts:
            doubts += self._step_doubts(limits, origin)
        return doubts + self._sampling

    def _length_doubts(self, limits: Limits | None, origin: str) -> list[Doubt]:
        """Doubts of sliding joints."""
        is_length = ~self._is_angle
        sliding_joints = self._checked[is_length]
        if limits is None or not sliding_joints.size:
            return []
        stops = (limits.lower[sliding_joints], limits.upper[sliding_joints])
        return length_doubts(self._names[sliding_joints].tolist(), self._range[:, is_length], stops, origin)

    def _angle_doubts(self, limits: Limits | None, origin: str) -> list[Doubt]:
        """Doubts of revolute joints."""
        turning_joints = self._checked[self._is_angle]
        places = self.places[self._is_angle]
        is_bounded = self._is_bounded[self._is_angle]
        lower = np.full(len(places), -np.inf)
        upper = np.full(len(places), np.inf)
        if limits is not None:
            bounded_joints = turning_joints[is_bounded]
            lower[is_bounded] = limits.lower[bounded_joints]
            upper[is_bounded] = limits.upper[bounded_joints]
        names = self._names[turning_joints].tolist()
        extent = self._range[:, self._is_angle]
        return angle_doubts(names, extent, (lower, upper), self._factor[places], self._is_stated[places], origin)

    def time_doubts(self, limits: Limits | None) -> list[Doubt]:
        """Doubt about the unit of time, if time steps are too long for the displacements in them."""
        step = self._usual_step
        is_moving = self._range[1] - self._range[0] > _SOME_MOVE
        row_count = self._step_count + 1
        if self._time_stated or row_count < _MIN_ROWS or not is_moving.any():
            return []
        if step < _MAX_STEP_IN_MS:
            units_per_second = 1e3
        elif step < _MAX_STEP_IN_US:
            units_per_second = 1e6
        else:
            units_per_second = 1e9
        unit = _TIME_UNITS[units_per_second]
        if not self._keeps_speed(units_per_second, limits):
            return []  # in that unit the motion would exceed the robot's limits
        velocity_limits = self._velocity_limits(limits)[is_moving]
        if step >= _LONG_STEP and self._largest_distance.max(initial=0.0) < _SHORT_MOVE:
            slowness = f"within one no joint moves by more than {printed(self._largest_distance.max(), 2)} rad or m"
        elif step >= _SLOW_STEP and np.isfinite(velocity_limits).all():
            share_of_limits = float((self._largest_speed[is_moving] / velocity_limits).max())
            slowness = f"no joint moves faster than {printed(100 * share_of_limits, 2)} % of its limit of velocity"
        else:
            return []
        reason = f"the usual step of time is {printed(step, 4)} s, and {slowness}"
        rate_text = ""
        if self._counts_rows:
            rate_option = spell(Argument("rate", Placeholder("HZ")))
            rate_text = f"; if it counts rows, give their rate by {rate_option}"
        column = Argument("columns", {"time": f"COLUMN [{unit}]"})
        return [doubt("time-unit", why=reason, unit=unit, rate=rate_text, column=column)]

    def _step_doubts(self, limits: Limits | None, origin: str) -> list[Doubt]:
        """Doubt about a time that may count rows, or note on long steps: whole seconds of a slow log look like row numbers.

        Time is in seconds if velocities were logged, as their scale is compared with it. It is also in seconds if ten rows
        per second would need more than the robot's speed. A plan may have points at whole seconds.
        """
        if self._time_stated or self._usual_step < _LONG_STEP:
            return []
        row_count = self._step_count + 1
        is_confirmed = origin == "plan" or any(rows.dq is not None for rows in self.runs)
        may_count_rows = self._counts_rows and row_count >= _MIN_ROWS and not is_confirmed
        if may_count_rows and self._keeps_speed(_MIN_LOGGING_RATE, limits):
            return [doubt("row-numbers", rows=row_count)]
        return [doubt("time-step", step=printed(self._usual_step, 4))]

    def _keeps_speed(self, factor: float, limits: Limits | None) -> bool:
        """True if no joint exceeds the speed that a robot can reach when its speeds are multiplied by ``factor``."""
        velocity_limits = self._velocity_limits(limits)
        max_speed = np.where(np.isfinite(velocity_limits), _MAX_SHARE_OF_LIMIT * velocity_limits, _MAX_SPEED)
        return bool((factor * self._largest_speed <= max_speed).all())

    def _velocity_limits(self, limits: Limits | None) -> Array:
        """Velocity limits (k,) of the checked entries, infinite if none is known."""
        velocity = np.full(len(self._checked), np.inf)
        if limits is not None:
            velocity = limits.velocity[self._checked]
        return known_velocities(velocity, self._is_angle)

    @property
    def _usual_step(self) -> float:
        """Median time step [s]; 0 without rows."""
        if not self._median_steps:
            return 0.0
        return float(np.median(self._median_steps))

    def _stays_in_a_turn(self) -> Array:
        """True for joints (k,) whose positions stay within -π to π, or within 0 to 2π."""
        least, largest = self._range
        is_about_zero = (least >= -math.pi - _TURN_TOLERANCE) & (largest <= math.pi + _TURN_TOLERANCE)
        is_above_zero = (least >= -_TURN_TOLERANCE) & (largest <= math.tau + _TURN_TOLERANCE)
        return np.asarray(is_about_zero | is_above_zero)

    def _jump_doubts(self, limits: Limits | None) -> Iterator[Doubt]:
        """Doubts about steps over half a turn that are too fast for the joint, and not omitted turns."""
        stays_in_a_turn = self._stays_in_a_turn()
        for k, joint in enumerate(self._checked.tolist()):
            jump = self._jumps.get(k)
            if jump is None and not stays_in_a_turn[k]:
                jump = self._first_wraps.get(k)
            if jump is None:
                continue
            usual_speed = float(self._largest_speed[k])
            if limits is not None and math.isfinite(limits.velocity[joint]):
                usual_speed = float(limits.velocity[joint])
            if jump.speed > TOO_FAST * usual_speed:
                words: dict[str, Any] = {
                    "angle": printed(jump.displacement, 4),
                    "time": seconds(jump.time, 4),
                    "speed": printed(jump.speed, 3),
                }
                yield doubt("jump", [self._checked_names[k]], joint=self._checked_names[k], **words)

    def _turn_doubts(self, limits: Limits | None) -> Iterator[Doubt]:
        """Notes on added turns, and doubts about joints that exceed their limits whatever number of turns is added."""
        has_turns = (self._wrap_counts > 0) & self._stays_in_a_turn()
        for k in np.flatnonzero(has_turns).tolist():
            name = self._checked_names[k]
            count_text = "1 time" if self._wrap_counts[k] == 1 else f"{self._wrap_counts[k]} times"
            first_time = seconds(self._first_wraps[k].time, 4)
            yield doubt("turned-on", [name], joint=name, count=count_text, time=first_time)
            if limits is None:
                continue
            joint = self._checked[k]
            lower = float(limits.lower[joint])
            upper = float(limits.upper[joint])
            tolerance = float(limits.tolerance[joint])
            if not (math.isfinite(lower) and math.isfinite(upper)):
                continue
            least, largest = self._unwrapped_range[:, k].tolist()
            # Fewest turns after which the least angle is not below the lower limit.
            turns = math.ceil((lower - tolerance - least) / math.tau)
            if largest + math.tau * turns > upper + tolerance:
                words: dict[str, Any] = {
                    "angle": printed(largest - least, 4),
                    "lower": printed(lower, 4),
                    "upper": printed(upper, 4),
                }
                yield doubt("wrapped", [name], joint=name, **words)

    @cached_property
    def _curves(self) -> list[Array]:
        """Positions (n, k) of each run, with omitted turns added."""
        all_curves = [rows.q[:, self.places] for rows in self.runs]
        for curves in all_curves:
            curves[:, self._is_angle] = np.unwrap(curves[:, self._is_angle], axis=0)
        return all_curves

    def _curves_and_rates(self, rate: str) -> list[tuple[Array, Array, Array]]:
        """Time, curves and their rates of each run that has these rates.

        ``rate`` is ``velocity``: velocities of positions; ``acceleration``: accelerations of velocities; or ``derived``:
        accelerations of velocities that are derived from positions.
        """
        runs_with_rates = []
        for rows, curves in zip(self.runs, self._curves, strict=True):
            if rate == "velocity" and rows.dq is not None:
                runs_with_rates.append((rows.time, curves, rows.dq[:, self._checked]))
            elif rate == "acceleration" and rows.dq is not None and rows.ddq is not None:
                runs_with_rates.append((rows.time, rows.dq, rows.ddq))
            elif rate == "derived" and rows.dq is None and rows.ddq is not None and len(curves) > 1:
                derived_dq = np.gradient(curves, rows.time, axis=0)
                runs_with_rates.append((rows.time, derived_dq, rows.ddq[:, self._checked]))
        return runs_with_rates

    @cached_property
    def _delays(self) -> Array:
        """Delay (k,) of each velocity behind the slope of its positions [s]; 0 if it has none."""
        return rate_delays(self._curves_and_rates("velocity"), len(self._checked))

    def _delay_doubts(self, delays: Array) -> Iterator[Doubt]:
        """Doubts about velocities that are late or early."""
        for direction, is_shifted in (("late", delays > 0.0), ("early", delays < 0.0)):
            if is_shifted.any():
                sizes = np.abs(delays[is_shifted])
                delay_text = seconds(sizes.min())
                if np.ptp(sizes) > _MIN_DELAY_RANGE:
                    delay_text += f" to {seconds(sizes.max())}"
                yield doubt("rate-late", names_of(self._checked_names, is_shifted), late=delay_text, way=direction)

    @cached_property
    def _scales(self) -> list[tuple[str, str, list[str], Array, Array]]:
        """For each kind of rates: its name, name of the differentiated quantity, joints, True for revolute joints, scales."""
        all_joints = np.arange(len(self._names))
        kinds_of_rates = (
            ("velocity", self._checked, "positions"),
            ("acceleration", all_joints, "velocities"),
            ("derived", self._checked, "positions' velocities"),
        )
        scales = []
        for kind, joints, base in kinds_of_rates:
            rate = "velocity" if kind == "velocity" else "acceleration"
            names = self._names[joints].tolist()
            is_angular = self._is_angular_velocity[joints]
            rate_gains = rate_scales(self._curves_and_rates(kind), is_angular)
            scales.append((rate, base, names, is_angular, rate_gains))
        return scales

    def rate_doubts(self, *, time_doubted: bool = False, late: Array | None = None) -> list[Doubt]:
        """Doubts about rates that differ from the slope of the quantity whose rates they are.

        ``late`` (k,) of bool: True if the velocity is shifted in time, so that its scale is not compared.
        """
        doubts = []
        for rate, base, names, is_angular, scales in self._scales:
            gains = scales
            if rate == "velocity" and late is not None:
                gains = np.where(late, 1.0, scales)
            unit_suffix = "/s" if rate == "velocity" else "/s^2"
            least, largest = _ALLOWED_GAINS[rate]
            is_allowed = (gains > least) & (gains < largest)
            joints_by_text: dict[str, list[str]] = {}
            for k in np.flatnonzero(~is_allowed).tolist():
                if time_doubted and _is_time_factor(gains[k]):
                    continue
                text = scale_words(float(gains[k]), bool(is_angular[k]), base, unit_suffix)
                joints_by_text.setdefault(text, []).append(names[k])
            for text, joints in joints_by_text.items():
                doubts.append(doubt("rate", joints, rate=rate, what=text))
        return doubts

    @cached_property
    def _sampling(self) -> list[Doubt]:
        """Doubts about repeated rows, or else about deviations from the paths; also about torques."""
        times = [rows.time for rows in self.runs]
        new_rows_of_runs = []
        for curves in self._curves:
            if not curves.size:
                continue
            rows = new_rows(curves)
            if rows is not None:
                new_rows_of_runs.append(rows)
        if len(new_rows_of_runs) > 0.5 * len(times):
            return [self._repetition_doubt(times, new_rows_of_runs), *self._torque_doubts()]
        deviations: list[Gap] = []
        for time, curves in zip(times, self._curves, strict=True):
            deviations += gaps(time, curves)
        return [*_gap_doubts(deviations, times), *self._torque_doubts()]

    def _repetition_doubt(self, times: Sequence[Array], new_rows_of_runs: Sequence[Array]) -> Doubt:
        """Doubt about positions that repeat in several rows; masks (n,) are True in rows with new positions."""
        time_steps = [np.diff(t) for t in times]
        step = float(np.median(np.concatenate(time_steps)))
        rows_between_new = [np.diff(np.flatnonzero(is_new)) for is_new in new_rows_of_runs]
        interval = step * float(np.median(np.concatenate(rows_between_new)))
        return doubt(
            "repeated", rate=number(1 / interval, 3), rows=number(1 / step, 3), apart=seconds(interval, 3),
            found={"value": 1 / interval, "unit": "Hz"},
        )  # fmt: skip

    def _torque_doubts(self) -> Iterator[Doubt]:
        """Doubts about torques with spikes, or with a constant value for a while."""
        for k, (begin, length) in self._dropouts().items():
            words: dict[str, Any] = {"from_": seconds(begin, 4), "length": number(length, 3)}
            yield doubt("dropout", [self._checked_names[k]], found={"value": length, "unit": "s"}, **words)
        masks = [spikes(rows.tau) for rows in self.runs if rows.tau is not None]
        if not masks:
            return
        has_spike = np.concatenate(masks)
        spike_row_count = int(has_spike.any(axis=1).sum())
        if spike_row_count:
            joint = self._names[int(has_spike.sum(axis=0).argmax())]
            share = spike_row_count / len(has_spike)
            level: Level = "unsure" if spike_row_count > _MAX_SHARE_OF_SPIKES * len(has_spike) else "note"
            found = {"value": float(spike_row_count), "unit": "rows"}
            yield doubt("spikes", [joint], level=level, rows=percent(share, 2), joint=joint, found=found)

    def _dropouts(self) -> dict[int, tuple[float, float]]:
        """Begin [s] and duration [s] of constant torques, by index among the checked joints."""
        durations: dict[int, tuple[float, float]] = {}
        for run, curves in zip(self.runs, self._curves, strict=True):
            tau = np.zeros((0, len(self._checked)))
            if run.tau is not None:
                tau = run.tau[:, self._checked]
            is_constant = dropouts(run.time, tau, curves)
            time_steps = np.diff(run.time)
            for k in np.flatnonzero(is_constant.any(axis=0)).tolist():
                first_time = float(run.time[is_constant[:, k].argmax()])
                begin, duration = durations.get(k, (first_time, 0.0))
                duration_in_run = float(time_steps[is_constant[1:, k]].sum())
                durations[k] = (begin, duration + duration_in_run)
        return durations


def _share_text(late: LatePositions) -> str:
    """Share of the time in percent; a range if it is not known exactly."""
    least, largest = percent(late.min_share), percent(late.max_share)
    return largest if least == largest else f"{least.removesuffix(' %')} to {largest}"


def _extend_range(extent: Array, x: Array) -> None:
    """Extend least and largest values (2, k), in place, by the rows x (n, k)."""
    extent[0] = np.minimum(extent[0], x.min(axis=0))
    extent[1] = np.maximum(extent[1], x.max(axis=0))


def _gap_doubts(deviations: Sequence[Gap], times: Sequence[Array]) -> Iterator[Doubt]:
    """Doubts about simultaneous deviations of all joints from their paths: buffered or missing rows."""
    if not deviations:
        return
    late_positions = None
    if len(times) == 1:
        time = times[0]
        late_positions = late_by_turns(deviations, time[0], time[-1])
    if late_positions is not None:
        delay = 1e3 * late_positions.delay  # ms
        yield doubt(
            "buffered", found={"value": delay, "unit": "ms"}, share=_share_text(late_positions), late=number(delay, 3),
            count=len(deviations), time=seconds(deviations[0].time, 4),
        )  # fmt: skip
        return
    gap_times, repeated_rows, delays = np.array([(gap.time, gap.held, gap.late) for gap in deviations]).T
    is_repetition = repeated_rows > 0
    if is_repetition.any():
        largest_count = int(repeated_rows.max())
        found = {"value": float(largest_count), "unit": "rows"}
        yield doubt("held", found=found, when=_times_text(gap_times[is_repetition]), rows=largest_count)
    is_pause = ~is_repetition
    if not is_pause.any():
        return
    pause_times = gap_times[is_pause]
    pause_delays = delays[is_pause]
    reason = "rows are missing there, and the stamps were closed up"
    if (pause_delays > 0).all():  # where rows are missing, positions are early
        reason = f"positions are {number(1e3 * pause_delays[0], 2)} ms late from there on: a clock was shifted"
    found = {"value": float(pause_times[0]), "unit": "s"}
    yield doubt("pause", when=_times_text(pause_times), why=reason, found=found)
