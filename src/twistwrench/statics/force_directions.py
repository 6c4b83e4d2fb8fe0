"""The largest wrench along a direction, and the direction in which a robot is weakest: both in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.printed_numbers import number
from ..errors import ValueRangeError
from ..typing import Array
from .ellipsoid import part_rows
from .pose_arguments import same_batch, unit_vectors
from .torque_limits import effort_limits, growth, require_fixed_base, resting_torques, span

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.quantity_types import Kind


@dataclass(frozen=True, eq=False)
class LargestWrench:
    """Largest wrench along a direction: how much the robot can apply at rest.

    Leading axes are the poses' and directions'.
    """

    magnitude: Array
    """(...) N (N m for a moment): 0 where the robot cannot hold even itself, inf where the structure bears it."""
    wrench: Array
    """(..., 6): the direction, of unit length, as (m, f)."""
    joint: Array
    """(...) of int: the joint that is then at its limit; -1 if none."""
    side: Array
    """(...): +1 if at its upper limit, -1 at its lower; 0 if none."""
    joint_names: tuple[str, ...]
    """Names of the joints, as ``joint`` counts them."""

    def __str__(self) -> str:
        if self.magnitude.ndim:
            return f"largest wrenches: {span(self.magnitude)}"
        if np.isnan(self.magnitude):
            return "unknown: q has an entry that is not a number"
        name = self.joint_names[int(self.joint)] if self.joint >= 0 else "no joint"
        along = ", ".join(number(round(x, 12) + 0.0, 3) for x in self.wrench)  # no minus zeros
        return f"{number(self.magnitude)} along ({along}), limited by {name}"


def largest_wrench(
    robot: Robot,
    q: ArrayLike,
    direction: ArrayLike,
    *,
    frame: str | None = None,
    kind: Kind = "world_aligned",
    limits: ArrayLike | None = None,
) -> LargestWrench:
    """Largest force or wrench along a direction: the largest s with s · direction within the torque limits, at rest.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    direction : (3,) or (6,) array_like, a force at zero moment, or a wrench (m, f); made of unit length
    frame : str, optional, a link of the robot; its tip if None
    kind : "body", "space" or "world_aligned", axes and reference point as in :meth:`twistwrench.Robot.jacobian`
    limits : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]

    Returns
    -------
    found : LargestWrench, ``magnitude`` () [N, moments: N m]

    Raises
    ------
    ShapeError, ValueRangeError
        An argument is of another size, or the direction is zero.
    UnknownNameError
        The robot has no such frame.
    FrameError
        No frame is named, and the robot has no single tip.

    Notes
    -----
    Closed form: the least over the joints of (L - sign(a) g) / abs(a), with a = J' direction and g the torques of
    gravity and of springs. MR section 5.2.

    Examples
    --------
    >>> import twistwrench as tw
    >>> print(largest_wrench(tw.robots.planar_2r(), [0.0, 0.0], (0, 0, 1), limits=[50.0, 20.0]))
    10.19 along (0, 0, 0, 0, 0, 1), limited by joint2
    """
    require_fixed_base(robot, "the largest wrench")
    d = unit_vectors(direction, 3, 6)
    F = d if d.shape[-1] == 6 else np.concatenate([np.zeros_like(d), d], axis=-1)
    g, J = resting_torques(robot, q), np.asarray(robot.jacobian(q, frame, kind))
    same_batch(q=g, direction=F)
    return _along(robot, g, J, F, effort_limits(robot, limits))


def weakest_direction(
    robot: Robot,
    q: ArrayLike,
    *,
    frame: str | None = None,
    part: str = "force",
    kind: Kind = "world_aligned",
    limits: ArrayLike | None = None,
) -> LargestWrench:
    """Weakest direction: the one in which the robot at rest can apply least.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    frame : str, optional, a link of the robot; its tip if None
    part : "force", "moment" or "wrench", as in :func:`wrench_ellipsoid`
    kind : "body", "space" or "world_aligned", axes and reference point as in :meth:`twistwrench.Robot.jacobian`
    limits : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]

    Returns
    -------
    found : LargestWrench

    Raises
    ------
    ShapeError, ValueRangeError, FrameError, UnknownNameError
        As :func:`largest_wrench`.

    Notes
    -----
    The polytope's nearest facet decides: it belongs to the joint and sign with the least (L ∓ g_i) / |J_i|, where J_i
    is the joint's column of J, and its normal ±J_i / |J_i| is the direction. Any batch of q; rows with NaN have NaN.

    Examples
    --------
    >>> import twistwrench as tw
    >>> print(weakest_direction(tw.robots.planar_2r(), [0.0, 0.0], limits=[50.0, 20.0]))
    10.19 along (0, 0, 0, 0, 0, 1), limited by joint2
    """
    require_fixed_base(robot, "the weakest direction")
    rows, L = part_rows(part), effort_limits(robot, limits)
    g, J = resting_torques(robot, q), np.asarray(robot.jacobian(q, frame, kind))
    lever = np.linalg.norm(J[..., rows, :], axis=-2)
    felt = lever > 1e-12 * np.maximum(1.0, lever.max(axis=-1, initial=0.0, keepdims=True))
    unknown = np.isnan(g).any(axis=-1) | np.isnan(lever).any(axis=-1)
    if not (felt.any(axis=-1) | unknown).all():
        raise ValueRangeError(
            f"no joint of {robot.name!r} feels any {part} there: the structure bears it all. Name a frame it moves."
        )
    distance = np.where(felt, (L - np.abs(g)) / np.where(felt, lever, 1.0), np.inf)
    joint = np.argmin(distance, axis=-1)[..., None]
    sign = np.where(np.take_along_axis(g, joint, axis=-1) < 0, -1.0, 1.0)
    column = sign * np.take_along_axis(J, joint[..., None, :], axis=-1)[..., 0]
    F = np.zeros_like(column)
    F[..., rows] = column[..., rows]
    F /= np.where(unknown[..., None], np.nan, np.linalg.norm(F, axis=-1, keepdims=True))
    return _along(robot, g, J, F, L)


def _along(robot: Robot, g: Array, J: Array, F: Array, L: Array) -> LargestWrench:
    a = np.einsum("...ij,...i->...j", J, F)
    s = growth(g, a, L)
    unknown = np.isnan(g).any(axis=-1) | np.isnan(a).any(axis=-1)
    holds = np.all(np.abs(g) <= L, axis=-1)
    return LargestWrench(
        np.where(unknown, np.nan, np.where(holds, np.maximum(s.most, 0.0), 0.0)),
        np.broadcast_to(F, (*a.shape[:-1], 6)).copy(),
        np.where(holds, s.joint, -1),
        np.where(holds, s.side, 0),
        robot.model.velocity_names,
    )
