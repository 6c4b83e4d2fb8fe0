"""A GPU in the processor's memory, for the tests: ``fake_cuda.c`` stands in for the driver and for the run-time compiler.

So the very Python that talks to a GPU runs, and the very source, as C++. What is not tested is the hardware, and whether NVIDIA's
libraries do what their manuals say.
"""

from __future__ import annotations

import ctypes
import shutil
import sys

import numpy as np
import pytest

from twistwrench.kernels import dlpack

NEEDS_COMPILERS = pytest.mark.skipif(
    not (shutil.which("cc") and shutil.which("c++") and sys.platform == "linux"), reason="no C compiler: cc, c++"
)

CLOSE = 1e-12
"""Of torques of double precision at ordinary states: some 1000 roundings of 1e-16, with another library's sine."""


class Gpu:
    """The stand-in, seen by the tests."""

    def __init__(self, library):
        self.library = library
        library.fake_history.restype = ctypes.c_char_p

    def reset(self, device=0):
        self.library.fake_reset(device)

    def fail(self, function, code):
        self.library.fake_fail(function.encode(), code)

    @property
    def calls(self):
        return self.library.fake_history().decode().splitlines()

    def of(self, function):
        return [line for line in self.calls if line.startswith(function + " ")]

    def put(self, array, device=0):
        """Let an array of NumPy's count as memory of a GPU; kept, so that no other comes to lie there."""
        KEPT.append(array)
        whole = array.base if array.base is not None else array
        address = ctypes.c_void_p(whole.__array_interface__["data"][0])
        self.library.fake_register(address, ctypes.c_size_t(max(whole.nbytes, 1)), device, 0)
        return array


KEPT = []


class Bare:
    """An array with nothing but the CUDA array interface."""

    def __init__(self, gpu, array, device=0, **more):
        self.array, self.more = gpu.put(np.asarray(array), device), more

    @property
    def __cuda_array_interface__(self):
        a = self.array
        strides = None if a.flags.c_contiguous else a.strides
        about = {
            "shape": a.shape,
            "typestr": a.dtype.str,
            "data": (a.ctypes.data, False),
            "strides": strides,
            "version": 3,
        }
        return about | self.more


class Lent:
    """An array with nothing but DLPack, in a capsule that NumPy made."""

    def __init__(self, gpu, array, kind=dlpack.CUDA):
        self.array, self.kind, self.streams = gpu.put(np.asarray(array)), kind, []

    def __dlpack_device__(self):
        return self.kind, 0

    def __dlpack__(self, stream=None):
        self.streams.append(stream)
        return self.array.__dlpack__()


def states(robot, *batch, arrays=3, dtype=float):
    rng = np.random.default_rng(5)
    return [rng.standard_normal((*batch, robot.nv)).astype(dtype) for _ in range(arrays)]
