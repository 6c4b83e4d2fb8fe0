"""Samples of a motion as a curve: without jumps that are no motion, its derivatives, and configurations between samples."""

from __future__ import annotations

from fractions import Fraction
from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..algorithms.coordinate_rates import brackets
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
    spline = make_interp_spline(local, x, k=DEGREE)
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

    With ξ(t) of degree 5 in t, q = q_k ⊕ ξ is a Hermite polynomial along the joint twists. For joints of several degrees,
    V = Σ (-ad ξ)ⁿ/(n + 1)! dξ, and dξ is the series' inverse of V.
    """
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, max(0, len(time) - 2))
    after = np.minimum(k + 1, len(time) - 1)
    h = (time[after] - time[k])[..., None]
    h = np.where(h > 0, h, 1.0)
    s = np.clip((t - time[k])[..., None] / h, 0.0, 1.0)
    way = _way(robot, q[k], q[after])
    groups = brackets(robot.model) if any(body.joint.nv > 1 for body in robot.model.leaders) else None
    rate1, bend1 = _rates(groups, way, dq[after], ddq[after])
    v0, a0, v1, a1 = h * dq[k], h * h * ddq[k], h * rate1, h * h * bend1
    e0, e1, e2 = way - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c3, c4, c5 = 10 * e0 - 4 * e1 + 0.5 * e2, -15 * e0 + 7 * e1 - e2, 6 * e0 - 3 * e1 + 0.5 * e2
    x = s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
    rate = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
    bend = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h)
    return np.asarray(robot.add(q[k], x)), *_twists(groups, x, rate, bend)


def _twists(groups: Array | None, x: Array, rate: Array, bend: Array) -> tuple[Array, Array]:
    """V and dV where q = q_k ⊕ x, from the derivatives of x."""
    if groups is None:
        return rate, bend
    (V, dV), term, slope = (rate, bend), rate, bend
    for c in _FORWARD[1:]:  # terms (ad x)ⁿ rate, and their derivatives
        term, slope = _bracket(groups, x, term), _bracket(groups, rate, term) + _bracket(groups, x, slope)
        V, dV = V + c * term, dV + c * slope
    return V, dV


def _rates(groups: Array | None, x: Array, V: Array, dV: Array) -> tuple[Array, Array]:
    """The derivatives of x where q = q_k ⊕ x, from V and dV."""
    if groups is None:
        return V, dV
    terms = [V]
    for _ in _INVERSE[1:]:
        terms.append(_bracket(groups, x, terms[-1]))
    rate = sum(c * term for c, term in zip(_INVERSE, terms, strict=True))
    slope = bend = dV
    for c, term in zip(_INVERSE[1:], terms, strict=False):
        slope = _bracket(groups, rate, term) + _bracket(groups, x, slope)
        bend = bend + c * slope
    return np.asarray(rate), np.asarray(bend)


def _bracket(groups: Array, x: Array, y: Array) -> Array:
    return np.asarray(np.einsum("...a,abd,...b->...d", x, groups, y, optimize=True))


def _series(n: int) -> tuple[Array, Array]:
    """Coefficients of (1 - e⁻ˣ)/x and of x/(1 - e⁻ˣ), up to xⁿ⁻¹."""
    forward = [Fraction((-1) ** i, factorial(i + 1)) for i in range(n)]
    inverse = [Fraction(1)]
    for i in range(1, n):
        inverse.append(-sum((forward[j] * inverse[i - j] for j in range(1, i + 1)), Fraction(0)))
    return np.array(forward, float), np.array(inverse, float)


_FORWARD, _INVERSE = _series(27)
"""A turn of half a revolution between two samples leaves 1e-8 out, one of 1 rad nothing."""
