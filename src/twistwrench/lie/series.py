"""The trigonometric quotients of exp, log and the left Jacobians, right for every angle.

This is the only file with small-angle thresholds. Each function takes theta >= 0 of any shape. Below its switch a
Taylor series in theta**2 is used, long enough that the first term left out is under 1e-17 relative at the switch.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["cot_term", "one_minus_cos_over_square", "sinc", "theta_minus_sin_over_cube"]


def sinc(theta: Array) -> Array:
    """sin(theta) / theta."""
    return np.sinc(np.asarray(theta) / np.pi)


def one_minus_cos_over_square(theta: Array) -> Array:
    """(1 - cos theta) / theta**2, by half angles: no cancellation at any angle, so no series."""
    return 0.5 * sinc(0.5 * np.asarray(theta)) ** 2


def _switched(theta: Array, switch: float, coefficients: tuple[float, ...], closed: Any) -> Array:
    theta = np.asarray(theta, float)
    small = theta < switch
    safe = np.where(small, 1.0, theta)
    return np.where(
        small, np.polynomial.polynomial.polyval(np.where(small, theta, 0.0) ** 2, coefficients), closed(safe)
    )


# sum (-1)^k x^k / (2k+3)!; at theta = 1 the 9th term left out is 1/21! = 2e-20.
_CUBE = tuple((-1.0) ** k / float(np.prod(np.arange(1.0, 2 * k + 4))) for k in range(9))


def theta_minus_sin_over_cube(theta: Array) -> Array:
    """(theta - sin theta) / theta**3."""
    return _switched(theta, 1.0, _CUBE, lambda t: (t - np.sin(t)) / t**3)


# Bernoulli numbers |B_2k| / (2k)!: the expansion of (1 - (t/2) cot(t/2)) / t**2.
_COT = (1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160, 691 / 1307674368000, 1 / 74724249600,
        3617 / 10670622842880000, 43867 / 5109094217170944000)  # fmt: skip


def cot_term(theta: Array) -> Array:
    """(1 - (theta/2) cot(theta/2)) / theta**2: the coefficient of [w]**2 in the inverse left Jacobian."""
    return _switched(theta, 0.6, _COT, lambda t: (1.0 - 0.5 * t / np.tan(0.5 * t)) / t**2)
