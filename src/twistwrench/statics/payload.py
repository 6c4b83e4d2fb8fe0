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

    Leading axes are those of the poses. Entries of the joints are in the order of dq, with coupled motors in place of
    their joints. Mimic joints with an effort limit come last, if they bear the payload or exceed their limit without it.
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
    """(..., nv): additional torques for each kilogram of payload [N m/kg or N/kg]."""
    per_joint: Array
    """(..., nv) kg: largest payload mass by the limit of each joint alone."""
    limits: Array
    """(nv,): torque limits [N m or N]."""
    joint_names: tuple[str, ...]
    """Names of the joints, indexed by ``joint``."""
    units: tuple[str, ...]
    """Units of the torques of the joints."""

    @property
    def torques(self) -> Array:
        """Holding torques with the largest payload (..., nv) [N m or N]; without payload if it is not finite."""
        mass = np.where(np.isfinite(self.mass), self.mass, 0.0)
        return self.unloaded + mass[..., None] * self.per_kilogram

    @property
    def share(self) -> Array:
        """Holding torques as shares of the limits (..., nv), 1 for the limiting joint."""
        sizes = np.abs(self.torques)
        shares_of_zero = np.where(sizes == 0, 0.0, np.inf)  # stay for joints with a limit of zero
        return np.divide(sizes, self.limits, out=shares_of_zero, where=self.limits > 0)

    def __str__(self) -> str:
        if self.mass.ndim:
            return f"largest payloads [kg] of {self.mass.size} poses: {span(self.mass)}"
        if np.isnan(self.mass):
            return "unknown: q has an entry that is not a number"
        if not self.holds:
            excess_torques = np.abs(self.unloaded) - self.limits  # N m and N are compared as numbers
            weakest_joint = int(np.argmax(excess_torques))
            needed_torque = number(abs(self.unloaded[weakest_joint]))
            limit = number(self.limits[weakest_joint])
            return f"no payload: {self.joint_names[weakest_joint]} needs {needed_torque} of {limit} to hold the robot alone"
        if self.joint < 0:
            return "not limited at this pose: no joint with a limit carries the payload"
        limiting_joint = int(self.joint)
        limit = printed(self.side * self.limits[limiting_joint], 4, signed=True)
        name, unit = self.joint_names[limiting_joint], self.units[limiting_joint]
        return f"{rounded_down(self.mass)} kg, limited by {name} at {limit} {unit}"


def torques_per_kilogram(
    robot: Robot, q: ArrayLike, com: ArrayLike = (0.0, 0.0, 0.0), frame: str | None = None
) -> Array:
    """Holding torques of one kilogram at a point of a frame, without the robot's own weight.

    In the frame, the force f = -R' g carries one kilogram, and τ = J_b' F with F = (c × f, f): MR eq. 5.26. Any batch of
    q and com broadcasts.

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
    F = _wrench_per_kilogram(robot, q, com, frame)
    return robot.wrench_torques(q, F, frame)


def _wrench_per_kilogram(robot: Robot, q: ArrayLike, com: ArrayLike, frame: str | None) -> Array:
    """Wrench (..., 6) that carries one kilogram at a point of a frame, in that frame."""
    c = points(com)
    T = np.asarray(robot.forward_kinematics(q, frame))
    R = T[..., :3, :3]
    same_batch(q=R[..., 0], com=c)  # the axes of q's batch, with a last axis as com has
    f = -np.einsum("...ji,j->...i", R, robot.gravity)
    m = np.cross(c, f)
    return np.concatenate([m, np.broadcast_to(f, m.shape)], axis=-1)


@dataclass(frozen=True, eq=False)
class _FollowerTorques:
    """Holding torques of k mimic joints with an effort limit."""

    unloaded: Array
    """(..., k): torques without payload [N m or N]."""
    per_kilogram: Array
    """(..., k): additional torques for each kilogram of payload [N m/kg or N/kg]."""
    limits: Array
    """(k,): torque limits [N m or N]."""
    names: tuple[str, ...]
    turns: tuple[bool, ...]
    """(k,): True for joints that turn."""


def _follower_torques(robot: Robot, q: ArrayLike, com: ArrayLike, frame: str | None) -> _FollowerTorques:
    """Torques of the mimic joints that the payload loads, or that exceed their limits without it."""
    model = robot.model
    zeros = np.zeros(robot.nv)
    loaded_frame = str(robot.tip if frame is None else frame)
    F = _wrench_per_kilogram(robot, q, com, frame)
    unloaded_wrenches = np.asarray(robot.joint_wrenches(q, zeros, zeros))
    loaded_wrenches = robot.joint_wrenches(q, zeros, zeros, wrench_by_robot={loaded_frame: F})
    unloaded_wrenches, loaded_wrenches = np.broadcast_arrays(unloaded_wrenches, loaded_wrenches)
    unloaded = follower_torques(model, unloaded_wrenches)
    payload_torques = follower_torques(model, loaded_wrenches - unloaded_wrenches)
    per_kilogram = _remove_rounding_errors(robot, payload_torques)
    bodies = [model.bodies[i] for i in model.limited_followers]
    limits = np.array([body.effort for body in bodies])
    bears_payload = per_kilogram != 0
    exceeds_limit = np.abs(unloaded) > limits + margin(limits)
    matters = (bears_payload | exceeds_limit).reshape(-1, len(bodies))  # (poses, mimic joints)
    indices = np.flatnonzero(matters.any(axis=0))
    names = tuple(bodies[k].joint.name for k in indices)
    turns = tuple(bool(bodies[k].joint.turning[0]) for k in indices)  # followers have one coordinate
    return _FollowerTorques(unloaded[..., indices], per_kilogram[..., indices], limits[indices], names, turns)


def _remove_rounding_errors(robot: Robot, per_kilogram: Array) -> Array:
    """Torques per kilogram, with zero for those that are rounding errors."""
    smallest_torque = least_torque_per_kilogram(robot.model)
    return np.where(np.abs(per_kilogram) < smallest_torque, 0.0, per_kilogram)


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
    joint_per_kilogram = torques_per_kilogram(robot, q, com, frame)
    drive_per_kilogram = motor_torques(robot.model, joint_per_kilogram)
    per_kilogram = _remove_rounding_errors(robot, drive_per_kilogram)
    unloaded, per_kilogram = np.broadcast_arrays(unloaded, per_kilogram)
    joint_names = robot.model.drive_labels
    turns = drive_turns(robot.model)  # a flag for each entry
    if robot.model.limited_followers:
        followers = _follower_torques(robot, q, com, frame)
        unloaded = np.concatenate([unloaded, followers.unloaded], -1)
        per_kilogram = np.concatenate([per_kilogram, followers.per_kilogram], -1)
        L = np.concatenate([L, followers.limits])
        joint_names = (*joint_names, *followers.names)
        turns.extend(followers.turns)
    mass_range = growth(unloaded, per_kilogram, L)
    holds = np.all(np.abs(unloaded) <= L + margin(L), axis=-1)
    largest_mass = np.maximum(mass_range.most, 0.0)
    held_mass = np.where(holds, largest_mass, 0.0)
    is_unknown = np.isnan(unloaded + per_kilogram).any(axis=-1)  # nan if one of the two is nan
    return LargestPayload(
        mass=np.where(is_unknown, np.nan, held_mass),
        joint=np.where(holds, mass_range.joint, -1),
        side=np.where(holds, mass_range.side, 0),
        holds=holds,
        unloaded=unloaded,
        per_kilogram=per_kilogram,
        per_joint=mass_range.per_joint,
        limits=L,
        joint_names=joint_names,
        units=units_of("tau", turns),
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

    The guaranteed payload is the minimum over the corners c_k, since torques are affine in the centre of mass. The best
    payload m and centre of mass c solve a linear programme: maximise Σ λ_k over λ ≥ 0 with abs(g + Σ λ_k w(c_k)) ≤ limits,
    where w are torques per kilogram. Then m = Σ λ_k and m c = Σ λ_k c_k.

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
    corner_payloads = largest_payload(robot, q, corners, frame=frame, limits=limits)
    worst_corner = int(np.argmin(corner_payloads.mass))
    worst_com = corners[worst_corner]
    if not corner_payloads.holds.all():  # the robot does not hold itself: no centre of mass is better
        return RegionPayload(sure=0.0, worst_com=worst_com, best=0.0, best_com=worst_com)
    unloaded = corner_payloads.unloaded[0]  # equal for all corners
    corner_masses = _best_masses(unloaded, corner_payloads.per_kilogram, corner_payloads.limits)
    best_mass = float(corner_masses.sum())
    if 0 < best_mass < np.inf:
        best_com = corner_masses @ corners / best_mass  # m c = Σ λ_k c_k
    else:
        best_corner = int(np.argmax(corner_payloads.mass))
        best_com = corners[best_corner]
    return RegionPayload(float(corner_payloads.mass[worst_corner]), worst_com, best_mass, best_com)


def _best_masses(unloaded: Array, per_kilogram: Array, limits: Array) -> Array:
    """Masses λ (k,) at the corners that solve the linear programme; inf if unbounded."""
    from scipy.optimize import linprog

    has_limit = np.isfinite(limits)
    A = per_kilogram.T[has_limit]
    L = limits[has_limit]
    g = unloaded[has_limit]
    b = np.concatenate([L - g, L + g])  # A λ ≤ L - g and -A λ ≤ L + g
    corner_count = A.shape[1]
    optimum = linprog(-np.ones(corner_count), A_ub=np.vstack([A, -A]), b_ub=b, method="highs")
    if optimum.status != 0:
        return np.full(corner_count, np.inf)
    return np.asarray(optimum.x)


def points(com: ArrayLike) -> Array:
    """Check ``com``: finite float64 (..., 3), x, y, z [m] in the frame. Raises ShapeError, ValueRangeError."""
    return np.asarray(arguments.finite(com, "com", 3), float)


# ── Payload over a slice of the workspace, from sampled configurations

SLICES = {"xz": (0, 2, 1), "yz": (1, 2, 0), "xy": (0, 1, 2)}
"""In-plane axes of each slice and the axis across it; "rz" is radius and height, for any direction around z."""
_CHUNK_CONFIGURATIONS = 32768
"""Number of configurations computed together."""
_MIN_CELLS = 8
"""Smallest number of cells along the longer side of a slice, unless given."""
_MAX_CELLS = 60
"""Largest number of cells along the longer side of a slice, unless given."""
_MIN_EXTENT = 1e-9
"""Extent of a slice [m] if all configurations have their tip at one point."""
_CELL_ROUND_OFF = 1e-9
"""Part of a cell by which the extent of a slice may exceed whole cells."""
_SAMPLES_PER_CELL = 40
"""Configurations per cell of a square; typical slices fill half their cells."""


@dataclass(frozen=True, eq=False)
class PayloadMap:
    """Payload map: largest payloads of sampled configurations, by the cell of a workspace slice that contains the tip.

    Sampling gives bounds: the true maximum of a cell is at least ``best``, the true minimum at most ``worst``. Inverse
    kinematics is not used, so an empty cell may still be reachable by configurations that were not drawn.
    """

    plane: str
    """Name of the slice: "xz", "yz", "xy" or "rz"."""
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
        first_edge, second_edge, *_ = self.edges[0].tolist()
        cell_size = second_edge - first_edge  # [m], of every cell along both axes
        best_mass = number(np.nanmax(self.best))
        worst_mass = number(np.nanmin(self.worst))
        return (
            f"{self.plane} slice: {self.samples} configurations in {filled} cells of "
            f"{number(1e3 * cell_size, 3)} mm, best {best_mass} kg, worst {worst_mass} kg"
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
        A plane is a slab of ``thickness`` around ``at`` on the axis across it. "rz" is the distance from the base's z axis
        and the height; it uses every sample.
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
    chunks: list[Array] = []  # rows (x, y, mass): tip in the plane [m] and largest payload [kg]
    for begin in range(0, samples, _CHUNK_CONFIGURATIONS):
        chunk_size = min(_CHUNK_CONFIGURATIONS, samples - begin)
        q = robot.random_configuration(rng, chunk_size)
        T = np.asarray(robot.forward_kinematics(q, frame))
        p = T[:, :3, 3]
        if plane == "rz":
            radius = np.hypot(p[:, 0], p[:, 1])
            plane_positions = np.column_stack([radius, p[:, 2]])
        else:
            x_axis, y_axis, normal_axis = SLICES[plane]
            is_inside = np.abs(p[:, normal_axis] - at) <= 0.5 * thickness
            q = q[is_inside]
            plane_positions = p[is_inside][:, [x_axis, y_axis]]
        if len(q):
            masses = largest_payload(robot, q, com, frame=frame, limits=limits).mass
            chunks.append(np.column_stack([plane_positions, masses]))
    if not chunks:
        raise ValueRangeError(
            f"none of {samples} configurations has its tip in the {plane} slice {printed(thickness)} m thick at "
            f"{printed(at)} m. Move the slice, make it thicker, or draw more samples."
        )
    tip_masses = np.concatenate(chunks)
    if cells is None:
        total_cells = len(tip_masses) / _SAMPLES_PER_CELL
        cells = int(np.clip(np.sqrt(total_cells), _MIN_CELLS, _MAX_CELLS))
    if plane == "rz":  # has no slab
        at, thickness = 0.0, np.inf
    edges, best, worst, count = _sort_into_cells(tip_masses, cells)
    return PayloadMap(plane, at, thickness, edges, best, worst, count)


def plane_and_samples(plane: str, samples: int) -> tuple[str, int]:
    """Check the plane and the number of samples. Raises UnknownNameError, ValueRangeError."""
    if not isinstance(plane, str) or plane not in (*SLICES, "rz"):
        raise UnknownNameError.from_choices("slice", plane, (*SLICES, "rz"))
    return plane, arguments.whole(samples, "samples", 1)


def _sort_into_cells(tip_masses: Array, cells: int) -> tuple[tuple[Array, Array], Array, Array, Array]:
    """Borders of square cells, and for each cell the maximum, minimum and number of its masses.

    The rows of ``tip_masses`` are (x, y, mass); ``cells`` is the number along the longer side.
    """
    x, y, mass = tip_masses.T
    low = tip_masses[:, :2].min(axis=0)
    high = tip_masses[:, :2].max(axis=0)
    extent = high - low
    size = max(float(extent.max()), _MIN_EXTENT) / cells
    cell_counts = np.ceil(extent / size - _CELL_ROUND_OFF).astype(int)
    nx, ny = np.maximum(cell_counts, 1)
    column = np.clip(((x - low[0]) / size).astype(int), 0, nx - 1)
    row = np.clip(((y - low[1]) / size).astype(int), 0, ny - 1)
    best = np.full((ny, nx), -np.inf)
    worst = np.full((ny, nx), np.inf)
    np.maximum.at(best, (row, column), mass)
    np.minimum.at(worst, (row, column), mass)
    count = np.zeros((ny, nx), int)
    np.add.at(count, (row, column), 1)
    is_empty = count == 0
    best[is_empty] = np.nan
    worst[is_empty] = np.nan
    edges = (low[0] + size * np.arange(nx + 1), low[1] + size * np.arange(ny + 1))
    return edges, best, worst, count


complete(globals())
