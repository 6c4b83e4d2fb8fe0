"""The columns of the groups by one kernel: only entries that a joint feels are traced, next to each other for each joint.

Row j of τ = W x has entries for the groups that joint j feels, and zeros else; of seven joints with 69 groups each 214 of 483
are left. The kernel gives those of the bodies, traced with all else folded away; drives' columns are put beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..algorithms.regressor import regressor
from ..program.trace import trace
from ..robot.model_kernels import compiled
from ..typing import Array
from .parameter_groups import BaseParameters


@dataclass(frozen=True, eq=False)
class BaseColumns:
    """Which entries there are, and where.

    Attributes
    ----------
    base : BaseParameters
    groups : tuple of (r_j,) arrays, the groups that each joint feels
    slices : tuple of slice, where the entries of each joint are in a row
    """

    base: BaseParameters
    groups: tuple[Array, ...]
    slices: tuple[slice, ...]

    @classmethod
    def of(cls, base: BaseParameters) -> BaseColumns:
        """Of all groups.

        Parameters
        ----------
        base : BaseParameters

        Returns
        -------
        columns : BaseColumns

        Examples
        --------
        >>> import twistwrench as tw
        >>> from twistwrench.identification.unknown_parameters import UnknownParameters
        >>> BaseColumns.of(BaseParameters.of(UnknownParameters(tw.robots.planar_2r()))).slices
        (slice(0, 9, None), slice(9, 16, None))
        """
        groups = tuple(np.flatnonzero(felt) for felt in base.felt)
        ends = np.cumsum([0, *(len(g) for g in groups)]).tolist()
        return cls(base, groups, tuple(slice(a, b) for a, b in pairwise(ends)))

    @property
    def count(self) -> int:
        """How many entries a row has."""
        return self.slices[-1].stop if self.slices else 0

    def rows(self, q: Array, dq: Array, ddq: Array, friction_speed: Array) -> Array:
        """Entries of the columns in states.

        Parameters
        ----------
        q, dq, ddq : (n, nv) arrays
        friction_speed : (nv,) array, v_0 [rad/s or m/s]

        Returns
        -------
        entries : (n, count) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> from twistwrench.identification.unknown_parameters import UnknownParameters
        >>> columns = BaseColumns.of(BaseParameters.of(UnknownParameters(tw.robots.planar_2r())))
        >>> columns.rows(*np.zeros((3, 4, 2)), np.ones(2)).shape
        (4, 16)
        """
        unknown, kept = self.base.unknown, self.base.kept
        found = np.empty((len(q), self.count))
        bodies = np.concatenate(
            [
                s.start + np.flatnonzero(unknown.of_bodies[kept[g]] >= 0)
                for g, s in zip(self.groups, self.slices, strict=True)
            ]
        ).astype(int)
        if bodies.size:
            found[:, bodies] = self._kernel(q, dq, ddq)
        for k in np.flatnonzero(unknown.of_bodies[kept] < 0).tolist():
            value, share = unknown.drive(int(kept[k]), dq, ddq, friction_speed)
            for j in np.flatnonzero(self.base.felt[:, k]).tolist():
                found[:, self.slices[j].start + int(np.searchsorted(self.groups[j], k))] = value * share[j]
        return found

    @property
    def _kernel(self) -> Any:
        """Entries of the bodies, by states."""
        unknown, kept = self.base.unknown, self.base.kept
        pairs = [
            (j, int(unknown.of_bodies[kept[k]]))
            for j, g in enumerate(self.groups)
            for k in g
            if unknown.of_bodies[kept[k]] >= 0
        ]
        rows, columns = np.array(pairs, int).reshape(-1, 2).T

        def made() -> Any:
            model = unknown.model

            def entries(q: Any, dq: Any, ddq: Any) -> Any:
                return regressor(model, q, dq, ddq)[rows, columns]

            inputs = [("q", (model.nq,)), ("dq", (model.nv,)), ("ddq", (model.nv,))]
            return compiled(
                trace(entries, inputs, ["entries"]), "base_columns", f"Columns of the groups of {model.name}."
            )

        return unknown.robot.engine.kept(("base columns", tuple(pairs)), made)
