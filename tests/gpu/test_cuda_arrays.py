"""robot.cuda and other libraries' arrays: PyTorch's and CuPy's as far as they are used, DLPack, and our own."""

from __future__ import annotations

import ctypes
import gc
import sys
import types

import numpy as np
import pytest
from fake_gpu import CLOSE, NEEDS_COMPILERS, Bare, Lent, states

import twistwrench as tw
from twistwrench.cuda import to_device
from twistwrench.kernels import dlpack
from twistwrench.testing import assert_close

pytest_plugins = ("cuda_fixtures",)
pytestmark = NEEDS_COMPILERS


@pytest.fixture
def torch(gpu, monkeypatch):
    """What of PyTorch is used; its tensors speak version 2 of the interface, without a stream."""
    module = types.ModuleType("torch")

    class Tensor:
        def __init__(self, array, device=0, requires_grad=False):
            self.array, self.dtype, self.requires_grad = gpu.put(array, device), f"torch.{array.dtype}", requires_grad
            self.device = types.SimpleNamespace(type="cuda", index=device)

        @property
        def __cuda_array_interface__(self):
            if self.requires_grad:
                raise RuntimeError(
                    "Can't get __cuda_array_interface__ on Variable that requires grad. … use var.detach()"
                )
            about = Bare(gpu, self.array, self.device.index).__cuda_array_interface__ | {"version": 2}
            del about["stream" if "stream" in about else "strides"]
            return about | {"strides": self.array.strides}

    Tensor.__module__ = "torch"
    module.Tensor = Tensor
    module.empty = lambda shape, dtype, device: Tensor(np.empty(shape, dtype.removeprefix("torch.")), device.index)
    module.cuda = types.SimpleNamespace(
        current_stream=lambda device: types.SimpleNamespace(cuda_stream=1000 + device.index)
    )
    monkeypatch.setitem(sys.modules, "torch", module)
    return module


def test_tensors_in_a_tensor_out_on_the_current_stream(gpu, arm, torch):
    class Named(torch.Tensor):
        """Classes derived from theirs count as theirs."""

    q, dq, ddq = states(arm, 30, dtype=np.float32)
    for kind in (torch.Tensor, Named):
        tau = arm.cuda.inverse_dynamics(kind(q, 1), kind(dq, 1), kind(ddq, 1))
        assert type(tau) is torch.Tensor and tau.dtype == "torch.float32" and tau.device.index == 1
        assert_close(tau.array, arm.inverse_dynamics(q, dq, ddq), 1e-4)
    assert gpu.of("cuLaunchKernel")[0].endswith("stream 1001")
    assert not gpu.of("cuEventRecord") and not gpu.of("cuMemAlloc_v2")
    with pytest.raises(tw.ValueRangeError, match=r"q does not hand out its memory: Can't get(?s:.*)detach"):
        arm.cuda.mass_matrix(torch.Tensor(q, requires_grad=True))


def test_cupy_arrays_in_a_cupy_array_out_on_their_device(gpu, arm, monkeypatch):
    module, entered = types.ModuleType("cupy"), []

    class ndarray(Bare):
        pass

    class Device:
        def __init__(self, number):
            self.number = number

        def __enter__(self):
            entered.append(self.number)

        def __exit__(self, *_):
            entered.append(None)

    ndarray.__module__ = "cupy"
    module.empty = lambda shape, dtype: ndarray(gpu, np.empty(shape, dtype), entered[-1], stream=2)
    module.cuda = types.SimpleNamespace(Device=Device)
    monkeypatch.setitem(sys.modules, "cupy", module)
    given = states(arm, 30)
    tau = arm.cuda.inverse_dynamics(*(ndarray(gpu, a, 1, stream=2) for a in given))
    assert type(tau) is ndarray and entered == [1, None]
    assert_close(tau.array, arm.inverse_dynamics(*given), CLOSE)
    assert gpu.of("cuLaunchKernel")[0].endswith("stream 2") and not gpu.of("cuEventRecord")


def test_dlpack_in_without_copies_and_given_back(gpu, arm):
    given = states(arm, 30)
    lent = [Lent(gpu, a) for a in given]
    before = [sys.getrefcount(x.array) for x in lent]
    tau = arm.cuda.inverse_dynamics(*lent)
    assert_close(tau.to_numpy(), arm.inverse_dynamics(*given), CLOSE)
    gc.collect()
    assert [sys.getrefcount(x.array) for x in lent] == before
    assert [x.streams for x in lent] == [[1]] * 3  # they are ready for the default stream, where the launch goes
    columns = Lent(gpu, np.ones((30, 4))[:, 1:3])
    arm.cuda.mass_matrix(columns)


def test_dlpack_out_is_the_same_memory_and_outlives_the_array(gpu, arm):
    q = states(arm, 30)[0]
    M = arm.cuda.mass_matrix(Bare(gpu, q))
    assert M.__dlpack_device__() == (dlpack.CUDA, 0)
    before, address = gpu.library.fake_allocated(), M.address
    gpu.reset()
    taken = dlpack.Borrowed(M.__dlpack__(stream=55, max_version=(1, 0)))
    assert (taken.address, taken.shape, taken.strides, taken.dtype) == (address, (30, 2, 2), (4, 2, 1), np.float64)
    assert gpu.of("cuStreamWaitEvent") == ["cuStreamWaitEvent stream 55 flags 0"]
    unused = M.__dlpack__()
    del M
    gc.collect()
    assert gpu.library.fake_allocated() == before
    there = np.ctypeslib.as_array(ctypes.cast(taken.address, ctypes.POINTER(ctypes.c_double)), (30, 2, 2))
    assert_close(there, arm.mass_matrix(q), CLOSE)
    del unused
    gc.collect()
    assert gpu.library.fake_allocated() == before  # the capsule that was taken still holds it
    del taken, there
    gc.collect()
    assert gpu.library.fake_allocated() == before - 1
    with pytest.raises(BufferError, match="no copy"):
        to_device([1.0]).__dlpack__(copy=True)


def test_to_the_device_and_back(gpu, arm):
    for values in ([[0.1, 0.2]], np.arange(6, dtype=np.int16).reshape(3, 2), np.ones((4, 2), np.float32)[::2]):
        there = to_device(values, device=1)
        array = np.asarray(values)
        assert there.device == 1 and there.dtype == (array.dtype if array.dtype == np.float32 else float)
        np.testing.assert_array_equal(there.to_numpy(), array)
        assert_close(arm.cuda.gravity_forces(there).to_numpy(), arm.gravity_forces(np.asarray(values)), 1e-6)
    assert repr(there) == "<DeviceArray of shape (2, 2), float32, on GPU 1>"
    for bad in ([[1.0], [2.0, 3.0]], "text", [1j]):
        with pytest.raises(tw.ValueRangeError, match="array of real numbers"):
            to_device(bad)
