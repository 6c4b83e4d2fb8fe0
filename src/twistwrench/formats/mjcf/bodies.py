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

_TURNED = frozenset(("quat", "axisangle", "xyaxes", "zaxis", "euler"))
_PLACED = _TURNED | {"pos"}
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def placement(element: Element, settings: Settings) -> Array:
    """Pose (4, 4) of an element by ``pos`` and an orientation, by default the identity."""
    attributes = element.attributes
    if _PLACED.isdisjoint(attributes):
        return IDENTITY
    R = UPRIGHT if _TURNED.isdisjoint(attributes) else rotation(element, settings).tolist()
    return pose_rows(R, element.floats("pos", (0.0, 0.0, 0.0)))


def rotation(element: Element, settings: Settings) -> Array:
    """Orientation (3, 3) of an element by quat, axisangle, xyaxes, zaxis or euler."""
    forms = [form for form in ("axisangle", "xyaxes", "zaxis", "euler") if form in element.attributes]
    if len(forms) > 1:
        raise element.error(f"gives its orientation in {len(forms)} ways: {', '.join(forms)}. Keep one.")
    if not forms:
        return _rotation_of_quaternion(element) if "quat" in element.attributes else np.eye(3)
    if forms[0] == "axisangle":
        *axis, angle = element.numbers("axisangle", 4).tolist()
        return _rotation_about(direction(element, "axisangle", axis), angle * settings.angle)
    if forms[0] == "xyaxes":
        values = element.numbers("xyaxes", 6)
        x = direction(element, "xyaxes", values[:3])
        y = direction(element, "xyaxes", values[3:] - (x @ values[3:]) * x)
        return np.column_stack([x, y, so3.cross(x, y)])
    if forms[0] == "zaxis":
        return rotation_of_z_axis_to(direction(element, "zaxis", element.numbers("zaxis", 3)))
    R = np.eye(3)
    angles = element.numbers("euler", 3) * settings.angle
    for letter, angle in zip(settings.euler_sequence, angles, strict=True):
        turn = _rotation_about(np.array(_AXES[letter.lower()]), float(angle))
        R = R @ turn if letter.islower() else turn @ R  # about axes that turn along, or that stand still
    return R


def _rotation_of_quaternion(element: Element) -> Array:
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
REFUSED = {
    "composite": "it makes bodies by a recipe of MuJoCo's",
    "flexcomp": "it makes a deformable body",
    "replicate": "it makes bodies by a recipe of MuJoCo's",
    "attach": "it copies a body of another model",
}


@dataclass(frozen=True, eq=False)
class PlacedElement:
    """A joint, geom or site with its defaults applied, and the pose of the frame around it in the body."""

    element: Element
    frame: Array

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
    T: Array
    """(4, 4) in the parent's frame, joints at their reference."""
    joints: list[PlacedElement] = field(default_factory=list)
    geoms: list[PlacedElement] = field(default_factory=list)
    sites: list[PlacedElement] = field(default_factory=list)
    inertial: PlacedElement | None = None
    plugins: list[Element] = field(default_factory=list)
    moves: bool = False
    """True if its own joint or one before moves it."""


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
    stack = []
    names = {WORLD}
    for world in reversed(worlds):
        stack.append((iter(world.children), 0, IDENTITY, world.attributes.get("childclass", "").strip()))
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
            inner = class_name if own_class is None else defaults.check(child, own_class.strip())
            if child.tag == "frame":
                stack.append((iter(child.children), k, T, inner))
                continue
            named = bool(child.attributes.get("name", "").strip())
            name = child.text("name") if named else unused(f"body{len(bodies)}", names)
            bodies.append(MjcfBody(child, name, k, T, moves=body.moves))
            stack.append((iter(child.children), len(bodies) - 1, IDENTITY, inner))
        else:
            if k == 0 and child.tag in ("joint", "freejoint"):
                raise child.error("stands in the worldbody, which does not move. Put it into a <body>.")
            _add_part(body, child, frame, class_name, defaults)
    return bodies


def _add_part(body: MjcfBody, child: Element, frame: Array, class_name: str, defaults: Defaults) -> None:
    """Add a joint, geom, site, inertial or plugin to its body, in a frame (4, 4) with a class of defaults."""
    if child.tag in ("joint", "freejoint"):
        # A free joint written short has no defaults.
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
"""Joint types of MJCF and of the model."""
COORDINATES = {"revolute": 1, "prismatic": 1, "ball": 4, "floating": 7}


@dataclass(eq=False)
class MjcfJoint:
    """One joint, in SI units and radians, in the frame of its body."""

    element: Element
    name: str
    kind: str
    point: Array
    axis: Array
    reference: float
    """Coordinate at the pose that the file gives the body."""
    rest: float
    """Rest position of its spring."""
    stiffness: float
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
        """Screw axis (6,) of a joint of one degree, in its body's frame."""
        return screw_through(self.kind, self.axis, self.point)

    @property
    def single(self) -> bool:
        """True if it has one degree of freedom."""
        return COORDINATES[self.kind] == 1


def names_given(bodies: list[MjcfBody]) -> set[str]:
    """The names that joints have in the file."""
    names = {part.element.attributes.get("name", "").strip() for body in bodies for part in body.joints}
    return names - {""}


def joints_of(body: MjcfBody, settings: Settings, names: set[str]) -> list[MjcfJoint]:
    """Joints of a body in the file's order; unnamed ones get names that are not among ``names``."""
    joints = [_joint(body, k, part, settings, names) for k, part in enumerate(body.joints)]
    free = [joint for joint in joints if joint.kind == "floating"]
    if free and body.parent != 0:
        raise free[0].element.error(
            f"is free, and its body {body.name!r} does not stand in the worldbody. Move it there."
        )
    if free and len(joints) > 1:
        raise free[0].element.error(f"is free and has other joints beside it in body {body.name!r}. Keep one.")
    return joints


def _joint(body: MjcfBody, k: int, part: PlacedElement, settings: Settings, names: set[str]) -> MjcfJoint:
    e = part.element
    kind_in_file = "free" if e.tag == "freejoint" else e.word("type", tuple(KINDS), "hinge")
    kind = KINDS[kind_in_file]
    number = str(k) if len(body.joints) > 1 else ""
    name = e.attributes.get("name", "").strip() or unused(f"{body.name}.{kind_in_file}{number}", names)
    unit = settings.angle if kind in ("revolute", "ball") else 1.0
    joint = MjcfJoint(
        e, name, kind,
        point=part.point_in_body(np.array(e.floats("pos", (0.0, 0.0, 0.0)))),
        axis=part.direction_in_body(direction(e, "axis", e.floats("axis", (0.0, 0.0, 1.0)))),
        reference=unit * e.floats("ref", (0.0,))[0], rest=unit * e.floats("springref", (0.0,))[0],
        stiffness=e.floats("stiffness", (0.0, 0.0, 0.0))[0], damping=e.floats("damping", (0.0, 0.0, 0.0))[0],
        friction=e.floats("frictionloss", (0.0,))[0], armature=e.floats("armature", (0.0,))[0],
    )  # fmt: skip
    aligned = e.tag == "freejoint" and e.word("align", ("true", "false", "auto"), "auto") == "true"
    if aligned or (e.tag == "freejoint" and settings.align_free):
        joint.remarks.append("moves its body's frame to the centre of mass in MuJoCo (align), and not here")
    for attribute in ("stiffness", "damping"):
        if any(e.floats(attribute, (0.0, 0.0, 0.0))[1:]):
            joint.remarks.append(LEFT_OUT[f"joint/{attribute}"])
    if e.floats("springyield", (0.0,))[0]:
        joint.remarks.append(LEFT_OUT["joint/springyield"])
    if kind != "floating" and has_active_range(e, "limited", "range", settings):
        if joint.single:
            joint.lower, joint.upper = (unit * x for x in e.floats("range", (0.0, 0.0)))
        else:
            joint.remarks.append(LEFT_OUT["ball/range"])
    if not joint.single and joint.stiffness:
        joint.remarks.append(LEFT_OUT["ball/stiffness"])
    if any(e.floats("springdamper", (0.0, 0.0))):
        joint.remarks.append("has a springdamper, which is left out. Give its stiffness and damping")
    return joint


def has_active_range(element: Element, flag: str, values: str, settings: Settings) -> bool:
    """True if a range is active: by its flag, or with ``auto`` if there is a range."""
    activity = element.word(flag, ("true", "false", "auto"), "auto")
    return activity == "true" or (activity == "auto" and settings.auto_limits and values in element.attributes)


_WATER_DENSITY = 1000.0
"""kg/m³, the format's density."""
WITHOUT_SHAPE = ("plane", "hfield")
"""Types without a shape of their own; a plane has no mass either."""
_TYPES = (*WITHOUT_SHAPE, "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf")
_LENGTHS = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
_ALONG = ("capsule", "cylinder", "ellipsoid", "box")
"""Shapes that may be given by the ends of their axis."""


def weighs(geom: Element, settings: Settings) -> bool:
    """True if a geom has inertia, by its group, its mass or density, and its shape."""
    solid = _is_in_groups(geom, settings) and geom.word("type", _TYPES, "sphere") != "plane"
    return solid and any(_mass_or_density(geom).values())


def inertia_of_geom(part: PlacedElement, settings: Settings, meshes: Meshes) -> SpatialInertia:
    """Inertia about the body's origin, in its axes."""
    geom = part.element
    kind, mass_or_density = geom.word("type", _TYPES, "sphere"), _mass_or_density(geom)
    if kind == "sdf":
        raise geom.error("is a signed distance field, whose mass is not computed. Give its body an <inertial>.")
    if geom.flag("shellinertia", default=False):
        raise geom.error("is a shell (shellinertia), whose inertia is not computed. Give its body an <inertial>.")
    if kind == "mesh":
        return meshes.inertia(geom, **mass_or_density).in_frame(product(part.frame, placement(geom, settings)))
    if "mesh" in geom.attributes:
        raise geom.error(
            "is a shape that MuJoCo fits to a mesh. Give its size in place of the mesh, or its body an <inertial>."
        )
    T, size = shape_of(geom, kind, settings)
    if kind == "hfield":
        kind, size = "box", meshes.half_sizes_of_hfield(geom)
    if min(size) <= 0:
        raise geom.error(f"is a {kind} of size {' '.join(map(printed, size))}; sizes are above zero.")
    return _solid(kind, size, mass_or_density).in_frame(product(part.frame, T))


def shape_of(element: Element, kind: str, settings: Settings) -> tuple[Array, list[float]]:
    """Pose (4, 4) and half sizes of a shape, by ``pos`` and an orientation, or by ``fromto``, the ends of its axis."""
    size = element.floats("size", (0.0, 0.0, 0.0))
    if "fromto" not in element.attributes or kind not in _ALONG:
        return placement(element, settings), size[: _LENGTHS.get(kind, 3)]
    ends = element.numbers("fromto", 6)
    along = ends[:3] - ends[3:]
    half = float(np.linalg.norm(along)) / 2.0
    T = se3.pose(rotation_of_z_axis_to(direction(element, "fromto", along)), (ends[:3] + ends[3:]) / 2.0)
    return T, [size[0], half] if _LENGTHS[kind] == 2 else [size[0], size[0], half]


def _mass_or_density(geom: Element) -> dict[str, float]:
    if "mass" in geom.attributes:
        quantity, value = "mass", geom.number("mass")
    else:
        quantity, value = "density", geom.floats("density", (_WATER_DENSITY,))[0]
    if value < 0:
        raise geom.error(f"has a negative {quantity}, {printed(value)}.")
    return {quantity: value}


def _solid(kind: str, size: list[float], mass_or_density: dict[str, float]) -> SpatialInertia:
    if kind == "sphere":
        return SpatialInertia.sphere(size[0], **mass_or_density)
    if kind == "ellipsoid":
        return SpatialInertia.ellipsoid(size, **mass_or_density)
    if kind == "box":
        return SpatialInertia.box([2.0 * x for x in size], **mass_or_density)
    build = SpatialInertia.capsule if kind == "capsule" else SpatialInertia.cylinder
    return build(size[0], 2.0 * size[1], **mass_or_density)


@dataclass(frozen=True)
class Inertias:
    """Inertia of each body about its frame's origin, in the order of the bodies, and notes on changes."""

    each: list[SpatialInertia]
    remarks: list[str]


def inertias_of(bodies: Sequence[MjcfBody], settings: Settings, meshes: Meshes) -> Inertias:
    """Inertias of the bodies; the world has none."""
    remarks: list[str] = []
    inertias = [SpatialInertia.zero()]
    for body in bodies[1:]:
        G = _inertia(body, settings, meshes, remarks)
        inertias.append(_correct_inertia(G, body, settings, remarks))
    if settings.total_mass > 0:
        total = sum(G.mass for G in inertias)
        if total > 0:
            factor = settings.total_mass / total
            inertias = [SpatialInertia.from_parameters(factor * G.parameters) for G in inertias]
            remarks.append(
                f"settotalmass={printed(settings.total_mass)}: all masses and inertias are multiplied by {printed(factor)}"
            )
    return Inertias(inertias, remarks)


def _inertia(body: MjcfBody, settings: Settings, meshes: Meshes, remarks: list[str]) -> SpatialInertia:
    from_geoms = settings.from_geoms == "true" or (settings.from_geoms == "auto" and body.inertial is None)
    if not from_geoms:
        return _given_inertia(body.inertial, settings) if body.inertial is not None else SpatialInertia.zero()
    geoms = [part for part in body.geoms if weighs(part.element, settings)]
    in_groups = any(_is_in_groups(part.element, settings) for part in body.geoms)
    if body.inertial is not None and not in_groups:
        return _given_inertia(body.inertial, settings)
    total = SpatialInertia.zero()
    for part in geoms:
        try:
            total = total + inertia_of_geom(part, settings, meshes)
        except RobotFileError as error:
            if body.moves:
                raise
            remarks.append(f"body {body.name!r} does not move, and its inertia is not complete: {error}")
    return total


def _is_in_groups(geom: Element, settings: Settings) -> bool:
    """True if a geom is in the groups that have inertia."""
    first, last = settings.groups
    return first <= geom.floats("group", (0.0,))[0] <= last


def _given_inertia(inertial: PlacedElement, settings: Settings) -> SpatialInertia:
    """Inertia about the body's origin, in its axes."""
    mass, T, moments = inertial_of(inertial.element, settings)
    R = T[:3, :3]
    G = SpatialInertia.from_com(mass, T[:3, 3], R @ moments @ R.T)
    return G if is_identity(inertial.frame) else G.in_frame(inertial.frame)


def inertial_of(inertial: Element, settings: Settings) -> tuple[float, Array, Array]:
    """Mass [kg], pose (4, 4) of the centre of mass with the axes of the tensor, and tensor (3, 3) [kg m²]."""
    T, mass = placement(inertial, settings), inertial.number("mass")
    forms = [name for name in ("diaginertia", "fullinertia") if name in inertial.attributes]
    if len(forms) > 1:
        raise inertial.error("has both diaginertia and fullinertia. Keep one.")
    if not forms:
        moments = np.zeros((3, 3))
    elif forms[0] == "diaginertia":
        moments = np.diag(inertial.numbers("diaginertia", 3))
    else:
        entries = dict(zip(IN_MJCF, inertial.numbers("fullinertia", 6).tolist(), strict=True))
        moments = tensor_of(entries.__getitem__)
        if set(inertial.attributes) & _TURNED:
            raise inertial.error("has fullinertia, which is along the body's axes, and an orientation. Keep one.")
    return mass, T, moments


def _correct_inertia(G: SpatialInertia, body: MjcfBody, settings: Settings, remarks: list[str]) -> SpatialInertia:
    """The inertia with the least mass and moments of ``<compiler>``, balanced if that is set."""
    if not (settings.least_mass > 0 or settings.least_moment > 0 or settings.balanced):
        return G
    mass = max(G.mass, settings.least_mass)
    moments, axes = np.linalg.eigh(G.moment_about_com)
    corrected = np.maximum(moments, settings.least_moment)
    causes = []
    if mass > G.mass:
        causes.append(f"boundmass={printed(settings.least_mass)}")
    if (corrected > moments).any():
        causes.append(f"boundinertia={printed(settings.least_moment)}")
    if settings.balanced and corrected[0] + corrected[1] < corrected[2]:
        corrected = np.full(3, corrected.mean())
        causes.append("balanceinertia")
    if not causes:
        return G
    remarks.append(
        f"{' and '.join(causes)} of <compiler> change body {body.name!r} ({body.element.place}): mass {printed(G.mass)} to "
        f"{printed(mass)} kg, principal moments {moments.round(12).tolist()} to {corrected.round(12).tolist()} kg m²"
    )
    com = G.com if G.mass else np.zeros(3)
    return SpatialInertia.from_com(mass, com, (axes * corrected) @ axes.T)
