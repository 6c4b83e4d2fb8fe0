"""Joint stops: which joints of a pose are beyond the positions they can take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..typing import Array

if TYPE_CHECKING:
    from ..model.limits import Limits
    from ..robot import Robot


@dataclass(frozen=True)
class BeyondStop:
    """A joint that cannot be where the pose puts it."""

    joint: str
    value: float
    """rad or m."""
    stop: float
    """The nearest place it can take [rad or m]."""
    turns: bool
    """Whether it turns, as opposed to slides."""

    @property
    def by(self) -> float:
        """How far it is beyond [rad or m], above zero."""
        return abs(self.value - self.stop)


def joints_beyond_stops(robot: Robot, q: Array, limits: Limits | None = None) -> tuple[BeyondStop, ...]:
    """The joints of one pose (nq,) outside their position limits, the robot's own or those given, farthest first.

    >>> import twistwrench as tw
    >>> [found] = joints_beyond_stops(tw.robots.ur5(), [0, 0, 7.0, 0, 0, 0])
    >>> found.joint, round(found.by, 3)
    ('elbow_joint', 3.858)
    """
    limits = robot.limits if limits is None else limits
    beyond = limits.exceeded(robot.model.positions(q))
    found = []
    for b in robot.model.leaders:
        if b.joint.nq != 1:  # ball, planar and floating joints have no stops
            continue
        if beyond[b.v_index]:
            value, low, high = float(q[b.q_index]), float(limits.lower[b.v_index]), float(limits.upper[b.v_index])
            stop = low if value < low else high
            found.append(BeyondStop(b.joint.name, value, stop, bool(b.joint.axes[0][:3].any())))
    return tuple(sorted(found, key=lambda f: -f.by))
