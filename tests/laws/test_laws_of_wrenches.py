"""The laws of wrenches on random trees of every joint kind: signs, power, what crosses the joints."""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow
from random_trees import ROUNDING, UNDRIVEN, body_poses, frames

from twistwrench import Ad, FrameError, Pose, Wrench, ad, se3
from twistwrench.testing import assert_close, random_robot

pytest_plugins = ("random_tree_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


# ── wrenches ──


def test_a_wrench_on_what_does_not_move_takes_no_torque(bundled):
    arm = bundled("ur5")
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 6))
    wanted = arm.inverse_dynamics(q, dq, ddq)
    for sign in ("wrench_by_robot", "wrench_on_robot"):
        found = arm.inverse_dynamics(q, dq, ddq, **{sign: {arm.link_names[0]: np.ones(6)}})
        assert_close(found, wanted, ROUNDING, "a wrench on the base")


def test_a_wrench_labelled_with_the_base_is_refused_and_the_same_wrench_at_the_tip_taken(bundled):
    """As J_s'F_s = J_b'F_b: a label says where a wrench acts, so one of the base would cost no torque."""
    arm = bundled("planar_2r")
    q, F_b = np.array([0.4, 1.2]), np.array([0.0, 0.0, 0.0, 3.0, 5.0, 0.0])
    T_sb = Pose(arm.forward_kinematics(q), to="base", of="tip")
    F_s = T_sb @ Wrench(F_b, "tip")
    with pytest.raises(FrameError, match="acts on the base"):
        arm.wrench_torques(q, F_s)
    expected = arm.jacobian(q, kind="space").T @ F_s.values
    assert_close(arm.wrench_torques(q, T_sb.inverse @ F_s), expected, ROUNDING, "J_s'F_s", scale=10.0)


def test_wrench_torques_are_the_transposed_jacobian_times_the_wrench(robot, state, rng):
    for frame in frames(robot):
        F = rng.standard_normal(6)
        expected = robot.jacobian(state.q, frame).T @ F
        assert_close(
            robot.wrench_torques(state.q, F, frame),
            expected,
            ROUNDING,
            "J_b' F",
            scale=max(1.0, np.abs(expected).max()),
        )


def test_power_of_a_wrench_is_the_same_in_every_frame(robot, state, rng):
    q, dq, _ = state
    frame = frames(robot)[0]
    F_b = rng.standard_normal(6)
    T_sb = robot.forward_kinematics(q, frame)
    F_s = Ad(se3.inverse(T_sb)).T @ F_b
    V_b, V_s = robot.frame_velocity(q, dq, frame, "body"), robot.frame_velocity(q, dq, frame, "space")
    scale = float(np.abs(F_s * V_s).max() + np.abs(F_b * V_b).max())
    assert_close(F_b @ V_b, F_s @ V_s, ROUNDING, "F_b'V_b = F_s'V_s", scale=scale)
    assert_close(robot.wrench_torques(q, F_b, frame) @ dq, F_b @ V_b, ROUNDING, "τ'dq = F'V", scale=scale)


def test_wrenches_by_the_robot_cost_torque_and_wrenches_on_it_save_it(robot, state, rng):
    q, dq, ddq = state
    a, b = frames(robot)[:2] if len(frames(robot)) > 1 else frames(robot) * 2
    by, on = {a: rng.standard_normal(6)}, {b: rng.standard_normal(6)}
    pushed = robot.jacobian(q, a).T @ by[a] - robot.jacobian(q, b).T @ on[b]
    tau = robot.inverse_dynamics(q, dq, ddq)
    got = robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by, wrench_on_robot=on)
    assert_close(got, tau + pushed, ROUNDING, "τ + J'F_by - J'F_on")
    holding = robot.holding_torques(q, wrench_by_robot=by, wrench_on_robot=on)
    assert_close(holding, robot.gravity_forces(q) + pushed, ROUNDING, "holding torques")
    back = robot.forward_dynamics(q, dq, got, wrench_by_robot=by, wrench_on_robot=on)
    assert_close(back, ddq, 1e-14 * robot.nv * np.linalg.cond(robot.mass_matrix(q)), "forward dynamics with wrenches")


def test_the_world_lifting_a_link_takes_its_weight_off_the_joints():
    """The sign of ``wrench_on_robot`` said once with numbers: an upward push of the weight at the com leaves no torque."""
    robot = random_robot(7, joints=1, kinds=("revolute",)).with_gravity((0, 0, -9.81))
    q, G = robot.random_configuration(1), robot.model.bodies[0].inertia
    lift = robot.forward_kinematics(q, "link1")[:3, :3].T @ (0, 0, 9.81 * G.mass)
    on = {"link1": np.r_[np.cross(G.com, lift), lift]}
    scale = np.abs(robot.gravity_forces(q)).max()
    assert_close(robot.holding_torques(q, wrench_on_robot=on), [0.0], ROUNDING, "nothing left to hold", scale=scale)
    assert_close(robot.holding_torques(q, wrench_by_robot=on), 2 * robot.gravity_forces(q), ROUNDING, "twice to hold")


# ── across the joints ──


def test_joint_wrenches_projected_on_the_axes_are_the_torques(robot, state):
    F = robot.joint_wrenches(*state)
    tau = np.zeros(robot.nv)
    for body, wrench in zip(robot.model.bodies, F, strict=True):
        tau[body.v_index : body.v_index + body.joint.nv] += body.ratio * (body.joint.axes @ wrench)
    assert_close(tau, robot.inverse_dynamics(*state), ROUNDING, "A'F = τ")


@pytest.mark.parametrize("robot", [*mostly_slow(UNDRIVEN[:12], 4), *UNDRIVEN[12:]], indirect=True)
def test_every_body_is_in_balance(robot, state, rng):
    """What comes through its joint, less what it passes on, moves the body: F = G dV - ad(V)' G V, MR eq. 8.40."""
    q, dq, ddq = state
    by = {frames(robot)[0]: rng.standard_normal(6)}
    F, poses = robot.joint_wrenches(q, dq, ddq, wrench_by_robot=by), body_poses(robot, q)
    names = {f.body: n for n, f in robot.model.frames.items() if np.array_equal(f.pose, np.eye(4))}
    for i, body in enumerate(robot.model.bodies):
        V = robot.frame_velocity(q, dq, names[i], "body")
        dV = robot.frame_acceleration(q, dq, ddq, names[i], "body")
        dV = dV - np.r_[np.zeros(3), poses[i][:3, :3].T @ robot.gravity]
        needed = body.inertia @ dV - ad(V).T @ (body.inertia @ V)
        left = F[i].copy()
        for j, other in enumerate(robot.model.bodies):
            if other.parent == i:
                left -= Ad(se3.inverse(poses[j]) @ poses[i]).T @ F[j]
        for frame, F_by in by.items():
            if robot.model.frames[frame].body == i:
                left -= Ad(se3.inverse(robot.model.frames[frame].pose)).T @ F_by
        assert_close(left, needed, ROUNDING, f"body {i}", scale=np.abs(F).max())


@pytest.mark.parametrize("kind", ["body", "space", "world_aligned"])
def test_a_constraint_loads_each_joint_below_its_frame_with_its_whole_wrench(bundled, kind):
    """The wrench of the constraint goes through every joint on its way to the base, and through none beyond its frame."""
    arm = bundled("ur5")
    closed = arm.constrain("wrist_1_link", "wx vz", kind=kind)
    rng = np.random.default_rng(1)
    q = arm.random_configuration(rng)
    dq = closed.project_velocity(q, rng.standard_normal(6))
    ddq = closed.project_acceleration(q, dq, rng.standard_normal(6))
    (F,) = closed.wrenches(closed.inverse_dynamics(q, dq, ddq).lam).values()
    T = arm.forward_kinematics(q, "wrist_1_link")
    frame = {"body": T, "space": np.eye(4), "world_aligned": se3.pose(np.eye(3), T[:3, 3])}[kind]
    F_s = Ad(se3.inverse(frame)).T @ F
    through = closed.joint_wrenches(q, dq, ddq) - arm.joint_wrenches(q, dq, ddq)
    for i, pose in enumerate(body_poses(arm, q)):
        wanted = Ad(pose).T @ F_s if i <= arm.model.frames["wrist_1_link"].body else np.zeros(6)
        assert_close(through[i], wanted, ROUNDING, f"across joint {i}", scale=np.abs(F_s).max())
