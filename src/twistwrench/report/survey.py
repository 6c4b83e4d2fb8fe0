"""How good a log is: its time step, the grid its numbers lie on, and its noise, judged from excerpts of the file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["Survey", "noise", "quantum", "survey"]

_ORDERS = range(3, 9)
_FINEST_DECIMAL = 11
_ROUND_OFF = 4e-16
"""Noise below this share of the values is arithmetic, not measurement."""


@dataclass(frozen=True, eq=False)
class Survey:
    """Quality of the columns of a log, in the file's own units."""

    step: float
    """Median time step [s]."""
    quantum: Array
    """(columns,) grid the values lie on; 0 where none shows."""
    noise: Array
    """(columns,) standard deviation of what is not smooth motion; 0 where it is round-off or the column is constant."""


def survey(tables: Sequence[Array], time: int) -> Survey:
    """Judge excerpts (n, columns) of consecutive rows each; ``time`` is the column of time."""
    steps = np.concatenate([np.diff(table[:, time]) for table in tables])
    columns = tables[0].shape[1]
    quanta, noises = np.zeros(columns), np.zeros(columns)
    for k in range(columns):
        if k == time:
            continue
        parts = [table[:, k] for table in tables]
        quanta[k] = quantum(parts)
        noises[k] = noise([table[:, time] for table in tables], parts, quanta[k])
    return Survey(float(np.median(steps)) if steps.size else math.nan, quanta, noises)


def quantum(parts: Sequence[Array]) -> float:
    """The grid that all values lie on, 0 if none shows: a power of ten, or else the smallest step of an encoder."""
    values = np.concatenate(parts)
    size = float(np.abs(values).max(initial=0.0))
    increments = np.concatenate([np.abs(np.diff(part)) for part in parts])
    increments = increments[increments > 1e-13 * size]
    if increments.size == 0:
        return 0.0
    encoder = _common_step(increments)
    decimal = next((10.0**-d for d in range(_FINEST_DECIMAL) if _on_grid(values, 10.0**d, size)), 0.0)
    return max(encoder, decimal)


def _on_grid(values: Array, scale: float, size: float) -> bool:
    return bool((np.abs(np.round(values * scale) - values * scale) <= 1e-15 * max(size * scale, 1.0) * 8).all())


def _common_step(increments: Array) -> float:
    """The smallest increment, if the other small ones are multiples of it as good as exactly; else 0."""
    smallest = float(increments.min())
    ratios = increments[increments < 20 * smallest] / smallest
    regular = np.abs(ratios - np.round(ratios)) < 0.05
    return float(np.median(increments[increments < 1.5 * smallest])) if ratios.size >= 30 and regular.mean() > 0.98 else 0.0


def noise(times: Sequence[Array], parts: Sequence[Array], grid: float = 0.0) -> float:
    """Standard deviation of white noise on a smooth motion, from high divided differences; at least that of the ``grid``.

    A difference of order m annihilates polynomials below degree m and, with weights of unit norm, keeps the variance of
    white noise. What smooth motion leaves in it shrinks with the order, so the least over several orders is taken.
    """
    size = max(float(np.abs(part).max(initial=0.0)) for part in parts)
    if all(np.ptp(part) == 0.0 for part in parts if part.size):
        return 0.0
    found = math.inf
    for order in _ORDERS:
        residuals = [_residuals(t, x, order) for t, x in zip(times, parts, strict=True) if len(x) > order]
        if residuals:
            found = min(found, float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))))
    if not math.isfinite(found) or found <= _ROUND_OFF * size:
        found = 0.0
    return max(found, grid / math.sqrt(12.0))


def _residuals(t: Array, x: Array, order: int) -> Array:
    """Divided differences of x at times t, their weights scaled to unit norm; (n,) → (n - order,)."""
    t = np.lib.stride_tricks.sliding_window_view(t, order + 1)
    gaps = (t[:, :, None] - t[:, None, :]) / (t[:, -1:, None] - t[:, :1, None])
    gaps[:, np.arange(order + 1), np.arange(order + 1)] = 1.0
    weights = 1.0 / gaps.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray((weights * np.lib.stride_tricks.sliding_window_view(x, order + 1)).sum(axis=1))
