"""Measured torques above their limits, and for how long."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.typing import Array

_MIN_SIGMAS, _MIN_ROWS, _MIN_TIME = 3.0, 3, 0.01
"""Noise [standard deviations], rows in a row, and time [s] above which a measured torque stays above its limit. Shorter peaks
are those of impacts, and of gears with a peak rating."""


class TimeAbove(NamedTuple):
    """Longest run of consecutive rows in which measured torques are above their limits, (nv,) each."""

    rows: Array
    """Number of rows; 0 if the torque is never above."""
    length: Array
    """Time from the first of them to the last [s]."""
    at: Array
    """Time of the first [s]; nan if the torque is never above."""

    @classmethod
    def from_rows(cls, time: Array, above: Array) -> TimeAbove:
        """Longest runs of True in each column of ``above`` (n, nv), rows at times (n,); the first of equally long ones."""
        runs = [_longest_run(time, np.flatnonzero(column)) for column in above.T]
        rows, length, begin = np.array(runs).reshape(-1, 3).T
        return cls(rows.astype(int), length, begin)

    def is_lasting(self, step: float) -> Array:
        """Mask (nv,) of torques that stay above for at least three rows and 10 ms; each row lasts one ``step`` [s]."""
        return np.asarray((self.rows >= _MIN_ROWS) & (self.length + step >= _MIN_TIME * (1 - 1e-6)))


def _longest_run(time: Array, rows: Array) -> tuple[int, float, float]:
    """Number of rows, duration and beginning of the longest run of consecutive numbers in ``rows``."""
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    longest = max(runs, key=len)
    if not len(longest):
        return 0, 0.0, np.nan
    begin, end = float(time[longest[0]]), float(time[longest[-1]])
    return len(longest), end - begin, begin


def above_limits(tau: Array, limits: Array, sigma: Array) -> Array:
    """Mask (n, nv) of measured torques above their limits (nv,) by more than their noise (nv,)."""
    return np.asarray(np.abs(tau) > limits + _MIN_SIGMAS * sigma)
