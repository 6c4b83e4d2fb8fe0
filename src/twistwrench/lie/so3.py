"""Rotations: so(3) and SO(3). Any leading batch shape; Modern Robotics section 3.2.

Largest error of an entry against 50-digit arithmetic, 400 random rotations of angle up to π: ``exp`` 7.3e-16, ``log``
6.7e-16, ``left_jacobian`` 2.8e-16, ``left_jacobian_inverse`` 1.8e-16. Beyond π the rounding of the angle itself, eps |w|, is
added. The bounds are asserted in ``tests/test_lie_accuracy.py``.

What is not real numbers of the shape said is a :class:`~twistwrench.ShapeError` or :class:`~twistwrench.ValueRangeError`; a
row with NaN gives a row of NaN.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from . import quaternion, series
from .quadratic import angle, quadratic, within_reach

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Array = NDArray[Any]

__all__ = [
    "as_scipy",
    "cross",
    "exp",
    "from_scipy",
    "hat",
    "left_jacobian",
    "left_jacobian_inverse",
    "log",
    "project",
    "vee",
]


def hat(w: ArrayLike) -> Array:
    """The skew-symmetric matrix [w], with ``[w] x = w × x``; (..., 3) → (..., 3, 3). MR eq. 3.30.

    >>> hat([1, 2, 3]).tolist()
    [[0.0, -3.0, 2.0], [3.0, 0.0, -1.0], [-2.0, 1.0, 0.0]]
    """
    w = arguments.array(w, "so3.hat: w", 3)
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*w.shape, 3)


def vee(W: ArrayLike) -> Array:
    """The vector w of a skew-symmetric matrix [w]; (..., 3, 3) → (..., 3)."""
    W = arguments.array(W, "so3.vee: W", 3, 3)
    return np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], axis=-1)


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """a × b; (..., 3), (..., 3) → (..., 3). Works on any element type, symbols included."""
    a, b = arguments.array(a, "so3.cross: a", 3), arguments.array(b, "so3.cross: b", 3)
    (a0, a1, a2), (b0, b1, b2) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    try:
        return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)
    except ValueError:
        arguments.together(a=a, b=b)
        raise


def exp(w: ArrayLike) -> Array:
    """The rotation matrix of the exponential coordinates w = ω̂θ; (..., 3) → (..., 3, 3). MR eq. 3.51.

    Of any finite length: past 1e16 rad the angle is lost in the rounding of w, and what comes is some turn about its axis.

    >>> import numpy as np
    >>> np.allclose(exp([0, 0, np.pi / 2]) @ [1, 0, 0], [0, 1, 0])
    True
    """
    w, theta = within_reach(arguments.real(w, "so3.exp: w", 3))
    return quadratic(w, series.sinc(theta), series.one_minus_cos_over_square(theta))


def log(R: ArrayLike) -> Array:
    """Exponential coordinates of a rotation matrix, 0 ≤ |w| ≤ π; (..., 3, 3) → (..., 3).

    Through the quaternion, so right at every angle, π and its neighbours included; at π itself w and -w are the same
    rotation, and one of them is returned. A matrix that is no rotation is a :class:`~twistwrench.ValueRangeError`.

    >>> log([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).round(12).tolist()
    [0.0, 0.0, 1.570796326795]
    """
    R = arguments.rotation(arguments.real(R, "so3.log: R", 3, 3), "so3.log: R")
    return quaternion.log(quaternion.from_matrix(R)).astype(R.dtype, copy=False)


def left_jacobian(w: ArrayLike) -> Array:
    """J with exp(w + dw) = exp(J dw) exp(w) to first order; (..., 3) → (..., 3, 3).

    It turns rates of the coordinates into the angular velocity in {s}: ω_s = J(w) dw/dt.

    >>> left_jacobian([0, 0, 0]).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, theta = within_reach(arguments.real(w, "so3.left_jacobian: w", 3))
    return quadratic(w, series.one_minus_cos_over_square(theta), series.theta_minus_sin_over_cube(theta))


def left_jacobian_inverse(w: ArrayLike) -> Array:
    """Inverse of :func:`left_jacobian`; (..., 3) → (..., 3, 3). Grows without bound as |w| nears 2π, 4π, …

    Lengths beyond 1e77 overflow.

    >>> w = [0.3, -2.0, 1.0]
    >>> bool(abs(left_jacobian(w) @ left_jacobian_inverse(w) - np.eye(3)).max() < 1e-15)
    True
    """
    w = arguments.real(w, "so3.left_jacobian_inverse: w", 3)
    theta = angle(w)
    return quadratic(w, np.full_like(theta, -0.5), series.cot_term(theta))


def project(M: ArrayLike, within: float = 0.1) -> Array:
    """The rotation nearest to a matrix (in the Frobenius norm), by its singular values; (..., 3, 3) → (..., 3, 3).

    A matrix with an entry further than ``within`` from that rotation is a :class:`~twistwrench.ValueRangeError` that says
    how far: it is not a rotation with rounding. A reflection is always at least 2/3 away.

    >>> project([[0.707, -0.707, 0], [0.707, 0.707, 0], [0, 0, 1]]).round(9)[0].tolist()
    [0.707106781, -0.707106781, 0.0]
    """
    M, within = arguments.real(M, "so3.project: M", 3, 3), arguments.number(within, "so3.project: within")
    solvable = np.isfinite(M).all(axis=(-2, -1), keepdims=True)  # LAPACK would refuse the whole batch
    U, _, Vt = np.linalg.svd(np.where(solvable, M, np.eye(3, dtype=M.dtype)))
    U[..., :, 2] *= np.where(np.linalg.det(U @ Vt) < 0, -1, 1)[..., None]
    R = np.where(solvable, U @ Vt, np.nan)
    arguments.refuse(
        np.where(np.isinf(M), np.inf, np.abs(R - M)),
        within,
        "so3.project: not a rotation with rounding: the nearest one is {gap:.3g} away, allowed {allowed:g}",
    )
    return np.asarray(R, M.dtype)


def as_scipy(R: ArrayLike) -> Rotation:
    """The ``scipy.spatial.transform.Rotation`` of a rotation matrix (..., 3, 3). Needs a rotation, as :func:`log` does.

    >>> as_scipy(exp([0, 0, 0.5])).as_rotvec().round(12).tolist()
    [0.0, 0.0, 0.5]
    """
    from scipy.spatial.transform import Rotation

    M = arguments.rotation(arguments.finite(R, "so3.as_scipy: R", 3, 3), "so3.as_scipy: R")
    return Rotation.from_matrix(np.require(M, requirements="W"))  # SciPy 1.13 takes no arrays that are read-only


def from_scipy(rotation: Rotation) -> Array:
    """The rotation matrix (..., 3, 3) of a ``scipy.spatial.transform.Rotation``."""
    return arguments.as_matrix(rotation, "so3.from_scipy", "scipy.spatial.transform.Rotation")
