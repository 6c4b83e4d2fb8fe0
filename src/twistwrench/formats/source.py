"""Sources of robot descriptions: files or text, xacro, and mesh files."""

from __future__ import annotations

import codecs
import difflib
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from ..core.errors import NotFoundError, RobotFileError
from ..core.files import read_bytes, read_standard_input
from ..core.numbers import printed
from ..core.third_party import third_party_errors

MAX_BYTES = 64 * 2**20
"""Largest accepted file [bytes]; the largest robot descriptions in use have a few MiB."""

_BUNDLED_ROBOTS = Path(__file__).parents[1] / "robots"
_NO_ENCODINGS = {"idna", "punycode", "undefined", "unicode_escape", "raw_unicode_escape"}
"""Python encodings that XML files do not use."""

DECLARED_ENCODING = re.compile(rb"""^\s*<\?xml[^>]*?\sencoding\s*=\s*["']([A-Za-z0-9._:-]+)["']""")


def read_robot_text(source: str | os.PathLike[str]) -> tuple[str, str]:
    """Text of a robot description, and its name in messages: the path, or "the text given".

    ``source`` is a path, or XML text, whose first non-blank character is "<". A path may be a pipe, which can be read
    only once. Raises :class:`~twistwrench.NotFoundError` with similar file names, or :class:`~twistwrench.RobotFileError`.
    """
    if is_text(source):
        source = str(source)
        _check_size(len(source), "the text given")
        return source, "the text given"
    path = path_given(source)
    return decode_text(bytes_of(path), str(path)), str(path)


def path_given(source: object) -> Path:
    """Path of a robot file; raises RobotFileError for anything else."""
    if not isinstance(source, str | os.PathLike):
        remedy = "Pass its .robot." if hasattr(source, "robot") else "Pass a str or a Path."
        raise RobotFileError(
            f"a robot is loaded from a path or from XML text, not from {type(source).__name__}. {remedy}"
        )
    if isinstance(source, str) and (not source.strip() or "\n" in source):
        raise RobotFileError(
            f"the text given is neither XML nor a path: {_beginning(source)}. XML text begins with '<'."
        )
    return Path(source)


def is_text(source: object) -> bool:
    """True for XML text: its first non-blank character is "<"."""
    return isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")


def standard_input_text() -> str:
    """Robot description from standard input. Raises :class:`~twistwrench.RobotFileError`."""
    with third_party_errors(lambda reason: RobotFileError(f"cannot read standard input: {reason}.")):
        text = decode_text(read_standard_input(MAX_BYTES), "standard input")
    if not text.lstrip("\ufeff \t\r\n").startswith("<"):
        raise RobotFileError(f"standard input is no XML: {_beginning(text)}. XML text begins with '<'.")
    return text


def _beginning(text: str) -> str:
    """First characters of a text, for messages."""
    return f"it begins with {text.strip()[:20]!r}" if text.strip() else "it is empty"


def bytes_of(path: Path) -> bytes:
    """Content of a file; raises as :func:`read_robot_text`."""
    name = str(path)
    clipped = name
    if len(name) > 200:
        clipped = name[:200] + "…"
    # A name that file systems reject (too long, with a NUL) is probably text that was meant to be XML.
    advice = "Pass a path, or XML text that begins with '<'."
    with third_party_errors(lambda reason: RobotFileError(f"cannot read {clipped!r}: {reason}. {advice}")):
        if path.is_dir():
            raise RobotFileError(f"{clipped!r} is a folder. Pass the robot file in it{_offer(_robot_files(path))}.")
        if not path.exists():
            raise NotFoundError(f"no file {clipped!r}. {_similar(path)}{_hint_on_names(path)}")
        if path.is_file():
            _check_size(path.stat().st_size, repr(name))
        return read_bytes(path, MAX_BYTES)


def _check_size(size: int, name: str) -> None:
    if size > MAX_BYTES:
        raise RobotFileError(
            f"{name} has {printed(size / 2**20, 3)} MiB; robot files of more than {MAX_BYTES // 2**20} MiB are refused. "
            "Is it a mesh or a log? Pass the robot description."
        )


def _similar(path: Path) -> str:
    folder = path.parent
    if not folder.is_dir():
        return f"Its folder {str(folder)!r} is not there either; check the path."
    names = sorted(entry.name for entry in folder.iterdir())
    similar = difflib.get_close_matches(path.name, names, n=3, cutoff=0.5)
    offered = similar or _robot_files(folder)
    if not offered:
        return f"There is no robot file in {str(folder)!r}; check the path."
    return f"In its folder{_offer(offered)}."


def _hint_on_names(path: Path) -> str:
    """Hint if the path is the name of a bundled robot."""
    name = path.stem.lower()
    if name.isidentifier() and (_BUNDLED_ROBOTS / f"{name}.urdf").is_file():
        return f" A robot of that name is bundled: twistwrench.robots.{name}()."
    # A single word is a name rather than a path.
    if str(path) == path.stem:
        return f" Robots are found by name with twistwrench.find({path.name!r})."
    return ""


def _robot_files(folder: Path) -> list[str]:
    kinds = (".urdf", ".xml", ".sdf", ".xacro", ".usd", ".usda", ".usdc")
    return sorted(entry.name for entry in folder.iterdir() if entry.suffix.lower() in kinds)


_MAX_OFFERED_NAMES = 12
"""Largest number of file names in a message."""


def _offer(names: list[str]) -> str:
    if not names:
        return ""
    ending = ", …" if len(names) > _MAX_OFFERED_NAMES else ""
    return f": {', '.join(names[:_MAX_OFFERED_NAMES])}{ending}"


def decode_text(data: bytes, name: str) -> str:
    """Decode by byte order mark, XML declaration, or UTF-8, in this order."""
    declared = DECLARED_ENCODING.match(data.removeprefix(b"\xef\xbb\xbf"))
    if data.startswith(b"\xef\xbb\xbf"):
        encoding = "utf-8-sig"
    elif data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    else:
        encoding = declared[1].decode("ascii") if declared else "utf-8"
    unknown = f"{name}: declares the encoding {encoding!r}, which is not known. Save the file as UTF-8."
    with third_party_errors(lambda reason: RobotFileError(f"{name}: cannot be read as {encoding} text: {reason}.")):
        try:
            if codecs.lookup(encoding).name.replace("-", "_") in _NO_ENCODINGS:
                raise RobotFileError(unknown)
            return data.decode(encoding)
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            raise RobotFileError(
                f"{name}: line {line} has a byte that is not {encoding} text. Save the file as UTF-8, or declare its "
                'encoding in the first line: <?xml version="1.0" encoding="latin-1"?>.'
            ) from None
        except LookupError:
            raise RobotFileError(unknown) from None


_PACKAGES = ("package://", "model://")
_PACKAGE_FILES = ("package.xml", "manifest.xml")


def find_resource(uri: str, robot_file: Path) -> Path | None:
    """Path of ``uri`` in ``robot_file``, or None if it is not found.

    Packages are searched in the folders above the robot file, then in ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``. Other
    names, those of ``file://`` too, are read below the package around the robot file, and without one below the folder above
    the robot's. Files elsewhere, files without the suffix of a mesh, and remote files (http://) count as not found.
    """
    from ..mechanics.bodies.mesh_files import SUFFIXES

    try:
        for place, roots in _mesh_candidates(uri.strip(), robot_file):
            path = place.resolve()
            named_as_mesh = all(name.suffix.lower() in SUFFIXES for name in (place, path))
            inside = roots is None or any(path.is_relative_to(root) for root in roots)
            if named_as_mesh and inside and path.is_file():
                return place
    except (OSError, ValueError, RuntimeError):  # names that file systems reject; links in a circle
        return None
    return None


def _mesh_candidates(uri: str, robot_file: Path) -> Iterator[tuple[Path, Sequence[Path] | None]]:
    """Places of a mesh, each with the folders that the file has to lie below once links are resolved; None: any.

    Packages that the user names by the environment may consist of links, as those of a workspace that is built with links do.
    """
    scheme = next((s for s in _PACKAGES if uri.startswith(s)), None)
    folders_above = _folders_around(robot_file)
    if scheme is not None:
        name, _, relative = unquote(uri[len(scheme) :]).lstrip("/").partition("/")
        inside = Path(os.path.normpath(relative))
        if not relative or name in ("", ".", "..") or inside.is_absolute() or ".." in inside.parts:
            return
        for folder in folders_above:
            yield folder / name / relative, [folder]
            if folder.name == name:
                yield folder / relative, [folder]
        for folder in _ros_folders():
            yield folder / name / relative, None
    elif uri.startswith("file://"):
        yield Path(unquote(uri.removeprefix("file://"))), [_own_folder(folders_above), *_ros_folders()]
    elif "://" not in uri and uri:
        yield robot_file.parent / uri, [_own_folder(folders_above), *_ros_folders()]


def _folders_around(robot_file: Path) -> list[Path]:
    """Folders above a robot file, the nearest first, without the user's home and what is above it."""
    own, *above = robot_file.resolve().parents
    home = Path.home()
    return [own, *(folder for folder in above if folder != folder.parent and not home.is_relative_to(folder))]


def _own_folder(folders: Sequence[Path]) -> Path:
    """The package around a robot file; without one, the folder above the robot's own, which often has the meshes."""
    for folder in folders:
        if any((folder / name).is_file() for name in _PACKAGE_FILES):
            return folder
    return folders[min(1, len(folders) - 1)]


def _ros_folders() -> list[Path]:
    """Folders of packages by the environment variables of ROS."""
    packages = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders = [Path(package) for package in packages if package]
    return folders + [Path(prefix) / "share" for prefix in prefixes if prefix]
