"""Pages of memory with code: written first and run later, never both at once."""

from __future__ import annotations

import ctypes
import mmap
import sys
from functools import cache
from typing import Any

from ..typing import Array
from .elf_file import Unplaced

_RESERVE_AND_COMMIT, _RELEASE = 0x3000, 0x8000
_READ_WRITE, _EXECUTE_READ = 0x04, 0x20
"""What VirtualAlloc, VirtualFree and VirtualProtect of Windows take."""


class CodePages:
    """Memory that can be read and run; it is given back with this object."""

    address: int

    @staticmethod
    def of(image: Array) -> CodePages:
        """Pages of those bytes. Raises :class:`~.elf_file.Unplaced` where the system runs no code from such pages."""
        return _WindowsPages(image) if sys.platform == "win32" else _MappedPages(image)


class _MappedPages(CodePages):
    """Pages of a system with mmap."""

    def __init__(self, image: Array) -> None:
        try:
            memory = mmap.mmap(-1, len(image), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        except (OSError, AttributeError):
            raise Unplaced from None
        memory[:] = image.tobytes()
        self._first = ctypes.c_char.from_buffer(memory)  # holds the memory
        self.address = ctypes.addressof(self._first)
        if _process().mprotect(self.address, len(image), mmap.PROT_READ | mmap.PROT_EXEC):
            raise Unplaced


class _WindowsPages(CodePages):
    """Pages of Windows."""

    def __init__(self, image: Array) -> None:
        self._system = _kernel32()
        self.address = self._system.VirtualAlloc(None, len(image), _RESERVE_AND_COMMIT, _READ_WRITE) or 0
        if not self.address:
            raise Unplaced
        ctypes.memmove(self.address, image.ctypes.data, len(image))
        before = ctypes.c_uint32()
        if not self._system.VirtualProtect(self.address, len(image), _EXECUTE_READ, ctypes.byref(before)):
            raise Unplaced

    def __del__(self) -> None:
        if self.address:
            self._system.VirtualFree(self.address, 0, _RELEASE)


@cache
def _process() -> Any:
    """What this process has loaded, the C library among it."""
    library = ctypes.CDLL(None)
    library.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    return library


@cache
def _kernel32() -> Any:
    library = ctypes.CDLL("kernel32")
    library.VirtualAlloc.restype = ctypes.c_void_p
    library.VirtualAlloc.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32, ctypes.c_uint32]
    library.VirtualFree.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32]
    library.VirtualProtect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32, ctypes.c_void_p]
    return library
