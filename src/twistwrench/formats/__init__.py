"""Readers of robot files: detect the format from the content and return a checked model."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ..core.arguments import integer
from ..core.errors import ModelError, RobotFileError, ValueRangeError
from ..core.text import argument, bounded_message
from ..mechanics.model.model import Model
from ..mechanics.model.snapping import DEFAULT_SNAP
from .robot_file import USD, RobotFile
from .source import bytes_of, is_text, read_robot_text
from .xacro import ENDING, EXPAND, expand_xacro, is_marked, xacro_arguments, xacro_in
from .xml import MOST_BODIES, Element, parse

__all__ = ["FORMATS", "format_of_file", "load_model", "usd_path"]

FORMATS = {"urdf": "robot", "mjcf": "mujoco", "sdf": "sdf"}
"""Root element of each XML format."""


def load_model(
    source: str | os.PathLike[str],
    *,
    data: bytes | None = None,
    quiet: bool = False,
    format: str | None = None,  # noqa: A002  the usual name
    floating_base: bool | None = None,
    keep: str | None = None,
    model: str | None = None,
    include_paths: Sequence[str | os.PathLike[str]] = (),
    max_bodies: int = MOST_BODIES,
    xacro: Mapping[str, str | float | bool] | bool | None = None,
    lock: Mapping[str, ArrayLike] | None = None,
    tip: str | None = None,
    mimic: str = "follow",
    inertia: str = "error",
    snap: float = DEFAULT_SNAP,
    gravity: ArrayLike | None = None,
) -> Model:
    """Load the model of a robot file or XML text; options as in :func:`twistwrench.load`. ``data``: content, if read.

    With ``quiet``, notes are not issued as warnings; the model's defects contain them in both cases. Raises
    :class:`~twistwrench.NotFoundError`, :class:`~twistwrench.RobotFileError` if the file cannot be read, and another
    :class:`~twistwrench.ModelError` if the robot is inconsistent. Messages have the file's name and the line.
    """
    if format is not None and format not in (*FORMATS, "usd"):
        choices = ", ".join(map(repr, (*FORMATS, "usd")))
        raise ValueRangeError(f"format={format!r} is not allowed. Choose from: {choices}, or None.")
    max_bodies = integer(max_bodies, "max_bodies")
    usd = usd_path(source)
    arguments, folders_given = xacro_arguments(xacro), [Path(folder) for folder in include_paths]
    file = None if usd is not None or is_text(source) else RobotFile.from_path(source, data)
    if file is not None:
        text, origin = file.text, str(file)
    else:
        text, origin = ("", str(usd)) if usd is not None else read_robot_text(source)
    home = None if is_text(source) else Path(source).parent
    shown = origin
    try:
        if usd is None:
            root = parse(text, max_bodies=max_bodies) if file is None else file.parsed(max_bodies)
            if (expanded := _expanded(source, text, root, arguments, folders_given)) is not None:
                text, shown = expanded, f"{origin} (lines are those that xacro expands it to)"
                root = parse(text, max_bodies=max_bodies)
            found = _format_of(root)
            said = f"{found.upper()} (<{root.tag}>, {root.place})"
        else:
            bytes_of(usd)
            found = said = "usd"
        for option, value, own in (("keep", keep, ("mjcf",)), ("model", model, ("sdf", "usd"))):
            if value is not None and found not in own:  # only formats whose files have several parts
                formats = " and ".join(name.upper() for name in own)
                raise ValueRangeError(
                    f"{argument(option, value)} is of {formats} files, and this one is {found.upper()}."
                )
        if format not in (None, found):
            raise RobotFileError(f"it is {said}, and format={format!r} was given.")
        if usd is not None:  # import only the required reader
            from .usd import read_usd

            builder, floating = read_usd(
                usd, origin, include_paths=folders_given, floating_base=floating_base,
                model=model, max_bodies=max_bodies,
            )  # fmt: skip
        elif found == "mjcf":
            from .mjcf import read_mjcf
            from .mjcf.preprocess import Folders

            folders = Folders(home, folders_given)
            builder, floating = read_mjcf(
                root, file or origin, folders, floating_base=floating_base, keep=keep, max_bodies=max_bodies
            )
        elif found == "sdf":
            from .sdf import read_sdf

            builder, floating = read_sdf(root, file or origin, floating_base=floating_base, model=model), False
        else:
            from .urdf import read_urdf

            builder, floating = read_urdf(root, file or origin, snap), bool(floating_base)
        if floating_base is False:
            builder.mount()
        return builder.build(
            floating_base=floating, lock=lock, tip=tip, mimic=mimic, inertia=inertia, snap=snap, gravity=gravity,
            quiet=quiet,
        )  # fmt: skip
    except ModelError as error:
        # Only this function has the file's name.
        raise type(error)(f"{shown}: {bounded_message(str(error))}") from None


def format_of_file(path: Path) -> str:
    """Format of a robot file, one of :data:`FORMATS` or ``"usd"``; raises as :func:`load_model`."""
    if usd_path(path) is not None:
        return "usd"
    return _format_of(RobotFile.from_path(path).root)


def usd_path(source: object) -> Path | None:
    """Path of a file with a USD suffix; otherwise None."""
    if not isinstance(source, str | os.PathLike) or is_text(source):
        return None
    return path if (path := Path(source)).suffix.lower() in USD else None


def _format_of(root: Element) -> str:
    found = next((name for name, tag in FORMATS.items() if root.tag == tag), None)
    if root.tag == "mujocoinclude":
        raise RobotFileError(
            f"it is a part of a robot (<{root.tag}>, {root.place}). Load the MJCF file that includes it."
        )
    if found is None:
        raise RobotFileError(
            f"its root element is <{root.tag}> ({root.place}), expected <robot> (URDF), <mujoco> (MJCF) or <sdf>."
        )
    return found


def _expanded(
    source: str | os.PathLike[str],
    text: str,
    root: Element,
    arguments: Mapping[str, Any] | None,
    folders: Sequence[Path],
) -> str | None:
    """Text after xacro expansion; None if there is nothing to expand.

    A file that ends in ``.xacro`` is expanded, and any other file or text if ``arguments`` are given, even without entries.
    Raises RobotFileError for xacro in other files.
    """
    path = None if is_text(source) else Path(source)
    found, ending = xacro_in(text, root), path is not None and path.suffix.lower() == ENDING
    if ending or (arguments is not None and is_marked(text)):
        return expand_xacro(text, path, arguments or {}, folders, found)
    if found:
        raise RobotFileError(
            f"{found}, which is expanded only on request in files that do not end in .xacro. Load it with "
            f"{argument('xacro', True)}, or run "
            f"{EXPAND} and load robot.urdf."
        )
    if arguments:
        raise ValueRangeError(
            f"{argument('xacro')} is of xacro files, and this one is not: <{root.tag}>, {root.place}."
        )
    return None
