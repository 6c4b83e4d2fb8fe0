"""Payload, push and fall in a real Chromium, without a network: what the hand moves, the page computes."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw

pytest_plugins = ("page_fixtures",)

SLIDE = """(id, value) => {
    const slider = document.getElementById(id);
    slider.value = value;
    slider.dispatchEvent(new Event("input"));
    return Number(slider.value);
}"""


def slide(page, name: str, value: float) -> float:
    """Moves a slider; where it stands then, for it goes in steps."""
    return page.run(f"({SLIDE})({name!r}, {value})")


def held(page, robot, mass: float = 0.0, push=(0.0, 0.0, 0.0)):
    """The page's torques are the kernels' at its pose, and are what stands on it."""
    q, tau = np.array(page.run("viewer.q")), np.array(page.run("viewer.tau"))
    heavy = robot.with_payload(tw.SpatialInertia.from_com(mass)) if mass else robot
    R = robot.forward_kinematics(q)[:3, :3]
    expected = heavy.holding_torques(q, wrench_on_robot={robot.tip: [0, 0, 0, *(R.T @ push)]})
    np.testing.assert_allclose(tau, expected, atol=1e-12 * max(1.0, np.abs(expected).max()))
    texts = page.run("Array.from(document.querySelectorAll('#torques .number'), (e) => e.textContent)")
    shown = [float(text.split()[0].replace("\u2212", "-")) for text in texts]
    np.testing.assert_allclose(shown, expected, atol=0.0501)
    return tau


def test_torques_follow_joints_payload_and_push(show):
    robot = tw.robots.panda()
    page = show("panda_load", robot)
    first = held(page, robot)
    slide(page, "hand-1", 0.9)
    second = held(page, robot)
    assert np.abs(second - first).max() > 10
    mass = slide(page, "payload", 3.0)
    assert mass == pytest.approx(3.0)
    third = held(page, robot, mass)
    assert np.abs(third - second).max() > 10
    push = [slide(page, f"push-{axis}", x) for axis, x in zip("xyz", (30.0, -40.0, 50.0), strict=True)]
    fourth = held(page, robot, mass, push)
    assert np.abs(fourth - third).max() > 10
    slide(page, "hand-3", -1.8)
    held(page, robot, mass, push)
    assert page.run("Array.from(document.querySelectorAll('#load .number'), (e) => e.value)") == [
        "3 kg",
        "30 N",
        "−40 N",
        "50 N",
    ]
    assert page.complaints == []


def test_an_arm_let_go_falls_and_keeps_its_energy(show):
    """Three seconds of it in frames of a sixtieth; what one takes to compute is printed, not judged."""
    robot = tw.robots.panda()
    page = show("panda_fall", robot)
    slide(page, "hand-1", 0.9)
    q = page.run("viewer.q")
    page.run("document.getElementById('show-stops').click()")
    page.run("document.getElementById('let-go').click()")
    page.wait("viewer.fall.time > 0.05 && viewer.q[1] !== 0.9")
    assert page.run("document.getElementById('let-go').textContent") == "Stop"
    assert page.run("viewer.tau") == [0.0] * robot.nv
    spent, kinetic, drift, q_now, dq_now = page.run("""(() => {
        const spent = [];
        while (viewer.fall.time < 3) { viewer.fallOn(1 / 60); spent.push(viewer.fall.spent); }
        const { kinetic, drift, q, y } = viewer.fall;
        return [spent, kinetic, drift, q, Array.from(y.slice(7, 14))]; })()""")
    print(f"a frame of 1/60 s: median {np.median(spent):.2f} ms, 95 of 100 within {np.quantile(spent, 0.95):.2f} ms")
    assert drift < 1e-6
    energy = float(robot.kinetic_energy(q_now, dq_now))
    assert kinetic == pytest.approx(energy, rel=1e-12)
    start = float(robot.potential_energy(np.array(q)))
    assert energy + float(robot.potential_energy(np.array(q_now))) == pytest.approx(start, abs=1e-6)
    page.run("new Promise(requestAnimationFrame)")
    assert "kept to" in page.run("document.getElementById('fall').textContent")
    page.run("document.getElementById('let-go').click()")
    assert page.run("viewer.fall") is None
    held(page, robot)
    still = page.run("viewer.q")
    page.run("new Promise((done) => setTimeout(done, 200))")
    assert page.run("viewer.q") == still
    assert page.complaints == []


def test_a_slider_of_a_joint_catches_the_arm(show):
    robot = tw.robots.panda()
    page = show("panda_fall", robot)
    page.run("document.getElementById('let-go').click()")
    page.wait("viewer.fall.time > 0.02")
    slide(page, "payload", 2.0)
    assert page.run("!!viewer.fall")  # the payload does not
    slide(page, "hand-0", 0.5)
    assert page.run("[viewer.fall, viewer.q[0], document.getElementById('let-go').textContent]") == [
        None,
        0.5,
        "Let go",
    ]
    held(page, robot, 2.0)


def test_what_cannot_be_let_go_has_no_button(show):
    page = show("stone_fall", tw.load('<robot name="stone"><link name="stone"/></robot>'))
    assert page.run("document.getElementById('load').hidden")


@pytest.mark.parametrize("width", [1280, 420])
def test_the_controls_fit(show, width):
    page = show("panda_load", tw.robots.panda())
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=820, deviceScaleFactor=1, mobile=False)
    try:
        page.run("viewer.compact.set(false); document.getElementById('load').scrollIntoView()")
        page.run("document.getElementById('let-go').click()")
        page.wait("viewer.fall.time > 0.02")
        inside = """Array.from(document.querySelectorAll('#load, #load *')).every((e) => {
            const box = e.getBoundingClientRect();
            return box.left >= 0 && box.right <= innerWidth; })"""
        assert page.run(inside)
        assert page.run("document.getElementById('load').scrollWidth <= document.getElementById('load').clientWidth")
    finally:
        page.call("Emulation.clearDeviceMetricsOverride")
