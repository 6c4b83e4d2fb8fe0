"""Torque limits: none, some, placeholders, degrees; and what an OK has to say of what was left out."""

from __future__ import annotations

import math
import pickle
import re
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from places import SHARED
from robot_files import FILES

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.motion.credible_values import arm_entries, placeholder_limits, weight_share
from twistwrench.motion.limits_file import read_limits

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

T = np.arange(0, 4, 0.01)
S = (T / 4) ** 3 * (10 - 15 * T / 4 + 6 * (T / 4) ** 2)


def link(name, mass=1.0, length=1.0):
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/><inertia ixx="{0.01 * mass}" '
        f'iyy="{0.01 * mass}" izz="{0.01 * mass}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name, parent, child, effort, *, x=0.0, rpy="0 0 0", inside=""):
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{x} 0 0" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 1 0"/><limit lower="-3.1" upper="3.1" velocity="5" effort="{effort}"/>'
        f"{inside}</joint>"
    )


def arm(efforts=(30, 10), *, extra="", rpy="0 0 0"):
    """Two links of 1 kg and 1 m that turn about y; stretched out, gravity takes 19.6 and 4.9 N m."""
    tool = '<link name="tool"/><joint name="tf" type="fixed"><origin xyz="1 0 0"/><parent link="l2"/><child link="tool"/></joint>'
    return (
        f'<robot name="arm2"><link name="base"/>{link("l1")}{link("l2")}{joint("shoulder", "base", "l1", efforts[0], rpy=rpy)}'
        f"{joint('elbow', 'l1', 'l2', efforts[1], x=1)}{tool}{extra}</robot>"
    )


def table(path, *columns, head="time,shoulder,elbow"):
    np.savetxt(path, np.c_[columns], delimiter=",", header=head, comments="", fmt="%.9g")


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A command run in a folder with the motion ok.csv: exit code and all that it prints, in one line."""
    monkeypatch.chdir(tmp_path)
    table("ok.csv", T, S, 0.3 + 0.5 * S)

    def run(*arguments):
        result = CliRunner().invoke(main, list(map(str, arguments)), env={"COLUMNS": "200"})
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        said = "\n".join(line for line in result.output.splitlines() if not line.startswith("note: robot"))
        return int(result.exit_code), " ".join(said.split())

    return run


COMMANDS = {
    "torques": ("torques", "arm.urdf", "--trajectory", "ok.csv"),
    "torques with a payload": ("torques", "arm.urdf", "--trajectory", "ok.csv", "--payload", 0.2),
    "payload": ("payload", "arm.urdf"),
    "move": ("move", "arm.urdf", "--to", "1,0.8", "--duration", 4),
}
COUNTS = {(30, 10): 0, (0, 10): 1, (30, 0): 1, (0, 0): 2}

# ── no limits, or some ──


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("efforts", COUNTS)
def test_no_ok_unless_each_loaded_joint_has_a_limit(run, tmp_path, command, efforts):
    (tmp_path / "arm.urdf").write_text(arm(efforts))
    code, said = run(*COMMANDS[command])
    if COUNTS[efforts]:
        assert (code, said.startswith(f"UNSURE: no torque limit for {COUNTS[efforts]} of 2 joints")) == (1, True), said
        assert "'twistwrench info arm.urdf --csv limits.csv'" in said and "--limits limits.csv" in said
    else:
        assert code == 0 and not said.startswith("UNSURE"), said


def test_a_thousand_kilograms_are_not_ok(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm((0, 0)))
    code, said = run("torques", "arm.urdf", "--trajectory", "ok.csv", "--payload", 1000, "--csv", "out.csv")
    assert code == 1 and said.startswith("UNSURE: the payload of 1000 kg is more than 100 times as heavy"), said
    assert "no torque limit for 2 of 2 joints" in said
    assert len((tmp_path / "out.csv").read_text().splitlines()) == 401
    assert re.search(r"shoulder -?\d+\.?\d* ", said)  # the table of peaks


def test_the_line_of_help_works(run, tmp_path):
    """The table that info writes is read by --limits, with its efforts filled in or not."""
    (tmp_path / "arm.urdf").write_text(arm((0, 10)))
    code, said = run("info", "arm.urdf", "--csv", "limits.csv")
    assert code == 0 and said.endswith("wrote limits.csv")
    written = (tmp_path / "limits.csv").read_text()
    assert run("info", "arm.urdf", "--csv", "-")[1] == " ".join(written.split())
    for command in COMMANDS.values():
        code, said = run(*command, "--limits", "limits.csv")
        assert code == 1 and said.startswith("UNSURE: no torque limit for 1 of 2 joints (shoulder)"), said
    (tmp_path / "limits.csv").write_text(written.replace("-3.1,3.1,5.0,,", "-3.1,3.1,5.0,30,"))
    for command in COMMANDS.values():
        code, said = run(*command, "--limits", "limits.csv")
        assert code == 0 and not said.startswith("UNSURE"), said


def test_what_nothing_drives_and_what_nothing_loads_is_not_asked_for(run, tmp_path):
    text = arm((30, 10)).replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/>')
    spin = joint("spin", "tool", "disc", 0).replace('xyz="0 1 0"', 'xyz="1 0 0"')
    disc = '<link name="disc"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    (tmp_path / "arm.urdf").write_text(text.replace("</robot>", disc + spin + "</robot>"))
    table("spin.csv", T, S, 0.3 + 0.5 * S, 0 * T, head="time,shoulder,elbow,spin")
    code, said = run("torques", "arm.urdf", "--trajectory", "spin.csv")
    assert code == 0 and said.startswith("OK: "), said
    (tmp_path / "float.urdf").write_text(arm((300, 100)))
    robot = tw.load(tmp_path / "float.urdf", floating_base=True)
    report = run("move", "float.urdf", "--floating-base", "--to", "elbow=0.5", "--duration", 4)[1]
    assert "no torque limit" not in report.lower() and robot.nv == 8


@pytest.mark.parametrize("duration", [1, 20])
@pytest.mark.parametrize("efforts", [(0, 10), (0, 0)])
def test_move_and_torques_count_the_same_joints_of_the_same_motion(run, tmp_path, efforts, duration):
    """The spin about the upright base is loaded by inertia alone, which fades where the motion is slow."""
    base = link("turning", 1.0, 0.2) + joint("spin", "base", "turning", 0).replace('xyz="0 1 0"', 'xyz="0 0 1"')
    text = arm(efforts, extra=base).replace(
        'name="shoulder" type="revolute"><origin xyz="0.0', 'name="shoulder" type="revolute"><origin xyz="0.2'
    )
    (tmp_path / "arm.urdf").write_text(
        text.replace('<parent link="base"/><child link="l1"/>', '<parent link="turning"/><child link="l1"/>')
    )
    for to in ("spin=1", "elbow=0.8"):
        first = []
        planned = run("move", "arm.urdf", "--to", to, "--duration", duration, "--csv", "move.csv", "--overwrite")
        for code, said in (planned, run("torques", "arm.urdf", "--trajectory", "move.csv")):
            words = re.match(r"(UNSURE: no torque limit for [^,;]*|OVER LIMIT|OK)", said)
            assert words, said
            first.append((code, words[1]))
        assert first[0] == first[1]


@pytest.mark.parametrize("efforts", [(0, 10), (30, 0), (0, 0)])
def test_no_payload_figure_without_the_limit_of_each_loaded_joint(run, tmp_path, efforts):
    (tmp_path / "arm.urdf").write_text(arm(efforts))
    for command in ("torques with a payload", "payload"):
        _, said = run(*COMMANDS[command])
        assert "largest payload" not in said and "Maximum payload" not in said, said


@pytest.mark.parametrize(("text", "figure"), [("none", False), ("some", False), ("placeholders", True)])
def test_an_overload_has_a_payload_figure_if_each_loaded_joint_has_a_limit(run, tmp_path, text, figure):
    """Doubted limits count: the load is beyond them, and the figure is by the same limits."""
    robots = {"none": arm((0, 0)), "some": arm((0, 10)), "placeholders": small(35)}
    (tmp_path / "arm.urdf").write_text(robots[text])
    table("small.csv", T, S, 0 * T, 0 * T, head="time,j1,j2,j3")
    file = "small.csv" if text == "placeholders" else "ok.csv"
    code, said = run("torques", "arm.urdf", "--trajectory", file, "--payload", 60)
    assert code == 1 and said.startswith("UNSURE: " if text == "none" else "OVER LIMIT: "), said
    assert ("Maximum payload on this path" in said) == figure, said


ELASTIC = "actuators: {elbow: {ratio: 50, stiffness: 800 N m/rad, rotor: {inertia: 1 kg cm^2, extra: true}}}"


@pytest.mark.parametrize(("effort", "code"), [(0, 1), (10, 0)])
def test_the_motor_of_an_elastic_joint_needs_a_limit_where_its_spring_is_loaded(run, tmp_path, effort, code):
    (tmp_path / "arm.urdf").write_text(arm((30, effort)))
    (tmp_path / "elastic.yaml").write_text(ELASTIC)
    found, report = run("payload", "arm.urdf", "--actuators", "elastic.yaml")
    assert found == code and ("no torque limit for 1 of 2 joints (elbow.motor)" in report) == (code == 1), report


@pytest.mark.parametrize(("effort", "code"), [(0, 1), (10, 0)])
def test_an_elastic_joint_counts_once_in_every_command(run, tmp_path, effort, code):
    """The spring is not driven, so it needs no limit; the motor behind it does, also where the motor itself rests."""
    (tmp_path / "arm.urdf").write_text(arm((30, effort)))
    (tmp_path / "elastic.yaml").write_text(ELASTIC)
    for command in (
        COMMANDS["torques"],
        COMMANDS["torques with a payload"],
        ("move", "arm.urdf", "--to", "shoulder=1", "--duration", 4),
    ):
        found, said = run(*command, "--actuators", "elastic.yaml")
        said = said.removeprefix("note: the elastic gears of elbow are taken to be stiff. ")
        word = "UNSURE: no torque limit for 1 of 2 joints (elbow" if code else "OK: "
        assert found == code and said.startswith(word), said


def test_placeholders_of_joints_with_a_spring_are_not_doubted(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(small(35))
    (tmp_path / "elastic.yaml").write_text(ELASTIC.replace("elbow", "j2"))
    for more, code, word in (
        ((), 1, "UNSURE: effort 35 on all 3 joints"),
        (("--actuators", "elastic.yaml"), 0, "OK: "),
    ):
        found, said = run("move", "arm.urdf", "--to", "j1=1", "--duration", 4, *more)
        assert found == code and said.startswith(word), said


# ── an upright arm ──


def test_an_upright_arm_does_not_limit_its_payload(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(rpy="0 -1.5707963 0"))
    code, said = run("payload", "arm.urdf", "--at", "0,0")
    assert (code, said.startswith("OK: the payload is not limited at this pose")) == (0, True), said
    assert "e+07" not in said
    code, said = run("payload", "arm.urdf", "--at", "1e-4,0")  # this lever of 0.2 mm is one
    assert code == 0 and re.search(r"pose: (5\.\d+e\+04 kg|\d{5} kg)", said), said
    found = tw.statics.largest_payload(tw.load(tmp_path / "arm.urdf"), [0.0, 0.0])
    assert np.isinf(found.mass) and "not limited at this pose" in str(found)


def test_nor_does_a_motion_that_stands_upright(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(rpy="0 -1.5707963 0"))
    table("up.csv", T, 0 * T, 0 * T)
    code, said = run("torques", "arm.urdf", "--trajectory", "up.csv", "--payload", 1)
    assert code == 0 and "Maximum payload" not in said, said


# ── joints held still although columns that vary are not used ──

UR5 = tw.robots.ur5().joint_names


def ur5_rows():
    motion = tw.Motion.from_file(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), tw.robots.ur5())
    return np.c_[motion.time, motion.q]


def test_lock_missing_is_not_offered_while_columns_that_vary_are_unused(run):
    table("log.csv", ur5_rows(), head="time,pan,lift,elbow,w1,w2,w3")
    code, said = run("torques", "ur5", "--trajectory", "log.csv", "--payload", 2)
    assert code == 2 and "--lock-missing" not in said and "--columns" in said, said
    assert "columns that vary and are not used: pan, lift, w1, w3" in said
    code, said = run("torques", "ur5", "--trajectory", "log.csv", "--payload", 2, "--lock-missing")
    said = said[said.index("LOOK AGAIN") :]
    assert code == 1 and said.startswith("LOOK AGAIN: 1 of 6 joints checked: "), said
    assert "pan, lift, w1, w3" in said and "Maximum payload" not in said


@pytest.mark.parametrize("beside", [None, "elbow_temperature [K]"])
def test_an_ok_says_how_many_joints_were_checked(run, beside):
    rows = ur5_rows()[:, :5]
    more = [] if beside is None else [310 + rows[:, 0]]
    table("log.csv", rows, *more, head=",".join(["time", *UR5[:4], *([beside] if beside else [])]))
    assert "--lock wrist_2_joint=0,wrist_3_joint=0" in run("torques", "ur5", "--trajectory", "log.csv")[1]
    code, said = run("torques", "ur5", "--trajectory", "log.csv", "--lock-missing")
    said = said[said.index("OK: ") :]
    assert code == 0 and ". Assumption: 4 of 6 joints checked, and wrist_2_joint, wrist_3_joint held still." in said, (
        said
    )


def test_what_was_assumed_is_counted_in_the_first_line(run, tmp_path):
    """The payload's frame, where the file has several tips apart from each other, and friction left out on request."""
    second = '<link name="probe"/><joint name="pf" type="fixed"><origin xyz="1.3 0 0"/><parent link="l2"/><child link="probe"/></joint>'
    text = arm((60, 30), extra=second).replace('effort="60"/>', 'effort="60"/><dynamics friction="0.5"/>')
    (tmp_path / "arm.urdf").write_text(text)
    command = ("torques", "arm.urdf", "--trajectory", "ok.csv", "--payload")
    for load, flags, words in (
        ("0.5", (), ". Assumption: 0.5 kg at probe (one of 2 tips; --tip)."),
        ("0.5", ("--no-friction",), ". 2 assumptions, the first: 0.5 kg at probe (one of 2 tips; --tip)."),
        ("0.5@tool", ("--no-friction",), ". Assumption: joint friction is left out."),
        ("0.5@tool", (), ""),
        ("0.5", ("--tip", "tool"), ""),
    ):
        code, said = run(*command, load, *flags)
        first = said[: said.index("Maximum payload")]
        assert code == 0 and ("ssumption" in first) == bool(words) and words in first, said


# ── a limits file in degrees ──


@pytest.mark.parametrize("command", ["torques", "payload", "move"])
def test_limits_in_degrees_are_found(run, tmp_path, command):
    (tmp_path / "arm.urdf").write_text(arm())
    rows = "joint,lower,upper,velocity,effort\nshoulder,-180,180,300,30\nelbow,-180,180,300,10\n"
    (tmp_path / "limits.csv").write_text(rows)
    code, said = run(*COMMANDS[command], "--limits", "limits.csv")
    assert code == 1 and said.startswith("LOOK AGAIN"), said
    assert "position look like degrees: 180 for 'shoulder'" in said and "upper [deg]" in said, said
    (tmp_path / "limits.csv").write_text(rows.replace("180", "3.14").replace("300", "5"))
    assert run(*COMMANDS[command], "--limits", "limits.csv")[0] == 0
    (tmp_path / "limits.csv").write_text(rows.replace("180", "inf"))
    code, said = run(*COMMANDS[command], "--limits", "limits.csv")
    assert code == 1 and "velocity look like degrees: 300 for 'shoulder' is 47.7 turns a second" in said, said
    (tmp_path / "limits.csv").write_text(rows.replace("180", "inf").replace("velocity", "velocity [rad/s]"))
    assert run(*COMMANDS[command], "--limits", "limits.csv")[0] == 0


@pytest.mark.parametrize(
    "head, row, velocity",
    [
        ("joint,velocity [deg/s]", "shoulder,180", math.pi),
        ("joint,velocity [rad/s]", "shoulder,180", 180.0),
        ("joint,velocity (rpm)", "shoulder,30", math.pi),
        ("joint,unit,velocity", "shoulder,deg,180", math.pi),
        ("joint,unit,velocity", "shoulder,rad,3", 3.0),
        ("joint,unit,velocity", "shoulder,,3", 3.0),
    ],
)
@pytest.mark.parametrize("degrees", [False, True])
def test_the_unit_of_a_limit_is_that_of_its_head_or_row_before_that_of_the_command(
    head, row, velocity, degrees, tmp_path
):
    (tmp_path / "limits.csv").write_text(f"{head}\n{row}\n")
    limits = read_limits(tmp_path / "limits.csv", tw.load(arm()).model, degrees=degrees)
    own = degrees and row == "shoulder,,3"
    assert limits.velocity[0] == pytest.approx(math.radians(velocity) if own else velocity, rel=1e-15)


@pytest.mark.parametrize(
    "head, row, words",
    [
        (
            "joint,unit,velocity",
            "shoulder,banana,3",
            "column 'unit': 'banana' is not a unit of this limit of a turning joint",
        ),
        ("joint,velocity [furlong]", "shoulder,3", "column 'velocity': 'furlong' is not a unit of this limit"),
        ("joint,velocity [deg]", "shoulder,3", "Write one of rad/s, deg/s, rpm"),
        ("joint,acceleration [deg/s]", "shoulder,3", "Write one of rad/s^2, deg/s^2"),
        ("joint,jerk [deg/s²]", "shoulder,3", "Write one of rad/s^3, deg/s^3"),
        ("joint,effort [lbf in]", "shoulder,3", "Write one of N m, mN m, kN m"),
        ("joint,velocity [m/s]", "shoulder,3", "'m/s' is not a unit of this limit of a turning joint"),
        ("joint,effort [N]", "shoulder,3", "'N' is not a unit of this limit of a turning joint"),
    ],
)
def test_unknown_units_of_limits_are_errors(head, row, words, tmp_path):
    (tmp_path / "limits.csv").write_text(f"{head}\n{row}\n")
    with pytest.raises(tw.ValueRangeError, match=re.escape(words)):
        read_limits(tmp_path / "limits.csv", tw.load(arm()).model)


def test_a_blank_deceleration_is_the_acceleration_and_changes_no_other_row(tmp_path):
    rows = ("shoulder,90,", "elbow,90,2")
    (tmp_path / "limits.csv").write_text("\n".join(["joint,acceleration [deg/s^2],deceleration [rad/s²]", *rows]))
    limits = read_limits(tmp_path / "limits.csv", tw.load(arm()).model)
    assert limits.acceleration.tolist() == [math.pi / 2, math.pi / 2] and limits.deceleration.tolist() == [
        math.pi / 2,
        2.0,
    ]


def test_an_ok_without_limits_of_velocity_says_so(run, tmp_path):
    for name, text in (
        ("none.urdf", arm().replace('velocity="5"', "")),
        ("degrees.urdf", arm().replace('velocity="5"', 'velocity="180"')),
    ):
        (tmp_path / name).write_text(text)
        code, said = run("torques", name, "--trajectory", "ok.csv")
        assert code == 0 and said.startswith("OK") and "Assumption: no velocity limit is known" in said, said


def test_many_turns_of_a_joint_are_no_degrees(run, tmp_path):
    """The robot's own limits are as wide, or most joints have such as turn less than twice."""
    wide = arm().replace('lower="-3.1" upper="3.1"', 'lower="-40" upper="40"')
    (tmp_path / "wide.urdf").write_text(wide)
    (tmp_path / "arm.urdf").write_text(arm())
    (tmp_path / "limits.csv").write_text("joint,lower,upper\nshoulder,-40,40\nelbow,-40,40\n")
    assert run("torques", "wide.urdf", "--trajectory", "ok.csv", "--limits", "limits.csv")[0] == 0
    (tmp_path / "limits.csv").write_text("joint,lower,upper\nshoulder,-40,40\nelbow,-3,3\n")
    assert run("torques", "arm.urdf", "--trajectory", "ok.csv", "--limits", "limits.csv")[0] == 0


# ── placeholder limits, and what the doctor says of limits ──

SMALL = "".join(link(f"l{k}", 0.15, 0.1) for k in range(1, 4))


def small(effort):
    """Three links of 0.15 kg and 0.1 m, whose weight takes 0.66 N m at most."""
    joints = "".join(
        joint(f"j{k}", f"l{k - 1}" if k > 1 else "base", f"l{k}", effort, x=0.1 * (k > 1)) for k in (1, 2, 3)
    )
    tool = '<link name="tool"/><joint name="tf" type="fixed"><origin xyz="0.1 0 0"/><parent link="l3"/><child link="tool"/></joint>'
    return f'<robot name="small"><link name="base"/>{SMALL}{joints}{tool}</robot>'


@pytest.mark.parametrize("command", ["torques", "payload", "move"])
def test_placeholder_limits_are_doubted_unless_their_unit_is_given(run, tmp_path, command):
    (tmp_path / "arm.urdf").write_text(small(35))
    table("small.csv", T, S, 0.3 + 0.5 * S, 0.2 * S, head="time,j1,j2,j3")
    given = {
        "torques": ("torques", "arm.urdf", "--trajectory", "small.csv", "--payload", 0.1),
        "payload": ("payload", "arm.urdf"),
        "move": ("move", "arm.urdf", "--to", "1,0.8,0.2", "--duration", 4),
    }[command]
    code, said = run(*given)
    assert code == 1 and said.startswith("UNSURE: effort 35 on all 3 joints: the arm's own weight takes at most 1."), (
        said
    )
    assert "write a table with 'twistwrench info arm.urdf --csv limits.csv', fill in its efforts" in " ".join(
        said.split()
    )
    assert (
        run("info", "arm.urdf", "--csv", "limits.csv")[0] == 0
    )  # as that says; its efforts are still those of the file
    code, said = run(*given, "--limits", "limits.csv")
    assert code == 1 and said.startswith("UNSURE: effort 35 on all 3 joints") and "'effort [N m]'" in said, said
    table_of_file = (tmp_path / "limits.csv").read_text()
    (tmp_path / "limits.csv").write_text(table_of_file.replace("effort", "effort [N m]"))
    assert run(*given, "--limits", "limits.csv")[0] == 0
    (tmp_path / "arm.urdf").write_text(small(2))  # 33 %
    assert run(*given)[0] == 0


def test_the_doctor_warns_of_placeholder_and_missing_limits(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(small(35))
    code, said = run("doctor", "arm.urdf", "--only", "placeholder-limits")
    assert code == 1 and "warning placeholder-limits, robot 'small' effort 35 on all 3 joints" in said, said
    (tmp_path / "arm.urdf").write_text(small(0))
    code, said = run("doctor", "arm.urdf", "--only", "effort")
    assert code == 1 and "warning effort, joints 'j1', 'j2', 'j3', line 1 there is no limit of effort" in said, said
    assert tw.doctor(tw.robots.path_of("ur5"), only="placeholder-limits").summary == "0 errors, 0 warnings, 0 notes"


PLACEHOLDERS = {
    *("so100.urdf", "so101.urdf", "bolt.urdf", "finger_edu.urdf", "quadruped.urdf", "solo.urdf", "solo12.urdf"),
    *("icub_genova02.urdf", "ur3_gripper.urdf", "ur3_joint_limited_robot.urdf", "ur3_robot.urdf"),
}


@pytest.mark.slow
def test_of_public_robots_the_wrong_files_alone_are_doubted():
    roots = [Path(entry) / "cmeel.prefix/share/example-robot-data" for entry in sys.path]
    roots.append(SHARED / "robots")
    files = sorted(
        file for root in roots if root.is_dir() for file in root.rglob("*.urdf") if file.parent.name != "defects"
    )
    if not files:
        pytest.skip("example-robot-data is not installed")
    found = set()
    for file in files:
        try:
            report = tw.doctor(file, only="placeholder-limits", meshes=False)
        except tw.TwistWrenchError:
            continue
        found |= {file.name} if report.findings and report.contents.robot.model.nv > 2 else set()
        if "ur3_" in file.name:
            assert "which are those of the UR10" in str(report.findings[0])
    assert found == PLACEHOLDERS & {file.name for file in files}


SHARES = {
    "kinova": 0.26,
    "z1": 0.32,
    "ur10_robot": 0.37,
    "ur5_robot": 0.40,
    "panda": 0.65,
    "xarm7": 0.65,
    "so100": 0.027,
    "so101": 0.086,
    "ur3_robot": 0.052,
}
"""The largest share of an effort that the own weight takes: of real arms, then of files with other efforts."""


@pytest.mark.slow
@pytest.mark.parametrize("name", SHARES)
def test_the_own_weight_of_real_arms_takes_a_quarter_of_some_effort_at_least(name):
    files = [file for key, file in FILES.items() if key.endswith(f"/{name}") and "beside" not in key]
    if not files:
        pytest.skip("example-robot-data is not installed")
    robot = tw.load(files[0], inertia="accept")
    share = weight_share(robot, arm_entries(robot.model), robot.limits.effort)
    assert share == pytest.approx(SHARES[name], rel=0.05)  # over 2,000 random poses
    assert bool(placeholder_limits(robot, robot.limits)) == (share < 0.15)


def test_links_of_a_gram_are_a_warning_and_a_tool_without_mass_is_counted(run, tmp_path):
    (tmp_path / "light.urdf").write_text(arm().replace('mass value="1.0"', 'mass value="0.001"'))
    code, said = run("doctor", "light.urdf", "--only", "light")
    assert code == 1 and "warning light, robot 'arm2' all that moves weighs 2 g, and the robot reaches 2 m" in said, (
        said
    )
    seen = '<link name="tool"><visual><geometry><box size=".1 .1 .1"/></geometry></visual></link>'
    (tmp_path / "tool.urdf").write_text(arm().replace('<link name="tool"/>', seen))
    code, said = run("torques", "tool.urdf", "--trajectory", "ok.csv")
    assert code == 0 and ". Assumption: tool has a shape and no mass, so no weight." in said, said


def test_the_doctor_prints_each_finding_once(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm((0, 0)).replace('mass value="1.0"', 'mass value="0.001"'))
    _, said = run("doctor", "arm.urdf", "--all")
    findings = tw.doctor(tmp_path / "arm.urdf").findings
    assert len(findings) > 2
    for finding in findings:
        assert said.count(finding.sentence) == sum(f.sentence == finding.sentence for f in findings)
        assert finding.where in said


# ── robots without a joint that moves ──

STILL = (
    ("payload", "still.urdf"),
    ("payload", "still.urdf", "--map", "rz"),
    ("torques", "still.urdf", "--trajectory", "ok.csv"),
    ("move", "still.urdf", "--to", "home"),
    ("move", "still.urdf", "--by", "0,0,0.1"),
    ("excite", "still.urdf"),
    ("simulate", "still.urdf"),
    ("identify", "still.urdf", "ok.csv"),
)


@pytest.mark.parametrize("command", STILL, ids=" ".join)
def test_a_robot_that_cannot_move_is_refused_in_one_line(run, tmp_path, command):
    (tmp_path / "still.urdf").write_text(f'<robot name="still">{link("base")}</robot>')
    code, said = run(*command)
    assert code == 2 and said.count("error: ") == 1 and "a fault of twistwrench" not in said, said


def test_in_python_a_robot_that_cannot_move_is_refused_too(tmp_path):
    (tmp_path / "still.urdf").write_text(f'<robot name="still">{link("base")}</robot>')
    robot = tw.load(tmp_path / "still.urdf")
    for ask in (
        lambda: tw.statics.largest_payload(robot, []),
        lambda: tw.statics.payload_map(robot, "rz"),
        lambda: tw.trajectories.follow_poses(
            robot, tw.trajectories.straight_path(np.eye(4), tw.se3.exp([0, 0, 0, 0, 0, 0.1])), []
        ),
    ):
        with pytest.raises(tw.ValueRangeError, match="needs a robot with moving joints"):
            ask()


# ── what mimic joints bear ──


def with_follower(effort, mass=5.0, *, multiplier=1):
    follower = joint("fj", "l2", "f", effort, x=1, inside=f'<mimic joint="elbow" multiplier="{multiplier}"/>')
    return arm((300, 100), extra=link("f", mass, 0.4) + follower)


@pytest.mark.parametrize(("effort", "code"), [(0.5, 1), (8.0, 1), (20, 0), (0, 0), (1e30, 0)])
def test_a_follower_beyond_its_own_effort_is_over_its_limit(run, tmp_path, effort, code):
    (tmp_path / "arm.urdf").write_text(with_follower(effort))
    for name in ("torques", "move"):
        found, said = run(*COMMANDS[name])
        assert found == code and said.startswith("OVER LIMIT: fj" if code else "OK: "), said
    if code:
        assert f"fj: torque -9.81 beyond -{effort:g} N m at 0 s" in said  # of the motion that begins stretched out
        said = run(*COMMANDS["torques"])[1]
        assert (
            f"fj, which follows elbow, needs 8.392 N m at t = 3.990 s, {100 * 8.392 / effort:.0f} % of its limit"
            in said
        ), said
    found, said = run("view", "arm.urdf", "--trajectory", "ok.csv", "--html", "page.html")
    assert found == 0 and ("fj exceeds its torque limit" in said) == bool(code), said
    motion = tw.Motion(T, np.c_[S, 0.3 + 0.5 * S], robot=tw.load(tmp_path / "arm.urdf"))
    assert [v.joint for v in motion.violations()] == ["fj"] * code


@pytest.mark.parametrize("multiplier", [1, -2.5])
def test_it_bears_what_a_motor_in_its_place_would_give(tmp_path, multiplier):
    """The oracle is the same robot with the follower as a joint of its own; edits and files keep its effort."""
    (tmp_path / "arm.urdf").write_text(with_follower(1e-6, multiplier=multiplier))
    robot, free = (tw.load(tmp_path / "arm.urdf", mimic=mimic) for mimic in ("follow", "independent"))
    t = np.linspace(0, 1, 21)
    q = np.c_[0.4 * t**3, 0.3 - 0.7 * t**2]
    motion = tw.Motion(t, q, robot=robot)
    every = [np.c_[x, multiplier * x[:, 1]] for x in (motion.q, motion.dq, motion.ddq)]
    tau = free.inverse_dynamics(*every)[:, 2]
    for written in ("urdf", "sdf", "xml"):
        tw.save(robot, tmp_path / f"again.{written}")
    loaded = [tw.load(tmp_path / f"again.{written}") for written in ("urdf", "sdf", "xml")]
    edited = [robot.with_payload(tw.SpatialInertia.from_com(0.0), frame="tool"), pickle.loads(pickle.dumps(robot))]
    for one in (robot, *loaded, *edited):
        found = next(v for v in tw.Motion(t, q, robot=one).violations() if v.joint == "fj")
        assert found.limit == np.copysign(1e-6, found.value)
        assert abs(found.value) == pytest.approx(np.abs(tau).max(), rel=1e-9)


def test_the_largest_payload_is_limited_by_a_follower(run, tmp_path):
    """Per kilogram at the follower's end, 0.4 m from its axis, it bears 3.924 N m besides its own 1 kg at 0.2 m."""
    (tmp_path / "arm.urdf").write_text(with_follower(5.0, 1.0))
    (tmp_path / "weak.urdf").write_text(with_follower(1.0, 1.0))
    robot = tw.load(tmp_path / "arm.urdf")
    found = tw.statics.largest_payload(robot, [0.0, 0.0], [0.4, 0, 0], frame="f")
    assert float(found.mass) == pytest.approx((5 - 0.2 * 9.81) / (0.4 * 9.81), rel=1e-5)
    assert found.joint_names[int(found.joint)] == "fj" and found.limits.tolist() == [300, 100, 5]
    code, said = run("payload", "arm.urdf", "--frame", "f", "--com", "0.4,0,0", "--csv", "out.csv")
    assert code == 0 and said.startswith(
        "OK: largest payload at rest in this pose: 0.7742 kg at f + [0.4, 0, 0] m. Limited by fj"
    ), said
    assert [row.split(",")[0] for row in (tmp_path / "out.csv").read_text().split()] == [
        "joint",
        "shoulder",
        "elbow",
        "fj",
    ]
    many = tw.statics.largest_payload(robot, [[0.0, 0.0], [0.3, 0.2]], [0.4, 0, 0], frame="f")
    assert many.mass[0] == found.mass and many.torques.shape == (2, 3)
    code, said = run("payload", "weak.urdf", "--frame", "f")
    assert code == 1 and said.startswith("OVER LIMIT: no payload. fj needs 1.962 of 1 to hold the robot alone"), said
    at_tip = tw.statics.largest_payload(robot, [0.0, 0.0], frame="tool")  # which the follower does not carry
    assert at_tip.joint_names == robot.model.velocity_names
    code, said = run("torques", "arm.urdf", "--trajectory", "ok.csv", "--payload", "0.2,0.4,0,0@f")
    assert code == 0 and "(limit of fj at" in said, said


def test_what_a_follower_bears_counts_payload_and_wrench(run, tmp_path):
    """At 0.4 m from its axis 1 kg adds 3.924 N m at most, and a force of 10 N adds 4 N m, to 1.962 N m of its own 1 kg."""
    (tmp_path / "arm.urdf").write_text(with_follower(5.0, 1.0))
    assert run("torques", "arm.urdf", "--trajectory", "ok.csv")[0] == 0
    code, said = run("torques", "arm.urdf", "--trajectory", "ok.csv", "--payload", "1,0.4,0,0@f")
    assert code == 1 and said.startswith("OVER LIMIT: fj"), said
    code, said = run("torques", "arm.urdf", "--trajectory", "ok.csv", "--wrench-on-robot", "f:0,10,0,0,0,0")
    assert code == 1 and said.startswith("OVER LIMIT: fj"), said


def test_a_motion_s_room_for_payload_is_that_of_its_follower(run, tmp_path):
    """Stretched out it bears 1.962 N m alone and 3.924 N m for each kilogram; the motion begins so, at rest."""
    (tmp_path / "arm.urdf").write_text(with_follower(5.0, 1.0))
    table("flat.csv", T, 0 * T, 0 * T)
    said = run("torques", "arm.urdf", "--trajectory", "flat.csv", "--payload", "0.2,0.4,0,0@f")[1]
    assert "Maximum payload on this path: 0.7742 kg at f (limit of fj" in said, said


@pytest.mark.parametrize(("effort", "code"), [(8.0, 1), (1000, 0)])
def test_the_fastest_motion_is_not_ok_where_a_follower_is_over_its_limit(run, tmp_path, effort, code):
    """The timing is planned without the follower, which at these accelerations bears 23 N m."""
    (tmp_path / "arm.urdf").write_text(with_follower(effort))
    found, said = run("move", "arm.urdf", "--to", "1,0.8", "--fastest")
    assert found == code and said.startswith("OVER LIMIT: fj: torque 22.8" if code else "OK: "), said


@pytest.mark.parametrize("header", ["effort", "effort [N m]"])
def test_limits_that_the_user_gives_for_some_joints_leave_the_others_in_doubt(run, tmp_path, header):
    (tmp_path / "arm.urdf").write_text(small(35))
    (tmp_path / "some.csv").write_text(f"joint,{header}\nj1,35\n")
    code, said = run("payload", "arm.urdf", "--limits", "some.csv")
    assert code == 1 and said.startswith("UNSURE: effort 35 on all 3 joints"), said


@pytest.mark.parametrize(("effort", "doubted"), [(5.0, True), (4.0, False)])
def test_a_share_of_fifteen_percent_is_doubted(tmp_path, effort, doubted):
    """The weight of three links takes 0.66 N m: 13 % of 5 N m, and 17 % of 4 N m."""
    (tmp_path / "arm.urdf").write_text(small(effort))
    found = tw.doctor(tmp_path / "arm.urdf", only="placeholder-limits").findings
    assert bool(found) == doubted


def test_a_thousand_newton_metres_on_half_of_the_joints_stand_for_no_limit(tmp_path):
    (tmp_path / "arm.urdf").write_text(arm((1000, 10)))
    (found,) = tw.doctor(tmp_path / "arm.urdf", only="placeholder-limits").findings
    assert "efforts of 1000 and more on 1 of 2 joints" in str(found)


def test_efforts_beside_an_actuator_file_are_the_users(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(small(35))
    (tmp_path / "a.yaml").write_text("actuators:\n  j1: {friction: {viscous: 0.1 N m s/rad}}\n")
    assert run("payload", "arm.urdf")[0] == 1
    code, said = run("payload", "arm.urdf", "--actuators", "a.yaml")
    assert code == 0 and "largest payload at rest in this pose" in said, said


@pytest.mark.parametrize(("depth", "doubted"), [(4, True), (5, False)])
def test_fingers_have_at_most_four_joints(tmp_path, depth, doubted):
    """The weight of an arm of three links is judged where it branches into fingers, and not where it carries other arms."""
    names = [["l3", *(f"{side}{k}" for k in range(depth))] for side in "ab"]
    fingers = "".join(
        link(child, 0.01, 0.02) + joint(f"j{child}", parent, child, 35, x=0.1 if parent == "l3" else 0.02)
        for chain in names
        for parent, child in pairwise(chain)
    )
    (tmp_path / "hand.urdf").write_text(small(35).replace("</robot>", f"{fingers}</robot>"))
    found = tw.doctor(tmp_path / "hand.urdf", only="placeholder-limits").findings
    assert bool(found) == doubted


def sliding(effort, mass=40.0):
    """A rail with its carriage, which need not carry anything."""
    return (
        '<robot name="rail"><link name="track"/>'
        f'<link name="carriage"><inertial><mass value="{mass}"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="rail" type="prismatic"><parent link="track"/><child link="carriage"/><axis xyz="1 0 0"/>'
        f'<limit lower="-1" upper="1" effort="{effort}" velocity="1.5"/></joint></robot>'
    )


@pytest.mark.parametrize(("effort", "doubted"), [(2000, False), (3900, False), (3950, True)])
def test_a_rail_pulls_with_up_to_ten_times_its_weight(tmp_path, effort, doubted):
    """40 kg weigh 392 N; the rail that pulls with 2000 N has the same word alone and under an arm."""
    (tmp_path / "rail.urdf").write_text(sliding(effort))
    assert bool(tw.doctor(tmp_path / "rail.urdf", only="placeholder-limits").findings) == doubted
    if not doubted:
        tw.join(str(tmp_path / "rail.urdf"), "ur5@carriage").write(tmp_path / "cell.urdf")
        assert not tw.doctor(tmp_path / "cell.urdf", only="placeholder-limits").findings


@pytest.mark.parametrize(("text", "unit"), [(sliding(5000), "N"), (small(35), "N m")])
def test_the_message_of_doubted_efforts_names_the_header_that_confirms_them(run, tmp_path, text, unit):
    (tmp_path / "robot.urdf").write_text(text)
    code, said = run("doctor", "robot.urdf", "--only", "placeholder-limits")
    assert code == 1 and f"name their unit in its header, 'effort [{unit}]'" in " ".join(said.split()), said
    tw.info(tmp_path / "robot.urdf").to_csv(tmp_path / "same.csv")
    table = (tmp_path / "same.csv").read_text()
    for header, expected in (("effort", 1), (f"effort [{unit}]", 0)):
        (tmp_path / "limits.csv").write_text(table.replace(",effort,", f",{header},"))
        assert run("doctor", "robot.urdf", "--only", "placeholder-limits", "--limits", "limits.csv")[0] == expected


def test_a_motor_of_unknown_limit_that_needs_no_torque_is_a_motor():
    """Without gravity an arm at rest needs no torque, so that its unknown limits leave no doubt; but it has motors."""
    text = re.sub(r' effort="[^"]*"', "", arm())
    answer = tw.check(tw.load(text, gravity=(0, 0, 0)), at=[0.3, 0.2])
    assert answer.headline.startswith("OK: all limits kept. No joint has a motor with a known limit.")
