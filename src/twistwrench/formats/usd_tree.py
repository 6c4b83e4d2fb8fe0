"""Which bodies and joints of a USD stage are one articulation, and in which order its joints hang from the base."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ..errors import RobotFileError, UnknownNameError
from .usd_stage import End, Stage, value_of, who

HOW_TO_SPLIT = (
    "Write it as revolute, prismatic, spherical and fixed joints with bodies between, or load the URDF or MJCF file that the "
    "stage was made of"
)
"""What to do about a joint that is not read."""


@dataclass(frozen=True, eq=False)
class TreeJoint:
    """A joint from a link that is placed already to the next one."""

    joint: Any
    near: End
    far: End
    forward: bool
    """Whether the next one is the joint's body1."""


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
                raise UnknownNameError.of("articulation", model, by_name)
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
        """The bodies of the articulation: all that hang together with one below its root, or with its joint."""
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
        """The body that floats: the articulation's root where that is one, else the first that is nobody's body1."""
        mine = [body for body in self.stage.bodies if body.GetPath() in within]
        if self.root and self.root.GetPath() in within:
            return self.root
        carried = {end.path for _, end in self.ends.values()}
        return next((body for body in mine if body.GetPath() not in carried), mine[0])


def _excluded(joint: Any) -> bool:
    return bool(value_of(joint, "physics:excludeFromArticulation", default=False))


def _too_many(joint: Any, near: End, far: End, found: Iterable[TreeJoint]) -> str:
    """What to say of a joint between two links that are joined already."""
    twin = next((one.joint for one in found if {one.near.path, one.far.path} == {near.path, far.path}), None)
    if twin is not None:
        return f"{who(joint)} and {who(twin)} join the same two bodies. {HOW_TO_SPLIT}."
    return f"{who(joint)} closes a loop. Cut it open there with excludeFromArticulation; robot.close closes it."
