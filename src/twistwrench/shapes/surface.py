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
"""Cosine of the crease angle; faces that meet at a smaller angle are shaded smoothly."""
_CORNERS_OF_CIRCLE = 32
"""Number of corners of a circle."""
_MAX_FACES_OF_SOLID = 4000
"""Number of faces of a surface up to which its decimation is kept for the next call."""
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
            dtypes = self.vertices.dtype, self.faces.dtype
            return _decimated_solid(self.vertices.tobytes(), self.faces.tobytes(), dtypes, most)
        return self._decimated(most)

    def _decimated(self, most: int) -> Surface:
        """Surface with at most about ``most`` triangles, by rounds of collapses until one removes no face."""
        surface = self
        previous_count = len(self.faces) + 1
        while most < len(surface.faces) < previous_count:
            previous_count = len(surface.faces)
            surface = surface._collapse_edges((previous_count - most + 1) // 2)  # each collapse removes two faces
        return surface

    def _collapse_edges(self, count: int) -> Surface:
        """Surface after the collapse of at most ``count`` edges that are not near each other."""
        from scipy.sparse import coo_array

        n, F = len(self.vertices), self.faces
        sides = np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1)
        edges, face_counts = np.unique(
            sides @ np.array([n, 1]), return_counts=True
        )  # an edge a-b as the number a n + b
        a, b = edges // n, edges % n
        on_border = np.zeros(n, bool)
        on_border[a[face_counts == 1]] = True
        on_border[b[face_counts == 1]] = True
        is_tangled = np.zeros(n, bool)
        is_tangled[a[face_counts > 2]] = True
        is_tangled[b[face_counts > 2]] = True
        # A collapsed edge becomes its middle, or its end on the border, which keeps its place.
        middle = 0.5 * (self.vertices[a] + self.vertices[b])
        middle = np.where((on_border[a] & ~on_border[b])[:, None], self.vertices[a], middle)
        middle = np.where((on_border[b] & ~on_border[a])[:, None], self.vertices[b], middle)
        joins_borders = (face_counts == 2) & on_border[a] & on_border[b]
        collapsible = ~is_tangled[a] & ~is_tangled[b] & ~joins_borders
        errors = np.where(collapsible, self._errors(a, b, middle), np.inf)
        order = np.argsort(errors, kind="stable")[: max(int(collapsible.sum()) // 2, 1)]
        touching = coo_array((np.ones(2 * len(a), np.int8), (np.r_[a, b], np.r_[b, a])), shape=(n, n)).tocsr()
        shared: Array = np.asarray((touching[a[order]] * touching[b[order]]).sum(axis=1)).ravel()
        order = order[(shared == face_counts[order]) & collapsible[order]]  # the link condition
        edges_to_collapse = []
        neighbours = np.split(touching.indices, touching.indptr[1:-1])
        blocked = np.zeros(n, bool)  # vertices near a collapsed edge
        for edge, first, second in zip(order.tolist(), a[order].tolist(), b[order].tolist(), strict=True):
            if not (blocked[first] or blocked[second]):
                blocked[neighbours[first]] = blocked[neighbours[second]] = True
                edges_to_collapse.append(edge)
                if len(edges_to_collapse) == count:
                    break
        renumbered = np.arange(n)
        renumbered[b[edges_to_collapse]] = a[edges_to_collapse]
        vertices = self.vertices.copy()
        vertices[a[edges_to_collapse]] = middle[edges_to_collapse]
        return _without_slivers(Surface(vertices, renumbered[F]))

    def _errors(self, a: Array, b: Array, middle: Array) -> Array:
        """Errors of the collapse of edges a-b to points: squared distances from the planes of the faces at a and b.

        Distances are weighted by the areas of the faces. A small term of the length puts short edges first in flat parts.
        """
        n = self.normals_of_faces()
        p = self.vertices[self.faces]
        area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        planes = np.column_stack([n, -np.einsum("ij,ij->i", n, p[:, 0])])
        x = np.column_stack([middle, np.ones(len(middle))])
        total = 1e-3 * np.linalg.norm(self.vertices[a] - self.vertices[b], axis=1) ** 4
        for i, j in itertools.combinations_with_replacement(
            range(4), 2
        ):  # x' Q x, with the symmetric Q summed at vertices
            weights = np.repeat(area * planes[:, i] * planes[:, j], 3)
            Q_ij = np.bincount(self.faces.ravel(), weights, len(self.vertices))
            occurrences = 1 if i == j else 2
            total += occurrences * (Q_ij[a] + Q_ij[b]) * x[:, i] * x[:, j]
        return np.asarray(total)

    def creased(self) -> Surface:
        """Surface with vertices duplicated along sharp edges, which keep their shading."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        faces = self.faces
        count = len(faces)
        normals = self.normals_of_faces()
        # Edges of all faces, with the corners at their ends, sorted so that the two faces of an edge are adjacent.
        corner = np.arange(3 * count).reshape(count, 3)
        a, b = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        at_a, at_b = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
        swap = a > b
        a, b = np.where(swap, b, a), np.where(swap, a, b)
        at_a, at_b = np.where(swap, at_b, at_a), np.where(swap, at_a, at_b)
        order = np.lexsort((b, a))
        side, other_side = order[:-1], order[1:]
        same_edge = (a[side] == a[other_side]) & (b[side] == b[other_side])
        side, other_side = side[same_edge], other_side[same_edge]
        cosines = np.abs(np.einsum("ij,ij->i", normals[side // 3], normals[other_side // 3]))
        is_smooth = cosines > _COS_OF_CREASE
        side, other_side = side[is_smooth], other_side[is_smooth]
        # Corners that meet at a smooth edge become one vertex.
        rows = np.concatenate([at_a[side], at_b[side]])
        columns = np.concatenate([at_a[other_side], at_b[other_side]])
        links = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(3 * count, 3 * count))
        _, vertex_of_corner = connected_components(links, directed=False)
        _, first, renumbered = np.unique(vertex_of_corner, return_index=True, return_inverse=True)
        return Surface(self.vertices[faces.ravel()[first]], renumbered.reshape(count, 3))

    def normals_of_faces(self) -> Array:
        """Outward unit normals (k, 3); zero for faces without area."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        n = np.cross(b - a, c - a)
        size = np.linalg.norm(n, axis=1, keepdims=True)
        return np.asarray(n / np.where(size > 0, size, 1.0))


@lru_cache(256)
def _decimated_solid(vertices: bytes, faces: bytes, dtypes: tuple[np.dtype[Any], np.dtype[Any]], most: int) -> Surface:
    """Decimated surface of few faces, kept since pictures of a robot show the same solids again and again."""
    vertex_array = np.frombuffer(vertices, dtypes[0]).reshape(-1, 3)
    face_array = np.frombuffer(faces, dtypes[1]).reshape(-1, 3)
    return Surface(vertex_array, face_array)._decimated(most)


def _without_slivers(surface: Surface) -> Surface:
    """Remove degenerate and duplicate faces after a merge, and unused vertices."""
    f = surface.faces
    f = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])]
    if len(f):
        _, first = np.unique(np.sort(f, axis=1), axis=0, return_index=True)
        f = f[np.sort(first)]
    used, renumbered = np.unique(f, return_inverse=True)
    return Surface(surface.vertices[used], renumbered.reshape(-1, 3))


def joined(surfaces: list[Surface]) -> Surface:
    """Single surface from several."""
    first_vertices = itertools.accumulate((len(s.vertices) for s in surfaces), initial=0)
    faces = [s.faces + first for s, first in zip(surfaces, first_vertices, strict=False)]  # the last sum has no surface
    return Surface(np.concatenate([s.vertices for s in surfaces]), np.concatenate(faces))


def revolved(profile: ArrayLike) -> Surface:
    """Surface of revolution of (radius, z) pairs (n, 2), from bottom to top, about the z axis."""
    profile = np.asarray(profile, float)
    angles = 2 * np.pi * np.arange(_CORNERS_OF_CIRCLE) / _CORNERS_OF_CIRCLE
    r, z = profile[:, :1], profile[:, 1:]
    rings = np.stack(np.broadcast_arrays(r * np.cos(angles), r * np.sin(angles), z), axis=-1).reshape(-1, 3)
    # Quadrilaterals between two rings, each of two triangles.
    ring, k = np.meshgrid(np.arange(len(profile) - 1), np.arange(_CORNERS_OF_CIRCLE), indexing="ij")
    corner = ring * _CORNERS_OF_CIRCLE + k
    next_corner = ring * _CORNERS_OF_CIRCLE + (k + 1) % _CORNERS_OF_CIRCLE
    above = corner + _CORNERS_OF_CIRCLE
    next_above = next_corner + _CORNERS_OF_CIRCLE
    triangles = ((corner, next_corner, next_above), (corner, next_above, above))
    faces = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in triangles])
    unique, group = np.unique(np.round(rings, 12), axis=0, return_inverse=True)
    return _without_slivers(Surface(unique, group.reshape(-1)[faces]))


def sphere(radius: float) -> Surface:
    """Sphere about the origin."""
    return ellipsoid((radius, radius, radius))


def ellipsoid(semi_axes: ArrayLike) -> Surface:
    """Ellipsoid with ``semi_axes`` (3,) along x, y, z."""
    latitudes = np.linspace(-np.pi / 2, np.pi / 2, 15)
    return revolved(np.stack([np.cos(latitudes), np.sin(latitudes)], axis=1)).scaled(semi_axes)


def cylinder(radius: float, length: float, *, round_ends: bool = False) -> Surface:
    """Cylinder along z, centred at the origin; ``round_ends`` adds a half sphere at each end, beyond its length."""
    h = length / 2
    if not round_ends:
        return revolved([(0, -h), (radius, -h), (radius, h), (0, h)])
    latitudes = np.linspace(0, np.pi / 2, 5)
    cap = np.stack([radius * np.cos(latitudes), radius * np.sin(latitudes)], axis=1)
    lower_cap = (cap * [1, -1])[::-1] - [0, h]
    upper_cap = cap + np.array([0, h])
    return revolved(np.concatenate([lower_cap, upper_cap]))


def box(size: ArrayLike) -> Surface:
    """Box with edges ``size`` (3,) along x, y, z, centred at the origin."""
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
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
    parts: dict[Colour | None, list[Surface]] = {}
    for part in read_parts(path):
        parts.setdefault(part.colour, []).append(Surface(part.vertices, part.faces))
    merged: list[tuple[Surface, Colour | None]] = []
    for colour, surfaces in parts.items():
        surface = _merge_vertices(joined(surfaces))
        if len(surface.faces):
            merged.append((surface, colour))
    if not merged:
        raise ModelError("holds no triangles")
    return merged


def _merge_vertices(surface: Surface) -> Surface:
    """Surface without faces that have NaN, whose equal vertices are merged; files repeat a vertex for each face."""
    finite = np.asarray(np.isfinite(surface.vertices).all(axis=1))
    faces = surface.faces[finite[surface.faces].all(axis=1)]
    finite_vertices = surface.vertices[finite]
    if not len(finite_vertices):
        return Surface(finite_vertices, np.zeros((0, 3), int))
    low = finite_vertices.min(axis=0)
    size = float(np.ptp(finite_vertices, axis=0).max()) or 1.0
    grid = np.round(np.where(finite[:, None], surface.vertices - low, 0.0) / (1e-6 * size)).astype(np.int64)
    _, first, group = np.unique(grid @ _PACKING_WEIGHTS, return_index=True, return_inverse=True)
    return _without_slivers(Surface(surface.vertices[first], group[faces]))


# ── Decimated rows of a motion: evenly spaced, with all extremes


class Decimation:
    """Reduces rows (n, k), added in portions, to at most ``most``.

    At most a quarter of the kept rows is evenly spaced. The others have the least or greatest value of a watched column in
    a bin of consecutive rows, or are neighbours of such rows. A spike of one sample thus keeps its height and width, and
    integrals over the kept rows stay correct.
    """

    def __init__(self, most: int, watched: slice) -> None:
        self._most, self._watched = most, watched
        self._step = 1  # between evenly spaced rows
        self._bin = 1  # number of added rows in a bin
        self._rows: Array | None = None
        self._index = np.zeros(0, int)  # of the kept rows among all added ones
        self.count = 0
        """Number of rows added."""

    def add(self, rows: Array) -> None:
        """Add consecutive rows."""
        self._index = np.concatenate([self._index, self.count + np.arange(len(rows))])
        self._rows = rows.copy() if self._rows is None else np.concatenate([self._rows, rows])
        self.count += len(rows)
        if self._bin > 1:
            self._decimate()
        while len(self._rows) > self._most and self._bin < 2 * self.count:
            self._bin *= 2
            while self.count > self._most // 4 * self._step:
                self._step *= 2
            self._decimate()

    def result(self) -> Array:
        """Kept rows in order, including the first and the last."""
        if self._rows is None:
            return np.zeros((0, 0))
        return self._rows

    def _decimate(self) -> None:
        """Keep evenly spaced rows, extremes of each bin with their neighbours, and the last row."""
        if self._rows is None or not len(self._rows):
            return
        bins = self._index // self._bin
        starts = np.r_[0, np.flatnonzero(np.diff(bins)) + 1]
        values = self._rows[:, self._watched]
        is_extreme = np.zeros(len(bins), bool)
        bin_number = np.cumsum(np.r_[0, np.diff(bins) != 0])  # without gaps
        for extremes in (np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)):
            row, column = np.nonzero(values == extremes[bin_number])
            # Index of the first row of each bin and column with the extreme value: rows are in order.
            _, first = np.unique(bin_number[row] * values.shape[1] + column, return_index=True)
            is_extreme[row[first]] = True
        are_neighbours = np.diff(self._index) == 1
        keep = (self._index % self._step == 0) | is_extreme
        keep[1:] |= is_extreme[:-1] & are_neighbours
        keep[:-1] |= is_extreme[1:] & are_neighbours
        keep[-1] = True  # the next portion may need it as a neighbour
        self._rows, self._index = self._rows[keep], self._index[keep]
