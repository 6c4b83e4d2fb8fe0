"""The fit of all rows of an information: groups, how sure they are, and how well each fifth of the time is predicted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from ..errors import TrajectoryError
from ..sensing.covariance import by_moments
from ..typing import Array
from .block_deviations import GroupCovariance
from .held_out import HeldOut
from .joint_moments import JointMoments
from .normal_equations import NormalEquations, Prior
from .setting_trial import FOLDS, FitSettings
from .streamed_rows import FASTER, RowFrame
from .weights import Method

if TYPE_CHECKING:
    from .information import Information

_SPEED_SIZE = 3.0
"""What a friction speed could be off by at most, in units of its step."""


@dataclass(frozen=True, eq=False)
class InformationFit:
    """Least squares of all rows of some moments.

    Parameters
    ----------
    frame : RowFrame
    moments : JointMoments
    weak : Prior, of the groups
    method : str
    hanging : float, rows that residuals hang together over
    """

    frame: RowFrame
    moments: JointMoments
    weak: Prior
    method: Method
    hanging: float = 1.0

    @property
    def prior(self) -> Prior:
        """Weak, of the groups and of what the settings were off."""
        shift = [0.1 / self.frame.settings.cutoff] if self.frame.free_shift else []
        size = np.array([*shift, *(_SPEED_SIZE for _ in self.frame.speeds)])
        return Prior(np.concatenate([self.weak.mean, np.zeros(len(size))]), np.concatenate([self.weak.size, size]))

    def solved(self, blocks: Array) -> tuple[Array, Array]:
        """Unknowns, and sizes of residuals (nv,), of some blocks of time."""
        found = self.moments.equations(self.frame, 1, blocks)
        if self.method == "wls":
            return found.solve(self.prior)
        if self.method == "ols":
            x = self.prior.solve(found.N.sum(axis=0), found.c.sum(axis=0))
            return x, np.sqrt(found.squares(x) / max(1.0, found.rows))
        return self.prior.solve(*_whitened(found, self.frame.sigma)), self.frame.sigma

    def folds(self) -> list[Array]:
        """Blocks of each fifth of the rows."""
        rows = self.moments.counts[:, 0]
        middle = (np.cumsum(rows) - 0.5 * rows) / max(rows.sum(), 1.0)
        label = np.minimum((FOLDS * middle).astype(int), FOLDS - 1)
        return [found for b in range(FOLDS) if (found := np.flatnonzero(label == b)).size]

    def held_out(self) -> HeldOut:
        """Each fifth of the rows predicted from the others."""
        folds = self.folds()
        if len(folds) < 2:
            raise TrajectoryError("the logs are too short to hold a part of them out. Give more seconds.")
        names, found = self.frame.base.unknown.model.velocity_names, list[HeldOut]()
        for mine in folds:
            x, _ = self.solved(np.setdiff1d(np.concatenate(folds), mine))
            plain = self.moments.equations(self.frame, 0, mine)
            found.append(HeldOut("five-fold", plain.squares(x), plain.y, names))
        whole = found[0]
        for one in found[1:]:
            whole = whole + one
        return whole

    def predicted(self, x: Array, kind: str) -> HeldOut:
        """All rows predicted by given unknowns."""
        plain = self.moments.equations(self.frame, 0, slice(None))
        return HeldOut(kind, plain.squares(x), plain.y, self.frame.base.unknown.model.velocity_names)

    def covariance(self, x: Array, sigma: Array, seconds: float) -> GroupCovariance:
        """By the sandwich over the blocks, as :func:`group_covariance` has it of rows; ``seconds`` is what a block lasts."""
        r, prior = self.frame.base.count, self.prior
        parts = [_whitened(self.moments.equations(self.frame, 1, [b]), sigma) for b in range(len(self.moments.counts))]
        N, total = np.stack([n for n, _ in parts]), sum((n for n, _ in parts), np.zeros((len(x), len(x))))
        scores = np.stack([c - n @ x for n, c in parts])
        scaled = total * prior.size[:, None] * prior.size
        values, U = np.linalg.eigh(scaled + np.eye(len(x)))
        half = prior.size[:, None] * (U / np.sqrt(values))
        left = self.moments.equations(self.frame, 1, slice(None)).squares(x) / sigma**2
        freedom = max(1.0, float(self.moments.counts[:, 0].sum()) * len(sigma) - len(x))
        own = np.einsum("ij,ij->i", half, half)
        textbook = np.sqrt(own * float(left.sum()) / freedom)[:r]
        found = by_moments(half.T @ N @ half, scores @ half, half)
        if found is None:
            return GroupCovariance((half @ half.T * self.hanging)[:r, :r], np.full(r, 1e9), textbook, 0.0)
        _, weight, whole = self.moments.counts.sum(axis=0)
        huber = (weight / whole) ** 2 if self.frame.robust and whole else 1.0
        return GroupCovariance(found[0][:r, :r] * huber, found[1][:r], textbook, seconds)

    def settings(self, x: Array) -> FitSettings:
        """Those of the excerpt with the corrections of all rows."""
        settings, r = self.frame.settings, self.frame.base.count
        speed, shift = settings.friction_speed.copy(), settings.shift
        if self.frame.free_shift:
            shift -= float(x[r])
        for k, (_, joints) in enumerate(self.frame.speeds):
            owner = int(np.flatnonzero(joints)[-1])
            speed[owner] *= max(1.0 + FASTER * float(x[r + int(self.frame.free_shift) + k]), 0.1)
        return replace(settings, shift=shift, friction_speed=speed)

    def folded(self, x: Array, sigma: Array) -> list[NormalEquations]:
        """Of the groups in each fifth, in units of the residuals, with what the settings were off taken from the torques."""
        r, off, found = self.frame.base.count, x[self.frame.base.count :], list[NormalEquations]()
        for mine in self.folds():
            one = self.moments.equations(self.frame, 1, mine)
            N, c, y = one.N / sigma[:, None, None] ** 2, one.c / sigma[:, None] ** 2, one.y / sigma**2
            rest = y - 2.0 * c[:, r:] @ off + np.einsum("jkl,k,l->j", N[:, r:, r:], off, off)
            found.append(NormalEquations(N[:, :r, :r], c[:, :r] - N[:, :r, r:] @ off, rest, one.rows))
        return found

    def by_factors(self) -> Array:
        """The unknowns by the triangular factors in place of the normal equations: digits that these lose, it keeps."""
        prior = self.prior
        x, sigma = self.solved(np.arange(len(self.moments.counts)))
        sigma = np.ones_like(sigma) if self.method == "ols" else sigma
        rows, right = [np.diag(1.0 / prior.size)], [prior.mean / prior.size]
        for felt, R, size in zip(self.frame.felt, self.moments.factors, sigma, strict=True):
            row = np.zeros((len(R), len(x)))
            row[:, felt] = R[:, :-1] / size
            rows.append(row)
            right.append(R[:, -1] / size)
        A, b = np.concatenate(rows) * prior.size, np.concatenate(right)
        return np.asarray(scipy.linalg.lstsq(A, b)[0] * prior.size)


def fit_of(information: Information) -> InformationFit:
    """Least squares of all rows of an information."""
    i = information
    return InformationFit(i.frame, i.moments, i.weak, i.method, i.hanging)


def _whitened(equations: NormalEquations, sigma: Array) -> tuple[Array, Array]:
    """N and c of all joints together."""
    return np.einsum("jkl,j->kl", equations.N, sigma**-2), (equations.c / sigma[:, None] ** 2).sum(axis=0)
