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
        self.model_parts = parts
        self.losses = Losses()
        self.losses.note_couplings(parts)
        self.robot = new("robot", name=parts.name)
        self.link_names = {*parts.links}
        """Names in use, by the model and by added links."""
        self.joint_names = {joint.name for joint in parts.joints}
        self.joint_elements: list[Element] = []
        """Elements of joints, which stand after the links."""

    def write(self) -> RobotDocument:
        """Text of links in document order, then of joints depth first, and what it cannot represent."""
        parts = self.model_parts
        world = ""  # name of the link above a floating root
        if parts.floating:
            world = unused("world", self.link_names)
            self._link(world, SpatialInertia.zero())
        for link in parts.links.values():
            self._link(link.name, link.inertia)
        if parts.floating:
            joint = self._joint("root_joint", "floating", world, parts.root, np.eye(4))
            self._add_dynamics(joint, "root_joint")
        for entry in parts.joints:
            self._add_joint(entry)
        self._add_sites()
        self._note_others()
        self.robot.children = [*self.robot.children, *self.joint_elements]
        return RobotDocument(xml_text(self.robot), tuple(self.losses.found))

    def _link(self, name: str, inertia: SpatialInertia) -> None:
        """Add a link; an inertia of zero is left out."""
        self.link_names.add(name)
        link = new("link", self.robot, name=name)
        if not inertia.parameters.any():
            return
        inertial = new("inertial", link)
        new("origin", inertial, xyz=figures(inertia.com), rpy="0 0 0")
        new("mass", inertial, value=figures(inertia.mass))
        tensor_entries = entries_of(inertia.moment_about_com)
        new("inertia", inertial, **{entry: figures(value) for entry, value in tensor_entries.items()})

    def _joint(self, name: str, kind: str, parent: str, child: str, T: Array) -> Element:
        """New element of a joint with the pose T (4, 4) in its parent."""
        joint = Element("joint", {"name": name, "type": kind}, 0, self.robot)
        self.joint_elements.append(joint)
        new("parent", joint, link=parent)
        new("child", joint, link=child)
        if not np.array_equal(T, np.eye(4)):
            new("origin", joint, xyz=figures(T[:3, 3]), rpy=figures(rpy_of_rotation(T[:3, :3])))
        return joint

    def _add_massless_link(self, name: str) -> str:
        """Add a link without mass, and return its name: ``name``, or a variant of it if that is in use."""
        unused_name = unused(name, self.link_names)
        self._link(unused_name, SpatialInertia.zero())
        return unused_name

    def _add_joint(self, entry: JointEntry) -> None:
        """Add the elements of a joint."""
        kind = entry.joint.kind
        if kind == "ball":
            self._add_ball(entry)
            return
        if kind not in ("fixed", "floating", "planar"):
            self._add_screw(entry)
            return
        joint = self._joint(entry.name, kind, entry.parent, entry.child, entry.placement)
        if kind == "planar":
            normal = entry.joint.axes[0, :3]
            new("axis", joint, xyz=figures(normal))
        if kind != "fixed":
            self._add_dynamics(joint, entry.name)

    def _add_screw(self, entry: JointEntry) -> None:
        """Add a joint about or along one axis.

        An axis away from the child's origin needs a link on the axis, and a fixed joint from it to the child. A helical joint
        needs a link between its revolute and its prismatic joint.
        """
        screw = screw_of(entry)
        limits = entry.limits
        name = entry.name
        moved_link = entry.child
        T = entry.placement
        offset_joint = ""
        if screw.point.any():  # the format has axes through the child's origin
            moved_link = self._add_massless_link(f"{entry.child}:{name}")
            T = T @ translation(screw.point)
            offset_joint = unused(f"{name}.fixed", self.joint_names)
        turned_link = moved_link  # child of the joint itself
        if screw.pitch:
            turned_link = self._add_massless_link(f"{entry.child}:{name}:slide")
        has_no_position_limit = limits.lower[0] == -np.inf and limits.upper[0] == np.inf
        kind = "prismatic"
        if screw.turns and has_no_position_limit:
            kind = "continuous"
        elif screw.turns:
            kind = "revolute"
        joint = self._joint(name, kind, entry.parent, turned_link, T)
        new("axis", joint, xyz=figures(screw.direction))
        self._add_limit(joint, limits)
        self._add_dynamics(joint, name)
        if entry.mimic is not None:
            self._add_mimic(joint, *entry.mimic)
        if screw.pitch:
            slide_name = unused(f"{name}.slide", self.joint_names)
            slide = self._joint(slide_name, "prismatic", turned_link, moved_link, np.eye(4))
            new("axis", slide, xyz=figures(screw.direction))
            infinity = np.full(1, np.inf)
            no_limits = Limits(lower=-infinity, upper=infinity, velocity=infinity, effort=infinity)
            self._add_limit(slide, no_limits)
            self._add_mimic(slide, name, screw.pitch, 0.0)
            self.losses.note_joint(
                name, "is helical; it is written as a revolute joint and a prismatic one that mimics it"
            )
        if offset_joint:
            self._joint(offset_joint, "fixed", moved_link, entry.child, translation(-screw.point))

    def _add_ball(self, entry: JointEntry) -> None:
        """Add a ball joint as three revolute joints, with links without mass between them."""
        parent = entry.parent
        T = entry.placement
        for letter, axis in zip("xyz", np.eye(3), strict=True):
            name = unused(f"{entry.name}.{letter}", self.joint_names)
            child = entry.child
            if letter != "z":
                child = self._add_massless_link(f"{entry.child}:{name}")
            joint = self._joint(name, "continuous", parent, child, T)
            new("axis", joint, xyz=figures(axis))
            if letter == "x":  # one of the three has the losses of the ball
                self._add_dynamics(joint, entry.name)
            parent = child
            T = np.eye(4)
        self.losses.note_joint(entry.name, "is a ball joint; it is written as three revolute joints about x, y and z")

    def _add_limit(self, joint: Element, limits: Limits) -> None:
        """Add the limits of a joint with one degree of freedom; acceleration and jerk limits need version 1.2."""
        names = ["lower", "upper", "velocity", "effort"]
        is_continuous = joint.attributes["type"] == "continuous"
        if is_continuous:
            names = ["velocity", "effort"]
        limit_by_name = {name: float(getattr(limits, name)[0]) for name in names}
        limit_values = list(limit_by_name.values())
        is_any_finite = bool(np.isfinite(limit_values).any())
        finite_limits_of_1_2: dict[str, float] = {}
        for name in LIMITS_OF_1_2:
            limit = float(getattr(limits, name)[0])
            if np.isfinite(limit):
                finite_limits_of_1_2[name] = limit
        if finite_limits_of_1_2:
            self.robot.attributes["version"] = "1.2"
        elif is_continuous and not is_any_finite:  # the format requires <limit> of the other types only
            return
        limit_by_name |= finite_limits_of_1_2
        texts = {name: figures(np.clip(limit, -_NO_LIMIT, _NO_LIMIT)) for name, limit in limit_by_name.items()}
        new("limit", joint, **texts)

    def _add_mimic(self, joint: Element, leader: str, ratio: float, offset: float) -> None:
        """Let a joint follow: position = ratio * position of the leader + offset."""
        new("mimic", joint, joint=leader, multiplier=figures(ratio), offset=figures(offset))

    def _add_dynamics(self, element: Element, name: str) -> None:
        """Add damping and friction of the joint ``name`` to its element. An armature is noted as lost."""
        drive = drive_of(self.model_parts, name, self.losses)
        if drive.damping or drive.friction:
            new("dynamics", element, damping=figures(drive.damping), friction=figures(drive.friction))
        if drive.armature:
            self.losses.note_joint(name, "has an armature, which the format cannot represent")

    def _add_sites(self) -> None:
        """Add each site as a link without mass, by a fixed joint."""
        for site in self.model_parts.additions.sites.values():
            link_name = self._add_massless_link(site.name)
            joint_name = unused(f"{link_name}.fixed", self.joint_names)
            self._joint(joint_name, "fixed", site.link, link_name, site.pose)
            self.losses.note("site", site.name, "is written as a fixed link without mass")

    def _note_others(self) -> None:
        """Note the loss of springs, gravity, and of what only MJCF can represent."""
        parts = self.model_parts
        for spring in parts.additions.springs:
            joints = ", ".join(repr(joint) for joint, _ in spring.terms)
            self.losses.say(f"the spring of {joints} is left out: the format has none")
        if not np.array_equal(parts.gravity, GRAVITY):
            self.losses.say(
                f"gravity {parts.gravity.tolist()} is left out, which is not part of the format: load with gravity=…"
            )
        self.losses.note_unwritten(parts)
