"""One way of calling a kernel's method from Python, and where Python and NumPy keep what a call reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..ir.program import TensorSpec
from ..lowering.target_machine import Precision

POINTERS = (
    "array_type", "list_type", "tuple_type", "dict_type", "float_type", "double_type", "none", "descriptor", "new_array",
    "new_scalar", "new_tuple", "dict_size", "dict_item", "vectorcall", "incref", "decref", "loop", "fallback",
)  # fmt: skip
"""What the bytes object holds first: addresses, 8 bytes each; that of the slower callable is where its own address stands."""

FIELDS = {"type": 8, "data": 16, "nd": 24, "dims": 32, "descr": 56, "flags": 64}
"""Offsets in NumPy's array object, as its C API has published them, on 64-bit CPython with its lock."""

BYTES_DATA, SIZE, LIST_ITEMS, TUPLE_ITEMS = 32, 16, 24, tuple.__basicsize__
"""Offsets of the contents of a bytes object, of the size of a list or tuple, and of their items."""


@dataclass(frozen=True)
class Way:
    """One way of calling a method: all that the code knows of it."""

    inputs: tuple[TensorSpec, ...]
    """The first parameters."""
    mapped: tuple[TensorSpec, ...]
    """Arrays that come in a dict; the keys are the last pointers."""
    outputs: tuple[TensorSpec, ...]
    precision: Precision
    parameters: int
    """How many there are; their names are the pointers after :data:`POINTERS`."""
    positional: int
    """How many of them may be given without a name."""
    options: tuple[tuple[int, bool], ...]
    """Parameters that must be a certain object, the next pointers; and whether they may be left out."""
    mapping: int = -1
    """The parameter that is a dict, if one is."""
    negative: bool = False
    """Whether what it holds counts with the other sign."""
    out: int = -1
    """The parameter for the results, if there is one."""
    batch: int = 0
    """How many of the first axes of every array, all of length 1, the loop knows nothing of."""


def loop_steps(ports: Sequence[TensorSpec], precision: Precision, batch: int = 0) -> list[int]:
    """The distances of contiguous rows in bytes, as a loop wants them; of the first ``batch`` axes it knows nothing."""
    inner: list[int] = []
    for port in ports:
        size, strides = precision.bytes, []
        for n in reversed(port.shape[batch:]):
            strides.append(size)
            size *= n
        inner += strides[::-1]
    return [port.size * precision.bytes for port in ports] + inner
