"""Factory calibration of UR robots, from ``calibration.conf`` of the controller or the YAML of UR's ROS tools.

The controller's corrections are those of a Denavit-Hartenberg table, whose frames lie hundreds of metres away if axes 2, 3
and 4 are nearly parallel. With screw axes they need no correction algorithm: e^[S_1]q_1 … e^[S_6]q_6 M depends on the axes
and on M alone. Each link frame is moved the shortest way onto its new axis: turned by the smallest rotation, shifted along
the normal.
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

_JOINTS = 6
_ALPHA = np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0]) * np.pi / 2
"""Twists of the nominal table [rad]."""
_GEOMETRY = 1e-5
"""Largest difference of an axis from the table's."""
_OTHER_MODEL = 20e-3
"""Shift [m] of an axis above which the corrections are of another model."""
_CONFIGURATIONS = 500
"""Number of configurations of the mean displacement."""
_LISTS = ("delta_theta", "delta_d", "delta_a", "delta_alpha")
_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""Entries of the YAML: poses of the joints' frames in their predecessors, which turn about z."""
_FLANGE = 5e-3
"""Largest difference [m] of the flange's distance from the file's frame there."""


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
    chain, file = TipChain.from_robot(robot), as_path(path)
    if len(chain.joints) != _JOINTS or not all(chain.turning):
        raise ModelError(
            f"robot {robot.name!r} has not the six turning joints of a UR, so its factory calibration means nothing."
        )
    old, table = _nominal(chain)
    if file.suffix.lower() in (".yaml", ".yml"):
        new = _frames_of_placements(chain, old, _placements(file))
    else:
        theta, d, a, alpha = _corrections(file)
        new = _frames(old[0], theta, table[0] + d, table[1] + a, _ALPHA + alpha)
    moved = max(_axis_shift(T, S) for T, S in zip(old, new, strict=True))
    if moved > _OTHER_MODEL:
        raise ModelError(
            f"{file}: the corrections move an axis of {robot.name!r} by {number(1e3 * moved, 3)} mm; some mm are usual. "
            "Were they made for another model? Load that one."
        )
    return _with_frames(chain, old, new)


@dataclass(frozen=True, eq=False, repr=False)
class FactoryCalibration(Answer):
    r"""Robot of UR with its factory calibration, and by how much it moves the tip.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> lists = "\n".join(f"{name} = [0, 0, 0, 0, 0, 0]" for name in _LISTS)
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
        """Displacement of the frame [m], root mean square over 500 configurations."""
        q = self.original.random_configuration(0, _CONFIGURATIONS)
        both = (self.original, self.robot)
        before, after = (np.asarray(one.forward_kinematics(q, frame=self.frame))[:, :3, 3] for one in both)
        return float(np.sqrt(((after - before) ** 2).sum(axis=1).mean()))

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
        moved = f"the factory calibration moves {self.frame} by {millimetres(self.displacement)} (rms over the reach)."
        yield Headline(Word.DONE, moved)

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
        said = f"factory calibration of {self.path.name}"
        return write_geometry(self.original, self.robot, self.frame, path, said)


def _nominal(chain: TipChain) -> tuple[list[Array], tuple[Array, Array]]:
    """Frames before each joint and after the last, and d and a (6,) of the table, from the robot's own axes."""
    S = np.array([np.asarray(Ad(T).matrix) @ s for T, s in zip(_homes(chain), chain.screws, strict=True)])
    foot = np.cross(S[:, :3], S[:, 3:])
    up = S[0, :3]
    R = np.column_stack([np.cross(-S[1, :3], up), -S[1, :3], up])
    X = np.asarray(se3.pose(R, foot[0] - up * (up @ foot[0])))
    p = (foot - X[:3, 3]) @ R
    a = np.array([0.0, p[2, 0] - p[1, 0], p[3, 0] - p[2, 0], 0.0, 0.0, 0.0])
    d = np.array([p[1, 2], 0.0, 0.0, -p[4, 1], p[3, 2] - p[5, 2], 0.0])
    frames = _frames(X, np.zeros(_JOINTS), d, a, _ALPHA)
    off = max(float(np.abs(np.asarray(Ad(T).matrix)[:, 2] - s).max()) for T, s in zip(frames, S, strict=False))
    if not off < _GEOMETRY:
        raise ModelError(
            f"robot {chain.robot.name!r} has not the geometry of a UR: an axis differs by {number(off, 2)} from the table's."
        )
    return frames, (d, a)


def _homes(chain: TipChain) -> list[Array]:
    """Frames of the links at zero of all joints."""
    T, found = np.eye(4), list[Array]()
    for P in chain.placements:
        T = T @ P
        found.append(T)
    return found


def _frames(X: Array, theta: Array, d: Array, a: Array, alpha: Array) -> list[Array]:
    """Frames before each joint, turning about z, and after the last: Rz(θ) Tz(d) Tx(a) Rx(α)."""
    found = [X]
    for i in range(_JOINTS):
        along_z, along_x = np.array([0, 0, theta[i], 0, 0, d[i]]), np.array([alpha[i], 0, 0, a[i], 0, 0])
        found.append(found[-1] @ np.asarray(se3.exp(along_z)) @ np.asarray(se3.exp(along_x)))
    return found


def _frames_of_placements(chain: TipChain, old: list[Array], placements: list[Array]) -> list[Array]:
    """Frames of the joints from their placements, and after the last; the table's last frame moves to the flange.

    Without corrections the placements are Tx(a) Rx(α) Rz(θ) Tz(d) of the table, with the distance d_6 of the flange.
    """
    frames = [old[0] @ placements[0]]
    for P in placements[1:]:
        frames.append(frames[-1] @ P)
    last = placements[-1]
    given = float(last[:3, 2] @ last[:3, 3])
    home, body = _homes(chain)[-1], chain.bodies[-1]
    inside = np.asarray(se3.inverse(old[_JOINTS - 1])) @ home
    heights = [float((inside @ frame.pose)[2, 3]) for frame in chain.robot.model.frames.values() if frame.body == body]
    flange = min(heights, key=lambda height: abs(height - given))
    if abs(flange - given) > _FLANGE:
        raise ModelError(
            f"robot {chain.robot.name!r} has no frame at the flange, {number(1e3 * given)} mm along the last axis; the nearest "
            f"is at {number(1e3 * flange)} mm. Was the calibration made for another model? Load that one."
        )
    old[_JOINTS] = old[_JOINTS] @ np.asarray(se3.exp(np.array([0, 0, 0, 0, 0, flange])))
    return [*frames, frames[-1]]


def _axis_shift(old: Array, new: Array) -> float:
    """Distance [m] of the old frame's nearest axis point from the new axis; ends compare their origins."""
    z = new[:3, 2]
    between = new[:3, 3] - old[:3, 3]
    return float(np.linalg.norm(between - z * (z @ between)))


def _with_frames(chain: TipChain, old: Sequence[Array], new: Sequence[Array]) -> Robot:
    """Robot whose axes are those of the new frames."""
    frames = [np.eye(4)]
    for home, screw, T in zip(_homes(chain), chain.screws, new, strict=False):
        z, o, w = T[:3, 2], T[:3, 3], home[:3, :3] @ screw[:3]
        z = z if z @ w > 0 else -z
        axis = np.cross(w, z)
        sine = float(np.linalg.norm(axis))
        turn = so3.exp(axis / sine * np.arctan2(sine, w @ z)) if sine > 0 else np.eye(3)
        frames.append(np.asarray(se3.pose(turn @ home[:3, :3], o + z * (z @ (home[:3, 3] - o)))))
    end = new[_JOINTS] @ np.asarray(se3.inverse(old[_JOINTS])) @ _homes(chain)[-1] @ chain.start.tip
    model = chain.robot.model
    bodies = list(model.bodies)
    for i, before, after in zip(chain.bodies, frames, frames[1:], strict=False):
        bodies[i] = replace(bodies[i], placement=np.asarray(se3.inverse(before)) @ after)
    named = dict(model.frames)
    if chain.frame != bodies[chain.bodies[-1]].link:  # a moving link's frame stays on its joint
        named[chain.frame] = replace(named[chain.frame], pose=np.asarray(se3.inverse(frames[-1])) @ end)
    return Robot(replace(model, bodies=tuple(bodies), frames=named))


# ── Files


def _corrections(path: Path) -> list[Array]:
    """Corrections of θ, d, a and α (6,) of ``calibration.conf``."""
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
        return [_numbers(parser["mounting"][name]) for name in _LISTS]
    except (configparser.Error, KeyError, ValueError) as problem:
        raise RobotFileError(
            f"{path}: is not a calibration.conf of a UR ({str(problem).splitlines()[0]}). "
            f"It has the lists {', '.join(_LISTS)} of six numbers below [mounting]."
        ) from None


def _placements(path: Path) -> list[Array]:
    """Poses (4, 4) of the joints in their predecessors, of UR's YAML: x, y, z, and fixed-axis roll, pitch, yaw."""
    content, _ = read_yaml(path, "factory calibration", "kinematics")
    try:
        links = Section(content, "").section("kinematics")
        entries = [links.section(name) for name in _LINKS]
        values = list(map(_pose_numbers, entries))
    except (KeyError, ModelError) as problem:
        raise RobotFileError(
            f"{path}: is not a kinematics file of a UR ({str(problem).splitlines()[0]}). "
            f"It has x, y, z, roll, pitch and yaw of {', '.join(_LINKS)} below kinematics."
        ) from None
    return [np.asarray(se3.pose(rotation_of_rpy(x[3:]), np.array(x[:3]))) for x in values]


def _pose_numbers(entry: Section) -> list[float]:
    """Numbers of one link's entry."""
    return [entry.number(name, "") for name in ("x", "y", "z", "roll", "pitch", "yaw")]


def _numbers(text: str) -> Array:
    found = np.array([float(x) for x in text.strip().strip("[]").split(",")])
    if len(found) != _JOINTS or not np.isfinite(found).all():
        raise ValueError(f"{len(found)} numbers")
    return found


complete(globals())
