"""Where things are: positions, and orientations in the five ways that MJCF writes them."""

from __future__ import annotations

import math

import numpy as np

from ...errors import RobotFileError
from ...lie import quaternion, so3
from ...lie.identity import IDENTITY, UPRIGHT, pose_rows
from ...typing import Array
from ..element import Element
from .settings import Settings

_TURNED = frozenset(("quat", "axisangle", "xyaxes", "zaxis", "euler"))
_PLACED = _TURNED | {"pos"}
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def placement(element: Element, settings: Settings) -> Array:
    """The pose (4, 4) that an element gives by ``pos`` and an orientation, the identity where it gives none."""
    said = element.attributes
    if _PLACED.isdisjoint(said):
        return IDENTITY
    R = UPRIGHT if _TURNED.isdisjoint(said) else rotation(element, settings).tolist()
    return pose_rows(R, element.floats("pos", (0.0, 0.0, 0.0)))


def rotation(element: Element, settings: Settings) -> Array:
    """The orientation (3, 3) that an element gives by quat, axisangle, xyaxes, zaxis or euler."""
    said = element.attributes
    ways = [way for way in ("axisangle", "xyaxes", "zaxis", "euler") if way in said]
    if len(ways) > 1:
        raise RobotFileError(f"{element} says its orientation in {len(ways)} ways: {', '.join(ways)}. Keep one.")
    if not ways:
        return _by_quaternion(element) if "quat" in said else np.eye(3)
    if ways[0] == "axisangle":
        *axis, angle = element.numbers("axisangle", 4).tolist()
        return _turned(direction(element, "axisangle", axis), angle * settings.angle)
    if ways[0] == "xyaxes":
        values = element.numbers("xyaxes", 6)
        x = direction(element, "xyaxes", values[:3])
        y = direction(element, "xyaxes", values[3:] - (x @ values[3:]) * x)
        return np.column_stack([x, y, so3.cross(x, y)])
    if ways[0] == "zaxis":
        return onto(direction(element, "zaxis", element.numbers("zaxis", 3)))
    R = np.eye(3)
    angles = element.numbers("euler", 3) * settings.angle
    for letter, angle in zip(settings.euler_sequence, angles, strict=True):
        turn = _turned(np.array(_AXES[letter.lower()]), float(angle))
        R = R @ turn if letter.islower() else turn @ R  # about axes that turn along, or that stand still
    return R


def onto(z: Array) -> Array:
    """The smallest rotation that takes the z axis to a unit vector; half a turn about x where they are opposite."""
    axis = np.array([-z[1], z[0], 0.0])
    sine = float(np.linalg.norm(axis))
    if sine < 1e-10:
        return np.eye(3) if z[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return _turned(axis / sine, math.atan2(sine, float(z[2])))


def direction(element: Element, attribute: str, vector: object) -> Array:
    """A vector at unit length; an error where it has none."""
    found = np.asarray(vector, float)
    length = float(np.linalg.norm(found))
    if not length > 1e-14:
        raise RobotFileError(
            f"{element} has {attribute}={element.attributes.get(attribute, '')!r}, which is no direction."
        )
    return found / length


def _by_quaternion(element: Element) -> Array:
    values = element.floats("quat", (1.0, 0.0, 0.0, 0.0))
    if not any(values):
        raise RobotFileError(f"{element} has a quaternion of zeros, which is no rotation. The identity is 1 0 0 0.")
    return quaternion.rotation(values)


def _turned(axis: Array, angle: float) -> Array:
    """About a unit vector."""
    return np.asarray(so3.exp(axis * angle))
