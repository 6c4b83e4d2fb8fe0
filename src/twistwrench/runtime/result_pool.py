"""Arrays for results: one block for those of a call, or pooled huge pages if they are large.

The C library takes the memory of a large result from the system and returns it with the result, so every result consists of
fresh pages, which cost more than most kernels take to fill them. A pooled block returns to the pool when its last view dies.
Nothing here is locked: each step on the list of idle blocks is atomic in Python, so blocks may be released in any thread and by
the garbage collector, in the middle of everything.
"""

from __future__ import annotations

import ctypes
import math
import mmap
import os
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..typing import Array
from .interpreter import switched_on

VARIABLE = "TWISTWRENCH_HUGE_PAGES"

PAGE = 1 << 21
"""Bytes of a huge page, where the system has them: x86-64, and AArch64 with small pages of 4 kB."""

MOST, SHARE = 1 << 30, 16
"""Bound of all blocks together [bytes], and as a part of the memory of a machine or of a container."""


class _Block:
    """Some huge pages, zero until written to. Raises OSError, ValueError or OverflowError if the system refuses."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.memory = mmap.mmap(-1, size + PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        start = ctypes.addressof(ctypes.c_char.from_buffer(self.memory))
        self.first = -start % PAGE
        self.address = start + self.first
        self.memory.madvise(mmap.MADV_HUGEPAGE)


class _Lease:
    """A block in use: NumPy makes an array of it, which keeps it as the base of all views."""

    def __init__(self, pool: ResultPool, block: _Block) -> None:
        self._pool, self._block, self._idle = pool, block, pool.idle
        self.__array_interface__ = {
            "version": 3, "shape": (block.size,), "typestr": "|u1", "data": (block.address, False),
        }  # fmt: skip

    def __del__(self) -> None:
        if self._idle is self._pool.idle:  # else it was acquired before a fork, from the parent's pool
            self._pool.release(self._block)


class ResultPool:
    """All blocks of this process."""

    def __init__(self) -> None:
        self.begin()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.begin)

    def begin(self) -> None:
        """Start without blocks: the child of a fork leaves those there are to its parent."""
        self.blocks: list[_Block] = []
        self.idle: list[_Block] = []

    def acquire(self, size: int) -> Any:
        """Memory of at least ``size`` bytes, for ``np.asarray``; None beyond the bound, or if the system refuses.

        Blocks have four sizes for each power of two, so a block serves all results of its size. Idle blocks of other sizes make
        room for a new one, the oldest first.
        """
        pages = -(-size // PAGE)
        step = 1 << max(0, pages.bit_length() - 3)
        size = -(-pages // step) * step * PAGE
        for block in list(self.idle):
            if block.size == size and self._removed(block):
                return _Lease(self, block)
        idle = list(self.idle)
        free = bound() - size - sum(block.size for block in self.blocks)
        if free + sum(block.size for block in idle) < 0:
            return None
        for block in idle:
            if free < 0 and self._removed(block):
                self.blocks.remove(block)
                free += block.size
        try:
            block = _Block(size)
        except (OSError, ValueError, OverflowError):
            return None
        self.blocks.append(block)
        return _Lease(self, block)

    def release(self, block: _Block) -> None:
        """Take a block back; until it is used again the system may have its pages, should memory run short."""
        with suppress(OSError):
            block.memory.madvise(mmap.MADV_FREE, block.first, block.size)
        self.idle.append(block)

    def clear(self) -> None:
        """Return idle blocks to the system."""
        for block in list(self.idle):
            if self._removed(block):
                self.blocks.remove(block)

    def _removed(self, block: _Block) -> bool:
        """True if the block was still idle: another thread may have been faster."""
        try:
            self.idle.remove(block)
        except ValueError:
            return False
        return True


_POOL = ResultPool()


@cache
def allowed() -> bool:
    """True if large results may lie in huge pages: where the system has them, unless ``TWISTWRENCH_HUGE_PAGES=0``."""
    effect = "leave large results to NumPy's own memory", "keep it for the next ones"
    return switched_on(VARIABLE, *effect) and hasattr(mmap, "MADV_HUGEPAGE") and hasattr(mmap, "MADV_FREE")


@cache
def bound() -> int:
    """Bytes of all blocks together."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min(MOST, min([memory, *_limits()]) // SHARE)


def _limits() -> list[int]:
    """Bytes that the control groups of this process may have, in either version of them; none outside of Linux."""
    found = []
    with suppress(OSError, ValueError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, kinds, own = line.split(":", 2)
            if kinds and "memory" not in kinds.split(","):
                continue
            root, name = (
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes") if kinds else ("/sys/fs/cgroup", "memory.max")
            )
            group = Path(root + own)
            for place in (group, *group.parents):
                with suppress(OSError, ValueError):
                    found.append(int((place / name).read_text()))  # "max" is not a number
    return found


# ── Results of one call: a single block for all of them, or pooled blocks if they are large

# The C library returns the memory of a result to the system when the result dies: always from 32 MB on, and below that whenever
# several results die together. Then each call pays for fresh pages, which take several times as long as computing.

LARGE = 1 << 25
"""Bytes of results that the C library never reuses: its largest threshold."""

LEAST_POOLED = 1 << 20
"""Least bytes of one of several large results for a pooled block of its own."""

LINE = 64
"""Bytes of a cache line, to which each result is aligned."""

ALIGNED = 1 << 20
"""Bytes of results from which on their cache lines are the processor's, for stores past the caches."""


def result_arrays(shapes: Sequence[tuple[int, ...]], dtype: np.dtype[Any]) -> tuple[Array, ...]:
    """New arrays of those shapes, uninitialised. Raises MemoryError.

    Below 32 MB they are views of one block, so keeping one keeps the memory of all; above, each has its own.
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
    lease = _POOL.acquire(size) if size >= LEAST_POOLED and allowed() else None
    if lease is not None:
        return np.asarray(lease)[:size].view(dtype).reshape(shape)
    try:
        return np.empty(shape, dtype)
    except MemoryError:
        _POOL.clear()
        return np.empty(shape, dtype)
