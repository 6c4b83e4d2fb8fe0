"""Where the meshes of a robot file are: package://, model://, file:// and relative names as paths. Nothing is fetched."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

MESHES = (".stl", ".dae", ".obj", ".ply", ".glb", ".gltf", ".off")
"""Endings of the files that are opened; a robot file may come from anywhere, and names no others."""
_PACKAGES = ("package://", "model://")


def find_resource(uri: str, robot_file: Path) -> Path | None:
    """The file that ``uri`` means in ``robot_file``, or None if it is nowhere.

    A package is looked for in the folders around the robot file, then in those of ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH``; a name that leads out of it is taken not to be there. So is whatever is no mesh by its ending, and
    what would have to be fetched, as with http://.
    """
    try:
        return next((path for path in _places(uri.strip(), robot_file) if _is_mesh(path)), None)
    except (OSError, ValueError):  # names that no file system takes
        return None


def _is_mesh(path: Path) -> bool:
    return path.suffix.lower() in MESHES and path.is_file()


def _places(uri: str, robot_file: Path) -> Iterator[Path]:
    scheme = next((s for s in _PACKAGES if uri.startswith(s)), None)
    if scheme is not None:
        name, _, rest = unquote(uri[len(scheme) :]).partition("/")
        inside = Path(os.path.normpath(rest))
        if name in ("", ".", "..") or inside.is_absolute() or ".." in inside.parts:
            return
        for folder in robot_file.resolve().parents:
            yield folder / name / rest
            if folder.name == name:
                yield folder / rest
        for folder in _known_folders():
            yield folder / name / rest
    elif uri.startswith("file://"):
        yield Path(unquote(uri.removeprefix("file://")))
    elif "://" not in uri and uri:
        yield robot_file.parent / uri


def _known_folders() -> Iterator[Path]:
    for folder in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(folder)
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(prefix) / "share"
