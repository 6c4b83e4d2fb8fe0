"""How good a log is: its time step, the grid its numbers lie on, and its noise, judged from excerpts of the file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array

ORDERS = range(3, 9)
"""Of the differences that noise is told from motion by."""
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
    found = np.where(_moves(parts), noise(times, parts if curves is None else curves, quanta), 0.0)
    # Rounding makes noise. Without it the steps are the motion's own, as those of a steady speed are.
    quanta = np.where(found > _LEAST_SEEN * quanta / math.sqrt(12.0), quanta, 0.0)
    return Survey(float(np.median(steps)) if steps.size else math.nan, quanta, found)


def quantum(parts: Sequence[Array]) -> float:
    """The grid that a column's values lie on, 0 if none shows: a power of ten, or the smallest step of an encoder.

    At a steady speed, or a steady acceleration, all increments are multiples of one, too: that is no grid.
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
    glitches are no noise; ``quanta`` (k,) are the grids of the columns, whose steps are.
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
        # Where many would go they are no glitches: the noise is of two sizes, and the motion's accuracy that of both.
        many |= (~kept).sum(axis=0) > few
        found = np.where(many, whole, found)
    return np.asarray(np.sqrt(found))


def _moves(parts: Sequence[Array]) -> Array:
    return np.asarray(np.any([np.ptp(x, axis=0) > 0 for x in parts if len(x)], axis=0))


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
