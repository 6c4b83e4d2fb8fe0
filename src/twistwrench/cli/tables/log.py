"""What ``twistwrench log info`` prints: the clock, and a row for each column."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.text import Text

from ...core.printed_numbers import number, percent
from ...report.log_quality import LogColumn, LogQuality
from .plain_table import PlainTable

_MANY_ZEROS, _FEW_STEPS = 0.1, 50
"""Share of the rows that are exactly zero, and steps of the grid from end to end, that are worth a word."""


def log_view(quality: LogQuality) -> RenderableType:
    """A line on the clock, and a table of the columns."""
    table = PlainTable()
    table.words("column")
    table.numbers("least", "most", "grid", "noise")
    table.words("", style="yellow")
    for column in quality.columns:
        table.row(column.name, column.least, column.most, column.grid or None, column.noise or None, _said(column))
    notes = [Text(f"note: {note}") for note in quality.notes]
    return Group(Text.assemble((quality.path.name, "bold"), f"  {_clock(quality)}"), table, *notes)


def _clock(quality: LogQuality) -> str:
    if not quality.time:
        return f"{quality.rows} rows, no column of time"
    said = [f"{quality.rows} rows in {number(quality.seconds)} s, {number(quality.rate)} Hz by the usual step"]
    if math.isfinite(quality.jitter) and quality.jitter * quality.rate > 1e-3:
        said.append(f"steps vary by {percent(quality.jitter * quality.rate, 2)}")
    for count, what in (
        (quality.gaps, f"gaps, the longest {number(quality.longest)} s"),
        (quality.repeated, "stamps repeated"),
        (quality.backward, "stamps run back"),
    ):
        if count:
            said.append(f"{count} {what}")
    return "; ".join(said)


def _said(column: LogColumn) -> str:
    if column.dead:
        return "one number throughout"
    said = [f"cut off: {percent(column.cut, 2)} of the rows at an extreme"] if column.cut else []
    if column.zeros > _MANY_ZEROS:
        said.append(f"exactly 0 in {percent(column.zeros, 2)} of the rows")
    if column.grid and column.most - column.least < _FEW_STEPS * column.grid:
        said.append(f"no more than {round((column.most - column.least) / column.grid)} steps of its grid in all")
    return "; ".join(said)
