"""Default gravity, the weight of a kilogram, and check of a given gravity."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from .arguments import number
from .errors import ShapeError, ValueRangeError
from .text import Argument
from .typing import Array

GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of gravity in a frame whose z axis points up [m/s²]. MR section 8.1."""

STRENGTH = -GRAVITY[2]
"""Magnitude of gravity [m/s²]."""

KGF = 9.80665
"""Weight of a kilogram, for files with kilograms as a unit of force [N]."""


def checked_strength(gravity: float) -> float:
    """Magnitude of gravity [m/s²]; raises ValueRangeError unless it is finite and above 0."""
    if not 0 < number(gravity, "gravity") < math.inf:
        text = f"{{0}} is not a valid magnitude of gravity. Give it in m/s², such as {STRENGTH}."
        raise ValueRangeError(text, Argument("gravity", gravity))
    return gravity


def vertical_axis(gravity: ArrayLike) -> Array:
    """Axis of the world (3,) that is vertical in a file: z, or another one that is nearest to gravity's line if z is far.

    Floors and soles are level along it. Gravity that leans from it, by up to 60 degrees from z, is that of a slope.

    >>> [vertical_axis(g).tolist() for g in ([0, 0, -9.81], [0, -9.81, 0], [7.6, 0, -6.2], [0, 0, 9.81])]
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    """
    size = np.abs(np.asarray(gravity, float))
    axis = 2
    if size[2] < _MIN_VERTICAL_SHARE * np.linalg.norm(size):
        axis = int(size.argmax())
    return np.eye(3)[axis]


_MIN_VERTICAL_SHARE = 0.5
"""Cosine of the angle from z up to which gravity is that of a slope in a file whose z axis is vertical."""


def gravity_vector(g: ArrayLike) -> Array:
    """Gravity as a read-only array of finite numbers.

    Returns
    -------
    g : (3,) array [m/s²]

    Examples
    --------
    >>> gravity_vector([0, 0, -1.62]).tolist()
    [0.0, 0.0, -1.62]
    """
    try:
        vector = np.array(g, float)
    except (TypeError, ValueError):
        raise ShapeError(f"gravity is {g!r}, expected three numbers, such as {GRAVITY}.") from None
    if vector.shape != (3,):
        raise ShapeError(f"gravity has shape {vector.shape}, expected (3,): an acceleration such as {GRAVITY}.")
    if not np.isfinite(vector).all():
        raise ValueRangeError(f"gravity is {vector.tolist()}; its components must be finite.")
    vector.setflags(write=False)
    return vector
