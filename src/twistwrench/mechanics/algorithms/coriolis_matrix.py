"""Coriolis matrix and Christoffel symbols. Modern Robotics section 8.1.2; Echeandia and Wensing, 2021."""

from __future__ import annotations

import numpy as np

from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Model
from .energies import body_velocities
from .mass_matrix import composite_inertias
from .recursion import add_entry, ancestors, armature_symbols, inward, joint_poses, zeros

# For a body, let K = ∫ ẋ r' dm and p = ∫ ẋ dm, with the velocities ẋ and positions r of its points in the body's frame. The
# operator B maps a twist (w, v) to
#
#     B (w, v) = ((tr K 1 - K) w, w × p)
#
# With it, C = Σ J_i' (G_i dJ_i + B_i J_i), C dq = c, and dM/dt - 2C is skew. K and p add up like inertias. With the sums G and
# B over all bodies that joint i carries, and S_j expressed in body i,
#
#     (1)  C_ji = S_j·(G dS_i + B S_i)                      j is i, or before it
#     (2)  C_ij = dS_j·G S_i + S_j·B'S_i,   dS = [V, S]     j before i


class BodyCoriolis:
    """The operator B of one body or of several joined bodies, given by K (3, 3) and p (3,)."""

    def __init__(self, K: Array, p: Array) -> None:
        self.K, self.p = K, p

    @classmethod
    def from_twist(cls, G: SpatialInertia, V: Array) -> BodyCoriolis:
        """Operator of a body with inertia G and twist V = (w, v): its points move with ẋ = v + w × r."""
        w, v = V[:3], V[3:]
        h = G.first_moment
        K = so3.hat(w) @ G.second_moment + np.outer(v, h)
        p = so3.cross(w, h) + G.mass * v
        return cls(K, p)

    def __add__(self, other: BodyCoriolis) -> BodyCoriolis:
        """Operator of both, joined."""
        return BodyCoriolis(self.K + other.K, self.p + other.p)

    def in_frame(self, T: Array) -> BodyCoriolis:
        """Operator expressed in {a}, if this operator is expressed in {b} and T = T_ab."""
        R, origin = T[:3, :3], T[:3, 3]
        p = R @ self.p
        K = R @ self.K @ R.T + np.outer(p, origin)
        return BodyCoriolis(K, p)

    def __matmul__(self, V: Array) -> Array:
        """B V."""
        w = V[:3]
        couple = self.K.trace() * w - self.K @ w
        return np.concatenate([couple, so3.cross(w, self.p)])

    def transposed_times(self, V: Array) -> Array:
        """B' V, a pure couple."""
        w, v = V[:3], V[3:]
        couple = self.K.trace() * w - self.K.T @ w + so3.cross(self.p, v)
        return np.concatenate([couple, zeros(3)])


def coriolis_matrix(model: Model, q: Array, dq: Array) -> Array:
    """C (nv, nv) with C dq = c and dM/dt - 2C skew. For joints of one degree, C consists of Christoffel symbols."""
    T = joint_poses(model, q)
    V = body_velocities(model, T, dq)
    G = composite_inertias(model, q)
    B = [BodyCoriolis.from_twist(body.inertia, V[i]) for i, body in enumerate(model.bodies)]
    for i, p in inward(model):
        if p != BASE:
            B[p] = B[p] + B[i].in_frame(T[i])
    to_parent = [Ad(pose).inverse.T for pose in T]
    C = zeros(model.nv, model.nv)
    for i, body in enumerate(model.bodies):
        for k, S_i in enumerate(body.joint.axes):
            dS_i = ad(V[i]) @ S_i
            # Wrenches of (1) and (2) in the frame of body i; the loop moves them to the frame of each ancestor j.
            F = G[i] @ dS_i + B[i] @ S_i
            GS = G[i] @ S_i
            BS = B[i].transposed_times(S_i)
            for j in ancestors(model, i):  # i itself first
                ancestor = model.bodies[j]
                for m, S_j in enumerate(ancestor.joint.axes):
                    add_entry(C, ancestor, m, body, k, S_j @ F)  # (1)
                    if j != i:
                        dS_j = ad(V[j]) @ S_j
                        add_entry(C, body, k, ancestor, m, dS_j @ GS + S_j @ BS)  # (2)
                F, GS, BS = to_parent[j] @ F, to_parent[j] @ GS, to_parent[j] @ BS
    for block, L in armature_symbols(model):  # L (n, n, n): the armature's torques are dq' L dq
        C[block, block] = C[block, block] + L @ dq[block]
    return C


def christoffel(model: Model, q: Array) -> Array:
    """Christoffel symbols Γ_ijk of the first kind, (nv, nv, nv). MR section 8.1.2.

    C is linear in dq, so Γ_··k is C at the k-th unit velocity.
    """
    gamma = zeros(model.nv, model.nv, model.nv)
    for k, unit_velocity in enumerate(np.eye(model.nv).astype(object)):  # objects, as symbols are
        gamma[:, :, k] = coriolis_matrix(model, q, unit_velocity)
    return gamma
