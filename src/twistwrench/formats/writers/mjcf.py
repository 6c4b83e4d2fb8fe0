"""Text of an MJCF file from a model: bodies, joints, limits, drives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ...core.errors import ModelError
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.lie import quaternion, se3
from ...mechanics.model.assembly import ROOT_JOINT
from ...mechanics.model.description import JointEntry, unused
from ...mechanics.model.model import Model
from ...mechanics.model.parts import ModelParts, disassemble
from ..mjcf.drives import ROWS
from ..urdf import ENTRIES, IN_MJCF, LIMITS_OF_1_2
from ..xml import Element, figures, new, xml_text
from .written import Losses, RobotDocument, configurations_of, drive_of, screw_of

_NO_LIMIT = 1e10
"""Number for no limit on one side, as the format requires two."""


class MjcfJoints:
    """The joints of one file, in the order in which they are written."""

    def __init__(self, parts: ModelParts, equality: Element, losses: Losses) -> None:
        self.found, self.equality, self.losses = parts, equality, losses
        self.elements: dict[str, Element] = {}
        """By the names of joints."""
        self._names = {joint.name for joint in parts.joints} | {ROOT_JOINT}
        self._order: list[tuple[str, JointEntry]] = []
        """(form of its coordinates, joint) in the order of MuJoCo's qpos, without the root's."""

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
        joint = self._axis(body, entry.name, kind, direction, point if axis.turns else None)
        self._limits(joint, entry)
        self._drive(entry.name, [joint])
        self._order.append(("single", entry))
        if axis.pitch:
            slide = unused(f"{entry.name}.slide", self._names)
            self._axis(body, slide, "slide", direction)
            self._follow(slide, entry.name, axis.pitch, 0.0)
            self._order.append(("pitch", entry))
            self.losses.note_joint(
                entry.name, "is helical; it is written as a hinge and a slide that an equality joins, softly in MuJoCo"
            )
        if entry.mimic is not None:
            self._follow(entry.name, *entry.mimic)

    def _axis(self, body: Element, name: str, kind: str, direction: Array, point: Array | None = None) -> Element:
        """One hinge or slide of a body."""
        joint = new("joint", body, name=name, type=kind, axis=figures(direction))
        if point is not None and point.any():
            joint.attributes["pos"] = figures(point)
        return self.elements.setdefault(name, joint)

    def add_planar(self, entry: JointEntry, body: Element) -> None:
        """Two slides and a hinge."""
        w, e1, e2 = entry.joint.axes[0, :3], entry.joint.axes[1, 3:], entry.joint.axes[2, 3:]
        joints = []
        for letter, kind, direction in (("x", "slide", e1), ("y", "slide", e2), ("theta", "hinge", w)):
            name = unused(f"{entry.name}.{letter}", self._names)
            joints.append(self._axis(body, name, kind, direction))
        self._drive(entry.name, joints)
        self._order.append(("planar", entry))
        self.losses.note_joint(
            entry.name,
            "is planar; it is written as two slides and a hinge, whose velocities are those of x, y and theta",
        )

    def _follow(self, joint: str, leader: str, ratio: float, offset: float) -> None:
        new("joint", self.equality, joint1=joint, joint2=leader, polycoef=figures([offset, ratio, 0, 0, 0]))

    def _limits(self, joint: Element, entry: JointEntry) -> None:
        limits = entry.limits
        ends = np.array([limits.lower[0], limits.upper[0]])
        if np.isfinite(ends).any():
            joint.attributes["range"] = figures(np.clip(ends, -_NO_LIMIT, _NO_LIMIT))
            if not np.isfinite(ends).all():
                self.losses.note_joint(
                    entry.name, f"has a limit on one side only; the other one is written as {printed(_NO_LIMIT)}"
                )
        if np.isfinite(limits.effort[0]):
            joint.attributes["actuatorfrcrange"] = figures([-limits.effort[0], limits.effort[0]])
        self.losses.note_limits(entry.name, limits, "velocity", *LIMITS_OF_1_2)

    def _drive(self, name: str, joints: list[Element]) -> None:
        drive = drive_of(self.found, name, self.losses)
        values = {"damping": drive.damping, "frictionloss": drive.friction, "armature": drive.armature}
        attributes = {name: figures(value) for name, value in values.items() if value}
        for joint in joints:
            joint.attributes |= attributes

    def qpos(self, positions: Mapping[str, Array]) -> Iterator[Array]:
        """The coordinates of each joint as MuJoCo has them."""
        if self.found.floating:
            yield _position_first(positions[ROOT_JOINT])
        for form, entry in self._order:
            leader, ratio, offset = entry.mimic or (entry.name, 1.0, 0.0)
            q = ratio * positions[leader] + offset
            if form == "floating":
                yield _position_first(q)
            elif form == "pitch":
                yield screw_of(entry).pitch * q
            else:
                yield q


def _position_first(q: Array) -> Array:
    """(x, y, z, qw, qx, qy, qz) of (qw, qx, qy, qz, x, y, z)."""
    return np.concatenate([q[4:], q[:4]])


WORLD = "world"
_MIN_INERTIA = 1e-14
"""MuJoCo's least moment of a body, and mass of one that moves."""
_ROUNDING = 4e-15
"""Rounding of principal moments, relative to the largest."""


def write_mjcf(model: Model) -> RobotDocument:
    """The MJCF file of a model. Each moving body has the inertia of all that is fixed to it."""
    return _MjcfWriter(disassemble(model)).write()


class _MjcfWriter:
    """Writer of one model."""

    def __init__(self, parts: ModelParts) -> None:
        self.found, self.losses = parts, Losses()
        self.losses.note_couplings(parts)
        self.root = new("mujoco", model=parts.name)
        new("compiler", self.root, angle="radian", inertiafromgeom="false")
        new("option", self.root, gravity=figures(parts.gravity))
        self.world = new("worldbody", self.root)
        self.equality = Element("equality", {}, 0, self.root)
        self.tendon = Element("tendon", {}, 0, self.root)
        self.keyframe = Element("keyframe", {}, 0, self.root)
        self.joints = MjcfJoints(parts, self.equality, self.losses)
        self.bodies: dict[str, Element] = {}
        self.children: dict[str, list[JointEntry]] = {}
        for joint in parts.joints:
            self.children.setdefault(joint.parent, []).append(joint)
        self.named = {site.link for site in parts.additions.sites.values()}
        """Links that sites and closures are at."""
        for closure in parts.additions.closures.values():
            self.named |= {closure.frame_a, closure.frame_b}
        self.standing: set[str] = set()
        """Links that do not move and keep an inertia of their own, as the world has none."""

    def write(self) -> RobotDocument:
        """Write nested bodies, then tendons, equalities and keyframes."""
        found = self.found
        if found.floating or found.root != WORLD:
            self.bodies[found.root] = self._body(found.root, self.world, np.eye(4), found.whole[found.root])
            if found.floating:
                self.joints.add_free(self.bodies[found.root])
        else:
            self.bodies[WORLD] = self.world
            self.standing.add(WORLD)
            self.losses.note_mass_of_world(found)
        pending: dict[str, tuple[JointEntry, ...]] = {}
        for entry in found.joints:
            before = pending.pop(entry.parent, ())
            if (before or not entry.fixed) and self._is_between(entry):
                pending[entry.child] = (*before, entry)
            else:
                self._add((*before, entry))
        self._add_sites()
        self._add_springs()
        self._add_configurations()
        self._add_closures()
        for part in (self.tendon, self.equality, self.keyframe):
            if part.children:
                self.root.add(part)
        return RobotDocument(xml_text(self.root), tuple(self.losses.found))

    def _is_between(self, entry: JointEntry) -> bool:
        """True if the child of a joint only stands between two joints, which then are joints of one body."""
        link = self.found.links[entry.child]
        while entry.joint.nv == int(not entry.fixed) and entry.child not in self.named:
            following = self.children.get(entry.child, [])
            if self.found.links[entry.child].inertia.parameters.any() or len(following) != 1:
                return False
            (entry,) = following
            if not entry.fixed:
                break
        else:
            return False
        if entry.joint.nv == 1 and not link.hidden:
            text = "has no mass; its joint moves the next body with mass, and its frame is lost"
            self.losses.note("link", link.name, text)
        return entry.joint.nv == 1

    def _body(self, name: str, parent: Element, T: Array, inertia: SpatialInertia | None) -> Element:
        name_in_file = name if name != WORLD else unused(name, {WORLD, *self.found.links})
        if name_in_file != name:
            self.losses.say(f"link {name!r} is written as {name_in_file!r}, for the world itself has its name")
        body = new("body", parent, name=name_in_file)
        body.attributes |= _pose(T)
        moves = self.found.floating or (name != self.found.root and name not in self.standing)
        if inertia is not None and (moves or inertia.parameters.any()):
            self._add_inertial(body, name, inertia, moves)
        return body

    def _add_inertial(self, body: Element, link: str, inertia: SpatialInertia, moves: bool) -> None:
        """Write the inertial of a body; a loss if MuJoCo does not compile it."""
        I = inertia.moment_about_com
        small, middle, large = np.linalg.eigvalsh(I)
        surplus = small + middle - large  # of the triangle inequality; zero for a flat body
        if abs(surplus) <= _ROUNDING * large:  # exactly flat in exact numbers, but perhaps not to MuJoCo's last digit
            I = I + _ROUNDING * large * np.eye(3)
        defect = ""
        if inertia.mass < _MIN_INERTIA:
            defect = "has no mass"
        elif small < _MIN_INERTIA:
            defect = "has a mass without inertia about some axis"
        elif surplus < -_ROUNDING * large:
            defect = "has physically impossible moments of inertia"
        if defect and moves:
            self.losses.note("link", link, f"moves and {defect}: MuJoCo does not compile the file")
        elif defect:
            self.losses.note("link", link, f"stands still and {defect}: its inertia is left out")
            return
        if inertia.parameters.any():
            full = [I[ENTRIES[name]] for name in IN_MJCF]
            new("inertial", body, pos=figures(inertia.com), mass=figures(inertia.mass), fullinertia=figures(full))

    def _add(self, entries: tuple[JointEntry, ...]) -> None:
        """A body with its joints, the last of which is that of its link."""
        first, last = entries[0], entries[-1]
        parent, kind = self.bodies[first.parent], last.joint.kind
        poses = [np.eye(4)]  # of the body's frame in each joint's child, all coordinates at zero
        for entry in reversed(entries):
            poses.insert(0, np.asarray(entry.placement @ poses[0]))
        inertia = self._inertia(last)
        if kind == "floating":
            if parent is not self.world or not np.array_equal(poses[0], np.eye(4)):
                raise ModelError(
                    f"joint {last.name!r} floats away from the world's origin, and MJCF has no joint for that. Lock it."
                )
            self.bodies[last.child] = self._body(last.child, parent, np.eye(4), inertia)
            self.joints.add_free(self.bodies[last.child], last)
            return
        body = self.bodies[last.child] = self._body(last.child, parent, poses[0], inertia)
        for entry, T in zip(entries, poses[1:], strict=True):
            if entry.fixed:
                continue
            if entry.joint.kind == "ball":
                self.joints.add_ball(entry, body)
            elif entry.joint.kind == "planar":
                self.joints.add_planar(entry, body)
            else:
                self.joints.add_screw(entry, body, T)

    def _inertia(self, entry: JointEntry) -> SpatialInertia | None:
        """Inertia of the body of a joint: with all that is fixed to it if it moves, alone if it stands in the world."""
        if not entry.fixed:
            return self.found.whole[entry.child]
        if entry.parent in self.standing:
            self.standing.add(entry.child)
            return self.found.links[entry.child].inertia
        return None

    def _add_sites(self) -> None:
        for site in self.found.additions.sites.values():
            body = self.bodies[site.link]
            element = new("site", body, name=site.name.removeprefix("site:"))
            element.attributes |= _pose(site.pose)

    def _add_springs(self) -> None:
        for spring in self.found.additions.springs:
            (first, weight), *others = spring.terms
            joint = self.joints.elements[first]
            if not others and "stiffness" not in joint.attributes:
                joint.attributes["stiffness"] = figures(spring.stiffness * weight**2)
                if spring.rest:
                    joint.attributes["springref"] = figures(spring.rest / weight)
                continue
            sign = -1.0 if spring.rest < 0 else 1.0  # a length is not negative
            tendon = new(
                "fixed", self.tendon, stiffness=figures(spring.stiffness), springlength=figures(sign * spring.rest)
            )
            for name, coefficient in spring.terms:
                new("joint", tendon, joint=name, coef=figures(sign * coefficient))

    def _add_configurations(self) -> None:
        for name, positions in configurations_of(self.found).items():
            qpos = np.concatenate([np.zeros(0), *self.joints.qpos(positions)])
            new("key", self.keyframe, name=name, qpos=figures(qpos))

    def _add_closures(self) -> None:
        tags = {rows: tag for tag, rows in ROWS.items()}
        for name, closure in self.found.additions.closures.items():
            if closure.rows not in tags:
                self.losses.note("closure", name, f"holds {closure.rows}, which the format cannot represent")
                continue
            site1, site2 = self._site_at(closure.frame_a), self._site_at(closure.frame_b)
            new(tags[closure.rows], self.equality, name=name, site1=site1, site2=site2)

    def _site_at(self, frame: str) -> str:
        """Site of a frame, new for a link, for elements that refer to sites only."""
        sites = self.found.additions.sites
        if frame in sites:
            return frame.removeprefix("site:")
        name = unused(f"{frame}.site", {site.removeprefix("site:") for site in sites})
        new("site", self.bodies[frame], name=name)
        return name


def _pose(T: Array) -> dict[str, str]:
    """Attributes of position and orientation, without identities."""
    attributes = {}
    if T[:3, 3].any():
        attributes["pos"] = figures(T[:3, 3])
    if not np.array_equal(T[:3, :3], np.eye(3)):
        attributes["quat"] = figures(quaternion.from_matrix(T[:3, :3]))
    return attributes
