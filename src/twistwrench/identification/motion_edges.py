"""Multipliers of the edges of a motion's room: what holds a search at the limits, not away from them.

With the distance s of every edge and instant, as a share of its size, and s_0 what is aimed at, a search makes small

    cost + Σ (max(0, λ - ρ (s - s_0))² - λ²) / 2 ρ,      λ ← max(0, λ - ρ (s - s_0)) after each search

Source: Nocedal and Wright, "Numerical Optimization", 2nd ed. 2006, 17.4 (Hestenes, Powell, Rockafellar).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..typing import Array


class Round(NamedTuple):
    """One search with multipliers that stay: its pull ρ, the most steps, and how many times as many instants there are."""

    rho: float
    steps: int
    finer: int = 1


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges of a room at the instants of a search.

    Attributes
    ----------
    multipliers : tuple of (n, k) arrays, λ of each band's edges
    rho : float, ρ
    aim : float, s_0
    finer : int, how many times as many instants there are
    """

    multipliers: tuple[Array, ...]
    rho: float = 1.0
    aim: float = 2e-3
    finer: int = 1

    def pushed(self, shares: Array, multipliers: Array) -> tuple[float, Array]:
        """What one band adds to the cost, and the forces (n, k): less its derivative by the shares (n, k)."""
        forces = np.maximum(0.0, multipliers - self.rho * (shares - self.aim))
        return float((forces**2 - multipliers**2).sum()) / (2.0 * self.rho), forces

    def followed(self, shares: tuple[Array, ...]) -> Edges:
        """With the multipliers that a search which came to these shares tells."""
        told = zip(shares, self.multipliers, strict=True)
        return replace(self, multipliers=tuple(self.pushed(s, m)[1] for s, m in told))

    def at(self, finer: int) -> Edges:
        """The same at instants as many times finer: between two of them in proportion, with the same sum."""
        if finer == self.finer:
            return self
        count = len(self.multipliers[0])
        at = np.arange(finer * (count - 1) + 1) / finer
        spread = tuple(
            np.array([np.interp(at, np.arange(count), one) for one in m.T]).reshape(-1, len(at)).T / finer
            for m in self.multipliers
        )
        return replace(self, multipliers=spread, finer=finer)
