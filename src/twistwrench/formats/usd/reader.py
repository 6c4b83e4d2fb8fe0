"""Reader of one articulation of a USD file.

The USD library may crash on a damaged file, or take all memory. The file is therefore read in a child process first; if this
succeeds, it is read again in this process.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.child_process import ChildLimits, run_in_child, sandboxed
from ...core.errors import RobotFileError
from ...core.third_party import reason_of
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.joints.screw_joint import screw_through
from ...mechanics.lie import quaternion, se3
from ...mechanics.lie.labelled import TWIST
from ...mechanics.model.assembly import ROOT_JOINT
from ...mechanics.model.builder import ModelBuilder
from ...mechanics.model.model import OfferedClosure
from ..known_elements import LeftOut, Unread
from ..sdf import add_ball
from ..xml import MOST_BODIES
from .articulation import HOW_TO_SPLIT, TreeJoint, UsdTree
from .colliders import inertia_of_shapes
from .stage import Stage, axis_of, number_of, open_stage, quaternion_of, vector_of, who

WORLD = "world"
"""Name of the link that stands for the stage."""

_KIND_OF_TYPE = {
    "PhysicsRevoluteJoint": "revolute",
    "PhysicsPrismaticJoint": "prismatic",
    "PhysicsSphericalJoint": "ball",
    "PhysicsFixedJoint": "fixed",
}
"""Kind of the builder's joint, by the type of the joint's prim."""
_MIN_NO_LIMIT = 1e30
"""Size from which a number of a file means no limit: USD has values near the largest float32, 3.4e38."""


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

    ``model`` selects the articulation by the name or path of its root. If ``floating_base`` is None, the file decides: a root
    without a joint to the world floats. False fixes such a root at its pose on the stage. Layers are read only from the folder
    of the file and from ``include_paths``. Unless TWISTWRENCH_SANDBOX is 0, the stage is read in a child process first.

    Raises :class:`~twistwrench.MissingExtraError`, :class:`~twistwrench.RobotFileError` with the path of the prim, and
    :class:`~twistwrench.UnknownNameError` for a missing articulation.
    """
    request = path, source, include_paths, floating_base, model, max_bodies
    if sandboxed():
        run_in_child(
            "twistwrench.formats.usd.reader:rehearse", *request, limits=ChildLimits(_MAX_SECONDS, _MAX_MEMORY),
            error_of=lambda reason: RobotFileError(f"it cannot be read as USD: {reason}."),
        )  # fmt: skip
    return _read(*request)


_MAX_SECONDS = 30.0
"""Largest processor time of reading a stage in a child process [s]."""
_MAX_MEMORY = 1 << 30
"""Largest memory of reading a stage in a child process [bytes]."""


def rehearse(*request: Any) -> None:
    """Read a stage in a child process, and return nothing; ``request`` are the arguments of :func:`read_usd`."""
    _read(*request)


def _read(
    path: Path,
    source: str,
    include_paths: Sequence[Path],
    floating_base: bool | None,
    model: str | None,
    max_bodies: int,
) -> tuple[ModelBuilder, bool]:
    """Result of :func:`read_usd`, read in this process."""
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
        self.names = _unique_names(stage.bodies, WORLD) | _unique_names(stage.joints)
        """Name of each link and joint, by the path of its prim."""
        self.tree = UsdTree(stage, model)
        robot_name = "robot"
        for prim in (self.tree.root, stage.default):  # the later takes precedence
            if prim and prim.GetName():
                robot_name = prim.GetName()
        self.builder = ModelBuilder(robot_name, source)
        self.builder.gravity = stage.gravity()

    def read(self) -> tuple[ModelBuilder, bool]:
        """Read the articulation; returns the builder, and True if its root floats."""
        tree_joints, closing_joints, free_root = self.tree.joints()  # the root is None if a joint holds it in the world
        member_paths = {tree_joint.far.path for tree_joint in tree_joints}
        if free_root is not None:
            member_paths.add(free_root.GetPath())
        bodies = [body for body in self.stage.bodies if body.GetPath() in member_paths]
        self.builder.add_link(WORLD)
        for body in bodies:
            has_shape = self.stage.has_shape(body)
            self.builder.add_link(self._name(body), self._inertia(body), where=str(body.GetPath()), shaped=has_shape)
        if free_root is not None:
            self._add_root_joint(free_root)
        else:
            self.builder.mount()
        for tree_joint in tree_joints:
            self._add_tree_joint(tree_joint)
        for joint in closing_joints:
            self._offer_closure(joint)
        separate_bodies = [body for body in self.stage.bodies if body.GetPath() not in member_paths]
        if separate_bodies:
            self.builder.remark(
                f"{who(separate_bodies[0])} and {len(separate_bodies) - 1} other bodies are not joined to the robot, and are "
                "left out"
            )
        unread = Unread("USD")
        joints = [tree_joint.joint for tree_joint in tree_joints]
        prims_by_kind = {"scene": self.stage.scenes[:1], "body": bodies, "joint": joints}
        for kind, prims in prims_by_kind.items():
            for prim in prims:
                _note_unread(unread, kind, prim)
        self.builder.remark(*unread.remarks)
        return self.builder, bool(self.floating_base) and free_root is None

    def _name(self, prim: Any) -> str:
        """Name of a link or joint; the world's name for None."""
        if prim is None:
            return WORLD
        return self.names[str(prim.GetPath())]

    def _add_root_joint(self, body: Any) -> None:
        """Join a root without a joint to the world: fixed if the caller wants it, otherwise floating."""
        where = str(body.GetPath())
        if self.floating_base is False:
            T, _scale = self.stage.pose_and_scale(body)
            self.builder.add_joint(ROOT_JOINT, "fixed", WORLD, self._name(body), placement=T, where=where)
        else:
            self.builder.add_joint(ROOT_JOINT, "floating", WORLD, self._name(body), where=where)

    def _add_tree_joint(self, tree_joint: TreeJoint) -> None:
        """Add a joint of the tree. Its near end is on the parent, its far end on the child."""
        joint = tree_joint.joint
        T_far = tree_joint.far.T
        kind = _KIND_OF_TYPE.get(str(joint.GetTypeName()))
        if kind is None:
            raise RobotFileError(f"{who(joint)} is a {joint.GetTypeName()}, which is not read. {HOW_TO_SPLIT}.")
        name, where = self._name(joint), str(joint.GetPath())
        parent = self._name(tree_joint.near.body)
        child = self._name(tree_joint.far.body)
        placement = tree_joint.near.T @ se3.inverse(T_far)  # of the child in the parent: both ends coincide
        if kind == "ball":
            add_ball(self.builder, name, parent, child, placement, T_far[:3, 3], where)
            return
        axis = T_far[:3, axis_of(joint)]
        if not tree_joint.forward:  # the file's joint leads from the child to the parent
            axis = -axis
        options: dict[str, Any] = {}
        if kind != "fixed":
            options = self._joint_options(joint, kind)
        S = screw_through(kind, axis, T_far[:3, 3])
        self.builder.add_joint(name, kind, parent, child, placement=placement, axis=S, where=where, **options)

    def _joint_options(self, joint: Any, kind: str) -> dict[str, Any]:
        """Limits of a joint with one coordinate and of its drive, and values of PhysX's and Newton's schemas, in SI units."""
        kilogram, metre = self.stage.kilogram, self.stage.metre
        if kind == "revolute":
            drive = "drive:angular"
            position_unit = math.pi / 180.0
            force_unit = kilogram * metre**2
            inertia_unit = kilogram * metre**2
        else:
            drive = "drive:linear"
            position_unit = metre
            force_unit = kilogram * metre
            inertia_unit = kilogram
        armature_name = "newton:armature"
        if number_of(joint, armature_name) == 0:
            armature_name = "physxJoint:armature"
        units_and_names = {
            "lower": (position_unit, "physics:lowerLimit"),
            "upper": (position_unit, "physics:upperLimit"),
            "effort": (force_unit, f"{drive}:physics:maxForce"),
            "velocity": (position_unit, "physxJoint:maxJointVelocity"),
            "armature": (inertia_unit, armature_name),
            "damping": (force_unit / position_unit, "newton:damping"),
            "friction": (force_unit, "newton:friction"),
        }
        options = {}
        for option, (unit, name) in units_and_names.items():
            value = number_of(joint, name, math.inf)  # in units of the stage, as is the bound
            if abs(value) < _MIN_NO_LIMIT:
                options[option] = unit * value
        return options

    def _offer_closure(self, joint: Any) -> None:
        """Offer a joint outside the articulation as a closure of two frames."""
        joint_type = str(joint.GetTypeName())
        name = self._name(joint)
        if joint_type not in _KIND_OF_TYPE:
            self.builder.note(who(joint), f"is a {joint_type} outside the articulation, which is left out")
            return
        axis = "xyz"[axis_of(joint)]
        free_rows: dict[str, tuple[str, ...]] = {
            "ball": TWIST[:3],
            "revolute": (f"w{axis}",),
            "prismatic": (f"v{axis}",),
        }
        own_free_rows = free_rows.get(_KIND_OF_TYPE[joint_type], ())  # no row of a fixed joint is free
        rows = " ".join(row for row in TWIST if row not in own_free_rows)
        a, b = (
            self.builder.add_site(f"{name}:{k}", self._name(end.body), end.T, where=who(joint))
            for k, end in enumerate(self.tree.ends[joint.GetPath()])
        )
        self.builder.add_closure(name, OfferedClosure(a, b, rows))
        self.builder.remark(f"{who(joint)} is left open: robot.close({a!r}, {b!r}, {rows!r}) closes it")

    def _inertia(self, body: Any) -> SpatialInertia:
        """Spatial inertia of a body from its MassAPI; its colliders give what is missing.

        In the format, infinities stand for a missing centre of mass, and zeros for missing moments.
        """
        metre, kilogram = self.stage.metre, self.stage.kilogram
        mass = number_of(body, "physics:mass") * kilogram
        _, scale = self.stage.pose_and_scale(body)
        com = vector_of(body, "physics:centerOfMass", (-math.inf,) * 3) * scale * metre
        moments = vector_of(body, "physics:diagonalInertia", (0.0, 0.0, 0.0))
        R = quaternion.rotation(quaternion_of(body, "physics:principalAxes"))
        I = R @ np.diag(moments * kilogram * metre**2) @ R.T
        has_com = bool(np.isfinite(com).all())
        has_moments = bool(moments.any())
        only_com_is_missing = mass > 0 and has_moments and not has_com
        if only_com_is_missing and not self.stage.colliders(body):
            com = np.zeros(3)  # the origin of the body
            has_com = True
        is_complete = mass > 0 and has_moments and has_com
        if not is_complete:
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
    attributes = {attribute.GetName(): attribute for attribute in prim.GetAuthoredAttributes() if attribute.HasValue()}
    names = [name for name in attributes if ":" in name]  # of a schema; others are the author's own
    for name in names:
        entry = unread.entry(row, name)
        if entry is None:
            unread.note_unknown(kind, name, who(prim))
        elif isinstance(entry, LeftOut) and entry.acts(_values_as_text(attributes[name])):
            name_in_newton = name.replace("mjc:", "newton:").removesuffix("loss")  # mjc:frictionloss, newton:friction
            if name.startswith("mjc:") and name_in_newton in names:
                continue  # converters write both; Newton's is read
            unread.note_left_out(kind, name, entry, f"{name} of {who(prim)}")
    for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():  # also schemas whose plugin is not installed
        schema_name, _, _ = schema.partition(":")  # without the name of an instance
        entry = unread.entry(row, f"<{schema_name}>")
        if isinstance(entry, LeftOut):
            unread.note_left_out(kind, schema, entry, f"{schema} of {who(prim)}")


def _values_as_text(attribute: Any) -> list[str]:
    """Value of an attribute as text; empty for an array, which may have any size."""
    if attribute.GetTypeName().isArray:
        return []
    return [str(attribute.Get())]


def _unique_names(prims: Sequence[Any], *reserved: str) -> dict[str, str]:
    """Name of each prim by path: its name if it is unique and not reserved, otherwise its path."""
    uses = Counter([*reserved, *(prim.GetName() for prim in prims)])
    names = {}
    for prim in prims:
        path, name = str(prim.GetPath()), prim.GetName()
        if uses[name] > 1:
            name = path
        names[path] = name
    return names
