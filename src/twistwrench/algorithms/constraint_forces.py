"""Forces of constraint that leave the joints without motors alone: τ = f + A'λ, zero there. Floats, batches."""

from __future__ import annotations

import numpy as np

from ..typing import Array

SINGULAR = 1e-9
"""Directions of λ that reach a joint less than this part of what others do, rows of A in their usual sizes, do not."""
UNBALANCED = 1e-6
"""Torques left at joints without motors, as a part of the largest: beyond it no motors make the motion. Configurations and
velocities may be as far from the constraints as integrators leave them."""


def balance(f: Array, A: Array, sizes: Array, driven: Array) -> tuple[Array, Array]:
    """λ (..., k) with least torques f + A'λ at the ``driven`` joints among those with least at the others; what is left there.

    f (..., nv) is M q̈ + h, ``driven`` (nv,) true where there is a motor.
    """
    At = np.swapaxes(A, -1, -2) / sizes  # A'λ = (A'W⁻¹)(W λ), columns of one size
    f = f[..., None]
    held, loose = At[..., driven, :], At[..., ~driven, :]
    floor = SINGULAR * np.linalg.norm(At, axis=(-2, -1))
    inverse = _pseudoinverse(loose, floor)
    x = -inverse @ f[..., ~driven, :]
    free = np.eye(len(sizes)) - inverse @ loose  # changes of λ that no motorless joint feels
    x = x - free @ _pseudoinverse(held @ free, floor) @ (f[..., driven, :] + held @ x)
    return x[..., 0] / sizes, (f[..., ~driven, :] + loose @ x)[..., 0]


def _pseudoinverse(X: Array, floor: Array) -> Array:
    """That of Moore and Penrose with singular values up to ``floor`` (...) zero."""
    if 0 in X.shape[-2:]:
        return np.swapaxes(X, -1, -2)
    U, sigma, Vt = np.linalg.svd(X, full_matrices=False)
    kept = sigma > floor[..., None]
    inverse = np.where(kept, 1.0 / np.where(kept, sigma, 1.0), 0.0)
    return np.asarray(np.swapaxes(Vt, -1, -2) @ (inverse[..., None] * np.swapaxes(U, -1, -2)))
