"""Errors for states that violate the constraints, and warnings of singular or distant configurations."""

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
"""Largest gap of the loops in constrained dynamics: angles in rad, lengths as a fraction of the loop's span.

Intermediate stages of an integrator have small errors: gaps grow with the square of the step, rates with the step.
"""
MAX_RATE_VIOLATION = 0.1
"""Largest fraction of a rate that may violate the constraints: intermediate stages of an integrator violate them, too."""
REST_SPEED = 1e-3
"""Speed below which joints count as at rest: in rad/s, or in lengths of the robot per s.

Where a motion reverses, velocities are as small as integration errors, so that any fraction of them may violate the
constraints.
"""
SINGULAR_RESPONSE = 1e-2
"""Response of a row to a motion, as a fraction of its typical size, below which the configuration is nearly singular.

Rounding and integration errors dominate such a response.
"""


def require_closed(closed: ConstrainedRobot, gaps: Array, tolerance: float, batch_shape: tuple[int, ...]) -> None:
    """Raise ConstraintError that names the start with the largest of the ``gaps`` (n,), if this exceeds ``tolerance``."""
    if not (gaps > tolerance).any():
        return
    worst_state = int(gaps.argmax())
    raise ConstraintError(
        f"no configuration with closed loops found from here: a gap of {printed(gaps[worst_state], 3)} "
        f"({gap_unit_text(closed)}) is left{place_in_batch(worst_state, batch_shape)}, allowed {printed(tolerance)}. Start "
        "nearer to one, or allow more: consistent(q, tolerance=…)."
    )


def warn_of_far(robot: Robot, q: Array, result: Array, within: float) -> None:
    """Warn if a joint moved further than ``within`` from q to ``result`` (..., nq), with the joint that moved furthest."""
    displacement = np.abs(robot.subtract(result, q))
    if not (displacement > within).any():
        return
    *batch_index, k = np.unravel_index(int(displacement.argmax()), displacement.shape)
    is_farthest = np.arange(robot.nv) == k
    (joint,) = joints(robot, is_farthest)
    warnings.warn(
        f"the closed configuration found is not near: joint {joint!r} moved by {printed(displacement.max(), 3)} (rad or m)"
        f"{_batch_row_text(batch_index)}, and {printed(within)} is called near. robot.subtract(found, q) is how far each one "
        "went; start nearer to the configuration meant, or allow more: consistent(q, within=…).",
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
        worst_index = np.unravel_index(int((gaps / allowed_gaps).argmax()), gaps.shape)
        *batch_index, k = worst_index
        row = np.flatnonzero(has_gap)[k]  # of A
        name = row_names(closed.constraints)[row]
        raise ConstraintError(
            f"q leaves loops open by {printed(gaps[worst_index], 3)} (rad or m) in {name!r}{_batch_row_text(batch_index)}, "
            f"allowed {printed(allowed_gaps[k], 3)}: begin with closed.consistent(q)."
        )
    A = closed.constraint_jacobian(q)
    _require_rate(closed, q, "dq", A, dq, np.zeros(1), "closed.project_velocity(q, dq)")
    if ddq is not None:
        bias = closed.constraint_bias(q, dq)
        _require_rate(closed, q, "ddq", A, ddq, bias, "closed.project_acceleration(q, dq, ddq)")


def _require_rate(closed: ConstrainedRobot, q: Array, name: str, A: Array, v: Array, b: Array, remedy: str) -> None:
    """Raise ConstraintError if A v + b, which should be zero, is too large for rates v (..., nv) called ``name``.

    ``remedy`` is the call that returns the nearest rates without a violation.
    """
    row_violations = np.abs((A @ v[..., None])[..., 0] + b)
    violation = (row_violations / closed.sizes).max(axis=-1, initial=0.0)
    # The terms of A v + b without their signs, none of which is smaller than at rest.
    speeds = np.abs(v) + REST_SPEED * rate_units(closed)
    sum_of_terms = (np.abs(A) @ speeds[..., None])[..., 0] + np.abs(b)
    usual_rate = (sum_of_terms / closed.sizes).max(axis=-1, initial=0.0)
    if (violation <= MAX_RATE_VIOLATION * usual_rate).all():
        return
    # Scaled by the mass matrix, a row of typical size is 1; this is the typical response of rows to such a motion.
    momentum = (closed.open().mass_matrix(q) @ v[..., None])[..., 0]
    twice_kinetic_energy = (v * momentum).sum(axis=-1)
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


def _batch_row_text(batch_index: Iterable[Any]) -> str:
    """Clause with the row of a batch, from its index in each axis of the batch; empty without axes."""
    indices = ", ".join(map(str, batch_index))
    return f" (row {indices} of the batch)" if indices else ""


def joints(robot: Robot, mask: Array) -> list[str]:
    """Names of the joints whose velocities are selected by a mask (nv,), each once."""
    joint_of_velocity: list[str] = []
    for body in robot.model.leaders:
        joint_of_velocity += [body.joint.name] * body.joint.nv
    return list(dict.fromkeys(compress(joint_of_velocity, mask)))
