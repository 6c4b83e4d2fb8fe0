"""Handlers of XLA's typed foreign functions that run a kernel's loop without entering Python, as LLVM assembly.

XLA calls ``handler(frame)`` with a structure of ``xla/ffi/api/c_api.h``; the handler reads the number of samples from the shape
of one array, stores the arrays' pointers in a table, and runs the loop. The code contains shapes but no addresses, so it can be
cached: the exported function, ``install(loop)``, stores the loop's address and returns the handler's.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..ir.program import TensorSpec
from ..lowering.target_machine import DOUBLE, SINGLE, Precision
from .dispatch_ir import loop_steps
from .gufunc import owner_of
from .jit import assembled

INSTALL = "install"
"""Name of the function that stores the loop's address and returns the handler's."""

EXTENSION, STAGE, ARGUMENTS, RESULTS = 8, 32, 72, 112
"""Offsets in the call's frame: extension, stage, and tables of pointers to buffers."""

DATA, RANK, DIMENSIONS = 24, 32, 40
"""Offsets in a buffer."""

TYPE, METADATA, MAJOR, MINOR = 8, 24, 24, 28
"""Offsets in an extension: its type and its pointer to metadata; in these, the handler's version of the interface."""

IS_METADATA, EXECUTE = 1, 3
"""XLA_FFI_Extension_Metadata, XLA_FFI_ExecutionStage_EXECUTE."""


def handler_assembly(
    inputs: Sequence[TensorSpec], outputs: Sequence[TensorSpec], precision: Precision, version: tuple[int, int]
) -> str:
    """Module for contiguous arrays of these shapes behind one batch shape; some array must have entries."""
    ports = (*inputs, *outputs)
    tables = [(ARGUMENTS, k) for k in range(len(inputs))] + [(RESULTS, k) for k in range(len(outputs))]
    counted = next(k for k, port in enumerate(ports) if port.size)
    steps = ", ".join(f"i64 {n}" for n in loop_steps(ports, precision))
    lines = []
    for k, (table, place) in enumerate(tables):
        lines += [
            *_loaded(f"table{k}", "ptr", "%frame", table),
            *_loaded(f"buffer{k}", "ptr", f"%table{k}", 8 * place),
            *_loaded(f"data{k}", "ptr", f"%buffer{k}", DATA),
            f"  %slot{k} = getelementptr ptr, ptr %arrays, i64 {k}",
            f"  store ptr %data{k}, ptr %slot{k}",
        ]
    return "\n".join(
        [
            "@loop = internal global ptr null",
            f"@steps = internal constant [{steps.count('i64')} x i64] [{steps}]",
            "define ptr @handler(ptr %frame) {",
            "entry:",
            f"  %arrays = alloca [{len(ports)} x ptr]",
            "  %samples = alloca i64",
            *_loaded("extension", "ptr", "%frame", EXTENSION),
            "  %call = icmp eq ptr %extension, null",
            "  br i1 %call, label %staged, label %asked",
            "asked:",
            *_loaded("type", "i32", "%extension", TYPE),
            f"  %metadata = icmp eq i32 %type, {IS_METADATA}",
            "  br i1 %metadata, label %answer, label %staged",
            "answer:",
            *_loaded("about", "ptr", "%extension", METADATA),
            f"  %major = getelementptr i8, ptr %about, i64 {MAJOR}",
            f"  store i32 {version[0]}, ptr %major",
            f"  %minor = getelementptr i8, ptr %about, i64 {MINOR}",
            f"  store i32 {version[1]}, ptr %minor",
            "  ret ptr null",
            "staged:",
            *_loaded("stage", "i32", "%frame", STAGE),
            f"  %now = icmp eq i32 %stage, {EXECUTE}",
            "  br i1 %now, label %run, label %done",
            "run:",
            *lines,
            *_loaded("rank", "i64", f"%buffer{counted}", RANK),
            *_loaded("dims", "ptr", f"%buffer{counted}", DIMENSIONS),
            f"  %last = sub i64 %rank, {len(ports[counted].shape)}",
            "  br label %count",
            "count:",
            "  %axis = phi i64 [ 0, %run ], [ %next, %more ]",
            "  %n = phi i64 [ 1, %run ], [ %product, %more ]",
            "  %left = icmp slt i64 %axis, %last",
            "  br i1 %left, label %more, label %counted",
            "more:",
            "  %place = getelementptr i64, ptr %dims, i64 %axis",
            "  %length = load i64, ptr %place",
            "  %product = mul i64 %n, %length",
            "  %next = add i64 %axis, 1",
            "  br label %count",
            "counted:",
            "  store i64 %n, ptr %samples",
            "  %f = load ptr, ptr @loop",
            "  call void %f(ptr %arrays, ptr %samples, ptr @steps, ptr null)",
            "  br label %done",
            "done:",
            "  ret ptr null",
            "}",
            f"define ptr @{INSTALL}(ptr %address) {{",
            "  store ptr %address, ptr @loop",
            "  ret ptr @handler",
            "}\n",
        ]
    )


def _loaded(name: str, kind: str, base: str, offset: int) -> list[str]:
    """Load ``name`` from ``offset`` bytes behind ``base``."""
    return [f"  %at.{name} = getelementptr i8, ptr {base}, i64 {offset}", f"  %{name} = load {kind}, ptr %at.{name}"]


# ── The compiled loop of a kernel as a handler of XLA's foreign functions: a call of it enters no Python

_INSTALLED = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)


@dataclass(frozen=True)
class XlaHandler:
    """A function in memory, and the objects that must live as long."""

    address: int
    keep: tuple[Any, ...]


def is_compiled(kernel: Any) -> bool:
    """True if a kernel has machine code and results."""
    owner = owner_of(kernel)
    return owner is not None and any(port.size for port in owner.given.outputs)


def make_handler(kernel: Any, char: str, version: tuple[int, int], *, scalar: bool) -> XlaHandler:
    """Handler of a compiled kernel for arrays of type ``char``, for one sample (``scalar``) or for any number."""
    owner = owner_of(kernel)
    if owner is None:
        raise TypeError("kernel: a compiled one is wanted; is_compiled says which are")
    precision = SINGLE if char == SINGLE.char else DOUBLE
    loop = owner.scalar_code(precision).address if scalar else owner.address(precision)
    code = assembled(
        handler_assembly(owner.given.inputs, owner.given.outputs, precision, version), INSTALL, owner.machine
    )
    address = _INSTALLED(code.address)(loop)
    return XlaHandler(address, (code, kernel))
