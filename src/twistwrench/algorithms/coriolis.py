"""The Coriolis matrix and the Christoffel symbols. Modern Robotics section 8.1.2; Echeandia and Wensing, 2021.

For a body, let K = ∫ ẋ r' dm and p = ∫ ẋ dm, velocities ẋ and positions r of its points in the body's frame. Then

    B V' = ((tr K 1 - K) w', w' × p)

is the factor with  C = Σ J_i' (G_i dJ_i + B_i J_i),  C dq = c  and  dM/dt - 2C  skew. K and p add up like inertias.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Body, Model
from ..typing import Array
from .armature import armature_symbols
from .energy import body_velocities
from .mass_matrix import composite_inertias
from .recursion import ancestors, inward, joint_poses, zeros


class BodyCoriolis:
    """The operator B of one body or of several joined, by its K (3, 3) and p (3,)."""

    def __init__(self, K: Array, p: Array) -> None:
        self.K, self.p = K, p

    @classmethod
    def of(cls, G: SpatialInertia, V: Array) -> BodyCoriolis:
        """That of a body with inertia G and twist V."""
        w, v, h = V[:3], V[3:], G.first_moment
        return cls(so3.hat(w) @ G.second_moment + np.outer(v, h), so3.cross(w, h) + G.mass * v)

    def __add__(self, other: BodyCoriolis) -> BodyCoriolis:
        return BodyCoriolis(self.K + other.K, self.p + other.p)

    def in_frame(self, T: Array) -> BodyCoriolis:
        """Seen from {a}, if this is in {b} and T is T_ab."""
        R, r = T[:3, :3], T[:3, 3]
        p = R @ self.p
        return BodyCoriolis(R @ self.K @ R.T + np.outer(p, r), p)

    def __matmul__(self, V: Array) -> Array:
        w = V[:3]
        return np.concatenate([self.K.trace() * w - self.K @ w, so3.cross(w, self.p)])

    def transposed_times(self, V: Array) -> Array:
        """B' V."""
        w, v = V[:3], V[3:]
        return np.concatenate([self.K.trace() * w - self.K.T @ w + so3.cross(self.p, v), zeros(3)])


def coriolis_matrix(model: Model, q: Array, dq: Array) -> Array:
    """C with C dq = c and dM/dt - 2C skew; the Christoffel one on one-degree joints; (nv, nv)."""
    T = joint_poses(model, q)
    V, G = body_velocities(model, T, dq), composite_inertias(model, q)
    B = [BodyCoriolis.of(body.inertia, V[i]) for i, body in enumerate(model.bodies)]
    for i, p in inward(model):
        if p != BASE:
            B[p] = B[p] + B[i].in_frame(T[i])
    up = [Ad(X).inverse.T for X in T]
    C = zeros(model.nv, model.nv)
    for i, body in enumerate(model.bodies):
        for b, S in enumerate(body.joint.axes):
            dS = ad(V[i]) @ S
            F1, F2, F3 = G[i] @ dS + B[i] @ S, G[i] @ S, B[i].transposed_times(S)
            for j in ancestors(model, i):
                other = model.bodies[j]
                for a, S_j in enumerate(other.joint.axes):
                    _add(C, other, a, body, b, S_j @ F1)
                    if j != i:
                        _add(C, body, b, other, a, (ad(V[j]) @ S_j) @ F2 + S_j @ F3)
                F1, F2, F3 = up[j] @ F1, up[j] @ F2, up[j] @ F3
    for mine, L in armature_symbols(model):
        C[mine, mine] = C[mine, mine] + L @ dq[mine]
    return C


def _add(C: Array, row: Body, a: int, column: Body, b: int, value: Any) -> None:
    r, c = row.v_index + a, column.v_index + b
    C[r, c] = C[r, c] + row.ratio * column.ratio * value


def christoffel(model: Model, q: Array) -> Array:
    """Γ_ijk, first kind; (nv, nv, nv). C is linear in dq, so Γ_··k is C at the k-th unit velocity. MR section 8.1.2."""
    gamma = zeros(model.nv, model.nv, model.nv)
    for k, e in enumerate(np.eye(model.nv).astype(object)):
        gamma[:, :, k] = coriolis_matrix(model, q, e)
    return gamma
