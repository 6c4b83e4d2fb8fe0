"""Least-squares fit of log rows for the search for causes, and the significance S of additional columns on held-out rows.

With s_j² the mean square of the residual of joint j in 5-fold cross-validation over time, a cause has the significance

    S = Σ_j log(s_j² without it / s_j² with it),

in which each joint has equal weight. Settings are chosen by the same criterion.
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
"""Chance that some cause of a log without causes exceeds the critical t."""
_MIN_HELD_OUT_SHARE = 0.005
"""Residual, as a share of a joint's torque (rms), that is added to held-out residuals, so that tiny residuals do not matter."""
_MIN_RESIDUAL_SHARE = 1e-9
"""Smallest residual, as a share of a joint's torque (rms): a log at rest may fit exactly."""
_MAX_COEFFICIENT_RATIO = 1e2
"""Plausible coefficient of a law, in units of the coefficient that gives the torques' size."""
# Bounds of the length of blocks of time [s]; other causes increase the autocorrelation length.
_MIN_BLOCK_SECONDS = 1.0
_MAX_BLOCK_SECONDS = 2.5
_BLOCK_LENGTHS = 5.0
"""Length of a block of time, in autocorrelation lengths."""
_MIN_UNSPANNED_SHARE = 1e-7
"""Share of a column's squares that other columns do not span, below which it is dependent."""
_LOG_PARTS = 6
"""Number of parts of a log; the first candidates for the beginning of a law are the rows between two parts."""
_ASKEW = np.array([0.31, -0.27, -0.911]) / np.linalg.norm([0.31, -0.27, -0.911])
"""Direction of gravity along no coordinate axis, which makes the groups valid for any mounting."""
_MAX_CUTOFF = 10.0
"""Maximum cut-off [Hz]."""
_MAX_FRICTION_SPEED = 0.1
"""Maximum speed of Coulomb smoothing [rad/s, m/s]."""
# Bounds of the largest number of rows of a fit.
_MIN_FIT_ROWS = 300
_MAX_FIT_ROWS = 1200
_MIN_SEARCH_ROWS = 40
"""Minimum number of rows for a search for causes."""
_MIN_EQUATIONS_OF_GROUP = 3
"""Minimum number of equations per group for a search for causes."""
_MAX_ENTRIES = 5e6  # maximum number of entries of rows
_BATCH_SIZE = 64  # sets of columns per batch, to limit memory


def _inverse(matrix: Array) -> Array:
    """Inverse of I + A with A positive semidefinite; eigenvalues below 1 are rounding errors, and count as 1."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors / np.maximum(values, 1.0)) @ vectors.T)


class CauseFit:
    """Fit of the rows of states, with columns of laws (m, nv) in addition to those of the groups, and held-out residuals.

    Attributes
    ----------
    groups : Prior, prior of the groups
    live : (nv,) mask of live joints, which have a torque
    x : (r,) array, groups and coefficients of laws
    weight : (nv,) array, inverse variances of the residuals of training rows
    folds : list of slice, rows of each fifth
    spread : (m, nv) array, √(1 + w' C w / σ²) with C the covariance of the parameters from the other fifths
    left : (m, nv) array, held-out residuals left over, divided by ``spread``: rows that the other fifths do not determine
        count less
    floor : (nv,) array, squares that are added to the mean squares of ``left``
    """

    def __init__(self, states: LogStates, prior: Prior, live: Array, laws: Sequence[Array] = ()) -> None:
        self.states = states
        self.live = live
        self.laws = tuple(laws)
        self.groups = prior
        W = self.W
        tau = np.asarray(states.measured_torques * live)
        self.tau = tau
        torque_size = np.sqrt((tau**2).mean(axis=0))  # rms of each joint
        felt = states.base.felt  # (nv, r), columns that act on each joint
        for e in laws:
            coefficient_size = float(torque_size.max() / max(np.abs(e).max(), 1e-9))
            size = _MAX_COEFFICIENT_RATIO * coefficient_size
            prior = Prior(np.append(prior.mean, 0.0), np.append(prior.size, size))
            acts_on_joint = (e != 0.0).any(axis=0)
            felt = np.column_stack([felt, acts_on_joint])
        edges = np.linspace(0, len(tau), FOLDS + 1).astype(int).tolist()
        self.folds = [slice(a, b) for a, b in pairwise(edges)]
        fifths = [NormalEquations.from_rows(W, tau, felt, rows=fold) for fold in self.folds]
        total = sum(fifths[1:], fifths[0])
        self.x, sigma = total.solve(prior)
        self.weight = live / np.maximum(sigma, _MIN_RESIDUAL_SHARE * torque_size + 1e-300) ** 2
        training_rows = [total - fifth for fifth in fifths]
        self._solve_training_rows([*training_rows, total], prior)
        squared_spread = np.ones(tau.shape)
        residual = np.empty(tau.shape)
        # The last inverse and the last solution are those of all rows.
        for fold, inverse, x in zip(self.folds, self._inverses[:-1], self._solutions[:-1], strict=True):
            for j in np.flatnonzero(live):
                A = W[fold, j][:, felt[j]]
                C = inverse[np.ix_(felt[j], felt[j])]
                squared_spread[fold, j] += self.weight[j] * ((A @ C) * A).sum(axis=1)
            residual[fold] = tau[fold] - W[fold] @ x
        self.spread = np.sqrt(np.maximum(squared_spread, 1.0))  # less only by rounding error
        self.left = residual / self.spread
        self.floor = (_MIN_HELD_OUT_SHARE * torque_size) ** 2 + 1e-300

    def _solve_training_rows(self, training: Sequence[NormalEquations], prior: Prior) -> None:
        """Set covariance and parameters for each set of training rows: without one of the fifths, and, at last, all rows."""
        self._inverses: list[Array] = []
        self._solutions: list[Array] = []
        for rows in training:
            A = np.einsum("jkl,j->kl", rows.N, self.weight)
            c = (rows.c * self.weight[:, None]).sum(axis=0)
            scaled = A * prior.size[:, None] * prior.size + np.eye(len(c))
            inverse = prior.size[:, None] * _inverse(scaled) * prior.size
            self._inverses.append(inverse)
            self._solutions.append(prior.mean + inverse @ (c - A @ prior.mean))

    @cached_property
    def W(self) -> Array:
        """(m, nv, r) columns of the groups and of the laws."""
        columns = self.states.columns * (self.states.gain * self.live)[:, None]
        if not self.laws:
            return columns
        return np.concatenate([columns, np.stack(self.laws, axis=2)], axis=2)

    def release(self, before: CauseFit) -> None:
        """Release columns that the fit ``before`` does not share, to limit memory; they are computed again when needed."""
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
        row_count = len(self.tau)
        equation_count = row_count * int(self.live.sum())
        return row_count >= _MIN_SEARCH_ROWS and equation_count >= _MIN_EQUATIONS_OF_GROUP * self.states.base.count

    @cached_property
    def squares(self) -> Array:
        """(nv,) mean squares of the held-out residuals."""
        return np.asarray((self.left**2).mean(axis=0) + self.floor)

    @cached_property
    def shares(self) -> Array:
        """(nv,) held-out residuals as shares of the torques."""
        squared_torques = np.maximum((self.tau**2).mean(axis=0), 1e-300)
        return np.sqrt(self.squares / squared_torques) * self.live

    def gain(self, other: CauseFit) -> float:
        """S of another fit, which includes a cause, against this one."""
        # Residuals are divided by their spreads; the second term restores them.
        spread_term = np.log(self.spread / other.spread).mean(axis=0)
        gain_of_joints = np.log(self.squares / other.squares) + 2.0 * spread_term
        return float(gain_of_joints[self.live].sum())

    def gains_of_columns(self, e: Array) -> tuple[Array, Array]:
        """S (g,) and coefficients (g, k) of g sets of k additional columns e (m, nv, g, k), with the weights of this fit."""
        left, beta = self.with_columns(e)
        squares = (left**2).mean(axis=0) + self.floor[:, None]
        gains_of_joints = np.log(self.squares[:, None] / squares)
        return gains_of_joints[self.live].sum(axis=0), beta

    def gains_of_sets(self, columns: Sequence[Array]) -> list[tuple[float, Array]]:
        """S and coefficients (k,) of several sets of columns (m, nv, k), each tested alone."""
        S_and_beta = [(0.0, np.zeros(0))] * len(columns)
        widths = np.array([e.shape[2] for e in columns])
        for width in set(widths.tolist()):
            sets = np.flatnonzero(widths == width)  # sets of one width together
            for batch in np.split(sets, range(_BATCH_SIZE, len(sets), _BATCH_SIZE)):
                stacked_columns = np.stack([columns[index] for index in batch], axis=2)
                gains, coefficients = self.gains_of_columns(stacked_columns)
                for index, S, beta in zip(batch, gains.tolist(), coefficients, strict=True):
                    S_and_beta[index] = S, beta
        return S_and_beta

    def with_columns(self, e: Array) -> tuple[Array, Array]:
        """Held-out residuals (m, nv, g) and coefficients (g, k) with g sets of k additional columns e (m, nv, g, k).

        Each set is added alone. Sets with columns that are linearly dependent on others in the training rows of a fifth have
        coefficients of 0. With Λ the weights, the normal equations of a fit with columns e are, after elimination of the
        other parameters by their inverse C,

            (e' Λ e - e' Λ W C W' Λ e) β = e' Λ τ - e' Λ W x
        """
        W_e: list[Array] = []  # W' Λ e of each fifth
        e_e: list[Array] = []  # e' Λ e of each fifth
        tau_e: list[Array] = []  # τ' Λ e of each fifth
        for fold in self.folds:
            weighted_e = e[fold] * self.weight[:, None, None]
            flat_e = weighted_e.reshape(-1, *e.shape[2:])
            flat_W = self.W[fold].reshape(len(flat_e), -1)
            W_e.append(np.tensordot(flat_W, flat_e, (0, 0)))
            e_e.append(np.einsum("xgk,xgl->gkl", e[fold].reshape(flat_e.shape), flat_e))
            tau_e.append(np.tensordot(self.tau[fold].ravel(), flat_e, (0, 0)))
        equations = list[tuple[Array, Array, Array]]()  # both sides, and C W' Λ e, for each set of training rows
        is_independent = np.ones(e.shape[2], bool)
        for b, (inverse, x) in enumerate(zip(self._inverses, self._solutions, strict=True)):
            border = _sum_without(W_e, b)
            square = _sum_without(e_e, b)
            product = _sum_without(tau_e, b)
            projection = np.tensordot(inverse, border, 1)  # C W' Λ e
            left_side = square - np.einsum("rgk,rgl->gkl", border, projection)
            diagonal = np.diagonal(left_side, axis1=1, axis2=2)
            full_diagonal = np.diagonal(square, axis1=1, axis2=2)
            is_independent &= np.greater(diagonal, _MIN_UNSPANNED_SHARE * full_diagonal).all(axis=1)
            scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
            scaled_left_side = left_side / (scale[:, :, None] * scale[:, None])
            smallest_eigenvalues = np.linalg.eigvalsh(scaled_left_side)[:, 0]
            is_independent &= smallest_eigenvalues > _MIN_UNSPANNED_SHARE
            right_side = product - np.tensordot(x, border, 1)
            equations.append((left_side, right_side, projection))
        residual = np.repeat(self.left[..., None], e.shape[2], axis=2)
        beta = np.zeros(e.shape[2:])
        if not is_independent.any():
            return residual, beta
        for b, (left_side, right_side, projection) in enumerate(equations):
            beta_column = np.linalg.solve(left_side[is_independent], right_side[is_independent, :, None])
            beta[is_independent] = beta_column[..., 0]
            if b < FOLDS:  # the last equations, of all rows, give only the coefficients
                fold = self.folds[b]
                unspanned = e[fold] - np.tensordot(self.W[fold], projection, 1)
                residual[fold] -= np.einsum("mjgk,gk->mjg", unspanned, beta) / self.spread[fold][..., None]
        return residual, beta

    def change(self, e: Array, beta: Array) -> Array:
        """(r,) change of the groups by additional columns (m, nv, k) with coefficients (k,)."""
        W_e = np.einsum("mjr,mjk,j->rk", self.W, e, self.weight, optimize=True)
        x_change = -(self._inverses[-1] @ W_e @ beta)
        return np.asarray(x_change[: self.states.base.count])

    @cached_property
    def joint_causes(self) -> list[ScreenedCause]:
        """Laws of the joints and their elasticity, each tested by its column; none if there are too few rows."""
        if not self.enough:
            return []
        return _screen_laws_of_joints(self)

    def deviation(self, e: Array) -> Array:
        """Standard deviations (k,), by blocks of time, of coefficients of columns (m, nv, k) beside those of this fit."""
        W_e = np.einsum("mjr,mjk,j->rk", self.W, e, self.weight, optimize=True)
        unspanned = e - self.W @ (self._inverses[-1] @ W_e)
        covariance = np.linalg.pinv(np.einsum("mjk,mjl,j->kl", unspanned, unspanned, self.weight, optimize=True))
        return self._block_deviation(unspanned @ covariance)

    def law_deviation(self, count: int) -> Array:
        """Standard deviations of the coefficients of the last ``count`` columns of laws."""
        return self._block_deviation(self.W @ self._inverses[-1][:, -count:])

    def _block_deviation(self, influence: Array) -> Array:
        """Standard deviations (k,) of Σ influence' Λ r with the residuals r.

        r are the held-out residuals, since residuals of training rows are too small. Of two estimates the larger is returned:
        by blocks of time, and by rows with their autocorrelation length.
        """
        residuals = self.left * self.spread
        weighted_rows = np.einsum("mjk,mj,j->mk", influence, residuals, self.weight, optimize=True)
        block_sums = np.add.reduceat(weighted_rows, self.blocks, axis=0)
        variance_by_blocks = (block_sums**2).sum(axis=0)
        variance_by_rows = self.correlation * (weighted_rows**2).sum(axis=0)
        return np.sqrt(np.maximum(variance_by_blocks, variance_by_rows))

    @cached_property
    def correlation(self) -> float:
        """Integrated autocorrelation time of the residuals, in rows."""
        return autocorrelation_length(self.left / np.sqrt(self.squares))

    @cached_property
    def blocks(self) -> Array:
        """First rows of blocks of time with a length of five autocorrelation lengths, between 1 and 2.5 s."""
        s = self.states
        step = float(np.median(np.diff(s.time[s.rows]))) if len(s.rows) > 1 else 1.0  # between rows [s]
        # In rows:
        min_length = _MIN_BLOCK_SECONDS / step
        max_length = _MAX_BLOCK_SECONDS / step
        length = max(min_length, min(max_length, _BLOCK_LENGTHS * self.correlation))
        block_count = max(2, int(len(self.left) / length))
        edges = np.linspace(0, len(self.left), block_count + 1).astype(int)
        return edges[:-1]

    def critical_t(self, tried: int) -> float:
        """Student's t that the largest t of ``tried`` causes, a number, exceeds by chance in 1 % of the logs."""
        freedom = max(1.0, len(self.blocks) - 1.0)
        return float(student_quantile(freedom, 1.0 - _MAX_CHANCE / max(1, tried)))

    def t_value(self, before: CauseFit) -> float:
        """Student's t of the gain in log-likelihood by blocks of time, against ``before``, the fit without the cause."""
        squares_before = before.squares
        squares_after = self.squares
        spread_term = 2.0 * np.log(before.spread / self.spread)
        residual_term = before.left**2 / squares_before - self.left**2 / squares_after
        doubled_gains = residual_term + np.log(squares_before / squares_after) + spread_term  # (m, nv)
        gains = 0.5 * doubled_gains[:, self.live].sum(axis=1)
        gains_of_blocks = np.add.reduceat(gains, self.blocks)
        error_of_mean = gains_of_blocks.std(ddof=1) / np.sqrt(len(gains_of_blocks))
        return float(gains_of_blocks.mean() / max(error_of_mean, 1e-300))


def _sum_without(parts: Sequence[Array], left_out: int) -> Array:
    """Sum of the parts of all fifths but one; of all parts if the index ``left_out`` is the number of fifths."""
    return np.asarray(sum(part for k, part in enumerate(parts) if k != left_out))


def log_fit(
    unknown: UnknownParameters, samples: Sequence[SteadySamples], settings: FitSettings, dead: Array
) -> CauseFit:
    """Fit to the rows of logs for the search for causes."""
    base = askew_base(unknown)
    entries_of_row = unknown.model.nv * base.count
    most_rows = max(_MIN_FIT_ROWS, min(_MAX_FIT_ROWS, _MAX_ENTRIES / entries_of_row))
    cutoff = min(settings.cutoff, _MAX_CUTOFF)
    friction_speed = np.minimum(settings.friction_speed, _MAX_FRICTION_SPEED)
    s = LogStates.from_samples(base, samples, cutoff, friction_speed, most_rows).with_fields(shift=settings.shift)
    sizes = unknown.scales(_typical(s.tau), _typical(s.dq), _typical(s.ddq))
    prior = Prior(base.project(unknown.file_values), base.weak_sizes(sizes))
    return CauseFit(s, prior, ~dead)


def _typical(x: Array) -> Array:
    """(nv,) root mean squares of columns x (n, nv), at least 1 % of their median, and above 0."""
    rms = np.maximum(np.sqrt((x**2).mean(axis=0)), 1e-6)
    return np.maximum(rms, 1e-2 * np.median(rms))


def askew_base(unknown: UnknownParameters) -> BaseParameters:
    """Base parameters for a tilted mounting, which are valid for any mounting."""
    strength = np.linalg.norm(unknown.model.gravity)
    return BaseParameters.from_unknowns(unknown, gravity=strength * _ASKEW)


# ── Screening of causes by their columns


@dataclass(frozen=True, eq=False)
class ScreenedCause:
    """Cause screened by its columns, with the weights of the fit without it."""

    S: float
    cause: Cause | Law
    beta: Array
    """(k,) value β of a cause, or coefficients of a law."""
    e: Array
    """(m, nv, k) columns."""


def screen_causes(fit: CauseFit, candidates: Iterable[Cause]) -> list[ScreenedCause]:
    """Screen causes with a value by their columns at each of their start values.

    Columns at the value 0 are tested together. Each distant start has a fit of its own, which is released before the next.
    """
    s = fit.states
    screened = list[ScreenedCause]()
    indices_at_zero = list[int]()
    for cause in candidates:
        for start in cause.starts:
            beta = np.full(cause.size, start)
            if start == 0.0:
                indices_at_zero.append(len(screened))
                screened.append(ScreenedCause(0.0, cause, beta, cause_columns(fit, s, cause, beta)))
                continue
            refit = fit.refit(cause.correct(s, beta))
            e = cause_columns(refit, s, cause, beta)
            ((S, step),) = refit.gains_of_sets([e])
            screened.append(ScreenedCause(fit.gain(refit) + S, cause, beta + step, e))
    gains = fit.gains_of_sets([screened[k].e for k in indices_at_zero])
    for k, (S, step) in zip(indices_at_zero, gains, strict=True):
        screened[k] = replace(screened[k], S=S, beta=screened[k].beta + step)
    return screened


def cause_columns(fit: CauseFit, s: LogStates, cause: Cause, beta: Array) -> Array:
    """-d(residual)/dβ (m, nv, k) by central differences, at the unknowns of the fit."""
    x = fit.x[: fit.W.shape[2] - len(fit.laws)]  # groups, without the coefficients of laws

    def negative_residual(beta: Array) -> Array:
        """τ̂ - τ (m, nv) of the states, with a value of the cause."""
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
        is_joint_of_law = np.isin(np.arange(len(fit.live)), law.joints)
        is_affected = fit.live & is_joint_of_law
        columns.append(filtered[key] * is_affected[:, None])
    return columns


def screen_laws(fit: CauseFit, laws: Iterable[Law]) -> list[ScreenedCause]:
    """Screen laws of the whole log, each by its columns."""
    acting_laws, columns = _acting_laws(fit, list(laws))
    screened = list[ScreenedCause]()
    for law, e, (S, beta) in zip(acting_laws, columns, fit.gains_of_sets(columns), strict=True):
        screened.append(ScreenedCause(S, law, beta, e))
    return screened


def _acting_laws(fit: CauseFit, laws: Sequence[Law]) -> tuple[list[Law], list[Array]]:
    """Laws with columns other than 0, and their columns (m, nv, k)."""
    fitted = FittedTorques.from_groups(fit.states, fit.x[: fit.states.base.count])
    acting_laws: list[Law] = []
    columns: list[Array] = []
    for law, e in zip(laws, law_columns(fit, laws, fitted), strict=True):
        if e.any():
            acting_laws.append(law)
            columns.append(e)
    return acting_laws, columns


def _screen_laws_of_joints(fit: CauseFit) -> list[ScreenedCause]:
    """Screen the laws of the joints and their elasticity, each by its column."""
    s = fit.states
    torques, _ = s.torques(fit.x[: s.base.count])
    elasticities = causes.compliances(s, s.low_passed(torques))
    return screen_laws(fit, causes.laws(s)) + screen_causes(fit, elasticities)


def screen_changes(fit: CauseFit) -> list[ScreenedCause]:
    """Screen laws that begin within the log, each from the row at which its columns gain most."""
    s = fit.states
    laws, columns = _acting_laws(fit, list(causes.changes(s)))
    screened = list[ScreenedCause]()
    for law, e, (S, beta, begin) in zip(laws, columns, _best_begins(fit, columns), strict=True):
        state = int(s.rows[begin])
        since = int(s.piece[state]), float(s.time[state])
        is_after = (np.arange(len(e)) >= begin)[:, None, None]
        screened.append(ScreenedCause(S, replace(law, since=since), beta, e * is_after))
    return screened


def _best_begins(fit: CauseFit, columns: Sequence[Array]) -> list[tuple[float, Array, int]]:
    """S, coefficients and first row of several columns e (m, nv, k) that begin within the log.

    The search starts at five rows, and halves its step around the best row as long as S may become significant.
    """
    m = len(fit.tau)
    rows = np.arange(m)[:, None, None]
    step = m // _LOG_PARTS
    best = [(-np.inf, np.zeros(0), 0)] * len(columns)  # S, coefficients and first row
    begins = (step * np.arange(1, _LOG_PARTS)).tolist()
    trials = list(product(range(len(columns)), begins))  # index of columns, and first row
    while trials:
        gains = fit.gains_of_sets([columns[c] * (rows >= begin) for c, begin in trials])
        for (c, begin), (S, beta) in zip(trials, gains, strict=True):
            best_S, _, _ = best[c]
            if best_S < S:
                best[c] = S, beta, begin
        step //= 2
        trials = []
        for c, (S, _, begin) in enumerate(best):
            if S > 0.5 * LEAST_S and step:
                for neighbour in (begin - step, begin + step):
                    if 0 < neighbour < m:
                        trials.append((c, neighbour))
    return best
