"""The wrench polytope: every wrench a robot at rest can apply within its torque limits, gravity held first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import UnknownNameError, ValueRangeError
from ..typing import Array
from .ellipsoid import effort_weights, part_rows
from .holding_torques import RANK_TOLERANCE
from .pose_arguments import one_configuration
from .torque_limits import effort_limits, require_fixed_base, resting_torques

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.quantity_types import Kind


@dataclass(frozen=True, eq=False)
class WrenchPolytope:
    """Wrench polytope: all x (n,) with ``normals`` @ x ≤ ``offsets``.

    A bounded cross-section, times what the structure bears.
    """

    normals: Array
    """(h, n): outward, of unit length."""
    offsets: Array
    """(h,): distance of each half-space's edge from zero, negative where zero is outside."""
    vertices: Array
    """(k, n): corners of the cross-section perpendicular to ``borne``."""
    borne: Array
    """(n, b): an orthonormal basis of the directions without bound; no columns for a bounded polytope."""
    sides: tuple[str, ...]
    """(h,): the joint and sign behind each half-space, such as "+elbow"; empty for a projection."""
    part: str
    """"force", "moment" or "wrench"."""
    rest: str
    """What the other three numbers are: "zero" or "any"."""
    frame: str
    """The frame at which the wrench is applied."""
    kind: Kind
    """Axes and reference point, as in :meth:`Robot.jacobian`."""

    def contains(self, x: ArrayLike, slack: float = 1e-9) -> Array:
        """Whether the robot can apply a force, moment or wrench.

        Parameters
        ----------
        x : (..., n) array_like [N or N m]
        slack : float, by which it may lie outside [N or N m]

        Returns
        -------
        answer : (...) array of bool

        Raises
        ------
        ShapeError, ValueRangeError
            ``x`` is of another size, or not finite.

        Examples
        --------
        >>> import twistwrench as tw
        >>> found = wrench_polytope(tw.robots.planar_2r(), [0.0, np.pi / 2], limits=[50.0, 20.0])
        >>> found.contains([[0, 0, 0], [0, 0, 100]]).tolist()
        [True, False]
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
        largest : (...) array, inf where the structure bears part of the direction

        Raises
        ------
        ShapeError, ValueRangeError
            ``direction`` is of another size, or not finite.

        Examples
        --------
        >>> import twistwrench as tw
        >>> found = wrench_polytope(tw.robots.planar_2r(), [0.0, np.pi / 2], limits=[50.0, 20.0])
        >>> round(float(found.support([0, 0, 1])), 6)
        50.38
        """
        d = arguments.finite(direction, "direction", self.normals.shape[1])
        most = (d @ self.vertices.T).max(axis=-1)
        size = np.linalg.norm(d, axis=-1)
        return np.where(np.linalg.norm(d @ self.borne, axis=-1) > RANK_TOLERANCE * size, np.inf, most)

    @property
    def facets(self) -> tuple[str, ...]:
        """The sides that do bound it: those that pass through as many corners as its dimension."""
        dimension = self.normals.shape[1] - self.borne.shape[1]
        gap = np.abs(self.normals @ self.vertices.T - self.offsets[:, None])
        touching = np.sum(gap <= 1e-7 * (1.0 + np.abs(self.offsets[:, None])), axis=1)
        return tuple(s for s, n in zip(self.sides, touching, strict=False) if n >= dimension)

    def __str__(self) -> str:
        free = f", unbounded along {self.borne.shape[1]} directions the structure bears" if self.borne.size else ""
        return (
            f"{self.part} polytope at {self.frame}: {len(self.vertices)} corners{free}; the other part is {self.rest}"
        )


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

    Parameters
    ----------
    robot : Robot
    q : (nq,) array_like, configuration
    frame : str, optional, a link of the robot; its tip if None
    part : "force", "moment" or "wrench" (m, f)
    rest : "zero" or "any", what the other three numbers are
        "zero", the section of the six-dimensional polytope; "any", its projection.
    kind : "body", "space" or "world_aligned", axes and reference point as in :meth:`twistwrench.Robot.jacobian`
    limits : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]

    Returns
    -------
    polytope : WrenchPolytope, with corners (k, 3), or (k, 6) for ``part="wrench"``

    Raises
    ------
    ValueRangeError
        No wrench at all keeps the limits, the base floats, or there are no limits.
    ShapeError
        q is a batch; it says how to loop.
    UnknownNameError, FrameError
        As the robot's methods.

    Notes
    -----
    Joints without a limit bound nothing. One pose at a time, as poses differ in how many corners they have;
    :func:`~twistwrench.statics.largest_wrench`, :func:`~twistwrench.statics.weakest_direction` and
    :func:`~twistwrench.statics.wrench_ellipsoid` take any batch.

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
        raise UnknownNameError.of("value of rest", rest, ("zero", "any"))
    q = one_configuration(robot, q, "wrench_polytope", "poses differ in how many corners they have")
    rows, whole = part_rows(part), slice(0, 6)
    effort_weights(robot, limits)  # refuses limits of zero
    L, g = effort_limits(robot, limits), resting_torques(robot, q)
    J = np.asarray(robot.jacobian(q, frame, kind))[whole if rest == "any" else rows]
    some = np.isfinite(L)
    A = np.concatenate([J.T[some], -J.T[some]])
    b = np.concatenate([(L - g)[some], (L + g)[some]])
    names = [n for n, finite in zip(robot.model.velocity_names, some, strict=True) if finite]
    sides = [f"+{n}" for n in names] + [f"-{n}" for n in names]
    labels: tuple[Any, ...] = (part, rest, str(robot.tip if frame is None else frame), kind)
    length = np.linalg.norm(A, axis=1)
    felt = length > 1e-12 * max(1.0, length.max(initial=0.0))
    if np.any(b[~felt] < 0):
        k = int(np.flatnonzero(~felt)[np.argmin(b[~felt])])
        raise ValueRangeError(
            f"{sides[k][1:]} is beyond its limit whatever wrench is applied: the robot cannot hold itself."
        )
    A, b = A[felt] / length[felt, None], b[felt] / length[felt]
    sides = [s for s, f in zip(sides, felt, strict=True) if f]
    vertices, borne = _corners(A, b)
    if rest == "any" and part != "wrench":
        return _projection(vertices[:, rows], borne[rows], labels)
    return WrenchPolytope(A, b, vertices, borne, tuple(sides), *labels)


def _corners(A: Array, b: Array) -> tuple[Array, Array]:
    """Corners (k, n) of A x ≤ b perpendicular to its lines, and an orthonormal basis (n, l) of these."""
    from scipy.spatial import HalfspaceIntersection

    _, s, Vt = np.linalg.svd(A, full_matrices=True)
    rank = int(np.sum(s > RANK_TOLERANCE * s.max(initial=1e-300)))
    Q, borne = Vt[:rank].T, Vt[rank:].T
    if rank == 0:
        return np.zeros((1, A.shape[1])), borne
    H = A @ Q
    inside = _deepest_point(H, b)
    if rank == 1:
        ends = b / H[:, 0]
        corners = np.array([[ends[H[:, 0] > 0].min()], [ends[H[:, 0] < 0].max()]])
    else:
        corners = HalfspaceIntersection(np.column_stack([H, -b]), inside).intersections
        scale = np.abs(corners - inside).max()
        _, first = np.unique(np.round((corners - inside) / (1e-9 * scale)), axis=0, return_index=True)
        corners = corners[np.sort(first)]
    return corners @ Q.T, borne


def _deepest_point(H: Array, b: Array) -> Array:
    """The centre (r,) of the largest ball in H x ≤ b, by linear programming."""
    from scipy.optimize import linprog

    scale = np.abs(b).max(initial=1e-300)
    size = H.shape[1]
    found = linprog(
        [0.0] * size + [-1.0],
        A_ub=np.column_stack([H, np.ones(len(H))]),
        b_ub=b / scale,
        bounds=[(None, None)] * size + [(0.0, 1e3)],
        method="highs",
    )
    if found.status != 0 or found.x is None or found.x[-1] <= 1e-9:
        raise ValueRangeError(
            "no wrench at this pose keeps the torques within their limits: the robot's own weight and springs ask for more. "
            "Look at statics.largest_payload for the joint, or pass larger limits=."
        )
    return np.asarray(found.x[:-1]) * scale


def _projection(corners: Array, lines: Array, labels: tuple[Any, ...]) -> WrenchPolytope:
    """The shadow on three numbers: hull of the corners' shadows across the lines' shadows."""
    from scipy.spatial import ConvexHull

    U, s, _ = np.linalg.svd(lines, full_matrices=True)
    rank = int(np.sum(s > 1e-7))
    borne, Q = U[:, :rank], U[:, rank:]
    flat = corners @ Q
    if Q.shape[1] >= 2:
        hull = ConvexHull(flat)
        equations = np.unique(np.round(hull.equations, 12), axis=0)
        normals, offsets, kept = equations[:, :-1], -equations[:, -1], flat[hull.vertices]
    elif Q.shape[1] == 1:
        kept = np.array([[flat.max()], [flat.min()]])
        normals, offsets = np.array([[1.0], [-1.0]]), np.array([flat.max(), -flat.min()])
    else:
        kept, normals, offsets = np.zeros((1, 0)), np.zeros((0, 0)), np.zeros(0)
    return WrenchPolytope(normals @ Q.T, offsets, kept @ Q.T, borne, (), *labels)
