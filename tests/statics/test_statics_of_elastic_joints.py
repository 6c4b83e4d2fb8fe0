"""An elastic gear changes nothing about what a robot can hold at rest: the motor's limit is the joint's."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench import statics

Q = np.array([0.0, -0.6, 0.9, 0.1, 0.2, 0.0])


def elastic(count):
    robot = tw.robots.ur5()
    entry = {"ratio": 100, "stiffness": "20 kN m/rad", "rotor": {"inertia": "200 g cm^2", "extra": True}}
    made = robot.with_actuators({"actuators": dict.fromkeys(robot.joint_names[:count], entry)})
    return robot, made, np.concatenate([Q, Q[:count]])


@pytest.mark.parametrize("count", [2, 6])
def test_payloads_forces_and_polytopes_are_the_rigid_robots(count):
    rigid, robot, q = elastic(count)
    loads = [statics.largest_payload(r, x) for r, x in ((rigid, Q), (robot, q))]
    assert loads[1].mass == pytest.approx(loads[0].mass, rel=1e-9)
    assert loads[1].joint == loads[0].joint
    forces = [statics.largest_wrench(r, x, (0, 0, 0, 0, 0, 1)) for r, x in ((rigid, Q), (robot, q))]
    assert float(forces[1].magnitude) == pytest.approx(float(forces[0].magnitude), rel=1e-9)
    reach = [statics.wrench_polytope(r, x).support((1, 0, 0)) for r, x in ((rigid, Q), (robot, q))]
    assert reach[1] == pytest.approx(reach[0], rel=1e-6)


@pytest.mark.parametrize("count", [2, 6])
def test_equilibrium_is_the_rigid_robots(count):
    rigid, robot, q = elastic(count)
    for force in (-50.0, -500.0):
        push = {"tool0": np.array([0, 0, 0, 0, 0, force])}
        found = [statics.robot_equilibrium(r, x, [], wrench_on_robot=push).holds for r, x in ((rigid, Q), (robot, q))]
        assert found[0] == found[1]


def test_the_torques_that_hold_it_push_on_nothing():
    _, robot, q = elastic(6)
    q[6:] += 1e-3
    found = statics.wrench_from_torques(robot, q, robot.holding_torques(q))
    assert np.abs(found.wrench).max() < 1e-8


def test_the_lower_limit_of_a_joint_and_its_motor_holds():
    _, robot, q = elastic(2)
    limits = np.array([100.0, 30.0, 100, 100, 100, 100, 20.0, 90.0])
    assert statics.largest_payload(robot, q, limits=limits).limits[:2].tolist() == [20.0, 30.0]
