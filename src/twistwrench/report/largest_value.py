"""What the largest of many noisy values says of the largest true one."""

from __future__ import annotations

import numpy as np

from ..typing import Array

_MOST = 4096
_NEAR = 6.0
"""Standard deviations below the largest value within which others contend with it."""
_UNSURE = 0.12
"""Share of the excess that is not known: it is in proportion to an estimated noise, and grows with a rough count."""


class Contenders:
    """The largest values of each column, one for each run of ``rows`` rows; rows come in any portions.

    A run whose largest value stands at its border, with a larger one next to it, is but the flank of its neighbour: noise
    moves both alike, and it does not count.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self.rows = rows
        self._seen = 0
        self._held = np.zeros((0, columns))
        self._before = np.full(columns, -np.inf)
        """The row before those that are held."""
        self._kept = np.zeros((0, columns))

    @property
    def runs(self) -> int:
        """How many runs there were."""
        return -(-self._seen // self.rows)

    def add(self, values: Array) -> None:
        """Take in consecutive values (n, columns)."""
        self._seen += len(values)
        held = np.concatenate([self._held, values])
        done = max(0, len(held) - 1) // self.rows  # runs of which the next row is known
        if done:
            runs = held[: done * self.rows].reshape(done, self.rows, -1)
            before = np.concatenate([self._before[None], runs[:-1, -1]])
            self._keep(_own(runs.max(axis=1), before, held[self.rows : done * self.rows + 1 : self.rows]))
            self._before = runs[-1, -1].copy()
        self._held = held[done * self.rows :].copy()

    def _keep(self, values: Array) -> None:
        self._kept = np.concatenate([self._kept, values])
        if len(self._kept) > _MOST:
            self._kept = -np.partition(-self._kept, _MOST - 1, axis=0)[:_MOST]

    def result(self) -> Array:
        """Each column's largest values, falling, and -inf at last for runs that do not count; (runs, columns).

        Of very many runs the first few thousand.
        """
        last = self._held.max(axis=0, keepdims=True) if len(self._held) else self._held
        last = _own(last, self._before[None], np.full_like(last, -np.inf))
        return -np.sort(-np.concatenate([self._kept, last]), axis=0)[:_MOST]


def _own(largest: Array, before: Array, after: Array) -> Array:
    """The largest values of runs (n, columns), -inf where the row before or after a run is larger still."""
    return np.where((largest >= before) & (largest >= after), largest, -np.inf)


def excess_of_largest(values: Array, sigma: float, runs: int) -> tuple[float, float]:
    """By how much the largest of falling ``values`` (k,) exceeds the largest true value, and that excess's deviation.

    Values of -inf do not count. Each other is a true one with independent normal noise of deviation ``sigma``; they are
    the largest of ``runs``. The true values that contend are taken to spread as much less than the values as the noise's
    variance explains.
    """
    from scipy.special import log_ndtr

    values = values[np.isfinite(values)]
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
