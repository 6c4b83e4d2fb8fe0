"""SDFormat, the model description of Gazebo and Drake: values, frames, links and joints.

The format is described at http://sdformat.org/spec.
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
from .xml import CONTENT, Element

__all__ = ["read_sdf"]


def with_text(element: Element) -> Element:
    """Element whose text is also its attribute ``CONTENT``, so that the checks of attributes apply to its numbers."""
    return element.with_attributes({**element.attributes, CONTENT: element.content})


def number(parent: Element | None, tag: str, default: float) -> float:
    """Number in a child element, or ``default`` if the parent or the child is missing."""
    child = _child(parent, tag)
    if child is None:
        return default
    return with_text(child).number(CONTENT)


def _child(parent: Element | None, tag: str) -> Element | None:
    """Child of an element; None without the child or without the element."""
    if parent is None:
        return None
    return parent.child(tag)


def _reference(element: Element | None, attribute: str) -> str:
    """Frame that an attribute of an element names; empty without the attribute or without the element."""
    if element is None:
        return ""
    return element.attributes.get(attribute, "").strip()


def inertial_of(inertial: Element | None) -> tuple[float, Array, Array]:
    """Mass [kg], pose (4, 4) of the centre of mass with the axes of the tensor, and tensor (3, 3) [kg m²] in these axes.

    Default values of the format are 1 kg and 1 kg m² about every axis.
    """
    tensor = _child(inertial, "inertia")
    default_entries = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0}
    I = tensor_of(lambda name: number(tensor, name, default_entries.get(name, 0.0)))
    mass = number(inertial, "mass", 1.0)
    return mass, pose(_child(inertial, "pose")), I


def missing_of(inertial: Element | None) -> tuple[str, ...]:
    """Tags of the missing parts of an ``<inertial>``: "mass", "inertia" or both."""
    return tuple(part for part in ("mass", "inertia") if _child(inertial, part) is None)


def assumed_text(missing: tuple[str, ...]) -> str:
    """Clause with the format's values for missing parts; empty if nothing is missing."""
    if not missing:
        return ""
    defaults = {"mass": "1 kg", "inertia": "1 kg m² about every axis"}
    text = " and ".join(f"no {part}, which means {defaults[part]}" for part in missing)
    return f"{text}, in this format"


def vector(element: Element) -> Array:
    """Three numbers of an element."""
    return with_text(element).numbers(CONTENT, 3)


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
    rotation_format = element.word("rotation_format", ("euler_rpy", "quat_xyzw"), "euler_rpy")
    value_count = {"euler_rpy": 6, "quat_xyzw": 7}[rotation_format]
    values = with_text(element).numbers(CONTENT, value_count)
    T[:3, 3] = values[:3]
    if rotation_format == "quat_xyzw":
        xyzw = values[3:]
        if not xyzw.any():
            raise element.error("has a quaternion of zeros, which is not a rotation.")
        wxyz = np.roll(xyzw, 1)
        T[:3, :3] = quaternion.rotation(wxyz)
        return T
    rpy = values[3:]
    if element.attributes.get("degrees", "false").strip() in ("true", "1"):
        rpy = rpy * (math.pi / 180.0)
    T[:3, :3] = rotation_of_rpy(rpy)
    return T


MODEL = "__model__"
"""Name of the frame of the enclosing model."""
WORLD = "world"
"""Name of the world's frame, and of the base link."""


@dataclass(eq=False)
class SdfFrame:
    """Frame of a link, a joint, a ``<frame>`` or a nested model. Names of frames begin with their enclosing models."""

    element: Element
    scope: str
    """Names of the enclosing models, each followed by ``::``."""
    T: Array
    """Pose (4, 4) in the frame ``relative_to``."""
    relative_to: str
    """Name of the frame in which the pose is given."""
    attached_to: str
    """Name of the frame to which this frame is fixed; for a link its own name."""


@dataclass(eq=False)
class SdfModel:
    """Content of a model and of its nested models, by name."""

    frames: dict[str, SdfFrame] = field(default_factory=dict)
    """Frames of all kinds."""
    links: dict[str, Element] = field(default_factory=dict)
    joints: dict[str, Element] = field(default_factory=dict)
    named: dict[str, Element] = field(default_factory=dict)
    """The ``<frame>`` elements."""
    _poses: dict[str, Array] = field(default_factory=dict)
    """Poses of frames in the model's frame, as far as they are computed."""
    _carriers: dict[str, str] = field(default_factory=dict)
    """Names of the links to which frames are fixed, as far as they are found."""

    def pose(self, name: str, user: Element) -> Array:
        """Pose (4, 4) of a frame in the model's frame.

        Missing frames and circular references raise an error with ``user``, the element that names the frame.
        """
        path: dict[str, None] = {}  # frames from this one to before one with a known pose, in order
        current = name
        while current not in self._poses and current != MODEL:
            if current in path:
                circle = listed([*path, current], between=" → ")
                raise RobotFileError(f"{user}: the frames {circle} are given relative to each other.")
            path[current] = None
            current = self.frame(current, user).relative_to
        T = self._poses.get(current, np.eye(4))
        for frame_name in reversed(path):
            T = T @ self.frames[frame_name].T
            self._poses[frame_name] = T
        return T

    def link_of(self, name: str, user: Element) -> str:
        """Link to which a frame is fixed; raises the errors of :meth:`pose`."""
        path: dict[str, None] = {}  # frames from this one to before one with a known link, in order
        current = name
        while current not in self.links and current not in self._carriers:
            if current in path:
                circle = listed([*path, current], between=" → ")
                raise RobotFileError(f"{user}: the frames {circle} are attached to each other.")
            path[current] = None
            current = self.frame(current, user).attached_to
        link = self._carriers.get(current, current)
        self._carriers |= dict.fromkeys(path, link)
        return link

    def frame(self, name: str, user: Element) -> SdfFrame:
        """Frame by name; raises an error with the element ``user`` if the frame is missing."""
        if name not in self.frames:
            known = listed(map(repr, self.frames))
            raise user.error(f"names {name!r}, which is not a link, joint, frame or model there. Known: {known}.")
        return self.frames[name]

    def between(self, a: str, b: str, user: Element) -> Array:
        """Pose T_ab (4, 4) of frame b in frame a."""
        return np.asarray(se3.inverse(self.pose(a, user)) @ self.pose(b, user))


def expand_model(model: Element) -> SdfModel:
    """Frames of a model and of its nested models, with names joined by ``::``."""
    expanded = SdfModel()
    pending = [(model, "")]  # models with their scopes
    while pending:
        model_element, scope = pending.pop()
        includes = model_element.all("include")
        if includes:
            raise includes[0].error("is not read. Put the model that it names in its place.")
        model_frame = _scoped_frame(MODEL, scope)
        for child in model_element.children:
            if child.tag not in ("link", "joint", "frame", "model"):
                continue
            name = scope + child.text("name")
            if name in expanded.frames:
                raise child.error(f"has the name of {expanded.frames[name].element}. Rename one.")
            default_reference = model_frame  # the format's default of relative_to
            attached_to = name
            if child.tag == "joint":
                attached_to = _scoped_frame(_name_at_end(child, "child"), scope)
                default_reference = attached_to
                expanded.joints[name] = child
            elif child.tag == "frame":
                target = child.attributes.get("attached_to", "").strip()
                attached_to = _scoped_frame(target or MODEL, scope)
                default_reference = attached_to
                expanded.named[name] = child
            elif child.tag == "link":
                expanded.links[name] = child
            else:
                pending.append((child, f"{name}::"))
                attached_to = f"{name}::{_canonical_link(child)}"
            relative_to = _reference_frame(child, scope) or default_reference
            expanded.frames[name] = SdfFrame(child, scope, pose(child.child("pose")), relative_to, attached_to)
        if not scope:
            expanded.frames[MODEL] = SdfFrame(model_element, "", np.eye(4), MODEL, _canonical_link(model_element))
    return expanded


def _reference_frame(element: Element, scope: str) -> str:
    """Frame that the ``<pose>`` of an element names in ``relative_to``; empty if it names none."""
    frame = _reference(element.child("pose"), "relative_to")
    if not frame:
        return ""
    return _scoped_frame(frame, scope)


def _scoped_frame(frame: str, scope: str) -> str:
    """Name of a frame, preceded by the names of its enclosing models."""
    if frame == MODEL:  # the frame of a nested model has the name of the model
        return scope.removesuffix("::") or MODEL
    return scope + frame


def _canonical_link(model: Element) -> str:
    """Name of the link to which the model's frame is fixed, by default the first link; empty without links."""
    name = model.attributes.get("canonical_link", "").strip()
    if name:
        return name
    for link in model.all("link"):
        return link.text("name")
    return ""


def _name_at_end(joint: Element, tag: str) -> str:
    """Name of the ``parent`` or ``child`` of a joint, as it stands in the file."""
    name = word(joint, tag)
    if not name:
        raise joint.error(f"has no <{tag}>. Name the link.")
    return name


TWO_AXES = ("universal", "revolute2")
"""Joint types with two axes of rotation."""
_KIND_OF_TYPE = {
    "revolute": "revolute", "continuous": "continuous", "prismatic": "prismatic", "fixed": "fixed", "ball": "ball",
    "screw": "helical", "universal": "revolute", "revolute2": "revolute",
}  # fmt: skip
"""Kind of the builder's joint by the file's type; for types with two axes, the kind of each of two joints."""


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
    """Model of a file by name, and the world that contains it; by default the only model that can move.

    The world is None for a model outside of worlds.
    """
    models: list[tuple[Element, Element | None]] = [(model, None) for model in root.all("model")]
    for world in root.all("world"):
        models += [(model, world) for model in world.all("model")]
    if name is not None:
        by_name = {model.text("name"): (model, world) for model, world in models}
        if name not in by_name:
            raise UnknownNameError.from_choices("model", name, by_name)
        return by_name[name]
    movable_models = [(model, world) for model, world in models if not is_true(model, "static")]
    if len(movable_models) > 1:
        names = listed(repr(model.text("name")) for model, _ in movable_models)
        raise root.error(f"has {len(movable_models)} models that can move: {names}. Say which, {argument('model')}.")
    if not models:
        raise root.error("has no <model>.")
    if movable_models:
        return movable_models[0]
    return models[0]


class _SdfReader:
    """Reader of one model."""

    def __init__(
        self, root: Element, model: Element, world: Element | None, source: str, floating_base: bool | None
    ) -> None:
        self.model = model
        self.world = world
        self.floating_base = floating_base
        self.version = _version(root)
        self.builder = ModelBuilder(model.text("name"), source)
        gravity = _child(world, "gravity")
        if gravity is not None:
            self.builder.gravity = vector(gravity).tolist()
        pose_element = model.child("pose")
        self.place = pose(pose_element)
        """Pose (4, 4) of the model in the world."""
        reference = _reference(pose_element, "relative_to")
        if reference not in ("", WORLD):
            self.builder.note(
                pose_element, f"is relative to {reference!r}, which is not read: it is taken as relative to the world"
            )
        self.parts: SdfModel = expand_model(model)

    def read(self) -> ModelBuilder:
        """Read links in the file's order, then joints, then frames."""
        builder = self.builder
        builder.add_link(WORLD)
        for name, link in self.parts.links.items():
            if name == WORLD:
                raise link.error("has the name of the world itself. Rename it.")
            has_shape = bool(link.all("visual") or link.all("collision"))
            builder.add_link(name, self._inertia(link), where=link.place, shaped=has_shape)
        child_links: set[str] = set()
        for name, joint in self.parts.joints.items():
            child_links.add(self._add_joint(name, joint))
        for element in self.model.walk():
            if element.tag == "drake:joint":
                raise element.error("is an extension of Drake's, which is not read. Write it as a <joint>.")
        self._add_roots(child_links)
        parents = [word(joint, "parent") for joint in self.parts.joints.values()]
        if is_true(self.model, "static") or WORLD in parents:
            builder.mount()
        for name, frame in self.parts.named.items():
            carrier = self.parts.link_of(name, frame)
            builder.add_site(name, carrier, self.parts.between(carrier, name, frame), where=frame.place)
        read_elements = [element for element in (self.world, self.model) if element is not None]
        builder.remark(*unread("SDF", *read_elements))
        return builder

    def _add_roots(self, child_links: set[str]) -> None:
        """Join each link that is not the child of a joint to the world, by a floating or a fixed joint."""
        roots = [name for name in self.parts.links if name not in child_links]
        is_static = is_true(self.model, "static")
        for name in roots:
            link = self.parts.links[name]
            T = self.place @ self.parts.pose(name, link)
            joint_name = "root_joint"
            if len(roots) > 1:
                joint_name = f"{name}.root_joint"
            if self.floating_base and not is_static:
                self.builder.add_joint(joint_name, "floating", WORLD, name, where=link.place)
                continue
            self.builder.add_joint(joint_name, "fixed", WORLD, name, placement=T, where=link.place)
            is_by_default = self.floating_base is None and not is_static
            if is_by_default:
                self.builder.note(link, "is held by no joint, so it is fixed; a floating base lets it float")

    def _inertia(self, link: Element) -> SpatialInertia:
        """Spatial inertia of a link in the axes of its frame; a note if the format's defaults apply."""
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
        if kind not in _KIND_OF_TYPE:
            raise joint.error(f"has the unknown type {kind!r}. Allowed: {', '.join(_KIND_OF_TYPE)}.")
        frame = self.parts.frames[name]
        parent = self._link_at_end(joint, "parent", frame.scope)
        child = self._link_at_end(joint, "child", frame.scope)
        if child == WORLD:
            raise joint.error("has the world as its child. Exchange parent and child.")
        T_parent = np.eye(4)  # in the world
        if parent != WORLD:
            T_parent = self.place @ self.parts.pose(parent, joint)
        T_child = self.place @ self.parts.pose(child, joint)
        T = np.asarray(se3.inverse(T_parent) @ T_child)
        T_cj = self.parts.between(child, name, joint)
        if kind == "fixed":
            self.builder.add_joint(name, "fixed", parent, child, placement=T, where=joint.place)
        elif kind == "ball":
            losses = _losses_of_axis(joint.child("axis"))
            add_ball(self.builder, name, parent, child, T, T_cj[:3, 3], joint.place, **losses)
        elif kind in TWO_AXES:  # two joints with a link without mass between them
            middle = f"{child}:{name}"
            self.builder.add_link(middle, hidden=True)
            self._add_axis(f"{name}.axis", frame, "axis", parent, middle, T, T_cj)
            self._add_axis(f"{name}.axis2", frame, "axis2", middle, child, np.eye(4), T_cj)
        else:
            self._add_axis(name, frame, "axis", parent, child, T, T_cj)
        return child

    def _link_at_end(self, joint: Element, tag: str, scope: str) -> str:
        """Link of the ``parent`` or ``child`` of a joint, which may name any frame that is fixed to the link."""
        name = word(joint, tag)
        if name == WORLD:
            return WORLD
        return self.parts.link_of(_scoped_frame(name, scope), joint)

    def _add_axis(self, name: str, frame: SdfFrame, tag: str, parent: str, child: str, T: Array, T_cj: Array) -> None:
        """Add a one-degree joint with the axis in ``<axis>`` or ``<axis2>``, which ``tag`` names.

        ``frame`` is the frame of the file's joint. T (4, 4) is the pose of the child in the parent, and T_cj the pose of the
        file's joint in its child link.
        """
        joint = frame.element
        scope = frame.scope
        kind = _KIND_OF_TYPE[joint.text("type")]
        axis = joint.require_child(tag, f"<{tag}><xyz>0 0 1</xyz></{tag}>")
        w = self._direction(axis, T_cj, scope, self._link_at_end(joint, "child", scope))
        length = float(np.linalg.norm(w))
        if not length:
            raise axis.error("has a zero <xyz>, which is not a direction. Give one such as 0 0 1.")
        w = w / length
        S = screw_through(kind, w, T_cj[:3, 3])
        if kind == "helical":
            S[3:] += _pitch(joint) * w
        rotor_inertia = number(joint, "drake:rotor_inertia", 0.0)
        gear_ratio = number(joint, "drake:gear_ratio", 1.0)
        self.builder.add_joint(
            name, kind, parent, child, placement=T, axis=S, armature=rotor_inertia * gear_ratio**2,
            mimic=_mimic(axis, scope), where=joint.place, **_limits_of_axis(axis), **_losses_of_axis(axis),
        )  # fmt: skip
        dynamics = axis.child("dynamics")
        stiffness = number(dynamics, "spring_stiffness", 0.0)
        if stiffness:
            rest_position = number(dynamics, "spring_reference", 0.0)
            self.builder.add_spring({name: 1.0}, stiffness, rest_position, where=joint.place)

    def _direction(self, axis: Element, T_cj: Array, scope: str, link: str) -> Array:
        """Joint axis (3,) in the frame of the child link.

        The file gives the axis in the frame ``expressed_in``. Without it, the axis is in the joint's frame since version 1.5 of
        the format, and in the model's frame before.
        """
        xyz = axis.child("xyz")
        if xyz is None:
            raise axis.error("has no <xyz>. Give a direction such as <xyz>0 0 1</xyz>.")
        w = vector(xyz)
        frame = xyz.attributes.get("expressed_in", "").strip()
        by_default_in_joint = self.version > (1, 4) and not is_true(axis, "use_parent_model_frame")
        if not frame and by_default_in_joint:
            return np.asarray(T_cj[:3, :3] @ w)
        T = self.parts.between(link, _scoped_frame(frame or MODEL, scope), axis)
        return np.asarray(T[:3, :3] @ w)


def add_ball(
    builder: ModelBuilder, name: str, parent: str, child: str, T: Array, point: Array, where: str, **losses: Any
) -> None:
    """Add a ball joint about a point (3,) of its child; T (4, 4) is the pose of the child in the parent.

    The builder's ball joints turn about the origin of their child. If the point is another one, a hidden link at the point is
    the child of the ball joint, and the file's child is fixed to it.
    """
    ball_child = child
    if point.any():
        ball_child = f"{child}:{name}"
        builder.add_link(ball_child, hidden=True)
        from_point = se3.pose(np.eye(3), -point)
        builder.add_joint(f"{name}.fixed", "fixed", ball_child, child, placement=from_point, where=where)
    to_point = se3.pose(np.eye(3), point)
    builder.add_joint(name, "ball", parent, ball_child, placement=T @ to_point, where=where, **losses)


def _limits_of_axis(axis: Element) -> dict[str, Any]:
    """Limits of a joint by name."""
    limit_element = axis.child("limit")
    limits = {}
    limits["lower"] = number(limit_element, "lower", -math.inf)
    limits["upper"] = number(limit_element, "upper", math.inf)
    for name in ("velocity", "effort"):
        limit = number(limit_element, name, -1.0)
        if limit > 0:  # other numbers mean no limit in this format
            limits[name] = limit
    return known_limits(**limits)


def _losses_of_axis(axis: Element | None) -> dict[str, Any]:
    """Damping and friction of a joint, zero by default."""
    dynamics = _child(axis, "dynamics")
    return {"damping": number(dynamics, "damping", 0.0), "friction": number(dynamics, "friction", 0.0)}


def _mimic(axis: Element, scope: str) -> Mimic | None:
    """Name of the leader, ratio and offset of a mimic joint; None for other joints.

    The file's law is follower = multiplier * (leader - reference) + offset.
    """
    mimic = axis.child("mimic")
    if mimic is None:
        return None
    leader = scope + mimic.text("joint")
    ratio = number(mimic, "multiplier", 1.0)
    offset = number(mimic, "offset", 0.0) - ratio * number(mimic, "reference", 0.0)
    return leader, ratio, offset


def _pitch(joint: Element) -> float:
    """Pitch [m/rad], from ``screw_thread_pitch`` in metres per turn, or ``thread_pitch`` in radians per metre, reversed."""
    if joint.child("screw_thread_pitch") is not None:
        return number(joint, "screw_thread_pitch", 1.0) / (2.0 * math.pi)
    radians_per_metre = number(joint, "thread_pitch", 1.0)
    if not radians_per_metre:
        raise joint.error("has a thread_pitch of zero. Give radians per metre.")
    return -1.0 / radians_per_metre


def _version(root: Element) -> tuple[int, ...]:
    """Version of the format, such as (1, 7)."""
    text = root.text("version")
    try:
        return tuple(int(part) for part in text.split("."))
    except ValueError:
        raise root.error(f"has version={text!r}, expected such as 1.7.") from None
