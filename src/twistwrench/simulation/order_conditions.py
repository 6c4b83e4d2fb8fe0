"""Rooted trees: every one of them is a condition that the weights of a Runge–Kutta method have to meet.

The expansion of the exact solution of y' = f(y) has one term for each rooted tree, and so has that of a step; they agree to
order p when they agree on all trees of at most p nodes. Source: Butcher, Numerical Methods for Ordinary Differential
Equations, 3rd ed., section 31; Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from math import prod

Tree = tuple["Tree", ...]
"""The subtrees of a root, sorted."""
Row = tuple[Fraction, ...]


@cache
def trees(nodes: int) -> tuple[Tree, ...]:
    """All rooted trees of that many nodes: there are 1, 1, 2, 4, 9, 20, 48 and so on.

    >>> [len(trees(n)) for n in range(1, 7)]
    [1, 1, 2, 4, 9, 20]
    """
    return tuple(sorted(_forests(nodes - 1, nodes - 1)))


def _forests(nodes: int, largest: int) -> set[Tree]:
    """Collections of trees with that many nodes in all, none with more than ``largest``."""
    if nodes == 0:
        return {()}
    return {
        tuple(sorted((first, *rest)))
        for size in range(1, min(nodes, largest) + 1)
        for first in trees(size)
        for rest in _forests(nodes - size, size)
    }


def order(tree: Tree) -> int:
    """The number of nodes."""
    return 1 + sum(map(order, tree))


def density(tree: Tree) -> int:
    """γ: the product, over all nodes, of the size of what hangs on each; the exact solution has 1/γ where a step has Σ bφ."""
    return order(tree) * prod(map(density, tree))


def elementary_weights(tree: Tree, matrix: Sequence[Row]) -> Row:
    """φ of every stage: the product over the subtrees of Σ_j a_ij φ_j; (stages,)."""
    found = [Fraction(1)] * len(matrix)
    for branch in tree:
        below = elementary_weights(branch, matrix)
        along = [sum((a * w for a, w in zip(row, below, strict=True)), Fraction(0)) for row in matrix]
        found = [x * y for x, y in zip(found, along, strict=True)]
    return tuple(found)
