"""Winding temperature by the Maxon academy's Formulae Handbook: two thermal masses; exact, since linear in each segment."""

from __future__ import annotations

import math

import numpy as np

from ..core.typing import Array
from ..mechanics.model.actuators import Thermal


def transitions(thermal: Thermal, resistance: float, squares: Array, duration: Array, ambient: float) -> Array:
    """Transition matrices (m, 3, 3) of (winding, housing, 1) above ambient through each segment, for mean squared currents.

    C_w dθ_w/dt = R (1 + α (T_w - T_0)) i² - (θ_w - θ_h) / R_wh, C_h dθ_h/dt = (θ_w - θ_h) / R_wh - θ_h / R_ha. A single
    thermal mass is the winding; the housing is then a separate entry that cools alone.
    """
    R, alpha, heat = resistance, thermal.coefficient, np.asarray(squares, float)
    cold = 1 + alpha * (ambient - thermal.reference)
    if thermal.winding_housing:
        R_w, R_h = thermal.winding_housing, thermal.housing_ambient
        C_w, C_h = thermal.winding_time / R_w, thermal.housing_time / R_h
        a, b = (R * alpha * heat - 1 / R_w) / C_w, 1 / (R_w * C_w)
        c, d = 1 / (R_w * C_h), np.full_like(heat, -(1 / R_w + 1 / R_h) / C_h)
    else:
        C_w = thermal.housing_time / thermal.housing_ambient
        a, b, c = (R * alpha * heat - 1 / thermal.housing_ambient) / C_w, 0.0, 0.0
        d = a - 1 / thermal.housing_time
    middle, distance = 0.5 * (a + d), np.sqrt((0.5 * (a - d)) ** 2 + b * c)
    half = 0.5 * (a - d)
    skew = np.stack([np.stack([half, np.full_like(half, b)], -1), np.stack([np.full_like(half, c), -half], -1)], -2)

    def matrix_function(first: Array, second: Array) -> Array:
        """Matrix function from its values at the two eigenvalues."""
        plain = 0.5 * (first + second)[:, None, None] * np.eye(2)
        return np.asarray(plain + (0.5 * (first - second) / distance)[:, None, None] * skew)

    larger, smaller = middle + distance, middle - distance  # eigenvalues
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        steps = [
            np.where(np.abs(x * duration) > 1e-12, np.expm1(x * duration) / x, duration) for x in (larger, smaller)
        ]
        matrices = np.zeros((len(heat), 3, 3))
        matrices[:, :2, :2] = matrix_function(np.exp(larger * duration), np.exp(smaller * duration))
        matrices[:, :2, 2] = matrix_function(*steps)[:, :, 0] * (R * cold * heat / C_w)[:, None]
    matrices[:, 2, 2] = 1.0
    return matrices


def periodic_temperatures(
    thermal: Thermal, resistance: float, squares: Array, duration: Array, ambient: float
) -> Array:
    """Periodic temperatures of winding and housing, (m + 1, 2) [°C], at the segment ends of a repeated cycle.

    They are inf if there is no periodic state (thermal runaway): the hotter winding heats more than its housing
    dissipates.
    """
    from_start = _cumulative(transitions(thermal, resistance, squares, duration, ambient))
    cycle = from_start[-1]
    if not np.isfinite(cycle).all() or np.abs(np.linalg.eigvals(cycle[:2, :2])).max() >= 1:
        return np.full((len(squares) + 1, 2), np.inf)
    state = np.append(np.linalg.solve(np.eye(2) - cycle[:2, :2], cycle[:2, 2]), 1.0)
    return np.asarray(np.vstack([state, from_start @ state]))[:, :2] + ambient


def _cumulative(each: Array) -> Array:
    """Products each[k] ··· each[0] of matrices (m, 3, 3), from those of pairs: as many steps as m has binary digits."""
    if len(each) == 1:
        return each
    even = len(each) // 2 * 2
    with np.errstate(over="ignore", invalid="ignore"):
        pairs = _cumulative(each[1:even:2] @ each[:even:2])
        products = np.empty_like(each)
        products[0], products[1:even:2] = each[0], pairs
        products[2::2] = each[2::2] @ pairs[: len(each[2::2])]
    return products


def runaway_current(thermal: Thermal, resistance: float) -> float:
    """Constant current [A] above which the winding temperature grows without bound."""
    inverse_square = resistance * thermal.coefficient * (thermal.winding_housing + thermal.housing_ambient)
    return 1 / math.sqrt(inverse_square) if inverse_square > 0 else math.inf


def allowed_current(thermal: Thermal, resistance: float, ambient: float) -> float:
    """Constant current [A] at which the winding reaches its maximum temperature."""
    hot = resistance * (1 + thermal.coefficient * (thermal.maximum - thermal.reference))
    warmer = thermal.maximum - ambient
    if not warmer > 0 or hot == 0:
        return 0.0 if warmer <= 0 else math.inf
    if math.isinf(warmer):
        return runaway_current(thermal, resistance)
    return math.sqrt(warmer / ((thermal.winding_housing + thermal.housing_ambient) * hot))
