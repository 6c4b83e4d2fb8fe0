"""Partition of a long program into several functions, in modules of a few: compiled in linear time and memory.

Values used by a later partition and all result entries go through a :class:`~.spill_frame.SpillFrame`. At the end a loop
writes rows of results from it, tile by tile. With one lane, entries are stored directly in their rows. Instructions and their
order do not change, so results are bit-identical.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from ..ir.loops import ColumnSolve
from ..ir.program import Program
from .batch_loop import Loop, call_block
from .column_solve import call_lane_columns, column_loop, column_programs, lane_column_programs
from .ir_builder import LlvmWriter, RowStorer, typed_list
from .lower import CUT_OUTPUTS, Emitter, declarations
from .spill_frame import (
    FrameLayout,
    RowLayout,
    SpillFrame,
    frame_to_rows,
    load_slot,
    preparation,
    store_slot,
    zero_tiles,
)
from .target_machine import LOOP, Machine, Precision
from .vector_math import wrapper

PARTITION = 400
"""Approximate number of instructions of a partition."""

EACH = 25
"""Number of partitions per module."""


def partitioned(given: Program | ColumnSolve, precision: Precision, machine: Machine, around: Loop) -> Iterator[str]:
    """Texts of the modules to compile and link together."""
    columns = given if isinstance(given, ColumnSolve) else ColumnSolve(given, 0, ())
    frame = SpillFrame(columns.program, PARTITION)
    head, places = _head, FrameLayout(columns)
    if machine.lanes(precision) == 1:
        head, places = _head_of_one_lane, RowLayout(columns)
    yield head(columns, frame, precision, machine, around)
    partitions = list(enumerate(pairwise(frame.starts)))
    for k in range(0, len(partitions), EACH):
        w = _writer(precision, machine)
        parts = [_partition(frame, places, precision, machine, *partition) for partition in partitions[k : k + EACH]]
        yield "\n".join([declarations(w), wrapper(precision, w.lanes), *parts])


def _writer(precision: Precision, machine: Machine) -> LlvmWriter:
    return LlvmWriter(precision, machine.lanes(precision), fused=machine.fused)


def _head(columns: ColumnSolve, frame: SpillFrame, precision: Precision, machine: Machine, around: Loop) -> str:
    """Module with the loop, the frame's preparation, and the block, which calls partitions, solves columns and makes rows."""
    w = _writer(precision, machine)
    declared = _call_partitions(w, frame, FrameLayout(columns).pointers)
    tables = []
    for k, (port, entry) in enumerate(zip(columns.outputs, columns.first_entries, strict=False)):
        is_zero = columns.zeros[entry : entry + port.size]
        tables.append(zero_tiles(f"zeros{k}", is_zero, RowStorer(w, "", port.size).span))
    label = column_loop(w, columns, "entry")
    for k, (port, table) in enumerate(zip(columns.outputs, tables, strict=True)):
        array, zeros = f"%a{len(columns.inputs) + k}", f"zeros{k}" if table else ""
        label = frame_to_rows(w, array, port.size, columns.first_entries[k], label, zeros)
    visible, room = replace(columns.program, outputs=columns.outputs), frame.size * w.lanes * precision.bytes
    return "\n".join(
        [
            *declared,
            preparation(_writer(precision, machine), frame.constants),
            *tables,
            *column_programs(columns, lambda: _writer(precision, machine)),
            _block(w, RowLayout(columns).pointers),
            around(LOOP, visible, precision, w.lanes, room, 1),
        ]
    )


def _head_of_one_lane(
    columns: ColumnSolve, frame: SpillFrame, precision: Precision, machine: Machine, around: Loop
) -> str:
    """Module with the loop and the block, which stores constant entries, calls the partitions and solves columns."""
    w, places = _writer(precision, machine), RowLayout(columns)
    for first, count, value in frame.constants:
        places.fill(w, first, count, value)
    declared = _call_partitions(w, frame, places.pointers)
    call_lane_columns(w, columns, places)
    room = max(frame.size - places.starts[-1], 1) * precision.bytes
    return "\n".join(
        [
            *declared,
            preparation(_writer(precision, machine), ()),
            *lane_column_programs(columns, places, precision, fused=machine.fused),
            _block(w, places.pointers),
            around(LOOP, replace(columns.program, outputs=columns.outputs), precision, w.lanes, room, 1),
        ]
    )


def _call_partitions(w: LlvmWriter, frame: SpillFrame, pointers: Sequence[str]) -> list[str]:
    """Call all partitions in order; returns their declarations."""
    types = ", ".join(["ptr"] * len(pointers))
    declarations_of_partitions = []
    for k in range(len(frame.starts) - 1):
        call_block(w, pointers, f"partition{k}")
        declarations_of_partitions.append(f"declare void @partition{k}({types})")
    return declarations_of_partitions


def _block(w: LlvmWriter, pointers: Sequence[str]) -> str:
    arguments, body = typed_list("ptr noalias", pointers), "\n".join(w.lines)
    return f'define internal void @block({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


def _partition(
    frame: SpillFrame, places: FrameLayout, precision: Precision, machine: Machine, number: int, bounds: tuple[int, int]
) -> str:
    w = _writer(precision, machine)
    _Partition(w, frame, places).walk(*bounds, frame.entries, large=False)
    arguments, body = typed_list(places.pointer, places.pointers), "\n".join(w.lines)
    return f'define void @partition{number}({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


class _Partition(Emitter):
    """Emitter that loads values of earlier partitions from their slots, and stores those that later ones need."""

    def __init__(self, w: LlvmWriter, frame: SpillFrame, places: FrameLayout) -> None:
        super().__init__(w, frame.program)
        self.frame, self.place, self.stored = frame, places.place, 0

    def meet(self, number: int) -> None:
        """Defer the load of an input until it is used, possibly in a later partition."""

    def value(self, number: int) -> str:
        """Vector of an instruction, from a register, an input or the frame."""
        op, _, value = self.program.instructions[number]
        if op == "const" or number in self.values:
            return super().value(number)
        if op == "input":
            self.values[number] = self.input(int(value))
        else:
            self.values[number] = load_slot(self.w, *self.place(self.frame.slots[number]))
        return self.values[number]

    def record(self, number: int, value: str) -> None:
        """Record the vector of an instruction, and store it if a later partition needs it and :meth:`output` does not."""
        super().record(number, value)
        if number in self.frame.slots and number not in self.frame.entries:
            store_slot(self.w, value, *self.place(self.frame.slots[number]))

    def output(self, number: int, value: str) -> None:
        """Store an entry of the results in its slot."""
        store_slot(self.w, value, *self.place(number))
        self.stored += 1
        if self.stored % CUT_OUTPUTS == 0:
            self.cut()
