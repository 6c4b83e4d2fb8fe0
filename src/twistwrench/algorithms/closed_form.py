"""The dynamics in block matrices, Modern Robotics section 8.4: slow, plain, and independent of the recursions.

Stack the bodies: 𝒱 = ℒ(𝒜 q̇), with ℒ = (1 - 𝒲)⁻¹ and 𝒲 holding Ad(T_i,p) where body i hangs on body p. Then
M = 𝒜'ℒ'𝒢ℒ𝒜, and c, g and the wrenches' part follow without a recursion. Floats only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lie import se3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Model
from .inverse_dynamics import Wrenches
from .recursion import joint_poses

Array = NDArray[Any]

__all__ = ["ClosedForm", "closed_form"]


@dataclass(frozen=True)
class ClosedForm:
    """The terms of τ = M q̈ + c + g + J'F."""

    M: Array
    c: Array
    g: Array
    wrench_torques: Array

    def inverse_dynamics(self, ddq: Array) -> Array:
        """τ; (nv,)."""
        return self.M @ ddq + self.c + self.g + self.wrench_torques


def closed_form(model: Model, q: Array, dq: Array, wrenches: Wrenches | None = None) -> ClosedForm:
    """All terms at one state, by block matrices of size 6n. MR section 8.4."""
    n, nv = len(model.bodies), model.nv
    T = [np.asarray(X, float) for X in joint_poses(model, np.asarray(q, float))]
    A, G, W = np.zeros((6 * n, nv)), np.zeros((6 * n, 6 * n)), np.zeros((6 * n, 6 * n))
    dV_base, F = np.zeros(6 * n), np.zeros(6 * n)
    for i, body in enumerate(model.bodies):
        here = slice(6 * i, 6 * i + 6)
        A[here, body.v_index : body.v_index + body.joint.nv] = body.ratio * body.joint.axes.T
        G[here, here] = body.inertia.matrix
        X = Ad(se3.inverse(T[i])).matrix
        if body.parent == BASE:
            dV_base[here] = X @ np.concatenate([np.zeros(3), -model.gravity])
        else:
            W[here, 6 * body.parent : 6 * body.parent + 6] = X
    for name, F_by in (wrenches or {}).items():
        frame = model.frame(name)
        if frame.body != BASE:
            F[6 * frame.body : 6 * frame.body + 6] += Ad(se3.inverse(frame.pose)).matrix.T @ F_by
    L = np.linalg.inv(np.eye(6 * n) - W)
    V = L @ A @ dq
    ad_V, ad_Adq = _block_diagonal(V), _block_diagonal(A @ dq)
    dV = L @ (-ad_Adq @ (W @ V))  # velocity products alone
    wrench = G @ dV - ad_V.T @ (G @ V)
    return ClosedForm(
        M=A.T @ L.T @ G @ L @ A,
        c=A.T @ L.T @ wrench,
        g=A.T @ L.T @ G @ L @ dV_base,
        wrench_torques=A.T @ L.T @ F,
    )


def _block_diagonal(V: Array) -> Array:
    big = np.zeros((len(V), len(V)))
    for k in range(0, len(V), 6):
        big[k : k + 6, k : k + 6] = ad(V[k : k + 6]).matrix
    return big
