"""Recordings of motions for other viewers: ROS 2 messages in MCAP files, and rerun's .rrd files.

Both contain the robot's URDF text with its meshes, joint states in rad, m, N m and N, and stamps in nanoseconds. Stamps counted
from 1970 stay unchanged. A report adds torques, their causes, shares of limits, the limits and the verdict.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.errors import MissingExtraError, ModelError, NotFoundError, ValueRangeError
from ..core.files import as_path, replacing
from ..core.numbers import seconds
from ..core.typing import Array
from ..core.verdict import Word
from ..formats.robot_file import file_of
from ..formats.source import find_resource
from ..formats.writers import write_urdf
from ..formats.xml import Element, parse, xml_text
from ..mechanics.joints.units import unit_of
from ..mechanics.lie import quaternion, se3
from ..mechanics.model.couplings import joint_effort
from ..motion.column_names import SINCE_1970
from ..motion.coordinates import Coordinates

if TYPE_CHECKING:
    from ..mechanics.model.model import Model
    from ..motion.motion import Motion
    from ..robot import Robot
    from .torque_report import TorqueReport

_NS = 10**9
_LAST = 2**31
"""Largest ROS time stamp [s]."""
_ROWS = 8192
_PARTS = {"position": "q", "velocity": "dq", "effort": "tau"}
"""Fields of a JointState and the quantities stored in them."""
_LEVELS = {Word.OK: 20, Word.UNSURE: 30}
"""Message levels in /rosout; other verdicts have the level of errors, 40."""


class JointStates(NamedTuple):
    """States of the joints: positions (n, nq), velocities and torques (n, nv); None if unknown."""

    q: Array | None = None
    dq: Array | None = None
    tau: Array | None = None


Portion = tuple[Array, Array, Mapping[str, JointStates]]
"""Times (n,), configurations (n, nq) to show, and joint states by their topic."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Content of a recording, in chunks of rows."""

    robot: Robot
    epoch: int
    """Stamp of time 0 [ns]."""
    span: tuple[float, float]
    """First and last time [s]."""
    portions: Iterator[Portion]
    limits: JointStates | None = None
    """Velocity and torque limits, (1, nv) each."""
    verdict: tuple[Word, str] | None = None

    @classmethod
    def from_motion(cls, motion: Motion) -> Recording:
        """Recording of a motion: its joint states."""
        states = {"joint_states": JointStates(motion.q, motion.dq, motion.tau)}
        portions = iter([(motion.time, motion.q, states)])
        return cls(motion.robot, motion.epoch, (float(motion.time[0]), float(motion.time[-1])), portions)

    @classmethod
    def from_report(cls, report: TorqueReport) -> Recording:
        """Recording of a report: the log's joint states, and the results."""
        from .spoken_verdict import verdict_text

        effort = joint_effort(report.load.robot.model, report.limits.effort)
        limits = JointStates(None, report.limits.velocity[None], effort[None])
        verdict = report.verdict.word, verdict_text(report)
        epoch = report.differentiation.trajectory.epoch
        return cls(report.load.robot, epoch, (report.begin, report.end), _results(report), limits, verdict)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Names and units of the robot's coordinates."""
        return Coordinates.from_model(self.robot.model)

    @cached_property
    def joints(self) -> tuple[list[str], Array, Array]:
        """Joints with one coordinate: names and indices in q and in dq."""
        found = [b for b in self.robot.model.leaders if b.joint.nq == 1]
        q, dq = (np.array([getattr(b, index) for b in found], int) for index in ("q_index", "v_index"))
        return [b.joint.name for b in found], q, dq

    @cached_property
    def units(self) -> dict[str, list[str]]:
        """Units of the positions, velocities and efforts of those joints."""
        angular = [bool(turns) for turns in self.coordinates.angular_velocity[self.joints[2]]]
        return {name: [unit_of(part, turns) for turns in angular] for name, part in _PARTS.items()}

    def values(self, states: JointStates) -> dict[str, Array]:
        """Known positions, velocities and efforts (n, joints) of the joints with one coordinate."""
        _, at, v_at = self.joints
        parts = {"position": (states.q, at), "velocity": (states.dq, v_at), "effort": (states.tau, v_at)}
        return {name: x[:, places] for name, (x, places) in parts.items() if x is not None}

    def stamps(self, time: Array) -> Array:
        """Stamps (n,) of times [ns]; raises ValueRangeError if they are negative or too large for ROS."""
        found = self.epoch + np.rint(time * _NS).astype(np.int64)
        if found[0] < 0 or found[-1] >= _LAST * _NS:
            raise ValueRangeError(
                f"stamps of recordings are from 0 to {_LAST} s, and the motion is from {seconds(found[0] / _NS)} to "
                f"{seconds(found[-1] / _NS)} s. Shift its times, for example to begin at 0."
            )
        return found


def _results(report: TorqueReport) -> Iterator[Portion]:
    """Chunks of a report: log, computed torques and their causes."""
    load, limits = report.load, report.limits
    model = load.with_load.model
    absent = {"spring": model.springs, "payload": load.payloads, "wrench": load.wrenches, "friction": load.friction}
    for states, motion, inner in report.differentiation.surrounded_states(_ROWS):
        s, torques = states[inner], load.torques(states[inner])
        logged = (None if x is None else x[inner] for x in (motion.q, motion.dq, motion.tau))
        found = {"joint_states": JointStates(*logged), "torque": JointStates(s.q, s.dq, torques)}
        for name, values in load.terms(s).items():
            if absent.get(name, True):
                found[f"torque/{name}"] = JointStates(tau=values)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.abs(load.drive_torques(torques)) / limits.effort
        for at, A, _ in model.coupled:  # coupled joints: largest share of their motors
            share[:, at] = np.max(share[:, at, None] * (A != 0), axis=1)
        found["share"] = JointStates(tau=share)
        yield s.time, s.q, found


# ── The robot


def robot_description(model: Model, *, local: bool = False) -> Element:
    """URDF of a model with locked joints fixed, and with the visuals and collision shapes of its own URDF file.

    Mesh names relative to the file become paths. If ``local``, all mesh names become paths, and shapes without their mesh file
    are left out.
    """
    robot = parse(write_urdf(model).text)
    links = {link.attributes["name"]: link for link in robot.all("link")}
    try:
        file = file_of(model)
        own = robot if file is None else file.root
    except (ModelError, NotFoundError, OSError, ValueError):  # the file changed since the robot was loaded
        return robot
    if file is None or own.tag != "robot":
        return robot
    robot.children = [*own.all("material"), *robot.children]
    for link in own.all("link"):
        for shape in [one.deep_copy() for one in (*link.all("visual"), *link.all("collision"))]:
            meshes = [element for element in shape.walk() if element.tag == "mesh"]
            found = [find_resource(mesh.attributes.get("filename", ""), Path(file)) for mesh in meshes]
            if link.attributes.get("name") not in links or (local and None in found):
                continue
            for mesh, place in zip(meshes, found, strict=True):
                if place is not None and (local or "://" not in mesh.attributes["filename"]):
                    mesh.attributes["filename"] = str(place.resolve()) if local else place.resolve().as_uri()
            links[link.attributes["name"]].add(shape)
    return robot


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Moving joints of a description and their coordinates in a motion."""

    robot: Robot
    description: Element

    @cached_property
    def joints(self) -> dict[str, Element]:
        """Joints of the description by name."""
        return {joint.attributes["name"]: joint for joint in self.description.all("joint")}

    def coordinates(self, q: Array) -> dict[str, Array]:
        """Coordinates (n,) of joints with one coordinate, including mimic joints."""
        bodies = [b for b in self.robot.model.bodies if b.joint.nq == 1]
        found = {b.joint.name: b.ratio * q[:, b.q_index] + b.offset for b in bodies}
        for name, joint in self.joints.items():
            mimic = joint.child("mimic")
            if mimic is not None and name not in found:
                leader = found[mimic.attributes["joint"]]
                found[name] = mimic.number("multiplier") * leader + mimic.number("offset")
        return found

    def transforms(self, q: Array) -> Iterator[tuple[str, str, Array, Array]]:
        """Parent, child, position (n, 3) and quaternion x, y, z, w (n, 4) of each joint with several coordinates.

        A ball joint is three joints in the description, of which the first has the whole rotation.
        """
        bodies = [b for b in self.robot.model.bodies if b.joint.nq > 1]
        names, T = list(self.robot.link_names), np.asarray(self.robot.link_poses(q)) if bodies else q
        for body in bodies:
            joint = self.joints.get(body.joint.name) or self.joints[f"{body.joint.name}.x"]
            parent, child = (joint.require_child(end, "").text("link") for end in ("parent", "child"))
            pose = T[:, names.index(body.link)]
            if parent in names:  # excludes the world of a floating base
                pose = se3.inverse(T[:, names.index(parent)]) @ pose
            yield parent, child, pose[:, :3, 3], np.roll(quaternion.from_matrix(pose[:, :3, :3]), -1, axis=-1)


# ── MCAP, https://mcap.dev

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
    path, writer_of, joints = as_path(path), require_mcap(), recording.joints[0]
    drawn = _Drawn(recording.robot, robot_description(recording.robot.model))
    with replacing(path) as scratch, scratch.open("wb") as file, writer_of(file) as writer:
        schemas = {kind: writer.register_msgdef(kind, text) for kind, text in _MESSAGES.items()}

        def write(topic: str, kind: str, stamp: int, message: dict[str, Any]) -> None:
            writer.write_message(topic, schemas[kind], message, stamp, stamp)

        def write_states(topic: str, stamp: int, values: Mapping[str, list[float]]) -> None:
            none: dict[str, list[float]] = {"position": [], "velocity": [], "effort": []}
            write(topic, _STATE, stamp, {"header": _header(stamp), "name": joints, **none, **values})

        first, last = recording.stamps(np.array(recording.span)).tolist()
        write("/robot_description", _TEXT, first, {"data": xml_text(drawn.description)})
        for time, q, series in recording.portions:
            rows = {topic: recording.values(states) for topic, states in series.items()}
            lists = {_topic(t): {name: x.tolist() for name, x in values.items()} for t, values in rows.items()}
            poses = list(drawn.transforms(q))
            for k, stamp in enumerate(recording.stamps(time).tolist()):
                for topic, values in lists.items() if joints else ():
                    write_states(topic, stamp, {name: x[k] for name, x in values.items()})
                if poses:
                    write("/tf", _TF, stamp, {"transforms": [_transform(stamp, k, *pose) for pose in poses]})
        if recording.limits is not None:
            limits = {name: x[0].tolist() for name, x in recording.values(recording.limits).items()}
            for stamp in (first, last):
                write_states(_topic("limits"), stamp, limits)
        if recording.verdict is not None:
            word, text = recording.verdict
            message = {"stamp": _time(first), "level": _LEVELS.get(word, 40), "name": "twistwrench", "msg": text}
            write("/rosout", _LOG, first, {**message, "file": "", "function": "", "line": 0})
    return path


def _topic(name: str) -> str:
    return "/joint_states" if name == "joint_states" else f"/twistwrench/{name}"


def _time(stamp: int) -> dict[str, int]:
    return {"sec": stamp // _NS, "nanosec": stamp % _NS}


def _header(stamp: int, frame: str = "") -> dict[str, Any]:
    return {"stamp": _time(stamp), "frame_id": frame}


def _transform(stamp: int, k: int, parent: str, child: str, place: Array, turn: Array) -> dict[str, Any]:
    """Message of row k of a transform."""
    at, rotation = (dict(zip("xyzw", x[k].tolist(), strict=False)) for x in (place, turn))
    transform = {"translation": at, "rotation": rotation}
    return {"header": _header(stamp, parent), "child_frame_id": child, "transform": transform}


# ── rerun, https://rerun.io


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
    path, rerun = as_path(path), require_rerun()
    drawn = _Drawn(recording.robot, robot_description(recording.robot.model, local=True))
    dated = recording.epoch > SINCE_1970 * _NS
    named = set[str]()
    with replacing(path) as scratch:
        stream = rerun.RecordingStream("twistwrench")
        stream.save(scratch)
        tree = _logged_tree(rerun, stream, drawn.description)

        def index(stamps: Array) -> list[Any]:
            kind = (
                {"timestamp": stamps.astype("datetime64[ns]")}
                if dated
                else {"duration": stamps.astype("timedelta64[ns]")}
            )
            return [rerun.TimeColumn("time", **kind)]

        def send(topic: str, states: JointStates, stamps: Array) -> None:
            for parts, unit, values in _curves(recording, topic, states):
                entity = rerun.new_entity_path(parts)
                if entity not in named:
                    named.add(entity)
                    stream.log(entity, rerun.SeriesLines(names=f"{' '.join(parts)} [{unit}]"), static=True)
                stream.send_columns(entity, index(stamps), rerun.Scalars.columns(scalars=values))

        for time, q, series in recording.portions:
            stamps = recording.stamps(time)
            coordinates = drawn.coordinates(q)
            for joint in tree.joints():
                if joint.name in coordinates:  # a joint beyond its limits is drawn at its value
                    stream.send_columns(
                        "transforms",
                        index(stamps),
                        joint.compute_transform_columns(coordinates[joint.name], clamp=False),
                    )
            for parent, child, place, turn in drawn.transforms(q):
                frames = {"parent_frame": [parent] * len(q), "child_frame": [child] * len(q)}
                columns = rerun.Transform3D.columns(translation=place, quaternion=turn, **frames)
                stream.send_columns("transforms", index(stamps), columns)
            for topic, states in series.items():
                send(topic, states, stamps)
        if recording.limits is not None:
            limits = JointStates(*(None if x is None else np.repeat(x, 2, axis=0) for x in recording.limits))
            send("limits", limits, recording.stamps(np.array(recording.span)))
        if recording.verdict is not None:
            stream.log("verdict", rerun.TextDocument(recording.verdict[1]), static=True)
        stream.flush()
        stream.disconnect()
    return path


def _logged_tree(rerun: Any, stream: Any, description: Element) -> Any:
    """Joint tree of a description; its links and shapes are logged."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "robot.urdf")
        file.write_text(xml_text(description), encoding="utf-8")
        tree = rerun.urdf.UrdfTree.from_file_path(file)
        tree.log_urdf_to_recording(stream)
    return tree


def _curves(recording: Recording, topic: str, states: JointStates) -> Iterator[tuple[tuple[str, ...], str, Array]]:
    """Path, unit and values (n,) of each joint and quantity of a topic."""
    names, units = recording.joints[0], recording.units
    results = topic == "share" or topic.startswith("torque")
    for quantity, values in recording.values(states).items():
        if results and quantity != "effort":
            continue
        parts = topic.split("/") if results else [topic, quantity]
        for name, unit, x in zip(names, units[quantity], values.T, strict=True):
            yield (*parts, name), "1" if topic == "share" else unit, x
