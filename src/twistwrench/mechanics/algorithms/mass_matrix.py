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
    """L and 1/D with M = L' D L, from the last row up; Featherstone, RBDA (2008), 6.5.

    L is unit lower triangular: only its entries below the diagonal are set and read, the others are those of M. Leaves come
    after their ancestors in M, so elimination from the end keeps the zeros between branches, and tracing omits them. Only the
    lower triangle of M is read. There is no pivoting, since M is positive definite.
    """
    n = len(M)
    H = M.copy()  # what remains of M after each elimination
    L = M.copy()
    D_inverse = M.diagonal().copy()
    for k in reversed(range(n)):
        D_inverse[k] = 1.0 / H[k, k]
        for i in range(k):
            L[k, i] = H[k, i] * D_inverse[k]
        for i in range(k):
            for j in range(i + 1):
                H[i, j] = H[i, j] - L[k, i] * H[k, j]
    return L, D_inverse


def solve_ldl(L: Array, D_inverse: Array, b: Array) -> Array:
    """x with L' D L x = b."""
    return solve_triangular(L, D_inverse * solve_transposed(L, b))


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
    unit_vectors = np.eye(len(L)).astype(object)  # entries may be traced values
    columns = [solve_triangular(L, unit_vector) for unit_vector in unit_vectors]
    return np.array(columns).reshape(L.shape).T


def symmetric_product(W: Array, D_inverse: Array) -> Array:
    """W D⁻¹ W', each symmetric pair computed once."""
    n = len(W)
    scaled_W = W * D_inverse
    product = W.copy()
    for i in range(n):
        for j in range(i + 1):
            product[i, j] = product[j, i] = scaled_W[i] @ W[j]
    return product


def with_diagonal(M: Array, diagonal: Array) -> Array:
    """M with ``diagonal`` added to its diagonal."""
    total = M.astype(object)  # a copy, whose entries may be traced values
    for i, entry in enumerate(diagonal):
        total[i, i] = total[i, i] + entry
    return total


# ── Mass matrix by composite bodies. Featherstone, RBDA (2008), 6.2

# M = Σ J_i' G_i J_i (MR eq. 8.57), with each body's inertia moved to its parent once; plus the drives' armature.


def composite_inertias(model: Model, q: Array) -> list[SpatialInertia]:
    """Inertia of each body together with all bodies that it carries, in the body's frame."""
    G = [body.inertia for body in model.bodies]  # grows from the leaves inward
    coordinates = joint_coordinates(model, q)
    for i, p in inward(model):
        if p != BASE:
            body = model.bodies[i]
            carried_inertia = body.joint.carry(G[i], coordinates[i])  # in the joint's frame
            G[p] = G[p] + carried_inertia.in_frame(body.placement)
    return G


def mass_matrix(model: Model, q: Array) -> Array:
    """M, symmetric and full; (nv, nv)."""
    to_parent = [Ad(pose).inverse.T for pose in joint_poses(model, q)]  # of wrenches and momenta
    M = zeros(model.nv, model.nv)
    for i, G in enumerate(composite_inertias(model, q)):
        body = model.bodies[i]
        for k, S_i in enumerate(body.joint.axes):
            F = G @ S_i  # momentum of all carried bodies at unit rate, in the frame of body i, then of its ancestors
            for j in ancestors(model, i):  # i itself first
                ancestor = model.bodies[j]
                for m, S_j in enumerate(ancestor.joint.axes):
                    is_mirror_image = i == j and m > k  # of an entry between two velocities of one joint
                    if not is_mirror_image:
                        _add_symmetric(M, ancestor, m, body, k, S_j @ F)
                F = to_parent[j] @ F
    armature = armature_matrix(model)
    M = with_diagonal(M, armature.diagonal())
    for velocity_indices, *_ in model.coupled:  # of joints that share motors
        for i, j in permutations(velocity_indices, 2):
            if not is_zero(armature[i, j]):  # tracing then omits the sum
                M[i, j] = M[i, j] + armature[i, j]
    return M


def _add_symmetric(M: Array, row_body: Body, m: int, column_body: Body, k: int, value: Any) -> None:
    """Add a value to an entry of M and to its mirror image, at velocities m and k of the joints of two bodies.

    Joints that share a coordinate may add several values to one entry.
    """
    row = row_body.v_index + m
    column = column_body.v_index + k
    scaled_value = row_body.ratio * column_body.ratio * value
    M[row, column] = M[row, column] + scaled_value
    is_one_velocity = row_body is column_body and m == k
    if not is_one_velocity:
        M[column, row] = M[column, row] + scaled_value
