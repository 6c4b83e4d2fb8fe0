"""Sliders of a robot's coordinates: names, units and ranges."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

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
