"""Quality of a log without a robot: clock, and range, grid, noise and saturation of each column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

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
"""Ratio to the median step from which a step is a gap."""
_EXCERPT_COUNT = 16
"""Number of excerpts of a large file from which grid and noise are estimated."""
_EXCERPT_ROWS = 4096
"""Number of rows of an excerpt."""
_BYTES_PER_NUMBER = 8
_MIN_ROWS_FOR_NOISE = 16
"""Smallest number of rows of an excerpt for an estimate of the noise."""
_MIN_SATURATED_SHARE = 0.01
"""Smallest share of the rows at the extreme of a saturated column."""
_MIN_SATURATED_ROWS = 20
"""Smallest number of rows at the extreme of a saturated column."""


@dataclass(frozen=True)
class LogColumn:
    """One column, in the file's unit."""

    name: str
    """Heading of the column."""
    least: float
    """Smallest value."""
    most: float
    """Largest value."""
    grid: float
    """Step of the quantisation grid; 0 if none is found."""
    noise: float
    """Standard deviation of the noise; 0 if none is found."""
    cut: float
    """Share of the rows that are cut off at an extreme by saturation; 0 if the column is not saturated."""
    dead: bool
    """True if the column is constant."""
    zeros: float = 0.0
    """Share of the rows that are exactly 0."""


@dataclass(frozen=True)
class LogQuality:
    """Quality of a log; times are in seconds, nan without a time column."""

    path: Path
    rows: int
    """Number of rows."""
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
        notes = list(file.notes)
        columns_of_words = text_columns(file)
        all_columns = range(len(file.header))
        number_columns = [k for k in all_columns if k not in columns_of_words]
        if not number_columns:
            number_columns = list(all_columns)  # all are words: reading the first row raises an error with its place
        elif columns_of_words:
            names = [repr(file.header[k]) for k in columns_of_words]
            notes.append(f"Ignored, as they hold words: {listed(names)}.")
        header = [file.header[k] for k in number_columns]
        header_place = str(path)
        if isinstance(file, CsvFile):
            header_place += f": line {file.header_line}"
        check_header(header, header_place)
        table = file.table(number_columns)
        if not len(table):
            raise TrajectoryError(f"{path}: no rows after the header.")
        time_name = ""
        clock = _Clock()
        value_columns = list(range(len(header)))
        time_column = _time_column(header, table)
        if time_column is not None:
            k, factor = time_column
            time_name = header[k]
            clock = _clock_figures(table[:, k] * factor)
            value_columns.remove(k)
        blocks = [table]
        if _BYTES_PER_NUMBER * table.size > MAX_TABLE_IN_MEMORY:
            blocks = excerpts(table, _EXCERPT_COUNT, _EXCERPT_ROWS)
        columns = tuple(_column_quality(header[k], table, blocks, k) for k in value_columns)
        return cls(file.path, len(table), time_name, *clock, columns, tuple(notes))


def _grid_and_noise(blocks: list[Array]) -> tuple[float, float]:
    """Quantisation step and noise of the numbers in several blocks of rows; 0 for those that are not found."""
    is_constant = min(map(np.min, blocks)) == max(map(np.max, blocks))
    if is_constant:
        return 0.0, 0.0
    grid = quantum(blocks)
    if min(map(len, blocks)) < _MIN_ROWS_FOR_NOISE:
        return grid, 0.0
    row_numbers = [np.arange(len(block), dtype=float) for block in blocks]
    columns = [block[:, None] for block in blocks]
    (sigma,) = noise(row_numbers, columns, grid)
    return grid, float(sigma)


def _time_column(header: Sequence[str], table: Array) -> tuple[int, float] | None:
    """Index of the time column and its factor to seconds; None if there is none.

    The unit is in the heading; or it follows from a name such as ``nsec``, or from numbers that count from 1970; else it is s.
    """
    candidates: list[tuple[int, int, float]] = []  # rank, column, factor
    for k, cell in enumerate(header):
        name, unit = split_unit(cell)
        meaning = time_meaning(name)
        if meaning is not None:
            rank, unit_of_name = meaning
            unit = unit or unit_of_name or unit_since_1970(table[:, k]) or "s"
            candidates.append((rank, k, time_factor(unit) or 1.0))
    if not candidates:
        return None
    _, k, factor = min(candidates)  # of the best rank, then the first
    return k, factor


class _Clock(NamedTuple):
    """Fields of :class:`LogQuality` from ``seconds`` to ``jitter``, in their order."""

    seconds: float = np.nan
    rate: float = np.nan
    gaps: int = 0
    longest: float = np.nan
    repeated: int = 0
    backward: int = 0
    jitter: float = np.nan


def _clock_figures(t: Array) -> _Clock:
    """Figures of the clock from its times (n,) [s]."""
    steps = np.diff(t)
    forward_steps = steps[steps > 0]
    median = float(np.median(forward_steps)) if forward_steps.size else np.nan
    regular_steps = forward_steps[forward_steps < GAP * median]
    return _Clock(
        seconds=float(t[-1] - t[0]),
        rate=1.0 / median,
        gaps=int((forward_steps >= GAP * median).sum()),
        longest=float(forward_steps.max(initial=0.0)),
        repeated=int((steps == 0).sum()),
        backward=int((steps < 0).sum()),
        jitter=float(regular_steps.std()) if regular_steps.size else np.nan,
    )


def _column_quality(name: str, table: Array, blocks: Sequence[Array], k: int) -> LogColumn:
    """Quality of column k; grid and noise follow from its numbers in ``blocks`` of rows."""
    x = table[:, k]
    least = float(x.min())
    most = float(x.max())
    is_constant = least == most
    # Many zeros are not saturation: a sensor may rest at an end of its range that is zero.
    counts = [int((x == extreme).sum()) for extreme in (least, most) if extreme != 0]
    rows_at_extreme = max(counts, default=0)
    min_rows = max(_MIN_SATURATED_ROWS, _MIN_SATURATED_SHARE * len(x))
    saturated_share = 0.0
    if not is_constant and rows_at_extreme >= min_rows:
        saturated_share = rows_at_extreme / len(x)
    grid, sigma = _grid_and_noise([block[:, k] for block in blocks])
    zero_share = float((x == 0).mean())
    return LogColumn(name, least, most, grid, sigma, saturated_share, is_constant, zero_share)
