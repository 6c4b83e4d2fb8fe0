"""What the motors of a closed robot bear: why, how it changes, and where the power goes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.constrained import ConstrainedDerivatives
from ..algorithms.constrained_derivatives import Slopes, constrained_derivatives
from ..algorithms.constraint_forces import balance
from . import closed_robot_checks as checks
from .state_arguments import finite_states
from .wrench_arguments import Wrenches

if TYPE_CHECKING:
    from .explanation import Explanation


class ClosedLoadMethods:
    """The methods of a closed robot about the loads of its motors."""

    def explain(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> Explanation:
        """Why a motor needs its torque: τ of :meth:`inverse_dynamics` split by term and by the link or payload that causes it.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]
        actuated : iterable of str, optional, joints that have a motor; None: all
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, count the friction of all joints, driven or not

        Returns
        -------
        why : Explanation, whose parts add up to τ; they are zero at joints without a motor

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints, or the motors named cannot make the motion.
        UnknownNameError
            ``actuated`` names no joint of the robot, or a wrench is at no frame of it.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Notes
        -----
        What a part asks of all joints of the open robot, the constraints bring to the motors: τ = f + A'λ is linear in f.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> why = held.explain(q, [0, 0, 0], [0, 0, 0], ["joint1"])
        >>> bool(abs(why.torque - held.holding_torques(q, ["joint1"]).tau).max() < 1e-10)
        True
        """
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        self.inverse_dynamics(q, dq, ddq, actuated, friction=friction, **given)  # judges the state and the motors
        why = self.robot.explain(q, dq, ddq, friction=friction, **given)
        driven = checks.driven(self.robot, actuated)
        (q,) = finite_states(self.robot.model, "explain", q=q)
        A = self.constraint_jacobian(q)[..., None, None, :, :]
        lam, _ = balance(why.parts, A, self.sizes, driven)
        pressed = (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0]
        return replace(why, parts=np.where(driven, why.parts + pressed, 0.0))

    def _loads(self: Any, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        robot = self.robot
        tau = self.inverse_dynamics(q, dq, ddq, list(robot.actuators), friction=friction, **wrenches).tau
        _, rotor = robot.drive_torques(q, dq, ddq)
        return tau - rotor, rotor

    def _moved(self: Any, q: ArrayLike, dq: ArrayLike, tau: ArrayLike, friction: bool, wrenches: dict[str, Any]) -> Any:
        ddq = self.forward_dynamics(q, dq, tau, friction=friction, **wrenches).ddq
        left = self.robot.engine.call("torque_past_friction", dq, tau) if friction else None
        return ddq, left

    def inverse_dynamics_derivatives(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str],
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> ConstrainedDerivatives:
        """Derivatives of the motors' torques by the motors' own q, dq and ddq, along motions that keep to the constraints.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]
        actuated : iterable of str, joints with a motor, of as many velocities m as there are degrees of freedom
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise

        Returns
        -------
        slopes : ConstrainedDerivatives, ``tau_by_q``, ``tau_by_dq`` and ``tau_by_ddq`` (m, m), in the order of the robot's
            velocities; the last is the mass matrix that the motors see

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints; the joints named have more or fewer velocities than there are degrees of
            freedom, or do not determine the others at q.
        UnknownNameError
            ``actuated`` names no joint of the robot, or a wrench is at no frame of it.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Notes
        -----
        The other joints' coordinates, velocities and accelerations follow from the constraints. Columns are along
        :meth:`twistwrench.Robot.add`. Friction is left out. MR section 8.7, differentiated.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.inverse_dynamics_derivatives(q, [0, 0, 0], [0, 0, 0], ["joint1"]).tau_by_q.shape
        (1, 1)
        """
        robot, given = self.robot, {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        driven = checks.driven(robot, actuated)
        q, dq, ddq = (x.astype(float) for x in finite_states(robot.model, "derivatives", q=q, dq=dq, ddq=ddq))
        batch = np.broadcast_shapes(*(x.shape[:-1] for x in (q, dq, ddq)))
        q, dq, ddq = (np.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, dq, ddq))
        checks.require_met(self, q, dq, ddq)
        checks.require_independent(self, q, driven)
        f = robot.inverse_dynamics(q, dq, ddq, **given)
        f_by_q, f_by_dq = robot.inverse_dynamics_derivatives(q, dq, ddq, **given)
        rows, empty = list(self.independent), np.zeros((*q.shape[:-1], 0, self.nv))
        A, A_by_q, b_by_q, b_by_dq = empty, empty[..., None] * np.zeros(self.nv), empty, empty
        if rows:
            A = self.constraint_jacobian(q)[..., rows, :]
            A_by_q = robot.kernel("constraint_jacobian", constraints=self._kept, by="q")(q)
            b_by_q, b_by_dq = robot.kernel("constraint_bias", constraints=self._kept, by=("q", "dq"))(q, dq)
        slopes = Slopes(A, A_by_q, b_by_q, b_by_dq, f, f_by_q, f_by_dq, robot.mass_matrix(q))
        return constrained_derivatives(slopes, dq, ddq, driven)
