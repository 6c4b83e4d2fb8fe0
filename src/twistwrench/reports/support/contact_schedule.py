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

_MIN_CARRYING_FORCE = 20.0
"""Force from which a foot carries [N]."""
_MIN_SWITCH_VALUE = 0.5
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
    logged = dict(zip(columns, values.T, strict=True))
    carries = np.ones((len(time), len(ground.contacts)), bool)
    for frame, source in given.items():
        own = logged[frame] if frame in logged else _values(frame, source, len(time))
        threshold = _MIN_SWITCH_VALUE if own.max(initial=0.0) <= 1.0 else _MIN_CARRYING_FORCE
        carries[:, ground.contacts_at(frame)] = (own > threshold)[:, None]
    return replace(ground, schedule=ContactSchedule(time, carries))


def _check_feet(ground: Ground, given: Mapping[str, object]) -> None:
    """Raise UnknownNameError or ValueRangeError unless there is one entry for each foot."""
    for frame in given:
        if frame not in ground.frames:
            raise UnknownNameError.from_choices("foot of in_contact", frame, ground.frames)
    for frame in ground.feet:
        if frame not in given:
            raise ValueRangeError(
                f"in_contact has no entry for {frame!r}. Give a column of the log for each foot, {{0}}: 0 or 1, or a force in "
                "N.",
                Argument("in_contact", {frame: "COLUMN"}),
            )


def _column(log: MotionLog, frame: str, name: str) -> int:
    """Number of the column of a foot, by its name with or without the unit."""
    names = []
    for k, text in enumerate(log.file.header):
        name_without_unit, _ = split_unit(text)
        if name in (text, name_without_unit):
            return k
        names.append(name_without_unit)
    similar = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    hint = f" Did you mean {similar[0]!r}?" if similar else ""
    raise ValueRangeError(
        f"{log.path}: no column {name!r}, needed for {frame!r}.{hint} Name one for each foot, {{0}}: 0 or 1, "
        "or a force in N. Or leave it out: feet then carry where they are low and slow.",
        Argument("in_contact", {frame: "COLUMN"}),
    )


def _rows(log: MotionLog, used: Sequence[int]) -> tuple[Array, Array]:
    """Time (n,) of each row of a file [s], as its motion has it, and columns (n, k), forces in N."""
    columns, header = log.columns, log.file.header
    if columns.counted:
        table = log.file.table((0, *used))
        time = columns.seconds * np.arange(len(table))
    else:
        table = log.file.table((columns.used[columns.time], *used))
        time = columns.seconds * table[:, 0]
    if len(time) and date_note(float(time[0])):
        time = time - float(time[0])
    factors = np.ones(len(used))
    for k, column in enumerate(used):
        _, unit = split_unit(header[column])
        if unit:
            factors[k] = si_factor(unit, "tau", angular=False) or 1.0
    return time, table[:, 1:] * factors


def _values(frame: str, given: ArrayLike, rows: int) -> Array:
    """Values (n,) of a foot for each row of the log; one value is that of all rows."""
    values = arguments.finite(given, f"in_contact of {frame!r}")
    if values.shape not in ((), (rows,)):
        raise ShapeError(
            f"in_contact of {frame!r} has the shape {values.shape}, and the motion has {rows} rows. Give one value for each "
            "row, 0 or 1 or a force in N, or one for all."
        )
    return np.broadcast_to(values, (rows,))
