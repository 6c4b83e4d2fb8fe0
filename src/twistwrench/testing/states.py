"""Random states of motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..robot import Robot
from ..typing import Array


class State(NamedTuple):
    """Where a robot is and how it moves: q (..., nq), dq and ddq (..., nv)."""

    q: Array
    """Configuration (..., nq)."""
    dq: Array
    """Velocities (..., nv), rad/s or m/s."""
    ddq: Array
    """Accelerations (..., nv), rad/s² or m/s²."""


def random_state(robot: Robot, rng: np.random.Generator | int | None = None, size: int | tuple[int, ...] = ()) -> State:
    """Random state: a configuration inside the limits, velocities and accelerations of order 1.

    Parameters
    ----------
    robot : Robot
    rng : numpy Generator or seed
    size : int or tuple of int, batch shape

    Returns
    -------
    state : State, q (*size, nq), dq and ddq (*size, nv)

    Examples
    --------
    >>> import twistwrench as tw
    >>> random_state(tw.robots.ur5(), 0, size=4).dq.shape
    (4, 6)
    """
    rng = np.random.default_rng(rng)
    shape = (size,) if isinstance(size, int) else tuple(size)
    q = robot.random_configuration(rng, shape)
    return State(q, rng.standard_normal((*shape, robot.nv)), rng.standard_normal((*shape, robot.nv)))
