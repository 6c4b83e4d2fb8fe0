"""Readable forms of sums of products: squares and products of sines if they are shorter, with masses factored out.

Each coefficient is written in the shortest of a few forms. One has sums of angles, cos(θ_1 + θ_2). The others have products of
sines and cosines, either of single joint angles, cos²(θ_2), or of angles along a chain of parallel axes, cos θ_2 cos(θ_2 +
θ_3).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import starmap
from typing import Any

import numpy as np

from ..core.typing import Array
from .names import shortest, sympy
from .trig_polynomial import Basis, Ring, ShortestForms, TrigPolynomial, Waves

Row = tuple[Any, int, Waves]
"""Product of a coefficient, a monomial, and sines and cosines."""
Term = tuple[Any, int]
"""Product of a coefficient and a monomial."""

_MAX_FACTORED_SYMBOLS = 7
"""Largest number of symbols in a sum that is factored."""
_MAX_FACTORED_TERMS = 28
"""Largest number of terms in a sum that is factored: the square of a sum of seven symbols has as many."""
_MAX_DENOMINATOR = 64
"""Largest denominator of a simple fraction; other numbers are measured values."""
_MAX_EXACT_DENOMINATOR = 1 << 20
"""Largest denominator with which a fraction is compared with a coefficient."""
_MAX_RATIO_ERROR = 1e-12
"""Relative difference of two ratios that are equal except for rounding."""


class EquationWriter:
    """Writer of sums of one ring as SymPy expressions.

    ``sums`` (n, n) are angles along chains of parallel axes, as rows of integer multiples of the ring's n angles. ``masses``
    are names of symbols to be factored out. ``expressions`` maps symbols of the ring to the expressions that replace them.
    """

    def __init__(
        self,
        ring: Ring,
        sums: Array | None = None,
        *,
        masses: Iterable[str] = (),
        expressions: Mapping[str, Any] | None = None,
    ) -> None:
        self.ring = ring
        replacements = expressions or {}
        self.symbols = {name: replacements.get(name, sympy.Symbol(name)) for name in ring.symbols}
        single_angles = np.eye(len(ring.angles), dtype=int)
        families = [single_angles]
        if sums is not None and (sums != single_angles).any():
            families.append(sums)
        self._forms = ShortestForms(families)
        self._masses = frozenset(masses)
        self._waves: dict[Basis, Any] = {}  # expressions of sines and cosines
        self._products: dict[frozenset[Term], Any] = {}  # factored forms by terms; None if there is none

    # ── expressions ──

    def write_by_mass(self, total: TrigPolynomial) -> Any:
        """Sum with masses factored out: m_2 (L_1² + 2 L_1 L_2 cos θ_2 + L_2²)."""
        parts: list[Any] = []
        rows_by_mass: dict[int, list[Row]] = defaultdict(list)  # by the monomial of their masses
        for row in self._rows(total):
            _, monomial, _ = row
            rows_by_mass[self._mass_part(monomial)].append(row)
        for mass, rows in rows_by_mass.items():
            if not mass or len(rows) == 1:
                parts.extend(starmap(self._product, rows))
                continue
            content = _content([coefficient for coefficient, _, _ in rows])
            quotients = [(coefficient / content, monomial - mass, waves) for coefficient, monomial, waves in rows]
            parts.append(self._product(content, mass, (), self._write_by_waves(quotients)))
        return sympy.Add(*parts)

    def write_by_angle(self, total: TrigPolynomial) -> Any:
        """Sum with terms of equal sines and cosines collected: (m_1 + m_2) L_1 g cos θ_1."""
        parts: list[Any] = []
        for waves, terms in _terms_by_waves(self._rows(total)).items():
            content, common_monomial, quotient = self._divide_by_content(terms)
            parts.append(self._product(content, common_monomial, waves, self._bracket(quotient)))
        return sympy.Add(*parts)

    def _bracket(self, terms: list[Term]) -> Any:
        """Sum of terms without sines and cosines: as squares and products if possible, otherwise with each mass once."""
        product = self._factorize(terms)
        if product is not None:
            return product
        terms_by_mass: dict[int, list[Term]] = defaultdict(list)  # by the monomial of their masses
        for coefficient, monomial in terms:
            terms_by_mass[self._mass_part(monomial)].append((coefficient, monomial))
        parts: list[Any] = []
        for mass, terms_of_mass in terms_by_mass.items():
            if not mass or len(terms_of_mass) == 1 or len(terms_by_mass) == 1:
                parts.append(self._sum(terms_of_mass))
                continue
            content, common_monomial, quotient = self._divide_by_content(terms_of_mass)
            inner = self._factorize(quotient)
            if inner is None:
                inner = self._sum(quotient)
            parts.append(self._product(content, common_monomial, (), inner))
        return sympy.Add(*parts)

    def _sum(self, terms: list[Term]) -> Any:
        """Sum of terms, written out."""
        return sympy.Add(*[self._product(coefficient, monomial, ()) for coefficient, monomial in terms])

    def _divide_by_content(self, terms: list[Term]) -> tuple[Any, int, list[Term]]:
        """Number and monomial that divide all terms, and the terms divided by them."""
        coefficients, monomials = zip(*terms, strict=True)
        content = _content(coefficients)
        common_monomial = self._common_monomial(monomials)
        quotients = []
        for coefficient, monomial in terms:
            quotients.append((coefficient / content, monomial - common_monomial))
        return content, common_monomial, quotients

    def _factorize(self, terms: list[Term]) -> Any:
        """Polynomial of three or more terms as squares and products such as (L_2 + x_3)²; None if there are none."""
        if not 3 <= len(terms) <= _MAX_FACTORED_TERMS:
            return None
        for coefficient, _ in terms:
            if not float(_MAX_DENOMINATOR * coefficient).is_integer():  # not a simple fraction: a measured value
                return None
        key = frozenset(terms)
        if key not in self._products:
            self._products[key] = self._product_of_factors(terms)
        return self._products[key]

    def _product_of_factors(self, terms: list[Term]) -> Any:
        """Product of the polynomial's irreducible factors; None if there is only one, or if it has too many symbols."""
        all_powers = [self.ring.exponents(monomial) for _, monomial in terms]
        names = sorted(set().union(*all_powers))
        if not 0 < len(names) <= _MAX_FACTORED_SYMBOLS:
            return None
        coefficients = {}
        for (coefficient, _), powers in zip(terms, all_powers, strict=True):
            exponents = tuple(powers.get(name, 0) for name in names)
            coefficients[exponents] = sympy.Rational(Fraction(coefficient))
        polynomial = sympy.Poly.from_dict(coefficients, *map(sympy.Symbol, names), domain=sympy.QQ)
        if polynomial.total_degree() < 2:
            return None
        content, factors = polynomial.factor_list()
        powers_of_factors = [power for _, power in factors]
        if powers_of_factors == [1]:  # irreducible
            return None
        written_factors = []
        for factor, power in factors:
            written_factors.append(self._expression(factor, names) ** power)
        return sympy.Mul(content, *_flat_factors(written_factors))

    def _expression(self, polynomial: Any, names: list[str]) -> Any:
        """SymPy expression of a SymPy polynomial in the symbols with these names."""
        symbols = [self.symbols[name] for name in names]
        terms = []
        for powers, coefficient in polynomial.terms():
            factors = map(pow, symbols, powers)
            terms.append(sympy.Mul(coefficient, *factors))
        return sympy.Add(*terms)

    def write_by_motion(self, total: TrigPolynomial, motions: list[str], write: Callable[[TrigPolynomial], Any]) -> Any:
        """Sum sorted by products of rates and accelerations; terms with proportional coefficients are combined.

        ``motions`` are the names of rates and accelerations; ``write`` writes a coefficient. A motion in this function is the
        monomial of a product of rates and accelerations, 0 for terms without any.
        """
        # Each group is a coefficient and its members (ratio, motion); a member stands for ratio · coefficient · motion.
        groups: list[tuple[TrigPolynomial, list[tuple[Any, int]]]] = []
        for motion, coefficient in sorted(total.split(motions).items()):
            members = None  # of the proportional group
            ratio = None
            if motion:
                members, ratio = _proportional_group(groups, coefficient)
            if members is None:
                groups.append((coefficient, [(1, motion)]))
            else:
                members.append((ratio, motion))
        parts: list[Any] = []
        for coefficient, members in groups:
            if _has_no_motion(members):
                parts.append(write(coefficient))
            else:
                parts.append(self._write_group(coefficient, members, write))
        return sympy.Add(*parts)

    def _write_group(
        self, coefficient: TrigPolynomial, members: list[tuple[Any, int]], write: Callable[[TrigPolynomial], Any]
    ) -> Any:
        """Coefficient times the sum of its members (ratio, motion), with simple ratios and few minus signs."""
        ratios = [ratio for ratio, _ in members]
        scale = min(map(abs, ratios))
        positive_count = np.count_nonzero(np.array(ratios) > 0)
        if 2 * positive_count < len(ratios):  # most motions get a plus sign
            scale = -scale
        sign = 1
        if all(scale * value < 0 for value in coefficient.terms.values()):
            sign = -1
        products = [sympy_number(ratio / scale) * self._power(motion) for ratio, motion in members]
        motion_sum = sympy.Add(*products)
        written_coefficient = write(coefficient * (sign * scale))
        return sympy.Mul(sign, *_flat_factors([written_coefficient, motion_sum]))

    def _write_by_waves(self, rows: list[Row]) -> Any:
        """Sum of rows, with equal sines and cosines collected, squares and products formed, and common factors once."""
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
        shared_factors = [factor for factor in factor_lists[0] if factor.is_Add]
        for factors in factor_lists[1:]:
            shared_factors = [factor for factor in shared_factors if factor in factors]
        quotients = []
        for factors in factor_lists:
            own_factors = [factor for factor in factors if factor not in shared_factors]
            quotients.append(sympy.Mul(*own_factors))
        quotient_sum = sympy.Add(*quotients)
        return sympy.Mul(*shared_factors, *sympy.Mul.make_args(quotient_sum))

    def _disjoint_groups(self, terms: list[Term]) -> list[list[Term]]:
        """Smallest groups of terms without a symbol in two groups, such as the terms of r² and of (L + x)²."""
        groups: list[tuple[set[str], list[Term]]] = []  # names of symbols, and terms, of each group
        for coefficient, monomial in terms:
            names = set(self.ring.exponents(monomial))
            members = [(coefficient, monomial)]
            disjoint_groups = []
            for group_names, group_members in groups:
                if group_names & names:
                    names |= group_names
                    members = group_members + members
                else:
                    disjoint_groups.append((group_names, group_members))
            groups = [*disjoint_groups, (names, members)]
        return [members for _, members in groups]

    def _product(self, coefficient: Any, monomial: int, waves: Waves, inner: Any = 1) -> Any:
        """Expression of a row, times the expression ``inner``."""
        factors = [sympy_number(coefficient), self._power(monomial), inner]
        for basis, power in waves:
            factors.append(self._wave(basis) ** power)
        return sympy.Mul(*_flat_factors(factors))

    def _power(self, monomial: int) -> Any:
        """Expression of a monomial, a product of powers."""
        powers = self.ring.exponents(monomial)
        factors = []
        for name, power in powers.items():
            factors.append(self.symbols[name] ** power)
        return sympy.Mul(*factors)

    def _wave(self, basis: Basis) -> Any:
        """Expression of a sine or cosine."""
        if basis not in self._waves:
            kind, multiples = basis
            terms = []
            for multiple, name in zip(multiples, self.ring.angles, strict=True):
                terms.append(sympy_number(multiple) * self.symbols[name])
            argument = sympy.Add(*terms)
            self._waves[basis] = getattr(sympy, kind)(argument, evaluate=False)
        return self._waves[basis]

    def _mass_part(self, monomial: int) -> int:
        """Monomial of the masses among the symbols of a monomial."""
        powers = self.ring.exponents(monomial)
        for name in powers.keys() - self._masses:
            del powers[name]
        return self.ring.monomial(powers)

    def _common_monomial(self, monomials: Sequence[int]) -> int:
        """Greatest common divisor of monomials."""
        common, *others = map(self.ring.exponents, monomials)
        for powers in others:
            common = {name: min(power, powers[name]) for name, power in common.items() if name in powers}
        return self.ring.monomial(common)

    def _rows(self, total: TrigPolynomial) -> list[Row]:
        """Terms of a sum, with sines and cosines in their shortest form."""
        terms_by_monomial: dict[int, dict[Basis, Any]] = defaultdict(dict)
        for (monomial, base), value in total.terms.items():
            terms_by_monomial[monomial][self.ring.bases[base]] = value
        rows = []
        for monomial, terms in terms_by_monomial.items():
            for waves, coefficient in self._forms.shortest(terms).items():
                rows.append((coefficient, monomial, waves))
        return rows


def _flat_factors(factors: Iterable[Any]) -> list[Any]:
    """Factors; a factor that is a product is replaced by its own factors."""
    flat_factors: list[Any] = []
    for factor in factors:
        flat_factors += sympy.Mul.make_args(sympy.sympify(factor))
    return flat_factors


def _terms_by_waves(rows: Iterable[Row]) -> dict[Waves, list[Term]]:
    """Coefficients and monomials of rows with equal sines and cosines, in order."""
    terms: dict[Waves, list[Term]] = defaultdict(list)
    for coefficient, monomial, waves in rows:
        terms[waves].append((coefficient, monomial))
    return terms


def _has_no_motion(members: list[tuple[Any, int]]) -> bool:
    """True for the group of terms without rates and accelerations, which has one member."""
    _, motion = members[0]
    return motion == 0


def _proportional_group(groups: list[tuple[TrigPolynomial, list[Any]]], total: TrigPolynomial) -> tuple[Any, Any]:
    """Members of the group to which a sum is proportional, and its ratio to the group's sum; None, None if there is none.

    Groups of terms without rates (motion 0) are ignored.
    """
    for group_sum, members in groups:
        if _has_no_motion(members):
            continue
        ratio = _ratio(total, group_sum)
        if ratio is not None:
            return members, ratio
    return None, None


def _ratio(dividend: TrigPolynomial, divisor: TrigPolynomial) -> Any:
    """dividend / divisor if it is a number, else None."""
    if dividend.terms.keys() != divisor.terms.keys() or not dividend.terms:
        return None
    ratios = [dividend.terms[key] / divisor.terms[key] for key in dividend.terms]
    first_ratio = ratios[0]
    for ratio in ratios:
        if not abs(ratio - first_ratio) <= _MAX_RATIO_ERROR * abs(first_ratio):  # true for NaN
            return None
    return first_ratio


def _content(coefficients: Sequence[Any]) -> Any:
    """Largest simple fraction that divides all coefficients, negative if all of them are; 1 for measured values."""
    sign = 1
    if max(coefficients) < 0:
        sign = -1
    sizes = set(map(abs, coefficients))
    if len(sizes) == 1:
        return sign * abs(coefficients[0])
    fractions = [Fraction(coefficient).limit_denominator(_MAX_EXACT_DENOMINATOR) for coefficient in coefficients]
    if fractions != list(map(Fraction, coefficients)):  # measured values
        return 1
    denominators = [fraction.denominator for fraction in fractions]
    if max(denominators) > _MAX_DENOMINATOR:
        return 1
    denominator = math.lcm(*denominators)
    numerators = [int(fraction * denominator) for fraction in fractions]
    content = Fraction(sign * math.gcd(*numerators), denominator)
    if isinstance(coefficients[0], Fraction):
        return content
    return float(content)


def sympy_number(value: Any) -> Any:
    """SymPy number: rational if the value is exactly a simple fraction, otherwise a float."""
    if isinstance(value, Fraction):
        return sympy.Rational(value.numerator, value.denominator)
    if isinstance(value, float) and not (_MAX_DENOMINATOR * value).is_integer():
        return sympy.Float(shortest(value))
    exact = Fraction(value)
    return sympy.Rational(exact.numerator, exact.denominator)
