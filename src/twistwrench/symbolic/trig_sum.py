"""Sums of products: numbers times symbols times one sine or cosine of a sum of angles. Canonical, so zero is no terms.

A person writes sums of angles, and so does this: every product of sines and cosines becomes a sum of them at once,
cos a cos b = ½ (cos(a - b) + cos(a + b)). A monomial of symbols is one integer, eight bits an exponent, so that products
add; hundreds of thousands of products take a second where trees of expressions take minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

Basis = tuple[str, tuple[Any, ...]]
"""``("cos" | "sin", multiple of each angle)``; the first multiple that is not zero is positive. cos 0 stands for 1."""

_BITS = 8
_MASK = (1 << _BITS) - 1
HIGHEST = _MASK
"""The highest exponent that a monomial has room for; one more would be carried into the next symbol."""


class Ring:
    """The symbols and angles that sums are made of, and a table of the products of sines and cosines met so far.

    Angles are symbols too: ``angles`` says which. Coefficients are floats, exact as long as all are multiples of powers
    of two; with ``exact=True`` fractions.
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

    # ── ways in ──

    def number(self, value: Any) -> TrigSum:
        """A constant."""
        value = Fraction(value) if self.exact and not isinstance(value, float) else float(value)
        return TrigSum(self, {(0, 0): value} if value else {})

    def symbol(self, name: str) -> TrigSum:
        """A symbol by its name."""
        one: Any = Fraction(1) if self.exact else 1.0
        return TrigSum(self, {(1 << (_BITS * self.place[name]), 0): one})

    def wave(self, kind: str, multiples: Sequence[Any]) -> TrigSum:
        """The cosine or sine of a sum of multiples of the angles."""
        basis, sign = _canonical(kind, tuple(multiples))
        one: Any = Fraction(sign) if self.exact else float(sign)
        return TrigSum(self, {(0, self._number(basis)): one} if sign else {})

    # ── monomials ──

    def exponents(self, monomial: int) -> dict[str, int]:
        """Symbol → exponent, of those that are there."""
        found, k = {}, 0
        while monomial:
            if power := monomial & _MASK:
                found[self.symbols[k]] = power
            monomial, k = monomial >> _BITS, k + 1
        return found

    def monomial(self, exponents: dict[str, int]) -> int:
        """The integer that stands for a product of powers."""
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
            plus, minus = (
                tuple(x + y for x, y in zip(f, g, strict=True)),
                tuple(x - y for x, y in zip(f, g, strict=True)),
            )
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


class TrigSum:
    """One sum: ``{(monomial, base): coefficient}``, without zeros. Lives in NumPy object arrays; never changes."""

    __slots__ = ("ring", "terms")

    def __init__(self, ring: Ring, terms: dict[tuple[int, int], Any]) -> None:
        self.ring, self.terms = ring, terms

    def __repr__(self) -> str:
        return f"<TrigSum of {len(self.terms)} terms>"

    def __len__(self) -> int:
        return len(self.terms)

    def __bool__(self) -> bool:
        return bool(self.terms)

    def __add__(self, other: Any) -> TrigSum:
        if not isinstance(other, TrigSum):
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
        return TrigSum(self.ring, terms)

    __radd__ = __add__

    def __neg__(self) -> TrigSum:
        return TrigSum(self.ring, {key: -value for key, value in self.terms.items()})

    def __sub__(self, other: Any) -> TrigSum:
        return self + (-other)

    def __rsub__(self, other: Any) -> TrigSum:
        return -self + other

    def __mul__(self, other: Any) -> TrigSum:
        if not isinstance(other, TrigSum):
            factor = Fraction(other) if self.ring.exact else float(other)
            return TrigSum(self.ring, {key: factor * value for key, value in self.terms.items()} if factor else {})
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
        return TrigSum(ring, {key: value for key, value in terms.items() if value})

    __rmul__ = __mul__

    def diff(self, name: str) -> TrigSum:
        """The derivative with respect to a symbol, an angle's sines and cosines included."""
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
        return TrigSum(ring, {key: value for key, value in terms.items() if value})

    def split(self, names: Sequence[str]) -> dict[int, TrigSum]:
        """The coefficients of the monomials in some of the symbols."""
        mask = sum(_MASK << (_BITS * self.ring.place[name]) for name in names)
        parts: dict[int, dict[tuple[int, int], Any]] = {}
        for (m, base), value in self.terms.items():
            parts.setdefault(m & mask, {})[m & ~mask, base] = value
        return {motion: TrigSum(self.ring, terms) for motion, terms in parts.items()}

    def without_dust(self, share: float) -> TrigSum:
        """The sum without terms smaller than a share of its largest: round-off of terms that cancel."""
        least = share * max((abs(value) for value in self.terms.values()), default=0.0)
        return TrigSum(self.ring, {key: value for key, value in self.terms.items() if abs(value) > least})
