"""Programs as CUDA kernels: the text above a kernel, and functions that copy rows through shared memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from ..ir.program import Program, TensorSpec
from .c99 import FUSED_MACROS, PRECISIONS, CFunction, statements

PRELUDE = """\
#define THREADS {threads}u

#ifdef __CUDACC__
#define SHARED __shared__ __align__(16)
#define EACH_BLOCK(block, blocks) if (const long long block = blockIdx.x; block < (blocks))
#define EACH_THREAD(t) if (const unsigned t = threadIdx.x; t < THREADS)
#define TOGETHER __syncthreads()
#define SINCOS(x, s, c) sincos{suffix}((x), (s), (c))
#define UNROLLED _Pragma("unroll 16")
#define INLINE static __device__ __forceinline__
#else /* the same on a processor: block after block, and in each what stands between two TOGETHER thread after thread */
#include <math.h>
#define __global__
#define __device__
#define __restrict__
#define __launch_bounds__(threads)
#define SHARED static
#define EACH_BLOCK(block, blocks) for (long long block = 0; block < (blocks); block++)
#define EACH_THREAD(t) for (unsigned t = 0; t < THREADS; t++)
#define TOGETHER
#define SINCOS(x, s, c) (*(s) = sin{suffix}(x), *(c) = cos{suffix}(x))
#define UNROLLED
#define INLINE static inline
#endif
"""

PLACE = """\
/* Where element i of rows of n elements lies in a tile: rows begin an odd number of elements apart, for the banks' sake. */
template <unsigned n> INLINE unsigned place(unsigned i) {{ return n % 2 ? i : i + i / n; }}
"""

ROWS_IN = """\
/* Rows of n elements, `step` elements apart, into a tile. */
template <unsigned n>
INLINE void whole_rows_in(unsigned t, {real} *tile, const {real} *__restrict__ from)
{{
    UNROLLED
    for (unsigned k = 0; k < n; k++)
        tile[place<n>(t + k * THREADS)] = from[t + k * THREADS];
}}

template <unsigned n>
INLINE void rows_in(unsigned t, unsigned rows, {real} *tile, const {real} *__restrict__ from, long long step)
{{
    if (rows == THREADS && step == n)
        whole_rows_in<n>(t, tile, from);
    else
        for (unsigned i = t; i < rows * n; i += THREADS)
            tile[place<n>(i)] = from[i / n * step + i % n];
}}
"""

ROWS_OUT = """\
/* Rows of n elements out of a tile, without gaps. */
template <unsigned n>
INLINE void rows_out(unsigned t, unsigned rows, const {real} *tile, {real} *__restrict__ to)
{{
    if (rows == THREADS) {{
        UNROLLED
        for (unsigned k = 0; k < n; k++)
            to[t + k * THREADS] = tile[place<n>(t + k * THREADS)];
    }} else
        for (unsigned i = t; i < rows * n; i += THREADS)
            to[i] = tile[place<n>(i)];
}}
"""

TABLE_OUT = """\
/* The same where equal elements are kept once: element k of a row is number table[k] of what is kept, in rows `pitch` apart. */
template <unsigned n, unsigned pitch>
INLINE void table_out(
    unsigned t, unsigned rows, const {real} *tile, const unsigned short *table, {real} *__restrict__ to)
{{
    for (unsigned i = t; i < rows * n; i += THREADS)
        to[i] = tile[i / n * pitch + table[i % n]];
}}
"""


# ── A program as a CUDA kernel with one thread per sample; the same text is valid C++ for the processor

# Rows of the arrays go through shared memory: adjacent threads copy adjacent elements, for any row length, and each thread then
# reads its own row there. Statements are those of exported C, so ``-fmad=false`` fuses the same products and no others. Sine,
# cosine and exponential are CUDA's accurate ones.

OPTIONS = ("-std=c++17", "-fmad=false")
"""Options of a CUDA compiler: the language, and no fusion by the compiler."""

LONG, LESS = 10_000, "--ptxas-options=-O1"
"""Number of instructions above which the last optimisations are skipped, which would take minutes. Results do not change."""

SHARED = 48 * 1024
"""Shared memory that every block can use on every device [bytes]."""

THREADS = (128, 64, 32)
"""Block sizes in whole warps, the preferred one first."""

BYTES = {"float": 4, "double": 8}


@dataclass(frozen=True)
class Tile:
    """Transfer of one array through shared memory, or directly."""

    port: TensorSpec
    """Input or output."""
    name: str
    """Name in the source."""
    kept: tuple[int, ...]
    """Numbers of the stored elements, without duplicates."""
    table: tuple[int, ...] | None = None
    """Position of each element among the stored ones; None if it equals the element's number."""
    staged: bool = True
    """True if the array fits into shared memory; otherwise each thread accesses its own row in global memory."""

    @property
    def pitch(self) -> int:
        """Elements between the rows of adjacent threads, an odd number."""
        return len(self.kept) | 1


@dataclass(frozen=True)
class CudaFunction:
    """Program with the name and precision of its CUDA kernel.

    Kernel arguments: the number of samples (64 bits); for each input a pointer and the distance between its samples in
    elements (64 bits), 0 if all samples share it; for each output a pointer to contiguous rows.
    """

    name: str
    """Name of the kernel."""
    program: Program
    """Program of the kernel."""
    precision: str = "double"
    """"float" or "double"."""
    shared: int = SHARED
    """Available shared memory [bytes]."""

    @property
    def options(self) -> tuple[str, ...]:
        """Options of the run-time compiler."""
        return (*OPTIONS, LESS) if len(self.program.instructions) > LONG else OPTIONS

    @property
    def threads(self) -> int:
        """Number of threads, and samples, per block."""
        return self._layout[0]

    @property
    def tiles(self) -> tuple[Tile, ...]:
        """All arrays, inputs first."""
        return self._layout[1]

    @cached_property
    def _layout(self) -> tuple[int, tuple[Tile, ...]]:
        """Largest block for which all arrays fit, if needed with equal elements stored once and the widest arrays left out."""
        tiles = self._plain_tiles
        if threads := self._fitting(tiles):
            return threads, tiles
        tiles = tuple(_squeezed(tile, number >= len(self.program.inputs)) for number, tile in enumerate(tiles))
        while not (threads := self._fitting(tiles)):
            widest = max((tile for tile in tiles if tile.staged), key=lambda tile: len(tile.kept))
            tiles = tuple(replace(tile, staged=False) if tile is widest else tile for tile in tiles)
        return threads, tuple(tile if tile.staged else replace(tile, table=None) for tile in tiles)

    @property
    def _plain_tiles(self) -> tuple[Tile, ...]:
        names = CFunction(self.name, self.program, self.precision).parameters
        tiles, results = [], iter(self.program.results)
        for number, (name, port) in enumerate(zip(names, (*self.program.inputs, *self.program.outputs), strict=True)):
            output = number >= len(self.program.inputs)
            kept = tuple(next(results) for _ in range(port.size)) if output else tuple(range(port.size))
            tiles.append(Tile(port, name, kept))
        return tuple(tiles)

    def _fitting(self, tiles: Sequence[Tile]) -> int:
        """Largest block that fits, or 0."""
        sample = BYTES[self.precision] * sum(tile.pitch for tile in tiles if tile.staged)
        return next((threads for threads in THREADS if threads * sample <= self.shared), 0)

    @cached_property
    def source(self) -> str:
        """Complete text: a kernel for a CUDA compiler; for a C++ compiler, a function that runs it on the processor."""
        real, suffix = self.precision, PRECISIONS[self.precision]
        staged = [tile for tile in self.tiles if tile.staged]
        made = len(self.program.inputs)
        inputs, outputs = self.tiles[:made], self.tiles[made:]
        helpers = [
            (PLACE, any(tile.table is None for tile in staged)),
            (ROWS_IN, any(tile.staged for tile in inputs)),
            (ROWS_OUT, any(tile.staged and tile.table is None for tile in outputs)),
            (TABLE_OUT, any(tile.table is not None for tile in outputs)),
        ]
        parts = [
            PRELUDE.format(threads=self.threads, suffix=suffix),
            FUSED_MACROS.format(fma=f"fma{suffix}"),
            *(text.format(real=real) for text, needed in helpers if needed),
            *(_table(tile) for tile in outputs if tile.table is not None),
            *self._functions(inputs, outputs),
        ]
        return "\n".join(parts)

    def _functions(self, inputs: Sequence[Tile], outputs: Sequence[Tile]) -> Iterator[str]:
        """Functions that load, compute and store, and the kernel."""
        real = self.precision
        offsets, total = {}, 0
        for tile in self.tiles:
            offsets[tile.name] = total
            total += self.threads * tile.pitch if tile.staged else 0
        into, out = [tile for tile in inputs if tile.staged], [tile for tile in outputs if tile.staged]
        if into:
            parameters = [f"const {real} *__restrict__ {tile.name}, long long {tile.name}_step" for tile in into]
            yield _function("load_rows", ["unsigned t", "unsigned rows", f"{real} *tile", *parameters], [
                f"    if (rows == THREADS && {' && '.join(f'{tile.name}_step == {tile.port.size}' for tile in into)}) {{",
                *(f"        whole_rows_in<{t.port.size}>(t, tile + {offsets[t.name]}, {t.name});" for t in into),
                "    } else {",
                *(
                    f"        rows_in<{t.port.size}>(t, rows, tile + {offsets[t.name]}, {t.name}, {t.name}_step);"
                    for t in into
                ),
                "    }",
            ])  # fmt: skip
        yield _function(
            "compute_row",
            [
                *(f"const {real} *__restrict__ {tile.name}" for tile in inputs),
                *(f"{real} *__restrict__ {tile.name}" for tile in outputs),
            ],
            self._statements(outputs),
        )
        if out:
            yield _function("store_rows", [
                "unsigned t", "unsigned rows", f"const {real} *tile", *(f"{real} *__restrict__ {tile.name}" for tile in out)
            ], [_store(tile, offsets[tile.name]) for tile in out])  # fmt: skip
        yield self._kernel(offsets, total, into, out)

    def _statements(self, outputs: Sequence[Tile]) -> list[str]:
        stores = [
            (f"{tile.name}[{k}]", number)
            for tile in outputs
            for k, number in enumerate(tile.kept if tile.staged else _results(tile, self.program, outputs))
        ]
        names = [tile.name for tile in self.tiles]
        return statements(self.program, self.precision, names, stores, sincos="SINCOS")

    def _kernel(self, offsets: dict[str, int], total: int, into: Sequence[Tile], out: Sequence[Tile]) -> str:
        real, made = self.precision, len(self.program.inputs)
        inputs, outputs = self.tiles[:made], self.tiles[made:]
        rows = [
            f"tile + {offsets[tile.name]} + t * {tile.pitch}"
            if tile.staged
            else f"{tile.name} + (first + t) * {f'{tile.name}_step' if tile in inputs else tile.port.size}"
            for tile in self.tiles
        ]
        loaded = "".join(f", {tile.name} + first * {tile.name}_step, {tile.name}_step" for tile in into)
        stored = "".join(f", {tile.name} + first * {tile.port.size}" for tile in out)
        parameters = [
            "long long samples",
            *(f"const {real} *{tile.name}, long long {tile.name}_step" for tile in inputs),
            *(f"{real} *{tile.name}" for tile in outputs),
        ]
        lines = [
            *([f"    SHARED {real} tile[{total}];"] if total else []),
            "    EACH_BLOCK(block, (samples + THREADS - 1) / THREADS) {",
            "        const long long first = block * THREADS;",
            "        const unsigned rows = samples - first < THREADS ? (unsigned)(samples - first) : THREADS;",
            *([f"        EACH_THREAD(t) load_rows(t, rows, tile{loaded});", "        TOGETHER;"] if into else []),
            f"        EACH_THREAD(t) if (t < rows) compute_row(\n            {f',{chr(10)}            '.join(rows)});",
            *(["        TOGETHER;", f"        EACH_THREAD(t) store_rows(t, rows, tile{stored});"] if out else []),
            "    }",
        ]
        head = f'extern "C" __global__ void __launch_bounds__(THREADS) {self.name}'
        return f"{head}(\n    {f',{chr(10)}    '.join(parameters)})\n{{\n{chr(10).join(lines)}\n}}\n"


def _squeezed(tile: Tile, output: bool) -> Tile:
    """Output tile that stores equal elements once, if that saves memory."""
    kept = tuple(dict.fromkeys(tile.kept))
    if not output or len(kept) == len(tile.kept):
        return tile
    slots = {number: slot for slot, number in enumerate(kept)}
    return replace(tile, kept=kept, table=tuple(slots[number] for number in tile.kept))


def _results(tile: Tile, program: Program, outputs: Sequence[Tile]) -> Sequence[int]:
    """Instruction that computes each element of an output, including duplicates."""
    first = sum(other.port.size for other in outputs[: outputs.index(tile)])
    return program.results[first : first + tile.port.size]


def _store(tile: Tile, offset: int) -> str:
    size, here = tile.port.size, f"tile + {offset}"
    if tile.table is None:
        return f"    rows_out<{size}>(t, rows, {here}, {tile.name});"
    return f"    table_out<{size}, {tile.pitch}>(t, rows, {here}, table_{tile.name}, {tile.name});"


def _table(tile: Tile) -> str:
    entries = tile.table or ()
    lines = [", ".join(map(str, entries[k : k + 24])) for k in range(0, len(entries), 24)]
    body = ",\n    ".join(lines)
    return f"static __device__ const unsigned short table_{tile.name}[{len(entries)}] = {{\n    {body}}};\n"


def _function(name: str, parameters: Sequence[str], lines: Sequence[str]) -> str:
    head = f"INLINE void {name}(\n    {f',{chr(10)}    '.join(parameters)})"
    return "\n".join([head, "{", *lines, "}\n"])
