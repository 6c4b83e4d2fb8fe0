"""The Coriolis matrix and the Christoffel symbols. Modern Robotics section 8.1.2; Echeandia and Wensing, 2021.

For a body, let K = ∫ ẋ r' dm and p = ∫ ẋ dm, velocities ẋ and positions r of its points in the body's frame. Then

    B V' = ((tr K 1 - K) w', w' × p)

is the factor with  C = Σ J_i' (G_i dJ_i + B_i J_i),  C dq = c  and  dM/dt - 2C  skew. K and p add up like inertias. With the
sums G and B over all that joint i carries, and S_j seen from body i,

    (1)  C_ji = S_j·(G dS_i + B S_i)                      j is i, or before it
    (2)  C_ij = dS_j·G S_i + S_j·B'S_i,   dS = [V, S]     j before i
"""

from __future__ import annotations

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Model
from ..typing import Array
from .armature import armature_symbols
from .energy import body_velocities
from .mass_matrix import composite_inertias
from .recursion import add_entry, ancestors, inward, joint_poses, zeros


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
            F, GS, BS = G[i] @ dS + B[i] @ S, G[i] @ S, B[i].transposed_times(S)
            for j in ancestors(model, i):
                other = model.bodies[j]
                for a, S_j in enumerate(other.joint.axes):
                    add_entry(C, other, a, body, b, S_j @ F)  # (1)
                    if j != i:
                        add_entry(C, body, b, other, a, (ad(V[j]) @ S_j) @ GS + S_j @ BS)  # (2)
                F, GS, BS = up[j] @ F, up[j] @ GS, up[j] @ BS
    for mine, L in armature_symbols(model):
        C[mine, mine] = C[mine, mine] + L @ dq[mine]
    return C


def christoffel(model: Model, q: Array) -> Array:
    """Γ_ijk, first kind; (nv, nv, nv). C is linear in dq, so Γ_··k is C at the k-th unit velocity. MR section 8.1.2."""
    gamma = zeros(model.nv, model.nv, model.nv)
    for k, e in enumerate(np.eye(model.nv).astype(object)):
        gamma[:, :, k] = coriolis_matrix(model, q, e)
    return gamma
