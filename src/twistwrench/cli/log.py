"""The command ``twistwrench log``: quality of recorded motions."""

from __future__ import annotations

import json as json_
from functools import partial

import click

from ..core.answers.blocks import Block
from ..core.files import check_outputs, refuse_existing
from ..core.third_party.workers import Failure, workers_of
from ..core.verdict import ExitCode
from ..reports.checked_motions import expanded_paths
from ..reports.log_report import LogReport, check_log
from .main import plain_command
from .shared import CHOICE, JSON, worker_options, write_text
from .skin import ALL, OVERWRITE
from .terminal import progress_bar, show


@plain_command(
    "log",
    click.argument("files", metavar="FILE...", nargs=-1, required=True),
    CHOICE,
    worker_options,
    JSON,
    OVERWRITE,
    ALL,
    examples=("log log.csv", "log 'monday/*.csv' --json logs.json"),
)
def log_command(
    files: tuple[str, ...],
    topic: str | None,
    episode: int | None,
    workers: int | None,
    scheduler: str | None,
    json: str | None,
    overwrite: bool,
    whole_report: bool,  # noqa: ARG001  read by :func:`.terminal.show`
) -> ExitCode:
    """Check the columns of a log: rates, gaps, repeated stamps, and range, grid and noise of each column.

    FILE may be a folder, or a pattern in quotes. Several files of one log are written a.csv+b.csv. Files that cannot be read
    are reported last, with exit code 2.
    """
    paths: list[str] = []
    for text in files:
        paths += expanded_paths(text)
    if json is not None and json != "-":  # a file; "-" is standard output
        check_outputs({"--json": json}, {f"FILE {path}": path for path in paths})
        refuse_existing(json, overwrite=overwrite)
    reports: list[LogReport] = []
    reason_by_path: list[tuple[str, str]] = []  # of files that cannot be read
    with progress_bar(f"{len(paths)} files") as progress, workers_of(workers, scheduler) as pool:
        check_file = partial(check_log, topic=topic, episode=episode)
        for path, result in zip(paths, pool.results(check_file, paths, progress), strict=True):
            if isinstance(result, Failure):
                reason_by_path.append((path, result.reason))
            else:
                reports.append(result)
    if json == "-":
        click.echo(_json_text(reports))
    else:
        blocks: list[Block] = []
        for report in reports:
            blocks += report.blocks()
        show(*blocks)
        if json is not None:
            write_text(json, f"{_json_text(reports)}\n")
    for path, reason in reason_by_path:
        if path not in reason:
            reason = f"{path}: {reason}"
        click.echo(f"error: {reason}", err=True)
    return ExitCode.BAD_INPUT if reason_by_path else ExitCode.FINE


def _json_text(reports: list[LogReport]) -> str:
    """JSON of a list with the data of each report."""
    return json_.dumps([report.to_dict() for report in reports], indent=2)
