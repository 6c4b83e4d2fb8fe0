"""One-degree joints: a screw axis, which one formula serves. Modern Robotics eq. 3.88."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.inertia import SpatialInertia
from ..lie import se3, so3
from ..typing import Array
from .axes import no_pitch, screw_of
from .joint import ChartEntry, Joint, Slider


class ScrewJoint(Joint):
    """A joint of one degree of freedom; its coordinate is the angle, or the way, along its screw axis."""

    turns: ClassVar[bool] = True
    """Whether it turns about its axis, as opposed to sliding along it."""
    has_pitch: ClassVar[bool] = False
    """Whether it does both."""

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """One screw axis."""
        no_pitch(cls.kind, pitch, who)
        return screw_of(cls.kind, cls.turns, axis, 0.0, normalise, who)[None, :]

    def pose(self, q: Array) -> Array:
        """exp([S] q)."""
        return screw_motion(self.axes[0], q[0])

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Turned about a coordinate axis where the joint's axis is one, which takes fewer operations."""
        axis = self.axes[0]
        if np.count_nonzero(axis) == 1 and axis[:3].any():
            k = int(np.argmax(np.abs(axis)))
            return G.turned(k, axis[k] * q[0])
        return G.in_frame(self.pose(q))

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """The coordinate itself."""
        turns = self.turning[0]
        return (ChartEntry("theta" if turns else "x", turns, "joint {}"),)

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """One."""
        return (Slider("", 0, "°", math.pi) if self.turning[0] else Slider("", 0, "m", 1.0),)


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
    return se3.pose(rodrigues(w, cos, sin), p)


def rodrigues(w: Array, cosine: Any, sine: Any) -> Array:
    """The rotation about a unit vector, sorted so that axis-aligned ones fold to four entries; MR eq. 3.51."""
    along = np.outer(w, w)
    return along + cosine * (np.eye(3) - along) + sine * so3.hat(w)
