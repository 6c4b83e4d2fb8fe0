"""Long programs as several functions, the partitions, in modules of a few: compiled in linear time and memory.

Values that a later partition uses and all result entries are stored in a frame, :class:`~.spill_frame.SpillFrame`. At the end a
loop writes rows of results from the frame, tile by tile. With one lane, result entries are stored directly in their rows.
Instructions and their order do not change, so results have the same bits as without partitions.
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


def partitioned(form: Program | ColumnSolve, precision: Precision, machine: Machine, around: Loop) -> Iterator[str]:
    """Texts of the modules of a program or column solve, to be compiled and linked together.

    ``around`` writes the loop around the blocks.
    """
    columns = form if isinstance(form, ColumnSolve) else ColumnSolve(form, 0, ())
    frame = SpillFrame(columns.program, PARTITION)
    head_module, layout = _head_module, FrameLayout(columns)
    if machine.lanes(precision) == 1:
        head_module, layout = _one_lane_head_module, RowLayout(columns)
    yield head_module(columns, frame, precision, machine, around)
    partitions = list(enumerate(pairwise(frame.starts)))
    for first in range(0, len(partitions), EACH):
        w = _writer(precision, machine)
        functions = []
        for number, bounds in partitions[first : first + EACH]:
            functions.append(_partition_function(frame, layout, precision, machine, number, bounds))
        yield "\n".join([declarations(w), wrapper(precision, w.lanes), *functions])


def _writer(precision: Precision, machine: Machine) -> LlvmWriter:
    """Writer of one function for the machine's vectors."""
    return LlvmWriter(precision, machine.lanes(precision), fused=machine.fused)


def _head_module(columns: ColumnSolve, frame: SpillFrame, precision: Precision, machine: Machine, around: Loop) -> str:
    """Module with the loop, the preparation of the frame, and the block.

    The block calls all partitions, solves columns, and writes rows of results.
    """
    w = _writer(precision, machine)
    partition_declarations = _call_partitions(w, frame, FrameLayout(columns).pointers)
    zero_tables = []
    # The shared results of a column solve come last, and are not outputs.
    for k, (port, first_entry) in enumerate(zip(columns.outputs, columns.first_entries, strict=False)):
        is_zero = columns.zeros[first_entry : first_entry + port.size]
        tile_columns = RowStorer(w, "", port.size).span
        zero_tables.append(zero_tiles(f"zeros{k}", is_zero, tile_columns))
    label = column_loop(w, columns, "entry")
    for k, (port, table) in enumerate(zip(columns.outputs, zero_tables, strict=True)):
        array = f"%a{len(columns.inputs) + k}"
        table_name = f"zeros{k}" if table else ""
        label = frame_to_rows(w, array, port.size, columns.first_entries[k], label, table_name)
    without_shared = replace(columns.program, outputs=columns.outputs)
    frame_bytes = frame.size * w.lanes * precision.bytes
    return "\n".join(
        [
            *partition_declarations,
            preparation(_writer(precision, machine), frame.constants),
            *zero_tables,
            *column_programs(columns, lambda: _writer(precision, machine)),
            _block_function(w, RowLayout(columns).pointers),
            around(LOOP, without_shared, precision, w.lanes, frame_bytes, 1),
        ]
    )


def _one_lane_head_module(
    columns: ColumnSolve, frame: SpillFrame, precision: Precision, machine: Machine, around: Loop
) -> str:
    """Module with the loop and the block, for one lane.

    The block stores constant entries, calls all partitions, and solves columns.
    """
    w = _writer(precision, machine)
    layout = RowLayout(columns)
    for first, count, value in frame.constants:
        layout.fill(w, first, count, value)
    partition_declarations = _call_partitions(w, frame, layout.pointers)
    call_lane_columns(w, columns, layout)
    without_shared = replace(columns.program, outputs=columns.outputs)
    frame_bytes = max(frame.size - layout.starts[-1], 1) * precision.bytes  # without the slots in output rows
    return "\n".join(
        [
            *partition_declarations,
            preparation(_writer(precision, machine), ()),
            *lane_column_programs(columns, layout, precision, fused=machine.fused),
            _block_function(w, layout.pointers),
            around(LOOP, without_shared, precision, w.lanes, frame_bytes, 1),
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


def _block_function(w: LlvmWriter, pointers: Sequence[str]) -> str:
    """Function ``@block`` with the writer's lines."""
    arguments = typed_list("ptr noalias", pointers)
    body = "\n".join(w.lines)
    return f'define internal void @block({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


def _partition_function(
    frame: SpillFrame, layout: FrameLayout, precision: Precision, machine: Machine, number: int, bounds: tuple[int, int]
) -> str:
    """Function of a partition; ``bounds`` are its first instruction and that of the next one."""
    w = _writer(precision, machine)
    first, end = bounds
    _PartitionEmitter(w, frame, layout).walk(first, end, frame.entries, large=False)
    arguments = typed_list(layout.pointer, layout.pointers)
    body = "\n".join(w.lines)
    return f'define void @partition{number}({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


class _PartitionEmitter(Emitter):
    """Emitter that loads values of earlier partitions from their slots, and stores those that later ones need."""

    def __init__(self, w: LlvmWriter, frame: SpillFrame, layout: FrameLayout) -> None:
        super().__init__(w, frame.program)
        self.frame = frame
        self.place = layout.place
        """Function that returns where a slot is: its index, and the pointer to which the index is relative."""
        self.stored = 0
        """Number of result entries that are stored."""

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
            index, pointer = self.place(self.frame.slots[number])
            self.values[number] = load_slot(self.w, index, pointer)
        return self.values[number]

    def record(self, number: int, value: str) -> None:
        """Record the vector of an instruction, and store it if a later partition needs it and :meth:`output` does not."""
        super().record(number, value)
        if number in self.frame.slots and number not in self.frame.entries:
            index, pointer = self.place(self.frame.slots[number])
            store_slot(self.w, value, index, pointer)

    def output(self, number: int, value: str) -> None:
        """Store an entry of the results in its slot, which has the same number."""
        index, pointer = self.place(number)
        store_slot(self.w, value, index, pointer)
        self.stored += 1
        if self.stored % CUT_OUTPUTS == 0:
            self.cut()
