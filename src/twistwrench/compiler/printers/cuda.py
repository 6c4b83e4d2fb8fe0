"""Programs as CUDA kernels with one thread per sample; the same text is valid C++ for the processor.

Statements are those of exported C, which mark the products that are fused with a sum. With ``-fmad=false``, the compiler fuses
no others. Sine, cosine and exponential are CUDA's accurate functions, not its fast ones.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..ir.program import Program
from .c99 import FUSED_MACROS, PRECISIONS, CFunction, statements

THREADS = 128
"""Number of threads of a block: four warps of 32."""

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
"""Options of a CUDA compiler: the version of C++, and no fusion by the compiler."""

MAX_OPTIMISED_LENGTH = 10_000
"""Maximum number of instructions of a program for the last optimisations; they would take minutes for longer programs."""
LESS_OPTIMISATION = "--ptxas-options=-O1"
"""Option that skips the last optimisations. Results do not change."""


@dataclass(frozen=True)
class CudaFunction:
    """Program with the name and precision of its CUDA kernel.

    Arguments of the kernel are the number of samples, two for each input, and one for each output. An input has a pointer and
    the distance between its samples in elements, 0 if all samples share it. An output has a pointer to contiguous rows. Numbers
    have 64 bits.
    """

    name: str
    """Name of the kernel."""
    program: Program
    """Program of the kernel."""
    precision: str = "double"
    """Type of numbers: "float" or "double"."""

    @property
    def options(self) -> tuple[str, ...]:
        """Options of the compiler for this program."""
        if len(self.program.instructions) > MAX_OPTIMISED_LENGTH:
            return (*OPTIONS, LESS_OPTIMISATION)
        return OPTIONS

    @property
    def source(self) -> str:
        """Complete text: a kernel for a CUDA compiler; for a C++ compiler, a function that runs it on the processor."""
        real = self.precision
        suffix = PRECISIONS[self.precision]  # of the names of functions
        names = CFunction(self.name, self.program, self.precision).parameters
        input_count = len(self.program.inputs)
        inputs = names[:input_count]
        outputs = names[input_count:]
        row_parameters: list[str] = []  # of the function for one sample
        row_arguments: list[str] = []  # in its call for sample i
        kernel_parameters: list[str] = ["long long samples"]
        for name in inputs:
            row_parameters.append(f"const {real} *__restrict__ {name}")
            row_arguments.append(f"{name} + i * {name}_step")
            kernel_parameters.append(f"const {real} *{name}, long long {name}_step")
        entries: list[str] = []  # of all results
        for name, port in zip(outputs, self.program.outputs, strict=True):
            row_parameters.append(f"{real} *__restrict__ {name}")
            row_arguments.append(f"{name} + i * {port.size}")
            kernel_parameters.append(f"{real} *{name}")
            entries += [f"{name}[{k}]" for k in range(port.size)]
        stores = zip(entries, self.program.results, strict=True)
        body = statements(self.program, real, names, stores, sincos="SINCOS")
        call = ["    EACH_SAMPLE(i, samples) compute_row(", f"{_one_per_line(row_arguments, indent=8)});"]
        kernel = f'extern "C" __global__ void __launch_bounds__(THREADS) {self.name}'
        return "\n".join([
            PRELUDE.format(threads=THREADS, suffix=suffix),
            FUSED_MACROS.format(fma=f"fma{suffix}"),
            f"INLINE void compute_row(\n{_one_per_line(row_parameters, indent=4)})", "{", *body, "}\n",
            f"{kernel}(\n{_one_per_line(kernel_parameters, indent=4)})", "{", *call, "}\n",
        ])  # fmt: skip


def _one_per_line(parts: list[str], indent: int) -> str:
    """Parts separated by commas, each on its own line, indented by ``indent`` blanks."""
    return ",\n".join(" " * indent + part for part in parts)
