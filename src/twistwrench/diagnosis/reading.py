"""From a robot file, or a robot, to what the doctor looks at."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.files import as_path
from ..errors import ModelError, ModelWarning, RobotFileError
from ..formats import FORMATS, load_model, usd_path
from ..formats.element import Element
from ..formats.source import is_text, robot_file
from ..formats.xml_parser import parse
from ..model.model import Model
from ..robot import Robot
from .described import DescribedLink, DescribedRobot, WrittenInertia
from .mjcf import describe_mjcf
from .problems import FileProblem, problems_of
from .sdf import describe_sdf
from .shapes import ShapeReader
from .urdf import describe_urdf

MOST_BODIES = 2_000
"""Links or bodies that are looked at unless ``max_bodies`` says otherwise: every one takes some milliseconds."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot to look at, and the text of its file."""

    robot: DescribedRobot
    text: str = ""
    """Empty for a robot that has no file."""
    path: Path | None = None
    data: bytes = b""
    """Of the file, as it was read."""
    floating_base: bool | None = None
    model: str | None = None
    """Which one of an SDF world."""


def read_subject(
    source: str | Path | Robot,
    *,
    meshes: bool | Sequence[str | Path] = True,
    floating_base: bool | None = None,
    model: str | None = None,
    max_bodies: int = MOST_BODIES,
) -> Subject:
    """The file read leniently: impossible bodies are accepted, remarks are kept for the checks.

    Raises :class:`~twistwrench.NotFoundError` and :class:`~twistwrench.ModelError` for what is no robot at all.
    """
    of = source.model.name if isinstance(source, Robot) else None
    if isinstance(source, Robot):
        path = Path(source.model.source) if source.model.source else None
        if path is None or not path.is_file() or usd_path(path) is not None:
            return Subject(_without_file(source.model))
        floating_base = (source.model.base_inertia.mass == 0 and "root_joint" in source.model.joint_names) or None
        source = path
    path = None if is_text(source) else as_path(source)
    if path is not None and usd_path(path) is not None:
        raise RobotFileError(
            f"{path} is USD, whose files are not examined. Examine the robot, twistwrench.doctor(twistwrench.load(path)), or "
            "the URDF that `twistwrench convert` makes of it."
        )
    data, text = b"", str(source)
    if path is not None:
        data, text = robot_file(path)
    given = text if path is None or not path.is_file() else source
    if of is not None:
        model = _model_of(text, of)
    problems: list[FileProblem] = []
    try:
        made = _loaded(given, floating_base, "follow", model, max_bodies)
    except ModelError as error:
        problems = _problems(text)
        if not problems:
            raise
        if any(not problem.mimic for problem in problems):
            raise type(error)(_together(str(error), problems)) from None
        made = _loaded(given, floating_base, "independent", model, max_bodies)
    root = parse(text)
    folders = [Path(folder) for folder in meshes] if not isinstance(meshes, bool) else []
    shapes = ShapeReader(path, folders, meshes is not False)
    described = replace(_DESCRIBE[_format(root)](root, made, shapes, path), problems=tuple(problems))
    return Subject(described, text, path, data, floating_base, model)


def _model_of(text: str, name: str) -> str | None:
    """The model of an SDF file with several, that a robot was read from by its name."""
    root = parse(text)
    models = [one for place in (root, *root.all("world")) for one in place.all("model")]
    return name if len(models) > 1 and name in [one.text("name") for one in models] else None


def _loaded(source: str | Path, floating_base: bool | None, mimic: str, model: str | None, max_bodies: int) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load_model(
            source, inertia="accept", floating_base=floating_base, mimic=mimic, model=model, max_bodies=max_bodies
        )


def _problems(text: str) -> list[FileProblem]:
    try:
        return problems_of(parse(text, max_bodies=MOST_BODIES))
    except ModelError:
        return []


def _together(first: str, problems: Sequence[FileProblem]) -> str:
    """The loader's error, which is the first, and what else it would have said."""
    others = [str(problem) for problem in problems if f"line {problem.line})" not in first]
    return first if not others else f"{first.rstrip('.')}. Besides: {' '.join(others)}"


_DESCRIBE = {"urdf": describe_urdf, "mjcf": describe_mjcf, "sdf": describe_sdf}


def _format(root: Element) -> str:
    return next(name for name, tag in FORMATS.items() if root.tag == tag)


def _without_file(model: Model) -> DescribedRobot:
    links = {name: DescribedLink(name, 0, written=_as_written(G)) for name, G in model.link_inertias.items()}
    return DescribedRobot(model, "", links)


def _as_written(G: SpatialInertia) -> WrittenInertia | None:
    if not G.parameters.any():
        return None
    return WrittenInertia(G.mass, G.com, np.eye(3), 0.5 * (G.moment_about_com + G.moment_about_com.T))
