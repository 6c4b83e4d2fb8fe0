"""Motions in files of arrays and tables (npz, npy, MAT, HDF5, parquet, feather) and in archives of simulations.

An array (n,) is a column with the array's name; the columns of an array (n, k) are numbered, ``q1`` to ``qk``. Other
arrays are ignored, as are columns of another length than most columns have. Rows are decoded in portions if the format
allows it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import NotFoundError, TrajectoryError
from ...core.text import Argument, listed
from ...core.third_party import third_party_errors
from ...core.typing import Array
from .. import log_table
from ..log_table import check_ratio
from .arrow_files import read_arrow
from .columnar_file import ArrayFile
from .file_ends import FileEnds
from .hdf5_files import read_hdf5
from .lerobot import EPISODES, read_metadata
from .mat_files import read_mat
from .numpy_files import is_simulation, read_npy, read_npz, simulation_file
from .stored_array import NUMBER_KINDS, Reader, StoredArray

MAX_COLUMNS = 10_000
"""Largest number of columns of an array, and of numbers in a row of it."""
_MAX_NUMBER_SIZE = 8
"""Size of the largest numbers [bytes]."""
_PORTION_SIZE = 1 << 26
"""Largest size of a portion of an array [bytes]: 64 MiB."""


def array_file(file: FileEnds, episode: int | None = None) -> ArrayFile:
    """Open a file of arrays, or one ``episode`` of it. A file with another suffix is read as the archive of a simulation.

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
    wide_arrays = _wide_arrays(arrays)
    if wide_arrays:
        note = f"Not read, as a row of it has more than {MAX_COLUMNS} numbers: {listed(wide_arrays)}."
        notes = (*notes, note)
        arrays = {name: array for name, array in arrays.items() if name not in wide_arrays}
    columns = _columns(arrays)
    if not columns:
        array_names = listed(arrays) or "none"
        message = f"{path}: has no arrays of numbers that are as long as each other. Found: {array_names}."
        raise TrajectoryError(" ".join([message, *notes]))
    with third_party_errors(lambda reason: TrajectoryError(f"{path}: {EPISODES!r} cannot be read: {reason}.")):
        episode_rows = _episode_rows(path, arrays.get(EPISODES), episode)

    def read_portions(used: Sequence[int]) -> Iterator[Array]:
        """Yield portions (m, k) of the rows of the k columns with the given indices."""
        used_columns = [columns[k] for k in used or (0,)]  # without columns, any one shows the number of rows
        used_arrays = {column.array: arrays[column.array] for column in used_columns}
        total_size = sum(array.size for array in used_arrays.values())  # bytes
        check_ratio(path, total_size, file.size)
        row_sizes = [array.row_size for array in used_arrays.values()]  # bytes
        largest_row_size = max(1, *row_sizes)
        max_rows = max(1, min(log_table.ROWS, _PORTION_SIZE // largest_row_size))
        first_dates: dict[int, Array] = {}  # by column
        begin = 0
        portions_of_arrays = [array.portions(max_rows) for array in used_arrays.values()]
        for portions in zip(*portions_of_arrays, strict=True):
            portion_by_array = dict(zip(used_arrays, portions, strict=True))
            end = begin + len(portions[0])
            selected_rows: Any = ...  # all
            if episode_rows is not None:
                selected_rows = episode_rows[begin:end]
            begin = end
            table_columns = []
            for k, column in enumerate(used_columns):
                portion = portion_by_array[column.array]
                values = portion[column.index][selected_rows]
                if values.dtype.kind in "mM":  # dates and durations become seconds since the first one
                    first_date = first_dates.setdefault(k, values[:1])
                    values = (values - first_date) / np.timedelta64(1, "s")
                table_columns.append(values)
            table = np.stack(table_columns, axis=1).astype(float, copy=False)
            yield table[:, : len(used)]

    dataset = ""
    if EPISODES in arrays:
        _, dataset = read_metadata(path)
    labels = tuple(column.label for column in columns)
    return ArrayFile(path, labels, file.size, read_portions, notes, dataset=dataset)


def _wide_arrays(arrays: Mapping[str, StoredArray]) -> list[str]:
    """Names of the arrays with too many numbers in a row."""
    max_row_size = _MAX_NUMBER_SIZE * MAX_COLUMNS  # bytes
    return [name for name, array in arrays.items() if array.shape and array.row_size > max_row_size]


@dataclass(frozen=True)
class _Column:
    """Column of numbers within an array."""

    label: str
    array: str
    """Name of the array."""
    index: Any
    """Index of the column within a portion of the array."""


def _columns(arrays: Mapping[str, StoredArray]) -> list[_Column]:
    """Numeric columns of the most frequent length; of the greatest length if several are equally frequent."""
    columns_by_length: dict[int, list[_Column]] = defaultdict(list)
    for name, array in arrays.items():
        if array.shape:
            columns_by_length[array.shape[0]] += _array_columns(name, array)
    lengths = [length for length, columns in columns_by_length.items() if length > 1 and columns]
    if not lengths:
        return []
    most_frequent = max(lengths, key=lambda length: (len(columns_by_length[length]), length))
    return columns_by_length[most_frequent]


def _array_columns(name: str, array: StoredArray) -> list[_Column]:
    """Numeric columns of an array (n,), with fields or without, or (n, k); empty for other arrays."""
    dtype = array.dtype
    shape = array.shape
    if len(shape) == 1 and dtype.names:
        return _field_columns(name, dtype)
    if dtype.kind not in NUMBER_KINDS:
        return []
    if len(shape) == 1:
        return [_Column(name, name, ...)]
    columns = []
    if len(shape) == 2:
        labels = [f"{name}.{column}" for column in array.names]
        if not labels:
            labels = [f"{name}{k + 1}" for k in range(shape[1])]
        for k, label in enumerate(labels):
            columns.append(_Column(label, name, np.s_[:, k]))
    return columns


def _field_columns(name: str, dtype: np.dtype[Any]) -> list[_Column]:
    """Columns of those fields of an array (n,) that hold one number each."""
    columns = []
    for field in dtype.names or ():
        is_number = dtype[field].kind in NUMBER_KINDS and not dtype[field].shape
        if is_number:
            label = f"{name}.{field}" if name else field
            columns.append(_Column(label, name, field))
    return columns


def _episode_rows(path: Path, episodes: StoredArray | None, episode: int | None) -> Array | None:
    """Mask (n,) of the rows of an episode; None for all. Raises TrajectoryError if the episode is missing."""
    if episodes is None:
        if episode is not None:
            raise TrajectoryError(
                f"{path}: {{0}} is for datasets with a column {EPISODES!r}, and none is here.", Argument("episode")
            )
        return None
    check_ratio(path, episodes.size, path.stat().st_size)
    episode_of_row = np.concatenate([np.zeros(0), *episodes.portions(log_table.ROWS)])
    if not np.isfinite(episode_of_row).all():
        raise TrajectoryError(f"{path}: {EPISODES!r} has missing numbers. Each row needs its episode.")
    episode_numbers = np.unique(episode_of_row).astype(int)
    if episode is None and len(episode_numbers) < 2:
        return None
    if episode is None or episode not in episode_numbers:
        finding = "several episodes" if episode is None else f"no episode {episode}"
        first_episode = int(episode_numbers[0])
        last_episode = int(episode_numbers[-1])
        raise TrajectoryError(
            f"{path}: has {finding}: {first_episode} to {last_episode}. Choose one: {{0}}.",
            Argument("episode", first_episode),
        )
    return np.asarray(episode_of_row == episode)


_READERS: Mapping[str, Reader] = {
    ".npy": read_npy,
    ".npz": read_npz,
    ".mat": read_mat,
    **dict.fromkeys((".h5", ".hdf5"), read_hdf5),
    **dict.fromkeys((".parquet", ".feather", ".arrow"), read_arrow),
}
"""Reader by the suffix of a file."""
