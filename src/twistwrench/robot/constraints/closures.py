"""Closures and velocity constraints from frames and rows, configurations at which loops are closed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ConstraintError, UnknownNameError
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.algorithms.constraint_projector import mass_weighted_rows
from ...mechanics.algorithms.constraints import Closure, Rolling, place_of
from ...mechanics.algorithms.kinematics import KINDS, row_numbers
from ...mechanics.lie.labelled import TWIST
from ...mechanics.model.couplings import refuse_couplings
from ...mechanics.model.model import BASE, Model
from ..arguments import Rows
from .states import gap_unit_text
from .tolerances import all_rows, six_sizes

if TYPE_CHECKING:
    from ..doors import ConstrainedRobot
    from ..robot import Robot


def closure(model: Model, frame_a: str, frame_b: str, rows: Rows, pose: ArrayLike | None) -> Closure:
    """Closure of :meth:`twistwrench.Robot.close`."""
    refuse_couplings(model, "close")
    frame_a, frame_b = _frame_name(model, frame_a), _frame_name(model, frame_b)
    if place_of(model, frame_a).body == place_of(model, frame_b).body:
        raise ConstraintError(
            f"{frame_a!r} and {frame_b!r} are fixed to one body, so nothing between them can be closed."
        )
    T_ac = np.eye(4) if pose is None else arguments.pose(arguments.one(pose, "pose", 4, 4), "pose")
    return Closure(frame_a, frame_b, row_numbers(rows), tuple(tuple(row) for row in T_ac.tolist()))


def rolling(model: Model, frame: str, rows: Rows, kind: str) -> Rolling:
    """Constraint of :meth:`twistwrench.Robot.constrain`."""
    if kind not in KINDS:
        raise UnknownNameError.from_choices("kind", kind, KINDS)
    refuse_couplings(model, "constrain")
    frame = _frame_name(model, frame)
    if model.frame(frame).body == BASE:
        raise ConstraintError(f"{frame!r} is fixed to the base, so nothing about it can be constrained.")
    return Rolling(frame, row_numbers(rows), kind)


def _frame_name(model: Model, frame: str | None) -> str:
    """Name of the frame, or the tip for None; raises the errors of :meth:`Model.frame`."""
    if frame is None:
        model.frame(None)
        return str(model.tip)
    return frame


# ── Configurations with closed loops, and rows that are independent there

STARTS = 32
"""Number of random start configurations in the search for closed ones; one in a few converges for common mechanisms."""
MAX_FOUND_GAP = 1e-10
"""rad, and fraction of the robot's length: gap far below which the row of A equals that of a closed configuration."""


def some_configurations(closed: ConstrainedRobot, near: ArrayLike | None) -> Array:
    """Configurations with closed loops, found from stored and random ones or from around ``near``; (n, nq)."""
    rng, robot = np.random.default_rng(0), closed.open()
    if near is None:
        stored = [robot.add(q, _spread(rng, robot, 4)) for q in robot.model.configurations.values()]
        starts = np.concatenate([*stored, robot.random_configuration(rng, STARTS - 1), robot.neutral[None]])
    else:
        q = arguments.one(near, "near", robot.nq, names=robot.coordinate_names)
        starts = robot.add(q, _spread(rng, robot, STARTS))
    q, gaps = closed.settled(starts, 0.01 * MAX_FOUND_GAP)
    if not (gaps <= MAX_FOUND_GAP).any():
        raise ConstraintError(
            f"no configuration found at which {closed.constraints[-1].name!r} closes: from {len(starts)} starts the nearest "
            f"leaves a gap of {printed(gaps.min(), 3)} ({gap_unit_text(closed)}). Check pose and rows, or give near=q, one "
            "near it."
        )
    return np.asarray(q[gaps <= MAX_FOUND_GAP])


def _spread(rng: np.random.Generator, robot: Robot, n: int) -> Array:
    """Random displacements (n, nv) of different size; the first is zero."""
    return np.repeat([0.0, 0.01, 0.1, 0.3], n // 4)[:, None] * rng.standard_normal((n, robot.nv))


def require_angle(closed: ConstrainedRobot, q: Array) -> None:
    """Raise an error if one angular row is held alone while other axes rotate too: its rate is not the rate of an angle."""
    new, robot = closed.constraints[-1], closed.open()
    turning = [k for k in new.rows if k < 3]
    if not isinstance(new, Closure) or len(turning) != 1:
        return
    J = robot.kernel("constraint_jacobian", constraints=(all_rows(new),))(q)
    others = np.delete(mass_weighted_rows(J, robot.mass_matrix(q))[:, :3], turning[0], axis=1)
    if np.abs(others).max() > 1e-9 * six_sizes(robot, new)[0]:
        raise ConstraintError(
            f"{new.name}: {TWIST[turning[0]]} is the only row of turning, and {new.frame_b!r} also turns about other axes, "
            "so it is the rate of no angle. Hold two rows of turning (a hinge) or three, or this rate alone with constrain."
        )


def refuse_redundant(closed: ConstrainedRobot) -> None:
    """Raise ConstraintError that names the dependent rows and an independent choice."""
    new = closed.constraints[-1]
    first = len(closed.sizes) - len(new.rows)
    keep = " ".join(TWIST[new.rows[k - first]] for k in closed.independent if k >= first)
    advice = f"Independent ones are rows={keep!r}: close with these" if keep else "It adds nothing: leave it out"
    raise ConstraintError(
        f"of the {len(new.rows)} rows of {new.name!r} {len(keep.split())} are independent constraints; the others never move, "
        f"or follow from rows before them: {', '.join(closed.redundant_rows)}. {advice}, or with redundant='accept', which "
        "takes the λ of least norm."
    )
