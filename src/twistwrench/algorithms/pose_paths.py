"""Paths from one pose to another: the constant screw, and the straight line of the origin. Modern Robotics section 9.2.1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError
from ..lie import se3, so3
from ..typing import Array


@dataclass(frozen=True, eq=False)
class PosePath:
    """Path of poses T(s) from s = 0 to 1, by a constant screw, or with the origin on a line.

    The rotation is then about a constant axis.
    """

    start: Array
    """Pose at s = 0 (4, 4)."""
    end: Array
    """Pose at s = 1 (4, 4)."""
    straight: bool
    """Whether the origin moves on a straight line."""
    twist: Array
    """(6,) the body twist dT/ds = T [V] of the screw; of a straight path (omega in the frame, v along the base's axes)."""

    def __call__(self, s: ArrayLike) -> Array:
        """T(s); (...) → (..., 4, 4).

        A straight path is R(s) = R0 exp(log(R0' R1) s), p(s) = p0 + s (p1 - p0), MR eq. 9.24 and 9.25; a screw
        T(s) = T0 exp(log(T0⁻¹ T1) s), MR eq. 9.23.
        """
        s = arguments.real(s, "s")[..., None]
        if not self.straight:
            return np.asarray(self.start @ se3.exp(s * self.twist))
        R = self.start[:3, :3] @ so3.exp(s * self.twist[:3])
        return se3.pose(R, s * self.end[:3, 3] + (1.0 - s) * self.start[:3, 3])

    def body_twist(self, s: ArrayLike) -> Array:
        """Body twist along the path, V(s) with dT/ds = T [V].

        Parameters
        ----------
        s : (...) array_like, 0 to 1

        Returns
        -------
        V : (..., 6) array, (omega, v) [rad, m]

        Examples
        --------
        >>> screw_path(np.eye(4), se3.exp([0, 0, 1, 2, 0, 0])).body_twist(0.5).round(12).tolist()
        [0.0, 0.0, 1.0, 2.0, 0.0, 0.0]
        """
        s = arguments.real(s, "s")
        if not self.straight:
            return np.broadcast_to(self.twist, (*s.shape, 6)).copy()
        R = self(s)[..., :3, :3]
        v = (np.swapaxes(R, -1, -2) @ self.twist[3:, None])[..., 0]
        return np.concatenate([np.broadcast_to(self.twist[:3], v.shape), v], axis=-1)


def screw_path(start: ArrayLike, end: ArrayLike) -> PosePath:
    """Screw path: the constant screw from one pose to another.

    Parameters
    ----------
    start : (4, 4) array_like, pose at s = 0
    end : (4, 4) array_like, pose at s = 1

    Returns
    -------
    path : PosePath

    Raises
    ------
    ShapeError, ValueRangeError
        An end is no pose (4, 4).

    Notes
    -----
    MR eq. 9.23.

    Examples
    --------
    >>> path = screw_path(np.eye(4), se3.exp([0, 0, np.pi / 2, 1, 0, 0]))
    >>> path(0.5)[:3, 3].round(6).tolist()
    [0.450158, 0.186462, 0.0]
    """
    start, end = _poses(start, end)
    return PosePath(start, end, False, se3.log(se3.inverse(start) @ end))


def straight_path(start: ArrayLike, end: ArrayLike) -> PosePath:
    """Straight path: the origin on a line, the rotation by itself about a constant axis.

    Parameters
    ----------
    start : (4, 4) array_like, pose at s = 0
    end : (4, 4) array_like, pose at s = 1

    Returns
    -------
    path : PosePath

    Raises
    ------
    ShapeError, ValueRangeError
        An end is no pose (4, 4).

    Notes
    -----
    MR eq. 9.24, 9.25.

    Examples
    --------
    >>> path = straight_path(np.eye(4), se3.exp([0, 0, np.pi / 2, 1, 0, 0]))
    >>> path(0.5)[:3, 3].round(6).tolist()
    [0.31831, 0.31831, 0.0]
    """
    start, end = _poses(start, end)
    w = so3.log(start[:3, :3].T @ end[:3, :3])
    return PosePath(start, end, True, np.concatenate([w, end[:3, 3] - start[:3, 3]]))


def _poses(start: ArrayLike, end: ArrayLike) -> tuple[Array, Array]:
    found = []
    for name, T in (("start", start), ("end", end)):
        M = np.asarray(arguments.pose(arguments.finite(T, name, 4, 4), name), float)
        if M.shape != (4, 4):
            raise ShapeError(f"{name} has shape {M.shape}: a path leads from one pose (4, 4) to another.")
        found.append(M)
    return found[0], found[1]
