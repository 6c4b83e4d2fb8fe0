"""Joints of one degree of freedom, given by a screw axis: revolute, continuous, prismatic, helical and rotor. MR eq. 3.88."""

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
    """New array of finite floats. Raises :class:`~twistwrench.ModelError` for other values; ``what`` is their name in it."""
    try:
        array = np.array(values, float)
    except (TypeError, ValueError):
        raise ModelError(f"{what} is {values!r}, expected {_shape_text(shape)}.") from None
    if array.shape != shape:
        raise ModelError(f"{what} has shape {array.shape}, expected {_shape_text(shape)}.")
    all_numbers = array.ravel().tolist()  # as a list, short arrays are tested faster
    if not all(map(math.isfinite, all_numbers)):
        raise ModelError(f"{what} is {array.tolist()}; every number must be finite.")
    return array


def number(value: float | ArrayLike, what: str) -> float:
    """Finite float. Raises :class:`~twistwrench.ModelError` for another value; ``what`` is its name in it."""
    if isinstance(value, float) and math.isfinite(value):  # the usual case, without an array
        return float(value)
    return float(numbers(value, (), what))


def _shape_text(shape: tuple[int, ...]) -> str:
    """Text of the expected numbers."""
    return f"numbers of shape {shape}" if shape else "a number"


def direction_of(axis: ArrayLike, who: str) -> Array:
    """Nonzero direction (3,), not normalised. Raises ModelError for a zero axis; ``who`` names the joint in messages."""
    direction = numbers(axis, (3,), f"the axis of {who}")
    if not direction.any():
        raise ModelError(f"{who} has a zero axis, so it has no direction to move in. Give an axis such as 0 0 1.")
    return direction


def no_pitch(kind: str, pitch: float, who: str) -> None:
    """Raise ModelError for a nonzero pitch of a joint whose kind has none."""
    if number(pitch, f"the pitch of {who}"):
        raise ModelError(f"{who} is {kind} and has a pitch of {printed(pitch)} m/rad; only helical joints have one.")


def screw_of(kind: str, turning: bool, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
    """Screw axis (6,) of a joint that rotates (``turning``) or slides.

    ``axis`` is a direction (3,), to which the pitch is added, or a screw axis (6,), which contains the pitch. With
    ``normalise`` the direction becomes a unit vector.
    """
    if np.shape(axis) == (6,):
        if pitch:
            raise ModelError(
                f"{who} has a screw axis and a pitch; a screw axis has its pitch in it, so leave out pitch."
            )
        screw = numbers(axis, (6,), f"the axis of {who}")
        return _checked_screw(kind, turning, screw, normalise, who)
    direction = direction_of(axis, who)
    if normalise:
        direction = unit_vector(direction)
    if not turning:
        return np.concatenate([np.zeros(3), direction])
    return np.concatenate([direction, np.zeros(3) + pitch * direction])  # + 0 turns -0 into 0


def _checked_screw(kind: str, turning: bool, screw: Array, normalise: bool, who: str) -> Array:
    """The given screw axis (6,), normalised if requested. Raises ModelError if it does not suit the kind of joint."""
    omega, v = screw[:3], screw[3:]
    if not omega.any() and not v.any():
        raise ModelError(f"{who} has a zero screw axis, so it does not move. Give (omega, v) with a nonzero part.")
    if bool(omega.any()) != turning:
        needed = "a nonzero omega" if turning else "(0, 0, 0, v)"
        raise ModelError(f"{who} is {kind}, so its screw axis (omega, v) needs {needed}; got {screw.tolist()}.")
    if not normalise:
        return screw
    if turning:
        return np.array(screw / np.linalg.norm(omega))
    return np.concatenate([np.zeros(3), unit_vector(v)])


def screw_through(kind: str, direction: Array, point: Array) -> Array:
    """Screw axis (6,) along a unit direction through a point: (ω, -ω × p), or (0, v) for a prismatic joint."""
    if kind == "prismatic":
        return np.concatenate([np.zeros(3), direction])
    v = so3.cross(point, direction) + 0.0  # p × ω = -ω × p; + 0 turns -0 into 0
    return np.concatenate([direction, v])


def unit_vector(v: Array) -> Array:
    """Unit vector along v (3,), exact for multiples of coordinate axes."""
    entries = v.tolist()
    nonzero_count = len(entries) - entries.count(0.0)
    if nonzero_count == 1:  # coordinate axes, the usual case in files
        return np.sign(v)
    scaled = v / np.abs(v).max()  # so that squares neither overflow nor vanish
    return np.array(scaled / np.linalg.norm(scaled))


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
        rotation_axis = so3.cross(z, normal)
        sine = float(np.linalg.norm(rotation_axis))
        cosine = float(normal[2])
        if sine > 0:
            angle = np.arctan2(sine, cosine)
            R = so3.exp(rotation_axis / sine * angle)
        else:  # normal -z: half a turn about x
            R = np.diag([1.0, -1.0, -1.0])
        e1, e2 = R[:, 0], R[:, 1]
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
        """Screw axis (1, 6) from a direction (3,) or a screw axis (6,)."""
        no_pitch(cls.kind, pitch, who)
        return screw_of(cls.kind, cls.turns, axis, 0.0, normalise, who)[None, :]

    def pose(self, q: Array) -> Array:
        """Pose exp([S] q)."""
        return screw_motion(self.axes[0], q[0])

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Inertia of the carried body; a rotation about a coordinate axis takes fewer operations."""
        axis = self.axes[0]
        turns_about_coordinate_axis = np.count_nonzero(axis) == 1 and axis[:3].any()
        if turns_about_coordinate_axis:
            k = int(np.argmax(np.abs(axis)))
            return G.turned(k, axis[k] * q[0])
        return G.in_frame(self.pose(q))

    @property
    def chart(self) -> tuple[ChartEntry, ...]:
        """Entry of the joint's only coordinate."""
        is_angle = self.turning[0]
        return (ChartEntry("theta" if is_angle else "x", is_angle, "joint {}"),)

    @property
    def sliders(self) -> tuple[Slider, ...]:
        """Slider in degrees for an angle, in metres for a displacement."""
        if self.turning[0]:
            return (Slider("", 0, "°", math.pi),)  # ± 180°
        return (Slider("", 0, "m", 1.0),)  # ± 1 m


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
    angle = theta if rate == 1.0 else rate * theta
    w, v = w / rate, v / rate
    W = so3.hat(w)
    sin, cos = np.sin(angle), np.cos(angle)
    # G(θ) v of MR eq. 3.88 with [w]² = w w' - 1:  -sin θ [w]² v + (1 - cos θ) [w] v + θ w (w'v). The last term is the pitch.
    p = sin * (-(W @ W) @ v) + (1.0 - cos) * (W @ v) + angle * (w * (w @ v))
    return se3.pose(rodrigues(w, cos, sin), p)


def rodrigues(w: Array, cosine: Any, sine: Any) -> Array:
    """Rotation about a unit vector, w w' + cos θ (1 - w w') + sin θ [w]; MR eq. 3.51 with [w]² = w w' - 1.

    In this form a rotation about a coordinate axis reduces to four entries.
    """
    ww = np.outer(w, w)
    return ww + cosine * (np.eye(3) - ww) + sine * so3.hat(w)


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
        """Screw axis (1, 6) from a direction (3,) and a pitch [m/rad], or from a screw axis (6,)."""
        pitch = float(numbers(pitch, (), f"the pitch of {who}"))
        return screw_of(cls.kind, True, axis, pitch, normalise, who)[None, :]


class RotorJoint(ScrewJoint):
    """Joint of a body of revolution that an actuator rotates on the link that carries it.

    The inertia of such a body does not depend on its angle, so its frame does not rotate.
    """

    kind = "rotor"
    moves_body = False

    def pose(self, q: Array) -> Array:
        """Identity: the rotor's frame is fixed to the carrier body."""
        return np.eye(4)

    def carry(self, G: SpatialInertia, q: Array) -> SpatialInertia:
        """Inertia of the carried body, unchanged."""
        return G
