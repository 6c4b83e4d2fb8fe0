"""Snapping: fixed rotations that are nearly permutations are taken to be exactly that."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["DEFAULT_SNAP", "snap_pose", "snap_rotation"]

DEFAULT_SNAP = 1e-9
"""How near to 0 or ±1 an entry of a fixed rotation must be to be taken for it."""


def snap_rotation(R: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """R (3, 3) with the entries within ``tolerance`` of 0 or ±1 set to it; 0 changes nothing.

    A robot file writes a right angle as 1.57079632679, and even the best float for π/2 has a cosine of 6e-17; exact
    zeros and ones vanish from the compiled kernels, and these do not. An entry becomes ±1 only together with the zeros
    beside it: cos(1e-5) is nearer to 1 than the tolerance, but a small angle is an angle, and R must stay a rotation.
    """
    if tolerance == 0:
        return R
    zero = np.abs(R) <= tolerance
    alone = ~zero & (zero.sum(0, keepdims=True) == 2) & (zero.sum(1, keepdims=True) == 2)
    return np.where(zero, 0.0, np.where(alone, np.sign(R), R))


def snap_pose(T: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """T (4, 4) with its rotation snapped; the position is left as it is."""
    if tolerance == 0:
        return T
    snapped = T.copy()
    snapped[:3, :3] = snap_rotation(T[:3, :3], tolerance)
    return snapped
