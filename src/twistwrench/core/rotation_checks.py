"""Whether matrices are rotations, and how far they are off."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ValueRangeError
from ..typing import Array
from .printed_numbers import printed

TOLERANCE = 1e-6
"""How far the entries of R' R may be from the identity where a rotation is needed: a rounded float32 rotation passes."""


def refuse(gaps: Array, allowed: float, complaint: str) -> None:
    """Raise when the largest of ``gaps`` (..., n, n) is more than allowed, naming the row of the batch. NaN passes."""
    if not (gaps > allowed).any():
        return
    worst = int(np.nanargmax(gaps))
    row = tuple(int(i) for i in np.unravel_index(worst, gaps.shape))[:-2]
    place = f" (row {', '.join(map(str, row))} of the batch)" if row else ""
    raise ValueRangeError(f"{complaint.format(gap=printed(gaps.flat[worst], 3), allowed=printed(allowed))}{place}.")


def rotation(R: Array, what: str) -> Array:
    """R (..., 3, 3), of float32, float64 or symbols, when it is a rotation to :data:`TOLERANCE`; symbols are not judged."""
    if R.dtype == object or _surely_rotations(R):
        return R
    allowed = max(TOLERANCE, 100 * float(np.finfo(R.dtype).eps))  # float32: what a chain of products adds up to
    with np.errstate(all="ignore"):
        off = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3))
        reflected = np.maximum(0.0, -np.linalg.det(R))[..., None, None]
    refuse(
        np.where(np.isinf(R).any(axis=(-2, -1), keepdims=True), np.inf, off),
        allowed,
        f"{what} is not a rotation: R' R is {{gap}} off the identity, allowed {{allowed}}; "
        "so3.project gives the nearest one",
    )
    refuse(reflected, 0.5, f"{what} is not a rotation but a reflection: det R = -{{gap}}; negate one axis")
    return R


def _surely_rotations(R: Array) -> bool:
    """Whether two rows are orthonormal and the third is their cross product, to a fifth of what is allowed.

    On floats or on columns, for every Ad and inverse asks; finding how far off and where takes ten times as long.
    """
    near = 0.2 * TOLERANCE
    if R.ndim == 2:
        return all(not abs(gap) > near for gap in gaps(R.tolist()))
    with np.errstate(all="ignore"):  # infinite entries are found, not warned of
        return not any((np.abs(gap) > near).any() for gap in gaps(np.moveaxis(R.reshape(-1, 3, 3), 0, -1).copy()))


def gaps(rows: Any) -> tuple[Any, ...]:
    """What the entries of a matrix (3, 3) miss of a rotation: the dot products of two rows, and their cross product."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    return (
        a * a + b * b + c * c - 1.0,
        d * d + e * e + f * f - 1.0,
        a * d + b * e + c * f,
        b * f - c * e - g,
        c * d - a * f - h,
        a * e - b * d - i,
    )


def last_row(T: Array, what: str, allowed: float = TOLERANCE) -> None:
    """Make sure that the last row of T (..., 4, 4) is (0, 0, 0, 1)."""
    if T.ndim == 2 and T[3].tolist() == [0.0, 0.0, 0.0, 1.0]:
        return
    off = np.abs(T[..., 3:, :] - np.array([0.0, 0.0, 0.0, 1.0]))
    refuse(off, allowed, f"{what} is not a pose: its last row is {{gap}} off (0, 0, 0, 1), allowed {{allowed}}")
