"""The limits that a trajectory passes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..core import arguments
from ..errors import ValueRangeError
from ..motion.bounds import Bounds, bounds_or_own
from ..motion.motion import Motion
from ..motion.violations import LimitCheck, Violation
from ..robot.robot_argument import require_robot
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot
    from .trajectory import Trajectory


def violations(
    robot: Robot,
    trajectory: Trajectory | Motion,
    bounds: Bounds | None = None,
    *,
    friction: bool = False,
    samples: int = 2001,
) -> tuple[Violation, ...]:
    """Limits that a motion passes, worst first.

    Parameters
    ----------
    robot : Robot
    trajectory : Trajectory or Motion, at its own samples
    bounds : Bounds, optional; None: the robot's own
    friction : bool, count the friction of the joints
    samples : int, instants at which a trajectory is looked at

    Returns
    -------
    found : tuple of Violation

    Raises
    ------
    ValueRangeError, ShapeError
        The motion is not of the robot.

    Examples
    --------
    >>> import twistwrench as tw
    >>> from twistwrench import trajectories
    >>> arm = tw.robots.ur5()
    >>> hasty = trajectories.move(arm, [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0], trajectories.cubic(0.3))
    >>> print(violations(arm, hasty)[0])
    shoulder_pan_joint: velocity 5 beyond 3.1416 at 0.15 s
    """
    require_robot(robot, "violations")
    if not hasattr(trajectory, "sample") or isinstance(trajectory, type):
        motion = getattr(trajectory, "motion", trajectory)  # a simulation's result has one
        if not isinstance(motion, Motion):
            raise ValueRangeError(
                f"violations: the motion is {arguments.shown(trajectory)}: give a Trajectory, a tw.Motion, or a simulation."
            )
        return motion.of(robot).violations(bounds, friction=friction)
    samples, friction = arguments.whole(samples, "samples"), arguments.flag(friction, "friction")
    t = np.linspace(0.0, trajectory.duration, samples)
    q, dq, ddq = trajectory(t)
    check = LimitCheck(robot.model, bounds_or_own(robot, bounds))
    check.add(t, q, dq, ddq, robot.inverse_dynamics(q, dq, ddq, friction=friction))
    check.add_dynamics(robot, t, q, dq, ddq)
    return check.violations()


def positions_passed(robot: Robot, s: Array, q: Array, bounds: Bounds) -> tuple[Violation, ...]:
    """The limits of position that configurations (n, nq) pass; ``s`` (n,) stands for the time."""
    check = LimitCheck(robot.model, bounds)
    check.add(s, q, np.zeros((len(s), robot.nv)))
    return check.violations()
