"""Payloads and tools.

Pages: [The largest payload](statics.md#the-largest-payload), [one rigid body](one-body.md), [what is carried](identification.md#known-values-payloads-essential-groups).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw


def test_payload_at_run_time():
    """How do I add and remove a payload at run time?

    `robot.with_payload(inertia, frame)` returns a new robot; the old one is unchanged.

    Source: pinocchio#1848, pinocchio#1491.
    Number: weight times lever arms, 3 kg · 9.81 m/s² at 2 m and 1 m.
    """
    arm = tw.robots.planar_2r()
    loaded = arm.with_payload(tw.SpatialInertia.from_com(3.0), "tip")
    print(loaded.gravity_forces([0, 0]) - arm.gravity_forces([0, 0]))
    assert loaded.gravity_forces([0, 0]) - arm.gravity_forces([0, 0]) == approx([58.86, 29.43])


def test_payload_of_zero():
    """Does a payload of zero change the torques?

    No. A payload of 0 kg changes them by exactly 0.

    Source: robotics-toolbox#134, robotics-toolbox#638.
    Number: no mass, no torque.
    """
    ur5 = tw.robots.ur5()
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 6))
    empty = ur5.with_payload(tw.SpatialInertia.from_com(0.0), "tool0")
    print(np.abs(empty.inverse_dynamics(q, dq, ddq) - ur5.inverse_dynamics(q, dq, ddq)).max())
    assert (empty.inverse_dynamics(q, dq, ddq) == ur5.inverse_dynamics(q, dq, ddq)).all()


def test_gripper_and_camera():
    """How do I add a gripper and a camera as one load?

    Add `SpatialInertia` objects in one frame; `in_frame` moves a part there.

    Source: droid#72.
    Number: the common centre of mass, (0.925 · 60 + 0.095 · 120) mm / 1.02, by hand.
    """
    gripper = tw.SpatialInertia.from_com(0.925, (0, 0, 0.06), np.diag([4e-3, 4e-3, 1e-3]))
    camera = tw.SpatialInertia.from_com(0.095, (0, 0, 0.12))
    both = gripper + camera
    print(f"{both.mass:.3f} kg, centre of mass at z = {1000 * both.com[2]:.2f} mm")
    assert both.mass == approx(1.02)
    assert both.com[2] == approx((0.925 * 0.06 + 0.095 * 0.12) / 1.02)


def test_payload_for_a_controller():
    """How do I get mass, centre of mass and inertia of a tool for the robot's controller?

    Print a `SpatialInertia`: controllers want the tensor about the centre of mass, which is `moment_about_com`.

    Source: Universal_Robots_ROS2_Driver#1711, universal_robot#78.
    Number: a solid cylinder, m r²/2 and m (3 r² + h²)/12.
    """
    tool = tw.SpatialInertia.cylinder(0.04, 0.12, mass=1.5).in_frame(tw.se3.exp([0, 0, 0, 0, 0, 0.06]))
    print(tool)
    assert np.diag(tool.moment_about_com) == approx([0.0024, 0.0024, 0.0012])


def test_rated_payload():
    """What is the largest payload in the worst pose?

    `twistwrench payload ROBOT` for one pose; `--map` for a slice of the workspace, with the best and the worst of each cell.

    Source: openarm#87.
    Number: the stretched arm, (60 N m − 3 · 9.81 N m) / (9.81 m/s² · 2 m), by hand.
    """
    arm = tw.robots.planar_2r()
    poses = arm.random_configuration(rng=0, size=2000)
    found = tw.statics.largest_payload(arm, poses, limits=[60.0, 30.0])
    worst = found.mass.argmin()
    print(
        f"{found.mass[worst]:.2f} kg, limited by {found.joint_names[found.joint[worst]]}, at {poses[worst].round(1)} rad"
    )
    assert found.mass[worst] == approx((60 - 3 * 9.81) / (2 * 9.81), abs=0.01)


def test_lengths_masses_servos():
    """How much does my arm of these lengths, masses and servos lift?

    Describe it by its Denavit–Hartenberg table with the masses of its links. Two links of 0.2 m and 0.15 m, stretched out, with
    servos of 1.5 N m:

    Source: robotics.stackexchange 7194, automaticaddison.com.
    Number: (1.5 N m − weights times levers) / (g · 0.35 m), by hand.
    """
    lengths, masses = np.array([0.2, 0.15]), np.array([0.12, 0.08])
    arm = tw.from_dh(
        {"d": [0, 0], "a": lengths, "alpha": [0, 0]},
        masses=masses,
        coms=[(-L / 2, 0, 0) for L in lengths],  # centre of each link
        moments_about_com=[np.diag([0, m * L**2 / 12, m * L**2 / 12]) for m, L in zip(masses, lengths, strict=True)],
        gravity=[0, -9.81, 0],  # the joints turn about horizontal axes
    )
    found = tw.statics.largest_payload(arm, [0, 0], limits=[1.5, 1.5])
    print(f"{found.mass:.3f} kg, limited by {found.joint_names[int(found.joint)]}")
    assert found.mass == approx((1.5 - 9.81 * (0.12 * 0.1 + 0.08 * 0.275)) / (9.81 * 0.35))


def test_hand_in_gravity_compensation():
    """Why does gravity compensation forget the hand?

    The hand must be part of the robot: in the file, or by `robot.attach` or `with_payload`. Its share is the difference:

    Source: franka_ros#160, panda-gazebo#39.
    Number: weight times horizontal distance between the hand's centre of mass and the axis of joint 2.
    """
    panda = tw.robots.panda()
    q = np.array([0, 0.5, 0, -1.5, 0, 1.8, 0.8])
    hand = tw.SpatialInertia.from_com(0.73, (-0.01, 0, 0.03))
    share = panda.with_payload(hand, "panda_hand").gravity_forces(q) - panda.gravity_forces(q)
    print(share.round(3) + 0.0)
    T = panda.forward_kinematics(q, "panda_hand")
    com = T[:3, :3] @ hand.com + T[:3, 3]
    assert share[1] == approx(-0.73 * 9.81 * com[0])


def test_two_tensors_added():
    """How do I add the inertias of two parts, with the parallel axis theorem?

    Add `SpatialInertia` objects, which are about the origin of a common frame. Two balls at ±10 cm:

    Source: solidworks_urdf_exporter#117, droid#72.
    Number: 2 (2/5 m r² + m d²) with m = 1 kg, r = 5 cm, d = 10 cm.
    """
    ball = tw.SpatialInertia.sphere(radius=0.05, mass=1.0)
    sides = [ball.in_frame(tw.se3.exp([0, 0, 0, x, 0, 0])) for x in (-0.1, 0.1)]
    both = sides[0] + sides[1]
    print(np.diag(both.moment_about_com))
    assert np.diag(both.moment_about_com) == approx([0.002, 0.022, 0.022])
