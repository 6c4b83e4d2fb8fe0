"""Forward dynamics: q̈ from torques, by solving M q̈ = τ - h. Modern Robotics section 8.5."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from ..model.model import Model
from .articulated import articulated_dynamics, articulated_pays
from .factors import factored, solved, widened
from .inverse_dynamics import Wrenches, bias_forces
from .mass_matrix import mass_matrix

Array = NDArray[Any]

__all__ = ["forward_dynamics"]


def forward_dynamics(
    model: Model, q: Array, dq: Array, tau: Array, wrenches: Wrenches | None = None, added: Array | None = None
) -> Array:
    """q̈ = M⁻¹ (τ - h - Σ J'F_by); (nv,). MR section 8.5. ``added`` (nv,) is inertia on top, on the diagonal of M."""
    if articulated_pays(model):
        return articulated_dynamics(model, q, dq, tau, wrenches, added)
    M = mass_matrix(model, q)
    L, D = factored(M if added is None else widened(M, added))
    return solved(L, D, tau - bias_forces(model, q, dq, wrenches))
