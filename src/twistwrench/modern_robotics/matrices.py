"""Chapter 3: rotations, rigid motions, exponentials, logarithms and projections to SO(3) and SE(3); [ad_V] of chapter 8."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array, Poses, Rotations, Twists
from ..mechanics.lie import se3, so3

# ── Rotations ──


def RotInv(R: ArrayLike) -> Rotations:
    """Inverse of a rotation, its transpose R' (MR section 3.2.1).

    Examples
    --------
    >>> RotInv([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).tolist()
    [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    return np.swapaxes(arguments.real(R, "R", 3, 3), -1, -2).copy()


def VecToso3(omg: ArrayLike) -> Array:
    """Skew-symmetric matrix [omg] of a vector (MR eq. 3.30).

    Returns
    -------
    so3mat : (..., 3, 3) array

    Examples
    --------
    >>> VecToso3([1, 2, 3]).tolist()
    [[0.0, -3.0, 2.0], [3.0, 0.0, -1.0], [-2.0, 1.0, 0.0]]
    """
    return so3.hat(arguments.real(omg, "omg", 3))


def so3ToVec(so3mat: ArrayLike) -> Array:
    """Vector of a skew-symmetric matrix.

    Returns
    -------
    omg : (..., 3) array

    Examples
    --------
    >>> so3ToVec([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]).tolist()
    [1.0, 2.0, 3.0]
    """
    return so3.vee(skew_argument(so3mat, "so3ToVec: so3mat"))


def AxisAng3(expc3: ArrayLike) -> tuple[Array, Any]:
    """Axis and angle of exponential coordinates of a rotation (MR section 3.2.3.3).

    The zero rotation has no axis: a zero axis and a zero angle are returned, so that axis times angle is always
    ``expc3``.

    Returns
    -------
    omghat : (..., 3) array, unit axis
    theta : (...) array, angle [rad]

    Examples
    --------
    >>> omghat, theta = AxisAng3([1, 2, 3])
    >>> omghat.round(8).tolist(), round(float(theta), 13)
    ([0.26726124, 0.53452248, 0.80178373], 3.7416573867739)
    """
    w = arguments.real(expc3, "expc3", 3)
    theta = _length(w)
    return _over(w, theta), theta


def MatrixExp3(so3mat: ArrayLike) -> Rotations:
    """Matrix exponential of so(3): the rotation exp([omg] theta), at every angle (MR eq. 3.51).

    Examples
    --------
    >>> MatrixExp3([[0, -3, 2], [3, 0, -1], [-2, 1, 0]]).round(8)[0].tolist()
    [-0.69492056, 0.71352099, 0.08929286]
    """
    return so3.exp(so3.vee(skew_argument(so3mat, "MatrixExp3: so3mat")))


def MatrixLog3(R: ArrayLike) -> Array:
    """Matrix logarithm of SO(3): [omg] theta with 0 ≤ theta ≤ π and exponential R, at every angle (MR eq. 3.53, 3.54).

    A matrix with few digits is replaced by the nearest rotation. At exactly π two logarithms are valid; the sign is
    that of the book's package.

    Returns
    -------
    so3mat : (..., 3, 3) array [rad]

    Examples
    --------
    >>> MatrixLog3([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).round(8)[0].tolist()
    [0.0, -1.20919958, 1.20919958]
    """
    R = rotation_argument(R, "MatrixLog3: R")
    return so3.hat(_signed(R, so3.log(R)))


def _signed(R: Array, w: Array) -> Array:
    """Logarithm w of R; for a half turn, the one with a positive last non-negligible entry."""
    if w.ndim == 1 and R[0, 1] != R[1, 0]:  # not a half turn
        return w
    if np.any(half := np.all(np.swapaxes(R, -1, -2) == R, axis=(-1, -2)) & (np.sum(w * w, axis=-1) > 1.0)):
        x, y, z = np.moveaxis(np.where(np.abs(w) > 1e-3 * np.pi, w, 0.0), -1, 0)
        last = np.where(z != 0, z, np.where(y != 0, y, x))
        w = np.where((half & (last < 0))[..., None], -w, w)
    return w


# ── Rigid motions ──


def RpToTrans(R: ArrayLike, p: ArrayLike) -> Poses:
    """Homogeneous matrix of a rotation and a position.

    Examples
    --------
    >>> RpToTrans([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [1, 2, 5])[2].tolist()
    [0.0, 1.0, 0.0, 5.0]
    """
    return se3.pose(arguments.real(R, "R", 3, 3), arguments.real(p, "p", 3))


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
    T = arguments.real(T, "T", 4, 4)
    return T[..., :3, :3].copy(), T[..., :3, 3].copy()


def TransInv(T: ArrayLike) -> Poses:
    """Inverse of a pose, by transposing the rotation (MR eq. 3.64).

    Notes
    -----
    Rounded rotations are treated as in :func:`MatrixLog3`.

    Examples
    --------
    >>> TransInv([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[1].tolist()
    [0.0, 0.0, 1.0, -3.0]
    """
    T = pose_argument(T, "TransInv: T")
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return se3.pose(Rt, -(Rt @ T[..., :3, 3, None])[..., 0])


def VecTose3(V: ArrayLike) -> Array:
    """Matrix [V] of a twist (MR eq. 3.71).

    Returns
    -------
    se3mat : (..., 4, 4) array

    Examples
    --------
    >>> VecTose3([1, 2, 3, 4, 5, 6])[0].tolist()
    [0.0, -3.0, 2.0, 4.0]
    """
    return se3.hat(arguments.real(V, "V", 6))


def se3ToVec(se3mat: ArrayLike) -> Twists:
    """Twist (omega, v) of a matrix [V].

    Examples
    --------
    >>> se3ToVec([[0, -3, 2, 4], [3, 0, -1, 5], [-2, 1, 0, 6], [0, 0, 0, 0]]).tolist()
    [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    """
    return se3.vee(twist_argument(se3mat, "se3ToVec: se3mat"))


def Adjoint(T: ArrayLike) -> Array:
    """Adjoint matrix of a pose, [Ad_T] = [R, 0; [p] R, R]; ``tw.Ad(T)`` applies it without forming it (MR eq. 3.83).

    Returns
    -------
    AdT : (..., 6, 6) array

    Examples
    --------
    >>> Adjoint([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])[4].tolist()
    [3.0, 0.0, 0.0, 0.0, 0.0, -1.0]
    """
    T = arguments.real(T, "T", 4, 4)
    R = T[..., :3, :3]
    return _lower(R, so3.hat(T[..., :3, 3]) @ R)


def ad(V: ArrayLike) -> Array:
    """Matrix of the Lie bracket with a twist, [ad_V] = [[omega], 0; [v], [omega]] (MR definition 8.5).

    Returns
    -------
    adV : (..., 6, 6) array

    Examples
    --------
    >>> ad([1, 2, 3, 4, 5, 6])[3].tolist()
    [0.0, -6.0, 5.0, 0.0, -3.0, 2.0]
    """
    V = arguments.real(V, "V", 6)
    return _lower(so3.hat(V[..., :3]), so3.hat(V[..., 3:]))


def _lower(diagonal: Array, below: Array) -> Array:
    out = np.zeros((*diagonal.shape[:-2], 6, 6), diagonal.dtype)
    out[..., :3, :3] = out[..., 3:, 3:] = diagonal
    out[..., 3:, :3] = below
    return out


def ScrewToAxis(q: ArrayLike, s: ArrayLike, h: ArrayLike) -> Twists:
    """Screw axis (s, q × s + h s) through a point along a unit vector with a pitch (MR section 3.3.2.2).

    s is not normalised, as in the book's package; ``screw_axis`` of :mod:`twistwrench.mechanics.lie.axis` normalises it.

    Parameters
    ----------
    q : (..., 3) array_like, point on the axis [m]
    s : (..., 3) array_like, unit vector along it
    h : (...) array_like, pitch [m/rad]

    Examples
    --------
    >>> ScrewToAxis([3, 0, 0], [0, 0, 1], 2).tolist()
    [0.0, 0.0, 1.0, 0.0, -3.0, 2.0]
    """
    q, s, h = arguments.real(q, "q", 3), arguments.real(s, "s", 3), arguments.real(h, "h")
    if h.ndim or q.shape != s.shape:
        q, s, h = arguments.together(q=q, s=s, h=h[..., None])
    return np.concatenate([s, so3.cross(q, s) + h * s], axis=-1)


def AxisAng6(expc6: ArrayLike) -> tuple[Array, Any]:
    """Screw axis and distance along it of exponential coordinates S theta (MR eq. 3.87).

    The angular part of S has unit length, even if it is tiny in ``expc6``. If it is zero, the linear part has unit
    length. Zero input gives a zero axis and a zero distance.

    Returns
    -------
    S : (..., 6) array, screw axis
    theta : (...) array, distance along it [rad, or m if the angular part of S is zero]

    Examples
    --------
    >>> S, theta = AxisAng6([1, 0, 0, 1, 2, 3])
    >>> S.tolist(), float(theta)
    ([1.0, 0.0, 0.0, 1.0, 2.0, 3.0], 1.0)
    """
    V = arguments.real(expc6, "expc6", 6)
    turn = _length(V[..., :3])
    theta = np.where(turn > 0, turn, _length(V[..., 3:]))[()]
    return _over(V, theta), theta


def MatrixExp6(se3mat: ArrayLike) -> Poses:
    """Matrix exponential of se(3): the pose exp([S] theta), at every angle (MR eq. 3.88).

    Examples
    --------
    >>> se3mat = [[0, 0, 0, 0], [0, 0, -1.57079632, 2.35619449], [0, 1.57079632, 0, 2.35619449], [0, 0, 0, 0]]
    >>> MatrixExp6(se3mat).round(7)[2].tolist()
    [0.0, 1.0, 0.0, 3.0]
    """
    return se3.exp(se3.vee(twist_argument(se3mat, "MatrixExp6: se3mat")))


def MatrixLog6(T: ArrayLike) -> Array:
    """Matrix logarithm of SE(3): [S] theta with 0 ≤ theta ≤ π and exponential T, at every angle (MR eq. 3.91, 3.92).

    Rounded rotations and exactly π are treated as in :func:`MatrixLog3`.

    Returns
    -------
    se3mat : (..., 4, 4) array

    Examples
    --------
    >>> (MatrixLog6([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]]).round(8)[2] + 0.0).tolist()
    [0.0, 1.57079633, 0.0, 2.35619449]
    """
    return se3.hat(log6(pose_argument(T, "MatrixLog6: T")))


def log6(T: Array) -> Array:
    """Twist of :func:`MatrixLog6`; (..., 4, 4) → (..., 6), for a valid pose T."""
    V = se3.log(T)
    turn = V[..., :3]
    if (w := _signed(T[..., :3, :3], turn)) is not turn:
        V = np.concatenate([w, (so3.left_jacobian_inverse(w) @ T[..., :3, 3, None])[..., 0]], axis=-1)
    return V


def _length(v: Array) -> Any:
    """Norm |v| without underflow or overflow of the squares; (..., n) → (...)."""
    if v.ndim == 1:
        return v.dtype.type(math.hypot(*v.tolist()))
    largest = np.abs(v).max(axis=-1, keepdims=True)
    safe = np.where(largest > 0, largest, 1.0)
    return (safe[..., 0] * np.linalg.norm(v / safe, axis=-1))[()]


def _over(v: Array, theta: Any) -> Array:
    return np.asarray(v / np.where(theta > 0, theta, 1.0)[..., None])


# ── Nearness: tests and projections

FAR = 1e9
"""Distance returned for a matrix with non-positive determinant."""


def NearZero(z: ArrayLike) -> Any:
    """True if a number is near zero: |z| < 1e-6.

    This package itself does not use this threshold.

    Parameters
    ----------
    z : (...) array_like

    Returns
    -------
    near : (...) array of bool

    Examples
    --------
    >>> bool(NearZero(-1e-7))
    True
    """
    return abs(z) < 1e-6 if type(z) is float else np.abs(arguments.real(z, "z")) < 1e-6


def Normalize(V: ArrayLike) -> Array:
    """Unit vector V / |V|.

    Parameters
    ----------
    V : (..., n) array_like

    Returns
    -------
    unit : (..., n) array

    Examples
    --------
    >>> Normalize([1, 2, 3]).round(8).tolist()
    [0.26726124, 0.53452248, 0.80178373]
    """
    V = np.atleast_1d(arguments.real(V, "V"))
    if V.ndim == 1 and 0.0 < (length := math.hypot(*V.tolist())) < math.inf:
        return V / V.dtype.type(length)
    largest = np.abs(V).max(axis=-1, keepdims=True, initial=0.0)
    if not np.all(largest > 0):
        raise ValueRangeError("V is zero, or not a number, so it has no direction. Give a vector with a nonzero entry.")
    V = V / largest  # scale first, to avoid underflow and overflow of the squares
    return np.asarray(V / np.linalg.norm(V, axis=-1, keepdims=True))


def ProjectToSO3(mat: ArrayLike) -> Rotations:
    """Nearest rotation to a matrix in the Frobenius norm, at any distance.

    Notes
    -----
    :func:`twistwrench.so3.project` does the same with a limit on the distance.

    Examples
    --------
    >>> ProjectToSO3([[0.675, 0.150, 0.720], [0.370, 0.771, -0.511], [-0.630, 0.619, 0.472]]).round(8)[0].tolist()
    [0.67901136, 0.14894516, 0.71885945]
    """
    return so3.project(arguments.real(mat, "mat", 3, 3), np.inf)


def ProjectToSE3(mat: ArrayLike) -> Poses:
    """Nearest pose to a matrix: the nearest rotation, the unchanged position, and the last row replaced.

    Examples
    --------
    >>> mat = [[0.675, 0.150, 0.720, 1.2], [0.370, 0.771, -0.511, 5.4], [-0.630, 0.619, 0.472, 3.6], [0.003, 0.002, 0.010, 0.9]]
    >>> ProjectToSE3(mat).round(8)[0].tolist()
    [0.67901136, 0.14894516, 0.71885945, 1.2]
    """
    mat = arguments.real(mat, "mat", 4, 4)
    return se3.pose(so3.project(mat[..., :3, :3], np.inf), mat[..., :3, 3])


def DistanceToSO3(mat: ArrayLike) -> Any:
    """Distance of a 3×3 matrix to SO(3): |mat' mat - 1| in the Frobenius norm.

    Returns
    -------
    distance : (...) array, 1e9 if the determinant is not positive

    Examples
    --------
    >>> round(float(DistanceToSO3([[1.0, 0.0, 0.0], [0.0, 0.1, -0.95], [0.0, 1.0, 0.1]])), 5)
    0.08835
    """
    return _distance(arguments.real(mat, "mat", 3, 3), None)


def DistanceToSE3(mat: ArrayLike) -> Any:
    """Distance of a 4×4 matrix to SE(3): :func:`DistanceToSO3` of the upper left block, with the error of the last row.

    Returns
    -------
    distance : (...) array; the last row is compared with (0, 0, 0, 1)

    Examples
    --------
    >>> mat = [[1.0, 0.0, 0.0, 1.2], [0.0, 0.1, -0.95, 1.5], [0.0, 1.0, 0.1, -0.9], [0.0, 0.0, 0.1, 0.98]]
    >>> round(float(DistanceToSE3(mat)), 6)
    0.134931
    """
    mat = arguments.real(mat, "mat", 4, 4)
    return _distance(mat[..., :3, :3], mat[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0]))


def _distance(R: Array, row: Array | None) -> Any:
    off = np.swapaxes(R, -1, -2) @ R - np.eye(3)
    square = np.sum(off * off, axis=(-1, -2)) + (0.0 if row is None else np.sum(row * row, axis=-1))
    return np.where(np.linalg.det(R) > 0, np.sqrt(square), FAR)[()]


def TestIfSO3(mat: ArrayLike) -> Any:
    """True if a matrix is a rotation: :func:`DistanceToSO3` below 1e-3.

    Returns
    -------
    answer : (...) array of bool

    Examples
    --------
    >>> bool(TestIfSO3([[1.0, 0.0, 0.0], [0.0, 0.1, -0.95], [0.0, 1.0, 0.1]]))
    False
    """
    return DistanceToSO3(mat) < 1e-3


def TestIfSE3(mat: ArrayLike) -> Any:
    """True if a matrix is a pose: :func:`DistanceToSE3` below 1e-3.

    Returns
    -------
    answer : (...) array of bool

    Examples
    --------
    >>> bool(TestIfSE3(np.eye(4)))
    True
    """
    return DistanceToSE3(mat) < 1e-3


# ── Argument validation of matrices, with errors that name the argument

ROUNDED = 0.01
"""Largest deviation of an entry from the nearest rotation; rotations rounded to two digits are accepted."""


def rotation_argument(R: ArrayLike, name: str) -> Array:
    """Check R (..., 3, 3): a rotation to 1e-6 is unchanged, a more coarsely rounded one becomes the nearest rotation."""
    return _nearest(arguments.real(R, name, 3, 3), name, arguments.rotation, so3.project)


def pose_argument(T: ArrayLike, name: str) -> Array:
    """Check T (..., 4, 4), with its rotation treated as in :func:`rotation_argument`."""
    return _nearest(arguments.real(T, name, 4, 4), name, arguments.pose, se3.project)


def _nearest(
    X: Array, name: str, judged: Callable[[Array, str], Array], project: Callable[[Array, float], Array]
) -> Array:
    try:
        return judged(X, name)
    except ValueRangeError:
        try:
            return project(X, ROUNDED)
        except ValueRangeError as problem:
            reason = str(problem).partition(".project: ")[2] or str(problem)
            raise ValueRangeError(f"{name}: {reason} mr.ProjectToSO3 and mr.ProjectToSE3 take any.") from None


def skew_argument(W: ArrayLike, name: str) -> Array:
    """Check W (..., 3, 3): W + W' must be zero to a hundredth of its largest entry, for rounded input."""
    W = arguments.real(W, name, 3, 3)
    if W.ndim == 2:
        (a, b, c), (d, e, f), (g, h, i) = W.tolist()
        if a == e == i == b + d == c + g == f + h == 0.0:
            return W
    with np.errstate(all="ignore"):
        off = np.abs(W + np.swapaxes(W, -1, -2))
        largest = np.maximum(arguments.TOLERANCE / ROUNDED, np.abs(W).max(axis=(-2, -1), keepdims=True))
    arguments.refuse(
        off / largest,
        ROUNDED,
        f"{name} is not skew-symmetric: with its transpose added it is {{gap}} of its largest entry, allowed "
        "{allowed}; mr.VecToso3 and mr.VecTose3 make such matrices of vectors, mr.MatrixLog3 and mr.MatrixLog6 of rotations "
        "and poses",
    )
    return W


def twist_argument(X: ArrayLike, name: str) -> Array:
    """Check X (..., 4, 4) of a twist: a skew-symmetric upper left block and a last row of zeros."""
    X = arguments.real(X, name, 4, 4)
    skew_argument(X[..., :3, :3], name)
    if X.ndim != 2 or X[3].tolist() != [0.0, 0.0, 0.0, 0.0]:
        complaint = f"{name} has no last row of zeros: an entry is {{gap}} off, allowed {{allowed}}"
        arguments.refuse(np.abs(X[..., 3:, :]), arguments.TOLERANCE, complaint)
    return X


complete(globals())
