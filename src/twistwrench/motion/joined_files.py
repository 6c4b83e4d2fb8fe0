"""Several files of one motion, written ``a.csv+b.csv``: joined by their stamps, or row by row where they have none.

Columns that are called alike in several files get the quantity that their file's name says: ``Joint_1`` of ``pos_data.csv`` and
``curr_data.csv`` are ``Joint_1`` and ``Joint_1.torque``; else the file's name stands before them, ``left:Joint_1``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from ..errors import TrajectoryError
from ..typing import Array
from .array_stream import LARGE
from .column_names import PART_OF, time_meaning
from .column_suffixes import SUFFIX
from .column_units import split_unit, time_factor
from .row_block import Block

JOINS = "+"
_ROWS = 1 << 14
_PART_OF = PART_OF | dict.fromkeys(("curr", "current", "currents"), "tau")
"""What words of a file's name say of the columns in it."""
_SAME_STAMPS = 1e-6
"""s."""


class Table(Protocol):
    """A file of columns, as each reader gives it."""

    @property
    def path(self) -> Path:
        """Of the file."""

    @property
    def header(self) -> tuple[str, ...]:
        """Names of its columns."""

    @property
    def size(self) -> int:
        """Of the file [bytes]."""

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each thing in the file that is not read."""

    def blocks(self, used: Sequence[int]) -> Iterator[Block]:
        """All rows of some columns, in blocks."""


@dataclass(frozen=True, eq=False)
class JoinedFile:
    """Files of one motion, side by side."""

    path: Path
    header: tuple[str, ...]
    parts: tuple[Table, ...]
    places: tuple[tuple[int, int], ...]
    """Of each column of the header: the file, and the column in it."""
    stamps: tuple[int | None, ...]
    """Of each file: its column of time."""
    size: int
    notes: tuple[str, ...] = ()

    @classmethod
    def open(cls, path: str | Path, reader: Callable[[str], Table]) -> JoinedFile:
        """Open each of the files that ``a.csv+b.csv`` names; raises what their readers raise, and TrajectoryError."""
        names = [name.strip() for name in str(path).split(JOINS)]
        if not all(names):
            raise TrajectoryError(
                f"{path}: files of one motion are written a.csv{JOINS}b.csv, with a name on both sides."
            )
        parts = tuple(reader(name) for name in names)
        stamps = tuple(_time_of(part.header) for part in parts)
        with_time = [s is not None for s in stamps]
        if any(with_time) and not all(with_time):
            bare = parts[with_time.index(False)]
            raise TrajectoryError(
                f"{bare.path}: has no column of time, and the file it is joined with has one. Both need one, or neither."
            )
        places = [(k, c) for k, part in enumerate(parts) for c in range(len(part.header)) if k == 0 or c != stamps[k]]
        cells = [parts[k].header[c] for k, c in places]
        twice = {cell for cell, count in Counter(filter(None, cells)).items() if count > 1}
        header = [
            _told_apart(cell, parts[k].path) if cell in twice else cell
            for cell, (k, _) in zip(cells, places, strict=True)
        ]
        size, notes = sum(part.size for part in parts), tuple(note for part in parts for note in part.notes)
        return cls(Path(str(path)), tuple(header), parts, tuple(places), stamps, size, notes)

    def blocks(self, used: Sequence[int]) -> Iterator[Block]:
        """All rows, in blocks: of the ``used`` columns. Files whose stamps differ are read whole, as they may be anywhere."""
        if self.size > LARGE and self._one_clock:
            yield from self._side_by_side(used)
            return
        wanted = [self.places[k] for k in used]
        tables, times = [], []
        for k, part in enumerate(self.parts):
            own = [c for file, c in wanted if file == k]
            stamp = self.stamps[k]
            columns = own if stamp is None else [*own, stamp]
            whole = np.concatenate([b.table for b in part.blocks(columns)] or [np.zeros((0, len(columns)))])
            times.append(None if stamp is None else whole[:, -1] * _seconds(part.header[stamp]))
            tables.append(whole[:, : len(own)])
        table = self._joined(tables, times)
        table = table[:, _in_order(wanted)]
        for k in range(0, len(table), _ROWS):
            rows = table[k : k + _ROWS]
            yield Block(rows, int(self.size * len(rows) / len(table)), lambda row, k=k: f"row {k + row + 1}")  # type: ignore[misc]

    @cached_property
    def _one_clock(self) -> bool:
        """Whether rows of one number belong together: no file has stamps, or all have the same."""
        if self.stamps[0] is None:
            return True
        columns = [([s], _seconds(p.header[s])) for p, s in zip(self.parts, self.stamps, strict=True) if s is not None]
        stamps = [
            (b.table[:, 0] * factor for b in part.blocks(column))
            for part, (column, factor) in zip(self.parts, columns, strict=True)
        ]
        try:
            return all(np.abs(t - t[0]).max(initial=0.0) <= _SAME_STAMPS for t in _abreast(stamps))
        except _UnevenError:
            return False

    def _side_by_side(self, used: Sequence[int]) -> Iterator[Block]:
        """Rows of one number, block by block; raises TrajectoryError where one file has more of them."""
        wanted, row = [self.places[k] for k in used], 0
        order = _in_order(wanted)
        mine = [[c for file, c in wanted if file == k] for k in range(len(self.parts))]
        files = [k for k, columns in enumerate(mine) if columns]
        share = self.size / sum(self.parts[k].size for k in files)
        read = [(b.table for b in self.parts[k].blocks(mine[k])) for k in files]
        try:
            for tables in _abreast(read):
                first = row
                row += len(tables[0])
                table = np.concatenate(tables, axis=1)[:, order]
                yield Block(table, int(share * 8 * table.size), lambda k, first=first: f"row {first + k + 1}")  # type: ignore[misc]
        except _UnevenError as problem:
            raise TrajectoryError(
                f"{self.path}: files without a time are joined row by row, and their rows differ: "
                f"{self.parts[files[problem.which]].path.name} has more than the {row} of another. Cut them alike, or "
                "give each a column of time."
            ) from None

    def excerpts(self, used: Sequence[int], count: int, rows: int) -> list[Block] | None:
        """None: it is read whole."""
        del used, count, rows
        return None

    def _joined(self, tables: list[Array], times: list[Array | None]) -> Array:
        first = times[0]
        if first is None:
            counts = [len(table) for table in tables]
            if len(set(counts)) > 1:
                said = ", ".join(f"{part.path.name} {n}" for part, n in zip(self.parts, counts, strict=True))
                raise TrajectoryError(
                    f"{self.path}: files without a time are joined row by row, and their rows differ: {said}. Cut them alike, "
                    "or give each a column of time."
                )
            return np.concatenate(tables, axis=1)
        begin = max(float(t[0]) for t in times if t is not None and len(t))
        end = min(float(t[-1]) for t in times if t is not None and len(t))
        kept = (first >= begin) & (first <= end)
        if not kept.any():
            raise TrajectoryError(f"{self.path}: the stamps of the files do not overlap, so they are no one recording.")
        found = [tables[0][kept]]
        for table, time in zip(tables[1:], times[1:], strict=True):
            if time is None:
                continue
            if len(time) == len(first) and np.abs(time - first).max() <= _SAME_STAMPS:
                found.append(table[kept])
            else:
                found.append(
                    np.stack([np.interp(first[kept], time, x) for x in table.T], axis=1).reshape(kept.sum(), -1)
                )
        return np.concatenate(found, axis=1)


class _UnevenError(Exception):
    """One of several files has rows left when another has none."""

    def __init__(self, which: int) -> None:
        super().__init__()
        self.which = which


def _abreast(parts: Sequence[Iterator[Array]]) -> Iterator[list[Array]]:
    """Portions of equally many rows from each of several, which come in portions of any length."""
    kept = [next(part, None) for part in parts]
    while all(x is not None for x in kept):
        some = [x for x in kept if x is not None]
        count = min(map(len, some))
        yield [x[:count] for x in some]
        kept = [x[count:] if len(x) > count else next(part, None) for x, part in zip(some, parts, strict=True)]
    if (left := [k for k, x in enumerate(kept) if x is not None and len(x)]) and len(left) < len(kept):
        raise _UnevenError(left[0])


def _in_order(wanted: Sequence[tuple[int, int]]) -> Array:
    """Takes columns that stand file by file to the order in which they were wanted."""
    return np.argsort(np.argsort([file for file, _ in wanted], kind="stable"), kind="stable")


def _time_of(header: Sequence[str]) -> int | None:
    """The column of a file that is surest to be time."""
    ranked = sorted(
        (rank[0], k) for k, cell in enumerate(header) if (rank := time_meaning(split_unit(cell)[0])) is not None
    )
    return ranked[0][1] if ranked else None


def _seconds(cell: str) -> float:
    name, unit = split_unit(cell)
    said = unit or (time_meaning(name) or (0, None))[1]
    return (time_factor(said) or 1.0) if said else 1.0


def _told_apart(cell: str, path: Path) -> str:
    stem = path.name.split(".")[0]
    said = {SUFFIX[_PART_OF[word]] for word in re.findall(r"[^\W\d_]+", stem.casefold()) if word in _PART_OF}
    if len(said) != 1:
        return f"{stem}:{cell}"
    name, unit = split_unit(cell)
    return f"{name}{said.pop()}" + (f" [{unit}]" if unit else "")
