"""Where a robot starts that is shown without a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..motion.coordinates import Coordinates
from ..typing import Array

if TYPE_CHECKING:
    from ..robot import Robot


def starting_pose(robot: Robot) -> Array:
    """The neutral configuration, but for joints whose limits leave it out: those are in their middle; (nq,)."""
    q = robot.neutral.copy()
    for body in robot.model.leaders:
        low, high = robot.limits.lower[body.v_index], robot.limits.upper[body.v_index]
        if body.joint.nv == 1 and not low <= q[body.q_index] <= high:
            q[body.q_index] = (low + high) / 2
    return q


def telling_pose(robot: Robot) -> Array:
    """A configuration above the floor of the base and far from singular ones; (nq,)."""
    Q = robot.random_configuration(0, 256)
    turned = np.where(
        Coordinates.of(robot.model).angular, Q - 2 * np.pi * np.round(Q / (2 * np.pi)), Q
    )  # to half a turn
    Q = np.where((robot.limits.lower <= turned) & (turned <= robot.limits.upper), turned, Q)
    heights = np.asarray(robot.link_poses(Q))[..., 2, 3]
    J = np.asarray(robot.jacobian(Q, kind="world_aligned"))
    least = np.linalg.svd(J, compute_uv=False)[:, -1]
    return np.asarray(Q[np.argmax(np.where(heights.min(axis=1) > -1e-9, least, least - 1e3))])
