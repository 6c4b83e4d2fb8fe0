"""Robots into files."""

from __future__ import annotations

import warnings
from pathlib import Path

from ..core.files import as_path
from ..errors import ValueRangeError
from .robot import Robot
from .robot_argument import require_robot


def save(robot: Robot, path: str | Path, *, overwrite: bool = False) -> list[str]:
    """Write a robot as a URDF, MJCF or SDF file.

    Parameters
    ----------
    robot : Robot
    path : str or Path, whose ending tells the format: ``.urdf``; ``.xml`` or ``.mjcf``; ``.sdf`` or ``.world``
    overwrite : bool, replace a file that is there

    Returns
    -------
    lost : list of str
        What the format cannot say of the robot, a sentence each, its tip included where reading the file takes another;
        empty where reading the file gives the same robot.

    Raises
    ------
    ValueRangeError
        The ending is none of these, the file is there, or it cannot be written.
    ModelError
        The format has no words for how the robot moves.

    Notes
    -----
    The file is whole or not there. Looks and shapes are not kept by a robot, and are not written.

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
    from ..formats.writers import SUFFIXES, WRITERS
    from ..outputs import check_outputs, refuse_existing, replacing

    require_robot(robot, "save")
    path = as_path(path)
    form = SUFFIXES.get(path.suffix.lower())
    if form is None:
        raise ValueRangeError(
            f"cannot write {path.name!r}: its ending tells no format. Choose one of {', '.join(SUFFIXES)}."
        )
    check_outputs({"the file": path}, {})
    refuse_existing(path, overwrite=overwrite)
    written = WRITERS[form](robot.model)
    with replacing(path) as scratch:
        scratch.write_text(written.text, encoding="utf-8", newline="\n")
    return [*written.lost, *_tip_lost(robot, path)]


def _tip_lost(robot: Robot, path: Path) -> list[str]:
    """A sentence where the file's default tip is another one: no format has a word for it."""
    from ..formats import load_model

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what reading remarks on is in the robot that was written
        tip = load_model(path).tip
    if tip == robot.tip:
        return []
    found = "finds none" if tip is None else f"takes {tip!r}"
    return [f"the tip is not kept: reading the file {found}; say tip={robot.tip!r} for the same"]
