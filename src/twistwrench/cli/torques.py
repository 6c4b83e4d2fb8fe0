"""The command ``torques``: its options, and its run from the motion to the report."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from ..errors import ValueRangeError
from ..verdict import ExitCode
from .bundled_files import motion_path
from .motion_options import loaded_motion_options, open_motion, refuse_motor_side
from .picture_paths import check_extra
from .progress import share_done
from .robot_options import RobotOptions
from .shared_options import LIMITS, option_group
from .work import files_in, worker_options

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..report.torque_findings import TorqueReport

_PLANNING, _PLANNING_AND_SMOOTHING = 0.25, 3.0
"""How long it takes to see how noisy a motion is, and to fit the smoothing, beside all that follows."""


torques_options = option_group(
    click.option("--why", is_flag=True, help="Split the worst joint's peak by link, payload and rotor too."),
    click.option("--motor-plot", metavar="OUT.png", help="Draw what each motor does in its speed–torque region."),
    LIMITS,
    click.option(
        "--plot", "plot_path", metavar="OUT.png", help="Draw torques, limits, and the split of the worst joint."
    ),
    click.option("--split", is_flag=True, help="Write the causes of the torques too."),
    click.option("--csv", "csv_path", metavar="OUT.csv", help="Write time and torques."),
    worker_options,
    loaded_motion_options(required=True),
)
"""The options of the command, all but the robot's own."""


def answer_torques(
    options: RobotOptions,
    show: Callable[[RenderableType], None],
    *,
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
    workers: int | None,
    scheduler: str | None,
) -> ExitCode:
    """Print the report with ``show``, and write the files; 0 where the verdict is OK. Raises errors of the library."""
    from ..outputs import check_outputs, picture_path

    if split and csv_path is None:
        raise ValueRangeError("--split adds columns to the file of --csv, and there is none. Add --csv OUT.csv.")
    path = motion_path(options, trajectory)
    reading: dict[str, Any] = {"columns": columns, "rate": rate, "lock_missing": lock_missing}
    if (paths := files_in(path, trajectory)) != [str(path)] or workers is not None or scheduler is not None:
        from .many_torques import TorquesOf, answer_many

        if plot_path or motor_plot or split or why:
            raise ValueRangeError(
                "--plot, --motor-plot, --split and --why are of one motion. Give one file, and no --workers."
            )
        work = TorquesOf(options, reading, payloads, wrenches, limits_path, smooth, friction=not no_friction)
        return answer_many(work, paths, show, csv_path=csv_path, workers=workers, scheduler=scheduler)
    check_extra(plot_path or motor_plot)
    plot_path = None if plot_path is None else picture_path(plot_path)
    motor_plot = None if motor_plot is None else picture_path(motor_plot)
    if motor_plot is not None and options.actuators is None:
        raise ValueRangeError("--motor-plot draws the motors, and none are described. Add --actuators FILE.yaml.")
    check_outputs(
        {"--csv": csv_path, "--plot": plot_path, "--motor-plot": motor_plot},
        {"--trajectory": path, "--limits": limits_path, **options.files},
    )
    from ..motion.differentiation import Differentiation
    from ..report.limits_file import read_limits
    from ..report.loaded_robot import LoadedRobot, parse_payload, parse_wrenches
    from ..report.progress_share import Steps
    from ..report.torques import analyse
    from .tables.torques import report_view

    robot, read = open_motion(options.load_and_locked, path, degrees=options.degrees, **reading)
    refuse_motor_side(options, robot, "torques")
    carried = tuple(parse_payload(text, options.tip) for text in payloads)
    load = LoadedRobot(robot, carried, parse_wrenches(wrenches), friction=not no_friction)
    limits = (
        robot.model.limits if limits_path is None else read_limits(limits_path, robot.model, degrees=options.degrees)
    )
    with share_done(path.name) as progress:
        steps = Steps(progress, (_PLANNING_AND_SMOOTHING if smooth else _PLANNING, 1.0))
        differentiation = Differentiation.plan(read, robot.model, smoothing=smooth, progress=steps.next())
        report = analyse(load, differentiation, limits, csv=csv_path, split=split, progress=steps.next())
    if smooth and not differentiation.derives:
        click.echo("note: --smooth changes nothing: the file gives velocities and accelerations.", err=True)
    show(report_view(report, degrees=options.degrees, why=why))
    _draw(report, plot_path, motor_plot, options.actuators)
    for written in filter(None, (csv_path, plot_path, motor_plot)):
        click.echo(f"wrote {written}")
    return report.verdict.exit_code


def _draw(report: TorqueReport, plot_path: str | None, motor_plot: str | None, actuators: object) -> None:
    """The pictures asked for."""
    if plot_path is not None:
        from ..plotting.torques import plot_report

        plot_report(report, plot_path)
    if motor_plot is not None:
        from ..plotting.motors import plot_motors

        if not report.motors:
            raise ValueRangeError(f"{actuators} describes no motor, so there is nothing to draw for --motor-plot.")
        plot_motors(report, motor_plot)
