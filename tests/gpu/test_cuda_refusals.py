"""What robot.cuda refuses, and what it says: arrays, shapes, outputs, and what the driver and the compiler report."""

from __future__ import annotations

import re
import types
from pathlib import Path

import numpy as np
import pytest
from fake_gpu import NEEDS_COMPILERS, Bare, Lent, states

import twistwrench as tw
from twistwrench.cuda import to_device
from twistwrench.kernels import cuda_driver, dlpack, nvrtc

pytest_plugins = ("cuda_fixtures",)
pytestmark = NEEDS_COMPILERS


def test_what_is_no_array_on_a_gpu_is_refused_by_name(gpu, arm):
    q = states(arm, 10)[0]
    for bad, words in (
        (q, r"mass_matrix: q is a numpy\.ndarray.*cupy\.asarray.*torch.*to_device"),
        (q.tolist(), "q is a list"),
        (None, "q is a NoneType"),
        (Lent(gpu, q, dlpack.CPU), r"Lent, which is not in a GPU's memory"),
        (Lent(gpu, q, 10), "DLPack's kind 10"),
        (Lent(gpu, q.astype(int)), "no floating-point"),
        (Bare(gpu, q, mask=q), "masked"),
        (Bare(gpu, q.astype(np.float16)), "q is of type float16.*float32 and float64"),
        (Bare(gpu, q.astype(int)), "q is of type int64"),
        (Bare(gpu, q, typestr=">f8"), "q is of type >f8"),
        (Bare(gpu, q, strides=(17, 8)), "no multiples of their size"),
        (types.SimpleNamespace(__cuda_array_interface__={"shape": (2,)}), "does not hand out its memory"),
    ):
        with pytest.raises(tw.ValueRangeError, match=words):
            arm.cuda.mass_matrix(bad)
    unknown = types.SimpleNamespace(__cuda_array_interface__={"shape": (2,), "typestr": "<f8", "data": (4096, False)})
    with pytest.raises(tw.ValueRangeError, match="the driver knows nothing of it"):
        arm.cuda.mass_matrix(unknown)


def test_shapes_types_and_numbers_of_arrays_are_refused_by_name(gpu, arm):
    q, dq, ddq = (Bare(gpu, a) for a in states(arm, 10))
    for given, error, words in (
        ((q, Bare(gpu, np.ones((10, 3))), ddq), tw.ShapeError, r"inverse_dynamics: dq has shape \(10, 3\), wanted \(…, 2\)"),
        ((q, Bare(gpu, np.ones(())), ddq), tw.ShapeError, r"dq has shape \(\), wanted"),
        ((q, Bare(gpu, np.ones((4, 2))), ddq), tw.ShapeError, r"do not broadcast: q \(10,\), dq \(4,\), ddq \(10,\)"),
        ((q, Bare(gpu, np.ones((10, 2), np.float32)), ddq), tw.ValueRangeError, "several types: q float64, dq float32, ddq float64"),
    ):  # fmt: skip
        with pytest.raises(error, match=words):
            arm.cuda.inverse_dynamics(*given)
    with pytest.raises(tw.UnknownNameError, match="base, com"):
        arm.cuda.momentum(q, dq, frame="tip")
    with pytest.raises(tw.ShapeError, match="2 inputs given, 3 wanted: q, dq, ddq"):
        arm.cuda.kernel("inverse_dynamics")(q, dq)
    assert not gpu.of("cuLaunchKernel")


def test_what_the_driver_refuses_is_reported(gpu, arm):
    given = [Bare(gpu, a) for a in states(arm, 10)]
    gpu.fail("cuLaunchKernel", 700)
    with pytest.raises(
        tw.KernelError, match=r"CUDA: cuLaunchKernel failed: CUDA_ERROR_ILLEGAL_ADDRESS, an illegal memory"
    ):
        arm.cuda.inverse_dynamics(*given)
    gpu.fail("cuMemAlloc_v2", 2)
    with pytest.raises(tw.KernelError, match="cuMemAlloc_v2 failed: error 2"):
        arm.cuda.inverse_dynamics(*given)
    arm.cuda.inverse_dynamics(*given)
    assert gpu.library.fake_depth() == 1


def test_what_the_compiler_refuses_is_reported_with_its_log(gpu, arm):
    gpu.fail("nvrtcCompileProgram", 6)
    with pytest.raises(
        tw.KernelError, match=r"refused the kernel planar_2r_mass_matrix: NVRTC_ERROR_COMPILATION.*\n.*this is the log"
    ):
        arm.cuda.mass_matrix(Bare(gpu, states(arm, 10)[0]))


def test_a_driver_without_a_gpu_is_reported(gpu, arm):
    for code, words in ((100, "finds no GPU"), (3, r"does not start \(error 3\)")):
        gpu.fail("cuInit", code)
        with pytest.raises(tw.KernelError, match=words):
            arm.cuda.mass_matrix(Bare(gpu, states(arm, 10)[0]))
    arm.cuda.mass_matrix(Bare(gpu, states(arm, 10)[0]))  # a failure is not kept


def test_no_driver_and_no_compiler_are_reported_with_what_to_do(gpu, arm, monkeypatch):
    q = Bare(gpu, states(arm, 10)[0])
    monkeypatch.setattr(nvrtc, "_places", lambda: iter(["no-such-compiler.so"]))
    with pytest.raises(tw.MissingExtraError, match=re.escape("pip install 'twistwrench[cuda]'")):
        arm.cuda.mass_matrix(q)
    monkeypatch.setattr(cuda_driver, "_NAMES", ("no-such-driver.so",))
    cuda_driver.driver.cache_clear()
    for call in (lambda: arm.cuda.mass_matrix(q), lambda: to_device([1.0])):
        with pytest.raises(tw.KernelError, match=r"no NVIDIA driver is found.*robot\.cuda\.source"):
            call()


def test_the_compiler_is_looked_for_in_packages_then_toolkits(tmp_path, monkeypatch):
    for folder, name in (("nvidia/cuda_nvrtc/lib", "libnvrtc.so.12"), ("nvidia/cuda_nvrtc/lib", "libnvrtc.alt.so.12"),
                         ("toolkit/lib64", "libnvrtc.so.13")):  # fmt: skip
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        (tmp_path / folder / name).touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("CUDA_HOME", str(tmp_path / "toolkit"))
    found = [place for place in nvrtc._places() if place.startswith(str(tmp_path))]
    assert [Path(place).name for place in found] == ["libnvrtc.so.12", "libnvrtc.so.13"]


def test_samples_that_lie_at_no_fixed_distance_are_refused(gpu, arm):
    q, ddq = (Bare(gpu, a) for a in states(arm, 4, 50, arrays=2))
    row, holes = Bare(gpu, np.ones((4, 1, 2))), Bare(gpu, np.ones((4, 60, 2))[:, :50])
    turned, backwards = Bare(gpu, np.ones((4, 2, 50)).swapaxes(1, 2)), Bare(gpu, np.ones((4, 50, 4))[..., ::2])
    for bad, words in (
        (row, "fixed distance"),
        (holes, "fixed distance"),
        (turned, "next to each other"),
        (backwards, "next to"),
    ):
        with pytest.raises(tw.ValueRangeError, match=rf"inverse_dynamics: .*dq.*{words}(?s:.*)contiguous\(\)"):
            arm.cuda.inverse_dynamics(q, bad, ddq)


def test_out_that_does_not_do_is_refused(gpu, arm):
    given = q, dq, _ = [Bare(gpu, a) for a in states(arm, 200)]
    good = np.empty((200, 2))
    for out, error, words in (
        (Bare(gpu, np.empty((200, 3))), tw.ShapeError, r"out= for tau is float64 of shape \(200, 3\), wanted float64 of shape \(200, 2\)"),
        (Bare(gpu, good.astype(np.float32)), tw.ShapeError, "is float32"),
        (Bare(gpu, np.empty((200, 4))[:, ::2]), tw.ValueRangeError, "has gaps"),
        (Bare(gpu, good, data=(good.ctypes.data, True)), tw.ValueRangeError, "cannot be written"),
        (dq, tw.ValueRangeError, "overlaps dq"),
        ((q, dq), tw.ShapeError, "2 arrays in out= given, 1 wanted: tau"),
        (good, tw.ValueRangeError, "numpy.ndarray, which is not in a GPU's memory"),
    ):  # fmt: skip
        with pytest.raises(error, match=words):
            arm.cuda.inverse_dynamics(*given, out=out)
    same = Bare(gpu, np.empty((200, 2, 2)))
    with pytest.raises(tw.ValueRangeError, match="out= for tau_by_dq overlaps out= for tau_by_q"):
        arm.cuda.inverse_dynamics_derivatives(*given, out=(same, same))
    assert not gpu.of("cuLaunchKernel")
