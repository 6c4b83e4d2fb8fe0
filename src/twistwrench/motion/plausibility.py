"""Motions that no robot makes: rows that are missing, repeated or wrong, and speeds and torques far beyond the limits.

Let v_ij = (q_j(i+1) - q_j(i)) / h_i be the speed of joint j in step i, and m_ij its running median over nine steps. The median
follows edges: at an impact, a stop or a start, v stays at its median. A row that is missing, repeated or wrong makes a pulse of
v, of at most four steps, so that v leaves its median and returns. No motor makes such a pulse, as it takes an acceleration and
the opposite one within a few rows; a joint that does was sampled too slowly, and its derived torque is unknown as well.

A log is judged as it was recorded, without payloads and wrenches that a user asks about. Velocity limits of a table that names
their unit are such a question too; others replace those of the file, as the same numbers have the same word.
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

    @property
    def level(self) -> Level:
        """Level of a doubt about a motion that no robot makes."""
        return "refuse" if self is Origin.LOG else "unsure"


class InstantKind(StrEnum):
    """Cause of rates that no drive makes."""

    ROWS = "rows"
    """A pulse of speed: rows are missing, repeated or wrong."""
    FREEZE = "freeze"
    """A moving robot stands from one row to the next, and its positions repeat exactly."""
    IMPACT = "impact"
    """A corner of the path: the speed changes from one row to the next, as in an impact."""


_DECIMALS = (1.0, 2.0, 5.0, 10.0)
_TOLERANCE = 1e-6
"""Relative tolerance of equal numbers that were printed."""


def is_encoder(grid: float) -> bool:
    """True if a grid is that of an encoder, and not of printed decimals.

    >>> is_encoder(6.283185307 / 4096), is_encoder(0.001), is_encoder(0.0)
    (True, False, False)
    """
    if not grid > 0.0:
        return False
    mantissa = grid / 10.0 ** np.floor(np.log10(grid * (1.0 + _TOLERANCE)))
    return not any(abs(mantissa / decimal - 1.0) < _TOLERANCE for decimal in _DECIMALS)


def origin_of(runs: Sequence[tuple[Array, Array | None]], *, plan: bool) -> Origin:
    """Origin of a motion from runs of positions (n, k), in the unit of the file, and measured torques (n, nv)."""
    if plan:
        return Origin.PLAN
    if any(tau is not None and (np.ptp(tau, axis=0) > 0.0).any() for _, tau in runs):
        return Origin.LOG
    for parts in zip(*[q.T for q, _ in runs], strict=True):
        if is_encoder(quantum(list(parts))):
            return Origin.LOG
    return Origin.EITHER


_WINDOW, _MAX_PULSE, _QUIET_STEPS = 9, 5, 5
"""Steps of the running median, longest pulse, and steps on either side of it in which speeds are usual."""
_PULSE_DEPARTURE, _CORNER_DEPARTURE, _MAX_QUIET_DEPARTURE = 0.6, 4.0, 0.35
"""Departure from the median, relative to it, that makes a pulse of speeds, and of accelerations; and largest relative departure
beside a pulse."""
_MADS, _TAIL, _GRIDS = 8.0, 4.0, 3.0
"""Departure in robust deviations, in 95 % quantiles, and in least steps of the joint, above which it is not noise."""
_MIN_ROWS = 20
"""Minimum number of rows."""
_MIN_ENCODER_STEPS = 3
"""Steps of a joint from which its least step is that of its encoder."""
_IMPOSSIBLE_TORQUE = 10.0
"""Multiple of a torque limit that no robot reaches: drives are stopped long before."""
_LONE_STEP, _ADJACENT_STEP = 10.0, 3.0
"""Multiple of a joint's own 99 % step, and of the steps beside it, from which a step is not a motion."""
SURROUNDINGS = 20
"""Rows on either side of a pulse in which the quintic spline rings by more than 1e-7 of it."""


class Instant(NamedTuple):
    """Rows between which derived rates are not those of the robot's drives."""

    begin: float
    """Time of its first row [s]."""
    end: float
    """Time of its last row [s]."""
    joint: int
    """Entry of dq that departs most."""
    cause: InstantKind
    """Rows, freeze or impact."""


class _Usual(NamedTuple):
    """Usual figures of each joint, (k,) each, and the usual time step."""

    step: float
    departure: Array
    """Departure of a speed that noise and the motion itself may cause."""
    noise: Array
    """Noise of a speed in a usual step."""
    grid: Array
    """Least displacement between two rows."""
    encoder: Array
    """Least displacement, or 0 if too few rows differ to show that it is a step of the encoder."""
    most: Array
    """99 % quantile of displacements."""
    change: Array
    """Departure of a change of speed that noise and the motion itself may cause."""


class RecordedSteps:
    """Steps of the positions of a motion, added in overlapping runs of rows."""

    def __init__(self, coordinates: Coordinates, runs: Sequence[tuple[Array, Array]]) -> None:
        """Learn usual steps from excerpts ``runs``: times (n,) and coordinates (n, nq)."""
        self.joints = np.flatnonzero(coordinates.position_of >= 0)
        self._places = coordinates.position_of[self.joints]
        self._names, self._turns = coordinates.velocity_names, coordinates.angular_velocity
        self._angles = coordinates.angular[self._places]
        count = len(self.joints)
        self.instants: list[Instant] = []
        """Rows that are missing, repeated or wrong, and corners of the path."""
        self.fastest = self.lone = Extrema.from_rows(np.zeros(0), *np.zeros((2, 0, count)))
        """Speeds of single steps, less noise; and lone displacements."""
        self._usual: _Usual | None = None
        if count:
            self._usual = self._learn(runs)

    def _curves(self, q: Array) -> Array:
        curves = q[:, self._places]
        curves[:, self._angles] = np.unwrap(curves[:, self._angles], axis=0)
        return curves

    def _learn(self, runs: Sequence[tuple[Array, Array]]) -> _Usual | None:
        durations, displacements, departures, changes = [], [], [], []
        for t, q in runs:
            if len(t) < _MIN_ROWS:
                continue
            h, moved = np.diff(t), np.diff(self._curves(q), axis=0)
            speeds = moved / h[:, None]
            durations.append(h)
            displacements.append(np.abs(moved))
            departures.append(np.abs(_departures(speeds)))
            changes.append(np.abs(_departures(np.diff(speeds, axis=0))))
        if not durations:
            return None
        step = float(np.median(np.concatenate(durations)))
        size, departure = np.concatenate(displacements), np.concatenate(departures)
        grid = np.where(size > 0.0, size, np.inf).min(axis=0)
        grid = np.where(np.isfinite(grid), grid, 0.0)
        rounding = _GRIDS * grid / step
        return _Usual(
            step=step,
            departure=np.maximum(_usual_bound(departure), rounding),
            noise=MAD * np.median(departure, axis=0),
            grid=grid,
            encoder=np.where((size > 0.0).sum(axis=0) >= _MIN_ENCODER_STEPS, grid, 0.0),
            most=np.quantile(size, 0.99, axis=0),
            change=np.maximum(_usual_bound(np.concatenate(changes)), rounding),
        )

    def add(self, t: Array, q: Array, inner: slice | None = None) -> None:
        """Add times (n,) and coordinates (n, nq); rows outside ``inner`` belong to other runs and are only looked at."""
        usual = self._usual
        if usual is None or len(t) < 2:
            return
        inner = inner or slice(0, len(t))
        own = slice(inner.start, min(inner.stop, len(t) - 1))
        if own.stop <= own.start:
            return
        h, moved = np.diff(t), np.diff(self._curves(q), axis=0)
        size = np.abs(moved)
        duration = np.maximum(h, usual.step)[:, None]
        speed = np.maximum(size - _GRIDS * usual.encoder, 0.0) / duration - _MADS * usual.noise
        fastest = Extrema.from_rows(t[own], speed[own], moved[own] / duration[own])
        self.fastest = Extrema.merge([self.fastest, fastest])
        padded = np.pad(size, ((1, 1), (0, 0)))
        adjacent = np.maximum(padded[:-2], padded[2:])
        is_lone = (size > _LONE_STEP * usual.most) & (size > _ADJACENT_STEP * adjacent)
        is_lone &= size > np.maximum(_GRIDS * usual.grid, _MADS * usual.noise * h[:, None])
        is_lone &= (h < _ADJACENT_STEP * usual.step)[:, None]
        lone = Extrema.from_rows(t[own], np.where(is_lone, size, 0.0)[own], moved[own])
        self.lone = Extrema.merge([self.lone, lone])
        if len(t) >= _MIN_ROWS:
            self._add_instants(t, moved, own)

    def _add_instants(self, t: Array, moved: Array, own: slice) -> None:
        """Add pulses and corners of the speeds of the steps ``moved`` (n - 1, k) from the rows at t (n,)."""
        assert self._usual is not None
        v = moved / np.diff(t)[:, None]
        departure = _departures(moved)
        # A step as usual with a wrong stamp is not a wrong row.
        jumps = np.abs(departure) > _PULSE_DEPARTURE * np.abs(moved - departure)
        pulses = []
        for first, last, k in _pulses(v, self._usual.departure, _PULSE_DEPARTURE, own):
            if jumps[first : last + 1, k].any() and _is_abrupt(v[:, k], first, last):
                pulses.append((first, last, k))
        for first, last, k in pulses:
            still = v[:, k] == 0.0
            while first > 0 and still[first - 1] and not still[: first - 1].all():
                first -= 1
            self.instants.append(Instant(float(t[first]), float(t[last + 1]), int(self.joints[k]), InstantKind.ROWS))
        stands = np.pad((v == 0.0).all(axis=1), 1, constant_values=True)
        for first, last, k in self._corners(v, own):
            if any(begin - _MAX_PULSE <= first <= end + _MAX_PULSE for begin, end, _ in pulses):
                continue
            before, after = stands[max(0, first - 1) : first + 2], stands[last + 2 : last + 5]
            cause = InstantKind.FREEZE if before.all() or after.all() else InstantKind.IMPACT
            self.instants.append(Instant(float(t[first]), float(t[last + 2]), int(self.joints[k]), cause))

    def _corners(self, v: Array, own: slice) -> Iterator[tuple[int, int, int]]:
        """First row, last row and joint of the pulses of changes of the speeds v (n, k)."""
        assert self._usual is not None
        changes, usual = np.diff(v, axis=0), self._usual.change
        for k in np.flatnonzero(np.abs(changes).max(axis=0) > usual).tolist():
            column = slice(k, k + 1)
            for first, last, _ in _pulses(changes[:, column], usual[column], _CORNER_DEPARTURE, own, split=True):
                yield first, last, k

    def doubts(self, limits: Limits | None, origin: Origin, others: Iterable[Doubt] = ()) -> list[Doubt]:
        """Doubts about steps that no robot makes, by limits of a file or a table.

        Plans have none, and neither have logs that one of the ``others`` refuses: its units or turns explain the steps.
        """
        if origin is Origin.PLAN or self._usual is None or any(other.refuses for other in others):
            return []
        velocity = np.full(len(self.joints), np.inf)
        if limits is not None:
            velocity = credible_velocities(limits)[self.joints]
        known = np.isfinite(velocity)
        share = np.where(known, self.fastest.value / np.where(known, velocity, 1.0), 0.0)
        if share.max(initial=0.0) > TOO_FAST:
            return [self._speed_doubt(int(share.argmax()), share, velocity, origin)]
        lone = np.where(~known, self.lone.value, 0.0)
        if lone.max(initial=0.0) > 0.0:
            return [self._lone_step_doubt(int(lone.argmax()), lone, origin)]
        return []

    def _speed_doubt(self, k: int, share: Array, velocity: Array, origin: Origin) -> Doubt:
        joint = int(self.joints[k])
        words: dict[str, Any] = {
            "joint": self._names[joint],
            "speed": number(abs(float(self.fastest.signed[k])), 3),
            "unit": unit_of("dq", bool(self._turns[joint])),
            "times": number(float(share[k]), 2),
            "limit": number(float(velocity[k]), 4),
            "time": seconds(float(self.fastest.time[k])),
        }
        return doubt("impossible-speed", [self._names[joint]], level=origin.level, **words)

    def _lone_step_doubt(self, k: int, lone: Array, origin: Origin) -> Doubt:
        joint, usual = int(self.joints[k]), self._usual
        assert usual is not None
        words: dict[str, Any] = {
            "joint": self._names[joint],
            "size": number(float(lone[k]), 3),
            "unit": unit_of("q", bool(self._turns[joint])),
            "usual": number(float(usual.most[k]), 2),
            "time": seconds(float(self.lone.time[k])),
        }
        return doubt("lone-step", [self._names[joint]], level=origin.level, **words)


def _usual_bound(departures: Array) -> Array:
    """Magnitude (k,) of departures (n, k) above which they are not those of noise and of the motion itself."""
    by_median = _MADS * MAD * np.median(departures, axis=0)
    return np.asarray(np.maximum(by_median, _TAIL * np.quantile(departures, 0.95, axis=0)))


def _pulses(
    x: Array, least: Array, relative: float, own: slice, *, split: bool = False
) -> Iterator[tuple[int, int, int]]:
    """First row, last row and column of the pulses of x (n, k), of a few rows in quiet surroundings.

    A pulse departs from the running median by more than ``least`` (k,), and by more than ``relative`` times the median.
    ``split``: the row beside it may have a part of it, as an impact between two rows changes the speed in both.
    """
    departure = _departures(x)
    size = np.abs(departure)
    is_large = size > np.maximum(relative * np.abs(x - departure), least)
    rows = np.flatnonzero(is_large.any(axis=1))
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > _MAX_PULSE) + 1):
        if not run.size or not own.start <= run[0] < own.stop or run[-1] - run[0] >= _MAX_PULSE:
            continue
        first, last = int(run[0]), int(run[-1])
        k = int(np.argmax((size[first : last + 1] / np.maximum(least, _MIN_DIVISOR)).max(axis=0)))
        if split and first > 0 and departure[first - 1, k] * departure[first, k] > 0.0:
            first -= 1
        if split and last + 1 < len(size) and departure[last + 1, k] * departure[last, k] > 0.0:
            last += 1
        before, after = size[max(0, first - _QUIET_STEPS) : first, k], size[last + 1 : last + 1 + _QUIET_STEPS, k]
        largest_beside = np.concatenate([before, after]).max(initial=0.0)
        if largest_beside <= _MAX_QUIET_DEPARTURE * size[first : last + 1, k].max():
            yield first, last, k


def _is_abrupt(v: Array, first: int, last: int) -> bool:
    """True if the speed v (n,) changes more where the pulse begins and ends than beside it; a brief stop is smooth."""
    changes = np.abs(np.diff(v))
    begin = max(0, first - 1)
    before, after = changes[max(0, begin - _QUIET_STEPS) : begin], changes[last + 1 : last + 1 + _QUIET_STEPS]
    largest_beside = np.concatenate([before, after]).max(initial=0.0)
    return bool(changes[begin : last + 1].max(initial=0.0) > largest_beside)


_MIN_DIVISOR = 1e-300
"""Divisor in place of zero."""


def _departures(v: Array) -> Array:
    """Departures of speeds (n, k) from their running medians, so that a wrong first or last row departs too.

    Beyond either end, v goes on along the line through its second and sixth value, whatever its last one is.
    """
    half = _WINDOW // 2
    steps_beyond = np.arange(2, half + 2)[:, None]

    def extrapolate(w: Array) -> Array:
        return w[1] + (w[1] - w[1 + half]) / half * steps_beyond

    before, after = extrapolate(v), extrapolate(v[::-1])
    # scipy.ndimage has a running median too, and takes 0.1 s to import.
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([before[::-1], v, after]), _WINDOW, axis=0)
    return np.asarray(v - np.partition(windows, half, axis=-1)[..., half])


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
        return any(instant.begin - self.reach <= t <= instant.end + self.reach for t in times)

    def doubt_at(self, times: Sequence[float]) -> Doubt:
        """Doubt about the instants at which the figures of these times stand; impacts only if there are no others."""
        nearby = [instant for instant in self.instants if self._spans_any(instant, times)]
        instants = nearby or list(self.instants)
        cause = min((instant.cause for instant in instants), key=list(InstantKind).index)
        begins = [instant.begin for instant in instants if instant.cause is cause]
        when = listed(dict.fromkeys(f"{seconds(begin, 4)} s" for begin in begins), _MAX_LISTED_TIMES)
        return doubt("impact" if cause is InstantKind.IMPACT else "doubtful-rows", when=when)


_MAX_LISTED_TIMES = 3


def doubtful_spans(instants: Iterable[Instant], step: float, origin: Origin, rows: int = SURROUNDINGS) -> DoubtfulSpans:
    """Spans of ``rows`` usual steps on either side of the instants; a plan has none, and corners only if it is a log."""
    causes = _DOUBTFUL_CAUSES[origin]
    doubtful = sorted(instant for instant in instants if instant.cause in causes)
    return DoubtfulSpans(tuple(doubtful), rows * step)


_DOUBTFUL_CAUSES: dict[Origin, tuple[InstantKind, ...]] = {
    Origin.PLAN: (),
    Origin.LOG: tuple(InstantKind),
    Origin.EITHER: (InstantKind.ROWS, InstantKind.FREEZE),
}
"""Kinds of instants near which figures of a motion are doubted, by its origin."""


def impossible_torque(robot: Robot, alone: Extrema, origin: Origin, corners: DoubtfulSpans) -> Doubt | None:
    """Doubt about a motion whose torques ``alone`` (nv,), without payloads and wrenches, no drive of the robot reaches.

    At one of the ``corners`` the torque may be that of an impact, which is not a drive's.
    """
    if origin is Origin.PLAN or not (alone.value > _IMPOSSIBLE_TORQUE * robot.limits.effort).any():
        return None
    effort, model = credible_efforts(robot), robot.model
    share = np.where(effort < np.inf, alone.value / np.where(effort < np.inf, effort, 1.0), 0.0)
    k = int(share.argmax())
    if not share[k] > _IMPOSSIBLE_TORQUE:
        return None
    time = float(alone.time[k])
    if corners.within(np.array(time)):
        return corners.doubt_at([time])
    words: dict[str, Any] = {
        "joint": model.drive_labels[k],
        "times": number(float(share[k]), 3),
        "limit": number(float(effort[k])),
        "unit": unit_of("tau", drive_turns(model)[k]),
        "time": seconds(time),
    }
    return doubt("impossible-torque", [model.drive_labels[k]], level=origin.level, **words)
