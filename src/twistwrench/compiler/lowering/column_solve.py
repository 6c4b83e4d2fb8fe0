"""Column solves in a frame: a function for each group of columns, and the loop that calls it.

Successive entries of a column are one row of the matrix apart. The solution replaces the column. All other values that a
function reads from the frame lie outside the matrices, so its two pointers do not alias.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..ir.loops import ColumnGroup, ColumnSolve
from .ir_builder import LlvmWriter, typed_list
from .lower import Emitter
from .spill_frame import RowLayout, load_slot, store_slot
from .target_machine import Precision

_BYTES_PER_OFFSET = 8
"""Size of an i64."""


def column_programs(solve: ColumnSolve, writer: Callable[[], LlvmWriter]) -> Iterator[str]:
    """For each group: the table ``@columns…`` of its columns' offsets in the frame, then the function ``@column…``."""
    for number, group in enumerate(solve.groups):
        w = writer()
        slot_bytes = w.lanes * w.precision.bytes
        offsets = []  # of the first entry of each column [bytes]
        for matrix, column in group.places:
            first_slot = solve.entry(matrix, 0, column)
            offsets.append(slot_bytes * first_slot)
        yield f"@columns{number} = internal constant [{len(offsets)} x i64] [{typed_list('i64', offsets)}]"
        emitter = _ColumnEmitter(w, solve, group)
        instruction_count = len(group.program.instructions)
        emitter.walk(0, instruction_count, solve.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f'define internal void @column{number}(ptr noalias %frame, ptr noalias %column) noinline "stackrealign"'
        yield f"{head} {{\nentry:\n{body}\n  ret void\n}}\n"


def column_loop(w: LlvmWriter, solve: ColumnSolve, label: str) -> str:
    """Write a loop over the columns of each group, which calls the group's function.

    ``label`` names the current basic block. Returns the name of the basic block after the loops.
    """
    for number, group in enumerate(solve.groups):
        # Each block of samples needs its constants anew: solutions of the previous block have replaced them.
        for entry, value in _constant_entries(solve, group):
            store_slot(w, w.splat(value), entry)
        column_count = str(len(group.places))
        with w.loop(column_count, label) as index:
            table_offset = w.new(f"mul i64 {index}, {_BYTES_PER_OFFSET}")
            table_entry = w.gep(f"@columns{number}", table_offset)
            column_offset = w.new(f"load i64, ptr {table_entry}, align {_BYTES_PER_OFFSET}")
            w.do(f"call void @column{number}(ptr %frame, ptr {w.gep('%frame', column_offset)})")
        label = w.after
    return label


def _shared_count(group: ColumnGroup) -> int:
    """Number of shared values of a group's program: all inputs before its last port, which is the column."""
    return sum(port.size for port in group.program.inputs[:-1])


def _constant_entries(solve: ColumnSolve, group: ColumnGroup) -> Iterator[tuple[int, float]]:
    """Slot and value of each constant among the column entries that a group's program reads."""
    program = solve.program
    shared_count = _shared_count(group)
    input_numbers = [int(instruction.value) for instruction in group.program.instructions if instruction.op == "input"]
    rows = [number - shared_count for number in input_numbers if number >= shared_count]
    for matrix, column in group.places:
        for row in rows:
            entry = solve.entry(matrix, row, column)
            instruction_number = program.results[entry]
            op, _, value = program.instructions[instruction_number]
            if op == "const":
                yield entry, value


class _ColumnEmitter(Emitter):
    """Emitter that reads shared values and one column from the frame."""

    def __init__(self, w: LlvmWriter, solve: ColumnSolve, group: ColumnGroup) -> None:
        super().__init__(w, group.program)
        self.first_shared_slot = solve.first_entries[-solve.shared]  # the shared results are the last ones
        self.slots_per_row = group.program.inputs[-1].size
        """Number of slots of a row of the matrix, which is square."""
        self.shared_count = _shared_count(group)

    def input(self, number: int) -> str:
        """Vector of an input: a shared value, or an entry of the column."""
        if number < self.shared_count:
            return load_slot(self.w, self.first_shared_slot + number)
        row = number - self.shared_count
        return load_slot(self.w, row * self.slots_per_row, "%column")

    def output(self, number: int, value: str) -> None:
        """Store an entry of the solution in its row of the matrix."""
        store_slot(self.w, value, number * self.slots_per_row, "%column")


# ── Columns of one sample in SIMD lanes: entries of adjacent columns are contiguous in the rows of a matrix

# Each lane makes the same operations as the functions above, so results have the same bits.

VECTOR_BYTES = 64
"""Size of a vector of columns [bytes]; processors with shorter vectors use two or four of theirs."""


def lane_column_programs(solve: ColumnSolve, layout: RowLayout, precision: Precision, *, fused: bool) -> Iterator[str]:
    """Function of each group for ``%count`` adjacent columns; ``%column`` is the address of the first column's first entry."""
    for number, group in enumerate(solve.groups):
        w = LlvmWriter(precision, VECTOR_BYTES // precision.bytes, fused=fused)
        lane_numbers = typed_list("i64", range(w.lanes))
        count_in_lanes = _lane_copies(w, f"<{w.lanes} x i64>", "i64 %count")
        is_used = w.new(f"icmp ult <{w.lanes} x i64> <{lane_numbers}>, {count_in_lanes}")  # lanes that have a column
        emitter = _LaneColumnsEmitter(w, solve, group, layout, is_used)
        instruction_count = len(group.program.instructions)
        emitter.walk(0, instruction_count, solve.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f"define internal void @column{number}(ptr noalias %frame, ptr noalias %column, i64 %count) noinline"
        yield f'{head} "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


def _lane_copies(w: LlvmWriter, vector: str, element: str) -> str:
    """Vector with one element in all lanes; ``vector`` is its type, ``element`` a type and a value."""
    in_lane_0 = w.new(f"insertelement {vector} poison, {element}, i32 0")
    return w.new(f"shufflevector {vector} {in_lane_0}, {vector} poison, <{w.lanes} x i32> zeroinitializer")


def call_lane_columns(w: LlvmWriter, solve: ColumnSolve, layout: RowLayout) -> None:
    """Call the functions for runs of adjacent columns."""
    max_columns = VECTOR_BYTES // w.precision.bytes
    for number, group in enumerate(solve.groups):
        for matrix, column, column_count in _column_runs(group, max_columns):
            first_entry = solve.entry(matrix, 0, column)
            index, base = layout.place(first_entry)
            address = w.gep(base, index * w.precision.bytes)
            w.do(f"call void @column{number}(ptr %frame, ptr {address}, i64 {column_count})")


def _column_runs(group: ColumnGroup, max_length: int) -> Iterator[tuple[int, int, int]]:
    """Runs of adjacent columns of a group: matrix, first column, number of columns (at most ``max_length``)."""
    run_matrix, run_column = group.places[0]  # first column of the current run
    length = 0  # columns of the run so far
    for matrix, column in group.places:
        continues = (matrix, column) == (run_matrix, run_column + length)
        if not continues or length == max_length:
            yield run_matrix, run_column, length
            run_matrix, run_column = matrix, column
            length = 0
        length += 1
    yield run_matrix, run_column, length


class _LaneColumnsEmitter(Emitter):
    """Emitter for several columns: shared values are read into all lanes, entries of adjacent columns into one lane each."""

    def __init__(self, w: LlvmWriter, solve: ColumnSolve, group: ColumnGroup, layout: RowLayout, is_used: str) -> None:
        super().__init__(w, group.program)
        self.typed_mask = f"{w.mask} {is_used}"
        """Type and register of the mask of lanes that have a column."""
        first_shared_slot = solve.first_entries[-solve.shared]  # the shared results are the last ones
        self.first_shared_index, _ = layout.place(first_shared_slot)  # in the frame, as all shared values
        self.bytes_per_row = group.program.inputs[-1].size * w.precision.bytes
        """Size of a row of the matrix, which is square."""
        self.shared_count = _shared_count(group)

    def meet(self, number: int) -> None:
        """Load nothing yet: :meth:`value` loads an input where it is used."""

    def value(self, number: int) -> str:
        """Vector of an instruction; an input is loaded at its first use."""
        op, _, value = self.program.instructions[number]
        if op == "input" and number not in self.values:
            self.values[number] = self.input(int(value))
        return super().value(number)

    def input(self, number: int) -> str:
        """Vector of an input."""
        w, element_bytes = self.w, self.w.precision.bytes
        if number >= self.shared_count:
            row = number - self.shared_count
            address = w.gep("%column", row * self.bytes_per_row)
            zeros_elsewhere = f"{w.vector} zeroinitializer"
            arguments = f"ptr {address}, i32 {element_bytes}, {self.typed_mask}, {zeros_elsewhere}"
            return w.new(f"call {w.vector} @llvm.masked.load.{w.suffix}.p0({arguments})")
        address = w.gep("%frame", (self.first_shared_index + number) * element_bytes)
        shared_value = w.new(f"load {w.element}, ptr {address}, align {element_bytes}")
        return _lane_copies(w, w.vector, f"{w.element} {shared_value}")

    def output(self, number: int, value: str) -> None:
        """Store an entry of the solutions in its row of the matrix."""
        w = self.w
        address = w.gep("%column", number * self.bytes_per_row)
        arguments = f"{w.vector} {value}, ptr {address}, i32 {w.precision.bytes}, {self.typed_mask}"
        w.do(f"call void @llvm.masked.store.{w.suffix}.p0({arguments})")
