"""Checks of arrays of the book's functions, with errors that name the argument."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.typing import Array
from ..mechanics.lie import se3, so3

Check = Callable[[Any, str], Array]
"""Function of an argument and its name that returns the argument as an array, or raises an error with the name."""

MAX_ROUNDING = 0.01
"""Largest deviation of an entry from the nearest rotation, so that rotations rounded to two digits are accepted."""


def real(*shape: int) -> Check:
    """Check of real numbers whose last axes have a shape."""
    return lambda x, name: arguments.real(x, name, *shape)


def rotation(R: ArrayLike, name: str) -> Array:
    """Check R (..., 3, 3), a rotation.

    R is unchanged if it is a rotation to 1e-6. A more coarsely rounded R becomes the nearest rotation.
    """
    real_R = arguments.real(R, name, 3, 3)
    return _as_given_or_projected(real_R, name, arguments.rotation, so3.project)


def pose(T: ArrayLike, name: str) -> Array:
    """Check T (..., 4, 4), a pose, with its rotation treated as in :func:`rotation`."""
    real_T = arguments.real(T, name, 4, 4)
    return _as_given_or_projected(real_T, name, arguments.pose, se3.project)


def _as_given_or_projected(
    X: Array, name: str, check: Callable[[Array, str], Array], project: Callable[[Array, float], Array]
) -> Array:
    """X if it passes a check, otherwise its projection; raises ValueRangeError if the projection is not near."""
    try:
        return check(X, name)
    except ValueRangeError:
        try:
            return project(X, MAX_ROUNDING)
        except ValueRangeError as problem:
            _, _, text = str(problem).partition(".project: ")  # the message without the function's name
            reason = text or str(problem)
            raise ValueRangeError(f"{name}: {reason} mr.ProjectToSO3 and mr.ProjectToSE3 take any.") from None


def skew(W: ArrayLike, name: str) -> Array:
    """Check W (..., 3, 3): W + W' must be zero to a hundredth of the largest entry of W, for rounded input."""
    W = arguments.real(W, name, 3, 3)
    if W.ndim == 2:  # most calls end here, which is faster than array operations
        (a, b, c), (d, e, f), (g, h, i) = W.tolist()
        if a == e == i == b + d == c + g == f + h == 0.0:
            return W
    with np.errstate(all="ignore"):
        symmetric_part = np.abs(W + np.swapaxes(W, -1, -2))
        max_entry = np.abs(W).max(axis=(-2, -1), keepdims=True)
        max_entry = np.maximum(arguments.TOLERANCE / MAX_ROUNDING, max_entry)  # not zero
    arguments.refuse(
        symmetric_part / max_entry,
        MAX_ROUNDING,
        f"{name} is not skew-symmetric: with its transpose added it is {{gap}} of its largest entry, allowed "
        "{allowed}; mr.VecToso3 and mr.VecTose3 make such matrices of vectors, mr.MatrixLog3 and mr.MatrixLog6 of rotations "
        "and poses",
    )
    return W


def twist_matrix(X: ArrayLike, name: str) -> Array:
    """Check X (..., 4, 4) of a twist: a skew-symmetric upper left block and a last row of zeros."""
    X = arguments.real(X, name, 4, 4)
    skew(X[..., :3, :3], name)
    if X.ndim != 2 or X[3].tolist() != [0.0, 0.0, 0.0, 0.0]:
        message = f"{name} has no last row of zeros: an entry is {{gap}} off, allowed {{allowed}}"
        arguments.refuse(np.abs(X[..., 3:, :]), arguments.TOLERANCE, message)
    return X
