"""Readers of robot files: detect the format from the content and return a checked model."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ..core.arguments import integer
from ..core.errors import ModelError, RobotFileError, ValueRangeError
from ..core.text import argument, bounded_message
from ..mechanics.model.builder import ModelBuilder
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
    all_formats = (*FORMATS, "usd")
    if format is not None and format not in all_formats:
        choices = ", ".join(map(repr, all_formats))
        raise ValueRangeError(f"format={format!r} is not allowed. Choose from: {choices}, or None.")
    max_bodies = integer(max_bodies, "max_bodies")
    usd = usd_path(source)
    arguments = xacro_arguments(xacro)
    folders = [Path(folder) for folder in include_paths]
    file = None  # of XML; None for a text or a USD file
    if usd is None and not is_text(source):
        file = RobotFile.from_path(source, data)
    text, origin = _text_and_origin(source, usd, file)
    options = _ReadOptions(source, folders, floating_base, keep, model, max_bodies, snap)
    name_in_messages = origin
    content: Path | Element
    try:
        if usd is not None:
            bytes_of(usd)  # raises an error if the file cannot be read
            content = usd
        else:
            if file is None:
                content = parse(text, max_bodies=max_bodies)
            else:
                content = file.parse_root(max_bodies)
            expansion = _xacro_expansion(source, text, content, arguments, folders)
            if expansion is not None:
                name_in_messages = f"{origin} (lines are those that xacro expands it to)"
                content = parse(expansion, max_bodies=max_bodies)
        builder, floating = _read_content(content, file or origin, format, options)
        if floating_base is False:
            builder.mount()
        return builder.build(
            floating_base=floating, lock=lock, tip=tip, mimic=mimic, inertia=inertia, snap=snap, gravity=gravity,
            quiet=quiet,
        )  # fmt: skip
    except ModelError as error:
        # Only this function has the file's name.
        raise type(error)(f"{name_in_messages}: {bounded_message(str(error))}") from None


def _text_and_origin(source: str | os.PathLike[str], usd: Path | None, file: RobotFile | None) -> tuple[str, str]:
    """Text of a robot file and its name in messages; the text of a USD file is not read."""
    if file is not None:
        return file.text, str(file)
    if usd is not None:
        return "", str(usd)
    return read_robot_text(source)


@dataclass(frozen=True)
class _ReadOptions:
    """Options of :func:`load_model` that the readers of formats use."""

    source: str | os.PathLike[str]
    folders: Sequence[Path]
    floating_base: bool | None
    keep: str | None
    model: str | None
    max_bodies: int
    snap: float

    def check(self, kind: str) -> None:
        """Raise ValueRangeError for an option that files of the format ``kind`` do not have."""
        options = (  # name, value, formats that have it
            ("keep", self.keep, ("mjcf",)),
            ("model", self.model, ("sdf", "usd")),
        )
        for option, value, formats in options:
            if value is not None and kind not in formats:
                names = " and ".join(name.upper() for name in formats)
                raise ValueRangeError(f"{argument(option, value)} is of {names} files, and this one is {kind.upper()}.")


def _read_content(
    content: Path | Element, origin: str, wanted_format: str | None, options: _ReadOptions
) -> tuple[ModelBuilder, bool]:
    """Builder of a robot, and True if its root floats. Only the reader of its format is imported, to save time."""
    if isinstance(content, Path):
        kind = "usd"
        kind_text = kind
    else:
        kind = _format_of(content)
        kind_text = f"{kind.upper()} (<{content.tag}>, {content.place})"
    options.check(kind)
    if wanted_format not in (None, kind):
        raise RobotFileError(f"it is {kind_text}, and format={wanted_format!r} was given.")
    if isinstance(content, Path):
        from .usd import read_usd

        return read_usd(
            content, origin, include_paths=options.folders, floating_base=options.floating_base,
            model=options.model, max_bodies=options.max_bodies,
        )  # fmt: skip
    if kind == "mjcf":
        from .mjcf import read_mjcf
        from .mjcf.preprocess import Folders

        folder_of_file = None
        if not is_text(options.source):
            folder_of_file = Path(options.source).parent
        folders = Folders(folder_of_file, options.folders)
        return read_mjcf(
            content, origin, folders, floating_base=options.floating_base, keep=options.keep,
            max_bodies=options.max_bodies,
        )  # fmt: skip
    if kind == "sdf":
        from .sdf import read_sdf

        return read_sdf(content, origin, floating_base=options.floating_base, model=options.model), False
    from .urdf import read_urdf

    return read_urdf(content, origin, options.snap), bool(options.floating_base)


def format_of_file(path: Path) -> str:
    """Format of a robot file, one of :data:`FORMATS` or ``"usd"``. Raises the errors of :func:`load_model`."""
    if usd_path(path) is not None:
        return "usd"
    return _format_of(RobotFile.from_path(path).root)


def usd_path(source: object) -> Path | None:
    """Path of a file with a USD suffix; otherwise None."""
    if not isinstance(source, str | os.PathLike) or is_text(source):
        return None
    path = Path(source)
    if path.suffix.lower() not in USD:
        return None
    return path


def _format_of(root: Element) -> str:
    """Format with this root element. Raises RobotFileError for another element."""
    for name, tag in FORMATS.items():
        if root.tag == tag:
            return name
    if root.tag == "mujocoinclude":
        raise RobotFileError(
            f"it is a part of a robot (<{root.tag}>, {root.place}). Load the MJCF file that includes it."
        )
    raise RobotFileError(
        f"its root element is <{root.tag}> ({root.place}), expected <robot> (URDF), <mujoco> (MJCF) or <sdf>."
    )


def _xacro_expansion(
    source: str | os.PathLike[str],
    text: str,
    root: Element,
    arguments: Mapping[str, Any] | None,
    folders: Sequence[Path],
) -> str | None:
    """Text after xacro expansion; None if there is nothing to expand.

    A file that ends in ``.xacro`` is always expanded. Another file or text with xacro is expanded if ``arguments`` are
    given, even an empty mapping; otherwise RobotFileError is raised.
    """
    path = None
    if not is_text(source):
        path = Path(source)
    marker = xacro_in(text, root)  # text about the xacro that was found; empty if there is none
    is_xacro_file = path is not None and path.suffix.lower() == ENDING
    if is_xacro_file or (arguments is not None and is_marked(text)):
        return expand_xacro(text, path, arguments or {}, folders, marker)
    if marker:
        raise RobotFileError(
            f"{marker}, which is expanded only on request in files that do not end in .xacro. Load it with "
            f"{argument('xacro', True)}, or run {EXPAND} and load robot.urdf."
        )
    if arguments:
        raise ValueRangeError(
            f"{argument('xacro')} is of xacro files, and this one is not: <{root.tag}>, {root.place}."
        )
    return None
