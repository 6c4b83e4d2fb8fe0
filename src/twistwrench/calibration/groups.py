"""Groups of parameters that the measurements determine, with intervals; and what remains of the tip's error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from ..core.estimation.covariance import student_quantile
from ..core.numbers import number
from ..core.typing import Array
from ..mechanics.lie import so3
from .chain import LENGTHS, point_columns
from .fit import CalibrationFit, Estimate, IndependentParameters

# Independent columns are found in two passes. The first keeps only columns that are long and clearly independent. Axes that
# are nearly parallel would otherwise give groups of 440 m, as in Denavit and Hartenberg's table.

_CLEAR_REMAINDER = 5e-2
"""Length of a column without its part along the kept columns, as a share of its length, from which the first pass keeps it."""
_MIN_REMAINDER = 1e-3
"""Share of the same kind, from which the second pass keeps a column."""
_CLEAR_LENGTH = 1e-3
"""Length of a column, as a share of the longest, below which the first pass leaves it out.

The zero of a joint whose axis goes through the target has a short column."""
_MIN_LENGTH = 1e-9
"""Length of a column, as a share of the longest, below which it consists of rounding errors."""
_MAX_RESIDUAL_RATIO = 1.05
"""Largest ratio of two residuals: with one parameter of each group, and with all parameters."""
_MAX_CHOICES = 4
"""Largest number of times that a parameter is chosen for each group."""
_MIN_FACTOR = 1e-4
"""Smallest factor of a group's terms after the first."""

# Readings do not show all that moves the tip if the predicted error of the tip is large against its part by noise, or against
# both the file's error and the noise of a reading.

_MAX_RATIO_TO_NOISE_PART = 3.0
"""Ratio of the predicted error to its part by noise."""
_MAX_SHARE_OF_FILE_ERROR = 0.1
"""Predicted error as a share of the file's error."""
_MAX_RATIO_TO_READING_NOISE = 2.0
"""Ratio of the predicted error to the noise of a reading."""
_NEGLIGIBLE_ERROR = 1e-6
"""Predicted error of the tip [m] that is negligible."""
_WIDE_DEVIATION = 10.0
"""Standard deviation of the unknowns of targets before any reading [m, rad]."""


@dataclass(frozen=True, eq=False)
class ParameterGroup:
    """Sum of a parameter and multiples of others, which readings cannot separate."""

    name: str
    """Parameter that leads the group."""
    terms: Mapping[str, float]
    """Factor of each parameter by its name; 1 for the leading one."""
    value: float
    """Sum of factors times parameters, in :attr:`unit`."""
    deviation: float
    """Standard deviation of the value."""
    freedom: float
    """Degrees of freedom of the deviation."""
    is_length: bool
    """True if the value is in m. False if it is in rad, or of a gear or sag: see :attr:`unit`."""

    @property
    def unit(self) -> str:
        """Unit of the value."""
        if self.name.endswith(".gear"):
            return ""
        if self.name.endswith(".sag"):
            return "rad/(N m)"
        return "m" if self.is_length else "rad"

    @property
    def text(self) -> str:
        """Sum of the terms: ``joint_2.zero + 3.7 joint_3.x``."""
        text = self.name
        for name, factor in self.terms.items():
            if name != self.name:
                sign = "+" if factor > 0 else "-"
                text += f" {sign} {number(abs(factor), 3)} {name}"
        return text

    def half_width(self, level: float = 0.95) -> float:
        """Half the width of the confidence interval at a level.

        Parameters
        ----------
        level : float, confidence level, 0 to 1

        Returns
        -------
        width : float, in the unit of the value

        Examples
        --------
        >>> round(ParameterGroup("tip.x", {"tip.x": 1.0}, 0.0, 1.0, 1e9, True).half_width(), 2)
        1.96
        """
        quantile = student_quantile(max(self.freedom, 1.0), level)
        return float(quantile * self.deviation)


def _preference(name: str) -> int:
    """Rank of a parameter as the leader of a group, 0 is preferred: targets, tip, zeros, lengths, gears, sags, angles.

    The tip comes before zeros, since the way in which a target is mounted is not an error of the last joint.
    """
    owner, _, kind = name.rpartition(".")
    if owner.startswith("target"):
        return 0
    if owner == "tip":
        return 1
    if kind in LENGTHS:
        return 3
    rank_by_kind = {"zero": 2, "gear": 4, "sag": 5}
    return rank_by_kind.get(kind, 6)  # 6: angles


@dataclass(frozen=True, eq=False)
class ParameterGroups:
    """Groups of a fit."""

    fit: CalibrationFit
    """Solution and its linearisation."""

    @cached_property
    def independent_columns(self) -> list[int]:
        """Indices of independent columns: the fitted ones, or else found by Gram-Schmidt in the order of preference."""
        if self.fit.problem.independent is not None:
            return list(self.fit.problem.independent.columns)
        A, _ = self.fit.weighted_rows
        names = self.fit.names
        lengths = np.linalg.norm(A, axis=0)
        preferred_first = sorted(range(len(names)), key=lambda k: _preference(names[k]))
        Q = np.zeros((len(A), 0))  # orthonormal basis of the kept columns
        kept_columns = list[int]()
        passes = (  # least remainder, least length; both as shares
            (_CLEAR_REMAINDER, _CLEAR_LENGTH),
            (_MIN_REMAINDER, _MIN_LENGTH),
        )
        for (min_remainder, min_length), k in product(passes, preferred_first):
            if k in kept_columns or lengths[k] < min_length * lengths.max():
                continue
            v = A[:, k] / lengths[k]
            for _ in range(2):  # twice, to limit rounding errors
                v = v - Q @ (Q.T @ v)
            remainder = float(np.linalg.norm(v))
            if remainder > min_remainder:
                kept_columns.append(k)
                Q = np.c_[Q, v / remainder]
        return kept_columns

    @property
    def rank(self) -> int:
        """Number of groups, including those of the targets."""
        return len(self.independent_columns)

    @cached_property
    def theory(self) -> int:
        """Rank in theory, if readings are many and different.

        The rank of the chain is that by the target whose kind of reading determines most.
        """
        chain = self.fit.problem.chain
        targets = self.fit.state.targets
        turning_count = sum(chain.turning)
        sliding_count = len(chain.turning) - turning_count
        chain_ranks = [target.freedom(turning_count, sliding_count) - len(target.names) for target in targets]
        target_unknowns = sum(len(target.names) for target in targets)
        gear_count = len(chain.joints) if "gears" in chain.assume else 0
        sag_count = len(chain.loaded_joints)
        return max(chain_ranks) + target_unknowns + gear_count + sag_count

    @cached_property
    def covariance(self) -> Array:
        """Covariance (k, k) of the independent parameters, with the prior of the fit."""
        A, y = self.fit.weighted_rows
        columns = list(self.independent.columns)
        prior = self.independent.prior(self.fit.problem.wide_deviations)
        columns_of_chain = columns[: len(prior)]  # targets have no prior
        information = A.T @ A
        prior_information = prior.T @ prior
        N = information[np.ix_(columns, columns)]
        N[: len(prior), : len(prior)] += prior_information[np.ix_(columns_of_chain, columns_of_chain)]
        size = np.sqrt(N.diagonal()) + 1e-300  # never zero
        scales = np.outer(size, size)  # radians and metres differ widely
        regular = N / scales + 1e-13 * np.eye(len(N))  # invertible despite rounding errors
        inverse = np.linalg.inv(regular) / scales
        residual_variance = max(float(y @ y) / self.freedom, 1e-12)  # not zero for readings without noise
        return np.asarray(inverse * residual_variance)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the residual."""
        used_rows = 0.0
        for W in self.fit.weights:
            is_used = W[:, -1] > 0  # a reading that is left out has weight zero in all its rows
            used_rows += float(is_used.sum()) * W.shape[1]
        return max(used_rows - self.rank, 1.0)

    @cached_property
    def independent(self) -> IndependentParameters:
        """Independent columns, and the factors (k, p) of the chain's parameters in the group of each."""
        if self.fit.problem.independent is not None:
            return self.fit.problem.independent
        A, _ = self.fit.weighted_rows
        p = len(self.fit.problem.chain.parameters)
        columns = sorted(self.independent_columns, key=lambda k: k >= p)  # stable: first the chain's, then the targets'
        dependent_columns = [k for k in range(p) if k not in columns]
        size = np.linalg.norm(A[:, columns], axis=0)
        scaled_factors, *_ = np.linalg.lstsq(A[:, columns] / size, A[:, dependent_columns], rcond=None)
        K = scaled_factors / size[:, None]  # dependent columns = independent columns times K
        K[np.abs(K) < _MIN_FACTOR] = 0.0
        group_count = sum(k < p for k in columns)  # of the chain
        terms = np.zeros((group_count, p))
        terms[np.arange(group_count), columns[:group_count]] = 1.0
        terms[:, dependent_columns] = K[:group_count]
        return IndependentParameters(tuple(columns), terms)

    @cached_property
    def values(self) -> Array:
        """Values (k,) of the groups of the chain's parameters."""
        chain = self.fit.problem.chain
        return self.independent.terms @ chain.values(self.fit.state.corrections)

    @cached_property
    def all(self) -> list[ParameterGroup]:
        """Groups of the chain's parameters, in the order of preference."""
        chain = self.fit.problem.chain
        variances = np.maximum(self.covariance.diagonal(), 0.0)
        deviations = np.sqrt(variances)
        groups = []
        for row, value in enumerate(self.values):  # unknowns of targets, which are not listed, have later rows
            k = self.independent.columns[row]
            factors = self.independent.terms[row]
            name = chain.parameters[k]
            others = {chain.parameters[j]: float(factors[j]) for j in np.flatnonzero(factors) if j != k}
            terms = {name: 1.0} | others
            is_length = bool(chain.are_lengths[k])
            groups.append(ParameterGroup(name, terms, float(value), float(deviations[row]), self.freedom, is_length))
        return groups


def fitted_in_groups(fit: CalibrationFit) -> CalibrationFit:
    """Fit of one parameter of each group; the other parameters keep their values in the file.

    A group's value is linear in its parameters only if these are small: an offset of 5° that is distributed over the joints of
    parallel axes adds up to less. With one parameter, the value is exact.

    The fit is returned unchanged in three cases:

    - the readings contain no length
    - they determine fewer groups than other readings would
    - one parameter of each group does not fit as well
    """
    chain = fit.problem.chain
    grouped_fit = fit
    previous_columns = set[int]()
    for _ in range(_MAX_CHOICES):
        groups = ParameterGroups(replace(grouped_fit, problem=fit.problem))
        columns = groups.independent.columns
        if fit.problem.is_scaleless or groups.rank < groups.theory:
            return fit
        # The choice of columns depends on the fitted geometry, so it is repeated until it stays the same.
        if set(columns) == previous_columns:
            break
        previous_columns = set(columns)
        values = np.zeros(len(chain.parameters))
        chosen_columns = list(columns[: len(groups.values)])  # of the chain
        values[chosen_columns] = groups.values
        problem = replace(fit.problem, independent=groups.independent)
        grouped_fit = problem.solve(Estimate(chain.corrections(values), grouped_fit.state.targets))
    return grouped_fit if grouped_fit.rms <= _MAX_RESIDUAL_RATIO * fit.rms else fit


# ── What remains of the tip's error


@dataclass(frozen=True, eq=False)
class Remaining:
    """Remaining error of the tip at configurations, predicted from the fit and from the accuracy of the file.

    e = J_v δ with errors δ of the parameters, whose covariance is C = (A' W A + diag(1 / σ_file²))⁻¹. The rigid motion of the
    base is projected out.

    Examples
    --------
    >>> import twistwrench as tw
    >>> remaining = tw.calibration.calibrate("ur5", "demo").remaining
    >>> remaining.squares(np.zeros((2, 6)))[0].shape, remaining.by_noise <= remaining.rms < remaining.worst
    ((2,), True)
    """

    fit: CalibrationFit
    """Solution and its linearisation."""
    q: Array
    """Configurations (N, nq) over which errors are averaged."""
    file_accuracy: tuple[float, float]
    """Standard deviations of the file's lengths [m] and axes [rad]."""

    @cached_property
    def wide(self) -> Array:
        """Standard deviations of all parameters before any reading: by the file, and wide ones for tip and targets."""
        length, angle = self.file_accuracy
        # Factors of gears and sags, and the tip's place [m] and orientation [rad], are known only roughly.
        chain_deviations = self.fit.problem.chain.scales(angle, length, gear=1e-3, sag=1e-3, tip=(0.5, 0.3))
        target_unknowns = len(self.fit.names) - len(chain_deviations)
        return np.concatenate([chain_deviations, np.full(target_unknowns, _WIDE_DEVIATION)])

    def _information(self, weighted_rows: Array) -> tuple[Array, Array]:
        """Eigenvalues and eigenvectors of A' W A from the given weighted rows, for parameters in units of :attr:`wide`."""
        S = weighted_rows * self.wide
        values, U = np.linalg.eigh(S.T @ S)
        return np.maximum(values, 0.0), U

    @cached_property
    def _information_of_fit(self) -> tuple[Array, Array]:
        """:meth:`_information` of the fit's rows."""
        A, _ = self.fit.weighted_rows
        return self._information(A)

    def _columns(self, q: Array) -> tuple[Array, Array]:
        """Velocities of the tip by each parameter (N, 3, p), and by a rigid motion of the base (N, 3, 6)."""
        chain = self.fit.problem.chain
        T, J = chain.poses(q, chain.loads(q), self.fit.state.corrections)
        by_turning = -so3.hat(T[:, :3, 3])
        by_sliding = np.broadcast_to(np.eye(3), (len(q), 3, 3))
        by_base_motion = np.concatenate([by_turning, by_sliding], axis=2)
        return point_columns(T, J), by_base_motion

    @cached_property
    def _base_motions(self) -> Array:
        """Rigid motion (6, p) of the base that is nearest to each parameter's velocities over the configurations."""
        J, J_base = self._columns(self.q)
        base_rows = J_base.reshape(-1, 6)
        parameter_rows = J.reshape(-1, J.shape[2])
        base_motions, *_ = np.linalg.lstsq(base_rows, parameter_rows, rcond=None)
        return base_motions

    def _scaled_columns(self, q: Array) -> Array:
        """Velocities (N, 3, p) of the tip by a standard deviation of each parameter, without rigid motions of the base."""
        J, J_base = self._columns(q)
        p = J.shape[2]
        return np.asarray((J - J_base @ self._base_motions) * self.wide[:p])

    def squares(self, q: Array, added: Array | None = None) -> tuple[Array, Array]:
        """Expected square of the error at each configuration, and its part by noise.

        Parameters
        ----------
        q : (N, nq) array
        added : (k, p) array, optional, weighted rows of k readings in addition to those of the fit

        Returns
        -------
        squares : two (N,) arrays [m²]
        """
        J = self._scaled_columns(q)
        p = J.shape[2]
        if added is None:
            values, U = self._information_of_fit
        else:
            A, _ = self.fit.weighted_rows
            values, U = self._information(np.concatenate([A, added]))
        # C = U diag(1 / (1 + λ)) U'; its part by noise is C (A' W A) C = U diag(λ / (1 + λ)²) U'
        squared_velocities = (J @ U[:p]) ** 2
        squares = (squared_velocities @ (1.0 / (1.0 + values))).sum(axis=1)
        squares_by_noise = (squared_velocities @ (values / (1.0 + values) ** 2)).sum(axis=1)
        return squares, squares_by_noise

    @cached_property
    def by_file(self) -> float:
        """RMS error of the tip before any reading [m], if the target's place on the tip is known."""
        errors = self._scaled_columns(self.q)[..., :-6]  # without the six parameters of the tip
        squares = (errors**2).sum(axis=(1, 2))
        return float(np.sqrt(squares.mean()))

    @cached_property
    def rms(self) -> float:
        """Root mean square of the predicted error over the configurations [m]."""
        squares, _ = self.squares(self.q)
        return float(np.sqrt(squares.mean()))

    @cached_property
    def by_noise(self) -> float:
        """Part of :attr:`rms` by noise [m]; the other part comes from directions that the measurements do not determine."""
        _, squares_by_noise = self.squares(self.q)
        return float(np.sqrt(squares_by_noise.mean()))

    @property
    def is_unseen(self) -> bool:
        """True if poses or kinds of the readings, not their noise, leave a large part of the error."""
        max_beside_noise = max(_MAX_RATIO_TO_NOISE_PART * self.by_noise, _NEGLIGIBLE_ERROR)
        if self.rms > max_beside_noise:
            return True
        max_beside_file = _MAX_SHARE_OF_FILE_ERROR * self.by_file
        max_beside_reading = _MAX_RATIO_TO_READING_NOISE * self.fit.noise
        return self.rms > max(max_beside_file, max_beside_reading)

    @cached_property
    def worst(self) -> float:
        """Largest predicted error at one of the configurations [m]."""
        squares, _ = self.squares(self.q)
        return float(np.sqrt(squares.max()))
