"""What rows A of velocities can reach through a mass matrix, where A M⁻¹ A' may have no inverse. Floats, batches.

With M = L L' and W the usual size of each row, the singular values of B = W⁻¹ A L⁻ᵀ are pure numbers, 1 for a row that
moves as easily as it usually does, and the same for any choice of coordinates of the joints. So one number says which of
them count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SingularMassMatrixError
from ..typing import Array

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


@dataclass(frozen=True, eq=False)
class Reach:
    """B = W⁻¹ A L⁻ᵀ = U σ V' by singular values, those that count; any leading batch shape.

    In the coordinates y = L'q̈, B y is what the rows see, and no length of y is larger than another of the same energy. So
    what constrains is V, what is free is the rest, and no number is divided by σ² on its way to q̈.
    """

    sizes: Array
    """The diagonal of W; (k,)."""
    L: Array
    """(..., nv, nv)."""
    U: Array
    """Its columns beyond the rank are zero, as are those of V, and 1/σ; (..., k, m)."""
    V: Array
    """(..., nv, m)."""
    inverse_sigma: Array
    """(..., m)."""

    @classmethod
    def of(cls, A: Array, M: Array, sizes: Array, most: int | None = None) -> Reach:
        """A (..., k, nv), M (..., nv, nv), sizes (k,); ``most`` directions where more are known to be rounding."""
        L = _factor(M)
        B = _through(A, L) / sizes[:, None]
        if 0 in B.shape[-2:]:
            empty = [np.zeros((*B.shape[:-2], *shape)) for shape in ((B.shape[-2], 0), (B.shape[-1], 0), (0,))]
            return cls(sizes, L, *empty)
        U, sigma, Vt = np.linalg.svd(B, full_matrices=False)
        kept = (sigma > TOLERANCE) & (np.arange(sigma.shape[-1]) < (sigma.shape[-1] if most is None else most))
        inverse = np.where(kept, 1.0 / np.where(kept, sigma, 1.0), 0.0)
        return cls(sizes, L, U * kept[..., None, :], np.swapaxes(Vt, -1, -2) * kept[..., None, :], inverse)

    @property
    def rank(self) -> Array:
        """How many directions there are; (...)."""
        return np.count_nonzero(self.inverse_sigma, axis=-1)

    @property
    def directions(self) -> Array:
        """Orthonormal columns: first those that span what A reaches, then the rest; (..., k, k)."""
        basis = self.sizes[:, None] * self.U
        if basis.shape[-1] == 0:
            return np.broadcast_to(np.eye(len(self.sizes)), (*basis.shape[:-1], len(self.sizes)))
        return np.linalg.svd(basis / self.sizes.max(), full_matrices=True)[0]

    @property
    def lost(self) -> Array:
        """Orthonormal rows that span the rest, as many as the sample with most has, zero after its own; (..., n, k)."""
        k, rank = len(self.sizes), np.asarray(self.rank)[..., None]
        place = rank + np.arange(k - rank.min(initial=k))
        columns = np.take_along_axis(self.directions, np.minimum(place, k - 1)[..., None, :], axis=-1)
        return np.asarray(np.swapaxes(columns * (place < k)[..., None, :], -1, -2))

    @property
    def range(self) -> Array:
        """The orthogonal projector on what A reaches, in the units of its rows; (..., k, k)."""
        Q = self.directions * (np.arange(len(self.sizes)) < self.rank[..., None])[..., None, :]
        return np.asarray(Q @ np.swapaxes(Q, -1, -2))

    @property
    def pseudoinverse(self) -> Array:
        """That of Moore and Penrose of A M⁻¹ A', in the units of its rows; (..., k, k)."""
        half = self.range @ (self.U * self.inverse_sigma[..., None, :] / self.sizes[:, None])
        return np.asarray(half @ np.swapaxes(half, -1, -2))

    @property
    def projector(self) -> Array:
        """1 - A'(A M⁻¹ A')⁺ A M⁻¹ = L (1 - V V') L⁻¹; (..., nv, nv)."""
        free = np.eye(self.V.shape[-2]) - self.V @ np.swapaxes(self.V, -1, -2)
        return np.asarray(self.L @ np.swapaxes(np.linalg.solve(np.swapaxes(self.L, -1, -2), free), -1, -2))

    def nearest(self, v: Array, missing: Array, damped: Array | float = 1.0) -> Array:
        """v less the least in the kinetic metric that A makes ``missing`` of, its directions ``damped`` (..., m)."""
        y = self.V @ (damped * self.inverse_sigma * self._seen(missing))[..., None]
        return np.asarray(v - self._back(y))

    def constrained(self, force: Array, b: Array) -> tuple[Array, Array]:
        """q̈ and λ of M q̈ + A'λ = force, A q̈ + b = 0, λ of least norm; (..., nv), (..., k)."""
        w = np.linalg.solve(self.L, force[..., None])
        taken = (np.swapaxes(self.V, -1, -2) @ w)[..., 0] + self.inverse_sigma * self._seen(b)
        lam = (self.U @ (self.inverse_sigma * taken)[..., None])[..., 0] / self.sizes
        return self._back(w - self.V @ taken[..., None]), (self.range @ lam[..., None])[..., 0]

    def _seen(self, b: Array) -> Array:
        return np.asarray((np.swapaxes(self.U, -1, -2) @ (b / self.sizes)[..., None])[..., 0])

    def _back(self, y: Array) -> Array:
        """L⁻ᵀ y; (..., nv, 1) → (..., nv)."""
        return np.asarray(np.linalg.solve(np.swapaxes(self.L, -1, -2), y)[..., 0])


def through(A: Array, M: Array) -> Array:
    """A L⁻ᵀ with M = L L'; (..., k, nv)."""
    return _through(A, _factor(M))


def _factor(M: Array) -> Array:
    try:
        return np.linalg.cholesky(M) if M.size else M
    except np.linalg.LinAlgError:
        raise SingularMassMatrixError(
            "the mass matrix has no inverse at this configuration: some joint moves nothing with inertia there. Choose other "
            "joints where their axes coincide, or give their links mass."
        ) from None


def _through(A: Array, L: Array) -> Array:
    return np.swapaxes(np.linalg.solve(L, np.swapaxes(A, -1, -2)), -1, -2) if 0 not in A.shape[-2:] else A


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
