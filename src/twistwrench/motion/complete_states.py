"""Samples of a motion that are complete: positions, velocities and accelerations, and what is known of how they came about."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..typing import Array


@dataclass(frozen=True, eq=False)
class States:
    """Consecutive samples of a motion with everything inverse dynamics needs; (n,), (n, nq), (n, nv), (n, nv)."""

    time: Array
    """(n,) s."""
    q: Array
    """As differentiated: smoothed if asked, and without the jumps of wrapped angles."""
    dq: Array
    """Velocities (n, nv), rad/s or m/s."""
    ddq: Array
    """Accelerations (n, nv), rad/s² or m/s²."""
    logged: Array
    """(n, nq) q as the file has it, in SI units: what position limits are about."""
    still: Array
    """(n, nv) bool: the velocity is derived and within its own uncertainty, so that its sign means nothing."""
    stray: Array
    """(n, k, 2) how far samples lie from the smoothed curve, in standard deviations and in SI units; 0 but at samples that
    belong to no noise. (n, 0) if nothing was smoothed."""

    def __len__(self) -> int:
        return len(self.time)

    def at(self, rows: Any) -> States:
        """Some of the rows.

        Parameters
        ----------
        rows : slice, mask or indices

        Returns
        -------
        states : States

        Examples
        --------
        >>> States.none(2, 2).at(slice(0)).q.shape
        (0, 2)
        """
        return States(*(getattr(self, f.name)[rows] for f in fields(self)))

    def copy(self) -> States:
        """The same, holding on to no larger arrays.

        Returns
        -------
        states : States

        Examples
        --------
        >>> States.none(2, 2).copy().dq.shape
        (0, 2)
        """
        return States(*(getattr(self, f.name).copy() for f in fields(self)))

    @classmethod
    def none(cls, nq: int, nv: int) -> States:
        """No states at all.

        Parameters
        ----------
        nq : int
        nv : int

        Returns
        -------
        states : States

        Examples
        --------
        >>> len(States.none(2, 2).time)
        0
        """
        q, v = np.zeros((0, nq)), np.zeros((0, nv))
        return cls(np.zeros(0), q, v, v, q, v.astype(bool), np.zeros((0, 0)))
