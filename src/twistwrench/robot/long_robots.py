"""Matrices of long robots: programs for what belongs to each joint, and loops over the pairs of joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..algorithms import joint_factors
from ..model.base_parameters import regrouped
from ..model.model import Model
from ..program.products import AFTER, BEFORE, NEITHER, Product, Products
from ..program.trace import trace
from ..typing import Array
from .quantities import QUANTITIES
from .quantity_programs import evaluated, inputs_of

FROM = 100_000
"""Instructions, as they are estimated here, of the smallest unrolled program that gives way to loops.

A humanoid's derivatives are a third of the estimate, and run twice as fast unrolled (bench/NOTES.md).
"""


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
        joint_factors.mass_matrix_factors, ((0, 1),), ((2, 3),), (joint_factors.constant_mass,), True, 60, 27
    ),
    "inverse_dynamics_derivatives": _Looped(
        joint_factors.derivative_factors, ((0, 1), (0, 2)), ((3, 4), (3, 5)), (joint_factors.constant_stiffness, None),
        False, 230, 106,
    ),
}  # fmt: skip


def products_of(model: Model, asked: Mapping[str, Mapping[str, Any]]) -> Products | None:
    """The loops for one quantity; None where it is short enough, or no such matrix."""
    (name, options), *others = asked.items()
    looped = _LOOPED.get(name)
    if looped is None or others or not set(options) <= {"wrenches"}:
        return None
    from ..targets.product_loop import LEAST

    if model.nv < LEAST:
        return None
    if not joint_factors.applies(model):
        return None
    carries, bodies = joint_factors.relations(model)
    if looped.for_a_joint * model.nv + looped.for_a_pair * int(carries.sum()) < FROM:
        return None
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
