"""Scale and delay of logged rates relative to the curves whose slopes they are."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..typing import Array
from .sampling import pauses

_MAX_ROWS = 512
"""Largest number of rows for integrating a rate, so that its bias adds up to little."""
_MIN_ROWS = 8
"""Smallest number of rows for integrating a rate."""
_MIN_RATIO_TO_NOISE, _MIN_STEPS = 100.0, 30.0
"""A curve moves if its variance exceeds that of its white noise, and its range its least step, by these factors. An
encoder at rest that flickers by a count or two does not move.
"""
_MAX_ROUNDING, _MAX_ROUNDING_SHARE = 1e-10, 1e-9
"""Range [rad, m, 1/s of them], and share of the largest range, that may be rounding."""
_MAX_ALIASING = 0.05
"""Largest relative change of a summed rate's squares when every other row is left out."""
_MIN_SPEED_SHARE = 0.02
"""Share of the fastest curve's speed below which a curve's rate is irrelevant."""
_MIN_MOTION_OF_RATE = 0.2
"""Minimum range [rad, m] of an integrated rate that contradicts a curve at rest."""
_MAX_MOTION_AT_REST = 0.02
"""Largest range of a curve at rest, as a share of the range of its integrated rate."""


def segments(time: Array) -> list[slice]:
    """Runs of 8 to 512 rows without gaps in time."""
    if len(time) < _MIN_ROWS:
        return []
    edges = sorted({*(pauses(time) + 1).tolist(), *range(0, len(time), _MAX_ROWS), len(time)})
    return [slice(a, b) for a, b in pairwise(edges) if b - a >= _MIN_ROWS]


def rate_scales(runs: Sequence[tuple[Array, Array, Array]], kinds: Array) -> Array:
    """Scale (k,) of rates y over the slopes of curves x, by least squares on ∫y dt; runs are (t, x, y).

    It is 1 if they agree or it is undetermined, inf if y moves and x does not. Speeds are compared among curves of one
    kind, as given by ``kinds`` (k,), because units differ.
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
    extent, integral_extent, speed = np.max(maxima, axis=0)
    moves = (xx > _MIN_RATIO_TO_NOISE * noise) & (extent > _MIN_STEPS * np.min(steps, axis=0))
    for kind in np.unique(kinds):
        columns = kinds == kind
        moves[columns] &= speed[columns] >= _MIN_SPEED_SHARE * speed[columns].max(initial=0.0)
    moves &= extent > max(_MAX_ROUNDING, _MAX_ROUNDING_SHARE * float(extent.max(initial=0.0)))
    moves &= aliasing <= _MAX_ALIASING * yy
    gain = np.where(moves, xy / np.where(moves, xx, 1.0), 1.0)
    rests = ~moves & (integral_extent > _MIN_MOTION_OF_RATE) & (extent < _MAX_MOTION_AT_REST * integral_extent)
    return np.where(rests, np.inf, gain)


def _statistics(time: Array, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Sums (5, k), largest numbers (3, k) and least steps (k,) of one segment."""
    integral, extent, moved = _integral(time, y), np.ptp(x, axis=0), np.abs(np.diff(x, axis=0))
    # Integrate every other row for comparison: samples do not resolve a rate that changes from row to row.
    coarser = _integral(time[::2], y[::2]) - integral[::2]
    a, b = x - x.mean(axis=0), integral - integral.mean(axis=0)
    noise = np.sum(np.diff(x, 2, axis=0) ** 2, axis=0) / 6.0
    sums = np.stack(
        [(a * a).sum(axis=0), (a * b).sum(axis=0), (b * b).sum(axis=0), noise, 2.0 * (coarser**2).sum(axis=0)]
    )
    maxima = np.stack([extent, np.ptp(integral, axis=0), extent / (time[-1] - time[0])])
    return sums, maxima, np.where(moved > 0, moved, np.inf).min(axis=0)


def _integral(time: Array, y: Array) -> Array:
    """∫y dt by the trapezoidal rule, starting at 0."""
    sums = np.cumsum(0.5 * np.diff(time)[:, None] * (y[1:] + y[:-1]), axis=0)
    return np.concatenate([np.zeros((1, y.shape[1])), sums])


# ── Delay of a logged rate relative to its curve

_LAGS = np.linspace(-0.6, 0.6, 97)
"""Delays to be tested [s]."""
_STEP, _MIN_RUN = 0.005, 1.5
"""Time between compared rows, and shortest length of a run [s]."""
_MIN_DELAY, _MIN_DELAY_IN_STEPS = 0.04, 2.0
"""Smallest reported delay in s and in time steps; filters of drives, and stamps per control cycle, cause less."""
_MAX_SHARE_LEFT, _MIN_SHARE_OF_SQUARES = 0.25, 2e-4
"""Largest share of the squares left by a valid delay, and smallest relevant share of the curve's squares."""
_MAX_SHARE_OF_EQUALS = 1e-3
"""Tolerance, as a share of the squares, for equally good delays. The shortest of them is used; repeating motions have
several.
"""
_MIN_EXTENT = 0.05
"""Smallest range [rad, m] of a curve about its trend for a comparison."""


def rate_delays(runs: Sequence[tuple[Array, Array, Array]], count: int) -> Array:
    """Delay d (k,) [s] of rates y of curves x with y(t) = x'(t - d), by least squares on ∫y dt; 0 if undetermined.

    Runs are time (n,), x (n, k) without jumps and y (n, k). Mean and trend of both are removed in each run without
    gaps, so that a bias of y has no effect.
    """
    errors, squares, extent, longest_step = np.zeros((len(_LAGS), count)), np.zeros(count), np.zeros(count), 0.0
    for t, x, y in runs:
        steps = np.diff(t)
        if not len(steps):
            continue
        usual_step = float(np.median(steps))
        longest_step = max(longest_step, usual_step)
        integral, stride = _integral(t, y), max(1, round(_STEP / usual_step))
        edges = [0, *(pauses(t) + 1).tolist(), len(t)]
        for a, b in pairwise(edges):
            comparison = _residuals_by_lag(t[a:b:stride], x[a:b:stride], integral[a:b:stride])
            if comparison is not None:
                curves, residuals = comparison
                errors += residuals
                squares += np.sum(curves**2, axis=0)
                extent = np.maximum(extent, np.ptp(curves, axis=0))
    best = _shortest_lag(errors, squares)
    columns = np.arange(count)
    undelayed, delayed = errors[len(_LAGS) // 2], errors[best, columns]
    determined = (best > 0) & (best < len(_LAGS) - 1) & (extent > _MIN_EXTENT)
    determined &= (delayed < _MAX_SHARE_LEFT * undelayed) & (undelayed > _MIN_SHARE_OF_SQUARES * squares)
    determined &= np.abs(_LAGS[best]) >= max(_MIN_DELAY, _MIN_DELAY_IN_STEPS * longest_step)
    before, centre, after = (errors[np.clip(best + k, 0, len(_LAGS) - 1), columns] for k in (-1, 0, 1))
    curvature = before - 2.0 * centre + after  # of the parabola through the least error and its neighbours
    correction = np.where(curvature > 0, 0.5 * (before - after) / np.where(curvature > 0, curvature, 1.0), 0.0)
    return np.where(determined, _LAGS[best] + correction * (_LAGS[1] - _LAGS[0]), 0.0)


def _shortest_lag(errors: Array, squares: Array) -> Array:
    """Index (k,) of the shortest of the delays that are equally good minima of the errors (lags, k)."""
    padded = np.pad(errors, ((1, 1), (0, 0)), constant_values=np.inf)
    minima = (errors <= padded[:-2]) & (errors <= padded[2:])
    minima &= errors <= errors.min(axis=0) + _MAX_SHARE_OF_EQUALS * squares
    return np.where(minima, np.abs(_LAGS)[:, None], np.inf).argmin(axis=0)


def _residuals_by_lag(t: Array, x: Array, integral: Array) -> tuple[Array, Array] | None:
    """Curves (n, k) of one run without mean and trend, and residual squares (lags, k) by lag; None for short runs."""
    used = (t >= t[0] - _LAGS[0]) & (t <= t[-1] - _LAGS[-1])
    if t[-1] - t[0] < _MIN_RUN or used.sum() < len(_LAGS):
        return None
    basis = np.linalg.qr(np.stack([np.ones(used.sum()), t[used] - t[0]], axis=1))[0]
    curves = _without_trend(basis, x[used])
    residuals = np.empty((len(_LAGS), x.shape[1]))
    for k, lag in enumerate(_LAGS):
        shifted = np.stack([np.interp(t[used] + lag, t, column) for column in integral.T], axis=1)
        residuals[k] = np.sum((_without_trend(basis, shifted) - curves) ** 2, axis=0)
    return curves, residuals


def _without_trend(basis: Array, x: Array) -> Array:
    return np.asarray(x - basis @ (basis.T @ x))
