"""Force capability at a pose: wrench ellipsoid, wrench polytope, strongest and weakest directions. MR section 5.4."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, vector
from ..core.text import argument
from ..core.typing import Array
from ..mechanics.model.couplings import motor_torques
from ..robot.base import require_robot
from .arguments import one_configuration, same_batch, unit_vectors
from .torque_limits import effort_limits, growth, require_fixed_base, resting_torques, span
from .torque_wrench import RANK_TOLERANCE

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.arguments import Kind

PARTS = {"moment": slice(0, 3), "force": slice(3, 6), "wrench": slice(0, 6)}
"""Rows of a wrench for each part."""
_MIN_LEVER = 1e-12
"""Length of a column of J, as a share of the longest, below which no wrench loads the joint."""
_CORNER_TOLERANCE = 1e-9
"""Distance below which corners are one, as a share of the size of the polytope."""
_FACET_TOLERANCE = 1e-7
"""Relative distance of a corner from a half-space's boundary up to which the corner lies on it."""
_MIN_LINE = 1e-7
"""Length of a projected unit vector above which it is a direction of a line."""
_MAX_RADIUS = 1e3
"""Bound of a ball's radius in a polytope, which may be unbounded, relative to the limits."""


@dataclass(frozen=True, eq=False, repr=False)
class WrenchEllipsoid:
    """Force ellipsoid: all x (n,) with x' A x ≤ 1, centred at zero, without gravity.

    Leading axes of the arrays are those of the poses.
    """

    matrix: Array
    """(..., n, n): A = J W⁻² J', where J has the rows of ``part`` and W the scale of each torque."""
    axes: Array
    """(..., n, n): directions of the semi-axes as columns, strongest first."""
    semi_axes: Array
    """(..., n): lengths of the semi-axes, descending; inf along directions that the structure bears."""
    part: str
    """"force", "moment" or "wrench"."""
    kind: Kind
    """Axes and reference point, as in :meth:`Robot.jacobian`."""

    def __repr__(self) -> str:
        title = f"WrenchEllipsoid of {self.part}s, {self.kind}"
        if self.semi_axes.ndim > 1:
            return f"{title}, of poses {self.semi_axes.shape[:-1]}"
        parts = []
        for length, axis in zip(self.semi_axes, self.axes.T, strict=True):
            if not np.isinf(length):
                largest_entry = axis[np.argmax(np.abs(axis))]
                direction = np.round(axis * np.sign(largest_entry), 4)
                parts.append(f"{number(length)} along {vector(direction)}")
        unbounded_count = int(np.isinf(self.semi_axes).sum())
        if unbounded_count:
            noun = "directions" if unbounded_count > 1 else "direction"
            parts.append(f"unbounded in {unbounded_count} {noun}")
        return f"{title}: {', '.join(parts)}"

    @property
    def condition(self) -> Array:
        """Condition number (...): ratio of the longest to the shortest semi-axis; inf at singular poses."""
        return self.semi_axes[..., 0] / self.semi_axes[..., -1]

    def reach(self, direction: ArrayLike) -> Array:
        """Extent of the ellipsoid along a direction.

        Parameters
        ----------
        direction : (..., n) array_like, scaled to unit length

        Returns
        -------
        reach : (...) array [N or N m for each unit of torque]

        Examples
        --------
        >>> import twistwrench as tw
        >>> float(wrench_ellipsoid(tw.robots.planar_2r(), [0.0, np.pi / 2]).reach([0, 1, 0]))
        inf
        """
        d = unit_vectors(direction, self.matrix.shape[-1])
        same_batch(poses=self.semi_axes, direction=d)
        squared_torque = np.einsum("...i,...ij,...j->...", d, self.matrix, d)  # of a unit wrench: d' A d
        needs_no_torque = squared_torque <= RANK_TOLERANCE**2 * np.trace(self.matrix, axis1=-2, axis2=-1)
        torque = np.sqrt(np.where(needs_no_torque, 1.0, squared_torque))
        return np.where(needs_no_torque, np.inf, 1.0 / torque)


def wrench_ellipsoid(
    robot: Robot,
    q: ArrayLike,
    frame: str | None = None,
    *,
    part: str = "force",
    kind: Kind = "world_aligned",
    limits: ArrayLike | None = None,
) -> WrenchEllipsoid:
    """Force ellipsoid: wrenches with torques of norm at most 1, without gravity (MR section 5.4).

    With ``limits`` the ellipsoid lies inside the polytope of :func:`~twistwrench.statics.wrench_polytope` without
    gravity.

    Parameters
    ----------
    part : "force", "moment" or "wrench"
        "force", at zero moment, the book's force ellipsoid f' J_v J_v' f = 1; "moment", at zero force; or "wrench", all
        six numbers (m, f), whose axes depend on the unit of length.
    limits : (nv,) array_like, optional, each torque is then a share of its limit [N m, sliding joints: N]

    Returns
    -------
    ellipsoid : WrenchEllipsoid, with n semi-axes, for any batch of q; rows with NaN have NaN

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> wrench_ellipsoid(arm, [0.0, np.pi / 2]).semi_axes.round(6).tolist()  # the golden ratio, and one over it
    [inf, 1.618034, 0.618034]
    >>> wrench_ellipsoid(arm, [0.0, np.pi / 2], part="moment")
    WrenchEllipsoid of moments, world_aligned: 0.7071 along (0, 1, 0), unbounded in 2 directions
    """
    all_rows = np.asarray(require_robot(robot, "wrench_ellipsoid").jacobian(q, frame, kind))
    J = all_rows[..., part_rows(part), :]
    if limits is not None:
        J = motor_torques(robot.model, J) * effort_weights(robot, limits)
    A = J @ np.swapaxes(J, -1, -2)
    has_nan = np.isnan(J).any(axis=(-2, -1))
    known_J = np.where(has_nan[..., None, None], 0.0, J)  # the SVD rejects NaN
    U, s, _ = np.linalg.svd(known_J, full_matrices=True)
    U = np.where(has_nan[..., None, None], np.nan, U)
    s = np.where(has_nan[..., None], np.nan, s)
    # The semi-axes are the reciprocal singular values; with fewer joints than n, the missing ones are zero.
    missing_count = J.shape[-2] - s.shape[-1]
    sigma = np.concatenate([s, np.zeros((*s.shape[:-1], missing_count))], axis=-1)
    is_zero = sigma <= RANK_TOLERANCE * np.maximum(sigma.max(axis=-1, keepdims=True), 1e-300)
    semi_axes = np.where(is_zero, np.inf, 1.0 / np.where(is_zero, 1.0, sigma))
    return WrenchEllipsoid(A, U[..., ::-1], semi_axes[..., ::-1], part, kind)


def effort_weights(robot: Robot, limits: ArrayLike | None) -> Array:
    """Reciprocal limits (nv,), zero for joints without a limit; raises ValueRangeError for a limit of zero."""
    L = effort_limits(robot, limits)
    if (L == 0).any():
        raise ValueRangeError(
            "a torque limit of zero leaves the ellipsoid and the polytope no inside. "
            "Give limits above zero, or, in Python, call statics.robot_equilibrium, which takes joints that nothing drives."
        )
    return 1.0 / L


def part_rows(part: str) -> slice:
    """Rows of a wrench for ``part``; raises UnknownNameError for other names."""
    try:
        return PARTS[part]
    except (KeyError, TypeError):
        raise UnknownNameError.from_choices("part of a wrench", part, PARTS) from None


@dataclass(frozen=True, eq=False)
class LargestWrench:
    """Largest wrench along a direction that the robot can apply at rest.

    Leading axes are those of the poses and directions.
    """

    magnitude: Array
    """(...) N (N m for a moment): 0 if the robot cannot hold itself, inf if the structure bears the wrench."""
    wrench: Array
    """(..., 6): the direction, of unit length, as (m, f)."""
    joint: Array
    """(...) of int: index of the limiting joint; -1 if none."""
    side: Array
    """(...): +1 if at its upper limit, -1 at its lower; 0 if none."""
    joint_names: tuple[str, ...]
    """Names of the joints, indexed by ``joint``."""

    def __str__(self) -> str:
        if self.magnitude.ndim:
            return f"largest wrenches: {span(self.magnitude)}"
        if np.isnan(self.magnitude):
            return "unknown: q has an entry that is not a number"
        name = self.joint_names[int(self.joint)] if self.joint >= 0 else "no joint"
        entries = [number(round(x, 12) + 0.0, 3) for x in self.wrench]  # no negative zeros
        return f"{number(self.magnitude)} along ({', '.join(entries)}), limited by {name}"


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

    Closed form: the minimum over the joints of (L - sign(a) g) / abs(a), with a = J' direction and g the torques of
    gravity and springs. MR section 5.2.

    Parameters
    ----------
    direction : (3,) or (6,) array_like, a force at zero moment, or a wrench (m, f); scaled to unit length

    Returns
    -------
    found : LargestWrench, ``magnitude`` () [N, moments: N m]

    Examples
    --------
    >>> import twistwrench as tw
    >>> print(largest_wrench(tw.robots.planar_2r(), [0.0, 0.0], (0, 0, 1), limits=[50.0, 20.0]))
    10.19 along (0, 0, 0, 0, 0, 1), limited by joint2
    """
    require_fixed_base(robot, "the largest wrench")
    d = unit_vectors(direction, 3, 6)
    F = d
    if d.shape[-1] == 3:
        F = np.concatenate([np.zeros_like(d), d], axis=-1)
    g = motor_torques(robot.model, resting_torques(robot, q))
    J = motor_torques(robot.model, robot.jacobian(q, frame, kind))
    same_batch(q=g, direction=F)
    return _largest_along(robot, g, J, F, effort_limits(robot, limits))


def weakest_direction(
    robot: Robot,
    q: ArrayLike,
    *,
    frame: str | None = None,
    part: str = "force",
    kind: Kind = "world_aligned",
    limits: ArrayLike | None = None,
) -> LargestWrench:
    """Weakest direction: the direction in which the robot at rest can apply the smallest force.

    It is the normal of the polytope's nearest facet. That facet belongs to the joint and sign with the least
    (L ∓ g_i) / |J_i|, where J_i is the joint's column of J, and has the normal ±J_i / |J_i|. Takes any batch of q; rows
    with NaN have NaN.

    Parameters
    ----------
    part : "force", "moment" or "wrench", as in :func:`wrench_ellipsoid`

    Examples
    --------
    >>> import twistwrench as tw
    >>> print(weakest_direction(tw.robots.planar_2r(), [0.0, 0.0], limits=[50.0, 20.0]))
    10.19 along (0, 0, 0, 0, 0, 1), limited by joint2
    """
    require_fixed_base(robot, "the weakest direction")
    rows = part_rows(part)
    L = effort_limits(robot, limits)
    g = motor_torques(robot.model, resting_torques(robot, q))
    J = motor_torques(robot.model, robot.jacobian(q, frame, kind))
    lever = np.linalg.norm(J[..., rows, :], axis=-2)  # |J_i|
    takes_part = lever > _MIN_LEVER * np.maximum(1.0, lever.max(axis=-1, initial=0.0, keepdims=True))
    has_nan = np.isnan(g).any(axis=-1) | np.isnan(lever).any(axis=-1)
    has_direction = takes_part.any(axis=-1) | has_nan
    if not has_direction.all():
        raise ValueRangeError(
            f"no joint of {robot.name!r} depends on any {part} there: the structure bears it all. Choose a frame that moves."
        )
    divisor = np.where(takes_part, lever, 1.0)
    distance = np.where(takes_part, (L - np.abs(g)) / divisor, np.inf)  # of the nearer facet of each joint
    joint = np.argmin(distance, axis=-1)[..., None]
    sign = np.where(np.take_along_axis(g, joint, axis=-1) < 0, -1.0, 1.0)
    column = sign * np.take_along_axis(J, joint[..., None, :], axis=-1)[..., 0]
    F = np.zeros_like(column)
    F[..., rows] = column[..., rows]
    F /= np.where(has_nan[..., None], np.nan, np.linalg.norm(F, axis=-1, keepdims=True))
    return _largest_along(robot, g, J, F, L)


def _largest_along(robot: Robot, g: Array, J: Array, F: Array, L: Array) -> LargestWrench:
    """Largest multiples of unit wrenches F (..., 6) that keep limits L (nv,), with resting torques g and Jacobian J."""
    a = np.einsum("...ij,...i->...j", J, F)
    s = growth(g, a, L)
    has_nan = np.isnan(g).any(axis=-1) | np.isnan(a).any(axis=-1)
    holds_itself = np.all(np.abs(g) <= L, axis=-1)
    magnitude = np.where(holds_itself, np.maximum(s.most, 0.0), 0.0)
    return LargestWrench(
        magnitude=np.where(has_nan, np.nan, magnitude),
        wrench=np.broadcast_to(F, (*a.shape[:-1], 6)).copy(),
        joint=np.where(holds_itself, s.joint, -1),
        side=np.where(holds_itself, s.side, 0),
        joint_names=robot.model.drive_labels,
    )


@dataclass(frozen=True, eq=False)
class WrenchPolytope:
    """Wrench polytope: all x (n,) with ``normals`` @ x ≤ ``offsets``.

    It is the sum of a bounded cross-section and the space that the structure bears.

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = wrench_polytope(tw.robots.planar_2r(), [0.0, np.pi / 2], limits=[50.0, 20.0])
    >>> found.contains([[0, 0, 0], [0, 0, 100]]).tolist(), round(float(found.support([0, 0, 1])), 6)
    ([True, False], 50.38)
    """

    normals: Array
    """(h, n): outward, of unit length."""
    offsets: Array
    """(h,): distance of each half-space's boundary from zero, negative if zero is outside."""
    vertices: Array
    """(k, n): corners of the cross-section perpendicular to ``borne``."""
    borne: Array
    """(n, b): orthonormal basis of the unbounded directions; no columns for a bounded polytope."""
    sides: tuple[str, ...]
    """(h,): joint and sign of each half-space, such as "+elbow"; empty for a projection."""
    part: str
    """"force", "moment" or "wrench"."""
    rest: str
    """Value of the other three numbers: "zero" or "any"."""
    frame: str
    """Frame of application of the wrench."""
    kind: Kind
    """Axes and reference point, as in :meth:`Robot.jacobian`."""

    def contains(self, x: ArrayLike, slack: float = 1e-9) -> Array:
        """True if the robot can apply a force, moment or wrench.

        Parameters
        ----------
        x : (..., n) array_like [N or N m]
        slack : float, tolerance outside the polytope [N or N m]

        Returns
        -------
        answer : (...) array of bool
        """
        x = arguments.finite(x, "x", self.normals.shape[1])
        return np.all(x @ self.normals.T <= self.offsets + slack, axis=-1)

    def support(self, direction: ArrayLike) -> Array:
        """Support function: the largest direction · x over the polytope.

        Parameters
        ----------
        direction : (..., n) array_like

        Returns
        -------
        largest : (...) array, inf if the structure bears part of the direction
        """
        d = arguments.finite(direction, "direction", self.normals.shape[1])
        largest = (d @ self.vertices.T).max(axis=-1)
        length = np.linalg.norm(d, axis=-1)
        is_unbounded = np.linalg.norm(d @ self.borne, axis=-1) > RANK_TOLERANCE * length
        return np.where(is_unbounded, np.inf, largest)

    @property
    def facets(self) -> tuple[str, ...]:
        """Sides that bound the polytope: those that contain at least as many corners as its dimension."""
        dimension = self.normals.shape[1] - self.borne.shape[1]
        gap = np.abs(self.normals @ self.vertices.T - self.offsets[:, None])
        is_on_boundary = gap <= _FACET_TOLERANCE * (1.0 + np.abs(self.offsets[:, None]))
        corner_counts = np.sum(is_on_boundary, axis=1)
        return tuple(side for side, count in zip(self.sides, corner_counts, strict=False) if count >= dimension)

    def __str__(self) -> str:
        text = f"{self.part} polytope at {self.frame}: {len(self.vertices)} corners"
        if self.borne.size:
            text += f", unbounded along {self.borne.shape[1]} directions the structure bears"
        return f"{text}; the other part is {self.rest}"


def wrench_polytope(
    robot: Robot,
    q: ArrayLike,
    frame: str | None = None,
    *,
    part: str = "force",
    rest: str = "zero",
    kind: Kind = "world_aligned",
    limits: ArrayLike | None = None,
) -> WrenchPolytope:
    """Wrench polytope (force polytope): every x with abs(g(q) + J' F) ≤ limits, at one pose.

    Joints without a limit do not bound it. Takes one pose per call, as the number of corners depends on the pose.
    :func:`~twistwrench.statics.largest_wrench`, :func:`~twistwrench.statics.weakest_direction` and
    :func:`~twistwrench.statics.wrench_ellipsoid` take any batch.

    Parameters
    ----------
    part : "force", "moment" or "wrench" (m, f)
    rest : "zero" or "any", value of the other three numbers
        "zero", the section of the six-dimensional polytope; "any", its projection.

    Returns
    -------
    polytope : WrenchPolytope, with corners (k, 3), or (k, 6) for ``part="wrench"``

    Raises
    ------
    ValueRangeError
        No wrench keeps the limits, the base is floating, or there are no limits.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> found = wrench_polytope(arm, [0.0, np.pi / 2], limits=[50.0, 20.0])
    >>> found.vertices.shape, found.facets
    ((4, 3), ('+joint1', '+joint2', '-joint1', '-joint2'))
    """
    require_fixed_base(robot, "the wrench polytope")
    if rest not in ("zero", "any"):
        raise UnknownNameError.from_choices("value of rest", rest, ("zero", "any"))
    q = one_configuration(robot, q, "wrench_polytope", "poses differ in how many corners they have")
    rows = part_rows(part)
    jacobian_rows = slice(0, 6) if rest == "any" else rows
    effort_weights(robot, limits)  # rejects limits of zero
    L = effort_limits(robot, limits)
    g = motor_torques(robot.model, resting_torques(robot, q))
    J = motor_torques(robot.model, robot.jacobian(q, frame, kind))[jacobian_rows]
    is_limited = np.isfinite(L)
    A = np.concatenate([J.T[is_limited], -J.T[is_limited]])  # upper limits, then lower ones
    b = np.concatenate([(L - g)[is_limited], (L + g)[is_limited]])
    names = list(compress(robot.model.drive_labels, is_limited))
    sides = [f"+{name}" for name in names] + [f"-{name}" for name in names]
    labels: tuple[Any, ...] = (part, rest, str(robot.tip if frame is None else frame), kind)
    length = np.linalg.norm(A, axis=1)
    takes_part = length > _MIN_LEVER * max(1.0, length.max(initial=0.0))  # joints that some wrench loads
    is_beyond_limit = ~takes_part & (b < 0)
    if is_beyond_limit.any():
        k = int(np.argmin(np.where(takes_part, np.inf, b)))  # farthest beyond its limit
        joint = sides[k][1:]  # without the sign
        raise ValueRangeError(f"{joint} is beyond its limit whatever wrench is applied: the robot cannot hold itself.")
    A = A[takes_part] / length[takes_part, None]
    b = b[takes_part] / length[takes_part]
    sides = list(compress(sides, takes_part))
    vertices, borne = _corners(A, b)
    if rest == "any" and part != "wrench":
        return _projection(vertices[:, rows], borne[rows], labels)
    return WrenchPolytope(A, b, vertices, borne, tuple(sides), *labels)


def _corners(A: Array, b: Array) -> tuple[Array, Array]:
    """Corners (k, n) of the cross-section of A x ≤ b perpendicular to its lines, and an orthonormal basis (n, l) of these."""
    from scipy.spatial import HalfspaceIntersection

    _, s, Vt = np.linalg.svd(A, full_matrices=True)
    rank = int(np.sum(s > RANK_TOLERANCE * s.max(initial=1e-300)))
    Q, borne = Vt[:rank].T, Vt[rank:].T
    if rank == 0:
        return np.zeros((1, A.shape[1])), borne
    H = A @ Q  # half-spaces in the coordinates y of the cross-section, with x = Q y
    inner_point = _deepest_point(H, b)
    if rank == 1:
        h = H[:, 0]
        boundaries = b / h
        corners = np.array([[boundaries[h > 0].min()], [boundaries[h < 0].max()]])
    else:
        corners = HalfspaceIntersection(np.column_stack([H, -b]), inner_point).intersections
        # More half-spaces than dimensions may meet in a corner, which then is listed several times.
        size = np.abs(corners - inner_point).max()
        rounded = np.round((corners - inner_point) / (_CORNER_TOLERANCE * size))
        _, first_indices = np.unique(rounded, axis=0, return_index=True)
        corners = corners[np.sort(first_indices)]
    return corners @ Q.T, borne


def _deepest_point(H: Array, b: Array) -> Array:
    """Centre (r,) of the largest ball in H x ≤ b: the largest radius ρ with H x + ρ ≤ b, by linear programming.

    This is exact if the rows of H have unit length, which nearly holds.
    """
    from scipy.optimize import linprog

    scale = np.abs(b).max(initial=1e-300)
    r = H.shape[1]
    A = np.column_stack([H, np.ones(len(H))])
    bounds = [(None, None)] * r + [(0.0, _MAX_RADIUS)]  # on x and ρ, divided by the scale
    cost = [0.0] * r + [-1.0]
    optimum = linprog(cost, A_ub=A, b_ub=b / scale, bounds=bounds, method="highs")
    if optimum.status != 0 or optimum.x is None or optimum.x[-1] <= 1e-9:  # unsolved, or without a radius
        raise ValueRangeError(
            "no wrench at this pose keeps the torques within their limits: the robot's own weight and springs need more. "
            f"Look at statics.largest_payload for the joint, or pass larger {argument('limits')}."
        )
    return np.asarray(optimum.x[:-1]) * scale


def _projection(corners: Array, lines: Array, labels: tuple[Any, ...]) -> WrenchPolytope:
    """Polytope of three numbers: hull of the projected ``corners`` (k, 3) perpendicular to the projected ``lines`` (3, l)."""
    from scipy.spatial import ConvexHull

    U, s, _ = np.linalg.svd(lines, full_matrices=True)
    rank = int(np.sum(s > _MIN_LINE))
    borne, Q = U[:, :rank], U[:, rank:]
    points = corners @ Q  # in the coordinates of the cross-section
    if Q.shape[1] >= 2:
        hull = ConvexHull(points)
        equations = np.unique(np.round(hull.equations, 12), axis=0)  # one for the triangles of each plane
        normals, offsets = equations[:, :-1], -equations[:, -1]
        vertices = points[hull.vertices]
    elif Q.shape[1] == 1:
        normals, offsets = np.array([[1.0], [-1.0]]), np.array([points.max(), -points.min()])
        vertices = np.array([[points.max()], [points.min()]])
    else:
        normals, offsets = np.zeros((0, 0)), np.zeros(0)
        vertices = np.zeros((1, 0))
    return WrenchPolytope(normals @ Q.T, offsets, vertices @ Q.T, borne, (), *labels)


complete(globals())
