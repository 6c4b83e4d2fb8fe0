"""MJCF as the doctor reads it: inertias as they are written, shapes of geoms."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from ..errors import RobotFileError
from ..formats.element import Element
from ..formats.inertia_entries import IN_MJCF
from ..formats.mjcf.bodies import MjcfBody, PlacedElement, survey
from ..formats.mjcf.defaults import Defaults
from ..formats.mjcf.geoms import WITHOUT_SHAPE, shape_of
from ..formats.mjcf.includes import Folders, expand
from ..formats.mjcf.inertial import full_inertia
from ..formats.mjcf.joints import joints_of, names_given
from ..formats.mjcf.placement import placement
from ..formats.mjcf.settings import Settings
from ..model.model import Model
from .described import DescribedJoint, DescribedLink, DescribedRobot, WrittenInertia
from .findings import Place
from .shapes import LinkShapes, ShapeReader, ShapeSpec


def describe_mjcf(root: Element, model: Model, reader: ShapeReader, path: Path | None) -> DescribedRobot:
    """A ``<mujoco>`` element that the loader has taken."""
    numbers = {id(element): k for k, element in enumerate(root.walk())}
    expand(root, Folders(None if path is None else path.parent), 20_000)
    settings, defaults = Settings.of(root), Defaults(root)
    bodies = survey(root, settings, defaults)
    meshes = _meshes(root, settings, defaults)
    links = {}
    for body in bodies[1:]:
        if body.name in model.link_inertias:
            links[body.name] = DescribedLink(
                body.name, body.element.line, body.element.file, _inertia(body, settings, model, numbers),
                read_shapes=partial(_shapes, body, settings, meshes, reader),
            )  # fmt: skip
    taken = names_given(bodies)
    joints = {}
    for body in bodies:
        for joint in joints_of(body, settings, taken):
            element = joint.element
            joints[joint.name] = DescribedJoint(
                joint.name, element.line, element.file, single=joint.single, child=body.name
            )
    changed = tuple(
        text for text in model.defects if " of <compiler> change " in text or text.startswith("settotalmass")
    )
    return DescribedRobot(model, "mjcf", links, joints, changed)


def _inertia(body: MjcfBody, settings: Settings, model: Model, numbers: dict[int, int]) -> WrittenInertia | None:
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
    specs = [_spec(part, settings, meshes) for part in body.geoms]
    return reader.read([spec for spec in specs if spec is not None])


def _spec(
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
