"""Object files of Linux and the BSDs: 64-bit ELF for x86-64."""

from __future__ import annotations

import numpy as np

from .object_file import PAGE, CodeSection, ObjectFile, Relocations, Unplaced, table, text_at

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
    """What a file has. Raises :class:`~.object_file.Unplaced` for what kernels do not need."""
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
