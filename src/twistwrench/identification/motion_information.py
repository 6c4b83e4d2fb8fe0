"""What a motion tells of base parameters before it is run: information, its log determinant, and deviations to expect.

With rows W_j of joint j (the columns that :func:`identify` fits), σ_j the deviation of its torque, and n rows of m that are
independent of each other,

    A = (n / m) Σ_j W_j' W_j / σ_j²,      deviations = sqrt(diag A⁻¹),      d log det A = Σ_j tr(G_j' dW_j),
    G_j = 2 (n / m) W_j A⁻¹ / σ_j²

What a search makes large is the merit: log det A, or -r m with m the median of v_i = log (A⁻¹)_ii, smoothed:

    Σ_i S((v_i - m) / κ) = r / 2,     S the logistic function,     dm = Σ_i w_i dv_i,     w_i ~ S',  Σ_i w_i = 1,
    dv_i = -(A⁻¹ dA A⁻¹)_ii / (A⁻¹)_ii

log det A does not depend on units but for a constant, the condition number does (Swevers et al., 1997).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from ..typing import Array
from .parameter_groups import BaseParameters

ROWS_PER_SECOND = 25.0
"""Rows that tell something new: two and a half a period of a cut-off of 10 Hz, as :func:`identify` keeps them."""
_ROUNDING = 1e-13
_STEP = 1e-5
_SMOOTH = 0.7
"""κ of the smoothed median: a factor of 2 between variances."""
Criterion = Literal["log_det", "deviations"]
CRITERIA = get_args(Criterion)


@dataclass(frozen=True, eq=False)
class MotionInformation:
    """Information that motions of one robot and one duration have.

    Attributes
    ----------
    base : BaseParameters
    noise : (nv,) array, deviation of each torque [N m, sliding joints: N]
    friction_speed : (nv,) array [rad/s, m/s]
    duration : float [s]
    criterion : "log_det" or "deviations", what the merit is
    """

    base: BaseParameters
    noise: Array
    friction_speed: Array
    duration: float
    criterion: Criterion = "log_det"

    def rows(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Columns of the torques that belong to base parameters.

        Parameters
        ----------
        q, dq, ddq : (n, nv) arrays

        Returns
        -------
        W : (n, nv, r) array
        """
        return self.base.unknown.columns(self.base.kept, q, dq, ddq, self.friction_speed)

    def _inverse(self, W: Array) -> tuple[float, Array]:
        """log det A and A⁻¹, by Cholesky's factors in units in which the columns have length 1."""
        import scipy.linalg

        weighted = (W / self.noise[:, None]).reshape(-1, W.shape[-1])
        weighted = weighted * np.sqrt(ROWS_PER_SECOND * self.duration / len(W))
        length = np.maximum(np.linalg.norm(weighted, axis=0), 1e-150)
        scaled = weighted / length
        A = scaled.T @ scaled
        A[np.diag_indices_from(A)] += _ROUNDING
        factor = scipy.linalg.cho_factor(A, lower=True, check_finite=False)
        log_det = 2.0 * float(np.log(factor[0].diagonal()).sum() + np.log(length).sum())
        inverse = scipy.linalg.cho_solve(factor, np.eye(len(A)), check_finite=False)
        return log_det, inverse / length[:, None] / length[None, :]

    def log_det(self, W: Array) -> float:
        """log det A of rows (n, nv, r) at times spread evenly over the motion."""
        return self._inverse(W)[0]

    def merit(self, W: Array) -> float:
        """What a search makes large, of rows (n, nv, r)."""
        return self.merit_and_slope(W)[0]

    def merit_and_slope(self, W: Array) -> tuple[float, Array]:
        """The merit, and G (n, nv, r), its derivative by each entry of W."""
        log_det, inverse = self._inverse(W)
        share, merit, weighted = ROWS_PER_SECOND * self.duration / len(W), log_det, inverse
        if self.criterion == "deviations":
            variances = inverse.diagonal()
            median, weights = _smooth_median(np.log(variances))
            merit = -len(weights) * median
            weighted = len(weights) * (inverse * (weights / variances)) @ inverse
        return merit, 2.0 * share * (W @ weighted) / self.noise[:, None] ** 2

    def weighing(self, of_rows: Array, times: int) -> Callable[[Array, Array, Array], Array]:
        """A function of states (times n, nv) that tells (times, n) sums of the bodies' columns with weights (n, nv, r)."""
        unknown, n = self.base.unknown, len(of_rows)
        places = unknown.of_bodies[self.base.kept]
        weights = np.zeros((*of_rows.shape[:2], len(unknown.robot.parameters)))
        weights[:, :, places[places >= 0]] = of_rows[:, :, places >= 0]
        out = np.empty((times * n, *weights.shape[1:]))

        def weigh(q: Array, dq: Array, ddq: Array) -> Array:
            Y = unknown.robot.regressor(q, dq, ddq, out=out)
            return np.asarray(np.einsum("snk,nk->sn", Y.reshape(times, n, -1), weights.reshape(n, -1)))

        return weigh

    def drive_slopes(self, states: Array, of_rows: Array) -> Array:
        """(3, n, nv) derivatives by states of the drives' columns with weights (n, nv, r): each joint's by its own state."""
        unknown, found = self.base.unknown, np.zeros(states.shape)
        mine = unknown.of_bodies[self.base.kept] < 0
        which, weights = self.base.kept[mine], of_rows[:, :, mine]
        q, dq, ddq = states
        for m, (of_dq, of_ddq) in ((1, (_STEP, 0.0)), (2, (0.0, _STEP))):
            ahead, behind = (
                unknown.columns(which, q, dq + sign * of_dq, ddq + sign * of_ddq, self.friction_speed)
                for sign in (1, -1)
            )
            found[m] = ((ahead - behind) * weights).sum(axis=2) / (2.0 * _STEP)
        return found

    def deviations(self, W: Array) -> Array:
        """(r,) deviations of the base parameters to expect, from rows (n, nv, r)."""
        return np.sqrt(self._inverse(W)[1].diagonal())

    def condition(self, W: Array) -> float:
        """Condition number of W, in SI units."""
        s = np.linalg.svd(W.reshape(-1, W.shape[-1]), compute_uv=False)
        return float(s[0] / max(s[-1], 1e-300))


def _smooth_median(values: Array) -> tuple[float, Array]:
    """m, and its derivative by each of the values, by Newton's method from their median."""
    m = float(np.median(values))
    for _ in range(50):
        S = 1.0 / (1.0 + np.exp((m - values) / _SMOOTH))
        by_values = S * (1.0 - S) / _SMOOTH
        step = float((S.sum() - 0.5 * len(values)) / by_values.sum())
        m += float(np.clip(step, -_SMOOTH, _SMOOTH))
        if abs(step) < 1e-12:
            break
    return m, by_values / by_values.sum()
