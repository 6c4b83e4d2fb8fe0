"""The limits that a motion is asked to keep: the robot's own, or others in their places."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..model.limits import Limits, margin
from ..robot.robot_argument import require_robot
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds of a motion: limits of position, velocity, acceleration and torque, (nv,) each, inf where nothing is limited."""

    lower: Array
    """Least positions [rad or m]."""
    upper: Array
    """Largest positions [rad or m]."""
    velocity: Array
    """Largest velocities [rad/s or m/s]."""
    acceleration: Array
    """Largest accelerations [rad/s² or m/s²]."""
    effort: Array
    """Largest torques [N m or N]."""

    def excess(self, kind: str, values: Array) -> Array:
        """How far values are past their limits.

        Parameters
        ----------
        kind : "position", "velocity", "acceleration" or "torque"
        values : (..., nv) array, of that kind

        Returns
        -------
        excess : (..., nv) array, negative inside; -inf where nothing is limited

        Examples
        --------
        >>> import twistwrench as tw
        >>> bounds = bounds_of(tw.robots.planar_2r(), velocity=2.0)
        >>> bounds.excess("velocity", np.array([1.5, 2.5])).tolist()
        [-0.5, 0.5]
        """
        if kind == "position":
            return np.asarray(np.maximum(values - self.upper, self.lower - values))
        return np.asarray(np.abs(values) - self.limit(kind))

    def limit(self, kind: str) -> Array:
        """Limit of a magnitude.

        Parameters
        ----------
        kind : "position", "velocity", "acceleration" or "torque"

        Returns
        -------
        limit : (nv,) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> bounds = bounds_of(tw.robots.planar_2r(), velocity=2.0)
        >>> bounds.limit("velocity").tolist()
        [2.0, 2.0]
        """
        return np.asarray({"velocity": self.velocity, "acceleration": self.acceleration, "torque": self.effort}[kind])

    def tolerance(self, kind: str) -> Array:
        """How far past a limit still counts as at it: the same share of every limit.

        Parameters
        ----------
        kind : "position", "velocity", "acceleration" or "torque"

        Returns
        -------
        tolerance : (nv,) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> bounds = bounds_of(tw.robots.planar_2r(), velocity=2.0)
        >>> bounds.tolerance("velocity").shape
        (2,)
        """
        if kind == "position":
            return Limits(self.lower, self.upper, self.velocity, self.effort).tolerance
        return margin(self.limit(kind))


def bounds_or_own(robot: Robot, bounds: Bounds | None) -> Bounds:
    """The bounds, or the robot's own limits for None. Raises ValueRangeError for what is neither."""
    if bounds is None:
        return bounds_of(robot)
    if not isinstance(bounds, Bounds):
        raise ValueRangeError(
            f"bounds is {arguments.shown(bounds)}: give tw.trajectories.bounds_of(robot, velocity=…), or None for "
            "the robot's own."
        )
    return bounds


def bounds_of(
    robot: Robot,
    *,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    effort: ArrayLike | None = None,
) -> Bounds:
    """Bounds of a robot: its limits with the given ones in their places.

    Parameters
    ----------
    robot : Robot
    velocity : (nv,) array_like or float, optional [rad/s, m/s]
    acceleration : (nv,) array_like or float, optional [rad/s², m/s²]
    effort : (nv,) array_like or float, optional [N m, sliding joints: N]

    Returns
    -------
    bounds : Bounds

    Raises
    ------
    ShapeError, ValueRangeError
        A limit is of another size, or not above zero.

    Examples
    --------
    >>> import twistwrench as tw
    >>> bounds_of(tw.robots.planar_2r(), velocity=2.0).velocity.tolist()
    [2.0, 2.0]
    """
    require_robot(robot, "bounds_of")
    found = {}
    given = {"velocity": velocity, "acceleration": acceleration, "effort": effort}
    own = {"velocity": robot.limits.velocity, "acceleration": np.full(robot.nv, np.inf), "effort": robot.limits.effort}
    for name, values in given.items():
        if values is None:
            found[name] = np.asarray(own[name], float)
            continue
        array = np.asarray(arguments.real(values, name, names=robot.model.velocity_names), float)
        if array.shape not in ((), (robot.nv,)):
            raise ShapeError(
                f"{name} has shape {array.shape}: give one number, or {robot.nv}, one for each of "
                f"{', '.join(robot.model.velocity_names[:12])}."
            )
        if not (array > 0).all():
            raise ValueRangeError(
                f"{name} has {printed(array[~(array > 0)].flat[0])}: a limit is above 0, inf for none."
            )
        found[name] = np.broadcast_to(array, (robot.nv,)).copy()
    return Bounds(robot.limits.lower, robot.limits.upper, found["velocity"], found["acceleration"], found["effort"])
