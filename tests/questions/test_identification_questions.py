"""Identification, servos and calibration.

Pages: [Identify masses, inertias and friction](identification.md), [logs without torques](identification.md#logs-without-torques),
[calibrate an arm](calibration.md).
"""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
from pytest import approx

import twistwrench as tw


@functools.cache
def log(payload: float = 0.0) -> tw.Motion:
    """Twenty seconds of the book's arm with 0.8 N m and 0.3 N m s/rad of friction in each joint, and 10 mN m of noise."""
    arm = tw.robots.planar_2r()
    real = arm.with_payload(tw.SpatialInertia.from_com(payload), "tip")
    t = np.arange(0, 20, 0.01)
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 2, 5)) / np.arange(1, 6)
    w = np.outer(t, 2 * np.pi * np.arange(1, 6) / 10)
    q = np.sin(w) @ a.T + np.cos(w) @ b.T
    motion = tw.Motion(t, q, robot=real)
    friction = 0.8 * np.tanh(motion.dq / 0.01) + 0.3 * motion.dq
    return tw.Motion(t, q, tau=motion.torques() + friction + 0.01 * rng.normal(size=q.shape), robot=arm)


@functools.cache
def found() -> tw.identification.IdentifiedRobot:
    return tw.identify(tw.robots.planar_2r(), log(), motor_inertia=False)


def test_friction_is_identified():
    """Is friction part of the identification?

    Yes: viscous and Coulomb friction with an offset for each joint; `friction=` adds Stribeck's law.

    Source: FloBaRoID#3, pinocchio#1416.
    Number: 0.8 N m and 0.3 N m s/rad, with which the log was simulated.
    """
    result = tw.identify(tw.robots.planar_2r(), log(), motor_inertia=False)
    for name in ("joint2.coulomb", "joint2.viscous"):
        print(name, round(result.parameters[name][0], 2))
    assert result.parameters["joint2.coulomb"][0] == approx(0.8, abs=0.05)
    assert result.parameters["joint2.viscous"][0] == approx(0.3, abs=0.05)


def test_friction_of_each_joint(shell):
    """How do I find the friction of each joint from tests on the arm?

    `twistwrench identify ROBOT log.csv`; the report has a table of friction. `--json` and `--out-actuators` write it.

    Source: openarm#103.
    Number: the names of the parameters: three of friction for each of two joints.
    """
    shell("twistwrench identify planar_2r demo --friction-model viscous,coulomb,offset --json found.json")
    parameters = json.loads(Path("found.json").read_text())["parameters"]
    assert {f"joint{i}.{law}" for i in (1, 2) for law in ("viscous", "coulomb", "offset")} <= {*parameters}


def test_which_friction_law():
    """Which friction formula was fitted?

    The laws and their units stand in the report: viscous · q̇ + coulomb · sign(q̇) + offset.

    Source: eRob_Compensation#1.
    Number: the names of the parameters, one of each law for a joint.
    """
    result = tw.identify(tw.robots.planar_2r(), log(), motor_inertia=False)
    names = [name for name in result.parameters if name.startswith("joint2.")]
    print(names)
    assert names == ["joint2.viscous", "joint2.coulomb", "joint2.offset"]


def test_log_into_an_mjcf_file():
    """How do I bring the masses of a real log into an MJCF file?

    `twistwrench identify arm.xml log.csv --out new.xml` edits the text of the file; `found.write` does the same in Python.

    Source: mujoco-sysid#10.
    Number: the gravity torques of the identified robot.
    """
    tw.save(tw.robots.planar_2r(), "arm.xml")
    result = tw.identify("arm.xml", log(), motor_inertia=False)
    result.write("new.xml", logs=["log.csv"])
    print(tw.load("new.xml").gravity_forces([0, 0]).round(1))
    assert tw.load("new.xml").gravity_forces([0, 0]) == approx(result.robot.gravity_forces([0, 0]), rel=1e-9)
    assert result.robot.gravity_forces([0, 0]) == approx([29.43, 9.81], rel=0.02)


def test_payload_from_a_log():
    """How do I find a payload from a log?

    `payload_only="FRAME"` estimates the body at the frame alone; all other parameters are those of the robot file, with friction.

    Source: iiwa_ros#60.
    Number: 1.2 kg, with which the log was simulated.
    """
    result = tw.identify(found().robot, log(payload=1.2), payload_only="tip", motor_inertia=False)
    print(f"{result.payload.mass:.2f} kg")
    assert result.payload.mass == approx(1.2, abs=0.03)


def test_payload_with_a_gripper():
    """How do I find the payload if a gripper is mounted?

    Attach the gripper to the robot first; the estimate is then what remains.

    Source: figaroh-examples#5, IntERAct#25.
    Number: 1.2 kg of the log less 0.5 kg of the gripper.
    """
    gripper = tw.SpatialInertia.from_com(0.5)
    result = tw.identify(found().robot.with_payload(gripper, "tip"), log(1.2), payload_only="tip", motor_inertia=False)
    print(f"{result.payload.mass:.2f} kg")
    assert result.payload.mass == approx(0.7, abs=0.03)


@functools.cache
def servos() -> tw.identification.IdentifiedServos:
    arm = tw.robots.planar_2r()
    log = tw.identification.simulated_servo_log(arm, armature=0.4, damping=3.0, coulomb=0.5, kp=90.0, delay=0.012)
    return tw.identification.identify_servos(arm, log)


def test_armature_and_friction_without_torques():
    """How do I find armature, friction loss and damping of my motors from commands and positions?

    `tw.identification.identify_servos`, or `identify --from-commands`. No torque is needed.

    Source: openarm#336, mujoco#1131, mujoco#1398, mujoco#1075.
    Number: 0.4 kg m², 3 N m s/rad and 0.5 N m, with which the log was simulated.
    """
    found = servos()
    print(found.armature.round(2), found.damping.round(1), found.coulomb.round(2))
    assert found.armature == approx([0.4, 0.4], rel=0.05)
    assert found.damping == approx([3.0, 3.0], rel=0.05)
    assert found.coulomb == approx([0.5, 0.5], rel=0.1)


def test_stiffness_of_a_servo():
    """How do I find the stiffness kp of a hobby servo without a torque sensor?

    From its commands and positions: the masses of the robot file give the scale.

    Source: pace-sim2real#13.
    Number: 90 N m/rad, with which the log was simulated.
    """
    found = servos()
    print(found.verdict.word, found.kp.round(1))
    assert found.kp == approx([90, 90], rel=0.02)


def test_delay_of_a_servo():
    """How do I find the delay of a servo, and its compliance?

    `identify_servos` has the delay with stiffness and armature. The compliance of gears needs a log with torques:
    `tw.identify(…, assume="elasticity")`.

    Source: pace-sim2real#19.
    Number: 12 ms, with which the log was simulated.
    """
    found = servos()
    print(f"{1000 * found.delay:.1f} ms")
    assert found.delay == approx(0.012, abs=5e-4)


def test_gains_for_a_simulator():
    """How do I bring gains, armature and delay of a real robot into my simulator?

    `found.write("arm.xml", "arm.yaml")` writes position actuators, armature and friction into an MJCF file.

    Source: simtoolreal#15, sim2real-robot-identification#8.
    Number: 90 N m/rad and 0.4 kg m², with which the log was simulated.
    """
    found = servos()
    print(found.robot.armature.round(2))
    assert found.robot.armature == approx([0.4, 0.4], rel=0.05)


def test_base_parameters():
    """Which combinations of parameters determine the torques, and can I have the regressor?

    `robot.regressor(q, dq, ddq)` with τ = Y π, and `found.base.names` for the independent combinations.

    Source: robotics-toolbox#455.
    Number: τ of inverse dynamics, and 4 groups of a planar arm of two links that gravity moves.
    """
    arm = tw.robots.planar_2r()
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 2))
    Y = arm.regressor(q, dq, ddq)
    print(Y.shape, np.abs(Y @ arm.parameters - arm.inverse_dynamics(q, dq, ddq)).max())
    assert Y @ arm.parameters == approx(arm.inverse_dynamics(q, dq, ddq))


def test_calibrate_the_kinematics():
    """How do I calibrate the kinematics of my arm?

    `twistwrench calibrate ROBOT readings.csv --out mine.urdf`, from positions, poses, distances or touches of the tip.

    Source: universal_robot#357, motoros2#206, robot_calibration#96.
    Number: −4.18 mrad of the elbow's zero, with which the bundled readings were simulated.
    """
    found = tw.calibration.calibrate("ur5", "demo")
    print(found.headline)
    value, half = found.zeros["elbow_joint"]
    assert abs(value + 4.18e-3) < 2 * half + 1e-4


def test_calibration_of_the_factory():
    """How do I use the factory calibration of my UR robot?

    `twistwrench calibrate ROBOT --from calibration.conf`, or `tw.calibration.factory`. Without it, poses of a plan deviate by millimetres.

    Source: universal_robot#414, robot_calibration#157, talos_robot#5.
    Number: a correction of 0.01 rad of the second zero, which is the pose with that joint turned by 0.01 rad.
    """
    zeros = "[0, 0, 0, 0, 0, 0]"
    corrections = f"delta_theta = [0, 0.01, 0, 0, 0, 0]\ndelta_a = {zeros}\ndelta_d = {zeros}\ndelta_alpha = {zeros}"
    Path("calibration.conf").write_text(f"[mounting]\n{corrections}\n")
    ur5 = tw.robots.ur5()
    mine = tw.calibration.factory(ur5, "calibration.conf")
    print((mine.forward_kinematics(np.zeros(6)) - ur5.forward_kinematics(np.zeros(6)))[:3, 3].round(4) + 0.0)
    assert mine.forward_kinematics(np.zeros(6)) == approx(ur5.forward_kinematics([0, 0.01, 0, 0, 0, 0]), abs=1e-12)
