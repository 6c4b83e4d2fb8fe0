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
"""Strengths that are compared."""
_MAX_MARGIN = 16384
"""Largest number of samples on either side that may affect a smoothed sample."""
_GLITCH_STRENGTH = 10.0
"""Strength of the curve from which glitches depart."""
_GLITCH_SIGMAS = 6.0
"""Departure of a glitch from this curve, in standard deviations of the noise."""
_SAMPLES_BESIDE_GLITCH = 5
"""Number of samples on either side of a glitch whose departures are smaller."""
_MAX_GLITCH_SHARE = 0.01
"""Largest share of all samples that may be glitches; if more depart as far, the motion is fast."""
_MAX_ALIKE_SAMPLES = 10.0
"""Largest number of consecutive samples whose rounding errors count as equal."""
_MAX_NOISE_GAIN = 0.95
"""Upper bound of the noise gain of a smoother, below 1 as the criterion divides by 1 - gain."""
_MAX_RISK = 4.0
"""Upper bound of the risk, mean squared correction plus twice the passed noise, in units of the noise variance.

The risk is 2 without smoothing. The other 2 allow for the error of the noise estimate.
"""
_MARGIN_DECAY = 28.0
"""Exponent of the influence of a sample beyond the margin: exp(-28) < 1e-12."""
_MARGIN_RESERVE = 16
"""Number of samples added to every margin."""
_WEIGHT_COUNT = 4
"""Number of weights of a third difference."""
_FREQUENCY_COUNT = 20000
"""Number of frequencies of a mean over all of them."""


def smooth(t: Array, x: Array, strength: float, step: float) -> Array:
    """Smooth columns with a common strength; t (n,), x (n,) or (n, k) → shape of x. ``step``: typical time step."""
    if strength == 0.0 or len(x) < _WEIGHT_COUNT:
        return x.copy()
    from scipy.linalg import solveh_banded

    D = _third_differences(t, step)
    # z = x - D' u with (D D' + 1/strength) u = D x. Rounding errors are then relative to the small correction D' u.
    bands = np.zeros((_WEIGHT_COUNT, len(D)))  # of D D' + 1/strength, the main diagonal last
    for k in range(_WEIGHT_COUNT):  # products of rows that are k apart
        common_count = _WEIGHT_COUNT - k  # of samples that both rows weigh
        bands[common_count - 1, k:] = np.sum(D[k:, :common_count] * D[: len(D) - k, k:], axis=1)
    bands[-1] += 1.0 / strength
    weights = D.reshape(*D.shape, *[1] * (x.ndim - 1))  # equal for all columns of x
    third_differences = _apply(weights, x)
    u = solveh_banded(bands, third_differences, check_finite=False, overwrite_ab=True)
    z = x.copy()
    for k in range(_WEIGHT_COUNT):
        z[k : k + len(u)] -= weights[:, k] * u
    return z


def _third_differences(t: Array, step: float) -> Array:
    """Rows of D as their four weights (n-3, 4); (-1, 3, -3, 1) on a uniform grid with this step.

    The third divided difference has the weights 1/Π_{j≠k} (t_k - t_j). It is scaled by 3! and the root of the relative
    span of its four samples.
    """
    windows = np.lib.stride_tricks.sliding_window_view(t, _WEIGHT_COUNT) / step  # four times of each row
    time_differences = windows[:, :, None] - windows[:, None, :]
    time_differences[:, np.arange(_WEIGHT_COUNT), np.arange(_WEIGHT_COUNT)] = 1.0  # no factor for j = k
    relative_span = (windows[:, 3] - windows[:, 0])[:, None] / 3.0  # 1 on a uniform grid
    return np.asarray(6.0 / time_differences.prod(axis=2) * np.sqrt(relative_span))


def _apply(weights: Array, x: Array) -> Array:
    """D x, from the weights (n-3, 4, …) of D's rows."""
    return np.asarray(sum(weights[:, k] * x[k : k + len(weights)] for k in range(_WEIGHT_COUNT)))


def best_strength(
    times: Sequence[Array], parts: Sequence[Array], noise: float, step: float, grid: float = 0.0
) -> float:
    """Strength with the least expected error of z, for an approximately known noise; 0 if smoothing does not help.

    ``times`` and ``parts``: times (n,) and samples (n,) of each part of a curve. ``noise``: standard deviation. ``grid``:
    step of the rounded samples, 0 if they are not rounded.

    Generalised cross-validation minimises the mean squared residual over (1 - gain)², where the gain is the share of
    noise that the smoother passes. Mallows' criterion would need the exact noise and sometimes smooths too little: the
    noise of a short log is known to 25 %, and the noise of late stamps is concentrated in few fast rows. Rounding is not
    white if a slow motion stays on a grid point for several samples: the gain is multiplied by their number. Source:
    Craven and Wahba, "Smoothing noisy data with spline functions", Numer. Math. 31, 1979.
    """
    if noise == 0.0:
        return 0.0
    chosen_strength = 0.0
    least_criterion = math.inf
    samples_per_error = alike_samples(parts, grid, noise)
    parts = [_without_glitches(t, x, noise, step) for t, x in zip(times, parts, strict=True)]
    sample_count = sum(map(len, parts))
    for strength in _STRENGTHS.tolist():
        if margin_of(strength) > _MAX_MARGIN:
            break
        sum_of_squares = 0.0
        for t, x in zip(times, parts, strict=True):
            sum_of_squares += float(np.sum((x - smooth(t, x, strength, step)) ** 2))
        mean_square = sum_of_squares / sample_count
        gain = min(_MAX_NOISE_GAIN, samples_per_error * _noise_gain(strength))
        risk = mean_square + 2.0 * noise**2 * gain
        if risk > _MAX_RISK * noise**2:
            continue  # the motion is too fast for this strength
        criterion = mean_square / (1.0 - gain) ** 2
        if criterion < least_criterion:
            chosen_strength = strength
            least_criterion = criterion
    return chosen_strength


def alike_samples(parts: Sequence[Array], grid: float, noise: float) -> float:
    """Mean number of consecutive samples with equal rounding error, 1 to 10; 1 without a grid.

    A slow motion stays on a grid point for many samples. Beyond ten samples, the log shows only stairs. The number
    counts in proportion to the share of rounding in the variance of the noise.
    """
    if grid == 0.0 or noise == 0.0:
        return 1.0
    rounding_variance = grid**2 / 12.0
    rounding_share = min(1.0, rounding_variance / noise**2)
    total_length = total_square = 0.0
    for x in parts:
        steps = np.diff(x)
        jumps = np.flatnonzero(np.abs(steps) > 0.5 * grid)
        # Between two jumps in one direction the motion crosses a whole grid step.
        is_monotonic = steps[jumps[1:]] * steps[jumps[:-1]] > 0
        run_lengths = np.diff(jumps)[is_monotonic].astype(float)
        total_length += float(run_lengths.sum())
        total_square += float((run_lengths**2).sum())
    mean_length = 1.0
    if total_length:
        length_per_sample = total_square / total_length  # mean over samples, so that a run counts by its length
        mean_length = min(_MAX_ALIKE_SAMPLES, max(1.0, length_per_sample))
    return 1.0 + (mean_length - 1.0) * rounding_share


def _without_glitches(t: Array, x: Array, noise: float, step: float) -> Array:
    """Replace isolated outliers, which would prevent smoothing, by interpolation between their neighbours."""
    from scipy.ndimage import maximum_filter1d

    max_glitches = max(2, _MAX_GLITCH_SHARE * len(x))
    for _ in range(2):  # the curve follows large glitches; without them it shows the smaller ones beside them
        departure = np.abs(x - smooth(t, x, _GLITCH_STRENGTH, step))
        largest_nearby = maximum_filter1d(departure, 2 * _SAMPLES_BESIDE_GLITCH + 1, mode="nearest")
        is_glitch = (departure > _GLITCH_SIGMAS * noise) & (departure >= largest_nearby)
        if not 0 < np.count_nonzero(is_glitch) <= max_glitches:
            break
        interpolated = np.interp(t, t[~is_glitch], x[~is_glitch])
        x = np.where(is_glitch, interpolated, x)
    return x


@cache
def _noise_gain(strength: float) -> float:
    """Mean gain of the smoother over all frequencies on a uniform grid with h = 1; 1 at strength 0."""
    w = (np.arange(_FREQUENCY_COUNT) + 0.5) * (math.pi / _FREQUENCY_COUNT)
    return float(np.mean(1.0 / (1.0 + strength * (2.0 * np.sin(w / 2)) ** 6)))


def margin_of(strength: float) -> int:
    """Number of samples beyond which the influence of a sample is below 1e-12, on a uniform grid."""
    # The slowest pole of 1/(1 + strength w^6) decays by exp(-½ strength^(-1/6)) a sample.
    positive_strength = max(strength, 1e-3)  # far below the least that is compared
    samples_per_decay = 2.0 * math.pow(positive_strength, 1.0 / 6.0)
    return math.ceil(_MARGIN_DECAY * samples_per_decay) + _MARGIN_RESERVE


# ── Samples of a motion as a curve: continuity, derivatives, and configurations between samples

DEGREE = 5
"""Degree of the spline."""
FEWEST = DEGREE + 1
"""Minimum number of samples for velocities and accelerations."""


class Between(NamedTuple):
    """Configurations between two samples, with the indices of these."""

    q: Array
    """Configurations (..., nq)."""
    before: Array
    """Index (...) of the last sample before each configuration."""
    after: Array
    """Index (...) of the sample after that one."""
    share: Array
    """Fraction (..., 1) of the interval, 0 to 1."""


def continuous(model: Model, q: Array) -> Array:
    """Coordinates q (n, nq) without the jumps of angles by a turn, and without sign changes of quaternions."""
    coordinates = Coordinates.from_model(model)
    q = q.astype(float)
    q[:, coordinates.endless] = np.unwrap(q[:, coordinates.endless], axis=0)
    for entries in coordinates.quaternions:
        sign_changes = np.einsum("ij,ij->i", q[1:, entries], q[:-1, entries]) < 0
        has_opposite_sign = np.cumsum(sign_changes) % 2 == 1  # after an odd number of changes
        q[1:, entries] *= np.where(has_opposite_sign, -1.0, 1.0)[:, None]
    return q


_MIN_PAUSE_RATIO = 5.0
"""Ratio to the typical and the adjacent time steps above which a time step may be a pause."""
_MIN_PAUSE = 0.05
"""Shortest pause [s]."""


def stretch_edges(t: Array) -> list[int]:
    """Edges [0, …, n] of the stretches between pauses; stretches with fewer than six samples are merged.

    >>> stretch_edges(np.r_[np.arange(10) * 0.01, 2.0 + np.arange(10) * 0.01])
    [0, 10, 20]
    """
    if len(t) <= FEWEST or _largest_step(t) <= _MIN_PAUSE:
        return [0, len(t)]
    steps = np.diff(t)
    shortest_pause = max(_MIN_PAUSE, _MIN_PAUSE_RATIO * float(np.median(steps)))
    if steps.max() <= shortest_pause:
        return [0, len(t)]
    adjacent_steps = np.maximum(np.r_[0.0, steps[:-1]], np.r_[steps[1:], 0.0])  # the longer of the two
    is_pause = steps > np.maximum(shortest_pause, _MIN_PAUSE_RATIO * adjacent_steps)
    edges = [0]
    for row_before in np.flatnonzero(is_pause).tolist():
        edge = row_before + 1
        if edge - edges[-1] >= FEWEST and len(t) - edge >= FEWEST:
            edges.append(edge)
    return [*edges, len(t)]


def _largest_step(t: Array) -> float:
    """Largest time step of times (n,); in portions, as a log may have millions of rows."""
    largest = 0.0
    for portion in slices(len(t)):
        steps = np.diff(t[portion.start : portion.stop + 1])  # + 1: the step to the next portion
        largest = max(largest, float(steps.max(initial=0.0)))
    return largest


def spline_rates(t: Array, x: Array) -> tuple[Array, Array]:
    """First and second derivatives (n, k) at the samples (n, k), by a quintic spline per stretch between pauses."""
    dx = np.empty(x.shape)
    ddx = np.empty(x.shape)
    for begin, end in pairwise(stretch_edges(t)):
        dx[begin:end], ddx[begin:end] = _spline_rates(t[begin:end], x[begin:end])
    return dx, ddx


def _spline_rates(t: Array, x: Array) -> tuple[Array, Array]:
    """First and second derivatives of the quintic spline through the samples (n, k) of one stretch."""
    from scipy.interpolate import make_interp_spline

    # Time from the stretch's middle, so that large stamps (seconds since 1970) do not lose digits.
    local_time = t - t[len(t) // 2]
    does_not_increase = np.diff(local_time) <= 0
    if does_not_increase.any():
        k = int(does_not_increase.argmax())
        raise TrajectoryError(
            f"time stamps of rows {k + 1} and {k + 2}, {float(t[k])!r} and {float(t[k + 1])!r} s, differ by less than a number "
            f"resolves beside the {printed(float(t[-1] - t[0]))} s of the motion. Remove one of the rows."
        )
    try:
        spline = make_interp_spline(local_time, x, k=DEGREE)
    except (np.linalg.LinAlgError, ValueError):
        steps = np.diff(local_time)
        raise TrajectoryError(
            f"no smooth curve leads through the samples: their time stamps are {printed(float(steps.min()))} to "
            f"{printed(float(steps.max()))} s apart. Remove the rows whose stamps are wrong."
        ) from None
    return spline(local_time, 1), spline(local_time, 2)


def between(robot: Robot, time: Array, q: Array, t: Array) -> Between:
    """Configurations at times t (...), along constant joint twists from each sample (n, nq) to the next."""
    before, after = _neighbours(time, t)
    step = time[after] - time[before]
    share = np.clip((t - time[before]) / np.where(step > 0, step, 1.0), 0.0, 1.0)[..., None]
    twists = _twists_between(robot, q[before], q[after])
    q_between = robot.add(q[before], share * twists)
    return Between(q_between, before, after, share)


def _neighbours(time: Array, t: Array) -> tuple[Array, Array]:
    """Indices of the samples at ``time`` (n,) before and after the times t (...); both are 0 for a single sample."""
    before = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(0, len(time) - 2))
    after = np.minimum(before + 1, len(time) - 1)
    return before, after


def _twists_between(robot: Robot, q0: Array, q1: Array) -> Array:
    """Joint twists (..., nv) from one configuration to the other in unit time."""
    twists = np.asarray(robot.subtract(q1, q0))
    endless_joints = [body.v_index for body in robot.model.leaders if body.joint.nv == 1 and body.joint.wraps]
    whole_turns = np.round(twists[..., endless_joints] / (2 * np.pi))  # a log may jump by a turn
    twists[..., endless_joints] -= 2 * np.pi * whole_turns
    return twists


def states_between(robot: Robot, time: Array, q: Array, dq: Array, ddq: Array, t: Array) -> tuple[Array, Array, Array]:
    """States at times t (...) by quintic Hermite interpolation of the samples and their rates.

    q = q_k ⊕ x with a quintic polynomial x(t) along the joint twists; for joints with several degrees of freedom
    V = Σ (-ad x)ⁿ/(n + 1)! dx. If q, dq and ddq of two samples contradict each other, as rounded positions with smooth
    accelerations do, the polynomial would oscillate. The twist is then constant between the two, and rates are linear.

    With s = (t - t_k)/h in a step of duration h, the polynomial is v0 s + a0 s²/2 + c3 s³ + c4 s⁴ + c5 s⁵. At s = 1 it
    reaches ``twists`` with the derivatives v1 and a1 along s.
    """
    before, after = _neighbours(time, t)
    h = (time[after] - time[before])[..., None]
    h = np.where(h > 0, h, 1.0)
    s = np.clip((t - time[before])[..., None] / h, 0.0, 1.0)
    twists = _twists_between(robot, q[before], q[after])
    # Entries of the joints with several degrees of freedom.
    joint_entries = [body.places[1] for body in robot.model.leaders if body.joint.nv > 1]
    brackets_matrix = None
    v1, a1 = dq[after], ddq[after]
    if joint_entries:
        brackets_matrix = _brackets(robot.model)
        v1, a1 = _rates(brackets_matrix, twists, v1, a1)
    v0, a0 = h * dq[before], h * h * ddq[before]
    v1, a1 = h * v1, h * h * a1
    # Bound of how far the polynomial's second derivative departs from the line between a0 and a1.
    extra_acceleration = 60 * np.abs(twists - 0.5 * (v0 + v1) + (a1 - a0) / 12) + 6 * np.abs(v1 - v0 - 0.5 * (a0 + a1))
    is_consistent = extra_acceleration <= _MAX_EXTRA_ACCELERATION * np.maximum(np.abs(a0), np.abs(a1))
    for entries in joint_entries:
        is_consistent[..., entries] = is_consistent[..., entries].all(axis=-1, keepdims=True)
    # What v0 s + a0 s²/2 and its two derivatives miss at s = 1; c3, c4 and c5 make it up.
    e0, e1, e2 = twists - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c3 = 10 * e0 - 4 * e1 + 0.5 * e2
    c4 = -15 * e0 + 7 * e1 - e2
    c5 = 6 * e0 - 3 * e1 + 0.5 * e2
    x = np.where(is_consistent, s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5)))), s * twists)
    V = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
    dV = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h)
    if brackets_matrix is not None:
        V, dV = _twists(brackets_matrix, x, V, dV)
    V = np.where(is_consistent, V, (1 - s) * dq[before] + s * dq[after])
    dV = np.where(is_consistent, dV, (1 - s) * ddq[before] + s * ddq[after])
    return np.asarray(robot.add(q[before], x)), V, dV


@lru_cache(8)
def _brackets(model: Model) -> Array:
    """Structure constants as a matrix (nv, nv²), so that ``x @ matrix`` are the entries of ad(x)."""
    c = brackets(model)
    return np.ascontiguousarray(np.swapaxes(c, 1, 2)).reshape(len(c), -1)


def _ad(brackets_matrix: Array, x: Array) -> Array:
    """Matrices ad(x) (..., nv, nv)."""
    return (x @ brackets_matrix).reshape(*x.shape, x.shape[-1])


def _term_count(x: Array) -> int:
    """Number of significant terms of both series: the n-th term decreases at least as (|ad x|/2π)ⁿ."""
    bound_of_ad = min(2.0 * float(np.abs(x).max(initial=1e-3)), 4.0)
    return min(len(_FORWARD), math.ceil(_MAX_LOG_DECREASE / math.log(2 * math.pi / bound_of_ad)))


def _twists(brackets_matrix: Array, x: Array, dx: Array, ddx: Array) -> tuple[Array, Array]:
    """V and dV for q = q_k ⊕ x, from the derivatives of x."""
    A = _ad(brackets_matrix, x)
    dA = _ad(brackets_matrix, dx)
    term = dx[..., None]
    term_rate = ddx[..., None]
    V, dV = term, term_rate
    for c in _FORWARD[1 : _term_count(x)]:
        term, term_rate = A @ term, dA @ term + A @ term_rate  # (ad x)ⁿ dx, and its derivative
        V, dV = V + c * term, dV + c * term_rate
    return V[..., 0], dV[..., 0]


def _rates(brackets_matrix: Array, x: Array, V: Array, dV: Array) -> tuple[Array, Array]:
    """Derivatives dx and ddx for q = q_k ⊕ x, from V and dV."""
    A = _ad(brackets_matrix, x)
    terms = [V[..., None]]  # (ad x)ⁿ V
    for _ in _INVERSE[1 : _term_count(x)]:
        terms.append(A @ terms[-1])
    dx = np.asarray(sum(c * term for c, term in zip(_INVERSE, terms, strict=False)))[..., 0]
    dA = _ad(brackets_matrix, dx)
    term_rate = ddx = dV[..., None]
    for c, term in zip(_INVERSE[1:], terms, strict=False):
        term_rate = dA @ term + A @ term_rate
        ddx = ddx + c * term_rate
    return dx, ddx[..., 0]


def _series(n: int) -> tuple[Array, Array]:
    """Coefficients of (1 - e⁻ˣ)/x and of x/(1 - e⁻ˣ), up to xⁿ⁻¹."""
    forward = [Fraction((-1) ** i, math.factorial(i + 1)) for i in range(n)]
    inverse = [Fraction(1)]
    for i in range(1, n):  # the product of the series is 1, so the sum of forward[j] inverse[i - j] over j is zero
        known_terms = (forward[j] * inverse[i - j] for j in range(1, i + 1))
        inverse.append(-sum(known_terms, Fraction(0)))
    return np.array(forward, float), np.array(inverse, float)


_MAX_LOG_DECREASE = 39.0
"""Negative natural logarithm of the first omitted term relative to the first term: exp(-39) ≈ 1e-17."""
_MAX_EXTRA_ACCELERATION = 0.1
"""Largest acceleration that the polynomial may add to the straight line, relative to the larger of the two samples."""
_FORWARD, _INVERSE = _series(27)
"""Coefficients of both series. For half a revolution between two samples the truncation error is 1e-8."""
