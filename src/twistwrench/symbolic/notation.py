"""How an expression is written: in plain text, in LaTeX, in MathML, with factors and terms in the order of a book.

Factors: numbers, masses, inertias, lengths, gravity, sines and cosines, sums, rates, accelerations. Terms: those with
accelerations, with rates, without; then by the numbers of the links.
"""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache
from typing import Any
from xml.sax.saxutils import escape

_RANKS = {"G": -0.7, "m": 0, "I": 1, "L": 2, "r": 2, "a": 2, "h": 2, "g": 3, "t": 4.5}
_GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ", "iota": "ι",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ",
    "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ",
    "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω",
}  # fmt: skip
_MARKS = {"ddot": "\u0308", "dot": "\u0307"}
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")  # Unicode has x below the line, but neither y nor z
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def _parts(name: str) -> tuple[str, str, str]:
    """Stem, mark and index of a symbol's name: thetadot_1 → theta, dot, 1."""
    stem, _, index = name.partition("_")
    for mark in _MARKS:
        if stem.endswith(mark) and len(stem) > len(mark):
            return stem[: -len(mark)], mark, index
    return stem, "", index


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
        for term in _ordered(expr):
            negative, factors = _signed(term)
            found.append(("-", self._negated(factors)) if negative else ("+", self._quotient(factors)))
        return found

    def _product(self, expr: Any) -> str:
        negative, factors = _signed(expr)
        return self.minus(self._negated(factors)) if negative else self._quotient(factors)

    def _negated(self, factors: list[Any]) -> str:
        """What stands after a minus: a sum by itself in brackets."""
        inner = self._quotient(factors)
        return self.bracket(inner) if _is_sum(factors) else inner

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
        return self.fraction(self.above(top) if _is_sum(above) else top or "1", self._factors(below))

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
            stem, mark, index = _parts(base.name)
            return ({"": _RANKS.get(stem, 4), "dot": 8, "ddot": 9}[mark], _where(index), base.name)
        if base.is_Add:
            parts = [_parts(s.name) for s in base.free_symbols]
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
        return self.figure(str(x) if x.is_Integer else f"{float(x):.6g}")

    # How things look: in plain text, as in the terminal.

    def symbol(self, name: str) -> str:
        """A symbol: Greek letters, dots for rates, indices."""
        stem, mark, index = _parts(name)
        low = re.sub(r"^r(?=\d)", "ᵣ", index).replace("_", ",").translate(_SUBSCRIPTS)
        return unicodedata.normalize("NFC", _GREEK.get(stem, stem) + (_MARKS[mark] if mark else "")) + low

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
        return head + "".join(f" {self.operator(sign)} {term}" for sign, term in rest)

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


class Latex(Notation):
    """LaTeX for amsmath."""

    def symbol(self, name: str) -> str:
        """A symbol: Greek letters, dots for rates, indices."""
        stem, mark, index = _parts(name)
        letter = f"\\{stem}" if stem in _GREEK else stem if len(stem) == 1 else f"\\mathit{{{stem}}}"
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


class MathML(Notation):
    """Presentation MathML, which browsers show without any script."""

    def symbol(self, name: str) -> str:
        """A symbol: Greek letters, dots for rates, indices."""
        stem, mark, index = _parts(name)
        letter = f"<mi>{escape(_GREEK.get(stem, stem))}</mi>"
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

    def join(self, terms: list[tuple[str, str]]) -> str:
        """A sum."""
        first, *rest = terms
        head = self.minus(first[1]) if first[0] == "-" else first[1]
        return head + "".join(f"<mo>{self.operator(sign)}</mo>{term}" for sign, term in rest)

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


def _factors(expr: Any) -> list[Any]:
    return list(expr.args) if expr.is_Mul else [expr]


def _is_sum(factors: list[Any]) -> bool:
    return len(factors) == 1 and bool(factors[0].is_Add)


def _where(index: str) -> tuple[int, bool]:
    """The number of a link or joint, rotors (r1) after the links of the same number."""
    number = re.match(r"(r?)(\d+)", index)
    return (int(number[2]), bool(number[1])) if number else (0, False)


def _signed(term: Any) -> tuple[bool, list[Any]]:
    """The sign of a term and the factors of its size; of sums among them, the sign of their first term is pulled out."""
    coefficient, rest = term.as_coeff_Mul()
    negative = bool(coefficient.is_negative)
    factors = [] if abs(coefficient) == 1 else [abs(coefficient)]
    for factor in _factors(rest):
        whole = factor.is_Pow and factor.exp.is_Integer and factor.exp.is_positive
        base, power = (factor.base, int(factor.exp)) if whole else (factor, 1)
        if base.is_Add and _signed(_ordered(base)[0])[0]:
            negative ^= bool(power % 2)
            factor = (-base) ** power
        if factor != 1:
            factors.append(factor)
    return negative, factors or [abs(coefficient)]


@lru_cache(maxsize=1 << 14)
def _ordered(expr: Any) -> list[Any]:
    """The terms of a sum in the order of a book."""
    return sorted(expr.as_ordered_terms() if expr.is_Add else [expr], key=_term_key)


def _term_key(term: Any) -> tuple[Any, ...]:
    marks, letters = [0, 0], []
    for symbol in term.free_symbols:
        stem, mark, index = _parts(symbol.name)
        if mark:
            marks[mark == "dot"] += 1
        power = int(next((f.exp for f in _factors(term) if f.is_Pow and f.base == symbol and f.exp.is_Integer), 1))
        letters.append((_where(index), 9 if mark else _RANKS.get(stem, 4), symbol.name, -power))
    return (-min(marks[0], 1), -min(marks[1], 1), tuple(sorted(letters)), str(term) if not letters else "")
