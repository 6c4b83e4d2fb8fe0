"""The forces of constraints as wrenches on the links of the open robot, each in the axes of its own frame.

With T_cb = (R, p), a closure's λ is the wrench F = (m, f) that {b} applies to {a} at the origin of {b}, along the axes of {c}:

    by the robot at {b}:  (R'm, R'f),        by the robot at {a}:  -(R_ac (m + p × f) + p_ac × R_ac f, R_ac f)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..algorithms.constraints import Closure, Rolling, names, place_of
from ..model.model import BASE
from ..typing import Array

if TYPE_CHECKING:
    from .closed_robot import ClosedRobot


def applied(closed: ClosedRobot, q: Array, lam: Array) -> list[tuple[str, Array]]:
    """(frame, (..., 6)): the wrenches by the robot that act on its links as λ (..., k) does, none for the ground."""
    found, poses = [], iter(np.moveaxis(_closure_poses(closed, q), -3, 0))
    for name, c in zip(names(closed.constraints), closed.constraints, strict=True):
        F = closed.wrenches(lam)[name]
        if isinstance(c, Rolling):
            found.append((c.frame, _at_frame(c.kind, closed.robot.forward_kinematics(q, c.frame), F)))
            continue
        T_cb = next(poses)
        R = np.swapaxes(T_cb[..., :3, :3], -1, -2)
        if place_of(closed.robot.model, c.frame_b).body != BASE:
            found.append((c.frame_b, _turned(R, F)))
        if place_of(closed.robot.model, c.frame_a).body != BASE:
            found.append((c.frame_a, -_moved(c.T_ac[:3, :3], c.T_ac[:3, 3], _moved(np.eye(3), T_cb[..., :3, 3], F))))
    return found


def _closure_poses(closed: ClosedRobot, q: Array) -> Array:
    if not any(isinstance(c, Closure) for c in closed.constraints):
        return np.zeros((*q.shape[:-1], 0, 4, 4))
    return np.asarray(closed.robot.engine.call("closure_poses", q, constraints=closed.constraints))


def _at_frame(kind: str, T: Array, F: Array) -> Array:
    """A wrench along the axes and at the point that the Jacobian's ``kind`` names, in the frame at T."""
    if kind == "body":
        return F
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    return _turned(R, F if kind == "world_aligned" else _moved(np.eye(3), -T[..., :3, 3], F))


def _turned(R: Array, F: Array) -> Array:
    m, f = ((R @ x[..., None])[..., 0] for x in (F[..., :3], F[..., 3:]))
    return np.concatenate([m, f], axis=-1)


def _moved(R: Array, p: Array, F: Array) -> Array:
    """A wrench of one frame in another, in which the first has the pose (R, p)."""
    turned = _turned(R, F)
    return np.concatenate([turned[..., :3] + np.cross(p, turned[..., 3:]), turned[..., 3:]], axis=-1)
