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
_MIN_ROWS = 20
"""Minimum number of rows between pauses."""
_MIN_ZERO_STEPS = 0.02
"""Fraction of zero steps from which stamps are rounded to a grid coarser than their steps."""
_MAX_GRID_ERROR = 1e-6
"""Largest distance of a step from a multiple of the grid, in grid steps."""
_MIN_PAUSE = 3.0
"""Number of grid steps above which a step is a pause."""
_MAX_ROUNDING = 0.65
"""Largest deviation of a rounded stamp in grid steps: 0.5 for rounding, the rest for the error of the clock."""


@dataclass
class DuplicateTimestamps:
    """Merges rows of equal time: repeated rows are dropped, others are averaged."""

    dropped: int = 0
    """Number of dropped rows."""
    averaged: int = 0
    """Number of rows that were averaged."""
    first: float | None = None
    """First time [s] with different rows; None without any."""

    def merge(self, table: Array, turning: Array, half_turn: Array, where: str) -> Array:
        """Reduce a table (n, k) to one row per time, in place; time is the first column. Raises TrajectoryError.

        ``turning`` are the columns of angles, ``half_turn`` is half a turn in the unit of each, and ``where`` begins messages.
        """
        begin = 0  # first row of the portion to merge
        merged_end = 0  # end of the merged rows, which overwrite the table from its beginning
        while begin < len(table):
            stop = min(begin + log_table.ROWS, len(table))
            while stop < len(table) and table[stop, 0] == table[stop - 1, 0]:  # keep rows of one time together
                stop += 1
                if stop - begin - log_table.ROWS > _MAX_ROWS_OF_ONE_TIME:
                    raise TrajectoryError(
                        f"{where}: time stands at {float(table[stop - 1, 0])!r} for more than {_MAX_ROWS_OF_ONE_TIME} rows. "
                        "Say how many rows a second has, {0}, after removing the column of time.",
                        Argument("rate", Placeholder("HZ")),
                    )
            rows = self._merge_portion(table[begin:stop], turning, half_turn, where)
            table[merged_end : merged_end + len(rows)] = rows
            merged_end += len(rows)
            begin = stop
        return table[:merged_end]

    def _merge_portion(self, rows: Array, turning: Array, half_turn: Array, where: str) -> Array:
        """Portion of a table with one row per time; arguments as of :meth:`merge`."""
        time = rows[:, 0]
        has_previous_time = np.r_[False, time[1:] == time[:-1]]
        if not has_previous_time.any():
            return rows
        repeats_row = has_previous_time & np.r_[False, (rows[1:] == rows[:-1]).all(axis=1)]
        self.dropped += int(repeats_row.sum())
        rows = rows[~repeats_row]
        has_previous_time = has_previous_time[~repeats_row]
        if not has_previous_time.any():
            return rows
        # Groups of rows of one time, most of which have a single row.
        starts = np.flatnonzero(~has_previous_time)
        counts = np.diff(np.r_[starts, len(rows)])
        spread = np.maximum.reduceat(rows, starts) - np.minimum.reduceat(rows, starts)
        merged_groups = np.flatnonzero(counts > 1)
        angle_spread = spread[np.ix_(merged_groups, turning)]
        angles_contradict = (angle_spread > half_turn).any(axis=1)
        if angles_contradict.any():
            first_group = merged_groups[angles_contradict][0]
            raise TrajectoryError(
                f"{where}: rows of one time, {float(rows[starts[first_group], 0])!r}, differ by more than half a turn. "
                "Keep one of them."
            )
        if self.first is None:
            self.first = float(rows[starts[merged_groups[0]], 0])
        self.averaged += int(counts[merged_groups].sum())
        means = np.add.reduceat(rows, starts) / counts[:, None]
        means[:, 0] = rows[starts, 0]  # exactly, as a mean of equal times may be rounded
        return np.asarray(means)

    def doubts(self) -> list[Doubt]:
        """Notes on dropped rows and averaged rows."""
        doubts = []
        if self.dropped:
            noun_and_verb = "row that repeats" if self.dropped == 1 else "rows that repeat"
            doubts.append(doubt("rows-left-out", what=f"{self.dropped} {noun_and_verb} the row before"))
        if self.averaged and self.first is not None:
            first_time = f"first t = {printed(self.first)} s"
            left_out = f"{self.averaged} rows with a time that others have too, {first_time}, but the mean of each time"
            doubts.append(doubt("rows-left-out", what=left_out))
        return doubts


def steady_times(stamps: Array) -> Array | None:
    """Reconstruct times (n,) from stamps rounded to a grid coarser than their steps; None without a steady clock.

    Between pauses, the times are the straight line through the stamps; each stamp must agree with it within rounding.
    """
    steps = np.diff(stamps)
    if len(steps) < _MIN_ROWS or (steps < 0).any():
        return None
    if (steps == 0).mean() < _MIN_ZERO_STEPS or not steps.any():  # the stamps are fine enough, or the clock stands
        return None
    grid = float(steps[steps > 0].min(initial=np.inf))
    distance_from_grid = np.abs(steps - grid * np.round(steps / grid))
    rounding = 4 * np.spacing(np.abs(stamps[1:]))  # steps are differences of large numbers
    tolerance = _MAX_GRID_ERROR * grid + rounding
    is_on_grid = distance_from_grid <= tolerance
    if not (np.isfinite(grid) and is_on_grid.all()):
        return None
    rows_after_pauses = np.flatnonzero(steps > _MIN_PAUSE * grid) + 1
    edges = [0, *rows_after_pauses.tolist(), len(stamps)]
    times = np.empty(len(stamps))
    for begin, end in pairwise(edges):
        if end - begin < _MIN_ROWS:
            return None
        own_stamps = stamps[begin:end]
        # Straight line by least squares; rows are counted from the middle, so that its value there is the mean.
        rows_from_middle = np.arange(end - begin) - 0.5 * (end - begin - 1)
        mean_stamp = float(own_stamps.mean())
        sum_of_products = float(rows_from_middle @ (own_stamps - mean_stamp))
        time_step = sum_of_products / float(rows_from_middle @ rows_from_middle)
        times[begin:end] = mean_stamp + time_step * rows_from_middle
        if np.abs(times[begin:end] - own_stamps).max() > _MAX_ROUNDING * grid:
            return None
    if not (np.diff(times) > 0).all():
        return None
    return times
