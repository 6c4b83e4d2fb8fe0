"""Assembly of links and joints to a model with one body per moving joint; and the tip, the default frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import UnknownNameError
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..joints import Floating
from ..lie.identity import IDENTITY, is_identity, product
from .configurations import from_names
from .description import JointEntry, LinkEntry, SiteEntry
from .limits import Friction, Limits
from .mimic import Drive, shared_limits
from .model import BASE, Body, Frame, Model, OfferedClosure, Spring
from .snapping import snap_pose
from .tree import Tree


def fuse(model: Model, poses: Mapping[int, Array]) -> Model:
    """Model with the joints of some bodies fixed: ``poses[i]`` is the pose T_joint,child (4, 4) of body i.

    The inertia, frames and children of a fixed body move to the body that carries it; its coordinates and limits are removed.
    If a leader is in ``poses``, its followers must be too.
    """
    if not poses:
        return model
    carriers = _carriers(model, poses)
    moving_bodies = [body for i, body in enumerate(model.bodies) if i not in poses]
    inertias = {i: body.inertia for i, body in enumerate(moving_bodies)}  # by new index
    inertias[BASE] = model.base_inertia
    for i in sorted(poses):
        carrier, T = carriers[i]
        inertia = model.bodies[i].inertia
        if inertia.parameters.any():
            if not is_identity(T):
                inertia = inertia.in_frame(T)
            inertias[carrier] = inertias[carrier] + inertia
    leaders = [body for body in moving_bodies if not body.follows and body.joint.nv]
    leaders.sort(key=lambda body: body.v_index)
    q_columns: list[int] = []  # remaining columns of q, in order
    v_columns: list[int] = []  # remaining columns of dq
    for body in leaders:
        q_slice, v_slice = body.places
        q_columns += range(q_slice.start, q_slice.stop)
        v_columns += range(v_slice.start, v_slice.stop)
    new_q_index = {old: new for new, old in enumerate(q_columns)}
    new_v_index = {old: new for new, old in enumerate(v_columns)}
    bodies = []
    for i, body in enumerate(moving_bodies):
        carrier, T = carriers[body.parent]
        q_index = 0  # of a body without coordinates
        v_index = 0
        if body.joint.nv:
            q_index = new_q_index[body.q_index]
            v_index = new_v_index[body.v_index]
        placement = snap_pose(product(T, body.placement), model.snap)
        bodies.append(
            replace(body, parent=carrier, placement=placement, inertia=inertias[i], q_index=q_index, v_index=v_index)
        )
    return replace(
        model,
        bodies=tuple(bodies),
        frames=_frames_on_carriers(model.frames, carriers, model.snap),
        sites=_frames_on_carriers(model.sites, carriers, model.snap),
        base_inertia=inertias[BASE],
        limits=model.limits.select(v_columns),
        friction=model.friction.select(v_columns),
        armature=model.armature[v_columns],
        configurations={name: q[q_columns] for name, q in model.configurations.items()},
    )


def _carriers(model: Model, poses: Mapping[int, Array]) -> dict[int, tuple[int, Array]]:
    """New index of the body that each body becomes part of, and the pose (4, 4) there, by old index.

    A body that still moves is part of itself, and so is the base.
    """
    carriers: dict[int, tuple[int, Array]] = {BASE: (BASE, IDENTITY)}
    new_index = 0
    for i, body in enumerate(model.bodies):
        if i in poses:
            carrier, T_carrier_parent = carriers[body.parent]
            T_parent_body = snap_pose(product(body.placement, poses[i]), model.snap)
            carriers[i] = carrier, snap_pose(product(T_carrier_parent, T_parent_body), model.snap)
        else:
            carriers[i] = new_index, IDENTITY
            new_index += 1
    return carriers


def _frames_on_carriers(
    frames: Mapping[str, Frame], carriers: Mapping[int, tuple[int, Array]], snap: float
) -> dict[str, Frame]:
    """Frames moved from their bodies to the bodies that these become part of."""
    new_frames: dict[str, Frame] = {}
    for name, frame in frames.items():
        carrier, T = carriers[frame.body]
        new_frames[name] = Frame(carrier, snap_pose(product(T, frame.pose), snap))
    return new_frames


def default_tip(model: Model) -> str | None:
    """Last leaf in document order on the last moving body, if the moving joints form one chain; else None."""
    is_chain = all(body.parent == i - 1 for i, body in enumerate(model.bodies))  # the base is -1
    if not is_chain:
        return None
    last_body = len(model.bodies) - 1
    leaves_of_last_body = (name for name in reversed(model.leaves) if model.frames[name].body == last_body)
    return next(leaves_of_last_body, None)


def check_tip(model: Model, tip: str | None) -> str | None:
    """``tip``, or the default tip for None; raises :class:`~twistwrench.UnknownNameError` if the model lacks the frame."""
    if tip is None:
        return default_tip(model)
    if tip not in model.all_frames:
        raise UnknownNameError.from_choices("frame", tip, model.all_frames)
    return tip


ROOT_JOINT = "root_joint"
"""Name of the joint that ``floating_base=True`` adds."""


@dataclass(frozen=True)
class _Indices:
    """Indices of a leader's first coordinate and first velocity."""

    q: int
    v: int


@dataclass
class Additions:
    """Entries of a file other than links and joints."""

    sites: dict[str, SiteEntry] = field(default_factory=dict)
    springs: list[Spring] = field(default_factory=list)
    configurations: dict[str, dict[str, ArrayLike]] = field(default_factory=dict)
    """Positions of joints, by name of the configuration and of the joint."""
    closures: dict[str, OfferedClosure] = field(default_factory=dict)
    motor_joints: set[str] = field(default_factory=set)
    """Joints that the file's actuators drive."""
    mounted: bool = False
    """True if something is stated to hold the fixed root."""
    locked: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Fixed joints that were locked, each with the joints that mimicked it."""


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
    """Model of a checked tree, fixed links merged; a follower of a fixed joint, or with ratio 0, is fixed too.

    A body is made for every joint at first, also for fixed ones; :func:`fuse` then removes those of fixed joints.
    """
    joints = list(tree.joints)
    if floating_base:
        joints.insert(0, _root_entry(tree.root))
    leaders = [entry for entry in joints if entry.name not in drives and entry.joint.nv]
    leader_indices = _leader_indices(leaders)
    limits, limit_remarks = _limits(leaders, joints, drives)
    joint_drives = {entry.name: drives.get(entry.name, Drive(entry.name, 1.0, 0.0)) for entry in joints}
    body_of_link = {} if floating_base else {tree.root: BASE}
    bodies: list[Body] = []
    fixed_poses: dict[int, Array] = {}
    for i, entry in enumerate(joints):
        body_of_link[entry.child] = i
        drive = joint_drives[entry.name]
        never_moves = drive.leader not in leader_indices or drive.ratio == 0
        if never_moves:
            fixed_poses[i] = IDENTITY if entry.fixed else entry.joint.pose(np.array([drive.offset]))
        indices = leader_indices.get(drive.leader, _Indices(0, 0))
        follows = entry.name in drives
        effort = np.inf
        if follows and entry.joint.nv:
            effort = float(entry.limits.effort[0])
        bodies.append(
            Body(
                entry.joint, entry.child, body_of_link.get(entry.parent, BASE), snap_pose(entry.placement, snap),
                links[entry.child].inertia, indices.q, indices.v, drive.ratio, drive.offset, follows=follows, effort=effort,
            )
        )  # fmt: skip
    friction, armature = _friction_and_armature(joints, joint_drives, leader_indices, len(limits.lower))
    model = Model(
        name, tuple(bodies), tip=None, gravity=gravity, leaves=tree.leaves, source=source, snap=snap,
        frames={name: Frame(body_of_link[name], IDENTITY) for name, link in links.items() if not link.hidden},
        sites={
            site.name: Frame(body_of_link[site.link], snap_pose(site.pose, snap)) for site in additions.sites.values()
        },
        link_inertias={link.name: link.inertia for link in links.values() if not link.hidden},
        base_inertia=SpatialInertia.zero() if floating_base else links[tree.root].inertia,
        shaped=frozenset(link.name for link in links.values() if link.shaped),
        limits=limits, friction=friction, armature=armature,
        springs=_springs_of_leaders(additions.springs, drives, leader_indices),
        closures=additions.closures, motor_joints=frozenset(additions.motor_joints), mounted=additions.mounted,
        locked=_locked_joints(joints, additions.locked),
        mounts={entry.child: (entry.parent, entry.name) for entry in joints},
        defects=limit_remarks,
    )  # fmt: skip
    return fuse(_with_configurations(model, additions.configurations), fixed_poses)


def _with_configurations(model: Model, positions_by_name: Mapping[str, Mapping[str, ArrayLike]]) -> Model:
    """Model with named configurations, from positions of joints by name; positions of followers are ignored."""
    configurations: dict[str, Array] = {}
    for name, positions in positions_by_name.items():
        leader_positions = {joint: positions[joint] for joint in model.joint_names if joint in positions}
        configurations[name] = from_names(model, leader_positions)
    if not configurations:
        return model
    return replace(model, configurations=configurations)


def _leader_indices(leaders: Iterable[JointEntry]) -> dict[str, _Indices]:
    """Indices of each leader by name, in the order of q."""
    leader_indices: dict[str, _Indices] = {}
    nq = 0  # number of coordinates so far
    nv = 0
    for entry in leaders:
        leader_indices[entry.name] = _Indices(nq, nv)
        nq += entry.joint.nq
        nv += entry.joint.nv
    return leader_indices


def _limits(
    leaders: Iterable[JointEntry], joints: Iterable[JointEntry], drives: Mapping[str, Drive]
) -> tuple[Limits, tuple[str, ...]]:
    """Limits (nv,) of all leaders, which also keep their followers within theirs, and the remarks on them."""
    followers: dict[str, list[JointEntry]] = {}
    for entry in joints:
        if entry.name in drives:
            followers.setdefault(drives[entry.name].leader, []).append(entry)
    limits_of_leaders: list[Limits] = []
    remarks: list[str] = []
    for leader in leaders:
        leader_limits, leader_remarks = shared_limits(leader, followers.get(leader.name, ()), drives)
        limits_of_leaders.append(leader_limits)
        remarks += leader_remarks
    all_limits: dict[str, Array] = {}
    for kind in fields(Limits):
        values = [getattr(leader_limits, kind.name) for leader_limits in limits_of_leaders]
        all_limits[kind.name] = np.concatenate([np.zeros(0), *values])
    return Limits(**all_limits), tuple(remarks)


def _locked_joints(
    joints: Iterable[JointEntry], followers: Mapping[str, tuple[str, ...]]
) -> dict[str, tuple[str, ...]]:
    """Followers of each locked joint, in the order of the tree; without joints that are not fixed any more."""
    locked: dict[str, tuple[str, ...]] = {}
    for entry in joints:
        if entry.fixed and entry.name in followers:
            locked[entry.name] = followers[entry.name]
    return locked


def _springs_of_leaders(
    springs: Iterable[Spring], drives: Mapping[str, Drive], leader_indices: Mapping[str, _Indices]
) -> tuple[Spring, ...]:
    """Springs between coordinates of leaders, without springs whose joints are all fixed."""
    between_leaders = [_spring_of_leaders(spring, drives, leader_indices) for spring in springs]
    return tuple(spring for spring in between_leaders if spring.terms)


def _spring_of_leaders(spring: Spring, drives: Mapping[str, Drive], leader_indices: Mapping[str, _Indices]) -> Spring:
    """Spring between coordinates of leaders; a follower's coordinate is ratio times its leader's, plus the offset."""
    weights: dict[str, float] = {}
    rest = spring.rest
    for joint, weight in spring.terms:
        drive = drives.get(joint, Drive(joint, 1.0, 0.0))
        rest -= weight * drive.offset
        if drive.leader in leader_indices and drive.ratio:
            weights[drive.leader] = weights.get(drive.leader, 0.0) + weight * drive.ratio
    return Spring(tuple(weights.items()), spring.stiffness, rest)


def _root_entry(root: str) -> JointEntry:
    """Floating joint of the root link."""
    infinity = np.full(6, np.inf)
    no_limits = Limits(-infinity, infinity, infinity, infinity)
    joint = Floating(ROOT_JOINT, np.eye(6))
    return JointEntry(joint, "", root, IDENTITY, no_limits, 0.0, 0.0, None, "")


def _friction_and_armature(
    joints: list[JointEntry], drives: Mapping[str, Drive], leader_indices: Mapping[str, _Indices], nv: int
) -> tuple[Friction, Array]:
    """Friction and armature (nv,) of leaders, to which friction and armature of their followers are added.

    A follower moves at ratio * dq, and its torque acts on the leader times ratio: damping and armature are scaled by
    ratio², friction by |ratio|.
    """
    damping = [0.0] * nv
    friction = [0.0] * nv
    armature = [0.0] * nv
    for entry in joints:
        drive = drives[entry.name]
        indices = leader_indices.get(drive.leader)
        if indices is None:
            continue
        for k in range(indices.v, indices.v + entry.joint.nv):
            damping[k] += drive.ratio**2 * entry.damping
            friction[k] += abs(drive.ratio) * entry.friction
            armature[k] += drive.ratio**2 * entry.armature
    return Friction.plain(np.array(damping), np.array(friction)), np.array(armature)
