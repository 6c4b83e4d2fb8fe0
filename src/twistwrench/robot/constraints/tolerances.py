"""Scales of the rows of constraints, and tolerances of gaps and rates."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.typing import Array
from ...mechanics.algorithms.constraint_projector import usual_sizes
from ...mechanics.algorithms.constraints import Closure, Constraint
from ...mechanics.model.model import BASE, Model

if TYPE_CHECKING:
    from ..doors import ConstrainedRobot
    from ..robot import Robot

MIN_LEVER_OF_LENGTH = 1e-4
"""Fraction of the robot's length: for shorter levers, single-precision rounding errors of positions exceed the largest
allowed gap."""
MAX_LENGTH = 1.0
"""m: loops of larger robots are closed to the same absolute gap as those of this size."""
GAP_LENGTH_SHARE = 4e-3
"""Fraction of a robot's whole length: 1e-12 of it is 18 units in the last place of positions, the smallest tolerance used."""


def row_sizes(closed: ConstrainedRobot, new: Constraint) -> tuple[Array, Array]:
    """Typical sizes of the rows of A, scaled by the mass matrix, and their spans, with one more constraint appended."""
    sizes, rows = six_sizes(closed.open(), new), list(new.rows)
    length = robot_length(closed.open().model)
    spans = np.repeat([1.0, np.clip(sizes[3] / sizes[0], MIN_LEVER_OF_LENGTH * length, MAX_LENGTH)], 3)
    return np.concatenate([closed.sizes, sizes[rows]]), np.concatenate([closed.spans, spans[rows]])


def robot_length(model: Model) -> float:
    """Length in m that scales gaps: distance that links can have from the base, at most :data:`MAX_LENGTH`."""
    return min(_whole_length(model), MAX_LENGTH)


def _whole_length(model: Model) -> float:
    """Sum of the levers along the longest chain with the strokes of sliding joints, in m; scale of rounding errors."""
    reach: list[float] = []
    for body in model.bodies:
        sliding = np.flatnonzero(body.joint.axes[:, 3:].any(axis=1))
        limits = model.limits.lower[body.v_index + sliding], model.limits.upper[body.v_index + sliding]
        strokes = np.maximum(*np.abs(limits))
        stroke = float(sum(np.where(np.isfinite(strokes), strokes, MAX_LENGTH)))
        base_reach = 0.0 if body.parent == BASE else reach[body.parent]
        reach.append(base_reach + float(np.linalg.norm(body.placement[:3, 3])) + abs(body.ratio) * stroke)
    lengths = list(reach)
    for frame in model.frames.values():
        base_reach = 0.0 if frame.body == BASE else reach[frame.body]
        lengths.append(base_reach + float(np.linalg.norm(frame.pose[:3, 3])))
    return max(lengths, default=0.0) or MAX_LENGTH


def gap_length(model: Model) -> float:
    """Length in m that corresponds to a relative gap of 1."""
    return max(robot_length(model), GAP_LENGTH_SHARE * _whole_length(model))


def gap_units(closed: ConstrainedRobot) -> Array:
    """Unit of the gap of each position row: 1 rad, or the robot's length in m, or the bound by rounding errors."""
    turning = np.array([k < 3 for c in closed.constraints if isinstance(c, Closure) for k in c.rows], bool)
    return np.where(turning, 1.0, gap_length(closed.open().model))


def all_rows(constraint: Constraint) -> Constraint:
    """The same constraint with all six rows."""
    return replace(constraint, rows=tuple(range(6)))


def six_sizes(robot: Robot, constraint: Constraint) -> Array:
    """Typical sizes of the six rows of a constraint, scaled by the mass matrix; (6,)."""
    robot.engine.require_invertible()
    samples = robot.random_configuration(0, 8)
    J = np.stack([robot.reference("constraint_jacobian", q, constraints=(all_rows(constraint),)) for q in samples])
    return usual_sizes(J, robot.mass_matrix(samples))


def rate_units(closed: ConstrainedRobot) -> Array:
    """Unit of the rate of each velocity: 1 rad/s, or the robot's length per second."""
    axes = np.concatenate([np.zeros((0, 6)), *(body.joint.axes for body in closed.open().model.leaders)])
    return np.where(axes[:, :3].any(axis=1), 1.0, robot_length(closed.open().model))
