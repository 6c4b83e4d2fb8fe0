"""Unit quaternions (w, x, y, z), scalar first. Any leading batch shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import series

Array = NDArray[Any]

__all__ = ["exp", "from_matrix", "log", "multiply", "rotation"]


def rotation(quat: ArrayLike) -> Array:
    """Rotation matrix of a quaternion of any nonzero length; (..., 4) → (..., 3, 3). Works on symbols too."""
    quat = np.asarray(quat)
    w, x, y, z = np.moveaxis(quat, -1, 0)
    s = 2.0 / (w * w + x * x + y * y + z * z)
    sx, sy, sz = s * x, s * y, s * z
    wx, wy, wz, xx, xy, xz, yy, yz, zz = w * sx, w * sy, w * sz, x * sx, x * sy, x * sz, y * sy, y * sz, z * sz
    rows = [1 - (yy + zz), xy - wz, xz + wy, xy + wz, 1 - (xx + zz), yz - wx, xz - wy, yz + wx, 1 - (xx + yy)]
    return np.stack(rows, axis=-1).reshape(*quat.shape[:-1], 3, 3)


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """The product a b (first b, then a); (..., 4), (..., 4) → (..., 4)."""
    (a0, a1, a2, a3), (b0, b1, b2, b3) = np.moveaxis(np.asarray(a), -1, 0), np.moveaxis(np.asarray(b), -1, 0)
    return np.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=-1,
    )


def exp(w: ArrayLike) -> Array:
    """Unit quaternion of the exponential coordinates w; (..., 3) → (..., 4)."""
    w = np.asarray(w, float)
    half = 0.5 * np.linalg.norm(w, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * series.sinc(half) * w], axis=-1)


def log(quat: ArrayLike) -> Array:
    """Exponential coordinates, 0 ≤ |w| ≤ π, of a quaternion of any nonzero length; (..., 4) → (..., 3)."""
    quat = np.asarray(quat, float)
    quat = np.where(quat[..., :1] < 0, -quat, quat)
    v = quat[..., 1:]
    norm = np.linalg.norm(v, axis=-1, keepdims=True)
    tiny = norm < 1e-150
    angle = 2.0 * np.arctan2(norm, quat[..., :1])
    return v * np.where(tiny, 2.0 / np.where(quat[..., :1] == 0, 1.0, quat[..., :1]), angle / np.where(tiny, 1.0, norm))


def from_matrix(R: ArrayLike) -> Array:
    """Unit quaternion (w ≥ 0) of a rotation matrix, by the best of four formulas; (..., 3, 3) → (..., 4).

    Source: Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
    """
    R = np.asarray(R, float)
    d = np.diagonal(R, axis1=-2, axis2=-1)
    trace = d.sum(-1)
    # Row k is 4 q_k q: the outer product of the quaternion with itself, and the row of the largest q_k is the safest.
    K = np.empty((*R.shape[:-2], 4, 4))
    K[..., 0, 0] = 1 + trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        K[..., i + 1, i + 1] = 1 + 2 * d[..., i] - trace
        K[..., 0, i + 1] = K[..., i + 1, 0] = R[..., k, j] - R[..., j, k]
        K[..., j + 1, k + 1] = K[..., k + 1, j + 1] = R[..., j, k] + R[..., k, j]
    best = np.argmax(np.diagonal(K, axis1=-2, axis2=-1), axis=-1)
    quat = np.take_along_axis(K, best[..., None, None], axis=-2)[..., 0, :]
    quat = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
    return np.where(quat[..., :1] < 0, -quat, quat)
