"""Chapter 3: rotations, rigid motions, their exponentials and logarithms; and the matrix [ad_V] of chapter 8."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..lie import se3, so3
from ..typing import Array
from . import matrix_arguments

# ── Rotations ──


def RotInv(R: ArrayLike) -> Array:
    """Inverse of a rotation, its transpose R'.

    Parameters
    ----------
    R : (..., 3, 3) array_like, rotation

    Returns
    -------
    inverse : (..., 3, 3) array

    Notes
    -----
    MR section 3.2.1.

    Examples
    --------
    >>> RotInv([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    return np.swapaxes(matrix_arguments.array(R, "R", 3, 3), -1, -2).copy()


def VecToso3(omg: ArrayLike) -> Array:
    """Skew-symmetric matrix [omg] of a vector.

    Parameters
    ----------
    omg : (..., 3) array_like

    Returns
    -------
    so3mat : (..., 3, 3) array

    Notes
    -----
    MR eq. 3.30.

    Examples
    --------
    >>> VecToso3([1, 2, 3]).tolist()
    [[0.0, -3.0, 2.0], [3.0, 0.0, -1.0], [-2.0, 1.0, 0.0]]
    """
    return so3.hat(matrix_arguments.array(omg, "omg", 3))


def so3ToVec(so3mat: ArrayLike) -> Array:
    """Vector of a skew-symmetric matrix.

    Parameters
    ----------
    so3mat : (..., 3, 3) array_like

    Returns
    -------
    omg : (..., 3) array

    Raises
    ------
    ValueRangeError
        The matrix is not skew-symmetric, to a hundredth of its largest entry.

    Examples
    --------
    >>> so3ToVec([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]).tolist()
    [1.0, 2.0, 3.0]
    """
    return so3.vee(matrix_arguments.skew(so3mat, "so3ToVec: so3mat"))


def AxisAng3(expc3: ArrayLike) -> tuple[Array, Any]:
    """Axis and angle of exponential coordinates of a rotation.

    Parameters
    ----------
    expc3 : (..., 3) array_like [rad]

    Returns
    -------
    omghat : (..., 3) array, unit axis
    theta : (...) array, angle [rad]

    Notes
    -----
    MR section 3.2.3.3. No rotation has no axis: zero gives a zero axis and a zero angle, so that axis times angle is
    always ``expc3``.

    Examples
    --------
    >>> omghat, theta = AxisAng3([1, 2, 3])
    >>> omghat.round(8).tolist(), round(float(theta), 13)
    ([0.26726124, 0.53452248, 0.80178373], 3.7416573867739)
    """
    w = matrix_arguments.array(expc3, "expc3", 3)
    theta = _length(w)
    return _over(w, theta), theta


def MatrixExp3(so3mat: ArrayLike) -> Array:
    """Matrix exponential of so(3): the rotation exp([omg] theta), at every angle.

    Parameters
    ----------
    so3mat : (..., 3, 3) array_like, [omg] theta [rad]

    Returns
    -------
    R : (..., 3, 3) array

    Raises
    ------
    ValueRangeError
        As :func:`so3ToVec`.

    Notes
    -----
    MR eq. 3.51.

    Examples
    --------
    >>> MatrixExp3([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]).round(8)[0].tolist()
    [-0.69492056, 0.71352099, 0.08929286]
    """
    return so3.exp(so3.vee(matrix_arguments.skew(so3mat, "MatrixExp3: so3mat")))


def MatrixLog3(R: ArrayLike) -> Array:
    """Matrix logarithm of SO(3): [omg] theta with 0 ≤ theta ≤ π whose exponential is R, at every angle.

    Parameters
    ----------
    R : (..., 3, 3) array_like, rotation

    Returns
    -------
    so3mat : (..., 3, 3) array [rad]

    Raises
    ------
    ValueRangeError
        An entry is further than 0.01 from any rotation.

    Notes
    -----
    MR eq. 3.53, 3.54. A matrix typed with few digits is read as the nearest rotation. At exactly π, where two
    logarithms are right, the sign is the one the book's package chooses.

    Examples
    --------
    >>> MatrixLog3([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).round(8)[0].tolist()
    [0.0, -1.20919958, 1.20919958]
    """
    return so3.hat(_log3(matrix_arguments.rotation(R, "MatrixLog3: R")))


def _log3(R: Array) -> Array:
    return _signed(R, so3.log(R))


def _signed(R: Array, w: Array) -> Array:
    """The logarithm w of R; of a half turn the one whose last entry (that is not nearly zero) is positive."""
    if w.ndim == 1 and R[0, 1] != R[1, 0]:  # no half turn
        return w
    if np.any(half := np.all(np.swapaxes(R, -1, -2) == R, axis=(-1, -2)) & (np.sum(w * w, axis=-1) > 1.0)):
        x, y, z = np.moveaxis(np.where(np.abs(w) > 1e-3 * np.pi, w, 0.0), -1, 0)
        last = np.where(z != 0, z, np.where(y != 0, y, x))
        w = np.where((half & (last < 0))[..., None], -w, w)
    return w


# ── Rigid motions ──


def RpToTrans(R: ArrayLike, p: ArrayLike) -> Array:
    """Homogeneous matrix of a rotation and a position.

    Parameters
    ----------
    R : (..., 3, 3) array_like, rotation
    p : (..., 3) array_like, position [m]

    Returns
    -------
    T : (..., 4, 4) array

    Examples
    --------
    >>> RpToTrans([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [1, 2, 5])[2].tolist()
    [0.0, 1.0, 0.0, 5.0]
    """
    R, p = matrix_arguments.array(R, "R", 3, 3), matrix_arguments.array(p, "p", 3)
    return se3.pose(R, p)


def TransToRp(T: ArrayLike) -> tuple[Array, Array]:
    """Rotation and position of a homogeneous matrix.

    Returns
    -------
    R : (..., 3, 3) array
    p : (..., 3) array [m]

    Examples
    --------
    >>> TransToRp([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[1].tolist()
    [0.0, 0.0, 3.0]
    """
    T = matrix_arguments.array(T, "T", 4, 4)
    return T[..., :3, :3].copy(), T[..., :3, 3].copy()


def TransInv(T: ArrayLike) -> Array:
    """Inverse of a pose, by transposing the rotation.

    Returns
    -------
    inverse : (..., 4, 4) array

    Raises
    ------
    ValueRangeError
        An entry of the rotation is further than 0.01 from any.

    Notes
    -----
    MR eq. 3.64. What :func:`MatrixLog3` says of rounded rotations holds here too.

    Examples
    --------
    >>> TransInv([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[1].tolist()
    [0.0, 0.0, 1.0, -3.0]
    """
    T = matrix_arguments.pose(T, "TransInv: T")
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    inverse = np.empty_like(T)
    inverse[..., :3, :3], inverse[..., :3, 3] = Rt, -(Rt @ T[..., :3, 3, None])[..., 0]
    inverse[..., 3, :] = 0.0, 0.0, 0.0, 1.0
    return inverse


def VecTose3(V: ArrayLike) -> Array:
    """Matrix [V] of a twist.

    Returns
    -------
    se3mat : (..., 4, 4) array

    Notes
    -----
    MR eq. 3.71.

    Examples
    --------
    >>> VecTose3([1, 2, 3, 4, 5, 6])[0].tolist()
    [0.0, -3.0, 2.0, 4.0]
    """
    return se3.hat(matrix_arguments.array(V, "V", 6))


def se3ToVec(se3mat: ArrayLike) -> Array:
    """Twist (omega, v) of a matrix [V].

    Parameters
    ----------
    se3mat : (..., 4, 4) array_like

    Returns
    -------
    V : (..., 6) array

    Raises
    ------
    ValueRangeError
        The upper left block is not skew-symmetric, or the last row is not zero.

    Examples
    --------
    >>> se3ToVec([[0, -3, 2, 4], [3, 0, -1, 5], [-2, 1, 0, 6], [0, 0, 0, 0]]).tolist()
    [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    """
    return se3.vee(matrix_arguments.twist_matrix(se3mat, "se3ToVec: se3mat"))


def Adjoint(T: ArrayLike) -> Array:
    """Adjoint matrix of a pose, [Ad_T] = [R, 0; [p] R, R]; ``tw.Ad(T)`` applies it without making it.

    Returns
    -------
    AdT : (..., 6, 6) array

    Notes
    -----
    MR eq. 3.83.

    Examples
    --------
    >>> Adjoint([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[4].tolist()
    [3.0, 0.0, 0.0, 0.0, 0.0, -1.0]
    """
    T = matrix_arguments.array(T, "T", 4, 4)
    R = T[..., :3, :3]
    return _lower(R, so3.hat(T[..., :3, 3]) @ R)


def ad(V: ArrayLike) -> Array:
    """Matrix of the Lie bracket with a twist, [ad_V] = [[omega], 0; [v], [omega]].

    Returns
    -------
    adV : (..., 6, 6) array

    Notes
    -----
    MR definition 8.5.

    Examples
    --------
    >>> ad([1, 2, 3, 4, 5, 6])[3].tolist()
    [0.0, -6.0, 5.0, 0.0, -3.0, 2.0]
    """
    V = matrix_arguments.array(V, "V", 6)
    return _lower(so3.hat(V[..., :3]), so3.hat(V[..., 3:]))


def _lower(diagonal: Array, below: Array) -> Array:
    out = np.zeros((*diagonal.shape[:-2], 6, 6), diagonal.dtype)
    out[..., :3, :3] = out[..., 3:, 3:] = diagonal
    out[..., 3:, :3] = below
    return out


def ScrewToAxis(q: ArrayLike, s: ArrayLike, h: ArrayLike) -> Array:
    """Screw axis (s, q × s + h s) through a point along a unit vector with a pitch.

    Parameters
    ----------
    q : (..., 3) array_like, point on the axis [m]
    s : (..., 3) array_like, unit vector along it
    h : (...) array_like, pitch [m/rad]

    Returns
    -------
    S : (..., 6) array

    Notes
    -----
    MR section 3.3.2.2. s is taken as it is, as in the book's package; ``screw_axis`` of :mod:`twistwrench.lie.axis`
    normalises it.

    Examples
    --------
    >>> ScrewToAxis([3, 0, 0], [0, 0, 1], 2).tolist()
    [0.0, 0.0, 1.0, 0.0, -3.0, 2.0]
    """
    q, s, h = matrix_arguments.array(q, "q", 3), matrix_arguments.array(s, "s", 3), matrix_arguments.array(h, "h")
    if h.ndim or q.shape != s.shape:
        q, s, h = arguments.together(q=q, s=s, h=h[..., None])
    return np.concatenate([s, so3.cross(q, s) + h * s], axis=-1)


def AxisAng6(expc6: ArrayLike) -> tuple[Array, Any]:
    """Screw axis and distance along it of exponential coordinates S theta.

    Parameters
    ----------
    expc6 : (..., 6) array_like

    Returns
    -------
    S : (..., 6) array, screw axis
    theta : (...) array, distance along it [rad, or m where S slides only]

    Notes
    -----
    MR eq. 3.87. The turning part of S is of unit length however small it was in ``expc6``; where it is zero, the
    sliding part is. Zero gives a zero axis and a zero distance.

    Examples
    --------
    >>> S, theta = AxisAng6([1, 0, 0, 1, 2, 3])
    >>> S.tolist(), float(theta)
    ([1.0, 0.0, 0.0, 1.0, 2.0, 3.0], 1.0)
    """
    V = matrix_arguments.array(expc6, "expc6", 6)
    turn = _length(V[..., :3])
    theta = np.where(turn > 0, turn, _length(V[..., 3:]))[()]
    return _over(V, theta), theta


def MatrixExp6(se3mat: ArrayLike) -> Array:
    """Matrix exponential of se(3): the pose exp([S] theta), at every angle.

    Parameters
    ----------
    se3mat : (..., 4, 4) array_like, [S] theta

    Returns
    -------
    T : (..., 4, 4) array

    Raises
    ------
    ValueRangeError
        As :func:`se3ToVec`.

    Notes
    -----
    MR eq. 3.88.

    Examples
    --------
    >>> se3mat = [[0, 0, 0, 0], [0, 0, -1.57079632, 2.35619449], [0, 1.57079632, 0, 2.35619449], [0, 0, 0, 0]]
    >>> MatrixExp6(se3mat).round(7)[2].tolist()
    [0.0, 1.0, 0.0, 3.0]
    """
    return se3.exp(se3.vee(matrix_arguments.twist_matrix(se3mat, "MatrixExp6: se3mat")))


def MatrixLog6(T: ArrayLike) -> Array:
    """Matrix logarithm of SE(3): [S] theta with 0 ≤ theta ≤ π whose exponential is T, at every angle.

    Returns
    -------
    se3mat : (..., 4, 4) array

    Raises
    ------
    ValueRangeError
        An entry of the rotation is further than 0.01 from any.

    Notes
    -----
    MR eq. 3.91, 3.92. What :func:`MatrixLog3` says of rounded rotations and of exactly π holds here too.

    Examples
    --------
    >>> (MatrixLog6([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]]).round(8)[2] + 0.0).tolist()
    [0.0, 1.57079633, 0.0, 2.35619449]
    """
    return se3.hat(log6(matrix_arguments.pose(T, "MatrixLog6: T")))


def log6(T: Array) -> Array:
    """The twist of :func:`MatrixLog6`; (..., 4, 4) → (..., 6), T a pose already."""
    V = se3.log(T)
    turn = V[..., :3]
    if (w := _signed(T[..., :3, :3], turn)) is not turn:
        V = np.concatenate([w, (so3.left_jacobian_inverse(w) @ T[..., :3, 3, None])[..., 0]], axis=-1)
    return V


def _length(v: Array) -> Any:
    """|v|, of vectors whose squares would vanish or overflow too; (..., n) → (...)."""
    if v.ndim == 1:
        return v.dtype.type(math.hypot(*v.tolist()))
    largest = np.abs(v).max(axis=-1, keepdims=True)
    safe = np.where(largest > 0, largest, 1.0)
    return (safe[..., 0] * np.linalg.norm(v / safe, axis=-1))[()]


def _over(v: Array, theta: Any) -> Array:
    return np.asarray(v / np.where(theta > 0, theta, 1.0)[..., None])


complete(globals())
