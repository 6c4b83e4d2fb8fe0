"""Least-squares fit of log rows for the search for causes, and the gain in S of additional columns on held-out rows.

With s_j² the mean square of the residual of joint j in 5-fold cross-validation over time, columns of a cause gain

    S = Σ_j log(s_j² without it / s_j² with it),

the criterion by which settings are chosen too. Each joint has equal weight.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import Any

import numpy as np

from ...core.estimation.covariance import autocorrelation_length, student_quantile
from ...core.estimation.cross_validation import FOLDS
from ...core.estimation.least_squares import NormalEquations, Prior
from ...core.typing import Array
from ..hyperparameters import FitSettings
from ..parameters import BaseParameters, UnknownParameters
from ..rows import SteadySamples
from . import causes
from .causes import Cause, FittedTorques, Law
from .log_states import LogStates

LEAST_S = 0.25
"""S from which a cause is reported: no S of 56 clean logs exceeded 0.19."""
_MAX_CHANCE = 0.01
_FLOOR = 0.005
"""Lower bound of the residual, as a share of a joint's torque (rms)."""
_MIN_RESIDUAL_SHARE = 1e-9
"""Smallest residual, as a share of a joint's torque (rms): a log at rest may fit exactly."""
_SECONDS, _LENGTHS = (1.0, 2.5), 5.0
"""Minimum and maximum length of blocks of time [s]; block length in autocorrelation lengths, which other causes increase."""
_MIN_UNSPANNED_SHARE = 1e-7
_LOG_PARTS = 6
"""Number of parts of a log between which the first candidates for the beginning of a law lie."""
_ASKEW = np.array([0.31, -0.27, -0.911]) / np.linalg.norm([0.31, -0.27, -0.911])
"""Direction of gravity along no coordinate axis, which makes the groups valid for any mounting."""
_MAX_CUTOFF, _MAX_FRICTION_SPEED = 10.0, 0.1
"""Maximum cut-off [Hz], and maximum speed of Coulomb smoothing."""
_MIN_FIT_ROWS, _MAX_FIT_ROWS = 300, 1200
_MIN_SEARCH_ROWS, _PER_GROUP = 40, 3
"""Minimum number of rows, and of equations per group, for a search for causes."""
_MAX_ENTRIES = 5e6  # maximum number of entries of rows
_BATCH_SIZE = 64  # sets of columns per batch, to limit memory


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
        W, tau = self.W, np.asarray(states.measured_torques * live)
        self.tau = tau
        size = np.sqrt((tau**2).mean(axis=0))
        felt = states.base.felt
        for e in laws:
            law_size = float(size.max() / max(np.abs(e).max(), 1e-9))
            prior = Prior(np.append(prior.mean, 0.0), np.append(prior.size, 1e2 * law_size))
            felt = np.column_stack([felt, (e != 0.0).any(axis=0)])
        edges = np.linspace(0, len(tau), FOLDS + 1).astype(int).tolist()
        self.folds = [slice(a, b) for a, b in pairwise(edges)]
        parts = [NormalEquations.from_rows(W, tau, felt, rows=fold) for fold in self.folds]
        total = sum(parts[1:], parts[0])
        self.x, sigma = total.solve(prior)
        self.weight = live / np.maximum(sigma, _MIN_RESIDUAL_SHARE * size + 1e-300) ** 2
        self._solve_training_rows([*(total - part for part in parts), total], prior)
        self.spread = np.ones(tau.shape)
        residual = np.empty(tau.shape)
        # the last inverse and the last groups are those of all rows
        for fold, inverse, x in zip(self.folds, self._inverse[:-1], self._held[:-1], strict=True):
            for j in np.flatnonzero(live):
                A = W[fold, j][:, felt[j]]
                self.spread[fold, j] += self.weight[j] * ((A @ inverse[np.ix_(felt[j], felt[j])]) * A).sum(axis=1)
            residual[fold] = tau[fold] - W[fold] @ x
        self.spread = np.sqrt(np.maximum(self.spread, 1.0))  # less only by rounding error
        self.left = residual / self.spread
        self.floor = (_FLOOR * size) ** 2 + 1e-300

    def _solve_training_rows(self, training: Sequence[NormalEquations], prior: Prior) -> None:
        """Covariance and groups of each of several sets of training rows: those without a fifth, and all rows."""
        self._inverse, self._held = list[Array](), list[Array]()
        for rows in training:
            A = np.einsum("jkl,j->kl", rows.N, self.weight)
            c = (rows.c * self.weight[:, None]).sum(axis=0)
            scaled = A * prior.size[:, None] * prior.size + np.eye(len(c))
            inverse = prior.size[:, None] * _inverse(scaled) * prior.size
            self._inverse.append(inverse)
            self._held.append(prior.mean + inverse @ (c - A @ prior.mean))

    @cached_property
    def W(self) -> Array:
        """(m, nv, r) columns of the groups and of the laws."""
        columns = self.states.columns * (self.states.gain * self.live)[:, None]
        if not self.laws:
            return columns
        return np.concatenate([columns, np.stack(self.laws, axis=2)], axis=2)

    def release(self, before: CauseFit) -> None:
        """Release columns that another fit does not share, to limit memory; they are computed again when needed."""
        self.__dict__.pop("W", None)
        if self.states is not before.states:
            for name in ("columns", "bodies", "drives"):
                self.states.__dict__.pop(name, None)

    def refit(self, states: LogStates, *laws: Array) -> CauseFit:
        """Fit of other states, with additional laws."""
        return CauseFit(states, self.groups, self.live, (*self.laws, *laws))

    @property
    def enough(self) -> bool:
        """True if there are enough rows for a search for causes."""
        count, groups = len(self.tau), self.states.base.count
        return count >= _MIN_SEARCH_ROWS and count * int(self.live.sum()) >= _PER_GROUP * groups

    @cached_property
    def squares(self) -> Array:
        """(nv,) mean squares of the held-out residuals."""
        return np.asarray((self.left**2).mean(axis=0) + self.floor)

    @cached_property
    def shares(self) -> Array:
        """(nv,) held-out residuals as shares of the torques."""
        return np.sqrt(self.squares / np.maximum((self.tau**2).mean(axis=0), 1e-300)) * self.live

    def gain(self, other: CauseFit) -> float:
        """S of another fit, which includes a cause, against this one."""
        volume = np.log(self.spread / other.spread).mean(axis=0)
        return float((np.log(self.squares / other.squares) + 2.0 * volume)[self.live].sum())

    def gains_of_columns(self, e: Array) -> tuple[Array, Array]:
        """S (g,) of additional columns e (m, nv, g, k), k at a time, with the weights of this fit; coefficients (g, k)."""
        left, beta = self.with_columns(e)
        squares = (left**2).mean(axis=0) + self.floor[:, None]
        return np.log(self.squares[:, None] / squares)[self.live].sum(axis=0), beta

    def gains_of_sets(self, columns: Sequence[Array]) -> list[tuple[float, Array]]:
        """S and coefficients (k,) of each of several sets of columns (m, nv, k), one set at a time."""
        found = [(0.0, np.zeros(0))] * len(columns)
        widths = np.array([e.shape[2] for e in columns])
        for width in set(widths.tolist()):
            sets = np.flatnonzero(widths == width)
            for batch in np.split(sets, range(_BATCH_SIZE, len(sets), _BATCH_SIZE)):
                S, beta = self.gains_of_columns(np.stack([columns[c] for c in batch], axis=2))
                for c, gain, coefficients in zip(batch, S.tolist(), beta, strict=True):
                    found[c] = gain, coefficients
        return found

    def with_columns(self, e: Array) -> tuple[Array, Array]:
        """Held-out residuals (m, nv, g) and coefficients (g, k) with additional columns e (m, nv, g, k), k at a time.

        Columns that are linearly dependent on others in the training rows of a fifth have coefficients of 0.
        """
        borders, sizes, products = list[Array](), list[Array](), list[Array]()
        for fold in self.folds:
            weighted = e[fold] * self.weight[:, None, None]
            flat = weighted.reshape(-1, *e.shape[2:])
            borders.append(np.tensordot(self.W[fold].reshape(len(flat), -1), flat, (0, 0)))
            sizes.append(np.einsum("xgk,xgl->gkl", e[fold].reshape(flat.shape), flat))
            products.append(np.tensordot(self.tau[fold].ravel(), flat, (0, 0)))
        solved = list[tuple[Array, Array, Array]]()
        independent = np.ones(e.shape[2], bool)
        for b, (inverse, x) in enumerate(zip(self._inverse, self._held, strict=True)):
            border, size, product = (_sum_without(parts, b) for parts in (borders, sizes, products))
            moved = np.tensordot(inverse, border, 1)
            own = size - np.einsum("rgk,rgl->gkl", border, moved)
            own_diagonal, diagonal = np.diagonal(own, axis1=1, axis2=2), np.diagonal(size, axis1=1, axis2=2)
            independent &= np.greater(own_diagonal, _MIN_UNSPANNED_SHARE * diagonal).all(axis=1)
            scale = np.sqrt(np.where(own_diagonal > 0.0, own_diagonal, 1.0))
            scaled = own / (scale[:, :, None] * scale[:, None])
            independent &= np.linalg.eigvalsh(scaled)[:, 0] > _MIN_UNSPANNED_SHARE
            solved.append((own, product - np.tensordot(x, border, 1), moved))
        residual, beta = np.repeat(self.left[..., None], e.shape[2], axis=2), np.zeros(e.shape[2:])
        if not independent.any():
            return residual, beta
        for b, (own, product, moved) in enumerate(solved):
            beta[independent] = np.linalg.solve(own[independent], product[independent, :, None])[..., 0]
            if b < FOLDS:
                fold = self.folds[b]
                across = e[fold] - np.tensordot(self.W[fold], moved, 1)
                residual[fold] -= np.einsum("mjgk,gk->mjg", across, beta) / self.spread[fold][..., None]
        return residual, beta

    def change(self, e: Array, beta: Array) -> Array:
        """(r,) change of the groups by additional columns (m, nv, k) with coefficients (k,)."""
        v = np.einsum("mjr,mjk,j->rk", self.W, e, self.weight, optimize=True)
        return np.asarray(-(self._inverse[-1] @ v @ beta)[: self.states.base.count])

    @cached_property
    def joint_causes(self) -> list[ScreenedCause]:
        """Laws of the joints and their elasticity, each tested by its column."""
        return _screen_laws_of_joints(self) if self.enough else []

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

    def critical_t(self, tried: int) -> float:
        """Student's t that the largest of ``tried`` causes exceeds by chance in 1 % of the logs."""
        return float(student_quantile(max(1.0, len(self.blocks) - 1.0), 1.0 - _MAX_CHANCE / max(1, tried)))

    def t_value(self, before: CauseFit) -> float:
        """Student's t of the differences of log-likelihood, by blocks, against the fit ``before``, without the cause."""
        a, b = before.squares, self.squares
        volume = 2.0 * np.log(before.spread / self.spread)
        d = 0.5 * (before.left**2 / a - self.left**2 / b + np.log(a / b) + volume)[:, self.live].sum(axis=1)
        sums = np.add.reduceat(d, self.blocks)
        return float(sums.mean() / max(sums.std(ddof=1) / np.sqrt(len(sums)), 1e-300))


def _sum_without(parts: Sequence[Array], left_out: int) -> Array:
    """Sum over the fifths without one; over all of them if there is no fifth of that number."""
    return np.asarray(sum(part for k, part in enumerate(parts) if k != left_out))


def log_fit(
    unknown: UnknownParameters, samples: Sequence[SteadySamples], settings: FitSettings, dead: Array
) -> CauseFit:
    """Fit to the rows of logs for the search for causes."""
    base = askew_base(unknown)
    nv, cutoff = unknown.model.nv, min(settings.cutoff, _MAX_CUTOFF)
    most_rows = max(_MIN_FIT_ROWS, min(_MAX_FIT_ROWS, _MAX_ENTRIES / (nv * base.count)))
    friction_speed = np.minimum(settings.friction_speed, _MAX_FRICTION_SPEED)
    s = LogStates.from_samples(base, samples, cutoff, friction_speed, most_rows).with_fields(shift=settings.shift)
    sizes = unknown.scales(_typical(s.tau), _typical(s.dq), _typical(s.ddq))
    prior = Prior(base.project(unknown.file_values), base.weak_sizes(sizes))
    return CauseFit(s, prior, ~dead)


def _typical(x: Array) -> Array:
    """(nv,) typical values of columns x (n, nv), above 0: not far below those of the other joints."""
    size = np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-6)
    return np.maximum(size, 1e-2 * np.median(size))


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


def screen_causes(fit: CauseFit, candidates: Iterable[Cause]) -> list[ScreenedCause]:
    """Screen causes with a value by their columns at each of their start values.

    Columns at the value 0 are tested together. Each distant start has a fit of its own, which is released before the next.
    """
    s = fit.states
    found = list[ScreenedCause]()
    at_zero = list[int]()
    for cause in candidates:
        for start in cause.starts:
            beta = np.full(cause.size, start)
            if start == 0.0:
                at_zero.append(len(found))
                found.append(ScreenedCause(0.0, cause, beta, cause_columns(fit, s, cause, beta)))
                continue
            refit = fit.refit(cause.correct(s, beta))
            e = cause_columns(refit, s, cause, beta)
            S, step = refit.gains_of_sets([e])[0]
            found.append(ScreenedCause(fit.gain(refit) + S, cause, beta + step, e))
    gains = fit.gains_of_sets([found[k].e for k in at_zero])
    for k, (S, step) in zip(at_zero, gains, strict=True):
        found[k] = replace(found[k], S=S, beta=found[k].beta + step)
    return found


def cause_columns(fit: CauseFit, s: LogStates, cause: Cause, beta: Array) -> Array:
    """-d(residual)/dβ (m, nv, k) by central differences, at the unknowns of the fit."""
    x = fit.x[: fit.W.shape[2] - len(fit.laws)]

    def negative_residual(beta: Array) -> Array:
        corrected = cause.correct(s, beta)
        return corrected.predicted_torques(x) - corrected.measured_torques

    columns = list[Array]()
    for step in cause.step * np.eye(cause.size):
        difference = negative_residual(beta + step) - negative_residual(beta - step)
        columns.append(difference / (2.0 * cause.step) * fit.live)
    return np.stack(columns, axis=-1)


def law_columns(fit: CauseFit, laws: Iterable[Law], fitted: FittedTorques) -> list[Array]:
    """Columns (m, nv, k) of laws in the rows of a fit, low-passed like the torques."""
    s = fit.states
    columns = list[Array]()
    filtered = dict[Any, Array]()
    for law in laws:
        key = law.values, law.since
        if key not in filtered:  # filter laws of several joints once
            filtered[key] = s.low_passed(law.everywhere(s, fitted))[s.rows]
        own_joints = fit.live & np.isin(np.arange(len(fit.live)), law.joints)
        columns.append(filtered[key] * own_joints[:, None])
    return columns


def screen_laws(fit: CauseFit, laws: Iterable[Law]) -> list[ScreenedCause]:
    """Screen laws of the whole log, each by its columns."""
    acting, columns = _acting_laws(fit, list(laws))
    found = list[ScreenedCause]()
    for law, e, (S, beta) in zip(acting, columns, fit.gains_of_sets(columns), strict=True):
        found.append(ScreenedCause(S, law, beta, e))
    return found


def _acting_laws(fit: CauseFit, laws: Sequence[Law]) -> tuple[list[Law], list[Array]]:
    """Laws with columns other than 0, and their columns (m, nv, k)."""
    fitted = FittedTorques.from_groups(fit.states, fit.x[: fit.states.base.count])
    acting, columns = list[Law](), list[Array]()
    for law, e in zip(laws, law_columns(fit, laws, fitted), strict=True):
        if e.any():
            acting.append(law)
            columns.append(e)
    return acting, columns


def _screen_laws_of_joints(fit: CauseFit) -> list[ScreenedCause]:
    """Screen the laws of the joints and their elasticity, each by its column."""
    s = fit.states
    torque = s.torques(fit.x[: s.base.count])[0]
    return screen_laws(fit, causes.laws(s)) + screen_causes(fit, causes.compliances(s, s.low_passed(torque)))


def screen_changes(fit: CauseFit) -> list[ScreenedCause]:
    """Screen laws that begin within the log, each from the row at which its columns gain most."""
    s, found = fit.states, list[ScreenedCause]()
    laws, columns = _acting_laws(fit, list(causes.changes(s)))
    for law, e, (S, beta, begin) in zip(laws, columns, _best_begins(fit, columns), strict=True):
        k = int(s.rows[begin])
        after = (np.arange(len(e)) >= begin)[:, None, None]
        found.append(ScreenedCause(S, replace(law, since=(int(s.piece[k]), float(s.time[k]))), beta, e * after))
    return found


def _best_begins(fit: CauseFit, columns: Sequence[Array]) -> list[tuple[float, Array, int]]:
    """S, coefficients and first row of each of several columns e (m, nv, k) that begin within the log, by step halving."""
    m = len(fit.tau)
    rows, step = np.arange(m)[:, None, None], m // _LOG_PARTS
    best = [(-np.inf, np.zeros(0), 0)] * len(columns)
    begins = (step * np.arange(1, _LOG_PARTS)).tolist()
    trials = list(product(range(len(columns)), begins))
    while trials:
        gains = fit.gains_of_sets([columns[c] * (rows >= begin) for c, begin in trials])
        for (c, begin), (S, beta) in zip(trials, gains, strict=True):
            best[c] = max(best[c], (S, beta, begin), key=lambda one: one[0])
        step //= 2
        trials = []
        for c, (S, _, begin) in enumerate(best):
            if S > 0.5 * LEAST_S and step:
                near = (begin - step, begin + step)
                trials += [(c, begin) for begin in near if 0 < begin < m]
    return best
