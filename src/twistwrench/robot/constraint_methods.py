"""What constraints let a closed robot do, and what of torques they bear. Modern Robotics section 8.7."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.constrained import MotionForceSplit
from ..algorithms.constraints import names
from ..algorithms.weighted_svd import Reach
from ..core import arguments, lazy
from ..typing import Array
from .state_arguments import finite_states

if TYPE_CHECKING:
    from .closed_robot import ClosedRobot


class ConstraintMethods:
    """The methods of a closed robot about its constraints: A, its rank, and projections."""

    @lazy.by_blocks(lambda closed, _: [(len(closed.sizes), closed.nv)])
    def constraint_jacobian(self: Any, q: ArrayLike) -> Array:
        """Constraint Jacobian A, with A dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        A : (k, nv) array, rows as in :attr:`row_names`

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Notes
        -----
        MR section 8.7.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.constraint_jacobian(q).shape
        (2, 3)
        """
        (q,) = finite_states(self.robot.model, "constraint_jacobian", q=q)
        if not self.constraints:
            return np.zeros((*q.shape[:-1], 0, self.nv))
        return np.asarray(self.robot.engine.call("constraint_jacobian", q, constraints=self.constraints))

    @lazy.by_blocks(lambda closed, _: [(len(closed.sizes),)])
    def constraint_bias(self: Any, q: ArrayLike, dq: ArrayLike) -> Array:
        """Constraint bias (dA/dt) dq, so that A q̈ + (dA/dt) dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]

        Returns
        -------
        b : (k,) array, rows as in :attr:`row_names` [rad/s², m/s²]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> held.constraint_bias(q, [0, 0, 0]).tolist()
        [0.0, 0.0]
        """
        q, dq = finite_states(self.robot.model, "constraint_bias", q=q, dq=dq)
        if not self.constraints:
            return np.zeros((*np.broadcast_shapes(q.shape[:-1], dq.shape[:-1]), 0))
        return np.asarray(self.robot.engine.call("constraint_bias", q, dq, constraints=self.constraints))

    @lazy.by_blocks(lambda *_: [()], dtype=int)
    def rank(self: Any, q: ArrayLike) -> Array:
        """Rank of A at q: how many of its rows are independent; fewer than usual where the configuration is singular.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        count : () array of int

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> int(held.rank(q))
        2
        """
        return reach_of(self, *finite_states(self.robot.model, "rank", q=q))[1].rank

    @lazy.by_blocks(lambda *_: [()], dtype=int)
    def degrees_of_freedom(self: Any, q: ArrayLike) -> Array:
        """Degrees of freedom at q: nv less the rank of A.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        count : () array of int

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> int(held.degrees_of_freedom(q))
        1
        """
        return self.nv - self.rank(q)

    @lazy.by_blocks(lambda closed, _: [(closed.nv, closed.nv)])
    def projector(self: Any, q: ArrayLike) -> Array:
        """Projector P = 1 - A'(A M⁻¹ A')⁻¹ A M⁻¹, which takes from torques what presses on the constraints.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Returns
        -------
        P : (nv, nv) array

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        Its transpose takes from velocities what breaks them. MR section 8.7.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> P = held.projector(q)
        >>> bool(abs(P @ P - P).max() < 1e-12)
        True
        """
        (q,) = finite_states(self.robot.model, "projector", q=q)
        return reach_of(self, q)[1].projector.astype(q.dtype, copy=False)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)] * 2, MotionForceSplit)
    def split(self: Any, q: ArrayLike, tau: ArrayLike) -> MotionForceSplit:
        """Torques split into those that move the robot, Pτ, and those that the constraints bear.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        tau : (nv,) array_like, joint torques [N m, sliding joints: N]

        Returns
        -------
        parts : MotionForceSplit, ``motion`` and ``force`` (nv,) [N m, sliding joints: N]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> parts = held.split(q, [1, 2, 3])
        >>> (parts.motion + parts.force).round(12).tolist()
        [1.0, 2.0, 3.0]
        """
        q, tau = finite_states(self.robot.model, "split", q=q, tau=tau)
        motion = (reach_of(self, q)[1].projector @ tau[..., None])[..., 0].astype(np.result_type(q, tau), copy=False)
        return MotionForceSplit(motion, tau - motion)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_velocity(self: Any, q: ArrayLike, dq: ArrayLike) -> Array:
        """Velocity nearest in the kinetic metric that meets A dq = 0: P'dq.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]

        Returns
        -------
        dq : (nv,) array [rad/s, m/s]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> bool(abs(held.constraint_jacobian(q) @ held.project_velocity(q, [1, 0, 0])).max() < 1e-12)
        True
        """
        q, dq = finite_states(self.robot.model, "project_velocity", q=q, dq=dq)
        return self._nearest(q, dq, 0.0)

    @lazy.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_acceleration(self: Any, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Acceleration nearest in the kinetic metric that meets A q̈ + (dA/dt) dq = 0.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, joint velocities [rad/s, m/s]
        ddq : (nv,) array_like, joint accelerations [rad/s², m/s²]

        Returns
        -------
        ddq : (nv,) array [rad/s², m/s²]

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> bool(abs(held.constraint_jacobian(q) @ held.project_acceleration(q, [0, 0, 0], [1, 0, 0])).max() < 1e-12)
        True
        """
        q, dq, ddq = finite_states(self.robot.model, "project_acceleration", q=q, dq=dq, ddq=ddq)
        return self._nearest(q, ddq, self.constraint_bias(q, dq))

    def _nearest(self: Any, q: Array, v: Array, b: Array | float) -> Array:
        A, reach = reach_of(self, q)
        return reach.nearest(v, (A @ v[..., None])[..., 0] + b).astype(np.result_type(q, v), copy=False)

    def wrenches(self: Any, lam: ArrayLike) -> dict[str, Array]:
        """Constraint wrenches: λ as wrenches (m, f) that the robot applies where it is held.

        Parameters
        ----------
        lam : (k,) array_like, λ of :meth:`forward_dynamics` or :meth:`inverse_dynamics` [N m, N]

        Returns
        -------
        wrenches : {name of the constraint: (6,) array} [N m, N]

        Raises
        ------
        ShapeError
            ``lam`` has not a number for each row.

        Notes
        -----
        A closure's is what {b} applies to {a}, at the origin of {b}, along the axes of {c}.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> q = held.consistent([-0.6, 0.2, 2.2])
        >>> {name: F.round(12).tolist() for name, F in held.wrenches([10.0, 0.0]).items()}
        {'ground–tip': [0.0, 0.0, 0.0, 10.0, 0.0, 0.0]}
        """
        lam = arguments.finite(lam, "lam", len(self.sizes))
        found, first = {}, 0
        for name, c in zip(names(self.constraints), self.constraints, strict=True):
            found[name] = np.zeros((*lam.shape[:-1], 6))
            found[name][..., list(c.rows)] = lam[..., first : first + len(c.rows)]
            first += len(c.rows)
        return found


def reach_of(closed: ClosedRobot, q: Array) -> tuple[Array, Reach]:
    """A at q, and what it reaches through the mass matrix."""
    A = closed.constraint_jacobian(q)
    return A, Reach.of(A, closed.robot.mass_matrix(q), closed.sizes, len(closed.independent))
