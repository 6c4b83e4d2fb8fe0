"""Nonzero entries of rows of equations: a kernel returns the entries of bodies, and drives have columns of their own."""

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
    slices = list[slice]()
    begin = 0
    for length in lengths:
        slices.append(slice(begin, begin + length))
        begin += length
    return slices


@dataclass(frozen=True, eq=False)
class BaseColumns:
    """Nonzero entries of rows of equations, with their positions: 214 of 483 entries for seven joints with 69 groups.

    One kernel returns the entries of the bodies, with constants folded. Entries of drives are computed separately.
    """

    base: BaseParameters
    groups: tuple[Array, ...]  # for each joint, indices of the groups with nonzero columns
    slices: tuple[slice, ...]  # for each joint, its entries in a row

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
        """Entries (n, count) at given states, joint by joint."""
        unknown, kept = self.base.unknown, self.base.kept
        entries = np.empty((len(q), self.count))
        is_of_body = [unknown.of_bodies[kept[groups]] >= 0 for groups in self.groups]  # a mask for each joint
        body_entries = np.flatnonzero(np.concatenate(is_of_body))
        if body_entries.size:
            entries[:, body_entries] = self._kernel(q, dq, ddq)
        factors = unknown.drives(kept[self.base.drives], dq, ddq, friction_speed)
        for group, factor in zip(self.base.drives.tolist(), factors.T, strict=True):
            for joint in np.flatnonzero(self.base.felt[:, group]).tolist():
                index_at_joint = int(np.searchsorted(self.groups[joint], group))
                entry = self.slices[joint].start + index_at_joint
                entries[:, entry] = factor * unknown.shares[kept[group], joint]
        return entries

    @property
    def _kernel(self) -> Any:
        """Kernel of the entries of the bodies, as a function of the states."""
        unknown = self.base.unknown
        column_of_group = unknown.of_bodies[self.base.kept]
        pairs: list[tuple[int, int]] = []  # joint, and column of the regressor
        for joint, groups in enumerate(self.groups):
            columns_of_joint = column_of_group[groups]
            body_columns = columns_of_joint[columns_of_joint >= 0]  # without groups of drives, which have -1
            pairs += [(joint, column) for column in body_columns.tolist()]
        rows, columns = np.array(pairs, int).reshape(-1, 2).T

        def build() -> Any:
            model = unknown.model

            def entries(q: Any, dq: Any, ddq: Any) -> Any:
                return regressor(model, q, dq, ddq)[rows, columns]

            inputs = [("q", (model.nq,)), ("dq", (model.nv,)), ("ddq", (model.nv,))]
            program = trace(entries, inputs, ["entries"])
            return compile_form(program, "base_columns", f"Columns of the groups of {model.name}.")

        return unknown.robot.engine.cache(("base columns", tuple(pairs)), build)
