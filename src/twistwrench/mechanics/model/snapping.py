"""Round-off cleanup of fixed rotations: entries near 0 and ±1 become exact, and the rotation stays orthonormal."""

from __future__ import annotations

import numpy as np

from ...core.typing import Array
from ..lie.identity import IDENTITY, UPRIGHT

DEFAULT_SNAP = 1e-9
"""Distance from 0 or ±1 below which an entry of a fixed rotation is set to it."""

_MAX_ROUNDING = 4.5e-16
"""Largest deviation of R'R and R R' from the identity by rounding of three products; R then counts as a rotation."""
_MAX_ROUNDING_AFTER_SNAP = 1e-15
"""Largest deviation of R'R and R R' from the identity after orthonormalisation."""


def snap_rotation(R: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """R (3, 3) with entries within ``tolerance`` of 0 or ±1 set to 0 or ±1, and orthonormalised; tolerance 0 disables this.

    Robot files write a right angle as 1.57079632679, and the cosine of the nearest float to π/2 is 6e-17. Exact zeros
    and ones vanish from compiled kernels; these values do not. An entry becomes ±1 only together with the zeros beside
    it: cos(1e-5) is within the tolerance of 1, but a small angle must stay. The remaining entries are orthonormalised
    to the last bit, because algorithms use the transpose as the inverse. The result is a signed permutation, a rotation
    about one axis, or a rotation with one zero entry. If no rotation has these zeros, R is unchanged.
    """
    if tolerance == 0:
        return R
    is_zero = np.abs(R) <= tolerance
    zeros_in_row = is_zero.sum(axis=1)
    zeros_in_column = is_zero.sum(axis=0)
    has_zeros_beside = (zeros_in_row[:, None] == 2) & (zeros_in_column[None, :] == 2)
    is_unit = ~is_zero & has_zeros_beside
    snapped = np.where(is_zero, 0.0, R)
    snapped = np.where(is_unit, np.copysign(1.0, R), snapped)
    is_permutation = is_unit.sum() == 3
    if np.array_equal(snapped, R) or is_permutation or _is_rotation(snapped, _MAX_ROUNDING):
        return snapped
    if is_unit.any():  # rotation about one axis: a block of two rows and columns remains
        i, j = np.argwhere(is_unit)[0]  # the only unit
        other_rows = [k for k in range(3) if k != i]
        other_columns = [k for k in range(3) if k != j]
        block = np.ix_(other_rows, other_columns)
        snapped[block] = _nearest_orthogonal(snapped[block])
    elif is_zero.sum() == 1:
        row_with_zero = int(zeros_in_row.argmax())  # the only one
        snapped = _orthonormalise_from_row(snapped, row_with_zero)
    return snapped if _is_rotation(snapped, _MAX_ROUNDING_AFTER_SNAP) else R


def _is_rotation(R: Array, tolerance: float) -> bool:
    """True if R'R and R R' equal the identity within a tolerance; a reflection passes too."""
    deviations = np.array([R.T @ R - np.eye(3), R @ R.T - np.eye(3)])
    return bool(np.abs(deviations).max() <= tolerance)


def _nearest_orthogonal(B: Array) -> Array:
    """Orthogonal matrix nearest to B (2, 2): a rotation or a reflection, like B."""
    (a, b), (c, d) = B
    determinant = 1.0 if a * d - b * c > 0 else -1.0  # of the orthogonal matrix
    x = a + determinant * d
    y = c - determinant * b
    length = np.hypot(x, y)
    cosine, sine = x / length, y / length
    return np.array([[cosine, -determinant * sine], [sine, determinant * cosine]])


def _orthonormalise_from_row(R: Array, i: int) -> Array:
    """R orthonormalised by Gram–Schmidt with determinant 1, beginning with row i, which has the zero."""
    first_row = R[i] / np.linalg.norm(R[i])
    second_row = R[(i + 1) % 3]
    for _ in range(2):  # twice, against rounding errors
        second_row = second_row - (first_row @ second_row) * first_row
        second_row = second_row / np.linalg.norm(second_row)
    orthonormal = np.empty((3, 3))
    orthonormal[i] = first_row
    orthonormal[(i + 1) % 3] = second_row
    orthonormal[(i + 2) % 3] = np.cross(first_row, second_row)
    return orthonormal


def snap_pose(T: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """T (4, 4) with its rotation snapped; the position is unchanged."""
    if tolerance == 0 or T is IDENTITY:
        return T
    if T[:3, :3].tolist() == UPRIGHT:
        return np.asarray(T + 0.0)  # no negative zeros
    snapped = T.copy()
    snapped[:3, :3] = snap_rotation(T[:3, :3], tolerance)
    return snapped
