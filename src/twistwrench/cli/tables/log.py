"""What ``twistwrench log info`` prints: the clock, and a row for each column."""

from __future__ import annotations

import math

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ...report.log_quality import LogColumn, LogQuality

_MANY_ZEROS, _FEW_STEPS = 0.1, 50
"""Share of the rows that are exactly zero, and steps of the grid from end to end, that are worth a word."""


def log_view(quality: LogQuality) -> RenderableType:
    """A line on the clock, and a table of the columns."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("column", overflow="fold")
    for name in ("least", "most", "grid", "noise"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", overflow="fold")
    for column in quality.columns:
        ends, rest = (column.least, column.most), (column.grid, column.noise)
        cells = [*(f"{x:.4g}" for x in ends), *(f"{x:.4g}" if x else "–" for x in rest)]
        table.add_row(Text(column.name), *cells, Text(_said(column), "yellow"))
    return Group(Text.assemble((quality.path.name, "bold"), f"  {_clock(quality)}"), table)


def _clock(quality: LogQuality) -> str:
    if not quality.time:
        return f"{quality.rows} rows, no column of time"
    said = [f"{quality.rows} rows in {quality.seconds:.4g} s, {quality.rate:.4g} Hz by the usual step"]
    if math.isfinite(quality.jitter) and quality.jitter * quality.rate > 1e-3:
        said.append(f"steps vary by {100 * quality.jitter * quality.rate:.2g} %")
    for count, what in (
        (quality.gaps, f"gaps, the longest {quality.longest:.3g} s"),
        (quality.repeated, "stamps repeated"),
        (quality.backward, "stamps run back"),
    ):
        if count:
            said.append(f"{count} {what}")
    return "; ".join(said)


def _said(column: LogColumn) -> str:
    if column.dead:
        return "one number throughout"
    said = [f"cut off: {100 * column.cut:.2g} % of the rows at an extreme"] if column.cut else []
    if column.zeros > _MANY_ZEROS:
        said.append(f"exactly 0 in {100 * column.zeros:.2g} % of the rows")
    if column.grid and column.most - column.least < _FEW_STEPS * column.grid:
        said.append(f"no more than {round((column.most - column.least) / column.grid)} steps of its grid in all")
    return "; ".join(said)
