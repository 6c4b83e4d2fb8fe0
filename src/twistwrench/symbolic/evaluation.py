"""Numbers from expressions: a walk over the tree, each distinct node once, on arrays of samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..typing import Array
from .equations import Equations


class Evaluator:
    """Values of expressions, given those of their symbols; definitions are worked off first, in order."""

    def __init__(self, values: Mapping[Any, Any]) -> None:
        self._known: dict[Any, Any] = dict(values)

    @classmethod
    def at(cls, equations: Equations, q: Array, dq: Array, ddq: Array) -> Evaluator:
        """At states (..., n), the parameters at their own values."""
        values: dict[Any, Any] = dict(equations.values)
        for symbols, array in ((equations.q, q), (equations.dq, dq), (equations.ddq, ddq)):
            values |= {symbol: array[..., k] for k, symbol in enumerate(symbols)}
        found = cls(values)
        for symbol, expr in equations.definitions:
            found._known[symbol] = found(expr)
        return found

    def __call__(self, expr: Any) -> Any:
        """The value of one expression."""
        known = self._known.get(expr)
        if known is None:
            known = self._known[expr] = self._value(expr)
        return known

    def array(self, exprs: Any, batch: tuple[int, ...]) -> Array:
        """Values of a matrix or array of expressions, (*batch, *its shape)."""
        shape = tuple(int(n) for n in exprs.shape)
        rows = [np.broadcast_to(self(exprs[place]), batch) for place in np.ndindex(shape)]
        return np.stack(rows, axis=-1).reshape(*batch, *shape)

    def _value(self, expr: Any) -> Any:
        if expr.is_Number:
            return float(expr)
        if expr.is_Add:
            return sum(map(self, expr.args))
        if expr.is_Mul:
            total = 1.0
            for factor in expr.args:
                total = total * self(factor)
            return total
        if expr.is_Pow and expr.exp.is_Integer:
            return self(expr.base) ** int(expr.exp)
        if expr.is_Pow:
            return np.power(self(expr.base), self(expr.exp))
        return getattr(np, expr.func.__name__)(*map(self, expr.args))
