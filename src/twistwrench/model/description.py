"""What a robot description says, link by link and joint by joint, each checked by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.inertia import SpatialInertia
from ..errors import InertiaError, ModelError
from .joint import JOINT_KINDS, Joint, planar_axes, screw_axis
from .model import Limits

Array = NDArray[Any]
Mimic = tuple[str, float, float]
"""Leader, multiplier and offset: the joint's coordinate is multiplier * leader's + offset."""

__all__ = [
    "KINDS",
    "JointEntry",
    "LinkEntry",
    "Mimic",
    "axes_of",
    "label",
    "limits_of",
    "link_entry",
    "mimic_of",
    "numbers",
    "placement_of",
]

KINDS = (*JOINT_KINDS, "fixed")
"""The kinds of joints that may be described; fixed ones are fused away when the model is built."""


def label(kind: str, name: str, where: str) -> str:
    """How messages call a link or joint: ``joint 'elbow' (line 12)``."""
    return f"{kind} {name!r} ({where})" if where else f"{kind} {name!r}"


@dataclass(frozen=True, eq=False)
class LinkEntry:
    """One described link."""

    name: str
    inertia: SpatialInertia
    """About the link frame's origin; zero when none is given."""
    where: str
    shaped: bool = False
    """Whether it has a shape, to be seen or to be touched."""

    def __str__(self) -> str:
        return label("link", self.name, self.where)


@dataclass(frozen=True, eq=False)
class JointEntry:
    """One described joint. A fixed one is a joint without axes."""

    joint: Joint
    parent: str
    child: str
    placement: Array
    """(4, 4) T_parent,child with the joint at zero."""
    limits: Limits
    damping: float
    friction: float
    mimic: Mimic | None
    where: str

    @property
    def name(self) -> str:
        """The joint's name."""
        return self.joint.name

    @property
    def fixed(self) -> bool:
        """Whether the joint holds two links together rigidly."""
        return self.joint.kind == "fixed"

    def __str__(self) -> str:
        return label("joint", self.name, self.where)


def numbers(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """``values`` as a fresh array of finite floats; otherwise a :class:`~twistwrench.ModelError` naming ``what``."""
    try:
        array = np.array(values, float)
    except (TypeError, ValueError):
        raise ModelError(f"{what} is {values!r}, expected {_shape_in_words(shape)}.") from None
    if array.shape != shape:
        raise ModelError(f"{what} has shape {array.shape}, expected {_shape_in_words(shape)}.")
    if not np.isfinite(array).all():
        raise ModelError(f"{what} is {array.tolist()}; every number must be finite.")
    return array


def _shape_in_words(shape: tuple[int, ...]) -> str:
    return f"numbers of shape {shape}" if shape else "a number"


def link_entry(name: str, inertia: SpatialInertia | None, where: str, shaped: bool = False) -> LinkEntry:
    """A link whose inertia is finite and whose mass is not negative: no policy can mend those."""
    link = LinkEntry(name, SpatialInertia.zero() if inertia is None else inertia, where, shaped)
    if not np.isfinite(link.inertia.parameters).all():
        raise InertiaError(f"{link} has an inertia that is not finite, {link.inertia.parameters.tolist()}.")
    if link.inertia.mass < 0:
        raise InertiaError(f"{link} has a negative mass, {link.inertia.mass:g} kg. A mass must be zero or positive.")
    return link


def mimic_of(mimic: Mimic | None, who: str) -> Mimic | None:
    """A mimic with its numbers checked."""
    if mimic is None:
        return None
    leader, multiplier, offset = mimic
    ratio, shift = numbers([multiplier, offset], (2,), f"the mimic multiplier and offset of {who}")
    return leader, float(ratio), float(shift)


def placement_of(T: ArrayLike | None, who: str) -> Array:
    """A pose (4, 4), the identity for None; raises unless it is a rigid motion."""
    if T is None:
        return np.eye(4)
    T = numbers(T, (4, 4), f"the placement of {who}")
    R = T[:3, :3]
    # 1e-6: rotations typed with six digits are meant as rotations; anything worse is another kind of matrix.
    if np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0 or np.any(T[3] != (0, 0, 0, 1)):
        raise ModelError(f"the placement of {who} is no pose: it needs a rotation, a position and a last row 0 0 0 1.")
    if np.abs(R.T @ R - np.eye(3)).max() > 1e-14:  # the nearest rotation: algorithms take a transpose for an inverse
        left, _, right = np.linalg.svd(R)
        T = T.copy()
        T[:3, :3] = left @ right
    return T


def axes_of(kind: str, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
    """The screw axes (nv, 6) of a joint, from a direction (3,) or a screw axis (6,) in the child's frame.

    Fixed and floating joints have no direction, so none is looked at.
    """
    if kind == "fixed":
        return np.zeros((0, 6))
    if kind == "floating":
        return np.eye(6)
    pitch = float(numbers(pitch, (), f"the pitch of {who}"))
    if pitch and kind != "helical":
        raise ModelError(f"{who} is {kind} and has a pitch of {pitch:g} m/rad; only helical joints have one.")
    if np.shape(axis) == (6,) and kind != "planar":
        if pitch:
            raise ModelError(
                f"{who} has a screw axis and a pitch; a screw axis has its pitch in it, so leave out pitch."
            )
        return _screw(kind, numbers(axis, (6,), f"the axis of {who}"), normalise, who)[None, :]
    direction = numbers(axis, (3,), f"the axis of {who}")
    if not direction.any():
        raise ModelError(f"{who} has a zero axis, so it has no direction to move in. Give an axis such as 0 0 1.")
    if kind == "planar":
        return planar_axes(_unit(direction))
    return screw_axis(kind, _unit(direction) if normalise else direction, pitch=pitch)[None, :]


def _screw(kind: str, S: Array, normalise: bool, who: str) -> Array:
    turns, slides = S[:3].any(), S[3:].any()
    if not turns and not slides:
        raise ModelError(f"{who} has a zero screw axis, so it does not move. Give (omega, v) with a nonzero part.")
    if turns == (kind == "prismatic"):
        allowed = "(0, 0, 0, v)" if kind == "prismatic" else "a nonzero omega"
        raise ModelError(f"{who} is {kind}, so its screw axis (omega, v) needs {allowed}; got {S.tolist()}.")
    if not normalise:
        return S
    return np.concatenate([np.zeros(3), _unit(S[3:])]) if not turns else np.array(S / np.linalg.norm(S[:3]))


def _unit(v: Array) -> Array:
    # By the largest entry first, so that a multiple of a coordinate axis becomes exactly it, and nothing overflows.
    v = v / np.abs(v).max()
    return np.array(v / np.linalg.norm(v))


def limits_of(
    joint: Joint, lower: float | None, upper: float | None, velocity: float | None, effort: float | None, who: str
) -> tuple[Limits, list[str]]:
    """The limits of a joint, (nv,) each, infinite where none is given, and remarks on those that cannot be meant."""
    remarks: list[str] = []
    none = np.full(joint.nv, np.inf)
    if joint.kind == "fixed":
        return Limits(-none, none, none, none), remarks
    if joint.nv > 1:
        if any(x is not None for x in (lower, upper, velocity, effort)):
            remarks.append(f"{who} is {joint.kind}; limits of joints with several coordinates are not kept")
        return Limits(-none, none, none, none), remarks
    low, high = _bounds(joint.kind, lower, upper, who, remarks)
    speed = _magnitude("velocity", velocity, who, remarks)
    most = _magnitude("effort", effort, who, remarks)
    return Limits(np.array([low]), np.array([high]), np.array([speed]), np.array([most])), remarks


def _bounds(kind: str, lower: float | None, upper: float | None, who: str, remarks: list[str]) -> tuple[float, float]:
    low = -np.inf if lower is None else _limit("lower", lower, who)
    high = np.inf if upper is None else _limit("upper", upper, who)
    if kind == "continuous":  # turns without end, whatever the file says
        return -np.inf, np.inf
    if low == high == 0:
        remarks.append(f"{who} has lower = upper = 0, taken to mean that no limits are given")
        return -np.inf, np.inf
    if low > high or low == np.inf or high == -np.inf:
        raise ModelError(
            f"{who} has reversed limits: lower={low:g} is above upper={high:g}. "
            "Exchange them, or leave both out where there are none, which some simulators mean by this."
        )
    return low, high


def _limit(what: str, value: float, who: str) -> float:
    try:
        value = float(value)
    except (TypeError, ValueError):
        value = np.nan
    if np.isnan(value):
        raise ModelError(
            f"{who} has {what}={value!r} as its limit; a limit is a number. Leave it out where there is none."
        )
    return value


def _magnitude(what: str, value: float | None, who: str, remarks: list[str]) -> float:
    if value is None:
        return float(np.inf)
    value = _limit(what, value, who)
    if value < 0:
        raise ModelError(
            f"{who} has {what}={value:g} as its limit; a limit is a positive number. Leave it out where there is none."
        )
    if value == 0:
        remarks.append(f"{who} has a limit {what}=0, taken to mean that none is given")
        return float(np.inf)
    return value
