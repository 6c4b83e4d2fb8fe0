"""The command ``twistwrench torques``: report of one motion, one line each for many motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..answers.blocks import (
    Block,
    Line,
    Table,
    numbers,
    word_cell,
    words,
)
from ..core.errors import ValueRangeError
from ..core.files import picture_path
from ..core.numbers import number, quantity
from ..core.third_party import Failure, workers_of
from ..core.verdict import ExitCode, Word
from ..motion.load_case import parse_payload, parse_wrenches
from ..motion.model_doubts import friction_words
from ..reports.check import check
from ..reports.torque_report import TorqueReport
from . import shared
from .main import Given, check_matplotlib, note, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import RobotOptions, robot_command
from .terminal import progress_bar, show, show_answer

if TYPE_CHECKING:
    pass

_PLANNING, _PLANNING_AND_SMOOTHING = 0.25, 3.0
"""Durations of noise estimation and smoothing relative to the analysis."""


_PLOTS = ("torques", "causes", "power", "phase", "motors")


@robot_command(
    "torques",
    shared.loaded_motion_options(required=True),
    shared.worker_options,
    shared.csv_option("Write time and torques as a table"),
    shared.JSON,
    option("--split", "Add the causes of the torques to the table of --csv."),
    option(
        "--plot [KIND=]OUT.png",
        f"Draw the motion (.png, .pdf or .svg); KIND: {', '.join(_PLOTS)}; may be repeated. [default KIND: torques]",
        "plots",
        multiple=True,
    ),
    option(
        "--joint JOINT",
        "Joint to draw in --plot causes= and phase=; may be repeated. [default: all]",
        "joints",
        multiple=True,
    ),
    shared.LIMITS,
    shared.CLEARANCE,
    option("--mcap OUT.mcap", "Write states, torques, causes and limits as a ROS 2 recording, for Foxglove."),
    option("--rerun OUT.rrd", "Write the same for rerun."),
    REPORT,
    PAGE,
    option("--why", "Split the peak of the worst joint by link, payload and rotor."),
    examples=(
        "torques ur5 demo --payload 10 --why",
        "torques ur5 demo --payload 5 --csv torques.csv --plot torques.png",
    ),
    robot_first=True,
)
def torques_command(options: RobotOptions, given: Given) -> ExitCode:
    """Compute the torques of a motion, compare them with the limits, and split them by cause.

    The first word is the verdict. Exit code: 0 for OK; 1 for OVER LIMIT, COLLISION, UNSURE and LOOK AGAIN.
    """
    if given.split and given.csv is None:
        raise ValueRangeError("--split adds columns to the file of --csv, and there is none. Add --csv OUT.csv.")
    path = shared.motion_path(options, given.trajectory)
    given.logs = paths = shared.expand_paths(path, given.trajectory)
    if paths != [str(path)] or given.workers is not None or given.scheduler is not None:
        if any((given.plots, given.split, given.why, given.mcap, given.rerun, given.report, given.html)):
            raise ValueRangeError(
                "--plot, --split, --why, --mcap, --rerun, --report and --html are of one motion. Give one file, and no "
                "--workers."
            )
        return run_batch(BatchTorques(options, given), paths)
    plots = _parse_plots(given.plots)
    if "motors" in plots and options.actuators is None:
        raise ValueRangeError("--plot motors=… draws the motors, and none are described. Add --actuators FILE.yaml.")
    if given.joints and not {"causes", "phase"} & plots.keys():
        raise ValueRangeError("--joint selects panels of --plot causes=… and phase=…. Add one of them.")
    files = {"--trajectory": path, "--limits": given.limits, "--srdf": given.srdf, **options.files}
    given.check_files(files, **{f"plot {kind}": picture for kind, picture in plots.items()})
    if given.mcap is not None or given.rerun is not None:
        from ..reports.recording import require_mcap, require_rerun

        for out, require in ((given.mcap, require_mcap), (given.rerun, require_rerun)):
            if out is not None:
                require()
    with progress_bar(path.name) as progress:
        report = answer_of(options, given, path, why=given.why, progress=progress)
    if given.smooth and not report.differentiation.derives:
        note("--smooth changes nothing: the file gives velocities and accelerations.")
    if "motors" in plots and not report.motors:
        raise ValueRangeError("--plot motors=…: the actuator file describes no motor.")
    blocks = list(report.blocks())
    show_answer(report)
    for kind, picture in plots.items():
        _plot(report, kind, picture, given.joints)
    if given.csv is not None:
        report.to_csv(given.csv, split=given.split)
    for out, write in ((given.mcap, report.to_mcap), (given.rerun, report.to_rerun)):
        if out is not None:
            write(out)
    shared.show_written(given.csv, *plots.values(), given.mcap, given.rerun)
    link = ""
    if given.html is not None:
        from ..reports.drawn_motion import reported_motion

        time = f"#t={number(report.joints[report.worst].time, 6)}" if report.worst is not None else ""
        link = write_viewer(given, report.load.robot, time, motion=reported_motion(report))
    if given.report is not None:
        write_torque_report(report, blocks, given, files, link)
    return report.verdict.exit_code


def _parse_plots(texts: Sequence[str]) -> dict[str, str]:
    """Pictures by kind; raises if one cannot be drawn, before a long run."""
    found: dict[str, str] = {}
    for text in texts:
        kind, sign, path = text.partition("=")
        kind, path = (kind, path) if sign else ("torques", text)
        if kind not in _PLOTS or not path:
            raise ValueRangeError(f"--plot {text!r} is not KIND=OUT.png. Kinds: {', '.join(_PLOTS)}.")
        if kind in found:
            raise ValueRangeError(f"--plot {kind} is given twice. Keep one of them.")
        found[kind] = picture_path(path)
    if found:
        check_matplotlib()
    return found


def _plot(report: TorqueReport, kind: str, path: str, joints: Sequence[str]) -> None:
    """Draw a kind of plot; causes and phase of some joints."""
    if joints and kind in ("causes", "phase"):
        from ..reports.drawn_motion import reported_motion
        from ..viz.plots import motion

        draw = motion.plot_split if kind == "causes" else motion.plot_phase
        draw(reported_motion(report), path, joints)
    else:
        report.plot(kind, path)


def write_torque_report(
    report: TorqueReport, blocks: Sequence[Block], given: Given, files: Mapping[str, str | Path | None], link: str
) -> None:
    """Write the page of one motion: worst moment, plots, and effects included in the torques."""
    from ..viz.answers import pictures_of, worst_moment

    pictures = list(pictures_of(report))
    if link:
        pictures[1] = worst_moment(report, link)
    load = report.load
    friction = friction_words(load.robot.model, counted=load.friction)
    write_report(
        given, "torques", report.subject, blocks, files=files, facts=report.facts().items(), pictures=pictures,
        robot=load.robot, limits=report.limits, degrees=report.in_degrees, used=[("torques", friction)],
    )  # fmt: skip


# ── Many motions: a folder or a pattern, on processes or a cluster


@dataclass(frozen=True)
class FileTorques:
    """Verdict on one motion, and the joint nearest to its limit or with the largest torque."""

    file: str
    verdict: str
    joint: str = ""
    peak: float = math.nan
    limit: float = math.nan
    unit: str = ""
    """Unit of peak and limit."""
    time: float = math.nan
    """Time of the peak [s]."""
    rows: int = 0
    reason: str = ""


@dataclass(frozen=True)
class BatchTorques:
    """Work on one file; it is sent to other processes."""

    options: RobotOptions
    given: Given

    def evaluate(self, path: str) -> FileTorques:
        """Torque report of the motion in this file."""
        report = answer_of(self.options, self.given, Path(path))
        judged = report.verdict
        found = FileTorques(path, str(judged.word), rows=report.rows, reason="; ".join(judged.reasons))
        if report.worst is None:
            return found
        worst = report.joints[report.worst]
        return replace(found, joint=worst.joint, peak=worst.peak, limit=worst.limit, unit=worst.unit, time=worst.time)


def answer_of(
    options: RobotOptions,
    given: Given,
    path: Path,
    *,
    why: bool = False,
    progress: Callable[[float], None] | None = None,
) -> TorqueReport:
    """Answer of :func:`~twistwrench.check` for the options."""
    robot, log = shared.open_motion(options, given, path)
    shared.refuse_motor_side(options, robot, "torques")
    return check(
        robot, log, payload=[parse_payload(text, options.tip) for text in given.payloads],
        wrench_on_robot=parse_wrenches(given.wrenches), limits=given.limits, friction=not given.no_friction,
        smooth=given.smooth, clearance=given.clearance, srdf=given.srdf, degrees=options.degrees, why=why, progress=progress,
    )  # fmt: skip


def run_batch(work: BatchTorques, paths: Sequence[str]) -> ExitCode:
    """Print a line for each file, including failed ones, and write a table; returns 0 if all are OK."""
    work.given.check_files({**{f"MOTION {p}": p for p in paths}, **work.options.files})
    with (
        progress_bar(f"{len(paths)} motions") as progress,
        workers_of(work.given.workers, work.given.scheduler) as team,
    ):
        found = [
            FileTorques(path, "failed", reason=result.reason) if isinstance(result, Failure) else result
            for path, result in zip(paths, team.results(work.evaluate, paths, progress), strict=True)
        ]
    show(many_table(found))
    columns = {field.name: [getattr(one, field.name) for one in found] for field in fields(FileTorques)}
    shared.write_csv(work.given.csv, columns)
    if all(one.verdict == "failed" for one in found):
        raise ValueRangeError(f"none of the {len(found)} motions can be read. The first: {found[0].reason}")
    return ExitCode.FINE if all(one.verdict == Word.OK for one in found) else ExitCode.NO


# ── Many motions


def many_table(found: Sequence[FileTorques]) -> Table:
    """Verdict, worst joint and reason of each file."""
    units = ", ".join(dict.fromkeys(one.unit for one in found if one.unit))
    column = partial(numbers, unit=units, headed=False)
    return Table(
        "",
        words("motion", [Path(one.file).name for one in found]),
        words("verdict", [word_cell(one.verdict) for one in found]),
        words("joint", [one.joint for one in found]),
        column("peak", [Line(quantity(one.peak, one.unit), value=one.peak) for one in found]),
        column("limit", [Line(quantity(one.limit, one.unit), value=one.limit) for one in found]),
        numbers("at", [Line(quantity(one.time, "s"), value=one.time) for one in found], unit="s", headed=False),
        words("", [one.reason for one in found]),
    )
