"""One style of tables."""

from __future__ import annotations

from rich.text import Text


def title_line(text: str, style: str = "bold") -> Text:
    """The title of a table, which stays on one line where the table is narrower than it."""
    return Text(text, style=style, no_wrap=True, overflow="ignore")
