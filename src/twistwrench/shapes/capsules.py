"""Capsules around a robot's links, their distances from each other and from the floor, and distance gradients.

A capsule contains all points within a radius r of a segment from a to b. For a set of points and an axis u through c,
let ρ_i be the distance of point i from the axis and t_i its coordinate along the axis. The smallest capsule on that
axis has

    r = max ρ_i,      a = min (t_i + sqrt(r² - ρ_i²)),      b = max (t_i - sqrt(r² - ρ_i²)),

and u and c minimise the volume π r² (b - a) + 4/3 π r³.

If the robot file has no shapes, capsules are assumed between the origins of neighbouring joints and of links fixed to
them. Their radius is a quarter of the longest of these distances, at most 0.08 m. Each begins half a radius beyond the
joint that moves it, because the previous link ends there. A sphere of the same radius surrounds each centre of mass.

Source: Ericson, "Real-Time Collision Detection", 2005, 4.5, for the capsules of points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.numbers import number
from ..core.text import listed
from ..core.typing import Array
from ..mechanics.model.model import BASE
from ..robot import Robot
from .reader import read_shapes

if TYPE_CHECKING:
    from .solids import LinkSolids, Solid

_MAX_VOLUME_RATIO = 0.6
"""Volume ratio above which one capsule around all shapes replaces the overlapping capsules around single shapes."""
_FACET_GAP_OF_RADIUS = 0.015
"""Gap between facets and the round surface, as a share of the radius; true gaps reach 0.012."""
_MAX_ITERATIONS = 200
"""Largest number of iterations of a volume minimisation."""
_RADIUS_OF_LENGTH = 0.25
"""Assumed radius as a share of the longest distance between joints."""
_MAX_ASSUMED_RADIUS = 0.08
"""Largest assumed radius [m]."""
_START_OF_RADIUS = 0.5
"""Distance between a joint and the start of its link, as a share of the radius."""
_MAX_GAP_OF_ORIGINS = 1e-6
"""Distance up to which origins coincide [m]."""


@dataclass(frozen=True, eq=False)
class LinkCapsules:
    """Capsules around a robot's links, in link frames. Frames without mass and shape get radius 0 at their origin."""

    links: Array  # (k,), link index of each capsule
    ends: Array  # (k, 2, 3), end points of each capsule's segment [m]
    radii: Array  # (k,) [m]
    assumed: tuple[str, ...] = ()  # moving links with mass whose shapes are missing or cannot all be read
    thickness: float = 0.0  # radius of the assumed capsules [m]

    @classmethod
    def from_robot(cls, robot: Robot) -> LinkCapsules:
        """Build capsules around the file's collision shapes, or its visual shapes; assume them for bodies without shapes."""
        solids, links_lacking_shapes = link_solids(robot)
        return cls.from_solids(robot, solids, links_lacking_shapes)

    @classmethod
    def from_solids(cls, robot: Robot, solids: Sequence[Sequence[Solid]], lacking: Sequence[str] = ()) -> LinkCapsules:
        """Build capsules around the shapes of each link; assume them for bodies with a link in ``lacking``."""
        names = robot.link_names
        frames = robot.model.frames
        capsules: list[tuple[int, Array, float]] = []
        described_bodies = set()
        for k, (name, own_solids) in enumerate(zip(names, solids, strict=True)):
            if own_solids:
                capsules += [(k, segment, radius) for segment, radius in _capsules_of(own_solids)]
                described_bodies.add(frames[name].body)
            else:
                capsules.append((k, np.zeros((2, 3)), 0.0))  # a point, since every link has a capsule
        moving_links = tuple(name for name in lacking if frames[name].body != BASE)
        bodies_without_shapes = {frames[name].body for name in moving_links}
        thickness = 0.0
        if bodies_without_shapes:
            if BASE not in described_bodies:
                bodies_without_shapes.add(BASE)
            assumed = _assumed_capsules(robot, bodies_without_shapes)
            _, _, thickness = assumed[0]  # all have the same radius
            capsules += assumed
        links, ends, radii = zip(*capsules, strict=True)
        return cls(np.array(links), np.array(ends), np.array(radii), moving_links, thickness)

    @property
    def assumption(self) -> str:
        """Sentence without a full stop about links without shapes; empty if there are none."""
        if not self.assumed:
            return ""
        lacking = "a link has no shape" if len(self.assumed) == 1 else f"{len(self.assumed)} links have no shapes"
        radius_in_mm = 1000.0 * self.thickness
        return (
            f"{lacking} in the robot's file, so clearances are those of assumed capsules of "
            f"{number(radius_in_mm)} mm around {listed(self.assumed, 4)}; a file with <collision> or <visual> "
            "shapes gives true ones"
        )

    def separable_pairs(self, robot: Robot) -> Array:
        """Pairs (m, 2) of capsules by number, on links that are not connected by a joint; none of radius 0."""
        bodies = _bodies_of_links(robot, self.links)
        parents = np.array([BASE if body == BASE else robot.model.bodies[body].parent for body in bodies], int)
        i, j = np.triu_indices(len(bodies), 1)
        not_connected = (bodies[i] != bodies[j]) & (parents[i] != bodies[j]) & (parents[j] != bodies[i])
        have_extent = (self.radii[i] > 0) & (self.radii[j] > 0)
        return np.stack([i, j], axis=1)[not_connected & have_extent]

    def ends_in_base(self, poses: Array) -> Array:
        """End points of the capsules in the base frame (2, 3, n, k), from poses of all links (n, links, 4, 4)."""
        # One product of matrices for all poses: (3 n, 4 u) with (4 u, 2 k), of u links with capsules.
        links, end_columns = self._end_columns
        pose_rows = np.moveaxis(poses[:, links, :3, :], 2, 0).reshape(3 * len(poses), -1)
        ends = (pose_rows @ end_columns).reshape(3, len(poses), 2, -1)
        return np.moveaxis(ends, 2, 0)

    @cached_property
    def _end_columns(self) -> tuple[Array, Array]:
        """Indices of links with capsules (u,), and homogeneous end points (4 u, 2 k), each in the rows of its link."""
        links, link_of_capsule = np.unique(self.links, return_inverse=True)
        count = len(link_of_capsule)
        columns = np.zeros((len(links), 4, 2, count))
        columns[link_of_capsule, :3, :, np.arange(count)] = np.swapaxes(self.ends, 1, 2)
        columns[link_of_capsule, 3, :, np.arange(count)] = 1.0
        return links, columns.reshape(-1, 2 * count)


def _bodies_of_links(robot: Robot, links: Array) -> Array:
    """Body (n,) of each of these links, by number."""
    return np.array([robot.model.frames[robot.link_names[k]].body for k in links], int)


def link_solids(robot: Robot) -> tuple[list[list[Solid]], list[str]]:
    """Shapes of each link in the robot file, and names of the links with mass whose shapes are missing or unreadable."""
    from .meshes import MeshFiles
    from .solids import LinkSolids, SolidReader

    model = robot.model
    file = Path(model.source) if model.source else None
    reader = SolidReader(MeshFiles(file))
    described = {shapes.link: shapes for shapes in read_shapes(model)}
    # Links that the file with the shapes does not have count as links with mass.
    links_of_known_mass = described or model.link_inertias
    solids, lacking = [], []
    for name in robot.link_names:
        shapes = reader.read(described[name]) if name in described else LinkSolids()
        own_solids = _solids_of_one_role(shapes)
        solids.append(own_solids)
        may_have_mass = name not in links_of_known_mass or model.link_inertias[name].mass > 0
        is_complete = bool(own_solids) and shapes.complete
        if may_have_mass and not is_complete:
            lacking.append(name)
    return solids, lacking


def _assumed_capsules(robot: Robot, bodies: set[int]) -> list[tuple[int, Array, float]]:
    """Capsules (link, ends in its frame, radius) of bodies without shapes."""
    model = robot.model
    poses = robot.link_poses(robot.neutral)
    links = dict[int, list[int]]()  # of each body
    for k, name in enumerate(robot.link_names):
        links.setdefault(model.frames[name].body, []).append(k)
    segments = {body: _segments_of_body(robot, body, links, poses) for body in links}
    longest_distance = 0.0  # of an end from the origin of its body's first link
    for own_segments in segments.values():
        for _, end in own_segments:
            longest_distance = max(longest_distance, float(np.linalg.norm(end)))
    radius = min(_MAX_ASSUMED_RADIUS, _RADIUS_OF_LENGTH * longest_distance)
    capsules = list[tuple[int, Array, float]]()
    for body in sorted(bodies):
        first_link = links[body][0]
        for start, end in segments[body]:
            length = float(np.linalg.norm(end - start))
            if body != BASE and length:  # the previous link ends at the joint
                share_left_out = min(1.0, _START_OF_RADIUS * radius / length)
                start = start + share_left_out * (end - start)
            capsules.append((first_link, np.array([start, end]), radius))
        if body != BASE and model.bodies[body].inertia.mass > 0:
            com = model.bodies[body].inertia.com
            capsules.append((first_link, np.array([com, com]), radius))  # a sphere
    return capsules


def _segments_of_body(robot: Robot, body: int, links: dict[int, list[int]], poses: Array) -> list[tuple[Array, Array]]:
    """Segments that join the origins of a body's links and of the next joints, in the frame of its first link.

    From near to far, each origin is joined to the nearest of the origins before it. ``links`` are those of each body, and
    ``poses`` those of all links.
    """
    model = robot.model
    child_links = [links[child][0] for child in links if child != BASE and model.bodies[child].parent == body]
    inverse = np.linalg.inv(poses[links[body][0]])
    origins = []
    for k in (*links[body], *child_links):
        pose_in_first_link = inverse @ poses[k]
        origins.append(pose_in_first_link[:3, 3])
    is_last_body = body != BASE and not child_links
    if is_last_body and np.ptp(origins, axis=0).max() <= _MAX_GAP_OF_ORIGINS:
        com = np.asarray(model.bodies[body].inertia.com)
        origins.append(2.0 * com)  # as for a rod, whose centre of mass is in its middle
    joined_origins = [origins[0]]
    segments = []
    for origin in sorted(origins[1:], key=lambda origin: float(np.linalg.norm(origin))):
        distances = [float(np.linalg.norm(other - origin)) for other in joined_origins]
        nearest = joined_origins[int(np.argmin(distances))]
        if min(distances) > _MAX_GAP_OF_ORIGINS:
            joined_origins.append(origin)
            segments.append((nearest, origin))
    if not segments:
        return [(origins[0], origins[0])]
    return segments


def _solids_of_one_role(shapes: LinkSolids) -> list[Solid]:
    """Collision shapes of a link, or its visual shapes if it has none."""
    collision = [solid for solid in shapes.solids if solid.shape.role == "collision"]
    return collision or [solid for solid in shapes.solids if solid.shape.role == "visual"]


def _capsules_of(solids: Sequence[Solid]) -> list[tuple[Array, float]]:
    """One capsule per shape, or one around all shapes if it is hardly larger in volume."""
    capsules = [_capsule_of(solid) for solid in solids]
    if len(capsules) < 2:
        return capsules
    all_points = np.concatenate([solid.points for solid in solids])
    ends, radius = capsule_around(all_points)
    radius += max(_facet_gap(solid) for solid in solids)
    sum_of_volumes = sum(_volume(own_ends, own_radius) for own_ends, own_radius in capsules)
    if _volume(ends, radius) <= _MAX_VOLUME_RATIO * sum_of_volumes:
        return [(ends, radius)]
    return capsules


def _facet_gap(solid: Solid) -> float:
    """Largest distance between a round surface and its facets [m]."""
    if solid.shape.kind in ("box", "mesh"):
        return 0.0
    return _FACET_GAP_OF_RADIUS * max(solid.shape.sizes)


def _capsule_of(solid: Solid) -> tuple[Array, float]:
    """Segment (2, 3) and radius of the capsule around one shape."""
    shape = solid.shape
    if shape.kind in ("sphere", "capsule"):
        half_length = 0.0
        if shape.kind == "capsule":
            _, length = shape.sizes
            half_length = 0.5 * length
        centre = shape.pose[:3, 3]
        z_axis = shape.pose[:3, 2]
        to_end = z_axis * half_length
        return centre + np.array([-to_end, to_end]), shape.sizes[0]
    ends, radius = capsule_around(solid.points)
    return ends, radius + _facet_gap(solid)


def _volume(ends: Array, r: float) -> float:
    """Volume of a capsule [m³]: cylinder and sphere."""
    return float(np.pi * r**2 * (np.linalg.norm(ends[1] - ends[0]) + 4.0 / 3.0 * r))


def capsule_around(points: Array) -> tuple[Array, float]:
    """Ends (2, 3) and radius of the smallest capsule around points, found by a short local search."""
    from scipy.optimize import minimize

    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=True)
    size = float(np.ptp(points @ axes.T, axis=0).max()) or 1.0  # 1 for a single point

    def capsule_on_axis(x: Array, axes: Array) -> tuple[Array, float]:
        """Smallest capsule on an axis near the first of three: x (4,) is the tilt and the shift along the two others."""
        u = axes[0] + x[0] * axes[1] + x[1] * axes[2]
        u /= np.linalg.norm(u)
        c = middle + size * (x[2] * axes[1] + x[3] * axes[2])
        t = (points - c) @ u
        rho = np.linalg.norm(points - c - np.outer(t, u), axis=1)
        r = float(rho.max())
        half_chord = np.sqrt(np.maximum(r**2 - rho**2, 0.0))
        a = float((t + half_chord).min())
        b = float((t - half_chord).max())
        if a > b:  # a sphere suffices
            a = b = 0.5 * (a + b)
            r = float(np.linalg.norm(points - c - a * u, axis=1).max())
        return np.array([c + a * u, c + b * u]), r

    def volume(x: Array, axes: Array) -> float:
        ends, r = capsule_on_axis(x, axes)
        return _volume(ends, r)

    capsules = list[tuple[Array, float]]()
    for k in range(3):  # from each principal axis, as the search finds local minima
        rotated_axes = np.roll(axes, -k, axis=0)
        optimum = minimize(
            volume, np.zeros(4), args=(rotated_axes,), method="Nelder-Mead", options={"maxiter": _MAX_ITERATIONS}
        )
        capsules.append(capsule_on_axis(np.asarray(optimum.x), rotated_axes))
    return min(capsules, key=lambda ends_and_radius: _volume(*ends_and_radius))


# ── Distances between moving capsules, and their gradients by the joints

# The nearest points of segments p + s d and q + t e lie on the infinite lines if s and t are within 0 and 1. Otherwise
# one of them is an end point. If the joints move, the distance changes by n · (dp_B - dp_A), with n from A to B and
# both nearest points fixed to their links. Their sliding along the segments changes the distance only in second order.
#
# Source: Ericson, "Real-Time Collision Detection", 2005, 5.1.9.

MARGIN = 0.02
"""Clearance [m] between capsules, and between capsules and the floor."""
_SAMPLED_CONFIGURATIONS = 200
"""Number of random configurations by which pairs are selected."""
Pullback = Callable[[Array], Array]
"""Function from weights of the results to the gradient of their weighted sum."""
ALWAYS = 0.95
"""Share of random configurations in contact above which a pair (of capsules, or capsule and floor) counts as always near."""
_MAX_HEIGHT_CHANGE = 1e-9
"""Change of a height [m] up to which it is constant."""
_MIN_LENGTH_SQUARED = 1e-14
"""Square of a segment's length [m²] up to which it counts as a point."""
_MIN_DETERMINANT = 1e-12
"""Squared sine of the angle between two segments up to which they are parallel."""
_MIN_DISTANCE = 1e-12
"""Smallest divisor of a distance vector [m], so that touching axes have no direction instead of NaN."""


def nearest_points(a: Array, b: Array) -> tuple[Array, Array]:
    """Fractions s and t (n,) of the lengths of segments at which they are nearest, from their ends (2, 3, n)."""
    d, e, r = a[1] - a[0], b[1] - b[0], a[0] - b[0]
    dd, ee, de = _dot(d, d), _dot(e, e), _dot(d, e)
    dr, er = _dot(d, r), _dot(e, r)
    det = dd * ee - de**2
    with np.errstate(divide="ignore", invalid="ignore"):  # quotients of points and of parallel segments are replaced
        s = np.where(det > _MIN_DETERMINANT * dd * ee, np.clip((de * er - dr * ee) / det, 0.0, 1.0), 0.0)
        t = np.where(ee > _MIN_LENGTH_SQUARED, np.clip((de * s + er) / ee, 0.0, 1.0), 0.0)
        s = np.where(dd > _MIN_LENGTH_SQUARED, np.clip((de * t - dr) / dd, 0.0, 1.0), 0.0)
    return s, t


def _dot(a: Array, b: Array) -> Array:
    """Scalar products (...) of vectors (3, ...)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _split_by_floor(robot: Robot, capsules: LinkCapsules, q: Array, floor: float) -> tuple[Array, Array]:
    """Indices of capsules whose height changes, and of those that stay near the floor because their link keeps its height."""
    poses = robot.link_poses(q)
    heights = capsules.ends_in_base(poses)[:, 2].min(axis=0)
    changes_height = np.ptp(heights, axis=0) > _MAX_HEIGHT_CHANGE
    keeps_height = np.ptp(poses[:, capsules.links, 2, 3], axis=0) <= _MAX_HEIGHT_CHANGE
    always_near = (heights - capsules.radii - floor < MARGIN).mean(axis=0) >= ALWAYS
    stays_low = keeps_height & always_near
    is_on_moving_body = _bodies_of_links(robot, capsules.links) != BASE
    return np.flatnonzero(changes_height & ~stays_low), np.flatnonzero(is_on_moving_body & stays_low)


@dataclass(frozen=True, eq=False)
class CapsuleDistances:
    """Distances of a robot's capsules from each other and from the floor."""

    robot: Robot
    capsules: LinkCapsules
    pairs: Array  # (m, 2), capsule pairs that are evaluated
    above: Array  # (k,), indices of capsules checked against the floor: those whose height changes
    floor: float | None  # height [m]
    margins: Array  # (m,), required clearance of each pair [m]
    itself: bool  # true if pairs of links are evaluated
    unwatched: tuple[str, ...] = ()  # clauses about distances left out because the construction keeps them small

    @classmethod
    def from_capsules(
        cls, robot: Robot, capsules: LinkCapsules, *, floor: float | None, itself: bool
    ) -> CapsuleDistances:
        """Select the pairs that can touch: links not connected by a joint and not always near each other.

        Capsules that are always near the floor, on a link with an origin of constant height, are also left out.
        """
        names = robot.link_names
        pairs = np.zeros((0, 2), int)
        if itself:
            pairs = capsules.separable_pairs(robot)
        q = robot.random_configuration(0, _SAMPLED_CONFIGURATIONS)
        no_indices = np.zeros(0, int)
        no_margins = np.zeros(0)
        all_pairs = cls(robot, capsules, pairs, no_indices, None, no_margins, itself)
        distances, _ = all_pairs.evaluate(q)
        always_near = (distances < MARGIN).mean(axis=0) >= ALWAYS
        left_out = (distances <= 0.0).mean(axis=0) >= ALWAYS
        if capsules.assumed:
            left_out = always_near
        # Other pairs that are always near keep no margin, but their shapes must not touch.
        margins = np.where(always_near, 0.0, MARGIN)[~left_out]
        pairs_of_links = {(names[capsules.links[a]], names[capsules.links[b]]) for a, b in pairs[left_out]}
        remarks = []
        for link, other_link in sorted(pairs_of_links):
            remarks.append(f"capsules around {link} and {other_link} are near each other wherever the joints are")
        above = no_indices
        if floor is not None:
            above, low = _split_by_floor(robot, capsules, q, floor)
            if low.size:
                low_links = dict.fromkeys(names[capsules.links[k]] for k in low)  # each once
                remarks.append(
                    f"the floor is too near {', '.join(low_links)} wherever the joints are, at a fixed height"
                )
        return cls(robot, capsules, pairs[~left_out], above, floor, margins, itself, tuple(remarks))

    @property
    def count(self) -> int:
        """Number of distances: m + 2 k."""
        return len(self.pairs) + 2 * len(self.above)

    def evaluate(self, q: Array, near: float = np.inf) -> tuple[Array, Pullback]:
        """Distances of the pairs and of the ends above the floor [m], negative if capsules overlap, and their pullback.

        Parameters
        ----------
        q : (n, nq) array
        near : float, distance [m] above which a pair gets a lower bound, the distance of the capsules' bounding spheres

        Returns
        -------
        distances : (n, m + 2 k) array
        pullback : function of weights (n, m + 2 k) that returns the gradient (n, nv) of the weighted sum
        """
        ends = self.capsules.ends_in_base(self.robot.link_poses(q))
        i, j = self.pairs.T
        r = self.capsules.radii
        pair_count = len(self.pairs)
        # Lower bounds by bounding spheres first, then the true distances of near pairs.
        middle = 0.5 * (ends[0] + ends[1])
        sphere_radii = r + 0.5 * np.linalg.norm(self.capsules.ends[:, 1] - self.capsules.ends[:, 0], axis=1)
        d = middle[..., j] - middle[..., i]
        distances = np.sqrt(_dot(d, d)) - sphere_radii[i] - sphere_radii[j]
        fractions = np.full((2, len(q), pair_count), 0.5)  # of the nearest points along both segments
        rows, pair = np.nonzero(distances < near)  # a row is a configuration
        a = ends[:, :, rows, i[pair]]
        b = ends[:, :, rows, j[pair]]
        s, t = nearest_points(a, b)
        fractions[:, rows, pair] = s, t
        d = b[0] + t * (b[1] - b[0]) - a[0] - s * (a[1] - a[0])
        distances[rows, pair] = np.sqrt(_dot(d, d)) - r[i[pair]] - r[j[pair]]
        if self.floor is not None:
            heights = ends[:, 2][..., self.above] - r[self.above] - self.floor
            distances = np.concatenate([distances, *heights], axis=1)

        def pullback(weights: Array) -> Array:
            """Gradient as joint forces: those of weighted unit forces that push the nearest points apart."""
            rows, pair = np.nonzero(weights[:, :pair_count])
            a, b = ends[:, :, rows, i[pair]], ends[:, :, rows, j[pair]]
            s, t = fractions[:, rows, pair]
            p_a = a[0] + s * (a[1] - a[0])  # nearest points
            p_b = b[0] + t * (b[1] - b[0])
            length = np.maximum(np.linalg.norm(p_b - p_a, axis=0), _MIN_DISTANCE)
            n = (p_b - p_a) * weights[rows, pair] / length
            # Columns after the pairs are heights: of the first ends of all capsules above, then of the second ends.
            floor_rows, columns = np.nonzero(weights[:, pair_count:])
            above = np.tile(self.above, 2)[columns]
            end_index = columns // max(len(self.above), 1)
            up = np.outer([0.0, 0.0, 1.0], weights[floor_rows, pair_count + columns])
            floor_points = ends[end_index, :, floor_rows, above].T
            points = np.concatenate([p_a, p_b, floor_points], axis=1)
            forces = np.concatenate([-n, n, up], axis=1)
            force_rows = np.concatenate([rows, rows, floor_rows])
            links = self.capsules.links[np.concatenate([i[pair], j[pair], above])]
            return self._joint_forces(q, force_rows, links, points, forces)

        return distances, pullback

    def _joint_forces(self, q: Array, rows: Array, links: Array, points: Array, forces: Array) -> Array:
        """Σ J' F (n, nv) of p forces (3, p) at points (3, p); each acts on one link (p,) in one configuration, a row of q."""
        joint_forces = np.zeros((len(q), self.robot.nv))
        moments = np.cross(points, forces, axis=0)  # about the origin of the base
        wrenches = np.concatenate([moments, forces]).T
        for link in np.unique(links):
            on_link = links == link
            wrench_on_link = np.zeros((len(q), 6))  # in each configuration
            np.add.at(wrench_on_link, rows[on_link], wrenches[on_link])
            J = self.robot.jacobian(q, frame=self.robot.link_names[link], kind="space")
            joint_forces += (J * wrench_on_link[:, :, None]).sum(axis=1)
        return joint_forces
