"""Least squares by normal equations, joint by joint, and weighted least squares of rows with a robust loss.

For joint j, W_j (n, r) and τ_j (n): N_j = W_j' W_j, c_j = W_j' τ_j, y_j = |τ_j|². Weighted, x solves

    (Σ_j N_j / σ_j² + D^-2) (x - x_0) = Σ_j (c_j - N_j x_0) / σ_j²,      σ_j² = |τ_j - W_j x|² / n

with a weak prior: D the largest plausible size of each group, x_0 the file's values. Directions that a log does not
determine keep the file's values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..typing import Array

_ROUNDS = 6
_LEAST_SHARE = 1e-12
_LEAST_VARIANCE = 1e-7
"""Smallest variance of residuals relative to the squared torques; keeps the weights of noise-free rows finite."""
_ROUNDING = 1e-13
_NO_INFORMATION = 1e-6
"""Singular values below this share of the largest are rounding errors."""

Information = tuple[Array, Array, float]
"""N, c and |τ|² of weighted rows."""


def sum_of(parts: Sequence[Information]) -> Information:
    """Add the information of several parts."""
    N, c, y = parts[0]
    for part in parts[1:]:
        N, c, y = N + part[0], c + part[1], y + part[2]
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
    """Normal equations of some rows, with the number of rows; sums of them are normal equations too."""

    N: Array  # (nv, r, r)
    c: Array  # (nv, r)
    y: Array  # (nv,)
    rows: float

    @classmethod
    def from_rows(
        cls,
        W: Array,
        tau: Array,
        active: Array | None = None,
        root: Array | None = None,
        rows: Array | slice | None = None,
    ) -> NormalEquations:
        """Normal equations of rows W (n, nv, r) and τ (n, nv), computed by joint to avoid a copy of W."""
        nv, r = W.shape[1:]
        N, c = np.zeros((nv, r, r)), np.zeros((nv, r))
        used = slice(None) if rows is None else rows
        tau = tau[used]
        if root is not None:
            tau = tau * root[used]
        if active is None:
            active = np.ones((nv, r), bool)
        for j in range(nv):
            columns = np.flatnonzero(active[j])
            A = np.ascontiguousarray(W[used, j][:, columns])
            if root is not None:
                A *= root[used, j, None]
            N[j][np.ix_(columns, columns)] = A.T @ A
            c[j, columns] = A.T @ tau[:, j]
        return cls(N, c, (tau**2).sum(axis=0), float(len(tau)))

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.N + other.N, self.c + other.c, self.y + other.y, self.rows + other.rows)

    def __sub__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.N - other.N, self.c - other.c, self.y - other.y, self.rows - other.rows)

    def together(self) -> tuple[Array, Array, float]:
        """N (r, r), c (r,) and |τ|² summed over joints, for equations in units of their residuals."""
        return self.N.sum(axis=0), self.c.sum(axis=0), float(self.y.sum())

    def whitened(self, sigma: Array) -> tuple[Array, Array]:
        """N (r, r) and c (r,) summed over joints, with equations scaled by residual sizes (nv,)."""
        return np.einsum("jkl,j->kl", self.N, sigma**-2), (self.c / sigma[:, None] ** 2).sum(axis=0)

    def squares(self, x: Array) -> Array:
        """Sums of squared residuals (nv,) at x (r,)."""
        squares = self.y - 2.0 * self.c @ x + np.einsum("jkl,k,l->j", self.N, x, x)
        return np.asarray(np.maximum(squares, _LEAST_SHARE * self.y))

    def solve(self, prior: Prior) -> tuple[Array, Array]:
        """Weighted least-squares solution and residual sizes."""
        variance = np.maximum(self.y / max(self.rows, 1.0), 1e-300)
        x = prior.mean
        for _ in range(_ROUNDS):
            x = prior.solve(np.einsum("jkl,j->kl", self.N, 1.0 / variance), (self.c / variance[:, None]).sum(axis=0))
            new = np.maximum(
                self.squares(x) / max(self.rows, 1.0), _LEAST_VARIANCE * self.y / max(self.rows, 1.0) + 1e-300
            )
            close = bool(np.abs(np.log(new / variance)).max() < 1e-3)
            variance = new
            if close:
                break
        return x, np.sqrt(variance)


@dataclass(frozen=True, eq=False)
class Prior:
    """Weak prior: values (r,) of undetermined groups, and their largest plausible sizes (r,), above 0."""

    mean: Array
    size: Array

    def solve(self, A: Array, b: Array) -> Array:
        """Solve (A + size⁻²) x = b + size⁻² mean, scaled to unit sizes."""
        S = self.size
        scaled = A * S[:, None] * S[None, :]
        diagonal = np.einsum("ii->i", scaled)  # a view
        diagonal += 1.0
        diagonal *= 1.0 + _ROUNDING
        return np.asarray(self.mean + solve_positive(scaled, S * (b - A @ self.mean), S))


def solve_positive(A: Array, b: Array, units: Array | float = 1.0) -> Array:
    """Solve A x = b for positive definite A by Cholesky factors, scaled to unit diagonal; returns ``units`` times x."""
    from scipy.linalg.lapack import dpotrf, dpotrs  # cho_factor and cho_solve take as long again for their checks

    size = np.sqrt(A.diagonal())
    factor, failed = dpotrf(A / size[:, None] / size[None, :], clean=0)
    if failed:
        raise np.linalg.LinAlgError(f"the matrix is not positive definite: leading minor {failed}.")
    solution, _ = dpotrs(factor, b / size)
    return np.asarray(units * solution / size)


# Iteratively reweighted least squares with Huber's weights min(1, k / |u|), u = r / s, k = 1.345 and s = 1.4826 median |r|
# (Holland and Welsch, "Robust regression using iteratively reweighted least-squares", Comm. Statistics A6, 1977).

HUBER, MAD = 1.345, 1.4826
"""Huber's k, and the ratio of the standard deviation to the median absolute deviation of normal noise."""
_REWEIGHTINGS = 12
Method = Literal["irls", "wls", "ols"]


def huber_weights(distance: Array, k: float = HUBER) -> Array:
    """Huber weights of residuals; ``distance`` is their size over the standard deviation."""
    return np.asarray(np.minimum(1.0, k / np.maximum(distance, 1e-300)))


def weighted_fit(
    W: Array, tau: Array, prior: Prior, method: Method, active: Array | None = None, rows: Array | None = None
) -> tuple[Array, Array, Array]:
    """Parameters (r,), residual sizes by joint (nv,), and weights (n, nv) of the rows, 1 for full weight.

    ``W`` is (n, nv, r), ``tau`` (n, nv). ``active`` (nv, r) marks nonzero columns, ``rows`` (n,) the rows that are
    used; weights of other rows are meaningless.
    """
    used = slice(None) if rows is None else rows
    plain = NormalEquations.from_rows(W, tau, active, rows=used)
    weights = np.ones(tau.shape)
    if method == "ols":
        x = prior.solve(plain.N.sum(axis=0), plain.c.sum(axis=0))
        return x, np.sqrt(plain.squares(x) / max(1.0, plain.rows)), weights
    x, sigma = plain.solve(prior)
    if method == "wls":
        return x, sigma, weights
    for _ in range(_REWEIGHTINGS):
        residuals = tau - W @ x
        least_sigma = 1e-9 * np.abs(tau[used]).max(axis=0) + 1e-300
        sigma = np.maximum(MAD * np.median(np.abs(residuals[used]), axis=0), least_sigma)
        weights = huber_weights(np.abs(residuals / sigma))
        root = np.sqrt(weights) / sigma
        equations = NormalEquations.from_rows(W, tau, active, root, used)
        new = prior.solve(equations.N.sum(axis=0), equations.c.sum(axis=0))
        done = bool(np.abs((W @ (new - x))[used]).max() <= 1e-6 * sigma.max())
        x = new
        if done:
            break
    return x, sigma, weights


def orthogonal_fit(A: Array, y: Array, root: Array, sizes: Array) -> tuple[Array, Array, Array]:
    """Weighted least squares: estimate (p,), square root of its covariance (p, p), orthonormal columns Q (n, c, p).

    A (n, c, p) W^(1/2) = Q U,  x = U⁻¹ Q' W^(1/2) y,  C = U⁻¹ U⁻ᵀ, with ``root`` (n, c) the square roots of the weights
    and ``sizes`` (p,) of the unknowns. Unknowns with zero columns are zero.
    """
    p = A.shape[-1]
    free = A.any(axis=(0, 1))
    q, upper = np.linalg.qr((A[..., free] * root[..., None]).reshape(y.size, -1) * sizes[free])
    x, half, Q = np.zeros(p), np.zeros((p, p)), np.zeros((y.size, p))
    inverse = sizes[free][:, None] * np.linalg.inv(upper)
    x[free] = inverse @ (q.T @ (y * root).ravel())
    half[np.ix_(free, free)] = inverse
    Q[:, free] = q
    return x, half, Q.reshape(A.shape)


def null_combinations(A: Array) -> Array:
    """Basis (k, p) of the null space of A (n, p) in reduced echelon form: few nonzero entries, leading ones."""
    if len(A) > A.shape[1]:
        A = np.asarray(np.linalg.qr(A)[1])  # same singular values and row space, smaller matrix
    _, values, rows = np.linalg.svd(A)
    rank = int((values > _NO_INFORMATION * values[0]).sum()) if values.size else 0
    rows, lead = rows[rank:].copy(), 0
    for column in range(rows.shape[1]):
        if lead == len(rows):
            break
        pivot = lead + int(np.abs(rows[lead:, column]).argmax())
        if abs(rows[pivot, column]) < 1e-6:
            continue
        rows[[lead, pivot]] = rows[[pivot, lead]]
        rows[lead] /= rows[lead, column]
        others = np.arange(len(rows)) != lead
        rows[others] -= np.outer(rows[others, column], rows[lead])
        lead += 1
    rows[np.abs(rows) < 1e-5 * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)] = 0.0
    return rows
