"""Runge–Kutta tableaus with orders verified by rooted trees.

Order conditions: the expansion of the exact solution of y' = f(y) has one term for each rooted tree, and so has the
expansion of a step. A step has order p if both expansions agree on all trees with at most p nodes. Source: Butcher,
Numerical Methods for Ordinary Differential Equations, 3rd ed., section 31; Hairer, Nørsett and Wanner, Solving Ordinary
Differential Equations I, section II.2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property
from itertools import product
from math import prod

import numpy as np

from ...core.errors import ValueRangeError
from ...core.typing import Array

Tree = tuple["Tree", ...]
"""Rooted tree: the subtrees of its root, sorted."""
Row = tuple[Fraction, ...]
"""Row of a tableau, or one number for each stage."""


@cache
def trees(nodes: int) -> tuple[Tree, ...]:
    """Rooted trees with a given number of nodes; there are 1, 1, 2, 4, 9, 20, 48 and so on.

    >>> [len(trees(n)) for n in range(1, 7)]
    [1, 1, 2, 4, 9, 20]
    """
    return tuple(sorted(_forests(nodes - 1, nodes - 1)))


def _forests(nodes: int, largest: int) -> set[Tree]:
    """Sorted collections of trees with a given total number of nodes; no tree has more than ``largest`` nodes."""
    if nodes == 0:
        return {()}
    forests: set[Tree] = set()
    for size in range(1, min(nodes, largest) + 1):  # number of nodes of the largest tree
        for largest_tree, other_trees in product(trees(size), _forests(nodes - size, size)):
            forests.add(tuple(sorted((largest_tree, *other_trees))))
    return forests


def order(tree: Tree) -> int:
    """Number of nodes of a tree."""
    return 1 + sum(map(order, tree))


def density(tree: Tree) -> int:
    """Density γ: product over all nodes of the sizes of their subtrees; 1/γ is the exact value of Σ bφ."""
    return order(tree) * prod(map(density, tree))


def elementary_weights(tree: Tree, matrix: Sequence[Row]) -> Row:
    """Elementary weights φ (stages,): the product of Σ_j a_ij φ_j over the subtrees, with φ_j of the subtree."""
    weights = [Fraction(1)] * len(matrix)
    for branch in tree:
        branch_weights = elementary_weights(branch, matrix)
        for i, row in enumerate(matrix):
            weights[i] *= _dot(row, branch_weights)
    return tuple(weights)


# k_i = f(t + c_i h, y + h Σ a_ij k_j),        y(t + h) = y + h Σ b_i k_i
#
# A tableau must satisfy the conditions of all rooted trees up to its order, exactly, and violate one of the next order:
# the stated order is neither too high nor too low.


@dataclass(frozen=True)
class Tableau:
    """Butcher tableau of a Runge–Kutta method, checked to have the stated order.

    Examples
    --------
    >>> Tableau("Heun", 2, a=((0, 0), (1, 0)), b=(Fraction(1, 2), Fraction(1, 2))).c
    (Fraction(0, 1), Fraction(1, 1))
    >>> Tableau("wrong", 2, a=((0,),), b=(1,))
    Traceback (most recent call last):
    twistwrench.core.errors.ValueRangeError: tableau 'wrong' is not of order 2: tree ((),) gives 0, wanted 1/2.
    """

    name: str
    """Name of the method."""
    order: int
    """Order of consistency."""
    a: tuple[Row, ...]
    """Coefficients of the stages (stages, stages)."""
    b: Row
    """Weights of the step (stages,)."""
    embedded: Row = ()
    """Weights (stages,) of an embedded step; its difference from the step estimates the error."""
    embedded_order: int = 0
    """Order of the embedded step."""
    dense: tuple[Row, ...] = ()
    """Weights of dense output (stages, degree): b_i(θ) = Σ_j dense[i][j] θ^(j+1) for 0 ≤ θ ≤ 1."""
    dense_order: int = 0
    """Order of dense output."""

    def __post_init__(self) -> None:
        for name in ("a", "dense"):
            matrix = getattr(self, name)
            exact_matrix = tuple(tuple(map(Fraction, row)) for row in matrix)
            object.__setattr__(self, name, exact_matrix)
        for name in ("b", "embedded"):
            exact_row = tuple(map(Fraction, getattr(self, name)))
            object.__setattr__(self, name, exact_row)
        stage_count = len(self.a)
        is_square = all(len(row) == stage_count for row in self.a)
        if not is_square or len(self.b) != stage_count:
            raise ValueRangeError(f"tableau {self.name!r}: a must be square, with a row for each entry of b.")
        self._require_order(self.b, self.order, "is not")
        if self.embedded:
            self._require_order(self.embedded, self.embedded_order, "has no embedded step")
        if self.dense:
            self._require_dense_order()

    def _require_dense_order(self) -> None:
        """Raise ValueRangeError unless Σ b_i(θ) φ_i = θ^nodes / γ, power by power of θ; θ = 1 is the end of the step."""
        weights_at_end = tuple(sum(row, Fraction(0)) for row in self.dense)
        if weights_at_end != self.b:
            raise ValueRangeError(f"tableau {self.name!r}: the dense output does not end where the step does.")
        for power, weights in enumerate(zip(*self.dense, strict=True), start=1):
            for tree, weighted_sum, exact in self._conditions(weights, self.dense_order):
                expected = exact if order(tree) == power else 0
                if weighted_sum != expected:
                    raise ValueRangeError(
                        f"tableau {self.name!r} has no dense output of order {self.dense_order}: at θ^{power} tree "
                        f"{tree} gives {weighted_sum}."
                    )

    @cached_property
    def c(self) -> Row:
        """Times of the stages (stages,): row sums of a."""
        return tuple(sum(row, Fraction(0)) for row in self.a)

    @property
    def explicit(self) -> bool:
        """True if each stage depends only on earlier ones."""
        return not any(any(row[i:]) for i, row in enumerate(self.a))

    @property
    def first_same_as_last(self) -> bool:
        """True if the last stage of a step is the first of the next."""
        return self.explicit and len(self.b) > 1 and self.a[-1] == self.b

    @property
    def symplectic(self) -> bool:
        """True if b_i a_ij + b_j a_ji = b_i b_j: quadratic invariants and volumes are preserved."""
        return _preserves_products(self.b, self.a, self.b, self.a)

    @cached_property
    def numbers(self) -> tuple[tuple[Array, ...], Array, Array, Array, Array]:
        """Rows of a below the diagonal, b, c, b - embedded (empty without an embedded step) and dense, as float64."""
        rows = tuple(np.array(row[:i], float) for i, row in enumerate(self.a))
        b = np.array(self.b, float)
        c = np.array(self.c, float)
        error = np.zeros(0)
        if self.embedded:
            error = b - np.array(self.embedded, float)
        return rows, b, c, error, np.array(self.dense, float)

    def _require_order(self, weights: Row, order: int, claim: str) -> None:
        """Raise ValueRangeError unless the weights of a step have this order, and not a higher one."""
        for tree, weighted_sum, exact in self._conditions(weights, order):
            if weighted_sum != exact:
                raise ValueRangeError(
                    f"tableau {self.name!r} {claim} of order {order}: tree {tree} gives {weighted_sum}, wanted {exact}."
                )
        conditions_of_next_order = self._conditions(weights, order + 1, first=order + 1)
        if all(weighted_sum == exact for _, weighted_sum, exact in conditions_of_next_order):
            raise ValueRangeError(f"tableau {self.name!r} claims order {order} and has order {order + 1}.")

    def _conditions(self, weights: Row, last: int, first: int = 1) -> Iterator[tuple[Tree, Fraction, Fraction]]:
        """Order conditions of the trees with ``first`` to ``last`` nodes: each tree, Σ b_i φ_i, and its exact value 1/γ."""
        for nodes in range(first, last + 1):
            for tree in trees(nodes):
                weighted_sum = _dot(weights, elementary_weights(tree, self.a))
                yield tree, weighted_sum, Fraction(1, density(tree))


@dataclass(frozen=True)
class Partitioned:
    """Partitioned Runge–Kutta method: separate tableaus for two parts of a state, such as velocities and positions."""

    name: str
    """Name of the method."""
    order: int
    """Order of consistency."""
    velocities: Tableau
    """Tableau of the velocities."""
    positions: Tableau
    """Tableau of the positions."""

    def __post_init__(self) -> None:
        parts = (self.velocities, self.positions)
        # The tree with one node: Σ b_i = 1. Trees with two nodes: Σ b_i c_i = ½, with b and c of either part.
        has_order_1 = all(sum(part.b) == 1 for part in parts)
        has_order_2 = all(_dot(root.b, leaf.c) == Fraction(1, 2) for root, leaf in product(parts, repeat=2))
        actual_order = 0
        if has_order_1:
            actual_order = 2 if has_order_2 else 1
        if actual_order != self.order:
            raise ValueRangeError(
                f"partitioned tableau {self.name!r} claims order {self.order} and has order {actual_order}."
            )

    @property
    def symplectic(self) -> bool:
        """True if b_i â_ij + b̂_j a_ji = b_i b̂_j, with a hat on positions: the symplectic form of H(q, p) is preserved."""
        return _preserves_products(self.velocities.b, self.velocities.a, self.positions.b, self.positions.a)


def _dot(weights: Sequence[Fraction], values: Sequence[Fraction]) -> Fraction:
    """Exact sum of products."""
    return sum((w * x for w, x in zip(weights, values, strict=True)), Fraction(0))


def _preserves_products(b: Row, a: tuple[Row, ...], b_hat: Row, a_hat: tuple[Row, ...]) -> bool:
    """True if b_i â_ij + b̂_j a_ji = b_i b̂_j for all pairs of stages."""
    pairs = product(range(len(b)), repeat=2)
    return all(b[i] * a_hat[i][j] + b_hat[j] * a[j][i] == b[i] * b_hat[j] for i, j in pairs)


def _row(text: str) -> Row:
    """Row of a tableau from its text."""
    return tuple(map(Fraction, text.split()))


def _rows(*texts: str) -> tuple[Row, ...]:
    """Rows of a tableau from their texts."""
    return tuple(map(_row, texts))


EULER = Tableau("Euler", 1, a=_rows("0"), b=_row("1"))
IMPLICIT_EULER = Tableau("implicit Euler", 1, a=_rows("1"), b=_row("1"))
MIDPOINT = Tableau("implicit midpoint", 2, a=_rows("1/2"), b=_row("1"))
SEMI_IMPLICIT_EULER = Partitioned("semi-implicit Euler", 1, velocities=EULER, positions=IMPLICIT_EULER)
RK4 = Tableau(
    "Runge–Kutta 4",
    4,
    a=_rows("0 0 0 0", "1/2 0 0 0", "0 1/2 0 0", "0 0 1 0"),
    b=_row("1/6 1/3 1/3 1/6"),
)
DORMAND_PRINCE = Tableau(
    "Dormand–Prince 5(4)",
    5,
    a=_rows(
        "0 0 0 0 0 0 0",
        "1/5 0 0 0 0 0 0",
        "3/40 9/40 0 0 0 0 0",
        "44/45 -56/15 32/9 0 0 0 0",
        "19372/6561 -25360/2187 64448/6561 -212/729 0 0 0",
        "9017/3168 -355/33 46732/5247 49/176 -5103/18656 0 0",
        "35/384 0 500/1113 125/192 -2187/6784 11/84 0",
    ),
    b=_row("35/384 0 500/1113 125/192 -2187/6784 11/84 0"),
    embedded=_row("5179/57600 0 7571/16695 393/640 -92097/339200 187/2100 1/40"),
    embedded_order=4,
    dense=_rows(
        "1 -8048581381/2820520608 8663915743/2820520608 -12715105075/11282082432",
        "0 0 0 0",
        "0 131558114200/32700410799 -68118460800/10900136933 87487479700/32700410799",
        "0 -1754552775/470086768 14199869525/1410260304 -10690763975/1880347072",
        "0 127303824393/49829197408 -318862633887/49829197408 701980252875/199316789632",
        "0 -282668133/205662961 2019193451/616988883 -1453857185/822651844",
        "0 40617522/29380423 -110615467/29380423 69997945/29380423",
    ),
    dense_order=4,
)
"""Dormand and Prince, "A family of embedded Runge–Kutta formulae", J. Comp. Appl. Math. 6(1), 1980; dense output by
Shampine, "Some practical Runge–Kutta formulas", Math. Comp. 46, 1986."""
