"""``<include>``: other files put in place of it. Never from outside the folder of the file, or of ``include_paths``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ...errors import RobotFileError
from ..element import Element
from ..source import MAX_BYTES, read_robot_text
from ..xml_parser import parse

_DEEPEST = 16
_ROOTS = ("mujoco", "mujocoinclude")


class Folders:
    """The folders that a robot file may read other files from; none where the robot came as text."""

    def __init__(self, home: Path | None, more: Sequence[Path] = ()) -> None:
        self.allowed = [folder.resolve() for folder in ([home] if home is not None else []) + list(more)]

    def find(self, name: str, asked: Element, near: Path | None = None) -> Path:
        """The file called ``name``, looked for in the robot's folder, beside the file that asks, then in the other folders.

        Raises :class:`~twistwrench.RobotFileError`, naming the element that asked, for absolute paths, addresses, what lies
        outside, and what is not there.
        """
        if not name or "\0" in name or name.startswith(("/", "\\")) or re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", name):
            raise RobotFileError(
                f"{asked} names the file {name[:200]!r}: only paths below the robot's own folder are read."
            )
        if not self.allowed:
            raise RobotFileError(
                f"{asked} names the file {name[:200]!r}, and a robot given as text has no folder. Load it from its path, or "
                "say include_paths=[folder]."
            )
        try:
            folders = [self.allowed[0], *([near] if near is not None else []), *self.allowed[1:]]
            places = [(folder / name).resolve() for folder in folders]
            within = [path for path in places if any(path.is_relative_to(folder) for folder in self.allowed)]
            found = next((path for path in within if path.is_file()), None)
        except OSError:
            within, found = [Path(name)], None
        if found is not None:
            return found
        if not within:
            raise RobotFileError(
                f"{asked} names the file {name[:200]!r}, which lies outside the robot's folder. If it is to be read, say "
                "include_paths=[its folder]."
            )
        raise RobotFileError(f"{asked} names the file {name[:200]!r}, which is not there.")


def expand(root: Element, folders: Folders, max_bodies: int) -> None:
    """Put the elements of the files that ``<include>`` elements name in their places, in ``root`` itself.

    Raises :class:`~twistwrench.RobotFileError` for files outside the folders, files included twice, and too many of them.
    """
    seen: dict[Path, Element] = {}
    total = 0
    stack: list[tuple[Element, int, Path | None]] = [(root, 0, None)]
    while stack:
        element, depth, near = stack.pop()
        children: list[Element] = []
        waiting = [(child, depth, near) for child in reversed(element.children)]
        while waiting:
            child, level, folder = waiting.pop()
            if child.tag != "include":
                child.parent = element
                children.append(child)
                if child.children:
                    stack.append((child, level, folder))
                continue
            if level == _DEEPEST:
                raise RobotFileError(
                    f"{child} is the {_DEEPEST + 1}th include inside includes; {_DEEPEST} are allowed."
                )
            path = folders.find(child.text("file"), child, folder)
            if path in seen:
                raise RobotFileError(
                    f"{child} includes {child.text('file')!r} again, after {seen[path]}. Each file may be included once."
                )
            seen[path] = child
            total += path.stat().st_size
            if total > MAX_BYTES:
                raise RobotFileError(f"{child}: the included files have more than {MAX_BYTES // 2**20} MiB together.")
            part = _part(path, child, max_bodies)
            waiting.extend((one, level + 1, path.parent) for one in reversed(part.children))
        element.children = children


def _part(path: Path, asked: Element, max_bodies: int) -> Element:
    name = asked.text("file")
    try:
        part = parse(read_robot_text(path)[0], name, max_bodies)
    except RobotFileError as error:
        raise RobotFileError(f"{asked} → {name}: {error}") from None
    if part.tag not in _ROOTS:
        raise RobotFileError(
            f"{asked} includes {name!r}, whose root element is <{part.tag}>, expected <mujocoinclude> or <mujoco>."
        )
    return part
