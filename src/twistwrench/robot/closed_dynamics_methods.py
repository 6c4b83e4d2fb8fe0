"""Dynamics of closed robots, forward and inverse, with the forces of their constraints. Modern Robotics section 8.7."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.constrained import ConstrainedMotion, ConstrainedTorques
from ..algorithms.constraint_forces import balance
from ..algorithms.weighted_svd import doubtful
from ..core import arguments, lazy
from ..typing import Array
from . import closed_robot_checks as checks
from .constraint_methods import reach_of
from .state_arguments import finite_states
from .wrench_arguments import Wrenches


class ClosedDynamicsMethods:
    """The methods of a closed robot about its dynamics."""

    @lazy.by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedMotion)
    def forward_dynamics(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> ConstrainedMotion:
        """Constrained forward dynamics: q̈ and λ of τ = M q̈ + h + A'λ + Σ J'F_by - Σ J'F_on, A q̈ + (dA/dt) dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        tau : (nv,) array_like, joint torques [N m, sliding joints: N]
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, count the friction of the joints

        Returns
        -------
        motion : ConstrainedMotion
            ``ddq`` (nv,) [rad/s², m/s²] and ``lam`` (k,) [N m, N], rows as in :attr:`row_names`.

        Raises
        ------
        ConstraintError
            q leaves loops open by a hundredth (rad, and of what the joints' lever is), or a tenth of dq breaks the
            constraints.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        UnknownNameError
            A wrench is at no frame of the robot.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Warns
        -----
        ConstraintWarning
            The configuration is singular.

        Notes
        -----
        MR section 8.7. λ = (A M⁻¹ A')⁻¹ (A M⁻¹ (τ - h) + (dA/dt) dq), of least norm where rows are redundant or the
        configuration is singular.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> motion = held.forward_dynamics(q, [0, 0, 0], [0, 0, 0])
        >>> bool(abs(held.constraint_jacobian(q) @ motion.ddq).max() < 1e-12)
        True
        """
        q, dq, tau = finite_states(self.robot.model, "forward_dynamics", q=q, dq=dq, tau=tau)
        checks.require_met(self, q, dq)
        if friction:
            tau = self.robot.engine.call("torque_past_friction", dq, tau)
        by, on = wrench_by_robot, wrench_on_robot
        if not self._kept:
            ddq = self.robot.forward_dynamics(q, dq, tau, wrench_by_robot=by, wrench_on_robot=on)
            return ConstrainedMotion(ddq, np.zeros((*ddq.shape[:-1], len(self.sizes)), ddq.dtype))
        rows, call = list(self.independent), self.robot.engine.call_with_wrenches
        with np.errstate(all="ignore"):
            ddq, some, pivots = call("constrained_dynamics", (q, dq, tau), by, on, None, constraints=self._kept)
        lam = np.zeros((*some.shape[:-1], len(self.sizes)), some.dtype)
        lam[..., rows] = some
        again = doubtful(pivots, self.sizes[rows])
        if len(rows) < len(self.sizes) and not again.all():
            usual = np.broadcast_to(q, (*again.shape, self.nq))[~again]
            lam[~again] = (reach_of(self, usual)[1].range @ lam[~again][..., None])[..., 0]
        if again.any():
            h = call("bias_forces", (q, dq), by, on, None)
            q, dq, force = (np.broadcast_to(x, (*again.shape, x.shape[-1]))[again] for x in (q, dq, tau - h))
            ddq[again], lam[again] = self._by_singular_values(q, dq, force)
        return ConstrainedMotion(ddq, lam)

    def _by_singular_values(self: Any, q: Array, dq: Array, force: Array) -> tuple[Array, Array]:
        """The same from τ - h (n, nv), however singular A is."""
        _, reach = reach_of(self, q)
        checks.warn_of_singular(reach.rank, len(self.independent))
        return reach.constrained(force, self.constraint_bias(q, dq))

    @lazy.by_blocks(lambda closed, _: [(closed.nv,), (len(closed.sizes),)], ConstrainedTorques)
    def inverse_dynamics(
        self: Any,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> ConstrainedTorques:
        """Constrained inverse dynamics: τ of the ``actuated`` joints, and λ, for a motion that meets the constraints.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]
        actuated : iterable of str, optional, joints that have a motor; None: all
        wrench_by_robot : {frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]
        wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, likewise
        friction : bool, add what overcomes the friction of all joints, driven or not
            As :meth:`forward_dynamics` takes off; friction that grows with the load is that of the torques the open
            robot would need.

        Returns
        -------
        torques : ConstrainedTorques
            ``tau`` (nv,) [N m, sliding joints: N], zero at the other joints, and ``lam`` (k,) [N m, N].

        Raises
        ------
        ConstraintError
            q, dq or ddq breaks the constraints, as in :meth:`forward_dynamics`, or the motors named cannot make the
            motion.
        UnknownNameError
            ``actuated`` names no joint of the robot.
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Notes
        -----
        With more motors than degrees of freedom τ is the one of least norm.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> torques = held.inverse_dynamics(q, [0, 0, 0], [0, 0, 0], actuated=["joint1"])
        >>> torques.tau.nonzero()[0].tolist()
        [0]
        """
        q, dq, ddq = finite_states(self.robot.model, "inverse_dynamics", q=q, dq=dq, ddq=ddq)
        checks.require_met(self, q, dq, ddq)
        driven = checks.driven(self.robot, actuated)
        by, on = wrench_by_robot, wrench_on_robot
        with np.errstate(all="ignore"):
            f = self.robot.inverse_dynamics(q, dq, ddq, wrench_by_robot=by, wrench_on_robot=on, friction=friction)
        f = arguments.finite(
            f, "inverse_dynamics: the torque of wrench_by_robot, wrench_on_robot and the motion", self.nv
        )
        A, reach = reach_of(self, q)
        lam, left = balance(f, reach.range @ A, self.sizes, driven)  # λ of what never moves would be any number
        checks.require_made(self, left, f, driven)
        tau = np.where(driven, f + (np.swapaxes(A, -1, -2) @ lam[..., None])[..., 0], 0.0)
        lam = (reach.range @ lam[..., None])[..., 0]
        return ConstrainedTorques(tau.astype(f.dtype, copy=False), lam.astype(f.dtype, copy=False))
