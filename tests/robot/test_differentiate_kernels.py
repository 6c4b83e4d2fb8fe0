"""Kernels of derivatives: batches, precisions, wrenches, C, and what is refused."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest
from random_trees import ROUNDING
from small_trees import tree

import twistwrench as tw
from twistwrench.testing import assert_close, random_state

MODES = ("forward", "reverse")
STATE = ("q", "dq", "ddq")


@pytest.mark.parametrize("name", ["panda", pytest.param("quadruped", marks=pytest.mark.slow)])
def test_auto_takes_the_mode_of_fewer_operations(bundled, name):
    """The estimate is right about which, wherever one of the modes takes a tenth less."""
    robot = bundled(name)
    for quantity, by in [
        ("mass_matrix", "q"),
        ("center_of_mass", "q"),
        ("inverse_dynamics", STATE),
        ("momentum", "q"),
    ]:
        made = [robot.program(quantity, by=by, mode=mode).flops for mode in MODES]
        auto = robot.program(quantity, by=by).flops
        assert auto <= 1.1 * min(made)


def test_compiled_kernels_take_batches_and_share_what_several_have_in_common():
    robot = tw.robots.floating_box()
    q, dq, ddq = random_state(robot, 1, size=(3, 5))
    kernel = robot.kernel("inverse_dynamics", by=("q", "dq"), values=True)
    assert kernel.signature == "(7),(6),(6)->(6),(6,6),(6,6)"
    assert kernel is robot.kernel("inverse_dynamics", by=("q", "dq"), values=True)
    tau, by_q, _ = kernel(q, dq, ddq)
    assert_close(tau, robot.inverse_dynamics(q, dq, ddq), ROUNDING, "τ")
    assert_close(by_q, robot.inverse_dynamics_derivatives(q, dq, ddq)[0], ROUNDING, "∂τ/∂q")
    single = kernel(*(x.astype(np.float32) for x in (q, dq, ddq)))
    assert {x.dtype for x in single} == {np.dtype(np.float32)}
    assert_close(single[1], by_q, 1e-5, "float32")
    both = robot.kernel("potential_energy", "center_of_mass", by="q")
    assert both.signature == "(7)->(6),(3,6)"
    assert_close(both(q)[1], robot.com_jacobian(q), ROUNDING, "together")


def test_methods_take_out_wrenches_and_batches():
    robot = tw.robots.planar_2r()
    rng = np.random.default_rng(2)
    q, dq, ddq, w, *v = rng.normal(size=(7, 4, 2))
    F = {"tip": rng.normal(size=6)}
    out = tuple(np.empty((4, 2)) for _ in range(3))
    given = robot.inverse_dynamics_hessian_product(q, dq, ddq, w, *v, wrench_on_robot=F, out=out)
    assert given[0] is out[0]
    without = robot.inverse_dynamics_hessian_product(q, dq, ddq, w, *v)
    torques = tw.differentiate(
        lambda q, w: robot.wrench_torques(q, -F["tip"], "tip") @ w, {"q": robot, "w": 2}, "q", form="hessian_along"
    )(q, w, v[0])
    assert_close(given[0] - without[0], torques, ROUNDING, "the wrench's part", scale=np.abs(given[0]).max())
    slope = robot.inverse_dynamics_gradient(q, dq, ddq, w, wrench_on_robot=F)
    by_q, _ = robot.inverse_dynamics_derivatives(q, dq, ddq, wrench_on_robot=F)
    assert_close(slope[0], (w[:, None] @ by_q)[:, 0], ROUNDING, "gradient")
    out = np.empty((4, 2, 2, 2))
    assert robot.mass_matrix_derivative(q, out=out) is out
    np.testing.assert_array_equal(out, robot.mass_matrix_derivative(q))


def test_results_of_four_axes():
    """Beyond what compiled loops copy: these run on NumPy."""
    robot = tw.robots.planar_2r()
    q = np.array([[0.3, -0.7], [1.0, 0.2]])
    by_q = robot.kernel("link_poses", by="q")(q)
    assert by_q.shape == (2, len(robot.link_names), 4, 4, 2)
    for k, frame in enumerate(robot.link_names):
        expected = robot.kernel("forward_kinematics", frame=frame, by="q")(q)
        assert_close(by_q[:, k], expected, ROUNDING, frame, scale=1.0)
    H = robot.kernel("mass_matrix", by="q", form="hessian")(q)
    assert_close(H[..., 1, 1], -robot.mass_matrix(q) + robot.mass_matrix([0.0, np.pi / 2]), ROUNDING, "∂²M/∂q²")


def test_robots_that_do_not_move():
    robot = tw.robots.planar_2r().lock({"joint1": 0.1, "joint2": 0.2})
    assert robot.nv == 0
    assert robot.mass_matrix_derivative([]).shape == (0, 0, 0)
    assert robot.jacobian_derivative([]).shape == (6, 0, 0)
    assert robot.kernel("center_of_mass", by="q")([]).shape == (3, 0)
    assert [x.shape for x in robot.inverse_dynamics_gradient([], [], [], [])] == [(0,)] * 3
    assert tw.differentiate(lambda q: 1.0, {"q": robot})([]).shape == (0,)
    assert tw.differentiate(robot.center_of_mass, {"q": robot})([]).shape == (3, 0)


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler: cc is not on the path")
def test_derivatives_are_exported_to_c(tmp_path):
    """The export's own test program compares them with kernels."""
    asked = [
        "center_of_mass",
        ("center_of_mass", {"by": "q"}),
        ("inverse_dynamics", {"by": STATE, "form": "hessian_along"}),
        ("inverse_dynamics", {"by": "wrench at tip", "wrenches": "tip"}),
    ]
    files = tw.robots.planar_2r().export_c(asked, tmp_path)
    assert "void planar_2r_center_of_mass_by_q(const double q[2], double com_by_q[6]);" in files[0].read_text()
    assert "derivative (hessian_along) by q, dq, ddq" in files[0].read_text()
    sources = [str(path) for path in files if path.suffix == ".c"]
    subprocess.run(["cc", "-std=c99", *sources, "-lm", "-o", str(tmp_path / "check")], check=True)
    assert subprocess.run([str(tmp_path / "check")], capture_output=True).returncode == 0


def test_a_kernel_says_what_goes_in_and_what_comes_out():
    robot = tw.robots.planar_2r()
    doc = robot.kernel("inverse_dynamics", by=("q", "dq"), values=True).__doc__
    assert doc.endswith("Inputs: q, dq, ddq. Outputs: tau, tau_by_q, tau_by_dq.")
    doc = tw.differentiate(lambda q, x: (q, x @ x), {"q": robot, "x": 3}, by="x").__doc__
    assert doc.endswith("Inputs: q, x. Outputs: result1_by_x, result2_by_x.")


def test_what_takes_numbers_only_says_so():
    robot = tw.robots.planar_2r()
    with pytest.raises(
        tw.ShapeError, match=r"Symbols go through the methods of robot.kernel's quantities; explain takes numbers"
    ):
        tw.differentiate(lambda q: robot.explain(q, q, q).tau, {"q": robot})


def test_what_cannot_be_meant(bundled):
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.UnknownNameError, match="no quantity named 'mass_matrx'"):
        robot.kernel("mass_matrx", by="q")
    with pytest.raises(tw.UnknownNameError, match=r"no input of mass_matrix named 'dq'.*Known: q"):
        robot.kernel("mass_matrix", by="dq")
    with pytest.raises(tw.UnknownNameError, match="no input of inverse_dynamics named 'gravity'"):
        robot.kernel("inverse_dynamics", by="gravity")
    with pytest.raises(tw.UnknownNameError, match="no mode of a derivative named 'backward'"):
        robot.kernel("mass_matrix", by="q", mode="backward")
    with pytest.raises(tw.UnknownNameError, match="no form of a derivative named 'gradient'"):
        robot.kernel("mass_matrix", by="q", form="gradient")
    with pytest.raises(tw.KernelError, match="mode= is of a derivative; name the inputs to differentiate by"):
        robot.kernel("mass_matrix", mode="forward")
    with pytest.raises(tw.KernelError, match="algorithms have no by="):
        robot.reference("mass_matrix", [0, 0], by="q")
    with pytest.raises(tw.KernelError, match="more than the 500000 one kernel may give"):
        bundled("quadruped").kernel("regressor", by=STATE, form="hessian")
    with pytest.raises(tw.ShapeError, match=r"weight on inverse_dynamics tau has shape \(3,\)"):
        robot.inverse_dynamics_gradient([0, 0], [0, 0], [0, 0], [1, 2, 3])
    with pytest.raises(tw.ShapeError, match=r"along dq has shape \(\)"):
        robot.inverse_dynamics_hessian_product([0, 0], [0, 0], [0, 0], [1, 2], [1, 2], 3.0, [1, 2])
    with pytest.raises(tw.ValueRangeError, match="Christoffel symbols need"):
        tree("floating").kernel("christoffel", by="q")
