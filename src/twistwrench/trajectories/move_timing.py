"""Path and timing of a move: waypoints, the path, and the fastest or the given time along it."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ConstraintWarning, PathError, ValueRangeError
from ..core.numbers import over_limit
from ..core.text import argument
from ..core.typing import Array
from ..core.verdict import Word
from ..mechanics.algorithms.time_scalings import cubic, quintic, s_curve, screw_path, straight_path, trapezoid
from ..mechanics.model.couplings import motor_torques
from ..mechanics.model.limits import Limits
from ..motion.bounds import Violation
from ..motion.coordinates import ConfigurationGiven, Coordinates
from ..motion.model_doubts import base_doubts, hanging_excess
from ..motion.readers.csv_reader import CsvFile, table_errors
from ..robot import Robot
from .fastest import fastest as fastest_timing
from .paths import JointPath, follow_poses, joint_line, spline
from .trajectory import Trajectory, fitted

Paths: TypeAlias = Literal["joint", "line", "screw"]
"""Straight line of the joints, straight line of the tip, or screw motion of the tip."""
Scalings: TypeAlias = Literal["quintic", "cubic", "trapezoid", "s-curve"]
"""Time scalings along the path."""
SAMPLES = 2001
"""Number of times at which a motion is judged."""
_MAX_LISTED_NAMES = 12
"""Largest number of columns that a message names."""
_PEAK_SPEED_OF_TRAPEZOID = 1.5
"""Largest speed of a trapezoidal scaling of one second [1/s]."""


def check_path(to: ConfigurationGiven, by: ArrayLike | None, waypoints: Any, path: str, scaling: str) -> None:
    """Raise ValueRangeError if the end of the motion is missing, a name is unknown, or two arguments contradict each other."""
    if path not in get_args(Paths):
        raise ValueRangeError(f"path is {path!r}. Give 'joint', 'line' or 'screw'.")
    if scaling not in get_args(Scalings):
        choices = ", ".join(map(repr, get_args(Scalings)))
        raise ValueRangeError(f"scaling is {scaling!r}. Give one of {choices}.")
    if to is not None and by is not None:
        raise ValueRangeError(
            f"{argument('to')} and {argument('by')} both set the end of the motion. Keep one of them."
        )
    if to is None and by is None:
        raise ValueRangeError(
            f"where does it end? Give {argument('to')} for the joints, or {argument('by')} for the tip."
        )
    if by is not None and path != "joint":
        raise ValueRangeError(f"{argument('by')} moves the tip on a straight line. Leave the path out.")
    is_path_of_tip = by is not None or path != "joint"
    if waypoints is not None and is_path_of_tip:
        raise ValueRangeError(
            f"{argument('waypoints')} are for the joints, and the path is one of the tip. Keep one of them."
        )


def path_and_trouble(
    robot: Robot, q0: Array, q1: Array, by: ArrayLike | None, between: Array | None, path: str
) -> tuple[JointPath | None, PathError | None]:
    """Requested path from q0 (nq,), and None.

    If the path ends early, the results are its feasible part, which may be None, and the error. The path ends at q1 (nq,), or
    where the tip has moved by a vector ``by`` (3,) [m]. ``between`` are waypoints (n, nq).
    """
    if between is not None:
        points = np.concatenate([[q0], between, [q1]])
        return spline(robot, points), None
    if by is None and path == "joint":
        return joint_line(robot, q0, q1), None
    start_pose = robot.forward_kinematics(q0)
    if by is not None:
        finite_by = arguments.finite(by, "by", 3)
        displacement = arguments.one(finite_by, "by", 3)
        end_pose = start_pose.copy()
        end_pose[:3, 3] += displacement
        poses = straight_path(start_pose, end_pose)
    elif path == "line":
        poses = straight_path(start_pose, robot.forward_kinematics(q1))
    else:
        poses = screw_path(start_pose, robot.forward_kinematics(q1))
    try:
        return follow_poses(robot, poses, q0), None
    except PathError as problem:
        return problem.partial, problem  # type: ignore[return-value]


def time_path(
    robot: Robot,
    path: JointPath,
    bounds: Limits,
    *,
    fast: bool,
    scaling: Scalings,
    duration: float | None,
    friction: bool,
) -> Trajectory:
    """Motion along the path: the fastest if ``fast``, otherwise with the time scaling.

    Without a duration, the time scaling is as short as the limits allow.
    """
    if fast:
        kinds = ("velocity", "effort", "acceleration", "deceleration", "jerk")
        limits = {kind: getattr(bounds, kind) for kind in kinds}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConstraintWarning)  # the verdict checks positions against the given limits
            return fastest_timing(robot, path, friction=friction, **limits)
    unit_scalings: dict[str, Any] = {  # of one second
        "quintic": quintic(1.0),
        "cubic": cubic(1.0),
        "s-curve": s_curve(1.0),
        "trapezoid": trapezoid(v=_PEAK_SPEED_OF_TRAPEZOID, duration=1.0),
    }
    unit_scaling = unit_scalings[scaling]
    if duration is not None:
        time_scaling = unit_scaling.stretched(duration)
    else:
        time_scaling = fitted(robot, path, unit_scaling, bounds, friction=friction)
    return Trajectory(robot, path, time_scaling, friction=friction)


def read_waypoints(robot: Robot, source: str | Path | ArrayLike, *, degrees: bool) -> Array:
    """Configurations (n, nq) of a file or an array, in rad and m; if ``degrees``, angles in the source are in degrees."""
    is_angle = Coordinates.from_model(robot.model).angular
    radians_per_degree = math.radians(1.0)
    units = np.where(is_angle & degrees, radians_per_degree, 1.0)  # of the source, in SI units
    if isinstance(source, str | Path):
        return _waypoints_of_file(robot, source) * units
    waypoints = arguments.finite(source, "waypoints", robot.nq, names=robot.coordinate_names)
    return np.atleast_2d(np.asarray(waypoints, float)) * units


def _waypoints_of_file(robot: Robot, file: str | Path) -> Array:
    """Configurations (n, nq) of a file, in its units."""
    names = robot.coordinate_names
    listed_names = ", ".join(names[:_MAX_LISTED_NAMES])
    form = f"the columns {listed_names}, each once, and at least one row"
    with table_errors(file, "waypoint file", form):
        table = CsvFile.open(file)
        if sorted(table.header) != sorted(names):
            raise ValueRangeError(f"{file}: line {table.header_line}: give {form}.")
        columns = [table.header.index(name) for name in names]
        rows = table.table(columns)
    if not len(rows):
        raise ValueRangeError(f"{file}: no row after the header: give {form}.")
    return rows


def can_stand(robot: Robot, path: JointPath, bounds: Limits) -> bool:
    """True if the torque limits suffice to stand still everywhere on the path."""
    q, _, _ = path(np.linspace(0.0, 1.0, SAMPLES))
    holding_torques = motor_torques(robot.model, robot.holding_torques(q))
    shares = np.abs(holding_torques) / bounds.effort
    return not bool(over_limit(shares).any())


def untimed_verdict(problem: PathError, robot: Robot, *, can_stand: bool) -> tuple[Word, PathError]:
    """Word of the verdict and reason for a path without a timing.

    If nothing holds the base of a legged robot, its torques are uncertain: the word is UNSURE instead of OVER LIMIT.
    """
    if can_stand:
        return Word.STOPPED, problem
    doubts = base_doubts(robot.model)
    if not doubts:
        return Word.OVER_LIMIT, problem
    reasons = [*doubts, hanging_excess(str(problem))]
    return Word.UNSURE, PathError("; ".join(reasons))


def certain_violations(violations: tuple[Violation, ...], robot: Robot) -> tuple[tuple[Violation, ...], list[str]]:
    """Violations that are certain, and doubts.

    If nothing holds the base of a legged robot, violations of torques are not certain: the first of them becomes a doubt.
    """
    doubts = base_doubts(robot.model)
    if not doubts:
        return violations, []
    certain = tuple(violation for violation in violations if violation.kind != "torque")
    of_torques = [violation for violation in violations if violation.kind == "torque"]
    if of_torques:
        doubts = [*doubts, hanging_excess(str(of_torques[0]))]
    return certain, doubts
