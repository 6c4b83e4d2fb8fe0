"""The matrices 1 + a [w] + b [w]²: every exponential and Jacobian of SO(3) is one, and those of SE(3) are made of them."""

from __future__ import annotations

import numpy as np

from ..typing import Array


def angle(w: Array) -> Array:
    """|w|; (..., 3) → (...)."""
    return np.asarray(np.sqrt(np.sum(w * w, axis=-1)))


_REACH = {np.dtype(kind): np.finfo(kind).max ** 0.25 for kind in (np.float32, np.float64)}


def within_reach(w: Array) -> tuple[Array, Array]:
    """w and |w|, where a w too long for powers of |w| is shortened along its axis to the fourth root of the largest float.

    That is 1e77, or 4e9 in float32: there the rounding of w exceeds many turns, so any angle is as right as another, and
    the left Jacobian is its limit ŵ ŵ' to the last digit.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        theta = angle(w)
        limit = _REACH[w.dtype]
        if np.fmax.reduce(theta, axis=None, initial=0.0) > limit:
            far = theta > limit
            u = w[far] / np.abs(w[far]).max(axis=-1, keepdims=True)  # infinity has no direction: NaN
            w = w.copy()
            w[far] = limit / angle(u)[..., None] * u
            theta = np.where(far, angle(w), theta)
    return w, theta


def quadratic(w: Array, a: Array, b: Array, constant: float = 1.0) -> Array:
    """constant + a [w] + b [w]², entry by entry; (..., 3), (...), (...) → (..., 3, 3)."""
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    ax, ay, az, bx, by = a * x, a * y, a * z, b * x, b * y
    xx, xy, xz, yy, yz, zz = bx * x, bx * y, bx * z, by * y, by * z, b * z * z
    out = np.empty((*w.shape, 3), w.dtype)
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = constant - (yy + zz), xy - az, xz + ay
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = xy + az, constant - (xx + zz), yz - ax
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = xz - ay, yz + ax, constant - (xx + yy)
    return out


def slope(w: Array, v: Array, a: Array, b: Array, da: Array, db: Array) -> Array:
    """The derivative of 1 + a [w] + b [w]² as w moves along v, where a and b have the slopes da and db; → (..., 3, 3).

    a [v] + b ([w][v] + [v][w]) + (w·v) (da [w] + db [w]²), with [w][v] + [v][w] = w v' + v w' - 2 w·v.
    """
    s = np.sum(w * v, axis=-1)  # half the rate of |w|²
    outer = (b[..., None] * w)[..., :, None] * v[..., None, :]
    out = quadratic(v, a, np.zeros_like(a), 0.0) + quadratic(w, s * da, s * db, 0.0)
    out += outer + np.swapaxes(outer, -1, -2)
    diagonal = np.einsum("...ii->...i", out)
    diagonal -= (2.0 * b * s)[..., None]
    return out
