"""Statistics of a motion in bounded memory: RMS, gaps in time, decimated curves, and noise-corrected peak torques."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..core.numbers import number, seconds
from ..core.typing import Array
from ..motion.bounds import RunningExtrema
from ..motion.coordinates import joint_rates
from ..motion.differentiation import SURE, Differentiation, MotionSamples
from ..motion.load_case import LoadCase
from ..motion.motion_log import LogRows
from ..motion.smoothing import spline_rates


class Rms:
    """RMS over time by the trapezoidal rule, so that uneven steps are weighted by their length."""

    def __init__(self, columns: int) -> None:
        self._integral = np.zeros(columns)
        self._last: tuple[float, Array] | None = None
        self._begin = 0.0

    def add(self, time: Array, values: Array) -> None:
        """Add consecutive rows, times (n,) and values (n, columns)."""
        squares = values * values
        if self._last is None:
            self._begin = float(time[0])
        else:
            self._integral += 0.5 * (time[0] - self._last[0]) * (self._last[1] + squares[0])
        steps = np.diff(time)
        self._integral += 0.5 * (steps @ squares[1:] + steps @ squares[:-1])
        self._last = float(time[-1]), squares[-1].copy()

    def result(self) -> Array:
        """RMS of each column, (columns,)."""
        if self._last is None:
            return np.full(self._integral.shape, np.nan)
        duration = self._last[0] - self._begin
        return np.asarray(np.sqrt(self._integral / duration if duration > 0 else self._last[1]))


_LONG, _MOVED, _FAST = 0.1, 1e-3, 0.1
"""Thresholds for hidden motion in a gap: its length [s], change of a coordinate [rad, m], and speed beside it relative to the
largest speed. In a shorter gap no joint with mass accelerates and brakes again."""


class _Gap(NamedTuple):
    """Gap in time that is long enough for a motion."""

    begin: float
    length: float
    change: float
    """Largest change of a coordinate across the gap [rad, m]."""
    beside: Array
    """(2, nv) speeds at its ends."""
    across: Array
    """(2, nv) least speed and acceleration of each coordinate within the gap; zero if unknown."""
    extent: Array
    """(2, nq) least and largest coordinates of the cubic between its ends."""


def _least_across(change: Array, v0: Array, v1: Array, h: float) -> Array:
    """(2, nv) speed and acceleration that a change over the time h takes, from the speed v0 to v1.

    A constant acceleration and deceleration: 2/3 of the largest acceleration of the cubic between the ends.
    """
    v = change / h
    a = np.maximum(np.abs(3 * v - 2 * v0 - v1), np.abs(3 * v - v0 - 2 * v1)) * 4 / (3 * h)
    return np.abs([v, a])


def _extent(q0: Array, q1: Array, v0: Array, v1: Array, h: float) -> Array:
    """(2, nq) least and largest values of the cubic from q0 to q1 with the speeds v0 and v1 at its ends."""
    u = np.linspace(0.0, 1.0, _POINTS)[:, None]
    cubic = q0 + (q1 - q0) * (3 - 2 * u) * u**2 + h * u * (1 - u) * (v0 * (1 - u) - v1 * u)
    return np.array([cubic.min(axis=0), cubic.max(axis=0)])


_POINTS = 101


@dataclass
class Gaps:
    """Time steps longer than ``threshold``; ``rates`` is true if velocities are the rates of the coordinates."""

    threshold: float
    rates: bool = True
    stops: tuple[Array, Array] | None = None
    """Least and largest allowed coordinates, (nq,) each; None if none are known."""
    count: int = 0
    longest: float = 0.0
    longest_at: float = float("nan")
    _long: list[_Gap] = field(default_factory=list)
    _most: Array | float = 0.0
    """(2, nv) largest logged speed and acceleration of each coordinate."""
    _last: tuple[Array, Array, Array] | None = None

    @property
    def hiding(self) -> list[tuple[float, float]]:
        """Start and length [s] of each gap with motion across it or at its ends."""
        fast = max(_FAST * float(np.max(self._most, initial=0.0, where=[[True], [False]])), _MOVED)
        return [
            (gap.begin, gap.length) for gap in self._long if gap.change > _MOVED or gap.beside.max(initial=0.0) > fast
        ]

    @property
    def hidden(self) -> float:
        """Length [s] of the longest gap with motion; 0 if there is none."""
        return max((step for _, step in self.hiding), default=0.0)

    @property
    def hidden_words(self) -> str:
        """Sentence on the longest gap with motion."""
        at, step = max(self.hiding, key=lambda gap: gap[1])
        return f"the robot moves while nothing is logged for {number(step)} s after t = {seconds(at)} s"

    @property
    def exceeds_logged_motion(self) -> bool:
        """True if a gap needs a larger speed or acceleration of a coordinate than any that was logged, or leaves its stops."""
        if self.stops is not None:
            lower, upper = self.stops
            if any(((gap.extent[0] < lower) | (gap.extent[1] > upper)).any() for gap in self._long):
                return True
        slack = (_MOVED * np.array([[1 / gap.length], [4 / gap.length**2]]) for gap in self._long)
        return any((gap.across > self._most + more).any() for gap, more in zip(self._long, slack, strict=True))

    def beside(self, time: float, within: float) -> bool:
        """True if the time is at most ``within`` [s] from an end of a gap with motion."""
        return any(min(abs(time - at), abs(time - at - step)) <= within for at, step in self.hiding)

    def add(self, time: Array, q: Array, dq: Array, ddq: Array) -> None:
        """Add consecutive times (n,), coordinates (n, nq), velocities and accelerations (n, nv)."""
        self._most = np.maximum(self._most, np.abs([dq, ddq]).max(axis=1, initial=0.0))
        if self._last is not None:
            time, q, dq = (np.concatenate(pair) for pair in zip(self._last, (time, q, dq), strict=True))
        steps, changes = np.diff(time), np.diff(q, axis=0)
        found = steps > self.threshold
        self.count += int(found.sum())
        self.longest, self.longest_at = _longest(time, np.where(found, steps, 0.0), (self.longest, self.longest_at))
        for k in np.flatnonzero(found & (steps > _LONG)):
            h, change, (v0, v1) = float(steps[k]), changes[k], dq[k : k + 2]
            across = _least_across(change, v0, v1, h) if self.rates else np.zeros((2, dq.shape[1]))
            size = float(np.abs(change).max(initial=0.0))
            extent = _extent(q[k], q[k + 1], v0, v1, h) if self.rates else np.array([q[k], q[k + 1]])
            self._long.append(_Gap(float(time[k]), h, size, np.abs([v0, v1]), across, extent))
        self._last = time[-1:], q[-1:], dq[-1:]


def _longest(time: Array, steps: Array, known: tuple[float, float]) -> tuple[float, float]:
    """Longest time step so far and its start."""
    k = int(np.argmax(steps)) if len(steps) else 0
    return (float(steps[k]), float(time[k])) if len(steps) and steps[k] > known[0] else known


# ── Min-max decimation: the least and the greatest value of each bin of rows

_BINS = 2048


class MinMaxDecimation:
    """Minima and maxima of (n, columns) rows in bins of equal size; the size doubles if the bins become too many."""

    def __init__(self, columns: int, bins: int = _BINS) -> None:
        self._most = 2 * bins
        self._rows_per_bin = 1
        self._rows = 0
        self._time = np.zeros(0)
        self._least, self._greatest = np.zeros((2, 0, columns))

    def add(self, time: Array, values: Array, upper: Array | None = None) -> None:
        """Add consecutive rows, times (n,) and values (n, columns), or bands from those to ``upper``."""
        offset = self._rows % self._rows_per_bin  # rows already in the last bin
        starts = np.arange(-offset, len(time), self._rows_per_bin).clip(min=0)
        begins, least = time[starts], np.minimum.reduceat(values, starts)
        greatest = np.maximum.reduceat(values if upper is None else upper, starts)
        if offset:
            self._least[-1] = np.minimum(self._least[-1], least[0])
            self._greatest[-1] = np.maximum(self._greatest[-1], greatest[0])
            begins, least, greatest = begins[1:], least[1:], greatest[1:]
        self._time = np.concatenate([self._time, begins])
        self._least = np.concatenate([self._least, least])
        self._greatest = np.concatenate([self._greatest, greatest])
        self._rows += len(time)
        while len(self._time) > self._most:
            pairs = np.arange(0, len(self._time), 2)
            self._time = self._time[::2]
            self._least = np.minimum.reduceat(self._least, pairs)
            self._greatest = np.maximum.reduceat(self._greatest, pairs)
            self._rows_per_bin *= 2

    def result(self) -> tuple[Array, Array, Array]:
        """Start times of the bins (b,), minima and maxima (b, columns)."""
        return self._time, self._least, self._greatest


# ── The largest true value behind many noisy ones

_MOST = 4096
_NEAR = 6.0
"""Distance below the largest value, in standard deviations, within which other values contend with it."""
_UNSURE = 0.12
"""Relative uncertainty of the excess, which depends on an estimated noise and an approximate count."""


class Contenders:
    """Maximum of each column over each run of ``rows`` rows, accumulated over chunks of rows.

    A run does not count if its maximum lies at its border next to a larger value: it is the flank of its neighbour, and both
    have correlated noise.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self.rows = rows
        self._seen = 0
        self._held = np.zeros((0, columns))
        self._before = np.full(columns, -np.inf)
        """Row before the held rows."""
        self._kept = np.zeros((0, columns))

    @property
    def runs(self) -> int:
        """Number of runs."""
        return -(-self._seen // self.rows)

    def add(self, values: Array) -> None:
        """Add consecutive values (n, columns)."""
        self._seen += len(values)
        held = np.concatenate([self._held, values])
        done = max(0, len(held) - 1) // self.rows  # runs followed by a known row
        if done:
            runs = held[: done * self.rows].reshape(done, self.rows, -1)
            before = np.concatenate([self._before[None], runs[:-1, -1]])
            self._keep(_own(runs.max(axis=1), before, held[self.rows : done * self.rows + 1 : self.rows]))
            self._before = runs[-1, -1].copy()
        self._held = held[done * self.rows :].copy()

    def _keep(self, values: Array) -> None:
        self._kept = np.concatenate([self._kept, values])
        if len(self._kept) > _MOST:
            self._kept = -np.partition(-self._kept, _MOST - 1, axis=0)[:_MOST]

    def result(self) -> Array:
        """Maxima (runs, columns) of the first few thousand runs in descending order; -inf for runs that do not count."""
        last = self._held.max(axis=0, keepdims=True) if len(self._held) else self._held
        last = _own(last, self._before[None], np.full_like(last, -np.inf))
        return -np.sort(-np.concatenate([self._kept, last]), axis=0)[:_MOST]


def _own(largest: Array, before: Array, after: Array) -> Array:
    """Maxima of runs (n, columns); -inf if the row before or after a run is larger."""
    return np.where((largest >= before) & (largest >= after), largest, -np.inf)


def excess_of_largest(values: Array, sigma: float, runs: int) -> tuple[float, float]:
    """Excess of the first of descending ``values`` (k,) over the largest true value, and its standard deviation.

    Values of -inf do not count. The others are true values with independent normal noise of standard deviation ``sigma``, the
    largest of ``runs``. The variance of the contending true values is that of the values minus that of the noise.
    """
    from scipy.special import log_ndtr

    values = values[np.isfinite(values)]
    near = values[values >= values[0] - _NEAR * sigma]
    if len(near) < 2 or sigma == 0.0:
        return 0.0, sigma
    count = runs if len(near) == len(values) else len(near)  # all listed values contend, and further ones may
    variance = float(np.var(near))
    kept = max(0.0, 1.0 - sigma**2 / variance) if variance else 0.0
    true = near.mean() + np.sqrt(kept) * (near - near.mean())
    x = np.linspace(true.max() - _NEAR * sigma, true.max() + 2 * _NEAR * sigma, 721)
    below = np.exp(np.sum([log_ndtr((x - w) / sigma) for w in true], axis=0) * (count / len(near)))
    share, middle = np.diff(below), 0.5 * (x[1:] + x[:-1])
    share /= share.sum()
    mean = float(share @ middle)
    spread = float(np.sqrt(share @ (middle - mean) ** 2))
    excess = max(0.0, mean - float(true.max()))
    return excess, float(np.hypot(spread, _UNSURE * excess))


# ── The largest torque without the noise of the log, by resampling

# Parametric bootstrap: the smoothed motion is taken as the truth, and logs of it are drawn with the errors estimated from the
# log and processed like the log. Their peaks differ from the truth like the log's peak: by the bias of smoothing, the residual
# noise, and the selection of the largest value.
# Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapters 6 and 10.

_DRAWS, _FEWEST_DRAWS, _MOST_COLUMNS = 128, 32, 4096
_BIAS = 0.8
"""Share of the drawn bias that is added as a standard deviation. Smoothing flattens the true peak and the noise left in the
smoothed motion. If noise dominates, the second effect is larger and has the opposite sign (errors are then -1.3 times the drawn
bias, on logs of known motions). The bias is therefore an error of unknown sign and is not subtracted. Of 844 such peaks, 95 %
intervals contain 94 % without it (91 % if only stamps have errors), 98 % (96 %) with this share, 99 % with share √2."""
INTERVAL = 1.96
"""Half-width of a 95 % confidence interval in standard deviations."""
_SEED = 8
_REACH, _SPLINE_REACH = 16.0, 24
"""Distance in samples, in units of strength^(1/6), beyond which a sample changes a smoothed value by less than 1e-3."""
_CELL = 2.0
"""Distance in samples, in units of strength^(1/6), at which the noise of smoothed accelerations is nearly uncorrelated."""


@dataclass(frozen=True)
class PeakEstimate:
    """Estimated peak torque of one joint, corrected for noise of the log."""

    value: float
    """Estimate with its sign."""
    sigma: float
    """Standard deviation of the estimate."""
    speed: float
    """Largest velocity of the smoothed motion, with its sign."""
    speed_sigma: float
    """Standard deviation of velocities there."""


class PeakSearch:
    """Peaks of the smoothed motion, competing values, and the log around the peaks, from one pass."""

    def __init__(self, differentiation: Differentiation, load: LoadCase) -> None:
        nv = load.robot.nv
        strengths = differentiation.strengths[differentiation.strengths > 0]
        wide = float(strengths.max()) ** (1 / 6) if strengths.size else 0.0
        narrow = float(strengths.min()) ** (1 / 6) if strengths.size else 0.0
        self.differentiation, self.load = differentiation, load
        self.cell = max(1, round(_CELL * narrow))
        self.reach = math.ceil(_REACH * wide) + _SPLINE_REACH + self.cell
        self.peak, self.speed = RunningExtrema(nv), RunningExtrema(nv)
        self.contenders = Contenders(nv, self.cell)
        self.around: list[tuple[LogRows, int] | None] = [None] * nv

    def add(self, core: MotionSamples, torques: Array, motion: LogRows, inner: slice) -> None:
        """Add an overlapping run: its new rows with their torques, and the log around them."""
        self.contenders.add(np.abs(torques))
        for joint, row in self.peak.add(core.time, np.abs(torques), torques):
            place = inner.start + row
            first = max(0, place - self.reach)
            rows = slice(first, place + self.reach + 1)
            self.around[joint] = _part(motion, rows), place - first
        self.speed.add(core.time, np.abs(core.dq), core.dq)

    def estimate(self, joint: int, steady: float) -> PeakEstimate:
        """Peak of a joint, by draws from a fixed seed; ``steady`` is its part independent of accelerations."""
        found = self.around[joint]
        assert found is not None
        motion, row = found
        near = slice(max(0, row - self.cell), row + self.cell + 1)
        sign = -1.0 if self.peak.signed[joint] < 0 else 1.0
        bias, sigma, speed_sigma = self._drawn(motion, near, joint, sign)
        values = self.contenders.result()[:, joint]
        excess, spread = excess_of_largest(values, sigma, self.contenders.runs)
        largest, sigma = float(self.peak.value[joint]), math.hypot(spread, _BIAS * bias)
        # The correction cannot exceed the part due to accelerations. If it would, the peak is unknown between these bounds.
        least = min(max(0.0, sign * steady), largest)
        if largest - excess < least:
            excess, sigma = largest - least, max(sigma, (largest - least) / INTERVAL)
        return PeakEstimate(
            value=sign * (largest - excess),
            sigma=sigma,
            speed=float(self.speed.signed[joint]),
            speed_sigma=speed_sigma,
        )

    def _drawn(self, motion: LogRows, near: slice, joint: int, sign: float) -> tuple[float, float, float]:
        """Bias and standard deviation of the peak near some rows, and standard deviation of the velocity there."""
        d, t = self.differentiation, motion.time
        curve = d.smooth(t, d.curves(motion))
        columns = curve.shape[1]
        count = min(_DRAWS, max(_FEWEST_DRAWS, _MOST_COLUMNS // max(1, columns)))
        speed = spline_rates(t, curve)[0]
        logs = d.smooth(t, d.errors.drawn(np.random.default_rng(_SEED), curve, speed, count))
        first, second = spline_rates(t, logs.reshape(len(t), -1))
        each = [x.reshape(len(t), columns, count)[near] for x in (logs, first, second)]
        clean = [x[near] for x in (curve, *spline_rates(t, curve))]
        true, _ = self._torques(motion, near, [x[:, :, None] for x in clean])
        drawn, dq = self._torques(motion, near, each)
        peaks = (sign * drawn[:, :, joint]).max(axis=0)
        bias = float(peaks.mean() - (sign * true[:, :, joint]).max())
        middle = len(dq) // 2
        return bias, float(peaks.std(ddof=1)), float(dq[middle, :, joint].std(ddof=1))

    def _torques(self, motion: LogRows, near: slice, logs: list[Array]) -> tuple[Array, Array]:
        """Torques and velocities (n, count, nv) of smoothed logs (n, k, count) with their derivatives."""
        d, model = self.differentiation, self.differentiation.model
        n, _, count = logs[0].shape
        x, first, second = (np.moveaxis(a, 1, 2).reshape(n * count, -1) for a in logs)

        def given(values: Array | None) -> Array:
            assert values is not None
            return np.repeat(values[near], count, axis=0)

        if motion.dq is None:
            q = x
            dq, ddq = joint_rates(model, q, first, second)
            ddq = ddq if motion.ddq is None else given(motion.ddq)
        else:
            q, dq, ddq = given(motion.q), x, first
        still = np.abs(dq) <= SURE * d.sigma_dq if d.derives_velocities else np.zeros(dq.shape, bool)
        time, none = np.repeat(motion.time[near], count), np.zeros((n * count, 0))
        torques = self.load.torques(MotionSamples(time, q, dq, ddq, q, still, none))
        torques = self.load.at_drives(torques)
        return torques.reshape(n, count, -1), dq.reshape(n, count, -1)


def _part(motion: LogRows, rows: slice) -> LogRows:
    def part(values: Array | None) -> Array | None:
        return None if values is None else values[rows].copy()

    return LogRows(motion.time[rows].copy(), motion.q[rows].copy(), part(motion.dq), part(motion.ddq))
