"""Forward kinematics, Jacobians, coordinate rates, and steps on the configuration manifold. MR chapters 4 and 5."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ...core.errors import ShapeError, UnknownNameError, ValueRangeError
from ...core.typing import Array
from ..lie import se3
from ..lie.adjoint import Ad, ad
from ..lie.half_angles import LARGEST_HALF_TURN
from ..lie.labelled import TWIST
from ..model.model import BASE, Body, Model
from .recursion import ancestors, base_poses, joint_poses, zeros


def forward_kinematics(model: Model, q: Array, frame: str) -> Array:
    """Pose of the frame in the base frame, T_s,frame; (4, 4)."""
    target = model.frame(frame)
    T = joint_poses(model, q)
    X = target.pose
    for i in ancestors(model, target.body):
        X = T[i] @ X
    return np.asarray(X)


def link_poses(model: Model, q: Array) -> Array:
    """Pose of every link, T_s,link, in the order of the model's frames; (nlinks, 4, 4)."""
    T_s = base_poses(model, joint_poses(model, q))
    return np.stack([f.pose if f.body == BASE else T_s[f.body] @ f.pose for f in model.frames.values()])


# ── Jacobians of a frame and their rates. Modern Robotics section 5.1

# ``kind`` selects the twist: ``"body"``, V_b in the frame itself; ``"space"``, V_s at the base origin;
# ``"world_aligned"``, at the frame's origin with the axes of {s}.

KINDS = ("body", "space", "world_aligned")
PINOCCHIO = {"LOCAL": "body", "WORLD": "space", "LOCAL_WORLD_ALIGNED": "world_aligned"}
"""Names of the Jacobian's frames in Pinocchio."""


def row_numbers(rows: str | Iterable[int | str] | None) -> tuple[int, ...]:
    """Numbers 0 to 5 of the rows of a twist, from names ("vx vz"), numbers, or None for all six; in the order given.

    Raises UnknownNameError for other names, ValueRangeError for numbers outside 0 to 5, repeated rows, and an empty selection.
    """
    if rows is None:
        return tuple(range(6))
    try:
        entries = rows.replace(",", " ").split() if isinstance(rows, str) else list(rows)
    except TypeError:
        raise ShapeError(
            f"rows={rows!r}: give names, such as {' '.join(TWIST[3:])!r}, or numbers from 0 to 5."
        ) from None
    numbers = tuple(_row_number(row) for row in entries)
    if not numbers:
        raise ValueRangeError(f"rows={rows!r} names no row. Choose from {', '.join(TWIST)}; None means all six.")
    if len(set(numbers)) < len(numbers):
        raise ValueRangeError(
            f"rows={rows!r} names a row twice: {', '.join(TWIST[k] for k in numbers)}. Name each once."
        )
    return numbers


def _row_number(row: object) -> int:
    if isinstance(row, str):
        if row not in TWIST:
            raise UnknownNameError.from_choices("row of a twist", row, TWIST)
        return TWIST.index(row)
    if isinstance(row, bool) or not isinstance(row, int | np.integer):
        raise ShapeError(f"a row of a twist is a name or a number, got {row!r}. Names: {', '.join(TWIST)}.")
    if not 0 <= row < 6:
        raise ValueRangeError(f"row {row} is out of range: a twist has rows 0 to 5, which are {', '.join(TWIST)}.")
    return int(row)


def _columns(model: Model, q: Array, frame: str, kind: str) -> Iterator[tuple[Body, Array]]:
    """(body, its joint's screw axes (k, 6) in the frame of ``kind``) from the base to the frame. MR eq. 5.11, 5.18."""
    target, T = model.frame(frame), joint_poses(model, q)
    path = list(ancestors(model, target.body))
    poses: dict[int, Array] = {}  # of the bodies, in the frame of ``kind``
    if kind == "body":
        X = se3.inverse(target.pose)
        for i in path:
            poses[i] = X
            X = X @ se3.inverse(T[i])
    else:
        T_s = base_poses(model, T)
        shift = np.zeros(3) if kind == "space" or target.body == BASE else (T_s[target.body] @ target.pose)[:3, 3]
        poses = {i: se3.pose(T_s[i][:3, :3], T_s[i][:3, 3] - shift) for i in path}
    for i in reversed(path):
        body = model.bodies[i]
        yield body, body.ratio * Ad(poses[i]).apply(body.joint.axes)


def jacobian(model: Model, q: Array, frame: str, kind: str = "body") -> Array:
    """Jacobian J of the frame; (6, nv)."""
    J = zeros(6, model.nv)
    for body, axes in _columns(model, q, frame, kind):
        _add(J, body, axes)
    return J


def jacobian_rate(model: Model, q: Array, dq: Array, frame: str, kind: str = "body") -> Array:
    """dJ/dt; (6, nv). Each column moves with its body relative to the observing frame: dJ_i = [V_i - V_observer, J_i]."""
    return _rate(model, list(_columns(model, q, frame, kind)), dq, kind)


def _rate(model: Model, columns: list[tuple[Body, Array]], dq: Array, kind: str) -> Array:
    V, twists = zeros(6), []
    for body, axes in columns:
        V = V + dq[body.places[1]] @ axes
        twists.append(V)
    observer = {"space": zeros(6), "body": V, "world_aligned": np.concatenate([zeros(3), V[3:]])}[kind]
    rate = zeros(6, model.nv)
    for (body, axes), V_i in zip(columns, twists, strict=True):
        _add(rate, body, ad(V_i - observer).apply(axes))
    return rate


def jacobian_derivative(model: Model, q: Array, frame: str, kind: str = "body") -> Array:
    """∂J/∂q; (6, nv, nv), last axis along robot.add. dJ/dt is linear in dq, so ∂J/∂q_k is dJ/dt at the k-th unit velocity."""
    columns, units = list(_columns(model, q, frame, kind)), np.eye(model.nv).astype(object)
    D = zeros(6, model.nv, model.nv)
    for body, axes in columns:
        for k in range(body.v_index, body.v_index + len(axes)):
            D[:, :, k] = _rate(model, columns, units[k], kind)
    return D


def _add(J: Array, body: Body, axes: Array) -> None:
    columns = body.places[1]
    J[:, columns] = J[:, columns] + axes.T


def frame_velocity(model: Model, q: Array, dq: Array, frame: str, kind: str = "body") -> Array:
    """V = J dq; (6,)."""
    return np.asarray(jacobian(model, q, frame, kind) @ dq)


def frame_acceleration(model: Model, q: Array, dq: Array, ddq: Array, frame: str, kind: str = "body") -> Array:
    """dV/dt = J ddq + (dJ/dt) dq; (6,)."""
    return np.asarray(jacobian(model, q, frame, kind) @ ddq + jacobian_rate(model, q, dq, frame, kind) @ dq)


def wrench_torques(model: Model, q: Array, F: Array, frame: str) -> Array:
    """J_b' F: torques for a wrench (6,) that the robot exerts at the frame, in its axes; (nv,). MR eq. 5.26."""
    target, T = model.frame(frame), joint_poses(model, q)
    tau = zeros(model.nv)
    F = Ad(target.pose).inverse.T @ F
    for i in ancestors(model, target.body):
        body = model.bodies[i]
        columns = body.places[1]
        tau[columns] = tau[columns] + body.ratio * (body.joint.axes @ F)
        F = Ad(T[i]).inverse.T @ F
    return tau


# ── Coordinate rates: derivatives of q ⊕ v with respect to v at v = 0, and Lie brackets of joint axes

# Along robot.add the pose of each joint is T exp([A v]). With dR = R [w] and dp = R v
#
#     dq = N(q) v,      N of a quaternion Q:  dQ = ½ Q (0, w),
#
# which leaves the length of Q unchanged. Functions that do not depend on this length have the same derivative as along
# robot.add, which normalises Q. Modern Robotics sections 3.2.2 and 3.3.2; quaternions: Appendix B.3.


def coordinate_rates(model: Model, q: Array) -> Array:
    """N in dq/dt = N dq along robot.add; (nq, nv)."""
    N = zeros(model.nq, model.nv)
    for body in model.leaders:
        rows, columns = body.places
        N[rows, columns] = body.joint.rates(q[rows])
    return N


def velocity_map(model: Model, q: Array) -> Array:
    """B in dq = B dq/dt, the inverse of N; (nv, nq). Rates that change a quaternion's length give no velocity.

    The columns of N are orthogonal, so the rows of B are the scaled columns.
    """
    return np.stack([column / (column @ column) for column in coordinate_rates(model, q).T])


def rates_of_coordinates(model: Model, q: Array, dq: Array) -> Array:
    """Coordinate rates dq/dt = N dq; (nq,)."""
    return np.asarray(coordinate_rates(model, q) @ dq)


def moving_parts(model: Model, q: Array) -> Iterator[tuple[Array, Array]]:
    """(x, its derivative along each velocity (*x.shape, nv)) for q, and for each rotation that a quaternion describes.

    dR = R [w] is short and half zeros, unlike the derivative through the quaternion.
    """
    yield q, coordinate_rates(model, q)
    for body in model.leaders:
        q_columns, v_columns = body.places
        for R, slopes in body.joint.rotation_slopes(q[q_columns]):
            dR = zeros(3, 3, model.nv)
            dR[:, :, v_columns] = slopes
            yield R, dR


def brackets(model: Model) -> Array:
    """Structure constants c of each joint's screw axes, [S_a, S_b] = Σ c_abd S_d, which form a Lie algebra; (nv, nv, nv)."""
    c = np.zeros((model.nv, model.nv, model.nv))
    for body in model.leaders:
        columns = body.places[1]
        axes = body.joint.axes
        products = np.zeros((len(axes), len(axes), 6))
        for a, b in np.ndindex(*products.shape[:2]):
            products[a, b] = ad(axes[a]) @ axes[b]
        c[columns, columns, columns] = np.round(products @ np.linalg.pinv(axes), 12)  # orthonormal axes: 0, 1 and -1
    return c


# ── Integration on symbols: branch-free q ⊕ v, and quaternion normalisation


def add(model: Model, q: Array, dv: Array) -> Array:
    """q ⊕ dv; (nq,)."""
    return add_at_angles(model, q, dv, q)


def add_at_angles(model: Model, q: Array, dv: Array, angles: Array) -> Array:
    """q ⊕ dv, each joint along its constant twist for unit time; (nq,). :meth:`twistwrench.Robot.add` on symbols.

    ``angles`` are the values of q to use in sines, cosines and rotations.
    """
    q_new = q.copy()
    for body in model.leaders:
        q_columns, v_columns = body.places
        q_new[q_columns] = body.joint.add(q[q_columns], dv[v_columns], angles[q_columns])
    return q_new


def subtract(model: Model, q1: Array, q0: Array) -> Array:
    """q1 ⊖ q0; (nv,). :meth:`twistwrench.Robot.subtract`."""
    difference = np.full(model.nv, 0.0, object)
    for body in model.leaders:
        q_columns, v_columns = body.places
        difference[v_columns] = body.joint.subtract(q1[q_columns], q0[q_columns])
    return difference


def halfway(model: Model, q: Array, dv: Array, angles: Array) -> Array:
    """q ⊕ dv/2; (nq,). Sines of its angles need no range reduction: they come from the angle-sum formulas."""
    q_new, turn = add_at_angles(model, q, 0.5 * dv, angles), 0.5 * dv
    for body in model.leaders:
        if body.joint.angle is not None:
            i, k = body.q_index + body.joint.angle[0], body.v_index + body.joint.angle[1]
            q_new[i] = angles[i].turned(turn[k].clip(-LARGEST_HALF_TURN, LARGEST_HALF_TURN))
    return q_new


def normalise_quaternions(model: Model, q: Array, share: Any = 1.0) -> Array:
    """q with its quaternions normalised, or moved towards unit length by the fraction ``share``; (nq,)."""
    q_new = q.copy()
    for columns in model.quaternions:
        Q = q[columns]
        q_new[columns] = Q + share * (1.0 / np.sqrt(Q @ Q) - 1.0) * Q
    return q_new
