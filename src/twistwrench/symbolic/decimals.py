"""Numbers as their files had them: 0.01 again, where fusing links and Steiner's theorem left 0.010000000000000002."""

from __future__ import annotations

_ROUND_OFF = 4e-16
"""Two units in the last place."""


def shortest(value: float, scale: float = 0.0) -> float:
    """The shortest decimal within round-off, 4e-16 of the value, or of ``scale`` where it is a difference of such numbers.

    >>> shortest(0.010000000000000002), shortest(0.1 + 0.2), shortest(1 / 3)
    (0.01, 0.3, 0.3333333333333333)
    """
    value = float(value)
    allowed = _ROUND_OFF * max(abs(value), scale)
    for digits in range(1, 17):
        near = float(f"{value:.{digits}g}")
        if abs(near - value) <= allowed:
            return near
    return value
