"""The command ``twistwrench torques``: report of one motion, one line each for many motions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..answers.blocks import (
    Block,
)
from ..core.errors import ValueRangeError
from ..core.files import picture_path
from ..core.numbers import number
from ..core.verdict import ExitCode
from ..motion.load_case import parse_payload, parse_wrenches
from ..motion.model_doubts import friction_words
from ..reports.check import check
from ..reports.checked_motions import CheckedMotion, checked_motions, expanded_paths
from ..reports.torque_report import TorqueReport
from . import shared
from .main import Given, check_matplotlib, note, option
from .report import PAGE, REPORT, write_report, write_viewer
from .shared import RobotOptions, robot_command
from .terminal import progress_bar, show_answer

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
    given.logs = paths = expanded_paths(given.trajectory if path == Path(given.trajectory) else path)
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
    if link and report.worst is not None:
        pictures = [picture for picture in pictures if not isinstance(picture.content, bytes)]
        pictures.insert(1, worst_moment(report, link))
    load = report.load
    friction = friction_words(load.robot.model, counted=load.friction)
    write_report(
        given, "torques", report.subject, blocks, files=files, facts=report.facts().items(), pictures=pictures,
        robot=load.robot, limits=report.limits, degrees=report.in_degrees, used=[("torques", friction)],
        viewer=report.viewer(),
    )  # fmt: skip


# ── Many motions: a folder or a pattern, on processes or a cluster


@dataclass(frozen=True)
class BatchTorques:
    """Question about one file; it is sent to other processes."""

    options: RobotOptions
    given: Given

    def answer(self, path: str) -> CheckedMotion:
        """Line of the motion in this file."""
        return CheckedMotion.from_report(path, answer_of(self.options, self.given, Path(path)))


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
    given, source = work.given, work.options.source
    given.check_files({**{f"MOTION {p}": p for p in paths}, **work.options.files})
    with progress_bar(f"{len(paths)} motions") as progress:
        found = checked_motions(Path(source).stem, paths, work.answer, given.workers, given.scheduler, progress)
    show_answer(found)
    if given.csv is not None:
        shared.show_written(found.to_csv(given.csv))
    return found.verdict.exit_code
