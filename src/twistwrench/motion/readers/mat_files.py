"""Arrays of MATLAB files, MAT versions 4 to 7.3."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import TrajectoryError
from ...core.typing import Array
from .file_ends import FileEnds
from .hdf5_files import read_hdf5
from .stored_array import StoredArray, check_unpacked


def read_mat(file: FileEnds) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Arrays of a MAT file of any version."""
    path, head = file.path, file.start[:128]
    if head[:4] == b"\x89HDF" or b"MATLAB 7.3" in head:
        return read_hdf5(file, columns_first=True)
    with file.open() as whole:
        data = memoryview(whole.read())
    read = _mat_4 if 0 in head[:4] else _mat_5
    arrays = read(path, data)
    return {name: StoredArray.from_array(x) for name, x in arrays.items()}, ()


_SAVED_AS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Number types by their codes in MAT files of version 5."""
_SAVED_AS_4 = {0: "f8", 1: "f4", 2: "i4", 3: "i2", 4: "u2", 5: "u1"}
"""Number types by their codes in MAT files of version 4."""
_CODE_MATRIX, _CODE_COMPRESSED, _COMPLEX_FLAG = 14, 15, 0x800
"""Codes of elements in MAT files of version 5, and the flag of complex arrays."""
_NUMERIC_CLASSES = range(6, 16)
"""Classes of dense real arrays in MAT files of version 5."""


def _damage_error(path: Path, what: str) -> TrajectoryError:
    return TrajectoryError(f"{path}: cannot be read as mat: {what}. The file is damaged or cut short: save it again.")


def _mat_5(path: Path, data: memoryview) -> dict[str, Any]:
    """Real arrays of a MAT file of version 5, 6 or 7; sizes are checked before unpacking.

    SciPy's reader does not check the sizes and crashes the process if they are wrong.
    """
    order = {b"IM": "<", b"MI": ">"}.get(bytes(data[126:128]))
    if order is None:
        raise _damage_error(path, "its first 128 bytes are not those of a MAT file")
    parts, unpacked, offset = [], 0, 128
    while offset < len(data):
        kind, content, offset = _element(path, order, data, offset)
        size, is_packed = len(content), kind == _CODE_COMPRESSED
        if is_packed:
            tag = zlib.decompressobj().decompress(content, 8)
            if len(tag) < 8:
                raise _damage_error(path, "a compressed array has no size")
            kind, size = struct.unpack(f"{order}II", tag)
        parts.append((kind, size, content, is_packed))
        unpacked += size
    check_unpacked(path, unpacked)
    arrays: dict[str, Any] = {}
    for kind, size, content, is_packed in parts:
        if kind != _CODE_MATRIX:
            continue
        if is_packed:
            content = memoryview(zlib.decompressobj().decompress(content, size + 8))[8:]
            if len(content) < size:
                raise _damage_error(path, f"an array has {len(content)} of the {size} bytes of its header")
        name, array = _matrix(path, order, content)
        arrays[name] = array
    return arrays


def _element(path: Path, order: str, data: memoryview, offset: int) -> tuple[int, memoryview, int]:
    """Type, data and end offset of the element at an offset."""
    if len(data) < offset + 8:
        raise _damage_error(path, "an array ends before its numbers")
    kind, size = struct.unpack_from(f"{order}II", data, offset)
    begin = offset + 8
    if kind >> 16:  # small element: up to four bytes within the tag
        kind, size, begin, end, room = kind & 0xFFFF, kind >> 16, offset + 4, offset + 8, 4
    elif kind == _CODE_COMPRESSED:
        end, room = begin + size, len(data) - begin
    else:  # padded to eight bytes
        end, room = begin + size + -size % 8, len(data) - begin
    if size > room:
        raise _damage_error(path, f"an element of {size} bytes does not fit into the {len(data) - begin} that are left")
    return kind, data[begin : begin + size], end


def _matrix(path: Path, order: str, content: memoryview) -> tuple[str, Array]:
    """Name and numbers of an array; without numbers unless it is dense and real, and not MATLAB's own."""
    _, flags, offset = _element(path, order, content, 0)
    _, sides, offset = _element(path, order, content, offset)
    _, label, offset = _element(path, order, content, offset)
    if len(flags) != 8 or len(sides) % 4:
        raise _damage_error(path, "an array has no type")
    (flag_bits,) = struct.unpack_from(f"{order}I", flags)
    name = bytes(label).decode("ascii", "replace")
    if flag_bits & 0xFF not in _NUMERIC_CLASSES or flag_bits & _COMPLEX_FLAG or name.startswith("__"):
        return name, np.zeros(0)
    saved_as, numbers, _ = _element(path, order, content, offset)
    shape = np.frombuffer(sides, f"{order}i4").tolist()
    if saved_as not in _SAVED_AS or min(shape, default=-1) < 0:
        raise _damage_error(path, f"{name!r} has numbers of type {saved_as} and the shape {shape}")
    dtype = np.dtype(order + _SAVED_AS[saved_as])
    values = np.frombuffer(numbers, dtype, len(numbers) // dtype.itemsize)
    if math.prod(shape) != len(values):
        raise _damage_error(path, f"{name!r} has {len(values)} numbers, and its shape has {math.prod(shape)}")
    return name, values.reshape(shape, order="F")


def _mat_4(path: Path, data: memoryview) -> dict[str, Any]:
    """Real arrays of a MAT file of version 4."""
    arrays: dict[str, Any] = {}
    offset = 0
    while offset < len(data):
        if len(data) < offset + 20:
            raise _damage_error(path, "an array has no size")
        order = "<" if struct.unpack_from("<i", data, offset)[0] in range(5000) else ">"
        mopt, rows, columns, is_complex, name_length = struct.unpack_from(f"{order}5i", data, offset)
        saved_as = _SAVED_AS_4.get(mopt // 10 % 10)
        begin = offset + 20 + name_length
        end = begin
        if saved_as is not None:
            end += rows * columns * (2 if is_complex else 1) * np.dtype(saved_as).itemsize
        if mopt not in range(5000) or saved_as is None or min(rows, columns, name_length) < 0 or end > len(data):
            raise _damage_error(path, f"an array of {rows} rows and {columns} columns does not fit into it")
        name = bytes(data[offset + 20 : begin]).split(b"\0")[0].decode("ascii", "replace")
        arrays[name] = np.zeros(0)
        if mopt % 10 == 0 and not is_complex:
            values = np.frombuffer(data[begin:end], order + saved_as)
            arrays[name] = values.reshape((rows, columns), order="F")
        offset = end
    return arrays
