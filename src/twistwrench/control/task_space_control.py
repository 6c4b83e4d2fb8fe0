"""Control of a frame's motion, with a posture in what the task leaves free. Modern Robotics section 11.4.3.

The law F = Λ a + η, τ = J'F of section 8.6 leaves the motions that J does not see to themselves. Here they follow a posture:
of all accelerations of the joints that give the frame the acceleration a, the one nearest to that of the posture, ddq_0, in the
metric of M. With P = 1 - J'Λ J M⁻¹, the projector of section 8.7,

    τ = J'(Λ a + η) + P (M ddq_0 + h)  =  M ddq_0 + h + J'Λ (a - J ddq_0 - dJ/dt dq),

and the posture does not disturb the task. Source: Khatib, "A unified approach for motion and force control of robot
manipulators: the operational space formulation", IEEE J. Robotics and Automation 3(1), 1987. Where J loses rank, Λ is the
pseudo-inverse, and the lost directions follow the posture.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from numpy.typing import ArrayLike

from ..algorithms.operational_space import row_numbers
from ..errors import UnknownNameError, ValueRangeError
from ..robot import Robot
from ..robot.quantity_types import Kind, Rows
from ..screws.component_names import TWIST
from ..typing import Array
from .control_arguments import gain, one_state, require_driven
from .references import Motion, Reference, in_body, in_world, joint_motion, pose_motion

KINDS = ("world_aligned", "body")


class TaskState(NamedTuple):
    """Task-space state: how a frame does at one state, on the chosen rows."""

    error: Array
    """X_e (r,): where it shall be, seen from where it is [rad, m]."""
    error_rate: Array
    """V_e (r,)."""
    feedforward: Array
    """Of the reference (r,): its acceleration."""
    J: Array
    """(r, nv)."""
    drift: Array
    """dJ/dt dq (r,)."""
    Lambda: Array
    """(r, r)."""
    T: Array
    """(4, 4)."""


_TOGETHER = frozenset(map(frozenset, ((0, 1, 2, 3, 4, 5), (0, 1, 2), (0, 4, 5), (1, 3, 5), (2, 3, 4))))
"""Rows of a twist that make a group of motions: an error on them is made up for by motions on them."""


@dataclass(frozen=True, eq=False)
class TaskLaw:
    """What task-space laws have in common: a robot as the law knows it, a reference of a frame, rows of it, and a posture.

    ``kind="world_aligned"``: turning and moving each by itself along the axes of {s}, X_e = (log(R_d R'), p_d - p), so that
    any rows can be chosen. ``kind="body"``: the book's [X_e] = log(X⁻¹ X_d) along the frame's axes, for all rows, those of
    turning, or those of a plane; ValueRangeError for others.
    """

    robot: Robot
    """The robot as the law knows it."""
    reference: Reference
    """T_d (4, 4), or a function of the time [s] that gives (T_d, V_d, dV_d), body twists, such as :class:`PoseMotion`; or one
    that gives (q, dq, ddq) of the joints, such as a trajectory, whose frame is meant."""
    frame: str | None = field(default=None, kw_only=True)
    """None: the tip."""
    kind: Kind = field(default="world_aligned", kw_only=True)
    """"world_aligned" or "body", as above."""
    rows: Rows = field(default=None, kw_only=True)
    """``"vx vz"``; None: all six."""
    posture: Reference | None = field(default=None, kw_only=True)
    """As the reference of :class:`JointLaw`; None: any, and free motions are damped only."""
    posture_kp: ArrayLike = field(default=25.0, kw_only=True)
    """1/s²."""
    posture_kd: ArrayLike = field(default=10.0, kw_only=True)
    """1/s."""
    _rows: tuple[int, ...] = field(init=False, repr=False)
    _posture_kp: Array = field(init=False, repr=False)
    _posture_kd: Array = field(init=False, repr=False)
    _motion: Motion = field(init=False, repr=False)
    _posture: Motion | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        what, put = type(self).__name__, object.__setattr__
        robot = require_driven(self.robot, what)
        robot.model.frame(self.frame)
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise UnknownNameError.of("kind of task", self.kind, KINDS)
        put(self, "_rows", row_numbers(self.rows))
        if self.kind == "body" and frozenset(self._rows) not in _TOGETHER:
            raise ValueRangeError(
                f"{what}: rows={self.rows!r} of kind 'body' do not go by themselves: the error is a twist, whose turning moves "
                "the origin too. Take six, 'wx wy wz', a plane ('wx vy vz', 'wy vx vz', 'wz vx vy'), or kind='world_aligned'."
            )
        put(self, "_motion", pose_motion(robot, self.reference, self.frame, f"{what}: reference"))
        posture = None if self.posture is None else joint_motion(robot, self.posture, f"{what}: posture")
        put(self, "_posture", posture)
        for name in ("posture_kp", "posture_kd"):
            put(self, f"_{name}", gain(getattr(self, name), f"{what}: {name}", robot.model.velocity_names))

    @property
    def row_names(self) -> tuple[str, ...]:
        """Of the rows chosen."""
        return tuple(TWIST[k] for k in self._rows)

    def task(self, t: float, q: ArrayLike, dq: ArrayLike) -> TaskState:
        """Task-space errors, and what the law needs beside them, on the chosen rows.

        Parameters
        ----------
        t : float [s]
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]

        Returns
        -------
        state : TaskState

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> law = TaskSpace(arm, arm.forward_kinematics([0, 0.5, 1]), kp=100.0, kd=20.0, rows="vx vz")
        >>> law.task(0.0, [0, 0.5, 1], [0, 0, 0]).error.round(12).tolist()
        [0.0, 0.0]
        """
        robot, rows = self.robot, list(self._rows)
        q, dq = one_state(robot, type(self).__name__, q, dq)
        T, J = robot.forward_kinematics(q, self.frame), robot.jacobian(q, self.frame, self.kind)
        errors = (in_body if self.kind == "body" else in_world)(T, J @ dq, *self._motion(t))
        drift = robot.jacobian_rate(q, dq, self.frame, self.kind) @ dq
        Lambda = robot.task_inertia(q, self.frame, self.kind, self._rows)
        X_e, V_e, forward = (x[rows] for x in errors)
        return TaskState(X_e, V_e, forward, J[rows], drift[rows], Lambda, T)

    def _torques(self, t: float, q: ArrayLike, dq: ArrayLike, now: TaskState, F: Array) -> Array:
        """τ for a force F (r,) that would give the frame the acceleration Λ⁻¹ F, if all else were made up for."""
        ddq = self._posture_acceleration(t, q, dq)
        more = F - now.Lambda @ (now.J @ ddq + now.drift)
        return self.robot.inverse_dynamics(q, dq, ddq) + now.J.T @ more

    def _posture_acceleration(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        if self._posture is None:
            return -self._posture_kd @ one_state(self.robot, type(self).__name__, q, dq)[1]
        q, dq = one_state(self.robot, type(self).__name__, q, dq)
        q_r, dq_r, ddq_r = self._posture(t)
        return ddq_r + self._posture_kp @ self.robot.subtract(q_r, q) + self._posture_kd @ (dq_r - dq)


@dataclass(frozen=True, eq=False)
class TaskSpace(TaskLaw):
    """Task-space control: τ = J'(Λ (d/dt(V_d) + Kp X_e + Kd V_e) + η) + P τ_0.

    The frame's error obeys dV_e/dt + Kd V_e + Kp X_e = 0. What the task leaves free follows ``posture``, or is damped.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError, FrameError
        An argument is invalid, or the robot has no such frame or row.

    Notes
    -----
    MR section 11.4.3, with the projector P of section 8.7.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, q = tw.robots.planar_3r(), np.array([-0.6, 0.2, 2.2])
    >>> T_d = arm.forward_kinematics(q) + [[0, 0, 0, 0.1], [0] * 4, [0] * 4, [0] * 4]
    >>> law = TaskSpace(arm, T_d, kp=100.0, kd=20.0, rows="vx vz", posture=q)
    >>> ddq = arm.forward_dynamics(q, [0, 0, 0], law(0.0, q, [0, 0, 0]))
    >>> abs((arm.jacobian(q, kind="world_aligned") @ ddq)[[3, 5]]).round(9).tolist()
    [10.0, 0.0]
    """

    kp: ArrayLike
    """Kp [1/s²]: a number, (r,), or (r, r)."""
    kd: ArrayLike
    """Kd [1/s]: the same."""
    _kp: Array = field(init=False, repr=False)
    _kd: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("kp", "kd"):
            object.__setattr__(self, f"_{name}", gain(getattr(self, name), f"TaskSpace: {name}", self.row_names))

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        now = self.task(t, q, dq)
        a = now.feedforward + self._kp @ now.error + self._kd @ now.error_rate
        return self._torques(t, q, dq, now, now.Lambda @ a)
