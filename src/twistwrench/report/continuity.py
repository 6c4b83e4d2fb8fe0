"""Curves out of columns of q: angles that a log wraps are unwrapped, quaternions keep the sign of their predecessors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .coordinates import Coordinates

Array = NDArray[Any]

__all__ = ["Continuity"]

_SPILL = 0.01
"""Of half a turn: how far beyond it rounding to two decimals, or less, carries a wrapped angle (3.15 for π)."""


@dataclass(frozen=True, eq=False)
class Continuity:
    """Which columns of q jump without the robot jumping; decided once for a file, so that all its windows agree."""

    wrapped: Array
    """(nq,) bool: endless angles that never leave one turn, within ±π or 0 to 2π. Others count turns, and steps of more
    than π are meant."""
    quaternions: tuple[slice, ...]
    """Where the quaternions of floating joints stand: p and -p are one rotation, but not one curve."""

    @classmethod
    def of(cls, coordinates: Coordinates, parts: Sequence[Array], turn: float = math.tau) -> Continuity:
        """Judge by excerpts of q (n, nq), with angles in units of which ``turn`` make a full turn."""
        least = np.min([x.min(axis=0, initial=math.inf) for x in parts], axis=0)
        most = np.max([x.max(axis=0, initial=-math.inf) for x in parts], axis=0)
        half, spill = 0.5 * turn, _SPILL * 0.5 * turn
        about_zero = (least >= -half - spill) & (most <= half + spill)
        from_zero = (least >= -spill) & (most <= turn + spill)
        return cls(coordinates.endless & (about_zero | from_zero), coordinates.quaternions)

    def curves(self, q: Array, turn: float = math.tau) -> Array:
        """Consecutive rows of q (n, nq) without those jumps; each column begins where it did."""
        found = q.copy()
        found[:, self.wrapped] = np.unwrap(q[:, self.wrapped], axis=0, period=turn)
        for place in self.quaternions:
            p = q[:, place]
            same = np.sum(p[1:] * p[:-1], axis=1) >= 0
            found[:, place] = p * np.cumprod(np.r_[1.0, np.where(same, 1.0, -1.0)])[:, None]
        return found
