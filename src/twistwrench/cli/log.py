"""The commands ``twistwrench log``: what is in files of motions."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

import click

from .common import plain_errors
from .console import console


@click.group(name="log")
def log() -> None:
    """Logs: what is in a file of a motion. Several files of one log are written a.csv+b.csv."""


@log.command()
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
def info(files: tuple[str, ...], as_json: bool) -> None:
    """Rates, gaps, repeated stamps, and for each column its range, grid and noise, and whether it is cut off or dead."""
    from ..report.log_quality import LogQuality
    from .tables.log import log_view

    with plain_errors():
        found = [LogQuality.of(file) for file in files]
        if as_json:
            click.echo(json.dumps([_plain({**asdict(q), "path": str(q.path)}) for q in found], indent=2))
            return
        for quality in found:
            console().print(log_view(quality))


def _plain(value: Any) -> Any:
    """None in place of what JSON has no number for."""
    if isinstance(value, dict):
        return {name: _plain(x) for name, x in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(x) for x in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
