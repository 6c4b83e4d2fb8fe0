"""The command ``twistwrench size``: motors and gears of a catalogue under a cyclic motion, as text, table and picture."""

from __future__ import annotations

from ..core.errors import ValueRangeError
from ..core.verdict import ExitCode
from ..motion.load_case import parse_payload
from ..robots.finding import bundled_file
from ..sizing.sizing import size_drives
from ..sizing.sizing_view import worst_moment
from . import shared
from .main import Given, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import RobotOptions, robot_command
from .terminal import show_answer


@robot_command(
    "size",
    shared.motion_argument(required=True),
    option(
        "--catalog FILE.yaml",
        "Catalogue of motors and gears; 'demo': bundled with the robot, 'servos': a table of servos.",
        required=True,
    ),
    option("--choose", "Choose the smallest drives of the catalogue, also for joints that have drives."),
    option("--pause SECONDS", "Pause after the motion, in which the motors hold the robot.", type=float, default=0.0),
    option("--brake", "Hold the robot with brakes during the pause."),
    option("--ambient CELSIUS", "Ambient temperature.", type=float, default=25.0),
    option("--life HOURS", "Required L10 life of strain-wave gears. [default: none]", type=float),
    option("--emergency FILE", "Motion of an emergency stop, for the momentary peak torque of gears."),
    option(
        "--regeneration",
        "Braking energy feeds other drives, or a resistor.",
        choices=("shared", "none"),
        default="shared",
    ),
    option("--masses-included", "Do not add masses of drives; the links include them."),
    shared.reading_options(),
    shared.PAYLOADS,
    shared.NO_FRICTION,
    shared.csv_option("Write each figure with its limit as a table"),
    shared.JSON,
    option("--plot OUT.png", "Draw each motor's speed–torque region with the cycle, and its temperature."),
    REPORT,
    PAGE,
    option("--out-actuators OUT.yaml", "Write the drives as an actuator file."),
    examples=("size ur5 demo --catalog demo --pause 0.8 --ambient 40 --masses-included",),
    robot_first=True,
)
def size_command(options: RobotOptions, given: Given) -> ExitCode:
    """Size motors and gears for a cyclic motion: loads against ratings, winding temperature, gear life, supply.

    The first word is the verdict. Exit code: 0 for OK; 1 for OVER LIMIT, UNSURE and LOOK AGAIN.
    """
    path = shared.motion_path(options, given.trajectory)
    source = (
        "servos"
        if given.catalog == "servos"
        else bundled_file(given.catalog, options.source, ".drives.yaml", "catalogue")
    )
    read = {"MOTION": path, "--catalog": source if source != "servos" else None, "--emergency": given.emergency}
    files = {**read, **options.files}
    given.check_files(files)
    if options.actuators is not None:
        raise ValueRangeError(
            "the catalogue describes the drives, and --actuators describes others. Leave --actuators out."
        )
    robot, log = shared.open_motion(options, given, path)
    emergency = None
    if given.emergency is not None:
        emergency = shared.open_motion(options, given, shared.motion_path(options, given.emergency))[1]
    found = size_drives(
        robot, log, source, payload=[parse_payload(text, options.tip) for text in given.payloads], emergency=emergency,
        friction=not given.no_friction, add_masses=not given.masses_included,
        shared_supply=given.regeneration == "shared", **given.pick("pause", "ambient", "life", "brake", "choose", "smooth"),
    )  # fmt: skip
    show_answer(found)
    if found.motion is None or found.report is None:
        return found.verdict.exit_code
    if given.csv is not None:
        found.to_csv(given.csv)
    if given.plot is not None:
        found.plot(path=given.plot)
    if given.out_actuators is not None:
        found.write_actuators(given.out_actuators)
    shared.show_written(given.csv, given.plot, given.out_actuators)
    link = ""
    if given.html is not None:
        from ..reports.drawn_motion import reported_motion

        link = write_viewer(given, robot, worst_moment(found)[-1], motion=reported_motion(found.report))
    if given.report is not None:
        from ..viz.answers import pictures_of_sizing

        write_report(
            given, "size", found.subject, list(found.blocks()), files=files, pictures=pictures_of_sizing(found, link),
            robot=robot,
        )  # fmt: skip
    return found.verdict.exit_code
