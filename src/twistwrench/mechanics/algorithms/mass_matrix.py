"""Mass matrix by composite bodies, and its sparse factors. RBDA chapter 6."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np

from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie.adjoint import Ad
from ..model.couplings import armature_matrix
from ..model.model import BASE, Body, Model
from .friction import is_zero
from .recursion import ancestors, inward, joint_coordinates, joint_poses, zeros


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
