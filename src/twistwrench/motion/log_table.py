"""Log table: rows of a log decoded once into float64, in memory or, above 32 MiB, in a memory-mapped temporary file."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from ..core.numbers import printed
from ..errors import TrajectoryError
from ..typing import Array

LARGE = 1 << 25
"""Bytes of a table in memory; larger ones are in a temporary file, whose pages the system evicts."""
ROWS = 1 << 14
"""Rows that passes over a table work on at a time."""


def table_of(portions: Iterable[Array], columns: int, path: Path) -> Array:
    """Table (n, columns) of consecutive portions of rows, writable; raises TrajectoryError if the disk is full.

    >>> table_of([np.ones((2, 3)), np.zeros((1, 3))], 3, Path("log.csv")).shape
    (3, 3)
    """
    with contextlib.ExitStack() as closing:  # a map outlives its file
        parts, rows, file = list[Array](), 0, None
        try:
            for portion in portions:
                rows += len(portion)
                parts.append(portion)
                if 8 * rows * columns <= LARGE and file is None:
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
    """Consecutive slices of so many rows each."""
    rows = rows or ROWS
    return (slice(k, min(k + rows, count)) for k in range(0, count, rows))


def without_times(table: Array, times: Iterable[float]) -> Array:
    """Table without the rows of those times, its first column; the others are moved up in place."""
    end, wrong = 0, list(times)
    for s in slices(len(table)):
        rows = table[s][~np.isin(table[s, 0], wrong)]
        table[end : end + len(rows)] = rows
        end += len(rows)
    return table[:end]


def excerpts(table: Array, count: int, rows: int) -> list[Array]:
    """Up to ``count`` runs of ``rows`` rows evenly spread over the table, its ends included; a short table whole.

    >>> [run[:, 0].tolist() for run in excerpts(np.arange(10.0)[:, None], 2, 3)]
    [[0.0, 1.0, 2.0], [7.0, 8.0, 9.0]]
    """
    if len(table) <= count * rows:
        return [np.asarray(table)]
    firsts = [(len(table) - rows) * k // max(1, count - 1) for k in range(count)]
    return [np.array(table[first : first + rows]) for first in firsts]


def windows(count: int, core: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Windows of ``core`` rows with up to ``margin`` more on either side, and the core's place in each.

    The last core is longer by fewer than ``margin`` rows if they alone would be left.

    >>> [(a.start, a.stop, b.start, b.stop) for a, b in windows(9, 4, 2)]
    [(0, 6, 0, 4), (2, 9, 2, 7)]
    """
    begin = 0
    while begin < count:
        end = begin + core if count - begin >= core + margin else count
        first = max(0, begin - margin)
        yield slice(first, min(end + margin, count)), slice(begin - first, end - first)
        begin = end
