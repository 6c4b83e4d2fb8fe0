"""Memory pages with code. They are writable at first, then executable, never both at once."""

from __future__ import annotations

import ctypes
import mmap
import sys
from functools import cache
from typing import Any

from ...core.typing import Array

# Arguments of VirtualAlloc, VirtualFree and VirtualProtect of Windows: kinds of allocation, then kinds of protection.
_RESERVE_AND_COMMIT = 0x3000
_RELEASE = 0x8000
_READ_WRITE = 0x04
_EXECUTE_READ = 0x20


class UnsupportedObject(Exception):
    """Raised for object code that needs LLVM's own linker, or if the system does not execute pages that were written."""


class ExecutableMemory:
    """Readable and executable memory; freed with this object."""

    address: int
    """Address of the first byte."""

    @staticmethod
    def from_image(image: Array) -> ExecutableMemory:
        """Pages with the bytes of ``image``. Raises :class:`UnsupportedObject` if the system does not execute such pages."""
        if sys.platform == "win32":
            return _WindowsMemory(image)
        return _MappedMemory(image)


class _MappedMemory(ExecutableMemory):
    """Pages on a system with mmap."""

    def __init__(self, image: Array) -> None:
        try:
            memory = mmap.mmap(-1, len(image), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        except (OSError, AttributeError):  # no memory, or no such flags on this system
            raise UnsupportedObject from None
        memory[:] = image.tobytes()
        self._first_byte = ctypes.c_char.from_buffer(memory)  # keeps the memory mapped
        self.address = ctypes.addressof(self._first_byte)
        failed = _process().mprotect(self.address, len(image), mmap.PROT_READ | mmap.PROT_EXEC)
        if failed:
            raise UnsupportedObject


class _WindowsMemory(ExecutableMemory):
    """Pages on Windows."""

    def __init__(self, image: Array) -> None:
        self._system = _kernel32()
        address = self._system.VirtualAlloc(None, len(image), _RESERVE_AND_COMMIT, _READ_WRITE)
        self.address = address or 0  # None for failure
        if not self.address:
            raise UnsupportedObject
        ctypes.memmove(self.address, image.ctypes.data, len(image))
        old_protection = ctypes.c_uint32()  # VirtualProtect requires a place for it
        is_done = self._system.VirtualProtect(self.address, len(image), _EXECUTE_READ, ctypes.byref(old_protection))
        if not is_done:
            raise UnsupportedObject

    def __del__(self) -> None:
        if self.address:
            self._system.VirtualFree(self.address, 0, _RELEASE)


@cache
def _process() -> Any:
    """Functions of the libraries that are loaded in this process; the C library has mprotect."""
    library = ctypes.CDLL(None)
    library.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    return library


@cache
def _kernel32() -> Any:
    """Library with Windows' functions for memory."""
    library = ctypes.CDLL("kernel32")
    library.VirtualAlloc.restype = ctypes.c_void_p
    library.VirtualAlloc.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32, ctypes.c_uint32]
    library.VirtualFree.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32]
    library.VirtualProtect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32, ctypes.c_void_p]
    return library
