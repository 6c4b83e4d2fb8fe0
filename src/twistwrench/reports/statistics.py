"""Statistics of a motion: time means, gaps in time, decimated curves, and noise-corrected peak torques."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.numbers import number, seconds
from ..core.typing import Array
from ..motion.bounds import Extrema
from ..motion.coordinates import joint_rates
from ..motion.differentiation import SIGNIFICANT_SIGMAS, Differentiation, MotionSamples
from ..motion.load_case import LoadCase
from ..motion.log_table import slices
from ..motion.motion_log import LogRows
from ..motion.smoothing import spline_rates


def mean_weights(time: Array, rows: slice) -> Array:
    """Weights of some rows in the time mean over the rows at ``time`` (n,) by the trapezoidal rule.

    Uneven steps count by their length. Without a duration only the last row counts.

    >>> mean_weights(np.array([0.0, 1.0, 4.0]), slice(0, 3)).round(3).tolist()
    [0.125, 0.5, 0.375]
    """
    duration = float(time[-1] - time[0])
    if not duration > 0:
        return 1.0 * (np.arange(rows.start, rows.stop) == len(time) - 1)
    first, last = max(0, rows.start - 1), min(rows.stop + 1, len(time))
    steps = np.pad(np.diff(time[first:last]), (int(rows.start == first), int(rows.stop == last)))
    return np.asarray((steps[:-1] + steps[1:]) / (2.0 * duration))


_MIN_GAP, _MIN_CHANGE, _MIN_SPEED_SHARE = 0.1, 1e-3, 0.1
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


@dataclass(frozen=True, eq=False)
class Gaps:
    """Time steps longer than ``threshold``, and those of them that are long enough for a motion."""

    threshold: float
    count: int
    longest: float
    """Longest of these steps [s]; 0 without any."""
    longest_at: float
    """Its begin [s]; nan without any."""
    long: tuple[_Gap, ...]
    most: Array
    """(2, nv) largest logged speed and acceleration of each coordinate."""
    stops: tuple[Array, Array] | None = None
    """Least and largest allowed coordinates, (nq,) each; None if none are known."""

    @classmethod
    def from_edges(
        cls,
        time: Array,
        edges: tuple[Array, Array],
        most: Array,
        threshold: float,
        *,
        rates: bool = True,
        stops: tuple[Array, Array] | None = None,
    ) -> Gaps:
        """Gaps of the rows at ``time`` (n,).

        ``edges`` are coordinates (m, nq) and velocities (m, nv) of the rows of :func:`gap_edges`; ``rates`` is true if
        velocities are the rates of the coordinates.
        """
        begins = long_steps(time, threshold)
        lengths = time[begins + 1] - time[begins]
        longest, longest_at = 0.0, math.nan
        if len(lengths):
            k = int(np.argmax(lengths))
            longest, longest_at = float(lengths[k]), float(time[begins[k]])
        rows, (q, dq) = gap_edges(time, threshold), edges
        gaps = []
        for begin, length in zip(begins.tolist(), lengths.tolist(), strict=True):
            if length <= _MIN_GAP:
                continue
            k = int(np.searchsorted(rows, begin))
            gaps.append(_gap(float(time[begin]), length, q[k : k + 2], dq[k : k + 2], rates=rates))
        return cls(threshold, len(begins), longest, longest_at, tuple(gaps), most, stops)

    @property
    def hiding(self) -> list[tuple[float, float]]:
        """Start and length [s] of each gap with motion across it or at its ends."""
        largest_speed = float(np.max(self.most, initial=0.0, where=[[True], [False]]))
        min_speed = max(_MIN_SPEED_SHARE * largest_speed, _MIN_CHANGE)

        def hides(gap: _Gap) -> bool:
            return gap.change > _MIN_CHANGE or gap.beside.max(initial=0.0) > min_speed

        return [(gap.begin, gap.length) for gap in self.long if hides(gap)]

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
        for gap in self.long:
            slack = _MIN_CHANGE * np.array([[1 / gap.length], [4 / gap.length**2]])
            if (gap.across > self.most + slack).any():
                return True
            if self.stops is not None:
                lower, upper = self.stops
                if ((gap.extent[0] < lower) | (gap.extent[1] > upper)).any():
                    return True
        return False

    def beside(self, time: float, within: float) -> bool:
        """True if the time is at most ``within`` [s] from an end of a gap with motion."""
        return any(min(abs(time - at), abs(time - at - step)) <= within for at, step in self.hiding)


def long_steps(time: Array, threshold: float) -> Array:
    """Rows (m,) after which the time step is longer than ``threshold`` [s].

    Steps are computed in portions: those of a log with millions of rows would take as much memory as its times.
    """
    is_long = np.zeros(max(0, len(time) - 1), bool)
    for s in slices(len(is_long)):
        is_long[s] = np.diff(time[s.start : s.stop + 1]) > threshold
    return np.flatnonzero(is_long)


def gap_edges(time: Array, threshold: float) -> Array:
    """Rows (m,) at either end of the gaps that are long enough for a motion."""
    begins = long_steps(time, max(threshold, _MIN_GAP))
    return np.unique(np.concatenate([begins, begins + 1]))


def _gap(begin: float, length: float, q: Array, dq: Array, *, rates: bool) -> _Gap:
    """Gap between two rows with coordinates (2, nq) and velocities (2, nv)."""
    change, (v0, v1) = q[1] - q[0], dq
    size = float(np.abs(change).max(initial=0.0))
    across, extent = np.zeros((2, dq.shape[1])), q
    if rates:
        across, extent = _least_across(change, v0, v1, length), _extent(q[0], q[1], v0, v1, length)
    return _Gap(begin, length, size, np.abs([v0, v1]), across, extent)


_BINS = 2048
"""Bins of a plot, each with the least and the greatest value of its rows."""


def stride_of(count: int, most: int) -> int:
    """Smallest power of two of which ``count`` rows have at most ``most`` multiples.

    >>> stride_of(4096, 4096), stride_of(4097, 4096)
    (1, 2)
    """
    if count <= most:
        return 1
    return 1 << (-(-count // most) - 1).bit_length()


class Bins(NamedTuple):
    """Minima and maxima (b, columns) of the rows of each bin, its number (b,) and the time (b,) of its first row."""

    number: Array
    time: Array
    least: Array
    greatest: Array

    @classmethod
    def from_rows(cls, first: int, time: Array, lower: Array, upper: Array, count: int, bins: int = _BINS) -> Bins:
        """Bins of rows (n, columns) from the row ``first`` of ``count`` ones, bands from ``lower`` to ``upper``."""
        size = stride_of(count, 2 * bins)
        starts = np.arange(-(first % size), len(time), size).clip(min=0)
        least, greatest = np.minimum.reduceat(lower, starts), np.maximum.reduceat(upper, starts)
        return cls((first + starts) // size, time[starts], least, greatest)

    @classmethod
    def from_parts(cls, parts: Sequence[Bins]) -> Bins:
        """Bins of consecutive rows from those of their parts, which may begin and end within a bin."""
        number, time, least, greatest = map(np.concatenate, zip(*parts, strict=True))
        starts = np.flatnonzero(np.diff(number, prepend=-1))
        return cls(
            number[starts], time[starts], np.minimum.reduceat(least, starts), np.maximum.reduceat(greatest, starts)
        )


_MAX_RUNS = 4096
"""Runs among which the largest values are looked for."""
_MAX_SIGMAS_BELOW = 6.0
"""Distance below the largest value, in standard deviations, within which other values contend with it."""
_RELATIVE_UNCERTAINTY = 0.12
"""Relative uncertainty of the excess, which depends on an estimated noise and an approximate count."""


class Runs(NamedTuple):
    """Runs of equally many consecutive rows: the largest of their maxima, and the runs at both ends, which may go on there.

    A run does not count, and its maximum is -inf, if the maximum lies at its border next to a larger value: it is the flank of
    its neighbour, and both have correlated noise.
    """

    maxima: Array
    """(k, columns) maxima of the inner runs, in descending order by column, at most :data:`_MAX_RUNS`."""
    number: Array
    """(e,) numbers of the runs at the ends, from 0; their other figures are (e, columns)."""
    largest: Array
    first: Array
    last: Array
    before: Array
    """Values of the row before a run; nan if another part has it."""
    after: Array

    @classmethod
    def from_rows(cls, first: int, values: Array, rows: int) -> Runs:
        """Runs of ``rows`` rows each, counted from the first row of the motion; values begin at the row ``first``."""
        starts = np.arange(-(first % rows), len(values), rows).clip(min=0)
        ends = np.append(starts[1:], len(values)) - 1
        largest = np.maximum.reduceat(values, starts)
        unknown = np.full((1, values.shape[1]), np.nan)
        before, after = np.concatenate([unknown, values[ends[:-1]]]), np.concatenate([values[starts[1:]], unknown])
        inner = _without_flanks(largest, before, after)[1:-1]
        at_end = np.unique([0, len(starts) - 1])
        return cls(
            _descending(inner),
            (first + starts[at_end]) // rows,
            *(figure[at_end] for figure in (largest, values[starts], values[ends], before, after)),
        )

    @classmethod
    def from_parts(cls, parts: Sequence[Runs]) -> Runs:
        """Runs of consecutive rows from those of their parts, which may begin and end within a run."""
        maxima, number, largest, first, last, before, after = map(np.concatenate, zip(*parts, strict=True))
        starts = np.flatnonzero(np.diff(number, prepend=-1))
        ends = np.append(starts[1:], len(number)) - 1
        number, largest = number[starts], np.maximum.reduceat(largest, starts)
        first, last, before, after = first[starts], last[ends], before[starts], after[ends]
        before[1:] = np.where(np.isnan(before[1:]), last[:-1], before[1:])
        after[:-1] = np.where(np.isnan(after[:-1]), first[1:], after[:-1])
        return cls(_descending(maxima), number, largest, first, last, before, after)

    @property
    def count(self) -> int:
        """Number of runs."""
        return int(self.number[-1]) + 1

    def contenders(self, column: int) -> Array:
        """Maxima (runs,) of a column in the first few thousand runs, in descending order; -inf for runs that do not count."""
        at_ends = _without_flanks(self.largest, self.before, self.after)
        return _descending(np.concatenate([self.maxima, at_ends]))[:, column]


def _without_flanks(largest: Array, before: Array, after: Array) -> Array:
    """Maxima (m, columns) of runs; -inf where the value before or after the run is larger."""
    return np.where((largest < before) | (largest < after), -np.inf, largest)


def _descending(maxima: Array) -> Array:
    """The largest few thousand of each column (m, columns), in descending order."""
    return np.sort(maxima, axis=0)[::-1][:_MAX_RUNS].copy()  # a view would keep the others


def excess_of_largest(values: Array, sigma: float, runs: int) -> tuple[float, float]:
    """Excess of the first of descending ``values`` (k,) over the largest true value, and its standard deviation.

    Values of -inf do not count. The others are true values with independent normal noise of standard deviation ``sigma``, the
    largest of ``runs``. The variance of the contending true values is that of the values minus that of the noise.
    """
    from scipy.special import log_ndtr

    values = values[np.isfinite(values)]
    contending = values[values >= values[0] - _MAX_SIGMAS_BELOW * sigma]
    if len(contending) < 2 or sigma == 0.0:
        return 0.0, sigma
    count = len(contending)
    if count == len(values):  # all listed values contend, and further ones may
        count = runs
    variance = float(np.var(contending))
    true_share = max(0.0, 1.0 - sigma**2 / variance) if variance else 0.0
    true = contending.mean() + np.sqrt(true_share) * (contending - contending.mean())
    x = np.linspace(true.max() - _MAX_SIGMAS_BELOW * sigma, true.max() + 2 * _MAX_SIGMAS_BELOW * sigma, 721)
    below = np.exp(np.sum([log_ndtr((x - w) / sigma) for w in true], axis=0) * (count / len(contending)))
    share, middle = np.diff(below), 0.5 * (x[1:] + x[:-1])
    share /= share.sum()
    mean = float(share @ middle)
    spread = float(np.sqrt(share @ (middle - mean) ** 2))
    excess = max(0.0, mean - float(true.max()))
    return excess, float(np.hypot(spread, _RELATIVE_UNCERTAINTY * excess))


# Parametric bootstrap: the smoothed motion is taken as the truth, and logs of it are drawn with the errors estimated from the
# log and processed like the log. Their peaks differ from the truth like the log's peak: by the bias of smoothing, the residual
# noise, and the selection of the largest value.
# Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapters 6 and 10.

_MAX_DRAWS, _MIN_DRAWS, _MAX_COLUMNS = 128, 32, 4096
_BIAS = 0.8
"""Share of the drawn bias that is added as a standard deviation. Smoothing flattens the true peak and the noise left in the
smoothed motion. If noise dominates, the second effect is larger and has the opposite sign (errors are then -1.3 times the drawn
bias, on logs of known motions). The bias is therefore an error of unknown sign and is not subtracted. Of 844 such peaks, 95 %
intervals contain 94 % without it (91 % if only stamps have errors), 98 % (96 %) with this share, 99 % with share √2."""
INTERVAL = 1.96
"""Half-width of a 95 % confidence interval in standard deviations."""
_RANDOM_STREAM = 8
"""Seed of the draws."""
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


@dataclass(frozen=True, eq=False)
class PeakBootstrap:
    """Draws of logs of a smoothed motion, for the bias and the uncertainty of its peaks."""

    differentiation: Differentiation
    load: LoadCase

    @property
    def cell(self) -> int:
        """Rows of a run, in which noise is correlated."""
        strengths = self.differentiation.strengths[self.differentiation.strengths > 0]
        if not strengths.size:
            return 1
        return max(1, round(_CELL * float(strengths.min()) ** (1 / 6)))

    @property
    def _reach(self) -> int:
        """Rows on either side of a peak that are drawn."""
        wide = float(self.differentiation.strengths.max(initial=0.0)) ** (1 / 6)
        return math.ceil(_REACH * wide) + _SPLINE_REACH + self.cell

    def estimate(
        self, joint: int, peaks: Extrema, contenders: Array, runs: int, steady: float, speed: float
    ) -> PeakEstimate:
        """Peak of a joint, by draws from a fixed seed.

        ``contenders`` (k,) are the largest of ``runs`` runs of the magnitudes of its torque, ``steady`` is the part of the
        peak that is independent of accelerations, and ``speed`` the largest velocity.
        """
        log = self.differentiation.trajectory
        row = int(np.searchsorted(log.table[:, 0], peaks.time[joint]))
        first = max(0, row - self._reach)
        motion, row = log.motion(log.table[first : row + self._reach + 1]), row - first
        near_peak = slice(max(0, row - self.cell), row + self.cell + 1)
        sign = -1.0 if peaks.signed[joint] < 0 else 1.0
        bias, sigma, speed_sigma = self._peak_statistics(motion, near_peak, joint, sign)
        excess, spread = excess_of_largest(contenders, sigma, runs)
        largest, sigma = float(peaks.value[joint]), math.hypot(spread, _BIAS * bias)
        # The correction cannot exceed the part due to accelerations. If it would, the peak is unknown between these bounds.
        least = min(max(0.0, sign * steady), largest)
        if largest - excess < least:
            excess, sigma = largest - least, max(sigma, (largest - least) / INTERVAL)
        return PeakEstimate(sign * (largest - excess), sigma, speed, speed_sigma)

    def _peak_statistics(
        self, motion: LogRows, near_peak: slice, joint: int, sign: float
    ) -> tuple[float, float, float]:
        """Bias and standard deviation of the peak near some rows, and standard deviation of the velocity there."""
        d, t = self.differentiation, motion.time
        curve = d.smooth(t, d.curves(motion))
        columns = curve.shape[1]
        count = min(_MAX_DRAWS, max(_MIN_DRAWS, _MAX_COLUMNS // max(1, columns)))
        first, second = spline_rates(t, curve)
        true = [x[near_peak, :, None] for x in (curve, first, second)]
        true_torques, _ = self._torques(motion, near_peak, true)
        logs = d.smooth(t, d.errors.drawn(np.random.default_rng(_RANDOM_STREAM), curve, first, count))
        first, second = spline_rates(t, logs.reshape(len(t), -1))
        drawn = [x.reshape(len(t), columns, count)[near_peak] for x in (logs, first, second)]
        drawn_torques, dq = self._torques(motion, near_peak, drawn)
        peaks = (sign * drawn_torques[:, :, joint]).max(axis=0)
        bias = float(peaks.mean() - (sign * true_torques[:, :, joint]).max())
        middle = len(dq) // 2
        return bias, float(peaks.std(ddof=1)), float(dq[middle, :, joint].std(ddof=1))

    def _torques(self, motion: LogRows, rows: slice, logs: list[Array]) -> tuple[Array, Array]:
        """Torques and velocities (n, count, nv) of smoothed logs (n, k, count) with their derivatives."""
        d, model = self.differentiation, self.differentiation.model
        n, _, count = logs[0].shape
        x, first, second = (np.moveaxis(log, 1, 2).reshape(n * count, -1) for log in logs)

        def repeat_logged(values: Array) -> Array:
            return np.repeat(values[rows], count, axis=0)

        if motion.dq is None:
            q = x
            dq, ddq = joint_rates(model, q, first, second)
            if motion.ddq is not None:
                ddq = repeat_logged(motion.ddq)
        else:
            q, dq, ddq = repeat_logged(motion.q), x, first
        stationary = np.zeros(dq.shape, bool)
        if d.derives_velocities:
            stationary = np.abs(dq) <= SIGNIFICANT_SIGMAS * d.sigma_dq
        time, no_outliers = np.repeat(motion.time[rows], count), np.zeros((n * count, 0))
        torques = self.load.torques(MotionSamples(time, q, dq, ddq, q, stationary, no_outliers))
        torques = self.load.drive_torques(torques)
        return torques.reshape(n, count, -1), dq.reshape(n, count, -1)
