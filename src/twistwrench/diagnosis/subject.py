"""Subject of the doctor: a robot file or a robot, read for the checks."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ..core.errors import ModelError, ModelWarning, RobotFileError
from ..core.files import as_path
from ..core.text import bounded_message
from ..formats import load_model, usd_path
from ..formats.robot_file import RobotFile, file_of
from ..formats.robot_text import WrittenInertia
from ..formats.source import is_text
from ..formats.xacro import EXPAND
from ..formats.xml import Element, parse
from ..mechanics.model.model import Model
from ..robot import Robot
from ..robot.load import is_name
from ..robots.finding import robot_file
from ..shapes.meshes import MeshFiles
from ..shapes.solids import SolidReader
from .load_errors import LoadError, load_errors
from .parsed_file import ParsedFile, ParsedLink, parse_elements

MOST_BODIES = 2_000
"""Default of ``max_bodies``; the check of a link takes some milliseconds."""


@dataclass(frozen=True, eq=False)
class Subject:
    """Robot to be checked, with the text of its file."""

    robot: ParsedFile
    """Links and model, for the checks."""
    text: str = ""
    """Text of the file; empty for a robot without a file."""
    path: Path | None = None
    """Path of the file; None for a text and for a robot without a file."""
    data: bytes = b""
    """Bytes of the file; empty for a text and for a robot without a file."""
    root: Element | None = None
    """Root element of the file; None for a robot without a file."""
    floating_base: bool | None = None
    """Option of the loader; None: as the file has it."""
    model: str | None = None
    """Name of the model in an SDF world; None for the only model."""


def read_subject(
    source: str | Path | Robot,
    *,
    meshes: bool | Sequence[str | Path] = True,
    floating_base: bool | None = None,
    model: str | None = None,
    max_bodies: int = MOST_BODIES,
) -> Subject:
    """Read a file, accepting impossible inertias; raises NotFoundError, and ModelError if it is not a robot."""
    robot_name = None
    if isinstance(source, Robot):
        known_file = file_of(source.model)
        if known_file is None or known_file.xacro:
            return Subject(_parse_model(source.model))
        robot_name = source.model.name
        has_floating_base = source.model.base_inertia.mass == 0 and "root_joint" in source.model.joint_names
        floating_base = True if has_floating_base else None  # None: as the file has it
        source = known_file
    if is_name(source):
        source = robot_file(str(source))
    path: Path | None = None
    file: RobotFile | None = None
    text = str(source)  # if it is XML text
    if not is_text(source):
        path = as_path(source)
        file = _readable_file(source, path)
        text = file.text
        if robot_name is not None:
            model = _model_in_world(file.root, robot_name)
    content = text if file is None else file
    loaded_model, errors = _load_with_errors(content, floating_base, model, max_bodies)
    if file is None:
        root = parse(text, max_bodies=max_bodies)
        data = b""
    else:
        root = file.root
        data = file.data
    parsed_file = parse_elements(root, loaded_model, _solid_reader(path, meshes), path)
    parsed_file = replace(parsed_file, load_errors=tuple(errors))
    return Subject(parsed_file, text, path, data, root, floating_base, model)


def _parse_model(model: Model) -> ParsedFile:
    """Model of a robot without a file, and its links as if read from a file."""
    links = {}
    for name, inertia in model.link_inertias.items():
        links[name] = ParsedLink(name, 0, written=WrittenInertia.from_inertia(inertia))  # 0: no line
    return ParsedFile(model, "", links)


def _readable_file(source: str | Path, path: Path) -> RobotFile:
    """File with its bytes read. Raises RobotFileError for USD and xacro, whose files are not examined."""
    if usd_path(path) is not None:
        raise RobotFileError(
            f"{path} is USD, whose files are not examined. Examine the robot, twistwrench.doctor(twistwrench.load(path)), or "
            "the URDF that `twistwrench convert` makes of it."
        )
    file = RobotFile.from_path(source)
    if file.xacro:
        raise RobotFileError(
            f"{path}: {file.xacro}, and xacro files are not examined. Examine what {EXPAND} makes of it, or the robot: "
            "twistwrench.doctor(twistwrench.load(path))."
        )
    return file


def _solid_reader(path: Path | None, meshes: bool | Sequence[str | Path]) -> SolidReader:
    """Reader of shapes, with mesh files of the given folders; without mesh files if ``meshes`` is False."""
    if meshes is False:
        return SolidReader(None)
    folders = [] if meshes is True else [Path(folder) for folder in meshes]
    return SolidReader(MeshFiles(path, folders))


def _load_with_errors(
    content: str, floating_base: bool | None, model: str | None, max_bodies: int
) -> tuple[Model, list[LoadError]]:
    """Model of a file or a text, and its load errors if all are mimic joints without a leader.

    Other load errors are raised together, as one error.
    """
    load = partial(_load_quietly, content, floating_base=floating_base, model=model, max_bodies=max_bodies)
    try:
        return load(mimic="follow"), []
    except ModelError as first_error:
        errors = _load_errors_of(content, max_bodies)
        if not errors:
            raise
        if not all(error.mimic for error in errors):
            message = _message_with_others(str(first_error), errors)
            raise type(first_error)(bounded_message(message)) from None
    return load(mimic="independent"), errors


def _load_errors_of(content: str, max_bodies: int) -> list[LoadError]:
    """All load errors of a file or a text; empty if it cannot be parsed."""
    try:
        if isinstance(content, RobotFile):
            return load_errors(content.parse_root(max_bodies))
        return load_errors(parse(content, max_bodies=max_bodies))
    except ModelError:
        return []


def _load_quietly(content: str, *, floating_base: bool | None, mimic: str, model: str | None, max_bodies: int) -> Model:
    """Model of a file or a text, without warnings; impossible inertias are accepted."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load_model(
            content, inertia="accept", floating_base=floating_base, mimic=mimic, model=model, max_bodies=max_bodies
        )


_MAX_OTHER_ERRORS = 12
"""Largest number of listed errors beside the first one."""


def _message_with_others(first_message: str, errors: Sequence[LoadError]) -> str:
    """Message of the loader's error, with the texts of the errors whose line and text it does not have."""
    line_of_text = {str(error): f"line {error.line})" for error in errors}
    other_texts = []
    for text, line in line_of_text.items():
        if line not in first_message and text.rstrip(".") not in first_message:
            other_texts.append(text)
    if not other_texts:
        return first_message
    message = f"{first_message.rstrip('.')}. Besides: {' '.join(other_texts[:_MAX_OTHER_ERRORS])}"
    if len(other_texts) > _MAX_OTHER_ERRORS:
        message += f" And {len(other_texts) - _MAX_OTHER_ERRORS} more."
    return message


def _model_in_world(root: Element, name: str) -> str | None:
    """The robot's name if an SDF file has several models and one of this name; None otherwise."""
    models = root.all("model")
    for world in root.all("world"):
        models = [*models, *world.all("model")]
    if len(models) < 2:
        return None
    model_names = [model.text("name") for model in models]
    return name if name in model_names else None
