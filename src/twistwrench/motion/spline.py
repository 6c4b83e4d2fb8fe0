"""Samples of a motion as a curve: without jumps that are no motion, its derivatives, and configurations between samples."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..algorithms.coordinate_rates import brackets
from ..core.printed_numbers import printed
from ..errors import TrajectoryError
from ..model.model import Model
from ..typing import Array
from .coordinates import Coordinates

if TYPE_CHECKING:
    from ..robot import Robot

DEGREE = 5
"""Of the spline."""
FEWEST = DEGREE + 1
"""Samples that velocities and accelerations can be derived from."""


class Between(NamedTuple):
    """Configurations between two samples, and where that is."""

    q: Array
    """(..., nq)."""
    before: Array
    after: Array
    """(...) numbers of the samples."""
    share: Array
    """(..., 1) of the way from one to the other, 0 to 1."""


def continuous(model: Model, q: Array) -> Array:
    """q (n, nq) without the jumps that are no motion: of angles by a turn, of quaternions to their negatives."""
    coordinates, q = Coordinates.of(model), q.astype(float)
    q[:, coordinates.endless] = np.unwrap(q[:, coordinates.endless], axis=0)
    for place in coordinates.quaternions:
        turned = np.einsum("ij,ij->i", q[1:, place], q[:-1, place]) < 0
        q[1:, place] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]
    return q


def spline_rates(t: Array, x: Array) -> tuple[Array, Array]:
    """First and second derivatives at the samples of the quintic spline through them; (n,), (n, k) → (n, k) twice."""
    from scipy.interpolate import make_interp_spline

    # Time from the window's middle, so that large clock readings (seconds since 1970) cost no digits.
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
    """Configurations at times t (...), along the constant joint twists that lead from one sample (n, nq) to the next."""
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(0, len(time) - 2))
    after = np.minimum(k + 1, len(time) - 1)
    step = time[after] - time[k]
    share = np.clip((t - time[k]) / np.where(step > 0, step, 1.0), 0.0, 1.0)[..., None]
    return Between(robot.add(q[k], share * _way(robot, q[k], q[after])), k, after, share)


def _way(robot: Robot, q0: Array, q1: Array) -> Array:
    """Joint twists (..., nv) that lead from one configuration to the other in unit time."""
    way = np.asarray(robot.subtract(q1, q0))
    endless = [b.v_index for b in robot.model.leaders if b.joint.nv == 1 and b.joint.wraps]
    way[..., endless] -= 2 * np.pi * np.round(way[..., endless] / (2 * np.pi))  # a log may jump by a turn
    return way


def states_between(robot: Robot, time: Array, q: Array, dq: Array, ddq: Array, t: Array) -> tuple[Array, Array, Array]:
    """States at times t (...) inside of those of the samples, which they meet with their rates.

    q = q_k ⊕ x with x(t) of degree 5, a Hermite polynomial along the joint twists; of joints of several degrees
    V = Σ (-ad x)ⁿ/(n + 1)! dx. Where q, dq and ddq of two samples contradict each other, as rounded positions beside smooth
    accelerations do, that polynomial would swing, and the twist is constant between the two with rates on straight lines.
    """
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(0, len(time) - 2))
    after = np.minimum(k + 1, len(time) - 1)
    h = (time[after] - time[k])[..., None]
    h = np.where(h > 0, h, 1.0)
    s = np.clip((t - time[k])[..., None] / h, 0.0, 1.0)
    way = _way(robot, q[k], q[after])
    several = [body.places[1] for body in robot.model.leaders if body.joint.nv > 1]
    groups = _brackets(robot.model) if several else None
    ends = dq[after], ddq[after]
    v1, a1 = ends if groups is None else _rates(groups, way, *ends)
    v0, a0, v1, a1 = h * dq[k], h * h * ddq[k], h * v1, h * h * a1
    swing = 60 * np.abs(way - 0.5 * (v0 + v1) + (a1 - a0) / 12) + 6 * np.abs(v1 - v0 - 0.5 * (a0 + a1))
    fits = swing <= _SWING * np.maximum(np.abs(a0), np.abs(a1))
    for mine in several:
        fits[..., mine] = fits[..., mine].all(axis=-1, keepdims=True)
    e0, e1, e2 = way - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c3, c4, c5 = 10 * e0 - 4 * e1 + 0.5 * e2, -15 * e0 + 7 * e1 - e2, 6 * e0 - 3 * e1 + 0.5 * e2
    x = np.where(fits, s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5)))), s * way)
    rates = (
        (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h,
        (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h),
    )
    straight = ((1 - s) * y[k] + s * y[after] for y in (dq, ddq))
    smooth = rates if groups is None else _twists(groups, x, *rates)
    V, dV = (np.where(fits, one, other) for one, other in zip(smooth, straight, strict=True))
    return np.asarray(robot.add(q[k], x)), V, dV


@lru_cache(8)
def _brackets(model: Model) -> Array:
    """c (nv, nv²) with ad(x) = x c."""
    c = brackets(model)
    return np.ascontiguousarray(np.swapaxes(c, 1, 2)).reshape(len(c), -1)


def _ad(groups: Array, x: Array) -> Array:
    """(..., nv, nv)."""
    return (x @ groups).reshape(*x.shape, x.shape[-1])


def _needed(x: Array) -> int:
    """How many terms of the series matter: they fall as (|x|/2π)ⁿ at least."""
    reach = min(2.0 * float(np.abs(x).max(initial=1e-3)), 4.0)
    return min(len(_FORWARD), math.ceil(_DIGITS / math.log(2 * math.pi / reach)))


def _twists(groups: Array, x: Array, rate: Array, bend: Array) -> tuple[Array, Array]:
    """V and dV where q = q_k ⊕ x, from the derivatives of x."""
    A, dA = _ad(groups, x), _ad(groups, rate)
    term, slope = rate[..., None], bend[..., None]
    V, dV = term, slope
    for c in _FORWARD[1 : _needed(x)]:  # terms (ad x)ⁿ rate, and their derivatives
        term, slope = A @ term, dA @ term + A @ slope
        V, dV = V + c * term, dV + c * slope
    return V[..., 0], dV[..., 0]


def _rates(groups: Array, x: Array, V: Array, dV: Array) -> tuple[Array, Array]:
    """The derivatives of x where q = q_k ⊕ x, from V and dV."""
    A = _ad(groups, x)
    terms = [V[..., None]]
    for _ in _INVERSE[1 : _needed(x)]:
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
"""Minus the logarithm of what is left out."""
_SWING = 0.1
"""Largest acceleration that a polynomial between two samples adds to the straight line, over the larger one of theirs."""
_FORWARD, _INVERSE = _series(27)
"""A turn of half a revolution between two samples leaves 1e-8 out, one of 1 rad nothing."""
