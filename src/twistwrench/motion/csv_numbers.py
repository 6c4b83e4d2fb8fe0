"""Rows of a CSV file as numbers, a block of lines at a time: NumPy's reader, and cell by cell what that does not know."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence

import numpy as np

from ..typing import Array
from .csv_dialect import Dialect, is_number

_CONTROL = bytes(k for k in range(32) if k not in (9, 10)) + b"\x7f"
_COMMENTS = re.compile(rb"^[ \t]*(#[^\n]*)?$", re.MULTILINE)


def parse_block(text: bytes, dialect: Dialect, columns: int, used: Sequence[int]) -> Array | None:
    """The ``used`` columns of lines that have ``columns`` cells each → (rows, len(used)); the same bits as ``float()``.

    Blank lines and lines that begin with # are passed over. None where a line has another number of cells, or a used cell is
    no finite number.
    """
    if text.translate(None, _CONTROL) != text:
        return None
    if b"#" in text:
        text = _COMMENTS.sub(b"", text)
    plain = text.isascii() and b'"' not in text
    if dialect.has_decimal_commas(text):
        plain = plain and b"." not in text
        text = text.replace(b",", b".") if plain else text
    table = _by_numpy(text, dialect, columns, used) if plain else None
    return _by_cells(text, dialect, columns, used) if table is None else table


def tidy(text: bytes) -> bytes:
    """Lines that end in a newline alone, the last one too; b"" if nothing but blanks is there."""
    if b"\r" in text:
        text = text.replace(b"\r\n", b"\n")
    if text.isspace() or not text:
        return b""
    return text if text.endswith(b"\n") else text + b"\n"


def _by_numpy(text: bytes, dialect: Dialect, columns: int, used: Sequence[int]) -> Array | None:
    if not text.strip():
        return np.zeros((0, len(used)))
    every = len(used) == columns
    if not every and not _whole(text, dialect, columns):
        return None
    try:
        table = np.loadtxt(
            io.BytesIO(text),
            delimiter=dialect.separator,
            comments=None,
            usecols=None if every else list(used),
            ndmin=2,
        )
    except (ValueError, IndexError, OverflowError):
        return None
    table = table[:, list(used)] if every and table.shape[1] == columns else table
    return np.asarray(table) if table.shape[1] == len(used) and np.isfinite(table).all() else None


def _whole(text: bytes, dialect: Dialect, columns: int) -> bool:
    """Whether every line has that many cells, blank lines aside."""
    if dialect.separator is None:
        return all(len(line.split()) in (0, columns) for line in text.split(b"\n"))
    raw = np.frombuffer(text, np.uint8)
    starts = np.r_[0, np.flatnonzero(raw == 10) + 1][:-1]
    counts = np.add.reduceat(raw == ord(dialect.separator), starts, dtype=np.int64)
    return bool(((counts == columns - 1) | (raw[starts] == 10)).all())


def _by_cells(text: bytes, dialect: Dialect, columns: int, used: Sequence[int]) -> Array | None:
    """Cell by cell: quotes, text in columns that are not used, decimal commas among points elsewhere."""
    try:
        lines = text.decode("utf-8").split("\n")
    except UnicodeDecodeError:
        return None
    decimal_comma = dialect.has_decimal_commas(text)
    rows = []
    for line in lines:
        if not line.strip():
            continue
        cells = dialect.cells(line)
        if len(cells) != columns:
            return None
        row = [cells[k] for k in used]
        if not all(is_number(cell, decimal_comma=decimal_comma) for cell in row):
            return None
        rows.append([float(cell.replace(",", ".")) for cell in row])
    table = np.array(rows, float).reshape(len(rows), len(used))
    return table if np.isfinite(table).all() else None
