"""Outliers of a log: samples far from the smoothed curve of their column."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.estimation.least_squares import MAD
from ..core.typing import Array
from .smoothing import smooth

_MIN_SIGMAS = 6.0
"""Standard deviations about the smoothed curve from which a sample is an outlier."""


@dataclass(frozen=True)
class Outlier:
    """Outliers of one column."""

    column: int
    """Index among the smoothed columns."""
    count: int
    time: float
    """Time of the largest outlier [s]."""
    sigmas: float
    """Largest signed residual in standard deviations."""
    off: float
    """Largest signed residual in SI units."""
    matters: bool = True
    """True if any outlier may be a torque beyond a limit."""


def outliers_of(found: Array) -> tuple[Outlier, ...]:
    """Outliers by column, largest first.

    ``found`` (m, 5) has an outlier in each row: column, time, residual in standard deviations and in SI units, and 1 if it
    may be a torque beyond a limit.
    """
    outliers = []
    for k in np.unique(found[:, 0]).tolist():
        rows = found[found[:, 0] == k]
        _, time, sigmas, residual, _ = rows[np.abs(rows[:, 2]).argmax()].tolist()
        outliers.append(Outlier(int(k), len(rows), time, sigmas, residual, bool(rows[:, 4].any())))
    return tuple(sorted(outliers, key=lambda outlier: -abs(outlier.sigmas)))


def outlier_residuals(residual: Array, spread: Array, strengths: Array) -> Array:
    """Residuals (n, k, 2) over their spread, and in SI units; nonzero only for local maxima beyond 6 deviations."""
    from scipy.ndimage import maximum_filter1d

    outliers = np.zeros((*residual.shape, 2))
    for k in np.flatnonzero(spread.any(axis=0) & (strengths > 0)).tolist():
        sigmas = residual[:, k] / spread[:, k]
        size = np.abs(sigmas)
        if not (size > _MIN_SIGMAS).any():
            continue
        # A glitch attracts the curve, so its neighbours also deviate from the curve, by less than half as much.
        reach = 2 * math.ceil(3.0 * strengths[k] ** (1 / 6)) + 1
        is_outlier = (size > _MIN_SIGMAS) & (size > 0.5 * maximum_filter1d(size, reach, mode="nearest"))
        outliers[is_outlier, k, 0] = sigmas[is_outlier]
        outliers[is_outlier, k, 1] = residual[is_outlier, k]
    return outliers


def residual_spread(
    times: Sequence[Array], parts: Sequence[Array], strengths: Array, step: float, least: Array
) -> Array:
    """Robust standard deviation (k,) of samples about the smoothed curve, at least ``least``; 0 without smoothing."""
    spread = np.zeros(len(strengths))
    for k in np.flatnonzero(strengths).tolist():
        strength = float(strengths[k])
        residuals = [x[:, k] - smooth(t, x[:, k], strength, step) for t, x in zip(times, parts, strict=True)]
        spread[k] = max(MAD * float(np.median(np.abs(np.concatenate(residuals)))), float(least[k]))
    return spread
