"""The command ``twistwrench move``: options, path, timing and report of a motion."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..answers.blocks import Bar, Block, Glyphs, Headline, Line, Table, mark_style, numbers, remarks, words
from ..answers.page import MarkedJoint
from ..core.arguments import parse_numbers
from ..core.colours import Style, strong
from ..core.errors import ConstraintWarning, PathError, ValueRangeError
from ..core.numbers import number, percent, percent_of_limit, printed, seconds, torque
from ..core.text import listed
from ..core.typing import Array
from ..core.verdict import ExitCode, Word
from ..mechanics.algorithms.time_scalings import cubic, quintic, s_curve, screw_path, straight_path, trapezoid
from ..mechanics.joints.units import heading_unit, units_of
from ..mechanics.model.couplings import coupled_entries, drive_turns, motor_torques, motor_velocities
from ..mechanics.model.limits import Limits, over_limit
from ..motion.bounds import Violation, bounds_of
from ..motion.coordinates import Coordinates, configuration_of, degrees_hint
from ..motion.credible_values import credible_limits
from ..motion.limits_file import read_limits
from ..motion.load_case import limit_doubts
from ..motion.model_doubts import (
    as_it_hangs,
    assumed_words,
    assumptions,
    base_doubts,
    friction_words,
    model_warnings,
)
from ..motion.readers.csv_reader import CsvFile, table_errors
from ..robot import Robot
from ..trajectories import Fastest, JointPath, Trajectory, fastest, fitted, follow_poses, joint_line, spline
from ..trajectories.trajectory import required_torques
from .main import Given, noted_if_failed, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import (
    CLEARANCE,
    JSON,
    LIMITS,
    NO_FRICTION,
    PAYLOADS,
    RobotOptions,
    clearance_along,
    clearance_verdict,
    csv_option,
    load_case,
    robot_command,
    show_written,
)
from .terminal import show


@robot_command(
    "move",
    option(
        "--from v,v,…|JOINT=VALUE",
        "Start configuration, in the form of --to. [default: neutral]",
        "begin",
        multiple=True,
    ),
    option(
        "--to v,v,…|JOINT=VALUE",
        "End configuration: all coordinates, a configuration of the file by its name, or the position of a joint, the "
        "others as at the start; may be repeated.",
        multiple=True,
    ),
    option("--waypoints FILE.csv", "Intermediate configurations, one per row, joints as columns."),
    option("--by x,y,z", "Move the tip in a straight line by this vector [m], in base axes."),
    option("--screw", "Move the tip along the constant screw between both poses."),
    option("--straight", "Move the tip along the straight line between both poses."),
    option("--fastest", "Use the fastest timing within all limits; with jerk limits, a short one."),
    option(
        "--scaling",
        "Time scaling along the path.",
        choices=("quintic", "cubic", "trapezoid", "s-curve"),
        default="quintic",
    ),
    option("--duration SECONDS", "Duration. [default: the shortest within all limits]", type=float),
    PAYLOADS,
    option("--acceleration A", "Acceleration limit of every joint [rad/s², m/s²].", type=float),
    option("--jerk J", "Jerk limit of every joint [rad/s³, m/s³].", type=float),
    LIMITS,
    CLEARANCE,
    NO_FRICTION,
    option("--step SECONDS", "Time between rows of --csv.", default=0.002),
    csv_option("Write the motion, which torques and view read"),
    JSON,
    option("--plot OUT.png", "Draw the motion; with --fastest also the phase plane."),
    REPORT,
    PAGE,
    examples=(
        "move ur5 --to 0.9,-0.9,1.0,-0.4,1.2,1.0 --fastest",
        "move ur5 --from=-0.5,-1.9,1.9,-0.3,1.5,0 --by 0.1,0,-0.1 --csv move.csv",
    ),
)
def move_command(options: RobotOptions, given: Given) -> ExitCode:
    """Plan a motion between two configurations and write it to a file: in joint space, at the tip, through waypoints.

    Exit code: 1 if the robot cannot follow the path, a limit is exceeded, links come too near (--clearance), or the verdict
    is not OK for another reason.
    """
    files = {"--limits": given.limits, "--srdf": given.srdf, "--waypoints": given.waypoints, **options.files}
    given.check_files(files)
    load = load_case(options.load(), options, given)
    robot = load.with_load
    bounds = _bounds(robot, given, degrees=options.degrees)
    if given.fastest and given.duration is not None:
        raise ValueRangeError("--fastest computes the duration, and --duration sets it. Leave one of them out.")
    if not given.step > 0:
        raise ValueRangeError(f"--step {printed(given.step)}: give seconds above zero.")
    begin, end, hints = _ends(robot, given, degrees=options.degrees)
    units = load.unit_hints
    typed = [*credible_limits(bounds, load.robot), *load.doubts]
    refused = [Headline(Word.LOOK_AGAIN, f"{each}.") for each in typed if each.refuses]

    def report(subject: str, blocks: list[Block], **shown: Any) -> None:
        write_report(
            given, "move", subject, blocks, files=files, robot=robot, limits=bounds,
            degrees=options.degrees, **shown,
        )  # fmt: skip

    if refused:
        show(*refused)
        report("contradictory input", [*refused])
        return ExitCode.NO
    path, trouble = _path_and_trouble(robot, begin, end, degrees=options.degrees, given=given)
    if path is None:
        return _cannot(trouble, [*hints, *units], report)
    friction = not given.no_friction and robot.model.friction.any
    try:
        with noted_if_failed(hints):
            moving = _timed(robot, path, bounds, given, friction=friction, whole=trouble is None)
    except PathError as problem:
        word, problem = _why_not_timed(problem, robot, held=_is_held(robot, path, bounds))
        return _cannot(problem, units, report, word=word)
    over, hanging = _certain(moving.violations(bounds, friction=friction), robot)
    uses = joint_uses(moving, bounds, friction=friction)
    doubts = hanging + [str(each) for each in typed if not each.refuses]
    doubts += limit_doubts(load.robot, bounds, [use.peak for use in uses])
    doubts += model_warnings(robot.model, uses)
    times = np.linspace(0.0, moving.duration, _SAMPLES)
    clearance = clearance_along(given, robot, [(times, moving(times)[0])])
    unclear = [] if clearance is None or clearance.verdict.word is not Word.UNSURE else clearance.verdict.reasons
    doubts += unclear
    collides = [] if unclear else clearance_verdict(clearance)
    cannot = "" if trouble is None else f"{trouble} The motion below, and in the files, is the path until there."
    assumed = assumed_words(assumptions(robot.model, load.payloads, friction=load.friction))
    carried = " and ".join(f"{number(p.mass)} kg" for p in load.payloads)
    blocks = [
        *collides,
        *_verdict(moving, bounds, over, doubts, cannot, assumed, named=not collides, degrees=options.degrees),
        *([] if clearance is None else clearance.lines),
        *_limits_of_files(bounds, given),
        *remarks([*hints, *units]),
        "",
        *move_view(moving, uses, friction=load.friction, degrees=options.degrees, carried=carried),
    ]
    show(*blocks)
    if given.csv is not None:
        moving.to_csv(given.csv, given.step, degrees=options.degrees)
    if given.plot is not None:
        moving.plot(given.plot, bounds, friction=friction)
    show_written(given.csv, given.plot)
    link = ""
    if given.html is not None:
        from ..reports.drawn_motion import motion_of

        judged = replace(load, robot=Robot(replace(load.robot.model, limits=bounds)))
        shown = replace(motion_of(judged, moving.sample(given.step)), clearance=clearance)
        link = write_viewer(given, judged.robot, motion=shown)
    if given.report is not None:
        from ..viz.pictures import drawn, robot_picture

        pictures = [robot_picture(robot, *_worst_moment(moving, uses, bounds, friction=friction), link=link)]
        pictures.append(drawn("Motion and limits", lambda path: moving.plot(path, bounds, friction=friction)))
        facts = [("duration", f"{number(moving.duration, 6)} s")]
        report(f"{robot.name} · {moving.path.name}", blocks, facts=facts, pictures=pictures)
    return ExitCode.FINE if not (over or doubts or collides) and trouble is None else ExitCode.NO


def _bounds(robot: Robot, given: Given, *, degrees: bool) -> Limits:
    """Limits of the robot or of --limits, with those of --acceleration and --jerk."""
    bounds = read_limits(given.limits, robot.model, degrees=degrees)
    asked = bounds_of(robot, acceleration=given.acceleration, jerk=given.jerk)
    if given.acceleration is not None:
        bounds = replace(bounds, acceleration=asked.acceleration, deceleration=asked.deceleration)
    return bounds if given.jerk is None else replace(bounds, jerk=asked.jerk)


def _ends(robot: Robot, given: Given, *, degrees: bool) -> tuple[Array, Array, list[str]]:
    """Configurations of --from and --to, and hints if they are plainly in degrees."""
    begin = configuration_of(robot, given.begin, degrees=degrees, what="--from")
    end = configuration_of(robot, given.to, degrees=degrees, what="--to", start=begin)
    hints = []
    for option_, texts, q in (("--from", given.begin, begin), ("--to", given.to, end)):
        hint = degrees_hint(robot, q) if texts else ""
        if hint:
            hints.append(f"{option_}: {hint}")
    return begin, end, hints


def _is_held(robot: Robot, path: JointPath, bounds: Limits) -> bool:
    """True if the torque limits suffice to stand still everywhere on the path."""
    q, _, _ = path(np.linspace(0.0, 1.0, _SAMPLES))
    shares = np.abs(motor_torques(robot.model, robot.holding_torques(q))) / bounds.effort
    return not bool(over_limit(shares).any())


def _why_not_timed(problem: PathError, robot: Robot, *, held: bool) -> tuple[Word, PathError]:
    """First word and reason for a path without a timing; torques of a legged robot whose base nothing holds are uncertain."""
    hanging = base_doubts(robot.model)
    if held or not hanging:
        return Word.STOPPED if held else Word.OVER_LIMIT, problem
    return Word.UNSURE, PathError("; ".join([*hanging, as_it_hangs(str(problem))]))


def _cannot(
    problem: PathError | None,
    hints: Sequence[str],
    report: Callable[[str, list[Block]], None],
    *,
    word: Word = Word.STOPPED,
) -> ExitCode:
    """Print that the path cannot be followed."""
    blocks: list[Block] = [Headline(word, str(problem)), *remarks(hints)]
    show(*blocks)
    report("no path", blocks)
    return ExitCode.NO


def _worst_moment(
    trajectory: Trajectory, uses: list[JointUse], bounds: Limits, *, friction: bool
) -> tuple[Array, MarkedJoint, str]:
    """Configuration in which a joint is nearest to a torque or velocity limit, the joint, and a title."""
    robot, t = trajectory.robot, np.linspace(0.0, trajectory.duration, _SAMPLES)
    q, dq, ddq = trajectory(t)
    tau = motor_torques(robot.model, required_torques(robot, t, q, dq, ddq, friction=friction))
    speed = np.where(coupled_entries(robot.model), np.inf, bounds.velocity)
    shares = np.maximum(np.abs(tau) / bounds.effort, np.abs(dq) / speed)
    row, k = np.unravel_index(int(np.argmax(shares)), shares.shape)
    label = f"{uses[k].joint}, {percent_of_limit(shares[row, k])} of a limit"
    marked = MarkedJoint(uses[k].joint, label, mark_style(float(shares[row, k])))
    return q[row], marked, f"{robot.name} at t = {seconds(t[row])} s"


def _timed(robot: Robot, path: JointPath, bounds: Any, given: Given, *, friction: bool, whole: bool) -> Trajectory:
    """Motion along the path: the fastest if requested and the path is ``whole``, otherwise with the time scaling."""
    if given.fastest and whole:
        kinds = ("velocity", "effort", "acceleration", "deceleration", "jerk")
        limits = {kind: getattr(bounds, kind) for kind in kinds}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConstraintWarning)  # the verdict checks positions against the given limits
            return fastest(robot, path, friction=friction, **limits)
    shapes: dict[str, Any] = {"quintic": quintic(1.0), "cubic": cubic(1.0), "s-curve": s_curve(1.0)}
    shape = {**shapes, "trapezoid": trapezoid(v=1.5, duration=1.0)}[given.scaling]
    if given.duration is not None:
        return Trajectory(robot, path, shape.stretched(given.duration), friction=friction)
    return Trajectory(robot, path, fitted(robot, path, shape, bounds, friction=friction), friction=friction)


def _path_and_trouble(
    robot: Robot, q0: Array, q1: Array, *, degrees: bool, given: Given
) -> tuple[JointPath | None, PathError | None]:
    """Requested path from q0 (nq,) to q1 (nq,) or ``--by``; if it ends early, its feasible part and the error."""
    tip_moves = [name for name in ("straight", "screw", "by") if getattr(given, name)]
    if len(tip_moves) > 1:
        raise ValueRangeError(f"--{tip_moves[0]} and --{tip_moves[1]} request two paths. Keep one of them.")
    if given.to and given.by is not None:
        raise ValueRangeError("--to and --by both set the end of the motion. Keep one of them.")
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
    elif tip_moves:
        build = straight_path if given.straight else screw_path
        poses = build(robot.forward_kinematics(q0), robot.forward_kinematics(q1))
    elif given.waypoints is None:
        return joint_line(robot, q0, q1), None
    else:
        between = _waypoints(robot, given.waypoints, degrees=degrees)
        return spline(robot, np.concatenate([[q0], between, [q1]])), None
    try:
        return follow_poses(robot, poses, q0), None
    except PathError as problem:
        return problem.partial, problem  # type: ignore[return-value]


def _waypoints(robot: Robot, file: str, *, degrees: bool) -> Array:
    """Configurations (n, nq) of a file."""
    names = robot.coordinate_names
    form = f"the columns {', '.join(names[:12])}, each once, and at least one row"
    with table_errors(file, "waypoint file", form):
        table = CsvFile.open(file)
        if sorted(table.header) != sorted(names):
            raise ValueRangeError(f"{file}: line {table.header_line}: give {form}.")
        found = table.table([table.header.index(name) for name in names])
    if not len(found):
        raise ValueRangeError(f"{file}: no row after the header: give {form}.")
    return found * np.where(Coordinates.from_model(robot.model).angular & degrees, math.radians(1.0), 1.0)


# ── The report


_SAMPLES = 2001
_LISTED = 12
_MOST_PASSED = 6
"""Maximum number of listed exceeded limits."""


@dataclass(frozen=True)
class JointUse:
    """Peaks of a joint or coupled motor in a motion, as values and as shares of the limits (nan without a limit)."""

    joint: str
    way: float
    velocity: float
    velocity_share: float
    peak: float
    """Torque of largest magnitude, with its sign."""
    torque_share: float
    unit: str
    """Unit of torque."""
    limiting: float
    """Fraction of the time at a limit, in a fastest motion."""
    uncertainty: float = 0.0
    """Standard deviation of the torque; zero for a planned motion."""


def joint_uses(trajectory: Trajectory, bounds: Limits, *, friction: bool) -> list[JointUse]:
    """Peaks for each entry of dq; coupled joints are replaced by their motors."""
    robot, model = trajectory.robot, trajectory.robot.model
    t = np.linspace(0.0, trajectory.duration, _SAMPLES)
    q, dq, ddq = trajectory(t)
    tau = motor_torques(model, required_torques(robot, t, q, dq, ddq, friction=friction))
    way, dq = motor_velocities(model, robot.subtract(q[-1], q[0])), motor_velocities(model, dq)
    units, most_speed = units_of("tau", drive_turns(model)), np.where(coupled_entries(model), np.inf, bounds.velocity)
    at_limit = dict.fromkeys((*model.velocity_names, *model.drive_labels), 0.0)
    if isinstance(trajectory, Fastest):
        for touch in trajectory.limit_contacts:
            at_limit[touch.joint] += (touch.end - touch.begin) / trajectory.duration
    found = []
    for k, name in enumerate(model.drive_labels):
        v, t = (x[int(np.abs(x).argmax())] for x in (dq[:, k], tau[:, k]))
        shares = [abs(x) / m if math.isfinite(m) else math.nan for x, m in ((v, most_speed[k]), (t, bounds.effort[k]))]
        use = (
            name,
            float(way[k]),
            float(v),
            shares[0],
            float(t),
            shares[1],
            units[k],
            at_limit[name],
        )
        found.append(JointUse(*use))
    return found


def move_view(
    trajectory: Trajectory, uses: list[JointUse], *, friction: bool, degrees: bool, carried: str
) -> Iterator[Block]:
    """Heading, one row per joint, and the active limits of the fastest motion over time."""
    robot = trajectory.robot
    turning = np.array(drive_turns(robot.model))
    factor = np.where(turning & degrees, math.degrees(1.0), 1.0)
    way, speed, force = (heading_unit(part, turning, degrees=degrees) for part in ("q", "dq", "tau"))
    most = [max((x for x in (u.velocity_share, u.torque_share) if not math.isnan(x)), default=0.0) for u in uses]
    fast = trajectory if isinstance(trajectory, Fastest) and trajectory.time_optimal is None else None
    yield Line(
        (robot.name, Style.STRONG),
        f"  ·  {trajectory.path.name}, {trajectory.scaling.name} timing: {number(trajectory.duration, 6)} s",
        f"  ·  carrying {carried}" if carried else "",
        f"  ·  {friction_words(robot.model, counted=friction)}",
    )
    yield Table(
        "",
        words("joint", [use.joint for use in uses]),
        numbers("way", [use.way for use in uses] * factor, _rounded, way),
        numbers("peak", [use.velocity for use in uses] * factor, _rounded, speed),
        numbers("share", [use.velocity_share for use in uses], percent_of_limit),
        numbers("peak", [use.peak for use in uses], torque, force),
        numbers("share", [use.torque_share for use in uses], percent_of_limit),
        numbers("at limit", [use.limiting for use in uses], percent) if fast else None,
        words("", map(Bar, most), fold=False),
        styles=[strong(Style.OVER) if over_limit(share) else "" for share in most],
    )
    if fast:
        yield from _timeline(fast)


def _rounded(value: float) -> str:
    return number(value, decimals=3)


def _timeline(trajectory: Fastest) -> Iterator[Block]:
    T, contacts = trajectory.duration, trajectory.limit_contacts
    shown = sorted(sorted(contacts, key=lambda t: t.begin - t.end)[:_LISTED], key=lambda t: t.begin)
    bars = []
    for t in shown:
        a, b = round(24 * t.begin / T), max(round(24 * t.end / T), round(24 * t.begin / T) + 1)
        bars.append("·" * min(a, 23) + "█" * (min(b, 24) - min(a, 23)) + "·" * (24 - min(b, 24)))
    yield Table(
        "What limits it when",
        numbers("from", [t.begin for t in shown], lambda t: seconds(t, 4), "s"),
        numbers("to", [t.end for t in shown], lambda t: seconds(t, 4), "s"),
        words("joint", [t.joint for t in shown], fold=False),
        words("limit", [f"{'+' if t.side > 0 else '-'} {t.kind}" for t in shown], fold=False),
        words("", [Glyphs(bar, Style.POINTED) for bar in bars], fold=False),
    )
    if rest := len(contacts) - len(shown):
        yield Line((f"and {rest} shorter parts", Style.QUIET))


def _certain(violations: tuple[Violation, ...], robot: Robot) -> tuple[tuple[Violation, ...], list[str]]:
    """Violations that hold however the base is held, and doubts about a legged robot's base and its torques."""
    hanging = base_doubts(robot.model)
    if not hanging:
        return violations, []
    torques = [as_it_hangs(str(v)) for v in violations if v.kind == "torque"]
    return tuple(v for v in violations if v.kind != "torque"), [*hanging, *torques[:1]]


def _verdict(
    trajectory: Trajectory,
    bounds: Limits,
    violations: tuple[Violation, ...],
    doubts: list[str],
    cannot: str,
    assumed: str,
    *,
    named: bool,
    degrees: bool,
) -> Iterator[Block]:
    """Verdict; ``doubts`` make it unsure, ``assumed`` lists assumptions of an OK, ``cannot`` is the reason for an early end.

    If not ``named``, the verdict word is left out because another verdict precedes it.
    """
    if cannot:
        yield Headline(Word.STOPPED, cannot)
    if violations:
        shown = [v.in_degrees() if degrees else v for v in violations[:_MOST_PASSED]]
        yield from (Headline(Word.OVER_LIMIT, f"{violation}.") for violation in shown)
        if len(violations) > _MOST_PASSED:
            yield f"and {len(violations) - _MOST_PASSED} more"
        return
    unknown = _unknown_velocities(trajectory, bounds)
    unlimited = unknown or np.isinf(bounds.effort).any()
    within = f"within {'the known' if unlimited else 'all'} limits"
    if isinstance(trajectory, Fastest):
        proven = ", the fastest timing on this path"
        within += proven if trajectory.time_optimal is None else f"; {trajectory.price_of_jerk}"
    time = f"{number(trajectory.duration, 6)} s, "
    within = "; ".join([*doubts, f"otherwise {within}"] if doubts else [time + within + assumed])
    word = Word.UNSURE if doubts else Word.OK
    if cannot:
        yield f"Until there: {within}."
    else:
        yield Headline(word, f"{within}.") if named else f"{within[0].upper()}{within[1:]}."
    yield from remarks(unknown)


def _limits_of_files(bounds: Limits, given: Given) -> Iterator[Block]:
    """Lines on acceleration and jerk limits that are not numbers in an option."""
    source = "the robot's file" if given.limits is None else f"the robot's file and {given.limits}"
    for kind in ("acceleration", "jerk"):
        count = int(np.isfinite(getattr(bounds, kind)).sum())
        if count and getattr(given, kind) is None:
            yield f"{kind.capitalize()} limits of {count} of {len(bounds.jerk)} joints are from {source}."


def _unknown_velocities(trajectory: Trajectory, bounds: Limits) -> list[str]:
    """Sentence on the joints without a velocity limit."""
    names = np.array(trajectory.robot.model.velocity_names)
    missing = names[~np.isfinite(bounds.velocity)]
    if not len(missing):
        return []
    of = "any joint" if len(missing) == len(names) else listed(missing, 6)
    return [
        f"No velocity limit of {of} is known, so none was applied. Give them with --limits FILE.csv (column velocity)."
    ]
