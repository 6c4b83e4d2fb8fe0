"""Logs and plans as ROS records them: MCAP files, rosbag2 folders, bare databases, and bags of ROS 1."""

from __future__ import annotations

import sqlite3

import numpy as np
import pytest

RULE = "=" * 80 + "\n"
STAMP = f"{RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
HEADER = f"{RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{STAMP}"
JOINT_STATE = (
    f"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{HEADER}"
)
POINT = (
    f"{RULE}MSG: trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n"
    f"float64[] effort\nbuiltin_interfaces/Duration time_from_start\n{RULE}MSG: builtin_interfaces/Duration\nint32 sec\n"
    "uint32 nanosec\n"
)
PLAN = "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points\n"
ROBOT_PLAN = f"trajectory_msgs/JointTrajectory joint_trajectory\n{RULE}MSG: trajectory_msgs/JointTrajectory\n{PLAN}{POINT}{HEADER}"
SHOWN_PLAN = (
    f"string model_id\nmoveit_msgs/RobotTrajectory[] trajectory\n{RULE}MSG: moveit_msgs/RobotTrajectory\n{ROBOT_PLAN}"
)
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
STATE = "std_msgs/Header header\nstring[] joint_names\n"
CONTROLLERS = {"new": ("reference", "feedback", "error", "output"), "old": ("desired", "actual", "error")}
"""Points of a controller's state since ROS 2 Humble, and before."""


def controller_state(form):
    return STATE + "".join(f"trajectory_msgs/JointTrajectoryPoint {name}\n" for name in CONTROLLERS[form])


def stamp(t, date=0):
    nano = round(t * 1e9) + date * 10**9
    return {"sec": nano // 10**9, "nanosec": nano % 10**9}


def header(t=0.0, date=0):
    return {"stamp": stamp(t, date), "frame_id": ""}


def point(t, *values):
    """A point at a time; positions, velocities, accelerations and efforts may be left out."""
    names = ("positions", "velocities", "accelerations", "effort")
    lists = [list(map(float, x)) for x in values] + [[]] * (4 - len(values))
    return dict(zip(names, lists, strict=True)) | {"time_from_start": stamp(t)}


def plan(names, time, *values):
    rows = zip(time, *values, strict=True)
    return {"header": header(), "joint_names": list(names), "points": [point(*row) for row in rows]}


def write_messages(path, topics):
    """An MCAP file of messages by their topic: (type, definition, [(time, message), …])."""
    writer = pytest.importorskip("mcap_ros2.writer").Writer(str(path))
    for topic, (kind, definition, messages) in topics.items():
        schema = writer.register_msgdef(kind, definition)
        for t, message in messages:
            writer.write_message(topic, schema, message, log_time=round(t * 1e9), publish_time=round(t * 1e9))
    writer.finish()


def write_mcap(path, names, time, q, tau):
    """An MCAP file of joint states, its names in reverse order, with stamps since 1970."""
    messages = [
        (t, {"header": header(t, 1_700_000_000), "name": list(names)[::-1], "position": a[::-1].tolist(), "velocity": [], "effort": b[::-1].tolist()})
        for t, a, b in zip(time, q, tau, strict=True)
    ]  # fmt: skip
    write_messages(path, {"/joint_states": ("sensor_msgs/msg/JointState", JOINT_STATE, messages)})


def typestore(*, ros1=False):
    """The types of ROS with those of controllers and planners."""
    typesys = pytest.importorskip("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)


def defined(store, kind, text):
    from rosbags.typesys import get_types_from_msg

    store.register(get_types_from_msg(text.split(RULE)[0], kind))
    return store


def as_message(store, kind, content):
    """A message of rosbags from nested dictionaries and lists."""
    fields = dict(store.fielddefs[kind][1])
    made = {}
    for name, value in content.items():
        said = fields[name]
        if isinstance(value, dict):
            made[name] = as_message(store, said[1], value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            made[name] = [as_message(store, said[1][0][1], each) for each in value]
        elif isinstance(value, list) and not (value and isinstance(value[0], str)) and said[1][0][1][0] == "float64":
            made[name] = np.array(value, float)
        else:
            made[name] = value
    return store.types[kind](**({"seq": 0} if kind == "std_msgs/msg/Header" and "seq" in fields else {}), **made)


def write_bag(path, names, time, q, tau):
    """A rosbag2 folder of joint states."""
    messages = [
        (t, {"header": header(t), "name": list(names), "position": a.tolist(), "velocity": [], "effort": b.tolist()})
        for t, a, b in zip(time, q, tau, strict=True)
    ]
    write_folder(path, {"/joint_states": ("sensor_msgs/msg/JointState", messages)}, typestore())


def write_folder(path, topics, store):
    """A rosbag2 folder with a database, of messages by their topic: (type, [(time, message), …])."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    with rosbag2.Writer(path, version=8) as writer:
        for topic, (kind, messages) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for t, message in messages:
                writer.write(connection, round(t * 1e9), store.serialize_cdr(as_message(store, kind, message), kind))


def write_database(path, topics, store, *, definitions=True):
    """The database of such a folder alone; without definitions as it was before ROS 2 Iron."""
    folder = path.with_suffix("")
    write_folder(folder, topics, store)
    next(folder.glob("*.db3")).rename(path)
    if not definitions:
        with sqlite3.connect(path) as database:
            for table in ("message_definitions", "schema"):
                database.execute(f"drop table if exists {table}")


def write_ros1(path, kind, messages, topic="/plan"):
    """A bag of ROS 1."""
    rosbag1, store = pytest.importorskip("rosbags.rosbag1"), typestore(ros1=True)
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection(topic, kind, typestore=store)
        for t, message in messages:
            writer.write(connection, round(t * 1e9), store.serialize_ros1(as_message(store, kind, message), kind))
