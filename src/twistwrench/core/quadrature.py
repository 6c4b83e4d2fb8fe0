"""Quadrature error of an integration method in the impulse of a force that it evaluates only at its own times.

Over a step of length h a method integrates a force f as h Σ b_i f(t + c_i h) with its own c and b. It misses a pulse between
these times. Gauss's rule at further times estimates the missed part. For a smooth f, both rules differ only by an error of
the method's order.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from .typing import Array

_NODES, _WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(8))
_NODES = _NODES + 0.5
"""Eight nodes of Gauss's rule, at most 0.19 of its length apart."""
_SPACINGS = 5.0
"""Length of one Gauss rule, in units of the spacing: its nodes are then less than one spacing apart."""
_SHARE = 1e-3
_ROUNDING = 1e-13


def probe_spacing(dt: float, duration: float) -> float:
    """Largest spacing of evaluations [s]: the smaller of dt and a thousandth of the duration."""
    return min(dt, _SHARE * duration)


class ProbeRule:
    """Evaluation times of a method, and probe times: at least eight per step, less than ``spacing`` [s] apart.

    ``times`` and ``weights`` are c and b of the method.
    """

    def __init__(self, times: Array, weights: Array, spacing: float) -> None:
        self.spacing = spacing
        self.times, self.weights = times[weights != 0.0], weights[weights != 0.0]

    @cached_property
    def _one(self) -> tuple[Array, Array]:
        return self._rules(1)

    def needed(self, h: float) -> bool:
        """True if the method's own evaluation times are too far apart."""
        return h > self.spacing / _SPACINGS

    def shares(self, h: float) -> tuple[Array, Array]:
        """Times (m,) as fractions of a step, and weights (m,) that give the missed part of the mean force."""
        rules = math.ceil(h / (_SPACINGS * self.spacing))
        if rules <= 1:
            return self._one
        return self._rules(rules)

    def _rules(self, n: int) -> tuple[Array, Array]:
        inside = ((np.arange(n)[:, None] + _NODES) / n).ravel()
        return np.concatenate([self.times, inside]), np.concatenate([-self.weights, np.tile(_WEIGHTS / n, n)])


def left_out(weights: Array, found: Array) -> Array:
    """Missed part (..., k) of the mean of forces ``found`` (..., m, k); rounding errors are set to zero."""
    off = weights @ found
    return np.where(np.abs(off) > _ROUNDING * np.abs(found).max(axis=-2), off, 0.0)
