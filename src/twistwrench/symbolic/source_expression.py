"""An expression in the operators that Python and C share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..errors import ValueRangeError


def written(expr: Any, functions: Mapping[str, str]) -> str:
    """An expression in the operators that Python and C share; powers of whole numbers as products.

    ``functions`` maps SymPy's name of each function that the language has to how a call of it looks. ValueRangeError names
    any other, and numbers that no double holds.
    """
    return _Operators(functions).write(expr)


class _Operators:
    def __init__(self, functions: Mapping[str, str]) -> None:
        self.functions = functions

    def write(self, expr: Any) -> str:
        import sympy

        if expr.is_Add:
            return " + ".join(map(self.write, expr.args)).replace("+ -", "- ")
        if expr.is_Mul:
            coefficient, rest = expr.as_coeff_Mul()
            if coefficient == -1:
                return "-" + self._joined(rest)
            return self._joined(expr)
        if expr.is_Pow and expr.exp.is_Integer and 0 < int(expr.exp) <= 8:
            return "*".join([self._factor(expr.base)] * int(expr.exp))
        if expr.is_Pow and expr.exp.is_Integer and int(expr.exp) < 0:
            return f"1.0/{self._divisor(expr.base**-expr.exp)}"
        if expr.is_Symbol:
            return str(expr.name)
        if expr.is_Number or expr.is_NumberSymbol:
            return self._number(expr)
        if expr.is_Pow and expr.exp == sympy.Rational(1, 2):
            return self._call("sqrt", expr.base)
        if expr.is_Pow and expr.exp == sympy.Rational(-1, 2):
            return f"1.0/{self._call('sqrt', expr.base)}"
        if expr.is_Pow:
            return self._call("pow", expr.base, expr.exp)
        return self._call(expr.func.__name__ if expr.args else str(expr), *expr.args)

    def _call(self, name: str, *args: Any) -> str:
        if name not in self.functions:
            known = ", ".join(n for n in self.functions if n != "pow")
            raise ValueRangeError(
                f"{name}, in these equations or the derivatives, cannot be written as source. Allowed are powers and {known}, "
                "of symbols with real=True where Abs is differentiated. Rewrite the Lagrangian in these, or evaluate the "
                "expressions with SymPy."
            )
        return self.functions[name].format(*map(self.write, args))

    def _number(self, x: Any) -> str:
        if not (x.is_finite and math.isfinite(_double(x))):
            raise ValueRangeError(
                f"{str(x)[:40]} cannot be written as source: no double holds it. Scale the Lagrangian."
            )
        if x.is_Rational and not x.is_Integer:
            if max(abs(x.p), x.q) >= 1 << 1000:
                return repr(float(x))
            exact = x.q & (x.q - 1) == 0 and abs(x.p) < 1 << 50
            return repr(float(x)) if exact else f"({x.p}.0/{x.q}.0)"
        return repr(float(x))

    def _joined(self, expr: Any) -> str:
        return "*".join(map(self._factor, expr.args)) if expr.is_Mul else self._factor(expr)

    def _factor(self, expr: Any) -> str:
        text = self.write(expr)
        plain = expr.is_Symbol or expr.is_Function or expr.is_NumberSymbol or (expr.is_Number and not expr.is_negative)
        power = expr.is_Pow and expr.exp.is_Integer and int(expr.exp) > 0
        return text if plain or power else f"({text})"

    def _divisor(self, expr: Any) -> str:
        return self.write(expr) if expr.is_Symbol or expr.is_Function else f"({self.write(expr)})"


def _double(x: Any) -> float:
    try:
        return float(x)
    except OverflowError:
        return math.inf
