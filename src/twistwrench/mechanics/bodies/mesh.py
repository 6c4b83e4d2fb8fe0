"""Inertia of uniform solids bounded by triangle meshes, and convex hulls of points.

The integral over a shell is the signed sum over the tetrahedra that its faces form with one fixed point. Integrals over a
tetrahedron are polynomials of its corners. Source: Blow and Binstock, "How to find the inertia tensor (or other mass
properties) of a 3D solid body represented by a triangle mesh", 2004. Shells that bound solids are added, shells that bound
cavities are subtracted: :mod:`twistwrench.mechanics.bodies.solids`.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ModelError, ModelWarning, ShapeError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import printed
from ...core.typing import Array
from .mesh_files import read_parts
from .shells import edges_of, nest, shell_numbers
from .solids import rotational_inertia, total_mass

_MIN_EXTENT = 1e-4
_MAX_EXTENT = 10.0
"""Plausible extent of a robot part [m]. A part drawn in millimetres but read in metres is 1000 times too large."""
_MIN_DENSITY = 1.0
_MAX_DENSITY = 23_000.0
"""Plausible density [kg/m³], from thin shells filled with air to osmium."""
_MIN_VOLUME_EDGE = 1e-5
"""Least edge of a cube of a solid's volume, as a share of the solid's extent; below it, the volume is a rounding error."""
_MAX_EXAMPLES = 3
"""Number of edges that an error message names."""
_VERTEX_TOLERANCE = 1e-8
"""Distance below which vertices count as one, in the units of the mesh."""


def mass_com_and_inertia(
    surface: str | Path | tuple[ArrayLike, ArrayLike], mass: float | None, density: float | None, scale: float
) -> tuple[float, Array, Array]:
    """Mass, centre of mass, and rotational inertia about that point, of a uniform solid, as for ``SpatialInertia.mesh``.

    With the corners a_i of a tetrahedron whose fourth corner is the origin, their sum s, and d = det(a_1, a_2, a_3), the
    integrals of 1, r and r r' over its volume are d/6, d s/24 and d (Σ a_i a_i' + s s')/120.
    """
    scale_number = arguments.number(scale, "mesh: scale")
    if not 0.0 < scale_number < np.inf:
        raise ValueRangeError(f"mesh: scale is {scale}, and must be positive and finite.")
    name, vertices, faces = _read(surface)
    _require_closed(name, vertices, faces)
    vertices = scale * vertices
    shell_count, shell_of_face = shell_numbers(faces)
    centre = vertices[faces].mean(axis=(0, 1))  # near the solid, against rounding errors of distant meshes
    corners = (vertices - centre)[faces]
    oriented_determinants = np.linalg.det(corners)  # six times the signed volume of each tetrahedron
    shell_volumes = np.bincount(shell_of_face, oriented_determinants, shell_count) / 6.0
    extent = float(np.ptp(vertices[faces], axis=(0, 1)).max())
    is_inverted = shell_volumes < 0  # the shell's faces are oriented inwards
    outward_triangles = np.where(is_inverted[shell_of_face, None, None], corners[:, ::-1], corners)
    shell_signs = _signs_of_shells(name, outward_triangles, shell_of_face, shell_count)
    signs = np.where(is_inverted, -1.0, 1.0) * shell_signs
    determinants = signs[shell_of_face] * oriented_determinants
    volume = determinants.sum() / 6.0
    min_edge = _MIN_VOLUME_EDGE * extent
    if not math.isfinite(volume) or not math.cbrt(volume) > min_edge:
        raise ModelError(f"{name} encloses no volume ({printed(volume, 3)} m³).")
    corner_sums = corners.sum(axis=1)
    h = determinants @ corner_sums / 24.0  # ∫ r
    products_of_corners = np.einsum("k,kia,kib->ab", determinants, corners, corners)  # Σ d a_i a_i'
    products_of_sums = np.einsum("k,ka,kb->ab", determinants, corner_sums, corner_sums)  # Σ d s s'
    S = (products_of_corners + products_of_sums) / 120.0  # ∫ r r'
    m = total_mass("mesh", float(volume), mass, density)
    rho = m / volume
    c = h / volume
    _warn_about_size(name, extent, float(rho), m)
    S_com = rho * S - m * np.outer(c, c)
    return m, c + centre, rotational_inertia(S_com)


def _signs_of_shells(name: str, outward_triangles: Array, shell_of_face: Array, shell_count: int) -> Array:
    """1 for each shell that bounds a solid, -1 for each that bounds a cavity; triangles (k, 3, 3) are oriented outwards."""
    if shell_count == 1:
        return np.ones(1)
    nesting = nest(outward_triangles, shell_of_face, shell_count)
    if nesting.cutting:
        warnings.warn(
            f"{name}: of its {shell_count} shells {len(nesting.cutting)} pairs cut each other or coincide; each counts as a "
            "solid, so what they have in common counts twice. Unite them (trimesh.boolean.union can), or give the mass and "
            "check the centre of mass.",
            ModelWarning,
            stacklevel=4,
        )
    return nesting.sign


def _warn_about_size(name: str, extent: float, density: float, mass: float) -> None:
    """Warn about a probable mistake in the unit of length."""
    text = f"{name} is {printed(extent, 3)} m long and weighs {printed(mass, 3)} kg, {printed(density, 3)} kg/m³"
    if not _MIN_EXTENT <= extent <= _MAX_EXTENT:
        advice = "If it is in millimetres, pass scale=0.001" if extent > _MAX_EXTENT else "Check scale"
        warnings.warn(f"{text}: not a plausible size of a robot part. {advice}.", ModelWarning, stacklevel=4)
    elif not _MIN_DENSITY <= density <= _MAX_DENSITY:
        warnings.warn(
            f"{text}: not a plausible density. Check mass, density [kg/m³] and scale.", ModelWarning, stacklevel=4
        )


def _read(surface: str | Path | tuple[ArrayLike, ArrayLike]) -> tuple[str, Array, Array]:
    """Name for messages, vertices (n, 3) and faces (k, 3) of a mesh given as a file or as two arrays."""
    if isinstance(surface, str | Path):
        vertices, faces = read_surface(Path(surface))
        return str(surface), vertices, faces
    try:
        given_vertices, given_faces = surface
        vertices = arguments.real(given_vertices, "vertices")
        faces = np.asarray(given_faces)
    except (TypeError, ValueError):
        raise ShapeError("a mesh is a file name or a pair (vertices (n, 3), faces (k, 3)).") from None
    have_three_columns = vertices.shape[1:] == (3,) and faces.shape[1:] == (3,)
    if not have_three_columns or not faces.size:
        raise ShapeError(f"vertices have shape {vertices.shape} and faces {faces.shape}, expected (n, 3) and (k, 3).")
    are_integers = np.issubdtype(faces.dtype, np.integer)
    if not are_integers or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueRangeError(f"faces must be whole numbers of the {len(vertices)} vertices, 0 to {len(vertices) - 1}.")
    return "the mesh", np.asarray(vertices, float), faces


def read_surface(path: Path) -> tuple[Array, Array]:
    """Vertices (n, 3) and triangles (k, 3) of a file that trimesh reads, with coincident vertices merged."""
    try:
        parts = read_parts(path)
    except ModelError as problem:
        raise ModelError(f"{path} {problem}.") from None
    faces_of_parts = []
    vertex_offset = 0  # number of vertices of the parts before
    for part in parts:
        faces_of_parts.append(part.faces + vertex_offset)
        vertex_offset += len(part.vertices)
    vertices = np.concatenate([part.vertices for part in parts])
    faces = np.concatenate(faces_of_parts)
    # Formats such as STL repeat a vertex in each of its triangles.
    rounded_vertices = np.round(vertices / _VERTEX_TOLERANCE)
    _, kept_rows, new_indices = np.unique(rounded_vertices, axis=0, return_index=True, return_inverse=True)
    return vertices[kept_rows], new_indices.reshape(-1)[faces]


def _require_closed(name: str, vertices: Array, faces: Array) -> None:
    """Raise ModelError unless each edge of a face belongs to exactly one other face, in opposite direction."""
    if not np.isfinite(vertices[faces]).all():
        raise ValueRangeError(f"{name} has corners that are not finite numbers.")
    edges = edges_of(faces)
    start, end = edges.T  # indices of vertices
    keys = start * len(vertices) + end  # a number for each directed edge
    reverse_keys = end * len(vertices) + start
    unique_keys, rows_of_unique_keys, counts = np.unique(keys, return_index=True, return_counts=True)
    unique_edges = edges[rows_of_unique_keys]
    one_sided_edges = unique_edges[~np.isin(unique_keys, reverse_keys)]
    _refuse_edges(name, vertices, one_sided_edges, "is not watertight: {n} edges have a face on one side only")
    repeated_edges = unique_edges[counts > 1]
    defect = "has {n} edges along which two faces run the same way (flipped or doubled)"
    _refuse_edges(name, vertices, repeated_edges, defect)


def _refuse_edges(name: str, vertices: Array, edges: Array, defect: str) -> None:
    """Raise ModelError if there are edges (n, 2) with a defect; ``{n}`` in its text stands for their number."""
    if not len(edges):
        return
    rounded = vertices.round(6)
    examples = "; ".join(f"{rounded[i].tolist()} to {rounded[j].tolist()}" for i, j in edges[:_MAX_EXAMPLES])
    raise ModelError(
        f"{name} {defect.format(n=len(edges))}, the first at {examples}. Close it (trimesh.repair can), or take a solid "
        "that bounds it, such as SpatialInertia.box."
    )


# ── Convex hull of points, as a closed triangle mesh


def hull_faces(points: Array) -> Array | None:
    """Triangles (k, 3) of the convex hull of points (n, 3), oriented outwards; None if the points are coplanar.

    For points (n, 2), the edges (k, 2) in no particular order; None if the points are collinear.

    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> len(hull_faces(corners)), hull_faces(corners[:3])
    (4, None)
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points, qhull_options="Qt")  # triangles only
    except (QhullError, ValueError):
        return None
    faces = np.array(hull.simplices, int)
    in_plane = points.shape[1] == 2
    if in_plane:
        return faces
    a, b, c = np.moveaxis(points[faces], 1, 0)  # first, second and third corner of each face, (k, 3)
    outward_normals = hull.equations[:, :3]
    normals = np.cross(b - a, c - a)
    is_inward = (normals * outward_normals).sum(axis=1) < 0
    faces[is_inward] = faces[is_inward][:, [0, 2, 1]]
    return faces


def convex_hull(points: Array) -> tuple[Array, Array] | None:
    """Vertices (m, 3) and triangles (k, 3) of the convex hull; None if the points are coplanar."""
    faces = hull_faces(points)
    if faces is None:
        return None
    point_indices, new_indices = np.unique(faces, return_inverse=True)
    return points[point_indices], new_indices.reshape(-1, 3)


complete(globals())
