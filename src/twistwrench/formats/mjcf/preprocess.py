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
    """Settings of all ``<compiler>`` elements of a file. The defaults are those of the format."""

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
        last_element = root
        attributes: dict[str, str] = {}
        for element in root.all("compiler"):
            last_element = element
            attributes |= element.attributes
        compiler = last_element.with_attributes(attributes)  # messages name the last element
        if compiler.word("coordinate", ("local", "global"), "local") == "global":
            raise RobotFileError(
                f'{compiler} has coordinate="global", which MuJoCo dropped too. Write poses relative to the parent body.'
            )
        attributes = compiler.attributes
        sequence = attributes.get("eulerseq", "xyz").strip()
        if len(sequence) != 3 or set(sequence) - set("xyzXYZ"):
            raise RobotFileError(
                f'{compiler} has eulerseq="{sequence}": three of the letters x, y, z, X, Y, Z are expected.'
            )
        return cls(
            degrees=compiler.word("angle", ("degree", "radian"), "degree") == "degree",
            euler_sequence=sequence,
            auto_limits=compiler.flag("autolimits", default=True),
            from_geoms=compiler.word("inertiafromgeom", ("true", "false", "auto"), "auto"),
            groups=tuple(compiler.floats("inertiagrouprange", (0.0, 5.0))),
            total_mass=compiler.floats("settotalmass", (-1.0,))[0],
            least_mass=compiler.floats("boundmass", (0.0,))[0],
            least_moment=compiler.floats("boundinertia", (0.0,))[0],
            balanced=compiler.flag("balanceinertia", default=False),
            mesh_folder=attributes.get("meshdir", attributes.get("assetdir", "")).strip(),
            plain_names=compiler.flag("strippath", default=False),
            align_free=compiler.flag("alignfree", default=False),
        )


_FORCES_OF_GROUPS = {"passive": {"spring", "damper"}, "constraint": {"equality", "frictionloss"}}
"""Names of the forces that one flag disables together."""


def disabled_by(root: Element) -> set[str]:
    """Names of the forces that the flags of ``<option>`` disable: gravity, spring, damper, equality and others."""
    disabled: set[str] = set()
    flags = [flag for option in root.all("option") for flag in option.all("flag")]
    for flag in flags:
        for name, value in flag.attributes.items():
            if value.strip() == "disable":
                disabled.add(name)
            elif value.strip() == "enable":
                disabled.discard(name)
    for group, forces in _FORCES_OF_GROUPS.items():
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
    """The last ``<option>`` that gives the medium a density or a viscosity; None without one."""
    fluid = None
    for option in root.all("option"):
        if option.floats("density", (0.0,))[0] or option.floats("viscosity", (0.0,))[0]:
            fluid = option
    return fluid


_MAX_DEPTH_OF_INCLUDES = 16
_ROOTS = ("mujoco", "mujocoinclude")
"""Names of the root elements of included files."""
_MAX_SHOWN_NAME = 200
"""Largest number of characters that messages show of a file's name."""


class Folders:
    """Folders from which a robot file may read other files.

    ``home`` is the folder of the robot file, None for a robot given as text.
    """

    def __init__(self, home: Path | None, others: Sequence[Path] = ()) -> None:
        folders = list(others)
        if home is not None:
            folders.insert(0, home)
        self.allowed = [folder.resolve() for folder in folders]

    def find(self, name: str, element: Element, including_folder: Path | None = None) -> Path:
        """Find the file ``name``: in the robot's folder, else in that of the including file, else in the other folders.

        Raises :class:`~twistwrench.RobotFileError`, naming ``element``, for absolute paths, addresses, files outside the
        folders, and missing files.
        """
        is_address = re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", name) is not None  # also C: of Windows
        is_absolute = name.startswith(("/", "\\"))
        named = f"names the file {name[:_MAX_SHOWN_NAME]!r}"
        if not name or "\0" in name or is_absolute or is_address:
            raise element.error(f"{named}: only paths below the robot's own folder are read.")
        if not self.allowed:
            raise element.error(
                f"{named}, and a robot given as text has no folder. Load it from its path, or pass include_paths=[folder]."
            )
        home, *others = self.allowed
        folders = [home, *others]
        if including_folder is not None:
            folders = [home, including_folder, *others]
        try:
            candidates = [(folder / name).resolve() for folder in folders]
            allowed_paths = list(filter(self._is_allowed, candidates))
            files = [path for path in allowed_paths if path.is_file()]
        except (OSError, RuntimeError):  # a link to itself is a RuntimeError before Python 3.13
            allowed_paths = [Path(name)]  # reported below as missing
            files = []
        if files:
            return files[0]
        if not allowed_paths:
            raise element.error(
                f"{named}, which lies outside the robot's folder. If it is to be read, pass include_paths=[its folder]."
            )
        raise element.error(f"{named}, which is not there.")

    def _is_allowed(self, path: Path) -> bool:
        """True if a resolved path lies below one of the folders."""
        return any(path.is_relative_to(folder) for folder in self.allowed)


def expand(root: Element, folders: Folders, max_bodies: int) -> None:
    """Replace ``<include>`` elements in ``root`` by the elements of the files they name.

    Raises :class:`~twistwrench.RobotFileError` for files outside the folders, files included twice, and too many of them.
    """
    include_by_path: dict[Path, Element] = {}
    total_bytes = 0
    # Elements whose children are still to be expanded, each with its depth of includes and the folder of its file.
    stack: list[tuple[Element, int, Path | None]] = [(root, 0, None)]
    while stack:
        element, element_depth, element_folder = stack.pop()
        children: list[Element] = []
        waiting = [(child, element_depth, element_folder) for child in reversed(element.children)]
        while waiting:
            child, depth, folder = waiting.pop()
            if child.tag != "include":
                child.parent = element
                children.append(child)
                if child.children:
                    stack.append((child, depth, folder))
                continue
            if depth == _MAX_DEPTH_OF_INCLUDES:
                raise child.error(
                    f"is the {_MAX_DEPTH_OF_INCLUDES + 1}th include inside includes; {_MAX_DEPTH_OF_INCLUDES} are allowed."
                )
            path = folders.find(child.text("file"), child, folder)
            if path in include_by_path:
                raise child.error(
                    f"includes {child.text('file')!r} again, after {include_by_path[path]}. Each file may be included once."
                )
            include_by_path[path] = child
            total_bytes += path.stat().st_size
            if total_bytes > MAX_BYTES:
                raise RobotFileError(f"{child}: the included files have more than {MAX_BYTES // 2**20} MiB together.")
            included_root = _included_root(path, child, max_bodies)
            waiting.extend((grandchild, depth + 1, path.parent) for grandchild in reversed(included_root.children))
        element.children = children


def _included_root(path: Path, include: Element, max_bodies: int) -> Element:
    """Root element of an included file."""
    name = include.text("file")
    try:
        root = parse(read_robot_text(path)[0], name, max_bodies)
    except RobotFileError as error:
        raise include.error(f"→ {name}: {error}") from None
    if root.tag not in _ROOTS:
        raise include.error(
            f"includes {name!r}, whose root element is <{root.tag}>, expected <mujocoinclude> or <mujoco>."
        )
    return root


# A class begins as a copy of the class that encloses it, with all that this class defines before or after it. An element
# belongs to the class that it names. If it names none, it belongs to the ``childclass`` of the nearest body or frame around it,
# and without one to the outermost class, ``main``.

SHORTCUT = "the shortcut"
"""Key beside the attributes of an actuator. Its value is the tag (such as ``motor``) that defines their meaning."""

_ORIENTATION_ATTRIBUTES = {"quat", "axisangle", "xyaxes", "zaxis", "euler"}
_MAIN = "main"
"""Name of the outermost class."""


class Defaults:
    """Default classes of a file."""

    def __init__(self, root: Element) -> None:
        """Read all ``<default>`` elements of a file."""
        self._classes: dict[str, dict[str, dict[str, str]]] = {_MAIN: {}}
        """Attributes by class name and tag of the element."""
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
            inherited = self._classes.get(parent or name, {})  # the outermost class may stand in several elements
            defaults = {tag: dict(attributes) for tag, attributes in inherited.items()}
            for child in element.children:
                if child.tag != "default":
                    key = _key(child.tag)
                    defaults[key] = merge_defaults(defaults.get(key), child)
            self._classes[name] = defaults
            stack.extend((child, name) for child in reversed(element.all("default")))

    def apply(self, element: Element, around: str = "", kind: str = "") -> Element:
        """Element completed by the attributes of its class; ``around`` is the childclass of the bodies around it.

        ``kind`` is the tag under which the defaults are written, if it is not the element's own.
        """
        name = element.attributes.get("class", "").strip() or around or _MAIN
        self._check(element, name, "is of the class")
        default = self._classes[name].get(kind or _key(element.tag))
        if not default and element.tag not in ACTUATORS:
            return element
        return element.with_attributes(merge_defaults(default, element))

    def check(self, element: Element, name: str) -> str:
        """Return ``name``; raise RobotFileError if it is not empty and no class has it."""
        if name:
            self._check(element, name, "has the childclass")
        return name

    def _check(self, element: Element, name: str, verb: str) -> None:
        """Raise RobotFileError if no class has the name."""
        if name not in self._classes:
            known = listed(map(repr, self._classes))
            raise element.error(f"{verb} {name!r}, which no <default> describes. Known: {known}.")


def merge_defaults(default: dict[str, str] | None, element: Element) -> dict[str, str]:
    """Attributes of a class, replaced by those of an element.

    An orientation can be written by one of five attributes. That of the element replaces any that the class has.
    """
    own_attributes = element.attributes
    attributes = dict(default or {})
    if not own_attributes.keys().isdisjoint(_ORIENTATION_ATTRIBUTES):
        attributes = {name: value for name, value in attributes.items() if name not in _ORIENTATION_ATTRIBUTES}
    merged = attributes | own_attributes
    if element.tag in ACTUATORS:
        merged[SHORTCUT] = element.tag
        if element.tag == "general":
            merged[SHORTCUT] = attributes.get(SHORTCUT, "general")
    return merged


def _key(tag: str) -> str:
    """Name under which defaults of an element are kept: one for all kinds of actuators."""
    if tag in ACTUATORS:
        return "actuator"
    return tag


_MODES = ("legacy", "exact", "convex", "shell")
"""Ways to compute the inertia of a mesh."""


class Meshes:
    """The meshes of a file's ``<asset>``, by name."""

    def __init__(self, root: Element, settings: Settings, defaults: Defaults, folders: Folders) -> None:
        self._settings = settings
        self._folders = folders
        self._meshes: dict[str, Element] = {}
        self._duplicates: dict[str, Element] = {}
        """Last mesh with a name that an earlier mesh has, by name."""
        self._hfields: dict[str, Element] = {}
        for asset in root.children_in("asset"):
            name = asset.attributes.get("name", "").strip() or Path(asset.attributes.get("file", "")).stem
            if asset.tag == "hfield":
                self._hfields[name] = asset
            elif asset.tag == "mesh":
                if name in self._meshes:
                    self._duplicates[name] = asset
                self._meshes[name] = defaults.apply(asset)

    def file_and_scale(self, name: str) -> tuple[str, tuple[float, ...]]:
        """File and scale of a mesh; an empty name if it is not in the assets or has no file."""
        no_scale = (1.0, 1.0, 1.0)
        if name not in self._meshes:
            return "", no_scale
        element = self._meshes[name]
        file = element.attributes.get("file", "").strip()
        if file:
            file = self._file(file)
        return file, tuple(element.floats("scale", no_scale))

    def _file(self, name: str) -> str:
        """Path of a mesh file relative to the robot's folder, after the settings ``meshdir`` and ``strippath``."""
        name = name.replace("\\", "/")
        if self._settings.plain_names:
            name = name.rpartition("/")[2]
        folder = self._settings.mesh_folder.replace("\\", "/").rstrip("/")
        if folder:
            return f"{folder}/{name}"
        return name

    def half_sizes_of_hfield(self, geom: Element) -> list[float]:
        """Half sizes of the box about its origin that MuJoCo uses for the mass of a height field.

        Raises :class:`~twistwrench.RobotFileError` naming the geom if the height field is missing.
        """
        name = geom.text("hfield")
        if name not in self._hfields:
            raise geom.error(f"shows the height field {name!r}, which no <asset> describes.")
        x, y, top, bottom = self._hfields[name].values("size", 4)  # heights above and below the zero level
        return [x, y, 0.25 * top + 0.5 * bottom]  # MuJoCo takes a mean height of top / 2

    def inertia(self, geom: Element, *, mass: float | None = None, density: float | None = None) -> SpatialInertia:
        """Inertia of a mesh geom in the mesh's own frame, as MuJoCo computes it.

        Raises :class:`~twistwrench.RobotFileError` naming the geom if the mesh is missing or cannot be read.
        """
        name = geom.text("mesh")
        if name not in self._meshes:
            known = listed(map(repr, self._meshes)) or "none"
            raise geom.error(f"shows the mesh {name!r}, which no <asset> describes. Known: {known}.")
        if name in self._duplicates:
            raise geom.error(f"shows the mesh {name!r}, and {self._duplicates[name]} is the second one of that name.")
        element = self._meshes[name]
        vertices, faces = self._surface(element, geom)
        mode = element.word("inertia", _MODES, "legacy")
        if mode == "shell":
            raise element.error(f"is a shell, whose inertia is not computed. Give the body of {geom} an <inertial>.")
        if mode == "convex":
            faces = _hull(vertices, element)
        if mode == "legacy":
            with np.errstate(invalid="ignore"):  # without area or volume, 0/0 is nan, which is refused below
                volume, parameters = _legacy_volume_and_parameters(vertices[faces])
        else:
            volume, parameters = _volume_and_parameters(vertices[faces], np.zeros(3), signed=True)
        if not volume > 0:
            raise element.error(f"encloses no volume. Give the body of {geom} an <inertial>.")
        if mass is None:
            mass = volume * float(density or 0.0)
        return SpatialInertia.from_parameters(parameters * (mass / volume))

    def _surface(self, element: Element, geom: Element) -> tuple[Array, Array]:
        """Vertices (n, 3) [m] in the frame that geoms place, and triangles (k, 3)."""
        if "file" in element.attributes:
            vertices, faces = self._read_surface(element, geom)
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
        p_reference = element.floats("refpos", (0.0, 0.0, 0.0))
        Q_reference = element.floats("refquat", (1.0, 0.0, 0.0, 0.0))
        vertices = vertices.astype(np.float32).astype(float)  # MuJoCo keeps them in single precision
        in_reference = (vertices - p_reference) @ quaternion.rotation(Q_reference)  # rows: R' (x - p)
        scale = element.floats("scale", (1.0, 1.0, 1.0))
        if np.prod(scale) < 0:  # in a mirror image, triangles are seen from inside
            faces = faces[:, [0, 2, 1]]
        return np.asarray(in_reference * scale), faces

    def _read_surface(self, element: Element, geom: Element) -> tuple[Array, Array]:
        """Vertices (n, 3) and triangles (k, 3) in the file of a mesh."""
        try:
            path = self._folders.find(self._file(element.text("file")), element)
        except RobotFileError as error:
            raise RobotFileError(
                f"the mass of {geom} is that of a mesh, and {error} Put the mesh there, or give the body an <inertial>."
            ) from None
        from ...mechanics.bodies.mesh import read_surface

        suffix = path.suffix.lower()
        if suffix not in (*SUFFIXES, ".msh"):
            raise element.error(f"names the file {path.name!r}, which is not a mesh: {', '.join(SUFFIXES)}, .msh.")
        try:
            if suffix == ".msh":
                return _read_msh(path)
            return read_surface(path)
        except TwistWrenchError as error:
            raise RobotFileError(f"{element}: {error}") from None


def _triples(element: Element, attribute: str) -> Array:
    """Numbers (n, 3) of an attribute."""
    count = len(element.text(attribute).split())
    if count % 3:
        raise element.error(f"has {count} numbers in {attribute}, which is not a multiple of three.")
    return element.numbers(attribute, count).reshape(-1, 3)


_MSH_HEADER_BYTES = 16


def _read_msh(path: Path) -> tuple[Array, Array]:
    """Vertices (n, 3) and triangles (k, 3) of a file in MuJoCo's own binary format.

    It holds four counts (int32); vertices (3), normals (3) and texture coordinates (2 numbers each) as float32; and faces (3
    indices each) as int32.
    """
    with third_party_errors(lambda reason: RobotFileError(f"{path.name} cannot be read as a mesh: {reason}.")):
        data = read_bytes(path)
    header = data[:_MSH_HEADER_BYTES]
    if len(header) < _MSH_HEADER_BYTES:
        header = bytes(_MSH_HEADER_BYTES)  # counts of zero, which are refused below
    counts = np.frombuffer(header, "<i4").astype(int)
    n_vertices, n_normals, n_textures, n_faces = counts
    number_count = 3 * n_vertices + 3 * n_normals + 2 * n_textures + 3 * n_faces
    expected_bytes = _MSH_HEADER_BYTES + 4 * number_count
    if counts.min() < 0 or not n_vertices or not n_faces or expected_bytes != len(data):
        raise RobotFileError(
            f"{path.name} is not a mesh of MuJoCo's: its counts and its size, {len(data)} bytes, do not agree."
        )
    coordinates = np.frombuffer(data, "<f4", 3 * n_vertices, offset=_MSH_HEADER_BYTES).astype(float)
    if not np.isfinite(coordinates).all():
        raise RobotFileError(f"{path.name} has vertices that are not finite.")
    faces_begin = len(data) - 4 * 3 * n_faces
    corner_indices = np.frombuffer(data, "<i4", 3 * n_faces, offset=faces_begin).astype(int)
    return coordinates.reshape(-1, 3), corner_indices.reshape(-1, 3)


def _hull(vertices: Array, element: Element) -> Array:
    """The triangles (k, 3) of the convex hull, seen from outside."""
    faces = hull_faces(vertices)
    if faces is None:
        raise element.error("has no convex hull: its vertices lie in a plane, or are too few.")
    return faces


def _volume_and_parameters(corners: Array, apex: Array, *, signed: bool) -> tuple[float, Array]:
    """Volume [m³], and the ten parameters at density one, of the tetrahedra from a common apex to the triangles (k, 3, 3).

    If ``signed``, tetrahedra that lie on the outer side of their triangle are subtracted; otherwise all are added.
    """
    a, b, c = np.moveaxis(corners - apex, 1, 0)
    volumes = (a * np.cross(b, c)).sum(axis=1) / 6.0
    if not signed:
        volumes = np.abs(volumes)
    centroids = (a + b + c) / 4.0
    h = volumes @ centroids
    # ∫ r r' of a tetrahedron with one corner at the origin: V/20 (Σ x x' + s s'), s the sum of the corners x.
    s = a + b + c
    S = sum(np.einsum("k,ki,kj->ij", volumes, x, x) for x in (a, b, c, s)) / 20.0
    V = float(volumes.sum())
    S = S + np.outer(h, apex) + np.outer(apex, h) + V * np.outer(apex, apex)  # about the frame's origin
    h = h + V * apex
    I = np.trace(S) * np.eye(3) - S
    return V, np.array(ten_parameters(V, h, I))


def _legacy_volume_and_parameters(corners: Array) -> tuple[float, Array]:
    """Volume and parameters as MuJoCo computes them by default.

    The apex of the tetrahedra is first the centre of the surface, which gives a centre of mass, and then this centre of mass.
    """
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 2.0
    surface_centre = areas @ corners.mean(axis=1) / areas.sum()
    first_volume, first_parameters = _volume_and_parameters(corners, surface_centre, signed=False)
    com = first_parameters[1:4] / first_volume
    V, parameters = _volume_and_parameters(corners - com, np.zeros(3), signed=False)
    Ixx, Ixy, Iyy, Ixz, Iyz, Izz = parameters[4:]
    I_com = np.array([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
    return V, np.asarray(SpatialInertia.from_com(V, com, I_com).parameters)
