"""The payload command: what it prints, the files it writes, its options and its exit codes."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench import statics
from twistwrench.cli.main import main

POSE = ("--at", "shoulder_lift_joint=-0.6", "--at", "elbow_joint=0.9")


@pytest.fixture
def run():
    def run(*arguments):
        result = CliRunner().invoke(main, ["payload", *map(str, arguments)])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.output

    return run


@pytest.fixture
def weak_limits(tmp_path):
    path = tmp_path / "limits.csv"
    path.write_text("joint,effort\njoint1,50\njoint2,20\n")
    return path


def test_it_prints_what_the_library_finds(run):
    ur5 = tw.robots.ur5()
    found = statics.largest_payload(ur5, [0, -0.6, 0.9, 0, 0, 0], (0, 0, 0.1))
    code, output = run("ur5", *POSE, "--com", "0,0,0.1")
    assert code == 0
    assert f"OK: largest payload at rest in this pose: {found.mass:.4g} kg at tool0" in output
    assert "payload at tool0 + [0, 0, 0.1] m" in output
    assert "Weakest along" in output


def test_poses_may_be_given_whole_or_in_degrees(run):
    outputs = {
        run("ur5", "--at", "0,-0.6,0.9,0,0,0")[1],
        run("ur5", *POSE)[1],
        run("ur5", "--at", "1,1,1,0,0,0", *POSE, "--at", "shoulder_pan_joint=0")[1],
    }
    assert len(outputs) == 1
    degrees = run(
        "ur5", "--degrees", "--at", f"shoulder_lift_joint={np.degrees(-0.6)}", "--at", f"elbow_joint={np.degrees(0.9)}"
    )
    assert degrees[1].splitlines()[-2:] == outputs.pop().splitlines()[-2:]
    assert "[°]" in degrees[1]


def test_the_csv_has_all_digits(run, tmp_path):
    code, _ = run("ur5", *POSE, "--csv", tmp_path / "out.csv")
    assert code == 0
    with (tmp_path / "out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = statics.largest_payload(tw.robots.ur5(), [0, -0.6, 0.9, 0, 0, 0])
    assert [r["joint"] for r in rows] == list(found.joint_names)
    assert_allclose([float(r["with_payload"]) for r in rows], found.torques, rtol=0, atol=1e-12 * 150)
    assert [float(r["q"]) for r in rows] == [0, -0.6, 0.9, 0, 0, 0]
    numbers = [float(r[c]) for r in rows for c in ("alone", "per_kilogram", "with_payload", "share")]
    assert all(x == 0 or abs(x) > 1e-9 for x in numbers)  # no rounding where there is nothing
    assert max(float(r["share"]) for r in rows) == pytest.approx(1)
    run("ur5", "--degrees", "--at", "elbow_joint=50", "--csv", tmp_path / "out.csv", "--overwrite")
    with (tmp_path / "out.csv").open(newline="") as file:
        assert [float(r["q_degrees"]) for r in csv.DictReader(file)] == pytest.approx([0, 0, 50, 0, 0, 0])


def test_what_is_carried_already_counts_as_part_of_the_robot(run, tmp_path):
    out = tmp_path / "out.csv"
    code, output = run(
        "ur5", *POSE, "--tool", "1.2,0,0,0.05", "--tool", "0.5@forearm_link", "--com", "0,0,0.1", "--csv", out
    )
    said = " ".join(output.split())
    assert code == 0
    loaded = tw.robots.ur5()
    for mass, place, frame in ((1.2, (0, 0, 0.05), "tool0"), (0.5, (0, 0, 0), "forearm_link")):
        loaded = loaded.with_payload(tw.SpatialInertia.from_com(mass, place), frame=frame)
    found = statics.largest_payload(loaded, [0, -0.6, 0.9, 0, 0, 0], (0, 0, 0.1))
    assert f"largest payload at rest in this pose: {found.mass:.4g} kg" in said
    assert "carrying 1.2 kg at tool0 + [0, 0, 0.05] m and 0.5 kg at forearm_link already" in said
    assert "carry the robot and what it carries" in said
    with out.open(newline="") as file:
        assert_allclose([float(r["alone"]) for r in csv.DictReader(file)], found.unloaded, atol=1e-9)
    code, output = run("ur5", *POSE, "--tool", "40")
    assert code == 1
    assert "to hold the robot and what it carries" in " ".join(output.split())


def test_the_title_says_where_the_payload_is_and_what_is_carried(run, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    from twistwrench.viz import style

    titles, figure = [], style.figure
    monkeypatch.setattr(style, "figure", lambda w, h, title: (titles.append(title), figure(w, h, title))[1])
    code, output = run("ur5", *POSE, "--com", "0,0,0.1", "--tool", "1.2", "--plot", tmp_path / "out.svg")
    assert code == 0
    mass = output.partition("in this pose: ")[2].partition(" kg")[0]
    assert titles == [
        f"ur5 · largest payload {mass} kg at tool0 + [0, 0, 0.1] m, by torque limits only, beside 1.2 kg at tool0"
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--com", "0,0,80"], "com is 80 m from its frame: lengths are in metres. If those are mm, write 0,0,0.08."),
        (["--tool", "1,0,0,50"], "the centre of the tool of 1 kg is 50 m from its frame"),
        (["--at", "elbow_joint=90"], "elbow_joint at 90 rad is more than a turn beyond its limits"),
        (["--at", "0,-45,90,0,0,0"], "shoulder_lift_joint at -45 rad is more than a turn"),
        (["--at", "elbow_joint=9"], None),  # beyond its limits, but not by a turn
        (["--degrees", "--at", "elbow_joint=900"], None),
        (["--com", "0,0,0.9"], None),
    ],
)
def test_numbers_of_another_unit_get_a_hint(run, arguments, words):
    _, output = run("ur5", *arguments)
    if words is None:
        assert "lengths" not in output
        assert "angles are" not in output
    else:
        assert f"! {words}" in " ".join(output.split())


def test_the_joints_are_said_to_be_all_that_counts(run):
    assert "structure, grip, warm motors and motion may limit it earlier" in run("ur5", *POSE)[1]


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_pictures_and_maps_are_drawn(run, tmp_path, suffix):
    pytest.importorskip("matplotlib")
    out = tmp_path / f"out.{suffix}"
    code, output = run("ur5", *POSE, "--map", "xz", "--samples", 3000, "--plot", out)
    assert code == 0, output
    assert out.stat().st_size > 10_000
    assert "map, xz slice" in output


def test_a_joint_that_can_give_nothing_is_drawn_too(tmp_path):
    pytest.importorskip("matplotlib")
    from twistwrench.viz.plots.payload import plot_payload

    arm = tw.robots.planar_2r()
    limits = replace(arm.limits, effort=np.array([50.0, 0.0]))
    plot_payload(tw.payload(arm, [0.0, 1.0], limits=limits), tmp_path / "out.png")
    assert (tmp_path / "out.png").stat().st_size > 10_000


def test_the_ellipsoid_that_is_drawn_is_that_of_the_robot(tmp_path, monkeypatch):
    """Each point of the wireframe is as far from the tip as the ellipsoid reaches in its direction."""
    pytest.importorskip("matplotlib")
    from mpl_toolkits.mplot3d import Axes3D

    from twistwrench.viz.plots.payload import plot_payload

    drawn, wireframe = [], Axes3D.plot_wireframe

    def record(axis, x, y, z, **look):
        drawn.append(np.stack([x, y, z], axis=-1).reshape(-1, 3))
        return wireframe(axis, x, y, z, **look)

    monkeypatch.setattr(Axes3D, "plot_wireframe", record)
    robot, q = tw.robots.ur5(), [0.3, -1.1, 0.9, -0.4, 0.7, 0.2]
    plot_payload(tw.payload(robot, q), tmp_path / "out.png")
    (points,) = drawn
    reach = tw.statics.wrench_ellipsoid(robot, q, limits=robot.limits.effort).reach(points)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), reach, rtol=1e-9)


def test_a_map_is_of_the_payload_asked_for(run, weak_limits):
    """The place of the mass in the frame counts, not the frame alone."""
    said = []
    for com in ("0,0,0", "0.5,0,0"):
        _, output = run("planar_2r", "--limits", weak_limits, "--com", com, "--map", "xz", "--samples", 500)
        said.append(next(line for line in output.splitlines() if line.startswith("map, ")))
    assert said[0] != said[1]


@pytest.mark.parametrize("pose", ["joint2=1.5", "joint2=0"])
def test_planar_arms_are_drawn_in_their_plane(run, weak_limits, tmp_path, pose):
    pytest.importorskip("matplotlib")
    code, output = run("planar_2r", "--limits", weak_limits, "--at", pose, "--plot", tmp_path / "out.png")
    assert code == 0, output
    assert (tmp_path / "out.png").stat().st_size > 10_000


def test_a_pose_that_cannot_be_held_is_said_so_and_drawn(run, tmp_path):
    pytest.importorskip("matplotlib")
    limits = tmp_path / "limits.csv"
    limits.write_text("joint,effort\njoint1,20\njoint2,20\n")
    code, output = run("planar_2r", "--limits", limits, "--plot", tmp_path / "out.png")
    assert code == 1
    assert "OVER LIMIT: no payload. joint1 needs 29.43 of 20 to hold the robot alone" in " ".join(output.split())
    limits.write_text("joint,effort\njoint1,50\njoint2,20\n")
    code, output = run("planar_2r", "--limits", limits, "--at", "joint1=1.5707963267948966")
    assert code == 0
    assert output.startswith("OK: the payload is not limited at this pose")


def test_a_pose_beyond_the_joint_limits_exits_1_and_says_by_how_much(run, tmp_path):
    """The torques are still what they would be there; that the robot cannot be there is the verdict."""
    high = float(tw.robots.ur5().limits.upper[2])
    code, output = run("ur5", "--at", f"elbow_joint={high + 0.25}", "--csv", tmp_path / "out.csv")
    said = " ".join(output.split())
    assert code == 1
    assert f"elbow_joint at {high + 0.25:.4g} rad is 0.25 rad above its upper position limit, {high:.4g} rad" in said
    assert "Largest payload at rest in this pose" in said
    assert (tmp_path / "out.csv").exists()
    code, output = run("ur5", "--degrees", "--at", "elbow_joint=-200", "--at", "wrist_1_joint=400")
    said = " ".join(output.split())
    assert code == 1
    assert "wrist_1_joint at 400° is 40° above its upper position limit, 360°" in said
    assert "elbow_joint at -200° is 20° below its lower position limit, -180°" in said
    verdict = said[said.index("OVER LIMIT") :]
    assert verdict.index("wrist_1_joint") < verdict.index("elbow_joint")  # the farthest first
    for edge in (high, -high):
        assert run("ur5", "--at", f"elbow_joint={edge!r}")[0] == 0


def test_a_slide_beyond_its_stop_is_told_in_metres_though_angles_are_degrees(run):
    """A slide at 2.9 m on a rail that ends at 2.4 m."""
    code, output = run("cart_pole", "--degrees", "--at", "slider=2.9")
    assert code == 1
    assert "slider at 2.9 m is 0.5 m above its upper position limit, 2.4 m" in " ".join(output.split())


def test_position_limits_of_the_file_stand_in_for_the_robots(run, tmp_path):
    limits = tmp_path / "limits.csv"
    limits.write_text("joint,lower,upper\nelbow_joint,0.2,1\n")
    assert run("ur5", "--at", "elbow_joint=0.5", "--limits", limits)[0] == 0
    code, output = run("ur5", "--at", "elbow_joint=1.5", "--limits", limits)
    assert code == 1
    assert "is 0.5 rad above its upper position limit, 1 rad" in " ".join(output.split())


def test_outputs_never_replace_inputs(run, weak_limits):
    before = weak_limits.read_text()
    code, output = run("planar_2r", "--limits", weak_limits, "--csv", weak_limits)
    assert code == 2
    assert "would overwrite the file of --limits" in output
    assert weak_limits.read_text() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ur5", "--at", "elbow"], "or JOINT=VALUE, as shoulder_pan_joint=0.5"),
        (["ur5", "--at", "elbow=1"], "Did you mean 'elbow_joint'"),
        (["ur5", "--at", "elbow_joint=bent"], "expected 1 number"),
        (["ur5", "--at", "1,2"], "expected 6 numbers"),
        (["ur5", "--com", "1"], "expected x,y,z"),
        (["ur5", "--frame", "hand"], "no frame named 'hand'"),
        (["ur5", "--tool", "heavy"], "payload 'heavy': expected MASS[,x,y,z][@FRAME]"),
        (["ur5", "--tool", "1@hand"], "no frame named 'hand'"),
        (["ur5", "--tool", "-1"], "negative mass"),
        (["ur5", "--at", "elbow_joint=1", "--at", " elbow_joint = 2"], "--at elbow_joint is given twice"),
        (["ur5", "--at", "elbow_joint=nan"], "expected 1 number"),
        (["ur5", "--com", "0,0,nan"], "expected x,y,z"),
        (["ur5", "--map", "zz"], "'zz' is not one of 'rz'"),
        (["ur5", "--map", "rz", "--samples", "0"], "samples is 0"),
        (["ur5", "--map", "rz", "--samples", "-3"], "samples is -3"),
        (["ur5", "--map", "rz", "--samples", "few"], "not a valid integer"),
        (["ur5", "--samples", "100"], "Add --map rz"),
        (["ur5", "--csv", "no/such/out.csv"], "cannot write"),
        (["ur5", "--csv", "out.png", "--plot", "out"], "would overwrite the file of --csv"),
        (["ur5", "--plot", "out.nope"], "cannot draw"),
        (["quadruped"], "needs a fixed base"),
        (["quadruped", "--frame", "FL_foot"], "needs a fixed base"),
        (
            ["quadruped", "--frame", "FL_foot"],
            "With --fixed-base the answer is that of a robot whose base a stand holds",
        ),
        (["quadruped", "--frame", "FL_foot", "--at", "1"], "JOINT=VALUE, as FL_hip_joint=0.5"),
        (["quadruped", "--frame", "FL_foot", "--at", "=1"], "JOINT=VALUE, for example FL_hip_joint=0.5"),
        (
            ["quadruped", "--fixed-base"],
            "the frame of the payload must be named: --frame FL_foot. It may be one of FL_foot, FR_foot",
        ),
        (["ur5", "--frame", "tool9"], "error: --frame: no frame named 'tool9'. Did you mean 'tool0'?"),
        (["nothing"], "no robot file"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(run, arguments, words):
    code, output = run(*arguments)
    assert code == 2
    assert words in output
    assert output.startswith("error: ")  # nothing of the report before it
    assert "Traceback" not in output


def test_help_answers_without_loading_what_is_heavy():
    import subprocess
    import sys

    code = (
        "import sys; from twistwrench.cli.main import main; print('scipy' in sys.modules, 'matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_links_without_mass_make_the_answer_unsure(run, tmp_path):
    """Their weight is missing from what the joints hold, so that the payload printed may be too much."""
    path = tmp_path / "swing.urdf"
    path.write_text(
        """<robot name="swing"><link name="base"/><link name="rod"/>
        <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
        <link name="tip"/><joint name="end" type="fixed"><parent link="rod"/><child link="tip"/>
        <origin xyz="0.5 0 0"/></joint></robot>"""
    )
    code, output = run(path)
    assert code == 1
    first, *_ = [line for line in output.splitlines() if not line.startswith("note: ")]
    assert first.startswith("UNSURE: rod has no mass")
