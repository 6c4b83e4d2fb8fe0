"""Articulation of a USD stage: its bodies and joints, ordered from the base."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ...core.errors import RobotFileError, UnknownNameError
from ...core.text import argument, listed
from .stage import End, Stage, value_of, who

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
        if not roots:
            return None
        return roots[0]

    def _bodies_of(self, joint: Any) -> set[Any]:
        """Paths of the bodies at both ends of a joint; None for the world."""
        first, second = self.ends[joint.GetPath()]
        return {first.path, second.path}

    def joints(self) -> tuple[list[TreeJoint], list[Any], Any]:
        """Joints ordered from the base, loop-closing joints, and the body without a joint to the world, if any."""
        inside, outside = list[Any](), list[Any]()
        for joint in self.stage.joints:
            if value_of(joint, "physics:excludeFromArticulation", default=False):
                outside.append(joint)
            else:
                inside.append(joint)
        joints_of: dict[Any, list[Any]] = {None: []}  # by the path of a body, None for the world
        for joint in inside:
            paths = self._bodies_of(joint)
            if len(paths) == 1:
                raise RobotFileError(f"{who(joint)} has one body at both ends. Name another one.")
            for path in paths:
                joints_of.setdefault(path, []).append(joint)
        members = self._members(joints_of)
        joints_of[None] = [joint for joint in joints_of[None] if members & self._bodies_of(joint)]
        start = None
        if not joints_of[None]:
            start = self._first(members)
        tree, reached = self._walk(start, joints_of)
        ordered = [tree[joint.GetPath()] for joint in inside if joint.GetPath() in tree]
        closing = [joint for joint in outside if self._bodies_of(joint) <= reached | {None}]
        return ordered, closing, start

    def _walk(self, start: Any, joints_of: dict[Any, list[Any]]) -> tuple[dict[Any, TreeJoint], set[Any]]:
        """Joints of the tree by path, breadth first from a body or the world, and the paths of the bodies reached."""
        tree: dict[Any, TreeJoint] = {}
        start_path = None
        if start is not None:
            start_path = start.GetPath()
        waiting = deque([start_path])
        reached = {start_path}
        while waiting:
            path = waiting.popleft()
            for joint in joints_of.get(path, []):
                if joint.GetPath() in tree:
                    continue
                first, second = self.ends[joint.GetPath()]
                near, far = first, second
                if first.path != path:
                    near, far = second, first
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
            jointed = [path for path in paths if path in joints_of]
            members = {(jointed or paths)[0]}
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


def _text_for_loop(joint: Any, near: End, far: End, tree: Iterable[TreeJoint]) -> str:
    """Error message for a joint between two links that are already joined."""
    for other in tree:
        if {other.near.path, other.far.path} == {near.path, far.path}:
            return f"{who(joint)} and {who(other.joint)} join the same two bodies. {HOW_TO_SPLIT}."
    return f"{who(joint)} closes a loop. Cut it open there with excludeFromArticulation; robot.close closes it."
