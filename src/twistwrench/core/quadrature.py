"""Estimate of the impulse of a force that an integration method misses between its evaluation times.

Over a step of length h, a method integrates a force f as h Σ b_i f(t + c_i h) with its own c and b. It misses a pulse between
these times. The integral by Gauss's rule, at further times, minus the method's integral estimates the missed impulse. For a
smooth f, both differ only by an error of the method's order.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from .typing import Array

_LEGENDRE_NODES, _LEGENDRE_WEIGHTS = np.polynomial.legendre.leggauss(8)  # on [-1, 1]
_NODES = 0.5 * _LEGENDRE_NODES + 0.5
"""Eight nodes of Gauss's rule on [0, 1], at most 0.19 apart."""
_WEIGHTS = 0.5 * _LEGENDRE_WEIGHTS
"""Weights of the nodes; their sum is 1."""
_RULE_LENGTH = 5.0
"""Length of one Gauss rule, in spacings: its nodes are then less than one spacing apart."""
_MAX_SHARE_OF_DURATION = 1e-3
"""Largest spacing of evaluations, as a share of the duration of a motion."""
_ROUNDING = 1e-13
"""Rounding error of a mean force, relative to the largest force."""


def probe_spacing(dt: float, duration: float) -> float:
    """Largest time between evaluations [s]: the smaller of dt and a thousandth of the duration."""
    return min(dt, _MAX_SHARE_OF_DURATION * duration)


class ProbeRule:
    """Rule for the missed part of the mean force in a step: at a method's own times, and at probe times between them.

    There are at least eight probe times in a step, less than ``spacing`` [s] apart. ``times`` and ``weights`` are c and b of
    the method.
    """

    def __init__(self, times: Array, weights: Array, spacing: float) -> None:
        self.spacing = spacing
        is_used = weights != 0.0
        self.times = times[is_used]
        self.weights = weights[is_used]

    @cached_property
    def _single_rule(self) -> tuple[Array, Array]:
        """Result of :meth:`shares` for short steps."""
        return self._rules(1)

    def needed(self, h: float) -> bool:
        """True if a step ``h`` [s] is so long that the method's own evaluation times are too far apart."""
        return h > self.spacing / _RULE_LENGTH

    def shares(self, h: float) -> tuple[Array, Array]:
        """Times (m,) as fractions of a step, and weights (m,) that give the missed part of the mean force."""
        rule_count = math.ceil(h / (_RULE_LENGTH * self.spacing))
        if rule_count <= 1:
            return self._single_rule
        return self._rules(rule_count)

    def _rules(self, n: int) -> tuple[Array, Array]:
        """Times and weights with n Gauss rules, one after the other; the method's weights are subtracted."""
        probe_times = ((np.arange(n)[:, None] + _NODES) / n).ravel()
        probe_weights = np.tile(_WEIGHTS / n, n)
        times = np.concatenate([self.times, probe_times])
        weights = np.concatenate([-self.weights, probe_weights])
        return times, weights


def left_out(weights: Array, forces: Array) -> Array:
    """Missed part (..., k) of the mean of forces (..., m, k) at the times of a rule; rounding errors are set to zero."""
    missed_mean = weights @ forces
    rounding = _ROUNDING * np.abs(forces).max(axis=-2)
    return np.where(np.abs(missed_mean) > rounding, missed_mean, 0.0)
