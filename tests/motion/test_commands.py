"""Commanded positions in files: names of each kind of log, units, pairs of topics, and joints without commands."""

from __future__ import annotations

import json

import numpy as np
import pytest
from ros_logs import CONTROLLER_STATE, HEADER, JOINT_STATE, POINT, controller_state, header, point, write_messages

import twistwrench as tw
from twistwrench.motion.motion_log import MotionLog

ARM = tw.robots.planar_2r()
NAMES = ARM.joint_names
TIME = np.linspace(0.0, 2.0, 101)
Q = np.stack([np.sin(2.0 * TIME), 1.0 - np.cos(3.0 * TIME)], axis=1)
COMMAND = Q + 0.01 * np.cos(5.0 * TIME)[:, None]


def written(path, names, command=COMMAND, positions=NAMES, factor=1.0):
    """CSV file with positions and commands under given names."""
    table = np.column_stack([TIME, Q, factor * command])
    np.savetxt(path, table, delimiter=",", header=",".join(["time", *positions, *names]), comments="", fmt="%.17g")
    return path


@pytest.mark.parametrize(
    ("positions", "names"),
    [
        (NAMES, [f"{name}.command" for name in NAMES]),
        (NAMES, [f"{name}_cmd" for name in NAMES]),
        (["actual_q_0", "actual_q_1"], ["target_q_0", "target_q_1"]),
        (["q_0", "q_1"], ["q_des_0", "q_des_1"]),
        (["observation.state.joint1.pos", "observation.state.joint2.pos"], ["action.joint1.pos", "action.joint2.pos"]),
        (["fer_joint1", "fer_joint2"], ["fer_joint1_desired", "fer_joint2_desired"]),
    ],
)
def test_names_of_commands_in_logs(positions, names, tmp_path):
    motion = tw.Motion.from_file(written(tmp_path / "log.csv", names, positions=positions), ARM)
    np.testing.assert_array_equal(motion.q, Q)
    np.testing.assert_array_equal(motion.command, COMMAND)


@pytest.mark.parametrize("ending", [".target_velocity", "_cmd_vel", ".commanded_torque"])
def test_commanded_velocities_and_torques_are_no_commanded_positions(ending, tmp_path):
    motion = tw.Motion.from_file(written(tmp_path / "log.csv", [f"{name}{ending}" for name in NAMES]), ARM)
    np.testing.assert_array_equal(motion.q, Q)
    assert motion.command is None and motion.tau is None


def test_a_motion_keeps_its_commands_in_files_and_parts(tmp_path):
    """Written and read again, with radians and degrees, as a part, as a table and as a dataset."""
    motion = tw.Motion(TIME, Q, robot=ARM, command=COMMAND)
    np.testing.assert_array_equal(tw.Motion.from_file(motion.to_csv(tmp_path / "a.csv"), ARM).command, COMMAND)
    again = tw.Motion.from_file(motion.to_csv(tmp_path / "b.csv", degrees=True), ARM)
    np.testing.assert_allclose(again.command, COMMAND, atol=1e-14)
    part = tw.Motion.from_file(motion.between(0.5, 1.5).to_csv(tmp_path / "c.csv"), ARM)
    np.testing.assert_array_equal(part.command, motion.between(0.5, 1.5).command)
    np.testing.assert_array_equal(tw.Motion.from_dataframe(motion.to_pandas(), ARM).command, COMMAND)
    assert motion.to_xarray().command.attrs["units"] == "rad"


def test_a_column_is_assigned_to_a_command_by_the_caller_in_its_unit(tmp_path):
    names = ["u1 [deg]", "u2 [deg]"]
    path = written(tmp_path / "log.csv", names, factor=float(np.degrees(1.0)))
    columns = {f"{joint}.command": column for joint, column in zip(NAMES, ["u1", "u2"], strict=True)}
    np.testing.assert_allclose(tw.Motion.from_file(path, ARM, columns=columns).command, COMMAND, atol=1e-14)


def test_a_joint_without_commands_is_nan_and_not_written(tmp_path):
    table = np.column_stack([TIME, Q, COMMAND[:, 1]])
    path = tmp_path / "log.csv"
    np.savetxt(
        path, table, delimiter=",", header=f"time,{','.join(NAMES)},{NAMES[1]}.command", comments="", fmt="%.17g"
    )
    motion = tw.Motion.from_file(path, ARM)
    assert np.isnan(motion.command[:, 0]).all()
    np.testing.assert_array_equal(motion.command[:, 1], COMMAND[:, 1])
    assert [name for name in motion.columns() if name.endswith(".command")] == [f"{NAMES[1]}.command"]
    with pytest.raises(tw.ShapeError, match=f"no commands of {NAMES[0]}"):
        tw.identification.identify_servos(ARM, path)
    with pytest.raises(tw.ValueRangeError, match="command has the entry nan"):
        tw.Motion(TIME, Q, robot=ARM, command=np.where(TIME[:, None] > 1.0, np.nan, COMMAND))


def test_torques_of_a_log_are_read_without_its_commands(tmp_path):
    """Commands that are missing in some rows are no obstacle if nobody needs them, and no column of another robot."""
    gaps = np.where(TIME[:, None] > 1.0, np.nan, COMMAND)
    path = written(tmp_path / "log.csv", [f"{name}.command" for name in NAMES], gaps)
    log = MotionLog.open(path, ARM.model)
    assert log.motion(log.table).command is None
    assert not log.notes


def test_a_dataset_has_actions(tmp_path):
    pyarrow = pytest.importorskip("pyarrow.parquet")
    import pyarrow as pa

    features = {name: {"names": list(NAMES), "unit": "degrees"} for name in ("observation.state", "action")}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"features": features}))
    (tmp_path / "data").mkdir()
    lists = {"observation.state": np.degrees(Q).tolist(), "action": np.degrees(COMMAND).tolist()}
    table = pa.table(lists | {"timestamp": TIME, "episode_index": np.zeros(len(TIME), int)})
    pyarrow.write_table(table, tmp_path / "data" / "file.parquet")
    motion = tw.Motion.from_file(tmp_path / "data" / "file.parquet", ARM)
    np.testing.assert_allclose(motion.command, COMMAND, atol=1e-12)


@pytest.mark.parametrize("form", ["new", "old"])
def test_a_controller_s_state_has_measured_positions_and_their_reference(form, tmp_path):
    wanted, measured = {"new": ("reference", "feedback"), "old": ("desired", "actual")}[form]
    others = {"new": ("error", "output"), "old": ("error",)}[form]
    messages = [
        (t, {"header": header(t), "joint_names": list(NAMES), measured: point(0, q), wanted: point(0, c)}
         | {name: point(0) for name in others})
        for t, q, c in zip(TIME, Q, COMMAND, strict=True)
    ]  # fmt: skip
    path = tmp_path / "state.mcap"
    write_messages(path, {"/state": (CONTROLLER_STATE, f"{controller_state(form)}{POINT}{HEADER}", messages)})
    motion = tw.Motion.from_file(path, ARM)
    np.testing.assert_array_equal(motion.q, Q)
    np.testing.assert_array_equal(motion.command, COMMAND)
    assert tw.Motion.from_file(path, ARM, topic="/state:reference").command is None


def joint_states(time, positions):
    return [
        (t, {"header": header(t), "name": list(NAMES), "position": x.tolist(), "velocity": [], "effort": []})
        for t, x in zip(time, positions, strict=True)
    ]


def test_a_pair_of_topics_gives_the_latest_command_before_each_row(tmp_path):
    kind, slow = "sensor_msgs/msg/JointState", slice(2, None, 3)
    path = tmp_path / "pair.mcap"
    topics = {"/joint_states": joint_states(TIME, Q), "/commands": joint_states(TIME[slow] - 1e-3, COMMAND[slow])}
    write_messages(path, {name: (kind, JOINT_STATE, messages) for name, messages in topics.items()})
    motion = tw.Motion.from_file(path, ARM, topic="/joint_states", command_topic="/commands")
    np.testing.assert_array_equal(motion.q, Q[2:])
    np.testing.assert_array_equal(motion.command, np.repeat(COMMAND[slow], 3, axis=0)[: len(motion)])
    with pytest.raises(tw.TrajectoryError, match="no motion in a topic '/none', command_topic"):
        tw.Motion.from_file(path, ARM, command_topic="/none")
    with pytest.raises(tw.TrajectoryError, match="is for recordings of ROS"):
        tw.Motion.from_file(written(tmp_path / "log.csv", ["a", "b"]), ARM, command_topic="/commands")


def test_a_command_of_the_same_stamp_as_a_row_is_that_row_s_command(tmp_path):
    """A controller that publishes both at once: row k has command k, and the first row has one too."""
    path = tmp_path / "pair.mcap"
    time, q, command = TIME[:10], Q[:10], COMMAND[:10]
    topics = {"/joint_states": joint_states(time, q), "/commands": joint_states(time, command)}
    kind = "sensor_msgs/msg/JointState"
    write_messages(path, {name: (kind, JOINT_STATE, messages) for name, messages in topics.items()})
    motion = tw.Motion.from_file(path, ARM, topic="/joint_states", command_topic="/commands")
    np.testing.assert_array_equal(motion.q, q)
    np.testing.assert_array_equal(motion.command, command)
