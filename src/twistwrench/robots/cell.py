"""A cell: robots fixed to frames of each other, such as an arm on a rail with a gripper at its tip."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.errors import FrameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number
from ..core.text import Argument, listed, spell
from ..core.typing import Array
from ..core.verdict import Reason, Verdict, Word
from ..formats.urdf import rotation_of_rpy
from ..mechanics.lie import se3
from ..mechanics.model.inertia_checks import massless_links
from ..mechanics.model.model import Model
from ..robot import Robot, load
from .finding import known_robots

if TYPE_CHECKING:
    from ..core.answers.blocks import Block
    from ..robot.export.written import Saved

__all__ = ["PlacedRobot", "RobotCell", "join"]

_MIN_TIP_DISTANCE = 1e-3
"""Difference of an entry of two tips' poses [1 or m] above which the choice between the tips matters."""
FLOOR = "floor"
"""Frame at which parts stand side by side; made if the cell has none of this name."""
_MAX_LISTED_NAMES = 4
"""Largest number of names in a reason."""
_MAX_LISTED_TIPS = 8
"""Largest number of possible tips that are listed."""
_FORM_OF_PART = "FILE@FRAME+x,y,z,roll,pitch,yaw:PREFIX, of which all but FILE may be left out"
"""Form of the text of a part, for messages."""
_PART_PATTERN = re.compile(
    r"(?P<file>.+?)"
    r"(?:@(?P<frame>(?:::|[^@+:])+)"  # a frame may contain ::, as in SDF
    r"(?:\+(?P<pose>[^:@]*))?)?"  # only after a frame
    r"(?::(?P<prefix>[\w.-]+))?"
)


@dataclass(frozen=True, eq=False)
class PlacedRobot:
    """A robot of a cell, and where it stands.

    Parameters
    ----------
    robot : Robot
    frame : str, optional, frame of the cell so far; None: its tip
    pose : (4, 4) array_like, optional, pose of the robot's base in that frame; None: the identity
    prefix : str, prepended to the names of the robot's links, joints and sites
    file : str or Path, the robot's file, for the report

    Examples
    --------
    >>> import twistwrench as tw
    >>> part = PlacedRobot.from_text("ur5@floor+0,1,0,0,30deg,0:left_")
    >>> part.robot.name, part.frame, part.prefix, part.pose[:3, 3].tolist()
    ('ur5', 'floor', 'left_', [0.0, 1.0, 0.0])
    """

    robot: Robot
    frame: str | None = None
    pose: Array | None = None
    prefix: str = ""
    file: str | Path = ""

    @classmethod
    def from_text(cls, text: str, *, degrees: bool = False) -> PlacedRobot:
        """Robot and place from ``FILE@FRAME+x,y,z,roll,pitch,yaw:PREFIX``; lengths in metres, angles in radians or ``30deg``.

        Parameters
        ----------
        text : str
        degrees : bool, angles are in degrees

        Returns
        -------
        part : PlacedRobot

        Raises
        ------
        ValueRangeError
            The text has another form.

        Examples
        --------
        >>> PlacedRobot.from_text("planar_2r@tool0:hand_").frame
        'tool0'
        """
        if Path(text).is_file():
            return cls(load(text), file=text)
        match = _PART_PATTERN.fullmatch(text)
        if match is None:
            raise ValueRangeError(f"the part {text!r} is not {_FORM_OF_PART}.")
        file, frame, pose_text, prefix = match.group("file", "frame", "pose", "prefix")  # None if missing
        is_robot = Path(file).is_file() or file in known_robots()
        if not is_robot and prefix is not None:  # what follows the colon may be part of the path
            path_with_colon = f"{file}:{prefix}"
            if Path(path_with_colon).exists():
                file = path_with_colon
                prefix = None
        T = None
        if pose_text is not None:
            T = _pose(pose_text, text, degrees=degrees)
        return cls(load(file), frame, T, prefix or "", file)


PartGiven: TypeAlias = Robot | PlacedRobot | str | Path
"""A robot, a robot with its place, a path, the name of a robot, or text of the form of :meth:`PlacedRobot.from_text`."""


@dataclass(frozen=True, eq=False, repr=False)
class RobotCell(Answer):
    """Robots joined by :func:`twistwrench.join`: the joined robot, and the parts that it is made of.

    The verdict is DONE; UNSURE if a part stands at a tip that is one of several, or if a moving link has no mass.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> cell = tw.join("ur5@floor:left_", "ur5@floor+0,1,0,0,0,0:right_", name="two_arms")
    >>> print(cell.headline)
    DONE: two_arms has 12 moving bodies, 12 joints, 33.99 kg that move, and no single tip.
    >>> cell.robot.nv, [part.prefix for part in cell.parts], list(cell.tables)
    (12, ['left_', 'right_'], ['part'])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     cell.write(f"{folder}/cell.urdf")
    []
    """

    robot: Robot
    """The joined robot."""
    parts: tuple[PlacedRobot, ...]
    """The robots, in the order in which they were joined."""
    frames: tuple[str, ...]
    """Frame of the cell at which each part stands."""
    doubts: tuple[Reason, ...] = ()
    """Reasons why the verdict is UNSURE."""
    call = "join"

    @property
    def verdict(self) -> Verdict:
        """DONE, or UNSURE with the reasons."""
        if self.doubts:
            return Verdict(Word.UNSURE, self.doubts)
        return Verdict(Word.DONE)

    @property
    def robot_name(self) -> str:
        """Name of the joined robot."""
        return self.robot.name

    @property
    def brief(self) -> str:
        """Number of parts and joints."""
        return f"{len(self.parts)} parts, {_joint_count(self.robot.model)} joints"

    def blocks(self) -> Iterator[Block]:
        """Verdict with bodies, joints, mass and tip, and the parts.

        Returns
        -------
        blocks : iterator of Block
        """
        from ..core.answers.blocks import Headline, Line, Table, numbers, words

        model = self.robot.model
        properties = _properties_sentence(self.robot)
        lines_below = []
        if self.doubts:
            lines_below.append(Line(properties))
        if model.tip is None:
            lines_below.append(Line(_possible_tips_sentence(model)))
        if self.doubts:
            yield Headline(Word.UNSURE, f"{'; '.join(self.doubts)}.", further=lines_below)
        else:
            yield Headline(Word.DONE, properties, further=lines_below)
        yield ""
        names, prefixes, joint_counts, masses = [], [], [], []
        for part in self.parts:
            part_model = part.robot.model
            names.append(part.robot.name)
            prefixes.append(part.prefix)
            joint_counts.append(_joint_count(part_model))
            masses.append(part_model.moving_mass + part_model.base_inertia.mass)
        yield Table(
            "",
            words("part", names),
            words("stands at", [frame or "origin" for frame in self.frames]),
            words("prefix", prefixes),
            numbers("joints", joint_counts),
            numbers("mass", masses, unit="kg"),
        )

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the parts.

        Returns
        -------
        files : {argument: path}
        """
        files: dict[str, str | Path] = {}
        for k, part in enumerate(self.parts, 1):
            if Path(part.file).is_file():
                files[f"PART {k}"] = part.file
        return files

    def write(self, path: str | Path, *, overwrite: bool = False) -> Saved:
        """Write the joined robot as URDF, MJCF or SDF.

        Parameters
        ----------
        path : str or Path, whose suffix selects the format

        Returns
        -------
        lost : Saved, properties that the format cannot represent

        Raises
        ------
        ValueRangeError
            The file exists, and ``overwrite`` is False; or its suffix is none of a robot file.
        """
        from ..robot.save import save

        return save(self.robot, path, overwrite=overwrite)


def join(*parts: PartGiven, name: str = "", degrees: bool = False) -> RobotCell:
    """Join robots to one, each fixed to a frame of those before it: a rail, an arm on it, a gripper, a second arm.

    Parameters
    ----------
    *parts : Robot, :class:`PlacedRobot`, path, or text ``FILE@FRAME+x,y,z,roll,pitch,yaw:PREFIX``
        The first part stands at the origin. A later part without a frame stands at the tip of the cell so far. The frame
        ``floor`` is made where a part asks for it; parts on it stand side by side.
    name : str, name of the joined robot; default: the names of the parts, joined
    degrees : bool, angles in texts are in degrees

    Returns
    -------
    cell : RobotCell
        ``cell.robot`` is the joined robot, ``cell.write(path)`` its file.

    Raises
    ------
    ModelError
        Two parts have a link or joint of the same name, and the latter has no prefix.
    UnknownNameError
        The cell has no such frame.
    ValueRangeError
        There are no parts, or a text has another form.

    Examples
    --------
    >>> import twistwrench as tw
    >>> cell = tw.join("ur5", "planar_2r@tool0+0,0,0.1,0,0,90deg:hand_")
    >>> cell.robot.joint_names[-2:], cell.robot.tip
    (('hand_joint1', 'hand_joint2'), 'hand_tip')
    """
    placed_robots = [_placed_robot(part, degrees=degrees) for part in parts]
    if not placed_robots:
        raise ValueRangeError(f"there is nothing to join. Give robots, each {_FORM_OF_PART}.")
    cell_name = name or "_".join(part.robot.name for part in placed_robots)
    cell, parts_to_attach, frames = _first_robot(placed_robots)
    doubts: list[Reason] = []
    for part in parts_to_attach:
        frame = part.frame or _tip_of(cell, part)
        if part.frame is None:
            other_tips = _tips_beside(cell.model, frame)
            if other_tips:
                remedy = f"name the frame, {part.file or part.robot.name}@FRAME"
                tips_text = listed(other_tips, _MAX_LISTED_NAMES)
                doubt_text = f"{part.robot.name} stands at {frame}, and {tips_text} is a tip too; {remedy}"
                doubts.append(Reason(doubt_text, remedy))
        cell = cell.attach(part.robot, frame, part.pose, prefix=part.prefix, name=cell_name)
        frames.append(frame)
    links_without_mass = massless_links(cell.model)
    if links_without_mass:
        verb = "have" if len(links_without_mass) > 1 else "has"
        doubts.append(Reason(f"{listed(links_without_mass, _MAX_LISTED_NAMES)} {verb} no mass"))
    return RobotCell(cell, tuple(placed_robots), tuple(frames), tuple(doubts))


def _first_robot(parts: Sequence[PlacedRobot]) -> tuple[Robot, Sequence[PlacedRobot], list[str]]:
    """Robot to begin with, the parts to be attached to it, and a frame for each part that it contains.

    The robot is the first part. It is a floor if a part needs one, or if the first part has a place or a prefix.
    """
    first_part = parts[0]
    if first_part.frame not in (None, FLOOR):
        raise ValueRangeError(
            f"the first part, {first_part.robot.name}, cannot stand at {first_part.frame!r}: nothing is there yet. "
            f"Leave the frame out, or give {FLOOR!r}."
        )
    is_placed = first_part.frame is not None or first_part.pose is not None
    stands_on_floor = any(part.frame == FLOOR for part in parts)
    needs_floor = stands_on_floor and FLOOR not in first_part.robot.frame_names
    if not (is_placed or first_part.prefix or needs_floor):
        return first_part.robot, parts[1:], [""]  # the first part stands at the origin, not at a frame
    floor = load(f'<robot name="cell"><link name="{FLOOR}"/></robot>')
    return floor, [replace(first_part, frame=FLOOR), *parts[1:]], []


def _placed_robot(part: PartGiven, *, degrees: bool) -> PlacedRobot:
    """Robot and place of a part in any of its forms."""
    if isinstance(part, PlacedRobot):
        return part
    if isinstance(part, Robot):
        return PlacedRobot(part)
    if isinstance(part, Path):
        return PlacedRobot(load(part), file=part)
    if isinstance(part, str):
        return PlacedRobot.from_text(part, degrees=degrees)
    raise ValueRangeError(f"a part is {arguments.value_text(part)}. Give a robot, a path, or text {_FORM_OF_PART}.")


def _tip_of(cell: Robot, part: PlacedRobot) -> str:
    """Tip of the cell, at which a part without a frame stands."""
    if cell.tip is None:
        tips_text = listed(cell.model.leaves, _MAX_LISTED_TIPS)
        raise FrameError(
            f"{part.robot.name} has no frame, and the cell so far has several tips: {tips_text}. "
            f"Name one, {part.file or part.robot.name}@{cell.model.leaves[0]}."
        )
    return cell.tip


def _properties_sentence(robot: Robot) -> str:
    """Sentence with the numbers of bodies and joints, the mass and the tip of a cell."""
    model = robot.model
    joint_count = _joint_count(model)
    tip_text = "no single tip" if model.tip is None else f"the tip {model.tip}"
    base_text = ""
    if joint_count != len(model.leaders):
        base_text = "a floating base, "
    mass_text = f"{number(model.moving_mass)} kg that move"
    bodies_and_joints = f"{len(model.bodies)} moving bodies, {joint_count} joints"
    return f"{robot.name} has {bodies_and_joints}, {base_text}{mass_text}, and {tip_text}."


def _possible_tips_sentence(model: Model) -> str:
    """Sentence on a cell that ends in several frames, of which none is the tip."""
    tips = model.possible_tips
    payload_argument = spell(Argument("payload", f"4@{tips[0]}"))
    tip_argument = spell(Argument("tip", tips[0]))
    tips_text = listed(tips, _MAX_LISTED_TIPS)
    return (
        f"A payload needs a frame, {payload_argument}, or the robot a tip, {tip_argument}. Possible tips: {tips_text}."
    )


def _joint_count(model: Model) -> int:
    """Number of driven joints; the joint of a floating base is not driven."""
    return sum(body.joint.driven for body in model.leaders)


def _tips_beside(model: Model, tip: str) -> list[str]:
    """Other tips on the body of ``tip`` whose poses differ from its pose."""
    tip_frame = model.all_frames[tip]
    other_tips = []
    for name in model.leaves:
        frame = model.frames[name]
        if name == tip or frame.body != tip_frame.body:
            continue
        if not np.allclose(frame.pose, tip_frame.pose, atol=_MIN_TIP_DISTANCE):
            other_tips.append(name)
    return other_tips


def _pose(text: str, part: str, *, degrees: bool) -> Array:
    """Pose (4, 4) of the text x,y,z,roll,pitch,yaw, or x,y,z without rotation; ``part`` names the part in messages."""
    number_texts = text.split(",")
    if len(number_texts) not in (3, 6):
        raise ValueRangeError(
            f"the pose of {part!r} has {len(number_texts)} numbers. Give x,y,z or x,y,z,roll,pitch,yaw."
        )
    angle_unit = math.radians(1.0) if degrees else 1.0  # of numbers without a unit [rad]
    position = [_number(number_text, part) for number_text in number_texts[:3]]
    angle_texts = number_texts[3:] or ("0", "0", "0")
    rpy = [_angle(angle_text.strip(), part, angle_unit) for angle_text in angle_texts]
    return se3.pose(rotation_of_rpy(rpy), position)


def _angle(text: str, part: str, unit: float) -> float:
    """Angle [rad] of a text: in degrees if it ends with ``deg``, else in ``unit`` [rad]."""
    if text.endswith("deg"):
        return math.radians(_number(text.removesuffix("deg"), part))
    angle = unit * _number(text, part)
    if abs(angle) > math.tau:
        turns = number(angle / math.tau, 3)
        raise ValueRangeError(f"the part {part!r} is turned by {text} rad, {turns} turns. For degrees write {text}deg.")
    return angle


def _number(text: str, part: str) -> float:
    """Number of a text; ``part`` names the part in messages."""
    value, *_ = arguments.parse_numbers(text.strip(), f"a number of the part {part!r},", "one number", 1)
    return value


complete(globals())
