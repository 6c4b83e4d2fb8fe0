"""Derivation as a web page with formulas in MathML."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

from ..core.numbers import printed
from .documents import heading, remarks_of, sentence
from .names import GREEK, Notation, name_parts

if TYPE_CHECKING:
    from .equations import Equations, Step


_ACCENTS = {"dot": "˙", "ddot": "¨"}
"""Characters above a letter, by the mark of a name."""


class MathML(Notation):
    """Presentation MathML, which browsers display without scripts."""

    def symbol(self, name: str) -> str:
        stem, mark, index = name_parts(name)
        letter = f"<mi>{escape(GREEK.get(stem, stem))}</mi>"
        if mark:
            letter = f'<mover accent="true">{letter}<mo>{_ACCENTS[mark]}</mo></mover>'
        if not index:
            return letter
        return f"<msub>{letter}<mi>{escape(index.replace('_', ','))}</mi></msub>"

    def figure(self, digits: str) -> str:
        mantissa, _, power = digits.partition("e")
        if not power:
            return f"<mn>{digits}</mn>"
        exponent = str(int(power)).replace("-", "−")
        return f"<mn>{mantissa}</mn><mo>·</mo><msup><mn>10</mn><mn>{exponent}</mn></msup>"

    def function(self, name: str, argument: str, power: str = "") -> str:
        function = f"<mi>{name}</mi>"
        if power:
            function = f"<msup>{function}<mn>{power}</mn></msup>"
        return f"<mrow>{function}{self.bracket(argument)}</mrow>"

    def superscript(self, base: str, power: str) -> str:
        return f"<msup><mrow>{base}</mrow><mn>{power.replace('-', '−')}</mn></msup>"

    def bracket(self, inner: str) -> str:
        return f'<mo stretchy="false">(</mo>{inner}<mo stretchy="false">)</mo>'

    def above(self, inner: str) -> str:
        return inner

    def fraction(self, top: str, bottom: str) -> str:
        return f"<mfrac><mrow>{_element(top)}</mrow><mrow>{_element(bottom)}</mrow></mfrac>"

    def times(self, factors: list[str]) -> str:
        return '<mspace width="0.15em"/>'.join(factors)

    def minus(self, inner: str) -> str:
        return f'<mo form="prefix">−</mo>{inner}'

    def between(self, sign: str) -> str:
        return f"<mo>{self.operator(sign)}</mo>"

    def matrix(self, rows: list[list[str]]) -> str:
        row_elements = []
        for row in rows:
            cells = "".join(f"<mtd>{entry}</mtd>" for entry in row)
            row_elements.append(f"<mtr>{cells}</mtr>")
        # The style sheet draws the brackets: stretched brackets need a mathematical font, which many systems lack.
        return f'<mtable class="matrix">{"".join(row_elements)}</mtable>'

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        derivative = f"<mfrac><mrow><mo>∂</mo>{top}</mrow><mrow><mo>∂</mo>{variable}</mrow></mfrac>"
        if rate:
            return f"<mfrac><mi>d</mi><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>{derivative}"
        return derivative

    def partial(self, variable: str, inner: str) -> str:
        return f"<mfrac><mo>∂</mo><mrow><mo>∂</mo>{variable}</mrow></mfrac>{inner}"

    def other(self, expr: Any) -> str:
        from sympy.printing.mathml import MathMLPresentationPrinter

        return str(MathMLPresentationPrinter().doprint(expr))


def _element(text: str) -> str:
    """MathML element; a text that is not an element, such as the 1 of ½, becomes a number."""
    if text.startswith("<"):
        return text
    return f"<mn>{text}</mn>"


_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin-bottom: .4rem; } h2 { font-size: 1.15rem; margin: 1.8rem 0 .2rem; }
p.remark, p.check { margin: 0 0 .6rem; opacity: .75; }
nav a { margin-right: .9rem; white-space: nowrap; }
table.symbols { border-collapse: collapse; font-size: .92rem; margin: 1rem 0; }
table.symbols td { padding: .15rem 1rem .15rem 0; border-bottom: 1px solid #8883; vertical-align: baseline; }
table.symbols td:last-child { text-align: right; font-variant-numeric: tabular-nums; }
.line { margin: .45rem 0 .45rem 2.5rem; text-indent: -2.5rem; line-height: 1.9; }
math { text-indent: 0; font-size: 1.06rem; }
mtable.matrix { border: solid currentColor; border-width: 0 1.5px; padding: .1em .25em; margin: 0 .15em;
  background: linear-gradient(currentColor 0 0) 0 0, linear-gradient(currentColor 0 0) 100% 0,
    linear-gradient(currentColor 0 0) 0 100%, linear-gradient(currentColor 0 0) 100% 100%;
  background-size: .35em 1.5px; background-repeat: no-repeat; }
"""


def html_page(equations: Equations, steps: tuple[Step, ...]) -> str:
    """HTML page of a derivation with these steps; sums are split at their terms, so that browsers break lines there."""
    notation = MathML()
    title = f"Equations of motion of {escape(equations.name)}"
    remarks = [f'<p class="check">{escape(text)}</p>' for text in remarks_of(equations)]
    links = [f'<a href="#{step.name}">{escape(heading(step))}</a>' for step in steps]
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{title}</h1>",
        *remarks,
        f"<nav>{' '.join(links)}</nav>",
        _symbol_table(equations, notation),
    ]
    for step in steps:
        remark = f'<p class="remark">{escape(sentence(step.remark))}</p>'
        parts.append(f'<section id="{step.name}"><h2>{escape(heading(step))}</h2>{remark}')
        for label, expr in step.lines:
            parts.append(_line(label.write(notation), expr, notation))
        parts.append("</section>")
    parts.append("</body></html>")
    return "\n".join(filter(None, parts)) + "\n"  # without an empty table


def _symbol_table(equations: Equations, notation: MathML) -> str:
    """Table of symbols, meanings and values; empty if there are no symbols with a meaning."""
    coordinate_rows = [(name, meaning, "") for name, meaning in equations.meanings]  # without a value
    parameter_rows = [
        (parameter.name, parameter.meaning, printed(parameter.value)) for parameter in equations.parameters
    ]
    rows = coordinate_rows + parameter_rows
    if not rows:
        return ""
    row_elements = ""
    for name, meaning, value in rows:
        symbol = f"<math>{notation.symbol(name)}</math>"
        row_elements += f"<tr><td>{symbol}</td><td>{escape(meaning)}</td><td>{value}</td></tr>"
    return f'<table class="symbols">{row_elements}</table>'


def _line(left: str, expr: Any, notation: MathML) -> str:
    """Equation as a line of the page. Each term of a sum is a formula, since browsers break lines between formulas."""
    if not getattr(expr, "is_Add", False):
        return f'<div class="line"><math>{left}<mo>=</mo>{notation.write(expr)}</math></div>'
    signs_and_terms = notation.terms(expr)
    first_sign, first_term = signs_and_terms[0]
    if first_sign == "-":
        first_term = notation.minus(first_term)
    formulas = [f"<math>{left}<mo>=</mo>{first_term}</math>"]
    for sign, term in signs_and_terms[1:]:
        formulas.append(f'<math><mo form="infix">{notation.operator(sign)}</mo>{term}</math>')
    return f'<div class="line">{" ".join(formulas)}</div>'
