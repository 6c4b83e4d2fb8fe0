"""Identity pose, one read-only array, and products that skip it: most frames of files are not moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..typing import Array

IDENTITY: Array = np.eye(4)
"""(4, 4)."""
IDENTITY.setflags(write=False)
_ROWS = IDENTITY.tolist()
UPRIGHT: list[list[float]] = np.eye(3).tolist()
"""Rows of the identity rotation."""


def is_identity(T: Array) -> bool:
    """True if T (4, 4) is the identity."""
    return T is IDENTITY or T.tolist() == _ROWS


def product(A: Array, B: Array) -> Array:
    """Product A B of poses (4, 4); the other factor itself if one is :data:`IDENTITY`."""
    return B if A is IDENTITY else A if B is IDENTITY else A @ B


def pose_rows(R: Any, p: Any) -> Array:
    """The pose (4, 4) of three rows of a rotation and a position, lists or tuples of floats that were checked before."""
    (a, b, c), (x, y, z) = R, p
    return np.array([[*a, x], [*b, y], [*c, z], [0.0, 0.0, 0.0, 1.0]])
