"""USD with UsdPhysics: bodies of a stage, their mass properties, and the joints of an articulation.

https://openusd.org/release/api/usd_physics_page_front.html. Pixar's library ``pxr`` (package usd-core, an extra) opens
the stage. Numbers are converted to SI by the stage's ``metersPerUnit`` and ``kilogramsPerUnit``, and angles to radians;
most are in single precision. Links are the rigid bodies, in their own frames without scale. Appearance, contacts and
drive gains are skipped.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.child_process import ChildLimits, run_in_child, sandboxed
from ..core.errors import MissingExtraError, RobotFileError, UnknownNameError
from ..core.gravity import STRENGTH
from ..core.numbers import printed
from ..core.text import argument, listed, shorten
from ..core.third_party import capture_stderr, reason_of, third_party_errors
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.joints.screw_joint import screw_through
from ..mechanics.lie import quaternion, se3, so3
from ..mechanics.lie.identity import IDENTITY, pose_rows
from ..mechanics.lie.labelled import TWIST
from ..mechanics.model.assembly import ROOT_JOINT
from ..mechanics.model.builder import ModelBuilder
from ..mechanics.model.model import OfferedClosure
from .known_elements import LeftOut, Unread
from .sdf import add_ball
from .xml import MOST_BODIES

_SINGLE_PRECISION = 1e-5
"""Error of rotations in single precision."""


def open_stage(path: Path, folders: Sequence[Path]) -> Any:
    """Open the stage of a file whose layers are all below ``folders``. Raises MissingExtraError and RobotFileError."""
    try:
        from pxr import Usd
    except ImportError:
        raise MissingExtraError.from_extra("usd-core", "usd", "Reading USD") from None
    allowed = [folder.resolve() for folder in folders]
    with (
        third_party_errors(lambda reason: RobotFileError(f"it cannot be read as USD: {reason}.")),
        capture_stderr() as library_messages,
    ):
        layers = _check_and_open_layers(path.resolve(), allowed)
        stage = Usd.Stage.Open(str(path.resolve()))
    if str(library_messages):  # a missing layer is a warning of the library, but a missing part of the robot
        raise RobotFileError(f"it cannot be read whole: {' '.join(str(library_messages).split())[:300]}")
    for layer in stage.GetUsedLayers():  # those too whose names are computed, by variables and variants
        if layer.realPath:
            _check_place(layer.realPath, allowed)
    del layers  # those that are held are not read again for the stage
    return stage


_MAX_LAYERS = 1000
"""Largest number of layers of a stage."""


def _check_and_open_layers(path: Path, allowed: Sequence[Path]) -> list[Any]:
    """Layers that a file names, itself or by its layers. Raises RobotFileError before one outside ``allowed`` is opened."""
    from pxr import Sdf

    waiting, layers = [str(path)], []
    for name in waiting:
        layer = Sdf.Layer.FindOrOpen(name)
        layers.append(layer)
        if layer is None:  # reported when the stage is opened
            continue
        for named in layer.GetCompositionAssetDependencies():
            place = layer.ComputeAbsolutePath(named)
            _check_place(place, allowed)
            if place not in waiting:
                waiting.append(place)
        if len(waiting) > _MAX_LAYERS:
            raise RobotFileError(f"it has more than {_MAX_LAYERS} layers.")
    return layers


def _check_place(name: str, allowed: Sequence[Path]) -> None:
    """Raise RobotFileError if a layer is not a file below ``allowed``. A part of an archive is ``robot.usdz[part.usd]``."""
    place = Path(name.partition("[")[0]).resolve()
    if not any(place.is_relative_to(folder) for folder in allowed):
        raise RobotFileError(
            f"it takes in {shorten(str(place))!r}, which lies outside its folder. To read it, pass include_paths=[its folder]."
        )
    if place.exists() and not place.is_file():
        raise RobotFileError(f"it takes in {shorten(str(place))!r}, which is not a file.")


@dataclass(frozen=True, eq=False)
class End:
    """One side of a joint: its body, None for the world, and the joint's frame in it."""

    body: Any
    T: Array

    @property
    def path(self) -> Any:
        """Frame of the joint in the body."""
        return None if self.body is None else self.body.GetPath()


class Stage:
    """Bodies and joints of a stage in document order, with poses in metres."""

    def __init__(self, stage: Any, max_bodies: int) -> None:
        from pxr import Usd, UsdGeom, UsdPhysics

        self.metre = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.kilogram = float(UsdPhysics.GetStageKilogramsPerUnit(stage))
        for name, unit in (("metersPerUnit", self.metre), ("kilogramsPerUnit", self.kilogram)):
            if not 0 < unit < math.inf:
                raise RobotFileError(f"it has {name} = {printed(unit)}; a positive number is expected.")
        self.up = 2 if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else 1
        self.cache = UsdGeom.XformCache(Usd.TimeCode.Default())
        prims = list(stage.Traverse(Usd.TraverseInstanceProxies()))
        self.bodies = [prim for prim in prims if prim.HasAPI(UsdPhysics.RigidBodyAPI) and moves(prim)]
        if len(self.bodies) > max_bodies:
            raise RobotFileError(
                f"it has more than {max_bodies:,} bodies ({who(self.bodies[max_bodies])}). Raise the limit, max_bodies=, if it "
                "is meant."
            )
        joints = (prim for prim in prims if prim.IsA(UsdPhysics.Joint))
        self.joints = [joint for joint in joints if value_of(joint, "physics:jointEnabled", default=True)]
        self.roots = [prim for prim in prims if prim.HasAPI(UsdPhysics.ArticulationRootAPI)]
        self.scenes = [prim for prim in prims if prim.IsA(UsdPhysics.Scene)]
        self.numbers = {prim.GetPath(): k for k, prim in enumerate(self.bodies)}
        self.default = stage.GetDefaultPrim()
        self.prim_at = stage.GetPrimAtPath

    def pose_and_scale(self, prim: Any) -> tuple[Array, Array]:
        """Pose (4, 4) of a prim on the stage, and the scale (3,) of its content."""
        M = np.array(self.cache.GetLocalToWorldTransform(prim))
        scale = np.sqrt((M[:3, :3] ** 2).sum(axis=1))
        if not scale.min() > 0:
            raise RobotFileError(f"{who(prim)} is scaled to nothing.")
        R = (M[:3, :3] / scale[:, None]).T  # rows of the library's matrices are the images of the axes
        if np.abs(R.T @ R - np.eye(3)).max() > _SINGLE_PRECISION or np.linalg.det(R) < 0:
            raise RobotFileError(
                f"{who(prim)} is sheared or mirrored by its transforms, which no body can be. Apply them to its shapes."
            )
        return se3.pose(so3.project(R), M[3, :3] * self.metre), scale

    def parts(self, body: Any) -> Iterator[Any]:
        """Prims of a body, starting with the body, without those of nested bodies."""
        from pxr import Usd

        prims = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
        for prim in prims:
            if prim != body and prim.GetPath() in self.numbers:
                prims.PruneChildren()
            else:
                yield prim

    def has_shape(self, body: Any) -> bool:
        """True if a body has a visual or a collider."""
        from pxr import UsdGeom

        return any(prim.IsA(UsdGeom.Gprim) for prim in self.parts(body))

    def colliders(self, body: Any) -> list[Any]:
        """Colliders of a body."""
        from pxr import UsdPhysics

        return [prim for prim in self.parts(body) if prim.HasAPI(UsdPhysics.CollisionAPI)]

    def gravity(self) -> Array:
        """Gravity (3,) of the scene [m/s²]; by default the earth's, downward."""
        down = -np.eye(3)[self.up]
        if not self.scenes:
            return STRENGTH * down
        direction = vector_of(self.scenes[0], "physics:gravityDirection", (0.0, 0.0, 0.0))
        magnitude = number_of(self.scenes[0], "physics:gravityMagnitude", -math.inf)
        strength = STRENGTH if magnitude < 0 else magnitude * self.metre
        length = float(np.linalg.norm(direction))
        return strength * (direction / length if length > 0 else down)

    def end(self, joint: Any, which: int) -> End:
        """Body and joint frame at one side of a joint; the stage if the side has no body."""
        targets = joint.GetRelationship(f"physics:body{which}").GetTargets()
        if len(targets) > 1:
            raise RobotFileError(f"{who(joint)} has {len(targets)} targets for body{which}; one is allowed.")
        T = IDENTITY
        prim = self.prim_at(targets[0]) if targets else None
        if prim is not None and not prim:
            raise RobotFileError(f"{who(joint)} has body{which} at {targets[0]}, where nothing is.")
        scale = np.ones(3)
        if prim is not None:
            T, scale = self.pose_and_scale(prim)
        local = vector_of(joint, f"physics:localPos{which}", (0.0, 0.0, 0.0)) * scale * self.metre
        turn = quaternion_of(joint, f"physics:localRot{which}")
        T = T @ pose_rows(quaternion.rotation(turn).tolist(), local.tolist())
        while prim is not None and prim and prim.GetPath() not in self.numbers:  # a part of a body belongs to the body
            prim = prim.GetParent()
        if prim is None or not prim:
            return End(None, T)
        return End(prim, np.asarray(se3.inverse(self.pose_and_scale(prim)[0]) @ T))


def who(prim: Any) -> str:
    """Name of a prim in messages."""
    return f"prim <{prim.GetPath()}>"


def value_of(prim: Any, name: str, *, default: Any) -> Any:
    """Value of an attribute: the file's, the schema's default, or ``default``; raises RobotFileError for an array."""
    attribute = prim.GetAttribute(name)
    if attribute and attribute.GetTypeName().isArray:  # of any size, so it is not read
        raise _wrong_type(prim, name, f"an array, {attribute.GetTypeName()}", "a single value")
    value = attribute.Get() if attribute else None
    return default if value is None else value


def _wrong_type(prim: Any, name: str, found: str, expected: str) -> RobotFileError:
    return RobotFileError(f"{who(prim)} has {name} = {shorten(found)}; expected {expected}.")


def number_of(prim: Any, name: str, default: float = 0.0) -> float:
    """Value of a scalar attribute."""
    return _decimal(prim, name, value_of(prim, name, default=default))


def vector_of(prim: Any, name: str, default: Sequence[float]) -> Array:
    """Value of an attribute with several numbers."""
    value = value_of(prim, name, default=default)
    if not hasattr(value, "__len__") or isinstance(value, str) or len(value) != len(default):
        raise _wrong_type(prim, name, str(value), f"{len(default)} numbers")
    return np.array([_decimal(prim, name, x) for x in value])


def _decimal(prim: Any, name: str, x: Any) -> float:
    """Shortest decimal that rounds to the same single-precision number."""
    if not isinstance(x, int | float):
        raise _wrong_type(prim, name, str(x), "a number")
    x = float(x)
    if math.isnan(x):
        raise RobotFileError(f"{who(prim)} has {name} = nan, which is not a number.")
    with np.errstate(over="ignore"):
        single = np.float32(x)
    return float(str(single)) if float(single) == x else x


def quaternion_of(prim: Any, name: str) -> list[float]:
    """Quaternion (w, x, y, z); zeros mean the identity."""
    value = value_of(prim, name, default=None)
    if value is not None and not hasattr(value, "GetImaginary"):
        raise _wrong_type(prim, name, str(value), "a quaternion")
    Q = [1.0, 0.0, 0.0, 0.0] if value is None else [float(value.GetReal()), *map(float, value.GetImaginary())]
    if not all(map(math.isfinite, Q)):
        raise _wrong_type(prim, name, str(value), "finite numbers")
    return Q if any(Q) else [1.0, 0.0, 0.0, 0.0]


def axis_of(prim: Any, name: str = "physics:axis", default: str = "X") -> int:
    """Axis (0, 1 or 2) of a joint's motion, or of a shape."""
    axis = str(value_of(prim, name, default=default))
    if axis not in ("X", "Y", "Z"):
        raise _wrong_type(prim, name, repr(axis), "X, Y or Z")
    return "XYZ".index(axis)


def moves(prim: Any) -> bool:
    """True if forces move a body: it is enabled and not kinematic."""
    return bool(value_of(prim, "physics:rigidBodyEnabled", default=True)) and not value_of(
        prim, "physics:kinematicEnabled", default=False
    )


# ── Articulation: bodies and joints of a stage, ordered from the base

HOW_TO_SPLIT = (
    "Write it as revolute, prismatic, spherical and fixed joints with bodies between, or load the URDF or MJCF file that the "
    "stage was made of"
)
"""Advice for a joint that is not supported."""


@dataclass(frozen=True, eq=False)
class TreeJoint:
    """Joint of the tree, from a placed link to the next one."""

    joint: Any
    near: End
    far: End
    forward: bool
    """True if the distal body is the joint's body1."""


class UsdTree:
    """One articulation of a stage; ``model`` selects the root by name or path if there are several."""

    def __init__(self, stage: Stage, model: str | None) -> None:
        self.stage = stage
        self.ends = {joint.GetPath(): (stage.end(joint, 0), stage.end(joint, 1)) for joint in stage.joints}
        self.root = self._find_root(model)

    def _find_root(self, model: str | None) -> Any:
        roots = self.stage.roots
        if model is not None:
            by_name = {}
            for prim in roots:
                by_name[prim.GetName()] = by_name[str(prim.GetPath())] = prim
            if model not in by_name:
                raise UnknownNameError.from_choices("articulation", model, by_name)
            return by_name[model]
        if len(roots) > 1:
            paths = listed(prim.GetPath() for prim in roots)
            raise RobotFileError(f"it has {len(roots)} articulations: {paths}. Say which, {argument('model')}.")
        return roots[0] if roots else None

    def _bodies_of(self, joint: Any) -> set[Any]:
        """Paths of the bodies at both ends of a joint; None for the world."""
        first, second = self.ends[joint.GetPath()]
        return {first.path, second.path}

    def joints(self) -> tuple[list[TreeJoint], list[Any], Any]:
        """Joints ordered from the base, loop-closing joints, and the body without a joint to the world, if any."""
        inside = [joint for joint in self.stage.joints if not _is_excluded(joint)]
        outside = [joint for joint in self.stage.joints if _is_excluded(joint)]
        joints_of: dict[Any, list[Any]] = {None: []}  # by the path of a body, None for the world
        for joint in inside:
            paths = self._bodies_of(joint)
            if len(paths) == 1:
                raise RobotFileError(f"{who(joint)} has one body at both ends. Name another one.")
            for path in paths:
                joints_of.setdefault(path, []).append(joint)
        members = self._members(joints_of)
        joints_of[None] = [joint for joint in joints_of[None] if members & self._bodies_of(joint)]
        start = None if joints_of[None] else self._first(members)
        tree, reached = self._walk(start, joints_of)
        ordered = [tree[joint.GetPath()] for joint in inside if joint.GetPath() in tree]
        closing = [joint for joint in outside if self._bodies_of(joint) <= reached | {None}]
        return ordered, closing, start

    def _walk(self, start: Any, joints_of: dict[Any, list[Any]]) -> tuple[dict[Any, TreeJoint], set[Any]]:
        """Joints of the tree by path, breadth first from a body or the world, and the paths of the bodies reached."""
        tree: dict[Any, TreeJoint] = {}
        waiting = deque([None if start is None else start.GetPath()])
        reached = set(waiting)
        while waiting:
            path = waiting.popleft()
            for joint in joints_of.get(path, []):
                if joint.GetPath() in tree:
                    continue
                first, second = self.ends[joint.GetPath()]
                near, far = (first, second) if first.path == path else (second, first)
                if far.path in reached:
                    raise RobotFileError(_text_for_loop(joint, near, far, tree.values()))
                reached.add(far.path)
                waiting.append(far.path)
                tree[joint.GetPath()] = TreeJoint(joint, near, far, forward=near is first)
        return tree, reached

    def _members(self, joints_of: dict[Any, list[Any]]) -> set[Any]:
        """Bodies of the articulation: those connected by joints to a body below its root, or to its joint."""
        paths = [body.GetPath() for body in self.stage.bodies]
        if not paths:
            raise RobotFileError("it has no rigid body (PhysicsRigidBodyAPI). Is it a stage of looks only?")
        if self.root:
            root = self.root.GetPath()
            members = {path for path in paths if path.HasPrefix(root)}
            for joint in self.stage.joints:
                if joint.GetPath().HasPrefix(root):
                    members |= self._bodies_of(joint) - {None}
        else:
            members = {next((path for path in paths if path in joints_of), paths[0])}
        if not members:
            raise RobotFileError(f"{who(self.root)} is the root of an articulation without a body.")
        waiting = list(members)
        while waiting:
            path = waiting.pop()
            for joint in joints_of.get(path, []):
                neighbours = self._bodies_of(joint) - members - {None}
                members |= neighbours
                waiting.extend(neighbours)
        return members

    def _first(self, members: set[Any]) -> Any:
        """Floating body: the articulation's root if it is a body, otherwise the first that is not a joint's body1."""
        if self.root and self.root.GetPath() in members:
            return self.root
        bodies = [body for body in self.stage.bodies if body.GetPath() in members]
        children = {second.path for _, second in self.ends.values()}
        return next((body for body in bodies if body.GetPath() not in children), bodies[0])


def _is_excluded(joint: Any) -> bool:
    return bool(value_of(joint, "physics:excludeFromArticulation", default=False))


def _text_for_loop(joint: Any, near: End, far: End, tree: Iterable[TreeJoint]) -> str:
    """Error message for a joint between two links that are already joined."""
    for other in tree:
        if {other.near.path, other.far.path} == {near.path, far.path}:
            return f"{who(joint)} and {who(other.joint)} join the same two bodies. {HOW_TO_SPLIT}."
    return f"{who(joint)} closes a loop. Cut it open there with excludeFromArticulation; robot.close closes it."


# ── Mass properties of colliders

# The mass of a collider is that of its MassAPI; otherwise its volume times a density: its own, that of the body's
# MassAPI, that of its material, or 1000 kg/m³, in this order. A given mass of the body is distributed over the
# colliders, which keeps the shape of the inertia. Meshes and planes have no mass.

_WATER_DENSITY = 1000.0
"""Default density of the format [kg/m³]."""
_ADVICE = "Give the body a PhysicsMassAPI with mass, centerOfMass, diagonalInertia and principalAxes"
_TURNS = (
    np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.eye(3),
)
"""Rotations from z, the solids' axis, to x, y and z."""


def inertia_of_shapes(stage: Stage, body: Any, mass: float) -> SpatialInertia:
    """Inertia of the colliders of a body about its frame's origin, scaled to ``mass`` [kg] if positive.

    Raises :class:`~twistwrench.RobotFileError` with the path of the prim if it has no collider or no such volume.
    """
    total, colliders = SpatialInertia.zero(), stage.colliders(body)
    if not colliders:
        missing = "physics:diagonalInertia" if mass > 0 else "physics:mass"
        raise RobotFileError(f"{who(body)} has no {missing}, and no collider that could give it. {_ADVICE}.")
    T_sb = stage.pose_and_scale(body)[0]
    for prim in colliders:
        T_sc, scale = stage.pose_and_scale(prim)
        total = total + _solid(stage, prim, body, scale).in_frame(se3.inverse(T_sb) @ T_sc)
    return total if mass <= 0 else SpatialInertia.from_parameters(mass / total.mass * total.parameters)


def _solid(stage: Stage, prim: Any, body: Any, scale: Array) -> SpatialInertia:
    """Inertia of a collider in its frame."""
    mass_or_density = _mass_or_density(stage, prim, body)
    kind, metres = str(prim.GetTypeName()), scale * stage.metre
    if kind == "Cube":
        return SpatialInertia.box(number_of(prim, "size", 2.0) * metres, **mass_or_density)
    if kind == "Sphere":
        return SpatialInertia.ellipsoid(number_of(prim, "radius", 1.0) * metres, **mass_or_density)
    if kind not in ("Cylinder", "Capsule"):
        raise RobotFileError(f"{who(prim)} is a {kind}, whose mass is not computed. {_ADVICE}.")
    k = axis_of(prim, "axis", default="Z")
    along, across = metres[k], np.delete(metres, k)
    if np.ptp(metres if kind == "Capsule" else across) > 1e-6 * along:
        raise RobotFileError(f"{who(prim)} is a {kind} scaled to another shape, whose mass is not computed. {_ADVICE}.")
    size, build = (1.0, SpatialInertia.cylinder) if kind == "Cylinder" else (0.5, SpatialInertia.capsule)
    radius, height = number_of(prim, "radius", size), number_of(prim, "height", 2.0 * size)
    return build(float(radius * across[0]), float(height * along), **mass_or_density).in_frame(
        se3.pose(_TURNS[k], np.zeros(3))
    )


def _mass_or_density(stage: Stage, prim: Any, body: Any) -> dict[str, float]:
    mass = number_of(prim, "physics:mass") * stage.kilogram
    if mass > 0:
        return {"mass": mass}
    for owner in (prim, body, _material(prim)):
        density = number_of(owner, "physics:density") if owner else 0.0
        if density > 0:
            return {"density": density * stage.kilogram / stage.metre**3}
    return {"density": _WATER_DENSITY}


def _material(prim: Any) -> Any:
    from pxr import UsdShade

    return UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0].GetPrim()


# ── Reader of one articulation

WORLD = "world"
"""Link name of the stage."""

_KINDS = {
    "PhysicsRevoluteJoint": "revolute", "PhysicsPrismaticJoint": "prismatic", "PhysicsSphericalJoint": "ball",
    "PhysicsFixedJoint": "fixed",
}  # fmt: skip


def read_usd(
    path: Path,
    source: str = "",
    *,
    include_paths: Sequence[Path] = (),
    floating_base: bool | None = None,
    model: str | None = None,
    max_bodies: int = MOST_BODIES,
) -> tuple[ModelBuilder, bool]:
    """Builder with the bodies and joints of one articulation, and True if its root link floats.

    ``model`` selects the articulation by the name or path of its root. ``floating_base`` None follows the file: a root
    without a joint to the world floats; False fixes it at its pose on the stage. Layers are read only from the folder
    of the file and from ``include_paths``. Unless TWISTWRENCH_SANDBOX is 0, the stage is read in a child process first.

    Raises :class:`~twistwrench.MissingExtraError`, :class:`~twistwrench.RobotFileError` with the path of the prim, and
    :class:`~twistwrench.UnknownNameError` for a missing articulation.
    """
    request = path, source, include_paths, floating_base, model, max_bodies
    if sandboxed():
        run_in_child(
            "twistwrench.formats.usd:rehearse", *request, limits=ChildLimits(_SECONDS, _MEMORY),
            error_of=lambda reason: RobotFileError(f"it cannot be read as USD: {reason}."),
        )  # fmt: skip
    return _read(*request)


_SECONDS, _MEMORY = 30.0, 1 << 30
"""Largest processor time [s] and memory [bytes] of reading a stage in a child process."""


def rehearse(*request: Any) -> None:
    """Read a stage in a child process, which ends at damage that crashes the library or takes all memory."""
    _read(*request)


def _read(
    path: Path,
    source: str,
    include_paths: Sequence[Path],
    floating_base: bool | None,
    model: str | None,
    max_bodies: int,
) -> tuple[ModelBuilder, bool]:
    stage = open_stage(path, [path.parent, *include_paths])
    from pxr import Tf

    try:  # the library reads on demand, so its errors come from any of its calls
        return _Reader(Stage(stage, max_bodies), source, floating_base, model).read()
    except (Tf.ErrorException, UnicodeError) as problem:
        raise RobotFileError(f"it cannot be read as USD: {reason_of(problem)}.") from problem


class _Reader:
    """Reader of one articulation."""

    def __init__(self, stage: Stage, source: str, floating_base: bool | None, model: str | None) -> None:
        self.stage, self.floating_base = stage, floating_base
        self.names = _names(stage.bodies, WORLD) | _names(stage.joints)
        self.tree = UsdTree(stage, model)
        name = stage.default.GetName() if stage.default else ""
        self.builder = ModelBuilder(name or (self.tree.root.GetName() if self.tree.root else "robot"), source)
        self.builder.gravity = stage.gravity()

    def read(self) -> tuple[ModelBuilder, bool]:
        """Read the articulation; returns the builder, and True if its root floats."""
        tree, closing, start = self.tree.joints()
        members = {link.far.path for link in tree}
        if start is not None:
            members.add(start.GetPath())
        bodies = [body for body in self.stage.bodies if body.GetPath() in members]
        self.builder.add_link(WORLD)
        for body in bodies:
            self.builder.add_link(
                self._name(body), self._inertia(body), where=str(body.GetPath()), shaped=self.stage.has_shape(body)
            )
        if start is not None:
            self._hold(start)
        else:
            self.builder.mount()
        for link in tree:
            self._add(link)
        for joint in closing:
            self._offer(joint)
        separate = [body for body in self.stage.bodies if body.GetPath() not in members]
        if separate:
            self.builder.remark(
                f"{who(separate[0])} and {len(separate) - 1} other bodies are not joined to the robot, and are left out"
            )
        unread = Unread("USD")
        prims_by_kind = {"scene": self.stage.scenes[:1], "body": bodies, "joint": [link.joint for link in tree]}
        for kind, prims in prims_by_kind.items():
            for prim in prims:
                _note_unread(unread, kind, prim)
        self.builder.remark(*unread.remarks)
        return self.builder, bool(self.floating_base) and start is None

    def _name(self, prim: Any) -> str:
        """Name of a link or joint; the world's name for None."""
        return WORLD if prim is None else self.names[str(prim.GetPath())]

    def _hold(self, body: Any) -> None:
        where = str(body.GetPath())
        if self.floating_base is False:
            T = self.stage.pose_and_scale(body)[0]
            self.builder.add_joint(ROOT_JOINT, "fixed", WORLD, self._name(body), placement=T, where=where)
        else:
            self.builder.add_joint(ROOT_JOINT, "floating", WORLD, self._name(body), where=where)

    def _add(self, link: TreeJoint) -> None:
        joint, T_far = link.joint, link.far.T
        kind = _KINDS.get(str(joint.GetTypeName()))
        if kind is None:
            raise RobotFileError(f"{who(joint)} is a {joint.GetTypeName()}, which is not read. {HOW_TO_SPLIT}.")
        name, where = self._name(joint), str(joint.GetPath())
        parent, child = self._name(link.near.body), self._name(link.far.body)
        placement = link.near.T @ se3.inverse(T_far)
        if kind == "ball":
            add_ball(self.builder, name, parent, child, placement, T_far[:3, 3], where)
            return
        axis = T_far[:3, axis_of(joint)] * (1.0 if link.forward else -1.0)
        S = screw_through(kind, axis, T_far[:3, 3])
        options = {} if kind == "fixed" else self._options(joint, kind)
        self.builder.add_joint(name, kind, parent, child, placement=placement, axis=S, where=where, **options)

    def _options(self, joint: Any, kind: str) -> dict[str, Any]:
        """Limits of a one-degree joint, including its drive, and the values of PhysX's and Newton's schemas."""
        turns = kind == "revolute"
        unit = math.pi / 180.0 if turns else self.stage.metre
        force = self.stage.kilogram * self.stage.metre ** (2 if turns else 1)
        drive = "drive:angular" if turns else "drive:linear"
        inertia = self.stage.kilogram * (self.stage.metre**2 if turns else 1.0)
        values = {
            "lower": unit * number_of(joint, "physics:lowerLimit", -math.inf),
            "upper": unit * number_of(joint, "physics:upperLimit", math.inf),
            "effort": force * number_of(joint, f"{drive}:physics:maxForce", math.inf),
            "velocity": unit * number_of(joint, "physxJoint:maxJointVelocity", math.inf),
            "armature": inertia * (number_of(joint, "newton:armature") or number_of(joint, "physxJoint:armature")),
            "damping": force / unit * number_of(joint, "newton:damping"),
            "friction": force * number_of(joint, "newton:friction"),
        }
        return {name: x for name, x in values.items() if math.isfinite(x) and abs(x) < 1e30}

    def _offer(self, joint: Any) -> None:
        """Register a joint outside the articulation as a closure of two frames."""
        kind, name = str(joint.GetTypeName()), self._name(joint)
        if kind not in _KINDS:
            self.builder.note(who(joint), f"is a {kind} outside the articulation, which is left out")
            return
        axis = "xyz"[axis_of(joint)]
        free = {"ball": TWIST[:3], "revolute": (f"w{axis}",), "prismatic": (f"v{axis}",)}.get(_KINDS[kind], ())
        rows = " ".join(row for row in TWIST if row not in free)
        frames = []
        for k, end in enumerate(self.tree.ends[joint.GetPath()]):
            frames.append(self.builder.add_site(f"{name}:{k}", self._name(end.body), end.T, where=who(joint)))
        self.builder.add_closure(name, OfferedClosure(frames[0], frames[1], rows))
        self.builder.remark(f"{who(joint)} is left open: robot.close({frames[0]!r}, {frames[1]!r}, {rows!r}) closes it")

    def _inertia(self, body: Any) -> SpatialInertia:
        """Inertia from the MassAPI, completed by the colliders."""
        metre, kilogram = self.stage.metre, self.stage.kilogram
        mass = number_of(body, "physics:mass") * kilogram
        com = vector_of(body, "physics:centerOfMass", (-math.inf,) * 3)
        moments = vector_of(body, "physics:diagonalInertia", (0.0, 0.0, 0.0))
        R = quaternion.rotation(quaternion_of(body, "physics:principalAxes"))
        com, I = com * self.stage.pose_and_scale(body)[1] * metre, R @ np.diag(moments * kilogram * metre**2) @ R.T
        has_com, has_moments = bool(np.isfinite(com).all()), bool(moments.any())
        if mass > 0 and has_moments and not has_com and not self.stage.colliders(body):
            com, has_com = np.zeros(3), True
        if not (mass > 0 and has_moments and has_com):
            G = inertia_of_shapes(self.stage, body, mass)
            mass = G.mass
            if not has_com:
                com = G.com
            if not has_moments:
                I = G.moment_about_com
        return SpatialInertia.from_com(mass, com, I)


def _note_unread(unread: Unread, kind: str, prim: Any) -> None:
    """Add notes on unread attributes and schemas of a prim."""
    row = unread.row(kind)
    authored = {attribute.GetName(): attribute for attribute in prim.GetAuthoredAttributes() if attribute.HasValue()}
    names = [name for name in authored if ":" in name]
    for name in names:
        entry = unread.entry(row, name)
        if entry is None:
            unread.note_unknown(kind, name, who(prim))
        elif isinstance(entry, LeftOut) and entry.acts(_values_as_text(authored[name])):
            in_newton = name.replace("mjc:", "newton:").removesuffix("loss")
            if name.startswith("mjc:") and in_newton in names:
                continue  # converters write both; Newton's is read
            unread.note_left_out(kind, name, entry, f"{name} of {who(prim)}")
    for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():  # including those without a plugin
        entry = unread.entry(row, f"<{schema.partition(':')[0]}>")
        if isinstance(entry, LeftOut):
            unread.note_left_out(kind, schema, entry, f"{schema} of {who(prim)}")


def _values_as_text(attribute: Any) -> list[str]:
    """Value of an attribute as text; empty for an array, which may have any size."""
    return [] if attribute.GetTypeName().isArray else [str(attribute.Get())]


def _names(prims: Sequence[Any], *reserved: str) -> dict[str, str]:
    """Name of each prim by path: its name if unique, otherwise its path."""
    count = Counter([*reserved, *(prim.GetName() for prim in prims)])
    names = {}
    for prim in prims:
        path, name = str(prim.GetPath()), prim.GetName()
        names[path] = name if count[name] == 1 else path
    return names
