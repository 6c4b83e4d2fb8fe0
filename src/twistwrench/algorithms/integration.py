"""Steps along a motion, on symbols: q ⊕ v without a branch, and what puts quaternions back to unit length."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..lie.half_angle import LARGEST_HALF_TURN
from ..model.model import Model
from ..typing import Array


def add(model: Model, q: Array, dv: Array) -> Array:
    """q ⊕ dv; (nq,)."""
    return moved(model, q, dv, q)


def moved(model: Model, q: Array, dv: Array, angles: Array) -> Array:
    """q ⊕ dv, each joint along its constant twist for unit time; (nq,). :meth:`twistwrench.Robot.add` on symbols.

    ``angles`` are q again, for sines, cosines and rotations.
    """
    found = q.copy()
    for body in model.leaders:
        mine, rates = body.places
        found[mine] = body.joint.add(q[mine], dv[rates], angles[mine])
    return found


def subtract(model: Model, q1: Array, q0: Array) -> Array:
    """q1 ⊖ q0; (nv,). :meth:`twistwrench.Robot.subtract`."""
    found = np.full(model.nv, 0.0, object)
    for body in model.leaders:
        mine, rates = body.places
        found[rates] = body.joint.subtract(q1[mine], q0[mine])
    return found


def halfway(model: Model, q: Array, dv: Array, angles: Array) -> Array:
    """q ⊕ dv/2, (nq,), whose angles need no look at their size: of sums, sines are taken part by part."""
    found, turn = moved(model, q, 0.5 * dv, angles), 0.5 * dv
    for body in model.leaders:
        if body.joint.angle is not None:
            at, k = body.q_index + body.joint.angle[0], body.v_index + body.joint.angle[1]
            found[at] = angles[at].turned(turn[k].clip(-LARGEST_HALF_TURN, LARGEST_HALF_TURN))
    return found


def normalised(model: Model, q: Array, share: Any = 1.0) -> Array:
    """q with its quaternions of unit length, or by a ``share`` of the way there; (nq,)."""
    found = q.copy()
    for mine in model.quaternions:
        Q = q[mine]
        found[mine] = Q + share * (1.0 / np.sqrt(Q @ Q) - 1.0) * Q
    return found
