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
from .sensor import ForceTorqueSensor, Inertia
from .static_poses import runs

_MISTAKES = ("sensor-exchanged", "sensor-known-bias", "sensor-gravity-up")  # swapped columns or a wrong bias, not units
_MAY_POINT_UP = (
    "Or gx, gy, gz point up, as an accelerometer at rest logs them, which explains the log as well: "
    "then negate these three and keep the sign."
)
MAX_NOISE_RATIO = 1.5  # residual over given noise above which the noise is doubtful
MIN_ORIENTATIONS, MIN_CHANNEL_FREEDOM = (
    10,
    6,
)  # orientations, and degrees of freedom per channel, for reliable intervals
MIN_MISFIT = 0.05  # fraction of the change of forces above which residuals may be more than noise


@dataclass(frozen=True, eq=False)
class UsedReadings:
    """Classification of the readings of a log: outliers, between static poses, or used in the fit."""

    left_out: Array  # (N,) outliers
    between: Array  # (N,) readings between dwells
    orientation: Array  # (n,) label of the orientation of each row of the fit
    whiteness: Whiteness | None  # whiteness of the residuals; None for too few rows


def acceptance_test(
    found: Diagnosis, confidence: float, problem: Problem, log: ReadingLog, use: UsedReadings
) -> Identification:
    """Build the result with its doubts; raise if the mass is negative. ``problem`` is that of the fit."""
    fit, unknowns = found.fit, found.fit.unknowns
    low, high = fit.interval("mass", confidence)
    if found.mass < -2 * fit.mass_deviation or found.mass == 0:
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
        mass = f"{plus_minus(found.mass, (high - low) / 2, 'kg')} ({percent(confidence, 3)})"
        doubts.append(doubt("sensor-mass", mass=mass))
    elif load.defects():
        doubts.append(doubt("sensor-inertia-invalid", defects="; ".join(load.defects())))
    causes = _noise_doubts(found) + _explanation_doubts(found, log, problem)
    if has_mass and not causes:
        causes += offers(problem, fit, found.kept)
    kinds = {cause.kind for cause in causes}
    if kinds.isdisjoint(_MISTAKES):
        unit = None
        if has_mass and "sensor-gain" not in kinds:
            unit = unit_doubt(found, sensor, problem.log)
        causes += _size_doubts(log, unit)
    kept = ~use.left_out & ~use.between
    result = Identification(sensor, fit, found.kept, kept, confidence, log, left_out=use.left_out)
    weak = []
    if has_mass and not any(cause.refuses for cause in causes):
        weak = weakness(result)
    return replace(result, doubts=(*doubts, *causes, *weak, *_cluster_doubts(found, problem, use)))


def _size_doubts(log: ReadingLog, unit: Doubt | None) -> list[Doubt]:
    """Doubts about the units of the motion; otherwise that about the unit of the readings, or about their sizes."""
    motion_doubts = log.motion_doubts()
    if motion_doubts:
        return motion_doubts
    return [unit] if unit else log.size_doubts()


def _log_doubts(log: ReadingLog, use: UsedReadings) -> list[Doubt]:
    """Doubts about outliers and about readings between dwells."""
    doubts = []
    outliers, between = int(use.left_out.sum()), int(use.between.sum())
    if outliers:
        spans = [_span(log, first, last) for first, last in runs(use.left_out)]
        listed = ", ".join(spans[:10])
        if len(spans) > 10:
            listed += ", …"
        if log.time is None:
            listed += " (from 0)"
        doubts.append(doubt("sensor-outliers", count=outliers, total=len(log), listed=listed))
    if between:
        doubts.append(doubt("sensor-between-dwells", count=between))
    return doubts


def _cluster_doubts(found: Diagnosis, problem: Problem, use: UsedReadings) -> list[Doubt]:
    """Doubts about intervals that may be too narrow."""
    doubts = []
    label = use.orientation[found.kept]
    count = len(np.unique(label))
    # Readings of a revisited orientation share its error.
    freedom = (1.0 - found.fit.leverage[found.kept]).sum(axis=0) - (len(label) - count)
    wanted = max(MIN_ORIENTATIONS - count, math.ceil(MIN_CHANNEL_FREEDOM - freedom.min() - 1e-9))
    if problem.noise is None and wanted > 0:
        alike = ", and it is taken to be alike in the three forces and in the three moments" if few(label) else ""
        details: dict[str, Any] = {
            "orientations": MIN_ORIENTATIONS,
            "count": count,
            "axis": WRENCH[int(freedom.argmin())],
            "wanted": wanted,
            "alike": alike,
            "freedom": number(max(freedom.min(), 0.0), 2),
            "least": MIN_CHANNEL_FREEDOM,
        }
        doubts.append(doubt("sensor-few-orientations", **details))
    white = use.whiteness
    if white is not None and not white.white:
        rare, lag1 = number(1 / max(white.chance, 1e-12), 2), number(white.lag1, 2)
        lagged: dict[str, Any] = {"test": white.test, "length": white.length, "found": {"value": white.lag1}}
        doubts.append(doubt("sensor-correlated", axis=white.axis, lag1=lag1, rare=rare, **lagged))
    return doubts


def _span(log: ReadingLog, first: int, last: int) -> str:
    """Times or indices of a run of readings."""
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"{first}" if first == last else f"{first}–{last}"


def _no_mass(found: Diagnosis, log: ReadingLog, problem: Problem) -> str:
    """Message for a negative mass: evidence and most likely cause."""
    evidence = f"mass comes out as {number(found.mass)} kg"
    better = others(found.sign, problem)
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
    """Arguments that fit the log better, with their residual."""
    best, *equal = indistinguishable_from_the_best(better)
    remedy = f"Use {' or '.join(e.options for e in (best, *equal))}: the residual is then {_noise(best)}."
    if equal:
        remedy += " These cannot be distinguished: check the sign, or add readings tilted about another axis."
    if log.by_gravity and log.V is None and best.sign != found.sign:
        remedy += f" {_MAY_POINT_UP}"
    return remedy


def _input_mistake(found: Diagnosis, problem: Problem, reference: Diagnosis) -> Doubt | None:
    """Swapped columns, wrong bias or gravity if they fit significantly better than the reference; None if not found."""
    free = free_bias(found, problem)
    exchanged = swap_forces_and_moments(problem, free or reference)
    if exchanged is not None:
        return doubt("sensor-exchanged", sign=Argument("sign", exchanged.sign), noise=_noise(exchanged))
    if free is not None:
        bias = listed_bias(free.fit.estimate[:6])
        return doubt("sensor-known-bias", bias=bias, before=_noise(found), after=_noise(free))
    upright = upside_down(found, problem, reference)
    if upright is None:
        return None
    return doubt("sensor-gravity-up", noise=_noise(upright))


def _noise_doubts(found: Diagnosis) -> list[Doubt]:
    """Doubts about a given noise."""
    if not np.isinf(found.fit.freedom).all():
        return []
    scaled = (found.fit.residuals / found.fit.deviation)[found.kept].reshape(-1, 2, 3)
    doubts = []
    for what, ratio in zip(("moments", "forces"), np.sqrt((scaled**2).mean(axis=(0, 2))).tolist(), strict=True):
        if ratio > MAX_NOISE_RATIO:
            doubts.append(doubt("sensor-noise", what=what, times=number(ratio, 2)))
    return doubts


def _explanation_doubts(found: Diagnosis, log: ReadingLog, problem: Problem) -> list[Doubt]:
    """Input error that explains the log, if any; otherwise the possible explanations."""
    rows, doubts = problem.log, []
    better: list[Diagnosis] = []
    share = misfit(rows, found.fit, found.kept)
    unexplained = share > MIN_MISFIT
    if unexplained and turns_may_help(rows, found.fit, found.kept):
        better = [e for e in others(found.sign, problem) if e.improves(found.fit)]
    if unexplained or free_bias(found, problem) is not None:
        mistake = _input_mistake(found, problem, better[0] if better else found)
        if mistake:
            return [mistake]
        residual = f"the residual is {_noise(found)}, {percent(share, 2)} of the change of forces"
        force_noise = None
        if better:
            doubts.append(doubt("sensor-sign", left=residual, ways=_remedy(better, found, log)))
        elif seems_moving(log):
            doubts.append(doubt("sensor-moving", evidence=f"Poses do not explain the readings: {residual}"))
        else:
            force_noise = unexplained_turns(rows, found)
        if force_noise is not None and not _drifts(found, problem):
            doubts.append(_doubt_on_poses(found, force_noise))
    if log.V is not None and not found.fit.unknowns.inertia:
        with_inertia = explain(found.sign, problem.with_unknowns(inertia=True))
        if with_inertia is not None and with_inertia.improves(found.fit):
            doubts.append(doubt("sensor-inertia", before=_noise(found), after=_noise(with_inertia)))
    if found.turn and not doubts and is_planar(rows, found.fit, found.kept, found.mass):
        other = explain("by_sensor" if found.sign == "on_sensor" else "on_sensor", problem)
        if other is not None and other.mass > 0 and other.equals(found.fit, found.kept):
            doubts.append(doubt("sensor-sign-or-mounting", options=other.options, noise=_noise(other)))
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
    """Residual noise of forces and moments, as text."""
    moment, force = found.noise
    return f"noise of {number(force, 2)} N and {number(moment, 2)} N m"
