"""Reader of MJCF: links, joints and keyframes of a robot."""

from __future__ import annotations

import itertools
from collections.abc import Sequence, Set

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import UnknownNameError
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.joints.screw_joint import screw_motion
from ...mechanics.lie import quaternion, se3
from ...mechanics.lie.identity import IDENTITY, product
from ...mechanics.model.builder import ModelBuilder
from ...mechanics.model.description import unused
from ..known_elements import LEFT_OUT, unread
from ..xml import Element
from .bodies import (
    COORDINATES,
    WORLD,
    MjcfBody,
    MjcfJoint,
    inertias_of,
    joints_of,
    names_given,
    shape_of,
    survey,
)  # fmt: skip
from .drives import add_closures, add_tendons, constraints_of, drives_of, mimics, motor_joints_of
from .preprocess import Defaults, Folders, Meshes, Settings, disabled_by, expand, fluid_of, gravity_of

REFERENCE = "qpos0"
"""MuJoCo's name of the configuration in which the file describes the bodies."""


def read_mjcf(
    root: Element,
    source: str = "",
    folders: Folders | None = None,
    *,
    floating_base: bool | None = None,
    keep: str | None = None,
    max_bodies: int = 20_000,
) -> tuple[ModelBuilder, bool]:
    """Builder with the bodies and joints of a ``<mujoco>`` element, and True if its root link is to float.

    ``floating_base`` None follows the file. True keeps free joints; if the file has none, the world's link floats. False fixes
    the bodies of free joints where the file puts them. ``keep`` names a body; only this body and all that it carries are read.
    Other files are read from ``folders`` only.

    Raises :class:`~twistwrench.RobotFileError`, with element and line, if the file has elements that are invalid or not
    supported, and :class:`~twistwrench.UnknownNameError` if the body to keep is not in the file.
    """
    folders = folders or Folders(None)
    expand(root, folders, max_bodies)
    return _Reader(root, source, folders, floating_base, keep).read()


class _Reader:
    """Reader of one file."""

    def __init__(
        self, root: Element, source: str, folders: Folders, floating_base: bool | None, keep: str | None
    ) -> None:
        self.root = root
        self.floating_base = floating_base
        self.settings = Settings.from_root(root)
        self.defaults = Defaults(root)
        name = root.attributes.get("model", "").strip() or "robot"
        self.builder = ModelBuilder(name, source)
        self.builder.gravity = gravity_of(root)
        self.bodies = survey(root, self.settings, self.defaults)
        self.meshes = Meshes(root, self.settings, self.defaults, folders)
        self.names = names_given(self.bodies)
        """Names that joints have in the file."""
        self.joints = [joints_of(body, self.settings, self.names) for body in self.bodies]
        """Joints of each body, in the order of ``bodies``."""
        self.joint_by_name: dict[str, MjcfJoint] = {}
        for joint in itertools.chain.from_iterable(self.joints):
            first_joint = self.joint_by_name.setdefault(joint.name, joint)
            if first_joint is not joint:
                raise joint.element.error(f"has the name of {first_joint.element}. Each joint needs a name of its own.")
        self.poses = [IDENTITY]
        """Poses of all bodies in the world when all joints are at their reference."""
        for body in self.bodies[1:]:
            self.poses.append(product(self.poses[body.parent], body.T))
        self.kept_bodies = _indices_of_kept_bodies(self.bodies, keep)
        self.disabled = disabled_by(root)
        """Names of the effects that the file turns off."""

    def read(self) -> tuple[ModelBuilder, bool]:
        """The builder, and True if its root floats."""
        builder, root = self.builder, self.root
        free_joints = {joint.name for joint in self.joint_by_name.values() if joint.kind == "floating"}
        kept_joints: set[str] = set()
        for k in self.kept_bodies:
            kept_joints |= {joint.name for joint in self.joints[k]}
        if self.floating_base is False:
            kept_joints -= free_joints
        constraints = [] if "equality" in self.disabled else constraints_of(root, self.defaults)
        inertias = inertias_of(self.bodies, self.settings, self.meshes)
        builder.remark(*inertias.remarks)
        self.follow = mimics(builder, constraints, self.joint_by_name, kept_joints)
        self.drives = drives_of(builder, root, self.joint_by_name, self.settings, self.defaults)
        builder.add_motors(motor_joints_of(root, self.joint_by_name, self.defaults) & kept_joints)
        builder.add_link(WORLD, SpatialInertia.zero(), shaped=bool(self.bodies[0].geoms))
        for k in self.kept_bodies:
            self._add_body(k, inertias.each[k])
        for k in (0, *self.kept_bodies):  # after all links, which have precedence for names
            self._add_sites(self.bodies[k])
        if "spring" not in self.disabled:
            add_tendons(builder, root, self.joint_by_name, kept_joints, self.defaults)
        add_closures(builder, constraints, self.bodies, self.poses, {0, *self.kept_bodies})
        self._add_configurations(kept_joints)
        fluid = fluid_of(root)
        if fluid is not None:
            builder.note(fluid, LEFT_OUT["option/density"])
        for element in root.children_in("deformable"):
            if element.tag == "flex":
                builder.note(element, LEFT_OUT["deformable/flex"])
        builder.remark(*unread("MJCF", root))
        has_free_joint = bool(kept_joints & free_joints)
        base_floats = bool(self.floating_base) and not has_free_joint
        return builder, base_floats

    def _add_body(self, k: int, inertia: SpatialInertia) -> None:
        """Add the link of body k, and its joints."""
        body = self.bodies[k]
        element = body.element
        self.builder.add_link(body.name, inertia, element.place, shaped=bool(body.geoms))
        gravity_compensation, *_ = element.floats("gravcomp", (0.0,))
        if gravity_compensation:
            self.builder.note(element, LEFT_OUT["body/gravcomp"])
        for plugin in body.plugins:
            self.builder.note(plugin, LEFT_OUT["body/plugin"])
        joints = self.joints[k]
        is_free = bool(joints) and joints[0].kind == "floating"
        if is_free and self.floating_base is False:
            joints = []
        if body.parent in self.kept_bodies:
            self._add_joints(joints, self.bodies[body.parent].name, body, body.T)
        else:  # child of the world, or the body to keep, whose parent is left out
            self._add_joints(joints, WORLD, body, self.poses[k])

    def _add_joints(self, joints: Sequence[MjcfJoint], parent: str, body: MjcfBody, T: Array) -> None:
        """Add the joints between the link ``parent`` and a body. T (4, 4) is the body's pose in the parent at all references.

        T_parent,body = T Π exp([S_i] (q_i - ref_i)), with screw axes S_i in the body's frame. The coordinates of a free joint
        are the body's pose itself.
        """
        if joints and joints[0].kind == "floating":
            T = IDENTITY
        for joint in joints:
            T_before = IDENTITY  # constant pose before the joint
            T_after = IDENTITY  # constant pose after the joint
            ends_at_body = joint is joints[-1]
            if joint.kind == "ball" and joint.point.any():  # turns about a point beside the origin of the body's frame
                T_before = se3.pose(np.eye(3), joint.point)
                T_after = se3.pose(np.eye(3), -joint.point)
                ends_at_body = False
            elif joint.single and joint.reference != 0.0:
                T_before = np.asarray(screw_motion(joint.screw, -joint.reference), float)
            child = body.name
            if not ends_at_body:
                child = f"{body.name}:{joint.name}"
                self.builder.add_link(child, hidden=True)
            self._add_joint(joint, parent, child, product(T, T_before))
            parent = child
            T = T_after
        if parent != body.name:  # without joints, or after a ball joint beside the origin
            name = unused(f"{body.name}.fixed", self.names)
            self.builder.add_joint(name, "fixed", parent, body.name, placement=T, where=body.element.place)

    def _add_joint(self, joint: MjcfJoint, parent: str, child: str, T: Array) -> None:
        """Add a joint with its drives and its spring; T (4, 4) is its placement in the parent."""
        name = joint.name
        where = joint.element.place
        drives = self.drives
        for text in joint.remarks:
            self.builder.note(joint.who, text)
        axis: ArrayLike = (0.0, 0.0, 1.0)
        if joint.single:
            axis = joint.screw
        damping = 0.0
        friction = 0.0
        if "damper" not in self.disabled:
            damping = joint.damping + drives.damping[name]
        if "frictionloss" not in self.disabled:
            friction = joint.friction
        self.builder.add_joint(
            name, joint.kind, parent, child, placement=T, axis=axis,
            lower=joint.lower, upper=joint.upper, effort=drives.efforts.get(name), damping=damping, friction=friction,
            armature=joint.armature + drives.armature[name], mimic=self.follow.get(name), where=where,
        )  # fmt: skip
        if name in drives.motors and name not in self.follow:
            actuator, motor_friction = drives.motors[name]
            if "frictionloss" in self.disabled:
                motor_friction = {}
            self.builder.add_actuator(actuator, motor_friction)
        if joint.single and joint.stiffness and "spring" not in self.disabled:
            self.builder.add_spring({name: 1.0}, joint.stiffness, joint.rest, where=where)

    def _add_sites(self, body: MjcfBody) -> None:
        """Add the sites of a body that have a name."""
        for site in body.sites:
            element = site.element
            name = element.attributes.get("name", "").strip()
            if name:
                shape = element.attributes.get("type", "sphere").strip()
                T, _ = shape_of(element, shape, self.settings)
                self.builder.add_site(name, body.name, product(site.frame, T), where=element.place)

    def _add_configurations(self, kept_joints: Set[str]) -> None:
        """Add ``qpos0`` and the keyframes."""
        references = [np.zeros(0)]  # so that concatenate accepts a file without joints
        for joints, T in zip(self.joints, self.poses, strict=True):
            references += [_reference_coordinates(joint, T) for joint in joints]
        q_reference = np.concatenate(references)
        self._add_keyframe(REFERENCE, q_reference, kept_joints)
        keys = [element for element in self.root.children_in("keyframe") if element.tag == "key"]
        for k, key in enumerate(keys):
            if "qpos" not in key.attributes:
                continue
            q = key.numbers("qpos", len(key.text("qpos").split()))
            if len(q) != len(q_reference):
                raise key.error(f"has {len(q)} numbers in qpos; the model has {len(q_reference)} coordinates.")
            name = key.attributes.get("name", "").strip() or f"key{k}"
            self._add_keyframe(name, q, kept_joints)

    def _add_keyframe(self, name: str, q: Array, kept_joints: Set[str]) -> None:
        """Add a configuration from the coordinates q of all joints, in MuJoCo's order."""
        positions: dict[str, Array] = {}
        first_coordinate = 0
        for joint in self.joint_by_name.values():
            coordinates = q[first_coordinate : first_coordinate + COORDINATES[joint.kind]]
            first_coordinate += len(coordinates)
            if joint.name in kept_joints:
                if joint.kind == "floating":  # MuJoCo has the position before the quaternion
                    coordinates = np.concatenate([coordinates[3:], coordinates[:3]])
                if not joint.single and not coordinates[:4].any():  # a quaternion of zeros means the identity
                    coordinates = np.concatenate([[1.0], coordinates[1:]])
                positions[joint.name] = coordinates
        self.builder.add_configuration(name, positions)


def _reference_coordinates(joint: MjcfJoint, T: Array) -> Array:
    """Coordinates of a joint at its reference; T (4, 4) is the pose of its body in the world."""
    if joint.single:
        return np.array([joint.reference])
    if joint.kind == "ball":
        return np.array([1.0, 0.0, 0.0, 0.0])
    return np.concatenate([T[:3, 3], quaternion.from_matrix(T[:3, :3])])


def _indices_of_kept_bodies(bodies: Sequence[MjcfBody], keep: str | None) -> dict[int, None]:
    """Indices of the bodies to read, in order, without the world. A dict keeps the order and finds an index quickly."""
    if keep is None:
        return dict.fromkeys(range(1, len(bodies)))
    index_by_name = {body.name: k for k, body in enumerate(bodies) if k}  # body 0 is the world
    if keep not in index_by_name:
        raise UnknownNameError.from_choices("body to keep", keep, index_by_name)
    root = index_by_name[keep]
    kept_indices = {root: None}
    for k in range(root + 1, len(bodies)):  # parents come first
        if bodies[k].parent in kept_indices:
            kept_indices[k] = None
    return kept_indices
