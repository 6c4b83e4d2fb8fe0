"""The loop of products: the program for a block of samples, then its matrices, sample by sample and tile by tile.

A tile is a few rows by a few columns; its columns lie in vectors. The last tiles overlap their neighbours, and overlaps are
computed twice. A tile of one kind needs one product; a mixed tile computes both and selects for each entry. Sums follow the
order of the factors, so an entry's bits do not depend on its tile.
"""

from __future__ import annotations

import numpy as np

from ..ir.loops import AFTER, BEFORE, NEITHER, Product, Products
from ..ir.program import Program, TensorSpec
from .batch_loop import (
    BEYOND_CACHES,
    LINE,
    MEMORY_DECLARATIONS,
    SHORTEST_PIECE,
    Loop,
    allocate,
    buffer_sizes,
    call_arrays,
    call_block,
    call_copy,
    copying,
    loop_function,
    nan_filler,
    streaming,
)
from .ir_builder import LlvmWriter, typed_list
from .target_machine import Precision

MIN_MATRIX_SIZE = 16
"""Minimum number of rows and columns of a matrix."""
_MIXED_TILE = 3
"""Kind of a tile with entries of several kinds; the other kinds are those of entries."""


def products_over(products: Products, *, fused: bool) -> Loop:
    """Return a writer of the loop of products around the program's blocks; ``fused``: the machine has fused products."""

    def write(name: str, _program: Program, precision: Precision, lanes: int, frame: int, _group: int) -> str:
        loop = _Matrices(products, LlvmWriter(precision, lanes, fused=fused), frame)
        loop.write()
        return "\n".join(
            [
                copying("gather", precision, lanes, inward=True),
                copying("scatter", precision, 1, inward=False),
                streaming(precision, lanes),
                nan_filler(precision, lanes),
                MEMORY_DECLARATIONS,
                loop.tables(),
                loop.declaration() if fused else "",
                *(loop.matrix(number, matrix) for number, matrix in enumerate(products.matrices)),
                *loop_function(name, loop.w),
            ]
        )

    return write


def _starts(n: int, step: int) -> list[int]:
    """First rows or columns of the tiles."""
    return [*range(0, n - step, step), n - step]


class _Matrices:
    """Writer of one loop and the functions it calls."""

    def __init__(self, products: Products, w: LlvmWriter, frame: int) -> None:
        self.p, self.w, self.frame = products, w, frame
        self.bytes, self.n = w.precision.bytes, len(products.relations)
        # Tile sizes for which sums fit into registers. Their vectors may be wider than the program's, with other intrinsics.
        self.height = 4 if w.lanes * self.bytes >= LINE else 2
        self.width = 8 if w.lanes == 16 else 16
        self.rows, self.columns = _starts(self.n, self.height), _starts(self.n, self.width)

    def declaration(self) -> str:
        """Declaration of the fma intrinsic."""
        w = LlvmWriter(self.w.precision, self.width)
        return f"declare {w.vector} @llvm.fma.{w.suffix}({', '.join([w.vector] * 3)})"

    def tables(self) -> str:
        """Tables of the tiles' first rows and columns, and of the kinds of tiles and entries."""
        relations = np.array(self.p.relations)
        kinds = []
        for i in self.rows:
            for j in self.columns:
                tile = relations[i : i + self.height, j : j + self.width]
                is_uniform = (tile == tile[0, 0]).all()
                kinds.append(int(tile[0, 0]) if is_uniform else _MIXED_TILE)

        def table(name: str, kind: str, numbers: list[int]) -> str:
            entries = typed_list(kind, numbers)
            return f"@tile_{name} = internal constant [{len(numbers)} x {kind}] [{entries}], align {LINE}"

        return "\n".join(
            [
                table("rows", "i64", self.rows),
                table("columns", "i64", self.columns),
                table("kinds", "i8", kinds),
                table("entries", "i8", relations.ravel().tolist()),
            ]
        )

    # ── one matrix of one sample ──

    def matrix(self, number: int, matrix: Product) -> str:
        """Function that computes a matrix from the factors of one sample."""
        w = LlvmWriter(self.w.precision, self.width, fused=self.w.fused)

        tile = w.new(f"alloca [{self.height * self.width} x {w.element}], align {LINE}")
        with w.loop(str(len(self.rows)), "entry") as a:
            i = self._entry(w, "@tile_rows", a)
            with w.loop(str(len(self.columns)), w.after) as b:
                j = self._entry(w, "@tile_columns", b)
                place = w.new(f"add i64 {w.new(f'mul i64 {a}, {len(self.columns)}')}, {b}")
                kind = w.new(f"load i8, ptr {w.gep('@tile_kinds', place)}, align 1")
                first = w.new(f"add i64 {w.new(f'mul i64 {i}, {self.n}')}, {j}")
                corner = w.gep("%matrix", w.new(f"mul i64 {first}, {self.bytes}"))
                for which, factors in ((BEFORE, matrix.before), (AFTER, matrix.after)):
                    with w.when(w.new(f"icmp eq i8 {kind}, {which}")):
                        self._tile(w, factors, i, j, corner, self.n)
                with w.when(w.new(f"icmp eq i8 {kind}, {NEITHER}")):
                    for row in range(self.height):
                        self._store(w, w.splat(0.0), w.gep(corner, row * self.n * self.bytes))
                with w.when(w.new(f"icmp eq i8 {kind}, {_MIXED_TILE}")):
                    self._tile(w, matrix.before, i, j, tile, self.width)
                    self._tile(w, matrix.after, i, j, corner, self.n)
                    for row in range(self.height):
                        self._choose(
                            w, w.gep("@tile_entries", first), row, w.gep(tile, row * self.width * self.bytes), corner
                        )
        for r, c, x in matrix.added:
            place = w.gep("%matrix", (r * self.n + c) * self.bytes)
            before = w.new(f"load {w.element}, ptr {place}, align {self.bytes}")
            total = w.new(f"fadd {w.element} {before}, {w.number(x)}")
            w.do(f"store {w.element} {total}, ptr {place}, align {self.bytes}")
        arguments = typed_list("ptr", ["%matrix", *(f"%f{k}" for k in range(len(self.p.program.outputs)))])
        body = "\n".join(w.lines)
        return f"define internal void @matrix{number}({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"

    def _entry(self, w: LlvmWriter, table: str, number: str) -> str:
        return w.new(f"load i64, ptr {w.gep(table, w.new(f'mul i64 {number}, 8'))}, align 8")

    def _store(self, w: LlvmWriter, vector: str, place: str) -> None:
        w.do(f"store {w.vector} {vector}, ptr {place}, align {self.bytes}")

    def _load(self, w: LlvmWriter, place: str) -> str:
        return w.new(f"load {w.vector}, ptr {place}, align {self.bytes}")

    def _tile(self, w: LlvmWriter, factors: tuple[int, int], i: str, j: str, corner: str, width: int) -> None:
        """Compute one product for all entries of a tile."""
        left, right = factors
        count = self.p.program.outputs[left].shape[1]
        first = w.gep(f"%f{left}", w.new(f"mul i64 {i}, {count * self.bytes}"))
        beside = w.gep(f"%f{right}", w.new(f"mul i64 {j}, {self.bytes}"))
        sums: list[str] = []
        for k in range(count):
            columns = self._load(w, w.gep(beside, k * self.n * self.bytes))
            for row in range(self.height):
                place = w.gep(first, (row * count + k) * self.bytes)
                x = w.new(f"load {w.element}, ptr {place}, align {self.bytes}")
                one = w.new(f"insertelement {w.vector} poison, {w.element} {x}, i32 0")
                every = w.shuffle(one, one, [0] * self.width)
                if k == 0:
                    sums.append(w.binary("fmul", every, columns))
                else:
                    sums[row] = w.fma(every, columns, sums[row])
        for row, vector in enumerate(sums):
            self._store(w, vector, w.gep(corner, row * width * self.bytes))

    def _choose(self, w: LlvmWriter, entries: str, row: int, before: str, corner: str) -> None:
        """Select the product that each entry in a row of a mixed tile needs."""
        place = w.gep(corner, row * self.n * self.bytes)
        kinds = w.new(f"load <{self.width} x i8>, ptr {w.gep(entries, row * self.n)}, align 1")
        after = w.new(f"icmp eq <{self.width} x i8> {kinds}, splat (i8 {AFTER})")
        none = w.new(f"icmp eq <{self.width} x i8> {kinds}, splat (i8 {NEITHER})")
        found = w.select(after, self._load(w, place), self._load(w, before))
        self._store(w, w.select(none, w.splat(0.0), found), place)

    # ── all samples ──

    def write(self) -> None:
        """Write the body of the loop function."""
        w, p = self.w, self.p
        ports = [*p.inputs, *p.outputs]
        samples, bases, strides = call_arrays(w, ports)
        count, factors = len(p.inputs), p.program.outputs
        one = TensorSpec("one matrix", (-(-self.n * self.n // w.lanes),))
        sizes = buffer_sizes(w, [*p.inputs, *factors, one])
        results = [(bases[k], ports[k].shape, strides[k]) for k in range(count, len(ports))]
        taken, label, (*buffers, matrix, room) = allocate(w, [*sizes, self.frame], samples, results)
        further = [room] if self.frame else []
        if self.frame:
            w.do(f"call void @prepare(ptr {room})")
        size = self.n * self.n * self.bytes
        many = w.new(f"icmp sgt i64 {samples}, {BEYOND_CACHES // (size * len(p.matrices))}")
        with w.loop(w.blocks(samples), label) as block:
            first = w.new(f"mul i64 {block}, {w.lanes}")
            some, _ = w.share(samples, first)
            for k, port in enumerate(p.inputs):
                place = w.gep(bases[k], w.new(f"mul i64 {first}, {strides[k][0]}"))
                call_copy(w, "gather", buffers[k], place, some, port.shape, strides[k])
            call_block(w, [*buffers, *further])
            with w.loop(some, w.after) as lane:
                row = w.new(f"add i64 {first}, {lane}")
                own_factors = []  # of this lane
                for buffer, port in zip(buffers[count:], factors, strict=True):
                    own_factors.append(w.gep(buffer, w.new(f"mul i64 {lane}, {port.size * self.bytes}")))
                for number in range(len(p.matrices)):
                    base, (outer, inner) = bases[count + number], strides[count + number]
                    place = w.gep(base, w.new(f"mul i64 {row}, {outer}"))
                    plain = w.new(f"icmp eq i64 {inner[1]}, {self.bytes}")
                    plain = w.new(f"and i1 {plain}, {w.new(f'icmp eq i64 {inner[0]}, {self.n * self.bytes}')}")
                    past = w.new(f"and i1 {self._may_go_past(many, place)}, {plain}")
                    direct = w.new(f"and i1 {plain}, {w.new(f'xor i1 {past}, true')}")
                    target = w.new(f"select i1 {direct}, ptr {place}, ptr {matrix}")
                    call_block(w, [target, *own_factors], f"matrix{number}")
                    with w.when(past):
                        w.do(f"call void @stream(ptr {matrix}, ptr {place}, i64 {size // (w.lanes * self.bytes)})")
                    with w.when(w.new(f"xor i1 {plain}, true")):
                        call_copy(w, "scatter", matrix, place, "1", (self.n, self.n), (outer, inner))
        with w.when(many):
            w.do("fence seq_cst")  # orders the nontemporal writes for other threads
        w.do(f"call void @free(ptr {taken})")

    def _may_go_past(self, many: str, place: str) -> str:
        """Condition (i1): a matrix should bypass the caches, and can."""
        w, piece = self.w, self.w.lanes * self.bytes
        if piece < SHORTEST_PIECE or self.n * self.n * self.bytes % piece:
            return "false"
        odd = w.new(f"and i64 {w.new(f'ptrtoint ptr {place} to i64')}, {piece - 1}")
        return w.new(f"and i1 {many}, {w.new(f'icmp eq i64 {odd}, 0')}")
