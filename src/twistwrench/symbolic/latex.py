"""Expressions in LaTeX."""

from __future__ import annotations

import re
from typing import Any

from .notation import Notation
from .symbol_names import GREEK, name_parts


class Latex(Notation):
    """LaTeX for amsmath."""

    def symbol(self, name: str) -> str:
        """A symbol: Greek letters, dots for rates, indices."""
        stem, mark, index = name_parts(name)
        letter = f"\\{stem}" if stem in GREEK else stem if len(stem) == 1 else f"\\mathit{{{stem}}}"
        letter = f"\\{mark}{{{letter}}}" if mark else letter
        return f"{letter}_{{{index.replace('_', ',')}}}" if index else letter

    def figure(self, digits: str) -> str:
        """A number without a sign."""
        mantissa, _, power = digits.partition("e")
        return f"{mantissa} \\cdot 10^{{{int(power)}}}" if power else digits

    def function(self, name: str, argument: str, power: str = "") -> str:
        """A sine or cosine, or a power of it."""
        raised = f"^{{{power}}}" if power else ""
        return (
            f"\\{name}{raised}{{{argument}}}"
            if re.fullmatch(r"\\?\w+(_\{\w+\})?", argument)
            else (f"\\{name}{raised}({argument})")
        )

    def raised(self, base: str, power: str) -> str:
        """A power."""
        return f"{base}^{{{power}}}"

    def above(self, inner: str) -> str:
        """A sum that something divides: the bar holds it together."""
        return inner

    def fraction(self, top: str, bottom: str) -> str:
        """A quotient."""
        return f"\\frac{{{top}}}{{{bottom}}}" if (top, bottom) != ("1", "2") else "\\tfrac{1}{2}"

    def times(self, factors: list[str]) -> str:
        """A product."""
        return " \\, ".join(factors)

    def minus(self, inner: str) -> str:
        """The negative."""
        return f"-{inner}"

    def operator(self, sign: str) -> str:
        """Plus or minus between terms."""
        return sign

    def matrix(self, rows: list[list[str]]) -> str:
        """A matrix."""
        return "\\begin{bmatrix} " + " \\\\ ".join(" & ".join(row) for row in rows) + " \\end{bmatrix}"

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        """∂top/∂variable, or its rate."""
        return ("\\frac{d}{dt} " if rate else "") + f"\\frac{{\\partial {top}}}{{\\partial {variable}}}"

    def partial(self, variable: str, inner: str) -> str:
        """∂/∂variable of what follows."""
        return f"\\frac{{\\partial}}{{\\partial {variable}}} {inner}"

    def other(self, expr: Any) -> str:
        """What there is no rule for."""
        import sympy

        return str(sympy.latex(expr))
