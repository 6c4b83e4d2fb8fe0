"""Links and joints of a model, for writing, joining and extraction, and reassembly of a model from them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..joints import Fixed, Joint
from ..lie import se3
from .actuation import is_in_link_mass, with_actuators
from .actuators import Actuator
from .assembly import ROOT_JOINT, Additions, assemble, default_tip
from .description import JointEntry, LinkEntry, SiteEntry, unused
from .limits import LAWS, Friction, Limits
from .mimic import find_drives
from .model import BASE, Body, Model
from .tree import find_tree

if TYPE_CHECKING:
    from .couplings import Coupling

_MIN_SIZE_SHARE = 1e-3
"""Size of mass, first moment or moments of inertia, relative to the largest entry, below which it is not the reference."""
_MAX_ROUNDING = 1e-13
"""Largest difference between a body's inertia and the sum of its links' inertias, relative to the largest entry."""


@dataclass(eq=False)
class ModelParts:
    """Links of a model with one inertia each, joints between them (also fixed ones), and other entries.

    Rotors are not bodies here; they belong to the actuators.
    """

    name: str
    gravity: Array
    snap: float
    source: str
    root: str
    """Fixed root link, or the first moving link of a floating base."""
    floating: bool
    """True if the root link is on a floating joint."""
    links: dict[str, LinkEntry] = field(default_factory=dict)
    """Links in document order."""
    joints: list[JointEntry] = field(default_factory=list)
    """Joints depth first, moving ones in the order of q; armature and friction are stored separately."""
    whole: dict[str, SpatialInertia] = field(default_factory=dict)
    """Whole inertia of the root and of each link on a moving joint, including everything fixed to it."""
    friction: dict[str, Friction] = field(default_factory=dict)
    """Friction by name of the joint, or of the motor behind its elastic gear; arrays of the shape (nv of the joint,)."""
    armature: dict[str, Array] = field(default_factory=dict)
    """Armature by joint, without rotors."""
    actuators: list[Actuator] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    """Coupled drives; friction, armature and effort of their joints are those of the motors at the same indices."""
    payloads: tuple[tuple[str, SpatialInertia], ...] = ()
    """Frame and inertia of each payload."""
    additions: Additions = field(default_factory=Additions)
    """Sites, springs, configurations, closures, joints with motors, locked joints, and what is stated about the base."""


def disassemble(model: Model, *, extra: bool = True) -> ModelParts:
    """Links and joints of a model.

    Link inertias include the rotors on the links that the file counts; with ``extra`` also the rotors that it does not count.
    Links that are fixed together are separated as described in the file. Later changes of a body's inertia, such as a
    payload at a site or a repair, are assigned to the link on its joint.
    """
    return _Disassembly(model, extra).parts()


class _Disassembly:
    """Conversion of one model to links and joints."""

    def __init__(self, model: Model, extra: bool) -> None:
        self.model, self.extra = model, extra
        self.body_indices = {body.link: i for i, body in enumerate(model.bodies) if body.joint.moves_body}
        """Index of the body of each link on a moving joint."""
        self.motors: dict[str, Body] = {}
        """Motors behind elastic gears, which have coordinates of their own, by the joint they drive."""
        for body in model.leaders:
            if not body.joint.moves_body:
                self.motors[model.actuators[body.joint.name].joint] = body
        self.leaders_by_index = {body.v_index: body for body in model.leaders}
        """Leading body by its first index in dq."""
        self.link_names = list(dict.fromkeys([*model.frames, *self.body_indices]))  # each name once
        remaining_links = set(self.link_names)
        self.parents = {link: self._carrier(link, remaining_links) for link in remaining_links if link in model.mounts}

    def _carrier(self, link: str, remaining_links: set[str]) -> str:
        """Nearest ancestor link that remains; hidden links of locked joints are removed."""
        parent, _ = self.model.mounts[link]
        while parent and parent not in remaining_links:
            parent, _ = self.model.mounts[parent]
        return parent

    def parts(self) -> ModelParts:
        """All parts of the model."""
        model = self.model
        links_without_carrier = [link for link in self.link_names if not self.parents.get(link, "")]
        first_link = links_without_carrier[0] if links_without_carrier else "world"  # a model may have no links
        floating = first_link in self.body_indices
        is_locked = not floating and first_link in self.parents  # a locked floating joint carries it
        root = first_link
        if is_locked:
            root = unused("world", {*self.link_names})  # new link that the first link is fixed to
        parts = ModelParts(
            model.name, model.gravity, model.snap, model.source, root=root, floating=floating,
            actuators=list(model.actuators.values()), couplings=list(model.couplings), payloads=model.payloads,
        )  # fmt: skip
        if is_locked:
            self.parents[first_link] = root
            parts.links[root] = LinkEntry(root, SpatialInertia.zero(), "")
        self._add_links(parts)
        parts.joints = [self._joint(link) for link in self._depth_first(root) if link != root]
        if floating:
            self._add_losses(parts, model.bodies[self.body_indices[root]])
        for joint in parts.joints:
            if not joint.fixed and joint.mimic is None:
                self._add_losses(parts, model.bodies[self.body_indices[joint.child]])
        self._add_additions(parts)
        return parts

    def _add_links(self, parts: ModelParts) -> None:
        """Add all links. If a body has more inertia than its links together, the link on its joint gets the difference."""
        model = self.model
        whole_inertias = {i: body.inertia for i, body in enumerate(model.bodies) if body.joint.moves_body}
        whole_inertias[BASE] = model.base_inertia
        for body in model.bodies:
            is_rotor = not body.joint.moves_body
            if is_rotor and (self.extra or is_in_link_mass(model, body)):
                rotor_inertia = body.inertia.in_frame(body.placement)
                whole_inertias[body.parent] = whole_inertias[body.parent] + rotor_inertia
        remainders = dict(whole_inertias)  # inertia of each body without its links
        for name, frame in model.frames.items():
            inertia = model.link_inertias.get(name, SpatialInertia.zero())
            if inertia.parameters.any():
                remainders[frame.body] = remainders[frame.body] - inertia.in_frame(frame.pose)
        for name in self.link_names:
            inertia = model.link_inertias.get(name, SpatialInertia.zero())
            i = self.body_indices.get(name, BASE)
            is_main_link = i != BASE or name == parts.root
            if is_main_link and _exceeds_rounding(remainders[i], whole_inertias[i]):
                inertia = inertia + remainders[i]
            is_shaped = name in model.shaped
            is_hidden = name not in model.frames
            parts.links[name] = LinkEntry(name, inertia, "", is_shaped, is_hidden)
        parts.whole = {link: whole_inertias[i] for link, i in self.body_indices.items()}
        parts.whole.setdefault(parts.root, whole_inertias[BASE])

    def _depth_first(self, root: str) -> Iterator[str]:
        """Links depth first; of several children, the one with the lowest body index first, so that bodies keep their order."""
        children: dict[str, list[str]] = {name: [] for name in (root, *self.link_names)}
        for link in self.link_names:
            if link != root and link in self.parents:
                children[self.parents[link]].append(link)
        parents_first = []
        stack = [root]
        while stack:
            link = stack.pop()
            parents_first.append(link)
            stack.extend(children[link])
        # Lowest index of the bodies on a link and beyond it; links without bodies come last.
        first_body = {link: self.body_indices.get(link, len(self.body_indices)) for link in children}
        for link in reversed(parents_first):
            parent = self.parents.get(link, "")
            if parent in first_body:
                first_body[parent] = min(first_body[parent], first_body[link])
        stack = [root]
        while stack:
            link = stack.pop()
            yield link
            sorted_children = sorted(children[link], key=first_body.__getitem__)
            stack.extend(reversed(sorted_children))  # the last of the stack is taken first

    def _pose(self, link: str) -> tuple[int, Array]:
        """Index of the body that a link is fixed to, and the link's pose in it."""
        if link in self.body_indices:
            return self.body_indices[link], np.eye(4)
        if link in self.model.frames:
            frame = self.model.frames[link]
            return frame.body, frame.pose
        return BASE, np.eye(4)

    def _joint(self, link: str) -> JointEntry:
        """Joint that carries a link, with its limits; a follower gets its mimic entry and its own limits."""
        model = self.model
        parent = self.parents[link]
        _, name = model.mounts[link]
        _, T_parent = self._pose(parent)
        if link not in self.body_indices:
            _, T = self._pose(link)
            return fixed_entry(name, parent, link, _relative_pose(T_parent, T))
        body = model.bodies[self.body_indices[link]]
        _, dq_indices = body.places
        limits = model.limits.select(dq_indices)
        if name in self.motors:  # behind an elastic gear; the motor has the effort limit
            _, motor_indices = self.motors[name].places
            limits = replace(limits, effort=model.limits.effort[motor_indices])
        entry = _entry(body.joint, parent, link, _relative_pose(T_parent, body.placement), limits)
        if not body.follows:
            return entry
        leader = self.leaders_by_index[body.v_index]
        infinite = np.full(1, np.inf)
        effort = np.array([body.effort])
        if body.ratio:
            leader_range = np.array([limits.lower, limits.upper])
            ends = body.ratio * leader_range + body.offset
            lower, upper = np.sort(ends, axis=0)  # a negative ratio exchanges them
            follower_limits = Limits(lower, upper, velocity=infinite, effort=effort)
        else:
            follower_limits = Limits(lower=-infinite, upper=infinite, velocity=infinite, effort=effort)
        return replace(entry, mimic=(leader.joint.name, body.ratio, body.offset), limits=follower_limits)

    def _add_losses(self, parts: ModelParts, body: Body) -> None:
        """Store friction and armature of a joint, and of the motor behind its elastic gear."""
        drives = [body]
        if body.joint.name in self.motors:
            drives.append(self.motors[body.joint.name])
        for drive in drives:
            _, dq_indices = drive.places
            name = drive.joint.name
            parts.friction[name] = self.model.friction.select(np.arange(dq_indices.start, dq_indices.stop))
            parts.armature[name] = self.model.armature[dq_indices]

    def _add_additions(self, parts: ModelParts) -> None:
        """Add everything beside links and joints; springs in elastic gears belong to the actuators."""
        model, additions = self.model, parts.additions
        for name, frame in model.sites.items():
            link = parts.root if frame.body == BASE else model.bodies[frame.body].link
            additions.sites[name] = SiteEntry(name, link, frame.pose)
        joint_names = {joint.name for joint in parts.joints} | {ROOT_JOINT}
        additions.springs = [spring for spring in model.springs if joint_names.issuperset(spring.joints)]
        leaders = [body for body in model.leaders if body.joint.moves_body]
        q_indices_by_joint = {}
        for body in leaders:
            q_indices, _ = body.places
            q_indices_by_joint[body.joint.name] = q_indices
        for name, q in model.configurations.items():
            additions.configurations[name] = {joint: q[indices] for joint, indices in q_indices_by_joint.items()}
        additions.closures = dict(model.closures)
        additions.motor_joints = set(model.motor_joints)
        additions.mounted = model.mounted
        additions.locked = dict(model.locked)


_NO_COORDINATES = np.zeros(0)
_NO_LIMITS = Limits(lower=_NO_COORDINATES, upper=_NO_COORDINATES, velocity=_NO_COORDINATES, effort=_NO_COORDINATES)
"""Limits of a fixed joint."""


def _entry(joint: Joint, parent: str, child: str, placement: Array, limits: Limits) -> JointEntry:
    """Joint between two links, without friction, armature and mimic."""
    return JointEntry(joint, parent, child, placement, limits, damping=0.0, friction=0.0, mimic=None, where="")


def fixed_entry(name: str, parent: str, child: str, placement: Array) -> JointEntry:
    """Fixed joint."""
    return _entry(Fixed(name, np.zeros((0, 6))), parent, child, placement, _NO_LIMITS)


def _relative_pose(T_ab: Array, T_ac: Array) -> Array:
    """Relative pose T_bc; exact if {b} equals {a}."""
    if np.array_equal(T_ab, np.eye(4)):
        return T_ac
    return np.asarray(se3.inverse(T_ab) @ T_ac)


def _exceeds_rounding(remainder: SpatialInertia, whole: SpatialInertia) -> bool:
    """True if the difference between a body and its links exceeds rounding errors."""
    differences = np.abs(remainder.parameters)
    sizes = np.abs(whole.parameters)
    mass, first_moment, moments = slice(0, 1), slice(1, 4), slice(4, 10)
    for entries in (mass, first_moment, moments):  # of three units, so their sizes may differ
        scale = max(sizes[entries].max(), _MIN_SIZE_SHARE * sizes.max())
        if differences[entries].max() > _MAX_ROUNDING * scale:
            return True
    return False


# ── Model from its parts


def reassemble(parts: ModelParts) -> Model:
    """Model from its parts, without checks and warnings."""
    tree = find_tree(parts.links, parts.joints)
    model = assemble(
        parts.name, parts.links, tree, find_drives(parts.joints), floating_base=parts.floating, snap=parts.snap,
        gravity=parts.gravity, source=parts.source, additions=parts.additions,
    )  # fmt: skip
    armature = [parts.armature[name] for name in model.joint_names]
    model = replace(model, armature=np.concatenate([np.zeros(0), *armature]), payloads=parts.payloads)
    model = replace(model, couplings=tuple(parts.couplings))
    model = with_actuators(model, parts.actuators)
    laws = [parts.friction[name] for name in model.joint_names]  # now with the motors of elastic gears
    friction: dict[str, Array] = {}
    for parameter in LAWS:
        values = [getattr(law, parameter) for law in laws]
        friction[parameter] = np.concatenate([np.zeros(0), *values])
    return replace(model, friction=Friction(**friction), tip=default_tip(model))
