"""The command ``twistwrench payload``: the largest payload at a pose, as text and as a file."""

from __future__ import annotations

from ..core.arguments import parse_numbers
from ..core.verdict import ExitCode
from ..motion.load_case import parse_payload
from ..statics.payload_report import SAMPLES, payload
from . import shared
from .main import Given, note, option
from .report import REPORT, write_report
from .shared import RobotOptions, robot_command
from .terminal import show_answer


@robot_command(
    "payload",
    shared.AT,
    option(
        "--tool MASS[,x,y,z][@FRAME]",
        "Load attached already, in the form of --payload of torques; may be repeated.",
        "payloads",
        multiple=True,
    ),
    option("--frame FRAME", "Frame of the payload. [default: the tip]"),
    option("--com x,y,z", "Centre of mass of the payload in this frame [m].", default="0,0,0"),
    shared.LIMITS,
    option("--map rz|xz|yz|xy", "Map the largest payload over this plane of the workspace.", "plane"),
    option("--samples N", f"Number of random configurations for --map.  [default: {SAMPLES}]", type=int),
    shared.csv_option("Write the table, one row per joint"),
    shared.JSON,
    option("--plot OUT.png", "Draw force polytope, ellipsoid, shares and map."),
    REPORT,
    examples=("payload ur5", "payload ur5 --at shoulder_lift_joint=-0.6 --at elbow_joint=0.9 --com 0,0,0.1"),
)
def payload_command(options: RobotOptions, given: Given) -> ExitCode:
    """Find the largest payload held at rest at a pose, the joint that limits it, and the forces at the tip.

    Exit code: 1 if the pose is outside the position limits, or the robot cannot hold itself there.
    """
    files = {"--limits": given.limits, **options.files}
    given.check_files(files)
    report = payload(
        options.load(), given.at or None, tool=[parse_payload(text, options.tip) for text in given.payloads],
        frame=given.frame or options.tip, limits=given.limits, map=given.plane, samples=given.samples,
        com=parse_numbers(given.com, "--com", "x,y,z in metres, for example 0,0,0.1", 3), degrees=options.degrees,
    )  # fmt: skip
    show_answer(report)
    if not report.judged and (given.plane or given.plot):
        note("--map and --plot need a torque limit of every joint that is loaded; none is written.")
        given.plot = None
    if given.csv is not None:
        report.to_csv(given.csv)
    if given.plot is not None:
        report.plot(path=given.plot)
    shared.show_written(given.csv, given.plot)
    if given.report is not None:
        write_report(
            given, "payload", report.subject, list(report.blocks()), files=files, facts=report.facts().items(),
            pictures=report.pictures(), robot=report.robot, limits=report.limits, degrees=options.degrees,
        )  # fmt: skip
    return report.verdict.exit_code
