"""Time stamps of a log: rows of equal time, and steady times in place of rounded stamps."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...core.doubts import Doubt, doubt
from ...core.errors import TrajectoryError
from ...core.numbers import printed
from ...core.text import Argument, Placeholder
from ...core.typing import Array
from .. import log_table

_MAX_ROWS_OF_ONE_TIME = 10_000
"""Number of rows with one time above which the clock is considered stopped."""
_MIN_ROWS, _MIN_ZERO_STEPS, _PAUSE = 20, 0.02, 3.0
"""Minimum rows, and fraction of zero steps, for rounded stamps; and number of grid steps that make a pause."""
_MAX_ROUNDING = 0.65
"""Largest deviation of a rounded stamp in grid steps: 0.5 for rounding, the rest for the error of the clock."""


@dataclass
class DuplicateTimestamps:
    """Merge rows of equal time: repeated rows are dropped, others are averaged."""

    dropped: int = 0
    averaged: int = 0
    first: float | None = None
    """First time with different rows."""

    def merge(self, table: Array, turning: Array, half_turn: Array, where: str) -> Array:
        """Reduce a table (n, k) to one row per time, in place; time is the first column. Raises TrajectoryError."""
        begin = end = 0
        while begin < len(table):
            stop = min(begin + log_table.ROWS, len(table))
            while stop < len(table) and table[stop, 0] == table[stop - 1, 0]:
                stop += 1
                if stop - begin - log_table.ROWS > _MAX_ROWS_OF_ONE_TIME:
                    raise TrajectoryError(
                        f"{where}: time stands at {float(table[stop - 1, 0])!r} for more than {_MAX_ROWS_OF_ONE_TIME} rows. "
                        "Say how many rows a second has, {0}, after removing the column of time.",
                        Argument("rate", Placeholder("HZ")),
                    )
            rows = self._merge_portion(table[begin:stop], turning, half_turn, where)
            table[end : end + len(rows)] = rows
            begin, end = stop, end + len(rows)
        return table[:end]

    def _merge_portion(self, rows: Array, turning: Array, half_turn: Array, where: str) -> Array:
        time = rows[:, 0]
        has_previous_time = np.r_[False, time[1:] == time[:-1]]
        if not has_previous_time.any():
            return rows
        repeats_row = has_previous_time & np.r_[False, (rows[1:] == rows[:-1]).all(axis=1)]
        self.dropped += int(repeats_row.sum())
        rows, has_previous_time = rows[~repeats_row], has_previous_time[~repeats_row]
        if not has_previous_time.any():
            return rows
        starts = np.flatnonzero(~has_previous_time)
        counts = np.diff(np.r_[starts, len(rows)])
        spread = np.maximum.reduceat(rows, starts) - np.minimum.reduceat(rows, starts)
        merged = np.flatnonzero(counts > 1)
        contradicting = merged[(spread[np.ix_(merged, turning)] > half_turn).any(axis=1)]
        if contradicting.size:
            raise TrajectoryError(
                f"{where}: rows of one time, {float(rows[starts[contradicting[0]], 0])!r}, differ by more than half a turn. "
                "Keep one of them."
            )
        if self.first is None:
            self.first = float(rows[starts[merged[0]], 0])
        self.averaged += int(counts[merged].sum())
        means = np.add.reduceat(rows, starts) / counts[:, None]
        means[:, 0] = rows[starts, 0]
        return np.asarray(means)

    def doubts(self) -> list[Doubt]:
        """Notes on dropped rows and averaged rows."""
        doubts = []
        if self.dropped:
            rows = "row that repeats" if self.dropped == 1 else "rows that repeat"
            doubts.append(doubt("rows-left-out", what=f"{self.dropped} {rows} the row before"))
        if self.averaged and self.first is not None:
            first = f"first t = {printed(self.first)} s"
            what = f"{self.averaged} rows with a time that others have too, {first}, but the mean of each time"
            doubts.append(doubt("rows-left-out", what=what))
        return doubts


def steady_times(stamps: Array) -> Array | None:
    """Reconstruct times (n,) from stamps rounded to a grid coarser than their steps; None without a steady clock.

    Between pauses, the times are the straight line through the stamps; each stamp must agree with it within rounding.
    """
    steps = np.diff(stamps)
    if len(steps) < _MIN_ROWS or (steps < 0).any() or (steps == 0).mean() < _MIN_ZERO_STEPS:
        return None
    grid = float(steps[steps > 0].min(initial=np.inf))
    on_grid = np.abs(steps - grid * np.round(steps / grid)) <= 1e-6 * grid + 4 * np.spacing(np.abs(stamps[1:]))
    if not (np.isfinite(grid) and on_grid.all()):
        return None
    edges = [0, *(np.flatnonzero(steps > _PAUSE * grid) + 1).tolist(), len(stamps)]
    times = np.empty(len(stamps))
    for begin, end in pairwise(edges):
        if end - begin < _MIN_ROWS:
            return None
        rows, own_stamps = np.arange(end - begin) - 0.5 * (end - begin - 1), stamps[begin:end]
        middle = float(own_stamps.mean())
        slope = float(rows @ (own_stamps - middle)) / float(rows @ rows)
        times[begin:end] = middle + slope * rows
        if np.abs(times[begin:end] - own_stamps).max() > _MAX_ROUNDING * grid:
            return None
    return times if (np.diff(times) > 0).all() else None
