"""Paths of the joints, q(s) for s from 0 to 1: straight lines, splines through waypoints. Modern Robotics sections 9.2, 9.3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..robot.robot_argument import require_robot
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint path q(s) with dq/ds and d²q/ds²; made by :func:`joint_line`, :func:`spline`, :func:`follow_poses`."""

    name: str
    """In words."""
    coordinates: Callable[[Array], tuple[Array, Array, Array]]
    """Gives q, dq/ds and d²q/ds² at s (m,), (m, n) each."""
    knots: Array = field(default_factory=lambda: np.array([0.0, 1.0]))
    """Where pieces meet, 0 and 1 among them."""
    deviation: float = 0.0
    """How far a path of poses is missed between the places where it was solved [m or rad]."""

    def __call__(self, s: ArrayLike) -> tuple[Array, Array, Array]:
        """q (..., nq), dq/ds and d²q/ds² (..., nv) at s (...) from 0 to 1."""
        return self.coordinates(arguments.real(s, "s"))


def joint_line(robot: Robot, q0: ArrayLike, q1: ArrayLike) -> JointPath:
    """Straight line in joint space, q0 ⊕ s (q1 ⊖ q0); floating and planar joints follow a constant twist.

    Parameters
    ----------
    robot : Robot
    q0, q1 : (nq,) array_like, configurations at the ends

    Returns
    -------
    path : JointPath

    Raises
    ------
    ShapeError, ValueRangeError
        An end is of another size or not finite, or the ends are the same.

    Notes
    -----
    MR section 9.2.

    Examples
    --------
    >>> import twistwrench as tw
    >>> path = joint_line(tw.robots.planar_2r(), [0, 0], [1, -2])
    >>> [x.tolist() for x in path(0.25)]
    [[0.25, -0.5], [1.0, -2.0], [0.0, 0.0]]
    """
    require_robot(robot, "joint_line")
    q0, q1 = (
        np.array(arguments.one(arguments.finite(q, n, robot.nq, names=robot.coordinate_names), n, robot.nq))
        for n, q in (("q0", q0), ("q1", q1))
    )
    way = robot.subtract(q1, q0)
    if not np.abs(way).max(initial=0.0) > 0:
        raise ValueRangeError("q0 and q1 are the same place, so no path leads from one to the other.")

    def line(s: Array) -> tuple[Array, Array, Array]:
        flat = np.broadcast_to(way, (*s.shape, robot.nv))
        return (
            robot.add(np.broadcast_to(q0, (*s.shape, robot.nq)), s[..., None] * flat),
            flat.copy(),
            np.zeros(flat.shape),
        )

    return JointPath("joint line", line)


def spline(
    robot: Robot,
    waypoints: ArrayLike,
    *,
    times: ArrayLike | None = None,
    velocities: ArrayLike | None = None,
    degree: int = 3,
) -> JointPath:
    """Spline path through waypoints; s is the share of its length, or of ``times``.

    Parameters
    ----------
    robot : Robot
    waypoints : (m, nq) array_like, m ≥ 2
    times : (m,) array_like, optional, rising [s]
        The path is at rest at both ends, and under ``uniform(times[-1] - times[0])`` each waypoint is met at its time.
    velocities : (m, nv) array_like, optional, at the waypoints, with times [rad/s, m/s]; accelerations then jump
    degree : 3 or 5

    Returns
    -------
    path : JointPath

    Raises
    ------
    ShapeError, ValueRangeError
        An argument is invalid, or the robot has planar or floating joints, which have lines only.

    Notes
    -----
    MR section 9.3, eq. 9.27.

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
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (steps == 0).any() and times is None:
        k = int((steps == 0).argmax())
        raise ValueRangeError(f"waypoints {k} and {k + 1} are the same place. Leave one of them out.")
    if arguments.number(degree, "degree") not in (3, 5):
        raise ValueRangeError(f"degree is {degree!r}: choose 3 or 5.")
    if degree == 5 and (len(points) < 6 or times is not None):
        raise ValueRangeError("a spline of degree 5 takes at least six waypoints, and no times. Choose degree=3.")
    if times is None:
        if velocities is not None:
            raise ValueRangeError("velocities are per second, so they need times.")
        knots = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
        knots[-1] = 1.0
        curve: Any = CubicSpline(knots, points) if degree == 3 else make_interp_spline(knots, points, k=5)
    else:
        at = np.asarray(arguments.finite(times, "times"), float)
        if at.shape != (len(points),):
            raise ShapeError(f"times has shape {at.shape}: give {len(points)}, one for each waypoint [s].")
        if (late := np.diff(at) <= 0).any():
            k = int(late.argmax())
            raise ValueRangeError(
                f"times has {printed(at[k + 1])} after {printed(at[k])}, at waypoint {k + 1}: give rising times [s], "
                "waypoints in that order."
            )
        T = at[-1] - at[0]
        knots = (at - at[0]) / T
        knots[-1] = 1.0
        if velocities is None:
            curve = CubicSpline(knots, points, bc_type="clamped")
        else:
            rates = arguments.finite(velocities, "velocities", robot.nv, names=robot.model.velocity_names)
            rates = arguments.one(rates, "velocities", len(points), robot.nv)
            curve = CubicHermiteSpline(knots, points, rates * T)
    first, second = curve.derivative(1), curve.derivative(2)
    return JointPath("spline", lambda s: (curve(s), first(s), second(s)), knots)


def require_path(path: Any, what: str) -> JointPath:
    """``path``, which must be one of the joints. Raises ValueRangeError."""
    if not isinstance(path, JointPath):
        raise ValueRangeError(
            f"{what}: the path is {arguments.shown(path)}: give a path of the joints, as tw.trajectories.joint_line(robot, q0, "
            "q1), spline(robot, waypoints) and follow_poses make one."
        )
    return path


def one_degree_joints(robot: Robot, what: str) -> None:
    """Raise ValueRangeError for a robot with joints of several degrees of freedom, naming them, and for one without joints."""
    if not robot.nv:
        raise ValueRangeError(f"{what} has no answer: robot {robot.name!r} has no joint that moves.")
    others = [b.joint.name for b in robot.model.leaders if b.joint.nv != 1]
    if others:
        raise ValueRangeError(
            f"{what} adds coordinates, and those of {', '.join(others)} are no numbers to add. Take joint_line, waypoint by "
            "waypoint, or lock the joint."
        )


def configurations(robot: Robot, q: ArrayLike, name: str) -> Array:
    """q (m, nq), finite."""
    array = np.asarray(arguments.finite(q, name, robot.nq, names=robot.coordinate_names), float)
    if array.ndim != 2:
        raise ShapeError(f"{name} has shape {array.shape[1:] or array.shape}, expected ({robot.nq},) each.")
    return array
