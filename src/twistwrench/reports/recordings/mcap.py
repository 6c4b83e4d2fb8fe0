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

_LEVELS = {Word.OK: 20, Word.UNSURE: 30}
"""Message levels in /rosout; other verdicts have the level of errors, 40."""
_RULE = "=" * 80 + "\n"
_TIME = f"{_RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER = f"{_RULE}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{_TIME}"
_XYZ = "float64 x\nfloat64 y\nfloat64 z\n"
_STATE, _TEXT, _LOG, _TF = (
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/String",
    "rcl_interfaces/msg/Log",
    "tf2_msgs/msg/TFMessage",
)
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
    """Writer of MCAP files; raises MissingExtraError."""
    try:
        from mcap_ros2.writer import Writer
    except ImportError:
        raise MissingExtraError.from_extra("mcap-ros2-support", "logs", "Writing MCAP") from None
    return Writer


def write_mcap(path: str | Path, recording: Recording) -> Path:
    """Write an MCAP file: JointState, robot description, /tf of joints with several coordinates, and the verdict in /rosout."""
    path, writer_of = as_path(path), require_mcap()
    moving = MovingJoints(recording.robot, robot_description(recording.robot.model))
    with replacing(path) as scratch, scratch.open("wb") as file, writer_of(file) as writer:
        messages = _MessageWriter(writer, recording.joints[0])
        first, last = recording.stamps(np.array(recording.span)).tolist()
        messages.write("/robot_description", _TEXT, first, {"data": xml_text(moving.description)})
        for time, q, series in recording.portions:
            values_of_topics = {}
            if recording.joints[0]:
                values_of_topics = {_topic(name): recording.values(states) for name, states in series.items()}
            poses = list(moving.transforms(q))
            for k, stamp in enumerate(recording.stamps(time).tolist()):
                for topic, values in values_of_topics.items():
                    messages.write_states(topic, stamp, values, k)
                if poses:
                    transforms = [_transform(stamp, k, *pose) for pose in poses]
                    messages.write("/tf", _TF, stamp, {"transforms": transforms})
        if recording.limits is not None:
            for stamp in (first, last):
                messages.write_states(_topic("limits"), stamp, recording.values(recording.limits), 0)
        if recording.verdict is not None:
            word, text = recording.verdict
            message = {"stamp": _time(first), "level": _LEVELS.get(word, 40), "name": "twistwrench", "msg": text}
            messages.write("/rosout", _LOG, first, {**message, "file": "", "function": "", "line": 0})
    return path


class _MessageWriter:
    """Writer of ROS messages for some joints."""

    def __init__(self, writer: Any, joints: list[str]) -> None:
        self._writer, self._joints = writer, joints
        self._schemas = {kind: writer.register_msgdef(kind, text) for kind, text in _MESSAGES.items()}

    def write(self, topic: str, kind: str, stamp: int, message: dict[str, Any]) -> None:
        """Write one message."""
        self._writer.write_message(topic, self._schemas[kind], message, stamp, stamp)

    def write_states(self, topic: str, stamp: int, values: Mapping[str, Array], k: int) -> None:
        """Write row k of joint states."""
        message: dict[str, Any] = {"header": _header(stamp), "name": self._joints}
        for name in ("position", "velocity", "effort"):
            message[name] = values[name][k].tolist() if name in values else []
        self.write(topic, _STATE, stamp, message)


def _topic(name: str) -> str:
    return "/joint_states" if name == "joint_states" else f"/twistwrench/{name}"


def _time(stamp: int) -> dict[str, int]:
    return {"sec": stamp // NANOSECONDS, "nanosec": stamp % NANOSECONDS}


def _header(stamp: int, frame: str = "") -> dict[str, Any]:
    return {"stamp": _time(stamp), "frame_id": frame}


def _transform(stamp: int, k: int, parent: str, child: str, places: Array, turns: Array) -> dict[str, Any]:
    """Message of row k of a transform."""
    translation = dict(zip("xyz", places[k].tolist(), strict=True))
    rotation = dict(zip("xyzw", turns[k].tolist(), strict=True))
    transform = {"translation": translation, "rotation": rotation}
    return {"header": _header(stamp, parent), "child_frame_id": child, "transform": transform}
