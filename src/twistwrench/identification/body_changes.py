"""Changes of the bodies that an identification found: masses and centres of mass against the file's, and a mounted tool.

A log determines few masses by themselves. The deviations of single masses are therefore those with the file as prior, which
is taken as right to 20 % at least: with A the groups by the coordinates of a step that keeps bodies consistent, C the
covariance of the groups, and P = 1 / min(γ, 25),

    cov = P - P A' (A P A' + C)^-1 A P

To them are added the changes if the prior is a hundred times weaker, and if one body alone differs from the file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.estimation.least_squares import Information, Prior, left_out, squares_of, sum_of
from ..core.typing import Array
from ..mechanics.algorithms.inverse_dynamics import PARAMETER_NAMES
from .consistent import STRENGTHS, PositivePrior, PositiveProblem

if TYPE_CHECKING:
    from .result import IdentifiedRobot

_MIN_DEVIATIONS = 2.0
"""Deviations from which a change of a mass is sure."""
_MIN_SQUARED_DEVIATIONS = 7.81
"""Squared deviations from which a change of three coordinates is as sure: 95 % of χ² with three degrees of freedom."""
_MIN_TOOL_DEVIATIONS, _MIN_TOOL_MASS, _MIN_EXCESS_SHARE = 5.0, 0.03, 0.95
"""A tool: least change of mass in deviations and as a share of the moving mass, and least share of the excess explained."""
_MC = [PARAMETER_NAMES.index(name) for name in ("mcx", "mcy", "mcz")]
_M = PARAMETER_NAMES.index("m")


@dataclass(frozen=True, eq=False)
class LoneChange:
    """Fit in which one body alone differs from the file, with friction, offsets and motor inertias free.

    Attributes
    ----------
    link : str, name of the body
    mass, deviation : float, change of its mass and the standard deviation of the change [kg]
    held_out : float, |τ - τ̂| / |τ| of held-out fifths, in units of each joint's residuals
    values : (p,) array, of all unknown parameters
    """

    link: str
    mass: float
    deviation: float
    held_out: float
    values: Array


@dataclass(frozen=True, eq=False)
class BodyChanges:
    """Bodies of the file and identified bodies.

    Attributes
    ----------
    links : sequence of str, names of the n bodies
    before, masses : (n,) arrays, mass in the file and identified mass [kg]
    covariance : (n, n) array, of the identified masses [kg²]
    moved : (n,) array, distance between both centres of mass [m]; nan for a body without mass in the file
    is_moved : (n,) bool array, True if the move of the centre is sure
    tool : LoneChange or None, change of the one body that explains the log
    """

    links: Sequence[str]
    before: Array
    masses: Array
    covariance: Array
    moved: Array
    is_moved: Array
    tool: LoneChange | None

    @property
    def deviations(self) -> Array:
        """(n,) standard deviations of the identified masses [kg]."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def is_heavier(self) -> Array:
        """(n,) bool array, True if the change of the mass is sure."""
        return np.asarray(np.abs(self.masses - self.before) > _MIN_DEVIATIONS * self.deviations)

    @property
    def is_sum_heavier(self) -> bool:
        """True if the change of the sum of the masses is sure."""
        change = float((self.masses - self.before).sum())
        return abs(change) > _MIN_DEVIATIONS * math.sqrt(max(float(self.covariance.sum()), 0.0))

    def to_list(self) -> list[dict[str, Any]]:
        """Plain data of each body, in SI units.

        Returns
        -------
        bodies : list of dict

        Examples
        --------
        >>> one = BodyChanges(["rod"], np.ones(1), np.full(1, 1.5), np.full((1, 1), 0.01), np.zeros(1), np.zeros(1, bool), None)
        >>> one.to_list()[0]["mass_changed"], one.is_sum_heavier
        (True, True)
        """
        bodies, deviations, is_heavier = [], self.deviations, self.is_heavier
        for k, link in enumerate(self.links):
            bodies.append({
                "link": link, "file_mass": float(self.before[k]), "mass": float(self.masses[k]),
                "deviation": float(deviations[k]), "mass_changed": bool(is_heavier[k]),
                "com_moved": float(self.moved[k]), "com_changed": bool(self.is_moved[k]),
            })  # fmt: skip
        return bodies


def body_changes(found: IdentifiedRobot) -> BodyChanges:
    """Masses and centres of the consistent bodies against the file's, and the body that alone explains the log."""
    unknown, consistent = found.base.unknown, found.consistent
    fit = _Fit(found)
    tool = fit.tool
    C = fit.covariance if tool is None else fit.covariance + _square(tool.values - consistent.fit.values)
    ten = 10 * np.array(unknown.bodies, int)[:, None] + np.arange(10)
    place = np.argmax(unknown.of_bodies == ten[..., None], axis=-1)  # (n, 10)
    before, after = unknown.file_values[place], consistent.fit.values[place]
    moved, is_moved = [], []
    for old, new, at in zip(before, after, place, strict=True):
        c = old[_MC] / old[_M] if old[_M] > 0 else np.zeros(3)
        J = np.column_stack([np.eye(3), -c])  # a mass added at the centre does not move it
        own = at[[*_MC, _M]]
        change, cov = J @ (new - old)[[*_MC, _M]], J @ C[np.ix_(own, own)] @ J.T
        is_moved.append(float(change @ np.linalg.pinv(cov, hermitian=True) @ change) > _MIN_SQUARED_DEVIATIONS)
        moved.append(float(np.linalg.norm(new[_MC] / new[_M] - c)) if old[_M] > 0 else math.nan)
    m = place[:, _M]
    links = [unknown.model.bodies[i].link for i in unknown.bodies]
    return BodyChanges(
        links, before[:, _M], after[:, _M], C[np.ix_(m, m)], np.array(moved), np.array(is_moved, bool), tool
    )


def _square(x: Array) -> Array:
    return np.outer(x, x)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Normal equations of an identification, by fifths of the time."""

    found: IdentifiedRobot

    @cached_property
    def parts(self) -> list[Information]:
        return [part for part in self.found._information() if part[2] > 0]

    @cached_property
    def covariance(self) -> Array:
        """(p, p) covariance of all unknown parameters with the file as prior."""
        found, fit = self.found, self.found.consistent.fit
        prior = PositivePrior.from_values(found.base, found.values, found.sizes)
        problem = PositiveProblem(found.base, prior, *sum_of(self.parts), found.sizes)
        stronger = [strength for strength in STRENGTHS if strength > fit.strength]
        weak = problem.path([*stronger, fit.strength, 0.1 * fit.strength, 0.01 * fit.strength])[-1]
        return problem.covariance(fit, found.covariance.matrix) + _square(weak.values - fit.values)

    def lone_change(self, link: str) -> LoneChange:
        """Change of one body if no other differs from the file."""
        base, unknown, sizes = self.found.base, self.found.base.unknown, self.found.sizes
        owners = np.array([name.rpartition(".")[0] for name in unknown.names])
        drives = (unknown.of_bodies < 0) & ~unknown.held
        free = np.flatnonzero(drives | ((owners == link) & ~unknown.held))
        start = np.where(drives, 0.0, unknown.file_values)
        x_start, K = base.project(start), base.grouping[:, free]
        solver = Prior(np.zeros(len(free)), sizes[free])

        def solve(rows: Information) -> Array:
            N, c, _ = rows
            return solver.solve(K.T @ N @ K, K.T @ (c - N @ x_start))

        N, _, y = total = sum_of(self.parts)
        squares = 0.0
        for part, training in left_out(self.parts):
            squares += squares_of(part, x_start + K @ solve(training))
        m = int(np.flatnonzero(free == unknown.names.index(f"{link}.m"))[0])
        by_groups = N @ K @ solver.solve(K.T @ N @ K, np.eye(len(free))[m])  # derivative of the mass by the groups
        values = start.copy()
        values[free] += solve(total)
        deviation = math.sqrt(max(float(by_groups @ self.found.covariance.matrix @ by_groups), 0.0))
        return LoneChange(link, float(values[free[m]] - start[free[m]]), deviation, math.sqrt(squares / y), values)

    @property
    def held_out_with_gain(self) -> float:
        """|τ - τ̂| / |τ| of held-out fifths, if one factor of all bodies and the drives alone differ from the file."""
        base, unknown = self.found.base, self.found.base.unknown
        of_bodies = unknown.of_bodies >= 0
        drives = np.flatnonzero(~of_bodies & ~unknown.held)
        others = base.project(np.where(of_bodies | unknown.held, unknown.file_values, 0.0))
        gain = base.project(np.where(of_bodies & ~unknown.held, unknown.file_values, 0.0))
        K = np.column_stack([gain, base.grouping[:, drives]])
        solver = Prior(np.zeros(1 + len(drives)), np.append(1.0, self.found.sizes[drives]))
        squares = 0.0
        for part, (N, c, _) in left_out(self.parts):
            squares += squares_of(part, others + K @ solver.solve(K.T @ N @ K, K.T @ (c - N @ others)))
        return math.sqrt(squares / sum_of(self.parts)[2])

    @property
    def tool(self) -> LoneChange | None:
        """Change of a last body that explains nearly all that the file does not; None without one.

        None also if one factor of all bodies explains as much: no log tells it from a gain of the torques.
        """
        found, unknown = self.found, self.found.base.unknown
        bodies, of_file = unknown.model.bodies, found.consistent.of_file**2
        excess = of_file - found.consistent.held_out**2
        carriers = {body.parent for body in bodies}
        ends = [i for i in unknown.bodies if i not in carriers and f"{bodies[i].link}.m" not in unknown.known]
        if not ends:
            return None
        change = min((self.lone_change(bodies[i].link) for i in ends), key=lambda one: one.held_out)
        if of_file - change.held_out**2 < _MIN_EXCESS_SHARE * excess:
            return None
        if of_file - self.held_out_with_gain**2 >= _MIN_EXCESS_SHARE * excess:
            return None
        moving = sum(float(bodies[i].inertia.mass) for i in unknown.bodies)
        large = (
            abs(change.mass) > _MIN_TOOL_MASS * moving and abs(change.mass) > _MIN_TOOL_DEVIATIONS * change.deviation
        )
        return change if large else None
