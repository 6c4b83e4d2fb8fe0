"""Closed loops and several robots.

Pages: [Robots with closed loops](constraints.md), [build a cell](cells.md), [robot file formats](formats.md).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw


def test_dynamics_of_a_linkage():
    """How do I compute the inverse dynamics of a linkage?

    Load the tree, close its loop with `robot.close`, and name the joint that has the motor.

    Source: pinocchio#2356, onshape-to-robot#94 (ABB 8700).
    Number: virtual work, Σ g · (what each joint turns per turn of the motor), with the turns by differences.
    """
    arm = tw.robots.planar_3r()
    linkage = arm.close("ground", "tip", rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.2, 0, 0]))
    q = linkage.consistent([2.0, -1.5, -1.5], within=2.0)
    torque = linkage.holding_torques(q, actuated=["joint1"]).tau
    print(q.round(4), torque.round(4))
    near = linkage.consistent(q + 1e-5 * linkage.project_velocity(q, [1.0, 0, 0]))
    turns = (near - q) / (near[0] - q[0])
    assert torque[0] == approx(arm.gravity_forces(q) @ turns, rel=1e-4)


def test_loops_in_a_urdf_file():
    """Are loops in a URDF file read?

    Yes, the `<constraint>` elements proposed for URDF. `robot.closures` lists them, and `robot.close` closes them.

    Source: urdfdom_headers#108, pinocchio#1274.
    Number: degrees of freedom by Grübler's formula, 3 joints less 2 constraints of a pin in the plane.
    """
    text = tw.robots.path_of("planar_3r").read_text()
    pin = """<constraint name="pin" type="spherical"><parent link="base"/><parent_origin xyz="1.2 0 0"/><child link="tip"/></constraint>"""
    robot = tw.load(text.replace("</robot>", f"{pin}</robot>"))
    loop = robot.closures["pin"]
    linkage = robot.close(loop.frame_a, loop.frame_b, loop.rows, near=[2.0, -1.5, -1.5], redundant="accept")
    q = linkage.consistent([2.0, -1.5, -1.5], within=2.0)
    print(loop.rows, linkage.degrees_of_freedom(q), robot.forward_kinematics(q, "tip")[:3, 3].round(9))
    assert linkage.degrees_of_freedom(q) == 1
    assert robot.forward_kinematics(q, "tip")[:3, 3] == approx([1.2, 0, 0], abs=1e-9)


def test_loop_of_an_sdf_file():
    """How do I compute the inverse dynamics of a loop in an SDF file?

    Load the tree and close it: bushings and plugins of an SDF file are not closures, so name the two frames.

    Source: rbdl-orb#31.
    Number: the same linkage from its URDF file.
    """
    tw.save(tw.robots.planar_3r(), "arm.sdf")
    corner = tw.se3.exp([0, 0, 0, 1.2, 0, 0])
    linkage, other = (
        r.close("ground", "tip", rows="vx vz", pose=corner) for r in (tw.load("arm.sdf"), tw.robots.planar_3r())
    )
    q = linkage.consistent([2.0, -1.5, -1.5], within=2.0)
    found = linkage.inverse_dynamics(q, np.zeros(3), np.zeros(3), actuated=["joint1"])
    print(found.tau.round(4) + 0.0)
    assert found.tau == approx(other.holding_torques(q, actuated=["joint1"]).tau, abs=1e-8)


def test_loop_with_a_free_hinge():
    """How do I close a loop with a hinge, whose axis stays free?

    `rows` lists what is held: `"wx wy vx vy vz"` is a hinge about z, all six are a weld.

    Source: pinocchio#2729.
    Number: degrees of freedom: a box with six velocities less five rows.
    """
    box = tw.robots.floating_box()
    hinged = box.close("ground", "box", rows="wx wy vx vy vz")
    print(hinged)
    assert hinged.degrees_of_freedom(box.neutral) == 1


def test_forces_of_a_loop():
    """How do I get the constraint forces λ of a loop?

    `linkage.forward_dynamics(q, dq, tau)` has `ddq` and `lam`; `linkage.wrenches(lam)` is the wrench at the cut.

    Source: pinocchio#1553, pinocchio#2150, pinocchio#2527.
    Number: the equation of motion of the open robot, τ = M q̈ + h + Aᵀλ.
    """
    arm = tw.robots.planar_3r()
    linkage = arm.close("ground", "tip", rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.2, 0, 0]))
    q = linkage.consistent([2.0, -1.5, -1.5], within=2.0)
    dq = linkage.project_velocity(q, [0.5, 0.0, 0.0])
    found = linkage.forward_dynamics(q, dq, [1.0, 0.0, 0.0])
    print(found.lam.round(3))
    A = linkage.constraint_jacobian(q)
    assert arm.inverse_dynamics(q, dq, found.ddq) + A.T @ found.lam == approx([1.0, 0, 0], abs=1e-9)


def test_two_arms_hold_an_object():
    """How do two arms hold one object?

    `robot.attach` mounts the second arm, `close` welds both tips to each other, where they are. The forces inside the object are λ.

    Source: robotoc#139, ocs2#105.
    Number: 12 velocities less 6 constraints.
    """
    pair = tw.robots.ur5().attach(tw.robots.ur5(), "base_link", tw.se3.exp([0, 0, 0, 0, 0.8, 0]), prefix="right_")
    q = np.array([0.3, -1.2, 1.5, -0.4, 0.8, 0.2] * 2)
    grasp = tw.se3.inverse(pair.forward_kinematics(q, "tool0")) @ pair.forward_kinematics(q, "right_tool0")
    held = pair.close("tool0", "right_tool0", pose=grasp, near=q)
    hold = held.holding_torques(q, actuated=held.joint_names)
    print(hold.tau.round(1), held.degrees_of_freedom(q))
    assert held.degrees_of_freedom(q) == 6
    assert pair.gravity_forces(q) == approx(hold.tau - 0 + held.constraint_jacobian(q).T @ -hold.lam, abs=1e-8)


def test_mobile_base_with_an_arm():
    """How do I put an arm on a mobile base?

    `robot.attach` or `twistwrench join`; a base that moves in the plane has a planar joint (x, y, angle).

    Source: pinocchio#2182.
    Number: the force m a of the whole mass for an acceleration of 1 m/s² of the base, 10 kg + 2 kg.
    """
    base = tw.ModelBuilder("base")
    base.add_link("floor")
    base.add_link("cart", tw.SpatialInertia.box((0.6, 0.4, 0.2), mass=10.0))
    base.add_joint("drive", "planar", "floor", "cart", axis=(0, 0, 1))
    mobile = tw.Robot(base.build()).attach(tw.robots.planar_2r(), "cart", prefix="arm_")
    tau = mobile.inverse_dynamics(np.zeros(5), np.zeros(5), [0, 1.0, 0, 0, 0])
    print(mobile.velocity_names, tau)
    assert tau[1] == approx(12.0)


def test_linear_track():
    """How do I put my arm on a linear track, or a gripper on it?

    `twistwrench join cell.urdf rail.urdf arm.urdf@carriage gripper.urdf@tool0`. In Python `tw.join`, here an arm on another:

    Source: searches for seventh axis, linear track, gantry.
    Number: the sum of the masses of the parts that move, 16.99 kg and 2 kg.
    """
    cell = tw.join("ur5", "planar_2r@tool0:hand_", name="arm_with_hand")
    print(cell.headline)
    assert cell.robot.nv == 8
