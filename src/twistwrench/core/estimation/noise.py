"""Quality of a log, estimated from excerpts: time step, rounding grid, noise and late stamps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array

ORDERS = range(3, 9)
"""Orders of the differences that separate noise from motion."""
_MAX_DECIMALS = 11
"""Largest number of decimals of a grid."""
_MAX_ROUND_OFF = 4e-16
"""Largest ratio of noise to values that is the rounding error of computation."""
_MIN_NOISE_OF_GRID = 0.02
"""Smallest noise of values on a grid, as a share of the grid's rounding error q/√12.

Slow motions stay on each grid point for hundreds of samples, which hides most of the error.
"""
_GRID_STEPS = 1.5
"""Largest effect of rounding on a difference with unit-norm weights, in grid steps: √(m+1)/2 for the order m ≤ 8."""
_MAX_OUTLIER_SHARE = 0.02
"""Largest share of residuals that may be left out."""
_ROWS_OF_TWO_GLITCHES = 18
"""Largest number of residuals that may be left out of few: those that two glitches affect at the highest order."""
_MAX_ROUNDS = 20
"""Maximum number of rounds of rejection."""
_MIN_KINKS = 30
"""Minimum number of places without parabolic motion for a grid; kinks of planned motions are fewer."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Quality of some columns of a log, in the file's units."""

    step: float
    """Median time step [s]; nan for a single row."""
    quantum: Array
    """Grid of the values (columns,); 0 if not detected."""
    noise: Array
    """Standard deviation (columns,) from smooth motion; 0 for rounding errors and constant columns."""

    @property
    def error(self) -> Array:
        """Standard deviation (columns,) including slow errors: at least the rounding error of a grid."""
        return np.maximum(self.noise, self.quantum / math.sqrt(12.0))


def survey(times: Sequence[Array], parts: Sequence[Array], curves: Sequence[Array] | None = None) -> Survey:
    """Assess excerpts of consecutive rows: times (n,) and columns (n, columns), as in the file.

    ``curves`` are the same columns without jumps of wrapped angles and sign changes of quaternions. These jumps are not
    noise, and 2π is not on a grid.
    """
    if curves is None:
        curves = parts
    steps = np.concatenate([np.diff(t) for t in times])
    median_step = float(np.median(steps)) if steps.size else math.nan
    quanta = np.array([quantum([x[:, k] for x in parts]) for k in range(parts[0].shape[1])], float)
    moves = np.any([np.ptp(x, axis=0) > 0 for x in parts if len(x)], axis=0)
    sigma = np.where(moves, noise(times, curves, quanta), 0.0)
    # Rounding to a grid causes noise. Without noise, equal steps come from the motion, such as a constant speed.
    has_grid = sigma > _MIN_NOISE_OF_GRID * quanta / math.sqrt(12.0)
    return Survey(median_step, np.where(has_grid, quanta, 0.0), sigma)


def quantum(parts: Sequence[Array]) -> float:
    """Grid of a column's values: a power of ten, or the smallest step of an encoder; 0 if none is detected.

    At constant speed or acceleration, all increments are multiples of one value too; this is not a grid. So the column must
    have enough kinks, where third differences are large.
    """
    values = np.concatenate(parts)
    size = float(np.abs(values).max(initial=0.0))
    increments = np.concatenate([np.abs(np.diff(part)) for part in parts])
    increments = increments[increments > 1e-13 * size]
    if increments.size == 0:
        return 0.0
    grid = max(_common_step(increments), _decimal_grid(values, size))
    kinks = sum(int((np.abs(np.diff(part, 3)) > 0.5 * grid).sum()) for part in parts)
    if kinks >= _MIN_KINKS:
        return grid
    return 0.0


def _decimal_grid(values: Array, size: float) -> float:
    """Coarsest power of ten of which all values are multiples; 0 without one."""
    for decimals in range(_MAX_DECIMALS + 1):
        scale = 10.0**decimals
        scaled = values * scale
        if (np.abs(np.round(scaled) - scaled) <= 8e-16 * max(size * scale, 1.0)).all():
            return 10.0**-decimals
    return 0.0


def _common_step(increments: Array) -> float:
    """Smallest increment, if there are enough small ones and nearly all are multiples of it; else 0."""
    smallest = float(increments.min())
    ratios = increments[increments < 20 * smallest] / smallest
    is_multiple = np.abs(ratios - np.round(ratios)) < 0.05
    if ratios.size < 30 or is_multiple.mean() < 0.98:
        return 0.0
    return float(np.median(increments[increments < 1.5 * smallest]))


def noise(times: Sequence[Array], parts: Sequence[Array], quanta: Array | float = 0.0) -> Array:
    """Standard deviation of white noise on smooth motion, from high divided differences; excerpts (n, k) → (k,).

    A difference of order m annihilates polynomials below degree m. With unit-norm weights it keeps the variance of
    white noise. The contribution of smooth motion decreases with the order, so the minimum over several orders is used.
    A few glitches do not count as noise, but steps of the columns' grids ``quanta`` (k,) do.
    """
    size = np.max([np.abs(x).max(axis=0, initial=0.0) for x in parts], axis=0)
    grid_effect = _GRID_STEPS * np.asarray(quanta)
    sigma = np.full(parts[0].shape[1], np.inf)
    for order in ORDERS:
        residuals = [differences(t, x, order) for t, x in zip(times, parts, strict=True) if len(t) > order]
        if residuals:
            sigma = np.minimum(sigma, deviation(np.concatenate(residuals), grid_effect))
    is_noise = np.isfinite(sigma) & (sigma > _MAX_ROUND_OFF * size)
    return np.asarray(np.where(is_noise, sigma, 0.0))


def deviation(residuals: Array, floor: Array) -> Array:
    """Standard deviation (k,) of residuals (n, k); those beyond both 5 deviations and ``floor`` (k,) are rejected in rounds."""
    squares = residuals**2
    mean_square = np.mean(squares, axis=0)
    variance = mean_square
    has_larger_noise = np.zeros(variance.shape, bool)
    max_outliers = max(_MAX_OUTLIER_SHARE * len(residuals), min(_ROWS_OF_TWO_GLITCHES, len(residuals) / 8))
    for _ in range(_MAX_ROUNDS):
        inliers = squares <= np.maximum(25.0 * variance, floor**2)
        if inliers.all():
            break
        variance = np.where(inliers, squares, 0.0).sum(axis=0) / np.maximum(1, inliers.sum(axis=0))
        # Many large residuals are not glitches but a second, larger noise; the accuracy follows from both.
        has_larger_noise |= (~inliers).sum(axis=0) > max_outliers
        variance = np.where(has_larger_noise, mean_square, variance)
    return np.asarray(np.sqrt(variance))


def differences(t: Array, x: Array, order: int) -> Array:
    """Divided differences (n - order, k) of x (n, k) at times t (n,), with weights of unit norm.

    The weight of sample j in a window of order + 1 samples is 1 / Π_{i≠j} (t_j - t_i), up to a common factor.
    """
    window_t = np.lib.stride_tricks.sliding_window_view(t, order + 1) - t[: len(t) - order, None]
    window_t = window_t / window_t[:, -1:]  # from 0 to 1
    gaps = window_t[:, :, None] - window_t[:, None, :]
    diagonal = np.arange(order + 1)
    gaps[:, diagonal, diagonal] = 1.0
    weights = 1.0 / gaps.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    n = len(weights)
    return np.asarray(sum(weights[:, j, None] * x[j : j + n] for j in range(order + 1)))


# ── Errors of samples: noise, rounding, and stamps

_MAX_GROUPS = 16
"""Maximum number of groups of rows with similar speeds."""
_MIN_ROWS_PER_GROUP = 60
"""Minimum number of rows of a group."""


@dataclass(frozen=True, eq=False)
class SampleErrors:
    """Errors of some columns, (k,) each, in the columns' units.

    Model of a sample at time t: ``round(x(t + e) + n)`` with white noise n, an error e of the stamp (common to all
    columns of a row), and rounding to a grid.
    """

    white: Array
    """Standard deviation of n."""
    grid: Array
    """Grid step; 0 without a grid."""
    stamp: Array
    """Standard deviation of e [s], as each column shows it."""

    def scaled(self, factors: Array) -> SampleErrors:
        """Errors in other units: ``factors`` (k,) convert numbers of the columns to them."""
        return SampleErrors(self.white * factors, self.grid * factors, self.stamp)

    @property
    def at_rest(self) -> Array:
        """Standard deviation (k,) of a sample at rest."""
        return np.sqrt(self.white**2 + self.grid**2 / 12.0)

    def deviation(self, speed: Array) -> Array:
        """Standard deviation (n, k) of samples that move at a speed (n, k)."""
        return np.asarray(np.sqrt(self.at_rest**2 + (self.stamp * speed) ** 2))

    def drawn(self, rng: np.random.Generator, curve: Array, speed: Array, count: int) -> Array:
        """Random samples (n, k, count): ``count`` logs of a curve (n, k) with the speeds ``speed`` (n, k)."""
        n = len(curve)
        samples = np.repeat(curve[:, :, None], count, axis=2)
        if self.stamp.any():
            samples += rng.normal(size=(n, 1, count)) * (self.stamp * speed)[:, :, None]
        for column in np.flatnonzero(self.white).tolist():
            samples[:, column] += self.white[column] * rng.normal(size=(n, count))
        for column in np.flatnonzero(self.grid).tolist():
            step = self.grid[column]
            offset = step * rng.uniform(-0.5, 0.5, count)  # random position of the grid relative to the curve
            samples[:, column] = np.round((samples[:, column] + offset) / step) * step - offset
        return samples


def sample_errors(times: Sequence[Array], curves: Sequence[Array], survey: Survey) -> SampleErrors:
    """Errors of columns (n, k) on smooth curves, from excerpts of consecutive rows.

    High-order differences isolate the errors. Their variance as a function of speed, a + b speed², separates noise and
    errors of stamps.
    """
    white = np.zeros(len(survey.noise))
    stamp = np.zeros(len(survey.noise))
    for k in np.flatnonzero(survey.noise).tolist():
        grid = float(survey.quantum[k])
        isolated = _isolate_errors(times, [x[:, k] for x in curves], grid)
        if isolated is not None:
            a, b = _split_variance(*isolated, rounding=grid**2 / 12.0)
            white[k], stamp[k] = math.sqrt(a), math.sqrt(b)
        else:
            white[k] = math.sqrt(max(0.0, survey.noise[k] ** 2 - grid**2 / 12.0))
    return SampleErrors(white, survey.quantum.copy(), stamp)


def _isolate_errors(times: Sequence[Array], parts: Sequence[Array], grid: float) -> tuple[Array, Array] | None:
    """Differences (n,) of the order least affected by motion, and speeds (n,); None for short excerpts.

    Differences have weights of unit norm, and so the standard deviation of the samples.
    """
    isolated = None
    smallest_sigma = math.inf
    for order in ORDERS:
        excerpts = [(t, x) for t, x in zip(times, parts, strict=True) if len(t) > order]
        difference_count = sum(len(t) - order for t, _ in excerpts)
        if difference_count < _MIN_ROWS_PER_GROUP:
            return isolated
        errors = np.concatenate([differences(t, x[:, None], order)[:, 0] for t, x in excerpts])
        sigma = float(deviation(errors[:, None], np.array([_GRID_STEPS * grid]))[0])
        if sigma < smallest_sigma:
            speed = np.concatenate([(x[order:] - x[:-order]) / (t[order:] - t[:-order]) for t, x in excerpts])
            isolated = errors, speed
            smallest_sigma = sigma
    return isolated


def _split_variance(errors: Array, speed: Array, *, rounding: float) -> tuple[float, float]:
    """Nonnegative a and b of the variance a + rounding + b speed² of differences (n,), by weighted least squares of groups."""
    from scipy.optimize import lsq_linear

    group_count = max(1, min(_MAX_GROUPS, len(errors) // _MIN_ROWS_PER_GROUP))
    groups = np.array_split(np.argsort(np.abs(speed), kind="stable"), group_count)
    floor = np.array([_GRID_STEPS * math.sqrt(12.0 * rounding)])
    variance = np.array([float(deviation(errors[rows, None], floor)[0]) ** 2 for rows in groups])
    square_speed = np.array([float(np.mean(speed[rows] ** 2)) for rows in groups])
    largest_square = float(square_speed.max()) or 1.0  # 1 at rest
    A = np.stack([np.ones(len(groups)), square_speed / largest_square], axis=1)
    y = np.maximum(variance - rounding, 0.0)
    least_scale = 0.02 * float(variance.mean()) + 1e-300  # a rest without noise must not outweigh the motion
    scale = np.maximum(variance, least_scale)
    x = np.zeros(2)
    for _ in range(3):  # the error of a variance is proportional to the variance, which each round knows better
        x = lsq_linear(A / scale[:, None], y / scale, (0.0, math.inf), method="bvls").x
        scale = np.maximum(np.maximum(A @ x + rounding, 0.1 * variance), least_scale)
    return float(x[0]), float(x[1] / largest_square)
