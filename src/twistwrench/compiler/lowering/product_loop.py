"""The loop of products: the program for a block of samples, then its matrices, sample by sample and tile by tile.

A tile is a few rows by a few columns of a matrix; each of its rows is a vector. The last tiles overlap their neighbours, and
entries in both are computed twice. A tile whose entries are of one kind needs one product. A mixed tile computes both products,
and selects one for each entry. Sums are computed in the order of the factors, so an entry's bits do not depend on its tile.
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
"""Minimum number of rows and columns of a matrix: the largest size of a tile."""
_MIXED_TILE = 3
"""Kind of a tile with entries of several kinds; tiles with entries of one kind (BEFORE, AFTER or NEITHER) have that kind."""


def products_over(products: Products, *, fused: bool) -> Loop:
    """Return a writer of the loop of products around the program's blocks; ``fused``: the machine has fused products."""

    def write(name: str, _program: Program, precision: Precision, lanes: int, frame_bytes: int, _group: int) -> str:
        loop = _ProductLoop(products, LlvmWriter(precision, lanes, fused=fused), frame_bytes)
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


def _tile_starts(n: int, tile_size: int) -> list[int]:
    """First rows or columns of the tiles of a matrix with n rows; the last tile ends with the matrix."""
    return [*range(0, n - tile_size, tile_size), n - tile_size]


class _ProductLoop:
    """Writer of one loop and the functions it calls."""

    def __init__(self, products: Products, w: LlvmWriter, frame_bytes: int) -> None:
        self.p = products
        self.w = w
        self.frame_bytes = frame_bytes
        """Size of the program's frame; 0 if it has none."""
        self.bytes = w.precision.bytes
        """Size of a number."""
        self.n = len(products.relations)
        """Number of rows and of columns of a matrix."""
        # Rows and columns of a tile, chosen so that its sums fit into registers. Its vectors may be wider than the program's.
        self.height = 4 if w.lanes * self.bytes >= LINE else 2
        self.width = 8 if w.lanes == 16 else 16
        self.tile_rows = _tile_starts(self.n, self.height)
        self.tile_columns = _tile_starts(self.n, self.width)

    def declaration(self) -> str:
        """Declaration of the fma intrinsic for the vectors of a tile."""
        w = LlvmWriter(self.w.precision, self.width)
        argument_types = ", ".join([w.vector] * 3)
        return f"declare {w.vector} @llvm.fma.{w.suffix}({argument_types})"

    def tables(self) -> str:
        """Tables of the tiles' first rows and columns, and of the kinds of tiles and entries."""
        relations = np.array(self.p.relations)  # kind of each entry
        tile_kinds = []
        for i in self.tile_rows:
            for j in self.tile_columns:
                tile = relations[i : i + self.height, j : j + self.width]
                is_uniform = (tile == tile[0, 0]).all()
                tile_kinds.append(int(tile[0, 0]) if is_uniform else _MIXED_TILE)

        def table(name: str, number_type: str, numbers: list[int]) -> str:
            entries = typed_list(number_type, numbers)
            return f"@tile_{name} = internal constant [{len(numbers)} x {number_type}] [{entries}], align {LINE}"

        return "\n".join(
            [
                table("rows", "i64", self.tile_rows),
                table("columns", "i64", self.tile_columns),
                table("kinds", "i8", tile_kinds),
                table("entries", "i8", relations.ravel().tolist()),
            ]
        )

    # ── one matrix of one sample ──

    def matrix(self, number: int, matrix: Product) -> str:
        """Function that computes a matrix from the factors of one sample."""
        w = LlvmWriter(self.w.precision, self.width, fused=self.w.fused)
        tile = w.new(f"alloca [{self.height * self.width} x {w.element}], align {LINE}")
        with w.loop(str(len(self.tile_rows)), "entry") as a:
            i = self._load_index(w, "@tile_rows", a)
            with w.loop(str(len(self.tile_columns)), w.after) as b:
                j = self._load_index(w, "@tile_columns", b)
                first_tile_of_row = w.new(f"mul i64 {a}, {len(self.tile_columns)}")
                tile_number = w.new(f"add i64 {first_tile_of_row}, {b}")
                kind = w.new(f"load i8, ptr {w.gep('@tile_kinds', tile_number)}, align 1")
                first_entry_of_row = w.new(f"mul i64 {i}, {self.n}")
                first_entry = w.new(f"add i64 {first_entry_of_row}, {j}")
                corner = w.gep("%matrix", w.new(f"mul i64 {first_entry}, {self.bytes}"))
                for uniform_kind, factors in ((BEFORE, matrix.before), (AFTER, matrix.after)):
                    with w.when(w.new(f"icmp eq i8 {kind}, {uniform_kind}")):
                        self._compute_tile(w, factors, i, j, corner, self.n)
                with w.when(w.new(f"icmp eq i8 {kind}, {NEITHER}")):
                    for row in range(self.height):
                        self._store(w, w.splat(0.0), w.gep(corner, row * self.n * self.bytes))
                with w.when(w.new(f"icmp eq i8 {kind}, {_MIXED_TILE}")):
                    self._compute_tile(w, matrix.before, i, j, tile, self.width)
                    self._compute_tile(w, matrix.after, i, j, corner, self.n)
                    for row in range(self.height):
                        entry_kinds = w.gep("@tile_entries", first_entry)
                        before_row = w.gep(tile, row * self.width * self.bytes)
                        self._select_products(w, entry_kinds, row, before_row, corner)
        for row, column, constant in matrix.added:
            entry = row * self.n + column
            address = w.gep("%matrix", entry * self.bytes)
            product = w.new(f"load {w.element}, ptr {address}, align {self.bytes}")
            total = w.new(f"fadd {w.element} {product}, {w.number(constant)}")
            w.do(f"store {w.element} {total}, ptr {address}, align {self.bytes}")
        factor_pointers = [f"%f{k}" for k in range(len(self.p.program.outputs))]
        arguments = typed_list("ptr", ["%matrix", *factor_pointers])
        body = "\n".join(w.lines)
        return f"define internal void @matrix{number}({arguments}) noinline {{\nentry:\n{body}\n  ret void\n}}\n"

    def _load_index(self, w: LlvmWriter, table: str, number: str) -> str:
        """Load the first row or column of a tile from a table, by the tile's number; entries have 8 bytes."""
        address = w.gep(table, w.new(f"mul i64 {number}, 8"))
        return w.new(f"load i64, ptr {address}, align 8")

    def _store(self, w: LlvmWriter, vector: str, address: str) -> None:
        """Store a row of a tile."""
        w.do(f"store {w.vector} {vector}, ptr {address}, align {self.bytes}")

    def _load(self, w: LlvmWriter, address: str) -> str:
        """Load a row of a tile."""
        return w.new(f"load {w.vector}, ptr {address}, align {self.bytes}")

    def _compute_tile(
        self, w: LlvmWriter, factors: tuple[int, int], i: str, j: str, corner: str, row_length: int
    ) -> None:
        """Compute the product of two factors for all entries of the tile at row i and column j of the matrix.

        The factors are given by number. The tile is stored at ``corner``, in rows that are ``row_length`` elements apart.
        """
        left, right = factors
        term_count = self.p.program.outputs[left].shape[1]
        first_row = w.gep(f"%f{left}", w.new(f"mul i64 {i}, {term_count * self.bytes}"))
        first_column = w.gep(f"%f{right}", w.new(f"mul i64 {j}, {self.bytes}"))
        sums: list[str] = []  # one for each row of the tile
        for k in range(term_count):
            right_row = self._load(w, w.gep(first_column, k * self.n * self.bytes))
            for row in range(self.height):
                address = w.gep(first_row, (row * term_count + k) * self.bytes)
                left_entry = w.new(f"load {w.element}, ptr {address}, align {self.bytes}")
                in_lane_0 = w.new(f"insertelement {w.vector} poison, {w.element} {left_entry}, i32 0")
                in_all_lanes = w.shuffle(in_lane_0, in_lane_0, [0] * self.width)
                if k == 0:
                    sums.append(w.binary("fmul", in_all_lanes, right_row))
                else:
                    sums[row] = w.fma(in_all_lanes, right_row, sums[row])
        for row, row_sum in enumerate(sums):
            self._store(w, row_sum, w.gep(corner, row * row_length * self.bytes))

    def _select_products(self, w: LlvmWriter, entry_kinds: str, row: int, before_row: str, corner: str) -> None:
        """Select the product that each entry in a row of a mixed tile needs.

        The matrix, from the tile's ``corner`` on, has the products of kind AFTER already; those of kind BEFORE are at
        ``before_row``.
        """
        after_row = w.gep(corner, row * self.n * self.bytes)
        kinds = w.new(f"load <{self.width} x i8>, ptr {w.gep(entry_kinds, row * self.n)}, align 1")
        is_after = w.new(f"icmp eq <{self.width} x i8> {kinds}, splat (i8 {AFTER})")
        is_zero = w.new(f"icmp eq <{self.width} x i8> {kinds}, splat (i8 {NEITHER})")
        product = w.select(is_after, self._load(w, after_row), self._load(w, before_row))
        self._store(w, w.select(is_zero, w.splat(0.0), product), after_row)

    # ── all samples ──

    def write(self) -> None:
        """Write the body of the loop function."""
        w, p = self.w, self.p
        ports = [*p.inputs, *p.outputs]
        samples, bases, strides = call_arrays(w, ports)
        input_count = len(p.inputs)
        factors = p.program.outputs
        vectors_per_matrix = -(-self.n * self.n // w.lanes)  # rounded up
        one_matrix = TensorSpec("one matrix", (vectors_per_matrix,))
        sizes = buffer_sizes(w, [*p.inputs, *factors, one_matrix])
        results = [(bases[k], ports[k].shape, strides[k]) for k in range(input_count, len(ports))]  # get NaN on failure
        allocation, label, all_buffers = allocate(w, [*sizes, self.frame_bytes], samples, results)
        *buffers, matrix, frame = all_buffers
        frame_argument = [frame] if self.frame_bytes else []
        if self.frame_bytes:
            w.do(f"call void @prepare(ptr {frame})")
        matrix_bytes = self.n * self.n * self.bytes
        max_samples_in_caches = BEYOND_CACHES // (matrix_bytes * len(p.matrices))
        exceeds_caches = w.new(f"icmp sgt i64 {samples}, {max_samples_in_caches}")
        with w.loop(w.blocks(samples), label) as block:
            first_sample = w.new(f"mul i64 {block}, {w.lanes}")
            sample_count, _ = w.share(samples, first_sample)  # of this block
            for k, port in enumerate(p.inputs):
                batch_stride, _ = strides[k]
                source = w.gep(bases[k], w.new(f"mul i64 {first_sample}, {batch_stride}"))
                call_copy(w, "gather", buffers[k], source, sample_count, port.shape, strides[k])
            call_block(w, [*buffers, *frame_argument])
            with w.loop(sample_count, w.after) as lane:
                sample = w.new(f"add i64 {first_sample}, {lane}")
                factors_of_lane = []
                for buffer, port in zip(buffers[input_count:], factors, strict=True):
                    offset = w.new(f"mul i64 {lane}, {port.size * self.bytes}")
                    factors_of_lane.append(w.gep(buffer, offset))
                for number in range(len(p.matrices)):
                    base = bases[input_count + number]
                    batch_stride, core_strides = strides[input_count + number]
                    result = w.gep(base, w.new(f"mul i64 {sample}, {batch_stride}"))
                    # A matrix is computed in place if its array is contiguous and stays in the caches; otherwise in a
                    # buffer, from which it is copied past the caches, or by strides.
                    columns_adjoin = w.new(f"icmp eq i64 {core_strides[1]}, {self.bytes}")
                    rows_adjoin = w.new(f"icmp eq i64 {core_strides[0]}, {self.n * self.bytes}")
                    is_contiguous = w.new(f"and i1 {columns_adjoin}, {rows_adjoin}")
                    can_stream = self._can_stream(exceeds_caches, result)
                    streams = w.new(f"and i1 {can_stream}, {is_contiguous}")
                    stays = w.new(f"xor i1 {streams}, true")
                    in_place = w.new(f"and i1 {is_contiguous}, {stays}")
                    target = w.new(f"select i1 {in_place}, ptr {result}, ptr {matrix}")
                    call_block(w, [target, *factors_of_lane], f"matrix{number}")
                    with w.when(streams):
                        vector_count = matrix_bytes // (w.lanes * self.bytes)
                        w.do(f"call void @stream(ptr {matrix}, ptr {result}, i64 {vector_count})")
                    with w.when(w.new(f"xor i1 {is_contiguous}, true")):
                        call_copy(w, "scatter", matrix, result, "1", (self.n, self.n), (batch_stride, core_strides))
        with w.when(exceeds_caches):
            w.do("fence seq_cst")  # orders the nontemporal writes for other threads
        w.do(f"call void @free(ptr {allocation})")

    def _can_stream(self, exceeds_caches: str, result: str) -> str:
        """Condition (i1): the results exceed the caches, and the matrix at ``result`` consists of aligned whole vectors."""
        w = self.w
        vector_bytes = self.w.lanes * self.bytes
        if vector_bytes < SHORTEST_PIECE or self.n * self.n * self.bytes % vector_bytes:
            return "false"
        address = w.new(f"ptrtoint ptr {result} to i64")
        misalignment = w.new(f"and i64 {address}, {vector_bytes - 1}")
        is_aligned = w.new(f"icmp eq i64 {misalignment}, 0")
        return w.new(f"and i1 {exceeds_caches}, {is_aligned}")
