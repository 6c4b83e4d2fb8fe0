"""Handlers of XLA's typed foreign function interface that run a kernel's loop without Python, as LLVM assembly.

XLA calls ``handler(frame)`` with a structure of ``xla/ffi/api/c_api.h``, the call frame. The handler takes the number of
samples from the shape of one array, stores the arrays' pointers in a table, and runs the loop. The code contains shapes but no
addresses, so it can be cached. The exported function ``install(loop)`` stores the loop's address and returns the handler's.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..ir.program import TensorSpec
from ..lowering.ir_builder import LlvmWriter, typed_list
from ..lowering.target_machine import DOUBLE, SINGLE, Precision
from .dispatch_ir import loop_steps
from .gufunc import owner_of
from .jit import assemble

INSTALL = "install"
"""Name of the function that stores the loop's address and returns the handler's address."""

# Offsets in the call frame [bytes].
EXTENSION = 8
STAGE = 32
ARGUMENTS = 72  # table of pointers to the buffers of arguments
RESULTS = 112  # table of pointers to the buffers of results

# Offsets in a buffer [bytes].
DATA = 24  # pointer to the elements
RANK = 32  # number of axes
DIMENSIONS = 40  # pointer to the lengths of the axes

# Offsets in an extension [bytes].
TYPE = 8
METADATA = 24  # pointer to metadata

# Offsets in metadata [bytes]: version of the interface for which the handler is written.
MAJOR_VERSION = 24
MINOR_VERSION = 28

_POINTER_BYTES = 8
"""Size of a pointer."""
_LENGTH_BYTES = 8
"""Size of a length of an axis, an i64."""

IS_METADATA = 1
"""Type of an extension that requests metadata in place of a call: XLA_FFI_Extension_Metadata."""
EXECUTE = 3
"""Stage of a call in which results are computed: XLA_FFI_ExecutionStage_EXECUTE."""


def handler_assembly(
    inputs: Sequence[TensorSpec], outputs: Sequence[TensorSpec], precision: Precision, version: tuple[int, int]
) -> str:
    """Module for contiguous arrays of these shapes after a common batch shape; at least one array must have elements."""
    w = LlvmWriter(precision, lanes=1)
    specs = (*inputs, *outputs)

    def load(base: str, offset: int, llvm_type: str = "ptr") -> str:
        """Field of a structure at an offset [bytes]."""
        address = w.gep(base, offset)
        return w.new(f"load {llvm_type}, ptr {address}")

    arrays = w.new(f"alloca [{len(specs)} x ptr]")
    samples = w.new("alloca i64")
    extension = load("%frame", EXTENSION)
    has_no_extension = w.new(f"icmp eq ptr {extension}, null")
    w.do(f"br i1 {has_no_extension}, label %call, label %query")
    w.begin("query")
    extension_type = load(extension, TYPE, "i32")
    requests_metadata = w.new(f"icmp eq i32 {extension_type}, {IS_METADATA}")
    w.do(f"br i1 {requests_metadata}, label %answer, label %call")
    w.begin("answer")
    metadata = load(extension, METADATA)
    for offset, number in zip((MAJOR_VERSION, MINOR_VERSION), version, strict=True):
        w.do(f"store i32 {number}, ptr {w.gep(metadata, offset)}")
    w.do("ret ptr null")  # no error
    w.begin("call")
    stage = load("%frame", STAGE, "i32")
    is_execution = w.new(f"icmp eq i32 {stage}, {EXECUTE}")
    w.do(f"br i1 {is_execution}, label %run, label %done")
    w.begin("run")
    buffers = []  # of the arguments, then of the results
    for table_offset, port_count in ((ARGUMENTS, len(inputs)), (RESULTS, len(outputs))):
        for k in range(port_count):
            table = load("%frame", table_offset)
            buffers.append(load(table, _POINTER_BYTES * k))
    for number, buffer in enumerate(buffers):
        elements = load(buffer, DATA)
        w.do(f"store ptr {elements}, ptr {w.gep(arrays, _POINTER_BYTES * number)}")
    # The number of samples is the product of the lengths of the batch axes of the first array with elements.
    first_with_elements = next(k for k, spec in enumerate(specs) if spec.size)
    buffer = buffers[first_with_elements]
    core_rank = len(specs[first_with_elements].shape)
    rank = load(buffer, RANK, "i64")
    lengths = load(buffer, DIMENSIONS)
    w.do(f"store i64 1, ptr {samples}")
    batch_axes = w.new(f"sub i64 {rank}, {core_rank}")
    with w.loop(batch_axes, "run") as axis:
        byte_offset = w.new(f"mul i64 {axis}, {_LENGTH_BYTES}")
        length = load(w.gep(lengths, byte_offset), 0, "i64")
        product_so_far = load(samples, 0, "i64")
        product = w.new(f"mul i64 {product_so_far}, {length}")
        w.do(f"store i64 {product}, ptr {samples}")
    loop = w.new("load ptr, ptr @loop")
    w.do(f"call void {loop}(ptr {arrays}, ptr {samples}, ptr @steps, ptr null)")
    w.do("br label %done")
    w.begin("done")
    return _module_text(w.lines, loop_steps(specs, precision))


def _module_text(handler_lines: Sequence[str], steps: Sequence[int]) -> str:
    """Module of a handler with this body, and of the function that stores the address of its loop."""
    return "\n".join(
        [
            "@loop = internal global ptr null",
            f"@steps = internal constant [{len(steps)} x i64] [{typed_list('i64', steps)}]",
            "define ptr @handler(ptr %frame) {\nentry:",
            *handler_lines,
            f"  ret ptr null\n}}\ndefine ptr @{INSTALL}(ptr %address) {{",
            "  store ptr %address, ptr @loop\n  ret ptr @handler\n}\n",
        ]
    )


# ── A kernel's compiled loop as a handler of XLA's foreign functions, without Python in the call

_INSTALL_TYPE = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
"""C type of the function ``install``."""


@dataclass(frozen=True)
class XlaHandler:
    """Handler in memory."""

    address: int
    """Address that XLA calls."""
    keep: tuple[Any, ...]
    """Objects that must live as long as the handler is used."""


def is_compiled(kernel: Any) -> bool:
    """True if a kernel is machine code and has results with entries."""
    owner = owner_of(kernel)
    return owner is not None and any(port.size for port in owner.given.outputs)


def make_handler(kernel: Any, char: str, version: tuple[int, int], *, scalar: bool) -> XlaHandler:
    """Handler of a compiled kernel for arrays of type ``char``, NumPy's letter; for one sample (``scalar``) or any number."""
    owner = owner_of(kernel)
    if owner is None:
        raise TypeError("kernel must be compiled (see its is_compiled)")
    precision = SINGLE if char == SINGLE.char else DOUBLE
    if scalar:
        loop = owner.scalar_code(precision).address
    else:
        loop = owner.address(precision)
    assembly = handler_assembly(owner.given.inputs, owner.given.outputs, precision, version)
    code = assemble(assembly, INSTALL, owner.machine)
    install = _INSTALL_TYPE(code.address)
    return XlaHandler(install(loop), keep=(code, kernel))
