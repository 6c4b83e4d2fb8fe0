"""Symbols and notation: rounded constants, symbol names, order of factors, and plain text."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from ..core.errors import MissingExtraError
from ..core.numbers import printed
from ..core.third_party import lazy_module

sympy: Any = lazy_module("sympy")


def require_sympy(purpose: str = "Deriving equations") -> None:
    """Raise MissingExtraError unless SymPy is installed."""
    try:
        import sympy  # noqa: F401  availability check only
    except ImportError:
        raise MissingExtraError.from_extra("sympy", "symbolic", purpose) from None


def names_of(entries: Iterable[Any]) -> list[str]:
    """Names of objects that have a name: symbols, parameters, coordinates or steps."""
    return [entry.name for entry in entries]


_ROUND_OFF = 4e-16
"""Relative rounding error of a few operations: two units in the last place."""
_MAX_DIGITS = 16
"""Largest number of digits of a shortened number."""


def shortest(value: float, scale: float = 0.0) -> float:
    """Shortest decimal that equals the value up to rounding errors.

    For differences of large numbers, ``scale`` is the size of the operands, to which rounding errors are relative.

    >>> shortest(0.010000000000000002), shortest(0.1 + 0.2), shortest(1 / 3)
    (0.01, 0.3, 0.3333333333333333)
    """
    value = float(value)
    max_error = _ROUND_OFF * max(abs(value), scale)
    for digits in range(1, _MAX_DIGITS + 1):
        rounded = float(f"{value:.{digits}g}")
        if abs(rounded - value) <= max_error:
            return rounded
    return value


# ── Parts of a symbol's name: letter, dots, index

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ", "iota": "ι",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ",
    "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ",
    "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω",
}  # fmt: skip

MARKS = {"ddot": "\u0308", "dot": "\u0307"}  # combining dots above the letter; ddot first, since it also ends in "dot"


def name_parts(name: str) -> tuple[str, str, str]:
    """Stem, mark and index of a symbol's name: thetadot_1 → theta, dot, 1."""
    stem, _, index = name.partition("_")
    for mark in MARKS:
        if stem.endswith(mark) and len(stem) > len(mark):
            return stem[: -len(mark)], mark, index
    return stem, "", index


def link_number(index: str) -> tuple[int, bool]:
    """Number in the index of a link, joint or rotor (r1), 0 for others; and True for a rotor, which sorts after its link."""
    match = re.match(r"(?P<rotor>r?)(?P<number>\d+)", index)
    if match is None:
        return 0, False
    return int(match["number"]), bool(match["rotor"])


# ── Order of factors and terms

# Order of factors: numbers, masses, inertias, lengths, gravity, sines and cosines, sums, rates, accelerations. Order of
# terms: those with accelerations, those with rates, others; then by link number.

RANKS = {"G": -0.7, "m": 0, "I": 1, "L": 2, "r": 2, "a": 2, "h": 2, "g": 3, "t": 4.5}
"""Rank of a symbol among the factors of a product, by its stem."""
_OTHER_RANK = 4
"""Rank of symbols with other stems."""


def _factors(expr: Any) -> list[Any]:
    """Factors of a product; a single factor for other expressions."""
    return list(expr.args) if expr.is_Mul else [expr]


def is_sum(factors: list[Any]) -> bool:
    """True for a single factor that is a sum."""
    return len(factors) == 1 and bool(factors[0].is_Add)


def signed_factors(term: Any) -> tuple[bool, list[Any]]:
    """True for a negative term, and its factors without sign; the first term of a sum among the factors is positive."""
    coefficient, symbolic_part = term.as_coeff_Mul()
    is_negative = bool(coefficient.is_negative)
    factors = []
    if abs(coefficient) not in (1, 1.0):  # SymPy tells them apart
        factors.append(abs(coefficient))
    for factor in _factors(symbolic_part):
        base, power = factor, 1
        if factor.is_Pow and factor.exp.is_Integer and factor.exp.is_positive:
            base, power = factor.base, int(factor.exp)
        if base.is_Add:
            first_term = ordered_terms(base)[0]
            first_is_negative, _ = signed_factors(first_term)
            if first_is_negative:
                is_negative ^= bool(power % 2)  # (-1)^power changes the sign if the power is odd
                factor = (-base) ** power
        if factor != 1:
            factors.append(factor)
    return is_negative, factors or [abs(coefficient)]


@lru_cache(maxsize=1 << 14)
def ordered_terms(expr: Any) -> list[Any]:
    """Terms of a sum in textbook order."""
    if not expr.is_Add:
        return [expr]
    return sorted(expr.as_ordered_terms(), key=_term_key)


def _exponent(term: Any, symbol: Any) -> int:
    """Integer power of a symbol in a term; 1 if its power is not an integer."""
    for factor in _factors(term):
        if factor.is_Pow and factor.base == symbol and factor.exp.is_Integer:
            return int(factor.exp)
    return 1


def _term_key(term: Any) -> tuple[Any, ...]:
    """Sort key of a term in a sum; numbers sort by their text."""
    marks, symbol_keys = set(), []
    for symbol in term.free_symbols:
        stem, mark, index = name_parts(symbol.name)
        marks.add(mark)
        rank = 9 if mark else RANKS.get(stem, _OTHER_RANK)
        symbol_keys.append((link_number(index), rank, symbol.name, -_exponent(term, symbol)))
    number_text = "" if symbol_keys else str(term)
    without_acceleration, without_rate = "ddot" not in marks, "dot" not in marks
    return (without_acceleration, without_rate, tuple(sorted(symbol_keys)), number_text)


# ── Notations: plain text, and the base of LaTeX and MathML

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")  # Unicode has a subscript x, but not y and z
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class Notation:
    """Writer of expressions as plain text; subclasses for LaTeX and MathML keep the order and define the appearance."""

    def write(self, expr: Any) -> str:
        """Text of an expression, a column or a matrix."""
        if isinstance(expr, sympy.MatrixBase):
            return self.matrix([list(map(self.write, row)) for row in expr.tolist()])
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
        """Terms of a sum, each as (sign, text)."""
        terms = []
        for term in ordered_terms(expr):
            is_negative, factors = signed_factors(term)
            if is_negative:
                terms.append(("-", self._operand_of_minus(factors)))
            else:
                terms.append(("+", self._quotient(factors)))
        return terms

    def _product(self, expr: Any) -> str:
        """Text of a product with its sign."""
        is_negative, factors = signed_factors(expr)
        if is_negative:
            return self.minus(self._operand_of_minus(factors))
        return self._quotient(factors)

    def _operand_of_minus(self, factors: list[Any]) -> str:
        """Operand of a minus sign; a sum is put in brackets."""
        operand = self._quotient(factors)
        return self.bracket(operand) if is_sum(factors) else operand

    def _quotient(self, factors: list[Any]) -> str:
        """Product, or a fraction if some factors have negative powers."""
        numerator: list[Any] = []
        denominator: list[Any] = []
        for factor in factors:
            if factor.is_Pow and factor.exp.is_Number and factor.exp.is_negative:
                denominator.append(factor.base**-factor.exp)
            else:
                numerator.append(factor)
        top = self._factors(numerator)
        if not denominator:
            return top
        if is_sum(numerator):
            top = self.above(top)
        return self.fraction(top or "1", self._factors(denominator))

    def _factors(self, factors: list[Any]) -> str:
        """Text of factors in textbook order; sums among several factors are put in brackets."""
        texts = []
        for factor in sorted(factors, key=self._factor_key):
            text = self.write(factor)
            if factor.is_Add and len(factors) > 1:
                text = self.bracket(text)
            texts.append(text)
        return self.times(texts)

    def _factor_key(self, factor: Any) -> tuple[Any, ...]:
        """Sort key of a factor: rank as in :data:`RANKS`, link number, name."""
        base = factor.base if factor.is_Pow else factor
        if base.is_Number:
            return (-1, 0, "")
        if base.is_Symbol:
            stem, mark, index = name_parts(base.name)
            rank = {"": RANKS.get(stem, _OTHER_RANK), "dot": 8, "ddot": 9}[mark]
            return (rank, link_number(index), base.name)
        if not base.is_Add:  # sine or cosine
            return (6, 0, str(base))
        parts = [name_parts(symbol.name) for symbol in base.free_symbols]
        has_rate = any(mark for _, mark, _ in parts)
        if has_rate:
            return (7, 0, str(base))
        has_mass = any(stem in ("m", "I") for stem, _, _ in parts)
        if has_mass and not base.has(sympy.sin, sympy.cos):
            return (-0.5, 0, str(base))
        return (5, 0, str(base))

    def _power(self, expr: Any) -> str:
        """Text of a power; negative powers are fractions."""
        if expr.exp.is_Number and expr.exp.is_negative:
            return self.fraction("1", self.write(expr.base**-expr.exp))
        if not expr.exp.is_Integer:
            return self.other(expr)
        if expr.base.func.__name__ in ("sin", "cos"):
            return self.function(expr.base.func.__name__, self.write(expr.base.args[0]), str(expr.exp))
        base = self.write(expr.base)
        if not expr.base.is_Symbol:
            base = self.bracket(base)
        return self.superscript(base, str(expr.exp))

    def _number(self, x: Any) -> str:
        """Text of a number; rational numbers are fractions."""
        if x.is_negative:
            return self.minus(self._number(-x))
        if x.is_Rational and not x.is_Integer:
            return self.fraction(self.figure(str(x.p)), self.figure(str(x.q)))
        if x.is_Integer:
            return self.figure(str(x))
        return self.figure(printed(float(x)))

    # Appearance in plain text, for the terminal.

    def symbol(self, name: str) -> str:
        """Symbol with Greek letters, dots for rates, and indices."""
        stem, mark, index = name_parts(name)
        with_rotor_mark = re.sub(r"^r(?=\d)", "ᵣ", index)
        subscript = with_rotor_mark.replace("_", ",").translate(_SUBSCRIPTS)
        letter = GREEK.get(stem, stem) + MARKS.get(mark, "")
        return unicodedata.normalize("NFC", letter) + subscript

    def figure(self, digits: str) -> str:
        """Number without a sign."""
        return digits

    def function(self, name: str, argument: str, power: str = "") -> str:
        """Sine or cosine, or a power of it."""
        return f"{name}{power.translate(_SUPERSCRIPTS)}({argument})"

    def superscript(self, base: str, power: str) -> str:
        """Power."""
        return base + power.translate(_SUPERSCRIPTS)

    def bracket(self, inner: str) -> str:
        """Parentheses."""
        return f"({inner})"

    def above(self, inner: str) -> str:
        """Numerator that is a sum."""
        return self.bracket(inner)

    def fraction(self, top: str, bottom: str) -> str:
        """Quotient."""
        vulgar_fractions = {("1", "2"): "½", ("1", "4"): "¼", ("3", "4"): "¾"}
        if (top, bottom) in vulgar_fractions:
            return vulgar_fractions[top, bottom]
        if " " in bottom:
            bottom = f"({bottom})"
        return f"{top}/{bottom}"

    def times(self, factors: list[str]) -> str:
        """Product."""
        return " ".join(factors)

    def minus(self, inner: str) -> str:
        """Negative of a term."""
        return f"−{inner}"

    def join(self, terms: list[tuple[str, str]]) -> str:
        """Sum of signed terms."""
        (first_sign, first_term), *others = terms
        text = self.minus(first_term) if first_sign == "-" else first_term
        for sign, term in others:
            text += self.between(sign) + term
        return text

    def between(self, sign: str) -> str:
        """Plus or minus, with spacing."""
        return f" {self.operator(sign)} "

    def operator(self, sign: str) -> str:
        """Plus or minus between terms."""
        return "−" if sign == "-" else "+"

    def matrix(self, rows: list[list[str]]) -> str:
        """Matrix in brackets; a column is written as a row in parentheses."""
        is_column = all(len(row) == 1 for row in rows)
        if is_column:
            return "(" + ", ".join(row[0] for row in rows) + ")"
        return "[" + "; ".join(map(", ".join, rows)) + "]"

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        """∂top/∂variable, or if ``rate`` its derivative with respect to time."""
        time_derivative = "d/dt " if rate else ""
        return f"{time_derivative}∂{top}/∂{variable}"

    def partial(self, variable: str, inner: str) -> str:
        """∂/∂variable of an expression."""
        return f"∂/∂{variable} {inner}"

    def other(self, expr: Any) -> str:
        """Text of any other expression."""
        return str(expr)


class Text(Notation):
    """Plain text with Greek letters and indices."""
