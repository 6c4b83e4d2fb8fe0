"""Random states of motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..robot import Robot

Array = NDArray[Any]

__all__ = ["State", "random_state"]


class State(NamedTuple):
    """Where a robot is and how it moves: q (..., nq), dq and ddq (..., nv)."""

    q: Array
    dq: Array
    ddq: Array


def random_state(robot: Robot, rng: np.random.Generator | int | None = None, size: int | tuple[int, ...] = ()) -> State:
    """A random configuration inside the limits, velocities and accelerations of order 1; (*size, nq), (*size, nv).

    >>> import twistwrench as tw
    >>> random_state(tw.robots.ur5(), 0, size=4).dq.shape
    (4, 6)
    """
    rng = np.random.default_rng(rng)
    shape = (size,) if isinstance(size, int) else tuple(size)
    q = robot.random_configuration(rng, shape)
    return State(q, rng.standard_normal((*shape, robot.nv)), rng.standard_normal((*shape, robot.nv)))
