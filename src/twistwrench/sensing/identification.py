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
from .static_poses import static_poses
from .unknowns import Unknowns

MIN_ROWS_IN_ORDER = 8
"""Smallest number of rows for tests that use their order."""
Cause: TypeAlias = Literal["orientation", "drift", "tilt", "delay"]
"""Causes of residuals for ``assume``, each an additional unknown of the fit."""
Causes: TypeAlias = Cause | Sequence[Cause]
Outliers: TypeAlias = Literal["trim", "keep"]
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
    assumed = [cause in causes for cause in CAUSES]
    unknowns = Unknowns(bias is None, arguments.flag(inertia, "inertia"), *assumed)
    known_bias, known_noise = _validate(bias, noise, outliers, confidence)
    _check_log(log, unknowns)
    used = np.ones(len(log), bool)
    poses = static_poses(log)
    if outliers == "trim":
        used = ~touched_in_static_poses(log, poses)
    if not used.all():
        poses = static_poses(log.rows(used))
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
    unobservable = blind_spots(log.rows(used), unknowns, factor)
    if unobservable:
        raise ValueRangeError(f"{log.name}: {' '.join(unobservable[:3])} {advice(log, unknowns)}")
    problem = with_guessed_mounting(problem)
    kept = np.ones(len(poses.log), bool)
    if outliers == "trim" and len(poses.log) > least_rows(problem):
        best_fit, kept = fit_unless_drift(problem, *reject_outliers(problem))
    else:
        best_fit = fit(problem, keep=kept)
    label = problem.label
    white = whiteness(best_fit, kept, label)
    has_revisits = len(np.unique(label)) < len(kept)
    if white is not None and white.length > 1 and not has_revisits:  # autocorrelated neighbours become one cluster
        problem = replace(problem, label=np.arange(len(kept)) // white.length, state=best_fit.state)
        best_fit = fit(problem, keep=kept)
    between_dwells = np.zeros(len(log), bool)
    between_dwells[used] = poses.row < 0
    left_out = ~used
    left_out[used] = ~poses.spread(kept) & ~between_dwells[used]
    used_readings = UsedReadings(left_out, between_dwells, label, white)
    return acceptance_test(Diagnosis(sign, best_fit, kept), confidence, problem, log, used_readings)


def whiteness(fit: Fit, kept: Array, label: Array) -> Whiteness | None:
    """Whiteness test of the residuals of the kept rows (n,), in the order of the log; None for too few rows.

    Rows with the same label (n,) share the pose error of a revisited orientation, so their mean is subtracted.
    """
    e = (fit.residuals / fit.deviation)[kept]
    _, cluster, count = np.unique(label[kept], return_inverse=True, return_counts=True)
    total = np.zeros((len(count), 6))
    np.add.at(total, cluster, e)
    cluster_means = np.where(count[:, None] > 1, total / count[:, None], 0.0)
    e = e - cluster_means[cluster]
    if len(e) < MIN_ROWS_IN_ORDER:
        return None
    A = (fit.design / fit.deviation[..., None])[kept].reshape(e.size, -1)
    largest_entries = np.abs(A).max(axis=0)
    Q, _ = np.linalg.qr(A / np.where(largest_entries > 0, largest_entries, 1.0))
    return Whiteness.from_residuals(e, Q.reshape(len(e), 6, -1), WRENCH)


def _check_log(log: ReadingLog, unknowns: Unknowns) -> None:
    """Raise ValueRangeError if the log lacks a signal that an unknown needs, or has too few readings."""
    motion = "motion, and the log has none. Give V and dV (columns wx, wy, wz, vx, vy, vz, dwx, …, dvz)"
    time = "time, and the log has none. Give a column time"
    orientations = "orientations, and the log has none. Give them"
    needs = (
        (unknowns.inertia, "an inertia", log.V, motion),
        (unknowns.delay, "a delay", log.V, motion),
        (unknowns.delay, "a delay", log.time, time),
        (unknowns.tilt, "a tilt of the base", log.rotations, orientations),
    )
    for is_unknown, name, signal, need in needs:
        if is_unknown and signal is None:
            raise ValueRangeError(f"{log.name}: {name} shows only in {need}; otherwise leave it out.")
    least = max(3, math.ceil((len(unknowns.names) + 2) / 6) + unknowns.turn)  # as least_rows
    if len(log) < least:
        readings = "1 reading" if len(log) == 1 else f"{len(log)} readings"
        raise ValueRangeError(
            f"{log.name}: {readings}, and {len(unknowns.names)} unknowns need at least {least} in different "
            "orientations. Add readings; `poses` proposes some."
        )


def _validate(
    bias: ArrayLike | None, noise: ArrayLike | None, outliers: str, confidence: float
) -> tuple[Array, Array | None]:
    """Known bias (6,), zero if there is none, and known noise (6,), if any."""
    known_bias = np.zeros(6) if bias is None else arguments.finite(arguments.one(bias, "bias", 6), "bias")
    known_noise = None if noise is None else six_noises(noise)
    arguments.choice(outliers, "outliers", ("trim", "keep"))
    if not 0 < arguments.number(confidence, "confidence") < 1:
        raise ValueRangeError(f"confidence {confidence!r} is not between 0 and 1. Give 0.95 for 95 %.")
    return known_bias, known_noise
