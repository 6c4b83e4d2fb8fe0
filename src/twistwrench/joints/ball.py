"""Ball joints: rotation about a point, by quaternions (qw, qx, qy, qz) and angular velocities in the child's frame.

``dR = R [ω]``; a quaternion Q changes by ``dQ = ½ Q (0, ω)``. Modern Robotics section 3.2.2 and appendix B.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..lie import quaternion, se3, so3
from ..lie.quaternion import half_angle, half_turn, short_way
from ..typing import Array
from .joint import ChartEntry, CosineSine, Joint, Slider, euler_axis, euler_rates, euler_rotation, exact

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


class Ball(Joint):
    """Turns about the joint's origin."""

    kind = "ball"
    coordinate_suffixes = (".qw", ".qx", ".qy", ".qz")
    velocity_suffixes = (".wx", ".wy", ".wz")
    quaternion = 0
    plain_rates = False
    pinocchio_order = (0, 1, 2)
    coordinate_units = ("", "", "", "")
    angle = None

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """It has no direction, so none is looked at."""
        return np.eye(6)[:3]

    def pose(self, q: Array) -> Array:
        """Turned by the quaternion."""
        return se3.pose(quaternion.rotation(q), np.zeros(3))

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """Q exp(ω)."""
        half, cosine, _ = half_angle(dv @ dv)
        Q = q / np.sqrt(q @ q)
        return quaternion.multiply(Q, np.concatenate([[cosine], half * dv]))

    def subtract(self, q1: Array, q0: Array) -> Array:
        """log(Q0⁻¹ Q1)."""
        return turn_between(q1, q0)[0]

    def rates(self, q: Array) -> Array:
        """N of dQ = ½ Q (0, ω); (4, 3)."""
        w, x, y, z = 0.5 * q
        return np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]], object)

    def rotation_slopes(self, q: Array) -> Iterator[tuple[Array, Array]]:
        """R and dR = R [ω]: short, and half of it zeros; through the quaternion it is neither."""
        R = quaternion.rotation(q)
        yield R, np.stack([R @ so3.hat(e) for e in np.eye(3).astype(object)], axis=-1)

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """ω = 2 vec(Q* dQ) / |Q|²; its derivative needs no dQ* dQ because that is a pure scalar."""
        conjugate, square = q * _CONJUGATE, np.sum(q * q, axis=1, keepdims=True)
        w = 2.0 * quaternion.multiply(conjugate, q1)[:, 1:] / square
        dw = 2.0 * (quaternion.multiply(conjugate, q2)[:, 1:] - np.sum(q * q1, axis=1, keepdims=True) * w) / square
        return w, dw

    def spread(self, sigma: Array) -> Array:
        """ω is twice the rate of the quaternion."""
        return np.full(3, 2.0 * sigma.max())

    def bound(self, off: Array) -> Array:
        """A quaternion changes by half the angle."""
        return np.full(3, 2.0 * np.linalg.norm(off))

    def random(self, rng: np.random.Generator, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
        """Uniform over all rotations."""
        return unit(rng.standard_normal((*shape, 4)))

    def to_pinocchio(self, q: Array) -> Array:
        """(x, y, z, w)."""
        return np.roll(unit(q), -1, axis=-1)

    def from_pinocchio(self, q: Array) -> Array:
        """(w, x, y, z)."""
        return np.roll(q, 1, axis=-1)

    def to_mujoco(self, q: Array) -> Array:
        """Coordinates in MuJoCo's order, the quaternion of unit length."""
        return unit(q)

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """ZYX Euler angles: the four numbers of a quaternion are not independent."""
        letters = (("alpha", "yaw"), ("beta", "pitch"), ("gamma", "roll"))
        return tuple(ChartEntry(letter, True, f"{word} of joint {{}}") for letter, word in letters)

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """ω = E times the rates of the angles."""
        return euler_rates(u, du)

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Rot(z) Rot(y) Rot(x)."""
        return euler_rotation(0, cosine_sine), exact(np.zeros(3))

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """Turning only."""
        return euler_axis(k, 0, cosine_sine), exact(np.zeros(3))

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Roll, pitch, yaw."""
        words = (("roll", math.pi), ("pitch", math.pi / 2), ("yaw", math.pi))
        return tuple(Slider(f" {word}", 0, "°", most, k) for k, (word, most) in enumerate(words))


def turn_between(Q1: Array, Q0: Array) -> tuple[Array, Any]:
    """ω = log(Q0⁻¹ Q1), the short way, of quaternions of any length from 1e-150 to 1e150; and its square."""
    Q = quaternion.multiply((Q0 / np.sqrt(Q0 @ Q0)) * _CONJUGATE, Q1 / np.sqrt(Q1 @ Q1))
    Q = short_way(Q[0]) * Q
    w = 2.0 * half_turn(Q[0], Q[1:] @ Q[1:]) * Q[1:]
    return w, w @ w


def unit(Q: Array) -> Array:
    """A quaternion (..., 4) of unit length."""
    return np.asarray(Q / np.linalg.norm(Q, axis=-1, keepdims=True))
