"""Prepared calls of a kernel's loop, row by row, as a C function of the METH_FASTCALL kind.

``call(number, array)`` copies the array to an operand of row ``number`` in a table of addresses, runs the loop on that row, and
returns one number of the results as a float; ``call(number)`` uses the operand as it is. For an array that is not plain it
returns None without effect. The code contains sizes but no addresses: those are in ``self``, a bytes object, in the order of
:data:`POINTERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import KernelError
from ..ir.program import TensorSpec, axes_of
from ..lowering.target_machine import DOUBLE, Machine
from ..typing import Array
from .dispatch import FASTCALL, address_of, builtin, table_of
from .dispatch_ir import BuiltinWriter, abi_matches
from .gufunc import owner_of
from .jit import Code, assembled

CALL = "call"
"""Name of the function."""

POINTERS = ("none", "array_type", "descriptor", "as_number", "new_float", "incref", "loop", "table", "sizes", "strides")
"""Addresses in the bytes object, 8 bytes each."""


def call_assembly(operands: int, size: int, taken: int, told: int) -> str:
    """Module for a loop: the array has ``size`` doubles and is copied to operand ``taken``.

    The float is the first double of operand ``told``.
    """
    call = BuiltinWriter(DOUBLE, POINTERS)
    w = call.w
    number = w.new(f"call i64 {call.known('as_number')}(ptr {call.at('%args', 0)})")
    row = w.at(call.known("table"), w.new(f"mul i64 {number}, {8 * operands}"))
    call.fork("icmp eq i64 %count, 1", "run", "copy")
    call.begin("copy")
    source = call.array(call.at("%args", 1), TensorSpec("x", (size,)))
    target = call.at(row, taken)
    w.do(f"call void @llvm.memcpy.p0.p0.i64(ptr align 8 {target}, ptr align 8 {source}, i64 {8 * size}, i1 false)")
    w.do("br label %run")
    call.begin("run")
    w.do(f"call void {call.known('loop')}(ptr {row}, ptr {call.known('sizes')}, ptr {call.known('strides')}, ptr null)")
    new_float = call.known("new_float")
    value = w.new(f"load double, ptr {call.at(row, told)}, align 8")
    w.do(f"ret ptr {w.new(f'call ptr {new_float}(double {value})')}")
    call.begin("slow")
    none = call.known("none")
    w.do(f"call void {call.known('incref')}(ptr {none})")
    w.do(f"ret ptr {none}")
    declared = "declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1 immarg)"
    return "\n".join([declared, f"define ptr @{CALL}(ptr %self, ptr %args, i64 %count) {{\nentry:", *w.lines, "}\n"])


# ── Calls of one loop on one row after the other, prepared: NumPy's way into a ufunc takes longer than short loops run

Rows = tuple[Array, NDArray[np.intp]]
"""An array (m, ...) of an operand's rows, and the number of the row for each call, (n,)."""


@cache
def _code(operands: int, size: int, taken: int, told: int, machine: Machine) -> Code:
    return assembled(call_assembly(operands, size, taken, told), CALL, machine)


def can_bind_calls(kernel: Any) -> bool:
    """True if calls row by row can be prepared: for a compiled kernel, in CPython with its lock."""
    return owner_of(kernel) is not None and abi_matches()


def bind_calls(kernel: Any, operands: Sequence[Rows], taken: int, told: int) -> Callable[..., Any]:
    """A function that makes one of n calls of a kernel, each on a row of every operand; of a scan, each of one step.

    ``call(k, x)`` makes call number k after x was copied to its row of operand number ``taken``, and returns the first
    number of operand ``told``; ``call(k)`` uses the row as it is. It returns None without effect if x is not a plain
    array of float64 of that size. k is not checked.
    """
    owner = owner_of(kernel)
    if owner is None or not abi_matches():
        raise KernelError("calls row by row are prepared for compiled kernels only.")
    sizes: dict[int, int] = {0: 1}
    strides: list[int] = [0] * len(operands)
    ports = (*owner.given.inputs, *owner.given.outputs)
    for port, axes, (array, _) in zip(ports, axes_of(owner.given.signature), operands, strict=True):
        if array.shape[1:] != port.shape or array.dtype != np.float64:
            raise KernelError(f"{port.name}: rows {array.shape[1:]} of {array.dtype}, and not {port.shape} of float64.")
        further = len(axes) - len(port.shape)  # steps and rows kept of a recurrence: one of each
        sizes |= dict(zip(axes, (1,) * further + port.shape, strict=True))
        strides += [0] * further + list(array.strides[1:])
    first = np.array([array.ctypes.data for array, _ in operands], np.intp)
    apart = np.array([array.strides[0] for array, _ in operands], np.intp)
    numbers = np.stack([which for _, which in operands], axis=1)
    tables = {
        "table": np.ascontiguousarray(first + numbers * apart),
        "sizes": np.array([sizes[k] for k in range(len(sizes))], np.intp),
        "strides": np.array(strides, np.intp),
    }
    code = _code(len(operands), ports[taken].size, taken, told, owner.machine)
    dtype = np.dtype(float)
    addresses = {
        "none": id(None),
        "array_type": id(np.ndarray),
        "descriptor": id(dtype),
        "as_number": address_of("PyLong_AsSsize_t"),
        "new_float": address_of("PyFloat_FromDouble"),
        "incref": address_of("Py_IncRef"),
        "loop": owner.code[DOUBLE.char].address,
        **{name: table.ctypes.data for name, table in tables.items()},
    }
    kept = {"kernel": kernel, "operands": tuple(operands), "tables": tables, "dtype": dtype}
    context = table_of([addresses[name] for name in POINTERS])
    found: Callable[..., Any] = builtin(CALL, "A prepared call.", code, FASTCALL, context, kept)
    return found
