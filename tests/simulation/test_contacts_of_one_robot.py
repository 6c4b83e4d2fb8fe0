"""Several contacts of one robot: each has its own law, points and joints, whichever was asked first."""

from __future__ import annotations

import re

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.simulation import JointStops, Plane
from twistwrench.simulation.contact import PlaneContact, StopContact


def test_planes_of_two_exponents_push_by_their_own():
    box, depth = tw.robots.floating_box().with_gravity([0, 0, 0]), 0.01
    for exponent in (1.0, 1.3, 2.0):
        plane = Plane(box.tip, height=depth, stiffness=1e4, exponent=exponent)
        tau = PlaneContact(box, plane).torques(box.neutral, np.zeros(6))
        assert np.abs(tau).max() == pytest.approx(1e4 * depth**exponent, rel=1e-12)


def test_stops_of_one_joint_after_those_of_another():
    arm = tw.robots.ur5()
    beyond = arm.limits.upper + 0.1
    for k, name in enumerate(arm.joint_names[:3]):
        tau = StopContact(arm, JointStops(1e3, 1.0, joints=(name,))).torques(beyond, np.zeros(6))
        np.testing.assert_allclose(tau, -100.0 * (np.arange(6) == k), rtol=1e-9)


@pytest.mark.parametrize("side", [-1, 1])
def test_stops_of_a_robot_with_a_floating_base_are_at_its_joints(side):
    """Its quaternion has one entry more than its angular velocity."""
    dog = tw.robots.quadruped()
    k = int(np.flatnonzero(np.isfinite(dog.limits.upper) & np.isfinite(dog.limits.lower))[0])
    stops = StopContact(dog, JointStops(1e3, 1.0))
    q = dog.neutral.copy()
    inside = np.clip(q[7:], dog.limits.lower[6:] + 0.05, dog.limits.upper[6:] - 0.05)
    q[7:] = inside
    assert stops.torques(q, np.zeros(dog.nv)) is None
    assert stops.gap(q) > 0.0
    q[k + 1] = (dog.limits.upper if side > 0 else dog.limits.lower)[k] + 0.02 * side
    assert stops.gap(q) == pytest.approx(-0.02, rel=1e-9)
    np.testing.assert_allclose(stops.torques(q, np.zeros(dog.nv)), -20.0 * side * (np.arange(dog.nv) == k), rtol=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_what_a_buried_point_stores_is_the_work_of_its_force(exponent):
    box, depth = tw.robots.floating_box(), 0.2
    plane = Plane(box.tip, height=depth, stiffness=1e5, exponent=exponent)
    middles = depth * (np.arange(20000) + 0.5) / 20000
    work = depth * float(np.mean(1e5 * middles**exponent))
    said = re.search(r"(\S+) J are in that contact", PlaneContact(box, plane).remark_at_start(box.neutral))
    assert said and float(said[1]) == pytest.approx(work, rel=5e-3)  # three digits
