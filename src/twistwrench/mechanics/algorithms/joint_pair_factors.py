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
# and so on: the equations of :mod:`.mass_matrix` and :mod:`.dynamics_derivatives`, which transform a wrench to the base joint
# by joint. In base coordinates no transformation is needed, so that an entry is one dot product. Bodies far from the base lose
# digits, about as many as their distance in body lengths. B' S is a pure couple in every frame.


class Relations(NamedTuple):
    """Relations between the velocities of joints."""

    carries: Array
    """(nv, nv) of bool: the row's joint carries the column's joint, or is the same."""
    bodies: Array
    """(nv,) index of the body of each velocity."""


def joints_are_independent(model: Model) -> bool:
    """True if joints share neither velocities nor motors, and no armature has velocity products: only bodies depend on dq."""
    shared = model.couplings or any(body.follows for body in model.bodies)
    return not shared and not any(True for _ in armature_symbols(model))


def relations(model: Model) -> Relations:
    """Table of which joints carry which."""
    bodies = np.zeros(model.nv, int)
    for k, body in enumerate(model.bodies):
        bodies[body.places[1]] = k
    carries = np.zeros((model.nv, model.nv), bool)
    for column, body in enumerate(bodies):
        carries[:, column] = np.isin(bodies, list(ancestors(model, int(body))))
    return Relations(carries, bodies)


def mass_matrix_factors(model: Model, q: Array) -> tuple[Array, ...]:
    """S (nv, 6), G S (6, nv), G S (nv, 6), S (6, nv).

    M_ji is row j of the first times column i of the second if j is before i; else the same of the third and the last.
    """
    T = joint_poses(model, q)
    S, GS = zeros(model.nv, 6), zeros(model.nv, 6)
    for body, X, G in zip(model.bodies, base_poses(model, T), composite_inertias(model, q), strict=True):
        for k, axis in enumerate(body.joint.axes, start=body.v_index):
            S[k], GS[k] = Ad(X) @ axis, Ad(X).inverse.T @ (G @ axis)
    return S, GS.T, GS, S.T


def constant_mass(model: Model) -> Array:
    """Constant part of M: the armature; (nv, nv)."""
    return np.diag(model.armature)


def derivative_factors(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, ...]:
    """S (nv, 6) and its factors by q and by dq, (6, nv); (B' S, G S) (nv, 9) and its factor, (9, nv)."""
    T = joint_poses(model, q)
    V, G = body_velocities(model, T, dq), composite_inertias(model, q)
    twice_B, F, columns = composite_terms(model, T, V, dq, ddq, wrenches)
    axes, by_position, by_velocity = zeros(model.nv, 6), zeros(model.nv, 6), zeros(model.nv, 6)
    left_factor, by_q, by_dq = zeros(model.nv, 9), zeros(model.nv, 9), zeros(model.nv, 9)
    for i, (body, X) in enumerate(zip(model.bodies, base_poses(model, T), strict=True)):
        R, to_base, wrench_to_base = X[:3, :3], Ad(X), Ad(X).inverse.T
        for k, c in enumerate(columns[i], start=body.v_index):
            axes[k] = to_base @ c.S
            couple = twice_B[i].transposed_times(c.S)[:3]
            left_factor[k] = np.concatenate([R @ couple, wrench_to_base @ (G[i] @ c.S)])
            by_dq[k] = np.concatenate([axes[k, :3], to_base @ c.R])
            by_velocity[k] = wrench_to_base @ (twice_B[i] @ c.S + G[i] @ c.R)
            if changes_dynamics(body):
                by_q[k] = np.concatenate([R @ c.P[:3], to_base @ c.Q])
                by_position[k] = wrench_to_base @ (twice_B[i] @ c.P + G[i] @ c.Q - ad(c.S).T @ F[i])
    return axes, by_position.T, by_velocity.T, left_factor, by_q.T, by_dq.T


def constant_stiffness(model: Model) -> Array:
    """Constant part of ∂τ/∂q: springs; (nv, nv)."""
    return np.asarray(zeros(model.nv, model.nv) + spring_stiffness(model), float)
