"""The shell. Commands read options, call one function of the library, and turn errors into one line and an exit code.

Exit codes are those of :mod:`twistwrench.verdict`. Everything heavy is imported inside the command that needs it, so that
``--help`` answers at once.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .errors import ModelWarning, ValueRangeError
from .export.command import export_options
from .report.motion_options import motion_options, open_motion
from .report.usage import Commands
from .sensing.command import sensor_group
from .shell import RobotOptions, bundled, plain_errors, robot_command
from .simulation.command import simulate_options
from .statics.command import payload_options
from .symbolic.command import derive_options
from .trajectories.command import move_options
from .verdict import ExitCode
from .viz.command import plot_options, view_options

if TYPE_CHECKING:
    from rich.console import Console

    from .motion.trajectory import Trajectory

__all__ = ["main"]

_FOUND_A_PROBLEM = ExitCode.NO
_LONG_FILE = 1 << 23  # bytes from which a progress bar is worth its flicker
_DEMO = "demo"


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="twistwrench")
def main() -> None:
    """Robot dynamics from robot files. ROBOT is a path or the name of a bundled robot, such as ur5."""


@main.command()
@motion_options(required=True)
@click.option(
    "--payload",
    "payloads",
    metavar="MASS[,x,y,z][@FRAME]",
    multiple=True,
    help="A point mass carried; may be repeated.",
)
@click.option(
    "--wrench-on-robot", "wrenches", metavar="FRAME:m,m,m,f,f,f", multiple=True, help="What the world does to it there."
)
@click.option("--csv", "csv_path", metavar="OUT.csv", help="Write time and torques.")
@click.option("--split", is_flag=True, help="Write the causes of the torques too.")
@click.option("--plot", "plot_path", metavar="OUT.png", help="Draw torques, limits, and the split of the worst joint.")
@click.option(
    "--limits",
    "limits_path",
    metavar="FILE.csv",
    help="Limits in place of the robot's: joint,lower,upper,velocity,effort.",
)
@click.option("--motor-plot", metavar="OUT.png", help="Draw what each motor does in its speed–torque region.")
@click.option("--why", is_flag=True, help="Split the worst joint's peak by link, payload and rotor too.")
@click.option("--no-friction", is_flag=True, help="Leave joint friction and damping out.")
@robot_command
def torques(
    options: RobotOptions,
    trajectory: str,
    columns: tuple[str, ...],
    rate: float | None,
    lock_missing: bool,
    payloads: tuple[str, ...],
    wrenches: tuple[str, ...],
    csv_path: str | None,
    split: bool,
    plot_path: str | None,
    limits_path: str | None,
    motor_plot: str | None,
    why: bool,
    smooth: bool,
    no_friction: bool,
) -> None:
    """Which torques a motion takes, which joint is over its limit, and what causes it.

    The first word is the verdict. OK ends with exit code 0; OVER LIMIT, UNSURE and LOOK AGAIN with 1.
    """
    from .outputs import check_outputs, picture_path

    if split and csv_path is None:
        raise ValueRangeError("--split adds columns to the file of --csv, and there is none. Add --csv OUT.csv.")
    path = _motion_path(options, trajectory)
    _check_extra(plot_path or motor_plot)
    plot_path = None if plot_path is None else picture_path(plot_path)
    motor_plot = None if motor_plot is None else picture_path(motor_plot)
    if motor_plot is not None and options.actuators is None:
        raise ValueRangeError("--motor-plot draws the motors, and none are described. Add --actuators FILE.yaml.")
    check_outputs(
        {"--csv": csv_path, "--plot": plot_path, "--motor-plot": motor_plot},
        {"--trajectory": path, "--limits": limits_path, **options.files},
    )
    from .report.derivatives import Differentiation
    from .report.limits_file import read_limits
    from .report.load import LoadedRobot, parse_payload, parse_wrenches
    from .report.tables import report_view
    from .report.torques import analyse

    reading: dict[str, Any] = {"columns": columns, "rate": rate, "lock_missing": lock_missing}
    robot, read = open_motion(options.load_and_locked, path, degrees=options.degrees, **reading)
    load = LoadedRobot(robot, tuple(map(parse_payload, payloads)), parse_wrenches(wrenches), friction=not no_friction)
    limits = (
        robot.model.limits if limits_path is None else read_limits(limits_path, robot.model, degrees=options.degrees)
    )
    differentiation = Differentiation.plan(read, robot.model, smoothing=smooth)
    if smooth and not differentiation.derives:
        click.echo("note: --smooth changes nothing: the file gives velocities and accelerations.", err=True)
    with _progress(read) as progress:
        report = analyse(load, differentiation, limits, csv=csv_path, split=split, progress=progress)
    _console().print(report_view(report, degrees=options.degrees, why=why))
    if plot_path is not None:
        from .report.plot import plot_report

        plot_report(report, plot_path)
    if motor_plot is not None:
        from .report.motors_plot import plot_motors

        if not report.motors:
            raise ValueRangeError(
                f"{options.actuators} describes no motor, so there is nothing to draw for --motor-plot."
            )
        plot_motors(report, motor_plot)
    for written in filter(None, (csv_path, plot_path, motor_plot)):
        click.echo(f"wrote {written}")
    if not report.verdict.ok:
        sys.exit(report.verdict.exit_code)


@main.command()
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON, in SI units and radians.")
@click.option("--csv", "as_csv", is_flag=True, help="Print the joints as CSV, in SI units and radians.")
@robot_command
def info(options: RobotOptions, as_json: bool, as_csv: bool) -> None:
    """What the robot is made of: joints, limits, inertias, masses, frames, and its tree."""
    from .report.info import info_view

    if as_json and as_csv:
        raise ValueRangeError("--json and --csv both write to the standard output. Choose one.")
    if options.degrees and (as_json or as_csv):
        raise ValueRangeError("--json and --csv are in SI units and radians. Leave --degrees out.")

    with warnings.catch_warnings(record=True) as remarks:
        warnings.simplefilter("always", ModelWarning)
        robot = options.load()
    for remark in remarks:  # those of the model itself stand below its tree
        if not any(defect in str(remark.message) for defect in robot.defects):
            warnings.warn_explicit(remark.message, remark.category, remark.filename, remark.lineno)
    if as_json or as_csv:
        from .report.robot_summary import as_text

        click.echo(as_text(robot, "json" if as_json else "csv"), nl=False)
        return
    _console().print(info_view(robot, degrees=options.degrees))


@main.command(name="robots")
@click.argument("word", default="")
def list_robots(word: str) -> None:
    """The bundled robots, by name; those with WORD in their name or description if it is given."""
    with plain_errors():
        from .report.bundled import bundled_table

        _console().print(bundled_table(word))


@main.command()
@robot_command
def verify(options: RobotOptions) -> None:
    """Check the robot's dynamics against independent formulas and libraries; exit code 1 if any disagrees."""
    from .verify import render
    from .verify import verify as checked

    robot = options.load()
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to check: {robot.name!r} has no joint that moves; load with --floating-base.")
    report = checked(robot)
    _console().print(render(report))
    if not report.passed:
        sys.exit(_FOUND_A_PROBLEM)


@main.command()
@payload_options
@robot_command
def payload(options: RobotOptions, **given: Any) -> None:
    """The largest payload held at rest at a pose, the joint that limits it, and the forces the robot can apply.

    Exit code 1 if the pose is outside the joints' position limits, or the robot cannot hold itself there.
    """
    from .outputs import check_outputs, picture_path
    from .statics.command import answer_payload

    _check_extra(given["plot_path"])
    if given["plot_path"] is not None:
        given["plot_path"] = picture_path(given["plot_path"])
    check_outputs(
        {"--csv": given["csv_path"], "--plot": given["plot_path"]},
        {"--limits": given["limits_path"], **options.files},
    )
    robot = options.load()
    if not answer_payload(robot, _console().print, degrees=options.degrees, **given):
        sys.exit(_FOUND_A_PROBLEM)


@main.command()
@simulate_options
@robot_command
def simulate(options: RobotOptions, **given: Any) -> None:
    """How the robot moves, falls or is thrown: states, energies with their drift, events, and why it stopped.

    Exit code 1 if the motion ended before its duration: at a limit with --stop-at-limits, or because it could not go on;
    what was computed until then is printed and written.
    """
    from .outputs import check_outputs, picture_path
    from .simulation.command import answer_simulate

    _check_extra(given["plot_path"])
    if given["plot_path"] is not None:
        given["plot_path"] = picture_path(given["plot_path"])
    check_outputs({"--csv": given["csv_path"], "--npz": given["npz_path"], "--plot": given["plot_path"]}, options.files)
    if code := answer_simulate(options.load(), _console().print, degrees=options.degrees, **given):
        sys.exit(code)


@main.command()
@view_options
@robot_command
def view(options: RobotOptions, trajectory: str | None, **given: Any) -> None:
    """Show the robot in a browser: joints to move, a motion to play, torques, forces at the tip; or write a page or a film."""
    from .viz.command import answer_view

    path = None if trajectory is None else _motion_path(options, trajectory)
    answer_view(options.load_and_locked, path, options.files, degrees=options.degrees, **given)


@main.command()
@plot_options
@robot_command
def plot(options: RobotOptions, trajectory: str, **given: Any) -> None:
    """Draw a motion: what each torque is made of, power and energy, or the phase plane of each joint."""
    from .viz.command import answer_plot

    path = _motion_path(options, trajectory)
    answer_plot(options.load_and_locked, path, options.files, degrees=options.degrees, **given)


@main.command()
@move_options
@robot_command
def move(options: RobotOptions, **given: Any) -> None:
    """A motion from one place to another: straight in the joints or at the tip, through waypoints, or as fast as can be.

    Exit code 1 if the robot cannot follow the path, or the motion passes a limit.
    """
    from .outputs import check_outputs, picture_path
    from .trajectories.command import answer_move

    _check_extra(given["plot_path"])
    if given["plot_path"] is not None:
        given["plot_path"] = picture_path(given["plot_path"])
    check_outputs(
        {"--csv": given["csv_path"], "--plot": given["plot_path"]},
        {"--limits": given["limits_path"], "--waypoints": given["waypoints"], **options.files},
    )
    if not answer_move(options.load(), _console().print, degrees=options.degrees, **given):
        sys.exit(_FOUND_A_PROBLEM)


@main.command()
@derive_options
@robot_command
def derive(options: RobotOptions, **given: Any) -> None:
    """The robot's equations of motion in symbols, derived by Lagrange's method, as text, LaTeX, a page, C or NumPy."""
    from .symbolic.command import derive_answer

    for part in derive_answer(options.load(), options.files, **given):
        click.echo(part)


@main.command()
@export_options
@robot_command
def export(options: RobotOptions, **given: Any) -> None:
    """The robot's quantities as C99 source that allocates nothing and needs math.h only, with a program that checks it."""
    from .export.command import export_answer

    for line in export_answer(options.load(), options.files, **given):
        click.echo(line)


def _motion_path(options: RobotOptions, motion: str) -> Path:
    """The motion's file; the bundled ones are in radians."""
    path = bundled(motion, options.source, ".csv", "motion")
    if options.degrees and path != Path(motion):
        raise ValueRangeError("the bundled motion 'demo' is in radians. Leave --degrees out.")
    return path


def _check_extra(plot_path: str | None) -> None:
    """Say before the long run, not after it, that a picture cannot be drawn."""
    if plot_path is not None:
        from .figure import require_matplotlib

        require_matplotlib("Drawing the report (--plot)")


def _console() -> Console:
    from rich.console import Console

    class Output(Console):
        def on_broken_pipe(self) -> None:
            raise

    console = Output(highlight=False)
    # Files and pipes have no width of their own; 110 columns hold the tables without folding.
    return console if console.is_terminal else Output(highlight=False, width=110)


@contextmanager
def _progress(trajectory: Trajectory) -> Iterator[Callable[[int], None] | None]:
    """A bar over the bytes read, where a person watches and the file is long."""
    if trajectory.size < _LONG_FILE or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(trajectory.path.name, total=trajectory.size)
        yield lambda size: bar.advance(task, size)


main.add_command(sensor_group(plain_errors, _console, _check_extra))
