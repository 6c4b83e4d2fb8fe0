"""Joint limits from a CSV file, ``joint,lower,upper,velocity,effort``, in place of the robot's; blanks keep those.

The table of ``twistwrench info --csv`` is read too: a row for each entry of dq, whose other columns are ignored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.files import as_path
from ..core.printed_numbers import printed
from ..errors import UnknownNameError, ValueRangeError
from ..model.limits import Limits
from ..model.model import Model
from ..motion.coordinates import Coordinates
from ..motion.csv_dialect import Dialect
from ..motion.csv_file import CsvFile, table_errors
from ..typing import Array
from .robot_summary import COLUMNS

_KINDS = ("lower", "upper", "velocity", "effort")
_BEYOND = {sign + word: float(sign + "inf") for word in ("inf", "infinity") for sign in ("", "+", "-")} | {
    "nan": math.nan
}
"""Words for numbers."""
_TURNS, _ENDLESS, _FAR = 4 * math.pi, 1e4, 3.0
"""Two turns [rad], from which positions may be degrees; numbers that stand for no limit; times the robot's own limit."""


@dataclass(frozen=True, eq=False)
class StatedLimits(Limits):
    """Limits of which some are the user's own."""

    stated: Array
    """(nv,) of bool: joints whose effort the user gave."""


def read_limits(path: str | Path, model: Model, *, degrees: bool = False) -> StatedLimits:
    """The model's limits with those of the file in their places; angles of the file are in degrees if ``degrees``.

    Raises :class:`~twistwrench.NotFoundError`, :class:`~twistwrench.UnknownNameError` and
    :class:`~twistwrench.ValueRangeError`, naming file, line and column.
    """
    path = as_path(path)
    with table_errors(path, "limits file", f"joint,{','.join(_KINDS)}, then a line per joint"):
        file = CsvFile.open(path)
        header, rows = _header(file), list(file.rows())
    joints = Coordinates.of(model)
    angles = np.where(joints.angular_velocity & degrees, math.radians(1.0), 1.0)
    found = {kind: getattr(model.limits, kind).copy() for kind in _KINDS}
    seen: set[str] = set()
    sizes, stated = np.zeros(model.nv), np.zeros(model.nv, bool)
    for line, cells in rows:
        if "leader" in header and cells[header.index("leader")]:
            continue
        where = f"{path}: line {line}"
        joint, values = _joint_of(header, cells, where, file.dialect)
        k = _check(joint, values, joints, seen, where)
        seen.add(joint)
        stated[k] = "effort" in values
        for kind, value in values.items():
            found[kind][k] = value * (1.0 if kind == "effort" else angles[k])
        sizes[k] = max(
            (abs(x) for kind, x in values.items() if kind in ("lower", "upper") and math.isfinite(x)), default=0
        )
        if found["lower"][k] > found["upper"][k]:
            raise ValueRangeError(
                f"{where}: the lower limit of {joint!r}, {printed(found['lower'][k])}, is above the upper, "
                f"{printed(found['upper'][k])}. Swap them."
            )
    if not degrees:
        _check_radians(path, sizes * joints.angular_velocity, model)
    return StatedLimits(**found, stated=stated)


def _check_radians(path: Path, sizes: Array, model: Model) -> None:
    """Refuse positions of turning joints that are degrees: more than half are beyond two turns and the robot's own.

    ``sizes`` (nv,) are the largest magnitudes in the file, zero where none is given.
    """
    own = np.maximum(np.abs(model.limits.lower), np.abs(model.limits.upper))
    far = (sizes > _TURNS) & (sizes < _ENDLESS) & (sizes > _FAR * np.where(np.isfinite(own), own, 0.0))
    if not 2 * int(far.sum()) > int((sizes > 0).sum()):
        return
    k = int(np.argmax(far))
    raise ValueRangeError(
        f"{path}: the limits of position look like degrees: {printed(sizes[k])} for {model.velocity_names[k]!r} is "
        f"{printed(sizes[k] / math.tau, 3)} turns in radians. Add --degrees, or write radians; inf stands for no limit."
    )


def _joint_of(header: list[str], cells: list[str], where: str, dialect: Dialect) -> tuple[str, dict[str, float]]:
    """The joint of a line and the limits it gives, as they stand there."""
    row = dict(zip(header, cells, strict=True))
    values = {kind: _limit(row[kind], kind, where, dialect) for kind in _KINDS if row.get(kind)}
    return row.get("velocity_name") or row["joint"], values


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


def _header(file: CsvFile) -> list[str]:
    header = [cell.strip().lower() for cell in file.header]
    unknown = [name for name in header if name not in COLUMNS]
    if "joint" not in header or unknown or len(set(header)) < len(header):
        raise ValueRangeError(
            f"{file.path}: line {file.header_line}: the header is {','.join(file.header)!r}. Name 'joint' and any of "
            f"{', '.join(_KINDS)}, each once, separated by commas."
        )
    return header


def _limit(text: str, kind: str, where: str, dialect: Dialect) -> float:
    value = _BEYOND[text.lower()] if text.lower() in _BEYOND else dialect.number(text)
    if value is None:
        raise ValueRangeError(f"{where}, column {kind!r}: {text!r} is no number. Leave it blank to keep the robot's.")
    if math.isnan(value) or (kind in ("velocity", "effort") and value <= 0):
        allowed = "a number above 0" if kind in ("velocity", "effort") else "a number"
        raise ValueRangeError(
            f"{where}, column {kind!r}: {text!r} cannot be a limit. Give {allowed}, inf for none, or a blank."
        )
    return value
