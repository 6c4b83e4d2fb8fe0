"""Write the tables of docs/coming-from.md from the table of first calls: `python docs/first_calls.py`."""

from __future__ import annotations

import re
from pathlib import Path

from twistwrench.core.first_calls import FirstCall, first_calls

PAGE = Path(__file__).with_name("coming-from.md")
_TABLE = re.compile(r"(<!-- first calls: (.+?) -->\n).*?(<!-- end -->\n)", re.DOTALL)


def page(text: str) -> str:
    """The page with its tables as they have to be."""
    return _TABLE.sub(lambda found: f"{found[1]}{_table(found[2])}{found[3]}", text)


def _table(library: str) -> str:
    rows = [row for row in first_calls() if row.of == library]
    assert rows, f"no row of {library}"
    cells = [(library, "here", "what differs"), ("---",) * 3, *map(_cells, rows)]
    return (
        "\n" + "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in cells) + "\n"
    )


def _cells(row: FirstCall) -> tuple[str, str, str]:
    names = ", ".join(f"`{word}`" for word in row.words)
    is_code = "`" not in row.use and ("page" not in row.where or "tw." in row.use)
    return row.shown or names, f"`{row.use}`" if is_code else row.use, row.differs


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
