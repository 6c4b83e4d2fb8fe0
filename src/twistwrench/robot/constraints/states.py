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
"""Largest gap of the loops in constrained dynamics, rad, and fraction of their span. Intermediate stages of an integrator
have small errors: gaps grow with the square of the step, rates with the step."""
MAX_RATE_VIOLATION = 0.1
"""Largest fraction of a rate that may violate the constraints, for the same reason."""
REST_SPEED = 1e-3
"""rad/s, and fraction of the robot's length per s: slower joints count as at rest. Where a motion reverses, velocities are as
small as integration errors, so that any fraction of them may violate the constraints."""
SINGULAR_RESPONSE = 1e-2
"""Rows whose response to a motion is below this fraction of its typical size are near a singular configuration; rounding and
integration errors dominate them."""


def require_closed(closed: ConstrainedRobot, gaps: Array, tolerance: float, batch: tuple[int, ...]) -> None:
    """Raise ConstraintError that names the start with the largest of its ``gaps`` (n,), if it exceeds ``tolerance``."""
    if not (gaps > tolerance).any():
        return
    worst = int(gaps.argmax())
    raise ConstraintError(
        f"no configuration with closed loops found from here: a gap of {printed(gaps[worst], 3)} ({gap_unit_text(closed)}) is "
        f"left{place_in_batch(worst, batch)}, allowed {printed(tolerance)}. Start nearer to one, or allow more: "
        "consistent(q, tolerance=…)."
    )


def warn_of_far(robot: Robot, q: Array, result: Array, within: float) -> None:
    """Warn if a joint moved further than ``within`` from q to ``result`` (..., nq); names the joint that moved furthest."""
    displacement = np.abs(robot.subtract(result, q))
    if not (displacement > within).any():
        return
    *row, k = np.unravel_index(int(displacement.argmax()), displacement.shape)
    (joint,) = joints(robot, np.arange(robot.nv) == k)
    warnings.warn(
        f"the closed configuration found is not near: joint {joint!r} moved by {printed(displacement.max(), 3)} (rad or m)"
        f"{_batch_row_text(row)}, and {printed(within)} is called near. robot.subtract(found, q) is how far each one went; "
        "start nearer to the configuration meant, or allow more: consistent(q, within=…).",
        ConstraintWarning,
        stacklevel=frames_to_user(),
    )


def warn_of_singular(rank: Array, usual: int) -> None:
    """Warn of states at which the rank of the constraints is lower than usual."""
    singular = rank < usual
    if singular.any():
        warnings.warn(
            f"singular configuration: {singular.sum()} of these states hold the constraints by {rank.min()} "
            f"directions, not {usual}; λ is the one of least norm.",
            ConstraintWarning,
            stacklevel=frames_to_user(),
        )


def require_met(closed: ConstrainedRobot, q: Array, dq: Array, ddq: Array | None = None) -> None:
    """Raise ConstraintError with the constraint violation of a state, if it is too large."""
    rows_with_gaps = with_gaps(closed.constraints)
    gap, allowed = np.abs(closed.gaps(q)), MAX_GAP_OF_SPAN * closed.spans[rows_with_gaps]
    if not (gap <= allowed).all():
        *row, k = np.unravel_index(int((gap / allowed).argmax()), gap.shape)
        name = row_names(closed.constraints)[np.flatnonzero(rows_with_gaps)[k]]
        raise ConstraintError(
            f"q leaves loops open by {printed(gap[(*row, k)], 3)} (rad or m) in {name!r}{_batch_row_text(row)}, allowed "
            f"{printed(allowed[k], 3)}: begin with closed.consistent(q)."
        )
    A = closed.constraint_jacobian(q)
    _require_rate(closed, q, "dq", A, dq, np.zeros(1), "closed.project_velocity(q, dq)")
    if ddq is not None:
        bias = closed.constraint_bias(q, dq)
        _require_rate(closed, q, "ddq", A, ddq, bias, "closed.project_acceleration(q, dq, ddq)")


def _require_rate(closed: ConstrainedRobot, q: Array, name: str, A: Array, v: Array, b: Array, remedy: str) -> None:
    violation = (np.abs((A @ v[..., None])[..., 0] + b) / closed.sizes).max(axis=-1, initial=0.0)
    terms = (np.abs(A) @ (np.abs(v) + REST_SPEED * rate_units(closed))[..., None])[..., 0] + np.abs(b)
    usual_rate = (terms / closed.sizes).max(axis=-1, initial=0.0)
    if (violation <= MAX_RATE_VIOLATION * usual_rate).all():
        return
    # Scaled by the mass matrix, a row of typical size is 1; this is the typical response of rows to such a motion.
    response = np.sqrt(np.maximum((v * (closed.open().mass_matrix(q) @ v[..., None])[..., 0]).sum(axis=-1), 0.0))
    usual_rate = np.maximum(usual_rate, SINGULAR_RESPONSE * response)
    if (violation <= MAX_RATE_VIOLATION * usual_rate).all():
        return
    share = np.divide(violation, usual_rate, out=np.zeros_like(violation), where=usual_rate > 0)
    worst = int(share.argmax())
    raise ConstraintError(
        f"{name} breaks the constraints by {printed(share.flat[worst], 3)} of its size{place_in_batch(worst, share.shape)}, "
        f"allowed {printed(MAX_RATE_VIOLATION)}. Take the nearest that meets them: {remedy}."
    )


def gap_unit_text(closed: ConstrainedRobot) -> str:
    """Units of a gap in words."""
    length = gap_length(closed.open().model)
    return "rad or m" if length == 1.0 else f"rad, or part of {printed(length, 3)} m"


def place_in_batch(flat: int, batch: tuple[int, ...]) -> str:
    """Clause with the row of a batch; empty for one state."""
    return _batch_row_text(np.unravel_index(flat, batch))


def _batch_row_text(row: Iterable[Any]) -> str:
    numbers = ", ".join(map(str, row))
    return f" (row {numbers} of the batch)" if numbers else ""


def joints(robot: Robot, which: Array) -> list[str]:
    """Joints of the velocities selected by the mask ``which`` (nv,)."""
    names = [b.joint.name for b in robot.model.leaders for _ in range(b.joint.nv)]
    return list(dict.fromkeys(compress(names, which)))
