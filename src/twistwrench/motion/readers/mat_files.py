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
    path = file.path
    header = file.start[:_HEADER_SIZE]
    if header[:4] == b"\x89HDF" or b"MATLAB 7.3" in header:
        return read_hdf5(file, columns_first=True)
    with file.open() as stream:
        data = memoryview(stream.read())
    is_version_4 = 0 in header[:4]  # version 5 begins with text
    arrays = _mat_4(path, data) if is_version_4 else _mat_5(path, data)
    return {name: StoredArray.from_array(x) for name, x in arrays.items()}, ()


_HEADER_SIZE = 128
"""Bytes of the header in MAT files of version 5."""
_TAG_SIZE = 8
"""Bytes of an element's tag, its type and its size, in MAT files of version 5."""
_NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Number types by their codes in MAT files of version 5."""
_NUMBER_TYPES_4 = {0: "f8", 1: "f4", 2: "i4", 3: "i2", 4: "u2", 5: "u1"}
"""Number types by their codes in MAT files of version 4."""
_HEADER_SIZE_4 = 20
"""Bytes of an array's header in MAT files of version 4."""
_TYPE_CODES_4 = range(5000)
"""Valid type codes in MAT files of version 4; in the wrong byte order they are larger."""
_CODE_MATRIX = 14
"""Type of an element that is an array, in MAT files of version 5."""
_CODE_COMPRESSED = 15
"""Type of an element that holds a compressed element."""
_COMPLEX_FLAG = 0x800
"""Flag of complex arrays in MAT files of version 5."""
_CLASS_BITS = 0xFF
"""Bits of an array's flags that have its class."""
_NUMERIC_CLASSES = range(6, 16)
"""Classes of dense real arrays in MAT files of version 5."""
_BYTE_ORDERS = {b"IM": "<", b"MI": ">"}
"""Byte order by the last two bytes of the header of MAT files of version 5."""
_SMALL_DATA_SIZE = 4
"""Bytes of data within the tag of a small element, after size and type of two bytes each."""


def _damage_error(path: Path, damage: str) -> TrajectoryError:
    """Error for a damaged file."""
    return TrajectoryError(f"{path}: cannot be read as mat: {damage}. The file is damaged or cut short: save it again.")


def _mat_5(path: Path, data: memoryview) -> dict[str, Any]:
    """Real arrays of a MAT file of version 5, 6 or 7; sizes are checked before unpacking.

    SciPy's reader does not check the sizes and crashes the process if they are wrong.
    """
    byte_order = _BYTE_ORDERS.get(bytes(data[_HEADER_SIZE - 2 : _HEADER_SIZE]))
    if byte_order is None:
        raise _damage_error(path, "its first 128 bytes are not those of a MAT file")
    elements: list[tuple[int, int, memoryview, bool]] = []  # type, unpacked size, content, and True if it is packed
    unpacked_size = 0
    offset = _HEADER_SIZE
    while offset < len(data):
        kind, content, offset = _element(path, byte_order, data, offset)
        size = len(content)
        is_packed = kind == _CODE_COMPRESSED
        if is_packed:
            tag = zlib.decompressobj().decompress(content, _TAG_SIZE)
            if len(tag) < _TAG_SIZE:
                raise _damage_error(path, "a compressed array has no size")
            kind, size = struct.unpack(f"{byte_order}II", tag)
        elements.append((kind, size, content, is_packed))
        unpacked_size += size
    check_unpacked(path, unpacked_size)
    arrays: dict[str, Any] = {}
    for kind, size, content, is_packed in elements:
        if kind != _CODE_MATRIX:
            continue
        if is_packed:
            unpacked = zlib.decompressobj().decompress(content, _TAG_SIZE + size)
            content = memoryview(unpacked)[_TAG_SIZE:]
            if len(content) < size:
                raise _damage_error(path, f"an array has {len(content)} of the {size} bytes of its header")
        name, array = _matrix(path, byte_order, content)
        arrays[name] = array
    return arrays


def _element(path: Path, byte_order: str, data: memoryview, offset: int) -> tuple[int, memoryview, int]:
    """Type of the element at an offset, its data, and the offset after it."""
    begin = offset + _TAG_SIZE
    if len(data) < begin:
        raise _damage_error(path, "an array ends before its numbers")
    kind, size = struct.unpack_from(f"{byte_order}II", data, offset)
    available = len(data) - begin
    if kind >> 16:  # small element: size, type and up to four bytes of data within the tag
        size = kind >> 16
        kind = kind & 0xFFFF
        begin = offset + _TAG_SIZE - _SMALL_DATA_SIZE
        end = offset + _TAG_SIZE
        available = _SMALL_DATA_SIZE
    elif kind == _CODE_COMPRESSED:
        end = begin + size
    else:
        padding = -size % 8  # to a multiple of eight bytes
        end = begin + size + padding
    if size > available:
        remaining = len(data) - begin
        raise _damage_error(path, f"an element of {size} bytes does not fit into the {remaining} that are left")
    return kind, data[begin : begin + size], end


def _matrix(path: Path, byte_order: str, content: memoryview) -> tuple[str, Array]:
    """Name and numbers of an array.

    There are no numbers unless the array is dense and real. MATLAB's own arrays, whose names begin with ``__``, have none
    either.
    """
    _, flags, offset = _element(path, byte_order, content, 0)
    _, axis_lengths, offset = _element(path, byte_order, content, offset)
    _, label, offset = _element(path, byte_order, content, offset)
    has_type = len(flags) == 8 and len(axis_lengths) % 4 == 0  # two flags, and lengths, of four bytes each
    if not has_type:
        raise _damage_error(path, "an array has no type")
    (flag_bits,) = struct.unpack_from(f"{byte_order}I", flags)
    name = bytes(label).decode("ascii", "replace")
    is_dense = (flag_bits & _CLASS_BITS) in _NUMERIC_CLASSES
    is_complex = bool(flag_bits & _COMPLEX_FLAG)
    if not is_dense or is_complex or name.startswith("__"):
        return name, np.zeros(0)
    number_code, numbers, _ = _element(path, byte_order, content, offset)
    shape = np.frombuffer(axis_lengths, f"{byte_order}i4").tolist()
    has_valid_shape = min(shape, default=-1) >= 0  # not without axes
    if number_code not in _NUMBER_TYPES or not has_valid_shape:
        raise _damage_error(path, f"{name!r} has numbers of type {number_code} and the shape {shape}")
    dtype = np.dtype(byte_order + _NUMBER_TYPES[number_code])
    values = np.frombuffer(numbers, dtype, len(numbers) // dtype.itemsize)
    if math.prod(shape) != len(values):
        raise _damage_error(path, f"{name!r} has {len(values)} numbers, and its shape has {math.prod(shape)}")
    return name, values.reshape(shape, order="F")


def _mat_4(path: Path, data: memoryview) -> dict[str, Any]:
    """Real arrays of a MAT file of version 4."""
    arrays: dict[str, Any] = {}
    offset = 0
    while offset < len(data):
        name_begin = offset + _HEADER_SIZE_4
        if len(data) < name_begin:
            raise _damage_error(path, "an array has no size")
        (type_code,) = struct.unpack_from("<i", data, offset)
        byte_order = "<" if type_code in _TYPE_CODES_4 else ">"
        type_code, rows, columns, is_complex, name_length = struct.unpack_from(f"{byte_order}5i", data, offset)
        number_code = type_code // 10 % 10  # decimal digits: machine, 0, number type, matrix type
        matrix_code = type_code % 10
        number_type = _NUMBER_TYPES_4.get(number_code, "")
        begin = name_begin + name_length
        end = begin
        if number_type:
            numbers_per_entry = 2 if is_complex else 1
            end += rows * columns * numbers_per_entry * np.dtype(number_type).itemsize
        is_valid_type = type_code in _TYPE_CODES_4 and number_type
        if not is_valid_type or min(rows, columns, name_length) < 0 or end > len(data):
            raise _damage_error(path, f"an array of {rows} rows and {columns} columns does not fit into it")
        name_bytes, _, _ = bytes(data[name_begin:begin]).partition(b"\0")
        name = name_bytes.decode("ascii", "replace")
        arrays[name] = np.zeros(0)
        is_full_matrix = matrix_code == 0  # neither text nor sparse
        if is_full_matrix and not is_complex:
            values = np.frombuffer(data[begin:end], byte_order + number_type)
            arrays[name] = values.reshape((rows, columns), order="F")
        offset = end
    return arrays
