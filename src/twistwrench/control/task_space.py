"""Task-space control with posture. MR section 11.4.3.

The law F = Λ a + η, τ = J'F of section 8.6 leaves motions in the null space of J undetermined. Here they follow a
posture. Of all joint accelerations that give the frame the acceleration a, the law selects the one nearest to the
posture's acceleration ddq_0 in the metric of M. With P = 1 - J'Λ J M⁻¹, the projector of section 8.7,

    τ = J'(Λ a + η) + P (M ddq_0 + h)  =  M ddq_0 + h + J'Λ (a - J ddq_0 - dJ/dt dq),

and the posture does not disturb the task. Source: Khatib, "A unified approach for motion and force control of robot
manipulators: the operational space formulation", IEEE J. Robotics and Automation 3(1), 1987. If J loses rank, Λ is the
pseudo-inverse, and the lost directions follow the posture.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.algorithms.kinematics import row_numbers
from ..mechanics.lie import se3, so3
from ..mechanics.lie.labelled import TWIST
from ..robot import Robot
from ..robot.arguments import Kind, Rows
from .references import Motion, Reference, joint_motion, one_state, pose_motion, require_driven, set_gains

KINDS = ("world_aligned", "body")
"""Kinds of tasks; see :class:`TaskLaw`."""


def body_errors(T: Array, V: Array, T_d: Array, V_d: Array, dV_d: Array) -> tuple[Array, Array, Array]:
    """Pose error X_e, twist error V_e and feedforward of the frame {b} at T, in {b}; (6,) each. MR section 11.4.3.

    [X_e] = log(X⁻¹ X_d), V_e = [Ad_X⁻¹X_d] V_d - V_b; the feedforward is d/dt ([Ad_X⁻¹X_d] V_d).
    """
    T_bd = se3.inverse(T) @ T_d
    R, p = T_bd[:3, :3], T_bd[:3, 3]
    V_bd = _transform_twist(R, p, V_d)
    dV_bd = _transform_twist(R, p, dV_d)
    linear_part = so3.cross(V[3:], V_bd[:3]) + so3.cross(V[:3], V_bd[3:])
    bracket = np.concatenate([so3.cross(V[:3], V_bd[:3]), linear_part])  # [V, V_bd]
    return se3.log(T_bd), V_bd - V, dV_bd - bracket


def world_errors(T: Array, V: Array, T_d: Array, V_d: Array, dV_d: Array) -> tuple[Array, Array, Array]:
    """Pose error (log(R_d R'), p_d - p), error of (ω, v) and feedforward in axes of {s}; (6,) each. MR section 11.3.3."""
    R_d, w_d, v_d = T_d[:3, :3], V_d[:3], V_d[3:]
    X_e = np.concatenate([so3.log(R_d @ T[:3, :3].T), T_d[:3, 3] - T[:3, 3]])
    V_s = np.concatenate([R_d @ w_d, R_d @ v_d])  # V_d in axes of {s}, as V is
    dV_s = np.concatenate([R_d @ dV_d[:3], R_d @ (dV_d[3:] + so3.cross(w_d, v_d))])
    return X_e, V_s - V, dV_s


def _transform_twist(R: Array, p: Array, V: Array) -> Array:
    """Product [Ad_T] V; T = (R, p) is a product of two validated poses, so it is not validated again."""
    w = R @ V[:3]
    return np.concatenate([w, R @ V[3:] + so3.cross(p, w)])


class TaskState(NamedTuple):
    """Task-space errors and matrices at one state, on the selected rows."""

    error: Array
    """Pose error X_e (r,), from the current to the desired pose [rad, m]."""
    error_rate: Array
    """Twist error V_e (r,)."""
    feedforward: Array
    """Acceleration of the reference (r,)."""
    J: Array
    """Jacobian (r, nv)."""
    drift: Array
    """Drift term dJ/dt dq (r,)."""
    Lambda: Array
    """Task-space inertia (r, r)."""
    T: Array
    """Pose of the frame (4, 4)."""


_SUBGROUP_ROWS = (
    frozenset((0, 1, 2, 3, 4, 5)),  # all motions
    frozenset((0, 1, 2)),  # rotations
    frozenset((0, 4, 5)),  # planar motions perpendicular to x
    frozenset((1, 3, 5)),  # to y
    frozenset((2, 3, 4)),  # to z
)
"""Sets of twist rows whose motions are a subgroup of SE(3): errors on them can be corrected by motions on the same rows."""


@dataclass(frozen=True, eq=False)
class TaskLaw:
    """Base of task-space laws: robot of the controller's model, reference of a frame, selected rows, and posture.

    ``kind="world_aligned"``: rotation and translation are separate, along the axes of {s}, X_e = (log(R_d R'), p_d -
    p). Any rows can be selected. ``kind="body"``: the book's [X_e] = log(X⁻¹ X_d) along the frame's axes, for all rows,
    the angular rows, or those of a plane; other rows raise ValueRangeError.
    """

    robot: Robot
    """Robot of the controller's model."""
    reference: Reference
    """T_d (4, 4), or a function of the time [s]: it returns (T_d, V_d, dV_d) with body twists, such as :class:`PoseMotion`, or
    (q, dq, ddq) of the joints, such as a trajectory, from which the frame's motion follows."""
    frame: str | None = field(default=None, kw_only=True)
    """Controlled frame; None: the tip."""
    kind: Kind = field(default="world_aligned", kw_only=True)
    """"world_aligned" or "body", as above."""
    rows: Rows = field(default=None, kw_only=True)
    """Selected rows, such as ``"vx vz"``; None: all six."""
    posture: Reference | None = field(default=None, kw_only=True)
    """Reference of the joints, as for :class:`JointLaw`; None: motions that the task leaves free are only damped."""
    posture_kp: ArrayLike = field(default=25.0, kw_only=True)
    """Posture gain [1/s²]."""
    posture_kd: ArrayLike = field(default=10.0, kw_only=True)
    """Posture damping [1/s]."""
    _rows: tuple[int, ...] = field(init=False, repr=False)
    _posture_kp: Array = field(init=False, repr=False)
    _posture_kd: Array = field(init=False, repr=False)
    _motion: Motion = field(init=False, repr=False)
    _posture: Motion | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        name = type(self).__name__
        set_field = object.__setattr__  # the dataclass is frozen
        robot = require_driven(self.robot, name)
        robot.model.frame(self.frame)  # raises UnknownNameError for another frame
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            raise UnknownNameError.from_choices("kind of task", self.kind, KINDS)
        set_field(self, "_rows", row_numbers(self.rows))
        if self.kind == "body" and frozenset(self._rows) not in _SUBGROUP_ROWS:
            raise ValueRangeError(
                f"{name}: rows={self.rows!r} of kind 'body' do not go by themselves: the error is a twist, whose turning moves "
                "the origin too. Take six, 'wx wy wz', a plane ('wx vy vz', 'wy vx vz', 'wz vx vy'), or kind='world_aligned'."
            )
        set_field(self, "_motion", pose_motion(robot, self.reference, self.frame, f"{name}: reference"))
        posture_motion = None if self.posture is None else joint_motion(robot, self.posture, f"{name}: posture")
        set_field(self, "_posture", posture_motion)
        set_gains(self, robot.model.velocity_names, "posture_kp", "posture_kd")

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names of the selected rows, such as ``wx``."""
        return tuple(TWIST[k] for k in self._rows)

    def task(self, t: float, q: ArrayLike, dq: ArrayLike) -> TaskState:
        """Task-space errors and the other inputs of the law, on the selected rows.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> law = TaskSpace(arm, arm.forward_kinematics([0, 0.5, 1]), kp=100.0, kd=20.0, rows="vx vz")
        >>> law.task(0.0, [0, 0.5, 1], [0, 0, 0]).error.round(12).tolist()
        [0.0, 0.0]
        """
        robot = self.robot
        rows = list(self._rows)
        q, dq = one_state(robot, type(self).__name__, q, dq)
        T = robot.forward_kinematics(q, self.frame)
        J = robot.jacobian(q, self.frame, self.kind)
        T_d, V_d, dV_d = self._motion(t)
        compute_errors = body_errors if self.kind == "body" else world_errors
        X_e, V_e, feedforward = compute_errors(T, J @ dq, T_d, V_d, dV_d)
        drift = robot.jacobian_rate(q, dq, self.frame, self.kind) @ dq
        Lambda = robot.task_inertia(q, self.frame, self.kind, self._rows)
        return TaskState(X_e[rows], V_e[rows], feedforward[rows], J[rows], drift[rows], Lambda, T)

    def _torques(self, t: float, q: ArrayLike, dq: ArrayLike, task: TaskState, F: Array) -> Array:
        """τ for a force F (r,) that gives the frame the acceleration Λ⁻¹ F after compensation of all other terms."""
        q, dq = one_state(self.robot, type(self).__name__, q, dq)
        if self._posture is None:
            ddq_0 = -self._posture_kd @ dq
        else:
            q_r, dq_r, ddq_r = self._posture(t)
            ddq_0 = ddq_r + self._posture_kp @ self.robot.subtract(q_r, q) + self._posture_kd @ (dq_r - dq)
        # τ = M ddq_0 + h + J'Λ (a - J ddq_0 - dJ/dt dq) with F = Λ a
        F_beyond_posture = F - task.Lambda @ (task.J @ ddq_0 + task.drift)
        return self.robot.inverse_dynamics(q, dq, ddq_0) + task.J.T @ F_beyond_posture


@dataclass(frozen=True, eq=False)
class TaskSpace(TaskLaw):
    """Task-space control: τ = J'(Λ (d/dt(V_d) + Kp X_e + Kd V_e) + η) + P τ_0.

    The frame's error obeys dV_e/dt + Kd V_e + Kp X_e = 0. The remaining motions follow ``posture``, or are damped. MR
    section 11.4.3, with the projector P of section 8.7.

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
    """Kp [1/s²]: scalar, (r,), or (r, r)."""
    kd: ArrayLike
    """Kd [1/s]: scalar, (r,), or (r, r)."""
    _kp: Array = field(init=False, repr=False)
    _kd: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_gains(self, self.row_names, "kp", "kd")

    def __call__(self, t: float, q: ArrayLike, dq: ArrayLike) -> Array:
        """τ (nv,)."""
        task = self.task(t, q, dq)
        a = task.feedforward + self._kp @ task.error + self._kd @ task.error_rate
        return self._torques(t, q, dq, task, task.Lambda @ a)


complete(globals())
