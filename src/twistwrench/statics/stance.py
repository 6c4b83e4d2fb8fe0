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

_MIN_STANCE_DROP = 0.005
"""A foot becomes the stance foot if it is lower than the other by this height [m]."""
_MIN_STANCE_TIME = 0.02
"""The new stance foot must be lower for this time [s]."""
_MAX_EQUAL_HEIGHT = 0.0005
"""Difference in height up to which both feet stand [m]. The new stance foot keeps its place of the last such row."""
_MAX_DISTANCE_FROM_PLANE = 0.01
"""Largest distance of points from one plane for which they all stand on it [m]."""
_MIN_COSINE_OF_LEAN = np.cos(np.radians(45.0))
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
    """Corners (k, 3) of each foot that do not move while it stands.

    One or two feet without known soles do not determine the pose of the base. They get three corners each, so that their
    whole frame does not move.
    """
    if len(soles) >= _MIN_POINT_FEET or any(len(points) > 1 for points in soles.values()):
        return dict(soles)
    return {frame: points + _CORNERS_OF_UNKNOWN_SOLE for frame, points in soles.items()}


_MIN_POINT_FEET = 3
"""Least number of feet that determine the pose of the base together if they are points."""
_CORNERS_OF_UNKNOWN_SOLE = 0.005 * np.array([(1.0, 1, 0), (1, -1, 0), (-1, 0, 0)])
"""Corners (3, 3) about the origin of a foot without a known sole [m]."""


def stance_rates(
    robot: Robot, q: Array, dq: Array, ddq: Array, soles: Mapping[str, Array], standing: Array
) -> tuple[Array, Array]:
    """Velocities and accelerations (n, nv) of base and joints, from those of the joints (n, nv - 6).

    ``standing`` (n, k) is true for the feet whose points do not move: J_b V_b + J_q dq = 0 gives the base's twist, and the
    accelerations of these points without that of the base give its rate.
    """
    base = np.zeros((len(q), 6))
    velocities = np.column_stack([base, dq])
    accelerations = np.column_stack([base, ddq])
    if not soles:
        return velocities, accelerations
    for mask in np.unique(standing, axis=0):
        rows = np.flatnonzero((standing == mask).all(axis=1))
        contacts: list[Contact] = []
        for frame in compress(soles, mask):
            contacts += [Contact(point, frame=frame) for point in soles[frame]]
        maps, _ = contact_maps(robot, q[rows], contacts)
        J = np.moveaxis(maps, 1, -1).reshape(len(rows), -1, robot.nv)  # of all points
        inverse_J_b = np.linalg.pinv(J[:, :, :6])
        velocities[rows, :6] = -_apply(inverse_J_b, _apply(J[:, :, 6:], velocities[rows, 6:]))
        without_base = []
        for contact in contacts:
            a = _point_acceleration(robot, q[rows], velocities[rows], accelerations[rows], contact)
            without_base.append(a)
        accelerations[rows, :6] = -_apply(inverse_J_b, np.concatenate(without_base, axis=1))
    return velocities, accelerations


def _point_acceleration(robot: Robot, q: Array, dq: Array, ddq: Array, contact: Contact) -> Array:
    """Accelerations (n, 3) of a contact point in the base frame."""
    V = np.asarray(robot.frame_velocity(q, dq, contact.frame))
    A = np.asarray(robot.frame_acceleration(q, dq, ddq, contact.frame))
    w, v = V[:, :3], V[:, 3:]
    a = A[:, 3:] + np.cross(w, v) + np.cross(A[:, :3], contact.point) + np.cross(w, np.cross(w, contact.point))
    R = np.asarray(robot.forward_kinematics(q, contact.frame))[:, :3, :3]
    return _apply(R, a)


def _apply(matrices: Array, vectors: Array) -> Array:
    """Products (..., m) of matrices (..., m, n) and vectors (..., n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def base_poses(
    robot: Robot,
    time: Array,
    q: Array,
    soles: Mapping[str, Array],
    stance: str | Sequence[str] = "auto",
    normal: Array | None = None,
) -> tuple[Array, Array]:
    """Poses (n, 4, 4) of the base of a robot that stands, and a mask (n, k) of the feet whose points do not move.

    ``robot`` has a fixed base; ``soles`` are the corners of each foot in its frame. A flat foot stands alone; feet that are
    points stand together, at least three of them. ``normal`` (3,) is that of the ground; None: the world's vertical axis.
    """
    up = upward(robot)
    frames = list(soles)
    ground_normal = up if normal is None else normal
    corners = []  # of each foot, (n, c, 3) in the frame of the base
    for frame, points in soles.items():
        T = np.asarray(robot.forward_kinematics(q, frame)).reshape(-1, 4, 4)
        corners.append(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])
    start = _pose_on_plane([points[0] for points in corners], up, ground_normal)
    chosen = _chosen_feet(stance, frames, len(q))
    widths = [_nearest_plane(points[0], up)[1] for points in corners]
    if chosen is None and max(widths) <= MIN_SOLE_WIDTH:
        return _PointFeet(time, corners, ground_normal, frames).poses(start)
    return _flat_foot(time, corners, ground_normal, start, chosen)


def _flat_foot(
    time: Array, corners: Sequence[Array], up: Array, start: Array, chosen: Array | None
) -> tuple[Array, Array]:
    """Poses of the base while one foot after the other stands, and a mask of the foot that stands.

    ``chosen`` is the number of the stance foot in each row; None: the lowest foot stands.
    """
    n = len(time)
    T_sb = np.tile(start, (n, 1, 1))
    standing = np.zeros((n, len(corners)), bool)
    if chosen is None:
        foot = int(_sole_heights(corners, T_sb, up)[0].argmin())
    else:
        foot = int(chosen[0])
    row = 0  # from which on ``foot`` stands
    while row < n:
        targets = corners[foot][row] @ T_sb[row, :3, :3].T + T_sb[row, :3, 3]
        T_sb[row:] = _fit_poses(corners[foot][row:], targets)
        if chosen is None:
            heights = _sole_heights([c[row:] for c in corners], T_sb[row:], up)
            row_count, successor = _next_lowest(time[row:], heights, foot)
        else:
            row_count, successor = _next_chosen(chosen[row:], foot)
        standing[row : row + row_count, foot] = True
        row += row_count
        foot = successor
    return T_sb, standing


class _PointFeet:
    """Base on feet that are points: those on the ground keep their places, at least three at a time."""

    def __init__(self, time: Array, corners: Sequence[Array], up: Array, frames: Sequence[str]) -> None:
        self.time = time
        self.corners = corners
        self.up = up
        self.frames = frames

    def poses(self, start: Array) -> tuple[Array, Array]:
        """Poses (n, 4, 4) of the base, and a mask (n, k) of the feet that stand."""
        n, k = len(self.time), len(self.corners)
        T_sb = np.tile(start, (n, 1, 1))
        standing = np.zeros((n, k), bool)
        heights = _sole_heights(self.corners, T_sb[:1], self.up)[0]
        down = heights <= heights.min() + _MAX_DISTANCE_FROM_PLANE  # (k,) feet that stand from ``row`` on
        raised = np.zeros(k, bool)  # feet that were lifted since they stood, and so may stand again
        row = 0
        while row < n:
            self._require_area(down, row)
            targets = [c[row] @ T_sb[row, :3, :3].T + T_sb[row, :3, 3] for c in self.corners]
            standing_feet = np.flatnonzero(down).tolist()
            points = np.concatenate([self.corners[i][row:] for i in standing_feet], axis=1)
            T_sb[row:] = _fit_poses(points, np.concatenate([targets[i] for i in standing_feet]))
            displacements = np.stack([self._displacement(i, row, T_sb, targets[i]) for i in range(k)], axis=1)
            heights = _sole_heights([c[row:] for c in self.corners], T_sb[row:], self.up)
            floor = heights[:, down].min(axis=1, keepdims=True)
            leaves = (displacements > _MIN_STANCE_DROP) & down
            lifted = np.maximum.accumulate(heights > floor + 2 * _MIN_STANCE_DROP, axis=0) | raised
            lands = lifted & (heights <= floor + _MIN_STANCE_DROP) & ~down
            events = np.flatnonzero((leaves | lands)[1:].any(axis=1)) + 1
            if not len(events):
                standing[row:] = down
                break
            row_count = int(events[0])
            standing[row : row + row_count] = down
            raised = lifted[row_count] & ~lands[row_count]
            if leaves[row_count].any():  # only the foot that slides most leaves; the others may then fit again
                leaving = int(np.where(down, displacements[row_count], -1.0).argmax())
                down = down | lands[row_count]
                down[leaving] = False
                raised[leaving] = False
            else:
                down = down | lands[row_count]
            row += row_count
        return T_sb, standing

    def _displacement(self, foot: int, row: int, poses: Array, targets: Array) -> Array:
        """Largest distance (m,) of a foot's corners from their targets, in each of the m rows from ``row`` on."""
        points = np.einsum("nij,nkj->nki", poses[row:, :3, :3], self.corners[foot][row:]) + poses[row:, None, :3, 3]
        return np.asarray(np.linalg.norm(points - targets, axis=-1).max(axis=1))

    def _require_area(self, down: Array, row: int) -> None:
        """Raise ValueRangeError if the points of the feet that stand lie on one line."""
        standing_feet = np.flatnonzero(down).tolist()
        points = np.concatenate([self.corners[i][row] for i in standing_feet])
        _, width, _ = _nearest_plane(points, self.up)
        if width <= MIN_SOLE_WIDTH:
            names = listed([self.frames[i] for i in standing_feet])
            raise ValueRangeError(
                f"at t = {seconds(float(self.time[row]))} s the robot stands on {names} alone, which are points: the pose "
                "of its base is not known from the joints. Give a log with the pose of the base, and load the robot with a "
                "floating base; or give the sizes of the soles."
            )


def _fit_poses(points: Array, targets: Array) -> Array:
    """Poses (n, 4, 4) that bring points (n, k, 3) nearest to targets (k, 3). Source: Kabsch, Acta Cryst. A32, 1976."""
    point_means = points.mean(axis=1)
    target_mean = targets.mean(axis=0)
    U, _, Vt = np.linalg.svd(np.einsum("ki,nkj->nij", targets - target_mean, points - point_means[:, None]))
    D = np.tile(np.eye(3), (len(points), 1, 1))
    D[:, 2, 2] = np.sign(np.linalg.det(U @ Vt))  # a rotation, not a reflection
    R = U @ D @ Vt
    T = np.tile(np.eye(4), (len(points), 1, 1))
    T[:, :3, :3] = R
    T[:, :3, 3] = target_mean - _apply(R, point_means)
    return T


def _sole_heights(corners: Sequence[Array], poses: Array, up: Array) -> Array:
    """Heights (n, k) of the lowest corners of the feet, with corners (n, c, 3) of each."""
    return np.stack([_least_heights(foot_corners, poses, up) for foot_corners in corners], axis=1)


def _least_heights(corners: Array, poses: Array, up: Array) -> Array:
    """Heights (n,) of the lowest of the corners (n, c, 3) in the frame of a base at ``poses`` (n, 4, 4)."""
    heights_above_base = np.einsum("nij,nkj->nki", poses[:, :3, :3], corners) @ up
    return np.asarray(heights_above_base.min(axis=1) + poses[:, :3, 3] @ up)


def _chosen_feet(stance: str | Sequence[str], frames: Sequence[str], n: int) -> Array | None:
    """Number (n,) of the given stance foot of each row; None if ``stance`` is "auto"."""
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
    """Number of rows before another foot is chosen, and that foot; ``foot`` itself if there is none."""
    rows_of_others = np.flatnonzero(chosen != foot)
    if not len(rows_of_others):
        return len(chosen), foot
    row = int(rows_of_others[0])
    return row, int(chosen[row])


def _next_lowest(time: Array, heights: Array, foot: int) -> tuple[int, int]:
    """Number of rows before another foot stands, and that foot; ``foot`` itself if there is none."""
    lowest = heights.argmin(axis=1)
    is_lower = heights[np.arange(len(lowest)), lowest] < heights[:, foot] - _MIN_STANCE_DROP
    is_lower[0] = False  # ``foot`` stands at least in its first row
    search_start = 0
    while True:
        begins = np.flatnonzero(is_lower[search_start:])
        if not len(begins):
            return len(time), foot
        begin = search_start + int(begins[0])
        ends = np.flatnonzero(~is_lower[begin:])
        end = begin + int(ends[0]) if len(ends) else len(time)
        is_long_enough = time[end - 1] - time[begin] >= _MIN_STANCE_TIME
        lasts_to_end = end == len(time) and end - begin > 1
        if is_long_enough or lasts_to_end:
            successor = int(lowest[begin])
            equal = np.flatnonzero(heights[:begin, successor] > heights[:begin, foot] - _MAX_EQUAL_HEIGHT)
            row_count = 1
            if len(equal):
                row_count = int(equal[-1]) + 1
            return row_count, successor
        search_start = end


def level_pose(robot: Robot, points: Array, normal: Array) -> Array:
    """Pose (4, 4) of the base in which the plane of points (k, 3) is that of the ground through the origin."""
    return _pose_on_plane([points], upward(robot), normal)


def _pose_on_plane(corners: Sequence[Array], up: Array, ground_normal: Array) -> Array:
    """Pose of the base in which the feet's plane is that of the ground, through the origin.

    If not all feet stand on one plane, the plane of the lowest corners is used. If these do not determine a plane, the
    base's own axis ``up`` is along the ground's normal.
    """

    def is_plane_to_stand_on(normal: Array, width: float) -> bool:
        return bool(width > MIN_SOLE_WIDTH and normal @ up > _MIN_COSINE_OF_LEAN)

    points = np.concatenate(corners)
    normal, width, distance = _nearest_plane(points, up)
    if distance > _MAX_DISTANCE_FROM_PLANE or not is_plane_to_stand_on(normal, width):
        heights = points @ up
        points = points[heights <= heights.min() + _MAX_DISTANCE_FROM_PLANE]
        normal, width, _ = _nearest_plane(points, up)
        if not is_plane_to_stand_on(normal, width):
            normal = up
    R = _rotation_between(normal, ground_normal)
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = -(points @ R.T @ ground_normal).min() * ground_normal  # the lowest point is at height 0
    return T


def _nearest_plane(points: Array, up: Array) -> tuple[Array, float, float]:
    """Normal of the plane nearest to some points, their width across their longest direction in it, and the largest distance.

    A width of zero means that the points lie on one line.
    """
    if len(points) < 3:
        return up, 0.0, 0.0
    offsets = points - points.mean(axis=0)
    _, widths, axes = np.linalg.svd(offsets, full_matrices=False)
    normal = axes[2]
    if normal @ up < 0:
        normal = -normal
    return normal, float(widths[1]), float(np.abs(offsets @ normal).max())


def _rotation_between(start: Array, end: Array) -> Array:
    """Smallest rotation (3, 3) from one unit vector to another."""
    normal = np.cross(start, end)
    sine = float(np.linalg.norm(normal))
    if sine < 1e-15:
        return np.eye(3)
    angle = np.arctan2(sine, float(start @ end))
    return np.asarray(so3.exp(normal / sine * angle))


def pose_coordinates(poses: Array) -> Array:
    """Coordinates (n, 7) of a floating base: quaternion w, x, y, z without jumps of its sign, and position."""
    quaternions = np.asarray(quaternion.from_matrix(poses[:, :3, :3]))
    has_same_sign = np.sum(quaternions[1:] * quaternions[:-1], axis=1) >= 0
    signs = np.cumprod(np.r_[1.0, np.where(has_same_sign, 1.0, -1.0)])
    return np.column_stack([quaternions * signs[:, None], poses[:, :3, 3]])


complete(globals())
