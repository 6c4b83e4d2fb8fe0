"""Orientations at the door: rotations and quaternions are checked, and gravity is turned into the sensor's frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.gravity import GRAVITY
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..lie import quaternion
from ..typing import Array

_OFF = 1e-3  # numbers written with four decimals pass; a wrong column does not


def checked_rotations(pose: ArrayLike, where: str = "pose") -> Array:
    """The rotations (..., 3, 3) of rotations (..., 3, 3) or poses (..., 4, 4), put exactly onto the group.

    Raises :class:`~twistwrench.ShapeError`, and :class:`~twistwrench.ValueRangeError` that says how far off a matrix is
    when RᵀR differs from the identity by more than 1e-3.
    """
    try:
        T = np.asarray(pose, float)
    except (TypeError, ValueError, OverflowError):
        raise ShapeError(
            f"{where} is no array of numbers; expected rotations (..., 3, 3) or poses (..., 4, 4)."
        ) from None
    if T.shape[-2:] not in ((3, 3), (4, 4)):
        raise ShapeError(f"{where} has shape {T.shape}, expected rotations (..., 3, 3) or poses (..., 4, 4).")
    R = T[..., :3, :3]
    if not np.isfinite(R).all():
        raise ValueRangeError(f"{where} has entries that are not finite numbers. Fill or remove them.")
    off = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3)).max(axis=(-1, -2))
    if off.size and off.max() > _OFF:
        raise ValueRangeError(
            f"{where}{_at(off)} is no rotation: RᵀR differs from the identity by {printed(off.max(), 3)}, allowed is "
            f"{printed(_OFF)}. Check the order of its entries (row by row) and its decimals."
        )
    if (determinant := np.linalg.det(R)).size and determinant.min() < 0:
        raise ValueRangeError(
            f"{where}{_at(-determinant)} mirrors: its determinant is {printed(determinant.min(), 3)}, a rotation has 1. "
            "Swap no axes: the frame must be right-handed."
        )
    return quaternion.rotation(quaternion.from_matrix(R))


def rotations_of_quaternions(quat: ArrayLike, where: str = "quaternion") -> Array:
    """Rotations (..., 3, 3) of unit quaternions (..., 4), scalar first.

    Raises :class:`~twistwrench.ValueRangeError` saying how far off the length is if that is more than 1e-3.
    """
    quat = np.asarray(arguments.real(quat, where), float)
    if quat.shape[-1:] != (4,):
        raise ShapeError(f"{where} has shape {quat.shape}, expected (..., 4): qw, qx, qy, qz.")
    if not np.isfinite(quat).all():
        raise ValueRangeError(f"{where} has entries that are not finite numbers. Fill or remove them.")
    length = np.linalg.norm(quat, axis=-1)
    off = np.abs(length - 1.0)
    if off.size and off.max() > _OFF:
        raise ValueRangeError(
            f"{where}{_at(off)} has length {printed(float(length.flat[off.argmax()]))}, off from 1 by "
            f"{printed(off.max(), 3)}, allowed is {printed(_OFF)}. Check which columns are qw, qx, qy, qz (qw is the "
            "scalar), or normalise them."
        )
    return quaternion.rotation(quat)


def gravity_in_frame(pose: ArrayLike, gravity: ArrayLike = GRAVITY) -> Array:
    """Gravity (..., 3) [m/s²] in {f}, from the pose T_wf or rotation R_wf and gravity (..., 3) in {w}.

    >>> from twistwrench import so3
    >>> import numpy as np
    >>> np.round(gravity_in_frame(so3.exp([np.pi / 2, 0, 0])), 6).tolist()  # the tool turned a quarter about x
    [0.0, -9.81, 0.0]
    """
    g = np.asarray(arguments.real(gravity, "gravity"), float)
    if g.shape[-1:] != (3,):
        raise ShapeError(f"gravity has shape {g.shape}, expected (..., 3) [m/s²].")
    if not np.isfinite(g).all():
        raise ValueRangeError("gravity has entries that are not finite numbers.")
    R = checked_rotations(pose)
    return np.asarray((np.swapaxes(R, -1, -2) @ g[..., None])[..., 0])


def rotations_to_gravity(directions: ArrayLike) -> Array:
    """The least rotations R_wf (..., 3, 3) that bring gravity, along -z of {w}, to these directions (..., 3) of {f}."""
    d = np.asarray(directions, float)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    # The quaternion that takes d to -z: (1 + cos, d × -z), or a half turn about x when they are opposite.
    quat = np.stack([1.0 - d[..., 2], -d[..., 1], d[..., 0], np.zeros(d.shape[:-1])], axis=-1)
    opposite = np.linalg.norm(quat, axis=-1, keepdims=True) < 1e-9
    return quaternion.rotation(np.where(opposite, [0.0, 1.0, 0.0, 0.0], quat))


def _at(badness: Array) -> str:
    """Which one of a batch is the worst, counting from 0; nothing for a single one."""
    if badness.ndim == 0:
        return ""
    place = ", ".join(str(k) for k in np.unravel_index(int(badness.argmax()), badness.shape))
    return f"[{place}]"
