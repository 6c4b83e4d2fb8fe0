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
"""Number for no limit."""


def write_sdf(model: Model) -> RobotDocument:
    """The SDF file of a model. Fixed links without mass become frames, for simulators refuse them as links."""
    return _SdfWriter(disassemble(model)).write()


class _SdfWriter:
    """Writer of one model."""

    def __init__(self, parts: ModelParts) -> None:
        self.found, self.losses = parts, Losses()
        self.losses.note_couplings(parts)
        self.root = new("sdf", version=_version(parts))
        self.model = Element("model", {"name": parts.name}, 0, self.root)
        self.names = {WORLD}
        # Joints first: motions go by the names of joints.
        self.joints = {joint.name: self._name("joint", joint.name) for joint in parts.joints if not joint.fixed}
        self.called: dict[str, str] = {}
        """Name of each link in the file."""
        for name in parts.links:
            is_world = name == WORLD and parts.root == WORLD and not parts.floating
            self.called[name] = WORLD if is_world else self._name("link", name)
        self.carriers = {parts.root: parts.root}
        """Link that carries each link: itself, or the one it is a frame of."""

    def write(self) -> RobotDocument:
        """Links with their joints, depth first, then frames."""
        found = self.found
        world = self.root
        if not np.array_equal(found.gravity, GRAVITY):
            world = new("world", self.root, name="world")
            new("gravity", world, figures(found.gravity))
        world.add(self.model)
        self._begin()
        for entry in found.joints:
            self._add(entry)
        standing = [joint for joint in found.joints if joint.fixed and joint.parent == found.root]
        beside = standing[0] if standing else None
        for site in found.additions.sites.values():
            if self.called[site.link] == WORLD and beside is not None:  # no frame is of the world
                T = np.asarray(se3.inverse(beside.placement) @ site.pose)
                self._frame(self._name("site", site.name), beside.child, T)
            elif self.called[site.link] == WORLD:
                self.losses.note("site", site.name, "stands in the world, and is left out")
            else:
                self._frame(self._name("site", site.name), site.link, site.pose)
        self._note_others()
        if "drake:rotor_inertia" in {element.tag for element in self.model.walk()}:
            self.root.attributes["xmlns:drake"] = "http://drake.mit.edu"
        return RobotDocument(xml_text(self.root), tuple(self.losses.found))

    def _name(self, kind: str, name: str) -> str:
        """Unused name: links, joints and frames share one scope, and ``::`` separates models."""
        unique = unused(name.replace("::", "."), self.names)
        if unique != name:
            self.losses.note(kind, name, f"is written as {unique!r}: the format keeps its name for others")
        return unique

    def _begin(self) -> None:
        """The root link: the world itself, fixed to it, or free."""
        found = self.found
        if self.called[found.root] == WORLD:
            self.losses.note_mass_of_world(found)
            return
        self._link(found.root, None, np.eye(4))
        if not found.floating:
            self._joint(self._name("joint", f"{found.root}.fixed"), "fixed", WORLD, found.root)
            return
        if any(drive_of(found, ROOT_JOINT, self.losses)):
            self.losses.note_joint(ROOT_JOINT, "has damping, friction or armature, which the format cannot represent")

    def _add(self, entry: JointEntry) -> None:
        kind = entry.joint.kind
        carrier = self.carriers[entry.parent]
        massless = not self.found.links[entry.child].inertia.parameters.any()
        if entry.fixed and self.called[carrier] != WORLD and massless:
            self.carriers[entry.child] = carrier
            self._frame(self.called[entry.child], entry.parent, entry.placement)
            return
        self.carriers[entry.child] = entry.child
        if kind == "floating":
            self._add_floating(entry)
            return
        if kind == "planar":
            self._add_planar(entry)
            return
        self._link(entry.child, entry.parent, entry.placement)
        name = self._name("joint", entry.name) if entry.fixed else self.joints[entry.name]
        if kind not in ("fixed", "ball"):
            self._add_screw(name, entry, self.called[carrier])
            return
        joint = self._joint(name, kind, self.called[carrier], entry.child)
        if kind == "ball":
            self._drive(entry.name, joint, None)

    def _add_floating(self, entry: JointEntry) -> None:
        if self.called[entry.parent] != WORLD or not np.array_equal(entry.placement, np.eye(4)):
            raise ModelError(
                f"joint {entry.name!r} floats away from the world's origin, and SDF has no joint for that. Lock it."
            )
        self._link(entry.child, None, np.eye(4))
        drive_of(self.found, entry.name, self.losses)
        if entry.name != ROOT_JOINT:
            self.losses.note_joint(
                entry.name, "floats, which the format expresses by the absence of a joint: its name is lost"
            )

    def _add_planar(self, entry: JointEntry) -> None:
        w, e1, e2 = entry.joint.axes[0, :3], entry.joint.axes[1, 3:], entry.joint.axes[2, 3:]
        parent, carrier, T = entry.parent, self.called[self.carriers[entry.parent]], entry.placement
        for letter, kind, direction in (("x", "prismatic", e1), ("y", "prismatic", e2), ("theta", "continuous", w)):
            child = entry.child
            if letter != "theta":
                child = f"{entry.child}:{entry.name}.{letter}"
                self.called[child] = self._name("link", child)
                self.carriers[child] = child
            self._link(child, parent, T)
            joint = self._joint(self._name("joint", f"{entry.name}.{letter}"), kind, carrier, child)
            self._drive(entry.name, joint, self._axis(joint, direction))
            parent, carrier, T = child, self.called[child], np.eye(4)
        self.losses.note_joint(
            entry.name,
            "is planar; it is written as two sliding joints and a turning one, whose velocities are those of x, y, theta",
        )

    def _add_screw(self, name: str, entry: JointEntry, parent: str) -> None:
        axis, limits = screw_of(entry), entry.limits
        if axis.pitch:
            kind = "screw"
        elif not axis.turns:
            kind = "prismatic"
        elif np.isfinite([limits.lower[0], limits.upper[0]]).any():
            kind = "revolute"
        else:
            kind = "continuous"
        joint = self._joint(name, kind, parent, entry.child)
        if axis.point.any():
            new("pose", joint, figures([*axis.point, 0, 0, 0]))
        if axis.pitch:
            new("screw_thread_pitch", joint, figures(2 * math.pi * axis.pitch))
        element = self._axis(joint, axis.direction)
        if entry.mimic is not None:
            leader, ratio, offset = entry.mimic
            mimic = new("mimic", element, joint=self.joints[leader])
            for what, value in (("multiplier", ratio), ("offset", offset), ("reference", 0.0)):
                new(what, mimic, figures(value))
        limit = new("limit", element)
        new("lower", limit, figures(max(limits.lower[0], -_NO_LIMIT)))
        new("upper", limit, figures(min(limits.upper[0], _NO_LIMIT)))
        for what, value in (("effort", limits.effort[0]), ("velocity", limits.velocity[0])):
            if np.isfinite(value):
                new(what, limit, figures(value))
        self.losses.note_limits(name, limits, *LIMITS_OF_1_2)
        self._drive(entry.name, joint, element)

    def _drive(self, name: str, joint: Element, axis: Element | None) -> None:
        """Friction, springs and armature of a joint into its elements."""
        drive = drive_of(self.found, name, self.losses)
        values = {"damping": drive.damping, "friction": drive.friction}
        for spring in self.found.additions.springs:
            (first, weight), *others = spring.terms
            if axis is not None and first == name and not others:
                if "spring_stiffness" in values:
                    self.losses.note_joint(name, "has a second spring, which is left out")
                    continue
                values |= {"spring_reference": spring.rest / weight, "spring_stiffness": spring.stiffness * weight**2}
        if any(values.values()):
            owner = self._axis(joint, np.array([0.0, 0.0, 1.0])) if axis is None else axis
            dynamics = new("dynamics", owner)
            for tag, value in values.items():
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
        joint = new("joint", self.model, name=name, type=kind)
        new("parent", joint, parent)
        new("child", joint, self.called[child])
        return joint

    def _axis(self, joint: Element, direction: Array) -> Element:
        axis = new("axis", joint)
        new("xyz", axis, figures(direction))
        return axis

    def _link(self, name: str, parent: str | None, T: Array) -> None:
        link = new("link", self.model, name=self.called[name])
        self._pose(link, parent, T)
        entry = self.found.links.get(name)
        G = SpatialInertia.zero() if entry is None else entry.inertia
        inertial = new("inertial", link)
        if G.com.any():
            new("pose", inertial, figures([*G.com, 0, 0, 0]))
        new("mass", inertial, figures(G.mass))
        tensor = new("inertia", inertial)  # what is left out would be 1 kg and 1 kg m²
        for what, value in entries_of(G.moment_about_com).items():
            new(what, tensor, figures(value))

    def _frame(self, name: str, link: str, T: Array) -> None:
        frame = new("frame", self.model, name=name, attached_to=self.called[link])
        self._pose(frame, None, T)

    def _pose(self, element: Element, parent: str | None, T: Array) -> None:
        attributes = {}
        if parent and self.called[parent] != WORLD:
            attributes["relative_to"] = self.called[parent]
        if attributes or not np.array_equal(T, np.eye(4)):
            new("pose", element, figures([*T[:3, 3], *rpy_of_rotation(T[:3, :3])]), **attributes)

    def _note_others(self) -> None:
        for spring in self.found.additions.springs:
            if len(spring.terms) > 1:
                joints = ", ".join(repr(joint) for joint, _ in spring.terms)
                self.losses.say(f"the spring of {joints} is left out: the format has none of several joints")
        self.losses.note_unwritten(self.found)


def _version(found: ModelParts) -> str:
    """The first version of the format that has all that is needed."""
    if any(joint.mimic is not None for joint in found.joints):
        return "1.11"
    screws = (joint for joint in found.joints if joint.joint.nv == 1)
    return "1.10" if any(screw_of(joint).pitch for joint in screws) else "1.8"
