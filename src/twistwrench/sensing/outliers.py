"""Readings that do not belong: someone touched the tool, the cable snagged, a pose was typed wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..typing import Array
from .contact_detection import CollisionThreshold
from .dwells import Witnesses
from .fit import Fit, Problem, fit
from .log import ReadingLog
from .observability import blind_spots

_FALSE_ALARM = 1e-3  # chance that a clean log loses a reading
_DWELL_ALARM = 1e-9  # that it loses a dwell: whole orientations go only where nothing else can be
_DWELL = 5  # readings of a dwell
_SUSPECT = 0.98  # share of clean readings below the distance from which one is looked at
_WEAKER = 2.0  # times by which what is left out may widen any unknown's deviation
_LEAST = 3  # gravity directions that fix a mass, its place and six biases
_MAD = 1.4826  # standard deviations that the median absolute deviation of normal noise makes


def least_rows(problem: Problem) -> int:
    """How many rows these unknowns need."""
    asked = problem.unknowns
    return max(_LEAST, math.ceil((len(asked.names) + 2) / 6) + asked.turn)


def touched_in_dwells(log: ReadingLog, found: Witnesses) -> Array:
    """A mask (N,) of readings that the others of their dwell contradict; never half of a dwell.

    A reading is far when its distance from the dwell's median, over 1.4826 times the median absolute distance in all
    dwells, passes a χ² limit whose chance of a false alarm is 1e-3 for the whole log. Dwells of four or fewer are kept.
    """
    touched = np.zeros(len(log), bool)
    place = found.row
    dwells = np.flatnonzero(found.count >= _DWELL)
    if not dwells.size:
        return touched
    off = np.zeros((len(log), 6))
    member = np.isin(place, dwells)
    for k in dwells.tolist():
        rows = place == k
        off[rows] = log.readings[rows] - np.median(log.readings[rows], axis=0)
    spread = _MAD * np.median(np.abs(off[member]), axis=0)
    noise = np.maximum(spread, np.abs(log.readings).max() * 1e-12 + 1e-300)
    limit = CollisionThreshold.of_axes(noise, _FALSE_ALARM / len(log))
    far = member & limit(off)
    for k in np.unique(place[far]).tolist():
        rows = place == k
        if far[rows].mean() < 0.5:
            touched |= far & rows
    return touched


def trimmed(problem: Problem) -> tuple[Fit, Array]:
    """Fit without outliers: the fit and which rows (n,) it kept.

    Huber's fit says which rows are suspect. They are left out, and each that the fit of the others predicts, within a test
    whose chance of a false alarm is 1e-3 for the whole log (1e-9 for a dwell), comes back; repeated until none changes.
    At least as many rows stay as the unknowns need, at most a third goes, and what stays tells each unknown nearly as well
    as all: where it would not, all stay, and what they contradict is in the noise.
    Sources: Huber, "Robust Statistics", 1981; Cook and Weisberg, "Residuals and Influence in Regression", 1982, § 2.2.
    """
    from scipy import special

    n = len(problem.log)
    everything = np.ones(n, bool)
    robust = fit(problem, keep=everything, huber=True)
    start = replace(problem, state=robust.state)
    score = ((robust.residuals / robust.deviation) ** 2).sum(axis=1)
    suspects = np.flatnonzero(score > special.chdtri(6, 1 - _SUSPECT))
    suspects = suspects[np.argsort(-score[suspects])][: max(0, min(n // 3, n - least_rows(problem)))]
    keep = everything.copy()
    keep[suspects] = False
    if suspects.size and not _still_told(start, robust, keep):
        return fit(start, keep=everything), everything
    found = fit(start, keep=keep)
    while suspects.size:
        if problem.noise is None and found.freedom.min() < 1:
            return fit(start, keep=everything), everything
        A, v = found.design[suspects], found.deviation[suspects] ** 2
        S = A @ found.joint @ np.swapaxes(A, -1, -2) + v[..., None] * np.eye(6)
        test = CollisionThreshold.predictive(S, found.freedom, _FALSE_ALARM / n)
        alarm = np.where(problem.count[suspects] < _DWELL, _FALSE_ALARM / n, _DWELL_ALARM)
        outside = test.distance(found.residuals[suspects]) > special.chdtri(6, alarm)
        if outside.all():
            break
        keep[suspects[~outside]] = True
        suspects = suspects[outside]
        found = fit(start, keep=keep)
    return found, keep


def _still_told(problem: Problem, robust: Fit, keep: Array) -> bool:
    """Whether the rows kept tell every unknown nearly as well as all rows do."""
    rows = problem.log.rows(keep)
    if blind_spots(rows, problem.unknowns, problem.factor):
        return False
    A = robust.design / robust.deviation[..., None] * problem.unknowns.scales
    A = A[..., A.any(axis=(0, 1))]
    p = A.shape[-1]
    try:
        all_, some = (np.diag(np.linalg.inv(a.T @ a)) for a in (A.reshape(-1, p), A[keep].reshape(-1, p)))
    except np.linalg.LinAlgError:
        return False
    return bool((some <= _WEAKER**2 * all_).all() and (some > 0).all())


def runs(mask: Array) -> list[tuple[int, int]]:
    """First and last index of each run of true values in ``mask`` (n,).

    >>> runs(np.array([True, True, False, True]))
    [(0, 1), (3, 3)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
