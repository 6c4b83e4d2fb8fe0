"""Scale and delay of logged rates relative to the curves whose slopes they should be.

In a log, curves are positions or velocities, and their rates are the columns of velocities or accelerations. A rate is
integrated and compared with its curve, because differences of the curve would amplify noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..typing import Array
from .sampling import pauses

_MAX_ROWS = 512
"""Largest number of rows over which a rate is integrated, so that its bias adds up to little."""
_MIN_ROWS = 8
"""Smallest number of rows over which a rate is integrated."""
_MIN_RATIO_TO_NOISE = 100.0
"""Smallest ratio of the variance of a moving curve to the variance of its white noise."""
_MIN_STEPS = 30.0
"""Smallest ratio of the range of a moving curve to its least step; an encoder at rest may flicker by a count or two."""
_MAX_ROUNDING = 1e-10
"""Largest range of a curve that may be rounding errors [rad or m; for velocities, rad/s or m/s]."""
_MAX_ROUNDING_SHARE = 1e-9
"""Largest range of a curve that may be rounding errors, as a share of the largest range of all curves."""
_MAX_ALIASING = 0.05
"""Largest relative change of the integral's squares when every other row is left out."""
_MIN_SPEED_SHARE = 0.02
"""Smallest mean speed of a curve whose rate is judged, as a share of the mean speed of the fastest curve."""
_MIN_MOTION_OF_RATE = 0.2
"""Minimum range [rad, m] of an integrated rate that contradicts a curve at rest."""
_MAX_MOTION_AT_REST = 0.02
"""Largest range of a curve at rest, as a share of the range of its integrated rate."""


def segments(time: Array) -> list[slice]:
    """Segments of :data:`_MIN_ROWS` to :data:`_MAX_ROWS` rows without gaps in time."""
    if len(time) < _MIN_ROWS:
        return []
    rows_after_gaps = (pauses(time) + 1).tolist()
    edges = sorted({*rows_after_gaps, *range(0, len(time), _MAX_ROWS), len(time)})
    return [slice(first, end) for first, end in pairwise(edges) if end - first >= _MIN_ROWS]


def rate_scales(runs: Sequence[tuple[Array, Array, Array]], kinds: Array) -> Array:
    """Scale (k,) of rates y over the slopes of curves x, by least squares on ∫y dt; runs are (t, x, y).

    The scale is 1 if rates and slopes agree, or if it is undetermined. It is inf if ∫y dt moves and x does not. Speeds are
    compared only among curves with the same entry of ``kinds`` (k,), because units differ.
    """
    sums, maxima, steps = [], [], []
    for t, x, y in runs:
        for rows in segments(t):
            segment_sums, segment_maxima, least_steps = _statistics(t[rows], x[rows], y[rows])
            sums.append(segment_sums)
            maxima.append(segment_maxima)
            steps.append(least_steps)
    if not sums:
        return np.ones(len(kinds))
    xx, xy, yy, noise, aliasing = np.sum(sums, axis=0)
    x_range, integral_range, speed = np.max(maxima, axis=0)
    least_step = np.min(steps, axis=0)
    moves = (xx > _MIN_RATIO_TO_NOISE * noise) & (x_range > _MIN_STEPS * least_step)
    for kind in np.unique(kinds):
        is_of_kind = kinds == kind
        largest_speed = speed[is_of_kind].max(initial=0.0)
        moves[is_of_kind] &= speed[is_of_kind] >= _MIN_SPEED_SHARE * largest_speed
    max_rounding = max(_MAX_ROUNDING, _MAX_ROUNDING_SHARE * float(x_range.max(initial=0.0)))
    moves &= x_range > max_rounding
    moves &= aliasing <= _MAX_ALIASING * yy
    divisor = np.where(moves, xx, 1.0)
    scale = np.where(moves, xy / divisor, 1.0)
    rate_moves = integral_range > _MIN_MOTION_OF_RATE
    only_rate_moves = ~moves & rate_moves & (x_range < _MAX_MOTION_AT_REST * integral_range)
    return np.where(only_rate_moves, np.inf, scale)


def _statistics(time: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Sums (5, k), maxima (3, k) and least steps (k,) of one segment.

    With Y = ∫y dt, both without their means, the sums are Σ x², Σ x Y, Σ Y², Σ noise² and Σ aliasing². The maxima are the
    ranges of x and Y, and the mean speed of x. The least step is the smallest nonzero difference of x from row to row.
    """
    integral = _integral(time, y)
    # Comparison with the integral of every other row: samples do not resolve a rate that changes from row to row.
    aliasing = _integral(time[::2], y[::2]) - integral[::2]
    x_deviation = x - x.mean(axis=0)
    integral_deviation = integral - integral.mean(axis=0)
    sums = np.stack([
        (x_deviation * x_deviation).sum(axis=0),
        (x_deviation * integral_deviation).sum(axis=0),
        (integral_deviation * integral_deviation).sum(axis=0),
        np.sum(np.diff(x, 2, axis=0) ** 2, axis=0) / 6.0,  # second differences of white noise have 6 times its variance
        2.0 * (aliasing**2).sum(axis=0),  # twice, for half as many rows
    ])  # fmt: skip
    x_range = np.ptp(x, axis=0)
    maxima = np.stack([x_range, np.ptp(integral, axis=0), x_range / (time[-1] - time[0])])
    steps = np.abs(np.diff(x, axis=0))
    least_steps = np.where(steps > 0, steps, np.inf).min(axis=0)
    return sums, maxima, least_steps


def _integral(time: Array, y: Array) -> Array:
    """∫y dt by the trapezoidal rule (n, k), starting at 0."""
    sums = np.cumsum(0.5 * np.diff(time)[:, None] * (y[1:] + y[:-1]), axis=0)
    return np.concatenate([np.zeros((1, y.shape[1])), sums])


# ── Delay of a logged rate relative to its curve

_LAGS = np.linspace(-0.6, 0.6, 97)
"""Tested delays [s]; the one in the middle is 0."""
_ZERO_LAG = len(_LAGS) // 2
"""Index of the delay 0."""
_STEP = 0.005
"""Time between compared rows [s]."""
_MIN_RUN = 1.5
"""Shortest duration of a run [s]."""
# Filters of drives, and time stamps for each control cycle, cause delays smaller than these.
_MIN_DELAY = 0.04
"""Smallest reported delay [s]."""
_MIN_DELAY_IN_STEPS = 2.0
"""Smallest reported delay in time steps."""
_MAX_REMAINING_SHARE = 0.25
"""Largest residual squares with a valid delay, as a share of the residual squares without a delay."""
_MIN_SHARE_OF_SQUARES = 2e-4
"""Smallest residual squares without a delay that need an explanation, as a share of the curve's squares."""
_MAX_SHARE_OF_EQUALS = 1e-3
"""Delays are equally good if their residual squares differ by less than this share of the curve's squares.

The shortest of them is used; motions that repeat themselves have several.
"""
_MIN_EXTENT = 0.05
"""Smallest range [rad, m] of a curve about its trend for a comparison."""


def rate_delays(runs: Sequence[tuple[Array, Array, Array]], count: int) -> Array:
    """Delay d (k,) [s] of rates y of curves x with y(t) = x'(t - d), by least squares on ∫y dt; 0 if undetermined.

    Runs are time (n,), x (n, k) without jumps and y (n, k). Mean and trend of x and ∫y dt are removed in each part of a run
    without gaps, so that a bias of y has no effect.
    """
    residual_squares = np.zeros((len(_LAGS), count))
    curve_squares = np.zeros(count)
    curve_range = np.zeros(count)
    longest_step = 0.0
    for t, x, y in runs:
        steps = np.diff(t)
        if not len(steps):
            continue
        usual_step = float(np.median(steps))
        longest_step = max(longest_step, usual_step)
        integral = _integral(t, y)
        stride = max(1, round(_STEP / usual_step))
        edges = [0, *(pauses(t) + 1).tolist(), len(t)]
        for first, end in pairwise(edges):
            rows = slice(first, end, stride)
            comparison = _residuals_by_lag(t[rows], x[rows], integral[rows])
            if comparison is not None:
                curves, squares_by_lag = comparison
                residual_squares += squares_by_lag
                curve_squares += np.sum(curves**2, axis=0)
                curve_range = np.maximum(curve_range, np.ptp(curves, axis=0))
    best = _shortest_lag(residual_squares, curve_squares)
    columns = np.arange(count)
    squares_without_delay = residual_squares[_ZERO_LAG]
    squares_at_best = residual_squares[best, columns]
    last_lag = len(_LAGS) - 1
    is_inside = (best > 0) & (best < last_lag)  # a better lag may be beyond the outermost lags
    needs_explanation = squares_without_delay > _MIN_SHARE_OF_SQUARES * curve_squares
    is_determined = is_inside & (curve_range > _MIN_EXTENT)
    is_determined &= (squares_at_best < _MAX_REMAINING_SHARE * squares_without_delay) & needs_explanation
    is_determined &= np.abs(_LAGS[best]) >= max(_MIN_DELAY, _MIN_DELAY_IN_STEPS * longest_step)
    # The minimum of the parabola through the least squares and their neighbours, as an offset in steps of the lags.
    before = residual_squares[np.clip(best - 1, 0, last_lag), columns]
    after = residual_squares[np.clip(best + 1, 0, last_lag), columns]
    curvature = before - 2.0 * squares_at_best + after
    divisor = np.where(curvature > 0, curvature, 1.0)
    offset = np.where(curvature > 0, 0.5 * (before - after) / divisor, 0.0)
    return np.where(is_determined, _LAGS[best] + offset * (_LAGS[1] - _LAGS[0]), 0.0)


def _shortest_lag(residual_squares: Array, curve_squares: Array) -> Array:
    """Index (k,) of the shortest of the equally good delays, which are minima of the residual squares (lags, k)."""
    padded = np.pad(residual_squares, ((1, 1), (0, 0)), constant_values=np.inf)
    is_minimum = (residual_squares <= padded[:-2]) & (residual_squares <= padded[2:])
    max_squares = residual_squares.min(axis=0) + _MAX_SHARE_OF_EQUALS * curve_squares
    is_good = is_minimum & (residual_squares <= max_squares)
    lengths_of_good = np.where(is_good, np.abs(_LAGS)[:, None], np.inf)
    return lengths_of_good.argmin(axis=0)


def _residuals_by_lag(t: Array, x: Array, integral: Array) -> tuple[Array, Array] | None:
    """Curves (n, k) of one run without mean and trend, and residual squares (lags, k) by lag; None for short runs."""
    has_all_lags = (t >= t[0] - _LAGS[0]) & (t <= t[-1] - _LAGS[-1])  # rows whose shifted times are in the run
    if t[-1] - t[0] < _MIN_RUN or has_all_lags.sum() < len(_LAGS):
        return None
    times = t[has_all_lags]
    mean_and_trend = np.stack([np.ones(len(times)), times - t[0]], axis=1)
    basis, _ = np.linalg.qr(mean_and_trend)
    curves = _without_trend(basis, x[has_all_lags])
    squares = np.empty((len(_LAGS), x.shape[1]))
    for k, lag in enumerate(_LAGS):
        shifted_integral = np.stack([np.interp(times + lag, t, column) for column in integral.T], axis=1)
        residuals = _without_trend(basis, shifted_integral) - curves
        squares[k] = np.sum(residuals**2, axis=0)
    return curves, squares


def _without_trend(basis: Array, x: Array) -> Array:
    """Columns of x (n, k) without their components along the orthonormal columns of the basis (n, 2)."""
    return np.asarray(x - basis @ (basis.T @ x))
