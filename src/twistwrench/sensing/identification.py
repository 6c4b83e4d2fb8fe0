"""Identification of a sensor's load from a log: bias, mass, centre of mass, inertia, mounting, and acceptance test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.doubts import Doubt, doubt
from ..core.errors import ValueRangeError
from ..core.estimation.covariance import Whiteness
from ..core.gravity import STRENGTH
from ..core.numbers import number, percent, plus_minus, seconds
from ..core.text import Argument
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie.labelled import WRENCH
from .contact_detection import six_noises
from .files import readings_of
from .fit import Fit, Problem, SensorState, Unknowns, few, fit
from .log import ReadingLog, ReadingsGiven
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
from .reading_doubts import (
    in_a_plane,
    largest_share,
    listed_bias,
    misfit,
    orthonormal,
    seems_moving,
    turns_may_help,
    unexplained_turns,
    unit_doubt,
)
from .result import Identification, weakness
from .sensor import ForceTorqueSensor, Inertia, Sign, sign_factor

_SURE = 1e-4  # significance level: probability of proposing a spurious unknown
_OF_ROWS = 0.1  # factor of the row-wise test, whose level is 1e-3: there are few rows
_LEAST = 4.0  # minimum number of residual degrees of freedom
_NEARLY = 0.8  # fraction of the largest reduction; among candidates above it, the one with fewest columns is chosen
_GAIN = 0.05  # of the load's wrench; smaller gains and cross-talk resemble pose errors of a degree or two


def fit_unless_drift(problem: Problem, found: Fit, kept: Array) -> tuple[Fit, Array]:
    """Restore rejected rows if bias drift explains them; returns the fit and its mask (n,) of kept rows."""
    drifts = problem.with_unknowns(drift=True)
    if kept.all() or problem.unknowns.drift or len(kept) <= least_rows(drifts):
        return found, kept
    if blind_spots(drifts.log, drifts.unknowns, drifts.factor):
        return found, kept
    _, more = trimmed(drifts)
    if more.sum() <= kept.sum():
        return found, kept
    again = fit(replace(problem, state=found.state), keep=more)
    return (again, more) if _offers_drift(problem, again, more) else (found, kept)


def _offers_drift(problem: Problem, fit: Fit, kept: Array) -> bool:
    return any(offer.kind == "sensor-drift" for offer in offers(problem, fit, kept))


def offers(problem: Problem, fit: Fit, kept: Array) -> list[Doubt]:
    """Unknowns that would explain the residuals of the kept rows (n,), selected one by one, best first.

    Each adds columns E to the whitened design. With P (rank r) the part of E orthogonal to it and to those before,
    F = ((|e|² - |e'|²) / r) / (|e'|² / (ν - r)), e' = e - P P'e, with ν the degrees of freedom of the residuals e.
    Drift and gain have separate columns for each channel. Their p-value is six times the smallest of the channels, as
    each channel has its own variance. Candidates with p < 1e-4 are significant. Among those that explain nearly as much
    as the best, the one with fewest columns is selected.
    """
    scale = fit.deviation[kept]
    e = (fit.residuals[kept] / scale).ravel()

    def flat(columns: Array) -> Array:
        x = (columns[kept] / scale[..., None]).reshape(e.size, -1)
        size = np.linalg.norm(x, axis=0)
        return np.asarray(x[:, size > 0] / size[size > 0])

    basis = orthonormal(flat(fit.design))
    columns = _candidates(problem, fit)
    candidates = {kind: flat(of_kind) for kind, of_kind in columns.items()}
    found: list[Doubt] = []
    e = e - basis @ (basis.T @ e)
    total = float(e @ e)
    while candidates and float(e @ e) > 1e-20 * max(total, 1e-300):
        sure = {}
        for kind, E in candidates.items():
            if _chance(kind, E, e, basis) < _SURE:
                P = orthonormal(E, basis)
                sure[kind] = (P, float(((P.T @ e) ** 2).sum()))
        if not sure:
            break
        most = max(gain for _, gain in sure.values())
        kind = min((k for k in sure if sure[k][1] >= _NEARLY * most), key=lambda k: sure[k][0].shape[1])
        P, gain = sure[kind]
        candidates.pop(kind)
        explained = (P @ (P.T @ e)).reshape(-1, 6) * scale
        if kind != "gain" or largest_share(explained, _loads(fit)[kept]) > _GAIN:
            found.append(_offer(kind, gain / total, columns[kind], fit, kept, explained))
        e = e - P @ (P.T @ e)
        basis = np.concatenate([basis, P], axis=1)
    return found


def _chance(kind: str, E: Array, e: Array, basis: Array) -> float:
    """p-value of the columns E (N, k): the probability that noise alone gives as good a fit."""
    from scipy import special

    channel = np.arange(e.size) % 6
    by_channel = kind in ("drift", "gain")
    own = [channel == c for c in range(6)] if by_channel else [np.ones(e.size, bool)]
    least = 1.0
    for rows in own:
        P = orthonormal(E[:, E[rows].any(axis=0)], basis)
        r, free = P.shape[1], float(rows.sum() - (basis[rows] ** 2).sum()) - P.shape[1]
        before, after = (float((x[rows] ** 2).sum()) for x in (e, e - P @ (P.T @ e)))
        if r and free >= _LEAST:
            F = (before - after) / r / max(after / free, 1e-12 * before, 1e-300)
            chance = len(own) * float(special.fdtrc(r, free, F))
            least = min(least, chance if by_channel else max(chance, _OF_ROWS * _chance_of_rows(P, e, free / 6)))
    return least


def _chance_of_rows(P: Array, e: Array, free: float) -> float:
    """p-value by Hotelling's test, for rows whose six channels share the error of their pose.

    b = P'e is the sum of the rows' P_g'e_g; its covariance is Σ s_g s_g' n / ν, s_g = P_g'e'_g, of the residuals.
    """
    from scipy import special

    r, b = P.shape[1], P.T @ e
    if free < r:
        return 1.0
    s = (P * (e - P @ b)[:, None]).reshape(-1, 6, r).sum(axis=1)
    T2 = float(b @ np.linalg.lstsq(s.T @ s * len(s) / free, b, rcond=None)[0])
    return float(special.fdtrc(r, free - r + 1, T2 * (free - r + 1) / (free * r)))


def _candidates(problem: Problem, fit: Fit) -> dict[str, Array]:
    """Design columns (n, 6, k) of each possible unknown; for a gain, one for each pair of channel and load component."""
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
    """Wrench (n, 6) of the load in the readings."""
    part = fit.unknowns.load
    return np.asarray(fit.design[..., part] @ fit.estimate[part])


def _offer(kind: str, share: float, columns: Array, fit: Fit, kept: Array, explained: Array) -> Doubt:
    """Doubt with the size of an unknown, from the explained residuals (n, 6), which are ``share`` of the squares."""
    found: dict[str, Any] = {"share": share}
    if kind in ("drift", "gain"):
        change = listed_bias(explained[-1] - explained[0])
        size = percent(largest_share(explained, _loads(fit)[kept]), 2)
        return doubt(f"sensor-{kind}", bias=change, size=size, share=percent(share), found=found)
    scale, k = fit.deviation[kept], columns.shape[-1]
    A = np.concatenate([columns[kept], fit.design[kept]], axis=-1) / scale[..., None]
    x = np.linalg.lstsq(A.reshape(6 * len(scale), -1), (fit.residuals[kept] / scale).ravel(), rcond=None)[0][:k]
    late = kind == "delay"
    value = 1e3 * float(x[0]) if late else math.degrees(float(np.linalg.norm(x)))
    found |= {"value": value, "unit": "ms" if late else "°"}
    return doubt(f"sensor-{kind}", size=number(value, 2), share=percent(share), found=found)


# ── Acceptance test: the sensor of a fit, notes and doubts

_SLIPS = ("sensor-exchanged", "sensor-known-bias", "sensor-gravity-up")  # swapped columns or a wrong bias, not units
_MAY_POINT_UP = (
    "Or gx, gy, gz point up, as an accelerometer at rest logs them, which explains the log as well: "
    "then negate these three and keep the sign."
)
_MISFIT = 1.5  # residual over given noise above which the noise is doubtful
_UNEXPLAINED = 0.05  # fraction of the change of forces above which residuals may be more than noise
_ORIENTATIONS, _FREEDOM = 10, 6  # minimum orientations, and degrees of freedom per channel, for reliable intervals


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
    told = low > 0
    load = SpatialInertia.zero()
    if found.mass > 0:  # otherwise the mass is zero within noise: no load
        load = SpatialInertia.from_parameters(fit.load)
        if not unknowns.inertia and told:  # at least the moments of a point mass
            load = SpatialInertia.from_com(found.mass, load.com)
    bias = fit.estimate[:6] if unknowns.bias else problem.bias
    inertia: Inertia = "unknown" if not unknowns.inertia else "accept" if load.defects() else "given"
    sensor = ForceTorqueSensor(load, bias, found.sign, fit.mounting, inertia=inertia)
    doubts = _log_doubts(log, use)
    if not told:
        mass = f"{plus_minus(found.mass, (high - low) / 2, 'kg')} ({percent(confidence, 3)})"
        doubts.append(doubt("sensor-mass", mass=mass))
    elif defects := load.defects():
        doubts.append(doubt("sensor-inertia-invalid", defects="; ".join(defects)))
    causes = _noise_doubts(found) + _explanation_doubts(found, log, problem)
    causes += offers(problem, fit, found.kept) if told and not causes else []
    if not any(cause.kind in _SLIPS for cause in causes):
        gain = any(cause.kind == "sensor-gain" for cause in causes)
        unit = unit_doubt(found, sensor, problem.log) if told and not gain else None
        causes += log.motion_doubts() or ([unit] if unit else log.size_doubts())
    kept = ~use.left_out & ~use.between
    result = Identification(sensor, fit, found.kept, kept, confidence, log, left_out=use.left_out)
    weak = weakness(result) if told and not any(cause.refuses for cause in causes) else []
    return replace(result, doubts=(*doubts, *causes, *weak, *_cluster_doubts(found, problem, use)))


def _log_doubts(log: ReadingLog, use: UsedReadings) -> list[Doubt]:
    """Doubts about outliers and about readings between dwells."""
    doubts = []
    if out := int(use.left_out.sum()):
        spans = [_span(log, a, b) for a, b in runs(use.left_out)]
        listed = ", ".join(spans[:10]) + (", …" if len(spans) > 10 else "") + (" (from 0)" if log.time is None else "")
        doubts.append(doubt("sensor-outliers", count=out, total=len(log), listed=listed))
    if between := int(use.between.sum()):
        doubts.append(doubt("sensor-between-dwells", count=between))
    return doubts


def _cluster_doubts(found: Diagnosis, problem: Problem, use: UsedReadings) -> list[Doubt]:
    """Doubts about intervals that may be too narrow."""
    doubts = []
    label = use.orientation[found.kept]
    count = len(np.unique(label))
    # Readings of a revisited orientation share its error.
    left = (1.0 - found.fit.leverage[found.kept]).sum(axis=0) - (len(label) - count)
    wanted = max(_ORIENTATIONS - count, math.ceil(_FREEDOM - left.min() - 1e-9))
    if problem.noise is None and wanted > 0:
        alike = ", and it is taken to be alike in the three forces and in the three moments" if few(label) else ""
        freedom: dict[str, Any] = {"freedom": number(max(left.min(), 0.0), 2), "least": _FREEDOM}
        words: dict[str, Any] = {"count": count, "axis": WRENCH[int(left.argmin())], "wanted": wanted, "alike": alike}
        doubts.append(doubt("sensor-few-orientations", orientations=_ORIENTATIONS, **words, **freedom))
    white = use.whiteness
    if white is not None and not white.white:
        rare, lag1 = number(1 / max(white.chance, 1e-12), 2), number(white.lag1, 2)
        lagged: dict[str, Any] = {"test": white.test, "length": white.length, "found": {"value": white.lag1}}
        doubts.append(doubt("sensor-correlated", axis=white.axis, lag1=lag1, rare=rare, **lagged))
    return doubts


def _span(log: ReadingLog, first: int, last: int) -> str:
    if log.time is not None:
        return f"{seconds(log.time[first])} to {seconds(log.time[last])} s"
    return f"{first}" if first == last else f"{first}–{last}"


def _no_mass(found: Diagnosis, log: ReadingLog, problem: Problem) -> str:
    evidence = f"mass comes out as {number(found.mass)} kg"
    better = others(found.sign, problem)
    for than in (found, *better[:1]):
        if slip := _slip(found, problem, than):
            return f"{evidence}. {slip}"
    if seems_moving(log):
        return f"{doubt('sensor-moving', evidence=evidence)}"
    if not better:
        return (
            f"{evidence}, with either sign. Check that the poses are of the sensor's frame and the readings of a load."
        )
    if (own := unexplained_turns(problem.log, better[0])) is not None:
        return f"{evidence}. {_poses(better[0], own)}"
    return f"{evidence}, so sign or mounting are not as given. {_ways(better, found, log)}"


def _poses(found: Diagnosis, own: float) -> Doubt:
    return doubt("sensor-poses", noise=_noise(found), own=number(own, 2))


def _ways(better: list[Diagnosis], found: Diagnosis, log: ReadingLog) -> str:
    best, *same = as_good_as_the_best(better)
    ways = f"Use {' or '.join(e.options for e in (best, *same))}: the residual is then {_noise(best)}."
    if same:
        ways += " These cannot be distinguished: check the sign, or add readings tilted about another axis."
    upward = log.by_gravity and log.V is None and best.sign != found.sign
    return f"{ways} {_MAY_POINT_UP}" if upward else ways


def _slip(found: Diagnosis, problem: Problem, than: Diagnosis) -> Doubt | None:
    """Input error (swapped columns, bias, gravity) with a significantly better fit than ``than``; None if not found."""
    free = free_bias(found, problem)
    if (exchanged := swapped(problem, free or than)) is not None:
        return doubt("sensor-exchanged", sign=Argument("sign", exchanged.sign), noise=_noise(exchanged))
    if free is not None:
        bias = listed_bias(free.fit.estimate[:6])
        return doubt("sensor-known-bias", bias=bias, before=_noise(found), after=_noise(free))
    upright = upside_down(found, problem, than)
    return None if upright is None else doubt("sensor-gravity-up", noise=_noise(upright))


def _noise_doubts(found: Diagnosis) -> list[Doubt]:
    """Doubts about a given noise."""
    if not np.isinf(found.fit.freedom).all():
        return []
    scaled = (found.fit.residuals / found.fit.deviation)[found.kept].reshape(-1, 2, 3)
    both = zip(("moments", "forces"), np.sqrt((scaled**2).mean(axis=(0, 2))).tolist(), strict=True)
    return [doubt("sensor-noise", what=what, times=number(times, 2)) for what, times in both if times > _MISFIT]


def _explanation_doubts(found: Diagnosis, log: ReadingLog, problem: Problem) -> list[Doubt]:
    """Input error that explains the log, if any; otherwise the possible explanations."""
    rows = problem.log
    share, doubts, better = misfit(rows, found.fit, found.kept), [], []
    unexplained = share > _UNEXPLAINED
    if unexplained and turns_may_help(rows, found.fit, found.kept):
        better = [e for e in others(found.sign, problem) if e.improves(found.fit)]
    if unexplained or free_bias(found, problem) is not None:
        if slip := _slip(found, problem, better[0] if better else found):
            return [slip]
        left = f"the residual is {_noise(found)}, {percent(share, 2)} of the change of forces"
        if better:
            doubts.append(doubt("sensor-sign", left=left, ways=_ways(better, found, log)))
        elif seems_moving(log):
            doubts.append(doubt("sensor-moving", evidence=f"Poses do not explain the readings: {left}"))
        elif (own := unexplained_turns(rows, found)) is not None and not _drifts(found, problem):
            doubts.append(_poses(found, own))
    if log.V is not None and not found.fit.unknowns.inertia:
        whole = explain(found.sign, problem.with_unknowns(inertia=True))
        if whole is not None and whole.improves(found.fit):
            doubts.append(doubt("sensor-inertia", before=_noise(found), after=_noise(whole)))
    if found.turn and not doubts and in_a_plane(rows, found.fit, found.kept, found.mass):
        other = explain("by_sensor" if found.sign == "on_sensor" else "on_sensor", problem)
        if other is not None and other.mass > 0 and other.equals(found.fit, found.kept):
            doubts.append(doubt("sensor-sign-or-mounting", options=other.options, noise=_noise(other)))
    return doubts


def _drifts(found: Diagnosis, problem: Problem) -> bool:
    """True if drift of the bias, with time or in the order of the log, explains the residuals ascribed to the poses."""
    if found.fit.unknowns.drift:
        return False
    steady = explain(found.sign, problem.with_unknowns(drift=True))
    return steady is not None and steady.improves(found.fit) and _offers_drift(problem, found.fit, found.kept)


def _noise(found: Diagnosis) -> str:
    moment, force = found.noise
    return f"noise of {number(force, 2)} N and {number(moment, 2)} N m"


# ── Identification

_IN_ORDER = 8  # minimum number of rows for tests that use their order
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
    log, factor = readings_of(log, gravity, "identify"), sign_factor(sign)
    causes = (assume,) if isinstance(assume, str) else tuple(assume)
    for cause in causes:
        arguments.choice(cause, "assume", CAUSES)
    unknowns = Unknowns(bias is None, arguments.flag(inertia, "inertia"), *(cause in causes for cause in CAUSES))
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
    if white is not None and white.length > 1 and not again:  # autocorrelated neighbours become one cluster
        problem = replace(problem, label=np.arange(len(kept)) // white.length, state=found.state)
        found = fit(problem, keep=kept)
    left_out, between = ~used, np.zeros(len(log), bool)
    between[used] = poses.row < 0
    left_out[used] = ~poses.spread(kept) & ~between[used]
    return acceptance_test(
        Diagnosis(sign, found, kept), confidence, problem, log, UsedReadings(left_out, between, label, white)
    )


def whiteness(fit: Fit, kept: Array, label: Array) -> Whiteness | None:
    """Whiteness test of the residuals of the kept rows (n,), in the order of the log; None for too few rows.

    Rows with the same label (n,) share the pose error of a revisited orientation, so their mean is subtracted.
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
    still = "motion, and the log has none. Give V and dV (columns wx, wy, wz, vx, vy, vz, dwx, …, dvz)"
    for unknown, lacks, what, where in (
        (unknowns.inertia, log.V is None, "an inertia", still),
        (unknowns.delay, log.V is None, "a delay", still),
        (unknowns.delay, log.time is None, "a delay", "time, and the log has none. Give a column time"),
        (unknowns.tilt, log.rotations is None, "a tilt of the base", "orientations, and the log has none. Give them"),
    ):
        if unknown and lacks:
            raise ValueRangeError(f"{log.name}: {what} shows only in {where}; otherwise leave it out.")
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
    known_bias = np.zeros(6) if bias is None else arguments.finite(arguments.one(bias, "bias", 6), "bias")
    known = None if noise is None else six_noises(noise)
    arguments.choice(outliers, "outliers", ("trim", "keep"))
    if not 0 < arguments.number(confidence, "confidence") < 1:
        raise ValueRangeError(f"confidence {confidence!r} is not between 0 and 1. Give 0.95 for 95 %.")
    return known_bias, known
