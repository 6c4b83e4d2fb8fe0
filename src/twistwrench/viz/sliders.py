"""Sliders of coordinates on a page: names, units and ranges; and the limbs that fold them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..mechanics.model.model import BASE, Model

MAX_TORQUES = 12
"""Maximum number of torques in a full list; longer lists show the largest and fold the rest by limb."""


def sliders_of(model: Model) -> list[dict[str, Any]]:
    """Sliders of the coordinates, one each.

    A slider has ``name``, index ``q``, velocity indices ``v`` of the joint, ``unit`` (° or m), range ``lower`` to
    ``upper``, and limits ``least``, ``most`` (or None). The three with ``turn`` 0, 1, 2 (roll, pitch, yaw) share a
    quaternion's ``q``.
    """
    sliders: list[dict[str, Any]] = []
    for body in model.leaders:
        least, most = -np.inf, np.inf
        if body.joint.nv == 1:
            least, most = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
        for slider in body.joint.sliders:
            lower, upper = _slider_range(least, most, slider.reach)
            entry = {
                "name": f"{body.joint.name}{slider.label}",
                "q": body.q_index + slider.coordinate,
                "v": list(range(model.nv)[body.places[1]]),
                "unit": slider.unit,
                "lower": lower,
                "upper": upper,
                "least": finite_or_none(least),
                "most": finite_or_none(most),
            }
            if slider.turn is not None:
                entry["turn"] = slider.turn
            sliders.append(entry)
    return sliders


def _slider_range(least: float, most: float, reach: float) -> tuple[float, float]:
    """Range of a slider: the limits; without a limit at least ``reach`` from zero, and twice that from the other limit."""
    lower, upper = least, most
    if not np.isfinite(least):
        lower = min(-reach, most - 2 * reach)
    if not np.isfinite(most):
        upper = max(reach, least + 2 * reach)
    return lower, upper


def finite_or_none(limit: float) -> float | None:
    """Limit for JSON; None if it is infinite."""
    return limit if np.isfinite(limit) else None


def limbs_of(model: Model) -> list[dict[str, Any]]:
    """Chains of joints between branchings of the tree: ``name``, ``torques`` and ``hands`` (sliders).

    >>> import twistwrench as tw
    >>> [(limb["name"], limb["torques"]) for limb in limbs_of(tw.robots.quadruped().model)][1]
    ('FL_hip_joint … FL_calf_joint', [6, 7, 8])
    """
    sliders, limbs = sliders_of(model), []
    first_bodies = _first_bodies(model)
    for first in dict.fromkeys(first_bodies):
        bodies = [body for k, body in enumerate(model.bodies) if first_bodies[k] == first and not body.follows]
        torques: list[int] = []
        coordinates: list[int] = []
        for body in bodies:
            torques += range(model.nv)[body.places[1]]
            coordinates += range(model.nq)[body.places[0]]
        if torques:
            names = dict.fromkeys((bodies[0].joint.name, bodies[-1].joint.name))
            hands = [k for k, slider in enumerate(sliders) if slider["q"] in coordinates]
            limbs.append({"name": " … ".join(names), "torques": torques, "hands": hands})
    return limbs


def _first_bodies(model: Model) -> list[int]:
    """First body of each body's limb: after the base, a branching, or a joint without a drive."""
    parents = [body.parent for body in model.bodies if body.joint.moves_body]
    first_bodies: list[int] = []
    for k, body in enumerate(model.bodies):
        begins = body.parent == BASE or parents.count(body.parent) > 1 or not model.bodies[body.parent].joint.driven
        if begins or not body.joint.moves_body:
            first_bodies.append(k)
        else:
            first_bodies.append(first_bodies[body.parent])
    return first_bodies
