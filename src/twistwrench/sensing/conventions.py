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

SIGNIFICANCE = 1e-4
"""Significance level of the F tests by which another explanation is preferred."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Fit of a log with one sign, with or without an unknown mounting."""

    sign: Sign
    fit: Fit
    kept: Array  # (n,) mask of the used rows, those that are not outliers

    @property
    def turn(self) -> bool:
        """True if the mounting is an unknown."""
        return self.fit.unknowns.turn

    @property
    def noise_product(self) -> float:
        """Product of the residual noise of moments and forces [N² m], by which explanations are compared."""
        return float(np.prod(self.fit.noise))

    @property
    def noise(self) -> tuple[float, float]:
        """Residual noise of moments [N m] and forces [N]: root mean square over the degrees of freedom."""
        residuals = self.fit.residuals[self.kept].reshape(-1, 2, 3)
        moment, force = np.sqrt((residuals**2).sum(axis=(0, 2)) / self.freedom)
        return float(moment), float(force)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the three moments, or of the three forces: each has half of the unknowns."""
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
        rotation_vector = so3.log(self.fit.mounting)
        angle = math.degrees(float(np.linalg.norm(rotation_vector)))
        unknown_mounting = spell(Argument("assume", "orientation"))
        return f"{sign} with {unknown_mounting} (turned by {number(angle, 3)}°)"

    def improves(self, other: Fit) -> bool:
        """True if the residual noise is significantly less than that of another fit of the same log."""
        return _has_significantly_less_noise(self.fit, other, self.kept)

    def equals(self, other: Fit, kept: Array) -> bool:
        """True if another fit is not significantly better on its used rows ``kept``."""
        return not _has_significantly_less_noise(other, self.fit, kept)


def explain(sign: Sign, problem: Problem) -> Diagnosis | None:
    """Best fit of the log with the given sign; None if the log does not determine the unknowns."""
    problem = replace(problem, factor=sign_factor(sign))
    if len(problem.log) < least_rows(problem):
        return None
    if blind_spots(problem.log, problem.unknowns, problem.factor):
        return None
    fit, kept = reject_outliers(with_guessed_mounting(problem))
    return Diagnosis(sign, fit, kept)


def with_guessed_mounting(problem: Problem) -> Problem:
    """Problem with an initial guess of the mounting, if the mounting is an unknown."""
    mounting = first_guess(problem) if problem.unknowns.turn else np.eye(3)
    return replace(problem, state=SensorState(mounting))


def others(sign: Sign, problem: Problem) -> list[Diagnosis]:
    """Fits of the log with other conventions: with the other sign, with a known or unknown mounting, or with both changed.

    Only fits with a positive mass are returned, sorted by noise.
    """
    explanations = []
    for turn in (False, True):  # known mounting, unknown mounting
        for other_sign in get_args(Sign):
            if other_sign == sign and turn == problem.unknowns.turn:
                continue
            explanation = explain(other_sign, problem.with_unknowns(turn=turn))
            if explanation is not None and explanation.mass > 0:
                explanations.append(explanation)
    return sorted(explanations, key=lambda explanation: explanation.noise_product)


def indistinguishable_from_the_best(explanations: list[Diagnosis]) -> list[Diagnosis]:
    """Explanations not significantly worse than the first, which has the least noise.

    An explanation with an unknown mounting is left out if its sign also explains the log with a known mounting.
    """
    best = explanations[0]
    equal_to_best = [e for e in explanations if e is best or e.equals(best.fit, best.kept)]
    signs_with_known_mounting = {e.sign for e in equal_to_best if not e.turn}
    return [e for e in equal_to_best if not e.turn or e.sign not in signs_with_known_mounting]


def first_guess(problem: Problem) -> Array:
    """Initial guess of the mounting R_fs (3, 3) from forces f = bias ± m R_fs' g, for a point mass at the origin of {f}.

    The guess is the rotation nearest to the matrix m R_fs' that fits the forces best.
    """
    log = problem.log
    g = log.gravity
    f = log.readings[:, 3:]
    if log.V is not None and log.dV is not None:  # g minus the acceleration of the origin
        g = g - log.dV[:, 3:] - so3.cross(log.V[:, :3], log.V[:, 3:])
    if problem.unknowns.bias:
        g = g - g.mean(axis=0)
        f = f - f.mean(axis=0)
    else:
        f = f - problem.bias[3:]
    solution, *_ = np.linalg.lstsq(g, f, rcond=None)
    M = problem.factor * solution.T  # m R_fs'
    U, _, Vt = np.linalg.svd(M)
    R_sf = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return np.asarray(R_sf.T)


def _has_significantly_less_noise(fit: Fit, other: Fit, rows: Array) -> bool:
    """True if the residuals of a fit are significantly less than those of another (F test of the variances)."""
    from scipy import special

    scale = np.repeat(fit.spread(rows), 3)  # (6,) sizes of moments and forces, so that both have equal weight
    variance, freedom = _residual_variance(fit, rows, scale)
    other_variance, other_freedom = _residual_variance(other, rows, scale)
    return other_variance / variance > float(special.fdtri(other_freedom, freedom, 1 - SIGNIFICANCE))


def _residual_variance(fit: Fit, rows: Array, scale: Array) -> tuple[float, float]:
    """Variance of the residuals of some rows, divided by ``scale`` (6,), and its degrees of freedom."""
    freedom = max(6.0 * rows.sum() - len(fit.unknowns.names), 1.0)
    return float(((fit.residuals[rows] / scale) ** 2).sum()) / freedom, freedom


_TINY_DEVIATION = 1e-12
"""Standard deviation [N m or N] in place of 0, as a divisor."""
_TINY_SUM = 1e-9
"""Sum of squares in place of 0, for exact data."""
_BIAS_SIZE = 6.0
"""Number of unknowns of a bias: three moments and three forces."""


def free_bias(found: Diagnosis, problem: Problem) -> Diagnosis | None:
    """Fit with an estimated bias if it is significantly better than that with the given bias; else None.

    An F test compares the residuals that six more unknowns explain with the residuals that remain.
    """
    if found.fit.unknowns.bias:
        return None
    from scipy import special

    with_free_bias = explain(found.sign, problem.with_unknowns(bias=True))
    if with_free_bias is None or with_free_bias.mass <= 0:
        return None
    rows = with_free_bias.kept & found.kept
    scale = np.maximum(with_free_bias.fit.deviation[rows], _TINY_DEVIATION)
    free_sum = float(((with_free_bias.fit.residuals[rows] / scale) ** 2).sum())
    given_sum = float(((found.fit.residuals[rows] / scale) ** 2).sum())
    freedom = max(6.0 * rows.sum() - len(with_free_bias.fit.unknowns.names), 1.0)
    max_F = float(special.fdtri(_BIAS_SIZE, freedom, 1 - SIGNIFICANCE))
    explained_variance = (given_sum - free_sum) / _BIAS_SIZE
    if explained_variance > max_F * max(free_sum, _TINY_SUM) / freedom:
        return with_free_bias
    return None


_SWAP = [3, 4, 5, 0, 1, 2]
"""Indices that exchange moments (0, 1, 2) and forces (3, 4, 5)."""


def swap_forces_and_moments(problem: Problem, reference: Diagnosis) -> Diagnosis | None:
    """Fit with forces and moments exchanged, if significantly better than the reference; else None."""
    swapped_log = replace(problem.log, readings=problem.log.readings[:, _SWAP])
    noise = None if problem.noise is None else problem.noise[_SWAP]
    swapped_problem = replace(
        problem, log=swapped_log, bias=problem.bias[_SWAP], within=problem.within[_SWAP], noise=noise
    )
    reference_fit: Fit = replace(reference.fit, residuals=reference.fit.residuals[:, _SWAP])
    better_explanations = []
    for sign in get_args(Sign):
        explanation = explain(sign, swapped_problem.with_unknowns(turn=False))
        if explanation is None or explanation.mass <= 0:
            continue
        if explanation.improves(reference_fit):
            better_explanations.append(explanation)
    return min(better_explanations, key=lambda explanation: explanation.noise_product, default=None)


def upside_down(found: Diagnosis, problem: Problem, reference: Diagnosis) -> Diagnosis | None:
    """Fit of a log in motion with gravity reversed, if significantly better than the reference; else None.

    A log at rest cannot tell reversed gravity from the opposite sign.
    """
    log = problem.log
    if not log.by_gravity or log.V is None:
        return None
    reversed_log = replace(log, gravity=-log.gravity)
    explanation = explain(found.sign, replace(problem, log=reversed_log))
    if explanation is None or explanation.mass <= 0:
        return None
    return explanation if explanation.improves(reference.fit) else None
