"""Acceptance test of an identification: the sensor of a fit, notes and doubts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.errors import ValueRangeError
from ..core.estimation.covariance import Whiteness
from ..core.numbers import number, percent, plus_minus, seconds
from ..core.text import Argument
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie.labelled import WRENCH
from .conventions import (
    Diagnosis,
    explain,
    free_bias,
    indistinguishable_from_the_best,
    others,
    swap_forces_and_moments,
    upside_down,
)
from .doubts.reading_doubts import is_planar, listed_bias, misfit, seems_moving, turns_may_help, unexplained_turns
from .doubts.unit_doubts import unit_doubt
from .fit import Problem, few
from .further_unknowns import offers, offers_drift
from .log import ReadingLog
from .result import Identification, weakness
from .sensor import ForceTorqueSensor, Inertia, Sign
from .static_poses import runs

_INPUT_MISTAKES = ("sensor-exchanged", "sensor-known-bias", "sensor-gravity-up")
"""Kinds of doubts that explain a log by a mistake other than its units."""
_MAY_POINT_UP = (
    "Or gx, gy, gz point up, as an accelerometer at rest logs them, which explains the log as well: "
    "then negate these three and keep the sign."
)
"""Sentence after a remedy that exchanges the sign of readings with gravity columns."""
MAX_NOISE_RATIO = 1.5
"""Ratio of residuals to given noise above which the noise is doubtful."""
MIN_ORIENTATIONS = 10
"""Smallest number of orientations for reliable intervals."""
MIN_CHANNEL_FREEDOM = 6
"""Smallest number of degrees of freedom of a channel for reliable intervals."""
MIN_MISFIT = 0.05
"""Residual, as a fraction of the change of forces, above which it may be more than noise."""
_MAX_LISTED_SPANS = 10
"""Largest number of runs of outliers that are listed."""


@dataclass(frozen=True, eq=False)
class UsedReadings:
    """Classification of the readings of a log: outliers, between static poses, or used in the fit."""

    left_out: Array
    """Mask (N,) of outliers."""
    between: Array
    """Mask (N,) of readings between dwells."""
    orientation: Array
    """Label (n,) of the orientation of each row of the fit."""
    whiteness: Whiteness | None
    """Whiteness of the residuals; None for too few rows."""


def acceptance_test(
    found: Diagnosis, confidence: float, problem: Problem, log: ReadingLog, use: UsedReadings
) -> Identification:
    """Result of an identification with its doubts; raises ValueRangeError if the mass is negative or zero.

    ``problem`` is the problem that ``found`` solves, and ``log`` has all readings.
    """
    fit = found.fit
    unknowns = fit.unknowns
    low, high = fit.interval("mass", confidence)
    is_negative = found.mass < -2 * fit.mass_deviation  # by more than two standard deviations
    if is_negative or found.mass == 0:
        raise ValueRangeError(f"{log.name}: {_no_mass(found, log, problem)}")
    has_mass = low > 0
    load = SpatialInertia.zero()
    if found.mass > 0:  # otherwise the mass is zero within noise: no load
        load = SpatialInertia.from_parameters(fit.load)
        if not unknowns.inertia and has_mass:  # at least the moments of a point mass
            load = SpatialInertia.from_com(found.mass, load.com)
    bias = fit.estimate[:6] if unknowns.bias else problem.bias
    inertia: Inertia = "unknown"
    if unknowns.inertia:
        inertia = "accept" if load.defects() else "given"
    sensor = ForceTorqueSensor(load, bias, found.sign, fit.mounting, inertia=inertia)
    doubts = _log_doubts(log, use)
    if not has_mass:
        mass_text = f"{plus_minus(found.mass, (high - low) / 2, 'kg')} ({percent(confidence, 3)})"
        doubts.append(doubt("sensor-mass", mass=mass_text))
    elif load.defects():
        doubts.append(doubt("sensor-inertia-invalid", defects="; ".join(load.defects())))
    causes = _noise_doubts(found) + _explanation_doubts(found, log, problem)
    if has_mass and not causes:
        causes += offers(problem, fit, found.kept)
    kinds = {cause.kind for cause in causes}
    if kinds.isdisjoint(_INPUT_MISTAKES):
        doubt_of_units = None
        if has_mass and "sensor-gain" not in kinds:
            doubt_of_units = unit_doubt(found, sensor, problem.log)
        causes += _size_doubts(log, doubt_of_units)
    is_used = ~use.left_out & ~use.between  # for each reading
    result = Identification(sensor, fit, found.kept, is_used, confidence, log, left_out=use.left_out)
    weaknesses = []
    if has_mass and not any(cause.refuses for cause in causes):
        weaknesses = weakness(result)
    return replace(result, doubts=(*doubts, *causes, *weaknesses, *_cluster_doubts(found, problem, use)))


def _size_doubts(log: ReadingLog, doubt_of_units: Doubt | None) -> list[Doubt]:
    """Doubts about the units of the motion; if there are none, about the units of the readings, or else about their sizes."""
    motion_doubts = log.motion_doubts()
    if motion_doubts:
        return motion_doubts
    if doubt_of_units:
        return [doubt_of_units]
    return log.size_doubts()


def _log_doubts(log: ReadingLog, use: UsedReadings) -> list[Doubt]:
    """Doubts about outliers and about readings between dwells."""
    doubts = []
    outlier_count = int(use.left_out.sum())
    if outlier_count:
        spans = [_span_text(log, first, last) for first, last in runs(use.left_out)]
        spans_text = ", ".join(spans[:_MAX_LISTED_SPANS])
        if len(spans) > _MAX_LISTED_SPANS:
            spans_text += ", …"
        if log.time is None:
            spans_text += " (from 0)"
        doubts.append(doubt("sensor-outliers", count=outlier_count, total=len(log), listed=spans_text))
    between_count = int(use.between.sum())
    if between_count:
        doubts.append(doubt("sensor-between-dwells", count=between_count))
    return doubts


def _cluster_doubts(found: Diagnosis, problem: Problem, use: UsedReadings) -> list[Doubt]:
    """Doubts about intervals that may be too narrow."""
    doubts = []
    labels = use.orientation[found.kept]  # of the orientation of each row
    count = len(np.unique(labels))
    # Readings of a revisited orientation share its error, so that they add no degree of freedom.
    revisit_count = len(labels) - count
    freedom = (1.0 - found.fit.leverage[found.kept]).sum(axis=0) - revisit_count  # of each channel
    missing_freedom = math.ceil(MIN_CHANNEL_FREEDOM - freedom.min() - 1e-9)  # 1e-9: rounding errors
    missing_orientations = max(MIN_ORIENTATIONS - count, missing_freedom)
    if problem.noise is None and missing_orientations > 0:
        alike = ""
        if few(labels):
            alike = ", and it is taken to be alike in the three forces and in the three moments"
        details: dict[str, Any] = {
            "orientations": MIN_ORIENTATIONS,
            "count": count,
            "axis": WRENCH[int(freedom.argmin())],
            "wanted": missing_orientations,
            "alike": alike,
            "freedom": number(max(freedom.min(), 0.0), 2),
            "least": MIN_CHANNEL_FREEDOM,
        }
        doubts.append(doubt("sensor-few-orientations", **details))
    whiteness = use.whiteness
    if whiteness is not None and not whiteness.white:
        details = {
            "axis": whiteness.axis,
            "lag1": number(whiteness.lag1, 2),
            "rare": number(1 / max(whiteness.chance, 1e-12), 2),
            "test": whiteness.test,
            "length": whiteness.length,
            "found": {"value": whiteness.lag1},
        }
        doubts.append(doubt("sensor-correlated", **details))
    return doubts


def _span_text(log: ReadingLog, first: int, last: int) -> str:
    """Times of a run of readings; indices for a log without times."""
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"{first}" if first == last else f"{first}–{last}"


def _no_mass(found: Diagnosis, log: ReadingLog, problem: Problem) -> str:
    """Message for a mass that is negative or zero: evidence and most likely cause."""
    evidence = f"mass comes out as {number(found.mass)} kg"
    better = others(found.sign, problem)  # the best first
    for reference in (found, *better[:1]):
        mistake = _input_mistake(found, problem, reference)
        if mistake:
            return f"{evidence}. {mistake}"
    if seems_moving(log):
        return f"{doubt('sensor-moving', evidence=evidence)}"
    if not better:
        return (
            f"{evidence}, with either sign. Check that the poses are of the sensor's frame and the readings of a load."
        )
    force_noise = unexplained_turns(problem.log, better[0])
    if force_noise is not None:
        return f"{evidence}. {_doubt_on_poses(better[0], force_noise)}"
    return f"{evidence}, so sign or mounting are not as given. {_remedy(better, found, log)}"


def _doubt_on_poses(found: Diagnosis, force_noise: float) -> Doubt:
    """Doubt about poses, with the noise [N] of forces estimated without them."""
    return doubt("sensor-poses", noise=_noise(found), own=number(force_noise, 2))


def _remedy(better: list[Diagnosis], found: Diagnosis, log: ReadingLog) -> str:
    """Sentences with the arguments that fit the log better, and their residual."""
    best, *equally_good = indistinguishable_from_the_best(better)
    options = " or ".join(explanation.options for explanation in (best, *equally_good))
    remedy = f"Use {options}: the residual is then {_noise(best)}."
    if equally_good:
        remedy += " These cannot be distinguished: check the sign, or add readings tilted about another axis."
    if log.by_gravity and log.V is None and best.sign != found.sign:
        remedy += f" {_MAY_POINT_UP}"
    return remedy


def _input_mistake(found: Diagnosis, problem: Problem, reference: Diagnosis) -> Doubt | None:
    """Doubt about swapped columns, a wrong bias or gravity that points up; None if none of them fits significantly better.

    ``reference`` is the fit with which swapped columns and reversed gravity are compared.
    """
    with_free_bias = free_bias(found, problem)
    with_swapped_columns = swap_forces_and_moments(problem, with_free_bias or reference)
    if with_swapped_columns is not None:
        sign = Argument("sign", with_swapped_columns.sign)
        return doubt("sensor-exchanged", sign=sign, noise=_noise(with_swapped_columns))
    if with_free_bias is not None:
        bias = listed_bias(with_free_bias.fit.estimate[:6])
        return doubt("sensor-known-bias", bias=bias, before=_noise(found), after=_noise(with_free_bias))
    with_reversed_gravity = upside_down(found, problem, reference)
    if with_reversed_gravity is None:
        return None
    return doubt("sensor-gravity-up", noise=_noise(with_reversed_gravity))


def _noise_doubts(found: Diagnosis) -> list[Doubt]:
    """Doubts about a given noise that residuals exceed."""
    is_given = np.isinf(found.fit.freedom).all()
    if not is_given:
        return []
    scaled_residuals = (found.fit.residuals / found.fit.deviation)[found.kept]
    moments_and_forces = scaled_residuals.reshape(-1, 2, 3)
    ratios = np.sqrt((moments_and_forces**2).mean(axis=(0, 2))).tolist()
    doubts = []
    for quantity, ratio in zip(("moments", "forces"), ratios, strict=True):
        if ratio > MAX_NOISE_RATIO:
            doubts.append(doubt("sensor-noise", what=quantity, times=number(ratio, 2)))
    return doubts


def _explanation_doubts(found: Diagnosis, log: ReadingLog, problem: Problem) -> list[Doubt]:
    """Doubt about an input error that explains the log, if there is one; otherwise doubts about possible explanations."""
    fit_log = problem.log
    doubts = []
    better: list[Diagnosis] = []
    residual_share = misfit(fit_log, found.fit, found.kept)
    is_misfit = residual_share > MIN_MISFIT
    if is_misfit and turns_may_help(fit_log, found.fit, found.kept):
        better = [explanation for explanation in others(found.sign, problem) if explanation.improves(found.fit)]
    if is_misfit or free_bias(found, problem) is not None:
        reference = better[0] if better else found
        mistake = _input_mistake(found, problem, reference)
        if mistake:
            return [mistake]
        residual = f"the residual is {_noise(found)}, {percent(residual_share, 2)} of the change of forces"
        force_noise = None  # noise of the forces without the poses; None if these are not in doubt
        if better:
            doubts.append(doubt("sensor-sign", left=residual, ways=_remedy(better, found, log)))
        elif seems_moving(log):
            doubts.append(doubt("sensor-moving", evidence=f"Poses do not explain the readings: {residual}"))
        else:
            force_noise = unexplained_turns(fit_log, found)
        if force_noise is not None and not _drifts(found, problem):
            doubts.append(_doubt_on_poses(found, force_noise))
    if log.V is not None and not found.fit.unknowns.inertia:
        with_inertia = explain(found.sign, problem.with_unknowns(inertia=True))
        if with_inertia is not None and with_inertia.improves(found.fit):
            doubts.append(doubt("sensor-inertia", before=_noise(found), after=_noise(with_inertia)))
    if found.turn and not doubts and is_planar(fit_log, found.fit, found.kept, found.mass):
        other_sign: Sign = "by_sensor" if found.sign == "on_sensor" else "on_sensor"
        with_other_sign = explain(other_sign, problem)
        if with_other_sign is None or not with_other_sign.mass > 0:
            return doubts
        if with_other_sign.equals(found.fit, found.kept):
            noise = _noise(with_other_sign)
            doubts.append(doubt("sensor-sign-or-mounting", options=with_other_sign.options, noise=noise))
    return doubts


def _drifts(found: Diagnosis, problem: Problem) -> bool:
    """True if drift of the bias, with time or in the order of the log, explains the residuals ascribed to the poses."""
    if found.fit.unknowns.drift:
        return False
    with_drift = explain(found.sign, problem.with_unknowns(drift=True))
    if with_drift is None or not with_drift.improves(found.fit):
        return False
    return offers_drift(problem, found.fit, found.kept)


def _noise(found: Diagnosis) -> str:
    """Text of the residual noise of forces and moments."""
    moment, force = found.noise
    return f"noise of {number(force, 2)} N and {number(moment, 2)} N m"
