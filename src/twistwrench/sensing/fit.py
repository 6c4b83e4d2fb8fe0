"""Weighted least squares for bias, load and what else is asked, with the noise of each of the six channels estimated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..typing import Array
from .covariance import as_weights, by_channels, by_witnesses, of_block, plug_in
from .log import ReadingLog
from .unknowns import SensorState, Unknowns, clock

_HUBER = 2.0  # scaled distance from which a row loses weight; 1 is the middle of good ones
_MAD = 1.4826  # standard deviations that the median absolute deviation of normal noise makes
_ROUNDS, _SETTLED = 100, 1e-7
_FEW = 6  # witnesses below which three channels of a kind share a variance
_QUIET = 1e-3  # of its kind's noise, the least that a channel may have
_LATE = 0.5  # s, the longest delay that is looked for


@dataclass(frozen=True, eq=False)
class Problem:
    """What a fit is asked: rows, unknowns, and what is known beforehand."""

    log: ReadingLog
    """n rows: means of dwells, and readings in motion."""
    unknowns: Unknowns
    factor: float
    """+1 for readings on the sensor, -1 for readings by it."""
    bias: Array
    """(6,) where it is no unknown."""
    noise: Array | None
    """(6,) standard deviations of one reading if known."""
    count: Array
    """(n,) readings in each row."""
    within: Array
    """(6,) variance of a reading within its dwell; zero where it cannot be told."""
    within_freedom: float
    label: Array
    """(n,) the witness of each row."""
    timed: bool = False
    """Whether the log has times, and not only an order."""
    state: SensorState = field(default_factory=SensorState)

    def asked(self, **changes: bool) -> Problem:
        """The problem with other unknowns."""
        return replace(self, unknowns=replace(self.unknowns, **changes))

    @property
    def target(self) -> Array:
        """(n, 6) what the unknowns are to explain."""
        return self.log.readings - (0.0 if self.unknowns.bias else self.bias)


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The unknowns that explain a log best, with their covariance."""

    unknowns: Unknowns
    estimate: Array
    """(p,) in the order of ``unknowns.names``; those of turn, tilt and delay are zero, for ``state`` has them."""
    covariance: Array
    """(p, p) by the sandwich, for intervals; that of the turn is of a small rotation in the sensor's own axes [rad]."""
    known: Array
    """(p,) degrees of freedom of each unknown's variance."""
    com_known: Array
    """(3,) those of the first moment less its own mass times the centre of mass, which Fieller's intervals are about."""
    joint: Array
    """(p, p) covariance for regions of several unknowns: that of independent rows, which is of full rank."""
    joint_freedom: float
    """Of mass and first moment together."""
    sigma: Array
    """(6,) standard deviation of one reading in any orientation [N m, N]."""
    freedom: Array
    """(6,) degrees of freedom these were estimated with; inf where they were given."""
    deviation: Array
    """(n, 6) standard deviation of each row."""
    residuals: Array
    """(n, 6) rows minus model."""
    state: SensorState
    """The mounting, the tilt of gravity and the delay."""
    design: Array
    """(n, 6, p)."""
    leverage: Array
    """(n, 6) share of each row's own reading in what the fit makes of it; zero where the row is left out."""

    def __repr__(self) -> str:
        return f"<Fit: {', '.join(self.unknowns.names)} from {len(self.residuals)} witnesses>"

    @property
    def load(self) -> Array:
        """The ten parameters; inertia numbers that were not asked are zero."""
        part = self.estimate[self.unknowns.load]
        return np.concatenate([part, np.zeros(10 - len(part))])

    @property
    def mounting(self) -> Array:
        """R_fs (3, 3)."""
        return self.state.mounting

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviation of one reading's moments [N m] and forces [N], root mean square of three."""
        moment, force = np.sqrt((self.sigma.reshape(2, 3) ** 2).mean(axis=1))
        return float(moment), float(force)


def few(label: Array) -> bool:
    """Whether the witnesses are too few for a variance of each channel."""
    return len(np.unique(label)) < _FEW


def fit(problem: Problem, *, keep: Array, huber: bool = False) -> Fit:
    """Explain the rows of ``keep`` (n,), with Huber's weights if ``huber``.

    Turn, tilt and delay are found by Gauss-Newton from ``problem.state``, the rest is linear. The variance of a row of
    count readings is v = τ + w / count, w that within dwells; τ makes the residuals' mean squares equal to v, corrected
    for the degrees of freedom, for each channel.
    """
    asked, log, target = problem.unknowns, problem.log, problem.target
    t = clock(log)
    state = replace(problem.state, middle=0.5 * float(t[0] + t[-1]))
    groups = np.repeat([0, 1], 3) if few(problem.label[keep]) else np.arange(6)
    share = 1.0 / problem.count[:, None]
    floor = (1e-13 * (np.abs(target).max() + 1e-3)) ** 2
    within = problem.within
    if problem.noise is None:
        v = np.tile(np.repeat([0.03**2, 1.0], 3), (len(log), 1))
    else:
        v = problem.noise**2 * share
    freedom, tau, weight = np.full(6, math.inf), np.zeros(6), keep.astype(float)
    A = asked.design(log, problem.factor, state)
    for round_ in range(_ROUNDS):
        if asked.curved:
            A = asked.design(log, problem.factor, state)
        inside = _inside(log, state.delay) if asked.delay else 1.0
        x, half, Q = _solve(A, target, v, weight * inside, asked)
        residuals = target - A @ x
        before, weighed = v, weight
        if problem.noise is None:
            tau, freedom = _between(residuals, Q, v, weight * inside, keep, within * share, groups, huber=huber)
            v = np.maximum(tau + within * share, np.maximum(0.1 * within * share, floor))
        if huber:
            distance = np.sqrt(np.mean(residuals**2 / v, axis=1))
            weight = keep * np.minimum(1.0, _HUBER / np.maximum(distance, 1e-300))
        moved = max(float(np.abs(v / before - 1.0).max()), float(np.abs(weight - weighed).mean()))
        if asked.curved:
            step = np.concatenate([x[asked.part(kind)] for kind in ("turn", "tilt", "delay") if kind in asked.kinds])
            state = asked.moved(state, log, x)
            state = replace(state, delay=float(np.clip(state.delay, -_LATE, _LATE)))
            moved = max(moved, float(np.abs(step).max()), float(round_ == 0))
            for kind in ("turn", "tilt", "delay"):
                if kind in asked.kinds:
                    x[asked.part(kind)] = 0.0
        if moved < (1e-3 if huber else _SETTLED) and (round_ or not huber):
            break
    root = np.sqrt(weight * inside)[:, None] / np.sqrt(before)
    start = asked.load.start
    com = half[start + 1 : start + 4] * x[start] - np.outer(x[start + 1 : start + 4], half[start])
    rows = np.concatenate([half, com])
    C, known = by_channels(Q, rows, freedom, groups)
    C = joint = C[: len(x), : len(x)]
    sigma = problem.noise
    joint_freedom = of_block(by_channels(Q, half[start : start + 4], as_weights(freedom), groups)[1])
    if sigma is None:
        label = problem.label[keep]
        added = half @ plug_in(Q, freedom, groups) @ half.T
        sandwich = None if few(label) else by_witnesses(Q[keep], (residuals * root)[keep], rows, label)
        C, known = (C, known) if sandwich is None else sandwich
        C, joint = C[: len(x), : len(x)] + added, joint + added
        size = np.unique(label, return_counts=True)[1]
        # Rows hang together, which only the sandwich minds. Rows of a witness that are all alike bring that much (Kish,
        # Survey Sampling, 1965, section 5.4); beyond it is noise of the sandwich.
        ratio = float((np.diag(C) / np.diag(joint))[asked.load].mean())
        joint = joint * min(max(1.0, ratio), float((size**2).sum() / size.sum()))
        sigma, freedom = _of_one(problem, v, keep, freedom)
    known, com_known = known[: len(x)], known[len(x) :]
    deviation, leverage = np.sqrt(v), (Q * Q).sum(axis=2)
    return Fit(
        asked, x, C, known, com_known, joint, joint_freedom, sigma, freedom, deviation, residuals, state, A, leverage
    )


def _of_one(problem: Problem, v: Array, keep: Array, freedom: Array) -> tuple[Array, Array]:
    """Standard deviation (6,) of one reading in any orientation, and its degrees of freedom (6,) by Satterthwaite.

    σ² = v + w (1 - 1 / count): what rows have, and what their means have lost.
    """
    lost = problem.within * (1.0 - float((1.0 / problem.count[keep]).mean()))
    mean = v[keep].mean(axis=0)
    unsure = mean**2 / freedom + lost**2 / max(problem.within_freedom, 1.0)
    return np.sqrt(mean + lost), (mean + lost) ** 2 / unsure


def _inside(log: ReadingLog, delay: float) -> Array:
    """(n,) 1 for rows whose poses a delay earlier are in the log."""
    t = clock(log)
    near = 2 * float(np.median(np.diff(t)))
    return ((t - delay > t[0] - near) & (t - delay < t[-1] + near)).astype(float)


def _solve(A: Array, target: Array, v: Array, weight: Array, asked: Unknowns) -> tuple[Array, Array, Array]:
    """Weighted least squares: estimate (p,), half its covariance (p, p), orthonormal columns Q (n, 6, p).

    A W^(1/2) = Q U,  x = U⁻¹ Q' W^(1/2) y,  C = U⁻¹ U⁻ᵀ.
    """
    n, _, p = A.shape
    free = np.ones(p, bool)
    for kind in ("turn", "tilt", "delay"):
        if kind in asked.kinds and not A[..., asked.part(kind)].any():  # no load yet: it waits
            free[asked.part(kind)] = False
    root = np.sqrt(weight)[:, None] / np.sqrt(v)
    scales = asked.scales[free]
    q, upper = np.linalg.qr((A[..., free] * root[..., None]).reshape(6 * n, -1) * scales)
    x, half, Q = np.zeros(p), np.zeros((p, p)), np.zeros((6 * n, p))
    inverse = scales[:, None] * np.linalg.inv(upper)
    x[free] = inverse @ (q.T @ (target * root).ravel())
    half[np.ix_(free, free)] = inverse
    Q[:, free] = q
    return x, half, Q.reshape(n, 6, p)


def _between(
    residuals: Array, Q: Array, v: Array, weight: Array, keep: Array, own: Array, groups: Array, *, huber: bool
) -> tuple[Array, Array]:
    """The variance τ (6,) that rows have beyond their ``own`` (n, 6), and its degrees of freedom (6,)."""
    used = (weight > 0)[:, None] if not huber else keep[:, None]
    loose = used * (1.0 - (Q * Q).sum(axis=2))  # 1 - leverage
    freedom = np.maximum(_pooled(loose.sum(axis=0), groups), 1e-9)
    if huber:  # by the median: up to half of the rows may be anything
        shared = int(groups[-1]) == 1  # three channels of a kind
        size = np.abs(residuals[keep])
        size = np.repeat(np.median(size.reshape(-1, 2, 3), axis=(0, 2)), 3) if shared else np.median(size, axis=0)
        tau = (_MAD * size) ** 2 * keep.sum() * np.bincount(groups)[groups] / np.maximum(freedom, 1.0)
        tau = np.maximum(tau - np.median(own[keep], axis=0), 0.0)
    else:
        weights = used / v**2
        tau = _pooled((weights * (residuals**2 - own * loose)).sum(axis=0), groups)
        tau = tau / np.maximum(_pooled((weights * loose).sum(axis=0), groups), 1e-300)
    most = np.repeat(np.maximum(tau, 0.0).reshape(2, 3).max(axis=1), 3)
    return np.maximum(tau, np.where(own.any(), -np.inf, _QUIET**2 * most)), freedom


def _pooled(x: Array, groups: Array) -> Array:
    """Sums over the channels of each group (6,)."""
    return np.bincount(groups, x)[groups]
