"""Pages of sections of the book: every number they show is that of the kernels, under Node and in a real browser."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from chains import chain
from click.testing import CliRunner
from page_files import read_page
from page_under_node import under_node

import twistwrench as tw
from twistwrench import statics
from twistwrench.cli.main import main
from twistwrench.viz import scene_of, write_page
from twistwrench.viz.article import ARTICLES
from twistwrench.viz.section_pages import SECTIONS, opening_picture

pytest_plugins = ("page_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

ARMS = ["planar_2r", "ur5", "panda"]
READ = """(m, given) => given.states.map((state) => {
    m.mass = given.mass; m.push = given.push; m.tau = state.tau;
    const { tables, values, tau } = READOUTS[given.section](m, state);
    return { tables: tables.map(({ rows }) => rows.map(([, xs]) => xs)), values: (values || []).map(([, x]) => x), tau }; })"""


@cache
def arm(name, load=""):
    """One of the bundled arms, with what the tests put at its tip; compiled once."""
    robot = getattr(tw.robots, name)()
    return robot.with_payload(tw.SpatialInertia.from_com(1.5)) if load else robot


class State:
    """One state of an arm, and what the kernels say of it; the payload is on it where the page has one."""

    def __init__(self, name, rng, k, load):
        self.bare, self.robot = arm(name), arm(name, load)
        robot, n = self.bare, self.bare.nv
        self.q = robot.random_configuration(k)
        self.dq, self.ddq, self.tau = rng.normal(size=n), rng.normal(size=n), 10 * rng.normal(size=n)
        self.dV = rng.normal(size=2 if n == 2 else 3)
        self.wrench = np.concatenate([rng.normal(size=3), 10 * rng.normal(size=3)])
        self.motor = np.array([50.0, 2.0, 3.0, 4.0])  # ratio, kg cm^2, N m s/rad, N m
        self.chosen = k % n
        self.mass, self.push = (1.5 if load else 0.0), (np.array([7.0, -8.0, 9.0]) if load == "all" else np.zeros(3))

    @property
    def sent(self):
        return {
            name: np.asarray(getattr(self, name)).tolist()
            for name in ("q", "dq", "ddq", "tau", "wrench", "dV", "motor", "chosen")
        }

    @property
    def link(self):
        return self.bare.body_names[self.chosen]


def on_link(s):
    G = np.asarray(s.bare.model.bodies[s.chosen].inertia.matrix)
    V = s.bare.frame_velocity(s.q, s.dq, s.link)
    return G, V, s.bare.frame_acceleration(s.q, s.dq, s.ddq, s.link), -(tw.ad(V).T @ (G @ V))


def of_3_4(s):
    V_b, V_s = (s.bare.frame_velocity(s.q, s.dq, kind=kind) for kind in ("body", "space"))
    F_s = tw.Ad(tw.se3.inverse(s.bare.forward_kinematics(s.q))).T @ s.wrench
    return [[V_b, V_s], [s.wrench, F_s]], [V_b @ s.wrench, V_s @ F_s], None


def of_5_1(s):
    J_b, J_s = s.bare.jacobian(s.q), s.bare.jacobian(s.q, kind="space")
    return [J_b, J_s, [J_b @ s.dq]], [], None


def of_5_2(s):
    J, tau = s.bare.jacobian(s.q), s.bare.wrench_torques(s.q, s.wrench)
    return [np.column_stack([(J * s.wrench[:, None]).T, tau])], [], tau


def forward(axes):
    """Axes, one a row, turned so that the first entry of each is positive."""
    return [x * np.sign(x[np.flatnonzero(np.abs(x) > 1e-9)[0]]) for x in np.asarray(axes)]


def of_5_3(s):
    """The twist that is hardest to reach, and the joint velocities that give it; lengths in sizes of the robot."""
    size = scene_of(s.bare).size
    lengths = np.array([1, 1, 1, size, size, size])
    J, rank = s.bare.jacobian(s.q) / lengths[:, None], min(6, s.bare.nv)
    U, values, _ = np.linalg.svd(J)
    (twist,) = forward([U[:, rank - 1]])
    rates = J.T @ twist / values[rank - 1]
    return [[values[:rank]], [twist * lengths], [rates]], [rank, 1 / values[rank - 1]], None


def of_5_4(s):
    tables = []
    for part, rank in zip(("force", "moment"), (2, 1) if s.bare.nv == 2 else (3, 3), strict=True):
        forces = statics.wrench_ellipsoid(s.bare, s.q, part=part)
        lengths, axes = forces.semi_axes[-rank:][::-1], forward(forces.axes.T[-rank:][::-1])
        tables.append(np.column_stack([1 / lengths, lengths, axes]))
    a = tables[0][:, 0]
    return tables, [a[0] / a[-1], (a[0] / a[-1]) ** 2, a.prod()], None


def of_8_1_2(s):
    terms = s.robot.christoffel(s.q) * s.dq[:, None] * s.dq
    c, squares = s.robot.coriolis_forces(s.q, s.dq), np.einsum("ijj->ij", terms).sum(axis=1)
    mine = terms[s.chosen]
    upper = np.where(np.tri(len(c), k=-1, dtype=bool), np.nan, mine + mine.T - np.diag(np.diag(mine)))
    return [upper, [squares, c - squares, c]], [], c


def of_8_1_3(s):
    return [s.robot.mass_matrix(s.q)], [], None


def of_8_2(s):
    G, V, dV, rest = on_link(s)
    return [[V], [dV], [G @ V], [G @ dV, rest, G @ dV + rest], G], [V @ G @ V / 2], None


def of_8_3(s):
    G, V, dV, rest = on_link(s)
    R = s.bare.forward_kinematics(s.q, s.link)[:3, :3]
    dV = dV + np.concatenate([np.zeros(3), -R.T @ s.bare.gravity])
    on = {s.bare.tip: s.wrench}
    F = s.bare.joint_wrenches(s.q, s.dq, s.ddq, wrench_by_robot=on)[s.chosen]
    tau = s.bare.inverse_dynamics(s.q, s.dq, s.ddq, wrench_by_robot=on)
    return [[V], [dV], [G @ dV, rest, F - G @ dV - rest, F]], [tau[s.chosen]], tau


def of_8_4(s):
    """From the stacked matrices of the whole robot."""
    at, k = s.bare.closed_form(s.q, s.dq), s.chosen
    mine = slice(6 * k, 6 * k + 6)
    J, G = (at.L @ at.A)[mine], at.G[mine, mine]
    link_gravity = J.T @ G @ (at.L @ at.dV_base)[mine]
    return [J, [at.V[mine]], J.T @ G @ J, at.M, [link_gravity, at.g]], [], at.g


def of_8_5(s):
    R = s.robot.forward_kinematics(s.q)[:3, :3]
    on = {s.robot.tip: [0, 0, 0, *(R.T @ s.push)]}
    h = s.robot.inverse_dynamics(s.q, s.dq, np.zeros(s.robot.nv), wrench_on_robot=on)
    ddq = s.robot.forward_dynamics(s.q, s.dq, s.tau, wrench_on_robot=on)
    return [[s.tau, h, s.tau - h, ddq], s.robot.mass_matrix(s.q)], [0.0], s.tau


def of_8_6(s):
    rows = "vx vz" if s.robot.nv == 2 else "vx vy vz"
    at = [3, 5] if s.robot.nv == 2 else [3, 4, 5]
    task = {"kind": "world_aligned", "rows": rows}
    Lambda, eta = s.robot.task_inertia(s.q, **task), s.robot.task_bias(s.q, s.dq, **task)
    F, J = Lambda @ s.dV + eta, s.robot.jacobian(s.q, kind="world_aligned")[at]
    pivots = np.diag(np.linalg.cholesky(np.linalg.inv(Lambda)[::-1, ::-1])) ** 2  # from the last row on
    return [Lambda, [Lambda @ s.dV, eta, F], [s.dV, s.dV]], [pivots.min()], J.T @ F


def of_8_7(s):
    """From the closed robot, with velocities projected."""
    R = s.robot.forward_kinematics(s.q)[:3, :3]
    on = {s.robot.tip: [0, 0, 0, *(R.T @ s.push)]}
    wall = s.robot.constrain(s.robot.tip, "vx", kind="world_aligned")
    free = wall.project_velocity(s.q, s.dq)
    A, P = wall.constraint_jacobian(s.q)[0], wall.projector(s.q)
    ddq, lam = wall.forward_dynamics(s.q, free, s.tau, wrench_on_robot=on)
    rest = s.tau - s.robot.inverse_dynamics(s.q, free, np.zeros(s.robot.nv), wrench_on_robot=on)
    place = s.bare.forward_kinematics(s.q)[0, 3]
    return [[A, free, rest, P @ rest, A * lam[0], ddq], P], [lam[0], place, 0.0, 0.0], s.tau


def of_8_9(s):
    """A robot with armature, and the two laws of friction."""
    ratio, inertia, viscous, coulomb = s.motor
    reflected = ratio**2 * inertia * 1e-4
    driven = s.robot.with_armature(dict.fromkeys(s.robot.joint_names, reflected))
    links, friction = s.robot.inverse_dynamics(s.q, s.dq, s.ddq), viscous * s.dq + coulomb * np.sign(s.dq)
    tau = driven.inverse_dynamics(s.q, s.dq, s.ddq) + friction
    at_joint = [
        s.robot.mass_matrix(s.q).diagonal(),
        np.full(s.robot.nv, reflected),
        links,
        reflected * s.ddq,
        friction,
        tau,
    ]
    at_motor = [tau / ratio, ratio * s.dq, tau * s.dq]
    return [np.transpose(at_joint), np.transpose(at_motor)], [], tau


EXPECTED = {
    "3.4": of_3_4,
    "5.1": of_5_1,
    "5.2": of_5_2,
    "5.3": of_5_3,
    "5.4": of_5_4,
    "8.1.2": of_8_1_2,
    "8.1.3": of_8_1_3,
    "8.2": of_8_2,
    "8.3": of_8_3,
    "8.4": of_8_4,
    "8.5": of_8_5,
    "8.6": of_8_6,
    "8.7": of_8_7,
    "8.9": of_8_9,
}


def test_every_section_is_compared():
    assert list(EXPECTED) == list(SECTIONS)


@pytest.mark.parametrize("number", [number for number in SECTIONS if number not in ARTICLES])
def test_a_section_without_an_article_opens_with_three_sentences_and_a_drawing(number):
    idea = re.sub(r"<[^>]+>", "", SECTIONS[number].idea)
    assert len(re.split(r"(?<=[.?])\s", idea)) == 3
    drawing = opening_picture(number)
    assert drawing.startswith("<svg")
    assert len(drawing) < 4000
    assert re.search(r'aria-label="[A-Z][^"]{30,}\."', drawing)


def close(found, expected, tolerance, what):
    expected = np.asarray(expected, float)
    found = (
        np.array([[np.nan if x is None else x for x in row] for row in found], float)
        if expected.ndim == 2
        else np.array(found)
    )
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=tolerance * max(1.0, np.nanmax(np.abs(expected))), err_msg=what
    )


def some(every, quick):
    """All of them, those that are not quick marked slow."""
    return [pytest.param(*x, id="-".join(x), marks=() if x in quick else pytest.mark.slow) for x in every]


QUICK = [*((number, "panda") for number in SECTIONS), ("8.1.3", "planar_2r"), ("8.5", "planar_2r")]


@pytest.mark.parametrize(("number", "name"), some([(s, n) for s in SECTIONS for n in ARMS], QUICK))
def test_what_a_section_shows_is_what_the_kernels_compute(tmp_path, number, name):
    """To 1e-12 of the largest entry; where M is inverted, times its condition."""
    robot, load = arm(name), SECTIONS[number].load
    page = write_page(robot, tmp_path / "page.html", section=number)
    rng = np.random.default_rng(0)
    states = [State(name, rng, k, load) for k in range(3)]
    given = {
        "section": number,
        "states": [s.sent for s in states],
        "mass": states[0].mass,
        "push": states[0].push.tolist(),
    }
    for s, found in zip(states, under_node(page, READ, given), strict=True):
        tables, values, tau = EXPECTED[number](s)
        tolerance = 1e-12 * (np.linalg.cond(s.robot.mass_matrix(s.q)) if number in ("8.5", "8.6", "8.7") else 1.0)
        if number == "8.6":
            tolerance *= np.linalg.cond(tables[0])
        for k, expected in enumerate(tables):
            close(found["tables"][k], expected, tolerance, f"table {k}")
        assert len(found["values"]) == len(values)
        if values:
            of_residual = np.abs(tau).max() if number == "8.5" else 1.0  # M ddq + h - tau, beside tau
            close(found["values"], values, tolerance * of_residual, "values")
        assert ("tau" in found) == (tau is not None)
        if tau is not None:
            close(found["tau"], tau, tolerance, "torques")


ARROWS = """(m, given) => given.states.map((state) => {
    m.mass = given.mass; m.push = given.push; m.tau = state.tau;
    return READOUTS[given.section](m, state).arrows.map(({ p, along }) => [p, along]); })"""


def arrows_of(number, s):
    """What a section draws at the tip, or at its link: vectors in the base's axes."""
    T = s.bare.forward_kinematics(s.q, s.link if number == "8.2" else None)
    R, p = T[:3, :3], T[:3, 3]
    if number == "3.4":
        V = s.bare.frame_velocity(s.q, s.dq)
        return p, [R @ V[3:], R @ V[:3], R @ s.wrench[3:], R @ s.wrench[:3]]
    if number == "8.2":
        G, V, dV, rest = on_link(s)
        return p, [R @ V[3:], R @ (G @ dV + rest)[3:]]
    if number == "8.6":
        force = np.zeros(3)
        force[[0, 2] if s.robot.nv == 2 else [0, 1, 2]] = of_8_6(s)[0][1][2]
        return p, [force]
    return p, [np.array([of_8_7(s)[1][0], 0.0, 0.0])]


@pytest.mark.parametrize(
    ("number", "name"), [("3.4", "panda"), ("8.2", "panda"), ("8.6", "planar_2r"), ("8.6", "panda"), ("8.7", "panda")]
)
def test_arrows_are_where_and_what_the_kernels_say(tmp_path, number, name):
    """To 1e-9: where M is inverted, its condition takes digits."""
    robot, load = arm(name), SECTIONS[number].load
    page = write_page(robot, tmp_path / "page.html", section=number)
    s = State(name, np.random.default_rng(0), 1, load)
    (found,) = under_node(
        page, ARROWS, {"section": number, "states": [s.sent], "mass": s.mass, "push": s.push.tolist()}
    )
    place, vectors = arrows_of(number, s)
    assert len(found) == len(vectors)
    for (p, along), vector in zip(found, vectors, strict=True):
        np.testing.assert_allclose(p, place, atol=1e-12)
        np.testing.assert_allclose(along, vector, atol=1e-9 * max(1.0, np.abs(vector).max()))


@pytest.mark.parametrize("number", some([(s,) for s in SECTIONS], [("5.2",), ("8.3",)]))
def test_a_page_of_a_section_in_a_browser(show, number):
    """On a screen and on a telephone: what stands in its cells are the numbers of its readout, nothing runs over its edges, and the sliders move them."""
    page = show(f"book_{number}", arm("panda"), section=number)
    try:
        for width, height in ((1280, 800), (390, 844)):
            page.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            fits(page)
            moves(page)
        assert page.complaints == []
    finally:
        page.call("Emulation.clearDeviceMetricsOverride")


def fits(page):
    inside = """Array.from(document.querySelectorAll('aside *:not(.scroll *)')).filter((e) => {
        const box = e.getBoundingClientRect();
        return box.left < 0 || box.right > innerWidth + 0.5; }).map((e) => e.outerHTML.slice(0, 80))"""
    assert page.run(inside) == []
    wide = "Array.from(document.querySelectorAll('#values td')).filter((e) => e.scrollWidth > e.clientWidth + 1).map((e) => e.textContent)"
    assert page.run(wide) == []
    shown = page.run("Array.from(document.querySelectorAll('#values td'), (e) => [e.title, e.textContent])")
    rows = "viewer.book.found.tables.flatMap(({ rows }) => rows.flatMap(([, xs]) => xs.map((x) => x === null ? '' : String(x))))"
    assert [title for title, _ in shown] == page.run(rows)
    for title, text in shown:
        if title:
            number = float(text.replace("\u2212", "-").replace("\u221e", "inf"))
            digits = len(text.partition(".")[2])
            assert number == pytest.approx(float(title), abs=0.501 * 10.0**-digits) or number == 0 == float(title)


def moves(page):
    values = "document.getElementById('values').textContent"
    before = page.run(values)
    page.run("viewer.setCoordinates(viewer.q.map((x, k) => x + 0.1 * (k === 1)))")
    assert page.run(values) != before
    for key in page.run("viewer.robot.book.inputs.map(({ key }) => key)"):
        before = page.run(values)
        page.run(
            f"((e) => {{ e.value = 0.7 * e.max - e.value; e.dispatchEvent(new Event('input')); }})(document.getElementById('{key}-0'))"
        )
        assert page.run(values) != before, key


def test_forward_dynamics_of_the_page_keeps_its_account(tmp_path):
    """Kinetic + potential energy - work of the torques, from a start with velocity."""
    robot = arm("ur5")
    page = write_page(robot, tmp_path / "page.html", section="8.5")
    work = """(m, given) => { m.tau = given.tau; const fall = new Fall(m, given.q, given.dq); fall.advance(0);
        for (let k = 1; k <= 8000; k++) { fall.step(); if (k % 80 === 0) fall.advance(0); }
        return [fall.drift, fall.work, fall.kinetic, fall.potential]; }"""
    q, dq = robot.random_configuration(3), [0.5, -0.5, 0.5, 0.0, 1.0, 0.0]
    tau = robot.holding_torques(q) + np.array([5.0, -3.0, 2.0, 0.1, 0.1, 0.0])
    drift, done, K, P = under_node(page, work, {"q": q.tolist(), "dq": dq, "tau": tau.tolist()})
    assert abs(done) > 0.1
    assert drift < 1e-6
    assert K + P - done == pytest.approx(float(robot.kinetic_energy(q, dq) + robot.potential_energy(q)), abs=1e-6)


@pytest.mark.slow
def test_a_robot_let_go_slides_along_the_wall(tmp_path):
    """By the torques that are set: as the closed robot's own integrator says, its energy kept, its tip on the wall."""
    robot = arm("ur5")
    page = write_page(robot, tmp_path / "page.html", section="8.7")
    slide = """(m, given) => { m.tau = given.tau; const { dq } = READOUTS["8.7"](m, given), fall = new Fall(m, given.q, dq);
        for (let k = 1; k <= 4000; k++) { fall.step(); if (k % 80 === 0) fall.advance(0); }
        return [fall.q, fall.dq, fall.drift, fall.work]; }"""
    q = robot.random_configuration(3)
    tau = robot.holding_torques(q) + np.array([5.0, -3.0, 2.0, 0.1, 0.1, 0.0])
    wall = robot.constrain(robot.tip, "vx", kind="world_aligned")
    dq = wall.project_velocity(q, [0.5, -0.5, 0.5, 0.0, 1.0, 0.0])
    sent = {"q": q.tolist(), "dq": dq.tolist(), "tau": tau.tolist()}
    q1, dq1, drift, work = under_node(page, slide, sent)
    assert abs(work) > 0.1
    assert drift < 1e-6
    assert abs(robot.forward_kinematics(q1)[0, 3] - robot.forward_kinematics(q)[0, 3]) < 1e-9
    assert np.abs(np.subtract(q1, q)).max() > 0.5
    end = wall.simulate(q, dq, duration=0.5, dt=1 / 8000, tau=tau)  # the same method and step, and projected after each
    np.testing.assert_allclose(q1, end.q[-1], atol=1e-8)
    np.testing.assert_allclose(dq1, end.dq[-1], atol=1e-7)


def test_the_wall_is_pressed_at_first(tmp_path):
    """The torques hold the robot, which stands still, and press with what they are given for it."""
    robot = arm("panda")
    header, _ = read_page(page := write_page(robot, tmp_path / "page.html", section="8.7"))
    tau = [row["start"] for row in header["book"]["inputs"][0]["rows"]]
    q = np.array(header["start"])
    sent = {"q": header["start"], "dq": [0.0] * 7, "tau": tau}
    force = under_node(page, '(m, given) => READOUTS["8.7"](m, given).values[0][1]', sent)
    J = robot.jacobian(q, kind="world_aligned")[3]
    np.testing.assert_allclose(tau, robot.holding_torques(q) + force * J, atol=1e-9)
    assert force > 5.0


def test_at_first_the_torques_hold_the_robot(tmp_path):
    robot = arm("panda")
    header, _ = read_page(write_page(robot, tmp_path / "page.html", section="8.5"))
    tau, dq = ([row["start"] for row in header["book"]["inputs"][k]["rows"]] for k in (0, 1))
    np.testing.assert_allclose(tau, robot.holding_torques(np.array(header["start"])), atol=1e-12 * 100)
    assert dq == [0.0] * robot.nv


@pytest.mark.parametrize(
    ("robot", "section", "message"),
    [
        (tw.robots.ur5(), "8.8", "section '8.8' is not known. Choose one of: 3.4"),
        (tw.robots.quadruped(), "8.3", "section 8.3: robot 'quadruped' has no single tip"),
        (tw.robots.floating_box(), "8.2", "neither turn nor slide, or a base that moves"),
    ],
)
def test_what_has_no_page_is_refused(tmp_path, robot, section, message):
    with pytest.raises(tw.ValueRangeError, match=message):
        write_page(robot, tmp_path / "page.html", section=section)
    with pytest.raises(tw.ValueRangeError, match="leave them out"):
        write_page(tw.robots.ur5(), tmp_path / "page.html", section="5.2", wrench_on_robot={"tool0": np.ones(6)})
    assert not any(tmp_path.iterdir())


def test_a_tip_that_only_turns(tmp_path):
    """Its page of manipulability has the turning alone, and those of forces at the tip say that there is nothing to show."""
    turning = tw.Robot(chain(np.random.default_rng(0), "r").build(tip="l1"))
    page = write_page(turning, tmp_path / "page.html", section="5.4")
    found = under_node(page, "(m, q) => READOUTS['5.4'](m, { q })", [0.3])
    (table,) = found["tables"]
    np.testing.assert_allclose(table["rows"][0][1][:2], [1.0, 1.0], atol=1e-12)
    with pytest.raises(tw.ValueRangeError, match="no joint moves the origin of its tip 'l1'"):
        write_page(turning, tmp_path / "none.html", section="8.7")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--section", "8.3"], "--section writes a page. Add --html OUT.html."),
        (["--section", "8.30", "--html", "x.html"], "Choose one of: 3.4"),
        (["--section", "8.3", "--html", "x.html", "--trajectory", "demo"], "Leave --trajectory out"),
        (["--section", "8.3", "--html", "x.html", "--wrench-on-robot", "tool0:0,0,0,1,0,0"], "leave them out"),
    ],
)
def test_the_command_refuses_before_it_writes(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(main, ["view", "ur5", *arguments])
    assert found.exit_code == 2
    assert message in " ".join(found.output.split())
    assert not any(tmp_path.iterdir())


def test_the_command_writes_a_page_with_a_payload(tmp_path):
    """What the arm carries is part of its last link, and of the page."""
    path = tmp_path / "page.html"
    done = CliRunner().invoke(main, ["view", "ur5", "--section", "8.1.3", "--payload", "2", "--html", str(path)])
    assert done.exit_code == 0, done.output
    heavy = arm("ur5").with_payload(tw.SpatialInertia.from_com(2.0))
    q = read_page(path)[0]["start"]
    J = heavy.jacobian(q, kind="world_aligned")
    assert np.linalg.svd(J, compute_uv=False)[-1] > 0.1  # far from singular
    found = under_node(path, "(m, q) => Array.from(m.massMatrix(q))", q)
    M = heavy.mass_matrix(q)
    np.testing.assert_allclose(np.reshape(found, M.shape), M, atol=1e-12 * M.max())


def test_arrows_are_to_a_scale_that_is_a_round_number(tmp_path):
    """And told: so much for a square of the floor."""
    page = write_page(arm("planar_2r"), tmp_path / "page.html", section="3.4")
    assert "<title>3.4 Twists and wrenches at the tip, planar_2r</title>" in page.read_text("utf-8")
    amounts = [1e-3, 0.13, 0.15, 1.0, 1.5, 3.1, 3.2, 7.0, 7.2, 900.0]
    found = under_node(page, "(m, x) => x.map(nearRound)", amounts)
    assert found == [1e-3, 0.1, 0.2, 1.0, 2.0, 2.0, 5.0, 5.0, 10.0, 1000.0]
    said = under_node(page, '(m) => saidScales(1.1, [[perSquare(1.5, 0.33, 1.1), "m/s"], [20, "N"], [20, "N"]])')
    assert said == "a square of the floor, 0.1 m, is 0.5 m/s, 20 N"  # 0.33 m for 1.5 m/s
    sections = {number: read_page(write_page(arm("planar_2r"), page, section=number))[0] for number in ("3.4", "5.2")}
    assert [any(key == "torques" for key, _ in s["switches"]) for s in sections.values()] == [False, True]


HEIGHTS = "['values', 'joints'].map((id) => { const b = document.getElementById(id).getBoundingClientRect(); return [b.y, b.height]; })"


def test_the_panel_keeps_its_place_when_a_velocity_becomes_zero(show):
    """A slider stays below the pointer: the legend's rows stay, and say that an arrow is zero."""
    page = show("place_8.2", tw.robots.ur5(), section="8.2")
    before = page.run(HEIGHTS)
    page.run("viewer.book.state.dq.fill(0); viewer.set('dq')")
    assert page.run(HEIGHTS) == before
    legend = "[...document.querySelectorAll('#values .legend span')].map((row) => row.textContent)"
    assert "velocity of its origin (zero)" in page.run(legend)
    page.run("viewer.book.state.ddq.fill(0); viewer.set('ddq')")
    assert page.run(HEIGHTS) == before
    assert "total force on it (zero)" in page.run(legend)
    assert page.complaints == []


def test_the_legend_names_ellipsoids_that_are_shown_and_colours_of_numbers(show):
    page = show("place_8.2", tw.robots.ur5(), section="8.2")
    legend = "document.querySelector('#values .legend').textContent"
    assert "ellipsoid" not in page.run(legend)
    assert "orange positive, blue negative" in page.run(legend)
    page.click("#show-inertia")
    assert "blue ellipsoids: uniform" in page.run(legend)
    page.click("#show-mass")
    assert "effective mass of the tip" in page.run(legend)
    page.click("#show-inertia")
    page.click("#show-mass")
    assert "ellipsoid" not in page.run(legend)


def test_a_switch_without_an_effect_is_not_offered(tmp_path):
    """Ellipsoids of point masses are within the joints of the planar arm."""

    def keys(robot):
        write_page(robot, tmp_path / "switches.html", section="5.2")
        return [key for key, _ in read_page(tmp_path / "switches.html")[0]["switches"]]

    assert "inertia" not in keys(tw.robots.planar_2r())
    assert "inertia" in keys(tw.robots.ur5())


def test_the_centre_of_mass_on_a_page_about_one_link_is_that_of_the_link(show):
    robot = tw.robots.panda()
    page = show("place_panda", robot, section="8.2")
    for k, body in enumerate(robot.model.bodies):
        page.run(f"viewer.book.state.chosen = {k}; viewer.refresh()")
        q = np.array(page.run("viewer.q"))
        T = robot.link_poses(q)[robot.link_names.index(robot.body_names[k])]
        expected = T[:3, :3] @ body.inertia.com + T[:3, 3]
        np.testing.assert_allclose(page.run("viewer.book.centre"), expected, atol=1e-12)
    page.click("#show-com")
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    labels = page.run("[...document.querySelectorAll('#labels span')].map((label) => label.textContent)")
    assert labels == ["{b}", "c", "tip"]
    page.click("#show-com")
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert page.run("document.querySelectorAll('#labels span').length") == 2
    assert page.complaints == []


def test_the_camera_stays_above_the_floor(show):
    """However the view is turned, moved and zoomed on a full page."""
    page = show("place_8.2", tw.robots.ur5(), section="8.2")
    above = "viewer.stage.camera().eye[2] > viewer.robot.floor"
    for way in [((300, 400), (500, 300)), ((300, 400), (320, 60)), ((300, 400), (310, 20))]:
        page.drag(*way)
        assert page.run(above)
    for _ in range(4):
        page.call("Input.dispatchMouseEvent", type="mouseWheel", x=300, y=300, deltaX=0, deltaY=400)
        assert page.run(above)
    page.run(
        "viewer.stage.target[2] = viewer.robot.floor - 1; document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowUp' }))"
    )
    assert page.run("viewer.stage.elevation") > 0
    assert page.complaints == []


def test_small_numbers_have_three_digits_and_zeros_look_alike(show):
    page = show("place_8.2", tw.robots.ur5(), section="8.2")
    texts = page.run("[...document.querySelectorAll('#values td')].map((cell) => [cell.textContent, cell.title])")
    assert all(text == "0" for text, _ in texts if re.fullmatch(r"[−-]?0\.?0*", text))
    small = [text for text, title in texts if 1e-3 < abs(float(title)) < 1e-2 and "0.00" in text]
    assert any(len(text.replace("−", "").lstrip("0.")) == 3 for text in small)
