"""Motions in recordings of ROS, without ROS: the joint states of MCAP files, of rosbag2 folders and of bags of ROS 1."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..core.foreign_errors import foreign_errors
from ..errors import MissingExtraError, NotFoundError, TrajectoryError
from ..typing import Array
from .array_file import checked
from .column_suffixes import SUFFIX
from .npz_file import NpzFile

_TYPE = "JointState"
_PARTS = (("position", "q"), ("velocity", "dq"), ("effort", "tau"))


def is_recording(path: Path) -> bool:
    """Whether it is named as recordings of ROS are: .mcap, .bag, or a folder with a metadata.yaml."""
    try:
        return path.suffix.lower() in (".mcap", ".bag") or (path / "metadata.yaml").is_file()
    except (OSError, ValueError):
        return False


def ros_file(path: Path) -> NpzFile:
    """Stamps, positions, velocities and efforts of the topic of joint states that has most messages.

    Raises NotFoundError, MissingExtraError where a package is missing, and TrajectoryError for what cannot be read.
    """
    if not path.exists():
        raise NotFoundError(f"no recording {str(path)!r}. Give the path of a .mcap, a .bag, or a rosbag2 folder.")
    messages: dict[str, list[Any]] = {}
    with foreign_errors(lambda reason: TrajectoryError(f"{path}: cannot be read as a recording of ROS: {reason}.")):
        for topic, message in _mcap(path) if path.suffix.lower() == ".mcap" else _bag(path):
            messages.setdefault(topic, []).append(message)
    if not messages:
        raise TrajectoryError(f"{path}: has no messages of the type sensor_msgs/{_TYPE}. Record /joint_states.")
    topic = max(messages, key=lambda name: len(messages[name]))
    header, table = _table(messages[topic], f"{path}, topic {topic}")
    size = path.stat().st_size if path.is_file() else sum(p.stat().st_size for p in path.iterdir() if p.is_file())
    return checked(path, header, table, size)


def _table(messages: list[Any], where: str) -> tuple[list[str], Array]:
    """Of messages that name the same joints as the first; others, of a gripper say, are left out."""
    names = list(messages[0].name)
    mine = [m for m in messages if set(m.name) >= set(names)]
    begin = mine[0].header.stamp
    time = [_seconds(m.header.stamp, begin) for m in mine]
    order = [[list(m.name).index(n) for n in names] for m in mine]
    header, columns = ["time [s]"], [np.array(time)[:, None]]
    for field, part in _PARTS:
        values = [np.asarray(getattr(m, field), float) for m in mine]
        if all(len(v) == len(m.name) for v, m in zip(values, mine, strict=True)):
            columns.append(np.array([v[o] for v, o in zip(values, order, strict=True)]))
            header += [f"{n}{SUFFIX[part]}" for n in names]
    if len(columns) == 1:
        raise TrajectoryError(f"{where}: its messages have neither positions nor efforts for their joints.")
    return header, np.concatenate(columns, axis=1)


def _seconds(stamp: Any, begin: Any) -> float:
    """Since the first stamp: whole nanoseconds since 1970 do not fit into a float."""
    nano = "nanosec" if hasattr(stamp, "nanosec") else "nsecs" if hasattr(stamp, "nsecs") else "nanosec"
    sec = "sec" if hasattr(stamp, "sec") else "secs"
    return (getattr(stamp, sec) - getattr(begin, sec)) + 1e-9 * (getattr(stamp, nano) - getattr(begin, nano))


def _mcap(path: Path) -> Iterator[tuple[str, Any]]:
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise MissingExtraError.of("mcap", "logs", "Reading MCAP") from None
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        topics = None
        if summary is not None:
            mine = {k for k, schema in summary.schemas.items() if schema.name.endswith(_TYPE)}
            topics = [c.topic for c in summary.channels.values() if c.schema_id in mine]
            if not topics:
                return
        for schema, channel, _, message in reader.iter_decoded_messages(topics=topics):
            if schema is not None and schema.name.endswith(_TYPE):
                yield channel.topic, message


def _bag(path: Path) -> Iterator[tuple[str, Any]]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError.of("rosbags", "logs", "Reading bags of ROS") from None
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        mine = [c for c in reader.connections if c.msgtype.endswith(_TYPE)]
        for connection, _, raw in reader.messages(connections=mine) if mine else ():
            yield connection.topic, reader.deserialize(raw, connection.msgtype)
