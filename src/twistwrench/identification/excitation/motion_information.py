"""Fisher information of a motion about base parameters.

With rows W_j of joint j (the columns that :func:`identify` fits), standard deviations σ_j of the torques, and n of m
rows that are independent,

    A = (n / m) Σ_j W_j' W_j / σ_j² + D⁻²,      deviations = sqrt(diag A⁻¹),      d log det A = Σ_j tr(G_j' dW_j),
    G_j = 2 (n / m) W_j A⁻¹ / σ_j²

D has the standard deviations of the weak prior, the largest plausible sizes of the groups; they bound the deviations
of undetermined groups. With v_i = log((A⁻¹)_ii / D_i²), a search maximises the merit,

    log det A - Λ / 2 κ log Σ_i exp(v_i / κ),        for κ → 0:  log det A - Λ log max_i (deviation_i / D_i),   Λ = r / 2,
    or -r m,  Σ_i S((v_i - m) / κ) = r / 2,  S the logistic function,   m the smoothed median of v_i for D_i = 1

Both m, of maximum and of median, have dm = Σ_i w_i dv_i with w_i ~ exp(v_i / κ) or w_i ~ S', Σ_i w_i = 1, and
dv_i = -(A⁻¹ dA A⁻¹)_ii / (A⁻¹)_ii. Units change log det A only by a constant, but they change the condition number.

Source: Swevers et al., 1997, for log det A and the condition number; the second term is this library's own.
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
"""Independent rows per second: 2.5 per period of a cut-off of 10 Hz, as in :func:`identify`."""
_WEIGHT_OF_WORST = 0.25  # Λ / 2 r
_MEDIAN_WIDTH = 0.7  # κ of the smoothed median: a factor of 2 between variances
_MAXIMUM_WIDTH = 0.3  # κ of the smoothed maximum
Criterion = Literal["log_det", "deviations"]
CRITERIA = get_args(Criterion)


@dataclass(frozen=True, eq=False)
class MotionInformation:
    """Information of motions of one robot with a fixed duration."""

    base: BaseParameters
    noise: Array  # (nv,), standard deviation of each torque [N m, sliding joints: N]
    friction_speed: Array  # (nv,) [rad/s, m/s]
    duration: float  # [s]
    prior: Array  # (r,), D: the largest plausible sizes of the groups
    criterion: Criterion = "log_det"  # objective

    def rows(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Columns of the base parameters in the torques."""
        return self.base.unknown.columns(self.base.kept, q, dq, ddq, self.friction_speed)

    def _inverse(self, W: Array) -> tuple[float, Array]:
        """log det A and A⁻¹, by a Cholesky factorisation with columns scaled to length 1."""
        import scipy.linalg

        weighted = (W / self.noise[:, None]).reshape(-1, W.shape[-1])
        A = weighted.T @ weighted * (ROWS_PER_SECOND * self.duration / len(W)) + np.diag(self.prior**-2.0)
        length = np.sqrt(A.diagonal())
        factor = scipy.linalg.cho_factor(A / length[:, None] / length, lower=True, check_finite=False)
        log_det = 2.0 * float(np.log(factor[0].diagonal()).sum() + np.log(length).sum())
        inverse = scipy.linalg.cho_solve(factor, np.eye(len(A)), check_finite=False)
        return log_det, inverse / length[:, None] / length

    def log_det(self, W: Array) -> float:
        """log det A for rows (n, nv, r) at evenly spaced times of the motion."""
        return self._inverse(W)[0]

    def merit_and_slope(self, W: Array) -> tuple[float, Array]:
        """Objective of a search, to be maximised, for rows (n, nv, r), and G (n, nv, r), its derivative by each entry of W."""
        log_det, inverse = self._inverse(W)
        variances = inverse.diagonal()
        if self.criterion == "deviations":
            m, weights = _smooth_median(np.log(variances))
            merit, slope, scale = 0.0, np.zeros_like(inverse), float(len(weights))
        else:
            m, weights = _smooth_maximum(np.log(variances / self.prior**2))
            merit, slope, scale = log_det, inverse, _WEIGHT_OF_WORST * len(inverse)
        slope = slope + scale * (inverse * (weights / variances)) @ inverse
        share = ROWS_PER_SECOND * self.duration / len(W)
        return merit - scale * m, 2.0 * share * (W @ slope) / self.noise[:, None] ** 2

    @cached_property
    def _pullback(self) -> Callable[..., tuple[Array, Array, Array]]:
        """Derivatives of the weighted sum of regressor entries by the states, by reverse mode."""
        return self.base.unknown.robot.kernel("regressor", by=("q", "dq", "ddq"), form="weighted")

    def slopes(self, states: Array, of_rows: Array) -> Array:
        """(3, n, nv) derivatives of the sum of rows, with weights (n, nv, r), by the states, separately for each instant."""
        unknown = self.base.unknown
        body_columns = unknown.of_bodies[self.base.kept]
        weights = np.zeros((*of_rows.shape[:2], len(unknown.robot.parameters)))
        weights[:, :, body_columns[body_columns >= 0]] = of_rows[:, :, body_columns >= 0]
        slopes = np.stack(self._pullback(*states, weights))
        dq, turn = states[1], np.tanh(states[1] / self.friction_speed)
        dry, bell = (1.0 - turn**2) / self.friction_speed, np.exp(-((dq / unknown.stribeck_speed) ** 2))
        stribeck, one = bell * (dry - 2.0 * dq / unknown.stribeck_speed**2 * turn), np.ones_like(dq)
        kinds, joints = np.array(unknown.kinds)[self.base.kept], self.base.felt.argmax(axis=0)
        laws = {"motor_inertia": (2, one), "viscous": (1, one), "coulomb": (1, dry), "stribeck": (1, stribeck)}
        for kind, (m, slope) in laws.items():
            columns = np.flatnonzero(kinds == kind)
            own_joints = joints[columns]
            slopes[m][:, own_joints] += of_rows[:, own_joints, columns] * slope[:, own_joints]
        return slopes

    def deviations(self, W: Array) -> Array:
        """(r,) expected standard deviations of the base parameters, from rows (n, nv, r)."""
        return np.sqrt(self._inverse(W)[1].diagonal())

    def condition(self, W: Array) -> float:
        """Condition number of W, in SI units."""
        s = np.linalg.svd(W.reshape(-1, W.shape[-1]), compute_uv=False)
        return float(s[0] / max(s[-1], 1e-300))


def _smooth_maximum(values: Array) -> tuple[float, Array]:
    """Smoothed maximum m, and its derivative by each value."""
    powers = np.exp((values - values.max()) / _MAXIMUM_WIDTH)
    return float(values.max() + _MAXIMUM_WIDTH * np.log(powers.sum())), powers / powers.sum()


def _smooth_median(values: Array) -> tuple[float, Array]:
    """Smoothed median m, and its derivative by each value."""
    from scipy.optimize import brentq
    from scipy.special import expit

    def above(m: float) -> Array:
        return np.asarray(expit((values - m) / _MEDIAN_WIDTH))

    m = float(brentq(lambda m: above(m).sum() - 0.5 * len(values), values.min() - 1.0, values.max() + 1.0))
    by_values = above(m) * (1.0 - above(m))
    return m, by_values / by_values.sum()
