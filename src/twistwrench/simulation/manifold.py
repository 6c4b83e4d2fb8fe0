"""Coordinates that are no vectors: how fast they change at given joint velocities, and how they are kept on their manifold.

Steps of Runge–Kutta methods go through the numbers of q themselves, where the rates of a quaternion and of a position are

    p' = ½ p ∘ (0, omega_b),        x' = R(p) v_b

and are then put back to unit length. The flow keeps that length, so what is put back is of the size of the step's error, and
every method has its full order. Source: Hairer, Lubich and Wanner, Geometric Numerical Integration, section IV.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..lie import series
from ..model.model import Model

Array = NDArray[Any]

__all__ = ["Manifold"]


@dataclass(frozen=True, eq=False)
class Manifold:
    """The configurations of one robot."""

    model: Model
    places: tuple[Array, Array]
    """Of the joints of one degree of freedom: in q and in dq."""
    planar: tuple[tuple[int, int], ...]
    """Where the coordinates and the velocities of each planar joint begin."""
    floating: tuple[tuple[int, int], ...]
    """The same for floating ones."""

    @classmethod
    def of(cls, model: Model) -> Manifold:
        """Read it off the model."""
        starts: dict[str, list[tuple[int, int]]] = {"planar": [], "floating": [], "": []}
        for body in model.leaders:
            kind = body.joint.kind if body.joint.kind in starts else ""
            starts[kind].append((body.q_index, body.v_index))
        plain = np.array(starts[""], int).reshape(-1, 2)
        return cls(model, (plain[:, 0], plain[:, 1]), tuple(starts["planar"]), tuple(starts["floating"]))

    @property
    def flat(self) -> bool:
        """Whether the rates of all coordinates are the velocities themselves."""
        return not self.planar and not self.floating

    def rates(self, q: Array, dq: Array, out: Array) -> None:
        """Write dq/dt of the coordinates, (nq), at the joint velocities (nv), into ``out``."""
        if self.flat:
            out[:] = dq
            return
        out[self.places[0]] = dq[self.places[1]]
        for i, k in self.planar:
            c, s, (w, vx, vy) = np.cos(q[i + 2]), np.sin(q[i + 2]), dq[k : k + 3].tolist()
            out[i : i + 3] = c * vx - s * vy, s * vx + c * vy, w
        for i, k in self.floating:
            a, b, c, d = q[i : i + 4].tolist()
            x, y, z, u, v, w = dq[k : k + 6].tolist()
            n = 2.0 / (a * a + b * b + c * c + d * d)
            # R v = v + (2 / |p|²) (a (e × v) + e × (e × v)) with p = (a, e)
            f, g, h = c * w - d * v, d * u - b * w, b * v - c * u
            out[i : i + 7] = (
                -0.5 * (b * x + c * y + d * z),
                0.5 * (a * x + c * z - d * y),
                0.5 * (a * y + d * x - b * z),
                0.5 * (a * z + b * y - c * x),
                u + n * (a * f + c * h - d * g),
                v + n * (a * g + d * f - b * h),
                w + n * (a * h + b * g - c * f),
            )

    def normalise(self, q: Array) -> None:
        """Bring the quaternions to unit length, in place."""
        for i, _ in self.floating:
            q[i : i + 4] /= np.linalg.norm(q[i : i + 4])

    def move(self, q: Array, dv: Array) -> Array:
        """q ⊕ dv of one state, (nq), (nv) → (nq): :meth:`twistwrench.Robot.add` in plain floats, ten times as fast."""
        if self.flat:
            return q + dv
        found = q.copy()
        found[self.places[0]] += dv[self.places[1]]
        for i, k in self.planar:
            (x, y, theta), (w, vx, vy) = q[i : i + 3].tolist(), dv[k : k + 3].tolist()
            half = np.sin(0.5 * w) / (0.5 * w) if w else 1.0
            a, b = (np.sin(w) / w if w else 1.0), 0.5 * w * half * half  # sin(w)/w and (1 - cos w)/w
            c, s, dx, dy = np.cos(theta), np.sin(theta), a * vx - b * vy, b * vx + a * vy
            found[i : i + 3] = x + c * dx - s * dy, y + s * dx + c * dy, theta + w
        for i, k in self.floating:
            (a, b, c, d, *place), V = q[i : i + 7].tolist(), dv[k : k + 6].tolist()
            w, v = (V[0], V[1], V[2]), (V[3], V[4], V[5])
            angle = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            half = np.sin(0.5 * angle) / angle if angle else 0.5
            third = float(series.theta_minus_sin_over_cube(angle))
            wv = _cross(w, v)  # the left Jacobian of the turn, applied to v
            slide = [u + 2.0 * half * half * x + third * y for u, x, y in zip(v, wv, _cross(w, wv), strict=True)]
            n = 1.0 / sqrt(a * a + b * b + c * c + d * d)
            a, e = n * a, (n * b, n * c, n * d)
            ev = _cross(e, (slide[0], slide[1], slide[2]))
            eev = _cross(e, ev)
            e0, (x, y, z) = np.cos(0.5 * angle), (half * w[0], half * w[1], half * w[2])
            b, c, d = e
            found[i : i + 7] = (
                a * e0 - b * x - c * y - d * z,
                a * x + b * e0 + c * z - d * y,
                a * y - b * z + c * e0 + d * x,
                a * z + b * y - c * x + d * e0,
                *(p + s + 2.0 * (a * f + g) for p, s, f, g in zip(place, slide, ev, eev, strict=True)),
            )
        return found


def _cross(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
