"""Reading robots: a file or text in, a checked model out. The format is told by content, not by file name."""

from __future__ import annotations

import os
from collections.abc import Mapping

from numpy.typing import ArrayLike

from ..errors import ModelError, RobotFileError
from ..model.model import Model
from ..model.snap import DEFAULT_SNAP
from .element import Element, parse
from .source import read_robot_text
from .urdf import read_urdf

__all__ = ["load_model"]

_NOT_READ = {"mujoco": "MJCF", "mujocoinclude": "MJCF", "sdf": "SDFormat"}


def load_model(
    source: str | os.PathLike[str],
    *,
    floating_base: bool = False,
    lock: Mapping[str, ArrayLike] | None = None,
    tip: str | None = None,
    mimic: str = "follow",
    inertia: str = "error",
    snap: float = DEFAULT_SNAP,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
) -> Model:
    """The model in a robot file, or in XML text; options as in :meth:`ModelBuilder.build`.

    Raises :class:`~twistwrench.NotFoundError`, :class:`~twistwrench.RobotFileError` for what is no readable URDF, other
    :class:`~twistwrench.ModelError` for what no robot can mean, each with the file's name and the line.

    >>> load_model('<robot name="stone"><link name="stone"/></robot>').tip
    'stone'
    """
    text, origin = read_robot_text(source)
    try:
        robot = parse(text)
        _check_format(robot)
        builder = read_urdf(robot, origin, snap)
        return builder.build(
            floating_base=floating_base, lock=lock, tip=tip, mimic=mimic, inertia=inertia, snap=snap, gravity=gravity
        )
    except ModelError as error:
        # What is wrong is known deep inside, and which file it is only here.
        raise type(error)(f"{origin}: {error}") from None


def _check_format(root: Element) -> None:
    if root.tag in _NOT_READ:
        raise RobotFileError(
            f"it is {_NOT_READ[root.tag]} (<{root.tag}>, line {root.line}), which is not read yet. Convert it to URDF."
        )
    if root.tag != "robot":
        raise RobotFileError(f"its root element is <{root.tag}> (line {root.line}), expected <robot>, as in URDF.")
    for element in root.walk():
        raw = next((f'{name}="{text}"' for name, text in element.attributes.items() if "${" in text), None)
        if element.tag.startswith("xacro:") or raw:
            raise RobotFileError(
                f"{element} is unexpanded xacro{': ' + raw if raw else ''}. Run `xacro file.xacro > robot.urdf` first, "
                "and load robot.urdf."
            )
