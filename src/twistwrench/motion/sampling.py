"""What the samples of a log are off by: noise, rounding to a grid, and stamps that are late or early."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .log_noise import ORDERS, Survey, deviation, differences

_GROUPS, _FEWEST = 16, 60
"""Rows are grouped by speed: this many groups, of at least so many rows."""
_GRID_STEPS = 1.5
"""Most that rounding by half a grid step makes of a difference whose weights have unit norm."""


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
