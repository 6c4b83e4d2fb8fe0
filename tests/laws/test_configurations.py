"""q ⊕ dv and q₁ ⊖ q₀ where they are delicate: no turn, tiny turns, half turns, long quaternions, single precision, derivatives."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.mechanics.model.builder import ModelBuilder

TURNING = ("planar", "ball", "floating")


def one_joint(kind):
    builder = ModelBuilder(kind)
    builder.add_link("base")
    builder.add_link("body", tw.SpatialInertia.from_com(1.0, (0.1, 0.2, -0.5), 0.01 * np.eye(3)))
    builder.add_joint("joint", kind, "base", "body", axis=(0, 0, 1))
    return tw.Robot(builder.build())


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("kind", ["ball", "floating"])
def test_a_half_turn_is_pi(kind, axis, dtype):
    robot = one_joint(kind)
    q0, q1 = robot.neutral.astype(dtype), robot.neutral.astype(dtype)
    q1[:4] = np.eye(4)[1 + axis]
    assert np.allclose(np.abs(robot.subtract(q1, q0)[:3]), np.pi * np.eye(3)[axis], atol=4 * np.finfo(dtype).eps)


@pytest.mark.parametrize("size", [1e-100, 1e-10, 1e10, 1e100])
def test_the_length_of_quaternions_does_not_count(size):
    robot = one_joint("ball")
    q1, q0 = robot.random_configuration(1, (2, 20))
    assert np.abs(robot.subtract(size * q1, size * q0) - robot.subtract(q1, q0)).max() < 1e-14
    assert np.abs(robot.subtract(size * q1, -q0) - robot.subtract(q1, q0)).max() < 1e-14


@pytest.mark.parametrize("turn", [0.0, 1e-15, 1e-12, 1e-8, 1e-4, 0.5, 0.999, 1.001, 3.0])
@pytest.mark.parametrize("kind", TURNING)
def test_derivatives_of_a_step_are_right_however_small_it_turns(kind, turn):
    """Of the pose by the step, against the left Jacobian of SE(3): d exp(V) = [J_l(V) dV] exp(V). Rounding, so 1e-13."""
    robot = one_joint(kind)
    axes = robot.model.bodies[0].joint.axes
    dv = {"planar": [turn, 1.0, 2.0], "ball": turn * np.array([0.6, 0.0, 0.8])}.get(
        kind, np.r_[turn * np.array([0.6, 0.0, 0.8]), 1.0, 2.0, 3.0]
    )
    dv = np.asarray(dv, float)
    slopes = tw.differentiate(lambda v: robot.forward_kinematics(robot.add(robot.neutral, v), "body"), {"v": robot.nv})
    found = slopes(dv)
    T, J = tw.se3.exp(axes.T @ dv), tw.se3.left_jacobian(axes.T @ dv)
    for k in range(robot.nv):
        assert np.abs(found[..., k] - tw.se3.hat(J @ axes[k]) @ T).max() < 1e-13, k


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("turn", [0.0, 1e-15, 1e-8])
def test_the_curvature_of_a_distance_has_no_hole_at_no_turn(turn, dtype):
    """Of |q ⊖ 1|² where both have one orientation: smooth, so nearly what it is at a turn of 1e-3 rad."""
    robot = one_joint("floating")
    hessian = tw.differentiate(lambda q: np.sum(robot.subtract(q, robot.neutral) ** 2), {"q": robot}, form="hessian")

    def at(turn):
        return hessian(robot.add(robot.neutral, [turn, 0, 0, 0.5, 0.5, 0.5]).astype(dtype))

    assert np.abs(at(turn) - at(1e-3)).max() < 5e-3


@pytest.mark.parametrize("kind", TURNING)
def test_a_difference_leads_from_one_configuration_to_the_other(kind):
    """q₀ ⊕ (q₁ ⊖ q₀) is the pose of q₁, and q₁ ⊖ q₀ is the logarithm of T₀⁻¹ T₁ along the joint's axes."""
    robot = one_joint(kind)
    q1, q0 = robot.random_configuration(3, 2)
    dv = robot.subtract(q1, q0)
    T1, T0 = (robot.forward_kinematics(q, "body") for q in (q1, q0))
    assert np.abs(robot.forward_kinematics(robot.add(q0, dv), "body") - T1).max() < 1e-14
    V = tw.se3.log(tw.se3.inverse(T0) @ T1)
    assert np.abs(robot.model.bodies[0].joint.axes.T @ dv - V).max() < 1e-13


@pytest.mark.parametrize("kind", TURNING)
def test_derivatives_by_any_configuration_are_along_add(kind):
    robot = one_joint(kind)
    q1, q0 = robot.random_configuration(3, 2)
    J1, J0 = robot.kernel("subtract", by=("q1", "q0"))(q1, q0)
    h = 1e-6
    for J, move in ((J1, lambda dv: (robot.add(q1, dv), q0)), (J0, lambda dv: (q1, robot.add(q0, dv)))):
        assert J.shape == (robot.nv, robot.nv)
        for k, e in enumerate(np.eye(robot.nv)):
            slope = (robot.subtract(*move(h * e)) - robot.subtract(*move(-h * e))) / (2 * h)
            assert np.abs(J[:, k] - slope).max() < 1e-8


def test_planar_joints_differ_by_the_shorter_turn():
    """From 3 to -3 rad it is 2 π - 6 forward, not 6 back."""
    body = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    joint = '<joint name="j" type="planar"><parent link="floor"/><child link="disk"/><axis xyz="0 0 1"/></joint>'
    robot = tw.load(f'<robot name="a"><link name="floor"/><link name="disk">{body}</link>{joint}</robot>')
    difference = robot.subtract([0.0, 0.0, -3.0], [0.0, 0.0, 3.0])
    assert np.allclose(difference, [2 * np.pi - 6.0, 0.0, 0.0], atol=1e-14)
