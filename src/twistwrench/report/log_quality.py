"""What is in a file of a motion, without a robot: its clock, and of each column its range, its grid and where it is cut."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import TrajectoryError
from ..motion.column_names import time_meaning
from ..motion.column_units import split_unit, time_factor
from ..motion.log_noise import noise, quantum
from ..motion.motion_file import MotionFile, open_motion_file
from ..typing import Array
from .log_tally import GAP, ColumnTally, StampTally

_LARGE = 1 << 25
"""Bytes, from which a file is looked at block by block."""
_RUNS = 16, 4096
_FEWEST = 16
_CUT, _CUT_ROWS = 0.01, 20
"""Share of the rows, and rows, that are at an extreme where a column is cut off there."""


@dataclass(frozen=True)
class LogColumn:
    """One column.

    Attributes
    ----------
    name : str
    least, most : float, in the file's unit
    grid : float, step of the grid that the numbers lie on; 0 where none shows
    noise : float, standard deviation of what is not smooth; 0 where none shows
    cut : float, share of the rows at the extreme that has most of them, where it is cut off there; 0 where it is not
    dead : bool, whether it is one number throughout
    zeros : float, share of the rows that are exactly 0
    """

    name: str
    least: float
    most: float
    grid: float
    noise: float
    cut: float
    dead: bool
    zeros: float = 0.0


@dataclass(frozen=True)
class LogQuality:
    """Quality of a log.

    Attributes
    ----------
    path : Path
    rows : int
    time : str, the column of time; empty where there is none
    seconds : float, from the first stamp to the last; not a number without a column of time
    rate : float, rows a second by the usual step [Hz]
    gaps : int, steps of three usual ones and more
    longest : float, step [s]
    repeated : int, rows with the stamp of the row before
    backward : int, rows whose stamp is before that of the row above
    jitter : float, standard deviation of the steps that are no gaps [s]
    columns : tuple of LogColumn
    notes : tuple of str, a sentence for each thing in the file that is not read
    """

    path: Path
    rows: int
    time: str
    seconds: float
    rate: float
    gaps: int
    longest: float
    repeated: int
    backward: int
    jitter: float
    columns: tuple[LogColumn, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: str | Path) -> LogQuality:
        """Read a file of a motion; of a large one, grids and noise are those of 16 runs of rows spread over it.

        Parameters
        ----------
        path : str or Path, as :meth:`twistwrench.Motion.from_file` takes it

        Returns
        -------
        quality : LogQuality

        Raises
        ------
        NotFoundError, TrajectoryError
            The file cannot be read.

        Examples
        --------
        >>> import twistwrench as tw
        >>> quality = LogQuality.of(tw.robots.path_of("ur5").with_name("ur5_demo.csv"))
        >>> quality.rows, round(quality.rate), quality.repeated
        (751, 125, 0)
        """
        file = open_motion_file(path)
        if (large := large_quality(file)) is not None:
            return large
        table = np.concatenate([block.table for block in file.blocks(range(len(file.header)))] or [np.zeros((0, 1))])
        if not len(table):
            raise TrajectoryError(f"{path}: no rows after the header.")
        place = _time_of(file)
        clock = _clock(table[:, place[0]] * place[1]) if place is not None else _no_clock()
        return cls(
            file.path,
            len(table),
            "" if place is None else file.header[place[0]],
            *clock,
            tuple(
                _column(file.header[k], table[:, k]) for k in range(table.shape[1]) if place is None or k != place[0]
            ),
            file.notes,
        )


def large_quality(file: MotionFile) -> LogQuality | None:
    """In one pass over the file, block by block; None of a file that is small, or in memory whole."""
    everything = range(len(file.header))
    if file.size < _LARGE or (runs := file.excerpts(everything, *_RUNS)) is None:
        return None
    place, tally = _time_of(file), ColumnTally(len(file.header))
    clock = None if place is None else StampTally()
    for block in file.blocks(everything):
        tally.add(block.table)
        if clock is not None and place is not None:
            clock.add(block.table[:, place[0]] * place[1])
    if not tally.rows:
        raise TrajectoryError(f"{file.path}: no rows after the header.")
    columns = []
    for k in everything:
        if place is not None and k == place[0]:
            continue
        least, most = float(tally.least[k]), float(tally.most[k])
        grid, size = _grid_and_noise([run.table[:, k] for run in runs])
        cut = tally.cut(k, _CUT, _CUT_ROWS)
        zeros = float(tally.zeros[k]) / tally.rows
        columns.append(LogColumn(file.header[k], least, most, grid, size, cut, least == most, zeros))
    return LogQuality(
        file.path,
        tally.rows,
        "" if place is None else file.header[place[0]],
        *(_no_clock() if clock is None else clock.found()),
        tuple(columns),
        file.notes,
    )


def _grid_and_noise(runs: list[Array]) -> tuple[float, float]:
    """Step of the grid that numbers of several runs of rows lie on, and the size of what is not smooth in them."""
    if min(map(np.min, runs)) == max(map(np.max, runs)):
        return 0.0, 0.0
    grid = quantum(runs)
    if min(map(len, runs)) < _FEWEST:
        return grid, 0.0
    rows = [np.arange(len(x), dtype=float) for x in runs]
    return grid, float(noise(rows, [x[:, None] for x in runs], grid)[0])


def _time_of(file: MotionFile) -> tuple[int, float] | None:
    """The column of time and what takes it to seconds."""
    ranked = []
    for k, cell in enumerate(file.header):
        name, unit = split_unit(cell)
        meant = time_meaning(name)
        if meant is not None:
            ranked.append((meant[0], k, time_factor(unit or meant[1] or "s") or 1.0))
    if not ranked:
        return None
    _, k, factor = min(ranked)
    return k, factor


def _clock(t: Array) -> tuple[float, float, int, float, int, int, float]:
    steps = np.diff(t)
    ahead = steps[steps > 0]
    usual = float(np.median(ahead)) if ahead.size else np.nan
    regular = ahead[ahead < GAP * usual] if ahead.size else ahead
    return (
        float(t[-1] - t[0]),
        1.0 / usual,
        int((ahead >= GAP * usual).sum()),
        float(ahead.max(initial=0.0)),
        int((steps == 0).sum()),
        int((steps < 0).sum()),
        float(regular.std()) if regular.size else np.nan,
    )


def _no_clock() -> tuple[float, float, int, float, int, int, float]:
    return np.nan, np.nan, 0, np.nan, 0, 0, np.nan


def _column(name: str, x: Array) -> LogColumn:
    least, most = float(x.min()), float(x.max())
    dead = least == most
    counts = [int((x == extreme).sum()) for extreme in (least, most) if extreme != 0]
    cut = max(counts, default=0)
    grid, size = _grid_and_noise([x])
    share = cut / len(x) if not dead and cut >= _CUT_ROWS and cut >= _CUT * len(x) else 0.0
    return LogColumn(name, least, most, grid, size, share, dead, float((x == 0).mean()))
