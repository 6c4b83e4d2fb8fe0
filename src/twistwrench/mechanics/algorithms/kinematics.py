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
    poses_in_parents = joint_poses(model, q)
    T = target.pose
    for i in ancestors(model, target.body):
        T = poses_in_parents[i] @ T
    return np.asarray(T)


def link_poses(model: Model, q: Array) -> Array:
    """Pose of every link, T_s,link, in the order of the model's frames; (nlinks, 4, 4)."""
    T_s = base_poses(model, joint_poses(model, q))
    poses = []
    for frame in model.frames.values():
        T = frame.pose
        if frame.body != BASE:
            T = T_s[frame.body] @ T
        poses.append(T)
    return np.stack(poses)


# ── Jacobians of a frame and their rates. Modern Robotics section 5.1

KINDS = ("body", "space", "world_aligned")
"""Kinds of twists of a frame, and so of its Jacobian, for the parameter ``kind`` of the following functions.

``"body"`` is V_b, in the frame itself; ``"space"`` is V_s, at the base origin; ``"world_aligned"`` is the twist at the frame's
origin with the axes of {s}.
"""
PINOCCHIO = {"LOCAL": "body", "WORLD": "space", "LOCAL_WORLD_ALIGNED": "world_aligned"}
"""Names of the Jacobian's frames in Pinocchio."""


def row_numbers(rows: str | Iterable[int | str] | None) -> tuple[int, ...]:
    """Indices 0 to 5 of rows of a twist, in the order given, from names ("vx vz") or indices; None means all six.

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
    """Index of a row, from its name or index; raises an error for other input."""
    if isinstance(row, str):
        if row not in TWIST:
            raise UnknownNameError.from_choices("row of a twist", row, TWIST)
        return TWIST.index(row)
    if isinstance(row, bool) or not isinstance(row, int | np.integer):
        raise ShapeError(f"a row of a twist is a name or a number, got {row!r}. Names: {', '.join(TWIST)}.")
    if not 0 <= row < 6:
        raise ValueRangeError(f"row {row} is out of range: a twist has rows 0 to 5, which are {', '.join(TWIST)}.")
    return int(row)


def _axes_on_path(model: Model, q: Array, frame: str, kind: str) -> Iterator[tuple[Body, Array]]:
    """Bodies from base to frame, each with its joint's screw axes (k, 6) in the frame of ``kind``. MR eq. 5.11, 5.18."""
    target = model.frame(frame)
    poses_in_parents = joint_poses(model, q)
    path = list(ancestors(model, target.body))
    poses: dict[int, Array] = {}  # of the bodies on the path, in the frame of ``kind``
    if kind == "body":
        T = se3.inverse(target.pose)
        for i in path:
            poses[i] = T
            T = T @ se3.inverse(poses_in_parents[i])
    else:
        T_s = base_poses(model, poses_in_parents)
        origin = np.zeros(3)  # of the frame of ``kind``, which has the axes of {s}
        if kind == "world_aligned" and target.body != BASE:
            T_target = T_s[target.body] @ target.pose
            origin = T_target[:3, 3]
        for i in path:
            R, p = T_s[i][:3, :3], T_s[i][:3, 3]
            poses[i] = se3.pose(R, p - origin)
    for i in reversed(path):
        body = model.bodies[i]
        yield body, body.ratio * Ad(poses[i]).apply(body.joint.axes)


def jacobian(model: Model, q: Array, frame: str, kind: str = "body") -> Array:
    """Jacobian J of the frame; (6, nv)."""
    J = zeros(6, model.nv)
    for body, axes in _axes_on_path(model, q, frame, kind):
        _add_columns(J, body, axes)
    return J


def jacobian_rate(model: Model, q: Array, dq: Array, frame: str, kind: str = "body") -> Array:
    """dJ/dt; (6, nv). Each column moves with its body relative to the observing frame: dJ_i = [V_i - V_observer, J_i]."""
    axes_on_path = list(_axes_on_path(model, q, frame, kind))
    return _jacobian_rate(model, axes_on_path, dq, kind)


def _jacobian_rate(model: Model, axes_on_path: list[tuple[Body, Array]], dq: Array, kind: str) -> Array:
    """dJ/dt from the bodies and their screw axes, as :func:`_axes_on_path` yields them."""
    V = zeros(6)  # twist of each body on the path in turn; after the loop, of the frame itself
    twists = []
    for body, axes in axes_on_path:
        _, velocities = body.places
        V = V + dq[velocities] @ axes
        twists.append(V)
    observer_twists = {
        "space": zeros(6),
        "body": V,
        "world_aligned": np.concatenate([zeros(3), V[3:]]),
    }
    dJ = zeros(6, model.nv)
    for (body, axes), V_i in zip(axes_on_path, twists, strict=True):
        relative_twist = V_i - observer_twists[kind]
        _add_columns(dJ, body, ad(relative_twist).apply(axes))
    return dJ


def jacobian_derivative(model: Model, q: Array, frame: str, kind: str = "body") -> Array:
    """∂J/∂q along robot.add (last axis); (6, nv, nv). dJ/dt is linear in dq, so ∂J/∂q_k is dJ/dt at the k-th unit velocity."""
    axes_on_path = list(_axes_on_path(model, q, frame, kind))
    unit_velocities = np.eye(model.nv).astype(object)  # to be multiplied by symbols
    derivative = zeros(6, model.nv, model.nv)
    for body, axes in axes_on_path:
        for k in range(body.v_index, body.v_index + len(axes)):
            derivative[:, :, k] = _jacobian_rate(model, axes_on_path, unit_velocities[k], kind)
    return derivative


def _add_columns(J: Array, body: Body, axes: Array) -> None:
    """Add axes (k, 6) to the columns of J of a body's joint; joints that share a coordinate share columns."""
    _, columns = body.places
    J[:, columns] = J[:, columns] + axes.T


def frame_velocity(model: Model, q: Array, dq: Array, frame: str, kind: str = "body") -> Array:
    """V = J dq; (6,)."""
    return np.asarray(jacobian(model, q, frame, kind) @ dq)


def frame_acceleration(model: Model, q: Array, dq: Array, ddq: Array, frame: str, kind: str = "body") -> Array:
    """dV/dt = J ddq + (dJ/dt) dq; (6,)."""
    return np.asarray(jacobian(model, q, frame, kind) @ ddq + jacobian_rate(model, q, dq, frame, kind) @ dq)


def wrench_torques(model: Model, q: Array, F: Array, frame: str) -> Array:
    """J_b' F: torques for a wrench (6,) that the robot exerts at the frame, in its axes; (nv,). MR eq. 5.26."""
    target = model.frame(frame)
    poses_in_parents = joint_poses(model, q)
    tau = zeros(model.nv)
    F_body = Ad(target.pose).inverse.T @ F
    for i in ancestors(model, target.body):
        body = model.bodies[i]
        _, columns = body.places
        tau[columns] = tau[columns] + body.ratio * (body.joint.axes @ F_body)
        F_body = Ad(poses_in_parents[i]).inverse.T @ F_body
    return tau


# ── Coordinate rates: derivatives of q ⊕ v with respect to v at v = 0, and Lie brackets of joint axes

# Along robot.add the pose of each joint is T exp([A v]), with the joint's screw axes A and velocities v. The rotation and the
# position of a floating joint change by dR = R [w] and dp = R v. The coordinates change by
#
#     dq = N(q) v,      for a quaternion Q:  dQ = ½ Q (0, w),
#
# which leaves the length of Q unchanged, while robot.add normalises Q. Functions that do not depend on the length of Q have the
# same derivative along both changes. Modern Robotics sections 3.2.2 and 3.3.2; quaternions: Appendix B.3.


def coordinate_rates(model: Model, q: Array) -> Array:
    """N in dq/dt = N dq along robot.add; (nq, nv)."""
    N = zeros(model.nq, model.nv)
    for body in model.leaders:
        rows, columns = body.places
        N[rows, columns] = body.joint.rates(q[rows])
    return N


def velocity_map(model: Model, q: Array) -> Array:
    """B in dq = B dq/dt, the inverse of N; (nv, nq). Rates that change a quaternion's length give no velocity.

    The columns of N are orthogonal, so the rows of B are the columns of N, each divided by its squared length.
    """
    N = coordinate_rates(model, q)
    return np.stack([column / (column @ column) for column in N.T])


def rates_of_coordinates(model: Model, q: Array, dq: Array) -> Array:
    """Coordinate rates dq/dt = N dq; (nq,)."""
    return np.asarray(coordinate_rates(model, q) @ dq)


def moving_parts(model: Model, q: Array) -> Iterator[tuple[Array, Array]]:
    """Pairs of a variable and its derivative along all velocities: q (nq, nv), then each quaternion's rotation R (3, 3, nv).

    A function of R is differentiated by dR = R [w], which is shorter than the derivative through the quaternion.
    """
    yield q, coordinate_rates(model, q)
    for body in model.leaders:
        q_columns, v_columns = body.places
        for R, slopes in body.joint.rotation_slopes(q[q_columns]):
            dR = zeros(3, 3, model.nv)
            dR[:, :, v_columns] = slopes
            yield R, dR


_DECIMALS = 12
"""Number of decimals to which structure constants are rounded, since they have rounding errors."""


def brackets(model: Model) -> Array:
    """Structure constants c of each joint's screw axes, [S_a, S_b] = Σ c_abd S_d, which form a Lie algebra; (nv, nv, nv)."""
    c = np.zeros((model.nv, model.nv, model.nv))
    for body in model.leaders:
        _, columns = body.places
        axes = body.joint.axes
        axis_brackets = np.zeros((len(axes), len(axes), 6))
        for a, b in np.ndindex(len(axes), len(axes)):
            axis_brackets[a, b] = ad(axes[a]) @ axes[b]
        constants = axis_brackets @ np.linalg.pinv(axes)
        c[columns, columns, columns] = np.round(constants, _DECIMALS)  # orthonormal axes give exactly 0, 1 and -1
    return c


# ── Integration on symbols: branch-free q ⊕ v, and quaternion normalisation


def add(model: Model, q: Array, dv: Array) -> Array:
    """q ⊕ dv; (nq,)."""
    return add_at_angles(model, q, dv, q)


def add_at_angles(model: Model, q: Array, dv: Array, angles: Array) -> Array:
    """q ⊕ dv, each joint along its constant twist for unit time; (nq,). :meth:`twistwrench.Robot.add` on symbols.

    ``angles`` (nq,) replace q in sines, cosines and rotations.
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
    half_dv = 0.5 * dv
    q_new = add_at_angles(model, q, half_dv, angles)
    for body in model.leaders:
        if body.joint.angle is not None:
            coordinate, velocity = body.joint.angle  # indices within the joint
            i = body.q_index + coordinate
            k = body.v_index + velocity
            q_new[i] = angles[i].turned(half_dv[k].clip(-LARGEST_HALF_TURN, LARGEST_HALF_TURN))
    return q_new


def normalise_quaternions(model: Model, q: Array, share: Any = 1.0) -> Array:
    """q with its quaternions normalised, or moved towards unit length by the fraction ``share``; (nq,)."""
    q_new = q.copy()
    for columns in model.quaternions:
        Q = q[columns]
        length_change = 1.0 / np.sqrt(Q @ Q) - 1.0  # relative to |Q|
        q_new[columns] = Q + share * length_change * Q
    return q_new
