"""Curves out of columns of q: angles that a log wraps are unwrapped, quaternions keep the sign of their predecessors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .coordinates import Coordinates

_FULL = 0.75
"""Of a turn: the least step of a bounded joint that is taken for a turn left out."""
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
    left_out: Array
    """(nq,) bool: angles of bounded joints within one turn. There a step of nearly a full turn, and no other, is a turn that
    the log left out."""

    @classmethod
    def of(cls, coordinates: Coordinates, parts: Sequence[Array], turn: float | Array = math.tau) -> Continuity:
        """Judge by excerpts of q (n, nq), with angles in units of which ``turn``, () or (nq,), make a full turn."""
        least = np.min([x.min(axis=0, initial=math.inf) for x in parts], axis=0)
        most = np.max([x.max(axis=0, initial=-math.inf) for x in parts], axis=0)
        half, spill = 0.5 * np.asarray(turn), _SPILL * 0.5 * np.asarray(turn)
        about_zero = (least >= -half - spill) & (most <= half + spill)
        from_zero = (least >= -spill) & (most <= turn + spill)
        within = about_zero | from_zero
        bounded = coordinates.angular & ~coordinates.endless
        return cls(coordinates.endless & within, coordinates.quaternions, bounded & within)

    def curves(self, q: Array, turn: float | Array = math.tau) -> Array:
        """Consecutive rows of q (n, nq) without those jumps; each column begins where it did."""
        found, turns = q.copy(), np.broadcast_to(np.asarray(turn, float), q.shape[1:])
        for k in np.flatnonzero(self.wrapped):
            found[:, k] = np.unwrap(q[:, k], period=turns[k])
        for k in np.flatnonzero(self.left_out):
            # np.unwrap leaves steps below ``discont`` as they are.
            found[:, k] = np.unwrap(q[:, k], period=turns[k], discont=_FULL * turns[k])
        for place in self.quaternions:
            p = q[:, place]
            same = np.sum(p[1:] * p[:-1], axis=1) >= 0
            found[:, place] = p * np.cumprod(np.r_[1.0, np.where(same, 1.0, -1.0)])[:, None]
        return found
