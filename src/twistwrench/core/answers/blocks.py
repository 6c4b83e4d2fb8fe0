"""Blocks of an answer: headline, lines, remarks, tables, bars and trees, independent of the surface that shows them.

:mod:`.terminal` writes them as text, :mod:`.page` as a page, :mod:`.card` as the card of a notebook, :mod:`.data` as JSON.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from textwrap import wrap
from typing import Any, TypeAlias

import numpy as np

from ..colours import NEAR_LIMIT, Style, word_style
from ..numbers import MISSING, number, over_limit, percent_of_limit
from ..text import ReadingNote, text_width
from ..verdict import Verdict, Word


class Level(IntEnum):
    """Level of a block, which decides where it is shown."""

    SHORT = 0
    """Shown on all surfaces, also in the short form."""
    ALL = 1
    """Shown on pages, and in the terminal with ``--all``."""
    PAGE = 2
    """Shown only on pages."""


Piece: TypeAlias = str | tuple[str, str]
"""Text, or (text, style)."""


class Line:
    """Text in pieces, each with an optional style: ``Line(("OK", strong(Style.GOOD)), ": no limit is passed.")``.

    ``value`` is the number with all digits, if the line is a cell with a number. ``indent`` is a number of blanks. A ``whole``
    line, such as a command to copy, is never broken.
    """

    def __init__(
        self,
        *pieces: Piece,
        indent: int = 0,
        value: float | None = None,
        whole: bool = False,
        level: Level = Level.SHORT,
    ) -> None:
        self.pieces = list(pieces)
        self.indent = indent
        self.value = value
        self.whole = whole
        self.level = level


@dataclass(frozen=True)
class Headline:
    """First lines of an answer with a verdict: its word in colour, and its reasons as sentences."""

    word: Word
    sentence: str = ""
    """First reason, or the result; it ends with a full stop."""
    at: str = ""
    """Text between the word and the sentence, with a time: ``STOPPED at t = 1.15 s: …``."""
    reasons: Sequence[str] = ()
    """Reasons after the first, each in a line of its own."""
    further: Sequence[Line] = ()
    """Lines with other results that belong to the verdict: largest payload, least distance, questions to the user."""
    whole: bool = False
    """True if the text is never broken into lines, for instance because it contains a path."""
    level: Level = Level.SHORT

    @classmethod
    def from_verdict(cls, verdict: Verdict, *, further: Sequence[Line] = ()) -> Headline:
        """Headline with all reasons of a verdict."""
        sentences = [f"{reason.removesuffix('.')}." for reason in verdict.reasons if reason]  # each with one full stop
        first_sentence = sentences[0] if sentences else ""
        return cls(verdict.word, first_sentence, reasons=sentences[1:], further=further)

    @property
    def pieces(self) -> list[Piece]:
        """Text with its styles."""
        text_after_word = self.at
        if self.sentence:
            text_after_word = f"{self.at}: {self.sentence}"
        pieces: list[Piece] = [(str(self.word), word_style(self.word)), text_after_word]
        pieces += [f"\n  - {reason}" for reason in self.reasons]
        for line in self.further:
            pieces += ["\n", *line.pieces]
        return pieces


@dataclass(frozen=True)
class Remark:
    """A doubt or a note: one sentence, and its remedy."""

    sentence: str
    do: str = ""
    """Remedy, printed before the sentence; empty if there is none."""
    reading: bool = False
    """True for a note on how a file was read."""
    level: Level = Level.SHORT

    @property
    def words(self) -> str:
        """Remedy and sentence as one text."""
        if self.do:
            return f"{self.do}: {self.sentence}"
        return self.sentence

    @property
    def pieces(self) -> list[Piece]:
        """Text with its styles."""
        return [("! ", Style.NEAR), self.words]


@dataclass(frozen=True)
class Bar:
    """Cell of a table: a share of a limit as a bar, with a text beside it."""

    share: float
    """Value divided by its limit."""
    text: str = ""
    """Text beside the bar; empty for none."""

    @property
    def pieces(self) -> list[Piece]:
        """Bar of :data:`_BAR_WIDTH` characters and the text, in the colour of the share."""
        filled_width = min(_BAR_WIDTH, round(self.share * _BAR_WIDTH))
        filled_part = ("━" * filled_width, self.style)
        empty_part = ("─" * (_BAR_WIDTH - filled_width), Style.QUIET)
        return [filled_part, empty_part, *self.label]

    @property
    def label(self) -> list[Piece]:
        """The text in the colour of the share; no piece without a text."""
        if self.text:
            return [(self.text, self.style)]
        return []

    @property
    def style(self) -> Style:
        """Colour of the share."""
        return limit_style(self.share)


_BAR_WIDTH = 12
"""Width of a bar in characters."""


@dataclass(frozen=True)
class Glyphs:
    """Characters that draw something in a cell; pages and data leave them out."""

    text: str
    style: str = ""

    @property
    def pieces(self) -> list[Piece]:
        """Text with its style."""
        return [(self.text, self.style)]


Cell: TypeAlias = str | Line | Bar | Glyphs
"""Content of a cell of a table."""


def cell_text(value: Any) -> Cell:
    """Content of a cell: texts unchanged, integers with all digits, other numbers rounded."""
    if isinstance(value, str | Line | Bar | Glyphs):
        return value
    if isinstance(value, int | np.integer):
        return str(value)
    return number(value)


@dataclass(frozen=True, eq=False)
class Column:
    """Column of a table: name, unit, values, and the format of a value."""

    name: str
    values: Sequence[Any]
    show: Callable[[Any], Cell] = cell_text
    unit: str = ""
    """Unit of the values, or a text with all units if rows have different ones; empty for numbers without a unit."""
    headed: bool = True
    """True if the head shows the unit; False if the unit is in the title or in another column."""
    limits: Sequence[float] | None = None
    """Limit of each row, shown behind its value."""
    words: bool = False
    """True for words, which are aligned to the left; numbers are aligned to the right."""
    whole: bool = True
    """True if cells are never broken into lines."""
    min_width: int | None = None
    """Least width of the column in characters, if cells may be broken."""
    style: str = ""
    narrow: Column | None = None
    """Column that narrow terminals show instead."""
    wide_only: bool = False
    """True if narrow terminals leave the column out."""

    @property
    def head(self) -> str:
        """Name with the unit."""
        if self.unit and self.headed:
            return f"{self.name} [{self.unit}]"
        return self.name


def words(
    name: str, values: Iterable[Any], *, fold: bool = True, style: str = "", narrow: Column | None = None
) -> Column:
    """A column of words; if ``fold``, narrow terminals break its cells into lines."""
    return Column(name, list(values), words=True, whole=not fold, style=style, narrow=narrow)


def numbers(
    name: str,
    values: Iterable[Any],
    show: Callable[[Any], Cell] = cell_text,
    unit: str = "",
    *,
    headed: bool = True,
    limits: Sequence[float] | None = None,
    min_width: int | None = None,
    wide_only: bool = False,
) -> Column:
    """A column of numbers. If ``min_width`` is given, cells with several numbers may be broken between them."""
    whole = min_width is None
    return Column(
        name,
        list(values),
        show,
        unit,
        headed=headed,
        limits=limits,
        whole=whole,
        min_width=min_width,
        wide_only=wide_only,
    )


class Table:
    """Columns of equal length below a title; columns that are None are left out. Each row may have a style.

    The short form shows at most ``most`` rows: those with the largest values in ``by``, which has a value for each row. They
    keep their order, and a last row counts the others. If ``of_limits``, the values in ``by`` are shares of limits.
    ``style`` is the style of the title, and ``styles`` has a style for each row. ``detail`` follows the title, such as
    ", by the robot alone", and then the ``unit`` of all values.
    """

    def __init__(
        self,
        title: str,
        *columns: Column | None,
        detail: str = "",
        unit: str = "",
        styles: Iterable[str] | None = None,
        style: str = Style.STRONG,
        level: Level = Level.SHORT,
        most: int | None = None,
        by: Sequence[float] | None = None,
        of_limits: bool = True,
    ) -> None:
        self.title = title
        self.detail = detail
        self.unit = unit
        self.style = style
        self.level = level
        self.columns = [column for column in columns if column is not None]
        self.styles = [""] * len(self.columns[0].values)
        if styles is not None:
            self.styles = list(styles)
        self.most = most
        self.by = by
        self.of_limits = of_limits

    @property
    def heading(self) -> str:
        """Title, detail and unit, as surfaces show them."""
        unit = ""
        if self.unit:
            unit = f" [{self.unit}]"
        return f"{self.title}{self.detail}{unit}"


@dataclass(frozen=True, eq=False)
class Branch:
    """A tree of lines."""

    label: Line
    branches: list[Branch] = field(default_factory=list)
    level: Level = Level.SHORT

    def add(self, label: Line) -> Branch:
        """Add a branch and return it."""
        branch = Branch(label)
        self.branches.append(branch)
        return branch


@dataclass(frozen=True)
class More:
    """Last line of a shortened answer. The surface adds how to see the full answer."""

    sentence: str
    """Content of the full form, such as "All 20 findings with lines"."""
    level: Level = Level.SHORT

    @property
    def pieces(self) -> list[Piece]:
        """Text with its styles."""
        return [(self.sentence, Style.QUIET)]


@dataclass(frozen=True, eq=False)
class Aligned:
    """Rows of two texts below a title, such as symbols and their meanings. All second texts begin at the same column."""

    title: str
    rows: Sequence[tuple[str, str]]
    fold: Callable[[str, int], Sequence[str]]
    """Function that breaks a text into lines of at most a width."""
    gap: str = " "
    """Text between the two texts of a row."""
    level: Level = Level.SHORT

    def title_lines(self, width: int) -> list[str]:
        """Title in lines of at most a width."""
        return wrap(self.title, width)

    def lines(self, width: int) -> list[str]:
        """Lines of the rows, indented, without trailing blanks."""
        indent = "  "
        name_width = max((text_width(name) for name, _ in self.rows), default=0)
        width_of_texts = width - len(indent) - name_width - len(self.gap)
        lines: list[str] = []
        for name, text in self.rows:
            first_name = name + " " * (name_width - text_width(name))
            next_name = " " * name_width  # only the first line of a row has the name
            text_lines = self.fold(text, width_of_texts) or [""]  # an empty text has a line for its name
            padded_name = first_name
            for line in text_lines:
                lines.append(f"{indent}{padded_name}{self.gap}{line}".rstrip())
                padded_name = next_name
        return lines


Block: TypeAlias = str | Headline | Line | Remark | Table | Branch | More | Aligned
"""A part of an answer; an empty text is a blank line."""


def remarks(sentences: Iterable[str]) -> list[Remark]:
    """One remark for each sentence; notes on how a file was read come last."""
    unsorted_remarks = [Remark(str(sentence), reading=isinstance(sentence, ReadingNote)) for sentence in sentences]
    return sorted(unsorted_remarks, key=lambda remark: remark.reading)  # stable: False before True


def word_cell(word: str) -> Line:
    """Word of a verdict in its colour, as a cell."""
    return Line((word, word_style(word)))


def limit_style(share: float) -> Style:
    """Style of a share of a limit: over the limit, near it, or good."""
    if over_limit(share):
        return Style.OVER
    if share > NEAR_LIMIT:
        return Style.NEAR
    return Style.GOOD


def mark_style(share: float) -> Style:
    """Style of the name of a joint in a sentence: a colour only near or over its limit.

    ``share`` is the joint's share of the limit, nan without a limit.
    """
    style = limit_style(share)
    if style is Style.GOOD or math.isnan(share):
        return Style.POINTED
    return style


def share_cell(share: float) -> str | Line:
    """Cell with a share of a limit, in its colour; a dash if the share is not finite, as without a limit."""
    if not math.isfinite(share):
        return MISSING
    return Line((percent_of_limit(share), limit_style(share)), value=share)
