"""Nonzero entries of rows of equations, from one kernel of the bodies and the columns of drives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compiler.ir.tracer import trace
from ..core.typing import Array
from ..mechanics.algorithms.inverse_dynamics import regressor
from ..robot.engine import compile_form
from .parameters import BaseParameters


def consecutive_slices(lengths: Iterable[int]) -> list[slice]:
    """Slices of given lengths, one after another.

    >>> consecutive_slices([2, 3])
    [slice(0, 2, None), slice(2, 5, None)]
    """
    slices, begin = list[slice](), 0
    for length in lengths:
        slices.append(slice(begin, begin + length))
        begin += length
    return slices


@dataclass(frozen=True, eq=False)
class BaseColumns:
    """Nonzero entries of rows of equations, with their positions: 214 of 483 for seven joints with 69 groups.

    One kernel returns the entries of the bodies, with constants folded; columns of drives are appended.
    """

    base: BaseParameters
    groups: tuple[Array, ...]  # groups with nonzero columns at each joint
    slices: tuple[slice, ...]  # position of each joint's entries in a row

    @classmethod
    def from_parameters(cls, base: BaseParameters) -> BaseColumns:
        """Entries of all groups."""
        groups = tuple(map(np.flatnonzero, base.felt))
        return cls(base, groups, tuple(consecutive_slices(map(len, groups))))

    @property
    def count(self) -> int:
        """Number of entries of a row."""
        return self.slices[-1].stop if self.slices else 0

    def rows(self, q: Array, dq: Array, ddq: Array, friction_speed: Array) -> Array:
        """Entries of the columns at given states."""
        unknown, kept = self.base.unknown, self.base.kept
        entries = np.empty((len(q), self.count))
        of_bodies = [unknown.of_bodies[kept[groups]] >= 0 for groups in self.groups]
        bodies = np.flatnonzero(np.concatenate(of_bodies))
        if bodies.size:
            entries[:, bodies] = self._kernel(q, dq, ddq)
        factors = unknown.drives(kept[self.base.drives], dq, ddq, friction_speed)
        for k, factor in zip(self.base.drives.tolist(), factors.T, strict=True):
            for j in np.flatnonzero(self.base.felt[:, k]).tolist():
                entry = self.slices[j].start + int(np.searchsorted(self.groups[j], k))
                entries[:, entry] = factor * unknown.shares[kept[k], j]
        return entries

    @property
    def _kernel(self) -> Any:
        """Kernel of the entries of the bodies, as a function of the states."""
        unknown = self.base.unknown
        column_of_group = unknown.of_bodies[self.base.kept]
        pairs: list[tuple[int, int]] = []
        for j, groups in enumerate(self.groups):
            columns = column_of_group[groups]
            pairs += [(j, column) for column in columns[columns >= 0].tolist()]
        rows, columns = np.array(pairs, int).reshape(-1, 2).T

        def build() -> Any:
            model = unknown.model

            def entries(q: Any, dq: Any, ddq: Any) -> Any:
                return regressor(model, q, dq, ddq)[rows, columns]

            inputs = [("q", (model.nq,)), ("dq", (model.nv,)), ("ddq", (model.nv,))]
            return compile_form(
                trace(entries, inputs, ["entries"]), "base_columns", f"Columns of the groups of {model.name}."
            )

        return unknown.robot.engine.cache(("base columns", tuple(pairs)), build)
