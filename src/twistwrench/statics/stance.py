"""Base of a legged robot that stands: from its joints and a foot that stays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import seconds
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.lie import quaternion, so3
from ..motion.motion import Motion
from ..robot.base import require_robot
from .contacts import Contact, contact_maps
from .feet import MIN_SOLE_WIDTH, sole, upward
from .torque_limits import floating_entries

if TYPE_CHECKING:
    from ..robot import Robot

_MIN_STANCE_DROP, _MIN_STANCE_TIME = 0.005, 0.02
"""A foot becomes the stance foot if it is lower than the other by so much [m] for so long [s]."""
_EQUAL_HEIGHT = 0.0005
"""Difference in height below which both feet stand, so that the new one keeps the place it had then [m]."""
_LEVEL = 0.01
"""Distance from one plane up to which all feet stand [m]."""
_LEANING = np.cos(np.radians(45.0))
"""Cosine of the largest angle between the feet's plane and the base's horizontal at the first instant."""


def base_from_stance(robot: Robot, motion: Motion, feet: Sequence[str], stance: str | Sequence[str] = "auto") -> Motion:
    """Motion with the pose and the rates of a floating base, from a motion of the joints and the foot that stands.

    The stance foot does not move: T_sb = T_sf T_bf(q)⁻¹, and the base's twist is V_b = -J_b⁻¹ J_q dq. Feet that are points
    stand together, three or more of them. At first the feet's plane is level at height 0; each new stance foot stays where
    it has come to.

    Parameters
    ----------
    robot : Robot, with a floating base
    motion : Motion, of the same robot with a fixed base
    feet : sequence of str, frames; the corners of their soles decide which is lowest
    stance : "auto", a frame, or a frame for each row
        "auto": the lowest foot; another takes over if it becomes lower by 5 mm for 20 ms, from equal heights on.

    Returns
    -------
    motion : Motion, of ``robot``

    Raises
    ------
    ShapeError, UnknownNameError, ValueRangeError
        The base is not free, the joints are others, or a stance frame is not a foot.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> from twistwrench.statics.feet import find_feet
    >>> held, free = (tw.load(tw.robots.path_of("quadruped"), floating_base=b) for b in (False, True))
    >>> q = np.tile([0, 0.8, -1.6], 4) + np.linspace(0, 0.1, 50)[:, None] * np.tile([0, 1, -2], 4)
    >>> motion = base_from_stance(free, tw.Motion(np.linspace(0, 1, 50), q, robot=held), find_feet(free))
    >>> foot = free.forward_kinematics(motion.q, "FL_foot")[:, :3, 3]
    >>> bool(np.ptp(foot, axis=0).max() < 1e-9)
    True
    """
    require_robot(robot, "base_from_stance")
    names = motion.robot.coordinate_names
    if not floating_entries(robot)[:6].all() or robot.coordinate_names[7:] != names:
        raise ShapeError(
            f"base_from_stance takes robot {robot.name!r} with a floating base, and a motion of its joints alone; the motion "
            f"has the coordinates {', '.join(names[:8])}. Load the robot with floating_base=True."
        )
    corners = {}
    for frame in feet:
        contacts = sole(motion.robot, frame, 0.0, q=motion.q[0])
        corners[frame] = np.array([contact.point for contact in contacts])
    soles = resting_points(corners)
    poses, standing = base_poses(motion.robot, motion.time, motion.q, soles, stance)
    q = np.column_stack([pose_coordinates(poses), motion.q])
    dq, ddq = stance_rates(robot, q, motion.dq, motion.ddq, soles, standing)
    tau = None
    if motion.tau is not None:
        tau = np.column_stack([np.zeros((len(q), 6)), motion.tau])
    return replace(motion, q=q, dq=dq, ddq=ddq, tau=tau, robot=robot, in_seconds=True, command=None)


def resting_points(soles: Mapping[str, Array]) -> dict[str, Array]:
    """Corners (k, 3) of each foot that rest with it; a foot of a biped without a known sole rests with its whole frame."""
    if len(soles) >= _FEET_OF_POINTS or any(len(points) > 1 for points in soles.values()):
        return dict(soles)
    return {frame: points + _BESIDE for frame, points in soles.items()}


_FEET_OF_POINTS = 3
"""Least number of feet that are points and determine the pose of the base together."""
_BESIDE = 0.005 * np.array([(1.0, 1, 0), (1, -1, 0), (-1, 0, 0)])
"""Points beside the origin of a foot without a sole [m]."""


def stance_rates(
    robot: Robot, q: Array, dq: Array, ddq: Array, soles: Mapping[str, Array], standing: Array
) -> tuple[Array, Array]:
    """Velocities and accelerations (n, nv) with those of the free base, from the joints' and the feet (n, k) that rest."""
    base = np.zeros((len(q), 6))
    V, A = np.column_stack([base, dq]), np.column_stack([base, ddq])
    if not soles:
        return V, A
    for mask in np.unique(standing, axis=0):
        rows = np.flatnonzero((standing == mask).all(axis=1))
        contacts: list[Contact] = []
        for frame in compress(soles, mask):
            contacts += [Contact(point, frame=frame) for point in soles[frame]]
        maps, _ = contact_maps(robot, q[rows], contacts)
        J = np.moveaxis(maps, 1, -1).reshape(len(rows), -1, robot.nv)  # of all points
        free = np.linalg.pinv(J[:, :, :6])
        V[rows, :6] = -_times(free, _times(J[:, :, 6:], V[rows, 6:]))
        drift = np.concatenate([_point_acceleration(robot, q[rows], V[rows], A[rows], c) for c in contacts], axis=1)
        A[rows, :6] = -_times(free, drift)
    return V, A


def _point_acceleration(robot: Robot, q: Array, dq: Array, ddq: Array, contact: Contact) -> Array:
    """Accelerations (n, 3) of a contact point in the base frame."""
    V = np.asarray(robot.frame_velocity(q, dq, contact.frame))
    A = np.asarray(robot.frame_acceleration(q, dq, ddq, contact.frame))
    w, v = V[:, :3], V[:, 3:]
    a = A[:, 3:] + np.cross(w, v) + np.cross(A[:, :3], contact.point) + np.cross(w, np.cross(w, contact.point))
    R = np.asarray(robot.forward_kinematics(q, contact.frame))[:, :3, :3]
    return _times(R, a)


def _times(A: Array, x: Array) -> Array:
    return np.asarray((A @ x[..., None])[..., 0])


def base_poses(
    robot: Robot,
    time: Array,
    q: Array,
    soles: Mapping[str, Array],
    stance: str | Sequence[str] = "auto",
    normal: Array | None = None,
) -> tuple[Array, Array]:
    """Poses (n, 4, 4) of the base of a robot that stands, and the feet (n, k) of bool whose points stay.

    ``robot`` has a fixed base; ``soles`` are the corners of each foot in its frame. A flat foot stands alone; feet that are
    points stand together, at least three of them. ``normal`` (3,) is that of the ground; None: the world's vertical axis.
    """
    up, frames = upward(robot), list(soles)
    ground = up if normal is None else normal
    corners = []
    for frame, points in soles.items():
        T = np.asarray(robot.forward_kinematics(q, frame)).reshape(-1, 4, 4)
        corners.append(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])
    start = _level([points[0] for points in corners], up, ground)
    chosen = _chosen_feet(stance, frames, len(q))
    if chosen is None and not any(_plane(points[0], up)[1] > MIN_SOLE_WIDTH for points in corners):
        return _PointFeet(time, corners, ground, frames).poses(start)
    return _flat_foot(time, corners, ground, start, chosen)


def _flat_foot(
    time: Array, corners: Sequence[Array], up: Array, start: Array, chosen: Array | None
) -> tuple[Array, Array]:
    """Poses of the base while one foot after the other keeps its place, and which one does."""
    n = len(time)
    T_sb, standing = np.tile(start, (n, 1, 1)), np.zeros((n, len(corners)), bool)
    if chosen is None:
        foot = int(_heights(corners, T_sb, up)[0].argmin())
    else:
        foot = int(chosen[0])
    row = 0
    while row < n:
        targets = corners[foot][row] @ T_sb[row, :3, :3].T + T_sb[row, :3, 3]
        T_sb[row:] = _fit_poses(corners[foot][row:], targets)
        if chosen is None:
            heights = _heights([c[row:] for c in corners], T_sb[row:], up)
            change, successor = _next_lowest(time[row:], heights, foot)
        else:
            change, successor = _next_chosen(chosen[row:], foot)
        standing[row : row + change, foot] = True
        row, foot = row + change, successor
    return T_sb, standing


class _PointFeet:
    """Base on feet that are points: those on the ground keep their places, at least three at a time."""

    def __init__(self, time: Array, corners: Sequence[Array], up: Array, frames: Sequence[str]) -> None:
        self.time, self.corners, self.up, self.frames = time, corners, up, frames

    def poses(self, start: Array) -> tuple[Array, Array]:
        """Poses (n, 4, 4) of the base, and the feet (n, k) that stand."""
        n, k = len(self.time), len(self.corners)
        T_sb, standing = np.tile(start, (n, 1, 1)), np.zeros((n, k), bool)
        heights = _heights(self.corners, T_sb[:1], self.up)[0]
        down, raised, row = heights <= heights.min() + _LEVEL, np.zeros(k, bool), 0
        while row < n:
            self._check(down, row)
            targets = [c[row] @ T_sb[row, :3, :3].T + T_sb[row, :3, 3] for c in self.corners]
            chosen = np.flatnonzero(down).tolist()
            points = np.concatenate([self.corners[i][row:] for i in chosen], axis=1)
            T_sb[row:] = _fit_poses(points, np.concatenate([targets[i] for i in chosen]))
            displacements = np.stack([self._displacement(i, row, T_sb, targets[i]) for i in range(k)], axis=1)
            heights = _heights([c[row:] for c in self.corners], T_sb[row:], self.up)
            floor = heights[:, down].min(axis=1, keepdims=True)
            leaves = (displacements > _MIN_STANCE_DROP) & down
            lifted = np.maximum.accumulate(heights > floor + 2 * _MIN_STANCE_DROP, axis=0) | raised
            enters = lifted & (heights <= floor + _MIN_STANCE_DROP) & ~down
            events = np.flatnonzero((leaves | enters)[1:].any(axis=1)) + 1
            if not len(events):
                standing[row:] = down
                break
            stop = int(events[0])
            standing[row : row + stop] = down
            raised = lifted[stop] & ~enters[stop]
            if leaves[stop].any():
                gone = int(np.where(down, displacements[stop], -1.0).argmax())
                down = down | enters[stop]
                down[gone] = raised[gone] = False
            else:
                down = down | enters[stop]
            row += stop
        return T_sb, standing

    def _displacement(self, foot: int, row: int, poses: Array, targets: Array) -> Array:
        """Distances (n,) of a foot's corners from where they stood, the largest of each row from ``row`` on."""
        points = np.einsum("nij,nkj->nki", poses[row:, :3, :3], self.corners[foot][row:]) + poses[row:, None, :3, 3]
        return np.asarray(np.linalg.norm(points - targets, axis=-1).max(axis=1))

    def _check(self, down: Array, row: int) -> None:
        points = np.concatenate([self.corners[i][row] for i in np.flatnonzero(down).tolist()])
        if _plane(points, self.up)[1] <= MIN_SOLE_WIDTH:
            names = listed([self.frames[i] for i in np.flatnonzero(down).tolist()])
            raise ValueRangeError(
                f"at t = {seconds(float(self.time[row]))} s the robot stands on {names} alone, which are points: the pose "
                "of its base is not known from the joints. Give a log with the pose of the base, and load the robot with a "
                "floating base; or give the sizes of the soles."
            )


def _fit_poses(points: Array, targets: Array) -> Array:
    """Poses (n, 4, 4) that bring points (n, k, 3) nearest to targets (k, 3). Source: Kabsch, Acta Cryst. A32, 1976."""
    middle, target = points.mean(axis=1), targets.mean(axis=0)
    U, _, Vt = np.linalg.svd(np.einsum("ki,nkj->nij", targets - target, points - middle[:, None]))
    D = np.tile(np.eye(3), (len(points), 1, 1))
    D[:, 2, 2] = np.sign(np.linalg.det(U @ Vt))
    R = U @ D @ Vt
    T = np.tile(np.eye(4), (len(points), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = R, target - _times(R, middle)
    return T


def _heights(corners: Sequence[Array], poses: Array, up: Array) -> Array:
    """Least height (n, k) of the corners (n, c, 3) of each foot."""
    return np.stack([_least_heights(c, poses, up) for c in corners], axis=1)


def _least_heights(corners: Array, poses: Array, up: Array) -> Array:
    return np.asarray((np.einsum("nij,nkj->nki", poses[:, :3, :3], corners) @ up).min(axis=1) + poses[:, :3, 3] @ up)


def _chosen_feet(stance: str | Sequence[str], frames: Sequence[str], n: int) -> Array | None:
    """Number (n,) of the stance foot of each row as given; None if it is to be found."""
    if isinstance(stance, str) and stance == "auto":
        return None
    names = [stance] * n if isinstance(stance, str) else list(stance)
    if len(names) != n:
        raise ShapeError(f"stance has {len(names)} frames for {n} rows. Give one frame, one for each row, or 'auto'.")
    for name in names:
        if name not in frames:
            raise UnknownNameError.from_choices("stance foot", name, frames)
    return np.array([frames.index(name) for name in names])


def _next_chosen(chosen: Array, foot: int) -> tuple[int, int]:
    other = np.flatnonzero(chosen != foot)
    if not len(other):
        return len(chosen), foot
    row = int(other[0])
    return row, int(chosen[row])


def _next_lowest(time: Array, heights: Array, foot: int) -> tuple[int, int]:
    """Rows until another foot has been lower for long enough, and that foot."""
    low = heights.argmin(axis=1)
    lower = heights[np.arange(len(low)), low] < heights[:, foot] - _MIN_STANCE_DROP
    lower[0] = False
    start = 0
    while True:
        begins = np.flatnonzero(lower[start:])
        if not len(begins):
            return len(time), foot
        first = start + int(begins[0])
        ends = np.flatnonzero(~lower[first:])
        last = first + int(ends[0]) if len(ends) else len(time)
        if time[last - 1] - time[first] >= _MIN_STANCE_TIME or (last == len(time) and last - first > 1):
            other = int(low[first])
            equal = np.flatnonzero(heights[:first, other] > heights[:first, foot] - _EQUAL_HEIGHT)
            first_lower = 1
            if len(equal):
                first_lower = int(equal[-1]) + 1
            return first_lower, other
        start = last


def level_pose(robot: Robot, points: Array, normal: Array) -> Array:
    """Pose (4, 4) of the base in which the plane of points (k, 3) is that of the ground through the origin."""
    return _level([points], upward(robot), normal)


def _level(corners: Sequence[Array], up: Array, ground: Array) -> Array:
    """Pose of the base in which the feet's plane is that of the ground, through the origin.

    If only one foot stands, the base's own axis ``up`` is along the ground's normal.
    """
    points = np.concatenate(corners)
    normal, width, distance = _plane(points, up)
    if not (distance <= _LEVEL and width > MIN_SOLE_WIDTH and normal @ up > _LEANING):
        heights = points @ up
        points = points[heights <= heights.min() + _LEVEL]
        normal, width, distance = _plane(points, up)
        if not (width > MIN_SOLE_WIDTH and normal @ up > _LEANING):
            normal = up
    T = np.eye(4)
    T[:3, :3] = _turn(normal, ground)
    T[:3, 3] = -(points @ T[:3, :3].T @ ground).min() * ground
    return T


def _plane(points: Array, up: Array) -> tuple[Array, float, float]:
    """Normal of the plane nearest to some points, the width across their line in it, and the farthest distance from it."""
    if len(points) < 3:
        return up, 0.0, 0.0
    offsets = points - points.mean(axis=0)
    _, widths, axes = np.linalg.svd(offsets, full_matrices=False)
    normal = axes[2]
    if normal @ up < 0:
        normal = -normal
    return normal, float(widths[1]), float(np.abs(offsets @ normal).max())


def _turn(start: Array, end: Array) -> Array:
    """Smallest rotation (3, 3) from one unit vector to another."""
    axis = np.cross(start, end)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-15:
        return np.eye(3)
    return np.asarray(so3.exp(axis / sine * np.arctan2(sine, float(start @ end))))


def pose_coordinates(poses: Array) -> Array:
    """Coordinates (n, 7) of a floating base: quaternion w, x, y, z of constant sign, and position."""
    quaternions = np.asarray(quaternion.from_matrix(poses[:, :3, :3]))
    same = np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0
    signs = np.cumprod(np.r_[1.0, np.where(same, 1.0, -1.0)])
    return np.column_stack([quaternions * signs[:, None], poses[:, :3, 3]])


complete(globals())
