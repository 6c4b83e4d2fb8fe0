"""Changes of the bodies that an identification found: masses and centres of mass against the file's, and a mounted tool.

A log determines few masses by themselves. Deviations of single masses therefore come from a fit with the file as prior, whose
errors are assumed to be 20 % at least. Let A be the derivatives of the groups by the coordinates of a step that keeps bodies
consistent, C the covariance of the groups, and P = 1 / min(γ, 25). The covariance in these coordinates is

    cov = P - P A' (A P A' + C)^-1 A P

Two changes δ of the parameters are added to it as δ δ': the change with a prior that is a hundred times weaker, and the change
in a fit in which one body alone differs from the file.
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
"""Least squared Mahalanobis distance of a sure change of three coordinates: 95 % of χ² with three degrees of freedom."""
_MIN_TOOL_DEVIATIONS = 5.0
"""Least mass of a tool, in its standard deviations."""
_MIN_TOOL_MASS = 0.03
"""Least mass of a tool, as a share of the moving mass."""
_MIN_EXCESS_SHARE = 0.95
"""Least share of the file's excess squared residual that a tool explains."""
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
    moved : (n,) array, distance between the centres of mass in the file and identified [m]; nan for a body without mass in
        the file
    is_moved : (n,) bool array, True if the move of the centre is sure
    tool : LoneChange or None, change of the one body that explains the log
    held : (n,) bool array, True if the mass is held at a known value, so that the log shows nothing of it
    """

    links: Sequence[str]
    before: Array
    masses: Array
    covariance: Array
    moved: Array
    is_moved: Array
    tool: LoneChange | None
    held: Array

    @property
    def _found_changes(self) -> Array:
        """(n,) changes of the masses that the log shows [kg]; 0 for held masses."""
        return np.where(self.held, 0.0, self.masses - self.before)

    @property
    def deviations(self) -> Array:
        """(n,) standard deviations of the identified masses [kg]."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def is_heavier(self) -> Array:
        """(n,) bool array, True if the mass has surely changed, to a larger or a smaller one."""
        return np.asarray(np.abs(self._found_changes) > _MIN_DEVIATIONS * self.deviations)

    @property
    def is_sum_heavier(self) -> bool:
        """True if the change of the sum of the masses is sure, to a larger or a smaller sum."""
        change = float(self._found_changes.sum())
        variance = max(float(self.covariance.sum()), 0.0)
        return abs(change) > _MIN_DEVIATIONS * math.sqrt(variance)

    def to_list(self) -> list[dict[str, Any]]:
        """Plain data of each body, in SI units.

        Returns
        -------
        bodies : list of dict

        Examples
        --------
        >>> no = np.zeros(1, bool)
        >>> one = BodyChanges(["rod"], np.ones(1), np.full(1, 1.5), np.full((1, 1), 0.01), np.zeros(1), no, None, no)
        >>> one.to_list()[0]["mass_changed"], one.is_sum_heavier
        (True, True)
        """
        bodies = []
        deviations = self.deviations
        is_heavier = self.is_heavier
        for k, link in enumerate(self.links):
            bodies.append({
                "link": link, "file_mass": float(self.before[k]), "mass": float(self.masses[k]),
                "deviation": float(deviations[k]), "mass_changed": bool(is_heavier[k]),
                "com_moved": float(self.moved[k]), "com_changed": bool(self.is_moved[k]),
            })  # fmt: skip
        return bodies


def body_changes(found: IdentifiedRobot) -> BodyChanges:
    """Masses and centres of the consistent bodies against the file's, and the body that alone explains the log."""
    unknown = found.base.unknown
    consistent_values = found.consistent.fit.values
    fits = _ComparisonFits(found)
    tool = fits.tool
    C = fits.covariance
    if tool is not None:
        C = C + _outer_square(tool.values - consistent_values)
    first_columns = 10 * np.array(unknown.bodies, int)
    columns = first_columns[:, None] + np.arange(10)  # (n, 10), of the regressor, which has ten for each body
    is_column = unknown.of_bodies == columns[..., None]
    indices = np.argmax(is_column, axis=-1)  # (n, 10): the unknown parameter that stands for each column
    file_parameters = unknown.robot.parameters[columns]  # (n, 10), without known values, which ``file_values`` contains
    identified_parameters = consistent_values[indices]  # (n, 10)
    distances, is_moved = [], []
    for in_file, identified, own_indices in zip(file_parameters, identified_parameters, indices, strict=True):
        has_mass = in_file[_M] > 0
        c_file = in_file[_MC] / in_file[_M] if has_mass else np.zeros(3)
        J = np.column_stack([np.eye(3), -c_file])  # of m c - m c_file: a mass added at the centre does not move it
        moments_and_mass = own_indices[[*_MC, _M]]
        parameter_changes = identified - in_file
        change = J @ parameter_changes[[*_MC, _M]]
        covariance = J @ C[np.ix_(moments_and_mass, moments_and_mass)] @ J.T
        squared_deviations = float(change @ np.linalg.pinv(covariance, hermitian=True) @ change)
        is_moved.append(squared_deviations > _MIN_SQUARED_DEVIATIONS)
        distance = math.nan
        if has_mass:
            c = identified[_MC] / identified[_M]
            distance = float(np.linalg.norm(c - c_file))
        distances.append(distance)
    mass_indices = indices[:, _M]
    return BodyChanges(
        links=[unknown.model.bodies[i].link for i in unknown.bodies],
        before=file_parameters[:, _M],
        masses=identified_parameters[:, _M],
        covariance=C[np.ix_(mass_indices, mass_indices)],
        moved=np.array(distances),
        is_moved=np.array(is_moved, bool),
        tool=tool,
        held=unknown.held[mass_indices],
    )


def _outer_square(x: Array) -> Array:
    """The matrix x x'."""
    return np.outer(x, x)


@dataclass(frozen=True, eq=False)
class _ComparisonFits:
    """Further fits to the rows of an identification, with which its result is compared."""

    found: IdentifiedRobot

    @cached_property
    def fifths(self) -> list[Information]:
        """Normal equations N, c and |τ|² of each fifth of the time that has torques."""
        return [(N, c, squares) for N, c, squares in self.found._information() if squares > 0]

    @cached_property
    def covariance(self) -> Array:
        """(p, p) covariance of all unknown parameters with the file as prior."""
        found = self.found
        fit = found.consistent.fit
        prior = PositivePrior.from_values(found.base, found.values, found.sizes)
        problem = PositiveProblem(found.base, prior, *sum_of(self.fifths), found.sizes)
        stronger = [strength for strength in STRENGTHS if strength > fit.strength]
        # Each fit starts from the fit with the next stronger prior; the last has a hundredth of the strength.
        fits = problem.path([*stronger, fit.strength, 0.1 * fit.strength, 0.01 * fit.strength])
        weak_fit = fits[-1]
        covariance = problem.covariance(fit, found.covariance.matrix)
        return covariance + _outer_square(weak_fit.values - fit.values)

    def lone_change(self, link: str) -> LoneChange:
        """Change of one body if no other differs from the file."""
        base, unknown = self.found.base, self.found.base.unknown
        owners = np.array([name.rpartition(".")[0] for name in unknown.names])
        is_drive = (unknown.of_bodies < 0) & ~unknown.held  # parameters without a column of a body
        is_of_link = (owners == link) & ~unknown.held
        free = np.flatnonzero(is_drive | is_of_link)  # indices of the parameters that may change
        start = np.where(is_drive, 0.0, unknown.file_values)
        # Values of the groups are x_start + K z for changes z of the free parameters.
        x_start = base.project(start)
        K = base.grouping[:, free]
        prior = Prior(np.zeros(len(free)), self.found.sizes[free])

        def solve(rows: Information) -> Array:
            """Changes of the free parameters, fitted to rows."""
            N, c, _ = rows
            return prior.solve(K.T @ N @ K, K.T @ (c - N @ x_start))

        all_rows = sum_of(self.fifths)
        N, _, squared_torques = all_rows
        squared_residuals = 0.0
        for held_out, training in left_out(self.fifths):
            squared_residuals += squares_of(held_out, x_start + K @ solve(training))
        mass_index = unknown.names.index(f"{link}.m")
        index_in_z = free.tolist().index(mass_index)
        unit_vector = np.eye(len(free))[index_in_z]
        mass_by_groups = N @ K @ prior.solve(K.T @ N @ K, unit_vector)  # derivatives of the mass by the groups
        variance = float(mass_by_groups @ self.found.covariance.matrix @ mass_by_groups)
        values = start.copy()
        values[free] += solve(all_rows)
        return LoneChange(
            link,
            mass=float(values[mass_index] - start[mass_index]),
            deviation=math.sqrt(max(variance, 0.0)),
            held_out=math.sqrt(squared_residuals / squared_torques),
            values=values,
        )

    @property
    def held_out_with_gain(self) -> float:
        """|τ - τ̂| / |τ| of held-out fifths, if only the drives and one factor of all bodies differ from the file."""
        base, unknown = self.found.base, self.found.base.unknown
        is_body = unknown.of_bodies >= 0
        drives = np.flatnonzero(~is_body & ~unknown.held)
        x_start = base.project(np.where(is_body | unknown.held, unknown.file_values, 0.0))
        x_bodies = base.project(np.where(is_body & ~unknown.held, unknown.file_values, 0.0))
        # Values of the groups are x_start + K z; z has the change of the factor from 1, then the parameters of the drives.
        K = np.column_stack([x_bodies, base.grouping[:, drives]])
        sizes = np.append(1.0, self.found.sizes[drives])
        prior = Prior(np.zeros(1 + len(drives)), sizes)
        squared_residuals = 0.0
        for held_out, (N, c, _) in left_out(self.fifths):
            z = prior.solve(K.T @ N @ K, K.T @ (c - N @ x_start))
            squared_residuals += squares_of(held_out, x_start + K @ z)
        _, _, squared_torques = sum_of(self.fifths)
        return math.sqrt(squared_residuals / squared_torques)

    @property
    def tool(self) -> LoneChange | None:
        """Change of a body at the end of a chain that explains nearly all of the file's excess residual; None without one.

        The result is also None if one factor of all bodies explains as much: no log distinguishes it from a gain of the
        torques.
        """
        found = self.found
        unknown = found.base.unknown
        bodies = unknown.model.bodies
        file_squares = found.consistent.of_file**2  # squared residual of the file, as a share
        min_explained = _MIN_EXCESS_SHARE * (file_squares - found.consistent.held_out**2)
        carriers = {body.parent for body in bodies}
        end_bodies = [i for i in unknown.bodies if i not in carriers]  # indices of bodies that carry no other
        end_links = [bodies[i].link for i in end_bodies]
        links = [link for link in end_links if f"{link}.m" not in unknown.known]
        if not links:
            return None
        changes = [self.lone_change(link) for link in links]
        change = min(changes, key=lambda change: change.held_out)
        if file_squares - change.held_out**2 < min_explained:
            return None
        if file_squares - self.held_out_with_gain**2 >= min_explained:
            return None
        moving_mass = sum(float(bodies[i].inertia.mass) for i in unknown.bodies)
        is_large = abs(change.mass) > _MIN_TOOL_MASS * moving_mass
        is_sure = abs(change.mass) > _MIN_TOOL_DEVIATIONS * change.deviation
        return change if is_large and is_sure else None
