"""SDF as the doctor reads it: inertias as they are written, shapes of links."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from ..errors import RobotFileError, TwistWrenchError
from ..formats.element import Element
from ..formats.inertia_entries import ENTRIES
from ..formats.sdf.frames import unpacked
from ..formats.sdf.reader import chosen_model
from ..formats.sdf.values import held, moments, number, pose, vector, word
from ..model.model import Model
from .described import DescribedJoint, DescribedLink, DescribedRobot, WrittenInertia
from .findings import Place
from .shapes import ShapeReader, ShapeSpec

_SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}


def describe_sdf(root: Element, model: Model, reader: ShapeReader, _path: Path | None) -> DescribedRobot:
    """An ``<sdf>`` element that the loader has taken."""
    numbers = {id(element): k for k, element in enumerate(root.walk())}
    try:
        chosen, _ = chosen_model(root, None)
    except TwistWrenchError:
        chosen, _ = chosen_model(root, model.name)
    parts = unpacked(chosen)
    links = {
        name: DescribedLink(
            name,
            link.line,
            written=_inertia(link, numbers),
            assumed=_left_out(link),
            read_shapes=partial(reader.read_parts, link, _spec),
        )
        for name, link in parts.links.items()
        if name in model.link_inertias
    }
    joints = {
        name: DescribedJoint(name, joint.line, child=word(joint, "child")) for name, joint in parts.joints.items()
    }
    return DescribedRobot(model, "sdf", links, joints)


def _left_out(link: Element) -> tuple[str, ...]:
    inertial = link.child("inertial")
    return tuple(part for part in ("mass", "inertia") if inertial is None or inertial.child(part) is None)


def _inertia(link: Element, numbers: dict[int, int]) -> WrittenInertia:
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


def _spec(part: Element, role: str) -> ShapeSpec | None:
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
            return ShapeSpec("ellipsoid", tuple(held(radii).numbers("text", 3).tolist()), T, role=role)
        sizes = tuple(number(shape, name, 0.0) for name in _SIZES.get(shape.tag, ()))
        return ShapeSpec(shape.tag, sizes, T, role=role)
    except RobotFileError:  # looks that cannot be read do not stop a robot from loading
        return ShapeSpec("unknown", (), np.eye(4), role=role)
