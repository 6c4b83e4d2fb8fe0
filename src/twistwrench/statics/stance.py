"""Motion of the base of a legged robot that stands, from its joints and the feet that do not move."""

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

_MAX_LISTED_NAMES = 8
"""Largest number of coordinates that a message names."""
_MIN_STANCE_DROP = 0.005
"""Height [m] by which a foot is lower than the stance foot before it becomes the stance foot itself."""
_MIN_STANCE_TIME = 0.02
"""Time [s] for which the new stance foot must be lower."""
_MAX_EQUAL_HEIGHT = 0.0005
"""Difference in height [m] up to which both feet stand. The new stance foot takes over in the row after the last such."""
_MAX_DISTANCE_FROM_PLANE = 0.01
"""Largest distance of points from a plane at which they still stand on it [m]."""
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
    has_free_base = floating_entries(robot)[:6].all()  # the velocities of the base come first
    has_same_joints = robot.coordinate_names[7:] == names  # without quaternion and position of the base
    if not (has_free_base and has_same_joints):
        raise ShapeError(
            f"base_from_stance takes robot {robot.name!r} with a floating base, and a motion of its joints alone; the motion "
            f"has the coordinates {', '.join(names[:_MAX_LISTED_NAMES])}. Load the robot with floating_base=True."
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
    has_known_sole = any(len(points) > 1 for points in soles.values())
    if has_known_sole or len(soles) >= _MIN_POINT_FEET:
        return dict(soles)
    return {frame: points + _CORNERS_OF_UNKNOWN_SOLE for frame, points in soles.items()}


_MIN_POINT_FEET = 3
"""Smallest number of feet, as points, that determine the pose of the base together."""
_CORNERS_OF_UNKNOWN_SOLE = 0.005 * np.array([(1.0, 1, 0), (1, -1, 0), (-1, 0, 0)])
"""Corners (3, 3) about the origin of a foot without a known sole [m]."""


def stance_rates(
    robot: Robot, q: Array, dq: Array, ddq: Array, soles: Mapping[str, Array], standing: Array
) -> tuple[Array, Array]:
    """Velocities and accelerations (n, nv) of base and joints, from velocities and accelerations (n, nv - 6) of the joints.

    ``standing`` (n, k) is true for the feet whose points do not move: J_b V_b + J_q dq = 0 gives the base's twist V_b. The
    accelerations of these points at dV_b = 0 give dV_b.
    """
    no_motion = np.zeros((len(q), 6))  # of the base, replaced below
    velocities = np.column_stack([no_motion, dq])
    accelerations = np.column_stack([no_motion, ddq])
    if not soles:
        return velocities, accelerations
    for standing_feet in np.unique(standing, axis=0):
        rows = np.flatnonzero((standing == standing_feet).all(axis=1))
        contacts: list[Contact] = []
        for frame in compress(soles, standing_feet):
            contacts += [Contact(point, frame=frame) for point in soles[frame]]
        maps, _ = contact_maps(robot, q[rows], contacts)
        J = np.moveaxis(maps, 1, -1).reshape(len(rows), -1, robot.nv)  # of all points
        inverse_J_b = np.linalg.pinv(J[:, :, :6])
        velocities_by_joints = _apply(J[:, :, 6:], velocities[rows, 6:])
        velocities[rows, :6] = -_apply(inverse_J_b, velocities_by_joints)
        accelerations_without_base = []
        for contact in contacts:
            a = _point_acceleration(robot, q[rows], velocities[rows], accelerations[rows], contact)
            accelerations_without_base.append(a)
        accelerations_by_joints = np.concatenate(accelerations_without_base, axis=1)
        accelerations[rows, :6] = -_apply(inverse_J_b, accelerations_by_joints)
    return velocities, accelerations


def _point_acceleration(robot: Robot, q: Array, dq: Array, ddq: Array, contact: Contact) -> Array:
    """Accelerations (n, 3) of a contact point in the base frame."""
    V = np.asarray(robot.frame_velocity(q, dq, contact.frame))
    A = np.asarray(robot.frame_acceleration(q, dq, ddq, contact.frame))
    w, v = V[:, :3], V[:, 3:]
    dw, dv = A[:, :3], A[:, 3:]
    a = dv + np.cross(w, v) + np.cross(dw, contact.point) + np.cross(w, np.cross(w, contact.point))
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
    """Poses (n, 4, 4) of the base of a robot that stands, and (n, k) True for feet whose points do not move.

    ``robot`` has a fixed base; ``soles`` are the corners of each foot in its frame. A flat foot stands alone; feet that are
    points stand together, at least three of them. ``normal`` (3,) is the ground's; None: the world's vertical axis.
    """
    up = upward(robot)
    frames = list(soles)
    ground_normal = up if normal is None else normal
    corners = []  # of each foot, (n, c, 3) in the frame of the base
    for frame, points in soles.items():
        T = np.asarray(robot.forward_kinematics(q, frame)).reshape(-1, 4, 4)
        corners.append(points @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])
    first_corners = [foot_corners[0] for foot_corners in corners]  # in the first row
    start = _pose_on_plane(first_corners, up, ground_normal)
    stance_feet = _chosen_feet(stance, frames, len(q))
    widths = []
    for points in first_corners:
        _, width, _ = _nearest_plane(points, up)
        widths.append(width)
    if stance_feet is None and max(widths) <= MIN_SOLE_WIDTH:
        return _PointFeet(time, corners, ground_normal, frames).poses(start)
    return _flat_foot(time, corners, ground_normal, start, stance_feet)


def _flat_foot(
    time: Array, corners: Sequence[Array], up: Array, start: Array, stance_feet: Array | None
) -> tuple[Array, Array]:
    """Poses (n, 4, 4) of the base while one foot after the other stands, and (n, k) True for the foot that stands.

    ``stance_feet`` (n,) is the index of the stance foot in each row; None: the lowest foot stands.
    """
    n = len(time)
    T_sb = np.tile(start, (n, 1, 1))
    standing = np.zeros((n, len(corners)), bool)
    if stance_feet is None:
        foot = int(_sole_heights(corners, T_sb, up)[0].argmin())
    else:
        foot = int(stance_feet[0])
    row = 0  # first row in which ``foot`` stands
    while row < n:
        targets = corners[foot][row] @ T_sb[row, :3, :3].T + T_sb[row, :3, 3]
        T_sb[row:] = _fit_poses(corners[foot][row:], targets)
        if stance_feet is None:
            heights = _sole_heights([foot_corners[row:] for foot_corners in corners], T_sb[row:], up)
            row_count, next_foot = _next_lowest(time[row:], heights, foot)
        else:
            row_count, next_foot = _next_chosen(stance_feet[row:], foot)
        standing[row : row + row_count, foot] = True
        row += row_count
        foot = next_foot
    return T_sb, standing


class _PointFeet:
    """Base on feet that are points: feet on the ground do not move, at least three at a time."""

    def __init__(self, time: Array, corners: Sequence[Array], up: Array, frames: Sequence[str]) -> None:
        self.time = time
        self.corners = corners
        self.up = up
        self.frames = frames

    def poses(self, start: Array) -> tuple[Array, Array]:
        """Poses (n, 4, 4) of the base, and (n, k) True for feet that stand."""
        n, foot_count = len(self.time), len(self.corners)
        T_sb = np.tile(start, (n, 1, 1))
        standing = np.zeros((n, foot_count), bool)
        start_heights = _sole_heights(self.corners, T_sb[:1], self.up)[0]
        stands = start_heights <= start_heights.min() + _MAX_DISTANCE_FROM_PLANE  # (k,) from ``row`` on
        was_lifted = np.zeros(foot_count, bool)  # since the foot stood: only then it may stand again
        row = 0
        while row < n:
            self._require_area(stands, row)
            targets = [points[row] @ T_sb[row, :3, :3].T + T_sb[row, :3, 3] for points in self.corners]
            standing_feet = np.flatnonzero(stands).tolist()
            points = np.concatenate([self.corners[foot][row:] for foot in standing_feet], axis=1)
            T_sb[row:] = _fit_poses(points, np.concatenate([targets[foot] for foot in standing_feet]))
            displacements = np.stack(
                [self._displacement(foot, row, T_sb, targets[foot]) for foot in range(foot_count)], axis=1
            )
            heights = _sole_heights([points[row:] for points in self.corners], T_sb[row:], self.up)
            floor = heights[:, stands].min(axis=1, keepdims=True)
            leaves = (displacements > _MIN_STANCE_DROP) & stands
            is_lifted = np.maximum.accumulate(heights > floor + 2 * _MIN_STANCE_DROP, axis=0) | was_lifted
            lands = is_lifted & (heights <= floor + _MIN_STANCE_DROP) & ~stands
            event_rows = np.flatnonzero((leaves | lands)[1:].any(axis=1)) + 1
            if not len(event_rows):
                standing[row:] = stands
                break
            row_count = int(event_rows[0])
            standing[row : row + row_count] = stands
            was_lifted = is_lifted[row_count] & ~lands[row_count]
            next_stands = stands | lands[row_count]
            if leaves[row_count].any():  # only the foot that slides most leaves; the others may then fit again
                leaving_foot = int(np.where(stands, displacements[row_count], -1.0).argmax())
                next_stands[leaving_foot] = False
                was_lifted[leaving_foot] = False
            stands = next_stands
            row += row_count
        return T_sb, standing

    def _displacement(self, foot: int, row: int, poses: Array, targets: Array) -> Array:
        """Largest distance (m,) of a foot's corners from their targets, in each of the m rows from ``row`` on."""
        R, p = poses[row:, :3, :3], poses[row:, None, :3, 3]
        points = np.einsum("nij,nkj->nki", R, self.corners[foot][row:]) + p
        return np.asarray(np.linalg.norm(points - targets, axis=-1).max(axis=1))

    def _require_area(self, stands: Array, row: int) -> None:
        """Raise ValueRangeError if the points of the feet that stand lie on one line."""
        standing_feet = np.flatnonzero(stands).tolist()
        points = np.concatenate([self.corners[foot][row] for foot in standing_feet])
        _, width, _ = _nearest_plane(points, self.up)
        if width <= MIN_SOLE_WIDTH:
            names = listed([self.frames[foot] for foot in standing_feet])
            raise ValueRangeError(
                f"at t = {seconds(float(self.time[row]))} s the robot stands on {names} alone, which are points: the pose "
                "of its base is not known from the joints. Give a log with the pose of the base, and load the robot with a "
                "floating base; or give the sizes of the soles."
            )


def _fit_poses(points: Array, targets: Array) -> Array:
    """Poses (n, 4, 4) that bring points (n, k, 3) nearest to targets (k, 3). Source: Kabsch, Acta Cryst. A32, 1976."""
    point_means = points.mean(axis=1)
    target_mean = targets.mean(axis=0)
    H = np.einsum("ki,nkj->nij", targets - target_mean, points - point_means[:, None])
    U, _, Vt = np.linalg.svd(H)
    S = np.tile(np.eye(3), (len(points), 1, 1))
    S[:, 2, 2] = np.sign(np.linalg.det(U @ Vt))  # a rotation, not a reflection
    R = U @ S @ Vt
    T = np.tile(np.eye(4), (len(points), 1, 1))
    T[:, :3, :3] = R
    T[:, :3, 3] = target_mean - _apply(R, point_means)
    return T


def _sole_heights(corners: Sequence[Array], poses: Array, up: Array) -> Array:
    """Heights (n, k) of the lowest corner of each foot, from the corners (n, c, 3) of each foot."""
    return np.stack([_least_heights(foot_corners, poses, up) for foot_corners in corners], axis=1)


def _least_heights(corners: Array, poses: Array, up: Array) -> Array:
    """Heights (n,) of the lowest of corners (n, c, 3), which are in the frame of a base at ``poses`` (n, 4, 4)."""
    heights_above_base = np.einsum("nij,nkj->nki", poses[:, :3, :3], corners) @ up
    return np.asarray(heights_above_base.min(axis=1) + poses[:, :3, 3] @ up)


def _chosen_feet(stance: str | Sequence[str], frames: Sequence[str], n: int) -> Array | None:
    """Index (n,) of the given stance foot of each row; None if ``stance`` is "auto"."""
    if isinstance(stance, str) and stance == "auto":
        return None
    names = [stance] * n if isinstance(stance, str) else list(stance)
    if len(names) != n:
        raise ShapeError(f"stance has {len(names)} frames for {n} rows. Give one frame, one for each row, or 'auto'.")
    for name in names:
        if name not in frames:
            raise UnknownNameError.from_choices("stance foot", name, frames)
    return np.array([frames.index(name) for name in names])


def _next_chosen(stance_feet: Array, foot: int) -> tuple[int, int]:
    """Number of rows before another foot is chosen, and that foot; all rows and ``foot`` itself if there is none."""
    rows_of_others = np.flatnonzero(stance_feet != foot)
    if not len(rows_of_others):
        return len(stance_feet), foot
    row = int(rows_of_others[0])
    return row, int(stance_feet[row])


def _next_lowest(time: Array, heights: Array, foot: int) -> tuple[int, int]:
    """Number of rows before another foot stands, and that foot; all rows and ``foot`` itself if there is none."""
    lowest_feet = heights.argmin(axis=1)
    least_heights = heights[np.arange(len(lowest_feet)), lowest_feet]
    other_is_lower = least_heights < heights[:, foot] - _MIN_STANCE_DROP
    other_is_lower[0] = False  # ``foot`` stands at least in its first row
    search_start = 0
    while True:  # for each span of rows in which another foot is lower
        lower_rows = np.flatnonzero(other_is_lower[search_start:])
        if not len(lower_rows):
            return len(time), foot
        begin = search_start + int(lower_rows[0])
        rows_after = np.flatnonzero(~other_is_lower[begin:])
        end = begin + int(rows_after[0]) if len(rows_after) else len(time)
        is_long_enough = time[end - 1] - time[begin] >= _MIN_STANCE_TIME
        lasts_to_end = end == len(time) and end - begin > 1
        if is_long_enough or lasts_to_end:
            next_foot = int(lowest_feet[begin])
            is_as_low = heights[:begin, next_foot] > heights[:begin, foot] - _MAX_EQUAL_HEIGHT  # both stand
            rows_of_both = np.flatnonzero(is_as_low)
            row_count = 1
            if len(rows_of_both):
                row_count = int(rows_of_both[-1]) + 1
            return row_count, next_foot
        search_start = end


def level_pose(robot: Robot, points: Array, normal: Array) -> Array:
    """Pose (4, 4) of the base that brings the plane of points (k, 3) onto the ground, which goes through the origin."""
    return _pose_on_plane([points], upward(robot), normal)


def _pose_on_plane(corners: Sequence[Array], up: Array, ground_normal: Array) -> Array:
    """Pose (4, 4) of the base that brings the feet's plane onto the ground, which goes through the origin.

    If not all feet stand on one plane, the plane of the lowest corners is used. If these do not determine a plane, the
    base's own axis ``up`` is along the ground's normal.
    """

    def is_plane_to_stand_on(normal: Array, width: float) -> bool:
        """True if points determine a plane, by their width, and the base does not lean too far on it."""
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
    """Normal of the plane nearest to some points, width of the points in it, and largest distance of a point from it.

    The width is measured across the longest direction; it is zero if the points lie on one line.
    """
    if len(points) < 3:  # no plane
        return up, 0.0, 0.0
    offsets = points - points.mean(axis=0)
    _, widths, axes = np.linalg.svd(offsets, full_matrices=False)  # the longest direction first
    _, width, _ = widths.tolist()
    _, _, normal = axes
    if normal @ up < 0:
        normal = -normal
    largest_distance = float(np.abs(offsets @ normal).max())
    return normal, width, largest_distance


def _rotation_between(start: Array, end: Array) -> Array:
    """Smallest rotation (3, 3) from one unit vector to another."""
    normal = np.cross(start, end)
    sine = float(np.linalg.norm(normal))
    if sine < 1e-15:  # the vectors are equal but for rounding
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
