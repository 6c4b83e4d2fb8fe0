"""Checks of a sensor log's conventions: sign, mounting, swapped or inverted inputs, drift, gain and cross-talk."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from ..core.numbers import number, percent
from ..lie import so3
from ..lie.labelled import WRENCH
from ..typing import Array
from .fit import Fit, Problem, SensorState, clock
from .log import ReadingLog
from .observability import blind_spots
from .outliers import least_rows, trimmed
from .sensor import ForceTorqueSensor, Sign, sign_factor

_SURE = 1e-4  # chance to prefer another explanation by luck
_MAYBE = 1e-2  # chance to try others in vain
_OFF_PLANE = 10.0  # times the noise, from which the wrong one of two signs is seen without a test
_ROUND = 0.1  # of the ball's radius: noise below which forces of one size lie on a ball


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """A log explained with one sign, the mounting turned or not."""

    sign: Sign
    fit: Fit
    kept: Array
    """(n,) which rows of the problem were used."""

    @property
    def turn(self) -> bool:
        """Whether the mounting is an unknown."""
        return self.fit.unknowns.turn

    @property
    def left(self) -> float:
        """Product of the noise left of moments and forces."""
        return float(np.prod(self.fit.noise))

    @property
    def mass(self) -> float:
        """kg; negative if it is no explanation."""
        return float(self.fit.load[0])

    @property
    def options(self) -> str:
        """How to ask for it."""
        if not self.turn:
            return f"sign={self.sign!r}"
        degrees = math.degrees(float(np.linalg.norm(so3.log(self.fit.mounting))))
        return f"sign={self.sign!r} with orientation=True (turned by {number(degrees, 3)}°)"

    def improves(self, on: Fit) -> bool:
        """Whether the noise left is surely less than that of another fit of the same log."""
        return _surely_less(self.fit, on, self.kept)

    def equals(self, other: Fit, kept: Array) -> bool:
        """Whether another fit is not surely better than this explanation."""
        return not _surely_less(other, self.fit, kept)


def explain(sign: Sign, problem: Problem) -> Diagnosis | None:
    """The log explained by that sign, as well as it can be; None if it tells too little for these unknowns."""
    asked = replace(problem, factor=sign_factor(sign))
    if len(asked.log) < least_rows(asked) or blind_spots(asked.log, asked.unknowns, asked.factor):
        return None
    return Diagnosis(sign, *trimmed(guessed(asked)))


def guessed(problem: Problem) -> Problem:
    """The problem with a first guess of the mounting, if that is asked for."""
    mounting = first_guess(problem) if problem.unknowns.turn else np.eye(3)
    return replace(problem, state=SensorState(mounting))


def others(sign: Sign, problem: Problem) -> list[Diagnosis]:
    """The explanations that were not asked for and have a mass, the one with least noise first."""
    found = []
    for turn in (False, True):
        for other in get_args(Sign):
            if (other, turn) != (sign, problem.unknowns.turn):
                explanation = explain(other, problem.asked(turn=turn))
                if explanation is not None and explanation.mass > 0:
                    found.append(explanation)
    return sorted(found, key=lambda e: e.left)


def as_good_as_the_best(sorted_: list[Diagnosis]) -> list[Diagnosis]:
    """Those not surely worse than the first; a turned mounting only where that sign does not do without."""
    best = sorted_[0]
    good = [e for e in sorted_ if e is best or e.equals(best.fit, best.kept)]
    straight = {e.sign for e in good if not e.turn}
    return [e for e in good if not (e.turn and e.sign in straight)]


def first_guess(problem: Problem) -> Array:
    """A mounting R_fs (3, 3) from forces alone: the rotation nearest to M of f = bias + M g, however large."""
    log = problem.log
    felt = log.gravity
    if log.V is not None and log.dV is not None:
        felt = log.gravity - log.dV[:, 3:] - so3.cross(log.V[:, :3], log.V[:, 3:])
    f = log.readings[:, 3:]
    if problem.unknowns.bias:
        felt, f = felt - felt.mean(axis=0), f - f.mean(axis=0)
    else:
        f = f - problem.bias[3:]
    M = problem.factor * np.linalg.lstsq(felt, f, rcond=None)[0].T  # m R_fs'
    U, _, Vt = np.linalg.svd(M)
    return np.asarray((U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt).T)


def misfit(log: ReadingLog, found: Fit, kept: Array) -> float:
    """What is left of the forces, as a share of how they change in the log."""
    f = log.readings[kept][:, 3:]
    change = float(np.sqrt(np.mean((f - f.mean(axis=0)) ** 2)))
    left = float(np.sqrt(np.mean(found.residuals[kept][:, 3:] ** 2)))
    return left / change if change else 0.0


def in_a_plane(log: ReadingLog, found: Fit, kept: Array, mass: float) -> bool:
    """Whether gravity keeps to a plane, to noise: then a half turn about the plane's normal undoes the other sign."""
    g = log.gravity[kept]
    if found.unknowns.bias:  # what is constant is as good as bias
        g = g - g.mean(axis=0)
    least = float(np.linalg.svd(g, compute_uv=False)[-1]) if len(g) > 2 else 0.0
    return 2.0 * mass * least < _OFF_PLANE * float(found.noise[1])


def unexplained_turns(log: ReadingLog, found: Fit, kept: Array) -> float | None:
    """The noise [N] of forces that poses have no part in, if surely less than what is left; None if it cannot be told.

    At rest forces lie on a ball about the bias, whatever the poses: |f|² = 2 b·f + r² − |b|² is linear in b and the rest.
    """
    from scipy import special

    f = log.readings[kept][:, 3:]
    n = len(f)
    if log.V is not None or n < 7:
        return None
    middle, size = f.mean(axis=0), float(np.linalg.norm(f - f.mean(axis=0), axis=1).max())
    if not size:
        return None
    u = (f - middle) / size
    A = np.column_stack([2 * u, np.ones(n)])
    x, _, rank, _ = np.linalg.lstsq(A, (u * u).sum(axis=1), rcond=1e-6)
    if rank < 4:
        return None
    radius = math.sqrt(max(float(x[3] + x[:3] @ x[:3]), 1e-300))
    off = np.linalg.norm(u - x[:3], axis=1) - radius
    own = size * max(math.sqrt(float(off @ off) / (n - 4)), 1e-12)
    left = float(np.sqrt(np.sum(found.residuals[kept][:, 3:] ** 2) / max(3 * n - len(found.unknowns.names) / 2, 1.0)))
    if own > _ROUND * radius * size or (left / own) ** 2 < special.fdtri(2 * n, n - 4, 1 - _SURE):
        return None
    return own


def turns_may_help(log: ReadingLog, found: Fit, kept: Array) -> bool:
    """Whether some sign and mounting may explain a log surely better: at rest, whether any readings linear in gravity do.

    The bias and the weight of a load are that, in whatever axes and with whatever sign; so where the best of all linear
    maps is no better, nothing else need be tried.
    """
    from scipy import special

    if log.V is not None:
        return True
    g, readings = log.gravity[kept], log.readings[kept]
    A = np.column_stack([np.ones(len(g)), g - g.mean(axis=0)])
    x, _, rank, _ = np.linalg.lstsq(A, readings, rcond=1e-6)
    scale = np.repeat(_deviation(found, kept), 3)
    free, known = 6.0 * (len(g) - rank), 6.0 * len(g) - len(found.unknowns.names)
    if free <= 0 or known <= free:
        return True
    least = float((((readings - A @ x) / scale) ** 2).sum())
    more = float(((found.residuals[kept] / scale) ** 2).sum()) - least
    gain = more / (known - free) - least / free * float(special.fdtri(known - free, free, 1 - _MAYBE))
    return gain > 0


def _surely_less(less: Fit, more: Fit, rows: Array) -> bool:
    from scipy import special

    scale = np.repeat(_deviation(less, rows), 3)
    freedom = [max(6.0 * rows.sum() - len(f.unknowns.names), 1.0) for f in (less, more)]
    mean = [float(((f.residuals[rows] / scale) ** 2).sum()) / n for f, n in zip((less, more), freedom, strict=True)]
    return mean[1] / mean[0] > float(special.fdtri(freedom[1], freedom[0], 1 - _SURE))


def _deviation(found: Fit, rows: Array) -> Array:
    """Standard deviations (2,) of what is left of moments and forces, given noise or not; never zero."""
    left = np.sqrt((found.residuals[rows].reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))
    return np.maximum(left, 1e-12 * (1e-3 + np.abs(found.residuals).max()))


# ── Input errors other than sign and mounting

MAY_POINT_UP = (
    "Or gx, gy, gz point up, as an accelerometer at rest logs them, which explains the log as well: "
    "then negate these three and keep the sign."
)
MAY_MOVE = (
    "It may be in motion: gravity turns steadily from reading to reading. Add columns wx, wy, wz, vx, vy, vz and their rates "
    "dwx, …, dvz, or keep only the readings at rest."
)
_SMOOTH = (1e-4, 0.2)  # rad from one reading to the next, of a log in motion
_ENOUGH = 10  # readings that show it
_SURE_BIAS = 1e-4  # chance to prefer another bias by luck
_SWAP = [3, 4, 5, 0, 1, 2]


def free_bias(found: Diagnosis, problem: Problem) -> Diagnosis | None:
    """The log explained with a bias of its own, where the one given fits surely worse: an F test of the six."""
    if found.fit.unknowns.bias:
        return None
    from scipy import special

    free = explain(found.sign, problem.asked(bias=True))
    if free is None or free.mass <= 0:
        return None
    rows = free.kept & found.kept
    scale = np.maximum(free.fit.deviation[rows], 1e-12)
    least, more = (float(((e.fit.residuals[rows] / scale) ** 2).sum()) for e in (free, found))
    known = 6.0 * rows.sum() - len(free.fit.unknowns.names)
    limit = float(special.fdtri(6.0, max(known, 1.0), 1 - _SURE_BIAS))
    return free if (more - least) / 6 > limit * max(least, 1e-9) / max(known, 1.0) else None


def swapped(problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """The log explained with forces and moments exchanged, if surely better ``than`` another explanation."""
    other = replace(problem.log, readings=problem.log.readings[:, _SWAP])
    noise = None if problem.noise is None else problem.noise[_SWAP]
    asked = replace(problem, log=other, bias=problem.bias[_SWAP], within=problem.within[_SWAP], noise=noise)
    tried = [explain(sign, asked.asked(turn=False)) for sign in get_args(Sign)]
    exchanged: Fit = replace(than.fit, residuals=than.fit.residuals[:, _SWAP])
    good = [e for e in tried if e is not None and e.mass > 0 and e.improves(exchanged)]
    return min(good, key=lambda e: e.left, default=None)


def upside_down(found: Diagnosis, problem: Problem, than: Diagnosis) -> Diagnosis | None:
    """The log in motion explained with gravity the other way, if surely better; at rest that is the other sign."""
    log = problem.log
    if not log.by_gravity or log.V is None:
        return None
    other = explain(found.sign, replace(problem, log=replace(log, gravity=-log.gravity)))
    return other if other is not None and other.mass > 0 and other.improves(than.fit) else None


def may_point_up(log: ReadingLog, asked: str, best: Diagnosis) -> bool:
    """Whether gravity the other way explains a log exactly as well as the other sign does."""
    return log.by_gravity and log.V is None and best.sign != asked


def seems_moving(log: ReadingLog) -> bool:
    """Whether a log without twists turns steadily, as no tool does that is held still in some orientations."""
    if log.V is not None or len(log) < _ENOUGH:
        return False
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    step = np.linalg.norm(np.diff(unit, axis=0), axis=1)
    return bool(_SMOOTH[0] < np.median(step) and step.max() < _SMOOTH[1] and np.ptp(unit, axis=0).max() > _SMOOTH[1])


def listed_bias(bias: Array) -> str:
    """A bias (6,) by its axes."""
    return ", ".join(f"{axis} {number(value, 3)}" for axis, value in zip(WRENCH, bias, strict=True))


# ── Drift of the bias, gain and cross-talk in what is left

_LEAST = 3  # readings that are off, from which a cause is looked for
_CURED = 0.25  # of them, at most, that are still off without it
_MOST = 0.5  # of the load's wrench; more is another tool
_PER_COLUMN = 3  # readings for each column of what is tried
_HUBER = 2.0  # times the noise, from which a reading loses weight
_ROUNDS = 50


def departure(
    log: ReadingLog, sensor: ForceTorqueSensor, rest: Array, sigma: Array, off: Callable[[Array], Array]
) -> str | None:
    """What explains nearly all readings that are ``off`` in rest (n, 6), with noise sigma (n, 6); None if nothing.

    Each channel is explained by columns X with Huber's weights: the powers 1, t, t² of time for a bias that drifts, or 1 and
    the load's six wrench components for a gain or cross-talk. A push of a while is neither.
    """
    before = int(off(rest).sum())
    if before < _LEAST:
        return None
    t = clock(log)
    s = (t - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 0.5
    load = log.predicted(sensor) - np.asarray(sensor.bias)
    tried = {"drift": np.stack([s**k for k in range(3)], axis=1), "gain": np.column_stack([np.ones(len(s)), load])}
    best: tuple[int, str, Array] | None = None
    for name, X in tried.items():
        basis = _basis(X)
        if len(s) < _PER_COLUMN * basis.shape[1]:
            continue
        explained = np.stack([_robust(basis, rest[:, c], sigma[:, c]) for c in range(6)], axis=1)
        after = int(off(rest - explained).sum())
        if after <= _CURED * before and (best is None or after < best[0]):
            best = (after, name, explained)
    if best is None:
        return None
    _, name, explained = best
    if name == "drift":
        moved = explained[-1] - explained[0]
        per = f"over {number(t[-1] - t[0], 3)} s" if log.time is not None else f"over the {len(t)} readings"
        return (
            f"The bias drifts: by {listed_bias(moved)} [N m, N] {per}, which explains {before - best[0]} of {before} readings "
            "that are off. Identify the sensor again, zero it more often, or let it warm up."
        )
    changes = explained - explained.mean(axis=0)
    size = [np.sqrt((x.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2))) for x in (changes, load - load.mean(axis=0))]
    share = float((size[0] / np.maximum(size[1], 1e-9)).max())
    if share > _MOST:
        return None
    return (
        f"A gain or cross-talk is off by {percent(share, 2)} of what the load does, which explains {before - best[0]} of "
        f"{before} readings that are off. Check the sensor's calibration matrix and its scale, or whether it is the log of "
        "this tool."
    )


def _basis(X: Array) -> Array:
    """Orthonormal columns that span those of X (n, k), without what is rounding."""
    size = np.linalg.norm(X, axis=0)
    U, values, _ = np.linalg.svd(X[:, size > 0] / size[size > 0], full_matrices=False)
    return np.asarray(U[:, values > 1e-6 * values[0]])


def _robust(X: Array, y: Array, sigma: Array) -> Array:
    """What columns X (n, k) explain of y (n,), with Huber's weights; least absolute deviations to begin with."""
    e, fitted = y - np.median(y), np.zeros_like(y)
    scale = max(float(np.median(np.abs(e))), 1e-300)
    for round_ in range(_ROUNDS):
        limit = 1e-3 * scale if round_ < 20 else _HUBER * sigma
        root = np.sqrt(np.minimum(1.0, limit / np.maximum(np.abs(e), 1e-300)))
        x = np.linalg.lstsq(X * root[:, None], y * root, rcond=None)[0]
        before, fitted = fitted, X @ x
        e = y - fitted
        if round_ > 20 and np.abs(fitted - before).max() < 1e-3 * sigma.min():
            break
    return fitted
