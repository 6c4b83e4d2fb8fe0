"""Functions that targets lack, composed of available ones: tanh, log and arctan2.

Each result is an ordinary expression, which every target can compute. A :class:`Composed` names it for the chain rule, which
uses the function's own derivative, not that of its formula. Errors are below 1e-15 in double precision, absolute for
results below 1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .expr import Expr

_MAX_FLOAT = float(np.finfo(float).max)
_MIN_NORMAL = float(np.finfo(float).tiny)
_SERIES_TERMS = 11
"""Number of terms of the series of artanh and arctan."""
_SQUARE_ROOTS = 10
"""Number of roots that bring any argument of a logarithm near 1."""


class Composed(NamedTuple):
    """Function and operands that an expression represents."""

    name: str
    """Name of the function."""
    operands: tuple[Expr, ...]
    """Operands of the function."""


def tanh(x: Expr) -> Expr:
    """Hyperbolic tangent: (1 - e) / (1 + e) with e = exp(-2 |x|), and the sign of x."""
    e = (-2.0 * abs(x)).exp()
    return _record_function("tanh", x.sign() * ((1.0 - e) / (1.0 + e)), 1.0, x)


def log(x: Expr) -> Expr:
    """Natural logarithm. Roots r of x near 1 give ln r from 2 artanh((r - 1) / (r + 1)); Halley's steps refine it.

    -inf at 0, NaN for negative numbers.
    """
    trace, r = x.trace, x
    for _ in range(_SQUARE_ROOTS):  # then sqrt(1/2) < r < 2
        r = r.sqrt()
    s = (r - 1.0) / (r + 1.0)
    y = 2.0 ** (_SQUARE_ROOTS + 1) * (s * _odd(s * s, 1.0))
    for _ in range(2):
        e = y.exp()
        y = y + (x - e) / trace.max(trace.constant(_MIN_NORMAL), 0.5 * x + 0.5 * e)
    at_zero = 1.0 - 1.0 / x.sign()  # 0 for x > 0, -inf at 0
    return _record_function("log", y + at_zero, _MAX_FLOAT, x)


def arctan2(y: Expr, x: Expr) -> Expr:
    """Angle of the point (x, y), from -pi to pi; 0 at the origin. Abramowitz and Stegun (1964), section 4.4."""
    trace, h, w = y.trace, abs(y), abs(x)
    longer = trace.max(h, w)
    t: Any = trace.min(h, w) / trace.max(trace.constant(_MIN_NORMAL), longer)
    for _ in range(2):  # half the angle, twice: t < tan(pi / 16)
        t = t / (1.0 + (1.0 + t * t).sqrt())
    angle = 4.0 * (t * _odd(t * t, -1.0))
    steep, back = 0.5 + 0.5 * (h - w).sign(), 0.5 - 0.5 * x.sign()
    angle = angle + steep * (0.5 * math.pi - 2.0 * angle)
    angle = angle + back * (math.pi - 2.0 * angle)
    up = y.sign()
    return _record_function("arctan2", (up + (1.0 - up * up)) * (longer.sign() * angle), math.pi, y, x)


def _odd(square: Any, sign: float) -> Any:
    """1 + s z / 3 + z^2 / 5 + s z^3 / 7 + ..., by Horner's scheme: artanh(t) / t or arctan(t) / t at z = t^2."""
    total: Any = 0.0
    for k in reversed(range(_SERIES_TERMS)):
        total = total * square + sign**k / (2 * k + 1)
    return total


def _record_function(name: str, value: Any, maximum: float, *operands: Expr) -> Expr:
    """Value, at most ``maximum``, as an unfolded expression that records the function it computes."""
    trace = operands[0].trace
    expression = trace.min(trace.constant(maximum), trace.lift(value))  # NaN stays NaN
    if expression.op != "const":
        trace.composed[expression.index] = Composed(name, operands)
    return expression
