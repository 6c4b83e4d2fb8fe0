"""Groups of parameters that the measurements determine, with intervals; and what remains of the tip's error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from ..core.estimation.covariance import student_quantile
from ..core.numbers import number
from ..core.typing import Array
from ..mechanics.lie import so3
from .chain import LENGTHS, point_columns
from .fit import CalibrationFit

_DISTINCT, _DEPENDENT = 5e-2, 1e-3
"""Length of a column beside the kept ones, as a share of its length, from which it is independent; clear ones come first.

Axes that are nearly parallel would otherwise give groups of 440 m, as in Denavit and Hartenberg's table."""
_NOTHING = 1e-9
"""Length of a column, as a share of the longest, below which it is rounding."""
_TERM = 1e-4
"""Smallest factor of a group's further term."""


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
    def turns_with_the_tip(self) -> bool:
        """True if a turn of the target on the tip has the same effect."""
        return any(name.startswith("tip.r") for name in self.terms)

    @property
    def unit(self) -> str:
        """Unit of the value."""
        if self.name.endswith((".gear", ".sag")):
            return "" if self.name.endswith(".gear") else "rad/(N m)"
        return "m" if self.is_length else "rad"

    @property
    def text(self) -> str:
        """Sum of the terms: ``joint_2.zero + 3.7 joint_3.x``."""
        more = [
            f" {'+' if x > 0 else '-'} {number(abs(x), 3)} {name}"
            for name, x in self.terms.items()
            if name != self.name
        ]
        return self.name + "".join(more)

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
    """Preference of a parameter as the name of a group: targets, ball, zeros, lengths, gears, sags, angles, tip's angles."""
    owner, _, word = name.rpartition(".")
    if owner.startswith("target"):
        return 0
    if owner == "tip":
        return 1 if word in LENGTHS else 7
    return {"zero": 2, "gear": 4, "sag": 5}.get(word, 3 if word in LENGTHS else 6)


@dataclass(frozen=True, eq=False)
class ParameterGroups:
    """Groups of a fit."""

    fit: CalibrationFit
    """Solution and its linearisation."""

    @cached_property
    def kept(self) -> list[int]:
        """Independent columns, by Gram-Schmidt in the order of preference."""
        A, names = self.fit.weighted[0], self.fit.names
        size = np.linalg.norm(A, axis=0)
        Q, kept = np.zeros((len(A), 0)), list[int]()
        order = sorted(range(len(names)), key=lambda k: _order(names[k]))
        every: list[tuple[float, int]] = list(product((_DISTINCT, _DEPENDENT), order))
        for least, k in every:
            if k in kept or size[k] < _NOTHING * size.max():
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
        return len(self.kept)

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
        """(p, p) of all parameters and targets, with the prior of the fit."""
        A, y = self.fit.weighted
        wide = self.fit.problem.wide
        N = A.T @ A
        N[np.arange(len(wide)), np.arange(len(wide))] += wide**-2.0
        size = np.sqrt(N.diagonal()) + 1e-300
        inverse = np.linalg.inv(N / np.outer(size, size) + 1e-13 * np.eye(len(N))) / np.outer(size, size)
        return np.asarray(inverse * max(float(y @ y) / self.freedom, 1e-12))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the residual."""
        used = sum(float((W[:, -1] > 0).sum()) * W.shape[1] for W in self.fit.weights)
        return max(used - self.rank, 1.0)

    @cached_property
    def all(self) -> list[ParameterGroup]:
        """Groups without a target's unknown, in the order of preference."""
        A, names, kept = self.fit.weighted[0], self.fit.names, self.kept
        rest = [k for k in range(len(names)) if k not in kept]
        size = np.linalg.norm(A[:, kept], axis=0)
        K = np.linalg.lstsq(A[:, kept] / size, A[:, rest], rcond=None)[0] / size[:, None]
        K[np.abs(K) < _TERM] = 0.0
        p = len(self.fit.problem.chain.parameters)
        values = np.zeros(len(names))
        values[:p] = self.fit.problem.chain.values(self.fit.state.corrections)
        found = []
        for row, k in enumerate(kept):
            if k >= p:
                continue
            G = np.zeros(len(names))
            G[k], G[rest] = 1.0, K[row]
            terms = {names[k]: 1.0} | {names[j]: float(x) for j, x in zip(rest, K[row], strict=True) if x}
            is_length = bool(self.fit.problem.chain.are_lengths[k])
            deviation = float(np.sqrt(max(float(G @ self.covariance @ G), 0.0)))
            found.append(ParameterGroup(names[k], terms, float(G @ values), deviation, self.freedom, is_length))
        return found


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
        S = self.fit.weighted[0] * self.wide
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
            S = np.concatenate([self.fit.weighted[0], added]) * self.wide
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

    @cached_property
    def worst(self) -> float:
        """Largest of the configurations [m]."""
        return float(np.sqrt(self.squares(self.q)[0].max()))
