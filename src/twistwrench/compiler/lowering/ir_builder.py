"""LLVM assembly as text: fresh names, splat constants, shuffles, counted loops."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from .target_machine import DOUBLE, Precision


def typed_list(kind: str, values: Iterable[object]) -> str:
    """Values with their type, as in ``i64 1, i64 2``: arguments of a call, or entries of a constant table."""
    return ", ".join(f"{kind} {value}" for value in values)


class LlvmWriter:
    """Writer of one function whose values are vectors of ``lanes`` elements."""

    def __init__(self, precision: Precision, lanes: int, *, fused: bool = True) -> None:
        self.precision, self.lanes, self.fused = precision, lanes, fused
        self.element = precision.llvm
        self.vector = f"<{lanes} x {self.element}>"
        self.integer = f"<{lanes} x i{precision.bits}>"
        self.mask = f"<{lanes} x i1>"
        self.suffix = f"v{lanes}f{precision.bits}"
        self.lines: list[str] = []
        self._names = 0

    def name(self) -> str:
        """Return a fresh local name."""
        self._names += 1
        return f"%t{self._names}"

    def label(self, stem: str) -> str:
        """Return a fresh label."""
        self._names += 1
        return f"{stem}{self._names}"

    def labels(self, *stems: str) -> tuple[str, ...]:
        """Return a fresh label for each stem."""
        return tuple(self.label(stem) for stem in stems)

    def do(self, text: str) -> None:
        """Add an instruction without a result."""
        self.lines.append(f"  {text}")

    def new(self, text: str) -> str:
        """Add an instruction and name its result."""
        name = self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def begin(self, label: str) -> None:
        """Start a basic block."""
        self.lines.append(f"{label}:")

    # ── constants ──

    def number(self, value: float) -> str:
        """Scalar constant, exact to the bit."""
        return f"0x{DOUBLE.pattern(self.precision.rounded(value)) % 2**64:016X}"

    def splat(self, value: float) -> str:
        """Vector with the same constant in every lane."""
        return f"splat ({self.element} {self.number(value)})"

    def bits(self, value: int) -> str:
        """Vector with the same integer in every lane."""
        return f"splat (i{self.precision.bits} {value})"

    # ── vector operations ──

    def binary(self, op: str, a: str, b: str) -> str:
        """Binary operation ``op`` of two vectors, as in ``fadd``."""
        return self.new(f"{op} {self.vector} {a}, {b}")

    def negate(self, a: str) -> str:
        """Negation of a vector."""
        return self.new(f"fneg {self.vector} {a}")

    def intrinsic(self, op: str, *operands: str) -> str:
        """Vector intrinsic, as in ``fma``."""
        return self.new(f"call {self.vector} @llvm.{op}.{self.suffix}({typed_list(self.vector, operands)})")

    def fma(self, a: str, b: str, c: str) -> str:
        """a b + c, rounded once; without hardware fma rounded twice, since LLVM would call the C library for each lane."""
        if self.fused:
            return self.intrinsic("fma", a, b, c)
        return self.binary("fadd", self.binary("fmul", a, b), c)

    def select(self, condition: str, a: str, b: str) -> str:
        """For each lane, a if the condition holds, else b."""
        return self.new(f"select {self.mask} {condition}, {self.vector} {a}, {self.vector} {b}")

    def shuffle(self, a: str, b: str, indices: Sequence[int], length: int | None = None) -> str:
        """Elements of a and b by index through both, each of ``length``."""
        source = f"<{length or self.lanes} x {self.element}>"
        return self.new(
            f"shufflevector {source} {a}, {source} {b}, <{len(indices)} x i32> <{typed_list('i32', indices)}>"
        )

    def gep(self, base: str, offset: int | str) -> str:
        """Pointer moved by ``offset`` bytes."""
        return self.new(f"getelementptr i8, ptr {base}, i64 {offset}")

    # ── samples, ``lanes`` per vector ──

    def blocks(self, samples: str) -> str:
        """Number of vectors that hold the samples; the last may be partly filled."""
        return self.new(f"sdiv i64 {self.new(f'add i64 {samples}, {self.lanes - 1}')}, {self.lanes}")

    def share(self, samples: str, first: str) -> tuple[str, str]:
        """Number of samples in the vector that begins with sample ``first``, and an i1 that is true if it is not full."""
        rest = self.new(f"sub i64 {samples}, {first}")
        short = self.new(f"icmp slt i64 {rest}, {self.lanes}")
        return self.new(f"select i1 {short}, i64 {rest}, i64 {self.lanes}"), short

    # ── control ──

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        """Context whose code runs only if the i1 ``condition`` holds."""
        inside, end = self.label("then"), self.label("done")
        self.do(f"br i1 {condition}, label %{inside}, label %{end}")
        self.begin(inside)
        self.after = inside
        yield
        self.do(f"br label %{end}")
        self.begin(end)
        self.after = end

    @contextmanager
    def loop(self, count: str, block: str) -> Iterator[str]:
        """Loop with an i64 counter from 0 to ``count``; ``block`` is the label before it. It ends in a block named ``.end``.

        Yields the counter; :attr:`after` is the label after the loop.
        """
        head, body, latch, end = self.labels("head", "body", "latch", "end")
        counter, following = self.name(), self.name()
        self.do(f"br label %{head}")
        self.begin(head)
        self.do(f"{counter} = phi i64 [0, %{block}], [{following}, %{latch}]")
        more = self.new(f"icmp slt i64 {counter}, {count}")
        self.do(f"br i1 {more}, label %{body}, label %{end}")
        self.begin(body)
        self.after = body
        yield counter
        self.do(f"br label %{latch}")
        self.begin(latch)
        self.do(f"{following} = add i64 {counter}, 1")
        self.do(f"br label %{head}")
        self.begin(end)
        self.after = end


# ── Conversion between rows and lanes, in registers

# A block has ``lanes`` consecutive rows of a C-contiguous array. Each row is loaded in pieces of 128 bits, which shuffles join
# and transpose. The last piece ends with the row and overlaps its neighbour, so nothing is masked or read past the end. A
# piece is loaded at the first use of one of its columns, and stored as soon as its columns are complete.


def _pieces(columns: int, width: int) -> list[int]:
    """First columns of the pieces that cover a row."""
    if columns < width:
        return []
    starts = list(range(0, columns - width + 1, width))
    if columns % width:
        starts.append(columns - width)  # overlaps its neighbour
    return starts


class _Rows:
    """Array of ``lanes`` rows of ``columns`` elements at ``base``."""

    def __init__(self, w: LlvmWriter, base: str, columns: int) -> None:
        self.w, self.base, self.columns = w, base, columns
        self.width = 16 // w.precision.bytes
        self.groups = w.lanes // self.width
        self.align = w.precision.bytes
        self.piece = f"<{self.width} x {w.element}>"
        self.starts: list[int] = []  # stays empty if there are fewer lanes than a piece is wide: one by one
        if self.groups:
            self.starts = _pieces(columns, self.width)

    def address(self, row: int, column: int) -> str:
        return self.w.gep(self.base, (row * self.columns + column) * self.w.precision.bytes)

    def within(self, a: str, b: str, picks: list[int]) -> str:
        """Shuffle with the same pattern in every 128-bit group; picks number the group's elements of a, then of b."""
        first_of_b = self.w.lanes - self.width  # shuffles number the elements of b after all of a
        indices: list[int] = []
        for group in range(self.groups):
            for i in picks:
                of_b = i >= self.width
                indices.append(group * self.width + i + of_b * first_of_b)
        return self.w.shuffle(a, b, indices)

    def transpose(self, v: list[str]) -> list[str]:
        """Transpose the width × width squares formed by the groups of ``width`` vectors; self-inverse."""
        if self.width == 2:
            return [self.within(v[0], v[1], [0, 2]), self.within(v[0], v[1], [1, 3])]
        low, high = [0, 4, 1, 5], [2, 6, 3, 7]
        a, b = self.within(v[0], v[1], low), self.within(v[2], v[3], low)
        c, d = self.within(v[0], v[1], high), self.within(v[2], v[3], high)
        first, second = [0, 1, 4, 5], [2, 3, 6, 7]
        return [
            self.within(a, b, first),
            self.within(a, b, second),
            self.within(c, d, first),
            self.within(c, d, second),
        ]


class RowLoader(_Rows):
    """Columns of an input array, each loaded once."""

    def __init__(self, w: LlvmWriter, base: str, columns: int) -> None:
        super().__init__(w, base, columns)
        self._ready: dict[int, str] = {}

    def column(self, c: int) -> str:
        """Vector of one column."""
        if c not in self._ready:
            start = next((s for s in self.starts if s <= c < s + self.width), None)
            if start is None:
                self._ready[c] = self._gather(c)
            else:
                for k, vector in enumerate(self._load(start)):
                    self._ready.setdefault(start + k, vector)
        return self._ready[c]

    def _load(self, start: int) -> list[str]:
        joined = []
        for k in range(self.width):
            parts = [
                self.w.new(f"load {self.piece}, ptr {self.address(g * self.width + k, start)}, align {self.align}")
                for g in range(self.groups)
            ]
            size = self.width
            while len(parts) > 1:
                pairs = zip(parts[::2], parts[1::2], strict=True)
                parts = [self.w.shuffle(a, b, range(2 * size), size) for a, b in pairs]
                size *= 2
            joined.append(parts[0])
        return self.transpose(joined)

    def _gather(self, c: int) -> str:
        w, vector = self.w, "poison"
        for row in range(w.lanes):
            x = w.new(f"load {w.element}, ptr {self.address(row, c)}, align {self.align}")
            vector = w.new(f"insertelement {w.vector} {vector}, {w.element} {x}, i32 {row}")
        return vector


class RowStorer(_Rows):
    """Columns of an output array, stored tile by tile as they become complete.

    Stores limit the speed of wide results, so a tile is two pieces wide in long rows, which halves their number.
    """

    def __init__(self, w: LlvmWriter, base: str, columns: int) -> None:
        super().__init__(w, base, columns)
        self.span = self.width  # columns of a tile
        if columns >= 2 * self.width:
            self.span = 2 * self.width
        self._ready: dict[int, str] = {}
        self._missing: dict[int, int] = {}
        """Number of columns that each tile lacks, by the tile's first column."""
        if self.groups:
            self._missing = dict.fromkeys(_pieces(columns, self.span), self.span)
        self._single = not self._missing

    def put(self, c: int, vector: str) -> None:
        """Store a column; called once per column."""
        self._ready[c] = vector
        if self._single:
            self._scatter(c, vector)
        for start in self._tiles(c):
            self._missing[start] -= 1
            if not self._missing[start]:
                self._store(start)

    def _tiles(self, c: int) -> list[int]:
        """First columns of the tiles with column c: its regular tile, and the last tile, which ends with the row."""
        starts = sorted({c - c % self.span, self.columns - self.span})
        return [start for start in starts if start in self._missing and start <= c]

    def _store(self, start: int) -> None:
        w, width, span = self.w, self.width, self.span
        tile = f"<{span} x {w.element}>"
        left, right = self._transposed(start), self._transposed(start + span - width)
        for k in range(width):
            for g in range(self.groups):
                first = g * width
                picks = list(range(first, first + width))
                if span > width:
                    picks += range(w.lanes + first, w.lanes + first + width)
                part = w.shuffle(left[k], right[k], picks)
                w.do(f"store {tile} {part}, ptr {self.address(g * width + k, start)}, align {self.align}")

    def clear(self) -> None:
        """Store zeros at the position of the first tile."""
        kind = f"<{self.span} x {self.w.element}>"
        for row in range(self.w.lanes):
            self.w.do(f"store {kind} zeroinitializer, ptr {self.address(row, 0)}, align {self.align}")

    def _transposed(self, start: int) -> list[str]:
        return self.transpose([self._ready[start + k] for k in range(self.width)])

    def _scatter(self, c: int, vector: str) -> None:
        w = self.w
        for row in range(w.lanes):
            x = w.new(f"extractelement {w.vector} {vector}, i32 {row}")
            w.do(f"store {w.element} {x}, ptr {self.address(row, c)}, align {self.align}")
