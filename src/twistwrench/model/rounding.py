"""Round-off cleanup: rotations that are nearly permutations, or about one axis, become exactly that."""

from __future__ import annotations

import math

import numpy as np

from ..lie.identity import IDENTITY, UPRIGHT
from ..typing import Array

DEFAULT_SNAP = 1e-9
"""Distance from 0 or ±1 below which an entry of a fixed rotation is set to it."""

_ROUNDING = 4.5e-16, 1e-15
"""A rotation whose R'R and R R' are this near to the identity is one to the last bit: sums of three products, each rounded.
The first for what is let alone, the second for what was made orthonormal."""

_ONE = np.eye(3)


def snap_rotation(R: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """R (3, 3) with the entries within ``tolerance`` of 0 or ±1 set to it, made a rotation again; 0 changes nothing.

    A robot file writes a right angle as 1.57079632679, and even the best float for π/2 has a cosine of 6e-17; exact
    zeros and ones vanish from the compiled kernels, and these do not. An entry becomes ±1 only together with the zeros
    beside it: cos(1e-5) is nearer to 1 than the tolerance, but a small angle is an angle. What is left of the rotation is
    made orthonormal to the last bit, for the algorithms take a transpose for an inverse: a signed permutation, a turn
    about one axis, or a rotation with one zero entry. Where small entries are zeros of no rotation, nothing is changed.
    """
    if tolerance == 0:
        return R
    rows = R.tolist()
    zero = [[abs(x) <= tolerance for x in row] for row in rows]
    across, down = [sum(row) for row in zero], [sum(column) for column in zip(*zero, strict=True)]
    alone = [(i, j) for i in range(3) for j in range(3) if across[i] == down[j] == 2 and not zero[i][j]]
    found = [
        [0.0 if none else x for x, none in zip(row, mask, strict=True)] for row, mask in zip(rows, zero, strict=True)
    ]
    for i, j in alone:
        found[i][j] = math.copysign(1.0, rows[i][j])
    snapped = np.array(found)
    if found == rows or len(alone) == 3 or _is_rotation(snapped, _ROUNDING[0]):
        return snapped
    if alone:
        i, j = alone[0]
        rest = np.ix_([k for k in range(3) if k != i], [k for k in range(3) if k != j])
        snapped[rest] = _nearest_of_two(snapped[rest])
    elif sum(across) == 1:
        snapped = _with_one_zero(snapped, across.index(1))
    return snapped if _is_rotation(snapped, _ROUNDING[1]) else R


def _is_rotation(R: Array, allowed: float) -> bool:
    return all(bool(np.abs(product - _ONE).max() <= allowed) for product in (R.T @ R, R @ R.T))


def _nearest_of_two(B: Array) -> Array:
    """The orthogonal matrix nearest to B (2, 2): a rotation or a reflection, as B is."""
    (a, b), (c, d) = B
    side = 1.0 if a * d - b * c > 0 else -1.0
    x, y = a + side * d, c - side * b
    x, y = x / np.hypot(x, y), y / np.hypot(x, y)
    return np.array([[x, -side * y], [y, side * x]])


def _with_one_zero(R: Array, i: int) -> Array:
    """R orthonormal again by Gram and Schmidt, from row i, which has the zero; determinant 1."""
    first, second = R[i] / np.linalg.norm(R[i]), R[(i + 1) % 3]
    for _ in range(2):  # once more, for what rounding left
        second = second - (first @ second) * first
        second = second / np.linalg.norm(second)
    found = np.empty((3, 3))
    found[i], found[(i + 1) % 3], found[(i + 2) % 3] = first, second, np.cross(first, second)
    return found


def snap_pose(T: Array, tolerance: float = DEFAULT_SNAP) -> Array:
    """T (4, 4) with its rotation snapped; the position is left as it is."""
    if tolerance == 0 or T is IDENTITY:
        return T
    if T[:3, :3].tolist() == UPRIGHT:
        return np.asarray(T + 0.0)  # no minus zeros
    snapped = T.copy()
    snapped[:3, :3] = snap_rotation(T[:3, :3], tolerance)
    return snapped
