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
    if pose is None:
        T_ac = np.eye(4)
    else:
        T_ac = arguments.pose(arguments.one(pose, "pose", 4, 4), "pose")
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
"""Largest gap of a configuration that counts as closed, rad, and fraction of the robot's length.

Rows of A differ from those of a closed configuration far less than their tolerances.
"""
_DISPLACEMENT_SIZES = [0.0, 0.01, 0.1, 0.3]
"""Standard deviations of random displacements around a configuration, rad and m."""


def some_configurations(closed: ConstrainedRobot, near: ArrayLike | None) -> Array:
    """Configurations with closed loops, found from stored and random ones or from around ``near``; (n, nq)."""
    rng = np.random.default_rng(0)
    robot = closed.open()
    if near is None:
        around_stored = [robot.add(q, _displacements(rng, robot, 4)) for q in robot.model.configurations.values()]
        random = robot.random_configuration(rng, STARTS - 1)
        starts = np.concatenate([*around_stored, random, robot.neutral[None]])
    else:
        q = arguments.one(near, "near", robot.nq, names=robot.coordinate_names)
        starts = robot.add(q, _displacements(rng, robot, STARTS))
    q, gaps = closed.settled(starts, 0.01 * MAX_FOUND_GAP)
    is_closed = gaps <= MAX_FOUND_GAP
    if not is_closed.any():
        raise ConstraintError(
            f"no configuration found at which {closed.constraints[-1].name!r} closes: from {len(starts)} starts the nearest "
            f"leaves a gap of {printed(gaps.min(), 3)} ({gap_unit_text(closed)}). Check pose and rows, or give near=q, one "
            "near it."
        )
    return np.asarray(q[is_closed])


def _displacements(rng: np.random.Generator, robot: Robot, count: int) -> Array:
    """Random displacements (count, nv) of different size; the first are zero. ``count``: a multiple of four."""
    sizes = np.repeat(_DISPLACEMENT_SIZES, count // len(_DISPLACEMENT_SIZES))
    return sizes[:, None] * rng.standard_normal((count, robot.nv))


def require_angle(closed: ConstrainedRobot, q: Array) -> None:
    """Raise ConstraintError if the last closure holds one angular row alone while the frame turns about other axes too.

    The rate of this row is then not the rate of an angle.
    """
    robot = closed.open()
    new = closed.constraints[-1]
    angular_rows = [row for row in new.rows if row < 3]
    if not isinstance(new, Closure) or len(angular_rows) != 1:
        return
    J = robot.kernel("constraint_jacobian", constraints=(all_rows(new),))(q)
    weighted_angular_rows = mass_weighted_rows(J, robot.mass_matrix(q))[:, :3]
    other_rows = np.delete(weighted_angular_rows, angular_rows[0], axis=1)
    angular_size = six_sizes(robot, new)[0]
    if np.abs(other_rows).max() > 1e-9 * angular_size:
        raise ConstraintError(
            f"{new.name}: {TWIST[angular_rows[0]]} is the only row of turning, and {new.frame_b!r} also turns about other "
            "axes, so it is the rate of no angle. Hold two rows of turning (a hinge) or three, or this rate alone with "
            "constrain."
        )


def refuse_redundant(closed: ConstrainedRobot) -> None:
    """Raise ConstraintError that names the dependent rows and an independent choice."""
    new = closed.constraints[-1]
    first = len(closed.sizes) - len(new.rows)
    independent_rows = [TWIST[new.rows[k - first]] for k in closed.independent if k >= first]
    advice = "It adds nothing: leave it out"
    if independent_rows:
        advice = f"Independent ones are rows={' '.join(independent_rows)!r}: close with these"
    raise ConstraintError(
        f"of the {len(new.rows)} rows of {new.name!r} {len(independent_rows)} are independent constraints; the others never "
        f"move, or follow from rows before them: {', '.join(closed.redundant_rows)}. {advice}, or with redundant='accept', "
        "which takes the λ of least norm."
    )
