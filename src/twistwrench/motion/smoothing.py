"""Smoothing of noisy logs by penalised least squares: near the samples, with a third derivative no larger than needed.

The smoothed z minimises |x - z|² + strength |D z|², D the third divided differences in units of the usual time step h;
on a uniform grid a component of angular frequency w comes out 1/(1 + strength (2 sin(w h/2))^6) times as large.
Source: Whittaker, "On a new method of graduation", Proc. Edinburgh Math. Soc. 41, 1923.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from ..typing import Array

_STRENGTHS = 10.0 ** np.arange(-1.0, 15.01, 0.5)
_MOST_MARGIN = 16384
_FAR, _NEAR, _REACH, _FEW = 6.0, 10.0, 5, 0.01
"""A glitch is that many standard deviations off the curve of strength ``_NEAR``, more than ``_REACH`` samples on either
side are, and there are few: else it is the motion that is fast."""
_MOST_ALIKE = 10.0
_MOST_PASSED, _MOST_RISK = 0.95, 4.0
"""Most of the noise that a smoother may pass and still count, and most mean square of what it takes off, with twice the
noise that it passes, in units of the noise's variance: 2 for no smoother, and as much again since that is an estimate."""
_DECAY = 28.0
"""exp(-28) < 1e-12: what is left of a sample's influence beyond the margin."""


def smooth(t: Array, x: Array, strength: float, step: float) -> Array:
    """The smoothed values of one column, or of several alike; t (n,), x (n,) or (n, k) → as x.

    ``step`` is the usual time step.
    """
    if strength == 0.0 or len(x) < 4:
        return x.copy()
    from scipy.linalg import solveh_banded

    D = _third_differences(t, step)
    # Solved for the correction, u in x - z = D' u, and not for z: then rounding hurts the small correction only.
    bands = np.zeros((4, len(D)))  # upper form of D D' + 1/strength
    for k in range(4):
        bands[3 - k, k:] = np.sum(D[k:, : 4 - k] * D[: len(D) - k, k:], axis=1)
    bands[3] += 1.0 / strength
    weights = D.reshape(*D.shape, *[1] * (x.ndim - 1))
    u = solveh_banded(bands, _apply(weights, x), check_finite=False, overwrite_ab=True)
    z = x.copy()
    for k in range(4):
        z[k : k + len(u)] -= weights[:, k] * u
    return z


def _third_differences(t: Array, step: float) -> Array:
    """Rows of D as their four weights (n-3, 4); (-1, 3, -3, 1) on a uniform grid of that step."""
    t = np.lib.stride_tricks.sliding_window_view(t, 4) / step
    gaps = t[:, :, None] - t[:, None, :]
    gaps[:, np.arange(4), np.arange(4)] = 1.0
    span = (t[:, 3] - t[:, 0])[:, None] / 3.0
    return np.asarray(6.0 / gaps.prod(axis=2) * np.sqrt(span))


def _apply(D: Array, x: Array) -> Array:
    return np.asarray(sum(D[:, k] * x[k : k + len(D)] for k in range(4)))


def best_strength(
    times: Sequence[Array], parts: Sequence[Array], noise: float, step: float, grid: float = 0.0
) -> float:
    """The strength that leaves the least expected error of z, given about how large the noise is; 0 where none is better.

    Generalised cross-validation: the mean squared residual over the square of the share of noise that it holds. The noise
    of a short log is known to a fourth only, and that of late stamps lives in the few rows that are fast, so that
    Mallows' criterion, which asks for the noise itself, now and then smooths next to nothing. Rounding to a ``grid`` is
    not white where a slow motion keeps to a point of the grid for several samples: as many times as much of its variance
    passes then.
    Source: Craven and Wahba, "Smoothing noisy data with spline functions", Numer. Math. 31, 1979.
    """
    if noise == 0.0:
        return 0.0
    best, least = 0.0, math.inf
    alike = alike_samples(parts, grid, noise)
    parts = [_without_glitches(t, x, noise, step) for t, x in zip(times, parts, strict=True)]
    for strength in _STRENGTHS:
        if margin_of(float(strength)) > _MOST_MARGIN:
            break
        pairs = list(zip(times, parts, strict=True))
        squares = sum(float(np.sum((x - smooth(t, x, float(strength), step)) ** 2)) for t, x in pairs)
        mean = squares / sum(len(x) for x in parts)
        passed = min(_MOST_PASSED, alike * _passed(float(strength)))
        if mean + 2.0 * noise**2 * passed > _MOST_RISK * noise**2:
            continue  # the motion is too fast for that
        risk = mean / (1.0 - passed) ** 2
        if risk < least:
            best, least = float(strength), risk
    return best


def alike_samples(parts: Sequence[Array], grid: float, noise: float) -> float:
    """How many samples in a row share one rounding error, in the mean over those that move; 1 to 10, and 1 without a grid.

    A slow motion keeps to a point of the grid for many samples. Beyond ten the motion is so slow that stairs are all there
    is to see. Of the whole ``noise``, only what rounding makes of it counts.
    """
    if grid == 0.0 or noise == 0.0:
        return 1.0
    rounding = min(1.0, grid**2 / 12.0 / noise**2)
    total = weighted = 0.0
    for x in parts:
        steps = np.diff(x)
        jumps = np.flatnonzero(np.abs(steps) > 0.5 * grid)
        climbs = steps[jumps[1:]] * steps[jumps[:-1]] > 0  # up and up, or down and down: a whole step is passed
        between = np.diff(jumps)[climbs].astype(float)
        total, weighted = total + float(between.sum()), weighted + float((between**2).sum())
    length = min(_MOST_ALIKE, max(1.0, weighted / total)) if total else 1.0
    return 1.0 + (length - 1.0) * rounding


def _without_glitches(t: Array, x: Array, noise: float, step: float) -> Array:
    """The column with lone samples far off replaced by what lies between their neighbours.

    One glitch shall not keep its whole column from being smoothed.
    """
    from scipy.ndimage import maximum_filter1d

    for _ in range(2):
        size = np.abs(x - smooth(t, x, _NEAR, step))
        far = (size > _FAR * noise) & (size >= maximum_filter1d(size, 2 * _REACH + 1, mode="nearest"))
        if not 0 < np.count_nonzero(far) <= max(2, _FEW * len(x)):
            break
        x = np.where(far, np.interp(t, t[~far], x[~far]), x)
    return x


@cache
def _passed(strength: float) -> float:
    """The mean over all frequencies of what the smoother passes; 1 at strength 0."""
    w = (np.arange(20000) + 0.5) * (math.pi / 20000)
    return float(np.mean(1.0 / (1.0 + strength * (2.0 * np.sin(w / 2)) ** 6)))


def margin_of(strength: float) -> int:
    """Samples after which the influence of one on another is below 1e-12, on a uniform grid."""
    # The slowest pole of 1/(1 + strength w^6) decays by exp(-½ strength^(-1/6)) a sample.
    return math.ceil(2.0 * _DECAY * math.pow(max(strength, 1e-3), 1.0 / 6.0)) + 16
