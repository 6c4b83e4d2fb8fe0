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
"""Force above which a foot carries [N]."""
_MIN_SWITCH_VALUE = 0.5
"""Value above which a foot carries in a column of 0 and 1."""
_MIN_SIMILARITY = 0.6
"""Similarity of two names, 0 to 1, from which one is proposed for the other."""


def with_schedule(ground: Ground, given: InContactGiven, log: MotionLog) -> Ground:
    """Ground whose feet carry at the rows of a log that ``given`` marks.

    "auto" keeps the rule of heights and speeds. The other word takes the columns of the log that are named after the feet.
    """
    if not isinstance(given, Mapping):
        if arguments.choice(given, "in_contact", get_args(ContactSource)) == "auto":
            return ground
        given = {frame: f"{frame}.contact" for frame in ground.feet}
    _check_feet(ground, given)
    column_by_foot = {frame: _column_number(log, frame, name) for frame, name in given.items() if isinstance(name, str)}
    time, columns = _times_and_columns(log, list(column_by_foot.values()))
    logged_values = dict(zip(column_by_foot, columns.T, strict=True))
    carries = np.ones((len(time), len(ground.contacts)), bool)
    for frame, source in given.items():
        if frame in logged_values:
            foot_values = logged_values[frame]
        else:
            foot_values = _given_values(frame, source, len(time))
        is_switch = foot_values.max(initial=0.0) <= 1.0  # 0 and 1 instead of a force
        threshold = _MIN_SWITCH_VALUE if is_switch else _MIN_CARRYING_FORCE
        carries[:, ground.contacts_at(frame)] = (foot_values > threshold)[:, None]
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


def _column_number(log: MotionLog, frame: str, name: str) -> int:
    """Number of the column of a foot, by the column's name with or without its unit. Raises ValueRangeError."""
    names_without_unit = []
    for k, heading in enumerate(log.file.header):
        name_without_unit, _ = split_unit(heading)
        if name in (heading, name_without_unit):
            return k
        names_without_unit.append(name_without_unit)
    similar_names = difflib.get_close_matches(name, names_without_unit, n=1, cutoff=_MIN_SIMILARITY)
    hint = f" Did you mean {similar_names[0]!r}?" if similar_names else ""
    raise ValueRangeError(
        f"{log.path}: no column {name!r}, needed for {frame!r}.{hint} Name one for each foot, {{0}}: 0 or 1, "
        "or a force in N. Or leave it out: feet then carry where they are low and slow.",
        Argument("in_contact", {frame: "COLUMN"}),
    )


def _times_and_columns(log: MotionLog, column_numbers: Sequence[int]) -> tuple[Array, Array]:
    """Time (n,) of each row of a log [s], as its motion has it, and the columns (n, k) with these numbers, forces in N."""
    columns = log.columns
    if columns.counted:  # no column of time; the first column takes its place in the table
        table = log.file.table((0, *column_numbers))
        time = columns.seconds * np.arange(len(table))
    else:
        table = log.file.table((columns.used[columns.time], *column_numbers))
        time = columns.seconds * table[:, 0]
    if len(time) and date_note(float(time[0])):  # seconds since 1970, which a motion counts from its first row
        time = time - float(time[0])
    factors = np.ones(len(column_numbers))
    for k, column in enumerate(column_numbers):
        _, unit = split_unit(log.file.header[column])
        if unit:
            factors[k] = (
                si_factor(unit, "tau", angular=False) or 1.0
            )  # the factor is None for other units than of forces
    return time, table[:, 1:] * factors


def _given_values(frame: str, given: ArrayLike, row_count: int) -> Array:
    """Given values (n,) of a foot, one for each row of the log; a single value is repeated."""
    values = arguments.finite(given, f"in_contact of {frame!r}")
    if values.shape not in ((), (row_count,)):
        raise ShapeError(
            f"in_contact of {frame!r} has the shape {values.shape}, and the motion has {row_count} rows. Give one value for "
            "each row, 0 or 1 or a force in N, or one for all."
        )
    return np.broadcast_to(values, (row_count,))
