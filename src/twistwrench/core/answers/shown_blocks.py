"""Blocks that a surface, such as a terminal or a card, shows: all, or a short form with the important rows of long tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ..colours import Style
from .blocks import Block, Column, Level, Line, More, Remark, Table

ROWS_OF_ARM = 6
"""Number of rows up to which a table is always whole: the joints of an arm. A table with one row more is whole too."""


def shown_blocks(
    blocks: Iterable[Block], *, every: bool, hint: str, rows: int | None = None, uncut_rows: int = ROWS_OF_ARM
) -> list[Block]:
    """Blocks of the short form, or all of them if ``every``.

    In the short form, a table of more than ``uncut_rows`` rows keeps those with the largest shares, at most ``rows``. Notes on
    how files were read are only counted. The ``hint`` says how to see everything; an empty hint leaves out such references.
    """
    level = Level.ALL if every else Level.SHORT
    in_level = [block for block in blocks if isinstance(block, str) or block.level <= level]
    if every:
        return [block for block in in_level if not isinstance(block, More)]
    short = list[Block]()
    reading_note_count = 0
    for block in in_level:
        if isinstance(block, Table):
            short += shorten_table(block, hint, rows, uncut_rows)
        elif isinstance(block, Remark) and block.reading:
            reading_note_count += 1
        elif not isinstance(block, More):
            short.append(block)
        elif hint:
            short.append(Line((f"{block.sentence}: {hint}", Style.QUIET)))
    if reading_note_count > 0 and hint:
        plural = "s" if reading_note_count > 1 else ""
        short.append(Line((f"{reading_note_count} note{plural} on how the log was read: {hint}", Style.QUIET)))
    return short


_ROUNDING = 1e-9
"""Rounding error of a percentage."""


def shorten_table(table: Table, hint: str, rows: int | None = None, uncut_rows: int = ROWS_OF_ARM) -> list[Block]:
    """Table with at most ``rows`` rows, those of the largest shares in the table's order, and a line that counts the others."""
    row_count = len(table.styles)
    if table.most is None:  # a table that stays whole
        return [table]
    selected_count = table.most if rows is None else min(table.most, rows)
    if row_count <= max(selected_count, uncut_rows) + 1:  # a line that counts one row would take its place
        return [table]
    shares = [0.0] * row_count
    if table.by is not None:
        shares = [0.0 if math.isnan(share) else share for share in table.by]
    by_share = sorted(range(row_count), key=lambda k: -shares[k])
    selected = sorted(by_share[:selected_count])
    omitted = by_share[selected_count:]
    columns = [_selected_rows(column, selected) for column in table.columns]
    styles = [table.styles[k] for k in selected]
    short = Table(
        table.title,
        *columns,
        detail=table.detail,
        unit=table.unit,
        styles=styles,
        style=table.style,
        level=table.level,
    )
    if not hint:
        return [short]
    bound = ""
    largest_omitted = shares[omitted[0]]
    if table.of_limits and largest_omitted > 0:
        next_percentage = math.floor(100.0 * largest_omitted + _ROUNDING) + 1  # whole number above all omitted shares
        bound = f" below {next_percentage} %"
    return [short, Line((f"{len(omitted)} more{bound}: {hint}", Style.QUIET))]


def _selected_rows(column: Column, rows: Sequence[int]) -> Column:
    """Column with the rows of these numbers, also in its narrow form."""
    shortened = replace(column, values=[column.values[k] for k in rows])
    if column.limits is not None:
        shortened = replace(shortened, limits=[column.limits[k] for k in rows])
    if column.narrow is not None:
        shortened = replace(shortened, narrow=_selected_rows(column.narrow, rows))
    return shortened
