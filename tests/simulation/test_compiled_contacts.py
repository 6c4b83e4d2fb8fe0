"""Contacts in compiled steps: the laws of an impact, and the same run by Python's steps on NumPy, where nothing compiles."""

import numpy as np
import pytest
from quick import mostly_slow
from scipy.optimize import brentq

import twistwrench as tw
from twistwrench.simulation import Event, JointStops, Plane

CORNERS = [[x, y, z] for x in (-0.15, 0.15) for y in (-0.1, 0.1) for z in (-0.05, 0.05)]
FIXED = ["rk4", "semi_implicit", "euler"]


def box(gravity=(0, 0, -9.81)):
    return tw.robots.floating_box().with_gravity(gravity)


def lifted(robot, height):
    return robot.coordinates(root_joint=[1, 0, 0, 0, 0, 0, height])


def returned(c, v):
    """e of c v - ln(1 + c v) = -c e v - ln(1 - c e v): the energy integral of the law, written down once more."""
    return brentq(
        lambda e: c * v - np.log1p(c * v) + c * e * v + np.log1p(-c * e * v), 0.0, min(1.0, 0.999999 / (c * v))
    )


@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.5, 2.0])
def test_of_the_speed_of_an_impact_comes_back_what_the_law_says(exponent):
    """Some hundred steps of rk4 in the contact, the first and the last with a corner of the force in them: 1e-4."""
    robot, c, v = box((0, 0, 0)), 0.4, 1.5
    plane = Plane("box", stiffness=2e4, exponent=exponent, dissipation=c)
    found = robot.simulate(lifted(robot, 0.1), [0, 0, 0, 0.2, 0, -v], 0.4, 1e-4, contacts=plane, method="rk4")
    e = returned(c, v)
    assert found.dq[-1, 5] == pytest.approx(e * v, rel=1e-4)
    assert found.dq[-1, 3] == pytest.approx(0.2, abs=1e-12)
    assert found.work["contacts"][-1] == pytest.approx(-3.0 * v**2 * (1.0 - e**2), rel=1e-4)
    assert found.relative_drift < 1e-4
    (touch,) = found.events
    assert touch.name == "box touches the plane"
    assert touch.time == pytest.approx(0.1 / v, abs=1e-12)
    assert touch.q[6] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("method", FIXED)
def test_what_lies_still_is_carried_by_its_weight(method):
    """k dⁿ of four corners is m g where it rests, and the contacts take all energy that the fall had."""
    robot, k, n = box(), 2e4, 1.5
    plane = Plane("box", CORNERS, stiffness=k, exponent=n, dissipation=2.0, friction=0.5)
    found = robot.simulate(lifted(robot, 0.06), None, 2.0, 1e-4, contacts=plane, method=method)
    depth = 0.05 - found.q[-1, 6]
    assert 4.0 * k * depth**n == pytest.approx(6.0 * 9.81, rel=1e-3)
    assert np.abs(found.dq[-1]).max() < 1e-3
    lost = found.work["contacts"][-1] + found.potential_energy[0] - found.potential_energy[-1]
    assert lost == pytest.approx(0.0, abs=2e-2 * abs(found.work["contacts"][-1]))


PANDA = tw.robots.panda()


def runs():
    robot = box()
    floor = Plane("box", CORNERS, stiffness=1e4, exponent=1.5, dissipation=0.3, friction=0.5)
    tilted = Plane("box", CORNERS[:3], normal=[0.2, 0.1, 1.0], height=-0.02, stiffness=3e3, exponent=1.3)
    fall = {"q0": lifted(robot, 0.2), "dq0": [1, 2, 0.5, 0, 0, 0], "duration": 0.22, "dt": 2e-3}
    yield "a box on one plane", robot, {**fall, "contacts": floor}
    yield (
        "a box on two planes, pushed",
        robot,
        {**fall, "contacts": [floor, tilted], "wrench_on_robot": {"box": [0, 0, 0.1, 1, 0, 0]}},
    )
    near = PANDA.limits.upper - 0.05
    stops = JointStops(stiffness=1e4, dissipation=0.2)
    swing = {"q0": near, "dq0": [2, -2, 1, 1.5, -1, 1, 2.0], "duration": 0.06, "dt": 2e-3}
    wall = Plane(
        PANDA.frame_names[-1], [[0, 0, 0], [0, 0.05, 0]], height=0.57, stiffness=1e4, dissipation=0.1, friction=0.3
    )
    yield (
        "an arm with friction between its stops and a wall",
        PANDA,
        {**swing, "contacts": [stops, wall], "friction": True},
    )


RUNS = {name: (robot, given) for name, robot, given in runs()}


@pytest.mark.parametrize(
    ("name", "method"),
    mostly_slow(
        [
            pytest.param(name, method, marks=pytest.mark.slow if i and method != "rk4" else ())
            for i, name in enumerate(RUNS)
            for method in FIXED
        ],
        2,
    ),
)
def test_python_s_steps_are_the_same(name, method, monkeypatch):
    """Both round in orders of their own, and contacts double differences some times."""
    robot, given = RUNS[name]
    one = robot.simulate(**given, method=method)
    assert one.work["contacts"][-1] != 0.0 and one.events
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    other = tw.Robot(robot.model).simulate(**given, method=method)
    for what in ("q", "dq", "kinetic_energy", "drift"):
        mine, theirs = getattr(one, what), getattr(other, what)
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-8 * (1.0 + np.abs(theirs).max()), err_msg=what)
    assert [e.name for e in one.events] == [e.name for e in other.events]
    np.testing.assert_allclose([e.time for e in one.events], [e.time for e in other.events], rtol=0.0, atol=1e-10)
    assert one.remarks == other.remarks
    assert one.steps == other.steps


@pytest.mark.parametrize("method", FIXED[:2])
def test_a_controller_and_an_event_change_nothing_of_contacts(method):
    """Steps are then taken between calls of Python, of the same machine code."""
    robot, given = RUNS["a box on two planes, pushed"]
    one = robot.simulate(**given, method=method)
    calm = np.zeros(robot.nv)
    for more in (
        {"controller": lambda t, q, dq: calm},
        {"events": Event(lambda t, q, dq: 1.0)},
        {"tau": lambda t, q, dq: calm},
    ):
        other = robot.simulate(**given, **more, method=method)
        np.testing.assert_allclose(other.q, one.q, rtol=0.0, atol=1e-12)
        assert [(e.name, e.time) for e in one.events] == [(e.name, e.time) for e in other.events]
        assert one.remarks == other.remarks


def test_a_batch_bounces_as_each_of_it_alone():
    """To the bit, events and remarks included, although each touches the ground at a time of its own."""
    robot = box()
    floor = Plane("box", CORNERS, stiffness=1e4, dissipation=0.3, friction=0.5)
    q0 = np.array([lifted(robot, h) for h in (0.1, 0.2, 0.5, 0.03)])
    rates = np.array([0.5, -0.4, 0.3, 0.1, 0.0, -0.2])
    batch = robot.simulate_batch(q0, rates, 0.3, 1e-3, method="rk4", contacts=floor)
    times = []
    for one, start in zip(batch, q0, strict=True):
        alone = robot.simulate(start, rates, 0.3, 1e-3, method="rk4", contacts=floor)
        np.testing.assert_array_equal(one.q, alone.q)
        assert [(e.name, e.time) for e in one.events] == [(e.name, e.time) for e in alone.events]
        assert one.remarks == alone.remarks
        times += [e.time for e in one.events[:1]]
    assert len(set(times)) == 3  # the third does not come down, the last begins inside


@pytest.mark.parametrize("limits", [None, "stop"])
def test_steps_of_any_length_end_at_a_limit_as_steps_of_one_length_do(limits):
    """dopri5 looks at many of its steps at once: what came after the limit is forgotten, a touch before it is told."""
    near = PANDA.limits.upper - 0.3
    z = float(PANDA.forward_kinematics(near, PANDA.frame_names[-1])[2, 3])
    wall = Plane(PANDA.frame_names[-1], height=z - 0.01, stiffness=2e3, dissipation=0.2)
    given = {
        "q0": near,
        "dq0": [1.0, -1, 0.5, 0.5, -1, 1, 0.3],
        "duration": 0.6,
        "dt": 2e-3,
        "contacts": wall,
        "limits": limits,
    }
    one, other = PANDA.simulate(**given), PANDA.simulate(**given, method="rk4")
    asked = PANDA.simulate(**given, events=lambda t, q, dq: 1.0)
    assert [e.name for e in one.events] == [e.name for e in other.events]
    np.testing.assert_allclose([e.time for e in one.events], [e.time for e in other.events], rtol=0.0, atol=1e-6)
    assert one.completed == other.completed == (limits is None)
    assert (one.steps, one.rejected, one.stopped) == (asked.steps, asked.rejected, asked.stopped)
    np.testing.assert_allclose(one.times, asked.times, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(one.q, asked.q, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(one.error_estimate, asked.error_estimate, rtol=1e-3)


def test_a_contact_shorter_than_three_steps_is_told_of():
    robot = box()
    found = robot.simulate(
        lifted(robot, 0.05), None, 0.5, 2e-2, contacts=Plane("box", stiffness=1e6), method="semi_implicit"
    )
    assert any("was over within three steps" in remark for remark in found.remarks)


def test_limits_that_stop_and_a_plane_go_together():
    """The arm touches first and is stopped later; the run ends in the limit."""
    middle = 0.5 * (PANDA.limits.lower + PANDA.limits.upper)
    wall = Plane(PANDA.frame_names[-1], height=0.6, stiffness=10.0)
    found = PANDA.simulate(middle, np.full(PANDA.nv, 0.5), 3.0, 1e-3, method="rk4", contacts=wall, limits="stop")
    assert not found.completed
    assert "limit" in found.stopped
    alone = PANDA.simulate(
        middle,
        np.full(PANDA.nv, 0.5),
        3.0,
        1e-3,
        method="rk4",
        contacts=wall,
        limits="stop",
        events=lambda t, q, dq: 1.0,
    )
    assert found.stopped == alone.stopped
    np.testing.assert_allclose(found.q, alone.q, rtol=0.0, atol=1e-9)
    assert [e.name for e in found.events] == [e.name for e in alone.events]
