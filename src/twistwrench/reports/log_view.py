"""Quality of a log as blocks: its clock, and a row for each column."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..core.answers.blocks import Block, Line, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import number, percent
from .log_quality import LogColumn, LogQuality

_MOST = 10
"""Maximum number of rows in the short form."""
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
        most=_MOST,
    )
    yield from remarks(quality.notes)


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
