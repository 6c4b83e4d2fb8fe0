"""What a method leaves out of the impulse of a force that it knows at its own times only.

Over a step of length h a method takes the impulse of a force f for h Σ b_i f(t + c_i h) with its own c and b; a pulse between
these times is not in it. Gauss's rule at further times says by how much. For a smooth f both differ by no more than the order
of the method allows.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from ..typing import Array

_NODES, _WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(8))
_NODES = _NODES + 0.5
"""Eight points of Gauss's rule, which are nowhere further apart than 0.19 of its length."""
_SPACINGS = 5.0
"""The length of one rule, in spacings: its points are then less than one apart."""
_SHARE = 1e-3
_ROUNDING = 1e-13


def probe_spacing(dt: float, duration: float) -> float:
    """How far apart functions are asked at most [s]: by dt, and by a thousandth of the duration."""
    return min(dt, _SHARE * duration)


class ProbeRule:
    """The times at which a method asks, and further ones: eight at least in a step, less than ``spacing`` [s] apart.

    ``times`` and ``weights`` are c and b of the method.
    """

    def __init__(self, times: Array, weights: Array, spacing: float) -> None:
        self.spacing = spacing
        self.times, self.weights = times[weights != 0.0], weights[weights != 0.0]

    @cached_property
    def _one(self) -> tuple[Array, Array]:
        return self._rules(1)

    def needed(self, h: float) -> bool:
        """Whether a step is so long that the method does not ask often enough itself."""
        return h > self.spacing / _SPACINGS

    def shares(self, h: float) -> tuple[Array, Array]:
        """Shares (m,) of a step, and the weights (m,) that give what the method leaves out of the mean of the forces there."""
        rules = math.ceil(h / (_SPACINGS * self.spacing))
        return self._one if rules <= 1 else self._rules(rules)

    def _rules(self, n: int) -> tuple[Array, Array]:
        inside = ((np.arange(n)[:, None] + _NODES) / n).ravel()
        return np.concatenate([self.times, inside]), np.concatenate([-self.weights, np.tile(_WEIGHTS / n, n)])


def left_out(weights: Array, found: Array) -> Array:
    """What is left out of the mean of forces ``found`` (..., m, k), (..., k); rounding is nothing."""
    off = weights @ found
    return np.where(np.abs(off) > _ROUNDING * np.abs(found).max(axis=-2), off, 0.0)
