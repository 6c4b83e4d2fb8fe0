"""Blocks that a surface shows: all of them, or a short form with the most important rows of long tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ..colours import Style
from .blocks import Block, Column, Level, Line, More, Remark, Table

ROWS_OF_ARM = 6
"""Rows of a table that is cut last: the joints of an arm, which may have one more."""


def shown_blocks(
    blocks: Iterable[Block], *, every: bool, hint: str, rows: int | None = None, uncut_rows: int = ROWS_OF_ARM
) -> list[Block]:
    """Blocks of the short form, or all of them if ``every``.

    Tables of more than ``uncut_rows`` keep the rows with the largest share, at most ``rows``; notes on how files were read are
    counted. The ``hint`` says how to see the rest.
    """
    level = Level.ALL if every else Level.SHORT
    in_level = [block for block in blocks if isinstance(block, str) or block.level <= level]
    if every:
        return [block for block in in_level if not isinstance(block, More)]
    short = list[Block]()
    reading_notes = 0
    for block in in_level:
        if isinstance(block, Table):
            short += shorten_table(block, hint, rows, uncut_rows)
        elif isinstance(block, Remark) and block.reading:
            reading_notes += 1
        elif not isinstance(block, More):
            short.append(block)
        elif hint:
            short.append(Line((f"{block.sentence}: {hint}", Style.QUIET)))
    if reading_notes and hint:
        plural = "s" * (reading_notes > 1)
        short.append(Line((f"{reading_notes} note{plural} on how the log was read: {hint}", Style.QUIET)))
    return short


_PERCENT, _ROUNDING = 100.0, 1e-9
"""Percent of a whole, and rounding error of a percentage."""


def shorten_table(table: Table, hint: str, rows: int | None = None, uncut_rows: int = ROWS_OF_ARM) -> list[Block]:
    """Table with its most important rows, at most ``rows``, in their order, and a line that counts the others."""
    count = len(table.styles)
    if table.most is None:
        return [table]
    row_count = table.most if rows is None else min(table.most, rows)
    if count <= max(row_count, uncut_rows) + 1:
        return [table]
    shares = [0.0] * count
    if table.by is not None:
        shares = [0.0 if math.isnan(share) else share for share in table.by]
    order = sorted(range(count), key=lambda k: -shares[k])
    selected, omitted = sorted(order[:row_count]), order[row_count:]
    columns = [_rows_of(column, selected) for column in table.columns]
    styles = [table.styles[k] for k in selected]
    short = Table(table.title, *columns, styles=styles, style=table.style, level=table.level)
    if not hint:
        return [short]
    largest, bound = shares[omitted[0]], ""
    if table.of_limits and largest > 0:
        bound = f" below {math.floor(_PERCENT * largest + _ROUNDING) + 1} %"
    return [short, Line((f"{len(omitted)} more{bound}: {hint}", Style.QUIET))]


def _rows_of(column: Column, rows: Sequence[int]) -> Column:
    """Some rows of a column."""
    column = replace(column, values=[column.values[k] for k in rows])
    if column.limits is not None:
        column = replace(column, limits=[column.limits[k] for k in rows])
    if column.narrow is not None:
        column = replace(column, narrow=_rows_of(column.narrow, rows))
    return column
