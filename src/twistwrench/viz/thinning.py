"""Rows of a long motion that a picture needs: evenly spaced ones, and all at which a curve is at its least or greatest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["Thinned"]


class Thinned:
    """Rows (n, k) come in any portions; of many, each bin of equally many consecutive rows keeps a few.

    Of each bin: its first row, and for every watched column the rows of its least and greatest value with their neighbours.
    So a spike of one sample is drawn at its height, and is no wider than it was: integrals over the kept rows stay right.
    """

    def __init__(self, most: int, watched: slice) -> None:
        self._most, self._watched = most, watched
        self._bin = 1
        self._rows: Array | None = None
        self._index = np.zeros(0, int)
        self.count = 0
        """Rows taken in."""

    def add(self, rows: Array) -> None:
        """Take in consecutive rows."""
        index = self.count + np.arange(len(rows))
        self.count += len(rows)
        self._rows = rows.copy() if self._rows is None else np.concatenate([self._rows, rows])
        self._index = np.concatenate([self._index, index])
        if self._bin > 1:
            self._thin()
        while len(self._rows) > self._most:
            self._bin *= 2
            before = len(self._rows)
            self._thin()
            if self._bin > self.count and len(self._rows) == before:  # more columns to watch than rows may be kept
                break

    def result(self) -> Array:
        """The rows kept, in order; the first and the last among them."""
        return np.zeros((0, 0)) if self._rows is None else self._rows

    def _thin(self) -> None:
        if self._rows is None or not len(self._rows):
            return
        bins = self._index // self._bin
        starts = np.r_[0, np.flatnonzero(np.diff(bins)) + 1]
        values = self._rows[:, self._watched]
        keep = self._index % self._bin == 0
        keep[-1] = True  # the next portion may need it as a neighbour
        group = np.cumsum(np.r_[0, np.diff(bins) != 0])
        for extreme in (np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)):
            at, column = np.nonzero(values == extreme[group])
            # The first row of each bin and column that has the extreme value: rows come in order.
            _, first = np.unique(group[at] * values.shape[1] + column, return_index=True)
            keep[at[first]] = True
        near = np.diff(self._index) == 1
        chosen = keep.copy()
        chosen[1:] |= keep[:-1] & near
        chosen[:-1] |= keep[1:] & near
        self._rows, self._index = self._rows[chosen], self._index[chosen]
