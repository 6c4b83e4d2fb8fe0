"""CSV and HTML tables: quoting of the standard library, numbers with all digits, no cell that a spreadsheet would run.

A spreadsheet reads text that begins with =, +, -, @, a tab or a line end as a formula. Such text gets an apostrophe before
it, as spreadsheets themselves mark text. A name with line ends or outer blanks, which readers of lines lose, is written as
a string of JSON, in its quotes. :func:`unescape_cell` undoes both. Numbers are unchanged.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from ..typing import Array
from .files import replacing
from .numbers import number

_PORTION = 4096
_RUN = re.compile(r"'*[=+\-@\t\r\n＝＋－＠]")
"""Text that a spreadsheet would run, or would without the apostrophes before it."""

_LOST = re.compile(r'[\r\n]|^\s|\s$|^".*"$')
"""Text that a reader of lines would lose or cut, or would read as a string of JSON."""


def harmless_text(text: str) -> str:
    """Text of one line that no spreadsheet reads as a formula; :func:`unescape_cell` restores the text."""
    if _LOST.search(text):
        return json.dumps(text, ensure_ascii=False)
    return f"'{text}" if _RUN.match(text) else text


def unescape_cell(cell: str) -> str:
    r"""The text of a cell of :func:`harmless_text`; any other cell unchanged.

    >>> unescape_cell("'=1+1"), unescape_cell("elbow"), unescape_cell("-x"), unescape_cell('"two\\nlines"')
    ('=1+1', 'elbow', '-x', 'two\nlines')
    """
    if len(cell) > 1 and cell[0] == cell[-1] == '"':
        with suppress(ValueError):
            return str(json.loads(cell))
    return cell[1:] if cell.startswith("'") and _RUN.match(cell) else cell


@dataclass(frozen=True, eq=False)
class CsvWriter:
    """Writer of rows to a CSV file that is open for bytes; lines end in a newline."""

    file: BinaryIO

    def row(self, cells: Iterable[str | float | None]) -> None:
        """Add one row; numbers with the digits that give them back exactly, None as an empty cell."""
        line = io.StringIO()
        texts = [harmless_text(c) if isinstance(c, str) else "" if c is None else repr(float(c)) for c in cells]
        csv.writer(line, lineterminator="\r\n").writerow(texts)  # a return in a name is quoted only if it may end lines
        self.file.write((line.getvalue().removesuffix("\r\n") + "\n").encode())

    def numbers(self, rows: Array) -> None:
        """Add rows (n, columns) of numbers, each with the digits that give it back exactly."""
        # A number needs no quotes, and its repr is its shortest exact decimal; the writer of the library is half as fast.
        for k in range(0, len(rows), _PORTION):  # a number takes ten times its memory while it is text
            lines = [",".join(map(repr, row)) for row in rows[k : k + _PORTION].tolist()]
            self.file.write(("\n".join(lines) + "\n").encode("ascii"))


@contextmanager
def csv_table(path: str | Path, header: Iterable[str]) -> Iterator[CsvWriter]:
    """Writer of a CSV file that begins with that header, and replaces what is there once it is complete."""
    with replacing(path) as scratch, scratch.open("wb") as file:
        writer = CsvWriter(file)
        writer.row(header)
        yield writer


# ── Tables for notebooks: ``_repr_html_`` of robots and reports


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table with a title, if it has rows; numbers in four digits, None as a dash, all else escaped, words to the left.

    >>> html_table("a < b", ["x"], [[0.123456], [None]])
    '<p>a &lt; b</p><table><thead><tr><th>x</th></tr></thead><tbody><tr><td>0.1235</td></tr><tr><td>–</td></tr></tbody></table>'
    """
    import html

    def text(value: Any) -> str:
        return number(value) if value is None or isinstance(value, float) else str(value)

    cells = [list(row) for row in rows]
    words = [any(isinstance(row[k], str) for row in cells) for k in range(len(header))]
    sides = [' style="text-align: left"' if word else "" for word in words]
    head = "".join(f"<th{side}>{html.escape(name)}</th>" for side, name in zip(sides, header, strict=True))
    body = "".join(
        f"<tr>{''.join(f'<td{s}>{html.escape(text(x))}</td>' for s, x in zip(sides, row, strict=True))}</tr>"
        for row in cells
    )
    above = f"<p>{html.escape(title)}</p>" if title else ""
    return f"{above}<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
