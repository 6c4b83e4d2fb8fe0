"""Object files of Windows: COFF for x86-64."""

from __future__ import annotations

import numpy as np

from .object_file import PAGE, CodeSection, ObjectFile, Relocations, Unplaced, table, text_at

MAGIC = b"\x64\x86"
"""What a file for x86-64 begins with."""

_FILE = np.dtype("V2, <u2, V4, <u4, <u4, <u2, V2")
"""The file's header: machine, sections, where the table of symbols is and how many they are, size of a further header."""
_SECTION = np.dtype(
    {
        "names": ["name", "size", "offset", "relocations", "count", "flags"],
        "formats": ["S8", "<u4", "<u4", "<u4", "<u2", "<u4"],
        "offsets": [0, 16, 20, 24, 32, 36],
        "itemsize": 40,
    }
)
_SYMBOL = np.dtype(
    {
        "names": ["name", "zero", "at", "value", "section", "kind", "further"],
        "formats": ["S8", "<u4", "<u4", "<u4", "<i2", "u1", "u1"],
        "offsets": [0, 0, 4, 8, 12, 16, 17],
        "itemsize": 18,
    }
)
_RELOCATION = np.dtype([("place", "<u4"), ("symbol", "<u4"), ("type", "<u2")])
_UNWINDING = (b".pdata", b".xdata")
"""What exceptions need that pass through code: none passes through a kernel."""
_WITHOUT_BYTES, _REMOVED, _DISCARDED, _WRITTEN = 0x80, 0x800, 0x2000000, 0x80000000
_COUNTED_IN_FIRST, _ALIGN = 0x1000000, 20
"""The flag of a section with more relocations than its header can say; and how far the bits of its alignment are shifted."""
_USUAL = 5
"""What stands for an alignment that is not said: 16 bytes."""
_EXTERNAL = 2
_FIRST, _LAST = 4, 9
"""IMAGE_REL_AMD64_REL32 to IMAGE_REL_AMD64_REL32_5: a symbol's distance from the end of an instruction, of which up to five
bytes follow."""


def read_coff(raw: bytes) -> ObjectFile:
    """What a file has. Raises :class:`~.object_file.Unplaced` for what kernels do not need."""
    _, count, _, at, length, further, _ = table(raw, _FILE, 0, 1)[0].item()
    if not raw.startswith(MAGIC) or further:
        raise Unplaced
    headers = table(raw, _SECTION, _FILE.itemsize, count)
    sections = {}
    relocations = []
    for number, header in enumerate(headers, start=1):
        name, size, offset, first, several, flags = header.item()
        if not size or flags & (_REMOVED | _DISCARDED) or name in _UNWINDING:
            continue
        align = 1 << ((flags >> _ALIGN & 15) or _USUAL) - 1
        if flags & _WRITTEN or flags & _WITHOUT_BYTES or offset + size > len(raw) or align > PAGE:
            raise Unplaced
        sections[number] = CodeSection(raw[offset : offset + size], align)
        skipped = bool(flags & _COUNTED_IN_FIRST)
        if skipped:
            several = int(table(raw, _RELOCATION, first, 1)["place"][0])
        entries = table(raw, _RELOCATION, first, several)[skipped:]
        if len(entries):
            relocations.append(_relative(number, sections[number].contents, entries))
    symbols = table(raw, _SYMBOL, at, length)
    texts = raw[at + length * _SYMBOL.itemsize :]
    names, homes = [b""] * length, [-1] * length
    k = 0
    while k < length:  # entries that belong to the one before them lie between
        name, zero, place, value, section, kind, further = symbols[k].item()
        homes[k] = section
        if kind == _EXTERNAL:
            names[k] = name if zero else text_at(texts, place)
            if not section and value:  # room that the linker is to make
                raise Unplaced
        elif section <= 0:
            homes[k] = -1
        k += 1 + further
    return ObjectFile(sections, names, homes, symbols["value"].astype(np.int64), relocations)


def _relative(number: int, contents: bytes, entries: np.ndarray) -> Relocations:
    """The relocations of a section; what is to be added to the distance stands in the bytes where it goes."""
    kinds, places = entries["type"].astype(np.int64), entries["place"].astype(np.int64)
    if not ((kinds >= _FIRST) & (kinds <= _LAST)).all():
        raise Unplaced
    cells = np.frombuffer(contents, np.uint8)[places[:, None] + np.arange(4)]
    addends = np.ascontiguousarray(cells).view("<i4")[:, 0].astype(np.int64)
    return Relocations(number, places, entries["symbol"], addends - 4 - (kinds - _FIRST))
