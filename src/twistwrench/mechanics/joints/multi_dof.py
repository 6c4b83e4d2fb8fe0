"""Joints of several degrees of freedom: ball, floating and planar.

Ball joints rotate about a point. Their coordinates are quaternions (qw, qx, qy, qz), their velocities angular velocities in the
child's frame: ``dR = R [ω]`` and ``dQ = ½ Q (0, ω)``. Modern Robotics section 3.2.2 and appendix B.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import ModelError
from ...core.typing import Array
from ..lie import quaternion, se3, so3
from ..lie.half_angles import cotangent_quotient, half_angle, half_turn, short_way
from ..lie.se3 import slide
from .joint import (
    ChartEntry,
    CosineSine,
    Joint,
    Slider,
    euler_axis,
    euler_rates,
    euler_rotation,
    exact,
    exact_rodrigues,
)
from .screw_joint import direction_of, no_pitch, plane_of, rodrigues, unit_vector

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
"""Signs of the conjugate quaternion."""


class Ball(Joint):
    """Joint that rotates about its origin in all directions."""

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
        """Return the three rotation axes; a direction in the file is ignored."""
        return np.eye(6)[:3]

    def pose(self, q: Array) -> Array:
        """Pose with the quaternion's rotation."""
        return se3.pose(quaternion.rotation(q), np.zeros(3))

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """Quaternion Q exp(ω)."""
        half_sinc, cosine, _ = half_angle(dv @ dv)  # sin(x/2) / x and cos(x/2) of the angle x = |ω|
        Q = q / np.sqrt(q @ q)
        return quaternion.multiply(Q, np.concatenate([[cosine], half_sinc * dv]))

    def subtract(self, q1: Array, q0: Array) -> Array:
        """Rotation vector log(Q0⁻¹ Q1)."""
        w, _ = rotation_between(q1, q0)
        return w

    def rates(self, q: Array) -> Array:
        """N in dQ = ½ Q (0, ω) = N ω; (4, 3)."""
        w, x, y, z = 0.5 * q
        rows = [
            [-x, -y, -z],
            [w, -z, y],
            [z, w, -x],
            [-y, x, w],
        ]
        return np.array(rows, object)

    def rotation_slopes(self, q: Array) -> Iterator[tuple[Array, Array]]:
        """R and dR = R [ω] for each unit velocity: shorter than derivatives through the quaternion, and half zeros."""
        R = quaternion.rotation(q)
        unit_velocities = np.eye(3).astype(object)
        yield R, np.stack([R @ so3.hat(omega) for omega in unit_velocities], axis=-1)

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """ω = 2 vec(Q* dQ) / |Q|² and dω = 2 (vec(Q* ddQ) - (Q·dQ) ω) / |Q|²; vec(dQ* dQ) is zero."""
        conjugate = q * _CONJUGATE
        square = np.sum(q * q, axis=1, keepdims=True)
        w = 2.0 * quaternion.multiply(conjugate, q1)[:, 1:] / square
        half_square_rate = np.sum(q * q1, axis=1, keepdims=True)
        dw = 2.0 * (quaternion.multiply(conjugate, q2)[:, 1:] - half_square_rate * w) / square
        return w, dw

    def spread(self, sigma: Array) -> Array:
        """Standard deviations of dω: twice the largest standard deviation of the quaternion's second derivatives."""
        return np.full(3, 2.0 * sigma.max())

    def bound(self, error: Array) -> Array:
        """Error bound of the angle: twice the length of the quaternion's error."""
        return np.full(3, 2.0 * np.linalg.norm(error))

    def random(self, rng: np.random.Generator, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
        """Random quaternions, uniform over all rotations."""
        return unit_quaternion(rng.standard_normal((*shape, 4)))

    def to_pinocchio(self, q: Array) -> Array:
        """Quaternion in the order (x, y, z, w)."""
        return np.roll(unit_quaternion(q), -1, axis=-1)

    def from_pinocchio(self, q: Array) -> Array:
        """Quaternion in the order (w, x, y, z)."""
        return np.roll(q, 1, axis=-1)

    def to_mujoco(self, q: Array) -> Array:
        """Coordinates in MuJoCo's order, with a unit quaternion."""
        return unit_quaternion(q)

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """ZYX Euler angles, because quaternion entries are not independent."""
        names = {"alpha": "yaw", "beta": "pitch", "gamma": "roll"}
        return tuple(ChartEntry(letter, True, f"{name} of joint {{}}") for letter, name in names.items())

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """Quaternion, and E in ω = E times the rates of the angles."""
        return euler_rates(u, du)

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Rotation Rot(z) Rot(y) Rot(x) at the origin."""
        return euler_rotation(0, cosine_sine), exact(np.zeros(3))

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """Angular velocity per unit rate of one Euler angle; v = 0."""
        return euler_axis(k, 0, cosine_sine), exact(np.zeros(3))

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Sliders for roll, pitch and yaw."""
        ranges = {"roll": math.pi, "pitch": math.pi / 2, "yaw": math.pi}
        sliders = []
        for k, (angle, largest) in enumerate(ranges.items()):
            sliders.append(Slider(f" {angle}", 0, "°", largest, k))
        return tuple(sliders)


def rotation_between(Q1: Array, Q0: Array) -> tuple[Array, Any]:
    """Shortest rotation vector ω = log(Q0⁻¹ Q1) for quaternions of length 1e-150 to 1e150, and |ω|²."""
    Q0_inverse = (Q0 / np.sqrt(Q0 @ Q0)) * _CONJUGATE
    Q = quaternion.multiply(Q0_inverse, Q1 / np.sqrt(Q1 @ Q1))
    Q = short_way(Q[0]) * Q
    cosine, sine_vector = Q[0], Q[1:]  # of half the rotation angle
    w = 2.0 * half_turn(cosine, sine_vector @ sine_vector) * sine_vector
    return w, w @ w


def unit_quaternion(Q: Array) -> Array:
    """Quaternion (..., 4), normalised."""
    return np.asarray(Q / np.linalg.norm(Q, axis=-1, keepdims=True))


_BALL = Ball("", np.eye(6)[:3])
"""Ball joint whose functions a floating joint uses for its rotation."""


class Floating(Joint):
    """Joint of a free body, of six degrees of freedom: (qw, qx, qy, qz, x, y, z) and body twists (ω, v).

    It rotates like a ball joint and translates with ``dp = R v``. Modern Robotics section 3.3.2.
    """

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
        """Return all six axes; a direction in the file is ignored."""
        return np.eye(6)

    def pose(self, q: Array) -> Array:
        """Pose (R, p)."""
        return se3.pose(quaternion.rotation(q[:4]), q[4:])

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """Pose (R, p) exp(dv)."""
        Q, p = q[:4], q[4:]
        w, v = dv[:3], dv[3:]
        Q = Q / np.sqrt(Q @ Q)
        half_sinc, cosine, third = half_angle(w @ w)  # sin(x/2) / x, cos(x/2) and (1 - sin(x) / x) / x² of x = |ω|
        Q_new = quaternion.multiply(Q, np.concatenate([[cosine], half_sinc * w]))
        displacement = slide(w, v, 2.0 * half_sinc * half_sinc, third)  # MR eq. 3.88, in the child's frame
        return np.concatenate([Q_new, p + quaternion.rotation(angles[:4]) @ displacement])

    def subtract(self, q1: Array, q0: Array) -> Array:
        """Twist log(T0⁻¹ T1); MR eq. 3.92."""
        w, square = rotation_between(q1[:4], q0[:4])
        p = quaternion.rotation(q0[:4]).T @ (q1[4:] - q0[4:])
        return np.concatenate([w, slide(w, p, -0.5, cotangent_quotient(square))])

    def rates(self, q: Array) -> Array:
        """N with the quaternion's block and R."""
        N = np.full((7, 6), 0.0, object)
        N[:4, :3] = _BALL.rates(q[:4])
        N[4:, 3:] = quaternion.rotation(q[:4])
        return N

    def rotation_slopes(self, q: Array) -> Iterator[tuple[Array, Array]]:
        """R and dR = R [ω]."""
        for R, dR in _BALL.rotation_slopes(q[:4]):
            yield R, np.concatenate([dR, np.full((3, 3, 3), 0.0, object)], axis=-1)

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """ω as for a ball joint, v = R' dp and dv = R' ddp - ω × v."""
        w, dw = _BALL.velocities(q[:, :4], q1[:, :4], q2[:, :4])
        Rt = np.swapaxes(quaternion.rotation(q[:, :4]), -1, -2)
        v = (Rt @ q1[:, 4:, None])[..., 0]
        dv = (Rt @ q2[:, 4:, None])[..., 0] - np.cross(w, v)
        return np.concatenate([w, v], axis=1), np.concatenate([dw, dv], axis=1)

    def spread(self, sigma: Array) -> Array:
        """Standard deviations as for a ball joint; the largest of x, y, z for all linear entries."""
        return np.r_[_BALL.spread(sigma[:4]), np.full(3, sigma[4:].max())]

    def bound(self, error: Array) -> Array:
        """Bounds as for a ball joint; the length of the error of (x, y, z) for all linear entries."""
        return np.r_[_BALL.bound(error[:4]), np.full(3, np.linalg.norm(error[4:]))]

    def random(self, rng: np.random.Generator, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
        """Random poses: uniform over all rotations, each position coordinate within ±1 m."""
        quaternions = unit_quaternion(rng.standard_normal((*shape, 4)))
        positions = rng.uniform(-1.0, 1.0, (*shape, 3))
        return np.concatenate([quaternions, positions], axis=-1)

    def to_pinocchio(self, q: Array) -> Array:
        """Coordinates in Pinocchio's order (x, y, z, qx, qy, qz, qw)."""
        return np.concatenate([q[..., 4:], _BALL.to_pinocchio(q[..., :4])], axis=-1)

    def from_pinocchio(self, q: Array) -> Array:
        """Coordinates from Pinocchio's order (x, y, z, qx, qy, qz, qw)."""
        return np.concatenate([_BALL.from_pinocchio(q[..., 3:]), q[..., :3]], axis=-1)

    def to_mujoco(self, q: Array) -> Array:
        """Coordinates in MuJoCo's order (x, y, z, qw, qx, qy, qz)."""
        return np.concatenate([q[..., 4:], unit_quaternion(q[..., :4])], axis=-1)

    def from_mujoco(self, q: Array) -> Array:
        """Coordinates from MuJoCo's order (x, y, z, qw, qx, qy, qz)."""
        return np.concatenate([q[..., 3:], q[..., :3]], axis=-1)

    def mujoco_rates(self, q: Array) -> Array:
        """Matrix P to MuJoCo's velocities: the linear velocity first, in world axes."""
        P = np.zeros((6, 6))
        P[:3, 3:] = quaternion.rotation(q[:4])
        P[3:, :3] = np.eye(3)
        return P

    def mujoco_turning(self, dq: Array) -> Array:
        """Difference (0, ω × v)."""
        return np.r_[np.zeros(3), np.cross(dq[:3], dq[3:])]

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """Coordinates x, y, z and ZYX Euler angles."""
        position = [ChartEntry(letter, False, f"{letter} of joint {{}}") for letter in "xyz"]
        return (*position, *_BALL.chart)

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """ω = E times the rates of the angles, v = R' dp, and dR'/dt = -[ω] R'."""
        Q, E, dE = euler_rates(u[3:], du[3:])
        Rt = quaternion.rotation(Q).T
        omega = E @ du[3:]
        B = np.zeros((6, 6))
        dB = np.zeros((6, 6))
        B[:3, 3:] = E
        B[3:, :3] = Rt
        dB[:3, 3:] = dE
        dB[3:, :3] = -so3.hat(omega) @ Rt
        return np.concatenate([Q, u[:3]]), B, dB

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Rotation Rot(z) Rot(y) Rot(x) and position (x, y, z)."""
        return euler_rotation(3, cosine_sine), np.array([coordinate(k) for k in range(3)], object)

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """Twist per unit rate: x, y, z translate along the joint's axes, the angles rotate."""
        zero = exact(np.zeros(3))
        if k < 3:
            return zero, into_child(np.eye(3)[k])
        return euler_axis(k - 3, 3, cosine_sine), zero

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Sliders for roll, pitch, yaw, x, y and z."""
        position = [Slider(f" {letter}", 4 + k, "m", 1.0) for k, letter in enumerate("xyz")]
        return (*_BALL.sliders, *position)


class Planar(Joint):
    """Joint in a plane, with the coordinates (x, y, theta) and the velocities (omega, v_1, v_2).

    x and y are along the joint's axes, theta is about the normal; the velocities are the twist in the child's frame.
    """

    kind = "planar"
    coordinate_suffixes = (".x", ".y", ".theta")
    velocity_suffixes = (".w", ".vx", ".vy")
    plain_rates = False
    wraps = (2,)
    pinocchio_order = (1, 2, 0)
    coordinate_units = ("m", "m", "rad")
    angle = (2, 0)

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """Screw axes from the normal of the plane."""
        no_pitch(cls.kind, pitch, who)
        return plane_of(unit_vector(direction_of(axis, who)))

    def pose(self, q: Array) -> Array:
        """Pose Rot(normal, theta) at (x, y)."""
        x, y, theta = q
        normal, e1, e2 = self.axes[0, :3], self.axes[1, 3:], self.axes[2, 3:]
        return se3.pose(rodrigues(normal, np.cos(theta), np.sin(theta)), e1 * x + e2 * y)

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """Configuration after the motion along a circular arc.

        In the child's frame the displacement is (dx, dy) = [a, -b; b, a] (v_1, v_2), with a and b of :func:`_arc`.
        """
        x, y, theta = q
        w, vx, vy = dv
        a, b = _arc(w)
        dx, dy = a * vx - b * vy, b * vx + a * vy
        c, s = np.cos(angles[2]), np.sin(angles[2])
        return np.array([x + c * dx - s * dy, y + s * dx + c * dy, theta + w], object)

    def subtract(self, q1: Array, q0: Array) -> Array:
        """Displacement along the circular arc from q0 to q1, with the shortest rotation."""
        x, y, angle = q1 - q0
        c_half, s_half = np.cos(0.5 * angle), np.sin(0.5 * angle)
        sign = short_way(c_half)
        w = 2.0 * sign * s_half * half_turn(sign * c_half, s_half * s_half)
        c, s = np.cos(q0[2]), np.sin(q0[2])
        dx, dy = c * x + s * y, c * y - s * x  # in the child's frame at q0
        a, b = _arc(w)
        determinant = a * a + b * b  # of the matrix [a, -b; b, a] of add()
        return np.array([w, (a * dx + b * dy) / determinant, (a * dy - b * dx) / determinant], object)

    def rates(self, q: Array) -> Array:
        """N in (dx, dy, dtheta) = N (omega, v_1, v_2)."""
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[0.0, c, -s], [0.0, s, c], [1.0, 0.0, 0.0]], object)

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """Velocities N⁻¹ dq/dt, and their derivatives."""
        dx, dy, w = q1.T
        ddx, ddy, dw = q2.T
        c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
        vx, vy = c * dx + s * dy, c * dy - s * dx
        dvx, dvy = c * ddx + s * ddy + w * vy, c * ddy - s * ddx - w * vx
        return np.stack([w, vx, vy], axis=1), np.stack([dw, dvx, dvy], axis=1)

    def spread(self, sigma: Array) -> Array:
        """Standard deviations; the larger of x and y for both linear entries."""
        return np.r_[sigma[2], np.full(2, sigma[:2].max())]

    def bound(self, error: Array) -> Array:
        """Bounds; the length of the error of (x, y) for both linear entries."""
        return np.r_[error[2], np.full(2, np.hypot(error[0], error[1]))]

    def random(self, rng: np.random.Generator, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
        """Random coordinates (x, y, theta); the limits have the order of the velocities."""
        return rng.uniform(np.roll(lower, -1), np.roll(upper, -1), (*shape, 3))

    def require_pinocchio(self) -> None:
        """Raise ModelError unless the plane is normal to z, as in Pinocchio."""
        if self.axes[0, 2] != 1.0:
            raise ModelError(f"planar joint {self.name!r} is not normal to z, and Pinocchio's planar joints all are.")

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """The joint's own coordinates."""
        return (
            ChartEntry("x", False, "x of joint {}"),
            ChartEntry("y", False, "y of joint {}"),
            ChartEntry("theta", True, "angle of joint {}"),
        )

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """B in (omega, v_1, v_2) = B (dx, dy, dtheta), and its rate."""
        c, s = np.cos(u[2]), np.sin(u[2])
        w = du[2]
        B = np.array([[0, 0, 1], [c, s, 0], [-s, c, 0]])
        dB = w * np.array([[0, 0, 0], [-s, c, 0], [-c, -s, 0]])
        return u, B, dB

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Pose, the same as :meth:`pose`."""
        normal, e1, e2 = self.axes[0, :3], self.axes[1, 3:], self.axes[2, 3:]
        R = exact_rodrigues(normal, *cosine_sine(2))
        p = exact(e1) * coordinate(0) + exact(e2) * coordinate(1)
        return R, p

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """Twist per unit rate: x and y translate along the joint's axes, theta rotates."""
        zero = exact(np.zeros(3))
        if k == 2:
            return exact(self.axes[0, :3]), zero
        return zero, into_child(self.axes[1 + k, 3:])

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Sliders for x, y and theta."""
        return (Slider(" x", 0, "m", 1.0), Slider(" y", 1, "m", 1.0), Slider(" theta", 2, "°", math.pi))


def _arc(w: Any) -> tuple[Any, Any]:
    """a = sin(w)/w and b = (1 - cos w)/w, from sin w = 2 sin(w/2) cos(w/2) and 1 - cos w = 2 sin²(w/2)."""
    half_sinc, cosine, _ = half_angle(w * w)
    return 2.0 * half_sinc * cosine, 2.0 * half_sinc * half_sinc * w
