"""Factors of the matrices of long robots: one vector per joint velocity, in base coordinates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.typing import Array
from ..lie.adjoint import Ad, ad
from ..model.model import Model
from .dynamics_derivatives import changes_dynamics, composite_terms
from .energies import body_velocities
from .inverse_dynamics import Wrenches
from .mass_matrix import composite_inertias
from .recursion import ancestors, armature_symbols, base_poses, joint_poses, spring_stiffness, zeros

# M_ji = S_j·(G S_i),
#     ∂τ_i/∂q_j = P_j·((2B)' S_i) + Q_j·(G S_i),      ∂τ_j/∂q_i = S_j·(2B P_i + G Q_i - [S_i, ·]'F)     for j before i,
#
# and likewise for the other entries. These are the equations of :mod:`.mass_matrix` and :mod:`.dynamics_derivatives`, which
# transform a wrench to the base joint by joint. In base coordinates no transformation is needed, so that an entry is one dot
# product. Bodies far from the base lose accuracy: by a factor of about their distance in body lengths. B' S is a pure couple in
# every frame, so that three numbers are enough for it.


class Relations(NamedTuple):
    """Relations between the velocities of joints."""

    carries: Array
    """(nv, nv) of bool: the row's joint carries the column's joint, or is the column's joint."""
    bodies: Array
    """(nv,) index of the body of each velocity."""


def joints_are_independent(model: Model) -> bool:
    """True if joints share neither velocities nor motors, and no armature has velocity products: only bodies depend on dq."""
    if model.couplings or any(body.follows for body in model.bodies):
        return False
    has_velocity_products = any(True for _ in armature_symbols(model))
    return not has_velocity_products


def relations(model: Model) -> Relations:
    """Table of which joints carry which, and the body of each velocity."""
    body_of_velocity = np.zeros(model.nv, int)
    for i, body in enumerate(model.bodies):
        _, velocity_slice = body.places
        body_of_velocity[velocity_slice] = i
    carries = np.zeros((model.nv, model.nv), bool)
    for column, i in enumerate(body_of_velocity.tolist()):
        carries[:, column] = np.isin(body_of_velocity, list(ancestors(model, i)))
    return Relations(carries, body_of_velocity)


def mass_matrix_factors(model: Model, q: Array) -> tuple[Array, ...]:
    """Factors of M: S (nv, 6), G S (6, nv), G S (nv, 6), S (6, nv).

    M_ji is row j of the first matrix times column i of the second if j is before i, else row j of the third matrix times column
    i of the last.
    """
    S = zeros(model.nv, 6)
    GS = zeros(model.nv, 6)
    poses = base_poses(model, joint_poses(model, q))
    for body, T_s, G in zip(model.bodies, poses, composite_inertias(model, q), strict=True):
        for k, axis in enumerate(body.joint.axes, start=body.v_index):
            S[k] = Ad(T_s) @ axis
            GS[k] = Ad(T_s).inverse.T @ (G @ axis)
    return S, GS.T, GS, S.T


def constant_mass(model: Model) -> Array:
    """Constant part of M: the armature; (nv, nv)."""
    return np.diag(model.armature)


def derivative_factors(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, ...]:
    """Factors of ∂τ/∂q and ∂τ/∂dq: row j of a first factor times column i of a second one is the entry of joints j and i.

    For j before i, the first factor is S (nv, 6); the second factors by q and by dq are wrenches, (6, nv). For i before j, and
    for i = j, the first factor is (2B' S, G S) (nv, 9); the second factors by q and by dq are (P, Q) and (S, R), (9, nv). The
    six matrices are returned in this order.
    """
    T = joint_poses(model, q)
    V = body_velocities(model, T, dq)
    G = composite_inertias(model, q)
    twice_B, F, columns = composite_terms(model, T, V, dq, ddq, wrenches)
    axes = zeros(model.nv, 6)
    wrenches_by_q = zeros(model.nv, 6)
    wrenches_by_dq = zeros(model.nv, 6)
    momenta = zeros(model.nv, 9)
    motions_by_q = zeros(model.nv, 9)
    motions_by_dq = zeros(model.nv, 9)
    for i, (body, T_s) in enumerate(zip(model.bodies, base_poses(model, T), strict=True)):
        R = T_s[:3, :3]
        to_base = Ad(T_s)
        wrench_to_base = Ad(T_s).inverse.T
        for k, column in enumerate(columns[i], start=body.v_index):
            S, P, Q, R_column = column
            axes[k] = to_base @ S
            couple = twice_B[i].transposed_times(S)[:3]
            momenta[k] = np.concatenate([R @ couple, wrench_to_base @ (G[i] @ S)])
            motions_by_dq[k] = np.concatenate([axes[k, :3], to_base @ R_column])
            wrenches_by_dq[k] = wrench_to_base @ (twice_B[i] @ S + G[i] @ R_column)
            if changes_dynamics(body):
                motions_by_q[k] = np.concatenate([R @ P[:3], to_base @ Q])
                wrenches_by_q[k] = wrench_to_base @ (twice_B[i] @ P + G[i] @ Q - ad(S).T @ F[i])
    return axes, wrenches_by_q.T, wrenches_by_dq.T, momenta, motions_by_q.T, motions_by_dq.T


def constant_stiffness(model: Model) -> Array:
    """Constant part of ∂τ/∂q: springs; (nv, nv)."""
    return np.asarray(zeros(model.nv, model.nv) + spring_stiffness(model), float)
