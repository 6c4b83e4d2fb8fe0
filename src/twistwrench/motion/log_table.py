"""Rows of a log, decoded once into a table of float64, and slices of it: blocks, excerpts and windows.

A temporary file without a name holds tables above 32 MiB. :mod:`.motion_file` opens files of any format as such tables.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from ..core.errors import TrajectoryError
from ..core.numbers import number, printed
from ..core.typing import Array

MAX_TABLE_IN_MEMORY = 1 << 25
"""Largest table in memory [bytes]; larger ones are in a temporary file, whose pages the system can evict."""
ROWS = 1 << 14
"""Rows per block in passes over a table."""


MAX_RATIO = 100
"""Largest size of data in multiples of the file's that holds it. Logs are packed to a third to a thirtieth of their size."""
FREE_UNPACKED_SIZE = 1 << 28
"""Size of data that a file of any size may hold [bytes]."""


def most_unpacked(packed: int) -> int:
    """Largest size [bytes] of the data of a file of ``packed`` bytes."""
    return max(FREE_UNPACKED_SIZE, MAX_RATIO * packed)


def check_ratio(path: Path, unpacked: int, packed: int) -> None:
    """Raise TrajectoryError if data of ``unpacked`` bytes are out of proportion to their file of ``packed`` bytes."""
    limit = most_unpacked(packed)
    if unpacked > limit:
        raise TrajectoryError(
            f"{path}: has {number(packed / 2**20)} MiB and unpacks to more than {number(limit / 2**20)} MiB, which no log "
            "does. If it is a log, unpack it before, or save parts of it."
        )


def table_of(portions: Iterable[Array], columns: int, path: Path) -> Array:
    """Writable table (n, columns) of consecutive portions of rows; raises TrajectoryError if the disk is full.

    >>> table_of([np.ones((2, 3)), np.zeros((1, 3))], 3, Path("log.csv")).shape
    (3, 3)
    """
    with contextlib.ExitStack() as closing:  # a memory map outlives its file
        parts, rows, file = list[Array](), 0, None
        try:
            for portion in portions:
                rows += len(portion)
                parts.append(portion)
                if 8 * rows * columns <= MAX_TABLE_IN_MEMORY and file is None:
                    continue
                file = file or closing.enter_context(tempfile.TemporaryFile())
                for part in parts:
                    file.write(np.ascontiguousarray(part, float).data)
                file.flush()
                parts.clear()
        except OSError as problem:
            raise TrajectoryError(
                f"{path}: its rows take {printed(8e-9 * rows * columns, 2)} GB or more in {tempfile.gettempdir()}, "
                f"which cannot be written: {problem.strerror or problem}. Free the space, or set TMPDIR."
            ) from None
        if file is None:
            return np.concatenate([np.zeros((0, columns)), *parts])
        return np.memmap(file, np.float64, "r+", shape=(rows, columns))


def slices(count: int, rows: int = 0) -> Iterator[slice]:
    """Consecutive slices of ``rows`` rows each."""
    rows = rows or ROWS
    return (slice(k, min(k + rows, count)) for k in range(0, count, rows))


def without_times(table: Array, times: Iterable[float]) -> Array:
    """Remove the rows with the given times (first column), in place."""
    end, removed_times = 0, list(times)
    for s in slices(len(table)):
        rows = table[s][~np.isin(table[s, 0], removed_times)]
        table[end : end + len(rows)] = rows
        end += len(rows)
    return table[:end]


def excerpts(table: Array, count: int, rows: int) -> list[Array]:
    """Up to ``count`` runs of ``rows`` rows, evenly spread over the table including its ends; a short table whole.

    >>> [run[:, 0].tolist() for run in excerpts(np.arange(10.0)[:, None], 2, 3)]
    [[0.0, 1.0, 2.0], [7.0, 8.0, 9.0]]
    """
    return [np.array(table[s]) for s in spread_rows(len(table), count, rows)]


def spread_rows(total: int, count: int, rows: int) -> list[slice]:
    """Up to ``count`` slices of ``rows`` rows, evenly spread over ``total`` rows; one slice if these are few.

    >>> spread_rows(10, 2, 3), spread_rows(10, 1, 4), spread_rows(10, 0, 4)
    ([slice(0, 3, None), slice(7, 10, None)], [slice(3, 7, None)], [])
    """
    if count and total <= count * rows:
        return [slice(0, total)]
    if count == 1:
        return [slice((total - rows) // 2, (total - rows) // 2 + rows)]
    firsts = [(total - rows) * k // (count - 1) for k in range(count)]
    return [slice(first, first + rows) for first in firsts]


def windows(count: int, core: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Windows of ``core`` rows with up to ``margin`` more on either side, and the slice of the core in each.

    The last core includes the remaining rows if they are fewer than ``margin``.

    >>> [(a.start, a.stop, b.start, b.stop) for a, b in windows(9, 4, 2)]
    [(0, 6, 0, 4), (2, 9, 2, 7)]
    """
    begin = 0
    while begin < count:
        end = begin + core
        if count - end < margin:
            end = count
        first = max(0, begin - margin)
        yield slice(first, min(end + margin, count)), slice(begin - first, end - first)
        begin = end
