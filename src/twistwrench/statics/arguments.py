"""Argument checks of statics: poses, directions and units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.numbers import printed
from ..core.text import Argument, spell
from ..core.typing import Array
from ..robot.base import require_robot

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot


def one_configuration(robot: Robot, q: ArrayLike, function: str, reason: str) -> Array:
    """Validated configuration (nq,), finite.

    For a batch, raises ShapeError with the name of the ``function`` and the ``reason`` why it takes no batch. For a coordinate
    that is not finite, raises ValueRangeError.
    """
    require_robot(robot, function)
    array = np.asarray(arguments.real(q, f"{function}: q", robot.nq, names=robot.coordinate_names), float)
    if array.ndim != 1:
        raise ShapeError(
            f"{function} takes one q ({robot.nq},) of robot {robot.name!r}, got shape {array.shape}: {reason}. "
            f"Call it pose by pose: [{function}(robot, x, …) for x in q.reshape(-1, {robot.nq})]."
        )
    is_finite = np.isfinite(array)
    if not is_finite.all():
        k = int(np.argmin(is_finite))  # the first False
        raise ValueRangeError(
            f"{function}: {robot.coordinate_names[k]!r} is {printed(array[k])}. Give finite coordinates."
        )
    return array


def unit_vectors(direction: ArrayLike, *sizes: int) -> Array:
    """Directions (..., n) of unit length; n must be one of ``sizes``. Raises ShapeError and ValueRangeError."""
    try:
        shape = np.shape(direction)
    except ValueError:  # lists of unequal lengths; rejected below
        shape = ()
    n = sizes[0]  # of which the error speaks if no size fits
    if shape and shape[-1] in sizes:
        n = shape[-1]
    try:
        d = np.asarray(arguments.real(direction, "direction", n), float)
    except ShapeError as problem:
        alternatives = "".join(f" Or give {size} numbers." for size in sizes[1:])
        raise ShapeError(f"{problem}{alternatives}") from None
    length = np.linalg.norm(d, axis=-1, keepdims=True)
    is_valid = np.isfinite(length) & (length > 0)
    if not is_valid.all():
        raise ValueRangeError("a direction of zero or not finite length points nowhere. Give one with a finite length.")
    return d / length


def same_batch(**arrays: Array) -> None:
    """Raise ShapeError unless the batch shapes, which are all axes but the last, broadcast."""
    try:
        np.broadcast_shapes(*(x.shape[:-1] for x in arrays.values()))
    except ValueError:
        raise arguments.mismatch(**arrays) from None


# ── Unit checks: millimetres for metres, degrees for radians

_SUSPECT_LENGTH = 1.0
"""Lever, or excess of a sliding joint over its limit, above which a wrong unit is suspected [m]."""
_MILLIMETRES = 1000  # per metre
_TURN = 2 * math.pi  # rad


def unit_slips(
    robot: Robot, q: Array, limits: Limits, positions: Mapping[str, Array], *, degrees: bool = False
) -> Iterator[str]:
    """Warnings about values that suggest a wrong unit, in the named ``positions`` (3,) [m] and in q (nq,).

    Suspect are a position beyond 1 m, a sliding joint more than 1 m beyond its limits, and, unless angles are in ``degrees``,
    a revolute joint more than one turn beyond its limits. Limits of a revolute joint that are missing, or wider than ±1 turn,
    count as ±1 turn.
    """
    for name, position in positions.items():
        distance = float(np.linalg.norm(position))
        if distance > _SUSPECT_LENGTH:
            metres = ",".join(printed(x / _MILLIMETRES) for x in position)
            yield f"{name} is {printed(distance)} m from its frame: lengths are in metres. If those are mm, write {metres}."
    for body in robot.model.leaders:
        if body.joint.nq != 1:
            continue
        name = body.joint.name
        coordinate = float(q[body.q_index])
        screw_axis = body.joint.axes[0]
        is_revolute = bool(screw_axis[:3].any())  # the angular part
        widest_limit = _TURN if is_revolute else math.inf
        lower = max(float(limits.lower[body.v_index]), -widest_limit)
        upper = min(float(limits.upper[body.v_index]), widest_limit)
        excess = max(lower - coordinate, coordinate - upper)
        if is_revolute and not degrees and excess > _TURN:
            yield (
                f"{name} at {printed(coordinate)} rad is more than a turn beyond its limits: angles are in radians. If "
                f"those are degrees, add {spell(Argument('degrees', True))}."
            )
        elif not is_revolute and excess > _SUSPECT_LENGTH:
            yield (
                f"{name} at {printed(coordinate)} m is more than 1 m beyond its limits: lengths are in metres. If those are "
                f"mm, write {printed(coordinate / _MILLIMETRES)}."
            )
