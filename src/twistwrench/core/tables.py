"""CSV and HTML tables: standard CSV quoting, numbers with all digits, and cells that spreadsheets do not execute.

Spreadsheets read text that begins with =, +, -, @, a tab or a line end as a formula. Such text gets a leading apostrophe, by
which spreadsheets mark text. Programs that read a file line by line lose line ends within names, and blanks at their ends.
Such names are written as JSON strings, with quotes. :func:`unescape_cell` reverses both. Numbers are unchanged.
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
"""Number of rows that are written at once."""
_FORMULA_TEXT = re.compile(r"'*[=+\-@\t\r\n＝＋－＠]")
"""Beginning of a text that a spreadsheet reads as a formula, or would read so without the leading apostrophes."""

_UNREADABLE_TEXT = re.compile(r'[\r\n]|^\s|\s$|^".*"$')
"""Text with line ends or outer blanks, or with the quotes of a JSON string."""


def harmless_text(text: str) -> str:
    """Single-line text that no spreadsheet reads as a formula; :func:`unescape_cell` restores the original."""
    if _UNREADABLE_TEXT.search(text):
        return json.dumps(text, ensure_ascii=False)
    if _FORMULA_TEXT.match(text):
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
    if cell.startswith("'") and _FORMULA_TEXT.match(cell):
        return cell[1:]
    return cell


@dataclass(frozen=True, eq=False)
class CsvWriter:
    """Writer of rows to a CSV file opened in binary mode; lines end in a newline."""

    file: BinaryIO

    def row(self, cells: Iterable[str | float | None]) -> None:
        """Add one row; numbers have the digits that reproduce them exactly, None is an empty cell."""
        buffer = io.StringIO()
        # The csv module quotes cells with "\r" only if its own lines end with it.
        csv.writer(buffer, lineterminator="\r\n").writerow(map(_cell_text, cells))
        line = buffer.getvalue().removesuffix("\r\n")
        self.file.write(f"{line}\n".encode())

    def numbers(self, rows: Array) -> None:
        """Add rows (n, columns) of numbers, with the digits that reproduce them exactly."""
        # The csv module would take twice as long. Numbers need no quotes, and repr gives the shortest exact decimal.
        for begin in range(0, len(rows), _ROWS_PER_BLOCK):  # in blocks: text takes ten times the memory of the numbers
            block = rows[begin : begin + _ROWS_PER_BLOCK].tolist()
            lines = [",".join(map(repr, row)) + "\n" for row in block]
            self.file.write("".join(lines).encode("ascii"))


def _cell_text(cell: str | float | None) -> str:
    """Text of a cell before CSV quoting."""
    if cell is None:
        return ""
    if isinstance(cell, str):
        return harmless_text(cell)
    return repr(float(cell))


@contextmanager
def csv_table(path: str | Path, header: Iterable[str]) -> Iterator[CsvWriter]:
    """Writer of a CSV file with that header; the file replaces an existing one once it is complete."""
    with replacing(path) as temporary_path, temporary_path.open("wb") as file:
        writer = CsvWriter(file)
        writer.row(header)
        yield writer


# ── Tables for notebooks: ``_repr_html_`` of robots and reports


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Table with an optional title. Numbers have four digits, None is a dash, and texts are escaped.

    Columns with a text are aligned at the left.

    >>> html_table("a < b", ["x"], [[0.123456], [None]])
    '<p>a &lt; b</p><table><thead><tr><th>x</th></tr></thead><tbody><tr><td>0.1235</td></tr><tr><td>–</td></tr></tbody></table>'
    """
    import html

    all_rows = [list(row) for row in rows]
    column_styles = [""] * len(header)
    for row in all_rows:
        for k, value in enumerate(row):
            if isinstance(value, str):
                column_styles[k] = ' style="text-align: left"'

    def table_row(tag: str, texts: Iterable[str]) -> str:
        """Row of cells with a tag: ``th`` for the header, otherwise ``td``."""
        cells = [f"<{tag}{style}>{html.escape(text)}</{tag}>" for style, text in zip(column_styles, texts, strict=True)]
        return f"<tr>{''.join(cells)}</tr>"

    head = table_row("th", header)
    body = "".join(table_row("td", map(_display_text, row)) for row in all_rows)
    caption = f"<p>{html.escape(title)}</p>" if title else ""
    return f"{caption}<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _display_text(value: Any) -> str:
    """Text of a cell of an HTML table, not escaped."""
    if value is None or isinstance(value, float):
        return number(value)
    return str(value)


def data_frame(columns: Mapping[str, Any]) -> Any:
    """pandas.DataFrame of columns; raises :class:`~twistwrench.MissingExtraError` if pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise MissingExtraError.from_extra("pandas", "tables", "Making a DataFrame") from None
    return pandas.DataFrame(columns)
