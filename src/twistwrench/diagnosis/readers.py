"""Readers of the doctor: URDF, SDF and MJCF with the places of their numbers, and the choice between them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.files import as_path
from ..errors import ModelError, ModelWarning, RobotFileError
from ..formats import FORMATS, load_model, usd_path
from ..formats.element import Element
from ..formats.mjcf.bodies import WITHOUT_SHAPE, MjcfBody, PlacedElement, placement, shape_of
from ..formats.mjcf.preprocess import Defaults, Settings
from ..formats.robot_text import TEXTS, MjcfText, WrittenInertia
from ..formats.sdf import pose, with_text, word
from ..formats.source import is_text, robot_file
from ..formats.urdf import origin_of
from ..formats.xml import parse
from ..model.model import Model
from ..robot import Robot
from .parsed_file import LoadError, ParsedFile, ParsedLink, load_errors
from .shapes import LinkShapes, ShapeReader, ShapeSpec

_SIZES = {
    "box": (("size", 3),), "sphere": (("radius", 1),), "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)), "ellipsoid": (("radii", 3),),
}  # fmt: skip
"""Numbers of shapes in URDF, where they are attributes, and SDF, where they are elements."""


def _parsed(root: Element, model: Model, reader: ShapeReader, path: Path | None) -> ParsedFile:
    """The links and joints of a root element that the loader accepts."""
    form = next(name for name, tag in FORMATS.items() if root.tag == tag)
    text = TEXTS[form](root, model.name, path)
    meshes = _meshes(root, text.settings, text.defaults) if isinstance(text, MjcfText) else {}
    links = {}
    for name, element in text.links.items():
        if name in model.link_inertias:
            written = text.inertia(name)
            if isinstance(text, MjcfText):
                written = _compiled(written, model.link_inertias[name], element)
                shapes = partial(_mjcf_shapes, text.bodies[name], text.settings, meshes, reader)
            else:
                shapes = partial(reader.read_parts, element, partial(_shape, in_elements=form == "sdf"))
            links[name] = ParsedLink(name, element.line, element.file, written, text.assumed(name), shapes)
    changed = (
        ()
        if form != "mjcf"
        else tuple(
            text for text in model.defects if " of <compiler> change " in text or text.startswith("settotalmass")
        )
    )
    return ParsedFile(model, form, links, text.joints, changed)


def _compiled(written: WrittenInertia | None, final: SpatialInertia, body: Element) -> WrittenInertia | None:
    """The inertia as written if it is the loader's, else the loader's, from geoms and settings of the compiler."""
    if written is not None and np.allclose(written.inertia.parameters, final.parameters, rtol=1e-9, atol=1e-12):
        return written
    return WrittenInertia.from_inertia(final, body.line, body.file)


def _shape(part: Element, role: str, *, in_elements: bool) -> ShapeSpec | None:
    """The shape of a ``<visual>`` or ``<collision>`` of URDF or SDF; None without a geometry."""
    try:
        geometry = part.child("geometry")
        if geometry is None or not geometry.children or (in_elements and geometry.children[0].tag == "plane"):
            return None
        shape, at = geometry.children[0], part.child("pose") if in_elements else None
        if at is not None and at.attributes.get("relative_to", "").strip():
            return ShapeSpec("unknown", (), np.eye(4), role=role)
        T = pose(at) if in_elements else origin_of(part)
        if shape.tag == "mesh":
            given = shape.child("scale") is not None if in_elements else "scale" in shape.attributes
            scale = _numbers(shape, "scale", 3, in_elements) if given else [1.0, 1.0, 1.0]
            return ShapeSpec(
                "mesh", tuple(scale), T, word(shape, "uri") if in_elements else shape.text("filename"), role
            )
        sizes = [x for name, count in _SIZES.get(shape.tag, ()) for x in _numbers(shape, name, count, in_elements)]
        return ShapeSpec(shape.tag, tuple(sizes), T, role=role)
    except RobotFileError:  # visuals that cannot be read do not stop a robot from loading
        return ShapeSpec("unknown", (), np.eye(4), role=role)


def _numbers(shape: Element, name: str, count: int, in_elements: bool) -> list[float]:
    if in_elements:
        return with_text(shape.required(name, f"<{name}>")).values("text", count)
    return shape.values(name, count)


def _meshes(root: Element, settings: Settings, defaults: Defaults) -> dict[str, tuple[str, tuple[float, ...]]]:
    """The file and the scale of each mesh by its name."""
    found = {}
    folder = settings.mesh_folder.replace("\\", "/").rstrip("/")
    for asset in root.all("asset"):
        for mesh in map(defaults.apply, asset.all("mesh")):
            file = mesh.attributes.get("file", "").strip().replace("\\", "/")
            name = mesh.attributes.get("name", "").strip() or Path(file).stem
            file = file.rpartition("/")[2] if settings.plain_names else file
            scale = tuple(mesh.floats("scale", (1.0, 1.0, 1.0)))
            found[name] = (f"{folder}/{file}" if folder and file else file), scale
    return found


def _mjcf_shapes(
    body: MjcfBody, settings: Settings, meshes: dict[str, tuple[str, tuple[float, ...]]], reader: ShapeReader
) -> LinkShapes:
    specs = [_mjcf_shape(part, settings, meshes) for part in body.geoms]
    return reader.read([spec for spec in specs if spec is not None])


def _mjcf_shape(
    part: PlacedElement, settings: Settings, meshes: dict[str, tuple[str, tuple[float, ...]]]
) -> ShapeSpec | None:
    geom = part.element
    kind = geom.attributes.get("type", "sphere").strip()
    if kind in WITHOUT_SHAPE:
        return None
    try:
        if "mesh" in geom.attributes:
            file, scale = meshes.get(geom.text("mesh"), ("", (1.0, 1.0, 1.0)))
            # MuJoCo moves a mesh to its centre of mass and back: in the body it is where its own frame is placed.
            known = "mesh" if kind == "mesh" else "fitted"
            return ShapeSpec(known, scale, part.frame @ placement(geom, settings), file)
        T, half = shape_of(geom, kind, settings)
    except RobotFileError:
        return ShapeSpec("unknown", (), np.eye(4))
    sizes = list(half)
    if kind in ("box", "capsule", "cylinder"):
        sizes = [2.0 * x for x in half] if kind == "box" else [half[0], 2.0 * half[1]]
    return ShapeSpec(kind, tuple(sizes), part.frame @ T, role="collision")


# ── From a file or a robot to the subject of the checks

MOST_BODIES = 2_000
"""Links or bodies that are looked at unless ``max_bodies`` says otherwise: every one takes some milliseconds."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot to look at, and the text of its file."""

    robot: ParsedFile
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
            links = {
                name: ParsedLink(name, 0, written=WrittenInertia.from_inertia(G))
                for name, G in source.model.link_inertias.items()
            }
            return Subject(ParsedFile(source.model, "", links))
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
    problems: list[LoadError] = []
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
    parsed = replace(_parsed(root, made, shapes, path), load_errors=tuple(problems))
    return Subject(parsed, text, path, data, floating_base, model)


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


def _problems(text: str) -> list[LoadError]:
    try:
        return load_errors(parse(text, max_bodies=MOST_BODIES))
    except ModelError:
        return []


def _together(first: str, problems: Sequence[LoadError]) -> str:
    """The loader's error, which is the first, and what else it would have said."""
    others = [str(problem) for problem in problems if f"line {problem.line})" not in first]
    return first if not others else f"{first.rstrip('.')}. Besides: {' '.join(others)}"
