"""The command ``twistwrench log``: quality of the files of motions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from typing import Any

import click

from ..answers.blocks import Block, Line, Table, numbers, words
from ..core.colours import Style
from ..core.numbers import number, percent
from ..core.third_party import Failure, workers_of
from ..core.verdict import ExitCode
from ..reports.checked_motions import expanded_paths
from ..reports.log_quality import LogColumn, LogQuality
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
    found: list[LogQuality] = []
    with progress_bar(f"{len(paths)} files") as progress, workers_of(given.workers, given.scheduler) as team:
        read = partial(LogQuality.from_file, **given.pick("topic", "episode"))
        for path, result in zip(paths, team.results(read, paths, progress), strict=True):
            if isinstance(result, Failure):
                failed.append((path, result.reason))
            else:
                found.append(result)
    if given.json is not None:
        texts = [_plain({**asdict(q), "path": str(q.path)}) for q in found]
        given.results = json.dumps(texts, indent=2) + "\n"
    show(*(block for quality in found for block in log_view(quality)))
    for path, reason in failed:
        click.echo(f"error: {reason if path in reason else f'{path}: {reason}'}", err=True)
    return ExitCode.BAD_INPUT if failed else ExitCode.FINE


def _plain(value: Any) -> Any:
    """Replace non-finite numbers by None for JSON."""
    if isinstance(value, dict):
        return {name: _plain(x) for name, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


_MANY_ZEROS, _FEW_STEPS = 0.1, 50
"""Share of exact zeros above which, and number of grid steps over the range below which, a column gets a remark."""


def log_view(quality: LogQuality) -> Iterator[Block]:
    """Line on the clock, and table of the columns."""
    columns = quality.columns
    yield Line((quality.path.name, Style.STRONG), f"  {_clock(quality)}")
    yield Table(
        "",
        words("column", [column.name for column in columns]),
        numbers("least", [column.least for column in columns]),
        numbers("most", [column.most for column in columns]),
        numbers("grid", [column.grid or None for column in columns]),
        numbers("noise", [column.noise or None for column in columns]),
        words("", map(_doubts, columns), style=Style.NEAR),
    )
    yield from (f"note: {note}" for note in quality.notes)


def _clock(quality: LogQuality) -> str:
    if not quality.time:
        return f"{quality.rows} rows, no column of time"
    parts = [f"{quality.rows} rows in {number(quality.seconds)} s, {number(quality.rate)} Hz by the usual step"]
    if math.isfinite(quality.jitter) and quality.jitter * quality.rate > 1e-3:
        parts.append(f"steps vary by {percent(quality.jitter * quality.rate, 2)}")
    longest = f", the longest {number(quality.longest)} s"
    for count, one, several in (
        (quality.gaps, f"gap{longest}", f"gaps{longest}"),
        (quality.repeated, "stamp repeated", "stamps repeated"),
        (quality.backward, "stamp runs back", "stamps run back"),
    ):
        if count:
            parts.append(f"{count} {one if count == 1 else several}")
    return "; ".join(parts)


def _doubts(column: LogColumn) -> str:
    if column.dead:
        return "one number throughout"
    parts = [f"cut off: {percent(column.cut, 2)} of the rows at an extreme"] if column.cut else []
    if column.zeros > _MANY_ZEROS:
        parts.append(f"exactly 0 in {percent(column.zeros, 2)} of the rows")
    if column.grid and column.most - column.least < _FEW_STEPS * column.grid:
        parts.append(f"no more than {round((column.most - column.least) / column.grid)} steps of its grid in all")
    return "; ".join(parts)
