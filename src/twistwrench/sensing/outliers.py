"""Static poses of a log as clusters of readings, outlier rejection, and checks of the log's conventions."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from ..core.estimation.least_squares import MAD
from ..core.numbers import number
from ..core.text import Argument, spell
from ..core.typing import Array
from ..mechanics.lie import so3
from .contact_detection import CollisionThreshold
from .fit import Fit, Problem, SensorState, fit
from .log import ReadingLog
from .poses import blind_spots
from .sensor import Sign, sign_factor

_STEADY = (2e-3, 5e-2)  # rad; lower and upper bound of the tolerance on gravity's direction within a dwell
_STEPS = 5.0  # tolerance between these bounds, in median steps between readings
_OF_SPREAD = 0.1  # upper bound of the tolerance as a fraction of the spread of all directions
_SHORTEST = 5  # minimum readings of a dwell in a log with motion
_AT_REST = (0.02, 0.01, 0.2, 0.2)  # rad/s, m/s, rad/s², m/s² below which the sensor is at rest
_MANY = 2000  # largest number of dwells whose orientations are compared pairwise


@dataclass(frozen=True, eq=False)
class StaticPoses:
    """Reduced log: one row for each dwell (mean of its readings), and one for each reading in motion."""

    log: ReadingLog  # log of n rows, with times, or indices if no times were logged
    count: Array  # (n,) readings in each row
    within: Array  # (6,) variance of a reading within its dwell [(N m)², N²]; zero if no dwell has two readings
    within_freedom: float  # degrees of freedom of ``within``
    label: Array  # (n,) cluster of each row; rows of a revisited orientation share one
    row: Array
    """Row (N,) of each reading of the original log; -1 for readings between dwells, which are not used."""
    moving: Array  # (n,) True for readings in motion

    def spread(self, kept: Array) -> Array:
        """Expand a mask (n,) of rows to a mask (N,) of readings."""
        return np.asarray(np.where(self.row >= 0, kept[self.row], False))


def static_poses(log: ReadingLog) -> StaticPoses:
    """Static poses of a log: dwells are runs of readings with constant direction of gravity in {f}.

    In a log with twists, a dwell has at least five readings at rest; other readings are in motion. In a log without
    twists, short runs between long ones are taken to be motion between dwells and are left out.

    >>> still = ReadingLog.from_arrays(np.zeros((6, 6)), gravity=np.repeat([[0, 0, -9.81], [9.81, 0, 0]], 3, axis=0))
    >>> static_poses(still).count.tolist()
    [3.0, 3.0]
    """
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    near = _nearness(unit)
    rest = _at_rest(log)
    first, last = _runs(unit, near, rest)
    length = last - first
    moving = ~rest[first]
    used = np.ones(len(first), bool)
    if log.V is None and length[length >= _SHORTEST].sum() > 0.5 * len(log) and (length >= _SHORTEST).sum() > 2:
        used = length >= _SHORTEST
    row = np.repeat(np.where(used, np.cumsum(used) - 1, -1), length)
    count = length[used].astype(float)
    averaged = {name: getattr(log, name) for name in ("readings", "gravity", "V", "dV", "rotations")}
    averaged["time"] = log.clock
    own = replace(log, **{name: _means(value, row, count) for name, value in averaged.items()})
    off = log.readings[row >= 0] - own.readings[row[row >= 0]]
    freedom = float((count - 1).sum())
    within = (off**2).sum(axis=0) / freedom if freedom else np.zeros(6)
    return StaticPoses(own, count, within, freedom, _labels(own, near, moving[used]), row, moving[used])


def _nearness(unit: Array) -> float:
    """Tolerance [rad] for equal directions (n, 3): a few median steps, far below the spread of the directions."""
    if len(unit) < 2:
        return 0.0
    least, most = _STEADY
    step = float(np.median(_lengths(np.diff(unit, axis=0))))
    spread = float(_lengths(unit - unit.mean(axis=0)).max())
    return float(min(max(_STEPS * step, least), most, _OF_SPREAD * spread))


def _at_rest(log: ReadingLog) -> Array:
    """True for readings (n,) in a run at rest that is long enough; all True for a log without twists."""
    if log.V is None or log.dV is None:
        return np.ones(len(log), bool)
    sizes = _lengths(np.concatenate([log.V, log.dV], axis=1).reshape(-1, 4, 3))
    slow = np.asarray((sizes < _AT_REST).all(axis=1))
    for a, b in runs(slow):
        slow[a : b + 1] = b + 1 - a >= _SHORTEST
    return slow


def _runs(unit: Array, near: float, rest: Array) -> tuple[Array, Array]:
    """First index and end index of each run of constant gravity direction; each reading in motion is a separate run."""
    edges, n, start = [0], len(unit), 0
    while start < n:
        end = start + 1
        if rest[start]:
            size = 64
            while end < n:
                window = slice(end, min(n, end + size))
                out = np.flatnonzero((_lengths(unit[window] - unit[start]) > near) | ~rest[window])
                if out.size:
                    end += int(out[0])
                    break
                end, size = window.stop, 2 * size
        edges.append(end)
        start = end
    return np.array(edges[:-1]), np.array(edges[1:])


def _means(value: Array | None, row: Array, count: Array) -> Any:
    """Mean over the readings of each row; valid as readings at rest are linear in all averaged quantities."""
    if value is None:
        return None
    if len(count) == len(value):
        return value
    total = np.zeros((len(count), *value.shape[1:]))
    np.add.at(total, row[row >= 0], value[row >= 0])
    return total / count.reshape(-1, *[1] * (value.ndim - 1))


def _labels(log: ReadingLog, near: float, moving: Array) -> Array:
    n = len(log)
    if n > _MANY or moving.all():
        return np.arange(n)
    R = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    if log.rotations is not None:
        R = log.rotations.reshape(n, 9)
    label, known = np.arange(n), np.zeros(n, bool)
    for k in np.flatnonzero(~moving).tolist():
        same = np.flatnonzero(known & (_lengths(R - R[k]) <= near))
        label[k], known[k] = (int(same[0]), False) if same.size else (k, True)
    return label


def _lengths(x: Array) -> Array:
    return np.asarray(np.linalg.norm(x, axis=-1))


# ── Outliers: contacts, snagged cables, mistyped poses

_FALSE_ALARM = 3e-5  # probability that a clean log loses a reading; 1e-2 with pose errors of half a degree
_DWELL_ALARM = 1e-9  # probability that a clean log loses a dwell, small so that whole orientations are rarely rejected
_DWELL = 5  # minimum readings of a dwell
_SUSPECT = 0.98  # quantile of clean readings above which a reading is suspect
_WEAKER = 2.0  # largest ratio by which rejection may widen any unknown's deviation
_LEAST = 3  # gravity directions that determine mass, centre of mass and six biases


def least_rows(problem: Problem) -> int:
    """Minimum number of rows for the unknowns."""
    asked = problem.unknowns
    return max(_LEAST, math.ceil((len(asked.names) + 2) / 6) + asked.turn)


def touched_in_static_poses(log: ReadingLog, found: StaticPoses) -> Array:
    """Mask (N,) of outliers within their dwell; never more than half of a dwell.

    A reading is an outlier if its distance from the dwell's median, over 1.4826 times the median absolute distance in
    all dwells, exceeds a χ² limit. The false-alarm probability is 3e-5 for the whole log. Dwells of four or fewer are
    kept.
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
    spread = MAD * np.median(np.abs(off[member]), axis=0)
    noise = np.maximum(spread, np.abs(log.readings).max() * 1e-12 + 1e-300)
    limit = CollisionThreshold.of_axes(noise, _FALSE_ALARM / len(log))
    far = member & limit(off)
    for k in np.unique(place[far]).tolist():
        rows = place == k
        if far[rows].mean() < 0.5:
            touched |= far & rows
    return touched


def trimmed(problem: Problem) -> tuple[Fit, Array]:
    """Fit with outlier rejection: the fit and the mask (n,) of kept rows.

    A Huber fit finds suspect rows. They are left out; each that the fit of the others predicts is restored. The test
    has a false-alarm probability of 3e-5 for the whole log (1e-9 for a dwell) and is repeated until nothing changes. At
    least as many rows stay as the unknowns need, and at most a third is rejected. If the rest would determine an
    unknown much less well, all rows stay, and the contradictions count as noise.
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
    """True if the kept rows determine every unknown nearly as well as all rows do."""
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
    """First and last index of each run of true values in ``mask`` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


# ── Conventions: sign, mounting, swapped or inverted inputs

_SURE = 1e-4  # significance level for preferring another explanation


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Fit of a log with one sign, with or without an unknown mounting."""

    sign: Sign
    fit: Fit
    kept: Array  # (n,) mask of used rows

    @property
    def turn(self) -> bool:
        """True if the mounting is an unknown."""
        return self.fit.unknowns.turn

    @property
    def left(self) -> float:
        """Product of the residual noise of moments and forces."""
        return float(np.prod(self.fit.noise))

    @property
    def noise(self) -> tuple[float, float]:
        """Residual noise of moments [N m] and forces [N]: root mean square over the degrees of freedom."""
        residuals = self.fit.residuals[self.kept].reshape(-1, 2, 3)
        moment, force = np.sqrt((residuals**2).sum(axis=(0, 2)) / self.freedom)
        return float(moment), float(force)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of three channels."""
        return max(3.0 * self.kept.sum() - len(self.fit.unknowns.names) / 2, 1.0)

    @property
    def mass(self) -> float:
        """Mass [kg]; negative if this does not explain the log."""
        return float(self.fit.load[0])

    @property
    def options(self) -> str:
        """Arguments that select this explanation."""
        sign = spell(Argument("sign", self.sign))
        if not self.turn:
            return sign
        degrees = math.degrees(float(np.linalg.norm(so3.log(self.fit.mounting))))
        return f"{sign} with {spell(Argument('assume', 'orientation'))} (turned by {number(degrees, 3)}°)"

    def improves(self, on: Fit) -> bool:
        """True if the residual noise is significantly less than that of another fit of the same log."""
        return _surely_less(self.fit, on, self.kept)

    def equals(self, other: Fit, kept: Array) -> bool:
        """True if another fit is not significantly better."""
        return not _surely_less(other, self.fit, kept)


def explain(sign: Sign, problem: Problem) -> Diagnosis | None:
    """Best fit of the log with the given sign; None if the log does not determine the unknowns."""
    asked = replace(problem, factor=sign_factor(sign))
    if len(asked.log) < least_rows(asked) or blind_spots(asked.log, asked.unknowns, asked.factor):
        return None
    return Diagnosis(sign, *trimmed(guessed(asked)))


def guessed(problem: Problem) -> Problem:
    """Problem with an initial guess of the mounting, if the mounting is an unknown."""
    mounting = first_guess(problem) if problem.unknowns.turn else np.eye(3)
    return replace(problem, state=SensorState(mounting))


def others(sign: Sign, problem: Problem) -> list[Diagnosis]:
    """Fits with other signs and mountings and a positive mass, sorted by noise."""
    found = []
    for turn in (False, True):
        for other in get_args(Sign):
            if (other, turn) != (sign, problem.unknowns.turn):
                explanation = explain(other, problem.with_unknowns(turn=turn))
                if explanation is not None and explanation.mass > 0:
                    found.append(explanation)
    return sorted(found, key=lambda e: e.left)


def as_good_as_the_best(sorted_: list[Diagnosis]) -> list[Diagnosis]:
    """Fits not significantly worse than the first; with an unknown mounting only if its sign fits no log without."""
    best = sorted_[0]
    good = [e for e in sorted_ if e is best or e.equals(best.fit, best.kept)]
    straight = {e.sign for e in good if not e.turn}
    return [e for e in good if not (e.turn and e.sign in straight)]


def first_guess(problem: Problem) -> Array:
    """Initial guess of the mounting R_fs (3, 3) from forces: the rotation nearest to M of f = bias + M g."""
    log = problem.log
    g, f = log.gravity, log.readings[:, 3:]
    if log.V is not None and log.dV is not None:
        g = g - log.dV[:, 3:] - so3.cross(log.V[:, :3], log.V[:, 3:])
    if problem.unknowns.bias:
        g, f = g - g.mean(axis=0), f - f.mean(axis=0)
    else:
        f = f - problem.bias[3:]
    M = problem.factor * np.linalg.lstsq(g, f, rcond=None)[0].T  # m R_fs'
    U, _, Vt = np.linalg.svd(M)
    return np.asarray((U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T)


def _surely_less(less: Fit, more: Fit, rows: Array) -> bool:
    from scipy import special

    scale = np.repeat(less.spread(rows), 3)
    freedom = [max(6.0 * rows.sum() - len(f.unknowns.names), 1.0) for f in (less, more)]
    mean = [float(((f.residuals[rows] / scale) ** 2).sum()) / n for f, n in zip((less, more), freedom, strict=True)]
    return mean[1] / mean[0] > float(special.fdtri(freedom[1], freedom[0], 1 - _SURE))


# ── Input errors other than sign and mounting

_SWAP = [3, 4, 5, 0, 1, 2]


def free_bias(found: Diagnosis, problem: Problem) -> Diagnosis | None:
    """Fit with an estimated bias if significantly better than with the given one (F test of the six); else None."""
    if found.fit.unknowns.bias:
        return None
    from scipy import special

    free = explain(found.sign, problem.with_unknowns(bias=True))
    if free is None or free.mass <= 0:
        return None
    rows = free.kept & found.kept
    scale = np.maximum(free.fit.deviation[rows], 1e-12)
    least, more = (float(((e.fit.residuals[rows] / scale) ** 2).sum()) for e in (free, found))
    known = 6.0 * rows.sum() - len(free.fit.unknowns.names)
    limit = float(special.fdtri(6.0, max(known, 1.0), 1 - _SURE))
    return free if (more - least) / 6 > limit * max(least, 1e-9) / max(known, 1.0) else None


def swapped(problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """Fit with forces and moments exchanged, if significantly better than ``than``; else None."""
    other = replace(problem.log, readings=problem.log.readings[:, _SWAP])
    noise = None if problem.noise is None else problem.noise[_SWAP]
    asked = replace(problem, log=other, bias=problem.bias[_SWAP], within=problem.within[_SWAP], noise=noise)
    tried = [explain(sign, asked.with_unknowns(turn=False)) for sign in get_args(Sign)]
    exchanged: Fit = replace(than.fit, residuals=than.fit.residuals[:, _SWAP])
    good = [e for e in tried if e is not None and e.mass > 0 and e.improves(exchanged)]
    return min(good, key=lambda e: e.left, default=None)


def upside_down(found: Diagnosis, problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """Fit of a log in motion with gravity reversed, if significantly better; at rest this equals the opposite sign."""
    log = problem.log
    if not log.by_gravity or log.V is None:
        return None
    other = explain(found.sign, replace(problem, log=replace(log, gravity=-log.gravity)))
    return other if other is not None and other.mass > 0 and other.improves(than.fit) else None
