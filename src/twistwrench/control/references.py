"""Reference motions of controllers (constant, function of time, trajectory), and argument validation of ``control``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import FrameError, ShapeError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.algorithms.operational_space import multi_dof_joints
from ..mechanics.algorithms.time_scalings import PosePath
from ..mechanics.lie import so3
from ..mechanics.lie.twist_wrench import Pose
from ..mechanics.model.model import BASE
from ..robot import Robot
from ..robot.base import require_robot

Measured = Callable[[float, Array, Array], ArrayLike]
"""Measured value from the time [s], q (nq,) and dq (nv,)."""
Motion = Callable[[float], tuple[Array, Array, Array]]
"""Position, velocity and acceleration from the time [s]."""
Reference = ArrayLike | Callable[[float], Any]
"""Constant configuration or pose, or a function of the time [s]."""
Timing = Callable[[ArrayLike], tuple[Array, Array, Array]]
"""Time scaling along a path: s, ds/dt and d²s/dt² at t [s]."""


@dataclass(frozen=True, eq=False)
class PoseMotion:
    """Motion of a frame: T(s(t)) with its body twist and the twist's rate, from a path and a time scaling. MR section 9.2.

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench import trajectories
    >>> path = trajectories.screw_path(np.eye(4), tw.se3.exp([0, 0, 1, 0, 0, 0]))
    >>> T, V, dV = PoseMotion(path, trajectories.quintic(2.0))(1.0)
    >>> V.round(4).tolist()
    [0.0, 0.0, 0.9375, 0.0, 0.0, 0.0]
    """

    path: PosePath
    """Path, as returned by :func:`twistwrench.trajectories.screw_path` or :func:`~twistwrench.trajectories.straight_path`."""
    scaling: Timing
    """Time scaling s(t), such as :func:`twistwrench.trajectories.quintic`."""

    def __post_init__(self) -> None:
        if not isinstance(self.path, PosePath):
            raise ValueRangeError(
                f"PoseMotion: the path is {arguments.value_text(self.path)}. Take tw.trajectories.screw_path or "
                "straight_path."
            )
        _require_one_argument(self.scaling, "PoseMotion: the scaling")

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """T (4, 4), the body twist V (6,) and dV/dt (6,) at t [s]."""
        s, ds, dds = map(float, _motion_values(self.scaling, "PoseMotion: the scaling", t))
        V_path = self.path.body_twist(s)  # for ds/dt = 1
        dV_path = np.zeros(6)  # derivative of V_path by s
        if self.path.straight:
            dV_path[3:] = -so3.cross(V_path[:3], V_path[3:])  # R turns in v = R'(p1 - p0)
        return self.path(s), V_path * ds, V_path * dds + dV_path * ds * ds


def joint_motion(robot: Robot, reference: Reference, what: str) -> Motion:
    """Function of the time that returns q_d (nq,), dq_d and ddq_d (nv,).

    ``reference`` is a constant q_d, or a function of the time that returns all three; ``what`` names it in errors.
    """
    source: Any = reference
    if not callable(reference):
        source = getattr(reference, "motion", reference)  # a simulation's result has a motion
    if not callable(source):
        q = arguments.one(source, what, robot.nq, names=robot.coordinate_names)
        q = np.array(arguments.finite(q, what, robot.nq))
        q.setflags(write=False)
        zero = np.zeros(robot.nv)
        return lambda _t: (q, zero, zero)
    _require_one_argument(source, what)
    rate_names = robot.model.velocity_names

    def motion(t: float) -> tuple[Array, Array, Array]:
        q, dq, ddq = _motion_values(source, what, t)
        label = f"{what} at t = {printed(t)} s"
        q = arguments.one(q, f"q of {label}", robot.nq, names=robot.coordinate_names)
        dq = arguments.one(dq, f"dq of {label}", robot.nv, names=rate_names)
        ddq = arguments.one(ddq, f"ddq of {label}", robot.nv, names=rate_names)
        return q, dq, ddq

    motion(0.0)  # raises now if the function returns other values
    return motion


def pose_motion(robot: Robot, reference: Reference, frame: str | None, what: str) -> Motion:
    """Function of the time that returns T_d (4, 4), its body twist V_d (6,) and dV_d/dt (6,).

    ``reference`` is a constant pose, a function of the time that returns all three, or a joint motion.
    """
    controlled_frame = robot.tip if frame is None else frame
    if isinstance(reference, Pose) and reference.of != controlled_frame:
        raise FrameError(
            f"{what} is the pose of {reference.of!r}, and {controlled_frame!r} is controlled: pass "
            f"frame={reference.of!r}, or move it."
        )
    frames = robot.model.frames
    if isinstance(reference, Pose) and reference.to in frames and frames[reference.to].body != BASE:
        raise FrameError(
            f"{what} is a pose seen from {reference.to!r}, which moves, and a reference is one seen from {{s}}: "
            f"T_s{reference.to} @ T, with Pose(robot.forward_kinematics(q, {reference.to!r}), to='s', of={reference.to!r})."
        )
    if not callable(reference):
        matrix = arguments.finite(arguments.one(reference, what, 4, 4), what)
        T = np.array(arguments.pose(matrix, what), float)
        T.setflags(write=False)
        zero = np.zeros(6)
        return lambda _t: (T, zero, zero)
    _require_one_argument(reference, what)
    start_position, _, _ = _motion_values(reference, what, 0.0)
    if np.ndim(start_position) == 1:  # q, not a pose
        motion_of_joints = joint_motion(robot, reference, what)

        def motion_of_frame(t: float) -> tuple[Array, Array, Array]:
            q, dq, ddq = motion_of_joints(t)
            T = robot.forward_kinematics(q, frame)
            V = robot.frame_velocity(q, dq, frame)
            dV = robot.frame_acceleration(q, dq, ddq, frame)
            return T, V, dV

        return motion_of_frame

    def motion(t: float) -> tuple[Array, Array, Array]:
        T, V, dV = _motion_values(reference, what, t)
        label = f"{what} at t = {printed(t)} s"
        T = arguments.one(T, f"T of {label}", 4, 4)
        T = arguments.pose(T, f"T of {label}")
        V = arguments.one(V, f"V of {label}", 6)
        dV = arguments.one(dV, f"dV of {label}", 6)
        return T, V, dV

    motion(0.0)  # raises now if the function returns other values
    return motion


_MAX_CHARACTERS = 60
"""Characters of a value that a message repeats."""


def _motion_values(function: Callable[[float], Any], what: str, t: Any) -> tuple[Any, Any, Any]:
    """Values of the function at t [s]: three arrays."""
    t = arguments.number(t, "t")
    values = function(t)
    if not isinstance(values, tuple | list) or len(values) != 3:
        values_text = repr(values)[:_MAX_CHARACTERS]
        if isinstance(values, np.ndarray):
            values_text = f"an array of shape {np.shape(values)}"
        raise ShapeError(
            f"{what} gave {values_text} at t = {printed(t)} s. A motion gives three: position, velocity, acceleration, as a "
            "Trajectory does; for a pose (T, V, dV), twists of the body."
        )
    position, velocity, acceleration = values
    return position, velocity, acceleration


def _require_one_argument(function: Any, what: str) -> None:
    """Raise ValueRangeError unless the function can be called with the time alone."""
    if not callable(function) or isinstance(function, type):  # calling a class makes an object, not values
        raise ValueRangeError(f"{what} is {arguments.value_text(function)}, and must be a function of the time.")
    try:
        parameters = signature(function)
    except (TypeError, ValueError):  # some C functions have no signature
        return
    try:
        parameters.bind(0.0)
    except TypeError as problem:
        raise ValueRangeError(
            f"{what} is a function of {parameters}, and is called with the time [s]: {problem}."
        ) from None


# ── Argument validation of ``control``: robots, states and gains

_ROUNDING_SHARE = 1e-9
"""Rounding errors of a gain matrix, as a share of its largest entry."""


def require_driven(robot: object, what: str) -> Robot:
    """Return the robot; raises an error unless it has a torque for every velocity."""
    checked = require_robot(robot, what)
    undriven_joints = multi_dof_joints(checked.model)
    if undriven_joints:
        raise ValueRangeError(
            f"{what} needs a torque for every velocity, and {', '.join(undriven_joints)} of robot {checked.name!r} is not a "
            "joint of one degree of freedom. Lock it (robot.lock), or load the robot on a fixed base."
        )
    return checked


def one_state(robot: Robot, what: str, q: ArrayLike, dq: ArrayLike) -> tuple[Array, Array]:
    """q (nq,) and dq (nv,) of one state."""
    q = arguments.one(q, f"{what}: q", robot.nq, names=robot.coordinate_names)
    return q, arguments.one(dq, f"{what}: dq", robot.nv, names=robot.model.velocity_names)


def gain(K: ArrayLike, what: str, names: Sequence[str], *, definite: bool = False) -> Array:
    """Gain as a symmetric matrix (n, n), n the number of names, from a scalar, a vector (n,) or a matrix.

    Its eigenvalues may not be negative, and not zero if it must be ``definite``.
    """
    n = len(names)
    values = arguments.finite(K, what, names=names)
    if values.shape not in ((), (n,), (n, n)):
        raise ShapeError(
            f"{what} has shape {values.shape}: give one number, {n} of them (for {', '.join(names)}), or a symmetric "
            f"matrix ({n}, {n})."
        )
    if values.ndim < 2:
        values = values * np.eye(n)
    matrix = np.array(values, float)
    rounding = _ROUNDING_SHARE * float(np.abs(matrix).max(initial=0.0))
    if np.abs(matrix - matrix.T).max(initial=0.0) > rounding:
        raise ValueRangeError(
            f"{what} is not symmetric, so it could feed energy in. Give a symmetric matrix ({n}, {n})."
        )
    smallest_eigenvalue = float(np.linalg.eigvalsh(matrix).min(initial=np.inf))
    is_negative = smallest_eigenvalue < -rounding
    is_singular = not smallest_eigenvalue > 0.0  # true for nan, too
    if is_negative or (definite and is_singular):
        requirement = "be above zero" if definite else "not be negative"
        raise ValueRangeError(
            f"{what} has the eigenvalue {printed(smallest_eigenvalue, 4)}, and must {requirement}: a gain holds back, never "
            "pushes on."
        )
    matrix.setflags(write=False)
    return matrix


def set_gains(law: object, names: Sequence[str], *fields: str) -> None:
    """Store gains of a law as matrices, under their names with a leading underscore."""
    for field in fields:
        value = getattr(law, field)
        label = f"{type(law).__name__}: {field}"
        matrix = gain(value, label, names)
        object.__setattr__(law, f"_{field}", matrix)  # the law is a frozen dataclass
