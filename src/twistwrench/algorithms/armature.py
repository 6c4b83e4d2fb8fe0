"""Armature: the inertia A = diag(a) of drives, felt by the velocities u of one joint each. Its kinetic energy is ½ u' A u.

The velocities of planar, ball and floating joints are no rates of coordinates, but the joint's own twist V by its axes S_k.
So Lagrange's equations are those of Hamel, and an armature has products of velocities as any inertia of that twist has:

    τ = A du/dt - [V, ·]' A u = A du/dt + C u,     C = L u,     L_abc = a_c S_c·[S_a, S_b]     (axes of unit length).

C is skew, as it has to be where dM/dt = 0. L is zero for joints of one degree. Of a ball joint with equal
armatures C u is zero; of a floating one what is left is a (ω × v), the acceleration of an origin whose velocity is that of a
moving frame. Source: Hamel, "Die Lagrange-Eulerschen Gleichungen der Mechanik", 1904; Modern Robotics section 8.2.2.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..lie.adjoint import ad
from ..model.model import Model
from ..typing import Array


def armature_symbols(model: Model) -> Iterator[tuple[slice, Array]]:
    """(place in dq, L) of each joint with several velocities and an armature, (n, n, n) for the n of the joint."""
    for body in model.leaders:
        mine, S = body.places[1], body.joint.axes
        a = model.armature[mine]
        if body.joint.nv > 1 and a.any():
            yield mine, np.array([[a * (S @ (ad(S_a) @ S_b)) for S_b in S] for S_a in S])


def armature_forces(model: Model, dq: Array, ddq: Array) -> Array:
    """A ddq + C dq, what the armature takes; (..., nv)."""
    tau = model.armature * ddq
    for mine, L in armature_symbols(model):
        u = dq[..., mine]
        pairs = np.triu(L + L.swapaxes(1, 2))  # each product of two velocities once; those of one with itself are zero
        products = u[..., None, :, None] * u[..., None, None, :]
        tau[..., mine] = tau[..., mine] + (pairs * products).sum(axis=(-2, -1))
    return tau
