"""The joints of MJCF bodies: hinges, slides, ball and free joints, with their limits and drives, and MuJoCo's coordinates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...core.printed_numbers import printed
from ...lie import se3
from ...model.assembly import ROOT_JOINT
from ...model.description import JointEntry
from ...model.outline import Outline
from ...typing import Array
from ..element import Element
from ..xml_text import figures, new
from .written import Losses, drive_of, screw_of, unused

_FAR = 1e10
"""Stands for no limit on one side, where the format wants two numbers."""


@dataclass(frozen=True, eq=False)
class _Axis:
    """One hinge or slide of a body."""

    name: str
    kind: str
    direction: Array
    point: Array


class MjcfJoints:
    """The joints of one file, in the order in which they are written."""

    def __init__(self, found: Outline, equality: Element, losses: Losses) -> None:
        self.found, self.equality, self.losses = found, equality, losses
        self.elements: dict[str, Element] = {}
        """By the names of joints."""
        self._names = {joint.name for joint in found.joints} | {ROOT_JOINT}
        self._order: list[tuple[str, JointEntry]] = []
        """(how its coordinates are written, joint) in the order of MuJoCo's qpos, but for the root's."""

    def add_free(self, body: Element, entry: JointEntry | None = None) -> None:
        """The joint of a floating body: an entry, or the root's."""
        name = ROOT_JOINT if entry is None else entry.name
        joint = self.elements[name] = new("freejoint", body, name=name)
        self._drive(name, [joint])
        if len(joint.attributes) > 1:  # the short form has a name alone
            joint.tag, joint.attributes = "joint", {"name": name, "type": "free", **joint.attributes}
        if entry is not None:
            self._order.append(("floating", entry))

    def add_ball(self, entry: JointEntry, body: Element) -> None:
        """A ball joint at the body's origin."""
        joint = self.elements[entry.name] = new("joint", body, name=entry.name, type="ball")
        self._drive(entry.name, [joint])
        self._order.append(("ball", entry))

    def add_screw(self, entry: JointEntry, body: Element, T: Array) -> None:
        """A hinge, a slide, or both; ``T`` is the pose of the body in the joint's child."""
        axis = screw_of(entry)
        direction, point = axis.direction, axis.point
        if not np.array_equal(T, np.eye(4)):  # the joint of a hidden link, seen from the body
            back = se3.inverse(T)
            direction, point = back[:3, :3] @ direction, back[:3, :3] @ point + back[:3, 3]
        kind = "hinge" if axis.turns else "slide"
        joint = self._axis(body, _Axis(entry.name, kind, direction, point if axis.turns else np.zeros(3)))
        self._limits(joint, entry)
        self._drive(entry.name, [joint])
        self._order.append(("single", entry))
        if axis.pitch:
            slide = self._name(f"{entry.name}.slide")
            self._axis(body, _Axis(slide, "slide", direction, np.zeros(3)))
            self._follow(slide, entry.name, axis.pitch, 0.0)
            self._order.append(("pitch", entry))
            self.losses.of_joint(
                entry.name, "is helical; it is written as a hinge and a slide that an equality joins, softly in MuJoCo"
            )
        if entry.mimic is not None:
            self._follow(entry.name, *entry.mimic)

    def _axis(self, body: Element, axis: _Axis) -> Element:
        joint = new("joint", body, name=axis.name, type=axis.kind, axis=figures(axis.direction))
        if axis.point.any():
            joint.attributes["pos"] = figures(axis.point)
        return self.elements.setdefault(axis.name, joint)

    def add_planar(self, entry: JointEntry, body: Element) -> None:
        """Two slides and a hinge."""
        w, e1, e2 = entry.joint.axes[0, :3], entry.joint.axes[1, 3:], entry.joint.axes[2, 3:]
        parts = [
            self._axis(body, _Axis(self._name(f"{entry.name}.{letter}"), kind, direction, np.zeros(3)))
            for letter, kind, direction in (("x", "slide", e1), ("y", "slide", e2), ("theta", "hinge", w))
        ]
        self._drive(entry.name, parts)
        self._order.append(("planar", entry))
        self.losses.of_joint(
            entry.name,
            "is planar; it is written as two slides and a hinge, whose velocities are those of x, y and theta",
        )

    def _name(self, name: str) -> str:
        name = unused(name, self._names)
        self._names.add(name)
        return name

    def _follow(self, joint: str, leader: str, ratio: float, offset: float) -> None:
        new("joint", self.equality, joint1=joint, joint2=leader, polycoef=figures([offset, ratio, 0, 0, 0]))

    def _limits(self, joint: Element, entry: JointEntry) -> None:
        limits = entry.limits
        ends = np.array([limits.lower[0], limits.upper[0]])
        if np.isfinite(ends).any():
            joint.attributes["range"] = figures(np.clip(ends, -_FAR, _FAR))
            if not np.isfinite(ends).all():
                self.losses.of_joint(
                    entry.name, f"has a limit on one side only; the other one is written as {printed(_FAR)}"
                )
        if np.isfinite(limits.effort[0]):
            joint.attributes["actuatorfrcrange"] = figures([-limits.effort[0], limits.effort[0]])
        if np.isfinite(limits.velocity[0]):
            self.losses.of_joint(entry.name, "has a limit of velocity, which the format cannot say")

    def _drive(self, name: str, joints: list[Element]) -> None:
        drive = drive_of(self.found, name, self.losses)
        said = {"damping": drive.damping, "frictionloss": drive.friction, "armature": drive.armature}
        for joint in joints:
            joint.attributes |= {what: figures(value) for what, value in said.items() if value}

    def qpos(self, positions: Mapping[str, Array]) -> Iterator[Array]:
        """The coordinates of each joint as MuJoCo has them."""
        if self.found.floating:
            yield _placed_first(positions[ROOT_JOINT])
        for form, entry in self._order:
            leader, ratio, offset = entry.mimic or (entry.name, 1.0, 0.0)
            q = ratio * positions[leader] + offset
            if form == "floating":
                yield _placed_first(q)
            else:
                yield screw_of(entry).pitch * q if form == "pitch" else q


def _placed_first(q: Array) -> Array:
    """(x, y, z, qw, qx, qy, qz) of (qw, qx, qy, qz, x, y, z)."""
    return np.concatenate([q[4:], q[:4]])
