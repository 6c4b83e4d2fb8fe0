"""Text of an SDF file from a model."""

from __future__ import annotations

import math

import numpy as np

from ...core.errors import ModelError
from ...core.gravity import GRAVITY
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.lie import se3
from ...mechanics.model.assembly import ROOT_JOINT
from ...mechanics.model.description import JointEntry, unused
from ...mechanics.model.model import Model
from ...mechanics.model.parts import ModelParts, disassemble
from ..urdf import LIMITS_OF_1_2, entries_of, rpy_of_rotation
from ..xml import Element, figures, new, xml_text
from .written import Losses, RobotDocument, drive_of, screw_of

WORLD = "world"
_NO_LIMIT = 1e16
"""Number written for an absent limit, as the format requires one."""


def write_sdf(model: Model) -> RobotDocument:
    """The SDF file of a model. Fixed links without mass become frames, because simulators refuse such links."""
    return _SdfWriter(disassemble(model)).write()


class _SdfWriter:
    """Writer of one model."""

    def __init__(self, parts: ModelParts) -> None:
        self.parts = parts
        self.losses = Losses()
        self.losses.note_couplings(parts)
        self.root = new("sdf", version=_version(parts))
        self.model = Element("model", {"name": parts.name}, 0, self.root)
        self.names_in_use = {WORLD}
        # Joints are named before links: of two equal names the first is kept, and motions name joints.
        self.joint_names = {joint.name: self._name("joint", joint.name) for joint in parts.joints if not joint.fixed}
        """Name in the file of each joint of the model that is not fixed."""
        self.link_names: dict[str, str] = {}
        """Name in the file of each link of the model."""
        fixed_to_world = parts.root == WORLD and not parts.floating
        for name in parts.links:
            if name == WORLD and fixed_to_world:
                self.link_names[name] = WORLD
            else:
                self.link_names[name] = self._name("link", name)
        self.carriers = {parts.root: parts.root}
        """Link in the file that carries each link of the model: itself, or the link to which it is attached as a frame."""

    def write(self) -> RobotDocument:
        """Text of links with their joints, depth first, then of frames, and what it cannot represent."""
        parts = self.parts
        parent_of_model = self.root
        if not np.array_equal(parts.gravity, GRAVITY):  # gravity belongs to a world
            parent_of_model = new("world", self.root, name="world")
            new("gravity", parent_of_model, figures(parts.gravity))
        parent_of_model.add(self.model)
        self._add_root()
        for entry in parts.joints:
            self._add_joint(entry)
        self._add_sites()
        self._note_others()
        tags = {element.tag for element in self.model.walk()}
        if "drake:rotor_inertia" in tags:
            self.root.attributes["xmlns:drake"] = "http://drake.mit.edu"
        return RobotDocument(xml_text(self.root), tuple(self.losses.found))

    def _add_sites(self) -> None:
        """Add a frame for each site. Frames cannot belong to the world: a link that is fixed to it takes its sites."""
        parts = self.parts
        fixed_at_root = (joint for joint in parts.joints if joint.fixed and joint.parent == parts.root)
        joint_to_world = next(fixed_at_root, None)  # the root is the world if it is used
        for site in parts.additions.sites.values():
            if self.link_names[site.link] != WORLD:
                self._frame(self._name("site", site.name), site.link, site.pose)
            elif joint_to_world is not None:
                T = np.asarray(se3.inverse(joint_to_world.placement) @ site.pose)
                self._frame(self._name("site", site.name), joint_to_world.child, T)
            else:
                self.losses.note("site", site.name, "stands in the world, and is left out")

    def _name(self, kind: str, name: str) -> str:
        """Name in the file of a part: without ``::``, which separates models, and unlike the names of all other parts."""
        unique = unused(name.replace("::", "."), self.names_in_use)
        if unique != name:
            self.losses.note(kind, name, f"is written as {unique!r}: the format keeps its name for others")
        return unique

    def _add_root(self) -> None:
        """Add the root link. It is the world itself, is fixed to the world, or floats."""
        parts = self.parts
        if self.link_names[parts.root] == WORLD:
            self.losses.note_mass_of_world(parts)
            return
        self._link(parts.root, None, np.eye(4))
        if not parts.floating:
            self._joint(self._name("joint", f"{parts.root}.fixed"), "fixed", WORLD, parts.root)
            return
        has_damping_friction_or_armature = any(drive_of(parts, ROOT_JOINT, self.losses))
        if has_damping_friction_or_armature:
            self.losses.note_joint(ROOT_JOINT, "has damping, friction or armature, which the format cannot represent")

    def _add_joint(self, entry: JointEntry) -> None:
        """Add a joint and its child; a fixed child without mass becomes a frame."""
        kind = entry.joint.kind
        carrier = self.carriers[entry.parent]
        is_massless = not self.parts.links[entry.child].inertia.parameters.any()
        carrier_is_world = self.link_names[carrier] == WORLD  # a frame cannot belong to the world
        if entry.fixed and is_massless and not carrier_is_world:
            self.carriers[entry.child] = carrier
            self._frame(self.link_names[entry.child], entry.parent, entry.placement)
            return
        self.carriers[entry.child] = entry.child
        if kind == "floating":
            self._add_floating(entry)
            return
        if kind == "planar":
            self._add_planar(entry)
            return
        self._link(entry.child, entry.parent, entry.placement)
        name = self._name("joint", entry.name) if entry.fixed else self.joint_names[entry.name]
        if kind not in ("fixed", "ball"):
            self._add_screw(name, entry, self.link_names[carrier])
            return
        joint = self._joint(name, kind, self.link_names[carrier], entry.child)
        if kind == "ball":
            self._drive(entry.name, joint, None)

    def _add_floating(self, entry: JointEntry) -> None:
        """Add the child of a floating joint, as a link without a joint. Raises ModelError unless it floats from the world."""
        is_at_world = self.link_names[entry.parent] == WORLD and np.array_equal(entry.placement, np.eye(4))
        if not is_at_world:
            raise ModelError(
                f"joint {entry.name!r} floats away from the world's origin, and SDF has no joint for that. Lock it."
            )
        self._link(entry.child, None, np.eye(4))
        drive_of(self.parts, entry.name, self.losses)  # only for its notes
        if entry.name != ROOT_JOINT:
            self.losses.note_joint(
                entry.name, "floats, which the format expresses by the absence of a joint: its name is lost"
            )

    def _add_planar(self, entry: JointEntry) -> None:
        """Add a planar joint as two sliding joints and a turning one, with links without mass between them."""
        w = entry.joint.axes[0, :3]  # normal of the plane, about which the joint turns
        e1, e2 = entry.joint.axes[1:, 3:]  # directions of x and y in the plane
        parent = entry.parent
        carrier = self.link_names[self.carriers[entry.parent]]
        T = entry.placement
        for coordinate, kind, direction in (("x", "prismatic", e1), ("y", "prismatic", e2), ("theta", "continuous", w)):
            child = entry.child
            if coordinate != "theta":
                child = f"{entry.child}:{entry.name}.{coordinate}"
                self.link_names[child] = self._name("link", child)
                self.carriers[child] = child
            self._link(child, parent, T)
            name = self._name("joint", f"{entry.name}.{coordinate}")
            joint = self._joint(name, kind, carrier, child)
            self._drive(entry.name, joint, self._axis(joint, direction))
            parent = child
            carrier = self.link_names[child]
            T = np.eye(4)
        self.losses.note_joint(
            entry.name,
            "is planar; it is written as two sliding joints and a turning one, whose velocities are those of x, y, theta",
        )

    def _add_screw(self, name: str, entry: JointEntry, parent: str) -> None:
        """Add the element of a joint about or along one axis; ``parent`` is the link's name in the file."""
        screw = screw_of(entry)
        limits = entry.limits
        has_position_limit = bool(np.isfinite([limits.lower[0], limits.upper[0]]).any())
        if screw.pitch:
            kind = "screw"
        elif not screw.turns:
            kind = "prismatic"
        elif has_position_limit:
            kind = "revolute"
        else:
            kind = "continuous"
        joint = self._joint(name, kind, parent, entry.child)
        if screw.point.any():
            new("pose", joint, figures([*screw.point, 0, 0, 0]))
        if screw.pitch:
            new("screw_thread_pitch", joint, figures(2 * math.pi * screw.pitch))
        element = self._axis(joint, screw.direction)
        if entry.mimic is not None:
            leader, ratio, offset = entry.mimic
            mimic = new("mimic", element, joint=self.joint_names[leader])
            new("multiplier", mimic, figures(ratio))
            new("offset", mimic, figures(offset))
            new("reference", mimic, figures(0.0))
        limit = new("limit", element)
        lower = max(limits.lower[0], -_NO_LIMIT)
        upper = min(limits.upper[0], _NO_LIMIT)
        new("lower", limit, figures(lower))
        new("upper", limit, figures(upper))
        for tag, value in (("effort", limits.effort[0]), ("velocity", limits.velocity[0])):
            if np.isfinite(value):
                new(tag, limit, figures(value))
        self.losses.note_limits(name, limits, *LIMITS_OF_1_2)
        self._drive(entry.name, joint, element)

    def _drive(self, name: str, joint: Element, axis: Element | None) -> None:
        """Add friction, springs and armature to a joint's elements; ``axis`` is None for a ball joint."""
        drive = drive_of(self.parts, name, self.losses)
        dynamics_values = {"damping": drive.damping, "friction": drive.friction}
        for spring in self.parts.additions.springs:
            (spring_joint, weight), *other_terms = spring.terms
            is_of_this_joint_alone = spring_joint == name and not other_terms
            if axis is None or not is_of_this_joint_alone:
                continue
            if "spring_stiffness" in dynamics_values:
                self.losses.note_joint(name, "has a second spring, which is left out")
                continue
            dynamics_values["spring_reference"] = spring.rest / weight  # the spring's length is weight * position
            dynamics_values["spring_stiffness"] = spring.stiffness * weight**2
        if any(dynamics_values.values()):
            if axis is None:
                owner = self._axis(joint, np.array([0.0, 0.0, 1.0]))  # any axis: a ball joint has none
            else:
                owner = axis
            dynamics = new("dynamics", owner)
            for tag, value in dynamics_values.items():
                if value:
                    new(tag, dynamics, figures(value))
        if drive.armature and axis is not None:
            new("drake:rotor_inertia", joint, figures(drive.armature))
            self.losses.note_joint(
                name, "has an armature, which is written as drake:rotor_inertia, an extension of Drake's"
            )
        elif drive.armature:
            self.losses.note_joint(name, "has an armature, which the format cannot represent")

    def _joint(self, name: str, kind: str, parent: str, child: str) -> Element:
        """New element of a joint; ``name`` and ``parent`` are names in the file, ``child`` the name in the model."""
        joint = new("joint", self.model, name=name, type=kind)
        new("parent", joint, parent)
        new("child", joint, self.link_names[child])
        return joint

    def _axis(self, joint: Element, direction: Array) -> Element:
        """New element of a joint's axis."""
        axis = new("axis", joint)
        new("xyz", axis, figures(direction))
        return axis

    def _link(self, name: str, parent: str | None, T: Array) -> None:
        """Add a link at the pose T (4, 4) in its parent; None stands for the model's frame."""
        link = new("link", self.model, name=self.link_names[name])
        self._pose(link, parent, T)
        entry = self.parts.links.get(name)
        G = SpatialInertia.zero()
        if entry is not None:  # None for links between the parts of a planar joint
            G = entry.inertia
        inertial = new("inertial", link)
        if G.com.any():
            new("pose", inertial, figures([*G.com, 0, 0, 0]))
        new("mass", inertial, figures(G.mass))
        tensor = new("inertia", inertial)  # written even if zero: the format's defaults are 1 kg and 1 kg m²
        for tag, value in entries_of(G.moment_about_com).items():
            new(tag, tensor, figures(value))

    def _frame(self, name: str, link: str, T: Array) -> None:
        """Add a frame at the pose T (4, 4) in a link of the model."""
        frame = new("frame", self.model, name=name, attached_to=self.link_names[link])
        self._pose(frame, None, T)

    def _pose(self, element: Element, parent: str | None, T: Array) -> None:
        """Add the pose of an element, relative to the link ``parent``; the world and None stand for the model's frame."""
        attributes = {}
        if parent and self.link_names[parent] != WORLD:
            attributes["relative_to"] = self.link_names[parent]
        if attributes or not np.array_equal(T, np.eye(4)):
            new("pose", element, figures([*T[:3, 3], *rpy_of_rotation(T[:3, :3])]), **attributes)

    def _note_others(self) -> None:
        """Note the loss of springs between several joints, and of what only MJCF can represent."""
        for spring in self.parts.additions.springs:
            if len(spring.terms) > 1:
                joints = ", ".join(repr(joint) for joint, _ in spring.terms)
                self.losses.say(f"the spring of {joints} is left out: the format has none of several joints")
        self.losses.note_unwritten(self.parts)


def _version(parts: ModelParts) -> str:
    """The oldest version of the format that has every element which the model needs."""
    if any(joint.mimic is not None for joint in parts.joints):
        return "1.11"
    joints_of_one_degree = (joint for joint in parts.joints if joint.joint.nv == 1)
    if any(screw_of(joint).pitch for joint in joints_of_one_degree):
        return "1.10"
    return "1.8"
