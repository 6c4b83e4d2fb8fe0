"""What is wrong with a motion file's rows: the first line to blame, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from ..errors import TrajectoryError

__all__ = ["blame"]


def blame(text: bytes, path: Path, line: int, header: Sequence[str], time: int, last: float) -> TrajectoryError:
    """The error of the first bad line of ``text``, whose first line has number ``line``.

    ``last`` is the time of the row before. Only called once a block is known to be bad, so it may be slow.
    """
    for count, raw in enumerate(text.decode("utf-8", "replace").splitlines()):
        if not raw.strip():
            continue
        where = f"{path}: line {line + count}"
        reason = _shape_fault(raw, header) or _number_fault(raw.split(","), header)
        if reason:
            return TrajectoryError(f"{where}{reason}")
        now = float(raw.split(",")[time])
        if now <= last:
            return TrajectoryError(
                f"{where}, column {header[time]!r}: time {now!r} does not come after {last!r} of the row before. "
                "Time must increase strictly; sort the rows and remove repeats."
            )
        last = now
    return TrajectoryError(f"{path}: rows that cannot be read as numbers. Save the motion as plain CSV.")


def _shape_fault(raw: str, header: Sequence[str]) -> str | None:
    fields = raw.split(",")
    if ";" in raw:
        return f": semicolons between values: {_shown(raw)}. Put commas there, and write decimals with a point (0.5)."
    if raw.lstrip().startswith("#"):
        return f" is a comment: {_shown(raw)}. Comments may stand before the header only."
    if len(fields) == len(header):
        return None
    counted = f" has {len(fields)} values, and the header names {len(header)} columns: {_shown(raw)}."
    if len(fields) < len(header):
        return f"{counted} The row is cut short; complete or remove it."
    if len(fields) >= 2 * len(header) - 1:
        return f"{counted} If commas are decimal marks here, write decimals with a point (0.5, not 0,5)."
    return f"{counted} Remove what is too much."


def _number_fault(fields: Sequence[str], header: Sequence[str]) -> str | None:
    for name, field in zip(header, fields, strict=True):
        shown = field.strip()
        try:
            value = float(shown)
        except ValueError:
            said = "is blank" if not shown else f"is {shown[:40]!r}, which is no number"
            return f", column {name!r} {said}. Every row needs a number such as -0.25 in every column."
        if not math.isfinite(value):
            return f", column {name!r} is {shown!r}. Samples must be finite: fill or remove the row."
        if "_" in shown:
            return f", column {name!r} is {shown!r}. Numbers are written without underscores."
    return None


def _shown(raw: str) -> str:
    return repr(raw if len(raw) <= 60 else raw[:57] + "…")
