"""Consecutive rows of a motion file, and where in the file each of them stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Block:
    """Rows as they were read."""

    table: NDArray[Any]
    """(n, columns), as the numbers stand in the file."""
    size: int
    """Bytes of the file that they took."""
    place: Callable[[int], str]
    """Of a row: ``line 12``, or ``row 3`` where the file has no lines."""
