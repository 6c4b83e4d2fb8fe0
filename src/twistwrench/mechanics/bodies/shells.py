"""Closed shells of a triangle mesh: connected faces, nesting and intersections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.glossary import complete
from ...core.typing import Array

# A solid may be bounded by several shells: its outer one, those of cavities, and those of separate parts. Only nesting tells
# which is which, not the orientation of faces: an outer shell bounds a solid, a shell inside it a cavity, a shell inside a
# cavity a solid again. Shells that intersect do not nest.

_MAX_SAMPLE_POINTS = 64
"""Number of sample points (vertices and face centres) per shell in the containment test."""
_MAX_PAIRS = 1 << 22
"""Maximum number of edge-face pairs per two shells in the intersection test."""
_PAIRS_PER_BLOCK = 1 << 20
"""Number of pairs whose bounding boxes are compared together."""
_MEMORY_OF_WINDING = 16
"""Memory of a pair of a point and a face in the winding number, over that of a pair of boxes."""
_MIN_DISTANCE_RATIO = 1e-9
"""Distance, relative to the shells, below which a point counts as on a face, and an edge only touches the face."""


@dataclass(frozen=True, eq=False)
class Nest:
    """Nesting of closed shells."""

    depth: Array
    """Number of shells around each shell (n,). A shell of even depth bounds a solid, one of odd depth a cavity."""
    cutting: tuple[tuple[int, int], ...]
    """Pairs of shells that intersect or coincide; neither counts as inside the other."""

    @property
    def sign(self) -> Array:
        """Sign (n,): 1 for solids, -1 for cavities."""
        return 1.0 - 2.0 * (self.depth % 2)


def edges_of(faces: Array) -> Array:
    """Directed edges (3 k, 2) of faces (k, 3): the first edge of each face, then the second, then the third."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)


def shell_numbers(faces: Array) -> tuple[int, Array]:
    """Number of shells, and the shell of each face (k,): faces that share an edge belong to one shell."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    k = len(faces)
    ends = np.sort(edges_of(faces), axis=1)
    vertex_count = int(faces.max()) + 1
    edge_keys = ends[:, 0] * vertex_count + ends[:, 1]
    _, edge_numbers = np.unique(edge_keys, return_inverse=True)
    face_numbers = np.tile(np.arange(k), 3)
    # Nodes of the graph are the faces, then the edges; each face is linked to its three edges.
    node_count = k + int(edge_numbers.max()) + 1
    links = (np.ones(3 * k, bool), (face_numbers, k + edge_numbers))
    graph = coo_array(links, shape=(node_count, node_count))
    shell_count, shell_of_node = connected_components(graph, directed=False)
    return int(shell_count), shell_of_node[:k]


def nest(triangles: Array, shell: Array, count: int) -> Nest:
    """Nesting of shells; triangles (k, 3, 3), faces oriented outwards, shell (k,) in 0 … count - 1."""
    shells = [triangles[shell == i] for i in range(count)]
    low = np.array([faces.min(axis=(0, 1)) for faces in shells])  # corners of the shells' boxes
    high = np.array([faces.max(axis=(0, 1)) for faces in shells])
    depth = np.zeros(count, int)
    cutting = []
    for i in range(count):
        boxes_meet = (low[i] <= high).all(axis=1) & (low <= high[i]).all(axis=1)
        candidates = np.flatnonzero(boxes_meet)
        for j in candidates[candidates > i]:  # each pair once
            i_inside_j = _is_inside(shells[i], shells[j])
            j_inside_i = _is_inside(shells[j], shells[i])
            is_unclear = i_inside_j is None or j_inside_i is None
            if is_unclear or _edges_cut(shells[i], shells[j]) or _edges_cut(shells[j], shells[i]):
                cutting.append((i, int(j)))
            else:
                depth[i] += bool(i_inside_j)
                depth[j] += bool(j_inside_i)
    return Nest(depth, tuple(cutting))


def _is_inside(shell: Array, other: Array) -> bool | None:
    """True if a shell (n, 3, 3) lies inside another, False if outside; None if partly inside, or on its surface."""
    points = np.concatenate([shell.mean(axis=1), shell.reshape(-1, 3)])
    step = max(1, len(points) // _MAX_SAMPLE_POINTS)
    winding_numbers = winding(points[::step], other)
    is_inside = winding_numbers[~np.isnan(winding_numbers)] > 0.5  # 1 inside, 0 outside
    is_partly_inside = is_inside.any() != is_inside.all()
    if not is_inside.size or is_partly_inside:
        return None
    return bool(is_inside.all())


def winding(points: Array, triangles: Array) -> Array:
    """Winding number of the surface about each point: 1 inside, 0 outside, NaN on it; (n, 3), (k, 3, 3) → (n,).

    The winding number is the sum of the solid angles Ω of all faces, over 4π. With the vectors a, b, c from the point to the
    vertices of a face (van Oosterom and Strackee, 1983),

        tan(Ω/2) = a·(b × c) / (|a| |b| |c| + (a·b) |c| + (b·c) |a| + (c·a) |b|)
    """
    winding_numbers = np.zeros(len(points))
    portion = max(1, _PAIRS_PER_BLOCK // (_MEMORY_OF_WINDING * len(triangles)))  # points
    for k in range(0, len(points), portion):
        a, b, c = np.moveaxis(triangles - points[k : k + portion, None, None], 2, 0)
        len_a, len_b, len_c = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
        ab = (a * b).sum(axis=-1)
        bc = (b * c).sum(axis=-1)
        ca = (c * a).sum(axis=-1)
        numerator = (a * np.cross(b, c)).sum(axis=-1)
        denominator = len_a * len_b * len_c + ab * len_c + bc * len_a + ca * len_b
        rounding_error = _MIN_DISTANCE_RATIO * np.maximum(np.maximum(len_a, len_b), len_c) ** 3
        on_face = ((np.abs(numerator) <= rounding_error) & (denominator <= rounding_error)).any(axis=-1)
        half_angle_sum = np.arctan2(numerator, denominator).sum(axis=-1)
        winding_numbers[k : k + portion] = np.where(on_face, np.nan, half_angle_sum / (2.0 * np.pi))
    return winding_numbers


def _edges_cut(shell: Array, other: Array) -> bool:
    """True if an edge of one shell passes through a face of the other."""
    starts = shell.reshape(-1, 3)
    ends = np.roll(shell, -1, axis=1).reshape(-1, 3)
    other_low, other_high = other.min(axis=(0, 1)), other.max(axis=(0, 1))
    edge_low, edge_high = np.minimum(starts, ends), np.maximum(starts, ends)
    edge_is_near = (edge_low <= other_high).all(axis=1) & (edge_high >= other_low).all(axis=1)
    starts, ends = starts[edge_is_near], ends[edge_is_near]
    low, high = shell.min(axis=(0, 1)), shell.max(axis=(0, 1))
    face_is_near = (other.min(axis=1) <= high).all(axis=1) & (other.max(axis=1) >= low).all(axis=1)
    faces = other[face_is_near]
    if not len(starts) or not len(faces):
        return False
    step = max(1, len(starts) * len(faces) // _MAX_PAIRS)
    starts, ends = starts[::step], ends[::step]
    extent = max(float(np.ptp(x, axis=(0, 1)).max()) for x in (shell, other))
    min_volume = _MIN_DISTANCE_RATIO * extent**3
    portion = max(1, _PAIRS_PER_BLOCK // len(faces))
    for k in range(0, len(starts), portion):
        p, q = starts[k : k + portion], ends[k : k + portion]
        edge_indices, face_indices = _intersecting_boxes(
            np.minimum(p, q), np.maximum(p, q), faces.min(axis=1), faces.max(axis=1)
        )
        if _edges_through_faces(p[edge_indices], q[edge_indices], faces[face_indices], min_volume).any():
            return True
    return False


def _intersecting_boxes(low: Array, high: Array, other_low: Array, other_high: Array) -> tuple[Array, Array]:
    """Indices of boxes and of other boxes that intersect, in pairs; boxes are given by two corners (m, 3), (n, 3) each."""
    do_meet = np.ones((len(low), len(other_low)), bool)
    for axis in range(3):
        do_meet &= low[:, None, axis] <= other_high[None, :, axis]
        do_meet &= other_low[None, :, axis] <= high[:, None, axis]
    indices, other_indices = np.nonzero(do_meet)
    return indices, other_indices


def _edges_through_faces(p: Array, q: Array, faces: Array, min_volume: float) -> Array:
    """True for each edge from p to q (n, 3) that passes through its face (n, 3, 3), and does not only touch it.

    p and q must be on different sides of the face's plane. The line through them must have all sides of the face on one hand.
    Both conditions are signs of volumes of parallelepipeds; volumes up to ``min_volume`` count as touching.
    """
    a, b, c = np.moveaxis(faces, 1, 0)
    normal = np.cross(b - a, c - a)
    volume_p, volume_q = (((x - a) * normal).sum(axis=1) for x in (p, q))
    smaller_volume = np.minimum(np.abs(volume_p), np.abs(volume_q))
    crosses_plane = (volume_p * volume_q < 0) & (smaller_volume > min_volume)
    sides = ((a, b), (b, c), (c, a))
    side_volumes = [((q - p) * np.cross(x - p, y - p)).sum(axis=1) for x, y in sides]
    all_positive = np.min(side_volumes, axis=0) > min_volume
    all_negative = np.max(side_volumes, axis=0) < -min_volume
    return np.asarray(crosses_plane & (all_positive | all_negative))


complete(globals())
