"""URDF of a recorded robot with its shapes, and the coordinates and poses of its joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...core.errors import ModelError, NotFoundError
from ...core.typing import Array
from ...formats.robot_file import file_of
from ...formats.source import find_resource
from ...formats.writers import write_urdf
from ...formats.xml import Element, parse
from ...mechanics.lie import quaternion, se3

if TYPE_CHECKING:
    from ...mechanics.model.model import Model
    from ...robot import Robot


def robot_description(model: Model, *, local: bool = False) -> Element:
    """Root element of the model's URDF: locked joints are fixed, and shapes are those of the robot's own URDF file.

    Mesh names relative to the file become addresses of files. If ``local``, all mesh names become paths, and shapes whose mesh
    file is missing are left out.
    """
    description = parse(write_urdf(model).text)
    try:
        file = file_of(model)
        root = description if file is None else file.root  # no shapes without a file
    except (ModelError, NotFoundError, OSError, ValueError):  # the file changed since the robot was loaded
        return description
    if file is None or root.tag != "robot":
        return description
    link_by_name = {link.attributes["name"]: link for link in description.all("link")}
    description.children = [*root.all("material"), *description.children]
    for link in root.all("link"):
        name = link.attributes.get("name", "")
        described_link = link_by_name.get(name)
        if described_link is None:
            continue
        for original in (*link.all("visual"), *link.all("collision")):
            shape = original.deep_copy()
            if _resolve_meshes(shape, Path(file), local=local):
                described_link.add(shape)
    return description


def _resolve_meshes(shape: Element, file: Path, *, local: bool) -> bool:
    """Replace mesh names of a shape as in :func:`robot_description`; False if ``local`` and a mesh file is missing."""
    for mesh in shape.walk():
        if mesh.tag != "mesh":
            continue
        name = mesh.attributes.get("filename", "")
        path = find_resource(name, file)
        if path is None:
            if local:
                return False
        elif local:
            mesh.attributes["filename"] = str(path.resolve())
        elif "://" not in name:
            mesh.attributes["filename"] = path.resolve().as_uri()
    return True


@dataclass(frozen=True, eq=False)
class MovingJoints:
    """Moving joints of a description and their coordinates in a motion."""

    robot: Robot
    description: Element
    """URDF of the robot."""

    @cached_property
    def joints(self) -> dict[str, Element]:
        """Joints of the description by name."""
        return {joint.attributes["name"]: joint for joint in self.description.all("joint")}

    def coordinates(self, q: Array) -> dict[str, Array]:
        """Coordinates (n,) of joints with one coordinate, including mimic joints, by name."""
        coordinates = {}
        for body in self.robot.model.bodies:
            if body.joint.nq == 1:
                coordinates[body.joint.name] = body.ratio * q[:, body.q_index] + body.offset
        for name, joint in self.joints.items():  # mimic joints that the model does not have
            mimic = joint.child("mimic")
            if mimic is not None and name not in coordinates:
                leader = coordinates[mimic.attributes["joint"]]
                coordinates[name] = mimic.number("multiplier") * leader + mimic.number("offset")
        return coordinates

    def transforms(self, q: Array) -> Iterator[tuple[str, str, Array, Array]]:
        """Parent, child, position (n, 3) and quaternion x, y, z, w (n, 4) of each joint with several coordinates.

        A ball joint is three joints in the description; the pose is that of the first, which has the whole rotation.
        """
        bodies = [body for body in self.robot.model.bodies if body.joint.nq > 1]
        if not bodies:
            return
        link_names = list(self.robot.link_names)
        T = np.asarray(self.robot.link_poses(q))
        for body in bodies:
            joint = self.joints.get(body.joint.name)
            if joint is None:  # a ball joint: its first joint
                joint = self.joints[f"{body.joint.name}.x"]
            parent = joint.require_child("parent", "").text("link")
            child = joint.require_child("child", "").text("link")
            pose = T[:, link_names.index(body.link)]  # (n, 4, 4)
            if parent in link_names:  # excludes the world of a floating base
                T_parent = T[:, link_names.index(parent)]
                pose = se3.inverse(T_parent) @ pose
            scalar_first = quaternion.from_matrix(pose[:, :3, :3])
            scalar_last = np.roll(scalar_first, -1, axis=-1)  # w, x, y, z → x, y, z, w
            yield parent, child, pose[:, :3, 3], scalar_last
