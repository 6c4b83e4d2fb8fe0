"""Motions in files of arrays and tables (npz, npy, MAT, HDF5, parquet, feather) and in archives of simulations.

An array (n,) is a column with the array's name; the columns of an array (n, k) are numbered, ``q1`` to ``qk``. Other
arrays are ignored, as are columns whose length differs from that of most. Rows are decoded in portions if the format
allows it.
"""

from __future__ import annotations

import json
import math
import re
import struct
import weakref
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ...core.errors import MissingExtraError, NotFoundError, TrajectoryError
from ...core.files import read_text
from ...core.numbers import number
from ...core.text import Argument, listed
from ...core.third_party import third_party_errors
from ...core.typing import Array
from .. import log_table
from ..column_names import PART_OF, STATES, SUFFIX, time_column
from ..log_table import FileEnds, check_ratio, most_unpacked, slices, table_of

MOST_UNPACKED = 1 << 30
"""Largest unpacked size [bytes] of data that must be read whole."""
MOST_COLUMNS = 10_000
"""Largest number of columns of an array, and of numbers in a row of it."""
_PORTION = 1 << 26
"""Largest size of a portion of an array [bytes]."""


# ── Columns of a file whose header has been read


def unreadable_rows(path: Path, row: int, reason: str) -> TrajectoryError:
    """Error for rows that cannot be read, counted from 0."""
    return TrajectoryError(f"{path}: cannot be read from row {row + 1} on: {reason}. Is the file cut short?")


@dataclass(frozen=True, eq=False)
class ArrayFile:
    """Columnar file whose header has been read."""

    path: Path
    header: tuple[str, ...]
    size: int
    """Size [bytes]."""
    read: Callable[[Sequence[int]], Iterator[Array]]
    """Function that yields portions (n, k) of the rows of some columns."""
    notes: tuple[str, ...] = ()
    """Sentences about ignored content of the file."""
    advice: str = "remove the row"
    """Remedy for non-finite numbers."""
    epoch: int = 0
    """Stamp [ns] of time 0 of a ROS recording."""
    dataset: str = ""
    """Unit of a LeRobot dataset's positions by its metadata: ``degrees``, ``radians``, ``range`` or ``unknown``."""
    plan: bool = False
    """True if the file is a plan, such as a JointTrajectory, and not a recording."""

    @classmethod
    def from_table(
        cls, path: Path, header: Sequence[str], table: Array, size: int, notes: Sequence[str] = ()
    ) -> ArrayFile:
        """File with columns (n, k) in memory."""
        return cls(path, tuple(header), size, lambda used: iter([table[:, list(used)]]), tuple(notes))

    def table(self, used: Sequence[int]) -> Array:
        """Table (n, len(used)) of the given columns; raises TrajectoryError for non-finite numbers."""
        return table_of(self._portions(used), len(used), self.path)

    def first(self, column: int) -> Array:
        """First portion of a column."""
        return next(self._portions([column]), np.zeros((0, 1)))[:, 0]

    def place(self, row: int) -> str:
        """Description of a row's place, ``row 3``."""
        return f"row {row + 1}"

    def _portions(self, used: Sequence[int]) -> Iterator[Array]:
        row, portions = 0, self.read(used)
        while True:
            with third_party_errors(partial(unreadable_rows, self.path, row)):
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


@dataclass(frozen=True, eq=False)
class StoredArray:
    """Array in a file, or in memory if the file had to be read whole."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    portions: Callable[[int], Iterator[Array]]
    """Function that yields consecutive rows, as many at once as given, split as by :func:`.slices`."""
    names: tuple[str, ...] = ()
    """Names of the columns of an array (n, k); if empty, columns are numbered."""

    @classmethod
    def from_array(cls, given: Any) -> StoredArray:
        """Array in memory; (1, n) and (n, 1) become (n,)."""
        x = np.asarray(given)
        x = x.ravel() if x.ndim == 2 and 1 in x.shape else x
        return cls(x.shape, x.dtype, lambda rows: (x[s] for s in slices(len(x), rows)))

    @property
    def row_size(self) -> int:
        """Size of a row [bytes], numbers as float64."""
        return max(8, self.dtype.itemsize) * math.prod(self.shape[1:])

    @property
    def size(self) -> int:
        """Size of all rows [bytes], numbers as float64."""
        return self.row_size * self.shape[0]


Reader = Callable[[FileEnds], tuple[Mapping[str, StoredArray], tuple[str, ...]]]
"""Function that returns the arrays of a file by name, and sentences about ignored content."""


def array_file(file: FileEnds, episode: int | None = None) -> ArrayFile:
    """Open a file of arrays, or one ``episode`` of it; an archive by another suffix is that of a simulation.

    Raises NotFoundError, MissingExtraError and TrajectoryError.
    """
    path = file.path
    suffix = path.suffix.lower() or ".npz"
    reader = _READERS.get(suffix)
    if reader is None:
        return simulation_file(file)
    if not path.is_file():
        raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a file.")
    if suffix == ".npz" and is_simulation(file):
        return simulation_file(file)
    with third_party_errors(lambda reason: TrajectoryError(f"{path}: cannot be read as {suffix[1:]}: {reason}.")):
        arrays, notes = reader(file)
    wide = [name for name, array in arrays.items() if len(array.shape) and array.row_size > 8 * MOST_COLUMNS]
    if wide:
        said = f"Not read, as a row of it has more than {MOST_COLUMNS} numbers: {listed(wide)}."
        arrays, notes = {name: array for name, array in arrays.items() if name not in wide}, (*notes, said)
    columns = _columns(arrays)
    if not columns:
        raise TrajectoryError(
            f"{path}: has no arrays of numbers that are as long as each other. Found: {listed(arrays) or 'none'}."
            + "".join(f" {note}" for note in notes)
        )

    size = file.size
    with third_party_errors(lambda reason: TrajectoryError(f"{path}: {_EPISODES!r} cannot be read: {reason}.")):
        rows = _rows_of(path, arrays.get(_EPISODES), episode)

    def read(used: Sequence[int]) -> Iterator[Array]:
        chosen, begin = [columns[k] for k in used or (0,)], 0
        names = dict.fromkeys(column.array for column in chosen)
        check_ratio(path, sum(arrays[name].size for name in names), size)
        most = max(1, min(log_table.ROWS, _PORTION // max(1, *(arrays[name].row_size for name in names))))
        begins: dict[int, Array] = {}
        for portions in zip(*(arrays[name].portions(most) for name in names), strict=True):
            parts = dict(zip(names, portions, strict=True))
            here = ... if rows is None else rows[begin : begin + len(portions[0])]
            begin += len(portions[0])
            found = [parts[column.array][column.part][here] for column in chosen]
            for k, x in enumerate(found):
                if x.dtype.kind in "mM":  # dates and durations: seconds since the first
                    found[k] = (x - begins.setdefault(k, x[:1])) / np.timedelta64(1, "s")
            yield np.stack(found, axis=1).astype(float, copy=False)[:, : len(used)]

    dataset = _lerobot(path)[1] if _EPISODES in arrays else ""
    labels = tuple(column.label for column in columns)
    return ArrayFile(path, labels, size, read, notes, dataset=dataset)


@dataclass(frozen=True)
class _Column:
    label: str
    array: str
    part: Any
    """Index of the column within a portion."""


def _columns(arrays: Mapping[str, StoredArray]) -> list[_Column]:
    """Numeric columns of the most frequent length."""
    found: list[tuple[int, _Column]] = []
    for name, array in arrays.items():
        shape, fields = array.shape, array.dtype.names
        if len(shape) == 1 and fields:
            parts = [f for f in fields if array.dtype[f].kind in _NUMBERS and not array.dtype[f].shape]
            found += [(shape[0], _Column(f"{name}.{f}" if name else f, name, f)) for f in parts]
        elif len(shape) == 1 and array.dtype.kind in _NUMBERS:
            found.append((shape[0], _Column(name, name, ...)))
        elif len(shape) == 2 and array.dtype.kind in _NUMBERS:
            names = [f"{name}.{n}" for n in array.names] or [f"{name}{k + 1}" for k in range(shape[1])]
            found += [(shape[0], _Column(label, name, np.s_[:, k])) for k, label in enumerate(names)]
    counts = Counter(n for n, _ in found if n > 1)
    rows = max(counts, key=lambda n: (counts[n], n), default=0)
    return [column for n, column in found if n == rows > 0]


_NUMBERS = "iufbmM"
"""NumPy kinds of numbers, dates and durations."""


def check_unpacked(path: Path, size: int) -> None:
    """Raise TrajectoryError if ``size`` [bytes] exceeds the limit for data read whole."""
    if size > MOST_UNPACKED:
        raise TrajectoryError(
            f"{path}: takes {number(size / 2**30)} GiB once unpacked, and such a file is read whole up to "
            f"{number(MOST_UNPACKED / 2**30)} GiB. Save parts of it, or write CSV, HDF5, parquet, or an npy "
            "file with rows in C order, which are read in portions."
        )


# ── NumPy files


def array_header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, column-major flag and type of an array in NumPy's format; leaves the file at the first number."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, columns_first, dtype = read(file)
    if any(n < 0 for n in shape):
        raise ValueError(f"a shape of {shape}")
    return shape, columns_first, dtype


def _in_numpy_format(path: Path, open_file: Callable[[], BinaryIO]) -> StoredArray:
    """Array in NumPy's format, by rows; a column-major array (n, k) is read whole."""
    with open_file() as file:
        shape, columns_first, dtype = array_header(file)
        offset = file.tell()
    if len(shape) == 2 and 1 in shape:
        shape = (math.prod(shape),)
    whole = columns_first and len(shape) > 1
    if whole:
        check_unpacked(path, math.prod(shape) * max(8, dtype.itemsize))
    rows, *inner = shape or (0,)
    width = dtype.itemsize * math.prod(inner)

    def portions(most: int) -> Iterator[Array]:
        with open_file() as file:
            if whole:
                x = np.lib.format.read_array(file, allow_pickle=False)
                yield from (x[s] for s in slices(len(x), most))
                return
            file.seek(offset)
            for s in slices(rows, most):
                data = file.read((s.stop - s.start) * width)
                if len(data) < (s.stop - s.start) * width:
                    raise TrajectoryError(
                        f"{path}: has fewer rows than the {rows} of its header. Is the file cut short?"
                    )
                yield np.frombuffer(data, dtype).reshape(-1, *inner)

    return StoredArray(shape, dtype, portions)


def _npy(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    array = _in_numpy_format(file.path, file.open)
    return {"" if array.dtype.names else "column": array}, ()


def _npz(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    opened: weakref.WeakValueDictionary[Path, zipfile.ZipFile] = weakref.WeakValueDictionary()

    def archive() -> zipfile.ZipFile:
        """Archive that is open as long as one of its members is."""
        return opened.get(file.path) or opened.setdefault(file.path, zipfile.ZipFile(file.open()))

    def member(name: str) -> BinaryIO:
        return archive().open(name)  # type: ignore[return-value]

    whole = archive()
    names = [name for name in whole.namelist() if name.endswith(".npy")]
    return {name.removesuffix(".npy"): _in_numpy_format(file.path, partial(member, name)) for name in names}, ()


def check_archive(file: FileEnds) -> None:
    """Raise TrajectoryError if the arrays of an archive of NumPy, by their headers, are out of proportion to the file."""
    size = sum(math.prod(a.shape) * max(8, a.dtype.itemsize) for a in _npz(file)[0].values())
    check_unpacked(file.path, size)
    check_ratio(file.path, size, file.size)


# ── Archives written by simulate --npz

_MARK = "twistwrench simulation"
_MARK_BYTES = 1 << 12


def is_simulation(file: FileEnds) -> bool:
    """True if ``simulate --npz`` wrote the archive; also True if the archive cannot be read."""
    try:
        with file.open() as whole, zipfile.ZipFile(whole) as archive:
            if "format.npy" not in archive.namelist():
                return False
            with archive.open("format.npy") as mark:
                shape, _, dtype = array_header(mark)  # type: ignore[arg-type]
                said = mark.read(min(_MARK_BYTES, dtype.itemsize))
            coding = "utf-32-be" if dtype.byteorder == ">" else "utf-32-le"
            return shape == () and dtype.kind == "U" and said.decode(coding).startswith(_MARK)
    except Exception:  # any NumPy error: the later read reports it
        return True


def simulation_file(file: FileEnds) -> ArrayFile:
    """Motion from an archive of ``simulate --npz``; raises TrajectoryError."""
    path = file.path
    advice = "Give one that a simulation wrote, whole, or a CSV file."
    unreadable = f"{path}: an archive that cannot be read as a motion"
    with third_party_errors(lambda reason: TrajectoryError(f"{unreadable}: {reason}. {advice}")):
        check_archive(file)
        with file.open() as whole, np.load(whole, allow_pickle=False) as archive:
            if not str(archive["format"]).startswith(_MARK):
                raise TrajectoryError(f"{path}: an archive of NumPy, but not one that a simulation wrote.")
            said = json.loads(str(archive["said"]))
            columns, header = [np.asarray(archive["times"], float)[:, None]], [time_column(said["coordinate_names"])]
            for part in STATES:
                names = said["coordinate_names" if part == "q" else "velocity_names"]
                header += [f"{name}{SUFFIX[part]}" for name in names]
                columns.append(np.asarray(archive[part], float).reshape(len(columns[0]), len(names)))
    found = ArrayFile.from_table(path, header, np.concatenate(columns, axis=1), file.size)
    return replace(found, plan=True)  # computed, and not recorded


# ── HDF5, and MATLAB files since version 7.3, which are HDF5


def _hdf5(file: FileEnds, *, columns_first: bool = False) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Arrays of an HDF5 file; ``columns_first`` for arrays stored transposed, as by MATLAB."""
    try:
        import h5py
    except ImportError:
        raise MissingExtraError.from_extra("h5py", "logs", "Reading HDF5") from None
    path, size = file.path, file.size
    found: dict[str, StoredArray] = {}
    ignored: dict[str, list[str]] = {}

    def look(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        shape = item.shape or ()
        if reason := _ignored_storage(item, size):
            ignored.setdefault(reason, []).append(name)
            return
        shape = (math.prod(shape),) if len(shape) == 2 and 1 in shape else shape[::-1] if columns_first else shape
        found[name] = StoredArray(shape, item.dtype, partial(portions, name, *shape[:1]))

    def portions(name: str, count: int, most: int) -> Iterator[Array]:
        with h5py.File(path, "r") as data:
            x: Any = data[name]
            ndim, first, line = x.ndim, len(x), x.ndim == 2 and 1 in x.shape
            if x.dtype.names:  # texts beside numbers are left in the file
                x = x.fields([f for f in x.dtype.names if x.dtype[f].kind in _NUMBERS])
            for s in slices(count, most):
                if line:
                    yield x[0, s] if first == 1 else x[s, 0]
                else:
                    yield x[:, s].T if columns_first and ndim == 2 else x[s]

    with h5py.File(path, "r") as data:
        data.visititems(look)
    return found, tuple(f"Not read, as {reason}: {listed(names)}." for reason, names in ignored.items())


_FILTERS = {1, 2, 3, 4, 5, 6, 32000}
"""Codes of the filters that come with h5py: deflate, shuffle, fletcher32, szip, nbit, scale-offset, LZF. HDF5 would look for
others on this machine."""
_MOST_CHUNK = 1 << 26
"""Largest chunk of a dataset [bytes], which HDF5 unpacks whole."""


def _ignored_storage(item: Any, size: int) -> str:
    """Reason to ignore a dataset of a file of ``size`` bytes: it reaches other files, or is out of proportion; else empty."""
    plan = item.id.get_create_plist()
    if plan.get_external_count() or item.is_virtual:
        return "its numbers are in other files"
    if any(plan.get_filter(k)[0] not in _FILTERS for k in range(plan.get_nfilters())):
        return "its filter does not come with HDF5"
    if item.chunks and math.prod(item.chunks) * item.dtype.itemsize > _MOST_CHUNK:
        return f"its chunks are larger than {number(_MOST_CHUNK / 2**20)} MiB"
    if math.prod(item.shape or ()) * item.dtype.itemsize > most_unpacked(size):
        return "it is too large for the size of the file"
    return ""


# ── MATLAB files


def _mat(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    path, head = file.path, file.start[:128]
    if head[:4] == b"\x89HDF" or b"MATLAB 7.3" in head:
        return _hdf5(file, columns_first=True)
    with file.open() as whole:
        data = memoryview(whole.read())
    arrays = _mat_4(path, data) if 0 in head[:4] else _mat_5(path, data)
    return {name: StoredArray.from_array(x) for name, x in arrays.items()}, ()


_SAVED_AS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Number types by their codes in MAT files of version 5."""
_MATRIX, _COMPRESSED, _COMPLEX = 14, 15, 0x800
_NUMERIC = range(6, 16)
"""Classes of dense real arrays in MAT files of version 5."""


def _damaged(path: Path, what: str) -> TrajectoryError:
    return TrajectoryError(f"{path}: cannot be read as mat: {what}. The file is damaged or cut short: save it again.")


def _mat_5(path: Path, data: memoryview) -> dict[str, Any]:
    """Real arrays of a MAT file of version 5, 6 or 7; sizes are checked before unpacking.

    SciPy's reader does not check the sizes and crashes the process if they are wrong.
    """
    order = {b"IM": "<", b"MI": ">"}.get(bytes(data[126:128]))
    if order is None:
        raise _damaged(path, "its first 128 bytes are not those of a MAT file")

    def element(of: memoryview, at: int) -> tuple[int, memoryview, int]:
        """Type, data and end offset of the element at offset ``at``."""
        if len(of) < at + 8:
            raise _damaged(path, "an array ends before its numbers")
        kind, size = struct.unpack_from(f"{order}II", of, at)
        begin, behind = at + 8, at + 8 + size + (-size % 8 if kind != _COMPRESSED else 0)
        if kind >> 16:  # small element: up to four bytes within the tag
            kind, size, begin, behind = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if size > (4 if begin == at + 4 else len(of) - begin):
            raise _damaged(path, f"an element of {size} bytes does not fit into the {len(of) - begin} that are left")
        return kind, of[begin : begin + size], behind

    parts, unpacked, at = [], 0, 128
    while at < len(data):
        kind, content, at = element(data, at)
        size = len(content)
        if kind == _COMPRESSED:
            tag = zlib.decompressobj().decompress(content, 8)
            if len(tag) < 8:
                raise _damaged(path, "a compressed array has no size")
            kind, size = struct.unpack(f"{order}II", tag)
            parts.append((kind, size, content, True))
        else:
            parts.append((kind, size, content, False))
        unpacked += size
    check_unpacked(path, unpacked)
    found: dict[str, Any] = {}
    for kind, size, content, packed in parts:
        if kind != _MATRIX:
            continue
        if packed:
            content = memoryview(zlib.decompressobj().decompress(content, size + 8))[8:]
            if len(content) < size:
                raise _damaged(path, f"an array has {len(content)} of the {size} bytes of its header")
        _, flags, at = element(content, 0)
        _, sides, at = element(content, at)
        _, label, at = element(content, at)
        if len(flags) != 8 or len(sides) % 4:
            raise _damaged(path, "an array has no type")
        (said,), name = struct.unpack_from(f"{order}I", flags), bytes(label).decode("ascii", "replace")
        found[name] = np.zeros(0)
        if said & 0xFF in _NUMERIC and not said & _COMPLEX and not name.startswith("__"):
            saved_as, numbers, _ = element(content, at)
            shape = np.frombuffer(sides, f"{order}i4").tolist()
            if saved_as not in _SAVED_AS or min(shape, default=-1) < 0:
                raise _damaged(path, f"{name!r} has numbers of type {saved_as} and the shape {shape}")
            values = np.frombuffer(
                numbers[: len(numbers) // int(_SAVED_AS[saved_as][1]) * int(_SAVED_AS[saved_as][1])],
                order + _SAVED_AS[saved_as],
            )
            if math.prod(shape) != len(values):
                raise _damaged(path, f"{name!r} has {len(values)} numbers, and its shape has {math.prod(shape)}")
            found[name] = values.reshape(shape, order="F")
    return found


def _mat_4(path: Path, data: memoryview) -> dict[str, Any]:
    """Real arrays of a MAT file of version 4."""
    found: dict[str, Any] = {}
    at = 0
    while at < len(data):
        if len(data) < at + 20:
            raise _damaged(path, "an array has no size")
        order = "<" if struct.unpack_from("<i", data, at)[0] in range(5000) else ">"
        mopt, rows, columns, complex_, length = struct.unpack_from(f"{order}5i", data, at)
        saved_as = ("f8", "f4", "i4", "i2", "u2", "u1")[mopt // 10 % 10] if mopt // 10 % 10 < 6 else ""
        count = rows * columns * (2 if complex_ else 1)
        end = at + 20 + length + count * int(saved_as[1:] or 0)
        if mopt not in range(5000) or not saved_as or min(rows, columns, length) < 0 or end > len(data):
            raise _damaged(path, f"an array of {rows} rows and {columns} columns does not fit into it")
        name = bytes(data[at + 20 : at + 20 + length]).split(b"\0")[0].decode("ascii", "replace")
        values = np.frombuffer(data[at + 20 + length : end], order + saved_as)
        found[name] = values.reshape((rows, columns), order="F") if mopt % 10 == 0 and not complex_ else np.zeros(0)
        at = end
    return found


# ── Arrow tables: parquet and feather


def _arrow(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    path = file.path
    try:
        import pyarrow.types as kinds
    except ImportError:
        raise MissingExtraError.from_extra("pyarrow", "logs", f"Reading {path.suffix[1:]}") from None
    if path.suffix.lower() == ".parquet":
        schema, rows, read, counts = _parquet(path)
    else:
        schema, rows, read = _feather(path)
        counts = Counter()

    def portions(name: str, most: int) -> Iterator[Array]:
        for column in read(name, most):
            column.validate(full=True)
            yield column.to_numpy(zero_copy_only=False)

    names = _lerobot(path)[0] if {_STATE, _EPISODES} & {*schema.names} else {}
    found, number = {}, np.dtype(float)
    for field in schema:
        rows_of = partial(portions, field.name)
        if any(test(field.type) for test in (kinds.is_floating, kinds.is_integer, kinds.is_boolean)):
            found[field.name] = StoredArray((rows,), number, rows_of)
        elif any(test(field.type) for test in (kinds.is_timestamp, kinds.is_date, kinds.is_duration)):
            found[f"{field.name} [s]"] = StoredArray((rows,), number, rows_of)
        elif kinds.is_nested(field.type) and 8 * counts.get(field.name, 0) > most_unpacked(path.stat().st_size):
            found[field.name] = StoredArray((), np.dtype(object), rows_of)
        elif kinds.is_list(field.type) or kinds.is_fixed_size_list(field.type):
            found[field.name] = _lists(path, field.name, rows, rows_of, names.get(field.name, ()))
        else:
            found[field.name] = StoredArray((), np.dtype(object), rows_of)
    nested = ", ".join(f"{f.name!r} ({f.type})" for f in schema if kinds.is_nested(f.type) and not found[f.name].shape)
    said = f"Not read, as each cell holds several values: {nested}. Write one column for each of them."
    return found, (said,) if nested else ()


def _parquet(path: Path) -> tuple[Any, int, Callable[[str, int], Iterator[Any]], Counter[str]]:
    """Schema and rows of a parquet file, a function that yields a column in portions, and the number of values by column."""
    import pyarrow.parquet

    def read(name: str, most: int) -> Iterator[Any]:
        with pyarrow.parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(most, columns=[name], use_threads=False):
                yield batch.column(0)

    counts = Counter[str]()
    with pyarrow.parquet.ParquetFile(path) as file:
        about = file.metadata
        for group in map(about.row_group, range(about.num_row_groups)):
            for part in map(group.column, range(group.num_columns)):
                counts[part.path_in_schema.partition(".")[0]] += part.num_values
        return file.schema_arrow, int(about.num_rows), read, counts


def _feather(path: Path) -> tuple[Any, int, Callable[[str, int], Iterator[Any]]]:
    """Schema and number of rows of a feather file, and a function that yields a column in portions; only it is unpacked."""
    import pyarrow.dataset
    import pyarrow.ipc

    with path.open("rb") as source:
        if source.read(len(_ARROW)) != _ARROW:
            raise TrajectoryError(
                f"{path}: is not an Arrow file, which begins with {_ARROW.decode()}. Feather version 1 is not read: write the "
                "table again with pyarrow.feather.write_feather, which writes version 2, or as parquet or CSV."
            )

    def opened(*fields: int) -> Any:
        options = pyarrow.ipc.IpcReadOptions(included_fields=list(fields), use_threads=False)
        return pyarrow.ipc.open_file(path, options=options)

    def read(name: str, most: int) -> Iterator[Any]:
        left: list[Any] = []
        with opened(schema.get_field_index(name)) as file:
            for k in range(file.num_record_batches):
                left.append(file.get_batch(k).column(0))
                while sum(map(len, left)) >= most:
                    whole = pyarrow.concat_arrays(left)
                    yield whole[:most]
                    left = [whole[most:]]
        if sum(map(len, left)):
            yield pyarrow.concat_arrays(left)

    with opened() as file:
        schema = file.schema
    return schema, int(pyarrow.dataset.dataset(path, format="feather").count_rows()), read


_ARROW = b"ARROW1"


def _lists(
    path: Path, name: str, rows: int, portions: Callable[[int], Iterator[Array]], names: Sequence[str]
) -> StoredArray:
    """Array (n, k) of a column of lists; without a shape unless they are numeric and the first ones equally long."""
    first = next(portions(log_table.ROWS), np.zeros(0))
    width = np.asarray(first[0]).size if len(first) else 0
    alike = all(cell is not None and np.size(cell) == width for cell in first)
    if not (width and alike) or np.asarray(first[0]).dtype.kind not in "iufb":
        return StoredArray((), np.dtype(object), portions)

    def stacked(most: int) -> Iterator[Array]:
        row = 0
        for portion in portions(most):
            if odd := [k for k, cell in enumerate(portion, row + 1) if cell is None or len(cell) != width]:
                raise TrajectoryError(
                    f"{path}: row {odd[0]} of {name!r} is not a list of {width} numbers, as the first row is."
                )
            yield np.array([np.asarray(cell, float) for cell in portion]).reshape(-1, width)
            row += len(portion)

    if name == _STATE:
        names = names if len(names) == width else [str(k + 1) for k in range(width)]
        names = [each if each.rpartition(".")[2] in PART_OF else f"{each}.pos" for each in names]
    return StoredArray((rows, width), np.dtype(float), stacked, tuple(names) if len(names) == width else ())


# ── LeRobot datasets: parquet with meta/info.json

_EPISODES = "episode_index"
"""Column of the episodes of a LeRobot dataset."""
_LEVELS = 3
"""Folders from an episode's file to the dataset's: ``DATASET/data/chunk-000/episode_000000.parquet``."""
_MOST_METADATA = 1 << 22
"""Largest size of ``meta/info.json`` [bytes]."""
_STATE = "observation.state"
"""Column of the positions of a LeRobot dataset."""


def _lerobot(path: Path) -> tuple[dict[str, list[str]], str]:
    """Element names of a dataset's list columns and unit of positions, from ``meta/info.json`` of the dataset's folder."""
    above = (folder / "meta" / "info.json" for folder in path.absolute().parents[:_LEVELS])
    info = next((file for file in above if file.is_file()), None)
    if info is None:
        return {}, "unknown"
    try:
        text = read_text(info, _MOST_METADATA)
        features = json.loads(text)["features"]
        named = {name: feature.get("names") for name, feature in features.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as problem:
        raise TrajectoryError(
            f"{info}: is not the metadata of a LeRobot dataset: {problem!r}. Mend or remove it."
        ) from None
    found = {}
    for name, names in named.items():
        while isinstance(names, dict) and len(names) == 1:  # {"motors": [...]}
            names = next(iter(names.values()))
        if isinstance(names, list) and all(isinstance(each, str) for each in names):
            found[name] = names
    if "range_m100_100" in text:
        return found, "range"
    unit = re.search(r'"(?:units?|use_degrees)"\s*:\s*"?(deg|rad|true)', text)
    return found, {"deg": "degrees", "true": "degrees", "rad": "radians"}[unit[1]] if unit else "unknown"


def _rows_of(path: Path, episodes: StoredArray | None, episode: int | None) -> Array | None:
    """Mask (n,) of the rows of an episode; None for all. Raises TrajectoryError if the episode is missing."""
    if episodes is None:
        if episode is not None:
            raise TrajectoryError(
                f"{path}: {{0}} is for datasets with a column {_EPISODES!r}, and none is here.", Argument("episode")
            )
        return None
    check_ratio(path, episodes.size, path.stat().st_size)
    index = np.concatenate([np.zeros(0), *episodes.portions(log_table.ROWS)])
    if not np.isfinite(index).all():
        raise TrajectoryError(f"{path}: {_EPISODES!r} has missing numbers. Each row needs its episode.")
    there = np.unique(index).astype(int)
    if episode is None and len(there) < 2:
        return None
    if episode is None or episode not in there:
        wrong = "several episodes" if episode is None else f"no episode {episode}"
        raise TrajectoryError(
            f"{path}: has {wrong}: {there[0]} to {there[-1]}. Choose one: {{0}}.", Argument("episode", int(there[0]))
        )
    return np.asarray(index == episode)


_READERS: Mapping[str, Reader] = {
    ".npy": _npy,
    ".npz": _npz,
    ".mat": _mat,
    **dict.fromkeys((".h5", ".hdf5"), _hdf5),
    **dict.fromkeys((".parquet", ".feather", ".arrow"), _arrow),
}
