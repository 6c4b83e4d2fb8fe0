"""Loader of object files without LLVM, for x86-64 ELF files.

LLVM writes such files for Linux, the BSDs and, at the request of its target triple, for Windows.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ...core.typing import Array
from .executable_memory import ExecutableMemory, UnsupportedObject

PAGE_SIZE = 4096
"""Maximum alignment of sections [bytes]."""


class CodeSection(NamedTuple):
    """Section of bytes that are read or executed, never written."""

    contents: bytes
    align: int
    """Alignment of its first byte in memory [bytes]."""


class Relocations(NamedTuple):
    """Positions in a section that get four-byte relative addresses: address of the symbol + addend - position."""

    section: int
    """Number of the section."""
    places: Array
    """Offset of each position in the section [bytes]."""
    symbols: Array
    """Number of each symbol."""
    addends: Array
    """Number that is added to each symbol's address [bytes]."""


class ObjectFile(NamedTuple):
    """Parts of an object file that are needed to load it."""

    sections: dict[int, CodeSection]
    """Sections by number."""
    names: list[bytes]
    """Names of the symbols; empty for those local to the file."""
    symbol_sections: list[int]
    """Section of each symbol; 0 if it is undefined."""
    offsets: Array
    """Offset of each symbol in its section [bytes]."""
    relocations: list[Relocations]

    def undefined(self) -> set[bytes]:
        """Names that relocations use and the file does not define."""
        used: set[int] = set()
        for relocations in self.relocations:
            used.update(relocations.symbols.tolist())
        return {self.names[k] for k in used if self.names[k] and not self.symbol_sections[k]}


MAGIC = b"\x7fELF\x02\x01"
"""First bytes of a 64-bit little-endian file."""

_RELOCATABLE_FILE = 1
"""File type ET_REL."""
_X86_64 = 62
"""Machine EM_X86_64."""


def _row_type(size: int, /, **fields: tuple[int, str]) -> np.dtype[Any]:
    """Type of a row of a table in the file: ``size`` bytes, and of each field that is read the first byte and the format."""
    offsets, formats = zip(*fields.values(), strict=True)
    row = {"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": size}
    return np.dtype(row)  # type: ignore[call-overload]


_FILE_HEADER = _row_type(
    64, file_type=(16, "<u2"), machine=(18, "<u2"), section_table_offset=(40, "<u8"), section_count=(60, "<u2")
)
_SECTION = _row_type(
    64,
    type=(4, "<u4"),
    flags=(8, "<u8"),
    offset=(24, "<u8"),
    size=(32, "<u8"),
    link=(40, "<u4"),
    info=(44, "<u4"),
    align=(48, "<u8"),
)
_SYMBOL = _row_type(24, name=(0, "<u4"), kind=(4, "u1"), section=(6, "<u2"), value=(8, "<u8"))
_RELOCATION = _row_type(24, place=(0, "<u8"), type=(8, "<u4"), symbol=(12, "<u4"), addend=(16, "<i8"))
# Types of sections
_PROGRAM_SECTION = 1  # SHT_PROGBITS
_SYMBOL_SECTION = 2  # SHT_SYMTAB
_RELOCATION_SECTION = 4  # SHT_RELA
_UNWINDING_SECTION = 0x70000001  # SHT_X86_64_UNWIND
# Flags of sections
_WRITTEN_FLAG = 1  # SHF_WRITE
_LOADED_FLAG = 2  # SHF_ALLOC
_RELATIVE_TYPES = (2, 4)
"""R_X86_64_PC32, R_X86_64_PLT32: four-byte address of a symbol relative to the reference."""
_ADDRESS_SIZE = 4
"""Size of a relative address [bytes]."""


def read_elf(raw: bytes) -> ObjectFile:
    """Sections, symbols and relocations of a file. Raises :class:`UnsupportedObject` for features that kernels do not need."""
    (file_header,) = table(raw, _FILE_HEADER, 0, 1)
    file_type, machine, table_offset, section_count = file_header.item()
    if not raw.startswith(MAGIC) or file_type != _RELOCATABLE_FILE or machine != _X86_64:
        raise UnsupportedObject
    headers = table(raw, _SECTION, table_offset, section_count)
    sections = {}
    for number, (section_type, flags, offset, size, _, _, align) in enumerate(headers.tolist()):
        is_loaded = flags & _LOADED_FLAG
        # tables for unwinding are needed by C++ exceptions, which no kernel raises
        if not is_loaded or section_type == _UNWINDING_SECTION:
            continue
        is_written = flags & _WRITTEN_FLAG
        is_truncated = offset + size > len(raw)
        if section_type != _PROGRAM_SECTION or is_written or is_truncated or align > PAGE_SIZE:
            raise UnsupportedObject
        sections[number] = CodeSection(raw[offset : offset + size], max(align, 1))
    symbol_headers = headers[headers["type"] == _SYMBOL_SECTION]
    if len(symbol_headers) != 1:
        raise UnsupportedObject
    (symbol_header,) = symbol_headers
    symbols = table(raw, _SYMBOL, int(symbol_header["offset"]), int(symbol_header["size"]) // _SYMBOL.itemsize)
    names_header = headers[int(symbol_header["link"])]
    names_offset, names_size = int(names_header["offset"]), int(names_header["size"])
    all_names = raw[names_offset : names_offset + names_size]  # each ends with a zero byte
    names = []
    for first_byte, kind in symbols[["name", "kind"]].tolist():
        is_local = kind >> 4 == 0  # the upper four bits are the binding, and STB_LOCAL is 0
        name = b""
        if not is_local:
            end = all_names.index(b"\0", first_byte)
            name = all_names[first_byte:end]
        names.append(name)
    relocations = []
    for header in headers[headers["type"] == _RELOCATION_SECTION]:
        section = int(header["info"])
        if section not in sections:  # of a section that is not loaded
            continue
        entries = table(raw, _RELOCATION, int(header["offset"]), int(header["size"]) // _RELOCATION.itemsize)
        if not np.isin(entries["type"], _RELATIVE_TYPES).all():
            raise UnsupportedObject
        places = entries["place"].astype(np.int64)  # signed, as differences of places are
        relocations.append(Relocations(section, places, entries["symbol"], entries["addend"]))
    offsets = symbols["value"].astype(np.int64)
    return ObjectFile(sections, names, symbols["section"].tolist(), offsets, relocations)


def table(raw: bytes, row_type: np.dtype[Any], offset: int, count: int) -> Array:
    """``count`` rows of a table in a file. Raises :class:`UnsupportedObject` if the file is too short."""
    if offset + count * row_type.itemsize > len(raw):
        raise UnsupportedObject
    return np.frombuffer(raw, row_type, count, offset)


# The rest of the module links object code in memory, as far as cached kernels need it. This saves the time of loading LLVM: the
# first torque of panda takes 72 ms instead of 97. Run times stay the same. The loader supports sections that are only read or
# executed, relocations relative to the code, and functions of the C library. It leaves other code, such as that for macOS, to
# LLVM's linker. All sections of a kernel are in one block of memory, so that every distance fits into four bytes. LLVM's linker
# for Windows places each section separately, and ends the process if a distance is too large.

_JUMP = b"\xff\x25\x02\x00\x00\x00\x90\x90"
"""``jmp [rip+2]`` and two NOP bytes: jumps to the address in the following eight bytes."""
_STUB_SIZE = 16
"""Size of a stub, which jumps to a library function: instruction and address [bytes]."""


class LoadedObject:
    """Functions in memory, whose addresses are read by name; the pages are freed with this object."""

    def __init__(self, pages: ExecutableMemory, offsets: dict[bytes, int]) -> None:
        self._pages = pages
        self._offsets = offsets

    def __getitem__(self, symbol: str) -> int:
        return self._pages.address + self._offsets[symbol.encode()]


def load_objects(objects: Sequence[bytes]) -> LoadedObject:
    """Functions of several object files together.

    Raises :class:`UnsupportedObject` for files that only LLVM's linker may be able to load, and RuntimeError for files that
    LLVM's linker must not load.
    """
    try:
        image, function_offsets = link_files([read_elf(raw) for raw in objects])
    except (IndexError, KeyError, OverflowError, ValueError):  # an invalid or truncated file
        raise UnsupportedObject from None
    return LoadedObject(ExecutableMemory.from_image(image), function_offsets)


def link_files(files: Sequence[ObjectFile]) -> tuple[Array, dict[bytes, int]]:
    """Bytes of several files together, the *image*, and the offset of each function in it."""
    end = 0
    section_offsets: list[dict[int, int]] = []  # for each file, offset in the image by number of the section
    function_offsets: dict[bytes, int] = {}
    for file in files:
        offsets: dict[int, int] = {}
        section_offsets.append(offsets)
        for number, (contents, align) in file.sections.items():
            offsets[number] = _round_up(end, align)
            end = offsets[number] + len(contents)
        for name, section, offset_in_section in zip(file.names, file.symbol_sections, file.offsets, strict=True):
            if name and section in offsets:
                function_offsets[name] = offsets[section] + int(offset_in_section)
    undefined: set[bytes] = set()
    for file in files:
        undefined |= file.undefined()
    library_functions = sorted(undefined - set(function_offsets))  # in an order that does not change between runs
    first_stub = _round_up(end, _STUB_SIZE)
    stub_offsets = {name: first_stub + _STUB_SIZE * k for k, name in enumerate(library_functions)}
    image = np.zeros(first_stub + _STUB_SIZE * len(library_functions), np.uint8)
    offsets_by_name = function_offsets | stub_offsets
    for file, offsets in zip(files, section_offsets, strict=True):
        _fill_image(image, file, offsets, offsets_by_name)
    for name, offset in stub_offsets.items():
        address = _library_function(name.decode())
        stub = _JUMP + address.to_bytes(8, "little")
        image[offset : offset + _STUB_SIZE] = np.frombuffer(stub, np.uint8)
    return image, function_offsets


def _round_up(offset: int, align: int) -> int:
    """Smallest multiple of ``align`` that is not below an offset."""
    return -(-offset // align) * align


def _fill_image(image: Array, file: ObjectFile, offsets: dict[int, int], offsets_by_name: dict[bytes, int]) -> None:
    """Copy the sections of a file into the image, and write the relative addresses of symbols into them.

    Both mappings hold offsets in the image: ``offsets`` of its sections, by number; ``offsets_by_name`` of all symbols.
    """
    symbol_offsets: list[int] = []  # in the image; -1 if unknown
    for name, section, offset_in_section in zip(file.names, file.symbol_sections, file.offsets.tolist(), strict=True):
        if name and not section:  # defined by another file or a stub; its offset in a section is zero
            base = offsets_by_name.get(name, -1)
        else:
            base = offsets.get(section, -1)
        symbol_offsets.append(-1 if base < 0 else base + offset_in_section)
    symbol_offset_array = np.array(symbol_offsets, np.int64)
    for number, (contents, _) in file.sections.items():
        image[offsets[number] : offsets[number] + len(contents)] = np.frombuffer(contents, np.uint8)
    for number, places, symbols, addends in file.relocations:
        targets = symbol_offset_array[symbols]
        last_place = len(file.sections[number].contents) - _ADDRESS_SIZE
        if (places < 0).any() or (places > last_place).any():  # LLVM's linker would write there
            raise RuntimeError("a relocation lies outside its section")
        if (targets < 0).any():
            raise UnsupportedObject
        positions = offsets[number] + places
        distances = (targets + addends - positions).astype("<i4")
        bytes_of_distances = distances.view(np.uint8).reshape(-1, _ADDRESS_SIZE)
        byte_positions = positions[:, None] + np.arange(_ADDRESS_SIZE)  # (relocations, 4)
        image[byte_positions] = bytes_of_distances


@cache
def _library_function(name: str) -> int:
    """Address of a function of the C library. Raises UnsupportedObject if there is none of this name."""
    for library in _libraries():
        function = getattr(library, name, None)
        if function is not None:
            address = ctypes.cast(function, ctypes.c_void_p).value
            return address or 0  # the value of a null pointer is None; a function is not null
    raise UnsupportedObject


@cache
def _libraries() -> tuple[Any, ...]:
    """Libraries with the C library's functions and, on Windows, the function that grows a stack."""
    if sys.platform == "win32":
        return tuple(ctypes.CDLL(name) for name in ("ucrtbase", "vcruntime140", "ntdll"))
    return (ctypes.CDLL(None),)
