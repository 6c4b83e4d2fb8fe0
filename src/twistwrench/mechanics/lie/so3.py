"""Rotations: so(3) and SO(3). Any leading batch shape; Modern Robotics section 3.2.

Largest error of an entry against 50-digit arithmetic, 400 random rotations of angle up to π: ``exp`` 1.1e-15, ``log``
8.9e-16, ``left_jacobian`` 2.8e-16, ``left_jacobian_inverse`` 1.8e-16. Above π the rounding error of the angle itself,
eps |w|, is added. ``tests/lie/test_lie_accuracy.py`` asserts these bounds.

Input of another shape raises :class:`~twistwrench.ShapeError`, input other than real numbers
:class:`~twistwrench.ValueRangeError`; a row with NaN gives a row of NaN.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ShapeError
from ...core.glossary import complete
from ...core.typing import Array, Rotations
from . import compiled_forms, quaternion, series
from .series import angle, quadratic, within_reach

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

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
    """Skew-symmetric matrix [w] of a vector, with ``[w] x = w × x`` (MR eq. 3.30).

    Parameters
    ----------
    w : (..., 3) array_like

    Returns
    -------
    W : (..., 3, 3) array

    Examples
    --------
    >>> hat([1, 2, 3]).tolist()
    [[0.0, -3.0, 2.0], [3.0, 0.0, -1.0], [-2.0, 1.0, 0.0]]
    """
    w = arguments.array(w, "so3.hat: w", 3)
    if w.ndim == 1:  # for three numbers, floats are faster than NumPy
        x, y, z = w.tolist()
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], w.dtype)
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    W = np.zeros((*w.shape, 3), w.dtype)
    W[..., 2, 1] = x
    W[..., 0, 2] = y
    W[..., 1, 0] = z
    W[..., 1, 2] = -x
    W[..., 2, 0] = -y
    W[..., 0, 1] = -z
    return W


def vee(W: ArrayLike) -> Array:
    """Vector w of a skew-symmetric matrix [w], the inverse of :func:`hat`.

    Parameters
    ----------
    W : (..., 3, 3) array_like

    Returns
    -------
    w : (..., 3) array

    Examples
    --------
    >>> vee(hat([1, 2, 3])).tolist()
    [1.0, 2.0, 3.0]
    """
    W = arguments.array(W, "so3.vee: W", 3, 3)
    if W.ndim == 2:
        return np.array([W[2, 1], W[0, 2], W[1, 0]], W.dtype)
    return np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], axis=-1)


def cross(a: ArrayLike, b: ArrayLike) -> Array:
    """Cross product a × b of vectors.

    Parameters
    ----------
    a, b : (..., 3) array_like of any element type, symbols included

    Returns
    -------
    c : (..., 3) array

    Examples
    --------
    >>> cross([1, 0, 0], [0, 1, 0]).tolist()
    [0.0, 0.0, 1.0]
    """
    a = arguments.array(a, "so3.cross: a", 3)
    b = arguments.array(b, "so3.cross: b", 3)
    if a.ndim == b.ndim == 1 and a.dtype == b.dtype:  # for three numbers, floats are faster than NumPy
        (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
        return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], a.dtype)
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    try:
        return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=-1)
    except ValueError:  # batches that do not fit
        arguments.together(a=a, b=b)  # raises ShapeError
        raise


def exp(w: ArrayLike) -> Rotations:
    """Matrix exponential of so(3): rotation matrix of exponential coordinates w = ω̂θ.

    Notes
    -----
    MR eq. 3.51. Any finite length is accepted. Above 1e16 rad the rounding error of w exceeds a full turn, so the result is
    an arbitrary rotation about the axis.

    Examples
    --------
    >>> import numpy as np
    >>> np.allclose(exp([0, 0, np.pi / 2]) @ [1, 0, 0], [0, 1, 0])
    True
    """
    return compiled_forms.exponential("rotation_exp", arguments.real(w, "so3.exp: w", 3), _exp)


def _exp(w: Array) -> Array:
    w, theta = within_reach(w)
    return quadratic(w, series.sinc(theta), series.one_minus_cos_over_square(theta))


def log(R: ArrayLike) -> Array:
    """Matrix logarithm of SO(3): exponential coordinates of a rotation matrix, 0 ≤ |w| ≤ π.

    Computed from the quaternion, so accurate at every angle, including π. At π, w and -w describe the same rotation, and one
    of the two is returned. MR section 3.2.3.3.

    Returns
    -------
    w : (..., 3) array [rad]

    Examples
    --------
    >>> log([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).round(12).tolist()
    [0.0, 0.0, 1.570796326795]
    """
    R = arguments.real(R, "so3.log: R", 3, 3)
    return compiled_forms.logarithm("rotation_log", R, lambda R: arguments.rotation(R, "so3.log: R"), _log)


def _log(R: Array) -> Array:
    return quaternion.log(quaternion.from_matrix(R)).astype(R.dtype, copy=False)


def left_jacobian(w: ArrayLike) -> Array:
    """Left Jacobian of SO(3): J with exp(w + dw) = exp(J dw) exp(w) to first order.

    It maps rates of the coordinates to the angular velocity in {s}: ω_s = J(w) dw/dt.

    Returns
    -------
    J : (..., 3, 3) array

    Examples
    --------
    >>> left_jacobian([0, 0, 0]).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, theta = within_reach(arguments.real(w, "so3.left_jacobian: w", 3))
    return quadratic(w, series.one_minus_cos_over_square(theta), series.theta_minus_sin_over_cube(theta))


def left_jacobian_inverse(w: ArrayLike) -> Array:
    """Inverse of the left Jacobian of SO(3); see :func:`left_jacobian`.

    Unbounded as |w| approaches 2π, 4π, … Overflows if w is longer than 1e77.

    Returns
    -------
    J : (..., 3, 3) array

    Examples
    --------
    >>> w = [0.3, -2.0, 1.0]
    >>> bool(abs(left_jacobian(w) @ left_jacobian_inverse(w) - np.eye(3)).max() < 1e-15)
    True
    """
    w = arguments.real(w, "so3.left_jacobian_inverse: w", 3)
    theta = angle(w)
    return quadratic(w, np.full_like(theta, -0.5), series.cot_term(theta))


def project(M: ArrayLike, within: float = 0.1) -> Rotations:
    """Nearest rotation to a matrix (in the Frobenius norm), by singular value decomposition.

    The distance to a reflection is always at least 2/3.

    Parameters
    ----------
    M : (..., 3, 3) array_like
    within : float, largest allowed deviation of an entry

    Examples
    --------
    >>> project([[0.707, -0.707, 0], [0.707, 0.707, 0], [0, 0, 1]]).round(9)[0].tolist()
    [0.707106781, -0.707106781, 0.0]
    """
    M = arguments.real(M, "so3.project: M", 3, 3)
    within = arguments.number(within, "so3.project: within")
    is_finite = np.isfinite(M).all(axis=(-2, -1), keepdims=True)
    finite_M = np.where(is_finite, M, np.eye(3, dtype=M.dtype))  # one NaN would make LAPACK fail for the whole batch
    U, _, Vt = np.linalg.svd(finite_M)
    sign = np.where(np.linalg.det(U @ Vt) < 0, -1, 1)
    U[..., :, 2] *= sign[..., None]  # a rotation, not a reflection
    R = np.where(is_finite, U @ Vt, np.nan)
    deviation = np.where(np.isinf(M), np.inf, np.abs(R - M))
    arguments.refuse(
        deviation,
        within,
        "so3.project: not a rotation with rounding: the nearest one is {gap} away, allowed {allowed}",
    )
    return np.asarray(R, M.dtype)


def as_scipy(R: ArrayLike) -> Rotation:
    """SciPy's ``Rotation`` of a rotation matrix.

    Returns
    -------
    rotation : scipy.spatial.transform.Rotation

    Raises
    ------
    ShapeError
        The batch is empty, and this SciPy version does not support empty batches.

    Examples
    --------
    >>> as_scipy(exp([0, 0, 0.5])).as_rotvec().round(12).tolist()
    [0.0, 0.0, 0.5]
    """
    from scipy.spatial.transform import Rotation

    finite_R = arguments.finite(R, "so3.as_scipy: R", 3, 3)
    M = arguments.rotation(finite_R, "so3.as_scipy: R")
    try:
        return Rotation.from_matrix(np.require(M, requirements="W"))  # SciPy 1.13 rejects read-only arrays
    except ValueError:
        if M.size:
            raise
        raise ShapeError(
            f"so3.as_scipy: R has shape {M.shape}, and this version of SciPy makes no empty Rotation."
        ) from None


def from_scipy(rotation: Rotation) -> Rotations:
    """Rotation matrix of SciPy's ``Rotation``.

    Parameters
    ----------
    rotation : scipy.spatial.transform.Rotation

    Examples
    --------
    >>> bool(np.allclose(from_scipy(as_scipy(exp([0, 0, 0.5]))), exp([0, 0, 0.5])))
    True
    """
    return arguments.matrix_of_rotation(rotation, "so3.from_scipy", "scipy.spatial.transform.Rotation")


complete(globals())
