"""Schedule of the feet that carry: columns of a log, a mapping to its columns, or values of a user."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ShapeError, UnknownNameError, ValueRangeError
from ...core.text import Argument
from ...core.typing import Array
from ...motion.column_names import date_note, si_factor, split_unit
from ...motion.motion_log import MotionLog
from .ground import ContactSchedule, ContactSource, Ground, InContactGiven

_LOADED = 20.0
"""Force from which a foot carries [N]."""
_SWITCH = 0.5
"""Value of a column of 0 and 1 from which a foot carries."""


def with_schedule(ground: Ground, given: InContactGiven, log: MotionLog) -> Ground:
    """Ground whose feet carry at the rows of a log that ``given`` marks; "auto" keeps the rule of heights and speeds."""
    if not isinstance(given, Mapping):
        if arguments.choice(given, "in_contact", get_args(ContactSource)) == "auto":
            return ground
        given = {frame: f"{frame}.contact" for frame in ground.feet}
    _check_feet(ground, given)
    columns = {frame: _column(log, frame, name) for frame, name in given.items() if isinstance(name, str)}
    time, values = _rows(log, list(columns.values()))
    forces = dict(zip(columns, values.T, strict=True))
    carries = np.ones((len(time), len(ground.contacts)), bool)
    for frame, source in given.items():
        own = forces[frame] if frame in forces else _values(frame, source, len(time))
        least = _SWITCH if own.max(initial=0.0) <= 1.0 else _LOADED
        carries[:, ground.contacts_at(frame)] = (own > least)[:, None]
    return replace(ground, schedule=ContactSchedule(time, carries))


def _check_feet(ground: Ground, given: Mapping[str, object]) -> None:
    """Raise UnknownNameError or ValueRangeError unless there is one entry for each foot."""
    for frame in given:
        if frame not in ground.frames:
            raise UnknownNameError.from_choices("foot of in_contact", frame, ground.frames)
    if missing := [frame for frame in ground.feet if frame not in given]:
        raise ValueRangeError(
            f"in_contact has no entry for {missing[0]!r}. Give a column of the log for each foot, {{0}}: 0 or 1, or a force in "
            "N.",
            Argument("in_contact", {missing[0]: "COLUMN"}),
        )


def _column(log: MotionLog, frame: str, name: str) -> int:
    """Number of the column of a foot, by its name with or without the unit."""
    header = list(log.file.header)
    named = [k for k, text in enumerate(header) if name in (text, split_unit(text)[0])]
    if named:
        return named[0]
    near = difflib.get_close_matches(name, [split_unit(text)[0] for text in header], n=1, cutoff=0.6)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise ValueRangeError(
        f"{log.path}: no column {name!r}, needed for {frame!r}.{hint} Name one for each foot, {{0}}: 0 or 1, "
        "or a force in N. Or leave it out: feet then carry where they are low and slow.",
        Argument("in_contact", {frame: "COLUMN"}),
    )


def _rows(log: MotionLog, used: Sequence[int]) -> tuple[Array, Array]:
    """Time (n,) of each row of a file [s], as its motion has it, and columns (n, k), forces in N."""
    columns, header = log.columns, log.file.header
    first = 0 if columns.counted else columns.used[columns.time]
    table = log.file.table((first, *used))
    time = columns.seconds * (np.arange(len(table)) if columns.counted else table[:, 0])
    shift = float(time[0]) if len(time) and date_note(float(time[0])) else 0.0
    units = [split_unit(header[k])[1] for k in used]
    factors = [(unit and si_factor(unit, "tau", angular=False)) or 1.0 for unit in units]
    return time - shift, table[:, 1:] * np.array(factors)


def _values(frame: str, given: ArrayLike, rows: int) -> Array:
    """Values (n,) of a foot for each row of the log; one value is that of all rows."""
    values = arguments.finite(given, f"in_contact of {frame!r}")
    if values.shape not in ((), (rows,)):
        raise ShapeError(
            f"in_contact of {frame!r} has the shape {values.shape}, and the motion has {rows} rows. Give one value for each "
            "row, 0 or 1 or a force in N, or one for all."
        )
    return np.broadcast_to(values, (rows,))
