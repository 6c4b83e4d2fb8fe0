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
        self.precision, self.lanes = precision, lanes
        self.fused = fused
        """True if :meth:`fma` rounds once."""
        self.element = precision.llvm
        self.vector = f"<{lanes} x {self.element}>"
        self.integer = f"<{lanes} x i{precision.bits}>"
        self.mask = f"<{lanes} x i1>"  # these four are types
        self.suffix = f"v{lanes}f{precision.bits}"
        """Suffix of intrinsics for these vectors."""
        self.lines: list[str] = []
        self.after = ""
        """Label of the block that :meth:`when` or :meth:`loop` began last."""
        self._name_count = 0

    def name(self) -> str:
        """Return a fresh local name."""
        self._name_count += 1
        return f"%t{self._name_count}"

    def label(self, stem: str) -> str:
        """Return a fresh label."""
        self._name_count += 1
        return f"{stem}{self._name_count}"

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
        """Scalar constant, exact to the bit; LLVM writes float32 numbers with the bits of a double, too."""
        rounded_value = self.precision.rounded(value)
        signed_bits = DOUBLE.pattern(rounded_value)
        return f"0x{signed_bits % 2**64:016X}"  # modulo 2^64: without a sign

    def splat(self, value: float) -> str:
        """Vector with the same constant in every lane."""
        return f"splat ({self.element} {self.number(value)})"

    def bits(self, value: int) -> str:
        """Vector with the same integer in every lane."""
        return f"splat (i{self.precision.bits} {value})"

    # ── vector operations ──

    def binary(self, op: str, a: str, b: str) -> str:
        """Operation of two vectors; ``op`` is an instruction such as ``fadd``."""
        return self.new(f"{op} {self.vector} {a}, {b}")

    def negate(self, a: str) -> str:
        """Negation of a vector."""
        return self.new(f"fneg {self.vector} {a}")

    def intrinsic(self, op: str, *operands: str) -> str:
        """Vector intrinsic; ``op`` is its name, such as ``fma``."""
        arguments = typed_list(self.vector, operands)
        return self.new(f"call {self.vector} @llvm.{op}.{self.suffix}({arguments})")

    def fma(self, a: str, b: str, c: str) -> str:
        """a b + c, rounded once, or twice without fma in hardware, where LLVM's fma calls the C library for each lane."""
        if self.fused:
            return self.intrinsic("fma", a, b, c)
        product = self.binary("fmul", a, b)
        return self.binary("fadd", product, c)

    def select(self, condition: str, a: str, b: str) -> str:
        """For each lane, a if the condition holds, else b."""
        return self.new(f"select {self.mask} {condition}, {self.vector} {a}, {self.vector} {b}")

    def shuffle(self, a: str, b: str, indices: Sequence[int], length: int | None = None) -> str:
        """Elements of a and b by index, which counts the elements of a and then of b; each has ``length`` (default: lanes)."""
        source_length = length or self.lanes
        source_type = f"<{source_length} x {self.element}>"
        pattern = f"<{len(indices)} x i32> <{typed_list('i32', indices)}>"
        return self.new(f"shufflevector {source_type} {a}, {source_type} {b}, {pattern}")

    def gep(self, base: str, offset: int | str) -> str:
        """Pointer moved by ``offset`` bytes."""
        return self.new(f"getelementptr i8, ptr {base}, i64 {offset}")

    # ── samples, ``lanes`` per vector ──

    def blocks(self, samples: str) -> str:
        """Number of vectors that hold the samples; the last may be partly filled."""
        padded_samples = self.new(f"add i64 {samples}, {self.lanes - 1}")
        return self.new(f"sdiv i64 {padded_samples}, {self.lanes}")

    def share(self, samples: str, first: str) -> tuple[str, str]:
        """Number of samples in the vector that begins with sample ``first``, and an i1: true if the vector is not full."""
        remaining = self.new(f"sub i64 {samples}, {first}")
        is_partial = self.new(f"icmp slt i64 {remaining}, {self.lanes}")
        count = self.new(f"select i1 {is_partial}, i64 {remaining}, i64 {self.lanes}")
        return count, is_partial

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
        """Loop with an i64 counter from 0 to ``count`` - 1; ``block`` is the label of the block before the loop.

        Yields the counter. Afterwards, :attr:`after` is the label of the block after the loop.
        """
        head, body, latch, end = self.labels("head", "body", "latch", "end")
        counter, next_counter = self.name(), self.name()
        self.do(f"br label %{head}")
        self.begin(head)
        self.do(f"{counter} = phi i64 [0, %{block}], [{next_counter}, %{latch}]")
        continues = self.new(f"icmp slt i64 {counter}, {count}")
        self.do(f"br i1 {continues}, label %{body}, label %{end}")
        self.begin(body)
        self.after = body
        yield counter
        self.do(f"br label %{latch}")
        self.begin(latch)
        self.do(f"{next_counter} = add i64 {counter}, 1")
        self.do(f"br label %{head}")
        self.begin(end)
        self.after = end


# ── Conversion between rows and lanes, in registers

# A block has ``lanes`` consecutive rows of a C-contiguous array. Each row is loaded in pieces of 128 bits, which shuffles join
# to vectors and transpose: a vector then has one column of all rows. The last piece ends with the row. It overlaps its
# neighbour, so that no lane is masked and nothing past the end of the row is read. A piece of an input is loaded when one of
# its columns is first used. A piece of a result is stored as soon as all its columns are known.


_PIECE_BYTES = 16
"""Size of a piece: 128 bits."""


def _piece_starts(columns: int, width: int) -> list[int]:
    """First columns of the pieces of ``width`` columns that cover a row; empty if the row is shorter than a piece."""
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
        self.width = _PIECE_BYTES // w.precision.bytes
        """Number of elements of a piece."""
        self.groups = w.lanes // self.width
        """Number of groups in a vector, which are as long as a piece; 0 if a vector is shorter."""
        self.align = w.precision.bytes
        """Alignment of rows [bytes]."""
        self.piece = f"<{self.width} x {w.element}>"
        """Type of a piece."""
        self.starts: list[int] = []
        """First column of each piece; empty if elements are loaded and stored one by one."""
        if self.groups:
            self.starts = _piece_starts(columns, self.width)

    def address(self, row: int, column: int) -> str:
        """Pointer to an element."""
        element = row * self.columns + column
        return self.w.gep(self.base, element * self.w.precision.bytes)

    def within(self, a: str, b: str, picks: list[int]) -> str:
        """Shuffle with the same pattern in every group; ``picks`` count the group's elements of a, then those of b."""
        indices: list[int] = []  # count all elements of a, then those of b
        for group in range(self.groups):
            for pick in picks:
                index = group * self.width + pick
                if pick >= self.width:  # an element of b
                    index += self.w.lanes - self.width
                indices.append(index)
        return self.w.shuffle(a, b, indices)

    def transpose(self, v: list[str]) -> list[str]:
        """Transpose the square that each group forms in ``width`` vectors v; the transposed vectors give v again.

        For float64 a square is 2 × 2, for float32 4 × 4.
        """
        if self.width == 2:  # float64
            return [self.within(v[0], v[1], [0, 2]), self.within(v[0], v[1], [1, 3])]
        interleave_low, interleave_high = [0, 4, 1, 5], [2, 6, 3, 7]  # the lower or upper halves, in turn
        a = self.within(v[0], v[1], interleave_low)
        b = self.within(v[2], v[3], interleave_low)
        c = self.within(v[0], v[1], interleave_high)
        d = self.within(v[2], v[3], interleave_high)
        join_low, join_high = [0, 1, 4, 5], [2, 3, 6, 7]  # the lower or upper halves, one after the other
        return [
            self.within(a, b, join_low),
            self.within(a, b, join_high),
            self.within(c, d, join_low),
            self.within(c, d, join_high),
        ]


class RowLoader(_Rows):
    """Columns of an input array, each loaded once."""

    def __init__(self, w: LlvmWriter, base: str, columns: int) -> None:
        super().__init__(w, base, columns)
        self._vectors: dict[int, str] = {}  # of the columns that are loaded

    def column(self, c: int) -> str:
        """Vector of one column."""
        if c not in self._vectors:
            starts = [
                start for start in self.starts if start <= c < start + self.width
            ]  # of the pieces with the column
            if not starts:
                self._vectors[c] = self._load_elements(c)
            else:
                for k, vector in enumerate(self._load(starts[0])):
                    self._vectors.setdefault(starts[0] + k, vector)  # overlapping pieces have some columns twice
        return self._vectors[c]

    def _load(self, start: int) -> list[str]:
        """Vectors of the columns of the piece that begins with column ``start``."""
        vectors = []
        for k in range(self.width):
            parts = []  # pieces of the rows k, k + width, ..., which form a vector
            for group in range(self.groups):
                address = self.address(group * self.width + k, start)
                parts.append(self.w.new(f"load {self.piece}, ptr {address}, align {self.align}"))
            part_length = self.width
            while len(parts) > 1:  # join pairs
                pairs = zip(parts[::2], parts[1::2], strict=True)
                parts = [self.w.shuffle(a, b, range(2 * part_length), part_length) for a, b in pairs]
                part_length *= 2
            vectors.append(parts[0])
        return self.transpose(vectors)

    def _load_elements(self, c: int) -> str:
        """Vector of a column, loaded element by element."""
        w = self.w
        vector = "poison"
        for row in range(w.lanes):
            element = w.new(f"load {w.element}, ptr {self.address(row, c)}, align {self.align}")
            vector = w.new(f"insertelement {w.vector} {vector}, {w.element} {element}, i32 {row}")
        return vector


class RowStorer(_Rows):
    """Columns of an output array, stored tile by tile as soon as all columns of a tile are known.

    The number of stores limits the speed of wide results. In long rows, a tile is two pieces wide, which halves this number.
    """

    def __init__(self, w: LlvmWriter, base: str, columns: int) -> None:
        super().__init__(w, base, columns)
        self.span = self.width
        """Number of columns of a tile."""
        if columns >= 2 * self.width:
            self.span = 2 * self.width
        self._vectors: dict[int, str] = {}  # of the columns that are known
        self._missing_counts: dict[int, int] = {}
        """Number of columns that each tile lacks, by the tile's first column."""
        if self.groups:
            self._missing_counts = dict.fromkeys(_piece_starts(columns, self.span), self.span)
        self._stores_elements = not self._missing_counts

    def put(self, c: int, vector: str) -> None:
        """Add the vector of a column, and store the tiles that it completes; called once per column."""
        self._vectors[c] = vector
        if self._stores_elements:
            self._store_elements(c, vector)
        for start in self._tiles(c):
            self._missing_counts[start] -= 1
            if not self._missing_counts[start]:
                self._store(start)

    def _tiles(self, c: int) -> list[int]:
        """First columns of the tiles with column c: its regular tile, and the last tile, which ends with the row."""
        regular_start = c - c % self.span
        last_start = self.columns - self.span
        starts = sorted({regular_start, last_start})
        return [start for start in starts if start in self._missing_counts and start <= c]

    def _store(self, start: int) -> None:
        """Store the tile that begins with column ``start``, row by row."""
        w, width, span = self.w, self.width, self.span
        tile = f"<{span} x {w.element}>"
        left = self._transposed(start)
        right = self._transposed(start + span - width)
        for k in range(width):
            for group in range(self.groups):
                first = group * width
                indices = list(range(first, first + width))
                if span > width:  # the right piece follows the left one
                    indices += range(w.lanes + first, w.lanes + first + width)
                row_of_tile = w.shuffle(left[k], right[k], indices)
                address = self.address(group * width + k, start)
                w.do(f"store {tile} {row_of_tile}, ptr {address}, align {self.align}")

    def clear(self) -> None:
        """Store zeros in place of the first tile."""
        tile = f"<{self.span} x {self.w.element}>"
        for row in range(self.w.lanes):
            self.w.do(f"store {tile} zeroinitializer, ptr {self.address(row, 0)}, align {self.align}")

    def _transposed(self, start: int) -> list[str]:
        """Pieces of the rows from column ``start`` on, joined to vectors."""
        columns = [self._vectors[start + k] for k in range(self.width)]
        return self.transpose(columns)

    def _store_elements(self, c: int, vector: str) -> None:
        """Store a column element by element."""
        w = self.w
        for row in range(w.lanes):
            element = w.new(f"extractelement {w.vector} {vector}, i32 {row}")
            w.do(f"store {w.element} {element}, ptr {self.address(row, c)}, align {self.align}")
