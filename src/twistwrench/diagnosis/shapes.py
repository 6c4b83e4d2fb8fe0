"""Shapes of a link as points and uniform solids in its frame, and the nearest tensor that a body can have."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..bodies.mesh import convex_hull
from ..bodies.solids import clipped, rotational_inertia, second_moments
from ..errors import ModelWarning, TwistWrenchError, ValueRangeError
from ..formats.source import MESHES, find_resource
from ..typing import Array
from ..viz import surface

_LARGEST = 200 * 2**20
"""Bytes of a mesh file that is opened."""


@dataclass(frozen=True, eq=False)
class ShapeSpec:
    """A shape as a file has it."""

    kind: str
    """box, sphere, cylinder, capsule, ellipsoid, mesh, or another that is not read."""
    sizes: tuple[float, ...]
    """Edges; radius; radius and length; semi-axes; or the scale of a mesh."""
    pose: Array
    """(4, 4) in the link's frame."""
    file: str = ""
    """File name of a mesh, as it is written."""
    role: str = "visual"
    """visual or collision."""


@dataclass(frozen=True, eq=False)
class Solid:
    """One shape that was read."""

    spec: ShapeSpec
    points: Array
    """(n, 3) corners in the link's frame [m]."""
    inertia: SpatialInertia | None
    """Inertia of the uniform solid, the hull for a mesh, at 1 kg/m³; None without volume."""
    path: Path | None = None
    """File of a mesh."""


@dataclass(frozen=True, eq=False)
class LinkShapes:
    """All shapes of a link."""

    specs: tuple[ShapeSpec, ...] = ()
    solids: tuple[Solid, ...] = ()

    @property
    def complete(self) -> bool:
        """True if there are shapes, and every one was read."""
        return bool(self.specs) and len(self.solids) == len(self.specs)

    @cached_property
    def points(self) -> Array:
        """(n, 3) corners of all shapes, in the link's frame [m]."""
        return np.concatenate([np.zeros((0, 3)), *(solid.points for solid in self.solids)])

    @property
    def diagonal(self) -> float:
        """Diagonal of the box along the link's axes [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    @cached_property
    def uniform(self) -> SpatialInertia | None:
        """Visuals, else colliders, as solids at 1 kg/m³; None without volume."""
        for role in ("visual", "collision"):
            mine = [s.inertia for s in self.solids if s.spec.role == role and s.inertia is not None]
            if mine:
                return sum(mine, SpatialInertia.zero())
        return None

    def tensor(self, mass: float) -> Array | None:
        """(3, 3) about the solids' own centre of mass, along the link's axes, at another mass [kg m²]."""
        if self.uniform is None:
            return None
        return np.asarray(self.uniform.moment_about_com * (mass / self.uniform.mass))

    def box(self, axes: Array) -> tuple[Array, Array]:
        """The least and largest coordinates (3,) of the corners along axes (3, 3), columns in the link's frame [m]."""
        along = self.points @ axes
        return along.min(axis=0), along.max(axis=0)


@dataclass(eq=False)
class ShapeReader:
    """Reads the shapes of links, each mesh once."""

    path: Path | None
    """The robot's file, which meshes are looked for around; None for none."""
    folders: Sequence[Path] = ()
    """Other folders where they may be, by their names or by what follows the package's."""
    meshes: bool = True
    _known: dict[str, Array | None] = field(default_factory=dict)

    def read(self, specs: Sequence[ShapeSpec]) -> LinkShapes:
        """Read shapes; those that cannot be read are left out of ``solids``."""
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
        """Corners (n, 3) and hull of a mesh; None where it is not there or cannot be read."""
        if spec.file not in self._known:
            self._known[spec.file] = self._read(spec.file) if self.meshes else None
        corners = self._known[spec.file]
        if corners is None:
            return None
        corners = corners * np.asarray(spec.sizes)
        return corners, hull_solid(corners)

    def _read(self, name: str) -> Array | None:
        """The corners of a mesh's hull in its own units."""
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
                if place.suffix.lower() in MESHES and place.is_file():
                    return place
        return None


def _simple(kind: str, sizes: tuple[float, ...]) -> tuple[Array, SpatialInertia] | None:
    """Corners and the uniform solid at 1 kg/m³; None for what is not read, or has no volume."""
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
"""Skin and uniform solid of each kind of shape."""


def hull_solid(corners: Array) -> SpatialInertia | None:
    """The uniform convex hull of points (n, 3) at 1 kg/m³; None where it is flat."""
    hull = convex_hull(corners)
    if hull is None:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)  # of no usual size: there is a check of its own
            return SpatialInertia.mesh(hull, density=1.0)
    except TwistWrenchError:
        return None


# ── The nearest physically consistent tensor, in a named metric

# With S the second moments, ½ tr(I) 1 - I: a body can have I where S is positive semidefinite.

METRICS = {
    "frobenius": "second moments, Frobenius norm",
    "entropic": "log-det divergence from the tensor of its shapes",
}
"""Metrics with their full names."""
_THINNEST = 1e-4
"""Share of the second moments that the least one keeps, so that ten digits of a file do not lose it again."""
_WEIGHT = 0.01
"""Weight of the divergence beside the squared distance."""


def nearest(tensor: Array, metric: str = "frobenius", reference: Array | None = None) -> Array:
    """The nearest tensor (3, 3) that a body can have.

    ``frobenius`` clips the second moments S. ``entropic`` minimises ½ |X - X_0|² + w (tr X - log det X) with S seen from the
    second moments of ``reference``, X = L⁻¹ S L⁻ᵀ: invariant to units and axes, and always a body with volume (Wensing, Kim
    and Slotine, 2018). Without a reference a ball of the same trace stands for it.
    Raises :class:`~twistwrench.ValueRangeError` for another metric.
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
