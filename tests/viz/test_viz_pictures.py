"""Motions, films and pictures of them: the numbers behind each, what is drawn, and what cannot be."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from page_files import read_page
from page_under_node import under_node
from quick import mostly_slow

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.answers.blocks import Style
from twistwrench.core.answers.page import MarkedJoint
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports import drawn_motion as motion_module
from twistwrench.viz import energies, film, motion_of, movie, plot_phase, plot_power, plot_split, read_motion, scene_of
from twistwrench.viz.pictures import robot_picture
from twistwrench.viz.plots.robot_picture import Camera, Painter, still

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

T = np.linspace(0.0, 2.0, 401)


def swing(robot, amplitude=0.5):
    """A smooth motion with its rates, (n, nv)."""
    w = 1.0 + 0.3 * np.arange(robot.nv)
    return (
        amplitude * np.sin(w * T[:, None]),
        amplitude * w * np.cos(w * T[:, None]),
        -amplitude * w**2 * np.sin(w * T[:, None]),
    )


@pytest.fixture(scope="module")
def demo():
    robot = tw.robots.ur5()
    load = LoadCase(robot, (Payload(5.0),))
    return read_motion(load, MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), robot.model))


# ── motions ──


def test_torques_of_a_motion_are_inverse_dynamics(bundled):
    robot = bundled("ur5")
    q, dq, ddq = swing(robot)
    motion = motion_of(robot, T, q, dq, ddq)
    expected = robot.inverse_dynamics(q, dq, ddq, friction=True)
    np.testing.assert_allclose(motion.torques, expected, atol=1e-12)
    np.testing.assert_allclose(motion.peaks, np.abs(expected).max(axis=0))


def test_rates_that_are_left_out_are_derived(bundled):
    robot = bundled("ur5")
    q, dq, ddq = swing(robot)
    inner = slice(20, -20)  # a spline is less sure at its ends
    for given, accuracy in (((), 1e-5), ((dq,), 1e-5)):
        motion = motion_of(robot, T, q, *given)
        np.testing.assert_allclose(motion.dq[inner], dq[inner], atol=accuracy)
        np.testing.assert_allclose(motion.ddq[inner], ddq[inner], atol=100 * accuracy)


def test_rates_of_a_floating_base_are_derived_though_its_quaternion_changes_sign(bundled):
    robot = bundled("floating_box")
    V = np.array([0.3, -0.2, 0.5, 0.1, 0.2, 0.3])
    q = np.stack([robot.add(robot.neutral, t * V) for t in T])
    q[200:, :4] *= -1
    motion = motion_of(robot, T, q)
    np.testing.assert_allclose(motion.dq[20:-20], np.tile(V, (361, 1)), atol=1e-6)
    between, _ = motion.at(float((T[199] + T[200]) / 2))
    expected = robot.forward_kinematics(robot.add(robot.neutral, (T[199] + T[200]) / 2 * V), "box")
    np.testing.assert_allclose(robot.forward_kinematics(between, "box"), expected, atol=1e-9)


def test_angles_that_wrap_are_no_motion():
    joint = '<joint name="wheel" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>'
    inertia = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    robot = tw.load(f'<robot name="wheel"><link name="a"/><link name="b">{inertia}</link>{joint}</robot>')
    turned = (4.0 * T[:, None] + np.pi) % (2 * np.pi) - np.pi
    motion = motion_of(robot, T, turned)
    np.testing.assert_allclose(motion.dq, 4.0, atol=1e-8)
    jump = int(np.argmin(np.diff(turned[:, 0])))
    given = motion_of(robot, T, turned, motion.dq, motion.ddq)  # taken as it is, and still played the short way
    q, _ = given.at(float((T[jump] + T[jump + 1]) / 2))
    assert np.cos(q[0] - 4.0 * (T[jump] + T[jump + 1]) / 2) == pytest.approx(1.0)


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_few_samples_are_poses_at_rest(bundled, rows):
    robot = bundled("planar_2r")
    q = np.full((rows, 2), 0.3)
    motion = motion_of(robot, np.arange(rows), q)
    np.testing.assert_allclose(motion.torques, robot.gravity_forces(q))
    np.testing.assert_array_equal(motion.at(0.0)[0], q[0])


def test_a_long_motion_is_thinned_and_its_peaks_kept(bundled, monkeypatch):
    monkeypatch.setattr(motion_module, "_MAX_STATES", 200)
    robot = bundled("ur5")
    q, dq, ddq = swing(robot)
    whole = robot.inverse_dynamics(q, dq, ddq, friction=True)
    motion = motion_of(robot, T, q, dq, ddq)
    assert 50 <= len(motion.time) <= 200
    assert motion.rows == 401
    np.testing.assert_allclose(motion.peaks, np.abs(whole).max(axis=0))
    kept = np.searchsorted(T, motion.time)
    np.testing.assert_allclose(motion.torques, whole[kept], atol=1e-12)
    assert (motion.time[0], motion.time[-1]) == (T[0], T[-1])


def test_a_file_in_many_chunks_is_thinned_and_keeps_evenly_spaced_states(demo, monkeypatch):
    monkeypatch.setattr(motion_module, "_MAX_STATES", 200)
    monkeypatch.setattr(motion_module, "_ROWS_PER_BATCH", 150)
    again = read_motion(
        demo.load, MotionLog.open(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), demo.load.robot.model)
    )
    assert 50 <= len(again.time) <= 200
    assert set(demo.time[::16]) <= set(
        again.time
    )  # 751 states, of which a quarter of 200 at most evenly spaced: every sixteenth
    np.testing.assert_allclose(again.peaks, demo.peaks)
    np.testing.assert_array_equal(np.abs(again.torques).max(axis=0), demo.peaks)


def test_a_spike_of_one_sample_is_drawn_at_its_height_and_its_width(bundled):
    robot = bundled("pendulum")
    t = np.arange(50_000) * 1e-3
    rest = np.zeros((len(t), 1))
    ddq = rest.copy()
    ddq[31_334] = 400.0
    motion = motion_of(robot, t, rest, rest, ddq)
    assert len(motion.time) < 17_000
    whole = robot.inverse_dynamics(rest, rest, ddq, friction=True)
    at = int(np.argmax(np.abs(motion.torques[:, 0])))
    assert motion.time[at] == t[31_334]
    assert motion.torques[at, 0] == whole[31_334, 0] == motion.peaks[0]
    np.testing.assert_allclose(motion.time[at - 1 : at + 2], t[31_333:31_336])


def test_coulomb_friction_at_rest_is_drawn_as_torques_counts_it(tmp_path):
    text = tw.robots.path_of("pendulum").read_text()
    text = re.sub(r"<dynamics[^>]*/>", "", text).replace("</joint>", '<dynamics friction="5"/></joint>', 1)
    (tmp_path / "r.urdf").write_text(text)
    robot = tw.load(tmp_path / "r.urdf")
    rng = np.random.default_rng(2)
    rows = np.column_stack([T, 0.3 + 1e-6 * rng.normal(size=len(T))])
    header = f"time,{robot.joint_names[0]}"
    np.savetxt(tmp_path / "m.csv", rows, delimiter=",", header=header, comments="")
    motion = read_motion(LoadCase(robot), MotionLog.open(tmp_path / "m.csv", robot.model))
    assert robot.model.friction.coulomb[0] == 5.0
    assert motion.still.mean() > 0.99  # 5 standard deviations of noise
    friction = motion.load.terms(motion.states)["friction"]
    assert np.abs(friction[motion.still]).max() < 1e-6
    np.testing.assert_allclose(sum(motion.load.terms(motion.states).values()), motion.torques, atol=1e-9)


@pytest.mark.parametrize(
    ("time", "q", "error", "words"),
    [
        ([0, 1], np.zeros((3, 2)), tw.ShapeError, "time"),
        ([[0, 1]], np.zeros((2, 2)), tw.ShapeError, "time"),
        ([0, 1], np.zeros((2, 3)), tw.ShapeError, "q"),
        ([], np.zeros((0, 2)), tw.ShapeError, "time"),
        ([0, 0], np.zeros((2, 2)), tw.ValueRangeError, "does not increase from sample 0"),
        ([0, np.nan], np.zeros((2, 2)), tw.ValueRangeError, "time"),
        ([0, 1], np.full((2, 2), np.inf), tw.ValueRangeError, "q"),
        ("later", np.zeros((2, 2)), tw.TwistWrenchError, "time"),
        ([0, 1], None, tw.TwistWrenchError, "q"),
    ],
)
def test_what_is_no_motion_is_refused(bundled, tmp_path, time, q, error, words):
    for call in (motion_of, lambda *a: movie(*a, tmp_path / "x.gif")):
        with pytest.raises(error, match=words):
            call(bundled("planar_2r"), time, q)
    assert not list(tmp_path.iterdir())


def test_each_limit_that_is_passed_is_a_sentence(bundled):
    robot = bundled("ur5")
    q, dq, ddq = swing(robot, 0.5)
    assert motion_of(robot, T, q, dq, ddq).warnings == ()
    assert any("too few" in said for said in motion_of(robot, T[:5], q[:5]).warnings)
    assert motion_of(robot, T[:5], q[:5], dq[:5], ddq[:5]).warnings == ()
    q, dq, ddq = swing(robot, 9.0)
    found = motion_of(robot, T, q, dq, ddq).warnings
    for kind in ("torque", "upper", "velocity"):
        assert any(f"{kind} limit" in sentence for sentence in found)
    worst = robot.model.velocity_names[int(np.argmax(np.abs(dq).max(axis=0) - robot.limits.velocity))]
    assert any(sentence.startswith(f"{worst} exceeds its velocity limit") for sentence in found)


def test_the_mirrored_motion_passes_the_same_limits():
    robot = tw.load(
        """<robot name="hinge"><link name="base"/>
        <link name="bar"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="hinge" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
        <limit lower="-0.5" upper="0.5" velocity="1" effort="4"/></joint></robot>"""
    )
    t = np.linspace(0, 1, 11)  # t³: all rates have one sign
    q, dq, ddq = t[:, None] ** 3, 3 * t[:, None] ** 2, 6 * t[:, None]
    ahead, back = (motion_of(robot, t, way * q, way * dq, way * ddq).warnings for way in (1, -1))
    for kind in ("torque limit by 2", "upper limit by 0.5", "velocity limit by 2"):
        assert sum(kind in said for said in ahead) == 1, ahead
    assert [said.replace("upper", "lower") for said in ahead] == [said for said in back if said], back


# ── energies and pictures ──


def test_work_less_friction_is_what_the_energies_gain(bundled):
    robot = bundled("ur5").with_actuators({"actuators": {"elbow_joint": {"friction": {"viscous": "8 N m s/rad"}}}})
    load = LoadCase(robot, (Payload(2.0),), {"tool0": np.array([0, 0, 0, 10.0, 0, 5.0])})
    q, dq, ddq = swing(robot)
    from twistwrench.motion.differentiation import MotionSamples

    states = MotionSamples(T, q, dq, ddq, q, np.zeros(q.shape, bool), np.zeros((len(T), 0)))
    e = energies(motion_module._read_states(load, iter([states])))
    gained = e.kinetic + e.potential - e.kinetic[0] - e.potential[0]
    assert np.ptp(e.friction) > 1
    assert np.ptp(e.wrenches) > 1
    # the trapezoidal rule: h²/12 times the span times the second derivative of power, some 1e4 W/s² here
    np.testing.assert_allclose(e.work - e.friction + e.wrenches, gained, atol=0.05)
    np.testing.assert_allclose(e.power, load.torques(states) * dq, atol=1e-9)


@pytest.mark.parametrize("draw", [plot_split, plot_power, plot_phase])
@pytest.mark.parametrize("name", mostly_slow(["cart_pole", "ur5", "floating_box", "pendulum"], 2))
def test_pictures_of_any_robot(bundled, tmp_path, draw, name):
    image = pytest.importorskip("matplotlib.image")
    robot = bundled(name)
    q, dq, ddq = swing(robot)
    full = np.stack([robot.add(robot.neutral, v) for v in q])
    path = draw(motion_of(robot, T, full, dq, ddq), tmp_path / "out.png")
    assert image.imread(path)[..., :3].std() > 0.02
    assert [p.name for p in tmp_path.iterdir()] == ["out.png"]


@pytest.mark.slow
def test_pictures_of_chosen_joints_are_smaller_and_unknown_ones_refused(demo, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    for draw in (plot_split, plot_phase):
        few = image.imread(draw(demo, tmp_path / "few.png", ["elbow_joint"])).size
        assert few < image.imread(draw(demo, tmp_path / "all.png")).size
        with pytest.raises(tw.UnknownNameError, match="Did you mean 'elbow_joint'"):
            draw(demo, tmp_path / "none.png", ["elbow"])
    assert not (tmp_path / "none.png").exists()


# ── films ──


def test_the_camera_sees_right_up_and_near():
    camera = Camera(np.zeros(3), 5.0, azimuth=-np.pi / 2, elevation=0.0)  # from -y
    points, away = camera.project([[1, 0, 0], [0, 0, 1], [0, -1, 0], [0, 1, 0]])
    np.testing.assert_allclose(points, [[1, 0], [0, 1], [0, 0], [0, 0]], atol=1e-12)
    np.testing.assert_allclose(away, [5, 5, 4, 6])


def test_the_painter_sorts_from_far_to_near_and_puts_shadows_on_the_floor(bundled):
    robot = bundled("ur5")
    scene = scene_of(robot)
    camera = Camera(np.array([0.3, 0, 0.3]), 4.0)
    painter = Painter(scene, camera, -0.1)
    q = np.array([0.3, -1.2, 1.3, -0.5, 0.4, 0.0])
    triangles, colours = painter.paint(q)
    assert triangles.shape[1:] == (3, 2)
    assert colours.shape == (len(triangles), 4)
    corners = np.concatenate(
        [
            s.surface.placed(s.pose if s.body < 0 else scene.body_poses(q)[s.body] @ s.pose).vertices
            for s in scene.shapes
            if s.layer == "looks"
        ]
    )
    seen, _ = camera.project(corners)
    low, high = triangles.reshape(-1, 2).min(axis=0), triangles.reshape(-1, 2).max(axis=0)
    assert (low <= seen.min(axis=0) + 1e-9).all()
    assert (high >= seen.max(axis=0) - 1e-9).all()


def frames_of(path):
    image = pytest.importorskip("PIL.Image")
    with image.open(path) as film_:
        found = []
        for k in range(film_.n_frames):
            film_.seek(k)
            found.append(np.asarray(film_.convert("RGB"), int))
        return found, film_.info["duration"]


def test_a_film_shows_the_robot_move(bundled, tmp_path):
    pytest.importorskip("matplotlib")
    robot = bundled("planar_2r")
    t = np.linspace(0, 1, 21)
    told = []
    path = movie(robot, t, np.outer(t, [1.5, -1.0]), tmp_path / "arm.gif", fps=5, progress=lambda *x: told.append(x))
    frames, duration = frames_of(path)
    assert len(frames) == 6
    assert duration == 200  # ms
    assert told == [(k, 6) for k in range(1, 7)]
    assert frames[0].shape == (450, 800, 3)
    for one, other in itertools.pairwise(frames):
        assert (np.abs(one - other)[:, :500].sum(axis=2) > 60).mean() > 0.005
    assert [p.name for p in tmp_path.iterdir()] == ["arm.gif"]


def test_speed_makes_films_shorter(bundled, tmp_path):
    pytest.importorskip("matplotlib")
    t = np.linspace(0, 1, 11)
    q = np.sin(t)[:, None]
    frames, _ = frames_of(movie(bundled("pendulum"), t, q, tmp_path / "a.gif", fps=8, speed=4))
    assert len(frames) == 3


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_a_film_as_mp4(bundled, tmp_path):
    pytest.importorskip("matplotlib")
    t = np.linspace(0, 0.5, 11)
    path = movie(bundled("pendulum"), t, np.sin(t)[:, None], tmp_path / "a.mp4", fps=10)
    assert path.read_bytes()[4:8] == b"ftyp"


def test_mp4_without_ffmpeg_is_refused_before_anything_is_drawn(bundled, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(tw.MissingExtraError, match=r"needs the program ffmpeg.*\.gif"):
        movie(bundled("pendulum"), [0, 1], [[0], [1]], tmp_path / "a.mp4")


@pytest.mark.parametrize(
    ("options", "words"),
    [({"fps": 0}, "fps"), ({"fps": np.nan}, "fps"), ({"speed": -1}, "speed"), ({"fps": 1e6}, "more than 2000")],
)
def test_films_that_cannot_be_are_refused(bundled, tmp_path, options, words):
    pytest.importorskip("matplotlib")
    with pytest.raises(tw.ValueRangeError, match=words):
        movie(bundled("pendulum"), [0, 1], [[0], [1]], tmp_path / "a.gif", **options)
    with pytest.raises(tw.ValueRangeError, match=r"Choose one of \.gif, \.mp4"):
        movie(bundled("pendulum"), [0, 1], [[0], [1]], tmp_path / "a.avi")
    assert not list(tmp_path.iterdir())


def test_an_interrupted_film_leaves_the_old_one(demo, tmp_path):
    pytest.importorskip("matplotlib")

    def enough(done, _of):
        if done == 2:
            raise KeyboardInterrupt

    path = tmp_path / "a.gif"
    path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt):
        film(demo, path, fps=1, progress=enough)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


# ── the shell ──


def run(*arguments):
    return CliRunner().invoke(main, list(map(str, arguments)))


def test_the_shell_writes_pages(tmp_path):
    out = tmp_path / "page.html"
    wrench = "tool0:0,0,0,0,0,-20"
    result = run("view", "ur5", "--trajectory", "demo", "--payload", 5, "--wrench-on-robot", wrench, "--html", out)
    assert result.exit_code == 0, result.output
    assert result.stdout == f"wrote {out}\n"
    header, arrays = read_page(out)
    assert len(arrays["time"]) == 751
    assert header["wrenches"][0]["force"] == [0.0, 0.0, -20.0]
    result = run("view", "panda", "--lock", "panda_joint1=0.3", "--html", out)
    assert result.exit_code == 0, result.output
    assert len(read_page(out)[0]["hands"]) == 6


def test_friction_is_in_the_torques_unless_it_is_left_out(tmp_path):
    text = re.sub(r"<dynamics[^>]*/>", "", tw.robots.path_of("pendulum").read_text())
    (tmp_path / "r.urdf").write_text(text.replace("</joint>", '<dynamics damping="5"/></joint>', 1))
    robot = tw.load(tmp_path / "r.urdf")
    q, dq, ddq = swing(robot)
    name = robot.joint_names[0]
    header = f"time,{name},{name}.vel,{name}.acc"
    np.savetxt(tmp_path / "m.csv", np.column_stack([T, q, dq, ddq]), delimiter=",", header=header, comments="")
    for flags, friction in (([], 5.0 * dq), (["--no-friction"], 0.0)):
        page = tmp_path / "a.html"
        done = run("view", tmp_path / "r.urdf", "--trajectory", tmp_path / "m.csv", "--html", page, *flags)
        assert done.exit_code == 0, done.output
        wanted = robot.inverse_dynamics(q, dq, ddq) + friction
        found = under_node(page, "(m, given, motion) => motion.tau")
        np.testing.assert_allclose(np.reshape(found, (-1, 1)), wanted, atol=1e-9)


def test_the_shell_films_and_draws(tmp_path):
    pytest.importorskip("matplotlib")
    result = run("view", "ur5", "--trajectory", "demo", "--movie", tmp_path / "a.gif", "--speed", 60)
    assert result.exit_code == 0, result.output
    kinds = ("torques", "causes", "power", "phase")
    for kind in kinds:
        joint = ("--joint", "elbow_joint") if kind in ("causes", "phase") else ()
        result = run("torques", "ur5", "demo", "--payload", 5, *joint, "--kind", kind, "--plot", tmp_path / kind)
        assert result.exit_code == 0, result.output
    assert all((tmp_path / f"{kind}.png").is_file() for kind in kinds)


def test_the_shell_tells_of_limits_that_are_passed(tmp_path):
    result = run("view", "ur5", "--trajectory", "demo", "--payload", 12, "--html", tmp_path / "a.html")
    assert result.exit_code == 0
    assert "note: shoulder_lift_joint exceeds its torque limit by" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("view", "ur5", "--movie", "a.gif"), "--movie films a motion, and there is none"),
        (("view", "ur5", "--trajectory", "demo", "--movie", "a.avi"), "Choose one of .gif, .mp4"),
        (("view", "ur5", "--html", "."), "is a folder"),
        (("view", "ur5", "--html", "nowhere/a.html"), "no such folder"),
        (("view", "ur5", "--trajectory", "none.csv", "--html", "a.html"), "no motion file"),
        (("view", "ur5", "--trajectory", "demo", "--degrees", "--html", "a.html"), "is in radians"),
        (("view", "ur5", "--wrench-on-robot", "nose:0,0,0,0,0,1", "--html", "a.html"), "no frame named 'nose'"),
        (("view", "ur5", "--payload", "heavy", "--html", "a.html"), "payload 'heavy': expected MASS"),
        (("view", "ur6", "--html", "a.html"), "no bundled robot of that name"),
        (("torques", "ur5", "--trajectory", "demo", "--kind", "causes", "--plot", "a.jpg"), "Choose one of .png"),
        (
            ("torques", "ur5", "--trajectory", "demo", "--kind", "phase", "--plot", "a.png", "--joint", "x"),
            "no joint named 'x'",
        ),
        (
            ("torques", "ur5", "--trajectory", "demo", "--kind", "power", "--plot", "a.png", "--joint", "elbow_joint"),
            "Add one of them",
        ),
        (("torques", "ur5", "--trajectory", "demo", "--kind", "art", "--plot", "a.png"), "'torques', 'causes'"),
        (("torques", "ur5", "--trajectory", "demo", "--plot", "power=a.png"), "--plot a.png --kind power"),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_file(tmp_path, monkeypatch, arguments, words):
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_outputs_never_overwrite_inputs(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_bytes(tw.robots.path_of("pendulum").read_bytes())
    result = run("view", path, "--html", path)
    assert result.exit_code == 2
    assert "would overwrite" in result.stderr


def test_what_is_heavy_is_left_for_later():
    code = "import sys, twistwrench.viz, twistwrench.cli.main; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"trimesh", "matplotlib", "scipy", "PIL", "llvmlite"} & {
        m.partition(".")[0] for m in done.stdout.split()
    }


def test_without_a_file_the_page_is_written_and_opened(monkeypatch):
    opened = []
    monkeypatch.setenv("BROWSER", "some")
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    result = run("view", "pendulum")
    page = Path(result.stdout.removeprefix("wrote ").strip())
    assert result.exit_code == 0
    assert opened == [page.as_uri()]
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_curves_of_a_page_have_the_places_of_the_picture(tmp_path):
    """To a hundredth of a point: steps from place to place add up to the same, over 2000 of them."""
    import matplotlib

    from twistwrench.viz.style import figure, page_svg, save

    x = np.linspace(0.0, 9.0, 2000)
    picture = tmp_path / "curve.svg"

    def plot(path):
        with figure(4, 3, "curve") as drawn:
            drawn.add_subplot().plot(x, np.sin(7 * x) * x)
            save(drawn, path)

    with matplotlib.rc_context({"path.simplify_threshold": 0.5}):  # as in pages
        plot(picture)
    longest = max(re.findall(r' d="([^"]*)"', picture.read_text("utf-8")), key=len)
    there = np.array(re.findall(r"[ML] (\S+) (\S+)", longest), float)
    written = max(re.findall(r' d="([^"]*)"', page_svg(plot)), key=len)
    begin, steps = re.fullmatch(r"M(.*?)l(.*)", written).groups()
    numbers = re.compile(r"-?(?:\d+\.?\d*|\.\d+)")
    here = np.cumsum([[float(v) for v in numbers.findall(part)] for part in (begin, *pairs(steps))], axis=0)
    np.testing.assert_allclose(here, there[: len(here)], atol=0.011)
    assert len(written) < 0.7 * len(longest)


def pairs(steps):
    numbers = re.findall(r"-?(?:\d+\.?\d*|\.\d+)", steps)
    return [f"{x} {y}" for x, y in zip(numbers[::2], numbers[1::2], strict=True)]


def test_without_a_browser_the_path_is_printed(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("webbrowser.open", lambda _url: False)
    result = run("view", "pendulum")
    assert result.exit_code == 0
    assert "Open the file in one" in result.stderr
    assert Path(result.stdout.removeprefix("wrote ").strip()).exists()
    assert run("view", "pendulum", "--no-browser").stderr == ""


@pytest.mark.parametrize("mark", [Style.OVER, Style.POINTED])
def test_a_marked_joint_has_the_colour_that_the_caption_names(mark):
    robot, q = tw.robots.planar_2r(), [0.3, 0.5]
    found = robot_picture(robot, q, MarkedJoint("joint2", "joint2, 111 % of its limit", mark), "planar_2r")
    wanted = {
        style: still(robot, q, "joint2", "joint2, 111 % of its limit", mark=style)
        for style in (Style.OVER, Style.POINTED)
    }
    assert found.content == wanted[mark] and wanted[Style.OVER] != wanted[Style.POINTED]
