"""Identification of a sensor's load from a log: bias, mass, centre of mass, inertia, mounting, and the test of acceptance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.inertia import SpatialInertia
from ..core import arguments
from ..core.numbers import number, percent, plus_minus, seconds
from ..core.verdict import Verdict
from ..errors import ShapeError, ValueRangeError
from ..estimation.covariance import Whiteness
from ..lie.labelled import WRENCH
from ..log_checks.reading_doubts import (
    MAY_MOVE,
    MAY_POINT_UP,
    in_a_plane,
    listed_bias,
    may_point_up,
    misfit,
    seems_moving,
    turns_may_help,
    unexplained_turns,
    unit_doubt,
)
from ..typing import Array
from .contact_detection import six_noises
from .fit import Fit, Problem, SensorState, Unknowns, few, fit
from .log import ReadingLog, checked_log
from .outliers import (
    Diagnosis,
    as_good_as_the_best,
    explain,
    free_bias,
    guessed,
    least_rows,
    others,
    runs,
    static_poses,
    swapped,
    touched_in_static_poses,
    trimmed,
    upside_down,
)
from .poses import advice, blind_spots
from .result import Identification, mass_interval, weakness
from .sensor import ForceTorqueSensor, Sign, sign_factor

_SURE = 1e-4  # chance that an unknown which is none is offered
_LEAST = 4.0  # degrees of freedom that are to be left
_NEARLY = 0.8  # of the most that any explains, from which the one of fewest columns is preferred
_GAIN = 0.05  # of the load's wrench, from which a gain or cross-talk is told from poses that are off by a degree or two
_OPTIONS = {"drift": "drift=True", "delay": "delay=True", "turn": "orientation=True", "tilt": "tilt=True"}


@dataclass(frozen=True)
class Offer:
    """Further unknown that explains the residuals surely better."""

    kind: str  # drift, delay, turn, tilt, or gain
    share: float  # share of the squared residuals, in units of the noise, that it explains
    said: str  # name and size of the unknown, in words

    def __str__(self) -> str:
        what = f"{self.said} would explain {percent(self.share)} of what is left (squares over noise)"
        if self.kind != "gain":
            return f"{what}: ask for {_OPTIONS[self.kind]}."
        return (
            f"{what}: readings are linear in the load's wrench, but not equal to it. Check the sensor's calibration matrix and "
            "its scale."
        )


def fit_unless_drift(problem: Problem, found: Fit, kept: Array) -> tuple[Fit, Array]:
    """The fit and its kept rows (n,), or those with rows that only contradict the others because the bias drifts."""
    drifts = problem.with_unknowns(drift=True)
    if kept.all() or problem.unknowns.drift or len(kept) <= least_rows(drifts):
        return found, kept
    if blind_spots(drifts.log, drifts.unknowns, drifts.factor):
        return found, kept
    _, more = trimmed(drifts)
    if more.sum() <= kept.sum():
        return found, kept
    again = fit(replace(problem, state=found.state), keep=more)
    drift = any(offer.kind == "drift" for offer in offers(problem, again, more))
    return (again, more) if drift else (found, kept)


def offers(problem: Problem, fit: Fit, kept: Array) -> list[Offer]:
    """Unknowns that would explain the residuals of the kept rows (n,), the best first, each beside those before it.

    Each adds columns E to the whitened design. With P the part of E orthogonal to it and to those before, of rank r,
    F = ((|e|² - |e'|²) / r) / (|e'|² / (ν - r)), e' = e - P P'e, with ν the degrees of freedom of the residuals e.
    Drift and gain have columns of their own for each channel, and F is that of the channel where it is rarest, times six:
    a channel's variance is estimated, so an error of one channel alone hides in it. Among those rarer than 1e-4 the one of
    fewest columns is taken that explains nearly as much as any.
    """
    scale = fit.deviation[kept]
    e = (fit.residuals[kept] / scale).ravel()

    def flat(columns: Array) -> Array:
        x = (columns[kept] / scale[..., None]).reshape(e.size, -1)
        size = np.linalg.norm(x, axis=0)
        return np.asarray(x[:, size > 0] / size[size > 0])

    basis = _orthonormal(flat(fit.design), np.zeros((e.size, 0)))
    columns = _candidates(problem, fit)
    candidates = {kind: flat(of_kind) for kind, of_kind in columns.items()}
    found: list[Offer] = []
    e = e - basis @ (basis.T @ e)
    total = float(e @ e)
    while candidates and float(e @ e) > 1e-20 * max(total, 1e-300):
        sure = {}
        for kind, E in candidates.items():
            if _chance(kind, E, e, basis) < _SURE:
                P = _orthonormal(E, basis)
                sure[kind] = (P, float(((P.T @ e) ** 2).sum()))
        if not sure:
            break
        most = max(gain for _, gain in sure.values())
        kind = min((k for k in sure if sure[k][1] >= _NEARLY * most), key=lambda k: sure[k][0].shape[1])
        P, gain = sure[kind]
        candidates.pop(kind)
        said = _offered(kind, columns[kind], fit, kept, (P @ (P.T @ e)).reshape(-1, 6) * scale)
        if said is not None:
            found.append(Offer(kind, gain / total, said))
        e = e - P @ (P.T @ e)
        basis = np.concatenate([basis, P], axis=1)
    return found


def _chance(kind: str, E: Array, e: Array, basis: Array) -> float:
    """Probability that noise alone is explained as well by the columns E (N, k)."""
    from scipy import special

    channel = np.arange(e.size) % 6
    own = [channel == c for c in range(6)] if kind in ("drift", "gain") else [np.ones(e.size, bool)]
    least = 1.0
    for rows in own:
        P = _orthonormal(E[:, E[rows].any(axis=0)], basis)
        r, free = P.shape[1], float(rows.sum() - (basis[rows] ** 2).sum()) - P.shape[1]
        before, after = (float((x[rows] ** 2).sum()) for x in (e, e - P @ (P.T @ e)))
        if r and free >= _LEAST:
            F = (before - after) / r / max(after / free, 1e-12 * before, 1e-300)
            least = min(least, len(own) * float(special.fdtrc(r, free, F)))
    return least


def _orthonormal(E: Array, basis: Array) -> Array:
    """Orthonormal columns of what E (N, k) has beside those of the basis (N, p); what is rounding is none."""
    E = E - basis @ (basis.T @ E)
    E = E - basis @ (basis.T @ E)
    U, values, _ = np.linalg.svd(E, full_matrices=False)
    return np.asarray(U[:, values > 1e-6])


def _candidates(problem: Problem, fit: Fit) -> dict[str, Array]:
    """Columns (n, 6, k) of each further unknown that is possible; of a gain, each channel with a share of each of the loads."""
    log = problem.log
    state = SensorState(fit.mounting, fit.state.tilt, fit.state.delay, fit.load, fit.state.middle)
    possible = {"turn": True, "drift": True, "tilt": log.rotations is not None}
    possible["delay"] = log.V is not None and problem.timed
    found = {}
    for kind, can in possible.items():
        if can and not getattr(fit.unknowns, kind):
            more = problem.with_unknowns(**{kind: True}).unknowns
            found[kind] = more.design(log, problem.factor, state)[..., more.part(kind)]
    found["gain"] = np.einsum("nk,cd->ncdk", _loads(fit), np.eye(6)).reshape(len(log), 6, 36)
    return found


def _loads(fit: Fit) -> Array:
    """(n, 6) what the load does to the readings."""
    part = fit.unknowns.load
    return np.asarray(fit.design[..., part] @ fit.estimate[part])


def _offered(kind: str, columns: Array, fit: Fit, kept: Array, explained: Array) -> str | None:
    """Name and size of an unknown, from the part (n, 6) of the residuals that it explains; None if it is negligible."""
    if kind == "drift":
        return f"A bias that drifts, by {listed_bias(explained[-1] - explained[0])} [N m, N] over the log,"
    if kind == "gain":
        load = _loads(fit)[kept]
        rms = [np.sqrt(((x - x.mean(axis=0)).reshape(-1, 2, 3) ** 2).mean(axis=(0, 2))) for x in (explained, load)]
        share = float((rms[0] / np.maximum(rms[1], 1e-12)).max())
        return (
            f"A gain or cross-talk that is off by {percent(share, 2)} of the load's wrench" if share > _GAIN else None
        )
    scale, k = fit.deviation[kept], columns.shape[-1]
    A = np.concatenate([columns[kept], fit.design[kept]], axis=-1) / scale[..., None]
    x = np.linalg.lstsq(A.reshape(6 * len(scale), -1), (fit.residuals[kept] / scale).ravel(), rcond=None)[0][:k]
    if kind == "delay":
        return f"Readings about {number(1e3 * float(x[0]), 2)} ms late"
    what = "A mounting turned" if kind == "turn" else "A base tilted"
    return f"{what} by about {number(math.degrees(float(np.linalg.norm(x))), 2)}°"


# ── Acceptance test: the sensor of a fit, remarks and doubts

_MISFIT = 1.5  # residuals this many times the noise given are not that noise
_UNEXPLAINED = 0.05  # of the change of forces, from which what is left may be more than noise
_ORIENTATIONS, _FREEDOM = 10, 6  # that determine the noise, of each channel; with fewer, intervals are too narrow


@dataclass(frozen=True, eq=False)
class UsedReadings:
    """Use of the readings of a log: left out, between static poses, or explained."""

    left_out: Array  # (N,) readings that the others contradict
    between: Array  # (N,) readings between dwells
    orientation: Array  # (n,) label of the orientation of each row of the fit
    whiteness: Whiteness | None  # whiteness of the residuals; None for too few rows


def acceptance_test(
    found: Diagnosis, confidence: float, problem: Problem, log: ReadingLog, use: UsedReadings
) -> Identification:
    """Result with its remarks and doubts; raises if the mass is negative. ``problem`` is that of the fit."""
    fit, unknowns = found.fit, found.fit.unknowns
    deviation = math.sqrt(fit.covariance[unknowns.load.start, unknowns.load.start])
    if found.mass < -2 * deviation or found.mass == 0:
        raise ValueRangeError(_no_mass(found, log, problem))
    low, high = mass_interval(fit, confidence)
    told = low > 0
    load = SpatialInertia.zero()
    if found.mass > 0:  # else by noise alone: nothing hangs on the sensor
        load = SpatialInertia.from_parameters(fit.load)
        if not unknowns.inertia and told:  # at least the moments of a point mass there
            load = SpatialInertia.from_com(found.mass, load.com)
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
    unsure += _cluster_doubts(found, problem, use)
    weak = (
        weakness(fit, sensor, confidence) if told and not doubts else None
    )  # more readings of the wrong kind help nobody
    verdict = Verdict.from_reasons(look_again=[*again, *doubts], unsure=unsure)
    remarks = [*again, *remarks, *([weak] if weak else []), *unsure]
    kept = ~use.left_out & ~use.between
    return Identification(
        sensor, fit, found.kept, kept, confidence, tuple(remarks), tuple(doubts), verdict, use.left_out
    )


def _cluster_doubts(found: Diagnosis, problem: Problem, use: UsedReadings) -> list[str]:
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
    free = free_bias(found, problem)
    exchanged = swapped(problem, free or than)
    if free is not None and exchanged is None:
        return (
            f"The bias given does not fit: left free, it comes out as {listed_bias(free.fit.estimate[:6])} [N m, N], and what "
            f"is left goes from {_noise(found)} to {_noise(free)}. Give no bias, or that of today."
        )
    if exchanged is not None:
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
    """Doubts about a noise that was given."""
    if not np.isinf(found.fit.freedom).all():
        return []
    scaled = (found.fit.residuals / found.fit.deviation)[found.kept].reshape(-1, 2, 3)
    return [
        f"What is left of the {what} is {number(times, 2)} times the noise given: the intervals are too narrow. "
        "Let the noise be estimated, or check poses and sign."
        for what, times in zip(("moments", "forces"), np.sqrt((scaled**2).mean(axis=(0, 2))).tolist(), strict=True)
        if times > _MISFIT
    ]


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
        whole = explain(found.sign, problem.with_unknowns(inertia=True))
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
    steady = explain(found.sign, problem.with_unknowns(drift=True))
    if steady is None or not steady.improves(found.fit):
        return False
    return any(offer.kind == "drift" for offer in offers(problem, found.fit, found.kept))


def _noise(found: Diagnosis) -> str:
    left = found.fit.residuals[found.kept].reshape(-1, 2, 3)
    freedom = max(3 * len(left) - len(found.fit.unknowns.names) / 2, 1.0)
    moment, force = np.sqrt((left**2).sum(axis=(0, 2)) / freedom)
    return f"noise of {number(force, 2)} N and {number(moment, 2)} N m"


# ── Identification

_IN_ORDER = 8  # rows from which their order says anything


def identify(
    log: ReadingLog,
    *,
    sign: Sign = "on_sensor",
    inertia: bool = False,
    orientation: bool = False,
    drift: bool = False,
    delay: bool = False,
    tilt: bool = False,
    bias: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    outliers: str = "trim",
    confidence: float = 0.95,
) -> Identification:
    """Force-torque sensor identification: its bias and its load's mass and centre of mass, from readings in different poses.

    Parameters
    ----------
    log : ReadingLog
    sign : "on_sensor" or "by_sensor", whose wrench the readings are
    inertia : bool, also the six inertia numbers (the log must have V and dV, in lively motion)
    orientation : bool, also the rotation of the sensor's axes against {f}
    drift : bool, also a linear change of the bias, which is then that of the middle of the log
    delay : bool, also the time by which readings are late
    tilt : bool, also a turn of gravity about two level axes of {w}
    bias : (6,) array_like, optional, known, not looked for [N m, N]
    noise : (moment [N m], force [N]), optional, known standard deviations in place of the fit's own
    outliers : "trim" leaves out and lists readings that the others contradict, "keep" trusts all
    confidence : float, of intervals and regions, 0 to 1

    Returns
    -------
    found : Identification
        Doubts of units, sign, mounting, bias and poses are in it.

    Raises
    ------
    ValueRangeError
        The log does not determine the unknowns, naming the combinations that do not change any reading, or mass
        comes out negative.

    Notes
    -----
    Without ``inertia`` the sensor found has a load whose inertia is ``unknown``: it compensates forces in motion, not
    moments. Source: least squares of F = Y π, Modern Robotics eq. 8.40.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> from twistwrench.sensing import ForceTorqueSensor, simulate
    >>> tool = ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)), bias=[0, 0, 0, 5, 0, 0])
    >>> found = identify(simulate(tool, 12, noise=(0.0, 0.0)))
    >>> round(found.sensor.load.mass, 6), round(float(found.sensor.load.com[2]), 6)
    (3.0, 0.1)
    """
    log, factor = checked_log(log, "identify"), sign_factor(sign)
    asked = {"inertia": inertia, "orientation": orientation, "drift": drift, "tilt": tilt, "delay": delay}
    unknowns = Unknowns(bias is None, *(arguments.flag(x, what) for what, x in asked.items()))
    known_bias, known_noise = _checked(bias, noise, outliers, confidence)
    _check_log(log, unknowns)
    used = np.ones(len(log), bool)
    poses = static_poses(log)
    if outliers == "trim" and (touched := touched_in_static_poses(log, poses)).any():
        used = ~touched
        poses = static_poses(log.rows(used))
    problem = Problem(
        poses.log,
        unknowns,
        factor,
        known_bias,
        known_noise,
        poses.count,
        poses.within,
        poses.within_freedom,
        poses.label,
        log.time is not None,
    )
    if blind := blind_spots(log.rows(used), unknowns, factor):
        raise ValueRangeError(f"{log.name}: {' '.join(blind[:3])} {advice(log, unknowns)}")
    problem = guessed(problem)
    kept = np.ones(len(poses.log), bool)
    if outliers == "trim" and len(poses.log) > least_rows(problem):
        found, kept = fit_unless_drift(problem, *trimmed(problem))
    else:
        found = fit(problem, keep=kept)
    label = problem.label
    white = whiteness(found, kept, label)
    again = len(np.unique(problem.label)) < len(kept)
    if white is not None and white.length > 1 and not again:  # neighbours that hang together are one cluster
        problem = replace(problem, label=np.arange(len(kept)) // white.length, state=found.state)
        found = fit(problem, keep=kept)
    left_out, between = ~used, np.zeros(len(log), bool)
    between[used] = poses.row < 0
    left_out[used] = ~poses.spread(kept) & ~between[used]
    return acceptance_test(
        Diagnosis(sign, found, kept), confidence, problem, log, UsedReadings(left_out, between, label, white)
    )


def whiteness(fit: Fit, kept: Array, label: Array) -> Whiteness | None:
    """Test of the residuals of the kept rows (n,), in the order of the log; None of rows too few.

    Of rows with one label (n,), an orientation that was visited again, the mean is taken off: they share their pose error.
    """
    e = (fit.residuals / fit.deviation)[kept]
    place, count = np.unique(label[kept], return_inverse=True, return_counts=True)[1:]
    total = np.zeros((len(count), 6))
    np.add.at(total, place, e)
    e = e - np.where(count[:, None] > 1, total / count[:, None], 0.0)[place]
    if len(e) < _IN_ORDER:
        return None
    A = (fit.design / fit.deviation[..., None])[kept].reshape(e.size, -1)
    size = np.abs(A).max(axis=0)
    Q = np.linalg.qr(A / np.where(size > 0, size, 1.0))[0]
    return Whiteness.from_residuals(e, Q.reshape(len(e), 6, -1), WRENCH)


def _check_log(log: ReadingLog, unknowns: Unknowns) -> None:
    if unknowns.inertia and log.V is None:
        raise ValueRangeError(
            f"{log.name}: inertia shows only in motion, and the log has none. Give V and dV (columns wx, wy, wz, vx, vy, "
            "vz, dwx, …, dvz), or ask for no inertia."
        )
    if unknowns.delay and (log.V is None or log.time is None):
        raise ValueRangeError(
            f"{log.name}: a delay shows only in motion, and the log has no {'time' if log.time is None else 'motion'}. Give "
            "time, V and dV, or ask for no delay."
        )
    if unknowns.tilt and log.rotations is None:
        raise ValueRangeError(
            f"{log.name}: the log has gravity in the sensor's frame, so a tilt of the base has no part in it. Give "
            "orientations, or ask for no tilt."
        )
    least = max(3, math.ceil((len(unknowns.names) + 2) / 6) + unknowns.turn)
    if len(log) < least:
        count, wanted = len(log), len(unknowns.names)
        raise ValueRangeError(
            f"{log.name}: {count} reading{'s' * (count > 1)}, and {wanted} unknowns need at least {least} in different "
            "orientations. Add readings; `poses` proposes some."
        )


def _checked(
    bias: ArrayLike | None, noise: ArrayLike | None, outliers: str, confidence: float
) -> tuple[Array, Array | None]:
    known_bias = np.zeros(6) if bias is None else np.asarray(arguments.real(bias, "bias"), float)
    if known_bias.shape != (6,):
        raise ShapeError(f"bias has shape {known_bias.shape}, expected (6,): mx, my, mz, fx, fy, fz.")
    if not np.isfinite(known_bias).all():
        raise ValueRangeError(f"bias {known_bias.tolist()} has a value that is not a finite number.")
    known = None if noise is None else six_noises(noise)
    arguments.choice(outliers, "outliers", ("trim", "keep"))
    if not 0 < arguments.number(confidence, "confidence") < 1:
        raise ValueRangeError(f"confidence {confidence!r} is not between 0 and 1. Give 0.95 for 95 %.")
    return known_bias, known
