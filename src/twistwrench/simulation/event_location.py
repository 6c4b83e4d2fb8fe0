"""Functions of a = ad(η) applied to one vector, by their power series in a: all that a step needs of a joint's group.

The eigenvalues of a are 0 and ±i times the angle turned. The first two series converge for less than a full turn, fast for
steps that are worth taking: at 1 rad the first term left out is below 1e-19.
"""

from __future__ import annotations

from fractions import Fraction
from math import comb, factorial

import numpy as np

from ..typing import Array

LARGEST_TURN = 2.0
"""rad a step; the first term left out is then below 1e-12."""
_TERMS = 13
_POWERS = 20


def _ratios() -> list[float]:
    """B_2n / (2n)! for n = 1, 2, …, of Bernoulli's numbers."""
    B = [Fraction(1)]
    for m in range(1, 2 * _TERMS + 1):
        B.append(-sum((comb(m + 1, j) * B[j] for j in range(m)), Fraction(0)) / (m + 1))
    return [float(B[2 * n] / factorial(2 * n)) for n in range(1, _TERMS + 1)]


_RATIOS = _ratios()
_TANH = [0.5 * 4.0**n * (4.0**n - 1.0) * r * 0.25 ** (2 * n - 1) for n, r in enumerate(_RATIOS, start=1)]
"""½ tanh(a/4) = Σ _TANH a^(2n-1)."""


def adjoint(V: Array, constants: Array) -> Array:
    """ad(V) (n, n) of velocities (n,) in the directions of a group, from its structure constants (n, n²)."""
    return np.asarray(V @ constants).reshape(len(V), len(V))


def bernoulli(a: Array, x: Array) -> Array:
    """a / (e^a - 1) x = x - a x / 2 + Σ B_2n / (2n)! a^2n x."""
    y = _even(a, x, _RATIOS)
    ax = a.dot(x)
    return np.asarray(x - 0.5 * ax + a.dot(a.dot(y)))


def half_step(a: Array, x: Array) -> Array:
    """1 / (1 + e^(a/2)) x = ½ x - ½ tanh(a/4) x."""
    return np.asarray(0.5 * x - a.dot(_even(a, x, _TANH)))


def exponential(a: Array, x: Array) -> Array:
    """e^a x."""
    y = x
    for k in range(_POWERS, 0, -1):
        y = x + a.dot(y) / k
    return y


def _even(a: Array, x: Array, coefficients: list[float]) -> Array:
    """Σ c_n a^(2n) x over n = 0, 1, … of an even function."""
    square, y = a.dot(a), coefficients[-1] * x
    for c in coefficients[-2::-1]:
        y = c * x + square.dot(y)
    return y
