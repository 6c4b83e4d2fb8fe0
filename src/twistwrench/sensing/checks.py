"""Checks of a sensor log's conventions: sign, mounting, swapped or inverted inputs, drift, gain and cross-talk."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from ..core.numbers import number
from ..lie import so3
from ..typing import Array
from .fit import Fit, Problem, SensorState
from .observability import blind_spots
from .outliers import least_rows, trimmed
from .sensor import Sign, sign_factor

_SURE = 1e-4  # chance to prefer another explanation by luck


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """A log explained with one sign, the mounting turned or not."""

    sign: Sign
    fit: Fit
    kept: Array
    """(n,) which rows of the problem were used."""

    @property
    def turn(self) -> bool:
        """True if the mounting is an unknown."""
        return self.fit.unknowns.turn

    @property
    def left(self) -> float:
        """Product of the noise left of moments and forces."""
        return float(np.prod(self.fit.noise))

    @property
    def mass(self) -> float:
        """Mass [kg]; negative if this does not explain the log."""
        return float(self.fit.load[0])

    @property
    def options(self) -> str:
        """Options of the command that give this explanation."""
        if not self.turn:
            return f"sign={self.sign!r}"
        degrees = math.degrees(float(np.linalg.norm(so3.log(self.fit.mounting))))
        return f"sign={self.sign!r} with orientation=True (turned by {number(degrees, 3)}°)"

    def improves(self, on: Fit) -> bool:
        """True if the remaining noise is surely less than that of another fit of the same log."""
        return _surely_less(self.fit, on, self.kept)

    def equals(self, other: Fit, kept: Array) -> bool:
        """True if another fit is not surely better than this explanation."""
        return not _surely_less(other, self.fit, kept)


def explain(sign: Sign, problem: Problem) -> Diagnosis | None:
    """Best explanation of the log with that sign; None if it does not determine these unknowns."""
    asked = replace(problem, factor=sign_factor(sign))
    if len(asked.log) < least_rows(asked) or blind_spots(asked.log, asked.unknowns, asked.factor):
        return None
    return Diagnosis(sign, *trimmed(guessed(asked)))


def guessed(problem: Problem) -> Problem:
    """Problem with a first guess of the mounting, if that is an unknown."""
    mounting = first_guess(problem) if problem.unknowns.turn else np.eye(3)
    return replace(problem, state=SensorState(mounting))


def others(sign: Sign, problem: Problem) -> list[Diagnosis]:
    """Explanations with other signs and mountings that have a mass, the one with least noise first."""
    found = []
    for turn in (False, True):
        for other in get_args(Sign):
            if (other, turn) != (sign, problem.unknowns.turn):
                explanation = explain(other, problem.asked(turn=turn))
                if explanation is not None and explanation.mass > 0:
                    found.append(explanation)
    return sorted(found, key=lambda e: e.left)


def as_good_as_the_best(sorted_: list[Diagnosis]) -> list[Diagnosis]:
    """Explanations not surely worse than the first; a turned mounting only if its sign does not explain the log without."""
    best = sorted_[0]
    good = [e for e in sorted_ if e is best or e.equals(best.fit, best.kept)]
    straight = {e.sign for e in good if not e.turn}
    return [e for e in good if not (e.turn and e.sign in straight)]


def first_guess(problem: Problem) -> Array:
    """A mounting R_fs (3, 3) from forces alone: the rotation nearest to M of f = bias + M g, however large."""
    log = problem.log
    felt = log.gravity
    if log.V is not None and log.dV is not None:
        felt = log.gravity - log.dV[:, 3:] - so3.cross(log.V[:, :3], log.V[:, 3:])
    f = log.readings[:, 3:]
    if problem.unknowns.bias:
        felt, f = felt - felt.mean(axis=0), f - f.mean(axis=0)
    else:
        f = f - problem.bias[3:]
    M = problem.factor * np.linalg.lstsq(felt, f, rcond=None)[0].T  # m R_fs'
    U, _, Vt = np.linalg.svd(M)
    return np.asarray((U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T)


def _surely_less(less: Fit, more: Fit, rows: Array) -> bool:
    from scipy import special

    scale = np.repeat(less.spread(rows), 3)
    freedom = [max(6.0 * rows.sum() - len(f.unknowns.names), 1.0) for f in (less, more)]
    mean = [float(((f.residuals[rows] / scale) ** 2).sum()) / n for f, n in zip((less, more), freedom, strict=True)]
    return mean[1] / mean[0] > float(special.fdtri(freedom[1], freedom[0], 1 - _SURE))


# ── Input errors other than sign and mounting

_SURE_BIAS = 1e-4  # chance to prefer another bias by luck
_SWAP = [3, 4, 5, 0, 1, 2]


def free_bias(found: Diagnosis, problem: Problem) -> Diagnosis | None:
    """The log explained with a bias of its own, where the one given fits surely worse: an F test of the six."""
    if found.fit.unknowns.bias:
        return None
    from scipy import special

    free = explain(found.sign, problem.asked(bias=True))
    if free is None or free.mass <= 0:
        return None
    rows = free.kept & found.kept
    scale = np.maximum(free.fit.deviation[rows], 1e-12)
    least, more = (float(((e.fit.residuals[rows] / scale) ** 2).sum()) for e in (free, found))
    known = 6.0 * rows.sum() - len(free.fit.unknowns.names)
    limit = float(special.fdtri(6.0, max(known, 1.0), 1 - _SURE_BIAS))
    return free if (more - least) / 6 > limit * max(least, 1e-9) / max(known, 1.0) else None


def swapped(problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """The log explained with forces and moments exchanged, if surely better ``than`` another explanation."""
    other = replace(problem.log, readings=problem.log.readings[:, _SWAP])
    noise = None if problem.noise is None else problem.noise[_SWAP]
    asked = replace(problem, log=other, bias=problem.bias[_SWAP], within=problem.within[_SWAP], noise=noise)
    tried = [explain(sign, asked.asked(turn=False)) for sign in get_args(Sign)]
    exchanged: Fit = replace(than.fit, residuals=than.fit.residuals[:, _SWAP])
    good = [e for e in tried if e is not None and e.mass > 0 and e.improves(exchanged)]
    return min(good, key=lambda e: e.left, default=None)


def upside_down(found: Diagnosis, problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """The log in motion explained with gravity the other way, if surely better; at rest that is the other sign."""
    log = problem.log
    if not log.by_gravity or log.V is None:
        return None
    other = explain(found.sign, replace(problem, log=replace(log, gravity=-log.gravity)))
    return other if other is not None and other.mass > 0 and other.improves(than.fit) else None
