"""Second moments of mass, point masses and uniform solids, and the closed shells of a triangle mesh.

S = ∫ r r' dm and I = tr(S) 1 - S, (3, 3) each. A body can have I if S has no negative eigenvalue.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ShapeError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import printed
from ...core.typing import Array

if TYPE_CHECKING:
    from .inertia import SpatialInertia


def ten_parameters(m: Any, h: Any, I: Array) -> list[Any]:
    """Inertial parameters from a mass, a first moment (3,) and a rotational inertia (3, 3), all about one origin."""
    return [m, *h, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]]


def second_moments(I: Array) -> Array:
    """S = ½ tr(I) 1 - I."""
    return np.asarray(0.5 * I.trace() * np.eye(3) - I)


def rotational_inertia(S: Array) -> Array:
    """I = tr(S) 1 - S."""
    return np.asarray(S.trace() * np.eye(3) - S)


def clip_eigenvalues(S: Array, least: float = 0.0) -> Array:
    """Nearest S in the Frobenius norm with eigenvalues of at least ``least`` times the largest absolute eigenvalue."""
    values, axes = np.linalg.eigh(S)
    return np.asarray(axes * np.maximum(values, least * np.abs(values).max()) @ axes.T)


def moment_matrix(I: ArrayLike) -> Array:
    """Return a rotational inertia (3, 3). For three numbers, the error message shows how to make a diagonal matrix."""
    try:
        return arguments.one(I, "moment_about_com", 3, 3)
    except ShapeError as problem:
        try:
            three = np.shape(I) == (3,)
        except ValueError:  # ragged
            three = False
        hint = " Three moments about the axes are np.diag(…) of them." if three else ""
        raise ShapeError(f"{problem}{hint}") from None


# ── Point masses and uniform solids

# Each function is a named constructor of :class:`~twistwrench.SpatialInertia`, used there as a class method. All solids except
# the mesh are centred: the frame's origin is the centre of mass, the axes are principal, and a symmetry axis is z.
# Moments of the solids: Lynch and Park, Modern Robotics, figure 8.5, and any table of mechanics.


def from_points(cls: type[SpatialInertia], masses: ArrayLike, points: ArrayLike) -> SpatialInertia:
    """Spatial inertia of point masses, about the frame's origin: I = -Σ m_i [r_i]².

    MR section 8.2.1.

    Parameters
    ----------
    masses : (n,) array_like [kg]
    points : (n, 3) array_like [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> G = SpatialInertia.from_points([1.0, 3.0], [[0, 0, 1], [0, 0, -1]])
    >>> G.mass, G.com.tolist(), G.moment_about_origin.diagonal().tolist()
    (4.0, [0.0, 0.0, -0.5], [4.0, 4.0, 0.0])
    """
    m, r = np.asarray(arguments.real(masses, "masses"), float), np.asarray(arguments.real(points, "points"), float)
    if m.ndim != 1 or r.shape != (m.size, 3):
        raise ShapeError(f"masses have shape {m.shape} and points {r.shape}, expected (n,) and (n, 3).")
    bad = np.flatnonzero(~((m >= 0) & (m < np.inf) & np.isfinite(r).all(axis=1)))
    if bad.size:
        i = bad[0]
        raise ValueRangeError(
            f"point {i}, mass {printed(m[i])} kg at {r[i]}, must be finite with a mass of at least 0."
        )
    S = (m * r.T) @ r  # second moments; -[r]² = r'r 1 - r r'
    I = rotational_inertia(S)
    return cls.from_parameters(ten_parameters(m.sum(), m @ r, I))


def box(
    cls: type[SpatialInertia], size: ArrayLike, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform box; the origin is its centre.

    Parameters
    ----------
    size : (3,) array_like, full edge lengths along x, y, z [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.box((1, 2, 3), mass=12).moment_about_com.diagonal().tolist()
    [13.0, 10.0, 5.0]
    """
    a = _lengths("size", size, 3)
    return _solid_about_centre(cls, "box", float(a.prod()), (a @ a - a**2) / 12.0, mass, density)


def ellipsoid(
    cls: type[SpatialInertia], semi_axes: ArrayLike, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform ellipsoid; the origin is its centre.

    Parameters
    ----------
    semi_axes : (3,) array_like, along x, y, z [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.ellipsoid((1, 2, 3), mass=5).moment_about_com.diagonal().tolist()
    [13.0, 10.0, 5.0]
    """
    a = _lengths("semi_axes", semi_axes, 3)
    return _solid_about_centre(
        cls, "ellipsoid", 4.0 / 3.0 * np.pi * float(a.prod()), (a @ a - a**2) / 5.0, mass, density
    )


def sphere(
    cls: type[SpatialInertia], radius: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform ball; the origin is its centre.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.sphere(1.0, mass=5.0).moment_about_com.diagonal().tolist()
    [2.0, 2.0, 2.0]
    """
    (r,) = _lengths("radius", radius, 1)
    return ellipsoid(cls, (r, r, r), mass=mass, density=density)


def cylinder(
    cls: type[SpatialInertia], radius: float, length: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform cylinder along z; the origin is its centre.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.cylinder(2.0, 6.0, mass=1.0).moment_about_com.diagonal().tolist()
    [4.0, 4.0, 2.0]
    """
    (r,), (h,) = _lengths("radius", radius, 1), _lengths("length", length, 1)
    across = r * r / 4.0 + h * h / 12.0
    return _solid_about_centre(cls, "cylinder", np.pi * r * r * h, (across, across, r * r / 2.0), mass, density)


def capsule(
    cls: type[SpatialInertia], radius: float, length: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform capsule, a cylinder along z with hemispherical ends; the origin is its centre.

    Parameters
    ----------
    length : float, of the cylinder [m]; the total length is length + 2 radius

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> ball, pill = SpatialInertia.sphere(0.1, density=1e3), SpatialInertia.capsule(0.1, 1e-12, density=1e3)
    >>> bool(np.allclose(ball.parameters, pill.parameters))
    True
    """
    (r,), (h,) = _lengths("radius", radius, 1), _lengths("length", length, 1)
    tube, ball = np.pi * r * r * h, 4.0 / 3.0 * np.pi * r**3
    # The centre of mass of a hemisphere is 3r/8 above its flat face: Steiner from the ball's centre to there, and on by h/2.
    across = tube * (r * r / 4.0 + h * h / 12.0) + ball * (2.0 / 5.0 * r * r + h * h / 4.0 + 3.0 / 8.0 * h * r)
    along = tube * r * r / 2.0 + ball * 2.0 / 5.0 * r * r
    return _solid_about_centre(
        cls, "capsule", tube + ball, np.array([across, across, along]) / (tube + ball), mass, density
    )


def cone(
    cls: type[SpatialInertia], radius: float, height: float, *, mass: float | None = None, density: float | None = None
) -> SpatialInertia:
    """Spatial inertia of a uniform cone whose tip points along +z.

    The origin is its centre of mass, height/4 above the base, not the base itself.

    Parameters
    ----------
    radius : float, of the base [m]
    height : float [m]

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> SpatialInertia.cone(2.0, 4.0, mass=10.0).moment_about_com.diagonal().tolist()
    [12.0, 12.0, 12.0]
    """
    (r,), (h,) = _lengths("radius", radius, 1), _lengths("height", height, 1)
    across = 3.0 / 20.0 * r * r + 3.0 / 80.0 * h * h
    return _solid_about_centre(
        cls, "cone", np.pi / 3.0 * r * r * h, (across, across, 3.0 / 10.0 * r * r), mass, density
    )


def total_mass(shape: str, volume: float, mass: float | None, density: float | None) -> float:
    """Mass [kg] of ``volume`` [m³] from exactly one of mass and density, both positive and finite."""
    if (mass is None) == (density is None):
        count = "neither" if mass is None else "both"
        raise ValueRangeError(f"{shape}: give mass= [kg] or density= [kg/m³], exactly one of them; got {count}.")
    name, number = ("mass", mass) if mass is not None else ("density", density)
    value = arguments.number(number, f"{shape}: {name}")
    if not 0.0 < value < np.inf:
        raise ValueRangeError(f"{shape}: {name} is {value}, and must be positive and finite.")
    return value if name == "mass" else value * volume


def _lengths(name: str, value: ArrayLike, count: int) -> Array:
    a = arguments.one(value, name, count) if count > 1 else np.array([arguments.number(value, name)])
    if not ((a >= 1e-100) & (a <= 1e100)).all():  # outside this range, squares and products overflow or underflow
        text = a.tolist() if count > 1 else a[0]
        raise ValueRangeError(f"{name} is {text}; lengths must be positive and finite, 1e-100 to 1e100 m.")
    return a


def _solid_about_centre(
    cls: type[SpatialInertia], shape: str, volume: float, moments: ArrayLike, mass: float | None, density: float | None
) -> SpatialInertia:
    """Solid about its centre, from its principal moments per unit mass."""
    m = total_mass(shape, float(volume), mass, density)
    return cls.from_com(m, moment_about_com=m * np.diag(np.asarray(moments, float)))


# ── Closed shells of a triangle mesh: connected faces, nesting and intersections

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
