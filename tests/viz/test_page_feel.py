"""Links that are pulled, and drives that hold as far as they can, in a real Chromium."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw

pytest_plugins = ("page_fixtures",)
LEVEL = [0.0, 0.0, 0.0, -np.pi / 2, np.pi / 2, 0.0]
PULL = """(() => { const { held } = viewer.grab, q = viewer.q;
    return { q, body: viewer.robot.bodies[held.body].name, p: viewer.grab.at(q), f: viewer.grab.force(q), tau: viewer.tau, k: held.k, target: held.target }; })()"""

FOREARM = """(() => { const { body, middle } = viewer.robot.fall.spheres.find(({ body }) => viewer.robot.bodies[body].name === 'forearm_link');
    const T = viewer.poses[body]; return viewer.stage.project(add(place(T), turn(T, middle))); })()"""


def press(page, kind, x, y):
    """Mouse with Ctrl held down."""
    page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1, modifiers=2)


def pulled(page, away=(40.0, -30.0)):
    """Takes hold of the forearm and pulls; what the page then has. A forearm that falls may have moved on before the press."""
    for _ in range(10):
        x, y = page.run(FOREARM)
        press(page, "mousePressed", x, y)
        if page.run("viewer.grab.held !== null"):
            break
        press(page, "mouseReleased", x, y)
    press(page, "mouseMoved", x + away[0], y + away[1])
    return page.run(PULL), (x, y)


def test_a_link_is_pulled_by_a_spring_and_torques_follow(show):
    """Those of inverse dynamics with the same wrench on the link, to 1e-9; a third of the view is the robot's weight."""
    robot = tw.robots.ur5()
    page = show("ur5_pull", robot)
    seen, (x, y) = pulled(page)
    q, f = np.array(seen["q"]), np.array(seen["f"])
    T = robot.forward_kinematics(q, seen["body"])
    r, turned = T[:3, :3].T @ (np.array(seen["p"]) - T[:3, 3]), T[:3, :3].T @ f
    wrench = {seen["body"]: [*np.cross(r, turned), *turned]}
    expected = robot.inverse_dynamics(q, np.zeros(6), np.zeros(6), wrench_on_robot=wrench)
    np.testing.assert_allclose(seen["tau"], expected, atol=1e-9)
    np.testing.assert_allclose(f, seen["k"] * (np.array(seen["target"]) - seen["p"]), atol=1e-9)
    metre = page.run("viewer.stage.metre(viewer.grab.at(viewer.q))")
    third = page.run("viewer.stage.canvas.clientHeight") / 3 / metre
    assert seen["k"] * third == pytest.approx(9.81 * page.run("viewer.robot.moving"), rel=0.2)
    page.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert page.run("document.getElementById('pull').textContent").endswith(" N")
    press(page, "mouseReleased", x + 40, y - 30)
    assert page.run("viewer.grab.held") is None
    np.testing.assert_allclose(page.run("viewer.tau"), robot.holding_torques(q), atol=1e-12)
    assert page.complaints == []


def test_a_robot_let_go_follows_the_pull(show):
    page = show("ur5_pull", tw.robots.ur5())
    page.run("document.getElementById('show-drives').click(); document.getElementById('let-go').click()")
    page.wait("viewer.fall && viewer.fall.time > 0.02 && !viewer.glide")
    seen, _ = pulled(page, (0.0, -90.0))
    page.run("(() => { for (let k = 0; k < 60; k++) viewer.fallOn(1 / 120); })()")
    after = page.run(PULL)
    assert np.linalg.norm(np.subtract(after["target"], after["p"])) < np.linalg.norm(
        np.subtract(seen["target"], seen["p"])
    )
    assert page.complaints == []


@pytest.mark.parametrize(("mass", "holds"), [(0.0, True), (14.0, False)])
def test_drives_hold_within_their_limits_and_slip_beyond(show, mass, holds):
    robot = tw.robots.ur5()
    page = show("ur5_drives", robot)
    page.run("viewer.drives && viewer.stop()")
    if not page.run("viewer.shown.drives"):
        page.run("document.getElementById('show-drives').click()")
    page.run(f"viewer.mechanics.mass = {mass}; viewer.setCoordinates({LEVEL})")
    heavy = robot.with_payload(tw.SpatialInertia.from_com(mass)) if mass else robot
    needs = abs(heavy.holding_torques(np.array(LEVEL))[1])
    page.run("document.getElementById('let-go').click()")
    assert page.wait("viewer.fall")
    told = page.run("(() => { viewer.panel.update(); return document.getElementById('fall').textContent; })()")
    limit = robot.limits.effort[1]
    assert (needs <= limit) == holds
    if not holds:
        assert f"shoulder_lift_joint slips: needs {needs:.3g}, has {limit:.4g} N m" in told
        assert page.run("[...viewer.over]") == [1]
    page.run("(() => { for (let k = 0; k < 120; k++) viewer.fallOn(1 / 120); })()")
    sag, tau = abs(page.run("viewer.q")[1]), np.abs(page.run("viewer.tau"))
    assert (sag < 0.01) == holds
    assert (sag > 0.3) != holds
    assert (tau <= robot.limits.effort * (1 + 1e-12)).all()
    assert page.complaints == []


def touch(page, kind, *points):
    """Fingers on the screen; those that are lifted are left out."""
    page.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y} for x, y in points])


def test_a_long_press_on_a_phone_pulls_a_link_and_a_short_one_turns_the_view(show):
    page = show("ur5_touch", tw.robots.ur5())
    page.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    page.call("Emulation.setTouchEmulationEnabled", enabled=True)
    try:
        page.wait("innerWidth === 390 && viewer.stage.canvas.matches('.compact *')")
        frames = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        page.run(frames)
        x, y = page.run(FOREARM)
        azimuth = page.run("viewer.stage.azimuth")
        touch(page, "touchStart", (x, y))
        touch(page, "touchMove", (x + 30, y))
        assert page.run("viewer.grab.held") is None
        touch(page, "touchEnd")
        assert page.run("viewer.stage.azimuth") != azimuth
        x, y = page.run(FOREARM)
        touch(page, "touchStart", (x, y))
        page.wait("viewer.grab.held")
        turned = page.run("viewer.stage.azimuth")
        touch(page, "touchMove", (x + 40, y - 30))
        page.run(frames)
        seen = page.run(PULL)
        assert seen["body"] == "forearm_link"
        pull = np.linalg.norm(seen["f"])
        assert pull == pytest.approx(seen["k"] * np.linalg.norm(np.subtract(seen["target"], seen["p"])), rel=1e-9)
        shown = page.run("document.getElementById('pull').textContent")
        assert shown.endswith(" N")
        assert float(shown.removesuffix(" N")) == pytest.approx(pull, rel=5e-3)
        assert page.run("viewer.stage.azimuth") == turned
        touch(page, "touchEnd")
        page.run(frames)
        assert page.run("[viewer.grab.held, document.getElementById('pull').hidden]") == [None, True]
        assert page.complaints == []
    finally:
        page.call("Emulation.setTouchEmulationEnabled", enabled=False)
        page.call("Emulation.clearDeviceMetricsOverride")


def test_a_pull_at_a_link_counts_against_its_drives(show):
    """What a drive needs to stand still under the pull is that of inverse dynamics with the same force; so much slips."""
    robot = tw.robots.ur5()
    page = show("ur5_pull", robot)
    seen, (x, y) = pulled(page)
    many = 2000.0
    slipping = page.run(
        f"new Drives(viewer.mechanics, viewer.q).slipping(viewer.q, viewer.grab.torques(viewer.q).map((x) => {many} * x))"
    )
    press(page, "mouseReleased", x + 40, y - 30)
    q = np.array(seen["q"])
    T = robot.forward_kinematics(q, seen["body"])
    r, turned = T[:3, :3].T @ (np.array(seen["p"]) - T[:3, 3]), many * T[:3, :3].T @ np.array(seen["f"])
    needs = robot.holding_torques(q, wrench_on_robot={seen["body"]: [*np.cross(r, turned), *turned]})
    assert slipping
    for joint in slipping:
        assert joint["needs"] == pytest.approx(needs[joint["k"]], rel=1e-6)


def test_without_limits_there_are_no_drives(show):
    page = show("two_r", tw.robots.planar_2r())
    assert page.run("document.getElementById('show-drives')") is None


def test_a_slow_computer_is_told_by_how_much_it_is_slower(show):
    page = show("ur5_slow", tw.robots.ur5())
    page.run("window.clock_ = 0; performance.now = () => (window.clock_ += 3)")
    page.run("document.getElementById('let-go').click()")
    pace, told = page.run(
        "(() => { for (let k = 0; k < 60; k++) viewer.fallOn(1 / 30); return [viewer.fall.pace, document.getElementById('fall').textContent]; })()"
    )
    assert pace < 0.95
    assert told.endswith(f"· {pace:.1f} × real time")
