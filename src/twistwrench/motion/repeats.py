"""Rows with the time of the row before: one row of each time is handed on, and what was done about it is counted."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..core.printed_numbers import printed
from ..errors import TrajectoryError
from ..typing import Array

_MOST = 10_000
"""Rows of one time, from which the clock is taken to stand."""
_FEWEST, _REPEATED, _PAUSE = 20, 0.02, 3.0
"""Rows, and share of the steps that are 0, from which stamps seem rounded; and steps of their grid that are a pause."""
_ROUNDED = 0.65
"""Steps of the grid that a rounded stamp is off at most: half of one, and what few rows leave open of the clock."""


class Repeats:
    """Rows come in any portions; the last time of each is held back, as more rows of it may follow.

    Rows that equal the one before are dropped. Others of one time become their mean, which is the best estimate of two
    readings that a coarse clock does not tell apart.
    """

    def __init__(self, time: int, turning: Array, half_turn: Array, where: str) -> None:
        self._time, self._turning, self._half_turn, self._where = time, turning, half_turn, where
        self._held: Array | None = None
        self.dropped = self.averaged = 0
        self.first: float | None = None
        """When rows that differ first had one time."""

    def add(self, rows: Array) -> Array:
        """Consecutive rows (n, columns) whose times do not decrease; those of times that are surely over."""
        rows = rows if self._held is None else np.concatenate([self._held, rows])
        if not len(rows):
            return rows
        time = rows[:, self._time]
        starts = np.r_[0, np.flatnonzero(time[1:] != time[:-1]) + 1]
        self._held = rows[starts[-1] :].copy()
        if len(self._held) > _MOST:
            raise TrajectoryError(
                f"{self._where}: time stands at {float(time[-1])!r} for more than {_MOST} rows. Say how many rows a second has "
                "(--rate HZ), after removing the column of time."
            )
        return self._one_each(rows[: starts[-1]])

    def rest(self) -> Array | None:
        """What was held back; None if no row came at all."""
        held, self._held = self._held, None
        return None if held is None else self._one_each(held)

    def _one_each(self, rows: Array) -> Array:
        time = rows[:, self._time]
        again = np.r_[False, time[1:] == time[:-1]]
        if not again.any():
            return rows
        same = again & np.r_[False, (rows[1:] == rows[:-1]).all(axis=1)]
        self.dropped += int(same.sum())
        rows, again = rows[~same], again[~same]
        if not again.any():
            return rows
        starts = np.flatnonzero(~again)
        counts = np.diff(np.r_[starts, len(rows)])
        spread = np.maximum.reduceat(rows, starts) - np.minimum.reduceat(rows, starts)
        at = np.flatnonzero(counts > 1)
        if (spread[np.ix_(at, self._turning)] > self._half_turn).any():
            k = at[int((spread[np.ix_(at, self._turning)] > self._half_turn).any(axis=1).argmax())]
            raise TrajectoryError(
                f"{self._where}: rows of one time, {float(rows[starts[k], self._time])!r}, differ by more than half a turn. "
                "Keep one of them."
            )
        self.first = float(rows[starts[at[0]], self._time]) if self.first is None else self.first
        self.averaged += int(counts[at].sum())
        found = np.add.reduceat(rows, starts) / counts[:, None]
        found[:, self._time] = rows[starts, self._time]
        return np.asarray(found)

    def notes(self) -> list[str]:
        """A sentence for what was dropped, and one for what was averaged."""
        said = []
        if self.dropped:
            said.append(
                f"{self.dropped} row{'s that repeat the row' if self.dropped > 1 else ' that repeats the row'} before dropped."
            )
        if self.averaged and self.first is not None:
            said.append(
                f"{self.averaged} rows have a time that others have too, the first at t = {printed(self.first)} s: the "
                "mean of each is taken."
            )
        return said


def steady_times(stamps: Array) -> Array | None:
    """Times (n,) of rows whose stamps were rounded to a grid coarser than their steps; None where they are no steady clock's.

    Between pauses, times are the straight line through the stamps, which no stamp is farther from than rounding takes it.
    """
    steps = np.diff(stamps)
    if len(steps) < _FEWEST or (steps < 0).any() or (steps == 0).mean() < _REPEATED:
        return None
    grid = float(steps[steps > 0].min(initial=np.inf))
    on_grid = np.abs(steps - grid * np.round(steps / grid)) <= 1e-6 * grid + 4 * np.spacing(np.abs(stamps[1:]))
    if not (np.isfinite(grid) and on_grid.all()):
        return None
    edges = [0, *(np.flatnonzero(steps > _PAUSE * grid) + 1).tolist(), len(stamps)]
    found = np.empty(len(stamps))
    for a, b in pairwise(edges):
        if b - a < _FEWEST:
            return None
        rows, times = np.arange(b - a) - 0.5 * (b - a - 1), stamps[a:b]
        middle = float(times.mean())
        slope = float(rows @ (times - middle)) / float(rows @ rows)
        found[a:b] = middle + slope * rows
        if np.abs(found[a:b] - times).max() > _ROUNDED * grid:
            return None
    return found if (np.diff(found) > 0).all() else None
