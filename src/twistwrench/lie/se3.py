"""Rigid motions: se(3) and SE(3). Twists are (omega, v), angular part first; Modern Robotics section 3.3.

Any leading batch shape. ``T_ab`` is the pose of frame {b} seen from {a}.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import so3
from .adjoint import Ad, ad

Array = NDArray[Any]

__all__ = ["Ad", "ad", "exp", "hat", "inverse", "log", "pose", "vee"]


def pose(R: ArrayLike, p: ArrayLike) -> Array:
    """The 4×4 matrix of a rotation and a position; (..., 3, 3), (..., 3) → (..., 4, 4). Works on symbols too."""
    R, p = np.asarray(R), np.asarray(p)
    top = np.concatenate([R, p[..., None]], axis=-1)
    bottom = np.broadcast_to(np.array([0.0, 0.0, 0.0, 1.0]), (*top.shape[:-2], 1, 4))
    return np.concatenate([top, bottom], axis=-2)


def hat(V: ArrayLike) -> Array:
    """The 4×4 matrix [V]; (..., 6) → (..., 4, 4). MR eq. 3.71."""
    V = np.asarray(V)
    top = np.concatenate([so3.hat(V[..., :3]), V[..., 3:, None]], axis=-1)
    return np.concatenate([top, np.zeros_like(top[..., :1, :])], axis=-2)


def vee(X: ArrayLike) -> Array:
    """The twist of a 4×4 matrix [V]; (..., 4, 4) → (..., 6)."""
    X = np.asarray(X)
    return np.concatenate([so3.vee(X[..., :3, :3]), X[..., :3, 3]], axis=-1)


def inverse(T: ArrayLike) -> Array:
    """T_ba from T_ab, by transposing; (..., 4, 4) → (..., 4, 4). MR eq. 3.64. Works on symbols too."""
    T = np.asarray(T)
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return pose(Rt, -(Rt @ T[..., :3, 3, None])[..., 0])


def exp(V: ArrayLike) -> Array:
    """The pose reached by following the twist V for unit time; (..., 6) → (..., 4, 4). MR eq. 3.88.

    >>> exp([0, 0, 0, 1, 2, 3])[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    V = np.asarray(V, float)
    w, v = V[..., :3], V[..., 3:]
    return pose(so3.exp(w), (so3.left_jacobian(w) @ v[..., None])[..., 0])


def log(T: ArrayLike) -> Array:
    """The twist, with |omega| ≤ π, that leads from the identity to T in unit time; (..., 4, 4) → (..., 6)."""
    T = np.asarray(T, float)
    w = so3.log(T[..., :3, :3])
    return np.concatenate([w, (so3.left_jacobian_inverse(w) @ T[..., :3, 3, None])[..., 0]], axis=-1)
