"""Text of a URDF file from a model."""

from __future__ import annotations

import numpy as np

from ...core.gravity import GRAVITY
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.model.description import JointEntry, unused
from ...mechanics.model.limits import Limits
from ...mechanics.model.model import Model
from ...mechanics.model.parts import ModelParts, disassemble
from ..urdf import LIMITS_OF_1_2, entries_of, rpy_of_rotation
from ..xml import Element, figures, new, xml_text
from .written import Losses, RobotDocument, drive_of, screw_of, translation

_NO_LIMIT = 1e16
"""Number for no limit, as the format requires one."""


def write_urdf(model: Model) -> RobotDocument:
    """The URDF file of a model. Links keep their own inertias, and fixed joints stay."""
    return _UrdfWriter(disassemble(model)).write()


class _UrdfWriter:
    """Writer of one model."""

    def __init__(self, parts: ModelParts) -> None:
        self.found, self.losses = parts, Losses()
        self.losses.note_couplings(parts)
        self.robot = new("robot", name=parts.name)
        self.names = {*parts.links}
        self.joint_names = {joint.name for joint in parts.joints}
        self.parts: list[Element] = []
        """Elements of joints, which come after those of links."""

    def write(self) -> RobotDocument:
        """Links in document order, then joints depth first."""
        found = self.found
        if found.floating:
            self._link(unused("world", self.names), SpatialInertia.zero())
        for link in found.links.values():
            self._link(link.name, link.inertia)
        if found.floating:
            joint = self._joint("root_joint", "floating", self.robot.children[0].text("name"), found.root, np.eye(4))
            self._losses_of(joint, "root_joint")
        for entry in found.joints:
            self._add(entry)
        self._add_sites()
        self._note_others()
        self.robot.children = [*self.robot.children, *self.parts]
        return RobotDocument(xml_text(self.robot), tuple(self.losses.found))

    def _link(self, name: str, inertia: SpatialInertia) -> None:
        self.names.add(name)
        link = new("link", self.robot, name=name)
        if not inertia.parameters.any():
            return
        inertial = new("inertial", link)
        new("origin", inertial, xyz=figures(inertia.com), rpy="0 0 0")
        new("mass", inertial, value=figures(inertia.mass))
        entries = entries_of(inertia.moment_about_com)
        new("inertia", inertial, **{name: figures(value) for name, value in entries.items()})

    def _joint(self, name: str, kind: str, parent: str, child: str, T: Array) -> Element:
        joint = Element("joint", {"name": name, "type": kind}, 0, self.robot)
        self.parts.append(joint)
        new("parent", joint, link=parent)
        new("child", joint, link=child)
        if not np.array_equal(T, np.eye(4)):
            new("origin", joint, xyz=figures(T[:3, 3]), rpy=figures(rpy_of_rotation(T[:3, :3])))
        return joint

    def _add_massless_link(self, name: str) -> str:
        """A new link without mass."""
        name = unused(name, self.names)
        self._link(name, SpatialInertia.zero())
        return name

    def _add(self, entry: JointEntry) -> None:
        kind, name = entry.joint.kind, entry.name
        if kind == "ball":
            self._add_ball(entry)
        elif kind not in ("fixed", "floating", "planar"):
            self._add_screw(entry)
        else:
            joint = self._joint(name, kind, entry.parent, entry.child, entry.placement)
            if kind == "planar":
                new("axis", joint, xyz=figures(entry.joint.axes[0, :3]))
            if kind != "fixed":
                self._losses_of(joint, name)

    def _add_screw(self, entry: JointEntry) -> None:
        axis, limits, name = screw_of(entry), entry.limits, entry.name
        child, T, beside = entry.child, entry.placement, ""
        if axis.point.any():  # the format has axes through the child's origin
            child, T = self._add_massless_link(f"{entry.child}:{name}"), T @ translation(axis.point)
            beside = unused(f"{name}.fixed", self.joint_names)
        middle = self._add_massless_link(f"{entry.child}:{name}:slide") if axis.pitch else child
        free = limits.lower[0] == -np.inf and limits.upper[0] == np.inf
        kind = "prismatic"
        if axis.turns:
            kind = "continuous" if free else "revolute"
        joint = self._joint(name, kind, entry.parent, middle, T)
        new("axis", joint, xyz=figures(axis.direction))
        self._limit(joint, limits)
        self._losses_of(joint, name)
        if entry.mimic is not None:
            self._mimic(joint, *entry.mimic)
        if axis.pitch:
            slide = self._joint(unused(f"{name}.slide", self.joint_names), "prismatic", middle, child, np.eye(4))
            new("axis", slide, xyz=figures(axis.direction))
            unlimited = np.full(1, np.inf)
            self._limit(slide, Limits(-unlimited, unlimited, unlimited, unlimited))
            self._mimic(slide, name, axis.pitch, 0.0)
            self.losses.note_joint(
                name, "is helical; it is written as a revolute joint and a prismatic one that mimics it"
            )
        if beside:
            self._joint(beside, "fixed", child, entry.child, translation(-axis.point))

    def _add_ball(self, entry: JointEntry) -> None:
        parent, T = entry.parent, entry.placement
        for k, letter in enumerate("xyz"):
            name = unused(f"{entry.name}.{letter}", self.joint_names)
            child = entry.child if k == 2 else self._add_massless_link(f"{entry.child}:{name}")
            joint = self._joint(name, "continuous", parent, child, T)
            new("axis", joint, xyz=figures(np.eye(3)[k]))
            if k == 0:
                self._losses_of(joint, entry.name)
            parent, T = child, np.eye(4)
        self.losses.note_joint(entry.name, "is a ball joint; it is written as three revolute joints about x, y and z")

    def _limit(self, joint: Element, limits: Limits) -> None:
        values = {name: float(getattr(limits, name)[0]) for name in ("lower", "upper", "velocity", "effort")}
        if joint.attributes["type"] == "continuous":
            del values["lower"], values["upper"]
        newer = {name: float(getattr(limits, name)[0]) for name in LIMITS_OF_1_2}
        newer = {name: limit for name, limit in newer.items() if np.isfinite(limit)}
        if newer:
            self.robot.attributes["version"] = "1.2"
        elif joint.attributes["type"] == "continuous" and not np.isfinite(list(values.values())).any():
            return
        texts = {name: figures(np.clip(limit, -_NO_LIMIT, _NO_LIMIT)) for name, limit in (values | newer).items()}
        new("limit", joint, **texts)

    def _mimic(self, joint: Element, leader: str, ratio: float, offset: float) -> None:
        new("mimic", joint, joint=leader, multiplier=figures(ratio), offset=figures(offset))

    def _losses_of(self, element: Element, name: str) -> None:
        """Damping and friction of a joint into its element; that it has an armature is noted."""
        drive = drive_of(self.found, name, self.losses)
        if drive.damping or drive.friction:
            new("dynamics", element, damping=figures(drive.damping), friction=figures(drive.friction))
        if drive.armature:
            self.losses.note_joint(name, "has an armature, which the format cannot represent")

    def _add_sites(self) -> None:
        for site in self.found.additions.sites.values():
            name = self._add_massless_link(site.name)
            beside = unused(f"{name}.fixed", self.joint_names)
            self._joint(beside, "fixed", site.link, name, site.pose)
            self.losses.note("site", site.name, "is written as a fixed link without mass")

    def _note_others(self) -> None:
        found = self.found
        for spring in found.additions.springs:
            joints = ", ".join(repr(joint) for joint, _ in spring.terms)
            self.losses.say(f"the spring of {joints} is left out: the format has none")
        if not np.array_equal(found.gravity, GRAVITY):
            self.losses.say(
                f"gravity {found.gravity.tolist()} is left out, which is not part of the format: load with gravity=…"
            )
        self.losses.note_unwritten(found)
