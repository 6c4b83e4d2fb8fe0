"""``twistwrench torques`` of many motions: a folder, or a pattern; each file's verdict in a line, whoever works on it."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.cluster import Failure, workers_of
from ..errors import ValueRangeError
from ..verdict import ExitCode, Word
from .motion_options import open_motion, refuse_motor_side
from .progress import share_done
from .robot_options import RobotOptions

if TYPE_CHECKING:
    from rich.console import RenderableType


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
class TorquesOf:
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
        from ..report.limits_file import read_limits
        from ..report.loaded_robot import LoadedRobot, parse_payload, parse_wrenches
        from ..report.torques import analyse

        options = self.options
        robot, read = open_motion(options.load_and_locked, Path(path), degrees=options.degrees, **self.reading)
        refuse_motor_side(options, robot, "torques")
        load = LoadedRobot(
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


def answer_many(
    work: TorquesOf,
    paths: Sequence[str],
    show: Callable[[RenderableType], None],
    *,
    csv_path: str | None,
    workers: int | None,
    scheduler: str | None,
) -> ExitCode:
    """Print a line for each file, those that failed among them, and write the same as a table; 0 where all are OK."""
    from ..outputs import check_outputs, replacing
    from .tables.many_torques import many_view

    check_outputs({"--csv": csv_path}, {**{f"MOTION {p}": p for p in paths}, **work.options.files})
    with share_done(f"{len(paths)} motions") as progress, workers_of(workers, scheduler) as team:
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
