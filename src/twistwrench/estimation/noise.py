"""Quality of a log, judged from excerpts: time step, grid of its numbers, noise and late stamps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array

ORDERS = range(3, 9)
"""Orders of the differences that separate noise from motion."""
_FINEST_DECIMAL = 11
_ROUND_OFF = 4e-16
"""Noise below this share of the values is arithmetic, not measurement."""
_LEAST_SEEN = 0.02
"""Share of q/√12, the error of rounding to a grid q, that shows as noise at least: a motion that keeps to each point of the
grid for hundreds of samples shows only so much of it."""
_GRID_STEPS = 1.5
"""Most that rounding by half a grid step makes of a difference whose weights have unit norm: √(m+1)/2, order m ≤ 8."""
_FEW, _TWO_GLITCHES, _ROUNDS = 0.02, 18, 20
"""Residuals that may be left out: a share of many, of few those that two glitches spoil at the highest order."""
_FEWEST_MARKS = 30
"""Places where a column must not move as a parabola does for its grid to be one: kinks of planned motions are fewer."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Quality of some columns of a log, in the file's own units."""

    step: float
    """Median time step [s]; nan if there is but one row."""
    quantum: Array
    """(columns,) grid the values lie on; 0 where none shows."""
    noise: Array
    """(columns,) standard deviation of what is not smooth motion; 0 where that is round-off or nothing moves."""

    @property
    def error(self) -> Array:
        """(columns,) standard deviation with what is too slow to show as noise: that of rounding, where a grid shows."""
        return np.maximum(self.noise, self.quantum / math.sqrt(12.0))


def survey(times: Sequence[Array], parts: Sequence[Array], curves: Sequence[Array] | None = None) -> Survey:
    """Judge excerpts of consecutive rows: their times (n,) and the columns in question (n, columns), as written.

    ``curves`` are the same columns without the jumps of wrapped angles and turned quaternions: those are not noise, and
    2π lies on no grid.
    """
    steps = np.concatenate([np.diff(t) for t in times])
    quanta = np.array([quantum([x[:, k] for x in parts]) for k in range(parts[0].shape[1])])
    moves = np.any([np.ptp(x, axis=0) > 0 for x in parts if len(x)], axis=0)
    found = np.where(moves, noise(times, parts if curves is None else curves, quanta), 0.0)
    # Rounding makes noise. Without it the steps are the motion's own, as those of a steady speed are.
    quanta = np.where(found > _LEAST_SEEN * quanta / math.sqrt(12.0), quanta, 0.0)
    return Survey(float(np.median(steps)) if steps.size else math.nan, quanta, found)


def quantum(parts: Sequence[Array]) -> float:
    """Grid of a column's values, 0 if none shows: a power of ten, or the smallest step of an encoder.

    At a steady speed, or a steady acceleration, all increments are multiples of one, too: those are not a grid.
    """
    values = np.concatenate(parts)
    size = float(np.abs(values).max(initial=0.0))
    increments = np.concatenate([np.abs(np.diff(part)) for part in parts])
    increments = increments[increments > 1e-13 * size]
    if increments.size == 0:
        return 0.0
    decimal = next((10.0**-d for d in range(_FINEST_DECIMAL + 1) if _on_grid(values, 10.0**d, size)), 0.0)
    found = max(_common_step(increments), decimal)
    marks = sum(int((np.abs(np.diff(part, 3)) > 0.5 * found).sum()) for part in parts)
    return found if marks >= _FEWEST_MARKS else 0.0


def _on_grid(values: Array, scale: float, size: float) -> bool:
    scaled = values * scale
    return bool((np.abs(np.round(scaled) - scaled) <= 8e-16 * max(size * scale, 1.0)).all())


def _common_step(increments: Array) -> float:
    """The smallest increment, if enough small ones are there and are its multiples, as good as exactly; else 0."""
    smallest = float(increments.min())
    ratios = increments[increments < 20 * smallest] / smallest
    regular = np.abs(ratios - np.round(ratios)) < 0.05
    if ratios.size < 30 or regular.mean() < 0.98:
        return 0.0
    return float(np.median(increments[increments < 1.5 * smallest]))


def noise(times: Sequence[Array], parts: Sequence[Array], quanta: Array | float = 0.0) -> Array:
    """Standard deviation of white noise on smooth motion, from high divided differences; excerpts (n, k) → (k,).

    A difference of order m annihilates polynomials below degree m and, with weights of unit norm, keeps the variance of
    white noise. What smooth motion leaves in it shrinks with the order, so the least over several orders is taken. A few
    glitches are not noise; ``quanta`` (k,) are the grids of the columns, whose steps are.
    """
    size = np.max([np.abs(x).max(axis=0, initial=0.0) for x in parts], axis=0)
    least = np.full(parts[0].shape[1], np.inf)
    for order in ORDERS:
        residuals = [differences(t, x, order) for t, x in zip(times, parts, strict=True) if len(t) > order]
        if residuals:
            least = np.minimum(least, deviation(np.concatenate(residuals), _GRID_STEPS * np.asarray(quanta)))
    return np.asarray(np.where(np.isfinite(least) & (least > _ROUND_OFF * size), least, 0.0))


def deviation(residuals: Array, floor: Array) -> Array:
    """Standard deviation (k,) of residuals (n, k), without the few beyond 5 of them and ``floor``, over and over."""
    squares = residuals**2
    found = whole = np.mean(squares, axis=0)
    many = np.zeros(found.shape, bool)
    few = max(_FEW * len(residuals), min(_TWO_GLITCHES, len(residuals) / 8))
    for _ in range(_ROUNDS):
        kept = squares <= np.maximum(25.0 * found, floor**2)
        if kept.all():
            break
        found = np.where(kept, squares, 0.0).sum(axis=0) / np.maximum(1, kept.sum(axis=0))
        # Where many would go they are not glitches: the noise is of two sizes, and the motion's accuracy that of both.
        many |= (~kept).sum(axis=0) > few
        found = np.where(many, whole, found)
    return np.asarray(np.sqrt(found))


def differences(t: Array, x: Array, order: int) -> Array:
    """Divided differences of x at times t, their weights scaled to unit norm; (n,), (n, k) → (n - order, k)."""
    t = np.lib.stride_tricks.sliding_window_view(t, order + 1) - t[: len(t) - order, None]
    t = t / t[:, -1:]
    gaps = t[:, :, None] - t[:, None, :]
    gaps[:, np.arange(order + 1), np.arange(order + 1)] = 1.0
    weights = 1.0 / gaps.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    n = len(weights)
    return np.asarray(sum(weights[:, j, None] * x[j : j + n] for j in range(order + 1)))


# ── Errors of samples: noise, rounding, and the timing of stamps

_GROUPS, _FEWEST = 16, 60
"""Rows are grouped by speed: this many groups, of at least so many rows."""


@dataclass(frozen=True, eq=False)
class SampleErrors:
    """The errors of some columns, (k,) each, in the columns' units.

    A sample at time t reads ``round(x(t + e) + n)``: n is white noise, e what its stamp is off by, one for all columns
    of a row, and the rounding is to a grid.
    """

    white: Array
    """Standard deviation of n."""
    grid: Array
    """Step of the grid; 0 where there is none."""
    stamp: Array
    """Standard deviation of e [s], as that column shows it."""

    def scaled(self, factors: Array) -> SampleErrors:
        """The same in units of which a column's own are ``factors`` (k,)."""
        return SampleErrors(self.white * factors, self.grid * factors, self.stamp)

    @property
    def at_rest(self) -> Array:
        """(k,) standard deviation of a sample that does not move."""
        return np.sqrt(self.white**2 + self.grid**2 / 12.0)

    def deviation(self, speed: Array) -> Array:
        """(n, k) standard deviation of samples that move at a speed (n, k)."""
        return np.asarray(np.sqrt(self.at_rest**2 + (self.stamp * speed) ** 2))

    def drawn(self, rng: np.random.Generator, curve: Array, speed: Array, count: int) -> Array:
        """Samples (n, k, count) that a log of this curve (n, k) could hold; ``speed`` (n, k) is the curve's."""
        n = len(curve)
        found = np.repeat(curve[:, :, None], count, axis=2)
        if self.stamp.any():
            found += rng.normal(size=(n, 1, count)) * (self.stamp * speed)[:, :, None]
        for column in np.flatnonzero(self.white).tolist():
            found[:, column] += self.white[column] * rng.normal(size=(n, count))
        for column in np.flatnonzero(self.grid).tolist():
            step = self.grid[column]
            place = step * rng.uniform(-0.5, 0.5, count)  # where the grid lies under the curve is unknown
            found[:, column] = np.round((found[:, column] + place) / step) * step - place
        return found


def sample_errors(times: Sequence[Array], curves: Sequence[Array], survey: Survey) -> SampleErrors:
    """The errors of columns (n, k) that lie on smooth curves, from excerpts of consecutive rows.

    Differences of a high order leave the errors alone. Their variance over the speed, a + b speed², splits them into
    noise and stamps.
    """
    columns = len(survey.noise)
    white, stamp = np.zeros(columns), np.zeros(columns)
    for k in np.flatnonzero(survey.noise).tolist():
        grid = float(survey.quantum[k])
        found = _of_least_order(times, [x[:, k] for x in curves], grid)
        if found is not None:
            a, b = _split(*found, rounding=grid**2 / 12.0)
            white[k], stamp[k] = math.sqrt(a), math.sqrt(b)
        else:
            white[k] = math.sqrt(max(0.0, survey.noise[k] ** 2 - grid**2 / 12.0))
    return SampleErrors(white, survey.quantum.copy(), stamp)


def _of_least_order(times: Sequence[Array], parts: Sequence[Array], grid: float) -> tuple[Array, Array] | None:
    """Differences (n,), scaled to the samples' deviation, and speeds (n,), of the order that motion shows least in."""
    best, least = None, math.inf
    for order in ORDERS:
        pairs = [(t, x) for t, x in zip(times, parts, strict=True) if len(t) > order]
        if sum(len(t) - order for t, _ in pairs) < _FEWEST:
            return best
        off = np.concatenate([differences(t, x[:, None], order)[:, 0] for t, x in pairs])
        size = float(deviation(off[:, None], np.array([_GRID_STEPS * grid]))[0])
        if size < least:
            speed = np.concatenate([(x[order:] - x[:-order]) / (t[order:] - t[:-order]) for t, x in pairs])
            best, least = (off, speed), size
    return best


def _split(off: Array, speed: Array, *, rounding: float) -> tuple[float, float]:
    """a and b, neither negative, of the variance a + rounding + b speed² of differences."""
    from scipy.optimize import nnls

    groups = np.array_split(np.argsort(np.abs(speed), kind="stable"), max(1, min(_GROUPS, len(off) // _FEWEST)))
    floor = np.array([_GRID_STEPS * math.sqrt(12.0 * rounding)])
    variance = np.array([float(deviation(off[rows, None], floor)[0]) ** 2 for rows in groups])
    square = np.array([float(np.mean(speed[rows] ** 2)) for rows in groups])
    top = float(square.max()) or 1.0
    table = np.stack([np.ones(len(groups)), square / top], axis=1)
    least = 0.02 * float(variance.mean()) + 1e-300  # rest without any noise at all must not outweigh motion
    target, scale = np.maximum(variance - rounding, 0.0), np.maximum(variance, least)
    found = np.zeros(2)
    for _ in range(3):  # a variance is uncertain in proportion to itself
        found = nnls(table / scale[:, None], target / scale)[0]
        scale = np.maximum(np.maximum(table @ found + rounding, 0.1 * variance), least)
    return float(found[0]), float(found[1] / top)
