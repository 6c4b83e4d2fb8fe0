"""Motions that no robot makes: rows that are missing, repeated or wrong, and speeds and torques far beyond the limits.

Let v_ij = (q_j(i+1) - q_j(i)) / h_i be the speed of joint j in step i, and m_ij its running median over nine steps. The median
follows edges: at an impact, a stop or a start, v stays at its median. A row that is missing, repeated or wrong makes a pulse of
v, of at most four steps, so that v leaves its median and returns. No motor makes such a pulse, as it takes an acceleration and
the opposite one within a few rows. If a joint does move so, it was sampled too slowly, and its derived torque is unknown too.

A log is judged as it was recorded, without payloads and wrenches that a user asks about. Velocity limits of a table with units
are such a question too. Limits of a table without units replace those of the file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.doubts import Doubt, Level, doubt
from ..core.estimation.least_squares import MAD
from ..core.estimation.noise import quantum
from ..core.numbers import number, seconds
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.joints.units import unit_of
from ..mechanics.model.couplings import drive_turns
from .bounds import Extrema
from .contradictions import TOO_FAST
from .credible_values import credible_efforts, credible_velocities

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot
    from .coordinates import Coordinates


class Origin(StrEnum):
    """Source of a motion."""

    PLAN = "plan"
    """A planner's result: its excesses are certain."""
    LOG = "log"
    """A recording, by its measured torques or the grid of an encoder: it cannot exceed what the robot can do."""
    EITHER = "either"
    """Neither is known: it may be a plan or a log."""

    @property
    def level(self) -> Level:
        """Level of a doubt about a motion that no robot makes."""
        if self is Origin.LOG:
            return "refuse"
        return "unsure"


class InstantKind(StrEnum):
    """Cause of rates that no drive makes."""

    ROWS = "rows"
    """A pulse of speed: rows are missing, repeated or wrong."""
    FREEZE = "freeze"
    """A moving robot stands from one row to the next, and its positions repeat exactly."""
    IMPACT = "impact"
    """A corner of the path: the speed changes from one row to the next, as in an impact."""


_DECIMAL_STEPS = (1.0, 2.0, 5.0, 10.0)
"""Mantissas of the steps of decimal numbers, such as 0.001 or 0.5."""
_TOLERANCE = 1e-6
"""Relative tolerance of equal numbers that were printed."""


def is_encoder(grid: float) -> bool:
    """True if a grid is that of an encoder, and not of printed decimals.

    >>> is_encoder(6.283185307 / 4096), is_encoder(0.001), is_encoder(0.0)
    (True, False, False)
    """
    if not grid > 0.0:
        return False
    # With the tolerance, 0.000999999999 counts as 0.001 and not as 9.99e-4.
    power_of_ten = 10.0 ** np.floor(np.log10(grid * (1.0 + _TOLERANCE)))
    mantissa = grid / power_of_ten
    return not any(abs(mantissa / step - 1.0) < _TOLERANCE for step in _DECIMAL_STEPS)


def origin_of(runs: Sequence[tuple[Array, Array | None]], *, plan: bool) -> Origin:
    """Origin of a motion from runs of positions (n, k), in the unit of the file, and measured torques (n, nv)."""
    if plan:
        return Origin.PLAN
    for _, tau in runs:
        torques_vary = tau is not None and bool((np.ptp(tau, axis=0) > 0.0).any())
        if torques_vary:
            return Origin.LOG
    coordinates_of_runs = [q.T for q, _ in runs]
    for positions_by_run in zip(*coordinates_of_runs, strict=True):  # of one coordinate after the other
        grid = quantum(list(positions_by_run))
        if is_encoder(grid):
            return Origin.LOG
    return Origin.EITHER


_MEDIAN_STEPS = 9
"""Number of steps in a running median."""
_MAX_PULSE = 5
"""Largest number of rows in a pulse, and of rows between two parts of it."""
_QUIET_STEPS = 5
"""Steps on either side of a pulse in which speeds are usual."""
_PULSE_DEPARTURE = 0.6
"""Departure from the median, relative to it, that makes a pulse of speeds."""
_CORNER_DEPARTURE = 4.0
"""Departure from the median, relative to it, that makes a pulse of changes of speed."""
_MAX_QUIET_DEPARTURE = 0.35
"""Largest departure beside a pulse, relative to that of the pulse."""
_NOISE_DEVIATIONS = 8.0
"""Departure in robust standard deviations above which it is not noise."""
_NOISE_QUANTILES = 4.0
"""Departure in 95 % quantiles above which it is not noise."""
_NOISE_GRID_STEPS = 3.0
"""Departure in least steps of the joint above which it is not rounding."""
_MIN_ROWS = 20
"""Minimum number of rows of a run."""
_MIN_ENCODER_STEPS = 3
"""Number of steps in which a joint moves, from which its least step is that of its encoder."""
_IMPOSSIBLE_TORQUE = 10.0
"""Multiple of a torque limit that no robot reaches: drives are stopped long before."""
_LONE_STEP = 10.0
"""Multiple of the 99 % quantile of a joint's steps from which a step is not a motion."""
_ADJACENT_STEP = 3.0
"""Multiple of the steps beside it from which a step is not a motion; also of the usual time step."""
SURROUNDINGS = 20
"""Rows on either side of a pulse in which the quintic spline oscillates by more than 1e-7 of the pulse."""


class Instant(NamedTuple):
    """Rows between which derived rates are not those of the robot's drives."""

    begin: float
    """Time of its first row [s]."""
    end: float
    """Time of its last row [s]."""
    joint: int
    """Entry of dq that departs most."""
    cause: InstantKind
    """Kind of event between the rows."""


class _Usual(NamedTuple):
    """Usual figures of each joint, (k,) each, and the usual time step."""

    step: float
    """Median time step [s]."""
    speed_departure: Array
    """Largest departure of a speed that noise and the motion itself may cause."""
    speed_noise: Array
    """Standard deviation of a speed in a usual step."""
    least_displacement: Array
    """Least displacement between two rows that differ."""
    encoder_step: Array
    """Least displacement, or 0 if too few rows differ to show that it is a step of the encoder."""
    large_displacement: Array
    """99 % quantile of displacements."""
    change_departure: Array
    """Largest departure of a change of speed that noise and the motion itself may cause."""


class RecordedSteps:
    """Steps of the positions of a motion, added in overlapping runs of rows."""

    def __init__(self, coordinates: Coordinates, runs: Sequence[tuple[Array, Array]]) -> None:
        """Learn usual steps from excerpts ``runs``: times (n,) and coordinates (n, nq)."""
        self.joints = np.flatnonzero(coordinates.position_of >= 0)
        """Entries of dq with one coordinate of q, as other joints' velocities are not differences of positions."""
        self._q_entries = coordinates.position_of[self.joints]
        self._names = coordinates.velocity_names
        self._is_angular = coordinates.angular_velocity
        self._is_angle = coordinates.angular[self._q_entries]
        joint_count = len(self.joints)
        self.instants: list[Instant] = []
        """Rows that are missing, repeated or wrong, and corners of the path."""
        no_values = np.zeros((0, joint_count))
        no_rows = Extrema.from_rows(np.zeros(0), no_values, no_values)
        self.fastest = no_rows
        """Speeds of single steps, less noise."""
        self.lone = no_rows
        """Displacements of lone steps."""
        self._usual: _Usual | None = None
        if joint_count:
            self._usual = self._learn(runs)

    def _curves(self, q: Array) -> Array:
        """Positions (n, k) of the joints, without jumps by a turn."""
        curves = q[:, self._q_entries]
        curves[:, self._is_angle] = np.unwrap(curves[:, self._is_angle], axis=0)
        return curves

    def _learn(self, runs: Sequence[tuple[Array, Array]]) -> _Usual | None:
        """Usual figures of runs of times (n,) and coordinates (n, nq); None if all are too short."""
        all_h = []
        all_distances = []
        all_departures = []
        all_change_departures = []
        for t, q in runs:
            if len(t) < _MIN_ROWS:
                continue
            h = np.diff(t)
            displacement = np.diff(self._curves(q), axis=0)
            speeds = displacement / h[:, None]
            all_h.append(h)
            all_distances.append(np.abs(displacement))
            all_departures.append(np.abs(_departures(speeds)))
            changes_of_speed = np.diff(speeds, axis=0)
            all_change_departures.append(np.abs(_departures(changes_of_speed)))
        if not all_h:
            return None
        step = float(np.median(np.concatenate(all_h)))
        distances = np.concatenate(all_distances)
        departures = np.concatenate(all_departures)
        moves = distances > 0.0
        least_displacement = np.where(moves, distances, np.inf).min(axis=0)  # inf for a joint that never moves
        least_displacement = np.where(np.isfinite(least_displacement), least_displacement, 0.0)
        has_encoder_step = moves.sum(axis=0) >= _MIN_ENCODER_STEPS
        change_departures = np.concatenate(all_change_departures)
        rounding = _NOISE_GRID_STEPS * least_displacement / step
        return _Usual(
            step=step,
            speed_departure=np.maximum(_noise_bound(departures), rounding),
            speed_noise=MAD * np.median(departures, axis=0),
            least_displacement=least_displacement,
            encoder_step=np.where(has_encoder_step, least_displacement, 0.0),
            large_displacement=np.quantile(distances, 0.99, axis=0),
            change_departure=np.maximum(_noise_bound(change_departures), rounding),
        )

    def add(self, t: Array, q: Array, inner: slice | None = None) -> None:
        """Add times (n,) and coordinates (n, nq) of a run.

        ``inner``: rows of the run itself, None for all. The other rows only surround them, and are added with other runs.
        """
        usual = self._usual
        if usual is None or len(t) < 2:
            return
        if inner is None:
            inner = slice(0, len(t))
        own_steps = slice(inner.start, min(inner.stop, len(t) - 1))
        if own_steps.stop <= own_steps.start:
            return
        h = np.diff(t)
        displacement = np.diff(self._curves(q), axis=0)
        distance = np.abs(displacement)
        duration = np.maximum(h, usual.step)[:, None]  # a time stamp that is too early does not make a large speed
        distance_beyond_rounding = np.maximum(distance - _NOISE_GRID_STEPS * usual.encoder_step, 0.0)
        speed_beyond_noise = distance_beyond_rounding / duration - _NOISE_DEVIATIONS * usual.speed_noise
        signed_speed = displacement[own_steps] / duration[own_steps]
        fastest = Extrema.from_rows(t[own_steps], speed_beyond_noise[own_steps], signed_speed)
        self.fastest = Extrema.merge([self.fastest, fastest])
        # The larger distance of the step before and the step after; there is no step beyond either end.
        padded = np.pad(distance, ((1, 1), (0, 0)))
        adjacent_distance = np.maximum(padded[:-2], padded[2:])
        noise = _NOISE_DEVIATIONS * usual.speed_noise * h[:, None]
        rounding = _NOISE_GRID_STEPS * usual.least_displacement
        is_lone = distance > _LONE_STEP * usual.large_displacement
        is_lone &= distance > _ADJACENT_STEP * adjacent_distance
        is_lone &= distance > np.maximum(rounding, noise)
        is_lone &= (h < _ADJACENT_STEP * usual.step)[:, None]  # after a pause, a large step is a motion
        lone_distance = np.where(is_lone, distance, 0.0)
        lone = Extrema.from_rows(t[own_steps], lone_distance[own_steps], displacement[own_steps])
        self.lone = Extrema.merge([self.lone, lone])
        if len(t) >= _MIN_ROWS:
            self._add_instants(t, displacement, own_steps)

    def _add_instants(self, t: Array, displacement: Array, own_steps: slice) -> None:
        """Add pulses and corners of the speeds, from the rows' times t (n,) and the steps' displacements (n - 1, k)."""
        assert self._usual is not None
        v = displacement / np.diff(t)[:, None]
        departure = _departures(displacement)
        # A usual displacement with a wrong time stamp makes a pulse of speed, but is not a wrong row.
        median_displacement = displacement - departure
        is_jump = np.abs(departure) > _PULSE_DEPARTURE * np.abs(median_displacement)
        pulses = []
        for first, last, k in _pulses(v, self._usual.speed_departure, _PULSE_DEPARTURE, own_steps):
            if is_jump[first : last + 1, k].any() and _is_abrupt(v[:, k], first, last):
                pulses.append((first, last, k))
        for first, last, k in pulses:
            is_still = v[:, k] == 0.0
            # Repeated rows before the pulse belong to it, unless the joint has stood from the beginning.
            while first > 0 and is_still[first - 1] and not is_still[: first - 1].all():
                first -= 1
            self.instants.append(Instant(float(t[first]), float(t[last + 1]), int(self.joints[k]), InstantKind.ROWS))
        # Step i has entry i + 1, as the robot counts as standing before the first and after the last step.
        all_stand = np.pad((v == 0.0).all(axis=1), 1, constant_values=True)
        for first, last, k in self._corners(v, own_steps):
            is_near_pulse = any(begin - _MAX_PULSE <= first <= end + _MAX_PULSE for begin, end, _ in pulses)
            if is_near_pulse:
                continue
            # Change i is that from step i to step i + 1; three steps on either side of the corner are asked.
            stand_before = all_stand[max(0, first - 1) : first + 2].all()
            stand_after = all_stand[last + 2 : last + 5].all()
            cause = InstantKind.FREEZE if stand_before or stand_after else InstantKind.IMPACT
            self.instants.append(Instant(float(t[first]), float(t[last + 2]), int(self.joints[k]), cause))

    def _corners(self, v: Array, own_steps: slice) -> Iterator[tuple[int, int, int]]:
        """First and last entry of ``np.diff(v)``, and column of v (n, k), of each pulse of changes of speed."""
        assert self._usual is not None
        changes = np.diff(v, axis=0)
        usual_departure = self._usual.change_departure
        largest_changes = np.abs(changes).max(axis=0)
        columns_with_large_changes = np.flatnonzero(largest_changes > usual_departure)
        for k in columns_with_large_changes.tolist():  # each joint by itself, as an impact may last longer in others
            column = slice(k, k + 1)
            pulses = _pulses(changes[:, column], usual_departure[column], _CORNER_DEPARTURE, own_steps, split=True)
            for first, last, _ in pulses:
                yield first, last, k

    def doubts(self, limits: Limits | None, origin: Origin, others: Iterable[Doubt] = ()) -> list[Doubt]:
        """Doubts about steps that no robot makes, by limits of a file or a table.

        Plans have none. A log has none if one of the ``others`` refuses it: that doubt, about units or turns, explains the
        steps.
        """
        if origin is Origin.PLAN or self._usual is None:
            return []
        if any(other.refuses for other in others):
            return []
        velocity_limit = np.full(len(self.joints), np.inf)
        if limits is not None:
            velocity_limit = credible_velocities(limits)[self.joints]
        has_limit = np.isfinite(velocity_limit)
        divisor = np.where(has_limit, velocity_limit, 1.0)
        share = np.where(has_limit, self.fastest.value / divisor, 0.0)
        if share.max(initial=0.0) > TOO_FAST:
            return [self._speed_doubt(int(share.argmax()), share, velocity_limit, origin)]
        # a joint with a limit is judged by its speed alone
        lone_distance = np.where(~has_limit, self.lone.value, 0.0)
        if lone_distance.max(initial=0.0) > 0.0:
            return [self._lone_step_doubt(int(lone_distance.argmax()), lone_distance, origin)]
        return []

    def _speed_doubt(self, k: int, share: Array, velocity_limit: Array, origin: Origin) -> Doubt:
        """Doubt about the joint ``joints[k]``; ``share``: speeds of single steps as shares of the limits."""
        joint = int(self.joints[k])
        words: dict[str, Any] = {
            "joint": self._names[joint],
            "speed": number(abs(float(self.fastest.signed[k])), 3),
            "unit": unit_of("dq", bool(self._is_angular[joint])),
            "times": number(float(share[k]), 2),
            "limit": number(float(velocity_limit[k]), 4),
            "time": seconds(float(self.fastest.time[k])),
        }
        return doubt("impossible-speed", [self._names[joint]], level=origin.level, **words)

    def _lone_step_doubt(self, k: int, lone_distance: Array, origin: Origin) -> Doubt:
        """Doubt about a lone step of the joint ``joints[k]``."""
        assert self._usual is not None
        joint = int(self.joints[k])
        words: dict[str, Any] = {
            "joint": self._names[joint],
            "size": number(float(lone_distance[k]), 3),
            "unit": unit_of("q", bool(self._is_angular[joint])),
            "usual": number(float(self._usual.large_displacement[k]), 2),
            "time": seconds(float(self.lone.time[k])),
        }
        return doubt("lone-step", [self._names[joint]], level=origin.level, **words)


def _noise_bound(departures: Array) -> Array:
    """Size (k,) of a departure above which neither noise nor the motion explains it, from departures (n, k)."""
    by_median = _NOISE_DEVIATIONS * MAD * np.median(departures, axis=0)
    by_quantile = _NOISE_QUANTILES * np.quantile(departures, 0.95, axis=0)
    return np.asarray(np.maximum(by_median, by_quantile))


def _pulses(
    x: Array, min_departure: Array, min_share: float, own_rows: slice, *, split: bool = False
) -> Iterator[tuple[int, int, int]]:
    """First row, last row and column of the pulses of x (n, k), of a few rows in quiet surroundings.

    A pulse departs from the running median by more than ``min_departure`` (k,), and by more than ``min_share`` times the
    median. It begins within ``own_rows``. ``split``: the row beside it may have a part of it, as an impact between two
    rows changes the speed in both.
    """
    departure = _departures(x)
    size = np.abs(departure)
    median_size = np.abs(x - departure)
    is_large = size > np.maximum(min_share * median_size, min_departure)
    large_rows = np.flatnonzero(is_large.any(axis=1))
    ends_of_runs = np.flatnonzero(np.diff(large_rows) > _MAX_PULSE)
    for run in np.split(large_rows, ends_of_runs + 1):
        if not run.size:  # no row is large
            continue
        first = int(run[0])
        last = int(run[-1])
        is_own = own_rows.start <= first < own_rows.stop
        is_long = last - first >= _MAX_PULSE
        if not is_own or is_long:
            continue
        relative_size = size[first : last + 1] / np.maximum(min_departure, _MIN_DIVISOR)
        largest_of_columns = relative_size.max(axis=0)
        k = int(np.argmax(largest_of_columns))
        # a row beside it has a part of the pulse if it departs with the same sign
        if split and first > 0 and departure[first - 1, k] * departure[first, k] > 0.0:
            first -= 1
        if split and last + 1 < len(size) and departure[last + 1, k] * departure[last, k] > 0.0:
            last += 1
        sizes_before = size[max(0, first - _QUIET_STEPS) : first, k]
        sizes_after = size[last + 1 : last + 1 + _QUIET_STEPS, k]
        largest_beside = np.concatenate([sizes_before, sizes_after]).max(initial=0.0)
        size_of_pulse = size[first : last + 1, k].max()
        if largest_beside <= _MAX_QUIET_DEPARTURE * size_of_pulse:
            yield first, last, k


def _is_abrupt(v: Array, first: int, last: int) -> bool:
    """True if the speed v (n,) changes more where the pulse begins and ends than beside it; a brief stop is smooth."""
    changes = np.abs(np.diff(v))
    first_change = max(0, first - 1)
    changes_before = changes[max(0, first_change - _QUIET_STEPS) : first_change]
    changes_after = changes[last + 1 : last + 1 + _QUIET_STEPS]
    largest_beside = np.concatenate([changes_before, changes_after]).max(initial=0.0)
    largest_of_pulse = changes[first_change : last + 1].max(initial=0.0)
    return bool(largest_of_pulse > largest_beside)


_MIN_DIVISOR = 1e-300
"""Divisor in place of zero."""


def _departures(v: Array) -> Array:
    """Departures of speeds (n, k) from their running medians.

    Before the first row, v is continued along the line through its second and sixth row, and likewise after the last.
    A wrong first or last row does not change this line, so that this row departs too.
    """
    half_window = _MEDIAN_STEPS // 2
    steps_from_second = np.arange(2, half_window + 2)[:, None]

    def extrapolate(w: Array) -> Array:
        """Continue w before its first row, nearest row first."""
        slope = (w[1] - w[1 + half_window]) / half_window
        return w[1] + slope * steps_from_second

    rows_before = extrapolate(v)[::-1]
    rows_after = extrapolate(v[::-1])
    continued = np.concatenate([rows_before, v, rows_after])
    # scipy.ndimage has a running median too, and takes 0.1 s to import.
    windows = np.lib.stride_tricks.sliding_window_view(continued, _MEDIAN_STEPS, axis=0)
    sorted_about_middle = np.partition(windows, half_window, axis=-1)
    medians = sorted_about_middle[..., half_window]
    return np.asarray(v - medians)


@dataclass(frozen=True, eq=False)
class DoubtfulSpans:
    """Spans around instants with rows that are missing, repeated or wrong."""

    instants: tuple[Instant, ...] = ()
    reach: float = 0.0
    """Time [s] on either side of an instant to which it changes derived rates."""

    def __bool__(self) -> bool:
        return bool(self.instants)

    def within(self, time: Array) -> Array:
        """Mask (n,) of times within a span."""
        time = np.asarray(time, float)
        is_within = np.zeros(time.shape, bool)
        for instant in self.instants:
            is_within |= (time >= instant.begin - self.reach) & (time <= instant.end + self.reach)
        return is_within

    def _spans_any(self, instant: Instant, times: Sequence[float]) -> bool:
        """True if one of the times is within the span of the instant."""
        return any(instant.begin - self.reach <= t <= instant.end + self.reach for t in times)

    def doubt_at(self, times: Sequence[float]) -> Doubt:
        """Doubt about the instants whose spans contain one of the times; about all instants if no span does.

        It is about instants of one kind: impacts only if there are no others.
        """
        instants = [instant for instant in self.instants if self._spans_any(instant, times)]
        if not instants:
            instants = list(self.instants)
        order_of_kinds = list(InstantKind)
        cause = min((instant.cause for instant in instants), key=order_of_kinds.index)
        time_texts = [f"{seconds(instant.begin, 4)} s" for instant in instants if instant.cause is cause]
        different_times = dict.fromkeys(time_texts)
        when = listed(different_times, _MAX_LISTED_TIMES)
        if cause is InstantKind.IMPACT:
            return doubt("impact", when=when)
        return doubt("doubtful-rows", when=when)


_MAX_LISTED_TIMES = 3
"""Number of times that a message names."""


def doubtful_spans(instants: Iterable[Instant], step: float, origin: Origin, rows: int = SURROUNDINGS) -> DoubtfulSpans:
    """Spans of ``rows`` usual time steps on either side of the instants.

    A plan has none. Impacts count only in a log.
    """
    causes = _DOUBTFUL_CAUSES[origin]
    doubtful_instants = sorted(instant for instant in instants if instant.cause in causes)
    return DoubtfulSpans(tuple(doubtful_instants), rows * step)


_DOUBTFUL_CAUSES: dict[Origin, tuple[InstantKind, ...]] = {
    Origin.PLAN: (),
    Origin.LOG: tuple(InstantKind),
    Origin.EITHER: (InstantKind.ROWS, InstantKind.FREEZE),
}
"""Kinds of instants near which figures of a motion are doubted, by its origin."""


def impossible_torque(robot: Robot, torques: Extrema, origin: Origin, corners: DoubtfulSpans) -> Doubt | None:
    """Doubt about a motion with a torque that no drive of the robot reaches; None if there is none.

    ``torques``: (nv,), without payloads and wrenches. At one of the ``corners`` an impact may make the torque, and no drive.
    """
    # a quick test first: credible limits are never below the robot's
    if origin is Origin.PLAN or not (torques.value > _IMPOSSIBLE_TORQUE * robot.limits.effort).any():
        return None
    model = robot.model
    torque_limit = credible_efforts(robot)
    has_limit = torque_limit < np.inf
    divisor = np.where(has_limit, torque_limit, 1.0)
    share = np.where(has_limit, torques.value / divisor, 0.0)
    k = int(share.argmax())
    if not share[k] > _IMPOSSIBLE_TORQUE:
        return None
    time = float(torques.time[k])
    is_at_corner = corners.within(np.array(time))
    if is_at_corner:
        return corners.doubt_at([time])
    words: dict[str, Any] = {
        "joint": model.drive_labels[k],
        "times": number(float(share[k]), 3),
        "limit": number(float(torque_limit[k])),
        "unit": unit_of("tau", drive_turns(model)[k]),
        "time": seconds(time),
    }
    return doubt("impossible-torque", [model.drive_labels[k]], level=origin.level, **words)
