"""Doubts about readings of a force-torque sensor: motion, poses, drift, gain, cross-talk and units."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.gravity import KGF
from ..core.numbers import number, percent, printed
from ..core.typing import Array
from ..mechanics.lie.labelled import WRENCH

if TYPE_CHECKING:
    from .fit import Fit
    from .log import ReadingLog
    from .outliers import Diagnosis
    from .sensor import ForceTorqueSensor

_SURE_POSES = 1e-4  # significance level for blaming the poses
_MAYBE = 1e-2  # significance level for trying other explanations
_OFF_PLANE = 10.0  # ratio to the noise above which a wrong sign is evident without a test
_ROUND = 0.1  # noise over radius below which forces of equal size lie on a sphere
_SMOOTH = (1e-4, 0.2)  # rad between consecutive readings of a log in motion
_ENOUGH = 10  # minimum number of readings for the test of motion


def seems_moving(log: ReadingLog) -> bool:
    """True if the directions of a log without twists change steadily, unlike those of static poses."""
    if log.V is not None or len(log) < _ENOUGH:
        return False
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    step = np.linalg.norm(np.diff(unit, axis=0), axis=1)
    return bool(_SMOOTH[0] < np.median(step) and step.max() < _SMOOTH[1] and np.ptp(unit, axis=0).max() > _SMOOTH[1])


def listed_bias(bias: Array) -> str:
    """Components of a bias (6,) with axis names, for messages."""
    return ", ".join(f"{axis} {number(value, 3)}" for axis, value in zip(WRENCH, bias, strict=True))


def misfit(log: ReadingLog, found: Fit, kept: Array) -> float:
    """Residual of the forces as a fraction of their change in the log."""
    f = log.readings[kept][:, 3:]
    change = float(np.sqrt(np.mean((f - f.mean(axis=0)) ** 2)))
    left = float(np.sqrt(np.mean(found.residuals[kept][:, 3:] ** 2)))
    return left / change if change else 0.0


def in_a_plane(log: ReadingLog, found: Fit, kept: Array, mass: float) -> bool:
    """True if gravity lies in a plane within noise; a half turn about its normal then equals the opposite sign."""
    g = log.gravity[kept]
    if found.unknowns.bias:  # a constant component is absorbed by the bias
        g = g - g.mean(axis=0)
    least = float(np.linalg.svd(g, compute_uv=False)[-1]) if len(g) > 2 else 0.0
    return 2.0 * mass * least < _OFF_PLANE * float(found.noise[1])


def unexplained_turns(log: ReadingLog, found: Diagnosis) -> float | None:
    """Noise [N] of forces estimated without the poses, if significantly less than the residuals; otherwise None.

    At rest, forces lie on a sphere about the bias: |f|² = 2 b·f + r² − |b|² is linear in b and r² − |b|².
    """
    from scipy import special

    f = log.readings[found.kept][:, 3:]
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
    if own > _ROUND * radius * size or (found.noise[1] / own) ** 2 < special.fdtri(2 * n, n - 4, 1 - _SURE_POSES):
        return None
    return own


def turns_may_help(log: ReadingLog, found: Fit, kept: Array) -> bool:
    """True if another sign or mounting may explain a log significantly better; at rest, if any linear map of gravity does.

    Bias and weight are a linear map of gravity for every sign and mounting. If the best linear map is not better, no
    other sign or mounting is.
    """
    from scipy import special

    if log.V is not None:
        return True
    g, readings = log.gravity[kept], log.readings[kept]
    A = np.column_stack([np.ones(len(g)), g - g.mean(axis=0)])
    x, _, rank, _ = np.linalg.lstsq(A, readings, rcond=1e-6)
    scale = np.repeat(found.spread(kept), 3)
    free, known = 6.0 * (len(g) - rank), 6.0 * len(g) - len(found.unknowns.names)
    if free <= 0 or known <= free:
        return True
    least = float((((readings - A @ x) / scale) ** 2).sum())
    more = float(((found.residuals[kept] / scale) ** 2).sum()) - least
    gain = more / (known - free) - least / free * float(special.fdtri(known - free, free, 1 - _MAYBE))
    return gain > 0


# ── Drift of the bias, gain and cross-talk in the residuals

_LEAST = 3  # minimum number of off readings for a search
_CURED = 0.25  # largest fraction of off readings that may remain
_MOST = 0.5  # of the load's wrench; above, the tool is another one
_PER_COLUMN = 3  # minimum readings per column of an explanation
_HUBER = 2.0  # residual over noise above which a reading loses weight


def departure(
    log: ReadingLog, sensor: ForceTorqueSensor, rest: Array, sigma: Array, off: Callable[[Array], Array]
) -> Doubt | None:
    """Cause of nearly all ``off`` readings in the residuals rest (n, 6) with noise sigma (n, 6); None if not found.

    Each channel is fitted by columns X with Huber weights: 1 for a constant offset, 1, t, t² for a drifting bias, or 1 and
    the six components of the load's wrench for a gain or cross-talk. None fits a temporary contact. An offset that
    explains the readings is named before the others, which contain it.
    """
    before = int(off(rest).sum())
    if before < _LEAST:
        return None
    t = log.clock
    s = (t - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 0.5
    load = log.predicted(sensor) - np.asarray(sensor.bias)
    constant = np.ones((len(s), 1))
    tried = {
        "offset": constant,
        "drift": np.stack([s**k for k in range(3)], axis=1),
        "gain": np.column_stack([constant, load]),
    }
    best: tuple[int, str, Array] | None = None
    for name, X in tried.items():
        basis = orthonormal(X[:, X.any(axis=0)] / np.linalg.norm(X[:, X.any(axis=0)], axis=0))
        if len(s) < _PER_COLUMN * basis.shape[1]:
            continue
        explained = np.stack([_robust(basis, rest[:, c], sigma[:, c]) for c in range(6)], axis=1)
        after = int(off(rest - explained).sum())
        if after <= _CURED * before and (best is None or after < best[0]):
            best = (after, name, explained)
            if name == "offset":
                break
    if best is None:
        return None
    after, name, explained = best
    count: dict[str, Any] = {"count": before - after, "total": before}
    if name == "offset":
        return doubt("sensor-file-offset", bias=listed_bias(explained[0]), **count)
    if name == "drift":
        span = f"{number(t[-1] - t[0], 3)} s" if log.time is not None else f"the {len(t)} readings"
        return doubt("sensor-file-drift", bias=listed_bias(explained[-1] - explained[0]), span=span, **count)
    share = largest_share(explained, load)
    return doubt("sensor-file-gain", share=percent(share, 2), **count) if share <= _MOST else None


def largest_share(explained: Array, load: Array) -> float:
    """Change of the explained part (n, 6) over the change of the load (n, 6); the larger of moments and forces."""
    changes = ((x - x.mean(axis=0)).reshape(-1, 2, 3) for x in (explained, load))
    part, whole = (np.sqrt((x**2).mean(axis=(0, 2))) for x in changes)
    return float((part / np.maximum(whole, 1e-12)).max())


def orthonormal(E: Array, basis: Array | None = None) -> Array:
    """Orthonormal basis of the columns E (N, k) orthogonal to a basis (N, p), without directions at rounding level."""
    if basis is not None:
        E = E - basis @ (basis.T @ E)
        E = E - basis @ (basis.T @ E)
    U, values, _ = np.linalg.svd(E, full_matrices=False)
    return np.asarray(U[:, values > 1e-6])


def _robust(X: Array, y: Array, sigma: Array) -> Array:
    """Robust fit of y (n,) by columns X (n, k), with Huber's loss, which is convex."""
    from scipy.optimize import least_squares

    def left(x: Array) -> Array:
        return np.asarray((X @ x - y) / sigma)

    return np.asarray(X @ least_squares(left, np.zeros(X.shape[1]), loss="huber", f_scale=_HUBER).x)


# ── Mixed-up units, judged by the resulting tool

# A wrong force unit scales the mass, a wrong moment unit the first moment; the centre of mass and the ratio of the two
# noises scale with their quotient. One of the three may be unusual. A doubt is raised if one is unusual and another
# unit makes all three usual, or if one is impossible.


class Mixup(NamedTuple):
    """Units of a log other than N and N m."""

    cause: str
    force: float
    """Newtons per force unit."""
    moment: float
    """Newton metres per moment unit."""

    @property
    def cure(self) -> str:
        """Conversion factors of the columns, as an instruction."""
        both = (("fx, fy, fz", self.force), ("mx, my, mz", self.moment))
        factors = both if self.force != self.moment else [("all six", self.force)]
        return "multiply " + " and ".join(f"{axes} by {printed(x)}" for axes, x in factors if x != 1.0)


MIXUPS = (
    Mixup("forces are in grams", KGF / 1000, 1.0),
    Mixup("forces are in kilograms", KGF, 1.0),
    Mixup("moments are in N mm", 1.0, 1e-3),
    Mixup("moments are in N cm", 1.0, 1e-2),
    Mixup("forces are in kilograms and moments in kg cm", KGF, KGF / 100),
    Mixup("forces are in grams and moments in g cm", KGF / 1000, KGF / 1e5),
    Mixup("forces are in pounds and moments in pound inches", 4.44822, 0.112985),
)
"""Wrong units found in logs, most frequent first."""

# Rows: mass [kg], distance of the centre of mass from the sensor [m], ratio of force noise to moment noise [1/m]. The
# ratio is the inverse of the distance of the strain gauges from the axis. Margins are 10 %.
_USUAL = np.array([[0.045, 55.0], [0.009, 0.33], [4.0, 600.0]])
_BEYOND = np.array([500.0, 0.5, math.inf])  # impossible for tools on a six-axis sensor
# Ranges that raise no doubt: a tool may be long, and noise in N and N m may be equal.
_TOOL = np.array([[0.045, 55.0], [0.009, 0.4], [0.5, 600.0]])
_SURE, _NOISE_SURE = 1e-5, 1e-3  # probabilities that an interval below misses the true value
_NO_NOISE = 1e-4  # of the weight; residuals below are rounding errors


def unit_doubt(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Doubt | None:
    """Doubt about the units of the log, with remedy; None if the identified tool is plausible."""
    found = _found(result, sensor, log)
    if _overlap(found, _TOOL).all():
        return None
    ways = []
    for place, way in enumerate(MIXUPS):
        meant = found * np.array([way.force, way.moment / way.force, way.force / way.moment])[:, None]
        if _overlap(meant, _USUAL).all():
            off = (np.log(meant[:, 1]) - np.log(_USUAL).mean(axis=1)) / np.ptp(np.log(_USUAL), axis=1)
            ways.append((float((off[np.isfinite(off)] ** 2).sum()) + 0.08 * place, f"{way.cause} ({way.cure})"))
    if not ways and not (found[:, 0] > _BEYOND).any():
        return None
    out, (moment, force) = float(np.linalg.norm(sensor.load.com)), result.fit.noise
    far = f"{number(out, 3)} m" if out >= 1 else f"{number(1e3 * out, 3)} mm"
    tool = (
        f"a mass of {number(sensor.load.mass, 3)} kg, {far} out, on a sensor with noise of {number(force, 2)} N and "
        f"{number(moment, 2)} N m"
    )
    if not ways:
        return doubt("sensor-counts", tool=tool)
    return doubt("sensor-unit", tool=tool, ways="; or ".join(way for _, way in sorted(ways)[:3]))


def _overlap(found: Array, usual: Array) -> Array:
    return (found[:, 0] <= usual[:, 1]) & (found[:, 2] >= usual[:, 0])


def _found(result: Diagnosis, sensor: ForceTorqueSensor, log: ReadingLog) -> Array:
    """Lower bound, estimate, upper bound (3, 3): mass [kg], distance of centre of mass [m], noise ratio [1/m]."""
    from scipy import special

    mass, start = float(result.fit.load[0]), result.fit.unknowns.load.start
    t = float(special.stdtrit(min(float(result.fit.known[start]), 1e9), 1 - _SURE))
    heavy = t * result.fit.mass_deviation
    out, far = float(np.linalg.norm(sensor.load.com)), t * float(np.linalg.norm(result.fit.com_deviation))
    freedom, (moment, force) = result.freedom, result.noise
    weight = mass * float(np.linalg.norm(log.gravity, axis=1).mean())
    noises = (0.0, math.nan, math.inf)
    rough = moment > _rounding(log.readings[:, :3]) and force > _rounding(log.readings[:, 3:])
    if rough and moment > 0 and force > _NO_NOISE * weight:
        times = math.sqrt(float(special.fdtri(freedom, freedom, 1 - _NOISE_SURE)))
        noises = (force / moment / times, force / moment, force / moment * times)
    return np.array([(mass - heavy, mass, mass + heavy), (out - far, out, out + far), noises])


def _rounding(values: Array) -> float:
    """Decimal place to which all values are rounded, such as 0.01; 0 if there are more than six decimals."""
    places = (10.0**-digits for digits in range(7))
    return next((p for p in places if (np.abs(values / p - np.round(values / p)) < 1e-6).all()), 0.0)
