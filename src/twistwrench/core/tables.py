"""CSV and HTML tables: standard CSV quoting, numbers with all digits, and cells that spreadsheets do not execute.

Spreadsheets read text that begins with =, +, -, @, a tab or a line end as a formula. Such text gets a leading apostrophe, the
spreadsheets' own text mark. Names with line ends or outer blanks, which line-based readers lose, are written as JSON
strings, with quotes. :func:`unescape_cell` reverses both. Numbers are unchanged.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from .errors import MissingExtraError
from .files import replacing
from .numbers import number
from .typing import Array

_ROWS_PER_BLOCK = 4096
_FORMULA = re.compile(r"'*[=+\-@\t\r\n＝＋－＠]")
"""Text that a spreadsheet reads as a formula, or would without its leading apostrophes."""

_UNREADABLE = re.compile(r'[\r\n]|^\s|\s$|^".*"$')
"""Text that a line-based reader loses or truncates, or that would be read as a JSON string."""


def harmless_text(text: str) -> str:
    """Single-line text that no spreadsheet reads as a formula; :func:`unescape_cell` restores the original."""
    if _UNREADABLE.search(text):
        return json.dumps(text, ensure_ascii=False)
    if _FORMULA.match(text):
        return f"'{text}"
    return text


def unescape_cell(cell: str) -> str:
    r"""Original text of a cell from :func:`harmless_text`; other cells are unchanged.

    >>> unescape_cell("'=1+1"), unescape_cell("elbow"), unescape_cell("-x"), unescape_cell('"two\\nlines"')
    ('=1+1', 'elbow', '-x', 'two\nlines')
    """
    if len(cell) > 1 and cell[0] == cell[-1] == '"':
        with suppress(ValueError):
            return str(json.loads(cell))
    if cell.startswith("'") and _FORMULA.match(cell):
        return cell[1:]
    return cell


@dataclass(frozen=True, eq=False)
class CsvWriter:
    """Writer of rows to a CSV file opened in binary mode; lines end in a newline."""

    file: BinaryIO

    def row(self, cells: Iterable[str | float | None]) -> None:
        """Add one row; numbers have the digits that reproduce them exactly, None is an empty cell."""
        line = io.StringIO()
        csv.writer(line, lineterminator="\r\n").writerow(
            map(_cell_text, cells)
        )  # "\r" is quoted only if it may end lines
        self.file.write((line.getvalue().removesuffix("\r\n") + "\n").encode())

    def numbers(self, rows: Array) -> None:
        """Add rows (n, columns) of numbers, with the digits that reproduce them exactly."""
        # Numbers need no quotes, and repr gives the shortest exact decimal; the csv module takes twice as long.
        for k in range(0, len(rows), _ROWS_PER_BLOCK):  # text takes ten times the memory of the numbers
            lines = [",".join(map(repr, row)) for row in rows[k : k + _ROWS_PER_BLOCK].tolist()]
            self.file.write(("\n".join(lines) + "\n").encode("ascii"))


def _cell_text(cell: str | float | None) -> str:
    if cell is None:
        return ""
    if isinstance(cell, str):
        return harmless_text(cell)
    return repr(float(cell))


@contextmanager
def csv_table(path: str | Path, header: Iterable[str]) -> Iterator[CsvWriter]:
    """Writer of a CSV file with that header; the file replaces an existing one once it is complete."""
    with replacing(path) as scratch, scratch.open("wb") as file:
        writer = CsvWriter(file)
        writer.row(header)
        yield writer


# ── Tables for notebooks: ``_repr_html_`` of robots and reports


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Table with an optional title: numbers in four digits, None as a dash, all else escaped, text columns left-aligned.

    >>> html_table("a < b", ["x"], [[0.123456], [None]])
    '<p>a &lt; b</p><table><thead><tr><th>x</th></tr></thead><tbody><tr><td>0.1235</td></tr><tr><td>–</td></tr></tbody></table>'
    """
    import html

    def table_row(tag: str, texts: Iterable[str]) -> str:
        cells = [f"<{tag}{style}>{html.escape(text)}</{tag}>" for style, text in zip(styles, texts, strict=True)]
        return f"<tr>{''.join(cells)}</tr>"

    cells = [list(row) for row in rows]
    styles = [""] * len(header)
    for row in cells:
        for k, value in enumerate(row):
            if isinstance(value, str):
                styles[k] = ' style="text-align: left"'
    head = table_row("th", header)
    body = "".join(table_row("td", map(_display_text, row)) for row in cells)
    caption = f"<p>{html.escape(title)}</p>" if title else ""
    return f"{caption}<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _display_text(value: Any) -> str:
    if value is None or isinstance(value, float):
        return number(value)
    return str(value)


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Data frame of columns; raises :class:`~twistwrench.MissingExtraError` if pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise MissingExtraError.from_extra("pandas", "tables", "Making a DataFrame") from None
    return pandas.DataFrame(columns)
