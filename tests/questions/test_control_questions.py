"""Control, kinematics and contact forces.

Pages: [Control](control.md), [calibrate a wrist sensor](sensor.md), [inverse kinematics](trajectories.md#inverse-kinematics).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw

HOME = np.array([0.3, -1.2, 1.5, -0.4, 0.8, 0.2])


def test_external_wrench_without_sensor():
    """How do I estimate an external wrench without a sensor?

    `tw.control.MomentumObserver`, from positions, velocities and joint torques; `observer.over` takes a whole record.

    Source: orocos_kdl#304, ros2_kortex#164, kortex2#87.
    Number: the wrench with which the simulated arm is pushed.
    """
    arm = tw.robots.planar_2r()
    push, q = {"tip": [0, 0, 0, 3.0, -2.0, 0]}, np.array([0.3, 1.2])
    hold = tw.control.ComputedTorque(arm, q, kp=400.0, kd=40.0)
    run = arm.simulate(q, duration=0.5, dt=0.001, tau=hold, wrench_on_robot=push)
    external = tw.control.MomentumObserver(arm, gain=50.0).over(run.times, run.q, run.dq, run.tau)
    print(external[-1].round(2), arm.wrench_torques(run.q[-1], push["tip"]).round(2))
    assert external[-1] == approx(arm.wrench_torques(run.q[-1], push["tip"]), abs=0.05)


def test_weight_in_the_wrist_sensor():
    """How do I take the weight of the tool out of my wrist sensor?

    `twistwrench sensor` calibrates bias, mass and centre of mass from readings at rest; `ForceTorqueSensor.predict` is what to subtract.

    Source: cartesian_controllers#100, mujoco_menagerie#156.
    Number: the weight of a tool of 2 kg with its centre 0.1 m in front of the sensor, by hand.
    """
    tool = tw.SpatialInertia.from_com(2.0, (0, 0, 0.1))
    sensor = tw.sensing.ForceTorqueSensor(tool, np.zeros(6), sign="on_sensor")
    level = tw.se3.exp([0, np.pi / 2, 0, 0, 0, 0])  # the sensor's z axis points along x of the world
    print(sensor.predict(level).round(3) + 0.0)
    assert np.abs(sensor.predict(level)) == approx([0, 2 * 9.81 * 0.1, 0, 2 * 9.81, 0, 0], abs=1e-9)


def test_threshold_of_a_collision_detector():
    """Which threshold does my collision detector need?

    `observer.threshold(log, per_hour=…)` takes a log without contact, and returns the residual that is passed by chance so often.

    Source: deoxys_control#27, ros2_kortex#4, spot-sim2real#194.
    Number: white noise of 0.5 N m behind the filter, σ √((1 − a)/(1 + a)) with a = e^(−K dt), of which an hour passes 4 to 5.5.
    """
    arm, t = tw.robots.planar_2r(), np.arange(0, 60, 0.01)
    work = tw.Motion(t, np.stack([np.sin(t), np.cos(0.7 * t)], axis=1), robot=arm)
    noise = np.random.default_rng(0).normal(0, 0.5, work.q.shape)
    log = tw.Motion(t, work.q, work.dq, work.ddq, work.torques() + noise, robot=arm)
    found = tw.control.MomentumObserver(arm, 30.0).threshold(log, per_hour=1.0)
    print(found.headline)
    a = np.exp(-30 * 0.01)
    sigma = 0.5 * np.sqrt((1 - a) / (1 + a))
    assert 4 * sigma < found.noise[1] < 5.5 * sigma


def test_task_space_at_a_singular_pose():
    """Is task-space control finite at a singular pose?

    Yes. Λ is then the inertia in the directions that remain, and `lost_directions` names the others.

    Source: IsaacLab#2775, IsaacLab#7063.
    Number: the stretched arm of the book: only the mass of the tip, across the arm.
    """
    arm = tw.robots.planar_2r()
    plane = {"kind": "world_aligned", "rows": "vx vz"}
    print(arm.task_inertia([0, 0], **plane), arm.lost_directions([0, 0], **plane))
    assert arm.task_inertia([0, 0], **plane) == approx(np.diag([0.0, 1.0]), abs=1e-9)


def test_task_inertia_and_bias():
    """How do I get the inertia and the bias forces in task space?

    `robot.task_inertia(q)` and `robot.task_bias(q, dq)`, with F = Λ V̇ + η.

    Source: fairo#1059, pinocchio#1933.
    Number: Λ of the book's arm with its elbow at 90°, diag(1, 2) kg.
    """
    arm = tw.robots.planar_2r()
    plane = {"kind": "world_aligned", "rows": "vx vz"}
    print(arm.task_inertia([0, np.pi / 2], **plane), arm.task_bias([0, np.pi / 2], [1.0, 0.0], **plane))
    assert arm.task_inertia([0, np.pi / 2], **plane) == approx(np.diag([1.0, 2.0]), abs=1e-12)


def test_joint_or_cartesian_inertia():
    """What is the difference between joint-space and Cartesian inertia?

    M(q) belongs to the joints, Λ = (J M⁻¹ Jᵀ)⁻¹ to the tip; both have the same kinetic energy if J is square.

    Source: libfranka#146.
    Number: ½ q̇ᵀ M q̇ = ½ Vᵀ Λ V.
    """
    ur5 = tw.robots.ur5()
    dq = np.full(6, 0.5)
    V = ur5.jacobian(HOME) @ dq
    print(f"{dq @ ur5.mass_matrix(HOME) @ dq / 2:.6f} J, {V @ ur5.task_inertia(HOME) @ V / 2:.6f} J")
    assert V @ ur5.task_inertia(HOME) @ V == approx(dq @ ur5.mass_matrix(HOME) @ dq, rel=1e-9)


def test_sliding_joint():
    """What do the Jacobian and the Coriolis terms of a sliding joint look like?

    A sliding joint has a column (0, v) of unit velocity. Its Coriolis force comes with the rotation of other joints.

    Source: moveit#1191, curobo#724.
    Number: a mass m on a turning slide, 2 m r ṙ θ̇ at the hinge and −m r θ̇² at the slide.
    """
    polar = tw.ModelBuilder("polar")
    for link, mass in (("base", None), ("arm", 1e-12), ("slide", 2.0)):
        polar.add_link(link, None if mass is None else tw.SpatialInertia.from_com(mass))
    polar.add_joint("hinge", "continuous", "base", "arm", axis=(0, 0, 1))
    polar.add_joint("slider", "prismatic", "arm", "slide", axis=(1, 0, 0))
    robot = tw.Robot(polar.build(inertia="accept"))
    print(robot.jacobian([0, 0.5], "slide")[:, 1], robot.coriolis_forces([0, 0.5], [3.0, 0.4]))
    assert robot.coriolis_forces([0, 0.5], [3.0, 0.4]) == approx([2 * 2 * 0.5 * 0.4 * 3, -2 * 0.5 * 9])


def test_inverse_kinematics_converges():
    """Does inverse kinematics converge, and does it accept the exact start?

    Yes. `converged` is true only below 1e-10 rad and 1e-10 m, and the exact start returns itself.

    Source: lerobot#3613, robotics-toolbox#664, robotics-toolbox#667.
    Number: the pose by forward kinematics.
    """
    ur5 = tw.robots.ur5()
    T = ur5.forward_kinematics(HOME)
    found, same = ur5.inverse_kinematics(T, q0=HOME + 0.3), ur5.inverse_kinematics(T, q0=HOME)
    print(found.converged, same.converged, np.abs(same.q - HOME).max())
    assert ur5.forward_kinematics(found.q) == approx(T, abs=1e-9)
    assert same.q == approx(HOME, abs=1e-12)


def test_hobby_arm():
    """How do I compensate gravity on a hobby arm with five joints, with inverse kinematics?

    `robot.gravity_forces(q)`, and `inverse_kinematics(…, rows="vx vy vz")` for the position alone.

    Source: lerobot#2352, lerobot#678, openarm#35, so101-nexus#9.
    Number: the position by forward kinematics.
    """
    arm = tw.robots.ur5().lock({"wrist_3_joint": 0.0})  # an arm of five joints
    goal = arm.forward_kinematics([0.3, -1.2, 1.5, -0.4, 0.8])
    goal[:3, 3] += [0.02, -0.03, 0.01]
    found = arm.inverse_kinematics(goal, q0=HOME[:5], rows="vx vy vz")
    print(found.converged, arm.gravity_forces(found.q).round(2) + 0.0)
    assert arm.forward_kinematics(found.q)[:3, 3] == approx(goal[:3, 3], abs=1e-9)
