"""Saving of robots to files."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import ValueRangeError
from ..core.files import as_path
from ..core.glossary import complete
from .base import require_robot
from .robot import Robot

if TYPE_CHECKING:
    from ..formats.writers import RobotDocument
    from ..mechanics.model.model import Model
    from .export.written import Saved

_SUFFIX_OF_FORMAT = {"urdf": ".urdf", "mjcf": ".xml", "sdf": ".sdf"}
"""Usual suffix of each format, for the example in an error message."""


def save(robot: Robot, path: str | Path, *, overwrite: bool = False, strict: bool = False) -> Saved:
    """Write a robot as a URDF, MJCF or SDF file.

    The file is written atomically. Visuals and collision shapes are not part of a robot and are not written.

    Parameters
    ----------
    path : str or Path, whose suffix selects the format: ``.urdf``; ``.xml`` or ``.mjcf``; ``.sdf`` or ``.world``
    strict : bool
        Count lost properties against the verdict.

    Returns
    -------
    lost : Saved, a list of str
        Properties of the robot that the format cannot represent, one sentence each, including a tip that differs from
        the default after reading; empty if reading the file returns the same robot.

    Raises
    ------
    ModelError
        The format cannot represent the robot's motion.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> tw.save(tw.robots.ur5(), folder / "ur5.urdf")
    []
    >>> tw.load(folder / "ur5.urdf").tip
    'tool0'
    """
    from ..core.files import check_outputs, refuse_existing, replacing
    from .export.written import Saved

    require_robot(robot, "save")
    path = as_path(path)
    write = writer_of(path, robot.name)
    check_outputs({"the file": path}, {})
    refuse_existing(path, overwrite=overwrite)
    document = write(robot.model)
    with replacing(path) as temporary_file:
        temporary_file.write_text(document.text, encoding="utf-8", newline="\n")
    return Saved([*document.lost, *_loss_of_tip(robot, path)], path, robot.name, strict=strict)


def writer_of(path: str | Path, name: str = "robot") -> Callable[[Model], RobotDocument]:
    """Writer of the format that the ending of a path names; raises ValueRangeError for another ending.

    ``name``: name of the robot, for an example in the message.
    """
    from ..formats.writers import SUFFIXES, WRITERS

    path = as_path(path)
    file_format = SUFFIXES.get(path.suffix.lower())
    if file_format is None:
        # A path such as "mjcf" is the name of a format, and gets an example of it.
        example = name + _SUFFIX_OF_FORMAT.get(path.name.lower(), ".urdf")
        raise ValueRangeError(
            f"cannot write {path.name!r}: its ending does not name a format. Choose one of {', '.join(SUFFIXES)}, "
            f"for example {example}."
        )
    return WRITERS[file_format]


def _loss_of_tip(robot: Robot, path: Path) -> list[str]:
    """Sentence, as a list, if the file's default tip differs from the robot's; no format stores the tip."""
    from ..formats import load_model

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the written robot has the same warnings
        tip = load_model(path, inertia="accept").tip
    if tip == robot.tip:
        return []
    effect = "finds none" if tip is None else f"takes {tip!r}"
    return [f"the tip is not kept: reading the file {effect}; pass tip={robot.tip!r} for the same"]


complete(globals())
