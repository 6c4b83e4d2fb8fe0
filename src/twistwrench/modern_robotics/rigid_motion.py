"""Chapter 3: rotations, rigid motions, their exponentials and logarithms; and the matrix [ad_V] of chapter 8."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from ..lie import se3, so3
from . import door, single

Array = NDArray[Any]

__all__ = [
    "Adjoint",
    "AxisAng3",
    "AxisAng6",
    "MatrixExp3",
    "MatrixExp6",
    "MatrixLog3",
    "MatrixLog6",
    "RotInv",
    "RpToTrans",
    "ScrewToAxis",
    "TransInv",
    "TransToRp",
    "VecTose3",
    "VecToso3",
    "ad",
    "se3ToVec",
    "so3ToVec",
]

# ── rotations ──


def RotInv(R: ArrayLike) -> Array:
    """R', the inverse of a rotation; (..., 3, 3) → (..., 3, 3). MR section 3.2.1.

    >>> RotInv([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    return np.swapaxes(door.array(R, "R", 3, 3), -1, -2).copy()


def VecToso3(omg: ArrayLike) -> Array:
    """The skew-symmetric matrix [omg]; (..., 3) → (..., 3, 3). MR eq. 3.30.

    >>> VecToso3([1, 2, 3]).tolist()
    [[0.0, -3.0, 2.0], [3.0, 0.0, -1.0], [-2.0, 1.0, 0.0]]
    """
    return _hat(door.array(omg, "omg", 3))


def so3ToVec(so3mat: ArrayLike) -> Array:
    """The vector of a skew-symmetric matrix; (..., 3, 3) → (..., 3).

    Raises ValueRangeError for a matrix that is not skew-symmetric, to a hundredth of its largest entry.

    >>> so3ToVec([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]).tolist()
    [1.0, 2.0, 3.0]
    """
    return _vee(door.skew(so3mat, "so3ToVec: so3mat"))


def AxisAng3(expc3: ArrayLike) -> tuple[Array, Any]:
    """Unit axis (..., 3) and angle (...) [rad] of exponential coordinates (..., 3). MR section 3.2.3.3.

    No rotation has no axis: zero gives a zero axis and a zero angle, so that axis times angle is always ``expc3``.

    >>> omghat, theta = AxisAng3([1, 2, 3])
    >>> omghat.round(8).tolist(), round(float(theta), 13)
    ([0.26726124, 0.53452248, 0.80178373], 3.7416573867739)
    """
    w = door.array(expc3, "expc3", 3)
    theta = _length(w)
    return _over(w, theta), theta


def MatrixExp3(so3mat: ArrayLike) -> Array:
    """The rotation exp([omg] theta); (..., 3, 3) → (..., 3, 3). MR eq. 3.51, at every angle.

    Raises ValueRangeError as :func:`so3ToVec` does.

    >>> MatrixExp3([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]).round(8)[0].tolist()
    [-0.69492056, 0.71352099, 0.08929286]
    """
    w = _vee(door.skew(so3mat, "MatrixExp3: so3mat"))
    R = single.exp3(w.tolist()) if w.ndim == 1 else None
    return so3.exp(w) if R is None else np.array(R, w.dtype)


def MatrixLog3(R: ArrayLike) -> Array:
    """[omg] theta with 0 ≤ theta ≤ π whose exponential is R; (..., 3, 3) → (..., 3, 3). MR eq. 3.53, 3.54, at every angle.

    A matrix typed with few digits is read as the nearest rotation; one with an entry further than 0.01 from any is a
    ValueRangeError. At exactly π, where two logarithms are right, the sign is the one the book's package chooses.

    >>> MatrixLog3([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).round(8)[0].tolist()
    [0.0, -1.20919958, 1.20919958]
    """
    return _hat(_log3(door.rotation(R, "MatrixLog3: R")))


def _log3(R: Array) -> Array:
    """Exponential coordinates; of a half turn the one whose last entry (that is not nearly zero) is positive."""
    w = so3.log(R) if R.ndim > 2 else np.array(single.log3(R.tolist()), R.dtype)
    if w.ndim == 1 and R[0, 1] != R[1, 0]:  # no half turn
        return w
    if np.any(half := np.all(np.swapaxes(R, -1, -2) == R, axis=(-1, -2)) & (np.sum(w * w, axis=-1) > 1.0)):
        x, y, z = np.moveaxis(np.where(np.abs(w) > 1e-3 * np.pi, w, 0.0), -1, 0)
        last = np.where(z != 0, z, np.where(y != 0, y, x))
        w = np.where((half & (last < 0))[..., None], -w, w)
    return w


# ── rigid motions ──


def RpToTrans(R: ArrayLike, p: ArrayLike) -> Array:
    """The homogeneous matrix of a rotation and a position; (..., 3, 3), (..., 3) → (..., 4, 4).

    >>> RpToTrans([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [1, 2, 5])[2].tolist()
    [0.0, 1.0, 0.0, 5.0]
    """
    R, p = door.array(R, "R", 3, 3), door.array(p, "p", 3)
    return se3.pose(R, p)


def TransToRp(T: ArrayLike) -> tuple[Array, Array]:
    """Rotation (..., 3, 3) and position (..., 3) of a homogeneous matrix (..., 4, 4).

    >>> TransToRp([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[1].tolist()
    [0.0, 0.0, 3.0]
    """
    T = door.array(T, "T", 4, 4)
    return T[..., :3, :3].copy(), T[..., :3, 3].copy()


def TransInv(T: ArrayLike) -> Array:
    """The inverse of a pose, by transposing; (..., 4, 4) → (..., 4, 4). MR eq. 3.64.

    What :func:`MatrixLog3` says of rounded rotations holds here too.

    >>> TransInv([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[1].tolist()
    [0.0, 0.0, 1.0, -3.0]
    """
    T = door.pose(T, "TransInv: T")
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return _last_row(_lowest(Rt, -(Rt @ T[..., :3, 3, None])[..., 0]))


def VecTose3(V: ArrayLike) -> Array:
    """The matrix [V] of a twist (omega, v); (..., 6) → (..., 4, 4). MR eq. 3.71.

    >>> VecTose3([1, 2, 3, 4, 5, 6])[0].tolist()
    [0.0, -3.0, 2.0, 4.0]
    """
    V = door.array(V, "V", 6)
    return _lowest(_hat(V[..., :3]), V[..., 3:])


def se3ToVec(se3mat: ArrayLike) -> Array:
    """The twist (omega, v) of a matrix [V]; (..., 4, 4) → (..., 6).

    Raises ValueRangeError where its upper left block is not skew-symmetric, and where its last row is not zero.

    >>> se3ToVec([[0, -3, 2, 4], [3, 0, -1, 5], [-2, 1, 0, 6], [0, 0, 0, 0]]).tolist()
    [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    """
    return _twist(door.twist_matrix(se3mat, "se3ToVec: se3mat"))


def Adjoint(T: ArrayLike) -> Array:
    """The matrix [Ad_T] = [R, 0; [p] R, R]; (..., 4, 4) → (..., 6, 6). MR eq. 3.83; ``tw.Ad(T)`` applies it without making it.

    >>> Adjoint([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[4].tolist()
    [3.0, 0.0, 0.0, 0.0, 0.0, -1.0]
    """
    T = door.array(T, "T", 4, 4)
    R = T[..., :3, :3]
    return _lower(R, _hat(T[..., :3, 3]) @ R)


def ad(V: ArrayLike) -> Array:
    """The matrix [ad_V] = [[omega], 0; [v], [omega]]; (..., 6) → (..., 6, 6). MR definition 8.5.

    >>> ad([1, 2, 3, 4, 5, 6])[3].tolist()
    [0.0, -6.0, 5.0, 0.0, -3.0, 2.0]
    """
    V = door.array(V, "V", 6)
    return _lower(_hat(V[..., :3]), _hat(V[..., 3:]))


def _lower(diagonal: Array, below: Array) -> Array:
    out = np.zeros((*diagonal.shape[:-2], 6, 6), diagonal.dtype)
    out[..., :3, :3] = out[..., 3:, 3:] = diagonal
    out[..., 3:, :3] = below
    return out


def ScrewToAxis(q: ArrayLike, s: ArrayLike, h: ArrayLike) -> Array:
    """The screw axis (s, q × s + h s) through q along the unit vector s with pitch h; (..., 3), (..., 3), (...) → (..., 6).

    s is taken as it is, as in the book's package; ``screw_axis`` of :mod:`twistwrench.screws.axis` normalises it.
    MR section 3.3.2.2.

    >>> ScrewToAxis([3, 0, 0], [0, 0, 1], 2).tolist()
    [0.0, 0.0, 1.0, 0.0, -3.0, 2.0]
    """
    q, s, h = door.array(q, "q", 3), door.array(s, "s", 3), door.array(h, "h")
    if q.ndim == s.ndim == 1 and h.ndim == 0:
        moment = single.cross(q.tolist(), s.tolist())
        return np.concatenate([s, moment + h * s])
    q, s, h = arguments.together(q=q, s=s, h=h[..., None])
    return np.concatenate([s, so3.cross(q, s) + h * s], axis=-1)


def AxisAng6(expc6: ArrayLike) -> tuple[Array, Any]:
    """Screw axis S (..., 6) and distance theta (...) along it, of exponential coordinates S theta (..., 6). MR eq. 3.87.

    The turning part of S is of unit length however small it was in ``expc6``; where it is zero, the sliding part is.
    Zero gives a zero axis and a zero distance.

    >>> S, theta = AxisAng6([1, 0, 0, 1, 2, 3])
    >>> S.tolist(), float(theta)
    ([1.0, 0.0, 0.0, 1.0, 2.0, 3.0], 1.0)
    """
    V = door.array(expc6, "expc6", 6)
    turn = _length(V[..., :3])
    theta = np.where(turn > 0, turn, _length(V[..., 3:]))[()]
    return _over(V, theta), theta


def MatrixExp6(se3mat: ArrayLike) -> Array:
    """The pose exp([S] theta); (..., 4, 4) → (..., 4, 4). MR eq. 3.88, at every angle.

    Raises ValueRangeError as :func:`se3ToVec` does.

    >>> se3mat = [[0, 0, 0, 0], [0, 0, -1.57079632, 2.35619449], [0, 1.57079632, 0, 2.35619449], [0, 0, 0, 0]]
    >>> MatrixExp6(se3mat).round(7)[2].tolist()
    [0.0, 1.0, 0.0, 3.0]
    """
    V = _twist(door.twist_matrix(se3mat, "MatrixExp6: se3mat"))
    T = single.exp6(V.tolist()) if V.ndim == 1 else None
    return se3.exp(V) if T is None else np.array(T, V.dtype)


def MatrixLog6(T: ArrayLike) -> Array:
    """[S] theta with 0 ≤ theta ≤ π whose exponential is T; (..., 4, 4) → (..., 4, 4). MR eq. 3.91, 3.92, at every angle.

    What :func:`MatrixLog3` says of rounded rotations and of exactly π holds here too.

    >>> (MatrixLog6([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]]).round(8)[2] + 0.0).tolist()
    [0.0, 1.57079633, 0.0, 2.35619449]
    """
    V = log6(door.pose(T, "MatrixLog6: T"))
    return _lowest(_hat(V[..., :3]), V[..., 3:])


def log6(T: Array) -> Array:
    """The twist of :func:`MatrixLog6`; (..., 4, 4) → (..., 6), T a pose already."""
    w = _log3(T[..., :3, :3])
    if w.ndim == 1:
        return np.array(single.log6(w.tolist(), T[:3, 3].tolist()), T.dtype)
    return np.concatenate([w, (so3.left_jacobian_inverse(w) @ T[..., :3, 3, None])[..., 0]], axis=-1)


def _vee(W: Array) -> Array:
    return so3.vee(W) if W.ndim > 2 else np.array([W[2, 1], W[0, 2], W[1, 0]])


def _twist(X: Array) -> Array:
    return np.concatenate([_vee(X[..., :3, :3]), X[..., :3, 3]], axis=-1)


def _hat(w: Array) -> Array:
    return so3.hat(w) if w.ndim > 1 else np.array(single.hat(w.tolist()), w.dtype)


def _lowest(W: Array, v: Array) -> Array:
    """[W, v; 0, 0]."""
    out = np.zeros((*v.shape[:-1], 4, 4), v.dtype)
    out[..., :3, :3], out[..., :3, 3] = W, v
    return out


def _last_row(T: Array) -> Array:
    T[..., 3, 3] = 1.0
    return T


def _length(v: Array) -> Any:
    """|v|, of vectors whose squares would vanish or overflow too; (..., n) → (...)."""
    if v.ndim == 1:
        return v.dtype.type(math.hypot(*v.tolist()))
    largest = np.abs(v).max(axis=-1, keepdims=True)
    safe = np.where(largest > 0, largest, 1.0)
    return (safe[..., 0] * np.linalg.norm(v / safe, axis=-1))[()]


def _over(v: Array, theta: Any) -> Array:
    return np.asarray(v / np.where(theta > 0, theta, 1.0)[..., None])
