"""Identity pose, one read-only array, and products that skip it, because most frames in files have the identity pose."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.typing import Array

IDENTITY: Array = np.eye(4)
"""Identity pose (4, 4)."""
IDENTITY.setflags(write=False)
_ROWS = IDENTITY.tolist()
UPRIGHT: list[list[float]] = np.eye(3).tolist()
"""Rows of the identity rotation."""


def is_identity(T: Array) -> bool:
    """True if T (4, 4) is the identity."""
    return T is IDENTITY or T.tolist() == _ROWS


def product(A: Array, B: Array) -> Array:
    """Product A B of poses (4, 4); if one factor is :data:`IDENTITY`, the other factor itself."""
    if A is IDENTITY:
        return B
    return A if B is IDENTITY else A @ B


def pose_rows(R: Any, p: Any) -> Array:
    """Pose (4, 4) from three rows of a rotation and a position, lists or tuples of floats that were checked before."""
    (a, b, c), (x, y, z) = R, p
    return np.array([[*a, x], [*b, y], [*c, z], [0.0, 0.0, 0.0, 1.0]])
