"""Flexible joints, MR section 8.9.5: two bodies and a spring, checked by oscillations that have closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.testing import State, assert_close, laws, random_state

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

J, G, K = 1e-4, 50.0, 800.0


def elastic(robot, **more):
    entry = {"ratio": G, "stiffness": f"{K} N m/rad", "rotor": {"inertia": f"{J} kg m^2", "extra": True}, **more}
    return robot.with_actuators({"actuators": dict.fromkeys(robot.joint_names, entry)})


def test_two_inertias_and_a_spring_swing_at_their_frequency():
    """A pendulum without gravity: ω² = k (1/I + 1/(G² J)), the eigenvalue of M⁻¹ ∂²P/∂q²."""
    robot = elastic(tw.robots.pendulum().with_gravity((0, 0, 0)))
    I = tw.robots.pendulum().mass_matrix([0.0])[0, 0]
    M = robot.mass_matrix(robot.neutral)
    stiffness = np.array([robot.holding_torques(e) for e in np.eye(2)])
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(M, stiffness)).real)
    assert squares == pytest.approx([0.0, K * (1 / I + 1 / (G**2 * J))], rel=1e-12, abs=1e-8)


def test_names_limits_and_coordinates():
    arm = tw.robots.ur5()
    robot = arm.with_actuators(
        {"actuators": {"elbow_joint": {"ratio": 101, "stiffness": "10 kN m/rad", "rotor": {"inertia": "100 g cm^2"}}}}
    )
    assert (robot.nq, robot.joint_names[-1]) == (7, "elbow_joint.motor")
    assert list(robot.actuators) == ["elbow_joint.motor"]
    assert robot.limits.effort.tolist() == [150, 150, np.inf, 28, 28, 28, 150]  # the motor's torque is what is limited
    assert robot.limits.upper[-1] == np.inf
    assert robot.limits.velocity.tolist() == [
        *arm.limits.velocity,
        arm.limits.velocity[2],
    ]  # both sides keep that of the joint


def test_equations_of_motion_follow_from_the_energies():
    """h holds the springs: M ddq + c + g + ∂P_spring/∂q, and the energy balance closes."""
    robot = elastic(tw.robots.planar_3r())
    rng = np.random.default_rng(4)
    for _ in range(5):
        q, dq, ddq = random_state(robot, rng)
        tau = robot.inverse_dynamics(q, dq, ddq)
        springs = robot.holding_torques(q) - robot.gravity_forces(q)
        assert_close(springs[:3], K * (q[:3] - q[3:]), 1e-11, "spring torques at the joints")
        assert_close(springs[3:], -springs[:3], 1e-11, "and at the motors")
        rest = robot.mass_matrix(q) @ ddq + robot.coriolis_forces(q, dq) + robot.gravity_forces(q)
        assert_close(tau, rest + springs, 1e-11, "τ = M q̈ + c + g + springs")
        assert laws.power_gap(robot, State(q, dq, ddq)) < laws.DIFFERENCES
        assert_close(robot.forward_dynamics(q, dq, tau), ddq, 1e-9, "FD∘ID")


def test_motor_and_joint_part_only_by_the_spring():
    """A stiff spring is not a spring: with motor and joint moving together, the sum of both equations is the rigid robot's."""
    arm = tw.robots.planar_2r()
    rotor = {"inertia": f"{J} kg m^2", "extra": True}
    rigid = arm.with_actuators({"actuators": {joint: {"ratio": G, "rotor": rotor} for joint in arm.joint_names}})
    q, dq, ddq = (np.array(x) for x in ([0.3, -0.5], [1.0, 2.0], [-1.0, 0.5]))
    both = elastic(arm).inverse_dynamics(np.tile(q, 2), np.tile(dq, 2), np.tile(ddq, 2))
    assert_close(both[:2] + both[2:], rigid.inverse_dynamics(q, dq, ddq), 1e-12, "rigid limit")


FRICTION = {"viscous": "3 N m s/rad", "coulomb": "2 N m"}


def test_motor_and_gear_friction_acts_on_the_motor_whether_the_gear_is_elastic_or_rigid():
    """At 1 rad/s both cost 5 N m as seen at the joint, 5/50 at the rotor, and the spring carries none of it."""
    arm = tw.robots.planar_2r()
    rotor = {"inertia": f"{J} kg m^2", "extra": True}
    entry = {"ratio": G, "rotor": rotor, "friction": FRICTION}
    rigid = arm.with_actuators({"actuators": dict.fromkeys(arm.joint_names, entry)})
    flexible = elastic(arm, friction=FRICTION)
    q, dq, ddq = (np.array(x) for x in ([0.3, -0.5], [1.0, -1.0], [-1.0, 0.5]))
    for robot, at in ((rigid, (q, dq, ddq)), (flexible, (np.tile(q, 2), np.tile(dq, 2), np.tile(ddq, 2)))):
        with_it, without = (robot.motor_loads(*at, friction=counted).torque for counted in (True, False))
        assert_close(with_it - without, np.array([5.0, -5.0]) / G, 1e-12, "what friction costs the motors")
    assert flexible.friction_forces([1, -1, 1, -1]).tolist() == [0, 0, 5, -5]
    both, at = flexible, (np.tile(q, 2), np.tile(dq, 2), np.tile(ddq, 2))
    tau = both.inverse_dynamics(*at, friction=True)
    assert_close(tau[:2] + tau[2:], rigid.inverse_dynamics(q, dq, ddq, friction=True), 1e-12, "rigid limit")


def test_what_gears_and_rotors_carry_adds_up_where_a_spring_pulls():
    robot = elastic(tw.robots.planar_2r())
    state = np.random.default_rng(3).normal(size=(3, robot.nv))
    carried, rotor = robot.drive_torques(*state)
    assert_close(carried + rotor, robot.inverse_dynamics(*state), 1e-12, "gear + rotor")


def test_friction_behind_the_spring_is_an_entry_of_its_own():
    arm = tw.robots.planar_2r()
    robot = elastic(arm, friction=FRICTION, link_friction={"viscous": "0.5 N m s/rad", "coulomb": "0.25 N m"})
    assert robot.friction_forces([1, -1, 2, -2]).tolist() == [0.75, -0.75, 8, -8]
    only = elastic(arm, link_friction={"coulomb": "0.25 N m"})
    assert only.friction_forces([1, -1, 2, -2]).tolist() == [0.25, -0.25, 0, 0]


def test_a_gear_taken_to_be_stiff_has_the_friction_of_both_sides():
    arm = tw.robots.planar_2r()
    entry = {
        "ratio": G, "stiffness": f"{K} N m/rad", "rotor": {"inertia": f"{J} kg m^2", "extra": True},
        "friction": {**FRICTION, "static": "4 N m", "stribeck": "0.1 rad/s", "load": "0.1"},
        "link_friction": {"viscous": "0.5 N m s/rad", "coulomb": "0.25 N m"},
    }  # fmt: skip
    with pytest.warns(tw.ModelWarning, match="taken to be stiff"):
        robot = arm.with_actuators({"actuators": dict.fromkeys(arm.joint_names, entry)}, stiff=True)
    assert robot.nv == 2
    law = 3.5 + 2.25 + 2 * np.exp(-100.0) + 0.1 * 7
    assert_close(robot.friction_forces([1.0, -1.0], load=[7.0, 7.0]), np.array([law, -law]), 1e-12)
    entry["link_friction"] = {"load": "0.9"}
    with pytest.warns(tw.ModelWarning), pytest.raises(tw.ValueRangeError, match="adds up to 1; it must be below 1"):
        arm.with_actuators({"actuators": dict.fromkeys(arm.joint_names, entry)}, stiff=True)
    entry["link_friction"] = {"coulomb": "1 N m", "static": "2 N m", "stribeck": "0.3 rad/s"}
    with pytest.warns(tw.ModelWarning), pytest.raises(tw.ModelError, match="two Stribeck speeds"):
        arm.with_actuators({"actuators": dict.fromkeys(arm.joint_names, entry)}, stiff=True)


def test_the_friction_of_the_robot_file_goes_to_the_motor_of_an_elastic_joint():
    """A file's friction is the drive's: measured at the motor. An entry replaces it on both sides."""
    text = """<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="j" type="continuous"><parent link="a"/><child link="b"/><dynamics damping="3" friction="2"/></joint></robot>"""
    assert elastic(tw.load(text)).friction_forces([1, 1]).tolist() == [0, 5]
    assert elastic(tw.load(text), friction={"coulomb": "1 N m"}).friction_forces([1, 1]).tolist() == [0, 1]
    assert elastic(tw.load(text), link_friction={"coulomb": "1 N m"}).friction_forces([1, 1]).tolist() == [1, 0]


def test_locking_an_end_holds_the_other_against_it():
    robot = elastic(tw.robots.pendulum().with_gravity((0, 0, 0)))
    held = robot.lock({f"{robot.joint_names[0]}.motor": 0.2})
    assert held.nv == 1
    assert held.holding_torques([0.5]) == pytest.approx(K * 0.3)
    assert held.potential_energy([0.5]) == pytest.approx(0.5 * K * 0.3**2)


def test_an_elastic_gear_without_a_rotor_is_an_error():
    with pytest.raises(tw.ModelError, match="needs an inertia"):
        tw.robots.planar_2r().with_actuators({"actuators": {"joint1": {"stiffness": "10 N m/rad"}}})
