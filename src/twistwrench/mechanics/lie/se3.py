"""Rigid motions: se(3) and SE(3). Twists are (omega, v), angular part first; Modern Robotics section 3.3.

Any leading batch shape. ``T_ab`` is the pose of frame {b} seen from {a}. Largest error of an entry against 50-digit
arithmetic, 400 random twists of angle up to π and |v| = 1: ``exp`` 1.1e-15, ``log`` 8.9e-16, ``left_jacobian`` 2.8e-16,
``left_jacobian_inverse`` 2.3e-16; linear in |v|. ``tests/lie/test_lie_accuracy.py`` asserts these bounds. Invalid input and
NaN are handled as in :mod:`~twistwrench.so3`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.arguments import gaps
from ...core.errors import MissingExtraError
from ...core.glossary import complete
from ...core.typing import Array, Poses, Twists
from . import compiled_forms, series, so3
from .adjoint import Ad, ad
from .half_angles import cotangent_quotient, half_angle, half_turn, short_way
from .series import angle, quadratic, slope, within_reach
from .so3 import cross

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

__all__ = [
    "Ad",
    "ad",
    "as_scipy",
    "exp",
    "from_scipy",
    "hat",
    "inverse",
    "left_jacobian",
    "left_jacobian_inverse",
    "log",
    "pose",
    "project",
    "vee",
]


def pose(R: ArrayLike, p: ArrayLike) -> Poses:
    """Homogeneous transform, 4×4, from a rotation and a position.

    Parameters
    ----------
    R : (..., 3, 3) array_like, rotation, may be symbolic
    p : (..., 3) array_like, position [m]

    Examples
    --------
    >>> pose(np.eye(3), [1, 2, 3])[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    R = arguments.array(R, "se3.pose: R", 3, 3)
    p = arguments.array(p, "se3.pose: p", 3)
    if R.shape[:-2] != p.shape[:-1]:
        R, p = _broadcast(R, p)
    T = np.empty((*p.shape[:-1], 4, 4), np.result_type(R, p))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, :3] = 0.0
    T[..., 3, 3] = 1.0
    return T


def hat(V: ArrayLike) -> Array:
    """Matrix [V] of se(3), 4×4, of a twist (MR eq. 3.71).

    Returns
    -------
    X : (..., 4, 4) array

    Examples
    --------
    >>> hat([1, 2, 3, 4, 5, 6])[:3].tolist()
    [[0.0, -3.0, 2.0, 4.0], [3.0, 0.0, -1.0, 5.0], [-2.0, 1.0, 0.0, 6.0]]
    """
    V = arguments.array(V, "se3.hat: V", 6)
    if V.ndim == 1:  # for six numbers, floats are faster than NumPy
        x, y, z, u, v, w = V.tolist()
        return np.array([[0.0, -z, y, u], [z, 0.0, -x, v], [-y, x, 0.0, w], [0.0, 0.0, 0.0, 0.0]], V.dtype)
    X = np.zeros((*V.shape[:-1], 4, 4), V.dtype)
    X[..., :3, :3] = so3.hat(V[..., :3])
    X[..., :3, 3] = V[..., 3:]
    return X


def vee(X: ArrayLike) -> Twists:
    """Twist of a 4×4 matrix [V], the inverse of :func:`hat`.

    Parameters
    ----------
    X : (..., 4, 4) array_like

    Examples
    --------
    >>> vee(hat([0, 0, 1, 2, 3, 4])).tolist()
    [0.0, 0.0, 1.0, 2.0, 3.0, 4.0]
    """
    X = arguments.array(X, "se3.vee: X", 4, 4)
    if X.ndim == 2:  # for one matrix, this is faster than NumPy operations
        return np.array([X[2, 1], X[0, 2], X[1, 0], X[0, 3], X[1, 3], X[2, 3]], X.dtype)
    return np.concatenate([so3.vee(X[..., :3, :3]), X[..., :3, 3]], axis=-1)


def inverse(T: ArrayLike) -> Poses:
    """Inverse of a pose: T_ba from T_ab, by transposing the rotation (MR eq. 3.64).

    Parameters
    ----------
    T : (..., 4, 4) array_like, T_ab, may be symbolic

    Examples
    --------
    >>> inverse(exp([0, 0, 0, 1, 2, 3]))[:3, 3].tolist()
    [-1.0, -2.0, -3.0]
    """
    T = arguments.pose(T, "se3.inverse: T")
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    p_column = T[..., :3, 3, None]
    return pose(Rt, -(Rt @ p_column)[..., 0])


def exp(V: ArrayLike) -> Poses:
    """Matrix exponential of se(3): pose reached by following the twist V for unit time.

    Notes
    -----
    MR eq. 3.88.

    Examples
    --------
    >>> exp([0, 0, 0, 1, 2, 3])[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    return compiled_forms.exponential("pose_exp", arguments.real(V, "se3.exp: V", 6), _exp)


def _exp(V: Array) -> Array:
    """Poses (..., 4, 4) of twists (..., 6)."""
    w, theta = within_reach(V[..., :3])
    v = V[..., 3:]
    b = series.one_minus_cos_over_square(theta)
    c = series.theta_minus_sin_over_cube(theta)
    wv = so3.cross(w, v)
    T = np.zeros((*V.shape[:-1], 4, 4), V.dtype)
    T[..., :3, :3] = quadratic(w, series.sinc(theta), b)
    T[..., :3, 3] = v + b[..., None] * wv + c[..., None] * so3.cross(w, wv)  # left_jacobian(w) v
    T[..., 3, 3] = 1
    return T


def log(T: ArrayLike) -> Twists:
    """Matrix logarithm of SE(3): twist with |omega| ≤ π that leads from the identity to T in unit time.

    Notes
    -----
    MR section 3.3.3.2.

    Examples
    --------
    >>> log(exp([0.1, 0.2, 0.3, 4, 5, 6])).round(12).tolist()
    [0.1, 0.2, 0.3, 4.0, 5.0, 6.0]
    """
    T = arguments.real(T, "se3.log: T", 4, 4)
    return compiled_forms.logarithm("pose_log", T, lambda T: arguments.pose(T, "se3.log: T"), _log)


def _log(T: Array) -> Array:
    """Twists (..., 6) of poses (..., 4, 4)."""
    w = so3.log(T[..., :3, :3])
    v_column = so3.left_jacobian_inverse(w) @ T[..., :3, 3, None]
    return np.concatenate([w, v_column[..., 0]], axis=-1)


def left_jacobian(V: ArrayLike) -> Array:
    """Left Jacobian of SE(3): J with exp(V + dV) = exp(J dV) exp(V) to first order, [[J, 0], [Q, J]].

    The diagonal blocks are the left Jacobian of SO(3) at omega; Q is its derivative along v, because ad(omega, v) is
    [omega + ε v] with ε² = 0. Valid for every angle. Source of Q: Barfoot & Furgale, "Associating uncertainty with
    three-dimensional poses", IEEE T-RO 30(3), 2014.

    Returns
    -------
    J : (..., 6, 6) array

    Examples
    --------
    >>> left_jacobian([0, 0, 0, 2, 0, 0])[3:, :3].tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    """
    V = arguments.real(V, "se3.left_jacobian: V", 6)
    w, theta = within_reach(V[..., :3])
    v = V[..., 3:]
    b = series.one_minus_cos_over_square(theta)
    c = series.theta_minus_sin_over_cube(theta)
    db = series.one_minus_cos_slope(theta)
    dc = series.theta_minus_sin_slope(theta)
    J = quadratic(w, b, c)
    Q = slope(w, v, b, c, db, dc)
    return _block_matrix(J, Q)


def left_jacobian_inverse(V: ArrayLike) -> Array:
    """Inverse of the left Jacobian of SE(3); see :func:`left_jacobian`.

    Unbounded as |omega| approaches 2π, 4π, … Overflows if omega is longer than 1e77.

    Returns
    -------
    J : (..., 6, 6) array

    Examples
    --------
    >>> V = [0.3, -2.0, 1.0, 0.5, 0.1, -0.4]
    >>> bool(abs(left_jacobian(V) @ left_jacobian_inverse(V) - np.eye(6)).max() < 1e-15)
    True
    """
    V = arguments.real(V, "se3.left_jacobian_inverse: V", 6)
    w, v = V[..., :3], V[..., 3:]
    theta = angle(w)
    b = np.full_like(theta, -0.5)
    c = series.cot_term(theta)
    db = np.zeros_like(theta)
    dc = series.cot_slope(theta)
    J = quadratic(w, b, c)
    Q = slope(w, v, b, c, db, dc)
    return _block_matrix(J, Q)


def project(M: ArrayLike, within: float = 0.1) -> Poses:
    """Nearest pose to a matrix that is nearly a pose.

    The rotation is projected by :func:`twistwrench.so3.project`, the position is kept, and the last row is exact.

    Parameters
    ----------
    M : (..., 4, 4) array_like
    within : float, largest allowed deviation of an entry of the rotation or of the last row

    Examples
    --------
    >>> T = exp([0.1, 0.2, 0.3, 4, 5, 6])
    >>> bool(abs(project(T.round(3)) - T).max() < 1e-3)
    True
    """
    M = arguments.real(M, "se3.project: M", 4, 4)
    within = arguments.number(within, "se3.project: within")
    arguments.last_row(M, "se3.project: M", within)
    return pose(so3.project(M[..., :3, :3], within), M[..., :3, 3])


def as_scipy(T: ArrayLike) -> RigidTransform:
    """SciPy's ``RigidTransform`` (SciPy ≥ 1.16) of a pose; exponential coordinates have the order (omega, v) there too.

    Returns
    -------
    transform : scipy.spatial.transform.RigidTransform

    Raises
    ------
    MissingExtraError
        The installed SciPy is older.

    Examples
    --------
    >>> as_scipy(exp([0, 0, 0.5, 1, 2, 3])).as_exp_coords().round(12).tolist()
    [0.0, 0.0, 0.5, 1.0, 2.0, 3.0]
    """
    T = arguments.pose(arguments.finite(T, "se3.as_scipy: T", 4, 4), "se3.as_scipy: T")
    try:
        from scipy.spatial.transform import RigidTransform
    except ImportError:
        raise MissingExtraError(
            "se3.as_scipy needs RigidTransform, which came with SciPy 1.16: pip install 'scipy>=1.16'."
        ) from None
    return RigidTransform.from_matrix(T)


def from_scipy(transform: RigidTransform) -> Poses:
    """Pose of SciPy's ``RigidTransform``.

    Parameters
    ----------
    transform : scipy.spatial.transform.RigidTransform

    Examples
    --------
    >>> bool(np.allclose(from_scipy(as_scipy(exp([0, 0, 0.5, 1, 2, 3]))), exp([0, 0, 0.5, 1, 2, 3])))
    True
    """
    return arguments.matrix_of_rotation(transform, "se3.from_scipy", "scipy.spatial.transform.RigidTransform")


def _broadcast(R: Array, p: Array) -> tuple[Array, Array]:
    """R (..., 3, 3) and p (..., 3) with one batch shape; raises an error if their batch shapes do not fit."""
    try:
        batch = np.broadcast_shapes(R.shape[:-2], p.shape[:-1])
    except ValueError:
        raise arguments.mismatch(R=R, p=p) from None
    return np.broadcast_to(R, (*batch, 3, 3)), np.broadcast_to(p, (*batch, 3))


def _block_matrix(J: Array, Q: Array) -> Array:
    """[[J, 0], [Q, J]]; (..., 3, 3) each → (..., 6, 6)."""
    upper = np.concatenate([J, np.zeros_like(J)], axis=-1)
    lower = np.concatenate([Q, J], axis=-1)
    return np.concatenate([upper, lower], axis=-2)


# ── Branch-free exp and log of one rotation or rigid motion: source of the compiled forms

# Each function also returns a number for range checks in ``mechanics/lie/compiled_forms.py``: the squared angle, or the squared
# deviation of a matrix from a rotation or a pose. Modern Robotics sections 3.2.3 and 3.3.3.


def rotation_exp(w: Array) -> tuple[Array, Any]:
    """exp [w], (3, 3), and w·w. MR eq. 3.51 with sin θ = 2 sin(θ/2) cos(θ/2) and 1 - cos θ = 2 sin²(θ/2)."""
    square = w @ w
    half, cosine, _ = half_angle(square)  # half = sin(θ/2)/θ
    R = quadratic(w, 2.0 * half * cosine, 2.0 * half * half)
    return R, square


def pose_exp(V: Array) -> tuple[Array, Any]:
    """exp [V], (4, 4), and ω·ω. MR eq. 3.88."""
    w, v = V[:3], V[3:]
    R, square = rotation_exp(w)
    half, _, third = half_angle(square)  # third = (θ - sin θ)/θ³
    p = slide(w, v, 2.0 * half * half, third)
    return pose(R, p), square


def rotation_log(R: Array) -> tuple[Array, Any]:
    """w with exp [w] = R and |w| ≤ π, and the squared deviation of R from a rotation. MR section 3.2.3.3, by the quaternion."""
    Q = _quaternion(R)
    Q = short_way(Q[0]) * Q
    cosine = Q[0]  # of half the angle
    sine_vector = Q[1:]  # axis times the sine of half the angle
    w = 2.0 * half_turn(cosine, sine_vector @ sine_vector) * sine_vector
    square_deviation = sum(gap * gap for gap in gaps(R))
    return w, square_deviation


def pose_log(T: Array) -> tuple[Array, Any]:
    """V with exp [V] = T and |ω| ≤ π, and the squared deviation of T from a pose. MR eq. 3.92."""
    w, square_deviation = rotation_log(T[:3, :3])
    v = slide(w, T[:3, 3], -0.5, cotangent_quotient(w @ w))
    last_row_error = T[3] - np.array([0.0, 0.0, 0.0, 1.0])
    return np.concatenate([w, v]), square_deviation + last_row_error @ last_row_error


def slide(w: Array, v: Array, b: Any, c: Any) -> Array:
    """v + b ω×v + c ω×(ω×v): the left Jacobian times v, or its inverse times v, depending on b and c."""
    wv = cross(w, v)
    return np.asarray(v + b * wv + c * cross(w, wv))


def _quaternion(R: Array) -> Array:
    """Unit quaternion (4,) of R, of either sign. Row k is 4 q_k q; the row of the largest q_k has the least rounding error.

    Source: Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    trace = xx + yy + zz
    other_rows = (
        (xx, [zy - yz, 1.0 + 2.0 * xx - trace, yx + xy, xz + zx]),
        (yy, [xz - zx, yx + xy, 1.0 + 2.0 * yy - trace, zy + yz]),
        (zz, [yx - xy, xz + zx, zy + yz, 1.0 + 2.0 * zz - trace]),
    )
    # q_k is the largest if the trace (k = 0) or the k-th diagonal entry is the largest of the four.
    largest = trace
    Q = np.array([1.0 + trace, zy - yz, xz - zx, yx - xy])  # row 0
    for diagonal_entry, row in other_rows:
        is_larger = 0.5 - 0.5 * short_way(largest - diagonal_entry)  # 1 or 0
        largest = largest + is_larger * (diagonal_entry - largest)
        Q = Q + is_larger * (np.array(row) - Q)
    return np.asarray(Q / np.sqrt(Q @ Q))


complete(globals())
