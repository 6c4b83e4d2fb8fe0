"""Covariance of weighted least squares with correlated rows: sandwich estimators and whiteness tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..typing import Array
from .least_squares import Prior

_MAX_SINGLE_CLUSTERS = 1000
"""Number of clusters above which neighbours are grouped."""
_MAX_SHARE_OF_CLUSTER = 1.0 - 1e-6
"""Share of an unknown that one cluster determines, above which no other cluster checks it."""
_MIN_FREEDOM_RATIO = 2 / 3
"""Smallest ratio of a weight's degrees of freedom to those of the variance."""
_FALSE_ALARM_RATE = 1e-4
"""False-alarm rate at which the tails of a sum of two estimated variances are matched."""
_MAX_LOGIT = 24.0
"""Largest logit of a probability in the integral over two variances."""
_NODE_COUNT = 25
"""Number of nodes of the integral, in each variance."""
_MATCHING_STEPS = 4
"""Number of fixed-point iterations of the match of tails."""
_MIN_FREEDOM = 2.1
"""Lower bound of an unknown's degrees of freedom; the mean of F is infinite at 2."""
_MIN_DIVISOR = 1e-300
"""Divisor in place of zero."""


def weight_freedom(freedom: Array) -> Array:
    """Degrees of freedom ν - 2 of weights 1 / s², for estimated variances s² with ν degrees of freedom.

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
    covariance = np.zeros((Q.shape[-1], Q.shape[-1]))
    for group in np.unique(groups):  # channels with one variance, and so one freedom
        in_group = groups == group
        q = Q[:, in_group].reshape(-1, Q.shape[-1])
        N = q.T @ q
        covariance += 4.0 / freedom[in_group][0] * (N - N @ N)
    return covariance


def channel_covariance(Q: Array, half: Array, freedom: Array, groups: Array) -> tuple[Array, Array]:
    """Covariance (k, k) half half' and Satterthwaite's degrees of freedom (k,), for independent rows.

    ν_k = (Σ_c s_kc)² / Σ_c s_kc² / ν_c, with s_kc the part of unknown k's variance due to channel c. Channels of a group have
    one variance and count as one. ``half`` (k, p) maps whitened unknowns to unknowns: it is a square root of the covariance.
    """
    channel_variances = [((Q[:, c] @ half.T) ** 2).sum(axis=0) for c in range(6)]  # moments, then forces
    variance_by_channel = np.stack(channel_variances, axis=1)
    group_variances: list[Array] = []
    group_freedom: list[float] = []
    for group in np.unique(groups):
        in_group = groups == group
        group_variances.append(variance_by_channel[:, in_group].sum(axis=1))
        group_freedom.append(freedom[in_group][0])
    variance_by_group = np.stack(group_variances, axis=1)
    total = variance_by_group.sum(axis=1)
    denominator = (variance_by_group**2 / np.array(group_freedom)).sum(axis=1)
    satterthwaite = total**2 / np.maximum(denominator, _MIN_DIVISOR)
    return half @ half.T, np.where(denominator > 0, satterthwaite, np.inf)


def f_test_freedom(freedom: Array) -> float:
    """Degrees of freedom of the F distribution of k unknowns together, from their own ν (k,).

    With E = Σ ν_k / (ν_k - 2), ν = 2 E / (E - k). Source: Fai and Cornelius, "Approximate F-tests of multiple degree of
    freedom hypotheses in generalized least squares analyses of unbalanced split-plot experiments", J. Statistical
    Computation and Simulation 54, 1996. Here it is applied to the unknowns in place of the axes of their ellipsoid, which is
    less exact.
    """
    excess = float((2.0 / (np.maximum(freedom, _MIN_FREEDOM) - 2.0)).sum())  # E - k
    if excess == 0.0:
        return np.inf
    return 2.0 * (len(freedom) + excess) / excess  # E = k + excess


def sum_freedom(variances: Array, freedom: Array) -> Array:
    """Degrees of freedom (k,) of sums of two estimated variances (2, k) with degrees of freedom (2, k), for tests.

    Satterthwaite's formula uses the estimated variances. It is too large if the less certain one is estimated too small.
    Here, Student's distribution with ν has the tails of N(0, Σ ν_i s_i² / χ²_i), fiducial in both variances, at
    probability 1e-4; between 1e-2 and 1e-6 the tails differ by less than a factor of ten. Source: Fisher, "The
    comparison of samples with possibly unequal variances", Ann. Eugenics 9, 1939.
    """
    from scipy import special

    total = variances.sum(axis=0)
    denominator = (variances**2 / np.maximum(freedom, 1.0)).sum(axis=0)
    satterthwaite = total**2 / np.maximum(denominator, _MIN_DIVISOR)
    both_estimated = (variances > 0).all(axis=0) & np.isfinite(freedom).all(axis=0)
    if not both_estimated.any():
        return satterthwaite
    # Integrals over the probabilities of both χ², with nodes at equal distances of the logit.
    logit = np.linspace(-_MAX_LOGIT, _MAX_LOGIT, _NODE_COUNT)
    probability = special.expit(logit)
    weights = probability * (1.0 - probability) * (logit[1] - logit[0])
    estimates = variances[:, both_estimated, None]  # s_i²
    parts_freedom = np.maximum(freedom, 1.0)[:, both_estimated, None]
    chi_squares = 2.0 * special.gammaincinv(0.5 * parts_freedom, probability)
    first_variance, second_variance = estimates * parts_freedom / chi_squares  # ν_i s_i² / χ²_i
    sum_of_variances = first_variance[:, :, None] + second_variance[:, None, :]  # (k, nodes, nodes)
    relative_deviation = np.sqrt(sum_of_variances / total[both_estimated, None, None])
    nu = satterthwaite[both_estimated]
    for _ in range(_MATCHING_STEPS):
        quantile = special.stdtrit(nu, 0.5 * _FALSE_ALARM_RATE)
        tail = special.ndtr(quantile[:, None, None] / relative_deviation) @ weights @ weights  # over both χ²
        nu = np.minimum(special.stdtridf(tail, quantile), satterthwaite[both_estimated])
    satterthwaite[both_estimated] = nu
    return satterthwaite


def cluster_robust_covariance(Q: Array, residuals: Array, half: Array, labels: Array) -> tuple[Array, Array] | None:
    """CR2 sandwich covariance (k, k) and degrees of freedom (k,); None if one cluster alone determines an unknown.

    Q (n, 6, p) are the orthonormal columns of the whitened design, ``residuals`` (n, 6) the whitened residuals e, ``half``
    (k, p) maps whitened unknowns to k unknowns or sums of them, and ``labels`` (n,) is the cluster of each row. With
    M_g = Q_g' Q_g:

    s_g = (1 - M_g)^(-1/2) Q_g' e_g,   C = half Σ_g s_g s_g' half',   ν_k = (tr Ω)² / tr Ω²,
    Ω_gh = δ_gh |M_g^(1/2) B_g l|² - (M_g B_g l) · (M_h B_h l),   B_g = (1 - M_g)^(-1/2),   l = row k of half.

    Sources: Bell and McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples",
    Survey Methodology 28, 2002; Pustejovsky and Tipton, J. Business & Economic Statistics 36, 2018.
    """

    def columns(rows: Array) -> Array:
        return Q[rows].reshape(-1, Q.shape[-1])

    M, s = cluster_moments(columns, residuals, labels)
    return sandwich_covariance(M, s, half)


def cluster_moments(columns: Callable[[Array], Array], residuals: Array, labels: Array) -> tuple[Array, Array]:
    """Q_g'Q_g (g, p, p) and Q_g'e_g (g, p) of each cluster; ``columns`` returns all columns of Q in the given rows."""
    numbers = cluster_numbers(labels)
    order = np.argsort(numbers, kind="stable")
    cluster_starts = np.searchsorted(numbers[order], np.arange(1, int(numbers.max()) + 1))  # without the first
    rows_by_cluster = np.split(order, cluster_starts)
    M: list[Array] = []
    s: list[Array] = []
    for rows in rows_by_cluster:
        Q = columns(rows)
        M.append(Q.T @ Q)
        s.append(Q.T @ residuals[rows].reshape(-1))
    return np.stack(M), np.stack(s)


def cluster_numbers(labels: Array) -> Array:
    """Cluster numbers (n,) 0, 1, … of rows, by their labels. Of more than 1000 clusters, neighbours get one number."""
    _, numbers = np.unique(labels, return_inverse=True)
    if numbers.max() >= _MAX_SINGLE_CLUSTERS:
        numbers = numbers * _MAX_SINGLE_CLUSTERS // (numbers.max() + 1)
    return np.asarray(numbers)


def sandwich_covariance(M: Array, s: Array, half: Array) -> tuple[Array, Array] | None:
    """Result of :func:`cluster_robust_covariance` from M_g = Q_g' Q_g (g, p, p) and s_g = Q_g' e_g (g, p) of each cluster."""
    values, U = np.linalg.eigh(M)  # (1 - M_g)^(-1/2) = U diag(1 - values)^(-1/2) U'
    if values.max() > _MAX_SHARE_OF_CLUSTER:
        return None
    B = (U / np.sqrt(1.0 - values)[:, None, :]) @ np.swapaxes(U, 1, 2)
    s = (B @ s[..., None])[..., 0]
    C = half @ (s.T @ s) @ half.T
    Bl = B @ half.T  # (G, p, k): B_g l for each unknown
    MBl = M @ Bl
    d = (Bl * MBl).sum(axis=1)  # (G, k): |M_g^(1/2) B_g l|²
    size = (MBl * MBl).sum(axis=1)
    cross = np.stack([MBl[:, :, k].T @ MBl[:, :, k] for k in range(len(half))])  # (k, p, p)
    trace = d.sum(axis=0) - size.sum(axis=0)  # tr Ω
    trace_of_square = (d**2).sum(axis=0) - 2 * (d * size).sum(axis=0) + (cross**2).sum(axis=(1, 2))  # tr Ω²
    return C, trace**2 / np.maximum(trace_of_square, _MIN_DIVISOR)


# Rows of a block of time are one cluster (Liang and Zeger, "Longitudinal data analysis using generalized linear
# models", Biometrika 73, 1986), with Bell and McCaffrey's correction for few clusters, as in the fits of sensors. The
# textbook formula s² (W'W)^-1 treats every row as a cluster, and is several times too small.
#
# An incorrect law, of friction for instance, gives residuals that depend on the state and cancel within a block of time.
# So rows in one cell of states are also one cluster. The result takes the larger variances of both sandwiches C and
# D, with the correlations of C:
#
#     S C S,   S = diag max(1, √(D_kk / C_kk)).

_MAX_BLOCKS = 120
"""Largest number of blocks of all logs together."""
_MIN_BLOCKS = 15
"""Smallest number of blocks of all logs together."""
_MAX_HALVINGS = 8
"""Number of trials with blocks of half the length."""
_MIN_BLOCK_SECONDS = 1.0
"""Minimum duration of a block [s], if the logs are long enough."""
_CORRELATION_LENGTHS_PER_BLOCK = 10.0
_ROWS_PER_FACTORISATION = 1000
_CELL_COUNT = 32
"""Number of cells of the state space."""
_MAX_VELOCITIES = 2
"""Number of joints whose direction of motion distinguishes cells."""
_COMPARED_PARTS = 8
"""Number of parts of each coordinate whose residuals are compared, to find the coordinates that affect them."""
_PRIOR_OF_SETTINGS = 1e3
"""Prior standard deviation of a setting's effect, over the largest residual size: so wide that it has no effect."""
_UNKNOWN_FREEDOM = 1e9
"""Degrees of freedom that stand for infinitely many."""


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
    def from_residuals(cls, q: Array, dq: Array, residuals: Array) -> StateCells:
        """About 30 cells of the coordinates that affect residuals (n, nv) most, with equally many rows in each part.

        Coordinates are ranked by the squared mean residuals in eight parts of each.
        """
        effects = []
        for coordinate in (*q.T, *dq.T):
            edges = _edges(coordinate, _COMPARED_PARTS)
            part_numbers = np.searchsorted(edges, coordinate)  # of each row
            row_counts = np.bincount(part_numbers, minlength=_COMPARED_PARTS)
            sums = np.stack([np.bincount(part_numbers, column, _COMPARED_PARTS) for column in residuals.T])
            effects.append(float((sums**2 / np.maximum(row_counts, 1)).sum()))
        position_effects, velocity_effects = effects[: q.shape[1]], effects[q.shape[1] :]
        position = int(np.argmax(position_effects))
        velocities = np.argsort(velocity_effects, kind="stable")[-_MAX_VELOCITIES:].tolist()
        position_parts = _CELL_COUNT >> len(velocities)  # each velocity doubles the number of cells
        return cls(position, _edges(q[:, position], position_parts), tuple(velocities))

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


def _edges(values: Array, parts: int) -> Array:
    """Limits (parts - 1,) between parts with equally many values."""
    return np.asarray(np.quantile(values, np.arange(1, parts) / parts))


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
        selected = slice(count)
        return replace(
            self,
            matrix=self.matrix[selected, selected],
            freedom=self.freedom[selected],
            textbook=self.textbook[selected],
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
        quantile = student_quantile(np.maximum(self.freedom, 1.0), level)
        return np.asarray(quantile * self.deviations)


def student_quantile(freedom: Array | float, level: float) -> Array:
    """Half-width of Student's interval, in standard deviations."""
    from scipy.special import stdtrit

    return np.asarray(stdtrit(np.minimum(freedom, _UNKNOWN_FREEDOM), 0.5 + 0.5 * level))


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

    ``time`` and ``log`` (n,) are the time and the log of each row, ``states`` its q and dq. ``chosen`` (n, nv, k) are the
    changes of the predicted torques with each setting that was selected on these rows, such as the clock offset. The
    uncertainty of settings is included.
    """
    group_count = W.shape[2]
    residuals = tau - W @ x
    whitening = np.sqrt(weights) / sigma  # factor of each row
    rms_changes = np.sqrt((chosen**2).mean(axis=(0, 1)))
    has_effect = rms_changes > 0
    settings = chosen[..., has_effect] / rms_changes[has_effect]
    # Settings are unknowns as well.
    setting_sizes = np.full(settings.shape[2], sigma.max() * _PRIOR_OF_SETTINGS)
    sizes = np.concatenate([prior.size, setting_sizes])

    def whitened_columns(rows: Array | slice) -> Array:
        """All columns (m nv, r + k) of the given rows."""
        A = np.concatenate([W[rows], settings[rows]], axis=2)
        A *= whitening[rows][..., None]
        return A.reshape(-1, len(sizes))

    q, dq = states
    whitened_residuals = residuals * whitening
    cells = StateCells.from_residuals(q, dq, whitened_residuals)
    covariance = _covariance(whitened_columns, whitened_residuals, sizes, time, log, cells.numbers(q, dq))
    groups = covariance.of_first(group_count)  # without the settings
    huber_factor = _huber_factor(residuals, weights)
    return replace(groups, matrix=groups.matrix * huber_factor**2)


def _huber_factor(residuals: Array, weights: Array) -> float:
    """Correction factor for Huber weights: mean weight over mean slope.

    Huber's residuals count with ψ(u) = w u, whose slope is 1 up to k and 0 beyond. Source: Huber, "Robust Statistics",
    1981, section 7.6.
    """
    is_measured = (residuals != 0).any(axis=0)
    if not is_measured.any() or (weights == 1.0).all():
        return 1.0
    measured_weights = weights[:, is_measured]
    return float(measured_weights.mean() / (measured_weights == 1.0).mean())


def larger_covariance(first: tuple[Array, Array], second: tuple[Array, Array] | None) -> tuple[Array, Array]:
    """Covariance with the larger variances of two estimates and the correlations of the first, and degrees of freedom."""
    if second is None:
        return first
    C, freedom = first
    D, other_freedom = second
    ratio = D.diagonal() / np.maximum(C.diagonal(), _MIN_DIVISOR)
    factor = np.sqrt(np.maximum(ratio, 1.0))
    larger_freedom = np.where(ratio > 1.0, other_freedom, freedom)  # of the estimate with the larger variance
    return C * factor[:, None] * factor, larger_freedom


def _covariance(
    columns: Callable[[Array | slice], Array], residuals: Array, sizes: Array, time: Array, log: Array, cell: Array
) -> GroupCovariance:
    """Larger covariance of the sandwiches by blocks of time and by cells of state.

    ``columns`` returns the whitened columns in some rows, ``residuals`` (n, nv) are whitened, ``sizes`` are the deviations of
    the unknowns' priors with zero mean, and ``cell`` (n,) is the number of each row's cell.
    """
    n, nv = residuals.shape
    R: Array = np.eye(len(sizes))  # R'R = 1 + A'A for columns in units of their sizes
    for begin in range(0, n, _ROWS_PER_FACTORISATION):
        block = columns(slice(begin, begin + _ROWS_PER_FACTORISATION)) * sizes
        R = np.asarray(np.linalg.qr(np.concatenate([R, block]), mode="r"))
    half = sizes[:, None] * np.linalg.inv(R)
    time_step = 1.0
    if n > 1:
        is_within_log = np.diff(log) == 0
        time_step = float(np.median(np.diff(time)[is_within_log]))
    square_sum = float((residuals**2).sum())
    freedom = max(1, n * nv - len(sizes))
    textbook_variances = (half @ half.T).diagonal() * square_sum / freedom
    textbook = np.sqrt(np.maximum(textbook_variances, 0.0))
    correlation_length = autocorrelation_length(residuals)
    block_rows = max(_CORRELATION_LENGTHS_PER_BLOCK * correlation_length, _MIN_BLOCK_SECONDS / time_step)
    block_rows = float(np.clip(block_rows, n / _MAX_BLOCKS, n / _MIN_BLOCKS))

    def sandwich(clusters: Array) -> tuple[Array, Array] | None:
        """Covariance and degrees of freedom by clusters; None if one cluster alone determines an unknown."""
        M, s = cluster_moments(lambda rows: columns(rows) @ half, residuals, clusters)
        return sandwich_covariance(M, s, half)

    # If one block alone determines an unknown, shorter blocks are tried.
    for _ in range(_MAX_HALVINGS):
        blocks = np.arange(n) // max(1, math.ceil(block_rows))
        blocks += (blocks.max() + 1) * log  # no block has rows of two logs
        by_blocks = sandwich(blocks)
        by_cells = sandwich(cell)
        if by_blocks is not None:
            matrix, freedom_of_unknowns = larger_covariance(by_blocks, by_cells)
            return GroupCovariance(matrix, freedom_of_unknowns, textbook, block_rows * time_step)
        block_rows /= 2.0
        if block_rows < 1.0:
            break
    inflated_matrix = half @ half.T * correlation_length
    return GroupCovariance(inflated_matrix, np.full(len(sizes), _UNKNOWN_FREEDOM), textbook, 0.0)


_MIN_CHANCE = 1e-3
"""Probability of a false alarm for white residuals, over all channels."""
_LJUNG_BOX_LAGS = 20
"""Number of lags of the Ljung-Box test."""
_MIN_ROWS_OF_LJUNG_BOX = 100
_MAX_LAG = 400
"""Largest lag [rows] of an autocorrelation time."""


def autocorrelation(e: Array, lags: int) -> Array:
    """Autocorrelation of a series (n,), whose mean is not subtracted, at lags 0 to ``lags``."""
    spectrum = np.fft.rfft(e, 2 * len(e))  # with zeros at the end, as the transform is periodic
    autocovariance = np.fft.irfft(spectrum * spectrum.conj())[: lags + 1]
    return np.asarray(autocovariance / max(float(e @ e), _MIN_DIVISOR))


def autocorrelation_length(residuals: Array) -> float:
    """Integrated autocorrelation time of residuals (n, nv) in rows, 1 + 2 Σ ρ above the noise; the largest of all joints."""
    n = len(residuals)
    longest = 1.0
    lags = min(n // 4, _MAX_LAG)
    for column in residuals.T:
        rho = autocorrelation(column - column.mean(), lags)
        noise_lags = np.flatnonzero(rho < 2.0 / math.sqrt(n))  # two standard deviations of white noise
        first_noise_lag = int(noise_lags[0]) if noise_lags.size else lags
        length = 1.0 + 2.0 * float(rho[1:first_noise_lag].sum())
        longest = max(longest, length)
    return longest


@dataclass(frozen=True)
class Whiteness:
    """Whiteness of residuals: test result of the least white channel."""

    axis: str  # name of the channel
    lag1: float  # autocorrelation of neighbouring rows
    chance: float  # p-value over all channels
    length: int  # correlation length of the residuals in rows; 1 if they are white
    test: str  # name of the test with this p-value

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

        n = len(e)
        channels: list[Whiteness] = []
        for axis, q, r in zip(names, np.moveaxis(Q, 1, 0), e.T, strict=True):
            squares = max(float(r @ r), _MIN_DIVISOR)
            variance = squares / max(n - float((q * q).sum()), 1.0)
            Dq = _mean_of_neighbours(q)
            statistic = float(r @ _mean_of_neighbours(r))
            mean = -float((q * Dq).sum())
            # tr D² = (n - 1) / 2
            statistic_variance = 2.0 * (0.5 * (n - 1) - 2.0 * float((Dq * Dq).sum()) + float(((q.T @ Dq) ** 2).sum()))
            z = (statistic / variance - mean) / np.sqrt(max(statistic_variance, 1e-12))
            tests = [(float(special.ndtr(-z)), "lag-1 autocorrelation")]  # p-value and name
            if n >= _MIN_ROWS_OF_LJUNG_BOX:
                rho = autocorrelation(r, _LJUNG_BOX_LAGS)[1:]
                lags = np.arange(1, _LJUNG_BOX_LAGS + 1)
                ljung_box = n * (n + 2) * float((rho**2 / (n - lags)).sum())
                p_value = float(special.chdtrc(_LJUNG_BOX_LAGS, ljung_box))
                tests.append((p_value, "Ljung-Box of 20 lags"))
            least_p_value, test = min(tests)
            chance = min(len(names) * len(tests) * least_p_value, 1.0)  # Bonferroni, for all channels and tests
            channels.append(cls(axis, lag1=statistic / squares, chance=chance, length=1, test=test))
        least_white = min(channels, key=lambda channel: channel.chance)
        if least_white.white:
            return least_white
        return replace(least_white, length=_correlated_rows(e))


def _mean_of_neighbours(x: Array) -> Array:
    """D x: mean of the previous and the next row, with zeros beyond the ends."""
    Dx = np.zeros_like(x)
    Dx[1:] += 0.5 * x[:-1]
    Dx[:-1] += 0.5 * x[1:]
    return Dx


def _correlated_rows(e: Array) -> int:
    """Twice the lag at which the largest autocorrelation first falls into the noise, at most a tenth of the rows."""
    n = len(e)
    max_lag = max(2, n // 10)
    largest_rho = np.max([autocorrelation(column, min(max_lag, n - 2))[1:] for column in e.T], axis=0)
    noise_indices = np.flatnonzero(largest_rho < 2.0 / np.sqrt(n))  # two standard deviations of white noise
    if not noise_indices.size:
        return max_lag
    first_noise_lag = int(noise_indices[0]) + 1  # the first entry is of lag 1
    return int(min(2 * first_noise_lag, max_lag))
