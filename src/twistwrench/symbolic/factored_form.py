"""Readable forms of sums of products: squares and products of sines if they are shorter, with masses factored out.

Each coefficient is written in the shortest of a few forms: with sums of angles, cos(θ_1 + θ_2); or with products of
sines and cosines, either of single joint angles or of angles along a chain of parallel axes, cos²(θ_2), cos θ_2 cos(θ_2
+ θ_3).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from itertools import chain
from typing import Any

import numpy as np

from ..core.typing import Array
from .names import shortest, sympy
from .trig_polynomial import Basis, Ring, ShortestForms, TrigPolynomial, Waves

Row = tuple[Any, int, Waves]
"""Coefficient, monomial, sines and cosines."""
Term = tuple[Any, int]
"""Coefficient and monomial."""

_MAX_FACTORED_TERMS, _MAX_FACTORED_NAMES = 28, 7  # numbers of terms and symbols in the square of a sum of seven


class EquationWriter:
    """Writer of sums of one ring as SymPy expressions. ``expressions`` maps the ring's symbols to expressions."""

    def __init__(
        self,
        ring: Ring,
        sums: Array | None = None,
        *,
        masses: Iterable[str] = (),
        expressions: Mapping[str, Any] | None = None,
    ) -> None:
        self.ring = ring
        known = expressions or {}
        self.symbols = {name: known.get(name, sympy.Symbol(name)) for name in ring.symbols}
        n = len(ring.angles)
        families = [np.eye(n, dtype=int)]
        if sums is not None and (sums != families[0]).any():
            families.append(sums)
        self._forms = ShortestForms(families)
        self._masses = frozenset(masses)
        self._waves: dict[Basis, Any] = {}
        self._products: dict[frozenset[Term], Any] = {}

    # ── expressions ──

    def write_by_mass(self, total: TrigPolynomial) -> Any:
        """Sum with masses factored out: m_2 (L_1² + 2 L_1 L_2 cos θ_2 + L_2²)."""
        parts: list[Any] = []
        for common, rows in _groups(self._rows(total), lambda row: self._mass_part(row[1])).items():
            if not common or len(rows) == 1:
                parts.extend(self._product(*row) for row in rows)
                continue
            share = _content([c for c, _, _ in rows])
            inner = self._write_by_waves([(c / share, m - common, waves) for c, m, waves in rows])
            parts.append(self._product(share, common, (), inner))
        return sympy.Add(*parts)

    def write_by_angle(self, total: TrigPolynomial) -> Any:
        """Sum with terms of equal sines and cosines collected: (m_1 + m_2) L_1 g cos θ_1."""
        parts: list[Any] = []
        for waves, rows in _groups(self._rows(total), lambda row: row[2]).items():
            common = self._common([m for _, m, _ in rows])
            share = _content([c for c, _, _ in rows])
            inner = self._bracket([(c / share, m - common) for c, m, _ in rows])
            parts.append(self._product(share, common, waves, inner))
        return sympy.Add(*parts)

    def _bracket(self, terms: list[Term]) -> Any:
        """Sum without sines and cosines: as squares and products if possible, otherwise with each mass once."""
        product = self._factorize(terms)
        if product is not None:
            return product
        groups = _groups(terms, lambda term: self._mass_part(term[1]))
        parts: list[Any] = []
        for mass, members in groups.items():
            if not mass or len(members) == 1 or len(groups) == 1:
                parts.extend(self._product(c, m, ()) for c, m in members)
                continue
            common, share = self._common([m for _, m in members]), _content([c for c, _ in members])
            quotient = [(c / share, m - common) for c, m in members]
            inner = self._factorize(quotient)
            if inner is None:
                inner = sympy.Add(*(self._product(c, m, ()) for c, m in quotient))
            parts.append(self._product(share, common, (), inner))
        return sympy.Add(*parts)

    def _factorize(self, terms: list[Term]) -> Any:
        """Polynomial of three or more terms as squares and products such as (L_2 + x_3)²; None if there are none."""
        if not 3 <= len(terms) <= _MAX_FACTORED_TERMS or not all(float(64 * c).is_integer() for c, _ in terms):
            return None
        key = frozenset(terms)
        if key not in self._products:
            self._products[key] = self._factors(terms)
        return self._products[key]

    def _factors(self, terms: list[Term]) -> Any:
        powers = [self.ring.exponents(m) for _, m in terms]
        names = sorted(set().union(*powers))
        if len(names) > _MAX_FACTORED_NAMES or max(sum(p.values()) for p in powers) < 2:
            return None
        Symbol, QQ = sympy.Symbol, sympy.QQ
        exponents = [tuple(p.get(name, 0) for name in names) for p in powers]
        coefficients = {e: sympy.Rational(Fraction(c)) for e, (c, _) in zip(exponents, terms, strict=True)}
        whole = sympy.Poly.from_dict(coefficients, *map(Symbol, names), domain=QQ)
        content, factors = whole.factor_list()
        if sum(k for _, k in factors) < 2:
            return None
        powers_of_factors = [self._expression(f, names) ** k for f, k in factors]
        return sympy.Mul(content, *_factors_of(powers_of_factors))

    def _expression(self, polynomial: Any, names: list[str]) -> Any:
        symbols = [self.symbols[name] for name in names]
        terms = [sympy.Mul(c, *map(pow, symbols, powers)) for powers, c in polynomial.terms()]
        return sympy.Add(*terms)

    def write_by_motion(self, total: TrigPolynomial, motions: list[str], write: Callable[[TrigPolynomial], Any]) -> Any:
        """Sum sorted by products of rates and accelerations; terms with proportional coefficients are combined."""
        groups: list[tuple[TrigPolynomial, list[tuple[Any, int]]]] = []
        for motion, coefficient in sorted(total.split(motions).items(), reverse=False):
            for first, members in groups:
                ratio = _ratio(coefficient, first) if motion and members[0][1] else None
                if ratio is not None:
                    members.append((ratio, motion))
                    break
            else:
                groups.append((coefficient, [(1, motion)]))
        parts: list[Any] = []
        for coefficient, members in groups:
            if not members[0][1]:
                parts.append(write(coefficient))
                continue
            scale = min(abs(ratio) for ratio, _ in members)
            if 2 * sum(ratio > 0 for ratio, _ in members) < len(members):
                scale = -scale
            inner = sympy.Add(*(sympy_number(r / scale) * self._power(motion) for r, motion in members))
            sign = -1 if all(scale * c < 0 for c in coefficient.terms.values()) else 1
            outer = sympy.Mul.make_args(write(coefficient * (sign * scale)))
            parts.append(sympy.Mul(sign, *outer, *sympy.Mul.make_args(inner)))
        return sympy.Add(*parts)

    def _write_by_waves(self, rows: list[Row]) -> Any:
        """Sum with equal sines and cosines collected, as squares and products if possible, and common factors once."""
        parts: list[Any] = []
        for waves, members in _groups(rows, lambda row: row[2]).items():
            terms = [(c, m) for c, m, _ in members]
            product = self._factorize(terms)
            if product is not None:
                parts.append(self._product(1, 0, waves, product))
                continue
            for group in self._disjoint_groups(terms):
                product = self._factorize(group)
                if product is not None:
                    parts.append(self._product(1, 0, waves, product))
                else:
                    parts.extend(self._product(c, m, waves) for c, m in group)
        args = [list(sympy.Mul.make_args(part)) for part in parts]
        shared = [f for f in args[0] if f.is_Add]
        for factors in args[1:]:
            shared = [f for f in shared if f in factors]
        quotients = [sympy.Mul(*filter(lambda f: f not in shared, factors)) for factors in args]
        return sympy.Mul(*shared, *sympy.Mul.make_args(sympy.Add(*quotients)))

    def _disjoint_groups(self, terms: list[Term]) -> list[list[Term]]:
        """Groups of terms without common symbols: r² beside (L + x)²."""
        groups: list[tuple[set[str], list[Term]]] = []
        for term in terms:
            names, members = set(self.ring.exponents(term[1])), [term]
            for group in [g for g in groups if g[0] & names]:
                groups.remove(group)
                names |= group[0]
                members = group[1] + members
            groups.append((names, members))
        return [members for _, members in groups]

    def _product(self, coefficient: Any, monomial: int, waves: Waves, inner: Any = 1) -> Any:
        factors = [sympy_number(coefficient), self._power(monomial), inner]
        factors += [self._wave(basis) ** power for basis, power in waves]
        return sympy.Mul(*_factors_of(factors))

    def _power(self, monomial: int) -> Any:
        return sympy.Mul(*(self.symbols[name] ** power for name, power in self.ring.exponents(monomial).items()))

    def _wave(self, basis: Basis) -> Any:
        if basis not in self._waves:
            kind, f = basis
            angles = (self.symbols[name] for name in self.ring.angles)
            argument = sympy.Add(*(sympy_number(x) * angle for x, angle in zip(f, angles, strict=True)))
            self._waves[basis] = getattr(sympy, kind)(argument, evaluate=False)
        return self._waves[basis]

    def _mass_part(self, monomial: int) -> int:
        return self.ring.monomial({n: k for n, k in self.ring.exponents(monomial).items() if n in self._masses})

    def _common(self, monomials: list[int]) -> int:
        powers = [self.ring.exponents(m) for m in monomials]
        shared = set(powers[0]).intersection(*powers)
        return self.ring.monomial({name: min(p[name] for p in powers) for name in shared})

    def _rows(self, total: TrigPolynomial) -> list[Row]:
        by_monomial: dict[int, dict[Basis, Any]] = defaultdict(dict)
        for (monomial, base), value in total.terms.items():
            by_monomial[monomial][self.ring.bases[base]] = value
        return [(c, m, waves) for m, terms in by_monomial.items() for waves, c in self._forms.shortest(terms).items()]


def _factors_of(factors: Iterable[Any]) -> list[Any]:
    """Factors, with products among them taken apart."""
    return list(chain.from_iterable(sympy.Mul.make_args(sympy.sympify(factor)) for factor in factors))


def _groups(items: Iterable[Any], key: Callable[[Any], Any]) -> dict[Any, list[Any]]:
    """Items grouped by key, in order."""
    groups: dict[Any, list[Any]] = defaultdict(list)
    for item in items:
        groups[key(item)].append(item)
    return groups


def _ratio(one: TrigPolynomial, other: TrigPolynomial) -> Any:
    """one / other if it is a number, else None."""
    if one.terms.keys() != other.terms.keys() or not one.terms:
        return None
    ratios = [one.terms[key] / other.terms[key] for key in one.terms]
    return ratios[0] if all(abs(r - ratios[0]) <= 1e-12 * abs(ratios[0]) for r in ratios) else None


def _content(coefficients: list[Any]) -> Any:
    """Largest simple number that divides all coefficients, with the majority sign; 1 for measured values."""
    if all(abs(c) == abs(coefficients[0]) for c in coefficients):
        return -abs(coefficients[0]) if all(c < 0 for c in coefficients) else abs(coefficients[0])
    fractions = [Fraction(c).limit_denominator(1 << 20) for c in coefficients]
    if any(Fraction(c) != f or f.denominator > 64 for c, f in zip(coefficients, fractions, strict=True)):
        return 1
    denominator = int(np.lcm.reduce([f.denominator for f in fractions]))
    numerator = int(np.gcd.reduce([int(f * denominator) for f in fractions]))
    sign = -1 if all(f < 0 for f in fractions) else 1
    share = Fraction(sign * numerator, denominator)
    return share if isinstance(coefficients[0], Fraction) else float(share)


def sympy_number(value: Any) -> Any:
    """SymPy number: rational if the value is exactly a simple fraction, otherwise a float."""
    if isinstance(value, Fraction):
        return sympy.Rational(value.numerator, value.denominator)
    if isinstance(value, float) and not (64 * value).is_integer():
        return sympy.Float(shortest(value))
    exact = Fraction(value)
    return sympy.Rational(exact.numerator, exact.denominator)
