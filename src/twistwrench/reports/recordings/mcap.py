"""Recordings as MCAP files of ROS 2 messages, https://mcap.dev."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import MissingExtraError
from ...core.files import as_path, replacing
from ...core.typing import Array
from ...core.verdict import Word
from ...formats.xml import xml_text
from .description import MovingJoints, robot_description
from .recording import NANOSECONDS, Recording

# Levels of rcl_interfaces/msg/Log
_INFO = 20
_WARNING = 30
_ERROR = 40
_LEVELS = {Word.OK: _INFO, Word.UNSURE: _WARNING}
"""Message levels in /rosout; other verdicts are errors."""
_RULE = "=" * 80 + "\n"
"""Line between the definitions of a message and of the messages in it."""
_TIME = f"{_RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER = f"{_RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{_TIME}"
_XYZ = "float64 x\nfloat64 y\nfloat64 z\n"

# Types of the messages that are written
_STATE = "sensor_msgs/msg/JointState"
_TEXT = "std_msgs/msg/String"
_LOG = "rcl_interfaces/msg/Log"
_TF = "tf2_msgs/msg/TFMessage"
_MESSAGES = {
    _STATE: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    + _HEADER,
    _TEXT: "string data\n",
    _LOG: "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n"
    + _TIME,
    _TF: "geometry_msgs/TransformStamped[] transforms\n"
    f"{_RULE}MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform\n"
    f"{_RULE}MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    f"{_RULE}MSG: geometry_msgs/Vector3\n{_XYZ}{_RULE}MSG: geometry_msgs/Quaternion\n{_XYZ}float64 w\n{_HEADER}",
}
"""Message definitions by type."""


def require_mcap() -> Any:
    """Class of the writer of MCAP files; raises MissingExtraError if it is not installed."""
    try:
        from mcap_ros2.writer import Writer
    except ImportError:
        raise MissingExtraError.from_extra("mcap-ros2-support", "logs", "Writing MCAP") from None
    return Writer


def write_mcap(path: str | Path, recording: Recording) -> Path:
    """Write an MCAP file: joint states, robot description, /tf of joints with several coordinates, and verdict in /rosout."""
    path = as_path(path)
    writer_of = require_mcap()
    moving_joints = MovingJoints(recording.robot, robot_description(recording.robot.model))
    with replacing(path) as temporary_path, temporary_path.open("wb") as file, writer_of(file) as writer:
        joint_names, _, _ = recording.joints
        messages = _MessageWriter(writer, joint_names)
        first_and_last_time = np.array(recording.span)
        first_stamp, last_stamp = recording.stamps(first_and_last_time).tolist()
        messages.write("/robot_description", _TEXT, first_stamp, {"data": xml_text(moving_joints.description)})
        for time, q, series in recording.portions:
            values_by_topic = {}
            if joint_names:
                values_by_topic = {_topic(name): recording.values(states) for name, states in series.items()}
            pose_series = list(moving_joints.transforms(q))
            for row, stamp in enumerate(recording.stamps(time).tolist()):
                for topic, values in values_by_topic.items():
                    messages.write_states(topic, stamp, values, row)
                if pose_series:
                    transforms = [_transform(stamp, row, *series_of_pair) for series_of_pair in pose_series]
                    messages.write("/tf", _TF, stamp, {"transforms": transforms})
        if recording.limits is not None:
            limits = recording.values(recording.limits)
            for stamp in (first_stamp, last_stamp):
                messages.write_states(_topic("limits"), stamp, limits, 0)
        if recording.verdict is not None:
            word, text = recording.verdict
            level = _LEVELS.get(word, _ERROR)
            message = {"stamp": _time(first_stamp), "level": level, "name": "twistwrench", "msg": text}
            empty_place = {"file": "", "function": "", "line": 0}
            messages.write("/rosout", _LOG, first_stamp, message | empty_place)
    return path


class _MessageWriter:
    """Writer of ROS messages for some joints; stamps are in nanoseconds."""

    def __init__(self, writer: Any, joints: list[str]) -> None:
        self._writer = writer
        self._joints = joints
        self._schemas = {name: writer.register_msgdef(name, definition) for name, definition in _MESSAGES.items()}

    def write(self, topic: str, message_type: str, stamp: int, message: dict[str, Any]) -> None:
        """Write one message, which is logged and published at its stamp."""
        self._writer.write_message(topic, self._schemas[message_type], message, stamp, stamp)

    def write_states(self, topic: str, stamp: int, values: Mapping[str, Array], row: int) -> None:
        """Write one row of joint states; quantities that are not among the values are empty."""
        message: dict[str, Any] = {"header": _header(stamp), "name": self._joints}
        for name in ("position", "velocity", "effort"):
            message[name] = values[name][row].tolist() if name in values else []
        self.write(topic, _STATE, stamp, message)


def _topic(name: str) -> str:
    """Topic of a series of joint states."""
    return "/joint_states" if name == "joint_states" else f"/twistwrench/{name}"


def _time(stamp: int) -> dict[str, int]:
    """Message of a stamp in nanoseconds."""
    return {"sec": stamp // NANOSECONDS, "nanosec": stamp % NANOSECONDS}


def _header(stamp: int, frame: str = "") -> dict[str, Any]:
    """Message of a header; the frame is empty for joint states."""
    return {"stamp": _time(stamp), "frame_id": frame}


def _transform(stamp: int, row: int, parent: str, child: str, positions: Array, quaternions: Array) -> dict[str, Any]:
    """Message of one row of the poses of a child in its parent; quaternions have the scalar last."""
    translation = dict(zip("xyz", positions[row].tolist(), strict=True))
    rotation = dict(zip("xyzw", quaternions[row].tolist(), strict=True))
    transform = {"translation": translation, "rotation": rotation}
    return {"header": _header(stamp, parent), "child_frame_id": child, "transform": transform}
