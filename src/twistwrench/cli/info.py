"""The commands ``twistwrench info`` and ``log``: the contents of robots and of files of motions."""

from __future__ import annotations

import json
import math
import sys
import warnings
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from ..core.files import check_outputs, replacing
from ..core.verdict import ExitCode
from ..errors import ModelWarning, ValueRangeError
from .console import console, expand_paths, progress_bar, worker_options
from .robot_options import RobotOptions
from .usage import about, plain_errors


def run_info(options: RobotOptions, show: Callable[[Any], None], *, as_json: bool, csv_path: str | None) -> None:
    """Show a robot, print it as JSON, or write its joints as CSV."""
    from .tables.robots import info_view

    if as_json and csv_path is not None:
        raise ValueRangeError("--json prints the robot, and --csv writes its joints. Choose one.")
    if options.degrees and (as_json or csv_path is not None):
        raise ValueRangeError("--json and --csv are in SI units and radians. Leave --degrees out.")
    if csv_path is not None and csv_path != "-":
        check_outputs({"--csv": csv_path}, options.files)

    with warnings.catch_warnings(record=True) as remarks:
        warnings.simplefilter("always", ModelWarning)
        robot = options.load()
    for remark in remarks:  # those of the model itself stand below its tree
        if not any(defect in str(remark.message) for defect in robot.defects):
            warnings.warn_explicit(remark.message, remark.category, remark.filename, remark.lineno)
    if as_json or csv_path is not None:
        from ..reports.robot_summary import as_text

        text = as_text(robot, "json" if as_json else "csv")
        if as_json or csv_path == "-":
            click.echo(text, nl=False)
        elif csv_path is not None:
            with replacing(csv_path) as scratch:
                scratch.write_text(text, encoding="utf-8", newline="")
            click.echo(f"wrote {csv_path}")
        return
    show(info_view(robot, degrees=options.degrees))


# ── ``log``: files of motions


@click.group(name="log", cls=click.Group, **about("log"))
def log() -> None:
    """Logs: what is in a file of a motion. Several files of one log are written a.csv+b.csv."""


@log.command(**about("log info"))
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@worker_options
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
def info(files: tuple[str, ...], as_json: bool, workers: int | None, scheduler: str | None) -> None:
    """Rates, gaps, repeated stamps, and for each column its range, grid and noise, and whether it is cut off or dead.

    FILE may be a folder, or a pattern in quotes. Files that cannot be read are reported last, with exit code 2.
    """
    from ..core.cluster import Failure, workers_of
    from ..reports.log_quality import LogQuality
    from .tables.robots import log_view

    failed: list[tuple[str, str]] = []
    with plain_errors():
        paths = [path for text in files for path in expand_paths(Path(text), text)]
        found: list[LogQuality] = []
        with progress_bar(f"{len(paths)} files") as progress, workers_of(workers, scheduler) as team:
            for path, result in zip(paths, team.results(LogQuality.of, paths, progress), strict=True):
                if isinstance(result, Failure):
                    failed.append((path, result.reason))
                else:
                    found.append(result)
        if as_json:
            click.echo(json.dumps([_plain({**asdict(q), "path": str(q.path)}) for q in found], indent=2))
        else:
            for quality in found:
                console().print(log_view(quality))
        for path, reason in failed:
            click.echo(f"error: {reason if path in reason else f'{path}: {reason}'}", err=True)
        if failed:
            sys.exit(ExitCode.BAD_INPUT)


def _plain(value: Any) -> Any:
    """None in place of what JSON has no number for."""
    if isinstance(value, dict):
        return {name: _plain(x) for name, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
