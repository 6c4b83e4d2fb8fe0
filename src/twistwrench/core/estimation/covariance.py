"""Covariance of weighted least squares with correlated rows: sandwich estimators and whiteness tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..typing import Array
from .least_squares import Prior

_MAX_SINGLE_CLUSTERS = 1000  # number of clusters above which neighbours are grouped
_MAX_SHARE_OF_CLUSTER = (
    1.0 - 1e-6
)  # share of an unknown determined by one cluster, above which no other cluster checks it
_MIN_FREEDOM_RATIO = 2 / 3  # minimum of a weight's degrees of freedom relative to the variance's, for small ones
_FALSE_ALARM_RATE = 1e-4  # false-alarm rate at which the tails of a sum of two estimated variances are matched
_MAX_LOGIT, _NODES, _MATCHES = 24.0, 25, 4
_MIN_FREEDOM = 2.1  # lower bound of an unknown's degrees of freedom; the mean of F is infinite at 2


def weight_freedom(freedom: Array) -> Array:
    """Degrees of freedom ν - 2 of the weights 1 / s² of variances with ν.

    E(σ² / s²) = ν / (ν - 2) for s² with ν degrees of freedom: inverses of estimated variances are biased upwards, and
    vary more than the variances. Source: Meier, "Variance of a weighted mean", Biometrics 9, 1953.
    """
    return np.maximum(freedom - 2.0, _MIN_FREEDOM_RATIO * freedom)


def variance_estimate_covariance(Q: Array, freedom: Array, groups: Array) -> Array:
    """Covariance (p, p) of whitened unknowns due to estimated variances, for orthonormal columns Q (n, 6, p).

    Σ_c (4 / (ν_c - 2)) (N_c - N_c N_c), with N_c = Σ_g q_gc q_gc' over the channels c of one variance, and ν_c its
    degrees of freedom. Source: Kenward and Roger, "Small sample inference for fixed effects from restricted maximum
    likelihood", Biometrics 53, 1997, eq. 3 with one variance for each channel. ν - 2 replaces ν, as few degrees of
    freedom make weights vary more than to first order.
    """
    freedom = weight_freedom(freedom)
    added = np.zeros((Q.shape[-1], Q.shape[-1]))
    for group in np.unique(groups):
        q = Q[:, groups == group].reshape(-1, Q.shape[-1])
        N = q.T @ q
        added += 4.0 / freedom[groups == group][0] * (N - N @ N)
    return added


def channel_covariance(Q: Array, half: Array, freedom: Array, groups: Array) -> tuple[Array, Array]:
    """Covariance (k, k) half half' and Satterthwaite's degrees of freedom (k,), for independent rows.

    ν_k = (Σ_c s_kc)² / Σ_c s_kc² / ν_c, with s_kc the part of unknown k's variance due to channel c; ``half`` (k, p)
    may have any rows.
    """
    parts = np.stack([((Q[:, c] @ half.T) ** 2).sum(axis=0) for c in range(6)], axis=1)
    grouped = np.stack([parts[:, groups == group].sum(axis=1) for group in np.unique(groups)], axis=1)
    each = np.array([freedom[groups == group][0] for group in np.unique(groups)])
    total = grouped.sum(axis=1)
    unsure = (grouped**2 / each).sum(axis=1)
    return half @ half.T, np.where(unsure > 0, total**2 / np.maximum(unsure, 1e-300), np.inf)


def f_test_freedom(freedom: Array) -> float:
    """Degrees of freedom of the F distribution of k unknowns together, from their own ν (k,).

    With E = Σ ν_k / (ν_k - 2), ν = 2 E / (E - k). Source: Fai and Cornelius, "Approximate F-tests of multiple degree of
    freedom hypotheses in generalized least squares analyses of unbalanced split-plot experiments", J. Statistical
        Computation and Simulation 54, 1996, applied to the unknowns in place of the axes of their ellipsoid (less
        exact).
    """
    excess = float((2.0 / (np.maximum(freedom, _MIN_FREEDOM) - 2.0)).sum())  # E - k
    if excess:
        return 2.0 * (len(freedom) + excess) / excess
    return np.inf


def sum_freedom(variances: Array, freedom: Array) -> Array:
    """Degrees of freedom (k,) of sums of two estimated variances (2, k) with degrees of freedom (2, k), for tests.

    Satterthwaite's formula uses the estimates, so it is too large if the uncertain part of the sum is underestimated.
    Here, Student's distribution with ν has the tails of N(0, Σ ν_i s_i² / χ²_i), fiducial in both variances, at
    probability 1e-4; between 1e-2 and 1e-6 the tails differ by less than a factor of ten. Source: Fisher, "The
    comparison of samples with possibly unequal variances", Ann. Eugenics 9, 1939.
    """
    from scipy import special

    total = variances.sum(axis=0)
    unsure = (variances**2 / np.maximum(freedom, 1.0)).sum(axis=0)
    satterthwaite = total**2 / np.maximum(unsure, 1e-300)
    uncertain = (variances > 0).all(axis=0) & np.isfinite(freedom).all(axis=0)
    if not uncertain.any():
        return satterthwaite
    logit = np.linspace(-_MAX_LOGIT, _MAX_LOGIT, _NODES)
    share = special.expit(logit)
    weight = share * (1.0 - share) * (logit[1] - logit[0])
    s, nu = variances[:, uncertain, None], np.maximum(freedom, 1.0)[:, uncertain, None]
    first, second = s * nu / (2.0 * special.gammaincinv(0.5 * nu, share))
    size = np.sqrt((first[:, :, None] + second[:, None, :]) / total[uncertain, None, None])  # (k, nodes, nodes)
    nu = satterthwaite[uncertain]
    for _ in range(_MATCHES):
        times = special.stdtrit(nu, 0.5 * _FALSE_ALARM_RATE)
        tail = special.ndtr(times[:, None, None] / size) @ weight @ weight
        nu = np.minimum(special.stdtridf(tail, times), satterthwaite[uncertain])
    satterthwaite[uncertain] = nu
    return satterthwaite


def cluster_robust_covariance(Q: Array, left: Array, half: Array, label: Array) -> tuple[Array, Array] | None:
    """CR2 sandwich covariance (k, k) and degrees of freedom (k,); None if one cluster alone determines an unknown.

    Q (n, 6, p) are the orthonormal columns of the whitened design, ``left`` (n, 6) the whitened residuals e, ``half``
    (k, p) maps whitened unknowns to k unknowns or sums of them, and ``label`` (n,) is the cluster of each row. With
    M_g = Q_g' Q_g:

    s_g = (1 - M_g)^(-1/2) Q_g' e_g,   C = half Σ_g s_g s_g' half',   ν_k = (tr Ω)² / tr Ω²,
    Ω_gh = δ_gh |M_g^(1/2) B_g l|² - (M_g B_g l) · (M_h B_h l),   B_g = (1 - M_g)^(-1/2),   l = row k of half.

    Sources: Bell and McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples",
    Survey Methodology 28, 2002; Pustejovsky and Tipton, J. Business & Economic Statistics 36, 2018.
    """
    return sandwich_covariance(*cluster_moments(lambda rows: Q[rows].reshape(-1, Q.shape[-1]), left, label), half)


def cluster_moments(columns: Callable[[Array], Array], left: Array, label: Array) -> tuple[Array, Array]:
    """Q_g'Q_g (g, p, p) and Q_g'e_g (g, p) of each cluster; ``columns`` returns all columns of Q in the given rows."""
    place = cluster_numbers(label)
    order = np.argsort(place, kind="stable")
    parts = np.split(order, np.searchsorted(place[order], np.arange(1, int(place.max()) + 1)))
    first = columns(parts[0])
    p = first.shape[1]
    M, s = np.zeros((len(parts), p, p)), np.zeros((len(parts), p))
    for g, rows in enumerate(parts):
        Q = columns(rows) if g else first
        M[g], s[g] = Q.T @ Q, Q.T @ left[rows].reshape(-1)
    return M, s


def cluster_numbers(label: Array) -> Array:
    """Cluster numbers (n,) 0, 1, … for the labels; more than a thousand clusters are grouped with neighbours."""
    numbers = np.unique(label, return_inverse=True)[1]
    if numbers.max() >= _MAX_SINGLE_CLUSTERS:
        numbers = numbers * _MAX_SINGLE_CLUSTERS // (numbers.max() + 1)
    return np.asarray(numbers)


def sandwich_covariance(M: Array, s: Array, half: Array) -> tuple[Array, Array] | None:
    """Same from sums over clusters: M (g, p, p) of Q_g' Q_g, and s (g, p) of Q_g' e_g."""
    values, U = np.linalg.eigh(M)
    if values.max() > _MAX_SHARE_OF_CLUSTER:
        return None
    B = (U / np.sqrt(1.0 - values)[:, None, :]) @ np.swapaxes(U, 1, 2)
    s = (B @ s[..., None])[..., 0]
    C = half @ (s.T @ s) @ half.T
    Bl = B @ half.T  # (G, p, k): B_g l for each unknown
    a = M @ Bl
    d = (Bl * a).sum(axis=1)  # (G, k)
    size = (a * a).sum(axis=1)
    cross = np.stack([a[:, :, k].T @ a[:, :, k] for k in range(len(half))])
    trace = d.sum(axis=0) - size.sum(axis=0)
    square = (d**2).sum(axis=0) - 2 * (d * size).sum(axis=0) + (cross**2).sum(axis=(1, 2))
    return C, trace**2 / np.maximum(square, 1e-300)


# Rows of a block of time are one cluster (Liang and Zeger, "Longitudinal data analysis using generalized linear
# models", Biometrika 73, 1986), with Bell and McCaffrey's correction for few clusters, as in the fits of sensors. The
# textbook formula s² (W'W)^-1 treats every row as a cluster, and is several times too small.
#
# An incorrect law, of friction for instance, gives residuals that depend on the state and cancel within a block of time.
# So rows in the same cell of state are also one cluster. The result takes the larger variances of both sandwiches C and
# D, with the correlations of C:
#
#     S C S,   S = diag max(1, √(D_kk / C_kk)).

_MAX_BLOCKS, _MIN_BLOCKS = 120, 15
_SECONDS = 1.0  # minimum duration of a block [s], if the logs are long enough
_LENGTHS = 10.0  # length of a block in autocorrelation lengths of the residuals
_PORTION = 1000  # rows per factorisation
_CELLS, _PARTS = 32, 8  # number of cells; and parts of each coordinate for the comparison of residuals


@dataclass(frozen=True, eq=False)
class StateCells:
    """Cells of the state space: parts of a position range, and directions of up to two joints.

    Attributes
    ----------
    position : int, index of the coordinate
    edges : (k,) array, limits between its parts
    velocities : tuple of int, indices of the joints
    """

    position: int
    edges: Array
    velocities: tuple[int, ...]

    @classmethod
    def from_residuals(cls, q: Array, dq: Array, left: Array) -> StateCells:
        """About 30 cells of the coordinates that affect residuals (n, nv) most, with equally many rows in each part.

        Coordinates are ranked by the squared mean residuals in eight parts of each.
        """
        shares = []
        for x in (*q.T, *dq.T):
            part = np.searchsorted(_edges(x, _PARTS), x)
            sums = np.stack([np.bincount(part, column, _PARTS) for column in left.T])
            shares.append(float((sums**2 / np.maximum(np.bincount(part, minlength=_PARTS), 1)).sum()))
        position = int(np.argmax(shares[: q.shape[1]]))
        velocities = np.argsort(shares[q.shape[1] :], kind="stable")[-2:].tolist()
        return cls(position, _edges(q[:, position], _CELLS >> len(velocities)), tuple(velocities))

    @property
    def count(self) -> int:
        """Number of cells."""
        return (len(self.edges) + 1) << len(self.velocities)

    def numbers(self, q: Array, dq: Array) -> Array:
        """Cell numbers (n,) of states."""
        cells = np.searchsorted(self.edges, q[:, self.position])
        for k in self.velocities:
            cells = 2 * cells + (dq[:, k] > 0)
        return cells


def _edges(x: Array, parts: int) -> Array:
    """Limits (parts - 1,) between parts with equally many values."""
    return np.asarray(np.quantile(x, np.arange(1, parts) / parts))


@dataclass(frozen=True, eq=False)
class GroupCovariance:
    """Covariance of groups of parameters.

    Attributes
    ----------
    matrix : (r, r) array
    freedom : (r,) array, degrees of freedom of each group's variance
    textbook : (r,) array, standard deviations as if every row were independent
    block : float, duration of a block [s]
    changes : (k, r) array or None, changes of the groups with omitted laws; included in the matrix
    """

    matrix: Array
    freedom: Array
    textbook: Array
    block: float
    changes: Array | None = None

    def widened(self, changes: Array) -> GroupCovariance:
        """Covariance including errors due to other laws, Σ_k δ_k δ_k'.

        Parameters
        ----------
        changes : (k, r) array, changes δ_k of the groups due to each law

        Returns
        -------
        covariance : GroupCovariance

        Examples
        --------
        >>> GroupCovariance(np.eye(1), np.ones(1), np.ones(1), 1.0).widened(np.array([[2.0]])).matrix.tolist()
        [[5.0]]
        """
        return replace(self, matrix=self.matrix + changes.T @ changes, changes=changes)

    @property
    def deviations(self) -> Array:
        """Standard deviations (r,) of the groups."""
        return np.sqrt(np.maximum(self.matrix.diagonal(), 0.0))  # rounding may make small ones negative

    def of_first(self, count: int) -> GroupCovariance:
        """Covariance of the first groups.

        Parameters
        ----------
        count : int

        Returns
        -------
        covariance : GroupCovariance

        Examples
        --------
        >>> GroupCovariance(np.eye(2), np.ones(2), np.ones(2), 1.0).of_first(1).matrix.shape
        (1, 1)
        """
        first = slice(count)
        return replace(
            self, matrix=self.matrix[first, first], freedom=self.freedom[first], textbook=self.textbook[first]
        )

    def half_width(self, level: float = 0.95) -> Array:
        """Half-widths (r,) of confidence intervals.

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
        return np.asarray(student_quantile(np.maximum(self.freedom, 1.0), level) * self.deviations)


def student_quantile(freedom: Array | float, level: float) -> Array:
    """Half-width of Student's interval, in standard deviations."""
    from scipy.special import stdtrit

    return np.asarray(stdtrit(np.minimum(freedom, 1e9), 0.5 + 0.5 * level))


def group_covariance(
    W: Array,
    tau: Array,
    x: Array,
    sigma: Array,
    weights: Array,
    prior: Prior,
    time: Array,
    log: Array,
    states: tuple[Array, Array],
    chosen: Array,
) -> GroupCovariance:
    """Covariance of a fit: W (n, nv, r), τ (n, nv), at x (r,), with residual sizes (nv,) and weights (n, nv).

    ``time`` and ``log`` (n,) belong to each row, ``states`` are its q and dq. ``chosen`` (n, nv, k) are the changes of
    the predicted torques with each setting selected on the same rows, such as the clock offset; their uncertainty is
    included.
    """
    r, residuals, root = W.shape[2], tau - W @ x, np.sqrt(weights) / sigma
    change = np.sqrt((chosen**2).mean(axis=(0, 1)))
    settings = chosen[..., change > 0] / change[change > 0]
    sizes = np.concatenate([prior.size, np.full(settings.shape[2], sigma.max() * 1e3)])

    def whitened_columns(rows: Array | slice) -> Array:
        """All columns (m nv, r + k) of the given rows."""
        A = np.concatenate([W[rows], settings[rows]], axis=2)
        A *= root[rows][..., None]
        return A.reshape(-1, len(sizes))

    cells = StateCells.from_residuals(*states, residuals * root)
    covariance = _covariance(whitened_columns, residuals * root, sizes, time, log, cells.numbers(*states))
    matrix = covariance.matrix[:r, :r] * _huber_factor(residuals, weights) ** 2
    return GroupCovariance(matrix, covariance.freedom[:r], covariance.textbook[:r], covariance.block)


def _huber_factor(residuals: Array, weights: Array) -> float:
    """Correction factor for Huber weights: mean weight over mean slope.

    Huber's residuals count with ψ(u) = w u, whose slope is 1 up to k and 0 beyond. Source: Huber, "Robust Statistics",
    1981, section 7.6.
    """
    active = (residuals != 0).any(axis=0)
    if not active.any() or (weights == 1.0).all():
        return 1.0
    return float(weights[:, active].mean() / (weights[:, active] == 1.0).mean())


def larger_covariance(first: tuple[Array, Array], second: tuple[Array, Array] | None) -> tuple[Array, Array]:
    """Covariance and degrees of freedom with the larger variances of two estimates and correlations of the first."""
    if second is None:
        return first
    (C, freedom), (D, other_freedom) = first, second
    ratio = D.diagonal() / np.maximum(C.diagonal(), 1e-300)
    factor = np.sqrt(np.maximum(ratio, 1.0))
    return C * factor[:, None] * factor, np.where(ratio > 1.0, other_freedom, freedom)


def _covariance(
    columns: Callable[[Array | slice], Array], residuals: Array, sizes: Array, time: Array, log: Array, cell: Array
) -> GroupCovariance:
    """Sandwiches of all whitened columns and residuals (n, nv), with zero-mean priors of these ``sizes``."""
    n, nv = residuals.shape
    R: Array = np.eye(len(sizes))  # R'R = 1 + A'A for columns in units of their sizes
    for begin in range(0, n, _PORTION):
        block = columns(slice(begin, begin + _PORTION)) * sizes
        R = np.asarray(np.linalg.qr(np.concatenate([R, block]), mode="r"))
    half = sizes[:, None] * np.linalg.inv(R)
    step = float(np.median(np.diff(time)[np.diff(log) == 0])) if n > 1 else 1.0
    squares, freedom = float((residuals**2).sum()), max(1, n * nv - len(sizes))
    textbook = np.sqrt(np.maximum((half @ half.T).diagonal() * squares / freedom, 0.0))
    correlation_length = autocorrelation_length(residuals)
    block_rows = max(_LENGTHS * correlation_length, _SECONDS / step)
    block_rows = float(np.clip(block_rows, n / _MAX_BLOCKS, n / _MIN_BLOCKS))

    def sandwich(clusters: Array) -> tuple[Array, Array] | None:
        return sandwich_covariance(*cluster_moments(lambda rows: columns(rows) @ half, residuals, clusters), half)

    for _ in range(8):
        blocks = np.arange(n) // max(1, math.ceil(block_rows))
        blocks += (blocks.max() + 1) * log
        by_blocks, by_cells = sandwich(blocks), sandwich(cell)
        if by_blocks is not None:
            return GroupCovariance(*larger_covariance(by_blocks, by_cells), textbook, block_rows * step)
        block_rows /= 2.0
        if block_rows < 1.0:
            break
    inflated = half @ half.T * correlation_length
    return GroupCovariance(inflated, np.full(len(sizes), 1e9), textbook, 0.0)


_MIN_CHANCE = 1e-3  # probability of a false alarm for white residuals, over all channels
_LAGS = 20  # lags of the Ljung-Box test
_MIN_ROWS_OF_LJUNG_BOX = 100  # minimum rows for the Ljung-Box test


def autocorrelation(e: Array, lags: int) -> Array:
    """Autocorrelation of a series (n,) about zero at lags 0 to ``lags``."""
    spectrum = np.fft.rfft(e, 2 * len(e))
    return np.asarray(np.fft.irfft(spectrum * spectrum.conj())[: lags + 1] / max(float(e @ e), 1e-300))


def autocorrelation_length(residuals: Array) -> float:
    """Integrated autocorrelation time of residuals (n, nv) in rows, 1 + 2 Σ ρ above the noise; largest of joints."""
    n, longest = len(residuals), 1.0
    lags = min(n // 4, 400)
    for column in residuals.T:
        rho = autocorrelation(column - column.mean(), lags)
        below = np.flatnonzero(rho < 2.0 / math.sqrt(n))
        stop = int(below[0]) if below.size else lags
        longest = max(longest, 1.0 + 2.0 * float(rho[1:stop].sum()))
    return longest


@dataclass(frozen=True)
class Whiteness:
    """Whiteness of residuals: test result of the least white channel."""

    axis: str
    lag1: float  # autocorrelation of neighbouring rows
    chance: float  # p-value over all channels
    length: int  # correlation length of the residuals in rows; 1 if they are white
    test: str

    @property
    def white(self) -> bool:
        """True if noise alone may be the cause."""
        return self.chance > _MIN_CHANCE

    @classmethod
    def from_residuals(cls, e: Array, Q: Array, names: Sequence[str]) -> Whiteness:
        """Test whitened residuals e (n, c) of a fit with the orthonormal columns Q (n, c, p).

        The statistic of each channel c is e_c' D e_c, with D the mean of the two shifts by one row: the numerator of
        the lag-1 autocorrelation, as in the Durbin-Watson test. Under white noise its mean is -tr Q_c' D Q_c and its
        variance 2 (tr D² - 2 tr Q_c' D² Q_c + tr (Q_c' D Q_c)²). From 100 rows on, the Ljung-Box test of 20 lags is
        added. Sources: Durbin and Watson, Biometrika 37, 1950; Ljung and Box, Biometrika 65, 1978.
        """
        from scipy import special

        n, channels = len(e), list[Whiteness]()
        for axis, q, r in zip(names, np.moveaxis(Q, 1, 0), e.T, strict=True):
            squares = max(float(r @ r), 1e-300)
            variance = squares / max(n - float((q * q).sum()), 1.0)
            Dq, product = _neighbours(q), float(r @ _neighbours(r))
            mean = -float((q * Dq).sum())
            spread = 2.0 * (0.5 * (n - 1) - 2.0 * float((Dq * Dq).sum()) + float(((q.T @ Dq) ** 2).sum()))
            z = (product / variance - mean) / np.sqrt(max(spread, 1e-12))
            tests = [(float(special.ndtr(-z)), "lag-1 autocorrelation")]
            if n >= _MIN_ROWS_OF_LJUNG_BOX:
                rho = autocorrelation(r, _LAGS)[1:]
                box = n * (n + 2) * float((rho**2 / (n - np.arange(1, _LAGS + 1))).sum())
                tests.append((float(special.chdtrc(_LAGS, box)), "Ljung-Box of 20 lags"))
            chance, test = min(tests)
            chance = min(len(names) * len(tests) * chance, 1.0)
            channels.append(cls(axis, product / squares, chance, 1, test))
        least_white = min(channels, key=lambda channel: channel.chance)
        if least_white.white:
            return least_white
        return replace(least_white, length=_correlated_rows(e))


def _neighbours(x: Array) -> Array:
    """D x: mean of the neighbouring rows."""
    out = np.zeros_like(x)
    out[1:] += 0.5 * x[:-1]
    out[:-1] += 0.5 * x[1:]
    return out


def _correlated_rows(e: Array) -> int:
    """Twice the lag at which the largest autocorrelation first falls into the noise, at most a tenth of the rows."""
    n = len(e)
    max_lag = max(2, n // 10)
    largest = np.max([autocorrelation(column, min(max_lag, n - 2))[1:] for column in e.T], axis=0)
    noise_lags = np.flatnonzero(largest < 2.0 / np.sqrt(n))
    if noise_lags.size:
        return int(min(2 * (int(noise_lags[0]) + 1), max_lag))
    return max_lag
