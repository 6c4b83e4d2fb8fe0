"""Readable forms of sums of products: squares and products of sines if they are shorter, with masses factored out.

Each coefficient is written in the shortest of a few forms: with sums of angles, cos(θ_1 + θ_2); or with products of
sines and cosines, either of single joint angles or of angles along a chain of parallel axes, cos²(θ_2), cos θ_2 cos(θ_2
+ θ_3).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import chain, starmap
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
                parts.extend(starmap(self._product, rows))
                continue
            coefficients, _, _ = zip(*rows, strict=True)
            content = _content(coefficients)
            quotients = [(c / content, m - common, waves) for c, m, waves in rows]
            parts.append(self._product(content, common, (), self._write_by_waves(quotients)))
        return sympy.Add(*parts)

    def write_by_angle(self, total: TrigPolynomial) -> Any:
        """Sum with terms of equal sines and cosines collected: (m_1 + m_2) L_1 g cos θ_1."""
        parts: list[Any] = []
        for waves, terms in _terms_by_waves(self._rows(total)).items():
            content, common, quotient = self._divide_by_content(terms)
            parts.append(self._product(content, common, waves, self._bracket(quotient)))
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
                parts.append(self._sum(members))
                continue
            content, common, quotient = self._divide_by_content(members)
            inner = self._factorize(quotient)
            if inner is None:
                inner = self._sum(quotient)
            parts.append(self._product(content, common, (), inner))
        return sympy.Add(*parts)

    def _sum(self, terms: list[Term]) -> Any:
        return sympy.Add(*[self._product(c, m, ()) for c, m in terms])

    def _divide_by_content(self, terms: list[Term]) -> tuple[Any, int, list[Term]]:
        """Number and monomial that divide all terms, and the quotients."""
        coefficients, monomials = zip(*terms, strict=True)
        content, common = _content(coefficients), self._common(monomials)
        quotients = []
        for coefficient, monomial in terms:
            quotients.append((coefficient / content, monomial - common))
        return content, common, quotients

    def _factorize(self, terms: list[Term]) -> Any:
        """Polynomial of three or more terms as squares and products such as (L_2 + x_3)²; None if there are none."""
        if not 3 <= len(terms) <= _MAX_FACTORED_TERMS:
            return None
        for coefficient, _ in terms:
            if not float(64 * coefficient).is_integer():
                return None
        key = frozenset(terms)
        if key not in self._products:
            self._products[key] = self._factors(terms)
        return self._products[key]

    def _factors(self, terms: list[Term]) -> Any:
        powers = [self.ring.exponents(m) for _, m in terms]
        names = sorted(set().union(*powers))
        if not 0 < len(names) <= _MAX_FACTORED_NAMES:
            return None
        coefficients = {}
        for (c, _), p in zip(terms, powers, strict=True):
            exponents = tuple(p.get(name, 0) for name in names)
            coefficients[exponents] = sympy.Rational(Fraction(c))
        polynomial = sympy.Poly.from_dict(coefficients, *map(sympy.Symbol, names), domain=sympy.QQ)
        if polynomial.total_degree() < 2:
            return None
        content, factors = polynomial.factor_list()
        if len(factors) == 1 and factors[0][1] == 1:
            return None
        written_factors = []
        for factor, power in factors:
            written_factors.append(self._expression(factor, names) ** power)
        return sympy.Mul(content, *_flat_factors(written_factors))

    def _expression(self, polynomial: Any, names: list[str]) -> Any:
        symbols = [self.symbols[name] for name in names]
        terms = [sympy.Mul(c, *map(pow, symbols, powers)) for powers, c in polynomial.terms()]
        return sympy.Add(*terms)

    def write_by_motion(self, total: TrigPolynomial, motions: list[str], write: Callable[[TrigPolynomial], Any]) -> Any:
        """Sum sorted by products of rates and accelerations; terms with proportional coefficients are combined."""
        groups: list[tuple[TrigPolynomial, list[tuple[Any, int]]]] = []
        for motion, coefficient in sorted(total.split(motions).items()):
            members, ratio = _proportional_group(groups, coefficient) if motion else (None, None)
            if members is None:
                groups.append((coefficient, [(1, motion)]))
            else:
                members.append((ratio, motion))
        parts: list[Any] = []
        for coefficient, members in groups:
            if not members[0][1]:
                parts.append(write(coefficient))
                continue
            ratios, _ = zip(*members, strict=True)
            scale = min(map(abs, ratios))
            positive = np.count_nonzero(np.array(ratios) > 0)
            if 2 * positive < len(ratios):
                scale = -scale
            sign = 1
            if all(scale * c < 0 for c in coefficient.terms.values()):
                sign = -1
            inner = sympy.Add(*[sympy_number(ratio / scale) * self._power(motion) for ratio, motion in members])
            outer = write(coefficient * (sign * scale))
            parts.append(sympy.Mul(sign, *_flat_factors([outer, inner])))
        return sympy.Add(*parts)

    def _write_by_waves(self, rows: list[Row]) -> Any:
        """Sum with equal sines and cosines collected, as squares and products if possible, and common factors once."""
        parts: list[Any] = []
        for waves, terms in _terms_by_waves(rows).items():
            groups = [terms]
            if self._factorize(terms) is None:
                groups = self._disjoint_groups(terms)
            for group in groups:
                product = self._factorize(group)
                if product is not None:
                    parts.append(self._product(1, 0, waves, product))
                    continue
                for coefficient, monomial in group:
                    parts.append(self._product(coefficient, monomial, waves))
        factor_lists = list(map(sympy.Mul.make_args, parts))
        shared = [factor for factor in factor_lists[0] if factor.is_Add]
        for factors in factor_lists[1:]:
            shared = [factor for factor in shared if factor in factors]
        quotients = []
        for factors in factor_lists:
            own_factors = [factor for factor in factors if factor not in shared]
            quotients.append(sympy.Mul(*own_factors))
        remainder = sympy.Add(*quotients)
        return sympy.Mul(*shared, *sympy.Mul.make_args(remainder))

    def _disjoint_groups(self, terms: list[Term]) -> list[list[Term]]:
        """Groups of terms without common symbols: r² beside (L + x)²."""
        groups: list[tuple[set[str], list[Term]]] = []
        for term in terms:
            names, members = set(self.ring.exponents(term[1])), [term]
            disjoint = []
            for group_names, group_members in groups:
                if group_names & names:
                    names |= group_names
                    members = group_members + members
                else:
                    disjoint.append((group_names, group_members))
            groups = [*disjoint, (names, members)]
        return [members for _, members in groups]

    def _product(self, coefficient: Any, monomial: int, waves: Waves, inner: Any = 1) -> Any:
        factors = [sympy_number(coefficient), self._power(monomial), inner]
        for basis, power in waves:
            factors.append(self._wave(basis) ** power)
        return sympy.Mul(*_flat_factors(factors))

    def _power(self, monomial: int) -> Any:
        powers = self.ring.exponents(monomial)
        factors = []
        for name, power in powers.items():
            factors.append(self.symbols[name] ** power)
        return sympy.Mul(*factors)

    def _wave(self, basis: Basis) -> Any:
        if basis not in self._waves:
            kind, multiples = basis
            terms = []
            for multiple, name in zip(multiples, self.ring.angles, strict=True):
                terms.append(sympy_number(multiple) * self.symbols[name])
            argument = sympy.Add(*terms)
            self._waves[basis] = getattr(sympy, kind)(argument, evaluate=False)
        return self._waves[basis]

    def _mass_part(self, monomial: int) -> int:
        powers = self.ring.exponents(monomial)
        for name in powers.keys() - self._masses:
            del powers[name]
        return self.ring.monomial(powers)

    def _common(self, monomials: Sequence[int]) -> int:
        common, *others = map(self.ring.exponents, monomials)
        for powers in others:
            common = {name: min(power, powers[name]) for name, power in common.items() if name in powers}
        return self.ring.monomial(common)

    def _rows(self, total: TrigPolynomial) -> list[Row]:
        by_monomial: dict[int, dict[Basis, Any]] = defaultdict(dict)
        for (monomial, base), value in total.terms.items():
            by_monomial[monomial][self.ring.bases[base]] = value
        rows = []
        for monomial, terms in by_monomial.items():
            for waves, coefficient in self._forms.shortest(terms).items():
                rows.append((coefficient, monomial, waves))
        return rows


def _flat_factors(factors: Iterable[Any]) -> list[Any]:
    """Factors, with products among them taken apart."""
    return list(chain.from_iterable(sympy.Mul.make_args(sympy.sympify(factor)) for factor in factors))


def _terms_by_waves(rows: Iterable[Row]) -> dict[Waves, list[Term]]:
    """Coefficients and monomials of rows with equal sines and cosines, in order."""
    terms: dict[Waves, list[Term]] = defaultdict(list)
    for coefficient, monomial, waves in rows:
        terms[waves].append((coefficient, monomial))
    return terms


def _groups(items: Iterable[Any], key: Callable[[Any], Any]) -> dict[Any, list[Any]]:
    """Items grouped by key, in order."""
    groups: dict[Any, list[Any]] = defaultdict(list)
    for item in items:
        groups[key(item)].append(item)
    return groups


def _proportional_group(groups: list[tuple[TrigPolynomial, list[Any]]], total: TrigPolynomial) -> tuple[Any, Any]:
    """Members of the group to which a sum is proportional, and its ratio to the group's sum; None if there is none.

    Groups of terms without rates (motion 0) are left out.
    """
    for first, members in groups:
        ratio = _ratio(total, first) if members[0][1] else None
        if ratio is not None:
            return members, ratio
    return None, None


def _ratio(one: TrigPolynomial, other: TrigPolynomial) -> Any:
    """one / other if it is a number, else None."""
    if one.terms.keys() != other.terms.keys() or not one.terms:
        return None
    ratios = [one.terms[key] / other.terms[key] for key in one.terms]
    for ratio in ratios:
        if not abs(ratio - ratios[0]) <= 1e-12 * abs(ratios[0]):
            return None
    return ratios[0]


def _content(coefficients: Sequence[Any]) -> Any:
    """Largest simple number that divides all coefficients, with the majority sign; 1 for measured values."""
    sign = 1
    if max(coefficients) < 0:
        sign = -1
    sizes = set(map(abs, coefficients))
    if len(sizes) == 1:
        return sign * abs(coefficients[0])
    fractions = [Fraction(c).limit_denominator(1 << 20) for c in coefficients]
    if fractions != list(map(Fraction, coefficients)):
        return 1
    denominators = [fraction.denominator for fraction in fractions]
    if max(denominators) > 64:
        return 1
    denominator = math.lcm(*denominators)
    numerators = [int(fraction * denominator) for fraction in fractions]
    content = Fraction(sign * math.gcd(*numerators), denominator)
    return content if isinstance(coefficients[0], Fraction) else float(content)


def sympy_number(value: Any) -> Any:
    """SymPy number: rational if the value is exactly a simple fraction, otherwise a float."""
    if isinstance(value, Fraction):
        return sympy.Rational(value.numerator, value.denominator)
    if isinstance(value, float) and not (64 * value).is_integer():
        return sympy.Float(shortest(value))
    exact = Fraction(value)
    return sympy.Rational(exact.numerator, exact.denominator)
