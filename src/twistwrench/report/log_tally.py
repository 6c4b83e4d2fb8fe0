"""What is counted over the rows of a file that come block by block: extremes of columns, and steps of the clock."""

from __future__ import annotations

import numpy as np

from ..typing import Array

GAP = 3.0
"""Times the usual step, from which a step is a gap."""


class ColumnTally:
    """Least and greatest numbers of columns, how many rows are exactly there, and how many are exactly zero."""

    def __init__(self, columns: int) -> None:
        self.rows = 0
        self.least, self.most = np.full(columns, np.inf), np.full(columns, -np.inf)
        self._at_least, self._at_most = np.zeros(columns, int), np.zeros(columns, int)
        self.zeros = np.zeros(columns, int)

    def add(self, table: Array) -> None:
        """Take in rows (n, columns)."""
        if not len(table):
            return
        self.rows += len(table)
        self.zeros += (table == 0).sum(axis=0)
        for extreme, count, found in (
            (self.least, self._at_least, np.minimum(self.least, table.min(axis=0))),
            (self.most, self._at_most, np.maximum(self.most, table.max(axis=0))),
        ):
            count[found != extreme] = 0
            extreme[:] = found
            count += (table == found).sum(axis=0)

    def cut(self, column: int, share: float, rows: int) -> float:
        """Share of the rows at the extreme that has most of them; 0 for fewer than so many, of a zero, and of one number."""
        if self.least[column] == self.most[column]:
            return 0.0
        pairs = ((self.least, self._at_least), (self.most, self._at_most))
        count = max((int(n[column]) for extreme, n in pairs if extreme[column] != 0), default=0)
        return count / self.rows if count >= rows and count >= share * self.rows else 0.0


class StampTally:
    """Steps of a clock, by the usual step of its first block."""

    def __init__(self) -> None:
        self._first = self._last = np.nan
        self._usual = 0.0
        self._gaps = self._repeated = self._backward = self._regular = 0
        self._longest = self._sum = self._squares = 0.0

    def add(self, t: Array) -> None:
        """Take in times (n,) [s]."""
        if not len(t):
            return
        steps = np.diff(t) if np.isnan(self._last) else np.diff(t, prepend=self._last)
        self._first = float(t[0]) if np.isnan(self._first) else self._first
        self._last = float(t[-1])
        ahead = steps[steps > 0]
        if not self._usual and ahead.size:
            self._usual = float(np.median(ahead))
        self._repeated += int((steps == 0).sum())
        self._backward += int((steps < 0).sum())
        self._longest = max(self._longest, float(ahead.max(initial=0.0)))
        off = ahead[ahead < GAP * self._usual] - self._usual
        self._gaps += len(ahead) - len(off)
        self._regular += len(off)
        self._sum += float(off.sum())
        self._squares += float((off**2).sum())

    def found(self) -> tuple[float, float, int, float, int, int, float]:
        """Seconds, rate, gaps, longest step, repeated and backward stamps, and how much regular steps vary."""
        usual = self._usual or np.nan
        mean = self._sum / max(1, self._regular)
        jitter = np.sqrt(max(self._squares / self._regular - mean**2, 0.0)) if self._regular else np.nan
        return (
            self._last - self._first, 1.0 / usual, self._gaps, self._longest, self._repeated, self._backward, float(jitter)
        )  # fmt: skip
