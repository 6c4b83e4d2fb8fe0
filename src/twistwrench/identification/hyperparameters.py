"""Hyperparameters of a fit: essential groups, cut-off, clock offset and speeds of friction, chosen on training rows alone."""

from __future__ import annotations

import operator
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Generic, TypeVar

import numpy as np

from ..core.numbers import number
from ..core.text import listed
from ..estimation.cross_validation import FOLDS
from ..estimation.least_squares import Information, NormalEquations, Prior, left_out, squares_of, sum_of
from ..typing import Array
from .parameters import BaseParameters, speed_owner
from .rows import MOST_ROWS, FilteredRows, JudgedStates, SteadySamples, cutoffs, torques_below


@dataclass(frozen=True)
class AssumedCause:
    """A cause that a fit was made with, and what it came out as.

    Attributes
    ----------
    kind : str, name of its row in the table of doubts, such as ``gain``
    joints : tuple of str, empty for a cause of the whole log
    value : float or None, in ``unit``; None for a cause without a value
    interval : (float, float) or None, 95 % interval of the value
    unit : str
    gravity : tuple of float or None, in the base's frame [m/s²], where the cause turns it
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
    friction_speed : (nv,) array, v_0 [rad/s or m/s]
    shift : float, by how much torques are later in the log than the positions they belong to [s]
    assumed : tuple of AssumedCause, taken off the log before
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
    """Settings fixed by the user; None: chosen."""

    cutoff: float | None = None
    friction_speed: float | None = None
    shift: float | None = None


class Trial:
    """Normal equations of all blocks under settings that change one at a time."""

    def __init__(self, source: SettingRows, settings: FitSettings) -> None:
        self.settings, self._source, self.felt = settings, source, source.base.felt
        self.coulomb = source.base.unknown.coulomb_columns(source.base.kept)
        self._blocks = source.kept_blocks(settings, self._fresh_blocks)

    @cached_property
    def rows(self) -> FilteredRows:
        """Rows at the cut-off, with the usual speed of friction."""
        return self._source.rows(self.settings.cutoff)

    @cached_property
    def fold(self) -> Array:
        """(m,) the block of time of each row."""
        return self._source.folds(self.rows.log, self.rows.time)

    @cached_property
    def _places(self) -> list[Array | slice]:
        """Rows of each block; those that follow each other as a slice, which copies nothing."""
        places = [np.flatnonzero(self.fold == b) for b in range(FOLDS)]
        return [slice(p[0], p[-1] + 1) if len(p) and p[-1] - p[0] == len(p) - 1 else p for p in places]

    @cached_property
    def tau(self) -> Array:
        """(m, nv)."""
        return self.rows.torques(self.settings.shift)

    @cached_property
    def W(self) -> Array:
        """(m, nv, r)."""
        rows, settings = self.rows, self.settings
        if np.array_equal(settings.friction_speed, self._source.usual_speed):
            return rows.W
        W = rows.W.copy()
        for c, joints in self.coulomb:
            W[:, :, c] = rows.coulomb(c, joints, settings.friction_speed)
        return W

    def _fresh_blocks(self) -> list[NormalEquations]:
        return [NormalEquations.from_rows(self.W[p], self.tau[p], self.felt) for p in self._places]

    def changes(self, x: Array) -> Array:
        """(m, nv, k) what the predicted torques change by with each chosen setting: the clock's offset, speeds of friction."""
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
                for c, joints in self.coulomb:
                    if speed_owner(joints) == j:
                        change += (self.rows.coulomb(c, joints, faster) - self.W[:, :, c]) * x[c]
                found.append(change)
        return np.stack(found, axis=-1) if found else np.zeros((*self.tau.shape, 0))

    def fits(self, prior: Prior, blocks: Sequence[int]) -> list[tuple[int, Array]]:
        """Each block, and what the others of ``blocks`` give."""
        total = reduce(operator.add, (self._blocks[b] for b in blocks))
        weight = 1.0 / total.solve(prior)[1] ** 2
        found = []
        for b in blocks:
            rest = total - self._blocks[b] if len(blocks) > 1 else total
            x = prior.solve(np.einsum("jkl,j->kl", rest.N, weight), (rest.c * weight[:, None]).sum(axis=0))
            found.append((b, x))
        return found

    def score(self, prior: Prior, blocks: Sequence[int]) -> float:
        """The sum of log |residual|² over the joints, of blocks predicted from the others."""
        left = sum((self._blocks[b].squares(x) for b, x in self.fits(prior, blocks)), np.zeros(len(self.felt)))
        return float(np.log(np.maximum(left, 1e-300)).sum())

    def shift(self, shift: float) -> None:
        """Take torques from another time."""
        _ = self.W  # of the settings before
        self.tau = self.rows.torques(shift)
        self.settings = replace(self.settings, shift=shift)
        for k, p in enumerate(self._places):
            W, tau = self.W[p], self.tau[p]
            c = np.stack([W[:, j].T @ tau[:, j] for j in range(W.shape[1])])
            self._blocks[k] = replace(self._blocks[k], c=c, y=(tau**2).sum(axis=0))

    def speed(self, friction_speed: Array) -> None:
        """Take other speeds of friction."""
        changed, _ = friction_speed != self.settings.friction_speed, self.tau
        if self.W is self.rows.W:
            self.W = self.W.copy()
        self.settings = replace(self.settings, friction_speed=friction_speed)
        for c, joints in self.coulomb:
            if not changed[speed_owner(joints)]:
                continue
            self.W[:, :, c] = self.rows.coulomb(c, joints, friction_speed)
            for k, p in enumerate(self._places):
                N, right = self._blocks[k].N.copy(), self._blocks[k].c.copy()
                W, tau = self.W[p], self.tau[p]
                for j in np.flatnonzero(joints):
                    N[j, :, c] = N[j, c, :] = W[:, j].T @ W[:, j, c]
                    right[j, c] = W[:, j, c] @ tau[:, j]
                self._blocks[k] = replace(self._blocks[k], N=N, c=right)


# ── Essential parameters: the fewest groups that predict rows held out as well as all of them

# Backward elimination: of the groups that are left, the one goes whose absence raises the squared residuals least,
#
#     x_i² / (A⁻¹)_ii,     x ← x - A⁻¹ e_i x_i / (A⁻¹)_ii,     A⁻¹ ← A⁻¹ - A⁻¹ e_i e_i' A⁻¹ / (A⁻¹)_ii
#
# and the order of all is judged by fifths of the time, each predicted from the others.
#
# Source: Pham and Gautier, "Essential parameters of robots", IEEE CDC 1991.

_NEAR_BEST = 1.01  # times the least residual held out, that fewer groups may leave


@dataclass(frozen=True, eq=False)
class EssentialGroups:
    """Essential groups of parameters, besides those that are known; the others are taken for zero.

    Attributes
    ----------
    names : tuple of str
    places : (k,) array, their numbers among all groups
    values : (k,) array, fitted anew without the others
    held_out : float, |τ - τ̂| / |τ| of fifths held out, in units of the residuals of each joint
    curve : tuple of (count, share), the same for each count of groups
    """

    names: tuple[str, ...]
    places: Array
    values: Array
    held_out: float
    curve: tuple[tuple[int, float], ...]


def essential_groups(
    names: Sequence[str], folds: Sequence[Information], size: Array, held: Array, values: Array
) -> EssentialGroups:
    """The fewest groups that predict as well as any."""
    x = np.where(held, values, 0.0)  # what known groups do is taken off the torques
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
    """The groups in the order in which they go, those that are known left out."""
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


# ── A bounded cache: least recently used entries go first

Made = TypeVar("Made")


class BoundedMemory(Generic[Made]):
    """Cache of objects by key, up to a number of bytes with room for one more as large as the largest; the last one stays."""

    def __init__(self, most: int, size: Callable[[Made], int]) -> None:
        self._most, self._size = most, size
        self._made: dict[Hashable, Made] = {}

    @property
    def keys(self) -> list[Hashable]:
        """Keys of the cached objects, the last used last."""
        return list(self._made)

    def get(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Cached object of a key; built if it is missing."""
        if key in self._made:
            found = self._made.pop(key)
        else:
            self._keep_below(self._most - max(map(self._size, self._made.values()), default=0), 0)
            found = make()
        self._made[key] = found
        self._keep_below(self._most, 1)
        return found

    def _keep_below(self, most: int, fewest: int) -> None:
        while len(self._made) > fewest and sum(map(self._size, self._made.values())) > most:
            self._made.pop(next(iter(self._made)))


# ── Search for cut-off, clock offset and speeds of friction

# Blocks of time are left out in turn and predicted from the others. A setting is the better the smaller Σ_j log |τ_j -
# τ̂_j|², the
# likelihood of normal residuals whose size differs from joint to joint, so that no joint counts more for its larger torques.
# Cut-offs are compared by torques below the highest of them: against torques of its own, the lowest would always win.

SPEEDS = (0.003, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Speeds that friction turns at [rad/s, m/s] that are tried."""
_USUAL_SPEED = 0.05
_LATER = (1, 2, 3, 4, 5, 7, 10, 15, 25, 40, 60, 90, 130, 200, 300)
_SHIFTS = tuple(1e-3 * s for s in (*(-s for s in reversed(_LATER)), 0, *_LATER))
_ROWS = 10.0  # equations for each group that a cut-off has to leave
_BYTES = 48 * 2**20
"""Memory for rows at several cut-offs, and for normal equations of the blocks at several settings, half of
that; beyond, those used longest ago are made again."""
_NEAR = 1e-3  # s, about an offset that was found, where it is sought again
_WORTH = 2e-3
"""Decrease of log |residual|² for each joint from which another cut-off, offset or speed is preferred to the first one."""
_CHANCE = 6.0
"""Decrease of log |residual|² of all joints, times the independent rows, that an offset or a speed brings by chance once in 70
times: half a log-likelihood ratio that is distributed as χ² of one degree of freedom (Wilks 1938)."""


class SettingRows:
    """The rows of logs at each cut-off that is tried, made once; ``dead`` (nv,) bool are joints without a torque."""

    def __init__(
        self,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        asked: FitOptions,
        dead: Array,
        most_rows: float = MOST_ROWS,
    ) -> None:
        self.base, self.samples, self.asked, self.dead = base, samples, asked, dead
        self.tried = (
            (asked.cutoff,)
            if asked.cutoff is not None
            else cutoffs(samples, _ROWS * base.count / base.unknown.model.nv)
        )
        speed = _USUAL_SPEED if asked.friction_speed is None else asked.friction_speed
        self.usual_speed = np.full(base.unknown.model.nv, speed)
        self._most = most_rows
        self._rows = BoundedMemory[FilteredRows](_BYTES, lambda rows: rows.nbytes)
        self._judged = BoundedMemory[JudgedStates](_BYTES // 3, lambda states: states.W.nbytes)
        self._blocks = BoundedMemory[list[tuple[Array, float]]](
            _BYTES // 2, lambda made: sum(x.nbytes for x, _ in made)
        )

    def rows(self, cutoff: float) -> FilteredRows:
        """At that cut-off, with the usual speed of friction."""

        def build() -> FilteredRows:
            rows = FilteredRows.from_samples(self.base, self.samples, cutoff, self.usual_speed, self._most)
            rows.W[:, self.dead], rows.dead = 0.0, self.dead
            return rows

        return self._rows.get(cutoff, build)

    def judged(self, cutoff: float) -> JudgedStates:
        """States of positions below that cut-off."""
        return self._judged.get(
            cutoff, lambda: JudgedStates.from_samples(self.base, self.samples, cutoff, self.usual_speed)
        )

    def folds(self, log: Array, time: Array) -> Array:
        """(m,) the block of time that each row belongs to, 0 to 4: fifths of all logs together."""
        begins = np.concatenate([[0.0], np.cumsum([s.seconds for s in self.samples])])
        starts = np.array([s.start for s in self.samples])
        at = begins[log] + (time - starts[log])
        return np.minimum((FOLDS * at / begins[-1]).astype(int), FOLDS - 1)

    def kept_blocks(self, settings: FitSettings, make: Callable[[], list[NormalEquations]]) -> list[NormalEquations]:
        """Normal equations of the blocks at settings, made once."""
        key = (settings.cutoff, settings.shift, settings.friction_speed.tobytes())
        packed = self._blocks.get(key, lambda: [(one.packed(self.base.felt), one.rows) for one in make()])
        return [NormalEquations.unpacked(numbers, self.base.felt, rows) for numbers, rows in packed]

    def typical(self) -> tuple[Array, Array, Array]:
        """Typical torque, speed and acceleration of the joints, (nv,) each, above 0."""
        rows = self.rows(self.tried[len(self.tried) // 2])
        found = [np.sqrt((x**2).mean(axis=0)) for x in (rows.torques(0.0), rows.speed, rows.acceleration)]
        usual = [max(float(np.median(x)), 1e-6) for x in found]
        return tuple(np.maximum(x, 1e-2 * u) for x, u in zip(found, usual, strict=True))

    def choose(self, prior: Prior, blocks: Iterable[int]) -> FitSettings:
        """The settings that predict each of some blocks of time best from the others of them."""
        blocks = tuple(blocks)
        settings = FitSettings(self.tried[-1], self.usual_speed.copy(), self.asked.shift or 0.0)
        for _ in range(2):
            cutoff = self._best_cutoff(prior, blocks, settings) if len(self.tried) > 1 else settings.cutoff
            again = cutoff != settings.cutoff
            settings = self._tuned(replace(settings, cutoff=cutoff), prior, blocks)
            if not again:
                break
        return settings

    def _tuned(self, settings: FitSettings, prior: Prior, blocks: tuple[int, ...]) -> FitSettings:
        """Offset of the clock and speeds of friction, one after another, at one cut-off."""
        trial = Trial(self, settings)
        best = trial.score(prior, blocks)
        if self.asked.shift is None:
            best = self._best_shift(trial, prior, blocks, best)
        if self.asked.friction_speed is None and trial.coulomb:
            nv = len(settings.friction_speed)
            for joints in (np.ones(nv, bool), *np.eye(nv, dtype=bool)):
                best = _best_speed(trial, prior, blocks, best, joints, self._worth(settings.cutoff))
        if self.asked.shift is None:
            self._best_shift(trial, prior, blocks, best)
        return trial.settings

    def _worth(self, cutoff: float) -> float:
        """Score that another setting has to gain: more for a short log, where chance gains as much."""
        independent = 2.0 * cutoff * sum(s.seconds for s in self.samples)
        return max(_WORTH * len(self.dead), _CHANCE / independent)

    def _best_shift(self, trial: Trial, prior: Prior, blocks: tuple[int, ...], best: float) -> float:
        worth = self._worth(trial.settings.cutoff)
        begun, first = trial.settings.shift, best
        scores = []
        for shift in _SHIFTS:
            trial.shift(shift)
            scores.append(trial.score(prior, blocks))
        k = int(np.argmin(scores))
        shift, least = _SHIFTS[k], scores[k]
        if 0 < k < len(_SHIFTS) - 1:
            around, of_these = _SHIFTS[k - 1 : k + 2], scores[k - 1 : k + 2]
            for _ in range(2):
                vertex = float(np.clip(_vertex(around, of_these), around[0], around[2]))
                trial.shift(vertex)
                if (found := trial.score(prior, blocks)) >= least:
                    break
                shift, least = vertex, found
                around = (vertex - _NEAR, vertex, vertex + _NEAR)
                of_these = []
                for s in around:
                    trial.shift(s)
                    of_these.append(trial.score(prior, blocks))
        if least > first - worth:
            shift, least = begun, first
        trial.shift(shift)
        return least

    def _best_cutoff(self, prior: Prior, blocks: tuple[int, ...], settings: FitSettings) -> float:
        """By predictions of torques below the highest cut-off; the lowest that is nearly as good as any."""
        torques = [torques_below(s, max(self.tried)) for s in self.samples]
        tried = [replace(settings, cutoff=cutoff) for cutoff in self.tried]
        scores = np.array([self._judged_score(prior, blocks, each, torques) for each in tried])
        return self.tried[int(np.flatnonzero(scores <= scores.min() + _WORTH * len(self.dead))[0])]

    def _judged_score(
        self, prior: Prior, blocks: tuple[int, ...], settings: FitSettings, torques: Sequence[tuple[Array, Array]]
    ) -> float:
        """The sum of log |residual|² over the joints, of torques that are given with their times for each log."""
        trial, judged = Trial(self, settings), self.judged(settings.cutoff)  # one trial at a time is in memory
        tau = np.concatenate(
            [
                np.stack([np.interp(s.time + settings.shift, time, x) for x in tau.T], axis=1)
                for s, (time, tau) in zip(judged.states, torques, strict=True)
            ]
        )
        fold = self.folds(judged.log, judged.time)
        W = judged.W.copy() if trial.coulomb else judged.W
        for c, joints in trial.coulomb:
            of_states = (
                self.base.unknown.drive(int(self.base.kept[c]), s.dq, s.ddq, settings.friction_speed)
                for s in judged.states
            )
            W[:, joints, c] = np.concatenate([value[:, None] * share[joints] for value, share in of_states])
        left = np.zeros(W.shape[1])
        for block, x in trial.fits(prior, blocks):
            here = fold == block
            left += ((tau[here] - judged.known[here] - W[here] @ x) ** 2).sum(axis=0)
        return float(np.log(np.maximum(left[~self.dead], 1e-300)).sum())


def _vertex(x: Sequence[float], y: Sequence[float]) -> float:
    """Minimum of the parabola through three points; the middle point if it has none."""
    (a, b, c), (d, e, f) = x, y
    below = (b - a) * (e - f) - (b - c) * (e - d)
    return b - 0.5 * ((b - a) ** 2 * (e - f) - (b - c) ** 2 * (e - d)) / below if below < 0 else b


def _best_speed(trial: Trial, prior: Prior, blocks: tuple[int, ...], best: float, joints: Array, worth: float) -> float:
    begun = trial.settings.friction_speed
    found, least = begun, best - worth
    for value in SPEEDS:
        tried = np.where(joints, value, begun)
        trial.speed(tried)
        if (score := trial.score(prior, blocks)) < least:
            found, least = tried, score
    trial.speed(found)
    return least if found is not begun else best
