"""What matrices of long robots are products of, one vector for each velocity of each joint, all seen from the base.

    M_ji = S_j·(G S_i),
    ∂τ_i/∂q_j = P_j·(B' S_i) + Q_j·(G S_i),         ∂τ_j/∂q_i = S_j·(2B P_i + G Q_i - [S_i, ·]'F)     for j before i,

and so on: the equations of :mod:`.mass_matrix` and :mod:`.derivatives`, in which a wrench travels to the base joint by joint.
From the base nothing has to travel, so that an entry is one dot product; what is far from the base loses some digits by it,
about as many as it is body lengths away. B' S is a pure couple wherever it is seen from.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..lie.adjoint import Ad, ad
from ..model.model import Model
from ..typing import Array
from .armature import armature_symbols
from .derivatives import carried, turns
from .energy import body_velocities
from .inverse_dynamics import Wrenches
from .mass_matrix import composite_inertias
from .recursion import ancestors, base_poses, joint_poses, zeros
from .springs import spring_stiffness


class Relations(NamedTuple):
    """How the velocities of joints relate."""

    carries: Array
    """(nv, nv) of bool: the row's joint carries the column's, or is the same."""
    bodies: Array
    """(nv,): whose they are."""


def applies(model: Model) -> bool:
    """Whether every velocity is one joint's own, and nothing but the bodies makes the matrices depend on dq."""
    return not any(body.follows for body in model.bodies) and not any(True for _ in armature_symbols(model))


def relations(model: Model) -> Relations:
    """Which joint carries which."""
    bodies = np.zeros(model.nv, int)
    for k, body in enumerate(model.bodies):
        bodies[body.places[1]] = k
    carried_by = [set(ancestors(model, k)) for k in range(len(model.bodies))]
    carries = [[int(r) in carried_by[int(c)] for c in bodies] for r in bodies]
    return Relations(np.array(carries, bool).reshape(model.nv, model.nv), bodies)


def mass_matrix_factors(model: Model, q: Array) -> tuple[Array, ...]:
    """S (nv, 6), G S (6, nv), G S (nv, 6), S (6, nv)."""
    T = joint_poses(model, q)
    S, GS = zeros(model.nv, 6), zeros(model.nv, 6)
    for body, X, G in zip(model.bodies, base_poses(model, T), composite_inertias(model, q), strict=True):
        for k, axis in enumerate(body.joint.axes, start=body.v_index):
            S[k], GS[k] = Ad(X) @ axis, Ad(X).inverse.T @ (G @ axis)
    return S, GS.T, GS, S.T


def constant_mass(model: Model) -> Array:
    """What M has besides; (nv, nv)."""
    return np.diag(model.armature)


def derivative_factors(
    model: Model, q: Array, dq: Array, ddq: Array, wrenches: Wrenches | None = None
) -> tuple[Array, ...]:
    """S (nv, 6), and by q and by dq what it goes with, (6, nv); (B' S, G S) (nv, 9), and what that goes with, (9, nv)."""
    T = joint_poses(model, q)
    V, G = body_velocities(model, T, dq), composite_inertias(model, q)
    B, F, columns = carried(model, T, V, dq, ddq, wrenches)
    own, moved, faster = zeros(model.nv, 6), zeros(model.nv, 6), zeros(model.nv, 6)
    left, by_q, by_dq = zeros(model.nv, 9), zeros(model.nv, 9), zeros(model.nv, 9)
    for i, (body, X) in enumerate(zip(model.bodies, base_poses(model, T), strict=True)):
        seen, felt = Ad(X), Ad(X).inverse.T
        for k, c in enumerate(columns[i], start=body.v_index):
            own[k] = seen @ c.S
            left[k] = np.concatenate([X[:3, :3] @ B[i].transposed_times(c.S)[:3], felt @ (G[i] @ c.S)])
            by_dq[k] = np.concatenate([own[k, :3], seen @ c.R])
            faster[k] = felt @ (B[i] @ c.S + G[i] @ c.R)
            if turns(body):
                by_q[k] = np.concatenate([X[:3, :3] @ c.P[:3], seen @ c.Q])
                moved[k] = felt @ (B[i] @ c.P + G[i] @ c.Q - ad(c.S).T @ F[i])
    return own, moved.T, faster.T, left, by_q.T, by_dq.T


def constant_stiffness(model: Model) -> Array:
    """What ∂τ/∂q has besides; (nv, nv)."""
    return np.asarray(zeros(model.nv, model.nv) + spring_stiffness(model), float)
