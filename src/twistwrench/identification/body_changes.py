"""Changes of the bodies that an identification found: masses and centres of mass against the file's, and a mounted tool.

A log determines few masses by themselves. Deviations of single masses therefore come from a fit with the file as prior, which
is taken as right to 20 % at least. With A the derivatives of the groups by the coordinates of a step that keeps bodies
consistent, C the covariance of the groups, and P = 1 / min(γ, 25), the covariance in these coordinates is

    cov = P - P A' (A P A' + C)^-1 A P

Two changes δ of the parameters are added to it as δ δ': by a prior that is a hundred times weaker, and by a fit in which one
body alone differs from the file.
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
"""Least sure change of a mass, in its standard deviations."""
_MIN_SQUARED_DEVIATIONS = 7.81
"""Least sure change of three coordinates, as its squared standard deviations: 95 % of χ² with three degrees of freedom."""
_MIN_TOOL_DEVIATIONS = 5.0
"""Least mass of a tool, in its standard deviations."""
_MIN_TOOL_MASS = 0.03
"""Least mass of a tool, as a share of the moving mass."""
_MIN_EXCESS_SHARE = 0.95
"""Least share of the file's excess residual that a tool explains."""
_MC = [PARAMETER_NAMES.index(name) for name in ("mcx", "mcy", "mcz")]
"""Indices of the first moments among the parameters of a body."""
_M = PARAMETER_NAMES.index("m")
"""Index of the mass among the parameters of a body."""


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
    C = fit.covariance
    if tool is not None:
        C = C + _outer_square(tool.values - consistent.fit.values)
    columns = 10 * np.array(unknown.bodies, int)[:, None] + np.arange(10)  # of the regressor
    indices = np.argmax(unknown.of_bodies == columns[..., None], axis=-1)  # (n, 10) of the bodies' parameters
    before, after = unknown.file_values[indices], consistent.fit.values[indices]
    moved, is_moved = [], []
    for old, new, own_indices in zip(before, after, indices, strict=True):
        has_mass = old[_M] > 0
        c = old[_MC] / old[_M] if has_mass else np.zeros(3)
        J = np.column_stack([np.eye(3), -c])  # of m c - m c_file: a mass added at the centre does not move it
        moments_and_mass = own_indices[[*_MC, _M]]
        change = J @ (new - old)[[*_MC, _M]]
        covariance = J @ C[np.ix_(moments_and_mass, moments_and_mass)] @ J.T
        squared_deviations = float(change @ np.linalg.pinv(covariance, hermitian=True) @ change)
        is_moved.append(squared_deviations > _MIN_SQUARED_DEVIATIONS)
        moved.append(float(np.linalg.norm(new[_MC] / new[_M] - c)) if has_mass else math.nan)
    masses = indices[:, _M]
    links = [unknown.model.bodies[i].link for i in unknown.bodies]
    return BodyChanges(
        links, before[:, _M], after[:, _M], C[np.ix_(masses, masses)], np.array(moved), np.array(is_moved, bool), tool
    )


def _outer_square(x: Array) -> Array:
    return np.outer(x, x)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Further fits to the rows of an identification."""

    found: IdentifiedRobot

    @cached_property
    def fifths(self) -> list[Information]:
        """Normal equations N, c and |τ|² of each fifth of the time, without empty ones."""
        return [fifth for fifth in self.found._information() if fifth[2] > 0]

    @cached_property
    def covariance(self) -> Array:
        """(p, p) covariance of all unknown parameters with the file as prior."""
        found, fit = self.found, self.found.consistent.fit
        prior = PositivePrior.from_values(found.base, found.values, found.sizes)
        problem = PositiveProblem(found.base, prior, *sum_of(self.fifths), found.sizes)
        stronger = [strength for strength in STRENGTHS if strength > fit.strength]
        # the path to a weak prior leads over all stronger ones
        weak_fit = problem.path([*stronger, fit.strength, 0.1 * fit.strength, 0.01 * fit.strength])[-1]
        return problem.covariance(fit, found.covariance.matrix) + _outer_square(weak_fit.values - fit.values)

    def lone_change(self, link: str) -> LoneChange:
        """Change of one body if no other differs from the file."""
        base, unknown, sizes = self.found.base, self.found.base.unknown, self.found.sizes
        owners = np.array([name.rpartition(".")[0] for name in unknown.names])
        is_drive = (unknown.of_bodies < 0) & ~unknown.held
        is_of_link = (owners == link) & ~unknown.held
        free = np.flatnonzero(is_drive | is_of_link)
        start = np.where(is_drive, 0.0, unknown.file_values)
        x_start, K = base.project(start), base.grouping[:, free]  # groups are x_start + K z for changes z of free ones
        prior = Prior(np.zeros(len(free)), sizes[free])

        def solve(rows: Information) -> Array:
            """Changes of the free parameters, fitted to rows."""
            N, c, _ = rows
            return prior.solve(K.T @ N @ K, K.T @ (c - N @ x_start))

        total = sum_of(self.fifths)
        N, _, squared_torques = total
        squares = 0.0
        for held_out, training in left_out(self.fifths):
            squares += squares_of(held_out, x_start + K @ solve(training))
        m = int(np.flatnonzero(free == unknown.names.index(f"{link}.m"))[0])
        mass_by_groups = N @ K @ prior.solve(K.T @ N @ K, np.eye(len(free))[m])
        deviation = math.sqrt(max(float(mass_by_groups @ self.found.covariance.matrix @ mass_by_groups), 0.0))
        values = start.copy()
        values[free] += solve(total)
        mass_change = float(values[free[m]] - start[free[m]])
        return LoneChange(link, mass_change, deviation, math.sqrt(squares / squared_torques), values)

    @property
    def held_out_with_gain(self) -> float:
        """|τ - τ̂| / |τ| of held-out fifths, if one factor of all bodies and the drives alone differ from the file."""
        base, unknown = self.found.base, self.found.base.unknown
        is_body = unknown.of_bodies >= 0
        drives = np.flatnonzero(~is_body & ~unknown.held)
        x_start = base.project(np.where(is_body | unknown.held, unknown.file_values, 0.0))
        x_bodies = base.project(np.where(is_body & ~unknown.held, unknown.file_values, 0.0))
        # groups are x_start + K z, with z the change of the factor from 1, and values of the drives
        K = np.column_stack([x_bodies, base.grouping[:, drives]])
        prior = Prior(np.zeros(1 + len(drives)), np.append(1.0, self.found.sizes[drives]))
        squares = 0.0
        for held_out, (N, c, _) in left_out(self.fifths):
            z = prior.solve(K.T @ N @ K, K.T @ (c - N @ x_start))
            squares += squares_of(held_out, x_start + K @ z)
        _, _, squared_torques = sum_of(self.fifths)
        return math.sqrt(squares / squared_torques)

    @property
    def tool(self) -> LoneChange | None:
        """Change of a last body that explains nearly all of the file's excess residual; None without such a body.

        The result is None, too, if one factor of all bodies explains as much: no log distinguishes it from a gain of the
        torques.
        """
        found, unknown = self.found, self.found.base.unknown
        bodies = unknown.model.bodies
        file_squares = found.consistent.of_file**2
        min_explained = _MIN_EXCESS_SHARE * (file_squares - found.consistent.held_out**2)
        carriers = {body.parent for body in bodies}
        ends = [i for i in unknown.bodies if i not in carriers and f"{bodies[i].link}.m" not in unknown.known]
        if not ends:
            return None
        change = min((self.lone_change(bodies[i].link) for i in ends), key=lambda change: change.held_out)
        if file_squares - change.held_out**2 < min_explained:
            return None
        if file_squares - self.held_out_with_gain**2 >= min_explained:
            return None
        moving_mass = sum(float(bodies[i].inertia.mass) for i in unknown.bodies)
        is_large = abs(change.mass) > _MIN_TOOL_MASS * moving_mass
        is_sure = abs(change.mass) > _MIN_TOOL_DEVIATIONS * change.deviation
        return change if is_large and is_sure else None
