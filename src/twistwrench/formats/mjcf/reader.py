"""Reader of MJCF: links, joints and keyframes of a robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass

import numpy as np

from ...bodies.inertia import SpatialInertia
from ...errors import RobotFileError, UnknownNameError
from ...joints.screw_joint import screw_motion
from ...lie import se3
from ...lie.identity import IDENTITY, UPRIGHT, product
from ...model.builder import ModelBuilder
from ...model.description import Mimic, ModelNote
from ...typing import Array
from ..known_elements import LEFT_OUT, Unread
from ..xml import Element
from .bodies import (
    COORDINATES,
    WORLD,
    MjcfBody,
    MjcfJoint,
    inertias_of,
    joints_of,
    names_given,
    screw,
    shape_of,
    survey,
    unused,
)
from .drives import Drives, add_closures, add_tendons, constraints_of, drives_of, mimics
from .preprocess import Defaults, Folders, Meshes, Settings, disabled_by, expand, fluid_of, gravity_of


@dataclass(frozen=True, eq=False)
class ChainLink:
    """Joint from a link to the next; None if fixed."""

    joint: MjcfJoint | None
    parent: str
    child: str
    placement: Array
    """(4, 4) of the child in the parent, the coordinate at zero."""


def chain(joints: Sequence[MjcfJoint], parent: str, body: str, T: Array) -> Iterator[ChainLink]:
    """The joints from the parent's link to the body's, whose pose there is T (4, 4) with every joint at its reference.

    T_parent,body = T Π exp([S_i] (q_i - ref_i)) with screw axes S_i in the body's frame; a free joint holds the body's pose.
    """
    if joints and joints[0].kind == "floating":
        T = IDENTITY
    for n, joint in enumerate(joints):
        last = n == len(joints) - 1
        before, after = IDENTITY, IDENTITY
        if joint.kind == "ball" and joint.point.any():  # turns about its point, and the body's frame goes with it
            before, after = (se3.pose(np.eye(3), sign * joint.point) for sign in (1.0, -1.0))
            last = False
        elif joint.single and joint.reference:
            before = np.asarray(screw_motion(screw(joint), -joint.reference), float)
        child = body if last else f"{body}:{joint.name}"
        yield ChainLink(joint, parent, child, product(T, before))
        parent, T = child, after
    if parent != body:
        yield ChainLink(None, parent, body, T)


def add_joints(
    builder: ModelBuilder, steps: Iterable[ChainLink], body: str, drives: Drives, disabled: Set[str],
    follow: Mapping[str, Mimic], names: set[str], where: str = "",
) -> None:  # fmt: skip
    """Add the joints of a body with their drives, springs and hidden links; ``names`` are taken."""
    for step in steps:
        joint = step.joint
        if step.child != body:
            builder.add_link(step.child, hidden=True)
        if joint is None:
            name = unused(f"{body}.fixed", names)
            builder.add_joint(name, "fixed", step.parent, step.child, placement=step.placement, where=where)
            continue
        for said in joint.remarks:
            builder.remark(ModelNote(joint.who, said))
        options = {"damping": 0.0, "armature": 0.0, **joint.options}
        options["armature"] += drives.armature.get(joint.name, 0.0)
        options["damping"] = 0.0 if "damper" in disabled else options["damping"] + drives.damping.get(joint.name, 0.0)
        if "frictionloss" in disabled:
            options["friction"] = 0.0
        builder.add_joint(
            joint.name, joint.kind, step.parent, step.child, placement=step.placement,
            axis=screw(joint) if joint.single else (0.0, 0.0, 1.0), effort=drives.efforts.get(joint.name),
            mimic=follow.get(joint.name), where=joint.where, **options,
        )  # fmt: skip
        if joint.single and joint.stiffness and "spring" not in disabled:
            builder.add_spring({joint.name: 1.0}, joint.stiffness, joint.rest, where=joint.where)


# ── Keyframes, and the initial configuration

REFERENCE = "qpos0"
"""MuJoCo's name of the configuration in which the file describes the bodies."""


def add_configurations(
    builder: ModelBuilder, root: Element, joints: Sequence[tuple[MjcfJoint, Array]], kept: set[str]
) -> None:
    """``qpos0`` and the keyframes; ``joints`` are those of the file in order, each with the pose of its body."""
    start = np.concatenate([np.zeros(0), *(_reference(joint, T) for joint, T in joints)])
    add_keyframe(builder, REFERENCE, start, [joint for joint, _ in joints], kept)
    keys = [key for section in root.all("keyframe") for key in section.all("key")]
    for k, key in enumerate(keys):
        name = key.attributes.get("name", "").strip() or f"key{k}"
        if "qpos" not in key.attributes:
            continue
        q = key.numbers("qpos", len(key.text("qpos").split()))
        if len(q) != len(start):
            raise RobotFileError(f"{key} has {len(q)} numbers in qpos; the model has {len(start)} coordinates.")
        add_keyframe(builder, name, q, [joint for joint, _ in joints], kept)


def _reference(joint: MjcfJoint, T: Array) -> Array:
    if joint.single:
        return np.array([joint.reference])
    if joint.kind == "ball":
        return np.array([1.0, 0.0, 0.0, 0.0])
    return np.concatenate([T[:3, 3], quaternion_of(T[:3, :3])])


def quaternion_of(R: Array) -> Array:
    """(w, x, y, z) of a rotation, w not negative."""
    if R.tolist() == UPRIGHT:  # most are, and SciPy takes long to import
        return np.array([1.0, 0.0, 0.0, 0.0])
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(R).as_quat()
    Q = np.array([w, x, y, z])
    return -Q if w < 0 else Q


def add_keyframe(builder: ModelBuilder, name: str, q: Array, joints: Sequence[MjcfJoint], kept: Set[str]) -> None:
    """Add a named configuration from ``qpos``; ``joints`` are all in its order, of which those ``kept`` are in the model."""
    positions: dict[str, Array] = {}
    at = 0
    for joint in joints:
        mine = q[at : at + COORDINATES[joint.kind]]
        at += len(mine)
        if joint.name in kept:
            if joint.kind == "floating":
                mine = np.concatenate([mine[3:], mine[:3]])
            if not joint.single and not mine[:4].any():
                mine = np.concatenate([[1.0], mine[1:]])
            positions[joint.name] = mine
    builder.add_configuration(name, positions)


# ── From the elements of an MJCF file to the builder's links and joints


def read_mjcf(
    root: Element,
    source: str = "",
    folders: Folders | None = None,
    *,
    floating_base: bool | None = None,
    keep: str | None = None,
    max_bodies: int = 20_000,
) -> tuple[ModelBuilder, bool]:
    """Builder with the bodies and joints of a ``<mujoco>`` element, and True if its root link floats besides.

    ``floating_base`` None follows the file; True keeps free joints, or lets the world's link float where there is none;
    False holds the bodies of free joints where the file puts them. ``keep`` takes one body and all that it carries. Other files
    are read from ``folders`` only.

    Raises :class:`~twistwrench.RobotFileError` with element and line for what is not allowed and what is not read, and
    :class:`~twistwrench.UnknownNameError` for a body to keep that is not there.
    """
    expand(root, folders or Folders(None), max_bodies)
    return _Reader(root, source, folders or Folders(None), floating_base, keep).read()


class _Reader:
    """Reader of one file."""

    def __init__(
        self, root: Element, source: str, folders: Folders, floating_base: bool | None, keep: str | None
    ) -> None:
        self.root = root
        self.floating_base = floating_base
        self.settings, self.defaults = Settings.from_root(root), Defaults(root)
        self.builder = ModelBuilder(root.attributes.get("model", "").strip() or "robot", source)
        self.builder.gravity = gravity_of(root)
        self.bodies = survey(root, self.settings, self.defaults)
        self.meshes = Meshes(root, self.settings, self.defaults, folders)
        taken = names_given(self.bodies)
        self.joints = [joints_of(body, self.settings, taken) for body in self.bodies]
        self.names = taken
        self.kept = _kept(self.bodies, keep)
        self.disabled = disabled_by(root)
        self.drives = Drives({}, {}, {}, [])

    def read(self) -> tuple[ModelBuilder, bool]:
        """The builder, and True if its root floats."""
        by_name = self._by_name()
        floats = [j for mine in self.joints for j in mine if j.kind == "floating"]
        kept = {
            j.name for k in self.kept for j in self.joints[k] if j.kind != "floating" or self.floating_base is not False
        }
        constraints = [] if "equality" in self.disabled else constraints_of(self.root, self.defaults)
        follow, remarks = mimics(constraints, by_name, kept)
        self.drives = drives_of(self.root, by_name, self.settings, self.defaults)
        inertias = inertias_of(self.bodies, self.settings, self.meshes)
        for text in (*inertias.remarks, *remarks, *self.drives.remarks):
            self.builder.remark(text)
        world = self.bodies[0]
        self.builder.add_link(WORLD, SpatialInertia.zero(), shaped=bool(world.geoms))
        poses = self._poses()
        for k in self.kept:
            self._add_body(k, inertias.each[k], poses, follow)
        for k in (0, *self.kept):  # once all links are known, whose names come first
            self._add_sites(self.bodies[k])
        if "spring" not in self.disabled:
            add_tendons(self.builder, self.root, by_name, kept, self.defaults)
        add_closures(self.builder, constraints, self.bodies, poses, {0, *self.kept})
        ordered = [(j, poses[k]) for k, mine in enumerate(self.joints) for j in mine]
        add_configurations(self.builder, self.root, ordered, kept)
        fluid = fluid_of(self.root)
        if fluid is not None:
            self.builder.remark(ModelNote(str(fluid), LEFT_OUT["option/density"]))
        for flex in (one for section in self.root.all("deformable") for one in section.all("flex")):
            self.builder.remark(ModelNote(str(flex), LEFT_OUT["deformable/flex"]))
        unread = Unread("MJCF")
        unread.walk(self.root)
        for text in unread.remarks:
            self.builder.remark(text)
        return self.builder, bool(self.floating_base) and not any(j.name in kept for j in floats)

    def _by_name(self) -> dict[str, MjcfJoint]:
        found: dict[str, MjcfJoint] = {}
        for mine in self.joints:
            for joint in mine:
                if joint.name in found:
                    raise RobotFileError(
                        f"{joint.element} has the name of {found[joint.name].element}. Each joint needs a name of its own."
                    )
                found[joint.name] = joint
        return found

    def _poses(self) -> list[Array]:
        """Poses of all bodies in the world, joints at their reference."""
        found = [IDENTITY]
        for body in self.bodies[1:]:
            found.append(product(found[body.parent], body.T))
        return found

    def _add_body(
        self,
        k: int,
        inertia: SpatialInertia,
        poses: Sequence[Array],
        follow: Mapping[str, Mimic],
    ) -> None:
        body, where = self.bodies[k], self.bodies[k].element.place
        self.builder.add_link(body.name, inertia, where, shaped=bool(body.geoms))
        if body.element.floats("gravcomp", (0.0,))[0]:
            self.builder.remark(ModelNote(str(body.element), LEFT_OUT["body/gravcomp"]))
        for plugin in body.plugins:
            self.builder.remark(ModelNote(str(plugin), LEFT_OUT["body/plugin"]))
        top = body.parent not in self.kept  # what stands in the world, or what is kept of more
        parent = WORLD if top else self.bodies[body.parent].name
        pending = poses[k] if top else body.T
        joints = list(self.joints[k])
        if joints and joints[0].kind == "floating" and self.floating_base is False:
            joints = []
        add_joints(
            self.builder, chain(joints, parent, body.name, pending), body.name, self.drives, self.disabled, follow, self.names,
            where,
        )  # fmt: skip

    def _add_sites(self, body: MjcfBody) -> None:
        for part in body.sites:
            name = part.element.attributes.get("name", "").strip()
            if name:
                kind = part.element.attributes.get("type", "sphere").strip()
                T, _ = shape_of(part.element, kind, self.settings)
                self.builder.add_site(name, body.name, product(part.frame, T), where=part.element.place)


def _kept(bodies: Sequence[MjcfBody], keep: str | None) -> dict[int, None]:
    """Numbers of the bodies to read, in order, without the world."""
    if keep is None:
        return dict.fromkeys(range(1, len(bodies)))
    numbers = {body.name: k for k, body in enumerate(bodies) if k}
    if keep not in numbers:
        raise UnknownNameError.from_choices("body to keep", keep, numbers)
    found = {numbers[keep]}
    for k in range(numbers[keep] + 1, len(bodies)):
        if bodies[k].parent in found:
            found.add(k)
    return dict.fromkeys(sorted(found))
