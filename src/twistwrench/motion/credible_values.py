"""Limits and loads that can be those of a robot: one check for files, tables and options."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.doubts import Doubt, doubt
from ..core.gravity import STRENGTH
from ..core.numbers import number, printed
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


def credible_limits(limits: Limits, robot: Robot, *, weight: bool = True) -> list[Doubt]:
    """Doubts about limits that a robot cannot have, by file or table alike.

    Positions and speeds that look like degrees contradict a robot. Efforts are doubted if all differ from those of the
    robot's file by one factor of ten or more, or, if ``weight``, if the robot's weight alone needs three times as much.
    """
    weak = _too_weak(limits, robot) if weight else []
    return [*_degrees(limits, robot.model), *_units_of_effort(limits, robot), *weak]


def _degrees(limits: Limits, model: Model) -> list[Doubt]:
    """Doubt about limits of turning joints in degrees: more than half, and two or more, are beyond two turns."""
    c = Coordinates.from_model(model)
    at = np.maximum(c.position_of, 0)
    turning = c.angular_velocity & (c.position_of >= 0) & ~c.endless[at]
    reach = np.maximum(np.abs(limits.lower), np.abs(limits.upper))
    bounded = turning & np.isfinite(reach)
    far = bounded & (reach > _TURNS) & (reach < _MOST)
    fast = turning & (limits.velocity > FASTEST_TURN) & np.isfinite(limits.velocity)
    if far.sum() < _FEWEST or 2 * far.sum() <= bounded.sum() or not (fast[far].any() or _of_protractor(reach[far])):
        return []
    k = int(np.flatnonzero(far)[0])
    turns = printed(reach[k] / math.tau, 3)
    return [doubt("limits-degrees", [c.velocity_names[k]], limit=printed(reach[k]), turns=turns)]


def _of_protractor(values: Array) -> bool:
    """True if all are whole numbers up to 90 or more, as ranges in degrees are; one number for all only if of quarter turns."""
    whole = (values == np.round(values)).all() and values.max() >= _QUARTER
    return bool(whole and (np.ptp(values) > 0.0 or values[0] % _QUARTER == 0.0))


_QUARTER = 90.0


def _units_of_effort(limits: Limits, robot: Robot) -> list[Doubt]:
    own = robot.limits.effort
    both = np.isfinite(own) & np.isfinite(limits.effort) & (own > 0.0) & (limits.effort > 0.0)
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
    known = np.isfinite(effort) & (effort > 0.0)
    if not known.any() or not np.any(robot.model.gravity):
        return []
    share = np.where(known, weight_torques(robot) / np.where(known, effort, 1.0), 0.0)
    k = int(share.argmax())
    if not share[k] > BY_WEIGHT:
        return []
    name = robot.model.drive_labels[k]
    return [doubt("effort-weight", [name], joint=name, times=number(float(share[k]), 2))]


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
    return []
