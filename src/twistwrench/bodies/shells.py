"""The closed shells of a triangle mesh: which faces hang together, which shell lies inside which, and which cut each other.

A solid may be bounded by several shells: its outer one, those of its cavities, those of solids beside it. What a shell
bounds does not depend on how its faces are turned: by itself it is a solid; inside another it is a cavity, inside a cavity a
solid again. Shells that cut each other are no such nest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..typing import Array

_LOOKED_AT = 64
"""Corners and face centres of a shell that are asked whether they are inside another."""
_PAIRS = 1 << 22
"""Pairs of an edge and a face that are looked at, for each two shells, to find whether they cut each other."""
_AT_ONCE = 1 << 20
"""Of these pairs as many are compared at once, by their boxes."""
_TOUCHING = 1e-9
"""Points this near to a face, as part of what is compared, lie on it; edges that go this little through one only touch it."""


@dataclass(frozen=True, eq=False)
class Nest:
    """What each shell bounds."""

    depth: Array
    """(n,): how many shells a shell lies in. Even: it bounds a solid. Odd: a cavity."""
    cutting: tuple[tuple[int, int], ...]
    """The pairs of shells that cut each other or coincide. Neither is taken to lie inside the other."""

    @property
    def sign(self) -> Array:
        """(n,): 1 for solids, -1 for cavities."""
        return 1.0 - 2.0 * (self.depth % 2)


def edges_of(faces: Array) -> Array:
    """The directed edges (3 k, 2) of faces (k, 3), the first of each face, then the second, then the third."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)


def shell_numbers(faces: Array) -> tuple[int, Array]:
    """How many shells there are, and the shell of each face (k,): faces that share an edge are of one shell."""
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
    """Which shells lie inside which; triangles (k, 3, 3), each shell's faces turned outwards, shell (k,) in 0 … count - 1."""
    parts = [triangles[shell == i] for i in range(count)]
    low = np.array([part.min(axis=(0, 1)) for part in parts])
    high = np.array([part.max(axis=(0, 1)) for part in parts])
    depth, cutting = np.zeros(count, int), []
    for i in range(count):
        near = np.flatnonzero((low[i] <= high).all(axis=1) & (low <= high[i]).all(axis=1))
        for j in near[near > i]:
            inside = _inside(parts[i], parts[j]), _inside(parts[j], parts[i])
            if None in inside or _cut(parts[i], parts[j]) or _cut(parts[j], parts[i]):
                cutting.append((i, int(j)))
            else:
                depth[i] += bool(inside[0])
                depth[j] += bool(inside[1])
    return Nest(depth, tuple(cutting))


def _inside(part: Array, other: Array) -> bool | None:
    """Whether a shell (n, 3, 3) lies inside another one; None where only a part of it does, or all of it on the surface."""
    points = np.concatenate([part.mean(axis=1), part.reshape(-1, 3)])
    points = points[:: max(1, len(points) // _LOOKED_AT)]
    w = _winding(points, other)
    found = w[~np.isnan(w)] > 0.5
    if not found.size:
        return None
    return bool(found[0]) if (found == found[0]).all() else None


def _winding(points: Array, triangles: Array) -> Array:
    """How often the surface goes round each point: 1 inside, 0 outside, NaN on it; (n, 3), (k, 3, 3) → (n,).

    By the solid angle of each face: van Oosterom and Strackee, 1983.
    """
    total = np.zeros(len(points))
    portion = max(1, _AT_ONCE // (16 * len(triangles)))
    for k in range(0, len(points), portion):
        a, b, c = np.moveaxis(triangles - points[k : k + portion, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=-1)
        along = la * lb * lc + (a * b).sum(axis=-1) * lc + (b * c).sum(axis=-1) * la + (c * a).sum(axis=-1) * lb
        small = _TOUCHING * np.maximum(np.maximum(la, lb), lc) ** 3
        on = ((np.abs(volume) <= small) & (along <= small)).any(axis=-1)
        total[k : k + portion] = np.where(on, np.nan, np.arctan2(volume, along).sum(axis=-1) / (2.0 * np.pi))
    return total


def _cut(part: Array, other: Array) -> bool:
    """Whether an edge of the one shell goes through a face of the other."""
    starts, ends = part.reshape(-1, 3), np.roll(part, -1, axis=1).reshape(-1, 3)
    low, high = other.min(axis=(0, 1)), other.max(axis=(0, 1))
    near = (np.minimum(starts, ends) <= high).all(axis=1) & (np.maximum(starts, ends) >= low).all(axis=1)
    starts, ends = starts[near], ends[near]
    low, high = part.min(axis=(0, 1)), part.max(axis=(0, 1))
    faces = other[(other.min(axis=1) <= high).all(axis=1) & (other.max(axis=1) >= low).all(axis=1)]
    if not len(starts) or not len(faces):
        return False
    step = max(1, len(starts) * len(faces) // _PAIRS)
    least = _TOUCHING * max(float(np.ptp(x, axis=(0, 1)).max()) for x in (part, other)) ** 3
    starts, ends = starts[::step], ends[::step]
    portion = max(1, _AT_ONCE // len(faces))
    for k in range(0, len(starts), portion):
        p, q = starts[k : k + portion], ends[k : k + portion]
        edge, face = _boxes_meet(np.minimum(p, q), np.maximum(p, q), faces.min(axis=1), faces.max(axis=1))
        if _pierced(p[edge], q[edge], faces[face], least).any():
            return True
    return False


def _boxes_meet(low: Array, high: Array, other_low: Array, other_high: Array) -> tuple[Array, Array]:
    """The pairs of boxes (m, 3) and (n, 3) that have a point in common."""
    meet = np.ones((len(low), len(other_low)), bool)
    for axis in range(3):
        meet &= low[:, None, axis] <= other_high[None, :, axis]
        meet &= other_low[None, :, axis] <= high[:, None, axis]
    first, second = np.nonzero(meet)
    return first, second


def _pierced(p: Array, q: Array, faces: Array, least: float) -> Array:
    """Whether each edge from p to q (n, 3) goes through its face (n, 3, 3), by more than touching it."""
    a, b, c = np.moveaxis(faces, 1, 0)
    normal = np.cross(b - a, c - a)
    before, after = (((x - a) * normal).sum(axis=1) for x in (p, q))
    through = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > least)
    sides = [((q - p) * np.cross(x - p, y - p)).sum(axis=1) for x, y in ((a, b), (b, c), (c, a))]
    return np.asarray(through & ((np.min(sides, axis=0) > least) | (np.max(sides, axis=0) < -least)))
