"""The one judgement of the torque limits that a verdict rests on: joints that have none, and limits that stand for none."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..listing import listed
from ..model.model import Model
from ..typing import Array

LOADED = 1e-6
"""Share of the largest torque from which a joint is loaded; less is rounding."""
TEMPLATE = (
    "write a table with 'twistwrench info ROBOT --csv limits.csv', fill in its efforts, and add --limits limits.csv"
)
"""Remedy for missing limits."""
_LISTED = 6


def driven_entries(model: Model) -> Array:
    """Entries of τ, (nv,) of bool, that an actuator gives: not those of floating joints, and of elastic joints the motor's."""
    found = np.zeros(model.nv, bool)
    springs = {a.joint for name, a in model.actuators.items() if name != a.joint}
    for body in model.leaders:
        found[body.places[1]] = body.joint.driven and body.joint.name not in springs
    return found


def loaded_entries(model: Model, peaks: ArrayLike) -> Array:
    """Entries of τ, (nv,) of bool, that a question is about: driven, and with a torque in ``peaks`` (nv,) [N m or N]."""
    size = np.abs(np.asarray(peaks, float))
    return driven_entries(model) & (size > LOADED * size.max(initial=0.0))


def unlimited(model: Model, effort: ArrayLike, peaks: ArrayLike) -> list[str]:
    """Names of the joints that are loaded by ``peaks`` (nv,) and have no limit in ``effort`` (nv,)."""
    missing = loaded_entries(model, peaks) & ~np.isfinite(effort)
    return [name for name, none in zip(model.velocity_names, missing, strict=True) if none]


def limit_doubts(model: Model, effort: ArrayLike, peaks: ArrayLike) -> list[str]:
    """A sentence, without a full stop, for each reason why limits of torque cannot be judged.

    ``effort`` and ``peaks`` are the limits and the largest torques of a motion or pose, (nv,).
    """
    said = []
    if missing := unlimited(model, effort, peaks):
        asked = int(loaded_entries(model, peaks).sum())
        named = "" if len(missing) == asked else f" ({listed(missing, _LISTED)})"
        said.append(
            f"no torque limit for {len(missing)} of {asked} joint{'s' if asked > 1 else ''}{named}, which cannot be judged; "
            f"{TEMPLATE}"
        )
    return said
