"""Joint paths q(s): straight lines, splines, and pose paths by inverse kinematics. MR sections 9.2 and 9.3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import PathError, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import printed
from ..core.typing import Array
from ..motion.coordinates import configuration
from ..robot.base import require_robot
from ..robot.inverse_kinematics.solve import pose_finder, twist_left

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint path q(s) with dq/ds and d²q/ds², from :func:`joint_line`, :func:`spline` or :func:`follow_poses`."""

    name: str
    """Kind of the path, such as ``spline``."""
    coordinates: Callable[[Array], tuple[Array, Array, Array]]
    """Function that returns q, dq/ds and d²q/ds² at s (m,), (m, n) each."""
    knots: Array = field(default_factory=lambda: np.array([0.0, 1.0]))
    """Values of s at the ends of smooth pieces, including 0 and 1."""
    third: Callable[[Array], Array] | None = None
    """Function that returns d³q/ds³ at s (m,), (m, n); None if unknown, so that jerk limits cannot be kept."""
    deviation: float = 0.0
    """Largest deviation from a pose path between the points where it was solved [m or rad]."""

    def __call__(self, s: ArrayLike) -> tuple[Array, Array, Array]:
        """q (..., nq), dq/ds and d²q/ds² (..., nv) at s (...) from 0 to 1."""
        return self.coordinates(arguments.real(s, "s"))


def joint_line(robot: Robot, q0: ArrayLike, q1: ArrayLike) -> JointPath:
    """Straight line in joint space, q0 ⊕ s (q1 ⊖ q0); floating and planar joints follow a constant twist. MR section 9.2.

    Examples
    --------
    >>> import twistwrench as tw
    >>> path = joint_line(tw.robots.planar_2r(), [0, 0], [1, -2])
    >>> [x.tolist() for x in path(0.25)]
    [[0.25, -0.5], [1.0, -2.0], [0.0, 0.0]]
    """
    require_robot(robot, "joint_line")
    q0, q1 = configuration(robot, q0, "q0"), configuration(robot, q1, "q1")
    displacement = robot.subtract(q1, q0)
    if robot.nv == 0:
        raise ValueRangeError(f"robot {robot.name!r} has no joint that moves, so there is no motion to plan.")
    if not np.abs(displacement).max(initial=0.0) > 0:
        raise ValueRangeError("q0 and q1 are the same configuration, so there is no motion to plan.")

    def line(s: Array) -> tuple[Array, Array, Array]:
        start = np.broadcast_to(q0, (*s.shape, robot.nq))
        dq_ds = np.broadcast_to(displacement, (*s.shape, robot.nv))
        return robot.add(start, s[..., None] * dq_ds), dq_ds.copy(), np.zeros(dq_ds.shape)

    return JointPath("joint line", line, third=lambda s: np.zeros((*s.shape, robot.nv)))


def spline(
    robot: Robot,
    waypoints: ArrayLike,
    *,
    times: ArrayLike | None = None,
    velocities: ArrayLike | None = None,
    degree: int = 3,
) -> JointPath:
    """Spline path through waypoints (MR section 9.3, eq. 9.27); s is the fraction of its length, or of ``times``.

    Parameters
    ----------
    waypoints : (m, nq) array_like, m ≥ 2
    times : (m,) array_like, optional, rising [s]
        The path is at rest at both ends. With ``uniform(times[-1] - times[0])`` each waypoint is reached at its time.
    velocities : (m, nv) array_like, optional, at the waypoints, with times [rad/s, m/s]; accelerations then jump
    degree : 3 or 5

    Examples
    --------
    >>> import twistwrench as tw
    >>> path = spline(tw.robots.planar_2r(), [[0, 0], [1, 1], [2, 0]])
    >>> path(path.knots)[0].round(9).tolist()
    [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline, make_interp_spline

    require_robot(robot, "spline")
    points = configurations(robot, waypoints, "waypoints")
    if len(points) < 2:
        raise ShapeError(f"waypoints has shape {points.shape}: a path takes at least two.")
    one_degree_joints(robot, "a spline")
    with np.errstate(over="ignore"):  # infinite distances are rejected below
        distances = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (distances == 0).any() and times is None:
        k = int(np.flatnonzero(distances == 0)[0])  # first waypoint of the first such pair
        raise ValueRangeError(f"waypoints {k} and {k + 1} are the same place. Leave one of them out.")
    if arguments.number(degree, "degree") not in (3, 5):
        raise ValueRangeError(f"degree is {degree!r}: choose 3 or 5.")
    if degree == 5 and (len(points) < 6 or times is not None):
        raise ValueRangeError("a spline of degree 5 takes at least six waypoints, and no times. Choose degree=3.")
    if times is None:
        if velocities is not None:
            raise ValueRangeError("velocities are per second, so they need times.")
        with np.errstate(invalid="ignore"):
            knots = np.concatenate([[0.0], np.cumsum(distances)]) / distances.sum()
        knots[-1] = 1.0  # without rounding
        if not (np.diff(knots) > 0).all():  # also if a distance is infinite
            k = int(distances.argmin())
            distance, length = float(distances[k]), float(distances.sum())
            raise ValueRangeError(
                f"waypoints {k} and {k + 1} are {printed(distance)} apart on a path of length {printed(length)}, too close for "
                "its digits. Give waypoints within the robot's range, and leave one of the two out."
            )
        curve: Any = CubicSpline(knots, points) if degree == 3 else make_interp_spline(knots, points, k=5)
    else:
        instants = np.asarray(arguments.finite(times, "times"), float)
        if instants.shape != (len(points),):
            raise ShapeError(f"times has shape {instants.shape}: give {len(points)}, one for each waypoint [s].")
        does_not_rise = np.diff(instants) <= 0
        if does_not_rise.any():
            k = int(np.flatnonzero(does_not_rise)[0])  # the first one
            raise ValueRangeError(
                f"times has {printed(instants[k + 1])} after {printed(instants[k])}, at waypoint {k + 1}: give rising times "
                "[s], waypoints in that order."
            )
        T = instants[-1] - instants[0]  # duration [s]
        knots = (instants - instants[0]) / T
        knots[-1] = 1.0  # without rounding
        if velocities is None:
            curve = CubicSpline(knots, points, bc_type="clamped")
        else:
            rates = arguments.finite(velocities, "velocities", robot.nv, names=robot.model.velocity_names)
            rates = arguments.one(rates, "velocities", len(points), robot.nv)
            curve = CubicHermiteSpline(knots, points, rates * T)  # dq/ds = dq/dt T
    dq_ds, d2q_ds2 = curve.derivative(1), curve.derivative(2)
    return JointPath("spline", lambda s: (curve(s), dq_ds(s), d2q_ds2(s)), knots, third=curve.derivative(3))


def require_path(path: Any, what: str) -> JointPath:
    """Return ``path``. Raises ValueRangeError unless it is a joint path; the message begins with ``what``."""
    if not isinstance(path, JointPath):
        raise ValueRangeError(
            f"{what}: the path is {arguments.value_text(path)}: give a path of the joints, as "
            "tw.trajectories.joint_line(robot, q0, q1), spline(robot, waypoints) and follow_poses make one."
        )
    return path


def one_degree_joints(robot: Robot, what: str) -> None:
    """Raise ValueRangeError if a joint has several degrees of freedom, or if the robot has no moving joints."""
    if not robot.nv:
        raise ValueRangeError(f"{what} needs a robot with moving joints, but {robot.name!r} has none.")
    multi_dof_joints = [body.joint.name for body in robot.model.leaders if body.joint.nv != 1]
    if multi_dof_joints:
        raise ValueRangeError(
            f"{what} adds coordinates, and those of {', '.join(multi_dof_joints)} cannot be added. Take joint_line, waypoint "
            "by waypoint, or lock the joint."
        )


def configurations(robot: Robot, q: ArrayLike, name: str) -> Array:
    """Configurations q (m, nq) as floats. Raises an error that names them ``name`` for other shapes and infinite numbers."""
    array = np.asarray(arguments.finite(q, name, robot.nq, names=robot.coordinate_names), float)
    if array.ndim != 2:
        raise ShapeError(f"{name} has shape {array.shape[1:] or array.shape}, expected ({robot.nq},) each.")
    return array


# ── Joint paths from pose paths, by inverse kinematics on one branch

_FIRST_INTERVALS = 64
"""Number of intervals between solved points in the first attempt."""
_MAX_INTERVALS = 4096
"""Largest number of intervals between solved points."""
_MAX_INTERVALS_AFTER_FAILURE = 1024
"""Number of intervals from which a path that ends early is not refined."""
_MAX_START_ERROR = 1e-6
"""Largest pose error of q0 at the beginning of the path [m, rad]."""
_MIN_PARTIAL_POINTS = 8
"""Smallest number of solved points for a partial path, whose spline has degree 5."""
_MAX_POSE_ERROR = 1e-11
"""Largest entry of the pose error at a solved point [m, rad]."""
_MAX_ERROR_OF_ROUNDING = 1e3 * _MAX_POSE_ERROR
"""Largest entry of the pose error of a solution that rounding alone kept from converging [m, rad]."""
_MIN_TOLERANCE = 1e-10
"""Smallest tolerance of the deviation from the path [m, rad]."""
_ALL_ROWS = tuple(range(6))
"""Rows of a pose error: rotation and position."""
_MAX_NEWTON_STEPS = 12
"""Newton steps of the fallback, used to find the reason if compiled inverse kinematics finds no near solution."""
_MAX_JUMP = 0.5
"""Largest joint displacement between adjacent points [rad or m]."""
_MIN_SINGULAR_VALUE_RATIO = 0.02
"""Ratio of the smallest to the largest singular value of J below which the arm is at a singular configuration."""
_MIN_SINGULAR_SHARE = 1e-9
"""Share of the largest singular value of J up to which a singular value counts as zero."""


def follow_poses(
    robot: Robot, poses: Callable[[Array], Array], q0: ArrayLike, frame: str | None = None, *, tolerance: float = 1e-8
) -> JointPath:
    """Joint path of a Cartesian path: moves a frame along T(s), from ``q0`` with the pose T(0), on the branch of q0.

    Parameters
    ----------
    poses : function, maps s (m,) from 0 to 1 to (m, 4, 4), as :func:`screw_path` and :func:`straight_path` do
    tolerance : float, largest pose error between points [m, rad]

    Raises
    ------
    PathError
        The robot cannot continue at some s (singular, a limit, out of reach, a jump); the message gives s and the
        reason. The path up to that point is kept as ``partial``.

    Notes
    -----
    Each point starts from the previous one, with least motion if joints are redundant. Points are joined by a spline.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> from twistwrench import trajectories
    >>> arm = tw.robots.ur5()
    >>> q0 = np.array([0, -1.2, 1.5, -0.3, 1.5, 0])
    >>> T = arm.forward_kinematics(q0)
    >>> there = T.copy()
    >>> there[2, 3] -= 0.2
    >>> path = trajectories.follow_poses(arm, trajectories.straight_path(T, there), q0)
    >>> half = arm.forward_kinematics(path(0.5)[0])
    >>> bool(abs(half[:3, 3] - (T[:3, 3] + there[:3, 3]) / 2).max() < 1e-6)
    True
    """
    one_degree_joints(require_robot(robot, "follow_poses"), "following poses")
    q0 = configuration(robot, q0, "q0")
    max_deviation = arguments.number(tolerance, "tolerance")
    if not _MIN_TOLERANCE <= max_deviation < np.inf:
        raise ValueRangeError(
            f"tolerance is {printed(max_deviation)}: give how far the frame may be off [m, rad], {_MIN_TOLERANCE} or more."
        )
    poses_at = _checked_poses_function(poses)
    start_pose = robot.forward_kinematics(q0, frame)[None]
    (start_error,) = twist_left(start_pose, poses_at(np.zeros(1)), _ALL_ROWS)  # (6,)
    if np.abs(start_error).max() > _MAX_START_ERROR:
        distance = np.linalg.norm(start_error[3:])
        angle = np.linalg.norm(start_error[:3])
        raise ValueRangeError(
            f"at q0 the frame is {printed(distance, 3)} m and {printed(angle, 3)} rad "
            "from where the path begins. Take robot.inverse_kinematics(T).q of its first pose, or begin it at "
            "robot.forward_kinematics(q0)."
        )
    interval_count = _FIRST_INTERVALS
    while True:
        s = np.linspace(0.0, 1.0, interval_count + 1)
        q, failure = _solve_poses(robot, poses_at(s), q0, frame)
        is_complete = len(q) == len(s)
        may_be_refined = interval_count < _MAX_INTERVALS_AFTER_FAILURE
        if not is_complete and may_be_refined and "limit" not in failure:
            interval_count *= 4  # a smaller spacing may succeed, except at a limit of a joint
            continue
        s = s[: len(q)]  # of the solved points
        if not is_complete and len(q) < _MIN_PARTIAL_POINTS:
            raise PathError(f"the path of poses ends at s = {printed(s[-1], 4)}: {failure}.", reached=float(s[-1]))
        path = _spline(s / s[-1], q, 0.0)
        s_at_middles = 0.5 * (s[1:] + s[:-1])  # of the intervals
        q_at_middles, _, _ = path(s_at_middles / s[-1])
        errors = twist_left(robot.forward_kinematics(q_at_middles, frame), poses_at(s_at_middles), _ALL_ROWS)
        distances = np.linalg.norm(errors[:, 3:], axis=1)
        angles = np.linalg.norm(errors[:, :3], axis=1)
        deviation = float(max(distances.max(), angles.max()))
        if not is_complete and (deviation <= max_deviation or not may_be_refined):
            raise PathError(
                f"the path of poses ends at s = {printed(s[-1], 4)}: {failure}.",
                reached=float(s[-1]),
                partial=_spline(s / s[-1], q, deviation),
            )
        if deviation <= max_deviation:
            return _spline(s, q, deviation)
        interval_count *= 2
        if interval_count > _MAX_INTERVALS:
            k = int(np.linalg.norm(errors, axis=1).argmax())
            s_at_worst = float(s_at_middles[k])
            raise PathError(
                f"between {interval_count // 2} places the frame is still {printed(deviation, 3)} off at s = "
                f"{printed(s_at_worst, 4)}: the path bends there, or the arm is near a singular configuration. Round "
                "the path off, or allow more with tolerance=.",
                reached=s_at_worst,
                partial=_spline(s, q, deviation),
            )


def _checked_poses_function(poses: Any) -> Callable[[Array], Array]:
    """The function, with a check that it returns poses (m, 4, 4). Raises ValueRangeError for another object."""
    name_in_messages = "the function of poses"
    if not callable(poses):
        raise ValueRangeError(
            f"poses is {type(poses).__name__}: give a function of s (m,) to (m, 4, 4), as straight_path does."
        )

    def checked_poses(s: Array) -> Array:
        try:
            returned = poses(s)
        except Exception as problem:
            raise ValueRangeError(
                f"{name_in_messages} failed with {type(problem).__name__}: {problem}. It is called with s (m,)."
            ) from problem
        T = arguments.finite(returned, name_in_messages, 4, 4)
        if T.shape != (len(s), 4, 4):
            raise ShapeError(
                f"{name_in_messages} gave shape {T.shape} for s of shape {s.shape}, expected {(len(s), 4, 4)}."
            )
        return np.asarray(arguments.pose(T, name_in_messages), float)

    return checked_poses


def _spline(s: Array, q: Array, deviation: float) -> JointPath:
    """Path of degree 5 through q (m, n) at s (m,), which has this deviation from the path of poses."""
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline(s, q, k=5)
    dq_ds = curve.derivative(1)
    d2q_ds2 = curve.derivative(2)
    return JointPath(
        "path of poses", lambda s: (curve(s), dq_ds(s), d2q_ds2(s)), third=curve.derivative(3), deviation=deviation
    )


def _solve_poses(robot: Robot, targets: Array, q0: Array, frame: str | None) -> tuple[Array, str]:
    """Configurations q at the targets (m, 4, 4) up to the first failure, and its reason; an empty text if all are solved."""
    solutions = [q0]
    limits = robot.limits
    is_beyond = limits.exceeded(q0)
    if is_beyond.any():
        k = int(np.flatnonzero(is_beyond)[0])
        lower, upper = printed(limits.lower[k], 4), printed(limits.upper[k], 4)
        reason = f"it begins with {robot.joint_names[k]} at {printed(q0[k], 4)}, outside its limits {lower} to {upper}"
        return np.array(solutions), reason
    solve_near = pose_finder(robot, frame, _MAX_POSE_ERROR)
    for target in targets[1:]:
        last_q = solutions[-1]
        guess = last_q.copy()
        if robot.nv <= 6 and len(solutions) > 1:
            guess = 2.0 * last_q - solutions[-2]  # extrapolated; redundant joints would drift
        solution = solve_near(target, guess)
        if solution is None or np.abs(solution - last_q).max() > _MAX_JUMP:
            solution, reason = _newton(robot, target, guess, last_q, frame)
            if reason:
                return np.array(solutions), reason
        solutions.append(solution)
    return np.array(solutions), ""


def _newton(robot: Robot, target: Array, q: Array, last_q: Array, frame: str | None) -> tuple[Array, str]:
    """Configuration near q with the target pose, and the reason why the path cannot go there from ``last_q``.

    The reason is an empty text if the path can.
    """
    names, limits = robot.joint_names, robot.limits
    for _ in range(_MAX_NEWTON_STEPS):
        (e,) = twist_left(robot.forward_kinematics(q, frame)[None], target[None], _ALL_ROWS)  # pose error (6,)
        if np.abs(e).max() <= _MAX_POSE_ERROR:
            break
        q = q + np.linalg.pinv(robot.jacobian(q, frame), rcond=_MIN_SINGULAR_SHARE) @ e
    else:  # not converged; close enough if rounding alone stopped it
        if np.abs(e).max() > _MAX_ERROR_OF_ROUNDING:
            return q, _reason_without_solution(robot.jacobian(last_q, frame))
    is_beyond = limits.exceeded(q)
    displacement = np.abs(q - last_q)
    if is_beyond.any():
        k = int(np.flatnonzero(is_beyond)[0])
        limit = limits.lower[k] if q[k] < limits.lower[k] else limits.upper[k]
        return q, f"{names[k]} reaches its limit {printed(limit, 4)}"
    if displacement.max() > _MAX_JUMP:
        k = int(displacement.argmax())
        return q, f"{names[k]} would jump by {printed(displacement[k], 3)}: the arm passes a singular configuration"
    return q, ""


def _reason_without_solution(J: Array) -> str:
    """Reason why no configuration has the next pose, from the Jacobian at the last configuration."""
    singular_values = np.linalg.svd(J, compute_uv=False)
    smallest = 0.0  # with fewer than six joints, J is always singular
    if len(singular_values) >= 6:
        smallest = float(singular_values[5])
    if smallest >= _MIN_SINGULAR_VALUE_RATIO * float(singular_values[0]):
        return "the next pose is out of reach on this branch"
    return (
        "the arm is at a singular configuration there, stretched out or folded, and finds no way on (smallest "
        f"singular value of J {printed(smallest, 2)})"
    )


complete(globals())
