"""Arrays for results: one block for all results of a call, or pooled huge pages for large ones.

The C library takes the memory of a large result from the system, and returns it to the system when the result is freed. So
every result has new pages, whose page faults take longer than the computations of most kernels. A pooled block returns to the
pool when its last view is freed.

No lock is needed: every operation on the list of idle blocks is atomic in Python, so any thread and the garbage collector may
release blocks at any time.
"""

from __future__ import annotations

import ctypes
import math
import mmap
import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ...core.typing import Array
from .interpreter import switched_on

VARIABLE = "TWISTWRENCH_HUGE_PAGES"
"""Environment variable that switches huge pages off."""

PAGE = 1 << 21
"""Size of a huge page [bytes] on x86-64, and on AArch64 with 4 kB pages."""

MAX_POOL = 1 << 30
"""Largest size of all blocks together [bytes]."""
MEMORY_PER_POOL = 16
"""Smallest ratio of the memory, of the machine or container, to the size of all blocks together."""


class _Block:
    """Block of huge pages, initially zero. Raises OSError, ValueError or OverflowError if the system provides none."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.memory = mmap.mmap(-1, size + PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        start = ctypes.addressof(ctypes.c_char.from_buffer(self.memory))
        self.offset = -start % PAGE  # of the first huge page in the memory
        self.address = start + self.offset
        self.memory.madvise(mmap.MADV_HUGEPAGE)


class _Lease:
    """Lease of a block, from which NumPy makes an array. The array and its views keep the lease, whose end frees the block."""

    def __init__(self, pool: ResultPool, block: _Block) -> None:
        self._pool = pool
        self._block = block
        self._idle = pool.idle  # another list after a fork
        self.__array_interface__ = {
            "version": 3, "shape": (block.size,), "typestr": "|u1", "data": (block.address, False),
        }  # fmt: skip

    def __del__(self) -> None:
        if self._idle is self._pool.idle:  # otherwise this process was forked since, and its parent owns the block
            self._pool.release(self._block)


class ResultPool:
    """Pool of all blocks of this process. ``idle`` are the blocks without views, ``blocks`` are all."""

    def __init__(self) -> None:
        self.begin()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.begin)

    def begin(self) -> None:
        """Reset to no blocks: after a fork, existing blocks belong to the parent."""
        self.blocks: list[_Block] = []
        self.idle: list[_Block] = []

    def acquire(self, size: int) -> Any:
        """Memory of at least ``size`` bytes, for ``np.asarray``; None above the limit, or if the system provides none.

        There are four block sizes per power of two, so that a block can be reused for results of similar size. If there is no
        room for a new block, idle blocks of other sizes are freed, the oldest first.
        """
        pages = -(-size // PAGE)  # rounded up
        step = 1 << max(0, pages.bit_length() - 3)  # pages between two block sizes: a quarter of the power of two below
        size = -(-pages // step) * step * PAGE
        for block in list(self.idle):
            if block.size == size and self._remove(block):
                return _Lease(self, block)
        idle_blocks = list(self.idle)
        room = bound() - size - _total_size(self.blocks)  # bytes beside the new block; negative if it does not fit
        if room + _total_size(idle_blocks) < 0:
            return None
        for block in idle_blocks:
            if room < 0 and self._remove(block):
                self.blocks.remove(block)
                room += block.size
        try:
            block = _Block(size)
        except (OSError, ValueError, OverflowError):
            return None
        self.blocks.append(block)
        return _Lease(self, block)

    def release(self, block: _Block) -> None:
        """Put a block into the idle list. While it is there, the system may reclaim its pages if memory is short."""
        with suppress(OSError):
            block.memory.madvise(mmap.MADV_FREE, block.offset, block.size)
        self.idle.append(block)

    def clear(self) -> None:
        """Return idle blocks to the system."""
        for block in list(self.idle):
            if self._remove(block):
                self.blocks.remove(block)

    def _remove(self, block: _Block) -> bool:
        """Remove a block from the idle list; False if another thread has taken it already."""
        try:
            self.idle.remove(block)
        except ValueError:
            return False
        return True


_POOL = ResultPool()


@cache
def may_use_huge_pages() -> bool:
    """True if large results may use huge pages: if the system has them, unless ``TWISTWRENCH_HUGE_PAGES=0``."""
    # What the variable does, for the message of another value.
    effect_of_0 = "leave large results to NumPy's own memory"
    effect_of_1 = "keep it for the next ones"
    has_huge_pages = hasattr(mmap, "MADV_HUGEPAGE") and hasattr(mmap, "MADV_FREE")
    return switched_on(VARIABLE, effect_of_0, effect_of_1) and has_huge_pages


@cache
def bound() -> int:
    """Limit of all blocks together [bytes]."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    available_memory = min([memory, *_control_group_limits()])
    return min(MAX_POOL, available_memory // MEMORY_PER_POOL)


def _control_group_limits() -> list[int]:
    """Memory limits [bytes] of this process's control groups, versions 1 and 2; empty outside Linux."""
    limits = []
    with suppress(OSError, ValueError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            if controllers and "memory" not in controllers.split(","):
                continue
            if controllers:  # version 1
                root = "/sys/fs/cgroup/memory"
                limit_file = "memory.limit_in_bytes"
            else:  # version 2, which names no controllers
                root = "/sys/fs/cgroup"
                limit_file = "memory.max"
            group = Path(root + path)
            for folder in (group, *group.parents):  # limits of outer groups apply too
                with suppress(OSError, ValueError):
                    limit_text = (folder / limit_file).read_text()
                    limits.append(int(limit_text))  # "max" is not a number: without a limit
    return limits


def _total_size(blocks: Iterable[_Block]) -> int:
    """Size of blocks together [bytes]."""
    return sum(block.size for block in blocks)


# ── Results of one call: one block for all of them, or pooled blocks if they are large

# When a result is freed, the C library returns its memory to the system if it has more than 32 MB, or if several results are
# freed together. Then each call has to get new pages, which takes several times as long as the computation.

MIN_SEPARATE = 1 << 25
"""Size of results [bytes] whose memory the C library never reuses: its maximum threshold."""

LEAST_POOLED = 1 << 20
"""Smallest size [bytes] of a result with a pooled block of its own, if the results together are large."""

LINE = 64
"""Size of a cache line [bytes], to which each result is aligned."""

MIN_ALIGNED = 1 << 20
"""Size of all results [bytes] from which the block is aligned to the processor's cache lines, for stores past the caches."""


def result_arrays(shapes: Sequence[tuple[int, ...]], dtype: np.dtype[Any]) -> tuple[Array, ...]:
    """New uninitialised arrays of the given shapes. Raises MemoryError.

    If all together have less than 32 MB, they are views of one block: the block exists as long as one of them. Otherwise each
    array has its own memory.
    """
    sizes = [math.prod(shape) * dtype.itemsize for shape in shapes]  # bytes
    total = sum(sizes)
    if total >= MIN_SEPARATE:
        return tuple(_separate_array(shape, dtype, size) for shape, size in zip(shapes, sizes, strict=True))
    block = np.empty(total + LINE * (len(sizes) + 1), np.uint8)
    arrays = []
    offset = 0
    if total >= MIN_ALIGNED:
        address, _ = block.__array_interface__["data"]
        offset = -address % LINE
    for shape, size in zip(shapes, sizes, strict=True):
        arrays.append(np.ndarray(shape, dtype, block, offset))
        offset += -(-size // LINE) * LINE  # rounded up to whole lines
    return tuple(arrays)


def _separate_array(shape: tuple[int, ...], dtype: np.dtype[Any], size: int) -> Array:
    """Array with its own memory of ``size`` bytes: a pooled block if it is large, otherwise NumPy's."""
    if size >= LEAST_POOLED and may_use_huge_pages():
        lease = _POOL.acquire(size)
        if lease is not None:
            return np.asarray(lease)[:size].view(dtype).reshape(shape)
    try:
        return np.empty(shape, dtype)
    except MemoryError:  # idle blocks may leave too little memory
        _POOL.clear()
        return np.empty(shape, dtype)
