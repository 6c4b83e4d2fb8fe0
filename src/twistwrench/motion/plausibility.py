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
_NEAR = 1e-6


def is_encoder(grid: float) -> bool:
    """True if a grid is that of an encoder, and not of printed decimals.

    >>> is_encoder(6.283185307 / 4096), is_encoder(0.001), is_encoder(0.0)
    (True, False, False)
    """
    if not grid > 0.0:
        return False
    mantissa = grid / 10.0 ** np.floor(np.log10(grid * (1.0 + _NEAR)))
    return not any(abs(mantissa / decimal - 1.0) < _NEAR for decimal in _DECIMALS)


def origin_of(runs: Sequence[tuple[Array, Array | None]], *, plan: bool) -> Origin:
    """Origin of a motion from runs of positions (n, k), in the unit of the file, and measured torques (n, nv)."""
    if plan:
        return Origin.PLAN
    if any(tau is not None and (np.ptp(tau, axis=0) > 0.0).any() for _, tau in runs):
        return Origin.LOG
    columns = zip(*(q.T for q, _ in runs), strict=True)
    return Origin.LOG if any(is_encoder(quantum(list(parts))) for parts in columns) else Origin.EITHER


# ── Steps of a recording

_WINDOW, _PULSE, _QUIET = 9, 5, 5
"""Steps of the running median, longest pulse, and steps on either side of it in which speeds are usual."""
_OFF, _CORNER, _REST = 0.6, 4.0, 0.35
"""Departure from the median, relative to it, that makes a pulse of speeds, and of accelerations; and largest relative departure
beside a pulse."""
_MADS, _TAIL, _GRIDS = 8.0, 4.0, 3.0
"""Departure in robust deviations, in 95 % quantiles, and in least steps of the joint, above which it is not noise."""
_FEWEST = 20
"""Minimum number of rows."""
_LEAST_STEPS = 3
"""Steps of a joint from which its least step is that of its encoder."""
_TOO_STRONG = 10.0
"""Multiple of a torque limit that no robot reaches: drives are stopped long before."""
_LONE, _SHARED = 10.0, 3.0
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
        self._usual = self._learn(runs) if count else None

    def _curves(self, q: Array) -> Array:
        curves = q[:, self._places]
        curves[:, self._angles] = np.unwrap(curves[:, self._angles], axis=0)
        return curves

    def _learn(self, runs: Sequence[tuple[Array, Array]]) -> _Usual | None:
        found = [(np.diff(t), np.diff(self._curves(q), axis=0)) for t, q in runs if len(t) >= _FEWEST]
        if not found:
            return None
        h, moved = (np.concatenate(parts) for parts in zip(*found, strict=True))
        step = float(np.median(h))
        off = np.concatenate([np.abs(_departures(d / s[:, None])) for s, d in found])
        size = np.abs(moved)
        noise = MAD * np.median(off, axis=0)
        grid = np.where(size > 0.0, size, np.inf).min(axis=0)
        grid = np.where(np.isfinite(grid), grid, 0.0)
        encoder = np.where((size > 0.0).sum(axis=0) >= _LEAST_STEPS, grid, 0.0)
        changes = np.concatenate([np.abs(_departures(np.diff(d / s[:, None], axis=0))) for s, d in found])
        least, change = (
            np.maximum(_MADS * MAD * np.median(x, axis=0), _TAIL * np.quantile(x, 0.95, axis=0)) for x in (off, changes)
        )
        rounding = _GRIDS * grid / step
        most = np.quantile(size, 0.99, axis=0)
        return _Usual(step, np.maximum(least, rounding), noise, grid, encoder, most, np.maximum(change, rounding))

    def add(self, t: Array, q: Array, inner: slice | None = None) -> None:
        """Add times (n,) and coordinates (n, nq); rows outside ``inner`` belong to other runs and are only looked at."""
        u = self._usual
        if u is None or len(t) < 2:
            return
        inner = inner or slice(0, len(t))
        own = slice(inner.start, min(inner.stop, len(t) - 1))
        if own.stop <= own.start:
            return
        h, moved = np.diff(t), np.diff(self._curves(q), axis=0)
        size = np.abs(moved)
        slow = np.maximum(h, u.step)[:, None]
        speed = np.maximum(size - _GRIDS * u.encoder, 0.0) / slow - _MADS * u.noise
        fastest = Extrema.from_rows(t[own], speed[own], moved[own] / slow[own])
        self.fastest = Extrema.joined([self.fastest, fastest])
        beside = np.pad(size, ((1, 1), (0, 0)))
        shared = np.maximum(beside[:-2], beside[2:])
        alone = (size > _LONE * u.most) & (size > _SHARED * shared)
        alone &= size > np.maximum(_GRIDS * u.grid, _MADS * u.noise * h[:, None])
        alone &= (h < _SHARED * u.step)[:, None]
        lone = Extrema.from_rows(t[own], np.where(alone, size, 0.0)[own], moved[own])
        self.lone = Extrema.joined([self.lone, lone])
        if len(t) >= _FEWEST:
            self._look_for_instants(t, moved, own)

    def _look_for_instants(self, t: Array, moved: Array, own: slice) -> None:
        """Add pulses and corners of the speeds of the steps ``moved`` (n - 1, k) from the rows at t (n,)."""
        assert self._usual is not None
        v = moved / np.diff(t)[:, None]
        departed = _departures(moved)
        jumps = np.abs(departed) > _OFF * np.abs(
            moved - departed
        )  # a step as usual with a wrong stamp is not a wrong row
        pulses = [p for p in _pulses(v, self._usual.departure, _OFF, own) if jumps[p[0] : p[1] + 1, p[2]].any()]
        pulses = [p for p in pulses if _is_abrupt(v[:, p[2]], p[0], p[1])]
        for first, last, k in pulses:
            still = v[:, k] == 0.0
            while first > 0 and still[first - 1] and not still[: first - 1].all():
                first -= 1
            self.instants.append(Instant(float(t[first]), float(t[last + 1]), int(self.joints[k]), InstantKind.ROWS))
        stands = np.pad((v == 0.0).all(axis=1), 1, constant_values=True)
        changes = np.diff(v, axis=0)
        corners = (
            (first, last, int(k))
            for k in np.flatnonzero(np.abs(changes).max(axis=0) > self._usual.change)
            for first, last, _ in _pulses(
                changes[:, k : k + 1], self._usual.change[k : k + 1], _CORNER, own, split=True
            )
        )
        for first, last, k in corners:
            if any(a - _PULSE <= first <= b + _PULSE for a, b, _ in pulses):
                continue
            before, after = stands[max(0, first - 1) : first + 2], stands[last + 2 : last + 5]
            cause = InstantKind.FREEZE if before.all() or after.all() else InstantKind.IMPACT
            self.instants.append(Instant(float(t[first]), float(t[last + 2]), int(self.joints[k]), cause))

    def doubts(self, limits: Limits | None, origin: Origin, others: Iterable[Doubt] = ()) -> list[Doubt]:
        """Doubts about steps that no robot makes, by limits of a file or a table.

        Plans have none, and neither have logs that one of the ``others`` refuses: its units or turns explain the steps.
        """
        if origin is Origin.PLAN or self._usual is None or any(each.refuses for each in others):
            return []
        velocity = np.full(len(self.joints), np.inf) if limits is None else credible_velocities(limits)[self.joints]
        known = np.isfinite(velocity)
        share = np.where(known, self.fastest.value / np.where(known, velocity, 1.0), 0.0)
        if share.max(initial=0.0) > TOO_FAST:
            return [self._too_fast(int(share.argmax()), share, velocity, origin)]
        lone = np.where(~known, self.lone.value, 0.0)
        return [self._too_far(int(lone.argmax()), lone, origin)] if lone.max(initial=0.0) > 0.0 else []

    def _too_fast(self, k: int, share: Array, velocity: Array, origin: Origin) -> Doubt:
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

    def _too_far(self, k: int, lone: Array, origin: Origin) -> Doubt:
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


def _pulses(
    x: Array, least: Array, relative: float, own: slice, *, split: bool = False
) -> Iterator[tuple[int, int, int]]:
    """First row, last row and column of the pulses of x (n, k), of a few rows in quiet surroundings.

    A pulse departs from the running median by more than ``least`` (k,), and by more than ``relative`` times the median.
    ``split``: the row beside it may have a part of it, as an impact between two rows changes the speed in both.
    """
    departure = _departures(x)
    off = np.abs(departure)
    rows = np.flatnonzero((off > np.maximum(relative * np.abs(x - departure), least)).any(axis=1))
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > _PULSE) + 1):
        if not run.size or not own.start <= run[0] < own.stop or run[-1] - run[0] >= _PULSE:
            continue
        first, last = int(run[0]), int(run[-1])
        k = int(np.argmax((off[first : last + 1] / np.maximum(least, _TINY)).max(axis=0)))
        if split and first > 0 and departure[first - 1, k] * departure[first, k] > 0.0:
            first -= 1
        if split and last + 1 < len(off) and departure[last + 1, k] * departure[last, k] > 0.0:
            last += 1
        beside = np.concatenate([off[max(0, first - _QUIET) : first, k], off[last + 1 : last + 1 + _QUIET, k]])
        if beside.max(initial=0.0) <= _REST * off[first : last + 1, k].max():
            yield first, last, k


def _is_abrupt(v: Array, first: int, last: int) -> bool:
    """True if the speed v (n,) changes more where the pulse begins and ends than beside it; a brief stop is smooth."""
    changes = np.abs(np.diff(v))
    begin = max(0, first - 1)
    beside = np.concatenate([changes[max(0, begin - _QUIET) : begin], changes[last + 1 : last + 1 + _QUIET]])
    return bool(changes[begin : last + 1].max(initial=0.0) > beside.max(initial=0.0))


_TINY = 1e-300


def _departures(v: Array) -> Array:
    """Departures of speeds (n, k) from their running medians, so that a wrong first or last row departs too.

    Beyond either end, v goes on along the line through its second and sixth value, whatever its last one is.
    """
    half = _WINDOW // 2
    ahead = np.arange(2, half + 2)[:, None]
    before, after = (w[1] + (w[1] - w[1 + half]) / half * ahead for w in (v, v[::-1]))
    # scipy.ndimage has a running median too, and takes 0.1 s to import.
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([before[::-1], v, after]), _WINDOW, axis=0)
    return np.asarray(v - np.partition(windows, half, axis=-1)[..., half])


# ── Spans of time in which derived figures are not those of the robot


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
        found = np.zeros(time.shape, bool)
        for instant in self.instants:
            found |= (time >= instant.begin - self.reach) & (time <= instant.end + self.reach)
        return found

    def doubt_at(self, times: Sequence[float]) -> Doubt:
        """Doubt about the instants at which the figures of these times stand; impacts only if there are no others."""
        at = [i for i in self.instants for t in times if i.begin - self.reach <= t <= i.end + self.reach]
        found = list(dict.fromkeys(at)) or list(self.instants)
        cause = min((i.cause for i in found), key=list(InstantKind).index)
        when = listed(dict.fromkeys(f"{seconds(i.begin, 4)} s" for i in found if i.cause is cause), _LISTED)
        return doubt("impact" if cause is InstantKind.IMPACT else "doubtful-rows", when=when)


_LISTED = 3


def doubtful_spans(instants: Iterable[Instant], step: float, origin: Origin, rows: int = SURROUNDINGS) -> DoubtfulSpans:
    """Spans of ``rows`` usual steps on either side of the instants; a plan has none, and corners only if it is a log."""
    causes = {Origin.PLAN: (), Origin.LOG: tuple(InstantKind), Origin.EITHER: (InstantKind.ROWS, InstantKind.FREEZE)}[
        origin
    ]
    return DoubtfulSpans(tuple(sorted(i for i in instants if i.cause in causes)), rows * step)


# ── Limits that can be those of a robot

_FEW = 3
"""Minimum number of joints whose one round limit is a placeholder."""
_ROUND = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0)


def shared_round(limits: Array) -> bool:
    """True if three joints or more have one limit with a single digit, such as 1, 10 or 100, which is a placeholder.

    >>> shared_round(np.full(6, 10.0)), shared_round(np.full(6, 3.14)), shared_round(np.array([10.0, 20.0, 20.0]))
    (True, False, False)
    """
    known = limits[np.isfinite(limits) & (limits > 0.0)]
    if len(known) < _FEW or np.ptp(known) > 0.0:
        return False
    mantissa = float(known[0]) / 10.0 ** np.floor(np.log10(known[0] * (1.0 + _NEAR)))
    return any(abs(mantissa / digit - 1.0) < _NEAR for digit in _ROUND)


def credible_velocities(limits: Limits) -> Array:
    """Velocity limits (nv,); inf where they are missing, not above zero, or one placeholder for all joints."""
    velocity = limits.velocity
    if shared_round(velocity):
        return np.full(velocity.shape, np.inf)
    return np.where(velocity > 0.0, velocity, np.inf)


_POSES, BY_WEIGHT = 2000, 3.0
"""Number of random poses, and multiple of a torque limit needed by the robot's weight alone, which makes it a placeholder."""


def weight_torques(robot: Robot) -> Array:
    """Largest gravity torque (nv,) of each joint in random poses [N m, N]."""
    q = robot.random_configuration(np.random.default_rng(0), _POSES)
    return np.asarray(np.abs(np.asarray(robot.gravity_forces(q))).max(axis=0))


def credible_efforts(robot: Robot) -> Array:
    """Torque limits (nv,) of the robot's file; inf where missing or not above zero, and everywhere if they are placeholders.

    A limit that the robot's weight alone exceeds by far shows that the unit of all is another, or that none is rated.
    """
    effort = np.where(robot.limits.effort > 0.0, robot.limits.effort, np.inf)
    if shared_round(robot.limits.effort) or (weight_torques(robot) > BY_WEIGHT * effort).any():
        return np.full(effort.shape, np.inf)
    return effort


def impossible_torque(robot: Robot, alone: Extrema, origin: Origin, corners: DoubtfulSpans) -> Doubt | None:
    """Doubt about a motion whose torques ``alone`` (nv,), without payloads and wrenches, no drive of the robot reaches.

    At one of the ``corners`` the torque may be that of an impact, which is not a drive's.
    """
    if origin is Origin.PLAN or not (alone.value > _TOO_STRONG * robot.limits.effort).any():
        return None
    effort, model = credible_efforts(robot), robot.model
    share = np.where(effort < np.inf, alone.value / np.where(effort < np.inf, effort, 1.0), 0.0)
    k = int(share.argmax())
    if not share[k] > _TOO_STRONG:
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


# ── Measured torques above their limits

_SIGMAS, _LEAST_ROWS, _LEAST_TIME = 3.0, 3, 0.01
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
        found = [_longest_run(time, np.flatnonzero(column)) for column in above.T]
        rows, length, at = np.array(found).reshape(-1, 3).T
        return cls(rows.astype(int), length, at)

    def lasting(self, step: float) -> Array:
        """Mask (nv,) of torques that stay above for at least three rows and 10 ms; each row lasts one ``step`` [s]."""
        return np.asarray((self.rows >= _LEAST_ROWS) & (self.length + step >= _LEAST_TIME * (1 - _NEAR)))


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
    return np.asarray(np.abs(tau) > limits + _SIGMAS * sigma)
