"""Programs as CUDA kernels with one thread per sample; the same text is valid C++ for the processor.

Statements are those of exported C, so ``-fmad=false`` fuses the same products and no others. Sine, cosine and exponential are
CUDA's accurate ones.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ir.program import Program
from .c99 import FUSED_MACROS, PRECISIONS, CFunction, statements

THREADS = 128
"""Block size, four warps."""

PRELUDE = """\
#define THREADS {threads}u

#ifdef __CUDACC__
#define EACH_SAMPLE(i, samples) \\
    if (const long long i = (long long)blockIdx.x * blockDim.x + threadIdx.x; i < (samples))
#define SINCOS(x, s, c) sincos{suffix}((x), (s), (c))
#define INLINE static __device__ __forceinline__
#else /* the same on a processor, sample after sample */
#include <math.h>
#define __global__
#define __restrict__
#define __launch_bounds__(threads)
#define EACH_SAMPLE(i, samples) for (long long i = 0; i < (samples); i++)
#define SINCOS(x, s, c) (*(s) = sin{suffix}(x), *(c) = cos{suffix}(x))
#define INLINE static inline
#endif
"""

OPTIONS = ("-std=c++17", "-fmad=false")
"""Options of a CUDA compiler: the language, and no fusion by the compiler."""

MAX_OPTIMISED_LENGTH, LESS_OPTIMISATION = 10_000, "--ptxas-options=-O1"
"""Number of instructions above which the last optimisations are skipped, which would take minutes. Results do not change."""


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

    @property
    def options(self) -> tuple[str, ...]:
        """Options of the run-time compiler."""
        if len(self.program.instructions) > MAX_OPTIMISED_LENGTH:
            return (*OPTIONS, LESS_OPTIMISATION)
        return OPTIONS

    @property
    def source(self) -> str:
        """Complete text: a kernel for a CUDA compiler; for a C++ compiler, a function that runs it on the processor."""
        real, suffix = self.precision, PRECISIONS[self.precision]
        names = CFunction(self.name, self.program, self.precision).parameters
        inputs, outputs = names[: len(self.program.inputs)], names[len(self.program.inputs) :]
        row_parameters, arrays, rows = [], [], []
        for x in inputs:
            row_parameters.append(f"const {real} *__restrict__ {x}")
            arrays.append(f"const {real} *{x}, long long {x}_step")
            rows.append(f"{x} + i * {x}_step")
        entries: list[str] = []
        for y, port in zip(outputs, self.program.outputs, strict=True):
            row_parameters.append(f"{real} *__restrict__ {y}")
            arrays.append(f"{real} *{y}")
            rows.append(f"{y} + i * {port.size}")
            entries += [f"{y}[{k}]" for k in range(port.size)]
        stores = zip(entries, self.program.results, strict=True)
        body = statements(self.program, real, names, stores, sincos="SINCOS")
        call = ["    EACH_SAMPLE(i, samples) compute_row(", f"{_one_a_line(rows, 8)});"]
        kernel = f'extern "C" __global__ void __launch_bounds__(THREADS) {self.name}'
        return "\n".join([
            PRELUDE.format(threads=THREADS, suffix=suffix),
            FUSED_MACROS.format(fma=f"fma{suffix}"),
            f"INLINE void compute_row(\n{_one_a_line(row_parameters, 4)})", "{", *body, "}\n",
            f"{kernel}(\n{_one_a_line(['long long samples', *arrays], 4)})", "{", *call, "}\n",
        ])  # fmt: skip


def _one_a_line(parts: list[str], indent: int) -> str:
    """Parts separated by commas, one a line."""
    return ",\n".join(" " * indent + part for part in parts)
