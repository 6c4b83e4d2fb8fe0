"""Outliers of a log: contacts, snagged cables, mistyped poses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..core.estimation.least_squares import MAD
from ..core.typing import Array
from .contact_detection import CollisionThreshold
from .fit import Fit, Problem, fit
from .log import ReadingLog
from .observability import blind_spots
from .static_poses import StaticPoses

FALSE_ALARM_RATE = 3e-5
"""Probability that a clean log loses a reading; it is 1e-2 with pose errors of half a degree."""
FALSE_ALARM_RATE_OF_DWELL = 1e-9
"""Probability that a clean log loses a dwell, which is all readings of an orientation."""
MIN_READINGS_OF_DWELL = 5
"""Smallest number of readings of a dwell in which outliers are sought."""
SUSPECT_QUANTILE = 0.98
"""Quantile of clean readings above which a reading is suspect."""
MAX_DEVIATION_RATIO = 2.0
"""Largest ratio by which rejection may increase the standard deviation of an unknown."""
MIN_DIRECTIONS = 3
"""Number of gravity directions that determine mass, centre of mass and six biases."""


def least_rows(problem: Problem) -> int:
    """Smallest number of rows, of six numbers each, for the unknowns and two variances; an unknown mounting takes one more."""
    unknowns = problem.unknowns
    rows_for_unknowns = math.ceil((len(unknowns.names) + 2) / 6)
    return max(MIN_DIRECTIONS, rows_for_unknowns + unknowns.turn)  # turn: True if the mounting is unknown


def touched_in_static_poses(log: ReadingLog, poses: StaticPoses) -> Array:
    """Mask (N,) of readings that are outliers of their dwell, in dwells with less than half of outliers.

    A reading is an outlier if its distance from the dwell's median exceeds a χ² limit. Distances are in units of the noise,
    which is 1.4826 times the median absolute distance in all dwells. The false-alarm probability is 3e-5 for the whole
    log. Dwells of four or fewer readings have no outliers.
    """
    is_touched = np.zeros(len(log), bool)
    dwell_of_reading = poses.row
    long_dwells = np.flatnonzero(poses.count >= MIN_READINGS_OF_DWELL)
    if not long_dwells.size:
        return is_touched
    deviations = np.zeros((len(log), 6))  # from the median of the dwell
    for k in long_dwells.tolist():
        in_dwell = dwell_of_reading == k
        deviations[in_dwell] = log.readings[in_dwell] - np.median(log.readings[in_dwell], axis=0)
    in_long_dwell = np.isin(dwell_of_reading, long_dwells)
    rounding_error = np.abs(log.readings).max() * 1e-12 + 1e-300  # above zero, also for readings of zero
    noise = MAD * np.median(np.abs(deviations[in_long_dwell]), axis=0)
    noise = np.maximum(noise, rounding_error)  # if readings repeat
    threshold = CollisionThreshold.of_axes(noise, FALSE_ALARM_RATE / len(log))
    is_outlier = in_long_dwell & threshold(deviations)
    for k in np.unique(dwell_of_reading[is_outlier]).tolist():
        in_dwell = dwell_of_reading == k
        share_of_outliers = is_outlier[in_dwell].mean()
        if share_of_outliers < 0.5:
            is_touched |= is_outlier & in_dwell
    return is_touched


def reject_outliers(problem: Problem) -> tuple[Fit, Array]:
    """Fit with outlier rejection, and the mask (n,) of the rows that it uses.

    A Huber fit finds suspect rows, which are left out. Suspect rows that the fit of the other rows predicts are restored. This
    test has a false-alarm probability of 3e-5 for the whole log (1e-9 for a dwell) and is repeated until nothing changes.
    At least as many rows stay as the unknowns need, and at most a third is rejected. If the other rows determine an
    unknown much less well, all rows stay, and the contradictions count as noise.
    """
    from scipy import special

    n = len(problem.log)
    all_rows = np.ones(n, bool)
    robust_fit = fit(problem, keep=all_rows, huber=True)
    start = replace(problem, state=robust_fit.state)
    squared_distances = ((robust_fit.residuals / robust_fit.deviation) ** 2).sum(axis=1)
    spare_rows = max(0, n - least_rows(problem))
    max_suspects = min(n // 3, spare_rows)
    suspects = np.flatnonzero(squared_distances > special.chdtri(6, 1 - SUSPECT_QUANTILE))
    worst_first = np.argsort(-squared_distances[suspects])
    worst_indices = worst_first[:max_suspects]
    suspects = suspects[worst_indices]
    keep = all_rows.copy()
    keep[suspects] = False
    if suspects.size and not _determines_unknowns(start, robust_fit, keep):
        return fit(start, keep=all_rows), all_rows
    others_fit = fit(start, keep=keep)
    while suspects.size:
        if problem.noise is None and others_fit.freedom.min() < 1:
            return fit(start, keep=all_rows), all_rows
        A = others_fit.design[suspects]
        variances = others_fit.deviation[suspects] ** 2
        # covariance of the errors of predicted readings
        by_unknowns = A @ others_fit.joint @ np.swapaxes(A, -1, -2)
        by_noise = variances[..., None] * np.eye(6)
        S = by_unknowns + by_noise
        test = CollisionThreshold.predictive(S, others_fit.freedom, FALSE_ALARM_RATE / n)
        is_short = problem.count[suspects] < MIN_READINGS_OF_DWELL
        alarm_rates = np.where(is_short, FALSE_ALARM_RATE / n, FALSE_ALARM_RATE_OF_DWELL)
        is_outlier = test.distance(others_fit.residuals[suspects]) > special.chdtri(6, alarm_rates)
        if is_outlier.all():
            break
        keep[suspects[~is_outlier]] = True
        suspects = suspects[is_outlier]
        others_fit = fit(start, keep=keep)
    return others_fit, keep


def _determines_unknowns(problem: Problem, robust_fit: Fit, keep: Array) -> bool:
    """True if the rows of the mask ``keep`` determine every unknown nearly as well as all rows do."""
    kept_log = problem.log.rows(keep)
    if blind_spots(kept_log, problem.unknowns, problem.factor):
        return False
    A = robust_fit.design / robust_fit.deviation[..., None] * problem.unknowns.scales
    A = A[..., A.any(axis=(0, 1))]  # without unknowns that do not affect the readings
    p = A.shape[-1]
    try:
        variances = _variances(A.reshape(-1, p))
        variances_of_kept = _variances(A[keep].reshape(-1, p))
    except np.linalg.LinAlgError:
        return False
    is_determined = variances_of_kept <= MAX_DEVIATION_RATIO**2 * variances  # squared, as variances are
    return bool(is_determined.all() and (variances_of_kept > 0).all())  # rounding may make variances negative


def _variances(A: Array) -> Array:
    """Variances (p,) of unknowns with the whitened design A (n, p); raises LinAlgError if A has no full rank."""
    return np.diag(np.linalg.inv(A.T @ A))
