"""The command ``twistwrench move``: its options, and its answer as things to print."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ..core.numbers import number, printed
from ..errors import ConstraintWarning, PathError, ValueRangeError
from ..typing import Array
from .motion_options import LIMITS, NO_FRICTION, PAYLOADS, option_group

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..model.limits import Limits
    from ..robot import Robot
    from ..trajectories.paths import JointPath
    from ..trajectories.trajectory import Trajectory


move_options = option_group(
    click.option(
        "--plot", "plot_path", metavar="OUT.png", help="Draw the motion; with --fastest, the phase plane too."
    ),
    click.option("--csv", "csv_path", metavar="OUT.csv", help="Write the motion, as 'twistwrench torques' reads it."),
    click.option(
        "--step", type=float, default=0.002, show_default=True, metavar="SECONDS", help="Between rows of --csv."
    ),
    NO_FRICTION,
    LIMITS,
    click.option("--acceleration", type=float, metavar="A", help="Limit every joint to it [rad/s², m/s²]."),
    PAYLOADS,
    click.option(
        "--duration", type=float, metavar="SECONDS", help="How long it takes; as short as may be if not given."
    ),
    click.option(
        "--scaling",
        type=click.Choice(["quintic", "cubic", "trapezoid"]),
        default="quintic",
        show_default=True,
        help="How the time goes along the path.",
    ),
    click.option("--fastest", is_flag=True, help="The fastest timing: one limit touched at all times."),
    click.option("--straight", is_flag=True, help="Move the tip on a straight line between the poses of both ends."),
    click.option("--screw", is_flag=True, help="Move the tip on the constant screw between them."),
    click.option("--by", metavar="x,y,z", help="Move the tip straight by that [m], along the base's axes."),
    click.option("--waypoints", metavar="FILE.csv", help="Configurations on the way, a row each, joints as columns."),
    click.option(
        "--to",
        metavar="v,v,…|JOINT=VALUE",
        multiple=True,
        help="Where it ends: all coordinates, a configuration of the file by its name, or a joint's place, others as at "
        "the beginning; may be repeated.",
    ),
    click.option(
        "--from",
        "begin",
        metavar="v,v,…|JOINT=VALUE",
        multiple=True,
        help="Where it begins, likewise; the neutral configuration if not given.",
    ),
)
"""The options of the command, all but the robot's own."""


def run_move(
    robot: Robot, show: Callable[[RenderableType], None], *, degrees: bool, tip: str | None, **given: Any
) -> bool:
    """Print the answer with ``show`` and write the files; whether the motion exists and stays within all limits for certain.

    Raises errors of the library.
    """
    from dataclasses import replace

    from ..motion.bounds import bounds_of
    from ..reports.load_case import LoadCase, limit_doubts, parse_payload
    from ..reports.robot_summary import degrees_hint, parse_configuration
    from ..reports.torque_verdict import assumed_words, assumptions, model_warnings
    from .tables.motion import joint_uses, move_view

    carried = [parse_payload(text, tip) for text in given["payloads"]]
    bare, robot = robot, LoadCase(robot, tuple(carried)).with_load
    limits: Limits = robot.limits
    bounds = bounds_of(robot, acceleration=given["acceleration"])
    if given["limits_path"] is not None:
        from ..reports.robot_summary import read_limits

        limits = read_limits(given["limits_path"], robot.model, degrees=degrees)
        bounds = replace(bounds, **{kind: getattr(limits, kind) for kind in ("lower", "upper", "velocity", "effort")})
    if given["fastest"] and given["duration"] is not None:
        raise ValueRangeError("--fastest finds the duration, and --duration says it. Leave one of them out.")
    if not given["step"] > 0:
        raise ValueRangeError(f"--step {printed(given['step'])}: give seconds above zero.")
    begin = parse_configuration(robot, given["begin"], degrees=degrees, option="--from")
    end = parse_configuration(robot, given["to"], degrees=degrees, option="--to", start=begin)
    for what, q in (("--from", begin), ("--to", end)):
        if given["begin" if what == "--from" else "to"] and (hint := degrees_hint(robot, q)):
            show(f"! {what}: {hint}")
    path, trouble = _path_and_trouble(robot, begin, end, degrees=degrees, **given)
    if path is None:
        show(f"CANNOT: {trouble}")
        return False
    friction = not given["no_friction"] and robot.model.friction.any
    try:
        moving = _timed(robot, path, bounds, given, friction=friction, whole=trouble is None)
    except PathError as problem:
        show(f"CANNOT: {problem}")
        return False
    over = moving.violations(bounds, friction=friction)
    words = " and ".join(f"{number(p.mass)} kg" for p in carried)
    cannot = "" if trouble is None else f"{trouble} The motion below, and in the files, is the path until there."
    uses = joint_uses(moving, bounds, friction=friction)
    doubts = limit_doubts(bare, limits, [use.peak for use in uses]) + model_warnings(robot.model, uses)
    show(
        move_view(
            moving,
            bounds,
            over,
            uses,
            doubts,
            friction=not given["no_friction"],
            degrees=degrees,
            carried=words,
            cannot=cannot,
            assumed=assumed_words(assumptions(robot.model, carried, friction=not given["no_friction"])),
        )
    )
    if given["csv_path"] is not None:
        moving.to_csv(given["csv_path"], given["step"], degrees=degrees)
    if given["plot_path"] is not None:
        moving.plot(given["plot_path"], bounds, friction=friction)
    for written in filter(None, (given["csv_path"], given["plot_path"])):
        show(f"wrote {written}")
    return not over and not doubts and trouble is None


def _timed(
    robot: Robot, path: JointPath, bounds: Any, given: dict[str, Any], *, friction: bool, whole: bool
) -> Trajectory:
    """The motion along the path: as fast as may be, where that is asked and the path is ``whole``, else by its scaling."""
    from ..trajectories.fastest import fastest
    from ..trajectories.trajectory import Trajectory

    if not (given["fastest"] and whole):
        return Trajectory(robot, path, _scaling(robot, path, bounds, given, friction=friction))
    limits = {"velocity": bounds.velocity, "effort": bounds.effort, "acceleration": bounds.acceleration}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConstraintWarning)  # positions are in the verdict, by the limits given
        return fastest(robot, path, friction=friction, **limits)


def _scaling(robot: Robot, path: JointPath, bounds: Any, given: dict[str, Any], *, friction: bool) -> Any:
    from ..algorithms.time_scalings import cubic, quintic, trapezoid
    from ..trajectories.trajectory import fitted

    shapes: dict[str, Any] = {
        "quintic": quintic,
        "cubic": cubic,
        "trapezoid": lambda T: trapezoid(v=1.5 / T, duration=T),
    }
    shape = shapes[given["scaling"]](1.0)
    if given["duration"] is not None:
        return shape.stretched(given["duration"])
    return fitted(robot, path, shape, bounds, friction=friction)


def _path_and_trouble(
    robot: Robot, q0: Array, q1: Array, *, degrees: bool, **given: Any
) -> tuple[JointPath | None, PathError | None]:
    """The path asked for, from q0 (nq,) to q1 (nq,) or ``by``; where it ends early, what there is of it and why."""
    from ..algorithms.time_scalings import screw_path, straight_path
    from ..reports.robot_summary import parse_numbers
    from ..trajectories.paths import follow_poses, joint_line, spline

    tip_moves = [name for name in ("straight", "screw", "by") if given[name]]
    if len(tip_moves) > 1:
        raise ValueRangeError(f"--{tip_moves[0]} and --{tip_moves[1]} ask for two paths. Keep one of them.")
    if given["to"] and given["by"] is not None:
        raise ValueRangeError("--to and --by both say where it ends. Keep one of them.")
    if not given["to"] and given["by"] is None:
        raise ValueRangeError("where does it end? Give --to v,v,… or --to JOINT=VALUE, or --by x,y,z for the tip.")
    if tip_moves and given["waypoints"] is not None:
        raise ValueRangeError(f"--waypoints are for the joints, and --{tip_moves[0]} moves the tip. Keep one of them.")
    if given["by"] is not None:
        step = parse_numbers(given["by"], "--by", "x,y,z in metres, for example 0,0,0.1", 3)
        T = robot.forward_kinematics(q0)
        end = T.copy()
        end[:3, 3] += step
        poses = straight_path(T, end)
    else:
        if not tip_moves:
            if given["waypoints"] is None:
                return joint_line(robot, q0, q1), None
            between = _waypoints(robot, given["waypoints"], degrees=degrees)
            return spline(robot, np.concatenate([[q0], between, [q1]])), None
        make = straight_path if given["straight"] else screw_path
        poses = make(robot.forward_kinematics(q0), robot.forward_kinematics(q1))
    try:
        return follow_poses(robot, poses, q0), None
    except PathError as problem:
        return problem.partial, problem  # type: ignore[return-value]


def _in_radians(robot: Robot, q: Array, *, degrees: bool) -> Array:
    from ..motion.coordinates import Coordinates

    return q * np.where(Coordinates.of(robot.model).angular & degrees, math.radians(1.0), 1.0)


def _waypoints(robot: Robot, file: str, *, degrees: bool) -> Array:
    from ..motion.csv_reader import CsvFile, table_errors

    names = robot.coordinate_names
    form = f"the columns {', '.join(names[:12])}, each once, and at least one row"
    with table_errors(file, "waypoint file", form):
        table = CsvFile.open(file)
        if sorted(table.header) != sorted(names):
            raise ValueRangeError(f"{file}: line {table.header_line}: give {form}.")
        used = [table.header.index(name) for name in names]
        found = table.table(used)
    if not len(found):
        raise ValueRangeError(f"{file}: no row after the header: give {form}.")
    return _in_radians(robot, found, degrees=degrees)
