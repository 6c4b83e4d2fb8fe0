"""Sliders of coordinates on a page: names, units and ranges; and the limbs that fold them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..mechanics.model.model import BASE, Model

MAX_TORQUES = 12
"""Maximum number of torques in a full list; longer lists show the largest and fold the rest by limb."""


def sliders_of(model: Model) -> list[dict[str, Any]]:
    """Sliders for the header of a page, one for each coordinate that a user can move.

    An entry has ``name``, the index ``q`` of the coordinate, the indices ``v`` of the joint's velocities, ``unit`` (° or m),
    the range ``lower`` to ``upper`` of the slider, and the limits ``least`` and ``most`` of the position, None without a limit.
    The three sliders of a quaternion have the same ``q``, and ``turn`` 0, 1 and 2 for roll, pitch and yaw.
    """
    sliders: list[dict[str, Any]] = []
    for body in model.leaders:
        min_position = -np.inf
        max_position = np.inf
        if body.joint.nv == 1:
            min_position = float(model.limits.lower[body.v_index])
            max_position = float(model.limits.upper[body.v_index])
        velocity_indices = list(range(body.v_index, body.v_index + body.joint.nv))
        for slider in body.joint.sliders:
            lower, upper = _slider_range(min_position, max_position, slider.reach)
            entry = {
                "name": f"{body.joint.name}{slider.label}",
                "q": body.q_index + slider.coordinate,
                "v": velocity_indices,
                "unit": slider.unit,
                "lower": lower,
                "upper": upper,
                "least": finite_or_none(min_position),
                "most": finite_or_none(max_position),
            }
            if slider.turn is not None:
                entry["turn"] = slider.turn
            sliders.append(entry)
    return sliders


def _slider_range(min_position: float, max_position: float, reach: float) -> tuple[float, float]:
    """Range of a slider, between the limits of the position.

    If a limit is missing, the range ends at a distance ``reach`` from zero, or twice ``reach`` from the other limit if that is
    farther out.
    """
    lower = min_position
    upper = max_position
    if not np.isfinite(min_position):
        lower = min(-reach, max_position - 2 * reach)
    if not np.isfinite(max_position):
        upper = max(reach, min_position + 2 * reach)
    return lower, upper


def finite_or_none(limit: float) -> float | None:
    """Limit for JSON; None if it is infinite."""
    return limit if np.isfinite(limit) else None


def limbs_of(model: Model) -> list[dict[str, Any]]:
    """Limbs for the header of a page: chains of joints between branchings of the tree.

    An entry has ``name``, the indices ``torques`` of its torques, and the indices ``hands`` of its sliders.

    >>> import twistwrench as tw
    >>> [(limb["name"], limb["torques"]) for limb in limbs_of(tw.robots.quadruped().model)][1]
    ('FL_hip_joint … FL_calf_joint', [6, 7, 8])
    """
    sliders = sliders_of(model)
    limbs = []
    first_bodies = _first_bodies(model)
    for first_body in dict.fromkeys(first_bodies):  # each limb once
        bodies = [body for k, body in enumerate(model.bodies) if first_bodies[k] == first_body and not body.follows]
        torque_indices: list[int] = []
        coordinate_indices: list[int] = []
        for body in bodies:
            coordinate_slice, velocity_slice = body.places
            torque_indices += range(model.nv)[velocity_slice]
            coordinate_indices += range(model.nq)[coordinate_slice]
        if torque_indices:
            end_names = dict.fromkeys((bodies[0].joint.name, bodies[-1].joint.name))  # one name if it has one joint
            slider_indices = [k for k, slider in enumerate(sliders) if slider["q"] in coordinate_indices]
            limbs.append({"name": " … ".join(end_names), "torques": torque_indices, "hands": slider_indices})
    return limbs


def _first_bodies(model: Model) -> list[int]:
    """Index of the first body of each body's limb: a child of the base, of a branching, or of a joint without a drive."""
    parents = [body.parent for body in model.bodies if body.joint.moves_body]
    first_bodies: list[int] = []
    for k, body in enumerate(model.bodies):
        is_after_branching = parents.count(body.parent) > 1
        begins_limb = body.parent == BASE or is_after_branching or not model.bodies[body.parent].joint.driven
        if begins_limb or not body.joint.moves_body:
            first_bodies.append(k)
        else:
            first_bodies.append(first_bodies[body.parent])
    return first_bodies
