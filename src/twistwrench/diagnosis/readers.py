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
from ..errors import ModelError, ModelWarning, RobotFileError, TwistWrenchError
from ..formats import FORMATS, load_model, usd_path
from ..formats.element import Element
from ..formats.mjcf.bodies import (
    WITHOUT_SHAPE,
    MjcfBody,
    PlacedElement,
    full_inertia,
    joints_of,
    names_given,
    placement,
    shape_of,
    survey,
)
from ..formats.mjcf.preprocess import Defaults, Folders, Settings, expand
from ..formats.sdf import chosen_model, moments, number, pose, unpacked, vector, with_text, word
from ..formats.source import is_text, robot_file
from ..formats.urdf import ENTRIES, IN_MJCF, origin_of, tensor_of
from ..formats.xml import parse
from ..model.model import Model
from ..robot import Robot
from .findings import Place
from .parsed_file import LoadError, ParsedFile, ParsedJoint, ParsedLink, WrittenInertia, load_errors
from .shapes import LinkShapes, ShapeReader, ShapeSpec

_SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
_JOINT_NUMBERS = (
    ("limit", ("lower", "upper", "velocity", "effort")),
    ("dynamics", ("damping", "friction")),
)  # fmt: skip


def describe_urdf(root: Element, model: Model, reader: ShapeReader, _path: Path | None) -> ParsedFile:
    """A ``<robot>`` element that the loader has taken."""
    numbers = {id(element): k for k, element in enumerate(root.walk())}
    links = {}
    for link in root.all("link"):
        name = link.text("name")
        links[name] = ParsedLink(
            name, link.line, written=_inertia(link, numbers), read_shapes=partial(reader.read_parts, link, _spec)
        )
    joints = {joint.text("name"): _joint(joint, numbers) for joint in root.all("joint")}
    return ParsedFile(model, "urdf", links, joints)


def _inertia(link: Element, numbers: dict[int, int]) -> WrittenInertia | None:
    inertial = link.child("inertial")
    if inertial is None:
        return None
    mass = inertial.required("mass", "a mass")
    tensor = inertial.required("inertia", "an inertia")
    T = origin_of(inertial)
    places = {name: Place(numbers[id(tensor)], name) for name in ENTRIES}
    places["mass"] = Place(numbers[id(mass)], "value")
    origin = inertial.child("origin")
    if origin is not None and "xyz" in origin.attributes:
        places |= {axis: Place(numbers[id(origin)], "xyz", k) for k, axis in enumerate("xyz")}
    return WrittenInertia(mass.number("value"), T[:3, 3], T[:3, :3], tensor_of(tensor.number), places, tensor.line)


def _spec(part: Element, role: str) -> ShapeSpec | None:
    """None for what has no geometry at all."""
    try:
        geometry = part.child("geometry")
        if geometry is None or not geometry.children:
            return None
        shape, pose = geometry.children[0], origin_of(part)
        if shape.tag == "mesh":
            scale = shape.numbers("scale", 3) if "scale" in shape.attributes else np.ones(3)
            return ShapeSpec("mesh", tuple(scale.tolist()), pose, shape.text("filename"), role)
        if shape.tag == "box":
            return ShapeSpec("box", tuple(shape.numbers("size", 3).tolist()), pose, role=role)
        sizes = tuple(shape.number(name) for name in _SIZES.get(shape.tag, ()))
        return ShapeSpec(shape.tag, sizes, pose, role=role)
    except RobotFileError:  # looks that cannot be read do not stop a robot from loading
        return ShapeSpec("unknown", (), np.eye(4), role=role)


def _joint(joint: Element, numbers: dict[int, int]) -> ParsedJoint:
    found: dict[str, float] = {}
    places: dict[str, Place] = {}
    kind = joint.text("type")
    for tag, names in _JOINT_NUMBERS if kind != "fixed" else ():
        element = joint.child(tag)
        for name in names if element is not None else ():
            value = element.optional_number(name) if element is not None else None
            if element is not None and value is not None:
                found[name], places[name] = value, Place(numbers[id(element)], name)
    axis = joint.child("axis") if kind not in ("fixed", "floating") else None
    child = joint.required("child", "a child").text("link")
    direction = None if axis is None else axis.numbers("xyz", 3)
    if axis is not None:
        places["axis"] = Place(numbers[id(axis)], "xyz")
    return ParsedJoint(
        joint.text("name"), joint.line, single=kind in ("revolute", "continuous", "prismatic"), turns=kind == "revolute",
        numbers=found, axis=direction, places=places, child=child,
    )  # fmt: skip


# ── SDF

_SDF_SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}


def describe_sdf(root: Element, model: Model, reader: ShapeReader, _path: Path | None) -> ParsedFile:
    """An ``<sdf>`` element that the loader has taken."""
    numbers = {id(element): k for k, element in enumerate(root.walk())}
    try:
        chosen, _ = chosen_model(root, None)
    except TwistWrenchError:
        chosen, _ = chosen_model(root, model.name)
    parts = unpacked(chosen)
    links = {
        name: ParsedLink(
            name,
            link.line,
            written=_sdf_inertia(link, numbers),
            assumed=_left_out(link),
            read_shapes=partial(reader.read_parts, link, _sdf_shape),
        )
        for name, link in parts.links.items()
        if name in model.link_inertias
    }
    joints = {name: ParsedJoint(name, joint.line, child=word(joint, "child")) for name, joint in parts.joints.items()}
    return ParsedFile(model, "sdf", links, joints)


def _left_out(link: Element) -> tuple[str, ...]:
    inertial = link.child("inertial")
    return tuple(part for part in ("mass", "inertia") if inertial is None or inertial.child(part) is None)


def _sdf_inertia(link: Element, numbers: dict[int, int]) -> WrittenInertia:
    """Missing parts as the format has them, 1 kg and 1 kg m², without places."""
    inertial = link.child("inertial")
    tensor = inertial.child("inertia") if inertial is not None else None
    places: dict[str, Place] = {}
    for name in ENTRIES if tensor is not None else ():
        child = tensor.child(name) if tensor is not None else None
        if child is not None:
            places[name] = Place(numbers[id(child)])
    mass = inertial.child("mass") if inertial is not None else None
    if mass is not None:
        places["mass"] = Place(numbers[id(mass)])
    T = pose(inertial.child("pose") if inertial is not None else None)
    line = tensor.line if tensor is not None else link.line
    return WrittenInertia(number(inertial, "mass", 1.0), T[:3, 3], T[:3, :3], moments(tensor), places, line)


def _sdf_shape(part: Element, role: str) -> ShapeSpec | None:
    try:
        geometry = part.child("geometry")
        if geometry is None or not geometry.children or geometry.children[0].tag == "plane":
            return None
        shape, at = geometry.children[0], part.child("pose")
        if at is not None and at.attributes.get("relative_to", "").strip():
            return ShapeSpec("unknown", (), np.eye(4), role=role)
        T = pose(at)
        if shape.tag == "mesh":
            scale = shape.child("scale")
            sizes = (1.0, 1.0, 1.0) if scale is None else tuple(vector(scale).tolist())
            return ShapeSpec("mesh", sizes, T, word(shape, "uri"), role)
        if shape.tag == "box":
            return ShapeSpec("box", tuple(vector(shape.required("size", "<size>1 1 1</size>")).tolist()), T, role=role)
        if shape.tag == "ellipsoid":
            radii = shape.required("radii", "<radii>1 1 1</radii>")
            return ShapeSpec("ellipsoid", tuple(with_text(radii).numbers("text", 3).tolist()), T, role=role)
        sizes = tuple(number(shape, name, 0.0) for name in _SDF_SIZES.get(shape.tag, ()))
        return ShapeSpec(shape.tag, sizes, T, role=role)
    except RobotFileError:  # looks that cannot be read do not stop a robot from loading
        return ShapeSpec("unknown", (), np.eye(4), role=role)


# ── MJCF


def describe_mjcf(root: Element, model: Model, reader: ShapeReader, path: Path | None) -> ParsedFile:
    """A ``<mujoco>`` element that the loader has taken."""
    numbers = {id(element): k for k, element in enumerate(root.walk())}
    expand(root, Folders(None if path is None else path.parent), 20_000)
    settings, defaults = Settings.from_root(root), Defaults(root)
    bodies = survey(root, settings, defaults)
    meshes = _meshes(root, settings, defaults)
    links = {}
    for body in bodies[1:]:
        if body.name in model.link_inertias:
            links[body.name] = ParsedLink(
                body.name, body.element.line, body.element.file, _mjcf_inertia(body, settings, model, numbers),
                read_shapes=partial(_shapes, body, settings, meshes, reader),
            )  # fmt: skip
    taken = names_given(bodies)
    joints = {}
    for body in bodies:
        for joint in joints_of(body, settings, taken):
            element = joint.element
            joints[joint.name] = ParsedJoint(
                joint.name, element.line, element.file, single=joint.single, child=body.name
            )
    changed = tuple(
        text for text in model.defects if " of <compiler> change " in text or text.startswith("settotalmass")
    )
    return ParsedFile(model, "mjcf", links, joints, changed)


def _mjcf_inertia(body: MjcfBody, settings: Settings, model: Model, numbers: dict[int, int]) -> WrittenInertia | None:
    """As written where that is what counts, else what the loader made of geoms and settings."""
    final = model.link_inertias[body.name]
    if body.inertial is not None:
        element = body.inertial.element
        T = body.inertial.frame @ placement(element, settings)
        tensor, places = _tensor(element, numbers.get(id(element)) if not element.file else None)
        mass = element.number("mass")
        written = WrittenInertia(mass, T[:3, 3], T[:3, :3], tensor, places, element.line, element.file)
        if np.allclose(written.inertia.parameters, final.parameters, rtol=1e-9, atol=1e-12):
            return written
    if not final.parameters.any():
        return None
    moments = 0.5 * (final.moment_about_com + final.moment_about_com.T)
    return WrittenInertia(final.mass, final.com, np.eye(3), moments, {}, body.element.line, body.element.file)


def _tensor(element: Element, number: int | None) -> tuple[np.ndarray, dict[str, Place]]:
    places = {} if number is None else {"mass": Place(number, "mass")}
    if "diaginertia" in element.attributes:
        moments = element.numbers("diaginertia", 3)
        if number is not None:
            places |= {name: Place(number, "diaginertia", k) for k, name in enumerate(("ixx", "iyy", "izz"))}
        return np.diag(moments), places
    if "fullinertia" in element.attributes:
        if number is not None:
            places |= {name: Place(number, "fullinertia", k) for k, name in enumerate(IN_MJCF)}
        return full_inertia(element), places
    return np.zeros((3, 3)), places


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


def _shapes(
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
    described = replace(_DESCRIBE[_format(root)](root, made, shapes, path), load_errors=tuple(problems))
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


def _problems(text: str) -> list[LoadError]:
    try:
        return load_errors(parse(text, max_bodies=MOST_BODIES))
    except ModelError:
        return []


def _together(first: str, problems: Sequence[LoadError]) -> str:
    """The loader's error, which is the first, and what else it would have said."""
    others = [str(problem) for problem in problems if f"line {problem.line})" not in first]
    return first if not others else f"{first.rstrip('.')}. Besides: {' '.join(others)}"


_DESCRIBE = {"urdf": describe_urdf, "mjcf": describe_mjcf, "sdf": describe_sdf}


def _format(root: Element) -> str:
    return next(name for name, tag in FORMATS.items() if root.tag == tag)


def _without_file(model: Model) -> ParsedFile:
    links = {name: ParsedLink(name, 0, written=_as_written(G)) for name, G in model.link_inertias.items()}
    return ParsedFile(model, "", links)


def _as_written(G: SpatialInertia) -> WrittenInertia | None:
    if not G.parameters.any():
        return None
    return WrittenInertia(G.mass, G.com, np.eye(3), 0.5 * (G.moment_about_com + G.moment_about_com.T))
