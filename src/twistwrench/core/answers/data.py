"""Blocks of an answer as data: the word of the verdict, sentences, and tables with all digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..numbers import MISSING
from ..tables import data_frame
from .blocks import Aligned, Bar, Block, Branch, Cell, Column, Glyphs, Headline, Line, More, Piece, Remark, Table


@dataclass(frozen=True)
class DataTable:
    """Table of an answer as data: columns with their units, and rows with all digits.

    Examples
    --------
    >>> table = DataTable("Torques", (("joint", ""), ("peak", "N m")), (("elbow", 28.5),))
    >>> table.to_dict(), table.rows()
    ({'joint': ['elbow'], 'peak': [28.5]}, [{'joint': 'elbow', 'peak': 28.5}])
    >>> table.to_pandas().attrs["units"]
    {'joint': '', 'peak': 'N m'}
    """

    title: str
    """Title without the unit."""
    columns: tuple[tuple[str, str], ...]
    """Name and unit of each column."""
    cells: tuple[tuple[Any, ...], ...]
    """Rows of cells; numbers are in the unit of their column, and None if not finite."""

    @classmethod
    def from_table(cls, table: Table) -> DataTable:
        """All rows of a table.

        Parameters
        ----------
        table : Table, a block of an answer

        Returns
        -------
        table : DataTable

        Examples
        --------
        >>> DataTable.from_table(Table("Peaks", Column("joint", ["rail"], words=True), unit="N")).title
        'Peaks'
        """
        data = table_data(table)
        columns = tuple((column["name"], column["unit"]) for column in data["columns"])
        return cls(table.title + table.detail, columns, tuple(map(tuple, data["rows"])))

    def rows(self) -> list[dict[str, Any]]:
        """One dictionary for each row.

        Returns
        -------
        rows : list of {column: value}
        """
        names = [name for name, _ in self.columns]
        return [dict(zip(names, row, strict=True)) for row in self.cells]

    def to_dict(self) -> dict[str, list[Any]]:
        """One list for each column.

        Returns
        -------
        columns : {column: list of values}
        """
        columns: dict[str, list[Any]] = {}
        for k, (name, _) in enumerate(self.columns):
            columns[name] = [row[k] for row in self.cells]
        return columns

    def to_pandas(self) -> Any:
        """Table as a DataFrame, with units in ``attrs``.

        Returns
        -------
        frame : pandas.DataFrame

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        frame = data_frame(self.to_dict())
        frame.attrs["units"] = dict(self.columns)
        return frame


def report_data(blocks: Sequence[Block]) -> dict[str, Any]:
    """Verdict (None without one), sentences, tables and notes of a report, for JSON."""
    verdict: str | None = None
    sentences: list[str] = []
    tables: list[dict[str, Any]] = []
    notes: list[str] = []
    for block in blocks:
        if isinstance(block, Headline) and verdict is None:
            verdict = str(block.word)  # and its text is among the sentences
        if isinstance(block, Table):
            tables.append(table_data(block))
        elif isinstance(block, Remark):
            notes.append(block.words)
        elif not isinstance(block, More):
            sentences += _lines(block)
    return {"verdict": verdict, "sentences": sentences, "tables": tables, "notes": notes}


def table_data(table: Table) -> dict[str, Any]:
    """Title, columns with name and unit, and rows; numbers are in the unit of their column, and None if not finite.

    Limits printed behind values become a separate column. A column without name and content, such as one of bars, is left out.
    """
    columns: list[dict[str, str]] = []
    cells_by_column: list[list[Any]] = []
    for column in table.columns:
        name = " ".join(column.name.split())
        # The form for narrow terminals has numbers in place of bars.
        number_column = column if column.narrow is None else column.narrow
        unit = number_column.unit
        cells = [_cell(number_column, value) for value in number_column.values]
        if name or any(cells):
            columns.append({"name": name, "unit": unit})
            cells_by_column.append(cells)
        if number_column.limits is not None:
            columns.append({"name": f"{name} limit", "unit": unit})
            cells_by_column.append([_number(limit) for limit in number_column.limits])
    rows = [list(row) for row in zip(*cells_by_column, strict=True)]
    return {"title": table.heading, "columns": columns, "rows": rows}


def plain(block: Block | Cell) -> str:
    """Text of a block or cell without styles; for a bar its label, for glyphs the empty text."""
    if isinstance(block, Branch):
        texts = [plain(block.label), *map(plain, block.branches)]
        return "\n".join(texts)
    if isinstance(block, Glyphs):
        return ""
    if isinstance(block, Bar):
        return _text(block.label)
    if isinstance(block, Headline | Line | Remark):
        return _text(block.pieces)
    if isinstance(block, Aligned):
        rows = [f"{name} {text}" for name, text in block.rows]
        return "\n".join([block.title, *rows])
    return str(block)


def _text(pieces: Sequence[Piece]) -> str:
    """Text of pieces, each of which is a text or a pair (text, style)."""
    texts: list[str] = []
    for piece in pieces:
        if isinstance(piece, str):
            texts.append(piece)
        else:
            text, _ = piece
            texts.append(text)
    return "".join(texts)


def _lines(block: Block) -> list[str]:
    """Lines of a block's text, without blank ones."""
    lines = [line.strip() for line in plain(block).splitlines()]
    return [line for line in lines if line]


def _cell(column: Column, value: Any) -> str | float | None:
    """Number of a cell if it has one, otherwise its text; None for a missing number."""
    if isinstance(value, float | int | np.number):
        return _number(value)
    cell = column.show(value)
    if isinstance(cell, Bar):
        if cell.text.strip():
            return _number(cell.share)
        return ""
    text = " ".join(plain(cell).split())
    if isinstance(cell, Line) and cell.value is not None and text:
        return _number(cell.value)
    if not column.words and text in ("", MISSING):
        return None
    return text


def _number(value: float | np.number[Any]) -> float | None:
    """Number as JSON can hold it; None for nan and infinity."""
    if isinstance(value, int | np.integer):
        return int(value)
    if math.isfinite(value):
        return float(value)
    return None
