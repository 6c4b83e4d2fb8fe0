"""The sliders that move a robot's coordinates: their names and ranges, what they show, and how they move it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..lie import quaternion
from ..typing import Array

if TYPE_CHECKING:
    from ..joints import Slider
    from ..model.model import Body, Model


def sliders_of(model: Model) -> list[dict[str, Any]]:
    """A slider for each coordinate.

    Its ``name``, place ``q``, ``unit`` (° or m), range ``lower`` to ``upper``, and limits ``least``, ``most`` (None without);
    three with ``turn`` 0, 1, 2 (roll, pitch, yaw) share a quaternion's ``q``.
    """
    return [_of(model, body, slider) for body in model.leaders for slider in body.joint.sliders]


def _of(model: Model, body: Body, slider: Slider) -> dict[str, Any]:
    least, most = -np.inf, np.inf
    if body.joint.nv == 1:
        least, most = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
    found = {
        "name": f"{body.joint.name}{slider.label}",
        "q": body.q_index + slider.coordinate,
        "unit": slider.unit,
        "lower": least if np.isfinite(least) else min(-slider.reach, most - 2 * slider.reach),
        "upper": most if np.isfinite(most) else max(slider.reach, least + 2 * slider.reach),
        "least": least if np.isfinite(least) else None,
        "most": most if np.isfinite(most) else None,
    }
    return found if slider.turn is None else found | {"turn": slider.turn}


def slider_value(hand: dict[str, Any], q: Array) -> float:
    """What the slider ``hand`` shows at a configuration: degrees or metres."""
    value = _angles(q[hand["q"] : hand["q"] + 4])[hand["turn"]] if "turn" in hand else float(q[hand["q"]])
    return float(np.degrees(value)) if hand["unit"] == "°" else value


def with_slider(hand: dict[str, Any], q: Array, value: float) -> Array:
    """The configuration with the slider ``hand`` moved to a value in rad or m."""
    q, at = q.copy(), hand["q"]
    if "turn" not in hand:
        q[at] = value
        return q
    angles = _angles(q[at : at + 4])
    angles[hand["turn"]] = value
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.array(angles) / 2), np.sin(np.array(angles) / 2)
    q[at : at + 4] = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return q


def _angles(quat: Array) -> list[float]:
    """Roll, pitch, yaw of a quaternion."""
    R = np.asarray(quaternion.rotation(quat / np.linalg.norm(quat)))
    pitch = float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
    return [float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))]
