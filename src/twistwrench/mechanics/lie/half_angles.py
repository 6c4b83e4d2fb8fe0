"""Branch-free rotation angles of exp and log, for numbers and symbols."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .series import cot_coefficients

# Quotients such as sin(x)/x are power series in x² up to 1 rad and closed forms above. Both are evaluated, each with an
# argument that is clipped to its side of 1 rad, and one is selected by a factor 0 or 1. So there is no branch, and values and
# all derivatives are accurate at every angle.

LARGEST_HALF_TURN = 2.0**14
"""Maximum half angle [rad]. Larger ones are clipped, so that their sines are finite; no step of a motion is that long."""


class HalfAngle(NamedTuple):
    """Values of three functions of an angle, computed from its square."""

    half: Any
    """sin(angle/2) / angle."""
    cosine: Any
    """cos(angle/2)."""
    third: Any
    """(angle - sin(angle)) / angle³."""


# Taylor coefficients in angle² of the three functions of HalfAngle; the first omitted terms are below 1e-19 at 1 rad.
_HALF = [(-1.0) ** k / (2.0 ** (2 * k + 1) * math.factorial(2 * k + 1)) for k in range(9)]
_COSINE = [(-1.0) ** k / (4.0**k * math.factorial(2 * k)) for k in range(9)]
_THIRD = [(-1.0) ** k / math.factorial(2 * k + 3) for k in range(9)]
_ARCTANGENT = [(-1.0) ** k / (2 * k + 1) for k in range(13)]
"""Coefficients of atan(t)/t in t²; the first omitted term is below 1e-19 at t = tan(π/16)."""
_COTANGENT = list(cot_coefficients(28))
"""Coefficients of (1 - (x/2) cot(x/2)) / x² in x²; successive terms decrease by a factor of 4 at x = π."""


def half_angle(square: Any) -> HalfAngle:
    """Half-angle terms from the square of an angle. Angles are clipped at twice :data:`LARGEST_HALF_TURN`."""
    small_square = _clip_above(square, 1.0)
    large_square = _clip_below(square, 1.0)
    angle = np.sqrt(large_square)
    half_of_angle = _clip_above(0.5 * angle, LARGEST_HALF_TURN)
    sine = np.sin(half_of_angle)
    cosine = np.cos(half_of_angle)
    is_large = 0.5 + 0.5 * _sign(square - 1.0)  # 1 above 1 rad, 0 below
    closed_half = sine / angle
    closed_third = (1.0 - 2.0 * sine * cosine / angle) / large_square  # sin(x) = 2 sin(x/2) cos(x/2)
    closed_forms = (closed_half, cosine, closed_third)
    functions: list[Any] = []
    for closed_form, coefficients in zip(closed_forms, (_HALF, _COSINE, _THIRD), strict=True):
        series = _polynomial(coefficients, small_square)
        functions.append(is_large * closed_form + (1.0 - is_large) * series)
    return HalfAngle(*functions)


def half_turn(cosine: Any, sine_square: Any) -> Any:
    """x / sin(x) of the angle 0 ≤ x ≤ π/2, from its cosine and its squared sine.

    The angle is halved three times by tan(x/2) = tan(x) / (1 + √(1 + tan²(x))), and x = 8 atan(t) with t = tan(x/8). Only
    quotients of the tangents by sin(x) are computed, so that x = 0 needs no case of its own.
    """
    quotient = 1.0 / (1.0 + cosine)  # tan(x/2) / sin(x)
    for _ in range(2):  # then tan(x/4) / sin(x) and tan(x/8) / sin(x)
        quotient = quotient / (1.0 + np.sqrt(1.0 + quotient * quotient * sine_square))
    eight_quotients = 8.0 * quotient
    tangent_square = quotient * quotient * sine_square
    return eight_quotients * _polynomial(_ARCTANGENT, tangent_square)


def cotangent_quotient(square: Any) -> Any:
    """(1 - (x/2) cot(x/2)) / x² from the square of an angle up to π."""
    return _polynomial(_COTANGENT, square)


def short_way(cosine: Any) -> Any:
    """-1 if a rotation, by the cosine of its half angle, exceeds π, so that the opposite one is shorter; else 1."""
    sign = _sign(cosine)
    return sign + (1.0 - sign * sign)  # the second term makes it 1 at cosine 0, where the sign is 0


def _polynomial(coefficients: list[float], x: Any) -> Any:
    """Polynomial by Horner's scheme; ``coefficients`` begin with the constant."""
    total: Any = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = coefficient + x * total
    return total


# Traced variables have methods sign and clip; numbers have none.


def _sign(x: Any) -> Any:
    """Sign of a number or a traced variable: -1, 0 or 1."""
    return x.sign() if hasattr(x, "sign") else np.sign(x)


def _clip_above(x: Any, maximum: float) -> Any:
    """The smaller of x and ``maximum``."""
    return x.clip(-np.inf, maximum) if hasattr(x, "sign") else min(x, maximum)


def _clip_below(x: Any, minimum: float) -> Any:
    """The larger of x and ``minimum``."""
    return x.clip(minimum, np.inf) if hasattr(x, "sign") else max(x, minimum)
