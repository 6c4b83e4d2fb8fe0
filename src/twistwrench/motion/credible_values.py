"""Limits and loads that a robot can have: one check for files, tables and options."""

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
"""Number of joints with one round limit from which this limit is a placeholder."""
_ROUND_MANTISSAS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0)
"""First digits of round limits; 7 is not among them."""


def shared_round(limits: Array) -> bool:
    """True if three joints or more have one limit with a single digit, such as 1, 10 or 100, which is a placeholder.

    >>> shared_round(np.full(6, 10.0)), shared_round(np.full(6, 3.14)), shared_round(np.array([10.0, 20.0, 20.0]))
    (True, False, False)
    """
    known_limits = limits[np.isfinite(limits) & (limits > 0.0)]
    if len(known_limits) < _MIN_PLACEHOLDERS or np.ptp(known_limits) > 0.0:
        return False
    limit = float(known_limits[0])  # all are equal
    # With the tolerance, 9.99999999 counts as 10 and not as a number below it.
    power_of_ten = 10.0 ** np.floor(np.log10(limit * (1.0 + _TOLERANCE)))
    mantissa = limit / power_of_ten
    return any(abs(mantissa / round_mantissa - 1.0) < _TOLERANCE for round_mantissa in _ROUND_MANTISSAS)


def credible_velocities(limits: Limits) -> Array:
    """Velocity limits (nv,); inf where they are missing, not above zero, or one placeholder for all joints."""
    velocity = limits.velocity
    if shared_round(velocity):
        return np.full(velocity.shape, np.inf)
    return np.where(velocity > 0.0, velocity, np.inf)


_POSE_COUNT = 2000
"""Number of random poses in which the robot's weight is evaluated."""
BY_WEIGHT = 3.0
"""Ratio of gravity torque to torque limit above which the limit is a placeholder."""


def weight_torques(robot: Robot) -> Array:
    """Largest gravity torque (nv,) of each joint in random poses [N m, N]."""
    q = robot.random_configuration(np.random.default_rng(0), _POSE_COUNT)
    torques = np.asarray(robot.gravity_forces(q))
    return np.asarray(np.abs(torques).max(axis=0))


def credible_efforts(robot: Robot) -> Array:
    """Torque limits (nv,) of the robot's file; inf if missing or not above zero, and all inf if they are placeholders.

    All are placeholders if the robot's weight alone exceeds one of them by far: they have another unit, or are not limits of
    motors.
    """
    effort = np.where(robot.limits.effort > 0.0, robot.limits.effort, np.inf)
    if shared_round(robot.limits.effort) or (weight_torques(robot) > BY_WEIGHT * effort).any():
        return np.full(effort.shape, np.inf)
    return effort


_UNIT_RATIOS = (STRENGTH, 10.0, math.degrees(1.0), 10 * STRENGTH, 100.0, 100 * STRENGTH, 1000.0)
"""Ratios of units, of torque or of angles, that are mistaken for each other; other ratios from ten on are gears."""
_MIN_UNIT_FACTOR = 9.5
"""Ratio of a table's efforts to a file's from which a unit is doubted."""
_MAX_FACTOR_SPREAD = 1.1
"""Ratio of the largest factor of all joints to the smallest, up to which the joints have a common factor.

It is also the tolerance of a unit's ratio.
"""
_MIN_DEGREES = 4 * math.pi
"""Position [rad] above which a number may be in degrees."""
_MAX_DEGREES = 400.0
"""Upper end of positions in degrees: joints with the largest ranges reach it."""
_MIN_JOINTS = 2
"""Number of joints from which their common factor, or their positions, show a unit."""
_MIN_DEGREES_PER_SECOND = 20.0
"""Speed [rad/s] above which a number of a table may be in degrees a second."""
_MIN_RATIO_TO_FILE = 3.0
"""Ratio to the file's number above which a number of a table may be in degrees."""
_NO_LIMIT = 1e4
"""Position [rad] or speed [rad/s] from which a number stands for no limit."""
_QUARTER_TURN = 90.0
"""Quarter of a turn in degrees."""


def credible_limits(limits: Limits, robot: Robot, *, weight: bool = True) -> list[Doubt]:
    """Doubts about limits that a robot cannot have, whether they are from a file or a table.

    Positions and speeds that look like degrees are doubted. Efforts are doubted if all differ from those of the robot's file
    by one factor of ten or more. With ``weight``, efforts are also doubted if the robot's weight alone needs three times as
    much. Limits given with their unit (:meth:`Limits.has_unit`) are not doubted.
    """
    doubts = [*_degree_doubts(limits, robot), *_effort_unit_doubts(limits, robot)]
    if weight:
        doubts += _weight_doubts(limits, robot)
    return doubts


def _degree_doubts(limits: Limits, robot: Robot) -> list[Doubt]:
    """Doubts about limits of turning joints in degrees: positions of most joints beyond two turns.

    Positions and speeds of a table are also compared with those of the file.
    """
    coordinates = Coordinates.from_model(robot.model)
    file_limits = robot.limits
    has_position = coordinates.position_of >= 0
    q_entries = np.maximum(coordinates.position_of, 0)  # entry 0 for joints without one, which are left out below
    is_hinge = coordinates.angular_velocity & has_position
    largest_positions = _largest_positions(limits)
    has_stops = is_hinge & ~coordinates.endless[q_entries] & np.isfinite(largest_positions)
    has_stops &= ~limits.has_unit("lower") & ~limits.has_unit("upper")
    has_speed = is_hinge & np.isfinite(limits.velocity) & ~limits.has_unit("velocity")
    in_degrees = has_stops & (largest_positions > _MIN_DEGREES) & (largest_positions < _MAX_DEGREES)
    is_majority = in_degrees.sum() >= _MIN_JOINTS and 2 * in_degrees.sum() > has_stops.sum()
    is_too_fast = has_speed & (limits.velocity > FASTEST_TURN)
    look_like_degrees = is_too_fast[in_degrees].any() or _are_protractor_angles(largest_positions[in_degrees])
    if not is_majority or not look_like_degrees:
        in_degrees = _entries_beyond_file(largest_positions, _largest_positions(file_limits), has_stops, _MIN_DEGREES)
    doubts = []
    if in_degrees.any():
        first_entry = int(in_degrees.argmax())  # the first True
        doubts.append(_degree_doubt("position", first_entry, largest_positions, coordinates))
    in_degrees = _entries_beyond_file(limits.velocity, file_limits.velocity, has_speed, _MIN_DEGREES_PER_SECOND)
    if in_degrees.any():
        first_entry = int(in_degrees.argmax())  # the first True
        doubts.append(_degree_doubt("velocity", first_entry, limits.velocity, coordinates))
    return doubts


def _largest_positions(limits: Limits) -> Array:
    """Largest position (nv,) within the limits, without its sign."""
    return np.asarray(np.maximum(np.abs(limits.lower), np.abs(limits.upper)))


def _entries_beyond_file(table_values: Array, file_values: Array, compared: Array, min_value: float) -> Array:
    """Mask of a table's entries that are above ``min_value`` and above a multiple of the file's number.

    ``compared`` is a mask of the entries to compare; those that differ from the file count. No entry is in the result unless
    most of them are.
    """
    is_changed = compared & (table_values != file_values) & np.isfinite(file_values)
    known_file_values = np.where(np.isfinite(file_values), file_values, 0.0)
    bound = np.maximum(min_value, _MIN_RATIO_TO_FILE * known_file_values)
    is_beyond = is_changed & (table_values > bound) & (table_values < _NO_LIMIT)
    if 2 * is_beyond.sum() > is_changed.sum():
        return is_beyond
    return np.zeros_like(is_beyond)


def _degree_doubt(what: str, k: int, values: Array, coordinates: Coordinates) -> Doubt:
    """Doubt about entry k of the limits of a ``position`` or a ``velocity``."""
    joint = coordinates.velocity_names[k]
    turns = f"{printed(values[k] / math.tau, 3)} turns"
    if what == "velocity":
        turns += " a second"
    words: dict[str, Any] = {"what": what, "limit": printed(values[k]), "joint": repr(joint), "turns": turns}
    return doubt("limits-degrees", [joint], **words)


def _are_protractor_angles(values: Array) -> bool:
    """True for whole numbers with a largest one of 90 or more, as in degrees; equal numbers must be quarter turns."""
    is_whole = values == np.round(values)
    if not is_whole.all() or values.max(initial=0.0) < _QUARTER_TURN:
        return False
    are_different = np.ptp(values) > 0.0
    first_is_quarter_turns = values[0] % _QUARTER_TURN == 0.0  # then all are, if they are equal
    return bool(are_different or first_is_quarter_turns)


def _effort_unit_doubts(limits: Limits, robot: Robot) -> list[Doubt]:
    """Doubt about efforts that all differ from the efforts of the robot's file by one factor."""
    file_effort = robot.limits.effort
    is_known_in_file = np.isfinite(file_effort) & (file_effort > 0.0)
    is_known = np.isfinite(limits.effort) & (limits.effort > 0.0)
    is_compared = is_known & is_known_in_file & (limits.effort != file_effort) & ~limits.has_unit("effort")
    if is_compared.sum() < _MIN_JOINTS or shared_round(file_effort):
        return []
    ratios = limits.effort[is_compared] / file_effort[is_compared]
    factor = float(np.median(ratios))
    factor_above_one = max(factor, 1.0 / factor)
    has_common_factor = ratios.max() <= _MAX_FACTOR_SPREAD * ratios.min()
    if factor_above_one < _MIN_UNIT_FACTOR or not has_common_factor:
        return []
    nearest_ratio = min(_UNIT_RATIOS, key=lambda ratio: abs(math.log(factor_above_one / ratio)))
    explanation = "as torques before a gear are"
    if abs(factor_above_one / nearest_ratio - 1.0) < _MAX_FACTOR_SPREAD - 1.0:
        explanation = "as another unit of torque is"
    return [doubt("effort-unit", factor=number(factor, 3), why=explanation)]


def _weight_doubts(limits: Limits, robot: Robot) -> list[Doubt]:
    """Doubt about the effort that the robot's weight alone exceeds most."""
    effort = limits.effort
    is_known = np.isfinite(effort) & (effort > 0.0) & ~limits.has_unit("effort")
    if not is_known.any() or not np.any(robot.model.gravity):
        return []
    known_effort = np.where(is_known, effort, 1.0)
    share = np.where(is_known, weight_torques(robot) / known_effort, 0.0)
    k = int(share.argmax())
    if not share[k] > BY_WEIGHT:
        return []
    name = robot.model.drive_labels[k]
    return [doubt("effort-weight", [name], joint=name, times=number(float(share[k]), 2))]


_MIN_WEIGHT_SHARE = 0.15
"""Ratio of gravity torque to effort below which efforts are doubted; real arms have 0.25 to 0.83."""
_MAX_ROUNDING_SHARE = 1e-6
"""Ratio of gravity torque to effort that is a rounding error, as of turning joints with vertical axes."""
_PLACEHOLDER_EFFORT = 1000.0
"""Effort [N m or N] from which it may be a placeholder."""
_MAX_LIGHT_MASS = 50.0
"""Moving mass [kg] of a robot below which such efforts are placeholders."""
_PLACEHOLDER_WEIGHTS = 10.0
"""Force of a sliding joint, in weights of the moving links, from which it may be a placeholder; drives of rails have less."""
_MIN_ARM_JOINTS = 3
"""Minimum number of joints of an arm before it branches."""
_MAX_FINGER_JOINTS = 4
"""Maximum number of joints in series of a finger."""
_EFFORTS_OF_ARMS = {
    "UR10": (330.0, 330.0, 150.0, 54.0, 54.0, 54.0),
    "UR5": (150.0, 150.0, 150.0, 28.0, 28.0, 28.0),
    "UR3": (56.0, 56.0, 28.0, 12.0, 12.0, 12.0),
    "Panda": (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    "iiwa 14": (320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0),
}
"""Efforts [N m] of arms, from the base on, that are often copied into files of other arms."""


def driven_entries(model: Model) -> Array:
    """Mask (nv,) of the entries of τ with a drive: none of floating joints; for elastic joints the motor's entry."""
    is_driven = np.zeros(model.nv, bool)
    elastic_joints = {actuator.joint for motor, actuator in model.actuators.items() if motor != actuator.joint}
    for body in model.leaders:
        _, entries = body.places
        is_driven[entries] = body.joint.driven and body.joint.name not in elastic_joints
    return is_driven


def placeholder_limits(robot: Robot, limits: Limits) -> str:
    """Sentence, without a full stop, on efforts that are probably not motor limits; empty if there are none.

    Efforts are doubted if half of the joints of a light robot have 1000 N m or more. The efforts of sliding joints must also
    be 10 times the robot's weight. Efforts of an arm are doubted if the arm's own weight needs less than 15 % of each, in the
    worst of many random poses. An arm without a turning joint that bears weight, as a SCARA, is not doubted. Robots with
    actuators are not judged, nor are efforts given with their unit, which the user has confirmed.
    """
    model = robot.model
    is_driven = driven_entries(model)
    has_unconfirmed = (is_driven & ~limits.has_unit("effort")).any()
    if not has_unconfirmed or model.actuators or model.couplings:
        return ""
    effort = limits.effort
    is_angular = Coordinates.from_model(model).angular_velocity
    placeholder_force = max(_PLACEHOLDER_EFFORT, _PLACEHOLDER_WEIGHTS * STRENGTH * model.moving_mass)
    placeholder_effort = np.where(is_angular, _PLACEHOLDER_EFFORT, placeholder_force)
    is_large = is_driven & np.isfinite(effort) & (effort >= placeholder_effort)
    if 2 * is_large.sum() >= is_driven.sum() and model.moving_mass < _MAX_LIGHT_MASS:
        return (
            f"efforts of {number(float(effort[is_large].min()))} and more on {is_large.sum()} of {is_driven.sum()} joints of "
            f"a robot of {number(model.moving_mass + model.base_inertia.mass)} kg, which stand for no limit"
        )
    arm = arm_entries(model)
    has_all_efforts = np.isfinite(effort[is_driven]).all()
    if len(arm) < _MIN_ARM_JOINTS or not has_all_efforts or not np.any(model.gravity):
        return ""
    share = weight_share(robot, arm, effort)
    turning_entries = [k for k in arm if is_angular[k]]
    if not 0 < share < _MIN_WEIGHT_SHARE or not turning_entries:
        return ""
    if weight_share(robot, turning_entries, effort) < _MAX_ROUNDING_SHARE:
        return ""
    arm_efforts = tuple(effort[arm].tolist())
    min_effort = min(arm_efforts)
    max_effort = max(arm_efforts)
    if min_effort == max_effort:
        efforts_text = f"effort {number(max_effort)} on all {len(arm)} joints"
        pronoun = "it"
    else:
        efforts_text = f"efforts of {number(min_effort)} to {number(max_effort)}"
        pronoun = "them"
    for name, efforts in _EFFORTS_OF_ARMS.items():
        if arm_efforts == efforts:
            efforts_text += f", which are those of the {name}"
            break
    weight_text = f"the arm's own weight takes at most {percent(share, 2)} of {pronoun}"
    return f"{efforts_text}: {weight_text}, and 25 to 83 % in real arms"


def weight_share(robot: Robot, entries: list[int], effort: Array) -> float:
    """Largest ratio of gravity torque to effort (nv,) over some entries of τ, at the worst of random poses."""
    torques = weight_torques(robot)
    shares = torques[entries] / effort[entries]
    return float(shares.max())


def arm_entries(model: Model) -> list[int]:
    """Entries of dq of an arm on a fixed base, from the base to its end or to its fingers; empty for other robots."""
    children: dict[int, list[int]] = defaultdict(list)
    for i, body in enumerate(model.bodies):
        if body.joint.moves_body:
            children[body.parent].append(i)

    def joints_in_series(i: int) -> int:
        """Largest number of joints in series from body i on."""
        return 1 + max(map(joints_in_series, children[i]), default=0)

    entries = []
    end = BASE
    while len(children[end]) == 1:
        [end] = children[end]
        body = model.bodies[end]
        if body.joint.nv != 1:
            return []
        if not body.follows:
            entries.append(body.v_index)
    are_fingers = all(joints_in_series(i) <= _MAX_FINGER_JOINTS for i in children[end])
    if not are_fingers:
        return []
    return entries


_MAX_MASS_RATIO = 100.0
"""Ratio of a load's mass to the robot's moving mass above which a unit is doubted; arms carry up to 1, cranes up to 10."""


def credible_load(mass: float | None, place: ArrayLike, frame: str | None, robot: Robot, reach: float) -> list[Doubt]:
    """Doubts about a load of a ``mass`` [kg], None if unknown, at a point ``place`` (3,) [m] of a frame, by default the tip.

    ``reach`` is the reach of the robot [m].
    """
    model = robot.model
    name = frame or model.tip
    distance = float(np.linalg.norm(np.asarray(place, float)))  # from the origin of the frame
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
