"""Assembly: from described links and joints to a model in which every joint, fixed ones included, carries a body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.inertia import SpatialInertia
from ..joints import Floating
from ..lie.identity import IDENTITY
from ..typing import Array
from .closure import OfferedClosure
from .configuration import from_names
from .description import JointEntry, LinkEntry, SiteEntry
from .fixed_joints import fuse
from .friction import Friction
from .limits import Limits
from .mimic import Drive, shared_limits
from .model import BASE, Body, Frame, Model
from .rounding import snap_pose
from .spring import Spring
from .tree import Tree

ROOT_JOINT = "root_joint"
"""The name of the joint that ``floating_base=True`` adds."""


@dataclass(frozen=True)
class _Column:
    """Where a leader's coordinates and velocities begin."""

    q: int
    v: int


@dataclass
class Additions:
    """What a file says beside links and joints."""

    sites: dict[str, SiteEntry] = field(default_factory=dict)
    springs: list[Spring] = field(default_factory=list)
    configurations: dict[str, dict[str, ArrayLike]] = field(default_factory=dict)
    closures: dict[str, OfferedClosure] = field(default_factory=dict)


def assemble(
    name: str,
    links: Mapping[str, LinkEntry],
    tree: Tree,
    drives: Mapping[str, Drive],
    *,
    floating_base: bool,
    snap: float,
    gravity: Array,
    source: str,
    additions: Additions,
) -> Model:
    """The model of a checked tree, fixed links fused; a follower of a fixed joint, or with ratio 0, is fixed too."""
    joints = ([_root_entry(tree.root)] if floating_base else []) + list(tree.joints)
    leaders = [j for j in joints if j.name not in drives and j.joint.nv]
    columns, nq, nv = {}, 0, 0
    for entry in leaders:
        columns[entry.name] = _Column(nq, nv)
        nq, nv = nq + entry.joint.nq, nv + entry.joint.nv
    followers: dict[str, list[JointEntry]] = {}
    for entry in joints:
        if entry.name in drives:
            followers.setdefault(drives[entry.name].leader, []).append(entry)
    limits = [shared_limits(entry, followers.get(entry.name, ()), drives) for entry in leaders]
    every = {entry.name: drives.get(entry.name) or Drive(entry.name, 1.0, 0.0) for entry in joints}
    index = {} if floating_base else {tree.root: BASE}
    bodies: list[Body] = []
    held: dict[int, Array] = {}
    for i, entry in enumerate(joints):
        index[entry.child] = i
        drive = every[entry.name]
        if drive.leader not in columns or drive.ratio == 0:
            held[i] = IDENTITY if entry.fixed else entry.joint.pose(np.array([drive.offset]))
        column = columns.get(drive.leader, _Column(0, 0))
        bodies.append(
            Body(
                joint=entry.joint,
                link=entry.child,
                parent=index.get(entry.parent, BASE),
                placement=snap_pose(entry.placement, snap),
                inertia=links[entry.child].inertia,
                q_index=column.q,
                v_index=column.v,
                ratio=drive.ratio,
                offset=drive.offset,
                follows=entry.name in drives,
                effort=float(entry.limits.effort[0]) if entry.name in drives and entry.joint.nv else np.inf,
            )
        )
    model = Model(
        name=name,
        bodies=tuple(bodies),
        frames={name: Frame(index[name], IDENTITY) for name, link in links.items() if not link.hidden},
        limits=_stacked([shared for shared, _ in limits]),
        defects=tuple(text for _, remarks in limits for text in remarks),
        friction=_friction(joints, every, columns, nv),
        gravity=gravity,
        base_inertia=SpatialInertia.zero() if floating_base else links[tree.root].inertia,
        tip=None,
        leaves=tree.leaves,
        link_inertias={link.name: link.inertia for link in links.values() if not link.hidden},
        source=source,
        shaped=frozenset(link.name for link in links.values() if link.shaped),
        snap=snap,
        armature=_armature(joints, every, columns, nv),
        sites={site.name: Frame(index[site.link], snap_pose(site.pose, snap)) for site in additions.sites.values()},
        springs=tuple(s for s in (_led(s, drives, columns) for s in additions.springs) if s.terms),
        closures=additions.closures,
        mounts={entry.child: (entry.parent, entry.name) for entry in joints},
    )
    positions = additions.configurations
    if positions:
        model = replace(model, configurations={name: _configuration(model, positions[name]) for name in positions})
    return fuse(model, held)


def _configuration(model: Model, positions: Mapping[str, ArrayLike]) -> Array:
    """q with the joints that have coordinates of their own as given; what mimics another follows."""
    return from_names(model, {name: positions[name] for name in model.joint_names if name in positions})


def _led(spring: Spring, drives: Mapping[str, Drive], columns: Mapping[str, _Column]) -> Spring:
    """The spring between coordinates: what a follower stretches, its leader does."""
    terms: dict[str, float] = {}
    rest = spring.rest
    for joint, weight in spring.terms:
        drive = drives.get(joint, Drive(joint, 1.0, 0.0))
        rest -= weight * drive.offset
        if drive.leader in columns and drive.ratio:
            terms[drive.leader] = terms.get(drive.leader, 0.0) + weight * drive.ratio
    return Spring(tuple(terms.items()), spring.stiffness, rest)


def _root_entry(root: str) -> JointEntry:
    none = np.full(6, np.inf)
    joint = Floating(ROOT_JOINT, np.eye(6))
    return JointEntry(joint, "", root, IDENTITY, Limits(-none, none, none, none), 0.0, 0.0, None, "")


def _stacked(limits: list[Limits]) -> Limits:
    def column(field: str) -> Array:
        return np.concatenate([np.zeros(0), *(getattr(one, field) for one in limits)])

    return Limits(column("lower"), column("upper"), column("velocity"), column("effort"))


def _armature(joints: list[JointEntry], drives: Mapping[str, Drive], columns: Mapping[str, _Column], nv: int) -> Array:
    """Inertia of the drives per velocity; that of a follower counts ratio², as a gear's does."""
    found = [0.0] * nv
    for entry in joints:
        drive = drives[entry.name]
        for k in _velocities(entry, drive, columns):
            found[k] += drive.ratio**2 * entry.armature
    return np.array(found)


def _friction(
    joints: list[JointEntry], drives: Mapping[str, Drive], columns: Mapping[str, _Column], nv: int
) -> Friction:
    """Damping and Coulomb friction per velocity, those of followers folded into their leaders.

    A follower moves at ratio * dq, and its torque reaches the leader times ratio: damping counts
    ratio², friction |ratio|.
    """
    damping, friction = [0.0] * nv, [0.0] * nv
    for entry in joints:
        drive = drives[entry.name]
        for k in _velocities(entry, drive, columns):
            damping[k] += drive.ratio**2 * entry.damping
            friction[k] += abs(drive.ratio) * entry.friction
    return Friction.plain(np.array(damping), np.array(friction))


def _velocities(entry: JointEntry, drive: Drive, columns: Mapping[str, _Column]) -> range:
    """The places in dq that move a joint; none where its leader is fixed."""
    column = columns.get(drive.leader)
    return range(0) if column is None else range(column.v, column.v + entry.joint.nv)
