"""Other ways to explain a log: the other sign, a mounting that is turned, or both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from ..core.printed_numbers import number
from ..lie import so3
from ..typing import Array
from .fit import Fit, Problem
from .log import ReadingLog
from .observability import blind_spots
from .outliers import least_rows, trimmed
from .sensor import Sign, sign_factor
from .unknowns import SensorState

_SURE = 1e-4  # chance to prefer another explanation by luck
_MAYBE = 1e-2  # chance to try others in vain
_OFF_PLANE = 10.0  # times the noise, from which the wrong one of two signs is seen without a test
_ROUND = 0.1  # of the ball's radius: noise below which forces of one size lie on a ball


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """A log explained with one sign, the mounting turned or not."""

    sign: Sign
    fit: Fit
    kept: Array
    """(n,) which rows of the problem were used."""

    @property
    def turn(self) -> bool:
        """Whether the mounting is an unknown."""
        return self.fit.unknowns.turn

    @property
    def left(self) -> float:
        """Product of the noise left of moments and forces."""
        return float(np.prod(self.fit.noise))

    @property
    def mass(self) -> float:
        """kg; negative if it is no explanation."""
        return float(self.fit.load[0])

    @property
    def options(self) -> str:
        """How to ask for it."""
        if not self.turn:
            return f"sign={self.sign!r}"
        degrees = math.degrees(float(np.linalg.norm(so3.log(self.fit.mounting))))
        return f"sign={self.sign!r} with orientation=True (turned by {number(degrees, 3)}°)"

    def improves(self, on: Fit) -> bool:
        """Whether the noise left is surely less than that of another fit of the same log."""
        return _surely_less(self.fit, on, self.kept)

    def equals(self, other: Fit, kept: Array) -> bool:
        """Whether another fit is not surely better than this explanation."""
        return not _surely_less(other, self.fit, kept)


def explain(sign: Sign, problem: Problem) -> Diagnosis | None:
    """The log explained by that sign, as well as it can be; None if it tells too little for these unknowns."""
    asked = replace(problem, factor=sign_factor(sign))
    if len(asked.log) < least_rows(asked) or blind_spots(asked.log, asked.unknowns, asked.factor):
        return None
    return Diagnosis(sign, *trimmed(guessed(asked)))


def guessed(problem: Problem) -> Problem:
    """The problem with a first guess of the mounting, if that is asked for."""
    mounting = first_guess(problem) if problem.unknowns.turn else np.eye(3)
    return replace(problem, state=SensorState(mounting))


def others(sign: Sign, problem: Problem) -> list[Diagnosis]:
    """The explanations that were not asked for and have a mass, the one with least noise first."""
    found = []
    for turn in (False, True):
        for other in get_args(Sign):
            if (other, turn) != (sign, problem.unknowns.turn):
                explanation = explain(other, problem.asked(turn=turn))
                if explanation is not None and explanation.mass > 0:
                    found.append(explanation)
    return sorted(found, key=lambda e: e.left)


def as_good_as_the_best(sorted_: list[Diagnosis]) -> list[Diagnosis]:
    """Those not surely worse than the first; a turned mounting only where that sign does not do without."""
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


def misfit(log: ReadingLog, found: Fit, kept: Array) -> float:
    """What is left of the forces, as a share of how they change in the log."""
    f = log.readings[kept][:, 3:]
    change = float(np.sqrt(np.mean((f - f.mean(axis=0)) ** 2)))
    left = float(np.sqrt(np.mean(found.residuals[kept][:, 3:] ** 2)))
    return left / change if change else 0.0


def in_a_plane(log: ReadingLog, found: Fit, kept: Array, mass: float) -> bool:
    """Whether gravity keeps to a plane, to noise: then a half turn about the plane's normal undoes the other sign."""
    g = log.gravity[kept]
    if found.unknowns.bias:  # what is constant is as good as bias
        g = g - g.mean(axis=0)
    least = float(np.linalg.svd(g, compute_uv=False)[-1]) if len(g) > 2 else 0.0
    return 2.0 * mass * least < _OFF_PLANE * float(found.noise[1])


def unexplained_turns(log: ReadingLog, found: Fit, kept: Array) -> float | None:
    """The noise [N] of forces that poses have no part in, if surely less than what is left; None if it cannot be told.

    At rest forces lie on a ball about the bias, whatever the poses: |f|² = 2 b·f + r² − |b|² is linear in b and the rest.
    """
    from scipy import special

    f = log.readings[kept][:, 3:]
    n = len(f)
    if log.V is not None or n < 7:
        return None
    middle, size = f.mean(axis=0), float(np.linalg.norm(f - f.mean(axis=0), axis=1).max())
    if not size:
        return None
    u = (f - middle) / size
    A = np.column_stack([2 * u, np.ones(n)])
    x, _, rank, _ = np.linalg.lstsq(A, (u * u).sum(axis=1), rcond=1e-6)
    if rank < 4:
        return None
    radius = math.sqrt(max(float(x[3] + x[:3] @ x[:3]), 1e-300))
    off = np.linalg.norm(u - x[:3], axis=1) - radius
    own = size * max(math.sqrt(float(off @ off) / (n - 4)), 1e-12)
    left = float(np.sqrt(np.sum(found.residuals[kept][:, 3:] ** 2) / max(3 * n - len(found.unknowns.names) / 2, 1.0)))
    if own > _ROUND * radius * size or (left / own) ** 2 < special.fdtri(2 * n, n - 4, 1 - _SURE):
        return None
    return own


def turns_may_help(log: ReadingLog, found: Fit, kept: Array) -> bool:
    """Whether some sign and mounting may explain a log surely better: at rest, whether any readings linear in gravity do.

    The bias and the weight of a load are that, in whatever axes and with whatever sign; so where the best of all linear
    maps is no better, nothing else need be tried.
    """
    from scipy import special

    if log.V is not None:
        return True
    g, readings = log.gravity[kept], log.readings[kept]
    A = np.column_stack([np.ones(len(g)), g - g.mean(axis=0)])
    x, _, rank, _ = np.linalg.lstsq(A, readings, rcond=1e-6)
    scale = np.repeat(_deviation(found, kept), 3)
    free, known = 6.0 * (len(g) - rank), 6.0 * len(g) - len(found.unknowns.names)
    if free <= 0 or known <= free:
        return True
    least = float((((readings - A @ x) / scale) ** 2).sum())
    more = float(((found.residuals[kept] / scale) ** 2).sum()) - least
    gain = more / (known - free) - least / free * float(special.fdtri(known - free, free, 1 - _MAYBE))
    return gain > 0


def _surely_less(less: Fit, more: Fit, rows: Array) -> bool:
    from scipy import special

    scale = np.repeat(_deviation(less, rows), 3)
    freedom = [max(6.0 * rows.sum() - len(f.unknowns.names), 1.0) for f in (less, more)]
    mean = [float(((f.residuals[rows] / scale) ** 2).sum()) / n for f, n in zip((less, more), freedom, strict=True)]
    return mean[1] / mean[0] > float(special.fdtri(freedom[1], freedom[0], 1 - _SURE))


def _deviation(found: Fit, rows: Array) -> Array:
    """Standard deviations (2,) of what is left of moments and forces, given noise or not; never zero."""
    left = np.sqrt((found.residuals[rows].reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))
    return np.maximum(left, 1e-12 * (1e-3 + np.abs(found.residuals).max()))
