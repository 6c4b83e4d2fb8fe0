"""A kernel as a builtin function for single samples: what a kilohertz loop calls. CPython only, with its lock.

NumPy's own way into a ufunc takes longer than most kernels run. The builtin made here does without it where the arguments
are plain; the rest it hands to a slower callable, which also has the last word on errors.
"""

from __future__ import annotations

import ctypes
import sys
import sysconfig
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..targets.fast_call_text import BYTES_DATA, CALL, FIELDS, POINTERS, call_assembly
from .interpreter import runs_machine_code
from .jit import assembled
from .ufunc import owner_of

_NEW_FROM_DESCRIPTOR = 94
"""Slot of PyArray_NewFromDescr in NumPy's array API table; fixed since NumPy 1.0."""

_FASTCALL_WITH_KEYWORDS = 0x0080 | 0x0002


class _MethodDefinition(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


class _Keeper(str):
    """All that a builtin points to; it holds this object as the name of its module, which others read as a text."""

    kept: dict[str, Any]


class kernel(bytes):  # what the builtin's repr calls it: "built-in method … of kernel object"
    """The addresses a builtin works with, and whose method it is; ``self`` of the builtin.

    Addresses mean nothing elsewhere. A builtin is pickled as the attribute of its name of its ``self``, and this one is
    pickled, and copied, as the owner of the method: what comes out is the owner's own method of that name.
    """

    owner: Any

    def __reduce_ex__(self, protocol: Any) -> tuple[Callable[[Any], Any], tuple[Any]]:
        return _same, (self.owner,)


def _same(owner: Any) -> Any:
    return owner


def make_call(ufunc: Any, fallback: Callable[..., Any], name: str) -> Callable[..., Any] | None:
    """A builtin that does what ``ufunc`` does for one sample, and what ``fallback``, a bound method, does for all else.

    None where it cannot be made: no compiled kernel, several results or scalar ones, an interpreter of another build.
    """
    owner = owner_of(ufunc)
    if owner is None or not _understood():
        return None
    program = owner.program
    ports = (*program.inputs, *program.outputs)
    if len(program.outputs) != 1 or any(not port.shape or not port.size for port in ports):
        return None
    code = assembled(call_assembly(program.inputs, program.outputs[0]), CALL, owner.machine)
    float64 = np.dtype(np.float64)
    addresses = {
        "array_type": id(np.ndarray),
        "float64": id(float64),
        "new_array": _new_from_descriptor(),
        "vectorcall": _address("PyObject_Vectorcall"),
        "incref": _address("Py_IncRef"),
        "decref": _address("Py_DecRef"),
        "loop": owner.code["d"].address,
        "fallback": id(fallback),
    }
    context = kernel(b"".join(addresses[n].to_bytes(8, sys.byteorder) for n in POINTERS))
    definition = _MethodDefinition(name.encode(), code.address, _FASTCALL_WITH_KEYWORDS, _doc(fallback, name).encode())
    context.owner = fallback.__self__  # type: ignore[attr-defined]
    keeper = _Keeper("twistwrench.robot")
    keeper.kept = {
        "ufunc": ufunc,
        "fallback": fallback,
        "code": code,
        "float64": float64,
        "definition": definition,
    }
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.py_object]
    return make(ctypes.addressof(definition), context, keeper)


def _doc(method: Any, name: str) -> str:
    """The method's own, behind a line from which ``inspect.signature`` reads its parameters."""
    function = method.__func__
    code, defaults, named = function.__code__, function.__defaults__ or (), function.__kwdefaults__ or {}
    count, several = code.co_argcount, code.co_argcount + code.co_kwonlyargcount
    places = list(code.co_varnames[1:count])
    for k, default in enumerate(defaults):
        places[k - len(defaults)] += f"={default!r}"
    rest = [f"{p}={named[p]!r}" if p in named else p for p in code.co_varnames[count:several]]
    return f"{name}({', '.join([*places, *(['*', *rest] if rest else [])])})\n--\n\n{function.__doc__ or ''}"


def _address(name: str) -> int:
    return ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0


@cache
def _new_from_descriptor() -> int:
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.restype, get_pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    table = ctypes.cast(get_pointer(_multiarray_umath._ARRAY_API, None), ctypes.POINTER(ctypes.c_void_p))
    return table[_NEW_FROM_DESCRIPTOR] or 0


@cache
def _understood() -> bool:
    """Whether objects lie in memory as the code expects: looked at, not guessed from versions."""
    if not runs_machine_code() or sys.byteorder != "little":
        return False
    if sysconfig.get_config_var("Py_GIL_DISABLED"):  # objects have longer heads, even while the lock is switched on
        return False
    probe, contents = np.arange(6.0).reshape(2, 3), kernel(b"twistwrench")

    def word(name: str, kind: Any = ctypes.c_ssize_t) -> int:
        return int(kind.from_address(id(probe) + FIELDS[name]).value)

    dims = (ctypes.c_ssize_t * 2).from_address(word("dims"))
    return (
        word("type") == id(np.ndarray)
        and word("data") == probe.ctypes.data
        and word("nd", ctypes.c_int) == 2
        and list(dims) == [2, 3]
        and word("descr") == id(probe.dtype) == id(np.dtype(np.float64))
        and word("flags", ctypes.c_int) & 0x101 == 0x101
        and ctypes.string_at(id(contents) + BYTES_DATA, len(contents)) == contents
    )
