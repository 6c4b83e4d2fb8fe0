"""Constraints of an exciting motion: limits, the floor, and clearances of capsules around the links.

A capsule holds all points that are within r of a segment from a to b. Around given points, with the axis u through c, ρ_i their
distances from the axis and t_i their places along it,

    r = max ρ_i,      a = min (t_i + sqrt(r² - ρ_i²)),      b = max (t_i - sqrt(r² - ρ_i²)),

u and c such that the volume π r² (b - a) + 4/3 π r³ is least.

Where the robot's file gives no shapes, capsules are assumed between the origins of neighbouring joints and of links fixed to
them. Their radius is a quarter of the longest distance between two of these, at most 0.08 m. They begin half a radius beyond
the joint that moves them, where the link before has its end. A sphere of that radius is around each centre of mass.

Source: Ericson, "Real-Time Collision Detection", 2005, 4.5, for the capsules of points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..diagnosis.parsed_file import read_subject
from ..diagnosis.shapes import LinkShapes, Solid
from ..errors import ShapeError, ValueRangeError
from ..model.model import BASE
from ..motion.bounds import Bounds
from ..robot import Robot
from ..typing import Array

_WORTH = 0.6
"""Share of the volume of capsules around single shapes, which overlap, up to which one around all takes their place."""
_FACETS = 0.015  # share of a radius that facets are within the round, 0.012 at most
_STEPS = 200  # steps of the search for the least volume
_THICK, _THICKEST = 0.25, 0.08  # radius assumed: share of the longest distance between joints, and the most [m]
_BESIDE = 0.5  # share of it from the joint at which a link begins
_SAME = 1e-6  # m: two origins are one


@dataclass(frozen=True, eq=False)
class LinkCapsules:
    """Capsules around a robot's links, in the links' frames; of radius 0 at the origin of a frame without mass and shape."""

    links: Array  # (k,), the number of each one's link
    ends: Array  # (k, 2, 3) [m]
    radii: Array  # (k,) [m]
    # moving links that have mass and a shape that is missing or could not be read
    assumed: tuple[str, ...] = ()
    thickness: float = 0.0  # radius of their assumed capsules [m]

    @classmethod
    def from_robot(cls, robot: Robot) -> LinkCapsules:
        """Capsules around the file's shapes, for contact, else to be seen; assumed ones of bodies with a link that has none."""
        described = read_subject(robot).robot
        names, frames = robot.link_names, robot.model.frames
        found, lacking = list[tuple[int, Array, float]](), list[str]()
        seen = set[int]()
        for k, name in enumerate(names):
            link = described.links.get(name)
            shapes = LinkShapes() if link is None else link.shapes
            mine = _of_solids(_looked_at(shapes))
            heavy = link is None or (link.written is not None and link.written.mass > 0)
            if heavy and not (mine and shapes.complete):
                lacking.append(name)
            if mine:
                seen.add(frames[name].body)
            found += [(k, segment, radius) for segment, radius in mine or [(np.zeros((2, 3)), 0.0)]]
        bodies = {frames[name].body for name in lacking if frames[name].body != BASE}
        if bodies and BASE not in seen:
            bodies.add(BASE)
        made = _assumed(robot, bodies) if bodies else []
        links, ends, radii = zip(*found, *made, strict=True)
        moving = tuple(name for name in lacking if frames[name].body != BASE)
        return cls(
            np.array(links, int),
            np.reshape(ends, (-1, 2, 3)),
            np.array(radii, float),
            moving,
            made[0][2] if made else 0.0,
        )

    def placed(self, poses: Array) -> Array:
        """Ends of the capsules."""
        n, count = poses.shape[:2]
        rows = np.moveaxis(poses[:, :, :3, :], 2, 0).reshape(3 * n, 4 * count)
        placed = (rows @ self._columns(count)).reshape(3, n, 2, len(self.links))
        return np.moveaxis(placed, 2, 0)

    def _columns(self, count: int) -> Array:
        """(4 count, 2 k) homogeneous coordinates of all ends, each in the rows of its link, the others zero."""
        if "columns" not in self.__dict__:
            k = len(self.links)
            found = np.zeros((count, 4, 2, k))
            found[self.links, :3, :, np.arange(k)] = np.swapaxes(self.ends, 1, 2)
            found[self.links, 3, :, np.arange(k)] = 1.0
            self.__dict__["columns"] = found.reshape(4 * count, 2 * k)
        return np.asarray(self.__dict__["columns"])


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
            places.append(2.0 * np.asarray(model.bodies[body].inertia.com))  # a rod of its own
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


def _looked_at(shapes: LinkShapes) -> list[Solid]:
    for role in ("collision", "visual"):
        mine = [s for s in shapes.solids if s.spec.role == role]
        if mine:
            return mine
    return []


def _of_solids(solids: Sequence[Solid]) -> list[tuple[Array, float]]:
    """A capsule around each shape, or one around all of them where it is hardly larger than what they hold."""
    each = [_around(solid) for solid in solids]
    if len(each) < 2:
        return each
    ends, radius = capsule_around(np.concatenate([solid.points for solid in solids]))
    whole = ends, radius + max(_bulge(solid) for solid in solids)
    return [whole] if _volume(*whole) <= _WORTH * sum(_volume(*one) for one in each) else each


def _bulge(solid: Solid) -> float:
    """Distance that a round shape reaches beyond the facets between its corners [m]."""
    return 0.0 if solid.spec.kind in ("box", "mesh") else _FACETS * max(solid.spec.sizes)


def _around(solid: Solid) -> tuple[Array, float]:
    """Segment (2, 3) and radius of a capsule that holds a shape."""
    spec = solid.spec
    if spec.kind in ("sphere", "capsule"):
        half = 0.5 * spec.sizes[1] if spec.kind == "capsule" else 0.0
        along = spec.pose[:3, 2] * half
        return spec.pose[:3, 3] + np.array([-along, along]), spec.sizes[0]
    ends, radius = capsule_around(solid.points)
    return ends, radius + _bulge(solid)


def _volume(ends: Array, r: float) -> float:
    return float(np.pi * r**2 * (np.linalg.norm(ends[1] - ends[0]) + 4.0 / 3.0 * r))


def capsule_around(points: Array) -> tuple[Array, float]:
    """The least capsule that a short search finds around points."""
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
    for k in range(3):
        frame = np.roll(axes, -k, axis=0)

        def volume(x: Array, frame: Array = frame) -> float:
            return _volume(*capsule(x, frame))

        best = minimize(volume, np.zeros(4), method="Nelder-Mead", options={"maxiter": _STEPS})
        found.append(capsule(np.asarray(best.x), frame))
    return min(found, key=lambda one: _volume(*one))


# ── Distances between moving capsules, and their gradients by the joints

# Of segments p + s d and q + t e, s and t from 0 to 1, the nearest points are those of the lines where these are within,
# else one
# of them is an end. What is left when the joints move is n · (dp_B - dp_A), with n from A to B and the nearest points fixed to
# their links: nearest points slide along the segments, and that changes the distance in second order only.
#
# Source: Ericson, "Real-Time Collision Detection", 2005, 5.1.9.

MARGIN = 0.02
"""m: what capsules stay away from each other and from the floor."""
_SAMPLES = 200
_ALWAYS = 0.95
"""Share of random configurations from which on a pair of capsules, or one and the floor, is near by how the robot is built."""
_STILL = 1e-9
_POINT = 1e-14  # m²: segments that are points
_PARALLEL = 1e-12


def nearest_points(a: Array, b: Array) -> tuple[Array, Array]:
    """Closest points of segments, as shares of their lengths."""
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


def _between(a: Array, b: Array, s: Array, t: Array) -> Array:
    """From the points at s of segments a to those at t of b, (3, ...)."""
    return np.asarray(b[0] + t * (b[1] - b[0]) - a[0] - s * (a[1] - a[0]))


@dataclass(frozen=True, eq=False)
class CapsuleDistances:
    """Distances of a robot's capsules from each other and from the floor."""

    robot: Robot
    capsules: LinkCapsules
    pairs: Array  # (m, 2), capsules that are looked at together
    above: Array  # (k,), capsules that are looked at together with the floor: those whose heights change
    floor: float | None  # height [m]
    # links whose capsules are too near by how the robot is built, and that are not looked at
    overlapping: tuple[tuple[str, str], ...] = ()
    itself: bool = True  # true if links are looked at together
    # links fixed at a height that are not looked at, as the floor is too near wherever the joints are
    low: tuple[str, ...] = ()
    margins: Array = field(default_factory=lambda: np.zeros(0))  # (m,), what pairs stay away from each other [m]

    @classmethod
    def from_capsules(
        cls, robot: Robot, capsules: LinkCapsules, *, floor: float | None, itself: bool
    ) -> CapsuleDistances:
        """The pairs that can touch: of links that no joint connects, and that are not always near each other.

        The capsules of a link whose origin stays at one height, and that are always near the floor, are left out too.
        """
        names = robot.link_names
        bodies = np.array([robot.model.frames[names[k]].body for k in capsules.links], int)
        parents = np.array([BASE if b == BASE else robot.model.bodies[b].parent for b in bodies], int)
        i, j = np.triu_indices(len(bodies), 1) if itself else (np.zeros(0, int), np.zeros(0, int))
        apart = (bodies[i] != bodies[j]) & (parents[i] != bodies[j]) & (parents[j] != bodies[i])
        apart &= (capsules.radii[i] > 0) & (capsules.radii[j] > 0)
        pairs = np.stack([i, j], axis=1)[apart]
        q = robot.random_configuration(0, _SAMPLES)
        every = cls(robot, capsules, pairs, np.zeros(0, int), None)
        apart = every.distances(q)
        near = (apart < MARGIN).mean(axis=0) >= _ALWAYS
        built = near if capsules.assumed else (apart <= 0.0).mean(axis=0) >= _ALWAYS
        margins = np.where(near, 0.0, MARGIN)[~built]  # true shapes that are near by design must not touch
        poses = robot.link_poses(q)
        heights = capsules.placed(poses)[:, 2].min(axis=0)
        above, low = np.zeros(0, int), np.zeros(0, int)
        if floor is not None:
            moves = np.ptp(heights, axis=0) > _STILL
            fixed = np.ptp(poses[:, capsules.links, 2, 3], axis=0) <= _STILL
            near = (heights - capsules.radii - floor < MARGIN).mean(axis=0) >= _ALWAYS
            moving = bodies != BASE
            above, low = np.flatnonzero(moves & ~(fixed & near)), np.flatnonzero(moving & fixed & near)
        over = sorted({(names[capsules.links[a]], names[capsules.links[b]]) for a, b in pairs[built]})
        under = tuple(dict.fromkeys(names[capsules.links[k]] for k in low))
        return cls(robot, capsules, pairs[~built], above, floor, tuple(over), itself, under, margins)

    @property
    def unwatched(self) -> tuple[str, ...]:
        """Distances that are not checked, in sentences."""
        found = [
            f"capsules around {a} and {b} are near each other wherever the joints are" for a, b in self.overlapping
        ]
        if self.low:
            found.append(f"the floor is too near {', '.join(self.low)} wherever the joints are, at a fixed height")
        return tuple(found)

    @property
    def count(self) -> int:
        """Number of distances: m + 2 k."""
        return len(self.pairs) + 2 * len(self.above)

    def distances(self, q: Array, near: float = np.inf) -> Array:
        """(n, m + 2 k) distances of the pairs, and of the ends above the floor [m]; below 0 where capsules overlap."""
        ends = self.capsules.placed(self.robot.link_poses(q))
        i, j = self.pairs.T
        middle, r = 0.5 * (ends[0] + ends[1]), self.capsules.radii
        half = r + 0.5 * np.linalg.norm(self.capsules.ends[:, 1] - self.capsules.ends[:, 0], axis=1)
        d = middle[..., j] - middle[..., i]
        found = np.sqrt(_dot(d, d)) - half[i] - half[j]
        rows, which = np.nonzero(found < near)
        a, b = ends[:, :, rows, i[which]], ends[:, :, rows, j[which]]
        d = _between(a, b, *nearest_points(a, b))
        found[rows, which] = np.sqrt(_dot(d, d)) - r[i[which]] - r[j[which]]
        if self.floor is None:
            return np.asarray(found)
        heights = ends[:, 2][..., self.above] - r[self.above] - self.floor
        return np.concatenate([found, *heights], axis=1)

    def slopes(self, q: Array, weights: Array) -> Array:
        """Derivative by the joints of a weighted sum of the distances."""
        found = np.zeros(q.shape)
        rows = np.flatnonzero(weights.any(axis=1))
        if not rows.size:
            return found
        q, weights = q[rows], weights[rows]
        m, k = len(self.pairs), len(self.above)
        used = np.flatnonzero(weights[:, :m].any(axis=0))
        i, j = self.pairs[used].T
        ends = self.capsules.placed(self.robot.link_poses(q))
        a, b = ends[..., i], ends[..., j]
        s, t = nearest_points(a, b)
        n = _between(a, b, s, t)
        n *= weights[:, used] / np.maximum(np.sqrt(_dot(n, n)), 1e-12)
        along_z = np.zeros((2, 3, len(q), k))
        along_z[0, 2], along_z[1, 2] = weights[:, m : m + k], weights[:, m + k :]
        points = np.concatenate([a[0] + s * (a[1] - a[0]), b[0] + t * (b[1] - b[0]), *ends[..., self.above]], axis=2)
        forces = np.concatenate([-n, n, *along_z], axis=2)
        wrenches = np.concatenate([np.cross(points, forces, axis=0), forces])  # about the base's origin, (6, n, points)
        links = self.capsules.links[np.concatenate([i, j, self.above, self.above])]
        for link in np.unique(links):
            total = wrenches[:, :, links == link].sum(axis=2)
            J = self.robot.jacobian(q, frame=self.robot.link_names[link], kind="space")
            found[rows] += np.einsum("niv,in->nv", J, total)
        return found


# ── Limits: each is a band, low ≤ x ≤ high, with a size that makes the distance s from its edge a share

Clear = Callable[[Array], Array]
"""Distances (n, ...) [m] of configurations (n, nq), below 0 where something touches."""
_NEAR = 0.1  # m: the size of a clearance
DENSE = 0.01
"""s: the longest step at which clearances are looked at in the end."""
_DISPLACED = 1e-5  # displacement of configurations for slopes of the user's distances


@dataclass(frozen=True, eq=False)
class Band:
    """Band low ≤ x ≤ high, (m,) each; inf where nothing is limited."""

    low: Array
    high: Array
    size: Array

    @cached_property
    def edges(self) -> tuple[tuple[float, Array, Array], ...]:
        """Sign, places (k,) and limits (k,) of the edges above and below."""
        return tuple(
            (sign, np.flatnonzero(np.isfinite(limit)), limit[np.isfinite(limit)])
            for sign, limit in ((1.0, self.high), (-1.0, self.low))
        )

    def shares(self, x: Array) -> Array:
        """(n, k) distances of x (n, m) from all edges, as shares; below 0 beyond them."""
        return np.concatenate(
            [sign * (limit - x[:, limited]) / self.size[limited] for sign, limited, limit in self.edges], axis=1
        )

    def least(self, x: Array) -> float:
        """The least distance from an edge, as a share; below 0 beyond it."""
        return float(self.shares(x).min(initial=np.inf))

    def slope(self, forces: Array) -> Array:
        """(n, m) derivative by x of the sum of forces (n, k) times shares."""
        found, done = np.zeros((len(forces), len(self.size))), 0
        for sign, limited, _ in self.edges:
            found[:, limited] -= sign * forces[:, done : done + len(limited)] / self.size[limited]
            done += len(limited)
        return found


@dataclass(frozen=True, eq=False)
class TrajectoryConstraints:
    """Constraints on the motions of one robot."""

    robot: Robot  # whose own friction counts among the torques
    bounds: Bounds  # those to keep
    friction_speed: Array  # (nv,), speed at which dry friction turns, for what has to be smooth
    capsules: CapsuleDistances  # of the floor and the robot itself
    clear: Clear | None = None

    @cached_property
    def bands(self) -> tuple[Band, Band, Band, Band, Band]:
        """Bands of positions, velocities, accelerations, torques and clearances."""
        b = self.bounds
        half = (b.upper - b.lower) / 2.0
        count = self.clearances(self.robot.neutral[None]).shape[1]
        margins = np.where(np.arange(count) < self.capsules.count, MARGIN, 0.0)  # the user's distances may come to 0
        margins[: len(self.capsules.margins)] = self.capsules.margins
        return (
            Band(b.lower, b.upper, np.where(np.isfinite(half), half, 1.0)),
            _both_ways(b.velocity),
            _both_ways(b.acceleration),
            _both_ways(b.effort),
            Band(margins, np.full(count, np.inf), np.full(count, _NEAR)),
        )

    def clearances(self, q: Array) -> Array:
        """(n, m) distances [m]: those of the capsules, and those of ``clear``."""
        return np.concatenate([self.capsules.distances(q, MARGIN + _NEAR), self._user_clearances(q)], axis=1)

    def clearance_slopes(self, q: Array, weights: Array) -> Array:
        """(n, nq) derivative by the joints of a sum of the clearances with weights (n, m)."""
        own = self.capsules.count
        found = self.capsules.slopes(q, weights[:, :own])
        if self.clear is not None and weights[:, own:].any():
            for k, step in enumerate(_DISPLACED * np.eye(q.shape[1])):
                moved = (self._user_clearances(q + step) - self._user_clearances(q - step)) / (2.0 * _DISPLACED)
                found[:, k] += (moved * weights[:, own:]).sum(axis=1)
        return found

    def _user_clearances(self, q: Array) -> Array:
        if self.clear is None:
            return np.zeros((len(q), 0))
        try:
            found = np.asarray(self.clear(q), float)
        except (TypeError, ValueError) as problem:
            raise ValueRangeError(f"clear could not be asked for {len(q)} configurations: {problem}") from None
        if found.ndim < 1 or len(found) != len(q) or not np.isfinite(found).all():
            raise ShapeError(
                f"clear gave an array of shape {found.shape} for {len(q)} configurations: give a distance [m] for each, "
                "finite, below 0 where something touches."
            )
        return found.reshape(len(q), -1)

    def smooth_torques(self, q: Array, dq: Array, ddq: Array) -> Array:
        """(n, nv) torques, dry friction turning smoothly and at its largest."""
        f = self.robot.model.friction
        rigid = np.asarray(self.robot.inverse_dynamics(q, dq, ddq))
        dry = (f.static + f.load * np.abs(rigid)) * np.tanh(dq / self.friction_speed)
        return np.asarray(rigid + f.viscous * dq + dry)

    def least(self, q: Array, dq: Array, ddq: Array) -> float:
        """The least distance from any edge, as a share of its size; below 0 beyond one. Friction as the robot's file has it."""
        found = min(band.least(x) for band, x in zip(self.bands, (q, dq, ddq), strict=False))
        if found < 0.0:
            return found
        tau = np.asarray(self.robot.inverse_dynamics(q, dq, ddq, friction=True))
        return min(found, self.bands[3].least(tau), self.bands[4].least(self.clearances(q)))


def _both_ways(limit: Array) -> Band:
    return Band(-limit, limit, np.where(np.isfinite(limit), limit, 1.0))


def half_and_middle(bounds: Bounds) -> tuple[Array, Array]:
    """Half the way between the limits of positions, inf where one is missing, and the middle, meant where both are there."""
    with np.errstate(invalid="ignore"):
        return (bounds.upper - bounds.lower) / 2.0, (bounds.upper + bounds.lower) / 2.0


def shared_bounds(bounds: Bounds, share: float) -> Bounds:
    """A share of the limits of positions, about their middle, of velocities and of torques; accelerations as they are."""
    half, middle = half_and_middle(bounds)
    both = np.isfinite(half)
    with np.errstate(invalid="ignore"):
        lower = np.where(both, middle - share * half, bounds.lower)
        upper = np.where(both, middle + share * half, bounds.upper)
    return replace(bounds, lower=lower, upper=upper, velocity=share * bounds.velocity, effort=share * bounds.effort)
