"""Readings that do not belong: someone touched the tool, the cable snagged, a pose was typed wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .fit import Fit, fit

Array = NDArray[Any]

__all__ = ["runs", "trimmed"]

_FALSE_ALARM = 1e-3  # chance that a clean log loses a reading
_SUSPECT = 0.98  # share of clean readings below the distance from which one is looked at


def trimmed(least: int, **problem: Any) -> tuple[Fit, Array]:
    """Fit without outliers: the fit and which readings (n,) it kept; at least ``least`` are kept.

    Huber's fit says which readings are suspect. They are left out, and each that the fit of the others predicts, within
    an F test whose chance of a false alarm is 1e-3 for the whole log, comes back; repeated until none changes.
    Sources: Huber, "Robust Statistics", 1981; Cook and Weisberg, "Residuals and Influence in Regression", 1982, § 2.2.
    """
    from scipy import special

    log, noise = problem["log"], problem.get("noise")
    n = len(log)
    everything = np.ones(n, bool)
    robust = fit(**problem, keep=everything, huber=True)
    problem = {**problem, "mounting": robust.mounting}
    score = ((robust.residuals / np.repeat(robust.sigma, 3)) ** 2).sum(axis=1)
    suspects = np.flatnonzero(score > special.chdtri(6, 1 - _SUSPECT))
    suspects = suspects[np.argsort(-score[suspects])][: max(0, min(n // 3, n - least))]
    keep = everything.copy()
    keep[suspects] = False
    found = fit(**problem, keep=keep)
    while suspects.size:
        freedom = float(min(found.freedom.min(), 1e9))
        if noise is None and freedom < 1:
            return fit(**problem, keep=everything), everything
        A, r = found.design[suspects], found.residuals[suspects]
        S = A @ found.covariance @ np.swapaxes(A, -1, -2) + np.diag(np.repeat(found.sigma, 3) ** 2)
        F = (r * np.linalg.solve(S, r[..., None])[..., 0]).sum(axis=1) / 6
        outside = special.fdtrc(6, freedom, F) < _FALSE_ALARM / n
        if outside.all():
            break
        keep[suspects[~outside]] = True
        suspects = suspects[outside]
        found = fit(**problem, keep=keep)
    return found, keep


def runs(mask: Array) -> list[tuple[int, int]]:
    """First and last index of each run of true values in ``mask`` (n,).

    >>> runs(np.array([True, True, False, True]))
    [(0, 1), (3, 3)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
