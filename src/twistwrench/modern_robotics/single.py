"""One rotation or one motion at a time, in plain floats: the formulas of :mod:`twistwrench.lie` where a call is all there is.

NumPy takes about a microsecond for each operation on three numbers, and ``lie``, made for batches, is some fifty of them. The
thresholds are those of ``lie/series.py``; ``tests/test_modern_robotics_traps.py`` holds both to each other and to 50 digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..lie import series

Vector = Sequence[float]
Rows = list[list[float]]

__all__ = ["REACH", "cross", "exp3", "exp6", "hat", "log3", "log6"]

REACH = 1e4
"""The largest angle [rad] taken here. Beyond it, and for NaN, ``lie`` does what it does."""


def hat(w: Vector) -> Rows:
    """[w]. MR eq. 3.30."""
    x, y, z = w
    return [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]


def exp3(w: Vector) -> Rows | None:
    """1 + a [w] + b [w]², a = sin θ/θ, b = (1 - cos θ)/θ² by half angles; None beyond :data:`REACH`. MR eq. 3.51."""
    x, y, z = w
    theta = math.hypot(x, y, z)
    if not theta < REACH:
        return None
    half = 0.5 * theta
    a = math.sin(theta) / theta if theta else 1.0
    b = _half_angle(half)
    bx, by = b * x, b * y
    xx, xy, xz, yy, yz, zz = bx * x, bx * y, bx * z, by * y, by * z, b * z * z
    ax, ay, az = a * x, a * y, a * z
    return [
        [1.0 - (yy + zz), xy - az, xz + ay],
        [xy + az, 1.0 - (xx + zz), yz - ax],
        [xz - ay, yz + ax, 1.0 - (xx + yy)],
    ]


def exp6(V: Vector) -> Rows | None:
    """The rotation of omega, and v + b ω×v + c ω×(ω×v) with c = (θ - sin θ)/θ³. MR eq. 3.88."""
    w, v = V[:3], V[3:]
    R = exp3(w)
    if R is None:
        return None
    theta = math.hypot(*w)
    b, c = _half_angle(0.5 * theta), float(series.theta_minus_sin_over_cube(theta))
    p = _plus(v, b, c, w)
    return [[*R[0], p[0]], [*R[1], p[1]], [*R[2], p[2]], [0.0, 0.0, 0.0, 1.0]]


def log3(R: Rows) -> list[float]:
    """Exponential coordinates through the largest row of q q', four times the quaternion; at every angle.

    Source: Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
    """
    (a, b, c), (d, e, f), (g, h, i) = R
    trace = a + e + i
    k = max(range(4), key=(trace, a, e, i).__getitem__)
    if k == 0:
        s, x, y, z = 1.0 + trace, h - f, c - g, d - b
    elif k == 1:
        s, x, y, z = h - f, 1.0 + 2.0 * a - trace, d + b, c + g
    elif k == 2:
        s, x, y, z = c - g, d + b, 1.0 + 2.0 * e - trace, h + f
    else:
        s, x, y, z = d - b, c + g, h + f, 1.0 + 2.0 * i - trace
    length = math.hypot(x, y, z)
    if length == 0.0:
        return [0.0, 0.0, 0.0]
    rate = 2.0 * math.atan2(length, abs(s)) / math.copysign(length, s)
    return [rate * x, rate * y, rate * z]


def log6(w: Vector, p: Vector) -> list[float]:
    """The sliding part p - ½ ω×p + c ω×(ω×p), c = (1 - (θ/2) cot(θ/2))/θ², after the turning part w. MR eq. 3.91, 3.92."""
    return [*w, *_plus(p, -0.5, float(series.cot_term(math.hypot(*w))), w)]


def _half_angle(half: float) -> float:
    """(1 - cos θ)/θ² = ½ (sin(θ/2)/(θ/2))²."""
    s = math.sin(half) / half if half else 1.0
    return 0.5 * s * s


def _plus(v: Vector, b: float, c: float, w: Vector) -> list[float]:
    """v + b ω×v + c ω×(ω×v)."""
    first = cross(w, v)
    second = cross(w, first)
    return [x + b * y + c * z for x, y, z in zip(v, first, second, strict=True)]


def cross(a: Vector, b: Vector) -> list[float]:
    """a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
