"""The live page: served, opened in a real Chromium, moved by its sliders; ports that are taken, browsers that are not there."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
import time

import numpy as np
import pytest
from chromium import browser
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli import live_page as command
from twistwrench.cli.main import main
from twistwrench.motion.motion_log import MotionLog
from twistwrench.report.loaded_robot import LoadedRobot, Payload
from twistwrench.viz import LiveView, read_motion
from twistwrench.viz.sliders import slider_value, sliders_of, with_slider
from twistwrench.viz.torque_table import torque_table

pytest.importorskip("viser", reason="needs the extra viz")
ELBOW = [0, 0, np.pi / 2, 0, 0, 0]


@pytest.fixture(scope="module")
def demo():
    robot = tw.robots.ur5()
    load = LoadedRobot(robot, (Payload(5.0),))
    return read_motion(load, MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), robot.model))


@contextlib.contextmanager
def showing(robot, **options):
    view = LiveView(robot, port=0, **options)
    try:
        yield view
    finally:
        view.close()


def places(view):
    """Where the nodes of the scene are, (nbodies, 3)."""
    return np.array([view.nodes.bodies[k].position for k in range(len(view.robot.model.bodies))])


def test_nodes_are_where_the_links_are(bundled):
    robot = bundled("quadruped")
    with showing(robot) as view:
        for q in robot.random_configuration(0, 3):
            view.pose(q)
            np.testing.assert_allclose(places(view), view.nodes.scene.body_poses(q)[:, :3, 3], atol=1e-6)
            np.testing.assert_allclose(view.tau, robot.holding_torques(q))
            np.testing.assert_allclose(view.nodes.layers["com"][0].position, robot.center_of_mass(q), atol=1e-6)


def test_torques_have_arrows_as_long_as_their_share(bundled):
    robot = bundled("ur5")
    with showing(robot) as view:
        view.pose(ELBOW)
        shares = view.tau / robot.limits.effort
        for mark, node in view.nodes._marks:
            assert node.visible == (abs(shares[mark.torque]) > 0.004)
        mark, node = max(view.nodes._marks, key=lambda m: abs(shares[m[0].torque]))
        local = (node.vertices - mark.pose[:3, 3]) @ mark.pose[:3, :3]
        tip = local[-14:].mean(axis=0)
        sweep = np.arctan2(tip[1], tip[0]) * np.sign(shares[mark.torque])
        assert sweep == pytest.approx(5.4 * abs(shares[mark.torque]), abs=1e-4)


def test_the_ellipsoid_and_polytope_follow_the_tip(bundled):
    robot = bundled("ur5")
    q = np.array([0.3, -1.2, 1.3, -0.5, 0.4, 0.0])
    with showing(robot, q=q) as view:
        for layer in ("ellipsoid", "polytope"):
            assert not view.nodes.layers[layer]
            view.nodes.switch(layer, True)
        view.refresh()
        at, scale = robot.forward_kinematics(q)[:3, 3], view.nodes.force_scale
        corners = (view.nodes.layers["polytope"][0].vertices - at) / scale
        expected = tw.statics.wrench_polytope(robot, q).vertices
        np.testing.assert_allclose(corners, expected, atol=1e-3)
        shell = (view.nodes.layers["ellipsoid"][0].vertices - at) / scale
        A = tw.statics.wrench_ellipsoid(robot, q, limits=robot.limits.effort).matrix
        np.testing.assert_allclose(np.einsum("ij,jk,ik->i", shell, A, shell), 1.0, atol=1e-3)
        view.pose(
            robot.with_payload(tw.SpatialInertia.from_com(1.0)).neutral
        )  # outstretched: singular, nothing without end
        assert all(
            np.isfinite(n.vertices).all() for layer in ("ellipsoid", "polytope") for n in view.nodes.layers[layer]
        )


def test_the_motion_plays_and_begins_again(demo):
    with showing(demo.load.bare, motion=demo) as view:
        view.advance(1.0)
        assert view.time == 0.0  # it does not play yet
        view.playing, view.speed = True, 2.0
        view.advance(0.5)
        assert view.time == pytest.approx(1.0)
        q, tau = demo.at(1.0)
        np.testing.assert_array_equal(view.q, q)
        np.testing.assert_array_equal(view.tau, tau)
        assert "at 1.00 s" in view.torque_panel.content
        view.advance(2.75)
        assert view.time == pytest.approx(0.5)
        view.pose(view.q)
        assert not view.playing
        assert "hold this pose" in view.torque_panel.content


def test_sliders_reach_every_coordinate(bundled):
    for name in ("quadruped", "cart_pole", "panda"):
        robot = bundled(name)
        with showing(robot) as view:
            q = robot.random_configuration(4)
            view.pose(robot.neutral)
            for hand in sliders_of(robot.model):
                value = slider_value(hand, q)
                view.pose(with_slider(hand, view.q, np.radians(value) if hand["unit"] == "°" else value))
            np.testing.assert_allclose(robot.link_poses(view.q), robot.link_poses(q), atol=1e-9)


def test_a_slider_turns_the_base_about_its_axis_and_shows_by_how_much(bundled):
    robot = bundled("quadruped")
    turns = [hand for hand in sliders_of(robot.model) if "turn" in hand]
    assert [hand["turn"] for hand in turns] == [0, 1, 2]
    for hand, axis in zip(turns, np.eye(3), strict=True):
        q = with_slider(hand, robot.neutral, 0.3)
        R = robot.forward_kinematics(q, robot.link_names[0])[:3, :3]
        np.testing.assert_allclose(R, tw.so3.exp(0.3 * axis), atol=1e-12)
        assert slider_value(hand, q) == pytest.approx(np.degrees(0.3))


def test_bars_of_torques_go_the_way_of_their_signs(bundled):
    table = torque_table(bundled("planar_2r").model, "", *np.array([[3.0, -4.0], [0.5, -1.0], [0.5, -1.0]]))
    assert re.findall(r"left:([\d.]+)%;width:([\d.]+)%", table) == [("50.0", "25.0"), ("0.0", "50.0")]


def test_the_page_in_a_browser(demo):
    """Loads without a complaint and asks for nothing elsewhere; a slider moves the robot; the button plays."""
    with browser() as page, showing(demo.load.bare, motion=demo) as view:
        server = threading.Thread(target=_serve, args=(view,), daemon=True)
        server.start()
        page.open(view.url)
        page.wait("document.body.innerText.includes('Torques of the motion')", 60)
        assert page.wait("document.querySelectorAll('canvas').length > 0")
        before = page.run("document.body.innerText")
        assert "shoulder_lift" in before
        start = view.q.copy()
        box = "document.querySelectorAll('[role=slider]')[2].getBoundingClientRect()"  # after time and the first joint
        x, y = page.run(f"[{box}.x + {box}.width / 2, {box}.y + {box}.height / 2]")
        page.drag((x, y), (x + 4, y), (x + 8, y))
        _until(lambda: view.posed and view.q[1] > start[1] + 0.1)
        np.testing.assert_array_equal(np.delete(view.q, 1), np.delete(start, 1))
        page.wait("document.body.innerText.includes('Torques that hold this pose')")
        _until(lambda: f"{view.tau[1]:.2f}" in page.run("document.body.innerText"))
        np.testing.assert_allclose(places(view), view.nodes.scene.body_poses(view.q)[:, :3, 3], atol=1e-6)
        page.run("[...document.querySelectorAll('button')].find((b) => b.innerText.trim() === 'Play').click()")
        _until(lambda: view.playing and view.time > 0.3)
        page.wait("document.body.innerText.includes('Pause')")
        page.run("[...document.querySelectorAll('button')].find((b) => b.innerText.trim() === 'Pause').click()")
        _until(lambda: not view.playing)
        picture = page.picture().astype(int)
        assert picture[100:500, 100:900].std() > 5  # the robot and the floor, not an empty page
        assert page.complaints == []
        assert [u for u in page.requests if not u.startswith((view.url, "data:", "blob:", "ws:"))] == []


def _serve(view):
    with contextlib.suppress(Exception):  # the server is stopped under it
        view.serve()


def _until(true, seconds=30.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


# ── what can be in the way ──


@pytest.fixture
def taken():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def test_a_port_that_is_taken_is_named_with_another(taken, bundled):
    with pytest.raises(tw.ValueRangeError, match=rf"port {taken} of 127.0.0.1 cannot be used.*--port 0"):
        LiveView(bundled("pendulum"), port=taken)


@pytest.mark.parametrize("port", [-1, 65536, 10**9])
def test_ports_that_do_not_exist_are_refused(port, bundled):
    with pytest.raises(tw.ValueRangeError, match="does not exist"):
        LiveView(bundled("pendulum"), port=port)


def test_a_port_is_free_again_after_closing(bundled):
    with showing(bundled("pendulum")) as view:
        port = view.server.get_port()
    LiveView(bundled("pendulum"), port=port).close()


@pytest.fixture
def served(monkeypatch):
    """The views that the command served, each interrupted at once; no browser comes up."""
    views, opened = [], []

    def serve(view):
        views.append(view)
        raise KeyboardInterrupt

    monkeypatch.setattr(LiveView, "serve", serve)
    monkeypatch.setenv("BROWSER", "none")
    monkeypatch.setattr(command.webbrowser, "open", lambda url: opened.append(url) or True)
    return views, opened


def run(*arguments):
    return CliRunner().invoke(main, ["view", *map(str, arguments)])


def test_the_command_serves_until_interrupted(served):
    views, opened = served
    result = run("ur5", "--trajectory", "demo", "--payload", "5", "--port", "0")
    assert result.exit_code == 0, result.output
    assert opened == [views[0].url]
    assert f"ur5 at {views[0].url}" in result.stdout
    assert result.stdout.endswith("ended\n")
    assert views[0].motion.load.payloads[0].mass == 5.0


def test_no_browser_is_no_error_and_the_address_is_said(served, monkeypatch):
    def broken(_url):
        raise command.webbrowser.Error("none")

    monkeypatch.setattr(command.webbrowser, "open", broken)
    result = run("pendulum", "--port", "0")
    assert result.exit_code == 0
    assert f"no browser could be opened here. Open {served[0][0].url}" in result.stderr
    result = run("pendulum", "--port", "0", "--no-browser")
    assert "browser" not in result.stderr


@pytest.mark.skipif("not sys.platform.startswith('linux')", reason="asks how Linux shows windows")
def test_a_browser_in_the_terminal_is_none(served, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    assert "no browser could be opened" in run("pendulum", "--port", "0").stderr
    assert served[1] == []


def test_a_taken_port_that_was_asked_for_ends_before_anything_runs(served, taken):
    result = run("pendulum", "--port", taken)
    assert result.exit_code == 2
    assert f"port {taken}" in result.stderr
    assert served[0] == []


def test_the_usual_port_taken_gives_another(served, taken, monkeypatch):
    monkeypatch.setattr(command, "PORT", taken)
    result = run("pendulum")
    assert result.exit_code == 0
    assert f"port {taken} is taken, so another is used" in result.stderr
    assert str(taken) not in served[1][0]


def test_without_viser_the_extra_is_named(served, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    result = run("pendulum")
    assert result.exit_code == 2
    assert "twistwrench[viz]" in result.stderr
    assert "--html" in result.stderr


def test_zero_outside_the_limits_is_no_start(served):
    run("panda", "--port", "0")
    (view,) = served[0]
    limits = view.robot.limits
    assert ((view.q >= limits.lower) & (view.q <= limits.upper)).all()
