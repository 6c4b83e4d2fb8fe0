"""Joints of one degree of freedom, by screw axis: revolute, continuous, prismatic, helical; and rotors. MR eq. 3.88."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import ModelError
from ...core.numbers import printed
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..lie import se3, so3
from .joint import ChartEntry, Joint, Slider


def numbers(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """Return ``values`` as a new array of finite floats. Raises :class:`~twistwrench.ModelError` that names ``what``."""
    try:
        array = np.array(values, float)
    except (TypeError, ValueError):
        raise ModelError(f"{what} is {values!r}, expected {_shape_in_words(shape)}.") from None
    if array.shape != shape:
        raise ModelError(f"{what} has shape {array.shape}, expected {_shape_in_words(shape)}.")
    if not all(map(math.isfinite, array.ravel().tolist())):
        raise ModelError(f"{what} is {array.tolist()}; every number must be finite.")
    return array


def number(value: float | ArrayLike, what: str) -> float:
    """Return ``value`` as a finite float. Raises :class:`~twistwrench.ModelError` that names ``what``."""
    return float(value) if isinstance(value, float) and math.isfinite(value) else float(numbers(value, (), what))


def _shape_in_words(shape: tuple[int, ...]) -> str:
    return f"numbers of shape {shape}" if shape else "a number"


def direction_of(axis: ArrayLike, who: str) -> Array:
    """Nonzero direction (3,), not normalised. Raises ModelError for a zero axis."""
    direction = numbers(axis, (3,), f"the axis of {who}")
    if not direction.any():
        raise ModelError(f"{who} has a zero axis, so it has no direction to move in. Give an axis such as 0 0 1.")
    return direction


def no_pitch(kind: str, pitch: float, who: str) -> None:
    """Raise ModelError if a joint without pitch is given one."""
    if number(pitch, f"the pitch of {who}"):
        raise ModelError(f"{who} is {kind} and has a pitch of {printed(pitch)} m/rad; only helical joints have one.")


def screw_of(kind: str, turning: bool, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
    """Screw axis (6,) of a rotating or sliding joint: from a direction and a pitch, or a given screw axis."""
    if np.shape(axis) == (6,):
        if pitch:
            raise ModelError(
                f"{who} has a screw axis and a pitch; a screw axis has its pitch in it, so leave out pitch."
            )
        return _screw(kind, turning, numbers(axis, (6,), f"the axis of {who}"), normalise, who)
    direction = direction_of(axis, who)
    direction = unit_vector(direction) if normalise else direction
    if not turning:
        return np.concatenate([np.zeros(3), direction])
    return np.concatenate([direction, np.zeros(3) + pitch * direction])


def _screw(kind: str, turning: bool, S: Array, normalise: bool, who: str) -> Array:
    turns, slides = bool(S[:3].any()), bool(S[3:].any())
    if not turns and not slides:
        raise ModelError(f"{who} has a zero screw axis, so it does not move. Give (omega, v) with a nonzero part.")
    if turns != turning:
        allowed = "a nonzero omega" if turning else "(0, 0, 0, v)"
        raise ModelError(f"{who} is {kind}, so its screw axis (omega, v) needs {allowed}; got {S.tolist()}.")
    if not normalise:
        return S
    return np.concatenate([np.zeros(3), unit_vector(S[3:])]) if not turns else np.array(S / np.linalg.norm(S[:3]))


def screw_through(kind: str, direction: Array, point: Array) -> Array:
    """Screw axis (6,) along a unit direction through a point: (ω, -ω × p), or (0, v) for a prismatic joint."""
    if kind == "prismatic":
        return np.concatenate([np.zeros(3), direction])
    return np.concatenate([direction, so3.cross(point, direction) + 0.0])


def unit_vector(v: Array) -> Array:
    """Unit vector along v. Scaled by the largest entry first, so that multiples of coordinate axes become exact."""
    x = v.tolist()
    if len(x) - x.count(0.0) == 1:  # coordinate axes, the usual case in files
        return np.sign(v)
    v = v / np.abs(v).max()
    return np.array(v / np.linalg.norm(v))


def plane_of(normal: Array) -> Array:
    """Axes (3, 6) of a planar joint with unit ``normal``: rotation about it, then translation along two directions.

    If the normal is a coordinate axis, the directions are the next two axes in cyclic order (z → x, y). Otherwise they are
    x and y, rotated by the shortest rotation from z to the normal.
    """
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


class ScrewJoint(Joint):
    """Joint of one degree of freedom; its coordinate is the angle or the displacement along its screw axis."""

    turns: ClassVar[bool] = True
    """True if it rotates about its axis, False if it slides along it."""
    has_pitch: ClassVar[bool] = False
    """True if it rotates and slides."""

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """Screw axis from a direction or a given screw axis."""
        no_pitch(cls.kind, pitch, who)
        return screw_of(cls.kind, cls.turns, axis, 0.0, normalise, who)[None, :]

    def pose(self, q: Array) -> Array:
        """Pose exp([S] q)."""
        return screw_motion(self.axes[0], q[0])

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Inertia of the carried body; a rotation about a coordinate axis takes fewer operations."""
        axis = self.axes[0]
        if np.count_nonzero(axis) == 1 and axis[:3].any():
            k = int(np.argmax(np.abs(axis)))
            return G.turned(k, axis[k] * q[0])
        return G.in_frame(self.pose(q))

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """The joint's own coordinate."""
        turns = self.turning[0]
        return (ChartEntry("theta" if turns else "x", turns, "joint {}"),)

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """A single slider."""
        return (Slider("", 0, "°", math.pi) if self.turning[0] else Slider("", 0, "m", 1.0),)


def screw_motion(axis: Array, theta: Any) -> Array:
    """exp([S] theta) for a constant screw axis S (6,) and a number or symbol theta; (4, 4). MR eq. 3.88.

    S may have any length: the angle is |omega| theta. Constants that are exactly 0 generate no operations.
    """
    w, v = axis[:3], axis[3:]
    rate = float(np.linalg.norm(w))
    if abs(rate - 1.0) < 1e-15:  # a unit vector up to rounding: its length is not multiplied
        rate = 1.0
    if rate == 0.0:
        return se3.pose(np.eye(3), v * theta)
    w, v, angle = w / rate, v / rate, (theta if rate == 1.0 else rate * theta)
    W = so3.hat(w)
    sin, cos = np.sin(angle), np.cos(angle)
    # G(theta) v of MR eq. 3.88, by terms: the pitch along w moves by angle, the rest rotates.
    p = sin * (-(W @ W) @ v) + (1.0 - cos) * (W @ v) + angle * (w * (w @ v))
    return se3.pose(rodrigues(w, cos, sin), p)


def rodrigues(w: Array, cosine: Any, sine: Any) -> Array:
    """Rotation about a unit vector, arranged so that axis-aligned rotations reduce to four entries; MR eq. 3.51."""
    along = np.outer(w, w)
    return along + cosine * (np.eye(3) - along) + sine * so3.hat(w)


class Revolute(ScrewJoint):
    """Joint that rotates about its axis."""

    kind = "revolute"


class Continuous(ScrewJoint):
    """Joint that rotates about its axis without limits."""

    kind = "continuous"
    wraps = (0,)


class Prismatic(ScrewJoint):
    """Joint that slides along its axis."""

    kind = "prismatic"
    turns = False


class Helical(ScrewJoint):
    """Screw joint, whose screw axis includes the pitch."""

    kind = "helical"
    has_pitch = True

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """Screw axis from a direction and a pitch."""
        pitch = float(numbers(pitch, (), f"the pitch of {who}"))
        return screw_of(cls.kind, True, axis, pitch, normalise, who)[None, :]


class RotorJoint(ScrewJoint):
    """Joint of a body of revolution that an actuator rotates on the link that carries it.

    Its inertia does not depend on its angle; so its frame does not rotate.
    """

    kind = "rotor"
    moves_body = False

    def pose(self, q: Array) -> Array:
        """Identity: the rotor's frame stays at its place on the carrier body."""
        return np.eye(4)

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Inertia of the carried body, unchanged."""
        return G
