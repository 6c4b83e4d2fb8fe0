"""Trigonometric polynomials: sums of a number times symbols times one sine or cosine of a sum of angles.

The form is canonical: zero has no terms. Products of sines and cosines become sums immediately,
cos a cos b = ½ (cos(a - b) + cos(a + b)). A monomial of symbols is one integer with eight bits per exponent, so that
products add integers. Hundreds of thousands of products take a second; expression trees take minutes.
"""

from __future__ import annotations

import operator
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np

from ..core.typing import Array

Basis = tuple[str, tuple[Any, ...]]
"""``("cos" | "sin", multiple of each angle)``; the first non-zero multiple is positive. cos 0 represents 1."""

_BITS = 8
_MASK = (1 << _BITS) - 1
HIGHEST = _MASK
"""Largest exponent in a monomial; a larger one would overflow into the next symbol."""


class Ring:
    """Symbols and angles of the sums, with a table of products of sines and cosines computed so far.

    Angles are symbols too: ``angles`` lists them. Coefficients are floats, exact if all are multiples of powers of two;
    with ``exact=True`` they are fractions.
    """

    def __init__(self, symbols: Sequence[str], angles: Sequence[str], *, exact: bool = False) -> None:
        self.symbols, self.angles, self.exact = tuple(symbols), tuple(angles), exact
        self.place = {name: k for k, name in enumerate(self.symbols)}
        self._angle_place = {name: k for k, name in enumerate(self.angles)}
        zero: tuple[Any, ...] = (0,) * len(self.angles)
        self.bases: list[Basis] = [("cos", zero)]
        self._numbers: dict[Basis, int] = {self.bases[0]: 0}
        self._products: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {}
        self._slopes: dict[tuple[int, int], tuple[int, Any]] = {}

    # ── constructors ──

    def number(self, value: Any) -> TrigPolynomial:
        """Constant."""
        if not value:
            return TrigPolynomial(self, {})
        if self.exact and not isinstance(value, float):
            return TrigPolynomial(self, {(0, 0): Fraction(value)})
        return TrigPolynomial(self, {(0, 0): float(value)})

    def symbol(self, name: str) -> TrigPolynomial:
        """Symbol with the given name."""
        return TrigPolynomial(self, {(1 << (_BITS * self.place[name]), 0): self._coefficient(1)})

    def wave(self, kind: str, multiples: Sequence[Any]) -> TrigPolynomial:
        """Cosine or sine of a sum of multiples of the angles."""
        basis, sign = _canonical(kind, tuple(multiples))
        if not sign:
            return TrigPolynomial(self, {})
        return TrigPolynomial(self, {(0, self._number(basis)): self._coefficient(sign)})

    def _coefficient(self, value: Any) -> Any:
        return Fraction(value) if self.exact else float(value)

    # ── monomials ──

    def exponents(self, monomial: int) -> dict[str, int]:
        """Map from symbols to non-zero exponents."""
        exponents, k = {}, 0
        while monomial:
            power = monomial & _MASK
            if power:
                exponents[self.symbols[k]] = power
            monomial, k = monomial >> _BITS, k + 1
        return exponents

    def monomial(self, exponents: dict[str, int]) -> int:
        """Integer that encodes a product of powers."""
        monomial = 0
        for name, power in exponents.items():
            monomial += power << (_BITS * self.place[name])
        return monomial

    # ── sines and cosines ──

    def _number(self, basis: Basis) -> int:
        number = self._numbers.get(basis)
        if number is None:
            number = self._numbers[basis] = len(self.bases)
            self.bases.append(basis)
        return number

    def product(self, a: int, b: int) -> tuple[tuple[int, int], ...]:
        """Twice the product of two bases, as (base, sign) pairs."""
        terms = self._products.get((a, b))
        if terms is None:
            terms = self._products[a, b] = self._products[b, a] = tuple(self._expand_product(a, b))
        return terms

    def _expand_product(self, a: int, b: int) -> Iterable[tuple[int, int]]:
        (kind_a, f), (kind_b, g) = self.bases[a], self.bases[b]
        plus, minus = tuple(map(operator.add, f, g)), tuple(map(operator.sub, f, g))
        if kind_a == kind_b == "cos":  # cos cos = ½ (cos⁻ + cos⁺)
            parts = [("cos", minus, 1), ("cos", plus, 1)]
        elif kind_a == kind_b:  # sin sin = ½ (cos⁻ - cos⁺)
            parts = [("cos", minus, 1), ("cos", plus, -1)]
        elif kind_a == "sin":  # sin f cos g = ½ (sin⁺ + sin⁻)
            parts = [("sin", plus, 1), ("sin", minus, 1)]
        else:  # cos f sin g = ½ (sin⁺ - sin⁻)
            parts = [("sin", plus, 1), ("sin", minus, -1)]
        for kind, multiples, sign in parts:
            basis, basis_sign = _canonical(kind, multiples)
            if basis_sign:
                yield self._number(basis), basis_sign * sign

    def slope(self, base: int, angle: int) -> tuple[int, Any]:
        """d(base)/d(angle) as (base, factor)."""
        slope = self._slopes.get((base, angle))
        if slope is None:
            slope = self._slopes[base, angle] = self._differentiate(base, angle)
        return slope

    def _differentiate(self, base: int, angle: int) -> tuple[int, Any]:
        kind, multiples = self.bases[base]
        factor = multiples[angle]
        if not factor:
            return 0, factor
        if kind == "cos":
            return self._number(("sin", multiples)), -factor
        return self._number(("cos", multiples)), factor


def _canonical(kind: str, multiples: tuple[Any, ...]) -> tuple[Basis, int]:
    """Basis with a positive first multiple, and the factor 1, -1 or 0 (sin 0) that it takes."""
    first = next((x for x in multiples if x), 0)
    if first < 0:
        opposite = tuple(map(operator.neg, multiples))
        return (kind, opposite), 1 if kind == "cos" else -1
    is_zero = first == 0 and kind == "sin"
    return (kind, multiples), 0 if is_zero else 1


class TrigPolynomial:
    """One sum: ``{(monomial, base): coefficient}``, without zeros. Immutable; usable in NumPy object arrays."""

    __slots__ = ("ring", "terms")

    def __init__(self, ring: Ring, terms: dict[tuple[int, int], Any]) -> None:
        self.ring, self.terms = ring, terms

    def __repr__(self) -> str:
        return f"<TrigPolynomial of {len(self.terms)} terms>"

    def __len__(self) -> int:
        return len(self.terms)

    def __bool__(self) -> bool:
        return bool(self.terms)

    def __add__(self, other: Any) -> TrigPolynomial:
        if not isinstance(other, TrigPolynomial):
            if not other:
                return self
            other = self.ring.number(other)
        if len(other.terms) > len(self.terms):
            self, other = other, self
        terms = dict(self.terms)
        for key, value in other.terms.items():
            total = terms.get(key, 0) + value
            if total:
                terms[key] = total
            else:
                del terms[key]
        return TrigPolynomial(self.ring, terms)

    __radd__ = __add__

    def __neg__(self) -> TrigPolynomial:
        return TrigPolynomial(self.ring, {key: -value for key, value in self.terms.items()})

    def __sub__(self, other: Any) -> TrigPolynomial:
        return self + (-other)

    def __rsub__(self, other: Any) -> TrigPolynomial:
        return -self + other

    def __mul__(self, other: Any) -> TrigPolynomial:
        if not isinstance(other, TrigPolynomial):
            factor = self.ring._coefficient(other)
            if not factor:
                return TrigPolynomial(self.ring, {})
            return TrigPolynomial(self.ring, {key: factor * value for key, value in self.terms.items()})
        ring, terms = self.ring, dict[tuple[int, int], Any]()
        for (m, a), x in self.terms.items():
            for (n, b), y in other.terms.items():
                if not a or not b:
                    key = (m + n, a or b)
                    terms[key] = terms.get(key, 0) + x * y
                    continue
                half = x * y / 2
                for base, sign in ring.product(a, b):
                    key = (m + n, base)
                    terms[key] = terms.get(key, 0) + (half if sign > 0 else -half)
        return TrigPolynomial(ring, {key: value for key, value in terms.items() if value})

    __rmul__ = __mul__

    def diff(self, name: str) -> TrigPolynomial:
        """Derivative with respect to a symbol, including sines and cosines of an angle."""
        ring = self.ring
        shift = _BITS * ring.place[name]
        angle = ring._angle_place.get(name)
        terms: dict[tuple[int, int], Any] = {}
        for (m, base), value in self.terms.items():
            power = (m >> shift) & _MASK
            if power:
                key = (m - (1 << shift), base)
                terms[key] = terms.get(key, 0) + power * value
            if angle is not None and base:
                other, factor = ring.slope(base, angle)
                if factor:
                    terms[m, other] = terms.get((m, other), 0) + ring._coefficient(factor) * value
        return TrigPolynomial(ring, {key: value for key, value in terms.items() if value})

    def split(self, names: Sequence[str]) -> dict[int, TrigPolynomial]:
        """Coefficients of the monomials in some of the symbols."""
        mask = 0
        for name in names:
            mask |= _MASK << (_BITS * self.ring.place[name])
        parts: dict[int, dict[tuple[int, int], Any]] = {}
        for (m, base), value in self.terms.items():
            parts.setdefault(m & mask, {})[m & ~mask, base] = value
        return {motion: TrigPolynomial(self.ring, terms) for motion, terms in parts.items()}

    def without_dust(self, share: float) -> TrigPolynomial:
        """Sum without terms below a share of its largest term, which are rounding errors of cancelled terms."""
        threshold = share * max(map(abs, self.terms.values()), default=0.0)
        return TrigPolynomial(self.ring, {key: value for key, value in self.terms.items() if abs(value) > threshold})


# ── Shortest forms: sums of angles, or products of single angles

Waves = tuple[tuple[Basis, int], ...]
"""Product of powers of sines and cosines."""

Powers = tuple[tuple[int, int], ...]
"""Powers of the cosine and of the sine of each angle."""

# Products are sought for sums of at most so many terms, angles involved, and multiples of one angle.
_MAX_TERMS, _MAX_ANGLES, _MAX_MULTIPLE = 40, 4, 4


class ShortestForms:
    """Shortest form of each coefficient of symbols, cached.

    ``families`` are the sets of angles allowed in products, as rows of integer multiples of joint angles.
    """

    def __init__(self, families: list[Array]) -> None:
        self._families = families
        self._cache: dict[Any, dict[Waves, Any]] = {}

    def shortest(self, terms: dict[Basis, Any]) -> dict[Waves, Any]:
        """Sum of cosines and sines, unchanged or as products if those are shorter."""
        plain: dict[Waves, Any] = {_waves_of({basis: 1}): c for basis, c in terms.items()}
        multiples = [x for _, f in terms for x in f]
        if len(terms) > _MAX_TERMS or not all(isinstance(x, int) for x in multiples):
            return plain
        if len(terms) == 1 and max(map(abs, multiples), default=0) <= 1:
            return plain
        key = tuple(sorted(terms.items()))
        if key not in self._cache:
            forms = [plain]
            for sums in self._families:
                forms.extend(_products(terms, sums))
            self._cache[key] = min(forms, key=_length)
        return self._cache[key]


def _length(form: dict[Waves, Any]) -> tuple[int, int, int, int]:
    """Sort key: number of terms, doubled angles, halves, factors."""
    doubled = factors = halves = 0
    for waves, coefficient in form.items():
        if float(2 * coefficient).is_integer() and not float(coefficient).is_integer():
            halves += 1
        for (_, multiples), power in waves:
            factors += power
            doubled += max(map(abs, multiples)) > 1
    return len(form), doubled, halves, factors


def _waves_of(powers: Mapping[Basis, int]) -> Waves:
    """Product of powers, without those that are 1: the power zero, and cos 0."""
    waves = []
    for (kind, multiples), power in powers.items():
        if power and any(multiples):
            waves.append(((kind, multiples), power))
    return tuple(sorted(waves))


def _products(terms: dict[Basis, Any], sums: Array) -> Iterable[dict[Waves, Any]]:
    """Sum as polynomials in the cosines and sines of the angles in the rows of ``sums``, with reduced squares."""
    polynomial = _angle_polynomial(terms, sums)
    if polynomial is None:
        return
    exponents = np.array(list(polynomial), int).reshape(-1, len(sums), 2)
    involved = np.flatnonzero(exponents.any(axis=(0, 2))).tolist()
    if len(involved) > _MAX_ANGLES:
        return
    rows = list(map(tuple, sums.tolist()))
    for remaining_squares in product((0, 1), repeat=len(involved)):  # squares of cosines (0) or sines (1)
        form = dict(polynomial)
        for j, square in zip(involved, remaining_squares, strict=True):
            form = _reduce_squares(form, j, square)
        threshold = 1e-14 * max(map(abs, form.values()), default=0)
        waves_form = {}
        for powers, coefficient in form.items():
            if abs(coefficient) > threshold:
                wave_powers = {}
                for j in involved:
                    wave_powers["cos", rows[j]], wave_powers["sin", rows[j]] = powers[j]
                waves_form[_waves_of(wave_powers)] = coefficient
        yield waves_form


def _angle_polynomial(terms: dict[Basis, Any], sums: Array) -> dict[Powers, Any] | None:
    """Sum as a polynomial in cosines and sines of the angles in the rows of ``sums``; None if its degree is too high."""
    inverse = np.rint(np.linalg.inv(sums)).astype(int)
    polynomial: dict[Powers, Any] = defaultdict(int)
    for (kind, f), value in terms.items():
        multiples = np.array(f, int) @ inverse
        if np.abs(multiples).max(initial=0) > _MAX_MULTIPLE:
            return None
        for powers, (real, imaginary) in _expansion(tuple(map(int, multiples))).items():
            part = real if kind == "cos" else imaginary
            if part:
                polynomial[powers] += part * value
    return polynomial


def _expansion(multiples: tuple[int, ...]) -> dict[Powers, tuple[int, int]]:
    """exp(i Σ g_j ψ_j) = Π (cos ψ_j ± i sin ψ_j)^|g_j| as powers (of cos, sin) → (real, imaginary) coefficient."""
    total: dict[Powers, complex] = {((0, 0),) * len(multiples): 1}
    for j, multiple in enumerate(multiples):
        sine_factor = 1j if multiple > 0 else -1j
        for _ in range(abs(multiple)):
            expanded: dict[Powers, complex] = defaultdict(complex)
            for powers, c in total.items():
                cosines, sines = powers[j]
                expanded[*powers[:j], (cosines + 1, sines), *powers[j + 1 :]] += c
                expanded[*powers[:j], (cosines, sines + 1), *powers[j + 1 :]] += c * sine_factor
            total = expanded
    return {powers: (round(c.real), round(c.imag)) for powers, c in total.items()}


def _reduce_squares(form: Mapping[Any, Any], j: int, square: int) -> dict[Any, Any]:
    """Replace sin² = 1 - cos² (square 0) or cos² = 1 - sin² (square 1) of angle j until none is left."""
    remaining, reduced = dict(form), defaultdict[Any, Any](int)
    while remaining:
        powers, c = remaining.popitem()
        if powers[j][1 - square] < 2:
            reduced[powers] += c
            continue
        low, high = list(powers[j]), list(powers[j])
        low[1 - square] -= 2
        high[1 - square] -= 2
        high[square] += 2
        for angle_powers, sign in ((low, 1), (high, -1)):
            key = (*powers[:j], tuple(angle_powers), *powers[j + 1 :])
            remaining[key] = remaining.get(key, 0) + sign * c
    return dict(reduced)
