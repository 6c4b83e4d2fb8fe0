"""Object code put into memory without LLVM: what kernels from the cache need, and no more.

Serves 64-bit ELF for x86-64, the code of kernels alone: sections that are only read or run, relocations relative to the code,
and functions of the C library. What has more is refused, and left to LLVM's linker. Pages are written first and run later,
never both at once.
"""

from __future__ import annotations

import ctypes
import mmap
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..typing import Array


class Unplaced(Exception):
    """Code that this does not serve, or a system that runs no code from such pages."""


_HEADER = b"\x7fELF\x02\x01"
_RELOCATABLE, _X86_64 = 1, 62
_FILE = np.dtype("V16, <u2, <u2, V20, <u8, V12, <u2, V2")
"""The file's header: magic, type, machine, and where the table of sections is and how many they are."""
_SECTION = np.dtype(
    {
        "names": ["type", "flags", "offset", "size", "link", "info", "align"],
        "formats": ["<u4", "<u8", "<u8", "<u8", "<u4", "<u4", "<u8"],
        "offsets": [4, 8, 24, 32, 40, 44, 48],
        "itemsize": 64,
    }
)
_SYMBOL = np.dtype(
    {
        "names": ["name", "kind", "section", "value"],
        "formats": ["<u4", "u1", "<u2", "<u8"],
        "offsets": [0, 4, 6, 8],
        "itemsize": 24,
    }
)
_RELOCATION = np.dtype([("place", "<u8"), ("type", "<u4"), ("symbol", "<u4"), ("addend", "<i8")])
_PROGRAM, _SYMBOLS, _RELOCATIONS, _UNWINDING = 1, 2, 4, 0x70000001
_WRITTEN, _LOADED = 1, 2
_UNDEFINED, _RESERVED = 0, 0xFF00
_RELATIVE = (2, 4)
"""R_X86_64_PC32, R_X86_64_PLT32: a symbol's distance from the place that names it, in four bytes."""
_JUMP = b"\xff\x25\x02\x00\x00\x00\x90\x90"
"""``jmp [rip+2]`` and two idle bytes: to the address in the eight bytes that follow."""
_STUB = 16


class _Object(NamedTuple):
    """An object file: its parts that are loaded, each with its place in memory; its symbols; its relocations by section."""

    raw: bytes
    places: dict[int, int]
    sections: Array
    symbols: Array
    names: list[bytes]


class Placed:
    """Functions in memory; the pages are given back with this object."""

    def __init__(self, memory: mmap.mmap, places: dict[bytes, int]) -> None:
        self._memory = memory
        self._first = ctypes.c_char.from_buffer(memory)
        self._places = places

    def __getitem__(self, symbol: str) -> int:
        return ctypes.addressof(self._first) + self._places[symbol.encode()]


def placed(objects: Sequence[bytes]) -> Placed:
    """The functions of several object files together. Raises :class:`Unplaced`."""
    try:
        return _placed(objects)
    except (IndexError, KeyError, OverflowError, ValueError):  # a file that is none, or is cut
        raise Unplaced from None


def _placed(objects: Sequence[bytes]) -> Placed:
    found, size = [], 0
    for raw in objects:
        part, size = _read(raw, size)
        found.append(part)
    known: dict[bytes, int] = {}
    for part in found:
        for name, symbol in zip(part.names, part.symbols, strict=True):
            if symbol["kind"] >> 4 and symbol["section"] != _UNDEFINED:  # not local to its file
                known[name] = part.places[int(symbol["section"])] + int(symbol["value"])
    outside = sorted({name for part in found for name in _undefined(part)} - {*known})
    first = -(-size // _STUB) * _STUB
    places = {**known, **{name: first + _STUB * k for k, name in enumerate(outside)}}
    image = np.zeros(first + _STUB * len(outside), np.uint8)
    for part in found:
        _fill(image, part, places)
    for name in outside:
        stub = _JUMP + _library_function(name.decode()).to_bytes(8, "little")
        image[places[name] : places[name] + _STUB] = np.frombuffer(stub, np.uint8)
    return Placed(_runnable(image), known)


def _read(raw: bytes, start: int) -> tuple[_Object, int]:
    """What a file has, its sections laid out from a place on; and the place behind them."""
    if not raw.startswith(_HEADER) or len(raw) < _FILE.itemsize:
        raise Unplaced
    _, kind, machine, _, first, _, count, _ = np.frombuffer(raw, _FILE, 1).item()
    if kind != _RELOCATABLE or machine != _X86_64:
        raise Unplaced
    sections = _table(raw, _SECTION, first, count)
    places, end = {}, start
    for number, (kind, flags, offset, size, _, _, align) in enumerate(sections.tolist()):
        if not flags & _LOADED or kind == _UNWINDING:
            continue
        if kind != _PROGRAM or flags & _WRITTEN or offset + size > len(raw) or align > mmap.PAGESIZE:
            raise Unplaced
        end = -(-end // max(align, 1)) * max(align, 1)
        places[number] = end
        end += size
    tables = sections[sections["type"] == _SYMBOLS]
    if len(tables) != 1:
        raise Unplaced
    (table,) = tables
    symbols = _table(raw, _SYMBOL, int(table["offset"]), int(table["size"]) // _SYMBOL.itemsize)
    texts = sections[int(table["link"])]
    text = raw[int(texts["offset"]) : int(texts["offset"] + texts["size"])]
    names = [text[at : text.index(b"\0", at)] if kind >> 4 else b"" for at, kind in symbols[["name", "kind"]].tolist()]
    return _Object(raw, places, sections, symbols, names), end


def _table(raw: bytes, kind: np.dtype[Any], offset: int, count: int) -> Array:
    if offset + count * kind.itemsize > len(raw):
        raise Unplaced
    return np.frombuffer(raw, kind, count, offset)


def _undefined(part: _Object) -> list[bytes]:
    return [name for name, section in zip(part.names, part.symbols["section"], strict=True) if name and not section]


def _fill(image: Array, part: _Object, places: dict[bytes, int]) -> None:
    """Copy the sections of a file to their places, and write into them where symbols are."""
    addresses = np.array(
        [
            places[name] if name and not number else part.places.get(number, -1)
            for name, number in zip(part.names, part.symbols["section"].tolist(), strict=True)
        ]
    )
    addresses = np.where(addresses < 0, -1, addresses + part.symbols["value"].astype(np.int64))
    for number, place in part.places.items():
        offset, size = (int(part.sections[number][n]) for n in ("offset", "size"))
        image[place : place + size] = np.frombuffer(part.raw, np.uint8, size, offset)
    for section in part.sections[part.sections["type"] == _RELOCATIONS]:
        target = part.places.get(int(section["info"]))
        if target is None:  # of what is not loaded
            continue
        entries = _table(part.raw, _RELOCATION, int(section["offset"]), int(section["size"]) // _RELOCATION.itemsize)
        to = addresses[entries["symbol"]]
        if (to < 0).any() or not np.isin(entries["type"], _RELATIVE).all():
            raise Unplaced
        at = target + entries["place"].astype(np.int64)
        distance = (to + entries["addend"] - at).astype("<i4")
        image[at[:, None] + np.arange(4)] = distance.view(np.uint8).reshape(-1, 4)


def _runnable(image: Array) -> mmap.mmap:
    """Pages of the image, which can be read and run, and no longer written to."""
    try:
        memory = mmap.mmap(-1, len(image), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except (OSError, AttributeError):
        raise Unplaced from None
    memory[:] = image.tobytes()
    protect = _library().mprotect
    protect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    if protect(start, len(image), mmap.PROT_READ | mmap.PROT_EXEC):
        raise Unplaced
    return memory


@cache
def _library() -> ctypes.CDLL:
    """What this process has loaded, the C library among it."""
    return ctypes.CDLL(None)


@cache
def _library_function(name: str) -> int:
    try:
        return ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value or 0
    except AttributeError:
        raise Unplaced from None
