"""Weighted least squares for bias, load, mounting and other unknowns of a sensor, with noise per channel."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.estimation.covariance import (
    channel_covariance,
    cluster_robust_covariance,
    f_test_freedom,
    student_quantile,
    sum_freedom,
    variance_estimate_covariance,
    weight_freedom,
)
from ..core.estimation.least_squares import MAD, huber_weights, orthogonal_fit
from ..core.typing import Array
from .log import ReadingLog
from .unknowns import SensorState, Unknowns

_HUBER_LIMIT = 2.0
"""Scaled distance above which a row loses weight; 1 is the median of inliers."""
MAX_ROUNDS = 100
"""Largest number of iterations."""
MAX_CHANGE = 1e-7
"""Largest change of unknowns and relative change of variances in the last iteration."""
_MAX_HUBER_CHANGE = 1e-3
"""Largest such change with Huber weights, whose fit only finds suspect rows."""
MIN_CLUSTERS = 6
"""Number of clusters below which the three channels of a kind share a variance."""
MIN_NOISE_RATIO = 1e-3
"""Smallest ratio of a channel's excess variance to the largest of its kind, as a ratio of standard deviations."""
_FIRST_MOMENT_NOISE = 0.03
"""Initial guess of the standard deviation of moments [N m]."""
_FIRST_FORCE_NOISE = 1.0
"""Initial guess of the standard deviation of forces [N]."""
_MIN_READING = 1e-3
"""Size [N m or N] that is added to the largest reading, so that rounding errors of zeros are not zero."""
_ROUNDING_SHARE = 1e-13
"""Rounding error of a row, relative to the largest reading."""
_SHARE_OF_EXACT_DATA = 1e-12
"""Smallest deviation of residuals, relative to the largest, so that quotients stay finite with exact data."""
_MIN_SHARE_OF_OWN_VARIANCE = 0.1
"""Smallest variance of a row, relative to that within its dwell."""
_TINY_FREEDOM = 1e-9
"""Degrees of freedom in place of 0 or less."""
_TINY_WEIGHT = 1e-300
"""Sum of weights in place of 0, as a divisor."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Problem of a fit: rows, unknowns, and known values."""

    log: ReadingLog
    """n rows: means of dwells, and readings in motion."""
    unknowns: Unknowns
    factor: float
    """+1 for readings on the sensor, -1 for readings by it."""
    bias: Array
    """Known bias (6,); zero if there is none."""
    noise: Array | None
    """Known standard deviations (6,) of one reading; None if they are estimated."""
    count: Array
    """Number (n,) of readings in each row."""
    within: Array
    """Variance (6,) of a reading within its static pose, a dwell; zero if unknown."""
    within_freedom: float
    """Degrees of freedom of ``within``."""
    label: Array
    """Cluster (n,) of each row."""
    timed: bool = False
    """True if the log has times; False if only an order."""
    state: SensorState = field(default_factory=SensorState)
    """Initial mounting, tilt and delay."""

    def with_unknowns(self, **changes: bool) -> Problem:
        """Problem with changed unknowns."""
        return replace(self, unknowns=replace(self.unknowns, **changes))

    @property
    def target(self) -> Array:
        """Right-hand side (n, 6) of the fit."""
        known_bias = 0.0 if self.unknowns.bias else self.bias
        return self.log.readings - known_bias


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """Best-fit unknowns of a log, with their covariance."""

    unknowns: Unknowns
    estimate: Array
    """Estimates (p,) in the order of ``unknowns.names``; turn, tilt and delay are zero, as ``state`` contains them."""
    covariance: Array
    """Sandwich covariance (p, p), for intervals; for the turn, of a small rotation in the sensor's axes [rad]."""
    known: Array
    """Degrees of freedom (p,) by which the variance of each unknown is known."""
    com_known: Array
    """Degrees of freedom (3,) of first moment minus mass times centre of mass, as used by Fieller's intervals."""
    joint: Array
    """Covariance (p, p) for regions of several unknowns together, as if rows were independent; it has full rank."""
    joint_freedom: float
    """Degrees of freedom of mass and first moment together."""
    sigma: Array
    """Standard deviation (6,) of one reading in a new orientation [N m, N]."""
    freedom: Array
    """Degrees of freedom (6,) of sigma; inf if the noise was given."""
    deviation: Array
    """Standard deviation (n, 6) of each row."""
    residuals: Array
    """Rows minus model (n, 6)."""
    state: SensorState
    """Mounting, tilt of gravity and delay."""
    design: Array
    """Design matrices (n, 6, p)."""
    leverage: Array
    """Leverage (n, 6) of each row; zero for rows left out."""

    def __repr__(self) -> str:
        return f"<Fit: {', '.join(self.unknowns.names)} from {len(self.residuals)} clusters>"

    @property
    def load(self) -> Array:
        """Ten inertial parameters; the inertia is zero unless it is an unknown."""
        estimated_parameters = self.estimate[self.unknowns.load]
        return np.concatenate([estimated_parameters, np.zeros(10 - len(estimated_parameters))])

    @property
    def mounting(self) -> Array:
        """R_fs (3, 3)."""
        return self.state.mounting

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviation of one reading's moments [N m] and forces [N], root mean square over three channels."""
        moment, force = np.sqrt((self.sigma.reshape(2, 3) ** 2).mean(axis=1))
        return float(moment), float(force)

    @property
    def mass_deviation(self) -> float:
        """Standard deviation of the mass [kg]."""
        return float(np.sqrt(self.covariance.diagonal()[self.unknowns.load.start]))

    def interval(self, name: str, confidence: float) -> tuple[float, float]:
        """Confidence interval of an unknown, in its SI unit; centred on zero for ``turn`` and ``tilt``."""
        k = self.unknowns.names.index(name)
        half_width = float(student_quantile(self.known[k], confidence)) * math.sqrt(self.covariance[k, k])
        middle = self.state.delay if name == "delay" else float(self.estimate[k])
        return middle - half_width, middle + half_width

    @property
    def com_deviation(self) -> Array:
        """Standard deviations (3,) of the centre of mass c = h / m [m], to first order: dc = (dh - c dm) / m."""
        mass_and_moment = slice(self.unknowns.load.start, self.unknowns.load.start + 4)
        x = self.estimate[mass_and_moment]  # (m, h)
        C = self.covariance[mass_and_moment, mass_and_moment]
        D = np.hstack([-(x[1:] / x[0])[:, None], np.eye(3)]) / x[0]
        return np.asarray(np.sqrt(np.diag(D @ C @ D.T)))

    def spread(self, rows: Array) -> Array:
        """Standard deviations (2,) of the residuals of moments and forces in some rows; always positive."""
        deviations = np.sqrt((self.residuals[rows].reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))
        least_deviation = _SHARE_OF_EXACT_DATA * (_MIN_READING + np.abs(self.residuals).max())
        return np.maximum(deviations, least_deviation)


def few(label: Array) -> bool:
    """True if there are too few clusters (n,) of rows to estimate a variance for each channel."""
    return len(np.unique(label)) < MIN_CLUSTERS


def fit(problem: Problem, *, keep: Array, huber: bool = False) -> Fit:
    """Fit the rows in the mask ``keep`` (n,), with Huber weights if ``huber``.

    Turn, tilt and delay are found by Gauss-Newton from ``problem.state``; the other unknowns are linear. The variance
    of a row of count readings is v = τ + w / count, with w the variance within dwells. For each channel, τ makes the
    mean square of the residuals equal to v, corrected for the degrees of freedom. Variances, weights and the state change
    from one iteration to the next.
    """
    unknowns = problem.unknowns
    log = problem.log
    target = problem.target
    t = log.clock
    nonlinear = unknowns.nonlinear_columns
    state = replace(problem.state, middle=0.5 * float(t[0] + t[-1]))
    groups = np.repeat([0, 1], 3) if few(problem.label[keep]) else np.arange(6)  # channels that share a variance
    inverse_count = 1.0 / problem.count[:, None]
    own_variance = problem.within * inverse_count
    rounding_error = _ROUNDING_SHARE * (np.abs(target).max() + _MIN_READING)
    min_variance = np.maximum(_MIN_SHARE_OF_OWN_VARIANCE * own_variance, rounding_error**2)
    if problem.noise is None:
        v = np.tile(np.repeat([_FIRST_MOMENT_NOISE**2, _FIRST_FORCE_NOISE**2], 3), (len(log), 1))
    else:
        v = problem.noise**2 * inverse_count
    freedom = np.full(6, math.inf)
    weight = keep.astype(float)
    A = unknowns.design(log, problem.factor, state)
    iteration = 0
    while True:
        if nonlinear.size and iteration:
            A = unknowns.design(log, problem.factor, state)
        used_weight = weight
        if unknowns.delay:
            used_weight = weight * _pose_is_in_log(log, state.delay)
        root_weight = np.sqrt(used_weight)[:, None] / np.sqrt(v)
        x, covariance_root, Q = orthogonal_fit(A, target, root_weight, unknowns.scales)
        residuals = target - A @ x
        last_v = v
        last_weight = weight
        if problem.noise is None:
            tau, freedom = _excess_variance(residuals, Q, v, used_weight, keep, own_variance, groups, huber=huber)
            v = np.maximum(tau + own_variance, min_variance)
        if huber:
            scaled_distance = np.sqrt(np.mean(residuals**2 / v, axis=1))
            weight = keep * huber_weights(scaled_distance, _HUBER_LIMIT)
        variance_change = float(np.abs(v / last_v - 1.0).max())
        weight_change = float(np.abs(weight - last_weight).mean())
        change = max(variance_change, weight_change)
        if nonlinear.size:
            state = unknowns.next_state(state, log, x)
            change = max(change, float(np.abs(x[nonlinear]).max()))
            if iteration == 0:  # a second iteration at least, with the new state
                change = max(change, 1.0)
            x[nonlinear] = 0.0  # the state contains them
        iteration += 1
        if huber:
            has_converged = iteration > 1 and change < _MAX_HUBER_CHANGE
        else:
            has_converged = change < MAX_CHANGE
        if has_converged or iteration == MAX_ROUNDS:
            break
    whitened_residuals = (residuals * root_weight)[keep]
    covariances = _covariances(problem, x, covariance_root, Q, whitened_residuals, freedom, groups, keep)
    sigma = problem.noise
    if sigma is None:
        sigma, freedom = _reading_deviation(problem, v, keep, freedom)
    leverage = (Q * Q).sum(axis=2)
    return Fit(unknowns, x, *covariances, sigma, freedom, np.sqrt(v), residuals, state, A, leverage)


def _covariances(
    problem: Problem, x: Array, root: Array, Q: Array, residuals: Array, freedom: Array, groups: Array, keep: Array
) -> tuple[Array, Array, Array, Array, float]:
    """Sandwich covariance, degrees of freedom of unknowns and centre of mass, joint covariance and its freedom.

    ``root`` is the root of the covariance for unit variances. ``residuals`` (m, 6) of the kept rows are whitened.
    """
    p = len(x)
    load = problem.unknowns.load
    m = load.start  # index of the mass
    h = slice(load.start + 1, load.start + 4)  # of the first moment
    rows = np.concatenate([root, root[h] * x[m] - np.outer(x[h], root[m])])  # unknowns, then m dh - h dm
    C, degrees_of_freedom = channel_covariance(Q, rows, freedom, groups)
    joint = C[:p, :p]
    _, load_freedom = channel_covariance(Q, root[m : m + 4], weight_freedom(freedom), groups)
    joint_freedom = f_test_freedom(load_freedom)
    if problem.noise is None:
        label = problem.label[keep]
        C_of_variance_estimates = root @ variance_estimate_covariance(Q, freedom, groups) @ root.T
        sandwich = None
        if not few(label):
            sandwich = cluster_robust_covariance(Q[keep], residuals, rows, label)
        if sandwich is not None:
            C, degrees_of_freedom = sandwich
        C = C[:p, :p] + C_of_variance_estimates
        joint = joint + C_of_variance_estimates
        # Only the sandwich accounts for autocorrelated rows. Fully correlated rows of a cluster give the largest ratio
        # (Kish, Survey Sampling, 1965, section 5.4); larger values are noise of the sandwich.
        ratio = float((np.diag(C) / np.diag(joint))[load].mean())
        _, cluster_sizes = np.unique(label, return_counts=True)
        largest_ratio = float((cluster_sizes**2).sum() / cluster_sizes.sum())
        joint = joint * min(max(1.0, ratio), largest_ratio)
    return C[:p, :p], degrees_of_freedom[:p], degrees_of_freedom[p:], joint, joint_freedom


def _reading_deviation(problem: Problem, v: Array, keep: Array, freedom: Array) -> tuple[Array, Array]:
    """Standard deviation (6,) of one reading in a new orientation, and its degrees of freedom (6,).

    σ² = v + w (1 - 1 / count): the variance of rows, plus the part that averaging removed.
    """
    mean_inverse_count = float((1.0 / problem.count[keep]).mean())
    removed_variance = problem.within * (1.0 - mean_inverse_count)
    row_variance = v[keep].mean(axis=0)
    freedoms = np.stack([freedom, np.full(6, problem.within_freedom)])
    sigma = np.sqrt(row_variance + removed_variance)
    return sigma, sum_freedom(np.stack([row_variance, removed_variance]), freedoms)


def _pose_is_in_log(log: ReadingLog, delay: float) -> Array:
    """1.0 for rows (n,) whose poses a delay earlier lie within the log, or at most two median steps beyond it."""
    t = log.clock
    margin = 2 * float(np.median(np.diff(t)))
    return ((t - delay > t[0] - margin) & (t - delay < t[-1] + margin)).astype(float)


def _excess_variance(
    residuals: Array, Q: Array, v: Array, weight: Array, keep: Array, own_variance: Array, groups: Array, *, huber: bool
) -> tuple[Array, Array]:
    """Variance τ (6,) of rows in excess of ``own_variance`` (n, 6), and its degrees of freedom (6,)."""
    is_used = keep if huber else weight > 0
    row_freedom = is_used[:, None] * (1.0 - (Q * Q).sum(axis=2))  # 1 - leverage
    freedom = np.maximum(_group_sums(row_freedom.sum(axis=0), groups), _TINY_FREEDOM)
    if huber:  # median: robust if up to half of the rows are outliers
        magnitudes = np.abs(residuals[keep])
        medians = np.median(magnitudes, axis=0)
        if int(groups[-1]) == 1:  # three channels of a kind share a variance
            medians = np.repeat(np.median(magnitudes.reshape(-1, 2, 3), axis=(0, 2)), 3)
        channels_of_group = np.bincount(groups)[groups]
        tau = (MAD * medians) ** 2 * keep.sum() * channels_of_group / np.maximum(freedom, 1.0)
        tau = np.maximum(tau - np.median(own_variance[keep], axis=0), 0.0)
    else:
        weights = is_used[:, None] / v**2
        excess_squares = _group_sums((weights * (residuals**2 - own_variance * row_freedom)).sum(axis=0), groups)
        weighted_freedom = _group_sums((weights * row_freedom).sum(axis=0), groups)
        tau = excess_squares / np.maximum(weighted_freedom, _TINY_WEIGHT)
    if own_variance.any():  # a channel has the noise within dwells, so τ needs no lower bound
        return tau, freedom
    largest_of_kinds = np.maximum(tau, 0.0).reshape(2, 3).max(axis=1)  # of moments and of forces
    min_variance = MIN_NOISE_RATIO**2 * np.repeat(largest_of_kinds, 3)
    return np.maximum(tau, min_variance), freedom


def _group_sums(x: Array, groups: Array) -> Array:
    """For each of six channels, sum of x (6,) over the channels of its group; ``groups`` (6,) are group numbers."""
    return np.bincount(groups, x)[groups]
