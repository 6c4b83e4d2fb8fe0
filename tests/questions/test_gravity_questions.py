"""Gravity and torques at rest.

Pages: [Forces at the tip](statics.md), [conventions](conventions.md#gravity), [limits](limits.md), [the kilohertz loop in C](export.md#a-kilohertz-loop).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw


def test_tilted_base():
    """How do I compute gravity torques on a tilted base?

    `robot.with_gravity` takes gravity in the axes of the base. A base that leans by 30° about its y axis:

    Source: franka_ros#338, franka_ros#327, kinova-ros#413.
    Number: the same arm upright with its first joint, whose axis is −y, turned by −30°.
    """
    arm = tw.robots.planar_2r()
    R = tw.so3.exp([0, np.radians(30), 0])
    tilted = arm.with_gravity(R.T @ [0, 0, -9.81])
    print(tilted.gravity_forces([0.2, 0.4]))
    assert tilted.gravity_forces([0.2, 0.4]) == approx(arm.gravity_forces([0.2 - np.radians(30), 0.4]))


def test_gravity_as_an_input():
    """How do I change gravity in a running controller?

    Make gravity an input of the kernel, or of the exported C function (`--quantity gravity_forces:gravity=input`).

    Source: Universal_Robots_Client_Library#415.
    Number: the robot with that gravity as its own.
    """
    ur5 = tw.robots.ur5()
    q = np.array([0.1, -1.0, 1.2, 0.3, 0.7, 0.0])
    g = ur5.kernel("gravity_forces", gravity="input")
    print(g(q, [0, 0, -9.81])[:3].round(3), g(q, [4.9, 0, -8.5])[:3].round(3))
    assert g(q, [4.9, 0, -8.5]) == approx(ur5.with_gravity([4.9, 0, -8.5]).gravity_forces(q))


def test_hold_an_arm():
    """Which torques hold an arm against gravity?

    `robot.gravity_forces(q)`, for any batch of configurations.

    Source: robotics.stackexchange 2889.
    Number: two point masses of 1 kg on links of 1 m, (m₁ + m₂) g L₁ + m₂ g L₂ and m₂ g L₂.
    """
    arm = tw.robots.planar_2r()
    print(arm.gravity_forces([0, 0]))
    assert arm.gravity_forces([0, 0]) == approx([3 * 9.81, 9.81])


def test_compensation_holds():
    """Does gravity compensation hold the arm?

    Yes: released at rest with τ = g(q), it stays where it is.

    Source: ModernRobotics#48.
    Number: no net torque, no motion.
    """
    panda = tw.robots.panda()
    q = np.array([0, 0.5, 0, -1.5, 0, 1.8, 0.8])
    run = panda.simulate(q, duration=2.0, dt=0.02, controller=lambda t, q, dq: panda.gravity_forces(q))
    print(f"moved by {np.abs(run.q - q).max():.0e} rad in {run.times[-1]:.0f} s")
    assert np.abs(run.q - q).max() < 1e-9


def test_effort_limits_of_a_file():
    """Are the effort limits of my robot file plausible?

    `twistwrench payload` compares them with the robot's own weight. Here every joint has the effort 10:

    Source: universal_robot#32.
    Number: the gravity torque of the shoulder of the UR5, by `gravity_forces`.
    """
    answer = tw.payload("ur5", limits={"effort": np.full(6, 10.0)})
    print(answer.headline)
    assert not answer.verdict.ok
    assert np.abs(tw.robots.ur5().gravity_forces(np.zeros(6))).max() == approx(59.17, abs=0.01)


def test_wrench_at_the_tip():
    """Which joint torques does a wrench at the tip need, and with which sign?

    τ = Jᵀ F for the wrench F that the robot applies. Gravity comes in addition: `holding_torques(q, wrench_by_robot=…)`.

    Source: the exercises of chapter 5 of Modern Robotics.
    Number: force times lever arm: 2 N at the end of two links of 1 m at a right angle.
    """
    arm = tw.robots.planar_2r()
    q, F = [0, np.pi / 2], np.array([0, 0, 0, 1.0, 2.0, 0])  # in the axes of the tip, which points up
    print(arm.wrench_torques(q, F), arm.holding_torques(q, wrench_by_robot={"tip": F}))
    assert arm.wrench_torques(q, F) == approx([3, 2])
    assert arm.holding_torques(q, wrench_by_robot={"tip": F}) == approx([3 + 19.62, 2])


def test_thrusters():
    """How do I get joint torques of a robot with thrusters?

    A thruster is a wrench of the world on the robot, at the frame where it is mounted.

    Source: jsk_aerial_robot#781.
    Number: thrust times lever arm: 5 N upward at 2 m and 1 m from the joints carries 5 · 2 and 5 · 1 N m.
    """
    arm = tw.robots.planar_2r()
    up = arm.forward_kinematics([0, 0])[:3, :3].T @ [0, 0, 5.0]
    print(arm.holding_torques([0, 0], wrench_on_robot={"tip": [0, 0, 0, *up]}))
    assert arm.holding_torques([0, 0], wrench_on_robot={"tip": [0, 0, 0, *up]}) == approx([29.43 - 10, 9.81 - 5])


def test_bias_from_a_file_without_meshes():
    """Can I compute M, h and g from a URDF file without its meshes?

    Yes. Meshes are needed only for pictures and for distances between links.

    Source: doosan-robot2#47, newton#2497.
    Number: M of a rod of 2 kg and 0.6 m about its end, m L²/3, and its gravity torque m g L/2.
    """
    rod = tw.load("""<robot name="rod"><link name="base"/><link name="rod">
      <visual><geometry><mesh filename="package://lost/rod.stl"/></geometry></visual>
      <inertial><origin xyz="0.3 0 0"/><mass value="2"/><inertia ixx="0" iyy="0.06" izz="0.06" ixy="0" ixz="0" iyz="0"/></inertial>
      </link><joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 -1 0"/></joint></robot>""")
    print(rod.mass_matrix([0]), rod.gravity_forces([0]))
    assert rod.mass_matrix([0]) == approx(np.array([[2 * 0.6**2 / 3]]))
    assert rod.gravity_forces([0]) == approx([2 * 9.81 * 0.3])
