"""The page in one file: nothing from outside, and in it the robot, its shapes and its motion to the digit."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from page_files import read_page

import twistwrench as tw
from twistwrench.mechanics.lie import se3
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.viz import motion_of, read_motion, scene_of, write_page
from twistwrench.viz.page import viewer_page

MIMIC = """<robot name="m"><link name="base"/>
<link name="a"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="c"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="slide" type="planar"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>
<joint name="lead" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0.3 0.2 0.1"/><axis xyz="1 1 0"/></joint>
<joint name="follow" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="5" velocity="1"/><mimic joint="lead" multiplier="-0.5" offset="0.2"/></joint></robot>"""


def robots():
    """Every kind of joint: turning, sliding, screwing, planar, floating, following, with rotors and springs."""
    ur5 = tw.robots.ur5()
    yield "ur5", ur5
    yield "quadruped", tw.robots.quadruped()
    yield "planar and mimic", tw.load(MIMIC)
    S = [[0, 0, 1, 0, -0.2, 0.05], [1, 0, 0, 0, 0.5, 0]]
    G = [tw.SpatialInertia.from_com(1.0, (0.1, 0, 0), 0.1 * np.eye(3)).matrix] * 2
    yield (
        "helical",
        tw.from_screws(
            M=None, Slist=np.array(S).T, Mlist=[np.eye(4), se3.pose(np.eye(3), [0.2, 0, 0.5]), np.eye(4)], Glist=G
        ),
    )
    motors = {
        "joint1": {
            "ratio": 100,
            "rotor": {"inertia": "2 kg cm^2", "mass": "0.3 kg", "extra": True},
            "stiffness": "900 N m/rad",
        }
    }
    yield "elastic", tw.robots.planar_2r().with_actuators({"actuators": motors})


ROBOTS = dict(robots())


@pytest.fixture(scope="module")
def demo():
    robot = tw.robots.ur5()
    load = LoadCase(robot, (Payload(5.0),), {"tool0": np.array([0, 0, 1.0, 0, 0, -20.0])})
    path = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    return read_motion(load, MotionLog.open(path, robot.model))


def test_a_motion_is_in_the_page_to_the_bit(tmp_path, demo):
    header, arrays = read_page(write_page(demo.load.robot, tmp_path / "page.html", motion=demo))
    np.testing.assert_array_equal(arrays["time"], demo.time)
    for name, values in {"q": demo.q, "dq": demo.dq, "ddq": demo.ddq}.items():
        np.testing.assert_array_equal(arrays[name].reshape(-1, 6), values)
    assert [t["limit"] for t in header["torques"]] == demo.load.robot.limits.effort.tolist()
    assert header["motion"]["mass"] == 5.0
    assert header["wrenches"] == [{"frame": header["tip"], "moment": [0, 0, 1.0], "force": [0, 0, -20.0]}]


def test_the_page_needs_nothing_from_outside(tmp_path, demo):
    text = write_page(demo.load.robot, tmp_path / "page.html", motion=demo).read_text("utf-8")
    without_data = re.sub(r'<script id="data".*?</script>', "", text, flags=re.DOTALL)
    assert not re.search(
        r"https?:|//[a-z]+\.|\bimport\b(?! (?:numpy as np|twistwrench as tw)\b)|@import|fetch\(|XMLHttpRequest|WebSocket|<link(?! rel=\"icon\" href=\"data:)|src=",
        without_data,
    )
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]


def test_a_name_that_is_markup_stays_a_name(tmp_path):
    robot = tw.load('<robot name="&lt;/script&gt;&lt;b&gt;$x"><link name="a"/></robot>')
    text = write_page(robot, tmp_path / "page.html").read_text("utf-8")
    assert "<title>&lt;/script&gt;&lt;b&gt;$x</title>" in text
    assert text.count("</script>") == 3


def test_shapes_come_out_as_they_went_in(tmp_path):
    """Vertices lie on a grid of 65535 steps along each side of their box."""
    import base64
    import zlib

    robot = ROBOTS["ur5"]
    scene = scene_of(robot)
    text = viewer_page(robot, scene=scene).page
    header, _ = read_page(_written(tmp_path, text))
    raw = zlib.decompress(base64.b64decode(re.search(r'octet-stream">(.*?)</script>', text, re.DOTALL).group(1)))
    start = 8 + -(-int.from_bytes(raw[:4], "little") // 8) * 8
    assert len(header["shapes"]) == len(scene.shapes)
    for shown, shape in zip(header["shapes"], scene.shapes, strict=True):
        s = header["surfaces"][shown["surface"]]
        grid = np.frombuffer(raw, "<u2", s["vertices"]["count"], start + s["vertices"]["at"]).reshape(-1, 3)
        faces = np.frombuffer(raw, f"<{s['faces']['kind']}", s["faces"]["count"], start + s["faces"]["at"]).reshape(
            -1, 3
        )
        found = (np.array(s["low"]) + grid * np.array(s["step"]))[faces]
        expected = shape.surface.vertices[shape.surface.faces]
        np.testing.assert_allclose(found, expected, atol=float(np.max(s["step"])))
        np.testing.assert_array_equal(np.reshape(shown["pose"], (4, 4)), shape.pose)


def _written(folder, text):
    path = folder / "text.html"
    path.write_text(text, "utf-8")
    return path


def test_limits_that_are_passed_are_in_the_verdict_and_not_in_the_notes(tmp_path):
    robot = tw.robots.ur5()
    t = np.linspace(0, 1, 50)
    q = np.outer(7.0 * t, [1, 0, 0, 0, 0, 0])
    motion = motion_of(robot, t, q)
    assert any("shoulder_pan_joint exceeds its upper limit by 0.717" in w for w in motion.warnings)
    header, _ = read_page(write_page(robot, tmp_path / "page.html", motion=motion))
    assert not set(motion.passed) & set(header["notes"])
    assert [(e["joint"], e["kind"]) for e in header["motion"]["verdict"]["passed"]] == [("shoulder_pan_joint", "upper")]


@pytest.mark.parametrize(
    ("robot", "said"),
    [(tw.robots.pendulum, "1 degree of freedom, 1 kg"), (tw.robots.planar_2r, "2 degrees of freedom, 2 kg")],
)
def test_the_subtitle_counts_degrees_of_freedom_and_what_moves(robot, said, tmp_path):
    assert read_page(write_page(robot(), tmp_path / "page.html"))[0]["subtitle"].startswith(f"{said} moving")


def test_a_motion_of_another_robot_is_refused(demo, tmp_path):
    with pytest.raises(tw.ValueRangeError, match="the motion is of robot 'ur5', and the one to be shown is 'panda'"):
        write_page(tw.robots.panda(), tmp_path / "page.html", motion=demo)
    assert not any(tmp_path.iterdir())


def test_wrenches_are_in_the_page_with_their_arrows(tmp_path, bundled):
    wrench = {"tip": [0.0, 1.0, 0.0, 3.0, 0.0, 4.0]}
    header, _ = read_page(write_page(bundled("planar_2r"), tmp_path / "a.html", wrench_on_robot=wrench))
    assert header["wrenches"] == [{"frame": header["tip"], "moment": [0.0, 1.0, 0.0], "force": [3.0, 0.0, 4.0]}]
    moment, force = header["wrenchMarks"]
    assert (moment["turns"], force["turns"]) == (True, False)
    np.testing.assert_allclose(np.reshape(force["pose"], (4, 4))[:3, 2], [0.6, 0, 0.8])
    with pytest.raises(tw.UnknownNameError, match="frame"):
        write_page(bundled("planar_2r"), tmp_path / "b.html", wrench_on_robot={"tpi": np.zeros(6)})
    with pytest.raises(tw.ShapeError, match="tip"):
        write_page(bundled("planar_2r"), tmp_path / "b.html", wrench_on_robot={"tip": np.zeros(5)})
    assert not (tmp_path / "b.html").exists()


@pytest.mark.parametrize("q", [np.zeros(3), [np.nan, 0], [[0, 0]], "ab", None.__class__])
def test_a_start_that_is_no_configuration_is_refused(tmp_path, bundled, q):
    with pytest.raises(tw.TwistWrenchError):
        write_page(bundled("planar_2r"), tmp_path / "page.html", q=q)
    assert not list(tmp_path.iterdir())


def test_an_old_page_stays_where_a_new_one_cannot_be_written(tmp_path, bundled):
    with pytest.raises(tw.ValueRangeError, match="No such"):
        write_page(bundled("planar_2r"), tmp_path / "nowhere" / "page.html")
    with pytest.raises(tw.ValueRangeError, match="is a folder"):
        write_page(bundled("planar_2r"), tmp_path)


@pytest.mark.parametrize("text", ['<robot name="stone"><link name="stone"/></robot>', MIMIC])
def test_robots_without_mass_or_motion_make_pages_too(tmp_path, text):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(text)
    header, _ = read_page(write_page(robot, tmp_path / "page.html"))
    assert np.isfinite([*header["target"], header["floor"], header["size"]]).all()
    assert header["size"] > 0


@pytest.mark.parametrize("name", ["panda", "quadruped"])
def test_a_robot_starts_where_it_may_be(tmp_path, name):
    """Both have joints whose limits leave zero out."""
    robot = getattr(tw.robots, name)()
    q = np.array(read_page(write_page(robot, tmp_path / "page.html"))[0]["start"])
    turning = [(b.q_index, b.v_index) for b in robot.model.leaders if b.joint.nv == 1]
    at, of = map(list, zip(*turning, strict=True))
    assert np.all((robot.limits.lower[of] <= q[at]) & (q[at] <= robot.limits.upper[of]))
    assert np.allclose(robot.subtract(q, robot.neutral)[:5], 0) or name == "panda"


def test_a_closed_robot_is_refused_with_the_way_out(tmp_path):
    closed = tw.robots.planar_3r().constrain("tip", "vx")
    with pytest.raises(tw.ValueRangeError, match=r"take robot\.open\(\)"):
        write_page(closed, tmp_path / "page.html")
    assert not any(tmp_path.iterdir())
