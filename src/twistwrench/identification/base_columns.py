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

    One kernel returns the entries of the bodies, with constants folded. Entries of drives are computed besides.
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
        """Entries (n, count) at given states, joint by joint."""
        unknown, kept = self.base.unknown, self.base.kept
        entries = np.empty((len(q), self.count))
        is_of_body = [unknown.of_bodies[kept[groups]] >= 0 for groups in self.groups]  # of each joint's entries
        body_entries = np.flatnonzero(np.concatenate(is_of_body))
        if body_entries.size:
            entries[:, body_entries] = self._kernel(q, dq, ddq)
        factors = unknown.drives(kept[self.base.drives], dq, ddq, friction_speed)
        for group, factor in zip(self.base.drives.tolist(), factors.T, strict=True):
            for joint in np.flatnonzero(self.base.felt[:, group]).tolist():
                place = int(np.searchsorted(self.groups[joint], group))  # among the joint's entries
                entries[:, self.slices[joint].start + place] = factor * unknown.shares[kept[group], joint]
        return entries

    @property
    def _kernel(self) -> Any:
        """Kernel of the entries of the bodies, as a function of the states."""
        unknown = self.base.unknown
        column_of_group = unknown.of_bodies[self.base.kept]
        pairs: list[tuple[int, int]] = []  # joint, and column of the regressor
        for joint, groups in enumerate(self.groups):
            columns_of_joint = column_of_group[groups]
            body_columns = columns_of_joint[columns_of_joint >= 0]  # -1 of groups of drives
            pairs += [(joint, column) for column in body_columns.tolist()]
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
