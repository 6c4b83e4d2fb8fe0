"""Few enough points to draw, from rows too many to keep: the least and the greatest value of each bin of rows."""

from __future__ import annotations

import numpy as np

from ..typing import Array

_BINS = 2048


class Envelope:
    """Least and greatest values of (n, k) rows in bins of equally many rows, doubled whenever they become too many."""

    def __init__(self, bins: int = _BINS) -> None:
        self._most = 2 * bins
        self._rows_per_bin = 1
        self._rows = 0
        self._time = np.zeros(0)
        self._least: Array | None = None
        self._greatest: Array | None = None

    def add(self, time: Array, values: Array, upper: Array | None = None) -> None:
        """Take in consecutive rows, times (n,) and values (n, k), or bands from those to ``upper`` (n, k)."""
        offset = self._rows % self._rows_per_bin  # rows already in the last bin
        starts = np.arange(-offset, len(time), self._rows_per_bin).clip(min=0)
        least, greatest = (
            np.minimum.reduceat(values, starts),
            np.maximum.reduceat(values if upper is None else upper, starts),
        )
        begins = time[starts]
        if self._least is None or self._greatest is None:
            self._time, self._least, self._greatest = begins, least, greatest
        else:
            if offset:
                self._least[-1] = np.minimum(self._least[-1], least[0])
                self._greatest[-1] = np.maximum(self._greatest[-1], greatest[0])
                begins, least, greatest = begins[1:], least[1:], greatest[1:]
            self._time = np.concatenate([self._time, begins])
            self._least = np.concatenate([self._least, least])
            self._greatest = np.concatenate([self._greatest, greatest])
        self._rows += len(time)
        while len(self._time) > self._most:
            pairs = np.arange(0, len(self._time), 2)
            self._time = self._time[::2]
            self._least = np.minimum.reduceat(self._least, pairs)
            self._greatest = np.maximum.reduceat(self._greatest, pairs)
            self._rows_per_bin *= 2

    def result(self) -> tuple[Array, Array, Array]:
        """Times at which bins begin (b,), least and greatest values (b, k)."""
        empty = np.zeros((0, 0))
        return (
            self._time,
            empty if self._least is None else self._least,
            empty if self._greatest is None else self._greatest,
        )
