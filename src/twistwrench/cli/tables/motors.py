"""The motors' part of the torque report: a table, and the answer to "which motor is too small?"."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.text import Text

from ...core.printed_numbers import number
from ...listing import listed
from ...model.limits import over_limit
from ...report.motors import Demand, MotorUse
from .plain_table import PlainTable, share_cell

_SHORT = {"peak current": "peak", "rms current": "rms"}
_DIGITS, _ROUNDING = 3, 6
"""Of currents, voltages, speeds and powers; what is smaller than that many decimals is rounding."""


def motors_table(motors: Sequence[MotorUse]) -> PlainTable:
    """A row per motor; limits stand behind the values, what passes one is red."""
    table = PlainTable("Motors")
    table.words("joint")
    table.numbers(
        *(f"{_SHORT.get(d.what, d.what)} [{d.unit}]" for d in motors[0].demands), "power [W]", "heat [W]", "used"
    )
    for use in motors:
        used = share_cell(use.tightest.share or math.nan)
        table.row(use.joint, *map(_cell, use.demands), _figure(use.power), _figure(use.heat), used)
    return table


def _cell(demand: Demand) -> Text:
    limit = f" / {number(demand.limit, _DIGITS)}" if math.isfinite(demand.limit) else ""
    return Text.assemble((_figure(demand.value), "red" if over_limit(demand.share) else ""), (limit, "dim"))


def _figure(value: float) -> str:
    return number(value, _DIGITS, decimals=_ROUNDING)


def motors_verdict(motors: Sequence[MotorUse]) -> Text:
    """One line: which motors are too small, by what; or which is nearest to its limits."""
    small = sorted((use for use in motors if use.too_small), key=lambda use: -use.tightest.share)
    if small:
        return Text.assemble(("MOTOR TOO SMALL", "bold red"), f": {listed((use.words for use in small), 3, '; ')}.")
    known = [use for use in motors if any(math.isfinite(d.limit) for d in use.demands)]
    if not known:
        return Text.assemble(("MOTORS", "bold"), ": their limits are not known.")
    return Text.assemble(
        ("MOTORS OK", "bold green"),
        f": nearest to its limits is {max(known, key=lambda use: use.tightest.share).words}.",
    )
