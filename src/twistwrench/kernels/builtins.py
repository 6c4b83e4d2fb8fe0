"""Machine code as a builtin function of Python: the description CPython wants of it, and the function made from that."""

from __future__ import annotations

import ctypes
from typing import Any

FASTCALL, KEYWORDS = 0x0080, 0x0002
"""CPython's flags of functions that take a table of arguments, and its length; and a tuple of names."""


class MethodDefinition(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def builtin(definition: MethodDefinition, context: bytes, keeper: str) -> Any:
    """The function, whose ``self`` is the context; the module's name has to keep alive what both point to."""
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.py_object]
    return make(ctypes.addressof(definition), context, keeper)


def address_of(name: str) -> int:
    """Where a function of Python's C API is."""
    return ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0
