"""What rows A of velocities can reach through a mass matrix, where A M⁻¹ A' may have no inverse. Floats, batches.

With M = L L' and W the usual size of each row, the singular values of B = W⁻¹ A L⁻ᵀ are pure numbers, 1 for a row that
moves as easily as it usually does, and the same for any choice of coordinates of the joints. So one number says which of
them count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

TOLERANCE = 1.5e-8
"""Singular values below it are zero. Coordinates good to the rounding of doubles, ε, may be √ε from a singular
configuration, and singular values grow with the distance from it; so what is smaller than √ε cannot be told from zero."""
SAFE = 1e-6
"""Where every pivot of B B' is larger, its inverse by elimination is good to some ε/SAFE = 1e-10; below, it is done again
here by singular values, of which B has the root of what B B' would have."""
SAFE_SINGLE = 1e-2
"""The same for float32."""
NEGLIGIBLE = 1e-9
"""Rad against m, and m against rad: turning about levers shorter than a nanometre, or sliding on circles of a gigametre."""

GENERIC = 1e-6
"""A row that is nearer to the span of others than this part of its usual size, at every configuration looked at, depends on
them: those configurations are consistent to 1e-12 only, and loops of special geometry are redundant nowhere else."""

__all__ = ["Reach", "doubtful", "independent_rows", "through", "usual_sizes"]


@dataclass(frozen=True, eq=False)
class Reach:
    """The singular value decomposition of B = W⁻¹ A L⁻ᵀ, U σ V'; any leading batch shape."""

    sizes: Array
    """The diagonal of W; (k,)."""
    U: Array
    sigma: Array

    @classmethod
    def of(cls, A: Array, M: Array, sizes: Array) -> Reach:
        """A (..., k, nv), M (..., nv, nv), sizes (k,)."""
        B = through(A, M) / sizes[:, None]
        if 0 in B.shape[-2:]:
            return cls(sizes, np.zeros((*B.shape[:-1], 0)), np.zeros((*B.shape[:-2], 0)))
        U, sigma, _ = np.linalg.svd(B, full_matrices=False)
        return cls(sizes, U, sigma)

    @property
    def rank(self) -> Array:
        """How many directions there are; (...)."""
        return np.count_nonzero(self.sigma > TOLERANCE, axis=-1)

    @property
    def basis(self) -> Array:
        """W U, its columns beyond the rank zero: a basis of what A reaches; (..., k, m)."""
        return self.sizes[:, None] * self.U * (self.sigma > TOLERANCE)[..., None, :]

    @property
    def range(self) -> Array:
        """The orthogonal projector on what A reaches, in the units of its rows; (..., k, k)."""
        Q = self.directions * (np.arange(len(self.sizes)) < self.rank[..., None])[..., None, :]
        return np.asarray(Q @ np.swapaxes(Q, -1, -2))

    @property
    def directions(self) -> Array:
        """Orthonormal columns: first those that span what A reaches, then the rest; (..., k, k)."""
        G = self.basis
        if G.shape[-1] == 0:
            return np.broadcast_to(np.eye(len(self.sizes)), (*G.shape[:-1], len(self.sizes)))
        return np.linalg.svd(G / self.sizes.max(), full_matrices=True)[0]

    @property
    def inverse(self) -> Array:
        """A generalised inverse of S = A M⁻¹ A', symmetric: S X S = S; (..., k, k)."""
        kept = self.sigma > TOLERANCE
        scaled = (self.U * np.where(kept, 1.0 / np.where(kept, self.sigma, 1.0), 0.0)[..., None, :]) / self.sizes[
            :, None
        ]
        return np.asarray(scaled @ np.swapaxes(scaled, -1, -2))

    @property
    def pseudoinverse(self) -> Array:
        """That of Moore and Penrose of S, in the units of its rows; (..., k, k)."""
        P = self.range
        return np.asarray(P @ self.inverse @ P)


def through(A: Array, M: Array) -> Array:
    """A L⁻ᵀ with M = L L'; (..., k, nv)."""
    if 0 in A.shape[-2:]:
        return A
    return np.swapaxes(np.linalg.solve(np.linalg.cholesky(M), np.swapaxes(A, -1, -2)), -1, -2)


def usual_sizes(J: Array, M: Array) -> Array:
    """The size of turning and of moving rows of A L⁻ᵀ over samples; J (n, 6, nv), M (n, nv, nv) → (6,).

    One size for the three rows of a kind, so that a row that hardly moves beside the others is seen to.
    """
    rows = np.sqrt((through(J, M) ** 2).sum(axis=-1).mean(axis=0))
    turning, moving = float(rows[:3].max(initial=0.0)), float(rows[3:].max(initial=0.0))
    turning, moving = max(turning, NEGLIGIBLE * moving), max(moving, NEGLIGIBLE * turning)
    return np.repeat([turning or 1.0, moving or 1.0], 3)


def doubtful(pivots: Array, sizes: Array) -> Array:
    """Whether elimination with these pivots (..., k) of A M⁻¹ A' is to be done again by singular values; (...)."""
    safe = SAFE_SINGLE if pivots.dtype == np.float32 else SAFE
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(~(pivots >= safe * sizes**2).all(axis=-1))


def independent_rows(A: Array, M: Array, sizes: Array) -> tuple[int, ...]:
    """Numbers of the rows of A that do not depend on earlier ones, where most of them do not; A (n, k, nv), M (n, nv, nv)."""
    best: tuple[int, ...] = ()
    for B in through(A, M) / sizes[:, None]:
        kept: list[int] = []
        Q = np.zeros((0, A.shape[-1]))
        for i, row in enumerate(B):
            rest = row - Q.T @ (Q @ row)
            rest = rest - Q.T @ (Q @ rest)  # once more, for what rounding left
            if np.linalg.norm(rest) > GENERIC:
                kept.append(i)
                Q = np.vstack([Q, rest / np.linalg.norm(rest)])
        best = max(best, tuple(kept), key=len)
    return best
