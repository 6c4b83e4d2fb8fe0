"""The greatest value of each column of numbers that come in portions."""

from __future__ import annotations

import numpy as np

from ..typing import Array


class Extreme:
    """The greatest value of each column so far, when it occurred, and which row of the last portion that was."""

    def __init__(self, columns: int) -> None:
        self.value = np.full(columns, -np.inf)
        self.time = np.full(columns, np.nan)

    def add(self, time: Array, values: Array) -> list[tuple[int, int]]:
        """Take in times (n,) and values (n, columns); the (column, row) pairs of columns with a new greatest value."""
        rows = np.argmax(values, axis=0)
        greatest = values[rows, np.arange(values.shape[1])]
        fresh = np.flatnonzero(greatest > self.value)
        self.value[fresh] = greatest[fresh]
        self.time[fresh] = time[rows[fresh]]
        return [(int(k), int(rows[k])) for k in fresh]
