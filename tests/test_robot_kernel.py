"""What ``robot.kernel`` hands out, and how wrong names and wrong shapes are told."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.kernels.ufunc import make_ufunc


@pytest.mark.parametrize(
    ("name", "quantity", "options", "signature"),
    [
        ("panda", "inverse_dynamics", {}, "(7),(7),(7)->(7)"),
        ("panda", "jacobian", {"frame": "panda_hand", "kind": "space"}, "(7)->(6,7)"),
        ("panda", "mass_matrix", {}, "(7)->(7,7)"),
        ("panda", "inverse_dynamics", {"wrenches": ("panda_hand", "panda_link3")}, "(7),(7),(7),(6),(6)->(7)"),
        ("cart_pole", "christoffel", {}, "(2)->(2,2,2)"),
        ("cart_pole", "kinetic_energy", {}, "(2),(2)->()"),
        ("floating_box", "frame_velocity", {}, "(7),(6)->(6)"),
    ],
)
def test_a_kernel_is_a_ufunc_with_the_robot_s_sizes(bundled, name, quantity, options, signature):
    kernel = bundled(name).kernel(quantity, **options)
    assert isinstance(kernel, np.ufunc)
    assert kernel.signature == signature
    assert kernel.__name__ == quantity
    assert name in kernel.__doc__
    assert kernel.nin == signature.split("->")[0].count("(")
    assert set(kernel.types) == {f"{'f' * kernel.nin}->f", f"{'d' * kernel.nin}->d"}
    assert bundled(name).kernel(quantity, **options) is kernel


@pytest.mark.parametrize(
    ("quantity", "options", "error", "told"),
    [
        ("mass_matrx", {}, tw.UnknownNameError, "'mass_matrx'.*Did you mean 'mass_matrix'.*bias_forces"),
        ("jacobian", {"frame": "link9"}, tw.UnknownNameError, "'link9'.*Known: base, link1, link2, tip"),
        ("jacobian", {"frame": ["link2"]}, tw.UnknownNameError, "Known: base, link1, link2, tip"),
        ("jacobian", {"kind": "spatial"}, tw.UnknownNameError, "'spatial'.*Known: body, space, world_aligned"),
        ("inverse_dynamics", {"wrenches": ("hand",)}, tw.UnknownNameError, "'hand'.*link1"),
        ("mass_matrix", {"frame": "tip"}, tw.KernelError, "mass_matrix takes no option 'frame'"),
        ("jacobian", {"flavour": "tip"}, tw.KernelError, "no option 'flavour'; it takes frame, kind"),
    ],
)
def test_unknown_names_list_the_choices(bundled, quantity, options, error, told):
    with pytest.raises(error, match=told):
        bundled("planar_2r").kernel(quantity, **options)


def test_too_many_arrays_are_refused(bundled):
    robot = bundled("planar_2r")
    with pytest.raises(tw.KernelError, match="33 arrays; NumPy allows"):
        robot.kernel("inverse_dynamics", wrenches=("tip",) * 29)
    program = robot.program("inverse_dynamics", wrenches=("tip",) * 3)
    assert make_ufunc(program, "few", "").nin == 6


@pytest.mark.parametrize("jit", ["0", "1"])
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((np.zeros(3), np.zeros(2), np.zeros(2)), r"q has shape \(3,\).*wants 2.*joint1, joint2"),
        ((np.zeros(2), np.zeros((4, 3)), np.zeros(2)), r"dq has shape \(4, 3\)"),
        ((np.zeros(2), np.zeros(2), 1.0), r"ddq has shape \(\)"),
        ((np.zeros((2, 0)), np.zeros(2), np.zeros(2)), r"q has shape \(2, 0\)"),
        ((np.zeros((3, 2)), np.zeros((4, 2)), np.zeros(2)), r"the batch shapes do not broadcast: q \(3,\), dq \(4,\)"),
        (([[1, 2], [3]], np.zeros(2), np.zeros(2)), "q is not an array of real numbers"),
        ((np.zeros(2), ["a", "b"], np.zeros(2)), "dq is not an array of real numbers"),
    ],
)
def test_wrong_shapes_are_explained(monkeypatch, arguments, told, jit):
    monkeypatch.setenv("TWISTWRENCH_JIT", jit)
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.ShapeError, match=f"inverse_dynamics: {told}"):
        robot.inverse_dynamics(*arguments)
    with pytest.raises((TypeError, ValueError)):  # the bare kernel refuses as well, in NumPy's words
        robot.kernel("inverse_dynamics")(*arguments)
