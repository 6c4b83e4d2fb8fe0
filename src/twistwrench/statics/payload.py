"""Payload: largest mass at a pose, in closed form, and over a slice of the workspace."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import margin, number, printed, rounded_down
from ..core.typing import Array
from ..mechanics.joints.units import units_of
from ..mechanics.model.couplings import drive_turns, motor_torques
from ..mechanics.model.joint_loads import follower_torques
from ..motion.load_case import least_torque_per_kilogram
from ..robot.base import require_robot
from .arguments import one_configuration, same_batch
from .torque_limits import effort_limits, growth, require_fixed_base, resting_torques, span

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True, eq=False)
class LargestPayload:
    """Largest payload: largest mass held at rest, and the joint at its limit.

    Leading axes are those of the poses. Mimic joints with an effort limit are added after the joints of dq if they bear
    the payload or exceed their limit without it. Coupled motors replace their joints.
    """

    mass: Array
    """(...) kg: 0 if the robot cannot hold itself, inf if the mass does not load any joint, nan if q is nan."""
    joint: Array
    """(...) of int: index of the limiting joint in ``joint_names``; -1 if none."""
    side: Array
    """(...): +1 if that joint is at its upper limit, -1 at its lower; 0 if none."""
    holds: Array
    """(...) of bool: True if the robot holds itself without a payload."""
    unloaded: Array
    """(..., nv): g(q), holding torques without payload [N m or N]."""
    per_kilogram: Array
    """(..., nv): additional torques per kilogram."""
    per_joint: Array
    """(..., nv) kg: largest mass by each joint's limit alone."""
    limits: Array
    """(nv,): the limits used."""
    joint_names: tuple[str, ...]
    """Names of the joints, indexed by ``joint``."""
    units: tuple[str, ...]
    """Units of their torques."""

    @property
    def torques(self) -> Array:
        """Holding torques with the largest payload (..., nv) [N m or N]; without payload if it is not finite."""
        mass = np.where(np.isfinite(self.mass), self.mass, 0.0)
        return self.unloaded + mass[..., None] * self.per_kilogram

    @property
    def share(self) -> Array:
        """Holding torques as shares of the limits (..., nv), 1 for the limiting joint."""
        idle = np.where(self.torques == 0, 0.0, np.inf)  # a joint with a limit of zero
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
        limit = printed(self.side * self.limits[k], 4, signed=True)
        return f"{rounded_down(self.mass)} kg, limited by {self.joint_names[k]} at {limit} {self.units[k]}"


def torques_per_kilogram(
    robot: Robot, q: ArrayLike, com: ArrayLike = (0.0, 0.0, 0.0), frame: str | None = None
) -> Array:
    """Holding torques of one kilogram at a point of a frame, without the robot's own weight.

    τ = J_b' F with F = (c × f, f), where f = -R' g carries one kilogram, in the frame: MR eq. 5.26. Any batch of q and
    com broadcasts.

    Returns
    -------
    tau : (nv,) array [N m/kg, sliding joints: N/kg]

    Examples
    --------
    >>> import twistwrench as tw
    >>> torques_per_kilogram(tw.robots.planar_2r(), [0.0, 0.0]).round(2).tolist()
    [19.62, 9.81]
    """
    require_robot(robot, "torques_per_kilogram")
    return robot.wrench_torques(q, _wrench_per_kilogram(robot, q, com, frame), frame)


def _wrench_per_kilogram(robot: Robot, q: ArrayLike, com: ArrayLike, frame: str | None) -> Array:
    """Wrench (..., 6) that carries one kilogram at a point of a frame, in that frame."""
    c = points(com)
    R = np.asarray(robot.forward_kinematics(q, frame))[..., :3, :3]
    same_batch(q=R[..., 0], com=c)
    f = -np.einsum("...ji,j->...i", R, robot.gravity)
    return np.concatenate([np.cross(c, f), np.broadcast_to(f, np.broadcast_shapes(c.shape, f.shape))], axis=-1)


def _followers(
    robot: Robot, q: ArrayLike, com: ArrayLike, frame: str | None
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Torques of mimic joints with an effort limit, without payload and per kilogram (..., k), their limits (k,) and names.

    Includes joints that the payload loads or that exceed their limits without it.
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
    """Largest payload: largest mass held at rest within the torque limits.

    Any batch of q and com broadcasts. Joint friction, which helps to hold, is neglected. A torque per kilogram below
    1e-6 of the robot's reach times gravity counts as zero.

    Returns
    -------
    found : LargestPayload, ``mass`` () [kg]

    Raises
    ------
    ValueRangeError
        There are no effort limits, or the base floats.

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = largest_payload(tw.robots.planar_2r(), [0.0, 0.0], limits=[50.0, 20.0])
    >>> print(found)
    1.038 kg, limited by joint2 at +20 N m
    """
    require_fixed_base(robot, "the largest payload")
    L = effort_limits(robot, limits)
    unloaded = motor_torques(robot.model, resting_torques(robot, q))
    per_kilogram = motor_torques(robot.model, torques_per_kilogram(robot, q, com, frame))
    per_kilogram = np.where(np.abs(per_kilogram) < least_torque_per_kilogram(robot.model), 0.0, per_kilogram)
    unloaded, per_kilogram = np.broadcast_arrays(unloaded, per_kilogram)
    names, turning = robot.model.drive_labels, drive_turns(robot.model)
    if robot.model.limited_followers:
        alone, added, theirs, followers = _followers(robot, q, com, frame)
        unloaded, per_kilogram = np.concatenate([unloaded, alone], -1), np.concatenate([per_kilogram, added], -1)
        L, names = np.concatenate([L, theirs]), (*names, *followers)
        turning += [bool(robot.model.bodies[i].joint.turning[0]) for i in robot.model.limited_followers]
    s = growth(unloaded, per_kilogram, L)
    holds = np.all(np.abs(unloaded) <= L + margin(L), axis=-1)
    unknown = np.isnan(unloaded + per_kilogram).any(axis=-1)
    mass = np.where(unknown, np.nan, np.where(holds, np.maximum(s.most, 0.0), 0.0))
    joint, side = np.where(holds, s.joint, -1), np.where(holds, s.side, 0)
    return LargestPayload(
        mass, joint, side, holds, unloaded, per_kilogram, s.per_joint, L, names, units_of("tau", turning)
    )


@dataclass(frozen=True, eq=False)
class RegionPayload:
    """Largest payload with its centre of mass anywhere in a convex region, unknown or free to choose."""

    sure: float
    """Mass [kg] held for every centre of mass in the region."""
    worst_com: Array
    """(3,) m: corner of the region with the smallest payload."""
    best: float
    """Mass [kg] held with the most favourable centre of mass."""
    best_com: Array
    """(3,) m: most favourable centre of mass."""


def payload_in_region(
    robot: Robot, q: ArrayLike, region: ArrayLike, *, frame: str | None = None, limits: ArrayLike | None = None
) -> RegionPayload:
    """Largest payload with its centre of mass in the convex hull of a region, at one pose.

    The guaranteed payload is the minimum over the corners, since torques are affine in the centre of mass. The best
    centre of mass solves a linear programme: maximise Σ λ over λ ≥ 0 with abs(g + Σ λ_k w(c_k)) ≤ limits, m = Σ λ and m
    c = Σ λ_k c_k.

    Parameters
    ----------
    region : (k, 3) array_like, corners in the frame [m]

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
    com = corners[int(np.argmax(at_corners.mass))]
    if 0 < best < np.inf:
        com = weights @ corners / best
    return RegionPayload(float(at_corners.mass[worst]), corners[worst], best, com)


def _best_mixture(unloaded: Array, per_kilogram: Array, limits: Array) -> Array:
    """Solution λ (k,) of the linear programme; inf if unbounded."""
    from scipy.optimize import linprog

    bounded = np.isfinite(limits)
    A, L, g = per_kilogram.T[bounded], limits[bounded], unloaded[bounded]
    b = np.concatenate([L - g, L + g])
    optimum = linprog(-np.ones(A.shape[1]), A_ub=np.vstack([A, -A]), b_ub=b, method="highs")
    if optimum.status != 0:
        return np.full(A.shape[1], np.inf)
    return np.asarray(optimum.x)


def points(com: ArrayLike) -> Array:
    """Check ``com``: finite float64 (..., 3), x, y, z [m] in the frame. Raises ShapeError, ValueRangeError."""
    return np.asarray(arguments.finite(com, "com", 3), float)


# ── Payload over a slice of the workspace, from sampled configurations

SLICES = {"xz": (0, 2, 1), "yz": (1, 2, 0), "xy": (0, 1, 2)}
"""In-plane axes of each slice and the axis across it; "rz" is radius and height, for any direction around z."""
_CHUNK = 1 << 15
_CELLS, _PER_CELL = (8, 60), 40
"""Cells along the longer side, and configurations per cell of a square; typical slices fill half their cells."""


@dataclass(frozen=True, eq=False)
class PayloadMap:
    """Payload map: largest payloads of sampled configurations, by the cell of a workspace slice that contains the tip.

    Sampling gives bounds: the true maximum of a cell is at least ``best``, the true minimum at most ``worst``. Inverse
    kinematics is not used, so an empty cell may still be reachable by configurations that were not drawn.
    """

    plane: str
    """"xz", "yz", "xy" or "rz"."""
    across: float
    """Position of the slice on the perpendicular axis [m]; 0 for "rz"."""
    thickness: float
    """Thickness of the slice [m]; inf for "rz"."""
    edges: tuple[Array, Array]
    """Cell borders along both axes, (nx + 1,) and (ny + 1,) m."""
    best: Array
    """(ny, nx) kg: maximum of the largest payloads in the cell; nan if it is empty."""
    worst: Array
    """(ny, nx) kg: minimum of the largest payloads in the cell."""
    count: Array
    """(ny, nx): number of configurations in the cell."""

    @property
    def samples(self) -> int:
        """Number of configurations in the slice."""
        return int(self.count.sum())

    def __str__(self) -> str:
        filled = int((self.count > 0).sum())
        return (
            f"{self.plane} slice: {self.samples} configurations in {filled} cells of "
            f"{number(1e3 * float(np.diff(self.edges[0])[0]), 3)} mm, best {number(np.nanmax(self.best))} kg, "
            f"worst {number(np.nanmin(self.worst))} kg"
        )


def payload_map(
    robot: Robot,
    plane: str = "rz",
    *,
    at: float = 0.0,
    thickness: float = 0.1,
    cells: int | None = None,
    samples: int = 200_000,
    com: ArrayLike = (0.0, 0.0, 0.0),
    frame: str | None = None,
    limits: ArrayLike | None = None,
    rng: np.random.Generator | int | None = 0,
) -> PayloadMap:
    """Payload map: the best and worst :func:`largest_payload` in each cell of a slice of the workspace.

    Parameters
    ----------
    plane : "xz", "yz" or "xy" of the base frame, or "rz"
        A slab of ``thickness`` about ``at`` on the axis across it; "rz", the distance from the base's z axis and the
        height, wastes no sample.
    at : float, position of the slab [m]
    thickness : float, of the slab [m]
    cells : int, optional, number along the longer side
        None: 8 to 60, depending on the number of samples in the slice, so that every cell has enough of them.
    samples : int, random configurations within the limits

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = payload_map(tw.robots.planar_2r(), "xz", cells=8, samples=4000, limits=[50.0, 20.0])
    >>> found.best.shape, bool(np.nanmax(found.best) > np.nanmin(found.worst))
    ((8, 8), True)
    """
    plane, samples = plane_and_samples(plane, samples)
    if cells is not None:
        cells = arguments.whole(cells, "cells", 1)
    thickness = arguments.positive(thickness, "thickness [m]")
    at = arguments.number(at, "at [m]")
    if not np.isfinite(at):
        raise ValueRangeError(f"at is {printed(at)}. Give where the slice lies on the axis across it [m].")
    require_fixed_base(robot, "a payload map")
    rng = arguments.generator(rng)
    parts = []
    for begin in range(0, samples, _CHUNK):
        q = robot.random_configuration(rng, min(_CHUNK, samples - begin))
        p = np.asarray(robot.forward_kinematics(q, frame))[:, :3, 3]
        if plane == "rz":
            position = np.column_stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]])
        else:
            first, second, third = SLICES[plane]
            inside = np.abs(p[:, third] - at) <= 0.5 * thickness
            q, position = q[inside], p[inside][:, [first, second]]
        if len(q):
            parts.append(np.column_stack([position, largest_payload(robot, q, com, frame=frame, limits=limits).mass]))
    if not parts:
        raise ValueRangeError(
            f"none of {samples} configurations has its tip in the {plane} slice {printed(thickness)} m thick at "
            f"{printed(at)} m. Move the slice, make it thicker, or draw more samples."
        )
    rows = np.concatenate(parts)
    if cells is None:
        cells = int(np.clip(np.sqrt(len(rows) / _PER_CELL), *_CELLS))
    slab = (0.0, np.inf) if plane == "rz" else (at, thickness)
    edges, best, worst, count = _sort_into_cells(rows, cells)
    return PayloadMap(plane, *slab, edges, best, worst, count)


def plane_and_samples(plane: str, samples: int) -> tuple[str, int]:
    """Check the plane and the number of samples. Raises UnknownNameError, ValueRangeError."""
    if not isinstance(plane, str) or plane not in (*SLICES, "rz"):
        raise UnknownNameError.from_choices("slice", plane, (*SLICES, "rz"))
    return plane, arguments.whole(samples, "samples", 1)


def _sort_into_cells(rows: Array, cells: int) -> tuple[tuple[Array, Array], Array, Array, Array]:
    """Sort rows (x, y, mass) into square cells: borders, maximum, minimum and count."""
    low, high = rows[:, :2].min(axis=0), rows[:, :2].max(axis=0)
    size = max(float((high - low).max()), 1e-9) / cells
    nx, ny = (np.maximum(np.ceil((high - low) / size - 1e-9), 1)).astype(int)
    column = np.clip(((rows[:, 0] - low[0]) / size).astype(int), 0, nx - 1)
    row = np.clip(((rows[:, 1] - low[1]) / size).astype(int), 0, ny - 1)
    best, worst = np.full((ny, nx), -np.inf), np.full((ny, nx), np.inf)
    np.maximum.at(best, (row, column), rows[:, 2])
    np.minimum.at(worst, (row, column), rows[:, 2])
    count = np.zeros((ny, nx), int)
    np.add.at(count, (row, column), 1)
    best[count == 0] = worst[count == 0] = np.nan
    edges = (low[0] + size * np.arange(nx + 1), low[1] + size * np.arange(ny + 1))
    return edges, best, worst, count


complete(globals())
