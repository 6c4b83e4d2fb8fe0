"""xacro, a macro language for robot files: detection of macros, and expansion in a process of its own."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ...core.errors import MissingExtraError, RobotFileError, UnknownNameError, ValueRangeError
from ...core.text import Argument, listed, shorten, spell
from ..known_elements import KNOWN, READ, Entry, Rows
from ..xml import Element, parse

__all__ = ["EXPAND", "expand_xacro", "is_marked", "xacro_arguments", "xacro_in"]

ENDING = ".xacro"
"""Ending of the names of files that are expanded without a request."""
EXPAND = "`xacro file.xacro > robot.urdf`"
"""Command for expanding a xacro file."""
MAX_SECONDS = 20.0
"""Largest processor time of an expansion [s]."""
MAX_MEMORY = 2**30
"""Largest memory of an expansion [bytes]."""
MAX_BYTES = 64 * 2**20
"""Largest size of all included files, and of the expanded text [bytes]."""

_ELEMENT_PREFIX = "xacro:"
_EXPRESSION_STARTS = ("${", "$(")
"""First characters of the two kinds of expressions."""
_MAX_BYTES_PER_CHARACTER = 8
"""Bound of the size of a character of the expanded text in the child's answer, which is JSON [bytes]."""


def is_marked(text: str) -> bool:
    """True if a text could have elements or expressions of xacro."""
    return _ELEMENT_PREFIX in text or _has_expression(text)


def xacro_in(text: str, root: Element | None = None, rows: Rows = KNOWN["URDF"]) -> str:
    """Clause that names the first element of a ``<robot>`` that only xacro can read; empty if there is none.

    Such an element has the prefix ``xacro:``, or an expression in an attribute that is read. Declarations, comments and
    ignored elements do not count. ``rows`` list the elements and attributes that are read, by default those of URDF.
    """
    if not is_marked(text):
        return ""
    if root is None:
        root = parse(text)
    if root.tag != "robot":
        return ""
    stack = [(root, rows.get(root.tag, {}))]  # elements to search, with their known attributes and children
    while stack:
        element, entries = stack.pop()
        if element.tag.startswith(_ELEMENT_PREFIX):
            return f"{element} is unexpanded xacro"
        for name, value in element.attributes.items():
            is_read = entries.get(name) is READ
            if is_read and _has_expression(value):
                if name == "name":  # str(element) contains its name already
                    return f"{element} is unexpanded xacro"
                attribute = shorten(f"{name}={value!r}")
                return f"{element} is unexpanded xacro: {attribute}"
        for child in reversed(element.children):  # the stack returns the last one first
            is_read = entries.get(f"<{child.tag}>") is READ
            if is_read or child.tag.startswith(_ELEMENT_PREFIX):
                stack.append((child, _entries_of(child, element, rows)))
    return ""


def _has_expression(text: str) -> bool:
    """True if a text contains ``${…}`` or ``$(…)``."""
    return any(start in text for start in _EXPRESSION_STARTS)


def _entries_of(element: Element, parent: Element, rows: Rows) -> Mapping[str, Entry]:
    """Known attributes and children of an element, from its row under the parent's tag or else from its own row."""
    return rows.get(f"{parent.tag}/{element.tag}") or rows.get(element.tag) or {}


def xacro_arguments(arguments: Mapping[str, Any] | bool | None) -> Mapping[str, Any] | None:
    """Arguments of a xacro file as texts by name: empty for True, None if the file is not to be expanded.

    Raises ValueRangeError for other input.
    """
    if arguments is None or arguments is False:
        return None
    if arguments is True:
        return {}
    if not isinstance(arguments, Mapping):
        raise _wrong_arguments(arguments)
    texts = {}
    for name, value in arguments.items():
        if not isinstance(name, str) or not isinstance(value, str | int | float):
            raise _wrong_arguments(arguments)
        texts[name] = str(value)
        if isinstance(value, bool):  # xacro writes true and false
            texts[name] = texts[name].lower()
    return texts


def _wrong_arguments(arguments: object) -> ValueRangeError:
    """Error for arguments that are not values by name."""
    return ValueRangeError(
        f"xacro={shorten(repr(arguments))}: give the arguments by name, as xacro={{'hand': 'true'}}, or xacro=True."
    )


def expand_xacro(
    text: str, path: Path | None, arguments: Mapping[str, Any], folders: Sequence[Path], found: str
) -> str:
    """URDF text of a xacro file, expanded in another process with limits of time and memory.

    Files are read only below the file's folder and package, ``folders``, and the packages of ``ROS_PACKAGE_PATH`` and
    ``AMENT_PREFIX_PATH``. Raises MissingExtraError, UnknownNameError for undeclared arguments, and RobotFileError.
    ``found`` is the clause of :func:`xacro_in`, or empty. It begins the message of MissingExtraError.
    """
    is_installed = all(importlib.util.find_spec(package) is not None for package in ("xacrodoc", "xacro"))
    if not is_installed:
        advice = MissingExtraError.advice("xacro")
        origin = path or "the text given"
        reason = found or "it is xacro"
        raise MissingExtraError(
            f"{origin}: {reason}. Reading it needs 'xacrodoc', which is not installed: {advice}. "
            f"Or run {EXPAND} first, and load robot.urdf."
        )

    from ...core.child_process import ChildLimits, run_in_child

    limits = ChildLimits(MAX_SECONDS, MAX_MEMORY, output=_MAX_BYTES_PER_CHARACTER * MAX_BYTES)
    request = _request_to_child(text, path, arguments, folders)
    # The answer has "declared", and either "text" or the "reason" of a failure.
    answer = run_in_child(
        "twistwrench.formats.xacro.expander:expand", request, limits=limits, error_of=_expansion_error
    )
    declared = dict.fromkeys(answer["declared"])  # names of the file's arguments in their order, each once
    if "text" not in answer:
        raise _expansion_error(answer["reason"], declared)
    for name in arguments:
        if name not in declared:
            owner = path.name if path else "the text"
            raise UnknownNameError.from_choices(f"xacro argument of {owner}", name, declared)
    return str(answer["text"])


def _expansion_error(reason: str, declared: Mapping[str, None] = MappingProxyType({})) -> RobotFileError:
    """Error for a file that xacro cannot expand; ``declared`` are the names of its arguments, empty if unknown."""
    argument_sentence = ""
    if declared:
        argument_sentence = f" It declares the arguments {listed(declared)}."
    folder_option = spell(Argument("include_paths", option="include-path"))
    return RobotFileError(
        f"xacro cannot expand it: {reason}.{argument_sentence} Folders of packages that are not above the file, and of other "
        f"files that it reads, go into {folder_option} or ROS_PACKAGE_PATH."
    )


def _request_to_child(
    text: str, path: Path | None, arguments: Mapping[str, Any], folders: Sequence[Path]
) -> dict[str, Any]:
    """Request to the child process: text, arguments, and the folders below which files may be read."""
    readable_folders: list[Path] = []
    if path is not None:
        readable_folders += [path.resolve().parent, *_package_around(path)]
    readable_folders += folders
    environment = {variable: os.environ.get(variable, "") for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")}
    for value in environment.values():
        folder_names = value.split(os.pathsep)
        readable_folders += [Path(name) for name in folder_names if name]
    return {
        "text": text,
        "file": None if path is None else str(path),
        "arguments": dict(arguments),
        "include_paths": [str(folder) for folder in folders],
        "folders": [str(folder.resolve()) for folder in readable_folders],
        "bytes": MAX_BYTES,
        "environment": environment,  # a child process may be older than the value
    }


def _package_around(path: Path) -> list[Path]:
    """List of the nearest folder above a file that is a package of ROS; empty if there is none."""
    for folder in path.resolve().parents:
        if (folder / "package.xml").is_file() or (folder / "manifest.xml").is_file():
            return [folder]
    return []
