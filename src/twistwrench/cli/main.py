"""The shell. Commands read options, call one function of the library, and turn errors into one line and an exit code.

Exit codes are those of :mod:`twistwrench.core.verdict`. Everything heavy is imported inside the command that needs it, so that
``--help`` answers at once.
"""

from __future__ import annotations

import sys
from typing import Any

import click

from ..core.verdict import ExitCode
from ..errors import ValueRangeError
from .console import console, picture
from .derive import derive_options
from .doctor import doctor_options
from .excite import excite_options, run_excite
from .export import convert_options, export_options
from .identify import identify_options, run_identify
from .info import log
from .move import move_options
from .payload import payload_options
from .robot_options import RobotOptions, motion_path, robot_command
from .sensor import sensor
from .simulate import simulate_options
from .torques import run_torques, torques_options
from .usage import Commands, about, plain_errors
from .view import plot_options, view_options

_FOUND_A_PROBLEM = ExitCode.NO
_DEMO = "demo"


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]}, **about(""))
@click.version_option(package_name="twistwrench")
def main() -> None:
    """Robot dynamics from robot files. ROBOT is a path, or a name that `twistwrench robots` lists, such as ur5."""


@main.command(**about("torques"))
@torques_options
@robot_command
def torques(options: RobotOptions, **given: Any) -> None:
    """Which torques a motion takes, which joint is over its limit, and what causes it.

    The first word is the verdict. OK ends with exit code 0; OVER LIMIT, UNSURE and LOOK AGAIN with 1.
    """
    if code := run_torques(options, console().print, **given):
        sys.exit(code)


@main.command(**about("info"))
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON, in SI units and radians.")
@click.option(
    "--csv",
    "csv_path",
    metavar="OUT.csv",
    help="Write the joints as CSV, in SI units and radians, as --limits reads it; '-' prints it.",
)
@robot_command
def info(options: RobotOptions, as_json: bool, csv_path: str | None) -> None:
    """What the robot is made of: joints, limits, inertias, masses, frames, and its tree."""
    from .info import run_info

    run_info(options, console().print, as_json=as_json, csv_path=csv_path)


@main.command(name="robots", **about("robots"))
@click.argument("word", default="")
def list_robots(word: str) -> None:
    """The robots that have a name: bundled, or of packages that are installed; with WORD, those that have it in theirs."""
    with plain_errors():
        from .tables.robots import robot_tables

        screen = console()
        for table in list(robot_tables(word)):
            screen.print(table)


@main.command(**about("verify"))
@robot_command
def verify(options: RobotOptions) -> None:
    """Check the robot's dynamics against independent formulas and libraries; exit code 1 if any disagrees."""
    from ..verify import verify as checked
    from .tables.robots import verification_view

    robot = options.load()
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to check: {robot.name!r} has no joint that moves; load with --floating-base.")
    report = checked(robot)
    console().print(verification_view(report))
    if not report.passed:
        sys.exit(_FOUND_A_PROBLEM)


@main.command(**about("payload"))
@payload_options
@robot_command
def payload(options: RobotOptions, **given: Any) -> None:
    """The largest payload held at rest at a pose, the joint that limits it, and the forces the robot can apply.

    Exit code 1 if the pose is outside the joints' position limits, or the robot cannot hold itself there.
    """
    from ..core.files import check_outputs
    from .payload import run_payload

    given["plot_path"] = picture(given["plot_path"])
    check_outputs(
        {"--csv": given["csv_path"], "--plot": given["plot_path"]},
        {"--limits": given["limits_path"], **options.files},
    )
    robot = options.load()
    if not run_payload(robot, console().print, degrees=options.degrees, tip=options.tip, **given):
        sys.exit(_FOUND_A_PROBLEM)


@main.command(**about("simulate"))
@simulate_options
@robot_command
def simulate(options: RobotOptions, **given: Any) -> None:
    """How the robot moves, falls or is thrown: states, energies with their drift, events, and why it stopped.

    Exit code 1 if the motion ended before its duration: at a limit with --stop-at-limits, or because it could not go on;
    what was computed until then is printed and written.
    """
    from ..core.files import check_outputs
    from .simulate import run_simulate

    given["plot_path"] = picture(given["plot_path"])
    check_outputs({"--csv": given["csv_path"], "--npz": given["npz_path"], "--plot": given["plot_path"]}, options.files)
    if code := run_simulate(options.load(), console().print, degrees=options.degrees, **given):
        sys.exit(code)


@main.command(**about("view"))
@view_options
@robot_command
def view(options: RobotOptions, trajectory: str | None, **given: Any) -> None:
    """Show the robot in a browser: joints to move, a motion to play, torques, forces at the tip; or write a page or a film.

    Exit code 1, LOOK AGAIN, if the motion contradicts itself; it is shown all the same.
    """
    from .view import run_view

    path = None if trajectory is None else motion_path(options, trajectory)
    if code := run_view(options.load_and_locked, path, options.files, degrees=options.degrees, **given):
        sys.exit(code)


@main.command(**about("plot"))
@plot_options
@robot_command
def plot(options: RobotOptions, trajectory: str, **given: Any) -> None:
    """Draw a motion: what each torque is made of, power and energy, or the phase plane of each joint.

    Exit code 1, LOOK AGAIN, if the motion contradicts itself; it is drawn all the same.
    """
    from .view import run_plot

    path = motion_path(options, trajectory)
    if code := run_plot(options.load_and_locked, path, options.files, degrees=options.degrees, **given):
        sys.exit(code)


@main.command(**about("move"))
@move_options
@robot_command
def move(options: RobotOptions, **given: Any) -> None:
    """A motion from one place to another: straight in the joints or at the tip, through waypoints, or as fast as can be.

    Exit code 1 if the robot cannot follow the path, or the motion passes a limit or lacks a contact, or a link its mass.
    """
    from ..core.files import check_outputs
    from .move import run_move

    given["plot_path"] = picture(given["plot_path"])
    check_outputs(
        {"--csv": given["csv_path"], "--plot": given["plot_path"]},
        {"--limits": given["limits_path"], "--waypoints": given["waypoints"], **options.files},
    )
    if not run_move(options.load(), console().print, degrees=options.degrees, tip=options.tip, **given):
        sys.exit(_FOUND_A_PROBLEM)


@main.command(**about("derive"))
@derive_options
@robot_command
def derive(options: RobotOptions, **given: Any) -> None:
    """The robot's equations of motion in symbols, derived by Lagrange's method, as text, LaTeX, a page, C or NumPy."""
    from .derive import run_derive

    for part in run_derive(options.load(), options.files, **given):
        click.echo(part)


@main.command(**about("convert"))
@robot_command
@convert_options
def convert(options: RobotOptions, **given: Any) -> None:
    """The robot as a file of another format: OUT.urdf, OUT.xml (MJCF) or OUT.sdf.

    Exit code 1 if the format cannot say something of the robot, which is listed; the file is written all the same.
    """
    from .export import run_convert

    if not run_convert(options, click.echo, **given):
        sys.exit(_FOUND_A_PROBLEM)


@main.command(**about("export"))
@export_options
@robot_command
def export(options: RobotOptions, **given: Any) -> None:
    """The robot's quantities as C99 source that allocates nothing and needs math.h only, with a program that checks it."""
    from .export import run_export

    for line in run_export(options.load(), options.files, **given):
        click.echo(line)


@main.command(**about("doctor"))
@doctor_options
def doctor(**given: Any) -> None:
    """What is wrong with a robot file, what it does to M and to gravity torques, and the repair.

    Exit code 1 with errors or warnings.
    """
    from .doctor import run_doctor

    with plain_errors():
        given["plot_path"] = picture(given["plot_path"])
        if code := run_doctor(console().print, **given):
            sys.exit(code)


@main.command(**about("identify"))
@robot_command
@identify_options
def identify(options: RobotOptions, **given: Any) -> None:
    """The robot's masses, inertias, friction and motor inertias from logs, with intervals, and what speaks against the logs.

    The first word is the verdict. OK ends with exit code 0; UNSURE and LOOK AGAIN with 1, and after LOOK AGAIN only --json is
    written unless --force is given. Several files of one log are written a.csv+b.csv.
    """
    if code := run_identify(options, console().print, **given):
        sys.exit(code)


@main.command(**about("excite"))
@robot_command
@excite_options
def excite(options: RobotOptions, **given: Any) -> None:
    """A motion whose log tells the robot's masses, inertias and friction best, at rest at both ends and within all limits.

    The limits are those of positions, velocities, accelerations and torques, and the floor if one is given. Links stay 20 mm
    away from it and from each other, by capsules around the shapes of the robot's file; of links without shapes capsules are
    assumed. The first word is the verdict: OK ends with exit code 0; UNSURE with 1 where capsules are assumed or something was
    not looked at. The motion is written in either case.
    """
    if code := run_excite(options, console().print, **given):
        sys.exit(code)


main.add_command(sensor)
main.add_command(log)
