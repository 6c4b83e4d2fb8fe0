"""Joining of two robots, extraction of a part, and release of a base: edits of the links and joints of a model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from ...core.errors import FrameError, ModelError, UnknownNameError
from ...core.text import argument, in_the_shell, listed
from ...core.typing import Array
from .actuators import Actuator
from .assembly import ROOT_JOINT
from .description import JointEntry, unused
from .limits import Friction
from .model import BASE, Model, OfferedClosure
from .parts import ModelParts, disassemble, fixed_entry, reassemble

_LISTED = 6
_Value = TypeVar("_Value")


def attach(model: Model, other: Model, frame: str | None, pose: Array, prefix: str, name: str) -> Model:
    """Model with another model's base fixed to a frame, at a pose (4, 4) in it; ``prefix`` is prepended to the other's names.

    Raises :class:`~twistwrench.UnknownNameError` and :class:`~twistwrench.FrameError` as :meth:`Model.frame`, and
    :class:`~twistwrench.ModelError` for duplicate names.
    """
    model.frame(frame)
    at = model.tip if frame is None else frame
    whole, part = disassemble(model, extra=False), _renamed(disassemble(other, extra=False), prefix)
    link, T = str(at), pose
    if link in whole.additions.sites:
        site = whole.additions.sites[link]
        link, T = site.link, np.asarray(site.pose @ pose)
    _check_names(whole, part, prefix)
    whole.additions.motor_joints = _motors_of_both(whole, part)
    whole.links |= part.links
    between = unused(f"{part.root}.attached", {joint.name for joint in (*whole.joints, *part.joints)})
    whole.joints += [fixed_entry(between, link, part.root, T), *part.joints]
    for field in ("friction", "armature"):
        getattr(whole, field).update(
            {k: v for k, v in getattr(part, field).items() if k != ROOT_JOINT or not part.floating}
        )
    whole.actuators += part.actuators
    whole.couplings += part.couplings
    whole.payloads += part.payloads
    mine, theirs = whole.additions, part.additions
    mine.sites |= theirs.sites
    mine.springs += theirs.springs
    mine.closures |= theirs.closures
    for label, positions in theirs.configurations.items():
        ours = {joint: q for joint, q in positions.items() if joint != ROOT_JOINT or not part.floating}
        mine.configurations[label] = mine.configurations.get(label, {}) | ours
    whole.name = name
    found = reassemble(whole)
    return replace(found, defects=(*model.defects, *other.defects))


def _motors_of_both(whole: ModelParts, part: ModelParts) -> set[str]:
    """Joints with motors of two joined robots; a file without actuators drives all its joints."""
    if not (whole.additions.motor_joints or part.additions.motor_joints):
        return set()
    driven: set[str] = set()
    for parts in (whole, part):
        every = {joint.name for joint in parts.joints if not joint.fixed and joint.joint.driven}
        driven |= parts.additions.motor_joints or every
    return driven


def chain(model: Model, base: str | None, tip: str | None) -> Model:
    """Part of the model with a fixed base: the subtree of a link, or only the joints between it and a tip.

    Links fixed to the part belong to it; gravity is that in the new base frame with every joint neutral.

    Raises :class:`~twistwrench.UnknownNameError` for unknown frames, :class:`~twistwrench.FrameError` if the base does
    not carry the tip, and :class:`~twistwrench.ModelError` if the part depends on joints outside it.
    """
    found = disassemble(model, extra=False)
    root = found.root if base is None else base
    if root not in found.links or found.links[root].hidden:
        raise UnknownNameError.from_choices("link", root, model.frames)
    if tip is not None:
        model.frame(tip)
    kept = _below(found, root, tip)
    if base is not None:
        found.gravity = _rotation(model, root).T @ found.gravity if root in model.frames else found.gravity
        found.floating = False
        found.additions.mounted = True
    part = _restricted(found, kept)
    part.root = root
    cut = reassemble(part)
    return replace(cut, tip=tip if tip in cut.all_frames else cut.tip, defects=model.defects)


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
    found = _without_locked_root(disassemble(model, extra=False))
    if any(joint.name == ROOT_JOINT for joint in found.joints):
        raise ModelError(f"a joint has the name {ROOT_JOINT!r}, which the joint of a floating base has. Rename it.")
    none = np.zeros(6)
    found.floating, found.additions.mounted = True, False
    found.friction[ROOT_JOINT], found.armature[ROOT_JOINT] = Friction.plain(none, none), none
    for positions in found.additions.configurations.values():
        positions[ROOT_JOINT] = _AT_ORIGIN
    return replace(reassemble(found), tip=model.tip, defects=model.defects)


def _without_locked_root(found: ModelParts) -> ModelParts:
    """Parts without the world and the joint by which a floating base was locked at the origin."""
    below = [joint for joint in found.joints if joint.parent == found.root]
    if len(below) != 1 or below[0].name != ROOT_JOINT or not below[0].fixed or found.links[found.root].inertia.mass:
        return found
    if not np.array_equal(below[0].placement, np.eye(4)):
        return found
    root, sites = below[0].child, found.additions.sites
    found.links = {name: link for name, link in found.links.items() if name != found.root}
    found.additions.sites = {
        name: replace(site, link=root) if site.link == found.root else site for name, site in sites.items()
    }
    found.joints, found.root = [joint for joint in found.joints if joint is not below[0]], root
    return found


_AT_ORIGIN = np.array([1.0, 0, 0, 0, 0, 0, 0])
"""Unit quaternion and position."""


def _check_names(whole: ModelParts, part: ModelParts, prefix: str) -> None:
    for what, ours, theirs in (
        ("link", {*whole.links, *whole.additions.sites}, (*part.links, *part.additions.sites)),
        ("joint", {joint.name for joint in whole.joints}, [joint.name for joint in part.joints]),
        ("motor", {m for c in whole.couplings for m in c.motors}, [m for c in part.couplings for m in c.motors]),
        ("closure", whole.additions.closures, part.additions.closures),
    ):
        both = [name for name in theirs if name in ours]
        if both:
            form = "FILE@FRAME:hand_" if in_the_shell() else "prefix='hand_'"
            advice = "another prefix" if prefix else f"a prefix for the names of the one attached, such as {form}"
            raise ModelError(f"both robots have a {what} called {listed(map(repr, both), _LISTED)}. Give {advice}.")


def _renamed(part: ModelParts, prefix: str) -> ModelParts:
    """Parts with a prefix before every name."""
    if not prefix:
        return part

    def called(name: str) -> str:
        return f"{prefix}{name}"

    def keyed(mapping: Mapping[str, _Value]) -> dict[str, _Value]:
        return {called(name): value for name, value in mapping.items()}

    more = part.additions

    def frame(name: str) -> str:
        marked = name in more.sites and name.startswith("site:")
        return f"site:{called(name.removeprefix('site:'))}" if marked else called(name)

    sites = {frame(name): replace(s, name=frame(name), link=called(s.link)) for name, s in more.sites.items()}

    additions = replace(
        more, sites=sites,
        springs=[replace(s, terms=tuple((called(joint), w) for joint, w in s.terms)) for s in more.springs],
        configurations={name: keyed(positions) for name, positions in more.configurations.items()},
        closures={
            called(name): OfferedClosure(frame(c.frame_a), frame(c.frame_b), c.rows) for name, c in more.closures.items()
        },
        motor_joints={called(name) for name in more.motor_joints},
    )  # fmt: skip
    return replace(
        part, root=called(part.root), additions=additions,
        links={called(link.name): replace(link, name=called(link.name)) for link in part.links.values()},
        joints=[_renamed_joint(joint, prefix) for joint in part.joints],
        whole=keyed(part.whole), friction=keyed(part.friction), armature=keyed(part.armature),
        actuators=[_renamed_actuator(actuator, prefix) for actuator in part.actuators],
        couplings=[
            replace(c, name=called(c.name), motors=tuple(map(called, c.motors)), joints=tuple(map(called, c.joints)))
            for c in part.couplings
        ],
        payloads=tuple((frame(name), G) for name, G in part.payloads),
    )  # fmt: skip


def _renamed_joint(entry: JointEntry, prefix: str) -> JointEntry:
    mimic = entry.mimic if entry.mimic is None else (prefix + entry.mimic[0], *entry.mimic[1:])
    joint = replace(entry.joint, name=prefix + entry.name)
    return replace(entry, joint=joint, parent=prefix + entry.parent, child=prefix + entry.child, mimic=mimic)


def _renamed_actuator(actuator: Actuator, prefix: str) -> Actuator:
    rotor = actuator.rotor
    if rotor is not None and rotor.link is not None:
        rotor = replace(rotor, link=prefix + rotor.link)
    return replace(actuator, joint=prefix + actuator.joint, rotor=rotor)


def _below(found: ModelParts, root: str, tip: str | None) -> set[str]:
    """Links to keep: the subtree of the root, or the chain to a tip with everything fixed to it."""
    carried = {joint.child: joint for joint in found.joints}
    way = {root}
    if tip is not None:
        link = found.additions.sites[tip].link if tip in found.additions.sites else tip
        while link != root:
            if link not in carried:
                raise FrameError(f"frame {tip!r} is not carried by link {root!r}. Name a base before it.")
            way.add(link)
            link = carried[link].parent
    kept = {root}
    for joint in found.joints:  # parents first
        if joint.parent in kept and (tip is None or joint.child in way or joint.fixed):
            kept.add(joint.child)
    return kept


def _rotation(model: Model, link: str) -> Array:
    """Rotation of a link in the base frame, with every joint neutral."""
    q, frame = model.neutral, model.frames[link]
    T, i = frame.pose, frame.body
    while i != BASE:
        body = model.bodies[i]
        mine = q[body.places[0]]
        T = body.placement @ body.joint.pose(body.ratio * mine + body.offset if body.follows else mine) @ T
        i = body.parent
    return np.asarray(T[:3, :3], float)


def _restricted(found: ModelParts, kept: set[str]) -> ModelParts:
    """Parts with some links only, without entries that concern other links."""
    joints = [joint for joint in found.joints if {joint.parent, joint.child} <= kept]
    names = {joint.name for joint in joints} | ({ROOT_JOINT} if found.floating else set())
    for joint in joints:
        if joint.mimic is not None and joint.mimic[0] not in names:
            raise ModelError(
                f"joint {joint.name!r} follows {joint.mimic[0]!r}, which is not in that part of the robot. Load with "
                f"{argument('mimic', 'independent')}, or lock the leader first."
            )
    more = found.additions
    sites = {name: site for name, site in more.sites.items() if site.link in kept}
    frames = kept | set(sites)
    couplings = [c for c in found.couplings if names & {*c.joints}]
    for c in couplings:
        if outside := [joint for joint in c.joints if joint not in names]:
            raise ModelError(
                f"joint {outside[0]!r} of coupling {c.name!r} is not in that part of the robot. Cut the part out first, and "
                "describe its actuators then."
            )
    driven = names | {motor for c in couplings for motor in c.motors}
    actuators = [actuator for actuator in found.actuators if actuator.joint in driven]
    for actuator in actuators:
        if actuator.rotor is not None and actuator.rotor.link not in (None, *frames):
            raise ModelError(
                f"the rotor of joint {actuator.joint!r} is on link {actuator.rotor.link!r}, which is not in that part of the "
                "robot. Cut the part out first, and describe its actuators then."
            )
    configurations = {
        name: {joint: q for joint, q in positions.items() if joint in names}
        for name, positions in more.configurations.items()
    }
    additions = replace(
        more, sites=sites, springs=[s for s in more.springs if all(joint in names for joint, _ in s.terms)],
        configurations=configurations, closures={k: c for k, c in more.closures.items() if {c.frame_a, c.frame_b} <= frames},
        motor_joints=more.motor_joints & names,
    )  # fmt: skip
    return replace(
        found, links={name: link for name, link in found.links.items() if name in kept}, joints=joints, actuators=actuators,
        couplings=couplings,
        payloads=tuple((frame, G) for frame, G in found.payloads if frame in frames), additions=additions,
    )  # fmt: skip
