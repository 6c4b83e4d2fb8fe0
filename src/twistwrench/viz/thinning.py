"""Rows of a long motion that a picture needs: evenly spaced ones, and all at which a curve is at its least or greatest."""

from __future__ import annotations

import numpy as np

from ..typing import Array


class Thinned:
    """Rows (n, k) come in any portions; ``most`` of many are kept.

    A quarter of them at most is evenly spaced. The others are, for every bin of equally many consecutive rows and every watched
    column, the rows of its least and greatest value with their neighbours: a spike of one sample is drawn at its height, and
    is no wider than it was, so that integrals over the kept rows stay right.
    """

    def __init__(self, most: int, watched: slice) -> None:
        self._most, self._watched = most, watched
        self._step = self._bin = 1
        self._rows: Array | None = None
        self._index = np.zeros(0, int)
        self.count = 0
        """Rows taken in."""

    def add(self, rows: Array) -> None:
        """Take in consecutive rows."""
        self._index = np.concatenate([self._index, self.count + np.arange(len(rows))])
        self._rows = rows.copy() if self._rows is None else np.concatenate([self._rows, rows])
        self.count += len(rows)
        if self._bin > 1:
            self._thin()
        while len(self._rows) > self._most and self._bin < 2 * self.count:
            self._bin *= 2
            while self.count > self._most // 4 * self._step:
                self._step *= 2
            self._thin()

    def result(self) -> Array:
        """The rows kept, in order; the first and the last among them."""
        return np.zeros((0, 0)) if self._rows is None else self._rows

    def _thin(self) -> None:
        if self._rows is None or not len(self._rows):
            return
        bins = self._index // self._bin
        starts = np.r_[0, np.flatnonzero(np.diff(bins)) + 1]
        values = self._rows[:, self._watched]
        peak = np.zeros(len(bins), bool)
        group = np.cumsum(np.r_[0, np.diff(bins) != 0])
        for extreme in (np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)):
            at, column = np.nonzero(values == extreme[group])
            # The first row of each bin and column that has the extreme value: rows come in order.
            _, first = np.unique(group[at] * values.shape[1] + column, return_index=True)
            peak[at[first]] = True
        near = np.diff(self._index) == 1
        keep = (self._index % self._step == 0) | peak
        keep[1:] |= peak[:-1] & near
        keep[:-1] |= peak[1:] & near
        keep[-1] = True  # the next portion may need it as a neighbour
        self._rows, self._index = self._rows[keep], self._index[keep]
