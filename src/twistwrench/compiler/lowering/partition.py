"""Long programs as several functions, the partitions, in modules of a few: compiled in linear time and memory.

A *block* is the group of samples that the lanes of a vector evaluate together. Values that a later partition uses, and all
result entries, are stored in a frame, :class:`~.spill_frame.SpillFrame`. At the end of a block, a loop writes rows of results
from the frame, tile by tile. With one lane, result entries are stored directly in their rows. Instructions and their order do
not change, so results have the same bits as without partitions.
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

PARTITIONS_PER_MODULE = 25
"""Number of partitions per module."""


def partitioned(form: Program | ColumnSolve, precision: Precision, machine: Machine, write_loop: Loop) -> Iterator[str]:
    """Texts of the modules of a program or column solve, to be compiled and linked together.

    ``write_loop`` writes the loop over the blocks.
    """
    columns = form if isinstance(form, ColumnSolve) else ColumnSolve(form, 0, ())
    frame = SpillFrame(columns.program, PARTITION)
    if machine.lanes(precision) == 1:
        layout: FrameLayout = RowLayout(columns)
        yield _one_lane_head_module(columns, frame, precision, machine, write_loop)
    else:
        layout = FrameLayout(columns)
        yield _head_module(columns, frame, precision, machine, write_loop)
    bounds_of_partitions = list(pairwise(frame.starts))
    for first_number in range(0, len(bounds_of_partitions), PARTITIONS_PER_MODULE):
        w = _writer(precision, machine)
        functions = []
        module_bounds = bounds_of_partitions[first_number : first_number + PARTITIONS_PER_MODULE]
        for number, bounds in enumerate(module_bounds, first_number):
            functions.append(_partition_function(frame, layout, precision, machine, number, bounds))
        yield "\n".join([declarations(w), wrapper(precision, w.lanes), *functions])


def _writer(precision: Precision, machine: Machine) -> LlvmWriter:
    """Writer of one function for the machine's vectors."""
    return LlvmWriter(precision, machine.lanes(precision), fused=machine.fused)


def _head_module(
    columns: ColumnSolve, frame: SpillFrame, precision: Precision, machine: Machine, write_loop: Loop
) -> str:
    """Module with the loop over blocks, the preparation of the frame, and the function of a block.

    That function calls all partitions, solves columns, and writes rows of results.
    """
    w = _writer(precision, machine)
    partition_declarations = _call_partitions(w, frame, FrameLayout(columns).pointers)
    zero_tables = []  # of each output, tiles that hold only zeros; empty texts for no table
    # strict=False: first entries of the shared results of a column solve come last; they are not outputs.
    for k, (port, first_entry) in enumerate(zip(columns.outputs, columns.first_entries, strict=False)):
        is_zero = columns.zeros[first_entry : first_entry + port.size]
        columns_per_tile = RowStorer(w, "", port.size).span
        zero_tables.append(zero_tiles(f"zeros{k}", is_zero, columns_per_tile))
    label = column_loop(w, columns, "entry")
    for k, (port, zero_table) in enumerate(zip(columns.outputs, zero_tables, strict=True)):
        array = f"%a{len(columns.inputs) + k}"
        table_name = f"zeros{k}" if zero_table else ""
        label = frame_to_rows(w, array, port.size, columns.first_entries[k], label, table_name)
    program_without_shared = replace(columns.program, outputs=columns.outputs)
    frame_bytes = frame.size * w.lanes * precision.bytes
    return "\n".join(
        [
            *partition_declarations,
            preparation(_writer(precision, machine), frame.constants),
            *zero_tables,
            *column_programs(columns, lambda: _writer(precision, machine)),
            _block_function(w, RowLayout(columns).pointers),
            write_loop(LOOP, program_without_shared, precision, w.lanes, frame_bytes, 1),
        ]
    )


def _one_lane_head_module(
    columns: ColumnSolve, frame: SpillFrame, precision: Precision, machine: Machine, write_loop: Loop
) -> str:
    """Module with the loop over blocks and the function of a block, for one lane.

    That function stores constant entries, calls all partitions, and solves columns.
    """
    w = _writer(precision, machine)
    layout = RowLayout(columns)
    for first_entry, entry_count, value in frame.constants:
        layout.fill(w, first_entry, entry_count, value)
    partition_declarations = _call_partitions(w, frame, layout.pointers)
    call_lane_columns(w, columns, layout)
    program_without_shared = replace(columns.program, outputs=columns.outputs)
    frame_bytes = max(frame.size - layout.starts[-1], 1) * precision.bytes  # without the slots in output rows
    return "\n".join(
        [
            *partition_declarations,
            preparation(_writer(precision, machine), ()),
            *lane_column_programs(columns, layout, precision, fused=machine.fused),
            _block_function(w, layout.pointers),
            write_loop(LOOP, program_without_shared, precision, w.lanes, frame_bytes, 1),
        ]
    )


def _call_partitions(w: LlvmWriter, frame: SpillFrame, pointers: Sequence[str]) -> list[str]:
    """Write calls of all partitions in order, and return the declarations of these functions."""
    types = ", ".join(["ptr"] * len(pointers))
    declarations_of_partitions = []
    for k in range(len(frame.starts) - 1):
        call_block(w, pointers, f"partition{k}")
        declarations_of_partitions.append(f"declare void @partition{k}({types})")
    return declarations_of_partitions


def _block_function(w: LlvmWriter, pointers: Sequence[str]) -> str:
    """Function ``@block`` with the writer's lines; its arguments are the ``pointers``."""
    arguments = typed_list("ptr noalias", pointers)
    body = "\n".join(w.lines)
    return f'define internal void @block({arguments}) noinline "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


def _partition_function(
    frame: SpillFrame, layout: FrameLayout, precision: Precision, machine: Machine, number: int, bounds: tuple[int, int]
) -> str:
    """Function of a partition; ``bounds`` are the numbers of its first instruction and of that after its last."""
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
        """Function of a slot that returns its index and the pointer to which the index is relative."""
        self.stored_entries = 0
        """Number of result entries that are stored."""

    def meet(self, number: int) -> None:
        """Write nothing: an input is loaded where it is used, possibly in a later partition."""

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
        self.stored_entries += 1
        if self.stored_entries % CUT_OUTPUTS == 0:
            self.cut()
