"""Shapes of a link as points and uniform solids in its frame, and the nearest physically consistent tensor."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from ..core.errors import ModelWarning, TwistWrenchError, ValueRangeError
from ..core.typing import Array
from ..formats.source import find_resource
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.bodies.mesh import convex_hull
from ..mechanics.bodies.mesh_files import SUFFIXES
from ..mechanics.bodies.solids import clipped, rotational_inertia, second_moments
from . import surface

_LARGEST = 200 * 2**20
"""Largest mesh file that is read [bytes]."""


@dataclass(frozen=True, eq=False)
class ShapeSpec:
    """Shape as described in a file."""

    kind: str
    """box, sphere, cylinder, capsule, ellipsoid, mesh, or an unsupported kind."""
    sizes: tuple[float, ...]
    """Edges; radius; radius and length; semi-axes; or the scale of a mesh."""
    pose: Array
    """Pose (4, 4) in the link's frame."""
    file: str = ""
    """File name of a mesh, as in the robot file."""
    role: str = "visual"
    """visual or collision."""


@dataclass(frozen=True, eq=False)
class Solid:
    """Shape that was read."""

    spec: ShapeSpec
    points: Array
    """Corners (n, 3) in the link's frame [m]."""
    inertia: SpatialInertia | None
    """Inertia of the uniform solid at 1 kg/m³; for a mesh, of its convex hull. None without volume."""
    path: Path | None = None
    """File of a mesh."""


@dataclass(frozen=True, eq=False)
class LinkShapes:
    """All shapes of a link."""

    specs: tuple[ShapeSpec, ...] = ()
    solids: tuple[Solid, ...] = ()

    @property
    def complete(self) -> bool:
        """True if there are shapes and all were read."""
        return bool(self.specs) and len(self.solids) == len(self.specs)

    @cached_property
    def points(self) -> Array:
        """Corners (n, 3) of all shapes, in the link's frame [m]."""
        return np.concatenate([np.zeros((0, 3)), *(solid.points for solid in self.solids)])

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box along the link's axes [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    @cached_property
    def uniform(self) -> SpatialInertia | None:
        """Inertia of the visuals, or else the colliders, as solids at 1 kg/m³; None without volume."""
        for role in ("visual", "collision"):
            mine = [s.inertia for s in self.solids if s.spec.role == role and s.inertia is not None]
            if mine:
                return sum(mine, SpatialInertia.zero())
        return None

    def tensor(self, mass: float) -> Array | None:
        """Tensor (3, 3) of the solids for another mass, about their centre of mass, along the link's axes [kg m²]."""
        if self.uniform is None:
            return None
        return np.asarray(self.uniform.moment_about_com * (mass / self.uniform.mass))

    def box(self, axes: Array) -> tuple[Array, Array]:
        """Smallest and largest coordinates (3,) of the corners along axes (3, 3), columns in the link's frame [m]."""
        along = self.points @ axes
        return along.min(axis=0), along.max(axis=0)


@dataclass(eq=False)
class ShapeReader:
    """Reader of the shapes of links; each mesh is read once."""

    path: Path | None
    """The robot's file, relative to which meshes are searched; None without a file."""
    folders: Sequence[Path] = ()
    """Additional search folders; meshes are found by name or by their path within the package."""
    meshes: bool = True
    _known: dict[str, Array | None] = field(default_factory=dict)

    def read(self, specs: Sequence[ShapeSpec]) -> LinkShapes:
        """Read shapes; ``solids`` omits those that cannot be read."""
        found = [self._solid(spec) for spec in specs]
        return LinkShapes(tuple(specs), tuple(solid for solid in found if solid is not None))

    def _solid(self, spec: ShapeSpec) -> Solid | None:
        known = self._mesh(spec) if spec.kind == "mesh" else _simple(spec.kind, spec.sizes)
        if known is None:
            return None
        corners, inertia = known
        points = corners @ spec.pose[:3, :3].T + spec.pose[:3, 3]
        path = self._find(spec.file) if spec.kind == "mesh" else None
        return Solid(spec, points, None if inertia is None else inertia.in_frame(spec.pose), path)

    def _mesh(self, spec: ShapeSpec) -> tuple[Array, SpatialInertia | None] | None:
        """Corners (n, 3) and hull of a mesh; None if it is missing or cannot be read."""
        if spec.file not in self._known:
            self._known[spec.file] = self._read(spec.file) if self.meshes else None
        corners = self._known[spec.file]
        if corners is None:
            return None
        corners = corners * np.asarray(spec.sizes)
        return corners, hull_solid(corners)

    def _read(self, name: str) -> Array | None:
        """Corners of a mesh's hull, in the units of the mesh."""
        path = self._find(name)
        try:
            if path is None or path.stat().st_size > _LARGEST:
                return None
            points = np.concatenate([part.vertices for part, _ in surface.read_mesh(path)])
        except (TwistWrenchError, OSError):
            return None
        hull = convex_hull(points)
        return points if hull is None else hull[0]

    def _find(self, name: str) -> Path | None:
        found = None if self.path is None else find_resource(name, self.path)
        if found is not None:
            return found
        parts = [part for part in name.partition("://")[2].split("/") or [name] if part] or name.split("/")
        if ".." in parts:
            return None
        for folder in self.folders:
            for k in range(len(parts)):
                place = folder.joinpath(*parts[k:])
                if place.suffix.lower() in SUFFIXES and place.is_file():
                    return place
        return None


def _simple(kind: str, sizes: tuple[float, ...]) -> tuple[Array, SpatialInertia] | None:
    """Corners and uniform solid at 1 kg/m³; None for unsupported kinds and for shapes without volume."""
    if not sizes or min(sizes) <= 0 or max(sizes) > 1e6:
        return None
    if kind not in _SOLIDS:
        return None
    skin, solid = _SOLIDS[kind]
    numbers = (sizes,) if kind in ("box", "ellipsoid") else sizes
    return skin(*numbers).vertices, solid(*numbers, density=1.0)


_SOLIDS: Mapping[str, tuple[Callable[..., surface.Surface], Callable[..., SpatialInertia]]] = {
    "box": (surface.box, SpatialInertia.box),
    "sphere": (surface.sphere, SpatialInertia.sphere),
    "ellipsoid": (surface.ellipsoid, SpatialInertia.ellipsoid),
    "cylinder": (surface.cylinder, SpatialInertia.cylinder),
    "capsule": (partial(surface.cylinder, round_ends=True), SpatialInertia.capsule),
}
"""Surface and uniform solid of each kind of shape."""


def hull_solid(corners: Array) -> SpatialInertia | None:
    """Uniform convex hull of points (n, 3) at 1 kg/m³; None if it is flat."""
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

# With the second moments S = ½ tr(I) 1 - I: I is physically consistent if S is positive semidefinite.

METRICS = {
    "frobenius": "second moments, Frobenius norm",
    "entropic": "log-det divergence from the tensor of its shapes",
}
"""Metrics with their full names."""
_THINNEST = 1e-4
"""Smallest second moment relative to their sum, so that rounding to ten digits does not make it negative."""
_WEIGHT = 0.01
"""Weight of the divergence relative to the squared distance."""


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
    return rotational_inertia(clipped(S, _THINNEST) if metric == "frobenius" else _drawn_in(S, reference))


def _drawn_in(S: Array, reference: Array | None) -> Array:
    size = max(abs(float(S.trace())), float(np.abs(S).max()), 1e-300)
    shape = np.eye(3) * size / 3.0 if reference is None else second_moments(reference)
    L = np.linalg.cholesky(clipped(shape, _THINNEST))
    back = np.linalg.inv(L)
    x, axes = np.linalg.eigh(back @ S @ back.T)
    # x - x_0 + w (1 - 1/x) = 0
    b = x - _WEIGHT
    x = np.maximum(0.5 * (b + np.sqrt(b * b + 4.0 * _WEIGHT)), _THINNEST)
    half = L @ axes
    return np.asarray((half * x) @ half.T)
