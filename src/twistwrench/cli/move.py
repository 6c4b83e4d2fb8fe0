"""The command ``twistwrench move``: a motion between two configurations, as text, table and picture."""

from __future__ import annotations

from dataclasses import replace

from ..core.arguments import parse_numbers
from ..core.errors import TwistWrenchError, ValueRangeError
from ..core.numbers import printed
from ..core.verdict import ExitCode
from ..motion.load_case import parse_payload
from ..robot import Robot
from ..trajectories.move_report import MoveReport, move
from .main import Given, note, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import (
    CLEARANCE,
    JSON,
    LIMITS,
    NO_FRICTION,
    PAYLOADS,
    RobotOptions,
    csv_option,
    load_case,
    robot_command,
    show_written,
)
from .terminal import show_answer


@robot_command(
    "move",
    option(
        "--from v,v,…|JOINT=VALUE",
        "Start configuration, in the form of --to. [default: neutral]",
        "start",
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
    if not given.step > 0:
        raise ValueRangeError(f"--step {printed(given.step)}: give seconds above zero.")
    tip_moves = [name for name in ("straight", "screw", "by") if getattr(given, name)]
    if len(tip_moves) > 1:
        raise ValueRangeError(f"--{tip_moves[0]} and --{tip_moves[1]} request two paths. Keep one of them.")
    robot = load_case(options.load(), options, given).robot
    by = None if given.by is None else parse_numbers(given.by, "--by", "x,y,z in metres, for example 0,0,0.1", 3)
    try:
        report = move(
            robot, given.to or None, start=given.start or None, by=by, waypoints=given.waypoints,
            path="line" if given.straight else "screw" if given.screw else "joint",
            payload=[parse_payload(text, options.tip) for text in given.payloads], friction=not given.no_friction,
            degrees=options.degrees, **given.pick(
                "fastest", "scaling", "duration", "limits", "acceleration", "jerk", "clearance", "srdf"
            ),
        )  # fmt: skip
    except TwistWrenchError as error:
        for hint in getattr(error, "__notes__", ()):
            note(hint)
        raise
    show_answer(report)
    link = ""
    if report.trajectory is not None:
        if given.csv is not None:
            report.to_csv(given.csv, given.step)
        if given.plot is not None:
            report.plot(path=given.plot)
        show_written(given.csv, given.plot)
        link = _written_viewer(given, report)
    if given.report is not None:
        from ..viz.answers import pictures_of_move

        write_report(
            given, "move", report.subject, list(report.blocks()), files=files, robot=report.robot, limits=report.limits,
            degrees=options.degrees, facts=report.facts().items(), pictures=pictures_of_move(report, link),
        )  # fmt: skip
    return report.verdict.exit_code


def _written_viewer(given: Given, report: MoveReport) -> str:
    """Write the page of --html if requested; returns its address for a report beside it, else empty."""
    if given.html is None or report.trajectory is None:
        return ""
    from ..reports.drawn_motion import motion_of

    judged = replace(report.load, robot=Robot(replace(report.load.robot.model, limits=report.limits)))
    shown = replace(motion_of(judged, report.trajectory.sample(given.step)), clearance=report.clearance)
    return write_viewer(given, judged.robot, motion=shown)
