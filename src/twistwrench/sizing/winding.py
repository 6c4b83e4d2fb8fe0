"""Winding temperature by the Maxon academy's Formulae Handbook, with two thermal masses.

The differential equations are linear in each segment of constant mean squared current, so their solution is exact.
"""

from __future__ import annotations

import math

import numpy as np

from ..core.typing import Array
from ..mechanics.model.actuators import Thermal


def transitions(thermal: Thermal, resistance: float, squares: Array, duration: Array, ambient: float) -> Array:
    """Transition matrices (m, 3, 3) of (θ_w, θ_h, 1) through each segment, for mean squared currents (m,) [A²].

    θ = T - T_ambient of winding and housing obeys

        C_w dθ_w/dt = R (1 + α (T_w - T_0)) i² - (θ_w - θ_h) / R_wh,
        C_h dθ_h/dt = (θ_w - θ_h) / R_wh - θ_h / R_ha.

    In the code this is dθ/dt = [a, b; c, d] θ + (R cold i² / C_w, 0) with cold = 1 + α (T_ambient - T_0). A single thermal
    mass is the winding; the housing is then a separate entry that cools alone.
    """
    R = resistance
    alpha = thermal.coefficient
    heat = np.asarray(squares, float)  # i²
    cold = 1 + alpha * (ambient - thermal.reference)
    if thermal.winding_housing:
        R_w = thermal.winding_housing
        R_h = thermal.housing_ambient
        C_w = thermal.winding_time / R_w
        C_h = thermal.housing_time / R_h
        a = (R * alpha * heat - 1 / R_w) / C_w
        b = 1 / (R_w * C_w)
        c = 1 / (R_w * C_h)
        d = np.full_like(heat, -(1 / R_w + 1 / R_h) / C_h)
    else:
        C_w = thermal.housing_time / thermal.housing_ambient
        a = (R * alpha * heat - 1 / thermal.housing_ambient) / C_w
        b = 0.0
        c = 0.0
        d = a - 1 / thermal.housing_time
    # The matrix A = [a, b; c, d] is middle 1 + traceless with traceless² = distance² 1: its eigenvalues are middle ± distance.
    middle = 0.5 * (a + d)
    half_difference = 0.5 * (a - d)
    distance = np.sqrt(half_difference**2 + b * c)
    upper_row = np.stack([half_difference, np.full_like(half_difference, b)], -1)
    lower_row = np.stack([np.full_like(half_difference, c), -half_difference], -1)
    traceless = np.stack([upper_row, lower_row], -2)

    def matrix_function(at_larger: Array, at_smaller: Array) -> Array:
        """Function f(A) from its values at the two eigenvalues."""
        mean = 0.5 * (at_larger + at_smaller)[:, None, None] * np.eye(2)
        slope = 0.5 * (at_larger - at_smaller) / distance
        return np.asarray(mean + slope[:, None, None] * traceless)

    def integral_of_exp(eigenvalue: Array) -> Array:
        """∫ exp(λ t) dt over the duration, which is the duration itself for λ = 0."""
        exponent = eigenvalue * duration
        is_nonzero = np.abs(exponent) > 1e-12  # beyond rounding errors
        return np.where(is_nonzero, np.expm1(exponent) / eigenvalue, duration)

    larger = middle + distance
    smaller = middle - distance
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        matrices = np.zeros((len(heat), 3, 3))
        matrices[:, :2, :2] = matrix_function(np.exp(larger * duration), np.exp(smaller * duration))
        integral = matrix_function(integral_of_exp(larger), integral_of_exp(smaller))
        heating = R * cold * heat / C_w  # of the winding [K/s]
        matrices[:, :2, 2] = integral[:, :, 0] * heating[:, None]
    matrices[:, 2, 2] = 1.0
    return matrices


def periodic_temperatures(
    thermal: Thermal, resistance: float, squares: Array, duration: Array, ambient: float
) -> Array:
    """Periodic temperatures of winding and housing, (m + 1, 2) [°C], at the begin and the segment ends of a repeated cycle.

    They are inf if there is no periodic state (thermal runaway): a hot winding heats more than its housing dissipates.
    """
    from_start = _cumulative(transitions(thermal, resistance, squares, duration, ambient))
    cycle = from_start[-1]
    A = cycle[:2, :2]
    b = cycle[:2, 2]
    if not np.isfinite(cycle).all() or np.abs(np.linalg.eigvals(A)).max() >= 1:
        return np.full((len(squares) + 1, 2), np.inf)
    theta = np.linalg.solve(np.eye(2) - A, b)  # equal before and after the cycle: θ = A θ + b
    state = np.append(theta, 1.0)
    states = np.asarray(np.vstack([state, from_start @ state]))
    return states[:, :2] + ambient


def _cumulative(matrices: Array) -> Array:
    """Products matrices[k] ··· matrices[0] for each k, (m, 3, 3); the number of array operations grows with log2 m.

    Products up to odd k are products of pairs of matrices; products up to even k need one more factor.
    """
    if len(matrices) == 1:
        return matrices
    even_count = len(matrices) // 2 * 2
    with np.errstate(over="ignore", invalid="ignore"):
        pairs = matrices[1:even_count:2] @ matrices[:even_count:2]
        up_to_odd = _cumulative(pairs)
        products = np.empty_like(matrices)
        products[0] = matrices[0]
        products[1:even_count:2] = up_to_odd
        products[2::2] = matrices[2::2] @ up_to_odd[: len(matrices[2::2])]
    return products


def runaway_current(thermal: Thermal, resistance: float) -> float:
    """Constant current [A] above which the winding temperature grows without bound; inf if there is none."""
    inverse_square = resistance * thermal.coefficient * (thermal.winding_housing + thermal.housing_ambient)
    return 1 / math.sqrt(inverse_square) if inverse_square > 0 else math.inf


def allowed_current(thermal: Thermal, resistance: float, ambient: float) -> float:
    """Constant current [A] at which the winding reaches its maximum temperature; inf if it never does."""
    hot_resistance = resistance * (1 + thermal.coefficient * (thermal.maximum - thermal.reference))
    allowed_rise = thermal.maximum - ambient
    if allowed_rise <= 0:
        return 0.0
    if math.isnan(allowed_rise) or hot_resistance == 0:
        return math.inf
    if math.isinf(allowed_rise):
        return runaway_current(thermal, resistance)
    return math.sqrt(allowed_rise / ((thermal.winding_housing + thermal.housing_ambient) * hot_resistance))
