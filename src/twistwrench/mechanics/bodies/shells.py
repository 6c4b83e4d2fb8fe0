"""Closed shells of a triangle mesh: connected faces, nesting and intersections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.glossary import complete
from ...core.typing import Array

# A solid may be bounded by several shells: its outer one, those of cavities, and those of separate parts. The orientation of
# faces is ignored: an outer shell bounds a solid, a shell inside it a cavity, a shell inside a cavity a solid again. Shells
# that intersect do not nest.

_MAX_SAMPLE_POINTS = 64
"""Number of sample points (vertices and face centres) per shell in the containment test."""
_MAX_PAIRS = 1 << 22
"""Maximum number of edge-face pairs per two shells in the intersection test."""
_PAIRS_PER_BLOCK = 1 << 20
"""Number of pairs whose bounding boxes are compared at once."""
_MIN_DISTANCE_RATIO = 1e-9
"""Relative distance below which a point counts as on a face, and an edge only touches the face."""


@dataclass(frozen=True, eq=False)
class Nest:
    """Nesting of closed shells."""

    depth: Array
    """Number of shells around each shell (n,). Even: it bounds a solid. Odd: a cavity."""
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
    _, edge = np.unique(ends[:, 0] * (int(faces.max()) + 1) + ends[:, 1], return_inverse=True)
    face = np.tile(np.arange(k), 3)
    n = k + int(edge.max()) + 1
    graph = coo_array((np.ones(3 * k, bool), (face, k + edge)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    return int(count), label[:k]


def nest(triangles: Array, shell: Array, count: int) -> Nest:
    """Nesting of shells; triangles (k, 3, 3), faces oriented outwards, shell (k,) in 0 … count - 1."""
    parts = [triangles[shell == i] for i in range(count)]
    low = np.array([part.min(axis=(0, 1)) for part in parts])
    high = np.array([part.max(axis=(0, 1)) for part in parts])
    depth, cutting = np.zeros(count, int), []
    for i in range(count):
        near = np.flatnonzero((low[i] <= high).all(axis=1) & (low <= high[i]).all(axis=1))
        for j in near[near > i]:
            inside = _inside(parts[i], parts[j]), _inside(parts[j], parts[i])
            if None in inside or _edges_cut(parts[i], parts[j]) or _edges_cut(parts[j], parts[i]):
                cutting.append((i, int(j)))
            else:
                depth[i] += bool(inside[0])
                depth[j] += bool(inside[1])
    return Nest(depth, tuple(cutting))


def _inside(part: Array, other: Array) -> bool | None:
    """True if a shell (n, 3, 3) lies inside another, False if outside; None if partly inside, or on its surface."""
    points = np.concatenate([part.mean(axis=1), part.reshape(-1, 3)])
    points = points[:: max(1, len(points) // _MAX_SAMPLE_POINTS)]
    w = winding(points, other)
    is_inside = w[~np.isnan(w)] > 0.5
    if not is_inside.size:
        return None
    return bool(is_inside[0]) if (is_inside == is_inside[0]).all() else None


def winding(points: Array, triangles: Array) -> Array:
    """Winding number of the surface about each point: 1 inside, 0 outside, NaN on it; (n, 3), (k, 3, 3) → (n,).

    From the solid angle of each face: van Oosterom and Strackee, 1983.
    """
    total = np.zeros(len(points))
    portion = max(1, _PAIRS_PER_BLOCK // (16 * len(triangles)))
    for k in range(0, len(points), portion):
        a, b, c = np.moveaxis(triangles - points[k : k + portion, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=-1)
        denominator = la * lb * lc + (a * b).sum(axis=-1) * lc + (b * c).sum(axis=-1) * la + (c * a).sum(axis=-1) * lb
        rounding = _MIN_DISTANCE_RATIO * np.maximum(np.maximum(la, lb), lc) ** 3
        on_face = ((np.abs(volume) <= rounding) & (denominator <= rounding)).any(axis=-1)
        total[k : k + portion] = np.where(on_face, np.nan, np.arctan2(volume, denominator).sum(axis=-1) / (2.0 * np.pi))
    return total


def _edges_cut(part: Array, other: Array) -> bool:
    """True if an edge of one shell passes through a face of the other."""
    starts, ends = part.reshape(-1, 3), np.roll(part, -1, axis=1).reshape(-1, 3)
    low, high = other.min(axis=(0, 1)), other.max(axis=(0, 1))
    near = (np.minimum(starts, ends) <= high).all(axis=1) & (np.maximum(starts, ends) >= low).all(axis=1)
    starts, ends = starts[near], ends[near]
    low, high = part.min(axis=(0, 1)), part.max(axis=(0, 1))
    faces = other[(other.min(axis=1) <= high).all(axis=1) & (other.max(axis=1) >= low).all(axis=1)]
    if not len(starts) or not len(faces):
        return False
    step = max(1, len(starts) * len(faces) // _MAX_PAIRS)
    min_volume = _MIN_DISTANCE_RATIO * max(float(np.ptp(x, axis=(0, 1)).max()) for x in (part, other)) ** 3
    starts, ends = starts[::step], ends[::step]
    portion = max(1, _PAIRS_PER_BLOCK // len(faces))
    for k in range(0, len(starts), portion):
        p, q = starts[k : k + portion], ends[k : k + portion]
        edge, face = _boxes_meet(np.minimum(p, q), np.maximum(p, q), faces.min(axis=1), faces.max(axis=1))
        if _edges_through_faces(p[edge], q[edge], faces[face], min_volume).any():
            return True
    return False


def _boxes_meet(low: Array, high: Array, other_low: Array, other_high: Array) -> tuple[Array, Array]:
    """Pairs of boxes (m, 3) and (n, 3) that intersect."""
    meet = np.ones((len(low), len(other_low)), bool)
    for axis in range(3):
        meet &= low[:, None, axis] <= other_high[None, :, axis]
        meet &= other_low[None, :, axis] <= high[:, None, axis]
    first, second = np.nonzero(meet)
    return first, second


def _edges_through_faces(p: Array, q: Array, faces: Array, min_volume: float) -> Array:
    """True for each edge from p to q (n, 3) that passes through its face (n, 3, 3), beyond touching it."""
    a, b, c = np.moveaxis(faces, 1, 0)
    normal = np.cross(b - a, c - a)
    before, after = (((x - a) * normal).sum(axis=1) for x in (p, q))
    passes = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > min_volume)
    sides = [((q - p) * np.cross(x - p, y - p)).sum(axis=1) for x, y in ((a, b), (b, c), (c, a))]
    return np.asarray(passes & ((np.min(sides, axis=0) > min_volume) | (np.max(sides, axis=0) < -min_volume)))


complete(globals())
