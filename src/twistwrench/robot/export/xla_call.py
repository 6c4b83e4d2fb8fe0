"""Kernels as in-place XLA calls on the CPU by the typed FFI."""

from __future__ import annotations

import ctypes
import itertools
import re
from collections.abc import Callable, Sequence
from ctypes import POINTER, Structure, c_char_p, c_int, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from pathlib import Path
from typing import Any

import numpy as np

from ...compiler.runtime.xla_handler import is_compiled, make_handler

_DTYPES = {11: np.float32, 12: np.float64}
"""XLA_FFI_DataType_F32 and F64."""
_EXECUTE, _METADATA, _INTERNAL = 3, 1, 13
"""XLA_FFI_ExecutionStage_EXECUTE, XLA_FFI_Extension_Metadata, XLA_FFI_Error_Code_INTERNAL."""
_HEAD = (("size", c_size_t), ("extension", c_void_p))
"""First fields of every structure."""


class _Version(Structure):
    _fields_ = (*_HEAD, ("major", c_int), ("minor", c_int))


class _Metadata(Structure):
    _fields_ = (("size", c_size_t), ("version", _Version), ("traits", c_uint32))


class _Extension(Structure):
    _fields_ = (("size", c_size_t), ("type", c_int), ("next", c_void_p), ("metadata", POINTER(_Metadata)))


class _Buffer(Structure):
    _fields_ = (*_HEAD, ("dtype", c_int32), ("data", c_void_p), ("rank", c_int64), ("dims", POINTER(c_int64)))


class _Buffers(Structure):
    _fields_ = (*_HEAD, ("count", c_int64), ("types", c_void_p), ("buffers", POINTER(POINTER(_Buffer))))


class _ErrorCreate(Structure):
    _fields_ = (*_HEAD, ("message", c_char_p), ("code", c_int))


class _Api(Structure):
    _fields_ = (*_HEAD, ("version", _Version), ("internal", c_void_p), ("error_create", c_void_p))


class _CallFrame(Structure):
    _fields_ = (
        *_HEAD, ("api", POINTER(_Api)), ("context", c_void_p), ("stage", c_int), ("args", _Buffers), ("rets", _Buffers),
    )  # fmt: skip


_HANDLER = ctypes.CFUNCTYPE(c_void_p, POINTER(_CallFrame))
_CREATE = ctypes.CFUNCTYPE(c_void_p, POINTER(_ErrorCreate))
_numbers = itertools.count()
_targets: dict[tuple[int, str, bool], tuple[str, Any, Any]] = {}
"""Targets with kernels and handlers, by kernel id, type and scalar flag.

They are never freed, because XLA keeps their addresses.
"""


def xla_target(jax: Any, name: str, kernel: Callable[..., Any], count: int, char: str, *, scalar: bool) -> str:
    """Register ``kernel(*inputs, out=results)`` with ``count`` inputs as a target of ``jax.ffi.ffi_call``; returns its name.

    ``char`` is the letter of the type; ``scalar`` is true for single samples.
    """
    key = id(kernel), char, scalar
    if key not in _targets:
        version = _version(jax)
        if is_compiled(kernel):
            handler: Any = make_handler(kernel, char, version, scalar=scalar)
            capsule = jax.ffi.pycapsule(ctypes.c_void_p(handler.address))
        else:
            handler = _callback(name, kernel, count, version)
            capsule = jax.ffi.pycapsule(handler)
        target = f"twistwrench_{name}_{next(_numbers)}"
        jax.ffi.register_ffi_target(target, capsule, platform="cpu")
        _targets[key] = target, kernel, handler
    return _targets[key][0]


def _callback(name: str, kernel: Callable[..., Any], count: int, version: tuple[int, int]) -> Any:
    def run(pointer: Any) -> int | None:
        frame = pointer.contents
        try:
            query = _Extension.from_address(frame.extension) if frame.extension else None
            if query is not None and query.type == _METADATA:  # XLA queries the version only
                answer = query.metadata.contents.version
                answer.major, answer.minor = version
            elif frame.stage == _EXECUTE:
                kernel(*_arrays(frame.args)[:count], out=tuple(_arrays(frame.rets)))
        except Exception as error:  # exceptions must not propagate through C
            failure = _ErrorCreate(ctypes.sizeof(_ErrorCreate), message=f"{name}: {error}".encode(), code=_INTERNAL)
            address: int | None = _CREATE(frame.api.contents.error_create)(ctypes.byref(failure))
            return address
        return None

    return _HANDLER(run)


def _version(jax: Any) -> tuple[int, int]:
    """Version of the FFI interface in the header of the installed JAX."""
    header = Path(jax.ffi.include_dir(), "xla", "ffi", "api", "c_api.h").read_text(encoding="utf-8")
    major, minor = (re.search(rf"#define XLA_FFI_API_{part} (\d+)", header) for part in ("MAJOR", "MINOR"))
    return (int(major[1]), int(minor[1])) if major and minor else (0, 1)


def _arrays(buffers: Any) -> Sequence[Any]:
    return [_array(buffers.buffers[k].contents) for k in range(buffers.count)]


def _array(buffer: Any) -> Any:
    shape = tuple(buffer.dims[: buffer.rank])
    dtype: Any = np.dtype(_DTYPES[buffer.dtype])
    size = int(np.prod(shape)) * dtype.itemsize
    if not size:
        return np.empty(shape, dtype)
    memory: Any = (ctypes.c_char * size).from_address(buffer.data)
    return np.frombuffer(memory, dtype).reshape(shape)
