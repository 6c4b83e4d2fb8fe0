"""Argument checks of ``statics``: poses and directions as they have to be, or an error that says what is wrong with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


def one_configuration(robot: Robot, q: ArrayLike, what: str, why: str) -> Array:
    """``q`` (nq,) of finite numbers, for ``what`` takes one pose only, for the reason ``why``.

    Raises ShapeError, ValueRangeError.
    """
    array = np.asarray(arguments.real(q, f"{what}: q", robot.nq, names=robot.coordinate_names), float)
    if array.ndim != 1:
        raise ShapeError(
            f"{what} takes one q ({robot.nq},) of robot {robot.name!r}, got shape {array.shape}: {why}. "
            f"Call it pose by pose: [{what}(robot, x, …) for x in q.reshape(-1, {robot.nq})]."
        )
    if not np.isfinite(array).all():
        k = int(np.argmin(np.isfinite(array)))
        raise ValueRangeError(f"{what}: {robot.coordinate_names[k]!r} is {printed(array[k])}. Give finite coordinates.")
    return array


def unit_vectors(direction: ArrayLike, *sizes: int) -> Array:
    """``direction`` (..., n) made of unit length, with n one of ``sizes``. Raises ShapeError, ValueRangeError."""
    try:
        given = np.shape(direction)[-1:]
    except ValueError:  # ragged, which is refused below
        given = ()
    n = given[0] if given and given[0] in sizes else sizes[0]
    try:
        d = np.asarray(arguments.real(direction, "direction", n), float)
    except ShapeError as problem:
        more = "".join(f" Or give {k} numbers." for k in sizes[1:])
        raise ShapeError(f"{problem}{more}") from None
    length = np.linalg.norm(d, axis=-1, keepdims=True)
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise ValueRangeError("a direction of zero or not finite length points nowhere. Give one with a finite length.")
    return d / length


def same_batch(**arrays: Array) -> None:
    """Refuse batches that do not broadcast, the last axis of each left out. Raises ShapeError."""
    try:
        np.broadcast_shapes(*(x.shape[:-1] for x in arrays.values()))
    except ValueError:
        raise arguments.mismatch(**arrays) from None
