"""Assembly of links and joints to a model, with mimic joints, the default tip, and round-off cleanup of rotations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import ModelError, ShapeError, UnknownNameError
from ...core.numbers import TOLERANCE, number
from ...core.text import argument, listed
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..joints import Floating
from ..lie.identity import IDENTITY, UPRIGHT, is_identity, product
from .description import JointEntry, LinkEntry, Mimic, SiteEntry
from .limits import BEARINGS, Friction, Limits
from .model import BASE, Body, Frame, Model, OfferedClosure, Spring, Tree

DEFAULT_SNAP = 1e-9
"""Distance from 0 or ±1 below which an entry of a fixed rotation is set to it."""

_ROUNDING = 4.5e-16, 1e-15
"""Deviations of R'R and R R' from the identity within rounding errors of three products: a rotation with a smaller one is
kept; the second bound applies after orthonormalisation."""

_ONE = np.eye(3)


def snap_rotation(R: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """R (3, 3) with entries within ``tolerance`` of 0 or ±1 set to it, orthonormalised again; a tolerance of 0 disables it.

    Robot files write a right angle as 1.57079632679, and the cosine of the nearest float to π/2 is 6e-17. Exact zeros
    and ones vanish from compiled kernels; these values do not. An entry becomes ±1 only together with the zeros beside
    it: cos(1e-5) is within the tolerance of 1, but a small angle must stay. The remaining entries are orthonormalised
    to the last bit, because algorithms use the transpose as the inverse. The result is a signed permutation, a rotation
    about one axis, or a rotation with one zero entry. If no rotation has these zeros, R is unchanged.
    """
    if tolerance == 0:
        return R
    rows = R.tolist()
    zero = [[abs(x) <= tolerance for x in row] for row in rows]
    across, down = [sum(row) for row in zero], [sum(column) for column in zip(*zero, strict=True)]
    alone = [(i, j) for i in range(3) for j in range(3) if across[i] == down[j] == 2 and not zero[i][j]]
    found = [
        [0.0 if none else x for x, none in zip(row, mask, strict=True)] for row, mask in zip(rows, zero, strict=True)
    ]
    for i, j in alone:
        found[i][j] = math.copysign(1.0, rows[i][j])
    snapped = np.array(found)
    if found == rows or len(alone) == 3 or _is_rotation(snapped, _ROUNDING[0]):
        return snapped
    if alone:
        i, j = alone[0]
        rest = np.ix_([k for k in range(3) if k != i], [k for k in range(3) if k != j])
        snapped[rest] = _nearest_of_two(snapped[rest])
    elif sum(across) == 1:
        snapped = _with_one_zero(snapped, across.index(1))
    return snapped if _is_rotation(snapped, _ROUNDING[1]) else R


def _is_rotation(R: Array, allowed: float) -> bool:
    return all(bool(np.abs(product - _ONE).max() <= allowed) for product in (R.T @ R, R @ R.T))


def _nearest_of_two(B: Array) -> Array:
    """Orthogonal matrix nearest to B (2, 2): a rotation or a reflection, like B."""
    (a, b), (c, d) = B
    side = 1.0 if a * d - b * c > 0 else -1.0
    x, y = a + side * d, c - side * b
    x, y = x / np.hypot(x, y), y / np.hypot(x, y)
    return np.array([[x, -side * y], [y, side * x]])


def _with_one_zero(R: Array, i: int) -> Array:
    """R orthonormalised by Gram–Schmidt, from row i, which has the zero; determinant 1."""
    first, second = R[i] / np.linalg.norm(R[i]), R[(i + 1) % 3]
    for _ in range(2):  # twice, against rounding errors
        second = second - (first @ second) * first
        second = second / np.linalg.norm(second)
    found = np.empty((3, 3))
    found[i], found[(i + 1) % 3], found[(i + 2) % 3] = first, second, np.cross(first, second)
    return found


def snap_pose(T: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """T (4, 4) with its rotation snapped; the position is unchanged."""
    if tolerance == 0 or T is IDENTITY:
        return T
    if T[:3, :3].tolist() == UPRIGHT:
        return np.asarray(T + 0.0)  # no negative zeros
    snapped = T.copy()
    snapped[:3, :3] = snap_rotation(T[:3, :3], tolerance)
    return snapped


# ── Assembly of a model from described links and joints: fusing, mimic joints, tip frame, configurations


def fuse(model: Model, held: Mapping[int, Array]) -> Model:
    """Model with the joints of some bodies fixed: ``held[i]`` is the pose T_joint,child (4, 4) of body i.

    The inertia, frames and children of such a body move to the body that carries it; its coordinates and limits are
    removed. If a leader is in ``held``, its followers must be too.
    """
    if not held:
        return model
    snap = model.snap
    carriers = _carriers(model, held)
    kept = [body for i, body in enumerate(model.bodies) if i not in held]
    inertias = {BASE: model.base_inertia, **{i: body.inertia for i, body in enumerate(kept)}}
    for i in sorted(held):
        carrier, T = carriers[i]
        if model.bodies[i].inertia.parameters.any():
            inertias[carrier] = inertias[carrier] + _seen_from(T, model.bodies[i].inertia)
    leaders = [body for i, body in enumerate(model.bodies) if i not in held and not body.follows and body.joint.nv]
    leaders.sort(key=lambda body: body.v_index)
    q_pick = np.array([k for b in leaders for k in range(b.q_index, b.q_index + b.joint.nq)], int)
    v_pick = np.array([k for b in leaders for k in range(b.v_index, b.v_index + b.joint.nv)], int)
    q_new, v_new = ({old: new for new, old in enumerate(pick.tolist())} for pick in (q_pick, v_pick))
    carriers[BASE] = (BASE, IDENTITY)
    bodies = tuple(
        replace(
            body,
            parent=carriers[body.parent][0],
            placement=snap_pose(product(carriers[body.parent][1], body.placement), snap),
            inertia=inertias[i],
            q_index=q_new[body.q_index] if body.joint.nv else 0,
            v_index=v_new[body.v_index] if body.joint.nv else 0,
        )
        for i, body in enumerate(kept)
    )

    def carried(frames: Mapping[str, Frame]) -> dict[str, Frame]:
        return {
            name: Frame(carriers[f.body][0], snap_pose(product(carriers[f.body][1], f.pose), snap))
            for name, f in frames.items()
        }

    return replace(
        model,
        bodies=bodies,
        frames=carried(model.frames),
        sites=carried(model.sites),
        base_inertia=inertias[BASE],
        limits=Limits(*(values[v_pick] for values in vars(model.limits).values())),
        friction=model.friction.select(v_pick),
        armature=model.armature[v_pick],
        configurations={name: q[q_pick] for name, q in model.configurations.items()},
    )


def _carriers(model: Model, held: Mapping[int, Array]) -> dict[int, tuple[int, Array]]:
    """New index of the body that carries each body, and its pose there."""
    carriers: dict[int, tuple[int, Array]] = {}
    count = 0
    for i, body in enumerate(model.bodies):
        if i in held:
            carrier, T = (BASE, IDENTITY) if body.parent == BASE else carriers[body.parent]
            T_body = snap_pose(product(body.placement, held[i]), model.snap)
            carriers[i] = carrier, snap_pose(product(T, T_body), model.snap)
        else:
            carriers[i] = count, IDENTITY
            count += 1
    return carriers


def _seen_from(T: Array, inertia: SpatialInertia) -> SpatialInertia:
    # Exact for a body in its own frame.
    return inertia if is_identity(T) else inertia.in_frame(T)


# ── Configurations of a robot: by joint names, and random

_ENDLESS = 1e3
"""rad or m: limits beyond it count as none; at an angle of 1e16 neighbouring doubles differ by 2 rad."""


def from_names(model: Model, joints: Mapping[str, ArrayLike]) -> Array:
    """q (nq,) with the named joints as given and the others neutral."""
    q = model.neutral
    by_name = {body.joint.name: body for body in model.leaders}
    for name, value in joints.items():
        if name not in by_name:
            raise UnknownNameError.from_choices("joint", name, by_name)
        body = by_name[name]
        try:
            given = np.atleast_1d(np.asarray(value, float))
        except (TypeError, ValueError):
            raise ShapeError(f"the coordinate of joint {name!r} is {value!r}, expected a number.") from None
        if given.shape != (body.joint.nq,):
            raise ShapeError(
                f"joint {name!r} ({body.joint.kind}) takes {body.joint.nq} numbers, got shape {given.shape}."
            )
        q[body.places[0]] = given
    return q


def random_configuration(model: Model, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Random q (*shape, nq): inside the limits, unbounded joints within ±π or ±1 m, quaternions uniform.

    Limits above 1000 rad or m, such as ±1e16 in files of propellers, count as none.
    """
    parts = [_random(model, body, rng, shape) for body in model.leaders]
    return np.concatenate([np.zeros((*shape, 0)), *parts], axis=-1)


def _random(model: Model, body: Body, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    joint, mine = body.joint, body.places[1]
    reach = np.where(np.any(joint.axes[:, :3] != 0, axis=1), np.pi, 1.0)
    lower, upper = model.limits.lower[mine], model.limits.upper[mine]
    lower, upper = np.where(lower < -_ENDLESS, -np.inf, lower), np.where(upper > _ENDLESS, np.inf, upper)
    # If only one limit is given, the other bound is at least the default range away from it.
    free_lower = np.minimum(-reach, np.where(np.isfinite(upper), upper - reach, -reach))
    free_upper = np.maximum(reach, np.where(np.isfinite(lower), lower + reach, reach))
    lower, upper = np.where(np.isfinite(lower), lower, free_lower), np.where(np.isfinite(upper), upper, free_upper)
    return joint.random(rng, shape, lower, upper)


# ── Tip: the default frame


def default_tip(model: Model) -> str | None:
    """Last leaf in document order on the last moving body, if the moving joints form one chain; else None."""
    if any(body.parent != i - 1 for i, body in enumerate(model.bodies)):
        return None
    last = len(model.bodies) - 1
    return next((name for name in reversed(model.leaves) if model.frames[name].body == last), None)


def check_tip(model: Model, tip: str | None) -> str | None:
    """``tip`` if the model has this frame; None: the default tip; raises :class:`~twistwrench.UnknownNameError`."""
    if tip is None:
        return default_tip(model)
    if tip not in model.all_frames:
        raise UnknownNameError.from_choices("frame", tip, model.all_frames)
    return tip


# ── Mimic joints: resolved leaders, ratios and offsets, and limits inherited by leaders

MIMIC_POLICIES = ("follow", "independent")
"""``follow``: mimic joints share their leader's coordinate. ``independent``: mimic joints are ordinary joints."""


@dataclass(frozen=True)
class Drive:
    """Coordinate of a follower: ``ratio`` times its leader's, plus ``offset``; the leader is not a follower itself."""

    leader: str
    ratio: float
    offset: float


def find_drives(joints: Iterable[JointEntry]) -> dict[str, Drive]:
    """Drive of each follower by name, with chains resolved; a mimic entry of a fixed joint is ignored.

    Raises :class:`~twistwrench.ModelError` for cycles, missing leaders, and joints with several coordinates.
    """
    by_name = {joint.name: joint for joint in joints}
    found: dict[str, Drive] = {}
    for joint in by_name.values():
        path: dict[str, tuple[JointEntry, Mimic]] = {}  # followers up to a resolved or independent joint
        while joint.mimic is not None and not joint.fixed and joint.name not in found:
            leader = joint.mimic[0]
            _check_pair(joint, leader, by_name)
            path[joint.name] = joint, joint.mimic
            if leader in path:
                names = [*path]
                loop = listed(map(repr, [*names[names.index(leader) :], leader]), between=" → ")
                raise ModelError(
                    f"{path[names[0]][0]} is part of a mimic cycle, {loop}. Remove the <mimic> of one of them."
                )
            joint = by_name[leader]
        drive = found.get(joint.name, Drive(joint.name, 1.0, 0.0))
        for name, (_, (_, ratio, offset)) in reversed(path.items()):
            found[name] = drive = Drive(drive.leader, ratio * drive.ratio, offset + ratio * drive.offset)
    return found


def _check_pair(joint: JointEntry, leader: str, by_name: Mapping[str, JointEntry]) -> None:
    if leader not in by_name:
        found = UnknownNameError.from_choices("joint", leader, by_name)
        raise ModelError(
            f"the mimic leader of {joint} is not there: {found} Or load with {argument('mimic', 'independent')}."
        )
    for one in (joint, by_name[leader]):
        if one.joint.nv > 1:
            raise ModelError(
                f"{joint} mimics {by_name[leader]}, but a {one.joint.kind} joint has several coordinates and can "
                f"neither mimic nor be mimicked. Load with {argument('mimic', 'independent')}, or remove the <mimic>."
            )


def shared_limits(
    leader: JointEntry, followers: Iterable[JointEntry], drives: Mapping[str, Drive]
) -> tuple[Limits, list[str]]:
    """Limits of a leader within which its followers keep theirs, and a note on each follower for which none exist.

    Limits of position and velocity are shared. A follower keeps its own effort limit: see :func:`follower_torques`.
    """
    limits, remarks = leader.limits, []
    for joint in followers:
        drive = drives[joint.name]
        if not drive.ratio:
            continue
        slack = limits.tolerance
        least, most = np.sort((np.stack([joint.limits.lower, joint.limits.upper]) - drive.offset) / drive.ratio, axis=0)
        lower = np.where(least > limits.lower + slack, least, limits.lower)
        upper = np.where(most < limits.upper - slack, most, limits.upper)
        if (upper - lower <= slack).any() and (limits.upper - limits.lower > slack).all():
            own = f"{number(float(joint.limits.lower[0]))} to {number(float(joint.limits.upper[0]))}"
            remarks.append(
                f"{joint} follows {leader} by {number(drive.ratio)} and cannot keep to its limits, {own}, wherever that "
                "moves within its own; they are left out"
            )
        else:
            limits = replace(limits, lower=lower, upper=upper)
        for name in ("velocity", "acceleration", "deceleration", "jerk"):
            theirs, own = getattr(joint.limits, name) / abs(drive.ratio), getattr(limits, name)
            limits = replace(limits, **{name: np.where(theirs < (1 - TOLERANCE) * own, theirs, own)})
    return limits, remarks


def follower_torques(model: Model, F: Array) -> Array:
    """Torques of followers with an effort limit, (..., k) [N m or N], from wrenches across the joints (..., nbodies, 6).

    τ = S' F for each of ``model.limited_followers``: torque of a motor at the follower, without friction.
    """
    which = model.limited_followers
    return np.stack([F[..., i, :] @ model.bodies[i].joint.axes[0] for i in which], axis=-1)


def bearing_loads(model: Model, F: Array) -> dict[str, Array]:
    """Loads (..., nbodies) of the bearings by kind, from wrenches across the joints (..., nbodies, 6).

    NaN at joints with other than one degree of freedom, and for forces along the axes of sliding joints, which motors bear.
    """
    found = {kind: np.full(F.shape[:-1], np.nan) for kind in BEARINGS}
    for i, body in enumerate(model.bodies):
        if body.joint.nv != 1 or not body.joint.moves_body:
            continue
        moment, force, S = F[..., i, :3], F[..., i, 3:], body.joint.axes[0]
        turns = bool(S[:3].any())
        a = S[:3] if turns else S[3:]
        a = np.asarray(a / np.linalg.norm(a), float)
        along = force @ a
        if turns:
            found["axial"][..., i] = np.abs(along)
        found["radial"][..., i] = np.linalg.norm(force - along[..., None] * a, axis=-1)
        across = moment - (moment @ a)[..., None] * a if turns else moment
        found["tilting"][..., i] = np.linalg.norm(across, axis=-1)
    return found


# ── Assembly of links and joints to a model with one body per joint

ROOT_JOINT = "root_joint"
"""Name of the joint that ``floating_base=True`` adds."""


@dataclass(frozen=True)
class _Column:
    """Indices of a leader's first coordinate and first velocity."""

    q: int
    v: int


@dataclass
class Additions:
    """Entries of a file other than links and joints."""

    sites: dict[str, SiteEntry] = field(default_factory=dict)
    springs: list[Spring] = field(default_factory=list)
    configurations: dict[str, dict[str, ArrayLike]] = field(default_factory=dict)
    closures: dict[str, OfferedClosure] = field(default_factory=dict)
    motor_joints: set[str] = field(default_factory=set)
    """Joints that the file's actuators drive."""
    mounted: bool = False
    """True if something is stated to hold the fixed root."""


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
    """Model of a checked tree, fixed links merged; a follower of a fixed joint, or with ratio 0, is fixed too."""
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
                entry.joint, entry.child, index.get(entry.parent, BASE), snap_pose(entry.placement, snap),
                links[entry.child].inertia, column.q, column.v, drive.ratio, drive.offset, follows=entry.name in drives,
                effort=float(entry.limits.effort[0]) if entry.name in drives and entry.joint.nv else np.inf,
            )
        )  # fmt: skip
    friction, armature = _losses(joints, every, columns, nv)
    model = Model(
        name, tuple(bodies), tip=None, gravity=gravity, leaves=tree.leaves, source=source, snap=snap,
        frames={name: Frame(index[name], IDENTITY) for name, link in links.items() if not link.hidden},
        sites={site.name: Frame(index[site.link], snap_pose(site.pose, snap)) for site in additions.sites.values()},
        link_inertias={link.name: link.inertia for link in links.values() if not link.hidden},
        base_inertia=SpatialInertia.zero() if floating_base else links[tree.root].inertia,
        shaped=frozenset(link.name for link in links.values() if link.shaped),
        limits=_stacked([shared for shared, _ in limits]), friction=friction, armature=armature,
        springs=tuple(s for s in (_led(s, drives, columns) for s in additions.springs) if s.terms),
        closures=additions.closures, motor_joints=frozenset(additions.motor_joints), mounted=additions.mounted,
        mounts={entry.child: (entry.parent, entry.name) for entry in joints},
        defects=tuple(text for _, remarks in limits for text in remarks),
    )  # fmt: skip
    configurations = {  # mimic joints follow
        label: from_names(model, {joint: q[joint] for joint in model.joint_names if joint in q})
        for label, q in additions.configurations.items()
    }
    return fuse(replace(model, configurations=configurations) if configurations else model, held)


def _led(spring: Spring, drives: Mapping[str, Drive], columns: Mapping[str, _Column]) -> Spring:
    """Spring between leading coordinates, with the extension of their followers included."""
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
    return Limits(*(np.concatenate([np.zeros(0), *(getattr(one, f.name) for one in limits)]) for f in fields(Limits)))


def _losses(
    joints: list[JointEntry], drives: Mapping[str, Drive], columns: Mapping[str, _Column], nv: int
) -> tuple[Friction, Array]:
    """Friction and armature per velocity, with those of followers added to their leaders.

    A follower moves at ratio * dq, and its torque acts on the leader times ratio: damping and armature are scaled by
    ratio², friction by |ratio|.
    """
    damping, friction, armature = [0.0] * nv, [0.0] * nv, [0.0] * nv
    for entry in joints:
        drive = drives[entry.name]
        column = columns.get(drive.leader)
        for k in () if column is None else range(column.v, column.v + entry.joint.nv):
            damping[k] += drive.ratio**2 * entry.damping
            friction[k] += abs(drive.ratio) * entry.friction
            armature[k] += drive.ratio**2 * entry.armature
    return Friction.plain(np.array(damping), np.array(friction)), np.array(armature)
