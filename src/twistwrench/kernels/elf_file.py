"""Reader of object files: 64-bit ELF for x86-64, as LLVM writes them for Linux, the BSDs and, by its triple, Windows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..typing import Array

PAGE = 4096
"""Bytes that sections are aligned to at most."""


class Unplaced(Exception):
    """Code that is not placed here, or a system that runs no code from such pages."""


class CodeSection(NamedTuple):
    """Bytes that are read or run, never written."""

    contents: bytes
    align: int


class Relocations(NamedTuple):
    """Places in a section where the distance to a symbol goes, in four bytes: symbol + addend - place."""

    section: int
    places: Array
    symbols: Array
    addends: Array


class ObjectFile(NamedTuple):
    """An object file, as far as it is loaded."""

    sections: dict[int, CodeSection]
    names: list[bytes]
    """Of each symbol; empty for those that are local to the file."""
    homes: list[int]
    """The section of each symbol; 0 where it is undefined."""
    values: Array
    """Where each symbol is in its section."""
    relocations: list[Relocations]

    def undefined(self) -> set[bytes]:
        """Names that relocations want and the file has not."""
        wanted = {int(k) for r in self.relocations for k in np.unique(r.symbols)}
        return {self.names[k] for k in wanted if self.names[k] and not self.homes[k]}


MAGIC = b"\x7fELF\x02\x01"
"""What a file of 64 bits in little-endian order begins with."""

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
_RELATIVE = (2, 4)
"""R_X86_64_PC32, R_X86_64_PLT32: a symbol's distance from the place that names it, in four bytes."""


def read_elf(raw: bytes) -> ObjectFile:
    """What a file has. Raises :class:`Unplaced` for what kernels do not need."""
    _, kind, machine, _, first, _, count, _ = table(raw, _FILE, 0, 1)[0].item()
    if not raw.startswith(MAGIC) or kind != _RELOCATABLE or machine != _X86_64:
        raise Unplaced
    headers = table(raw, _SECTION, first, count)
    sections = {}
    for number, (kind, flags, offset, size, _, _, align) in enumerate(headers.tolist()):
        if not flags & _LOADED or kind == _UNWINDING:
            continue
        if kind != _PROGRAM or flags & _WRITTEN or offset + size > len(raw) or align > PAGE:
            raise Unplaced
        sections[number] = CodeSection(raw[offset : offset + size], max(align, 1))
    tables = headers[headers["type"] == _SYMBOLS]
    if len(tables) != 1:
        raise Unplaced
    (at,) = tables
    symbols = table(raw, _SYMBOL, int(at["offset"]), int(at["size"]) // _SYMBOL.itemsize)
    where = headers[int(at["link"])]
    texts = raw[int(where["offset"]) : int(where["offset"] + where["size"])]
    names = [text_at(texts, k) if kind >> 4 else b"" for k, kind in symbols[["name", "kind"]].tolist()]
    relocations = []
    for header in headers[headers["type"] == _RELOCATIONS]:
        if int(header["info"]) not in sections:
            continue
        entries = table(raw, _RELOCATION, int(header["offset"]), int(header["size"]) // _RELOCATION.itemsize)
        if not np.isin(entries["type"], _RELATIVE).all():
            raise Unplaced
        places = entries["place"].astype(np.int64)
        relocations.append(Relocations(int(header["info"]), places, entries["symbol"], entries["addend"]))
    return ObjectFile(sections, names, symbols["section"].tolist(), symbols["value"].astype(np.int64), relocations)


def table(raw: bytes, kind: np.dtype[Any], offset: int, count: int) -> Array:
    """Rows of a table in a file; raises :class:`Unplaced` where the file ends before them."""
    if offset + count * kind.itemsize > len(raw):
        raise Unplaced
    return np.frombuffer(raw, kind, count, offset)


def text_at(texts: bytes, at: int) -> bytes:
    """The text that begins at a place and ends before a zero."""
    return texts[at : texts.index(b"\0", at)]
