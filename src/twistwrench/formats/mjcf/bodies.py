"""Bodies of MJCF: poses, order, joints, and inertia from geoms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...core.errors import RobotFileError
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.joints.screw_joint import screw_through
from ...mechanics.lie import quaternion, se3, so3
from ...mechanics.lie.identity import IDENTITY, UPRIGHT, is_identity, pose_rows, product
from ...mechanics.model.description import label, unused
from ..known_elements import LEFT_OUT
from ..urdf import IN_MJCF, direction, rotation_of_z_axis_to, tensor_of
from ..xml import Element
from .preprocess import Defaults, Meshes, Settings

_ORIENTATION_ATTRIBUTES = frozenset(("quat", "axisangle", "xyaxes", "zaxis", "euler"))
_POSE_ATTRIBUTES = _ORIENTATION_ATTRIBUTES | {"pos"}
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Axes of Euler angles by letter."""


def placement(element: Element, settings: Settings) -> Array:
    """Pose (4, 4) of an element by ``pos`` and an orientation; the identity without both."""
    attributes = element.attributes
    if _POSE_ATTRIBUTES.isdisjoint(attributes):
        return IDENTITY
    R_rows = UPRIGHT
    if not _ORIENTATION_ATTRIBUTES.isdisjoint(attributes):
        R_rows = rotation(element, settings).tolist()
    return pose_rows(R_rows, element.floats("pos", (0.0, 0.0, 0.0)))


def rotation(element: Element, settings: Settings) -> Array:
    """Orientation (3, 3) of an element by quat, axisangle, xyaxes, zaxis or euler."""
    forms = [form for form in ("axisangle", "xyaxes", "zaxis", "euler") if form in element.attributes]
    if len(forms) > 1:
        raise element.error(f"gives its orientation in {len(forms)} ways: {', '.join(forms)}. Keep one.")
    if not forms:
        if "quat" in element.attributes:
            return _rotation_of_quaternion(element)
        return np.eye(3)
    (form,) = forms
    if form == "axisangle":
        *axis, angle = element.numbers("axisangle", 4).tolist()
        return _rotation_about(direction(element, "axisangle", axis), angle * settings.angle)
    if form == "xyaxes":
        x_and_y = element.numbers("xyaxes", 6)
        x = direction(element, "xyaxes", x_and_y[:3])
        y = direction(element, "xyaxes", x_and_y[3:] - (x @ x_and_y[3:]) * x)  # orthogonal to x
        return np.column_stack([x, y, so3.cross(x, y)])
    if form == "zaxis":
        return rotation_of_z_axis_to(direction(element, "zaxis", element.numbers("zaxis", 3)))
    R = np.eye(3)
    angles = element.numbers("euler", 3) * settings.angle
    for letter, angle in zip(settings.euler_sequence, angles, strict=True):
        turn = _rotation_about(np.array(_AXES[letter.lower()]), float(angle))
        if letter.islower():  # about an axis that turns with the body
            R = R @ turn
        else:  # about an axis that stands still
            R = turn @ R
    return R


def _rotation_of_quaternion(element: Element) -> Array:
    """Rotation (3, 3) of ``quat``; raises an error for zeros."""
    values = element.floats("quat", (1.0, 0.0, 0.0, 0.0))
    if not any(values):
        raise element.error("has a quaternion of zeros, which is not a rotation. The identity is 1 0 0 0.")
    return quaternion.rotation(values)


def _rotation_about(axis: Array, angle: float) -> Array:
    """Rotation about a unit vector."""
    return np.asarray(so3.exp(axis * angle))


WORLD = "world"
"""Name of the link of the worldbody."""
_EXPANDED = (
    "expand it with MuJoCo: model = mujoco.MjSpec.from_file(path).compile(), then twistwrench.from_mujoco(model)"
)
REFUSED = {  # why an element is not read
    "composite": "it makes bodies by a recipe of MuJoCo's",
    "flexcomp": "it makes a deformable body",
    "replicate": "it makes bodies by a recipe of MuJoCo's",
    "attach": "it copies a body of another model",
}


@dataclass(frozen=True, eq=False)
class PlacedElement:
    """A joint, geom, site or inertial of a body, with its defaults applied."""

    element: Element
    frame: Array
    """Pose (4, 4) of the frame around the element in the body."""

    def direction_in_body(self, x: Array) -> Array:
        """A direction (3,) of the frame, in the body."""
        return x if self.frame is IDENTITY else self.frame[:3, :3] @ x

    def point_in_body(self, x: Array) -> Array:
        """A point (3,) of the frame, in the body."""
        return x if self.frame is IDENTITY else self.frame[:3, :3] @ x + self.frame[:3, 3]


@dataclass(eq=False)
class MjcfBody:
    """One body. The worldbody is number 0, and its own parent."""

    element: Element
    name: str
    parent: int
    """Number of the parent."""
    T: Array
    """Pose (4, 4) in the parent's frame, with the joints at their reference."""
    joints: list[PlacedElement] = field(default_factory=list)
    geoms: list[PlacedElement] = field(default_factory=list)
    sites: list[PlacedElement] = field(default_factory=list)
    inertial: PlacedElement | None = None
    plugins: list[Element] = field(default_factory=list)
    moves: bool = False
    """True if a joint of the body, or of a body that carries it, moves it."""


def survey(root: Element, settings: Settings, defaults: Defaults) -> list[MjcfBody]:
    """All bodies, depth first in the file's order, as MuJoCo numbers them.

    Raises :class:`~twistwrench.RobotFileError` for elements that make bodies by a recipe.
    """
    bodies = [MjcfBody(root, WORLD, 0, IDENTITY)]
    worlds = root.all("worldbody")
    if not worlds:
        for element in root.walk():
            if element.tag == "body":
                raise element.error("stands outside a <worldbody>, and the file has none. Put its bodies into one.")
    # Elements whose children are read: their other children, number of the body, pose of the frame in it, class of defaults.
    stack = []
    names = {WORLD}
    for world in reversed(worlds):  # the first one is read first
        class_name = world.attributes.get("childclass", "").strip()
        stack.append((iter(world.children), 0, IDENTITY, class_name))
        names |= {element.attributes.get("name", "") for element in world.walk() if element.tag == "body"}
    while stack:
        children, k, frame, class_name = stack[-1]
        child = next(children, None)
        if child is None:
            stack.pop()
            continue
        body = bodies[k]
        if child.tag in ("body", "frame"):
            T = product(frame, placement(child, settings))
            own_class = child.attributes.get("childclass")
            child_class = class_name if own_class is None else defaults.check(child, own_class.strip())
            if child.tag == "frame":
                stack.append((iter(child.children), k, T, child_class))
                continue
            has_name = bool(child.attributes.get("name", "").strip())
            name = child.text("name") if has_name else unused(f"body{len(bodies)}", names)
            number = len(bodies)
            bodies.append(MjcfBody(child, name, k, T, moves=body.moves))
            stack.append((iter(child.children), number, IDENTITY, child_class))
        else:
            if k == 0 and child.tag in ("joint", "freejoint"):  # 0 is the worldbody
                raise child.error("stands in the worldbody, which does not move. Put it into a <body>.")
            _add_part(body, child, frame, class_name, defaults)
    return bodies


def _add_part(body: MjcfBody, child: Element, frame: Array, class_name: str, defaults: Defaults) -> None:
    """Add a joint, geom, site, inertial or plugin to its body, in a frame (4, 4) with a class of defaults."""
    if child.tag in ("joint", "freejoint"):
        # Defaults do not apply to <freejoint>, the short form of a free joint.
        joint = defaults.apply(child, class_name) if child.tag == "joint" else child
        body.joints.append(PlacedElement(joint, frame))
        body.moves = True
    elif child.tag == "geom":
        body.geoms.append(PlacedElement(defaults.apply(child, class_name), frame))
    elif child.tag == "site":
        body.sites.append(PlacedElement(defaults.apply(child, class_name), frame))
    elif child.tag == "inertial":
        if body.inertial is not None:
            raise child.error(f"is the second one of its body, after {body.inertial.element}. Keep one.")
        body.inertial = PlacedElement(child, frame)
    elif child.tag in REFUSED:
        raise child.error(f"is not read: {REFUSED[child.tag]}. Use it there, and {_EXPANDED}.")
    elif child.tag == "plugin":
        body.plugins.append(child)


KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}
"""Joint types of the model by joint type of MJCF."""
COORDINATES = {"revolute": 1, "prismatic": 1, "ball": 4, "floating": 7}
"""Number of coordinates by joint type of the model."""


@dataclass(eq=False)
class MjcfJoint:
    """One joint, in SI units and radians, in the frame of its body."""

    element: Element
    name: str
    kind: str
    """Joint type of the model."""
    point: Array
    """Point (3,) on the axis."""
    axis: Array
    """Direction (3,) of the axis."""
    reference: float
    """Coordinate at the pose that the file gives the body."""
    rest: float
    """Rest position of the joint's spring."""
    stiffness: float
    """Linear coefficient of the spring; damping, friction and armature are those of the drive."""
    damping: float
    friction: float
    armature: float
    lower: float | None = None
    upper: float | None = None
    remarks: list[str] = field(default_factory=list)
    """Notes on properties that are left out."""

    @property
    def who(self) -> str:
        """Name in messages."""
        place = self.element.place
        if place and "name" in self.element.attributes:
            return str(self.element)
        return label("joint", self.name, place)

    @property
    def screw(self) -> Array:
        """Screw axis (6,) of a joint with one degree of freedom, in its body's frame."""
        return screw_through(self.kind, self.axis, self.point)

    @property
    def single(self) -> bool:
        """True for a single degree of freedom."""
        return COORDINATES[self.kind] == 1


def names_given(bodies: list[MjcfBody]) -> set[str]:
    """The names that joints have in the file."""
    names = {part.element.attributes.get("name", "").strip() for body in bodies for part in body.joints}
    return names - {""}


def joints_of(body: MjcfBody, settings: Settings, names: set[str]) -> list[MjcfJoint]:
    """Joints of a body in the file's order; joints without a name get names that are not in ``names``."""
    joints = [_joint(body, k, part, settings, names) for k, part in enumerate(body.joints)]
    for joint in joints:
        if joint.kind != "floating":
            continue
        if body.parent != 0:
            raise joint.element.error(
                f"is free, and its body {body.name!r} does not stand in the worldbody. Move it there."
            )
        if len(joints) > 1:
            raise joint.element.error(f"is free and has other joints beside it in body {body.name!r}. Keep one.")
    return joints


def _joint(body: MjcfBody, k: int, part: PlacedElement, settings: Settings, names: set[str]) -> MjcfJoint:
    """Joint number k of a body; ``names`` are the used names of joints."""
    e = part.element
    kind_in_file = "free" if e.tag == "freejoint" else e.word("type", tuple(KINDS), "hinge")
    kind = KINDS[kind_in_file]
    name = e.attributes.get("name", "").strip()
    if not name:
        number = str(k) if len(body.joints) > 1 else ""
        name = unused(f"{body.name}.{kind_in_file}{number}", names)
    unit = settings.angle if kind in ("revolute", "ball") else 1.0
    joint = MjcfJoint(
        e, name, kind,
        point=part.point_in_body(np.array(e.floats("pos", (0.0, 0.0, 0.0)))),
        axis=part.direction_in_body(direction(e, "axis", e.floats("axis", (0.0, 0.0, 1.0)))),
        reference=unit * e.floats("ref", (0.0,))[0], rest=unit * e.floats("springref", (0.0,))[0],
        stiffness=e.floats("stiffness", (0.0, 0.0, 0.0))[0], damping=e.floats("damping", (0.0, 0.0, 0.0))[0],
        friction=e.floats("frictionloss", (0.0,))[0], armature=e.floats("armature", (0.0,))[0],
    )  # fmt: skip
    if e.tag == "freejoint":
        is_aligned = e.word("align", ("true", "false", "auto"), "auto") == "true"
        if is_aligned or settings.align_free:
            joint.remarks.append("moves its body's frame to the centre of mass in MuJoCo (align), and not here")
    for attribute in ("stiffness", "damping"):
        _, *higher_orders = e.floats(attribute, (0.0, 0.0, 0.0))
        if any(higher_orders):
            joint.remarks.append(LEFT_OUT[f"joint/{attribute}"])
    if e.floats("springyield", (0.0,))[0]:
        joint.remarks.append(LEFT_OUT["joint/springyield"])
    if kind != "floating" and has_active_range(e, "limited", "range", settings):
        if joint.single:
            lower, upper = e.floats("range", (0.0, 0.0))
            joint.lower = unit * lower
            joint.upper = unit * upper
        else:
            joint.remarks.append(LEFT_OUT["ball/range"])
    if not joint.single and joint.stiffness:
        joint.remarks.append(LEFT_OUT["ball/stiffness"])
    if any(e.floats("springdamper", (0.0, 0.0))):
        joint.remarks.append("has a springdamper, which is left out. Give its stiffness and damping")
    return joint


def has_active_range(element: Element, flag: str, values: str, settings: Settings) -> bool:
    """True if a range is active; ``flag`` and ``values`` are the attributes with its activity and its numbers."""
    activity = element.word(flag, ("true", "false", "auto"), "auto")
    if activity == "auto":
        return settings.auto_limits and values in element.attributes
    return activity == "true"


_WATER_DENSITY = 1000.0
"""Default density of the format [kg/m³]."""
WITHOUT_SHAPE = ("plane", "hfield")
"""Types of geoms without a shape of their own; a plane also has no mass."""
_TYPES = (*WITHOUT_SHAPE, "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
"""Types of geoms."""
_SIZE_COUNTS = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
"""Number of sizes by type of geom."""
_TYPES_WITH_ENDS = ("capsule", "cylinder", "ellipsoid", "box")
"""Types of geoms that may be given by the ends of their axis."""


def weighs(geom: Element, settings: Settings) -> bool:
    """True if a geom has inertia, by its group, its mass or density, and its shape."""
    is_solid = _is_in_groups(geom, settings) and geom.word("type", _TYPES, "sphere") != "plane"
    return is_solid and any(_mass_or_density(geom).values())


def inertia_of_geom(part: PlacedElement, settings: Settings, meshes: Meshes) -> SpatialInertia:
    """Inertia of a geom about the body's origin, in the body's axes."""
    geom = part.element
    kind = geom.word("type", _TYPES, "sphere")
    mass_or_density = _mass_or_density(geom)
    if kind == "sdf":
        raise geom.error("is a signed distance field, whose mass is not computed. Give its body an <inertial>.")
    if geom.flag("shellinertia", default=False):
        raise geom.error("is a shell (shellinertia), whose inertia is not computed. Give its body an <inertial>.")
    if kind == "mesh":
        T = product(part.frame, placement(geom, settings))
        return meshes.inertia(geom, **mass_or_density).in_frame(T)
    if "mesh" in geom.attributes:
        raise geom.error(
            "is a shape that MuJoCo fits to a mesh. Give its size in place of the mesh, or its body an <inertial>."
        )
    T, size = shape_of(geom, kind, settings)
    if kind == "hfield":
        kind = "box"
        size = meshes.half_sizes_of_hfield(geom)
    if min(size) <= 0:
        raise geom.error(f"is a {kind} of size {' '.join(map(printed, size))}; sizes are above zero.")
    return _solid(kind, size, mass_or_density).in_frame(product(part.frame, T))


def shape_of(element: Element, kind: str, settings: Settings) -> tuple[Array, list[float]]:
    """Pose (4, 4) and half sizes of a shape, by ``pos`` and an orientation, or by ``fromto``, the ends of its axis."""
    size = element.floats("size", (0.0, 0.0, 0.0))
    if "fromto" not in element.attributes or kind not in _TYPES_WITH_ENDS:
        return placement(element, settings), size[: _SIZE_COUNTS.get(kind, 3)]
    begin, end = np.split(element.numbers("fromto", 6), 2)
    axis = begin - end
    half_length = float(np.linalg.norm(axis)) / 2.0
    R = rotation_of_z_axis_to(direction(element, "fromto", axis))
    T = se3.pose(R, (begin + end) / 2.0)
    radius = size[0]
    if _SIZE_COUNTS[kind] == 2:
        return T, [radius, half_length]
    return T, [radius, radius, half_length]


def _mass_or_density(geom: Element) -> dict[str, float]:
    """Mass [kg] or density [kg/m³] of a geom, by its name; raises an error if it is negative."""
    if "mass" in geom.attributes:
        quantity = "mass"
        value = geom.number("mass")
    else:
        quantity = "density"
        (value,) = geom.floats("density", (_WATER_DENSITY,))
    if value < 0:
        raise geom.error(f"has a negative {quantity}, {printed(value)}.")
    return {quantity: value}


def _solid(kind: str, size: list[float], mass_or_density: dict[str, float]) -> SpatialInertia:
    """Inertia of a solid about its centre, from its half sizes."""
    if kind == "sphere":
        return SpatialInertia.sphere(size[0], **mass_or_density)
    if kind == "ellipsoid":
        return SpatialInertia.ellipsoid(size, **mass_or_density)
    if kind == "box":
        return SpatialInertia.box([2.0 * x for x in size], **mass_or_density)
    build = SpatialInertia.capsule if kind == "capsule" else SpatialInertia.cylinder
    radius, half_length, *_ = size
    return build(radius, 2.0 * half_length, **mass_or_density)


@dataclass(frozen=True)
class Inertias:
    """Inertia of each body about its frame's origin, in the order of the bodies, and notes on changes."""

    each: list[SpatialInertia]
    """Inertia of each body."""
    remarks: list[str]
    """Notes on inertias that the settings change, or that are not complete."""


def inertias_of(bodies: Sequence[MjcfBody], settings: Settings, meshes: Meshes) -> Inertias:
    """Inertias of the bodies; the world has none."""
    remarks: list[str] = []
    inertias = [SpatialInertia.zero()]
    for body in bodies[1:]:
        G = _inertia(body, settings, meshes, remarks)
        inertias.append(_correct_inertia(G, body, settings, remarks))
    if settings.total_mass > 0:
        mass = sum(G.mass for G in inertias)
        if mass > 0:
            factor = settings.total_mass / mass
            inertias = [SpatialInertia.from_parameters(factor * G.parameters) for G in inertias]
            remarks.append(
                f"settotalmass={printed(settings.total_mass)}: all masses and inertias are multiplied by {printed(factor)}"
            )
    return Inertias(inertias, remarks)


def _inertia(body: MjcfBody, settings: Settings, meshes: Meshes, remarks: list[str]) -> SpatialInertia:
    """Inertia of a body by its inertial or its geoms, zero without both; a note on an incomplete one goes to ``remarks``."""
    from_geoms = settings.from_geoms == "true" or (settings.from_geoms == "auto" and body.inertial is None)
    if not from_geoms:
        if body.inertial is None:
            return SpatialInertia.zero()
        return _given_inertia(body.inertial, settings)
    geoms = [part for part in body.geoms if weighs(part.element, settings)]
    has_geom_in_groups = any(_is_in_groups(part.element, settings) for part in body.geoms)
    if body.inertial is not None and not has_geom_in_groups:
        return _given_inertia(body.inertial, settings)
    G = SpatialInertia.zero()
    for part in geoms:
        try:
            G = G + inertia_of_geom(part, settings, meshes)
        except RobotFileError as error:
            if body.moves:
                raise
            remarks.append(f"body {body.name!r} does not move, and its inertia is not complete: {error}")
    return G


def _is_in_groups(geom: Element, settings: Settings) -> bool:
    """True if a geom is in the groups that have inertia."""
    first_group, last_group = settings.groups
    (group,) = geom.floats("group", (0.0,))
    return first_group <= group <= last_group


def _given_inertia(inertial: PlacedElement, settings: Settings) -> SpatialInertia:
    """Inertia of an inertial about the body's origin, in the body's axes."""
    mass, T, tensor = inertial_of(inertial.element, settings)
    R = T[:3, :3]
    G = SpatialInertia.from_com(mass, T[:3, 3], R @ tensor @ R.T)
    if is_identity(inertial.frame):
        return G
    return G.in_frame(inertial.frame)


def _place_of_inertial(body: MjcfBody, settings: Settings) -> Array:
    """Position (3,) of a body's inertial, where its mass would be; the body's origin if geoms give the inertia."""
    if body.inertial is None or settings.from_geoms == "true":
        return np.zeros(3)
    _, T, _ = inertial_of(body.inertial.element, settings)
    return np.asarray((body.inertial.frame @ T)[:3, 3])


def inertial_of(inertial: Element, settings: Settings) -> tuple[float, Array, Array]:
    """Mass [kg], pose (4, 4) of the centre of mass with the axes of the tensor, and tensor (3, 3) [kg m²]."""
    T = placement(inertial, settings)
    mass = inertial.number("mass")
    has_diagonal = "diaginertia" in inertial.attributes
    has_full_tensor = "fullinertia" in inertial.attributes
    if has_diagonal and has_full_tensor:
        raise inertial.error("has both diaginertia and fullinertia. Keep one.")
    tensor = np.zeros((3, 3))
    if has_diagonal:
        tensor = np.diag(inertial.numbers("diaginertia", 3))
    elif has_full_tensor:
        entries = dict(zip(IN_MJCF, inertial.numbers("fullinertia", 6).tolist(), strict=True))
        tensor = tensor_of(entries.__getitem__)
        if not _ORIENTATION_ATTRIBUTES.isdisjoint(inertial.attributes):
            raise inertial.error("has fullinertia, which is along the body's axes, and an orientation. Keep one.")
    return mass, T, tensor


def _correct_inertia(G: SpatialInertia, body: MjcfBody, settings: Settings, remarks: list[str]) -> SpatialInertia:
    """Inertia with at least the mass and moments that ``<compiler>`` sets, balanced if its ``balanceinertia`` is true.

    A change goes to ``remarks``.
    """
    has_bounds = settings.least_mass > 0 or settings.least_moment > 0
    if not has_bounds and not settings.balanced:
        return G
    mass = max(G.mass, settings.least_mass)
    moments, axes = np.linalg.eigh(G.moment_about_com)
    corrected_moments = np.maximum(moments, settings.least_moment)
    causes = []
    if mass > G.mass:
        causes.append(f"boundmass={printed(settings.least_mass)}")
    if (corrected_moments > moments).any():
        causes.append(f"boundinertia={printed(settings.least_moment)}")
    smallest, middle, largest = corrected_moments
    if settings.balanced and smallest + middle < largest:  # violates the triangle inequality
        corrected_moments = np.full(3, corrected_moments.mean())
        causes.append("balanceinertia")
    if not causes:
        return G
    remarks.append(
        f"{' and '.join(causes)} of <compiler> change body {body.name!r} ({body.element.place}): mass {printed(G.mass)} to "
        f"{printed(mass)} kg, principal moments {moments.round(12).tolist()} to {corrected_moments.round(12).tolist()} kg m²"
    )
    com = G.com
    if not G.mass:
        com = _place_of_inertial(body, settings)
    return SpatialInertia.from_com(mass, com, (axes * corrected_moments) @ axes.T)
