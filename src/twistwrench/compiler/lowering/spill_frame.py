"""Cuts of a long program, and a frame of vectors in memory for values that cross a cut.

One function per part keeps the compile time linear in the length of the program. The frame begins with all result entries, in
order. Slots for other values that a later part uses follow; each is reused after the last use of its value. Inputs and
constants have no slots, because every part loads them from their origin.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

from ..ir.loops import ColumnSolve
from ..ir.program import Program
from .ir_builder import LlvmWriter, RowStorer, typed_list

AT_HAND = ("const", "input")
"""Operations whose values every part can load from their origin."""


@dataclass(frozen=True)
class SpillFrame:
    """Cuts of a program into parts of about ``length`` instructions, and slots for its values."""

    program: Program
    length: int

    @cached_property
    def starts(self) -> list[int]:
        """First instruction of each part, and the end. Cuts are near even ones, at the minimum number of live values."""
        end = len(self.program.instructions)
        born_and_dead = [0] * (end + 1)
        for number, last in enumerate(self._last):
            if last:
                born_and_dead[number + 1] += 1
                born_and_dead[last + 1] -= 1
        living = list(accumulate(born_and_dead))
        starts = [0]
        while end - starts[-1] > self.length * 3 // 2:
            low, high = starts[-1] + self.length // 2, starts[-1] + self.length * 3 // 2
            starts.append(min(range(low, high), key=living.__getitem__))
        return [*starts, end]

    @cached_property
    def _last(self) -> list[int]:
        """Last instruction that uses each value; 0 for unused values, inputs and constants."""
        instructions = self.program.instructions
        last = [0] * len(instructions)
        for number, (_, args, _) in enumerate(instructions):
            for a in args:
                if instructions[a].op not in AT_HAND:
                    last[a] = number
        return last

    @cached_property
    def entries(self) -> dict[int, list[int]]:
        """Result entries by the instruction that computes them, without constants."""
        entries: dict[int, list[int]] = {}
        for k, result in enumerate(self.program.results):
            if self.program.instructions[result].op != "const":
                entries.setdefault(result, []).append(k)
        return entries

    @cached_property
    def constants(self) -> list[tuple[int, int, float]]:
        """Runs of equal constant entries: first entry, length, value."""
        runs: list[tuple[int, int, float]] = []
        for k, result in enumerate(self.program.results):
            op, _, value = self.program.instructions[result]
            if op == "const":
                if runs and runs[-1][0] + runs[-1][1] == k and runs[-1][2] == value:
                    runs[-1] = runs[-1][0], runs[-1][1] + 1, value
                else:
                    runs.append((k, 1, value))
        return runs

    @cached_property
    def slots(self) -> dict[int, int]:
        """Slot of each value that a later part uses: its result entry if it has one, otherwise one after the entries."""
        slots: dict[int, int] = {}
        free: list[int] = []
        spent: dict[int, list[int]] = {}
        size = len(self.program.results)
        for part, (first, end) in enumerate(pairwise(self.starts)):
            for number in range(first, end):
                last = self._last[number]
                if last < end:
                    continue
                if number in self.entries:
                    slots[number] = self.entries[number][0]
                    continue
                if not free:
                    free.append(size)
                    size += 1
                slots[number] = free.pop()
                spent.setdefault(bisect_right(self.starts, last) - 1, []).append(slots[number])
            free.extend(spent.pop(part, ()))  # only now, as the part may still read old values
        return slots

    @cached_property
    def size(self) -> int:
        """Number of vectors in the frame."""
        last_slot = max(self.slots.values(), default=-1)
        return max(len(self.program.results), last_slot + 1)


def _slot_address(w: LlvmWriter, slot: int | str, base: str) -> str:
    """Address of a vector in the frame."""
    size = w.lanes * w.precision.bytes
    if isinstance(slot, int):
        return w.gep(base, slot * size)
    return w.gep(base, w.new(f"mul i64 {slot}, {size}"))


def load_slot(w: LlvmWriter, slot: int | str, base: str = "%frame") -> str:
    """Load a vector from its slot in the frame, relative to ``base``."""
    return w.new(f"load {w.vector}, ptr {_slot_address(w, slot, base)}, align {w.lanes * w.precision.bytes}")


def store_slot(w: LlvmWriter, value: str, slot: int | str, base: str = "%frame") -> None:
    """Store a vector in its slot."""
    w.do(f"store {w.vector} {value}, ptr {_slot_address(w, slot, base)}, align {w.lanes * w.precision.bytes}")


def frame_to_rows(w: LlvmWriter, base: str, columns: int, entry: int, label: str, zeros: str = "") -> str:
    """Write rows from the vectors starting at ``entry``: tiles in a loop, then the last tile, which ends with the row.

    Takes and returns the current label. ``zeros`` is the name of a table of :func:`zero_tiles`.
    """
    whole = RowStorer(w, base, columns)
    if not whole.starts:  # too narrow for tiles
        for c in range(columns):
            whole.put(c, load_slot(w, entry + c))
        return label
    with w.loop(str(columns // whole.span), label) as tile:
        first, stored = w.new(f"mul i64 {tile}, {whole.span}"), ""
        if zeros:
            full, empty, stored = w.label("full"), w.label("empty"), w.label("stored")
            nothing = w.new(f"load i1, ptr {w.gep(f'@{zeros}', tile)}, align 1")
            w.do(f"br i1 {nothing}, label %{empty}, label %{full}")
            w.begin(empty)
            place = w.gep(base, w.new(f"mul i64 {first}, {w.precision.bytes}"))
            RowStorer(w, place, columns).clear()
            w.do(f"br label %{stored}")
            w.begin(full)
        _tile(w, base, columns, first, w.new(f"add i64 {first}, {entry}"))
        if stored:
            w.do(f"br label %{stored}")
            w.begin(stored)
    label = w.after
    if columns % whole.span:
        last = columns - whole.span
        _tile(w, base, columns, str(last), w.new(f"add i64 0, {entry + last}"))
    return label


def zero_tiles(name: str, zero: Sequence[bool], span: int) -> str:
    """Table of the tiles of a row that are all zero; empty if there are none."""
    tiles = [int(all(zero[k : k + span])) for k in range(0, len(zero) - span + 1, span)]
    if not any(tiles):
        return ""
    return f"@{name} = internal constant [{len(tiles)} x i8] [{typed_list('i8', tiles)}]"


def _tile(w: LlvmWriter, base: str, columns: int, first: str, entry: str) -> None:
    place = w.gep(base, w.new(f"mul i64 {first}, {w.precision.bytes}"))
    storer = RowStorer(w, place, columns)
    for c in range(storer.span):
        storer.put(c, load_slot(w, w.new(f"add i64 {entry}, {c}")))


def preparation(w: LlvmWriter, constants: Sequence[tuple[int, int, float]], name: str = "prepare") -> str:
    """Function that stores constant result entries in the frame once per call; blocks do not overwrite them."""
    label = "entry"
    for first, count, value in constants:
        with w.loop(str(count), label) as k:
            store_slot(w, w.splat(value), w.new(f"add i64 {k}, {first}"))
        label = w.after
    body = "\n".join(w.lines)
    return f"define internal void @{name}(ptr %frame) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


# There are two layouts: all slots in the frame, or, for one lane, result entries directly in the output rows.

WIDEST_STORE = 64
"""Size of constants per store [bytes]."""


class FrameLayout:
    """Layout with every slot in the frame."""

    pointer = "ptr noalias"
    """Pointer type. ``noalias`` lets LLVM move loads before stores."""

    def __init__(self, columns: ColumnSolve) -> None:
        self.inputs = self.arrays = len(columns.inputs)

    @property
    def pointers(self) -> list[str]:
        """Arguments of a part: the arrays that it accesses, which are the inputs, and the frame."""
        return [*(f"%a{k}" for k in range(self.arrays)), "%frame"]

    def place(self, slot: int) -> tuple[int, str]:
        """Index of a slot relative to a pointer, and that pointer."""
        return slot, "%frame"


class RowLayout(FrameLayout):
    """Layout for one lane: result entries are stored in the output rows, other slots in the frame."""

    pointer = "ptr"
    """Pointer type, without ``noalias``: loads moved before stores would occupy registers for longer."""

    def __init__(self, columns: ColumnSolve) -> None:
        super().__init__(columns)
        self.starts = [0, *accumulate(port.size for port in columns.outputs)]
        """First slot of each result, and of the frame."""
        self.arrays = self.inputs + len(columns.outputs)

    def place(self, slot: int) -> tuple[int, str]:
        """Index of a slot relative to a pointer, and that pointer."""
        result = bisect_right(self.starts, slot) - 1
        pointer = "%frame" if slot >= self.starts[-1] else f"%a{self.inputs + result}"
        return slot - self.starts[result], pointer

    def fill(self, w: LlvmWriter, first: int, count: int, value: float) -> None:
        """Store a constant in ``count`` slots from ``first`` on."""
        size, end = w.precision.bytes, first + count
        while first < end:
            number, base = self.place(first)
            following = bisect_right(self.starts, first)  # a store ends where the next array begins
            array_end = self.starts[following] if following < len(self.starts) else end
            together = min(end - first, array_end - first, WIDEST_STORE // size)
            constant = f"splat ({w.element} {w.number(value)})"
            w.do(f"store <{together} x {w.element}> {constant}, ptr {w.gep(base, number * size)}, align {size}")
            first += together
