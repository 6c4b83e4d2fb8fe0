"""Recordings as .rrd files of rerun, https://rerun.io."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import MissingExtraError
from ...core.files import as_path, replacing
from ...core.typing import Array
from ...formats.xml import Element, xml_text
from ...motion.column_names import SINCE_1970
from .description import MovingJoints, robot_description
from .recording import NANOSECONDS, JointStates, Recording


def require_rerun() -> Any:
    """Import the package rerun; raises MissingExtraError."""
    try:
        import rerun
        import rerun.urdf
    except ImportError:
        raise MissingExtraError.from_extra("rerun-sdk", "rerun", "Writing .rrd") from None
    return rerun


def write_rerun(path: str | Path, recording: Recording) -> Path:
    """Write an .rrd file: the robot with its meshes, its transforms, a curve of each joint and quantity, and the verdict."""
    path = as_path(path)
    rerun = require_rerun()
    description = robot_description(recording.robot.model, local=True)
    moving_joints = MovingJoints(recording.robot, description)
    with replacing(path) as scratch:
        stream = rerun.RecordingStream("twistwrench")
        stream.save(scratch)
        joint_tree = _log_links(rerun, stream, moving_joints.description)
        curves = _CurveWriter(rerun, stream, recording)
        for time, q, states_by_topic in recording.portions:
            stamps = recording.stamps(time)
            coordinates = moving_joints.coordinates(q)
            for joint in joint_tree.joints():
                if joint.name in coordinates:
                    # clamp=False: a joint beyond its limits is drawn at its value
                    columns = joint.compute_transform_columns(coordinates[joint.name], clamp=False)
                    stream.send_columns("transforms", curves.time_columns(stamps), columns)
            for parent, child, positions, quaternions in moving_joints.transforms(q):
                frames = {"parent_frame": [parent] * len(q), "child_frame": [child] * len(q)}
                columns = rerun.Transform3D.columns(translation=positions, quaternion=quaternions, **frames)
                stream.send_columns("transforms", curves.time_columns(stamps), columns)
            for topic, states in states_by_topic.items():
                curves.send(topic, states, stamps)
        if recording.limits is not None:  # constant curves from the first to the last time
            end_stamps = recording.stamps(np.array(recording.span))
            curves.send("limits", _duplicate_rows(recording.limits), end_stamps)
        if recording.verdict is not None:
            _, text = recording.verdict
            stream.log("verdict", rerun.TextDocument(text), static=True)
        stream.flush()
        stream.disconnect()
    return path


class _CurveWriter:
    """Writer of curves of joint states to a stream."""

    def __init__(self, rerun: Any, stream: Any, recording: Recording) -> None:
        self._rerun = rerun
        self._stream = stream
        self._recording = recording
        self._named_entities = set[str]()
        """Paths of the curves whose names are sent."""

    def time_columns(self, stamps: Array) -> list[Any]:
        """Column of times from stamps [ns]; dates if the log has them, else durations."""
        if self._recording.epoch > SINCE_1970 * NANOSECONDS:
            return [self._rerun.TimeColumn("time", timestamp=stamps.astype("datetime64[ns]"))]
        return [self._rerun.TimeColumn("time", duration=stamps.astype("timedelta64[ns]"))]

    def send(self, topic: str, states: JointStates, stamps: Array) -> None:
        """Send the curves of a topic with their time stamps [ns]; the name of a curve is sent once."""
        for path, unit, values in _curves(self._recording, topic, states):
            entity = self._rerun.new_entity_path(path)
            if entity not in self._named_entities:
                self._named_entities.add(entity)
                name = f"{' '.join(path)} [{unit}]"
                self._stream.log(entity, self._rerun.SeriesLines(names=name), static=True)
            columns = self._rerun.Scalars.columns(scalars=values)
            self._stream.send_columns(entity, self.time_columns(stamps), columns)


def _duplicate_rows(states: JointStates) -> JointStates:
    """States with each row twice."""
    doubled = [None if rows is None else np.repeat(rows, 2, axis=0) for rows in states]
    return JointStates(*doubled)


def _log_links(rerun: Any, stream: Any, description: Element) -> Any:
    """Log the links and shapes of a URDF description; returns its joint tree."""
    with tempfile.TemporaryDirectory() as folder:  # rerun reads a URDF file only from a path
        file = Path(folder, "robot.urdf")
        file.write_text(xml_text(description), encoding="utf-8")
        tree = rerun.urdf.UrdfTree.from_file_path(file)
        tree.log_urdf_to_recording(stream)
    return tree


def _curves(recording: Recording, topic: str, states: JointStates) -> Iterator[tuple[tuple[str, ...], str, Array]]:
    """Path, unit and values (n,) of each joint and quantity of a topic."""
    joint_names, _, _ = recording.joints
    is_result = topic == "share" or topic.startswith("torque")
    for quantity, values in recording.values(states).items():
        if is_result and quantity != "effort":  # the motion's own topic has positions and velocities
            continue
        path = topic.split("/") if is_result else [topic, quantity]
        units = recording.units[quantity]
        if topic == "share":  # without unit
            units = ["1"] * len(joint_names)
        for joint_name, unit, curve in zip(joint_names, units, values.T, strict=True):
            yield (*path, joint_name), unit, curve
