"""Room for the results of one call: a single block for all of them, or memory that is lent where they are large.

What the C library gets from the system for a result it hands back when the result dies: always from 32 MB on, and below that
whenever several results die together. Then each call pays for fresh pages, several times what computing takes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..typing import Array
from . import huge_pages

LARGE = 1 << 25
"""Bytes of results that the C library never keeps: its largest threshold for that."""

LEAST_LENT = 1 << 20
"""Bytes of one of several large results that is worth a lease of its own."""

LINE = 64
"""Each result begins with a cache line of its own."""

ALIGNED = 1 << 20
"""Bytes of results from which on these are the processor's, so that they can be written past the caches."""


def room(shapes: Sequence[tuple[int, ...]], dtype: np.dtype[Any]) -> tuple[Array, ...]:
    """Arrays of those shapes, whatever is in them; raises MemoryError.

    Below 32 MB they are views of one block, so one that is kept keeps the others' memory; above, each is by itself.
    """
    sizes = [math.prod(shape) * dtype.itemsize for shape in shapes]
    total = sum(sizes)
    if total >= LARGE:
        return tuple(_apart(shape, dtype, size) for shape, size in zip(shapes, sizes, strict=True))
    block, at, found = np.empty(total + LINE * (len(sizes) + 1), np.uint8), 0, []
    if total >= ALIGNED:
        at = -block.__array_interface__["data"][0] % LINE
    for shape, size in zip(shapes, sizes, strict=True):
        found.append(np.ndarray(shape, dtype, block, at))
        at += -(-size // LINE) * LINE
    return tuple(found)


def _apart(shape: tuple[int, ...], dtype: np.dtype[Any], size: int) -> Array:
    lease = huge_pages.lend(size) if size >= LEAST_LENT else None
    if lease is not None:
        return np.asarray(lease).view(dtype).reshape(shape)
    try:
        return np.empty(shape, dtype)
    except MemoryError:
        huge_pages.clear()
        return np.empty(shape, dtype)
