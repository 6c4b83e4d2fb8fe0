"""Linearised dynamics: how small deviations of a state grow, for linear controllers. Modern Robotics section 8.5."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..typing import Array


class LinearizationMethods:
    """The method of a robot that linearises its dynamics."""

    def linearize(self: Any, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> tuple[Array, Array]:
        """State-space matrices A and B of small deviations from a state: dx/dt = A x + B u, x = (δ, δdq), u = δτ.

        Parameters
        ----------
        q : (nq,) array_like, configuration
        dq : (nv,) array_like, velocities
        tau : (nv,) array_like, torques

        Returns
        -------
        A : (2 nv, 2 nv) array
        B : (2 nv, nv) array

        Raises
        ------
        ShapeError
            The last axes are not the robot's sizes, or batch shapes do not broadcast.
        SingularMassMatrixError
            As for :meth:`forward_dynamics`.

        Notes
        -----
        δ are deviations along :meth:`add`, ``q ⊕ δ``, so there are nv of them on quaternions too; ``subtract`` measures
        them. With T = T₀ exp([δ]) a joint's twist is V = Ad(exp(-[δ])) V₀ + dδ/dt + …, hence to first order

            dδ/dt   = δdq - ad(dq) δ        (0 but for joints that turn and slide at once, or turn in space)
            dδdq/dt = ∂ddq/∂q δ + ∂ddq/∂dq δdq + ∂ddq/∂τ δτ.

        Deviations are of the motion through the state; it is an equilibrium where dq = 0 and τ holds it. Friction is not
        included.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> pendulum = tw.robots.pendulum()
        >>> A, B = pendulum.linearize([np.pi], [0.0], [0.0])
        >>> A.round(9).tolist(), B.round(9).tolist()
        ([[0.0, 1.0], [9.81, 0.0]], [[0.0], [1.0]])
        """
        by_q, by_dq, by_tau = self.forward_dynamics_derivatives(q, dq, tau)
        n, batch = self.nv, by_q.shape[:-2]
        A, B = np.zeros((*batch, 2 * n, 2 * n)), np.zeros((*batch, 2 * n, n))
        from ..algorithms.coordinate_rates import brackets

        A[..., :n, :n] = np.einsum("bad,...a->...db", brackets(self.model), np.asarray(dq, float))
        A[..., :n, n:] = np.eye(n)
        A[..., n:, :n], A[..., n:, n:], B[..., n:, :] = by_q, by_dq, by_tau
        return A, B
