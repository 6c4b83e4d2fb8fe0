"""The order in which a book writes factors and terms, and the parts of a symbol's name."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from .symbol_names import link_number, name_parts

RANKS = {"G": -0.7, "m": 0, "I": 1, "L": 2, "r": 2, "a": 2, "h": 2, "g": 3, "t": 4.5}


def _factors(expr: Any) -> list[Any]:
    return list(expr.args) if expr.is_Mul else [expr]


def is_sum(factors: list[Any]) -> bool:
    """One factor, a sum."""
    return len(factors) == 1 and bool(factors[0].is_Add)


def signed_factors(term: Any) -> tuple[bool, list[Any]]:
    """The sign of a term and the factors of its size; of sums among them, the sign of their first term is pulled out."""
    coefficient, rest = term.as_coeff_Mul()
    negative = bool(coefficient.is_negative)
    factors = [] if abs(coefficient) == 1 else [abs(coefficient)]
    for factor in _factors(rest):
        whole = factor.is_Pow and factor.exp.is_Integer and factor.exp.is_positive
        base, power = (factor.base, int(factor.exp)) if whole else (factor, 1)
        if base.is_Add and signed_factors(ordered_terms(base)[0])[0]:
            negative ^= bool(power % 2)
            factor = (-base) ** power
        if factor != 1:
            factors.append(factor)
    return negative, factors or [abs(coefficient)]


@lru_cache(maxsize=1 << 14)
def ordered_terms(expr: Any) -> list[Any]:
    """The terms of a sum in the order of a book."""
    return sorted(expr.as_ordered_terms() if expr.is_Add else [expr], key=_term_key)


def _term_key(term: Any) -> tuple[Any, ...]:
    marks, letters = [0, 0], []
    for symbol in term.free_symbols:
        stem, mark, index = name_parts(symbol.name)
        if mark:
            marks[mark == "dot"] += 1
        power = int(next((f.exp for f in _factors(term) if f.is_Pow and f.base == symbol and f.exp.is_Integer), 1))
        letters.append((link_number(index), 9 if mark else RANKS.get(stem, 4), symbol.name, -power))
    return (-min(marks[0], 1), -min(marks[1], 1), tuple(sorted(letters)), str(term) if not letters else "")
