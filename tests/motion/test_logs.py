"""Logs as loggers write them: every dialect gives the same numbers, every fault one error of the tree, every contradiction a sentence."""

from __future__ import annotations

import gzip
import random
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from motions import write_motion
from places import SHARED

import twistwrench as tw
from twistwrench import load, robots
from twistwrench.cli.shared import RobotOptions
from twistwrench.core.errors import ModelWarning, TrajectoryError, TwistWrenchError, UnknownNameError, ValueRangeError
from twistwrench.formats import load_model
from twistwrench.motion.load_case import joints_beside
from twistwrench.motion.matching import NamedJoints
from twistwrench.motion.motion_file import joints_without_column, open_motion_file
from twistwrench.motion.motion_log import MotionLog
from twistwrench.motion.readers import csv_reader as csv_module

pytest_plugins = ("torque_fixtures",)
LOGS = SHARED / "logs"
ROBOTS = LOGS.parent / "robots"

ARM = """<robot name="arm"><link name="base"/>
<link name="a"><inertial><mass value="1"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
<link name="b"><inertial><mass value="1"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
<joint name="shoulder_joint" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-6.3" upper="6.3" velocity="3" effort="50"/></joint>
<joint name="elbow_joint" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<origin xyz="0.5 0 0"/><limit lower="-3.2" upper="3.2" velocity="3" effort="50"/></joint></robot>"""


@pytest.fixture(scope="module")
def arm():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load(ARM)


@pytest.fixture(scope="module")
def model(arm):
    return arm.model


@pytest.fixture
def write(tmp_path):
    def write(content: str | bytes, name: str = "log.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def read(path, model, **options):
    log = MotionLog.open(path, model, **options)
    return log.motion(log.table), log


# ── dialects ──

ROWS = [(0.0, 0.5, -1.25), (0.25, 1.5, -2.5), (0.5, 2.5, 1e-3)]


def table(header, separator=",", form=repr, before="", end="\n"):
    lines = [separator.join(header), *(separator.join(map(form, row)) for row in ROWS)]
    return before + end.join(lines) + end


def comma(x):
    return repr(x).replace(".", ",")


EXACT = ("time", "shoulder_joint", "elbow_joint")
DIALECTS = {
    "commas": table(EXACT),
    "semicolons": table(EXACT, ";"),
    "semicolons and decimal commas": table(EXACT, ";", comma),
    "tabs": table(EXACT, "\t"),
    "tabs and decimal commas": table(EXACT, "\t", comma),
    "blanks": table(EXACT, "  "),
    "blanks about commas": table(EXACT, " , "),
    "BOM": b"\xef\xbb\xbf" + table(EXACT).encode(),
    "UTF-16": table(EXACT).encode("utf-16"),
    "UTF-16 of the other order": b"\xfe\xff" + table(EXACT).encode("utf-16-be"),
    "UTF-16 without a mark": table(EXACT, "\t").encode("utf-16-le"),
    "UTF-16 of the other order without a mark": table(EXACT, "\t").encode("utf-16-be"),
    "gzip": gzip.compress(table(EXACT).encode()),
    "gzip of UTF-16": gzip.compress(table(EXACT).encode("utf-16")),
    "Windows' line ends": table(EXACT, end="\r\n"),
    "old line ends": table(EXACT, end="\r"),
    "no newline at the end": table(EXACT).rstrip("\n"),
    "comments": "# a log\n\n" + table(EXACT).replace("0.25,", "# halfway\n\n0.25,") + "# the end\n",
    "blank lines of blanks": table(EXACT).replace("0.25,", "  \n\t\n0.25,"),
    "the header in a comment": table(("# time", *EXACT[1:])),
    "quotes": table(EXACT, form=lambda x: f'"{x!r}"'),
    "quoted names": table([f'"{name}"' for name in EXACT]),
    "a column of text": "\n".join([",".join([*EXACT, "state"]), *(",".join([*map(repr, r), "läuft"]) for r in ROWS)]),
    "a quoted comma in a column of text": "\n".join(
        [",".join([*EXACT, "said"]), *(",".join([*map(repr, r), '"one, two"']) for r in ROWS)]
    ),
    "pandas' index": "\n".join(
        [",".join(["", *EXACT]), *(",".join([str(k), *map(repr, r)]) for k, r in enumerate(ROWS))]
    ),
    "a comma at the end": table(EXACT).replace("\n", ",\n"),
    "a date beside decimal commas": "\n".join(
        [";".join([*EXACT, "clock"]), *(";".join([*map(comma, r), "22.11.2026"]) for r in ROWS)]
    ),
}


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("block", [1 << 18, 16])
def test_every_dialect_gives_the_same_numbers(model, write, dialect, block, monkeypatch):
    monkeypatch.setattr(csv_module, "_BLOCK_SIZE", block)
    motion, log = read(write(DIALECTS[dialect]), model)
    expected = np.array(ROWS)
    np.testing.assert_array_equal(motion.time, expected[:, 0])
    np.testing.assert_array_equal(motion.q, expected[:, 1:])
    assert log.doubts() == ()


TIMES = {
    "Time": 1.0,
    "t": 1.0,
    "timestamp": 1.0,
    "Time [s]": 1.0,
    "Time (ms)": 1e-3,
    "time_us": 1e-6,
    "stamp [min]": 60.0,
}


@pytest.mark.parametrize("name", TIMES)
def test_time_is_known_by_its_names_and_units(model, write, name):
    motion, log = read(write(table((name, *EXACT[1:]))), model)
    np.testing.assert_allclose(motion.time, TIMES[name] * np.array(ROWS)[:, 0], rtol=1e-15)
    assert any("Time is read in" in said for said in log.notes) == (TIMES[name] != 1.0)


@pytest.mark.parametrize(
    "start, scale, unit", [(1.7e18, 1e9, "ns"), (0.0, 1e9, "ns"), (1.7e9, 1.0, "s"), (0.0, 1.0, "s")]
)
@pytest.mark.parametrize("columns", [{}, {"time": "%time"}])
def test_the_values_of_ros_s_column_of_time_say_its_unit(model, write, start, scale, unit, columns):
    """Whole nanoseconds as ``rostopic echo -p`` writes them, or seconds with fractions; of a date, or from zero."""
    stamps = [start + scale * row[0] for row in ROWS]
    written = "\n".join(
        ",".join([str(int(t)) if unit == "ns" else repr(t), *map(repr, row[1:])])
        for t, row in zip(stamps, ROWS, strict=True)
    )
    motion, log = read(write(",".join(("%time", *EXACT[1:])) + "\n" + written + "\n"), model, columns=columns)
    np.testing.assert_allclose(np.diff(motion.time), np.diff(np.array(ROWS)[:, 0]), atol=1e-6)
    assert sum(f"time is read in {unit}." in said and "%time" in said for said in log.notes) == 1


NAMES = {
    "_position": "{}_position",
    ".pos": "{}.pos",
    "_pos": "{}_pos",
    "TIAGo's": "- {}_position",
    "ROS": "joint_states.position.{}",
    "PlotJuggler": "/joint_states/{}/position",
    "capitals": "{}_Position",
    "measured": "{}_measured_position",
    "units": "{} [rad]",
    "units after the quantity": "{}_pos_rad",
}


@pytest.mark.parametrize("form", NAMES)
def test_the_usual_suffixes_and_prefixes_are_understood(model, write, form):
    names = [NAMES[form].format(joint) for joint in EXACT[1:]]
    motion, log = read(write(table(("time", *names))), model)
    np.testing.assert_array_equal(motion.q, np.array(ROWS)[:, 1:])
    assert form == "units" or "is taken to be shoulder_joint, and 1 more" in " ".join(log.notes)


def test_joints_are_known_without_the_word_joint_too(model, write):
    motion, _ = read(write(table(("time", "elbow", "shoulder_position"))), model)
    np.testing.assert_array_equal(motion.q, np.array(ROWS)[:, [2, 1]])


def test_what_is_not_measured_or_not_of_the_joint_is_not_taken():
    joints = NamedJoints(["elbow", "arm_1", "arm_10"])
    assert joints.meaning("target_elbow_position").part == "command"
    for name in (
        "elbow_temperature",
        "target_elbow_velocity",
        "left_elbow",
        "elbow2",
        "elbow_state",
        "arm_1_position_error",
    ):
        assert joints.meaning(name) is None, name
    assert joints.meaning("arm_10_effort").name == 2


def test_every_quantity_is_found_and_brought_to_si(model, write):
    text = (
        "time,shoulder_joint_vel [deg/s],elbow_velocity,shoulder_position [deg],elbow.pos,"
        "shoulder_acc [rad/s^2],elbow_acc,shoulder_effort [mNm],elbow_torque\n"
        "0,180,2,90,1,5,6,7000,8\n1,180,2,90,1,5,6,7000,8\n"
    )
    motion, log = read(write(text), model)
    np.testing.assert_allclose(motion.q[0], [np.pi / 2, 1])
    np.testing.assert_allclose(motion.dq[0], [np.pi, 2])
    np.testing.assert_allclose(motion.ddq[0], [5, 6])
    np.testing.assert_allclose(motion.tau[0], [7, 8])
    assert not log.columns.extra
    # A unit that is said counts more than --degrees, which is for all columns that say none.
    turned, _ = read(write(text), model, degrees=True)
    np.testing.assert_allclose(turned.q[0], [np.pi / 2, np.radians(1)])
    np.testing.assert_allclose(turned.dq[0], [np.pi, np.radians(2)])
    np.testing.assert_allclose(turned.tau[0], [7, 8])


@pytest.mark.parametrize(
    "names",
    [
        ("pos1", "pos2"),
        ("q0", "q1"),
        ("actual_q_0", "actual_q_1"),
        ("q[1]", "q[2]"),
        ("Joint_1", "Joint_2"),
        ("J1", "J2"),
    ],
)
def test_numbered_columns_are_taken_by_their_order_and_a_note_says_so(model, write, names):
    motion, log = read(write(table(("time", *names))), model)
    np.testing.assert_array_equal(motion.q, np.array(ROWS)[:, 1:])
    assert f"{names[0]} is shoulder_joint, {names[1]} is elbow_joint" in " ".join(log.notes)


@pytest.mark.parametrize(
    "names", [("pos1", "pos3"), ("pos2", "pos3"), ("pos1", "pos2", "pos3"), ("target_q_0", "target_q_1")]
)
def test_numbers_that_do_not_count_the_joints_are_not_taken(model, write, names):
    text = ",".join(("time", *names)) + "\n" + ",".join("0" for _ in range(len(names) + 1)) + "\n"
    with pytest.raises(TrajectoryError, match="no column for shoulder_joint, elbow_joint") as caught:
        read(write(text), model)
    assert f"found: time, {', '.join(names)}." in str(caught.value)
    assert "--columns 'shoulder_joint=COLUMN,elbow_joint=COLUMN'" in caught.value.in_shell()


def test_one_joint_needs_no_number(write):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        model = load_model(robots.path_of("pendulum"))
    motion, _ = read(write("time,position,velocity,torque\n0,1,2,3\n1,3,2,3\n"), model)
    np.testing.assert_array_equal(np.hstack([motion.q, motion.dq, motion.tau])[0], [1, 2, 3])


def test_columns_are_as_they_are_told(model, write):
    told = {
        "elbow_joint": "a [deg]",
        "shoulder_joint": "b",
        "shoulder_joint.vel": "c",
        "elbow_joint.vel": "a",
        "time": "d [ms]",
    }
    text = "a,b,c,d\n0,1,2,3000\n0,2,2,4000\n"
    motion, _ = read(write(text), model, columns={**told, "elbow_joint.vel": "b [deg/s]"})
    np.testing.assert_array_equal(motion.time, [3, 4])
    np.testing.assert_allclose(motion.dq, [[2, np.radians(1)], [2, np.radians(2)]])
    for suffix in (".torque", ".tau", ".effort"):
        joints = ("shoulder_joint", "elbow_joint")
        motion, _ = read(
            write(text), model, columns={**told, "elbow_joint.vel": "b", **{f"{j}{suffix}": "c" for j in joints}}
        )
        np.testing.assert_array_equal(motion.tau, [[2, 2], [2, 2]])
    with pytest.raises(
        TrajectoryError, match=r"no column 'z', which columns={'elbow_joint': 'z'} names.*found: a, b, c, d"
    ):
        read(write(text), model, columns={"elbow_joint": "z"})
    with pytest.raises(UnknownNameError, match=r"no coordinate .* 'elbow'.*Did you mean 'elbow_joint'"):
        read(write(text), model, columns={"elbow": "a"})


def test_a_unit_that_is_told_is_believed_rather_than_the_headers(model, write):
    told = {"shoulder_joint": "a [deg]", "elbow_joint": "b"}
    motion, _ = read(write("time,a [rad],b [deg]\n0,90,90\n1,180,90\n"), model, columns=told)
    np.testing.assert_allclose(motion.q, np.radians([[90, 90], [180, 90]]))


def test_a_rate_takes_the_place_of_a_column_of_time(model, write, monkeypatch):
    monkeypatch.setattr(csv_module, "_BLOCK_SIZE", 32)
    text = "elbow_joint;shoulder_joint\n" + "".join(f"{k},5;{-k},25\n" for k in range(50))
    motion, _ = read(write(text), model, rate=200.0)
    np.testing.assert_allclose(motion.time, np.arange(50) / 200, rtol=1e-14)
    np.testing.assert_array_equal(motion.q[1:3], [[-1.25, 1.5], [-2.25, 2.5]])
    with pytest.raises(TrajectoryError, match="rate=… is given, and column 'time' is time"):
        read(write(table(EXACT)), model, rate=10.0)
    with pytest.raises(TrajectoryError, match=r"no time column.*rate=HZ.*found: elbow_joint, shoulder_joint"):
        read(write(text), model)
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueRangeError, match="rate"):
            read(write(text), model, rate=wrong)


def test_our_own_simulations_are_read_from_both_kinds_of_file(arm, tmp_path):
    result = arm.simulate(duration=0.3, dt=0.01)
    result.to_npz(tmp_path / "sim.npz")
    result.to_csv(tmp_path / "sim.csv")
    for name in ("sim.npz", "sim.csv"):
        motion, log = read(tmp_path / name, arm.model)
        for part, expected in (("time", result.times), ("q", result.q), ("dq", result.dq), ("ddq", result.ddq)):
            np.testing.assert_array_equal(getattr(motion, part), expected)
        np.testing.assert_array_equal(motion.tau, result.tau)
        assert log.doubts(arm.limits) == ()


def test_our_own_simulations_do_not_contradict_themselves(arm, tmp_path):
    """Coarse samples of fast motions, and joints that rest but for rounding, are nobody's wrong unit."""
    for robot, options in (
        (arm, {"dt": 0.02}),
        (robots.quadruped(), {"dt": 0.001}),
        (robots.quadruped(), {"dt": 0.02}),
    ):
        robot.simulate(duration=1.0, **options).to_npz(tmp_path / "sim.npz")
        _, log = read(tmp_path / "sim.npz", robot.model)
        assert log.doubts(robot.limits) == ()


# ── repeated rows ──


@pytest.mark.parametrize("block", [1 << 18, 24])
def test_rows_that_repeat_are_dropped_and_others_of_one_time_averaged(model, write, block, monkeypatch):
    monkeypatch.setattr(csv_module, "_BLOCK_SIZE", block)
    rows = ["0,1,2", "0.1,3,4", "0.1,3,4", "0.1,3,4", "0.2,5,6", "0.2,7,8", "0.3,9,10", "0.3,9,10"]
    motion, log = read(write(",".join(EXACT) + "\n" + "\n".join(rows)), model)
    np.testing.assert_allclose(motion.time, [0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(motion.q, [[1, 2], [3, 4], [6, 7], [9, 10]])
    said = " ".join(log.notes)
    assert "Left out: 3 rows that repeat the row before." in said
    assert "2 rows with a time that others have too, first t = 0.2 s" in said


def test_no_mean_is_taken_across_a_turn(model, write):
    with pytest.raises(TrajectoryError, match="differ by more than half a turn"):
        read(write(",".join(EXACT) + "\n0,3.1,0\n0,-3.1,0\n1,0,0\n"), model)


# ── faults ──

TWO = ",".join(EXACT) + "\n0,1,2\n1,2,3\n"
FAULTS = {
    "a cut gzip": (gzip.compress(TWO.encode() * 40)[:-20], "cannot be unpacked"),
    "no gzip": (b"\x1f\x8b\x08\x00nothing of the kind", "cannot be unpacked"),
    "half a character of UTF-16": (TWO.encode("utf-16")[:-1], "not text in the encoding of its first bytes"),
    "a cell that begins with 0x1f": (TWO + "2,\x1f3,4\n", "line 4 has a control character, '\\x1f'"),
    "a NUL": (TWO + "2,3\x00,4\n", "line 4 has a control character"),
    "a ragged row": (TWO + "2,3\n", "line 4 has 2 values, and the header names 3"),
    "a ragged row among text": (TWO.replace("\n", ",x\n") + "2,3,4\n", "line 4 has 3 values, and the header names 4"),
    "rows ragged both ways": (TWO.replace("\n", ",x\n") + "2,3,4\n2,3,4,x,x\n", "line 4 has 3 values"),
    "a lone quote": (TWO + '2,"3,4\n', "line 4 has a quote that never ends"),
    "cut short in the middle": (TWO + "2,3", "line 4 has 2 values"),
    "thousands": (
        "time;shoulder_joint;elbow_joint\n0;1.234,5;0\n",
        "line 2, column 'shoulder_joint' is '1.234,5', with a point",
    ),
    "points among commas": (
        "time;shoulder_joint;elbow_joint\n0;1,5;0\n1;1.5;0\n",
        "line 3, column 'shoulder_joint' is '1.5'",
    ),
    "a unit of another kind": (
        TWO.replace("elbow_joint", "elbow_joint [Nm]"),
        "the unit 'Nm' is not one of this column's kind",
    ),
    "no unit of time": (TWO.replace("time", "time [kg]"), "'kg' is not a unit of time"),
    "two of one meaning": (
        "time,shoulder_joint,elbow_pos,elbow_position\n0,1,2,2\n1,2,3,3\n",
        "may all be elbow_joint. Say which",
    ),
    "an archive of nothing": (b"PK\x05\x06" + bytes(18), "cannot be read as a motion"),
    "half an archive": (b"PK\x03\x04 and no more", "cannot be read as a motion"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_are_errors_of_the_tree_that_say_where(model, write, case):
    content, said = FAULTS[case]
    with pytest.raises(TrajectoryError, match=re.escape(said)) as caught:
        read(write(content), model)
    assert "log.csv" in str(caught.value)


def test_mutated_bytes_end_in_errors_of_the_tree(model, write, arm, tmp_path):
    """A thousand damaged files, of every dialect; nothing but errors of the tree may come out, and no infinite number."""
    rng = random.Random(11)
    arm.simulate(duration=0.05, dt=0.01).to_npz(tmp_path / "sim.npz")
    seeds = [x if isinstance(x, bytes) else x.encode() for x in DIALECTS.values()] + [
        (tmp_path / "sim.npz").read_bytes()
    ]
    odd = [
        b"\x00",
        b"\x1f",
        b'"',
        b"\n",
        b"\r",
        b";",
        b",",
        b"\t",
        b"\xff",
        b"#",
        b"1e999",
        b"nan",
        b"0x1p3",
        b"\xe2\x88\x92",
        b"[deg]",
        b"=",
    ]
    read_well = 0
    for _ in range(1000):
        content = bytearray(rng.choice(seeds))
        for _ in range(rng.randint(1, 2)):
            at = rng.randrange(len(content) + 1)
            kind = rng.randrange(5)
            if kind == 0:
                content[at:at] = rng.choice(odd)
            elif kind == 1:
                del content[at : at + rng.randint(1, 8)]
            elif kind == 2 and at < len(content):
                content[at] = rng.randrange(256)
            elif kind == 3:
                content[at:at] = content[max(0, at - rng.randint(1, 30)) : at]
            else:
                content = content[: max(1, at)]
        path = write(bytes(content))
        try:
            motion, log = read(path, model)
            log.doubts(model.limits)
            assert log.notes is not None
        except TwistWrenchError:
            continue
        read_well += 1
        assert np.isfinite(motion.q).all()
        assert (np.diff(motion.time) > 0).all()
    assert read_well > 50


def test_a_joint_called_like_a_unit_is_read_from_our_own_files(tmp_path):
    text = tw.robots.path_of("planar_2r").read_text().replace('"joint1"', '"arm [deg]"')
    robot = tw.load(text)
    result = robot.simulate([0.1, 0.2], duration=0.1, dt=0.01)
    for kind in ("csv", "npz"):
        path = getattr(result, f"to_{kind}")(tmp_path / f"s.{kind}")
        motion, _ = read(path, robot.model)
        np.testing.assert_array_equal(motion.q, result.q)


def test_a_last_number_that_is_cut_is_noted(model, write):
    text = ",".join(EXACT) + "\n" + "".join(f"{0.01 * k:.2f},{0.1 * k:.6f},{0.2 * k:.6f}\n" for k in range(40))
    longer = text + "0.40,4.00000000001,8.00000000001"  # more digits than the others: a number that is whole
    for content, cut in ((text, False), (text[:-1], False), (text[:-4], True), (longer, False)):
        _, log = read(write(content), model)
        assert any("cut short" in said for said in log.notes) == cut


# ── contradictions ──

T = np.arange(600) * 0.01
Q = np.column_stack([0.8 * np.sin(1.3 * T), 0.5 * np.sin(2.1 * T + 0.3)])
DQ = np.column_stack([0.8 * 1.3 * np.cos(1.3 * T), 0.5 * 2.1 * np.cos(2.1 * T + 0.3)])
TURNED = np.column_stack([2.0 * T, 3.1 + 0.08 * np.sin(5.0 * T)])  # as far as both joints may
TURNING = np.column_stack([np.full(len(T), 2.0), 0.4 * np.cos(5.0 * T)])
WRAPPED = np.arctan2(np.sin(TURNED), np.cos(TURNED))
DDQ = np.column_stack([-0.8 * 1.3**2 * np.sin(1.3 * T), -0.5 * 2.1**2 * np.sin(2.1 * T + 0.3)])
NONE = np.zeros_like(Q)


def said_of(tmp_path, robot, *columns, t=T, time="time"):
    path = write_motion(tmp_path / "m.csv", robot, t, columns, ("", ".vel", ".acc")[: len(columns)])
    path.write_text(path.read_text().replace("time", time, 1))
    _, log = read(path, robot.model)
    return tuple(str(d) for d in log.doubts(robot.limits) if d.refuses), " ".join(log.notes)


CONTRADICTIONS = {
    "velocities in degrees": ((Q, np.degrees(DQ)), "shoulder_joint, elbow_joint: the velocity column is 57.3 times"),
    "one velocity in degrees": ((Q, DQ * [180 / np.pi, 1]), "shoulder_joint: the velocity column is 57.3 times"),
    "positions in degrees": ((np.degrees(Q), DQ), "the velocity column is 1/57.3 times"),
    "velocities in rpm": ((Q, DQ * 30 / np.pi), "the velocity column is 9.55 times"),
    "no velocities": ((Q, NONE), "the velocity column is next to nothing, and the positions move"),
    "no accelerations": ((Q, DQ, NONE), "the acceleration column is next to nothing, and the velocities move"),
    "nothing but positions": ((Q, NONE, NONE), "the velocity column is next to nothing"),
    "accelerations in degrees": ((Q, DQ, np.degrees(DDQ)), "the acceleration column is 57.3 times"),
    "a sign": ((Q, DQ * [1, -1]), "elbow_joint: the velocity column has the opposite sign"),
    "columns changed about": ((Q, DQ[:, ::-1]), "the velocity column"),
    "velocities a fifth too large": (
        (Q, 1.2 * DQ),
        "the velocity column is not the slope of the positions, but some 1.2",
    ),
    "velocities a fifth too small": ((Q, 0.8 * DQ), "but some 0.8 times"),
    "one velocity of a motor": ((Q, DQ * [1, 2]), "elbow_joint: the velocity column is not the slope"),
    "a clock at half its rate": ((Q, DQ / 2), "but some 0.5 times"),
    "accelerations twice as large": ((Q, DQ, 2 * DDQ), "the acceleration column is not the slope"),
    "accelerations in g": ((Q, DQ, 9.81 * DDQ), "but some 9.8 times"),
    "positions that stand": ((NONE, DQ), "the velocity column moves, and the positions stand"),
}


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_rates_that_contradict_the_positions_are_told(arm, tmp_path, case):
    columns, said = CONTRADICTIONS[case]
    assert any(said in sentence for sentence in said_of(tmp_path, arm, *columns)[0])


def test_honest_logs_are_not_accused(arm, tmp_path):
    rng = np.random.default_rng(3)
    noisy = DQ + 0.05 * rng.normal(size=DQ.shape)
    late = np.vstack([DQ[:3], DQ[:-3]])  # 30 ms
    rounded = np.round(Q / 1e-3) * 1e-3
    flicker = np.array([0.3, -0.2]) + 1e-4 * (rng.random(Q.shape) < 0.02)  # an encoder at rest
    steady = np.outer(T, [0.1, -0.2])
    for columns in (
        (Q,),
        (Q, DQ),
        (Q, DQ, DDQ),
        (rounded, noisy),
        (Q, late),
        (flicker, NONE),
        (flicker, 0.01 * rng.normal(size=Q.shape)),
        (steady, np.tile([0.1, -0.2], (len(T), 1)), NONE),
        (WRAPPED, TURNING),
    ):
        assert said_of(tmp_path, arm, *columns)[0] == ()


def test_rates_of_a_joint_that_wraps_are_compared_too(arm, tmp_path):
    assert (np.abs(np.diff(WRAPPED, axis=0)).max(axis=0) > 6).all()
    (said,), _ = said_of(tmp_path, arm, WRAPPED, np.degrees(TURNING))
    assert "57.3 times the slope of the positions" in said


def test_time_in_milliseconds_is_told_unless_its_unit_is(arm, tmp_path):
    for columns in ((Q,), (Q, DQ)):
        said, _ = said_of(tmp_path, arm, *columns, t=1e3 * T)
        assert len(said) == 1
        assert "the usual step of time is 10 s" in said[0]
        assert "time [ms]" in said[0]
    assert said_of(tmp_path, arm, Q, DQ, t=1e3 * T, time="time [ms]")[0] == ()
    assert said_of(tmp_path, arm, Q, t=1e3 * T, time="time [s]")[0] == ()
    assert said_of(tmp_path, arm, NONE, t=1e3 * T)[0] == ()  # a robot at rest takes the same torques at any pace


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.05, 0.1, 0.2, -0.1])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_velocities_that_are_late_are_told_with_their_delay(arm, tmp_path, delay, noise):
    """To 10 ms, with noise of 1 mrad and 50 mrad/s, jitter of the stamps and a bias; filters of 10 ms are usual."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 12.0, 0.01) + 0.002 * rng.random(1200)

    def at(t):
        return np.stack([np.sin(1.3 * t) + 0.4 * np.sin(3.1 * t), 0.7 * np.cos(2.0 * t)], axis=1)

    def rates(t):
        return np.stack([1.3 * np.cos(1.3 * t) + 1.24 * np.cos(3.1 * t), -1.4 * np.sin(2.0 * t)], axis=1)

    q = at(t) + noise * rng.normal(size=(len(t), 2))
    dq = rates(t - delay) + 0.01 + 50 * noise * rng.normal(size=(len(t), 2))
    said, _ = said_of(tmp_path, arm, q, dq, t=t)
    if abs(delay) < 0.04:
        assert said == ()
        return
    (sentence,) = said
    assert sentence.startswith("shoulder_joint, elbow_joint: the velocity column is ")
    found = [float(x) for x in re.findall(r"0\.\d{3}", sentence)]
    assert found
    assert all(abs(x - abs(delay)) < 0.01 for x in found)
    assert ("late" if delay > 0 else "early") in sentence


@pytest.mark.parametrize("hz", [2000, 500, 100, 50])
def test_time_in_milliseconds_is_told_by_the_limits_of_velocity(arm, tmp_path, hz):
    """At 2 rad/s of the 3 that the joints reach; the steps read as 0.5 to 20 s."""
    t = np.arange(0.0, 4.0, 1.0 / hz)
    q = np.stack([np.sin(2.0 * t), np.cos(2.0 * t)], axis=1)
    ((sentence,), _) = said_of(tmp_path, arm, q, t=1e3 * t)
    assert "time seems to be in ms" in sentence
    assert said_of(tmp_path, arm, q, t=1e3 * t, time="time [s]")[0] == ()
    assert said_of(tmp_path, arm, q, t=t)[0] == ()


def test_a_turn_that_the_log_left_out_is_added_and_noted(arm, tmp_path):
    q = np.column_stack([3.0 + 0.5 * np.sin(T), Q[:, 1]])
    wrapped = np.arctan2(np.sin(q), np.cos(q))
    assert np.abs(np.diff(wrapped[:, 0])).max() > 6
    said, notes = said_of(tmp_path, arm, wrapped)
    assert said == ()
    assert "shoulder_joint steps by a full turn" in notes
    from twistwrench.motion.differentiation import Differentiation

    log = MotionLog.open(tmp_path / "m.csv", arm.model)
    (states,) = Differentiation.plan(log, arm.model).states(10**6)
    inner = slice(5, -5)
    np.testing.assert_allclose(states.dq[inner, 0], 0.5 * np.cos(T)[inner], atol=1e-6)


def test_a_jump_that_is_no_turn_is_told(arm, tmp_path):
    q = Q.copy()
    q[300:, 1] += 3.6
    said, _ = said_of(tmp_path, arm, q)
    assert any("elbow_joint jumps by 3." in sentence for sentence in said)


# ── the shell ──


def test_what_contradicts_itself_is_looked_at_again(run, tmp_path, arm):
    robot = tmp_path / "arm.urdf"
    robot.write_text(ARM)
    path = write_motion(tmp_path / "m.csv", arm, T, (Q, np.degrees(DQ)), ("", ".vel"))
    code, text = run("torques", robot, "--trajectory", path)
    assert code == 1
    assert "LOOK AGAIN: shoulder_joint, elbow_joint: the velocity column is 57.3 times" in " ".join(text.split())
    good = write_motion(tmp_path / "g.csv", arm, T, (Q, DQ), ("", ".vel"))
    code, text = run("torques", robot, "--trajectory", good, "--payload", "1,0,0,100@b")
    assert code == 1
    assert "LOOK AGAIN: the payload of 1 kg lies 100 m from b, and the robot reaches 0.5 m" in " ".join(text.split())
    assert run("torques", robot, "--trajectory", good, "--payload", "1,0,0,0.1@b")[0] == 0


def test_pictures_of_what_contradicts_itself_are_drawn_and_end_with_1(run, tmp_path, arm):
    robot = tmp_path / "arm.urdf"
    robot.write_text(ARM)
    bad = write_motion(tmp_path / "m.csv", arm, T, (Q, np.degrees(DQ)), ("", ".vel"))
    good = write_motion(tmp_path / "g.csv", arm, T, (Q, DQ), ("", ".vel"))
    for command, out in (
        ("torques", ["--plot", tmp_path / "a.png"]),
        ("view", ["--html", tmp_path / "a.html"]),
    ):
        code, text = run(command, robot, "--trajectory", bad, *out)
        assert (code, "LOOK AGAIN" in text) == (1, True)
        assert out[-1].is_file()
        assert run(command, robot, "--trajectory", good, *out)[0] == 0


def test_columns_and_a_rate_are_told_to_the_shell(run, tmp_path):
    robot, path = tmp_path / "arm.urdf", tmp_path / "raw.csv"
    robot.write_text(ARM)
    np.savetxt(path, np.degrees(Q), fmt="%.12f", delimiter=";", header="first;second", comments="")
    flags = ("--columns", "shoulder_joint=first", "--columns", "elbow_joint=second", "--rate", "100", "--degrees")
    code, text = run("torques", robot, "--trajectory", path, *flags, "--csv", tmp_path / "a.csv")
    assert code == 0, text
    np.savetxt(tmp_path / "b.in.csv", np.column_stack([T, Q]), delimiter=",", header=",".join(EXACT), comments="")
    run("torques", robot, "--trajectory", tmp_path / "b.in.csv", "--csv", tmp_path / "b.csv")
    a, b = (np.loadtxt(tmp_path / f"{x}.csv", delimiter=",", skiprows=1) for x in "ab")
    np.testing.assert_allclose(a, b, atol=1e-5)
    for wrong, said in (("elbow_joint", "is not JOINT=COLUMN"), ("elbow_joint=", "is not JOINT=COLUMN")):
        code, text = run("torques", robot, "--trajectory", path, "--columns", wrong)
        assert (code, said in text) == (2, True), text


def test_a_pose_of_the_base_that_was_not_logged_is_held_by_no_option(run, tmp_path):
    robot, path = tmp_path / "arm.urdf", tmp_path / "joints.csv"
    robot.write_text(ARM)
    np.savetxt(path, np.column_stack([T, Q]), delimiter=",", header=",".join(EXACT), comments="")
    code, text = run("torques", robot, "--floating-base", "--trajectory", path)
    assert (code, "--lock" in text) == (2, False), text
    assert "load the robot with its base fixed" in text


def test_a_column_that_fits_two_joints_is_offered_for_neither(run, tmp_path):
    header = "time,base,shoulder,elbow,wrist1,wrist2,wrist3"
    np.savetxt(tmp_path / "own.csv", np.zeros((9, 7)) + T[:9, None], delimiter=",", header=header, comments="")
    code, text = run("torques", "ur5", "--trajectory", tmp_path / "own.csv")
    assert (code, "=shoulder" in text) == (2, False), text
    assert "wrist_1_joint=wrist1" in text


def test_joints_are_locked_by_patterns_and_where_the_log_leaves_them_out(run, tmp_path):
    robot, path = tmp_path / "arm.urdf", tmp_path / "one.csv"
    robot.write_text(ARM)
    np.savetxt(path, np.column_stack([T, Q[:, 0]]), delimiter=",", header="time,shoulder_joint", comments="")
    code, text = run("torques", robot, "--trajectory", path)
    assert code == 2
    assert "when the robot is loaded: --lock elbow_joint=0." in text
    figures = set()
    for flags in (
        ["--lock-missing"],
        ["--lock", "elbow_joint=0"],
        ["--lock", "elb*=0"],
        ["--lock", "elb*=1", "--lock", "elbow_joint=0"],
    ):
        code, text = run("torques", robot, "--trajectory", path, *flags)
        assert code == 0, text
        assert ("held still, as the motion has no column for them: elbow_joint=0" in text) == (
            flags == ["--lock-missing"]
        )
        figures.add(re.search(r"shoulder_joint +(\S+)", text)[1])
    assert len(figures) == 1
    for flags, said in (
        (["--lock", "*wheel*=0"], "no joint that fits the pattern named '*wheel*'"),
        (["--lock", "elb*=0", "--lock", "*bow*=1"], "both hold 'elbow_joint'"),
        (["--lock", "elbow_joint=90"], "If 90 are degrees, add --degrees, or write 1.5708"),
        (["--lock", "elbow_joint=200", "--degrees"], "outside the joint's limits, -183.346° to 183.346°"),
    ):
        code, text = run("torques", robot, "--trajectory", path, *flags)
        assert (code, said in text) == (2, True), text


def test_a_chain_holds_all_joints_beside_it(run):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        model = robots.quadruped().model
    assert len(joints_beside(model, "FL_hip", "FL_calf")) == len(model.leaders) - 2
    assert len(joints_beside(model, "FL_calf", "FR_calf")) == len(model.leaders) - 6
    with pytest.raises(ValueRangeError, match="no joint moves one of these frames from the other"):
        joints_beside(model, "FL_calf", "FL_calf")
    code, text = run("info", "ur5", "--chain", "upper_arm_link", "wrist_1_link")
    assert code == 0, text
    assert "2 moving bodies" in text
    assert run("info", "ur5", "--chain", "upper_arm_link", "nothing")[0] == 2


def test_what_is_locked_stays_where_it_was_put_beside_a_chain_too():
    lock, chain = {"wrist_3_joint": 0.7}, ("upper_arm_link", "wrist_1_link")
    whole, part = robots.ur5(), RobotOptions("ur5", {"lock": lock}, chain=chain).load()
    assert part.joint_names == ("elbow_joint", "wrist_1_joint")
    q = np.array([0, 0, 0.3, -0.4, 0, 0.7])
    np.testing.assert_allclose(part.forward_kinematics(q[2:4]), whole.forward_kinematics(q), atol=1e-12)


# ── real logs ──

DOUBLE = "dfki_double_pendulum/20220812-{}-PM_measured.csv"


@pytest.mark.skipif(not LOGS.is_dir(), reason="../shared/logs is not there")
@pytest.mark.parametrize("name, rows", [("060143", 2001), ("060245", 2008), ("063536", 2466)])
def test_the_double_pendulums_logs_go_in_by_themselves(name, rows):
    model = load_model(robots.path_of("planar_2r"))
    path = LOGS / DOUBLE.format(name)
    whole = np.loadtxt(path, delimiter=",", skiprows=1)
    motion, log = read(path, model)
    assert len(motion.time) == len(np.unique(whole[:, 0]))
    if len(motion.time) == len(whole):
        for part, columns in (("time", 0), ("q", [1, 2]), ("dq", [3, 4]), ("tau", [5, 6])):
            np.testing.assert_array_equal(getattr(motion, part), whole[:, columns])
    assert [d for d in log.doubts() if d.level != "note"] == []


@pytest.mark.skipif(not (LOGS.is_dir() and ROBOTS.is_dir()), reason="../shared/logs and ../shared/robots are not there")
def test_motor_positions_without_a_time_column_go_in_with_a_rate():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        model = load_model(ROBOTS / "staubli_tx40.urdf")
    motion, _ = read(LOGS / "staubli_tx40" / "pos_read_data.csv", model, rate=5000.0)
    assert motion.q.shape == (27000, 6)
    assert motion.time[-1] == pytest.approx(26999 / 5000)


@pytest.mark.skipif(not LOGS.is_dir(), reason="../shared/logs is not there")
def test_tiagos_columns_are_known_by_their_suffixes():
    joints = ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))]
    reader = NamedJoints(joints)
    for kind, part in (("position", "q"), ("velocity", "dq"), ("effort", "tau")):
        header = open_motion_file(LOGS / "tiago" / f"tiago_{kind}.csv").header
        meanings = [reader.meaning(name) for name in header[1:]]
        assert [(m.name, m.part) for m in meanings] == [(k, part) for k in range(8)]


def test_joints_without_a_column_are_found(model, write):
    assert joints_without_column(write("time,elbow_pos\n0,1\n"), model) == ("shoulder_joint",)
    assert joints_without_column(write("time,x\n0,1\n"), model, {"elbow_joint": "x"}) == ("shoulder_joint",)


def test_a_gap_in_a_log_is_told_from_its_first_line_to_its_last(tmp_path):
    """NaN stands in four lines one after another: no number is made up for them, and none has to be searched."""
    rows = [f"{0.1 * k:g};{k % 7};{'NaN' if 3 <= k < 7 else k % 5}" for k in range(20)]
    (tmp_path / "gap.csv").write_text("\n".join(["time;joint1 [deg];joint2 [deg]", *rows]))
    arm = tw.robots.planar_2r()
    with pytest.raises(tw.TrajectoryError) as caught:
        tw.Motion.from_file(tmp_path / "gap.csv", arm)
    told = "line 5, column 'joint2 [deg]' is 'NaN', and so on to line 8. Samples must be finite: fill or remove these rows."
    assert told in str(caught.value)
    frame = pytest.importorskip("pandas").read_csv(tmp_path / "gap.csv", sep=";")
    with pytest.raises(tw.TrajectoryError) as caught:
        tw.Motion.from_dataframe(frame, arm)
    assert "row 4, column 'joint2 [deg]' is nan, and 3 more rows here" in str(caught.value)
    assert "frame.dropna()" in str(caught.value)
    assert len(tw.Motion.from_dataframe(frame.dropna(), arm)) == 16


def test_what_a_simulation_wrote_is_read_back_without_a_word(tmp_path):
    """Energies, works and momenta follow from the motion: that they are not coordinates is not news."""
    arm = tw.robots.planar_2r()
    fall = arm.simulate([0.3, 0.2], duration=0.1, dt=0.01)
    motion = tw.Motion.from_file(fall.to_csv(tmp_path / "fall.csv"), arm)
    assert motion.notes == ()
    assert (motion.ddq == fall.ddq).all()


# ── rounded stamps, pauses ──

PAUSED = np.r_[np.arange(0, 4, 0.004), np.arange(6, 10, 0.004)] + 0.0013
"""Times of a log of 250 Hz that pauses for two seconds."""


def paused_log(path, arm, *columns):
    """Log whose stamps are whole multiples of 10 ms, with some of the columns q, tau."""
    q = np.stack([np.sin(1.3 * PAUSED), np.cos(1.9 * PAUSED)], axis=1)
    parts = {"q": q, "tau": 10 * q}
    names = {"q": arm.joint_names, "tau": [f"{n}.tau" for n in arm.joint_names]}
    table = np.column_stack([10 * np.floor(100 * PAUSED), *(parts[c] for c in columns)])
    header = ",".join(["time [ms]", *(n for c in columns for n in names[c])])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.mark.parametrize("files", ["one", "joined"])
def test_rounded_stamps_in_milliseconds_keep_their_pause(arm, tmp_path, files):
    """Of one file and of two side by side: a steady clock in seconds, which nothing of the pause bends."""
    if files == "one":
        path = paused_log(tmp_path / "log.csv", arm, "q", "tau")
    else:
        path = f"{paused_log(tmp_path / 'a.csv', arm, 'q')}+{paused_log(tmp_path / 'b.csv', arm, 'tau')}"
    motion = tw.Motion.from_file(path, arm)
    assert len(motion) == len(PAUSED)
    steps, pause = np.diff(motion.time), np.diff(PAUSED).argmax()
    assert steps.argmax() == pause and abs(steps[pause] - 2.0) < 0.02
    np.testing.assert_allclose(np.delete(steps, pause), 0.004, rtol=0.01)
    assert np.abs(motion.time - PAUSED).max() < 0.01
    assert any("a steady clock of 250" in note for note in motion.notes)


@pytest.mark.parametrize("given", ["q", "dq"])
def test_a_pause_is_not_differentiated_across(arm, given):
    """Rates before it are those of the log that ends there, to the bit, and close to the truth at its edges."""
    q = np.stack([np.sin(1.3 * PAUSED), np.cos(1.9 * PAUSED)], axis=1)
    dq = np.stack([1.3 * np.cos(1.3 * PAUSED), -1.9 * np.sin(1.9 * PAUSED)], axis=1) if given == "dq" else None
    motion, first = tw.Motion(PAUSED, q, dq, robot=arm), slice(0, 1000)
    before = tw.Motion(PAUSED[first], q[first], None if dq is None else dq[first], robot=arm)
    np.testing.assert_array_equal(motion.ddq[first], before.ddq)
    np.testing.assert_allclose(motion.ddq, -q * [1.3**2, 1.9**2], atol=2e-5)
