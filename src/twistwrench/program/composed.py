"""Functions that targets do not have, made of those they have: tanh, log and arctan2.

Each result is an ordinary expression, so every target computes it, and a :class:`Composed` tells the chain rule what it is:
its derivative is the function's own, not that of the formula that computes it. Errors are below 1e-15, of 1 where the
function is smaller, in double precision.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .expr import Expr

_LARGEST = float(np.finfo(float).max)
_SMALLEST = float(np.finfo(float).tiny)
_TERMS = 11
_ROOTS = 10


class Composed(NamedTuple):
    """What an expression computes."""

    name: str
    """The function."""
    operands: tuple[Expr, ...]
    """What it is applied to."""


def tanh(x: Expr) -> Expr:
    """(1 - e) / (1 + e) with e = exp(-2 |x|), and the sign of x."""
    e = (-2.0 * abs(x)).exp()
    return _noted("tanh", x.sign() * ((1.0 - e) / (1.0 + e)), 1.0, x)


def log(x: Expr) -> Expr:
    """Natural logarithm: roots bring x near 1, where 2 artanh((r - 1) / (r + 1)) is about ln r; Halley's step does the rest.

    Of 0 it is -inf, of negative numbers NaN.
    """
    trace, r = x.trace, x
    for _ in range(_ROOTS):  # then sqrt(1/2) < r < 2
        r = r.sqrt()
    s = (r - 1.0) / (r + 1.0)
    y = 2.0 ** (_ROOTS + 1) * (s * _odd(s * s, 1.0))
    for _ in range(2):
        e = y.exp()
        y = y + (x - e) / trace.max(trace.constant(_SMALLEST), 0.5 * x + 0.5 * e)
    at_zero = 1.0 - 1.0 / x.sign()  # 0 where x > 0, -inf at 0
    return _noted("log", y + at_zero, _LARGEST, x)


def arctan2(y: Expr, x: Expr) -> Expr:
    """The angle of the point (x, y), from -pi to pi; 0 at the origin. Abramowitz and Stegun (1964), section 4.4."""
    trace, h, w = y.trace, abs(y), abs(x)
    longer = trace.max(h, w)
    t: Any = trace.min(h, w) / trace.max(trace.constant(_SMALLEST), longer)
    for _ in range(2):  # half the angle, twice: t < tan(pi / 16)
        t = t / (1.0 + (1.0 + t * t).sqrt())
    angle = 4.0 * (t * _odd(t * t, -1.0))
    steep, back = 0.5 + 0.5 * (h - w).sign(), 0.5 - 0.5 * x.sign()
    angle = angle + steep * (0.5 * math.pi - 2.0 * angle)
    angle = angle + back * (math.pi - 2.0 * angle)
    up = y.sign()
    return _noted("arctan2", (up + (1.0 - up * up)) * (longer.sign() * angle), math.pi, y, x)


def _odd(square: Any, sign: float) -> Any:
    """1 + s z / 3 + z^2 / 5 + s z^3 / 7 + ..., by Horner's scheme: artanh(t) / t or arctan(t) / t at z = t^2."""
    total: Any = 0.0
    for k in reversed(range(_TERMS)):
        total = total * square + sign**k / (2 * k + 1)
    return total


def _noted(name: str, value: Any, most: float, *operands: Expr) -> Expr:
    """The value, none above ``most``, as an expression that no folding looks into, with what it is."""
    trace = operands[0].trace
    found = trace.min(trace.constant(most), trace.lift(value))  # so that NaN stays NaN
    if found.op != "const":
        trace.composed[found.index] = Composed(name, operands)
    return found
