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
"""Cosine or sine of a sum of angles: ``("cos" | "sin", multiple of each angle)``.

The first non-zero multiple is positive. The constant 1 is cos 0, which has the base number 0.
"""

_BITS = 8
"""Bits of an exponent in a monomial."""
_MASK = (1 << _BITS) - 1
HIGHEST = _MASK
"""Largest exponent in a monomial; a larger one would overflow into the next symbol."""


class Ring:
    """Symbols and angles of the sums, with a table of products of sines and cosines computed so far.

    ``angles`` are those of the ``symbols`` that stand in sines and cosines. Coefficients are floats; their sums are exact if
    all are multiples of powers of two. With ``exact=True`` they are fractions.
    """

    def __init__(self, symbols: Sequence[str], angles: Sequence[str], *, exact: bool = False) -> None:
        self.symbols = tuple(symbols)
        self.angles = tuple(angles)
        self.exact = exact
        self.place = {name: k for k, name in enumerate(self.symbols)}
        """Index of each symbol, and of its exponent in a monomial."""
        self._angle_index = {name: k for k, name in enumerate(self.angles)}
        zero_multiples: tuple[Any, ...] = (0,) * len(self.angles)
        self.bases: list[Basis] = [("cos", zero_multiples)]
        """Sines and cosines by their base number."""
        self._base_numbers: dict[Basis, int] = {self.bases[0]: 0}
        self._products: dict[tuple[int, int], tuple[tuple[int, int], ...]] = {}
        """Results of :meth:`product` by two base numbers."""
        self._derivatives: dict[tuple[int, int], tuple[int, Any]] = {}
        """Results of :meth:`base_derivative` by base number and angle."""

    # ── constructors ──

    def number(self, value: Any) -> TrigPolynomial:
        """Constant sum."""
        if not value:
            return TrigPolynomial(self, {})
        if self.exact and not isinstance(value, float):
            return TrigPolynomial(self, {(0, 0): Fraction(value)})
        return TrigPolynomial(self, {(0, 0): float(value)})

    def symbol(self, name: str) -> TrigPolynomial:
        """Symbol with the given name."""
        monomial = self.monomial({name: 1})
        return TrigPolynomial(self, {(monomial, 0): self._coefficient(1)})

    def wave(self, kind: str, multiples: Sequence[Any]) -> TrigPolynomial:
        """Cosine or sine of a sum of multiples of the angles."""
        basis, sign = _canonical(kind, tuple(multiples))
        if not sign:
            return TrigPolynomial(self, {})
        return TrigPolynomial(self, {(0, self._base_number(basis)): self._coefficient(sign)})

    def _coefficient(self, value: Any) -> Any:
        """Number in the type of the ring's coefficients."""
        return Fraction(value) if self.exact else float(value)

    # ── monomials ──

    def exponents(self, monomial: int) -> dict[str, int]:
        """Map from symbols to non-zero exponents."""
        exponents = {}
        for symbol in self.symbols:
            power = monomial & _MASK
            if power:
                exponents[symbol] = power
            monomial >>= _BITS
        return exponents

    def monomial(self, exponents: dict[str, int]) -> int:
        """Integer that encodes a product of powers."""
        monomial = 0
        for name, power in exponents.items():
            monomial += power << (_BITS * self.place[name])
        return monomial

    # ── sines and cosines ──

    def _base_number(self, basis: Basis) -> int:
        """Number of a sine or cosine; a new one gets the next number."""
        number = self._base_numbers.get(basis)
        if number is None:
            number = len(self.bases)
            self._base_numbers[basis] = number
            self.bases.append(basis)
        return number

    def product(self, a: int, b: int) -> tuple[tuple[int, int], ...]:
        """Twice the product of the bases with the numbers a and b, as pairs (base number, sign)."""
        terms = self._products.get((a, b))
        if terms is None:
            terms = tuple(self._expand_product(a, b))
            self._products[a, b] = terms
            self._products[b, a] = terms
        return terms

    def _expand_product(self, a: int, b: int) -> Iterable[tuple[int, int]]:
        """Pairs of :meth:`product`, computed anew."""
        kind_a, f = self.bases[a]
        kind_b, g = self.bases[b]
        plus = tuple(map(operator.add, f, g))
        minus = tuple(map(operator.sub, f, g))
        # cos⁺ = cos(f + g), cos⁻ = cos(f - g), and sines likewise
        if kind_a == kind_b == "cos":  # 2 cos f cos g = cos⁻ + cos⁺
            waves = [("cos", minus, 1), ("cos", plus, 1)]
        elif kind_a == kind_b:  # 2 sin f sin g = cos⁻ - cos⁺
            waves = [("cos", minus, 1), ("cos", plus, -1)]
        elif kind_a == "sin":  # 2 sin f cos g = sin⁺ + sin⁻
            waves = [("sin", plus, 1), ("sin", minus, 1)]
        else:  # 2 cos f sin g = sin⁺ - sin⁻
            waves = [("sin", plus, 1), ("sin", minus, -1)]
        for kind, multiples, sign in waves:
            basis, basis_sign = _canonical(kind, multiples)
            if basis_sign:
                yield self._base_number(basis), basis_sign * sign

    def base_derivative(self, base: int, angle: int) -> tuple[int, Any]:
        """Derivative of a base by an angle, as (base number, factor); ``base`` and ``angle`` are numbers."""
        derivative = self._derivatives.get((base, angle))
        if derivative is None:
            derivative = self._differentiate(base, angle)
            self._derivatives[base, angle] = derivative
        return derivative

    def _differentiate(self, base: int, angle: int) -> tuple[int, Any]:
        """Pair of :meth:`base_derivative`, computed anew."""
        kind, multiples = self.bases[base]
        factor = multiples[angle]
        if not factor:
            return 0, factor
        if kind == "cos":
            return self._base_number(("sin", multiples)), -factor
        return self._base_number(("cos", multiples)), factor


def _canonical(kind: str, multiples: tuple[Any, ...]) -> tuple[Basis, int]:
    """Basis whose first non-zero multiple is positive, and its factor: -1 for a sine of the opposite, 0 for sin 0, else 1."""
    first_nonzero = next((multiple for multiple in multiples if multiple), 0)
    if first_nonzero < 0:
        opposite = tuple(map(operator.neg, multiples))
        factor = 1 if kind == "cos" else -1  # cos(-x) = cos x, sin(-x) = -sin x
        return (kind, opposite), factor
    is_sin_0 = first_nonzero == 0 and kind == "sin"
    return (kind, multiples), 0 if is_sin_0 else 1


class TrigPolynomial:
    """One sum: ``{(monomial, base): coefficient}``, without zeros. Immutable; usable in NumPy object arrays."""

    __slots__ = ("ring", "terms")

    def __init__(self, ring: Ring, terms: dict[tuple[int, int], Any]) -> None:
        self.ring = ring
        self.terms = terms

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
        longer = self.terms
        shorter = other.terms
        if len(longer) < len(shorter):  # fewer terms are then added one by one
            longer = other.terms
            shorter = self.terms
        terms = dict(longer)
        for key, coefficient in shorter.items():
            total = terms.get(key, 0) + coefficient
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
        ring = self.ring
        terms: dict[tuple[int, int], Any] = {}
        for (monomial_a, a), x in self.terms.items():
            for (monomial_b, b), y in other.terms.items():
                monomial = monomial_a + monomial_b
                if not a or not b:  # one base is 1, whose number is 0: the product is the other one
                    key = (monomial, a or b)
                    terms[key] = terms.get(key, 0) + x * y
                    continue
                half_product = x * y / 2
                for base, sign in ring.product(a, b):
                    key = (monomial, base)
                    terms[key] = terms.get(key, 0) + (half_product if sign > 0 else -half_product)
        return TrigPolynomial(ring, {key: value for key, value in terms.items() if value})

    __rmul__ = __mul__

    def diff(self, name: str) -> TrigPolynomial:
        """Derivative with respect to a symbol, including sines and cosines if the symbol is an angle."""
        ring = self.ring
        shift = _BITS * ring.place[name]  # of the symbol's exponent in a monomial
        angle = ring._angle_index.get(name)
        terms: dict[tuple[int, int], Any] = {}
        for (monomial, base), value in self.terms.items():
            power = (monomial >> shift) & _MASK
            if power:  # power rule: the exponent decreases by one
                key = (monomial - (1 << shift), base)
                terms[key] = terms.get(key, 0) + power * value
            if angle is not None and base:
                new_base, factor = ring.base_derivative(base, angle)
                if factor:
                    key = (monomial, new_base)
                    terms[key] = terms.get(key, 0) + ring._coefficient(factor) * value
        return TrigPolynomial(ring, {key: value for key, value in terms.items() if value})

    def split(self, names: Sequence[str]) -> dict[int, TrigPolynomial]:
        """Coefficient of each monomial in the named symbols: a sum in the other symbols, by monomial."""
        mask = 0  # bits of the exponents of the named symbols
        for name in names:
            mask |= _MASK << (_BITS * self.ring.place[name])
        terms_by_monomial: dict[int, dict[tuple[int, int], Any]] = {}
        for (monomial, base), value in self.terms.items():
            terms = terms_by_monomial.setdefault(monomial & mask, {})
            terms[monomial & ~mask, base] = value
        return {monomial: TrigPolynomial(self.ring, terms) for monomial, terms in terms_by_monomial.items()}

    def without_dust(self, share: float) -> TrigPolynomial:
        """Sum without terms up to a share of its largest term, which are rounding errors of cancelled terms."""
        largest_coefficient = max(map(abs, self.terms.values()), default=0.0)
        threshold = share * largest_coefficient
        return TrigPolynomial(self.ring, {key: value for key, value in self.terms.items() if abs(value) > threshold})


# ── Shortest forms: sums of angles, or products of single angles

Waves = tuple[tuple[Basis, int], ...]
"""Product of powers of sines and cosines."""

Powers = tuple[tuple[int, int], ...]
"""Powers of the cosine and of the sine of each angle."""

# Products are sought only for small sums, since the number of products grows with these three.
_MAX_TERMS = 40
_MAX_ANGLES = 4
_MAX_MULTIPLE = 4
"""Largest multiple of one angle."""


class ShortestForms:
    """Shortest forms of sums of sines and cosines, cached.

    Each of ``families`` is a set of angles that products may contain: a matrix whose rows are multiples of the joint angles.
    """

    def __init__(self, families: list[Array]) -> None:
        self._families = families
        self._cache: dict[Any, dict[Waves, Any]] = {}  # shortest form by terms

    def shortest(self, terms: dict[Basis, Any]) -> dict[Waves, Any]:
        """Sum of cosines and sines, unchanged or as products if those are shorter."""
        unchanged: dict[Waves, Any] = {_waves_of({basis: 1}): coefficient for basis, coefficient in terms.items()}
        all_multiples = [multiple for _, multiples in terms for multiple in multiples]
        are_integers = all(isinstance(multiple, int) for multiple in all_multiples)
        if len(terms) > _MAX_TERMS or not are_integers:
            return unchanged
        if len(terms) == 1 and max(map(abs, all_multiples), default=0) <= 1:
            return unchanged
        key = tuple(sorted(terms.items()))
        if key not in self._cache:
            forms = [unchanged]
            for family in self._families:
                forms.extend(_products(terms, family))
            self._cache[key] = min(forms, key=_length)
        return self._cache[key]


def _length(form: dict[Waves, Any]) -> tuple[int, int, int, int]:
    """Sort key: numbers of terms, of waves with a multiple angle such as 2θ, of half-integer coefficients, and of factors."""
    multiple_angles = 0
    factors = 0
    halves = 0
    for waves, coefficient in form.items():
        if float(2 * coefficient).is_integer() and not float(coefficient).is_integer():
            halves += 1
        for (_, multiples), power in waves:
            factors += power
            if max(map(abs, multiples)) > 1:
                multiple_angles += 1
    return len(form), multiple_angles, halves, factors


def _waves_of(powers: Mapping[Basis, int]) -> Waves:
    """Product of powers without factors 1, which are powers with exponent zero and powers of cos 0."""
    waves = []
    for (kind, multiples), power in powers.items():
        if power and any(multiples):
            waves.append(((kind, multiples), power))
    return tuple(sorted(waves))


def _products(terms: dict[Basis, Any], family: Array) -> Iterable[dict[Waves, Any]]:
    """Sum as polynomials in the cosines and sines of the angles in the rows of ``family``.

    For each angle, either squares of its cosine or squares of its sine remain. There is a polynomial for each such choice.
    """
    polynomial = _angle_polynomial(terms, family)
    if polynomial is None:
        return
    exponents = np.array(list(polynomial), int).reshape(-1, len(family), 2)
    angle_indices = np.flatnonzero(exponents.any(axis=(0, 2))).tolist()  # of angles that occur
    if len(angle_indices) > _MAX_ANGLES:
        return
    angles = list(map(tuple, family.tolist()))
    for remaining_squares in product((0, 1), repeat=len(angle_indices)):  # squares of cosines (0) or sines (1)
        form = dict(polynomial)
        for j, square in zip(angle_indices, remaining_squares, strict=True):
            form = _reduce_squares(form, j, square)
        rounding_error = 1e-14 * max(map(abs, form.values()), default=0)
        waves_form = {}
        for powers, coefficient in form.items():
            if abs(coefficient) > rounding_error:
                wave_powers = {}
                for j in angle_indices:
                    cosine_power, sine_power = powers[j]
                    wave_powers["cos", angles[j]] = cosine_power
                    wave_powers["sin", angles[j]] = sine_power
                waves_form[_waves_of(wave_powers)] = coefficient
        yield waves_form


def _angle_polynomial(terms: dict[Basis, Any], family: Array) -> dict[Powers, Any] | None:
    """Sum as a polynomial in cosines and sines of the angles in the rows of ``family``; None if its degree is too high."""
    inverse = np.rint(np.linalg.inv(family)).astype(int)  # joint angles as integer multiples of the family's angles
    polynomial: dict[Powers, Any] = defaultdict(int)
    for (kind, f), value in terms.items():
        multiples = np.array(f, int) @ inverse
        if np.abs(multiples).max(initial=0) > _MAX_MULTIPLE:
            return None
        exponential = _expand_exponential(tuple(map(int, multiples)))
        for powers, (real, imaginary) in exponential.items():
            coefficient = real if kind == "cos" else imaginary  # cos x = Re exp(i x), sin x = Im exp(i x)
            if coefficient:
                polynomial[powers] += coefficient * value
    return polynomial


def _expand_exponential(multiples: tuple[int, ...]) -> dict[Powers, tuple[int, int]]:
    """exp(i Σ g_j ψ_j) = Π (cos ψ_j ± i sin ψ_j)^|g_j| for multiples g: real and imaginary parts of coefficients, by powers."""
    total: dict[Powers, complex] = {((0, 0),) * len(multiples): 1}
    for j, multiple in enumerate(multiples):
        sine_factor = 1j if multiple > 0 else -1j
        for _ in range(abs(multiple)):
            expanded: dict[Powers, complex] = defaultdict(complex)
            for powers, c in total.items():
                cosine_power, sine_power = powers[j]
                expanded[*powers[:j], (cosine_power + 1, sine_power), *powers[j + 1 :]] += c
                expanded[*powers[:j], (cosine_power, sine_power + 1), *powers[j + 1 :]] += c * sine_factor
            total = expanded
    return {powers: (round(c.real), round(c.imag)) for powers, c in total.items()}


def _reduce_squares(form: Mapping[Any, Any], j: int, square: int) -> dict[Any, Any]:
    """Replace sin² = 1 - cos² (square 0) or cos² = 1 - sin² (square 1) of angle j until none is left."""
    remaining = dict(form)
    reduced: dict[Any, Any] = defaultdict(int)
    remaining_wave = square  # index into the powers of an angle: 0 of the cosine, 1 of the sine
    replaced_wave = 1 - square
    while remaining:
        powers, coefficient = remaining.popitem()
        if powers[j][replaced_wave] < 2:
            reduced[powers] += coefficient
            continue
        times_one = list(powers[j])  # powers of the angle after the square is replaced by 1
        times_one[replaced_wave] -= 2
        times_square = list(times_one)  # and by the other square
        times_square[remaining_wave] += 2
        for angle_powers, sign in ((times_one, 1), (times_square, -1)):
            key = (*powers[:j], tuple(angle_powers), *powers[j + 1 :])
            remaining[key] = remaining.get(key, 0) + sign * coefficient
    return dict(reduced)
