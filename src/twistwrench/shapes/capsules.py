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

_WORTH = 0.6
"""Volume ratio above which one capsule around all shapes replaces the overlapping capsules around single shapes."""
_FACETS = 0.015  # gap between facets and the round surface, as a share of the radius; 0.012 at most
_STEPS = 200  # iterations of the volume minimisation
_THICK, _THICKEST = 0.25, 0.08  # assumed radius: share of the longest distance between joints, and the maximum [m]
_BESIDE = 0.5  # distance between the joint and the start of its link, as a share of the radius
_SAME = 1e-6  # m: origins closer than this coincide


@dataclass(frozen=True, eq=False)
class LinkCapsules:
    """Capsules around a robot's links, in link frames. Frames without mass and shape get radius 0 at their origin."""

    links: Array  # (k,), link index of each capsule
    ends: Array  # (k, 2, 3) [m]
    radii: Array  # (k,) [m]
    # moving links with mass and at least one missing or unreadable shape
    assumed: tuple[str, ...] = ()
    thickness: float = 0.0  # radius of the assumed capsules [m]

    @classmethod
    def from_robot(cls, robot: Robot) -> LinkCapsules:
        """Build capsules around the file's collision shapes, or its visual shapes; assume them for bodies without shapes."""
        return cls.from_solids(robot, *link_solids(robot))

    @classmethod
    def from_solids(cls, robot: Robot, solids: Sequence[Sequence[Solid]], lacking: Sequence[str] = ()) -> LinkCapsules:
        """Build capsules around the shapes of each link; assume them for bodies with a link in ``lacking``."""
        names, frames = robot.link_names, robot.model.frames
        found = [
            (k, segment, radius)
            for k, mine in enumerate(solids)
            for segment, radius in _of_solids(mine) or [(np.zeros((2, 3)), 0.0)]
        ]
        seen = {frames[name].body for name, mine in zip(names, solids, strict=True) if mine}
        bodies = {frames[name].body for name in lacking if frames[name].body != BASE}
        made = _assumed(robot, bodies if BASE in seen else bodies | {BASE}) if bodies else []
        links, ends, radii = (np.array(x) for x in zip(*found, *made, strict=True))
        moving = tuple(name for name in lacking if frames[name].body != BASE)
        return cls(links, ends, radii, moving, made[0][2] if made else 0.0)

    @property
    def assumption(self) -> str:
        """Sentence without a full stop about links without shapes; empty if there are none."""
        if not self.assumed:
            return ""
        lacking = "a link has no shape" if len(self.assumed) == 1 else f"{len(self.assumed)} links have no shapes"
        return (
            f"{lacking} in the robot's file, so clearances are those of assumed capsules of "
            f"{number(1000.0 * self.thickness)} mm around {listed(self.assumed, 4)}; a file with <collision> or <visual> "
            "shapes gives true ones"
        )

    def separable_pairs(self, robot: Robot) -> Array:
        """Pairs (m, 2) of capsules on links that are not connected by a joint."""
        bodies = np.array([robot.model.frames[robot.link_names[k]].body for k in self.links], int)
        parents = np.array([BASE if b == BASE else robot.model.bodies[b].parent for b in bodies], int)
        i, j = np.triu_indices(len(bodies), 1)
        apart = (bodies[i] != bodies[j]) & (parents[i] != bodies[j]) & (parents[j] != bodies[i])
        return np.stack([i, j], axis=1)[apart & (self.radii[i] > 0) & (self.radii[j] > 0)]

    def placed(self, poses: Array) -> Array:
        """End points of the capsules in the base frame (2, 3, n, k), from poses of all links (n, links, 4, 4)."""
        used, columns = self._columns
        rows = np.moveaxis(poses[:, used, :3, :], 2, 0).reshape(3 * len(poses), -1)
        return np.moveaxis((rows @ columns).reshape(3, len(poses), 2, -1), 2, 0)

    @cached_property
    def _columns(self) -> tuple[Array, Array]:
        """Links with capsules (u,), and homogeneous end points (4 u, 2 k), each in the rows of its link."""
        used, mine = np.unique(self.links, return_inverse=True)
        found = np.zeros((len(used), 4, 2, len(mine)))
        found[mine, :3, :, np.arange(len(mine))] = np.swapaxes(self.ends, 1, 2)
        found[mine, 3, :, np.arange(len(mine))] = 1.0
        return used, found.reshape(-1, 2 * len(mine))


def link_solids(robot: Robot) -> tuple[list[list[Solid]], list[str]]:
    """Shapes of each link in the robot file, and the links with mass and a missing or unreadable shape."""
    from .meshes import MeshFiles
    from .solids import LinkSolids, SolidReader

    model = robot.model
    reader = SolidReader(MeshFiles(Path(model.source) if model.source else None))
    described = {shapes.link: shapes for shapes in read_shapes(model)}
    known, solids, lacking = described if described else model.link_inertias, [], []
    for name in robot.link_names:
        shapes = reader.read(described[name]) if name in described else LinkSolids()
        solids.append(_looked_at(shapes))
        heavy = name not in known or model.link_inertias[name].mass > 0
        if heavy and not (solids[-1] and shapes.complete):
            lacking.append(name)
    return solids, lacking


def _assumed(robot: Robot, bodies: set[int]) -> list[tuple[int, Array, float]]:
    """Capsules (link, ends in its frame, radius) of bodies without shapes."""
    names, model, poses = robot.link_names, robot.model, robot.link_poses(robot.neutral)
    links = dict[int, list[int]]()
    for k, name in enumerate(names):
        links.setdefault(model.frames[name].body, []).append(k)
    rods = dict[int, list[tuple[Array, Array]]]()
    for body, mine in links.items():
        next_ones = [links[b][0] for b in links if b != BASE and model.bodies[b].parent == body]
        inverse = np.linalg.inv(poses[mine[0]])
        places = [(inverse @ poses[k])[:3, 3] for k in (*mine, *next_ones)]
        if body != BASE and np.ptp(places, axis=0).max() <= _SAME and not next_ones:
            places.append(2.0 * np.asarray(model.bodies[body].inertia.com))  # a rod to twice the centre of mass
        origins = [places[0]]
        rods[body] = []
        for place in sorted(places[1:], key=lambda x: float(np.linalg.norm(x))):
            near = min(origins, key=lambda x: float(np.linalg.norm(x - place)))
            if np.linalg.norm(place - near) > _SAME:
                origins.append(place)
                rods[body].append((near, place))
        rods[body] = rods[body] or [(places[0], places[0])]
    longest = max(float(np.linalg.norm(b)) for body in rods.values() for _, b in body)
    radius = min(_THICKEST, _THICK * longest)
    found = list[tuple[int, Array, float]]()
    for body in sorted(bodies):
        k = links[body][0]
        for near, far in rods[body]:
            length = float(np.linalg.norm(far - near))
            begin = near if body == BASE or not length else near + min(1.0, _BESIDE * radius / length) * (far - near)
            found.append((k, np.array([begin, far]), radius))
        if body != BASE and model.bodies[body].inertia.mass > 0:
            found.append((k, np.array(2 * [model.bodies[body].inertia.com]), radius))
    return found


def _looked_at(shapes: LinkSolids) -> list[Solid]:
    """Collision shapes of a link, or its visual shapes if it has none."""
    roles = ([s for s in shapes.solids if s.shape.role == role] for role in ("collision", "visual"))
    return next((mine for mine in roles if mine), [])


def _of_solids(solids: Sequence[Solid]) -> list[tuple[Array, float]]:
    """One capsule per shape, or one around all shapes if it is hardly larger in volume."""
    each = [_around(solid) for solid in solids]
    if len(each) < 2:
        return each
    ends, radius = capsule_around(np.concatenate([solid.points for solid in solids]))
    whole = ends, radius + max(_bulge(solid) for solid in solids)
    return [whole] if _volume(*whole) <= _WORTH * sum(_volume(*one) for one in each) else each


def _bulge(solid: Solid) -> float:
    """Largest distance between a round surface and its facets [m]."""
    return 0.0 if solid.shape.kind in ("box", "mesh") else _FACETS * max(solid.shape.sizes)


def _around(solid: Solid) -> tuple[Array, float]:
    """Segment (2, 3) and radius of the capsule around one shape."""
    shape = solid.shape
    if shape.kind in ("sphere", "capsule"):
        half = 0.5 * shape.sizes[1] if shape.kind == "capsule" else 0.0
        along = shape.pose[:3, 2] * half
        return shape.pose[:3, 3] + np.array([-along, along]), shape.sizes[0]
    ends, radius = capsule_around(solid.points)
    return ends, radius + _bulge(solid)


def _volume(ends: Array, r: float) -> float:
    return float(np.pi * r**2 * (np.linalg.norm(ends[1] - ends[0]) + 4.0 / 3.0 * r))


def capsule_around(points: Array) -> tuple[Array, float]:
    """Smallest capsule around points, found by a short local search."""
    from scipy.optimize import minimize

    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=True)[2]
    size = float(np.ptp(points @ axes.T, axis=0).max()) or 1.0

    def capsule(x: Array, frame: Array) -> tuple[Array, float]:
        u = frame[0] + x[0] * frame[1] + x[1] * frame[2]
        u /= np.linalg.norm(u)
        c = middle + size * (x[2] * frame[1] + x[3] * frame[2])
        t = (points - c) @ u
        away = np.linalg.norm(points - c - np.outer(t, u), axis=1)
        r = float(away.max())
        reach = np.sqrt(np.maximum(r**2 - away**2, 0.0))
        low, high = float((t + reach).min()), float((t - reach).max())
        if low > high:
            low = high = 0.5 * (low + high)
            r = float(np.linalg.norm(points - c - low * u, axis=1).max())
        return np.array([c + low * u, c + high * u]), r

    found = list[tuple[Array, float]]()
    for frame in (np.roll(axes, -k, axis=0) for k in range(3)):

        def volume(x: Array, frame: Array = frame) -> float:
            return _volume(*capsule(x, frame))

        best = minimize(volume, np.zeros(4), method="Nelder-Mead", options={"maxiter": _STEPS})
        found.append(capsule(np.asarray(best.x), frame))
    return min(found, key=lambda one: _volume(*one))


# ── Distances between moving capsules, and their gradients by the joints

# The nearest points of segments p + s d and q + t e lie on the infinite lines if s and t are within 0 and 1. Otherwise
# one of them is an end point. If the joints move, the distance changes by n · (dp_B - dp_A), with n from A to B and
# both nearest points fixed to their links. Their sliding along the segments changes the distance only in second order.
#
# Source: Ericson, "Real-Time Collision Detection", 2005, 5.1.9.

MARGIN = 0.02
"""Clearance [m] between capsules, and between capsules and the floor."""
_SAMPLES = 200
Pullback = Callable[[Array], Array]
"""Function from weights of the results to the gradient of their weighted sum."""
ALWAYS = 0.95
"""Share of random configurations in contact above which a pair (of capsules, or capsule and floor) counts as always near."""
_STILL = 1e-9
_POINT = 1e-14  # m²: shorter segments count as points
_PARALLEL = 1e-12


def nearest_points(a: Array, b: Array) -> tuple[Array, Array]:
    """Closest points of two segments, as fractions of their lengths."""
    d, e, r = a[1] - a[0], b[1] - b[0], a[0] - b[0]
    dd, ee, de, dr, er = _dot(d, d), _dot(e, e), _dot(d, e), _dot(d, r), _dot(e, r)
    det = dd * ee - de**2
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(det > _PARALLEL * dd * ee, np.clip((de * er - dr * ee) / det, 0.0, 1.0), 0.0)
        t = np.where(ee > _POINT, np.clip((de * s + er) / ee, 0.0, 1.0), 0.0)
        s = np.where(dd > _POINT, np.clip((de * t - dr) / dd, 0.0, 1.0), 0.0)
    return s, t


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@dataclass(frozen=True, eq=False)
class CapsuleDistances:
    """Distances of a robot's capsules from each other and from the floor."""

    robot: Robot
    capsules: LinkCapsules
    pairs: Array  # (m, 2), capsule pairs that are evaluated
    above: Array  # (k,), capsules checked against the floor: those whose height changes
    floor: float | None  # height [m]
    margins: Array  # (m,), required clearance of each pair [m]
    itself: bool  # true if link pairs are evaluated
    unwatched: tuple[str, ...] = ()  # distances left out because the construction keeps them near

    @classmethod
    def from_capsules(
        cls, robot: Robot, capsules: LinkCapsules, *, floor: float | None, itself: bool
    ) -> CapsuleDistances:
        """Select the pairs that can touch: links not connected by a joint and not always near each other.

        Capsules that are always near the floor, on a link with an origin of constant height, are also left out.
        """
        names = robot.link_names
        bodies = np.array([robot.model.frames[names[k]].body for k in capsules.links], int)
        pairs = capsules.separable_pairs(robot) if itself else np.zeros((0, 2), int)
        q, none = robot.random_configuration(0, _SAMPLES), np.zeros(0, int)
        every = cls(robot, capsules, pairs, none, None, none, itself)
        apart = every.evaluate(q)[0]
        near = (apart < MARGIN).mean(axis=0) >= ALWAYS
        built = near if capsules.assumed else (apart <= 0.0).mean(axis=0) >= ALWAYS
        margins = np.where(near, 0.0, MARGIN)[~built]  # pairs near by construction: their true shapes must not touch
        poses = robot.link_poses(q)
        heights = capsules.placed(poses)[:, 2].min(axis=0)
        above = low = none
        if floor is not None:
            moves = np.ptp(heights, axis=0) > _STILL
            fixed = np.ptp(poses[:, capsules.links, 2, 3], axis=0) <= _STILL
            near = (heights - capsules.radii - floor < MARGIN).mean(axis=0) >= ALWAYS
            moving = bodies != BASE
            above, low = np.flatnonzero(moves & ~(fixed & near)), np.flatnonzero(moving & fixed & near)
        over = sorted({(names[capsules.links[a]], names[capsules.links[b]]) for a, b in pairs[built]})
        said = [f"capsules around {a} and {b} are near each other wherever the joints are" for a, b in over]
        if low.size:
            under = ", ".join(dict.fromkeys(names[capsules.links[k]] for k in low))
            said.append(f"the floor is too near {under} wherever the joints are, at a fixed height")
        return cls(robot, capsules, pairs[~built], above, floor, margins, itself, tuple(said))

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
        ends, (i, j), r = self.capsules.placed(self.robot.link_poses(q)), self.pairs.T, self.capsules.radii
        middle, count = 0.5 * (ends[0] + ends[1]), len(self.pairs)
        half = r + 0.5 * np.linalg.norm(self.capsules.ends[:, 1] - self.capsules.ends[:, 0], axis=1)
        d = middle[..., j] - middle[..., i]
        found, at = np.sqrt(_dot(d, d)) - half[i] - half[j], np.full((2, len(q), count), 0.5)
        rows, which = np.nonzero(found < near)
        a, b = ends[:, :, rows, i[which]], ends[:, :, rows, j[which]]
        at[:, rows, which] = s, t = nearest_points(a, b)
        d = b[0] + t * (b[1] - b[0]) - a[0] - s * (a[1] - a[0])
        found[rows, which] = np.sqrt(_dot(d, d)) - r[i[which]] - r[j[which]]
        if self.floor is not None:
            found = np.concatenate([found, *(ends[:, 2][..., self.above] - r[self.above] - self.floor)], axis=1)

        def pullback(weights: Array) -> Array:
            rows, which = np.nonzero(weights[:, :count])
            (a, b), (s, t) = (ends[:, :, rows, k[which]] for k in (i, j)), at[:, rows, which]
            a, b = a[0] + s * (a[1] - a[0]), b[0] + t * (b[1] - b[0])
            n = (b - a) * weights[rows, which] / np.maximum(np.linalg.norm(b - a, axis=0), 1e-12)
            low, end = np.nonzero(weights[:, count:])
            above = np.tile(self.above, 2)[end]
            up = np.outer([0.0, 0.0, 1.0], weights[low, count + end])
            points = np.concatenate([a, b, ends[end // max(len(self.above), 1), :, low, above].T], axis=1)
            forces = np.concatenate([-n, n, up], axis=1)
            links = self.capsules.links[np.concatenate([i[which], j[which], above])]
            return self._joint_forces(q, np.concatenate([rows, rows, low]), links, points, forces)

        return found, pullback

    def _joint_forces(self, q: Array, rows: Array, links: Array, points: Array, forces: Array) -> Array:
        """Σ J' F (n, nv) of forces (3, p) at points (3, p); each force acts on one link in one configuration of q."""
        found = np.zeros((len(q), self.robot.nv))
        wrenches = np.concatenate([np.cross(points, forces, axis=0), forces]).T  # about the base origin
        for link in np.unique(links):
            mine = links == link
            total = np.zeros((len(q), 6))
            np.add.at(total, rows[mine], wrenches[mine])
            J = self.robot.jacobian(q, frame=self.robot.link_names[link], kind="space")
            found += (J * total[:, :, None]).sum(axis=1)
        return found
