"""Calls of one loop on one row after the other, prepared: NumPy's way into a ufunc takes longer than short loops run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import KernelError
from ..program.port import axes_of
from ..targets.processor import DOUBLE, Machine
from ..targets.row_call_text import CALL, POINTERS, row_call_assembly
from ..typing import Array
from .builtins import FASTCALL, MethodDefinition, address_of, builtin
from .fast_call import understood
from .jit import Code, assembled
from .ufunc import owner_of

Rows = tuple[Array, NDArray[np.intp]]
"""An array (m, ...) of an operand's rows, and which of them each call takes, (n,)."""


@cache
def _code(operands: int, size: int, taken: int, told: int, machine: Machine) -> Code:
    return assembled(row_call_assembly(operands, size, taken, told), CALL, machine)


class _Kept(str):
    """What keeps alive all that the builtin points to, in the place of the name of its module."""

    things: tuple[Any, ...]


def calls_rows(kernel: Any) -> bool:
    """Whether calls row by row can be prepared: of a compiled kernel, by CPython with its lock."""
    return owner_of(kernel) is not None and understood()


def row_calls(kernel: Any, operands: Sequence[Rows], taken: int, told: int) -> Callable[..., Any]:
    """A function that makes one of n calls of a kernel, each on a row of every operand; of a recurrence, each of one step.

    ``call(k, x)`` makes call number k, once x is written where operand number ``taken`` has its row, and gives the first
    number of operand ``told``; ``call(k)`` takes what is there. It gives None, and does nothing, where x is not a plain
    array of float64 of that size. Nothing looks at k.
    """
    owner = owner_of(kernel)
    if owner is None or not understood():
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
    context = b"".join(addresses[name].to_bytes(8, sys.byteorder) for name in POINTERS)
    definition = MethodDefinition(CALL.encode(), code.address, FASTCALL, b"A call of a prepared row.")
    keeper = _Kept(CALL)
    keeper.things = kernel, tuple(operands), tables, code, dtype, definition
    found: Callable[..., Any] = builtin(definition, context, keeper)
    return found
