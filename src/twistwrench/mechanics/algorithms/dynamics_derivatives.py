"""Derivatives of inverse and forward dynamics by recursion: analytic, exact to rounding."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.typing import Array
from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Body, Model
from .coriolis_matrix import BodyCoriolis
from .energies import body_velocities
from .inverse_dynamics import Wrenches, applied_wrenches, bias_forces, body_motions, inertial_wrench
from .mass_matrix import composite_inertias, inverse_factor, ldl_factors, mass_matrix, solve_ldl, symmetric_product
from .recursion import add_entry, ancestors, armature_symbols, inward, joint_poses, spread, spring_stiffness, zeros

# Coordinate j moves all bodies it carries along S_j. Let λ be the parent of j's body. In frames that move along, body k has
#
#     (1)  P_j = [V_λ, S_j]                                 ∂V_k/∂q_j = P_j
#     (2)  Q_j = [dV_λ, S_j] + [V_λ, P_j]                   ∂dV_k/∂q_j = Q_j - [V_k, P_j]
#     (3)  R_j = P_j + [V_j, S_j]
#
# where all vectors are expressed in body k. The bracket with V_k is combined with the velocity products: both together give
# 2 B P_j. B is the operator of the Coriolis matrix and adds up over bodies like the inertia G. With the sums G, B and F of all
# bodies that i carries, for j before i, or j = i in (4) and (6),
#
#     (4)  ∂τ_i/∂q_j = P_j·(2B)'S_i + Q_j·G S_i             (5)  ∂τ_j/∂q_i = S_j·(2B P_i + G Q_i - [S_i, ·]'F)
#     (6)  ∂τ_i/∂dq_j = S_j·(2B)'S_i + R_j·G S_i            (7)  ∂τ_j/∂dq_i = S_j·(2B S_i + G R_i)
#
# Four wrenches of each joint propagate to the base. Derivatives by q are along robot.add, also for planar and floating joints.
# Sources: Carpentier and Mansard, RSS 2018; Singh, Russell and Wensing, IEEE RA-L 7(2), 2022.


class _Column(NamedTuple):
    """One velocity of one joint: its axis S, and P, Q, R of (1) to (3), (6,) each in the body's frame."""

    S: Array
    P: Array
    Q: Array
    R: Array


def inverse_dynamics_derivatives(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array]:
    """∂τ/∂q and ∂τ/∂dq; (nv, nv) each. ∂τ/∂ddq is M."""
    T = joint_poses(model, q)
    V = body_velocities(model, T, dq)
    G = composite_inertias(model, q)
    twice_B, F, columns = composite_terms(model, T, V, dq, ddq, wrenches)
    to_parent = [Ad(pose).inverse.T for pose in T]
    by_q = zeros(model.nv, model.nv) + spring_stiffness(model)
    by_dq = zeros(model.nv, model.nv)
    for i, body in enumerate(model.bodies):
        for k, column_i in enumerate(columns[i]):
            GS = G[i] @ column_i.S
            BS = twice_B[i].transposed_times(column_i.S)  # (2B)'S
            for j in ancestors(model, i):  # i itself first
                ancestor = model.bodies[j]
                for m, column_j in enumerate(columns[j]):
                    if changes_dynamics(ancestor):
                        add_entry(by_q, body, k, ancestor, m, column_j.P @ BS + column_j.Q @ GS)  # (4)
                    add_entry(by_dq, body, k, ancestor, m, column_j.S @ BS + column_j.R @ GS)  # (6)
                GS = to_parent[j] @ GS
                BS = to_parent[j] @ BS
            if changes_dynamics(body):
                F_by_q = twice_B[i] @ column_i.P + G[i] @ column_i.Q - ad(column_i.S).T @ F[i]
                _add_to_ancestors(by_q, model, columns, to_parent, i, k, F_by_q)  # (5)
            F_by_dq = twice_B[i] @ column_i.S + G[i] @ column_i.R
            _add_to_ancestors(by_dq, model, columns, to_parent, i, k, F_by_dq)  # (7)
    for block, L in armature_symbols(model):  # L (n, n, n): the armature's torques are dq' L dq
        by_dq[block, block] = by_dq[block, block] + (L + L.swapaxes(1, 2)) @ dq[block]
    return by_q, by_dq


def composite_terms(
    model: Model, T: list[Array], V: list[Array], dq: Array, ddq: Array, wrenches: Wrenches | None
) -> tuple[list[BodyCoriolis], list[Array], list[list[_Column]]]:
    """2 B and F summed over all bodies that each body carries, and the columns of its joint."""
    twice_B = [BodyCoriolis.from_twist(body.inertia, 2.0 * V[i]) for i, body in enumerate(model.bodies)]
    columns: list[list[_Column]] = []
    Adq = spread(model, dq)
    Addq = spread(model, ddq)
    F: list[Array] = []
    for i, motion in body_motions(model, T, dq, ddq):
        body = model.bodies[i]
        F.append(inertial_wrench(body.inertia, motion))
        V_parent = V[i] - Adq[i]
        w, v = V[i][:3], V[i][3:]
        dV = np.concatenate([motion.dw, motion.a - so3.cross(w, v)])  # a = dv + w × v: acceleration of the origin
        dV_parent = dV - Addq[i] - ad(V_parent) @ Adq[i]  # dV = dV_parent + S q̈ + [V_parent, S dq]
        joint_columns = []
        for S in body.joint.axes:
            P = ad(V_parent) @ S  # (1)
            Q = ad(dV_parent) @ S + ad(V_parent) @ P  # (2)
            R = P + ad(V[i]) @ S  # (3)
            joint_columns.append(_Column(S, P, Q, R))
        columns.append(joint_columns)
    for i, F_by in applied_wrenches(model, wrenches):
        F[i] = F[i] + F_by
    for i, p in inward(model):
        if p != BASE:
            twice_B[p] = twice_B[p] + twice_B[i].in_frame(T[i])
            F[p] = F[p] + Ad(T[i]).inverse.T @ F[i]
    return twice_B, F, columns


def _add_to_ancestors(
    matrix: Array, model: Model, columns: list[list[_Column]], to_parent: list[Ad], i: int, k: int, F: Array
) -> None:
    """Add the torques of a wrench F on body i at the joints before i, in the column of velocity k of i's joint."""
    F = to_parent[i] @ F
    for j in ancestors(model, i):
        if j == i:
            continue
        for m, column in enumerate(columns[j]):
            add_entry(matrix, model.bodies[j], m, model.bodies[i], k, column.S @ F)
        F = to_parent[j] @ F


def changes_dynamics(body: Body) -> bool:
    """True if the joint's coordinate changes the dynamics; the coordinate of a body of revolution does not."""
    return body.joint.moves_body


def forward_dynamics_derivatives(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array, Array]:
    """∂ddq/∂q, ∂ddq/∂dq and ∂ddq/∂τ = M⁻¹; (nv, nv) each. From M ∂ddq/∂x = -∂τ/∂x at the ddq that τ produces."""
    tau_by_q, tau_by_dq, M_inverse, W, D = torque_derivatives_and_factors(model, q, dq, tau, wrenches)
    return accelerations(W, D, tau_by_q), accelerations(W, D, tau_by_dq), M_inverse


def torque_derivatives_and_factors(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None
) -> tuple[Array, Array, Array, Array, Array]:
    """∂τ/∂q and ∂τ/∂dq at the ddq that τ produces, M⁻¹, and the factors W (nv, nv) and D (nv,) of M⁻¹ = W D W'."""
    L, D = ldl_factors(mass_matrix(model, q))
    ddq = solve_ldl(L, D, tau - bias_forces(model, q, dq, wrenches))
    by_q, by_dq = inverse_dynamics_derivatives(model, q, dq, ddq, wrenches)
    W = inverse_factor(L)  # keeps the zeros between branches, unlike M⁻¹
    return by_q, by_dq, symmetric_product(W, D), W, D


def accelerations(W: Array, D: Array, X: Array) -> Array:
    """-M⁻¹ X = -W D W' X for one column (nv,) or several (nv, m): ∂ddq/∂x from X = ∂τ/∂x."""
    return -(W @ (D * (W.T @ X).T).T)  # transposed, so that D (nv,) scales the rows of one column and of several
