"""Least squares by normal equations, joint by joint, and weighted least squares of rows with a robust loss.

Joint j has n rows of torques τ_j (n,), which a linear model W_j x with W_j (n, r) describes. Its normal equations consist of

    N_j = W_j' W_j,   c_j = W_j' τ_j,   y_j = |τ_j|².

Weighted by the variances σ_j² of the residuals, x solves

    (Σ_j N_j / σ_j² + D^-2) (x - x_0) = Σ_j (c_j - N_j x_0) / σ_j²,      σ_j² = |τ_j - W_j x|² / n

with a weak prior: D is the diagonal matrix of the largest plausible sizes, x_0 holds the file's values. Directions that a log
does not determine keep the file's values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..typing import Array

_MAX_ITERATIONS = 6
"""Maximum number of solutions with new variances of the residuals."""
_MIN_RELATIVE_SQUARES = 1e-12
"""Smallest sum of squared residuals relative to |τ|²; smaller ones are rounding errors, and may be negative."""
_MIN_RELATIVE_VARIANCE = 1e-7
"""Smallest variance of residuals relative to the mean squared torque; keeps the weights of noise-free rows finite."""
_MIN_DIVISOR = 1e-300
"""Smallest divisor: keeps quotients finite where all torques are zero."""
_DIAGONAL_ROUNDING = 1e-13
"""Relative growth of the diagonal, which keeps the matrix positive definite in spite of rounding."""
_MIN_RELATIVE_SINGULAR_VALUE = 1e-6
"""Singular values below this share of the largest are rounding errors."""
_MIN_PIVOT = 1e-6
"""Smallest entry of a unit vector that is a pivot; smaller ones are rounding errors."""
_MIN_SHARE_OF_ROW = 1e-5
"""Entries of a combination below this share of its largest are rounding errors."""
_MAX_LOG_CHANGE = 1e-3
"""Change of the logarithm of a variance up to which the variances have converged."""
_MIN_RELATIVE_DEVIATION = 1e-9
"""Smallest standard deviation of residuals relative to the largest torque."""
_MAX_RELATIVE_CHANGE = 1e-6
"""Change of a torque, in standard deviations of the residuals, up to which the weights have converged."""

Information = tuple[Array, Array, float]
"""Normal equations summed over joints, as a tuple: N (r, r), c (r,) and y = |τ|² of weighted rows."""


def sum_of(parts: Sequence[Information]) -> Information:
    """Normal equations of several parts of a log together."""
    N, c, y = parts[0]
    for N_part, c_part, y_part in parts[1:]:
        N = N + N_part
        c = c + c_part
        y = y + y_part
    return N, c, y


def left_out(parts: Sequence[Information]) -> Iterator[tuple[Information, Information]]:
    """Yield each part with the sum of the others; a single part with itself."""
    for k, part in enumerate(parts):
        others = [*parts[:k], *parts[k + 1 :]]
        yield part, sum_of(others or [part])


def squares_of(part: Information, x: Array) -> float:
    """Sum of squared residuals at x (r,)."""
    N, c, y = part
    return max(y - 2.0 * float(c @ x) + float(x @ N @ x), 0.0)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of some rows, joint by joint. Sums and differences of them are normal equations too."""

    N: Array  # (nv, r, r)
    c: Array  # (nv, r)
    y: Array  # (nv,)
    rows: float  # number of rows of each joint

    @classmethod
    def from_rows(
        cls,
        W: Array,
        tau: Array,
        active: Array | None = None,
        root: Array | None = None,
        rows: Array | slice | None = None,
    ) -> NormalEquations:
        """Normal equations of W (n, nv, r) and τ (n, nv), computed by joint to avoid a copy of W.

        ``active`` (nv, r) marks the nonzero columns of each joint. ``root`` (n, nv) are square roots of weights. ``rows`` are
        the indices or the mask of the rows that are used. By default all columns and rows are used, with weight 1.
        """
        nv, r = W.shape[1:]
        N = np.zeros((nv, r, r))
        c = np.zeros((nv, r))
        used_rows = slice(None) if rows is None else rows
        tau = tau[used_rows]
        if root is not None:
            tau = tau * root[used_rows]
        if active is None:
            active = np.ones((nv, r), bool)
        for j in range(nv):
            columns = np.flatnonzero(active[j])
            A = np.ascontiguousarray(W[used_rows, j][:, columns])  # a copy: W keeps its values
            if root is not None:
                A *= root[used_rows, j, None]
            N[j][np.ix_(columns, columns)] = A.T @ A
            c[j, columns] = A.T @ tau[:, j]
        y = (tau**2).sum(axis=0)
        return cls(N, c, y, rows=float(len(tau)))

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.N + other.N, self.c + other.c, self.y + other.y, self.rows + other.rows)

    def __sub__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.N - other.N, self.c - other.c, self.y - other.y, self.rows - other.rows)

    def together(self) -> tuple[Array, Array, float]:
        """Sums over joints of N (r, r), c (r,) and |τ|², for rows that are already divided by their standard deviations."""
        return self.N.sum(axis=0), self.c.sum(axis=0), float(self.y.sum())

    def whitened(self, sigma: Array) -> tuple[Array, Array]:
        """Σ_j N_j / σ_j² (r, r) and Σ_j c_j / σ_j² (r,) for standard deviations σ (nv,) of the residuals."""
        N = np.einsum("jkl,j->kl", self.N, sigma**-2)
        c = (self.c / sigma[:, None] ** 2).sum(axis=0)
        return N, c

    def squares(self, x: Array) -> Array:
        """Sums of squared residuals (nv,) at x (r,)."""
        squares = self.y - 2.0 * self.c @ x + np.einsum("jkl,k,l->j", self.N, x, x)
        return np.asarray(np.maximum(squares, _MIN_RELATIVE_SQUARES * self.y))

    def solve(self, prior: Prior) -> tuple[Array, Array]:
        """Weighted least-squares solution x (r,), and standard deviations σ (nv,) of its residuals.

        σ depends on x, and x on σ: both are computed in turn, until the variances change by less than 0.1 %.
        """
        n = max(self.rows, 1.0)
        least_variance = _MIN_RELATIVE_VARIANCE * self.y / n + _MIN_DIVISOR
        variance = np.maximum(self.y / n, _MIN_DIVISOR)
        x = prior.mean
        for _ in range(_MAX_ITERATIONS):
            weighted_N = np.einsum("jkl,j->kl", self.N, 1.0 / variance)
            weighted_c = (self.c / variance[:, None]).sum(axis=0)
            x = prior.solve(weighted_N, weighted_c)
            new_variance = np.maximum(self.squares(x) / n, least_variance)
            log_changes = np.abs(np.log(new_variance / variance))
            variance = new_variance
            if log_changes.max() < _MAX_LOG_CHANGE:
                break
        return x, np.sqrt(variance)


@dataclass(frozen=True, eq=False)
class Prior:
    """Weak prior of r groups of parameters: values that undetermined groups keep, and largest plausible sizes, above 0."""

    mean: Array
    size: Array

    def solve(self, A: Array, b: Array) -> Array:
        """Solve (A + D⁻²) (x - mean) = b - A mean, D the diagonal matrix of the sizes.

        With x - mean = D z this is (D A D + 1) z = D (b - A mean), whose unknowns z have similar sizes.
        """
        D = self.size
        matrix = A * D[:, None] * D[None, :]
        diagonal = np.einsum("ii->i", matrix)  # a view: the next lines change the matrix
        diagonal += 1.0
        diagonal *= 1.0 + _DIAGONAL_ROUNDING
        right_side = D * (b - A @ self.mean)
        return np.asarray(self.mean + solve_positive(matrix, right_side, units=D))


def solve_positive(A: Array, b: Array, units: Array | float = 1.0) -> Array:
    """Solve A x = b for positive definite A by Cholesky factors, scaled to unit diagonal; returns ``units`` times x."""
    from scipy.linalg.lapack import dpotrf, dpotrs  # cho_factor and cho_solve take as long again for their checks

    scale = np.sqrt(A.diagonal())
    scaled_A = A / scale[:, None] / scale[None, :]
    factor, failed_minor = dpotrf(scaled_A, clean=0)  # failed_minor: order of the first one, or 0 for none
    if failed_minor:
        raise np.linalg.LinAlgError(f"the matrix is not positive definite: leading minor {failed_minor}.")
    scaled_x, _ = dpotrs(factor, b / scale)
    return np.asarray(units * scaled_x / scale)


# Iteratively reweighted least squares with Huber's weights min(1, k / |u|), u = r / s, k = 1.345 and s = 1.4826 median |r|
# (Holland and Welsch, "Robust regression using iteratively reweighted least-squares", Comm. Statistics A6, 1977).

HUBER = 1.345
"""Huber's k."""
MAD = 1.4826
"""Ratio of the standard deviation to the median absolute deviation of normal noise."""
_MAX_REWEIGHTINGS = 12
"""Maximum number of solutions with new weights of the rows."""
Method = Literal["irls", "wls", "ols"]
"""Iteratively reweighted, weighted by joint, or ordinary least squares."""


def huber_weights(distance: Array, k: float = HUBER) -> Array:
    """Huber weights of residuals; ``distance`` is their size over the standard deviation, |u| above."""
    return np.asarray(np.minimum(1.0, k / np.maximum(distance, _MIN_DIVISOR)))


def weighted_fit(
    W: Array, tau: Array, prior: Prior, method: Method, active: Array | None = None, rows: Array | None = None
) -> tuple[Array, Array, Array]:
    """Parameters (r,), standard deviations of the residuals by joint (nv,), and weights (n, nv) of the rows.

    ``W`` is (n, nv, r), ``tau`` (n, nv). ``active`` (nv, r) marks nonzero columns, ``rows`` (n,) the rows that are used.
    A weight of 1 is full weight. Weights of unused rows have no meaning.
    """
    used_rows = slice(None) if rows is None else rows
    unweighted = NormalEquations.from_rows(W, tau, active, rows=used_rows)
    weights = np.ones(tau.shape)
    if method == "ols":
        x = prior.solve(unweighted.N.sum(axis=0), unweighted.c.sum(axis=0))
        variance = unweighted.squares(x) / max(1.0, unweighted.rows)
        return x, np.sqrt(variance), weights
    x, sigma = unweighted.solve(prior)
    if method == "wls":
        return x, sigma, weights
    largest_torques = np.abs(tau[used_rows]).max(axis=0)
    least_sigma = _MIN_RELATIVE_DEVIATION * largest_torques + _MIN_DIVISOR
    for _ in range(_MAX_REWEIGHTINGS):
        residuals = tau - W @ x
        median_deviation = np.median(np.abs(residuals[used_rows]), axis=0)
        sigma = np.maximum(MAD * median_deviation, least_sigma)
        weights = huber_weights(np.abs(residuals / sigma))
        root = np.sqrt(weights) / sigma
        equations = NormalEquations.from_rows(W, tau, active, root, used_rows)
        x_new = prior.solve(equations.N.sum(axis=0), equations.c.sum(axis=0))
        torque_changes = W @ (x_new - x)
        largest_change = np.abs(torque_changes[used_rows]).max()
        x = x_new
        if largest_change <= _MAX_RELATIVE_CHANGE * sigma.max():
            break
    return x, sigma, weights


def orthogonal_fit(A: Array, y: Array, root: Array, sizes: Array) -> tuple[Array, Array, Array]:
    """Weighted least squares: estimate x (p,), square root U⁻¹ of its covariance C (p, p), orthonormal columns Q (n, c, p).

    For measurements y (n, c), a model A (n, c, p), and the square roots ``root`` (n, c) of the weights W:

        W^(1/2) A = Q U,   x = U⁻¹ Q' W^(1/2) y,   C = U⁻¹ U⁻ᵀ.

    The columns of A are scaled by the ``sizes`` (p,) of the unknowns. Unknowns with zero columns are zero.
    """
    p = A.shape[-1]
    free = A.any(axis=(0, 1))  # unknowns with nonzero columns
    weighted_A = (A[..., free] * root[..., None]).reshape(y.size, -1)
    Q_free, U_scaled = np.linalg.qr(weighted_A * sizes[free])
    U_inverse = sizes[free][:, None] * np.linalg.inv(U_scaled)
    x = np.zeros(p)
    x[free] = U_inverse @ (Q_free.T @ (y * root).ravel())
    covariance_root = np.zeros((p, p))
    covariance_root[np.ix_(free, free)] = U_inverse
    Q = np.zeros((y.size, p))
    Q[:, free] = Q_free
    return x, covariance_root, Q.reshape(A.shape)


def null_combinations(A: Array) -> Array:
    """Basis (k, p) of the null space of A (n, p) in reduced echelon form: few nonzero entries, leading ones."""
    if len(A) > A.shape[1]:
        _, triangular_factor = np.linalg.qr(A)
        A = np.asarray(triangular_factor)  # same singular values and row space, smaller matrix
    _, singular_values, right_vectors = np.linalg.svd(A)
    rank = 0
    if singular_values.size:
        rank = int((singular_values > _MIN_RELATIVE_SINGULAR_VALUE * singular_values[0]).sum())
    basis = right_vectors[rank:].copy()
    row = 0  # the row that gets the next leading one
    for column in range(basis.shape[1]):
        if row == len(basis):
            break
        pivot_row = row + int(np.abs(basis[row:, column]).argmax())
        if abs(basis[pivot_row, column]) < _MIN_PIVOT:
            continue
        basis[[row, pivot_row]] = basis[[pivot_row, row]]  # the two rows change places
        basis[row] /= basis[row, column]
        is_other_row = np.arange(len(basis)) != row
        basis[is_other_row] -= np.outer(basis[is_other_row, column], basis[row])
        row += 1
    largest_entries = np.abs(basis).max(axis=1, keepdims=True, initial=0.0)  # of each row
    basis[np.abs(basis) < _MIN_SHARE_OF_ROW * largest_entries] = 0.0
    return basis
