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
"""True: distances by coal; False: by capsules; "auto": by coal if it is installed."""
_RANDOM_CONFIGURATIONS = 2000
"""Number of random configurations used to find pairs that are always in contact."""
_ROWS_PER_BATCH = 4096
"""Number of configurations processed at a time."""
_CONTACT_DISTANCE = 1e-9
"""Distance below which surfaces are in contact [m]."""


class LinkShape(NamedTuple):
    """One shape of a link for coal, and what it encloses."""

    geometry: Any
    """Object of coal."""
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
        """True if a part of this shape is inside ``wall``, in whose frame the shape has the pose T; None: not known."""
        R, p = T[:3, :3], T[:3, 3]
        vertices = np.zeros((1, 3)) if self.walls is None else self.walls.vertices
        if not wall.reaches(vertices @ R.T + p).any():
            return False
        return any_of(wall.holds(points @ R.T + p) for points in self.parts)


def any_of(answers: Iterable[bool | None]) -> bool | None:
    """True if one of the answers is True; otherwise None if one of them is None, which means not known."""
    result: bool | None = False
    for answer in answers:
        if answer:
            return True
        if answer is None:
            result = None
    return result


class Nearest(NamedTuple):
    """Smallest distance found, and its pair."""

    distance: float
    """Distance [m]."""
    pair: int
    """Index of the pair; -1 if none is nearer than the bound of the search."""
    hidden: frozenset[int] = frozenset()
    """Indices of pairs of which one link may be inside the other, whose mesh is not closed."""


@dataclass(frozen=True, eq=False)
class LinkPairs:
    """Pairs of links that can touch: lower bounds of their distances by capsules, and their distances by coal."""

    robot: Robot
    capsules: CapsuleDistances
    links: Array
    """(p, 2) indices of the links."""
    starts: Array
    """(p,) index of the first capsule pair of each link pair; the other capsule pairs of these links follow."""
    shapes: Sequence[Sequence[LinkShape]] | None
    """Shapes of each link; None: capsules only."""
    unknown: tuple[str, ...]
    """Names of links with mass and a missing or unreadable shape."""
    known: int
    """Number of links with all their shapes."""
    undecided: tuple[str, ...] = ()
    """Pairs left out because their capsules always overlap."""
    touching: tuple[str, ...] = ()
    """Pairs left out because they are nearly always in contact."""

    @classmethod
    def from_robot(cls, robot: Robot, exact: Exact = "auto", srdf: str | Path | None = None) -> LinkPairs:
        """Pairs of links not connected by a joint, disabled in the SRDF file or always in contact."""
        disabled_links: frozenset[frozenset[str]] = frozenset()
        if srdf is not None:
            disabled_links = disabled_pairs(robot, srdf)
        with_coal = _has_coal(exact)
        key = ("clearance", disabled_links, with_coal)
        pairs: LinkPairs = robot.engine.cache(key, lambda: cls._without_contact(robot, disabled_links, exact=with_coal))
        return pairs

    @classmethod
    def _without_contact(cls, robot: Robot, disabled_links: frozenset[frozenset[str]], *, exact: bool) -> LinkPairs:
        """Pairs of links that are not disabled, without those that are always in contact."""
        solids, unknown = link_solids(robot)
        capsules = LinkCapsules.from_solids(robot, solids)
        names = robot.link_names
        shapes = [_geometries(link) for link in solids] if exact else None
        with_shapes = {name for name, link in zip(names, solids, strict=True) if link}
        capsule_pairs = capsules.separable_pairs(robot)
        is_enabled = [frozenset((names[a], names[b])) not in disabled_links for a, b in capsules.links[capsule_pairs]]
        capsule_pairs = capsule_pairs[is_enabled]
        # Capsule pairs of the same links become adjacent. ``lexsort`` takes the most significant key last.
        first_links, second_links = capsules.links[capsule_pairs].T
        order = np.lexsort((second_links, first_links))
        capsule_pairs = capsule_pairs[order]
        none_above_floor = np.zeros(0, int)
        no_margins = np.zeros(0, int)
        known_count = len(with_shapes - {*unknown})

        def link_pairs(selected_pairs: Array) -> LinkPairs:
            """Link pairs of some capsule pairs."""
            links, starts = np.unique(capsules.links[selected_pairs], axis=0, return_index=True)
            distances = CapsuleDistances(
                robot, capsules, selected_pairs, none_above_floor, floor=None, margins=no_margins, itself=True
            )
            return cls(robot, distances, links, starts, shapes, tuple(unknown), known_count)

        all_pairs = link_pairs(capsule_pairs)
        if not len(capsule_pairs):
            return all_pairs
        always_touch = all_pairs._always_in_contact()
        _, link_pair_of = np.unique(capsules.links[capsule_pairs], axis=0, return_inverse=True)
        link_pair_of = link_pair_of.ravel()  # of two axes in NumPy 2.0
        remaining_pairs = link_pairs(capsule_pairs[~always_touch[link_pair_of]])
        left_out_texts = all_pairs.pair_texts(np.flatnonzero(always_touch).tolist())
        if exact:
            return replace(remaining_pairs, touching=left_out_texts)
        return replace(remaining_pairs, undecided=left_out_texts)

    def _always_in_contact(self) -> Array:
        """True for pairs (p,) in contact in a share :data:`ALWAYS` of random configurations; by capsules without coal."""
        q = self.robot.random_configuration(0, _RANDOM_CONFIGURATIONS)
        capsules_touch = self.bounds(q) <= 0.0
        always_touch = np.asarray(capsules_touch.mean(axis=0) >= ALWAYS)
        if self.shapes is None:
            return always_touch
        poses = self.robot.link_poses(q)
        max_apart = (1.0 - ALWAYS) * _RANDOM_CONFIGURATIONS
        for k in np.flatnonzero(always_touch).tolist():
            apart_count = 0
            for row in np.flatnonzero(capsules_touch[:, k]):
                distance, _ = self.separation(poses[row], k, _CONTACT_DISTANCE)
                apart_count += distance > 0.0
                if apart_count > max_apart:
                    always_touch[k] = False
                    break
        return always_touch

    @property
    def names(self) -> Array:
        """(p, 2) names of the links."""
        return np.array(self.robot.link_names)[self.links]

    def pair_texts(self, pairs: Iterable[int]) -> tuple[str, ...]:
        """Texts of some pairs, given by their indices."""
        return tuple(f"{first} – {second}" for first, second in self.names[sorted(pairs)])

    def bounds(self, q: Array) -> Array:
        """Lower bounds (n, p) of the distances [m] in configurations (n, nq)."""
        batches: list[Array] = []  # distances of the capsule pairs
        for k in range(0, len(q), _ROWS_PER_BATCH):
            distances, *_ = self.capsules.evaluate(q[k : k + _ROWS_PER_BATCH])
            batches.append(distances)
        return np.minimum.reduceat(np.concatenate(batches), self.starts, axis=1)

    def distance(self, poses: Array, k: int, bound: float = np.inf) -> float:
        """Distance of pair k by coal [m], from the poses of all links (links, 4, 4), or ``bound`` if that is smaller."""
        import coal

        assert self.shapes is not None
        request = coal.DistanceRequest()
        result = coal.DistanceResult()
        result.min_distance = bound  # initial bound of the search in the trees of two meshes

        def placed_shapes(link: int) -> list[tuple[Any, Any]]:
            """Geometry and pose of each shape of a link."""
            assert self.shapes is not None
            geometries_with_poses = []
            for shape in self.shapes[link]:
                T = poses[link] @ shape.pose
                geometries_with_poses.append((shape.geometry, coal.Transform3s(T[:3, :3], T[:3, 3])))
            return geometries_with_poses

        first_shapes, second_shapes = map(placed_shapes, self.links[k])
        for a, T_a in first_shapes:
            for b, T_b in second_shapes:
                bound = min(bound, coal.distance(a, T_a, b, T_b, request, result))
        return float(bound)

    def encloses(self, poses: Array, k: int) -> bool | None:
        """True if a part of one link of pair k is inside a mesh of the other; None: not known. Surfaces must not touch."""
        assert self.shapes is not None
        answers = []
        for inner, outer in (self.links[k], self.links[k][::-1]):
            for mesh in self.shapes[outer]:
                if mesh.walls is None:
                    continue
                T_mesh_inner = np.linalg.inv(poses[outer] @ mesh.pose) @ poses[inner]
                is_inside = any_of(shape.inside(mesh.walls, T_mesh_inner @ shape.pose) for shape in self.shapes[inner])
                if is_inside:
                    return True
                answers.append(is_inside)
        return any_of(answers)

    def separation(self, poses: Array, k: int, bound: float) -> tuple[float, bool]:
        """Distance of pair k as :meth:`distance`, but 0 if one link is inside the other; and True if that is not known."""
        distance = self.distance(poses, k, bound)
        if distance <= 0.0:
            return distance, False
        is_inside = self.encloses(poses, k)
        if is_inside:
            return 0.0, False
        return distance, is_inside is None

    def _nearest_pair(self, poses: Array, lower_bounds: Array, bound: float) -> Nearest:
        """Smallest distance below ``bound`` in one configuration, from the lower bounds (p,) of all pairs.

        If there is none, the result has the distance ``bound`` and the pair -1.
        """
        nearest_pair = -1
        hidden: set[int] = set()
        for k in np.argsort(lower_bounds, kind="stable").tolist():
            if lower_bounds[k] >= bound or bound <= 0.0:
                break
            may_be_inside = False
            if self.shapes is None:
                distance = float(lower_bounds[k])
            elif lower_bounds[k] > 0.0:  # links whose capsules are apart are not inside each other
                distance = self.distance(poses, k, bound)
            else:
                distance, may_be_inside = self.separation(poses, k, bound)
            if may_be_inside:
                hidden.add(k)
            if distance < bound:
                bound = max(distance, 0.0)
                nearest_pair = k
        return Nearest(bound, nearest_pair, frozenset(hidden))

    def nearest(self, q: Array) -> list[Nearest]:
        """Smallest distance in each of the configurations (n, nq)."""
        if not len(self.links):
            return [Nearest(np.inf, -1)] * len(q)
        if not len(q):
            return []
        poses = self.robot.link_poses(q)
        lower_bounds = self.bounds(q)
        return [self._nearest_pair(poses[k], lower_bounds[k], np.inf) for k in range(len(q))]

    def nearest_row(self, q: Array, bound: float) -> tuple[Nearest, int]:
        """Smallest distance below ``bound`` over all configurations, and its row; -1 if there is none.

        If links are in contact in several rows, the row is the first of these.
        """
        row = -1
        nearest = Nearest(bound, -1)
        if not len(self.links) or not len(q):
            return nearest, row
        poses = self.robot.link_poses(q)
        lower_bounds = self.bounds(q)
        row_bounds = lower_bounds.min(axis=1)
        for k in np.argsort(row_bounds, kind="stable").tolist():
            if row_bounds[k] >= nearest.distance or nearest.distance <= 0.0:
                break
            candidate = self._nearest_pair(poses[k], lower_bounds[k], nearest.distance)
            hidden = nearest.hidden | candidate.hidden
            if candidate.pair >= 0:
                row = k
                nearest = candidate
            nearest = nearest._replace(hidden=hidden)
        if nearest.distance > 0.0:
            return nearest, row
        for k in np.flatnonzero(row_bounds[: row + 1] <= 0.0).tolist():  # the first row in contact
            contact = self._nearest_pair(poses[k], lower_bounds[k], _CONTACT_DISTANCE)
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
    shapes: list[LinkShape] = []
    for solid in solids:
        description, surface = solid.shape, solid.surface
        walls = None
        if surface is not None:
            vertices = surface.vertices * np.asarray(description.sizes)
            walls = Enclosure(vertices, surface.faces)
            points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
            points.extend(list(vertices))
            triangles.extend([coal.Triangle(*corners) for corners in surface.faces.tolist()])
            geometry = coal.BVHModelOBBRSS()
            geometry.beginModel(len(triangles), len(points))
            geometry.addSubModel(points, triangles)
            geometry.endModel()
        else:
            constructor = constructors.get(description.kind, coal.Ellipsoid)
            geometry = constructor(*description.sizes)
        shapes.append(LinkShape(geometry, description.pose, walls))
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
            pairs += [(element.text("link1"), element.text("link2")) for element in root.all("disable_collisions")]
    except RobotFileError as error:
        raise RobotFileError(f"{name}: {with_clipped_quotations(str(error))}") from None
    if xacro:
        command = EXPAND.replace("robot.urdf", "robot.srdf")
        raise RobotFileError(f"{name}: {xacro}. Expand it first: {command}.")
    if root.tag != "robot" or not pairs:
        raise RobotFileError(
            f"{name}: <{root.tag}> has no <disable_collisions link1=… link2=…>. Give an SRDF file that leaves out pairs."
        )
    link_names = set(robot.link_names)
    own_pairs = frozenset(frozenset(pair) for pair in pairs if link_names.issuperset(pair))
    if not own_pairs:
        first_pair = " – ".join(pairs[0])
        raise RobotFileError(
            f"{name}: none of its {len(pairs)} pairs are links of robot {robot.name!r}; the first is {first_pair}. "
            f"Links of the robot: {listed(robot.link_names)}. Is the file of another robot?"
        )
    return own_pairs


complete(globals())
