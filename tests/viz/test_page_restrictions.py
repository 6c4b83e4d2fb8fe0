"""The page where a browser allows less: no functions made of strings, nothing loaded, no WebGL."""

from __future__ import annotations

import re

import numpy as np
import pytest
from chromium import WITHOUT_WEBGL, browser

import twistwrench as tw
from twistwrench.core.colours import COLOURS, Style
from twistwrench.viz import write_page

pytest_plugins = ("page_fixtures",)


def test_the_page_runs_under_a_strict_policy_of_its_own(show, folder):
    """It forbids functions made of strings, scripts but its own two, and every request."""
    page = show("policy", tw.robots.ur5())
    assert page.run("viewer.tau.length") == 6
    text = (folder / "policy.html").read_text("utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    assert policy.count("sha256-") == 2
    refused = page.call("Runtime.evaluate", expression="new Function('return 1')()", allowUnsafeEvalBlockedByCSP=False)
    assert "Content Security Policy" in refused["exceptionDetails"]["exception"]["description"]
    added = """(() => { const script = document.createElement("script"); script.textContent = "window.intruder = 1";
        document.body.appendChild(script); return window.intruder === undefined; })()"""
    assert page.run(added)


def test_a_changed_script_does_not_run(page, folder):
    path = write_page(tw.robots.pendulum(), folder / "changed.html")
    path.write_text(path.read_text("utf-8").replace("const PROGRAMS", "window.changed = 1; const PROGRAMS"), "utf-8")
    page.open(path.as_uri())
    assert page.run("[typeof window.changed, typeof window.viewer]") == ["undefined", "undefined"]
    (folder / "empty.html").write_text("<!doctype html>", "utf-8")
    page.open((folder / "empty.html").as_uri())  # what this page complained of is heard before the next one
    page.run("new Promise((done) => setTimeout(done, 100))")


@pytest.fixture(scope="module")
def blind():
    with browser(WITHOUT_WEBGL) as found:
        found.offline()
        yield found


def test_without_webgl_the_page_says_so_and_goes_on(blind, folder):
    robot = tw.robots.panda()
    path = write_page(robot, folder / "blind.html")
    blind.open(path.as_uri())
    blind.wait("!!window.viewer")
    assert blind.run("document.createElement('canvas').getContext('webgl2')") is None
    assert blind.run("getComputedStyle(document.getElementById('undrawn')).display") != "none"
    assert "no WebGL 2" in blind.run("document.getElementById('undrawn').textContent")
    assert blind.run("document.getElementById('failure').hidden")
    before = blind.picture().astype(int)[:, :900]
    blind.run("viewer.setCoordinates(viewer.q.map((x, k) => k === 1 ? 0.9 : x))")
    blind.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    q = np.array(blind.run("viewer.q"))
    tau = robot.holding_torques(q)
    np.testing.assert_allclose(blind.run("viewer.tau"), tau, atol=1e-12 * np.abs(tau).max())
    assert (np.abs(blind.picture().astype(int)[:, :900] - before).sum(axis=2) > 20).sum() > 1000
    blind.run("document.getElementById('let-go').click()")
    blind.wait("viewer.fall.time > 0.05")
    assert blind.complaints == []


def test_the_tip_follows_the_mouse_within_the_limits(show):
    robot = tw.robots.panda()
    start = [0.3, -0.4, 0.0, -2.0, 0.0, 1.8, 0.5]
    page = show("panda_grasp", robot, q=start)
    x, y = page.run("viewer.stage.project(viewer.grasp.tip)")
    azimuth = page.run("viewer.stage.azimuth")
    page.drag((x, y), (x + 20, y + 10), (x + 40, y + 30))
    q = np.array(page.run("viewer.q"))
    assert page.run("viewer.stage.azimuth") == azimuth
    assert np.abs(q - start).max() > 0.01
    assert np.hypot(*(np.array(page.run("viewer.stage.project(viewer.grasp.tip)")) - [x + 40, y + 30])) < 3
    page.drag(page.run("viewer.stage.project(viewer.grasp.tip)"), (5, 5), (5, 790), (900, 400))
    q = np.array(page.run("viewer.q"))
    assert (q >= robot.limits.lower).all()
    assert (q <= robot.limits.upper).all()
    assert page.complaints == []


def test_the_view_turns_by_keys(show):
    page = show("panda_keys", tw.robots.panda())
    page.run("document.getElementById('stage').focus()")
    view = "[viewer.stage.azimuth, viewer.stage.elevation, viewer.stage.distance]"
    before = page.run(view)
    for key in ("ArrowRight", "ArrowDown", "+"):
        page.call("Input.dispatchKeyEvent", type="keyDown", key=key)
    azimuth, elevation, distance = page.run(view)
    assert azimuth < before[0]
    assert elevation > before[1]
    assert distance < before[2]
    page.call("Input.dispatchKeyEvent", type="keyDown", key="Home")
    assert page.run(view) == before


def test_what_rests_is_not_drawn_again_and_what_is_slow_is_drawn_coarsely(show):
    page = show("panda_rest", tw.robots.panda())
    page.run("new Promise((done) => setTimeout(done, 400))")
    page.run("var drawn = [], draw = viewer.draw; viewer.draw = (how) => { drawn.push(how); draw.call(viewer, how); }")
    page.run("new Promise((done) => setTimeout(done, 300))")
    assert page.run("drawn") == []
    page.run("document.getElementById('show-frames').click()")
    page.wait("drawn.length")
    frames = """(() => { const s = new Sharpness(), found = [];
        for (let k = 0; k <= 80; k++) found.push(s.at(40 * k, String(k)));
        return [...found, s.at(3241, "80"), s.at(3400, "80"), s.at(3440, "80")]; })()"""
    *slow, too_soon, rests, done = page.run(frames)
    assert [how["most"] for how in slow[::20]] == [2, 0.75, 0.5, 0.5, 0.5]  # at 25 frames a second
    assert (too_soon, rests["samples"], done) == (None, 4, None)
    fast = "(() => { const s = new Sharpness(); let how; for (let k = 0; k < 200; k++) how = s.at(16.7 * k, String(k)); return how.most; })()"
    assert page.run(fast) == 2


FRAMES = """(() => { window.frames_ = 0; const request = window.requestAnimationFrame;
    window.requestAnimationFrame = (work) => { window.frames_++; return request(work); }; })()"""


def frames_in(page, seconds):
    """Frames that the page requests in that time."""
    page.run("window.frames_ = 0")
    page.run(f"new Promise((done) => setTimeout(done, {1000 * seconds}))")
    return page.run("window.frames_")


def test_at_rest_no_frame_is_requested(show):
    """Neither at first, nor once a fall has ended; a change of the view or of the robot asks for frames again."""
    page = show("ur5_still", tw.robots.ur5())
    page.run(FRAMES)
    page.run("new Promise((done) => setTimeout(done, 500))")
    assert frames_in(page, 0.3) == 0
    page.run("document.getElementById('let-go').click()")
    assert page.wait("viewer.fall && viewer.fall.time > 0.05")
    page.run("(() => { while (!viewer.fall.rests && viewer.fall.time < 15) viewer.fallOn(1 / 120); })()")
    assert page.run("viewer.fall.rests")
    page.run("new Promise((done) => setTimeout(done, 500))")
    assert frames_in(page, 0.3) == 0
    assert page.run("document.getElementById('fall').textContent").startswith("At rest after")
    page.run("document.getElementById('stage').dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft' }))")
    assert page.wait("window.frames_ > 0")
    page.run("window.frames_ = 0; viewer.setCoordinates(viewer.robot.start)")
    assert page.wait("window.frames_ > 0")
    assert page.complaints == []


def test_a_torque_is_neutral_then_amber_then_red_and_of_another_shape(show):
    page = show("ur5_law", tw.robots.ur5())
    shares = [0.0, 0.5, 0.79, 0.85, 1.0, 1.1]
    seen = page.run(f"{shares}.map((share) => viewer.colour(0, share))")
    quiet, near, over = (list(COLOURS[style].scene) for style in (Style.QUIET, Style.NEAR, Style.OVER))
    assert seen == [quiet, quiet, quiet, near, near, over]
    kept = "(share) => { const items = []; viewer.shares = () => viewer.tau.map(() => share); viewer.torqueMarks(items); return items.map(({ kept }) => kept.count); }"
    below, beyond = page.run(f"({kept})(0.9)"), page.run(f"({kept})(1.1)")
    assert not set(below) & set(beyond)


def test_lost_graphics_are_said(show):
    page = show("panda_lost", tw.robots.panda())
    page.run("viewer.stage.gl.getExtension('WEBGL_lose_context').loseContext()")
    page.wait("!document.getElementById('failure').hidden")
    assert "Reload" in page.run("document.getElementById('failure').textContent")
