"""Factory calibration of UR robots, from ``calibration.conf`` of the controller or the YAML of UR's ROS tools.

The controller's corrections are those of a Denavit-Hartenberg table. Axes 2, 3 and 4 are nearly parallel, so that frames of
the corrected table lie hundreds of metres away. Screw axes need no such table: e^[S_1]q_1 … e^[S_6]q_6 M depends on the axes
and on M alone. Each link frame is moved the shortest way onto its new axis: turned by the smallest rotation, and shifted
along the common normal.
"""

from __future__ import annotations

import configparser
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block, Headline
from ..core.errors import ModelError, NotFoundError, RobotFileError
from ..core.files import as_path, read_text
from ..core.glossary import complete
from ..core.numbers import number
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..formats.urdf import rotation_of_rpy
from ..formats.yaml import Section, read_yaml
from ..mechanics.lie import se3, so3
from ..mechanics.lie.adjoint import Ad
from ..motion.limits_file import robot_origin
from ..robot import Robot
from .chain import TipChain
from .result_view import millimetres
from .write import write_geometry

if TYPE_CHECKING:
    from ..core.answers.page import Setting

_JOINT_COUNT = 6
_ALPHA = np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0]) * np.pi / 2
"""Angles α between successive axes of the nominal table [rad]."""
_MAX_AXIS_DIFFERENCE = 1e-5
"""Largest difference of an entry of a robot's screw axis from that of the table [rad/rad or m/rad]."""
_MAX_AXIS_SHIFT = 20e-3
"""Shift [m] of an axis above which the corrections are of another model."""
_CONFIGURATION_COUNT = 500
"""Number of configurations of the mean displacement."""
_CORRECTION_NAMES = ("delta_theta", "delta_d", "delta_a", "delta_alpha")
"""Entries of ``calibration.conf``: corrections of θ, d, a and α."""
_LINK_NAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""Entries of the YAML: poses of the joints' frames, each in the frame before it. Joints rotate about z."""
_MAX_FLANGE_DIFFERENCE = 5e-3
"""Largest difference [m] between the flange's distance in the YAML and that of a frame of the robot."""


def factory(robot: Robot, path: str | Path) -> Robot:
    r"""Robot of UR with its factory calibration; its link frames move by millimetres.

    Parameters
    ----------
    path : str or Path, ``calibration.conf`` of the controller, or the YAML with ``kinematics:`` that UR's ROS tools write

    Returns
    -------
    robot : Robot

    Raises
    ------
    NotFoundError, RobotFileError
        The file cannot be read.
    ModelError
        The robot has not the geometry of a UR, or the corrections are of another model.

    Notes
    -----
    The nominal table comes from the robot's own axes: d_1, a_2, a_3, d_4, d_5, d_6, and α = 90°, 0, 0, 90°, -90°, 0.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> zeros = "[0, 0, 0, 0, 0, 0]"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "calibration.conf")
    ...     text = f"delta_theta = [0, 0.01, 0, 0, 0, 0]\ndelta_a = {zeros}\ndelta_d = {zeros}\ndelta_alpha = {zeros}"
    ...     count = path.write_text(f"[mounting]\n{text}\n")
    ...     calibrated = tw.calibration.factory(tw.robots.ur5(), path)
    >>> off = calibrated.forward_kinematics(np.zeros(6)) - tw.robots.ur5().forward_kinematics([0, 0.01, 0, 0, 0, 0])
    >>> bool(np.abs(off).max() < 1e-12)
    True
    """
    chain = TipChain.from_robot(robot)
    calibration_path = as_path(path)
    if len(chain.joints) != _JOINT_COUNT or not all(chain.turning):
        raise ModelError(
            f"robot {robot.name!r} has not the six turning joints of a UR, so its factory calibration means nothing."
        )
    nominal_frames, d, a = _nominal_table(chain)
    if calibration_path.suffix.lower() in (".yaml", ".yml"):
        placements = _joint_placements(calibration_path)
        nominal_frames[_JOINT_COUNT] = _flange_frame(chain, nominal_frames, placements[-1])  # after the last joint
        frames = _frames_of_placements(nominal_frames[0], placements)
    else:  # calibration.conf
        delta_theta, delta_d, delta_a, delta_alpha = _table_corrections(calibration_path)
        frames = _frames_of_table(nominal_frames[0], delta_theta, d + delta_d, a + delta_a, _ALPHA + delta_alpha)
    axis_shifts = [_axis_shift(nominal, frame) for nominal, frame in zip(nominal_frames, frames, strict=True)]
    max_shift = max(axis_shifts)
    if max_shift > _MAX_AXIS_SHIFT:
        raise ModelError(
            f"{calibration_path}: the corrections move an axis of {robot.name!r} by {number(1e3 * max_shift, 3)} mm; some mm "
            "are usual. Were they made for another model? Load that one."
        )
    return _with_frames(chain, nominal_frames, frames)


@dataclass(frozen=True, eq=False, repr=False)
class FactoryCalibration(Answer):
    r"""Robot of UR with its factory calibration, and by how much it moves the tip.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> lists = "\n".join(f"{name} = [0, 0, 0, 0, 0, 0]" for name in _CORRECTION_NAMES)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "calibration.conf")
    ...     count = path.write_text(f"[mounting]\n{lists}\n")
    ...     found = FactoryCalibration.from_file(tw.robots.ur5(), path)
    ...     found.write(f"{folder}/mine.urdf").name, [*found.sources()]
    ('mine.urdf', ['ROBOT', 'CALIBRATION'])
    >>> print(found.headline, dict(found.facts()), len(list(found.blocks())))
    DONE: the factory calibration moves tool0 by 0 mm (rms over the reach). {'moved': '0 mm'} 1
    """

    call: ClassVar[str] = "calibrate"

    original: Robot
    """Robot as its file has it."""
    robot: Robot
    """Robot with its calibration."""
    frame: str
    """Frame whose displacement is reported."""
    path: Path
    """File of the calibration."""

    @classmethod
    def from_file(cls, robot: Robot, path: str | Path, tip: str | None = None) -> FactoryCalibration:
        """Calibration of a robot from ``calibration.conf`` of its controller; raises as :func:`factory`.

        Returns
        -------
        found : FactoryCalibration
        """
        return cls(robot, factory(robot, path), str(tip or robot.tip), as_path(path))

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.original.name

    @property
    def brief(self) -> str:
        """Displacement of the frame."""
        return f"{self.frame} moved by {millimetres(self.displacement)}"

    @cached_property
    def displacement(self) -> float:
        """Displacement of the frame [m], root mean square over 500 random configurations."""
        q = self.original.random_configuration(0, _CONFIGURATION_COUNT)
        poses = np.asarray(self.original.forward_kinematics(q, frame=self.frame))
        calibrated_poses = np.asarray(self.robot.forward_kinematics(q, frame=self.frame))
        displacements = calibrated_poses[:, :3, 3] - poses[:, :3, 3]
        return float(np.sqrt((displacements**2).sum(axis=1).mean()))

    @property
    def verdict(self) -> Verdict:
        """DONE: nothing was judged."""
        return Verdict(Word.DONE)

    def blocks(self) -> Iterator[Block]:
        """Displacement of the tip.

        Returns
        -------
        blocks : iterator of Block
        """
        text = f"the factory calibration moves {self.frame} by {millimetres(self.displacement)} (rms over the reach)."
        yield Headline(Word.DONE, text)

    def facts(self) -> Mapping[str, str]:
        """Displacement of the tip.

        Returns
        -------
        facts : {name: text}
        """
        return {"moved": millimetres(self.displacement)}

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the robot and of the calibration.

        Returns
        -------
        files : {argument: path}
        """
        return {"ROBOT": self.original.model.source, "CALIBRATION": self.path}

    def origin(self) -> Iterator[Setting]:
        """Robot with its joints.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        return robot_origin(self.robot)

    def write(self, path: str | Path) -> Path:
        """Write the calibrated geometry into the robot's URDF or MJCF file; all other bytes stay.

        Returns
        -------
        path : Path of the file
        """
        summary = f"factory calibration of {self.path.name}"
        return write_geometry(self.original, self.robot, self.frame, path, summary)


def _nominal_table(chain: TipChain) -> tuple[list[Array], Array, Array]:
    """Frames before each joint and after the last, and d and a (6,) of the nominal table, from the robot's own axes."""
    screws = [np.asarray(Ad(T).matrix) @ s for T, s in zip(_link_frames(chain), chain.screws, strict=True)]
    S = np.array(screws)  # screw axes in the base, (6, 6)
    axis_points = np.cross(S[:, :3], S[:, 3:])  # of each axis, nearest to the base's origin
    # The table's first frame X: z is the direction of the first axis, -y of the second.
    z = S[0, :3]
    minus_y = S[1, :3]
    R = np.column_stack([np.cross(-minus_y, z), -minus_y, z])
    X = np.asarray(se3.pose(R, axis_points[0] - z * (z @ axis_points[0])))
    p = (axis_points - X[:3, 3]) @ R  # points of the axes in the table's first frame
    # a_2 and a_3 are distances of successive axes along x; d_1, d_4 and d_5 are distances along z, -y and -z.
    a = np.array([0.0, p[2, 0] - p[1, 0], p[3, 0] - p[2, 0], 0.0, 0.0, 0.0])
    d = np.array([p[1, 2], 0.0, 0.0, -p[4, 1], p[3, 2] - p[5, 2], 0.0])
    frames = _frames_of_table(X, np.zeros(_JOINT_COUNT), d, a, _ALPHA)
    differences = []
    for T, screw in zip(frames[:_JOINT_COUNT], S, strict=True):
        table_screw = np.asarray(Ad(T).matrix)[:, 2]  # rotation about the frame's z axis
        differences.append(float(np.abs(table_screw - screw).max()))
    max_difference = max(differences)
    if not max_difference < _MAX_AXIS_DIFFERENCE:  # also true for NaN
        raise ModelError(
            f"robot {chain.robot.name!r} has not the geometry of a UR: "
            f"an axis differs by {number(max_difference, 2)} from the table's."
        )
    return frames, d, a


def _link_frames(chain: TipChain) -> list[Array]:
    """Poses (4, 4) of the links' frames in the base, with all joints at zero."""
    T = np.eye(4)
    frames = list[Array]()
    for P in chain.placements:
        T = T @ P
        frames.append(T)
    return frames


def _frames_of_table(X: Array, theta: Array, d: Array, a: Array, alpha: Array) -> list[Array]:
    """Frames before each joint, which rotates about z, and after the last: X, then each by Rz(θ) Tz(d) Tx(a) Rx(α)."""
    frames = [X]
    for i in range(_JOINT_COUNT):
        screw_along_z = np.array([0, 0, theta[i], 0, 0, d[i]])
        screw_along_x = np.array([alpha[i], 0, 0, a[i], 0, 0])
        frames.append(frames[-1] @ np.asarray(se3.exp(screw_along_z)) @ np.asarray(se3.exp(screw_along_x)))
    return frames


def _frames_of_placements(base: Array, placements: list[Array]) -> list[Array]:
    """Frames of the joints from their placements, and after them the last frame again, as the frame after the last joint.

    The first placement is a pose in ``base``. Without corrections the placements are Tx(a) Rx(α) Rz(θ) Tz(d) of the table,
    with the distance d_6 of the flange.
    """
    frames = [base @ placements[0]]
    for P in placements[1:]:
        frames.append(frames[-1] @ P)
    return [*frames, frames[-1]]


def _flange_frame(chain: TipChain, nominal_frames: list[Array], last_placement: Array) -> Array:
    """Last frame of the nominal table, moved along the last axis to the flange, since the YAML counts d_6 up to there.

    The flange is the robot's frame on the last link whose distance along the last axis is that of the last placement.
    Raises ModelError if there is none.
    """
    expected_distance = float(last_placement[:3, 2] @ last_placement[:3, 3])
    last_body = chain.bodies[-1]
    link_in_table = np.asarray(se3.inverse(nominal_frames[_JOINT_COUNT - 1])) @ _link_frames(chain)[-1]
    poses_on_link = [frame.pose for frame in chain.robot.model.frames.values() if frame.body == last_body]
    distances = [float((link_in_table @ pose)[2, 3]) for pose in poses_on_link]  # along the last axis
    distance = min(distances, key=lambda candidate: abs(candidate - expected_distance))
    if abs(distance - expected_distance) > _MAX_FLANGE_DIFFERENCE:
        raise ModelError(
            f"robot {chain.robot.name!r} has no frame at the flange, {number(1e3 * expected_distance)} mm along the last axis; "
            f"the nearest is at {number(1e3 * distance)} mm. Was the calibration made for another model? Load that one."
        )
    shift_along_z = np.array([0, 0, 0, 0, 0, distance])
    return nominal_frames[_JOINT_COUNT] @ np.asarray(se3.exp(shift_along_z))


def _axis_shift(old_frame: Array, new_frame: Array) -> float:
    """Distance [m] of the old frame's origin from the z axis of the new frame."""
    z = new_frame[:3, 2]
    difference = new_frame[:3, 3] - old_frame[:3, 3]
    return float(np.linalg.norm(difference - z * (z @ difference)))


def _with_frames(chain: TipChain, old_frames: Sequence[Array], new_frames: Sequence[Array]) -> Robot:
    """Robot whose axes are z of the new frames, and whose tip moves as the last frame of the table does."""
    link_frames = _link_frames(chain)
    moved_frames = [np.eye(4)]  # of the base and of the links
    for link_frame, screw, T in zip(link_frames, chain.screws, new_frames[:_JOINT_COUNT], strict=True):
        R, p = link_frame[:3, :3], link_frame[:3, 3]
        old_axis = R @ screw[:3]
        new_axis, new_point = T[:3, 2], T[:3, 3]
        if not new_axis @ old_axis > 0:  # the robot file has the axis in the opposite direction
            new_axis = -new_axis
        cross = np.cross(old_axis, new_axis)
        sine = float(np.linalg.norm(cross))
        smallest_rotation = np.eye(3)  # of all that turn the old axis to the new one
        if sine > 0:
            angle = np.arctan2(sine, old_axis @ new_axis)
            smallest_rotation = so3.exp(cross / sine * angle)
        point_on_axis = new_point + new_axis * (new_axis @ (p - new_point))  # point of the new axis nearest to p
        moved_frames.append(np.asarray(se3.pose(smallest_rotation @ R, point_on_axis)))
    motion_of_last_frame = new_frames[_JOINT_COUNT] @ np.asarray(se3.inverse(old_frames[_JOINT_COUNT]))
    tip = motion_of_last_frame @ link_frames[-1] @ chain.start.tip
    model = chain.robot.model
    bodies = list(model.bodies)
    for body_index, parent_frame, own_frame in zip(chain.bodies, moved_frames[:-1], moved_frames[1:], strict=True):
        placement = np.asarray(se3.inverse(parent_frame)) @ own_frame
        bodies[body_index] = replace(bodies[body_index], placement=placement)
    named_frames = dict(model.frames)
    if chain.frame != bodies[chain.bodies[-1]].link:  # the frame of the moving link itself stays on its joint
        tip_in_link = np.asarray(se3.inverse(moved_frames[-1])) @ tip
        named_frames[chain.frame] = replace(named_frames[chain.frame], pose=tip_in_link)
    return Robot(replace(model, bodies=tuple(bodies), frames=named_frames))


# ── Files


def _table_corrections(path: Path) -> list[Array]:
    """Corrections of θ, d, a and α, each (6,), of ``calibration.conf``."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise NotFoundError(
            f"no factory calibration {str(path)!r}. Copy calibration.conf from the robot's controller."
        ) from None
    except (OSError, UnicodeDecodeError) as problem:
        raise RobotFileError(f"{path}: cannot be read as text: {str(problem).splitlines()[0]}.") from None
    parser = configparser.ConfigParser(inline_comment_prefixes=("#",), interpolation=None)
    try:
        parser.read_string(text)
        return [_numbers(parser["mounting"][name]) for name in _CORRECTION_NAMES]
    except (configparser.Error, KeyError, ValueError) as problem:
        raise RobotFileError(
            f"{path}: is not a calibration.conf of a UR ({str(problem).splitlines()[0]}). "
            f"It has the lists {', '.join(_CORRECTION_NAMES)} of six numbers below [mounting]."
        ) from None


def _joint_placements(path: Path) -> list[Array]:
    """Poses (4, 4) of the joints in their predecessors, of UR's YAML: x, y, z, and fixed-axis roll, pitch, yaw."""
    content, _ = read_yaml(path, "factory calibration", "kinematics")
    try:
        links = Section(content, "").section("kinematics")
        entries = [_position_and_angles(links.section(name)) for name in _LINK_NAMES]
    except (KeyError, ModelError) as problem:
        raise RobotFileError(
            f"{path}: is not a kinematics file of a UR ({str(problem).splitlines()[0]}). "
            f"It has x, y, z, roll, pitch and yaw of {', '.join(_LINK_NAMES)} below kinematics."
        ) from None
    placements = list[Array]()
    for entry in entries:
        position = np.array(entry[:3])
        rotation = rotation_of_rpy(entry[3:])
        placements.append(np.asarray(se3.pose(rotation, position)))
    return placements


def _position_and_angles(entry: Section) -> list[float]:
    """Position [m] and fixed-axis angles [rad] of one link's entry: six numbers."""
    return [entry.number(name, "") for name in ("x", "y", "z", "roll", "pitch", "yaw")]


def _numbers(text: str) -> Array:
    """Six numbers of a list in brackets. Raises ValueError for another text."""
    number_texts = text.strip().strip("[]").split(",")
    numbers = np.array([float(number_text) for number_text in number_texts])
    if len(numbers) != _JOINT_COUNT or not np.isfinite(numbers).all():
        raise ValueError(f"{len(numbers)} numbers")
    return numbers


complete(globals())
