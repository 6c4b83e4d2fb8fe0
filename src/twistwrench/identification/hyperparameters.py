"""Hyperparameters of a fit: essential groups, cut-off, clock offset and friction speeds, chosen on training rows only."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial, reduce
from itertools import pairwise

import numpy as np

from ..core.estimation.cross_validation import FOLDS
from ..core.estimation.least_squares import Information, NormalEquations, Prior, left_out, squares_of, sum_of
from ..core.numbers import number
from ..core.text import listed
from ..core.typing import Array
from .parameters import BaseParameters, speed_owner
from .rows import MOST_ROWS, FilteredRows, JudgedStates, SteadySamples, cutoffs, torques_below


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
        said = f"{self.kind} of {listed(self.joints, 4)}" if self.joints else self.kind
        if self.value is not None:
            said += f" {number(self.value, 4)}{' ' + self.unit if self.unit else ''}"
        if self.interval is not None:
            said += f" (95 %: {number(self.interval[0], 4)} to {number(self.interval[1], 4)})"
        if self.gravity is not None:
            said += f", gravity {', '.join(number(x, 4) for x in self.gravity)} m/s²"
        return said


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
        self.settings, self._source, self.felt = settings, source, source.base.felt
        self.rows = source.rows(settings.cutoff, most)
        self.tau = self.rows.torques(settings.shift)
        """(m, nv) torques."""

    @cached_property
    def fold(self) -> Array:
        """(m,) index of the fifth of the time of each row."""
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
        for c, joints in self._source.coulomb:
            W[:, :, c] = rows.coulomb(c, joints, settings.friction_speed)
        return W

    def changes(self, x: Array) -> Array:
        """(m, nv, k) derivatives of the predicted torques by each chosen setting: clock offset and friction speeds."""
        found, settings, asked = [], self.settings, self._source.asked
        if asked.shift is None:
            step = 0.1 / settings.cutoff
            later, sooner = self.rows.torques(settings.shift + step), self.rows.torques(settings.shift - step)
            found.append((later - sooner) / (2 * step))
        if asked.friction_speed is None:
            for j, faster in enumerate(
                np.where(np.eye(len(self.felt), dtype=bool), 1.1, 1.0) * settings.friction_speed
            ):
                change = np.zeros(self.tau.shape)
                for c, joints in self._source.coulomb:
                    if speed_owner(joints) == j:
                        change += (self.rows.coulomb(c, joints, faster) - self.W[:, :, c]) * x[c]
                found.append(change)
        return np.stack(found, axis=-1) if found else np.zeros((*self.tau.shape, 0))


# ── Essential parameters: the fewest groups that predict held-out rows as well as all groups

# Backward elimination removes, at each step, the group whose absence raises the squared residuals least,
#
#     x_i² / (A⁻¹)_ii,     x ← x - A⁻¹ e_i x_i / (A⁻¹)_ii,     A⁻¹ ← A⁻¹ - A⁻¹ e_i e_i' A⁻¹ / (A⁻¹)_ii
#
# and the resulting order is evaluated by 5-fold cross-validation over time.
#
# Source: Pham and Gautier, "Essential parameters of robots", IEEE CDC 1991.

_NEAR_BEST = 1.01  # ratio to the least held-out residual that fewer groups may reach


@dataclass(frozen=True, eq=False)
class EssentialGroups:
    """Essential groups of parameters, in addition to the known ones; the other groups are set to zero.

    Attributes
    ----------
    names : tuple of str
    places : (k,) array, indices among all groups
    values : (k,) array, fitted again without the others
    held_out : float, |τ - τ̂| / |τ| of held-out fifths, in units of the residuals of each joint
    curve : tuple of (count, share), |τ - τ̂| / |τ| for each number of groups
    """

    names: tuple[str, ...]
    places: Array
    values: Array
    held_out: float
    curve: tuple[tuple[int, float], ...]


def essential_groups(
    names: Sequence[str], folds: Sequence[Information], size: Array, held: Array, values: Array
) -> EssentialGroups:
    """Smallest set of groups that predicts as well as any other."""
    x = np.where(held, values, 0.0)  # torques of known groups are subtracted
    parts = [(N, c - N @ x, float(y - 2.0 * c @ x + x @ N @ x)) for N, c, y in folds if y > 0]
    total = sum_of(parts)
    order = _order(total, size, held)
    sets = [np.sort(order[k:]) for k in range(len(order))]
    left = np.zeros(len(sets))
    for (N, c, y), rest in left_out(parts):
        for n, kept in enumerate(sets):
            left[n] += squares_of((N[np.ix_(kept, kept)], c[kept], y), _solved(rest, kept, size))
    shares = np.sqrt(left / max(sum(float(fold[2]) for fold in folds), 1e-300))
    chosen = int(np.flatnonzero(shares <= _NEAR_BEST * shares.min())[-1])
    kept = sets[chosen]
    found = _solved(total, kept, size)
    curve = tuple((len(one), float(share)) for one, share in zip(sets, shares, strict=True))
    return EssentialGroups(tuple(names[int(k)] for k in kept), kept, found, float(shares[chosen]), curve)


def _solved(information: Information, which: Array, size: Array) -> Array:
    N, c, _ = information
    S = size[which]
    A = N[np.ix_(which, which)] * S[:, None] * S + np.eye(len(which))
    return np.asarray(S * np.linalg.solve(A, S * c[which]))


def _order(total: Information, size: Array, held: Array) -> Array:
    """Order in which the groups are removed, without known groups."""
    N, c, _ = total
    left = np.flatnonzero(~held)
    S = size[left]
    C = np.linalg.inv(N[np.ix_(left, left)] * S[:, None] * S + np.eye(len(left)))
    x = C @ (S * c[left])
    order = []
    while left.size:
        i = int(np.argmin(x**2 / C.diagonal()))
        order.append(int(left[i]))
        gain = C[:, i] / C[i, i]
        x, C = np.delete(x - gain * x[i], i), np.delete(np.delete(C - np.outer(gain, C[i]), i, 0), i, 1)
        left = np.delete(left, i)
    return np.array(order, int)


# ── Search for cut-off, clock offset and friction speeds

# Each block of time is predicted from the others. The score of a setting is Σ_j log |τ_j - τ̂_j|², to be minimised: the
# likelihood of normal residuals with a different size for each joint, which gives all joints equal weight. All cut-offs
# are scored against the same torques, below the highest cut-off; otherwise the lowest cut-off would always win.

SPEEDS = (0.003, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Candidate Coulomb smoothing speeds [rad/s, m/s]."""
_USUAL_SPEED = 0.05
_LATER = (1, 2, 3, 4, 5, 7, 10, 15, 25, 40, 60, 90, 130, 200, 300)
_SHIFTS = tuple(1e-3 * s for s in (*(-s for s in reversed(_LATER)), 0, *_LATER))
_ROWS = 10.0  # minimum number of equations per group at a cut-off
_BYTES = 64 * 2**20
"""Cache size for rows at several cut-offs with their states, and for normal equations at several settings; the least
recently used are evicted."""
_MOST_CHOICE = 3000
"""Maximum number of rows for the choice of settings."""
_EXACT = 5e-5
"""Accuracy of a clock offset [s]."""
_WORTH = 2e-3
"""Decrease of log |residual|² per joint from which another cut-off, offset or speed is preferred to the first one."""
_CHANCE = 6.0
"""Decrease of log |residual|² of all joints, times the number of independent rows, that an offset or a speed exceeds by
chance once in 70 times. Twice a log-likelihood ratio, it is χ² distributed with one degree of freedom (Wilks 1938)."""


def _half_done(progress: Callable[[float], None], turn: int, share: float) -> None:
    progress(0.5 * (turn + share))


class SettingRows:
    """Rows of logs at each candidate cut-off; ``dead`` (nv,) bool is True for joints without a torque."""

    def __init__(
        self,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        asked: FitOptions,
        dead: Array,
    ) -> None:
        self.base, self.samples, self.asked, self.dead = base, samples, asked, dead
        nv = base.unknown.model.nv
        self.tried = (asked.cutoff,) if asked.cutoff is not None else cutoffs(samples, _ROWS * base.count / nv)
        self.usual_speed = np.full(nv, _USUAL_SPEED if asked.friction_speed is None else asked.friction_speed)
        self.coulomb = base.unknown.coulomb_columns(base.kept)
        """Columns of dry friction, with (nv,) bool, True for the joints that each column affects."""
        columns, states = nv * base.count * _MOST_CHOICE, 3 * nv * sum(map(len, samples))
        cached = lru_cache(max(2, int(_BYTES / (8 * (columns + states)))))
        self.rows, self._judged = cached(self._rows), cached(self._states)
        self._later = cached(self._judged_torques)
        self._trials = lru_cache(2)(self._trial)
        self._parts = lru_cache(2 + int(_BYTES / (8 * nv * base.count**2 * FOLDS)))(self._undelayed)

    def release(self) -> None:
        """Release the rows of all candidates, to limit memory; they are computed again when needed."""
        for cache in (self.rows, self._judged, self._later, self._trials, self._parts):
            cache.cache_clear()
        self.__dict__.pop("_torques", None)

    def _rows(self, cutoff: float, most: float) -> FilteredRows:
        """Rows at a cut-off, with the usual friction speed."""
        rows = FilteredRows.from_samples(self.base, self.samples, cutoff, self.usual_speed, most)
        rows.W[:, self.dead], rows.dead = 0.0, self.dead
        return rows

    def _states(self, cutoff: float) -> JudgedStates:
        """States of positions below a cut-off."""
        return JudgedStates.from_samples(self.base, self.samples, cutoff, self.usual_speed)

    def _trial(self, cutoff: float, speeds: tuple[float, ...]) -> Trial:
        return Trial(self, FitSettings(cutoff, np.array(speeds), 0.0), _MOST_CHOICE)

    def _undelayed(self, cutoff: float, speeds: tuple[float, ...]) -> list[NormalEquations]:
        """Normal equations of each fifth, without a clock offset."""
        trial = self._trials(cutoff, speeds)
        return [NormalEquations.from_rows(trial.W, trial.tau, trial.felt, rows=place) for place in trial.places]

    def _equations(self, settings: FitSettings) -> list[NormalEquations]:
        """Normal equations of each fifth; a clock offset changes only the torques."""
        key = settings.cutoff, tuple(settings.friction_speed.tolist())
        parts = self._parts(*key)
        if not settings.shift:
            return parts
        trial = self._trials(*key)
        late = trial.rows.torques(settings.shift)
        tau = [late[place] for place in trial.places]
        c = [np.einsum("mjr,mj->jr", trial.W[place], x) for place, x in zip(trial.places, tau, strict=True)]
        return [replace(one, c=k, y=(x**2).sum(axis=0)) for one, k, x in zip(parts, c, tau, strict=True)]

    def folds(self, log: Array, time: Array) -> Array:
        """(m,) index 0 to 4 of the fifth of each row, in the time of all logs together."""
        begins = np.concatenate([[0.0], np.cumsum([s.seconds for s in self.samples])])
        starts = np.array([s.start for s in self.samples])
        at = begins[log] + (time - starts[log])
        return np.minimum((FOLDS * at / begins[-1]).astype(int), FOLDS - 1)

    def typical(self) -> tuple[Array, Array, Array]:
        """Typical torque, speed and acceleration of the joints, (nv,) each, above 0."""
        rows = self.rows(self.tried[len(self.tried) // 2], _MOST_CHOICE)
        found = [np.sqrt((x**2).mean(axis=0)) for x in (rows.torques(0.0), rows.speed, rows.acceleration)]
        usual = [max(float(np.median(x)), 1e-6) for x in found]
        return tuple(np.maximum(x, 1e-2 * u) for x, u in zip(found, usual, strict=True))

    def choose(
        self,
        prior: Prior,
        sets: Sequence[Sequence[int]],
        progress: Callable[[float], None] = lambda _share: None,
    ) -> list[FitSettings]:
        """Choose, for each set of fifths, the settings that minimise its cross-validation residual.

        Each cut-off is scored for all sets before the next, so that the rows of few cut-offs are in memory: from the lowest
        to the highest, whose rows cost most, and back.
        """
        begin = FitSettings(self.tried[-1], self.usual_speed.copy(), self.asked.shift or 0.0)
        found, left = [begin] * len(sets), list(range(len(sets)))
        for turn in range(2):
            open_sets = [(tuple(sets[k]), found[k]) for k in left]
            done = partial(_half_done, progress, turn)
            best = self._best_cutoffs(prior, open_sets, done, rising=turn == 0)
            again = [k for k, cutoff in zip(left, best, strict=True) if cutoff != found[k].cutoff]
            for k, cutoff in zip(left, best, strict=True):
                found[k] = self._tuned(replace(found[k], cutoff=cutoff), prior, tuple(sets[k]))
            left = again
        return found

    def _tuned(self, settings: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        """Optimise clock offset and friction speeds one after another, at one cut-off."""
        if self.asked.shift is None:
            settings = self._best_shift(settings, prior, blocks)
        if self.asked.friction_speed is None and self.coulomb:
            nv = len(self.dead)
            for joints in (np.ones(nv, bool), *np.eye(nv, dtype=bool)):
                others = [np.where(joints, speed, settings.friction_speed) for speed in SPEEDS]
                tried = [replace(settings, friction_speed=speed) for speed in others]
                settings = self._better(
                    settings, min(tried, key=lambda one: self._score(one, prior, blocks)), prior, blocks
                )
        return settings if self.asked.shift is not None else self._best_shift(settings, prior, blocks)

    def _best_shift(self, settings: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        from scipy.optimize import minimize_scalar

        def score(shift: float) -> float:
            return self._score(replace(settings, shift=float(shift)), prior, blocks)

        k = int(np.argmin([score(shift) for shift in _SHIFTS]))
        best = _SHIFTS[k]
        if 0 < k < len(_SHIFTS) - 1:
            near = minimize_scalar(score, bounds=(_SHIFTS[k - 1], _SHIFTS[k + 1]), options={"xatol": _EXACT})
            best = min((best, float(near.x)), key=score)
        return self._better(settings, replace(settings, shift=best), prior, blocks)

    def _better(self, first: FitSettings, other: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        """Return the other settings if their gain is significant; short logs need a larger gain."""
        independent = 2.0 * first.cutoff * sum(s.seconds for s in self.samples)
        worth = max(_WORTH * len(self.dead), _CHANCE / independent)
        gain = self._score(first, prior, blocks) - self._score(other, prior, blocks)
        return other if gain > worth else first

    def _fits(self, settings: FitSettings, prior: Prior, blocks: Sequence[int]) -> list[tuple[NormalEquations, Array]]:
        """Normal equations of each fifth, and the groups fitted to the others of ``blocks``."""
        every = self._equations(settings)
        parts = [every[b] for b in blocks]
        total = reduce(operator.add, parts)
        sigma, found = total.solve(prior)[1], []
        for part in parts:
            rest = total - part if len(parts) > 1 else total
            found.append((part, prior.solve(*rest.whitened(sigma))))
        return found

    def _score(self, settings: FitSettings, prior: Prior, blocks: Sequence[int]) -> float:
        """Sum of log |residual|² over the joints, of fifths predicted from the others."""
        left = sum((part.squares(x) for part, x in self._fits(settings, prior, blocks)), np.zeros(len(self.dead)))
        return float(np.log(np.maximum(left, 1e-300)).sum())

    @cached_property
    def _torques(self) -> list[tuple[Array, Array]]:
        """Times and torques of each log below the highest cut-off, against which all cut-offs are scored."""
        return [torques_below(s, max(self.tried)) for s in self.samples]

    def _judged_torques(self, cutoff: float, shift: float) -> Array:
        """(m, nv) torques of the states on which a cut-off is scored, ``shift`` seconds later."""
        states = zip(self._judged(cutoff).states, self._torques, strict=True)
        parts = [[np.interp(s.time + shift, time, x) for x in tau.T] for s, (time, tau) in states]
        return np.concatenate([np.stack(part, axis=1) for part in parts])

    def _best_cutoffs(
        self,
        prior: Prior,
        sets: Sequence[tuple[tuple[int, ...], FitSettings]],
        progress: Callable[[float], None],
        *,
        rising: bool,
    ) -> list[float]:
        """Lowest cut-off for each set whose predictions, below the highest cut-off, are nearly as good as the best."""
        if len(self.tried) == 1:
            return [settings.cutoff for _, settings in sets]
        order = self.tried if rising else self.tried[::-1]
        scores = np.empty((len(order), len(sets)))
        for k, cutoff in enumerate(order):
            scores[k] = [self._judged_score(prior, blocks, replace(s, cutoff=cutoff)) for blocks, s in sets]
            progress((k + 1) / len(order))
        scores = scores if rising else scores[::-1]
        near = scores <= scores.min(axis=0) + _WORTH * len(self.dead)
        return [self.tried[k] for k in near.argmax(axis=0).tolist()]

    def _judged_score(self, prior: Prior, blocks: tuple[int, ...], settings: FitSettings) -> float:
        """Sum of log |residual|² over the joints, of torques that are not low-passed at the tested cut-off."""
        judged, tau = self._judged(settings.cutoff), self._later(settings.cutoff, settings.shift)
        fold = self.folds(judged.log, judged.time)
        W, unknown, usual = judged.W, self.base.unknown, np.array_equal(settings.friction_speed, self.usual_speed)
        W = W if usual else W.copy()
        for c, joints in () if usual else self.coulomb:
            k = int(self.base.kept[c])
            factors = [unknown.drives([k], s.dq, s.ddq, settings.friction_speed) for s in judged.states]
            W[:, joints, c] = np.concatenate(factors) * unknown.shares[k, joints]
        left = np.zeros(W.shape[1])
        for block, (_, x) in zip(blocks, self._fits(settings, prior, blocks), strict=True):
            here = fold == block
            left += ((tau[here] - judged.known[here] - W[here] @ x) ** 2).sum(axis=0)
        return float(np.log(np.maximum(left[~self.dead], 1e-300)).sum())
