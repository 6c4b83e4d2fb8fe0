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
    """Weights of ``rows`` in the time mean over all rows at ``time`` (n,) by the trapezoidal rule.

    Steps count by their length. If all rows have the same time, only the last row counts.

    >>> mean_weights(np.array([0.0, 1.0, 4.0]), slice(0, 3)).round(3).tolist()
    [0.125, 0.5, 0.375]
    """
    duration = float(time[-1] - time[0])
    if not duration > 0:
        is_last_row = np.arange(rows.start, rows.stop) == len(time) - 1
        return 1.0 * is_last_row
    # A row has half of the steps on both its sides. The first row and the last row have a step of zero beyond them.
    first = max(0, rows.start - 1)
    stop = min(rows.stop + 1, len(time))
    zeros_beyond = (int(rows.start == first), int(rows.stop == stop))
    steps = np.pad(np.diff(time[first:stop]), zeros_beyond)
    return np.asarray((steps[:-1] + steps[1:]) / (2.0 * duration))


_MIN_GAP = 0.1
"""Length [s] up to which a gap hides no motion, as no joint with mass accelerates and brakes again in it."""
_MIN_CHANGE = 1e-3
"""Change [rad or m] of a coordinate across a gap up to which there was no motion."""
_MIN_SPEED_SHARE = 0.1
"""Speed at an end of a gap, relative to the largest speed of the log, above which the gap hides motion."""


class _Gap(NamedTuple):
    """Gap in time that is long enough for a motion."""

    begin: float
    """Time [s] of the row before the gap."""
    length: float
    """Length [s] of the gap."""
    change: float
    """Largest change of a coordinate across the gap [rad, m]."""
    end_speeds: Array
    """(2, nv) speeds at the ends of the gap [rad/s, m/s]."""
    least_rates: Array
    """(2, nv) least speed and acceleration that each coordinate needs within the gap; zero if unknown."""
    extent: Array
    """(2, nq) least and largest coordinates of the cubic between its ends."""


def _least_rates_across(change: Array, v0: Array, v1: Array, h: float) -> Array:
    """(2, nv) speed and acceleration that a change within the time h needs, if the velocities at its ends are v0 and v1.

    The speed is the mean speed. The acceleration is 2/3 of the largest acceleration of the cubic between the ends. From
    rest to rest, this equals a constant acceleration followed by an equal deceleration.
    """
    v = change / h
    # The cubic has the accelerations (6 v - 4 v0 - 2 v1) / h and -(6 v - 2 v0 - 4 v1) / h at its ends.
    a = np.maximum(np.abs(3 * v - 2 * v0 - v1), np.abs(3 * v - v0 - 2 * v1)) * 4 / (3 * h)
    return np.abs([v, a])


_EXTENT_POINTS = 101
"""Number of points of a cubic at which its extent is sought."""


def _cubic_extent(q0: Array, q1: Array, v0: Array, v1: Array, h: float) -> Array:
    """(2, nq) least and largest values of the cubic from q0 to q1 in the time h with the velocities v0 and v1 at its ends."""
    u = np.linspace(0.0, 1.0, _EXTENT_POINTS)[:, None]  # time as a fraction of h
    cubic = q0 + (q1 - q0) * (3 - 2 * u) * u**2 + h * u * (1 - u) * (v0 * (1 - u) - v1 * u)
    return np.array([cubic.min(axis=0), cubic.max(axis=0)])


@dataclass(frozen=True, eq=False)
class Gaps:
    """Time steps of a log that are longer than a threshold, called gaps."""

    threshold: float
    """Length [s] above which a time step is a gap."""
    count: int
    """Number of gaps."""
    longest: float
    """Length of the longest gap [s]; 0 without any."""
    longest_at: float
    """Begin of the longest gap [s]; nan without any."""
    long: tuple[_Gap, ...]
    """Gaps that are long enough for a motion."""
    largest_rates: Array
    """(2, nv) largest logged speed and acceleration of each coordinate."""
    stops: tuple[Array, Array] | None = None
    """Least and largest allowed coordinates, (nq,) each; None if unknown."""

    @classmethod
    def from_edges(
        cls,
        time: Array,
        edges: tuple[Array, Array],
        largest_rates: Array,
        threshold: float,
        *,
        rates: bool = True,
        stops: tuple[Array, Array] | None = None,
    ) -> Gaps:
        """Gaps of the rows at ``time`` (n,).

        ``edges`` are coordinates (m, nq) and velocities (m, nv) of the rows of :func:`gap_edges`; ``rates`` is true if
        velocities are the rates of the coordinates.
        """
        rows_before = long_steps(time, threshold)
        begins = time[rows_before]
        lengths = time[rows_before + 1] - begins
        gap_count = len(lengths)
        longest = 0.0
        longest_at = math.nan
        if gap_count:
            k = int(np.argmax(lengths))
            longest = float(lengths[k])
            longest_at = float(begins[k])
        q, dq = edges
        edge_rows = gap_edges(time, threshold)
        long_gaps = []
        for row, begin, length in zip(rows_before.tolist(), begins.tolist(), lengths.tolist(), strict=True):
            if length > _MIN_GAP:
                k = int(np.searchsorted(edge_rows, row))  # of the row before the gap; the row after it follows
                long_gaps.append(_gap(begin, length, q[k : k + 2], dq[k : k + 2], rates=rates))
        return cls(threshold, gap_count, longest, longest_at, tuple(long_gaps), largest_rates, stops)

    @property
    def hiding(self) -> list[tuple[float, float]]:
        """Start and length [s] of each gap with motion across it or at its ends."""
        speeds, _ = self.largest_rates
        largest_speed = float(np.max(speeds, initial=0.0))
        min_speed = max(_MIN_SPEED_SHARE * largest_speed, _MIN_CHANGE)

        def hides_motion(gap: _Gap) -> bool:
            return gap.change > _MIN_CHANGE or gap.end_speeds.max(initial=0.0) > min_speed

        return [(gap.begin, gap.length) for gap in self.long if hides_motion(gap)]

    @property
    def hidden(self) -> float:
        """Length [s] of the longest gap with motion; 0 if there is none."""
        return max((length for _, length in self.hiding), default=0.0)

    @property
    def hidden_words(self) -> str:
        """Sentence on the longest gap with motion."""
        begin, length = max(self.hiding, key=lambda begin_and_length: begin_and_length[1])
        return f"the robot moves while nothing is logged for {number(length)} s after t = {seconds(begin)} s"

    @property
    def exceeds_logged_motion(self) -> bool:
        """True if a coordinate exceeds all logged speeds or accelerations within a gap, or its stops."""
        for gap in self.long:
            # The smallest change that is motion needs this speed and, from rest to rest, this acceleration.
            rates_of_min_change = _MIN_CHANGE * np.array([[1 / gap.length], [4 / gap.length**2]])
            if (gap.least_rates > self.largest_rates + rates_of_min_change).any():
                return True
            if self.stops is not None:
                lower, upper = self.stops
                least, largest = gap.extent
                if ((least < lower) | (largest > upper)).any():
                    return True
        return False

    def beside(self, time: float, within: float) -> bool:
        """True if the time is at most ``within`` [s] from an end of a gap with motion."""
        distances = [min(abs(time - begin), abs(time - begin - length)) for begin, length in self.hiding]
        return any(distance <= within for distance in distances)


def long_steps(time: Array, threshold: float) -> Array:
    """Rows (m,) after which the time step is longer than ``threshold`` [s].

    Steps are computed in portions, because all steps of a log with millions of rows would take as much memory as its times.
    """
    is_long = np.zeros(max(0, len(time) - 1), bool)
    for s in slices(len(is_long)):
        is_long[s] = np.diff(time[s.start : s.stop + 1]) > threshold
    return np.flatnonzero(is_long)


def gap_edges(time: Array, threshold: float) -> Array:
    """Rows (m,) before and after the gaps that are long enough for a motion, in order."""
    begins = long_steps(time, max(threshold, _MIN_GAP))
    return np.unique(np.concatenate([begins, begins + 1]))


def _gap(begin: float, length: float, q: Array, dq: Array, *, rates: bool) -> _Gap:
    """Gap between two rows with coordinates (2, nq) and velocities (2, nv).

    Without ``rates``, velocities do not belong to coordinates, so no motion between the rows is inferred.
    """
    q0, q1 = q
    v0, v1 = dq
    largest_change = float(np.abs(q1 - q0).max(initial=0.0))
    least_rates = np.zeros((2, dq.shape[1]))
    extent = q
    if rates:
        least_rates = _least_rates_across(q1 - q0, v0, v1, length)
        extent = _cubic_extent(q0, q1, v0, v1, length)
    return _Gap(begin, length, largest_change, np.abs([v0, v1]), least_rates, extent)


_BINS = 2048
"""Number of bins of a plot, each with the least and the greatest value of its rows."""


def stride_of(count: int, most: int) -> int:
    """Smallest power of two s for which every s-th of ``count`` rows are at most ``most`` rows.

    >>> stride_of(4096, 4096), stride_of(4097, 4096)
    (1, 2)
    """
    if count <= most:
        return 1
    least_stride = math.ceil(count / most)
    return 1 << (least_stride - 1).bit_length()


class Bins(NamedTuple):
    """Bins of equally many consecutive rows, with the range of the values in each."""

    number: Array
    """(b,) number of each bin in the motion."""
    time: Array
    """(b,) time of the first row of each bin [s]."""
    least: Array
    """(b, columns) minima of the rows of each bin."""
    greatest: Array
    """(b, columns) maxima of the rows of each bin."""

    @classmethod
    def from_rows(cls, first: int, time: Array, lower: Array, upper: Array, count: int, bins: int = _BINS) -> Bins:
        """Bins of n rows of a motion, from its row ``first`` on; the motion has ``count`` rows.

        Values lie between ``lower`` and ``upper`` (n, columns).
        """
        rows_per_bin = stride_of(count, 2 * bins)
        first_start = -(first % rows_per_bin)  # the first bin may begin before the first row
        starts = np.arange(first_start, len(time), rows_per_bin).clip(min=0)
        least = np.minimum.reduceat(lower, starts)
        greatest = np.maximum.reduceat(upper, starts)
        return cls((first + starts) // rows_per_bin, time[starts], least, greatest)

    @classmethod
    def from_parts(cls, parts: Sequence[Bins]) -> Bins:
        """Bins of consecutive rows from the bins of their parts, which may begin and end within a bin."""
        number, time, least, greatest = map(np.concatenate, zip(*parts, strict=True))
        starts = np.flatnonzero(np.diff(number, prepend=-1))  # parts of one bin have one number
        least = np.minimum.reduceat(least, starts)
        greatest = np.maximum.reduceat(greatest, starts)
        return cls(number[starts], time[starts], least, greatest)


_MAX_RUNS = 4096
"""Number of largest maxima that may contend for the largest value."""
_MAX_SIGMAS_BELOW = 6.0
"""Distance below the largest value, in standard deviations, within which other values contend with it."""
_RELATIVE_UNCERTAINTY = 0.12
"""Relative uncertainty of the excess, which depends on an estimated noise and an approximate count."""
_GRID_POINTS = 721
"""Number of points of the distribution of the largest value: 40 in a standard deviation."""


class Runs(NamedTuple):
    """Runs of equally many consecutive rows: the largest maxima of inner runs, and the runs at both ends.

    The runs at the ends may continue in another part of the motion. A run does not count if its maximum lies at its border
    next to a larger value: it is the flank of its neighbour, and both have correlated noise. Its maximum is -inf.
    """

    maxima: Array
    """(k, columns) largest maxima of the inner runs, at most :data:`_MAX_RUNS`, each column in descending order."""
    number: Array
    """(e,) number in the motion of each run at an end; e is 1 or 2."""
    largest: Array
    """(e, columns) maxima of the rows of these runs."""
    first: Array
    """(e, columns) values of the first row of each."""
    last: Array
    """(e, columns) values of the last row of each."""
    before: Array
    """(e, columns) values of the row before each; nan if that row is in another part."""
    after: Array
    """(e, columns) values of the row after each; nan if that row is in another part."""

    @classmethod
    def from_rows(cls, first: int, values: Array, rows: int) -> Runs:
        """Runs of ``rows`` rows each of a motion, whose row ``first`` is the first row of ``values`` (n, columns)."""
        starts = np.arange(-(first % rows), len(values), rows).clip(min=0)  # the first run may have begun before
        ends = np.append(starts[1:], len(values)) - 1
        largest = np.maximum.reduceat(values, starts)
        unknown = np.full((1, values.shape[1]), np.nan)
        before = np.concatenate([unknown, values[ends[:-1]]])
        after = np.concatenate([values[starts[1:]], unknown])
        inner_maxima = _without_flanks(largest, before, after)[1:-1]
        at_ends = np.unique([0, len(starts) - 1])
        return cls(
            maxima=_descending(inner_maxima),
            number=(first + starts[at_ends]) // rows,
            largest=largest[at_ends],
            first=values[starts[at_ends]],
            last=values[ends[at_ends]],
            before=before[at_ends],
            after=after[at_ends],
        )

    @classmethod
    def from_parts(cls, parts: Sequence[Runs]) -> Runs:
        """Runs of consecutive rows from the runs of their parts, which may begin and end within a run."""
        maxima, number, largest, first, last, before, after = map(np.concatenate, zip(*parts, strict=True))
        starts = np.flatnonzero(np.diff(number, prepend=-1))  # parts of one run have one number
        ends = np.append(starts[1:], len(number)) - 1
        first = first[starts]
        before = before[starts]
        last = last[ends]
        after = after[ends]
        # Rows before and after a run may be the ends of its neighbours in other parts.
        before[1:] = np.where(np.isnan(before[1:]), last[:-1], before[1:])
        after[:-1] = np.where(np.isnan(after[:-1]), first[1:], after[:-1])
        largest = np.maximum.reduceat(largest, starts)
        return cls(_descending(maxima), number[starts], largest, first, last, before, after)

    @property
    def run_count(self) -> int:
        """Number of runs of the motion up to the last row."""
        return int(self.number[-1]) + 1

    def contenders(self, column: int) -> Array:
        """Maxima (runs,) of a column in the first few thousand runs, in descending order; -inf for runs that do not count."""
        end_maxima = _without_flanks(self.largest, self.before, self.after)
        return _descending(np.concatenate([self.maxima, end_maxima]))[:, column]


def _without_flanks(largest: Array, before: Array, after: Array) -> Array:
    """Maxima (m, columns) of runs; -inf where the value before or after the run is larger."""
    return np.where((largest < before) | (largest < after), -np.inf, largest)


def _descending(maxima: Array) -> Array:
    """Largest few thousand maxima of each column (m, columns), in descending order."""
    descending = np.sort(maxima, axis=0)[::-1]
    return descending[:_MAX_RUNS].copy()  # a view would keep the others in memory


def excess_of_largest(values: Array, sigma: float, runs: int) -> tuple[float, float]:
    """Expected excess of the largest of noisy values over the largest true value, and its standard deviation.

    ``values`` (k,) are the largest of ``runs`` values, in descending order; -inf does not count. Each is a true value plus
    independent normal noise of standard deviation ``sigma``. The true values that contend are estimated from their noisy
    values: these are shrunk towards their mean until their variance is less by the variance of the noise.
    """
    from scipy.special import log_ndtr

    values = values[np.isfinite(values)]
    contending = values[values >= values[0] - _MAX_SIGMAS_BELOW * sigma]
    if len(contending) < 2 or sigma == 0.0:
        return 0.0, sigma
    contender_count = len(contending)
    if contender_count == len(values):  # all listed values contend, and values that are not listed may
        contender_count = runs
    variance = float(np.var(contending))
    true_share = max(0.0, 1.0 - sigma**2 / variance) if variance else 0.0  # of the variance
    true_values = contending.mean() + np.sqrt(true_share) * (contending - contending.mean())
    largest_true = true_values.max()
    # The largest of independent values is below x with the product of their probabilities.
    x = np.linspace(
        largest_true - _MAX_SIGMAS_BELOW * sigma, largest_true + 2 * _MAX_SIGMAS_BELOW * sigma, _GRID_POINTS
    )
    log_probability_of_contending = np.sum([log_ndtr((x - value) / sigma) for value in true_values], axis=0)
    log_probability = log_probability_of_contending * (contender_count / len(contending))
    probability_below = np.exp(log_probability)
    interval_probability = np.diff(probability_below)
    interval_probability /= interval_probability.sum()
    middle = 0.5 * (x[1:] + x[:-1])
    mean = float(interval_probability @ middle)
    spread = float(np.sqrt(interval_probability @ (middle - mean) ** 2))
    excess = max(0.0, mean - float(largest_true))
    return excess, float(np.hypot(spread, _RELATIVE_UNCERTAINTY * excess))


# Parametric bootstrap: the smoothed motion is taken as the truth, and logs of it are drawn with the errors estimated from the
# log and processed like the log. Their peaks differ from the truth like the log's peak: by the bias of smoothing, the residual
# noise, and the selection of the largest value.
# Source: Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapters 6 and 10.

_MAX_DRAWS = 128
"""Largest number of drawn logs."""
_MIN_DRAWS = 32
"""Smallest number of drawn logs, however many curves each has."""
_MAX_DRAWN_CURVES = 4096
"""Number of curves of all drawn logs above which fewer logs are drawn."""
_BIAS_SHARE = 0.8
"""Share of the drawn bias that is added as a standard deviation.

Smoothing flattens the true peak, and it flattens the noise that is left in the smoothed motion. If noise dominates, the second
effect is larger and has the opposite sign: errors are then -1.3 times the drawn bias, on logs of known motions. The bias is
therefore an error of unknown sign and is not subtracted. Intervals of 95 % were compared with 844 such peaks. They contain 94 %
of them without the bias (91 % if only stamps have errors), 98 % (96 %) with this share, and 99 % with a share of √2."""
INTERVAL = 1.96
"""Half-width of a 95 % confidence interval in standard deviations."""
_RANDOM_STREAM = 8
"""Seed of the draws."""
_SMOOTHING_REACH = 16.0
"""Distance in samples, in units of strength^(1/6), beyond which a sample changes a smoothed value by less than 1e-3."""
_SPLINE_REACH = 24
"""Distance in samples beyond which a sample does not change the derivative of a spline noticeably."""
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
        """Number of rows of a run, in which noise is correlated."""
        strengths = self.differentiation.strengths[self.differentiation.strengths > 0]
        if not strengths.size:  # nothing is smoothed
            return 1
        smoothing_width = float(strengths.min()) ** (1 / 6)
        return max(1, round(_CELL * smoothing_width))

    @property
    def _reach(self) -> int:
        """Number of rows on either side of a peak that are drawn."""
        smoothing_width = float(self.differentiation.strengths.max(initial=0.0)) ** (1 / 6)
        return math.ceil(_SMOOTHING_REACH * smoothing_width) + _SPLINE_REACH + self.cell

    def estimate(
        self, joint: int, peaks: Extrema, contenders: Array, runs: int, steady: float, speed: float
    ) -> PeakEstimate:
        """Peak torque of a joint, corrected by draws from a fixed seed.

        Runs of its torque have maxima, of which ``contenders`` (k,) are the largest and ``runs`` is the number. ``steady``
        is the part of the peak that is independent of accelerations, and ``speed`` is the largest velocity.
        """
        log = self.differentiation.trajectory
        peak_row = int(np.searchsorted(log.table[:, 0], peaks.time[joint]))
        first_row = max(0, peak_row - self._reach)
        motion = log.motion(log.table[first_row : peak_row + self._reach + 1])
        peak = peak_row - first_row  # row in the motion
        near_peak = slice(max(0, peak - self.cell), peak + self.cell + 1)
        sign = -1.0 if peaks.signed[joint] < 0 else 1.0
        bias, drawn_sigma, speed_sigma = self._peak_statistics(motion, near_peak, joint, sign)
        excess, spread = excess_of_largest(contenders, drawn_sigma, runs)
        largest = float(peaks.value[joint])
        sigma = math.hypot(spread, _BIAS_SHARE * bias)
        # Only the part due to accelerations is noisy. If the excess is larger, the peak is somewhere between the bounds
        # least and largest.
        least = min(max(0.0, sign * steady), largest)
        if largest - excess < least:
            excess = largest - least
            sigma = max(sigma, excess / INTERVAL)
        return PeakEstimate(sign * (largest - excess), sigma, speed, speed_sigma)

    def _peak_statistics(
        self, motion: LogRows, near_peak: slice, joint: int, sign: float
    ) -> tuple[float, float, float]:
        """Bias and standard deviation of the peak near some rows, and standard deviation of the velocity there."""
        d = self.differentiation
        t = motion.time
        true_curves = d.smooth(t, d.curves(motion))
        curve_count = true_curves.shape[1]
        affordable_count = _MAX_DRAWN_CURVES // max(1, curve_count)
        draw_count = min(_MAX_DRAWS, max(_MIN_DRAWS, affordable_count))
        true_rates, true_second_rates = spline_rates(t, true_curves)
        true_near_peak = [x[near_peak, :, None] for x in (true_curves, true_rates, true_second_rates)]
        true_torques, _ = self._torques(motion, near_peak, true_near_peak)
        true_peak = (sign * true_torques[:, :, joint]).max()
        rng = np.random.default_rng(_RANDOM_STREAM)
        curves = d.smooth(t, d.errors.drawn(rng, true_curves, true_rates, draw_count))
        rates, second_rates = spline_rates(t, curves.reshape(len(t), -1))
        drawn_near_peak = [x.reshape(len(t), curve_count, draw_count)[near_peak] for x in (curves, rates, second_rates)]
        drawn_torques, dq = self._torques(motion, near_peak, drawn_near_peak)
        drawn_peaks = (sign * drawn_torques[:, :, joint]).max(axis=0)
        bias = float(drawn_peaks.mean() - true_peak)
        middle_row = len(dq) // 2
        return bias, float(drawn_peaks.std(ddof=1)), float(dq[middle_row, :, joint].std(ddof=1))

    def _torques(self, motion: LogRows, rows: slice, curves_and_rates: list[Array]) -> tuple[Array, Array]:
        """Torques and velocities (n, count, nv) of drawn logs in some rows of a motion.

        ``curves_and_rates`` are their smoothed curves (n, k, count) with first and second derivatives. Curves are
        coordinates, or velocities if the motion has logged velocities.
        """
        d = self.differentiation
        smoothed_curves, _, _ = curves_and_rates
        n, _, count = smoothed_curves.shape
        curves, rates, second_rates = (np.moveaxis(x, 1, 2).reshape(n * count, -1) for x in curves_and_rates)

        def repeat_logged(values: Array) -> Array:
            return np.repeat(values[rows], count, axis=0)

        if motion.dq is None:
            q = curves
            dq, ddq = joint_rates(d.model, q, rates, second_rates)
            if motion.ddq is not None:
                ddq = repeat_logged(motion.ddq)
        else:
            q, dq, ddq = repeat_logged(motion.q), curves, rates
        stationary = np.zeros(dq.shape, bool)
        if d.derives_velocities:
            stationary = np.abs(dq) <= SIGNIFICANT_SIGMAS * d.sigma_dq
        time = np.repeat(motion.time[rows], count)
        no_outliers = np.zeros((n * count, 0))
        torques = self.load.torques(MotionSamples(time, q, dq, ddq, q, stationary, no_outliers))
        torques = self.load.drive_torques(torques)
        return torques.reshape(n, count, -1), dq.reshape(n, count, -1)
