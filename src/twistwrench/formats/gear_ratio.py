"""Gear ratios as files write them: 101, 101:1, or the lead of a spindle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import ModelError
from .yaml_section import plain_number, shown

_PER_METRE: dict[str, Callable[[float], float]] = {
    "rad/m": lambda x: x,
    "mm/turn": lambda x: 2e3 * np.pi / x,
    "m/turn": lambda x: 2 * np.pi / x,
}
"""Rotor radians per metre, from what a spindle or a rack is described by."""


def gear_ratio(value: object, where: str, *, sliding: bool) -> float:
    """A plain number, or ``101:1``; at a sliding joint a plain number of rad/m, or with one of the units of leads."""
    if sliding and isinstance(value, str):
        for unit, per_metre in _PER_METRE.items():
            if value.rstrip().endswith(unit):
                problem = f"{where} is {shown(value)}, expected a number before {unit}."
                number = plain_number(value.rstrip()[: -len(unit)], problem)
                if number == 0:
                    raise ModelError(problem)
                return float(per_metre(number))
    units = f", or with one of {', '.join(_PER_METRE)}" if sliding else ", or 101:1"
    problem = f"{where} is {shown(value)}, expected a number such as 101{units}."
    turns, colon, per = value.partition(":") if isinstance(value, str) else (value, "", "")
    divisor = plain_number(per, problem) if colon else 1.0
    if divisor == 0:
        raise ModelError(problem)
    return plain_number(turns, problem) / divisor
