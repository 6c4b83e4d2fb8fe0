"""Paths of poses turned into paths of the joints: inverse kinematics from place to place, on one branch."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import PathError, ShapeError, ValueRangeError
from ..robot.inverse_kinematics import pose_finder, twist_left
from ..robot.robot_argument import require_robot
from ..typing import Array
from .paths import JointPath, one_degree_joints

if TYPE_CHECKING:
    from ..robot import Robot

_FIRST, _MOST = 64, 4096
_ARRIVED = 1e-11
_NEWTON = 12
"""Steps of our own, where those compiled for inverse kinematics find nothing near by; they say why."""
_JUMP = 0.5
"""rad or m: what a joint may move from one place to the next when the places are as close as they get."""


def follow_poses(
    robot: Robot,
    poses: Callable[[Array], Array],
    q0: ArrayLike,
    frame: str | None = None,
    *,
    tolerance: float = 1e-8,
) -> JointPath:
    """Joint path of a Cartesian path: moves a frame along T(s), from ``q0`` where it has the pose T(0), on q0's branch.

    Parameters
    ----------
    robot : Robot
    poses : function, maps s (m,) from 0 to 1 to (m, 4, 4), as :func:`screw_path` and :func:`straight_path` do
    q0 : (nq,) array_like, configuration at the start
    frame : str, optional, a link of the robot; its tip if None
    tolerance : float, how far the frame may be off between places [m, rad]

    Returns
    -------
    path : JointPath

    Raises
    ------
    PathError
        The robot cannot go on at some s (singular, a limit, out of reach, a jump), which is said with why.
        The path until there is kept as ``partial``.
    ShapeError, ValueRangeError, UnknownNameError, FrameError
        An argument is invalid, or the robot has no such frame.

    Notes
    -----
    Each place starts from the one before, by least motion where joints are redundant; between places a spline.

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
    q0 = arguments.finite(q0, "q0", robot.nq, names=robot.coordinate_names)
    q0 = np.array(arguments.one(q0, "q0", robot.nq))
    allowed = arguments.number(tolerance, "tolerance")
    if not 1e-10 <= allowed < np.inf:
        raise ValueRangeError(
            f"tolerance is {printed(allowed)}: give how far the frame may be off [m, rad], 1e-10 or more."
        )
    along = _door(poses)
    first = along(np.zeros(1))
    gap = twist_left(robot.forward_kinematics(q0, frame)[None], first, tuple(range(6)))[0]
    if np.abs(gap).max() > 1e-6:
        raise ValueRangeError(
            f"at q0 the frame is {printed(np.linalg.norm(gap[3:]), 3)} m and {printed(np.linalg.norm(gap[:3]), 3)} rad "
            "from where the path begins. Take robot.inverse_kinematics(T).q of its first pose, or begin it at "
            "robot.forward_kinematics(q0)."
        )
    n = _FIRST
    while True:
        s = np.linspace(0.0, 1.0, n + 1)
        q, why = _solved(robot, along(s), np.asarray(q0), frame)
        if len(q) < len(s) and (n < 1024 and "limit" not in why):
            n *= 4  # closer places may get through
            continue
        arrived, s = len(q) == len(s), s[: len(q)]
        if not arrived and len(q) < 8:
            raise PathError(f"the path of poses ends at s = {printed(s[-1], 4)}: {why}.", reached=float(s[-1]))
        path, middle = _spline(s / s[-1], q, 0.0), 0.5 * (s[1:] + s[:-1])
        off = twist_left(robot.forward_kinematics(path(middle / s[-1])[0], frame), along(middle), tuple(range(6)))
        deviation = float(max(np.linalg.norm(off[:, 3:], axis=1).max(), np.linalg.norm(off[:, :3], axis=1).max()))
        if not arrived and (deviation <= allowed or n >= 1024):
            partial, reached = _spline(s / s[-1], q, deviation), float(s[-1])
            raise PathError(
                f"the path of poses ends at s = {printed(reached, 4)}: {why}.", reached=reached, partial=partial
            )
        if deviation <= allowed:
            return _spline(s, q, deviation)
        n *= 2
        if n > _MOST:
            k = int(np.linalg.norm(off, axis=1).argmax())
            raise PathError(
                f"between {n // 2} places the frame is still {printed(deviation, 3)} off at s = {printed(middle[k], 4)}: "
                "the path bends there, or the arm is near a singular configuration. Round the path off, or allow more with "
                "tolerance=.",
                reached=float(middle[k]),
                partial=_spline(s, q, deviation),
            )


def _door(poses: Any) -> Callable[[Array], Array]:
    """The function, its results held to be poses (m, 4, 4)."""
    what = "the function of poses"
    if not callable(poses):
        raise ValueRangeError(
            f"poses is {type(poses).__name__}: give a function of s (m,) to (m, 4, 4), as straight_path does."
        )

    def along(s: Array) -> Array:
        try:
            found = poses(s)
        except Exception as problem:
            raise ValueRangeError(
                f"{what} failed with {type(problem).__name__}: {problem}. It is called with s (m,)."
            ) from problem
        T = arguments.finite(found, what, 4, 4)
        if T.shape != (len(s), 4, 4):
            raise ShapeError(f"{what} gave shape {T.shape} for s of shape {s.shape}, expected {(len(s), 4, 4)}.")
        return np.asarray(arguments.pose(T, what), float)

    return along


def _spline(s: Array, q: Array, deviation: float) -> JointPath:
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline(s, q, k=5)
    first, second = curve.derivative(1), curve.derivative(2)
    return JointPath(
        "path of poses", lambda x: (curve(x), first(x), second(x)), np.array([0.0, 1.0]), deviation=deviation
    )


def _solved(robot: Robot, targets: Array, q0: Array, frame: str | None) -> tuple[Array, str]:
    """q at each place until the first that fails, and why it does."""
    every = tuple(range(6))
    limits = robot.limits
    lower, upper = limits.lower, limits.upper
    names = robot.joint_names
    found, near = [q0], pose_finder(robot, frame, _ARRIVED)
    if limits.exceeded(q0).any():
        k = int(limits.exceeded(q0).argmax())
        return (
            np.array(found),
            f"it begins with {names[k]} at {printed(q0[k], 4)}, outside its limits {printed(lower[k], 4)} to "
            f"{printed(upper[k], 4)}",
        )
    for target in targets[1:]:
        q, last = found[-1].copy(), found[-1]
        if robot.nv <= 6 and len(found) > 1:
            q = 2.0 * last - found[-2]  # redundant joints would drift on by themselves
        step = near(target, q)
        if step is not None and np.abs(step - last).max() <= _JUMP:
            found.append(step)
            continue
        for _ in range(_NEWTON):
            e = twist_left(robot.forward_kinematics(q, frame)[None], target[None], every)[0]
            if np.abs(e).max() <= _ARRIVED:
                break
            J = robot.jacobian(q, frame)
            q = q + np.linalg.pinv(J, rcond=1e-9) @ e
        else:
            if np.abs(e).max() > 1e3 * _ARRIVED:
                sizes = np.linalg.svd(robot.jacobian(last, frame), compute_uv=False)
                least = float(sizes[min(5, len(sizes) - 1)]) if len(sizes) >= 6 else 0.0
                if least < 0.02 * float(sizes[0]):
                    return (
                        np.array(found),
                        "the arm is at a singular configuration there, stretched out or folded, and finds no way on (smallest "
                        f"singular value of J {printed(least, 2)})",
                    )
                return np.array(found), "the next pose is out of reach on this branch"
        if limits.exceeded(q).any():
            k = int(limits.exceeded(q).argmax())
            limit = lower[k] if q[k] < lower[k] else upper[k]
            return np.array(found), f"{names[k]} reaches its limit {printed(limit, 4)}"
        if np.abs(q - last).max() > _JUMP:
            k = int(np.abs(q - last).argmax())
            return np.array(found), (
                f"{names[k]} would jump by {printed(abs(q[k] - last[k]), 3)}: the arm passes a singular configuration"
            )
        found.append(q)
    return np.array(found), ""
