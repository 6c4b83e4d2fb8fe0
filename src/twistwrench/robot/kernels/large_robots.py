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

# Forward-dynamics derivatives solve M x = c for each column c of ∂τ. Unrolled, the solutions are half of all
# instructions; a humanoid's 60,000 instructions exceed processor caches. A loop over the columns avoids this.

COLUMN_LOOP_FROM = 20
"""Number of pairs of velocities of two joints, of which one carries the other, from which a loop is faster.

Source: bench/NOTES.md.
"""

FORWARD_DERIVATIVES = "forward_dynamics_derivatives"


def _is_alone(requested: Mapping[str, Mapping[str, Any]], name: str) -> bool:
    """True if only the quantity ``name`` is requested, with no options but wrenches."""
    return tuple(requested) == (name,) and set(requested[name]) <= {"wrenches"}


def columns_of(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> ColumnSolve | None:
    """Forward-dynamics derivatives as a loop over columns; None for short programs and other quantities."""
    if not _is_alone(requested, FORWARD_DERIVATIVES):
        return None
    carries, bodies = joint_pair_factors.relations(model)
    carries_other_joint = carries & (bodies[:, None] != bodies)
    if int(carries_other_joint.sum()) < COLUMN_LOOP_FROM:
        return None
    quantity = replace(QUANTITIES[FORWARD_DERIVATIVES], algorithm=torque_derivatives_and_factors)
    regrouped_model = regrouped(model)
    options = requested[FORWARD_DERIVATIVES]

    def derivatives_and_factors(*arrays: Array) -> Any:
        return evaluate_quantity(quantity, regrouped_model, list(arrays), options)

    inputs = inputs_of(model, FORWARD_DERIVATIVES, options)
    factors = ["W", "D"]  # results that only the groups use
    program = trace(derivatives_and_factors, inputs, [*quantity.outputs, *factors])
    column_groups = _column_groups(program, model.nv)
    return ColumnSolve(program, len(factors), tuple(column_groups))


_TAU_DERIVATIVES = 2
"""Number of matrices ∂τ, the first results of the program: ∂τ/∂q and ∂τ/∂dq."""


def _column_groups(program: Program, n: int) -> list[ColumnGroup]:
    """Nonzero columns of ∂τ, grouped by the rows in which they are nonzero.

    The program's results are three matrices (n, n), of which the first two are ∂τ, then the factors W (n, n) and D.
    """
    is_zero = np.array(program.zeros[: _TAU_DERIVATIVES * n * n]).reshape(_TAU_DERIVATIVES, n, n)
    is_nonzero = ~is_zero
    columns_by_rows: dict[tuple[bool, ...], list[tuple[int, int]]] = {}
    for matrix, column in np.argwhere(is_nonzero.any(axis=1)).tolist():
        nonzero_rows = tuple(is_nonzero[matrix, :, column].tolist())
        columns_by_rows.setdefault(nonzero_rows, []).append((matrix, column))
    W_results = program.results[3 * n * n : 4 * n * n]
    W_entries = [program.instructions[result] for result in W_results]
    W_varies = np.array([entry.op != "const" for entry in W_entries]).reshape(n, n)
    W_constants = np.array([entry.value for entry in W_entries]).reshape(n, n)

    def solution_program(nonzero_rows: tuple[bool, ...]) -> Program:
        """Program that solves for a column with these nonzero rows."""

        def solve(W: Array, D: Array, x: Array) -> Array:
            sparse_W = np.where(W_varies, W, W_constants)
            sparse_x = np.where(nonzero_rows, x, 0.0)
            return accelerations(sparse_W, D, sparse_x)

        return trace(solve, [("W", (n, n)), ("D", (n,)), ("x", (n,))], ["solution"])

    return [ColumnGroup(solution_program(rows), tuple(columns)) for rows, columns in columns_by_rows.items()]


# Unrolled, the solutions alone take about 2 nv³ operations a state. These are 3.4 million instructions for a chain of 100
# links, beyond the limit of a trace. LAPACK therefore solves for the derivatives of such robots.

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
        inputs, _, _ = str(self._acceleration.signature).partition("->")
        self.signature = f"{inputs}->({n},{n}),({n},{n}),({n},{n})"
        self.nin = self._acceleration.nin
        self.nout = 3

    def __repr__(self) -> str:
        return f"<LapackDerivatives {self.signature}>"

    def __call__(self, *args: ArrayLike, out: tuple[Array, Array, Array] | None = None) -> tuple[Array, ...]:
        """Evaluate on arrays whose last axes match the signature."""
        ddq = self._acceleration(*args)  # validates the arguments, as all kernels do
        q, dq, _, *wrenches = args
        tau_by_q, tau_by_dq = self._torque_derivatives(q, dq, ddq, *wrenches)
        M = self._mass(q).astype(ddq.dtype, copy=False)
        M_inverse = _inverse(M)
        ddq_by_q = -(M_inverse @ tau_by_q)
        ddq_by_dq = -(M_inverse @ tau_by_dq)
        ddq_by_tau = np.broadcast_to(M_inverse, tau_by_q.shape)
        if out is None:
            return ddq_by_q, ddq_by_dq, ddq_by_tau.copy()
        for target, result in zip(out, (ddq_by_q, ddq_by_dq, ddq_by_tau), strict=True):
            target[...] = result
        return out


def _inverse(M: Array) -> Array:
    """M⁻¹, and NaN where M is singular, so that one singular state does not affect the others."""
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
class _PairLoops:
    """Matrices of one quantity whose entries are products of two factors, and their estimated length when unrolled."""

    factors: Callable[..., tuple[Array, ...]]
    """Algorithm that returns the factors."""
    before: tuple[tuple[int, int], ...]
    """For each matrix, indices of the two factors of entries in which the row's joint carries the column's joint."""
    after: tuple[tuple[int, int], ...]
    """For each matrix, indices of the two factors of all other entries."""
    constant_parts: tuple[Callable[[Model], Array] | None, ...]
    """For each matrix, function that returns its constant part; None without one."""
    symmetric: bool
    """True if the matrices are symmetric."""
    instructions_per_velocity: int
    instructions_per_pair: int
    """Instructions for each pair of a velocity and a velocity that it carries."""


_PAIR_LOOPS = {
    "mass_matrix": _PairLoops(
        factors=joint_pair_factors.mass_matrix_factors,
        before=((0, 1),),
        after=((2, 3),),
        constant_parts=(joint_pair_factors.constant_mass,),
        symmetric=True,
        instructions_per_velocity=60,
        instructions_per_pair=27,
    ),
    "inverse_dynamics_derivatives": _PairLoops(
        factors=joint_pair_factors.derivative_factors,
        before=((0, 1), (0, 2)),
        after=((3, 4), (3, 5)),
        constant_parts=(joint_pair_factors.constant_stiffness, None),
        symmetric=False,
        instructions_per_velocity=230,
        instructions_per_pair=106,
    ),
}


def products_of(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> Products | Program | None:
    """Loops for one quantity, or its unrolled program if this is short enough; None for other quantities."""
    name, options = next(iter(requested.items()))
    loops = _PAIR_LOOPS.get(name)
    if loops is None or not _is_alone(requested, name):
        return None
    from ...compiler.lowering.product_loop import MIN_MATRIX_SIZE

    if model.nv < MIN_MATRIX_SIZE or not joint_pair_factors.joints_are_independent(model):
        return None
    carries, bodies = joint_pair_factors.relations(model)
    pair_count = int(carries.sum())
    estimated_length = loops.instructions_per_velocity * model.nv + loops.instructions_per_pair * pair_count
    if estimated_length < PAIR_LOOP_FROM:
        return None
    if estimated_length < MAX_OVERESTIMATE * PAIR_LOOP_FROM:  # the estimate does not decide
        unrolled = program_of_several(model, requested)
        if len(unrolled.instructions) < PAIR_LOOP_FROM:
            return unrolled
    is_carried = carries.T
    if loops.symmetric:  # two velocities of one body are one pair, not two
        is_same_body = bodies[:, None] == bodies
        is_above_diagonal = np.triu(np.ones_like(is_same_body), 1)
        is_carried = is_carried & ~(is_same_body & is_above_diagonal)
    relations = np.where(carries, BEFORE, NEITHER)
    relations = np.where(is_carried, AFTER, relations)
    quantity = replace(QUANTITIES[name], algorithm=loops.factors)
    regrouped_model = regrouped(model)

    def factors(*arrays: Array) -> Any:
        return evaluate_quantity(quantity, regrouped_model, list(arrays), options)

    factor_indices = set(chain(*loops.before, *loops.after))
    factor_names = [f"factor {k}" for k in range(len(factor_indices))]
    program = trace(factors, inputs_of(model, name, options), factor_names)
    matrices = []
    fields_of_matrices = zip(quantity.outputs, loops.before, loops.after, loops.constant_parts, strict=True)
    for output, before, after, constant_part in fields_of_matrices:
        constant_entries: tuple[tuple[int, int, float], ...] = ()
        if constant_part is not None:
            constant = constant_part(regrouped_model)
            rows_and_columns = np.argwhere(constant).tolist()  # of entries that are not zero
            constant_entries = tuple((row, column, float(constant[row, column])) for row, column in rows_and_columns)
        matrices.append(Product(output, before, after, constant_entries))
    return Products(program, tuple(matrices), tuple(map(tuple, relations.tolist())))
