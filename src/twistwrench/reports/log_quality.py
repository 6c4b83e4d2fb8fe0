"""Quality of a log without a robot: clock, and range, grid, noise and saturation of each column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import TrajectoryError
from ..core.estimation.noise import noise, quantum
from ..core.text import listed
from ..core.typing import Array
from ..motion.column_names import split_unit, time_factor, time_meaning, unit_since_1970
from ..motion.columns import check_header
from ..motion.log_table import MAX_TABLE_IN_MEMORY, excerpts
from ..motion.motion_file import open_motion_file, text_columns
from ..motion.readers.csv_reader import CsvFile

GAP = 3.0
"""Ratio to the median step above which a step is a gap."""


_RUNS = 16, 4096
_MIN_ROWS_FOR_NOISE = 16
_MIN_SATURATED_SHARE, _MIN_SATURATED_ROWS = 0.01, 20
"""Minimum share and number of rows at the extreme of a saturated column."""


@dataclass(frozen=True)
class LogColumn:
    """One column, in the file's unit."""

    name: str
    least: float
    most: float
    grid: float
    """Step of the quantisation grid; 0 if none is found."""
    noise: float
    """Standard deviation of the noise; 0 if none is found."""
    cut: float
    """Share of the rows at the saturated extreme; 0 if the column is not saturated."""
    dead: bool
    """True if the column is constant."""
    zeros: float = 0.0
    """Share of the rows that are exactly 0."""


@dataclass(frozen=True)
class LogQuality:
    """Quality of a log; times are in seconds, nan without a time column."""

    path: Path
    rows: int
    time: str
    """Name of the time column; empty if there is none."""
    seconds: float
    """Time from the first stamp to the last."""
    rate: float
    """Rows per second by the median step [Hz]."""
    gaps: int
    """Number of steps of at least three median steps."""
    longest: float
    """Longest step."""
    repeated: int
    """Number of rows with the stamp of the previous row."""
    backward: int
    """Number of rows with a stamp before that of the previous row."""
    jitter: float
    """Standard deviation of the steps that are not gaps."""
    columns: tuple[LogColumn, ...]
    notes: tuple[str, ...] = ()
    """Sentences on ignored parts of the file."""

    @classmethod
    def from_file(cls, path: str | Path, *, topic: str | None = None, episode: int | None = None) -> LogQuality:
        """Read a motion file; for a large file, grid and noise come from 16 blocks of rows spread over it.

        ``topic`` selects a topic of a ROS recording, ``episode`` an episode of a LeRobot dataset.
        """
        file = open_motion_file(path, topic, episode)
        text, notes = text_columns(file), list(file.notes)
        all_columns = range(len(file.header))
        used = sorted({*all_columns} - {*text}) or list(all_columns)  # if all are words, the first row raises
        if 0 < len(text) < len(file.header):
            notes.append(f"Ignored, as they hold words: {listed([repr(file.header[k]) for k in text])}.")
        header = [file.header[k] for k in used]
        where = str(path)
        if isinstance(file, CsvFile):
            where += f": line {file.header_line}"
        check_header(header, where)
        table = file.table(used)
        if not len(table):
            raise TrajectoryError(f"{path}: no rows after the header.")
        time, clock = "", (np.nan, np.nan, 0, np.nan, 0, 0, np.nan)
        value_columns = list(range(len(header)))
        time_column = _time_of(header, table)
        if time_column is not None:
            k, factor = time_column
            time, clock = header[k], _clock(table[:, k] * factor)
            value_columns.remove(k)
        runs = [table]
        if 8 * table.size > MAX_TABLE_IN_MEMORY:
            runs = excerpts(table, *_RUNS)
        columns = tuple(_column(header[k], table, runs, k) for k in value_columns)
        return cls(file.path, len(table), time, *clock, columns, tuple(notes))


def _grid_and_noise(runs: list[Array]) -> tuple[float, float]:
    """Quantisation step and noise of the numbers in several blocks of rows."""
    if min(map(np.min, runs)) == max(map(np.max, runs)):
        return 0.0, 0.0
    grid = quantum(runs)
    if min(map(len, runs)) < _MIN_ROWS_FOR_NOISE:
        return grid, 0.0
    row_numbers, columns = list[Array](), list[Array]()
    for run in runs:
        row_numbers.append(np.arange(len(run), dtype=float))
        columns.append(run[:, None])
    return grid, float(noise(row_numbers, columns, grid)[0])


def _time_of(header: Sequence[str], table: Array) -> tuple[int, float] | None:
    """Time column and its factor to seconds, by its unit, or by its numbers if they count from 1970."""
    candidates = []
    for k, cell in enumerate(header):
        name, unit = split_unit(cell)
        meaning = time_meaning(name)
        if meaning is not None:
            rank, unit_of_name = meaning
            unit = unit or unit_of_name or unit_since_1970(table[:, k]) or "s"
            candidates.append((rank, k, time_factor(unit) or 1.0))
    if not candidates:
        return None
    _, k, factor = min(candidates)
    return k, factor


def _clock(t: Array) -> tuple[float, float, int, float, int, int, float]:
    steps = np.diff(t)
    ahead = steps[steps > 0]
    median = float(np.median(ahead)) if ahead.size else np.nan
    regular = ahead[ahead < GAP * median]
    return (
        float(t[-1] - t[0]),
        1.0 / median,
        int((ahead >= GAP * median).sum()),
        float(ahead.max(initial=0.0)),
        int((steps == 0).sum()),
        int((steps < 0).sum()),
        float(regular.std()) if regular.size else np.nan,
    )


def _column(name: str, table: Array, runs: Sequence[Array], k: int) -> LogColumn:
    x = table[:, k]
    least, most = float(x.min()), float(x.max())
    constant = least == most
    counts = [int((x == extreme).sum()) for extreme in (least, most) if extreme != 0]
    rows_at_extreme = max(counts, default=0)
    saturated_share = 0.0
    if not constant and rows_at_extreme >= max(_MIN_SATURATED_ROWS, _MIN_SATURATED_SHARE * len(x)):
        saturated_share = rows_at_extreme / len(x)
    grid, sigma = _grid_and_noise([run[:, k] for run in runs])
    return LogColumn(name, least, most, grid, sigma, saturated_share, constant, float((x == 0).mean()))
