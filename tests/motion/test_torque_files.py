"""Files of the torques command: limits in, tables and pictures out, the bundled motion, and ten million rows."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from motions import LOAD, SLED, report_of, write_motion

from twistwrench import load, robots
from twistwrench.core.errors import TwistWrenchError, ValueRangeError
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.limits_file import read_limits
from twistwrench.motion.load_case import TERMS, LoadCase
from twistwrench.motion.motion_log import MotionLog

pytest_plugins = ("torque_fixtures",)
DEMO = Path(robots.__file__).parent / "ur5_demo.csv"

# ── out ──


def test_the_csv_has_time_torques_and_their_causes(ur5, motion, motion_file, tmp_path):
    out = tmp_path / "out.csv"
    report_of(ur5, motion_file, csv=out, split=True, chunk=256, **LOAD)
    header = out.read_text().splitlines()[0].split(",")
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    assert header[:2] == ["time", f"{ur5.joint_names[0]}.torque"]
    np.testing.assert_array_equal(table[:, 0], motion[0])
    for name in ur5.joint_names:
        total = sum(table[:, header.index(f"{name}.{term}")] for term in TERMS)
        np.testing.assert_allclose(total, table[:, header.index(f"{name}.torque")], rtol=1e-10, atol=1e-10)


def test_a_failed_run_leaves_the_old_file_alone(run, ur5, motion_file, tmp_path):
    out = tmp_path / "out.csv"
    out.write_text("old")
    motion_file.write_text(motion_file.read_text() + "oops\n")
    code, text = run("torques", "ur5", "--trajectory", motion_file, "--csv", out, "--overwrite")
    assert code == 2
    assert "line 702" in text
    assert out.read_text() == "old"
    assert {p.name for p in tmp_path.iterdir()} == {"motion.csv", "out.csv"}


def test_outputs_never_replace_inputs_or_each_other(run, motion_file, tmp_path):
    before, link, limits = motion_file.read_text(), tmp_path / "link.csv", tmp_path / "l.csv"
    link.symlink_to(motion_file)
    limits.write_text("joint,effort\n")
    robot = tmp_path / "r.urdf"
    robot.write_text(robots.path_of("ur5").read_text())
    (tmp_path / "one.svg").hardlink_to(limits)
    for flags in (
        ["--csv", motion_file],
        ["--csv", link],
        ["--csv", limits],
        ["--csv", robot],
        ["--csv", tmp_path / "new.png", "--plot", tmp_path / "new"],
        ["--plot", tmp_path / "one.svg"],
    ):
        code, text = run("torques", robot, "--trajectory", motion_file, "--limits", limits, *flags)
        assert (code, "would overwrite" in text) == (2, True), text
    assert motion_file.read_text() == before
    assert not (tmp_path / "new.png").exists()


def test_the_plot_is_a_picture(run, tmp_path):
    pytest.importorskip("matplotlib")
    t = np.linspace(0.0, 1.0, 101)
    swing = write_motion(tmp_path / "swing.csv", robots.pendulum(), t, (np.sin(t)[:, None],))
    for suffix, magic in (("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")):
        path = tmp_path / f"out.{suffix}"
        run("torques", "pendulum", "--trajectory", swing, "--payload", "5", "--plot", path)
        assert path.read_bytes().startswith(magic)


def test_lines_break_at_gaps_and_labels_are_the_tables(ur5, motion, tmp_path):
    pytest.importorskip("matplotlib")
    from twistwrench.viz.plots.torques import _break_at_gaps, report_title

    time, curve = _break_at_gaps(np.r_[0:5, 20:25] * 1.0, 5.0, np.arange(10.0))
    assert np.flatnonzero(np.isnan(curve)).tolist() == [5]
    assert len(time) == 11
    t, *columns = motion
    path = write_motion(tmp_path / "m.csv", ur5, t, columns)
    report = report_of(ur5, path, friction=False, wrenches={"tool0": np.ones(6)})
    assert report_title(report) == "ur5 · m · wrench on tool0 · without friction"
    assert report.label(1342.0) == "1342"
    assert report.label(1e-9 * report.scale) == "0"


# ── limits ──


def test_limits_come_from_a_file_and_blanks_keep(ur5, tmp_path):
    path = tmp_path / "limits.csv"
    path.write_text(
        "\ufeffjoint,effort,upper,velocity\n# remark\nelbow_joint,40,90,\nwrist_1_joint,,,inf\n", encoding="utf-8"
    )
    limits = read_limits(path, ur5.model, degrees=True)
    assert limits.effort[2] == 40
    assert limits.upper[2] == pytest.approx(np.pi / 2)
    assert limits.velocity[2] == ur5.limits.velocity[2]
    assert limits.velocity[3] == np.inf
    np.testing.assert_array_equal(limits.lower, ur5.limits.lower)
    np.testing.assert_array_equal(np.delete(limits.effort, 2), np.delete(ur5.limits.effort, 2))


@pytest.mark.parametrize(
    "text, said",
    [
        ("", "empty"),
        ("name,effort\n", "Name 'joint' and any of"),
        ("joint,torque\n", "Name 'joint' and any of"),
        ("joint,effort\nelbow,3\n", "Did you mean 'elbow_joint'"),
        ("joint,effort\nelbow_joint,3\nelbow_joint,4\n", "line 3: joint 'elbow_joint' has limits already"),
        ("joint,effort\nelbow_joint,x\n", "line 2, column 'effort': 'x' is not a number"),
        ("joint,effort\nelbow_joint,0\n", "cannot be a limit"),
        ("joint,effort\nelbow_joint,nan\n", "cannot be a limit"),
        ("joint,acceleration\nelbow_joint,-3\n", "line 2, column 'acceleration': '-3' cannot be a limit"),
        ("joint,jerk\nelbow_joint,fast\n", "line 2, column 'jerk': 'fast' is not a number"),
        ("joint,effort\nelbow_joint,1,2\n", "line 2 has 3 values"),
        ("joint,lower,upper\nelbow_joint,1,-1\n", "is above the upper"),
        ("joint,lower\nelbow_joint,4\n", "is above the upper"),
    ],
)
def test_bad_limit_files_are_refused(ur5, tmp_path, text, said):
    path = tmp_path / "limits.csv"
    path.write_text(text)
    with pytest.raises(TwistWrenchError, match=re.escape(said)):
        read_limits(path, ur5.model)


@pytest.mark.parametrize(
    "header, row, expected",
    [
        ("acceleration", "90", (90, 90)),
        ("acceleration,deceleration", "90,", (90, 90)),
        ("acceleration,deceleration", "90,180", (90, 180)),
    ],
)
def test_one_limit_of_acceleration_holds_for_both_ways(ur5, tmp_path, header, row, expected):
    path = tmp_path / "limits.csv"
    path.write_text(f"joint,{header}\nelbow_joint,{row}\n")
    limits = read_limits(path, ur5.model, degrees=True)
    assert np.degrees([limits.acceleration[2], limits.deceleration[2]]) == pytest.approx(expected)
    assert np.isinf(np.delete(limits.acceleration, 2)).all()


@pytest.mark.parametrize(
    "header, words",
    [
        ("acceleration", "Assumption: limits of acceleration are not judged"),
        ("acceleration,jerk", "Assumption: limits of acceleration and jerk are not judged"),
        ("velocity", "OK"),
    ],
)
def test_limits_that_are_not_judged_are_named_in_the_verdict(run, motion_file, tmp_path, header, words):
    (tmp_path / "limits.csv").write_text(f"joint,{header}\nelbow_joint{',9' * len(header.split(','))}\n")
    code, said = run("torques", "ur5", "--trajectory", motion_file, "--limits", tmp_path / "limits.csv")
    assert code == 0 and words in " ".join(said.split()), said
    assert ("not judged" in said) == (header != "velocity")


@pytest.mark.parametrize("upper, over", [(60, False), (40, True)])
def test_limits_of_the_command_are_in_the_unit_of_its_angles(run, tmp_path, upper, over):
    t = np.linspace(0, 1, 101)
    place = 25 * (1 - np.cos(np.pi * t))  # to 50 degrees
    rates = 25 * np.pi * np.sin(np.pi * t), 25 * np.pi**2 * np.cos(np.pi * t)
    table = np.column_stack([t, place, 0 * t, rates[0], 0 * t, rates[1], 0 * t])
    header = "time,joint1,joint2,joint1.vel,joint2.vel,joint1.acc,joint2.acc"
    np.savetxt(tmp_path / "m.csv", table, delimiter=",", header=header, comments="")
    (tmp_path / "limits.csv").write_text(f"joint,lower,upper,effort\njoint1,-1,{upper},60\njoint2,-1,1,60\n")
    code, said = run(
        *("torques", "planar_2r", "--degrees", "--trajectory", tmp_path / "m.csv", "--limits", tmp_path / "limits.csv")
    )
    assert code == int(over), said
    assert ("joint1 exceeds its position limit at t = 1.000 s" in said) is over, said
    assert bool(re.search(r"joint1 +position, upper \[°\] +50 +40 +1\.000", said)) is over, said


def test_positions_of_planar_and_floating_velocities_have_no_limits(tmp_path):
    urdf, path = tmp_path / "sled.urdf", tmp_path / "limits.csv"
    urdf.write_text(SLED)
    for robot, velocity in ((load(urdf), "vx"), (robots.floating_box(), "wx")):
        joint = f"{robot.model.leaders[0].joint.name}.{velocity}"
        path.write_text(f"joint,lower,upper,velocity,effort\n{joint},,inf,2,3\n")
        limits = read_limits(path, robot.model)
        assert 2.0 in limits.velocity
        assert 3.0 in limits.effort
        for row, kind in (("-1,,,", "lower"), (",1,,", "upper")):
            path.write_text(f"joint,lower,upper,velocity,effort\n{joint},{row}\n")
            with pytest.raises(ValueRangeError, match=f"line 2, column '{kind}': '{joint}' is a velocity"):
                read_limits(path, robot.model)


# ── the bundled motion ──


def test_the_bundled_motion_is_the_one_its_comments_describe():
    waypoint = re.compile(r"# t = (\S+)  q = ((?:\S+ ){6})")
    found = [m for m in map(waypoint.match, DEMO.read_text().splitlines()) if m]
    T = np.array([float(m[1]) for m in found])
    Q = np.array([[float(x) for x in m[2].split()] for m in found])
    table = np.loadtxt(DEMO, delimiter=",", skiprows=len(found) + 4)
    t = table[:, 0]
    np.testing.assert_allclose(t, np.arange(len(t)) / 125, atol=1e-12)
    k = np.clip(np.searchsorted(T, t, side="right") - 1, 0, len(T) - 2)
    span = (T[k + 1] - T[k])[:, None]
    u = (t - T[k])[:, None] / span
    way = Q[k + 1] - Q[k]
    q = Q[k] + way * (10 * u**3 - 15 * u**4 + 6 * u**5)
    dq = way / span * (30 * u**2 - 60 * u**3 + 30 * u**4)
    ddq = way / span**2 * (60 * u - 180 * u**2 + 120 * u**3)
    np.testing.assert_allclose(table[:, 1:], np.hstack([q, dq, ddq]), atol=5.001e-9)  # eight decimals


# ── memory ──

TEN_MILLION = """
import pathlib, re, sys
from click.testing import CliRunner
from twistwrench.cli.main import main
result = CliRunner().invoke(main, ["torques", "panda", "--trajectory", sys.argv[1]])
print(result.output)
# Not ru_maxrss: that starts from the size of the process that forked this one.
peak = re.search(r"VmHWM:\\s+(\\d+)", pathlib.Path("/proc/self/status").read_text())
print("code", result.exit_code, "MiB", int(peak[1]) / 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads the peak from /proc")
def test_ten_million_rows_go_through_under_a_gibibyte(tmp_path):
    t = np.arange(10000)
    q = 0.5 * np.sin(np.outer(t, np.arange(1, 8)) * 2 * np.pi / 10000) + [0, 0, 0, -1.5, 0, 1.8, 0]
    tails = [
        f"{k % 1000:03d}," + ",".join(f"{x:.6f}" for x in row) + "\n" for k, row in zip(t, q.tolist(), strict=True)
    ]
    path = tmp_path / "long.csv"
    with path.open("w") as file:
        file.write("time," + ",".join(robots.panda().joint_names) + "\n")
        for block in range(1000):
            file.write("".join(f"{block * 10 + k // 1000}.{tail}" for k, tail in enumerate(tails)))
    done = subprocess.run([sys.executable, "-c", TEN_MILLION, path], capture_output=True, text=True, check=True)
    assert "10,000,000 rows" in done.stdout
    code, memory = re.search(r"code (\d) MiB (\S+)", done.stdout).groups()
    assert code in "01"
    assert float(memory) < 1024


def test_friction_is_left_out_where_the_spline_rings_and_the_samples_stand_still(tmp_path):
    """A motion that halts, with nine decimals at 10 ms: beside the halt the spline swings by less than a sample shows."""
    t = np.arange(0, 4.0, 0.01)

    def eased(x):
        x = np.clip(x, 0, 1)
        return 10 * x**3 - 15 * x**4 + 6 * x**5

    q = 0.8 * eased(t / 1.5) - 0.8 * eased((t - 2.5) / 1.5)
    robot = robots.planar_2r().with_actuators(
        {"actuators": {j: {"friction": {"coulomb": "5 N m"}} for j in ("joint1", "joint2")}}
    )
    path = tmp_path / "halt.csv"
    rows = [f"{a:.2f},{b:.9f},{b / 3:.9f}" for a, b in zip(t, q, strict=True)]
    path.write_text("\n".join(["time,joint1,joint2", *rows]))
    plan = Differentiation.plan(MotionLog.open(path, robot.model), robot.model)
    load = LoadCase(robot)
    (states,) = plan.states(10_000)
    friction = load.terms(states)["friction"]
    halted = (t > 1.505) & (t < 2.495)
    assert np.abs(friction[halted]).max() < 1e-3
    moving = (t > 0.1) & (t < 1.4)
    np.testing.assert_allclose(friction[moving], 5.0)
    np.testing.assert_allclose(friction[(t > 2.6) & (t < 3.9)], -5.0)
