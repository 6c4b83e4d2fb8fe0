"""Blocks of a report: lines of text, tables of quantities, and trees, independent of the output format.

:mod:`twistwrench.cli.terminal` writes them to the terminal, :mod:`twistwrench.reports.page` to a page.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, TypeAlias

import numpy as np

from ..core.colours import NEAR_LIMIT, Style, word_style
from ..core.numbers import MISSING, number, percent_of_limit
from ..core.text import ReadingNote
from ..core.verdict import Word
from ..mechanics.model.limits import over_limit

Piece: TypeAlias = str | tuple[str, str]
"""Text, or text with its style."""


class Line:
    """Text in pieces, each with an optional style: ``Line(("OK", strong(Style.GOOD)), ": no limit is passed.")``.

    ``value`` is the number of a cell with all digits.
    """

    def __init__(self, *pieces: Piece, indent: int = 0, value: float | None = None) -> None:
        self.pieces, self.indent, self.value = list(pieces), indent, value


def shown(value: Any) -> str | Line:
    """Text of a cell: words unchanged, integers in full, other numbers rounded."""
    if isinstance(value, str | Line):
        return value
    return str(value) if isinstance(value, int | np.integer) else number(value)


@dataclass(frozen=True, eq=False)
class Column:
    """Column of a table: name, unit, values, and the format of a value."""

    name: str
    values: Sequence[Any]
    show: Callable[[Any], str | Line] = shown
    unit: str = ""
    """Unit of the values; all units if they differ by row. Shares are ratios without a unit."""
    headed: bool = True
    """False if the unit is in the title or in another column instead of the head."""
    limits: Sequence[float] | None = None
    """Limits shown behind the values."""
    words: bool = False
    """True for words, aligned left; numbers are aligned right."""
    whole: bool = True
    """True if cells are never broken into lines."""
    min_width: int | None = None
    style: str = ""
    narrow: Column | None = None
    """Column used instead in narrow terminals."""

    @property
    def head(self) -> str:
        """Name with the unit."""
        return f"{self.name} [{self.unit}]" if self.unit and self.headed else self.name


def words(
    name: str, values: Iterable[Any], *, fold: bool = True, style: str = "", narrow: Column | None = None
) -> Column:
    """A column of words, folded in narrow terminals if ``fold``."""
    return Column(name, list(values), words=True, whole=not fold, style=style, narrow=narrow)


def numbers(
    name: str,
    values: Iterable[Any],
    show: Callable[[Any], str | Line] = shown,
    unit: str = "",
    *,
    headed: bool = True,
    limits: Sequence[float] | None = None,
    min_width: int | None = None,
) -> Column:
    """A column of numbers, which are never cut; with ``min_width``, cells of several numbers may break between them."""
    whole = min_width is None
    return Column(name, list(values), show, unit, headed=headed, limits=limits, whole=whole, min_width=min_width)


class Table:
    """Columns of equal length below a title; columns that are None are left out. Each row may have a style."""

    def __init__(
        self, title: str, *columns: Column | None, styles: Iterable[str] | None = None, style: str = Style.STRONG
    ) -> None:
        self.title, self.style = title, style
        self.columns = [column for column in columns if column is not None]
        self.styles = [""] * len(self.columns[0].values) if styles is None else list(styles)


@dataclass(frozen=True, eq=False)
class Branch:
    """A tree of lines."""

    label: Line
    branches: list[Branch] = field(default_factory=list)

    def add(self, label: Line) -> Branch:
        """Add a branch and return it."""
        self.branches.append(Branch(label))
        return self.branches[-1]


Block: TypeAlias = str | Line | Table | Branch
"""A part of a report; an empty text is a blank line."""


# ── Verdicts, notes, and shares of limits

_BAR = 12
"""Width of a bar in characters."""


def verdict(word: str, *pieces: Piece) -> Line:
    """The word of a verdict in its colour, and the text after it."""
    return Line((word, word_style(word)), *pieces)


def remarks(sentences: Iterable[str]) -> list[Line]:
    """One line for each sentence; notes on how a file was read come last."""
    ordered = sorted(sentences, key=lambda sentence: isinstance(sentence, ReadingNote))
    return [Line(("! ", Style.NEAR), sentence) for sentence in ordered]


def limit_style(share: float) -> Style:
    """Style of a share of a limit: over, near, or good."""
    if over_limit(share):
        return Style.OVER
    return Style.NEAR if share > NEAR_LIMIT else Style.GOOD


def mark_style(share: float) -> Style:
    """Style of the joint that a sentence names, with its share of a limit (nan without one)."""
    style = limit_style(share)
    return Style.POINTED if style is Style.GOOD or math.isnan(share) else style


def share_bar(share: float, text: str = "") -> Line:
    """A share of a limit as a bar of twelve characters and a text, in its colour."""
    filled = min(_BAR, round(share * _BAR))
    style = limit_style(share)
    return Line(("━" * filled, style), ("─" * (_BAR - filled), Style.QUIET), (text, style), value=share)


def share_cell(share: float) -> str | Line:
    """A share of a limit, in its colour; a dash without a limit."""
    return Line((percent_of_limit(share), limit_style(share)), value=share) if math.isfinite(share) else MISSING


# ── Reports as data: the word of the verdict, sentences, and tables with all digits


def report_data(blocks: Sequence[Block]) -> dict[str, Any]:
    """Verdict (None without one), sentences, tables and notes of a report, for JSON."""
    texts = [block for block in blocks if not isinstance(block, Table)]
    words = (block.pieces[0][0] for block in texts if isinstance(block, Line) and isinstance(block.pieces[0], tuple))
    return {
        "verdict": next((word for word in words if word in tuple(Word)), None),
        "sentences": list(chain.from_iterable(map(_lines, (block for block in texts if not is_remark(block))))),
        "tables": [table_data(block) for block in blocks if isinstance(block, Table)],
        "notes": [plain(block).removeprefix("! ") for block in texts if is_remark(block)],
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


def plain(block: str | Line | Branch | Any) -> str:
    """The text of a line without styles."""
    if isinstance(block, Branch):
        return "\n".join(map(plain, (block.label, *block.branches)))
    if isinstance(block, Line):
        return "".join(piece if isinstance(piece, str) else piece[0] for piece in block.pieces)
    return str(block)


def is_remark(block: Block) -> bool:
    """True if the block is one of :func:`remarks`."""
    return isinstance(block, Line) and block.pieces[:1] == [("! ", Style.NEAR)]


def is_reading_note(block: Block) -> bool:
    """True if the block is the remark of a note on how a file was read."""
    return isinstance(block, Line) and is_remark(block) and isinstance(block.pieces[1], ReadingNote)


def is_bar(text: str) -> bool:
    """True for the terminal's bars, whose numbers are printed beside them, and for empty text."""
    return set(text) <= set("━─█·")


def _lines(block: Block) -> Iterator[str]:
    yield from (line.strip() for line in plain(block).splitlines() if line.strip())


def _cell(column: Column, value: Any) -> str | float | None:
    if isinstance(value, float | int | np.number):
        return _number(value)
    line = column.show(value)
    pieces = line.pieces if isinstance(line, Line) else [line]
    texts = (piece if isinstance(piece, str) else piece[0] for piece in pieces)
    text = " ".join("".join(piece for piece in texts if not is_bar(piece)).split())
    if isinstance(line, Line) and line.value is not None and text:
        return _number(line.value)
    return None if not column.words and text in ("", MISSING) else text


def _number(value: float | np.number[Any]) -> float | None:
    if isinstance(value, int | np.integer):
        return int(value)
    return float(value) if math.isfinite(value) else None
