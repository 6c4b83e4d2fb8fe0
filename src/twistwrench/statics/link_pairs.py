"""Pairs of links, the search for the nearest, and pairs that an SRDF file disables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ..core import arguments
from ..core.errors import MissingExtraError, RobotFileError, ValueRangeError
from ..core.glossary import complete
from ..core.text import listed, with_clipped_quotations
from ..core.typing import Array
from ..formats.known_elements import READ
from ..formats.source import read_robot_text
from ..formats.xacro import EXPAND, xacro_in
from ..formats.xml import parse
from ..mechanics.bodies.enclosure import Enclosure
from ..robot import Robot
from ..shapes.capsules import ALWAYS, CapsuleDistances, LinkCapsules, link_solids

if TYPE_CHECKING:
    from ..shapes.solids import Solid

Exact = Literal["auto"] | bool
_POSES = 2000
"""Number of random configurations used to find pairs that are always in contact."""
_ROWS = 4096
"""Number of configurations processed at a time."""
_CONTACT = 1e-9  # m: surfaces closer than this are in contact


class LinkShape(NamedTuple):
    """One shape of a link for coal, and what it encloses."""

    geometry: Any
    pose: Array
    """Pose (4, 4) in the frame of the link."""
    walls: Enclosure | None
    """Solid bounded by a mesh; None for a simple shape, which coal treats as solid."""

    @property
    def parts(self) -> list[Array]:
        """Points (n, 3) of each connected part, in the frame of the shape."""
        if self.walls is None:
            return [np.zeros((1, 3))]
        return [shell.triangles.reshape(-1, 3) for shell in self.walls.shells]

    def inside(self, wall: Enclosure, T: Array) -> bool | None:
        """True if a part of this shape, whose pose in the frame of ``wall`` is T, is inside it; None if that is not known."""
        own = np.zeros((1, 3)) if self.walls is None else self.walls.vertices
        if not wall.reaches(own @ T[:3, :3].T + T[:3, 3]).any():
            return False
        return any_of(wall.holds(points @ T[:3, :3].T + T[:3, 3]) for points in self.parts)


def any_of(answers: Iterable[bool | None]) -> bool | None:
    """True if an answer is; otherwise None if one is not known."""
    result: bool | None = False
    for answer in answers:
        if answer:
            return True
        if answer is None:
            result = None
    return result


class Nearest(NamedTuple):
    """Smallest distance found."""

    distance: float
    """[m]."""
    pair: int
    """Index of the pair; -1 if none is nearer than the bound given."""
    hidden: frozenset[int] = frozenset()
    """Pairs of which one link may be inside the other, whose mesh is not closed."""


@dataclass(frozen=True, eq=False)
class LinkPairs:
    """Pairs of links that can touch, with lower bounds of their distances from capsules and the distances from coal."""

    robot: Robot
    capsules: CapsuleDistances
    links: Array  # (p, 2), indices of the links
    starts: Array  # (p,), index of each link pair's first capsule pair; its others follow
    shapes: Sequence[Sequence[LinkShape]] | None  # of each link; None: capsules only
    unknown: tuple[str, ...]
    known: int  # number of links with all their shapes
    undecided: tuple[str, ...] = ()
    touching: tuple[str, ...] = ()

    @classmethod
    def from_robot(cls, robot: Robot, exact: Exact = "auto", srdf: str | Path | None = None) -> LinkPairs:
        """Pairs of links not connected by a joint, disabled in the SRDF file or always in contact."""
        disabled = frozenset[frozenset[str]]()
        if srdf is not None:
            disabled = disabled_pairs(robot, srdf)
        with_coal = _has_coal(exact)
        pairs: LinkPairs = robot.engine.cache(
            ("clearance", disabled, with_coal), lambda: cls._without_contact(robot, disabled, exact=with_coal)
        )
        return pairs

    @classmethod
    def _without_contact(cls, robot: Robot, disabled: frozenset[frozenset[str]], *, exact: bool) -> LinkPairs:
        solids, unknown = link_solids(robot)
        capsules, names = LinkCapsules.from_solids(robot, solids), robot.link_names
        shapes = [_geometries(link) for link in solids] if exact else None
        with_shapes = {name for name, link in zip(names, solids, strict=True) if link}
        pairs = capsules.separable_pairs(robot)
        pairs = pairs[[frozenset((names[a], names[b])) not in disabled for a, b in capsules.links[pairs]]]
        pairs = pairs[np.lexsort(capsules.links[pairs].T[::-1])]  # capsule pairs of the same links are adjacent
        none = np.zeros(0, int)

        def link_pairs(rows: Array) -> LinkPairs:
            links, starts = np.unique(capsules.links[rows], axis=0, return_index=True)
            distances = CapsuleDistances(robot, capsules, rows, none, None, none, itself=True)
            return cls(robot, distances, links, starts, shapes, tuple(unknown), len(with_shapes - {*unknown}))

        all_pairs = link_pairs(pairs)
        if not len(pairs):
            return all_pairs
        always = all_pairs._always_in_contact()
        _, link_pair_of = np.unique(capsules.links[pairs], axis=0, return_inverse=True)
        link_pair_of = link_pair_of.ravel()  # of two axes in NumPy 2.0
        judged = link_pairs(pairs[~always[link_pair_of]])
        left_out = all_pairs.pair_texts(np.flatnonzero(always).tolist())
        if exact:
            return replace(judged, touching=left_out)
        return replace(judged, undecided=left_out)

    def _always_in_contact(self) -> Array:
        """Mask (p,) of pairs in contact (without coal: of capsules) in a share :data:`ALWAYS` of random configurations."""
        q = self.robot.random_configuration(0, _POSES)
        touch = self.bounds(q) <= 0.0
        always = np.asarray(touch.mean(axis=0) >= ALWAYS)
        if self.shapes is None:
            return always
        poses = self.robot.link_poses(q)
        for k in np.flatnonzero(always).tolist():
            apart = 0
            for row in np.flatnonzero(touch[:, k]):
                apart += self.separation(poses[row], k, _CONTACT)[0] > 0.0
                if apart > (1.0 - ALWAYS) * _POSES:
                    always[k] = False
                    break
        return always

    @property
    def names(self) -> Array:
        """(p, 2) names of the links."""
        return np.array(self.robot.link_names)[self.links]

    def pair_texts(self, pairs: Iterable[int]) -> tuple[str, ...]:
        """Texts of some pairs."""
        return tuple(f"{a} – {b}" for a, b in self.names[sorted(pairs)])

    def bounds(self, q: Array) -> Array:
        """Lower bounds (n, p) of the distances [m] in configurations (n, nq)."""
        parts = [self.capsules.evaluate(q[k : k + _ROWS])[0] for k in range(0, len(q), _ROWS)]
        return np.minimum.reduceat(np.concatenate(parts), self.starts, axis=1)

    def distance(self, poses: Array, k: int, bound: float = np.inf) -> float:
        """Distance of pair k by coal [m], from the poses of all links (links, 4, 4), or ``bound`` if that is smaller."""
        import coal

        assert self.shapes is not None
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        result.min_distance = bound  # initial bound of the search in the trees of two meshes

        def placed_shapes(link: int) -> list[tuple[Any, Any]]:
            assert self.shapes is not None
            pairs = []
            for shape, own_pose, _ in self.shapes[link]:
                T = poses[link] @ own_pose
                pairs.append((shape, coal.Transform3s(T[:3, :3], T[:3, 3])))
            return pairs

        first, second = map(placed_shapes, self.links[k])
        for a, T_a in first:
            for b, T_b in second:
                bound = min(bound, coal.distance(a, T_a, b, T_b, request, result))
        return float(bound)

    def encloses(self, poses: Array, k: int) -> bool | None:
        """True if a part of one link of pair k, whose surfaces do not touch, is inside a mesh of the other; None: not known."""
        assert self.shapes is not None
        result: bool | None = False
        for inner, outer in (self.links[k], self.links[k][::-1]):
            for around in self.shapes[outer]:
                if around.walls is None:
                    continue
                into = np.linalg.inv(poses[outer] @ around.pose) @ poses[inner]
                inside = any_of(shape.inside(around.walls, into @ shape.pose) for shape in self.shapes[inner])
                if inside:
                    return True
                if inside is None:
                    result = None
        return result

    def separation(self, poses: Array, k: int, bound: float) -> tuple[float, bool]:
        """Distance of pair k as :meth:`distance`, 0 if one link is inside the other; and True if that is not known."""
        distance = self.distance(poses, k, bound)
        if distance <= 0.0:
            return distance, False
        inside = self.encloses(poses, k)
        if inside:
            return 0.0, False
        return distance, inside is None

    def _least(self, poses: Array, low: Array, bound: float) -> Nearest:
        """Smallest distance in one configuration and its pair, from bounds (p,); ``bound`` and -1 if none is smaller."""
        nearest, hidden = -1, set[int]()
        for k in np.argsort(low, kind="stable").tolist():
            if low[k] >= bound or bound <= 0.0:
                break
            if self.shapes is None:
                distance, unknown = float(low[k]), False
            elif low[k] > 0.0:  # links whose capsules are apart are not inside each other
                distance, unknown = self.distance(poses, k, bound), False
            else:
                distance, unknown = self.separation(poses, k, bound)
            if unknown:
                hidden.add(k)
            if distance < bound:
                bound, nearest = max(distance, 0.0), k
        return Nearest(bound, nearest, frozenset(hidden))

    def nearest(self, q: Array) -> list[Nearest]:
        """Smallest distance in each of the configurations (n, nq)."""
        if not len(self.links):
            return [Nearest(np.inf, 0)] * len(q)
        if not len(q):
            return []
        return [self._least(T, low, np.inf) for T, low in zip(self.robot.link_poses(q), self.bounds(q), strict=True)]

    def nearest_row(self, q: Array, bound: float) -> tuple[Nearest, int]:
        """Smallest distance over all configurations, and its row (the first in contact); -1 if above ``bound``."""
        row, nearest = -1, Nearest(bound, -1)
        if not len(self.links) or not len(q):
            return nearest, row
        poses, low = self.robot.link_poses(q), self.bounds(q)
        row_bounds = low.min(axis=1)
        for k in np.argsort(row_bounds, kind="stable").tolist():
            if row_bounds[k] >= nearest.distance or nearest.distance <= 0.0:
                break
            candidate = self._least(poses[k], low[k], nearest.distance)
            hidden = nearest.hidden | candidate.hidden
            if candidate.pair >= 0:
                row, nearest = k, candidate
            nearest = nearest._replace(hidden=hidden)
        if nearest.distance > 0.0:
            return nearest, row
        for k in np.flatnonzero(row_bounds[: row + 1] <= 0.0).tolist():  # the first row in contact
            contact = self._least(poses[k], low[k], _CONTACT)
            if contact.pair >= 0:
                return nearest._replace(pair=contact.pair), k
        return nearest, row


def _has_coal(exact: Exact) -> bool:
    """True if coal is to be used; raises MissingExtraError if it is required but not installed."""
    if exact is not True and exact is not False and exact != "auto":
        raise ValueRangeError(f"exact is {arguments.value_text(exact)}: give True, False or 'auto'.")
    try:
        import coal  # noqa: F401
    except ImportError:
        if exact is True:
            raise MissingExtraError.from_extra("coal", "clearance", "Exact clearance") from None
        return False
    return exact is not False


def _geometries(solids: Sequence[Solid]) -> list[LinkShape]:
    """Shapes of a link for coal; meshes as triangles."""
    import coal

    constructors = {"box": coal.Box, "sphere": coal.Sphere, "cylinder": coal.Cylinder, "capsule": coal.Capsule}
    shapes = list[LinkShape]()
    for solid in solids:
        description, surface, walls = solid.shape, solid.surface, None
        if surface is not None:
            points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
            vertices = surface.vertices * np.asarray(description.sizes)
            walls = Enclosure(vertices, surface.faces)
            points.extend(list(vertices))
            triangles.extend([coal.Triangle(*corners) for corners in surface.faces.tolist()])
            shape = coal.BVHModelOBBRSS()
            shape.beginModel(len(triangles), len(points))
            shape.addSubModel(points, triangles)
            shape.endModel()
        else:
            shape = constructors.get(description.kind, coal.Ellipsoid)(*description.sizes)
        shapes.append(LinkShape(shape, description.pose, walls))
    return shapes


# ── Pairs disabled by an SRDF file

_SRDF = {"robot": {"<disable_collisions>": READ}, "disable_collisions": {"link1": READ, "link2": READ}}
"""Elements and attributes of SRDF that are read."""


def disabled_pairs(robot: Robot, srdf: str | Path) -> frozenset[frozenset[str]]:
    """Link pairs of ``<disable_collisions>`` in an SRDF file, given as a path or as its text.

    Pairs with a link that the robot does not have are ignored. Raises NotFoundError, and RobotFileError if the file is
    not SRDF or has no pair of links of this robot.
    """
    text, name = read_robot_text(srdf)
    try:
        root = parse(text)
        xacro = xacro_in(text, root, _SRDF)
        pairs: list[tuple[str, str]] = []
        if not xacro:
            pairs += [(e.text("link1"), e.text("link2")) for e in root.all("disable_collisions")]
    except RobotFileError as error:
        raise RobotFileError(f"{name}: {with_clipped_quotations(str(error))}") from None
    if xacro:
        raise RobotFileError(f"{name}: {xacro}. Expand it first: {EXPAND.replace('robot.urdf', 'robot.srdf')}.")
    if root.tag != "robot" or not pairs:
        raise RobotFileError(
            f"{name}: <{root.tag}> has no <disable_collisions link1=… link2=…>. Give an SRDF file that leaves out pairs."
        )
    own_pairs = frozenset(frozenset(pair) for pair in pairs if {*pair} <= {*robot.link_names})
    if not own_pairs:
        raise RobotFileError(
            f"{name}: none of its {len(pairs)} pairs are links of robot {robot.name!r}; the first is {' – '.join(pairs[0])}. "
            f"Links of the robot: {listed(robot.link_names)}. Is the file of another robot?"
        )
    return own_pairs


complete(globals())
