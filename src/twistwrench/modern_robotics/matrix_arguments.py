"""Argument checks of this package: real arrays of the expected shape, or an error that names the argument."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ValueRangeError
from ..lie import se3, so3
from ..typing import Array

ROUNDED = 0.01
"""Largest distance of an entry from the nearest rotation's: matrices typed with two digits are taken for rotations."""


def array(x: ArrayLike, name: str, *core: int) -> Array:
    """x as real numbers, its last axes of the shape ``core``; float32 stays that."""
    return arguments.real(x, name, *core)


def rotation(R: ArrayLike, name: str) -> Array:
    """R (..., 3, 3) as it is where it is a rotation to 1e-6, and the nearest one where it was rounded more than that."""
    return _nearest(array(R, name, 3, 3), name, arguments.rotation, so3.project)


def pose(T: ArrayLike, name: str) -> Array:
    """T (..., 4, 4), its rotation as :func:`rotation` takes it."""
    return _nearest(array(T, name, 4, 4), name, arguments.pose, se3.project)


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


def skew(W: ArrayLike, name: str) -> Array:
    """W (..., 3, 3), when W + W' is zero but for rounding, in a hundredth of its largest entry."""
    W = array(W, name, 3, 3)
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


def twist_matrix(X: ArrayLike, name: str) -> Array:
    """X (..., 4, 4) of a twist: :func:`skew` above on the left, and a last row of zeros."""
    X = array(X, name, 4, 4)
    skew(X[..., :3, :3], name)
    if X.ndim != 2 or X[3].tolist() != [0.0, 0.0, 0.0, 0.0]:
        complaint = f"{name} has no last row of zeros: an entry is {{gap}} off, allowed {{allowed}}"
        arguments.refuse(np.abs(X[..., 3:, :]), arguments.TOLERANCE, complaint)
    return X
