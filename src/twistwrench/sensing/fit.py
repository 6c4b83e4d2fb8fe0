"""Weighted least squares for bias, load and mounting, with the noise of moments and of forces estimated from the fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lie import so3
from .log import ReadingLog
from .sensor import load_regressor

Array = NDArray[Any]

__all__ = ["Fit", "Unknowns", "fit"]

_BIAS = tuple(f"bias {axis}" for axis in ("mx", "my", "mz", "fx", "fy", "fz"))
_LOAD = ("mass", "m cx", "m cy", "m cz")
_INERTIA = ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
_TURN = ("turn x", "turn y", "turn z")
_SIZES = {"bias": 1.0, "load": 1.0, "inertia": 0.1, "turn": 0.1}  # what counts as much of each, in its unit
_HUBER = 2.0  # scaled distance from which a reading loses weight; 1 is the middle of good ones
_ROUNDS, _SETTLED = 60, 1e-9


@dataclass(frozen=True)
class Unknowns:
    """What is asked: bias unless known, mass and first moment always, the six inertia numbers, the mounting's turn."""

    bias: bool = True
    inertia: bool = False
    turn: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns of the design, in order."""
        return (self.bias * _BIAS) + _LOAD + (self.inertia * _INERTIA) + (self.turn * _TURN)

    @property
    def scales(self) -> Array:
        """A size (p,) for each unknown that makes them comparable."""
        counts = {"bias": 6 * self.bias, "load": 4, "inertia": 6 * self.inertia, "turn": 3 * self.turn}
        return np.concatenate([np.full(n, _SIZES[kind]) for kind, n in counts.items()])

    @property
    def load(self) -> slice:
        """Where mass, first moment (and inertia) are."""
        start = 6 * self.bias
        return slice(start, start + 4 + 6 * self.inertia)

    def design(self, log: ReadingLog, factor: float, mounting: Array, load: Array | None = None) -> Array:
        """A (n, 6, p): how readings change with the unknowns; the turn's columns need the load (10,), else they are zero."""
        Y = factor * load_regressor(log.gravity, log.V, log.dV)
        Y = np.concatenate([mounting.T @ Y[:, :3], mounting.T @ Y[:, 3:]], axis=1)  # F_s = R_fs' F_f
        columns = [np.broadcast_to(np.eye(6), (len(log), 6, 6))] if self.bias else []
        columns.append(Y[..., : 10 if self.inertia else 4])
        if self.turn:
            F = np.zeros((len(log), 6)) if load is None else Y @ load
            # R exp([δ]): the wrench in the turned axes changes by F × δ.
            columns.append(np.concatenate([so3.hat(F[:, :3]), so3.hat(F[:, 3:])], axis=1))
        return np.concatenate(columns, axis=-1)


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """The unknowns that explain a log best, with their covariance."""

    unknowns: Unknowns
    estimate: Array
    """(p,) in the order of ``unknowns.names``; the turn's entries are zero, for ``mounting`` has them."""
    covariance: Array
    """(p, p); that of the turn is of a small rotation in the sensor's own axes [rad]."""
    sigma: Array
    """(2,) standard deviation of one reading's moment [N m] and force [N] entries."""
    freedom: Array
    """(2,) degrees of freedom these were estimated with; inf where they were given."""
    residuals: Array
    """(n, 6) readings minus model."""
    mounting: Array
    """R_fs (3, 3)."""
    design: Array
    """(n, 6, p)."""

    def __repr__(self) -> str:
        return f"<Fit: {', '.join(self.unknowns.names)} from {len(self.residuals)} readings>"

    @property
    def load(self) -> Array:
        """The ten parameters; inertia numbers that were not asked are zero."""
        part = self.estimate[self.unknowns.load]
        return np.concatenate([part, np.zeros(10 - len(part))])


def fit(
    log: ReadingLog,
    unknowns: Unknowns,
    factor: float,
    bias: Array,
    *,
    keep: Array,
    noise: Array | None = None,
    huber: bool = False,
    mounting: Array | None = None,
) -> Fit:
    """Explain the readings of ``keep`` (n,); ``noise`` (2,) if known, else estimated; with Huber's weights if ``huber``.

    ``bias`` (6,) counts where it is no unknown. The turn is found by Gauss-Newton from ``mounting``, the rest is linear; the
    variances are those that make the residuals' mean squares, corrected for the degrees of freedom, equal to them.
    """
    target = log.readings - (0.0 if unknowns.bias else bias)
    R = np.eye(3) if mounting is None else mounting
    sigma = np.array([0.03, 1.0]) if noise is None else noise
    floor = 1e-13 * (np.abs(target).max() + 1e-3)
    freedom, weight, load = np.full(2, math.inf), keep.astype(float), None
    A = unknowns.design(log, factor, R)
    for round_ in range(_ROUNDS):
        if unknowns.turn:
            A = unknowns.design(log, factor, R, load)
        x, unit, leverage = _solve(A, target, sigma, weight, unknowns.scales, turning=load is not None)
        residuals = target - (A @ x)
        before, weighed = sigma, weight
        if noise is None:
            sigma, freedom = _noise(residuals, leverage, weight, keep, floor, huber=huber)
        if huber:
            distance = _distance(residuals, sigma)
            weight = keep * np.minimum(1.0, _HUBER / np.maximum(distance, 1e-300))
        moved = max(float(np.abs(sigma / before - 1.0).max()), float(np.abs(weight - weighed).mean()))
        if unknowns.turn:
            load = np.concatenate([x[unknowns.load], np.zeros(10 - len(x[unknowns.load]))])
            R = R @ so3.exp(x[-3:])
            moved = max(moved, float(np.abs(x[-3:]).max()), float(round_ == 0))
            x[-3:] = 0.0
        if moved < (1e-3 if huber else _SETTLED) and (round_ or not huber):
            break
    return Fit(unknowns, x, unit, sigma, freedom, residuals, R, A)


def _solve(
    A: Array, target: Array, sigma: Array, weight: Array, scales: Array, *, turning: bool
) -> tuple[Array, Array, Array]:
    """Weighted least squares: estimate (p,), its covariance (p, p), leverages (n, 6)."""
    n, _, p = A.shape
    if not turning and not A[..., -1].any():  # no load yet: the turn waits
        A, free = A[..., :-3], p - 3
    else:
        free = p
    root = np.sqrt(weight)[:, None] / np.repeat(sigma, 3)
    Q, upper = np.linalg.qr((A * root[..., None]).reshape(6 * n, free) * scales[:free])
    inverse = np.linalg.inv(upper)
    x, unit = np.zeros(p), np.zeros((p, p))
    x[:free] = scales[:free] * (inverse @ (Q.T @ (target * root).ravel()))
    half = scales[:free, None] * inverse
    unit[:free, :free] = half @ half.T
    return x, unit, (Q * Q).sum(axis=1).reshape(n, 6)


def _distance(residuals: Array, sigma: Array) -> Array:
    """Root mean square (n,) of a reading's six residuals, each in units of its noise."""
    return np.sqrt(np.mean((residuals / np.repeat(sigma, 3)) ** 2, axis=1))


def _noise(
    residuals: Array, leverage: Array, weight: Array, keep: Array, floor: float, *, huber: bool
) -> tuple[Array, Array]:
    """Standard deviations (2,) of moments and forces and their degrees of freedom (2,)."""
    sigma, freedom = np.zeros(2), np.zeros(2)
    for k in range(2):
        part = slice(3 * k, 3 * k + 3)
        freedom[k] = 3 * keep.sum() - leverage[:, part].sum()
        if huber:  # by the median: up to half of the readings may be anything
            spread = 1.4826 * np.median(np.abs(residuals[keep][:, part]))
            sigma[k] = spread * math.sqrt(3 * keep.sum() / max(freedom[k], 1.0))
        else:
            sigma[k] = math.sqrt((weight[:, None] * residuals[:, part] ** 2).sum() / max(freedom[k], 1e-9))
    return np.maximum(sigma, floor), freedom
