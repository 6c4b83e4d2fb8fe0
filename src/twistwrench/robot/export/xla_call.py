"""Kernels as in-place XLA calls on the CPU by the typed FFI (foreign function interface).

The structures repeat those of XLA's header ``c_api.h``.
"""

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
"""Types by XLA_FFI_DataType: F32 and F64."""
_EXECUTE_STAGE = 3
"""XLA_FFI_ExecutionStage_EXECUTE."""
_METADATA_EXTENSION = 1
"""XLA_FFI_Extension_Metadata."""
_INTERNAL_ERROR = 13
"""XLA_FFI_Error_Code_INTERNAL."""
_FIRST_FIELDS = (("size", c_size_t), ("extension", c_void_p))
"""First fields of most structures."""


class _Version(Structure):
    _fields_ = (*_FIRST_FIELDS, ("major", c_int), ("minor", c_int))


class _Metadata(Structure):
    _fields_ = (("size", c_size_t), ("version", _Version), ("traits", c_uint32))


class _Extension(Structure):
    _fields_ = (("size", c_size_t), ("type", c_int), ("next", c_void_p), ("metadata", POINTER(_Metadata)))


class _Buffer(Structure):
    _fields_ = (*_FIRST_FIELDS, ("dtype", c_int32), ("data", c_void_p), ("rank", c_int64), ("dims", POINTER(c_int64)))


class _Buffers(Structure):
    _fields_ = (*_FIRST_FIELDS, ("count", c_int64), ("types", c_void_p), ("buffers", POINTER(POINTER(_Buffer))))


class _ErrorCreate(Structure):
    _fields_ = (*_FIRST_FIELDS, ("message", c_char_p), ("code", c_int))


class _Api(Structure):
    _fields_ = (*_FIRST_FIELDS, ("version", _Version), ("internal", c_void_p), ("error_create", c_void_p))


class _CallFrame(Structure):
    _fields_ = (
        *_FIRST_FIELDS, ("api", POINTER(_Api)), ("context", c_void_p), ("stage", c_int), ("args", _Buffers), ("rets", _Buffers),
    )  # fmt: skip


_HANDLER = ctypes.CFUNCTYPE(c_void_p, POINTER(_CallFrame))
"""C type of a handler: call frame → address of an error, or None."""
_ERROR_FUNCTION = ctypes.CFUNCTYPE(c_void_p, POINTER(_ErrorCreate))
"""C type of XLA's function that makes an error."""
_target_numbers = itertools.count()
"""Numbers that distinguish the names of targets."""
_targets: dict[tuple[int, str, bool], tuple[str, Any, Any]] = {}
"""Names of targets with their kernels and handlers, by kernel id, type and scalar flag.

They are never freed, because XLA keeps their addresses.
"""


def xla_target(jax: Any, name: str, kernel: Callable[..., Any], count: int, char: str, *, scalar: bool) -> str:
    """Register ``kernel(*inputs, out=results)`` with ``count`` inputs as a target of ``jax.ffi.ffi_call``; returns its name.

    ``char`` is the character of the number type; ``scalar`` is true for single samples.
    """
    key = (id(kernel), char, scalar)
    if key not in _targets:
        version = _interface_version(jax)
        if is_compiled(kernel):
            handler: Any = make_handler(kernel, char, version, scalar=scalar)
            capsule = jax.ffi.pycapsule(ctypes.c_void_p(handler.address))
        else:
            handler = _python_handler(name, kernel, count, version)
            capsule = jax.ffi.pycapsule(handler)
        target = f"twistwrench_{name}_{next(_target_numbers)}"
        jax.ffi.register_ffi_target(target, capsule, platform="cpu")
        _targets[key] = (target, kernel, handler)
    target, _, _ = _targets[key]
    return target


def _python_handler(name: str, kernel: Callable[..., Any], count: int, version: tuple[int, int]) -> Any:
    """Handler that calls a kernel of Python with ``count`` inputs."""

    def handle(frame_pointer: Any) -> int | None:
        """Answer a query of the version, or run the kernel; the address of an error, or None."""
        frame = frame_pointer.contents
        try:
            extension = _Extension.from_address(frame.extension) if frame.extension else None
            if extension is not None and extension.type == _METADATA_EXTENSION:  # XLA queries the version only
                metadata = extension.metadata.contents
                major, minor = version
                metadata.version.major = major
                metadata.version.minor = minor
            elif frame.stage == _EXECUTE_STAGE:
                inputs = _arrays(frame.args)[:count]
                kernel(*inputs, out=tuple(_arrays(frame.rets)))
        except Exception as error:  # exceptions must not propagate through C
            message = f"{name}: {error}".encode()
            error_arguments = _ErrorCreate(ctypes.sizeof(_ErrorCreate), message=message, code=_INTERNAL_ERROR)
            make_error = _ERROR_FUNCTION(frame.api.contents.error_create)
            error_address: int | None = make_error(ctypes.byref(error_arguments))
            return error_address
        return None

    return _HANDLER(handle)


def _interface_version(jax: Any) -> tuple[int, int]:
    """Version of the FFI in the header of the installed JAX; 0.1 if the header does not state it."""
    header = Path(jax.ffi.include_dir(), "xla", "ffi", "api", "c_api.h").read_text(encoding="utf-8")
    major_match = re.search(r"#define XLA_FFI_API_MAJOR (\d+)", header)
    minor_match = re.search(r"#define XLA_FFI_API_MINOR (\d+)", header)
    if major_match is None or minor_match is None:
        return 0, 1
    return int(major_match[1]), int(minor_match[1])


def _arrays(buffers: Any) -> Sequence[Any]:
    """Arrays on the memory of XLA's buffers, without copies."""
    return [_array(buffers.buffers[k].contents) for k in range(buffers.count)]


def _array(buffer: Any) -> Any:
    """Array on the memory of a buffer, without a copy."""
    shape = tuple(buffer.dims[: buffer.rank])
    dtype: Any = np.dtype(_DTYPES[buffer.dtype])
    size = int(np.prod(shape)) * dtype.itemsize
    if not size:
        return np.empty(shape, dtype)
    memory: Any = (ctypes.c_char * size).from_address(buffer.data)
    return np.frombuffer(memory, dtype).reshape(shape)
