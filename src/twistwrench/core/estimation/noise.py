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
_MAX_INCREMENT_ROUND_OFF = 1e-13
"""Largest ratio of an increment to the values that is a rounding error."""
_MAX_DECIMAL_ERROR = 8e-16
"""Largest rounding error of a decimal number that is multiplied by a power of ten, relative to the product."""
_MIN_NOISE_OF_GRID = 0.02
"""Smallest noise of values on a grid, as a share of the grid's rounding error q/√12.

Slow motions stay on each grid point for hundreds of samples, which hides most of the error.
"""
_GRID_STEPS = 1.5
"""Largest effect of rounding on a difference with unit-norm weights, in grid steps: √(m+1)/2 for the order m ≤ 8."""
_MAX_DEVIATIONS_SQUARED = 5.0**2
"""Square of the largest residual that is not rejected, in standard deviations."""
_MAX_OUTLIER_SHARE = 0.02
"""Largest share of residuals that may be left out."""
_ROWS_OF_TWO_GLITCHES = 18
"""Number of residuals that two glitches affect at the highest order; as many may be left out of a few residuals."""
_MAX_SHARE_OF_FEW = 1 / 8
"""Largest share of a few residuals that may be left out."""
_MAX_ROUNDS = 20
"""Maximum number of rounds of rejection."""
_MIN_KINKS = 30
"""Minimum number of places without parabolic motion for a grid; kinks of planned motions are fewer."""
# Encoder steps: the smallest increment counts if most of the other small increments are multiples of it.
_MAX_SMALL_RATIO = 20  # of a small increment to the smallest
_MAX_SINGLE_RATIO = 1.5  # of an increment of one step to the smallest
_MAX_RATIO_ERROR = 0.05  # of a multiple
_MIN_SMALL_INCREMENTS = 30  # number
_MIN_MULTIPLE_SHARE = 0.98  # of small increments that are multiples


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
    """Quality of excerpts of consecutive rows: ``times`` (n,) and ``parts`` (n, columns) of each excerpt, as in the file.

    ``curves`` are the columns without jumps of wrapped angles and sign changes of quaternions. These jumps are not noise, and
    2π is not on a grid.
    """
    if curves is None:
        curves = parts
    steps = np.concatenate([np.diff(t) for t in times])
    median_step = float(np.median(steps)) if steps.size else math.nan
    column_count = parts[0].shape[1]
    quanta = np.zeros(column_count)
    for k in range(column_count):
        quanta[k] = quantum([x[:, k] for x in parts])
    is_moving = np.any([np.ptp(x, axis=0) > 0 for x in parts if len(x)], axis=0)  # columns
    sigma = np.where(is_moving, noise(times, curves, quanta), 0.0)
    # Rounding to a grid causes noise. Without noise, equal steps come from the motion, such as a constant speed.
    has_grid = sigma > _MIN_NOISE_OF_GRID * quanta / math.sqrt(12.0)
    return Survey(median_step, np.where(has_grid, quanta, 0.0), sigma)


def quantum(parts: Sequence[Array]) -> float:
    """Grid of a column's values: a power of ten, or the smallest step of an encoder; 0 if none is detected.

    At constant speed or acceleration, all increments are multiples of one value without a grid. Therefore a grid also needs
    enough kinks, which are places with large third differences.
    """
    values = np.concatenate(parts)
    largest_value = float(np.abs(values).max(initial=0.0))
    increments = np.concatenate([np.abs(np.diff(part)) for part in parts])
    increments = increments[increments > _MAX_INCREMENT_ROUND_OFF * largest_value]
    if increments.size == 0:
        return 0.0
    grid = max(_common_step(increments), _decimal_grid(values, largest_value))
    kink_count = 0
    for part in parts:
        is_kink = np.abs(np.diff(part, 3)) > 0.5 * grid  # on a grid it is a whole number of grid steps
        kink_count += int(is_kink.sum())
    if kink_count >= _MIN_KINKS:
        return grid
    return 0.0


def _decimal_grid(values: Array, largest_value: float) -> float:
    """Coarsest power of ten of which all values are multiples; 0 without one."""
    for decimals in range(_MAX_DECIMALS + 1):
        scale = 10.0**decimals
        scaled = values * scale
        distances = np.abs(np.round(scaled) - scaled)
        max_distance = _MAX_DECIMAL_ERROR * max(largest_value * scale, 1.0)
        if (distances <= max_distance).all():
            return 10.0**-decimals
    return 0.0


def _common_step(increments: Array) -> float:
    """Smallest increment if nearly all of enough small increments are its multiples; else 0."""
    smallest_increment = float(increments.min())
    small_increments = increments[increments < _MAX_SMALL_RATIO * smallest_increment]
    ratios = small_increments / smallest_increment
    is_multiple = np.abs(ratios - np.round(ratios)) < _MAX_RATIO_ERROR
    if ratios.size < _MIN_SMALL_INCREMENTS or is_multiple.mean() < _MIN_MULTIPLE_SHARE:
        return 0.0
    single_steps = increments[increments < _MAX_SINGLE_RATIO * smallest_increment]
    return float(np.median(single_steps))


def noise(times: Sequence[Array], parts: Sequence[Array], quanta: Array | float = 0.0) -> Array:
    """Standard deviation (k,) of white noise on smooth motion, from high divided differences of excerpts (n, k).

    A difference of order m annihilates polynomials below degree m. With unit-norm weights it keeps the variance of
    white noise. The contribution of smooth motion decreases with the order, so the minimum over several orders is used.
    A few glitches do not count as noise. Rounding to the columns' grids ``quanta`` (k,) counts.
    """
    largest_values = np.max([np.abs(x).max(axis=0, initial=0.0) for x in parts], axis=0)  # (k,)
    grid_effect = _GRID_STEPS * np.asarray(quanta)
    sigma = np.full(parts[0].shape[1], np.inf)
    for order in ORDERS:
        residuals = [differences(t, x, order) for t, x in zip(times, parts, strict=True) if len(t) > order]
        if residuals:
            sigma_of_order = deviation(np.concatenate(residuals), grid_effect)
            sigma = np.minimum(sigma, sigma_of_order)
    is_noise = np.isfinite(sigma) & (sigma > _MAX_ROUND_OFF * largest_values)
    return np.asarray(np.where(is_noise, sigma, 0.0))


def deviation(residuals: Array, floor: Array) -> Array:
    """Standard deviation (k,) of residuals (n, k), without outliers.

    A residual is rejected if it is above 5 standard deviations and above ``floor`` (k,).
    """
    squares = residuals**2
    mean_square = np.mean(squares, axis=0)
    variance = mean_square
    has_larger_noise = np.zeros(variance.shape, bool)
    max_of_few = min(_ROWS_OF_TWO_GLITCHES, _MAX_SHARE_OF_FEW * len(residuals))
    max_outliers = max(_MAX_OUTLIER_SHARE * len(residuals), max_of_few)
    for _ in range(_MAX_ROUNDS):
        is_inlier = squares <= np.maximum(_MAX_DEVIATIONS_SQUARED * variance, floor**2)
        if is_inlier.all():
            break
        inlier_sum = np.where(is_inlier, squares, 0.0).sum(axis=0)
        variance = inlier_sum / np.maximum(1, is_inlier.sum(axis=0))
        # Many large residuals are not glitches but a second, larger noise; the accuracy follows from both.
        has_larger_noise |= (~is_inlier).sum(axis=0) > max_outliers
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
_WEIGHT_ROUNDS = 3
"""Number of rounds of weighted least squares."""
_MIN_VARIANCE_RATIO = 0.02
"""Smallest scale of a group's error, as a share of the mean variance."""
_MIN_ESTIMATE_RATIO = 0.1
"""Smallest scale of a group's error, as a share of its own variance."""


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
        """Errors in other units: the ``factors`` (k,) convert the columns to these units."""
        return SampleErrors(self.white * factors, self.grid * factors, self.stamp)

    @property
    def at_rest(self) -> Array:
        """Standard deviation (k,) of a sample at rest."""
        return np.sqrt(self.white**2 + self.grid**2 / 12.0)

    def deviation(self, speed: Array) -> Array:
        """Standard deviation (n, k) of samples that move at a speed (n, k)."""
        return np.asarray(np.sqrt(self.at_rest**2 + (self.stamp * speed) ** 2))

    def drawn(self, rng: np.random.Generator, curve: Array, speed: Array, count: int) -> Array:
        """Random samples (n, k, count) of ``count`` logs, from a curve (n, k) without errors and its speeds (n, k)."""
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
        rounding_variance = grid**2 / 12.0  # of a uniform distribution
        errors_and_speeds = _isolate_errors(times, [x[:, k] for x in curves], grid)
        if errors_and_speeds is not None:
            errors, speed = errors_and_speeds
            a, b = _split_variance(errors, speed, rounding=rounding_variance)
            white[k] = math.sqrt(a)
            stamp[k] = math.sqrt(b)
        else:
            white[k] = math.sqrt(max(0.0, survey.noise[k] ** 2 - rounding_variance))
    return SampleErrors(white, survey.quantum.copy(), stamp)


def _isolate_errors(times: Sequence[Array], parts: Sequence[Array], grid: float) -> tuple[Array, Array] | None:
    """Differences (n,) of the order that motion affects least, and speeds (n,); None for short excerpts.

    The weights of a difference have unit norm, so it has the standard deviation of the samples.
    """
    best_errors_and_speeds = None
    smallest_sigma = math.inf
    for order in ORDERS:
        excerpts = [(t, x) for t, x in zip(times, parts, strict=True) if len(t) > order]
        difference_count = sum(len(t) - order for t, _ in excerpts)
        if difference_count < _MIN_ROWS_PER_GROUP:
            return best_errors_and_speeds
        error_column = np.concatenate([differences(t, x[:, None], order) for t, x in excerpts])
        floor = np.array([_GRID_STEPS * grid])
        (sigma,) = deviation(error_column, floor).tolist()
        if sigma < smallest_sigma:
            smallest_sigma = sigma
            speed = np.concatenate([(x[order:] - x[:-order]) / (t[order:] - t[:-order]) for t, x in excerpts])
            best_errors_and_speeds = error_column[:, 0], speed
    return best_errors_and_speeds


def _split_variance(errors: Array, speed: Array, *, rounding: float) -> tuple[float, float]:
    """Nonnegative a and b of the variance a + rounding + b speed² of errors (n,), by weighted least squares.

    ``rounding`` is the variance of rounding errors. The rows are groups of errors at similar speeds.
    """
    from scipy.optimize import lsq_linear

    group_count = min(_MAX_GROUPS, len(errors) // _MIN_ROWS_PER_GROUP)
    group_count = max(1, group_count)
    by_speed = np.argsort(np.abs(speed), kind="stable")
    floor = np.array([_GRID_STEPS * math.sqrt(12.0 * rounding)])
    variance = np.zeros(group_count)
    mean_square_speed = np.zeros(group_count)
    for k, rows in enumerate(np.array_split(by_speed, group_count)):
        (sigma,) = deviation(errors[rows, None], floor).tolist()
        variance[k] = sigma**2
        mean_square_speed[k] = np.mean(speed[rows] ** 2)
    speed_scale = float(mean_square_speed.max())
    if speed_scale == 0.0:  # at rest
        speed_scale = 1.0
    A = np.stack([np.ones(group_count), mean_square_speed / speed_scale], axis=1)
    y = np.maximum(variance - rounding, 0.0)
    # A rest without noise must not outweigh the motion, nor divide by zero.
    min_scale = _MIN_VARIANCE_RATIO * float(variance.mean()) + 1e-300
    scale = np.maximum(variance, min_scale)
    x = np.zeros(2)
    # The error of a variance is proportional to the variance, and each round has a better estimate of the variance.
    for _ in range(_WEIGHT_ROUNDS):
        x = lsq_linear(A / scale[:, None], y / scale, (0.0, math.inf), method="bvls").x
        estimate = A @ x + rounding
        scale = np.maximum(np.maximum(estimate, _MIN_ESTIMATE_RATIO * variance), min_scale)
    a, scaled_b = x.tolist()
    return a, scaled_b / speed_scale
