"""Limits and loads that can be those of a robot: one check for files, tables and options."""

from __future__ import annotations

import math
from collections import defaultdict
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

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot

_TOLERANCE = 1e-6
"""Relative tolerance of equal numbers that were printed."""
_MIN_PLACEHOLDERS = 3
"""Minimum number of joints whose one round limit is a placeholder."""
_DIGITS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0)


def shared_round(limits: Array) -> bool:
    """True if three joints or more have one limit with a single digit, such as 1, 10 or 100, which is a placeholder.

    >>> shared_round(np.full(6, 10.0)), shared_round(np.full(6, 3.14)), shared_round(np.array([10.0, 20.0, 20.0]))
    (True, False, False)
    """
    known = limits[np.isfinite(limits) & (limits > 0.0)]
    if len(known) < _MIN_PLACEHOLDERS or np.ptp(known) > 0.0:
        return False
    mantissa = float(known[0]) / 10.0 ** np.floor(np.log10(known[0] * (1.0 + _TOLERANCE)))
    return any(abs(mantissa / digit - 1.0) < _TOLERANCE for digit in _DIGITS)


def credible_velocities(limits: Limits) -> Array:
    """Velocity limits (nv,); inf where they are missing, not above zero, or one placeholder for all joints."""
    velocity = limits.velocity
    if shared_round(velocity):
        return np.full(velocity.shape, np.inf)
    return np.where(velocity > 0.0, velocity, np.inf)


_POSES, BY_WEIGHT = 2000, 3.0
"""Number of random poses, and multiple of a torque limit needed by the robot's weight alone, which makes it a placeholder."""


def weight_torques(robot: Robot) -> Array:
    """Largest gravity torque (nv,) of each joint in random poses [N m, N]."""
    q = robot.random_configuration(np.random.default_rng(0), _POSES)
    return np.asarray(np.abs(np.asarray(robot.gravity_forces(q))).max(axis=0))


def credible_efforts(robot: Robot) -> Array:
    """Torque limits (nv,) of the robot's file; inf where missing or not above zero, and everywhere if they are placeholders.

    A limit that the robot's weight alone exceeds by far shows that the unit of all is another, or that none is rated.
    """
    effort = np.where(robot.limits.effort > 0.0, robot.limits.effort, np.inf)
    if shared_round(robot.limits.effort) or (weight_torques(robot) > BY_WEIGHT * effort).any():
        return np.full(effort.shape, np.inf)
    return effort


_UNITS = (STRENGTH, 10.0, math.degrees(1.0), 10 * STRENGTH, 100.0, 100 * STRENGTH, 1000.0)
"""Ratios of units of torque, and of angles, that are mistaken for each other; gears are others from ten on."""
_MIN_UNIT_FACTOR, _MAX_FACTOR_SPREAD = 9.5, 1.1
"""Common factor of the efforts of a table and of a file from which a unit is doubted, and spread of the factor."""
_MIN_DEGREES, _MAX_DEGREES = 4 * math.pi, 400.0
"""Position [rad] from which numbers may be degrees, and position in degrees of the largest range."""
_MIN_JOINTS = 2
"""Joints from which their common factor, or their positions, show a unit."""
_MIN_DEGREES_A_SECOND, _MIN_RATIO_TO_FILE, _NO_LIMIT = 20.0, 3.0, 1e4
"""Speed [rad/s] from which a number of a table may be degrees, multiple of the file's number, and numbers for no limit."""


def credible_limits(limits: Limits, robot: Robot, *, weight: bool = True) -> list[Doubt]:
    """Doubts about limits that a robot cannot have, by file or table alike.

    Positions and speeds that look like degrees contradict a robot. Efforts are doubted if all differ from those of the
    robot's file by one factor of ten or more, or, if ``weight``, if the robot's weight alone needs three times as much.
    Limits given with their unit (:meth:`Limits.has_unit`) are not doubted.
    """
    doubts = [*_degree_doubts(limits, robot), *_effort_unit_doubts(limits, robot)]
    if weight:
        doubts += _weight_doubts(limits, robot)
    return doubts


def _degree_doubts(limits: Limits, robot: Robot) -> list[Doubt]:
    """Doubts about limits of turning joints in degrees: positions of most joints beyond two turns.

    Positions and speeds of a table are also compared with those of the file.
    """
    c, own = Coordinates.from_model(robot.model), robot.limits
    positions = np.maximum(c.position_of, 0)
    turning = c.angular_velocity & (c.position_of >= 0)
    reach, own_reach = _reach(limits), _reach(own)
    stops = turning & ~c.endless[positions] & np.isfinite(reach) & ~limits.has_unit("lower") & ~limits.has_unit("upper")
    speeds = turning & np.isfinite(limits.velocity) & ~limits.has_unit("velocity")
    in_degrees = stops & (reach > _MIN_DEGREES) & (reach < _MAX_DEGREES)
    is_majority = in_degrees.sum() >= _MIN_JOINTS and 2 * in_degrees.sum() > stops.sum()
    too_fast = (speeds & (limits.velocity > FASTEST_TURN))[in_degrees].any()
    if not is_majority or not (too_fast or _are_protractor_angles(reach[in_degrees])):
        in_degrees = _entries_beyond_file(reach, own_reach, stops, _MIN_DEGREES)
    doubts = []
    if in_degrees.any():
        doubts.append(_degree_doubt("position", int(in_degrees.argmax()), reach, c))
    in_degrees = _entries_beyond_file(limits.velocity, own.velocity, speeds, _MIN_DEGREES_A_SECOND)
    if in_degrees.any():
        doubts.append(_degree_doubt("velocity", int(in_degrees.argmax()), limits.velocity, c))
    return doubts


def _reach(limits: Limits) -> Array:
    return np.asarray(np.maximum(np.abs(limits.lower), np.abs(limits.upper)))


def _entries_beyond_file(values: Array, own: Array, entries: Array, least: float) -> Array:
    """Entries above ``least`` and a multiple of the file's numbers, if these are most of those that differ; else none."""
    changed = entries & (values != own) & np.isfinite(own)
    bound = np.maximum(least, _MIN_RATIO_TO_FILE * np.where(np.isfinite(own), own, 0.0))
    beyond = changed & (values > bound) & (values < _NO_LIMIT)
    return beyond if 2 * beyond.sum() > changed.sum() else np.zeros_like(beyond)


def _degree_doubt(what: str, k: int, values: Array, c: Coordinates) -> Doubt:
    joint, turns = c.velocity_names[k], f"{printed(values[k] / math.tau, 3)} turns"
    if what == "velocity":
        turns += " a second"
    words: dict[str, Any] = {"what": what, "limit": printed(values[k]), "joint": repr(joint), "turns": turns}
    return doubt("limits-degrees", [joint], **words)


def _are_protractor_angles(values: Array) -> bool:
    """True if all are whole numbers up to 90 or more, as ranges in degrees are; one number for all only if of quarter turns."""
    are_whole = (values == np.round(values)).all() and values.max(initial=0.0) >= _QUARTER_TURN
    return bool(are_whole and (np.ptp(values) > 0.0 or values[0] % _QUARTER_TURN == 0.0))


_QUARTER_TURN = 90.0
"""Quarter of a turn in degrees."""


def _effort_unit_doubts(limits: Limits, robot: Robot) -> list[Doubt]:
    own = robot.limits.effort
    compared = np.isfinite(own) & np.isfinite(limits.effort) & (own > 0.0) & (limits.effort > 0.0)
    compared &= (limits.effort != own) & ~limits.has_unit("effort")
    if compared.sum() < _MIN_JOINTS or shared_round(own):
        return []
    ratios = limits.effort[compared] / own[compared]
    factor = float(np.median(ratios))
    size = max(factor, 1.0 / factor)
    if size < _MIN_UNIT_FACTOR or ratios.max() > _MAX_FACTOR_SPREAD * ratios.min():
        return []
    nearest_unit = min(_UNITS, key=lambda unit: abs(math.log(size / unit)))
    why = "as torques before a gear are"
    if abs(size / nearest_unit - 1.0) < _MAX_FACTOR_SPREAD - 1.0:
        why = "as another unit of torque is"
    return [doubt("effort-unit", factor=number(factor, 3), why=why)]


def _weight_doubts(limits: Limits, robot: Robot) -> list[Doubt]:
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


_MIN_WEIGHT_SHARE = 0.15
"""Gravity torque over effort below which efforts are doubted; real arms have 0.25 to 0.83."""
_NO_WEIGHT = 1e-6
"""Gravity torque over effort of turning joints whose axes are vertical: rounding."""
_PLACEHOLDER_EFFORT, _MAX_MASS = 1000.0, 50.0
"""Effort [N m or N] taken for a placeholder, and mass [kg] of the robot below which this applies."""
_PULL = 10.0
"""Force of a sliding joint taken for a placeholder, in weights of the moving links: drives of rails pull with less."""
_MIN_ARM_JOINTS, _MAX_FINGER_JOINTS = 3, 4
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
    is_driven = np.zeros(model.nv, bool)
    elastic_joints = {a.joint for name, a in model.actuators.items() if name != a.joint}
    for body in model.leaders:
        is_driven[body.places[1]] = body.joint.driven and body.joint.name not in elastic_joints
    return is_driven


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
    least_large = np.where(turning, _PLACEHOLDER_EFFORT, max(_PLACEHOLDER_EFFORT, _PULL * STRENGTH * model.moving_mass))
    large = driven & np.isfinite(effort) & (effort >= least_large)
    if 2 * large.sum() >= driven.sum() and model.moving_mass < _MAX_MASS:
        return (
            f"efforts of {number(float(effort[large].min()))} and more on {large.sum()} of {driven.sum()} joints of a robot of "
            f"{number(model.moving_mass + model.base_inertia.mass)} kg, which stand for no limit"
        )
    chain = arm_entries(model)
    if len(chain) < _MIN_ARM_JOINTS or not np.isfinite(effort[driven]).all() or not np.any(model.gravity):
        return ""
    share = weight_share(robot, chain, effort)
    bearing = [k for k in chain if turning[k]]
    if not 0 < share < _MIN_WEIGHT_SHARE or not bearing or weight_share(robot, bearing, effort) < _NO_WEIGHT:
        return ""
    smallest, largest = float(effort[chain].min()), float(effort[chain].max())
    what, them = f"efforts of {number(smallest)} to {number(largest)}", "them"
    if smallest == largest:
        what, them = f"effort {number(largest)} on all {len(chain)} joints", "it"
    for name, efforts in _SETS.items():
        if tuple(effort[chain].tolist()) == efforts:
            what += f", which are those of the {name}"
            break
    return f"{what}: the arm's own weight takes at most {percent(share, 2)} of {them}, and 25 to 83 % in real arms"


def weight_share(robot: Robot, entries: list[int], effort: Array) -> float:
    """Largest ratio of gravity torque to effort (nv,) over some entries of τ, at the worst of random poses."""
    return float((weight_torques(robot)[entries] / effort[entries]).max())


def arm_entries(model: Model) -> list[int]:
    """Entries of dq of an arm on a fixed base, from the base to its first branch into fingers; empty for other robots."""
    children: dict[int, list[int]] = defaultdict(list)
    for k, body in enumerate(model.bodies):
        if body.joint.moves_body:
            children[body.parent].append(k)

    def depth(k: int) -> int:
        return 1 + max(map(depth, children[k]), default=0)

    entries, end = [], BASE
    while len(children[end]) == 1:
        [end] = children[end]
        body = model.bodies[end]
        if body.joint.nv != 1:
            return []
        if not body.follows:
            entries.append(body.v_index)
    return entries if all(depth(k) <= _MAX_FINGER_JOINTS for k in children[end]) else []


_MAX_MASS_RATIO = 100.0
"""Mass of a load over the robot's moving mass above which a unit is doubted; arms carry up to their mass, cranes ten times."""


def credible_load(mass: float | None, place: ArrayLike, frame: str | None, robot: Robot, reach: float) -> list[Doubt]:
    """Doubts about a load [kg], None if unknown, at a point (3,) [m] of a frame, the tip if None; reach of the robot [m]."""
    model = robot.model
    name = frame or model.tip
    distance = float(np.linalg.norm(np.asarray(place, float)))
    if distance > reach > 0:
        what = "the payload"
        if mass is not None:
            what += f" of {printed(mass)} kg"
        words: dict[str, Any] = {"what": what, "distance": number(distance), "frame": name, "reach": number(reach, 3)}
        return [doubt("load-far", **words)]
    if mass and name is not None and model.frame(name).body == BASE:
        return [doubt("load-on-base", mass=number(mass), frame=name)]
    if mass and mass > _MAX_MASS_RATIO * model.moving_mass > 0.0:
        return [doubt("load-heavy", mass=number(mass), robot=number(model.moving_mass, 3))]
    return []
