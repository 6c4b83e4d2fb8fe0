"""Covariance of weighted least squares whose rows come in witnesses: the sandwich, corrected for few witnesses."""

from __future__ import annotations

import numpy as np

from ..typing import Array

_MANY = 1000  # witnesses; more are told in groups of neighbours
_WHOLE = 1.0 - 1e-6  # share of an unknown that one witness tells; from there on nothing checks it
_LEAST_KNOWN = 2 / 3  # of its degrees of freedom, what a weight counts with at least; else two or three say nothing
_LEAST_FREEDOM = 2.1  # of an unknown in a block; the mean of F has no value at 2


def as_weights(freedom: Array) -> Array:
    """Degrees of freedom of variances, as those of the weights 1 / s² made from them: ν - 2.

    E(σ² / s²) = ν / (ν - 2) for s² of ν degrees of freedom: inverses of estimated variances are too large in the mean, and
    vary more than the variances. Source: Meier, "Variance of a weighted mean", Biometrics 9, 1953.
    """
    return np.maximum(freedom - 2.0, _LEAST_KNOWN * freedom)


def plug_in(Q: Array, freedom: Array, groups: Array) -> Array:
    """What estimated variances add to the covariance (p, p) of whitened unknowns, of orthonormal columns Q (n, 6, p).

    With N_c = Σ_g q_gc q_gc' the share of the channels c of one variance, and ν_c its degrees of freedom,
    Σ_c (4 / (ν_c - 2)) (N_c - N_c N_c). Source: Kenward and Roger, "Small sample inference for fixed effects from
    restricted maximum likelihood", Biometrics 53, 1997, eq. 3 with one variance for each channel, and ν - 2 for ν since
    few degrees of freedom make weights vary more than the first order says.
    """
    freedom = as_weights(freedom)
    added = np.zeros((Q.shape[-1], Q.shape[-1]))
    for group in np.unique(groups):
        q = Q[:, groups == group].reshape(-1, Q.shape[-1])
        N = q.T @ q
        added += 4.0 / freedom[groups == group][0] * (N - N @ N)
    return added


def by_channels(Q: Array, half: Array, freedom: Array, groups: Array) -> tuple[Array, Array]:
    """Covariance (k, k) half half' and degrees of freedom (k,) by Satterthwaite, where all rows are independent.

    ν_k = (Σ_c s_kc)² / Σ_c s_kc² / ν_c with s_kc the part of unknown k's variance that channel c brings; ``half`` (k, p)
    may have any rows.
    """
    parts = np.stack([((Q[:, c] @ half.T) ** 2).sum(axis=0) for c in range(6)], axis=1)
    grouped = np.stack([parts[:, groups == group].sum(axis=1) for group in np.unique(groups)], axis=1)
    each = np.array([freedom[groups == group][0] for group in np.unique(groups)])
    total = grouped.sum(axis=1)
    unsure = (grouped**2 / each).sum(axis=1)
    return half @ half.T, np.where(unsure > 0, total**2 / np.maximum(unsure, 1e-300), np.inf)


def of_block(freedom: Array) -> float:
    """Degrees of freedom of the F distribution of k unknowns together, from their own ν (k,).

    With E = Σ ν_k / (ν_k - 2), ν = 2 E / (E - k). Source: Fai and Cornelius, "Approximate F-tests of multiple degree of
    freedom hypotheses in generalized least squares analyses of unbalanced split-plot experiments", J. Statistical
    Computation and Simulation 54, 1996, with the unknowns in place of axes of their ellipsoid, which tells less.
    """
    more = float((2.0 / (np.maximum(freedom, _LEAST_FREEDOM) - 2.0)).sum())  # E - k
    return 2.0 * (len(freedom) + more) / more if more else np.inf


def by_witnesses(Q: Array, left: Array, half: Array, label: Array) -> tuple[Array, Array] | None:
    """Covariance (k, k) by the sandwich CR2 and degrees of freedom (k,); None where one witness alone tells something.

    Q (n, 6, p) are the orthonormal columns of the whitened design, ``left`` (n, 6) the whitened residuals e, half (k, p)
    takes whitened unknowns to k unknowns or sums of them, label (n,) says to which witness a row belongs. With
    M_g = Q_g' Q_g:

    s_g = (1 - M_g)^(-1/2) Q_g' e_g,   C = half Σ_g s_g s_g' half',   ν_k = (tr Ω)² / tr Ω²,
    Ω_gh = δ_gh |M_g^(1/2) B_g l|² - (M_g B_g l) · (M_h B_h l),   B_g = (1 - M_g)^(-1/2),   l = row k of half.

    Sources: Bell and McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples",
    Survey Methodology 28, 2002; Pustejovsky and Tipton, J. Business & Economic Statistics 36, 2018.
    """
    p = Q.shape[-1]
    place = witnesses(label)
    count = int(place.max()) + 1
    M, s = np.zeros((count, p, p)), np.zeros((count, p))
    order = np.argsort(place, kind="stable")
    starts = np.searchsorted(place[order], np.arange(count))
    np.add.reduceat(np.einsum("gc,gcp->gp", left, Q)[order], starts, axis=0, out=s)
    for g, (a, b) in enumerate(zip(starts, [*starts[1:], len(order)], strict=True)):
        q = Q[order[a:b]].reshape(-1, p)
        M[g] = q.T @ q
    return by_moments(M, s, half)


def witnesses(label: Array) -> Array:
    """(n,) numbers 0, 1, … of the witnesses with these labels; of more than a thousand, neighbours are one."""
    place = np.unique(label, return_inverse=True)[1]
    return np.asarray(place * _MANY // (place.max() + 1) if place.max() >= _MANY else place)


def by_moments(M: Array, s: Array, half: Array) -> tuple[Array, Array] | None:
    """The same of what witnesses add up to: M (g, p, p) of Q_g' Q_g, and s (g, p) of Q_g' e_g."""
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
    cross = np.stack([a[:, :, k].T @ a[:, :, k] for k in range(len(half))])
    trace = d.sum(axis=0) - size.sum(axis=0)
    square = (d**2).sum(axis=0) - 2 * (d * size).sum(axis=0) + (cross**2).sum(axis=(1, 2))
    return C, trace**2 / np.maximum(square, 1e-300)
