"""Logs that name the joints of one part of a cell: the message names the option with which they are read."""

from __future__ import annotations

import ast
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench import TrajectoryError
from twistwrench.cli.main import main

RAIL = """<robot name="rail"><link name="track"/><link name="carriage"><inertial><mass value="20"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic"><parent link="track"/><child link="carriage"/><axis xyz="1 0 0"/>
  <limit lower="0" upper="3" effort="2000" velocity="1"/></joint></robot>"""
FINGER = RAIL.replace("rail", "finger").replace("carriage", "pad").replace("track", "palm").replace('"20"', '"0.1"')
T = np.arange(0.0, 2.0, 0.01)
NAMINGS = {
    "by names": lambda names: [*names],
    "by short names": lambda names: [name.removesuffix("_joint") for name in names],
    "numbered": lambda names: [f"q{k}" for k in range(len(names))],
    "as a UR's recorder": lambda names: [f"actual_q_{k}" for k in range(len(names))],
}


@pytest.fixture
def parts(tmp_path):
    for name, text in (("rail", RAIL), ("hand", FINGER)):
        (tmp_path / f"{name}.urdf").write_text(text)
    return tmp_path


def joined(folder, *parts):
    path = folder / "cell.urdf"
    tw.join(str(folder / "rail.urdf"), *parts).write(path)
    return path


def curves(count):
    return 0.3 * np.sin(T[:, None] + np.arange(count)) + 0.2


def log_of(folder, names, q=None, unused=()):
    path = folder / "log.csv"
    table = np.column_stack([T, curves(len(names)) if q is None else q, *(np.cos(T + k) for k in range(len(unused)))])
    np.savetxt(path, table, delimiter=",", header=",".join(["time", *names, *unused]), comments="")
    return path


def told(cell, log):
    with pytest.raises(TrajectoryError) as caught:
        tw.check(cell, log)
    return caught.value


@pytest.mark.parametrize(("arm", "naming"), [*(("ur5", naming) for naming in NAMINGS), ("panda", "numbered")])
def test_with_the_option_that_the_message_names_the_arm_has_the_torques_of_the_whole_cell(parts, arm, naming):
    """The cell moved with rail and finger at rest, in full coordinates, is the other way to the same torques."""
    tip = tw.load(arm).tip
    cell = joined(parts, f"{arm}@carriage", f"{parts / 'hand.urdf'}@{tip}:hand_")
    whole = tw.load(cell)
    names = [name for name in whole.joint_names if name not in ("rail", "hand_finger")]
    log = log_of(parts, NAMINGS[naming](names))

    text = str(told(cell, log))
    assert f"{len(names)} columns fit the {len(names)} joints of the arm; rail and hand_finger have none" in text
    lock = ast.literal_eval(re.search(r"lock=(\{.*?\})", text)[1])
    assert set(lock) == {"rail", "hand_finger"}

    held = tw.load(cell, lock=lock)
    read = tw.Motion.from_file(log, held)
    at = [whole.joint_names.index(name) for name in held.joint_names]
    q, dq, ddq = (np.zeros((len(read.q), whole.nv)) for _ in range(3))
    for part, values in ((q, read.q), (dq, read.dq), (ddq, read.ddq)):
        part[:, at] = values
    np.testing.assert_allclose(read.q, curves(len(names)), atol=1e-12)
    scale = np.abs(whole.inverse_dynamics(q, dq, ddq)).max()
    np.testing.assert_allclose(
        held.inverse_dynamics(read.q, read.dq, read.ddq), whole.inverse_dynamics(q, dq, ddq)[:, at], atol=1e-12 * scale
    )  # the same bodies, some of them fixed


def test_the_option_of_the_shell_takes_commas_and_is_to_be_copied(parts):
    cell = joined(parts, "ur5@carriage", f"{parts / 'hand.urdf'}@tool0:hand_")
    log = log_of(parts, [f"q{k}" for k in range(6)])
    run = CliRunner().invoke(main, ["torques", str(cell), "--trajectory", str(log)])
    assert run.exit_code == 2 and "--lock rail=0,hand_finger=0." in run.stderr
    again = CliRunner().invoke(main, ["torques", str(cell), "--trajectory", str(log), "--lock", "rail=0,hand_finger=0"])
    assert again.exit_code in (0, 1), again.stderr


def test_of_two_arms_the_one_with_columns_is_named(parts):
    cell = joined(parts, "ur5@carriage:left_", "ur5@carriage+0,1,0,0,0,0:right_")
    names = [name for name in tw.load(cell).joint_names if name.startswith("right_")]
    text = str(told(cell, log_of(parts, names)))
    assert "6 columns fit the 6 joints of one arm, right_shoulder_pan_joint to right_wrist_3_joint; rail, left_" in text
    both = [name for name in tw.load(cell).joint_names if name != "rail"]
    assert "12 columns fit the 12 joints of the arms; rail has none" in str(told(cell, log_of(parts, both)))


def test_numbered_columns_that_may_be_either_arm_are_given_to_none(parts):
    cell = joined(parts, "ur5@carriage:left_", "ur5@carriage+0,1,0,0,0,0:right_")
    assert "columns fit" not in str(told(cell, log_of(parts, [f"q{k}" for k in range(6)])))


def test_a_log_that_lacks_a_joint_of_the_arm_names_that_joint(parts):
    cell = joined(parts, "ur5@carriage")
    names = [name for name in tw.load("ur5").joint_names if name != "elbow_joint"]
    text = str(told(cell, log_of(parts, names)))
    assert "no column for rail, elbow_joint" in text and "columns fit" not in text


def test_a_column_that_may_be_the_missing_joint_is_named_before_any_joint_is_held(parts):
    cell = joined(parts, "ur5@carriage")
    text = str(told(cell, log_of(parts, tw.load("ur5").joint_names, unused=["seventh_axis"])))
    assert "columns fit" not in text and "seventh_axis" in text and "lock=" not in text


# ── Joints that are held, in whatever way that is written


def torques(*options):
    """Exit code, and the report with its lines joined."""
    run = CliRunner().invoke(main, ["torques", *map(str, options)])
    return run.exit_code, " ".join(run.stdout.split()) or run.stderr


def words_of_all_ways(cell, log, **options):
    """First line of one question in the ways to hold the joints of the rail and the finger."""
    lock = {"rail": 0, "hand_finger": 0}
    held = tw.load(cell).lock(lock)
    limits = ["--limits", options["limits"]] if options else []
    typed = [
        torques(cell, log, "--lock", "rail=0,hand_finger=0", *limits)[1],
        torques(cell, log, "--lock-missing", *limits)[1],
    ]
    answers = [tw.check(cell, log, lock=lock, **options), tw.check(held, log, **options)]
    if not options:
        answers.append(tw.check(held, tw.Motion.from_file(log, held)))
    return [*typed, *(str(answer.headline) for answer in answers)]


@pytest.fixture
def cell(parts):
    return joined(parts, "ur5@carriage", f"{parts / 'hand.urdf'}@tool0:hand_")


def test_a_column_that_moves_beside_a_held_joint_is_doubted_however_the_joint_is_held(cell, parts):
    log = log_of(parts, tw.load("ur5").joint_names, unused=["E1"])
    for said in words_of_all_ways(cell, log):
        assert said.startswith("LOOK AGAIN: 6 of 8 joints checked: rail, hand_finger held still without a column"), said
        assert "E1" in said


def test_an_ok_states_the_joints_that_are_held_however_they_are_held(cell, parts):
    log = log_of(parts, tw.load("ur5").joint_names)
    for said in words_of_all_ways(cell, log):
        assert said.startswith("OK") and "6 of 8 joints checked, and rail, hand_finger held still" in said, said
    assert "held still" not in tw.check("ur5", log).headline


def test_a_held_joint_with_its_own_column_leaves_other_columns_undoubted(cell, parts):
    log = log_of(parts, [*tw.load("ur5").joint_names, "rail", "hand_finger"], unused=["E1"])
    assert tw.check(cell, log, lock={"rail": 0, "hand_finger": 0}).verdict.ok


def test_a_locked_part_is_held_in_the_cell_that_it_joins(parts):
    rail = tw.load(parts / "rail.urdf", lock={"rail": 0.5})
    arm = tw.load("ur5")
    held = rail.attach(arm, frame="carriage", prefix="arm_").model.locked
    assert dict(held) == {"rail": ()} and dict(arm.attach(rail, prefix="b_").model.locked) == {"b_rail": ()}


def test_limits_of_held_joints_are_ignored_with_a_note_and_other_names_refused(cell, parts):
    log, table = log_of(parts, tw.load("ur5").joint_names), parts / "limits.csv"
    table.write_text("joint,velocity,effort\nrail,4,2000\nshoulder_lift_joint,,50\n")
    for said in words_of_all_ways(cell, log, limits=str(table)):
        assert said.startswith("OVER LIMIT: shoulder_lift_joint"), said
    code, said = torques(cell, log, "--lock-missing", "--limits", table)
    assert code == 1 and "Limits of locked joints are ignored: rail." in said
    lock = {"rail": 0, "hand_finger": 0}
    assert (
        tw.check(cell, log, lock=lock, limits={"rail": 2000.0, "shoulder_lift_joint": 50.0}).verdict.word
        == "OVER LIMIT"
    )

    table.write_text("joint,velocity,effort\nrial,4,2000\n")
    with pytest.raises(tw.ValueRangeError, match="no joint named 'rial'"):
        tw.check(cell, log, lock=lock, limits=table)
    with pytest.raises(tw.UnknownNameError, match="rial"):
        tw.check(cell, log, lock=lock, limits={"rial": 4.0})


@pytest.mark.parametrize("naming", NAMINGS)
def test_lock_missing_holds_what_the_columns_of_an_arm_leave_over(cell, parts, naming):
    log = log_of(parts, NAMINGS[naming](tw.load("ur5").joint_names))
    missing, typed = torques(cell, log, "--lock-missing"), torques(cell, log, "--lock", "rail=0,hand_finger=0")
    assert missing == typed and missing[1].startswith("OK"), missing


def test_lock_missing_holds_nothing_where_numbered_columns_may_be_either_arm(parts):
    cell = joined(parts, "ur5@carriage:left_", "ur5@carriage+0,1,0,0,0,0:right_")
    code, said = torques(cell, log_of(parts, [f"q{k}" for k in range(6)]), "--lock-missing")
    assert code == 2 and "no column for" in said


# ── Cells without a single tip, and columns in another order than the joints

GRIPPER = (
    """<robot name="gripper"><link name="palm"><inertial><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
    + "".join(
        f"""<link name="{side}"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
  </inertial></link><joint name="{side}_finger" type="prismatic"><parent link="palm"/><child link="{side}"/>
  <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="100" velocity="0.1"/></joint>"""
        for side in ("left", "right")
    )
    + "</robot>"
)


@pytest.fixture
def with_gripper(parts):
    (parts / "gripper.urdf").write_text(GRIPPER)
    return joined(parts, "ur5@carriage", f"{parts / 'gripper.urdf'}@tool0")


def test_the_message_of_a_payload_without_a_frame_is_to_be_copied(with_gripper, parts):
    """The palm carries both fingers, so it is the first frame that the payload may be at."""
    log = log_of(parts, tw.load(with_gripper).joint_names, 0.01 * curves(9))
    code, said = torques(with_gripper, log, "--payload", "0.5")
    assert code == 2 and "It may be one of palm, ee_link, left, right." in said
    option = re.search(r"Write (--payload \S+), or load with (--tip \S+)\.", said)
    for given in (option[1].split(), ["--payload", "0.5", *option[2].split()]):
        code, answer = torques(with_gripper, log, *given)
        assert code in (0, 1) and "0.5 kg" in answer, answer
    with pytest.raises(tw.FrameError, match=re.escape("payload='0.5@palm'")):
        tw.check(with_gripper, log, payload=0.5)
    with pytest.raises(tw.FrameError, match="tip='palm'"):
        tw.load(with_gripper).jacobian(np.zeros(9))


def test_a_joined_cell_without_a_single_tip_states_the_options(with_gripper):
    run = CliRunner().invoke(
        main, ["join", str(with_gripper.parent / "again.urdf"), str(with_gripper), "planar_2r@carriage"]
    )
    said = " ".join(run.stdout.split())
    assert "--payload 4@palm, or the robot a tip, --tip palm" in said and "no single tip" in said
    assert "--tip" not in CliRunner().invoke(main, ["join", str(with_gripper.parent / "b.urdf"), "ur5"]).stdout


def test_a_named_column_of_the_rail_leaves_the_others_in_their_order(parts):
    """Columns of a controller: six joints, then the rail."""
    cell, names = joined(parts, "ur5@carriage"), [*(f"J{k}" for k in range(1, 7)), "E1"]
    q = curves(7)
    log = log_of(parts, names, q * [1, 1, 1, 1, 1, 1, 1000])
    read = tw.Motion.from_file(log, tw.load(cell), columns={"rail": "E1 [mm]"})
    np.testing.assert_allclose(read.q, np.column_stack([q[:, 6], q[:, :6]]), atol=1e-12)


def test_a_list_of_columns_in_another_order_names_the_column_that_the_rail_has(parts):
    cell, names = joined(parts, "ur5@carriage"), [*(f"J{k}" for k in range(1, 7)), "E1"]
    log = log_of(parts, names, np.column_stack([100.0 * curves(6), curves(1)]))
    said = torques(cell, log, "--columns", ",".join(names), "--degrees")[1]
    assert said.startswith("LOOK AGAIN: rail goes to") and "rail has the column J1" in said
    assert "--columns 'rail=COLUMN'" in said
    named = ",".join(f"{joint}={column}" for joint, column in zip(tw.load(cell).joint_names, names, strict=True))
    assert "By the order" not in torques(cell, log, "--columns", named, "--degrees")[1]


def test_a_cell_in_place_of_its_robot_is_answered_with_the_robot(parts):
    cell = tw.join(str(parts / "rail.urdf"), "ur5@carriage")
    log = log_of(parts, cell.robot.joint_names)
    with pytest.raises(tw.RobotFileError, match=r"not from RobotCell\. Pass its \.robot\."):
        tw.check(cell, log)
    assert tw.check(cell.robot, log).verdict.ok


def test_the_question_for_the_frame_of_a_part_has_the_part_as_it_was_given(parts):
    given = [str(parts / "rail.urdf"), "ur5@carriage", str(parts / "hand.urdf")]
    assert f"{given[2]}@FRAME" in tw.join(*given).headline


def test_a_rectangle_is_of_feet_and_not_of_wheels(cell, parts):
    log = log_of(parts, tw.load(cell).joint_names)
    with pytest.raises(tw.ValueRangeError, match="LENGTHxWIDTH@FRAME, is of feet"):
        tw.check(cell, log, wheels="0.3x0.2@carriage")


def test_joints_that_a_short_table_counts_are_below_the_share_that_it_states(cell, parts):
    """Of 15 joints those with the smallest shares are counted."""
    log = log_of(parts, tw.load(cell).joint_names)
    report = tw.check(cell, log)
    shares = sorted(100 * abs(joint.peak / joint.limit) for joint in report.joints)
    count, most = re.search(r"(\d+) more below (\d+) %", torques(cell, log, "--bolts", "4x0.3")[1]).groups()
    largest = shares[int(count) - 1]
    assert largest < int(most) <= largest + 1
