"""From expressions to a program: choose an order, fuse products into the sums that use them, number what remains.

The order matters more than anything a compiler does afterwards, because a program has thousands of values and a processor
a few dozen registers. Programs keep the order in which the algorithm made their values, sines and cosines first: what
belongs together in time stays together. Depth first from the results spills half as much again (see bench/NOTES.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .expr import Expr
from .port import Port
from .program import FUSED, Instruction, Program


def build(results: Sequence[Expr], inputs: tuple[Port, ...], outputs: tuple[Port, ...]) -> Program:
    """The program that computes ``results``."""
    nodes = _needed(results)
    instructions, numbers = _emit(nodes, _fusions(nodes, results))
    return Program(tuple(instructions), tuple(numbers[r.index] for r in results), inputs, outputs)


def _needed(results: Sequence[Expr]) -> list[Expr]:
    """Everything the results need, in the order it was made; sines, cosines and what they need come first."""
    early = reached([node for node in reached(results) if node.op in ("sin", "cos")])
    first = {node.index for node in early}
    return sorted(reached(results), key=lambda node: (node.index not in first, node.index))


def operands_of(node: Expr) -> tuple[Expr, ...]:
    """None, one or two."""
    return () if node.a is None else (node.a,) if node.b is None else (node.a, node.b)


def reached(results: Sequence[Expr], operands: Callable[[Expr], Sequence[Expr]] = operands_of) -> list[Expr]:
    """All expressions the results are made of; iterative, for programs may be deep."""
    seen: dict[int, Expr] = {}
    stack = list(results)
    while stack:
        node = stack.pop()
        if node.index not in seen:
            seen[node.index] = node
            stack.extend(operands(node))
    return list(seen.values())


_FUSED_BY_SIGNS = {signs: op for op, signs in FUSED.items()}


def _fusions(nodes: Sequence[Expr], results: Sequence[Expr]) -> dict[int, tuple[str, Expr, Expr]]:
    """Sums that take in a product nobody else uses: index of the sum → (fused operation, product, other operand)."""
    uses: dict[int, int] = {}
    for node in nodes:
        for x in operands_of(node):
            uses[x.index] = uses.get(x.index, 0) + 1
    for r in results:
        uses[r.index] = uses.get(r.index, 0) + 1
    fused: dict[int, tuple[str, Expr, Expr]] = {}
    for node in nodes:
        if node.op not in ("add", "sub") or node.a is None or node.b is None:
            continue
        sign = 1 if node.op == "add" else -1
        if node.b.op == "mul" and uses[node.b.index] == 1:
            fused[node.index] = _FUSED_BY_SIGNS[sign, 1], node.b, node.a
        elif node.a.op == "mul" and uses[node.a.index] == 1:
            fused[node.index] = _FUSED_BY_SIGNS[1, sign], node.a, node.b
    return fused


def _emit(nodes: Sequence[Expr], fused: dict[int, tuple[str, Expr, Expr]]) -> tuple[list[Instruction], dict[int, int]]:
    swallowed = {product.index for _, product, _ in fused.values()}
    instructions: list[Instruction] = []
    numbers: dict[int, int] = {}
    for node in nodes:
        if node.index in swallowed:
            continue
        if node.index in fused:
            op, product, other = fused[node.index]
            operands: tuple[Expr | None, ...] = (product.a, product.b, other)
        else:
            op, operands = node.op, (node.a, node.b)
        args = tuple(numbers[x.index] for x in operands if x is not None)
        numbers[node.index] = len(instructions)
        instructions.append(Instruction(op, args, node.value))
    return instructions, numbers
