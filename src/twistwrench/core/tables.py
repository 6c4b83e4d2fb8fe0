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

_PORTION = 4096
_RUN = re.compile(r"'*[=+\-@\t\r\n＝＋－＠]")
"""Text that a spreadsheet reads as a formula, or would without its leading apostrophes."""

_LOST = re.compile(r'[\r\n]|^\s|\s$|^".*"$')
"""Text that a line-based reader loses or truncates, or that would be read as a JSON string."""


def harmless_text(text: str) -> str:
    """Single-line text that no spreadsheet reads as a formula; :func:`unescape_cell` restores the original."""
    if _LOST.search(text):
        return json.dumps(text, ensure_ascii=False)
    return f"'{text}" if _RUN.match(text) else text


def unescape_cell(cell: str) -> str:
    r"""Original text of a cell from :func:`harmless_text`; other cells are unchanged.

    >>> unescape_cell("'=1+1"), unescape_cell("elbow"), unescape_cell("-x"), unescape_cell('"two\\nlines"')
    ('=1+1', 'elbow', '-x', 'two\nlines')
    """
    if len(cell) > 1 and cell[0] == cell[-1] == '"':
        with suppress(ValueError):
            return str(json.loads(cell))
    return cell[1:] if cell.startswith("'") and _RUN.match(cell) else cell


@dataclass(frozen=True, eq=False)
class CsvWriter:
    """Writer of rows to a CSV file opened in binary mode; lines end in a newline."""

    file: BinaryIO

    def row(self, cells: Iterable[str | float | None]) -> None:
        """Add one row; numbers have the digits that reproduce them exactly, None is an empty cell."""
        line = io.StringIO()
        texts = [harmless_text(c) if isinstance(c, str) else "" if c is None else repr(float(c)) for c in cells]
        csv.writer(line, lineterminator="\r\n").writerow(texts)  # "\r" is quoted only if it may end lines
        self.file.write((line.getvalue().removesuffix("\r\n") + "\n").encode())

    def numbers(self, rows: Array) -> None:
        """Add rows (n, columns) of numbers, with the digits that reproduce them exactly."""
        # Numbers need no quotes, and repr gives the shortest exact decimal; the csv module takes twice as long.
        for k in range(0, len(rows), _PORTION):  # text takes ten times the memory of the numbers
            lines = [",".join(map(repr, row)) for row in rows[k : k + _PORTION].tolist()]
            self.file.write(("\n".join(lines) + "\n").encode("ascii"))


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


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Data frame of columns; raises :class:`~twistwrench.MissingExtraError` if pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise MissingExtraError.from_extra("pandas", "tables", "Making a DataFrame") from None
    return pandas.DataFrame(columns)
