"""Hyperparameters of a fit: cut-off, clock offset and friction speeds, chosen on training rows only."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial, reduce
from itertools import pairwise

import numpy as np

from ..core.estimation.cross_validation import FOLDS
from ..core.estimation.least_squares import NormalEquations, Prior
from ..core.numbers import number
from ..core.text import listed
from ..core.typing import Array
from .parameters import BaseParameters, speed_owner
from .rows import (
    MOST_ROWS,
    FilteredRows,
    JudgedStates,
    SteadySamples,
    cutoffs,
    interpolate,
    torques_below,
    total_seconds,
)


@dataclass(frozen=True)
class AssumedCause:
    """Cause that a fit assumes, with its estimated value.

    Attributes
    ----------
    kind : str, name of its row in the table of doubts, such as ``gain``
    joints : tuple of str, empty for a cause of the whole log
    value : float or None, in ``unit``; None for a cause without a value
    interval : (float, float) or None, 95 % interval of the value
    unit : str
    gravity : tuple of float or None, in the base frame [m/s²], if the cause changes its direction
    """

    kind: str
    joints: tuple[str, ...] = ()
    value: float | None = None
    interval: tuple[float, float] | None = None
    unit: str = ""
    gravity: tuple[float, ...] | None = None

    def __str__(self) -> str:
        text = f"{self.kind} of {listed(self.joints, 4)}" if self.joints else self.kind
        if self.value is not None:
            text += f" {number(self.value, 4)} {self.unit}".rstrip()
        if self.interval is not None:
            text += f" (95 %: {number(self.interval[0], 4)} to {number(self.interval[1], 4)})"
        if self.gravity is not None:
            text += f", gravity {', '.join(number(x, 4) for x in self.gravity)} m/s²"
        return text


@dataclass(frozen=True, eq=False)
class FitSettings:
    """Settings of a fit.

    Attributes
    ----------
    cutoff : float [Hz]
    friction_speed : (nv,) array, Coulomb smoothing speed v_0 [rad/s or m/s]
    shift : float, delay of the log's torques relative to its positions [s]
    assumed : tuple of AssumedCause, removed from the log before the fit
    """

    cutoff: float
    friction_speed: Array
    shift: float
    assumed: tuple[AssumedCause, ...] = ()

    def __str__(self) -> str:
        speeds = ", ".join(map(number, self.friction_speed))
        side = "before" if self.shift < 0 else "after"
        return (
            f"cut-off {number(self.cutoff)} Hz; torques {number(abs(self.shift) * 1e3)} ms {side} positions; friction turns "
            f"at {speeds} rad/s or m/s"
        )


@dataclass(frozen=True)
class FitOptions:
    """Settings fixed by the user; None: chosen automatically."""

    cutoff: float | None = None
    friction_speed: float | None = None
    shift: float | None = None


class Trial:
    """Rows of equations at given settings, with a maximum number of rows."""

    def __init__(self, source: SettingRows, settings: FitSettings, most: int = MOST_ROWS) -> None:
        self.settings = settings
        self._source = source
        self.felt = source.base.felt
        """(nv, r) True if a group enters the torque of a joint."""
        self.rows = source.rows(settings.cutoff, most)
        self.tau = self.rows.torques(settings.shift)
        """(m, nv) torques."""

    @cached_property
    def fold(self) -> Array:
        """(m,) index, 0 to 4, of the fifth of the time to which each row belongs."""
        return self._source.folds(self.rows.log, self.rows.time)

    @cached_property
    def places(self) -> list[slice]:
        """Rows of each fifth, as consecutive slices."""
        edges = np.searchsorted(self.fold, np.arange(FOLDS + 1)).tolist()
        return [slice(a, b) for a, b in pairwise(edges)]

    @cached_property
    def W(self) -> Array:
        """(m, nv, r) columns of the groups."""
        rows, settings = self.rows, self.settings
        if np.array_equal(settings.friction_speed, self._source.usual_speed):
            return rows.W
        W = rows.W.copy()
        for column, joints in self._source.coulomb:
            W[:, :, column] = rows.coulomb(column, joints, settings.friction_speed)
        return W

    def changes(self, x: Array) -> Array:
        """Changes of the residual by each setting that was chosen automatically, (m, nv, k).

        Derivative by the clock offset [s], and change by 10 % of each friction speed.
        """
        changes = list[Array]()
        if self._source.asked.shift is None:
            step = 0.1 / self.settings.cutoff  # a tenth of the shortest period
            later_torques = self.rows.torques(self.settings.shift + step)
            earlier_torques = self.rows.torques(self.settings.shift - step)
            changes.append((later_torques - earlier_torques) / (2 * step))
        if self._source.asked.friction_speed is None:
            changes += [self._change_by_speed(x, joint) for joint in range(len(self.felt))]
        if not changes:
            return np.zeros((*self.tau.shape, 0))
        return np.stack(changes, axis=-1)

    def _change_by_speed(self, x: Array, joint: int) -> Array:
        """(m, nv) change of the predicted torques if the friction speed of a joint is 10 % larger."""
        speed_factors = np.ones(len(self.felt))
        speed_factors[joint] = 1.1
        larger_speed = speed_factors * self.settings.friction_speed
        torque_change = np.zeros(self.tau.shape)
        for column, joints in self._source.coulomb:
            if speed_owner(joints) == joint:
                column_change = self.rows.coulomb(column, joints, larger_speed) - self.W[:, :, column]
                torque_change += column_change * x[column]
        return torque_change


# Each block of time is predicted from the others. The score of a setting is Σ_j log |τ_j - τ̂_j|², to be minimised: the
# likelihood of normal residuals with a different size for each joint, which gives all joints equal weight. All cut-offs
# are scored against the same torques, below the highest cut-off; otherwise the lowest cut-off would always win.

SPEEDS = (0.003, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Candidate Coulomb smoothing speeds [rad/s, m/s]."""
_USUAL_SPEED = 0.05
"""Friction speed [rad/s, m/s] from which the choice starts."""
_OFFSETS_MS = np.array([1, 2, 3, 4, 5, 7, 10, 15, 25, 40, 60, 90, 130, 200, 300])
_SHIFTS = (*(-1e-3 * _OFFSETS_MS[::-1]).tolist(), 0.0, *(1e-3 * _OFFSETS_MS).tolist())
"""Candidate clock offsets [s], of either sign, in ascending order."""
_MIN_ROWS_OF_GROUP = 10.0
"""Minimum number of equations per group at a cut-off."""
_CACHE_BYTES = 64 * 2**20
"""Cache size for rows at several cut-offs with their states, and for normal equations at several settings; the least
recently used are evicted."""
_BYTES_OF_FLOAT = 8
_MAX_SCORES = 10_000
"""Maximum number of scores that are kept: the search comes back to many settings."""
_MAX_ROWS_OF_CHOICE = 3000
"""Maximum number of rows for the choice of settings."""
_SHIFT_TOLERANCE = 5e-5
"""Accuracy of a clock offset [s]."""
_MIN_GAIN = 2e-3
"""Decrease of log |residual|² per joint from which another cut-off, offset or speed is preferred to the present one."""
_MAX_CHANCE_GAIN = 6.0
"""Decrease of log |residual|² of all joints, times the number of independent rows, that an offset or a speed exceeds by
chance once in 70 times. This product is twice a log-likelihood ratio, χ² distributed with one degree of freedom (Wilks
1938)."""

_MIN_TYPICAL_SIZE = 1e-6
"""Smallest typical size, so that quotients stay finite."""
_MIN_SHARE_OF_MEDIAN = 1e-2
"""Smallest typical size of a joint, relative to the median of all joints."""
_TINY_SQUARE = 1e-300
"""Sum of squared residuals in place of 0, for its logarithm."""


def _typical_sizes(x: Array) -> Array:
    """(nv,) root mean squares of columns x (m, nv), but at least 1 % of the median of all joints, and above 0."""
    rms = np.sqrt((x**2).mean(axis=0))
    median = max(float(np.median(rms)), _MIN_TYPICAL_SIZE)
    return np.maximum(rms, _MIN_SHARE_OF_MEDIAN * median)


def _report_sweep(progress: Callable[[float], None], sweep: int, done_share: float) -> None:
    """Report the progress of one of two sweeps, 0 or 1, as a share of both."""
    progress(0.5 * (sweep + done_share))


class SettingRows:
    """Rows of logs at each candidate cut-off; ``dead`` (nv,) bool is True for joints without a torque.

    ``asked`` are the settings fixed by the user, and ``tried`` the candidate cut-offs [Hz] in ascending order. A *fifth* is
    one of five parts of the logs of equal time.
    """

    def __init__(
        self,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        asked: FitOptions,
        dead: Array,
    ) -> None:
        self.base = base
        self.samples = samples
        self.asked = asked
        self.dead = dead
        nv = base.unknown.model.nv
        if asked.cutoff is None:
            self.tried = cutoffs(samples, _MIN_ROWS_OF_GROUP * base.count / nv)
        else:
            self.tried = (asked.cutoff,)
        self.usual_speed = np.full(nv, _USUAL_SPEED if asked.friction_speed is None else asked.friction_speed)
        self.coulomb = base.unknown.coulomb_columns(base.kept)
        """Columns of dry friction, with (nv,) bool, True for the joints that each column affects."""
        # number of floats at one cut-off: columns of its rows, and q, dq and ddq of its states
        floats_of_cutoff = nv * base.count * _MAX_ROWS_OF_CHOICE + 3 * nv * sum(map(len, samples))
        cached = lru_cache(max(2, int(_CACHE_BYTES / (_BYTES_OF_FLOAT * floats_of_cutoff))))
        self.rows = cached(self._rows)
        self._judged = cached(self._states)
        self._shifted_torques = cached(self._judged_torques)
        self._trials = lru_cache(2)(self._trial)
        sets_of_equations = 2 + int(_CACHE_BYTES / (_BYTES_OF_FLOAT * nv * base.count**2 * FOLDS))
        self._fifths = lru_cache(sets_of_equations)(self._equations_without_delay)
        sets_of_products = 2 + int(_CACHE_BYTES / (_BYTES_OF_FLOAT * nv * base.count * FOLDS))
        self._products = lru_cache(sets_of_products)(self._shifted_products)
        self._scores = lru_cache(_MAX_SCORES)(self._score_at)

    def release(self) -> None:
        """Release the rows of all candidates, to limit memory; they are computed again when needed."""
        rows_and_torques = (self.rows, self._judged, self._shifted_torques)
        for cache in (*rows_and_torques, self._trials, self._fifths, self._products, self._scores):
            cache.cache_clear()
        self.__dict__.pop("_torques", None)  # value of the cached property

    def _rows(self, cutoff: float, most: float) -> FilteredRows:
        """At most ``most`` rows at a cut-off, with the usual friction speed; columns of joints without a torque are zero."""
        rows = FilteredRows.from_samples(self.base, self.samples, cutoff, self.usual_speed, most)
        rows.W[:, self.dead] = 0.0
        rows.dead = self.dead
        return rows

    def _states(self, cutoff: float) -> JudgedStates:
        """States of positions below a cut-off."""
        return JudgedStates.from_samples(self.base, self.samples, cutoff, self.usual_speed)

    def _trial(self, cutoff: float, speeds: tuple[float, ...]) -> Trial:
        """Rows for the choice of settings, without a clock offset."""
        return Trial(self, FitSettings(cutoff, np.array(speeds), 0.0), _MAX_ROWS_OF_CHOICE)

    def _equations_without_delay(self, cutoff: float, speeds: tuple[float, ...]) -> list[NormalEquations]:
        """Normal equations of each fifth, without a clock offset."""
        trial = self._trials(cutoff, speeds)
        return [NormalEquations.from_rows(trial.W, trial.tau, trial.felt, rows=place) for place in trial.places]

    def _equations(self, settings: FitSettings) -> list[NormalEquations]:
        """Normal equations of each fifth; a clock offset changes only the torques."""
        cutoff_and_speeds = (settings.cutoff, tuple(settings.friction_speed.tolist()))
        fifths = self._fifths(*cutoff_and_speeds)
        if not settings.shift:
            return fifths
        products = self._products(*cutoff_and_speeds, settings.shift)
        return [replace(fifth, c=c, y=y) for fifth, (c, y) in zip(fifths, products, strict=True)]

    def _shifted_products(self, cutoff: float, speeds: tuple[float, ...], shift: float) -> list[tuple[Array, Array]]:
        """Products W' τ (nv, r) and squares of the torques (nv,) of each fifth, with torques ``shift`` seconds later."""
        trial = self._trials(cutoff, speeds)
        torques = trial.rows.torques(shift)
        products = list[tuple[Array, Array]]()
        for place in trial.places:
            tau = torques[place]
            products.append((np.einsum("mjr,mj->jr", trial.W[place], tau), (tau**2).sum(axis=0)))
        return products

    def folds(self, log: Array, time: Array) -> Array:
        """(m,) index 0 to 4 of the fifth of each row, in the time of all logs together."""
        begins = np.concatenate([[0.0], np.cumsum([s.seconds for s in self.samples])])  # of the logs in the time of all
        starts = np.array([s.start for s in self.samples])  # of the logs in their own time
        elapsed = begins[log] + (time - starts[log])
        total = begins[-1]
        return np.minimum((FOLDS * elapsed / total).astype(int), FOLDS - 1)  # the last row belongs to the last fifth

    def typical(self) -> tuple[Array, Array, Array]:
        """Typical torque, speed and acceleration of the joints, (nv,) each, above 0."""
        middle_cutoff = self.tried[len(self.tried) // 2]
        rows = self.rows(middle_cutoff, _MAX_ROWS_OF_CHOICE)
        return _typical_sizes(rows.torques(0.0)), _typical_sizes(rows.speed), _typical_sizes(rows.acceleration)

    def choose(
        self,
        prior: Prior,
        sets: Sequence[Sequence[int]],
        progress: Callable[[float], None] = lambda _share: None,
    ) -> list[FitSettings]:
        """Choose, for each set of fifths, the settings that minimise its cross-validation residual.

        Each cut-off is scored for all sets before the next one, so that the rows of few cut-offs are in memory. The first
        sweep goes from the lowest cut-off to the highest. The second sweep is for sets whose cut-off changed. It goes back,
        since the rows of the highest cut-off cost most and are still cached.
        """
        initial = FitSettings(self.tried[-1], self.usual_speed.copy(), self.asked.shift or 0.0)
        chosen = [initial] * len(sets)
        open_sets = list(range(len(sets)))
        for sweep in range(2):
            blocks_and_settings = [(tuple(sets[k]), chosen[k]) for k in open_sets]
            report = partial(_report_sweep, progress, sweep)
            best_cutoffs = self._best_cutoffs(prior, blocks_and_settings, report, rising=sweep == 0)
            changed_sets = list[int]()
            for k, cutoff in zip(open_sets, best_cutoffs, strict=True):
                if cutoff != chosen[k].cutoff:
                    changed_sets.append(k)
                chosen[k] = self._tune(replace(chosen[k], cutoff=cutoff), prior, tuple(sets[k]))
            open_sets = changed_sets
        return chosen

    def _tune(self, settings: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        """Settings with optimised clock offset and friction speeds, one after another, at their cut-off.

        ``blocks`` are the numbers of the fifths by which settings are compared.
        """
        if self.asked.shift is None:
            settings = self._best_shift(settings, prior, blocks)
        if self.asked.friction_speed is None and self.coulomb:
            nv = len(self.dead)
            settings = self._best_speed(settings, np.ones(nv, bool), prior, blocks)  # of all joints together
            for joint in np.eye(nv, dtype=bool):
                settings = self._best_speed(settings, joint, prior, blocks)
        if self.asked.shift is None:  # again, with the new friction speeds
            settings = self._best_shift(settings, prior, blocks)
        return settings

    def _best_speed(self, settings: FitSettings, joints: Array, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        """Settings with the best common friction speed of the joints that a mask (nv,) selects."""
        candidates = list[FitSettings]()
        for speed in SPEEDS:
            friction_speed = np.where(joints, speed, settings.friction_speed)
            candidates.append(replace(settings, friction_speed=friction_speed))
        best = min(candidates, key=lambda candidate: self._score(candidate, prior, blocks))
        return self._better(settings, best, prior, blocks)

    def _best_shift(self, settings: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        """Settings with the best clock offset: the best candidate, refined between its neighbours."""
        from scipy.optimize import minimize_scalar

        def score(shift: float) -> float:
            return self._score(replace(settings, shift=float(shift)), prior, blocks)

        k = int(np.argmin([score(shift) for shift in _SHIFTS]))
        best = _SHIFTS[k]
        if 0 < k < len(_SHIFTS) - 1:
            refined = minimize_scalar(
                score, bounds=(_SHIFTS[k - 1], _SHIFTS[k + 1]), options={"xatol": _SHIFT_TOLERANCE}
            )
            best = min((best, float(refined.x)), key=score)
        return self._better(settings, replace(settings, shift=best), prior, blocks)

    def _better(self, present: FitSettings, other: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        """The other settings if their gain is significant, else the present settings; short logs need a larger gain."""
        independent_rows = 2.0 * present.cutoff * total_seconds(self.samples)  # below a cut-off f, 2 f of them a second
        min_gain = max(_MIN_GAIN * len(self.dead), _MAX_CHANCE_GAIN / independent_rows)
        gain = self._score(present, prior, blocks) - self._score(other, prior, blocks)
        return other if gain > min_gain else present

    def _fits(self, settings: FitSettings, prior: Prior, blocks: Sequence[int]) -> list[tuple[NormalEquations, Array]]:
        """Normal equations of each fifth of ``blocks``, and the groups x fitted to the other fifths of ``blocks``."""
        all_fifths = self._equations(settings)
        fifths = [all_fifths[b] for b in blocks]
        total = reduce(operator.add, fifths)
        _, sigma = total.solve(prior)
        fits = list[tuple[NormalEquations, Array]]()
        for fifth in fifths:
            training = total - fifth if len(fifths) > 1 else total
            fits.append((fifth, prior.solve(*training.whitened(sigma))))
        return fits

    def _score(self, settings: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> float:
        """Sum of log |residual|² over the joints, of fifths predicted from the others."""
        return self._scores(settings.cutoff, tuple(settings.friction_speed.tolist()), settings.shift, prior, blocks)

    def _score_at(
        self, cutoff: float, speeds: tuple[float, ...], shift: float, prior: Prior, blocks: tuple[int, ...]
    ) -> float:
        """Score as of :meth:`_score`, with arguments that can be keys of a cache."""
        squares = np.zeros(len(self.dead))  # of the residuals of each joint
        settings = FitSettings(cutoff, np.array(speeds), shift)
        for fifth, x in self._fits(settings, prior, blocks):
            squares = squares + fifth.squares(x)
        return float(np.log(np.maximum(squares, _TINY_SQUARE)).sum())

    @cached_property
    def _torques(self) -> list[tuple[Array, Array]]:
        """Times and torques of each log, low-passed at the highest cut-off; all cut-offs are scored against these."""
        highest = max(self.tried)
        return [torques_below(samples, highest) for samples in self.samples]

    def _judged_torques(self, cutoff: float, shift: float) -> Array:
        """(m, nv) torques of the states on which a cut-off is scored, ``shift`` seconds later."""
        torques_of_logs = list[Array]()
        for states, (time, tau) in zip(self._judged(cutoff).states, self._torques, strict=True):
            torques_of_logs.append(interpolate(states.time + shift, time, tau))
        return np.concatenate(torques_of_logs)

    def _best_cutoffs(
        self,
        prior: Prior,
        sets: Sequence[tuple[tuple[int, ...], FitSettings]],
        progress: Callable[[float], None],
        *,
        rising: bool,
    ) -> list[float]:
        """For each set, the lowest cut-off whose predictions are nearly as good as the best.

        ``sets`` has the numbers of the fifths and the settings of each set. Predictions are compared with torques below the
        highest cut-off. If ``rising``, cut-offs are scored from the lowest to the highest, otherwise in reverse order.
        """
        cutoff_count = len(self.tried)
        if cutoff_count == 1:
            return [settings.cutoff for _, settings in sets]
        order = list(range(cutoff_count))
        if not rising:
            order.reverse()
        scores = np.empty((cutoff_count, len(sets)))
        for done_count, k in enumerate(order, 1):
            for n, (blocks, settings) in enumerate(sets):
                scores[k, n] = self._judged_score(prior, blocks, replace(settings, cutoff=self.tried[k]))
            progress(done_count / cutoff_count)
        is_good = scores <= scores.min(axis=0) + _MIN_GAIN * len(self.dead)
        first_good = is_good.argmax(axis=0)  # index of the lowest such cut-off, for each set
        return [self.tried[k] for k in first_good.tolist()]

    def _judged_score(self, prior: Prior, blocks: tuple[int, ...], settings: FitSettings) -> float:
        """Sum of log |residual|² over the joints, of torques that are not low-passed at the tested cut-off."""
        judged = self._judged(settings.cutoff)
        tau = self._shifted_torques(settings.cutoff, settings.shift)
        fold = self.folds(judged.log, judged.time)
        W = judged.W
        if not np.array_equal(settings.friction_speed, self.usual_speed):
            W = self._with_speeds(judged, settings.friction_speed)
        squares = np.zeros(W.shape[1])
        for block, (_, x) in zip(blocks, self._fits(settings, prior, blocks), strict=True):
            is_in_block = fold == block
            residual = tau[is_in_block] - judged.known[is_in_block] - W[is_in_block] @ x
            squares += (residual**2).sum(axis=0)
        return float(np.log(np.maximum(squares[~self.dead], _TINY_SQUARE)).sum())

    def _with_speeds(self, judged: JudgedStates, friction_speed: Array) -> Array:
        """(m, nv, r) columns of states with other friction speeds than the usual ones."""
        W = judged.W.copy()
        unknown = self.base.unknown
        for column, joints in self.coulomb:
            k = int(self.base.kept[column])  # index of the column among all unknown parameters
            friction = [unknown.drives([k], states.dq, states.ddq, friction_speed) for states in judged.states]
            W[:, joints, column] = np.concatenate(friction) * unknown.shares[k, joints]
        return W
