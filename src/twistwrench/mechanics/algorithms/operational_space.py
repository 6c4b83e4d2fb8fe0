"""Operational-space dynamics, F = Λ dV + η (MR section 8.6), and joint control laws (MR section 11.4).

With Y = L⁻ᵀJ' and M = L'DL, J M⁻¹ J' = Y'D⁻¹Y = R'ER. M is factored once, and the zeros between branches stay zeros. The pivots
E of J M⁻¹ J' are returned too. Each is the squared part of a row that is independent of the later rows; a value near zero
marks a direction in which the hand cannot move. In the code ``D_inverse`` and ``E_inverse`` stand for D⁻¹ and E⁻¹.
"""

from __future__ import annotations

import numpy as np

from ...core.typing import Array
from ..model.model import Model
from .forward_dynamics import articulated_pays
from .inverse_dynamics import bias_forces, inverse_dynamics
from .kinematics import jacobian, jacobian_rate
from .mass_matrix import ldl_factors, mass_matrix, solve_ldl, solve_transposed
from .recursion import zeros


def task_inertia(model: Model, q: Array, frame: str, kind: str, rows: tuple[int, ...]) -> tuple[Array, Array]:
    """Λ = (J M⁻¹ J')⁻¹ (r, r) and the pivots (r,) of J M⁻¹ J', for r rows of J. MR section 8.6, also for non-square J."""
    L, D_inverse = ldl_factors(mass_matrix(model, q))
    J = jacobian(model, q, frame, kind)[list(rows)]
    Y = solve_transposed(L, J.T)
    R, E_inverse = ldl_factors(Y.T @ (D_inverse[:, None] * Y))
    Lambda = zeros(len(rows), len(rows))
    unit_vectors = np.eye(len(rows)).astype(object)
    for k, unit_vector in enumerate(unit_vectors):
        Lambda[:, k] = solve_ldl(R, E_inverse, unit_vector)
    below_diagonal = np.tril_indices(len(rows), -1)
    Lambda.T[below_diagonal] = Lambda[below_diagonal]  # symmetric to the last bit
    return Lambda, 1.0 / E_inverse


def task_bias(model: Model, q: Array, dq: Array, frame: str, kind: str, rows: tuple[int, ...]) -> tuple[Array, Array]:
    """η = Λ (J M⁻¹ h - (dJ/dt) dq) (r,) and the pivots (r,) of J M⁻¹ J', for r rows of J. MR section 8.6."""
    L, D_inverse = ldl_factors(mass_matrix(model, q))
    J = jacobian(model, q, frame, kind)[list(rows)]
    Y = solve_transposed(L, J.T)
    R, E_inverse = ldl_factors(Y.T @ (D_inverse[:, None] * Y))
    z = D_inverse * solve_transposed(L, bias_forces(model, q, dq))  # D⁻¹L⁻ᵀh
    J_M_inverse_h = Y.T @ z
    dJ = jacobian_rate(model, q, dq, frame, kind)[list(rows)]
    return solve_ldl(R, E_inverse, J_M_inverse_h - dJ @ dq), 1.0 / E_inverse


# ── Control laws of joints. Modern Robotics section 11.4


def multi_dof_joints(model: Model) -> tuple[str, ...]:
    """Joints of several degrees of freedom (ball, planar, floating), which single-joint control laws do not drive."""
    return tuple(body.joint.name for body in model.leaders if body.joint.nv > 1)


def clip_torques(tau: Array, limits: Array) -> Array:
    """Torques clipped to their limits; (nv,). For symbols; a plain number is the 0 of a joint without control law."""
    clipped = []
    for torque, limit in zip(tau, limits, strict=True):
        clipped.append(torque.clip(-limit, limit) if hasattr(torque, "clip") else torque)
    return np.array(clipped, object)


def proportional_derivative(
    model: Model, q: Array, dq: Array, q_des: Array, dq_des: Array, kp: Array, kd: Array
) -> Array:
    """Kp e + Kd ė for every joint of one degree of freedom, 0 for others; (nv,). MR section 11.4."""
    u = zeros(model.nv)
    for body in model.leaders:
        if body.joint.nv == 1:
            k = body.v_index
            error = q_des[body.q_index] - q[body.q_index]
            error_rate = dq_des[k] - dq[k]
            u[k] = kp[k] * error + kd[k] * error_rate
    return u


def computed_torque(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """τ = M q̈ + h for the desired acceleration; (nv,). MR eq. 11.35.

    If forward dynamics uses M, this reuses its M and h.
    """
    if articulated_pays(model):
        return inverse_dynamics(model, q, dq, ddq)
    return mass_matrix(model, q) @ ddq + bias_forces(model, q, dq)
