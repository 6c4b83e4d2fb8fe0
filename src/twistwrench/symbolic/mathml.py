"""Expressions in MathML."""

from __future__ import annotations

from typing import Any
from xml.sax.saxutils import escape

from .notation import Notation
from .symbol_names import GREEK, name_parts


class MathML(Notation):
    """Presentation MathML, which browsers show without any script."""

    def symbol(self, name: str) -> str:
        """A symbol: Greek letters, dots for rates, indices."""
        stem, mark, index = name_parts(name)
        letter = f"<mi>{escape(GREEK.get(stem, stem))}</mi>"
        if mark:
            letter = f'<mover accent="true">{letter}<mo>{"˙" if mark == "dot" else "¨"}</mo></mover>'
        return f"<msub>{letter}<mi>{escape(index.replace('_', ','))}</mi></msub>" if index else letter

    def figure(self, digits: str) -> str:
        """A number without a sign."""
        mantissa, _, power = digits.partition("e")
        if not power:
            return f"<mn>{digits}</mn>"
        return f"<mn>{mantissa}</mn><mo>·</mo><msup><mn>10</mn><mn>{str(int(power)).replace('-', '−')}</mn></msup>"

    def function(self, name: str, argument: str, power: str = "") -> str:
        """A sine or cosine, or a power of it."""
        head = f"<msup><mi>{name}</mi><mn>{power}</mn></msup>" if power else f"<mi>{name}</mi>"
        return f"<mrow>{head}{self.bracket(argument)}</mrow>"

    def raised(self, base: str, power: str) -> str:
        """A power."""
        return f"<msup><mrow>{base}</mrow><mn>{power.replace('-', '−')}</mn></msup>"

    def bracket(self, inner: str) -> str:
        """Parentheses."""
        return f'<mo stretchy="false">(</mo>{inner}<mo stretchy="false">)</mo>'

    def above(self, inner: str) -> str:
        """A sum that something divides: the bar holds it together."""
        return inner

    def fraction(self, top: str, bottom: str) -> str:
        """A quotient."""
        top, bottom = (x if x.startswith("<") else f"<mn>{x}</mn>" for x in (top, bottom))
        return f"<mfrac><mrow>{top}</mrow><mrow>{bottom}</mrow></mfrac>"

    def times(self, factors: list[str]) -> str:
        """A product."""
        return '<mspace width="0.15em"/>'.join(factors)

    def minus(self, inner: str) -> str:
        """The negative."""
        return f'<mo form="prefix">−</mo>{inner}'

    def between(self, sign: str) -> str:
        """Plus or minus with what is around it."""
        return f"<mo>{self.operator(sign)}</mo>"

    def matrix(self, rows: list[list[str]]) -> str:
        """A matrix."""
        inner = "".join("<mtr>" + "".join(f"<mtd>{x}</mtd>" for x in row) + "</mtr>" for row in rows)
        # Drawn brackets, by the page's style: stretched ones need a font with mathematical tables, which many systems lack.
        return f'<mtable class="matrix">{inner}</mtable>'

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        """∂top/∂variable, or its rate."""
        head = "<mfrac><mi>d</mi><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>" if rate else ""
        return f"{head}<mfrac><mrow><mo>∂</mo>{top}</mrow><mrow><mo>∂</mo>{variable}</mrow></mfrac>"

    def partial(self, variable: str, inner: str) -> str:
        """∂/∂variable of what follows."""
        return f"<mfrac><mo>∂</mo><mrow><mo>∂</mo>{variable}</mrow></mfrac>{inner}"

    def other(self, expr: Any) -> str:
        """What there is no rule for."""
        from sympy.printing.mathml import MathMLPresentationPrinter

        return str(MathMLPresentationPrinter().doprint(expr))
