"""Array in a file, read in portions of its rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import TrajectoryError
from ...core.numbers import number
from ...core.typing import Array
from ..log_table import slices
from .file_ends import FileEnds

MAX_UNPACKED_SIZE = 1 << 30
"""Largest unpacked size [bytes] of data that must be read whole."""
NUMBER_KINDS = "iufbmM"
"""NumPy's characters of kinds of numbers, dates and durations."""
_FLOAT64_SIZE = 8
"""Size of a number as float64 [bytes]."""


@dataclass(frozen=True, eq=False)
class StoredArray:
    """Array in a file, or in memory if the file had to be read whole."""

    shape: tuple[int, ...]
    """Empty for a single number, and for content that is not numbers."""
    dtype: np.dtype[Any]
    portions: Callable[[int], Iterator[Array]]
    """Function of the number of rows of a portion; it yields all portions in order, as :func:`.slices` splits the rows."""
    names: tuple[str, ...] = ()
    """Names of the columns of an array (n, k); if empty, columns have numbers."""

    @classmethod
    def from_array(cls, array: Any) -> StoredArray:
        """Array in memory; (1, n) and (n, 1) become (n,)."""
        numbers = np.asarray(array)
        if is_line(numbers.shape):
            numbers = numbers.ravel()

        def portions(row_limit: int) -> Iterator[Array]:
            return (numbers[rows] for rows in slices(len(numbers), row_limit))

        return cls(numbers.shape, numbers.dtype, portions)

    @property
    def row_size(self) -> int:
        """Size of a row [bytes] with its numbers as float64, or as stored if that is larger."""
        return max(_FLOAT64_SIZE, self.dtype.itemsize) * math.prod(self.shape[1:])

    @property
    def size(self) -> int:
        """Size of all rows [bytes], as :attr:`row_size`."""
        return self.row_size * self.shape[0]


def is_line(shape: tuple[int, ...]) -> bool:
    """True for the shapes (1, n) and (n, 1)."""
    return len(shape) == 2 and 1 in shape


Reader = Callable[[FileEnds], tuple[Mapping[str, StoredArray], tuple[str, ...]]]
"""Function that returns the arrays of a file by name, and sentences about ignored content."""


def check_unpacked(path: Path, size: int) -> None:
    """Raise TrajectoryError if ``size`` [bytes] exceeds the limit for data read whole."""
    if size > MAX_UNPACKED_SIZE:
        raise TrajectoryError(
            f"{path}: takes {number(size / 2**30)} GiB once unpacked, and such a file is read whole up to "
            f"{number(MAX_UNPACKED_SIZE / 2**30)} GiB. Save parts of it, or write CSV, HDF5, parquet, or an npy "
            "file with rows in C order, which are read in portions."
        )
