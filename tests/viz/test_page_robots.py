"""Robots as they are: a menu of tips, poses at work, lists of many joints, and what is let go comes to rest."""

from __future__ import annotations

import numpy as np
import pytest
from page_files import read_page
from page_under_node import under_node

import twistwrench as tw
from twistwrench.viz import write_page
from twistwrench.viz.starting_pose import STOP_CLEARANCE, clear_of_stops, starting_pose

pytest_plugins = ("page_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")
BUNDLED = ("ur5", "panda", "planar_2r", "planar_3r", "pendulum", "cart_pole", "floating_box", "quadruped")
MASS, PUSH = 1.5, np.array([7.0, -8.0, 9.0])


@pytest.mark.parametrize("name", BUNDLED)
def test_a_page_opens_clear_of_stops(name):
    robot = getattr(tw.robots, name)()
    q = starting_pose(robot)
    joints = [b for b in robot.model.leaders if b.joint.nv == 1]
    for body, low, high in zip(joints, *clear_of_stops(robot), strict=True):
        lower, upper = robot.limits.lower[body.v_index], robot.limits.upper[body.v_index]
        room = STOP_CLEARANCE * (upper - lower) if np.isfinite(upper - lower) else 0.0
        assert lower + room <= low <= q[body.q_index] <= high <= upper - room


@pytest.mark.parametrize("name", ["ur5", "panda", "planar_2r", "planar_3r", "cart_pole"])
def test_an_arm_opens_at_work(name):
    """Tip in the upper half of its reach, and half as far from singular as the best of 500 random poses."""
    robot = getattr(tw.robots, name)()
    q, Q = starting_pose(robot), robot.random_configuration(1, 500)
    heights = robot.forward_kinematics(Q)[:, 2, 3]
    assert robot.forward_kinematics(q)[2, 3] > 0.5 * (heights.min() + heights.max())

    def sigma(q):
        found = np.linalg.svd(robot.jacobian(q, kind="world_aligned"), compute_uv=False)
        return found[..., min(robot.nv, {"planar_2r": 2, "planar_3r": 3, "cart_pole": 2}.get(name, 6)) - 1]

    assert sigma(q) > 0.5 * sigma(Q).max()


def test_everything_of_the_tip_follows_the_menu(tmp_path):
    """Torques under payload and push at each foot of a quadruped, and the Jacobian of each."""
    robot = tw.robots.quadruped()
    page = write_page(robot, tmp_path / "page.html")
    header = read_page(page)[0]
    names = [header["frames"][entry["tip"]]["name"] for entry in header["tips"]]
    assert names == ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
    q = robot.random_configuration(2)
    work = """(m, given) => { m.mass = given.mass; m.push = given.push;
        return m.robot.tips.map((_, k) => { m.choose(k); return [m.holding(given.q), m.tipColumns(given.q).flat(), m.tipPose(given.q)]; }); }"""
    given = {"q": q.tolist(), "mass": MASS, "push": PUSH.tolist()}
    for tip, (tau, columns, T) in zip(names, under_node(page, work, given), strict=True):
        R = robot.forward_kinematics(q, tip)[:3, :3]
        heavy = robot.with_payload(tw.SpatialInertia.from_com(MASS), frame=tip)
        expected = heavy.holding_torques(q, wrench_on_robot={tip: np.concatenate([np.zeros(3), R.T @ PUSH])})
        np.testing.assert_allclose(tau, expected, atol=1e-12 * np.abs(expected).max())
        J = robot.jacobian(q, tip, "world_aligned")[3:]
        np.testing.assert_allclose(np.reshape(columns, (robot.nv, 3)).T, J, atol=1e-12)
        np.testing.assert_allclose(np.reshape(T, (4, 4)), robot.forward_kinematics(q, tip), atol=1e-12)


def test_the_tip_keeps_its_orientation_where_asked(tmp_path):
    """A drag by 22 cm: without, the hand of a panda turns by tens of degrees."""
    robot = tw.robots.panda()
    page = write_page(robot, tmp_path / "page.html")
    q0 = np.array(read_page(page)[0]["start"])
    work = """(m, keep) => { let q = m.robot.start; const held = m.tipPose(q), size = m.robot.size, goal = add(place(held), [-0.1, 0.16, -0.11]);
        for (let k = 0; k < 60; k++) {
          const rows = tipError(m.tipPose(q), goal, keep ? held : null, TURN * size), far = Math.hypot(...rows);
          const v = dampedStep(m.tipColumns(q, keep ? TURN * size : 0), times(Math.min(1, 0.1 * size / (far || 1)), rows), damping(far, size));
          const rates = m.run.rates(q, v); q = q.map((x, i) => x + rates[i]); }
        return q; }"""
    turned = []
    for keep in (True, False):
        q = np.array(under_node(page, work, keep))
        T, T0 = robot.forward_kinematics(q), robot.forward_kinematics(q0)
        np.testing.assert_allclose(T[:3, 3] - T0[:3, 3], [-0.1, 0.16, -0.11], atol=1e-5)
        turned.append(np.degrees(np.linalg.norm(tw.so3.log(T0[:3, :3].T @ T[:3, :3]))))
    assert turned[0] < 0.01 < 5 < turned[1]


REST = """(m, damping) => { const { fall } = m.robot;
    fall.viscous = fall.viscous.map((b) => damping ?? b);
    const f = new Fall(m, m.robot.start, [], true), first = f.potential;
    let most = 0;
    while (!f.rests && f.time < 12) { f.step(); most = Math.max(most, f.kinetic); }
    return { time: f.time - f.calm, q: f.q, dq: f.dq, most, lost: first - f.potential - f.kinetic, at: f.resistance.at }; }"""


def test_an_arm_let_go_comes_to_rest(tmp_path):
    """ur5, whose file has no friction: within ten seconds with what is assumed, where dry friction holds it."""
    robot = tw.robots.ur5()
    page = write_page(robot, tmp_path / "page.html")
    assert read_page(page)[0]["fall"]["viscous"] == 6 * [0.1]
    found = under_node(page, REST)
    assert 1.0 < found["time"] < 10.0
    assert found["most"] > 1.0  # J
    hold = np.abs(robot.holding_torques(np.array(found["q"])))
    assert (hold <= 0.02 * robot.limits.effort * (1 + 1e-3) + 2e-2).all()
    drop = robot.potential_energy(read_page(page)[0]["start"]) - robot.potential_energy(found["q"])
    assert found["lost"] == pytest.approx(drop, rel=1e-5)


SLIDE = """<link name="{child}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><joint name="{child}_slide" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<limit lower="-1" upper="1" effort="{effort}" velocity="1"/></joint>"""


COAST = """(m, { speed, seconds }) => {
    const f = new Fall(m, m.robot.start, [speed], true);
    while (f.time < seconds - 1e-9) f.step();
    return f.dq[0]; }"""


def test_what_slides_in_a_damper_loses_speed_at_the_rate_of_damping_over_mass(tmp_path):
    """2 kg on a level rail with 3 N s/m: exp(-3 t / 2), to the error of steps of a millisecond."""
    slide = SLIDE.format(child="a", parent="base", effort=20).replace('mass value="1"', 'mass value="2"')
    damped = slide.replace("/></joint>", '/><dynamics damping="3"/></joint>')
    path = tmp_path / "rail.urdf"
    path.write_text(f'<robot name="rail"><link name="base"/>{damped}</robot>')
    page = write_page(tw.load(path), tmp_path / "page.html", q=[0.0])
    assert under_node(page, COAST, {"speed": 0.8, "seconds": 0.5}) == pytest.approx(0.8 * np.exp(-0.75), rel=1e-3)


def test_joints_stay_between_their_stops_and_rest_against_them(tmp_path):
    """A rod with a stop at 30 degrees below the horizontal ends there; a second joint hangs freely."""
    text = """<robot name="r"><link name="base"/>
    <link name="a"><inertial><origin xyz="0.5 0 0"/><mass value="2"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
    <link name="b"><inertial><origin xyz="0.2 0 0"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
    <joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/><limit lower="-1" upper="0.5236" effort="50" velocity="5"/><dynamics damping="0.2" friction="0.05"/></joint>
    <joint name="k" type="continuous"><parent link="a"/><child link="b"/><origin xyz="1 0 0"/><axis xyz="0 1 0"/><dynamics damping="0.5" friction="0.05"/></joint></robot>"""
    robot = tw.load(text)
    page = write_page(robot, tmp_path / "page.html", q=[-0.8, 0.3])
    found = under_node(page, REST)
    assert found["time"] < 10.0
    assert found["at"] == [1, 0]
    assert found["q"][0] == 0.5236
    hang = robot.holding_torques(np.array(found["q"]))
    assert abs(hang[1]) < 0.05 + 1e-3


def test_many_joints_are_sorted_and_folded_by_limb(show):
    robot = tw.robots.quadruped()
    page = show("quadruped_lists", robot)
    shares = "Array.from(document.querySelectorAll('#torques > ul > li:not([hidden])'), (row) => viewer.panel.bars.findIndex(({ label }) => label.parentElement === row))"
    order = page.run(shares)
    assert len(order) == 8
    found = np.abs(page.run("viewer.shares()"))
    assert sorted(np.round(found[order], 9)) == sorted(np.sort(np.round(found, 9))[-8:])
    folds = page.run("Array.from(document.querySelectorAll('#torques summary'), (s) => s.textContent).filter(Boolean)")
    assert sum(int(text.split("(")[1].split(",")[0]) for text in folds) == robot.nv - 6 - 8  # the floor holds the base
    page.run(
        "(() => { const box = document.getElementById('filter'); box.value = 'RL_'; box.dispatchEvent(new Event('input')); })()"
    )
    names = page.run("Array.from(document.querySelectorAll('#torques > ul > li:not([hidden]) .name'), (e) => e.title)")
    assert sorted(names) == ["RL_calf", "RL_hip", "RL_thigh"]
    seen = page.run(
        "Array.from(document.querySelectorAll('#joints li'), (row) => row).filter((row) => row.offsetHeight).length"
    )
    assert seen == 3
    assert page.complaints == []


def test_a_tip_is_chosen_and_is_in_the_address(show):
    page = show("quadruped_lists", tw.robots.quadruped())
    page.run(
        "(() => { const list = document.querySelector('#tips select'); list.value = 2; list.dispatchEvent(new Event('change')); })()"
    )
    assert page.run("[viewer.robot.frames[viewer.robot.tip].name, location.hash]") == ["RL_foot", "#tip=RL_foot"]
    page.run("viewer.menu.reset()")
    assert page.run("viewer.robot.frames[viewer.robot.tip].name") == "FL_foot"
    assert page.complaints == []
