"""Blocks of an answer as data: the word of the verdict, sentences, and tables with all digits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np

from ..core.numbers import MISSING
from .blocks import Bar, Block, Branch, Cell, Column, Glyphs, Headline, Line, Piece, Remark, Table


def report_data(blocks: Sequence[Block]) -> dict[str, Any]:
    """Verdict (None without one), sentences, tables and notes of a report, for JSON."""
    sentences = [block for block in blocks if not isinstance(block, Table | Remark)]
    return {
        "verdict": next((str(block.word) for block in blocks if isinstance(block, Headline)), None),
        "sentences": list(chain.from_iterable(map(_lines, sentences))),
        "tables": [table_data(block) for block in blocks if isinstance(block, Table)],
        "notes": [block.words for block in blocks if isinstance(block, Remark)],
    }


def table_data(table: Table) -> dict[str, Any]:
    """Title, columns with name and unit, and rows; a number is in the unit of its column, and None if it is not finite.

    Limits printed behind values become a separate column. Columns that contain only bars are left out.
    """
    columns: list[dict[str, str]] = []
    cells: list[list[Any]] = []
    for column in table.columns:
        name, source = " ".join(column.name.split()), column.narrow or column
        values = [_cell(source, value) for value in source.values]
        if name or any(values):
            columns.append({"name": name, "unit": source.unit})
            cells.append(values)
        if source.limits is not None:
            columns.append({"name": f"{name} limit", "unit": source.unit})
            cells.append([_number(limit) for limit in source.limits])
    return {"title": table.title, "columns": columns, "rows": [list(row) for row in zip(*cells, strict=True)]}


def plain(block: Block | Cell) -> str:
    """The text of a block or cell without styles; a bar is its label, and glyphs are left out."""
    if isinstance(block, Branch):
        return "\n".join([plain(block.label), *(plain(branch) for branch in block.branches)])
    if isinstance(block, Glyphs):
        return ""
    if isinstance(block, Bar):
        return _text(block.label)
    if isinstance(block, Headline | Line | Remark):
        return _text(block.pieces)
    return str(block)


def _text(pieces: Sequence[Piece]) -> str:
    return "".join(piece if isinstance(piece, str) else piece[0] for piece in pieces)


def _lines(block: Block) -> Iterator[str]:
    yield from (line.strip() for line in plain(block).splitlines() if line.strip())


def _cell(column: Column, value: Any) -> str | float | None:
    if isinstance(value, float | int | np.number):
        return _number(value)
    cell = column.show(value)
    if isinstance(cell, Bar):
        return _number(cell.share) if cell.text.strip() else ""
    text = " ".join(plain(cell).split())
    if isinstance(cell, Line) and cell.value is not None and text:
        return _number(cell.value)
    return None if not column.words and text in ("", MISSING) else text


def _number(value: float | np.number[Any]) -> float | None:
    if isinstance(value, int | np.integer):
        return int(value)
    return float(value) if math.isfinite(value) else None
