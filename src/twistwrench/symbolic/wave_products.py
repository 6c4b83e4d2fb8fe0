"""The shortest form of a sum of cosines and sines: of sums of angles, or products of cosines and sines of single ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np

from ..typing import Array
from .trig_sum import Basis

Waves = tuple[tuple[Basis, int], ...]
"""A product of powers of sines and cosines."""

_LONGEST = 40  # terms beyond which a coefficient has no short form to look for


class ShortestForms:
    """The shortest form of each coefficient of symbols, found once.

    ``families`` are the sets of angles, in rows of whole multiples of joint angles, that products may be of.
    """

    def __init__(self, families: list[Array]) -> None:
        self._families = families
        self._found: dict[Any, dict[Waves, Any]] = {}

    def shortest(self, terms: dict[Basis, Any]) -> dict[Waves, Any]:
        """The sum of cosines and sines as it is, or as products where they are shorter."""
        plain: dict[Waves, Any] = {_waves_of({basis: 1}): c for basis, c in terms.items()}
        if len(terms) > _LONGEST or (len(terms) == 1 and all(abs(x) <= 1 for x in next(iter(terms))[1])):
            return plain
        if any(not isinstance(x, int) for _, f in terms for x in f):
            return plain
        key = tuple(sorted(terms.items()))
        if key not in self._found:
            products = (form for sums in self._families for form in _products(terms, sums))
            self._found[key] = min([plain, *products], key=_length)
        return self._found[key]


def _length(form: dict[Waves, Any]) -> tuple[int, int, int, int]:
    """Terms; doubled angles; halves; factors. The first that differs decides."""
    doubled = sum(1 for waves in form for (_, f), _ in waves if any(abs(x) > 1 for x in f))
    halves = sum(1 for c in form.values() if float(2 * c).is_integer() and not float(c).is_integer())
    return len(form), doubled, halves, sum(power for waves in form for _, power in waves)


def _waves_of(powers: Mapping[Basis, int]) -> Waves:
    return tuple(sorted((basis, power) for basis, power in powers.items() if power and any(basis[1])))


def _products(terms: dict[Basis, Any], sums: Array) -> Iterable[dict[Waves, Any]]:
    """The sum as polynomials in the cosines and sines of the angles that are the rows of ``sums``, squares reduced."""
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
    for keep in product((0, 1), repeat=len(involved)):  # of the squares, leave cosines (0) or sines (1)
        form = dict(whole)
        for j, kept in zip(involved, keep, strict=True):
            form = _reduced(form, j, kept)
        yield {
            _waves_of(
                {(("cos", "sin")[s], tuple(int(x) for x in sums[j])): p[j][s] for j in involved for s in (0, 1)}
            ): c
            for p, c in _without_dust(form).items()
        }


def _expansion(g: tuple[int, ...]) -> dict[tuple[tuple[int, int], ...], tuple[int, int]]:
    """exp(i Σ g_j ψ_j) = Π (cos ψ_j ± i sin ψ_j)^|g_j| as powers (of cos, of sin) → (real, imaginary) coefficient."""
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


def _reduced(form: Mapping[Any, Any], j: int, kept: int) -> dict[Any, Any]:
    """sin² = 1 - cos² (kept 0) or cos² = 1 - sin² (kept 1) of angle j, until none is left."""
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


def _without_dust(form: Mapping[Any, Any]) -> dict[Any, Any]:
    least = 1e-14 * max((abs(c) for c in form.values()), default=0)
    return {p: c for p, c in form.items() if abs(c) > least}
