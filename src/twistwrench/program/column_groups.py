"""A program, and matrices among its results whose columns are worked on one by one: a loop where unrolled code is too long.

What all columns have in common, such as the factors they are solved with, the program makes once. Columns whose entries are
zero in the same rows form a group, and a group has one program that takes a column to what takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from .port import Port, signature_of
from .program import Program


@dataclass(frozen=True)
class ColumnGroup:
    """Columns that one program works on. Its inputs are the shared results and a column, its result is the new column."""

    program: Program
    places: tuple[tuple[int, int], ...]
    """The number of a result, a matrix, and of a column of it."""


@dataclass(frozen=True)
class ColumnGroups:
    """A program, and what becomes of the columns of its results."""

    program: Program
    shared: int
    """How many of the last results only the groups take."""
    groups: tuple[ColumnGroup, ...]

    @property
    def inputs(self) -> tuple[Port, ...]:
        """What the kernel takes: what the program does."""
        return self.program.inputs

    @property
    def outputs(self) -> tuple[Port, ...]:
        """What the kernel returns."""
        return self.program.outputs[: len(self.program.outputs) - self.shared]

    @cached_property
    def signature(self) -> str:
        """The gufunc signature."""
        return signature_of([p.shape for p in self.inputs], [p.shape for p in self.outputs])

    @cached_property
    def first_entries(self) -> tuple[int, ...]:
        """By result, the number of its first entry among those of all."""
        found = [0]
        for port in self.program.outputs:
            found.append(found[-1] + port.size)
        return tuple(found[:-1])

    def entry(self, matrix: int, row: int, column: int) -> int:
        """The number of an entry of a matrix among those of all results."""
        port = self.program.outputs[matrix]
        return self.first_entries[matrix] + row * port.shape[1] + column

    def stored_rows(self, group: ColumnGroup) -> list[int]:
        """The rows that are not zero before and after."""
        return [
            row
            for row, nothing in enumerate(group.program.zeros)
            if not (nothing and all(self.program.zeros[self.entry(m, row, c)] for m, c in group.places))
        ]

    def stored_entries(self, group: ColumnGroup) -> dict[int, list[int]]:
        """The rows that each instruction of the group's program makes, of those that are stored."""
        entries: dict[int, list[int]] = {}
        for row in self.stored_rows(group):
            entries.setdefault(group.program.results[row], []).append(row)
        return entries

    @cached_property
    def zeros(self) -> tuple[bool, ...]:
        """Of each entry of the program's results whether it is zero in the end, whatever the inputs."""
        zeros = list(self.program.zeros)
        for group in self.groups:
            rows = self.stored_rows(group)
            for matrix, column in group.places:
                for row in rows:
                    zeros[self.entry(matrix, row, column)] = False
        return tuple(zeros)
