"""Columns of logs are matched to joints by their names, and what matches none is refused with a line that can be pasted."""

from __future__ import annotations

import random
import re
import shlex

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.cli.shared import parse_columns
from twistwrench.core.errors import TrajectoryError, TwistWrenchError, ValueRangeError
from twistwrench.motion import MotionLog

UR5 = tw.robots.path_of("ur5").read_text()
OWN = tw.robots.ur5().joint_names
TIME = np.arange(200) * 0.01
Q = 0.4 * np.sin(np.outer(TIME, [1.0, 1.3, 1.7, 2.1, 2.6, 3.1]) + np.arange(6))
TAU = np.asarray(tw.Motion(TIME, Q, robot=tw.robots.ur5()).torques())


def named(names):
    """The UR5 with other names of joints."""
    text = UR5
    for k, old in enumerate(OWN):
        text = re.sub(rf'"{old}"', f'"#{k}#"', text)
    for k, new in enumerate(names):
        text = text.replace(f'"#{k}#"', f'"{new}"')
    return text.replace('<robot name="ur5"', '<robot name="arm"')


def written(path, header, *columns, separator=",", comma=False):
    rows = np.column_stack([np.asarray(x, float).reshape(len(TIME), -1) for x in columns])
    lines = [separator.join(repr(x) for x in row) for row in rows.tolist()]
    text = "\n".join([separator.join(header), *(line.replace(".", ",") if comma else line for line in lines)])
    path.write_text(text + "\n")
    return path


def echoed(path, names=OWN, date=0):
    """What ``rostopic echo -p /joint_states`` writes: names in the cells of every row."""
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    header += [f"field.{part}{k}" for part in ("name", "position", "effort") for k in range(6)]
    rows = [",".join(header)]
    for k, t in enumerate(TIME):
        nano = str(date * 10**9 + round(t * 1e9))
        order = [2, 1, 0, 3, 4, 5]
        cells = [nano, str(k), nano, "", *(names[j] for j in order), *(str(Q[k, j]) for j in order)]
        rows.append(",".join([*cells, *(str(TAU[k, j]) for j in order)]))
    path.write_text("\n".join(rows) + "\n")
    return path


NUMBERED = [f"joint_{k}" for k in range(1, 7)]
PANDA = [f"panda_joint{k}" for k in range(1, 7)]
KUKA = [f"joint_a{k}" for k in range(1, 7)]
BODIES = ["waist", "shoulder", "elbow", "roll", "bend", "turn"]
PLACES = ["base", "base", "arm", "wrist", "wrist", "hand"]
DEGREES = np.degrees(Q)


def maker(header, q=Q, names=NUMBERED, time="time", **form):
    return names, lambda path: written(path, [time, *header], TIME, q, **form)


DOORS = {
    "rostopic echo -p": (OWN, echoed),
    "another prefix": maker([f"fer_joint{k}" for k in range(1, 7)], names=PANDA),
    "a prefix of the log": maker([f"left/arm/{name}" for name in OWN], names=OWN),
    "a prefix of the robot": maker(["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"], names=PANDA),
    "KUKA": maker([f"A{k}" for k in range(1, 7)], DEGREES, KUKA, "Zeit", separator=";", comma=True),
    "ABB": maker([f"rax_{k}" for k in range(1, 7)], DEGREES),
    "UR's RTDE": maker([f"actual_q_{k}" for k in range(6)], names=OWN, time="timestamp"),
    "German": maker([f"Achse {k} [°]" for k in range(1, 7)], DEGREES, OWN, "Zeit", separator=";", comma=True),
    "Italian": maker([f"asse_{k}" for k in range(1, 7)], names=OWN, time="tempo"),
    "Franka": maker([f"q_{k}" for k in range(6)], names=PANDA),
    "endings": maker(BODIES, names=[f"{place}_{body}" for place, body in zip(PLACES, BODIES, strict=True)]),
    "time without a name": maker(NUMBERED, time="uhr"),
    "time with a unit": maker(NUMBERED, time="Laufzeit [s]"),
    "Chinese": maker(NUMBERED, time="时间"),
}


@pytest.mark.parametrize("case", DOORS)
def test_one_command_reads_each_door_and_gives_the_same_torques(case, tmp_path, monkeypatch):
    names, write = DOORS[case]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(named(names))
    write(tmp_path / "log.csv")
    result = CliRunner().invoke(main, ["torques", "arm.urdf", "--trajectory", "log.csv", "--csv", "out.csv"])
    assert result.exit_code in (0, 1), result.output
    table = np.genfromtxt("out.csv", delimiter=",", names=True, deletechars="")
    tau = np.column_stack([table[f"{name}.torque"] for name in names])
    assert np.abs(tau - TAU).max() < 1e-9 * np.abs(TAU).max()


def test_the_rule_is_named_in_the_note(tmp_path):
    rules = {
        "another prefix": "are taken by their names, a common prefix aside: fer_joint1 is panda_joint1",
        "KUKA": "are taken by their names, a common prefix aside: A1 is joint_a1",
        "endings": "are taken by the ends of their names: waist is base_waist",
        "ABB": "are taken in their order: rax_1 is joint_1",
        "time without a name": "Column 'uhr' is taken to be the time, the only one that rises in every row",
    }
    for case, said in rules.items():
        names, write = DOORS[case]
        log = MotionLog.open(write(tmp_path / "log.csv"), tw.load(named(names)).model)
        assert said in " ".join(log.notes), log.notes


def test_times_since_1970_count_from_the_first_row_and_the_date_is_said_once(tmp_path):
    motion = tw.Motion.from_file(echoed(tmp_path / "log.csv", date=1_700_000_000), tw.robots.ur5())
    assert motion.time[0] == 0 and np.abs(motion.time - TIME).max() < 1e-6
    assert [note for note in motion.notes if "2023" in note] == ["Time counts from 2023-11-14 22:13:20 UTC."]


# ── What matches no joint


def refused(tmp_path, monkeypatch, names, header, *columns, arguments=(), **form):
    """The error of a log, and the output of the same command with the options that the error prints."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(named(names))
    written(tmp_path / "log.csv", header, *columns, **form)
    command = ["torques", "arm.urdf", "--trajectory", "log.csv", *arguments]
    error = CliRunner().invoke(main, command)
    assert error.exit_code == 2, error.output
    option = re.search(r"(--columns '[^']*'(?: --degrees)?)", " ".join(error.output.split()))[1]
    return " ".join(error.output.split()), CliRunner().invoke(
        main, [*command, *shlex.split(option), "--csv", "out.csv"]
    )


def test_the_line_to_copy_works_when_pasted(tmp_path, monkeypatch):
    header = ["Zeit", *(f"M{k} Ist" for k in range(1, 7))]
    error, pasted = refused(tmp_path, monkeypatch, KUKA, header, TIME, DEGREES, separator=";", comma=True)
    assert (
        "Columns M1 Ist … M6 Ist match no joint by name. If they are the joints in order: --columns 'joint_a1=M1 Ist,"
        in error
    )
    assert pasted.exit_code in (0, 1), pasted.output
    table = np.genfromtxt("out.csv", delimiter=",", names=True, deletechars="")
    tau = np.column_stack([table[f"{name}.torque"] for name in KUKA])
    assert np.abs(tau - TAU).max() < 1e-9 * np.abs(TAU).max()


def test_a_name_with_a_comma_is_quoted_in_the_line(tmp_path, monkeypatch):
    header = ["time", *(f'"enc, {k}"' for k in range(1, 7))]
    error, pasted = refused(tmp_path, monkeypatch, OWN, header, TIME, Q)
    assert '="enc, 1"' in error and "--degrees" not in error
    assert pasted.exit_code in (0, 1), pasted.output


LEFT_OVER = {
    "seven for six": ([f"fer_joint{k}" for k in range(1, 8)], PANDA),
    "two arms": ([f"{side}_joint{k}" for side in ("left", "right") for k in range(1, 7)], PANDA),
    "two that end alike": ([*(f"A{k}" for k in range(1, 7)), "A7"], KUKA),
    "one of another robot": (["other_a1", *(f"robot_a{k}" for k in range(2, 7))], [f"a{k}" for k in range(1, 7)]),
    "commanded": ([f"target_joint{k}" for k in range(1, 7)], PANDA),
    "temperatures": ([f"temp_joint{k}" for k in range(1, 7)], PANDA),
}


@pytest.mark.parametrize("case", LEFT_OVER)
def test_columns_named_alike_that_are_left_over_win_nothing(case, tmp_path):
    columns, names = LEFT_OVER[case]
    path = written(tmp_path / "log.csv", ["time", *columns], TIME, np.resize(Q.T, (len(columns), len(TIME))).T)
    with pytest.raises(TrajectoryError, match=f"no column for {names[0]}"):
        MotionLog.open(path, tw.load(named(names)).model)


def test_of_two_series_of_columns_none_is_the_only_one(tmp_path):
    """A1 and A2 may be the two joints in order, and that is proposed; beside B1 and B2 nothing is."""
    for others, proposed in ((["E1"], True), (["B1", "B2"], False)):
        path = written(tmp_path / "log.csv", ["time", "A1", "A2", *others], TIME, Q[:, : 2 + len(others)])
        with pytest.raises(TrajectoryError, match="no column for joint1") as caught:
            tw.Motion.from_file(path, tw.robots.planar_2r())
        assert ("If they are the joints in order" in str(caught.value)) is proposed


def test_locked_joints_are_no_columns_left_over(tmp_path):
    """Seven columns of another prefix, and the robot's last two joints held still."""
    path = written(tmp_path / "log.csv", ["time", *(f"fer_joint{k}" for k in range(1, 7))], TIME, Q)
    robot = tw.load(named(PANDA)).lock({"panda_joint5": 0.0, "panda_joint6": 0.0})
    log = MotionLog.open(path, robot.model)
    assert np.array_equal(log.motion(log.table).q, Q[:, :4])


def test_lock_missing_knows_columns_of_another_prefix(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(named(PANDA))
    written(tmp_path / "log.csv", ["time", *(f"fer_joint{k}" for k in range(1, 5))], TIME, Q[:, :4])
    result = CliRunner().invoke(main, ["torques", "arm.urdf", "--trajectory", "log.csv", "--lock-missing"])
    assert result.exit_code in (0, 1) and "4 of 6 joints checked" in " ".join(result.output.split()), result.output


def random_header(rng):
    """Names of a robot's joints, a log's columns in any order, and which column is truly each joint's (None: any answer)."""
    kinds = ["joint{}", "joint_{}", "j{}", "axis_{}", "joint_a{}", "shoulder_{}", "hip_{}_joint"]
    kind, count = rng.choice(kinds), rng.randint(2, 7)
    bodies = [kind.format(k + 1) for k in range(count)]
    if rng.random() < 0.3:
        bodies = rng.sample(
            ["waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate", "base_yaw"], count
        )
    robot, log = (
        rng.choice(["", "panda_", "ur_", "left_arm_"]),
        rng.choice(["", "fer_", "robot/", "left_arm_", "ns/arm0/"]),
    )
    joints = [robot + body for body in bodies]
    ending = rng.choice(["", "_pos", "_position", ".pos"])
    truth = {joint: f"{log}{body}{ending}" for joint, body in zip(joints, bodies, strict=True)}
    others = [f"{log}{body}{rng.choice(['_temp', '_current', '_target', '_error', '_vel'])}" for body in bodies]
    others += [f"other_{body}{ending}" for body in bodies] * (rng.random() < 0.3)
    others += [f"{log}gripper_{k}{ending}" for k in range(rng.randint(0, 2))] + ["status"]
    columns = list(dict.fromkeys([*truth.values(), *rng.sample(others, rng.randint(0, len(others)))]))
    if rng.random() < 0.2:  # one is missing
        columns.remove(truth.pop(rng.choice(joints)))
    rng.shuffle(columns)
    return joints, columns, truth


def test_no_wrong_match_in_300_headers_of_random_orders_and_prefixes(tmp_path):
    """Right, or refused; and most are understood."""
    from twistwrench.motion.columns import Columns, Reading
    from twistwrench.motion.coordinates import Coordinates

    rng, understood = random.Random(7), 0
    for _ in range(300):
        joints, columns, truth = random_header(rng)
        count = len(joints)
        flags = np.ones(count, bool)
        coordinates = Coordinates(tuple(joints), tuple(joints), flags, flags, np.arange(count), ~flags, (), ())
        try:
            found = Columns.from_header(
                ["time", *columns], coordinates, "log", Reading(tmp_path), lambda k: np.zeros(3)
            )
        except TrajectoryError:
            continue
        matched = {joint: found.header[int(k)] for joint, k in zip(joints, found.places["q"], strict=True)}
        assert matched == truth, (joints, columns, matched)
        understood += 1
    assert understood > 150


# ── --columns


def test_columns_are_a_list_or_a_map():
    assert parse_columns(["time=Zeit,a=A1", "b=A2 [deg]"], []) == {"time": "Zeit", "a": "A1", "b": "A2 [deg]"}
    assert parse_columns(["A1,A2 [deg]"], []) == {"#1": "A1", "#2": "A2 [deg]"}
    assert parse_columns(['"x,1","y=2"'], []) == {"#1": "x,1", "#2": "y=2"}
    assert parse_columns(['a="say ""x"", y"'], []) == {"a": 'say "x", y'}


def test_a_list_gives_the_columns_in_the_order_of_the_joints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "log.csv", ["t", *"abcdef"], TIME, Q)
    command = ["torques", "ur5", "--trajectory", "log.csv", "--csv", "out.csv", "--overwrite", "--columns"]
    (tmp_path / "map.csv").write_text(
        "name,column\n" + "\n".join(f"{n},{c}" for n, c in zip(OWN, "abcdef", strict=True))
    )
    for told in ("a,b,c,d,e,f", "@map.csv"):
        result = CliRunner().invoke(main, [*command, told])
        assert result.exit_code in (0, 1), result.output
        tau = np.loadtxt("out.csv", delimiter=",", skiprows=1)[:, 1:7]
        assert np.abs(tau - TAU).max() < 1e-9 * np.abs(TAU).max()


BAD_COLUMNS = {
    "a": "is not JOINT=COLUMN",
    "a=b,c": "is not JOINT=COLUMN",
    "a,,b": "is not JOINT=COLUMN",
    "=b": "is not JOINT=COLUMN",
    "a=": "is not JOINT=COLUMN",
    "": "is not JOINT=COLUMN",
    "a=b,a=c": "a is given twice",
    "@none.csv": "no map of columns 'none.csv'",
}


@pytest.mark.parametrize("text", BAD_COLUMNS)
def test_bad_columns_are_one_error(text):
    with pytest.raises(TwistWrenchError, match=re.escape(BAD_COLUMNS[text])):
        parse_columns([text], [])


def test_bad_maps_and_lists_are_one_error(tmp_path):
    for content, said in (
        ("a,b\n1,2\n", "the header is 'a,b'"),
        ("", "is empty"),
        ("name,column\nx\n", "has 1 values"),
    ):
        (tmp_path / "map.csv").write_text(content)
        with pytest.raises(ValueRangeError, match=re.escape(said)):
            parse_columns([f"@{tmp_path / 'map.csv'}"], [])
    path = written(tmp_path / "log.csv", ["t", *"abcdef"], TIME, Q)
    with pytest.raises(TrajectoryError, match=r"columns=… lists 2 columns, and the robot has 6 coordinates"):
        MotionLog.open(path, tw.robots.ur5().model, columns={"#1": "a", "#2": "b"})


# ── Time


def test_an_index_is_never_the_time_and_two_that_rise_are_none(tmp_path):
    model = tw.load(named(NUMBERED)).model
    bad = {"row": np.arange(200), "count": TIME, "battery_used": TIME, "temp": TIME}
    for name, column in bad.items():
        path = written(tmp_path / "log.csv", [name, *NUMBERED], column, Q)
        with pytest.raises(TrajectoryError, match=r"no time column.*rate=HZ"):
            MotionLog.open(path, model)
    path = written(tmp_path / "log.csv", ["x", "y", *NUMBERED], TIME, 2 * TIME, Q)
    with pytest.raises(TrajectoryError, match="no time column"):
        MotionLog.open(path, model)
    still = written(tmp_path / "log.csv", NUMBERED, np.column_stack([Q[:, :5], TIME]))
    with pytest.raises(TrajectoryError, match="no time column"):
        MotionLog.open(still, model)


BAD_ECHO = {
    "names that change": lambda text: text.replace("shoulder_pan_joint", "gripper", 3).replace(
        "gripper", "shoulder_pan_joint", 1
    ),
    "cut short": lambda text: text[: len(text) // 2],
    "no rows": lambda text: text.split("\n")[0] + "\n",
}


@pytest.mark.parametrize("case", BAD_ECHO)
def test_bad_output_of_rostopic_is_one_error(case, tmp_path):
    path = echoed(tmp_path / "log.csv")
    path.write_text(BAD_ECHO[case](path.read_text()))
    with pytest.raises(TrajectoryError, match=r"log\.csv"):
        tw.Motion.from_file(path, tw.robots.ur5())
