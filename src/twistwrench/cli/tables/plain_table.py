"""The one writer of tables: words at the left, numbers at the right, one look for all commands."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from ...core.printed_numbers import MISSING, number, percent_of_limit
from ...model.limits import over_limit
from ...model.model import Model
from ...verdict import Word

_NEAR = 0.8
"""Share of a limit from which it is worth a colour."""
_LEAST = 8
"""Characters of a word that stay together in any case: names fold where there is no room."""


class PlainTable(Table):
    """A table without lines but that under the heads. No text in it is taken for markup.

    Parameters
    ----------
    title : str, on one line also where the table is narrower
    style : str, of the title
    """

    def __init__(self, title: str = "", style: str = "bold") -> None:
        heading = Text(title, style=style, no_wrap=True, overflow="ignore") if title else None
        super().__init__(box=SIMPLE_HEAD, title=heading, title_justify="left", pad_edge=False)
        self._whole: list[bool] = []
        """By column, whether its cells are never broken. Rich's own option for this takes all room from other columns."""

    def words(self, *heads: str, fold: bool = True, style: str = "") -> None:
        """Columns of words, which fold where there is no room unless told not to."""
        for head in heads:
            self.add_column(Text(head), overflow="fold", style=style)
            self._whole.append(not fold)

    def numbers(self, *heads: str, min_width: int | None = None) -> None:
        """Columns of numbers, which are never cut; those with a width may break between numbers."""
        for head in heads:
            self.add_column(Text(head), justify="right", min_width=min_width)
            self._whole.append(min_width is None)

    def row(self, *cells: Any, style: str = "") -> None:
        """Words as they are, numbers as :func:`~twistwrench.core.printed_numbers.number` has them, whole ones in full."""
        texts = [_cell(cell) for cell in cells]
        for column, whole, text in zip(self.columns, self._whole, texts, strict=False):
            text.no_wrap = whole or None
            needs = [cell_len(text.plain)] if whole else [min(cell_len(part), _LEAST) for part in text.plain.split()]
            column.min_width = max([column.min_width or 0, *needs])
        self.add_row(*texts, style=style)


def _cell(value: Any) -> Text:
    if isinstance(value, Text):
        return value
    return Text(
        value if isinstance(value, str) else str(value) if isinstance(value, int | np.integer) else number(value)
    )


def verdict_word(word: str) -> Text:
    """The word of a verdict in its colour."""
    colours: dict[str, str] = {Word.OK: "bold green", Word.UNSURE: "bold yellow"}
    return Text(word, colours.get(word, "bold red"))


def limit_style(share: float) -> str:
    """The colour of a share of a limit: red beyond it, yellow near it."""
    return "red" if over_limit(share) else "yellow" if share > _NEAR else "green"


def share_bar(share: float, length: int = 12) -> Text:
    """A share of a limit as a bar of that many characters, in its colour."""
    filled = min(length, round(share * length))
    return Text.assemble(("━" * filled, limit_style(share)), ("─" * (length - filled), "dim"))


def share_cell(share: float) -> Text:
    """A share of a limit, in its colour; a dash where there is no limit."""
    text = percent_of_limit(share)
    return Text(text, style="" if text == MISSING else limit_style(share))


def friction_words(model: Model, *, counted: bool) -> str:
    """Part of a heading: whether the torques count friction."""
    if not counted:
        return "without friction"
    return "with friction" if model.friction.any else "no friction, as its file gives none"


def remarks(sentences: Iterable[str]) -> list[Text]:
    """A line each."""
    return [Text.assemble(("! ", "yellow"), sentence) for sentence in sentences]
