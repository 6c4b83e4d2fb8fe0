"""Least-squares fit of log rows for the search for causes, and the gain in S of additional columns on held-out rows.

With s_j² the mean square of the residual of joint j in 5-fold cross-validation over time, columns of a cause gain

    S = Σ_j log(s_j² without it / s_j² with it),

the criterion by which settings are chosen too. Each joint has equal weight.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ..core.estimation.covariance import autocorrelation_length, student_quantile
from ..core.estimation.cross_validation import FOLDS
from ..core.estimation.least_squares import NormalEquations, Prior
from ..core.typing import Array
from . import causes
from .causes import Cause, FittedTorques, Law, LogStates
from .hyperparameters import FitSettings
from .parameters import BaseParameters, UnknownParameters
from .rows import SteadySamples

LEAST_S = 0.25
"""S from which a cause is reported: no S of 56 clean logs exceeded 0.19."""
_CHANCE = 0.01
_FLOOR = 0.005
"""Lower bound of the residual, as a share of a joint's torque (rms)."""
_EXACT = 1e-9
"""Smallest residual, as a share of a joint's torque (rms): a log at rest may fit exactly."""
_SECONDS, _LENGTHS = (1.0, 2.5), 5.0
"""Minimum and maximum length of blocks of time [s]; block length in autocorrelation lengths, which other causes increase."""
_UNTOLD = 1e-7
_BEGINS = 6
"""Number of parts of a log between which the first candidates for the beginning of a law lie."""
_ASKEW = np.array([0.31, -0.27, -0.911]) / np.linalg.norm([0.31, -0.27, -0.911])
"""Direction of gravity along no coordinate axis, which makes the groups valid for any mounting."""
_HIGHEST, _SLOWEST = 10.0, 0.1
"""Maximum cut-off [Hz], and maximum speed of Coulomb smoothing."""
_FEWEST, _MOST = 300, 1200
_LEAST_ROWS, _PER_GROUP = 40, 3
"""Minimum number of rows, and of equations per group, for a search for causes."""
_NUMBERS = 5e6  # maximum number of entries of rows
_TOGETHER = 64  # sets of columns per batch, to limit memory


def _inverse(matrix: Array) -> Array:
    """Inverse of I + A with A positive semidefinite, whose eigenvalues are below 1 by rounding error only."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors / np.maximum(values, 1.0)) @ vectors.T)


class CauseFit:
    """Fit of the rows of states, with columns of laws (m, nv) beside those of the groups, and held-out residuals.

    Residuals ``left`` (m, nv) are in units of √(1 + w' C w / σ²), with C the covariance of the parameters from the
    other fifths. This reduces the weight of rows that the other fifths do not determine.
    """

    def __init__(self, states: LogStates, prior: Prior, live: Array, laws: Sequence[Array] = ()) -> None:
        self.states, self.live, self.laws, self.groups = states, live, tuple(laws), prior
        W, tau = self.W, np.asarray(states.measured * live)
        self.tau = tau
        size = np.sqrt((tau**2).mean(axis=0))
        if laws:
            usual = [float(size.max() / max(np.abs(e).max(), 1e-9)) for e in laws]
            prior = Prior(np.append(prior.mean, 0.0 * np.array(usual)), np.append(prior.size, 1e2 * np.array(usual)))
        felt = np.concatenate([states.base.felt, *((e != 0.0).any(axis=0)[:, None] for e in laws)], axis=1)
        edges = np.linspace(0, len(tau), FOLDS + 1).astype(int)
        self.folds = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        parts = [NormalEquations.from_rows(W, tau, felt, rows=fold) for fold in self.folds]
        total = sum(parts[1:], parts[0])
        self.x, sigma = total.solve(prior)
        self.weight = live / np.maximum(sigma, _EXACT * size + 1e-300) ** 2
        self._inverse, self._held = [], []
        for part in [*parts, None]:
            rest = total if part is None else total - part
            A = np.einsum("jkl,j->kl", rest.N, self.weight)
            c = (rest.c * self.weight[:, None]).sum(axis=0)
            scaled = A * prior.size[:, None] * prior.size + np.eye(len(c))
            inverse = prior.size[:, None] * _inverse(scaled) * prior.size
            self._inverse.append(inverse)
            self._held.append(prior.mean + inverse @ (c - A @ prior.mean))
        self.spread = np.ones(tau.shape)
        for f, inverse in zip(self.folds, self._inverse[:-1], strict=True):
            for j in np.flatnonzero(live):
                A = W[f, j][:, felt[j]]
                self.spread[f, j] += self.weight[j] * ((A @ inverse[np.ix_(felt[j], felt[j])]) * A).sum(axis=1)
        self.spread = np.sqrt(np.maximum(self.spread, 1.0))  # less only by rounding error
        left = np.concatenate([tau[f] - W[f] @ x for f, x in zip(self.folds, self._held[:-1], strict=True)])
        self.left = left / self.spread
        self.floor = (_FLOOR * size) ** 2 + 1e-300

    @cached_property
    def W(self) -> Array:
        """(m, nv, r) columns of the groups and of the laws."""
        columns = self.states.columns * (self.states.gain * self.live)[:, None]
        return np.concatenate([columns, *(e[..., None] for e in self.laws)], axis=2) if self.laws else columns

    def release(self, before: CauseFit) -> None:
        """Release columns that another fit does not share, to limit memory; they are computed again when needed."""
        self.__dict__.pop("W", None)
        for name in ("columns", "bodies", "drives") if self.states is not before.states else ():
            self.states.__dict__.pop(name, None)

    def refit(self, states: LogStates, *laws: Array) -> CauseFit:
        """Fit of other states, with additional laws."""
        return CauseFit(states, self.groups, self.live, (*self.laws, *laws))

    @property
    def enough(self) -> bool:
        """True if there are enough rows for a search for causes."""
        count, groups = len(self.tau), self.states.base.count
        return count >= _LEAST_ROWS and count * int(self.live.sum()) >= _PER_GROUP * groups

    @cached_property
    def squares(self) -> Array:
        """(nv,) mean squares of the held-out residuals."""
        return np.asarray((self.left**2).mean(axis=0) + self.floor)

    @cached_property
    def shares(self) -> Array:
        """(nv,) held-out residuals as shares of the torques."""
        return np.sqrt(self.squares / np.maximum((self.tau**2).mean(axis=0), 1e-300)) * self.live

    def gained(self, other: CauseFit) -> float:
        """S of another fit, which includes a cause, against this one."""
        volume = np.log(self.spread / other.spread).mean(axis=0)
        return float((np.log(self.squares / other.squares) + 2.0 * volume)[self.live].sum())

    def gained_by(self, e: Array) -> tuple[Array, Array]:
        """S (g,) of additional columns e (m, nv, g, k), k at a time, with the weights of this fit; coefficients (g, k)."""
        left, beta = self.with_columns(e)
        squares = (left**2).mean(axis=0) + self.floor[:, None]
        return np.log(self.squares[:, None] / squares)[self.live].sum(axis=0), beta

    def gains(self, columns: Sequence[Array]) -> list[tuple[float, Array]]:
        """S and coefficients (k,) of each of several sets of columns (m, nv, k), one set at a time."""
        found = [(0.0, np.zeros(0))] * len(columns)
        for width in {e.shape[2] for e in columns}:
            mine = [c for c, e in enumerate(columns) if e.shape[2] == width]
            for some in (mine[k : k + _TOGETHER] for k in range(0, len(mine), _TOGETHER)):
                S, beta = self.gained_by(np.stack([columns[c] for c in some], axis=2))
                for c, one, coefficients in zip(some, S.tolist(), beta, strict=True):
                    found[c] = one, coefficients
        return found

    def with_columns(self, e: Array) -> tuple[Array, Array]:
        """Held-out residuals (m, nv, g) and coefficients (g, k) with additional columns e (m, nv, g, k), k at a time.

        Columns that are linearly dependent on others in the training rows of a fifth have coefficients of 0.
        """
        v, a, c = [], [], []
        for f in self.folds:
            weighted = e[f] * self.weight[:, None, None]
            flat = weighted.reshape(-1, *e.shape[2:])
            v.append(np.tensordot(self.W[f].reshape(len(flat), -1), flat, (0, 0)))
            a.append(np.einsum("xgk,xgl->gkl", e[f].reshape(flat.shape), flat))
            c.append(np.tensordot(self.tau[f].ravel(), flat, (0, 0)))
        solved, told = [], np.ones(e.shape[2], bool)
        for b, (inverse, x) in enumerate(zip(self._inverse, self._held, strict=True)):
            border, size, right = (sum(part[k] for k in range(FOLDS) if k != b) for part in (v, a, c))
            moved = np.tensordot(inverse, border, 1)
            own = size - np.einsum("rgk,rgl->gkl", border, moved)
            left_over, before = (np.diagonal(each, axis1=1, axis2=2) for each in (own, size))
            told &= np.greater(left_over, _UNTOLD * before).all(axis=1)
            scale = np.sqrt(np.where(left_over > 0.0, left_over, 1.0))
            told &= np.linalg.eigvalsh(own / (scale[:, :, None] * scale[:, None]))[:, 0] > _UNTOLD
            solved.append((own, right - np.tensordot(x, border, 1), moved))
        left, beta = np.repeat(self.left[..., None], e.shape[2], axis=2), np.zeros(e.shape[2:])
        for b, (own, right, moved) in enumerate(solved if told.any() else ()):
            beta[told] = np.linalg.solve(own[told], right[told, :, None])[..., 0]
            if b < FOLDS:
                f = self.folds[b]
                across = e[f] - np.tensordot(self.W[f], moved, 1)
                left[f] -= np.einsum("mjgk,gk->mjg", across, beta) / self.spread[f][..., None]
        return left, beta

    def change(self, e: Array, beta: Array) -> Array:
        """(r,) change of the groups by additional columns (m, nv, k) with coefficients (k,)."""
        v = np.einsum("mjr,mjk,j->rk", self.W, e, self.weight, optimize=True)
        return np.asarray(-(self._inverse[-1] @ v @ beta)[: self.states.base.count])

    @cached_property
    def joint_causes(self) -> list[ScreenedCause]:
        """Laws of the joints and their elasticity, each tested by its column."""
        return _laws_screened(self) if self.enough else []

    def deviation(self, e: Array) -> Array:
        """Standard deviations (k,), by blocks of time, of coefficients of columns (m, nv, k) that this fit contains."""
        v = np.einsum("mjr,mjk,j->rk", self.W, e, self.weight, optimize=True)
        across = e - self.W @ (self._inverse[-1] @ v)
        size = np.linalg.pinv(np.einsum("mjk,mjl,j->kl", across, across, self.weight, optimize=True))
        return self._block_deviation(across @ size)

    def law_deviation(self, count: int) -> Array:
        """Standard deviations of the coefficients of the last ``count`` columns of laws."""
        return self._block_deviation(self.W @ self._inverse[-1][:, -count:])

    def _block_deviation(self, influence: Array) -> Array:
        """Standard deviations (k,) of Σ influence' Λ r, with held-out residuals r; residuals of training rows are too small.

        Returns the larger of two estimates: by blocks of time, and by rows with their autocorrelation length.
        """
        u = np.einsum("mjk,mj,j->mk", influence, self.left * self.spread, self.weight, optimize=True)
        by_blocks = (np.add.reduceat(u, self.blocks, axis=0) ** 2).sum(axis=0)
        return np.sqrt(np.maximum(by_blocks, self.correlation * (u**2).sum(axis=0)))

    @cached_property
    def correlation(self) -> float:
        """Integrated autocorrelation time of the residuals, in rows."""
        return autocorrelation_length(self.left / np.sqrt(self.squares))

    @cached_property
    def blocks(self) -> Array:
        """First rows of blocks of time with a length of five autocorrelation lengths, between 1 and 2.5 s."""
        s = self.states
        step = float(np.median(np.diff(s.time[s.rows]))) if len(s.rows) > 1 else 1.0
        length = max(_SECONDS[0] / step, min(_SECONDS[1] / step, _LENGTHS * self.correlation))
        count = max(2, int(len(self.left) / length))
        return np.linspace(0, len(self.left), count + 1).astype(int)[:-1]

    def sure(self, tried: int) -> float:
        """Student's t that the largest of ``tried`` causes exceeds by chance in 1 % of the logs."""
        return float(student_quantile(max(1.0, len(self.blocks) - 1.0), 1.0 - _CHANCE / max(1, tried)))

    def t_value(self, before: CauseFit) -> float:
        """Student's t of the differences of log-likelihood, by blocks, against the fit ``before``, without the cause."""
        a, b = before.squares, self.squares
        volume = 2.0 * np.log(before.spread / self.spread)
        d = 0.5 * (before.left**2 / a - self.left**2 / b + np.log(a / b) + volume)[:, self.live].sum(axis=1)
        sums = np.add.reduceat(d, self.blocks)
        return float(sums.mean() / max(sums.std(ddof=1) / np.sqrt(len(sums)), 1e-300))


def log_fit(
    unknown: UnknownParameters, samples: Sequence[SteadySamples], settings: FitSettings, dead: Array
) -> CauseFit:
    """Fit to the rows of logs for the search for causes."""
    base = askew_base(unknown)
    nv, cutoff = unknown.model.nv, min(settings.cutoff, _HIGHEST)
    most = max(_FEWEST, min(_MOST, _NUMBERS / (nv * base.count)))
    speed = np.minimum(settings.friction_speed, _SLOWEST)
    s = LogStates.from_samples(base, samples, cutoff, speed, most).changed(shift=settings.shift)
    size = [np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-6) for x in (s.tau, s.dq, s.ddq)]
    sizes = unknown.scales(*(np.maximum(x, 1e-2 * np.median(x)) for x in size))
    prior = Prior(base.project(unknown.file_values), base.weak_sizes(sizes))
    return CauseFit(s, prior, ~dead)


def askew_base(unknown: UnknownParameters) -> BaseParameters:
    """Base parameters for a tilted mounting, which are valid for any mounting."""
    return BaseParameters.from_unknowns(unknown, gravity=np.linalg.norm(unknown.model.gravity) * _ASKEW)


# ── Screening of causes by their columns


@dataclass(frozen=True, eq=False)
class ScreenedCause:
    """Cause screened by its columns e (m, nv, k), with β and S at the weights of the fit without it."""

    S: float
    cause: Cause | Law
    beta: Array
    e: Array


def screened(fit: CauseFit, tried: Iterable[Cause]) -> list[ScreenedCause]:
    """Screen causes with a value by their columns at each of their start values.

    Columns at the value 0 are tested together. Each distant start has a fit of its own, which is released before the next.
    """
    s, found, near = fit.states, list[ScreenedCause](), list[int]()
    for cause in tried:
        for start in cause.starts:
            beta = np.full(cause.size, start)
            if start == 0.0:
                near.append(len(found))
                found.append(ScreenedCause(0.0, cause, beta, cause_columns(fit, s, cause, beta)))
                continue
            at = fit.refit(cause.correct(s, beta))
            e = cause_columns(at, s, cause, beta)
            S, step = at.gains([e])[0]
            found.append(ScreenedCause(fit.gained(at) + S, cause, beta + step, e))
    for k, (S, step) in zip(near, fit.gains([found[k].e for k in near]), strict=True):
        found[k] = replace(found[k], S=S, beta=found[k].beta + step)
    return found


def cause_columns(fit: CauseFit, s: LogStates, cause: Cause, beta: Array) -> Array:
    """-d(residual)/dβ (m, nv, k) by central differences, at the unknowns of the fit."""
    x, found = fit.x[: fit.W.shape[2] - len(fit.laws)], []
    for axis in np.eye(cause.size):
        ends = [cause.correct(s, beta + way * cause.step * axis) for way in (1.0, -1.0)]
        plus, minus = (one.predicted(x) - one.measured for one in ends)
        found.append((plus - minus) / (2.0 * cause.step) * fit.live)
    return np.stack(found, axis=-1)


def law_columns(fit: CauseFit, laws: Iterable[Law], fitted: FittedTorques) -> list[Array]:
    """Columns (m, nv, k) of laws in the rows of a fit, low-passed like the torques."""
    s, found, alike = fit.states, list[Array](), dict[Any, Array]()
    for law in laws:
        key = law.values, law.since
        if key not in alike:  # filter laws of several joints once
            alike[key] = s.filtered(law.everywhere(s, fitted))[s.rows]
        mine = fit.live & np.isin(np.arange(len(fit.live)), law.joints)
        found.append(alike[key] * mine[:, None])
    return found


def screened_laws(fit: CauseFit, laws: Iterable[Law]) -> list[ScreenedCause]:
    """Screen laws of the whole log, each by its columns."""
    laws = list(laws)
    fitted = FittedTorques.from_groups(fit.states, fit.x[: fit.states.base.count])
    told = [(law, e) for law, e in zip(laws, law_columns(fit, laws, fitted), strict=True) if e.any()]
    gained = fit.gains([e for _, e in told])
    return [ScreenedCause(S, law, beta, e) for (law, e), (S, beta) in zip(told, gained, strict=True)]


def _laws_screened(fit: CauseFit) -> list[ScreenedCause]:
    """Screen the laws of the joints and their elasticity, each by its column."""
    s = fit.states
    torque = s.torques(fit.x[: s.base.count])[0]
    return screened_laws(fit, causes.laws(s)) + screened(fit, causes.compliances(s, s.filtered(torque)))


def screened_changes(fit: CauseFit) -> list[ScreenedCause]:
    """Screen laws that begin within the log, each from the row at which its columns gain most."""
    s, found = fit.states, list[ScreenedCause]()
    fitted = FittedTorques.from_groups(s, fit.x[: s.base.count])
    laws = list(causes.changes(s))
    told = [(law, e) for law, e in zip(laws, law_columns(fit, laws, fitted), strict=True) if e.any()]
    for (law, e), (S, beta, begin) in zip(told, _best_begins(fit, [e for _, e in told]), strict=True):
        k = int(s.rows[begin])
        after = (np.arange(len(e)) >= begin)[:, None, None]
        found.append(ScreenedCause(S, replace(law, since=(int(s.piece[k]), float(s.time[k]))), beta, e * after))
    return found


def _best_begins(fit: CauseFit, columns: Sequence[Array]) -> list[tuple[float, Array, int]]:
    """S, coefficients and first row of each of several columns e (m, nv, k) that begin within the log, by step halving."""
    m = len(fit.tau)
    rows, step = np.arange(m)[:, None, None], m // _BEGINS
    best = [(-np.inf, np.zeros(0), 0)] * len(columns)
    tried = [(c, int(begin)) for c in range(len(columns)) for begin in step * np.arange(1, _BEGINS)]
    while tried:
        gained = fit.gains([columns[c] * (rows >= begin) for c, begin in tried])
        for (c, begin), (S, beta) in zip(tried, gained, strict=True):
            best[c] = max(best[c], (S, beta, begin), key=lambda one: one[0])
        step //= 2
        worth = [c for c, (S, _, _) in enumerate(best) if S > 0.5 * LEAST_S and step]
        tried = [(c, begin) for c in worth for begin in (best[c][2] - step, best[c][2] + step) if 0 < begin < m]
    return best
