"""Motors, gears and rotors.

Pages: [Motors, gears and friction](actuation.md), [coupled drives](actuation.md#coupled-drives), [choose a motor and gear](sizing.md).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw


def test_motor_temperature():
    """Does the motor overheat?

    `twistwrench size ROBOT cycle.csv --catalog drives.yaml` has the temperature of the winding over the repeated motion. Here a motor
    holds 1 N m for ever:

    Source: mujoco#2815, sot-torque-control#25, xArm-Python-SDK#106.
    Number: 25 °C + R_th · R i², with a resistance that grows by 0.39 % per kelvin.
    """
    motor = {"torque_constant": "0.2 N m/A", "resistance": "0.5 ohm", "voltage": "48 V", "current_peak": "20 A",
             "speed": "3000 rpm", "rotor": {"inertia": "1 g cm^2"}, "mass": "1 kg",
             "thermal": {"housing_ambient": "4 K/W", "housing_time": "600 s", "maximum": "125 degC"}}  # fmt: skip
    arm = tw.robots.pendulum()
    t = np.linspace(0, 10, 101)
    hold = tw.Motion(t, np.full((101, 1), np.arcsin(1 / 9.81)), robot=arm)
    gear = {"kind": "planetary", "ratio": 1, "efficiency": 1, "no_load_torque": "0 N m"}
    drives = {"motors": {"M": motor}, "gears": {"G": gear}, "actuators": {"hinge": {"motor": "M", "gear": "G"}}}
    s = tw.size_drives(arm, hold, drives, add_masses=False)
    print(f"{s.joints['hinge'].motor.temperature.max():.1f} °C")
    heat = 0.5 * 5.0**2  # W at 20 °C
    rise = 4 * heat * (1 + 0.0039 * 5) / (1 - 4 * heat * 0.0039)
    assert s.joints["hinge"].motor.temperature.max() == approx(25 + rise, rel=2e-3)


def test_power_of_standing():
    """Does a motor need energy while the robot stands still?

    Yes, the heat R i² of its holding current: `robot.motor_loads`.

    Source: dart#560.
    Number: R (τ / (G k_t))² with 9.81 N m, a ratio of 50, 0.1 N m/A and 0.4 ohm.
    """
    drive = {"ratio": "50", "motor": {"torque_constant": "0.1 N m/A", "resistance": "0.4 ohm"}}
    arm = tw.robots.pendulum().with_actuators({"actuators": {"hinge": drive}})
    loads = arm.motor_loads([np.pi / 2], [0], [0])
    print(f"{loads.current[0]:.3f} A, {loads.power[0]:.3f} W")
    assert loads.power[0] == approx(0.4 * (9.81 / (50 * 0.1)) ** 2)
    assert loads.heat[0] == approx(loads.power[0])  # nothing moves, so that all of it is heat


def test_coupled_drives():
    """How do I describe a differential or coupled drive?

    `couplings:` in the actuator file: motors, joints, and the matrix A between them. Rotors then add Aᵀ G²J A to M.

    Source: mujoco#928, pinocchio#440, ros2_control#1837.
    Number: Aᵀ diag(G²J) A by hand, with two rotors of 20 g cm² behind gears of 101.
    """
    motor = {"ratio": 101, "rotor": {"inertia": "20 g cm^2"}, "effort": "28 N m"}
    joints = ["wrist_2_joint", "wrist_3_joint"]
    wrist = {"motors": ["m5", "m6"], "joints": joints, "motor_per_joint": [[1, 1], [1, -1]]}
    bare = tw.robots.ur5()
    ur5 = bare.with_actuators({"couplings": {"wrist": wrist}, "actuators": {"m5": motor, "m6": motor}})
    added = ur5.mass_matrix(np.zeros(6)) - bare.mass_matrix(np.zeros(6))
    print(added[4:, 4:].round(5))
    assert added[4:, 4:] == approx(2 * 101**2 * 20e-7 * np.eye(2), rel=1e-6)


def test_rotors_in_inverse_dynamics():
    """Is the inertia of the rotors part of inverse dynamics?

    Yes, with `robot.with_actuators` (rotors as bodies, with their gyroscopic moments) or `with_armature` (G²J on the diagonal).

    Source: orocos_kdl#155, openrave#600.
    Number: G² J = 101² · 21 kg mm² = 0.2142 kg m².
    """
    arm = tw.robots.pendulum().with_gravity([0, 0, 0])
    geared = arm.with_actuators({"actuators": {"hinge": {"ratio": "101", "rotor": {"inertia": "210 g cm^2"}}}})
    print(arm.inverse_dynamics([0], [0], [1.0]), geared.inverse_dynamics([0], [0], [1.0]))
    assert geared.inverse_dynamics([0], [0], [1.0]) == approx([1 + 101**2 * 21e-6])


def test_plausible_armature():
    """Is an armature of 0.01 plausible for my motor?

    The armature is the inertia of the rotor times the square of the gear ratio. It is on the diagonal of M, and `tw.save` writes it
    into an MJCF file.

    Source: unitree_rl_mjlab#51.
    Number: 40 g cm² · 101² = 0.0408 kg m².
    """
    motor = {"ratio": "101", "reflected_inertia": f"{40e-7 * 101**2:.6f} kg m^2"}
    arm = tw.robots.planar_2r()
    geared = arm.with_actuators({"actuators": {"joint2": motor}})
    tw.save(geared, "arm.xml")
    print(geared.armature, tw.load("arm.xml").armature)
    assert geared.mass_matrix([0, 0]) - arm.mass_matrix([0, 0]) == approx(np.diag([0, 0.040804]))
    assert tw.load("arm.xml").armature == approx([0, 0.040804])


def test_armature_of_each_environment():
    """How do I randomise the armature of each environment?

    Make it a parameter of the kernel, with a row for each environment.

    Source: IsaacLab#1604, track-mjx#166.
    Number: M of the book's arm, [[5, 2], [2, 1]] at 0, with the armature added on its diagonal.
    """
    arm = tw.robots.planar_2r()
    M = arm.kernel("mass_matrix", parameters=("*.armature",))
    armature = np.array([[0.0, 0.0], [0.1, 0.02], [0.3, 0.01]])
    print(M(np.zeros(2), armature)[2])
    assert M(np.zeros(2), armature) == approx(np.array([[5.0, 2.0], [2.0, 1.0]]) + armature[:, :, None] * np.eye(2))
