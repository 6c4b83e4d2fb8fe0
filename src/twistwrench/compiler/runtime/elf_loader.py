"""Loader of object files without LLVM: x86-64 ELF, which LLVM writes for Linux, the BSDs and, by its triple, Windows."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ...core.typing import Array
from .executable_memory import ExecutableMemory, UnsupportedObject

PAGE = 4096
"""Maximum alignment of sections [bytes]."""


class CodeSection(NamedTuple):
    """Section of bytes that are read or executed, never written."""

    contents: bytes
    align: int


class Relocations(NamedTuple):
    """Positions in a section for four-byte relative addresses of symbols: symbol + addend - position."""

    section: int
    places: Array
    symbols: Array
    addends: Array


class ObjectFile(NamedTuple):
    """Loaded parts of an object file."""

    sections: dict[int, CodeSection]
    names: list[bytes]
    """Names of the symbols; empty for those local to the file."""
    symbol_sections: list[int]
    """Section of each symbol; 0 if it is undefined."""
    values: Array
    """Offset of each symbol in its section."""
    relocations: list[Relocations]

    def undefined(self) -> set[bytes]:
        """Names used by relocations but not defined in the file."""
        undefined = set()
        for relocations in self.relocations:
            for k in relocations.symbols.tolist():
                if self.names[k] and not self.symbol_sections[k]:
                    undefined.add(self.names[k])
        return undefined


MAGIC = b"\x7fELF\x02\x01"
"""First bytes of a 64-bit little-endian file."""

_RELOCATABLE_FILE, _X86_64 = 1, 62
_FILE = np.dtype("V16, <u2, <u2, V20, <u8, V12, <u2, V2")
"""File header: magic, type, machine, and offset and length of the section table."""


def _rows(size: int, fields: str, formats: str, offsets: Sequence[int]) -> np.dtype[Any]:
    """Row type of a table with rows of ``size`` bytes, of which some fields are read."""
    rows = {"names": fields.split(), "formats": formats.split(), "offsets": list(offsets), "itemsize": size}
    return np.dtype(rows)  # type: ignore[call-overload]


_SECTION = _rows(
    64, "type flags offset size link info align", "<u4 <u8 <u8 <u8 <u4 <u4 <u8", (4, 8, 24, 32, 40, 44, 48)
)
_SYMBOL = _rows(24, "name kind section value", "<u4 u1 <u2 <u8", (0, 4, 6, 8))
_RELOCATION = np.dtype([("place", "<u8"), ("type", "<u4"), ("symbol", "<u4"), ("addend", "<i8")])
_PROGRAM, _SYMBOLS, _RELOCATIONS, _UNWINDING = 1, 2, 4, 0x70000001
_WRITTEN_FLAG, _LOADED_FLAG = 1, 2
_RELATIVE = (2, 4)
"""R_X86_64_PC32, R_X86_64_PLT32: four-byte address of a symbol relative to the reference."""


def read_elf(raw: bytes) -> ObjectFile:
    """Sections, symbols and relocations of a file. Raises :class:`UnsupportedObject` for features that kernels do not need."""
    _, kind, machine, _, first, _, count, _ = table(raw, _FILE, 0, 1)[0].item()
    if not raw.startswith(MAGIC) or kind != _RELOCATABLE_FILE or machine != _X86_64:
        raise UnsupportedObject
    headers = table(raw, _SECTION, first, count)
    sections = {}
    for number, (kind, flags, offset, size, _, _, align) in enumerate(headers.tolist()):
        if not flags & _LOADED_FLAG or kind == _UNWINDING:
            continue
        if kind != _PROGRAM or flags & _WRITTEN_FLAG or offset + size > len(raw) or align > PAGE:
            raise UnsupportedObject
        sections[number] = CodeSection(raw[offset : offset + size], max(align, 1))
    tables = headers[headers["type"] == _SYMBOLS]
    if len(tables) != 1:
        raise UnsupportedObject
    (symbol_table,) = tables
    symbols = table(raw, _SYMBOL, int(symbol_table["offset"]), int(symbol_table["size"]) // _SYMBOL.itemsize)
    text_section = headers[int(symbol_table["link"])]
    texts = raw[int(text_section["offset"]) : int(text_section["offset"] + text_section["size"])]
    names = []
    for first_byte, kind in symbols[["name", "kind"]].tolist():
        is_local = not kind >> 4
        names.append(b"" if is_local else texts[first_byte : texts.index(b"\0", first_byte)])
    relocations = []
    for header in headers[headers["type"] == _RELOCATIONS]:
        if int(header["info"]) not in sections:
            continue
        entries = table(raw, _RELOCATION, int(header["offset"]), int(header["size"]) // _RELOCATION.itemsize)
        if not np.isin(entries["type"], _RELATIVE).all():
            raise UnsupportedObject
        places = entries["place"].astype(np.int64)
        relocations.append(Relocations(int(header["info"]), places, entries["symbol"], entries["addend"]))
    return ObjectFile(sections, names, symbols["section"].tolist(), symbols["value"].astype(np.int64), relocations)


def table(raw: bytes, kind: np.dtype[Any], offset: int, count: int) -> Array:
    """Rows of a table in a file. Raises :class:`UnsupportedObject` if the file is too short."""
    if offset + count * kind.itemsize > len(raw):
        raise UnsupportedObject
    return np.frombuffer(raw, kind, count, offset)


# Object code is linked in memory, to the extent that cached kernels need it. It does not change run times; it saves the time
# of loading LLVM: the first torque of panda takes 72 ms instead of 97. It links sections that are only read or executed,
# relocations relative to the code, and functions of the C library. Other code, such as that for macOS, is left to LLVM's
# linker. Pages are written first, then executable, never both at once. All sections of a kernel are in one block, so that
# every distance fits into four bytes. LLVM's linker for Windows places each separately, and ends the process if a distance is
# too large.

_JUMP = b"\xff\x25\x02\x00\x00\x00\x90\x90"
"""``jmp [rip+2]`` and two NOP bytes: jumps to the address in the following eight bytes."""
_STUB = 16


class LoadedObject:
    """Functions in memory; the pages are freed with this object."""

    def __init__(self, pages: ExecutableMemory, offsets: dict[bytes, int]) -> None:
        self._pages = pages
        self._offsets = offsets

    def __getitem__(self, symbol: str) -> int:
        return self._pages.address + self._offsets[symbol.encode()]


def load_objects(objects: Sequence[bytes]) -> LoadedObject:
    """Functions of several object files together.

    Raises :class:`UnsupportedObject` for files that LLVM's linker may load, and RuntimeError for files that it must not load.
    """
    try:
        image, functions = link_files([read_elf(raw) for raw in objects])
    except (IndexError, KeyError, OverflowError, ValueError):  # an invalid or truncated file
        raise UnsupportedObject from None
    return LoadedObject(ExecutableMemory.from_image(image), functions)


def link_files(files: Sequence[ObjectFile]) -> tuple[Array, dict[bytes, int]]:
    """Bytes of several files together, and the offset of each function."""
    end = 0
    section_offsets: list[dict[int, int]] = []
    functions: dict[bytes, int] = {}
    for file in files:
        offsets: dict[int, int] = {}
        section_offsets.append(offsets)
        for number, (contents, align) in file.sections.items():
            offsets[number] = -(-end // align) * align
            end = offsets[number] + len(contents)
        for name, section, value in zip(file.names, file.symbol_sections, file.values, strict=True):
            if name and section in offsets:
                functions[name] = offsets[section] + int(value)
    undefined: set[bytes] = set()
    for file in files:
        undefined |= file.undefined()
    library_functions = sorted(undefined - set(functions))
    first = -(-end // _STUB) * _STUB
    stubs = {name: first + _STUB * k for k, name in enumerate(library_functions)}
    image = np.zeros(first + _STUB * len(library_functions), np.uint8)
    for file, offsets in zip(files, section_offsets, strict=True):
        _fill(image, file, offsets, functions | stubs)
    for name, offset in stubs.items():
        stub = _JUMP + _library_function(name.decode()).to_bytes(8, "little")
        image[offset : offset + _STUB] = np.frombuffer(stub, np.uint8)
    return image, functions


def _fill(image: Array, file: ObjectFile, offsets: dict[int, int], symbols_by_name: dict[bytes, int]) -> None:
    """Copy the sections of a file to their offsets, and write the relative addresses of symbols into them."""
    starts: list[int] = []
    for name, section in zip(file.names, file.symbol_sections, strict=True):
        is_external = name and not section
        starts.append(symbols_by_name.get(name, -1) if is_external else offsets.get(section, -1))
    addresses = np.array(starts, np.int64)
    addresses = np.where(addresses < 0, -1, addresses + file.values)
    for number, (contents, _) in file.sections.items():
        image[offsets[number] : offsets[number] + len(contents)] = np.frombuffer(contents, np.uint8)
    for number, at, symbols, addends in file.relocations:
        targets, last_start = addresses[symbols], len(file.sections[number].contents) - 4
        if (at < 0).any() or (at > last_start).any():  # LLVM's linker would write there
            raise RuntimeError("a relocation lies outside its section")
        if (targets < 0).any():
            raise UnsupportedObject
        at = offsets[number] + at
        distance = (targets + addends - at).astype("<i4")
        image[at[:, None] + np.arange(4)] = distance.view(np.uint8).reshape(-1, 4)


@cache
def _library_function(name: str) -> int:
    for library in _libraries():
        with_name = getattr(library, name, None)
        if with_name is not None:
            return ctypes.cast(with_name, ctypes.c_void_p).value or 0
    raise UnsupportedObject


@cache
def _libraries() -> tuple[Any, ...]:
    """Libraries with the C library's functions and, on Windows, the function that grows a stack."""
    if sys.platform == "win32":
        return tuple(ctypes.CDLL(name) for name in ("ucrtbase", "vcruntime140", "ntdll"))
    return (ctypes.CDLL(None),)
