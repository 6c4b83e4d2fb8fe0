"""Contacts with normals of their own: hands on a wall, magnets at a ceiling, suction cups on a pane."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

import twistwrench as tw
from twistwrench import statics

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

_LEANER = """<mujoco model="leaner"><compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 0.9"><freejoint name="root"/>
<geom type="box" size="0.1 0.15 0.25" mass="30" pos="0 0 0.25"/>
<body name="leg"><joint name="hip" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.85" size="0.05" mass="8"/>
<body name="foot" pos="0 0 -0.85"><joint name="ankle" axis="0 1 0"/><geom type="box" size="0.12 0.05 0.02" mass="1"/></body></body>
<body name="arm" pos="0 0 0.45"><joint name="shoulder" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.6 0 0" size="0.04" mass="4"/>
<body name="hand" pos="0.6 0 0"><joint name="wrist" axis="0 1 0"/><geom type="sphere" size="0.05" mass="0.5"/></body></body>
</body></worldbody></mujoco>"""
_CRAWLER = """<mujoco model="crawler"><compiler angle="radian"/><worldbody><body name="base" pos="0 0 2"><freejoint name="root"/>
<geom type="box" size="0.2 0.15 0.05" mass="8"/><body name="arm" pos="0 0 -0.05"><joint name="j" axis="1 0 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.02" mass="3"/></body></body></worldbody></mujoco>"""
FOOT = [(x, y, -0.05) for x in (-0.09, 0.15) for y in (-0.05, 0.05)]


def still(robot, q):
    z = np.zeros((5, robot.nv))
    return tw.Motion(np.linspace(0, 1, 5), np.tile(q, (5, 1)), z, z, robot=robot)


def limits(robot):
    return {name: 800.0 for name in robot.model.velocity_names if not name.startswith("root")}


def leaning(angle):
    """Robot whose straight body leans forward by an angle, with a flat foot and the arm level."""
    robot = tw.load(_LEANER)
    q = robot.neutral.copy()
    q[:4] = np.cos(angle / 2), 0, np.sin(angle / 2), 0
    q[[robot.coordinate_names.index(name) for name in ("ankle", "shoulder")]] = -angle
    return robot, still(robot, q)


def holds(robot, motion, contacts, edges=64):
    """True if forces in pyramids inside the cones balance the robot at rest: a linear programme."""
    q, columns = motion.q[0], []
    turn = 2 * np.pi * np.arange(edges) / edges
    load = robot.gravity_forces(q)[:6]
    for c in contacts:
        T = robot.forward_kinematics(q, c.frame)
        J = robot.jacobian(q, c.frame, "world_aligned")[:, :6]
        arm = T[:3, :3] @ c.point
        J = J[3:] - np.cross(np.eye(3), arm) @ J[:3]
        u = np.cross(c.normal, [0.0, 1, 0])
        v = np.cross(c.normal, u)
        E = c.normal[:, None] + c.friction * np.cos(np.pi / edges) * (
            np.outer(u, np.cos(turn)) + np.outer(v, np.sin(turn))
        )
        columns.append(J.T @ E)
        load = load + J.T @ (c.pull * c.normal)
    G = np.concatenate(columns, axis=1)
    return linprog(np.zeros(G.shape[1]), A_eq=G, b_eq=load).status == 0


@pytest.mark.parametrize(
    ("angle", "floor", "wall"), [(0.35, 0.7, 0.5), (0.35, 0.1, 0.0), (0.8, 0.9, 0.4), (-0.26, 0.7, 0.5)]
)
def test_a_hand_on_a_wall_carries_beside_the_foot(angle, floor, wall):
    """The hand is high above the foot: it carries at every instant, and is no reason to take the floor for a slope."""
    robot, motion = leaning(angle)
    foot = [statics.Contact(point, friction=floor, frame="foot") for point in FOOT]
    hand = statics.Contact((0.05, 0, 0), (-1, 0, 0), friction=wall, frame="hand")
    answer = tw.check(robot, motion, feet=[*foot, hand], limits=limits(robot))
    assert answer.support.in_contact.all()
    assert answer.verdict.word == ("OK" if holds(robot, motion, [*foot, hand]) else "OVER LIMIT")
    alone = tw.check(robot, motion, feet=foot, limits=limits(robot))
    assert alone.headline.startswith("OVER LIMIT: tips over foot")


def test_a_schedule_may_name_the_hand_too():
    robot, motion = leaning(0.35)
    foot = [statics.Contact(point, friction=0.7, frame="foot") for point in FOOT]
    hand = statics.Contact((0.05, 0, 0), (-1, 0, 0), friction=0.5, frame="hand")
    asked = {"feet": [*foot, hand], "limits": limits(robot)}
    without = tw.check(robot, motion, **asked, in_contact={"foot": True, "hand": [1.0, 1, 0, 0, 1]})
    assert (without.support.in_contact[:, -1] == [True, True, False, False, True]).all()
    assert without.headline.startswith("OVER LIMIT: tips over foot at t = 0.5")
    assert tw.check(robot, motion, **asked, in_contact={"foot": True}).verdict.ok


@pytest.mark.parametrize(
    ("normal", "points"),
    [
        ((0, 0, -1), [(x, y, 0.05) for x in (-0.2, 0.2) for y in (-0.15, 0.15)]),
        ((-1, 0, 0), [(0.2, y, z) for y in (-0.15, 0.15) for z in (-0.05, 0.05)]),
    ],
)  # fmt: skip
def test_magnets_and_cups_hold_up_to_their_force(normal, points):
    """First word at 0.99 and 1.01 times the least force, found by a linear programme."""
    robot = tw.load(_CRAWLER)
    motion = still(robot, robot.neutral)

    def contacts(pull):
        return [statics.Contact(p, normal, friction=0.5, pull=pull, frame="base") for p in points]

    low, high = 1.0, 500.0
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(robot, motion, contacts(middle)) else (middle, high)
    ok, over = (tw.check(robot, motion, feet=contacts(f * high), limits=limits(robot)) for f in (1.01, 0.99))
    assert ok.verdict.word == "OK" and ok.support.in_contact.all()
    assert over.headline.startswith(("OVER LIMIT: pulls off at base", "OVER LIMIT: slips at base"))


def test_a_log_of_the_joints_alone_leaves_a_robot_on_magnets_where_it_is(tmp_path):
    """Nothing stands on a foot, and there are no wheels: the note says what is taken."""
    robot = tw.load(_CRAWLER)
    time = np.linspace(0, 1, 21)
    angle = 0.1 * np.sin(np.pi * time) ** 2
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([time, angle]), "%.9f", ",", header="time [s],j", comments="")
    magnets = [
        statics.Contact((x, y, 0.05), (0, 0, -1), friction=0.5, pull=200.0, frame="base")
        for x in (-0.2, 0.2)
        for y in (-0.15, 0.15)
    ]
    answer = tw.check(robot, log, feet=magnets, limits=limits(robot))
    assert "The pose of the base is constant, as no foot shows how it moves." in answer.to_dict()["notes"]
    assert np.ptp(answer.motion.q[:, :7], axis=0).max() == 0.0
