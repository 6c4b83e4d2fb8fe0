"""Object code put into memory without LLVM: what kernels from the cache need, and no more.

Serves ELF for x86-64, the code of kernels alone: sections that are only read or run, relocations relative to the
code, and functions of the C library. What has more is refused, and left to LLVM's linker, as is the code of macOS. Pages are
written first and run later, never both at once. All sections of a kernel lie in one block, so that every distance fits into
four bytes; LLVM's linker for Windows puts each where the system has room, and ends the process where one is too far off.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from ..typing import Array
from .code_pages import CodePages
from .elf_file import ObjectFile, Unplaced, read_elf

_JUMP = b"\xff\x25\x02\x00\x00\x00\x90\x90"
"""``jmp [rip+2]`` and two idle bytes: to the address in the eight bytes that follow."""
_STUB = 16


class Placed:
    """Functions in memory; the pages are given back with this object."""

    def __init__(self, pages: CodePages, places: dict[bytes, int]) -> None:
        self._pages = pages
        self._places = places

    def __getitem__(self, symbol: str) -> int:
        return self._pages.address + self._places[symbol.encode()]


def placed(objects: Sequence[bytes]) -> Placed:
    """The functions of several object files together.

    Raises :class:`Unplaced` for what LLVM's linker is to try, RuntimeError for what it must not see.
    """
    try:
        image, known = linked([read_elf(raw) for raw in objects])
    except (IndexError, KeyError, OverflowError, ValueError):  # a file that is none, or is cut
        raise Unplaced from None
    return Placed(CodePages.of(image), known)


def linked(files: Sequence[ObjectFile]) -> tuple[Array, dict[bytes, int]]:
    """The bytes of several files together, and where in them each function is."""
    end = 0
    where: list[dict[int, int]] = []
    for file in files:
        where.append({})
        for number, (contents, align) in file.sections.items():
            where[-1][number] = -(-end // align) * align
            end = where[-1][number] + len(contents)
    known = {
        name: places[home] + int(value)
        for file, places in zip(files, where, strict=True)
        for name, home, value in zip(file.names, file.homes, file.values, strict=True)
        if name and home in places
    }
    outside = sorted({name for file in files for name in file.undefined()} - {*known})
    first = -(-end // _STUB) * _STUB
    places = {**known, **{name: first + _STUB * k for k, name in enumerate(outside)}}
    image = np.zeros(first + _STUB * len(outside), np.uint8)
    for file, mine in zip(files, where, strict=True):
        _fill(image, file, mine, places)
    for name in outside:
        stub = _JUMP + _library_function(name.decode()).to_bytes(8, "little")
        image[places[name] : places[name] + _STUB] = np.frombuffer(stub, np.uint8)
    return image, known


def _fill(image: Array, file: ObjectFile, mine: dict[int, int], places: dict[bytes, int]) -> None:
    """Copy the sections of a file to their places, and write into them where symbols are."""
    starts = [
        places.get(name, -1) if name and not home else mine.get(home, -1)
        for name, home in zip(file.names, file.homes, strict=True)
    ]
    addresses = np.array(starts, np.int64)
    addresses = np.where(addresses < 0, -1, addresses + file.values)
    for number, (contents, _) in file.sections.items():
        image[mine[number] : mine[number] + len(contents)] = np.frombuffer(contents, np.uint8)
    for number, at, symbols, addends in file.relocations:
        to, last = addresses[symbols], len(file.sections[number].contents) - 4
        if (at < 0).any() or (at > last).any():  # LLVM's linker would write there
            raise RuntimeError("a relocation lies outside its section")
        if (to < 0).any():
            raise Unplaced
        at = mine[number] + at
        distance = (to + addends - at).astype("<i4")
        image[at[:, None] + np.arange(4)] = distance.view(np.uint8).reshape(-1, 4)


@cache
def _library_function(name: str) -> int:
    for library in _libraries():
        with_name = getattr(library, name, None)
        if with_name is not None:
            return ctypes.cast(with_name, ctypes.c_void_p).value or 0
    raise Unplaced


@cache
def _libraries() -> tuple[Any, ...]:
    """What has the C library's functions, and the one by which Windows grows a stack."""
    if sys.platform == "win32":
        return tuple(ctypes.CDLL(name) for name in ("ucrtbase", "vcruntime140", "ntdll"))
    return (ctypes.CDLL(None),)
