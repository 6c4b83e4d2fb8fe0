"""How sure groups of parameters are, where residuals hang together in time: the sandwich over blocks of time.

Rows of a block of time count as one witness (Liang and Zeger, "Longitudinal data analysis using generalized linear models",
Biometrika 73, 1986), with the correction for few witnesses of Bell and McCaffrey that the sensors' fits have as well. The
textbook's s² (W'W)^-1 takes every row for a witness, and is several times too small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..sensing.covariance import by_moments, witnesses
from ..typing import Array
from .normal_equations import Prior

_MOST_BLOCKS, _FEWEST_BLOCKS = 120, 15
_SECONDS = 1.0
"""s, that a block lasts at least, where the logs have enough of them."""
_LENGTHS = 10.0
"""Times the length over which residuals hang together that a block lasts."""
_PORTION = 1000
"""Rows that are factored at a time."""


@dataclass(frozen=True, eq=False)
class GroupCovariance:
    """Covariance of the groups.

    Attributes
    ----------
    matrix : (r, r) array
    freedom : (r,) array, degrees of freedom of each group's variance
    textbook : (r,) array, standard deviations as if every row were independent
    block : float, how long a block is [s]
    """

    matrix: Array
    freedom: Array
    textbook: Array
    block: float

    @property
    def deviations(self) -> Array:
        """(r,) standard deviations."""
        return np.sqrt(np.maximum(self.matrix.diagonal(), 0.0))  # of what is known, rounding is left

    def half_width(self, level: float = 0.95) -> Array:
        """(r,) half the width of intervals that hold the truth with that chance.

        Parameters
        ----------
        level : float

        Returns
        -------
        width : (r,) array

        Examples
        --------
        >>> GroupCovariance(np.eye(1), np.array([1e9]), np.ones(1), 1.0).half_width().round(2).tolist()
        [1.96]
        """
        from scipy.special import stdtrit

        return np.asarray(stdtrit(np.maximum(self.freedom, 1.0), 0.5 + 0.5 * level) * self.deviations)


def group_covariance(
    W: Array,
    tau: Array,
    x: Array,
    sigma: Array,
    weights: Array,
    prior: Prior,
    time: Array,
    log: Array,
    chosen: Array,
) -> GroupCovariance:
    """Covariance of a fit: W (n, nv, r), τ (n, nv), at x (r,), with its residuals' sizes (nv,) and weights (n, nv).

    ``time`` and ``log`` (n,) say when each row is, and of which log. ``chosen`` (n, nv, k) is what the predicted torques change
    by with each setting that was chosen on the same rows, such as the offset of the clock: the fit is no surer than they are.
    """
    groups = W.shape[2]
    left = tau - W @ x
    size = np.sqrt((chosen**2).mean(axis=(0, 1)))
    rows = _WhitenedRows(W, chosen[..., size > 0] / size[size > 0], np.sqrt(weights) / sigma)
    prior = Prior(np.zeros(rows.count), np.concatenate([prior.size, np.full(int((size > 0).sum()), sigma.max() * 1e3)]))
    found = _covariance(rows, left * rows.root, prior, time, log)
    matrix = found.matrix[:groups, :groups] * _huber_factor(left, weights) ** 2
    return GroupCovariance(matrix, found.freedom[:groups], found.textbook[:groups], found.block)


@dataclass(frozen=True, eq=False)
class _WhitenedRows:
    """Columns W (n, nv, r) and beside them others (n, nv, k), times the roots (n, nv) of their weights: some rows at a time."""

    W: Array
    beside: Array
    root: Array

    @property
    def count(self) -> int:
        """Of all columns."""
        return int(self.W.shape[2] + self.beside.shape[2])

    def of(self, rows: Array | slice) -> Array:
        """(m nv, r + k) of some of the rows."""
        A = np.concatenate([self.W[rows], self.beside[rows]], axis=2)
        A *= self.root[rows][..., None]
        return A.reshape(-1, self.count)

    def factor(self, size: Array) -> Array:
        """R (r + k, r + k) with R'R = 1 + A'A of the columns in units of their sizes: of the rows so far and the next ones."""
        R: Array = np.eye(self.count)
        for begin in range(0, len(self.W), _PORTION):
            more = self.of(slice(begin, begin + _PORTION)) * size
            R = np.asarray(np.linalg.qr(np.concatenate([R, more]), mode="r"))
        return R

    def moments(self, left: Array, half: Array, label: Array) -> tuple[Array, Array]:
        """Q_g'Q_g (g, r + k, r + k) and Q_g'e_g (g, r + k) of each witness, Q = A half and e (n, nv) the residuals."""
        place = witnesses(label)
        order = np.argsort(place, kind="stable")
        parts = np.split(order, np.searchsorted(place[order], np.arange(1, int(place.max()) + 1)))
        M, s = np.zeros((len(parts), self.count, self.count)), np.zeros((len(parts), self.count))
        for g, rows in enumerate(parts):
            Q = self.of(rows) @ half
            M[g], s[g] = Q.T @ Q, Q.T @ left[rows].reshape(-1)
        return M, s


def _huber_factor(left: Array, weights: Array) -> float:
    """What the weights of large residuals make the equations seem steeper by than they are: mean weight over mean slope.

    Huber's residuals count with ψ(u) = w u, whose slope is 1 up to k and 0 beyond. Source: Huber, "Robust Statistics", 1981,
    section 7.6.
    """
    live = (left != 0).any(axis=0)
    if not live.any() or (weights == 1.0).all():
        return 1.0
    return float(weights[:, live].mean() / (weights[:, live] == 1.0).mean())


def _covariance(rows: _WhitenedRows, left: Array, prior: Prior, time: Array, log: Array) -> GroupCovariance:
    """The sandwich of all columns, ``left`` (n, nv) the whitened residuals."""
    (n, nv), r = left.shape, rows.count
    half = prior.size[:, None] * np.linalg.inv(rows.factor(prior.size))
    step = float(np.median(np.diff(time)[np.diff(log) == 0])) if n > 1 else 1.0
    textbook = np.sqrt(np.maximum(((half @ half.T).diagonal()) * float((left**2).sum()) / max(1, n * nv - r), 0.0))
    apart = max(_LENGTHS * hanging(left), _SECONDS / step)
    apart = float(np.clip(apart, n / _MOST_BLOCKS, n / _FEWEST_BLOCKS))
    for _ in range(8):
        label = np.arange(n) // max(1, math.ceil(apart))
        found = by_moments(*rows.moments(left, half, label + (label.max() + 1) * log), half)
        if found is not None:
            matrix, freedom = found
            return GroupCovariance(matrix, freedom, textbook, apart * step)
        apart /= 2.0
        if apart < 1.0:
            break
    inflated = half @ half.T * hanging(left)
    return GroupCovariance(inflated, np.full(r, 1e9), textbook, 0.0)


def hanging(left: Array) -> float:
    """Rows that residuals (n, nv) hang together over: 1 + 2 Σ ρ up to where ρ is lost in noise, the most of the joints."""
    n = len(left)
    lags = min(n // 4, 400)
    longest = 1.0
    for column in left.T:
        e = column - column.mean()
        size = float(e @ e)
        if size <= 0:
            continue
        spectrum = np.fft.rfft(e, 2 * n)
        rho = np.fft.irfft(spectrum * spectrum.conj())[: lags + 1] / size
        below = np.flatnonzero(rho < 2.0 / math.sqrt(n))
        stop = int(below[0]) if below.size else lags
        longest = max(longest, 1.0 + 2.0 * float(rho[1:stop].sum()))
    return longest
