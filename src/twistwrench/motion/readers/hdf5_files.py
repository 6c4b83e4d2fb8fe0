"""Arrays of HDF5 files, which MATLAB files are since version 7.3."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from ...core.errors import MissingExtraError
from ...core.numbers import number
from ...core.text import listed
from ...core.typing import Array
from ..log_table import most_unpacked, slices
from .file_ends import FileEnds
from .stored_array import NUMBER_KINDS, StoredArray, is_line


def read_hdf5(file: FileEnds, *, columns_first: bool = False) -> tuple[Mapping[str, StoredArray], tuple[str, ...]]:
    """Arrays of an HDF5 file by name, and notes on ignored ones; ``columns_first`` for transposed arrays, as of MATLAB."""
    try:
        import h5py
    except ImportError:
        raise MissingExtraError.from_extra("h5py", "logs", "Reading HDF5") from None
    path = file.path
    arrays: dict[str, StoredArray] = {}
    ignored_names: dict[str, list[str]] = {}  # by reason

    def collect(name: str, item: Any) -> None:
        """Add an item of the file to the arrays or to the ignored names."""
        if not isinstance(item, h5py.Dataset):
            return
        reason = _reason_to_ignore(item, file.size)
        if reason:
            ignored_names.setdefault(reason, []).append(name)
            return
        shape = item.shape or ()
        if is_line(shape):
            shape = (math.prod(shape),)
        elif columns_first:
            shape = shape[::-1]
        arrays[name] = StoredArray(shape, item.dtype, partial(read_portions, name, *shape[:1]))

    def read_portions(name: str, row_count: int, row_limit: int) -> Iterator[Array]:
        """Portions of up to ``row_limit`` of an array's rows."""
        with h5py.File(path, "r") as data:
            dataset: Any = data[name]
            stored_shape = dataset.shape
            if dataset.dtype.names:  # texts beside numbers are left in the file
                field_kinds = {field: dataset.dtype[field].kind for field in dataset.dtype.names}
                number_fields = [field for field, kind in field_kinds.items() if kind in NUMBER_KINDS]
                dataset = dataset.fields(number_fields)
            for rows in slices(row_count, row_limit):
                if is_line(stored_shape):
                    yield dataset[0, rows] if stored_shape[0] == 1 else dataset[rows, 0]
                elif columns_first and len(stored_shape) == 2:
                    yield dataset[:, rows].T
                else:
                    yield dataset[rows]

    with h5py.File(path, "r") as data:
        data.visititems(collect)
    notes = [f"Not read, as {reason}: {listed(names)}." for reason, names in ignored_names.items()]
    return arrays, tuple(notes)


_KNOWN_FILTERS = {1, 2, 3, 4, 5, 6, 32000}
"""Codes of the filters that come with h5py: deflate, shuffle, fletcher32, szip, nbit, scale-offset, LZF.

HDF5 would search this machine for other filters.
"""
_MAX_CHUNK_SIZE = 1 << 26
"""Largest chunk of a dataset [bytes], which HDF5 unpacks whole."""


def _reason_to_ignore(dataset: Any, file_size: int) -> str:
    """Reason to ignore a dataset of a file of ``file_size`` bytes, by its storage; empty if there is none."""
    properties = dataset.id.get_create_plist()
    if properties.get_external_count() or dataset.is_virtual:
        return "its numbers are in other files"
    for k in range(properties.get_nfilters()):
        filter_code, *_ = properties.get_filter(k)
        if filter_code not in _KNOWN_FILTERS:
            return "its filter does not come with HDF5"
    number_size = dataset.dtype.itemsize
    if dataset.chunks and math.prod(dataset.chunks) * number_size > _MAX_CHUNK_SIZE:
        return f"its chunks are larger than {number(_MAX_CHUNK_SIZE / 2**20)} MiB"
    if math.prod(dataset.shape or ()) * number_size > most_unpacked(file_size):
        return "it is too large for the size of the file"
    return ""
