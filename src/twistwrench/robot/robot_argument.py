"""The check that an argument is a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from ..core import arguments
from ..errors import ValueRangeError
from .task_space_methods import TaskSpaceMethods

if TYPE_CHECKING:
    from .robot import Robot


def require_robot(robot: object, what: str) -> Robot:
    """``robot``, which must be one. Raises ValueRangeError.

    >>> require_robot([0.1, 0.2], "fastest")
    Traceback (most recent call last):
    twistwrench.errors.ValueRangeError: fastest: the robot is [0.1, 0.2]: give a tw.Robot, as tw.load(path) makes one.
    """
    if isinstance(robot, TaskSpaceMethods):  # a base class of Robot's alone, which imports nothing that asks here
        return cast("Robot", robot)
    advice = "of a closed robot take closed.robot" if hasattr(robot, "robot") else "as tw.load(path) makes one"
    raise ValueRangeError(f"{what}: the robot is {arguments.shown(robot)}: give a tw.Robot, {advice}.")
