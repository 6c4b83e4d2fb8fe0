"""Calls of one loop on one row after the other, prepared: NumPy's way into a ufunc takes longer than short loops run."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import KernelError
from ..program.program import axes_of
from ..targets.processor import DOUBLE
from ..typing import Array
from .ufunc import owner_of

_LOOP = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 4)
"""Of a loop that is called with Python's lock held: it is over before another thread could make use of it."""

Rows = tuple[Array, NDArray[np.intp]]
"""An array (m, ...) of an operand's rows, and which of them each call takes, (n,)."""


class RowCalls:
    """n calls of a compiled kernel, each on a row of every operand; of a recurrence, each of one step.

    Call number k is ``function(places[k], sizes, strides, None)``.
    """

    def __init__(self, kernel: Any, operands: Sequence[Rows]) -> None:
        owner = owner_of(kernel)
        if owner is None:
            raise KernelError("calls row by row are prepared for compiled kernels only.")
        sizes: dict[int, int] = {0: 1}
        strides: list[int] = [0] * len(operands)
        ports = (*owner.given.inputs, *owner.given.outputs)
        signature = owner.given.signature
        for port, axes, (array, _) in zip(ports, axes_of(signature), operands, strict=True):
            if array.shape[1:] != port.shape or array.dtype != np.float64:
                raise KernelError(
                    f"{port.name}: rows {array.shape[1:]} of {array.dtype}, and not {port.shape} of float64."
                )
            further = len(axes) - len(port.shape)  # steps and rows kept of a recurrence: one of each
            sizes |= dict(zip(axes, (1,) * further + port.shape, strict=True))
            strides += [0] * further + list(array.strides[1:])
        first = np.array([array.ctypes.data for array, _ in operands], np.uintp)
        apart = np.array([array.strides[0] for array, _ in operands])
        numbers = np.stack([which for _, which in operands], axis=1)
        tables = (
            np.ascontiguousarray(first + (numbers * apart).astype(np.uintp)),
            np.array([sizes[k] for k in range(len(sizes))], np.intp),
            np.array(strides, np.intp),
        )
        self._kept = kernel, operands, tables
        self.function: Any = _LOOP(owner.code[DOUBLE.char].address)
        table, self.sizes, self.strides = (x.ctypes.data for x in tables)
        self.places = range(table, table + tables[0].nbytes, tables[0].strides[0])
