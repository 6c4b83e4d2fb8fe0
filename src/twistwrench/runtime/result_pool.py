"""Memory in huge pages, lent and taken back: large results that are made again and again meet no page fault but the first.

Where a result is large, the C library gets its memory from the system and hands it back with the result, so every fresh one
is made of fresh pages, and those cost more than most kernels take to fill them. A block lent from here comes back when the
last view of it dies, and until it is lent again the system may take its pages where memory runs short. Nothing here is
locked: each step on the list of idle blocks is one that Python does as a whole, so blocks may come back from any thread, from
the garbage collector, and in the middle of everything.
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

from ..errors import ValueRangeError
from ..typing import Array

VARIABLE = "TWISTWRENCH_HUGE_PAGES"

PAGE = 1 << 21
"""Bytes of a huge page, where the system has them: x86-64, and AArch64 with small pages of 4 kB."""

MOST = 1 << 30
"""Bytes of all blocks together, lent and idle, on a machine with memory enough; :func:`most` says how much on this one."""

SHARE = 16
"""Of the memory of a machine, or of a container, this part at most."""

SLACK = 1.25
"""A block may be so many times as large as what it is lent for."""

PATIENCE = 16
"""A block that so many others were lent past makes room for new ones. One that was in use since does not: pages are what
costs, and two results that drive out each other would cost more than without any of this."""


class _Block:
    """Some huge pages, zero until written to."""

    def __init__(self, size: int) -> None:
        """Raises OSError, ValueError or OverflowError where the system refuses."""
        self.size = size
        self.memory = mmap.mmap(-1, size + PAGE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        start = ctypes.addressof(ctypes.c_char.from_buffer(self.memory))
        self.first = -start % PAGE
        self.address = start + self.first
        self.memory.madvise(mmap.MADV_HUGEPAGE)
        self.lent_last = 0

    def rest(self) -> None:
        """Let the system have the pages, should it run short of memory; until then they stay."""
        with suppress(OSError):
            self.memory.madvise(mmap.MADV_FREE, self.first, self.size)


class Lease:
    """A block in somebody's hands: what NumPy makes an array of, and keeps as the base of all its views."""

    def __init__(self, pool: _Pool, block: _Block, size: int) -> None:
        self._pool, self._block, self._home = pool, block, pool.idle
        self.__array_interface__ = {
            "version": 3, "shape": (size,), "typestr": "|u1", "data": (block.address, False),
        }  # fmt: skip

    def __del__(self) -> None:
        if self._home is self._pool.idle:  # else it was lent before a fork, by the parent's pool
            self._block.rest()
            self._home.append(self._block)


class _Pool:
    """All blocks of this process."""

    def __init__(self) -> None:
        self.begin()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.begin)

    def begin(self) -> None:
        """Own nothing: a child of a fork leaves to its parent what was there, lent or idle."""
        self.blocks: list[_Block] = []
        self.idle: list[_Block] = []
        self.lent = 0

    def lend(self, size: int) -> Lease | None:
        """Memory of so many bytes; None where there is none to be had, or where plain memory serves better."""
        self.lent += 1
        whole = -(-size // PAGE) * PAGE
        block = self._taken(whole) or self._made(whole)
        if block is None:
            return None
        block.lent_last = self.lent
        return Lease(self, block, size)

    def _taken(self, size: int) -> _Block | None:
        """An idle block, the smallest that fits; None only if there was none when last looked."""
        while fitting := [block for block in list(self.idle) if size <= block.size <= SLACK * size]:
            for block in sorted(fitting, key=lambda b: b.size):
                if self._removed(block):
                    return block
        return None

    def _made(self, size: int) -> _Block | None:
        """A new block, where there is room for it or where blocks that nobody wants make room."""
        if size > most():
            return None
        for block in sorted(self.idle, key=lambda b: b.lent_last):
            if self._total() + size <= most() or self.lent - block.lent_last <= PATIENCE:
                break
            if self._removed(block):
                self.blocks.remove(block)
        if self._total() + size > most():
            return None
        try:
            block = _Block(size)
        except (OSError, ValueError, OverflowError):
            return None
        self.blocks.append(block)
        return block

    def _removed(self, block: _Block) -> bool:
        """Whether it was still there: another thread may have been faster."""
        try:
            self.idle.remove(block)
        except ValueError:
            return False
        return True

    def _total(self) -> int:
        return sum(block.size for block in self.blocks)

    def clear(self) -> None:
        """Give the system back what is idle."""
        for block in list(self.idle):
            if self._removed(block):
                self.blocks.remove(block)


_POOL = _Pool()


def lend(size: int) -> Any:
    """Memory of so many bytes as an object that NumPy makes an array of; None where plain memory serves better."""
    return _POOL.lend(size) if allowed() else None


def clear() -> None:
    """Give the system back what nobody holds."""
    _POOL.clear()


@cache
def allowed() -> bool:
    """Whether large results may lie in huge pages: where the system has them, unless ``TWISTWRENCH_HUGE_PAGES=0``.

    Raises ValueRangeError for what is neither on nor off.
    """
    text = os.environ.get(VARIABLE, "").strip().lower() or "1"
    if text not in ("0", "1", "off", "on"):
        raise ValueRangeError(
            f"{VARIABLE}: {os.environ[VARIABLE]!r} is not understood. Set 0 or off to leave large results to NumPy's own "
            "memory; 1, on or nothing to keep it for the next ones."
        )
    return text in ("1", "on") and hasattr(mmap, "MADV_HUGEPAGE") and hasattr(mmap, "MADV_FREE")


@cache
def most() -> int:
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


# ── Room for the results of one call: a single block for all of them, or memory that is lent where they are large

# What the C library gets from the system for a result it hands back when the result dies: always from 32 MB on, and below that
# whenever several results die together. Then each call pays for fresh pages, several times what computing takes.

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
    lease = lend(size) if size >= LEAST_LENT else None
    if lease is not None:
        return np.asarray(lease).view(dtype).reshape(shape)
    try:
        return np.empty(shape, dtype)
    except MemoryError:
        clear()
        return np.empty(shape, dtype)
