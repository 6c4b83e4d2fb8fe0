"""Joints: what moves, along which screw axes. One formula serves every one-degree joint; the rest is data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.inertia import SpatialInertia
from ..lie import quaternion, se3, so3

Array = NDArray[Any]

__all__ = ["JOINT_KINDS", "Joint", "planar_axes", "screw_axis"]

JOINT_KINDS = ("revolute", "continuous", "prismatic", "helical", "planar", "floating")
"""The kinds of moving joints. ``fixed`` joints are fused away by the builder; ``rotor`` ones come with actuators."""


@dataclass(frozen=True, eq=False)
class Joint:
    """One moving joint. Its twist, in the child's frame, is ``axes.T @ dq``.

    ``axes`` is (nv, 6), a screw axis a row, constant in the child's frame: one for revolute, continuous, prismatic and
    helical, ``(omega, v_1, v_2)`` for planar, the identity for floating.
    """

    name: str
    kind: str
    axes: Array

    @property
    def nv(self) -> int:
        """Velocities of the joint."""
        return int(self.axes.shape[0])

    @property
    def nq(self) -> int:
        """Coordinates of the joint: 7 for floating (a quaternion), else ``nv``."""
        return 7 if self.kind == "floating" else self.nv

    @property
    def neutral(self) -> Array:
        """Coordinates at which the child's frame coincides with the joint's; (nq,)."""
        return np.array([1.0, 0, 0, 0, 0, 0, 0]) if self.kind == "floating" else np.zeros(self.nq)

    @property
    def coordinate_suffixes(self) -> tuple[str, ...]:
        """What is appended to the joint's name to name its coordinates; one empty string for one-degree joints."""
        if self.kind == "floating":
            return (".qw", ".qx", ".qy", ".qz", ".x", ".y", ".z")
        return (".x", ".y", ".theta") if self.kind == "planar" else ("",)

    @property
    def velocity_suffixes(self) -> tuple[str, ...]:
        """What is appended to the joint's name to name its velocities."""
        if self.kind == "floating":
            return (".wx", ".wy", ".wz", ".vx", ".vy", ".vz")
        return (".w", ".vx", ".vy") if self.kind == "planar" else ("",)

    def pose(self, q: Array) -> Array:
        """T_jc, pose of the child's frame in the joint's frame; (nq,) → (4, 4). Works on symbols."""
        if self.kind == "floating":
            return se3.pose(quaternion.rotation(q[:4]), q[4:])
        if self.kind == "planar":
            normal, e1, e2 = self.axes[0, :3], self.axes[1, 3:], self.axes[2, 3:]
            return se3.pose(_turn(normal, q[2]), e1 * q[0] + e2 * q[1])
        if self.kind == "rotor":  # a body of revolution looks the same however it has turned: its frame stays behind
            return np.eye(4)
        return screw_motion(self.axes[0], q[0])

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Inertia, in the joint's frame, of a body whose inertia in the child's frame is G. Works on symbols."""
        axis = self.axes[0]
        if self.kind == "rotor":
            return G
        if self.nv == 1 and np.count_nonzero(axis) == 1 and axis[:3].any():  # turning about a coordinate axis
            k = int(np.argmax(np.abs(axis)))
            return G.turned(k, axis[k] * q[0])
        return G.in_frame(self.pose(q))

    def integrate(self, q: Array, dv: Array) -> Array:
        """Follow the constant joint twist ``axes.T @ dv`` for unit time from q; (..., nq), (..., nv) → (..., nq)."""
        if self.kind == "floating":
            step = se3.exp(dv)
            R = quaternion.rotation(q[..., :4])
            turned = quaternion.multiply(_unit(q[..., :4]), quaternion.exp(dv[..., :3]))
            return np.concatenate([turned, q[..., 4:] + (R @ step[..., :3, 3, None])[..., 0]], axis=-1)
        if self.kind == "planar":
            x, y, theta = np.moveaxis(q, -1, 0)
            w, vx, vy = np.moveaxis(dv, -1, 0)
            a, b = np.sinc(w / np.pi), 0.5 * w * np.sinc(0.5 * w / np.pi) ** 2  # sin(w)/w and (1 - cos w)/w
            dx, dy = a * vx - b * vy, b * vx + a * vy
            c, s = np.cos(theta), np.sin(theta)
            return np.stack([x + c * dx - s * dy, y + s * dx + c * dy, theta + w], axis=-1)
        return q + dv

    def difference(self, q1: Array, q0: Array) -> Array:
        """The dv with ``integrate(q0, dv) = q1``; (..., nq), (..., nq) → (..., nv)."""
        if self.kind == "floating":
            quat0 = _unit(q0[..., :4]) * np.array([1.0, -1, -1, -1])
            w = quaternion.log(quaternion.multiply(quat0, _unit(q1[..., :4])))
            R0t = np.swapaxes(quaternion.rotation(q0[..., :4]), -1, -2)
            p = R0t @ (q1[..., 4:] - q0[..., 4:])[..., None]
            return np.concatenate([w, (so3.left_jacobian_inverse(w) @ p)[..., 0]], axis=-1)
        if self.kind == "planar":
            c, s = np.cos(q0[..., 2]), np.sin(q0[..., 2])
            (x, y, w) = np.moveaxis(q1 - q0, -1, 0)
            w = w - 2 * np.pi * np.round(w / (2 * np.pi))  # the short way round; whole turns would divide by zero
            dx, dy = c * x + s * y, c * y - s * x
            a, b = np.sinc(w / np.pi), 0.5 * w * np.sinc(0.5 * w / np.pi) ** 2
            n = a * a + b * b
            return np.stack([w, (a * dx + b * dy) / n, (a * dy - b * dx) / n], axis=-1)
        return q1 - q0


def screw_motion(axis: Array, theta: Any) -> Array:
    """exp([S] theta) for a constant screw axis S (6,) and a number or symbol theta; (4, 4). MR eq. 3.88.

    Any length of S is allowed: the angle is |omega| theta. Constants that are exactly 0 leave no operations behind.
    """
    w, v = axis[:3], axis[3:]
    rate = float(np.linalg.norm(w))
    if abs(rate - 1.0) < 1e-15:  # a unit vector to the last bit or so: its length is no factor
        rate = 1.0
    if rate == 0.0:
        return se3.pose(np.eye(3), v * theta)
    w, v, angle = w / rate, v / rate, (theta if rate == 1.0 else rate * theta)
    W = so3.hat(w)
    sin, cos = np.sin(angle), np.cos(angle)
    # G(theta) v of MR eq. 3.88, sorted by what multiplies it: the pitch along w moves by angle, the rest turns.
    p = sin * (-(W @ W) @ v) + (1.0 - cos) * (W @ v) + angle * (w * (w @ v))
    return se3.pose(_turn(w, angle), p)


def _turn(w: Array, angle: Any) -> Array:
    """Rodrigues' formula about a unit vector, sorted so that axis-aligned ones fold to four entries; MR eq. 3.51."""
    along = np.outer(w, w)
    return along + np.cos(angle) * (np.eye(3) - along) + np.sin(angle) * so3.hat(w)


def _unit(quat: Array) -> Array:
    return quat / np.linalg.norm(quat, axis=-1, keepdims=True)


def screw_axis(kind: str, direction: Array, point: Array | None = None, pitch: float = 0.0) -> Array:
    """The screw axis (6,) of a one-degree joint along a unit ``direction`` through ``point``; pitch in m/rad."""
    direction = np.asarray(direction, float)
    if kind == "prismatic":
        return np.concatenate([np.zeros(3), direction])
    moment = np.zeros(3) if point is None else so3.cross(np.asarray(point, float), direction)
    return np.concatenate([direction, moment + pitch * direction])


def planar_axes(normal: Array) -> Array:
    """The three axes (3, 6) of a planar joint with unit ``normal``: turning about it, then sliding along two directions.

    The directions are the next two coordinate axes in cyclic order when the normal is a coordinate axis (z → x, y), and
    otherwise those of z turned the shortest way onto the normal.
    """
    normal = np.asarray(normal, float)
    k = int(np.argmax(np.abs(normal)))
    if normal[k] == 1.0:
        e1, e2 = np.eye(3)[(k + 1) % 3], np.eye(3)[(k + 2) % 3]
    else:
        z = np.array([0.0, 0.0, 1.0])
        w = so3.cross(z, normal)
        s, c = float(np.linalg.norm(w)), float(normal[2])
        turn = so3.exp(w / s * np.arctan2(s, c)) if s > 0 else np.diag([1.0, -1.0, -1.0])
        e1, e2 = turn[:, 0], turn[:, 1]
    zero = np.zeros(3)
    return np.stack([np.r_[normal, zero], np.r_[zero, e1], np.r_[zero, e2]])
