"""Back onto the constraints from nearby, on symbols: what a step of an integrator leaves is taken away again.

With M = L'DL, Y = L⁻ᵀA' and S = Y'D⁻¹Y = A M⁻¹ A', the least changes in the kinetic metric are

    (1)  q ← q ⊕ -M⁻¹A'S⁻¹ g(q),  g the gaps of the loops
    (2)  dq ← dq - M⁻¹A'S⁻¹ A dq

(1) is taken twice with the matrices of the first q, Newton's method simplified: gaps of a step are small, and each time shrink
by the square of what was moved. (2) is exact at the q found. Source: Hairer, Lubich and Wanner, Geometric Numerical
Integration, section IV.4, projection methods; in the metric of M the projection is the same in any coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.model import Model
from ..typing import Array
from .constraints import Closure, Constraint, closure_poses, constraint_jacobian, with_gaps
from .integration import add, normalised
from .mass_matrix import mass_matrix
from .recursion import zeros
from .tree_factorisation import factored, lowered, raised, solved

ROUNDS = 2
"""Of (1): a gap of 1e-5 of the robot's size becomes one of 1e-10, and that rounding."""


_OPPOSITE = 1e-30
"""So that a turn by π, whose sine is zero, is no division by zero; beside any other cosine it is nothing."""


@dataclass(frozen=True)
class LoopRows:
    """The rows of closures that have a position and depend on no others, to be brought to zero."""

    constraints: tuple[Constraint, ...]
    independent: tuple[int, ...]
    """Numbers of the rows of A that do not depend on earlier ones."""

    @property
    def places(self) -> tuple[list[int], list[int]]:
        """The numbers of the rows among those of :func:`small_gaps`, and among those of A."""
        with_gap = [k for k, has in enumerate(with_gaps(self.constraints)) if has]
        closing = [n for n, k in enumerate(with_gap) if k in self.independent]
        return closing, [with_gap[n] for n in closing]

    def gaps(self, model: Model, q: Array) -> Array:
        """By how much they are open, rad and m."""
        return small_gaps(model, q, self.constraints)[self.places[0]]

    def jacobian(self, model: Model, q: Array) -> Array:
        """Their rows of A."""
        return constraint_jacobian(model, q, self.constraints)[self.places[1]]


def projected(
    model: Model, q: Array, dq: Array, constraints: Sequence[Constraint], independent: Sequence[int]
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """q and dq on the constraints, the gaps and the rates A dq before, the gaps after, and the pivots of A M⁻¹ A'.

    (nq,), (nv,), (rows of closures,), (independent rows,), (rows of closures,), (independent rows,). ``independent`` are the
    numbers of the rows of A that do not depend on earlier ones.
    """
    closing, rows = LoopRows(tuple(constraints), tuple(independent)).places
    before = after = small_gaps(model, q, constraints)
    if closing:
        (L, D), A = factored(mass_matrix(model, q)), constraint_jacobian(model, q, tuple(constraints))
        Y = lowered(L, A[rows].T)
        R, E = factored(Y.T @ (D[:, None] * Y))
        for _ in range(ROUNDS):
            q = add(model, q, -raised(L, D * (Y @ solved(R, E, after[closing]))))  # (1)
            after = small_gaps(model, q, constraints)
    q = normalised(model, q)
    (L, D), A = factored(mass_matrix(model, q)), constraint_jacobian(model, q, tuple(constraints))[list(independent)]
    Y = lowered(L, A.T)
    R, E = factored(Y.T @ (D[:, None] * Y))
    rates = A @ dq
    return q, dq - raised(L, D * (Y @ solved(R, E, rates))), before, rates, after, 1.0 / E  # (2)


def small_gaps(model: Model, q: Array, constraints: Sequence[Constraint]) -> Array:
    """The gaps of the closures' rows, rad and m, right to the third order; zero where :func:`.loop_closure.closure_gaps` are.

    Twice the sine of half an angle stands for it.
    """
    closures = [c for c in constraints if isinstance(c, Closure)]
    if not closures:
        return zeros(0)
    T = closure_poses(model, q, tuple(closures))
    return np.concatenate([_small_gap(c.rows, T[n, :3, :3], T[n, :3, 3]) for n, c in enumerate(closures)])


def _small_gap(rows: tuple[int, ...], R: Array, p: Array) -> Array:
    turning = [k for k in range(3) if k in rows]
    if not turning:
        return p[[row - 3 for row in rows]]
    turn, cosine = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]), 0.5 * (np.trace(R) - 1.0)
    k = 3 - sum(turning) if len(turning) == 2 else turning[0]
    i, j = (k + 1) % 3, (k + 2) % 3
    if len(turning) == 2:
        turn[i], turn[j], cosine = -R[j, k], R[i, k], R[k, k]  # e_k × R e_k
    elif len(turning) == 1:
        cosine = 0.5 * (R[i, i] + R[j, j])
    turn = turn * np.sqrt(2.0 / (1.0 + cosine + _OPPOSITE))  # sin x = 2 sin(x/2) cos(x/2), and 1 + cos x = 2 cos²(x/2)
    return np.concatenate([turn, p])[list(rows)]
