"""What a gain between a column and the slope of another one says about their units, in words."""

from __future__ import annotations

import math

from ..core.printed_numbers import printed

_WITHIN = 0.1
"""How near a known factor between units a gain is taken to be that factor."""

_DEGREES = math.degrees(1.0)


def described_gain(gain: float, angular: bool, base: str, per: str) -> str:
    """What a column is, whose slope over time should be that of ``base``; ``per`` is the unit's end, such as /s."""
    slope = f"the slope of the {base}"
    if math.isinf(gain):
        return f"moves, and the {base} stand"
    if abs(gain) < 0.02 and not (angular and near(gain, 1 / _DEGREES)) and not near(gain, 1e-3):
        return f"is next to nothing, and the {base} move: leave the column out, then it is derived"
    known = [
        ("1000", 1e3, "time seems to be in ms"),
        ("1/1000", 1e-3, "time, or the column, seems to be in another unit"),
    ]
    if angular:
        known += [
            ("57.3", _DEGREES, f"it seems to be in deg{per}; name the unit, as in 'JOINT [deg{per}]'"),
            ("1/57.3", 1 / _DEGREES, "the positions seem to be in degrees; name the unit, as in 'JOINT [deg]'"),
        ]
        if per == "/s":
            known.append(("9.55", 30 / math.pi, "it seems to be in rpm; name the unit, as in 'JOINT [rpm]'"))
    else:
        known[0] = ("1000", 1e3, f"time seems to be in ms, or the column in mm{per}")
    for shown, factor, reason in known:
        if near(gain, factor):
            return f"is {shown} times {slope}: {reason}"
    if near(gain, -1.0):
        return f"has the opposite sign of {slope}"
    return f"is not {slope}, but some {printed(gain, 2)} times it"


def near(gain: float, factor: float) -> bool:
    """Whether a gain is taken to be a factor between units."""
    return abs(gain / factor - 1.0) < _WITHIN
