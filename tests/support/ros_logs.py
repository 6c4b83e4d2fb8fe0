"""Logs of joint states as ROS records them: MCAP files and rosbag2 folders."""

from __future__ import annotations

import numpy as np
import pytest

JOINT_STATE = """
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def write_mcap(path, names, time, q, tau):
    """An MCAP file of joint states, its names in reverse order."""
    writer = pytest.importorskip("mcap_ros2.writer").Writer(str(path))
    schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    for t, position, effort in zip(time, q, tau, strict=True):
        nano = round(t * 1e9) + 1_700_000_000 * 10**9
        stamp = {"sec": nano // 10**9, "nanosec": nano % 10**9}
        message = {"header": {"stamp": stamp, "frame_id": ""}, "name": list(names)[::-1]}
        message |= {"position": position[::-1].tolist(), "velocity": [], "effort": effort[::-1].tolist()}
        writer.write_message("/joint_states", schema, message, log_time=nano, publish_time=nano)
    writer.finish()


def write_bag(path, names, time, q, tau):
    """A rosbag2 folder of joint states."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, stamp = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with rosbag2.Writer(path, version=8) as writer:
        connection = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for t, position, effort in zip(time, q, tau, strict=True):
            nano = round(t * 1e9)
            at = header(stamp=stamp(sec=nano // 10**9, nanosec=nano % 10**9), frame_id="")
            message = state(header=at, name=list(names), position=position, velocity=np.zeros(0), effort=effort)
            writer.write(connection, nano, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
