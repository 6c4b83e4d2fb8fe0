"""How large the rows of a constraint usually are, and what gaps and rates are small beside."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..algorithms.constraints import Closure, Constraint
from ..algorithms.weighted_svd import usual_sizes
from ..model.model import BASE
from ..typing import Array

if TYPE_CHECKING:
    from ..model.model import Model
    from .closed_robot import ClosedRobot
    from .robot import Robot

CLOSED = 1e-12
"""rad, and part of the robot's length: loops closed to this are closed; positions are rounded to some 1e-15 of it."""
SHORTEST = 1e-4
"""Part of the robot's length: beside levers shorter than it, positions of single precision are rounded to more than loops may
be open."""
LONGEST = 1.0
"""m: loops of larger robots are closed as well as those of this size."""
ROUNDED = 4e-3
"""Part of a robot's whole length, however large: 1e-12 of this is 18 units in the last place of its positions, and no loop is
closed to less."""


def row_sizes(closed: ClosedRobot, new: Constraint) -> tuple[Array, Array]:
    """How large rows of A usually are, through the mass matrix, and their spans, those of one more constraint appended."""
    sizes, rows = six_sizes(closed.robot, new), list(new.rows)
    length = robot_length(closed.robot.model)
    spans = np.repeat([1.0, np.clip(sizes[3] / sizes[0], SHORTEST * length, LONGEST)], 3)
    return np.concatenate([closed.sizes, sizes[rows]]), np.concatenate([closed.spans, spans[rows]])


def robot_length(model: Model) -> float:
    """m, :data:`LONGEST` at most: how far its links may be from its base, what gaps are small beside."""
    return min(_whole_length(model), LONGEST)


def _whole_length(model: Model) -> float:
    """m: the sum of the levers along the longest chain, with what joints may slide; what positions are rounded by."""
    reach: list[float] = []
    for body in model.bodies:
        sliding = body.joint.axes[:, 3:].any(axis=1)
        most = 0.0
        if sliding.any():
            k = body.v_index
            way = [max(abs(model.limits.lower[k + n]), abs(model.limits.upper[k + n])) for n in np.flatnonzero(sliding)]
            most = float(sum(x if np.isfinite(x) else LONGEST for x in way))
        before = 0.0 if body.parent == BASE else reach[body.parent]
        reach.append(before + float(np.linalg.norm(body.placement[:3, 3])) + abs(body.ratio) * most)
    frames = [
        (0.0 if f.body == BASE else reach[f.body]) + float(np.linalg.norm(f.pose[:3, 3])) for f in model.frames.values()
    ]
    return max([*reach, *frames], default=0.0) or LONGEST


def gap_length(model: Model) -> float:
    """m: what a gap of one is."""
    return max(robot_length(model), ROUNDED * _whole_length(model))


def gap_units(closed: ClosedRobot) -> Array:
    """What a gap of one is, of each row that has a position: 1 rad, or the robot's length in m, or what rounding allows."""
    turning = np.array([k < 3 for c in closed.constraints if isinstance(c, Closure) for k in c.rows], bool)
    return np.where(turning, 1.0, gap_length(closed.robot.model))


def all_rows(constraint: Constraint) -> Constraint:
    """The same constraint with all six rows."""
    return replace(constraint, rows=tuple(range(6)))


def six_sizes(robot: Robot, constraint: Constraint) -> Array:
    """How large the six rows of a constraint usually are, through the mass matrix; (6,)."""
    robot.engine.require_invertible()
    some = robot.random_configuration(0, 8)
    J = np.stack([robot.reference("constraint_jacobian", q, constraints=(all_rows(constraint),)) for q in some])
    return usual_sizes(J, robot.mass_matrix(some))


def rate_units(closed: ClosedRobot) -> Array:
    """What a rate of one is, of each velocity: 1 rad/s, or the robot's length per second."""
    axes = np.concatenate([np.zeros((0, 6)), *(body.joint.axes for body in closed.robot.model.leaders)])
    return np.where(axes[:, :3].any(axis=1), 1.0, robot_length(closed.robot.model))
