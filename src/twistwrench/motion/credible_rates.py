"""Velocity and torque limits of a file that can be those of a robot; a placeholder for all joints is not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core.typing import Array

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..robot import Robot

_TOLERANCE = 1e-6
"""Relative tolerance of equal numbers that were printed."""
_MIN_JOINTS = 3
"""Minimum number of joints whose one round limit is a placeholder."""
_DIGITS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0)


def shared_round(limits: Array) -> bool:
    """True if three joints or more have one limit with a single digit, such as 1, 10 or 100, which is a placeholder.

    >>> shared_round(np.full(6, 10.0)), shared_round(np.full(6, 3.14)), shared_round(np.array([10.0, 20.0, 20.0]))
    (True, False, False)
    """
    known = limits[np.isfinite(limits) & (limits > 0.0)]
    if len(known) < _MIN_JOINTS or np.ptp(known) > 0.0:
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
