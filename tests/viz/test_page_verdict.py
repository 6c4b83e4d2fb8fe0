"""The verdict of a motion page, under Node: the sentence, the torques and the numbers are those of the command ``torques``."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from page_files import read_page
from page_under_node import under_node

import twistwrench as tw
from twistwrench.core import numbers
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.limits_file import read_limits
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.drawn_motion import reported_motion
from twistwrench.reports.spoken_verdict import verdict_text as said
from twistwrench.reports.torque_analysis import analyse
from twistwrench.viz import motion_of, write_page

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

SET = "m.mass = given.mass; m.push = given.push; motion.pace = given.pace; motion.run();"
SAY = f"(m, all, motion) => all.map((given) => {{ {SET} return new Verdict(motion, m.robot).now.text; }})"
SWEEP = f"(m, all, motion) => all.map((given) => {{ {SET} return motion.tau.slice(); }})"


def under(mass=0.0, push=(0.0, 0.0, 0.0), pace=1.0):
    return {"mass": mass, "push": list(push), "pace": pace}


def report_of(robot, log, *payloads, limits=None, wrenches=None, friction=True):
    opened = MotionLog.open(log, robot.model)
    load = LoadCase(robot, payloads, wrenches or {}, friction=friction)
    return analyse(load, Differentiation.plan(opened, robot.model), limits or robot.limits)


def page_of(report, path):
    motion = reported_motion(report)
    return write_page(motion.load.robot, path, motion=motion)


@pytest.fixture(scope="module")
def demo_log():
    return tw.robots.path_of("ur5").with_name("ur5_demo.csv")


@pytest.fixture(scope="module")
def demo(demo_log, tmp_path_factory):
    report = report_of(tw.robots.ur5(), demo_log, Payload(5.0))
    return page_of(report, tmp_path_factory.mktemp("verdict") / "demo.html")


MASSES = [0.0, 5.0, 8.38, 8.40, 10.0]


def test_the_sentence_is_that_of_the_command_for_every_payload(demo, demo_log):
    """One page, its payload set by hand, against the command run anew with that payload."""
    found = under_node(demo, SAY, [under(mass) for mass in MASSES])
    expected = [said(report_of(tw.robots.ur5(), demo_log, Payload(mass))) for mass in MASSES]
    assert found == expected
    words = [text.split(":")[0] for text in found]
    assert words == ["OK", "OK", "OK", "OVER LIMIT", "OVER LIMIT"]
    for text, share in zip(found, ["42 %", "76 %", "99.997 %", "100.1 %", "111 %"], strict=True):
        assert share in text
    assert all("Maximum payload on this path: 8.38 kg at tool0" in text for text in found[1:])


def numbers_to_print():
    rng = random.Random(4)
    ties = [0.5, 1.5, 2.5, 62.5, 0.125, 0.375, 1.0625, 99.5, 1000.5, 2.0005, 12345.5, 0.99995, 1.00005, 999.95, 9999.5]
    sizes = [rng.uniform(1, 10) * 10.0 ** rng.randint(-9, 8) for _ in range(2000)]
    short = [rng.randint(1, 99999) / 10.0 ** rng.randint(0, 6) for _ in range(1000)]
    near = [1.0 + rng.uniform(-0.011, 0.011) for _ in range(500)]
    values = [0.0, 1.0, 150.0, 1e6, 999999.5, 1e-4, 1e-5, *ties, *sizes, *short, *near]
    return values + [-x for x in values]


PRINTED = [
    (numbers.number, "number(x)"),
    (lambda x: numbers.number(x, 3), "number(x, 3)"),
    (lambda x: numbers.number(x, 5), "number(x, 5)"),
    (numbers.torque, "torqueText(x)"),
    (numbers.percent, "percent(x)"),
    (lambda x: numbers.percent(x, 2), "percent(x, 2)"),
    (numbers.percent_of_limit, "percentOfLimit(x)"),
    (numbers.seconds, "seconds(x)"),
    (lambda x: numbers.rounded_down(abs(x)), "roundedDown(Math.abs(x))"),
    (lambda x: numbers.deviation(abs(x)), "deviation(Math.abs(x))"),
]


def test_numbers_are_printed_as_python_prints_them(demo):
    """To the character, for ties, powers of ten, values beside a limit, and minus zero."""
    values = numbers_to_print()
    work = f"(m, given) => [{', '.join(f'given.map((x) => {there})' for _, there in PRINTED)}]"
    for (here, there), found in zip(PRINTED, under_node(demo, work, values), strict=True):
        assert found == [here(x) for x in values], there


def joint_motion(robot, seed):
    """A smooth motion about a random pose, its rates given."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2, 41)
    middle, size, rate = robot.random_configuration(rng), rng.uniform(0.1, 0.4, robot.nv), rng.uniform(1, 5, robot.nv)
    phase = np.outer(t, rate)
    return t, middle + size * np.sin(phase), size * rate * np.cos(phase), -size * rate**2 * np.sin(phase)


@pytest.mark.parametrize("name", ["ur5", pytest.param("panda", marks=pytest.mark.slow), "planar_3r"])
def test_torques_under_payload_push_and_speed_are_those_of_inverse_dynamics(tmp_path, name):
    robot = getattr(tw.robots, name)()
    rng = np.random.default_rng(7)
    t, q, dq, ddq = joint_motion(robot, 3)
    page = write_page(robot, tmp_path / "page.html", motion=motion_of(robot, t, q, dq, ddq))
    set_ = [under(rng.uniform(0, 12), rng.uniform(-80, 80, 3), rng.uniform(0.25, 2)) for _ in range(3)]
    R = robot.forward_kinematics(q)[:, :3, :3]
    for given, found in zip(set_, under_node(page, SWEEP, set_), strict=True):
        heavy = robot.with_payload(tw.SpatialInertia.from_com(given["mass"]))
        F = np.concatenate([np.zeros((len(t), 3)), np.einsum("nji,j->ni", R, given["push"])], axis=1)
        s = given["pace"]
        expected = heavy.inverse_dynamics(
            q, s * dq, s * s * ddq, wrench_on_robot={robot.tip: F}, friction=robot.model.friction.any
        )
        np.testing.assert_allclose(np.reshape(found, q.shape), expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_of_a_very_long_motion_the_largest_torques_are_kept(tmp_path):
    """Of more rows than a page holds: it says so, and its peaks are those of every row."""
    robot = tw.robots.planar_2r()
    t = np.linspace(0, 20, 30_001)
    q, dq = np.sin(np.outer(t, [1.3, 2.9])), np.cos(np.outer(t, [1.3, 2.9])) * [1.3, 2.9]
    ddq = -q * np.square([1.3, 2.9])
    ddq[17_317] = 400.0  # one row, such as a jerk between two of those that are evenly spaced
    motion = motion_of(robot, t, q, dq, ddq)
    page = write_page(robot, tmp_path / "page.html", motion=motion)
    [note] = [note for note in read_page(page)[0]["notes"] if "rows" in note]
    assert note.startswith(f"The page has {len(motion.time)} of 30001 rows")
    peaks = under_node(page, "(m, given, motion) => motion.peaks.map((peak) => Math.abs(peak.value))")
    expected = np.abs(robot.inverse_dynamics(q, dq, ddq, friction=robot.model.friction.any)).max(axis=0)
    np.testing.assert_allclose(peaks, expected, rtol=1e-12)


def test_twice_the_speed_quadruples_what_inertia_takes(demo):
    work = f"""(m, all, motion) => all.map((given) => {{ {SET}
        const {{ inertia, coriolis, gravity }} = motion.terms(226, 1); return [inertia, coriolis, gravity]; }})"""
    slow, fast = under_node(demo, work, [under(3.0), under(3.0, pace=2.0)])
    np.testing.assert_allclose(fast, np.multiply(slow, [4.0, 4.0, 1.0]), rtol=1e-12)


def test_the_verdict_at_another_speed_is_that_of_a_log_with_another_clock(demo, tmp_path):
    """The demo in half its time, and in four times as much, written as a log and judged by the command."""
    robot = tw.robots.ur5()
    arrays = read_page(demo)[1]
    q, dq, ddq = (arrays[name].reshape(-1, 6) for name in ("q", "dq", "ddq"))
    paces = [2.0, 0.25]
    for pace, text in zip(paces, under_node(demo, SAY, [under(6.0, pace=pace) for pace in paces]), strict=True):
        motion = tw.Motion(arrays["time"] / pace, q, pace * dq, pace**2 * ddq, robot=robot)
        motion.to_csv(tmp_path / "clock.csv")
        assert text == said(report_of(robot, tmp_path / "clock.csv", Payload(6.0)))
        assert ("velocity" in text) == (pace == 2.0)


def test_friction_of_the_file_is_counted_at_every_speed(tmp_path):
    """A robot with viscous and dry friction; without friction on request, the page leaves it out as well."""
    robot = tw.robots.ur5()
    laws = replace(robot.model.friction, viscous=np.full(6, 2.0), coulomb=np.full(6, 3.0), static=np.full(6, 3.0))
    robot = tw.Robot(replace(robot.model, friction=laws))
    t, q, dq, ddq = joint_motion(robot, 5)
    page = write_page(robot, tmp_path / "page.html", motion=motion_of(robot, t, q, dq, ddq))
    [found] = under_node(page, SWEEP, [under(2.0, pace=1.5)])
    heavy = robot.with_payload(tw.SpatialInertia.from_com(2.0))
    expected = heavy.inverse_dynamics(q, 1.5 * dq, 2.25 * ddq, friction=True)
    np.testing.assert_allclose(np.reshape(found, q.shape), expected, atol=1e-11 * np.abs(expected).max())


def test_a_payload_beside_the_tip_and_a_wrench_are_those_of_the_command(tmp_path, demo_log):
    robot, wrench = tw.robots.ur5(), {"tool0": np.array([0, 0, 1.0, 4.0, 0, -20.0])}
    payload = Payload(3.0, (0.02, 0.0, 0.1), "wrist_2_link")
    page = page_of(report_of(robot, demo_log, payload, wrenches=wrench), tmp_path / "page.html")
    masses = [3.0, 15.0]
    expected = [said(report_of(robot, demo_log, replace(payload, mass=m), wrenches=wrench)) for m in masses]
    assert under_node(page, SAY, [under(m) for m in masses]) == expected


HAND = """<robot name="hand"><link name="base"/>{links}
<joint name="lift" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="60" velocity="9"/></joint>
<joint name="left" type="revolute"><parent link="arm"/><child link="left_finger"/><origin xyz="0.5 0.05 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="20" velocity="9"/></joint>
<joint name="right" type="revolute"><parent link="arm"/><child link="right_finger"/><origin xyz="0.5 -0.05 0"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="4" velocity="30"/><mimic joint="left" multiplier="0.5"/></joint>
<link name="left_tip"/><joint name="a" type="fixed"><parent link="left_finger"/><child link="left_tip"/><origin xyz="0.3 0 0"/></joint>
<link name="right_tip"/><joint name="b" type="fixed"><parent link="right_finger"/><child link="right_tip"/><origin xyz="0.3 0 0"/></joint>
</robot>"""
LINK = """<link name="{}"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>"""


def log_of(robot, path):
    """A swing of all joints about neutral, a floating base at rest."""
    t, free = np.linspace(0, 2, 41), robot.nq - robot.nv
    q, dq, ddq = np.tile(robot.neutral, (41, 1)), np.zeros((41, robot.nv)), np.zeros((41, robot.nv))
    for k in range(6 * free, robot.nv):
        size, rate = 0.2 + 0.02 * k, 2 + 0.1 * k
        q[:, k + free] += size * np.sin(rate * t)
        dq[:, k], ddq[:, k] = size * rate * np.cos(rate * t), -size * rate**2 * np.sin(rate * t)
    return tw.Motion(t, q, dq, ddq, robot=robot).to_csv(path)


def test_mimic_joints_with_limits_are_judged_at_every_load_and_tip(tmp_path):
    """Each finger is a tip; with 3 kg the right one, which follows, is over its own limit."""
    robot = tw.load(HAND.format(links="".join(map(LINK.format, ("arm", "left_finger", "right_finger")))))
    log = log_of(robot, tmp_path / "log.csv")
    page = page_of(report_of(robot, log), tmp_path / "page.html")
    tips = [read_page(page)[0]["frames"][entry["tip"]]["name"] for entry in read_page(page)[0]["tips"]]
    assert tips == ["left_tip", "right_tip"]
    work = f"""(m, all, motion) => all.map((given) => {{ m.choose(given.tip); {SET} return new Verdict(motion, m.robot).now.text; }})"""
    given = [(0.0, 0), *((mass, k) for mass in (0.2, 3.0) for k in (0, 1))]
    found = under_node(page, work, [{**under(mass), "tip": k} for mass, k in given])
    expected = [said(report_of(robot, log, *([Payload(mass, frame=tips[k])] if mass else []))) for mass, k in given]
    assert found == expected
    assert any("right, which follows left" in text for text in found)
    assert any("Maximum payload" in text for text in found)


def test_the_assumption_of_a_tip_is_said_at_every_payload_of_the_slider(tmp_path):
    """Three tips on the last body: a page made without a payload, and one made with another, say what the command says."""
    ends = "".join(
        f'<link name="{x}"/><joint name="to_{x}" type="fixed"><parent link="hand"/><child link="{x}"/><origin xyz="0 {y} 0"/></joint>'
        for x, y in (("a", 0.1), ("b", 0.0), ("c", -0.1))
    )
    arm = HAND.partition('<joint name="left"')[0].replace('"arm"', '"hand"')
    robot = tw.load(arm.format(links=LINK.format("hand")) + ends + "</robot>")
    log = log_of(robot, tmp_path / "log.csv")
    masses = (0.0, 0.3, 1.25, 4.0)
    expected = [said(report_of(robot, log, *([Payload(mass)] if mass else []))) for mass in masses]
    for payloads in ((), (Payload(2.0),)):
        page = page_of(report_of(robot, log, *payloads), tmp_path / f"page{len(payloads)}.html")
        assert under_node(page, SAY, [under(mass) for mass in masses]) == expected
    assert "Assumption: 1.25 kg at c (one of 3 tips; tip=…)" in expected[2]


@pytest.mark.slow
def test_a_floating_base_is_judged_at_every_load(tmp_path):
    """Of a robot without stops: a log beyond them is in doubt, and its page carries the answer of the command's load."""
    quadruped = tw.robots.quadruped()
    unlimited = replace(quadruped.limits, lower=np.full(quadruped.nv, -np.inf), upper=np.full(quadruped.nv, np.inf))
    robot = tw.Robot(replace(quadruped.model, limits=unlimited))
    log = log_of(robot, tmp_path / "log.csv")
    page = page_of(report_of(robot, log), tmp_path / "page.html")
    expected = [said(report_of(robot, log, *([Payload(mass, frame="FL_foot")] if mass else []))) for mass in (0.0, 2.0)]
    assert under_node(page, SAY, [under(mass) for mass in (0.0, 2.0)]) == expected
    assert "IS A CONTACT MISSING?" in expected[1]


def test_a_robot_without_limits_is_never_ok(tmp_path, bundled):
    robot = bundled("planar_3r")
    t, q, dq, ddq = joint_motion(robot, 1)
    tw.Motion(t, q, dq, ddq, robot=robot).to_csv(tmp_path / "log.csv")
    report = report_of(robot, tmp_path / "log.csv")
    page = page_of(report, tmp_path / "page.html")
    texts = under_node(page, SAY, [under(m) for m in (0.0, 0.5, 50.0)])
    assert texts[0] == said(report)
    assert all(text.startswith("UNSURE: no torque limit for 3 of 3 joints") for text in texts)
    assert not any("Maximum payload" in text for text in texts)
    limits = tmp_path / "limits.csv"
    limits.write_text("joint,effort\n" + "".join(f"{joint},60\n" for joint in robot.joint_names))
    stated = read_limits(limits, robot.model)
    page = page_of(report_of(robot, tmp_path / "log.csv", limits=stated), tmp_path / "limited.html")
    texts = under_node(page, SAY, [under(m) for m in (0.5, 50.0)])
    expected = [said(report_of(robot, tmp_path / "log.csv", Payload(m), limits=stated)) for m in (0.5, 50.0)]
    assert texts == expected
    assert [text.split(":")[0] for text in texts] == ["OK", "OVER LIMIT"]


def test_doubts_of_the_log_stay_whatever_the_sliders_say(tmp_path):
    """A contradiction refuses every load; noise about the limit leaves the answer open within its interval."""
    robot = tw.robots.ur5()
    t, q, dq, ddq = joint_motion(robot, 2)
    motion = motion_of(robot, t, q, dq, ddq)
    page = write_page(robot, tmp_path / "page.html", motion=replace(motion, refused=("the clock runs backwards",)))
    texts = under_node(page, SAY, [under(), under(1.0), under(100.0)])
    assert set(texts) == {"LOOK AGAIN: the clock runs backwards."}


def test_a_noisy_log_has_the_commands_sentence_and_its_interval_at_other_loads(tmp_path, demo):
    """Positions with noise: peaks are estimates, and near the limit the answer is open, whatever the slider says."""
    robot, arrays = tw.robots.ur5(), read_page(demo)[1]
    noisy = arrays["q"].reshape(-1, 6) + 3e-4 * np.random.default_rng(1).standard_normal((751, 6))
    log = tmp_path / "noisy.csv"
    header = ",".join(["time", *robot.joint_names])
    np.savetxt(log, np.column_stack([arrays["time"], noisy]), delimiter=",", header=header, comments="")
    report = report_of(robot, log, Payload(8.3))
    texts = under_node(page_of(report, tmp_path / "page.html"), SAY, [under(mass) for mass in (8.3, 8.0, 8.5, 9.0)])
    assert texts[0] == said(report)
    assert [text.split(":")[0] for text in texts] == ["UNSURE", "OK", "UNSURE", "OVER LIMIT"]
    assert "shoulder_lift_joint may exceed its limit, within the noise: -151.8 ± 1.1 N m" in texts[2]


def test_what_a_page_cannot_judge_it_carries(tmp_path, demo_log):
    """Motors and gears: the command's sentence, whatever is set."""
    robot = tw.robots.ur5().with_actuators(tw.robots.path_of("ur5").with_name("ur5_demo.yaml"))
    report = report_of(robot, demo_log, Payload(2.0))
    page = page_of(report, tmp_path / "page.html")
    work = f"""(m, all, motion) => all.map((given) => {{ {SET} const found = new Verdict(motion, m.robot).now;
        return [found.text, found.note]; }})"""
    note = "As computed for the command's load at its own speed, since motors and gears are judged as well."
    moved = f"{note} Torques below are those of the sliders."
    assert under_node(page, work, [under(2.0), under(9.0)]) == [[said(report), note], [said(report), moved]]


@pytest.mark.slow
def test_a_film_has_payload_and_verdict_on_its_frames(tmp_path, demo_log):
    """In the upper left corner, in the colour of the verdict; a motion that nobody judged has none."""
    pytest.importorskip("matplotlib")
    from PIL import Image

    from twistwrench.viz import film

    motion = reported_motion(report_of(tw.robots.ur5(), demo_log, Payload(10.0)))
    frames = {}
    for name, one in {"judged": motion, "plain": replace(motion, report=None)}.items():
        with Image.open(film(one, tmp_path / f"{name}.gif", fps=2, speed=6)) as picture:
            frames[name] = np.asarray(picture.convert("RGB")).astype(int)[30:80, :300]
    red = {name: ((f[..., 0] > 150) & (f[..., 1] < 90)).sum() for name, f in frames.items()}
    assert red["judged"] > 200
    assert red["plain"] == 0


def test_a_joint_without_position_limits_is_nearest_to_none(tmp_path):
    """The page of a robot that has no position limits is written, and names none."""
    t = np.linspace(0.0, 2.0, 201)
    robot = tw.robots.planar_2r()
    motion = tw.Motion(t, np.outer(1 - np.cos(t), [1.0, 0.0]), robot=robot)
    answer = tw.check(robot, motion, limits={"velocity": np.array([2.0, 2.0]), "effort": np.array([900.0, 900.0])})
    assert "position" not in answer.headline
    assert answer.to_html(tmp_path / "page.html").is_file()
