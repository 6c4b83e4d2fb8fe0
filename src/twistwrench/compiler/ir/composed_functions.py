"""Functions that compilation targets lack, composed of operations that all have: tanh, log and arctan2.

Each result is an ordinary expression. A :class:`Composed` records the function that it computes, so that the chain rule uses
the derivative of the function in place of that of the formula. In double precision, errors are below 1e-15: absolute for
results below 1, relative for others.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .expr import Expr

_MAX_LOG = 710.0
"""Bound of logarithms in double precision, ln 1.8e308 = 709.8. Single precision holds it, too."""
_MIN_NORMAL = float(np.finfo(float).tiny)
_SERIES_TERM_COUNT = 11
"""Number of terms of the series of artanh, for arguments below 1/3, and of arctan, for arguments below tan(pi/16) = 0.2."""
_SQUARE_ROOT_COUNT = 10
"""Number of square roots in sequence that bring any argument of a logarithm between 1/2 and 2."""


class Composed(NamedTuple):
    """Function and operands that an expression represents."""

    name: str
    """Name of the function."""
    operands: tuple[Expr, ...]
    """Operands of the function."""


def tanh(x: Expr) -> Expr:
    """Hyperbolic tangent: (1 - e) / (1 + e) with e = exp(-2 |x|), and the sign of x."""
    e = (-2.0 * abs(x)).exp()
    value = x.sign() * ((1.0 - e) / (1.0 + e))
    return _record_function("tanh", value, 1.0, x)


def log(x: Expr) -> Expr:
    """Natural logarithm; -inf at 0, NaN for negative numbers.

    Ten square roots in sequence give r = x^(1/1024) near 1. Then ln x = 1024 ln r, ln r = 2 artanh s and s = (r - 1) / (r + 1).
    Two steps of Halley's method for exp(y) = x, y := y + 2 (x - exp(y)) / (x + exp(y)), remove the rounding errors.
    """
    trace = x.trace
    r = x
    for _ in range(_SQUARE_ROOT_COUNT):
        r = r.sqrt()  # at the end, sqrt(1/2) < r < 2
    s = (r - 1.0) / (r + 1.0)
    artanh_s = s * _odd_series(s * s, 1.0)
    y = 2.0 ** (_SQUARE_ROOT_COUNT + 1) * artanh_s
    for _ in range(2):
        e = y.exp()
        y = y + (x - e) / trace.max(trace.constant(_MIN_NORMAL), 0.5 * x + 0.5 * e)
    sign = x.sign()
    at_zero = 1.0 - 1.0 / (sign * sign)  # 0 except at 0, where it is -inf; the sign of -0.0 is -0.0
    return _record_function("log", y + at_zero, _MAX_LOG, x)


def arctan2(y: Expr, x: Expr) -> Expr:
    """Angle of the point (x, y), from -pi to pi; 0 at the origin. Abramowitz and Stegun (1964), section 4.4.

    The angle between (|x|, |y|) and the nearer axis has the tangent t = shorter / longer side. The half-angle formula,
    applied twice, makes t smaller. Reflections then bring the angle into the octant of (x, y).
    """
    trace = y.trace
    height, width = abs(y), abs(x)
    longer = trace.max(height, width)
    t: Any = trace.min(height, width) / trace.max(trace.constant(_MIN_NORMAL), longer)
    for _ in range(2):  # tan(a / 2) = tan a / (1 + sqrt(1 + tan^2 a)); then t < tan(pi / 16)
        t = t / (1.0 + (1.0 + t * t).sqrt())
    angle = 4.0 * (t * _odd_series(t * t, -1.0))
    # 0 or 1; 1/2 on the line in which the angle is reflected, where it stays
    is_steep = 0.5 + 0.5 * (height - width).sign()
    is_left = 0.5 - 0.5 * x.sign()
    angle = angle + is_steep * (0.5 * math.pi - 2.0 * angle)  # pi / 2 - angle if steep
    angle = angle + is_left * (math.pi - 2.0 * angle)  # pi - angle if on the left
    sign_y = y.sign()
    sign_of_angle = sign_y + (1.0 - sign_y * sign_y)  # 1 for y = 0 too
    return _record_function("arctan2", sign_of_angle * (longer.sign() * angle), math.pi, y, x)


def _odd_series(square: Any, sign: float) -> Any:
    """Series 1 + s z / 3 + z^2 / 5 + s z^3 / 7 + ... at z = ``square``, with s = ``sign``, by Horner's scheme.

    At z = t^2 it is artanh(t) / t for s = 1, and arctan(t) / t for s = -1.
    """
    total: Any = 0.0
    for k in reversed(range(_SERIES_TERM_COUNT)):
        total = total * square + sign**k / (2 * k + 1)
    return total


def _record_function(name: str, value: Any, maximum: float, *operands: Expr) -> Expr:
    """Expression of a function's value, with the function recorded in its trace.

    ``value`` may be an expression that is used elsewhere, too. Its minimum with ``maximum``, a bound of the function, is a
    new expression.
    """
    trace = operands[0].trace
    expression = trace.min(trace.constant(maximum), trace.lift(value))  # NaN stays NaN
    if expression.op != "const":
        trace.composed[expression.index] = Composed(name, operands)
    return expression
