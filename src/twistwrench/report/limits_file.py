"""Joint limits from a CSV file, ``joint,lower,upper,velocity,effort``, in place of the robot's; blanks keep those."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from ..errors import NotFoundError, UnknownNameError, ValueRangeError
from ..model.model import Limits, Model
from .coordinates import Coordinates

__all__ = ["read_limits"]

_KINDS = ("lower", "upper", "velocity", "effort")


def read_limits(path: str | Path, model: Model, *, degrees: bool = False) -> Limits:
    """The model's limits with those of the file in their places; angles of the file are in degrees if ``degrees``.

    Raises :class:`~twistwrench.NotFoundError`, :class:`~twistwrench.UnknownNameError` and
    :class:`~twistwrench.ValueRangeError`, naming file, line and column.
    """
    path = Path(path)
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except FileNotFoundError:
        raise NotFoundError(f"no limits file {str(path)!r}. Give a CSV file: joint,{','.join(_KINDS)}.") from None
    except (OSError, UnicodeDecodeError) as problem:
        raise ValueRangeError(
            f"{path}: cannot be read: {problem}. Give a CSV file in UTF-8: joint,{','.join(_KINDS)}."
        ) from None
    rows = [
        (n, next(csv.reader([line]))) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")
    ]
    if not rows:
        raise ValueRangeError(
            f"{path}: the file is empty. Its header is joint,{','.join(_KINDS)}, then a line per joint."
        )
    header = _header(rows[0], path)
    coordinates = Coordinates.of(model)
    known = {name: k for k, name in enumerate(coordinates.velocity_names)}
    angles = np.where(coordinates.angular_velocity & degrees, math.radians(1.0), 1.0)
    found = {kind: getattr(model.limits, kind).copy() for kind in _KINDS}
    seen: set[str] = set()
    for line, cells in rows[1:]:
        where = f"{path}: line {line}"
        if len(cells) != len(header):
            raise ValueRangeError(
                f"{where} has {len(cells)} values, and the header names {len(header)}. Leave blanks, keep commas."
            )
        row = dict(zip(header, (cell.strip() for cell in cells), strict=True))
        joint = row.pop("joint")
        if joint not in known:
            raise ValueRangeError(f"{where}: {UnknownNameError.of('joint', joint, known)}")
        if joint in seen:
            raise ValueRangeError(f"{where}: joint {joint!r} has limits already. Keep one line for each joint.")
        seen.add(joint)
        k = known[joint]
        for kind, text in row.items():
            if text:
                found[kind][k] = _limit(text, kind, where) * (1.0 if kind == "effort" else angles[k])
        if found["lower"][k] > found["upper"][k]:
            raise ValueRangeError(
                f"{where}: the lower limit of {joint!r}, {found['lower'][k]:g}, is above the upper, "
                f"{found['upper'][k]:g}. Swap them."
            )
    return Limits(**found)


def _header(row: tuple[int, list[str]], path: Path) -> list[str]:
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
