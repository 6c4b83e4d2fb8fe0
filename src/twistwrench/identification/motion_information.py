"""What a motion tells of base parameters before it is run: information, its log determinant, and deviations to expect.

With rows W_j of joint j (the columns that :func:`identify` fits), σ_j the deviation of its torque, and n rows of m that are
independent of each other,

    A = (n / m) Σ_j W_j' W_j / σ_j²,      deviations = sqrt(diag A⁻¹),      d log det A = Σ_j tr(G_j' dW_j),
    G_j = 2 (n / m) W_j A⁻¹ / σ_j²

log det A does not depend on units but for a constant, the condition number does (Swevers et al., 1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .parameter_groups import BaseParameters

ROWS_PER_SECOND = 25.0
"""Rows that tell something new: two and a half a period of a cut-off of 10 Hz, as :func:`identify` keeps them."""
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class MotionInformation:
    """Information that motions of one robot and one duration have.

    Attributes
    ----------
    base : BaseParameters
    noise : (nv,) array, deviation of each torque [N m, sliding joints: N]
    friction_speed : (nv,) array [rad/s, m/s]
    duration : float [s]
    """

    base: BaseParameters
    noise: Array
    friction_speed: Array
    duration: float

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

    def log_det_and_slope(self, W: Array) -> tuple[float, Array]:
        """log det A, and G (n, nv, r), its derivative by each entry of W."""
        log_det, inverse = self._inverse(W)
        share = ROWS_PER_SECOND * self.duration / len(W)
        return log_det, 2.0 * share * (W @ inverse) / self.noise[:, None] ** 2

    def deviations(self, W: Array) -> Array:
        """(r,) deviations of the base parameters to expect, from rows (n, nv, r)."""
        return np.sqrt(self._inverse(W)[1].diagonal())

    def condition(self, W: Array) -> float:
        """Condition number of W, in SI units."""
        s = np.linalg.svd(W.reshape(-1, W.shape[-1]), compute_uv=False)
        return float(s[0] / max(s[-1], 1e-300))
