"""Identification of a sensor's load from a log: bias, mass, centre of mass, inertia and mounting."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.estimation.covariance import Whiteness
from ..core.gravity import STRENGTH
from ..core.typing import Array
from ..mechanics.lie.labelled import WRENCH
from .acceptance import UsedReadings, acceptance_test
from .contact_detection import six_noises
from .conventions import Diagnosis, with_guessed_mounting
from .files import readings_of
from .fit import Fit, Problem, fit
from .further_unknowns import fit_unless_drift
from .log import ReadingLog, ReadingsGiven
from .observability import advice, blind_spots
from .outliers import least_rows, reject_outliers, touched_in_static_poses
from .result import Identification
from .sensor import Sign, sign_factor
from .static_poses import StaticPoses, static_poses
from .unknowns import Unknowns

MIN_ROWS_IN_ORDER = 8
"""Smallest number of rows for tests that use the order of the rows."""
Cause: TypeAlias = Literal["orientation", "drift", "tilt", "delay"]
"""Causes of residuals for ``assume``, each an additional unknown of the fit."""
Causes: TypeAlias = Cause | Sequence[Cause]
"""A cause, or several."""
Outliers: TypeAlias = Literal["trim", "keep"]
"""Treatment of outliers: rejected, or used."""
BiasGiven: TypeAlias = ArrayLike
NoiseGiven: TypeAlias = ArrayLike
CAUSES: tuple[Cause, ...] = get_args(Cause)


def identify(
    log: ReadingsGiven,
    *,
    sign: Sign = "on_sensor",
    inertia: bool = False,
    assume: Causes = (),
    bias: BiasGiven | None = None,
    noise: NoiseGiven | None = None,
    outliers: Outliers = "trim",
    confidence: float = 0.95,
    gravity: float = STRENGTH,
) -> Identification:
    """Force-torque sensor identification: bias, mass and centre of mass of the load, from readings in different poses.

    Parameters
    ----------
    log : ReadingLog, path of a log, "demo" or "demo-motion"
    sign : "on_sensor" or "by_sensor"
        Readings are what the load does to the sensor (at rest its weight), or what the sensor does to it.
    inertia : bool
        Estimate the six moments of inertia too; the log needs wx … vz and dwx … dvz, in lively motion.
    assume : str or sequence of str
        Estimate this cause of residuals too. orientation: rotation of the sensor's axes against the frame of the poses.
        drift: linear change of the bias, which then is that of the middle of the log. tilt: rotation of gravity; the log
        needs orientations. delay: delay of the readings; the log needs time and motion.
    bias : (6,) array_like, optional
        Known bias [N m, N], which is then not estimated.
    noise : (2,) or (6,) array_like, optional
        Standard deviation of moments [N m] and forces [N], or of all six; default: estimated.
    outliers : "trim" rejects and lists outliers, "keep" uses all readings
    confidence : float, confidence level of intervals and regions, 0 to 1
    gravity : float
        Its size [m/s²], for a log that is read from a file; -z of the world.

    Returns
    -------
    found : Identification
        Includes doubts about units, sign, mounting, bias, poses and noise.

    Raises
    ------
    ValueRangeError
        The log does not determine the unknowns, or the mass is negative. The message lists combinations of unknowns
        without effect on the readings.

    Notes
    -----
    Without ``inertia`` the sensor's load has an ``unknown`` inertia: in motion, forces are compensated and moments are
    not. Source: least squares of F = Y π, Modern Robotics eq. 8.40.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> from twistwrench.sensing import ForceTorqueSensor, simulate
    >>> tool = ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)), bias=[0, 0, 0, 5, 0, 0])
    >>> found = identify(simulate(tool, 12, noise=(0.0, 0.0)))
    >>> round(found.sensor.load.mass, 6), round(float(found.sensor.load.com[2]), 6)
    (3.0, 0.1)
    >>> print(identify("demo").headline)
    OK: 2.986 ± 0.022 kg (95 %) at (4.9, -12.1, 85.6) mm.
    """
    log = readings_of(log, gravity, "identify")
    factor = sign_factor(sign)
    causes = (assume,) if isinstance(assume, str) else tuple(assume)
    for cause in causes:
        arguments.choice(cause, "assume", CAUSES)
    is_assumed = [cause in causes for cause in CAUSES]  # in the order of the fields of Unknowns
    has_inertia = arguments.flag(inertia, "inertia")
    unknowns = Unknowns(bias is None, has_inertia, *is_assumed)
    known_bias, known_noise = _validate(bias, noise, outliers, confidence)
    _check_log(log, unknowns)
    is_used = np.ones(len(log), bool)  # mask of readings
    poses = static_poses(log)
    if outliers == "trim":
        is_used = ~touched_in_static_poses(log, poses)
    if not is_used.all():
        poses = static_poses(log.rows(is_used))
    problem = Problem(
        log=poses.log,
        unknowns=unknowns,
        factor=factor,
        bias=known_bias,
        noise=known_noise,
        count=poses.count,
        within=poses.within,
        within_freedom=poses.within_freedom,
        label=poses.label,
        timed=log.time is not None,
    )
    unobservable = blind_spots(log.rows(is_used), unknowns, factor)
    if unobservable:
        sentences = " ".join(unobservable[:_MAX_BLIND_SPOTS])
        raise ValueRangeError(f"{log.name}: {sentences} {advice(log, unknowns)}")
    problem = with_guessed_mounting(problem)
    is_kept = np.ones(len(poses.log), bool)  # mask of rows, which are dwells or readings in motion
    if outliers == "trim" and len(poses.log) > least_rows(problem):
        trimmed_fit, is_kept = reject_outliers(problem)
        best_fit, is_kept = fit_unless_drift(problem, trimmed_fit, is_kept)
    else:
        best_fit = fit(problem, keep=is_kept)
    white = whiteness(best_fit, is_kept, poses.label)
    has_revisits = len(np.unique(poses.label)) < len(is_kept)
    is_autocorrelated = white is not None and white.length > 1
    if white is not None and is_autocorrelated and not has_revisits:  # neighbours become one cluster
        cluster_of_row = np.arange(len(is_kept)) // white.length
        problem = replace(problem, label=cluster_of_row, state=best_fit.state)
        best_fit = fit(problem, keep=is_kept)
    used_readings = _used_readings(is_used, poses, is_kept, white)
    return acceptance_test(Diagnosis(sign, best_fit, is_kept), confidence, problem, log, used_readings)


_MAX_BLIND_SPOTS = 3
"""Largest number of sentences on unobservable unknowns in an error message."""


def _used_readings(is_used: Array, poses: StaticPoses, is_kept: Array, white: Whiteness | None) -> UsedReadings:
    """Use of each reading, from the masks of used readings (N,) and of kept rows (n,)."""
    is_between_dwells = np.zeros(len(is_used), bool)
    is_between_dwells[is_used] = poses.row < 0  # readings without a row
    is_outlier = ~is_used
    is_reading_kept = poses.spread(is_kept)  # from rows to readings
    is_outlier[is_used] = ~is_reading_kept & ~is_between_dwells[is_used]
    return UsedReadings(is_outlier, is_between_dwells, poses.label, white)


def whiteness(fit: Fit, kept: Array, label: Array) -> Whiteness | None:
    """Whiteness test of the residuals of the rows that the mask ``kept`` (n,) marks, in the order of the log.

    Rows with the same ``label`` (n,) share the pose error of a revisited orientation, so their mean is subtracted. Returns None
    for too few rows.
    """
    scaled_residuals = fit.residuals / fit.deviation
    e = scaled_residuals[kept]  # (n, 6)
    _, cluster, count = np.unique(label[kept], return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), 6))  # of each cluster
    np.add.at(sums, cluster, e)
    cluster_means = np.where(count[:, None] > 1, sums / count[:, None], 0.0)  # a single row keeps its residual
    e = e - cluster_means[cluster]
    if len(e) < MIN_ROWS_IN_ORDER:
        return None
    weighted_design = fit.design / fit.deviation[..., None]
    A = weighted_design[kept].reshape(e.size, -1)
    largest_entries = np.abs(A).max(axis=0)
    column_sizes = np.where(largest_entries > 0, largest_entries, 1.0)
    Q, _ = np.linalg.qr(A / column_sizes)
    return Whiteness.from_residuals(e, Q.reshape(len(e), 6, -1), WRENCH)


def _check_log(log: ReadingLog, unknowns: Unknowns) -> None:
    """Raise ValueRangeError if the log lacks a signal that an unknown needs, or has too few readings."""
    motion = "motion, and the log has none. Give V and dV (columns wx, wy, wz, vx, vy, vz, dwx, …, dvz)"
    time = "time, and the log has none. Give a column time"
    orientations = "orientations, and the log has none. Give them"
    needs = (  # True if it is an unknown, its name, signal in the log, text about this signal
        (unknowns.inertia, "an inertia", log.V, motion),
        (unknowns.delay, "a delay", log.V, motion),
        (unknowns.delay, "a delay", log.time, time),
        (unknowns.tilt, "a tilt of the base", log.rotations, orientations),
    )
    for is_unknown, name, signal, signal_text in needs:
        if is_unknown and signal is None:
            raise ValueRangeError(f"{log.name}: {name} shows only in {signal_text}; otherwise leave it out.")
    # A reading has six equations. The minimum is the same as in least_rows.
    unknown_count = len(unknowns.names)
    min_readings = max(3, math.ceil((unknown_count + 2) / 6) + unknowns.turn)
    if len(log) < min_readings:
        readings = "1 reading" if len(log) == 1 else f"{len(log)} readings"
        raise ValueRangeError(
            f"{log.name}: {readings}, and {unknown_count} unknowns need at least {min_readings} in different "
            "orientations. Add readings; `poses` proposes some."
        )


def _validate(
    bias: ArrayLike | None, noise: ArrayLike | None, outliers: str, confidence: float
) -> tuple[Array, Array | None]:
    """Known bias (6,), zero if it is not known, and known noise (6,), None if it is not known."""
    known_bias = np.zeros(6)
    if bias is not None:
        six_numbers = arguments.one(bias, "bias", 6)
        known_bias = arguments.finite(six_numbers, "bias")
    known_noise = None if noise is None else six_noises(noise)
    arguments.choice(outliers, "outliers", ("trim", "keep"))
    level = arguments.number(confidence, "confidence")
    if not 0 < level < 1:
        raise ValueRangeError(f"confidence {confidence!r} is not between 0 and 1. Give 0.95 for 95 %.")
    return known_bias, known_noise
