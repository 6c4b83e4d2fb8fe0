"""A call with many samples: room for its results, and parts that several threads can take where that pays."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..targets.processor import SINGLE
from ..typing import Array
from .results import room

if TYPE_CHECKING:
    from ..program.forms import Form
    from ..program.port import Port
    from ..program.program import Program

Arrays = tuple[Array, ...]

LEAST = 2.5e6
"""Operations of the least part, some 0.1 ms: four times what handing over takes. Less than two such parts are not cut."""

PARTS_EACH = 4
"""Parts a thread, so that one that is held up by other work on its core leaves the rest to the others."""

ROWS = 64
"""Long axes are cut at multiples of this: every part but the last is whole blocks, whatever the lanes."""

SINE, ENTRY = 18, 6
"""What a sine or cosine costs, and what an entry read or written does, in operations of a lane."""

ONE_ROOM, SEVERAL_ROOMS = 1 << 24, 1 << 19
"""Bytes of one result, and of several, from which on their memory is not left to NumPy: less meets no page faults."""

NOTABLE = 2048
"""Numbers in the first input, 4 times as many where there is one result: with fewer it does not pay to look."""

FLOAT32, FLOAT64 = np.dtype(np.float32), np.dtype(np.float64)

TO_DOUBLE = frozenset(c for c in "?" + np.typecodes["AllInteger"] + np.typecodes["Float"] if np.can_cast(c, "d"))
TO_SINGLE = frozenset(c for c in TO_DOUBLE if np.can_cast(c, "f"))
"""Codes of the types that NumPy takes for each of a kernel's two loops."""


class Part(NamedTuple):
    """A kernel's arguments for some of the samples: views of the whole arrays."""

    inputs: Arrays
    outputs: Arrays


def effort(form: Form) -> int:
    """Operations of a sample, or of its step; arms and quadrupeds do 12 to 30 a nanosecond in lanes of four doubles."""
    from ..program.column_groups import ColumnGroups
    from ..program.forms import program_of

    program = program_of(form)
    entries = sum(port.size for port in (*program.inputs, *program.outputs))
    columns = form.groups if isinstance(form, ColumnGroups) else ()
    return _operations(program) + ENTRY * entries + sum(len(g.places) * _operations(g.program) for g in columns)


def _operations(program: Program) -> int:
    counts = program.counts()
    return sum(counts.values()) + (SINE - 1) * (counts.get("sin", 0) + counts.get("cos", 0))


def cut(kernel: Any, given: tuple[Any, ...], out: Any, threads: int) -> tuple[list[Part], Arrays] | None:
    """The parts and the whole outputs; None where one thread is to do it all, because it is little work, or not plain.

    What NumPy would refuse, convert or copy first is left to NumPy: then its errors and its rules are its own.
    """
    owner = _owner_of()(kernel)
    if owner is None or len(given) != len(owner.given.inputs):
        return None
    arrays = tuple([np.asarray(a) if type(a) in (list, tuple) else a for a in given])
    batch = _batch(arrays, owner.given.inputs)
    if batch is None:
        return None
    single = _is_single(arrays)
    work = math.prod(batch) * owner.effort / (2 if single else 1)
    count = min(int(work / LEAST), PARTS_EACH * threads)
    if count < 2:
        return None
    count = max(count // threads * threads, min(count, threads))  # an even number for each, where there are enough
    shapes = [batch + port.shape for port in owner.given.outputs]
    outputs = _outputs(out, shapes, FLOAT32 if single else FLOAT64, arrays)
    if outputs is None:
        return None
    if single:
        owner.address(SINGLE)  # compiled before it is shared out, and here, where an exception can leave
    long = [k for k, n in enumerate(batch) if n >= PARTS_EACH * count]
    axis = (
        long[0] if long else batch.index(max(batch))
    )  # the first that is long enough: what lies inside it stays whole
    rows = -(-batch[axis] // count)
    rows = -(-rows // ROWS) * ROWS if rows >= ROWS else rows
    ports = (*owner.given.inputs, *owner.given.outputs)
    axes = [_axis(a, port, axis - len(batch)) for a, port in zip((*arrays, *outputs), ports, strict=True)]
    slices = [slice(first, first + rows) for first in range(0, batch[axis], rows)]
    views = [
        [a] * len(slices) if before is None else [a[(*before, samples)] for samples in slices]
        for a, before in zip((*arrays, *outputs), axes, strict=True)
    ]
    n = len(arrays)
    return [Part(v[:n], v[n:]) for v in zip(*views, strict=True)], outputs


@cache
def _owner_of() -> Any:
    """What finds the owner of a ufunc; its module knows this one."""
    from .ufunc import owner_of

    return owner_of


def room_for_results(kernel: Any, arrays: tuple[Any, ...]) -> Arrays | None:
    """Fresh arrays for the results of a call in one part; None where NumPy's own are as good."""
    first = arrays[0]
    if kernel.nout == 1 and first.size < 4 * NOTABLE:
        return None
    owner = _owner_of()(kernel)
    if owner is None or type(first) is not np.ndarray or len(arrays) != len(owner.given.inputs):
        return None
    ports = owner.given.outputs
    least = ONE_ROOM if len(ports) == 1 else SEVERAL_ROOMS
    if owner.row * first.size < least * owner.given.inputs[0].size:  # a guess: other inputs may have more samples
        return None
    batch = _batch(arrays, owner.given.inputs)
    if batch is None:
        return None
    return room([batch + port.shape for port in ports], FLOAT32 if _is_single(arrays) else FLOAT64)


def _is_single(arrays: Arrays) -> bool:
    """Whether NumPy would take the loop for float32."""
    return all(a.dtype.char in TO_SINGLE for a in arrays)


def _batch(arrays: Arrays, ports: tuple[Port, ...]) -> tuple[int, ...] | None:
    """The batch shape of plain arrays of real numbers that fit the ports; None of all others."""
    batches = []
    for a, port in zip(arrays, ports, strict=True):
        if type(a) is not np.ndarray or a.dtype.char not in TO_DOUBLE:
            return None
        rank = a.ndim - len(port.shape)
        if rank < 0 or a.shape[rank:] != port.shape:
            return None
        batches.append(a.shape[:rank])
    if len(set(batches)) == 1:
        return batches[0]
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        return None


def _outputs(out: Any, shapes: list[tuple[int, ...]], dtype: np.dtype[Any], arrays: Arrays) -> Arrays | None:
    """Fresh arrays, or those given if they can be written to in any order: rows without gaps, nothing else in them."""
    if out is None:
        return room(shapes, dtype)
    outputs = out if isinstance(out, tuple) else (out,)
    if len(outputs) != len(shapes):
        return None
    for k, (a, shape) in enumerate(zip(outputs, shapes, strict=True)):
        if type(a) is not np.ndarray or a.dtype != dtype or a.shape != shape:
            return None
        if not (a.flags.c_contiguous and a.flags.behaved):
            return None
        if any(np.may_share_memory(a, other) for other in (*arrays, *outputs[:k])):
            return None
    return outputs


def _axis(a: Array, port: Port, axis: int) -> tuple[slice, ...] | None:
    """The index of all axes before the one that is cut, counted from the batch's last; None where it is broadcast."""
    place = a.ndim - len(port.shape) + axis
    return None if place < 0 or a.shape[place] == 1 else (slice(None),) * place
