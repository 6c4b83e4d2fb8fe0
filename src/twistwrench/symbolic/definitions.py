"""Definitions of intermediate results, in order, and the derivatives of what they define."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..joints.chart import exact
from ..typing import Array
from .generalized_coordinates import Coordinate
from .symbols import Entry, ModelEntries

AXES = "xyz"


def exact_number(value: float) -> Any:
    """A SymPy number: whole ones exact, so that 0 and ±1 leave nothing behind."""
    import sympy

    return sympy.sympify(exact(value))


class Definitions:
    """Definitions in order, and the derivatives of what they define."""

    def __init__(self, coordinates: tuple[Coordinate, ...], entries: ModelEntries) -> None:
        import sympy

        self._sympy = sympy
        self.q = [sympy.Symbol(c.name) for c in coordinates]
        self.definitions: list[tuple[Any, Any]] = []
        self.groups: list[tuple[str, str, int]] = []
        self._taken = {s.name for s in self.q} | {p.name for p in entries.parameters}
        self._expr: dict[Any, Any] = {}
        self._slopes: dict[tuple[Any, int], Any] = {}
        self._waves: dict[tuple[int, float, float], tuple[Any, Any]] = {}

    def group(self, name: str, remark: str) -> None:
        """What is defined from here on belongs to this step."""
        self.groups.append((name, remark, len(self.definitions)))

    def name(self, name: str, expr: Any) -> Any:
        """The expression itself where it is a number or at most a product of a number and a symbol; else a new name."""
        expr = self._sympy.sympify(expr)
        core = expr.as_coeff_Mul()[1]
        if core.is_Symbol or not expr.free_symbols:
            return expr
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        symbol = self._sympy.Symbol(name)
        self.definitions.append((symbol, expr))
        self._expr[symbol] = expr
        return symbol

    def names(self, pattern: str, vector: Array) -> Array:
        """Names for the entries of a vector: x, y, z appended."""
        return np.array([self.name(f"{pattern}{AXES[k]}", x) for k, x in enumerate(vector)], object)

    def slope(self, expr: Any, k: int) -> Any:
        """d(expr)/dq_k, through the definitions; derivatives of names get names."""
        total = self._sympy.Integer(0)
        for symbol in sorted(expr.free_symbols, key=str):
            inner = self._symbol_slope(symbol, k)
            if inner != 0:
                total = total + expr.diff(symbol) * inner
        return total

    def _symbol_slope(self, symbol: Any, k: int) -> Any:
        if symbol == self.q[k]:
            return self._sympy.Integer(1)
        if symbol not in self._expr:
            return self._sympy.Integer(0)
        if (symbol, k) not in self._slopes:
            self._slopes[symbol, k] = self.name(f"d{symbol.name}_q{k + 1}", self.slope(self._expr[symbol], k))
        return self._slopes[symbol, k]

    # ── the arithmetic of kinematics ──

    def number(self, entry: Entry) -> Any:
        """A number of the model, or its symbol."""
        if entry.parameter is None:
            return exact_number(entry.value)
        return entry.sign * self._sympy.Symbol(entry.parameter.name)

    def coordinate(self, k: int) -> Any:
        """The k-th coordinate itself."""
        return self.q[k]

    def cosine_sine(self, k: int, rate: float, offset: float) -> tuple[Any, Any]:
        """Names for the cosine and sine; those of a coordinate itself are c_k and s_k."""
        key = (k, rate, offset)
        if key not in self._waves:
            again = sum(1 for other in self._waves if other[0] == k)
            index = f"{self.q[k].name.partition('_')[2]}{'_' + str(again + 1) if again else ''}"
            argument = exact_number(rate) * self.q[k] + exact_number(offset)
            letter = "" if self.q[k].name.startswith("theta") else self.q[k].name.partition("_")[0]
            self._waves[key] = (
                self.name(f"c{letter}_{index}", self._sympy.cos(argument)),
                self.name(f"s{letter}_{index}", self._sympy.sin(argument)),
            )
            c, s = self._waves[key]
            if c in self._expr:  # their derivatives are each other, not sines and cosines anew
                self._slopes[c, k], self._slopes[s, k] = -exact_number(rate) * s, exact_number(rate) * c
        return self._waves[key]
