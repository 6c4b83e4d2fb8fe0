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
