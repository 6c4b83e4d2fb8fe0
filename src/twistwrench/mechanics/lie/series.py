"""Trigonometric quotients of exp, log and the left Jacobians, and their slopes, accurate for every angle.

This is the only file with small-angle thresholds. Each function takes theta >= 0 of any shape. Below ``SWITCH`` a Taylor
series in theta**2 is used, whose first omitted term is below 1e-17 relative at the switch. Above it the closed form loses
little to cancellation. The slope of f is f'(theta) / theta, twice its derivative with respect to theta**2. The SE(3)
Jacobians need it, because they are directional derivatives of the SO(3) Jacobians.

Largest relative error measured against 120-digit arithmetic, 6300 angles from 1e-10 to 3.14, densest at the switch, in
units of eps = 2.2e-16: sinc 0.9, one_minus_cos_over_square 1.6, theta_minus_sin_over_cube 1.2, cot_term 1.2,
one_minus_cos_slope 3.2, theta_minus_sin_slope 3.0, cot_slope 21 (its factors reduce this to under 1 eps in the results).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ...core.typing import Array

Coefficients = tuple[float, ...]

SWITCH = 2.5
"""Angle [rad] below which series are used."""


def cot_coefficients(terms: int) -> Coefficients:
    """Coefficients of (1 - (t/2) cot(t/2)) / t**2: positive, by the recurrence of y = x cot x, x y' = y - y² - x²."""
    a = [0.0, 1.0 / 3.0]  # y = 1 - sum a_k x^2k
    for k in range(2, terms + 1):
        a.append(sum(a[j] * a[k - j] for j in range(1, k)) / (2 * k + 1))
    return tuple(a[k] * 0.25**k for k in range(1, terms + 1))


def _slope(coefficients: Coefficients) -> Coefficients:
    return tuple(2.0 * k * c for k, c in enumerate(coefficients) if k)


_COS = tuple((-1.0) ** k / math.factorial(2 * k + 2) for k in range(16))
_SIN = tuple((-1.0) ** k / math.factorial(2 * k + 3) for k in range(16))
_COT = cot_coefficients(25)  # successive terms decrease by 2.5² / (2π)² = 0.16 at the switch


def _switched(theta: ArrayLike, coefficients: Coefficients, closed: Callable[[Array], Array]) -> Array:
    """Series below the switch, closed form above; each is evaluated only at its own angles."""
    theta = np.asarray(theta)
    small = theta < SWITCH
    if small.all():
        return np.asarray(np.polynomial.polynomial.polyval(theta * theta, coefficients))
    if not small.any():
        return np.asarray(closed(theta))
    out = np.empty_like(theta)
    out[small] = np.polynomial.polynomial.polyval(theta[small] ** 2, coefficients)
    out[~small] = closed(theta[~small])
    return out


def sinc(theta: ArrayLike) -> Array:
    """sin(theta) / theta."""
    theta = np.asarray(theta)
    safe = np.where(theta == 0, 1, theta)
    return np.where(theta == 0, 1, np.sin(safe) / safe)


def one_minus_cos_over_square(theta: ArrayLike) -> Array:
    """(1 - cos theta) / theta**2 by half angles: free of cancellation at every angle, so without series."""
    return np.asarray(0.5 * sinc(0.5 * np.asarray(theta)) ** 2)


def theta_minus_sin_over_cube(theta: ArrayLike) -> Array:
    """(theta - sin theta) / theta**3."""
    return _switched(theta, _SIN, lambda t: (t - np.sin(t)) / t**3)


def cot_term(theta: ArrayLike) -> Array:
    """(1 - (theta/2) cot(theta/2)) / theta**2: coefficient of [w]**2 in the inverse left Jacobian."""
    return _switched(theta, _COT, lambda t: (1.0 - 0.5 * t / np.tan(0.5 * t)) / t**2)


def one_minus_cos_slope(theta: ArrayLike) -> Array:
    """Slope of :func:`one_minus_cos_over_square`: (theta sin theta - 2 (1 - cos theta)) / theta**4."""
    return _switched(theta, _slope(_COS), lambda t: (sinc(t) - sinc(0.5 * t) ** 2) / t**2)


def theta_minus_sin_slope(theta: ArrayLike) -> Array:
    """Slope of :func:`theta_minus_sin_over_cube`: (theta (1 - cos theta) - 3 (theta - sin theta)) / theta**5."""
    return _switched(theta, _slope(_SIN), lambda t: (3.0 * sinc(t) - np.cos(t) - 2.0) / t**4)


def cot_slope(theta: ArrayLike) -> Array:
    """Slope of :func:`cot_term`: ((theta/2)² / sin²(theta/2) + (theta/2) cot(theta/2) - 2) / theta**4."""

    def closed(t: Array) -> Array:
        h = 0.5 * t
        return np.asarray(((h / np.sin(h)) ** 2 + h / np.tan(h) - 2.0) / t**4)

    return _switched(theta, _slope(_COT), closed)


# ── Matrices 1 + a [w] + b [w]²: exponentials and Jacobians of SO(3), and blocks of those of SE(3)


def angle(w: Array) -> Array:
    """|w|; (..., 3) → (...)."""
    return np.asarray(np.sqrt(np.sum(w * w, axis=-1)))


_REACH = {np.dtype(kind): np.finfo(kind).max ** 0.25 for kind in (np.float32, np.float64)}


def within_reach(w: Array) -> tuple[Array, Array]:
    """w and |w|; a w too long for powers of |w| is shortened along its axis to the fourth root of the largest float.

    That is 1e77, or 4e9 in float32. The rounding error of such a w exceeds many turns, so any angle is equally valid, and the
    left Jacobian equals its limit ŵ ŵ' to the last digit.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        theta = angle(w)
        limit = _REACH[w.dtype]
        if np.fmax.reduce(theta, axis=None, initial=0.0) > limit:
            far = theta > limit
            u = w[far] / np.abs(w[far]).max(axis=-1, keepdims=True)  # infinity has no direction: the result is NaN
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
    """Derivative of 1 + a [w] + b [w]² as w moves along v, if a and b have the slopes da and db; → (..., 3, 3).

    a [v] + b ([w][v] + [v][w]) + (w·v) (da [w] + db [w]²), with [w][v] + [v][w] = w v' + v w' - 2 w·v.
    """
    s = np.sum(w * v, axis=-1)  # half the rate of |w|²
    outer = (b[..., None] * w)[..., :, None] * v[..., None, :]
    out = quadratic(v, a, np.zeros_like(a), 0.0) + quadratic(w, s * da, s * db, 0.0)
    out += outer + np.swapaxes(outer, -1, -2)
    diagonal = np.einsum("...ii->...i", out)
    diagonal -= (2.0 * b * s)[..., None]
    return out
