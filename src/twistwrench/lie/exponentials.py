"""exp and log of one rotation or rigid motion, on numbers and on symbols, without a branch: the text of the compiled forms.

Each comes with a number that says whether it counts: the square of the angle, or how far a matrix is from a rotation or a
pose, in squares; ``lie/compiled.py`` looks at it. Modern Robotics sections 3.2.3 and 3.3.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.rotation_checks import gaps
from ..typing import Array
from .half_angle import cotangent_quotient, half_angle, half_turn, short_way
from .quadratic import quadratic
from .se3 import pose
from .so3 import cross


def rotation_exp(w: Array) -> tuple[Array, Any]:
    """exp [w], (3, 3), and w·w. MR eq. 3.51, by half angles."""
    square = w @ w
    half, cosine, _ = half_angle(square)
    return quadratic(w, 2.0 * half * cosine, 2.0 * half * half), square


def pose_exp(V: Array) -> tuple[Array, Any]:
    """exp [V], (4, 4), and ω·ω. MR eq. 3.88."""
    w, v = V[:3], V[3:]
    R, square = rotation_exp(w)
    half, _, third = half_angle(square)
    return pose(R, slide(w, v, 2.0 * half * half, third)), square


def rotation_log(R: Array) -> tuple[Array, Any]:
    """w with exp [w] = R and |w| ≤ π, and how far R is from a rotation. MR section 3.2.3.3, through the quaternion."""
    Q = _quaternion(R)
    Q = short_way(Q[0]) * Q
    return 2.0 * half_turn(Q[0], Q[1:] @ Q[1:]) * Q[1:], sum(gap * gap for gap in gaps(R))


def pose_log(T: Array) -> tuple[Array, Any]:
    """V with exp [V] = T and |ω| ≤ π, and how far T is from a pose. MR eq. 3.92."""
    w, off = rotation_log(T[:3, :3])
    last = T[3] - np.eye(4)[3]
    return np.concatenate([w, slide(w, T[:3, 3], -0.5, cotangent_quotient(w @ w))]), off + last @ last


def slide(w: Array, v: Array, b: Any, c: Any) -> Array:
    """v + b ω×v + c ω×(ω×v): the left Jacobian times v, or its inverse."""
    wv = cross(w, v)
    return np.asarray(v + b * wv + c * cross(w, wv))


def _quaternion(R: Array) -> Array:
    """The unit quaternion of R, of either sign: row k of what follows is 4 q_k q, and the largest q_k is the safest.

    Source: Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1(3), 1978.
    """
    (a, b, c), (d, e, f), (g, h, i) = R
    trace = a + e + i
    others = (
        (a, [h - f, 1.0 + 2.0 * a - trace, d + b, c + g]),
        (e, [c - g, d + b, 1.0 + 2.0 * e - trace, h + f]),
        (i, [d - b, c + g, h + f, 1.0 + 2.0 * i - trace]),
    )
    largest, Q = trace, np.array([1.0 + trace, h - f, c - g, d - b])
    for size, row in others:
        better = 0.5 - 0.5 * short_way(largest - size)  # 1 or 0
        largest, Q = largest + better * (size - largest), Q + better * (np.array(row) - Q)
    return np.asarray(Q / np.sqrt(Q @ Q))
