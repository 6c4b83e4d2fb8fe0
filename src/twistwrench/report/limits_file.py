"""Joint limits from a CSV file, ``joint,lower,upper,velocity,effort``, in place of the robot's; blanks keep those."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ..core.csv_writer import meant_text
from ..core.files import read_text
from ..core.foreign_errors import foreign_errors
from ..errors import NotFoundError, UnknownNameError, ValueRangeError
from ..model.model import Limits, Model
from .coordinates import Coordinates

__all__ = ["read_limits"]

_KINDS = ("lower", "upper", "velocity", "effort")
_MOST_BYTES = 2**24
_Line = tuple[int, list[str]]
"""A line's number, counting from 1, and its cells."""


def read_limits(path: str | Path, model: Model, *, degrees: bool = False) -> Limits:
    """The model's limits with those of the file in their places; angles of the file are in degrees if ``degrees``.

    Raises :class:`~twistwrench.NotFoundError`, :class:`~twistwrench.UnknownNameError` and
    :class:`~twistwrench.ValueRangeError`, naming file, line and column.
    """
    path = Path(path)
    header, rows = _open(path)
    joints = Coordinates.of(model)
    angles = np.where(joints.angular_velocity & degrees, math.radians(1.0), 1.0)
    found = {kind: getattr(model.limits, kind).copy() for kind in _KINDS}
    seen: set[str] = set()
    for line, cells in rows:
        where = f"{path}: line {line}"
        joint, values = _row(header, cells, where)
        k = _check(joint, values, joints, seen, where)
        seen.add(joint)
        for kind, value in values.items():
            found[kind][k] = value * (1.0 if kind == "effort" else angles[k])
        if found["lower"][k] > found["upper"][k]:
            raise ValueRangeError(
                f"{where}: the lower limit of {joint!r}, {found['lower'][k]:g}, is above the upper, "
                f"{found['upper'][k]:g}. Swap them."
            )
    return Limits(**found)


def _open(path: Path) -> tuple[list[str], list[_Line]]:
    """The header, and the lines after it that are neither blank nor comments."""
    columns = f"joint,{','.join(_KINDS)}"
    with foreign_errors(
        lambda reason: ValueRangeError(f"{path}: cannot be read: {reason}. Give a CSV file in UTF-8: {columns}.")
    ):
        try:
            lines = enumerate(read_text(path, _MOST_BYTES).splitlines(), 1)
        except FileNotFoundError:
            raise NotFoundError(f"no limits file {str(path)!r}. Give a CSV file: {columns}.") from None
        rows = [(n, next(csv.reader([line]))) for n, line in lines if line.strip() and not line.startswith("#")]
    if not rows:
        raise ValueRangeError(
            f"{path}: the file is empty. Its header is joint,{','.join(_KINDS)}, then a line per joint."
        )
    return _header(rows[0], path), rows[1:]


def _row(header: list[str], cells: list[str], where: str) -> tuple[str, dict[str, float]]:
    """The joint of a line and the limits it gives, as they stand there."""
    if len(cells) != len(header):
        raise ValueRangeError(
            f"{where} has {len(cells)} values, and the header names {len(header)}. Leave blanks, keep commas."
        )
    row = dict(zip(header, (cell.strip() for cell in cells), strict=True))
    joint = meant_text(row.pop("joint"))
    return joint, {kind: _limit(text, kind, where) for kind, text in row.items() if text}


def _check(joint: str, values: dict[str, float], joints: Coordinates, seen: set[str], where: str) -> int:
    """Refuse unknown joints, joints seen before, and positions where there is none; which velocity the joint is."""
    known = joints.velocity_names
    if joint not in known:
        raise ValueRangeError(f"{where}: {UnknownNameError.of('joint', joint, known)}")
    if joint in seen:
        raise ValueRangeError(f"{where}: joint {joint!r} has limits already. Keep one line for each joint.")
    k = known.index(joint)
    bounded = [kind for kind in ("lower", "upper") if math.isfinite(values.get(kind, math.inf))]
    if joints.position_of[k] < 0 and bounded:
        raise ValueRangeError(
            f"{where}, column {bounded[0]!r}: {joint!r} is a velocity in the frame of a moving body, and no position "
            "belongs to it. Give limits of velocity and effort, and leave lower and upper blank."
        )
    return k


def _header(row: _Line, path: Path) -> list[str]:
    line, cells = row
    header = [cell.strip().lower() for cell in cells]
    unknown = [name for name in header if name not in ("joint", *_KINDS)]
    if "joint" not in header or unknown or len(set(header)) < len(header):
        raise ValueRangeError(
            f"{path}: line {line}: the header is {','.join(cells)!r}. Name 'joint' and any of {', '.join(_KINDS)}, "
            "each once, separated by commas."
        )
    return header


def _limit(text: str, kind: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueRangeError(
            f"{where}, column {kind!r}: {text!r} is no number. Leave it blank to keep the robot's."
        ) from None
    if math.isnan(value) or (kind in ("velocity", "effort") and value <= 0):
        allowed = "a number above 0" if kind in ("velocity", "effort") else "a number"
        raise ValueRangeError(
            f"{where}, column {kind!r}: {text!r} cannot be a limit. Give {allowed}, inf for none, or a blank."
        )
    return value
