"""Projection onto constraints whose A M⁻¹ A' may be singular, for batches of floats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.errors import SingularMassMatrixError
from ...core.typing import Array

# With M = L L' and W the usual size of each row, the singular values of B = W⁻¹ A L⁻ᵀ are dimensionless: 1 for a row of usual
# mobility. They do not depend on the joint coordinates, so one threshold separates significant from zero values.

TOLERANCE = 1.5e-8
"""Largest singular value that counts as zero. Coordinates accurate to the rounding of doubles, ε, may be √ε away from a
singular configuration, and singular values grow with that distance."""
MIN_PIVOT = 1e-6
"""Smallest pivot of B B' for elimination, whose error is then about ε/MIN_PIVOT = 1e-10. With smaller pivots, the singular
values of B are used: their squares are the singular values of B B'."""
MIN_PIVOT_SINGLE = 1e-2
"""Smallest pivot for elimination in float32."""
MIN_SIZE_RATIO = 1e-9
"""Least ratio of the sizes of angular [rad] and linear rows [m], and least inverse ratio: lever arms of 1 nm and 1 Gm."""

MIN_INDEPENDENT_PART = 1e-6
"""Least distance of an independent row from the span of earlier rows, as a fraction of its usual size. A row that is nearer at
every sampled configuration is dependent: samples are consistent to 1e-12 only, and redundancy of special geometry holds
everywhere."""


@dataclass(frozen=True, eq=False)
class ConstraintProjector:
    """B = W⁻¹ A L⁻ᵀ = U σ V', reduced to its significant singular values; any leading batch shape.

    In the coordinates y = L'q̈, A q̈ is W B y, and |y|² = q̈'M q̈. V spans the constrained directions, and the complement of V the
    free ones. q̈ is computed without a division by σ².
    """

    sizes: Array
    """Diagonal of W; (k,)."""
    L: Array
    """Cholesky factor of M; (..., nv, nv)."""
    U: Array
    """Left singular vectors; (..., k, m). Columns of U and V and entries of 1/σ beyond the rank are zero."""
    V: Array
    """Right singular vectors; (..., nv, m)."""
    inverse_sigma: Array
    """1/σ; (..., m)."""

    @classmethod
    def from_rows(cls, A: Array, M: Array, sizes: Array, max_rank: int | None = None) -> ConstraintProjector:
        """Projector of the rows A (..., k, nv) with their usual ``sizes`` (k,) and the mass matrix M (..., nv, nv).

        At most ``max_rank`` directions are used, if further directions are known to be rounding errors.
        """
        L = _cholesky_factor(M)
        B = _mass_weighted(A, L) / sizes[:, None]
        *batch, k, nv = B.shape
        if k == 0 or nv == 0:
            no_U = np.zeros((*batch, k, 0))
            no_V = np.zeros((*batch, nv, 0))
            no_sigma = np.zeros((*batch, 0))
            return cls(sizes, L, no_U, no_V, no_sigma)
        U, sigma, Vt = np.linalg.svd(B, full_matrices=False)
        is_significant = sigma > TOLERANCE
        if max_rank is not None:
            is_significant[..., max_rank:] = False
        safe_sigma = np.where(is_significant, sigma, 1.0)
        inverse_sigma = np.where(is_significant, 1.0 / safe_sigma, 0.0)
        V = np.swapaxes(Vt, -1, -2)
        column_factors = is_significant[..., None, :]  # 0 for columns beyond the rank
        return cls(sizes, L, U * column_factors, V * column_factors, inverse_sigma)

    @property
    def rank(self) -> Array:
        """Number of independent directions; (...)."""
        return np.count_nonzero(self.inverse_sigma, axis=-1)

    @property
    def directions(self) -> Array:
        """Orthonormal columns: first a basis of the range of A, then a basis of its complement; (..., k, k)."""
        basis = self.sizes[:, None] * self.U
        if basis.shape[-1] == 0:
            return np.broadcast_to(np.eye(len(self.sizes)), (*basis.shape[:-1], len(self.sizes)))
        directions, _, _ = np.linalg.svd(basis / self.sizes.max(), full_matrices=True)
        return directions

    @property
    def lost(self) -> Array:
        """Orthonormal rows that span the complement of the range of A, zero-padded to the largest number; (..., n, k)."""
        k = len(self.sizes)
        rank = np.asarray(self.rank)[..., None]
        max_row_count = k - rank.min(initial=k)
        column_indices = rank + np.arange(max_row_count)  # of ``directions`` beyond the rank; padding from k on
        existing_indices = np.minimum(column_indices, k - 1)
        columns = np.take_along_axis(self.directions, existing_indices[..., None, :], axis=-1)
        padded_columns = columns * (column_indices < k)[..., None, :]
        return np.asarray(np.swapaxes(padded_columns, -1, -2))

    @property
    def range(self) -> Array:
        """Orthogonal projector on the range of A, in the units of its rows; (..., k, k)."""
        is_in_range = np.arange(len(self.sizes)) < self.rank[..., None]
        Q = self.directions * is_in_range[..., None, :]
        return np.asarray(Q @ np.swapaxes(Q, -1, -2))

    @property
    def pseudoinverse(self) -> Array:
        """Moore–Penrose inverse of A M⁻¹ A' = W U σ² U' W, in the units of its rows; (..., k, k)."""
        scaled_U = self.U * self.inverse_sigma[..., None, :] / self.sizes[:, None]  # W⁻¹ U σ⁻¹
        root = self.range @ scaled_U
        return np.asarray(root @ np.swapaxes(root, -1, -2))

    @property
    def projector(self) -> Array:
        """1 - A'(A M⁻¹ A')⁺ A M⁻¹ = L (1 - V V') L⁻¹; (..., nv, nv)."""
        free = np.eye(self.V.shape[-2]) - self.V @ np.swapaxes(self.V, -1, -2)  # 1 - V V', symmetric
        transposed_product = np.linalg.solve(np.swapaxes(self.L, -1, -2), free)  # L⁻ᵀ (1 - V V')
        free_L_inverse = np.swapaxes(transposed_product, -1, -2)
        return np.asarray(self.L @ free_L_inverse)

    def nearest(self, v: Array, missing: Array, damped: Array | float = 1.0) -> Array:
        """v minus the smallest change in the kinetic metric that A maps to ``missing`` (..., k).

        ``damped`` (..., m) are factors of the change in each singular direction.
        """
        y = self.V @ (damped * self.inverse_sigma * self._significant_part(missing))[..., None]
        return np.asarray(v - self._to_velocities(y))

    def constrained_acceleration(self, force: Array, b: Array) -> tuple[Array, Array]:
        """q̈ and λ of M q̈ + A'λ = force, A q̈ + b = 0, with λ of minimum norm; (..., nv), (..., k).

        In y = L'q̈ this is y + V σ U'W λ = L⁻¹ force, where V'y = -σ⁻¹ U'W⁻¹ b.
        """
        w = np.linalg.solve(self.L, force[..., None])
        Vt_w = (np.swapaxes(self.V, -1, -2) @ w)[..., 0]
        constraint_part = Vt_w + self.inverse_sigma * self._significant_part(b)  # σ U'W λ
        lam = (self.U @ (self.inverse_sigma * constraint_part)[..., None])[..., 0] / self.sizes
        ddq = self._to_velocities(w - self.V @ constraint_part[..., None])
        minimum_lam = (self.range @ lam[..., None])[..., 0]
        return ddq, minimum_lam

    def _significant_part(self, b: Array) -> Array:
        """U'W⁻¹ b; (..., k) → (..., m)."""
        return np.asarray((np.swapaxes(self.U, -1, -2) @ (b / self.sizes)[..., None])[..., 0])

    def _to_velocities(self, y: Array) -> Array:
        """L⁻ᵀ y; (..., nv, 1) → (..., nv)."""
        return np.asarray(np.linalg.solve(np.swapaxes(self.L, -1, -2), y)[..., 0])


def mass_weighted_rows(A: Array, M: Array) -> Array:
    """A L⁻ᵀ with M = L L'; (..., k, nv)."""
    return _mass_weighted(A, _cholesky_factor(M))


def _cholesky_factor(M: Array) -> Array:
    """L of M = L L'; raises SingularMassMatrixError if there is none."""
    try:
        return np.linalg.cholesky(M) if M.size else M
    except np.linalg.LinAlgError:
        raise SingularMassMatrixError(
            "the mass matrix has no inverse at this configuration: some joint moves nothing with inertia there. Choose other "
            "joints where their axes coincide, or give their links mass."
        ) from None


def _mass_weighted(A: Array, L: Array) -> Array:
    """A L⁻ᵀ."""
    if 0 in A.shape[-2:]:
        return A
    transposed_result = np.linalg.solve(L, np.swapaxes(A, -1, -2))  # L⁻¹ A'
    return np.swapaxes(transposed_result, -1, -2)


def usual_sizes(J: Array, M: Array) -> Array:
    """RMS size of the angular and of the linear rows of A L⁻ᵀ over samples; J (n, 6, nv), M (n, nv, nv) → (6,).

    The three rows of a kind share one size, so that a row that hardly moves compared with the others is recognised.
    """
    square_lengths = (mass_weighted_rows(J, M) ** 2).sum(axis=-1)
    row_sizes = np.sqrt(square_lengths.mean(axis=0))
    largest_angular = float(row_sizes[:3].max(initial=0.0))
    largest_linear = float(row_sizes[3:].max(initial=0.0))
    angular = max(largest_angular, MIN_SIZE_RATIO * largest_linear)
    linear = max(largest_linear, MIN_SIZE_RATIO * largest_angular)
    if not angular and not linear:  # nothing moves: any size will do
        return np.ones(6)
    return np.repeat([angular, linear], 3)


def needs_singular_values(pivots: Array, sizes: Array) -> Array:
    """True if elimination with these pivots (..., k) of A M⁻¹ A' is too inaccurate and singular values are needed; (...)."""
    min_pivot = MIN_PIVOT_SINGLE if pivots.dtype == np.float32 else MIN_PIVOT
    with np.errstate(invalid="ignore", over="ignore"):
        are_large = (pivots >= min_pivot * sizes**2).all(axis=-1)  # False also for nan
        return np.asarray(~are_large)


def independent_rows(A: Array, M: Array, sizes: Array) -> tuple[int, ...]:
    """Indices of the rows of A that are independent of earlier rows, at the sample of largest rank.

    A (n, k, nv) and M (n, nv, nv) are given at n samples.
    """
    most_rows: tuple[int, ...] = ()
    for B in mass_weighted_rows(A, M) / sizes[:, None]:
        independent: list[int] = []
        Q = np.zeros((0, A.shape[-1]))  # orthonormal rows that span the independent rows
        for i, row in enumerate(B):
            residual = row - Q.T @ (Q @ row)
            residual = residual - Q.T @ (Q @ residual)  # repeated against rounding errors
            if np.linalg.norm(residual) > MIN_INDEPENDENT_PART:
                independent.append(i)
                Q = np.vstack([Q, residual / np.linalg.norm(residual)])
        if len(independent) > len(most_rows):
            most_rows = tuple(independent)
    return most_rows
