"""The block matrices of section 8.4: each against the recursion that does without it, on random trees."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import ROUNDING, frames

import twistwrench as tw
from twistwrench.mechanics.algorithms.recursion import base_poses, joint_poses
from twistwrench.mechanics.model.model import BASE
from twistwrench.testing import assert_close

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


def visible(robot):
    """Bodies that carry a link, and its name; a motor's rotor is a body without one."""
    return [(i, body.link) for i, body in enumerate(robot.model.bodies) if body.link in robot.frame_names]


def test_twists_and_wrenches_come_out_of_the_block_matrices(robot, state, rng):
    q, dq, ddq = state
    by = {frame: rng.standard_normal(6) for frame in frames(robot)}
    at = robot.closed_form(q, dq, wrench_by_robot=by)
    for i, name in visible(robot):
        V = robot.frame_velocity(q, dq, name)
        assert_close(at.V[6 * i : 6 * i + 6], V, ROUNDING, "𝒱 = ℒ𝒜 q̇", scale=np.abs(at.V).max())
    expected = robot.joint_wrenches(q, dq, ddq, wrench_by_robot=by).ravel()
    assert_close(at.wrenches(ddq), expected, ROUNDING, "ℱ")
    assert_close(
        at.A.T @ at.wrenches(ddq),
        robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by),
        ROUNDING,
        "τ = 𝒜'ℱ",
        scale=np.abs(expected).max(),
    )
    assert_close(
        at.inverse_dynamics(ddq), at.A.T @ at.wrenches(ddq), ROUNDING, "τ by terms", scale=np.abs(expected).max()
    )


def test_accelerations_are_those_of_the_frames_with_gravity(robot, state):
    q, dq, ddq = state
    at = robot.closed_form(q, dq)
    found = at.accelerations(ddq)
    for i, name in visible(robot):
        dV = robot.frame_acceleration(q, dq, ddq, name)
        dV[3:] -= robot.forward_kinematics(q, name)[:3, :3].T @ robot.gravity
        assert_close(found[6 * i : 6 * i + 6], dV, ROUNDING, "𝒱̇", scale=np.abs(found).max())


def test_the_tree_is_in_w_and_its_closure_in_l(robot, state):
    q, dq, _ = state
    at, bodies = robot.closed_form(q, dq), robot.model.bodies
    n = len(bodies)
    total, power = np.eye(6 * n), np.eye(6 * n)
    for _ in range(n):
        power = power @ at.W
        total = total + power
    assert not power.any()  # no chain is longer than the number of bodies
    assert_close(at.L, total, ROUNDING, "ℒ = 1 + 𝒲 + 𝒲² + …")
    poses = [np.asarray(T, float) for T in base_poses(robot.model, joint_poses(robot.model, q))]
    for i, body in enumerate(bodies):
        rows = at.W[6 * i : 6 * i + 6].reshape(6, n, 6)
        parents = [j for j in range(n) if rows[:, j].any()]
        assert parents == ([] if body.parent == BASE else [body.parent])
        for j in parents:
            expected = tw.Ad(tw.se3.inverse(poses[i]) @ poses[j]).matrix
            assert_close(rows[:, j], expected, ROUNDING, "Ad(T_ip)", scale=max(1.0, np.abs(expected).max()))
        assert_close(at.G[6 * i : 6 * i + 6, 6 * i : 6 * i + 6], body.inertia.matrix, 0.0, "𝒢")
    assert at.ad_V.shape == at.ad_Adq.shape == (6 * n, 6 * n)


def test_every_term_is_the_product_that_the_book_writes(robot, state, rng):
    q, dq, _ = state
    by = {frames(robot)[0]: rng.standard_normal(6)}
    at = robot.closed_form(q, dq, wrench_by_robot=by)
    inner = at.A.T @ at.L.T
    assert_close(at.M, inner @ at.G @ at.L @ at.A, 1e-15, "M")
    assert_close(at.g, inner @ at.G @ at.L @ at.dV_base, 1e-14, "g", scale=max(1.0, np.abs(at.g).max()))
    assert_close(
        at.wrench_torques, robot.wrench_torques(q, by[frames(robot)[0]], frames(robot)[0]), ROUNDING, "J'F", scale=10.0
    )
    slip = at.c - inner @ (at.G @ at.L @ at.ad_Adq @ at.W + at.ad_V.T @ at.G) @ at.V  # the sign in front dropped
    assert_close(slip, 2 * at.c, ROUNDING, "c has a minus", scale=max(1.0, np.abs(at.c).max()))


@pytest.mark.parametrize(
    ("q", "dq", "wrench", "told"),
    [
        ([0.0], [0.0, 0.0], None, r"closed_form: q has shape \(1,\)"),
        ([0.0, 0.0], [[0.0, 0.0]], None, r"closed_form: dq has shape \(1, 2\)"),
        ([0.0, 0.0], [0.0, 0.0], np.zeros((3, 6)), "wrench at 'tip' is a batch"),
        ([0.0, 0.0], [0.0, 0.0], np.zeros(3), r"'tip' has shape \(3,\)"),
    ],
)
def test_one_state_at_a_time(q, dq, wrench, told):
    arm = tw.robots.planar_2r()
    with pytest.raises(tw.ShapeError, match=told):
        arm.closed_form(q, dq, wrench_by_robot=None if wrench is None else {"tip": wrench})
