"""Planar joints: rotation about a normal and translation in the plane, by (x, y, theta) and (omega, v_1, v_2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ModelError
from ..lie import se3
from ..lie.quaternion import half_angle, half_turn, short_way
from ..typing import Array
from .joint import ChartEntry, CosineSine, Joint, Slider, exact, exact_rodrigues
from .screw_joint import direction_of, no_pitch, plane_of, rodrigues, unit_vector


class Planar(Joint):
    """The twist is in the child's frame; coordinates x and y are along the joint's axes."""

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
        """Rot(normal, theta) at (x, y)."""
        normal, e1, e2 = self.axes[0, :3], self.axes[1, 3:], self.axes[2, 3:]
        return se3.pose(rodrigues(normal, np.cos(q[2]), np.sin(q[2])), e1 * q[0] + e2 * q[1])

    def add(self, q: Array, dv: Array, angles: Array) -> Array:
        """Along an arc of a circle."""
        (x, y, theta), (w, vx, vy) = q, dv
        a, b = _arc(w)
        dx, dy = a * vx - b * vy, b * vx + a * vy
        c, s = np.cos(angles[2]), np.sin(angles[2])
        return np.array([x + c * dx - s * dy, y + s * dx + c * dy, theta + w], object)

    def subtract(self, q1: Array, q0: Array) -> Array:
        """The arc from q0 to q1, turning the short way."""
        x, y, turn = q1 - q0
        c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)
        way = short_way(c)
        w = 2.0 * way * s * half_turn(way * c, s * s)
        c, s = np.cos(q0[2]), np.sin(q0[2])
        dx, dy = c * x + s * y, c * y - s * x
        a, b = _arc(w)
        n = a * a + b * b
        return np.array([w, (a * dx + b * dy) / n, (a * dy - b * dx) / n], object)

    def rates(self, q: Array) -> Array:
        """(dx, dy, dtheta) = N (omega, v_1, v_2)."""
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[0.0, c, -s], [0.0, s, c], [1.0, 0.0, 0.0]], object)

    def velocities(self, q: Array, q1: Array, q2: Array) -> tuple[Array, Array]:
        """N⁻¹ dq/dt, and its derivative."""
        c, s, w = np.cos(q[:, 2]), np.sin(q[:, 2]), q1[:, 2]
        vx, vy = c * q1[:, 0] + s * q1[:, 1], c * q1[:, 1] - s * q1[:, 0]
        ax, ay = c * q2[:, 0] + s * q2[:, 1] + w * vy, c * q2[:, 1] - s * q2[:, 0] - w * vx
        return np.stack([w, vx, vy], axis=1), np.stack([q2[:, 2], ax, ay], axis=1)

    def spread(self, sigma: Array) -> Array:
        """The larger of x and y for both directions."""
        return np.r_[sigma[2], np.full(2, sigma[:2].max())]

    def bound(self, off: Array) -> Array:
        """The length of (x, y) in both directions."""
        return np.r_[off[2], np.full(2, np.hypot(off[0], off[1]))]

    def random(self, rng: np.random.Generator, shape: tuple[int, ...], lower: Array, upper: Array) -> Array:
        """Limits are in the order of the velocities, coordinates (x, y, theta)."""
        return rng.uniform(np.roll(lower, -1), np.roll(upper, -1), (*shape, 3))

    def require_pinocchio(self) -> None:
        """Its planar joints are all normal to z."""
        if self.axes[0, 2] != 1.0:
            raise ModelError(f"planar joint {self.name!r} is not normal to z, and Pinocchio's planar joints all are.")

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """Its coordinates."""
        letters = (("x", False, "x"), ("y", False, "y"), ("theta", True, "angle"))
        return tuple(ChartEntry(letter, angle, f"{word} of joint {{}}") for letter, angle, word in letters)

    def from_chart(self, u: Array, du: Array) -> tuple[Array, Array, Array]:
        """(omega, v_1, v_2) = B (dx, dy, dtheta)."""
        c, s, w = np.cos(u[2]), np.sin(u[2]), du[2]
        B = np.array([[0, 0, 1], [c, s, 0], [-s, c, 0]])
        return u, B, w * np.array([[0, 0, 0], [-s, c, 0], [-c, -s, 0]])

    def chart_pose(self, cosine_sine: CosineSine, coordinate: Callable[[int], Any]) -> tuple[Array, Array]:
        """Pose, the same as :meth:`pose`."""
        normal, e1, e2 = self.axes[0, :3], self.axes[1, 3:], self.axes[2, 3:]
        return exact_rodrigues(normal, *cosine_sine(2)), exact(e1) * coordinate(0) + exact(e2) * coordinate(1)

    def chart_column(
        self, k: int, into_child: Callable[[Array], Array], cosine_sine: CosineSine
    ) -> tuple[Array, Array]:
        """x and y slide along the joint's axes, theta turns."""
        nothing = exact(np.zeros(3))
        return (exact(self.axes[0, :3]), nothing) if k == 2 else (nothing, into_child(self.axes[1 + k, 3:]))

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """x, y, theta."""
        return (Slider(" x", 0, "m", 1.0), Slider(" y", 1, "m", 1.0), Slider(" theta", 2, "°", math.pi))


def _arc(w: Any) -> tuple[Any, Any]:
    """sin(w)/w and (1 - cos w)/w."""
    half, cosine, _ = half_angle(w * w)
    return 2.0 * half * cosine, 2.0 * half * half * w
