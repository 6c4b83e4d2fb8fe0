"""What elements of SDF hold as text: numbers, words, poses."""

from __future__ import annotations

import math

import numpy as np

from ...errors import RobotFileError
from ...lie import quaternion
from ...typing import Array
from ..element import Element
from ..inertia_entries import tensor_of
from ..urdf import rotation_of_rpy


def held(element: Element) -> Element:
    """The element with its text as the attribute ``text``, so that numbers are checked as those of attributes are."""
    return element.with_attributes({**element.attributes, "text": element.content})


def number(parent: Element | None, tag: str, default: float) -> float:
    """The number in a child, the default where there is none."""
    child = parent.child(tag) if parent is not None else None
    return default if child is None else held(child).number("text")


def moments(tensor: Element | None) -> Array:
    """The tensor (3, 3) in an ``<inertia>``: what is left out, all of it for None, is that of 1 kg m² about every axis."""
    return tensor_of(lambda name: number(tensor, name, float(name in ("ixx", "iyy", "izz"))))


def vector(element: Element) -> Array:
    """Three numbers."""
    return held(element).numbers("text", 3)


def word(parent: Element, tag: str, default: str = "") -> str:
    """The text in a child, blanks at its ends removed."""
    child = parent.child(tag)
    return default if child is None else child.content.strip()


def said(parent: Element, tag: str) -> bool:
    """Whether a child says true or 1."""
    return word(parent, tag) in ("true", "1")


def pose(element: Element | None) -> Array:
    """The pose (4, 4) in a ``<pose>``: position, then roll, pitch, yaw or a quaternion (x, y, z, w)."""
    T = np.eye(4)
    if element is None or not element.content.strip():
        return T
    form = element.word("rotation_format", ("euler_rpy", "quat_xyzw"), "euler_rpy")
    values = held(element).numbers("text", 6 if form == "euler_rpy" else 7)
    T[:3, 3] = values[:3]
    if form == "quat_xyzw":
        if not values[3:].any():
            raise RobotFileError(f"{element} has a quaternion of zeros, which is no rotation.")
        T[:3, :3] = quaternion.rotation(np.roll(values[3:], 1))
    else:
        degrees = element.attributes.get("degrees", "false").strip() in ("true", "1")
        T[:3, :3] = rotation_of_rpy(values[3:] * (math.pi / 180.0 if degrees else 1.0))
    return T
