"""From expressions to a program: choose an order, fuse products into the sums that use them, number what remains.

The order matters more than anything a compiler does afterwards, because a program has thousands of values and a processor
a few dozen registers. Programs with few results are emitted depth first from the results; programs with many as the
algorithm wrote them, which keeps what belongs together in time together in the program.
"""

from __future__ import annotations

from collections.abc import Sequence

from .expr import Expr
from .program import FUSED, Instruction, Port, Program

__all__ = ["build"]

MANY_RESULTS = 24
"""From this many distinct results on, the written order wins (measured on arms and humanoids; see bench/NOTES.md)."""


def build(results: Sequence[Expr], inputs: tuple[Port, ...], outputs: tuple[Port, ...], order: str = "auto") -> Program:
    """The program that computes ``results``; ``order`` is ``"depth"``, ``"written"`` or ``"auto"``."""
    if order == "auto":
        order = "written" if len({r.index for r in results}) >= MANY_RESULTS else "depth"
    nodes = _depth_first(results)
    if order == "written":
        nodes.sort(key=lambda n: (n.op not in ("input", "sin", "cos"), n.index))
    instructions, numbers = _emit(nodes, _fusions(nodes, results))
    return Program(tuple(instructions), tuple(numbers[r.index] for r in results), inputs, outputs)


def _depth_first(results: Sequence[Expr]) -> list[Expr]:
    """Operands before users, each result's own needs last; iterative, for programs may be deep."""
    seen: set[int] = set()
    ordered: list[Expr] = []
    for result in results:
        stack = [(result, False)]
        while stack:
            node, done = stack.pop()
            if done:
                ordered.append(node)
            elif node.index not in seen:
                seen.add(node.index)
                stack.append((node, True))
                stack.extend((x, False) for x in (node.b, node.a) if x is not None)
    return ordered


_FUSED_BY_SIGNS = {signs: op for op, signs in FUSED.items()}


def _fusions(nodes: Sequence[Expr], results: Sequence[Expr]) -> dict[int, tuple[str, Expr, Expr]]:
    """Sums that take in a product nobody else uses: index of the sum → (fused operation, product, other operand)."""
    uses: dict[int, int] = {}
    for node in nodes:
        for x in (node.a, node.b):
            if x is not None:
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


def _emit(
    nodes: Sequence[Expr], fused: dict[int, tuple[str, Expr, Expr]]
) -> tuple[list[Instruction], dict[int, int]]:
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
