"""Cuts of a long program into parts, and a frame of vectors in memory for values that cross a cut.

Each part is a function of its own, which keeps the compile time linear in the length of the program. A place for a vector in
the frame is a *slot*. The first slots belong to all result entries, in order. Slots for other values that a later part uses
follow; each is reused after the last use of its value. Inputs and constants have no slots: every part loads them from their
origin.
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

RELOADABLE_OPERATIONS = ("const", "input")
"""Operations whose values every part can load from their origin."""


@dataclass(frozen=True)
class SpillFrame:
    """Cuts of a program into parts of about ``length`` instructions, and slots for its values."""

    program: Program
    length: int  # of a part, about [instructions]

    @cached_property
    def starts(self) -> list[int]:
        """First instruction of each part, and the end of the program.

        A part has 1/2 to 3/2 of ``length`` instructions. It ends where the fewest values are live: computed before, used later.
        """
        end = len(self.program.instructions)
        live_count_changes = [0] * (end + 1)
        for number, last_use in enumerate(self._last_uses):
            if last_use:
                live_count_changes[number + 1] += 1
                live_count_changes[last_use + 1] -= 1
        live_counts = list(accumulate(live_count_changes))  # before each instruction
        max_length = self.length * 3 // 2
        starts = [0]
        while end - starts[-1] > max_length:
            earliest_cut = starts[-1] + self.length // 2
            latest_cut = starts[-1] + max_length
            cut = min(range(earliest_cut, latest_cut), key=live_counts.__getitem__)
            starts.append(cut)
        return [*starts, end]

    @cached_property
    def _last_uses(self) -> list[int]:
        """Number of the last instruction that uses each value; 0 for unused values, inputs and constants."""
        instructions = self.program.instructions
        last_uses = [0] * len(instructions)
        for number, (_, operands, _) in enumerate(instructions):
            for operand in operands:
                if instructions[operand].op not in RELOADABLE_OPERATIONS:
                    last_uses[operand] = number
        return last_uses

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
        """Runs of equal constant entries of the results: first entry, number of entries, value."""
        runs: list[tuple[int, int, float]] = []
        for k, result in enumerate(self.program.results):
            op, _, value = self.program.instructions[result]
            if op != "const":
                continue
            if runs:
                first_entry, count, run_value = runs[-1]
                if first_entry + count == k and run_value == value:  # the run goes on
                    runs[-1] = first_entry, count + 1, value
                    continue
            runs.append((k, 1, value))
        return runs

    @cached_property
    def slots(self) -> dict[int, int]:
        """Slot of each value that a later part uses: its result entry if it has one, otherwise one after the entries."""
        slots: dict[int, int] = {}
        free_slots: list[int] = []
        slots_by_last_part: dict[int, list[int]] = {}  # by number of the part that uses their values last
        size = len(self.program.results)
        for part, (first, end) in enumerate(pairwise(self.starts)):
            for number in range(first, end):
                last_use = self._last_uses[number]
                if last_use < end:  # no later part uses the value
                    continue
                if number in self.entries:
                    slots[number] = self.entries[number][0]  # equal entries: any of them
                    continue
                if not free_slots:
                    free_slots.append(size)
                    size += 1
                slots[number] = free_slots.pop()
                last_part = bisect_right(self.starts, last_use) - 1
                slots_by_last_part.setdefault(last_part, []).append(slots[number])
            # Slots become free after the part, since it may still read their values.
            free_slots.extend(slots_by_last_part.pop(part, ()))
        return slots

    @cached_property
    def size(self) -> int:
        """Number of vectors in the frame."""
        last_slot = max(self.slots.values(), default=-1)
        return max(len(self.program.results), last_slot + 1)


def _slot_address(w: LlvmWriter, slot: int | str, base: str) -> str:
    """Address of a slot relative to ``base``; ``slot`` is a number, or the name of an i64."""
    vector_bytes = w.lanes * w.precision.bytes
    if isinstance(slot, int):
        return w.gep(base, slot * vector_bytes)
    return w.gep(base, w.new(f"mul i64 {slot}, {vector_bytes}"))


def load_slot(w: LlvmWriter, slot: int | str, base: str = "%frame") -> str:
    """Load a vector from its slot in the frame, relative to ``base``."""
    address = _slot_address(w, slot, base)
    return w.new(f"load {w.vector}, ptr {address}, align {w.lanes * w.precision.bytes}")


def store_slot(w: LlvmWriter, value: str, slot: int | str, base: str = "%frame") -> None:
    """Store a vector in its slot in the frame, relative to ``base``."""
    address = _slot_address(w, slot, base)
    w.do(f"store {w.vector} {value}, ptr {address}, align {w.lanes * w.precision.bytes}")


def frame_to_rows(w: LlvmWriter, base: str, columns: int, entry: int, label: str, zeros: str = "") -> str:
    """Write rows of ``columns`` elements at ``base`` from the slots starting at ``entry``.

    A loop writes the tiles from the left. If they do not fill the row, one more tile ends with the row. ``label`` is the label
    of the current block; the label of the block afterwards is returned. ``zeros`` is the name of a table of
    :func:`zero_tiles`, or empty; tiles that are all zero need no loads.
    """
    rows = RowStorer(w, base, columns)
    if not rows.starts:  # too narrow for tiles
        for c in range(columns):
            rows.put(c, load_slot(w, entry + c))
        return label
    with w.loop(str(columns // rows.span), label) as tile:
        first_column = w.new(f"mul i64 {tile}, {rows.span}")
        after_tile = ""
        if zeros:
            full = w.label("full")
            empty = w.label("empty")
            after_tile = w.label("stored")
            zero_address = w.gep(f"@{zeros}", tile)
            is_zero = w.new(f"load i1, ptr {zero_address}, align 1")
            w.do(f"br i1 {is_zero}, label %{empty}, label %{full}")
            w.begin(empty)
            byte_offset = w.new(f"mul i64 {first_column}, {w.precision.bytes}")
            address = w.gep(base, byte_offset)
            RowStorer(w, address, columns).clear()
            w.do(f"br label %{after_tile}")
            w.begin(full)
        first_slot = w.new(f"add i64 {first_column}, {entry}")
        _store_tile(w, base, columns, first_column, first_slot)
        if after_tile:
            w.do(f"br label %{after_tile}")
            w.begin(after_tile)
    label = w.after
    if columns % rows.span:
        last_column = columns - rows.span  # the first one of the last tile
        first_slot = w.new(f"add i64 0, {entry + last_column}")
        _store_tile(w, base, columns, str(last_column), first_slot)
    return label


def zero_tiles(name: str, is_zero: Sequence[bool], span: int) -> str:
    """Constant table with 1 for each tile of a row that is all zero, else 0; empty if no tile is all zero.

    ``is_zero`` tells the columns that are zero, and ``span`` is the number of columns of a tile.
    """
    tiles = [is_zero[first : first + span] for first in range(0, len(is_zero) - span + 1, span)]
    is_zero_tile = [int(all(tile)) for tile in tiles]
    if not any(is_zero_tile):
        return ""
    return f"@{name} = internal constant [{len(is_zero_tile)} x i8] [{typed_list('i8', is_zero_tile)}]"


def _store_tile(w: LlvmWriter, base: str, columns: int, first_column: str, first_slot: str) -> None:
    """Write one tile, from slots in the frame that start at ``first_slot``."""
    byte_offset = w.new(f"mul i64 {first_column}, {w.precision.bytes}")
    address = w.gep(base, byte_offset)
    storer = RowStorer(w, address, columns)
    for c in range(storer.span):
        slot = w.new(f"add i64 {first_slot}, {c}")
        storer.put(c, load_slot(w, slot))


def preparation(w: LlvmWriter, constants: Sequence[tuple[int, int, float]], name: str = "prepare") -> str:
    """Text of a function that stores constant result entries in the frame, once for all blocks: no block overwrites them."""
    label = "entry"
    for first_entry, count, value in constants:
        with w.loop(str(count), label) as k:
            vector = w.splat(value)
            slot = w.new(f"add i64 {k}, {first_entry}")
            store_slot(w, vector, slot)
        label = w.after
    body = "\n".join(w.lines)
    return f"define internal void @{name}(ptr %frame) noinline {{\nentry:\n{body}\n  ret void\n}}\n"


# A layout says where slots are. There are two: all slots in the frame, or, for one lane, result entries in the output rows.

MAX_STORE_BYTES = 64
"""Maximum size of a store of constants [bytes]."""


class FrameLayout:
    """Layout with every slot in the frame."""

    pointer = "ptr noalias"
    """Pointer type. ``noalias`` lets LLVM move loads before stores."""

    def __init__(self, columns: ColumnSolve) -> None:
        self.inputs = len(columns.inputs)
        """Number of inputs."""
        self.arrays = self.inputs
        """Number of arrays that a part accesses."""

    @property
    def pointers(self) -> list[str]:
        """Arguments of a part: pointers to the arrays that it accesses, and to the frame."""
        return [*(f"%a{k}" for k in range(self.arrays)), "%frame"]

    def place(self, slot: int) -> tuple[int, str]:
        """Index of a slot from a pointer on, and the pointer."""
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
        """Index of a slot from a pointer on, and the pointer."""
        result = bisect_right(self.starts, slot) - 1  # number of the result; of the frame, one after the last
        pointer = "%frame" if slot >= self.starts[-1] else f"%a{self.inputs + result}"
        return slot - self.starts[result], pointer

    def fill(self, w: LlvmWriter, first: int, count: int, value: float) -> None:
        """Store a constant in ``count`` slots from ``first`` on."""
        element_bytes = w.precision.bytes
        max_length = MAX_STORE_BYTES // element_bytes
        slot = first
        end = first + count
        while slot < end:
            index, base = self.place(slot)
            next_array = bisect_right(self.starts, slot)
            array_end = self.starts[next_array] if next_array < len(self.starts) else end
            length = min(end - slot, array_end - slot, max_length)  # of one store, within one array
            constant = f"splat ({w.element} {w.number(value)})"
            address = w.gep(base, index * element_bytes)
            w.do(f"store <{length} x {w.element}> {constant}, ptr {address}, align {element_bytes}")
            slot += length
