"""What log, project and labelled poses ask of a matrix, and errors that say how far off it is and in which row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, ValueRangeError

Array = NDArray[Any]

__all__ = ["TOLERANCE", "finite", "last_row", "pose", "real", "refuse", "rotation"]

TOLERANCE = 1e-6
"""How far the entries of R' R may be from the identity where a rotation is needed: float32 rounding passes."""


def real(x: ArrayLike) -> Array:
    """x as float32 if it is that, else as float64."""
    x = np.asarray(x)
    return x if x.dtype == np.float32 else np.asarray(x, float)


def finite(x: ArrayLike, what: str, shape: tuple[int, ...]) -> Array:
    """x as real numbers, its last axes of the given shape and none of them NaN or infinite."""
    M = real(x)
    if M.shape[-len(shape) :] != shape:
        raise ShapeError(f"{what} has shape {M.shape}, expected (..., {', '.join(map(str, shape))}).")
    bad = ~np.isfinite(M)
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueRangeError(f"{what} has the entry {M[where]} at {where}: every entry must be a finite number.")
    return M


def refuse(gaps: Array, allowed: float, complaint: str) -> None:
    """Raise when the largest of ``gaps`` (..., n, n) is more than allowed, naming the row of the batch."""
    if gaps.size and not (gap := float(gaps.max())) <= allowed:
        row = tuple(int(i) for i in np.unravel_index(int(gaps.argmax()), gaps.shape))[:-2]
        place = f" (row {', '.join(map(str, row))} of the batch)" if row else ""
        raise ValueRangeError(f"{complaint.format(gap=gap, allowed=allowed)}{place}.")


def rotation(R: ArrayLike) -> Array:
    """R (..., 3, 3), when it is a rotation to :data:`TOLERANCE`."""
    R = finite(R, "a rotation matrix", (3, 3))
    off = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3))
    refuse(
        off,
        TOLERANCE,
        "not a rotation: R' R is {gap:.3g} off the identity, allowed {allowed:g}; so3.project gives the nearest one",
    )
    reflected = np.maximum(0.0, -np.linalg.det(R))[..., None, None]
    refuse(reflected, 0.5, "not a rotation but a reflection: det R = -{gap:.3g}; negate one axis")
    return R


def last_row(T: Array, allowed: float = TOLERANCE) -> None:
    """Make sure that the last row of T (..., 4, 4) is (0, 0, 0, 1)."""
    off = np.abs(T[..., 3:, :] - np.array([0.0, 0.0, 0.0, 1.0]))
    refuse(off, allowed, "not a pose: its last row is {gap:.3g} off (0, 0, 0, 1), allowed {allowed:g}")


def pose(T: ArrayLike) -> Array:
    """T (..., 4, 4), when it is a pose to :data:`TOLERANCE`."""
    T = finite(T, "a pose", (4, 4))
    last_row(T)
    rotation(T[..., :3, :3])
    return T
