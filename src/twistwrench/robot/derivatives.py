"""Derivatives of quantities as methods, and linearised dynamics. Modern Robotics section 8.5."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Generic

import numpy as np
from numpy.typing import ArrayLike

from ..core.glossary import complete
from ..core.typing import Array
from .arguments import Kind, Wrenches
from .base import RobotBase, Slopes


class DerivativeMethods(RobotBase, Generic[Slopes]):
    """Derivatives of a robot's dynamics and kinematics."""

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> Slopes:
        """Derivatives of inverse dynamics, ∂τ/∂q and ∂τ/∂dq; ∂τ/∂ddq is M.

        Wrenches have constant components in their frames, which move with the links. Friction is excluded. With
        constraints, these are derivatives of the motor torques by the motors' q, dq and ddq. The other joints then follow, so
        that the motion satisfies the constraints.

        Parameters
        ----------
        actuated : iterable of str, joints with a motor, for a robot with constraints
            Their number of velocities m equals the degrees of freedom.
        out : pair of arrays, optional, takes the results

        Returns
        -------
        tau_by_q : (nv, nv) array, ∂τ/∂q, columns along :meth:`add`
        tau_by_dq : (nv, nv) array, ∂τ/∂dq
            With constraints ConstrainedDerivatives: ``tau_by_q``, ``tau_by_dq`` and ``tau_by_ddq`` (m, m), in the order
            of the robot's velocities; ``tau_by_ddq`` is the mass matrix reduced to the motors.

        Raises
        ------
        ConstraintError
            q, dq or ddq violates the constraints; the number of velocities of the named joints differs from the degrees
            of freedom; or these joints do not determine the others at q.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> by_q, by_dq = tw.robots.planar_2r().inverse_dynamics_derivatives([np.pi / 2, 0], [0, 0], [0, 0])
        >>> np.round(by_q, 2).tolist()
        [[-29.43, -9.81], [-9.81, -9.81]]
        """
        options = {} if actuated is None else {"actuated": self._motors(actuated)}
        arrays = q, dq, ddq
        return self._with_wrenches(
            "inverse_dynamics_derivatives", arrays, wrench_by_robot, wrench_on_robot, out, **options
        )

    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array, Array]:
        """Derivatives of forward dynamics, ∂ddq/∂q, ∂ddq/∂dq and ∂ddq/∂τ = M⁻¹.

        Wrenches have constant components in their frames, which move with the links. Friction is excluded.

        Parameters
        ----------
        out : triple of arrays, optional, takes the results

        Returns
        -------
        ddq_by_q : (nv, nv) array, ∂ddq/∂q, columns along :meth:`add`
        ddq_by_dq : (nv, nv) array, ∂ddq/∂dq
        ddq_by_tau : (nv, nv) array, M⁻¹

        Raises
        ------
        SingularMassMatrixError
            A joint moves no inertia, so that M has no inverse.
        """
        arrays = q, dq, tau
        return self._with_wrenches("forward_dynamics_derivatives", arrays, wrench_by_robot, wrench_on_robot, out)

    def inverse_dynamics_gradient(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array, Array]:
        """Gradient of a weighted sum of torques, ∂(w·τ)/∂(q, dq, ddq), by reverse mode.

        Cost: a few evaluations of τ.

        Parameters
        ----------
        out : triple of arrays, optional, takes the results

        Returns
        -------
        by_q : (nv,) array, ∂(w·τ)/∂q along :meth:`add`
        by_dq : (nv,) array, ∂(w·τ)/∂dq
        by_ddq : (nv,) array, ∂(w·τ)/∂ddq = M w

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> by_q, by_dq, by_ddq = tw.robots.planar_2r().inverse_dynamics_gradient([np.pi / 2, 0], [0, 0], [0, 0], [1, 1])
        >>> by_q.round(2).tolist()
        [-39.24, -19.62]
        """
        options = {"by": ("q", "dq", "ddq"), "form": "weighted"}
        arrays = (q, dq, ddq, weights)
        return self._with_wrenches("inverse_dynamics", arrays, wrench_by_robot, wrench_on_robot, out, **options)

    def inverse_dynamics_hessian_product(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        along_q: ArrayLike,
        along_dq: ArrayLike,
        along_ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array, Array]:
        """Hessian of a weighted sum of torques, ∂²(w·τ)/∂(q, dq, ddq)², times a direction.

        It is the Hessian of (u, a, b) ↦ w·τ(q ⊕ u, dq + a, ddq + b) at 0, with ⊕ for :meth:`add`, and always symmetric.

        Parameters
        ----------
        along_q, along_dq, along_ddq : (nv,) array_like, parts of the direction
        out : triple of arrays, optional, takes the results

        Returns
        -------
        by_q, by_dq, by_ddq : (nv,) array, parts of the product

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, zero = tw.robots.planar_2r(), [0, 0]
        >>> by_q, by_dq, by_ddq = arm.inverse_dynamics_hessian_product(zero, zero, zero, [1, 0], [1, 0], zero, zero)
        >>> by_q.round(2).tolist()
        [-29.43, -9.81]
        """
        options = {"by": ("q", "dq", "ddq"), "form": "hessian_along"}
        arrays = (q, dq, ddq, weights, along_q, along_dq, along_ddq)
        return self._with_wrenches("inverse_dynamics", arrays, wrench_by_robot, wrench_on_robot, out, **options)

    def jacobian_derivative(
        self, q: ArrayLike, frame: str | None = None, kind: Kind = "body", *, out: Any = None
    ) -> Array:
        """Derivative of the Jacobian by the configuration, ∂J/∂q; its product with dq is dJ/dt.

        Returns
        -------
        J_by_q : (6, nv, nv) array, derivative of :meth:`jacobian`, last axis along :meth:`add`
        """
        return self._call("jacobian_derivative", q, frame=frame, kind=kind, out=out)

    def mass_matrix_derivative(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Derivative of the mass matrix by the configuration, ∂M/∂q; its product with dq is dM/dt.

        Returns
        -------
        M_by_q : (nv, nv, nv) array, last axis along :meth:`add`
        """
        return self._call("mass_matrix", q, by="q", out=out)

    # ── linearised dynamics ──

    def linearize(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> tuple[Array, Array]:
        """State-space matrices A and B of small deviations from a state: dx/dt = A x + B u, x = (δ, δdq), u = δτ.

        Returns
        -------
        A : (2 nv, 2 nv) array
        B : (2 nv, nv) array

        Notes
        -----
        δ are deviations along :meth:`add`, ``q ⊕ δ``, so there are nv of them even with quaternions; ``subtract``
        computes them. With T = T₀ exp([δ]), a joint's twist is V = Ad(exp(-[δ])) V₀ + dδ/dt + …. To first order,

            dδ/dt   = δdq - ad(dq) δ
            dδdq/dt = ∂ddq/∂q δ + ∂ddq/∂dq δdq + ∂ddq/∂τ δτ.

        ad(dq) δ differs from 0 only for joints that turn and slide together, or turn in space. Deviations are from the motion
        through the state, an equilibrium if dq = 0 and τ holds it. Friction is excluded.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> pendulum = tw.robots.pendulum()
        >>> A, B = pendulum.linearize([np.pi], [0.0], [0.0])
        >>> A.round(9).tolist(), B.round(9).tolist()
        ([[0.0, 1.0], [9.81, 0.0]], [[0.0], [1.0]])
        """
        from ..mechanics.algorithms.kinematics import brackets

        ddq_by_q, ddq_by_dq, ddq_by_tau = self.forward_dynamics_derivatives(q, dq, tau)
        n = self.nv
        batch_shape = ddq_by_q.shape[:-2]
        # brackets(model) has c_bad of [S_b, S_a]. As [S_b, S_a] = -[S_a, S_b], the sum over a of c_bad dq_a is -ad(dq).
        minus_ad_dq = np.einsum("bad,...a->...db", brackets(self.model), np.asarray(dq, float))
        A = np.zeros((*batch_shape, 2 * n, 2 * n))
        A[..., :n, :n] = minus_ad_dq
        A[..., :n, n:] = np.eye(n)
        A[..., n:, :n] = ddq_by_q
        A[..., n:, n:] = ddq_by_dq
        B = np.zeros((*batch_shape, 2 * n, n))
        B[..., n:, :] = ddq_by_tau
        return A, B


complete(globals())
