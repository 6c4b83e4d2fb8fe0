"""The motion in an archive that ``simulate --npz`` wrote, as a table under a header."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import as_path
from ..core.foreign_errors import foreign_errors
from ..core.printed_numbers import number
from ..errors import NotFoundError, TrajectoryError
from ..typing import Array
from .column_names import time_column
from .column_suffixes import SUFFIX
from .row_block import Block

MOST_UNPACKED = 1 << 30
"""Bytes that a file read whole may unpack to."""
_MARK = "twistwrench simulation"
_MARK_BYTES = 1 << 12
_ROWS = 1 << 14


def check_unpacked(path: Path, size: int) -> None:
    """Refuse a file whose columns would take more memory than a file read whole may; ``size`` in bytes."""
    if size > MOST_UNPACKED:
        raise TrajectoryError(
            f"{path}: takes {number(size / 2**30)} GiB once unpacked, and such a file is read whole up to "
            f"{number(MOST_UNPACKED / 2**30)} GiB. Save parts of it, or write CSV, HDF5, parquet without dates, or an npy "
            "file with rows in C order, which are read in portions."
        )


def array_header(file: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether columns come first, and type of an array in NumPy's format; the file is at its first number then."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, columns_first, dtype = read(file)
    if any(n < 0 for n in shape):
        raise ValueError(f"a shape of {shape}")
    return shape, columns_first, dtype


def check_archive(path: Path) -> None:
    """Refuse an archive of arrays that would take more memory than a file read whole may, by its headers."""
    size = 0
    with zipfile.ZipFile(path) as archive:
        for item in archive.infolist():
            if item.filename.endswith(".npy"):
                with archive.open(item) as file:
                    shape, _, dtype = array_header(file)
                size += math.prod(shape) * max(8, dtype.itemsize)
    check_unpacked(path, size)


def is_archive(path: Path) -> bool:
    """Whether the file begins as archives of NumPy do; False for what cannot be read."""
    try:
        if not path.is_file():  # a pipe would lose what is read of it here
            return False
        with path.open("rb") as file:
            return file.read(2) == b"PK"
    except (OSError, ValueError):
        return False


def is_simulation(path: Path) -> bool:
    """Whether the archive is one that ``simulate --npz`` wrote; False for what cannot be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            if "format.npy" not in archive.namelist():
                return False
            with archive.open("format.npy") as file:
                shape, _, dtype = array_header(file)
                said = file.read(min(_MARK_BYTES, dtype.itemsize))
            coding = "utf-32-be" if dtype.byteorder == ">" else "utf-32-le"
            return shape == () and dtype.kind == "U" and said.decode(coding).startswith(_MARK)
    except Exception:  # whatever NumPy raises: reading it says what is wrong
        return True


@dataclass(frozen=True, eq=False)
class NpzFile:
    """A motion that is in memory whole."""

    path: Path
    header: tuple[str, ...]
    table: Array
    size: int
    """Of the file [bytes]."""
    notes: tuple[str, ...] = ()
    """A sentence for each thing in the file that is not read."""

    @classmethod
    def open(cls, path: str | Path) -> NpzFile:
        """Read it all; raises :class:`~twistwrench.NotFoundError` and :class:`~twistwrench.TrajectoryError`."""
        path = as_path(path)
        if not path.is_file():
            raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a CSV file.")
        advice = "Give one that simulate --npz wrote, whole, or a CSV file."
        unreadable = f"{path}: an archive that cannot be read as a motion"
        with foreign_errors(lambda reason: TrajectoryError(f"{unreadable}: {reason}. {advice}")):
            header, table = _read(path)
        bad = ~np.isfinite(table).all(axis=1)
        if bad.any():
            raise TrajectoryError(
                f"{path}: row {int(bad.argmax()) + 1} has a number that is not finite. Remove the row."
            )
        return cls(path, tuple(header), table, path.stat().st_size)

    def blocks(self, used: Sequence[int]) -> Iterator[Block]:
        """All rows, in blocks: of the ``used`` columns."""
        for k in range(0, len(self.table), _ROWS):
            rows = self.table[k : k + _ROWS, list(used)]
            if not np.isfinite(rows).all():
                raise TrajectoryError(self._gap(rows, k, used))
            share = len(rows) / len(self.table)
            yield Block(rows, int(self.size * share), lambda row, k=k: f"row {k + row + 1}")  # type: ignore[misc]

    def _gap(self, rows: Array, first: int, used: Sequence[int]) -> str:
        """What is not finite in ``rows``, of which the first has that number; a DataFrame's, as files are read whole."""
        odd = ~np.isfinite(rows)
        row = int(odd.any(axis=1).argmax())
        column, count = int(odd[row].argmax()), int(odd.any(axis=1).sum())
        more = f", and {count - 1} more row{'s' if count > 2 else ''} here" if count > 1 else ""
        return (
            f"{self.path}: row {first + row + 1}, column {self.header[used[column]]!r} is {rows[row, column]}{more}. Samples "
            "must be finite: frame.dropna() leaves such rows out, frame.interpolate() fills them."
        )

    def excerpts(self, used: Sequence[int], count: int, rows: int) -> list[Block] | None:
        """None: it is read whole."""
        del used, count, rows
        return None


def _read(path: Path) -> tuple[list[str], Array]:
    check_archive(path)
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        if not str(archive["format"]).startswith(_MARK):
            raise TrajectoryError(f"{path}: an archive of NumPy, but not one that simulate --npz wrote.")
        said = json.loads(str(archive["said"]))
        columns, header = [np.asarray(archive["times"], float)[:, None]], [time_column(said["coordinate_names"])]
        for part, ending in SUFFIX.items():
            values, names = (
                np.asarray(archive[part], float),
                said["coordinate_names" if part == "q" else "velocity_names"],
            )
            header += [f"{name}{ending}" for name in names]
            columns.append(values.reshape(len(columns[0]), len(names)))
        return header, np.concatenate(columns, axis=1)
