"""What the largest of many noisy values says of the largest true one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["Contenders", "excess_of_largest"]

_MOST = 4096
_NEAR = 6.0
"""Standard deviations below the largest value within which others contend with it."""
_UNSURE = 0.12
"""Share of the excess that is not known: it is in proportion to an estimated noise, and grows with a rough count."""


class Contenders:
    """The largest values of each column, one for each run of ``rows`` rows; rows come in any portions."""

    def __init__(self, columns: int, rows: int) -> None:
        self.rows = rows
        self.runs = 0
        """How many runs there were."""
        self._seen = 0
        self._open = np.full(columns, -np.inf)
        self._kept = np.zeros((0, columns))

    def add(self, values: Array) -> None:
        """Take in consecutive values (n, columns)."""
        begun = self._seen % self.rows
        starts = np.arange(-begun, len(values), self.rows).clip(min=0)
        found = np.maximum.reduceat(values, starts)
        if begun:
            found[0] = np.maximum(found[0], self._open)
        self._seen += len(values)
        self.runs = -(-self._seen // self.rows)
        done = len(found) - (self._seen % self.rows > 0)
        self._open = found[-1].copy()
        self._keep(found[:done])

    def _keep(self, values: Array) -> None:
        self._kept = np.concatenate([self._kept, values])
        if len(self._kept) > _MOST:
            self._kept = -np.partition(-self._kept, _MOST - 1, axis=0)[:_MOST]

    def result(self) -> Array:
        """(runs, columns): each column's largest values, falling; of very many runs the first few thousand."""
        last = self._open[None, :] if self._seen % self.rows else self._open[None, :0].reshape(0, len(self._open))
        return -np.sort(-np.concatenate([self._kept, last]), axis=0)[:_MOST]


def excess_of_largest(values: Array, sigma: float, runs: int) -> tuple[float, float]:
    """By how much the largest of falling ``values`` (k,) exceeds the largest true value, and that excess's deviation.

    Each value is a true one with independent normal noise of deviation ``sigma``; they are the largest of ``runs``. The
    true values that contend are taken to spread as much less than the values as the noise's variance explains.
    """
    from scipy.special import log_ndtr

    near = values[values >= values[0] - _NEAR * sigma]
    if len(near) < 2 or sigma == 0.0:
        return 0.0, sigma
    count = runs if len(near) == len(values) else len(near)  # all that are listed contend, and more that are not
    variance = float(np.var(near))
    kept = max(0.0, 1.0 - sigma**2 / variance) if variance else 0.0
    true = near.mean() + np.sqrt(kept) * (near - near.mean())
    x = np.linspace(true.max() - _NEAR * sigma, true.max() + 2 * _NEAR * sigma, 721)
    below = np.exp(np.sum([log_ndtr((x - w) / sigma) for w in true], axis=0) * (count / len(near)))
    share, middle = np.diff(below), 0.5 * (x[1:] + x[:-1])
    share /= share.sum()
    mean = float(share @ middle)
    spread = float(np.sqrt(share @ (middle - mean) ** 2))
    excess = max(0.0, mean - float(true.max()))
    return excess, float(np.hypot(spread, _UNSURE * excess))
