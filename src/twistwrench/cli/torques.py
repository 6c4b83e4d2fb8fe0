"""The command ``twistwrench torques``: one motion to the report, or many to a line each."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.cluster import Failure, workers_of
from ..core.verdict import ExitCode, Word
from ..errors import ValueRangeError
from .console import check_matplotlib, expand_paths, progress_bar, worker_options
from .motion_options import LIMITS, loaded_motion_options, open_motion, option_group, refuse_motor_side
from .robot_options import RobotOptions, motion_path

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..reports.torque_report import TorqueReport

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


def run_torques(
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
    from ..core.files import check_outputs, picture_path

    if split and csv_path is None:
        raise ValueRangeError("--split adds columns to the file of --csv, and there is none. Add --csv OUT.csv.")
    path = motion_path(options, trajectory)
    reading: dict[str, Any] = {"columns": columns, "rate": rate, "lock_missing": lock_missing}
    if (paths := expand_paths(path, trajectory)) != [str(path)] or workers is not None or scheduler is not None:
        if plot_path or motor_plot or split or why:
            raise ValueRangeError(
                "--plot, --motor-plot, --split and --why are of one motion. Give one file, and no --workers."
            )
        work = BatchTorques(options, reading, payloads, wrenches, limits_path, smooth, friction=not no_friction)
        return run_batch(work, paths, show, csv_path=csv_path, workers=workers, scheduler=scheduler)
    check_matplotlib(plot_path or motor_plot)
    plot_path = None if plot_path is None else picture_path(plot_path)
    motor_plot = None if motor_plot is None else picture_path(motor_plot)
    if motor_plot is not None and options.actuators is None:
        raise ValueRangeError("--motor-plot draws the motors, and none are described. Add --actuators FILE.yaml.")
    check_outputs(
        {"--csv": csv_path, "--plot": plot_path, "--motor-plot": motor_plot},
        {"--trajectory": path, "--limits": limits_path, **options.files},
    )
    from ..motion.differentiation import Differentiation
    from ..reports.load_case import LoadCase, parse_payload, parse_wrenches
    from ..reports.motors import Steps
    from ..reports.robot_summary import read_limits
    from ..reports.torque_report import analyse
    from .tables.torques import report_view

    robot, read = open_motion(options.load_and_locked, path, degrees=options.degrees, **reading)
    refuse_motor_side(options, robot, "torques")
    carried = tuple(parse_payload(text, options.tip) for text in payloads)
    load = LoadCase(robot, carried, parse_wrenches(wrenches), friction=not no_friction)
    limits = (
        robot.model.limits if limits_path is None else read_limits(limits_path, robot.model, degrees=options.degrees)
    )
    with progress_bar(path.name) as progress:
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
        from ..plotting.torques import plot_motors

        if not report.motors:
            raise ValueRangeError(f"{actuators} describes no motor, so there is nothing to draw for --motor-plot.")
        plot_motors(report, motor_plot)


# ── Many motions: a folder or a pattern, on processes or a cluster


@dataclass(frozen=True)
class FileTorques:
    """What one motion takes: its verdict, and the joint that is nearest to its limit, or takes most."""

    file: str
    verdict: str
    joint: str = ""
    peak: float = math.nan
    limit: float = math.nan
    unit: str = ""
    """Of peak and limit."""
    time: float = math.nan
    """s"""
    rows: int = 0
    reason: str = ""


@dataclass(frozen=True)
class BatchTorques:
    """The work on one file; it travels to other processes."""

    options: RobotOptions
    reading: dict[str, Any]
    payloads: tuple[str, ...]
    wrenches: tuple[str, ...]
    limits_path: str | None
    smooth: bool
    friction: bool

    def of(self, path: str) -> FileTorques:
        """What the motion in that file takes."""
        from ..motion.differentiation import Differentiation
        from ..reports.load_case import LoadCase, parse_payload, parse_wrenches
        from ..reports.robot_summary import read_limits
        from ..reports.torque_report import analyse

        options = self.options
        robot, read = open_motion(options.load_and_locked, Path(path), degrees=options.degrees, **self.reading)
        refuse_motor_side(options, robot, "torques")
        load = LoadCase(
            robot, tuple(map(parse_payload, self.payloads)), parse_wrenches(self.wrenches), friction=self.friction
        )
        limits = robot.model.limits
        if self.limits_path is not None:
            limits = read_limits(self.limits_path, robot.model, degrees=options.degrees)
        report = analyse(load, Differentiation.plan(read, robot.model, smoothing=self.smooth), limits)
        found = FileTorques(path, str(report.verdict.word), rows=report.rows, reason="; ".join(report.verdict.reasons))
        if report.worst is None:
            return found
        worst = report.joints[report.worst]
        return replace(found, joint=worst.joint, peak=worst.peak, limit=worst.limit, unit=worst.unit, time=worst.time)


def run_batch(
    work: BatchTorques,
    paths: Sequence[str],
    show: Callable[[RenderableType], None],
    *,
    csv_path: str | None,
    workers: int | None,
    scheduler: str | None,
) -> ExitCode:
    """Print a line for each file, those that failed among them, and write the same as a table; 0 where all are OK."""
    from ..core.files import check_outputs, replacing
    from .tables.torques import many_view

    check_outputs({"--csv": csv_path}, {**{f"MOTION {p}": p for p in paths}, **work.options.files})
    with progress_bar(f"{len(paths)} motions") as progress, workers_of(workers, scheduler) as team:
        found = [
            FileTorques(path, "failed", reason=result.reason) if isinstance(result, Failure) else result
            for path, result in zip(paths, team.results(work.of, paths, progress), strict=True)
        ]
    show(many_view(found))
    if csv_path is not None:
        with replacing(csv_path) as scratch, scratch.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([field.name for field in fields(FileTorques)])
            writer.writerows(astuple(one) for one in found)
    if all(one.verdict == "failed" for one in found):
        raise ValueRangeError(f"none of the {len(found)} motions can be read. The first: {found[0].reason}")
    return ExitCode.FINE if all(one.verdict == Word.OK for one in found) else ExitCode.NO
