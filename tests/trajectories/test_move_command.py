"""The move command: what it prints and writes, its options and its exit codes."""

from __future__ import annotations

import csv
import gzip
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

ENDS = ("--from=0,-1.2,1.5,-0.3,1.5,0", "--to", "1.2,-0.8,1.1,-0.9,1.2,1")


@pytest.fixture
def run():
    def run(*arguments):
        result = CliRunner().invoke(main, list(map(str, arguments)))
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.output

    return run


def test_the_fastest_motion_is_told_written_drawn_and_read_back(run, tmp_path):
    file, picture = tmp_path / "m.csv", tmp_path / "m.png"
    code, output = run("move", "ur5", *ENDS, "--fastest", "--payload", "3", "--csv", file, "--plot", picture)
    assert code == 0, output
    assert "the fastest timing on this path" in output
    assert "shoulder_pan_joint   + torque" in output
    assert picture.read_bytes().startswith(b"\x89PNG")
    code, output = run("torques", "ur5", "--trajectory", file, "--payload", "3", "--no-friction")
    assert code == 0, output  # at the limits, and not over them
    assert "100 %" in output


def test_the_tables_of_a_motion_fit_eighty_columns(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for more in ((), ("--fastest",)):
        output = run("move", "ur5", *ENDS, *more)[1]
        assert max(map(len, output.splitlines())) <= 80, output


def test_a_straight_line_in_degrees(run, tmp_path):
    file = tmp_path / "m.csv"
    code, output = run(
        "move", "ur5", "--degrees", "--from=0,-70,85,-20,85,0", "--by", "0.05,0.1,-0.1", "--csv", file, "--step", 0.1
    )
    assert code == 0, output
    assert re.match(r"OK: [\d.]+ s, within all limits\.", output)
    rows = list(csv.reader(file.read_text().splitlines()))
    assert np.allclose([float(x) for x in rows[1][1:7]], [0, -70, 85, -20, 85, 0])
    assert float(rows[2][0]) - float(rows[1][0]) == pytest.approx(0.1, rel=0.2)  # a whole number of steps


@pytest.mark.parametrize("flags, quarter", [(["--degrees"], 90.0), ([], np.pi / 2)])
def test_ways_and_peaks_are_in_the_unit_asked_for(run, flags, quarter):
    """The cubic timing is fastest half way, 3/2 of the mean; MR section 9.2.2."""
    code, output = run(
        "move", "planar_2r", *flags, "--from=0,0", "--to", f"{quarter!r},0", "--scaling", "cubic", "--duration", 1
    )
    assert code == 1, output  # the arm has no limits
    row = next(line.split() for line in output.splitlines() if line.split()[:1] == ["joint1"])
    assert row[1:3] == [f"{quarter:.4g}", f"{1.5 * quarter:.4g}"]


def test_a_path_that_ends_early_is_kept_until_there(run, tmp_path):
    file = tmp_path / "m.csv"
    code, output = run("move", "ur5", ENDS[0], "--by", "0.1,-0.2,2", "--csv", file)
    assert code == 1
    words = " ".join(output.split())
    assert words.startswith("STOPPED: the path of poses ends at s = 0.1")
    assert "is the path until there. Until there: " in words and "within all limits. ur5" in words
    assert len(file.read_text().splitlines()) > 10


def test_a_hasty_motion_is_a_problem_found(run):
    code, output = run("move", "ur5", *ENDS, "--duration", "0.2", "--scaling", "trapezoid")
    assert code == 1
    assert output.startswith("OVER LIMIT: shoulder_pan_joint: velocity")


def test_where_no_limit_is_known_it_is_said(run, tmp_path):
    """planar_2r has no limits at all; with a file for one joint the other is named."""
    limits = tmp_path / "limits.csv"
    limits.write_text("joint,velocity,effort\njoint1,2,100\n")
    code, output = run("move", "planar_2r", "--to", "1,0", "--duration", "2", "--limits", limits)
    words = " ".join(output.split())
    assert code == 1, output
    assert words.startswith("UNSURE: no torque limit for 1 of 2 joints (joint2)")
    assert "otherwise within the known limits." in words
    assert "No velocity limit of joint2 is known" in words
    code, output = run("move", "planar_2r", "--to", "1,0", "--duration", "2")
    assert " ".join(output.split()).startswith("UNSURE: no torque limit for 2 of 2 joints")


def test_acceleration_limits_of_files_are_kept_and_their_source_is_named(run, tmp_path):
    text = tw.robots.path_of("ur5").read_text().replace("effort=", 'acceleration="3" effort=')
    (tmp_path / "arm.urdf").write_text(text)
    motion = "--from=0,-1,1,0,0,0", "--to=1,-1,1,0,0,0", "--fastest"
    code, output = run("move", tmp_path / "arm.urdf", *motion)
    assert code == 0, output
    assert "Acceleration limits of 6 of 6 joints are from the robot's file." in output
    assert "+ acceleration" in output
    (tmp_path / "limits.csv").write_text("joint,acceleration\nshoulder_pan_joint,2\n")
    code, output = run("move", "ur5", *motion, "--limits", tmp_path / "limits.csv")
    assert code == 0, output
    assert re.search(r"of 1 of 6 joints are from the robot's file and \S+limits.csv", " ".join(output.split())), output
    assert "Acceleration limits" not in run("move", tmp_path / "arm.urdf", *motion, "--acceleration", "9")[1]


def test_a_robot_too_weak_is_a_problem_found(run, tmp_path):
    limits = tmp_path / "limits.csv"
    limits.write_text("joint,effort\njoint1,20\njoint2,20\n")
    code, output = run(
        "move", "planar_2r", "--to", "1,0", "--fastest", "--limits", limits, "--csv", tmp_path / "none.csv"
    )
    assert code == 1
    assert "OVER LIMIT: the robot cannot hold itself on this path" in output
    assert "29.43 of 20" in output
    assert not (tmp_path / "none.csv").exists()  # there is no motion to write


@pytest.mark.parametrize("flags, over", [([], True), (["--no-friction"], False)])
def test_friction_is_judged_where_it_is_counted(run, tmp_path, flags, over):
    """Half a radian in a second takes less than 4 N m without friction; at 0.75 rad/s this drags with 3.75 N m more."""
    text = tw.robots.path_of("pendulum").read_text()
    limit = '<limit effort="5" velocity="9"/><dynamics damping="5"/></joint>'
    (tmp_path / "r.urdf").write_text(text.replace("</joint>", limit, 1))
    code, output = run("move", tmp_path / "r.urdf", "--to", 0.5, "--duration", 1, "--scaling", "cubic", *flags)
    assert (code, "OVER LIMIT: hinge: torque" in output) == (int(over), over), output


@pytest.mark.parametrize(
    ("name", "flags", "words"),
    [
        ("ur5", (), "no friction, as its file gives none"),
        ("panda", (), "with friction"),
        ("panda", ("--no-friction",), "without friction"),
    ],
)
def test_the_heading_says_what_friction_is_counted(run, name, flags, words):
    robot = getattr(tw.robots, name)()
    _, output = run("move", name, "--to", ",".join(map(str, robot.neutral + 0.01)), *flags)
    assert f"  ·  {words}\n" in output


@pytest.mark.parametrize(
    "command",
    [("move", "planar_2r", "--to", "90,-45"), ("simulate", "planar_2r", "--at", "joint1=90", "--duration", 0.01)],
)
def test_angles_that_are_plainly_degrees_are_hinted_at(run, command):
    for flags, hinted in (((), True), (("--degrees",), False)):
        _, output = run(*command, *flags)
        assert ("joint1 is at 90 rad, 14.3 turns. For degrees add --degrees." in " ".join(output.split())) == hinted


DIALECTS = {
    "commas": lambda text: text.encode(),
    "a mark of UTF-8": lambda text: text.encode("utf-8-sig"),
    "UTF-16": lambda text: text.encode("utf-16"),
    "semicolons and decimal commas": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "tabs, lines of Windows": lambda text: text.replace(",", "\t").replace("\n", "\r\n").encode(),
    "gzip": lambda text: gzip.compress(text.encode()),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_tables_of_waypoints_and_limits_are_read_as_motions_are(run, tmp_path, dialect):
    points, limits, csv = tmp_path / "w.csv", tmp_path / "limits.csv", tmp_path / "m.csv"
    points.write_bytes(DIALECTS[dialect]("joint1,joint2\n0.25,0.5\n"))
    limits.write_bytes(DIALECTS[dialect]("joint,velocity,effort\njoint1,0.75,60.5\njoint2,inf,60.5\n"))
    given = ("--to", "1,1", "--waypoints", points, "--limits", limits, "--acceleration", 50, "--csv", csv)
    code, output = run("move", "planar_2r", *given)
    assert code == 0, output
    q = tw.Motion.from_file(csv, tw.robots.planar_2r()).q
    assert np.abs(q - [0.25, 0.5]).max(axis=1).min() < 5e-3  # a row every 2 ms at 0.75 rad/s
    assert "0.75" in output


@pytest.mark.parametrize(
    "upper, code, said", [("0.5", 1, "OVER LIMIT: joint1"), ("1.5", 0, "OK: 1.07457 s, within all limits")]
)
def test_limits_of_positions_are_those_of_the_file(run, tmp_path, upper, code, said):
    limits = tmp_path / "limits.csv"
    limits.write_text(f"joint,lower,upper,velocity,effort\njoint1,-2,{upper},2,200\njoint2,-2,2,2,200\n")
    found, output = run("move", "planar_2r", "--to", "1,0", "--acceleration", 5, "--limits", limits)
    assert found == code, output
    assert said in output.partition("\n")[0], output


def test_waypoints_are_met(run, tmp_path):
    points, file, limits = tmp_path / "w.csv", tmp_path / "m.csv", tmp_path / "limits.csv"
    points.write_text("joint2,joint1\n0.5,-0.2\n-0.1,0.7\n")
    limits.write_text("joint,velocity,effort\njoint1,2,60\njoint2,2,60\n")
    code, output = run(
        "move", "planar_2r", "--to", "1,1", "--waypoints", points, "--limits", limits, "--csv", file, "--step", 0.001
    )
    assert code == 0, output
    q = np.array([[float(x) for x in row[1:3]] for row in list(csv.reader(file.read_text().splitlines()))[1:]])
    for point in ([-0.2, 0.5], [0.7, -0.1]):
        assert np.abs(q - point).max(axis=1).min() < 2e-3


def test_limits_of_jerk_come_from_the_option_or_from_files_and_a_bad_file_is_named(run, tmp_path):
    file, picture = tmp_path / "limits.csv", tmp_path / "move.png"
    file.write_text("joint,velocity,effort,acceleration,jerk\njoint1,3,150,12,90\njoint2,3,60,12,90\n")
    way = ("move", "planar_2r", "--to", "1,-0.5", "--limits", file)
    code, output = run(*way, "--fastest", "--plot", picture)
    assert code == 0, output
    words = " ".join(output.split())
    assert re.search(
        r"OK: [\d.]+ s, within all limits; \d+ % slower than without jerk limits; not proven shortest", words
    )
    assert "Jerk limits of 2 of 2 joints are from the robot's file and" in words and picture.exists()
    shown = [re.search(r"timing: ([\d.]+) s", run(*way, *more)[1])[1] for more in ((), ("--scaling", "s-curve"))]
    again = re.search(r"timing: ([\d.]+) s", run(*way, "--jerk", 20)[1])[1]
    assert 0 < float(shown[0]) < float(again) and float(shown[1]) > 0
    file.write_text("joint,jerk\njoint1,-5\n")
    code, output = run(*way)
    assert code == 2 and "-5" in output and "limits.csv" in output and output.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--from=1,2,3", "--to", "1,1"), "--from"),
        ((), "where does it end"),
        (("--to", "1,1", "--by", "0,0,1"), "--to and --by"),
        (("--by", "0,0,1", "--path", "screw"), "Leave the path out"),
        (("--to", "1,1", "--fastest", "--duration", "1"), "--duration"),
        (("--to", "1,1", "--duration", "0"), "duration"),
        (("--to", "1,1", "--step", "0"), "--step"),
        (("--to", "1,nan"), "--to"),
        (("--to", "0,0"), "same configuration"),
        (("--to", "1,1"), "nothing limits"),
        (("--to", "1,1", "--fastest"), "nothing limits"),
        (("--to", "1,1", "--waypoints", "none.csv"), "none.csv"),
        (("--to", "1,1", "--acceleration", "-1"), "acceleration"),
        (("--to", "1,1", "--jerk", "-1"), "jerk has -1"),
        (("--to", "1,1", "--jerk", "nan"), "jerk"),
        (("--to", "1,1", "--jerk", "9", "--scaling", "cubic"), "jumps at the ends"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, arguments, words):
    code, output = run("move", "planar_2r", *arguments)
    assert code == 2, output
    assert words in output
    assert output.count("\n") == 1


def test_ends_are_coordinates_joints_or_configurations_of_the_file(run, tmp_path):
    """One motion asked for in all ways: what --to does not name stays as at the beginning."""
    text = """<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size="0.1" mass="1" pos="1 0 0"/>
      <body pos="1 0 0"><joint name="b" axis="0 1 0"/><geom size="0.1" mass="1" pos="1 0 0"/></body></body></worldbody>
      <keyframe><key name="bent" qpos="0.4 0.5"/><key name="there" qpos="0.4 -0.6"/></keyframe></mujoco>"""
    (tmp_path / "r.xml").write_text(text)
    ways = (
        ("--from", "0.4,0.5", "--to", "0.4,-0.6"),
        ("--from", "a=0.4", "--from", "b=0.5", "--to", "b=-0.6"),
        ("--from", "bent", "--to", "there"),
        ("--degrees", "--from", "bent", "--to", f"b={np.degrees(-0.6)}"),
    )
    answers = set()
    for k, way in enumerate(ways):
        code, output = run("move", tmp_path / "r.xml", *way, "--duration", "1", "--csv", tmp_path / f"{k}.csv")
        assert code == 1, output  # its joints have no limits
        motion = tw.Motion.from_file(tmp_path / f"{k}.csv", tw.load(text), degrees="--degrees" in way)
        answers.add(str(motion.q[[0, -1]].round(9).tolist()))
    assert answers == {"[[0.4, 0.5], [0.4, -0.6]]"}
    code, output = run("move", tmp_path / "r.xml", "--to", "bend")
    assert code == 2
    assert "2 numbers, a,b; or JOINT=VALUE, as a=0.5; or a configuration of the file:" in output
    code, output = run("move", tmp_path / "r.xml", "--to", "bent", "--to", "0,0")
    assert (code, "both set all coordinates" in output) == (2, True)


LINK = '<link name="{}"><inertial><origin xyz="0 0 0.2"/><mass value="2"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".05"/></inertial></link>'
PAIR = """<robot name="pair">{}{}<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="5"/></joint></robot>"""


@pytest.mark.parametrize(
    ("upper", "options", "doubt"),
    [
        (LINK, (), ""),
        ('<link name="{}"/>', (), "b has no mass"),
        (LINK, ("--floating-base",), "nothing drives the base, but the motion needs"),
    ],
)
def test_a_motion_whose_torques_lack_something_is_unsure(run, tmp_path, upper, options, doubt):
    """As the command ``torques`` says of the same motion."""
    robot, end = tmp_path / "pair.urdf", "1,0,0,0,0,0,0,0.5" if options else "0.5"
    robot.write_text(PAIR.format(LINK.format("a"), upper.format("b")))
    code, text = run("move", robot, "--to", end, "--duration", "2", "--csv", tmp_path / "m.csv", *options)
    again, said = run("torques", robot, "--trajectory", tmp_path / "m.csv", *options)
    assert code == again == bool(doubt)
    for shown in (text, said):
        flat = " ".join(shown.split())
        assert ("OK" in flat) != bool(doubt)
        assert (f"UNSURE: {doubt}" in flat) == bool(doubt)
