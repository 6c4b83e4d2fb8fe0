"""Column solves in a frame: a function for each group of columns, and the loop that calls it.

Entries of a column that follow each other are one row of the matrix apart. The solution replaces the column. All other values
that a function reads from the frame lie outside the matrices, so its two pointers do not alias.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..ir.loops import ColumnGroup, ColumnSolve
from .ir_builder import LlvmWriter, typed_list
from .lower import Emitter
from .spill_frame import RowLayout, load_slot, store_slot
from .target_machine import Precision


def column_programs(columns: ColumnSolve, writer: Callable[[], LlvmWriter]) -> Iterator[str]:
    """For each group, a table of the offsets of its columns in the frame, and its function."""
    for number, group in enumerate(columns.groups):
        w = writer()
        slot_bytes = w.lanes * w.precision.bytes
        offsets = [slot_bytes * columns.entry(matrix, 0, column) for matrix, column in group.places]
        yield f"@columns{number} = internal constant [{len(offsets)} x i64] [{typed_list('i64', offsets)}]"
        emitter = _ColumnEmitter(w, columns, group)
        emitter.walk(0, len(group.program.instructions), columns.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f'define internal void @column{number}(ptr noalias %frame, ptr noalias %column) noinline "stackrealign"'
        yield f"{head} {{\nentry:\n{body}\n  ret void\n}}\n"


def column_loop(w: LlvmWriter, columns: ColumnSolve, label: str) -> str:
    """Call the functions; ``label`` is that of the current block, and the result that of the block afterwards."""
    for number, group in enumerate(columns.groups):
        for entry, value in _constant_entries(
            columns, group
        ):  # again: the solutions of the last block have replaced them
            store_slot(w, w.splat(value), entry)
        with w.loop(str(len(group.places)), label) as k:
            table_offset = w.new(f"mul i64 {k}, 8")
            table_entry = w.gep(f"@columns{number}", table_offset)
            column_offset = w.new(f"load i64, ptr {table_entry}, align 8")
            w.do(f"call void @column{number}(ptr %frame, ptr {w.gep('%frame', column_offset)})")
        label = w.after
    return label


def _constant_entries(columns: ColumnSolve, group: ColumnGroup) -> Iterator[tuple[int, float]]:
    """Constant entries of the columns that a group's program reads, with their values."""
    program = columns.program
    first_of_column = sum(
        port.size for port in group.program.inputs[:-1]
    )  # number of the column's first entry as an input
    inputs = [int(instruction.value) for instruction in group.program.instructions if instruction.op == "input"]
    rows = [number - first_of_column for number in inputs if number >= first_of_column]
    for matrix, column in group.places:
        for row in rows:
            entry = columns.entry(matrix, row, column)
            op, _, value = program.instructions[program.results[entry]]
            if op == "const":
                yield entry, value


class _ColumnEmitter(Emitter):
    """Emitter that reads shared values and one column from the frame."""

    def __init__(self, w: LlvmWriter, columns: ColumnSolve, group: ColumnGroup) -> None:
        super().__init__(w, group.program)
        self.shared = columns.first_entries[-columns.shared]
        """First slot of the shared values."""
        self.row = group.program.inputs[-1].size
        """Number of slots of a row of the matrix, which is square."""
        self.before = sum(port.size for port in group.program.inputs[:-1])
        """Number of shared values, which come before the column among the inputs."""

    def input(self, number: int) -> str:
        """Vector of an input: a shared value, or an entry of the column."""
        if number < self.before:
            return load_slot(self.w, self.shared + number)
        return load_slot(self.w, (number - self.before) * self.row, "%column")

    def output(self, number: int, value: str) -> None:
        """Store an entry of the solution."""
        store_slot(self.w, value, number * self.row, "%column")


# ── Columns of one sample in SIMD lanes: entries of adjacent columns are contiguous in the rows of a matrix

# Each lane makes the same operations as the functions above, so results have the same bits.

VECTOR_BYTES = 64
"""Size of a vector of columns [bytes]; processors with shorter vectors use two or four of theirs."""


def lane_column_programs(
    columns: ColumnSolve, places: RowLayout, precision: Precision, *, fused: bool
) -> Iterator[str]:
    """Function of each group for ``%count`` adjacent columns; ``%column`` is the address of the first column's first entry."""
    for number, group in enumerate(columns.groups):
        w = LlvmWriter(precision, VECTOR_BYTES // precision.bytes, fused=fused)
        integers = f"<{w.lanes} x i64>"
        lane_numbers = typed_list("i64", range(w.lanes))
        in_lane_0 = w.new(f"insertelement {integers} poison, i64 %count, i32 0")
        count = w.new(f"shufflevector {integers} {in_lane_0}, {integers} poison, <{w.lanes} x i32> zeroinitializer")
        mask = w.new(f"icmp ult {integers} <{lane_numbers}>, {count}")  # lanes that have a column
        emitter = _LaneColumnsEmitter(w, columns, group, places, mask)
        emitter.walk(0, len(group.program.instructions), columns.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f"define internal void @column{number}(ptr noalias %frame, ptr noalias %column, i64 %count) noinline"
        yield f'{head} "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


def call_lane_columns(w: LlvmWriter, columns: ColumnSolve, places: RowLayout) -> None:
    """Call the functions for runs of adjacent columns."""
    for number, group in enumerate(columns.groups):
        for matrix, column, count in _runs(group, VECTOR_BYTES // w.precision.bytes):
            index, base = places.place(columns.entry(matrix, 0, column))
            address = w.gep(base, index * w.precision.bytes)
            w.do(f"call void @column{number}(ptr %frame, ptr {address}, i64 {count})")


def _runs(group: ColumnGroup, max_length: int) -> Iterator[tuple[int, int, int]]:
    """Runs of adjacent columns of a group: matrix, first column, number of columns."""
    run_matrix, run_column = group.places[0]
    length = 0
    for matrix, column in group.places:
        continues = (matrix, column) == (run_matrix, run_column + length)
        if not continues or length == max_length:
            yield run_matrix, run_column, length
            run_matrix, run_column, length = matrix, column, 0
        length += 1
    yield run_matrix, run_column, length


class _LaneColumnsEmitter(Emitter):
    """Emitter for several columns: shared values are read into all lanes, entries of adjacent columns into one lane each."""

    def __init__(self, w: LlvmWriter, columns: ColumnSolve, group: ColumnGroup, places: RowLayout, mask: str) -> None:
        super().__init__(w, group.program)
        self.mask = f"{w.mask} {mask}"
        """Lanes that have a column, with the type."""
        self.shared, _ = places.place(columns.first_entries[-columns.shared])
        """Index of the first shared value in the frame."""
        self.row = group.program.inputs[-1].size * w.precision.bytes
        """Size of a row of the matrix [bytes]."""
        self.before = sum(port.size for port in group.program.inputs[:-1])
        """Number of shared values, which come before the column among the inputs."""

    def meet(self, number: int) -> None:
        """Defer the load of an input until it is used."""

    def value(self, number: int) -> str:
        """Vector of an instruction."""
        op, _, value = self.program.instructions[number]
        if op == "input" and number not in self.values:
            self.values[number] = self.input(int(value))
        return super().value(number)

    def input(self, number: int) -> str:
        """Vector of an input."""
        w, element_bytes = self.w, self.w.precision.bytes
        if number >= self.before:
            address = w.gep("%column", (number - self.before) * self.row)
            arguments = f"ptr {address}, i32 {element_bytes}, {self.mask}, {w.vector} zeroinitializer"
            return w.new(f"call {w.vector} @llvm.masked.load.{w.suffix}.p0({arguments})")
        address = w.gep("%frame", (self.shared + number) * element_bytes)
        shared = w.new(f"load {w.element}, ptr {address}, align {element_bytes}")
        in_lane_0 = w.new(f"insertelement {w.vector} poison, {w.element} {shared}, i32 0")
        return w.new(f"shufflevector {w.vector} {in_lane_0}, {w.vector} poison, <{w.lanes} x i32> zeroinitializer")

    def output(self, number: int, value: str) -> None:
        """Store an entry of the solutions in its row of the matrix."""
        w = self.w
        address = w.gep("%column", number * self.row)
        arguments = f"{w.vector} {value}, ptr {address}, i32 {w.precision.bytes}, {self.mask}"
        w.do(f"call void @llvm.masked.store.{w.suffix}.p0({arguments})")
