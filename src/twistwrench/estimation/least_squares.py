"""Least squares by normal equations, joint by joint, and weighted least squares of rows with a robust loss.

For joint j, W_j (n, r) and τ_j (n): N_j = W_j' W_j, c_j = W_j' τ_j, y_j = |τ_j|². Weighted, x solves

    (Σ_j N_j / σ_j² + D^-2) (x - x_0) = Σ_j (c_j - N_j x_0) / σ_j²,      σ_j² = |τ_j - W_j x|² / n

with a weak prior: D the largest plausible size of each group, x_0 the file's values. Directions that a log does not determine
keep the file's values.
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
"""Least variance of residuals, as a share of the torques' squares: weights of rows without noise stay finite."""
_ROUNDING = 1e-13

Information = tuple[Array, Array, float]
"""N, c and |τ|² of weighted rows."""


def sum_of(parts: Sequence[Information]) -> Information:
    """Sum of the information of several parts."""
    N, c, y = parts[0]
    for other in parts[1:]:
        N, c, y = N + other[0], c + other[1], y + other[2]
    return N, c, y


def left_out(parts: Sequence[Information]) -> Iterator[tuple[Information, Information]]:
    """Each part with the sum of the others; a single one with itself."""
    for k, part in enumerate(parts):
        yield part, sum_of([p for j, p in enumerate(parts) if j != k] or [part])


def squares_of(part: Information, x: Array) -> float:
    """Sum of squared residuals at x (r,)."""
    N, c, y = part
    return max(y - 2.0 * float(c @ x) + float(x @ N @ x), 0.0)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of some rows, (nv, r, r), (nv, r), (nv,), and how many rows of each joint; they add up.

    Attributes
    ----------
    N : (nv, r, r) array
    c : (nv, r) array
    y : (nv,) array
    rows : float
    """

    N: Array
    c: Array
    y: Array
    rows: float

    @classmethod
    def from_rows(
        cls,
        W: Array,
        tau: Array,
        felt: Array | None = None,
        root: Array | None = None,
        rows: Array | slice | None = None,
    ) -> NormalEquations:
        """Normal equations of rows W (n, nv, r) and τ (n, nv), joint by joint, so that W is not copied."""
        nv, r = W.shape[1:]
        N, c = np.zeros((nv, r, r)), np.zeros((nv, r))
        mine = slice(None) if rows is None else rows
        tau = tau[mine] if root is None else tau[mine] * root[mine]
        for j in range(nv):
            which = np.arange(r) if felt is None else np.flatnonzero(felt[j])
            A = np.ascontiguousarray(W[mine, j][:, which])
            if root is not None:
                A *= root[mine, j, None]
            N[j][np.ix_(which, which)] = A.T @ A
            c[j, which] = A.T @ tau[:, j]
        return cls(N, c, (tau**2).sum(axis=0), float(len(tau)))

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.N + other.N, self.c + other.c, self.y + other.y, self.rows + other.rows)

    def __sub__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(self.N - other.N, self.c - other.c, self.y - other.y, self.rows - other.rows)

    def together(self) -> tuple[Array, Array, float]:
        """N (r, r), c (r,) and |τ|² of all joints, of equations in units of their residuals."""
        return self.N.sum(axis=0), self.c.sum(axis=0), float(self.y.sum())

    def squares(self, x: Array) -> Array:
        """Sums of squared residuals (nv,) at x (r,)."""
        found = self.y - 2.0 * self.c @ x + np.einsum("jkl,k,l->j", self.N, x, x)
        return np.asarray(np.maximum(found, _LEAST_SHARE * self.y))

    def solve(self, prior: Prior) -> tuple[Array, Array]:
        """Weighted least squares."""
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
class FeltEquations:
    """Normal equations without zero entries: for each joint those of the columns that affect it.

    Attributes
    ----------
    N : tuple of (k, k) arrays, by joint
    c : tuple of (k,) arrays
    y : (nv,) array
    rows : float
    felt : (nv, r) bool array
    """

    N: tuple[Array, ...]
    c: tuple[Array, ...]
    y: Array
    rows: float
    felt: Array

    @classmethod
    def from_equations(cls, equations: NormalEquations, felt: Array) -> FeltEquations:
        """Compressed equations, from those whose other entries are zero."""
        N = tuple(A[np.ix_(mine, mine)] for A, mine in zip(equations.N, felt, strict=True))
        c = tuple(b[mine] for b, mine in zip(equations.c, felt, strict=True))
        return cls(N, c, equations.y, equations.rows, felt)

    @property
    def nbytes(self) -> int:
        """Size in memory [bytes]."""
        return sum(x.nbytes for x in (*self.N, *self.c, self.y))

    def whole(self) -> NormalEquations:
        """With the entries that are zero."""
        nv, r = self.felt.shape
        N, c = np.zeros((nv, r, r)), np.zeros((nv, r))
        for j, mine in enumerate(self.felt):
            N[j][np.ix_(mine, mine)], c[j, mine] = self.N[j], self.c[j]
        return NormalEquations(N, c, self.y, self.rows)


@dataclass(frozen=True, eq=False)
class Prior:
    """Weak prior: values of groups that the rows do not determine, and their largest plausible size.

    Attributes
    ----------
    mean : (r,) array
    size : (r,) array, above 0
    """

    mean: Array
    size: Array

    def solve(self, A: Array, b: Array) -> Array:
        """x of (A + size⁻²) x = b + size⁻² mean, in units in which sizes are 1."""
        import scipy.linalg

        S = self.size
        scaled = A * S[:, None] * S[None, :]
        scaled[np.diag_indices_from(scaled)] += 1.0
        scaled[np.diag_indices_from(scaled)] *= 1.0 + _ROUNDING
        diagonal = np.sqrt(scaled.diagonal())
        factor = scipy.linalg.cho_factor(scaled / diagonal[:, None] / diagonal[None, :], check_finite=False)
        right = S * (b - A @ self.mean)
        return np.asarray(
            self.mean + S * scipy.linalg.cho_solve(factor, right / diagonal, check_finite=False) / diagonal
        )


# ── Weighted least squares of rows with Huber's loss

# Iteratively reweighted least squares with Huber's weights min(1, k / |u|), u = r / s, k = 1.345 and s = 1.4826 median |r|
# (Holland and Welsch, "Robust regression using iteratively reweighted least-squares", Comm. Statistics A6, 1977).

HUBER, _MAD = 1.345, 1.4826
_REWEIGHTINGS = 12
Method = Literal["irls", "wls", "ols"]


def weighted_fit(
    W: Array, tau: Array, prior: Prior, method: Method, felt: Array | None = None, rows: Array | None = None
) -> tuple[Array, Array, Array]:
    """Parameters (r,), sizes of residuals by joint (nv,), and weights (n, nv) of the rows, 1 for whole ones.

    ``W`` is (n, nv, r), ``tau`` (n, nv); ``felt`` (nv, r) marks the columns that are not zero, ``rows`` (n,) bool
    the rows that count: weights of the others are meaningless.
    """
    mine = slice(None) if rows is None else rows
    plain = NormalEquations.from_rows(W, tau, felt, rows=mine)
    weights = np.ones(tau.shape)
    if method == "ols":
        x = prior.solve(plain.N.sum(axis=0), plain.c.sum(axis=0))
        return x, np.sqrt(plain.squares(x) / max(1.0, plain.rows)), weights
    x, sigma = plain.solve(prior)
    if method == "wls":
        return x, sigma, weights
    for _ in range(_REWEIGHTINGS):
        left = tau - W @ x
        sigma = np.maximum(_MAD * np.median(np.abs(left[mine]), axis=0), 1e-9 * np.abs(tau[mine]).max(axis=0) + 1e-300)
        weights = np.minimum(1.0, HUBER / np.maximum(np.abs(left / sigma), 1e-300))
        root = np.sqrt(weights) / sigma
        equations = NormalEquations.from_rows(W, tau, felt, root, mine)
        new = prior.solve(equations.N.sum(axis=0), equations.c.sum(axis=0))
        done = bool(np.abs((W @ (new - x))[mine]).max() <= 1e-6 * sigma.max())
        x = new
        if done:
            break
    return x, sigma, weights
