"""Default gravity, the weight of a kilogram, and checks of gravity from callers."""

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
"""Weight of a kilogram by definition, for files with kilograms as a unit of force [N]."""


def checked_strength(gravity: float) -> float:
    """Magnitude of gravity [m/s²]; raises ValueRangeError unless it is finite and above 0."""
    if not 0 < number(gravity, "gravity") < math.inf:
        message = f"{{0}} is not a valid magnitude of gravity. Give it in m/s², such as {STRENGTH}."
        raise ValueRangeError(message, Argument("gravity", gravity))  # the error puts the argument in place of {0}
    return gravity


def vertical_axis(gravity: ArrayLike) -> Array:
    """Unit vector (3,) of the world's axis that is vertical in a file.

    The axis is z if gravity is at most 60 degrees from z or -z: the ground is then a slope. Otherwise the file has another
    vertical axis, and the axis nearest to gravity is returned. Floors and soles are perpendicular to the axis.

    >>> [vertical_axis(g).tolist() for g in ([0, 0, -9.81], [0, -9.81, 0], [7.6, 0, -6.2], [0, 0, 9.81])]
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]
    """
    components = np.abs(np.asarray(gravity, float))
    axis = 2
    if components[2] < _MIN_COSINE_TO_Z * np.linalg.norm(components):
        axis = int(components.argmax())
    return np.eye(3)[axis]


_MIN_COSINE_TO_Z = 0.5
"""Cosine of 60 degrees, the largest angle between gravity and a vertical z axis."""


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
