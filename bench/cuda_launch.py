"""Compile a CUDA kernel written by ``robot.export_cuda`` with nvcc and launch it on arrays of the host."""

import ctypes
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

LAUNCHER = """
#include <cuda_runtime.h>
#include <vector>

/* Copy the inputs to the GPU, launch the kernel `repeats` times, copy the outputs back; milliseconds of one launch. */
extern "C" int launch(long long samples, int inputs, int outputs, void **host, const size_t *bytes, long long *steps,
                      int repeats, float *milliseconds)
{
    std::vector<void *> device(inputs + outputs), arguments{&samples};
    for (int i = 0; i < inputs + outputs; i++) {
        if (cudaError_t e = cudaMalloc(&device[i], bytes[i])) return e;
        if (cudaError_t e = cudaMemcpy(device[i], host[i], bytes[i], cudaMemcpyHostToDevice)) return e;
        arguments.push_back(&device[i]);
        if (i < inputs) arguments.push_back(&steps[i]);
    }
    cudaEvent_t begin, end;
    cudaEventCreate(&begin);
    cudaEventCreate(&end);
    const dim3 blocks((unsigned)((samples + THREADS - 1) / THREADS));
    cudaEventRecord(begin);
    for (int i = 0; i < repeats; i++)
        cudaLaunchKernel((const void *)KERNEL, blocks, dim3(THREADS), arguments.data(), 0, 0);
    cudaEventRecord(end);
    if (cudaError_t e = cudaDeviceSynchronize()) return e;
    cudaEventElapsedTime(milliseconds, begin, end);
    *milliseconds /= repeats;
    for (int i = inputs; i < inputs + outputs; i++)
        if (cudaError_t e = cudaMemcpy(host[i], device[i], bytes[i], cudaMemcpyDeviceToHost)) return e;
    for (void *pointer : device) cudaFree(pointer);
    return cudaGetLastError();
}
"""


def compile_kernel(source: str, name: str, folder: Path, options: Sequence[str]) -> ctypes.CDLL:
    """Shared library of the kernel ``name`` and its launcher."""
    file, library = folder / f"{name}.cu", folder / f"{name}.so"
    file.write_text(f"{source}\n{LAUNCHER.replace('KERNEL', name)}")
    command = ["nvcc", *options, "-arch=native", "-O3", "-shared", "-Xcompiler", "-fPIC", file, "-o", library]
    subprocess.run([*map(str, command)], check=True)
    return ctypes.CDLL(str(library))


def launch(
    library: ctypes.CDLL, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray], samples: int, repeats: int = 1
) -> float:
    """Fill ``outputs`` and return seconds per launch, copies not counted. An input of one row serves all samples."""
    arrays = [*inputs, *outputs]
    if not all(a.flags.c_contiguous for a in arrays):
        raise ValueError("arrays must be contiguous in C order")
    steps = [0 if len(a) == 1 < samples else a[0].size for a in inputs]
    milliseconds = ctypes.c_float()
    error = library.launch(
        ctypes.c_longlong(samples),
        len(inputs),
        len(outputs),
        (ctypes.c_void_p * len(arrays))(*(a.ctypes.data for a in arrays)),
        (ctypes.c_size_t * len(arrays))(*(a.nbytes for a in arrays)),
        (ctypes.c_longlong * len(steps))(*steps),
        repeats,
        ctypes.byref(milliseconds),
    )
    if error:
        raise RuntimeError(f"CUDA error {error}")
    return milliseconds.value / 1e3
