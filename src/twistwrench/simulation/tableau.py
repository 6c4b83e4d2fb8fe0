"""Runge–Kutta methods as data: a table of fractions that proves its own order when it is made.

    k_i = f(t + c_i h, y + h Σ a_ij k_j),        y(t + h) = y + h Σ b_i k_i

A table is refused unless it meets the condition of every rooted tree up to its order, exactly, and misses one of the next
order: it can claim neither too much nor too little.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from ..errors import ValueRangeError
from ..typing import Array
from .order_conditions import Row, Tree, density, elementary_weights, trees


@dataclass(frozen=True)
class Tableau:
    """Butcher tableau of a Runge-Kutta method, checked to have the order claimed.

    Raises
    ------
    ValueRangeError
        a, b, c do not have it; the tree that fails is named.

    Examples
    --------
    >>> Tableau("Heun", 2, a=((0, 0), (1, 0)), b=(Fraction(1, 2), Fraction(1, 2))).c
    (Fraction(0, 1), Fraction(1, 1))
    >>> Tableau("wrong", 2, a=((0,),), b=(1,))
    Traceback (most recent call last):
    twistwrench.errors.ValueRangeError: tableau 'wrong' is not of order 2: tree ((),) gives 0, wanted 1/2.
    """

    name: str
    """Of the method."""
    order: int
    """Order of consistency."""
    a: tuple[Row, ...]
    """(stages, stages)."""
    b: Row
    """(stages,), the weights of the step."""
    embedded: Row = ()
    """(stages,), weights of a second step whose distance from the first is the estimate of its error."""
    embedded_order: int = 0
    """Order of the second step."""
    dense: tuple[Row, ...] = ()
    """(stages, degree): the weights within the step, b_i(θ) = Σ_j dense[i][j] θ^(j+1) for 0 ≤ θ ≤ 1."""
    dense_order: int = 0
    """Order within the step."""

    def __post_init__(self) -> None:
        for part in ("a", "dense"):
            object.__setattr__(self, part, tuple(tuple(map(Fraction, row)) for row in getattr(self, part)))
        for part in ("b", "embedded"):
            object.__setattr__(self, part, tuple(map(Fraction, getattr(self, part))))
        if len(self.b) != len(self.a) or any(len(row) != len(self.a) for row in self.a):
            raise ValueRangeError(f"tableau {self.name!r}: a must be square, with a row for each entry of b.")
        self._require(self.b, self.order, "is not")
        if self.embedded:
            self._require(self.embedded, self.embedded_order, "has no embedded step")
        if self.dense:
            self._require_dense()

    @cached_property
    def c(self) -> Row:
        """(stages,), the times of the stages: the sums of the rows of a."""
        return tuple(sum(row, Fraction(0)) for row in self.a)

    @property
    def explicit(self) -> bool:
        """Whether each stage needs only earlier ones."""
        return not any(x for i, row in enumerate(self.a) for x in row[i:])

    @property
    def first_same_as_last(self) -> bool:
        """Whether the last stage is taken at the end of the step, and so is the first of the next one."""
        return self.explicit and len(self.b) > 1 and self.a[-1] == self.b

    @property
    def symplectic(self) -> bool:
        """Whether b_i a_ij + b_j a_ji = b_i b_j: quadratic invariants are kept, and volumes with them."""
        return _keeps(self.b, self.a, self.b, self.a)

    @cached_property
    def numbers(self) -> tuple[tuple[Array, ...], Array, Array, Array, Array]:
        """The rows of a up to the diagonal, b, c, b - embedded, dense, as float64."""
        rows = tuple(np.array(row[:i], float) for i, row in enumerate(self.a))
        b, c = np.array(self.b, float), np.array(self.c, float)
        error = b - np.array(self.embedded, float) if self.embedded else np.zeros(0)
        return rows, b, c, error, np.array(self.dense, float)

    def _require(self, weights: Row, order: int, claim: str) -> None:
        for tree, found, wanted in self._conditions(weights, order):
            if found != wanted:
                raise ValueRangeError(
                    f"tableau {self.name!r} {claim} of order {order}: tree {tree} gives {found}, wanted {wanted}."
                )
        if all(found == wanted for _, found, wanted in self._conditions(weights, order + 1, order + 1)):
            raise ValueRangeError(f"tableau {self.name!r} claims order {order} and has order {order + 1}.")

    def _conditions(self, weights: Row, last: int, first: int = 1) -> Iterator[tuple[Tree, Fraction, Fraction]]:
        """Tree, Σ b_i φ_i and 1/γ, for the trees of ``first`` to ``last`` nodes."""
        for nodes in range(first, last + 1):
            for tree in trees(nodes):
                yield tree, _dot(weights, elementary_weights(tree, self.a)), Fraction(1, density(tree))

    def _require_dense(self) -> None:
        """Σ b_i(θ) φ_i = θ^nodes / γ, power by power of θ; and at θ = 1 the step itself."""
        if tuple(sum(row, Fraction(0)) for row in self.dense) != self.b:
            raise ValueRangeError(f"tableau {self.name!r}: the dense output does not end where the step does.")
        for power, weights in enumerate(zip(*self.dense, strict=True), start=1):
            for nodes in range(1, self.dense_order + 1):
                for tree in trees(nodes):
                    found = _dot(weights, elementary_weights(tree, self.a))
                    if found != (Fraction(1, density(tree)) if nodes == power else 0):
                        raise ValueRangeError(
                            f"tableau {self.name!r} has no dense output of order {self.dense_order}: at θ^{power} tree "
                            f"{tree} gives {found}."
                        )


@dataclass(frozen=True)
class Partitioned:
    """Partitioned Runge-Kutta method: two tables for two halves of a state, such as velocities and positions.

    Each half steps by its own.

    Raises
    ------
    ValueRangeError
        The two have not the order claimed together, on trees whose nodes have two colours.
    """

    name: str
    """Of the method."""
    order: int
    """Order of consistency."""
    velocities: Tableau
    """Table of the velocities."""
    positions: Tableau
    """Table of the positions."""

    def __post_init__(self) -> None:
        v, p = self.velocities, self.positions
        ends = all(sum(t.b) == 1 for t in (v, p))
        # Trees of two nodes, by the colours of root and leaf: Σ b_i a_ij = ½ with b and a of either half.
        pairs = [_dot(s.b, t.c) == Fraction(1, 2) for s in (v, p) for t in (v, p)]
        found = 0 if not ends else 2 if all(pairs) else 1
        if min(found, 2) != self.order:
            raise ValueRangeError(f"partitioned tableau {self.name!r} claims order {self.order} and has order {found}.")

    @property
    def symplectic(self) -> bool:
        """Whether b_i â_ij + b̂_j a_ji = b_i b̂_j: the map keeps the symplectic form of H(q, p)."""
        return _keeps(self.velocities.b, self.velocities.a, self.positions.b, self.positions.a)


def _dot(weights: Sequence[Fraction], values: Sequence[Fraction]) -> Fraction:
    return sum((w * x for w, x in zip(weights, values, strict=True)), Fraction(0))


def _keeps(b: Row, a: tuple[Row, ...], b_hat: Row, a_hat: tuple[Row, ...]) -> bool:
    stages = range(len(b))
    return all(b[i] * a_hat[i][j] + b_hat[j] * a[j][i] == b[i] * b_hat[j] for i in stages for j in stages)


def _fractions(*rows: str) -> tuple[Row, ...]:
    return tuple(tuple(map(Fraction, row.split())) for row in rows)


EULER = Tableau("Euler", 1, a=_fractions("0"), b=(Fraction(1),))
IMPLICIT_EULER = Tableau("implicit Euler", 1, a=_fractions("1"), b=(Fraction(1),))
MIDPOINT = Tableau("implicit midpoint", 2, a=_fractions("1/2"), b=(Fraction(1),))
SEMI_IMPLICIT_EULER = Partitioned("semi-implicit Euler", 1, velocities=EULER, positions=IMPLICIT_EULER)
RK4 = Tableau(
    "Runge–Kutta 4",
    4,
    a=_fractions("0 0 0 0", "1/2 0 0 0", "0 1/2 0 0", "0 0 1 0"),
    b=_fractions("1/6 1/3 1/3 1/6")[0],
)
DORMAND_PRINCE = Tableau(
    "Dormand–Prince 5(4)",
    5,
    a=_fractions(
        "0 0 0 0 0 0 0",
        "1/5 0 0 0 0 0 0",
        "3/40 9/40 0 0 0 0 0",
        "44/45 -56/15 32/9 0 0 0 0",
        "19372/6561 -25360/2187 64448/6561 -212/729 0 0 0",
        "9017/3168 -355/33 46732/5247 49/176 -5103/18656 0 0",
        "35/384 0 500/1113 125/192 -2187/6784 11/84 0",
    ),
    b=_fractions("35/384 0 500/1113 125/192 -2187/6784 11/84 0")[0],
    embedded=_fractions("5179/57600 0 7571/16695 393/640 -92097/339200 187/2100 1/40")[0],
    embedded_order=4,
    dense=_fractions(
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
"""Dormand and Prince, "A family of embedded Runge–Kutta formulae", J. Comp. Appl. Math. 6(1), 1980; the dense output is that
of Shampine, "Some practical Runge–Kutta formulas", Math. Comp. 46, 1986."""
