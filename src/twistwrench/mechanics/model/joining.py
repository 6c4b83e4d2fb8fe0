"""Joining of two robots, extraction of a part, and release of a base: edits of the links and joints of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import FrameError, ModelError, UnknownNameError
from ...core.text import argument, in_the_shell, listed
from ...core.typing import Array
from ..lie import se3
from .actuators import Actuator
from .assembly import ROOT_JOINT, Additions
from .couplings import Coupling
from .description import JointEntry, SiteEntry, unused
from .limits import Friction
from .model import BASE, Model, OfferedClosure, Spring
from .parts import ModelParts, disassemble, fixed_entry, reassemble

_MAX_LISTED_NAMES = 6
"""Number of names that an error message lists; further ones are counted."""
_Value = TypeVar("_Value")


def attach(model: Model, other: Model, frame: str | None, pose: Array, prefix: str, name: str) -> Model:
    """Model with another model's base fixed to a frame, at a pose (4, 4) in this frame. All names of the other get ``prefix``.

    Raises :class:`~twistwrench.UnknownNameError` and :class:`~twistwrench.FrameError` as :meth:`Model.frame`, and
    :class:`~twistwrench.ModelError` for duplicate names.
    """
    model.frame(frame)
    link = str(model.tip if frame is None else frame)
    pose_in_link = pose
    carrier = disassemble(model, extra=False)  # its parts become the joined robot
    attached = _with_prefix(disassemble(other, extra=False), prefix)
    if link in carrier.additions.sites:
        site = carrier.additions.sites[link]
        link = site.link
        pose_in_link = np.asarray(site.pose @ pose)
    _check_names(carrier, attached, prefix)
    carrier.additions.motor_joints = _motors_of_both(carrier, attached)
    carrier.links |= attached.links
    all_joint_names = _joint_names([*carrier.joints, *attached.joints])
    connection = unused(f"{attached.root}.attached", all_joint_names)
    carrier.joints += [fixed_entry(connection, link, attached.root, pose_in_link), *attached.joints]
    carrier.friction |= _without_root_joint(attached, attached.friction)
    carrier.armature |= _without_root_joint(attached, attached.armature)
    carrier.actuators += attached.actuators
    carrier.couplings += attached.couplings
    carrier.payloads += attached.payloads
    additions = carrier.additions
    new_additions = attached.additions
    additions.sites |= new_additions.sites
    additions.springs += new_additions.springs
    additions.closures |= new_additions.closures
    additions.locked |= new_additions.locked
    for configuration, positions in new_additions.configurations.items():
        own_positions = additions.configurations.get(configuration, {})
        additions.configurations[configuration] = own_positions | _without_root_joint(attached, positions)
    carrier.name = name
    joined = reassemble(carrier)
    return replace(joined, defects=(*model.defects, *other.defects))


def _without_root_joint(part: ModelParts, values: Mapping[str, _Value]) -> dict[str, _Value]:
    """Values by joint, without the joint of a floating base, since this base is now fixed to the other robot."""
    remaining = dict(values)
    if part.floating:
        remaining.pop(ROOT_JOINT, None)
    return remaining


def _motors_of_both(carrier: ModelParts, attached: ModelParts) -> set[str]:
    """Joints with motors of two joined robots; empty, for all joints, if neither file names joints with motors.

    If only one file names them, all joints of the other robot are driven.
    """
    names_motor_joints = carrier.additions.motor_joints or attached.additions.motor_joints
    if not names_motor_joints:
        return set()
    motor_joints: set[str] = set()
    for parts in (carrier, attached):
        driven_joints = {joint.name for joint in parts.joints if not joint.fixed and joint.joint.driven}
        motor_joints |= parts.additions.motor_joints or driven_joints  # a file without such names drives all joints
    return motor_joints


def chain(model: Model, base: str | None, tip: str | None) -> Model:
    """Part of the model with a fixed base: the subtree of a link, or only the joints between the link and a tip.

    Links fixed to the part belong to it. Gravity is expressed in the new base frame at neutral joints.

    Raises :class:`~twistwrench.UnknownNameError` for unknown frames, :class:`~twistwrench.FrameError` if the base does
    not carry the tip, and :class:`~twistwrench.ModelError` if the part depends on joints outside it.
    """
    parts = disassemble(model, extra=False)
    root = parts.root if base is None else base
    if root not in parts.links or parts.links[root].hidden:
        raise UnknownNameError.from_choices("link", root, model.frames)
    if tip is not None:
        model.frame(tip)
    links = _links_of_part(parts, root, tip)
    if base is not None:
        if root in model.frames:
            parts.gravity = _rotation(model, root).T @ parts.gravity
        parts.floating = False
        parts.additions.mounted = True
    part = _part_with_links(parts, links)
    part.root = root
    model_of_part = replace(reassemble(part), defects=model.defects)
    if tip in model_of_part.all_frames:
        return replace(model_of_part, tip=tip)
    return model_of_part


def with_free_base(model: Model) -> Model:
    """Model whose fixed root floats, at the identity in its neutral and named configurations.

    Raises :class:`~twistwrench.ModelError` if a joint has the name of the joint that is added.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r().model
    >>> with_free_base(arm).nv - arm.nv
    6
    """
    parts = _without_locked_root(disassemble(model, extra=False))
    if any(joint.name == ROOT_JOINT for joint in parts.joints):
        raise ModelError(f"a joint has the name {ROOT_JOINT!r}, which the joint of a floating base has. Rename it.")
    zeros = np.zeros(6)
    parts.floating = True
    parts.additions.mounted = False
    parts.friction[ROOT_JOINT] = Friction.plain(zeros, zeros)
    parts.armature[ROOT_JOINT] = zeros
    for positions in parts.additions.configurations.values():
        positions[ROOT_JOINT] = _AT_ORIGIN
    return replace(reassemble(parts), tip=model.tip, defects=model.defects)


def _without_locked_root(parts: ModelParts) -> ModelParts:
    """Parts without the world and its joint, if this joint was a floating base and is locked.

    Gravity is then in the axes of the base.
    """
    world = parts.root
    root_joints = [joint for joint in parts.joints if joint.parent == world]
    world_has_mass = parts.links[world].inertia.mass != 0.0
    if len(root_joints) != 1 or world_has_mass:
        return parts
    (root_joint,) = root_joints
    if root_joint.name != ROOT_JOINT or not root_joint.fixed:
        return parts
    base_pose = root_joint.placement  # in the world
    parts.gravity = base_pose[:3, :3].T @ parts.gravity
    del parts.links[world]
    for name, site in parts.additions.sites.items():
        if site.link == world:
            parts.additions.sites[name] = replace(site, link=root_joint.child, pose=se3.inverse(base_pose) @ site.pose)
    parts.joints = [joint for joint in parts.joints if joint is not root_joint]
    parts.root = root_joint.child
    return parts


_AT_ORIGIN = np.array([1.0, 0, 0, 0, 0, 0, 0])
"""Coordinates of a floating base at the origin: unit quaternion and position."""


def _check_names(carrier: ModelParts, attached: ModelParts, prefix: str) -> None:
    """Raise ModelError if both robots have entries of one kind with the same name."""
    attached_names = _names_by_kind(attached)
    for kind, names in _names_by_kind(carrier).items():
        carrier_names = set(names)
        shared_names = [name for name in attached_names[kind] if name in carrier_names]
        if shared_names:
            example = "FILE@FRAME:hand_" if in_the_shell() else "prefix='hand_'"
            advice = "another prefix" if prefix else f"a prefix for the names of the one attached, such as {example}"
            names_text = listed(map(repr, shared_names), _MAX_LISTED_NAMES)
            raise ModelError(f"both robots have a {kind} called {names_text}. Give {advice}.")


def _names_by_kind(parts: ModelParts) -> dict[str, list[str]]:
    """Names that two joined robots must not share, by kind of entry."""
    return {
        "link": [*parts.links, *parts.additions.sites],
        "joint": [joint.name for joint in parts.joints],
        "motor": [motor for coupling in parts.couplings for motor in coupling.motors],
        "closure": list(parts.additions.closures),
    }


def _with_prefix(part: ModelParts, prefix: str) -> ModelParts:
    """Parts with a prefix before every name."""
    if not prefix:
        return part
    payloads = []
    for frame, inertia in part.payloads:
        payloads.append((_frame_with_prefix(frame, part.additions, prefix), inertia))
    return replace(
        part, root=prefix + part.root, additions=_additions_with_prefix(part.additions, prefix),
        links={prefix + name: replace(link, name=prefix + name) for name, link in part.links.items()},
        joints=[_joint_with_prefix(joint, prefix) for joint in part.joints],
        whole=_keys_with_prefix(part.whole, prefix),
        friction=_keys_with_prefix(part.friction, prefix), armature=_keys_with_prefix(part.armature, prefix),
        actuators=[_actuator_with_prefix(actuator, prefix) for actuator in part.actuators],
        couplings=[_coupling_with_prefix(coupling, prefix) for coupling in part.couplings],
        payloads=tuple(payloads),
    )  # fmt: skip


def _keys_with_prefix(mapping: Mapping[str, _Value], prefix: str) -> dict[str, _Value]:
    return {prefix + name: value for name, value in mapping.items()}


def _names_with_prefix(names: Iterable[str], prefix: str) -> tuple[str, ...]:
    return tuple(prefix + name for name in names)


def _frame_with_prefix(name: str, additions: Additions, prefix: str) -> str:
    """Name of a link or site with the prefix. The mark "site:", of a site with the name of a link, stays in front."""
    if name in additions.sites and name.startswith("site:"):
        return f"site:{prefix}{name.removeprefix('site:')}"
    return prefix + name


def _additions_with_prefix(additions: Additions, prefix: str) -> Additions:
    sites: dict[str, SiteEntry] = {}
    for name, site in additions.sites.items():
        frame = _frame_with_prefix(name, additions, prefix)
        sites[frame] = replace(site, name=frame, link=prefix + site.link)
    closures: dict[str, OfferedClosure] = {}
    for name, closure in additions.closures.items():
        frame_a = _frame_with_prefix(closure.frame_a, additions, prefix)
        frame_b = _frame_with_prefix(closure.frame_b, additions, prefix)
        closures[prefix + name] = OfferedClosure(frame_a, frame_b, closure.rows)
    locked: dict[str, tuple[str, ...]] = {}
    for joint, followers in additions.locked.items():
        locked[prefix + joint] = _names_with_prefix(followers, prefix)
    configurations = additions.configurations
    return replace(
        additions, sites=sites, closures=closures, locked=locked,
        springs=[_spring_with_prefix(spring, prefix) for spring in additions.springs],
        configurations={name: _keys_with_prefix(q, prefix) for name, q in configurations.items()},
        motor_joints=set(_names_with_prefix(additions.motor_joints, prefix)),
    )  # fmt: skip


def _spring_with_prefix(spring: Spring, prefix: str) -> Spring:
    return replace(spring, terms=tuple((prefix + joint, weight) for joint, weight in spring.terms))


def _coupling_with_prefix(coupling: Coupling, prefix: str) -> Coupling:
    motors = _names_with_prefix(coupling.motors, prefix)
    joints = _names_with_prefix(coupling.joints, prefix)
    return replace(coupling, name=prefix + coupling.name, motors=motors, joints=joints)


def _joint_with_prefix(entry: JointEntry, prefix: str) -> JointEntry:
    mimic = entry.mimic
    if mimic is not None:
        leader, ratio, offset = mimic
        mimic = (prefix + leader, ratio, offset)
    joint = replace(entry.joint, name=prefix + entry.name)
    return replace(entry, joint=joint, parent=prefix + entry.parent, child=prefix + entry.child, mimic=mimic)


def _actuator_with_prefix(actuator: Actuator, prefix: str) -> Actuator:
    rotor = actuator.rotor
    if rotor is not None and rotor.link is not None:
        rotor = replace(rotor, link=prefix + rotor.link)
    return replace(actuator, joint=prefix + actuator.joint, rotor=rotor)


def _links_of_part(parts: ModelParts, root: str, tip: str | None) -> set[str]:
    """Links to keep: the subtree of the root, or the chain to a tip with everything fixed to the chain."""
    carrying_joints = {joint.child: joint for joint in parts.joints}
    path = {root}
    if tip is not None:
        link = parts.additions.sites[tip].link if tip in parts.additions.sites else tip
        while link != root:
            if link not in carrying_joints:
                raise FrameError(f"frame {tip!r} is not carried by link {root!r}. Name a base before it.")
            path.add(link)
            link = carrying_joints[link].parent
    links = {root}
    for joint in parts.joints:  # parents first
        belongs_to_part = tip is None or joint.child in path or joint.fixed
        if joint.parent in links and belongs_to_part:
            links.add(joint.child)
    return links


def _rotation(model: Model, link: str) -> Array:
    """Rotation of a link in the base frame, with every joint neutral."""
    frame = model.frames[link]
    T = frame.pose
    i = frame.body
    while i != BASE:
        body = model.bodies[i]
        T = body.placement @ body.joint.pose(body.coordinates(model.neutral)) @ T
        i = body.parent
    return np.asarray(T[:3, :3], float)


def _part_with_links(parts: ModelParts, links: set[str]) -> ModelParts:
    """Parts with some links only, without entries that concern other links."""
    joints = [joint for joint in parts.joints if {joint.parent, joint.child} <= links]
    joint_names = _joint_names(joints)
    if parts.floating:
        joint_names.add(ROOT_JOINT)
    _check_leaders(joints, joint_names)
    couplings = [coupling for coupling in parts.couplings if joint_names & set(coupling.joints)]
    _check_coupled_joints(couplings, joint_names)
    drives = set(joint_names)
    for coupling in couplings:
        drives.update(coupling.motors)
    actuators = [actuator for actuator in parts.actuators if actuator.joint in drives]
    additions = _additions_of_part(parts.additions, links, joint_names)
    frames = links | set(additions.sites)
    _check_rotor_links(actuators, frames)
    return replace(
        parts, links=_entries_of(parts.links, links), joints=joints,
        actuators=actuators, couplings=couplings, additions=additions,
        payloads=tuple((frame, G) for frame, G in parts.payloads if frame in frames),
    )  # fmt: skip


def _joint_names(joints: Iterable[JointEntry]) -> set[str]:
    return {joint.name for joint in joints}


def _entries_of(mapping: Mapping[str, _Value], names: set[str]) -> dict[str, _Value]:
    """Entries of these names only."""
    return {name: value for name, value in mapping.items() if name in names}


def _additions_of_part(additions: Additions, links: set[str], joints: set[str]) -> Additions:
    """Sites, springs, configurations, closures and motors that concern only these links and joints."""
    sites = {name: site for name, site in additions.sites.items() if site.link in links}
    frames = links | set(sites)
    configurations: dict[str, dict[str, ArrayLike]] = {}
    for name, positions in additions.configurations.items():
        configurations[name] = _entries_of(positions, joints)
    springs = [spring for spring in additions.springs if joints.issuperset(spring.joints)]
    closures = {
        name: closure for name, closure in additions.closures.items() if {closure.frame_a, closure.frame_b} <= frames
    }
    return replace(
        additions,
        sites=sites,
        springs=springs,
        configurations=configurations,
        closures=closures,
        motor_joints=additions.motor_joints & joints,
    )


def _check_leaders(joints: Sequence[JointEntry], joint_names: set[str]) -> None:
    """Raise ModelError if the leader of a mimic joint is not in the part."""
    for joint in joints:
        if joint.mimic is None:
            continue
        leader, _, _ = joint.mimic
        if leader not in joint_names:
            raise ModelError(
                f"joint {joint.name!r} follows {leader!r}, which is not in that part of the robot. Load with "
                f"{argument('mimic', 'independent')}, or lock the leader first."
            )


def _check_coupled_joints(couplings: Sequence[Coupling], joint_names: set[str]) -> None:
    """Raise ModelError if only some joints of a coupling are in the part."""
    for coupling in couplings:
        outside = [joint for joint in coupling.joints if joint not in joint_names]
        if outside:
            raise ModelError(
                f"joint {outside[0]!r} of coupling {coupling.name!r} is not in that part of the robot. Cut the part out "
                "first, and describe its actuators then."
            )


def _check_rotor_links(actuators: Sequence[Actuator], frames: set[str]) -> None:
    """Raise ModelError if a rotor is on a link that is not in the part."""
    for actuator in actuators:
        if actuator.rotor is None or actuator.rotor.link is None:
            continue
        if actuator.rotor.link not in frames:
            raise ModelError(
                f"the rotor of joint {actuator.joint!r} is on link {actuator.rotor.link!r}, which is not in that part of the "
                "robot. Cut the part out first, and describe its actuators then."
            )
