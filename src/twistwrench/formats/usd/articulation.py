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
    """Prim of the joint."""
    near: End
    """Proximal end, toward the base."""
    far: End
    """Distal end."""
    forward: bool
    """True if the distal body is the joint's body1."""


class UsdTree:
    """One articulation of a stage; ``model`` selects the root by name or path if there are several."""

    def __init__(self, stage: Stage, model: str | None) -> None:
        self.stage = stage
        self.ends = {joint.GetPath(): (stage.end(joint, 0), stage.end(joint, 1)) for joint in stage.joints}
        """Ends of each joint at body0 and body1, by the path of the joint."""
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
        return roots[0] if roots else None

    def _bodies_of(self, joint: Any) -> set[Any]:
        """Paths of the bodies at both ends of a joint, with None for the world."""
        first, second = self.ends[joint.GetPath()]
        return {first.path, second.path}

    def joints(self) -> tuple[list[TreeJoint], list[Any], Any]:
        """Joints of the tree in document order, loop-closing joints, and the floating body (None if the base is fixed)."""
        included_joints: list[Any] = []  # in the articulation
        excluded_joints: list[Any] = []
        for joint in self.stage.joints:
            if value_of(joint, "physics:excludeFromArticulation", default=False):
                excluded_joints.append(joint)
            else:
                included_joints.append(joint)
        joints_at: dict[Any, list[Any]] = {None: []}  # by the path of a body, None for the world
        for joint in included_joints:
            paths = self._bodies_of(joint)
            if len(paths) == 1:
                raise RobotFileError(f"{who(joint)} has one body at both ends. Name another one.")
            for path in paths:
                joints_at.setdefault(path, []).append(joint)
        member_paths = self._member_paths(joints_at)
        joints_at[None] = [joint for joint in joints_at[None] if member_paths & self._bodies_of(joint)]
        floating_body = None
        if not joints_at[None]:
            floating_body = self._floating_body(member_paths)
        tree, reached_paths = self._walk(floating_body, joints_at)
        tree_joints = [tree[joint.GetPath()] for joint in included_joints if joint.GetPath() in tree]
        closing_joints = [joint for joint in excluded_joints if self._bodies_of(joint) <= reached_paths | {None}]
        return tree_joints, closing_joints, floating_body

    def _walk(self, start: Any, joints_at: dict[Any, list[Any]]) -> tuple[dict[Any, TreeJoint], set[Any]]:
        """Joints of the tree by path, and paths of the bodies that it reaches, breadth first from the body ``start``.

        None starts from the world.
        """
        tree: dict[Any, TreeJoint] = {}
        start_path = None if start is None else start.GetPath()
        waiting_paths = deque([start_path])
        reached_paths = {start_path}
        while waiting_paths:
            path = waiting_paths.popleft()
            for joint in joints_at.get(path, []):
                if joint.GetPath() in tree:
                    continue
                end_0, end_1 = self.ends[joint.GetPath()]
                near, far = end_0, end_1
                if end_0.path != path:
                    near, far = end_1, end_0
                if far.path in reached_paths:
                    raise RobotFileError(_text_for_loop(joint, near, far, tree.values()))
                reached_paths.add(far.path)
                waiting_paths.append(far.path)
                tree[joint.GetPath()] = TreeJoint(joint, near, far, forward=near is end_0)
        return tree, reached_paths

    def _member_paths(self, joints_at: dict[Any, list[Any]]) -> set[Any]:
        """Paths of the articulation's bodies: all that joints connect to a body or joint below its root.

        Without a root, all that joints connect to the first body with a joint.
        """
        paths = [body.GetPath() for body in self.stage.bodies]
        if not paths:
            raise RobotFileError("it has no rigid body (PhysicsRigidBodyAPI). Is it a stage of looks only?")
        if self.root:
            root_path = self.root.GetPath()
            member_paths = {path for path in paths if path.HasPrefix(root_path)}
            for joint in self.stage.joints:
                if joint.GetPath().HasPrefix(root_path):
                    member_paths |= self._bodies_of(joint) - {None}
        else:
            paths_with_joints = [path for path in paths if path in joints_at]
            candidates = paths_with_joints or paths
            member_paths = {candidates[0]}
        if not member_paths:
            raise RobotFileError(f"{who(self.root)} is the root of an articulation without a body.")
        waiting_paths = list(member_paths)
        while waiting_paths:
            path = waiting_paths.pop()
            for joint in joints_at.get(path, []):
                new_paths = self._bodies_of(joint) - member_paths - {None}
                member_paths |= new_paths
                waiting_paths.extend(new_paths)
        return member_paths

    def _floating_body(self, member_paths: set[Any]) -> Any:
        """The articulation's root if it is a body; otherwise the first body that is not body1 of a joint."""
        if self.root and self.root.GetPath() in member_paths:
            return self.root
        bodies = [body for body in self.stage.bodies if body.GetPath() in member_paths]
        child_paths = {second.path for _, second in self.ends.values()}
        return next((body for body in bodies if body.GetPath() not in child_paths), bodies[0])


def _text_for_loop(joint: Any, near: End, far: End, tree: Iterable[TreeJoint]) -> str:
    """Error message for a joint whose two bodies the tree already connects, by one joint or by several."""
    for other in tree:
        if {other.near.path, other.far.path} == {near.path, far.path}:
            return f"{who(joint)} and {who(other.joint)} join the same two bodies. {HOW_TO_SPLIT}."
    return f"{who(joint)} closes a loop. Cut it open there with excludeFromArticulation; robot.close closes it."
