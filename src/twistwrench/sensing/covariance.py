"""Covariance of weighted least squares whose rows come in witnesses: the sandwich, corrected for few witnesses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

__all__ = ["by_channels", "by_witnesses", "plug_in"]

_MANY = 1000  # witnesses; more are told in groups of neighbours
_WHOLE = 1.0 - 1e-6  # share of an unknown that one witness tells; from there on nothing checks it


def plug_in(Q: Array, freedom: Array, groups: Array) -> Array:
    """What estimated variances add to the covariance (p, p) of whitened unknowns, of orthonormal columns Q (n, 6, p).

    With N_c = Σ_g q_gc q_gc' the share of the channels c of one variance, and ν_c its degrees of freedom,
    Σ_c (4 / ν_c) (N_c - N_c N_c). Source: Kenward and Roger, "Small sample inference for fixed effects from restricted
    maximum likelihood", Biometrics 53, 1997, eq. 3 with one variance for each channel.
    """
    added = np.zeros((Q.shape[-1], Q.shape[-1]))
    for group in np.unique(groups):
        q = Q[:, groups == group].reshape(-1, Q.shape[-1])
        N = q.T @ q
        added += 4.0 / freedom[groups == group][0] * (N - N @ N)
    return added


def by_channels(Q: Array, half: Array, freedom: Array, groups: Array) -> tuple[Array, Array]:
    """Covariance (p, p) half half' and degrees of freedom (p,) by Satterthwaite, where all rows are independent.

    ν_k = (Σ_c s_kc)² / Σ_c s_kc² / ν_c with s_kc the part of unknown k's variance that channel c brings.
    """
    parts = np.stack([((Q[:, c] @ half.T) ** 2).sum(axis=0) for c in range(6)], axis=1)
    grouped = np.stack([parts[:, groups == group].sum(axis=1) for group in np.unique(groups)], axis=1)
    each = np.array([freedom[groups == group][0] for group in np.unique(groups)])
    total = grouped.sum(axis=1)
    unsure = (grouped**2 / each).sum(axis=1)
    return half @ half.T, np.where(unsure > 0, total**2 / np.maximum(unsure, 1e-300), np.inf)


def by_witnesses(Q: Array, left: Array, half: Array, label: Array) -> tuple[Array, Array] | None:
    """Covariance (p, p) by the sandwich CR2 and degrees of freedom (p,); None where one witness alone tells something.

    Q (n, 6, p) are the orthonormal columns of the whitened design, ``left`` (n, 6) the whitened residuals e, half (p, p)
    takes whitened unknowns to unknowns, label (n,) says to which witness a row belongs. With M_g = Q_g' Q_g:

    s_g = (1 - M_g)^(-1/2) Q_g' e_g,   C = half Σ_g s_g s_g' half',   ν_k = (tr Ω)² / tr Ω²,
    Ω_gh = δ_gh |M_g^(1/2) B_g l|² - (M_g B_g l) · (M_h B_h l),   B_g = (1 - M_g)^(-1/2),   l = row k of half.

    Sources: Bell and McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples",
    Survey Methodology 28, 2002; Pustejovsky and Tipton, J. Business & Economic Statistics 36, 2018.
    """
    p = Q.shape[-1]
    place = np.unique(label, return_inverse=True)[1]
    if place.max() >= _MANY:
        place = place * _MANY // (place.max() + 1)
    count = int(place.max()) + 1
    M, s = np.zeros((count, p, p)), np.zeros((count, p))
    order = np.argsort(place, kind="stable")
    starts = np.searchsorted(place[order], np.arange(count))
    np.add.reduceat(np.einsum("gc,gcp->gp", left, Q)[order], starts, axis=0, out=s)
    for g, (a, b) in enumerate(zip(starts, [*starts[1:], len(order)], strict=True)):
        q = Q[order[a:b]].reshape(-1, p)
        M[g] = q.T @ q
    values, U = np.linalg.eigh(M)
    if values.max() > _WHOLE:
        return None
    B = (U / np.sqrt(1.0 - values)[:, None, :]) @ np.swapaxes(U, 1, 2)
    s = (B @ s[..., None])[..., 0]
    C = half @ (s.T @ s) @ half.T
    Bl = B @ half.T  # (G, p, k): B_g l for every unknown
    a = M @ Bl
    d = (Bl * a).sum(axis=1)  # (G, k)
    size = (a * a).sum(axis=1)
    cross = np.stack([a[:, :, k].T @ a[:, :, k] for k in range(p)])
    trace = d.sum(axis=0) - size.sum(axis=0)
    square = (d**2).sum(axis=0) - 2 * (d * size).sum(axis=0) + (cross**2).sum(axis=(1, 2))
    return C, trace**2 / np.maximum(square, 1e-300)
