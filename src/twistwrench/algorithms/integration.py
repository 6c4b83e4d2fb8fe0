"""Steps along a motion, on symbols: q ⊕ v without a branch, and what puts quaternions back to unit length.

Quotients such as sin(x)/x are taken at √(x² + 1e-30). That is x to the last bit from 1e-7 on, and below it the quotients are
what they are at 0; where one is wrong there, it multiplies x². So no angle needs a series, and none is 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lie import quaternion, so3
from ..model.model import Body, Model

Array = NDArray[Any]

__all__ = ["halfway", "moved", "normalised"]

TINY = 1e-30
MOST = 2.0**14
"""Half the angle [rad] that a step may turn, so that code need not ask whether sines can be taken: no motion has such steps."""


def moved(model: Model, q: Array, dv: Array, angles: Array) -> Array:
    """q ⊕ dv, each joint along its constant twist for unit time; (nq,). :meth:`twistwrench.Robot.add` on symbols.

    ``angles`` are q again, for sines, cosines and rotations.
    """
    found = q.copy()
    for body in model.leaders:
        mine, k = slice(body.q_index, body.q_index + body.joint.nq), body.v_index
        x, v = q[mine], dv[k : k + body.joint.nv]
        found[mine] = _MOVES[body.joint.kind](x, v, angles[mine]) if body.joint.kind in _MOVES else x + v
    return found


def halfway(model: Model, q: Array, dv: Array, angles: Array) -> Array:
    """q ⊕ dv/2, (nq,), whose angles need no look at their size: of sums, sines are taken part by part."""
    found, turn = moved(model, q, 0.5 * dv, angles), 0.5 * dv
    for body in model.leaders:
        at, k = body.q_index, body.v_index
        if body.joint.nv == 1:
            found[at] = angles[at].turned(turn[k].clip(-MOST, MOST))
        elif body.joint.kind == "planar":
            found[at + 2] = angles[at + 2].turned(turn[k].clip(-MOST, MOST))
    return found


def normalised(model: Model, q: Array, share: Any = 1.0) -> Array:
    """q with its quaternions of unit length, or by a ``share`` of the way there; (nq,)."""
    found = q.copy()
    for body in _floating(model):
        Q = q[body.q_index : body.q_index + 4]
        found[body.q_index : body.q_index + 4] = Q + share * (1.0 / np.sqrt(Q @ Q) - 1.0) * Q
    return found


def _floating(model: Model) -> list[Body]:
    return [body for body in model.leaders if body.joint.kind == "floating"]


def _floating_moved(q: Array, dv: Array, same: Array) -> Array:
    Q, p, w, v = q[:4], q[4:], dv[:3], dv[3:]
    Q = Q / np.sqrt(Q @ Q)
    angle, half, cosine = _half_angle(w @ w)
    third = (1.0 - 2.0 * half * cosine) / (angle * angle)  # (angle - sin(angle)) / angle³
    wv = so3.cross(w, v)
    slide = v + 2.0 * half * half * wv + third * so3.cross(w, wv)  # the left Jacobian times v; MR eq. 3.88
    turned = quaternion.multiply(Q, np.concatenate([[cosine], half * w]))
    return np.concatenate([turned, p + quaternion.rotation(same[:4]) @ slide])


def _planar_moved(q: Array, dv: Array, same: Array) -> Array:
    (x, y, theta), (w, vx, vy) = q, dv
    _, half, cosine = _half_angle(w * w)
    a, b = 2.0 * half * cosine, 2.0 * half * half * w  # sin(w)/w and (1 - cos w)/w
    dx, dy = a * vx - b * vy, b * vx + a * vy
    c, s = np.cos(same[2]), np.sin(same[2])
    return np.array([x + c * dx - s * dy, y + s * dx + c * dy, theta + w], object)


def _half_angle(square: Any) -> tuple[Any, Any, Any]:
    """The angle, sin(angle/2) / angle, and cos(angle/2)."""
    angle = np.sqrt(square + TINY)
    half = (0.5 * angle).clip(-MOST, MOST)
    return angle, np.sin(half) / angle, np.cos(half)


_MOVES = {"floating": _floating_moved, "planar": _planar_moved}
