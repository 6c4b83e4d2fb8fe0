"""Shapes of a link as points and uniform solids in the link's frame, and the nearest physically consistent tensor."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..core.errors import ModelWarning, TwistWrenchError, ValueRangeError
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.bodies.mesh import convex_hull
from ..mechanics.bodies.solids import clip_eigenvalues, rotational_inertia, second_moments
from . import surface
from .meshes import MeshFiles
from .reader import LinkShapes, ShapeSpec


@dataclass(frozen=True, eq=False)
class Solid:
    """Shape that was read, as points and a uniform solid."""

    shape: ShapeSpec
    points: Array
    """Corners (n, 3) in the link's frame [m]."""
    inertia: SpatialInertia | None
    """Inertia of the uniform solid at 1 kg/m³, for a mesh of its convex hull; None for a shape without volume."""
    surface: surface.Surface | None = None
    """Surface of a mesh, in the units of the mesh."""


@dataclass(frozen=True, eq=False)
class LinkSolids:
    """All shapes of a link, and the solids of those that were read."""

    shapes: tuple[ShapeSpec, ...] = ()
    solids: tuple[Solid, ...] = ()

    @property
    def complete(self) -> bool:
        """True if there are shapes and all were read."""
        return bool(self.shapes) and len(self.solids) == len(self.shapes)

    @cached_property
    def points(self) -> Array:
        """Corners (n, 3) of all shapes, in the link's frame [m]."""
        return np.concatenate([np.zeros((0, 3)), *(solid.points for solid in self.solids)])

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box along the link's axes [m]."""
        if len(self.points):
            return float(np.linalg.norm(np.ptp(self.points, axis=0)))
        return 0.0

    @cached_property
    def uniform(self) -> SpatialInertia | None:
        """Inertia of the visuals as solids at 1 kg/m³, or of the colliders if no visual has a volume; None without volume."""
        for role in ("visual", "collision"):
            solids_of_role = [solid for solid in self.solids if solid.shape.role == role]
            inertias = [solid.inertia for solid in solids_of_role if solid.inertia is not None]
            if inertias:
                return sum(inertias, SpatialInertia.zero())
        return None

    def tensor(self, mass: float) -> Array | None:
        """Tensor (3, 3) of the solids for another mass, about their centre of mass, along the link's axes [kg m²]."""
        if self.uniform is None:
            return None
        return np.asarray(self.uniform.moment_about_com * (mass / self.uniform.mass))

    def box(self, axes: Array) -> tuple[Array, Array]:
        """Smallest and largest coordinates (3,) of the corners along axes (3, 3), columns in the link's frame [m]."""
        coordinates = self.points @ axes
        return coordinates.min(axis=0), coordinates.max(axis=0)


@dataclass(eq=False)
class SolidReader:
    """Solids of shapes; the hull of each mesh is computed once."""

    meshes: MeshFiles | None
    """Files of meshes; None if meshes are not read."""
    _hulls: dict[str, tuple[surface.Surface, Array] | None] = field(default_factory=dict)
    """Result of :meth:`_hull` by the mesh's name."""

    def read(self, link: LinkShapes) -> LinkSolids:
        """Solids of a link; shapes that cannot be read have none."""
        shapes = []
        solids = []
        for shape in link.parts:
            if not shape.kind:
                continue
            shapes.append(shape)
            solid = self._solid(shape)
            if solid is not None:
                solids.append(solid)
        return LinkSolids(tuple(shapes), tuple(solids))

    def _solid(self, shape: ShapeSpec) -> Solid | None:
        """Solid of a shape in the link's frame; None if it cannot be read."""
        parts_of_solid: tuple[Array, SpatialInertia | None, surface.Surface | None] | None
        if shape.kind == "mesh":
            parts_of_solid = self._mesh(shape)
        else:
            parts_of_solid = _primitive_solid(shape.kind, shape.sizes)
        if parts_of_solid is None:
            return None
        corners, inertia, mesh_surface = parts_of_solid  # in the shape's frame
        points = corners @ shape.pose[:3, :3].T + shape.pose[:3, 3]
        if inertia is not None:
            inertia = inertia.in_frame(shape.pose)
        return Solid(shape, points, inertia, mesh_surface)

    def _mesh(self, shape: ShapeSpec) -> tuple[Array, SpatialInertia | None, surface.Surface] | None:
        """Corners (n, 3) of a mesh's hull, its uniform solid, and the mesh's surface; None if the mesh cannot be read."""
        if shape.mesh not in self._hulls:
            self._hulls[shape.mesh] = self._hull(shape.mesh)
        hull = self._hulls[shape.mesh]
        if hull is None:
            return None
        mesh_surface, corners = hull
        corners = corners * np.asarray(shape.sizes)  # the scale of the mesh
        return corners, hull_solid(corners), mesh_surface

    def _hull(self, name: str) -> tuple[surface.Surface, Array] | None:
        """Surface of a mesh and the corners of its hull, in the units of the mesh; None if the mesh cannot be read."""
        if self.meshes is None:
            return None
        try:
            surfaces = [part for part, _ in self.meshes.read(name)]
            mesh_surface = surface.joined(surfaces)
        except (TwistWrenchError, OSError):
            return None
        corners = mesh_surface.vertices
        hull = convex_hull(mesh_surface.vertices)
        if hull is not None:  # a flat mesh has no hull
            corners, _ = hull
        return mesh_surface, corners


_MAX_SIZE = 1e6
"""Largest size of a shape [m] that can be a solid."""


def _primitive_solid(kind: str, sizes: tuple[float, ...]) -> tuple[Array, SpatialInertia, None] | None:
    """Corners, uniform solid at 1 kg/m³, and None in place of a mesh's surface.

    The result is None for unsupported kinds, and for shapes without volume.
    """
    if kind not in _SOLIDS or not sizes:
        return None
    if min(sizes) <= 0 or max(sizes) > _MAX_SIZE:
        return None
    corners = surface.SIMPLE[kind](*sizes).vertices
    return corners, _SOLIDS[kind](*sizes, density=1.0), None


_SOLIDS: Mapping[str, Callable[..., SpatialInertia]] = {
    "box": lambda *edges, density: SpatialInertia.box(edges, density=density),
    "sphere": SpatialInertia.sphere,
    "ellipsoid": lambda *semi_axes, density: SpatialInertia.ellipsoid(semi_axes, density=density),
    "cylinder": SpatialInertia.cylinder,
    "capsule": SpatialInertia.capsule,
}
"""Uniform solid of each kind of shape."""


def hull_solid(corners: Array) -> SpatialInertia | None:
    """Inertia of the convex hull of points (n, 3) at 1 kg/m³; None if the hull is flat."""
    hull = convex_hull(corners)
    if hull is None:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)  # an unusual size is reported by another check
            return SpatialInertia.mesh(hull, density=1.0)
    except TwistWrenchError:
        return None


# ── Nearest physically consistent tensor in a metric

# A rotational inertia I is physically consistent if its second moments S = ½ tr(I) 1 - I are positive semidefinite.

METRICS = {
    "frobenius": "second moments, Frobenius norm",
    "entropic": "log-det divergence from the tensor of its shapes",
}
"""Metrics with their full names."""
_MIN_SHARE_OF_MOMENT = 1e-4
"""Smallest second moment as a share of the sum of the three, so that rounding to ten digits does not make it negative."""
_DIVERGENCE_WEIGHT = 0.01
"""Weight w of the log-det divergence relative to the squared distance."""


def nearest(tensor: Array, metric: str = "frobenius", reference: Array | None = None) -> Array:
    """Nearest physically consistent tensor (3, 3).

    ``frobenius`` clips the second moments S. ``entropic`` minimises ½ |X - X_0|² + w (tr X - log det X) with X = L⁻¹ S
    L⁻ᵀ, S relative to the second moments of ``reference``. It is invariant to units and axes, and the result always has
    a volume (Wensing, Kim and Slotine, 2018). The default reference is a ball with the same trace. Raises
    :class:`~twistwrench.ValueRangeError` for another metric.
    """
    if metric not in METRICS:
        raise ValueRangeError(f"metric={metric!r} is not allowed. Choose from: {', '.join(map(repr, METRICS))}.")
    S = second_moments(tensor)
    if metric == "frobenius":
        return rotational_inertia(clip_eigenvalues(S, _MIN_SHARE_OF_MOMENT))
    return rotational_inertia(_nearest_by_entropy(S, reference))


def _nearest_by_entropy(S: Array, reference: Array | None) -> Array:
    """Nearest second moments in the entropic metric.

    The minimum has the axes of X_0, so each eigenvalue is determined by itself.
    """
    if reference is None:  # a ball
        largest_entry = float(np.abs(S).max())
        trace = max(abs(float(S.trace())), largest_entry, 1e-300)  # above zero, whatever S is
        S_reference = np.eye(3) * trace / 3.0
    else:
        S_reference = second_moments(reference)
    L = np.linalg.cholesky(clip_eigenvalues(S_reference, _MIN_SHARE_OF_MOMENT))
    L_inverse = np.linalg.inv(L)
    x_0, axes = np.linalg.eigh(L_inverse @ S @ L_inverse.T)
    # The positive root of x - x_0 + w (1 - 1/x) = 0, that is x² - b x - w = 0 with b = x_0 - w
    b = x_0 - _DIVERGENCE_WEIGHT
    positive_root = 0.5 * (b + np.sqrt(b * b + 4.0 * _DIVERGENCE_WEIGHT))
    x = np.maximum(positive_root, _MIN_SHARE_OF_MOMENT)
    L_axes = L @ axes
    return np.asarray((L_axes * x) @ L_axes.T)
