"""Branch-free rotation angles of exp and log, for numbers and symbols."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .series import cot_coefficients

# Quotients such as sin(x)/x are power series in x² up to 1 rad and closed forms above. Both are evaluated, each with its
# argument clipped to its own side of 1 rad, and one is selected. So values and all derivatives are accurate at every angle.

LARGEST_HALF_TURN = 2.0**14
"""Maximum half angle [rad] of one step, which makes sines defined without a test; steps of real motions are shorter."""


class HalfAngle(NamedTuple):
    """Functions of an angle, computed from its square."""

    half: Any
    """sin(angle/2) / angle."""
    cosine: Any
    """cos(angle/2)."""
    third: Any
    """(angle - sin(angle)) / angle³."""


_HALF = [(-1.0) ** k / (2.0 ** (2 * k + 1) * math.factorial(2 * k + 1)) for k in range(9)]
_COSINE = [(-1.0) ** k / (4.0**k * math.factorial(2 * k)) for k in range(9)]
_THIRD = [(-1.0) ** k / math.factorial(2 * k + 3) for k in range(9)]
_ARCTANGENT = [(-1.0) ** k / (2 * k + 1) for k in range(13)]
"""Coefficients of atan(t)/t in t²; the first omitted term is below 1e-19 at t = tan(π/16)."""
_COTANGENT = list(cot_coefficients(28))
"""Coefficients of (1 - (x/2) cot(x/2)) / x² in x²; successive terms decrease by a factor of 4 at x = π."""


def half_angle(square: Any) -> HalfAngle:
    """Half-angle terms from the square of an angle. Angles are clipped at twice :data:`LARGEST_HALF_TURN`."""
    near, far = _least(square, 1.0), _largest(square, 1.0)
    angle = np.sqrt(far)
    x = _least(0.5 * angle, LARGEST_HALF_TURN)
    sine, cosine = np.sin(x), np.cos(x)
    beyond = 0.5 + 0.5 * _sign(square - 1.0)
    closed_forms = (sine / angle, cosine, (1.0 - 2.0 * sine * cosine / angle) / far)
    functions: list[Any] = []
    for closed, coefficients in zip(closed_forms, (_HALF, _COSINE, _THIRD), strict=True):
        series = _polynomial(coefficients, near)
        functions.append(beyond * closed + (1.0 - beyond) * series)
    return HalfAngle(*functions)


def half_turn(cosine: Any, sine_square: Any) -> Any:
    """x / sin(x) of the angle 0 ≤ x ≤ π/2, from its cosine and its squared sine.

    The tangent is halved three times, tan(x/2) = tan(x) / (1 + √(1 + tan²(x))); only its quotients by the sine are computed.
    """
    quotient = 1.0 / (1.0 + cosine)  # tan(x/2) / sin(x)
    for _ in range(2):
        quotient = quotient / (1.0 + np.sqrt(1.0 + quotient * quotient * sine_square))
    return 8.0 * quotient * _polynomial(_ARCTANGENT, quotient * quotient * sine_square)


def cotangent_quotient(square: Any) -> Any:
    """(1 - (x/2) cot(x/2)) / x² from the square of an angle up to π."""
    return _polynomial(_COTANGENT, square)


def short_way(cosine: Any) -> Any:
    """-1 if the rotation with this cosine of its half angle exceeds π, so that its opposite is shorter, else 1."""
    sign = _sign(cosine)
    return sign + (1.0 - sign * sign)


def _polynomial(coefficients: list[float], x: Any) -> Any:
    total: Any = coefficients[-1]
    for c in coefficients[-2::-1]:
        total = c + x * total
    return total


def _sign(x: Any) -> Any:
    return x.sign() if hasattr(x, "sign") else np.sign(x)


def _least(x: Any, most: float) -> Any:
    return x.clip(-np.inf, most) if hasattr(x, "sign") else min(x, most)


def _largest(x: Any, least: float) -> Any:
    return x.clip(least, np.inf) if hasattr(x, "sign") else max(x, least)
