"""Units of joint quantities: radians and N m for rotation, metres and N for translation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, TypeAlias

Part: TypeAlias = Literal["q", "dq", "ddq", "dddq", "tau"]
"""Coordinates, velocities, accelerations, jerks, and torques or forces."""

_UNITS: dict[str, tuple[str, str]] = {
    "q": ("rad", "m"),
    "dq": ("rad/s", "m/s"),
    "ddq": ("rad/s²", "m/s²"),
    "dddq": ("rad/s³", "m/s³"),
    "tau": ("N m", "N"),
    "command": ("rad", "m"),
}
"""Units of angular and of linear entries."""


def unit_of(part: str, turns: bool, *, degrees: bool = False) -> str:
    """Unit of one entry of q, dq, ddq, dddq or tau, angular if ``turns``, else linear; ``degrees`` in place of radians."""
    unit = _UNITS[part][not turns]
    if degrees:
        return unit.replace("rad", "°")
    return unit


def units_of(part: str, turning: Iterable[bool]) -> tuple[str, ...]:
    """Units of the entries of q, dq, ddq, dddq or tau, angular and linear."""
    return tuple(unit_of(part, bool(turns)) for turns in turning)


def heading_unit(part: str, turning: Iterable[bool], *, degrees: bool = False) -> str:
    """Unit for the heading of a column of entries, or both units.

    >>> heading_unit("tau", (True, True)), heading_unit("q", (True, False), degrees=True)
    ('N m', '°, m')
    """
    kinds = sorted(set(map(bool, turning)) or {True}, reverse=True)
    return ", ".join(unit_of(part, turns, degrees=degrees) for turns in kinds)


def torque_word(unit: str) -> str:
    """Axis label for torques or forces, by their unit.

    >>> torque_word("N m"), torque_word("N")
    ('torque [N m]', 'force [N]')
    """
    torque_unit, _ = _UNITS["tau"]
    if unit == torque_unit:
        return f"torque [{unit}]"
    return f"force [{unit}]"
