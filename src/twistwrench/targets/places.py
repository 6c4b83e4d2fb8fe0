"""Where sections keep values: all in the frame, or for blocks of one lane the entries of results in the rows themselves."""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate

from ..program.column_groups import ColumnGroups
from .llvm_text import LlvmWriter

WIDEST_STORE = 64
"""Bytes of constants that are written at once."""


class FramePlaces:
    """Every home is a vector of the frame."""

    pointer = "ptr noalias"
    """A pointer's type: where it shares memory with no other, loads are moved before stores."""

    def __init__(self, columns: ColumnGroups) -> None:
        self.inputs = len(columns.inputs)

    @property
    def pointers(self) -> list[str]:
        """What a section takes: the inputs, and the frame."""
        return [*(f"%a{k}" for k in range(self.inputs)), "%frame"]

    def place(self, home: int) -> tuple[int, str]:
        """The number of a home, and the pointer from which it is counted."""
        return home, "%frame"


class RowPlaces(FramePlaces):
    """The homes of entries of results are the entries, where a vector is one number; the frame has the others."""

    pointer = "ptr"
    """Loads of results that were moved before stores would take registers for longer, which one lane wants for itself."""

    def __init__(self, columns: ColumnGroups) -> None:
        super().__init__(columns)
        self.starts = [0, *accumulate(port.size for port in columns.outputs)]

    @property
    def pointers(self) -> list[str]:
        """What a section takes: the inputs, the results, and the frame."""
        return [*(f"%a{k}" for k in range(self.inputs + len(self.starts) - 1)), "%frame"]

    def place(self, home: int) -> tuple[int, str]:
        """The number of a home, and the pointer from which it is counted."""
        result = bisect_right(self.starts, home) - 1
        return home - self.starts[result], "%frame" if home >= self.starts[-1] else f"%a{self.inputs + result}"

    def fill(self, w: LlvmWriter, first: int, count: int, value: float) -> None:
        """Store a constant in so many homes from ``first`` on."""
        size, end = w.precision.bytes, first + count
        while first < end:
            number, base = self.place(first)
            nearest = min((start - first for start in self.starts if start > first), default=count)
            together = min(end - first, nearest, WIDEST_STORE // size)
            constant = f"splat ({w.element} {w.number(value)})"
            w.do(f"store <{together} x {w.element}> {constant}, ptr {w.at(base, number * size)}, align {size}")
            first += together
