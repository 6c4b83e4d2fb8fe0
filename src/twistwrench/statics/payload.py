"""The largest mass a robot can hold at a pose: in closed form, since gravity's torques are linear in the mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import number, printed
from ..errors import ShapeError
from ..model.limits import margin
from ..model.mimic import follower_torques
from ..report.loaded_robot import least_torque_per_kilogram
from ..typing import Array
from .pose_arguments import one_configuration, same_batch
from .torque_limits import effort_limits, growth, require_fixed_base, resting_torques, span

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True, eq=False)
class LargestPayload:
    """Largest payload: the largest mass held at rest, and the joint that is then at its limit.

    Leading axes are the poses'. Mimic joints that have a limit of effort and bear the payload, or more than their limit
    without it, are joints like others here, after those of dq.
    """

    mass: Array
    """(...) kg: 0 where the robot cannot hold even itself, inf where no joint feels the mass, nan where q is nan."""
    joint: Array
    """(...) of int: index of the limiting joint in ``joint_names``; -1 if none."""
    side: Array
    """(...): +1 if that joint is at its upper limit, -1 at its lower; 0 if none."""
    holds: Array
    """(...) of bool: whether the robot holds itself, with nothing in its hand."""
    unloaded: Array
    """(..., nv): g(q), the torques that hold the robot alone [N m or N]."""
    per_kilogram: Array
    """(..., nv): what each kilogram adds to them."""
    per_joint: Array
    """(..., nv) kg: the mass each joint could hold, were it the only weak one."""
    limits: Array
    """(nv,): the limits used."""
    joint_names: tuple[str, ...]
    """Names of the joints, as ``joint`` counts them."""

    @property
    def torques(self) -> Array:
        """Holding torques with the largest payload (..., nv) [N m or N]; without one where that is not finite."""
        mass = np.where(np.isfinite(self.mass), self.mass, 0.0)
        return self.unloaded + mass[..., None] * self.per_kilogram

    @property
    def share(self) -> Array:
        """Holding torques as shares of the limits (..., nv), 1 for the limiting joint."""
        idle = np.where(self.torques == 0, 0.0, np.inf)  # a joint that can give nothing
        return np.divide(np.abs(self.torques), self.limits, out=idle, where=self.limits > 0)

    def __str__(self) -> str:
        if self.mass.ndim:
            return f"largest payloads [kg] of {self.mass.size} poses: {span(self.mass)}"
        if np.isnan(self.mass):
            return "unknown: q has an entry that is not a number"
        if not self.holds:
            k = int(np.argmax(np.abs(self.unloaded) - self.limits))
            return (
                f"no payload: {self.joint_names[k]} needs {number(abs(self.unloaded[k]))} of {number(self.limits[k])} "
                "to hold the robot alone"
            )
        if self.joint < 0:
            return "not limited at this pose: no joint with a limit carries the payload"
        k = int(self.joint)
        return f"{number(self.mass)} kg, then {self.joint_names[k]} is at {printed(self.side * self.limits[k], 4, signed=True)}"


def torques_per_kilogram(
    robot: Robot, q: ArrayLike, com: ArrayLike = (0.0, 0.0, 0.0), frame: str | None = None
) -> Array:
    """Holding torques of one kilogram at a point of a frame, the robot's own weight left out.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    com : (3,) array_like, centre of mass of the payload in the frame [m]
    frame : str, optional, a link of the robot; its tip if None

    Returns
    -------
    tau : (nv,) array [N m/kg, sliding joints: N/kg]

    Raises
    ------
    ShapeError, ValueRangeError, FrameError, UnknownNameError
        As the robot's methods.

    Notes
    -----
    τ = J_b' F with F = (c × f, f), f = -R' g the force that carries a kilogram, in the frame: MR eq. 5.26. Any batch of
    q and com broadcasts.

    Examples
    --------
    >>> import twistwrench as tw
    >>> torques_per_kilogram(tw.robots.planar_2r(), [0.0, 0.0]).round(2).tolist()
    [19.62, 9.81]
    """
    return robot.wrench_torques(q, _wrench_per_kilogram(robot, q, com, frame), frame)


def _wrench_per_kilogram(robot: Robot, q: ArrayLike, com: ArrayLike, frame: str | None) -> Array:
    """The wrench (..., 6) that carries a kilogram at a point of a frame, in the frame."""
    c = points(com)
    R = np.asarray(robot.forward_kinematics(q, frame))[..., :3, :3]
    same_batch(q=R[..., 0], com=c)
    f = -np.einsum("...ji,j->...i", R, robot.gravity)
    return np.concatenate([np.cross(c, f), np.broadcast_to(f, np.broadcast_shapes(c.shape, f.shape))], axis=-1)


def _followers(
    robot: Robot, q: ArrayLike, com: ArrayLike, frame: str | None
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """What mimic joints with a limit of effort bear alone and per kilogram, (..., k) each, their limits (k,), their names.

    Of those that the payload loads, or that are beyond their limits without one.
    """
    model, zero = robot.model, np.zeros(robot.nv)
    where, F = robot.tip if frame is None else frame, _wrench_per_kilogram(robot, q, com, frame)
    alone = np.asarray(robot.joint_wrenches(q, zero, zero))
    alone, loaded = np.broadcast_arrays(alone, robot.joint_wrenches(q, zero, zero, wrench_by_robot={str(where): F}))
    unloaded, added = follower_torques(model, alone), follower_torques(model, loaded - alone)
    added = np.where(np.abs(added) < least_torque_per_kilogram(model), 0.0, added)
    bodies = [model.bodies[i] for i in model.limited_followers]
    limits = np.array([body.effort for body in bodies])
    matters = (added != 0) | (np.abs(unloaded) > limits + margin(limits))
    kept = np.flatnonzero(matters.reshape(-1, len(bodies)).any(axis=0))
    return unloaded[..., kept], added[..., kept], limits[kept], tuple(bodies[k].joint.name for k in kept)


def largest_payload(
    robot: Robot,
    q: ArrayLike,
    com: ArrayLike = (0.0, 0.0, 0.0),
    *,
    frame: str | None = None,
    limits: ArrayLike | None = None,
) -> LargestPayload:
    """Largest payload: the largest mass held at rest within the torque limits.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    com : (3,) array_like, centre of mass of the payload in the frame [m]
    frame : str, optional, a link of the robot; its tip if None
    limits : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]

    Returns
    -------
    found : LargestPayload, ``mass`` () [kg]

    Raises
    ------
    ValueRangeError
        There are no effort limits, or the base floats.
    ShapeError, FrameError, UnknownNameError
        As the robot's methods.

    Notes
    -----
    Any batch of q and com broadcasts. Joint friction, which helps to hold, is left out, and a torque per kilogram below 1e-6
    of the robot's reach times gravity is zero.

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = largest_payload(tw.robots.planar_2r(), [0.0, 0.0], limits=[50.0, 20.0])
    >>> print(found)
    1.039 kg, then joint2 is at +20
    """
    require_fixed_base(robot, "the largest payload")
    L = effort_limits(robot, limits)
    unloaded = resting_torques(robot, q)
    per_kilogram = torques_per_kilogram(robot, q, com, frame)
    per_kilogram = np.where(np.abs(per_kilogram) < least_torque_per_kilogram(robot.model), 0.0, per_kilogram)
    unloaded, per_kilogram = np.broadcast_arrays(unloaded, per_kilogram)
    names = robot.model.velocity_names
    if robot.model.limited_followers:
        alone, added, theirs, followers = _followers(robot, q, com, frame)
        unloaded, per_kilogram = np.concatenate([unloaded, alone], -1), np.concatenate([per_kilogram, added], -1)
        L, names = np.concatenate([L, theirs]), (*names, *followers)
    s = growth(unloaded, per_kilogram, L)
    holds = np.all(np.abs(unloaded) <= L + margin(L), axis=-1)
    unknown = np.isnan(unloaded + per_kilogram).any(axis=-1)
    mass = np.where(unknown, np.nan, np.where(holds, np.maximum(s.most, 0.0), 0.0))
    return LargestPayload(
        mass,
        np.where(holds, s.joint, -1),
        np.where(holds, s.side, 0),
        holds,
        unloaded,
        per_kilogram,
        s.per_joint,
        L,
        names,
    )


@dataclass(frozen=True, eq=False)
class RegionPayload:
    """Largest payload when its centre of mass is only known, or may be chosen, within a convex region."""

    sure: float
    """kg held wherever in the region the centre of mass is."""
    worst_com: Array
    """(3,) m: the corner of the region that allows no more."""
    best: float
    """kg held with the centre of mass where it suits the robot most."""
    best_com: Array
    """(3,) m: that place."""


def payload_in_region(
    robot: Robot, q: ArrayLike, region: ArrayLike, *, frame: str | None = None, limits: ArrayLike | None = None
) -> RegionPayload:
    """Largest payload with its centre of mass in the convex hull of a region, at one pose.

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    region : (k, 3) array_like, corners in the frame [m]
    frame : str, optional, a link of the robot; its tip if None
    limits : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]

    Returns
    -------
    found : RegionPayload

    Raises
    ------
    ValueRangeError, ShapeError, FrameError, UnknownNameError
        As :func:`largest_payload`.

    Notes
    -----
    What is held surely is the least of the corners, since torques are affine in the centre of mass. The best place is a
    linear programme: maximise Σ λ over λ ≥ 0 with abs(g + Σ λ_k w(c_k)) ≤ limits, where m = Σ λ and m c = Σ λ_k c_k.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> found = payload_in_region(arm, [0.0, 0.0], [[0.0, 0, 0], [0.5, 0, 0]], limits=[50.0, 20.0])
    >>> round(found.sure, 4), round(found.best, 4), found.best_com.tolist()
    (0.6925, 1.0387, [0.0, 0.0, 0.0])
    """
    corners = np.atleast_2d(points(region))
    if corners.ndim != 2 or not len(corners):
        raise ShapeError(f"region has shape {np.shape(region)}, expected (k, 3): the corners of a convex region [m].")
    q = one_configuration(robot, q, "payload_in_region", "the best place is a linear programme of each pose")
    at_corners = largest_payload(robot, q, corners, frame=frame, limits=limits)
    worst = int(np.argmin(at_corners.mass))
    if not at_corners.holds.all():
        return RegionPayload(0.0, corners[worst], 0.0, corners[worst])
    weights = _best_mixture(at_corners.unloaded[0], at_corners.per_kilogram, at_corners.limits)
    best = float(weights.sum())
    com = weights @ corners / best if 0 < best < np.inf else corners[int(np.argmax(at_corners.mass))]
    return RegionPayload(float(at_corners.mass[worst]), corners[worst], best, com)


def _best_mixture(unloaded: Array, per_kilogram: Array, limits: Array) -> Array:
    """The λ (k,) of the linear programme; inf where it is unbounded."""
    from scipy.optimize import linprog

    bounded = np.isfinite(limits)
    A, L, g = per_kilogram.T[bounded], limits[bounded], unloaded[bounded]
    found = linprog(-np.ones(A.shape[1]), A_ub=np.vstack([A, -A]), b_ub=np.concatenate([L - g, L + g]), method="highs")
    return np.asarray(found.x) if found.status == 0 else np.full(A.shape[1], np.inf)


def points(com: ArrayLike) -> Array:
    """``com`` as finite float64 (..., 3), x, y, z [m] in the frame. Raises ShapeError, ValueRangeError."""
    return np.asarray(arguments.finite(com, "com", 3), float)
