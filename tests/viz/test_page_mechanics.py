"""What the page computes, under Node: its programs are the robot's kernels, and what is let go keeps its energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from chains import chain
from page_files import read_page
from page_under_node import under_node
from quick import mostly_slow
from scipy.integrate import solve_ivp
from test_viz_page import ROBOTS

import twistwrench as tw
from twistwrench.viz import write_page
from twistwrench.viz.page_programs import MAX_INSTRUCTIONS

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

EVERY = {**ROBOTS, "panda": tw.robots.panda(), "pendulum": tw.robots.pendulum()}
LONG = tw.Robot(chain(np.random.default_rng(0), 28 * "r").build(tip="l28"))
ARMS = ["ur5", "panda", "planar and mimic", "helical", "elastic", "pendulum"]
WRENCH = [0.5, -1.0, 2.0, 3.0, 4.0, -5.0]
PUSH = np.array([7.0, -8.0, 9.0])
LOAD = "m.mass = given.mass; m.push = given.push;"


def given(q, mass=0.0, push=(0.0, 0.0, 0.0)):
    return {"q": np.asarray(q).tolist(), "mass": mass, "push": list(push)}


@pytest.mark.parametrize("name", mostly_slow(EVERY, 2))
def test_what_is_held_and_where_are_the_kernels(tmp_path, name):
    """Payload and push are the page's own, the wrench was on the robot when it was written."""
    robot = EVERY[name]
    wrench = {robot.frame_names[-1]: np.array(WRENCH)}
    page = write_page(robot, tmp_path / "page.html", wrench_on_robot=wrench)
    Q = robot.random_configuration(5, 4)
    header = read_page(page)[0]
    tip = header["frames"][header["tip"]]["name"] if header["payload"] is not None else None
    mass, push = (1.5, PUSH) if tip else (0.0, 0.0 * PUSH)
    work = f"""(m, given) => {{ {LOAD} return given.q.map((q) => [
        m.holding(q), m.centre(q), m.poses(q).flat(), m.pushed < 0 ? [] : m.tipColumns(q).flat()]); }}"""
    found = under_node(page, work, given(Q, mass, push))
    heavy = robot.with_payload(tw.SpatialInertia.from_com(mass), frame=tip) if mass else robot
    for q, (tau, centre, poses, columns) in zip(Q, found, strict=True):
        on = dict(wrench)
        if tip:
            R = robot.forward_kinematics(q, tip)[:3, :3]
            on[tip] = on.get(tip, np.zeros(6)) + np.concatenate([np.zeros(3), R.T @ push])
            J = robot.jacobian(q, tip, kind="world_aligned")[3:]
            np.testing.assert_allclose(np.reshape(columns, (robot.nv, 3)).T, J, atol=1e-12 * max(1.0, np.abs(J).max()))
        expected = heavy.holding_torques(q, wrench_on_robot=on)
        np.testing.assert_allclose(tau, expected, atol=1e-12 * max(1.0, np.abs(expected).max()))
        np.testing.assert_allclose(centre, heavy.center_of_mass(q), atol=1e-12)
        bodies = np.reshape(poses, (-1, 4, 4))
        links = [robot.model.all_frames[link] for link in robot.link_names]
        placed = [(np.eye(4) if f.body < 0 else bodies[f.body]) @ f.pose for f in links]
        np.testing.assert_allclose(placed, robot.link_poses(q), atol=1e-12)


def test_angles_of_sliders_are_roll_pitch_and_yaw(tmp_path):
    page = write_page(EVERY["pendulum"], tmp_path / "page.html")
    angles = np.random.default_rng(3).uniform(-1.5, 1.5, (5, 3))
    found = under_node(page, "(m, given) => given.map((a) => fromQuaternion(toQuaternion(...a)))", angles.tolist())
    turns = [[tw.so3.exp(x * axis) for x, axis in zip(row, np.eye(3), strict=True)] for row in angles]
    np.testing.assert_allclose(np.reshape(found, (5, 3, 3)), [Z @ Y @ X for X, Y, Z in turns], atol=1e-14)


@pytest.mark.parametrize("name", ["quadruped", "planar and mimic"])
def test_between_two_samples_is_the_middle_of_the_short_way(tmp_path, name):
    """Whatever the sign of a quaternion, and however often an angle of the log has turned."""
    robot = EVERY[name]
    page = write_page(robot, tmp_path / "page.html")
    rng = np.random.default_rng(2)
    a = robot.random_configuration(rng)
    step = 0.4 * rng.standard_normal(robot.nv)
    for (
        body
    ) in robot.model.leaders:  # bases turn on the spot: where they move too, the way of robot.add is not straight
        first = {"floating": 3, "planar": 1}.get(body.joint.kind, body.joint.nv)
        step[body.v_index + first : body.v_index + body.joint.nv] = 0.0
    b, middle = robot.add(a, step), robot.add(a, 0.5 * step)
    for body in robot.model.leaders:
        first = body.q_index
        if body.joint.kind == "floating":
            b[first : first + 4] *= -1.0
        elif body.joint.kind == "revolute" and not np.isfinite(robot.limits.upper[body.v_index]):
            b[first] += 2.0 * np.pi
    found = np.array(
        under_node(page, "(m, given) => between(m.robot, given[0], given[1], 0.5)", [a.tolist(), b.tolist()])
    )
    np.testing.assert_allclose(robot.link_poses(found), robot.link_poses(middle), atol=1e-12)


@pytest.mark.parametrize(("name", "rows"), [("panda", "vx vy vz"), ("planar_2r", "vx vz")])
def test_the_tip_is_as_heavy_as_the_task_inertia_says(tmp_path, name, rows):
    """Lambda's eigenvalues are the effective masses, its eigenvectors the axes; the page's payload is in it."""
    robot = getattr(tw.robots, name)()
    page = write_page(robot, tmp_path / "page.html")
    Q = robot.random_configuration(5, 6)
    work = f"""(m, given) => {{ {LOAD} return given.q.map((q) => {{
        const columns = m.tipColumns(q), masses = effectiveMasses(m.massMatrix(q), columns);
        return [masses.map((x) => x.mass), masses.map((x) => x.axis).flat()]; }}); }}"""
    heavy = robot.with_payload(tw.SpatialInertia.from_com(1.5))
    for q, (masses, axes) in zip(Q, under_node(page, work, given(Q, 1.5)), strict=True):
        Lambda = np.asarray(heavy.task_inertia(q, kind="world_aligned", rows=rows))
        expected, n = np.linalg.eigvalsh(Lambda), len(Lambda)
        tolerance = 1e-12 * np.linalg.cond(np.asarray(heavy.mass_matrix(q)))
        np.testing.assert_allclose(masses[:n], expected, rtol=tolerance * expected[-1] / expected[0])
        assert masses[n:] == [None] * (3 - n)  # infinite: no JSON number
        J = heavy.jacobian(q, kind="world_aligned")[3:]
        inverse = J @ np.linalg.solve(heavy.mass_matrix(q), J.T)
        e = np.reshape(axes, (3, 3))
        np.testing.assert_allclose(e @ e.T, np.eye(3), atol=1e-14)
        for axis, mass in zip(e[:n], masses, strict=False):
            np.testing.assert_allclose(inverse @ axis, axis / mass, atol=1e-12 * np.abs(inverse).max())


FALL = f"""(m, given) => {{ {LOAD}
    const fall = new Fall(m, given.q), n = Math.round(given.seconds / fall.h);
    let most = 0;
    for (let k = 1; k <= n; k++) {{ fall.step(); if (k % 80 === 0) {{ fall.advance(0); most = Math.max(most, fall.kinetic); }} }}
    return {{ time: fall.time, y: fall.y, drift: fall.drift, most, work: fall.work }}; }}"""


def far(robot):
    """A pose that falls far, each joint some way from neutral, with springs at rest."""
    q = robot.random_configuration(3)
    for spring in robot.model.springs:  # between a joint and its motor, which is the last coordinate here
        assert [weight for _, weight in spring.terms] == [1.0, -1.0]
        q[-1] = q[0]
    return q


@pytest.mark.parametrize("name", ARMS)
def test_a_robot_let_go_keeps_its_energy(tmp_path, name):
    robot = EVERY[name]
    page = write_page(robot, tmp_path / "page.html")
    found = under_node(page, FALL, {**given(far(robot)), "seconds": 3.0})
    assert found["time"] == pytest.approx(3.0)
    assert found["most"] > 0.1  # it moved [J]
    assert found["drift"] < 1e-6  # [J]
    assert found["work"] == 0


def test_a_robot_falls_as_its_kernels_say(tmp_path, monkeypatch):
    """Against SciPy's adaptive method of order 8 on compiled kernels."""
    monkeypatch.setenv("TWISTWRENCH_JIT", "1")
    robot = EVERY["panda"]
    page = write_page(robot, tmp_path / "page.html")
    q0 = far(robot)
    y = under_node(page, FALL, {**given(q0, 2.0, PUSH), "seconds": 0.5})["y"]
    heavy = robot.with_payload(tw.SpatialInertia.from_com(2.0))

    n = robot.nv

    def slope(_, y):
        q, dq = y[:n], y[n:]
        R = heavy.forward_kinematics(q)[:3, :3]
        push = {heavy.tip: [0, 0, 0, *(R.T @ PUSH)]}
        return np.concatenate([dq, heavy.forward_dynamics(q, dq, np.zeros(n), wrench_on_robot=push)])

    end = solve_ivp(slope, (0, 0.5), np.concatenate([q0, np.zeros(n)]), method="DOP853", rtol=1e-12, atol=1e-13).y[
        :, -1
    ]
    np.testing.assert_allclose(y[: 2 * n], end, atol=1e-8)


@pytest.mark.parametrize("name", ["panda", "planar and mimic"])
def test_the_work_of_what_pushes_is_counted(tmp_path, name):
    """Kinetic + potential energy - work stays; the push alone does f (p - p0)."""
    robot = EVERY[name]
    start = far(robot)
    plain = write_page(robot, tmp_path / "page.html")
    found = under_node(plain, FALL, {**given(start, 0.5, PUSH), "seconds": 1.0})
    p = [robot.forward_kinematics(np.array(q))[:3, 3] for q in (found["y"][: robot.nq], start)]
    assert found["work"] == pytest.approx(PUSH @ (p[0] - p[1]), abs=1e-7)
    assert found["drift"] < 1e-6
    wrenched = write_page(robot, tmp_path / "wrench.html", wrench_on_robot={robot.frame_names[-1]: WRENCH})
    found = under_node(wrenched, FALL, {**given(start, 0.5, PUSH), "seconds": 1.0})
    assert abs(found["work"]) > 1e-3
    assert found["drift"] < 1e-7 * found["most"]  # a moment that turns with the wrist spins it up without end


def test_a_change_of_the_load_begins_a_new_account(tmp_path):
    robot = tw.robots.planar_2r()
    page = write_page(robot, tmp_path / "page.html")
    work = """(m, q) => { const fall = new Fall(m, q); fall.advance(0.01); m.mass = 3; fall.reckon();
        const before = fall.begin; fall.advance(0.01); return [before, fall.drift]; }"""
    energy, drift = under_node(page, work, [0.4, 0.2])
    heavy = robot.with_payload(tw.SpatialInertia.from_com(3.0))
    assert energy == pytest.approx(float(heavy.potential_energy([0.4, 0.2])), abs=0.5)
    assert drift < 1e-9


@pytest.mark.parametrize(
    ("robot", "why"),
    [
        (LONG, f"more than {MAX_INSTRUCTIONS} operations, too much for a page"),
        (tw.load('<robot name="stone"><link name="stone"/></robot>'), "Nothing of it moves"),
    ],
    ids=["chain", "stone"],
)
def test_what_cannot_be_let_go_says_why(tmp_path, robot, why):
    page = write_page(robot, tmp_path / "page.html")
    header, _ = read_page(page)
    assert why in header["fall"]["why"]
    assert not {"acceleration", "mass"} & set(header["programs"]) or len(robot.model.bodies) < 28
    assert page.stat().st_size < 700_000


def test_a_robot_of_massless_joints_says_so(tmp_path):
    text = '<robot name="m"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
    with pytest.warns(tw.ModelWarning):
        robot = tw.load(text)
    header, _ = read_page(write_page(robot, tmp_path / "page.html"))
    assert "moves nothing that has mass" in header["fall"]["why"]
    assert header["payload"] == 1.0


def test_frames_named_as_the_pages_own_do_not_meet(tmp_path, bundled):
    """A link called payload, and one called body 0."""
    text = tw.robots.path_of("planar_2r").read_text().replace('"tip"', '"payload"').replace('"link1"', '"body 0"')
    robot, q = tw.load(text), [0.3, 0.4]
    page = write_page(robot, tmp_path / "page.html", wrench_on_robot={"body 0": WRENCH})
    tau = under_node(page, f"(m, given) => {{ {LOAD} return m.holding(given.q); }}", given(q, 2.0, [0, 0, 0]))
    heavy = bundled("planar_2r").with_payload(tw.SpatialInertia.from_com(2.0))
    expected = heavy.holding_torques(q, wrench_on_robot={"link1": WRENCH})
    np.testing.assert_allclose(tau, expected, atol=1e-12 * max(1.0, math.hypot(*expected)))
