"""Projection onto constraints with singular A M⁻¹ A'. Floats, batches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.errors import SingularMassMatrixError
from ...core.typing import Array

# With M = L L' and W the usual size of each row, the singular values of B = W⁻¹ A L⁻ᵀ are dimensionless: 1 for a row of usual
# mobility. They do not depend on the joint coordinates, so one threshold separates significant from zero values.

TOLERANCE = 1.5e-8
"""Singular values below it count as zero. Coordinates accurate to the rounding of doubles, ε, may be √ε away from a singular
configuration, and singular values grow with that distance."""
MIN_PIVOT = 1e-6
"""Smallest pivot of B B' for elimination, whose error is then about ε/MIN_PIVOT = 1e-10. Below it, the singular values of B are
used instead; those of B B' are their squares."""
MIN_PIVOT_SINGLE = 1e-2
"""The same threshold for float32."""
MIN_SIZE_RATIO = 1e-9
"""Negligible rad relative to m, and m relative to rad: lever arms below a nanometre, or radii above a gigametre."""

MIN_INDEPENDENT_PART = 1e-6
"""Distance of a row from the span of others, as a fraction of its usual size. A row that is nearer at every sampled
configuration is dependent: samples are consistent to 1e-12 only, and redundancy of special geometry holds everywhere."""


@dataclass(frozen=True, eq=False)
class ConstraintProjector:
    """B = W⁻¹ A L⁻ᵀ = U σ V', reduced to its significant singular values; any leading batch shape.

    In the coordinates y = L'q̈ the rows act as B y, and the norm of y is that of the kinetic metric. V spans the constrained
    directions, its complement the free ones, and q̈ is computed without a division by σ².
    """

    sizes: Array
    """Diagonal of W; (k,)."""
    L: Array
    """Cholesky factor of M; (..., nv, nv)."""
    U: Array
    """Left singular vectors; (..., k, m). Columns beyond the rank are zero, likewise in V and 1/σ."""
    V: Array
    """Right singular vectors; (..., nv, m)."""
    inverse_sigma: Array
    """1/σ; (..., m)."""

    @classmethod
    def from_rows(cls, A: Array, M: Array, sizes: Array, max_rank: int | None = None) -> ConstraintProjector:
        """A (..., k, nv), M (..., nv, nv), sizes (k,); ``max_rank`` if further directions are known to be rounding errors."""
        L = _factor(M)
        B = _mass_weighted(A, L) / sizes[:, None]
        batch, (k, nv) = B.shape[:-2], B.shape[-2:]
        if k == 0 or nv == 0:
            return cls(sizes, L, np.zeros((*batch, k, 0)), np.zeros((*batch, nv, 0)), np.zeros((*batch, 0)))
        U, sigma, Vt = np.linalg.svd(B, full_matrices=False)
        significant = sigma > TOLERANCE
        if max_rank is not None:
            significant[..., max_rank:] = False
        inverse = np.where(significant, 1.0 / np.where(significant, sigma, 1.0), 0.0)
        V = np.swapaxes(Vt, -1, -2)
        return cls(sizes, L, U * significant[..., None, :], V * significant[..., None, :], inverse)

    @property
    def rank(self) -> Array:
        """Number of independent directions; (...)."""
        return np.count_nonzero(self.inverse_sigma, axis=-1)

    @property
    def directions(self) -> Array:
        """Orthonormal columns: first a basis of the range of A, then one of its complement; (..., k, k)."""
        basis = self.sizes[:, None] * self.U
        if basis.shape[-1] == 0:
            return np.broadcast_to(np.eye(len(self.sizes)), (*basis.shape[:-1], len(self.sizes)))
        return np.linalg.svd(basis / self.sizes.max(), full_matrices=True)[0]

    @property
    def lost(self) -> Array:
        """Orthonormal rows that span the complement of the range of A, zero-padded to the largest number; (..., n, k)."""
        k, rank = len(self.sizes), np.asarray(self.rank)[..., None]
        index = rank + np.arange(k - rank.min(initial=k))
        columns = np.take_along_axis(self.directions, np.minimum(index, k - 1)[..., None, :], axis=-1)
        return np.asarray(np.swapaxes(columns * (index < k)[..., None, :], -1, -2))

    @property
    def range(self) -> Array:
        """Orthogonal projector on the range of A, in the units of its rows; (..., k, k)."""
        Q = self.directions * (np.arange(len(self.sizes)) < self.rank[..., None])[..., None, :]
        return np.asarray(Q @ np.swapaxes(Q, -1, -2))

    @property
    def pseudoinverse(self) -> Array:
        """Moore–Penrose inverse of A M⁻¹ A', in the units of its rows; (..., k, k)."""
        half = self.range @ (self.U * self.inverse_sigma[..., None, :] / self.sizes[:, None])
        return np.asarray(half @ np.swapaxes(half, -1, -2))

    @property
    def projector(self) -> Array:
        """1 - A'(A M⁻¹ A')⁺ A M⁻¹ = L (1 - V V') L⁻¹; (..., nv, nv)."""
        free = np.eye(self.V.shape[-2]) - self.V @ np.swapaxes(self.V, -1, -2)
        return np.asarray(self.L @ np.swapaxes(np.linalg.solve(np.swapaxes(self.L, -1, -2), free), -1, -2))

    def nearest(self, v: Array, missing: Array, damped: Array | float = 1.0) -> Array:
        """v minus the smallest change in the kinetic metric that A maps to ``missing``, its directions ``damped`` (..., m)."""
        y = self.V @ (damped * self.inverse_sigma * self._significant_part(missing))[..., None]
        return np.asarray(v - self._to_velocities(y))

    def constrained_acceleration(self, force: Array, b: Array) -> tuple[Array, Array]:
        """q̈ and λ of M q̈ + A'λ = force, A q̈ + b = 0, with λ of minimum norm; (..., nv), (..., k)."""
        w = np.linalg.solve(self.L, force[..., None])
        removed = (np.swapaxes(self.V, -1, -2) @ w)[..., 0] + self.inverse_sigma * self._significant_part(b)
        lam = (self.U @ (self.inverse_sigma * removed)[..., None])[..., 0] / self.sizes
        return self._to_velocities(w - self.V @ removed[..., None]), (self.range @ lam[..., None])[..., 0]

    def _significant_part(self, b: Array) -> Array:
        return np.asarray((np.swapaxes(self.U, -1, -2) @ (b / self.sizes)[..., None])[..., 0])

    def _to_velocities(self, y: Array) -> Array:
        """L⁻ᵀ y; (..., nv, 1) → (..., nv)."""
        return np.asarray(np.linalg.solve(np.swapaxes(self.L, -1, -2), y)[..., 0])


def mass_weighted_rows(A: Array, M: Array) -> Array:
    """A L⁻ᵀ with M = L L'; (..., k, nv)."""
    return _mass_weighted(A, _factor(M))


def _factor(M: Array) -> Array:
    try:
        return np.linalg.cholesky(M) if M.size else M
    except np.linalg.LinAlgError:
        raise SingularMassMatrixError(
            "the mass matrix has no inverse at this configuration: some joint moves nothing with inertia there. Choose other "
            "joints where their axes coincide, or give their links mass."
        ) from None


def _mass_weighted(A: Array, L: Array) -> Array:
    if 0 in A.shape[-2:]:
        return A
    return np.swapaxes(np.linalg.solve(L, np.swapaxes(A, -1, -2)), -1, -2)


def usual_sizes(J: Array, M: Array) -> Array:
    """RMS size of the angular and of the linear rows of A L⁻ᵀ over samples; J (n, 6, nv), M (n, nv, nv) → (6,).

    The three rows of a kind share one size, so that a row that hardly moves compared with the others is recognised.
    """
    rows = np.sqrt((mass_weighted_rows(J, M) ** 2).sum(axis=-1).mean(axis=0))
    turning, moving = float(rows[:3].max(initial=0.0)), float(rows[3:].max(initial=0.0))
    turning, moving = max(turning, MIN_SIZE_RATIO * moving), max(moving, MIN_SIZE_RATIO * turning)
    return np.repeat([turning or 1.0, moving or 1.0], 3)


def needs_singular_values(pivots: Array, sizes: Array) -> Array:
    """True if elimination with these pivots (..., k) of A M⁻¹ A' is too inaccurate and singular values are needed; (...)."""
    min_pivot = MIN_PIVOT_SINGLE if pivots.dtype == np.float32 else MIN_PIVOT
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(~(pivots >= min_pivot * sizes**2).all(axis=-1))


def independent_rows(A: Array, M: Array, sizes: Array) -> tuple[int, ...]:
    """Numbers of the rows of A independent of earlier ones, at the sample of largest rank; A (n, k, nv), M (n, nv, nv)."""
    largest: tuple[int, ...] = ()
    for B in mass_weighted_rows(A, M) / sizes[:, None]:
        independent: list[int] = []
        Q = np.zeros((0, A.shape[-1]))
        for i, row in enumerate(B):
            residual = row - Q.T @ (Q @ row)
            residual = residual - Q.T @ (Q @ residual)  # repeated against rounding errors
            if np.linalg.norm(residual) > MIN_INDEPENDENT_PART:
                independent.append(i)
                Q = np.vstack([Q, residual / np.linalg.norm(residual)])
        largest = max(largest, tuple(independent), key=len)
    return largest
