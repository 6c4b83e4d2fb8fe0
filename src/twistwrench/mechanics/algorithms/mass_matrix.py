"""Mass matrix by composite bodies, its sparse factors, energies and momenta, and the Coriolis matrix. RBDA chapter 6."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import numpy as np

from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import so3
from ..lie.adjoint import Ad, ad
from ..model.couplings import armature_matrix, motor_velocities
from ..model.model import BASE, Body, Model
from .friction import is_zero
from .recursion import (
    add_entry,
    ancestors,
    armature_symbols,
    base_poses,
    inward,
    joint_coordinates,
    joint_poses,
    outward,
    spread,
    spring_energy,
    zeros,
)


def ldl_factors(M: Array) -> tuple[Array, Array]:
    """L, unit lower triangular, and 1/D with M = L' D L, from the last row up; Featherstone, RBDA (2008), 6.5.

    Leaves come after their ancestors in M, so elimination from the end keeps the zeros between branches, and tracing omits
    them. Only the lower triangle is read. Unrolled and without pivoting: M is positive definite.
    """
    n = len(M)
    H, L, inverse = M.copy(), M.copy(), M.diagonal().copy()
    for k in reversed(range(n)):
        inverse[k] = 1.0 / H[k, k]
        for i in range(k):
            L[k, i] = H[k, i] * inverse[k]
        for i in range(k):
            for j in range(i + 1):
                H[i, j] = H[i, j] - L[k, i] * H[k, j]
    return L, inverse


def solve_ldl(L: Array, inverse: Array, b: Array) -> Array:
    """x with L' D L x = b."""
    return solve_triangular(L, inverse * solve_transposed(L, b))


def solve_transposed(L: Array, b: Array) -> Array:
    """z with L' z = b."""
    z = b.astype(np.result_type(L, b))
    for k in reversed(range(len(z))):
        for i in range(k):
            z[i] = z[i] - L[k, i] * z[k]
    return z


def solve_triangular(L: Array, b: Array) -> Array:
    """x with L x = b."""
    x = b.astype(np.result_type(L, b))
    for k in range(len(x)):
        for i in range(k):
            x[k] = x[k] - L[k, i] * x[i]
    return x


def inverse_factor(L: Array) -> Array:
    """W with W L = 1: unit lower triangular, with the zeros of L; M⁻¹ = W D⁻¹ W'."""
    return np.array([solve_triangular(L, e) for e in np.eye(len(L)).astype(object)]).reshape(L.shape).T


def symmetric_product(W: Array, inverse: Array) -> Array:
    """W D⁻¹ W', each symmetric pair computed once."""
    n = len(W)
    scaled, product = W * inverse, W.copy()
    for i in range(n):
        for j in range(i + 1):
            product[i, j] = product[j, i] = scaled[i] @ W[j]
    return product


def with_diagonal(M: Array, diagonal: Array) -> Array:
    """M with ``diagonal`` added to its diagonal."""
    total = M.astype(object)
    for i, x in enumerate(diagonal):
        total[i, i] = total[i, i] + x
    return total


# ── Mass matrix by composite bodies. Featherstone, RBDA (2008), 6.2

# M = Σ J_i' G_i J_i (MR eq. 8.57), with each body's inertia moved to its parent once; plus the drives' armature.


def composite_inertias(model: Model, q: Array) -> list[SpatialInertia]:
    """Inertia of each body together with all bodies it carries, in the body's frame."""
    G = [body.inertia for body in model.bodies]
    coordinates = joint_coordinates(model, q)
    for i, p in inward(model):
        if p != BASE:
            body = model.bodies[i]
            G[p] = G[p] + body.joint.carry(G[i], coordinates[i]).in_frame(body.placement)
    return G


def mass_matrix(model: Model, q: Array) -> Array:
    """M, symmetric and full; (nv, nv)."""
    T = joint_poses(model, q)
    up = [Ad(X).inverse.T for X in T]
    M = zeros(model.nv, model.nv)
    for i, G in enumerate(composite_inertias(model, q)):
        for b, S in enumerate(model.bodies[i].joint.axes):
            F = G @ S  # momentum of all carried bodies at unit rate
            for j in ancestors(model, i):
                for a, S_j in enumerate(model.bodies[j].joint.axes):
                    if i != j or a <= b:
                        _add_symmetric(M, model.bodies[j], a, model.bodies[i], b, S_j @ F)
                F = up[j] @ F
    drives = armature_matrix(model)
    M = with_diagonal(M, drives.diagonal())
    for at, _, _ in model.coupled:
        for i, j in permutations(at, 2):
            if not is_zero(drives[i, j]):
                M[i, j] = M[i, j] + drives[i, j]
    return M


def _add_symmetric(M: Array, row: Body, a: int, column: Body, b: int, value: Any) -> None:
    """Add an entry and its mirror image. Joints that share a coordinate may add several values to one entry."""
    r, c = row.v_index + a, column.v_index + b
    value = row.ratio * column.ratio * value
    M[r, c] = M[r, c] + value
    if row is not column or a != b:
        M[c, r] = M[c, r] + value


# ── Energies, momentum, centre of mass. Modern Robotics sections 8.1 and 8.2


def body_velocities(model: Model, T: Sequence[Array], dq: Array) -> list[Array]:
    """Twist V_i of each body in its own frame; (6,) each. MR eq. 8.51."""
    Adq = spread(model, dq)
    V: list[Array] = []
    for i, p in outward(model):
        V.append(Adq[i] if p == BASE else Ad(T[i]).inverse @ V[p] + Adq[i])
    return V


def kinetic_energy(model: Model, q: Array, dq: Array) -> Any:
    """½ Σ V' G V plus the energy of the drives' armature [J]. MR section 8.1.2."""
    V = body_velocities(model, joint_poses(model, q), dq)
    u = motor_velocities(model, dq)
    drives = 0.5 * (u @ (model.armature * u))
    return sum((0.5 * (v @ (body.inertia @ v)) for body, v in zip(model.bodies, V, strict=True)), start=drives)


def _first_moments(model: Model, q: Array) -> tuple[float, Array]:
    """Mass and first moment (3,) of all moving bodies together, in the base frame."""
    mass, h = 0.0, zeros(3)
    for body, T in zip(model.bodies, base_poses(model, joint_poses(model, q)), strict=True):
        mass += body.inertia.mass
        h = h + T[:3, :3] @ body.inertia.first_moment + body.inertia.mass * T[:3, 3]
    return mass, h


def potential_energy(model: Model, q: Array) -> Any:
    """-Σ m g·c, zero with every centre of mass at the base origin, plus the energy of springs [J]."""
    return -(model.gravity @ _first_moments(model, q)[1]) + spring_energy(model, q)


def center_of_mass(model: Model, q: Array) -> Array:
    """Centre of mass of the moving bodies in the base frame, NaN if their mass is zero; (3,)."""
    mass, h = _first_moments(model, q)
    return h * _per(mass)


def _per(mass: Any) -> Any:
    """1 / mass, NaN for zero mass; symbolic masses count as nonzero."""
    return np.nan if isinstance(mass, int | float) and mass == 0 else 1.0 / mass


def com_jacobian(model: Model, q: Array) -> Array:
    """J with d(center_of_mass)/dt = J dq; (3, nv). Each joint moves the composite body that it carries."""
    T = joint_poses(model, q)
    T_s, G = base_poses(model, T), composite_inertias(model, q)
    J = zeros(3, model.nv)
    for i, body in enumerate(model.bodies):
        for b, S in enumerate(body.joint.axes):
            c = body.v_index + b
            J[:, c] = J[:, c] + body.ratio * (T_s[i][:3, :3] @ (G[i] @ S)[3:])
    mass = sum(body.inertia.mass for body in model.bodies)
    return J * _per(mass)


def momentum(model: Model, q: Array, dq: Array) -> Array:
    """Spatial momentum P of the moving bodies at the base origin; (6,)."""
    T = joint_poses(model, q)
    V, T_s = body_velocities(model, T, dq), base_poses(model, T)
    P = zeros(6)
    for i, body in enumerate(model.bodies):
        P = P + Ad(T_s[i]).inverse.T @ (body.inertia @ V[i])
    return P


def momentum_about_com(model: Model, q: Array, dq: Array) -> Array:
    """Centroidal momentum: the spatial momentum about the centre of mass, axes of {s}; (6,)."""
    P = momentum(model, q, dq)
    return np.concatenate([P[:3] - so3.cross(center_of_mass(model, q), P[3:]), P[3:]])


# ── Coriolis matrix and Christoffel symbols. Modern Robotics section 8.1.2; Echeandia and Wensing, 2021

# For a body, let K = ∫ ẋ r' dm and p = ∫ ẋ dm, velocities ẋ and positions r of its points in the body's frame. Then
#
#     B V' = ((tr K 1 - K) w', w' × p)
#
# is the factor with  C = Σ J_i' (G_i dJ_i + B_i J_i),  C dq = c  and  dM/dt - 2C  skew. K and p add up like inertias. With the
# sums G and B over all bodies that joint i carries, and S_j expressed in body i,
#
#     (1)  C_ji = S_j·(G dS_i + B S_i)                      j is i, or before it
#     (2)  C_ij = dS_j·G S_i + S_j·B'S_i,   dS = [V, S]     j before i


class BodyCoriolis:
    """The operator B of one body or of several joined ones, given by K (3, 3) and p (3,)."""

    def __init__(self, K: Array, p: Array) -> None:
        self.K, self.p = K, p

    @classmethod
    def from_twist(cls, G: SpatialInertia, V: Array) -> BodyCoriolis:
        """Coriolis matrix of a body with inertia G and twist V."""
        w, v, h = V[:3], V[3:], G.first_moment
        return cls(so3.hat(w) @ G.second_moment + np.outer(v, h), so3.cross(w, h) + G.mass * v)

    def __add__(self, other: BodyCoriolis) -> BodyCoriolis:
        return BodyCoriolis(self.K + other.K, self.p + other.p)

    def in_frame(self, T: Array) -> BodyCoriolis:
        """Operator expressed in {a}, given one in {b} and T = T_ab."""
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
    """C with C dq = c and dM/dt - 2C skew; the Christoffel form for one-degree joints; (nv, nv)."""
    T = joint_poses(model, q)
    V, G = body_velocities(model, T, dq), composite_inertias(model, q)
    B = [BodyCoriolis.from_twist(body.inertia, V[i]) for i, body in enumerate(model.bodies)]
    for i, p in inward(model):
        if p != BASE:
            B[p] = B[p] + B[i].in_frame(T[i])
    to_parent = [Ad(X).inverse.T for X in T]
    C = zeros(model.nv, model.nv)
    for i, body in enumerate(model.bodies):
        for b, S in enumerate(body.joint.axes):
            dS = ad(V[i]) @ S
            F, GS, BS = G[i] @ dS + B[i] @ S, G[i] @ S, B[i].transposed_times(S)
            for j in ancestors(model, i):
                ancestor = model.bodies[j]
                for a, S_j in enumerate(ancestor.joint.axes):
                    add_entry(C, ancestor, a, body, b, S_j @ F)  # (1)
                    if j != i:
                        add_entry(C, body, b, ancestor, a, (ad(V[j]) @ S_j) @ GS + S_j @ BS)  # (2)
                F, GS, BS = to_parent[j] @ F, to_parent[j] @ GS, to_parent[j] @ BS
    for block, L in armature_symbols(model):
        C[block, block] = C[block, block] + L @ dq[block]
    return C


def christoffel(model: Model, q: Array) -> Array:
    """Γ_ijk of the first kind; (nv, nv, nv). C is linear in dq, so Γ_··k is C at the k-th unit velocity. MR section 8.1.2."""
    gamma = zeros(model.nv, model.nv, model.nv)
    for k, e in enumerate(np.eye(model.nv).astype(object)):
        gamma[:, :, k] = coriolis_matrix(model, q, e)
    return gamma
