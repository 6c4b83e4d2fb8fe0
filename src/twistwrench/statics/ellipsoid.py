"""The wrench ellipsoid: what torques of unit norm can press with, direction by direction. Modern Robotics section 5.4."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.printed_numbers import number, vector
from ..errors import UnknownNameError, ValueRangeError
from ..typing import Array
from .holding_torques import RANK_TOLERANCE
from .pose_arguments import same_batch, unit_vectors
from .torque_limits import effort_limits

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.quantity_types import Kind

PARTS = {"moment": slice(0, 3), "force": slice(3, 6), "wrench": slice(0, 6)}
"""The rows of a wrench that each part means."""


@dataclass(frozen=True, eq=False, repr=False)
class WrenchEllipsoid:
    """Force ellipsoid: all x (n,) with x' A x ≤ 1, centred where the torques of gravity would put nothing.

    Leading axes are the poses'.
    """

    matrix: Array
    """(..., n, n): A = J W⁻² J', with the rows of J that are meant and W the scale of each torque."""
    axes: Array
    """(..., n, n): the directions of the semi-axes, as columns, strongest first."""
    semi_axes: Array
    """(..., n): their lengths, descending; inf along what the structure bears."""
    part: str
    """"force", "moment" or "wrench"."""
    kind: Kind
    """Axes and reference point, as in :meth:`Robot.jacobian`."""

    def __repr__(self) -> str:
        what = f"WrenchEllipsoid of {self.part}s, {self.kind}"
        if self.semi_axes.ndim > 1:
            return f"{what}, of poses {self.semi_axes.shape[:-1]}"
        said = [
            f"{number(size)} along {vector(np.round(axis * np.sign(axis[np.argmax(np.abs(axis))]), 4))}"
            for size, axis in zip(self.semi_axes, self.axes.T, strict=True)
            if not np.isinf(size)
        ]
        free = int(np.isinf(self.semi_axes).sum())
        across = [f"unbounded in {free} direction{'s' if free > 1 else ''}"] if free else []
        return f"{what}: {', '.join(said + across)}"

    @property
    def condition(self) -> Array:
        """Condition number (...): the longest semi-axis over the shortest; inf at singular poses."""
        return self.semi_axes[..., 0] / self.semi_axes[..., -1]

    def reach(self, direction: ArrayLike) -> Array:
        """How far the ellipsoid extends along a direction.

        Parameters
        ----------
        direction : (..., n) array_like, made of unit length

        Returns
        -------
        reach : (...) array [N or N m for each unit of torque]

        Raises
        ------
        ShapeError, ValueRangeError
            ``direction`` is of another size, or zero.

        Examples
        --------
        >>> import twistwrench as tw
        >>> float(wrench_ellipsoid(tw.robots.planar_2r(), [0.0, np.pi / 2]).reach([0, 1, 0]))
        inf
        """
        d = unit_vectors(direction, self.matrix.shape[-1])
        same_batch(poses=self.semi_axes, direction=d)
        square = np.einsum("...i,...ij,...j->...", d, self.matrix, d)
        none = square <= RANK_TOLERANCE**2 * np.trace(self.matrix, axis1=-2, axis2=-1)
        return np.where(none, np.inf, 1.0 / np.sqrt(np.where(none, 1.0, square)))


def wrench_ellipsoid(
    robot: Robot,
    q: ArrayLike,
    frame: str | None = None,
    *,
    part: str = "force",
    kind: Kind = "world_aligned",
    limits: ArrayLike | None = None,
) -> WrenchEllipsoid:
    """Force ellipsoid: the wrenches whose torques have norm at most 1, without gravity.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    frame : str, optional, a link of the robot; its tip if None
    part : "force", "moment" or "wrench"
        "force", at zero moment, the book's force ellipsoid f' J_v J_v' f = 1; "moment", at zero force; or "wrench", all
        six numbers (m, f), whose axes depend on the unit of length.
    kind : "body", "space" or "world_aligned", axes and reference point as in :meth:`twistwrench.Robot.jacobian`
    limits : (nv,) array_like, optional, each torque then counts as a share of its limit [N m, sliding joints: N]

    Returns
    -------
    ellipsoid : WrenchEllipsoid, with n semi-axes, for any batch of q; rows with NaN have NaN

    Raises
    ------
    UnknownNameError, ShapeError, ValueRangeError
        An argument is none of the choices, or of another size.

    Notes
    -----
    MR section 5.4. With ``limits`` the ellipsoid lies inside the polytope of
    :func:`~twistwrench.statics.wrench_polytope` without gravity.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> wrench_ellipsoid(arm, [0.0, np.pi / 2]).semi_axes.round(6).tolist()  # the golden ratio, and one over it
    [inf, 1.618034, 0.618034]
    >>> wrench_ellipsoid(arm, [0.0, np.pi / 2], part="moment")
    WrenchEllipsoid of moments, world_aligned: 0.7071 along (0, 1, 0), unbounded in 2 directions
    """
    J = np.asarray(robot.jacobian(q, frame, kind))[..., part_rows(part), :]
    if limits is not None:
        J = J * effort_weights(robot, limits)
    A = J @ np.swapaxes(J, -1, -2)
    unknown = np.isnan(J).any(axis=(-2, -1))
    U, s, _ = np.linalg.svd(np.where(unknown[..., None, None], 0.0, J), full_matrices=True)
    U, s = np.where(unknown[..., None, None], np.nan, U), np.where(unknown[..., None], np.nan, s)
    n = J.shape[-2]
    sigma = np.concatenate([s, np.zeros((*s.shape[:-1], n - s.shape[-1]))], axis=-1)
    flat = sigma <= RANK_TOLERANCE * np.maximum(sigma.max(axis=-1, keepdims=True), 1e-300)
    semi_axes = np.where(flat, np.inf, 1.0 / np.where(flat, 1.0, sigma))
    return WrenchEllipsoid(A, U[..., ::-1], semi_axes[..., ::-1], part, kind)


def effort_weights(robot: Robot, limits: ArrayLike | None) -> Array:
    """One over each limit, (nv,); zero where a joint has none. Raises ValueRangeError for a limit of zero."""
    L = effort_limits(robot, limits)
    if (L == 0).any():
        raise ValueRangeError(
            "a torque limit of zero leaves the ellipsoid and the polytope no inside. "
            "Give limits above zero, or ask statics.robot_equilibrium, which takes joints that nothing drives."
        )
    return 1.0 / L


def part_rows(part: str) -> slice:
    """The rows of a wrench meant by ``part``; UnknownNameError lists the choices."""
    try:
        return PARTS[part]
    except (KeyError, TypeError):
        raise UnknownNameError.of("part of a wrench", part, PARTS) from None
