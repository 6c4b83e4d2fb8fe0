"""Fisher information of a motion about base parameters.

With rows W_j of joint j (the columns that :func:`identify` fits), standard deviations σ_j of the torques, and n of m
rows that are independent,

    A = (n / m) Σ_j W_j' W_j / σ_j² + D⁻²,      deviations = sqrt(diag A⁻¹),      d log det A = Σ_j tr(G_j' dW_j),
    G_j = 2 (n / m) W_j A⁻¹ / σ_j²

D has the standard deviations of the weak prior: the largest plausible sizes of the groups, which bound the deviations of
undetermined groups. With v_i = log((A⁻¹)_ii / D_i²), r groups and Λ = r / 2, a search maximises one of two merits. The first
is

    log det A - Λ / 2 m,     m = κ log Σ_i exp(v_i / κ),

with m the smoothed maximum of v_i; for κ → 0 it becomes log det A - Λ log max_i (deviation_i / D_i). The second is

    -r m,     Σ_i S((v_i - m) / κ) = r / 2,     S the logistic function,

with m the smoothed median of v_i for D_i = 1. Both have dm = Σ_i w_i dv_i with Σ_i w_i = 1, w_i ~ exp(v_i / κ) or w_i ~ S',
and dv_i = -(A⁻¹ dA A⁻¹)_ii / (A⁻¹)_ii. Units change log det A only by a constant, but they change the condition number.

Source: Swevers et al., 1997, for log det A and the condition number. The term with m was introduced by this library.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from ...core.typing import Array
from ..parameters import BaseParameters

ROWS_PER_SECOND = 25.0
"""Number of independent rows per second: 2.5 per period of a cut-off of 10 Hz, as in :func:`identify`."""
_WEIGHT_OF_MAXIMUM = 0.25
"""Weight of m for each group: Λ / (2 r)."""
_MEDIAN_WIDTH = 0.7
"""κ of the smoothed median: a factor of 2 between variances."""
_MAXIMUM_WIDTH = 0.3
"""κ of the smoothed maximum."""
Criterion = Literal["log_det", "deviations"]
"""Merit that a search maximises: the first or the second."""
CRITERIA = get_args(Criterion)


@dataclass(frozen=True, eq=False)
class MotionInformation:
    """Information of motions of one robot with a fixed duration."""

    base: BaseParameters
    noise: Array
    """Standard deviation (nv,) of each torque [N m, sliding joints: N]."""
    friction_speed: Array
    """Speeds (nv,) over which the sign of Coulomb friction is smoothed [rad/s, m/s]."""
    duration: float
    """Duration of each motion [s]."""
    prior: Array
    """D (r,): the largest plausible sizes of the groups."""
    criterion: Criterion = "log_det"

    def rows(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Rows W (n, nv, r) of the torques, with a column for each base parameter."""
        return self.base.unknown.columns(self.base.kept, q, dq, ddq, self.friction_speed)

    def _inverse(self, W: Array) -> tuple[float, Array]:
        """log det A and A⁻¹, by a Cholesky factorisation with columns scaled to length 1."""
        import scipy.linalg

        weighted_rows = (W / self.noise[:, None]).reshape(-1, W.shape[-1])
        information_of_motion = weighted_rows.T @ weighted_rows * self._independent_share(W)
        A = information_of_motion + np.diag(self.prior**-2.0)
        length = np.sqrt(A.diagonal())
        scaled_A = A / length[:, None] / length
        factor = scipy.linalg.cho_factor(scaled_A, lower=True, check_finite=False)
        L, _ = factor  # L and a flag of SciPy
        log_det = 2.0 * float(np.log(L.diagonal()).sum() + np.log(length).sum())
        scaled_inverse = scipy.linalg.cho_solve(factor, np.eye(len(A)), check_finite=False)
        return log_det, scaled_inverse / length[:, None] / length

    def _independent_share(self, W: Array) -> float:
        """Share n / m of independent rows."""
        return ROWS_PER_SECOND * self.duration / len(W)

    def log_det(self, W: Array) -> float:
        """log det A for rows (n, nv, r) at evenly spaced times of the motion."""
        log_det, _ = self._inverse(W)
        return log_det

    def merit_and_slope(self, W: Array) -> tuple[float, Array]:
        """Merit for rows W (n, nv, r), and its derivative G (n, nv, r) by each entry of W."""
        log_det, inverse = self._inverse(W)
        variances = inverse.diagonal()
        # The merit is first_term - scale m, and its derivative tr(by_A dA).
        group_count = len(inverse)
        if self.criterion == "deviations":
            m, weights = _smooth_median(np.log(variances))
            scale = float(group_count)
            first_term = 0.0
            by_A = np.zeros_like(inverse)
        else:
            m, weights = _smooth_maximum(np.log(variances / self.prior**2))
            scale = _WEIGHT_OF_MAXIMUM * group_count
            first_term = log_det
            by_A = inverse
        by_A = by_A + scale * (inverse * (weights / variances)) @ inverse
        slope = 2.0 * self._independent_share(W) * (W @ by_A) / self.noise[:, None] ** 2  # G of the module's docstring
        return first_term - scale * m, slope

    @cached_property
    def _pullback(self) -> Callable[..., tuple[Array, Array, Array]]:
        """Function of states and weights: derivatives by the states of the weighted sum of regressor entries."""
        return self.base.unknown.robot.kernel("regressor", by=("q", "dq", "ddq"), form="weighted")

    def slopes(self, states: Array, row_weights: Array) -> Array:
        """Derivatives (3, n, nv) of Σ G W by the states of each instant, with the weights G (n, nv, r).

        States are q, dq and ddq. A parameter of a drive enters only the torque of one joint, as there are no coupled motors.
        """
        unknown = self.base.unknown
        body_columns = unknown.of_bodies[self.base.kept]  # of the regressor; -1 for parameters of drives
        is_body = body_columns >= 0
        regressor_weights = np.zeros((*row_weights.shape[:2], len(unknown.robot.parameters)))
        regressor_weights[:, :, body_columns[is_body]] = row_weights[:, :, is_body]
        slopes = np.stack(self._pullback(*states, regressor_weights))
        by_dq, by_ddq = slopes[1], slopes[2]
        dq = states[1]
        smooth_sign = np.tanh(dq / self.friction_speed)
        fading = np.exp(-((dq / unknown.stribeck_speed) ** 2))
        one = np.ones_like(dq)
        coulomb_slope = (1.0 - smooth_sign**2) / self.friction_speed
        stribeck_slope = fading * (coulomb_slope - 2.0 * dq / unknown.stribeck_speed**2 * smooth_sign)
        column_slopes = {  # array of derivatives to which a kind of column adds, and its slope
            "motor_inertia": (by_ddq, one),
            "viscous": (by_dq, one),
            "coulomb": (by_dq, coulomb_slope),
            "stribeck": (by_dq, stribeck_slope),
        }
        kinds = np.array(unknown.kinds)[self.base.kept]
        joint_of_column = self.base.felt.argmax(axis=0)  # the first joint whose torque the column enters
        for kind, (by_rate, slope) in column_slopes.items():
            columns = np.flatnonzero(kinds == kind)
            joints = joint_of_column[columns]
            by_rate[:, joints] += row_weights[:, joints, columns] * slope[:, joints]
        return slopes

    def deviations(self, W: Array) -> Array:
        """Expected standard deviations (r,) of the base parameters, from rows W (n, nv, r)."""
        _, inverse = self._inverse(W)
        return np.sqrt(inverse.diagonal())

    def condition(self, W: Array) -> float:
        """Condition number of the rows W (n, nv, r), in SI units."""
        singular_values = np.linalg.svd(W.reshape(-1, W.shape[-1]), compute_uv=False)
        largest, smallest = singular_values[0], singular_values[-1]
        return float(largest / max(smallest, 1e-300))  # no division by zero


def _smooth_maximum(values: Array) -> tuple[float, Array]:
    """Smoothed maximum m, and its derivative by each value."""
    powers = np.exp((values - values.max()) / _MAXIMUM_WIDTH)  # relative to the largest, against overflow
    m = float(values.max() + _MAXIMUM_WIDTH * np.log(powers.sum()))
    return m, powers / powers.sum()


def _smooth_median(values: Array) -> tuple[float, Array]:
    """Smoothed median m, and its derivative by each value."""
    from scipy.optimize import brentq
    from scipy.special import expit

    def is_above(m: float) -> Array:
        """Smoothed indicators S((v - m) / κ) of values above m."""
        return np.asarray(expit((values - m) / _MEDIAN_WIDTH))

    def excess_count(m: float) -> float:
        """Number of values above m, less half of all."""
        return is_above(m).sum() - 0.5 * len(values)

    m = float(brentq(excess_count, values.min() - 1.0, values.max() + 1.0))
    share_above = is_above(m)
    by_values = share_above * (1.0 - share_above)  # S' times κ
    return m, by_values / by_values.sum()
