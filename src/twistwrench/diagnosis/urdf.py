"""URDF as the doctor reads it: numbers with their places, shapes of links."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from ..errors import RobotFileError
from ..formats.element import Element
from ..formats.inertia_entries import ENTRIES, tensor_of
from ..formats.urdf import origin_of
from ..model.model import Model
from .described import DescribedJoint, DescribedLink, DescribedRobot, WrittenInertia
from .findings import Place
from .shapes import ShapeReader, ShapeSpec

_SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}
_JOINT_NUMBERS = (
    ("limit", ("lower", "upper", "velocity", "effort")),
    ("dynamics", ("damping", "friction")),
)  # fmt: skip


def describe_urdf(root: Element, model: Model, reader: ShapeReader, _path: Path | None) -> DescribedRobot:
    """A ``<robot>`` element that the loader has taken."""
    numbers = {id(element): k for k, element in enumerate(root.walk())}
    links = {}
    for link in root.all("link"):
        name = link.text("name")
        links[name] = DescribedLink(
            name, link.line, written=_inertia(link, numbers), read_shapes=partial(reader.read_parts, link, _spec)
        )
    joints = {joint.text("name"): _joint(joint, numbers) for joint in root.all("joint")}
    return DescribedRobot(model, "urdf", links, joints)


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


def _joint(joint: Element, numbers: dict[int, int]) -> DescribedJoint:
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
    return DescribedJoint(
        joint.text("name"), joint.line, single=kind in ("revolute", "continuous", "prismatic"), turns=kind == "revolute",
        numbers=found, axis=direction, places=places, child=child,
    )  # fmt: skip
