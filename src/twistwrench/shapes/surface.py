"""Triangle surfaces: simple solids, meshes from files, creases and decimation; and decimated rows of a motion."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import ModelError
from ..core.typing import Array
from ..mechanics.bodies.mesh_files import read_parts

Colour = tuple[float, float, float]
"""Red, green, blue, from 0 to 1."""

_COS_OF_CREASE = np.cos(np.radians(38.0))
"""Cosine of the crease angle; faces whose normals differ by less are shaded smoothly."""
_CORNERS_OF_CIRCLE = 32
"""Number of corners of a circle."""
_RINGS_OF_SPHERE = 15
"""Number of circles of latitude of a sphere, with the poles; odd, so that the equator is one of them."""
_RINGS_OF_CAP = 5
"""Number of circles of latitude of a half sphere."""
_LENGTH_WEIGHT = 1e-3
"""Weight of an edge's length to the fourth power in the error of its collapse."""
_MAX_FACES_OF_SOLID = 4000
"""Number of faces of a surface up to which its decimation is kept for the next call."""
_GRID_SHARE = 1e-6
"""Width of the grid on which equal vertices of a mesh coincide, as a share of its size."""
_ROUNDED_DECIMALS = 12
"""Decimals to which corners of a surface of revolution [m] are rounded before equal ones are merged."""
_PACKING_WEIGHTS = np.array([1 << 42, 1 << 21, 1])
"""Weights that pack three integers below 2²¹ into one, since integers sort faster than rows."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles: ``vertices`` (n, 3) [m] and ``faces`` (k, 3), vertex indices, counterclockwise seen from outside."""

    vertices: Array
    faces: Array

    def placed(self, T: ArrayLike) -> Surface:
        """Surface transformed from {b} to {a} by T_ab (4, 4)."""
        T = np.asarray(T)
        return Surface(self.vertices @ T[:3, :3].T + T[:3, 3], self.faces)

    def scaled(self, scale: ArrayLike) -> Surface:
        """Surface scaled along the axes by ``scale`` (3,), with faces reversed for a reflection."""
        scale = np.asarray(scale, float)
        keeps_orientation = np.prod(scale) > 0
        return Surface(self.vertices * scale, self.faces if keeps_orientation else self.faces[:, ::-1])

    def decimated(self, most: int) -> Surface:
        """Surface with at most about ``most`` triangles by edge collapse: short edges first, early in flat parts.

        Collapses keep the link condition: the end points of an edge share no neighbours except the corners of its
        faces, so that an edge never has more than two faces. If no such edge is left, more triangles remain. Source:
        Hoppe and others, Mesh Optimization, SIGGRAPH 1993; errors as in Garland and Heckbert, SIGGRAPH 1997.
        """
        if len(self.faces) <= most:
            return self
        if len(self.faces) <= _MAX_FACES_OF_SOLID:
            dtypes = (self.vertices.dtype, self.faces.dtype)
            return _decimated_solid(self.vertices.tobytes(), self.faces.tobytes(), dtypes, most)
        return self._decimated(most)

    def _decimated(self, max_faces: int) -> Surface:
        """Surface with at most about ``max_faces`` triangles, by rounds of collapses until one removes no face."""
        surface = self
        previous_count = len(self.faces) + 1
        while max_faces < len(surface.faces) < previous_count:
            previous_count = len(surface.faces)
            collapses = (previous_count - max_faces + 1) // 2  # each removes two faces
            surface = surface._collapse_edges(collapses)
        return surface

    def _collapse_edges(self, max_collapses: int) -> Surface:
        """Surface after the collapse of at most ``max_collapses`` edges that are not near each other."""
        from scipy.sparse import coo_array

        n = len(self.vertices)
        F = self.faces
        sides = np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1)
        # an edge of the vertices a and b is the number a n + b
        edge_numbers, face_counts = np.unique(sides @ np.array([n, 1]), return_counts=True)
        a = edge_numbers // n
        b = edge_numbers % n
        on_border = np.zeros(n, bool)
        on_border[a[face_counts == 1]] = True
        on_border[b[face_counts == 1]] = True
        is_tangled = np.zeros(n, bool)  # at an edge of more than two faces
        is_tangled[a[face_counts > 2]] = True
        is_tangled[b[face_counts > 2]] = True
        # A collapsed edge becomes its middle, or its end on the border, since vertices on a border stay in place.
        targets = 0.5 * (self.vertices[a] + self.vertices[b])
        targets = np.where((on_border[a] & ~on_border[b])[:, None], self.vertices[a], targets)
        targets = np.where((on_border[b] & ~on_border[a])[:, None], self.vertices[b], targets)
        joins_borders = (face_counts == 2) & on_border[a] & on_border[b]
        collapsible = ~is_tangled[a] & ~is_tangled[b] & ~joins_borders
        errors = np.where(collapsible, self._collapse_errors(a, b, targets), np.inf)
        candidate_count = max(int(collapsible.sum()) // 2, 1)
        candidates = np.argsort(errors, kind="stable")[:candidate_count]  # edges, the smallest error first
        ends = np.r_[a, b]
        other_ends = np.r_[b, a]
        touching = coo_array((np.ones(len(ends), np.int8), (ends, other_ends)), shape=(n, n)).tocsr()
        touches_both_ends = touching[a[candidates]] * touching[b[candidates]]  # (candidates, n)
        shared_counts: Array = np.asarray(touches_both_ends.sum(axis=1)).ravel()
        meets_link_condition = shared_counts == face_counts[candidates]
        candidates = candidates[meets_link_condition & collapsible[candidates]]
        edges_to_collapse = []
        neighbours = np.split(touching.indices, touching.indptr[1:-1])  # of each vertex
        blocked = np.zeros(n, bool)  # vertices near a collapsed edge
        for edge in candidates.tolist():
            vertex_a = a[edge]
            vertex_b = b[edge]
            if not (blocked[vertex_a] or blocked[vertex_b]):
                blocked[neighbours[vertex_a]] = True
                blocked[neighbours[vertex_b]] = True
                edges_to_collapse.append(edge)
                if len(edges_to_collapse) == max_collapses:
                    break
        new_numbers = np.arange(n)
        new_numbers[b[edges_to_collapse]] = a[edges_to_collapse]
        vertices = self.vertices.copy()
        vertices[a[edges_to_collapse]] = targets[edges_to_collapse]
        return _without_slivers(Surface(vertices, new_numbers[F]))

    def _collapse_errors(self, a: Array, b: Array, targets: Array) -> Array:
        """Errors of the collapse of edges a-b to points: squared distances from the planes of the faces at a and b.

        Distances are weighted by the areas of the faces. A small term of the length puts short edges first in flat parts.
        """
        n = self.normals_of_faces()
        p = self.vertices[self.faces]
        area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        planes = np.column_stack([n, -np.einsum("ij,ij->i", n, p[:, 0])])  # coefficients (faces, 4)
        x = np.column_stack([targets, np.ones(len(targets))])  # homogeneous coordinates
        lengths = np.linalg.norm(self.vertices[a] - self.vertices[b], axis=1)
        errors = _LENGTH_WEIGHT * lengths**4
        # x' Q x by its entries, with the symmetric Q of a vertex summed over its faces
        for i, j in itertools.combinations_with_replacement(range(4), 2):
            weights = np.repeat(area * planes[:, i] * planes[:, j], 3)
            Q_ij = np.bincount(self.faces.ravel(), weights, len(self.vertices))
            occurrences = 1 if i == j else 2
            errors += occurrences * (Q_ij[a] + Q_ij[b]) * x[:, i] * x[:, j]
        return np.asarray(errors)

    def creased(self) -> Surface:
        """Surface with vertices duplicated along sharp edges, so that each face is shaded by its own normal there."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        faces = self.faces
        count = len(faces)
        normals = self.normals_of_faces()
        # Sides of all faces, with the numbers of the corners at their ends, turned so that a < b. They are sorted by their
        # vertices so that the two sides of an edge are adjacent.
        corner = np.arange(3 * count).reshape(count, 3)
        begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        corner_at_begin, corner_at_end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
        swap = begin > end
        a = np.where(swap, end, begin)
        b = np.where(swap, begin, end)
        corner_at_a = np.where(swap, corner_at_end, corner_at_begin)
        corner_at_b = np.where(swap, corner_at_begin, corner_at_end)
        order = np.lexsort((b, a))
        side, other_side = order[:-1], order[1:]  # neighbours in this order
        same_edge = (a[side] == a[other_side]) & (b[side] == b[other_side])
        side, other_side = side[same_edge], other_side[same_edge]
        normal, other_normal = normals[side // 3], normals[other_side // 3]  # three sides belong to a face
        cosines = np.abs(np.einsum("ij,ij->i", normal, other_normal))
        is_smooth = cosines > _COS_OF_CREASE
        side, other_side = side[is_smooth], other_side[is_smooth]
        # Corners that meet at a smooth edge become one vertex.
        corners = np.concatenate([corner_at_a[side], corner_at_b[side]])
        other_corners = np.concatenate([corner_at_a[other_side], corner_at_b[other_side]])
        links = coo_array((np.ones(len(corners), np.int8), (corners, other_corners)), shape=(3 * count, 3 * count))
        _, vertex_of_corner = connected_components(links, directed=False)
        _, first_corner, new_vertex = np.unique(vertex_of_corner, return_index=True, return_inverse=True)
        return Surface(self.vertices[faces.ravel()[first_corner]], new_vertex.reshape(count, 3))

    def normals_of_faces(self) -> Array:
        """Outward unit normals (k, 3); zero for faces without area."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        n = np.cross(b - a, c - a)
        length = np.linalg.norm(n, axis=1, keepdims=True)
        return np.asarray(n / np.where(length > 0, length, 1.0))


@lru_cache(256)
def _decimated_solid(
    vertices: bytes, faces: bytes, dtypes: tuple[np.dtype[Any], np.dtype[Any]], max_faces: int
) -> Surface:
    """Decimated surface of few faces, stored since pictures of a robot show the same solids again and again.

    Arrays come as bytes with their types, because they cannot be keys of a cache.
    """
    vertex_type, face_type = dtypes
    vertex_array = np.frombuffer(vertices, vertex_type).reshape(-1, 3)
    face_array = np.frombuffer(faces, face_type).reshape(-1, 3)
    return Surface(vertex_array, face_array)._decimated(max_faces)


def _without_slivers(surface: Surface) -> Surface:
    """Remove degenerate and duplicate faces after a merge, and unused vertices."""
    f = surface.faces
    f = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]
    if len(f):
        _, first_of_equal = np.unique(np.sort(f, axis=1), axis=0, return_index=True)
        f = f[np.sort(first_of_equal)]  # in their order
    used_vertices, new_numbers = np.unique(f, return_inverse=True)
    return Surface(surface.vertices[used_vertices], new_numbers.reshape(-1, 3))


def joined(surfaces: list[Surface]) -> Surface:
    """Single surface with the triangles of several."""
    first_vertices = itertools.accumulate((len(s.vertices) for s in surfaces), initial=0)
    faces = [s.faces + first for s, first in zip(surfaces, first_vertices, strict=False)]  # the last sum has no surface
    return Surface(np.concatenate([s.vertices for s in surfaces]), np.concatenate(faces))


def revolved(profile: ArrayLike) -> Surface:
    """Surface of revolution of (radius, z) pairs (n, 2), from bottom to top, about the z axis."""
    profile = np.asarray(profile, float)
    angles = 2 * np.pi * np.arange(_CORNERS_OF_CIRCLE) / _CORNERS_OF_CIRCLE
    r, z = profile[:, :1], profile[:, 1:]
    coordinates = np.broadcast_arrays(r * np.cos(angles), r * np.sin(angles), z)  # (n, corners) each
    corners = np.stack(coordinates, axis=-1).reshape(-1, 3)
    # Each pair of neighbouring circles has quadrilaterals between them, of two triangles each.
    ring, k = np.meshgrid(np.arange(len(profile) - 1), np.arange(_CORNERS_OF_CIRCLE), indexing="ij")
    corner = ring * _CORNERS_OF_CIRCLE + k
    next_corner = ring * _CORNERS_OF_CIRCLE + (k + 1) % _CORNERS_OF_CIRCLE
    above = corner + _CORNERS_OF_CIRCLE
    next_above = next_corner + _CORNERS_OF_CIRCLE
    triangles = ((corner, next_corner, next_above), (corner, next_above, above))
    faces = np.concatenate([np.stack(triangle, axis=-1).reshape(-1, 3) for triangle in triangles])
    # corners of a circle of radius zero are one vertex; they may differ by rounding errors
    rounded_corners = np.round(corners, _ROUNDED_DECIMALS)
    vertices, vertex_of_corner = np.unique(rounded_corners, axis=0, return_inverse=True)
    return _without_slivers(Surface(vertices, vertex_of_corner.reshape(-1)[faces]))


def sphere(radius: float) -> Surface:
    """Sphere about the origin."""
    return ellipsoid((radius, radius, radius))


def ellipsoid(semi_axes: ArrayLike) -> Surface:
    """Ellipsoid with ``semi_axes`` (3,) along x, y, z."""
    latitudes = np.linspace(-np.pi / 2, np.pi / 2, _RINGS_OF_SPHERE)
    unit_sphere = revolved(np.stack([np.cos(latitudes), np.sin(latitudes)], axis=1))
    return unit_sphere.scaled(semi_axes)


def cylinder(radius: float, length: float, *, round_ends: bool = False) -> Surface:
    """Cylinder along z, centred at the origin; ``round_ends`` adds a half sphere at each end, beyond its length."""
    h = length / 2
    if not round_ends:
        return revolved([(0, -h), (radius, -h), (radius, h), (0, h)])
    latitudes = np.linspace(0, np.pi / 2, _RINGS_OF_CAP)
    cap = np.stack([radius * np.cos(latitudes), radius * np.sin(latitudes)], axis=1)
    lower_cap = (cap * [1, -1])[::-1] - [0, h]
    upper_cap = cap + np.array([0, h])
    return revolved(np.concatenate([lower_cap, upper_cap]))


def box(size: ArrayLike) -> Surface:
    """Box with edges ``size`` (3,) along x, y, z, centred at the origin."""
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    # Corner 4 i + 2 j + k is at the lower (0) or upper (1) end i of x, j of y and k of z; squares -x, x, -y, y, -z, z.
    squares = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = []
    for a, b, c, d in squares:
        faces += [(a, b, c), (a, c, d)]
    return Surface(corners * np.asarray(size, float), np.array(faces))


SIMPLE: Mapping[str, Callable[..., Surface]] = {
    "box": lambda *edges: box(edges),
    "sphere": sphere,
    "ellipsoid": lambda *semi_axes: ellipsoid(semi_axes),
    "cylinder": cylinder,
    "capsule": partial(cylinder, round_ends=True),
}
"""Surface of each kind of shape from its sizes."""


def read_mesh(path: Path) -> list[tuple[Surface, Colour | None]]:
    """Surfaces of a mesh file with their colours: one for each colour, and one for parts without a colour.

    Raises MissingExtraError, or ModelError if the file cannot be read.
    """
    surfaces_by_colour: dict[Colour | None, list[Surface]] = {}
    for part in read_parts(path):
        surfaces_by_colour.setdefault(part.colour, []).append(Surface(part.vertices, part.faces))
    merged: list[tuple[Surface, Colour | None]] = []
    for colour, surfaces in surfaces_by_colour.items():
        surface = _merge_vertices(joined(surfaces))
        if len(surface.faces):
            merged.append((surface, colour))
    if not merged:
        raise ModelError("holds no triangles")
    return merged


def _merge_vertices(surface: Surface) -> Surface:
    """Surface with equal vertices merged, because files repeat a vertex for each face.

    Faces with a vertex that is not finite are left out. Vertices are equal if they round to one point of a grid.
    """
    is_finite = np.asarray(np.isfinite(surface.vertices).all(axis=1))
    faces = surface.faces[is_finite[surface.faces].all(axis=1)]
    finite_vertices = surface.vertices[is_finite]
    if not len(finite_vertices):
        return Surface(finite_vertices, np.zeros((0, 3), int))
    low = finite_vertices.min(axis=0)
    size = float(np.ptp(finite_vertices, axis=0).max()) or 1.0  # 1 if all vertices are one point
    grid_width = _GRID_SHARE * size
    offsets = np.where(is_finite[:, None], surface.vertices - low, 0.0)
    grid_points = np.round(offsets / grid_width).astype(np.int64)
    _, first_vertex, group = np.unique(grid_points @ _PACKING_WEIGHTS, return_index=True, return_inverse=True)
    return _without_slivers(Surface(surface.vertices[first_vertex], group[faces]))


# ── Decimated rows of a motion: evenly spaced, with all extremes


class Decimation:
    """Reduces rows (n, k) of a motion, added in portions, to at most ``most``.

    At most a quarter of the kept rows is evenly spaced. The others have the least or greatest value of a column of the
    slice ``watched`` in a bin of consecutive rows, or are neighbours of such rows. A spike of one sample thus keeps its
    height and width, and integrals over the kept rows stay correct.
    """

    def __init__(self, most: int, watched: slice) -> None:
        self._max_rows = most
        self._watched_columns = watched
        self._step = 1  # number of added rows from one evenly spaced row to the next
        self._bin_size = 1  # number of added rows in a bin
        self._kept_rows: Array | None = None
        self._indices = np.zeros(0, int)  # of the kept rows among all added ones
        self.count = 0
        """Number of rows added."""

    def add(self, rows: Array) -> None:
        """Add consecutive rows, and decimate all if they are too many."""
        self._indices = np.concatenate([self._indices, self.count + np.arange(len(rows))])
        self._kept_rows = rows.copy() if self._kept_rows is None else np.concatenate([self._kept_rows, rows])
        self.count += len(rows)
        if self._bin_size > 1:
            self._decimate()
        # a bin that holds all rows cannot be made larger
        while len(self._kept_rows) > self._max_rows and self._bin_size < 2 * self.count:
            self._bin_size *= 2
            while self.count > self._max_rows // 4 * self._step:  # at most a quarter is evenly spaced
                self._step *= 2
            self._decimate()

    def result(self) -> Array:
        """Kept rows in order, including the first and the last."""
        if self._kept_rows is None:
            return np.zeros((0, 0))
        return self._kept_rows

    def _decimate(self) -> None:
        """Keep evenly spaced rows, extremes of each bin with their neighbours, and the last row."""
        if self._kept_rows is None or not len(self._kept_rows):
            return
        bins = self._indices // self._bin_size
        begins_bin = np.diff(bins) != 0  # from the second row on
        starts = np.r_[0, np.flatnonzero(begins_bin) + 1]
        bin_number = np.cumsum(np.r_[0, begins_bin])  # of each row, without gaps
        values = self._kept_rows[:, self._watched_columns]
        is_extreme = np.zeros(len(bins), bool)
        for extremes in (np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)):
            row, column = np.nonzero(values == extremes[bin_number])
            # Of several rows with the extreme value of a bin and column, the first is kept.
            bin_and_column = bin_number[row] * values.shape[1] + column
            _, first_of_equal = np.unique(bin_and_column, return_index=True)
            is_extreme[row[first_of_equal]] = True
        are_neighbours = np.diff(self._indices) == 1
        keep = (self._indices % self._step == 0) | is_extreme
        keep[1:] |= is_extreme[:-1] & are_neighbours
        keep[:-1] |= is_extreme[1:] & are_neighbours
        keep[-1] = True  # the next portion may need it as a neighbour
        self._kept_rows = self._kept_rows[keep]
        self._indices = self._indices[keep]
