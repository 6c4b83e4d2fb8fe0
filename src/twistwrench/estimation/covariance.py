"""Covariance of weighted least squares with correlated rows: sandwich estimates over clusters and over blocks of time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .least_squares import Prior

_MANY = 1000  # clusters; more are told in groups of neighbours
_WHOLE = 1.0 - 1e-6  # share of an unknown that one cluster tells; from there on nothing checks it
_LEAST_KNOWN = 2 / 3  # of its degrees of freedom, what a weight counts with at least; else two or three say nothing
_RATE = 1e-4  # of false alarms, at which tails of a sum of two estimated variances are matched
_WIDEST, _NODES, _MATCHES = 24.0, 25, 4
_LEAST_FREEDOM = 2.1  # of an unknown in a block; the mean of F has no value at 2


def as_weights(freedom: Array) -> Array:
    """Degrees of freedom of variances, as those of the weights 1 / s² made from them: ν - 2.

    E(σ² / s²) = ν / (ν - 2) for s² of ν degrees of freedom: inverses of estimated variances are too large in the mean, and
    vary more than the variances. Source: Meier, "Variance of a weighted mean", Biometrics 9, 1953.
    """
    return np.maximum(freedom - 2.0, _LEAST_KNOWN * freedom)


def plug_in(Q: Array, freedom: Array, groups: Array) -> Array:
    """Covariance (p, p) of whitened unknowns that estimated variances add, for orthonormal columns Q (n, 6, p).

    With N_c = Σ_g q_gc q_gc' the share of the channels c of one variance, and ν_c its degrees of freedom,
    Σ_c (4 / (ν_c - 2)) (N_c - N_c N_c). Source: Kenward and Roger, "Small sample inference for fixed effects from
    restricted maximum likelihood", Biometrics 53, 1997, eq. 3 with one variance for each channel, and ν - 2 for ν since
    few degrees of freedom make weights vary more than to first order.
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
    Computation and Simulation 54, 1996, with the unknowns in place of axes of their ellipsoid, which is less exact.
    """
    more = float((2.0 / (np.maximum(freedom, _LEAST_FREEDOM) - 2.0)).sum())  # E - k
    return 2.0 * (len(freedom) + more) / more if more else np.inf


def sum_freedom(variances: Array, freedom: Array) -> Array:
    """Degrees of freedom (k,) of sums of two estimated variances (2, k), of ``freedom`` (2, k) each, as tests need them.

    Satterthwaite's number comes from the estimates themselves, so it is too large just where the uncertain part of the sum
    is underestimated. Instead Student's distribution with ν has the tails of N(0, Σ ν_i s_i² / χ²_i), fiducial in both
    variances, where they hold 1e-4; at other rates from 1e-2 to 1e-6 they differ by less than ten times.
    Source: Fisher, "The comparison of samples with possibly unequal variances", Ann. Eugenics 9, 1939.
    """
    from scipy import special

    total = variances.sum(axis=0)
    unsure = (variances**2 / np.maximum(freedom, 1.0)).sum(axis=0)
    found = total**2 / np.maximum(unsure, 1e-300)
    both = (variances > 0).all(axis=0) & np.isfinite(freedom).all(axis=0)
    if not both.any():
        return found
    logit = np.linspace(-_WIDEST, _WIDEST, _NODES)
    share = special.expit(logit)
    weight = share * (1.0 - share) * (logit[1] - logit[0])
    first, second = (
        s[both, None] * nu[both, None] / (2.0 * special.gammaincinv(0.5 * nu[both, None], share))
        for s, nu in zip(variances, np.maximum(freedom, 1.0), strict=True)
    )
    size = np.sqrt((first[:, :, None] + second[:, None, :]) / total[both, None, None])  # (k, nodes, nodes)
    nu = found[both]
    for _ in range(_MATCHES):
        times = special.stdtrit(nu, 0.5 * _RATE)
        tail = special.ndtr(times[:, None, None] / size) @ weight @ weight
        nu = np.minimum(special.stdtridf(tail, times), found[both])
    found[both] = nu
    return found


def by_clusters(Q: Array, left: Array, half: Array, label: Array) -> tuple[Array, Array] | None:
    """Covariance (k, k) by the sandwich CR2 and degrees of freedom (k,); None if one cluster alone determines an unknown.

    Q (n, 6, p) are the orthonormal columns of the whitened design, ``left`` (n, 6) the whitened residuals e, half (k, p)
    takes whitened unknowns to k unknowns or sums of them, label (n,) is the cluster of each row. With
    M_g = Q_g' Q_g:

    s_g = (1 - M_g)^(-1/2) Q_g' e_g,   C = half Σ_g s_g s_g' half',   ν_k = (tr Ω)² / tr Ω²,
    Ω_gh = δ_gh |M_g^(1/2) B_g l|² - (M_g B_g l) · (M_h B_h l),   B_g = (1 - M_g)^(-1/2),   l = row k of half.

    Sources: Bell and McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples",
    Survey Methodology 28, 2002; Pustejovsky and Tipton, J. Business & Economic Statistics 36, 2018.
    """
    p = Q.shape[-1]
    place = cluster_numbers(label)
    count = int(place.max()) + 1
    M, s = np.zeros((count, p, p)), np.zeros((count, p))
    order = np.argsort(place, kind="stable")
    starts = np.searchsorted(place[order], np.arange(count))
    np.add.reduceat(np.einsum("gc,gcp->gp", left, Q)[order], starts, axis=0, out=s)
    for g, (a, b) in enumerate(zip(starts, [*starts[1:], len(order)], strict=True)):
        q = Q[order[a:b]].reshape(-1, p)
        M[g] = q.T @ q
    return by_moments(M, s, half)


def cluster_numbers(label: Array) -> Array:
    """(n,) numbers 0, 1, … of the clusters with these labels; of more than a thousand, neighbours are one."""
    place = np.unique(label, return_inverse=True)[1]
    return np.asarray(place * _MANY // (place.max() + 1) if place.max() >= _MANY else place)


def by_moments(M: Array, s: Array, half: Array) -> tuple[Array, Array] | None:
    """The same of what clusters add up to: M (g, p, p) of Q_g' Q_g, and s (g, p) of Q_g' e_g."""
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


# ── Covariance of groups of parameters: the sandwich over blocks of time

# Rows of a block of time count as one cluster (Liang and Zeger, "Longitudinal data analysis using generalized linear models",
# Biometrika 73, 1986), with the correction for few clusters of Bell and McCaffrey that the sensors' fits have as well. The
# textbook's s² (W'W)^-1 takes every row for a cluster, and is several times too small.

_MOST_BLOCKS, _FEWEST_BLOCKS = 120, 15
_SECONDS = 1.0
"""s, that a block lasts at least, where the logs have enough of them."""
_LENGTHS = 10.0
"""Length of a block, in autocorrelation lengths of the residuals."""
_PORTION = 1000
"""Rows that are factored at a time."""


@dataclass(frozen=True, eq=False)
class GroupCovariance:
    """Covariance of the groups.

    Attributes
    ----------
    matrix : (r, r) array
    freedom : (r,) array, degrees of freedom of each group's variance
    textbook : (r,) array, standard deviations as if every row were independent
    block : float, how long a block is [s]
    """

    matrix: Array
    freedom: Array
    textbook: Array
    block: float

    @property
    def deviations(self) -> Array:
        """(r,) standard deviations."""
        return np.sqrt(np.maximum(self.matrix.diagonal(), 0.0))  # of what is known, rounding is left

    def half_width(self, level: float = 0.95) -> Array:
        """(r,) half the width of intervals that hold the truth with that chance.

        Parameters
        ----------
        level : float

        Returns
        -------
        width : (r,) array

        Examples
        --------
        >>> GroupCovariance(np.eye(1), np.array([1e9]), np.ones(1), 1.0).half_width().round(2).tolist()
        [1.96]
        """
        from scipy.special import stdtrit

        return np.asarray(stdtrit(np.maximum(self.freedom, 1.0), 0.5 + 0.5 * level) * self.deviations)


def group_covariance(
    W: Array,
    tau: Array,
    x: Array,
    sigma: Array,
    weights: Array,
    prior: Prior,
    time: Array,
    log: Array,
    chosen: Array,
) -> GroupCovariance:
    """Covariance of a fit: W (n, nv, r), τ (n, nv), at x (r,), with its residuals' sizes (nv,) and weights (n, nv).

    ``time`` and ``log`` (n,) are those of each row. ``chosen`` (n, nv, k) are the changes of the predicted torques with each
    setting that was chosen on the same rows, such as the offset of the clock: the fit is not surer than they are.
    """
    groups = W.shape[2]
    left = tau - W @ x
    size = np.sqrt((chosen**2).mean(axis=(0, 1)))
    rows = _WhitenedRows(W, chosen[..., size > 0] / size[size > 0], np.sqrt(weights) / sigma)
    prior = Prior(np.zeros(rows.count), np.concatenate([prior.size, np.full(int((size > 0).sum()), sigma.max() * 1e3)]))
    found = _covariance(rows, left * rows.root, prior, time, log)
    matrix = found.matrix[:groups, :groups] * _huber_factor(left, weights) ** 2
    return GroupCovariance(matrix, found.freedom[:groups], found.textbook[:groups], found.block)


@dataclass(frozen=True, eq=False)
class _WhitenedRows:
    """Columns W (n, nv, r) and beside them others (n, nv, k), times the roots (n, nv) of their weights: some rows at a time."""

    W: Array
    beside: Array
    root: Array

    @property
    def count(self) -> int:
        """Number of all columns."""
        return int(self.W.shape[2] + self.beside.shape[2])

    def of(self, rows: Array | slice) -> Array:
        """(m nv, r + k) of some of the rows."""
        A = np.concatenate([self.W[rows], self.beside[rows]], axis=2)
        A *= self.root[rows][..., None]
        return A.reshape(-1, self.count)

    def factor(self, size: Array) -> Array:
        """R (r + k, r + k) with R'R = 1 + A'A of the columns in units of their sizes: of the rows so far and the next ones."""
        R: Array = np.eye(self.count)
        for begin in range(0, len(self.W), _PORTION):
            more = self.of(slice(begin, begin + _PORTION)) * size
            R = np.asarray(np.linalg.qr(np.concatenate([R, more]), mode="r"))
        return R

    def moments(self, left: Array, half: Array, label: Array) -> tuple[Array, Array]:
        """Q_g'Q_g (g, r + k, r + k) and Q_g'e_g (g, r + k) of each cluster, Q = A half and e (n, nv) the residuals."""
        place = cluster_numbers(label)
        order = np.argsort(place, kind="stable")
        parts = np.split(order, np.searchsorted(place[order], np.arange(1, int(place.max()) + 1)))
        M, s = np.zeros((len(parts), self.count, self.count)), np.zeros((len(parts), self.count))
        for g, rows in enumerate(parts):
            Q = self.of(rows) @ half
            M[g], s[g] = Q.T @ Q, Q.T @ left[rows].reshape(-1)
        return M, s


def _huber_factor(left: Array, weights: Array) -> float:
    """Factor by which weights of large residuals make the equations seem too steep: mean weight over mean slope.

    Huber's residuals count with ψ(u) = w u, whose slope is 1 up to k and 0 beyond. Source: Huber, "Robust Statistics", 1981,
    section 7.6.
    """
    live = (left != 0).any(axis=0)
    if not live.any() or (weights == 1.0).all():
        return 1.0
    return float(weights[:, live].mean() / (weights[:, live] == 1.0).mean())


def _covariance(rows: _WhitenedRows, left: Array, prior: Prior, time: Array, log: Array) -> GroupCovariance:
    """The sandwich of all columns, ``left`` (n, nv) the whitened residuals."""
    (n, nv), r = left.shape, rows.count
    half = prior.size[:, None] * np.linalg.inv(rows.factor(prior.size))
    step = float(np.median(np.diff(time)[np.diff(log) == 0])) if n > 1 else 1.0
    textbook = np.sqrt(np.maximum(((half @ half.T).diagonal()) * float((left**2).sum()) / max(1, n * nv - r), 0.0))
    apart = max(_LENGTHS * autocorrelation_length(left), _SECONDS / step)
    apart = float(np.clip(apart, n / _MOST_BLOCKS, n / _FEWEST_BLOCKS))
    for _ in range(8):
        label = np.arange(n) // max(1, math.ceil(apart))
        found = by_moments(*rows.moments(left, half, label + (label.max() + 1) * log), half)
        if found is not None:
            matrix, freedom = found
            return GroupCovariance(matrix, freedom, textbook, apart * step)
        apart /= 2.0
        if apart < 1.0:
            break
    inflated = half @ half.T * autocorrelation_length(left)
    return GroupCovariance(inflated, np.full(r, 1e9), textbook, 0.0)


def autocorrelation_length(left: Array) -> float:
    """Integrated autocorrelation time of residuals (n, nv) in rows: 1 + 2 Σ ρ until ρ is lost in noise; the largest joint's."""
    n = len(left)
    lags = min(n // 4, 400)
    longest = 1.0
    for column in left.T:
        e = column - column.mean()
        size = float(e @ e)
        if size <= 0:
            continue
        spectrum = np.fft.rfft(e, 2 * n)
        rho = np.fft.irfft(spectrum * spectrum.conj())[: lags + 1] / size
        below = np.flatnonzero(rho < 2.0 / math.sqrt(n))
        stop = int(below[0]) if below.size else lags
        longest = max(longest, 1.0 + 2.0 * float(rho[1:stop].sum()))
    return longest
