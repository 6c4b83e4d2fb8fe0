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
"""Limit that is written on a side without one, since the format requires both."""


class MjcfJoints:
    """Writer of the joints of one file."""

    def __init__(self, parts: ModelParts, equality: Element, losses: Losses) -> None:
        self.parts = parts
        self.equality = equality
        self.losses = losses
        self.elements: dict[str, Element] = {}
        """Element of each joint by name; of the hinge of a helical joint."""
        self._used_names = {joint.name for joint in parts.joints} | {ROOT_JOINT}
        self._qpos_joints: list[tuple[str, JointEntry]] = []
        """Form of the coordinates, and joint, for each part of MuJoCo's qpos in order, without the root joint."""

    def add_free(self, body: Element, entry: JointEntry | None = None) -> None:
        """Add the joint of a floating body: ``entry``, or the root joint if None."""
        name = ROOT_JOINT if entry is None else entry.name
        joint = new("freejoint", body, name=name)
        self.elements[name] = joint
        self._drive(name, [joint])
        if len(joint.attributes) > 1:  # <freejoint> may have a name only
            joint.tag = "joint"
            joint.attributes = {"name": name, "type": "free", **joint.attributes}
        if entry is not None:
            self._qpos_joints.append(("floating", entry))

    def add_ball(self, entry: JointEntry, body: Element) -> None:
        """Add a ball joint at the body's origin."""
        joint = new("joint", body, name=entry.name, type="ball")
        self.elements[entry.name] = joint
        self._drive(entry.name, [joint])
        self._qpos_joints.append(("ball", entry))

    def add_screw(self, entry: JointEntry, body: Element, T: Array) -> None:
        """Add a hinge, a slide, or both for a helical joint; ``T`` is the pose of the body in the joint's child link."""
        screw = screw_of(entry)
        direction, point = screw.direction, screw.point  # in the frame of the child
        if not np.array_equal(T, np.eye(4)):  # the child is a hidden link, which is not written
            T_inverse = se3.inverse(T)
            direction = T_inverse[:3, :3] @ direction
            point = T_inverse[:3, :3] @ point + T_inverse[:3, 3]
        if screw.turns:
            joint = self._add_axis(body, entry.name, "hinge", direction, point)
        else:
            joint = self._add_axis(body, entry.name, "slide", direction)
        self._limits(joint, entry)
        self._drive(entry.name, [joint])
        self._qpos_joints.append(("single", entry))
        if screw.pitch:
            slide_name = unused(f"{entry.name}.slide", self._used_names)
            self._add_axis(body, slide_name, "slide", direction)
            self._follow(slide_name, entry.name, screw.pitch, 0.0)
            self._qpos_joints.append(("pitch", entry))
            self.losses.note_joint(
                entry.name, "is helical; it is written as a hinge and a slide that an equality joins, softly in MuJoCo"
            )
        if entry.mimic is not None:
            leader, ratio, offset = entry.mimic
            self._follow(entry.name, leader, ratio, offset)

    def _add_axis(self, body: Element, name: str, kind: str, direction: Array, point: Array | None = None) -> Element:
        """Add a hinge or slide to a body, and return its element; a hinge turns about a line through ``point``."""
        joint = new("joint", body, name=name, type=kind, axis=figures(direction))
        if point is not None and point.any():
            joint.attributes["pos"] = figures(point)
        return self.elements.setdefault(name, joint)

    def add_planar(self, entry: JointEntry, body: Element) -> None:
        """Add two slides and a hinge in place of a planar joint, whose axes are (w, 0), (0, x) and (0, y)."""
        w_axis, x_axis, y_axis = entry.joint.axes
        single_axes = (
            ("x", "slide", x_axis[3:]),
            ("y", "slide", y_axis[3:]),
            ("theta", "hinge", w_axis[:3]),
        )
        joints = []
        for suffix, kind, direction in single_axes:
            name = unused(f"{entry.name}.{suffix}", self._used_names)
            joints.append(self._add_axis(body, name, kind, direction))
        self._drive(entry.name, joints)
        self._qpos_joints.append(("planar", entry))
        self.losses.note_joint(
            entry.name,
            "is planar; it is written as two slides and a hinge, whose velocities are those of x, y and theta",
        )

    def _follow(self, joint: str, leader: str, ratio: float, offset: float) -> None:
        """Add the equality joint = ratio · leader + offset."""
        coefficients = [offset, ratio, 0, 0, 0]  # of the powers of the leader's position
        new("joint", self.equality, joint1=joint, joint2=leader, polycoef=figures(coefficients))

    def _limits(self, joint: Element, entry: JointEntry) -> None:
        """Write the limits of a joint of one degree of freedom; limits that the format does not have are noted as losses."""
        limits = entry.limits
        bounds = np.array([limits.lower[0], limits.upper[0]])
        if np.isfinite(bounds).any():
            joint.attributes["range"] = figures(np.clip(bounds, -_NO_LIMIT, _NO_LIMIT))
            if not np.isfinite(bounds).all():
                self.losses.note_joint(
                    entry.name, f"has a limit on one side only; the other one is written as {printed(_NO_LIMIT)}"
                )
        if np.isfinite(limits.effort[0]):
            joint.attributes["actuatorfrcrange"] = figures([-limits.effort[0], limits.effort[0]])
        self.losses.note_limits(entry.name, limits, "velocity", *LIMITS_OF_1_2)

    def _drive(self, name: str, joints: list[Element]) -> None:
        """Write damping, friction and armature of a joint into the elements that represent it."""
        drive = drive_of(self.parts, name, self.losses)
        values = {"damping": drive.damping, "frictionloss": drive.friction, "armature": drive.armature}
        attributes = {attribute: figures(value) for attribute, value in values.items() if value != 0}
        for joint in joints:
            joint.attributes |= attributes

    def qpos(self, positions: Mapping[str, Array]) -> Iterator[Array]:
        """Coordinates of each joint in the order and form of MuJoCo's qpos, from ``positions`` by joint without followers."""
        if self.parts.floating:
            yield _mujoco_free_coordinates(positions[ROOT_JOINT])
        for form, entry in self._qpos_joints:
            leader, ratio, offset = entry.name, 1.0, 0.0
            if entry.mimic is not None:
                leader, ratio, offset = entry.mimic
            q = ratio * positions[leader] + offset
            if form == "floating":
                yield _mujoco_free_coordinates(q)
            elif form == "pitch":
                yield screw_of(entry).pitch * q
            else:
                yield q


def _mujoco_free_coordinates(q: Array) -> Array:
    """Coordinates (x, y, z, qw, qx, qy, qz) of a free joint, from (qw, qx, qy, qz, x, y, z)."""
    return np.concatenate([q[4:], q[:4]])


WORLD = "world"
"""Name of a root link that stands for the world itself."""
_MIN_INERTIA = 1e-14
"""Least mass [kg] and least principal moment [kg m²] of a moving body that MuJoCo accepts."""
_MAX_ROUNDING = 4e-15
"""Rounding of principal moments, relative to the largest."""


def write_mjcf(model: Model) -> RobotDocument:
    """MJCF file of a model. The inertia of a moving body includes all links that are fixed to it."""
    return _MjcfWriter(disassemble(model)).write()


class _MjcfWriter:
    """Writer of one model."""

    def __init__(self, parts: ModelParts) -> None:
        self.parts = parts
        self.losses = Losses()
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
        """Element of the body of each written link, by the link's name."""
        self.child_joints: dict[str, list[JointEntry]] = {}
        """Joints by the name of their parent link."""
        for joint in parts.joints:
            self.child_joints.setdefault(joint.parent, []).append(joint)
        self.referenced_links = {site.link for site in parts.additions.sites.values()}
        """Links to which sites and closures refer."""
        for closure in parts.additions.closures.values():
            self.referenced_links |= {closure.frame_a, closure.frame_b}
        self.links_in_world: set[str] = set()
        """Links that are fixed in the world. They keep their inertia, which MuJoCo's world body cannot have."""

    def write(self) -> RobotDocument:
        """Write nested bodies, then tendons, equalities and keyframes."""
        parts = self.parts
        if parts.floating or parts.root != WORLD:
            self.bodies[parts.root] = self._body(parts.root, self.world, np.eye(4), parts.whole[parts.root])
            if parts.floating:
                self.joints.add_free(self.bodies[parts.root])
        else:
            self.bodies[WORLD] = self.world
            self.links_in_world.add(WORLD)
            self.losses.note_mass_of_world(parts)
        # Joints of each body that is not written yet, by the child link of the last one.
        pending_joints: dict[str, tuple[JointEntry, ...]] = {}
        for entry in parts.joints:
            earlier_joints = pending_joints.pop(entry.parent, ())
            may_share_body = bool(earlier_joints) or not entry.fixed
            if may_share_body and self._shares_body_with_next(entry):
                pending_joints[entry.child] = (*earlier_joints, entry)
            else:
                self._add_body_with_joints((*earlier_joints, entry))
        self._add_sites()
        self._add_springs()
        self._add_configurations()
        self._add_closures()
        for section in (self.tendon, self.equality, self.keyframe):
            if section.children:
                self.root.add(section)
        return RobotDocument(xml_text(self.root), tuple(self.losses.found))

    def _shares_body_with_next(self, entry: JointEntry) -> bool:
        """True if a joint and the next moving one are joints of one body, since the link between them is not needed.

        Such a link has no mass, no site and one child joint. Both joints have one degree of freedom. Fixed joints may stand
        between them, with links of this kind. The loss of the first link is noted unless it is hidden.
        """
        first_link = self.parts.links[entry.child]
        while True:
            has_several_degrees = entry.joint.nv != int(not entry.fixed)
            if has_several_degrees or entry.child in self.referenced_links:
                return False
            child_joints = self.child_joints.get(entry.child, [])
            if self.parts.links[entry.child].inertia.parameters.any() or len(child_joints) != 1:
                return False
            (entry,) = child_joints
            if not entry.fixed:
                break
        if entry.joint.nv != 1:
            return False
        if not first_link.hidden:
            text = "has no mass; its joint moves the next body with mass, and its frame is lost"
            self.losses.note("link", first_link.name, text)
        return True

    def _body(self, name: str, parent: Element, T: Array, inertia: SpatialInertia | None) -> Element:
        """Add the body of a link to its parent body, with its pose ``T`` and inertia, and return its element."""
        name_in_file = name
        if name == WORLD:
            name_in_file = unused(name, {WORLD, *self.parts.links})
            self.losses.say(f"link {name!r} is written as {name_in_file!r}, for the world itself has its name")
        body = new("body", parent, name=name_in_file)
        body.attributes |= _pose_attributes(T)
        is_fixed_root = name == self.parts.root and not self.parts.floating
        moves = not is_fixed_root and name not in self.links_in_world
        if inertia is not None and (moves or inertia.parameters.any()):
            self._add_inertial(body, name, inertia, moves)
        return body

    def _add_inertial(self, body: Element, link: str, inertia: SpatialInertia, moves: bool) -> None:
        """Write the inertial of a body; an inertia that MuJoCo does not compile is noted as a loss."""
        I = inertia.moment_about_com
        smallest, middle, largest = np.linalg.eigvalsh(I)
        surplus = smallest + middle - largest  # negative if the triangle inequality is violated, zero for a flat body
        if abs(surplus) <= _MAX_ROUNDING * largest:
            # Without an addition, MuJoCo may find a violation in the last digit of a flat body.
            I = I + _MAX_ROUNDING * largest * np.eye(3)
        defect = ""
        if inertia.mass < _MIN_INERTIA:
            defect = "has no mass"
        elif smallest < _MIN_INERTIA:
            defect = "has a mass without inertia about some axis"
        elif surplus < -_MAX_ROUNDING * largest:
            defect = "has physically impossible moments of inertia"
        if defect and moves:
            self.losses.note("link", link, f"moves and {defect}: MuJoCo does not compile the file")
        elif defect:
            self.losses.note("link", link, f"stands still and {defect}: its inertia is left out")
            return
        if inertia.parameters.any():
            tensor = [I[ENTRIES[name]] for name in IN_MJCF]
            new("inertial", body, pos=figures(inertia.com), mass=figures(inertia.mass), fullinertia=figures(tensor))

    def _add_body_with_joints(self, entries: tuple[JointEntry, ...]) -> None:
        """Add a body with its joints; the child of the last joint is the body's link."""
        parent = self.bodies[entries[0].parent]
        last_entry = entries[-1]
        # Poses of the body's frame in the child link of each joint, with all coordinates at zero.
        pose_in_parent = np.eye(4)
        poses_in_children: list[Array] = []
        for entry in reversed(entries):
            poses_in_children.insert(0, pose_in_parent)
            pose_in_parent = np.asarray(entry.placement @ pose_in_parent)
        inertia = self._inertia(last_entry)
        if last_entry.joint.kind == "floating":
            if parent is not self.world or not np.array_equal(pose_in_parent, np.eye(4)):
                raise ModelError(
                    f"joint {last_entry.name!r} floats away from the world's origin, and MJCF has no joint for that. Lock it."
                )
            body = self._body(last_entry.child, parent, np.eye(4), inertia)
            self.bodies[last_entry.child] = body
            self.joints.add_free(body, last_entry)
            return
        body = self._body(last_entry.child, parent, pose_in_parent, inertia)
        self.bodies[last_entry.child] = body
        for entry, pose_in_child in zip(entries, poses_in_children, strict=True):
            if entry.fixed:
                continue
            if entry.joint.kind == "ball":
                self.joints.add_ball(entry, body)
            elif entry.joint.kind == "planar":
                self.joints.add_planar(entry, body)
            else:
                self.joints.add_screw(entry, body, pose_in_child)

    def _inertia(self, entry: JointEntry) -> SpatialInertia | None:
        """Inertia that is written with a joint's child link.

        It includes all links fixed to a moving link. A link that is fixed in the world has its own inertia, and a link that
        is fixed to a moving one has None.
        """
        if not entry.fixed:
            return self.parts.whole[entry.child]
        if entry.parent in self.links_in_world:
            self.links_in_world.add(entry.child)
            return self.parts.links[entry.child].inertia
        return None

    def _add_sites(self) -> None:
        """Write sites into their bodies."""
        for site in self.parts.additions.sites.values():
            body = self.bodies[site.link]
            element = new("site", body, name=site.name.removeprefix("site:"))
            element.attributes |= _pose_attributes(site.pose)

    def _add_springs(self) -> None:
        """Write springs as attributes of a joint, or as tendons if they act on several joints.

        The energy of a spring is ½ k (Σ coefficient · position - rest)².
        """
        for spring in self.parts.additions.springs:
            first_joint, first_coefficient = spring.terms[0]
            joint = self.joints.elements[first_joint]
            if len(spring.terms) == 1 and "stiffness" not in joint.attributes:
                joint.attributes["stiffness"] = figures(spring.stiffness * first_coefficient**2)
                if spring.rest:
                    joint.attributes["springref"] = figures(spring.rest / first_coefficient)
                continue
            sign = -1.0 if spring.rest < 0 else 1.0  # the length of a tendon must not be negative
            tendon = new(
                "fixed", self.tendon, stiffness=figures(spring.stiffness), springlength=figures(sign * spring.rest)
            )
            for name, coefficient in spring.terms:
                new("joint", tendon, joint=name, coef=figures(sign * coefficient))

    def _add_configurations(self) -> None:
        """Write named configurations as keyframes."""
        for name, positions in configurations_of(self.parts).items():
            qpos = np.concatenate([np.zeros(0), *self.joints.qpos(positions)])  # zeros(0): an array even without joints
            new("key", self.keyframe, name=name, qpos=figures(qpos))

    def _add_closures(self) -> None:
        """Write closures as equalities between two sites."""
        tag_of_rows = {rows: tag for tag, rows in ROWS.items()}
        for name, closure in self.parts.additions.closures.items():
            if closure.rows not in tag_of_rows:
                self.losses.note("closure", name, f"holds {closure.rows}, which the format cannot represent")
                continue
            site1 = self._site_at(closure.frame_a)
            site2 = self._site_at(closure.frame_b)
            new(tag_of_rows[closure.rows], self.equality, name=name, site1=site1, site2=site2)

    def _site_at(self, frame: str) -> str:
        """Name of the site of a frame; a link gets a new site, since closures refer to sites only."""
        sites = self.parts.additions.sites
        if frame in sites:
            return frame.removeprefix("site:")
        used_names = {site.removeprefix("site:") for site in sites}
        name = unused(f"{frame}.site", used_names)
        new("site", self.bodies[frame], name=name)
        return name


def _pose_attributes(T: Array) -> dict[str, str]:
    """Attributes of position and orientation; a zero position and an identity rotation are left out."""
    attributes = {}
    R, p = T[:3, :3], T[:3, 3]
    if p.any():
        attributes["pos"] = figures(p)
    orientation = figures(quaternion.from_matrix(R))
    if orientation != "1 0 0 0":  # nor is a rotation by rounding errors written
        attributes["quat"] = orientation
    return attributes
