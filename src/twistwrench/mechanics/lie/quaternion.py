"""Unit quaternions (w, x, y, z), scalar first, with any leading batch shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ValueRangeError
from ...core.typing import Array
from . import series
from .series import within_reach


def rotation(quat: ArrayLike) -> Array:
    """Rotation matrix of a quaternion of length 1e-150 to 1e150, also of symbols; (..., 4) → (..., 3, 3).

    A zero quaternion raises :class:`~twistwrench.ValueRangeError`.
    """
    quat = arguments.array(quat, "quaternion.rotation: quat", 4)
    # The factor square / square is 1, or NaN if the square overflows. Without it, an overflow would give a wrong rotation.
    if quat.ndim == 1 and quat.dtype == np.float64:  # for four numbers, floats are faster than NumPy
        w, x, y, z = quat.tolist()
        square = w * w + x * x + y * y + z * z
        if square == 0.0:
            _require_nonzero(np.zeros(()), "quaternion.rotation: quat")  # a size of zero, which raises
        nine_numbers = entries(w, x, y, z, 2.0 / square * (square / square))
        return np.array(nine_numbers).reshape(3, 3)
    w, x, y, z = (quat[..., k] for k in range(4))
    square = w * w + x * x + y * y + z * z
    if quat.dtype != object:
        _require_nonzero(square, "quaternion.rotation: quat")
    nine_entries = entries(w, x, y, z, 2.0 / square * (square / square))
    return np.stack(nine_entries, axis=-1).reshape(*quat.shape[:-1], 3, 3)


def entries(w: Any, x: Any, y: Any, z: Any, s: Any) -> list[Any]:
    """Nine entries of the rotation matrix row by row, s = 2 / squared length; for numbers, arrays and symbols."""
    sx, sy, sz = s * x, s * y, s * z
    wx, wy, wz = w * sx, w * sy, w * sz  # these and all other products contain s
    xx, xy, xz = x * sx, x * sy, x * sz
    yy, yz, zz = y * sy, y * sz, z * sz
    return [
        *(1 - (yy + zz), xy - wz, xz + wy),
        *(xy + wz, 1 - (xx + zz), yz - wx),
        *(xz - wy, yz + wx, 1 - (xx + yy)),
    ]


def multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Product a b (first b, then a); (..., 4), (..., 4) → (..., 4)."""
    a = arguments.array(a, "quaternion.multiply: a", 4)
    b = arguments.array(b, "quaternion.multiply: b", 4)
    a0, a1, a2, a3 = (a[..., k] for k in range(4))
    b0, b1, b2, b3 = (b[..., k] for k in range(4))
    try:
        return np.stack(
            [
                a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
                a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
                a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
                a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
            ],
            axis=-1,
        )
    except ValueError:
        arguments.together(a=a, b=b)  # raises ShapeError if the batch shapes do not fit
        raise


def exp(w: ArrayLike) -> Array:
    """Unit quaternion of the exponential coordinates w; (..., 3) → (..., 4)."""
    w = np.asarray(arguments.real(w, "quaternion.exp: w", 3), float)
    w, angle = within_reach(w)  # angle: |w|
    half_angle = 0.5 * angle[..., None]
    return np.concatenate([np.cos(half_angle), 0.5 * series.sinc(half_angle) * w], axis=-1)


def log(quat: ArrayLike) -> Array:
    """Exponential coordinates, 0 ≤ |w| ≤ π, of a quaternion of any nonzero length; (..., 4) → (..., 3).

    A zero quaternion raises :class:`~twistwrench.ValueRangeError`.
    """
    q = np.asarray(arguments.real(quat, "quaternion.log: quat", 4), float)
    largest_entry = np.abs(q).max(axis=-1, keepdims=True, initial=0.0)
    _require_nonzero(largest_entry[..., 0], "quaternion.log: quat")
    _, exponent = np.frexp(largest_entry)  # of two
    q = np.ldexp(q, -exponent)  # divided by a power of two, so that squares neither overflow nor underflow
    q = np.where(q[..., :1] < 0, -q, q)  # the same rotation, by the angle up to π
    w, v = q[..., :1], q[..., 1:]
    norm = np.linalg.norm(v, axis=-1, keepdims=True)
    is_tiny = norm < _MIN_NORM
    angle = 2.0 * np.arctan2(norm, w)
    limit_of_ratio = 2.0 / np.where(w == 0, 1.0, w)  # of angle / norm for small norms
    ratio = angle / np.where(is_tiny, 1.0, norm)
    return v * np.where(is_tiny, limit_of_ratio, ratio)


_MIN_NORM = 1e-150
"""Norm of the vector part below which the quotient angle / norm is replaced by its limit."""


def _require_nonzero(size: Array, what: str) -> None:
    """Raise ValueRangeError if a quaternion is zero; ``what`` names the argument.

    ``size`` (...) are norms, squared norms or largest entries of the quaternions.
    """
    if not size.all():  # NaN counts as true
        first_zero = np.argwhere(size == 0)[0]
        row = tuple(map(int, first_zero))  # empty for a single quaternion
        row_text = f" in row {row}" if row else ""
        raise ValueRangeError(f"{what} is zero{row_text}, which is not a rotation; the identity is (1, 0, 0, 0).")


_MATRIX = "quaternion.from_matrix: R"
"""Name of the argument in messages."""


def from_matrix(R: ArrayLike) -> Array:
    """Unit quaternion (w ≥ 0) of a rotation matrix, by the best of four formulas; (..., 3, 3) → (..., 4).

    A matrix that is not a rotation raises :class:`~twistwrench.ValueRangeError`, whose message gives the deviation.
    Source: Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
    """
    real_R = arguments.real(R, _MATRIX, 3, 3)
    R = np.asarray(arguments.rotation(real_R, _MATRIX), float)
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    trace = diagonal.sum(-1)
    # K = 4 q q' is linear in R. Its row k is 4 q_k q; the row of the largest q_k has the least rounding error.
    K = np.empty((*R.shape[:-2], 4, 4))
    K[..., 0, 0] = 1 + trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3  # the axes after i
        K[..., i + 1, i + 1] = 1 + 2 * diagonal[..., i] - trace
        K[..., 0, i + 1] = K[..., i + 1, 0] = R[..., k, j] - R[..., j, k]
        K[..., j + 1, k + 1] = K[..., k + 1, j + 1] = R[..., j, k] + R[..., k, j]
    squares = np.diagonal(K, axis1=-2, axis2=-1)  # 4 q_k²
    best_row = np.argmax(squares, axis=-1)
    chosen_rows = np.take_along_axis(K, best_row[..., None, None], axis=-2)  # (..., 1, 4)
    quat = chosen_rows[..., 0, :]
    quat = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
    return np.where(quat[..., :1] < 0, -quat, quat)  # w ≥ 0
