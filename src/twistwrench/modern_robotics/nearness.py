"""Near zero, near a rotation, near a pose: the tests and projections of the book's package."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ValueRangeError
from ..lie import se3, so3
from ..typing import Array
from . import matrix_arguments

FAR = 1e9
"""The distance of a matrix whose determinant is not positive."""


def NearZero(z: ArrayLike) -> Any:
    """Whether a number is near zero: |z| < 1e-6.

    Parameters
    ----------
    z : (...) array_like

    Returns
    -------
    near : (...) array of bool

    Notes
    -----
    Nothing in this package decides by it.

    Examples
    --------
    >>> bool(NearZero(-1e-7))
    True
    """
    return abs(z) < 1e-6 if type(z) is float else np.abs(matrix_arguments.array(z, "z")) < 1e-6


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
    V = np.atleast_1d(matrix_arguments.array(V, "V"))
    if V.ndim == 1 and 0.0 < (length := math.hypot(*V.tolist())) < math.inf:
        return V / V.dtype.type(length)
    largest = np.abs(V).max(axis=-1, keepdims=True, initial=0.0)
    if not np.all(largest > 0):
        raise ValueRangeError("V is zero, or not a number, so it has no direction. Give a vector with a nonzero entry.")
    V = V / largest  # first, so that the squares neither vanish nor overflow
    return np.asarray(V / np.linalg.norm(V, axis=-1, keepdims=True))


def ProjectToSO3(mat: ArrayLike) -> Array:
    """Nearest rotation to a matrix in the Frobenius norm, however far that is.

    Parameters
    ----------
    mat : (..., 3, 3) array_like

    Returns
    -------
    R : (..., 3, 3) array

    Notes
    -----
    :func:`twistwrench.so3.project` is the same with a limit.

    Examples
    --------
    >>> ProjectToSO3([[0.675, 0.150, 0.720], [0.370, 0.771, -0.511], [-0.630, 0.619, 0.472]]).round(8)[0].tolist()
    [0.67901136, 0.14894516, 0.71885945]
    """
    return so3.project(matrix_arguments.array(mat, "mat", 3, 3), np.inf)


def ProjectToSE3(mat: ArrayLike) -> Array:
    """Nearest pose to a matrix: the nearest rotation, the position as it is, the last row replaced.

    Parameters
    ----------
    mat : (..., 4, 4) array_like

    Returns
    -------
    T : (..., 4, 4) array

    Examples
    --------
    >>> mat = [[0.675, 0.150, 0.720, 1.2], [0.370, 0.771, -0.511, 5.4], [-0.630, 0.619, 0.472, 3.6], [0.003, 0.002, 0.010, 0.9]]
    >>> ProjectToSE3(mat).round(8)[0].tolist()
    [0.67901136, 0.14894516, 0.71885945, 1.2]
    """
    mat = matrix_arguments.array(mat, "mat", 4, 4)
    return se3.pose(so3.project(mat[..., :3, :3], np.inf), mat[..., :3, 3])


def DistanceToSO3(mat: ArrayLike) -> Any:
    """Distance of a 3×3 matrix to SO(3): |mat' mat - 1| in the Frobenius norm.

    Parameters
    ----------
    mat : (..., 3, 3) array_like

    Returns
    -------
    distance : (...) array, 1e9 where the determinant is not positive

    Examples
    --------
    >>> round(float(DistanceToSO3([[1.0, 0.0, 0.0], [0.0, 0.1, -0.95], [0.0, 1.0, 0.1]])), 5)
    0.08835
    """
    return _distance(matrix_arguments.array(mat, "mat", 3, 3), None)


def DistanceToSE3(mat: ArrayLike) -> Any:
    """Distance of a 4×4 matrix to SE(3): :func:`DistanceToSO3` of the upper left block, with what the last row is off.

    Parameters
    ----------
    mat : (..., 4, 4) array_like

    Returns
    -------
    distance : (...) array; the last row is measured against (0, 0, 0, 1)

    Examples
    --------
    >>> mat = [[1.0, 0.0, 0.0, 1.2], [0.0, 0.1, -0.95, 1.5], [0.0, 1.0, 0.1, -0.9], [0.0, 0.0, 0.1, 0.98]]
    >>> round(float(DistanceToSE3(mat)), 6)
    0.134931
    """
    mat = matrix_arguments.array(mat, "mat", 4, 4)
    return _distance(mat[..., :3, :3], mat[..., 3, :] - np.array([0.0, 0.0, 0.0, 1.0]))


def _distance(R: Array, row: Array | None) -> Any:
    off = np.swapaxes(R, -1, -2) @ R - np.eye(3)
    square = np.sum(off * off, axis=(-1, -2)) + (0.0 if row is None else np.sum(row * row, axis=-1))
    return np.where(np.linalg.det(R) > 0, np.sqrt(square), FAR)[()]


def TestIfSO3(mat: ArrayLike) -> Any:
    """Whether a matrix is a rotation: :func:`DistanceToSO3` below 1e-3.

    Parameters
    ----------
    mat : (..., 3, 3) array_like

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
    """Whether a matrix is a pose: :func:`DistanceToSE3` below 1e-3.

    Parameters
    ----------
    mat : (..., 4, 4) array_like

    Returns
    -------
    answer : (...) array of bool

    Examples
    --------
    >>> bool(TestIfSE3(np.eye(4)))
    True
    """
    return DistanceToSE3(mat) < 1e-3
