"""Jacobians of a frame and their rates. Modern Robotics section 5.1.

``kind`` says which twist the Jacobian gives: ``"body"``, V_b in the frame itself; ``"space"``, V_s at the base origin;
``"world_aligned"``, at the frame's origin with the axes of {s}.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..lie import se3
from ..lie.adjoint import Ad, ad
from ..model.model import BASE, Body, Model
from ..typing import Array
from .recursion import ancestors, base_poses, joint_poses, zeros

KINDS = ("body", "space", "world_aligned")
PINOCCHIO = {"LOCAL": "body", "WORLD": "space", "LOCAL_WORLD_ALIGNED": "world_aligned"}
"""What Pinocchio calls them."""


def _columns(model: Model, q: Array, frame: str, kind: str) -> Iterator[tuple[Body, Array]]:
    """(body, its joint's screw axes (k, 6) seen from the observer) from the base to the frame. MR eq. 5.11, 5.18."""
    place, T = model.frame(frame), joint_poses(model, q)
    path = list(ancestors(model, place.body))
    seen: dict[int, Array] = {}
    if kind == "body":
        X = se3.inverse(place.pose)
        for i in path:
            seen[i] = X
            X = X @ se3.inverse(T[i])
    else:
        T_s = base_poses(model, T)
        shift = np.zeros(3) if kind == "space" or place.body == BASE else (T_s[place.body] @ place.pose)[:3, 3]
        seen = {i: se3.pose(T_s[i][:3, :3], T_s[i][:3, 3] - shift) for i in path}
    for i in reversed(path):
        body = model.bodies[i]
        yield body, body.ratio * (Ad(seen[i]) @ body.joint.axes)


def jacobian(model: Model, q: Array, frame: str, kind: str = "body") -> Array:
    """J of the frame; (6, nv)."""
    J = zeros(6, model.nv)
    for body, axes in _columns(model, q, frame, kind):
        _add(J, body, axes)
    return J


def jacobian_rate(model: Model, q: Array, dq: Array, frame: str, kind: str = "body") -> Array:
    """dJ/dt; (6, nv). Each column turns with its body, as the observer sees it: dJ_i = [V_i - V_observer, J_i]."""
    return _rate(model, list(_columns(model, q, frame, kind)), dq, kind)


def _rate(model: Model, columns: list[tuple[Body, Array]], dq: Array, kind: str) -> Array:
    V, twists = zeros(6), []
    for body, axes in columns:
        V = V + dq[body.places[1]] @ axes
        twists.append(V)
    observer = {"space": zeros(6), "body": V, "world_aligned": np.concatenate([zeros(3), V[3:]])}[kind]
    rate = zeros(6, model.nv)
    for (body, axes), V_i in zip(columns, twists, strict=True):
        _add(rate, body, ad(V_i - observer) @ axes)
    return rate


def jacobian_derivative(model: Model, q: Array, frame: str, kind: str = "body") -> Array:
    """∂J/∂q; (6, nv, nv), the last axis along robot.add. dJ/dt is linear in dq, so ∂J/∂q_k is dJ/dt at the k-th unit rate."""
    columns, units = list(_columns(model, q, frame, kind)), np.eye(model.nv).astype(object)
    D = zeros(6, model.nv, model.nv)
    for body, axes in columns:
        for k in range(body.v_index, body.v_index + len(axes)):
            D[:, :, k] = _rate(model, columns, units[k], kind)
    return D


def _add(J: Array, body: Body, axes: Array) -> None:
    mine = body.places[1]
    J[:, mine] = J[:, mine] + axes.T


def frame_velocity(model: Model, q: Array, dq: Array, frame: str, kind: str = "body") -> Array:
    """V = J dq; (6,)."""
    return np.asarray(jacobian(model, q, frame, kind) @ dq)


def frame_acceleration(model: Model, q: Array, dq: Array, ddq: Array, frame: str, kind: str = "body") -> Array:
    """dV/dt = J ddq + (dJ/dt) dq; (6,)."""
    return np.asarray(jacobian(model, q, frame, kind) @ ddq + jacobian_rate(model, q, dq, frame, kind) @ dq)


def wrench_torques(model: Model, q: Array, F: Array, frame: str) -> Array:
    """J_b' F: the torques for a wrench (6,) that the robot applies at the frame, in the frame; (nv,). MR eq. 5.26."""
    place, T = model.frame(frame), joint_poses(model, q)
    tau = zeros(model.nv)
    F = Ad(place.pose).inverse.T @ F
    for i in ancestors(model, place.body):
        body = model.bodies[i]
        mine = body.places[1]
        tau[mine] = tau[mine] + body.ratio * (body.joint.axes @ F)
        F = Ad(T[i]).inverse.T @ F
    return tau
