"""Settings, includes, default classes and meshes of MJCF, resolved before bodies are read."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.errors import RobotFileError, TwistWrenchError
from ...core.files import read_bytes
from ...core.gravity import GRAVITY
from ...core.text import listed
from ...core.third_party import third_party_errors
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.bodies.mesh import hull_faces
from ...mechanics.bodies.mesh_files import SUFFIXES
from ...mechanics.bodies.solids import ten_parameters
from ...mechanics.lie import quaternion
from ..known_elements import ACTUATORS
from ..source import MAX_BYTES, read_robot_text
from ..xml import Element, parse


@dataclass(frozen=True)
class Settings:
    """The settings of the file's ``<compiler>`` elements, together; defaults are the format's."""

    degrees: bool = True
    euler_sequence: str = "xyz"
    auto_limits: bool = True
    from_geoms: str = "auto"
    """Inertia from geoms: ``true``, ``false``, or ``auto`` for bodies without an ``<inertial>``."""
    groups: tuple[float, ...] = (0.0, 5.0)
    """The first and last group of geoms that have inertia."""
    total_mass: float = -1.0
    """Total mass [kg] that all bodies are scaled to; not scaled if negative."""
    least_mass: float = 0.0
    least_moment: float = 0.0
    balanced: bool = False
    """True if principal moments that violate the triangle inequality are set to their mean."""
    mesh_folder: str = ""
    plain_names: bool = False
    """True if the folders in the names of mesh files are ignored."""
    align_free: bool = False

    @property
    def angle(self) -> float:
        """Radians in the file's unit of angles."""
        if self.degrees:
            return math.pi / 180.0
        return 1.0

    @classmethod
    def from_root(cls, root: Element) -> Settings:
        """Settings of a file; later elements override earlier ones."""
        last, attributes = root, dict[str, str]()
        for element in root.all("compiler"):
            last = element
            attributes |= element.attributes
        one = last.with_attributes(attributes)
        if one.word("coordinate", ("local", "global"), "local") == "global":
            raise RobotFileError(
                f'{one} has coordinate="global", which MuJoCo dropped too. Write poses relative to the parent body.'
            )
        sequence = one.attributes.get("eulerseq", "xyz").strip()
        if len(sequence) != 3 or set(sequence) - set("xyzXYZ"):
            raise RobotFileError(
                f'{one} has eulerseq="{sequence}": three of the letters x, y, z, X, Y, Z are expected.'
            )
        return cls(
            degrees=one.word("angle", ("degree", "radian"), "degree") == "degree",
            euler_sequence=sequence,
            auto_limits=one.flag("autolimits", default=True),
            from_geoms=one.word("inertiafromgeom", ("true", "false", "auto"), "auto"),
            groups=tuple(one.floats("inertiagrouprange", (0.0, 5.0))),
            total_mass=one.floats("settotalmass", (-1.0,))[0],
            least_mass=one.floats("boundmass", (0.0,))[0],
            least_moment=one.floats("boundinertia", (0.0,))[0],
            balanced=one.flag("balanceinertia", default=False),
            mesh_folder=one.attributes.get("meshdir", one.attributes.get("assetdir", "")).strip(),
            plain_names=one.flag("strippath", default=False),
            align_free=one.flag("alignfree", default=False),
        )


def disabled_by(root: Element) -> set[str]:
    """Forces that the flags of ``<option>`` disable: gravity, spring, damper, equality and others."""
    disabled: set[str] = set()
    for option in root.all("option"):
        for flag in option.all("flag"):
            for name, value in flag.attributes.items():
                if value.strip() == "disable":
                    disabled.add(name)
                elif value.strip() == "enable":
                    disabled.discard(name)
    for group, forces in (("passive", {"spring", "damper"}), ("constraint", {"equality", "frictionloss"})):
        if group in disabled:
            disabled |= forces
    return disabled


def gravity_of(root: Element) -> list[float]:
    """Gravity (3,) [m/s²], zero if a flag disables it."""
    gravity = list(GRAVITY)
    for option in root.all("option"):
        gravity = option.floats("gravity", gravity)
    if "gravity" in disabled_by(root):
        return [0.0, 0.0, 0.0]
    return gravity


def fluid_of(root: Element) -> Element | None:
    """The ``<option>`` that gives the medium a density or a viscosity."""
    fluid = None
    for option in root.all("option"):
        if option.floats("density", (0.0,))[0] or option.floats("viscosity", (0.0,))[0]:
            fluid = option
    return fluid


_MAX_DEPTH_OF_INCLUDES = 16
_ROOTS = ("mujoco", "mujocoinclude")


class Folders:
    """Folders from which a robot file may read other files; none for a robot given as text."""

    def __init__(self, home: Path | None, others: Sequence[Path] = ()) -> None:
        folders = list(others)
        if home is not None:
            folders.insert(0, home)
        self.allowed = [folder.resolve() for folder in folders]

    def find(self, name: str, asked: Element, near: Path | None = None) -> Path:
        """Find the file ``name`` in the robot's folder, beside the including file, then in the other folders.

        Raises :class:`~twistwrench.RobotFileError`, naming the element, for absolute paths, addresses, files outside the
        folders, and missing files.
        """
        if not name or "\0" in name or name.startswith(("/", "\\")) or re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", name):
            raise asked.error(f"names the file {name[:200]!r}: only paths below the robot's own folder are read.")
        if not self.allowed:
            raise asked.error(
                f"names the file {name[:200]!r}, and a robot given as text has no folder. Load it from its path, or "
                "pass include_paths=[folder]."
            )
        home, *others = self.allowed
        folders = [home, *others]
        if near is not None:
            folders = [home, near, *others]
        try:
            places = [(folder / name).resolve() for folder in folders]
            within = list(filter(self._is_allowed, places))
            files = [path for path in within if path.is_file()]
        except (OSError, RuntimeError):  # a link to itself is a RuntimeError before Python 3.13
            within, files = [Path(name)], []
        if files:
            return files[0]
        if not within:
            raise asked.error(
                f"names the file {name[:200]!r}, which lies outside the robot's folder. If it is to be read, pass "
                "include_paths=[its folder]."
            )
        raise asked.error(f"names the file {name[:200]!r}, which is not there.")

    def _is_allowed(self, place: Path) -> bool:
        """True if a resolved path lies below one of the folders."""
        return any(place.is_relative_to(folder) for folder in self.allowed)


def expand(root: Element, folders: Folders, max_bodies: int) -> None:
    """Replace ``<include>`` elements in ``root`` by the elements of the files they name.

    Raises :class:`~twistwrench.RobotFileError` for files outside the folders, files included twice, and too many of them.
    """
    included: dict[Path, Element] = {}
    total = 0
    stack: list[tuple[Element, int, Path | None]] = [(root, 0, None)]
    while stack:
        element, depth, near = stack.pop()
        children: list[Element] = []
        waiting = [(child, depth, near) for child in reversed(element.children)]
        while waiting:
            child, level, folder = waiting.pop()
            if child.tag != "include":
                child.parent = element
                children.append(child)
                if child.children:
                    stack.append((child, level, folder))
                continue
            if level == _MAX_DEPTH_OF_INCLUDES:
                raise child.error(
                    f"is the {_MAX_DEPTH_OF_INCLUDES + 1}th include inside includes; {_MAX_DEPTH_OF_INCLUDES} are allowed."
                )
            path = folders.find(child.text("file"), child, folder)
            if path in included:
                raise child.error(
                    f"includes {child.text('file')!r} again, after {included[path]}. Each file may be included once."
                )
            included[path] = child
            total += path.stat().st_size
            if total > MAX_BYTES:
                raise RobotFileError(f"{child}: the included files have more than {MAX_BYTES // 2**20} MiB together.")
            part = _part(path, child, max_bodies)
            waiting.extend((element, level + 1, path.parent) for element in reversed(part.children))
        element.children = children


def _part(path: Path, asked: Element, max_bodies: int) -> Element:
    name = asked.text("file")
    try:
        part = parse(read_robot_text(path)[0], name, max_bodies)
    except RobotFileError as error:
        raise asked.error(f"→ {name}: {error}") from None
    if part.tag not in _ROOTS:
        raise asked.error(
            f"includes {name!r}, whose root element is <{part.tag}>, expected <mujocoinclude> or <mujoco>."
        )
    return part


# A class begins as a copy of the class it stands in, whatever the order in the file. An element takes the class it names, else
# the ``childclass`` of the nearest body or frame around it, else the outermost class, ``main``.

SHORTCUT = "the shortcut"
"""Key beside the attributes of an actuator: the element that defines their meaning."""

_TURNED = {"quat", "axisangle", "xyaxes", "zaxis", "euler"}
_MAIN = "main"


class Defaults:
    """The classes of a file, by name."""

    def __init__(self, root: Element) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {_MAIN: {}}
        stack = [(element, "") for element in reversed(root.all("default"))]
        while stack:
            element, parent = stack.pop()
            name = element.attributes.get("class", "").strip()
            if not name and not parent:
                name = _MAIN
            if not name:
                raise element.error(f"lies in the class {parent!r} and has no name of its own. Give it class=….")
            if parent and name in self._classes:
                raise element.error(f"is the second class called {name!r}. Rename one.")
            if not parent and name != _MAIN:
                raise element.error(f"is called {name!r}; the outermost class is {_MAIN!r}. Put it into that one.")
            start = self._classes.get(parent or name, {})
            defaults = {tag: dict(attributes) for tag, attributes in start.items()}
            for child in element.children:
                if child.tag != "default":
                    key = _key(child.tag)
                    defaults[key] = merge_defaults(defaults.get(key, {}), child)
            self._classes[name] = defaults
            stack.extend((child, name) for child in reversed(element.all("default")))

    def apply(self, element: Element, around: str = "", kind: str = "") -> Element:
        """Element completed by the attributes of its class; ``around`` is the childclass it stands in.

        ``kind`` is what the defaults are called where that is not the element's own tag.
        """
        name = element.attributes.get("class", "").strip() or around or _MAIN
        self._check(element, name, "is of the class")
        default = self._classes[name].get(kind or _key(element.tag))
        if not default and element.tag not in ACTUATORS:
            return element
        return element.with_attributes(merge_defaults(default, element))

    def check(self, element: Element, name: str) -> str:
        """``name`` if there is such a class, or where it is empty."""
        if name:
            self._check(element, name, "has the childclass")
        return name

    def _check(self, element: Element, name: str, verb: str) -> None:
        if name not in self._classes:
            known = listed(map(repr, self._classes))
            raise element.error(f"{verb} {name!r}, which no <default> describes. Known: {known}.")


def merge_defaults(default: dict[str, str] | None, element: Element) -> dict[str, str]:
    """Attributes of an element over those of a class; an orientation, written in five ways, replaces all of them."""
    own = element.attributes
    attributes = dict(default or {})
    if not own.keys().isdisjoint(_TURNED):
        attributes = {name: value for name, value in attributes.items() if name not in _TURNED}
    if element.tag in ACTUATORS:
        shortcut = element.tag
        if shortcut == "general":
            shortcut = attributes.get(SHORTCUT, "general")
        return {**attributes, **own, SHORTCUT: shortcut}
    return {**attributes, **own}


def _key(tag: str) -> str:
    """Name under which defaults of an element are kept: one for all kinds of actuators."""
    if tag in ACTUATORS:
        return "actuator"
    return tag


_MODES = ("legacy", "exact", "convex", "shell")


class Meshes:
    """The meshes of a file's ``<asset>``, by name."""

    def __init__(self, root: Element, settings: Settings, defaults: Defaults, folders: Folders) -> None:
        self._settings, self._folders = settings, folders
        self._meshes: dict[str, Element] = {}
        self._doubled: dict[str, Element] = {}
        self._hfields: dict[str, Element] = {}
        for asset in root.children_in("asset"):
            name = asset.attributes.get("name", "").strip() or Path(asset.attributes.get("file", "")).stem
            if asset.tag == "hfield":
                self._hfields[name] = asset
            elif asset.tag == "mesh":
                if name in self._meshes:
                    self._doubled[name] = asset
                self._meshes[name] = defaults.apply(asset)

    def file_and_scale(self, name: str) -> tuple[str, tuple[float, ...]]:
        """File and scale of a mesh; an empty name if it is not in the assets or has no file."""
        element = self._meshes.get(name)
        if element is None:
            return "", (1.0, 1.0, 1.0)
        file = element.attributes.get("file", "").strip()
        return self._file(file) if file else "", tuple(element.floats("scale", (1.0, 1.0, 1.0)))

    def _file(self, name: str) -> str:
        """Path of a mesh file by the folder settings."""
        name = name.replace("\\", "/")
        if self._settings.plain_names:
            name = name.rpartition("/")[2]
        folder = self._settings.mesh_folder.replace("\\", "/").rstrip("/")
        return f"{folder}/{name}" if folder else name

    def half_sizes_of_hfield(self, geom: Element) -> list[float]:
        """Half sizes of the box about its origin that MuJoCo uses for the mass of a height field.

        Raises :class:`~twistwrench.RobotFileError` naming the geom if the height field is missing.
        """
        name = geom.text("hfield")
        if name not in self._hfields:
            raise geom.error(f"shows the height field {name!r}, which no <asset> describes.")
        x, y, top, bottom = self._hfields[name].values("size", 4)
        return [x, y, 0.25 * top + 0.5 * bottom]

    def inertia(self, geom: Element, *, mass: float | None = None, density: float | None = None) -> SpatialInertia:
        """Inertia of a mesh geom in the mesh's own frame, as MuJoCo computes it.

        Raises :class:`~twistwrench.RobotFileError` naming the geom if the mesh is missing or cannot be read.
        """
        name = geom.text("mesh")
        if name not in self._meshes:
            known = listed(map(repr, self._meshes)) or "none"
            raise geom.error(f"shows the mesh {name!r}, which no <asset> describes. Known: {known}.")
        if name in self._doubled:
            raise geom.error(f"shows the mesh {name!r}, and {self._doubled[name]} is the second one of that name.")
        element = self._meshes[name]
        vertices, faces = self._surface(element, geom)
        mode = element.word("inertia", _MODES, "legacy")
        if mode == "shell":
            raise element.error(f"is a shell, whose inertia is not computed. Give the body of {geom} an <inertial>.")
        if mode == "convex":
            faces = _hull(vertices, element)
        if mode == "legacy":
            volume, parameters = _legacy(vertices[faces])
        else:
            volume, parameters = _solid(vertices[faces], np.zeros(3), signed=True)
        if not volume > 0:
            raise element.error(f"encloses no volume. Give the body of {geom} an <inertial>.")
        if mass is None:
            mass = volume * float(density or 0.0)
        return SpatialInertia.from_parameters(parameters * (mass / volume))

    def _surface(self, element: Element, geom: Element) -> tuple[Array, Array]:
        """Vertices (n, 3) [m] in the frame that geoms place, and triangles (k, 3)."""
        if "file" in element.attributes:
            vertices, faces = self._read(element, geom)
        elif "vertex" in element.attributes:
            vertices = _triples(element, "vertex")
            if "face" in element.attributes:
                faces = _triples(element, "face").astype(int)
            else:
                faces = _hull(vertices, element)
        else:
            raise element.error(f"has neither a file nor vertices, so the mass of {geom} is not known.")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise element.error("has faces of vertices that are not there.")
        place, Q = element.floats("refpos", (0.0, 0.0, 0.0)), element.floats("refquat", (1.0, 0.0, 0.0, 0.0))
        vertices = vertices.astype(np.float32).astype(float)  # as MuJoCo keeps them
        in_reference = (vertices - place) @ quaternion.rotation(Q)
        scale = element.floats("scale", (1.0, 1.0, 1.0))
        if np.prod(scale) < 0:  # a mirror image has its inside outside
            faces = faces[:, [0, 2, 1]]
        return np.asarray(in_reference * scale), faces

    def _read(self, element: Element, geom: Element) -> tuple[Array, Array]:
        try:
            path = self._folders.find(self._file(element.text("file")), element)
        except RobotFileError as error:
            raise RobotFileError(
                f"the mass of {geom} is that of a mesh, and {error} Put the mesh there, or give the body an <inertial>."
            ) from None
        from ...mechanics.bodies.mesh import read_surface

        if path.suffix.lower() not in (*SUFFIXES, ".msh"):
            raise element.error(f"names the file {path.name!r}, which is not a mesh: {', '.join(SUFFIXES)}, .msh.")
        try:
            return _msh(path) if path.suffix.lower() == ".msh" else read_surface(path)
        except TwistWrenchError as error:
            raise RobotFileError(f"{element}: {error}") from None


def _triples(element: Element, attribute: str) -> Array:
    count = len(element.text(attribute).split())
    if count % 3:
        raise element.error(f"has {count} numbers in {attribute}, which is not a multiple of three.")
    return element.numbers(attribute, count).reshape(-1, 3)


def _msh(path: Path) -> tuple[Array, Array]:
    """MuJoCo's own binary format: four counts, then vertices, normals and texture coordinates as float32, and faces."""
    with third_party_errors(lambda reason: RobotFileError(f"{path.name} cannot be read as a mesh: {reason}.")):
        data = read_bytes(path)
    counts = np.frombuffer(data[:16] if len(data) >= 16 else bytes(16), "<i4").astype(int)
    vertices, normals, textures, faces = counts
    size = 16 + 4 * (3 * vertices + 3 * normals + 2 * textures + 3 * faces)
    if counts.min() < 0 or not vertices or not faces or size != len(data):
        raise RobotFileError(
            f"{path.name} is not a mesh of MuJoCo's: its counts and its size, {len(data)} bytes, do not agree."
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
        raise element.error("has no convex hull: its vertices lie in a plane, or are too few.")
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
    return V, np.array(ten_parameters(V, h, I))


def _legacy(corners: Array) -> tuple[float, Array]:
    """Volume and parameters as MuJoCo computes them: pyramids from the surface's centre, then from their centre of mass."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2.0
    centre = area @ corners.mean(axis=1) / area.sum()
    first, pyramids = _solid(corners, centre, signed=False)
    com = pyramids[1:4] / first
    V, about = _solid(corners - com, np.zeros(3), signed=False)
    moments = np.array([[about[4], about[5], about[7]], [about[5], about[6], about[8]], [about[7], about[8], about[9]]])
    return V, np.asarray(SpatialInertia.from_com(V, com, moments).parameters)
