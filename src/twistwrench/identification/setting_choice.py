"""The choice of cut-off, clock offset and speeds of friction, on training rows alone.

Blocks of time are left out in turn and predicted from the others. A setting is the better the smaller Σ_j log |τ_j - τ̂_j|², the
likelihood of normal residuals whose size differs from joint to joint, so that no joint counts more for its larger torques.
Cut-offs are compared by torques below the highest of them: against torques of its own, the lowest would always win.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..typing import Array
from .bounded_memory import BoundedMemory
from .filtered_rows import MOST_ROWS, FilteredRows, JudgedStates
from .normal_equations import FeltEquations, NormalEquations, Prior
from .parameter_groups import BaseParameters
from .setting_trial import FOLDS, Asked, FitSettings, Trial
from .zero_phase import SteadySamples, cutoffs, torques_below

SPEEDS = (0.003, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Speeds that friction turns at [rad/s, m/s] that are tried."""
_USUAL_SPEED = 0.05
_SHIFTS = tuple(
    1e-3 * s
    for s in (-90, -60, -40, -25, -15, -10, -7, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 7, 10, 15, 25, 40, 60, 90)
)
_ROWS = 10.0
"""Equations for each group that a cut-off has to leave."""
_BYTES = 48 * 2**20
"""Of rows at several cut-offs that are kept at a time, and of normal equations of the blocks at several settings, half of
that; beyond, those used longest ago are made again."""
_NEAR = 1e-3
"""s, about an offset that was found, where it is sought again."""
_WORTH = 2e-3
"""Of log |residual|², that another cut-off, offset or speed has to bring for each joint; else the first one stays."""
_CHANCE = 6.0
"""Of log |residual|² of all joints, by the independent rows there are, what an offset or a speed brings by chance once in 70
times: half a log-likelihood ratio that is distributed as χ² of one degree of freedom (Wilks 1938)."""


class SettingRows:
    """The rows of logs at each cut-off that is tried, made once; ``dead`` (nv,) bool are joints without a torque."""

    def __init__(
        self,
        base: BaseParameters,
        samples: Sequence[SteadySamples],
        asked: Asked,
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
        self._blocks = BoundedMemory[tuple[FeltEquations, ...]](_BYTES // 2, lambda made: sum(x.nbytes for x in made))

    def rows(self, cutoff: float) -> FilteredRows:
        """At that cut-off, with the usual speed of friction."""

        def made() -> FilteredRows:
            rows = FilteredRows.of(self.base, self.samples, cutoff, self.usual_speed, self._most)
            rows.W[:, self.dead], rows.dead = 0.0, self.dead
            return rows

        return self._rows.of(cutoff, made)

    def judged(self, cutoff: float) -> JudgedStates:
        """States of positions below that cut-off."""
        return self._judged.of(cutoff, lambda: JudgedStates.of(self.base, self.samples, cutoff, self.usual_speed))

    def folds(self, log: Array, time: Array) -> Array:
        """(m,) the block of time that each row belongs to, 0 to 4: fifths of all logs together."""
        begins = np.concatenate([[0.0], np.cumsum([s.seconds for s in self.samples])])
        starts = np.array([s.start for s in self.samples])
        at = begins[log] + (time - starts[log])
        return np.minimum((FOLDS * at / begins[-1]).astype(int), FOLDS - 1)

    def kept_blocks(
        self, settings: FitSettings, make: Callable[[], list[NormalEquations]]
    ) -> tuple[NormalEquations, ...]:
        """Normal equations of the blocks at settings, made once; nothing changes them in place."""
        key = (settings.cutoff, settings.shift, settings.friction_speed.tobytes())
        kept = self._blocks.of(key, lambda: tuple(FeltEquations.of(one, self.base.felt) for one in make()))
        return tuple(one.whole() for one in kept)

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
        """What another setting has to bring: of a short log more, where chance brings as much."""
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
        """By predictions of torques below the highest cut-off."""
        top = max(self.tried)
        torques = [torques_below(s, top) for s in self.samples]
        scores = np.array(
            [self._judged_score(prior, blocks, replace(settings, cutoff=cutoff), torques) for cutoff in self.tried]
        )
        good = np.flatnonzero(scores <= scores.min() + _WORTH * len(self.dead))
        return self.tried[int(good[0])]

    def _judged_score(
        self, prior: Prior, blocks: tuple[int, ...], settings: FitSettings, torques: Sequence[tuple[Array, Array]]
    ) -> float:
        """The sum of log |residual|² over the joints, of torques that are given with their times for each log."""
        trial, judged = Trial(self, settings), self.judged(settings.cutoff)
        tau = np.concatenate(
            [
                np.stack([np.interp(s.time + settings.shift, time, x) for x in tau.T], axis=1)
                for s, (time, tau) in zip(judged.states, torques, strict=True)
            ]
        )
        fold = self.folds(judged.log, judged.time)
        W = judged.W.copy() if trial.coulomb else judged.W
        for c, joints in trial.coulomb:
            kept = self.base.kept[c : c + 1]
            new = [
                self.base.unknown.columns(kept, s.q, s.dq, s.ddq, settings.friction_speed)[..., 0]
                for s in judged.states
            ]
            W[:, joints, c] = np.concatenate(new)[:, joints]
        left = np.zeros(W.shape[1])
        for block, x in trial.fits(prior, blocks):
            here = fold == block
            left += ((tau[here] - judged.known[here] - W[here] @ x) ** 2).sum(axis=0)
        return float(np.log(np.maximum(left[~self.dead], 1e-300)).sum())


def _vertex(x: Sequence[float], y: Sequence[float]) -> float:
    """Where the parabola through three points is least; the middle one where it has no such place."""
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
