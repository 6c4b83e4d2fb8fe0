"""Motions in files of arrays and tables: npz, npy, MAT, HDF5, parquet and feather, as columns under a header.

An array (n,) is a column called by its name; of one (n, k) the columns are numbered, ``q1`` to ``qk``. What is no column of
numbers as long as most is left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core.foreign_errors import foreign_errors
from ..errors import MissingExtraError, NotFoundError, TrajectoryError
from ..typing import Array
from .npz_file import NpzFile, is_archive, is_simulation

_HDF5 = b"\x89HDF"


def array_file(path: Path) -> NpzFile | None:
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


def _made(path: Path, read: Callable[[Path], Mapping[str, Any]]) -> NpzFile:
    if not path.is_file():
        raise NotFoundError(f"no motion file {str(path)!r}. Give the path of a file.")
    with foreign_errors(lambda reason: TrajectoryError(f"{path}: cannot be read as {path.suffix[1:]}: {reason}.")):
        arrays = dict(read(path))
        header, table = column_table(arrays, str(path))
    return checked(path, header, table, path.stat().st_size)


def checked(path: Path, header: list[str], table: Array, size: int) -> NpzFile:
    """The table as a file, whose numbers are finite; rows before all columns have begun are left out."""
    bad = ~np.isfinite(table).all(axis=1)
    if bad.any():
        raise TrajectoryError(f"{path}: row {int(bad.argmax()) + 1} has a number that is not finite. Remove the row.")
    return NpzFile(path, tuple(header), table, size)


def _npz(path: Path) -> Mapping[str, Any]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _npy(path: Path) -> Mapping[str, Any]:
    values = np.load(path, allow_pickle=False)
    return {"": values} if values.dtype.names else {"column": values}


def _mat(path: Path) -> Mapping[str, Any]:
    with path.open("rb") as file:
        if file.read(4) == _HDF5 or b"MATLAB 7.3" in file.read(124):
            return {name: np.asarray(x).T for name, x in _hdf5(path).items()}  # MATLAB stores columns first
    from scipy.io import loadmat

    return {name: x for name, x in loadmat(path).items() if not name.startswith("__")}


def _hdf5(path: Path) -> Mapping[str, Any]:
    try:
        import h5py
    except ImportError:
        raise MissingExtraError.of("h5py", "logs", "Reading HDF5") from None
    found: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def _arrow(path: Path) -> Mapping[str, Any]:
    try:
        import pyarrow.feather
        import pyarrow.parquet
    except ImportError:
        raise MissingExtraError.of("pyarrow", "logs", f"Reading {path.suffix[1:]}") from None
    read = pyarrow.parquet.read_table if path.suffix.lower() == ".parquet" else pyarrow.feather.read_table
    table = read(path)
    found = {}
    for name in table.column_names:
        values = table[name].to_numpy()
        dates = values.dtype.kind in "mM"
        found[f"{name} [s]" if dates else name] = values
    return found


_READERS: Mapping[str, Callable[[Path], Mapping[str, Any]]] = {
    ".npy": _npy,
    ".mat": _mat,
    **dict.fromkeys((".h5", ".hdf5"), _hdf5),
    **dict.fromkeys((".parquet", ".feather", ".arrow"), _arrow),
}
