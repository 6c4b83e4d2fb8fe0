"""The command ``twistwrench move``: options, path, timing and report of a motion."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any

import click
import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ..algorithms.time_scalings import cubic, quintic, screw_path, straight_path, trapezoid
from ..core.files import check_outputs
from ..core.numbers import number, percent, percent_of_limit, printed, seconds, torque
from ..core.text import listed
from ..core.verdict import ExitCode, Word
from ..errors import ConstraintWarning, PathError, ValueRangeError
from ..joints.units import heading_unit
from ..model.limits import Limits, over_limit
from ..motion.bounds import Bounds, Violation, bounds_of
from ..motion.coordinates import Coordinates
from ..motion.csv_reader import CsvFile, table_errors
from ..reports.load_case import LoadCase, limit_doubts, parse_payload
from ..reports.robot_summary import degrees_hint, parse_configuration, parse_numbers, read_limits
from ..reports.torque_verdict import assumed_words, assumptions, model_warnings
from ..robot import Robot
from ..trajectories.fastest import Fastest, fastest
from ..trajectories.paths import JointPath, follow_poses, joint_line, spline
from ..trajectories.trajectory import Trajectory, fitted
from ..typing import Array
from .console import picture, show, show_written
from .motion_options import LIMITS, NO_FRICTION, PAYLOADS
from .plain_table import PlainTable, friction_words, remarks, share_bar, verdict_word
from .robot_options import RobotOptions, robot_command
from .usage import Given, option_group

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


@robot_command(
    "move",
    move_options,
    examples=(
        "move ur5 --to 0.9,-0.9,1.0,-0.4,1.2,1.0 --fastest",
        "move ur5 --from=-0.5,-1.9,1.9,-0.3,1.5,0 --by 0.1,0,-0.1 --csv move.csv",
    ),
)
def move_command(options: RobotOptions, given: Given) -> ExitCode:
    """A motion from one place to another: straight in the joints or at the tip, through waypoints, or as fast as can be.

    Exit code 1 if the robot cannot follow the path, or the motion passes a limit or lacks a contact, or a link its mass.
    """
    given.plot_path = picture(given.plot_path)
    check_outputs(
        {"--csv": given.csv_path, "--plot": given.plot_path},
        {"--limits": given.limits_path, "--waypoints": given.waypoints, **options.files},
    )
    bare = options.load()
    carried = [parse_payload(text, options.tip) for text in given.payloads]
    robot = LoadCase(bare, tuple(carried)).with_load
    limits: Limits = robot.limits
    bounds = bounds_of(robot, acceleration=given.acceleration)
    if given.limits_path is not None:
        limits = read_limits(given.limits_path, robot.model, degrees=options.degrees)
        bounds = replace(bounds, **{kind: getattr(limits, kind) for kind in ("lower", "upper", "velocity", "effort")})
    if given.fastest and given.duration is not None:
        raise ValueRangeError("--fastest finds the duration, and --duration says it. Leave one of them out.")
    if not given.step > 0:
        raise ValueRangeError(f"--step {printed(given.step)}: give seconds above zero.")
    begin = parse_configuration(robot, given.begin, degrees=options.degrees, option="--from")
    end = parse_configuration(robot, given.to, degrees=options.degrees, option="--to", start=begin)
    for what, q in (("--from", begin), ("--to", end)):
        if (given.begin if what == "--from" else given.to) and (hint := degrees_hint(robot, q)):
            show(f"! {what}: {hint}")
    path, trouble = _path_and_trouble(robot, begin, end, degrees=options.degrees, given=given)
    if path is None:
        show(f"CANNOT: {trouble}")
        return ExitCode.NO
    friction = not given.no_friction and robot.model.friction.any
    try:
        moving = _timed(robot, path, bounds, given, friction=friction, whole=trouble is None)
    except PathError as problem:
        show(f"CANNOT: {problem}")
        return ExitCode.NO
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
            friction=not given.no_friction,
            degrees=options.degrees,
            carried=words,
            cannot=cannot,
            assumed=assumed_words(assumptions(robot.model, carried, friction=not given.no_friction)),
        )
    )
    if given.csv_path is not None:
        moving.to_csv(given.csv_path, given.step, degrees=options.degrees)
    if given.plot_path is not None:
        moving.plot(given.plot_path, bounds, friction=friction)
    show_written(given.csv_path, given.plot_path)
    return ExitCode.FINE if not over and not doubts and trouble is None else ExitCode.NO


def _timed(robot: Robot, path: JointPath, bounds: Any, given: Given, *, friction: bool, whole: bool) -> Trajectory:
    """Motion along the path: the fastest if requested and the path is ``whole``, otherwise by its scaling."""
    if not (given.fastest and whole):
        return Trajectory(robot, path, _scaling(robot, path, bounds, given, friction=friction))
    limits = {"velocity": bounds.velocity, "effort": bounds.effort, "acceleration": bounds.acceleration}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConstraintWarning)  # positions are in the verdict, by the limits given
        return fastest(robot, path, friction=friction, **limits)


def _scaling(robot: Robot, path: JointPath, bounds: Any, given: Given, *, friction: bool) -> Any:

    shapes: dict[str, Any] = {
        "quintic": quintic,
        "cubic": cubic,
        "trapezoid": lambda T: trapezoid(v=1.5 / T, duration=T),
    }
    shape = shapes[given.scaling](1.0)
    if given.duration is not None:
        return shape.stretched(given.duration)
    return fitted(robot, path, shape, bounds, friction=friction)


def _path_and_trouble(
    robot: Robot, q0: Array, q1: Array, *, degrees: bool, given: Given
) -> tuple[JointPath | None, PathError | None]:
    """Requested path from q0 (nq,) to q1 (nq,) or ``--by``; if it ends early, its feasible part and the error."""
    tip_moves = [name for name in ("straight", "screw", "by") if getattr(given, name)]
    if len(tip_moves) > 1:
        raise ValueRangeError(f"--{tip_moves[0]} and --{tip_moves[1]} ask for two paths. Keep one of them.")
    if given.to and given.by is not None:
        raise ValueRangeError("--to and --by both say where it ends. Keep one of them.")
    if not given.to and given.by is None:
        raise ValueRangeError("where does it end? Give --to v,v,… or --to JOINT=VALUE, or --by x,y,z for the tip.")
    if tip_moves and given.waypoints is not None:
        raise ValueRangeError(f"--waypoints are for the joints, and --{tip_moves[0]} moves the tip. Keep one of them.")
    if given.by is not None:
        step = parse_numbers(given.by, "--by", "x,y,z in metres, for example 0,0,0.1", 3)
        T = robot.forward_kinematics(q0)
        end = T.copy()
        end[:3, 3] += step
        poses = straight_path(T, end)
    else:
        if not tip_moves:
            if given.waypoints is None:
                return joint_line(robot, q0, q1), None
            between = _waypoints(robot, given.waypoints, degrees=degrees)
            return spline(robot, np.concatenate([[q0], between, [q1]])), None
        make = straight_path if given.straight else screw_path
        poses = make(robot.forward_kinematics(q0), robot.forward_kinematics(q1))
    try:
        return follow_poses(robot, poses, q0), None
    except PathError as problem:
        return problem.partial, problem  # type: ignore[return-value]


def _in_radians(robot: Robot, q: Array, *, degrees: bool) -> Array:

    return q * np.where(Coordinates.from_model(robot.model).angular & degrees, math.radians(1.0), 1.0)


def _waypoints(robot: Robot, file: str, *, degrees: bool) -> Array:

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


# ── The report


_SAMPLES = 2001
_LISTED = 12
_MOST_PASSED = 6
"""Limits passed that are listed."""


@dataclass(frozen=True)
class JointUse:
    """Peaks of a joint in a motion, as values and as shares of its limits (nan without a limit)."""

    joint: str
    way: float
    velocity: float
    velocity_share: float
    peak: float
    """The largest torque, with its sign."""
    torque_share: float
    unit: str
    """Unit of the torque."""
    limiting: float
    """The part of the time during which it is at a limit, in a fastest motion."""
    uncertainty: float = 0.0
    """Standard deviation of the torque; zero for a planned motion."""


def joint_uses(trajectory: Trajectory, bounds: Bounds, *, friction: bool) -> list[JointUse]:
    """Peaks for each entry of dq."""
    robot = trajectory.robot
    q, dq, ddq = trajectory(np.linspace(0.0, trajectory.duration, _SAMPLES))
    tau = robot.inverse_dynamics(q, dq, ddq, friction=friction)
    way, units = robot.subtract(q[-1], q[0]), Coordinates.from_model(robot.model).torque_units
    at_limit = dict.fromkeys(robot.model.velocity_names, 0.0)
    if isinstance(trajectory, Fastest):
        for touch in trajectory.limit_contacts:
            at_limit[touch.joint] += (touch.end - touch.begin) / trajectory.duration
    found = []
    for k, name in enumerate(robot.model.velocity_names):
        v, t = (x[int(np.abs(x).argmax())] for x in (dq[:, k], tau[:, k]))
        shares = [
            abs(x) / m if math.isfinite(m) else math.nan for x, m in ((v, bounds.velocity[k]), (t, bounds.effort[k]))
        ]
        use = (name, float(way[k]), float(v), shares[0], float(t), shares[1], units[k], at_limit[name])
        found.append(JointUse(*use))
    return found


def move_view(
    trajectory: Trajectory,
    bounds: Bounds,
    violations: tuple[Violation, ...],
    uses: list[JointUse],
    doubts: list[str],
    *,
    friction: bool,
    degrees: bool,
    carried: str = "",
    cannot: str = "",
    assumed: str = "",
) -> RenderableType:
    """Verdict, heading, a row per joint, and the active limits of the fastest motion over time.

    ``uses`` come from :func:`joint_uses`; ``doubts`` make torques unsure, ``assumed`` lists assumptions of an OK, and
    ``cannot`` is the reason for an early end.
    """
    robot = trajectory.robot
    names = Coordinates.from_model(robot.model)
    unit = np.where(names.angular_velocity & degrees, math.degrees(1.0), 1.0)
    way, speed, force = (heading_unit(part, names.angular_velocity, degrees=degrees) for part in ("q", "dq", "tau"))
    table = PlainTable()
    table.words("joint", fold=False)
    fast = isinstance(trajectory, Fastest)
    table.numbers(f"way [{way}]", f"peak [{speed}]", "share", f"peak [{force}]", "share", *(["at limit"] * fast))
    table.words("", fold=False)
    for k, use in enumerate(uses):
        most = max((x for x in (use.velocity_share, use.torque_share) if not math.isnan(x)), default=0.0)
        table.row(
            use.joint,
            number(use.way * unit[k], decimals=3),
            number(use.velocity * unit[k], decimals=3),
            percent_of_limit(use.velocity_share),
            torque(use.peak),
            percent_of_limit(use.torque_share),
            *([percent(use.limiting)] * fast),
            share_bar(most),
            style="bold red" if over_limit(most) else "",
        )
    s = trajectory.path.name
    first = Text.assemble(
        (robot.name, "bold"),
        f"  ·  {s}, {trajectory.scaling.name} timing: {number(trajectory.duration, 6)} s",
        f"  ·  carrying {carried}" if carried else "",
        f"  ·  {friction_words(robot.model, counted=friction)}",
    )
    parts: list[RenderableType] = [first, table]
    if isinstance(trajectory, Fastest):
        parts.extend(_timeline(trajectory))
    return Group(*_verdict(trajectory, bounds, violations, doubts, cannot, assumed), Text(), *parts)


def _timeline(trajectory: Fastest) -> list[RenderableType]:
    table = PlainTable("What limits it when")
    table.numbers("from [s]", "to [s]")
    table.words("joint", "limit", "", fold=False)
    T, touches = trajectory.duration, trajectory.limit_contacts
    shown = sorted(sorted(touches, key=lambda t: t.begin - t.end)[:_LISTED], key=lambda t: t.begin)
    for t in shown:
        a, b = round(24 * t.begin / T), max(round(24 * t.end / T), round(24 * t.begin / T) + 1)
        bar = Text("·" * min(a, 23) + "█" * (min(b, 24) - min(a, 23)) + "·" * (24 - min(b, 24)), style="cyan")
        table.row(seconds(t.begin, 4), seconds(t.end, 4), t.joint, f"{'+' if t.side > 0 else '-'} {t.kind}", bar)
    rest = len(touches) - len(shown)
    return [table, *([Text(f"and {rest} shorter parts", style="dim")] if rest else [])]


def _verdict(
    trajectory: Trajectory,
    bounds: Bounds,
    violations: tuple[Violation, ...],
    doubts: list[str],
    cannot: str,
    assumed: str,
) -> list[Text]:
    first = [Text.assemble(("CANNOT", "bold red"), f": {cannot}")] if cannot else []
    if violations:
        over = [Text.assemble(verdict_word(Word.OVER_LIMIT), f": {v}.") for v in violations[:_MOST_PASSED]]
        return [
            *first,
            *over,
            *([Text(f"and {len(violations) - _MOST_PASSED} more")] if len(violations) > _MOST_PASSED else []),
        ]
    unknown = _unknown_velocities(trajectory, bounds)
    unlimited = unknown or np.isinf(bounds.effort).any()
    within = f"{'until there, ' if cannot else ''}within {'the limits that are known' if unlimited else 'all limits'}"
    if isinstance(trajectory, Fastest):
        within += ", and at one of them at all times: it cannot be done faster on this path"
    word = Word.UNSURE if doubts else Word.OK
    within = "; ".join([*doubts, f"otherwise {within}"] if doubts else [within + assumed])
    said = Text(f"{within[0].upper()}{within[1:]}.") if cannot else Text.assemble(verdict_word(word), f": {within}.")
    return [*first, said, *remarks(unknown)]


def _unknown_velocities(trajectory: Trajectory, bounds: Bounds) -> list[str]:
    """A sentence on the joints without a limit of velocity."""
    names = np.array(trajectory.robot.model.velocity_names)
    missing = names[~np.isfinite(bounds.velocity)]
    if not len(missing):
        return []
    of = "any joint" if len(missing) == len(names) else listed(missing, 6)
    return [f"No velocity limit of {of} is known, so none was asked for: --limits FILE.csv gives them (velocity)."]
