"""Error of an integration method in the impulse of a force that it evaluates only at its own times.

Over a step of length h a method integrates a force f as h Σ b_i f(t + c_i h) with its own c and b; a pulse between
these times is lost. Gauss's rule at further times measures the loss. For a smooth f both differ by no more than the order
of the method allows.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from ..typing import Array

_NODES, _WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(8))
_NODES = _NODES + 0.5
"""Eight points of Gauss's rule, at most 0.19 of its length apart."""
_SPACINGS = 5.0
"""Length of one rule, in spacings: its points are then less than one apart."""
_SHARE = 1e-3
_ROUNDING = 1e-13


def probe_spacing(dt: float, duration: float) -> float:
    """Largest spacing of evaluations [s]: dt, and a thousandth of the duration."""
    return min(dt, _SHARE * duration)


class ProbeRule:
    """The times at which a method evaluates, and further ones: eight at least in a step, less than ``spacing`` [s] apart.

    ``times`` and ``weights`` are c and b of the method.
    """

    def __init__(self, times: Array, weights: Array, spacing: float) -> None:
        self.spacing = spacing
        self.times, self.weights = times[weights != 0.0], weights[weights != 0.0]

    @cached_property
    def _one(self) -> tuple[Array, Array]:
        return self._rules(1)

    def needed(self, h: float) -> bool:
        """True if the method's own evaluations are too far apart."""
        return h > self.spacing / _SPACINGS

    def shares(self, h: float) -> tuple[Array, Array]:
        """Shares (m,) of a step, and the weights (m,) of the forces there that give the lost part of their mean."""
        rules = math.ceil(h / (_SPACINGS * self.spacing))
        return self._one if rules <= 1 else self._rules(rules)

    def _rules(self, n: int) -> tuple[Array, Array]:
        inside = ((np.arange(n)[:, None] + _NODES) / n).ravel()
        return np.concatenate([self.times, inside]), np.concatenate([-self.weights, np.tile(_WEIGHTS / n, n)])


def left_out(weights: Array, found: Array) -> Array:
    """Lost part of the mean of forces ``found`` (..., m, k), (..., k); round-off is zero."""
    off = weights @ found
    return np.where(np.abs(off) > _ROUNDING * np.abs(found).max(axis=-2), off, 0.0)
