"""SDFormat, the model description of Gazebo and Drake: values, frame graph, links and joints.

Source: http://sdformat.org/spec.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..core.errors import RobotFileError, UnknownNameError
from ..core.text import argument, listed
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.joints.screw_joint import screw_through
from ..mechanics.lie import quaternion, se3
from ..mechanics.model.builder import ModelBuilder
from ..mechanics.model.description import Mimic
from .known_elements import unread
from .urdf import known_limits, rotation_of_rpy, tensor_of
from .xml import Element

__all__ = ["read_sdf"]


def with_text(element: Element) -> Element:
    """Element with its text as the attribute ``text``, so that its numbers are checked like attributes."""
    return element.with_attributes({**element.attributes, "text": element.content})


def number(parent: Element | None, tag: str, default: float) -> float:
    """Number in a child element, or ``default``."""
    child = _child(parent, tag)
    if child is None:
        return default
    return with_text(child).number("text")


def _child(parent: Element | None, tag: str) -> Element | None:
    """Child of an element; None without the child or without the element."""
    if parent is None:
        return None
    return parent.child(tag)


def _reference(place: Element | None, attribute: str) -> str:
    """Frame that an attribute of an element names; empty without the attribute or without the element."""
    if place is None:
        return ""
    return place.attributes.get(attribute, "").strip()


def inertial_of(inertial: Element | None) -> tuple[float, Array, Array]:
    """Mass [kg], pose (4, 4) of the centre of mass with the axes of the tensor, and tensor (3, 3) [kg m²].

    Default values of the format are 1 kg and 1 kg m² about every axis.
    """
    tensor, defaults = _child(inertial, "inertia"), {"ixx": 1.0, "iyy": 1.0, "izz": 1.0}
    I = tensor_of(lambda name: number(tensor, name, defaults.get(name, 0.0)))
    return number(inertial, "mass", 1.0), pose(_child(inertial, "pose")), I


def missing_of(inertial: Element | None) -> tuple[str, ...]:
    """Missing parts of an ``<inertial>``, of mass and inertia."""
    return tuple(part for part in ("mass", "inertia") if _child(inertial, part) is None)


def assumed_text(missing: tuple[str, ...]) -> str:
    """Description of the format's values for missing parts."""
    means = {"mass": "1 kg", "inertia": "1 kg m² about every axis"}
    if not missing:
        return ""
    text = " and ".join(f"no {part}, which means {means[part]}" for part in missing)
    return f"{text}, in this format"


def vector(element: Element) -> Array:
    """Three numbers of an element."""
    return with_text(element).numbers("text", 3)


def word(parent: Element, tag: str, default: str = "") -> str:
    """Text of a child without leading and trailing blanks."""
    child = parent.child(tag)
    if child is None:
        return default
    return child.content.strip()


def is_true(parent: Element, tag: str) -> bool:
    """True if a child's text is true or 1."""
    return word(parent, tag) in ("true", "1")


def pose(element: Element | None) -> Array:
    """Pose (4, 4) in a ``<pose>``: position, then roll, pitch, yaw or a quaternion (x, y, z, w)."""
    T = np.eye(4)
    if element is None or not element.content.strip():
        return T
    form = element.word("rotation_format", ("euler_rpy", "quat_xyzw"), "euler_rpy")
    values = with_text(element).numbers("text", {"euler_rpy": 6, "quat_xyzw": 7}[form])
    T[:3, 3], turn = values[:3], values[3:]
    if form == "quat_xyzw":
        if not turn.any():
            raise element.error("has a quaternion of zeros, which is not a rotation.")
        T[:3, :3] = quaternion.rotation(np.roll(turn, 1))
        return T
    if element.attributes.get("degrees", "false").strip() in ("true", "1"):
        turn = turn * (math.pi / 180.0)
    T[:3, :3] = rotation_of_rpy(turn)
    return T


MODEL = "__model__"
WORLD = "world"
_JOINTS = ("joint", "{drake}joint")


@dataclass(eq=False)
class SdfFrame:
    """Link, joint, frame or nested model; the name includes those of enclosing models."""

    element: Element
    scope: str
    """Enclosing models, each followed by ``::``."""
    T: Array
    """Pose (4, 4) in the ``relative_to`` frame."""
    relative_to: str
    attached_to: str
    """Name of the frame to which it is attached; a link's own name."""


@dataclass(eq=False)
class SdfModel:
    """Content of a model, with nested models expanded."""

    frames: dict[str, SdfFrame] = field(default_factory=dict)
    links: dict[str, Element] = field(default_factory=dict)
    joints: dict[str, Element] = field(default_factory=dict)
    named: dict[str, Element] = field(default_factory=dict)
    """The ``<frame>`` elements."""
    _poses: dict[str, Array] = field(default_factory=dict)
    _carriers: dict[str, str] = field(default_factory=dict)
    """Cache of the frames' links."""

    def pose(self, name: str, asked: Element) -> Array:
        """Pose (4, 4) of a frame in the model's frame; raises for missing frames and circular references."""
        path: dict[str, None] = {}
        current = name
        while current not in self._poses and current != MODEL:
            if current in path:
                raise RobotFileError(
                    f"{asked}: the frames {listed([*path, current], between=' → ')} are given relative to each other."
                )
            path[current] = None
            current = self.frame(current, asked).relative_to
        T = self._poses.get(current, np.eye(4))
        for step in reversed(path):
            T = T @ self.frames[step].T
            self._poses[step] = T
        return T

    def link_of(self, name: str, asked: Element) -> str:
        """Link to which a frame is fixed."""
        path: dict[str, None] = {}
        while name not in self.links and name not in self._carriers:
            if name in path:
                raise RobotFileError(
                    f"{asked}: the frames {listed([*path, name], between=' → ')} are attached to each other."
                )
            path[name] = None
            name = self.frame(name, asked).attached_to
        link = self._carriers.get(name, name)
        self._carriers |= dict.fromkeys(path, link)
        return link

    def frame(self, name: str, asked: Element) -> SdfFrame:
        """Frame by name."""
        if name not in self.frames:
            known = listed(map(repr, self.frames))
            raise asked.error(f"names {name!r}, which is not a link, joint, frame or model there. Known: {known}.")
        return self.frames[name]

    def between(self, a: str, b: str, asked: Element) -> Array:
        """Transform T_ab between two frames."""
        return np.asarray(se3.inverse(self.pose(a, asked)) @ self.pose(b, asked))


def expand_model(model: Element) -> SdfModel:
    """Frames of a model and of its nested models, with names joined by ``::``."""
    expanded = SdfModel()
    stack = [(model, "")]
    while stack:
        element, scope = stack.pop()
        if element.all("include"):
            raise element.all("include")[0].error("is not read. Put the model that it names in its place.")
        own = scope[:-2] or MODEL
        for child in element.children:
            if child.tag not in ("link", "joint", "frame", "model"):
                continue
            name = scope + child.text("name")
            if name in expanded.frames:
                raise child.error(f"has the name of {expanded.frames[name].element}. Rename one.")
            default = own
            attached = name
            if child.tag == "joint":
                default = scope + _end(child, "child")
                attached = default
                expanded.joints[name] = child
            elif child.tag == "frame":
                target = child.attributes.get("attached_to", "").strip()
                default = own
                if target and target != MODEL:
                    default = scope + target
                attached = default
                expanded.named[name] = child
            elif child.tag == "link":
                expanded.links[name] = child
            else:
                stack.append((child, f"{name}::"))
                attached = f"{name}::{_canonical_link(child)}"
            relative = _reference_frame(child, scope) or default
            expanded.frames[name] = SdfFrame(child, scope, pose(child.child("pose")), relative, attached)
        if not scope:
            expanded.frames[MODEL] = SdfFrame(element, "", np.eye(4), MODEL, _canonical_link(element))
    return expanded


def _reference_frame(element: Element, scope: str) -> str:
    """Frame that the pose of an element is relative to; empty if it is not given."""
    frame = _reference(element.child("pose"), "relative_to")
    if not frame:
        return ""
    return _scoped_frame(frame, scope)


def _scoped_frame(frame: str, scope: str) -> str:
    """Name of a frame, with those of the enclosing models."""
    if frame == MODEL:
        return scope[:-2] or MODEL
    return scope + frame


def _canonical_link(model: Element) -> str:
    """Name of the link to which the model's frame is fixed."""
    name = model.attributes.get("canonical_link", "").strip()
    if name:
        return name
    for link in model.all("link"):
        return link.text("name")
    return ""


def _end(joint: Element, which: str) -> str:
    name = word(joint, which)
    if not name:
        raise joint.error(f"has no <{which}>. Name the link.")
    return name


TWO_AXES = ("universal", "revolute2")
"""Joint types with two axes of rotation."""
_KINDS = {
    **{kind: kind for kind in ("revolute", "continuous", "prismatic", "fixed", "ball")},
    "screw": "helical", **dict.fromkeys(TWO_AXES, "revolute"),
}  # fmt: skip


def read_sdf(
    root: Element, source: str = "", *, floating_base: bool | None = None, model: str | None = None
) -> ModelBuilder:
    """Builder with the links and joints of one model of an ``<sdf>`` element; its base is the link ``world``.

    ``model`` selects one of several models. ``floating_base=True`` lets links without a joint float; otherwise they are
    fixed at the file's pose. Raises :class:`~twistwrench.RobotFileError` with element and line, and
    :class:`~twistwrench.UnknownNameError` for a missing model.
    """
    element, world = chosen_model(root, model)
    return _SdfReader(root, element, world, source, floating_base).read()


def chosen_model(root: Element, name: str | None) -> tuple[Element, Element | None]:
    """Model of a file by name, by default the one that can move, and its world."""
    models: list[tuple[Element, Element | None]] = []
    for world in (None, *root.all("world")):
        models += [(model, world) for model in (world or root).all("model")]
    if name is not None:
        by_name = {model.text("name"): (model, world) for model, world in models}
        if name not in by_name:
            raise UnknownNameError.from_choices("model", name, by_name)
        return by_name[name]
    movable = [pair for pair in models if not is_true(pair[0], "static")]
    if len(movable) > 1:
        names = listed(repr(model.text("name")) for model, _ in movable)
        raise root.error(f"has {len(movable)} models that can move: {names}. Say which, {argument('model')}.")
    if not models:
        raise root.error("has no <model>.")
    return (movable or models)[0]


class _SdfReader:
    """Reader of one model."""

    def __init__(
        self, root: Element, model: Element, world: Element | None, source: str, floating_base: bool | None
    ) -> None:
        self.model, self.world, self.floating_base = model, world, floating_base
        self.version = _version(root)
        self.builder = ModelBuilder(model.text("name"), source)
        gravity = _child(world, "gravity")
        if gravity is not None:
            self.builder.gravity = vector(gravity).tolist()
        own = model.child("pose")
        self.place = pose(own)
        reference = _reference(own, "relative_to")
        if reference not in ("", WORLD):
            self.builder.note(
                own, f"is relative to {reference!r}, which is not read: it is taken as relative to the world"
            )
        self.parts: SdfModel = expand_model(model)

    def read(self) -> ModelBuilder:
        """Read links in the file's order, then joints, then frames."""
        builder = self.builder
        builder.add_link(WORLD)
        for name, link in self.parts.links.items():
            if name == WORLD:
                raise link.error("has the name of the world itself. Rename it.")
            shaped = bool(link.all("visual") or link.all("collision"))
            builder.add_link(name, self._inertia(link), where=link.place, shaped=shaped)
        children = {self._add_joint(name, joint) for name, joint in self.parts.joints.items()}
        for element in self.model.walk():
            if element.tag == "drake:joint":
                raise element.error("is an extension of Drake's, which is not read. Write it as a <joint>.")
        self._add_roots(children)
        parents = [word(joint, "parent") for joint in self.parts.joints.values()]
        if is_true(self.model, "static") or WORLD in parents:
            builder.mount()
        for name, frame in self.parts.named.items():
            carrier = self.parts.link_of(name, frame)
            builder.add_site(name, carrier, self.parts.between(carrier, name, frame), where=frame.place)
        builder.remark(*unread("SDF", *filter(None, (self.world, self.model))))
        return builder

    def _add_roots(self, children: set[str]) -> None:
        roots = [name for name in self.parts.links if name not in children]
        floats = bool(self.floating_base) and not is_true(self.model, "static")
        for name in roots:
            link = self.parts.links[name]
            T = self.place @ self.parts.pose(name, link)
            joint = "root_joint"
            if len(roots) > 1:
                joint = f"{name}.root_joint"
            if floats:
                self.builder.add_joint(joint, "floating", WORLD, name, where=link.place)
            else:
                self.builder.add_joint(joint, "fixed", WORLD, name, placement=T, where=link.place)
                if self.floating_base is None and not is_true(self.model, "static"):
                    self.builder.note(link, "is held by no joint, so it is fixed; a floating base lets it float")

    def _inertia(self, link: Element) -> SpatialInertia:
        inertial = link.child("inertial")
        if inertial is not None and inertial.attributes.get("auto", "").strip() in ("true", "1"):
            raise inertial.error("requests inertia from shapes (auto), which is not computed. Write the numbers.")
        text = assumed_text(missing_of(inertial))
        if text:
            self.builder.note(link, f"has {text}")
        mass, T, I = inertial_of(inertial)
        R = T[:3, :3]
        return SpatialInertia.from_com(mass, T[:3, 3], R @ I @ R.T)

    def _add_joint(self, name: str, joint: Element) -> str:
        """Add a joint and return its child link."""
        kind = joint.text("type")
        if kind == "gearbox":
            raise joint.error("is a gearbox, which is a constraint between joints. Remove it, or write a <mimic>.")
        if kind not in _KINDS:
            raise joint.error(f"has the unknown type {kind!r}. Allowed: {', '.join(_KINDS)}.")
        frame = self.parts.frames[name]
        parent, child = self._end(joint, "parent", frame.scope), self._end(joint, "child", frame.scope)
        if child == WORLD:
            raise joint.error("has the world as its child. Exchange parent and child.")
        T_parent = np.eye(4)
        if parent != WORLD:
            T_parent = self.place @ self.parts.pose(parent, joint)
        T = np.asarray(se3.inverse(T_parent) @ (self.place @ self.parts.pose(child, joint)))
        T_cj = self.parts.between(child, name, joint)
        if kind == "fixed":
            self.builder.add_joint(name, "fixed", parent, child, placement=T, where=joint.place)
        elif kind == "ball":
            add_ball(self.builder, name, parent, child, T, T_cj[:3, 3], joint.place, **_losses(joint.child("axis")))
        elif kind in TWO_AXES:
            middle = f"{child}:{name}"
            self.builder.add_link(middle, hidden=True)
            self._add_axis(f"{name}.axis", frame, "axis", parent, middle, T, T_cj)
            self._add_axis(f"{name}.axis2", frame, "axis2", middle, child, np.eye(4), T_cj)
        else:
            self._add_axis(name, frame, "axis", parent, child, T, T_cj)
        return child

    def _end(self, joint: Element, which: str, scope: str) -> str:
        name = word(joint, which)
        if name == WORLD:
            return WORLD
        return self.parts.link_of(scope + name, joint)

    def _add_axis(self, name: str, frame: SdfFrame, which: str, parent: str, child: str, T: Array, T_cj: Array) -> None:
        """Add a one-degree joint; T_cj is the pose of the file's joint in its child link."""
        joint, scope = frame.element, frame.scope
        kind = _KINDS[joint.text("type")]
        axis = joint.require_child(which, f"<{which}><xyz>0 0 1</xyz></{which}>")
        w = self._direction(axis, T_cj, scope, self._end(joint, "child", scope))
        length = float(np.linalg.norm(w))
        if not length:
            raise axis.error("has a zero <xyz>, which is not a direction. Give one such as 0 0 1.")
        w = w / length
        S = screw_through(kind, w, T_cj[:3, 3])
        if kind == "helical":
            S[3:] += _pitch(joint) * w
        inertia, gear = number(joint, "drake:rotor_inertia", 0.0), number(joint, "drake:gear_ratio", 1.0)
        self.builder.add_joint(
            name, kind, parent, child, placement=T, axis=S, armature=inertia * gear**2, mimic=_mimic(axis, scope),
            where=joint.place, **_limits(axis), **_losses(axis),
        )  # fmt: skip
        dynamics = axis.child("dynamics")
        stiffness = number(dynamics, "spring_stiffness", 0.0)
        if stiffness:
            rest_position = number(dynamics, "spring_reference", 0.0)
            self.builder.add_spring({name: 1.0}, stiffness, rest_position, where=joint.place)

    def _direction(self, axis: Element, T_cj: Array, scope: str, link: str) -> Array:
        """Joint axis in the frame of the child link."""
        xyz = axis.child("xyz")
        if xyz is None:
            raise axis.error("has no <xyz>. Give a direction such as <xyz>0 0 1</xyz>.")
        w, frame = vector(xyz), xyz.attributes.get("expressed_in", "").strip()
        if not frame and self.version > (1, 4) and not is_true(axis, "use_parent_model_frame"):
            return np.asarray(T_cj[:3, :3] @ w)
        name = _scoped_frame(frame or MODEL, scope)
        return np.asarray(self.parts.between(link, name, axis)[:3, :3] @ w)


def add_ball(
    builder: ModelBuilder, name: str, parent: str, child: str, T: Array, point: Array, where: str, **losses: Any
) -> None:
    """Add a ball joint about a point of its child; T (4, 4) is the pose of the child in the parent."""
    below = child
    to_point, back = se3.pose(np.eye(3), point), se3.pose(np.eye(3), -point)
    if point.any():
        below = f"{child}:{name}"
        builder.add_link(below, hidden=True)
        builder.add_joint(f"{name}.fixed", "fixed", below, child, placement=back, where=where)
    builder.add_joint(name, "ball", parent, below, placement=T @ to_point, where=where, **losses)


def _limits(axis: Element) -> dict[str, Any]:
    limit = axis.child("limit")
    limits = {"lower": number(limit, "lower", -math.inf), "upper": number(limit, "upper", math.inf)}
    for name in ("velocity", "effort"):
        largest = number(limit, name, -1.0)
        if largest > 0:
            limits[name] = largest
    return known_limits(**limits)


def _losses(axis: Element | None) -> dict[str, Any]:
    dynamics = _child(axis, "dynamics")
    return {"damping": number(dynamics, "damping", 0.0), "friction": number(dynamics, "friction", 0.0)}


def _mimic(axis: Element, scope: str) -> Mimic | None:
    mimic = axis.child("mimic")
    if mimic is None:
        return None
    leader, ratio = scope + mimic.text("joint"), number(mimic, "multiplier", 1.0)
    return leader, ratio, number(mimic, "offset", 0.0) - ratio * number(mimic, "reference", 0.0)


def _pitch(joint: Element) -> float:
    """Pitch [m/rad]; ``screw_thread_pitch`` is in metres per turn, ``thread_pitch`` in radians per metre, reversed."""
    if joint.child("screw_thread_pitch") is not None:
        return number(joint, "screw_thread_pitch", 1.0) / (2.0 * math.pi)
    per_metre = number(joint, "thread_pitch", 1.0)
    if not per_metre:
        raise joint.error("has a thread_pitch of zero. Give radians per metre.")
    return -1.0 / per_metre


def _version(root: Element) -> tuple[int, ...]:
    text = root.text("version")
    try:
        return tuple(int(part) for part in text.split("."))
    except ValueError:
        raise root.error(f"has version={text!r}, expected such as 1.7.") from None
