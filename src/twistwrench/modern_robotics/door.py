"""The door of this package: what a caller gave, as real numbers of the right shape, or an error that names it."""

from __future__ import annotations

import operator
from typing import Any

from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, ValueRangeError
from ..lie import checks, se3, so3

Array = NDArray[Any]

__all__ = ["ROUNDED", "array", "count", "pose", "rotation", "same_length"]

ROUNDED = 0.01
"""How far an entry may be from the nearest rotation's: matrices typed with two digits are taken for rotations."""


def array(x: ArrayLike, name: str, *core: int) -> Array:
    """x as real numbers, its last axes of the shape ``core``; float32 stays that."""
    return checks.real(x, name, *core)


def rotation(R: ArrayLike, name: str) -> Array:
    """R (..., 3, 3) as it is where it is a rotation to 1e-6, and the nearest one where it was rounded more than that."""
    R = array(R, name, 3, 3)
    try:
        return checks.rotation(R, name)
    except ValueRangeError:
        return so3.project(R, ROUNDED)


def pose(T: ArrayLike, name: str) -> Array:
    """T (..., 4, 4), its rotation as :func:`rotation` takes it."""
    T = array(T, name, 4, 4)
    try:
        return checks.pose(T, name)
    except ValueRangeError:
        return se3.project(T, ROUNDED)


def count(n: Any, name: str, least: int) -> int:
    """n as a whole number, at least ``least``; 6.0 is one, as the book's package has it."""
    try:
        whole = operator.index(int(n))
    except (TypeError, ValueError, OverflowError):
        whole = least - 1
    if whole < least or whole != n:
        raise ValueRangeError(f"{name} is {n!r}: a whole number is needed, {least} or more.")
    return whole


def same_length(**matrices: Array) -> None:
    """Make sure that matrices with a row for each instant have as many of them."""
    if len({len(m) for m in matrices.values()}) > 1:
        listed = ", ".join(f"{name} {m.shape}" for name, m in matrices.items())
        raise ShapeError(f"the matrices of one motion need as many rows as each other: {listed}.")
