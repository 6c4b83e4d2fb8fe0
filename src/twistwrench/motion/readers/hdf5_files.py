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
    """Arrays of an HDF5 file; ``columns_first`` for arrays stored transposed, as by MATLAB."""
    try:
        import h5py
    except ImportError:
        raise MissingExtraError.from_extra("h5py", "logs", "Reading HDF5") from None
    path, size = file.path, file.size
    arrays: dict[str, StoredArray] = {}
    ignored: dict[str, list[str]] = {}

    def collect(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        reason = _ignored_storage(item, size)
        if reason:
            ignored.setdefault(reason, []).append(name)
            return
        shape = item.shape or ()
        if is_line(shape):
            shape = (math.prod(shape),)
        elif columns_first:
            shape = shape[::-1]
        arrays[name] = StoredArray(shape, item.dtype, partial(portions, name, *shape[:1]))

    def portions(name: str, count: int, row_limit: int) -> Iterator[Array]:
        with h5py.File(path, "r") as data:
            x: Any = data[name]
            shape = x.shape
            if x.dtype.names:  # texts beside numbers are left in the file
                x = x.fields([field for field in x.dtype.names if x.dtype[field].kind in NUMBER_KINDS])
            for s in slices(count, row_limit):
                if not is_line(shape):
                    yield x[:, s].T if columns_first and len(shape) == 2 else x[s]
                elif shape[0] == 1:
                    yield x[0, s]
                else:
                    yield x[s, 0]

    with h5py.File(path, "r") as data:
        data.visititems(collect)
    return arrays, tuple(f"Not read, as {reason}: {listed(names)}." for reason, names in ignored.items())


_FILTERS = {1, 2, 3, 4, 5, 6, 32000}
"""Codes of the filters that come with h5py: deflate, shuffle, fletcher32, szip, nbit, scale-offset, LZF. HDF5 would look for
others on this machine."""
_MAX_CHUNK_SIZE = 1 << 26
"""Largest chunk of a dataset [bytes], which HDF5 unpacks whole."""


def _ignored_storage(item: Any, size: int) -> str:
    """Reason to ignore a dataset of a file of ``size`` bytes: it reaches other files, or is out of proportion; else empty."""
    plan = item.id.get_create_plist()
    if plan.get_external_count() or item.is_virtual:
        return "its numbers are in other files"
    if any(plan.get_filter(k)[0] not in _FILTERS for k in range(plan.get_nfilters())):
        return "its filter does not come with HDF5"
    if item.chunks and math.prod(item.chunks) * item.dtype.itemsize > _MAX_CHUNK_SIZE:
        return f"its chunks are larger than {number(_MAX_CHUNK_SIZE / 2**20)} MiB"
    if math.prod(item.shape or ()) * item.dtype.itemsize > most_unpacked(size):
        return "it is too large for the size of the file"
    return ""
