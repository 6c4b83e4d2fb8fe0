"""What to make of a fit: the sensor it gives, what a person should know of it, and whether the log can mean what it says."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.printed_numbers import number, percent, plus_minus, seconds
from ..errors import ValueRangeError
from ..screws.component_names import WRENCH
from ..typing import Array
from ..verdict import Verdict
from .fit import Problem, few
from .identified import Identification, mass_interval, weakness
from .log import ReadingLog
from .log_mistakes import (
    MAY_MOVE,
    MAY_POINT_UP,
    free_bias,
    listed_bias,
    may_point_up,
    seems_moving,
    swapped,
    upside_down,
)
from .outliers import runs
from .sensor import ForceTorqueSensor
from .sensor_units import unit_doubt
from .sign_and_mounting import (
    Diagnosis,
    as_good_as_the_best,
    explain,
    in_a_plane,
    misfit,
    others,
    turns_may_help,
    unexplained_turns,
)
from .suggested_unknowns import offers
from .whiteness import Whiteness

_MISFIT = 1.5  # residuals this many times the noise given are not that noise
_UNEXPLAINED = 0.05  # of the change of forces, from which what is left may be more than noise
_ORIENTATIONS, _FREEDOM = 10, 6  # that determine the noise, of each channel; with fewer, intervals are too narrow


@dataclass(frozen=True, eq=False)
class Use:
    """What was made of the readings of a log."""

    left_out: Array
    """(N,) readings that the others contradict."""
    between: Array
    """(N,) readings between dwells."""
    orientation: Array
    """(n,) label of the orientation of each row that the fit was asked to explain."""
    whiteness: Whiteness | None
    """Of what is left; None of rows too few."""


def judged(found: Diagnosis, confidence: float, problem: Problem, log: ReadingLog, use: Use) -> Identification:
    """The result with its remarks and doubts; an error if the mass is negative. ``problem`` is what the fit was asked."""
    fit, unknowns = found.fit, found.fit.unknowns
    deviation = math.sqrt(fit.covariance[unknowns.load.start, unknowns.load.start])
    if found.mass < -2 * deviation or found.mass == 0:
        raise ValueRangeError(_no_mass(found, log, problem))
    low, high = mass_interval(fit, confidence)
    told = low > 0
    load = _load(found, told=told)
    sensor = ForceTorqueSensor(
        load,
        fit.estimate[:6] if unknowns.bias else problem.bias,
        found.sign,
        fit.mounting,
        inertia="unknown" if not unknowns.inertia else "accept" if load.defects() else "given",
    )
    again, remarks = [], []
    if not told:
        again.append(
            f"The mass, {plus_minus(found.mass, (high - low) / 2, 'kg')} ({percent(confidence, 3)}), cannot be told from "
            "zero, so neither can its place."
        )
    elif defects := sensor.load.defects():
        again.append(
            f"The load cannot be a real body ({'; '.join(defects)}): noise is larger than what the motion shows. "
            "sensor.load.nearest_consistent() is the nearest that can; livelier motion tells more."
        )
    counted = " (from 0)" if log.time is None else ""
    if out := np.flatnonzero(use.left_out).tolist():
        spans = [_span(log, a, b) for a, b in runs(use.left_out)]
        listed = ", ".join(spans[:10]) + (", …" if len(spans) > 10 else "")
        again.append(f"Left out {len(out)} of {len(log)} readings that the others contradict: {listed}{counted}.")
    if use.between.any():
        remarks.append(f"{int(use.between.sum())} readings between dwells, where orientations change, are not used.")
    slip, doubted = _explanation_doubts(found, log, problem)
    doubts = _noise_doubts(found) + doubted + ([slip] if slip else [])
    offered = offers(problem, fit, found.kept) if told and not doubts else []
    gains = [str(offer) for offer in offered if offer.kind == "gain"]
    unsure = [str(offer) for offer in offered if offer.kind != "gain"]
    units = unit_doubt(found, sensor, problem.log) if told and not gains and not log.motion_doubts() else None
    doubts += gains + (log.motion_doubts() or ([units] if units else log.size_doubts()) if not slip else [])
    unsure += _witness_doubts(found, problem, use)
    weak = (
        weakness(fit, sensor, confidence) if told and not doubts else None
    )  # more readings of the wrong kind help nobody
    verdict = Verdict.of(look_again=[*again, *doubts], unsure=unsure)
    remarks = [*again, *remarks, *([weak] if weak else []), *unsure]
    kept = ~use.left_out & ~use.between
    return Identification(
        sensor, fit, found.kept, kept, confidence, tuple(remarks), tuple(doubts), verdict, use.left_out
    )


def _witness_doubts(found: Diagnosis, problem: Problem, use: Use) -> list[str]:
    """Why the intervals may be too narrow."""
    doubts = []
    label = use.orientation[found.kept]
    count = len(np.unique(label))
    # Readings of an orientation that is visited again share its error.
    left = (1.0 - found.fit.leverage[found.kept]).sum(axis=0) - (len(label) - count)
    wanted = max(_ORIENTATIONS - count, math.ceil(_FREEDOM - left.min() - 1e-9))
    if problem.noise is None and wanted > 0:
        alike = ", and it is taken to be alike in the three forces and in the three moments" if few(label) else ""
        doubts.append(
            f"{count} orientations are too few to determine the noise: {WRENCH[int(left.argmin())]} is left with "
            f"{number(max(left.min(), 0.0), 2)} degrees of freedom{alike}. The intervals may be too narrow. "
            f"Add {wanted} or more orientations ({_ORIENTATIONS} at least, and {_FREEDOM} degrees of freedom of each channel), "
            "or give the noise."
        )
    white = use.whiteness
    if white is not None and not white.white:
        doubts.append(
            f"What is left is not white in the order of the log: {white.axis} has a lag-1 autocorrelation of "
            f"{number(white.lag1, 2)} "
            f"({white.test}; white noise has as much in one log of {number(1 / max(white.chance, 1e-12), 2)}). The intervals "
            f"count {white.length} rows in a row as one witness, and may still be too narrow."
        )
    return doubts


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"{first}" if first == last else f"{first}–{last}"


def _load(found: Diagnosis, *, told: bool) -> SpatialInertia:
    if found.mass <= 0:  # by noise alone: nothing hangs on the sensor
        return SpatialInertia.zero()
    load = SpatialInertia.from_parameters(found.fit.load)
    if not found.fit.unknowns.inertia and told:  # at least the moments of a point mass there
        return SpatialInertia.from_com(found.mass, load.com)
    return load


def _no_mass(found: Diagnosis, log: ReadingLog, problem: Problem) -> str:
    said = f"{log.name}: mass comes out as {number(found.mass)} kg"
    if slip := _slip(found, problem, found):
        return f"{said}. {slip}"
    better = others(found.sign, problem)
    if better and (slip := _slip(found, problem, better[0])):
        return f"{said}. {slip}"
    if seems_moving(log):
        return f"{said}. {MAY_MOVE}"
    if not better:
        return f"{said}, with either sign. Check that the poses are of the sensor's frame and the readings of a load."
    if (own := unexplained_turns(problem.log, better[0].fit, better[0].kept)) is not None:
        return f"{said}: {_poses(better[0], own)}"
    return f"{said}, so sign or mounting are not as said. {_ways(better, found, log)}"


def _poses(found: Diagnosis, own: float) -> str:
    return (
        f"the poses do not explain the readings. Forces are left with {_noise(found)}, but their size alone has "
        f"{number(own, 2)} N. "
        "Are the orientations those of the sensor in the world, R_wf (not of the world in the sensor), the scalar of "
        "quaternions first, and read when the tool was still?"
    )


def _ways(better: list[Diagnosis], found: Diagnosis, log: ReadingLog) -> str:
    best, *same = as_good_as_the_best(better)
    said = f"Use {' or '.join(e.options for e in (best, *same))}: what is left is then {_noise(best)}."
    if same:
        said += " These cannot be told apart: make sure of the sign, or add readings tilted about another axis."
    return f"{said} {MAY_POINT_UP}" if may_point_up(log, found.sign, best) else said


def _slip(found: Diagnosis, problem: Problem, than: Diagnosis) -> str | None:
    """A slip that explains the log surely better ``than`` what there is."""
    if (free := free_bias(found, problem)) is not None:
        return (
            f"The bias given does not fit: left free, it comes out as {listed_bias(free.fit.estimate[:6])} [N m, N], and what "
            f"is left goes from {_noise(found)} to {_noise(free)}. Give no bias, or that of today."
        )
    if (exchanged := swapped(problem, than)) is not None:
        return (
            "Forces and moments seem swapped: with mx, my, mz and fx, fy, fz exchanged and "
            f"sign={exchanged.sign!r} what is left is {_noise(exchanged)}. Exchange the names of the columns."
        )
    if (upright := upside_down(found, problem, than)) is not None:
        return (
            f"gx, gy, gz seem to point up, as an accelerometer logs them: negated, what is left is {_noise(upright)}. Negate "
            "these three and keep the sign."
        )
    return None


def _noise_doubts(found: Diagnosis) -> list[str]:
    doubts = []
    scaled = (found.fit.residuals / found.fit.deviation)[found.kept]
    for what, part in (("moments", slice(0, 3)), ("forces", slice(3, 6))):
        times = float(np.sqrt(np.mean(scaled[:, part] ** 2)))
        if np.isinf(found.fit.freedom).all() and times > _MISFIT:
            doubts.append(
                f"What is left of the {what} is {number(times, 2)} times the noise given: the intervals are too narrow. "
                "Let the noise be estimated, or check poses and sign."
            )
    return doubts


def _explanation_doubts(found: Diagnosis, log: ReadingLog, problem: Problem) -> tuple[str | None, list[str]]:
    """A slip that explains the log, if there is one, else what may."""
    rows = problem.log
    share = misfit(rows, found.fit, found.kept)
    doubts: list[str] = []
    if free_bias(found, problem) is not None:
        return _slip(found, problem, found), []
    if share > _UNEXPLAINED:
        left = f"what is left is {_noise(found)}, {percent(share, 2)} of how forces change"
        tried = others(found.sign, problem) if turns_may_help(rows, found.fit, found.kept) else []
        better = [e for e in tried if e.improves(found.fit)]
        if slip := _slip(found, problem, better[0] if better else found):
            return slip, []
        if better:
            doubts.append(f"Poses, sign or mounting do not explain the readings: {left}. {_ways(better, found, log)}")
        elif seems_moving(log):
            doubts.append(f"Poses do not explain the readings: {left}. {MAY_MOVE}")
        elif (own := unexplained_turns(rows, found.fit, found.kept)) is not None and not _drifts(found, problem):
            doubts.append(f"Look at the poses: {_poses(found, own)}")
    if log.V is not None and not found.fit.unknowns.inertia:
        whole = explain(found.sign, problem.asked(inertia=True))
        if whole is not None and whole.improves(found.fit):
            doubts.append(
                f"The load's inertia shows in this motion, and the centre of mass is off without it: with inertia=True what "
                f"is left goes from {_noise(found)} to {_noise(whole)}."
            )
    if found.turn and not doubts and in_a_plane(rows, found.fit, found.kept, found.mass):
        other = explain("by_sensor" if found.sign == "on_sensor" else "on_sensor", problem)
        if other is not None and other.mass > 0 and other.equals(found.fit, found.kept):
            doubts.append(
                f"Sign and mounting cannot be told apart: {other.options} leaves {_noise(other)}, no more than this. Make "
                "sure of the sign, or add readings tilted about another axis."
            )
    return None, doubts


def _drifts(found: Diagnosis, problem: Problem) -> bool:
    """True if a bias that drifts with time, or in the order of the log, explains what the poses would be blamed for."""
    if found.fit.unknowns.drift:
        return False
    steady = explain(found.sign, problem.asked(drift=True))
    if steady is None or not steady.improves(found.fit):
        return False
    return any(offer.kind == "drift" for offer in offers(problem, found.fit, found.kept))


def _noise(found: Diagnosis) -> str:
    left = found.fit.residuals[found.kept].reshape(-1, 2, 3)
    freedom = max(3 * len(left) - len(found.fit.unknowns.names) / 2, 1.0)
    moment, force = np.sqrt((left**2).sum(axis=(0, 2)) / freedom)
    return f"noise of {number(force, 2)} N and {number(moment, 2)} N m"
