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
        value = Fraction(value) if self.exact and not isinstance(value, float) else float(value)
        return TrigPolynomial(self, {(0, 0): value} if value else {})

    def symbol(self, name: str) -> TrigPolynomial:
        """Symbol with the given name."""
        one: Any = Fraction(1) if self.exact else 1.0
        return TrigPolynomial(self, {(1 << (_BITS * self.place[name]), 0): one})

    def wave(self, kind: str, multiples: Sequence[Any]) -> TrigPolynomial:
        """Cosine or sine of a sum of multiples of the angles."""
        basis, sign = _canonical(kind, tuple(multiples))
        one: Any = Fraction(sign) if self.exact else float(sign)
        return TrigPolynomial(self, {(0, self._number(basis)): one} if sign else {})

    # ── monomials ──

    def exponents(self, monomial: int) -> dict[str, int]:
        """Map from symbols to non-zero exponents."""
        found, k = {}, 0
        while monomial:
            if power := monomial & _MASK:
                found[self.symbols[k]] = power
            monomial, k = monomial >> _BITS, k + 1
        return found

    def monomial(self, exponents: dict[str, int]) -> int:
        """Integer that encodes a product of powers."""
        return sum(power << (_BITS * self.place[name]) for name, power in exponents.items())

    # ── sines and cosines ──

    def _number(self, basis: Basis) -> int:
        number = self._numbers.get(basis)
        if number is None:
            number = self._numbers[basis] = len(self.bases)
            self.bases.append(basis)
        return number

    def product(self, a: int, b: int) -> tuple[tuple[int, int], ...]:
        """Twice the product of two bases, as (base, sign) pairs."""
        found = self._products.get((a, b))
        if found is None:
            (kind_a, f), (kind_b, g) = self.bases[a], self.bases[b]
            plus, minus = tuple(map(operator.add, f, g)), tuple(map(operator.sub, f, g))
            if kind_a == kind_b:  # cos cos = ½ (cos⁻ + cos⁺), sin sin = ½ (cos⁻ - cos⁺)
                parts = [("cos", minus, 1), ("cos", plus, 1 if kind_a == "cos" else -1)]
            else:  # sin f cos g = ½ (sin⁺ + sin⁻), cos f sin g = ½ (sin⁺ - sin⁻)
                parts = [("sin", plus, 1), ("sin", minus, 1 if kind_a == "sin" else -1)]
            waves = [(_canonical(kind, h), sign) for kind, h, sign in parts]
            found = tuple((self._number(basis), own * sign) for (basis, own), sign in waves if own)
            self._products[a, b] = self._products[b, a] = found
        return found

    def slope(self, base: int, angle: int) -> tuple[int, Any]:
        """d(base)/d(angle) as (base, factor)."""
        found = self._slopes.get((base, angle))
        if found is None:
            kind, f = self.bases[base]
            other = ("sin" if kind == "cos" else "cos", f)
            found = self._number(other) if f[angle] else 0, -f[angle] if kind == "cos" else f[angle]
            self._slopes[base, angle] = found
        return found


def _canonical(kind: str, multiples: tuple[Any, ...]) -> tuple[Basis, int]:
    first = next((x for x in multiples if x), 0)
    if first < 0:
        return (kind, tuple(-x for x in multiples)), 1 if kind == "cos" else -1
    return (kind, multiples), 0 if first == 0 and kind == "sin" else 1


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
            factor = Fraction(other) if self.ring.exact else float(other)
            scaled = {key: factor * value for key, value in self.terms.items()} if factor else {}
            return TrigPolynomial(self.ring, scaled)
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
            if power := (m >> shift) & _MASK:
                key = (m - (1 << shift), base)
                terms[key] = terms.get(key, 0) + power * value
            if angle is not None and base:
                other, factor = ring.slope(base, angle)
                if factor:
                    terms[m, other] = terms.get((m, other), 0) + (factor if ring.exact else float(factor)) * value
        return TrigPolynomial(ring, {key: value for key, value in terms.items() if value})

    def split(self, names: Sequence[str]) -> dict[int, TrigPolynomial]:
        """Coefficients of the monomials in some of the symbols."""
        mask = sum(_MASK << (_BITS * self.ring.place[name]) for name in names)
        parts: dict[int, dict[tuple[int, int], Any]] = {}
        for (m, base), value in self.terms.items():
            parts.setdefault(m & mask, {})[m & ~mask, base] = value
        return {motion: TrigPolynomial(self.ring, terms) for motion, terms in parts.items()}

    def without_dust(self, share: float) -> TrigPolynomial:
        """Sum without terms below a share of its largest term, which are rounding errors of cancelled terms."""
        least = share * max((abs(value) for value in self.terms.values()), default=0.0)
        return TrigPolynomial(self.ring, {key: value for key, value in self.terms.items() if abs(value) > least})


# ── Shortest forms: sums of angles, or products of single angles

Waves = tuple[tuple[Basis, int], ...]
"""Product of powers of sines and cosines."""

_MAX_TERMS = 40  # maximum number of terms for which a short form is sought


class ShortestForms:
    """Shortest form of each coefficient of symbols, cached.

    ``families`` are the sets of angles allowed in products, as rows of integer multiples of joint angles.
    """

    def __init__(self, families: list[Array]) -> None:
        self._families = families
        self._found: dict[Any, dict[Waves, Any]] = {}

    def shortest(self, terms: dict[Basis, Any]) -> dict[Waves, Any]:
        """Sum of cosines and sines, unchanged or as products if those are shorter."""
        plain: dict[Waves, Any] = {_waves_of({basis: 1}): c for basis, c in terms.items()}
        if len(terms) > _MAX_TERMS or (len(terms) == 1 and all(abs(x) <= 1 for x in next(iter(terms))[1])):
            return plain
        if any(not isinstance(x, int) for _, f in terms for x in f):
            return plain
        key = tuple(sorted(terms.items()))
        if key not in self._found:
            products = (form for sums in self._families for form in _products(terms, sums))
            self._found[key] = min([plain, *products], key=_length)
        return self._found[key]


def _length(form: dict[Waves, Any]) -> tuple[int, int, int, int]:
    """Sort key: number of terms, doubled angles, halves, factors."""
    doubled = sum(1 for waves in form for (_, f), _ in waves if any(abs(x) > 1 for x in f))
    halves = sum(1 for c in form.values() if float(2 * c).is_integer() and not float(c).is_integer())
    return len(form), doubled, halves, sum(power for waves in form for _, power in waves)


def _waves_of(powers: Mapping[Basis, int]) -> Waves:
    return tuple(sorted((basis, power) for basis, power in powers.items() if power and any(basis[1])))


def _products(terms: dict[Basis, Any], sums: Array) -> Iterable[dict[Waves, Any]]:
    """Sum as polynomials in the cosines and sines of the angles in the rows of ``sums``, with reduced squares."""
    inverse = np.rint(np.linalg.inv(sums)).astype(int)
    n = len(sums)
    whole: dict[tuple[tuple[int, int], ...], Any] = defaultdict(int)
    for (kind, f), value in terms.items():
        g = np.array(f, int) @ inverse
        if np.abs(g).max(initial=0) > 4:
            return
        for powers, (real, imaginary) in _expansion(tuple(map(int, g))).items():
            part = real if kind == "cos" else imaginary
            if part:
                whole[powers] += part * value
    involved = [j for j in range(n) if any(p[j][0] or p[j][1] for p in whole)]
    if len(involved) > 4:
        return
    for keep in product((0, 1), repeat=len(involved)):  # keep squares of cosines (0) or sines (1)
        form = dict(whole)
        for j, kept in zip(involved, keep, strict=True):
            form = _reduce_squares(form, j, kept)
        least = 1e-14 * max((abs(c) for c in form.values()), default=0)
        bases = [(j, s, (("cos", "sin")[s], tuple(int(x) for x in sums[j]))) for j in involved for s in (0, 1)]
        yield {_waves_of({basis: p[j][s] for j, s, basis in bases}): c for p, c in form.items() if abs(c) > least}


def _expansion(g: tuple[int, ...]) -> dict[tuple[tuple[int, int], ...], tuple[int, int]]:
    """exp(i Σ g_j ψ_j) = Π (cos ψ_j ± i sin ψ_j)^|g_j| as powers (of cos, sin) → (real, imaginary) coefficient."""
    total: dict[tuple[tuple[int, int], ...], complex] = {((0, 0),) * len(g): 1}
    for j, power in enumerate(g):
        for _ in range(abs(power)):
            grown: dict[tuple[tuple[int, int], ...], complex] = defaultdict(complex)
            for p, c in total.items():
                (a, b) = p[j]
                grown[*p[:j], (a + 1, b), *p[j + 1 :]] += c
                grown[*p[:j], (a, b + 1), *p[j + 1 :]] += c * (1j if power > 0 else -1j)
            total = grown
    return {p: (round(c.real), round(c.imag)) for p, c in total.items()}


def _reduce_squares(form: Mapping[Any, Any], j: int, kept: int) -> dict[Any, Any]:
    """Replace sin² = 1 - cos² (kept 0) or cos² = 1 - sin² (kept 1) of angle j until none is left."""
    todo, done = dict(form), defaultdict[Any, Any](int)
    while todo:
        p, c = todo.popitem()
        if p[j][1 - kept] < 2:
            done[p] += c
            continue
        low, high = list(p[j]), list(p[j])
        low[1 - kept] -= 2
        high[1 - kept] -= 2
        high[kept] += 2
        for powers, sign in ((low, 1), (high, -1)):
            q = (*p[:j], tuple(powers), *p[j + 1 :])
            todo[q] = todo.get(q, 0) + sign * c
    return dict(done)
