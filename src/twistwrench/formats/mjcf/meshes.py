"""Meshes that inertia is computed of: opened only then, and only inside the robot's folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...bodies.hull import hull_faces
from ...bodies.inertia import SpatialInertia
from ...core.files import read_bytes
from ...core.foreign_errors import foreign_errors
from ...errors import RobotFileError, TwistWrenchError
from ...lie import quaternion
from ...typing import Array
from ..element import Element
from .defaults import Defaults
from .includes import Folders
from .settings import Settings

_MODES = ("legacy", "exact", "convex", "shell")


class Meshes:
    """The meshes of a file's ``<asset>``, by name."""

    def __init__(self, root: Element, settings: Settings, defaults: Defaults, folders: Folders) -> None:
        self._settings, self._folders = settings, folders
        self._meshes: dict[str, Element] = {}
        self._doubled: dict[str, Element] = {}
        self._hfields: dict[str, Element] = {}
        for asset in root.all("asset"):
            for hfield in asset.all("hfield"):
                name = hfield.attributes.get("name", "").strip() or Path(hfield.attributes.get("file", "")).stem
                self._hfields[name] = hfield
            for mesh in asset.all("mesh"):
                name = mesh.attributes.get("name", "").strip() or Path(mesh.attributes.get("file", "")).stem
                if name in self._meshes:
                    self._doubled[name] = mesh
                self._meshes[name] = defaults.apply(mesh)

    def half_sizes_of_hfield(self, geom: Element) -> list[float]:
        """Half sizes of the box about its origin by which MuJoCo weighs a height field, whatever its heights.

        Raises :class:`~twistwrench.RobotFileError` naming the geom if the height field is missing.
        """
        name = geom.text("hfield")
        if name not in self._hfields:
            raise RobotFileError(f"{geom} shows the height field {name!r}, which no <asset> describes.")
        x, y, top, bottom = self._hfields[name].values("size", 4)
        return [x, y, 0.25 * top + 0.5 * bottom]

    def inertia(self, geom: Element, *, mass: float | None = None, density: float | None = None) -> SpatialInertia:
        """That of a mesh geom in the mesh's own frame, as MuJoCo has it.

        Raises :class:`~twistwrench.RobotFileError` naming the geom where the mesh is not there or cannot be read.
        """
        name = geom.text("mesh")
        if name not in self._meshes:
            known = ", ".join(repr(one) for one in list(self._meshes)[:12]) or "none"
            raise RobotFileError(f"{geom} shows the mesh {name!r}, which no <asset> describes. Known: {known}.")
        if name in self._doubled:
            raise RobotFileError(
                f"{geom} shows the mesh {name!r}, and {self._doubled[name]} is the second one of that name."
            )
        element = self._meshes[name]
        vertices, faces = self._surface(element, geom)
        mode = element.word("inertia", _MODES, "legacy")
        if mode == "shell":
            raise RobotFileError(
                f"{element} is a shell, whose inertia is not computed. Give the body of {geom} an <inertial>."
            )
        if mode == "convex":
            faces = _hull(vertices, element)
        if mode == "legacy":
            volume, found = _legacy(vertices[faces])
        else:
            volume, found = _solid(vertices[faces], np.zeros(3), signed=True)
        if not volume > 0:
            raise RobotFileError(f"{element} encloses no volume. Give the body of {geom} an <inertial>.")
        weight = mass if mass is not None else volume * float(density or 0.0)
        return SpatialInertia.from_parameters(found * (weight / volume))

    def _surface(self, element: Element, geom: Element) -> tuple[Array, Array]:
        """Vertices (n, 3) [m] in the frame that geoms place, and triangles (k, 3)."""
        if "file" in element.attributes:
            vertices, faces = self._read(element, geom)
        elif "vertex" in element.attributes:
            vertices = _triples(element, "vertex")
            faces = _triples(element, "face").astype(int) if "face" in element.attributes else _hull(vertices, element)
        else:
            raise RobotFileError(f"{element} has neither a file nor vertices, so the mass of {geom} is not known.")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise RobotFileError(f"{element} has faces of vertices that are not there.")
        place, turn = element.floats("refpos", (0.0, 0.0, 0.0)), element.floats("refquat", (1.0, 0.0, 0.0, 0.0))
        vertices = vertices.astype(np.float32).astype(float)  # as MuJoCo keeps them
        moved = (vertices - place) @ quaternion.rotation(turn)
        scale = element.floats("scale", (1.0, 1.0, 1.0))
        if np.prod(scale) < 0:  # a mirror image has its inside outside
            faces = faces[:, [0, 2, 1]]
        return np.asarray(moved * scale), faces

    def _read(self, element: Element, geom: Element) -> tuple[Array, Array]:
        name = element.text("file").replace("\\", "/")
        name = name.rpartition("/")[2] if self._settings.plain_names else name
        folder = self._settings.mesh_folder.replace("\\", "/").rstrip("/")
        try:
            path = self._folders.find(f"{folder}/{name}" if folder else name, element)
        except RobotFileError as error:
            raise RobotFileError(
                f"the mass of {geom} is that of a mesh, and {error} Put the mesh there, or give the body an <inertial>."
            ) from None
        from ...bodies.mesh import read_surface

        try:
            return _msh(path) if path.suffix.lower() == ".msh" else read_surface(path)
        except TwistWrenchError as error:
            raise RobotFileError(f"{element}: {error}") from None


def _triples(element: Element, attribute: str) -> Array:
    count = len(element.text(attribute).split())
    if count % 3:
        raise RobotFileError(f"{element} has {count} numbers in {attribute}, which is no multiple of three.")
    return element.numbers(attribute, count).reshape(-1, 3)


def _msh(path: Path) -> tuple[Array, Array]:
    """MuJoCo's own binary format: four counts, then vertices, normals and texture coordinates as float32, and faces."""
    with foreign_errors(lambda reason: RobotFileError(f"{path.name} cannot be read as a mesh: {reason}.")):
        data = read_bytes(path)
    counts = np.frombuffer(data[:16], "<i4").astype(int)
    vertices, normals, textures, faces = counts if counts.size == 4 else (0, 0, 0, 0)
    size = 16 + 4 * (3 * vertices + 3 * normals + 2 * textures + 3 * faces)
    if counts.size != 4 or counts.min() < 0 or not vertices or not faces or size != len(data):
        raise RobotFileError(
            f"{path.name} is no mesh of MuJoCo's: its counts and its size, {len(data)} bytes, do not agree."
        )
    places = np.frombuffer(data, "<f4", 3 * vertices, 16).astype(float)
    if not np.isfinite(places).all():
        raise RobotFileError(f"{path.name} has vertices that are not finite.")
    numbers = np.frombuffer(data, "<i4", 3 * faces, size - 12 * faces).astype(int)
    return places.reshape(-1, 3), numbers.reshape(-1, 3)


def _hull(vertices: Array, element: Element) -> Array:
    """The triangles (k, 3) of the convex hull, seen from outside."""
    faces = hull_faces(vertices)
    if faces is None:
        raise RobotFileError(f"{element} has no convex hull: its vertices lie in a plane, or are too few.")
    return faces


def _solid(corners: Array, about: Array, *, signed: bool) -> tuple[float, Array]:
    """Volume, and the ten parameters at density one, of pyramids from a point to the triangles (k, 3, 3).

    ``signed`` takes those off that lie on the outer side of their triangle; else every one counts as solid.
    """
    a, b, c = np.moveaxis(corners - about, 1, 0)
    volumes = (a * np.cross(b, c)).sum(axis=1) / 6.0
    volumes = volumes if signed else np.abs(volumes)
    total = (a + b + c) / 4.0
    h = volumes @ total
    # ∫ r r' of a tetrahedron with one corner at the origin: V/20 (Σ x x' + s s'), s the sum of the corners x.
    s = a + b + c
    S = sum(np.einsum("k,ki,kj->ij", volumes, x, x) for x in (a, b, c, s)) / 20.0
    V = float(volumes.sum())
    S = S + np.outer(h, about) + np.outer(about, h) + V * np.outer(about, about)
    h = h + V * about
    I = np.trace(S) * np.eye(3) - S
    return V, np.array([V, *h, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])


def _legacy(corners: Array) -> tuple[float, Array]:
    """MuJoCo's way: pyramids from the surface's own centre, then from their centre of mass, none taken off."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2.0
    centre = area @ corners.mean(axis=1) / area.sum()
    first, pyramids = _solid(corners, centre, signed=False)
    com = pyramids[1:4] / first
    V, about = _solid(corners - com, np.zeros(3), signed=False)
    moments = np.array([[about[4], about[5], about[7]], [about[5], about[6], about[8]], [about[7], about[8], about[9]]])
    return V, np.asarray(SpatialInertia.from_com(V, com, moments).parameters)
