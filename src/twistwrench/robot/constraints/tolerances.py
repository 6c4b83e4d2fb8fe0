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
"""Shortest lever as a fraction of the robot's length.

For shorter levers, single-precision rounding errors of positions exceed the largest allowed gap.
"""
MAX_LENGTH = 1.0
"""Largest length [m] that scales gaps: loops of larger robots are closed to the same absolute gap."""
GAP_LENGTH_SHARE = 4e-3
"""Smallest length that scales gaps, as a fraction of a robot's whole length.

With a tolerance of 1e-12, the smallest used, the gap is then 18 units in the last place of positions.
"""
_SIZE_CONFIGURATIONS = 8
"""Number of random configurations that determine the typical sizes of rows."""


def row_sizes(closed: ConstrainedRobot, new: Constraint) -> tuple[Array, Array]:
    """Sizes and spans of the rows of A, (rows,) each, with the constraint ``new`` appended.

    Sizes are typical ones of rows scaled by the mass matrix. Spans are 1 for angular rows, and a lever [m] for linear rows.
    """
    rows = list(new.rows)
    sizes = six_sizes(closed.open(), new)
    length = robot_length(closed.open().model)
    angular_size = sizes[0]  # of the first angular row
    linear_size = sizes[3]  # of the first linear row
    lever = np.clip(linear_size / angular_size, MIN_LEVER_OF_LENGTH * length, MAX_LENGTH)
    spans = np.repeat([1.0, lever], 3)
    return np.concatenate([closed.sizes, sizes[rows]]), np.concatenate([closed.spans, spans[rows]])


def robot_length(model: Model) -> float:
    """Length [m] that scales gaps: largest distance of links from the base, at most :data:`MAX_LENGTH`."""
    return min(_whole_length(model), MAX_LENGTH)


def _whole_length(model: Model) -> float:
    """Sum [m] of levers and strokes of sliding joints along the longest chain, which scales rounding errors.

    It is :data:`MAX_LENGTH` for a robot without any length.
    """
    distances = {BASE: 0.0}  # largest one from the base to the frame of each body
    for i, body in enumerate(model.bodies):
        sliding_axes = np.flatnonzero(body.joint.axes[:, 3:].any(axis=1))
        lower = np.abs(model.limits.lower[body.v_index + sliding_axes])
        upper = np.abs(model.limits.upper[body.v_index + sliding_axes])
        strokes = np.maximum(lower, upper)
        finite_strokes = np.where(np.isfinite(strokes), strokes, MAX_LENGTH)
        stroke = float(sum(finite_strokes))
        lever = float(np.linalg.norm(body.placement[:3, 3]))
        distances[i] = distances[body.parent] + lever + abs(body.ratio) * stroke
    frames = model.frames.values()
    frame_distances = [distances[frame.body] + float(np.linalg.norm(frame.pose[:3, 3])) for frame in frames]
    length = max(*distances.values(), *frame_distances, 0.0)
    return MAX_LENGTH if length == 0.0 else length


def gap_length(model: Model) -> float:
    """Length [m] that counts as a relative gap of 1."""
    return max(robot_length(model), GAP_LENGTH_SHARE * _whole_length(model))


def gap_units(closed: ConstrainedRobot) -> Array:
    """Unit of the gap of each position row: 1 rad, or :func:`gap_length` in m."""
    rows: list[int] = []
    for constraint in closed.constraints:
        if isinstance(constraint, Closure):
            rows += constraint.rows
    is_angular = np.array(rows, int) < 3
    return np.where(is_angular, 1.0, gap_length(closed.open().model))


def all_rows(constraint: Constraint) -> Constraint:
    """Constraint between the same frames with all six rows."""
    return replace(constraint, rows=tuple(range(6)))


def six_sizes(robot: Robot, constraint: Constraint) -> Array:
    """Typical sizes of the six rows of a constraint, scaled by the mass matrix; (6,)."""
    robot.engine.require_invertible()
    constraints = (all_rows(constraint),)
    configurations = robot.random_configuration(0, _SIZE_CONFIGURATIONS)
    J = np.stack([robot.reference("constraint_jacobian", q, constraints=constraints) for q in configurations])
    return usual_sizes(J, robot.mass_matrix(configurations))


def rate_units(closed: ConstrainedRobot) -> Array:
    """Unit of the rate of each velocity: 1 rad/s, or the robot's length per second."""
    model = closed.open().model
    no_axes = np.zeros((0, 6))  # for a model without joints
    axes = np.concatenate([no_axes, *[body.joint.axes for body in model.leaders]])
    is_angular = axes[:, :3].any(axis=1)
    return np.where(is_angular, 1.0, robot_length(model))
