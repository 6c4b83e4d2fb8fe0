"""A report is blocks: lines of text, tables of quantities, and trees, described once, whatever writes them.

The terminal's writer is :mod:`twistwrench.cli.terminal`; another one needs nothing but these classes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from ..core.numbers import MISSING, number, percent_of_limit
from ..core.verdict import Word
from ..model.limits import over_limit

Piece: TypeAlias = str | tuple[str, str]
"""Text, or text with its style."""


class Line:
    """Text in pieces, of which some have a style: ``Line(("OK", "bold green"), ": no limit is passed.")``."""

    def __init__(self, *pieces: Piece, indent: int = 0) -> None:
        self.pieces, self.indent = list(pieces), indent


def shown(value: Any) -> str | Line:
    """Words unchanged, integers in full, numbers as a person reads them."""
    if isinstance(value, str | Line):
        return value
    return str(value) if isinstance(value, int | np.integer) else number(value)


@dataclass(frozen=True, eq=False)
class Column:
    """Quantity of all rows, once: name and unit, values, and the format of one of them."""

    name: str
    values: Sequence[Any]
    show: Callable[[Any], str | Line] = shown
    unit: str = ""
    words: bool = False
    """True for words, which stand at the left; numbers stand at the right."""
    whole: bool = True
    """True if no cell is ever broken into lines."""
    min_width: int | None = None
    style: str = ""
    narrow: Column | None = None
    """The column in its place where there is little room."""

    @property
    def head(self) -> str:
        """Name with the unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def words(
    name: str, values: Iterable[Any], *, fold: bool = True, style: str = "", narrow: Column | None = None
) -> Column:
    """A column of words, folded where there is little room if ``fold``."""
    return Column(name, list(values), words=True, whole=not fold, style=style, narrow=narrow)


def numbers(
    name: str,
    values: Iterable[Any],
    show: Callable[[Any], str | Line] = shown,
    unit: str = "",
    *,
    min_width: int | None = None,
) -> Column:
    """A column of numbers, which are never cut; cells of several, of a least width, may break between them."""
    return Column(name, list(values), show, unit, whole=min_width is None, min_width=min_width)


class Table:
    """Columns of equal length below a title; columns that are None are left out. Each row may have a style."""

    def __init__(
        self, title: str, *columns: Column | None, styles: Iterable[str] | None = None, style: str = "bold"
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

_NEAR, _BAR = 0.8, 12
"""Share of a limit from which it is coloured, and characters of a bar."""


def verdict(word: str, *pieces: Piece) -> Line:
    """The word of a verdict in its colour, and what follows it."""
    colours: dict[str, str] = {Word.OK: "bold green", Word.UNSURE: "bold yellow"}
    return Line((word, colours.get(word, "bold red")), *pieces)


def remarks(sentences: Iterable[str]) -> list[Line]:
    """A line for each sentence."""
    return [Line(("! ", "yellow"), sentence) for sentence in sentences]


def limit_style(share: float) -> str:
    """The colour of a share of a limit: red beyond it, yellow near it."""
    return "red" if over_limit(share) else "yellow" if share > _NEAR else "green"


def share_bar(share: float, text: str = "") -> Line:
    """A share of a limit as a bar of twelve characters and a text, in its colour."""
    filled = min(_BAR, round(share * _BAR))
    return Line(("━" * filled, limit_style(share)), ("─" * (_BAR - filled), "dim"), (text, limit_style(share)))


def share_cell(share: float) -> str | Line:
    """A share of a limit, in its colour; a dash where there is no limit."""
    return Line((percent_of_limit(share), limit_style(share))) if math.isfinite(share) else MISSING
