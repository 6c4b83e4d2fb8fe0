"""Motions that look fine and are not: each was OK once, and what differs from it in the one thing that matters still is."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest_plugins = ("torque_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

LINK = """<link name="l{0}"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.05"/></inertial></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="l{1}"/><child link="l{2}"/><axis xyz="0 1 0"/>
<limit lower="{3}" upper="{4}" velocity="{5}" effort="900"/>{6}</joint>"""


def arm(*joints: str) -> str:
    links = "".join(LINK.format(k) for k in range(1, len(joints) + 1))
    return f'<robot name="arm"><link name="l0"/>{links}{"".join(joints)}</robot>'


def leader(*, lower=-2.0, upper=2.0, velocity=10.0) -> str:
    return JOINT.format("a", 0, 1, lower, upper, velocity, "")


def follower(*, lower=-4.0, upper=4.0, velocity=20.0) -> str:
    return JOINT.format("b", 1, 2, lower, upper, velocity, '<mimic joint="a" multiplier="-2" offset="0.1"/>')


@pytest.fixture
def said(run, tmp_path):
    """The first line of the command ``torques`` for a robot and the columns of a motion."""

    def said(robot, t, **columns):
        (tmp_path / "arm.urdf").write_text(robot)
        table = np.column_stack([t, *columns.values()])
        header = ",".join(["time", *columns])
        np.savetxt(tmp_path / "m.csv", table, "%.17g", ",", header=header, comments="")
        code, text = run("torques", tmp_path / "arm.urdf", "--trajectory", tmp_path / "m.csv")
        verdict = " ".join(text.split("\n\n")[0].split())
        assert (code == 0) == verdict.startswith("OK")
        return verdict

    return said


T = np.linspace(0.0, 4.0, 401)


def test_a_follower_beyond_its_own_limits(said):
    """b = -2 sin t + 0.1, from -1.9 to 1.62, at up to 2 rad/s."""
    assert said(arm(leader(), follower()), T, a=np.sin(T)).startswith("OK")
    for limits in ({"lower": -1.8}, {"upper": 1.6}, {"velocity": 1.9}):
        kind = "velocity" if "velocity" in limits else "position"
        assert f"exceeds its {kind} limit" in said(arm(leader(), follower(**limits)), T, a=np.sin(T))


def test_a_follower_that_the_log_has_elsewhere(said):
    """b = -2 a + 0.1 by the robot's file; its play, and its unit, are not a contradiction."""
    robot, a = arm(leader(), follower()), np.sin(T)
    for fine in ({"b": 0.1 - 2 * a}, {"b": 0.11 - 1.97 * a}, {"b [deg]": np.degrees(0.1 - 2 * a)}):
        assert said(robot, T, a=a, **fine).startswith("OK")
    for elsewhere in ({"b": 0.1 + 2 * a}, {"b": 0.0 * a}, {"b": 0.9 - 2 * a}):
        verdict = said(robot, T, a=a, **elsewhere)
        assert verdict.startswith("LOOK AGAIN: b is") and "from the position given by its leader" in verdict


def test_a_follower_is_where_its_offset_puts_it(said):
    """b = -2 a + 1: a column without the offset is a radian away, and not within its play."""
    robot, a = arm(leader(), follower()).replace('offset="0.1"', 'offset="1"'), np.sin(T)
    assert said(robot, T, a=a, b=1.0 - 2 * a).startswith("OK")
    assert said(robot, T, a=a, b=-2 * a).startswith("LOOK AGAIN: b is")


def test_turns_that_the_log_leaves_out_lead_beyond_the_limits(said):
    """From 0 on by 2 rad/s, which is 4 rad after two seconds; the log keeps within half a turn."""
    robot = arm(leader(lower=-4.0, upper=4.0))
    for end, fine in ((1.9, True), (2.1, False)):
        t = T[end >= T]
        verdict = said(robot, t, a=np.remainder(2 * t + math.pi, math.tau) - math.pi)
        assert verdict.startswith("OK" if fine else "LOOK AGAIN: a steps by about a full turn")


def test_a_motion_that_is_not_in_the_log(said):
    t = np.concatenate([T[:100], T[300:]])
    swings = np.sin(3 * T)
    rests = np.where(T < 1.0, np.sin(math.pi * T) ** 4, np.where(T < 3.0, 0.0, np.sin(math.pi * (T - 3.0)) ** 4))
    assert said(arm(leader()), t, a=rests[np.isin(T, t)]).startswith("OK")
    assert said(arm(leader()), t, a=swings[np.isin(T, t)]).startswith("UNSURE: the robot moves while nothing is logged")
