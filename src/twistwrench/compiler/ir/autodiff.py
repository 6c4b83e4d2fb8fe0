"""Derivatives of traced expressions by forward and reverse mode, as expressions of the same trace.

A sweep applies the chain rule to all expressions that the results depend on, once per direction (forward) or per result
(reverse). It starts (forward) or ends (reverse) at *known* expressions, whose derivatives along the directions are given:
usually inputs, or expressions with a shorter formula than the chain rule gives. Operands of known expressions are not visited,
so known expressions may be any mixture of inputs and expressions of inputs.

Source: Griewank and Walther, Evaluating Derivatives, 2nd ed. (2008), chapters 3 (both modes) and 5 (reverse before forward).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...core.typing import Array
from .expr import Expr
from .tracer import operands_of, reachable

Known = Mapping[Expr, Mapping[int, Expr]]
"""Derivatives of an expression by number of the direction; missing ones are zero."""


class Work(NamedTuple):
    """Number of additions and multiplications of a Jacobian in each mode, before constant folding."""

    forward: int
    reverse: int


def jacobian(results: Sequence[Expr], known: Known, directions: int, mode: str = "auto") -> Array:
    """Derivatives of the results along the directions; (len(results), directions).

    ``mode``: ``"forward"``, ``"reverse"``, or ``"auto"`` for the mode with fewer operations by :func:`work`.
    """
    if mode == "auto":
        operations = work(results, known)
        mode = "reverse" if operations.reverse < operations.forward else "forward"
    J = np.full((len(results), directions), 0.0, object)
    if mode == "forward":
        for direction, column in enumerate(_forward(results, known, directions)):
            J[:, direction] = column
        return J
    rows: dict[Expr, Array] = {}  # a symmetric matrix has most entries twice
    for r, result in enumerate(results):
        if result not in rows:
            rows[result] = gradient([result], [result.trace.one], known, directions)
        J[r] = rows[result]
    return J


def along(results: Sequence[Expr], known: Known, direction: Sequence[Any]) -> list[Any]:
    """Derivative of each result along one combination of the directions, by forward mode."""
    rates: dict[Expr, dict[int, Expr]] = {}
    for e, row in known.items():
        rates[e] = {}
        rate = e.trace.zero
        for d, slope in row.items():
            rate = rate + slope * direction[d]
        if rate is not e.trace.zero:
            rates[e][0] = rate
    return _forward(results, rates, 1)[0]


def gradient(results: Sequence[Expr], weights: Sequence[Any], known: Known, directions: int) -> Array:
    """Derivative of Σ weights · results along every direction for constant weights, by reverse mode; (directions,)."""
    nodes = _active(results, known)
    adjoint: dict[Expr, Any] = {}

    def add(node: Expr, part: Any) -> None:
        if node in adjoint:
            part = adjoint[node] + part
        adjoint[node] = part

    for result, weight in zip(results, weights, strict=True):
        add(result, weight)
    total = np.full(directions, 0.0, object)
    for node in reversed(nodes):
        weight = adjoint.get(node)
        if weight is None:
            continue
        if node in known:
            for d, slope in known[node].items():
                total[d] = total[d] + slope * weight
            continue
        for operand, slope in _slopes(node, nodes):
            add(operand, slope * weight)
    return total


def work(results: Sequence[Expr], known: Known) -> Work:
    """Operations of both modes, from the directions that reach each expression and the results that depend on it.

    A product counts one multiplication for each varying factor, and one addition if both vary; sums count their additions.
    """
    reach = _active(results, known)
    used = dict.fromkeys(reach, 0)  # results that depend on each expression, as bits
    for k, result in enumerate(dict.fromkeys(results)):
        if result in reach:
            used[result] |= 1 << k
    forward = reverse = 0
    for node in reversed(reach):
        if node in known:
            ends = sum(slope is not node.trace.one for slope in known[node].values())
            reverse += 2 * ends * used[node].bit_count()
            continue
        operands = [x for x in _made_of(node) if x in reach]
        multiplies = node.op not in ("add", "sub", "neg")
        for x in operands:
            forward += multiplies * reach[x].bit_count()
            reverse += multiplies * used[node].bit_count() + (used[x] & used[node]).bit_count()
            used[x] |= used[node]
        if len(operands) == 2:
            forward += (reach[operands[0]] & reach[operands[1]]).bit_count()
    return Work(forward, reverse)


# ── the chain rule ──


def _share_of_first(node: Expr, a: Any, b: Any) -> Any:
    """1 if a minimum or maximum is its first operand, 0 if it is the second, ½ if they are equal."""
    if node.op == "min":
        return 0.5 + 0.5 * (b - a).sign()
    return 0.5 + 0.5 * (a - b).sign()


_RULES: Mapping[str, tuple[Callable[[Expr, Any, Any], Any], ...]] = {
    "add": (lambda f, a, b: 1.0, lambda f, a, b: 1.0),
    "sub": (lambda f, a, b: 1.0, lambda f, a, b: -1.0),
    "neg": (lambda f, a, b: -1.0,),
    "mul": (lambda f, a, b: b, lambda f, a, b: a),
    "div": (lambda f, a, b: 1.0 / b, lambda f, a, b: -(f * (1.0 / b))),
    "sqrt": (lambda f, a, b: 0.5 / f,),
    "sin": (lambda f, a, b: a.cos(),),
    "cos": (lambda f, a, b: -a.sin(),),
    "exp": (lambda f, a, b: f,),
    "sign": (lambda f, a, b: 0.0,),  # piecewise constant
    "min": (_share_of_first, lambda f, a, b: 1.0 - _share_of_first(f, a, b)),
    "max": (_share_of_first, lambda f, a, b: 1.0 - _share_of_first(f, a, b)),
    "tanh": (lambda f, a, b: 1.0 - f * f,),
    "log": (lambda f, a, b: 1.0 / a,),
    "arctan2": (lambda f, a, b: b / (a * a + b * b), lambda f, a, b: -(a / (a * a + b * b))),
}
"""Derivative of f(a, b) with respect to each operand."""


def _made_of(node: Expr) -> tuple[Expr, ...]:
    """Operands of an operation, or of the function that it computes."""
    composed = node.trace.composed
    if composed and node.index in composed:
        return composed[node.index].operands
    return operands_of(node)


def _slopes(node: Expr, active: Mapping[Expr, int]) -> list[tuple[Expr, Any]]:
    """Varying operands of an operation, each with the derivative by it."""
    operands = _made_of(node)
    if not operands:
        return []
    composed = node.trace.composed.get(node.index)
    rules = _RULES[node.op if composed is None else composed.name]
    a, b = (*operands, None)[:2]
    return [(x, rule(node, a, b)) for x, rule in zip(operands, rules, strict=True) if x in active]


def _forward(results: Sequence[Expr], known: Known, directions: int) -> list[list[Any]]:
    """One sweep for each direction, in the order of evaluation."""
    active = _active(results, known)
    slopes_of: dict[Expr, Sequence[tuple[Expr, Any]]] = {}
    for node in active:
        if node not in known:
            slopes_of[node] = _slopes(node, active)
    columns = []
    for d in range(directions):
        rates: dict[Expr, Any] = {}
        for node, reach in active.items():
            if not reach >> d & 1:
                continue
            if node in known:
                rates[node] = known[node][d]
                continue
            total: Any = 0.0
            for operand, slope in slopes_of[node]:
                if operand in rates:
                    total = total + slope * rates[operand]
            rates[node] = total
        columns.append([rates.get(result, 0.0) for result in results])
    return columns


def _active(results: Sequence[Expr], known: Known) -> dict[Expr, int]:
    """Varying expressions between known ones and the results, operands first, with their directions as bits."""
    masks: dict[Expr, int] = {}
    nodes = reachable(results, lambda x: () if x in known else _made_of(x))
    for node in sorted(nodes, key=lambda x: x.index):
        mask = sum(1 << d for d in known.get(node, ()))
        if node not in known and node.op != "sign":
            for x in _made_of(node):
                mask |= masks.get(x, 0)
        if mask:
            masks[node] = mask
    return masks
