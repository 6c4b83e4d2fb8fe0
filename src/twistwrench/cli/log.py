"""The command ``twistwrench log``: quality of the files of motions."""

from __future__ import annotations

import json
from functools import partial

import click

from ..core.third_party import Failure, workers_of
from ..core.verdict import ExitCode
from ..reports.checked_motions import expanded_paths
from ..reports.log_report import LogReport, check_log
from .main import Given, command
from .shared import CHOICE, JSON, worker_options
from .terminal import progress_bar, show


@command(
    "log",
    CHOICE,
    JSON,
    worker_options,
    click.argument("files", metavar="FILE...", nargs=-1, required=True),
    examples_=("log log.csv", "log 'monday/*.csv' --json logs.json"),
)
def log_command(given: Given) -> ExitCode:
    """Check the columns of a log: rates, gaps, repeated stamps, and range, grid and noise of each column.

    FILE may be a folder, or a pattern in quotes. Several files of one log are written a.csv+b.csv. Files that cannot be read
    are reported last, with exit code 2.
    """
    failed: list[tuple[str, str]] = []
    paths = [path for text in given.files for path in expanded_paths(text)]
    found: list[LogReport] = []
    with progress_bar(f"{len(paths)} files") as progress, workers_of(given.workers, given.scheduler) as team:
        read = partial(check_log, **given.pick("topic", "episode"))
        for path, result in zip(paths, team.results(read, paths, progress), strict=True):
            if isinstance(result, Failure):
                failed.append((path, result.reason))
            else:
                found.append(result)
    if given.json is not None:
        given.results = json.dumps([report.to_dict() for report in found], indent=2) + "\n"
    show(*(block for report in found for block in report.blocks()))
    for path, reason in failed:
        click.echo(f"error: {reason if path in reason else f'{path}: {reason}'}", err=True)
    return ExitCode.BAD_INPUT if failed else ExitCode.FINE
