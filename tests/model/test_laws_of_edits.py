"""Robots made of robots: payloads, mimic joints, locked joints and moved bases obey the mechanics of the whole."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import ROUNDING

from twistwrench import Robot, ad
from twistwrench.testing import assert_close, random_builder, random_inertia, random_pose, random_robot, random_state

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

FOLLOWED = (0, 1, 2, 3, 5, 8, 9, 11)
"""Seeds that give robots with mimic joints."""


@pytest.mark.parametrize("seed", range(4))
def test_a_payload_equals_a_link_fixed_there(seed):
    load, frame = random_inertia(seed + 50), "link4"
    builder = random_builder(seed, joints=5)
    bare = Robot(builder.build())
    builder.add_link("load", load)
    builder.add_joint("grip", "fixed", frame, "load")
    built, state = Robot(builder.build()), random_state(bare, seed)
    assert_close(bare.with_payload(load, frame).inverse_dynamics(*state), built.inverse_dynamics(*state), ROUNDING, "τ")
    by = robot_tau_of_load(bare, state, load, frame)
    assert_close(
        built.inverse_dynamics(*state), bare.inverse_dynamics(*state) + by, ROUNDING, "τ, the load as a wrench"
    )


def robot_tau_of_load(robot, state, G, frame):
    """The torques that move a load, from the load's own equation of motion."""
    q, dq, ddq = state
    V, dV = robot.frame_velocity(q, dq, frame), robot.frame_acceleration(q, dq, ddq, frame)
    dV = dV - np.r_[np.zeros(3), robot.forward_kinematics(q, frame)[:3, :3].T @ robot.gravity]
    return robot.jacobian(q, frame).T @ (G @ dV - ad(V).T @ (G @ V))


@pytest.mark.parametrize("seed", FOLLOWED)
def test_a_follower_is_an_independent_joint_held_to_its_leader(seed):
    options = {"joints": 8, "kinds": ("revolute", "prismatic", "helical", "mimic", "floating", "planar")}
    follow, free = random_robot(seed, **options), random_robot(seed, **options, mimic="independent")
    assert follow.nv < free.nv
    P, q_free = constraint(follow, free)
    q, dq, ddq = random_state(follow, seed)
    x = q_free(q)
    assert_close(follow.link_poses(q), free.link_poses(x), ROUNDING, "poses")
    tau = free.inverse_dynamics(x, P @ dq, P @ ddq)
    assert_close(follow.inverse_dynamics(q, dq, ddq), P.T @ tau, ROUNDING, "τ = τ_leader + Σ ratio τ_follower")
    assert_close(follow.mass_matrix(q), P.T @ free.mass_matrix(x) @ P, ROUNDING, "M = P' M P")


def constraint(follow, free):
    """P with dq_free = P dq, and the function from q to q_free."""
    P = np.zeros((free.nv, follow.nv))
    pairs = list(zip(follow.model.bodies, free.model.bodies, strict=True))
    for mine, theirs in pairs:
        rows, columns = slice(theirs.v_index, None), slice(mine.v_index, mine.v_index + mine.joint.nv)
        P[rows, columns][: mine.joint.nv] = mine.ratio * np.eye(mine.joint.nv)

    def q_free(q):
        x = free.neutral
        for mine, theirs in pairs:
            part = q[mine.q_index : mine.q_index + mine.joint.nq]
            x[theirs.q_index : theirs.q_index + mine.joint.nq] = (
                mine.ratio * part + mine.offset if mine.follows else part
            )
        return x

    return P, q_free


@pytest.mark.parametrize("seed", range(8))
def test_a_locked_joint_is_a_joint_at_rest(seed):
    robot = random_robot(seed, joints=7, floating_base=seed % 2 == 0)
    chosen = [b for b in robot.model.leaders if b.joint.name != "root_joint"][::2]
    q, dq, ddq = random_state(robot, seed)
    held = np.zeros(robot.nv, bool)
    held_q = np.zeros(robot.nq, bool)
    for body in chosen:
        held[body.v_index : body.v_index + body.joint.nv] = True
        held_q[body.q_index : body.q_index + body.joint.nq] = True
    locked = robot.lock({b.joint.name: q[b.q_index : b.q_index + b.joint.nq] for b in chosen})
    dq[held] = ddq[held] = 0.0
    free = ~held
    # Locking snaps rotations to 1e-9 at most, and only if an entry happens to be that near 0 or ±1.
    assert_close(
        locked.mass_matrix(q[~held_q]), robot.mass_matrix(q)[np.ix_(free, free)], 1e-8, "M, without the held rows"
    )
    tau = locked.inverse_dynamics(q[~held_q], dq[free], ddq[free])
    assert_close(tau, robot.inverse_dynamics(q, dq, ddq)[free], 1e-8, "τ of the free joints")


@pytest.mark.parametrize("seed", range(4))
def test_dynamics_do_not_depend_on_where_the_base_stands(seed):
    """A robot on a tilted and shifted base, gravity tilted with it, feels nothing of it."""
    robot, tilt = random_robot(seed), random_pose(seed)
    builder = random_builder(seed)
    builder.add_link("ground")
    builder.add_joint("foot", "fixed", "ground", "link0", placement=tilt)
    tilted = Robot(builder.build(gravity=tilt[:3, :3] @ robot.gravity))
    state = random_state(robot, seed)
    assert_close(tilted.inverse_dynamics(*state), robot.inverse_dynamics(*state), 1e-8, "τ")  # 1e-8: tilted poses snap
    assert_close(
        tilted.forward_kinematics(state.q, "link3"), tilt @ robot.forward_kinematics(state.q, "link3"), 1e-8, "T"
    )
