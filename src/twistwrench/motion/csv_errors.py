"""What is wrong with the rows of a CSV file: the first line to blame, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from ..errors import TrajectoryError
from .csv_dialect import Dialect, is_number

_GAPS = ("nan", "inf", "infinity")
"""What stands for a number that is not there, whatever its sign."""


def blame(
    text: bytes, path: Path, line: int, header: Sequence[str], used: Sequence[int], dialect: Dialect
) -> TrajectoryError:
    """The error of the first bad line of ``text``, whose first line has number ``line``.

    Only called once a block is known to be bad, so it may be slow.
    """
    decimal_comma = dialect.has_decimal_commas(text)
    lines = text.decode("utf-8", "replace").split("\n")

    def gap(raw: str) -> str | None:
        cells = dialect.cells(raw)
        if _passed_over(raw) or len(cells) != len(header):
            return None
        return _gap([cells[k] for k in used], [header[k] for k in used], decimal_comma=decimal_comma)

    for count, raw in enumerate(lines):
        if _passed_over(raw):
            continue
        if missing := gap(raw):
            last = next((k for k in range(count + 1, len(lines)) if not gap(lines[k])), len(lines)) - 1
            more = f", and so on to line {line + last}" if last > count else ""
            these = "these rows" if more else "the row"
            return TrajectoryError(
                f"{path}: line {line + count}{missing}{more}. Samples must be finite: fill or remove {these}."
            )
        reason = _bytes_fault(raw) or _shape_fault(raw, header, dialect)
        cells = dialect.cells(raw)
        reason = reason or _number_fault(
            [cells[k] for k in used], [header[k] for k in used], decimal_comma=decimal_comma
        )
        if reason:
            return TrajectoryError(f"{path}: line {line + count}{reason}")
    return TrajectoryError(f"{path}: rows that cannot be read as numbers. Save it as plain CSV.")


def _passed_over(raw: str) -> bool:
    """Whether a line is no row: blank, or a comment."""
    return not raw.strip() or raw.lstrip(" \t").startswith("#")


def _gap(fields: Sequence[str], names: Sequence[str], *, decimal_comma: bool) -> str | None:
    """The first of these that is not finite, where all others are numbers; None where there is none."""
    found = None
    for name, field in zip(names, fields, strict=True):
        if field.lower().lstrip("+-") in _GAPS:
            infinite = True
        elif is_number(field, decimal_comma=decimal_comma):
            infinite = not math.isfinite(float(field.replace(",", ".")))
        else:
            return None
        if infinite and found is None:
            found = f", column {name!r} is {field[:40]!r}"
    return found


def _bytes_fault(raw: str) -> str | None:
    if "\ufffd" in raw:
        return f" is not UTF-8 text: {_shown(raw)}. Save it as CSV in UTF-8."
    odd = next((c for c in raw if (c < " " and c != "\t") or c == "\x7f"), None)
    if odd is None:
        return None
    return f" has a control character, {odd!r}: {_shown(raw)}. The file may be damaged or binary; write the row again."


def _shape_fault(raw: str, header: Sequence[str], dialect: Dialect) -> str | None:
    fields = dialect.cells(raw)
    if raw.count('"') % 2:
        return f" has a quote that never ends: {_shown(raw)}. Remove the quote."
    if len(fields) == len(header):
        return None
    if dialect.separator == "," and ";" in raw:
        return f": semicolons between values: {_shown(raw)}, and commas in the header. Separate all rows as the header."
    counted = f" has {len(fields)} values, and the header names {len(header)} columns: {_shown(raw)}."
    if len(fields) < len(header):
        return f"{counted} The row is cut short; complete or remove it."
    if dialect.separator == "," and len(fields) >= 2 * len(header) - 1:
        return (
            f"{counted} If commas are decimal marks here, separate values by semicolons, or write decimals with a point "
            "(0.5, not 0,5)."
        )
    return f"{counted} Remove what is too much."


def _number_fault(fields: Sequence[str], names: Sequence[str], *, decimal_comma: bool) -> str | None:
    for name, field in zip(names, fields, strict=True):
        shown = field[:40]
        column = f", column {name!r}"
        if is_number(field, decimal_comma=decimal_comma) or field.lower().lstrip("+-") in _GAPS:
            continue
        if "_" in field:
            return f"{column} is {shown!r}. Numbers are written without underscores."
        if decimal_comma and "." in field:
            return f"{column} is {shown!r}, with a point where other rows have decimal commas. Write all of them alike."
        if "," in field and not decimal_comma and is_number(field, decimal_comma=True):
            return f"{column} is {shown!r}. Where commas separate values, decimals are written with a point (0.5)."
        said = "is blank" if not field else f"is {shown!r}, which is no number"
        return f"{column} {said}. Every row needs a number such as -0.25 in every column that is used."
    return None


def _shown(raw: str) -> str:
    return repr(raw if len(raw) <= 60 else raw[:57] + "…")
