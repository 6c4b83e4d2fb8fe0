"""Smoothing of noisy logs by penalised least squares on the third derivative (Whittaker smoother).

The smoothed z minimises |x - z|² + strength |D z|², with D the third divided differences in units of the typical time
step h. On a uniform grid the gain at angular frequency w is 1/(1 + strength (2 sin(w h/2))^6). Source: Whittaker, "On a
new method of graduation", Proc. Edinburgh Math. Soc. 41, 1923.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.errors import TrajectoryError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.algorithms.kinematics import brackets
from ..mechanics.model.model import Model
from .coordinates import Coordinates
from .log_table import slices

if TYPE_CHECKING:
    from ..robot import Robot

_STRENGTHS = 10.0 ** np.arange(-1.0, 15.01, 0.5)
_MAX_MARGIN = 16384
"""Largest number of samples on either side that may affect a smoothed sample."""
_GLITCH_SIGMAS, _GLITCH_STRENGTH, _GLITCH_REACH, _MAX_GLITCH_SHARE = 6.0, 10.0, 5, 0.01
"""Criteria of a glitch: more than ``_GLITCH_SIGMAS`` standard deviations off the curve of strength ``_GLITCH_STRENGTH``, the
largest within ``_GLITCH_REACH`` samples, and at most this share of all samples. Otherwise the motion is fast.
"""
_MAX_ALIKE_SAMPLES = 10.0
_MAX_NOISE_GAIN, _MAX_RISK = 0.95, 4.0
"""Upper bound of the noise gain of a smoother, and of its risk in units of the noise variance: mean squared correction
plus twice the passed noise. The risk is 2 without smoothing; the rest allows for the error of the noise estimate.
"""
_DECAY = 28.0
"""exp(-28) < 1e-12 bounds the influence of a sample beyond the margin."""


def smooth(t: Array, x: Array, strength: float, step: float) -> Array:
    """Smooth columns with a common strength; t (n,), x (n,) or (n, k) → shape of x. ``step``: typical time step."""
    if strength == 0.0 or len(x) < 4:
        return x.copy()
    from scipy.linalg import solveh_banded

    D = _third_differences(t, step)
    # Solved for u in the correction x - z = D' u, so that rounding errors are relative to the small correction.
    bands = np.zeros((4, len(D)))  # upper form of D D' + 1/strength
    for k in range(4):
        bands[3 - k, k:] = np.sum(D[k:, : 4 - k] * D[: len(D) - k, k:], axis=1)
    bands[3] += 1.0 / strength
    weights = D.reshape(*D.shape, *[1] * (x.ndim - 1))
    u = solveh_banded(bands, _apply(weights, x), check_finite=False, overwrite_ab=True)
    z = x.copy()
    for k in range(4):
        z[k : k + len(u)] -= weights[:, k] * u
    return z


def _third_differences(t: Array, step: float) -> Array:
    """Rows of D as their four weights (n-3, 4); (-1, 3, -3, 1) on a uniform grid with this step."""
    t = np.lib.stride_tricks.sliding_window_view(t, 4) / step
    gaps = t[:, :, None] - t[:, None, :]
    gaps[:, np.arange(4), np.arange(4)] = 1.0
    span = (t[:, 3] - t[:, 0])[:, None] / 3.0
    return np.asarray(6.0 / gaps.prod(axis=2) * np.sqrt(span))


def _apply(D: Array, x: Array) -> Array:
    return np.asarray(sum(D[:, k] * x[k : k + len(D)] for k in range(4)))


def best_strength(
    times: Sequence[Array], parts: Sequence[Array], noise: float, step: float, grid: float = 0.0
) -> float:
    """Strength with the least expected error of z, for an approximately known noise; 0 if smoothing does not help.

    Generalised cross-validation: mean squared residual over the squared fraction of noise in it. Mallows' criterion
    would need the exact noise and sometimes smooths too little: the noise of a short log is known to 25 %, and the
    noise of late stamps is concentrated in few fast rows. Rounding to a ``grid`` is not white if a slow motion stays on
    a grid point for several samples: the passed variance is multiplied by their number. Source: Craven and Wahba,
    "Smoothing noisy data with spline functions", Numer. Math. 31, 1979.
    """
    if noise == 0.0:
        return 0.0
    best_so_far, least_risk = 0.0, math.inf
    alike = alike_samples(parts, grid, noise)
    parts = [_without_glitches(t, x, noise, step) for t, x in zip(times, parts, strict=True)]
    for strength in _STRENGTHS:
        if margin_of(float(strength)) > _MAX_MARGIN:
            break
        squares = 0.0
        for t, x in zip(times, parts, strict=True):
            squares += float(np.sum((x - smooth(t, x, float(strength), step)) ** 2))
        mean = squares / sum(map(len, parts))
        gain = min(_MAX_NOISE_GAIN, alike * _noise_gain(float(strength)))
        if mean + 2.0 * noise**2 * gain > _MAX_RISK * noise**2:
            continue  # the motion is too fast for this strength
        risk = mean / (1.0 - gain) ** 2
        if risk < least_risk:
            best_so_far, least_risk = float(strength), risk
    return best_so_far


def alike_samples(parts: Sequence[Array], grid: float, noise: float) -> float:
    """Mean number of consecutive samples with equal rounding error, 1 to 10; 1 without a grid.

    A slow motion stays on a grid point for many samples. Beyond ten samples, the log shows only stairs. Only the
    rounding part of ``noise`` counts.
    """
    if grid == 0.0 or noise == 0.0:
        return 1.0
    rounding = min(1.0, grid**2 / 12.0 / noise**2)
    total = weighted = 0.0
    for x in parts:
        steps = np.diff(x)
        jumps = np.flatnonzero(np.abs(steps) > 0.5 * grid)
        climbs = steps[jumps[1:]] * steps[jumps[:-1]] > 0  # monotonic: the motion crosses a whole grid step
        between = np.diff(jumps)[climbs].astype(float)
        total += float(between.sum())
        weighted += float((between**2).sum())
    length = 1.0
    if total:
        length = min(_MAX_ALIKE_SAMPLES, max(1.0, weighted / total))
    return 1.0 + (length - 1.0) * rounding


def _without_glitches(t: Array, x: Array, noise: float, step: float) -> Array:
    """Replace isolated outliers, which would prevent smoothing, by interpolation between their neighbours."""
    from scipy.ndimage import maximum_filter1d

    for _ in range(2):
        size = np.abs(x - smooth(t, x, _GLITCH_STRENGTH, step))
        largest_nearby = maximum_filter1d(size, 2 * _GLITCH_REACH + 1, mode="nearest")
        glitches = (size > _GLITCH_SIGMAS * noise) & (size >= largest_nearby)
        if not 0 < np.count_nonzero(glitches) <= max(2, _MAX_GLITCH_SHARE * len(x)):
            break
        x = np.where(glitches, np.interp(t, t[~glitches], x[~glitches]), x)
    return x


@cache
def _noise_gain(strength: float) -> float:
    """Mean gain of the smoother over all frequencies; 1 at strength 0."""
    w = (np.arange(20000) + 0.5) * (math.pi / 20000)
    return float(np.mean(1.0 / (1.0 + strength * (2.0 * np.sin(w / 2)) ** 6)))


def margin_of(strength: float) -> int:
    """Number of samples beyond which the influence of a sample is below 1e-12, on a uniform grid."""
    # The slowest pole of 1/(1 + strength w^6) decays by exp(-½ strength^(-1/6)) a sample.
    return math.ceil(2.0 * _DECAY * math.pow(max(strength, 1e-3), 1.0 / 6.0)) + 16


# ── Samples of a motion as a curve: continuity, derivatives, and configurations between samples

DEGREE = 5
"""Degree of the spline."""
FEWEST = DEGREE + 1
"""Minimum number of samples for velocities and accelerations."""


class Between(NamedTuple):
    """Configurations between two samples, and their place."""

    q: Array
    """Configurations (..., nq)."""
    before: Array
    after: Array
    """Indices (...) of the neighbouring samples."""
    share: Array
    """Fraction (..., 1) of the interval, 0 to 1."""


def continuous(model: Model, q: Array) -> Array:
    """Coordinates q (n, nq) without jumps of angles by a turn and sign changes of quaternions."""
    coordinates, q = Coordinates.from_model(model), q.astype(float)
    q[:, coordinates.endless] = np.unwrap(q[:, coordinates.endless], axis=0)
    for place in coordinates.quaternions:
        turned = np.einsum("ij,ij->i", q[1:, place], q[:-1, place]) < 0
        q[1:, place] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]
    return q


_GAP, _PAUSE = 5.0, 0.05
"""Ratio to the typical and adjacent time steps, and duration [s], above which a time step is a pause."""


def stretch_edges(t: Array) -> list[int]:
    """Edges [0, …, n] of the stretches between pauses; stretches with fewer than six samples are merged.

    >>> stretch_edges(np.r_[np.arange(10) * 0.01, 2.0 + np.arange(10) * 0.01])
    [0, 10, 20]
    """
    if len(t) <= FEWEST or _largest_step(t) <= _PAUSE:
        return [0, len(t)]
    steps = np.diff(t)
    shortest_pause = max(_PAUSE, _GAP * float(np.median(steps)))
    if steps.max() <= shortest_pause:
        return [0, len(t)]
    adjacent_steps = np.maximum(np.r_[0.0, steps[:-1]], np.r_[steps[1:], 0.0])
    edges = [0]
    for k in np.flatnonzero(steps > np.maximum(shortest_pause, _GAP * adjacent_steps)).tolist():
        if k + 1 - edges[-1] >= FEWEST and len(t) - k - 1 >= FEWEST:
            edges.append(k + 1)
    return [*edges, len(t)]


def _largest_step(t: Array) -> float:
    """Largest time step of times (n,); in portions, as a log may have millions of rows."""
    return max(float(np.diff(t[s.start : s.stop + 1]).max(initial=0.0)) for s in slices(len(t)))


def spline_rates(t: Array, x: Array) -> tuple[Array, Array]:
    """First and second derivatives (n, k) at the samples (n, k), by a quintic spline per stretch between pauses."""
    first, second = np.empty(x.shape), np.empty(x.shape)
    for a, b in pairwise(stretch_edges(t)):
        first[a:b], second[a:b] = _spline_rates(t[a:b], x[a:b])
    return first, second


def _spline_rates(t: Array, x: Array) -> tuple[Array, Array]:
    from scipy.interpolate import make_interp_spline

    # Time from the window's middle, so that large stamps (seconds since 1970) do not lose digits.
    local = t - t[len(t) // 2]
    close = np.diff(local) <= 0
    if close.any():
        k = int(close.argmax())
        raise TrajectoryError(
            f"time stamps of rows {k + 1} and {k + 2}, {float(t[k])!r} and {float(t[k + 1])!r} s, differ by less than a number "
            f"resolves beside the {printed(float(t[-1] - t[0]))} s of the motion. Remove one of the rows."
        )
    try:
        spline = make_interp_spline(local, x, k=DEGREE)
    except (np.linalg.LinAlgError, ValueError):
        steps = np.diff(local)
        raise TrajectoryError(
            f"no smooth curve leads through the samples: their time stamps are {printed(float(steps.min()))} to "
            f"{printed(float(steps.max()))} s apart. Remove the rows whose stamps are wrong."
        ) from None
    return spline(local, 1), spline(local, 2)


def between(robot: Robot, time: Array, q: Array, t: Array) -> Between:
    """Configurations at times t (...), along constant joint twists from each sample (n, nq) to the next."""
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(0, len(time) - 2))
    after = np.minimum(k + 1, len(time) - 1)
    step = time[after] - time[k]
    share = np.clip((t - time[k]) / np.where(step > 0, step, 1.0), 0.0, 1.0)[..., None]
    return Between(robot.add(q[k], share * _way(robot, q[k], q[after])), k, after, share)


def _way(robot: Robot, q0: Array, q1: Array) -> Array:
    """Joint twists (..., nv) from one configuration to the other in unit time."""
    way = np.asarray(robot.subtract(q1, q0))
    endless = [b.v_index for b in robot.model.leaders if b.joint.nv == 1 and b.joint.wraps]
    way[..., endless] -= 2 * np.pi * np.round(way[..., endless] / (2 * np.pi))  # a log may jump by a turn
    return way


def states_between(robot: Robot, time: Array, q: Array, dq: Array, ddq: Array, t: Array) -> tuple[Array, Array, Array]:
    """States at times t (...) by quintic Hermite interpolation of the samples and their rates.

    q = q_k ⊕ x with a quintic polynomial x(t) along the joint twists; for joints with several degrees of freedom
    V = Σ (-ad x)ⁿ/(n + 1)! dx. If q, dq and ddq of two samples contradict each other, as rounded positions with smooth
    accelerations do, the polynomial would oscillate. The twist is then constant between the two, and rates are linear.
    """
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(0, len(time) - 2))
    after = np.minimum(k + 1, len(time) - 1)
    h = (time[after] - time[k])[..., None]
    h = np.where(h > 0, h, 1.0)
    s = np.clip((t - time[k])[..., None] / h, 0.0, 1.0)
    way = _way(robot, q[k], q[after])
    several = [body.places[1] for body in robot.model.leaders if body.joint.nv > 1]  # entries of such joints
    groups = None
    v1, a1 = dq[after], ddq[after]
    if several:
        groups = _brackets(robot.model)
        v1, a1 = _rates(groups, way, v1, a1)
    v0, a0, v1, a1 = h * dq[k], h * h * ddq[k], h * v1, h * h * a1
    swing = 60 * np.abs(way - 0.5 * (v0 + v1) + (a1 - a0) / 12) + 6 * np.abs(v1 - v0 - 0.5 * (a0 + a1))
    fits = swing <= _SWING * np.maximum(np.abs(a0), np.abs(a1))
    for entries in several:
        fits[..., entries] = fits[..., entries].all(axis=-1, keepdims=True)
    e0, e1, e2 = way - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c3, c4, c5 = 10 * e0 - 4 * e1 + 0.5 * e2, -15 * e0 + 7 * e1 - e2, 6 * e0 - 3 * e1 + 0.5 * e2
    x = np.where(fits, s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5)))), s * way)
    V = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
    dV = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h)
    if groups is not None:
        V, dV = _twists(groups, x, V, dV)
    V = np.where(fits, V, (1 - s) * dq[k] + s * dq[after])
    dV = np.where(fits, dV, (1 - s) * ddq[k] + s * ddq[after])
    return np.asarray(robot.add(q[k], x)), V, dV


@lru_cache(8)
def _brackets(model: Model) -> Array:
    """Structure constants c (nv, nv²) with ad(x) = x c."""
    c = brackets(model)
    return np.ascontiguousarray(np.swapaxes(c, 1, 2)).reshape(len(c), -1)


def _ad(groups: Array, x: Array) -> Array:
    """Matrices ad(x) (..., nv, nv)."""
    return (x @ groups).reshape(*x.shape, x.shape[-1])


def _term_count(x: Array) -> int:
    """Number of significant terms of the series, which decrease at least as (|x|/2π)ⁿ."""
    bound = min(2.0 * float(np.abs(x).max(initial=1e-3)), 4.0)  # of the norm of ad(x)
    return min(len(_FORWARD), math.ceil(_DIGITS / math.log(2 * math.pi / bound)))


def _twists(groups: Array, x: Array, rate: Array, bend: Array) -> tuple[Array, Array]:
    """V and dV for q = q_k ⊕ x, from the derivatives of x."""
    A, dA = _ad(groups, x), _ad(groups, rate)
    term, slope = rate[..., None], bend[..., None]
    V, dV = term, slope
    for c in _FORWARD[1 : _term_count(x)]:  # terms (ad x)ⁿ rate, and their derivatives
        term, slope = A @ term, dA @ term + A @ slope
        V, dV = V + c * term, dV + c * slope
    return V[..., 0], dV[..., 0]


def _rates(groups: Array, x: Array, V: Array, dV: Array) -> tuple[Array, Array]:
    """Derivatives of x for q = q_k ⊕ x, from V and dV."""
    A = _ad(groups, x)
    terms = [V[..., None]]
    for _ in _INVERSE[1 : _term_count(x)]:
        terms.append(A @ terms[-1])
    rate = np.asarray(sum(c * term for c, term in zip(_INVERSE, terms, strict=False)))[..., 0]
    dA = _ad(groups, rate)
    slope = bend = dV[..., None]
    for c, term in zip(_INVERSE[1:], terms, strict=False):
        slope = dA @ term + A @ slope
        bend = bend + c * slope
    return rate, bend[..., 0]


def _series(n: int) -> tuple[Array, Array]:
    """Coefficients of (1 - e⁻ˣ)/x and of x/(1 - e⁻ˣ), up to xⁿ⁻¹."""
    forward = [Fraction((-1) ** i, math.factorial(i + 1)) for i in range(n)]
    inverse = [Fraction(1)]
    for i in range(1, n):
        inverse.append(-sum((forward[j] * inverse[i - j] for j in range(1, i + 1)), Fraction(0)))
    return np.array(forward, float), np.array(inverse, float)


_DIGITS = 39.0
"""Negative logarithm of the truncation error."""
_SWING = 0.1
"""Largest acceleration that the polynomial may add to the straight line, relative to the larger of the two samples."""
_FORWARD, _INVERSE = _series(27)
"""The truncation error is 1e-8 for half a revolution between two samples, and negligible for 1 rad."""
