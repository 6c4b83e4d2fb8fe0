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

_DISTINCT, _DEPENDENT = 5e-2, 1e-3
"""Length of a column beside the kept ones, as a share of its length, from which it is independent; clear ones come first.

Axes that are nearly parallel would otherwise give groups of 440 m, as in Denavit and Hartenberg's table."""
_ZERO_COLUMN, _SHORT_COLUMN = 1e-9, 1e-3
"""Length of a column, as a share of the longest, below which it is rounding; or below which others come first: the zero of a
joint whose axis goes through the target."""
_AS_GOOD = 1.05
"""Largest ratio of the residual with one parameter of each group to that with all."""
_CHOICES = 4
"""Most choices of a parameter for each group."""
_TERM = 1e-4
"""Smallest factor of a group's further term."""
_MAX_RATIO_TO_NOISE, _MAX_SHARE_OF_FILE_ERROR, _NOISE_OF_TIP, _MIN_ERROR = 3.0, 0.1, 2.0, 1e-6
"""Readings do not show all that moves the tip if the predicted error is more than 3 times its part by noise, or more than a
tenth of the file's error and 2 times the noise of a reading; errors below 1 µm do not matter."""


@dataclass(frozen=True, eq=False)
class ParameterGroup:
    """Parameter, and multiples of others with the same effect."""

    name: str
    """Parameter that leads the group."""
    terms: Mapping[str, float]
    """Factor of each parameter."""
    value: float
    """Sum of factors times parameters [rad, m]."""
    deviation: float
    """Standard deviation of the value."""
    freedom: float
    """Degrees of freedom of the deviation."""
    is_length: bool
    """True for m; False for rad."""

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
        """Half the interval at a level.

        Parameters
        ----------
        level : float

        Returns
        -------
        width : float [rad, m]

        Examples
        --------
        >>> round(ParameterGroup("tip.x", {"tip.x": 1.0}, 0.0, 1.0, 1e9, True).half_width(), 2)
        1.96
        """
        return float(student_quantile(max(self.freedom, 1.0), level) * self.deviation)


def _order(name: str) -> int:
    """Preference of a parameter as the name of a group: targets, tip, zeros, lengths, gears, sags, angles.

    The tip comes before zeros, since the way in which a target is mounted is not an error of the last joint.
    """
    owner, _, word = name.rpartition(".")
    if owner.startswith("target"):
        return 0
    if owner == "tip":
        return 1
    return {"zero": 2, "gear": 4, "sag": 5}.get(word, 3 if word in LENGTHS else 6)


@dataclass(frozen=True, eq=False)
class ParameterGroups:
    """Groups of a fit."""

    fit: CalibrationFit
    """Solution and its linearisation."""

    @cached_property
    def independent_columns(self) -> list[int]:
        """Independent columns: those that were fitted, or by Gram-Schmidt in the order of preference."""
        if self.fit.problem.independent is not None:
            return list(self.fit.problem.independent.columns)
        A, names = self.fit.weighted_rows[0], self.fit.names
        size = np.linalg.norm(A, axis=0)
        Q, kept = np.zeros((len(A), 0)), list[int]()
        order = sorted(range(len(names)), key=lambda k: _order(names[k]))
        every: list[tuple[float, int]] = list(product((_DISTINCT, _DEPENDENT), order))
        for least, k in every:
            min_size = _SHORT_COLUMN if least == _DISTINCT else _ZERO_COLUMN
            if k in kept or size[k] < min_size * size.max():
                continue
            v = A[:, k] / size[k]
            for _ in range(2):
                v = v - Q @ (Q.T @ v)
            left = float(np.linalg.norm(v))
            if left > least:
                kept.append(k)
                Q = np.c_[Q, v / left]
        return kept

    @property
    def rank(self) -> int:
        """Number of groups, including those of the targets."""
        return len(self.independent_columns)

    @cached_property
    def theory(self) -> int:
        """Rank of many different readings."""
        chain, fit = self.fit.problem.chain, self.fit
        turning, sliding = sum(chain.turning), len(chain.turning) - sum(chain.turning)
        alone = [target.freedom(turning, sliding) - len(target.names) for target in fit.state.targets]
        extra = ("gears" in chain.assume) * len(chain.joints) + len(chain.loaded_joints)
        return max(alone) + sum(len(target.names) for target in fit.state.targets) + extra

    @cached_property
    def covariance(self) -> Array:
        """(k, k) of the independent parameters, with the prior of the fit."""
        A, y = self.fit.weighted_rows
        prior, kept = self.independent.prior(self.fit.problem.wide), list(self.independent.columns)
        N = (A.T @ A)[np.ix_(kept, kept)]
        N[: len(prior), : len(prior)] += (prior.T @ prior)[np.ix_(kept[: len(prior)], kept[: len(prior)])]
        size = np.sqrt(N.diagonal()) + 1e-300
        inverse = np.linalg.inv(N / np.outer(size, size) + 1e-13 * np.eye(len(N))) / np.outer(size, size)
        return np.asarray(inverse * max(float(y @ y) / self.freedom, 1e-12))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the residual."""
        used = sum(float((W[:, -1] > 0).sum()) * W.shape[1] for W in self.fit.weights)
        return max(used - self.rank, 1.0)

    @cached_property
    def independent(self) -> IndependentParameters:
        """Independent columns, and the factors (k, p) of the chain's parameters in the group of each."""
        if self.fit.problem.independent is not None:
            return self.fit.problem.independent
        A, p = self.fit.weighted_rows[0], len(self.fit.problem.chain.parameters)
        kept = sorted(self.independent_columns, key=lambda k: k >= p)
        rest = [k for k in range(p) if k not in kept]
        size = np.linalg.norm(A[:, kept], axis=0)
        K = np.linalg.lstsq(A[:, kept] / size, A[:, rest], rcond=None)[0] / size[:, None]
        K[np.abs(K) < _TERM] = 0.0
        of_chain = sum(k < p for k in kept)
        terms = np.zeros((of_chain, p))
        terms[np.arange(of_chain), kept[:of_chain]] = 1.0
        terms[:, rest] = K[:of_chain]
        return IndependentParameters(tuple(kept), terms)

    @cached_property
    def values(self) -> Array:
        """Values (k,) of the groups of the chain's parameters."""
        chain = self.fit.problem.chain
        return self.independent.terms @ chain.values(self.fit.state.corrections)

    @cached_property
    def all(self) -> list[ParameterGroup]:
        """Groups without a target's unknown, in the order of preference."""
        chain, found = self.fit.problem.chain, []
        deviations = np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))
        for k, G, value, deviation in zip(
            self.independent.columns, self.independent.terms, self.values, deviations, strict=False
        ):
            name = chain.parameters[k]
            others = {chain.parameters[j]: float(G[j]) for j in np.flatnonzero(G) if j != k}
            is_length = bool(chain.are_lengths[k])
            found.append(
                ParameterGroup(name, {name: 1.0} | others, float(value), float(deviation), self.freedom, is_length)
            )
        return found


def fitted_in_groups(fit: CalibrationFit) -> CalibrationFit:
    """Fit of one parameter of each group, with the others as in the file.

    A group's value is linear in its parameters only for small ones: an offset of 5° that is distributed over the joints of
    parallel axes adds up to less. With one parameter the value is exact. Nothing changes if readings lack a length or
    determine fewer groups than others would, since the file then decides, best by all of its lengths; or if one parameter
    of each group does not fit as well.
    """
    chain, found, last = fit.problem.chain, fit, set[int]()
    for _ in range(_CHOICES):
        groups = ParameterGroups(replace(found, problem=fit.problem))
        columns = groups.independent.columns
        if fit.problem.is_scaleless or groups.rank < groups.theory:
            return fit
        if set(columns) == last:  # the choice depends on the geometry, which an offset distorts before
            break
        last = set(columns)
        values = np.zeros(len(chain.parameters))
        values[list(columns[: len(groups.values)])] = groups.values
        problem = replace(fit.problem, independent=groups.independent)
        found = problem.solve(Estimate(chain.corrections(values), found.state.targets))
    return found if found.rms <= _AS_GOOD * fit.rms else fit


# ── What remains of the tip's error


@dataclass(frozen=True, eq=False)
class Remaining:
    """Error of the tip that is left at configurations, predicted from the fit and from the accuracy of the file.

    C = (A' W A + diag(1 / σ_file²))⁻¹, e = J_v δ, the rigid motion of the base projected out.

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
    """(N, nq) configurations of the average."""
    file_accuracy: tuple[float, float]
    """Standard deviations of the file's lengths [m] and axes [rad]."""

    @cached_property
    def wide(self) -> Array:
        """Standard deviations of all parameters by the file."""
        length, angle = self.file_accuracy
        of_chain = self.fit.problem.chain.scales(angle, length, 1e-3, 1e-3, (0.5, 0.3))
        return np.concatenate([of_chain, np.full(len(self.fit.names) - len(of_chain), 10.0)])

    @cached_property
    def _information(self) -> tuple[Array, Array]:
        """Eigenvalues and vectors of A' W A over the file's deviations."""
        S = self.fit.weighted_rows[0] * self.wide
        values, U = np.linalg.eigh(S.T @ S)
        return np.maximum(values, 0.0), U

    def _columns(self, q: Array) -> tuple[Array, Array]:
        """Velocities (N, 3, p) of the tip, and of the base's rigid motion (N, 3, 6)."""
        chain = self.fit.problem.chain
        T, J = chain.poses(q, chain.loads(q), self.fit.state.corrections)
        rigid = np.concatenate([-so3.hat(T[:, :3, 3]), np.broadcast_to(np.eye(3), (len(q), 3, 3))], axis=2)
        return point_columns(T, J), rigid

    @cached_property
    def _base(self) -> Array:
        """Rigid motion (6, p) of the base that takes up most of each column over the configurations."""
        J, rigid = self._columns(self.q)
        return np.linalg.lstsq(rigid.reshape(-1, 6), J.reshape(-1, J.shape[2]), rcond=None)[0]

    def squares(self, q: Array, added: Array | None = None) -> tuple[Array, Array]:
        """Mean square of the error, and its part by noise.

        Parameters
        ----------
        q : (N, nq) array
        added : (k, p) array, optional, further weighted rows

        Returns
        -------
        squares : two (N,) arrays [m²]
        """
        J, rigid = self._columns(q)
        p = J.shape[2]
        J = (J - rigid @ self._base) * self.wide[:p]
        if added is None:
            values, U = self._information
        else:
            S = np.concatenate([self.fit.weighted_rows[0], added]) * self.wide
            values, U = np.linalg.eigh(S.T @ S)
            values = np.maximum(values, 0.0)
        seen = (J @ U[:p]) ** 2
        both = (seen @ (1.0 / (1.0 + values))).sum(axis=1)
        return both, (seen @ (values / (1.0 + values) ** 2)).sum(axis=1)

    @cached_property
    def by_file(self) -> float:
        """Root mean square over the configurations without any reading [m]; the target's place on the tip is known."""
        J, rigid = self._columns(self.q)
        error = ((J - rigid @ self._base) * self.wide[: J.shape[2]])[..., :-6]
        return float(np.sqrt((error**2).sum(axis=(1, 2)).mean()))

    @cached_property
    def rms(self) -> float:
        """Root mean square over the configurations [m]."""
        return float(np.sqrt(self.squares(self.q)[0].mean()))

    @cached_property
    def by_noise(self) -> float:
        """Part of it that noise leaves [m]; the other part is what the measurements cannot see."""
        return float(np.sqrt(self.squares(self.q)[1].mean()))

    @property
    def is_unseen(self) -> bool:
        """True if poses or kinds of the readings, not their noise, leave a large part of the error."""
        if self.rms > max(_MAX_RATIO_TO_NOISE * self.by_noise, _MIN_ERROR):
            return True
        return self.rms > max(_MAX_SHARE_OF_FILE_ERROR * self.by_file, _NOISE_OF_TIP * self.fit.noise)

    @cached_property
    def worst(self) -> float:
        """Largest of the configurations [m]."""
        return float(np.sqrt(self.squares(self.q)[0].max()))
