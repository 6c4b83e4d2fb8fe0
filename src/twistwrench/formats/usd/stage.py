"""Stage of a USD file: layers below allowed folders, bodies and joints with poses in metres, and values of attributes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import MissingExtraError, RobotFileError
from ...core.gravity import STRENGTH
from ...core.numbers import printed
from ...core.text import shorten
from ...core.third_party import capture_stderr, third_party_errors
from ...core.typing import Array
from ...mechanics.lie import quaternion, se3, so3
from ...mechanics.lie.identity import IDENTITY, pose_rows

_SINGLE_PRECISION = 1e-5
"""Largest error of a rotation matrix in single precision."""
_MAX_MESSAGE_LENGTH = 300
"""Largest number of characters of the library's messages that an error shows."""


def open_stage(path: Path, folders: Sequence[Path]) -> Any:
    """Open the stage of a file; raises RobotFileError if one of its layers lies outside ``folders``, and MissingExtraError."""
    try:
        from pxr import Usd
    except ImportError:
        raise MissingExtraError.from_extra("usd-core", "usd", "Reading USD") from None
    allowed_folders = [folder.resolve() for folder in folders]
    with (
        third_party_errors(lambda reason: RobotFileError(f"it cannot be read as USD: {reason}.")),
        capture_stderr() as library_messages,
    ):
        open_layers = _check_and_open_layers(path.resolve(), allowed_folders)
        stage = Usd.Stage.Open(str(path.resolve()))
    if str(library_messages):  # the library only warns of a missing layer; here a part of the robot is missing
        messages = " ".join(str(library_messages).split())
        raise RobotFileError(f"it cannot be read whole: {messages[:_MAX_MESSAGE_LENGTH]}")
    for layer in stage.GetUsedLayers():  # also layers whose names come from variables and variants
        if layer.realPath:
            _check_layer_path(layer.realPath, allowed_folders)
    del open_layers  # kept until here, so that the library did not read the files again
    return stage


_MAX_LAYERS = 1000
"""Largest number of layers of a stage."""


def _check_and_open_layers(path: Path, allowed: Sequence[Path]) -> list[Any]:
    """The layer of a file, and all layers that it names, directly or through other layers.

    Raises RobotFileError before a layer outside the folders ``allowed`` is opened.
    """
    from pxr import Sdf

    layer_paths = [str(path)]
    layers = []
    for layer_path in layer_paths:  # the list grows by the layers that each layer names
        layer = Sdf.Layer.FindOrOpen(layer_path)
        layers.append(layer)
        if layer is None:  # the library reports it when it opens the stage
            continue
        for dependency in layer.GetCompositionAssetDependencies():
            dependency_path = layer.ComputeAbsolutePath(dependency)
            _check_layer_path(dependency_path, allowed)
            if dependency_path not in layer_paths:
                layer_paths.append(dependency_path)
        if len(layer_paths) > _MAX_LAYERS:
            raise RobotFileError(f"it has more than {_MAX_LAYERS} layers.")
    return layers


def _check_layer_path(layer_path: str, allowed: Sequence[Path]) -> None:
    """Raise RobotFileError if a layer is not a file below the folders ``allowed``."""
    archive_or_file, _, _ = layer_path.partition("[")  # a layer in an archive is robot.usdz[part.usd]
    path = Path(archive_or_file).resolve()
    if not any(path.is_relative_to(folder) for folder in allowed):
        raise RobotFileError(
            f"it takes in {shorten(str(path))!r}, which lies outside its folder. To read it, pass include_paths=[its folder]."
        )
    if path.exists() and not path.is_file():
        raise RobotFileError(f"it takes in {shorten(str(path))!r}, which is not a file.")


@dataclass(frozen=True, eq=False)
class End:
    """One end of a joint."""

    body: Any
    """Prim of the body; None for the world."""
    T: Array
    """Pose (4, 4) of the joint's frame in the body."""

    @property
    def path(self) -> Any:
        """Path of the body; None for the world."""
        if self.body is None:
            return None
        return self.body.GetPath()


class Stage:
    """Bodies and joints of a stage in document order, with poses in metres."""

    def __init__(self, stage: Any, max_bodies: int) -> None:
        from pxr import Usd, UsdGeom, UsdPhysics

        # units of length and of mass in the file [m, kg]
        self.metre = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.kilogram = float(UsdPhysics.GetStageKilogramsPerUnit(stage))
        for name, unit in (("metersPerUnit", self.metre), ("kilogramsPerUnit", self.kilogram)):
            if not 0 < unit < math.inf:
                raise RobotFileError(f"it has {name} = {printed(unit)}; a positive number is expected.")
        self.up = 1
        """Axis of the stage that points up: 1 for y, 2 for z."""
        if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
            self.up = 2
        self.cache = UsdGeom.XformCache(Usd.TimeCode.Default())
        prims = list(stage.Traverse(Usd.TraverseInstanceProxies()))
        self.bodies = [prim for prim in prims if prim.HasAPI(UsdPhysics.RigidBodyAPI) and moves(prim)]
        if len(self.bodies) > max_bodies:
            raise RobotFileError(
                f"it has more than {max_bodies:,} bodies ({who(self.bodies[max_bodies])}). Raise the limit, max_bodies=, if it "
                "is meant."
            )
        self.joints: list[Any] = []
        self.roots: list[Any] = []
        """Roots of articulations."""
        self.scenes: list[Any] = []
        for prim in prims:
            if prim.IsA(UsdPhysics.Joint) and value_of(prim, "physics:jointEnabled", default=True):
                self.joints.append(prim)
            if prim.HasAPI(UsdPhysics.ArticulationRootAPI):
                self.roots.append(prim)
            if prim.IsA(UsdPhysics.Scene):
                self.scenes.append(prim)
        self.body_paths = {prim.GetPath() for prim in self.bodies}
        self.default = stage.GetDefaultPrim()
        self.prim_at = stage.GetPrimAtPath

    def pose_and_scale(self, prim: Any) -> tuple[Array, Array]:
        """Pose (4, 4) of a prim on the stage, and the scale (3,) of its content."""
        # The library multiplies rows by matrices: rows 0 to 2 are the images of the axes, row 3 is the position.
        M = np.array(self.cache.GetLocalToWorldTransform(prim))
        scale = np.sqrt((M[:3, :3] ** 2).sum(axis=1))  # lengths of the images
        if not scale.min() > 0:
            raise RobotFileError(f"{who(prim)} is scaled to nothing.")
        R = (M[:3, :3] / scale[:, None]).T
        is_sheared = np.abs(R.T @ R - np.eye(3)).max() > _SINGLE_PRECISION
        is_mirrored = np.linalg.det(R) < 0
        if is_sheared or is_mirrored:
            raise RobotFileError(
                f"{who(prim)} is sheared or mirrored by its transforms, which no body can be. Apply them to its shapes."
            )
        return se3.pose(so3.project(R), M[3, :3] * self.metre), scale

    def parts(self, body: Any) -> Iterator[Any]:
        """Prims of a body, starting with the body, without the prims of bodies inside it."""
        from pxr import Usd

        traversal = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
        for prim in traversal:
            if prim != body and prim.GetPath() in self.body_paths:
                traversal.PruneChildren()
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
        down = -np.eye(3)[self.up]  # unit vector
        if not self.scenes:
            return STRENGTH * down
        direction = vector_of(self.scenes[0], "physics:gravityDirection", (0.0, 0.0, 0.0))
        magnitude = number_of(self.scenes[0], "physics:gravityMagnitude", -math.inf)
        strength = magnitude * self.metre
        if magnitude < 0:  # the schema's mark of "not given"
            strength = STRENGTH
        length = float(np.linalg.norm(direction))
        if not length > 0:  # zeros are the schema's mark of "downward"
            return strength * down
        return strength * (direction / length)

    def end(self, joint: Any, which: int) -> End:
        """End 0 or 1 of a joint; if the file names no moving body, its body is None and its pose is that on the stage."""
        targets = joint.GetRelationship(f"physics:body{which}").GetTargets()
        if len(targets) > 1:
            raise RobotFileError(f"{who(joint)} has {len(targets)} targets for body{which}; one is allowed.")
        prim = None
        T_prim, scale = IDENTITY, np.ones(3)
        if targets:
            prim = self.prim_at(targets[0])
            if not prim:
                raise RobotFileError(f"{who(joint)} has body{which} at {targets[0]}, where nothing is.")
            T_prim, scale = self.pose_and_scale(prim)
        local_position = vector_of(joint, f"physics:localPos{which}", (0.0, 0.0, 0.0)) * scale * self.metre
        local_rotation = quaternion.rotation(quaternion_of(joint, f"physics:localRot{which}"))
        T_joint = T_prim @ pose_rows(local_rotation.tolist(), local_position.tolist())
        body = prim
        while body and body.GetPath() not in self.body_paths:  # a part of a body belongs to the body
            body = body.GetParent()
        if not body:
            return End(None, T_joint)
        T_body, _ = self.pose_and_scale(body)
        return End(body, np.asarray(se3.inverse(T_body) @ T_joint))


def who(prim: Any) -> str:
    """Name of a prim in messages."""
    return f"prim <{prim.GetPath()}>"


def value_of(prim: Any, name: str, *, default: Any) -> Any:
    """Value of an attribute in the file, or the schema's default, or ``default``; raises RobotFileError for an array."""
    attribute = prim.GetAttribute(name)
    if attribute and attribute.GetTypeName().isArray:  # which may have any size
        raise _wrong_type(prim, name, f"an array, {attribute.GetTypeName()}", "a single value")
    if not attribute:
        return default
    value = attribute.Get()
    if value is None:
        return default
    return value


def _wrong_type(prim: Any, name: str, value_text: str, expected: str) -> RobotFileError:
    """Error for an attribute whose value is not of the expected type."""
    return RobotFileError(f"{who(prim)} has {name} = {shorten(value_text)}; expected {expected}.")


def number_of(prim: Any, name: str, default: float = 0.0) -> float:
    """Value of a scalar attribute."""
    return _decimal(prim, name, value_of(prim, name, default=default))


def vector_of(prim: Any, name: str, default: Sequence[float]) -> Array:
    """Value of an attribute with several numbers."""
    value = value_of(prim, name, default=default)
    is_sequence = hasattr(value, "__len__") and not isinstance(value, str)
    if not is_sequence or len(value) != len(default):
        raise _wrong_type(prim, name, str(value), f"{len(default)} numbers")
    return np.array([_decimal(prim, name, component) for component in value])


def _decimal(prim: Any, name: str, value: Any) -> float:
    """Number of an attribute; for a number of single precision, the shortest decimal that rounds to it."""
    if not isinstance(value, int | float):
        raise _wrong_type(prim, name, str(value), "a number")
    number = float(value)
    if math.isnan(number):
        raise RobotFileError(f"{who(prim)} has {name} = nan, which is not a number.")
    with np.errstate(over="ignore"):
        single = np.float32(number)
    if float(single) != number:  # the file holds more digits than single precision has
        return number
    return float(str(single))


def quaternion_of(prim: Any, name: str) -> list[float]:
    """Quaternion (w, x, y, z); the identity if the attribute is absent or holds zeros."""
    value = value_of(prim, name, default=None)
    if value is not None and not hasattr(value, "GetImaginary"):
        raise _wrong_type(prim, name, str(value), "a quaternion")
    identity = [1.0, 0.0, 0.0, 0.0]
    if value is None:
        return identity
    Q = [float(value.GetReal()), *map(float, value.GetImaginary())]
    if not all(map(math.isfinite, Q)):
        raise _wrong_type(prim, name, str(value), "finite numbers")
    if not any(Q):
        return identity
    return Q


def axis_of(prim: Any, name: str = "physics:axis", default: str = "X") -> int:
    """Index 0, 1 or 2 of the axis of a joint's motion, or of a shape."""
    axis = str(value_of(prim, name, default=default))
    if axis not in ("X", "Y", "Z"):
        raise _wrong_type(prim, name, repr(axis), "X, Y or Z")
    return "XYZ".index(axis)


def moves(prim: Any) -> bool:
    """True if forces move a body: it is enabled and not kinematic."""
    is_enabled = bool(value_of(prim, "physics:rigidBodyEnabled", default=True))
    return is_enabled and not value_of(prim, "physics:kinematicEnabled", default=False)
