"""Conventions of a log: fits with other signs, mountings, biases, and swapped or inverted inputs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from ..core.numbers import number
from ..core.text import Argument, spell
from ..core.typing import Array
from ..mechanics.lie import so3
from .fit import Fit, Problem
from .observability import blind_spots
from .outliers import least_rows, reject_outliers
from .sensor import Sign, sign_factor
from .unknowns import SensorState

SIGNIFICANCE = 1e-4  # significance level for preferring another explanation


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Fit of a log with one sign, with or without an unknown mounting."""

    sign: Sign
    fit: Fit
    kept: Array  # (n,) mask of used rows

    @property
    def turn(self) -> bool:
        """True if the mounting is an unknown."""
        return self.fit.unknowns.turn

    @property
    def noise_product(self) -> float:
        """Product of the residual noise of moments and forces."""
        return float(np.prod(self.fit.noise))

    @property
    def noise(self) -> tuple[float, float]:
        """Residual noise of moments [N m] and forces [N]: root mean square over the degrees of freedom."""
        residuals = self.fit.residuals[self.kept].reshape(-1, 2, 3)
        moment, force = np.sqrt((residuals**2).sum(axis=(0, 2)) / self.freedom)
        return float(moment), float(force)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of three channels."""
        return max(3.0 * self.kept.sum() - len(self.fit.unknowns.names) / 2, 1.0)

    @property
    def mass(self) -> float:
        """Mass [kg]; negative if this does not explain the log."""
        return float(self.fit.load[0])

    @property
    def options(self) -> str:
        """Arguments that select this explanation."""
        sign = spell(Argument("sign", self.sign))
        if not self.turn:
            return sign
        degrees = math.degrees(float(np.linalg.norm(so3.log(self.fit.mounting))))
        return f"{sign} with {spell(Argument('assume', 'orientation'))} (turned by {number(degrees, 3)}°)"

    def improves(self, on: Fit) -> bool:
        """True if the residual noise is significantly less than that of another fit of the same log."""
        return _surely_less(self.fit, on, self.kept)

    def equals(self, other: Fit, kept: Array) -> bool:
        """True if another fit is not significantly better."""
        return not _surely_less(other, self.fit, kept)


def explain(sign: Sign, problem: Problem) -> Diagnosis | None:
    """Best fit of the log with the given sign; None if the log does not determine the unknowns."""
    problem = replace(problem, factor=sign_factor(sign))
    if len(problem.log) < least_rows(problem) or blind_spots(problem.log, problem.unknowns, problem.factor):
        return None
    return Diagnosis(sign, *reject_outliers(with_guessed_mounting(problem)))


def with_guessed_mounting(problem: Problem) -> Problem:
    """Problem with an initial guess of the mounting, if the mounting is an unknown."""
    mounting = first_guess(problem) if problem.unknowns.turn else np.eye(3)
    return replace(problem, state=SensorState(mounting))


def others(sign: Sign, problem: Problem) -> list[Diagnosis]:
    """Fits with other signs and mountings and a positive mass, sorted by noise."""
    explanations = []
    for turn in (False, True):
        for other in get_args(Sign):
            if (other, turn) != (sign, problem.unknowns.turn):
                explanation = explain(other, problem.with_unknowns(turn=turn))
                if explanation is not None and explanation.mass > 0:
                    explanations.append(explanation)
    return sorted(explanations, key=lambda e: e.noise_product)


def as_good_as_the_best(sorted_: list[Diagnosis]) -> list[Diagnosis]:
    """Fits not significantly worse than the first; with an unknown mounting only if its sign fits no log without."""
    best = sorted_[0]
    good = [e for e in sorted_ if e is best or e.equals(best.fit, best.kept)]
    signs_without_turn = {e.sign for e in good if not e.turn}
    return [e for e in good if not (e.turn and e.sign in signs_without_turn)]


def first_guess(problem: Problem) -> Array:
    """Initial guess of the mounting R_fs (3, 3) from forces: the rotation nearest to M of f = bias + M g."""
    log = problem.log
    g, f = log.gravity, log.readings[:, 3:]
    if log.V is not None and log.dV is not None:
        g = g - log.dV[:, 3:] - so3.cross(log.V[:, :3], log.V[:, 3:])
    if problem.unknowns.bias:
        g, f = g - g.mean(axis=0), f - f.mean(axis=0)
    else:
        f = f - problem.bias[3:]
    M = problem.factor * np.linalg.lstsq(g, f, rcond=None)[0].T  # m R_fs'
    U, _, Vt = np.linalg.svd(M)
    return np.asarray((U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T)


def _surely_less(less: Fit, more: Fit, rows: Array) -> bool:
    """True if the residuals of one fit are significantly less than those of another (F test of the variances)."""
    from scipy import special

    scale = np.repeat(less.spread(rows), 3)
    freedoms, variances = [], []
    for f in (less, more):
        freedom = max(6.0 * rows.sum() - len(f.unknowns.names), 1.0)
        freedoms.append(freedom)
        variances.append(float(((f.residuals[rows] / scale) ** 2).sum()) / freedom)
    return variances[1] / variances[0] > float(special.fdtri(freedoms[1], freedoms[0], 1 - SIGNIFICANCE))


_SWAP = [3, 4, 5, 0, 1, 2]


def free_bias(found: Diagnosis, problem: Problem) -> Diagnosis | None:
    """Fit with an estimated bias if significantly better than with the given one (F test of the six); else None."""
    if found.fit.unknowns.bias:
        return None
    from scipy import special

    free = explain(found.sign, problem.with_unknowns(bias=True))
    if free is None or free.mass <= 0:
        return None
    rows = free.kept & found.kept
    scale = np.maximum(free.fit.deviation[rows], 1e-12)
    free_sum = float(((free.fit.residuals[rows] / scale) ** 2).sum())
    given_sum = float(((found.fit.residuals[rows] / scale) ** 2).sum())
    freedom = max(6.0 * rows.sum() - len(free.fit.unknowns.names), 1.0)
    limit = float(special.fdtri(6.0, freedom, 1 - SIGNIFICANCE))
    if (given_sum - free_sum) / 6 > limit * max(free_sum, 1e-9) / freedom:
        return free
    return None


def swap_forces_and_moments(problem: Problem, reference: Diagnosis) -> Diagnosis | None:
    """Fit with forces and moments exchanged, if significantly better than the reference; else None."""
    swapped_log = replace(problem.log, readings=problem.log.readings[:, _SWAP])
    noise = None if problem.noise is None else problem.noise[_SWAP]
    problem = replace(problem, log=swapped_log, bias=problem.bias[_SWAP], within=problem.within[_SWAP], noise=noise)
    reference_fit: Fit = replace(reference.fit, residuals=reference.fit.residuals[:, _SWAP])
    good = []
    for sign in get_args(Sign):
        explanation = explain(sign, problem.with_unknowns(turn=False))
        if explanation is not None and explanation.mass > 0 and explanation.improves(reference_fit):
            good.append(explanation)
    return min(good, key=lambda e: e.noise_product, default=None)


def upside_down(found: Diagnosis, problem: Problem, reference: Diagnosis) -> Diagnosis | None:
    """Fit of a log in motion with gravity reversed, if significantly better; at rest this equals the opposite sign."""
    log = problem.log
    if not log.by_gravity or log.V is None:
        return None
    other = explain(found.sign, replace(problem, log=replace(log, gravity=-log.gravity)))
    if other is not None and other.mass > 0 and other.improves(reference.fit):
        return other
    return None
