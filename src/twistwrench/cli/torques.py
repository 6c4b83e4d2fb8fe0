"""The command ``twistwrench torques``: report of one motion, one line each for many motions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from ..core.errors import ValueRangeError
from ..core.text import listed, words_of_the_shell
from ..reports.check import check
from ..reports.checked_motions import CheckedMotion, CheckedMotions, checked_motions, expanded_paths
from ..reports.torque_report import TorqueReport
from . import shared
from .main import option
from .shared import LogOptions, RobotOptions
from .skin import Asked, OutputFile, Outputs, command_of, picture_file, table_file
from .terminal import progress_bar

_PLOT_KINDS = ("torques", "causes", "power", "phase", "motors", "support", "mounting", "grip")
_PLOT_KINDS_BY_JOINT = {"causes", "phase"}
Checked: TypeAlias = TorqueReport | CheckedMotions
"""Answer on one motion, or on many."""


def _single_report(report: Checked) -> TorqueReport:
    """The report itself, for outputs of one motion only."""
    assert isinstance(report, TorqueReport), "files of one motion are refused for many"
    return report


def _to_csv(report: Checked, path: str) -> Path:
    """Write a CSV file; of one motion with the causes of the torques."""
    if isinstance(report, TorqueReport):
        return report.to_csv(path, split=True)
    return report.to_csv(path)


def _require_mcap() -> None:
    """Raise if the libraries of ``--mcap`` are not installed."""
    from ..reports.recordings.mcap import require_mcap

    require_mcap()


def _require_rerun() -> None:
    """Raise if the library of ``--rerun`` is not installed."""
    from ..reports.recordings.rerun_file import require_rerun

    require_rerun()


@command_of(
    "torques",
    check,
    shared.worker_options,
    option("--kind", "Kind of picture of --plot. [default: torques]", choices=_PLOT_KINDS),
    option(
        "--joint JOINT",
        "Joint to draw in --kind causes and phase; may be repeated. [default: all]",
        "joints",
        multiple=True,
    ),
    files=(
        table_file(_to_csv, "Write time, torques and their causes as a table"),
        picture_file("Draw the motion (.png, .pdf or .svg)."),
        OutputFile(
            "--mcap OUT.mcap",
            "Write states, torques, causes and limits as a ROS 2 recording, for Foxglove.",
            lambda report, path: _single_report(report).to_mcap(path),
            require=_require_mcap,
        ),
        OutputFile(
            "--rerun OUT.rrd",
            "Write the same for rerun.",
            lambda report, path: _single_report(report).to_rerun(path),
            require=_require_rerun,
        ),
    ),
    report=True,
    needs_motion=False,
    examples=(
        "torques ur5 demo --payload 10 --why",
        "torques quadruped --feet auto --plot standing.png --kind support",
    ),
)
def torques_command(
    robot: RobotOptions,
    log: LogOptions,
    asked: Asked,
    outputs: Outputs[Checked],
    workers: int | None,
    scheduler: str | None,
    kind: str | None,
    joints: tuple[str, ...],
    why: bool,
) -> Checked:
    """Compute the torques of a motion, or at rest (--at), compare them with the limits, and split them by cause.

    Exit code: 0 for OK; 1 for OVER LIMIT, COLLISION, UNSURE and LOOK AGAIN.
    """
    if log.trajectory is None:
        _check_picture(outputs, robot, kind, joints)
        return _with_picture(_at_rest(robot, log, {**asked, "why": why}), outputs, kind, joints)
    path = log.path(robot)
    is_typed = path == Path(log.trajectory)  # False for the bundled motion
    paths = expanded_paths(log.trajectory if is_typed else path)
    has_many_motions = paths != [str(path)]
    if has_many_motions or workers is not None or scheduler is not None:
        flags_of_one_motion = set(outputs.flags) - {"--csv", "--json", "--report"}  # these are of many motions, too
        if why or flags_of_one_motion:
            raise ValueRangeError(
                "--plot, --why, --mcap and --rerun are of one motion. Give one file, and no --workers."
            )
        motion_files = {f"MOTION {p}": p for p in paths}
        batch_outputs = replace(outputs, inputs={**motion_files, **robot.files})
        batch_outputs.check(overwrite=True)  # no output may be one of the inputs
        batch = BatchTorques(robot, log, asked, tuple(paths))
        with progress_bar(f"{len(paths)} motions") as progress:
            return checked_motions(Path(robot.source).stem, paths, batch.answer, workers, scheduler, progress)
    _check_picture(outputs, robot, kind, joints)
    with progress_bar(path.name) as progress:
        report = answer_of(robot, log, {**asked, "why": why}, path, progress=progress)
    return _with_picture(report, outputs, kind, joints)


def _with_picture(
    report: TorqueReport, outputs: Outputs[Checked], kind: str | None, joints: Sequence[str]
) -> TorqueReport:
    """The report itself, after the picture of --plot is set to a kind and joints."""
    if kind == "motors" and not report.motors:
        raise ValueRangeError("--kind motors: the actuator file describes no motor.")
    outputs.set_writer("--plot", lambda answer, path: _plot(_single_report(answer), kind, path, joints))
    return report


def _at_rest(robot: RobotOptions, log: LogOptions, asked: Asked) -> TorqueReport:
    """Answer on a robot at rest, without the file of a motion."""
    if log.given:
        flags = listed(f"--{name.replace('_', '-')}" for name in log.given)
        raise ValueRangeError(f"{flags}: of the file of a motion, and there is none. Name it after the robot.")
    return check(robot.load(), None, **asked)


def _check_picture(outputs: Outputs[Checked], robot: RobotOptions, kind: str | None, joints: Sequence[str]) -> None:
    """Raise, before a long run, if the kind of picture cannot be drawn, or no picture is written."""
    if kind is not None and "--plot" not in outputs.flags:
        raise ValueRangeError("--kind is of the picture of --plot, and there is none. Add --plot OUT.png.")
    name, equals_sign, path = outputs.path_of("--plot").partition("=")  # an older form: --plot KIND=PATH
    if equals_sign and name in _PLOT_KINDS:
        raise ValueRangeError(
            f"--plot {name}={path}: the kind is an option of its own. Write --plot {path} --kind {name}."
        )
    if kind == "motors" and robot.actuators is None:
        raise ValueRangeError("--kind motors draws the motors, and none are described. Add --actuators FILE.yaml.")
    if joints and kind not in _PLOT_KINDS_BY_JOINT:
        raise ValueRangeError(
            "--joint selects panels of --kind causes and phase. Add one of them, with --plot OUT.png."
        )


def _plot(report: TorqueReport, kind: str | None, path: str, joints: Sequence[str]) -> None:
    """Draw a kind of plot; with joints, the causes or the phase plane of these joints."""
    if joints:
        from ..reports.drawn_motion import reported_motion
        from ..viz.plots import motion

        draw = motion.plot_split if kind == "causes" else motion.plot_phase
        draw(reported_motion(report), path, joints)
    else:
        report.plot(kind, path)


# ── Many motions: a folder or a pattern, on processes or a cluster


@dataclass(frozen=True)
class BatchTorques:
    """Options of a batch of motions, which are sent to other processes."""

    robot: RobotOptions
    log: LogOptions
    asked: Asked
    logs: tuple[str, ...]

    def answer(self, path: str) -> CheckedMotion:
        """Line of the motion in a file; messages name options of the command, in other processes too."""
        with words_of_the_shell():
            report = answer_of(self.robot, self.log, self.asked, Path(path), self.logs)
            return CheckedMotion.from_report(path, report)


def answer_of(
    robot: RobotOptions,
    log: LogOptions,
    asked: Asked,
    path: Path,
    logs: Sequence[str] = (),
    *,
    progress: Callable[[float], None] | None = None,
) -> TorqueReport:
    """Answer of :func:`~twistwrench.check` on the motion in a file; ``logs`` are all files of a batch."""
    stands = bool({"feet", "wheels", "casters"} & asked.keys())
    loaded_robot, motion = shared.open_motion(robot, log, path, logs, stands=stands)
    shared.refuse_motor_side(robot, loaded_robot, "torques")
    return check(loaded_robot, motion, progress=progress, **asked)
