"""Hands on a robot: the sliders that move its coordinates, named, with their ranges."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..model.model import Body, Model

__all__ = ["hands_of"]

_SLIDE = 1.0
"""How far a slider goes either way where there are no limits [m]."""


def hands_of(model: Model) -> list[dict[str, Any]]:
    """A hand for each coordinate: its ``name``, place ``q``, ``unit`` (° or m), range ``lower`` to ``upper`` of the slider,
    and limits ``least``, ``most`` (None without); three with ``turn`` 0, 1, 2 (roll, pitch, yaw) share a quaternion's ``q``."""
    return [hand for body in model.leaders for hand in _of_joint(model, body)]


def _of_joint(model: Model, body: Body) -> list[dict[str, Any]]:
    name, at = body.joint.name, body.q_index
    if body.joint.kind == "floating":
        turns = [
            _hand(f"{name} {word}", at, "°", -most, most) | {"turn": k}
            for k, (word, most) in enumerate((("roll", math.pi), ("pitch", math.pi / 2), ("yaw", math.pi)))
        ]
        return turns + [_hand(f"{name} {x}", at + 4 + k, "m", -_SLIDE, _SLIDE) for k, x in enumerate("xyz")]
    if body.joint.kind == "planar":
        slides = [_hand(f"{name} {x}", at + k, "m", -_SLIDE, _SLIDE) for k, x in enumerate("xy")]
        return [*slides, _hand(f"{name} theta", at + 2, "°", -math.pi, math.pi)]
    turning = bool(body.joint.axes[0, :3].any())
    reach = math.pi if turning else _SLIDE
    least, most = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
    hand = _hand(
        name,
        at,
        "°" if turning else "m",
        least if np.isfinite(least) else min(-reach, most - 2 * reach),
        most if np.isfinite(most) else max(reach, least + 2 * reach),
    )
    bounds = {"least": least if np.isfinite(least) else None, "most": most if np.isfinite(most) else None}
    return [hand | bounds]


def _hand(name: str, q: int, unit: str, lower: float, upper: float) -> dict[str, Any]:
    return {"name": name, "q": q, "unit": unit, "lower": lower, "upper": upper, "least": None, "most": None}
