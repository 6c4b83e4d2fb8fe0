"""Binary files of columns: simulation archives, and large npy, npz, parquet and HDF5 files decoded in portions."""

from __future__ import annotations

import contextlib
import json
import math
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import as_path
from ..core.numbers import number
from ..core.third_party import third_party_errors
from ..errors import MissingExtraError, NotFoundError, TrajectoryError
from ..typing import Array
from . import log_table
from .column_names import SUFFIX, time_column
from .log_table import slices, table_of

MOST_UNPACKED = 1 << 30
"""Bytes that a file read whole may unpack to."""
_MARK = "twistwrench simulation"
_MARK_BYTES = 1 << 12


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
    """True if the file begins as archives of NumPy do; False if it cannot be read."""
    try:
        if not path.is_file():  # a pipe would lose what is read of it here
            return False
        with path.open("rb") as file:
            return file.read(2) == b"PK"
    except (OSError, ValueError):
        return False


def is_simulation(path: Path) -> bool:
    """True if ``simulate --npz`` wrote the archive; also if it cannot be read."""
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


Read = Callable[[Sequence[int]], Iterator[Array]]
"""Portions (n, k) of the rows of some columns."""


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """File of columns whose header has been read."""

    path: Path
    header: tuple[str, ...]
    size: int
    """Size of the file, or of its columns unpacked if that is more [bytes]."""
    read: Read
    notes: tuple[str, ...] = ()
    """A sentence for each thing in the file that is not read."""
    advice: str = "remove the row"
    """Remedy of numbers that are not finite."""

    @classmethod
    def of_table(
        cls, path: Path, header: Sequence[str], table: Array, size: int, notes: tuple[str, ...] = ()
    ) -> ArrayFile:
        """File whose columns (n, k) are in memory."""
        return cls(path, tuple(header), size, lambda used: iter([table[:, list(used)]]), notes)

    def table(self, used: Sequence[int]) -> Array:
        """Table (n, len(used)) of those columns; raises TrajectoryError for numbers that are not finite."""
        return table_of(self._portions(used), len(used), self.path)

    def first(self, column: int) -> Array:
        """First numbers of a column, as many as a portion has."""
        return next(self._portions([column]), np.zeros((0, 1)))[:, 0]

    def place(self, row: int) -> str:
        """Place of a row, ``row 3``."""
        return f"row {row + 1}"

    def _portions(self, used: Sequence[int]) -> Iterator[Array]:
        row, portions = 0, self.read(list(used))
        while True:
            reason = f"{self.path}: cannot be read from row {row + 1} on"
            with third_party_errors(
                lambda said, reason=reason: TrajectoryError(f"{reason}: {said}. Is the file cut short?")  # type: ignore[misc]
            ):
                table = next(portions, None)
            if table is None:
                return
            if (odd := ~np.isfinite(table)).any():
                bad = int(odd.any(axis=1).argmax())
                k, count = int(odd[bad].argmax()), int(odd.any(axis=1).sum())
                more = f", and {count - 1} more row{'s' if count > 2 else ''} here" if count > 1 else ""
                raise TrajectoryError(
                    f"{self.path}: row {row + bad + 1}, column {self.header[used[k]]!r} is {table[bad, k]}{more}. Samples must "
                    f"be finite: {self.advice}."
                )
            yield table
            row += len(table)


def simulation_file(path: str | Path) -> ArrayFile:
    """Motion of a simulation that ``simulate --npz`` wrote; raises NotFoundError and TrajectoryError."""
    path = as_path(path)
    if not path.is_file():
        raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a CSV file.")
    advice = "Give one that simulate --npz wrote, whole, or a CSV file."
    unreadable = f"{path}: an archive that cannot be read as a motion"
    with third_party_errors(lambda reason: TrajectoryError(f"{unreadable}: {reason}. {advice}")):
        header, table = _read(path)
    return ArrayFile.of_table(path, header, table, path.stat().st_size)


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


# ── Large files: npy, npz, parquet and HDF5

_NUMBERS = "iufb"


def large_array_file(path: Path) -> ArrayFile | None:
    """File that is decoded in portions; None if it is small, or its columns cannot be read in portions."""
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
    return None if size < log_table.LARGE else ArrayFile(path, tuple(header), size, read, *found[3:])


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

    def read(used: Sequence[int]) -> Iterator[Array]:
        with path.open("rb") as file:
            file.seek(offset)
            for s in slices(shape[0]):
                count = s.stop - s.start
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

    def read(used: Sequence[int]) -> Iterator[Array]:
        wanted = [places[k][:2] for k in used]
        with zipfile.ZipFile(path) as archive, contextlib.ExitStack() as open_files:
            files = {}
            for name in dict.fromkeys(name for name, _ in wanted):
                member, offset, _, _ = heads[name]
                files[name] = open_files.enter_context(archive.open(member))
                files[name].seek(offset)
            for s in slices(rows):
                count, parts = s.stop - s.start, {}
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
        raise MissingExtraError.from_extra("pyarrow", "logs", "Reading parquet") from None
    with pyarrow.parquet.ParquetFile(path) as file:
        fields = list(file.schema_arrow)
        rows = int(file.metadata.num_rows)
    is_number = (pyarrow.types.is_floating, pyarrow.types.is_integer)
    header = [f.name for f in fields if any(test(f.type) for test in is_number)]
    if not header or any(pyarrow.types.is_temporal(f.type) for f in fields):
        return None  # dates are seconds since the first of them
    notes = lists_left_out(fields)

    def read(used: Sequence[int]) -> Iterator[Array]:
        names = [header[k] for k in used]
        with pyarrow.parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(log_table.ROWS, columns=names, use_threads=False):
                columns = [batch.column(name).to_numpy(zero_copy_only=False) for name in names]
                yield np.stack([column.astype(float, copy=False) for column in columns], axis=1)

    return header, rows, read, notes


def lists_left_out(fields: Sequence[Any]) -> tuple[str, ...]:
    """Note on the fields of an arrow schema whose cells are lists or structures of numbers."""
    import pyarrow.types

    nested = [f"{f.name!r} ({f.type})" for f in fields if pyarrow.types.is_nested(f.type)]
    said = "Not read, as each cell holds several values: {}. Write one column for each of them."
    return (said.format(", ".join(nested)),) if nested else ()


def _hdf5(path: Path) -> tuple[list[str], int, Read] | None:
    try:
        import h5py
    except ImportError:
        raise MissingExtraError.from_extra("h5py", "logs", "Reading HDF5") from None
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

    def read(used: Sequence[int]) -> Iterator[Array]:
        wanted = [places[k][:2] for k in used]
        with h5py.File(path, "r") as file:
            for s in slices(rows):
                parts = {name: file[name][s] for name in dict.fromkeys(name for name, _ in wanted)}
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
