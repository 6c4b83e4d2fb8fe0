"""Column solves in a frame: a function for each group of columns, and the loop that calls it.

Adjacent entries of a column are one matrix row apart, and the solution replaces the column. All other values that a function
reads from the frame lie outside the matrices, so its two pointers do not alias.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..ir.loops import ColumnGroup, ColumnSolve
from .ir_builder import LlvmWriter, typed_list
from .lower import Emitter
from .spill_frame import RowLayout, load_slot, store_slot
from .target_machine import Precision


def column_programs(columns: ColumnSolve, writer: Callable[[], LlvmWriter]) -> Iterator[str]:
    """Table of the groups' columns, and their functions."""
    for number, group in enumerate(columns.groups):
        w = writer()
        slot = w.lanes * w.precision.bytes
        offsets = [slot * columns.entry(matrix, 0, column) for matrix, column in group.places]
        yield f"@columns{number} = internal constant [{len(offsets)} x i64] [{typed_list('i64', offsets)}]"
        e = _Column(w, columns, group)
        e.walk(0, len(group.program.instructions), columns.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f'define internal void @column{number}(ptr noalias %frame, ptr noalias %column) noinline "stackrealign"'
        yield f"{head} {{\nentry:\n{body}\n  ret void\n}}\n"


def column_loop(w: LlvmWriter, columns: ColumnSolve, label: str) -> str:
    """Call the functions; takes and returns the current label."""
    for number, group in enumerate(columns.groups):
        for entry, value in _constants(columns, group):  # the frame holds the columns of the last block
            store_slot(w, w.splat(value), entry)
        with w.loop(str(len(group.places)), label) as k:
            place = w.new(f"load i64, ptr {w.gep(f'@columns{number}', w.new(f'mul i64 {k}, 8'))}, align 8")
            w.do(f"call void @column{number}(ptr %frame, ptr {w.gep('%frame', place)})")
        label = w.after
    return label


def _constants(columns: ColumnSolve, group: ColumnGroup) -> Iterator[tuple[int, float]]:
    """Constant entries that a group's program reads."""
    program = columns.program
    first = sum(port.size for port in group.program.inputs[:-1])
    rows = [int(x.value) - first for x in group.program.instructions if x.op == "input" and x.value >= first]
    for matrix, column in group.places:
        for row in rows:
            entry = columns.entry(matrix, row, column)
            op, _, value = program.instructions[program.results[entry]]
            if op == "const":
                yield entry, value


class _Column(Emitter):
    """Emitter that reads shared values and one column from the frame."""

    def __init__(self, w: LlvmWriter, columns: ColumnSolve, group: ColumnGroup) -> None:
        super().__init__(w, group.program)
        self.shared = columns.first_entries[-columns.shared]
        self.row = group.program.inputs[-1].size
        self.before = sum(port.size for port in group.program.inputs[:-1])

    def input(self, number: int) -> str:
        """Vector of an input."""
        if number < self.before:
            return load_slot(self.w, self.shared + number)
        return load_slot(self.w, (number - self.before) * self.row, "%column")

    def output(self, number: int, value: str) -> None:
        """Store an entry of the solution."""
        store_slot(self.w, value, number * self.row, "%column")


# ── Columns of one sample in SIMD lanes: adjacent columns of the results are contiguous in the rows of a matrix

# Each lane computes the same as a block of samples does column by column, so results are bit-identical.

WIDTH = 64
"""Size of a vector of columns [bytes]; processors with shorter vectors use two or four instead."""


def lane_column_programs(
    columns: ColumnSolve, places: RowLayout, precision: Precision, *, fused: bool
) -> Iterator[str]:
    """Function of each group for ``count`` columns, starting at the first row of the first column."""
    for number, group in enumerate(columns.groups):
        w = LlvmWriter(precision, WIDTH // precision.bytes, fused=fused)
        lanes = typed_list("i64", range(w.lanes))
        first = w.new(f"insertelement <{w.lanes} x i64> poison, i64 %count, i32 0")
        count = w.new(
            f"shufflevector <{w.lanes} x i64> {first}, <{w.lanes} x i64> poison, <{w.lanes} x i32> zeroinitializer"
        )
        e = _Columns(w, columns, group, places, w.new(f"icmp ult <{w.lanes} x i64> <{lanes}>, {count}"))
        e.walk(0, len(group.program.instructions), columns.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f"define internal void @column{number}(ptr noalias %frame, ptr noalias %column, i64 %count) noinline"
        yield f'{head} "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


def call_lane_columns(w: LlvmWriter, columns: ColumnSolve, places: RowLayout) -> None:
    """Call the functions for runs of adjacent columns."""
    for number, group in enumerate(columns.groups):
        for matrix, column, count in _runs(group, WIDTH // w.precision.bytes):
            entry, base = places.place(columns.entry(matrix, 0, column))
            place = w.gep(base, entry * w.precision.bytes)
            w.do(f"call void @column{number}(ptr %frame, ptr {place}, i64 {count})")


def _runs(group: ColumnGroup, most: int) -> Iterator[tuple[int, int, int]]:
    """Runs of adjacent columns of a group, at most ``most`` long: matrix, first column, length."""
    start, count = group.places[0], 0
    for matrix, column in group.places:
        if count == most or (matrix, column) != (start[0], start[1] + count):
            yield *start, count
            start, count = (matrix, column), 0
        count += 1
    yield *start, count


class _Columns(Emitter):
    """Emitter that reads shared values from the frame, broadcast to all lanes, and columns from rows of a matrix."""

    def __init__(self, w: LlvmWriter, columns: ColumnSolve, group: ColumnGroup, places: RowLayout, mask: str) -> None:
        super().__init__(w, group.program)
        self.mask = f"{w.mask} {mask}"
        self.shared, _ = places.place(columns.first_entries[-columns.shared])
        self.row = group.program.inputs[-1].size * w.precision.bytes
        self.before = sum(port.size for port in group.program.inputs[:-1])

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
        w, size = self.w, self.w.precision.bytes
        if number >= self.before:
            place = w.gep("%column", (number - self.before) * self.row)
            zeros = f"{w.vector} zeroinitializer"
            return w.new(
                f"call {w.vector} @llvm.masked.load.{w.suffix}.p0(ptr {place}, i32 {size}, {self.mask}, {zeros})"
            )
        place = w.gep("%frame", (self.shared + number) * size)
        shared = w.new(f"load {w.element}, ptr {place}, align {size}")
        first = w.new(f"insertelement {w.vector} poison, {w.element} {shared}, i32 0")
        return w.new(f"shufflevector {w.vector} {first}, {w.vector} poison, <{w.lanes} x i32> zeroinitializer")

    def output(self, number: int, value: str) -> None:
        """Store an entry of the solutions in its row."""
        w, place = self.w, self.w.gep("%column", number * self.row)
        w.do(
            f"call void @llvm.masked.store.{w.suffix}.p0({w.vector} {value}, ptr {place}, i32 {w.precision.bytes}, {self.mask})"
        )
