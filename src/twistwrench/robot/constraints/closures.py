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
    """Closure with the arguments of :meth:`twistwrench.Robot.close`, checked."""
    refuse_couplings(model, "close")
    frame_a, frame_b = _frame_name(model, frame_a), _frame_name(model, frame_b)
    if place_of(model, frame_a).body == place_of(model, frame_b).body:
        raise ConstraintError(
            f"{frame_a!r} and {frame_b!r} are fixed to one body, so nothing between them can be closed."
        )
    T_ac = np.eye(4)  # pose that frame_b takes, in frame_a
    if pose is not None:
        matrix = arguments.one(pose, "pose", 4, 4)
        T_ac = arguments.pose(matrix, "pose")
    hashable_pose = tuple(tuple(matrix_row) for matrix_row in T_ac.tolist())
    return Closure(frame_a, frame_b, row_numbers(rows), hashable_pose)


def rolling(model: Model, frame: str, rows: Rows, kind: str) -> Rolling:
    """Constraint with the arguments of :meth:`twistwrench.Robot.constrain`, checked."""
    if kind not in KINDS:
        raise UnknownNameError.from_choices("kind", kind, KINDS)
    refuse_couplings(model, "constrain")
    frame = _frame_name(model, frame)
    if model.frame(frame).body == BASE:
        raise ConstraintError(f"{frame!r} is fixed to the base, so nothing about it can be constrained.")
    return Rolling(frame, row_numbers(rows), kind)


def _frame_name(model: Model, frame: str | None) -> str:
    """Name of the frame; for None the name of the tip, or an error of :meth:`Model.frame` if the robot has no tip."""
    if frame is None:
        model.frame(None)  # only for its error
        return str(model.tip)
    return frame


# ── Configurations with closed loops, and rows that are independent there

STARTS = 32
"""Number of random start configurations in the search for configurations with closed loops, beside those near known ones."""
MAX_FOUND_GAP = 1e-10
"""Largest gap of a configuration that counts as closed: an angle [rad], or a distance as a fraction of the robot's length.

The constraint matrix A then equals the matrix of an exactly closed configuration, far within tolerances.
"""
_TARGET_GAP = 0.01 * MAX_FOUND_GAP
"""Gap at which the solver stops, with room to :data:`MAX_FOUND_GAP`."""
_DISPLACEMENT_SIZES = [0.0, 0.01, 0.1, 0.3]
"""Standard deviations of random displacements around a configuration, rad and m."""
_MAX_COUPLING = 1e-9
"""Share of the size of angular rows up to which an entry of an angular row counts as zero: no turn about that axis."""


def some_configurations(closed: ConstrainedRobot, near: ArrayLike | None) -> Array:
    """Configurations (n, nq) with closed loops.

    The search starts around ``near``. For None, it starts around the robot's stored configurations and at random ones.
    """
    rng = np.random.default_rng(0)  # equal searches in all runs
    robot = closed.open()
    if near is None:
        starts_per_stored = len(_DISPLACEMENT_SIZES)
        stored = robot.model.configurations.values()
        starts_around_stored = [robot.add(q, _displacements(rng, robot, starts_per_stored)) for q in stored]
        random_starts = robot.random_configuration(rng, STARTS - 1)  # the neutral one makes STARTS
        starts = np.concatenate([*starts_around_stored, random_starts, robot.neutral[None]])
    else:
        q_near = arguments.one(near, "near", robot.nq, names=robot.coordinate_names)
        starts = robot.add(q_near, _displacements(rng, robot, STARTS))
    solutions, gaps = closed.settled(starts, _TARGET_GAP)
    is_closed = gaps <= MAX_FOUND_GAP
    if not is_closed.any():
        name = closed.constraints[-1].name
        gap_text = f"{printed(gaps.min(), 3)} ({gap_unit_text(closed)})"
        raise ConstraintError(
            f"no configuration found at which {name!r} closes: from {len(starts)} starts the nearest "
            f"leaves a gap of {gap_text}. Check pose and rows, or give near=q, one near it."
        )
    return np.asarray(solutions[is_closed])


def _displacements(rng: np.random.Generator, robot: Robot, count: int) -> Array:
    """Random displacements (count, nv): first ``count / 4`` of the first of four :data:`_DISPLACEMENT_SIZES`, and so on.

    ``count`` is a multiple of 4.
    """
    sizes = np.repeat(_DISPLACEMENT_SIZES, count // len(_DISPLACEMENT_SIZES))
    return sizes[:, None] * rng.standard_normal((count, robot.nv))


def require_angle(closed: ConstrainedRobot, q: Array) -> None:
    """Raise ConstraintError if the last closure has a single angular row while its frame also turns about other axes.

    The rate of this row is then not the rate of an angle. ``q`` are configurations (n, nq) with closed loops.
    """
    robot = closed.open()
    last_closure = closed.constraints[-1]
    angular_rows = [row for row in last_closure.rows if row < 3]  # before the linear rows 3, 4, 5
    if not isinstance(last_closure, Closure) or len(angular_rows) != 1:
        return
    row = angular_rows[0]
    constraint_jacobian = robot.kernel("constraint_jacobian", constraints=(all_rows(last_closure),))
    J = constraint_jacobian(q)  # (n, 6, nv)
    weighted_rows = mass_weighted_rows(J, robot.mass_matrix(q))
    weighted_angular_rows = weighted_rows[:, :3]  # (n, 3, nv)
    other_rows = np.delete(weighted_angular_rows, row, axis=1)
    row_sizes = six_sizes(robot, last_closure)
    angular_size = row_sizes[0]  # equal for all angular rows
    if np.abs(other_rows).max() > _MAX_COUPLING * angular_size:
        raise ConstraintError(
            f"{last_closure.name}: {TWIST[row]} is the only row of turning, and {last_closure.frame_b!r} also turns about "
            "other axes, so it is the rate of no angle. Hold two rows of turning (a hinge) or three, or this rate alone with "
            "constrain."
        )


def refuse_redundant(closed: ConstrainedRobot) -> None:
    """Raise ConstraintError that names the dependent rows of the last constraint, and the independent rows to keep."""
    last = closed.constraints[-1]
    first_index = len(closed.sizes) - len(last.rows)  # of its rows among the rows of all constraints
    independent_names = []
    for k in closed.independent:
        if k >= first_index:
            row = last.rows[k - first_index]
            independent_names.append(TWIST[row])
    advice = "It adds nothing: leave it out"
    if independent_names:
        advice = f"Independent ones are rows={' '.join(independent_names)!r}: close with these"
    redundant_rows = ", ".join(closed.redundant_rows)
    raise ConstraintError(
        f"of the {len(last.rows)} rows of {last.name!r} {len(independent_names)} are independent constraints; the others never "
        f"move, or follow from rows before them: {redundant_rows}. {advice}, or with redundant='accept', which takes the λ "
        "of least norm."
    )
