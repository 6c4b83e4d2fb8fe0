"""Tables of all commands: words at the left, numbers at the right."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from ..core.numbers import MISSING, number, percent_of_limit
from ..core.verdict import Word
from ..model.limits import over_limit
from ..model.model import Model

_NEAR = 0.8
"""Share of a limit from which it is coloured."""
_ANY = 10_000
"""Width in characters that no table reaches."""
_LEAST = 8
"""Fewest characters of a word that stay together when names are folded."""


class PlainTable(Table):
    """Table with a single rule below its heads; text is not interpreted as markup. The title stays on one line."""

    def __init__(self, title: str = "", style: str = "bold") -> None:
        heading = Text(title, style=style, no_wrap=True, overflow="ignore") if title else None
        super().__init__(box=SIMPLE_HEAD, title=heading, title_justify="left", pad_edge=False)
        self._whole: list[bool] = []
        """True for columns whose cells are never broken. Rich's own option for this takes all width from other columns."""
        self._folding: list[list[Text]] = []
        """Cells of each column that may be folded."""

    def words(self, *heads: str, fold: bool = True, style: str = "") -> None:
        """Add columns of words, folded in narrow tables if ``fold``."""
        for head in heads:
            self.add_column(Text(head), overflow="fold", style=style)
            self._whole.append(not fold)
            self._folding.append([])

    def numbers(self, *heads: str, min_width: int | None = None) -> None:
        """Add columns of numbers, which are never cut; those with a width may break between numbers."""
        for head in heads:
            least = max(map(cell_len, head.split()), default=0) if min_width is None else min_width
            self.add_column(Text(head), justify="right", min_width=least)
            self._whole.append(min_width is None)
            self._folding.append([])

    def row(self, *cells: Any, style: str = "") -> None:
        """Add a row: words unchanged, numbers by :func:`~twistwrench.core.numbers.number`, integers in full."""
        texts = [_cell(cell) for cell in cells]
        for column, whole, folding, text in zip(self.columns, self._whole, self._folding, texts, strict=False):
            text.no_wrap = whole or None
            if column.justify == "left" and not whole:
                folding.append(text)
            needs = [cell_len(text.plain)] if whole else [min(cell_len(part), _LEAST) for part in text.plain.split()]
            column.min_width = max([column.min_width or 0, *needs])
        self.add_row(*texts, style=style)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the table; in narrow consoles with less padding and with names folded at their separators."""
        for padding in (self.padding, (0, 0)):
            self.padding = padding
            excess = Measurement.get(console, options.update(max_width=_ANY), self).maximum - options.max_width
            if excess <= 0:
                break
            for texts in filter(None, self._folding):
                longest = max(cell_len(line) for text in texts for line in text.plain.splitlines() or [""])
                least = max(cell_len(part) for text in texts for part in _parts(text.plain))
                width = max(least, longest - excess)
                for text in texts:
                    text.plain = _folded(text.plain, width)
                excess -= max(longest - width, 0)
        yield from super().__rich_console__(console, options)


def _parts(name: str) -> list[str]:
    """Parts of a name that stay together, with the separator that ends each."""
    return re.findall(r"[^_\-./\s]*[_\-./]|[^_\-./\s]+", name) or [""]


def _folded(name: str, width: int) -> str:
    """Break a name between its parts into lines of at most that width."""
    if cell_len(name) <= width or " " in name:
        return name
    lines = [""]
    for part in _parts(name):
        if lines[-1] and cell_len(lines[-1] + part) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)


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
    """Words of a heading on the friction of torques."""
    if not counted:
        return "without friction"
    return "with friction" if model.friction.any else "no friction, as its file gives none"


def remarks(sentences: Iterable[str]) -> list[Text]:
    """Format each sentence as a line."""
    return [Text.assemble(("! ", "yellow"), sentence) for sentence in sentences]
