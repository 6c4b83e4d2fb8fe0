"""The directions of the base in which a tip can be moved at will."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..robot import Robot

AXES = ("vx", "vy", "vz")
_POSES = 16


def task_rows(robot: Robot, frame: str | None = None) -> tuple[str, ...]:
    """Names of velocities of a frame, its tip if None, that are independent at most configurations: as many as there are.

    >>> import twistwrench as tw
    >>> task_rows(tw.robots.planar_2r()), task_rows(tw.robots.ur5())
    (('vx', 'vz'), ('vx', 'vy', 'vz'))
    """
    J = np.asarray(robot.jacobian(robot.random_configuration(0, _POSES), frame, kind="world_aligned"))[:, 3:]
    found: list[int] = []
    for k in range(3):
        if np.linalg.matrix_rank(J[:, [*found, k]], tol=1e-9).max() > len(found):
            found.append(k)
    return tuple(AXES[k] for k in found)
