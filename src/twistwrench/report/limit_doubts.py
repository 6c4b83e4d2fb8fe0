"""The one judgement of the torque limits that a verdict rests on: joints that have none, and limits that stand for none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.printed_numbers import number, percent
from ..listing import listed
from ..model.limits import Limits
from ..model.model import BASE, Model
from ..typing import Array
from .limits_file import StatedLimits

if TYPE_CHECKING:
    from ..robot import Robot

LOADED = 1e-6
"""Share of the largest torque from which a joint is loaded; less is rounding."""
TEMPLATE = (
    "write a table with 'twistwrench info ROBOT --csv limits.csv', fill in its efforts, and add --limits limits.csv"
)
"""Remedy for missing limits."""
_LISTED = 6
_POSES, _USUAL = 2000, 0.15
"""Random poses, and the share of effort below which an arm's own weight leaves it in doubt: real arms have 0.25 to 0.83."""
_LARGE, _LIGHT = 1000.0, 50.0
"""Effort [N m or N] that stands for none, in a robot of less than so many kilograms."""
_CHAIN, _FINGER = 3, 4
"""Fewest joints of an arm before it branches, and most joints one behind the other of a finger."""
_SETS = {
    "UR10": (330.0, 330.0, 150.0, 54.0, 54.0, 54.0),
    "UR5": (150.0, 150.0, 150.0, 28.0, 28.0, 28.0),
    "UR3": (56.0, 56.0, 28.0, 12.0, 12.0, 12.0),
    "Panda": (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    "iiwa 14": (320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0),
}
"""Efforts of arms that are often copied into files of others [N m]."""


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


def limit_doubts(robot: Robot, limits: Limits, peaks: ArrayLike) -> list[str]:
    """A sentence, without a full stop, for each reason why limits of torque cannot be judged.

    ``peaks`` (nv,) are the largest torques of a motion or pose. Limits that the user gave are not doubted.
    """
    said, model = [], robot.model
    if missing := unlimited(model, limits.effort, peaks):
        asked = int(loaded_entries(model, peaks).sum())
        named = "" if len(missing) == asked else f" ({listed(missing, _LISTED)})"
        said.append(
            f"no torque limit for {len(missing)} of {asked} joint{'s' if asked > 1 else ''}{named}, which cannot be judged; "
            f"{TEMPLATE}"
        )
    stated = limits.stated if isinstance(limits, StatedLimits) else np.zeros(model.nv, bool)
    if (loaded_entries(model, peaks) & ~stated).any() and (placeholders := placeholder_limits(robot)):
        said.append(f"{placeholders}; give the real limits with --limits")
    return said


def placeholder_limits(robot: Robot) -> str:
    """Sentence, without a full stop, on efforts of the robot's file that are probably no limits of its motors; empty if none.

    An arm whose own weight, at the worst of many random poses, takes less than 15 % of every effort; or a light robot with
    1000 N m and more on half of its joints. Joints with actuators are left out: their limits are the user's.
    """
    model = robot.model
    driven = driven_entries(model)
    if not driven.any() or model.actuators:
        return ""
    effort = model.limits.effort
    large = driven & np.isfinite(effort) & (effort >= _LARGE)
    if 2 * large.sum() >= driven.sum() and model.moving_mass < _LIGHT:
        return (
            f"efforts of {number(float(effort[large].min()))} and more on {large.sum()} of {driven.sum()} joints of a robot of "
            f"{number(model.moving_mass)} kg, which stand for no limit"
        )
    chain = arm_entries(model)
    if len(chain) < _CHAIN or not np.isfinite(effort[driven]).all() or not np.any(model.gravity):
        return ""
    q = robot.random_configuration(np.random.default_rng(0), _POSES)
    weight = np.abs(np.asarray(robot.gravity_forces(q)))[:, chain].max(axis=0)
    share = weight / effort[chain]
    if not weight.max() > 0 or share.max() >= _USUAL:
        return ""
    least, most = float(effort[chain].min()), float(effort[chain].max())
    what = (
        f"effort {number(most)} on all {len(chain)} joints"
        if least == most
        else f"efforts of {number(least)} to {number(most)}"
    )
    copied = [name for name, known in _SETS.items() if tuple(effort[chain].tolist()) == known]
    return (
        f"{what}{f', which are those of the {copied[0]}' if copied else ''}: the arm's own weight takes at most "
        f"{percent(float(share.max()), 2)} of {'it' if least == most else 'them'}, and 25 to 83 % in real arms"
    )


def arm_entries(model: Model) -> list[int]:
    """Entries of dq of an arm on a fixed base, from the base to where it branches into fingers; empty for other robots."""
    moving = [k for k, b in enumerate(model.bodies) if b.joint.moves_body]
    below = {k: [i for i in moving if model.bodies[i].parent == k] for k in [BASE, *moving]}

    def depth(k: int) -> int:
        return 1 + max(map(depth, below[k]), default=0)

    found, at = [], BASE
    while len(below[at]) == 1:
        [at] = below[at]
        body = model.bodies[at]
        if body.joint.nv != 1:
            return []
        if not body.follows:
            found.append(body.v_index)
    return found if all(depth(k) <= _FINGER for k in below[at]) else []
