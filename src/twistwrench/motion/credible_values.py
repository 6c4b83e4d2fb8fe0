"""Limits and loads that can be those of a robot: one check for files, tables and options."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.doubts import Doubt, doubt
from ..core.gravity import STRENGTH
from ..core.numbers import number, percent, printed
from ..core.typing import Array
from ..mechanics.model.limits import FASTEST_TURN
from ..mechanics.model.model import BASE, Model
from .coordinates import Coordinates
from .plausibility import BY_WEIGHT, shared_round, weight_torques

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot

_UNITS = (STRENGTH, 10.0, math.degrees(1.0), 10 * STRENGTH, 100.0, 100 * STRENGTH, 1000.0)
"""Ratios of units of torque, and of angles, that are mistaken for each other; gears are others from ten on."""
_FROM, _ALIKE = 9.5, 1.1
"""Common factor of the efforts of a table and of a file from which a unit is doubted, and spread of the factor."""
_TURNS, _MOST = 4 * math.pi, 400.0
"""Position [rad] from which numbers may be degrees, and position in degrees of the largest range."""
_FEWEST = 2
_FAST, _FAR, _ENDLESS = 20.0, 3.0, 1e4
"""Speed [rad/s] from which a number of a table may be degrees, multiple of the file's number, and numbers for no limit."""


def credible_limits(limits: Limits, robot: Robot, *, weight: bool = True) -> list[Doubt]:
    """Doubts about limits that a robot cannot have, by file or table alike.

    Positions and speeds that look like degrees contradict a robot. Efforts are doubted if all differ from those of the
    robot's file by one factor of ten or more, or, if ``weight``, if the robot's weight alone needs three times as much.
    Limits given with their unit (:meth:`Limits.has_unit`) are not doubted.
    """
    weak = _too_weak(limits, robot) if weight else []
    return [*_degrees(limits, robot), *_units_of_effort(limits, robot), *weak]


def _degrees(limits: Limits, robot: Robot) -> list[Doubt]:
    """Doubts about limits of turning joints in degrees: positions of most joints beyond two turns.

    Positions and speeds of a table are also compared with those of the file.
    """
    c, own = Coordinates.from_model(robot.model), robot.limits
    at = np.maximum(c.position_of, 0)
    turning = c.angular_velocity & (c.position_of >= 0)
    reach, own_reach = _reach(limits), _reach(own)
    stops = turning & ~c.endless[at] & np.isfinite(reach) & ~limits.has_unit("lower") & ~limits.has_unit("upper")
    speeds = turning & np.isfinite(limits.velocity) & ~limits.has_unit("velocity")
    far = stops & (reach > _TURNS) & (reach < _MOST)
    unusual = (speeds & (limits.velocity > FASTEST_TURN))[far].any() or (far.any() and _of_protractor(reach[far]))
    in_file = far.sum() >= _FEWEST and 2 * far.sum() > stops.sum() and unusual
    far = far if in_file else _beyond_file(reach, own_reach, stops, _TURNS)
    found = [] if not far.any() else [_in_degrees("position", int(far.argmax()), reach, c)]
    fast = _beyond_file(limits.velocity, own.velocity, speeds, _FAST)
    return found if not fast.any() else [*found, _in_degrees("velocity", int(fast.argmax()), limits.velocity, c)]


def _reach(limits: Limits) -> Array:
    return np.asarray(np.maximum(np.abs(limits.lower), np.abs(limits.upper)))


def _beyond_file(values: Array, own: Array, entries: Array, usual: float) -> Array:
    """Entries above ``usual`` and a multiple of the file's numbers, if these are most of those that differ; else none."""
    changed = entries & (values != own) & np.isfinite(own)
    far = changed & (values > np.maximum(usual, _FAR * np.where(np.isfinite(own), own, 0.0))) & (values < _ENDLESS)
    return far if 2 * far.sum() > changed.sum() else np.zeros_like(far)


def _in_degrees(what: str, k: int, values: Array, c: Coordinates) -> Doubt:
    joint, turns = c.velocity_names[k], f"{printed(values[k] / math.tau, 3)} turns"
    turns += " a second" if what == "velocity" else ""
    words: dict[str, Any] = {"what": what, "limit": printed(values[k]), "joint": repr(joint), "turns": turns}
    return doubt("limits-degrees", [joint], **words)


def _of_protractor(values: Array) -> bool:
    """True if all are whole numbers up to 90 or more, as ranges in degrees are; one number for all only if of quarter turns."""
    whole = (values == np.round(values)).all() and values.max() >= _QUARTER
    return bool(whole and (np.ptp(values) > 0.0 or values[0] % _QUARTER == 0.0))


_QUARTER = 90.0


def _units_of_effort(limits: Limits, robot: Robot) -> list[Doubt]:
    own = robot.limits.effort
    both = np.isfinite(own) & np.isfinite(limits.effort) & (own > 0.0) & (limits.effort > 0.0)
    both &= (limits.effort != own) & ~limits.has_unit("effort")
    if both.sum() < _FEWEST or shared_round(own):
        return []
    ratios = limits.effort[both] / own[both]
    factor = float(np.median(ratios))
    size = max(factor, 1.0 / factor)
    if size < _FROM or ratios.max() > _ALIKE * ratios.min():
        return []
    near = min(_UNITS, key=lambda unit: abs(math.log(size / unit)))
    why = "as another unit of torque is" if abs(size / near - 1.0) < _ALIKE - 1.0 else "as torques before a gear are"
    return [doubt("effort-unit", factor=number(factor, 3), why=why)]


def _too_weak(limits: Limits, robot: Robot) -> list[Doubt]:
    effort = limits.effort
    known = np.isfinite(effort) & (effort > 0.0) & ~limits.has_unit("effort")
    if not known.any() or not np.any(robot.model.gravity):
        return []
    share = np.where(known, weight_torques(robot) / np.where(known, effort, 1.0), 0.0)
    k = int(share.argmax())
    if not share[k] > BY_WEIGHT:
        return []
    name = robot.model.drive_labels[k]
    return [doubt("effort-weight", [name], joint=name, times=number(float(share[k]), 2))]


# ── Efforts that are not those of motors

_USUAL = 0.15
"""Gravity torque over effort below which efforts are doubted; real arms have 0.25 to 0.83."""
_NO_WEIGHT = 1e-6
"""Gravity torque over effort of turning joints whose axes are vertical: rounding."""
_LARGE, _LIGHT = 1000.0, 50.0
"""Effort [N m or N] taken for a placeholder, and mass [kg] of the robot below which this applies."""
_PULL = 10.0
"""Force of a sliding joint taken for a placeholder, in weights of the moving links: drives of rails pull with less."""
_CHAIN, _FINGER = 3, 4
"""Minimum number of joints of an arm before it branches, and maximum number of joints in series of a finger."""
_SETS = {
    "UR10": (330.0, 330.0, 150.0, 54.0, 54.0, 54.0),
    "UR5": (150.0, 150.0, 150.0, 28.0, 28.0, 28.0),
    "UR3": (56.0, 56.0, 28.0, 12.0, 12.0, 12.0),
    "Panda": (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    "iiwa 14": (320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0),
}
"""Efforts [N m] of arms that are often copied into files of other arms."""


def driven_entries(model: Model) -> Array:
    """Entries of τ, (nv,) of bool, driven by an actuator: none of floating joints; for elastic joints the motor's entry."""
    found = np.zeros(model.nv, bool)
    springs = {a.joint for name, a in model.actuators.items() if name != a.joint}
    for body in model.leaders:
        found[body.places[1]] = body.joint.driven and body.joint.name not in springs
    return found


def placeholder_limits(robot: Robot, limits: Limits) -> str:
    """Sentence, without a full stop, on efforts of a file or a table that are probably not motor limits; empty if none.

    Efforts are doubted if an arm's own weight needs less than 15 % of each at the worst of many random poses, or if half of the
    joints of a light robot have 1000 N m or more; a sliding joint's is then also 10 times the robot's
    weight. If no turning joint bears weight, as in a SCARA, the weight measures nothing.
    Joints with actuators are left out, and so are efforts given with their unit: the user has confirmed these.
    """
    model = robot.model
    driven = driven_entries(model)
    if not (driven & ~limits.has_unit("effort")).any() or model.actuators or model.couplings:
        return ""
    effort = limits.effort
    turning = Coordinates.from_model(model).angular_velocity
    least_large = np.where(turning, _LARGE, max(_LARGE, _PULL * STRENGTH * model.moving_mass))
    large = driven & np.isfinite(effort) & (effort >= least_large)
    if 2 * large.sum() >= driven.sum() and model.moving_mass < _LIGHT:
        return (
            f"efforts of {number(float(effort[large].min()))} and more on {large.sum()} of {driven.sum()} joints of a robot of "
            f"{number(model.moving_mass + model.base_inertia.mass)} kg, which stand for no limit"
        )
    chain = arm_entries(model)
    if len(chain) < _CHAIN or not np.isfinite(effort[driven]).all() or not np.any(model.gravity):
        return ""
    share = weight_share(robot, chain, effort)
    bearing = [k for k in chain if turning[k]]
    if not 0 < share < _USUAL or not bearing or weight_share(robot, bearing, effort) < _NO_WEIGHT:
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
        f"{percent(share, 2)} of {'it' if least == most else 'them'}, and 25 to 83 % in real arms"
    )


def weight_share(robot: Robot, entries: list[int], effort: Array) -> float:
    """Largest ratio of gravity torque to effort (nv,) over some entries of τ, at the worst of random poses."""
    return float((weight_torques(robot)[entries] / effort[entries]).max())


def arm_entries(model: Model) -> list[int]:
    """Entries of dq of an arm on a fixed base, from the base to its first branch into fingers; empty for other robots."""
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


# ── Loads

_HEAVIEST = 100.0
"""Mass of a load over the robot's moving mass above which a unit is doubted; arms carry up to their mass, cranes ten times."""


def credible_load(mass: float | None, place: ArrayLike, frame: str | None, robot: Robot, reach: float) -> list[Doubt]:
    """Doubts about a load [kg], None if unknown, at a point (3,) [m] of a frame, the tip if None; reach of the robot [m]."""
    model = robot.model
    name = frame or model.tip
    distance = float(np.linalg.norm(np.asarray(place, float)))
    if distance > reach > 0:
        what = "the payload" if mass is None else f"the payload of {printed(mass)} kg"
        words: dict[str, Any] = {"what": what, "distance": number(distance), "frame": name, "reach": number(reach, 3)}
        return [doubt("load-far", **words)]
    if mass and name is not None and model.frame(name).body == BASE:
        return [doubt("load-on-base", mass=number(mass), frame=name)]
    if mass and mass > _HEAVIEST * model.moving_mass > 0.0:
        return [doubt("load-heavy", mass=number(mass), robot=number(model.moving_mass, 3))]
    return []
