"""∂q̈/∂(q, q̇, τ) of arms and larger robots: M is factored once, and the columns of ∂τ are solved in a loop.

Unrolled, the solutions are half of all instructions, and a humanoid's 60,000 do not stay in a processor's caches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..algorithms.derivatives import accelerations, torque_derivatives_and_factors
from ..algorithms.joint_factors import relations
from ..model.base_parameters import regrouped
from ..model.model import Model
from ..program.column_groups import ColumnGroup, ColumnGroups
from ..program.program import Program
from ..program.trace import trace
from ..typing import Array
from .quantities import QUANTITIES
from .quantity_programs import evaluated, inputs_of

FROM = 20
"""Pairs of a velocity and one of another joint that it carries, from which on a loop is faster (bench/NOTES.md)."""

NAME = "forward_dynamics_derivatives"


def columns_of(model: Model, asked: Mapping[str, Mapping[str, Any]]) -> ColumnGroups | None:
    """The program and its columns; None where it is short enough, or another quantity."""
    plain = all(set(options) <= {"wrenches"} for options in asked.values())
    if not plain or tuple(asked) != (NAME,):
        return None
    carries, bodies = relations(model)
    if int((carries & (bodies[:, None] != bodies)).sum()) < FROM:
        return None
    quantity = replace(QUANTITIES[NAME], algorithm=torque_derivatives_and_factors)
    mine, options = regrouped(model), asked[NAME]

    def parts(*arrays: Array) -> Any:
        return evaluated(quantity, mine, list(arrays), options)

    program = trace(parts, inputs_of(model, NAME, options), [*quantity.outputs, "W", "D"])
    return ColumnGroups(program, 2, tuple(_groups(program, model.nv)))


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
