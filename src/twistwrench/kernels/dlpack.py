"""DLPack, version 0: the capsule in which libraries hand each other arrays without copies."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

CPU, CUDA, CUDA_MANAGED = 1, 2, 13
"""Kinds of device."""

_FLOAT = 2
_NAME, _USED = b"dltensor", b"used_dltensor"


class _Tensor(ctypes.Structure):
    """DLManagedTensor."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("device_type", ctypes.c_int32),
        ("device_id", ctypes.c_int32),
        ("ndim", ctypes.c_int32),
        ("code", ctypes.c_uint8),
        ("bits", ctypes.c_uint8),
        ("lanes", ctypes.c_uint16),
        ("shape", ctypes.POINTER(ctypes.c_int64)),
        ("strides", ctypes.POINTER(ctypes.c_int64)),
        ("byte_offset", ctypes.c_uint64),
        ("manager", ctypes.c_void_p),
        ("deleter", ctypes.c_void_p),
    )


_DELETER = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_DESTRUCTOR = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


def _python(name: str, result: Any, *arguments: Any) -> Callable[..., Any]:
    """A function of CPython's, with a prototype of its own."""
    return ctypes.PYFUNCTYPE(result, *arguments)((name, ctypes.pythonapi))


_pointer = _python("PyCapsule_GetPointer", ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)
_rename = _python("PyCapsule_SetName", ctypes.c_int, ctypes.py_object, ctypes.c_char_p)
_new = _python("PyCapsule_New", ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
# Of a capsule that is going: nothing may count a reference to it.
_is_unused = _python("PyCapsule_IsValid", ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p)
_pointer_of_going = _python("PyCapsule_GetPointer", ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)


class Borrowed:
    """What a capsule holds, taken out of it; its owner gets it back when this object goes. Strides in elements."""

    def __init__(self, given: Any) -> None:
        address = _pointer(given, _NAME)
        _rename(given, _USED)
        tensor = _Tensor.from_address(address)
        if tensor.deleter:
            weakref.finalize(self, _DELETER(tensor.deleter), address).atexit = False
        axes = range(tensor.ndim)
        self.address = (tensor.data or 0) + tensor.byte_offset
        self.shape = tuple(tensor.shape[k] for k in axes)
        self.strides = tuple(tensor.strides[k] for k in axes) if tensor.strides else None
        real = tensor.code == _FLOAT and tensor.lanes == 1 and tensor.bits in (16, 32, 64)
        self.dtype = np.dtype(f"f{tensor.bits // 8}") if real else None
        """None where its elements are no floating-point numbers that NumPy has."""


_LENT: dict[int, Any] = {}
"""What tensors handed out are made of, until whoever took one is done with it."""


def capsule(
    address: int, device: int, shape: tuple[int, ...], strides: tuple[int, ...], dtype: np.dtype[Any], keep: Any
) -> Any:
    """A capsule with an array of floating-point numbers in a GPU's memory; ``keep`` lives until nobody needs it."""
    axes = ctypes.c_int64 * max(len(shape), 1)
    lengths, distances = axes(*shape), axes(*strides)
    bits = 8 * dtype.itemsize
    tensor = _Tensor(address, CUDA, device, len(shape), _FLOAT, bits, 1, lengths, distances, 0, None)
    tensor.deleter = ctypes.cast(_give_back, ctypes.c_void_p)
    place = ctypes.addressof(tensor)
    _LENT[place] = (keep, tensor, lengths, distances)
    return _new(place, _NAME, ctypes.cast(_drop_capsule, ctypes.c_void_p))


def _forget(place: int) -> None:
    _LENT.pop(place, None)


def _forget_capsule(going: int) -> None:
    """Of a capsule that nobody took anything out of."""
    if _is_unused(going, _NAME):
        _forget(_pointer_of_going(going, _NAME))


_give_back, _drop_capsule = _DELETER(_forget), _DESTRUCTOR(_forget_capsule)
