"""Kernels of large robots: forward-dynamics derivatives by column loops or LAPACK, and matrices by loops over joints.

Unrolled, the solutions are half of all instructions, and a humanoid's 60,000 do not stay in a processor's caches.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms import forward_dynamics
from ..algorithms.forward_dynamics import accelerations, relations, torque_derivatives_and_factors
from ..ir.loops import AFTER, BEFORE, NEITHER, ColumnGroup, ColumnSolve, Product, Products
from ..ir.program import Program
from ..ir.tracer import trace
from ..model.model import Model
from ..model.parameters import regrouped
from ..typing import Array
from .programs import evaluated, inputs_of, program_of_several
from .quantities import QUANTITIES

if TYPE_CHECKING:
    from ..model.model import Model
    from .engine import ModelKernels

COLUMN_LOOP_FROM = 20
"""Pairs of a velocity and one of another joint that it carries, from which on a loop is faster (bench/NOTES.md)."""

NAME = "forward_dynamics_derivatives"


def columns_of(model: Model, asked: Mapping[str, Mapping[str, Any]]) -> ColumnSolve | None:
    """The program and its columns; None where it is short enough, or another quantity."""
    plain = all(set(options) <= {"wrenches"} for options in asked.values())
    if not plain or tuple(asked) != (NAME,):
        return None
    carries, bodies = relations(model)
    if int((carries & (bodies[:, None] != bodies)).sum()) < COLUMN_LOOP_FROM:
        return None
    quantity = replace(QUANTITIES[NAME], algorithm=torque_derivatives_and_factors)
    mine, options = regrouped(model), asked[NAME]

    def parts(*arrays: Array) -> Any:
        return evaluated(quantity, mine, list(arrays), options)

    program = trace(parts, inputs_of(model, NAME, options), [*quantity.outputs, "W", "D"])
    return ColumnSolve(program, 2, tuple(_groups(program, model.nv)))


def _groups(program: Program, n: int) -> list[ColumnGroup]:
    """The columns of ∂τ that are not zero, by the rows in which they are not."""
    some = ~np.array(program.zeros[: 2 * n * n]).reshape(2, n, n)
    places: dict[tuple[bool, ...], list[tuple[int, int]]] = {}
    for matrix, column in np.argwhere(some.any(axis=1)).tolist():
        places.setdefault(tuple(some[matrix, :, column].tolist()), []).append((matrix, column))
    factor = [program.instructions[r] for r in program.results[3 * n * n : 4 * n * n]]
    made = np.array([x.op != "const" for x in factor]).reshape(n, n)
    constant = np.array([x.value for x in factor]).reshape(n, n)

    def solution(rows: tuple[bool, ...]) -> Program:
        def solve(W: Array, D: Array, x: Array) -> Array:
            return accelerations(np.where(made, W, constant), D, np.where(rows, x, 0.0))

        return trace(solve, [("W", (n, n)), ("D", (n,)), ("x", (n,))], ["solution"])

    return [ColumnGroup(solution(rows), tuple(mine)) for rows, mine in places.items()]


# ── ∂q̈/∂(q, q̇, τ) by LAPACK: M ∂q̈/∂x = -∂τ/∂x

# Unrolled, the solutions alone take some 2 nv³ operations a state: 3.4 million instructions for a chain of 100 links, more than
# a trace may have. A matrix product of that size is what LAPACK is for.

LAPACK_FROM = 64
"""Velocities of the smallest robot whose derivatives are put together this way; unrolled they would be a million operations."""


def applies(model: Model, wanted: Mapping[str, Mapping[str, Any]]) -> bool:
    """True for derivatives that would be too long unrolled."""
    plain = all(set(options) <= {"wrenches"} for options in wanted.values())
    return plain and tuple(wanted) == ("forward_dynamics_derivatives",) and model.nv >= LAPACK_FROM


class LapackDerivatives:
    """Callable like the kernel of ``forward_dynamics_derivatives``: broadcasting, ``out=``, float32 in and out."""

    def __init__(self, engine: ModelKernels, options: Mapping[str, Any]) -> None:
        self._mass, self._acceleration = (
            engine.kernel(["mass_matrix"], {}),
            engine.kernel(["forward_dynamics"], options),
        )
        self._torque_derivatives = engine.kernel(["inverse_dynamics_derivatives"], options)
        self.__name__, n = "forward_dynamics_derivatives", engine.model.nv
        self.__doc__ = f"forward_dynamics_derivatives of {engine.model.name}, from its mass matrix and ∂τ."
        inputs = str(self._acceleration.signature).split("->")[0]
        self.signature = f"{inputs}->({n},{n}),({n},{n}),({n},{n})"
        self.nin, self.nout = self._acceleration.nin, 3

    def __repr__(self) -> str:
        return f"<LapackDerivatives {self.signature}>"

    def __call__(self, *args: ArrayLike, out: tuple[Array, Array, Array] | None = None) -> tuple[Array, ...]:
        """Evaluate on arrays whose last axes are the signature's."""
        ddq = self._acceleration(*args)  # refuses what does not fit, as all kernels do
        q, dq, _, *wrenches = args
        by_q, by_dq = self._torque_derivatives(q, dq, ddq, *wrenches)
        inverse = _inverse(self._mass(q).astype(ddq.dtype, copy=False))
        found = -(inverse @ by_q), -(inverse @ by_dq), np.broadcast_to(inverse, by_q.shape)
        if out is None:
            return found[0], found[1], found[2].copy()
        for given, made in zip(out, found, strict=True):
            given[...] = made
        return out


def _inverse(M: Array) -> Array:
    """M⁻¹, NaN where there is none: one state without must not cost the others theirs."""
    try:
        return np.linalg.inv(M)
    except np.linalg.LinAlgError:
        found = np.full_like(M, np.nan)
        for where in np.ndindex(M.shape[:-2]):
            if np.linalg.matrix_rank(M[where]) == M.shape[-1]:
                found[where] = np.linalg.inv(M[where])
        return found


# ── Matrices of long robots by loops over pairs of joints

PAIR_LOOP_FROM = 100_000
"""Instructions of the smallest unrolled program that is replaced by loops (bench/NOTES.md)."""

MOST_OVERESTIMATED = 3
"""Estimated instructions exceed those of the unrolled program at most by this factor; they are never much fewer."""


@dataclass(frozen=True)
class _Looped:
    """One quantity: what it is made of, and how long it would be unrolled."""

    factors: Callable[..., tuple[Array, ...]]
    before: tuple[tuple[int, int], ...]
    after: tuple[tuple[int, int], ...]
    """By matrix, the factors of entries whose row's joint carries the column's, and of all others."""
    added: tuple[Callable[[Model], Array] | None, ...]
    """By matrix, what is constant of it."""
    symmetric: bool
    for_a_joint: int
    for_a_pair: int
    """Instructions, for each velocity and for each pair of one that carries the other."""


_LOOPED = {
    "mass_matrix": _Looped(
        forward_dynamics.mass_matrix_factors, ((0, 1),), ((2, 3),), (forward_dynamics.constant_mass,), True, 60, 27
    ),
    "inverse_dynamics_derivatives": _Looped(
        forward_dynamics.derivative_factors, ((0, 1), (0, 2)), ((3, 4), (3, 5)), (forward_dynamics.constant_stiffness, None),
        False, 230, 106,
    ),
}  # fmt: skip


def products_of(model: Model, asked: Mapping[str, Mapping[str, Any]]) -> Products | Program | None:
    """The loops for one quantity; its unrolled program if counting shows that this is short enough; None for all others."""
    (name, options), *others = asked.items()
    looped = _LOOPED.get(name)
    if looped is None or others or not set(options) <= {"wrenches"}:
        return None
    from ..lowering.product_loop import LEAST

    if model.nv < LEAST:
        return None
    if not forward_dynamics.applies(model):
        return None
    carries, bodies = forward_dynamics.relations(model)
    estimated = looped.for_a_joint * model.nv + looped.for_a_pair * int(carries.sum())
    if estimated < PAIR_LOOP_FROM:
        return None
    if estimated < MOST_OVERESTIMATED * PAIR_LOOP_FROM:
        unrolled = program_of_several(model, asked)
        if len(unrolled.instructions) < PAIR_LOOP_FROM:
            return unrolled
    same = bodies[:, None] == bodies
    below = carries.T if not looped.symmetric else carries.T & ~(same & np.triu(np.ones_like(same), 1))
    relations = np.where(below, AFTER, np.where(carries, BEFORE, NEITHER))
    quantity, mine = replace(QUANTITIES[name], algorithm=looped.factors), regrouped(model)

    def factors(*arrays: Array) -> Any:
        return evaluated(quantity, mine, list(arrays), options)

    count = len({k for pair in (*looped.before, *looped.after) for k in pair})
    program = trace(factors, inputs_of(model, name, options), [f"factor {k}" for k in range(count)])
    matrices = []
    for output, before, after, added in zip(quantity.outputs, looped.before, looped.after, looped.added, strict=True):
        constant = np.zeros((model.nv, model.nv)) if added is None else added(mine)
        places = zip(*np.nonzero(constant), strict=True)
        more = tuple((int(r), int(c), float(constant[r, c])) for r, c in places)
        matrices.append(Product(output, before, after, more))
    return Products(program, tuple(matrices), tuple(map(tuple, relations.tolist())))
