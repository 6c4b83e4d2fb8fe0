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
"""Largest ratio of the size of unpacked data to the size of their file; packed logs have 3 to 30."""
FREE_UNPACKED_SIZE = 1 << 28
"""Size of data that even the smallest file may hold [bytes]."""
_BYTES_PER_NUMBER = 8


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
    with contextlib.ExitStack() as open_file:  # closed at the end; a memory map outlives its file
        unwritten_portions: list[Array] = []
        row_count = 0
        file = None
        try:
            for portion in portions:
                row_count += len(portion)
                unwritten_portions.append(portion)
                if file is None:
                    if _BYTES_PER_NUMBER * row_count * columns <= MAX_TABLE_IN_MEMORY:
                        continue
                    file = open_file.enter_context(tempfile.TemporaryFile())
                for unwritten in unwritten_portions:
                    file.write(np.ascontiguousarray(unwritten, float).data)
                file.flush()
                unwritten_portions.clear()
        except OSError as error:
            size = 8e-9 * row_count * columns  # GB, with 8 bytes per number
            raise TrajectoryError(
                f"{path}: its rows take {printed(size, 2)} GB or more in {tempfile.gettempdir()}, which "
                f"cannot be written: {error.strerror or error}. Free the space, or set TMPDIR."
            ) from None
        if file is None:
            return np.concatenate([np.zeros((0, columns)), *unwritten_portions])
        return np.memmap(file, np.float64, "r+", shape=(row_count, columns))


def slices(count: int, rows: int = 0) -> Iterator[slice]:
    """Consecutive slices of a table with ``count`` rows: each of ``rows`` rows, or of :data:`ROWS` if ``rows`` is 0."""
    step = rows or ROWS
    return (slice(begin, min(begin + step, count)) for begin in range(0, count, step))


def without_times(table: Array, times: Iterable[float]) -> Array:
    """Table without the rows of the given times (first column). Its memory is that of ``table``, which is overwritten."""
    removed_times = list(times)
    remaining_count = 0
    for block in slices(len(table)):
        is_removed = np.isin(table[block, 0], removed_times)
        remaining_rows = table[block][~is_removed]
        next_count = remaining_count + len(remaining_rows)
        table[remaining_count:next_count] = remaining_rows
        remaining_count = next_count
    return table[:remaining_count]


def excerpts(table: Array, count: int, rows: int) -> list[Array]:
    """Up to ``count`` runs of ``rows`` rows, evenly spread over the table including its ends; a short table whole.

    >>> [run[:, 0].tolist() for run in excerpts(np.arange(10.0)[:, None], 2, 3)]
    [[0.0, 1.0, 2.0], [7.0, 8.0, 9.0]]
    """
    return [np.array(table[run]) for run in spread_rows(len(table), count, rows)]


def spread_rows(total: int, count: int, rows: int) -> list[slice]:
    """Up to ``count`` slices of ``rows`` rows, evenly spread over ``total`` rows; one slice of all if these are fewer.

    >>> spread_rows(10, 2, 3), spread_rows(10, 1, 4), spread_rows(10, 0, 4)
    ([slice(0, 3, None), slice(7, 10, None)], [slice(3, 7, None)], [])
    """
    if count > 0 and total <= count * rows:
        return [slice(0, total)]
    last_begin = total - rows
    if count == 1:
        begins = [last_begin // 2]
    else:
        begins = [last_begin * k // (count - 1) for k in range(count)]
    return [slice(begin, begin + rows) for begin in begins]


def windows(count: int, core: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Pairs of slices for ``count`` rows in cores of ``core`` rows: a core with its margins, and the core in this window.

    A window has up to ``margin`` rows more than its core on either side. The last core includes the remaining rows if they
    are fewer than ``margin``.

    >>> [(window.start, window.stop, core.start, core.stop) for window, core in windows(9, 4, 2)]
    [(0, 6, 0, 4), (2, 9, 2, 7)]
    """
    begin = 0
    while begin < count:
        end = begin + core
        if count - end < margin:
            end = count
        window = slice(max(0, begin - margin), min(end + margin, count))
        yield window, slice(begin - window.start, end - window.start)
        begin = end
