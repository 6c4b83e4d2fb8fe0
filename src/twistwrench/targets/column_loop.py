"""The columns of results in a frame, one after the other: a function for each group, and the loop that calls it.

A column's entries are as far apart as a row of its matrix is long. Its solution takes their places. What a function reads of
the frame beside its column is not in the matrices, so the two pointers it takes share nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..program.column_groups import ColumnGroup, ColumnGroups
from .llvm import Emitter
from .llvm_text import LlvmWriter
from .spill_frame_text import load_home, store_home


def column_programs(columns: ColumnGroups, writer: Callable[[], LlvmWriter]) -> Iterator[str]:
    """A table of the groups' columns, and their functions."""
    for number, group in enumerate(columns.groups):
        w = writer()
        places = [columns.entry(matrix, 0, column) for matrix, column in group.places]
        listed = ", ".join(f"i64 {place * w.lanes * w.precision.bytes}" for place in places)
        yield f"@columns{number} = internal constant [{len(places)} x i64] [{listed}]"
        e = _Column(w, columns, group)
        e.walk(0, len(group.program.instructions), columns.stored_entries(group), large=False)
        body = "\n".join(w.lines)
        head = f'define internal void @column{number}(ptr noalias %frame, ptr noalias %column) noinline "stackrealign"'
        yield f"{head} {{\nentry:\n{body}\n  ret void\n}}\n"


def column_loop(w: LlvmWriter, columns: ColumnGroups, label: str) -> str:
    """Call the functions; takes the label control comes from and returns the one it is in afterwards."""
    for number, group in enumerate(columns.groups):
        for entry, value in _constants(columns, group):  # the columns of the last block are in their places
            store_home(w, w.splat(value), entry)
        with w.loop(str(len(group.places)), label) as k:
            place = w.new(f"load i64, ptr {w.at(f'@columns{number}', w.new(f'mul i64 {k}, 8'))}, align 8")
            w.do(f"call void @column{number}(ptr %frame, ptr {w.at('%frame', place)})")
        label = w.after
    return label


def _constants(columns: ColumnGroups, group: ColumnGroup) -> Iterator[tuple[int, float]]:
    """The constants among the entries that a group's program takes."""
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
    """An emitter that finds what columns share in the frame, and a column in its places."""

    def __init__(self, w: LlvmWriter, columns: ColumnGroups, group: ColumnGroup) -> None:
        super().__init__(w, group.program)
        self.shared = columns.first_entries[-columns.shared]
        self.row = group.program.inputs[-1].size
        self.before = sum(port.size for port in group.program.inputs[:-1])

    def input(self, number: int) -> str:
        """The vector of an input."""
        if number < self.before:
            return load_home(self.w, self.shared + number)
        return load_home(self.w, (number - self.before) * self.row, "%column")

    def output(self, number: int, value: str) -> None:
        """Put an entry of the solution into its place."""
        store_home(self.w, value, number * self.row, "%column")
