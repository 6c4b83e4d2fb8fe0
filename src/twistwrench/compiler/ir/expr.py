"""Symbols that record the arithmetic applied to them.

An :class:`Expr` belongs to one :class:`~twistwrench.compiler.ir.tracer.Trace`, which stores each distinct expression once and
folds constants immediately. Expressions are elements of NumPy object arrays, so algorithms written with NumPy operators run on
them unchanged: ``np.sin`` of an object array calls each element's ``.sin()``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .composed_functions import arctan2, log, tanh

if TYPE_CHECKING:
    from .tracer import Trace


class Expr:
    """Value of a traced program. Equal expressions of one trace are the same object."""

    # The operation op has the operands a and b; b, or both, are None if it has fewer. value is the value of a constant, and
    # index is the number of the expression in its trace.
    __slots__ = ("a", "b", "index", "op", "trace", "value")
    __array_priority__ = 1000.0  # NumPy scalars and arrays use the operators below instead of their own

    def __init__(self, trace: Trace, op: str, a: Expr | None, b: Expr | None, value: float, index: int) -> None:
        self.trace = trace
        self.op = op
        self.a = a
        self.b = b
        self.value = value
        self.index = index

    def __repr__(self) -> str:
        return f"Expr(%{self.index} = {self.op})"

    # Tracing a humanoid makes a hundred thousand of these calls, so each operator takes the shortest path.

    def __add__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return _elementwise(np.add, self, other)
        return self.trace.add(self, other if type(other) is Expr else self.trace.lift(other))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return _elementwise(np.subtract, self, other)
        return self.trace.sub(self, other if type(other) is Expr else self.trace.lift(other))

    def __rsub__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return _elementwise(np.subtract, other, self)
        return self.trace.sub(self.trace.lift(other), self)

    def __mul__(self, other: Any) -> Any:
        if type(other) is Expr:
            return self.trace.mul(self, other)
        if isinstance(other, np.ndarray):
            return _elementwise(np.multiply, self, other)
        return self.trace.scale(float(other), self)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return _elementwise(np.divide, self, other)
        return self.trace.div(self, self.trace.lift(other))

    def __rtruediv__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return _elementwise(np.divide, other, self)
        return self.trace.div(self.trace.lift(other), self)

    def __neg__(self) -> Expr:
        return self.trace.neg(self)

    def __pos__(self) -> Expr:
        return self

    def __abs__(self) -> Any:
        return self * self.sign()

    def __pow__(self, power: Any) -> Any:
        """Power: by products and a square root for integer and half-integer exponents, else by exp and log (positive bases)."""
        if isinstance(power, np.ndarray):
            return _elementwise(np.power, self, power)
        if isinstance(power, Expr):
            return (power * self.log()).exp()
        is_number = isinstance(power, int | float | np.number)
        if not is_number or not abs(float(power)) <= _MAX_POWER:
            raise TypeError(f"a traced value to the power of {power!r}: powers up to {_MAX_POWER} can be traced.")
        double_power = 2 * float(power)
        is_half_integer = double_power == int(double_power)
        if not is_half_integer:
            return (float(power) * self.log()).exp()
        if double_power < 0:
            return 1.0 / self ** (-power)
        exponent, has_half = divmod(int(double_power), 2)
        result = self.sqrt() if has_half else self.trace.one
        factor = self  # x, x², x⁴, …: one for each binary digit of the exponent, from the lowest
        while exponent:
            if exponent & 1:
                result = result * factor
            factor = factor * factor
            exponent >>= 1
        return result

    def __rpow__(self, base: Any) -> Any:
        if isinstance(base, np.ndarray):
            return _elementwise(np.power, base, self)
        return self.trace.lift(base) ** self

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        raise TypeError("traced values cannot be compared: an algorithm must not branch on the robot's state.")

    __hash__ = object.__hash__

    def __bool__(self) -> bool:
        raise TypeError("a traced value has no truth: an algorithm must not branch on the robot's state.")

    def conjugate(self) -> Expr:
        """The value itself, which is real; called by NumPy's ``vecdot`` and others."""
        return self

    def sin(self) -> Expr:
        """Sine; called by ``np.sin``."""
        return self.trace.sin(self)

    def cos(self) -> Expr:
        """Cosine; called by ``np.cos``."""
        return self.trace.cos(self)

    def turned(self, by: Any) -> Expr:
        """Angle plus the angle ``by``; sine and cosine of the sum follow from sines and cosines of both angles."""
        return self.trace.turned(self, self.trace.lift(by))

    def sqrt(self) -> Expr:
        """Square root; called by ``np.sqrt``."""
        return self.trace.sqrt(self)

    def tan(self) -> Any:
        """Tangent; called by ``np.tan``."""
        return self.sin() / self.cos()

    def exp(self) -> Expr:
        """Exponential; called by ``np.exp``."""
        return self.trace.exp(self)

    def log(self) -> Expr:
        """Natural logarithm; called by ``np.log``."""
        return log(self)

    def tanh(self) -> Expr:
        """Hyperbolic tangent; called by ``np.tanh``."""
        return tanh(self)

    def arctan(self) -> Expr:
        """Arc tangent; called by ``np.arctan``."""
        return arctan2(self, self.trace.one)

    def arctan2(self, x: Any) -> Expr:
        """Angle of the point (x, the value); called by ``np.arctan2``."""
        return arctan2(self, self.trace.lift(x))

    def hypot(self, other: Any) -> Any:
        """Root of the sum of two squares; called by ``np.hypot``. Its derivative at 0 is NaN."""
        return (self * self + other * other).sqrt()

    def clip(self, lower: Any, upper: Any) -> Expr:
        """Value clipped to the limits; NaN stays NaN."""
        trace = self.trace
        return trace.max(trace.lift(lower), trace.min(trace.lift(upper), self))

    def sign(self) -> Expr:
        """Sign: -1, 0 or 1."""
        return self.trace.sign(self)


_MAX_POWER = 64
"""Largest magnitude of a power that is traced."""


def _elementwise(ufunc: np.ufunc, a: Any, b: Any) -> Any:
    """Apply ``ufunc`` to a symbol and every element of an array.

    The symbol is wrapped in an array of no dimensions: NumPy would pass a bare symbol back to its operators.
    """
    wrapped = np.empty((), object)
    if isinstance(a, Expr):
        wrapped[()] = a
        return ufunc(wrapped, b.astype(object))
    wrapped[()] = b
    return ufunc(a.astype(object), wrapped)
