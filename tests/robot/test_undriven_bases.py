"""A base that nothing drives is not a motor: torques and constraint forces of closed robots that stand or glide."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.errors import ConstraintError
from twistwrench.robot.constraints.drives import motor_joints
from twistwrench.testing import random_robot

ROUNDING = 1e-9
"""Relative to the largest torque. A'λ solves a least-squares problem of condition up to some 1e4 on numbers rounded to 1e-16."""
KINDS = ("revolute", "continuous", "prismatic", "helical", "fixed")


def standing(seed):
    """Random floating tree, one or two of its last links held by the ground, and a motion that keeps the loops closed."""
    rng = np.random.default_rng(seed)
    robot = random_robot(seed, joints=6, kinds=KINDS, floating_base=True)
    q = robot.random_configuration(rng)
    closed = robot
    for link in rng.permutation([name for name in robot.model.leaves if robot.model.frames[name].body > 0])[:2]:
        pose = robot.forward_kinematics(q, frame=str(link))
        closed = closed.close("ground", str(link), pose=pose, near=q, redundant="accept")
    q = closed.consistent(q)
    dq = closed.project_velocity(q, rng.uniform(-1, 1, robot.nv))
    return closed, q, dq, closed.project_acceleration(q, dq, rng.uniform(-1, 1, robot.nv))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))])
def test_a_free_root_has_no_torque_and_the_constraints_bear_the_rest(seed):
    """M q̈ + h + A'λ = τ with exact zeros at the root, for every motion; λ and τ make forward dynamics give q̈ again."""
    closed, q, dq, ddq = standing(seed)
    robot = closed.open()
    tau, lam = closed.inverse_dynamics(q, dq, ddq)
    assert (tau[:6] == 0).all()
    whole = robot.mass_matrix(q) @ ddq + robot.bias_forces(q, dq) + closed.constraint_jacobian(q).T @ lam
    np.testing.assert_allclose(whole, tau, rtol=0, atol=ROUNDING * max(1.0, abs(whole).max()))
    motors = [name for name in robot.joint_names if name != "root_joint"]
    same = closed.inverse_dynamics(q, dq, ddq, motors)
    np.testing.assert_array_equal(same.tau, tau)


def test_a_robot_bolted_to_the_ground_by_its_last_link_presses_on_it_with_its_weight():
    """λ of the bolted foot is the whole weight, and the free root bears nothing."""
    robot = tw.robots.quadruped()
    foot, q = robot.model.leaves[0], robot.neutral
    closed = robot.close("ground", foot, pose=robot.forward_kinematics(q, frame=foot), near=q)
    tau, lam = closed.holding_torques(q)
    R = robot.forward_kinematics(q, frame=foot)[:3, :3]
    weight = robot.model.moving_mass * robot.gravity
    np.testing.assert_allclose(R @ lam[3:], weight, atol=1e-9 * abs(weight).max())
    assert (tau[:6] == 0).all()
    assert abs(tau[6:]).max() > 1


def test_feet_that_cannot_hold_a_free_root_are_an_error_that_names_the_root():
    """One point on the ground cannot balance a dog, and nothing else holds its base."""
    robot = tw.robots.quadruped()
    foot, q = robot.model.leaves[0], robot.neutral
    one = robot.close("ground", foot, rows="vx vy vz", pose=robot.forward_kinematics(q, frame=foot), near=q)
    with pytest.raises(ConstraintError, match=r"Nothing drives root_joint.*another foot"):
        one.holding_torques(q)


CART = """<mujoco><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0"/><joint name="lift" type="slide" axis="0 0 1"/>
<geom type="box" size=".2 .2 .1" mass="5"/>
<body name="arm" pos="0 0 .1"><joint name="shoulder" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="1"/>
<body name="tip" pos=".5 0 0"><joint name="elbow" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1"/>
</body></body></body></worldbody>
<actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>"""


def test_joints_that_a_files_actuators_leave_out_are_passive():
    """A root of two sliders without motors: its rows are 0 as at a free root, and a motor named on purpose is one."""
    robot = tw.load(CART)
    q = np.array([0.1, 0.2, 0.4, 0.5])
    closed = robot.close("ground", "tip", rows="wy vx vz", pose=robot.forward_kinematics(q, frame="tip"), near=q)
    rest = np.zeros(4)
    tau = closed.inverse_dynamics(q, rest, rest).tau
    assert (tau[:2] == 0).all()
    assert abs(tau[2:]).max() > 1
    assert abs(closed.inverse_dynamics(q, rest, rest, ["lift", "shoulder", "elbow"]).tau[1]) > 1


def test_a_planar_base_is_not_driven():
    text = """<robot name="glider"><link name="floor"/>
    <link name="base"><inertial><mass value="4"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <link name="arm"><inertial><origin xyz=".2 0 0"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial></link><link name="hand"><inertial><origin xyz=".2 0 0"/><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="glide" type="planar"><parent link="floor"/><child link="base"/><axis xyz="0 0 1"/></joint>
    <joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
    <joint name="elbow" type="continuous"><parent link="arm"/><child link="hand"/><origin xyz=".4 0 0"/><axis xyz="0 0 1"/></joint>
    </robot>"""
    robot = tw.load(text)
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    closed = robot.close("ground", "hand", rows="wz vx vy", pose=robot.forward_kinematics(q, frame="hand"), near=q)
    dq = closed.project_velocity(q, np.ones(5))
    ddq = closed.project_acceleration(q, dq, np.ones(5))
    assert (closed.inverse_dynamics(q, dq, ddq).tau[:3] == 0).all()
    assert (closed.explain(q, dq, ddq).torque[:3] == 0).all()
    driven = closed.joint_wrenches(q, dq, ddq, ["shoulder", "elbow"])
    np.testing.assert_array_equal(closed.joint_wrenches(q, dq, ddq), driven)


def test_the_motor_of_a_follower_drives_its_leader():
    """A file whose only actuator stands at the joint that follows another by an equality; the third has none."""
    inertial = '<inertial pos=".1 0 0" mass="1" diaginertia=".1 .1 .1"/>'
    robot = tw.load(f"""<mujoco><worldbody><body>{inertial}<joint name="leader" axis="0 0 1"/><body pos=".2 0 0">{inertial}
    <joint name="follower" axis="0 0 1"/><body pos=".2 0 0">{inertial}<joint name="idle" axis="0 0 1"/></body></body></body></worldbody>
    <equality><joint joint1="follower" joint2="leader" polycoef="0 2 0 0 0"/></equality>
    <actuator><motor joint="follower"/></actuator></mujoco>""")
    assert motor_joints(robot) == ["leader"]


def test_motors_of_an_actuator_file_drive_beside_those_of_the_robots_file():
    """Three vertical slides of 1, 2 and 4 kg: the first has the file's motor, the second one of an actuator file, and the
    third rides on the first."""
    slides = "".join(
        f'''<body name="{name}" pos="{m} 0 0"><inertial pos="0 0 0" mass="{m}" diaginertia="1 1 1"/>
        <joint name="{name}" type="slide" axis="0 0 1"/></body>'''
        for name, m in {"first": 1, "second": 2, "third": 4}.items()
    )
    text = f'<mujoco><worldbody>{slides}</worldbody><actuator><motor joint="first"/></actuator></mujoco>'
    robot = tw.load(text).with_actuators({"actuators": {"second": {"ratio": 10}}})
    closed = robot.close("first", "third", rows="vz", near=np.zeros(3))
    tau = closed.inverse_dynamics(np.zeros(3), np.zeros(3), np.zeros(3)).tau
    np.testing.assert_allclose(tau, 9.81 * np.array([1 + 4, 2, 0]), rtol=1e-9, atol=1e-9)
