"""Floating joints: all six directions, by (qw, qx, qy, qz, x, y, z) and body twists (ω, v).

They turn as a ball joint does, and slide with ``dp = R v``. Modern Robotics section 3.3.2.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..lie import quaternion, se3, so3
from ..lie.quaternion import cotangent_quotient, half_angle
from ..lie.se3 import slide
from ..typing import Array
from .ball import Ball, turn_between, unit
from .joint import ChartEntry, CosineSine, Joint, Slider, euler_axis, euler_rates, euler_rotation, exact

_TURNING = Ball("", np.eye(6)[:3])


class Floating(Joint):
    """A free body."""

    kind = "floating"
    coordinate_suffixes = (*Ball.coordinate_suffixes, ".x", ".y", ".z")
    velocity_suffixes = (*Ball.velocity_suffixes, ".vx", ".vy", ".vz")
    quaternion = 0
    driven = False
    plain_rates = False
    pinocchio_order = (3, 4, 5, 0, 1, 2)
    coordinate_units = (*Ball.coordinate_units, "m", "m", "m")
    angle = None

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """It has no direction, so none is looked at."""
        return np.eye(6)

    def pose(self, q: Array) -> Array:
        """(R, p)."""
        return se3.pose(quaternion.rotation(q[:4]), q[4:])

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """(R, p) exp(dv)."""
        Q, p, w, v = q[:4], q[4:], dv[:3], dv[3:]
        Q = Q / np.sqrt(Q @ Q)
        half, cosine, third = half_angle(w @ w)
        turned = quaternion.multiply(Q, np.concatenate([[cosine], half * w]))
        slid = slide(w, v, 2.0 * half * half, third)  # MR eq. 3.88
        return np.concatenate([turned, p + quaternion.rotation(angles[:4]) @ slid])

    def subtract(self, q1: Array, q0: Array) -> Array:
        """log(T0⁻¹ T1); MR eq. 3.92."""
        w, square = turn_between(q1[:4], q0[:4])
        p = quaternion.rotation(q0[:4]).T @ (q1[4:] - q0[4:])
        return np.concatenate([w, slide(w, p, -0.5, cotangent_quotient(square))])

    def rates(self, q: Array) -> Array:
        """N of the quaternion, and R."""
        N = np.full((7, 6), 0.0, object)
        N[:4, :3], N[4:, 3:] = _TURNING.rates(q[:4]), quaternion.rotation(q[:4])
        return N

    def rotation_slopes(self, q: Array) -> Iterator[tuple[Array, Array]]:
        """R and dR = R [ω]."""
        for R, dR in _TURNING.rotation_slopes(q[:4]):
            yield R, np.concatenate([dR, np.full((3, 3, 3), 0.0, object)], axis=-1)

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """ω as of a ball joint, v = R' dp."""
        w, dw = _TURNING.velocities(q[:, :4], q1[:, :4], q2[:, :4])
        R_bs = np.swapaxes(quaternion.rotation(q[:, :4]), -1, -2)
        v = (R_bs @ q1[:, 4:, None])[..., 0]
        a = (R_bs @ q2[:, 4:, None])[..., 0] - np.cross(w, v)
        return np.concatenate([w, v], axis=1), np.concatenate([dw, a], axis=1)

    def spread(self, sigma: Array) -> Array:
        """Spread of a ball joint, and the largest of x, y, z for all directions."""
        return np.r_[_TURNING.spread(sigma[:4]), np.full(3, sigma[4:].max())]

    def bound(self, off: Array) -> Array:
        """Bound of a ball joint, and the length of (x, y, z)."""
        return np.r_[_TURNING.bound(off[:4]), np.full(3, np.linalg.norm(off[4:]))]

    def random(self, rng: np.random.Generator, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
        """Uniform over all rotations, within a metre."""
        return np.concatenate([unit(rng.standard_normal((*shape, 4))), rng.uniform(-1.0, 1.0, (*shape, 3))], axis=-1)

    def to_pinocchio(self, q: Array) -> Array:
        """(x, y, z, qx, qy, qz, qw)."""
        return np.concatenate([q[..., 4:], _TURNING.to_pinocchio(q[..., :4])], axis=-1)

    def from_pinocchio(self, q: Array) -> Array:
        """The way back."""
        return np.concatenate([_TURNING.from_pinocchio(q[..., 3:]), q[..., :3]], axis=-1)

    def to_mujoco(self, q: Array) -> Array:
        """(x, y, z, qw, qx, qy, qz)."""
        return np.concatenate([q[..., 4:], unit(q[..., :4])], axis=-1)

    def from_mujoco(self, q: Array) -> Array:
        """The way back."""
        return np.concatenate([q[..., 3:], q[..., :3]], axis=-1)

    def mujoco_rates(self, q: Array) -> Array:
        """The linear velocity first, along the world's axes."""
        P = np.zeros((6, 6))
        P[:3, 3:], P[3:, :3] = quaternion.rotation(q[:4]), np.eye(3)
        return P

    def mujoco_turning(self, dq: Array) -> Array:
        """ω × v."""
        return np.r_[np.zeros(3), np.cross(dq[:3], dq[3:])]

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """x, y, z and ZYX Euler angles."""
        return (*(ChartEntry(letter, False, f"{letter} of joint {{}}") for letter in "xyz"), *_TURNING.chart)

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """ω = E times the rates of the angles, v = R' dp."""
        Q, E, dE = euler_rates(u[3:], du[3:])
        Rt = quaternion.rotation(Q).T
        B, dB = np.zeros((6, 6)), np.zeros((6, 6))
        B[:3, 3:], B[3:, :3] = E, Rt
        dB[:3, 3:], dB[3:, :3] = dE, -so3.hat(E @ du[3:]) @ Rt
        return np.concatenate([Q, u[:3]]), B, dB

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Rot(z) Rot(y) Rot(x) at (x, y, z)."""
        return euler_rotation(3, cosine_sine), np.array([coordinate(k) for k in range(3)], object)

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """x, y, z slide along the joint's axes, the angles turn."""
        nothing = exact(np.zeros(3))
        return (euler_axis(k - 3, 3, cosine_sine), nothing) if k > 2 else (nothing, into_child(np.eye(3)[k]))

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Roll, pitch, yaw, x, y, z."""
        return (*_TURNING.sliders, *(Slider(f" {x}", 4 + k, "m", 1.0) for k, x in enumerate("xyz")))
