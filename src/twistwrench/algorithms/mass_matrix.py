"""The mass matrix by composite bodies: what each joint feels of everything it carries. Featherstone, RBDA (2008), 6.2.

M = Σ J_i' G_i J_i (MR eq. 8.57) summed so that every body is moved to its parent once; and the drives' armature.
"""

from __future__ import annotations

from typing import Any

from ..bodies.inertia import SpatialInertia
from ..lie.adjoint import Ad
from ..model.model import BASE, Body, Model
from ..typing import Array
from .recursion import ancestors, inward, joint_coordinates, joint_poses, zeros
from .tree_factorisation import widened


def composite_inertias(model: Model, q: Array) -> list[SpatialInertia]:
    """Inertia of each body together with everything it carries, in the body's frame."""
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
            F = G @ S  # momentum of all it carries, for unit rate
            for j in ancestors(model, i):
                for a, S_j in enumerate(model.bodies[j].joint.axes):
                    if i != j or a <= b:
                        _add_symmetric(M, model.bodies[j], a, model.bodies[i], b, S_j @ F)
                F = up[j] @ F
    return widened(M, model.armature)


def _add_symmetric(M: Array, row: Body, a: int, column: Body, b: int, value: Any) -> None:
    """Add an entry and its mirror image; joints that share a coordinate may bring two entries to one place."""
    r, c = row.v_index + a, column.v_index + b
    value = row.ratio * column.ratio * value
    M[r, c] = M[r, c] + value
    if row is not column or a != b:
        M[c, r] = M[c, r] + value
