"""Stages of USD: bodies and joints in order, poses in metres, and the articulation they form."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.gravity import STRENGTH
from ..core.numbers import printed
from ..core.third_party import captured_stderr, third_party_errors
from ..errors import MissingExtraError, RobotFileError, UnknownNameError
from ..lie import quaternion, se3, so3
from ..lie.identity import IDENTITY, pose_rows
from ..typing import Array

"""Default magnitude of gravity [m/s²]."""
_SINGLE = 1e-5
"""Error of rotations in single precision."""


def opened(path: Path, folders: Sequence[Path]) -> Any:
    """The stage of a file whose layers all lie below ``folders``.

    Raises :class:`~twistwrench.MissingExtraError` and :class:`~twistwrench.RobotFileError`.
    """
    try:
        from pxr import Usd
    except ImportError:
        raise MissingExtraError.from_extra("usd-core", "usd", "Reading USD") from None
    with (
        third_party_errors(lambda reason: RobotFileError(f"it cannot be read as USD: {reason}.")),
        captured_stderr() as said,
    ):
        stage = Usd.Stage.Open(str(path.resolve()))
    if str(said):  # a layer that is not there is a warning to the library, and a part of the robot to us
        raise RobotFileError(f"it cannot be read whole: {' '.join(str(said).split())[:300]}")
    allowed = [folder.resolve() for folder in folders]
    for layer in stage.GetUsedLayers():
        place = Path(layer.realPath).resolve() if layer.realPath else None
        if place is not None and not any(place.is_relative_to(folder) for folder in allowed):
            raise RobotFileError(
                f"it takes in {str(place)!r}, which lies outside its folder. To read it, say include_paths=[its folder]."
            )
    return stage


@dataclass(frozen=True, eq=False)
class End:
    """One side of a joint: the body it is on, None for the world, and the joint's frame there."""

    body: Any
    T: Array

    @property
    def path(self) -> Any:
        """Frame of the joint in the body."""
        return None if self.body is None else self.body.GetPath()


class Stage:
    """Bodies and joints of a stage in its order, poses in metres."""

    def __init__(self, stage: Any, max_bodies: int) -> None:
        from pxr import Usd, UsdGeom, UsdPhysics

        self.metre = float(UsdGeom.GetStageMetersPerUnit(stage))
        self.kilogram = float(UsdPhysics.GetStageKilogramsPerUnit(stage))
        for name, unit in (("metersPerUnit", self.metre), ("kilogramsPerUnit", self.kilogram)):
            if not 0 < unit < math.inf:
                raise RobotFileError(f"it has {name} = {printed(unit)}; a positive number is expected.")
        self.up = 2 if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else 1
        self.cache = UsdGeom.XformCache(Usd.TimeCode.Default())
        self.bodies: list[Any] = []
        self.joints: list[Any] = []
        self.roots: list[Any] = []
        self.scenes: list[Any] = []
        for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
            if prim.HasAPI(UsdPhysics.RigidBodyAPI) and moves(prim):
                self.bodies.append(prim)
                if len(self.bodies) > max_bodies:
                    raise RobotFileError(
                        f"it has more than {max_bodies:,} bodies ({who(prim)}). Raise the limit, max_bodies=, if it is meant."
                    )
            if prim.IsA(UsdPhysics.Joint) and value_of(prim, "physics:jointEnabled", default=True):
                self.joints.append(prim)
            if prim.HasAPI(UsdPhysics.ArticulationRootAPI):
                self.roots.append(prim)
            if prim.IsA(UsdPhysics.Scene):
                self.scenes.append(prim)
        self.numbers = {prim.GetPath(): k for k, prim in enumerate(self.bodies)}
        self.default = stage.GetDefaultPrim()
        self.prim_at = stage.GetPrimAtPath

    def placed(self, prim: Any) -> tuple[Array, Array]:
        """The pose (4, 4) of a prim on the stage, and the scale (3,) of what lies in it."""
        M = np.array(self.cache.GetLocalToWorldTransform(prim))
        scale = np.sqrt((M[:3, :3] ** 2).sum(axis=1))
        if not scale.min() > 0:
            raise RobotFileError(f"{who(prim)} is scaled to nothing.")
        R = (M[:3, :3] / scale[:, None]).T  # rows of theirs are the images of the axes
        if np.abs(R.T @ R - np.eye(3)).max() > _SINGLE or np.linalg.det(R) < 0:
            raise RobotFileError(
                f"{who(prim)} is sheared or mirrored by its transforms, which no body can be. Apply them to its shapes."
            )
        return se3.pose(so3.project(R), M[3, :3] * self.metre), scale

    def parts(self, body: Any) -> Iterator[Any]:
        """Prims of a body, itself first, without those of nested bodies."""
        from pxr import Usd

        prims = iter(Usd.PrimRange(body, Usd.TraverseInstanceProxies()))
        for prim in prims:
            if prim != body and prim.GetPath() in self.numbers:
                prims.PruneChildren()
            else:
                yield prim

    def shaped(self, body: Any) -> bool:
        """True if a body has a visual or a collider."""
        from pxr import UsdGeom

        return any(prim.IsA(UsdGeom.Gprim) for prim in self.parts(body))

    def gravity(self) -> Array:
        """(3,) m/s²: of the scene, else of the earth, downward."""
        down = -np.eye(3)[self.up]
        if not self.scenes:
            return STRENGTH * down
        direction = vector_of(self.scenes[0], "physics:gravityDirection", (0.0, 0.0, 0.0))
        magnitude = number_of(self.scenes[0], "physics:gravityMagnitude", -math.inf)
        size = STRENGTH if magnitude < 0 else magnitude * self.metre
        length = float(np.linalg.norm(direction))
        return size * (direction / length if length > 0 else down)

    def end(self, joint: Any, which: int) -> End:
        """Body at one side of a joint, and the joint's frame there; the stage if there is none."""
        targets = joint.GetRelationship(f"physics:body{which}").GetTargets()
        if len(targets) > 1:
            raise RobotFileError(f"{who(joint)} has {len(targets)} targets for body{which}; one is allowed.")
        T = IDENTITY
        prim = self.prim_at(targets[0]) if targets else None
        if prim is not None and not prim:
            raise RobotFileError(f"{who(joint)} has body{which} at {targets[0]}, where nothing is.")
        scale = np.ones(3)
        if prim is not None:
            T, scale = self.placed(prim)
        local = vector_of(joint, f"physics:localPos{which}", (0.0, 0.0, 0.0)) * scale * self.metre
        turn = quaternion_of(joint, f"physics:localRot{which}")
        T = T @ pose_rows(quaternion.rotation(turn).tolist(), local.tolist())
        while prim is not None and prim and prim.GetPath() not in self.numbers:  # a part of a body is held by the body
            prim = prim.GetParent()
        if prim is None or not prim:
            return End(None, T)
        return End(prim, np.asarray(se3.inverse(self.placed(prim)[0]) @ T))


def who(prim: Any) -> str:
    """Name of a prim in messages."""
    return f"prim <{prim.GetPath()}>"


def value_of(prim: Any, name: str, *, default: Any) -> Any:
    """Value of an attribute, by default the schema's, then ``default``."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get() if attribute else None
    return default if value is None else value


def number_of(prim: Any, name: str, default: float = 0.0) -> float:
    """The value of an attribute that is one number."""
    return _decimal(prim, name, value_of(prim, name, default=default))


def vector_of(prim: Any, name: str, default: Sequence[float]) -> Array:
    """Value of an attribute with several numbers."""
    return np.array([_decimal(prim, name, x) for x in value_of(prim, name, default=default)])


def _decimal(prim: Any, name: str, x: Any) -> float:
    """Shortest decimal that rounds to the same single-precision number."""
    x = float(x)
    if math.isnan(x):
        raise RobotFileError(f"{who(prim)} has {name} = nan, which is not a number.")
    with np.errstate(over="ignore"):
        single = np.float32(x)
    return float(str(single)) if float(single) == x else x


def quaternion_of(prim: Any, name: str) -> list[float]:
    """Quaternion (w, x, y, z); zeros stand for the identity."""
    value = value_of(prim, name, default=None)
    Q = [1.0, 0.0, 0.0, 0.0] if value is None else [float(value.GetReal()), *map(float, value.GetImaginary())]
    return Q if any(Q) else [1.0, 0.0, 0.0, 0.0]


def axis_of(prim: Any, name: str = "physics:axis", default: str = "X") -> int:
    """Axis (0, 1 or 2) of a joint's motion, or of a shape."""
    return "XYZ".index(str(value_of(prim, name, default=default)))


def moves(prim: Any) -> bool:
    """True if forces move a body: it is enabled and not kinematic."""
    return bool(value_of(prim, "physics:rigidBodyEnabled", default=True)) and not value_of(
        prim, "physics:kinematicEnabled", default=False
    )


# ── Articulation: bodies and joints of a stage, in order from the base

HOW_TO_SPLIT = (
    "Write it as revolute, prismatic, spherical and fixed joints with bodies between, or load the URDF or MJCF file that the "
    "stage was made of"
)
"""Advice for a joint that is not read."""


@dataclass(frozen=True, eq=False)
class TreeJoint:
    """Joint of the tree, from a placed link to the next one."""

    joint: Any
    near: End
    far: End
    forward: bool
    """True if the far body is the joint's body1."""


class UsdTree:
    """One articulation of a stage: ``model`` names its root, by its name or path, where there are several."""

    def __init__(self, stage: Stage, model: str | None) -> None:
        self.stage = stage
        self.ends = {joint.GetPath(): (stage.end(joint, 0), stage.end(joint, 1)) for joint in stage.joints}
        self.root = self._chosen_root(model)

    def _chosen_root(self, model: str | None) -> Any:
        roots = self.stage.roots
        if model is not None:
            by_name = {name: prim for prim in roots for name in (prim.GetName(), str(prim.GetPath()))}
            if model not in by_name:
                raise UnknownNameError.from_choices("articulation", model, by_name)
            return by_name[model]
        if len(roots) > 1:
            paths = ", ".join(str(prim.GetPath()) for prim in roots)
            raise RobotFileError(f"it has {len(roots)} articulations: {paths}. Say which, model=….")
        return roots[0] if roots else None

    def joints(self) -> tuple[list[TreeJoint], list[Any], Any]:
        """The joints outward from the base, those that close loops, and the body that no joint holds, if there is one."""
        inside = [joint for joint in self.stage.joints if not _excluded(joint)]
        tied: dict[Any, list[Any]] = {None: []}  # the joints of each body, and of the world
        for joint in inside:
            paths = {end.path for end in self.ends[joint.GetPath()]}
            if len(paths) == 1:
                raise RobotFileError(f"{who(joint)} has one body at both ends. Name another one.")
            for path in paths:
                tied.setdefault(path, []).append(joint)
        within = self._within(tied)
        tied[None] = [joint for joint in tied[None] if within & {end.path for end in self.ends[joint.GetPath()]}]
        start = None if tied[None] else self._first(within)
        found: dict[Any, TreeJoint] = {}  # by the path of the joint
        waiting = [None if start is None else start.GetPath()]
        met = set(waiting)
        for at in waiting:  # which grows on the way
            for joint in tied.get(at, []):
                if joint.GetPath() in found:
                    continue
                first, second = self.ends[joint.GetPath()]
                near, far = (first, second) if first.path == at else (second, first)
                if far.path in met:
                    raise RobotFileError(_too_many(joint, near, far, found.values()))
                met.add(far.path)
                waiting.append(far.path)
                found[joint.GetPath()] = TreeJoint(joint, near, far, forward=near is first)
        ordered = [found[joint.GetPath()] for joint in inside if joint.GetPath() in found]
        outside = (joint for joint in self.stage.joints if _excluded(joint))
        return (
            ordered,
            [joint for joint in outside if {end.path for end in self.ends[joint.GetPath()]} <= met | {None}],
            start,
        )

    def _within(self, tied: dict[Any, list[Any]]) -> set[Any]:
        """Bodies of the articulation: all that joints connect with one below its root, or with its joint."""
        paths = [body.GetPath() for body in self.stage.bodies]
        if not paths:
            raise RobotFileError("it has no rigid body (PhysicsRigidBodyAPI). Is it a stage of looks only?")
        if self.root:
            root = self.root.GetPath()
            joints = [joint for joint in self.stage.joints if joint.GetPath().HasPrefix(root)]
            found = {path for path in paths if path.HasPrefix(root)}
            found |= {end.path for joint in joints for end in self.ends[joint.GetPath()]} - {None}
        else:
            found = {next((path for path in paths if path in tied), paths[0])}
        if not found:
            raise RobotFileError(f"{who(self.root)} is the root of an articulation without a body.")
        waiting = list(found)
        for path in waiting:
            new = {end.path for joint in tied.get(path, []) for end in self.ends[joint.GetPath()]} - found - {None}
            found |= new
            waiting.extend(new)
        return found

    def _first(self, within: set[Any]) -> Any:
        """Floating body: the articulation's root if it is a body, else the first that is not the body1 of a joint."""
        mine = [body for body in self.stage.bodies if body.GetPath() in within]
        if self.root and self.root.GetPath() in within:
            return self.root
        carried = {end.path for _, end in self.ends.values()}
        return next((body for body in mine if body.GetPath() not in carried), mine[0])


def _excluded(joint: Any) -> bool:
    return bool(value_of(joint, "physics:excludeFromArticulation", default=False))


def _too_many(joint: Any, near: End, far: End, found: Iterable[TreeJoint]) -> str:
    """Message for a joint between two links that are joined already."""
    twin = next((one.joint for one in found if {one.near.path, one.far.path} == {near.path, far.path}), None)
    if twin is not None:
        return f"{who(joint)} and {who(twin)} join the same two bodies. {HOW_TO_SPLIT}."
    return f"{who(joint)} closes a loop. Cut it open there with excludeFromArticulation; robot.close closes it."
