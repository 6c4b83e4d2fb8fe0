"""Sources of robot descriptions: files, text or standard input, and the mesh files that they name."""

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
"""Folder of the bundled robots."""
_BLANKS = "\ufeff \t\r\n"
"""Characters that may stand before XML: byte order mark and white space."""
_MAX_NAME_LENGTH = 200
"""Largest number of characters of a path in a message."""
_MAX_SIMILAR_NAMES = 3
"""Largest number of similar file names in a message."""
_MIN_SIMILARITY = 0.5
"""Least similarity of two names, from 0 to 1, as :mod:`difflib` measures it."""
_REJECTED_ENCODINGS = {"idna", "punycode", "undefined", "unicode_escape", "raw_unicode_escape"}
"""Python encodings that XML files do not use."""
_UTF8_MARK = b"\xef\xbb\xbf"
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
"""Byte order marks of UTF-16, little and big endian."""

DECLARED_ENCODING = re.compile(rb"""^\s*<\?xml[^>]*?\sencoding\s*=\s*["']([A-Za-z0-9._:-]+)["']""")
"""XML declaration at the beginning of a file; its group is the encoding."""


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
    if isinstance(source, str) and (not source.strip() or "\n" in source):  # no path is blank or has several lines
        raise RobotFileError(
            f"the text given is neither XML nor a path: {_beginning_text(source)}. XML text begins with '<'."
        )
    return Path(source)


def is_text(source: object) -> bool:
    """True for XML text: its first non-blank character is "<"."""
    return isinstance(source, str) and source.lstrip(_BLANKS).startswith("<")


def standard_input_text() -> str:
    """Robot description from standard input. Raises :class:`~twistwrench.RobotFileError`."""
    with third_party_errors(lambda reason: RobotFileError(f"cannot read standard input: {reason}.")):
        text = decode_text(read_standard_input(MAX_BYTES), "standard input")
    if not is_text(text):
        raise RobotFileError(f"standard input is no XML: {_beginning_text(text)}. XML text begins with '<'.")
    return text


def _beginning_text(text: str) -> str:
    """Clause with the first 20 characters of a text, for messages."""
    stripped = text.strip()
    return f"it begins with {stripped[:20]!r}" if stripped else "it is empty"


def bytes_of(path: Path) -> bytes:
    """Content of a file; raises the errors of :func:`read_robot_text`."""
    name = str(path)
    short_name = name
    if len(name) > _MAX_NAME_LENGTH:
        short_name = name[:_MAX_NAME_LENGTH] + "…"
    # File systems reject a name that is too long or has a NUL; it is probably text that was meant to be XML.
    advice = "Pass a path, or XML text that begins with '<'."
    with third_party_errors(lambda reason: RobotFileError(f"cannot read {short_name!r}: {reason}. {advice}")):
        if path.is_dir():
            file_names = _names_text(_robot_file_names(path))
            raise RobotFileError(f"{short_name!r} is a folder. Pass the robot file in it{file_names}.")
        if not path.exists():
            raise NotFoundError(f"no file {short_name!r}. {_similar_files_text(path)}{_bundled_robot_hint(path)}")
        if path.is_file():
            _check_size(path.stat().st_size, repr(name))
        return read_bytes(path, MAX_BYTES)


def _check_size(size: int, name: str) -> None:
    """Raise RobotFileError for a size above the limit [bytes]."""
    if size > MAX_BYTES:
        raise RobotFileError(
            f"{name} has {printed(size / 2**20, 3)} MiB; robot files of more than {MAX_BYTES // 2**20} MiB are refused. "
            "Is it a mesh or a log? Pass the robot description."
        )


def _similar_files_text(path: Path) -> str:
    """Sentence with similar file names in the folder of a missing file, or else with the robot files of this folder."""
    folder = path.parent
    if not folder.is_dir():
        return f"Its folder {str(folder)!r} is not there either; check the path."
    names = sorted(entry.name for entry in folder.iterdir())
    similar_names = difflib.get_close_matches(path.name, names, n=_MAX_SIMILAR_NAMES, cutoff=_MIN_SIMILARITY)
    proposals = similar_names or _robot_file_names(folder)
    if not proposals:
        return f"There is no robot file in {str(folder)!r}; check the path."
    return f"In its folder{_names_text(proposals)}."


def _bundled_robot_hint(path: Path) -> str:
    """Sentence with the call for a bundled robot of that name, or for the search by name; empty for other paths."""
    name = path.stem.lower()
    is_bundled = name.isidentifier() and (_BUNDLED_ROBOTS / f"{name}.urdf").is_file()
    if is_bundled:
        return f" A robot of that name is bundled: twistwrench.robots.{name}()."
    is_single_word = str(path) == path.stem  # a name rather than a path
    if is_single_word:
        return f" Robots are found by name with twistwrench.find({path.name!r})."
    return ""


def _robot_file_names(folder: Path) -> list[str]:
    """Names of the files in a folder that can be robots, by their suffix."""
    suffixes = (".urdf", ".xml", ".sdf", ".xacro", ".usd", ".usda", ".usdc")
    return sorted(entry.name for entry in folder.iterdir() if entry.suffix.lower() in suffixes)


_MAX_OFFERED_NAMES = 12
"""Largest number of file names in a message."""


def _names_text(names: list[str]) -> str:
    """A colon and the first names, for the end of a clause; empty without names."""
    if not names:
        return ""
    ending = ", …" if len(names) > _MAX_OFFERED_NAMES else ""
    return f": {', '.join(names[:_MAX_OFFERED_NAMES])}{ending}"


def decode_text(data: bytes, name: str) -> str:
    """Text of a file, decoded by its byte order mark, by its XML declaration, or as UTF-8, in this order."""
    declaration = DECLARED_ENCODING.match(data)
    if data.startswith(_UTF8_MARK):
        encoding = "utf-8-sig"
    elif data.startswith(_UTF16_MARKS):
        encoding = "utf-16"
    elif declaration:
        encoding = declaration[1].decode("ascii")
    else:
        encoding = "utf-8"
    unknown_encoding = f"{name}: declares the encoding {encoding!r}, which is not known. Save the file as UTF-8."
    with third_party_errors(lambda reason: RobotFileError(f"{name}: cannot be read as {encoding} text: {reason}.")):
        try:
            encoding_name = codecs.lookup(encoding).name
            if encoding_name.replace("-", "_") in _REJECTED_ENCODINGS:
                raise RobotFileError(unknown_encoding)
            return data.decode(encoding)
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            raise RobotFileError(
                f"{name}: line {line} has a byte that is not {encoding} text. Save the file as UTF-8, or declare its "
                'encoding in the first line: <?xml version="1.0" encoding="latin-1"?>.'
            ) from None
        except LookupError:
            raise RobotFileError(unknown_encoding) from None


_PACKAGE_SCHEMES = ("package://", "model://")
"""Schemes of names whose first part is a package, in ROS and in Gazebo."""
_PACKAGE_FILES = ("package.xml", "manifest.xml")
"""Files that mark the folder of a package: of catkin and ament, and of rosbuild."""


def find_resource(uri: str, robot_file: Path) -> Path | None:
    """Path of the mesh that ``robot_file`` names by ``uri``, or None if it is not found.

    Packages are searched in the folders above the robot file, then in ``ROS_PACKAGE_PATH`` and ``AMENT_PREFIX_PATH``. Meshes of
    other names, also with ``file://``, must lie in the package around the robot file. If there is no package, they must lie
    below the parent of the robot's folder. Files elsewhere, files without the suffix of a mesh, and remote files (http://)
    count as not found.
    """
    from ..mechanics.bodies.mesh_files import SUFFIXES

    try:
        for candidate, roots in _mesh_candidates(uri.strip(), robot_file):
            target = candidate.resolve()  # where symbolic links lead
            has_mesh_suffix = all(path.suffix.lower() in SUFFIXES for path in (candidate, target))
            is_allowed = roots is None or any(target.is_relative_to(root) for root in roots)
            if has_mesh_suffix and is_allowed and target.is_file():
                return candidate
    except (OSError, ValueError, RuntimeError):  # names that file systems reject; links in a circle
        return None
    return None


def _mesh_candidates(uri: str, robot_file: Path) -> Iterator[tuple[Path, Sequence[Path] | None]]:
    """Paths that a mesh may have, each with folders: its target must lie in one of them once symbolic links are resolved.

    None in place of the folders allows any target: packages that the user names by the environment may consist of links. A
    ROS workspace can be built in this way.
    """
    scheme = next((s for s in _PACKAGE_SCHEMES if uri.startswith(s)), None)
    folders_above = _folders_around(robot_file)
    if scheme is not None:
        path = unquote(uri[len(scheme) :]).lstrip("/")
        package, _, path_in_package = path.partition("/")
        normal_path = Path(os.path.normpath(path_in_package))
        leaves_package = normal_path.is_absolute() or ".." in normal_path.parts
        if not path_in_package or package in ("", ".", "..") or leaves_package:
            return
        for folder in folders_above:
            yield folder / package / path_in_package, [folder]
            if folder.name == package:
                yield folder / path_in_package, [folder]
        for folder in _ros_folders():
            yield folder / package / path_in_package, None
    elif uri.startswith("file://"):
        yield Path(unquote(uri.removeprefix("file://"))), [_package_folder(folders_above), *_ros_folders()]
    elif "://" not in uri and uri:
        yield robot_file.parent / uri, [_package_folder(folders_above), *_ros_folders()]


def _folders_around(robot_file: Path) -> list[Path]:
    """Folders above a robot file, the nearest first, except the root, the user's home and folders above home."""
    own_folder, *folders_above = robot_file.resolve().parents
    home = Path.home()
    allowed = [folder for folder in folders_above if folder != folder.parent and not home.is_relative_to(folder)]
    return [own_folder, *allowed]


def _package_folder(folders: Sequence[Path]) -> Path:
    """Folder of the package around a robot file; without a package, the parent of the robot's folder, which often has meshes.

    ``folders`` are the result of :func:`_folders_around`. If the parent is not among them, it is the robot's own folder.
    """
    for folder in folders:
        if any((folder / name).is_file() for name in _PACKAGE_FILES):
            return folder
    own_folder, *folders_above = folders
    if folders_above:
        return folders_above[0]
    return own_folder


def _ros_folders() -> list[Path]:
    """Folders of packages by the environment variables of ROS."""
    packages = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders = [Path(package) for package in packages if package]
    return folders + [Path(prefix) / "share" for prefix in prefixes if prefix]
