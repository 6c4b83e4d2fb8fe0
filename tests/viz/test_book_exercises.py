"""Exercises of the section pages: every answer is that of the library, and a typed number is right to 1 %."""

from __future__ import annotations

import numpy as np
import pytest
from page_under_node import under_node
from test_book_pages import State, arm, on_link

from twistwrench import statics
from twistwrench.viz import scene_of, write_page
from twistwrench.viz.page import viewer_page
from twistwrench.viz.section_pages import SECTIONS

pytest_plugins = ("page_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

ANSWER = """(m, given) => given.states.map((state) => {
    m.mass = given.mass; m.push = given.push; m.tau = state.tau;
    return ANSWERS[given.section].map((answer) => answer(m, state, READOUTS[given.section](m, state))); })"""


def singular_values(s):
    """Of the body Jacobian, lengths in sizes of the robot."""
    J = s.bare.jacobian(s.q)
    J[3:] /= scene_of(s.bare).size
    return np.linalg.svd(J, compute_uv=False)[: min(6, s.bare.nv)]


def of_3_4(s):
    V_b, V_s = (s.bare.frame_velocity(s.q, s.dq, kind=kind) for kind in ("body", "space"))
    return np.linalg.norm(V_b[3:]), np.linalg.norm(V_s[3:]), V_b[:3] @ s.wrench[:3]


def of_5_1(s):
    first, others = np.eye(s.bare.nv)[0], s.dq * (np.arange(s.bare.nv) > 0)
    V = [s.bare.frame_velocity(s.q, dq) for dq in (2 * first, np.ones(s.bare.nv), others)]
    return np.linalg.norm(V[0][3:]), np.linalg.norm(V[1][:3]), np.linalg.norm(V[2][3:])


def of_5_2(s):
    tau = s.bare.wrench_torques(s.q, s.wrench)
    force = s.bare.wrench_torques(s.q, s.wrench * [0, 0, 0, 2, 2, 2])
    return force[0], 100 / np.abs(tau).max(), 1e-3 * tau.sum()


def of_5_3(s):
    sigma = singular_values(s)
    return sigma[0] / sigma[-1], sigma.prod(), 2 * sigma[-1]


def of_5_4(s):
    lengths = statics.wrench_ellipsoid(s.bare, s.q, part="force").semi_axes[-(2 if s.bare.nv == 2 else 3) :]
    return 10 * lengths.max(), 0.5 / lengths.max(), lengths.min()


def of_8_1_2(s):
    c, last = s.robot.coriolis_forces(s.q, s.dq), s.dq * (np.arange(s.robot.nv) == s.robot.nv - 1)
    return s.robot.coriolis_forces(s.q, 2 * s.dq)[s.chosen], c @ s.dq, s.robot.coriolis_forces(s.q, last)[0]


def of_8_1_3(s):
    first, M = np.eye(s.robot.nv)[0], s.robot.mass_matrix(s.q)
    J = s.robot.jacobian(s.q, kind="world_aligned")[3:]
    mobility = np.linalg.eigvalsh(J @ np.linalg.solve(M, J.T)).max()
    return s.robot.kinetic_energy(s.q, 2 * first), np.linalg.norm(M @ (3 * first)), 2 / mobility


def of_8_2(s):
    G, V, dV, rest = on_link(s)
    body = s.bare.model.bodies[s.chosen].inertia
    v = V[3:] + np.cross(V[:3], body.com)
    return np.linalg.norm(body.com), body.mass * v @ v / 2, V @ (G @ dV + rest)


def of_8_3(s):
    on = {s.bare.tip: s.wrench}
    F = s.bare.joint_wrenches(s.q, s.dq, s.ddq, wrench_by_robot=on)[s.chosen]
    tau = s.bare.inverse_dynamics(s.q, s.dq, s.ddq, wrench_by_robot=on)
    return np.linalg.norm(F[3:]), tau[s.chosen] * s.dq[s.chosen], tau @ s.dq


def of_8_4(s):
    G, V, _, _ = on_link(s)
    J = s.bare.jacobian(s.q, s.link)
    share = (J.T @ G @ J)[0, 0] / s.bare.mass_matrix(s.q)[0, 0]
    step = 1e-6
    rise = s.bare.potential_energy(s.q + step * s.dq) - s.bare.potential_energy(s.q - step * s.dq)
    return 100 * share, V @ G @ V / 2, rise / (2 * step)


def of_8_5(s):
    R, first = s.robot.forward_kinematics(s.q)[:3, :3], np.eye(s.robot.nv)[0]
    on = {s.robot.tip: [0, 0, 0, *(R.T @ s.push)]}
    now, more, twice = (
        s.robot.forward_dynamics(s.q, s.dq, tau, wrench_on_robot=on)[0] for tau in (s.tau, s.tau + first, 2 * s.tau)
    )
    return more - now, twice - now, s.dq[0] + 0.01 * now


def of_8_6(s):
    task = {"kind": "world_aligned", "rows": "vx vz" if s.robot.nv == 2 else "vx vy vz"}
    Lambda = s.robot.task_inertia(s.q, **task)
    eta, still = (s.robot.task_bias(s.q, dq, **task)[0] for dq in (s.dq, 0 * s.dq))
    return (Lambda @ (2 * s.dV))[0] + eta, 1 / np.linalg.inv(Lambda)[0, 0], still


def of_8_7(s):
    R = s.robot.forward_kinematics(s.q)[:3, :3]
    on = {s.robot.tip: [0, 0, 0, *(R.T @ s.push)]}
    wall = s.robot.constrain(s.robot.tip, "vx", kind="world_aligned")
    free, A = wall.project_velocity(s.q, s.dq), wall.constraint_jacobian(s.q)[0]
    ddq, pressed = wall.forward_dynamics(s.q, free, s.tau + 10 * A, wrench_on_robot=on)
    return pressed[0], ddq[0], pressed[0] * A @ free


def of_8_9(s):
    ratio, inertia, viscous, coulomb = s.motor
    rotor = inertia * 1e-4
    driven = s.robot.with_armature(dict.fromkeys(s.robot.joint_names, ratio**2 * rotor))
    friction = viscous * s.dq + coulomb * np.sign(s.dq)
    power = (driven.inverse_dynamics(s.q, s.dq, s.ddq) + friction) @ s.dq
    return np.sqrt(s.robot.mass_matrix(s.q)[0, 0] / rotor), friction[0] * s.dq[0], power


EXPECTED = {
    "3.4": of_3_4, "5.1": of_5_1, "5.2": of_5_2, "5.3": of_5_3, "5.4": of_5_4, "8.1.2": of_8_1_2, "8.1.3": of_8_1_3,
    "8.2": of_8_2, "8.3": of_8_3, "8.4": of_8_4, "8.5": of_8_5, "8.6": of_8_6, "8.7": of_8_7, "8.9": of_8_9,
}  # fmt: skip


def test_every_section_has_exercises():
    assert list(EXPECTED) == list(SECTIONS)


def some(name):
    """Sections for one arm; all but those of the planar arm are marked slow: the pages themselves are compared on the Panda."""
    return [
        pytest.param(s, name, id=f"{s}-{name}", marks=() if name == "planar_2r" else pytest.mark.slow) for s in SECTIONS
    ]


@pytest.mark.parametrize(("number", "name"), [*some("planar_2r"), *some("ur5"), *some("panda")])
def test_answers_are_those_of_the_library(tmp_path, number, name):
    """To 1e-8: energies are differentiated by steps of 1e-6, and M is inverted."""
    load = SECTIONS[number].load
    page = write_page(arm(name), tmp_path / "page.html", section=number)
    rng = np.random.default_rng(1)
    states = [State(name, rng, k, load) for k in range(3)]
    sent = {"section": number, "states": [s.sent for s in states], "mass": states[0].mass}
    found = under_node(page, ANSWER, sent | {"push": states[0].push.tolist()})
    for s, answers in zip(states, found, strict=True):
        expected = np.array(EXPECTED[number](s))
        np.testing.assert_allclose(answers, expected, rtol=1e-8, atol=1e-8 * max(1.0, np.abs(s.tau).max()))


def test_numbers_are_right_to_one_percent_as_people_type_them(tmp_path):
    page = write_page(arm("planar_2r"), tmp_path / "page.html", section="3.4")
    typed = ["1,25", " −3.5 ", "1e-3", "", "3 N", "12.1", "12.2", "0", "heavy", "1 2"]
    work = "(m, given) => given.map(typedNumber).concat([isRight(12.1, 12), isRight(12.2, 12), isRight(4e-4, 0), isRight(1e-3, 0)])"
    assert under_node(page, work, typed) == [
        1.25, -3.5, 1e-3, None, 3, 12.1, 12.2, 0, None, None, True, False, True, False,
    ]  # fmt: skip


def test_neighbours_are_links_and_absent_where_none_are_named():
    assert "8.1.2.html" not in viewer_page(arm("planar_2r"), section="8.1.3").page


def test_exercises_are_checked_in_a_browser(show):
    """A right and a wrong number by the keyboard; moving a slider takes the result back. On a phone a touched cell is read out."""
    page = show("exercises", arm("planar_2r"), section="8.1.3")
    answer = page.run("viewer.book.exercises.answer(0)")
    mass = arm("planar_2r").mass_matrix(page.run("Array.from(viewer.q)"))
    assert answer == pytest.approx(2 * mass[0, 0], rel=1e-12)
    check = """(x) => { const form = document.querySelector('#exercises form');
        form.querySelector('input').value = x; form.requestSubmit(); return form.querySelector('output').textContent; }"""
    assert page.run(f"({check})('{answer * 1.005}')") == "Right."
    assert page.run(f"({check})('{answer * 1.02}')") == "Not yet."
    assert page.run(f"({check})('{-answer}')").startswith("That is minus the answer.")
    assert page.run(f"({check})('heavy')") == "Type a number."
    slide = "const s = document.querySelector('#joints input'); s.value = Number(s.value) + 0.3; s.dispatchEvent(new Event('input'));"
    page.run(slide + "0")
    page.run("new Promise(requestAnimationFrame)")
    assert page.run("document.querySelector('#exercises output').textContent") == ""
    try:
        page.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=False)
        page.run("document.querySelectorAll('#values .heat td')[1].click()")
        assert page.run("document.querySelector('.touched').textContent").startswith("row 1, column 2: ")
        assert page.run("document.querySelector('.touched').getBoundingClientRect().height") > 0
    finally:
        page.call("Emulation.clearDeviceMetricsOverride")


def test_an_exercise_without_a_finite_answer_says_so(show):
    """Without torques no factor takes the largest of them to 100 N m, and no number is right."""
    page = show("endless_5.2", arm("planar_2r"), section="5.2")
    page.run("viewer.book.state.wrench.fill(0); viewer.set('wrench')")
    for text in ("1000", "0", "1e12"):
        said = page.run(
            f"(() => {{ const {{ rows }} = viewer.book.exercises; rows[1].field.value = '{text}'; viewer.book.exercises.check(1); return [rows[1].result.className, rows[1].result.textContent]; }})()"
        )
        assert said == ["wrong", "There is no finite answer here: move a joint or a slider."]
    assert page.complaints == []
