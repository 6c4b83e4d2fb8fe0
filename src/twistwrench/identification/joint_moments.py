"""Sums over rows: of each joint the products of its entries and torques, in blocks of time; and their triangular factors.

With A_j = (W_j, τ_j) and weights w, a block has Σ A_j' A_j and Σ A_j' w A_j, the lower triangles in a row of numbers, and all
rows together R_j with R_j' R_j = Σ A_j' w A_j by orthogonal transformations (TSQR: Demmel, Grigori, Hoemmen and Langou,
"Communication-optimal parallel and sequential QR and LU factorizations", SIAM J. Sci. Comput. 34, 2012), which lose no digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .normal_equations import NormalEquations
from .streamed_rows import JointRows, RowFrame
from .weights import HUBER

MOST_BLOCKS = 60
"""Of time; beyond, the two neighbours with fewest rows become one."""


@dataclass(frozen=True, eq=False)
class JointMoments:
    """Sums over some rows.

    Attributes
    ----------
    sums : (b, 2, f) array, of each block the plain and the weighted sums
    counts : (b, 3) array, rows; weights, and rows of whole weight, of all live joints
    factors : tuple of (r_j + 1, r_j + 1) arrays, R_j
    """

    sums: Array
    counts: Array
    factors: tuple[Array, ...]

    @classmethod
    def none(cls, frame: RowFrame, blocks: int) -> JointMoments:
        """Of no rows yet, in so many blocks."""
        widths = [len(felt) + 1 for felt in frame.felt]
        size = sum(w * (w + 1) // 2 for w in widths)
        return cls(np.zeros((blocks, 2, size)), np.zeros((blocks, 3)), tuple(np.zeros((w, w)) for w in widths))

    def added(self, frame: RowFrame, rows: JointRows, block: Array) -> JointMoments:
        """With the rows of one portion, each in its ``block`` (n,); sums and counts are changed in place."""
        factors, at = [], 0
        for j, A in enumerate(rows.entries):
            weights = _weights(frame, j, A)
            root = np.sqrt(weights)[:, None]
            corner = np.tril_indices(A.shape[1])
            place = slice(at, at + len(corner[0]))
            at = place.stop
            for b in np.unique(block).tolist():
                mine = A[block == b]
                heavy = mine * root[block == b]
                self.sums[b, 0, place] += (mine.T @ mine)[corner]
                self.sums[b, 1, place] += (heavy.T @ heavy)[corner]
                if not frame.dead[j]:
                    self.counts[b, 1:] += weights[block == b].sum(), (weights[block == b] == 1.0).sum()
            factors.append(_factor(self.factors[j], A * root))
        self.counts[:, 0] += np.bincount(block, minlength=len(self.counts))
        return JointMoments(self.sums, self.counts, tuple(factors))

    def __add__(self, other: JointMoments) -> JointMoments:
        """Blocks one after another, at most :data:`MOST_BLOCKS` of them."""
        sums, counts = np.concatenate([self.sums, other.sums]), np.concatenate([self.counts, other.counts])
        some = counts[:, 0] > 0
        sums, counts = sums[some], counts[some]
        while len(counts) > MOST_BLOCKS:
            k = int(np.argmin(counts[:-1, 0] + counts[1:, 0]))
            sums[k] += sums[k + 1]
            counts[k] += counts[k + 1]
            sums, counts = np.delete(sums, k + 1, axis=0), np.delete(counts, k + 1, axis=0)
        pairs = zip(self.factors, other.factors, strict=True)
        return JointMoments(sums, counts, tuple(_factor(a, b) for a, b in pairs))

    def equations(self, frame: RowFrame, which: int, blocks: slice | Sequence[int] | Array) -> NormalEquations:
        """Normal equations of some blocks together: plain ones (0), or weighted (1)."""
        nv, width = len(frame.felt), frame.base.count + frame.extra
        sums, rows = self.sums[blocks, which].sum(axis=0), self.counts[blocks, 0].sum()
        N, c, y, at = np.zeros((nv, width, width)), np.zeros((nv, width)), np.zeros(nv), 0
        for j, felt in enumerate(frame.felt):
            w = len(felt) + 1
            G, corner = np.zeros((w, w)), np.tril_indices(w)
            G[corner] = sums[at : at + len(corner[0])]
            at += len(corner[0])
            G = np.tril(G) + np.tril(G, -1).T
            N[j][np.ix_(felt, felt)], c[j, felt], y[j] = G[:-1, :-1], G[:-1, -1], G[-1, -1]
        return NormalEquations(N, c, y, float(rows))


def _weights(frame: RowFrame, j: int, A: Array) -> Array:
    """Huber's, by the residuals of the groups that an excerpt gave."""
    if not frame.robust or frame.dead[j]:
        return np.ones(len(A))
    groups = frame.columns.groups[j]
    left = np.abs(A[:, -1] - A[:, : len(groups)] @ frame.x[groups]) / frame.sigma[j]
    return np.asarray(np.minimum(1.0, HUBER / np.maximum(left, 1e-300)))


def _factor(above: Array, below: Array) -> Array:
    """R of both one above the other."""
    return np.asarray(np.linalg.qr(np.concatenate([above, below]), mode="r"))
