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
    """Joint of the tree."""

    joint: Any
    near: End
    """Proximal side, toward the base."""
    far: End
    """Distal side."""
    forward: bool
    """True if the distal body is the joint's body1."""


class UsdTree:
    """One articulation of a stage; ``model`` selects the root by name or path if there are several."""

    def __init__(self, stage: Stage, model: str | None) -> None:
        self.stage = stage
        self.ends = {joint.GetPath(): (stage.end(joint, 0), stage.end(joint, 1)) for joint in stage.joints}
        """Sides body0 and body1 of each joint, by its path."""
        self.root = self._find_root(model)

    def _find_root(self, model: str | None) -> Any:
        """Root of the articulation with the name or path ``model``, or the only root; None if the stage has none."""
        roots = self.stage.roots
        if model is not None:
            root_by_name = {}
            for root in roots:
                root_by_name[root.GetName()] = root
                root_by_name[str(root.GetPath())] = root
            if model not in root_by_name:
                raise UnknownNameError.from_choices("articulation", model, root_by_name)
            return root_by_name[model]
        if len(roots) > 1:
            paths = listed(root.GetPath() for root in roots)
            raise RobotFileError(f"it has {len(roots)} articulations: {paths}. Say which, {argument('model')}.")
        if not roots:
            return None
        return roots[0]

    def _bodies_of(self, joint: Any) -> set[Any]:
        """Paths of the bodies at both ends of a joint; None for the world."""
        first, second = self.ends[joint.GetPath()]
        return {first.path, second.path}

    def joints(self) -> tuple[list[TreeJoint], list[Any], Any]:
        """Joints of the tree in document order, loop-closing joints, and the floating body (None if the base is fixed)."""
        inside: list[Any] = []  # the articulation
        outside: list[Any] = []
        for joint in self.stage.joints:
            if value_of(joint, "physics:excludeFromArticulation", default=False):
                outside.append(joint)
            else:
                inside.append(joint)
        joints_at: dict[Any, list[Any]] = {None: []}  # by the path of a body, None for the world
        for joint in inside:
            paths = self._bodies_of(joint)
            if len(paths) == 1:
                raise RobotFileError(f"{who(joint)} has one body at both ends. Name another one.")
            for path in paths:
                joints_at.setdefault(path, []).append(joint)
        members = self._members(joints_at)
        joints_at[None] = [joint for joint in joints_at[None] if members & self._bodies_of(joint)]
        floating_body = None
        if not joints_at[None]:
            floating_body = self._floating_body(members)
        tree, reached_paths = self._walk(floating_body, joints_at)
        tree_joints = [tree[joint.GetPath()] for joint in inside if joint.GetPath() in tree]
        closing = [joint for joint in outside if self._bodies_of(joint) <= reached_paths | {None}]
        return tree_joints, closing, floating_body

    def _walk(self, start: Any, joints_at: dict[Any, list[Any]]) -> tuple[dict[Any, TreeJoint], set[Any]]:
        """Joints of the tree by path, breadth first from a body or the world, and the paths of the bodies reached."""
        tree: dict[Any, TreeJoint] = {}
        start_path = None
        if start is not None:
            start_path = start.GetPath()
        waiting_paths = deque([start_path])
        reached_paths = {start_path}
        while waiting_paths:
            path = waiting_paths.popleft()
            for joint in joints_at.get(path, []):
                if joint.GetPath() in tree:
                    continue
                first, second = self.ends[joint.GetPath()]
                near, far = first, second
                if first.path != path:
                    near, far = second, first
                if far.path in reached_paths:
                    raise RobotFileError(_text_for_loop(joint, near, far, tree.values()))
                reached_paths.add(far.path)
                waiting_paths.append(far.path)
                tree[joint.GetPath()] = TreeJoint(joint, near, far, forward=near is first)
        return tree, reached_paths

    def _members(self, joints_at: dict[Any, list[Any]]) -> set[Any]:
        """Paths of the articulation's bodies: all that joints connect to a body or joint below its root.

        Without a root, they are connected to the first body that has a joint.
        """
        paths = [body.GetPath() for body in self.stage.bodies]
        if not paths:
            raise RobotFileError("it has no rigid body (PhysicsRigidBodyAPI). Is it a stage of looks only?")
        if self.root:
            root_path = self.root.GetPath()
            members = {path for path in paths if path.HasPrefix(root_path)}
            for joint in self.stage.joints:
                if joint.GetPath().HasPrefix(root_path):
                    members |= self._bodies_of(joint) - {None}
        else:
            paths_with_joints = [path for path in paths if path in joints_at]
            candidates = paths_with_joints or paths
            members = {candidates[0]}
        if not members:
            raise RobotFileError(f"{who(self.root)} is the root of an articulation without a body.")
        waiting_paths = list(members)
        while waiting_paths:
            path = waiting_paths.pop()
            for joint in joints_at.get(path, []):
                new_members = self._bodies_of(joint) - members - {None}
                members |= new_members
                waiting_paths.extend(new_members)
        return members

    def _floating_body(self, members: set[Any]) -> Any:
        """The articulation's root if it is a body; otherwise the first body that is not body1 of a joint."""
        if self.root and self.root.GetPath() in members:
            return self.root
        bodies = [body for body in self.stage.bodies if body.GetPath() in members]
        child_paths = {second.path for _, second in self.ends.values()}
        return next((body for body in bodies if body.GetPath() not in child_paths), bodies[0])


def _text_for_loop(joint: Any, near: End, far: End, tree: Iterable[TreeJoint]) -> str:
    """Error message for a joint whose two bodies the tree already connects, by one joint or by several."""
    for other in tree:
        if {other.near.path, other.far.path} == {near.path, far.path}:
            return f"{who(joint)} and {who(other.joint)} join the same two bodies. {HOW_TO_SPLIT}."
    return f"{who(joint)} closes a loop. Cut it open there with excludeFromArticulation; robot.close closes it."
