"""The columns of one sample's results in SIMD lanes: columns that follow each other lie side by side in the rows of a matrix.

Lanes compute what a block of samples computes with one column after the other, so the bits are the same.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..program.column_groups import ColumnGroup, ColumnGroups
from .llvm import Emitter
from .llvm_text import LlvmWriter
from .places import RowPlaces
from .processor import Precision

WIDTH = 64
"""Bytes of a vector of columns; processors with shorter ones take two or four in its place."""


def lane_column_programs(
    columns: ColumnGroups, places: RowPlaces, precision: Precision, *, fused: bool
) -> Iterator[str]:
    """A function for each group: so many columns, from the place of the first row of the first on."""
    for number, group in enumerate(columns.groups):
        w = LlvmWriter(precision, WIDTH // precision.bytes, fused=fused)
        lanes = ", ".join(f"i64 {k}" for k in range(w.lanes))
        first = w.new(f"insertelement <{w.lanes} x i64> poison, i64 %count, i32 0")
        count = w.new(
            f"shufflevector <{w.lanes} x i64> {first}, <{w.lanes} x i64> poison, <{w.lanes} x i32> zeroinitializer"
        )
        e = _Columns(w, columns, group, places, w.new(f"icmp ult <{w.lanes} x i64> <{lanes}>, {count}"))
        e.walk(0, len(group.program.instructions), columns.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f"define internal void @column{number}(ptr noalias %frame, ptr noalias %column, i64 %count) noinline"
        yield f'{head} "stackrealign" {{\nentry:\n{body}\n  ret void\n}}\n'


def call_lane_columns(w: LlvmWriter, columns: ColumnGroups, places: RowPlaces) -> None:
    """Call the functions."""
    for number, group in enumerate(columns.groups):
        for matrix, column, count in _runs(group, WIDTH // w.precision.bytes):
            entry, base = places.place(columns.entry(matrix, 0, column))
            place = w.at(base, entry * w.precision.bytes)
            w.do(f"call void @column{number}(ptr %frame, ptr {place}, i64 {count})")


def _runs(group: ColumnGroup, most: int) -> Iterator[tuple[int, int, int]]:
    """Columns of a group that follow each other, at most so many: the matrix, the first, and how many."""
    start, count = group.places[0], 0
    for matrix, column in group.places:
        if count == most or (matrix, column) != (start[0], start[1] + count):
            yield *start, count
            start, count = (matrix, column), 0
        count += 1
    yield *start, count


class _Columns(Emitter):
    """An emitter that finds what columns share in the frame, a number for all lanes, and columns in the rows of a matrix."""

    def __init__(self, w: LlvmWriter, columns: ColumnGroups, group: ColumnGroup, places: RowPlaces, mask: str) -> None:
        super().__init__(w, group.program)
        self.mask = f"{w.mask} {mask}"
        self.shared, _ = places.place(columns.first_entries[-columns.shared])
        self.row = group.program.inputs[-1].size * w.precision.bytes
        self.before = sum(port.size for port in group.program.inputs[:-1])

    def meet(self, number: int) -> None:
        """Leave an input until it is used."""

    def value(self, number: int) -> str:
        """The vector of an instruction."""
        op, _, value = self.program.instructions[number]
        if op == "input" and number not in self.values:
            self.values[number] = self.input(int(value))
        return super().value(number)

    def input(self, number: int) -> str:
        """The vector of an input."""
        w, size = self.w, self.w.precision.bytes
        if number >= self.before:
            place = w.at("%column", (number - self.before) * self.row)
            zeros = f"{w.vector} zeroinitializer"
            return w.new(
                f"call {w.vector} @llvm.masked.load.{w.suffix}.p0(ptr {place}, i32 {size}, {self.mask}, {zeros})"
            )
        place = w.at("%frame", (self.shared + number) * size)
        shared = w.new(f"load {w.element}, ptr {place}, align {size}")
        first = w.new(f"insertelement {w.vector} poison, {w.element} {shared}, i32 0")
        return w.new(f"shufflevector {w.vector} {first}, {w.vector} poison, <{w.lanes} x i32> zeroinitializer")

    def output(self, number: int, value: str) -> None:
        """Put an entry of the solutions into its row."""
        w, place = self.w, self.w.at("%column", number * self.row)
        w.do(
            f"call void @llvm.masked.store.{w.suffix}.p0({w.vector} {value}, ptr {place}, i32 {w.precision.bytes}, {self.mask})"
        )
