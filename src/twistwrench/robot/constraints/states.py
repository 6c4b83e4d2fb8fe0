"""Checks that states meet the constraints, and warnings of those that are far from it, or singular."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import ConstraintError, ConstraintWarning
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.algorithms.constraints import row_names, with_gaps
from ...mechanics.model.description import frames_to_user
from .tolerances import gap_length, rate_units

if TYPE_CHECKING:
    from ..doors import ConstrainedRobot
    from ..robot import Robot

MAX_GAP_OF_SPAN = 1e-2
"""Largest gap of the loops in constrained dynamics, rad, and fraction of their span.

Intermediate stages of an integrator have small errors: gaps grow with the square of the step, rates with the step.
"""
MAX_RATE_VIOLATION = 0.1
"""Largest fraction of a rate that may violate the constraints, for the same reason as :data:`MAX_GAP_OF_SPAN`."""
REST_SPEED = 1e-3
"""Speed below which joints count as at rest, rad/s, and fraction of the robot's length per s.

Where a motion reverses, velocities are as small as integration errors, so that any fraction of them may violate the
constraints.
"""
SINGULAR_RESPONSE = 1e-2
"""Response of a row to a motion below which it is near a singular configuration, as a fraction of its typical size.

Rounding and integration errors dominate such rows.
"""


def require_closed(closed: ConstrainedRobot, gaps: Array, tolerance: float, batch_shape: tuple[int, ...]) -> None:
    """Raise ConstraintError that names the start with the largest of its ``gaps`` (n,), if it exceeds ``tolerance``."""
    if not (gaps > tolerance).any():
        return
    worst_state = int(gaps.argmax())
    raise ConstraintError(
        f"no configuration with closed loops found from here: a gap of {printed(gaps[worst_state], 3)} "
        f"({gap_unit_text(closed)}) is left{place_in_batch(worst_state, batch_shape)}, allowed {printed(tolerance)}. Start "
        "nearer to one, or allow more: consistent(q, tolerance=…)."
    )


def warn_of_far(robot: Robot, q: Array, result: Array, within: float) -> None:
    """Warn if a joint moved further than ``within`` from q to ``result`` (..., nq); names the joint that moved furthest."""
    displacement = np.abs(robot.subtract(result, q))
    if not (displacement > within).any():
        return
    *row, k = np.unravel_index(int(displacement.argmax()), displacement.shape)
    is_farthest = np.arange(robot.nv) == k
    (joint,) = joints(robot, is_farthest)
    warnings.warn(
        f"the closed configuration found is not near: joint {joint!r} moved by {printed(displacement.max(), 3)} (rad or m)"
        f"{_batch_row_text(row)}, and {printed(within)} is called near. robot.subtract(found, q) is how far each one went; "
        "start nearer to the configuration meant, or allow more: consistent(q, within=…).",
        ConstraintWarning,
        stacklevel=frames_to_user(),
    )


def warn_of_singular(rank: Array, usual_rank: int) -> None:
    """Warn of states at which the rank of the constraints is lower than usual."""
    is_singular = rank < usual_rank
    if is_singular.any():
        warnings.warn(
            f"singular configuration: {is_singular.sum()} of these states hold the constraints by {rank.min()} "
            f"directions, not {usual_rank}; λ is the one of least norm.",
            ConstraintWarning,
            stacklevel=frames_to_user(),
        )


def require_met(closed: ConstrainedRobot, q: Array, dq: Array, ddq: Array | None = None) -> None:
    """Raise ConstraintError with the constraint violation of a state, if it is too large."""
    has_gap = with_gaps(closed.constraints)
    gaps = np.abs(closed.gaps(q))
    allowed_gaps = MAX_GAP_OF_SPAN * closed.spans[has_gap]
    if not (gaps <= allowed_gaps).all():
        *row, k = np.unravel_index(int((gaps / allowed_gaps).argmax()), gaps.shape)
        name = row_names(closed.constraints)[np.flatnonzero(has_gap)[k]]
        raise ConstraintError(
            f"q leaves loops open by {printed(gaps[(*row, k)], 3)} (rad or m) in {name!r}{_batch_row_text(row)}, allowed "
            f"{printed(allowed_gaps[k], 3)}: begin with closed.consistent(q)."
        )
    A = closed.constraint_jacobian(q)
    _require_rate(closed, q, "dq", A, dq, np.zeros(1), "closed.project_velocity(q, dq)")
    if ddq is not None:
        bias = closed.constraint_bias(q, dq)
        _require_rate(closed, q, "ddq", A, ddq, bias, "closed.project_acceleration(q, dq, ddq)")


def _require_rate(closed: ConstrainedRobot, q: Array, name: str, A: Array, v: Array, b: Array, remedy: str) -> None:
    """Raise ConstraintError if A v + b, which should be zero, is too large for rates v (..., nv) called ``name``."""
    violation_of_rows = np.abs((A @ v[..., None])[..., 0] + b)
    violation = (violation_of_rows / closed.sizes).max(axis=-1, initial=0.0)
    # The terms of A v + b without their signs, none of which is smaller than at rest.
    speeds = np.abs(v) + REST_SPEED * rate_units(closed)
    sum_of_terms = (np.abs(A) @ speeds[..., None])[..., 0] + np.abs(b)
    usual_rate = (sum_of_terms / closed.sizes).max(axis=-1, initial=0.0)
    if (violation <= MAX_RATE_VIOLATION * usual_rate).all():
        return
    # Scaled by the mass matrix, a row of typical size is 1; this is the typical response of rows to such a motion.
    twice_kinetic_energy = (v * (closed.open().mass_matrix(q) @ v[..., None])[..., 0]).sum(axis=-1)
    response = np.sqrt(np.maximum(twice_kinetic_energy, 0.0))
    usual_rate = np.maximum(usual_rate, SINGULAR_RESPONSE * response)
    if (violation <= MAX_RATE_VIOLATION * usual_rate).all():
        return
    share = np.divide(violation, usual_rate, out=np.zeros_like(violation), where=usual_rate > 0)
    worst_state = int(share.argmax())
    place = place_in_batch(worst_state, share.shape)
    raise ConstraintError(
        f"{name} breaks the constraints by {printed(share.flat[worst_state], 3)} of its size{place}, "
        f"allowed {printed(MAX_RATE_VIOLATION)}. Take the nearest that meets them: {remedy}."
    )


def gap_unit_text(closed: ConstrainedRobot) -> str:
    """Units of a gap in words."""
    length = gap_length(closed.open().model)
    if length == 1.0:
        return "rad or m"
    return f"rad, or part of {printed(length, 3)} m"


def place_in_batch(flat_index: int, batch_shape: tuple[int, ...]) -> str:
    """Clause with the row of a state in a batch, from its index in the flat batch; empty for one state."""
    return _batch_row_text(np.unravel_index(flat_index, batch_shape))


def _batch_row_text(row: Iterable[Any]) -> str:
    """Clause with a row, an index in each axis of a batch; empty without axes."""
    indices = ", ".join(map(str, row))
    return f" (row {indices} of the batch)" if indices else ""


def joints(robot: Robot, mask: Array) -> list[str]:
    """Joints of the velocities selected by a mask (nv,), each once."""
    joint_of_velocity: list[str] = []
    for body in robot.model.leaders:
        joint_of_velocity += [body.joint.name] * body.joint.nv
    return list(dict.fromkeys(compress(joint_of_velocity, mask)))
