"""Shapes of links as URDF, SDF and MJCF files describe them; those of USD files are not read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ..core.errors import RobotFileError
from ..core.typing import Array
from ..formats.mjcf.bodies import WITHOUT_SHAPE, PlacedElement, placement, shape_of
from ..formats.robot_file import file_of
from ..formats.robot_text import MjcfText, RobotText, UrdfText, text_of
from ..formats.sdf import pose, with_text, word
from ..formats.urdf import origin_of
from ..formats.xml import CONTENT, Element
from ..mechanics.lie.identity import IDENTITY
from ..mechanics.model.model import Model
from .surface import Colour

Role = Literal["visual", "collision"]

_SIZE_NAMES = {
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "ellipsoid": (("radii", 3),),
}
"""Names of the sizes of each kind of shape, with their numbers of values. They are attributes in URDF, elements in SDF."""
_URDF_KINDS = ("box", "sphere", "cylinder", "capsule", "mesh")
"""Shapes that URDF defines."""
_GEOMETRY = '<geometry><box size="1 1 1"/></geometry>'
"""Example for the message about a missing geometry."""
_NO_SCALE = [1.0, 1.0, 1.0]
"""Factors along x, y and z of a mesh without ``scale``."""


@dataclass(frozen=True, eq=False)
class ShapeSpec:
    """Shape as described in a file."""

    kind: str
    """box, sphere, cylinder, capsule, ellipsoid, mesh, fitted (a primitive fitted to a mesh), or another name of a file.

    It is unknown if the shape cannot be read, and empty without a geometry.
    """
    sizes: tuple[float, ...]
    """Edges of a box, radius of a sphere, radius and length, semi-axes of an ellipsoid [m]; factors (3,) of a mesh."""
    pose: Array
    """Pose (4, 4) in the link's frame."""
    mesh: str = ""
    """File name of a mesh, as in the robot file."""
    role: Role = "visual"
    colour: Colour | None = None
    element: str = ""
    """Element of the file, for messages."""
    problem: str = ""
    """Reason why the shape cannot be drawn as described; empty if it can."""


@dataclass(frozen=True, eq=False)
class LinkShapes:
    """Shapes of one link."""

    link: str
    parts: tuple[ShapeSpec, ...] = ()


def read_shapes(model: Model, role: Role | None = None) -> tuple[LinkShapes, ...]:
    """Shapes of the links in the model's file, of one role or of both; empty for robots without a file, xacro and USD.

    If the model comes from another process, the file is read again, which may raise its errors.
    """
    file = file_of(model)
    if file is None or file.xacro:
        return ()
    text = text_of(file.root, model.name, Path(file))
    links = [name for name in text.links if name in model.frames]  # the model may be a part of the file
    return tuple(link_shapes(text, link, role) for link in links)


def link_shapes(text: RobotText, link: str, role: Role | None = None) -> LinkShapes:
    """Shapes of one link; planes, height fields and empty elements are left out."""
    if isinstance(text, MjcfText):
        shapes = _mjcf_shapes(text, link)
    else:
        shapes = _urdf_or_sdf_shapes(text, link)
    if role is not None:
        shapes = (shape for shape in shapes if shape.role == role)
    return LinkShapes(link, tuple(shapes))


def _urdf_or_sdf_shapes(text: RobotText, link: str) -> Iterator[ShapeSpec]:
    """Visuals, then collision shapes, of a link of URDF or SDF."""
    roles: tuple[Role, ...] = ("visual", "collision")
    for role in roles:
        for part in text.links[link].all(role):
            if isinstance(text, UrdfText):
                shape = _urdf_shape(part, role, text)
            else:
                shape = _sdf_shape(part, role)
            if shape is not None:
                yield shape


def _urdf_shape(part: Element, role: Role, text: UrdfText) -> ShapeSpec | None:
    """Shape of a ``<visual>`` or ``<collision>`` of URDF; None for an empty geometry."""
    try:
        geometry = part.require_child("geometry", _GEOMETRY)
        if not geometry.children:
            return None
        shape = geometry.children[0]
        mesh = ""
        sizes: list[float] = []
        for name, count in _SIZE_NAMES.get(shape.tag, ()):
            sizes += shape.values(name, count)
        if shape.tag == "mesh":
            mesh = shape.text("filename")
            if mesh:
                sizes = shape.values("scale", 3) if "scale" in shape.attributes else _NO_SCALE
        T = origin_of(part)
    except RobotFileError as error:  # not raised: a file with such a shape can be loaded
        kind = "unknown" if part.all("geometry") else ""
        return ShapeSpec(kind, (), IDENTITY, role=role, element=str(part), problem=str(error))
    if shape.tag not in _URDF_KINDS:
        problem = f"{shape} cannot be drawn"
        return ShapeSpec(shape.tag, tuple(sizes), T, role=role, element=str(shape), problem=problem)
    problem = ""
    colour: Colour | None = None
    try:
        colour = _colour(part, text)
    except RobotFileError as error:
        problem = str(error)
    return ShapeSpec(shape.tag, tuple(sizes), T, mesh, role, colour, str(part), problem)


def _colour(part: Element, text: UrdfText) -> Colour | None:
    """Colour of an element's ``<material>``, or of the robot's material of the same name."""
    material = part.child("material")
    if material is None:
        return None
    own_colour = _rgb(material)
    if own_colour is not None:
        return own_colour
    material_name = material.attributes.get("name", "")
    robot_material = text.materials.get(material_name)
    if robot_material is None:
        return None
    return _rgb(robot_material)


def _rgb(material: Element) -> Colour | None:
    """Colour that a material states; None without any, or if it cannot be read."""
    try:
        colour = material.child("color")
        if colour is None:
            return None
        rgba = colour.numbers("rgba", 4)
        r, g, b, _ = np.clip(rgba, 0.0, 1.0).tolist()
    except RobotFileError:
        return None
    return r, g, b


def _sdf_shape(part: Element, role: Role) -> ShapeSpec | None:
    """Shape of a ``<visual>`` or ``<collision>`` of SDF; None for a plane, and for a part without a geometry."""
    unknown_shape = ShapeSpec("unknown", (), IDENTITY, role=role, element=str(part))
    try:
        geometry = part.child("geometry")
        if geometry is None or not geometry.children:
            return None
        shape = geometry.children[0]
        if shape.tag == "plane":
            return None
        pose_element = part.child("pose")
        if pose_element is not None:
            other_frame = pose_element.attributes.get("relative_to", "")
            if other_frame.strip():
                return unknown_shape
        T = pose(pose_element)
        mesh = ""
        sizes: list[float] = []
        for name, count in _SIZE_NAMES.get(shape.tag, ()):
            sizes += _values(shape, name, count)
        if shape.tag == "mesh":
            mesh = word(shape, "uri")
            sizes = _values(shape, "scale", 3) if shape.child("scale") is not None else _NO_SCALE
    except RobotFileError:
        return unknown_shape
    return ShapeSpec(shape.tag, tuple(sizes), T, mesh, role, element=str(part))


def _values(shape: Element, name: str, count: int) -> list[float]:
    """Numbers in the text of the child element ``name``. Raises RobotFileError unless it holds ``count`` of them."""
    child = shape.require_child(name, f"<{name}>")
    return with_text(child).values(CONTENT, count)


def _mjcf_shapes(text: MjcfText, body: str) -> Iterator[ShapeSpec]:
    """Shapes of the geoms of a body."""
    for part in text.bodies[body].geoms:
        kind = part.element.attributes.get("type", "sphere").strip()
        if kind not in WITHOUT_SHAPE:
            yield _mjcf_shape(part, kind, text)


def _mjcf_shape(part: PlacedElement, kind: str, text: MjcfText) -> ShapeSpec:
    """Shape of a geom: a visual if it is a mesh or cannot be read, otherwise a collision shape."""
    geom = part.element
    try:
        if "mesh" in geom.attributes:
            file, scale = text.meshes.file_and_scale(geom.text("mesh"))
            # MuJoCo moves a mesh to its centre of mass and back, so the mesh's frame is that of the geom.
            mesh_pose = part.frame @ placement(geom, text.settings)
            kind_of_mesh = "mesh" if kind == "mesh" else "fitted"  # a primitive fitted to the mesh
            return ShapeSpec(kind_of_mesh, scale, mesh_pose, file)
        T, half_sizes = shape_of(geom, kind, text.settings)
    except RobotFileError:
        return ShapeSpec("unknown", (), IDENTITY)
    if kind == "box":
        sizes = [2.0 * half_edge for half_edge in half_sizes]
    elif kind in ("capsule", "cylinder"):
        radius, half_length = half_sizes[0], half_sizes[1]
        sizes = [radius, 2.0 * half_length]
    else:
        sizes = list(half_sizes)  # of a sphere or an ellipsoid, radii
    return ShapeSpec(kind, tuple(sizes), part.frame @ T, role="collision")
