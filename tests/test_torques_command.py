"""The torques command: the files it reads and writes, its options, its exit codes, its memory."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from motions import LOAD, SLED, report_of, rough_motion, write_motion, write_positions
from twistwrench import load, robots
from twistwrench.cli import main
from twistwrench.errors import ModelWarning, TwistWrenchError, ValueRangeError
from twistwrench.report.limits_file import read_limits
from twistwrench.report.load import TERMS, parse_payload, parse_wrenches
from twistwrench.report.table_file import replacing
from twistwrench.report.tables import torque_label
from twistwrench.report.usage import in_shell_words

DEMO = Path(robots.__file__).parent / "ur5_demo.csv"


@pytest.fixture(scope="module")
def ur5():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return robots.ur5()


@pytest.fixture
def run():
    def run(*arguments):
        result = CliRunner().invoke(main, [str(a) for a in arguments])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        assert "Traceback" not in result.output
        return result.exit_code, result.output

    return run


@pytest.fixture(scope="module")
def motion():
    return rough_motion()


@pytest.fixture
def motion_file(tmp_path, ur5, motion):
    t, *columns = motion
    return write_motion(tmp_path / "motion.csv", ur5, t, columns)


# ── files ──


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
    code, text = run("torques", "ur5", "--trajectory", motion_file, "--csv", out)
    assert code == 2
    assert "line 702" in text
    assert out.read_text() == "old"
    assert {p.name for p in tmp_path.iterdir()} == {"motion.csv", "out.csv"}


def test_replacing_reports_what_cannot_be_written(tmp_path):
    for path in (tmp_path, tmp_path / "no" / "where.csv"):
        with pytest.raises(ValueRangeError, match="cannot write"), replacing(path):
            pass


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
        ("joint,effort\nelbow_joint,x\n", "line 2, column 'effort': 'x' is no number"),
        ("joint,effort\nelbow_joint,0\n", "cannot be a limit"),
        ("joint,effort\nelbow_joint,nan\n", "cannot be a limit"),
        ("joint,effort\nelbow_joint,1,2\n", "line 2 has 3 values"),
        ("joint,lower,upper\nelbow_joint,1,-1\n", "is above the upper"),
    ],
)
def test_bad_limit_files_are_refused(ur5, tmp_path, text, said):
    path = tmp_path / "limits.csv"
    path.write_text(text)
    with pytest.raises(TwistWrenchError, match=re.escape(said)):
        read_limits(path, ur5.model)


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


# ── options ──


def test_payloads_and_wrenches_are_read_as_written():
    assert parse_payload("5").mass == 5
    load = parse_payload(" 2.5,0,-.1,1e-2@tool0")
    assert (load.mass, load.place, load.frame) == (2.5, (0.0, -0.1, 0.01), "tool0")
    wrenches = parse_wrenches(["a:1,2,3,4,5,6", "ns:b:0,0,0,0,0,1", "a:1,1,1,1,1,1"])
    np.testing.assert_array_equal(wrenches["a"], [2, 3, 4, 5, 6, 7])
    np.testing.assert_array_equal(wrenches["ns:b"], [0, 0, 0, 0, 0, 1])


BAD_INPUT = {
    "no such robot": (["nobot", "--trajectory", DEMO], "no robot file 'nobot'"),
    "no such motion": (["ur5", "--trajectory", "none.csv"], "no motion file"),
    "no bundled motion": (["panda", "--trajectory", "demo"], "no motion is bundled with 'panda'. With: ur5"),
    "payload words": (["ur5", "--trajectory", DEMO, "--payload", "heavy"], "'heavy' is no number"),
    "payload pair": (["ur5", "--trajectory", DEMO, "--payload", "1,2"], "has 2 numbers"),
    "payload below zero": (["ur5", "--trajectory", DEMO, "--payload", "-1"], "negative mass"),
    "payload infinite": (["ur5", "--trajectory", DEMO, "--payload", "inf"], "not finite"),
    "payload nowhere": (["ur5", "--trajectory", DEMO, "--payload", "1@hand"], "no frame named 'hand'"),
    "payload at nothing": (["ur5", "--trajectory", DEMO, "--payload", "1@"], "names no frame"),
    "wrench without frame": (["ur5", "--trajectory", DEMO, "--wrench-on-robot", "1,2,3,4,5,6"], "names no frame"),
    "wrench too short": (["ur5", "--trajectory", DEMO, "--wrench-on-robot", "tool0:1,2,3"], "has 3 numbers, not 6"),
    "wrench nowhere": (["ur5", "--trajectory", DEMO, "--wrench-on-robot", "hand:0,0,0,0,0,1"], "no frame named 'hand'"),
    "lock nothing": (["ur5", "--trajectory", DEMO, "--lock", "elbow_joint"], "is not JOINT=VALUE"),
    "lock unknown": (["ur5", "--trajectory", DEMO, "--lock", "elbow=1"], "elbow"),
    "locked twice": (["ur5", "--trajectory", DEMO, *("--lock", "elbow_joint=0") * 2], "is given twice"),
    "demo in degrees": (["ur5", "--trajectory", "demo", "--degrees"], "is in radians"),
    "wrench without numbers": (["ur5", "--trajectory", DEMO, "--wrench-on-robot", "tool0"], "lacks the numbers"),
    "no such picture folder": (["ur5", "--trajectory", DEMO, "--plot", "no/such/o.png"], "cannot write"),
    "no such option": (["ur5", "--trajectory", DEMO, "--plott", "o.png"], "--plot"),
    "no trajectory": (["ur5"], "Missing option '--trajectory'"),
    "split without csv": (["ur5", "--trajectory", DEMO, "--split"], "Add --csv"),
    "no such folder": (["ur5", "--trajectory", DEMO, "--csv", "no/such/folder/o.csv"], "cannot write"),
    "no such picture": (["ur5", "--trajectory", DEMO, "--plot", "o.xyz"], "pictures of kind 'xyz'"),
    "no such limits": (["ur5", "--trajectory", DEMO, "--limits", "none.csv"], "no limits file"),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_exits_2_with_one_line(run, case):
    arguments, said = BAD_INPUT[case]
    if "--plot" in arguments:
        pytest.importorskip("matplotlib")
    code, text = run("torques", *arguments)
    assert code == 2, text
    (line,) = [x for x in text.splitlines() if x.startswith("error: ")]
    assert said in line


def test_a_motion_within_limits_exits_0(run, tmp_path):
    code, text = run("torques", "ur5", "--trajectory", "demo", "--payload", "5")
    assert code == 0, text
    assert "OK: nearest to its limit is shoulder_lift_joint" in text
    assert "derived by a quintic spline" in text


@pytest.mark.parametrize(
    "row, said",
    [
        (
            "shoulder_lift_joint,,,,80",
            r"OVER LIMIT: shoulder_lift_joint at t = \d\.\d+ s takes −114\.6 N m, limit 80 \(143 %\)",
        ),
        ("elbow_joint,,1,,", "OVER LIMIT: elbow_joint at t = .* passes its position limit"),
        ("elbow_joint,,,0.5,", "OVER LIMIT: elbow_joint at t = .* passes its velocity limit"),
    ],
)
def test_a_limit_passed_exits_1_and_says_which(run, tmp_path, row, said):
    limits = tmp_path / "limits.csv"
    limits.write_text(f"joint,lower,upper,velocity,effort\n{row}\n")
    code, text = run("torques", "ur5", "--trajectory", "demo", "--payload", "5", "--limits", limits)
    assert code == 1
    assert re.search(said, " ".join(text.split()))


def test_degrees_and_radians_give_the_same_torques(run, ur5, motion, tmp_path, motion_file):
    t, *columns = motion
    turned = write_motion(tmp_path / "degrees.csv", ur5, t, [np.degrees(c) for c in columns])
    run("torques", "ur5", "--trajectory", motion_file, "--csv", tmp_path / "a.csv")
    run("torques", "ur5", "--trajectory", turned, "--degrees", "--csv", tmp_path / "b.csv")
    a, b = (np.loadtxt(tmp_path / f"{x}.csv", delimiter=",", skiprows=1) for x in "ab")
    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_a_locked_joint_needs_no_column(run, ur5, motion, tmp_path):
    t, *columns = motion
    locked = ur5.lock({"wrist_3_joint": 0.5})
    path = write_motion(tmp_path / "m.csv", locked, t, [c[:, :5] for c in columns])
    for value, flags in (("0.5", []), (repr(float(np.degrees(0.5))), ["--degrees"])):
        code, text = run("info", "ur5", "--lock", f"wrist_3_joint={value}", *flags)
        assert code == 0, text
        assert "5 moving bodies" in text
    assert run("torques", "ur5", "--trajectory", path, "--lock", "wrist_3_joint=0.5")[0] in (0, 1)


def test_gaps_in_time_are_told(run, ur5, motion, tmp_path):
    _, *columns = motion
    t = np.arange(700) * 0.01
    t[400:] += 0.2
    _, text = run("torques", "ur5", "--trajectory", write_motion(tmp_path / "m.csv", ur5, t, columns))
    assert "Time jumps 1 time by more than 5 usual steps; the longest gap is 0.21 s, after t = 3.9900 s" in " ".join(
        text.split()
    )


def test_a_noisy_log_is_told_and_smoothing_offered(run, tmp_path):
    t = np.arange(3000) * 1e-3
    q = 0.5 * np.sin(np.outer(t, np.arange(1, 7))) - 0.5
    path = tmp_path / "m.csv"
    np.savetxt(
        path, np.column_stack([t, q]), "%.5f", ",", header="time," + ",".join(robots.ur5().joint_names), comments=""
    )
    _, text = run("torques", "ur5", "--trajectory", path)
    said = " ".join(text.split())
    assert "on a grid of 1e-05" in said
    assert "Try --smooth" in said
    _, text = run("torques", "ur5", "--trajectory", path, "--smooth")
    said = " ".join(text.split())
    assert "after smoothing to the noise found" in said
    assert "Try --smooth" not in said


def test_the_plot_is_a_picture(run, ur5, motion_file, tmp_path):
    pytest.importorskip("matplotlib")
    for suffix, magic in (("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")):
        path = tmp_path / f"out.{suffix}"
        run("torques", "ur5", "--trajectory", motion_file, "--payload", "5", "--plot", path)
        assert path.read_bytes().startswith(magic)


def test_info_tells_what_a_robot_is_made_of(run, ur5):
    code, text = run("info", "ur5", "--degrees")
    assert code == 0
    for name in (*ur5.joint_names, *ur5.frame_names):
        assert name in text
    moving = sum(b.inertia.mass for b in ur5.model.bodies)
    assert f"mass {moving:.4g} kg moving" in text
    assert "360" in text


@pytest.mark.parametrize("flags, offset", [([], "+0.2"), (["--degrees"], "+11.459")])
def test_info_tells_whom_a_joint_follows_and_no_limits_of_its_own(run, tmp_path, flags, offset):
    text = robots.path_of("planar_2r").read_text()
    mimic = '<mimic joint="joint1" multiplier="-2" offset="0.2"/>'
    head, tail = text.split('<joint name="joint2"', 1)
    path = tmp_path / "follower.urdf"
    path.write_text(head + '<joint name="joint2"' + tail.replace("</joint>", mimic + "</joint>", 1))
    code, said = run("info", path, *flags)
    assert code == 0, said
    lines = said.splitlines()
    k = next(k for k, line in enumerate(lines) if line.split()[:1] == ["joint2"])
    assert lines[k].split()[1] == "continuous,"
    assert f"follows -2 × joint1 {offset}" in lines[k + 1]
    assert len(lines[k].split()) == 3  # name, kind, link


def test_names_are_not_taken_for_markup(run, tmp_path):
    text = robots.path_of("planar_2r").read_text().replace("joint1", "[red]1").replace("joint2", "[/]2")
    path = tmp_path / "odd.urdf"
    path.write_text(text)
    motion = tmp_path / "m.csv"
    motion.write_text("time,[red]1,[/]2,[red]1.vel,[/]2.vel,[red]1.acc,[/]2.acc\n0,0,0,0,0,0,0\n")
    limits = tmp_path / "l.csv"
    limits.write_text("joint,lower\n[/]2,0.5\n")
    for arguments in (("info", path), ("torques", path, "--trajectory", motion, "--limits", limits)):
        code, text = run(*arguments)
        assert code == (0 if arguments[0] == "info" else 1)
        assert "[red]1" in text
        assert "[/]2" in text


def test_a_floating_base_is_held_up_against_gravity_and_its_acceleration(run, tmp_path):
    box = robots.floating_box()
    t = np.arange(500) * 0.01
    still = np.broadcast_to(box.neutral[:6], (500, 6))
    path, out = tmp_path / "box.csv", tmp_path / "out.csv"
    table = np.column_stack([t, still, 0.5 * np.sin(2 * t)])
    np.savetxt(path, table, "%.17g", ",", header="time," + ",".join(box.coordinate_names), comments="")
    code, text = run("torques", "floating_box", "--trajectory", path, "--csv", out)
    assert code == 0, text
    assert "torque limits are not known" in text
    force = np.loadtxt(out, delimiter=",", skiprows=1)[:, 1:]
    np.testing.assert_allclose(force[5:-5, 5], 6.0 * (9.81 - 2.0 * np.sin(2 * t[5:-5])), rtol=1e-5)
    np.testing.assert_allclose(force[:, :5], 0, atol=1e-7)


def test_one_row_is_enough_where_rates_are_given(run, ur5, motion, tmp_path):
    t, *columns = motion
    path = write_motion(tmp_path / "m.csv", ur5, t[:1], [c[:1] for c in columns])
    code, text = run("torques", "ur5", "--trajectory", path, "--plot", tmp_path / "o.png")
    assert code in (0, 1), text
    assert "1 row " in text


def test_the_module_runs_as_a_program():
    done = subprocess.run([sys.executable, "-m", "twistwrench", "--help"], capture_output=True, text=True, check=True)
    for command in ("torques", "info", "verify"):
        assert command in done.stdout


def test_help_imports_nothing_heavy():
    code = "import sys, twistwrench.cli; print([m for m in ('scipy', 'llvmlite', 'rich', 'matplotlib') if m in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )


# ── the bundled motion ──


def test_the_bundled_motion_is_the_one_its_comments_describe():
    waypoint = re.compile(r"# t = (\S+)  q = ((?:\S+ ){6})")
    found = [m for m in map(waypoint.match, DEMO.read_text().splitlines()) if m]
    T = np.array([float(m[1]) for m in found])
    Q = np.array([[float(x) for x in m[2].split()] for m in found])
    table = np.loadtxt(DEMO, delimiter=",", skiprows=len(found) + 3)
    t = table[:, 0]
    np.testing.assert_allclose(t, np.arange(len(t)) / 125, atol=1e-12)
    k = np.clip(np.searchsorted(T, t, side="right") - 1, 0, len(T) - 2)
    u = ((t - T[k]) / (T[k + 1] - T[k]))[:, None]
    np.testing.assert_allclose(table[:, 1:], Q[k] + (Q[k + 1] - Q[k]) * (10 * u**3 - 15 * u**4 + 6 * u**5), atol=1e-10)


# ── memory ──

TEN_MILLION = """
import pathlib, re, sys
from click.testing import CliRunner
from twistwrench.cli import main
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


# ── what a user meets ──


def still_file(tmp_path, robot, rows=200):
    q = np.tile([0.3, -0.3, 0.7], 4)[: robot.nq] * np.ones((rows, 1))
    return write_positions(tmp_path / "still.csv", robot, np.arange(rows) * 0.01, q)


@pytest.fixture
def rubbing(tmp_path):
    """A planar arm in the plane of gravity, with friction in every joint."""
    text = robots.path_of("planar_2r").read_text()
    text = re.sub(r"<dynamics[^>]*/>", "", text)
    path = tmp_path / "rubbing.urdf"
    path.write_text(re.sub(r"</joint>", '<dynamics friction="1" damping="1"/></joint>', text))
    return path


def test_a_joint_at_rest_has_no_coulomb_friction(run, rubbing, tmp_path):
    robot, out = load(rubbing), tmp_path / "o.csv"
    assert robot.model.friction.all()
    code, text = run("torques", rubbing, "--trajectory", still_file(tmp_path, robot), "--csv", out)
    assert code == 0, text
    assert "Coulomb friction is undetermined" in text
    found = np.loadtxt(out, delimiter=",", skiprows=1)[:, 1:]
    held = np.broadcast_to(robot.gravity_forces(np.array([0.3, -0.3])), found.shape)
    np.testing.assert_allclose(found, held, atol=1e-7)


def test_a_joint_that_moves_has_coulomb_friction(run, rubbing, tmp_path):
    robot, out = load(rubbing), tmp_path / "o.csv"
    t = np.arange(200) * 0.01
    path = write_positions(tmp_path / "m.csv", robot, t, np.outer(t, [0.1, -0.2]))
    run("torques", rubbing, "--trajectory", path, "--csv", out, "--split")
    lines = out.read_text().splitlines()[0].split(",")
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    for joint, v in zip(robot.joint_names, (0.1, -0.2), strict=True):
        np.testing.assert_allclose(table[:, lines.index(f"{joint}.friction")], v + np.sign(v), atol=1e-9)


def test_smoothing_tells_of_the_glitch_it_removes(run, ur5, tmp_path):
    t = np.arange(400) * 0.01
    q = 0.3 * np.sin(np.outer(t, np.arange(1, 7) * 0.5)) + 1e-3 * np.random.default_rng(3).normal(size=(400, 6))
    flags = ("torques", "ur5", "--trajectory", tmp_path / "m.csv", "--smooth")
    write_positions(tmp_path / "m.csv", ur5, t, q)
    assert "flattened" not in run(*flags)[1]
    q[160, 2] += 0.5
    write_positions(tmp_path / "m.csv", ur5, t, q)
    said = " ".join(run(*flags)[1].split())
    assert "flattened" in said
    at = re.search(r"elbow_joint at t = 1\.6000 s off by (\S+)", said)
    assert float(at[1]) == pytest.approx(0.5, rel=0.2)
    assert "UNSURE" in said


def noisy_still(tmp_path, robot):
    t = np.arange(400) * 0.01
    q = np.array([0, -1.0, 1, 0, 0, 0]) + 1e-5 * np.random.default_rng(5).normal(size=(400, 6))
    return write_positions(tmp_path / "m.csv", robot, t, q)


@pytest.mark.parametrize("share, said, code", [(1.002, "UNSURE", 0), (0.998, "by less than its noise", 1)])
def test_a_verdict_within_noise_says_so(run, ur5, tmp_path, share, said, code):
    path = noisy_still(tmp_path, ur5)
    joint = report_of(ur5, path).joints[1]
    assert joint.uncertainty > 0.002 * abs(joint.peak)
    limits = tmp_path / "l.csv"
    limits.write_text(f"joint,effort\nshoulder_lift_joint,{abs(joint.peak) * share!r}\n")
    found, text = run("torques", "ur5", "--trajectory", path, "--limits", limits)
    assert said in " ".join(text.split())
    assert found == code
    assert "± 1σ" in text


def test_units_in_doubt_are_asked_about(run, ur5, motion, tmp_path):
    t, q, *_ = motion
    turned = write_positions(tmp_path / "d.csv", ur5, t, 90 * q)
    assert "Did you mean --degrees?" in run("torques", "ur5", "--trajectory", turned)[1]
    assert "Did you mean --degrees?" not in run("torques", "ur5", "--trajectory", turned, "--degrees")[1]
    slow = write_positions(tmp_path / "ms.csv", ur5, 1000 * t, q)
    assert "Is time in ms?" in run("torques", "ur5", "--trajectory", slow)[1]


def test_a_lock_outside_the_limits_is_noted(run):
    assert "outside the joint's limits" in run("info", "ur5", "--lock", "elbow_joint=9")[1]
    assert "outside the joint's limits" in run("info", "ur5", "--lock", "elbow_joint=200", "--degrees")[1]
    assert "outside the joint's limits" not in run("info", "ur5", "--lock", "elbow_joint=1")[1]


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


def test_columns_of_locked_joints_and_others_are_ignored_with_a_note(run, ur5, motion, motion_file, tmp_path):
    code, text = run("torques", "ur5", "--trajectory", motion_file, "--lock", "elbow_joint=1")
    assert code in (0, 1), text
    assert "Columns of locked joints are ignored: elbow_joint, elbow_joint.vel" in " ".join(text.split())
    lines = motion_file.read_text().splitlines()
    path = tmp_path / "x.csv"
    path.write_text("\n".join([lines[0] + ",temp", *(f"{x},20" for x in lines[1:])]) + "\n")
    said = " ".join(run("torques", "ur5", "--trajectory", path)[1].split())
    assert "no coordinate of this robot are ignored: temp." in said


def test_a_robot_without_joints_has_nothing_to_verify(run):
    lock = [x for k in ("joint1", "joint2") for x in ("--lock", f"{k}=0")]
    code, text = run("verify", "planar_2r", *lock)
    assert code == 2
    assert "nothing to check" in text


def test_errors_speak_of_the_shells_options():
    for text, said in (
        ("load with inertia='repair' to", "load with --inertia repair to"),
        ("Pass frame=…, or load with tip=….", "Name one with --tip FRAME."),
        ("the name that floating_base=True gives", "the name that --floating-base gives"),
    ):
        assert said in in_shell_words(text)


def test_a_payload_on_the_base_and_a_limit_of_none_are_noted_once(run, motion_file, tmp_path):
    limits = tmp_path / "l.csv"
    limits.write_text("joint,effort\nelbow_joint,inf\n")
    flags = ("--payload", "5@base_link", "--limits", limits)
    said = " ".join(run("torques", "ur5", "--trajectory", motion_file, *flags)[1].split())
    assert "rests on the fixed base and loads no joint" in said
    assert "No torque limit is known for elbow_joint." in said
    assert "Give one with --limits" not in said


def test_a_joint_is_named_once_in_the_verdict(run, motion_file, tmp_path):
    limits = tmp_path / "l.csv"
    limits.write_text("joint,lower,upper,velocity\nelbow_joint,-0.1,0.1,0.1\n")
    said = " ".join(run("torques", "ur5", "--trajectory", motion_file, "--limits", limits)[1].split())
    assert said[said.rindex("OVER LIMIT") :].count("elbow_joint") <= 2


def test_a_zero_quaternion_is_refused_by_line(run, tmp_path):
    box = robots.floating_box()
    q = np.tile(box.neutral, (10, 1))
    q[6, :4] = 0
    path = write_positions(tmp_path / "b.csv", box, np.arange(10) * 0.1, q)
    code, text = run("torques", "floating_box", "--trajectory", path)
    assert code == 2
    assert "line 8, column" in text
    assert "quaternion is zero" in text


def test_info_names_a_defect_once(run, tmp_path):
    text = robots.path_of("planar_2r").read_text()
    path = tmp_path / "odd.urdf"
    path.write_text(re.sub(r'ixx="[^"]*"', 'ixx="99"', text, count=1))
    said = run("info", path, "--inertia", "accept")[1]
    assert said.count("triangle inequality") == 1


def test_lines_break_at_gaps_and_labels_are_the_tables(ur5, motion, tmp_path):
    pytest.importorskip("matplotlib")
    from twistwrench.report.plot import _broken, _title

    time, curve = _broken(np.r_[0:5, 20:25] * 1.0, 5.0, np.arange(10.0))
    assert np.flatnonzero(np.isnan(curve)).tolist() == [5]
    assert len(time) == 11
    t, *columns = motion
    path = write_motion(tmp_path / "m.csv", ur5, t, columns)
    report = report_of(ur5, path, friction=False, wrenches={"tool0": np.ones(6)})
    assert _title(report) == "ur5 · m · wrench on tool0 · without friction"
    assert torque_label(report, 1342.0) == "1342"
    assert torque_label(report, 1e-9 * report.scale) == "0"


def test_rounding_is_printed_as_no_torque_and_raises_no_alarm(run, ur5, tmp_path):
    t = np.arange(300) * 0.01
    q = np.tile([0.0, -1.0, 1.0, 0, 0, 0], (300, 1))
    path = write_positions(tmp_path / "m.csv", ur5, t, q + 1e-14 * np.random.default_rng(2).normal(size=q.shape))
    said = run("torques", "ur5", "--trajectory", path)[1]
    assert "Try --smooth" not in said
    assert re.search(r"shoulder_pan_joint .* –", said.split("made of")[1])
