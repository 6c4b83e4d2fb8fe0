"""Derivatives of traced expressions by forward and reverse mode, as expressions of the same trace.

A sweep applies the chain rule to all expressions that the results depend on. Forward mode needs a sweep for each direction,
reverse mode one for each result. Sweeps begin (forward) or end (reverse) at *known* expressions, whose derivatives along the
directions are given. Most of these are inputs; others have a shorter derivative than the chain rule gives. Operands of known
expressions are not visited, so known expressions may be any mixture of inputs and expressions of inputs.

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
"""Derivatives of each known expression, by number of the direction; missing ones are zero."""


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
        for direction, column in enumerate(_forward_sweeps(results, known, directions)):
            J[:, direction] = column
        return J
    gradients: dict[Expr, Array] = {}  # by result, since a symmetric matrix has most entries twice
    for row, result in enumerate(results):
        if result not in gradients:
            gradients[result] = gradient([result], [result.trace.one], known, directions)
        J[row] = gradients[result]
    return J


def along(results: Sequence[Expr], known: Known, direction: Sequence[Any]) -> list[Any]:
    """Derivative of each result along Σ_d direction[d] · (direction d), by one sweep of forward mode."""
    known_rates: dict[Expr, dict[int, Expr]] = {}  # along the only direction, which has number 0
    for node, derivatives in known.items():
        known_rates[node] = {}
        rate = node.trace.zero
        for d, derivative in derivatives.items():
            rate = rate + derivative * direction[d]
        if rate is not node.trace.zero:
            known_rates[node][0] = rate
    (rates_of_results,) = _forward_sweeps(results, known_rates, 1)
    return rates_of_results


def gradient(results: Sequence[Expr], weights: Sequence[Any], known: Known, directions: int) -> Array:
    """Derivative of Σ weights · results along every direction for constant weights, by reverse mode; (directions,)."""
    nodes = _varying_nodes(results, known)
    adjoints: dict[Expr, Any] = {}  # derivatives of the sum with respect to each expression

    def add_to_adjoint(node: Expr, term: Any) -> None:
        if node in adjoints:
            term = adjoints[node] + term
        adjoints[node] = term

    for result, weight in zip(results, weights, strict=True):
        add_to_adjoint(result, weight)
    derivatives = np.full(directions, 0.0, object)
    for node in reversed(nodes):
        adjoint = adjoints.get(node)
        if adjoint is None:
            continue
        if node in known:
            for d, derivative in known[node].items():
                derivatives[d] = derivatives[d] + derivative * adjoint
            continue
        for operand, derivative in _local_derivatives(node, nodes):
            add_to_adjoint(operand, derivative * adjoint)
    return derivatives


def work(results: Sequence[Expr], known: Known) -> Work:
    """Operations of both modes, from the directions that reach each expression and the results that depend on it.

    A product counts one multiplication for each varying factor, and one addition if both vary; sums count their additions.
    """
    directions_of = _varying_nodes(results, known)  # directions that reach each expression, as bits
    results_of = dict.fromkeys(directions_of, 0)  # results that depend on each expression, as bits
    for k, result in enumerate(dict.fromkeys(results)):
        if result in directions_of:
            results_of[result] |= 1 << k
    forward = 0
    reverse = 0
    for node in reversed(directions_of):
        if node in known:
            factor_count = sum(derivative is not node.trace.one for derivative in known[node].values())
            reverse += 2 * factor_count * results_of[node].bit_count()  # a multiplication and an addition each
            continue
        operands = [operand for operand in _operands_of_function(node) if operand in directions_of]
        multiplies = node.op not in ("add", "sub", "neg")
        for operand in operands:
            forward += multiplies * directions_of[operand].bit_count()
            reverse += multiplies * results_of[node].bit_count()
            # An adjoint that exists already gets an addition.
            reverse += (results_of[operand] & results_of[node]).bit_count()
            results_of[operand] |= results_of[node]
        if len(operands) == 2:
            a, b = operands
            forward += (directions_of[a] & directions_of[b]).bit_count()
    return Work(forward, reverse)


# ── the chain rule ──


def _derivative_by_first(node: Expr, a: Any, b: Any) -> Any:
    """Derivative of a minimum or maximum by its first operand: 1 if it is this one, 0 if the other, ½ if both are equal."""
    if node.op == "min":
        return 0.5 + 0.5 * (b - a).sign()
    return 0.5 + 0.5 * (a - b).sign()


# name: derivative by a, derivative by b
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
    "min": (_derivative_by_first, lambda f, a, b: 1.0 - _derivative_by_first(f, a, b)),
    "max": (_derivative_by_first, lambda f, a, b: 1.0 - _derivative_by_first(f, a, b)),
    "tanh": (lambda f, a, b: 1.0 - f * f,),
    "log": (lambda f, a, b: 1.0 / a,),
    "arctan2": (lambda f, a, b: b / (a * a + b * b), lambda f, a, b: -(a / (a * a + b * b))),
}
"""Derivatives of f = f(a, b) by a and by b, by name of the operation or composed function."""


def _operands_of_function(node: Expr) -> tuple[Expr, ...]:
    """Operands of an operation, or of the composed function whose last operation it is."""
    composed = node.trace.composed
    if composed and node.index in composed:
        return composed[node.index].operands
    return operands_of(node)


def _local_derivatives(node: Expr, varying: Mapping[Expr, int]) -> list[tuple[Expr, Any]]:
    """Varying operands of an operation, each with the derivative of the operation with respect to it."""
    operands = _operands_of_function(node)
    if not operands:
        return []
    composed = node.trace.composed.get(node.index)
    rules = _RULES[node.op if composed is None else composed.name]
    a = operands[0]
    b = operands[1] if len(operands) > 1 else None  # no rule of a single operand reads b
    return [(operand, rule(node, a, b)) for operand, rule in zip(operands, rules, strict=True) if operand in varying]


def _forward_sweeps(results: Sequence[Expr], known: Known, directions: int) -> list[list[Any]]:
    """Derivatives of the results along each direction: one sweep for each direction, in the order of evaluation."""
    varying = _varying_nodes(results, known)
    local_derivatives: dict[Expr, Sequence[tuple[Expr, Any]]] = {}
    for node in varying:
        if node not in known:
            local_derivatives[node] = _local_derivatives(node, varying)
    rates_of_results = []
    for d in range(directions):
        rates: dict[Expr, Any] = {}  # derivatives along direction d
        for node, direction_bits in varying.items():
            varies_along_d = (direction_bits >> d) & 1
            if not varies_along_d:
                continue
            if node in known:
                rates[node] = known[node][d]
                continue
            rate: Any = 0.0
            for operand, derivative in local_derivatives[node]:
                if operand in rates:
                    rate = rate + derivative * rates[operand]
            rates[node] = rate
        rates_of_results.append([rates.get(result, 0.0) for result in results])
    return rates_of_results


def _varying_nodes(results: Sequence[Expr], known: Known) -> dict[Expr, int]:
    """Expressions from known ones to the results that vary in some direction, operands first; bit d stands for direction d."""
    direction_bits: dict[Expr, int] = {}
    nodes = reachable(results, lambda node: () if node in known else _operands_of_function(node))
    for node in sorted(nodes, key=lambda node: node.index):  # operands have smaller indices
        bits = sum(1 << d for d in known.get(node, ()))
        if node not in known and node.op != "sign":  # a sign is piecewise constant
            for operand in _operands_of_function(node):
                bits |= direction_bits.get(operand, 0)
        if bits:
            direction_bits[node] = bits
    return direction_bits
