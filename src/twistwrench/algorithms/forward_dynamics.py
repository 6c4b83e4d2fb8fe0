"""Forward dynamics: q̈ from torques, by solving M q̈ = τ - h. Modern Robotics section 8.5."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from ..model.model import Model
from .inverse_dynamics import Wrenches, bias_forces
from .mass_matrix import mass_matrix

Array = NDArray[Any]

__all__ = ["forward_dynamics", "solve_symmetric"]


def forward_dynamics(model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None) -> Array:
    """q̈ = M⁻¹ (τ - h - Σ J'F_by); (nv,). MR eq. 8.27."""
    return solve_symmetric(mass_matrix(model, q), tau - bias_forces(model, q, dq, wrenches))


def solve_symmetric(M: Array, b: Array) -> Array:
    """x with M x = b, by M = L' D L from the last row up; Featherstone, RBDA (2008), 6.5.

    Leaves come after their ancestors in M, so eliminating from the end keeps the zeros between branches zero, and a
    trace drops them. Only the lower triangle is read. Unrolled: no pivots, M positive definite.
    """
    n = len(b)
    H, x = M.copy(), b.copy()
    L = M.copy()
    for k in reversed(range(n)):
        for i in range(k):
            L[k, i] = H[k, i] * (1.0 / H[k, k])
        for i in range(k):
            for j in range(i + 1):
                H[i, j] = H[i, j] - L[k, i] * H[k, j]
            x[i] = x[i] - L[k, i] * x[k]
    for k in range(n):
        x[k] = x[k] * (1.0 / H[k, k])
        for i in range(k):
            x[k] = x[k] - L[k, i] * x[i]
    return x
