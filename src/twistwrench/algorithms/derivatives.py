"""Derivatives of the dynamics, by recursion: ∂τ/∂(q, dq) and ∂ddq/∂(q, dq, τ). Analytic, exact to round-off.

Turning coordinate j moves all it carries by S_j. In frames that move along, body k then has (λ the parent of j's body)

    (1)  P_j = [V_λ, S_j]                                 ∂V_k/∂q_j = P_j
    (2)  Q_j = [dV_λ, S_j] + [V_λ, P_j]                   ∂dV_k/∂q_j = Q_j - [V_k, P_j]
    (3)  R_j = P_j + [V_j, S_j]

with everything seen from body k. The bracket with V_k goes to the velocity products, which together are 2 B P_j, where B is
the operator of the Coriolis matrix: it adds up over bodies as the inertia G does. So with G, B and F of all that i carries,
for j before i, or j = i in (4) and (6),

    (4)  ∂τ_i/∂q_j = P_j·(2B)'S_i + Q_j·G S_i             (5)  ∂τ_j/∂q_i = S_j·(2B P_i + G Q_i - [S_i, ·]'F)
    (6)  ∂τ_i/∂dq_j = S_j·(2B)'S_i + R_j·G S_i            (7)  ∂τ_j/∂dq_i = S_j·(2B S_i + G R_i)

Four wrenches of each joint travel to the base. Derivatives by q are along robot.add, on planar and floating joints too.
Sources: Carpentier and Mansard, RSS 2018; Singh, Russell and Wensing, IEEE RA-L 7(2), 2022.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Body, Model
from ..typing import Array
from .inverse_dynamics import Wrenches, applied_wrenches, bias_forces, body_motions, inertial_wrench
from .mass_matrix import (
    BodyCoriolis,
    body_velocities,
    composite_inertias,
    factored,
    inverse_factor,
    mass_matrix,
    solved,
    symmetric_product,
)
from .recursion import add_entry, ancestors, armature_symbols, inward, joint_poses, spread, spring_stiffness, zeros


class _Column(NamedTuple):
    """One velocity of one joint, seen from its body: its axis, and (1) to (3)."""

    S: Array
    P: Array
    Q: Array
    R: Array


def inverse_dynamics_derivatives(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array]:
    """∂τ/∂q and ∂τ/∂dq; (nv, nv) each. ∂τ/∂ddq is M."""
    T = joint_poses(model, q)
    V, G = body_velocities(model, T, dq), composite_inertias(model, q)
    B, F, columns = carried(model, T, V, dq, ddq, wrenches)
    up = [Ad(X).inverse.T for X in T]
    by_q, by_dq = zeros(model.nv, model.nv) + spring_stiffness(model), zeros(model.nv, model.nv)
    for i, body in enumerate(model.bodies):
        for b, c in enumerate(columns[i]):
            GS, BS = G[i] @ c.S, B[i].transposed_times(c.S)
            for j in ancestors(model, i):
                other = model.bodies[j]
                for a, d in enumerate(columns[j]):
                    if turns(other):
                        add_entry(by_q, body, b, other, a, d.P @ BS + d.Q @ GS)  # (4)
                    add_entry(by_dq, body, b, other, a, d.S @ BS + d.R @ GS)  # (6)
                GS, BS = up[j] @ GS, up[j] @ BS
            if turns(body):
                _add_felt(by_q, model, columns, up, i, b, B[i] @ c.P + G[i] @ c.Q - ad(c.S).T @ F[i])  # (5)
            _add_felt(by_dq, model, columns, up, i, b, B[i] @ c.S + G[i] @ c.R)  # (7)
    for mine, L in armature_symbols(model):
        by_dq[mine, mine] = by_dq[mine, mine] + (L + L.swapaxes(1, 2)) @ dq[mine]
    return by_q, by_dq


def carried(
    model: Model, T: list[Array], V: list[Array], dq: Array, ddq: Array, wrenches: Wrenches | None
) -> tuple[list[BodyCoriolis], list[Array], list[list[_Column]]]:
    """2 B and F of all that each body carries, and the columns of its joint."""
    B, columns = [BodyCoriolis.from_twist(body.inertia, 2.0 * V[i]) for i, body in enumerate(model.bodies)], []
    Adq, Addq = spread(model, dq), spread(model, ddq)
    F: list[Array] = []
    for i, motion in body_motions(model, T, dq, ddq):
        body = model.bodies[i]
        F.append(inertial_wrench(body.inertia, motion))
        V_up = V[i] - Adq[i]
        dV_up = np.concatenate([motion.dw, motion.a - so3.cross(V[i][:3], V[i][3:])]) - Addq[i] - ad(V_up) @ Adq[i]
        mine = []
        for S in body.joint.axes:
            P = ad(V_up) @ S  # (1)
            mine.append(_Column(S, P, ad(dV_up) @ S + ad(V_up) @ P, P + ad(V[i]) @ S))  # (2), (3)
        columns.append(mine)
    for i, F_by in applied_wrenches(model, wrenches):
        F[i] = F[i] + F_by
    for i, p in inward(model):
        if p != BASE:
            B[p], F[p] = B[p] + B[i].in_frame(T[i]), F[p] + Ad(T[i]).inverse.T @ F[i]
    return B, F, columns


def _add_felt(
    matrix: Array, model: Model, columns: list[list[_Column]], up: list[Ad], i: int, b: int, F: Array
) -> None:
    """Add the effect of a wrench on body i on the joints before it: their rows of its column."""
    F = up[i] @ F
    for j in ancestors(model, i):
        if j == i:
            continue
        for a, d in enumerate(columns[j]):
            add_entry(matrix, model.bodies[j], a, model.bodies[i], b, d.S @ F)
        F = up[j] @ F


def turns(body: Body) -> bool:
    """True if the joint's coordinate changes the mechanics; that of a body of revolution does not."""
    return body.joint.moves_body


def forward_dynamics_derivatives(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array, Array]:
    """∂ddq/∂q, ∂ddq/∂dq and ∂ddq/∂τ = M⁻¹; (nv, nv) each. By  M ∂ddq/∂x = -∂τ/∂x  at the ddq that τ gives."""
    by_q, by_dq, inverse, W, D = torque_derivatives_and_factors(model, q, dq, tau, wrenches)
    return accelerations(W, D, by_q), accelerations(W, D, by_dq), inverse


def torque_derivatives_and_factors(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array, Array, Array, Array]:
    """∂τ/∂q and ∂τ/∂dq at the ddq that τ gives, M⁻¹, and its factors W (nv, nv) and D (nv,): M⁻¹ = W D W'."""
    L, D = factored(mass_matrix(model, q))
    ddq = solved(L, D, tau - bias_forces(model, q, dq, wrenches))
    by_q, by_dq = inverse_dynamics_derivatives(model, q, dq, ddq, wrenches)
    W = inverse_factor(L)  # keeps the zeros between branches, which M⁻¹ does not
    return by_q, by_dq, symmetric_product(W, D), W, D


def accelerations(W: Array, D: Array, X: Array) -> Array:
    """-M⁻¹ X, of one column (nv,) or several (nv, m)."""
    return -(W @ (D * (W.T @ X).T).T)
