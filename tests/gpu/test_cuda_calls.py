"""robot.cuda from arrays to a launch: results, batches, outputs, streams, devices; on the GPU of fake_gpu.py."""

from __future__ import annotations

import gc
import types

import numpy as np
import pytest
from fake_gpu import CLOSE, NEEDS_COMPILERS, Bare, states

import twistwrench as tw
from twistwrench.cuda import DeviceArray
from twistwrench.robot.quantity_methods import METHODS
from twistwrench.testing import assert_close

pytest_plugins = ("cuda_fixtures",)
pytestmark = NEEDS_COMPILERS


# ── what comes out ──


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_bare_arrays_in_a_bare_array_out(gpu, arm, dtype):
    given = states(arm, 5, 60, dtype=dtype)
    tau = arm.cuda.inverse_dynamics(*(Bare(gpu, a) for a in given))
    assert isinstance(tau, DeviceArray) and tau.shape == (5, 60, 2) and tau.dtype == dtype
    assert_close(tau.to_numpy(), arm.inverse_dynamics(*given), CLOSE if dtype == np.float64 else 1e-4)
    (launch,) = gpu.of("cuLaunchKernel")
    assert "planar_2r_inverse_dynamics grid 3,1,1 block 128,1,1 shared 0 stream 1" in launch  # 300 samples
    assert "--gpu-architecture=sm_90 -std=c++17 -fmad=false" in gpu.of("nvrtcCompileProgram")[0]


def test_every_method_gives_what_the_robots_own_gives(gpu):
    """Same names, same arguments, same numbers, for every method that takes states; on a robot where none is zero."""
    robot = tw.robots.ur5()
    q, dq, ddq, F = np.random.default_rng(2).standard_normal((4, 3, 6))
    given = {"q": q, "dq": dq, "ddq": ddq, "tau": ddq, "wrench_by_robot": F, "load": ddq, "q1": q, "q0": dq, "dv": ddq}
    given |= {"weights": F, "along_q": dq, "along_dq": q, "along_ddq": F}
    tested = []
    for name, method in METHODS.items():
        if name.startswith("_") or name == "inverse_dynamics_hessian_product":  # g++ takes a quarter of a minute for it
            continue
        wanted = method.__code__.co_varnames[1 : method.__code__.co_argcount]
        places = [given[label] for label in wanted if label in given]
        options = {"kind": "space", "frame": "wrist_2_link"} if "kind" in wanted else {}
        found = getattr(robot.cuda, name)(*(Bare(gpu, a) for a in places), **options)
        own = getattr(robot, name)(*places, **options)
        for f, o in zip(*(x if isinstance(x, tuple) else (x,) for x in (found, own)), strict=True):
            assert_close(f.to_numpy(), o, CLOSE, name)
        tested.append(name)
    assert {"inverse_dynamics", "forward_dynamics", "mass_matrix", "bias_forces", "gravity_forces", "coriolis_forces",
            "jacobian", "forward_kinematics", "inverse_dynamics_derivatives", "forward_dynamics_derivatives"} <= set(tested)  # fmt: skip


def test_wrenches_by_and_on_the_robot_have_their_signs(gpu, arm):
    q, dq, ddq = states(arm, 40)
    F = np.random.default_rng(1).standard_normal((40, 6))
    for keyword in ("wrench_by_robot", "wrench_on_robot"):
        found = arm.cuda.inverse_dynamics(*(Bare(gpu, a) for a in (q, dq, ddq)), **{keyword: {"tip": Bare(gpu, F)}})
        assert_close(found.to_numpy(), arm.inverse_dynamics(q, dq, ddq, **{keyword: {"tip": F}}), CLOSE)
    given = {"wrench_by_robot": {"tip": Bare(gpu, F)}, "wrench_on_robot": {"link1": Bare(gpu, F[0])}}
    found = arm.cuda.forward_dynamics(*(Bare(gpu, a) for a in (q, dq, ddq)), **given)
    own = arm.forward_dynamics(q, dq, ddq, wrench_by_robot={"tip": F}, wrench_on_robot={"link1": F[0]})
    assert_close(found.to_numpy(), own, CLOSE)
    with pytest.raises(tw.ValueRangeError, match="by and on the robot are given at 'tip'"):
        arm.cuda.holding_torques(Bare(gpu, q), wrench_by_robot={"tip": F}, wrench_on_robot={"tip": F})
    with pytest.raises(tw.ShapeError, match="a dict"):
        arm.cuda.holding_torques(Bare(gpu, q), wrench_by_robot=F)


def test_any_quantity_has_a_kernel_with_its_options(gpu, arm):
    kernel = arm.cuda.kernel("gravity_forces", parameters=("tip.mass",), gravity="input")
    assert kernel is arm.cuda.kernel("gravity_forces", gravity="input", parameters=("tip.mass",))
    q, g, m = states(arm, 9)[0], np.array([0.0, 1.0, -5.0]), np.linspace(0, 2, 9)[:, None]
    own = arm.kernel("gravity_forces", parameters=("tip.mass",), gravity="input")(q, g, m)
    assert_close(kernel(Bare(gpu, q), Bare(gpu, g), Bare(gpu, m)).to_numpy(), own, CLOSE)
    assert repr(kernel) == "<CudaKernel gravity_forces: (2),(3),(1)->(2)>"


# ── batches ──


def test_batches_broadcast_without_copies(gpu, arm):
    q, dq, ddq = states(arm, 4, 50)
    state = np.concatenate([q, dq], axis=-1)
    wide = gpu.put(state)
    for given in (
        (q, dq[0, 0], ddq),
        (q[0, 0], dq, ddq[0, :1]),
        (q, np.broadcast_to(dq[0, 0], (4, 50, 2)), ddq),
        (wide[..., :2], wide[..., 2:], ddq),
        (q[:, ::-1].reshape(-1, 2), dq.reshape(-1, 2), ddq.reshape(-1, 2)),
        (q[0, 0], dq[0, 0], ddq[0, 0]),
        (q[:1, :1], dq[0, 0], ddq[:1, 0]),
    ):
        found = arm.cuda.inverse_dynamics(*(Bare(gpu, a) for a in given)).to_numpy()
        own = arm.inverse_dynamics(*given)
        assert found.shape == own.shape
        assert_close(found, own, CLOSE)
    assert not gpu.of("cuMemcpyHtoD_v2")


def test_no_samples_no_launch(gpu, arm):
    tau = arm.cuda.inverse_dynamics(*(Bare(gpu, np.empty((0, 2)), data=(0, False)) for _ in range(3)))
    assert tau.shape == (0, 2) and tau.to_numpy().shape == (0, 2)
    assert not gpu.of("cuLaunchKernel")


# ── out= ──


def test_out_is_written_and_returned(gpu, arm):
    q, dq, ddq = states(arm, 200)
    tau = Bare(gpu, np.full((200, 2), np.nan))
    assert arm.cuda.inverse_dynamics(Bare(gpu, q), Bare(gpu, dq), Bare(gpu, ddq), out=tau) is tau
    assert_close(tau.array, arm.inverse_dynamics(q, dq, ddq), CLOSE)
    pair = tuple(Bare(gpu, np.full((200, 2, 2), np.nan)) for _ in range(2))
    found = arm.cuda.inverse_dynamics_derivatives(Bare(gpu, q), Bare(gpu, dq), Bare(gpu, ddq), out=pair)
    assert found == pair and not gpu.of("cuMemAlloc_v2")
    for mine, own in zip(pair, arm.inverse_dynamics_derivatives(q, dq, ddq), strict=True):
        assert_close(mine.array, own, CLOSE)


# ── streams, devices, code ──


def test_the_launch_goes_to_the_stream_of_the_first_input_and_waits_for_the_others(gpu, arm):
    q, dq, ddq = states(arm, 10)
    arm.cuda.inverse_dynamics(Bare(gpu, q, stream=77), Bare(gpu, dq, stream=88), Bare(gpu, ddq, stream=None))
    assert gpu.of("cuLaunchKernel")[0].endswith("stream 77")
    assert gpu.of("cuEventRecord") == ["cuEventRecord stream 88"]
    assert gpu.of("cuStreamWaitEvent") == ["cuStreamWaitEvent stream 77 flags 0"]


@pytest.mark.parametrize(
    ("stream", "handle"),
    [
        (5, 5),
        (0, 1),
        (types.SimpleNamespace(cuda_stream=6), 6),
        (types.SimpleNamespace(ptr=7), 7),
        (types.SimpleNamespace(__cuda_stream__=lambda: (0, 8)), 8),
    ],
)
def test_a_stream_may_be_named(gpu, arm, stream, handle):
    given = [Bare(gpu, a, stream=77) for a in states(arm, 10)]
    tau = arm.cuda.on(stream).inverse_dynamics(*given)
    assert gpu.of("cuLaunchKernel")[0].endswith(f"stream {handle}")
    assert gpu.of("cuEventRecord") == ["cuEventRecord stream 77"]
    assert tau.__cuda_array_interface__["stream"] == handle
    tau.to_numpy()
    assert gpu.of("cuStreamSynchronize") == [f"cuStreamSynchronize stream {handle}"]
    for bad in (True, "fast", -1):
        with pytest.raises(tw.ValueRangeError, match="is no stream"):
            arm.cuda.on(bad).inverse_dynamics(*given)


def test_code_is_made_once_for_each_precision_and_device(gpu, arm):
    for device in (0, 0, 1, 1):
        for dtype in (np.float32, np.float64, np.float32):
            given = [Bare(gpu, a, device) for a in states(arm, 10, dtype=dtype)]
            tau = arm.cuda.inverse_dynamics(*given)
            assert tau.device == device
    assert len(gpu.of("cuLaunchKernel")) == 12
    loaded = gpu.of("cuModuleLoadData")
    assert sorted(loaded) == ["cuModuleLoadData on 0"] * 2 + ["cuModuleLoadData on 1"] * 2
    assert len(gpu.of("cuDevicePrimaryCtxRetain")) == 1  # device 0 is current, device 1 is not
    assert gpu.library.fake_depth() == 1  # what was pushed is popped
    mixed = [Bare(gpu, a, device) for a, device in zip(states(arm, 10), (0, 1, 0), strict=True)]
    with pytest.raises(tw.ValueRangeError, match="on several GPUs: q on GPU 0, dq on GPU 1"):
        arm.cuda.inverse_dynamics(*mixed)


def test_without_a_context_the_primary_one_serves(gpu, arm):
    gpu.reset(device=-1)
    given = states(arm, 10)
    tau = arm.cuda.inverse_dynamics(*(Bare(gpu, a) for a in given))
    assert_close(tau.to_numpy(), arm.inverse_dynamics(*given), CLOSE)
    assert gpu.of("cuDevicePrimaryCtxRetain") == ["cuDevicePrimaryCtxRetain 0"] and gpu.library.fake_depth() == 0


def test_code_is_kept_on_disk(gpu, arm, tmp_path, monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", str(tmp_path / "kept"))
    given = [Bare(gpu, a) for a in states(arm, 10)]
    for robot in (arm, tw.robots.planar_2r()):
        robot.cuda.inverse_dynamics(*given)
    assert len(gpu.of("nvrtcCompileProgram")) == 1 and len(gpu.of("cuLaunchKernel")) == 2
    assert len(list((tmp_path / "kept").iterdir())) == 1


def test_memory_is_given_back(gpu, arm):
    gc.collect()
    before = gpu.library.fake_allocated()
    kept = [arm.cuda.mass_matrix(Bare(gpu, states(arm, 10)[0])) for _ in range(3)]
    assert gpu.library.fake_allocated() == before + 3
    del kept
    gc.collect()
    assert gpu.library.fake_allocated() == before
