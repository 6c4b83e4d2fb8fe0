"""How an expression is written: in plain text, in LaTeX, in MathML, with factors and terms in the order of a book.

Factors: numbers, masses, inertias, lengths, gravity, sines and cosines, sums, rates, accelerations. Terms: those with
accelerations, with rates, without; then by the numbers of the links.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Any

from ..core.printed_numbers import printed
from .symbol_names import GREEK, MARKS, link_number, name_parts
from .term_order import RANKS, is_sum, ordered_terms, signed_factors

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")  # Unicode has x below the line, but neither y nor z
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class Notation:
    """The order in which things are written. What follows says how they look."""

    def write(self, expr: Any) -> str:
        """An expression, a column or a matrix."""
        import sympy

        if isinstance(expr, sympy.MatrixBase):
            return self.matrix([[self.write(x) for x in row] for row in expr.tolist()])
        if expr.is_Add:
            return self.join(self.terms(expr))
        if expr.is_Mul:
            return self._product(expr)
        if expr.is_Symbol:
            return self.symbol(expr.name)
        if expr.is_Number:
            return self._number(expr)
        if expr.is_Pow:
            return self._power(expr)
        if expr.func.__name__ in ("sin", "cos"):
            return self.function(expr.func.__name__, self.write(expr.args[0]))
        return self.other(expr)

    def terms(self, expr: Any) -> list[tuple[str, str]]:
        """The terms of a sum, each with its sign."""
        found = []
        for term in ordered_terms(expr):
            negative, factors = signed_factors(term)
            found.append(("-", self._negated(factors)) if negative else ("+", self._quotient(factors)))
        return found

    def _product(self, expr: Any) -> str:
        negative, factors = signed_factors(expr)
        return self.minus(self._negated(factors)) if negative else self._quotient(factors)

    def _negated(self, factors: list[Any]) -> str:
        """What stands after a minus: a sum by itself in brackets."""
        inner = self._quotient(factors)
        return self.bracket(inner) if is_sum(factors) else inner

    def _quotient(self, factors: list[Any]) -> str:
        above: list[Any] = []
        below: list[Any] = []
        for factor in factors:
            if factor.is_Pow and factor.exp.is_Number and factor.exp.is_negative:
                below.append(factor.base**-factor.exp)
            else:
                above.append(factor)
        top = self._factors(above)
        if not below:
            return top
        return self.fraction(self.above(top) if is_sum(above) else top or "1", self._factors(below))

    def _factors(self, factors: list[Any]) -> str:
        ordered = sorted(factors, key=self._factor_key)
        alone = len(ordered) == 1
        return self.times([self.write(f) if alone or not f.is_Add else self.bracket(self.write(f)) for f in ordered])

    def _factor_key(self, factor: Any) -> tuple[Any, ...]:
        import sympy

        base = factor.base if factor.is_Pow else factor
        if base.is_Number:
            return (-1, 0, "")
        if base.is_Symbol:
            stem, mark, index = name_parts(base.name)
            return ({"": RANKS.get(stem, 4), "dot": 8, "ddot": 9}[mark], link_number(index), base.name)
        if base.is_Add:
            parts = [name_parts(s.name) for s in base.free_symbols]
            if any(mark for _, mark, _ in parts):
                return (7, 0, str(base))
            heavy = any(stem in ("m", "I") for stem, _, _ in parts) and not base.has(sympy.sin, sympy.cos)
            return (-0.5 if heavy else 5, 0, str(base))
        return (6, 0, str(base))

    def _power(self, expr: Any) -> str:
        if expr.exp.is_Number and expr.exp.is_negative:
            return self.fraction("1", self.write(expr.base**-expr.exp))
        if not expr.exp.is_Integer:
            return self.other(expr)
        if expr.base.func.__name__ in ("sin", "cos"):
            return self.function(expr.base.func.__name__, self.write(expr.base.args[0]), str(expr.exp))
        base = self.write(expr.base)
        return self.raised(base if expr.base.is_Symbol else self.bracket(base), str(expr.exp))

    def _number(self, x: Any) -> str:
        if x.is_negative:
            return self.minus(self._number(-x))
        if x.is_Rational and not x.is_Integer:
            return self.fraction(self.figure(str(x.p)), self.figure(str(x.q)))
        return self.figure(str(x) if x.is_Integer else f"{printed(float(x))}")

    # How things look: in plain text, as in the terminal.

    def symbol(self, name: str) -> str:
        """A symbol: Greek letters, dots for rates, indices."""
        stem, mark, index = name_parts(name)
        low = re.sub(r"^r(?=\d)", "ᵣ", index).replace("_", ",").translate(_SUBSCRIPTS)
        return unicodedata.normalize("NFC", GREEK.get(stem, stem) + (MARKS[mark] if mark else "")) + low

    def figure(self, digits: str) -> str:
        """A number without a sign."""
        return digits

    def function(self, name: str, argument: str, power: str = "") -> str:
        """A sine or cosine, or a power of it."""
        return f"{name}{power.translate(_SUPERSCRIPTS)}({argument})"

    def raised(self, base: str, power: str) -> str:
        """A power."""
        return base + power.translate(_SUPERSCRIPTS)

    def bracket(self, inner: str) -> str:
        """Parentheses."""
        return f"({inner})"

    def above(self, inner: str) -> str:
        """A sum that something divides."""
        return self.bracket(inner)

    def fraction(self, top: str, bottom: str) -> str:
        """A quotient."""
        halves = {("1", "2"): "½", ("1", "4"): "¼", ("3", "4"): "¾"}
        return halves.get((top, bottom)) or f"{top}/{f'({bottom})' if ' ' in bottom else bottom}"

    def times(self, factors: list[str]) -> str:
        """A product."""
        return " ".join(factors)

    def minus(self, inner: str) -> str:
        """The negative."""
        return f"−{inner}"

    def join(self, terms: list[tuple[str, str]]) -> str:
        """A sum."""
        first, *rest = terms
        head = self.minus(first[1]) if first[0] == "-" else first[1]
        return head + "".join(self.between(sign) + term for sign, term in rest)

    def between(self, sign: str) -> str:
        """Plus or minus with what is around it."""
        return f" {self.operator(sign)} "

    def operator(self, sign: str) -> str:
        """Plus or minus between terms."""
        return "−" if sign == "-" else "+"

    def matrix(self, rows: list[list[str]]) -> str:
        """A matrix; columns lie down, in parentheses."""
        if all(len(row) == 1 for row in rows):
            return "(" + ", ".join(row[0] for row in rows) + ")"
        return "[" + "; ".join(", ".join(row) for row in rows) + "]"

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        """∂top/∂variable, or its rate."""
        return f"{'d/dt ' if rate else ''}∂{top}/∂{variable}"

    def partial(self, variable: str, inner: str) -> str:
        """∂/∂variable of what follows."""
        return f"∂/∂{variable} {inner}"

    def other(self, expr: Any) -> str:
        """What there is no rule for."""
        return str(expr)


class Text(Notation):
    """Plain text with Greek letters and indices."""
