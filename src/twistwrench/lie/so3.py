"""Rotations: so(3) and SO(3). Any leading batch shape; Modern Robotics section 3.2."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import quaternion, series

Array = NDArray[Any]

__all__ = ["cross", "exp", "hat", "left_jacobian", "left_jacobian_inverse", "log", "vee"]


def hat(w: ArrayLike) -> Array:
    """The skew-symmetric matrix [w], with ``[w] x = w × x``; (..., 3) → (..., 3, 3). MR eq. 3.30.

    >>> hat([1, 2, 3]).tolist()
    [[0, -3, 2], [3, 0, -1], [-2, 1, 0]]
    """
    w = np.asarray(w)
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*w.shape, 3)


def vee(W: ArrayLike) -> Array:
    """The vector w of a skew-symmetric matrix [w]; (..., 3, 3) → (..., 3)."""
    W = np.asarray(W)
    return np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], axis=-1)


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """a × b; (..., 3), (..., 3) → (..., 3). Works on any element type, symbols included."""
    a, b = np.asarray(a), np.asarray(b)
    (a0, a1, a2), (b0, b1, b2) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)


def exp(w: ArrayLike) -> Array:
    """The rotation matrix of the exponential coordinates w = ω̂θ; (..., 3) → (..., 3, 3). MR eq. 3.51.

    >>> import numpy as np
    >>> np.allclose(exp([0, 0, np.pi / 2]) @ [1, 0, 0], [0, 1, 0])
    True
    """
    w = np.asarray(w, float)
    theta = np.linalg.norm(w, axis=-1)[..., None, None]
    W = hat(w)
    return np.eye(3) + series.sinc(theta) * W + series.one_minus_cos_over_square(theta) * (W @ W)


def log(R: ArrayLike) -> Array:
    """Exponential coordinates of a rotation matrix, 0 ≤ |w| ≤ π; (..., 3, 3) → (..., 3).

    Through the quaternion, so right at every angle, π and its neighbours included.
    """
    return quaternion.log(quaternion.from_matrix(R))


def left_jacobian(w: ArrayLike) -> Array:
    """J with exp(w + dw) = exp(J dw) exp(w) to first order; (..., 3) → (..., 3, 3)."""
    w = np.asarray(w, float)
    theta = np.linalg.norm(w, axis=-1)[..., None, None]
    W = hat(w)
    return np.eye(3) + series.one_minus_cos_over_square(theta) * W + series.theta_minus_sin_over_cube(theta) * (W @ W)


def left_jacobian_inverse(w: ArrayLike) -> Array:
    """Inverse of :func:`left_jacobian`, for |w| < 2π; (..., 3) → (..., 3, 3)."""
    w = np.asarray(w, float)
    theta = np.linalg.norm(w, axis=-1)[..., None, None]
    W = hat(w)
    return np.eye(3) - 0.5 * W + series.cot_term(theta) * (W @ W)
