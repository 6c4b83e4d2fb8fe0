"""Capsules around the links of a robot: what keeps an exciting motion clear of the floor and of the robot itself.

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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..diagnosis.reading import read_subject
from ..diagnosis.shapes import LinkShapes, Solid
from ..model.model import BASE
from ..robot import Robot
from ..typing import Array

_WORTH = 0.6
"""Share of the volume of capsules around single shapes, which overlap, up to which one around all takes their place."""
_FACETS = 0.015
"""Share of a radius that facets are within the round, 0.012 at most."""
_STEPS = 200
"""Of the search for the least volume."""
_THICK, _THICKEST = 0.25, 0.08
"""Radius assumed: share of the longest distance between joints, and the most [m]."""
_BESIDE = 0.5
"""Share of it from the joint at which a link begins."""
_SAME = 1e-6
"""m: two origins are one."""


@dataclass(frozen=True, eq=False)
class LinkCapsules:
    """Capsules around the links of a robot, in the frames of the links.

    Attributes
    ----------
    links : (k,) array, the number of each one's link
    ends : (k, 2, 3) array [m]
    radii : (k,) array [m]
    assumed : tuple of str, moving links that have mass and a shape that is missing or could not be read
    thickness : float, radius of their assumed capsules [m]

    A frame without mass and shape has a capsule of radius 0 at its origin.
    """

    links: Array
    ends: Array
    radii: Array
    assumed: tuple[str, ...] = ()
    thickness: float = 0.0

    @classmethod
    def of(cls, robot: Robot) -> LinkCapsules:
        """Capsules around the shapes that the robot's file gives its links: those for contact, else those to be seen.

        Bodies of which a link with mass has none have assumed ones.

        Parameters
        ----------
        robot : Robot

        Returns
        -------
        capsules : LinkCapsules

        Examples
        --------
        >>> import twistwrench as tw
        >>> found = LinkCapsules.of(tw.robots.planar_2r())
        >>> float(found.radii.max()), found.assumed
        (0.08, ('link1', 'link2'))
        """
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
        """Ends of the capsules.

        Parameters
        ----------
        poses : (n, nlinks, 4, 4) array, as ``robot.link_poses`` gives them

        Returns
        -------
        ends : (2, 3, n, k) array, in the base frame [m]

        Examples
        --------
        >>> one = LinkCapsules(np.array([0]), np.array([[[0, 0, 0], [0, 0, 1.0]]]), np.array([0.1]))
        >>> one.placed(np.eye(4)[None, None]).ravel().tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
        """
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
    """How far a round shape reaches beyond the facets between its corners [m]."""
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
    """The least capsule that a short search finds around points.

    Parameters
    ----------
    points : (n, 3) array [m]

    Returns
    -------
    ends : (2, 3) array, of its segment [m]
    radius : float [m]

    Examples
    --------
    >>> ends, radius = capsule_around(np.array([[0, 0, 0], [0, 0, 1.0]]))
    >>> round(float(np.linalg.norm(ends[1] - ends[0]) + 2 * radius), 9)
    1.0
    """
    from scipy.optimize import minimize

    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=True)[2]
    size = float(np.ptp(points @ axes.T, axis=0).max()) or 1.0

    def of(x: Array, frame: Array) -> tuple[Array, float]:
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
            return _volume(*of(x, frame))

        best = minimize(volume, np.zeros(4), method="Nelder-Mead", options={"maxiter": _STEPS})
        found.append(of(np.asarray(best.x), frame))
    return min(found, key=lambda one: _volume(*one))
