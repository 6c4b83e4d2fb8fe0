"""Motions in files of arrays and tables (npz, npy, MAT, HDF5, parquet, feather), and the writer of CSV files.

An array (n,) is a column called by its name; of one (n, k) the columns are numbered, ``q1`` to ``qk``. Other
arrays, and columns of another length than most, are ignored.
"""

from __future__ import annotations

import contextlib
import math
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.files import replacing
from ..core.tables import CsvWriter
from ..core.third_party import third_party_errors
from ..errors import MissingExtraError, NotFoundError, TrajectoryError
from ..typing import Array
from .array_stream import (
    ArrayFile,
    array_header,
    check_archive,
    check_unpacked,
    is_archive,
    is_simulation,
    lists_left_out,
)

_HDF5 = b"\x89HDF"


def array_file(path: Path) -> ArrayFile | None:
    """The file read whole, or None where its name and first bytes are of no such file.

    Raises NotFoundError, MissingExtraError where a package is missing, and TrajectoryError for what cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix == ".npz" or (is_archive(path) and not suffix):
        if path.is_file() and is_simulation(path):
            return None
        return _made(path, _npz)
    reader = _READERS.get(suffix)
    return None if reader is None else _made(path, reader)


def column_table(arrays: Mapping[str, Any], where: str) -> tuple[list[str], Array]:
    """Header and table (n, columns) of arrays by their names; TrajectoryError begins with ``where``."""
    found: dict[str, Array] = {}
    for name, given in arrays.items():
        values = np.asarray(given)
        if values.dtype.names:
            found |= {
                (f"{name}.{part}" if name else part): _numbers(values[part].ravel()) for part in values.dtype.names
            }
            continue
        if values.dtype.kind not in "iufbmM" or values.ndim == 0 or not values.size:
            continue
        if values.ndim == 2 and 1 in values.shape:
            values = values.ravel()
        if values.ndim == 1:
            found[name] = _numbers(values)
        elif values.ndim == 2:
            found |= {f"{name}{k + 1}": _numbers(column) for k, column in enumerate(values.T)}
    counts = Counter(len(x) for x in found.values() if len(x) > 1)
    if not counts:
        raise TrajectoryError(
            f"{where}: has no arrays of numbers that are as long as each other. Found: {', '.join(arrays) or 'none'}."
        )
    rows = max(counts, key=lambda n: (counts[n], n))
    kept = {name: x for name, x in found.items() if len(x) == rows}
    return list(kept), np.column_stack(list(kept.values()))


def _numbers(values: Array) -> Array:
    """As floats; dates and spans in seconds since the first."""
    if values.dtype.kind in "mM":
        return np.asarray((values - values[:1]) / np.timedelta64(1, "s"), float)
    return values.astype(float)


def _made(path: Path, read: Callable[[Path], Mapping[str, Any]]) -> ArrayFile:
    if not path.is_file():
        raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a file.")
    with third_party_errors(lambda reason: TrajectoryError(f"{path}: cannot be read as {path.suffix[1:]}: {reason}.")):
        arrays = dict(read(path))
        notes = arrays.pop(_NOTES, ())
        header, table = column_table(arrays, str(path))
    return ArrayFile.of_table(path, header, table, path.stat().st_size, notes)


def _npz(path: Path) -> Mapping[str, Any]:
    check_archive(path)
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _npy(path: Path) -> Mapping[str, Any]:
    with path.open("rb") as file:
        shape, _, dtype = array_header(file)
    check_unpacked(path, math.prod(shape) * max(8, dtype.itemsize))
    values = np.load(path, allow_pickle=False)
    return {"": values} if values.dtype.names else {"column": values}


def _mat(path: Path) -> Mapping[str, Any]:
    with path.open("rb") as file:
        head = file.read(128)
        if head[:4] == _HDF5 or b"MATLAB 7.3" in head:
            return {name: np.asarray(x).T for name, x in _hdf5(path).items()}  # MATLAB stores columns first
        data = memoryview(head + file.read())
    return _mat_4(path, data) if 0 in head[:4] else _mat_5(path, data)


_SAVED_AS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Types of numbers by their codes in MAT files of version 5."""
_MATRIX, _COMPRESSED, _COMPLEX = 14, 15, 0x800
_NUMERIC = range(6, 16)
"""Classes of arrays of real numbers, in full, in MAT files of version 5."""


def _damaged(path: Path, what: str) -> TrajectoryError:
    return TrajectoryError(f"{path}: cannot be read as mat: {what}. The file is damaged or cut short: save it again.")


def _mat_5(path: Path, data: memoryview) -> Mapping[str, Any]:
    """Arrays of real numbers of a MAT file of version 5, 6 or 7, whose sizes are checked before they are unpacked.

    SciPy's reader trusts the sizes, and ends the process where they are wrong.
    """
    order = {b"IM": "<", b"MI": ">"}.get(bytes(data[126:128]))
    if order is None:
        raise _damaged(path, "its first 128 bytes are not those of a MAT file")

    def element(of: memoryview, at: int) -> tuple[int, memoryview, int]:
        """Type and bytes of the element there, and the place behind it."""
        if len(of) < at + 8:
            raise _damaged(path, "an array ends before its numbers")
        kind, size = struct.unpack_from(f"{order}II", of, at)
        begin, behind = at + 8, at + 8 + size + (-size % 8 if kind != _COMPRESSED else 0)
        if kind >> 16:  # up to four bytes in the tag itself
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
                raise _damaged(path, f"an array has {len(content)} of the {size} bytes that it says")
        _, flags, at = element(content, 0)
        _, sides, at = element(content, at)
        _, label, at = element(content, at)
        if len(flags) != 8 or len(sides) % 4:
            raise _damaged(path, "an array does not say what it is")
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
                raise _damaged(path, f"{name!r} has {len(values)} numbers, and its shape says {math.prod(shape)}")
            found[name] = values.reshape(shape, order="F")
    return found


def _mat_4(path: Path, data: memoryview) -> Mapping[str, Any]:
    """Arrays of real numbers of a MAT file of version 4."""
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


def _hdf5(path: Path) -> Mapping[str, Any]:
    try:
        import h5py
    except ImportError:
        raise MissingExtraError.from_extra("h5py", "logs", "Reading HDF5") from None
    sizes: dict[str, int] = {}

    def look(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            numbers = item.dtype.kind in "iufbV" and not item.dtype.hasobject and item.size
            sizes[name] = item.size * max(8, item.dtype.itemsize) if numbers else 0

    with h5py.File(path, "r") as file:
        file.visititems(look)
        check_unpacked(path, sum(sizes.values()))
        return {name: file[name][()] if size else np.zeros(0) for name, size in sizes.items()}


_NOTES = "\0notes"
"""Under this name a reader gives sentences on what it leaves out."""


def _arrow(path: Path) -> Mapping[str, Any]:
    try:
        import pyarrow
        import pyarrow.feather
        import pyarrow.parquet
        import pyarrow.types
    except ImportError:
        raise MissingExtraError.from_extra("pyarrow", "logs", f"Reading {path.suffix[1:]}") from None

    def read(fields: Any) -> bool:
        return not (pyarrow.types.is_nested(fields.type) or pyarrow.types.is_string(fields.type))

    if path.suffix.lower() == ".parquet":
        with pyarrow.parquet.ParquetFile(path) as file:
            schema = file.schema_arrow
            wanted = [f.name for f in schema if read(f)]
            check_unpacked(path, 8 * file.metadata.num_rows * len(wanted))
            table = file.read(columns=wanted, use_threads=False)
    else:
        with path.open("rb") as source:
            check_unpacked(path, _feather_bytes(source))
        table = pyarrow.feather.read_table(path, use_threads=False)
        schema = table.schema
    table.validate(full=True)
    found: dict[str, Any] = {f.name: np.zeros(0) for f in schema}
    for field in schema:
        if read(field):
            values = table[field.name].to_numpy()
            del found[field.name]
            found[f"{field.name} [s]" if values.dtype.kind in "mM" else field.name] = values
    return found | {_NOTES: lists_left_out(schema)}


def _feather_bytes(source: Any) -> int:
    """Bytes of all columns of a feather file once unpacked, of 8 bytes a number, by the headers of its batches."""
    import pyarrow

    if source.read(6) != b"ARROW1":
        return 0  # of the first version, which is not compressed
    source.seek(8)
    rows = columns = 0
    for message in pyarrow.MessageReader.open_stream(source):
        if message.type == "schema":
            columns = len(pyarrow.ipc.read_schema(message))
        elif message.type == "record batch":
            meta = message.metadata.to_pybytes()
            table = struct.unpack_from("<I", meta)[0]

            def field(at: int, number: int, meta: bytes = meta) -> int:
                """Place of a field of the FlatBuffers table there."""
                names = at - struct.unpack_from("<i", meta, at)[0]
                return at + struct.unpack_from("<H", meta, names + 4 + 2 * number)[0]

            place = field(table, 2)
            batch = place + struct.unpack_from("<I", meta, place)[0]
            rows += struct.unpack_from("<q", meta, field(batch, 0))[0]
    return 8 * rows * columns


_READERS: Mapping[str, Callable[[Path], Mapping[str, Any]]] = {
    ".npy": _npy,
    ".mat": _mat,
    **dict.fromkeys((".h5", ".hdf5"), _hdf5),
    **dict.fromkeys((".parquet", ".feather", ".arrow"), _arrow),
}


# ── Writing CSV files: a header, and rows of numbers that lose no digit


@dataclass(frozen=True, eq=False)
class TableFile:
    """A CSV file that rows are being added to."""

    writer: CsvWriter

    @staticmethod
    @contextlib.contextmanager
    def writing(path: str | Path | None, header: Sequence[str]) -> Iterator[TableFile | None]:
        """Write a CSV file with that header; yield None, and write nothing, without a path."""
        if path is None:
            yield None
            return
        with replacing(path) as scratch, scratch.open("wb") as file:
            writer = CsvWriter(file)
            writer.row(header)
            yield TableFile(writer)

    def write(self, rows: Array) -> None:
        """Add rows (n, columns), each number with the digits that give it back exactly."""
        self.writer.numbers(rows)
