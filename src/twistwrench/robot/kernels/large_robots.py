"""Kernels of large robots: forward-dynamics derivatives by column loops or LAPACK, and matrices by loops over joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...compiler.ir.loops import AFTER, BEFORE, NEITHER, ColumnGroup, ColumnSolve, Product, Products
from ...compiler.ir.program import Program
from ...compiler.ir.tracer import trace
from ...core.typing import Array
from ...mechanics.algorithms import joint_pair_factors
from ...mechanics.algorithms.dynamics_derivatives import accelerations, torque_derivatives_and_factors
from ...mechanics.model.model import Model
from ...mechanics.model.parameters import regrouped
from ..programs import evaluate_quantity, inputs_of, program_of_several
from ..quantities import QUANTITIES

if TYPE_CHECKING:
    from ..engine import Engine

# Unrolled, the solutions are half of all instructions; a humanoid's 60,000 instructions exceed processor caches.

COLUMN_LOOP_FROM = 20
"""Number of pairs of a velocity and one of a joint it carries, from which a loop is faster (bench/NOTES.md)."""

FORWARD_DERIVATIVES = "forward_dynamics_derivatives"


def _is_alone(requested: Mapping[str, Mapping[str, Any]], name: str) -> bool:
    """True if only this quantity is requested, with no options but wrenches."""
    return tuple(requested) == (name,) and set(requested[name]) <= {"wrenches"}


def columns_of(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> ColumnSolve | None:
    """Program and its columns; None for short programs and other quantities."""
    if not _is_alone(requested, FORWARD_DERIVATIVES):
        return None
    carries, bodies = joint_pair_factors.relations(model)
    if int((carries & (bodies[:, None] != bodies)).sum()) < COLUMN_LOOP_FROM:
        return None
    quantity = replace(QUANTITIES[FORWARD_DERIVATIVES], algorithm=torque_derivatives_and_factors)
    regrouped_model, options = regrouped(model), requested[FORWARD_DERIVATIVES]

    def parts(*arrays: Array) -> Any:
        return evaluate_quantity(quantity, regrouped_model, list(arrays), options)

    program = trace(parts, inputs_of(model, FORWARD_DERIVATIVES, options), [*quantity.outputs, "W", "D"])
    return ColumnSolve(program, 2, tuple(_groups(program, model.nv)))


def _groups(program: Program, n: int) -> list[ColumnGroup]:
    """Nonzero columns of ∂τ, grouped by the rows in which they are nonzero."""
    nonzero = ~np.array(program.zeros[: 2 * n * n]).reshape(2, n, n)
    columns_by_rows: dict[tuple[bool, ...], list[tuple[int, int]]] = {}
    for matrix, column in np.argwhere(nonzero.any(axis=1)).tolist():
        rows = tuple(nonzero[matrix, :, column].tolist())
        columns_by_rows.setdefault(rows, []).append((matrix, column))
    factor = [program.instructions[r] for r in program.results[3 * n * n : 4 * n * n]]
    varies = np.array([x.op != "const" for x in factor]).reshape(n, n)
    constant = np.array([x.value for x in factor]).reshape(n, n)

    def solution(rows: tuple[bool, ...]) -> Program:
        def solve(W: Array, D: Array, x: Array) -> Array:
            return accelerations(np.where(varies, W, constant), D, np.where(rows, x, 0.0))

        return trace(solve, [("W", (n, n)), ("D", (n,)), ("x", (n,))], ["solution"])

    return [ColumnGroup(solution(rows), tuple(columns)) for rows, columns in columns_by_rows.items()]


# Unrolled, the solutions alone take about 2 nv³ operations a state: 3.4 million instructions for a chain of 100 links,
# beyond the limit of a trace.

LAPACK_FROM = 64
"""Number of velocities from which derivatives are computed by LAPACK; unrolled, they would take a million operations."""


def needs_lapack(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> bool:
    """True for derivatives that would be too long unrolled."""
    return _is_alone(requested, FORWARD_DERIVATIVES) and model.nv >= LAPACK_FROM


class LapackDerivatives:
    """Callable like the kernel of ``forward_dynamics_derivatives``: broadcasting, ``out=``, float32 in and out."""

    def __init__(self, engine: Engine, options: Mapping[str, Any]) -> None:
        self._mass = engine.kernel(["mass_matrix"], {})
        self._acceleration = engine.kernel(["forward_dynamics"], options)
        self._torque_derivatives = engine.kernel(["inverse_dynamics_derivatives"], options)
        self.__name__ = FORWARD_DERIVATIVES
        self.__doc__ = f"{FORWARD_DERIVATIVES} of {engine.model.name}, from its mass matrix and ∂τ."
        n = engine.model.nv
        inputs = str(self._acceleration.signature).split("->")[0]
        self.signature = f"{inputs}->({n},{n}),({n},{n}),({n},{n})"
        self.nin, self.nout = self._acceleration.nin, 3

    def __repr__(self) -> str:
        return f"<LapackDerivatives {self.signature}>"

    def __call__(self, *args: ArrayLike, out: tuple[Array, Array, Array] | None = None) -> tuple[Array, ...]:
        """Evaluate on arrays whose last axes match the signature."""
        ddq = self._acceleration(*args)  # validates the arguments, as all kernels do
        q, dq, _, *wrenches = args
        by_q, by_dq = self._torque_derivatives(q, dq, ddq, *wrenches)
        inverse = _inverse(self._mass(q).astype(ddq.dtype, copy=False))
        results = -(inverse @ by_q), -(inverse @ by_dq), np.broadcast_to(inverse, by_q.shape)
        if out is None:
            return results[0], results[1], results[2].copy()
        for target, result in zip(out, results, strict=True):
            target[...] = result
        return out


def _inverse(M: Array) -> Array:
    """M⁻¹, or NaN for singular M: one singular state must not affect the others."""
    try:
        return np.linalg.inv(M)
    except np.linalg.LinAlgError:
        inverses = np.full_like(M, np.nan)
        for state in np.ndindex(M.shape[:-2]):
            if np.linalg.matrix_rank(M[state]) == M.shape[-1]:
                inverses[state] = np.linalg.inv(M[state])
        return inverses


PAIR_LOOP_FROM = 100_000
"""Instruction count of an unrolled program above which loops replace it (bench/NOTES.md)."""

MAX_OVERESTIMATE = 3
"""Largest factor by which the estimate exceeds the instructions of the unrolled program; it is never much too low."""


@dataclass(frozen=True)
class _Looped:
    """One quantity: the products that compose it, and its estimated length when unrolled."""

    factors: Callable[..., tuple[Array, ...]]
    before: tuple[tuple[int, int], ...]
    after: tuple[tuple[int, int], ...]
    """By matrix, the factors of entries whose row's joint carries the column's, and of all other entries."""
    added: tuple[Callable[[Model], Array] | None, ...]
    """By matrix, its constant part."""
    symmetric: bool
    for_a_joint: int
    for_a_pair: int
    """Instructions per velocity, and per pair of one velocity and another that it carries."""


_LOOPED = {
    "mass_matrix": _Looped(
        joint_pair_factors.mass_matrix_factors, ((0, 1),), ((2, 3),), (joint_pair_factors.constant_mass,), True, 60, 27
    ),
    "inverse_dynamics_derivatives": _Looped(
        joint_pair_factors.derivative_factors, ((0, 1), (0, 2)), ((3, 4), (3, 5)),
        (joint_pair_factors.constant_stiffness, None), False, 230, 106,
    ),
}  # fmt: skip


def products_of(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> Products | Program | None:
    """Loops for one quantity; its unrolled program if that is short enough; None for other quantities."""
    (name, options), *_ = requested.items()
    looped = _LOOPED.get(name)
    if looped is None or not _is_alone(requested, name):
        return None
    from ...compiler.lowering.product_loop import MIN_MATRIX_SIZE

    if model.nv < MIN_MATRIX_SIZE or not joint_pair_factors.joints_are_independent(model):
        return None
    carries, bodies = joint_pair_factors.relations(model)
    estimated = looped.for_a_joint * model.nv + looped.for_a_pair * int(carries.sum())
    if estimated < PAIR_LOOP_FROM:
        return None
    if estimated < MAX_OVERESTIMATE * PAIR_LOOP_FROM:
        unrolled = program_of_several(model, requested)
        if len(unrolled.instructions) < PAIR_LOOP_FROM:
            return unrolled
    below = carries.T
    if looped.symmetric:  # of two velocities of one body, each pair once
        same_body = bodies[:, None] == bodies
        below = below & ~(same_body & np.triu(np.ones_like(same_body), 1))
    relations = np.where(below, AFTER, np.where(carries, BEFORE, NEITHER))
    quantity, regrouped_model = replace(QUANTITIES[name], algorithm=looped.factors), regrouped(model)

    def factors(*arrays: Array) -> Any:
        return evaluate_quantity(quantity, regrouped_model, list(arrays), options)

    count = len(set(chain(*looped.before, *looped.after)))
    program = trace(factors, inputs_of(model, name, options), [f"factor {k}" for k in range(count)])
    matrices = []
    for output, before, after, added in zip(quantity.outputs, looped.before, looped.after, looped.added, strict=True):
        constant = np.zeros((model.nv, model.nv)) if added is None else added(regrouped_model)
        entries = tuple((int(r), int(c), float(constant[r, c])) for r, c in np.argwhere(constant))
        matrices.append(Product(output, before, after, entries))
    return Products(program, tuple(matrices), tuple(map(tuple, relations.tolist())))
