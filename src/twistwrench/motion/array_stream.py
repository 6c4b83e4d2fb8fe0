"""Binary files of columns: archives read whole, and npy, npz, parquet and HDF5 read in blocks of bounded memory."""

from __future__ import annotations

import contextlib
import json
import math
import zipfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import as_path
from ..core.numbers import number
from ..core.third_party import third_party_errors
from ..errors import MissingExtraError, NotFoundError, TrajectoryError
from ..typing import Array
from .column_names import SUFFIX, time_column
from .csv_reader import Block

MOST_UNPACKED = 1 << 30
"""Bytes that a file read whole may unpack to."""
_MARK = "twistwrench simulation"
_MARK_BYTES = 1 << 12
_ROWS_of_npz_file = 1 << 14


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
        with third_party_errors(lambda reason: TrajectoryError(f"{unreadable}: {reason}. {advice}")):
            header, table = _read(path)
        bad = ~np.isfinite(table).all(axis=1)
        if bad.any():
            raise TrajectoryError(
                f"{path}: row {int(bad.argmax()) + 1} has a number that is not finite. Remove the row."
            )
        return cls(path, tuple(header), table, path.stat().st_size)

    def blocks(self, used: Sequence[int]) -> Iterator[Block]:
        """All rows, in blocks: of the ``used`` columns."""
        for k in range(0, len(self.table), _ROWS_of_npz_file):
            rows = self.table[k : k + _ROWS_of_npz_file, list(used)]
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


# ── Blocks of large files: npy, npz, parquet and HDF5

LARGE = 1 << 25
"""Bytes of all columns once unpacked, beyond which a file is not read whole."""
_ROWS = 1 << 14
_NUMBERS = "iufb"

Read = Callable[[Sequence[int], int, int], Iterator[Array]]
"""Of columns, the first row, and the row after the last: portions (n, columns)."""


@dataclass(frozen=True, eq=False)
class ArrayStream:
    """A file of columns whose rows stay in it.

    Attributes
    ----------
    path : Path
    header : tuple of str
    rows : int, of the file
    size : int, of the file, or of its columns unpacked where that is more [bytes]
    read : callable, portions of some columns between two rows
    begin, end : int, the rows that are given
    """

    path: Path
    header: tuple[str, ...]
    rows: int
    size: int
    read: Read
    begin: int = 0
    end: int = -1
    notes: tuple[str, ...] = ()
    """A sentence for each thing in the file that is not read."""

    @classmethod
    def open(cls, path: Path) -> ArrayStream | None:
        """Look at the file; None where it is small, or not made of columns that can be read in portions."""
        suffix = path.suffix.lower() or (".npz" if is_archive(path) else "")
        reader = _READERS.get(suffix)
        if reader is None or not path.is_file():
            return None
        with third_party_errors(lambda reason: TrajectoryError(f"{path}: cannot be read as {suffix[1:]}: {reason}.")):
            found = reader(path)
        if found is None:
            return None
        header, rows, read = found[:3]
        size = max(path.stat().st_size, 8 * rows * len(header))
        return None if size < LARGE else cls(path, tuple(header), rows, size, read, 0, rows, *found[3:])

    def part(self, begin: int, end: int) -> ArrayStream:
        """The same file from one row to another, as far as it has them."""
        return replace(self, begin=max(0, begin), end=min(self.rows, end))

    def blocks(self, used: Sequence[int]) -> Iterator[Block]:
        """All rows, in blocks: of the ``used`` columns, which must be finite numbers."""
        row, bytes_per_row = self.begin, self.size / max(1, self.rows)
        portions = self.read(list(used), self.begin, self.end)
        reason = f"{self.path}: cannot be read from row {row + 1} on"
        while True:
            with third_party_errors(lambda said: TrajectoryError(f"{reason}: {said}. Is the file cut short?")):
                table = next(portions, None)
            if table is None:
                return
            if not np.isfinite(table).all():
                bad = row + int((~np.isfinite(table).all(axis=1)).argmax())
                raise TrajectoryError(f"{self.path}: row {bad + 1} has a number that is not finite. Remove the row.")
            yield Block(table, int(bytes_per_row * len(table)), lambda k, row=row: f"row {row + k + 1}")  # type: ignore[misc]
            row += len(table)

    def excerpts(self, used: Sequence[int], count: int, rows: int) -> list[Block] | None:
        """Up to ``count`` runs of ``rows`` consecutive rows spread evenly over the file, its ends included."""
        whole = self.end - self.begin
        if whole <= count * rows:
            return None
        found = []
        for k in range(count):
            first = self.begin + (whole - rows) * k // (count - 1)
            blocks = list(self.part(first, first + rows).blocks(used))
            table = np.concatenate([b.table for b in blocks])
            found.append(Block(table, 0, blocks[0].place))
        return found


def _npy(path: Path) -> tuple[list[str], int, Read] | None:
    """Rows in C order of one type, or records of numbers."""
    with path.open("rb") as file:
        shape, columns_first, dtype = array_header(file)
        offset = file.tell()
    names = dtype.names
    kinds = [dtype[name].kind if not dtype[name].shape else "-" for name in names] if names else [dtype.kind]
    if columns_first or any(k not in _NUMBERS for k in kinds) or len(shape) != (1 if names else 2):
        return None
    header = list(names) if names else [f"column{k + 1}" for k in range(shape[1])]
    width = dtype.itemsize if names else dtype.itemsize * shape[1]
    if path.stat().st_size < offset + width * shape[0]:
        raise TrajectoryError(f"{path}: has fewer rows than the {shape[0]} that it says. Is the file cut short?")

    def read(used: Sequence[int], begin: int, end: int) -> Iterator[Array]:
        with path.open("rb") as file:
            file.seek(offset + begin * width)
            for first in range(begin, end, _ROWS):
                count = min(_ROWS, end - first)
                data = file.read(count * width)
                if len(data) < count * width:
                    raise TrajectoryError("there are fewer rows than its header says")
                if names:
                    records = np.frombuffer(data, dtype)
                    yield np.stack([records[names[k]] for k in used], axis=1).astype(float, copy=False)
                else:
                    yield np.frombuffer(data, dtype).reshape(count, -1)[:, list(used)].astype(float, copy=False)

    return header, shape[0], read


def _npz(path: Path) -> tuple[list[str], int, Read] | None:
    """Arrays of numbers, those of several columns in C order."""
    found: list[tuple[str, tuple[int, ...]]] = []
    heads: dict[str, tuple[str, int, np.dtype[Any], int]] = {}
    if is_simulation(path):
        return None
    with zipfile.ZipFile(path) as archive:
        for item in archive.infolist():
            name = item.filename.removesuffix(".npy")
            if name == item.filename or name in heads:
                return None
            with archive.open(item) as file:
                shape, columns_first, dtype = array_header(file)
                offset = file.tell()
            if dtype.names or dtype.kind in "bmM" or (columns_first and len(shape) > 1):
                return None
            if dtype.kind in _NUMBERS and len(shape) in (1, 2) and 0 not in shape:
                found.append((name, shape))
                heads[name] = item.filename, offset, dtype, 1 if len(shape) == 1 else shape[1]
    told = _places(found)
    if told is None:
        return None
    rows, places = told

    def read(used: Sequence[int], begin: int, end: int) -> Iterator[Array]:
        wanted = [places[k][:2] for k in used]
        with zipfile.ZipFile(path) as archive, contextlib.ExitStack() as open_files:
            files = {}
            for name in dict.fromkeys(name for name, _ in wanted):
                member, offset, dtype, width = heads[name]
                files[name] = open_files.enter_context(archive.open(member))
                files[name].seek(offset + begin * width * dtype.itemsize)
            for first in range(begin, end, _ROWS):
                count, parts = min(_ROWS, end - first), {}
                for name, file in files.items():
                    _, _, dtype, width = heads[name]
                    data = file.read(count * width * dtype.itemsize)
                    if len(data) < count * width * dtype.itemsize:
                        raise TrajectoryError("there are fewer rows than its header says")
                    parts[name] = np.frombuffer(data, dtype).reshape(count, width)
                yield np.stack([parts[name][:, k or 0] for name, k in wanted], axis=1).astype(float, copy=False)

    return [label for _, _, label in places], rows, read


def _parquet(path: Path) -> tuple[list[str], int, Read, tuple[str, ...]] | None:
    try:
        import pyarrow.parquet
        import pyarrow.types
    except ImportError:
        raise MissingExtraError.of("pyarrow", "logs", "Reading parquet") from None
    with pyarrow.parquet.ParquetFile(path) as file:
        fields = list(file.schema_arrow)
        starts = np.cumsum([0, *(file.metadata.row_group(k).num_rows for k in range(file.metadata.num_row_groups))])
    is_number = (pyarrow.types.is_floating, pyarrow.types.is_integer)
    header = [f.name for f in fields if any(test(f.type) for test in is_number)]
    if not header or any(pyarrow.types.is_temporal(f.type) for f in fields):
        return None  # dates are seconds since the first of them
    notes = lists_left_out(fields)

    def read(used: Sequence[int], begin: int, end: int) -> Iterator[Array]:
        names = [header[k] for k in used]
        groups = [k for k in range(len(starts) - 1) if starts[k] < end and starts[k + 1] > begin]
        row = int(starts[groups[0]]) if groups else 0
        with pyarrow.parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(_ROWS, row_groups=groups, columns=names, use_threads=False):
                a, b = max(begin, row) - row, min(end, row + batch.num_rows) - row
                row += batch.num_rows
                if a < b:
                    part = batch.slice(a, b - a)
                    yield np.stack(
                        [part.column(name).to_numpy(zero_copy_only=False).astype(float, copy=False) for name in names],
                        axis=1,
                    )

    return header, int(starts[-1]), read, notes


def lists_left_out(fields: Sequence[Any]) -> tuple[str, ...]:
    """What is said of the fields of an arrow schema whose cells are lists or structures of numbers."""
    import pyarrow.types

    nested = [f"{f.name!r} ({f.type})" for f in fields if pyarrow.types.is_nested(f.type)]
    said = "Not read, as each cell holds several values: {}. Write one column for each of them."
    return (said.format(", ".join(nested)),) if nested else ()


def _hdf5(path: Path) -> tuple[list[str], int, Read] | None:
    try:
        import h5py
    except ImportError:
        raise MissingExtraError.of("h5py", "logs", "Reading HDF5") from None
    found: list[tuple[str, tuple[int, ...]]] = []

    def look(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in _NUMBERS and item.ndim in (1, 2) and item.size:
            found.append((name, item.shape))

    with h5py.File(path, "r") as file:
        file.visititems(look)
    told = _places(found)
    if told is None:
        return None
    rows, places = told

    def read(used: Sequence[int], begin: int, end: int) -> Iterator[Array]:
        wanted = [places[k][:2] for k in used]
        with h5py.File(path, "r") as file:
            for first in range(begin, end, _ROWS):
                last = min(end, first + _ROWS)
                parts = {name: file[name][first:last] for name in dict.fromkeys(name for name, _ in wanted)}
                yield np.stack([parts[name] if k is None else parts[name][:, k] for name, k in wanted], axis=1).astype(
                    float, copy=False
                )

    return [label for _, _, label in places], rows, read


def _places(found: Sequence[tuple[str, tuple[int, ...]]]) -> tuple[int, list[tuple[str, int | None, str]]] | None:
    """Rows, and of each column its array, its place in it and its label; arrays of another length than most are left out."""
    counts = Counter(shape[0] for _, shape in found for _ in range(1 if len(shape) == 1 else shape[1]))
    if not counts or any(len(shape) == 2 and 1 in shape for _, shape in found):
        return None
    rows = max(counts, key=lambda n: (counts[n], n))
    places: list[tuple[str, int | None, str]] = []
    for name, shape in found:
        if shape[0] == rows and len(shape) == 1:
            places.append((name, None, name))
        elif shape[0] == rows:
            places += [(name, k, f"{name}{k + 1}") for k in range(shape[1])]
    return rows, places


_READERS: dict[str, Callable[[Path], Any]] = {
    ".npy": _npy,
    ".npz": _npz,
    ".parquet": _parquet,
    **dict.fromkeys((".h5", ".hdf5"), _hdf5),
}


# ── Buffered rows of a table that can only be read from its beginning


def passing_runs(tables: Callable[[], Iterable[Array]], count: int, rows: int, *, whole: bool) -> list[Array]:
    """Up to ``count`` runs of ``rows`` rows spread evenly over blocks of a table, which are passed over twice.

    All rows as one run where ``whole``, or where there are no more.

    >>> blocks = [np.arange(6.0).reshape(3, 2), np.arange(6.0, 14.0).reshape(4, 2)]
    >>> [run[:, 0].tolist() for run in passing_runs(lambda: blocks, 2, 2, whole=False)]
    [[0.0, 2.0], [10.0, 12.0]]
    """
    total = 0 if whole else sum(len(table) for table in tables())
    if whole or total <= count * rows:
        return [np.concatenate(list(tables()))]
    firsts = [(total - rows) * k // max(1, count - 1) for k in range(count)]
    runs: list[list[Array]] = [[] for _ in firsts]
    at = 0
    for table in tables():
        for k, first in enumerate(firsts):
            inside = table[max(0, first - at) : max(0, first + rows - at)]
            if len(inside):
                runs[k].append(inside.copy())
        at += len(table)
    return [np.concatenate(run) for run in runs]
