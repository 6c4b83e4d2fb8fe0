"""The commands ``twistwrench log``: what is in files of motions."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from ..verdict import ExitCode
from .command_texts import about
from .console import console
from .plain_errors import plain_errors
from .progress import share_done
from .work import files_in, worker_options


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
    from ..report.log_quality import LogQuality
    from .tables.log import log_view

    failed: list[tuple[str, str]] = []
    with plain_errors():
        paths = [path for text in files for path in files_in(Path(text), text)]
        found: list[LogQuality] = []
        with share_done(f"{len(paths)} files") as progress, workers_of(workers, scheduler) as team:
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
