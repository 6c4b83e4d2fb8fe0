"""Reader of one articulation of a USD file, after a rehearsal in a child process."""

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
"""Link name of the stage."""

_KINDS = {
    "PhysicsRevoluteJoint": "revolute", "PhysicsPrismaticJoint": "prismatic", "PhysicsSphericalJoint": "ball",
    "PhysicsFixedJoint": "fixed",
}  # fmt: skip


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

    ``model`` selects the articulation by the name or path of its root. ``floating_base`` None follows the file: a root
    without a joint to the world floats; False fixes it at its pose on the stage. Layers are read only from the folder
    of the file and from ``include_paths``. Unless TWISTWRENCH_SANDBOX is 0, the stage is read in a child process first.

    Raises :class:`~twistwrench.MissingExtraError`, :class:`~twistwrench.RobotFileError` with the path of the prim, and
    :class:`~twistwrench.UnknownNameError` for a missing articulation.
    """
    request = path, source, include_paths, floating_base, model, max_bodies
    if sandboxed():
        run_in_child(
            "twistwrench.formats.usd.reader:rehearse", *request, limits=ChildLimits(_SECONDS, _MEMORY),
            error_of=lambda reason: RobotFileError(f"it cannot be read as USD: {reason}."),
        )  # fmt: skip
    return _read(*request)


_SECONDS, _MEMORY = 30.0, 1 << 30
"""Largest processor time [s] and memory [bytes] of reading a stage in a child process."""


def rehearse(*request: Any) -> None:
    """Read a stage in a child process, which ends at damage that crashes the library or takes all memory."""
    _read(*request)


def _read(
    path: Path,
    source: str,
    include_paths: Sequence[Path],
    floating_base: bool | None,
    model: str | None,
    max_bodies: int,
) -> tuple[ModelBuilder, bool]:
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
        self.names = _names(stage.bodies, WORLD) | _names(stage.joints)
        self.tree = UsdTree(stage, model)
        names = [prim.GetName() for prim in (stage.default, self.tree.root) if prim]
        self.builder = ModelBuilder(next(filter(None, names), "robot"), source)
        self.builder.gravity = stage.gravity()

    def read(self) -> tuple[ModelBuilder, bool]:
        """Read the articulation; returns the builder, and True if its root floats."""
        tree, closing, start = self.tree.joints()
        members = {link.far.path for link in tree}
        if start is not None:
            members.add(start.GetPath())
        bodies = [body for body in self.stage.bodies if body.GetPath() in members]
        self.builder.add_link(WORLD)
        for body in bodies:
            self.builder.add_link(
                self._name(body), self._inertia(body), where=str(body.GetPath()), shaped=self.stage.has_shape(body)
            )
        if start is not None:
            self._hold(start)
        else:
            self.builder.mount()
        for link in tree:
            self._add(link)
        for joint in closing:
            self._offer(joint)
        separate = [body for body in self.stage.bodies if body.GetPath() not in members]
        if separate:
            self.builder.remark(
                f"{who(separate[0])} and {len(separate) - 1} other bodies are not joined to the robot, and are left out"
            )
        unread = Unread("USD")
        prims_by_kind = {"scene": self.stage.scenes[:1], "body": bodies, "joint": [link.joint for link in tree]}
        for kind, prims in prims_by_kind.items():
            for prim in prims:
                _note_unread(unread, kind, prim)
        self.builder.remark(*unread.remarks)
        return self.builder, bool(self.floating_base) and start is None

    def _name(self, prim: Any) -> str:
        """Name of a link or joint; the world's name for None."""
        if prim is None:
            return WORLD
        return self.names[str(prim.GetPath())]

    def _hold(self, body: Any) -> None:
        where = str(body.GetPath())
        if self.floating_base is False:
            T = self.stage.pose_and_scale(body)[0]
            self.builder.add_joint(ROOT_JOINT, "fixed", WORLD, self._name(body), placement=T, where=where)
        else:
            self.builder.add_joint(ROOT_JOINT, "floating", WORLD, self._name(body), where=where)

    def _add(self, link: TreeJoint) -> None:
        joint, T_far = link.joint, link.far.T
        kind = _KINDS.get(str(joint.GetTypeName()))
        if kind is None:
            raise RobotFileError(f"{who(joint)} is a {joint.GetTypeName()}, which is not read. {HOW_TO_SPLIT}.")
        name, where = self._name(joint), str(joint.GetPath())
        parent, child = self._name(link.near.body), self._name(link.far.body)
        placement = link.near.T @ se3.inverse(T_far)
        if kind == "ball":
            add_ball(self.builder, name, parent, child, placement, T_far[:3, 3], where)
            return
        axis, options = T_far[:3, axis_of(joint)], dict[str, Any]()
        if not link.forward:
            axis = -axis
        if kind != "fixed":
            options = self._options(joint, kind)
        S = screw_through(kind, axis, T_far[:3, 3])
        self.builder.add_joint(name, kind, parent, child, placement=placement, axis=S, where=where, **options)

    def _options(self, joint: Any, kind: str) -> dict[str, Any]:
        """Limits of a one-degree joint, including its drive, and the values of PhysX's and Newton's schemas."""
        kilogram, metre = self.stage.kilogram, self.stage.metre
        if kind == "revolute":
            drive, unit, force, inertia = "drive:angular", math.pi / 180.0, kilogram * metre**2, kilogram * metre**2
        else:
            drive, unit, force, inertia = "drive:linear", metre, kilogram * metre, kilogram
        values = {
            "lower": unit * number_of(joint, "physics:lowerLimit", -math.inf),
            "upper": unit * number_of(joint, "physics:upperLimit", math.inf),
            "effort": force * number_of(joint, f"{drive}:physics:maxForce", math.inf),
            "velocity": unit * number_of(joint, "physxJoint:maxJointVelocity", math.inf),
            "armature": inertia * (number_of(joint, "newton:armature") or number_of(joint, "physxJoint:armature")),
            "damping": force / unit * number_of(joint, "newton:damping"),
            "friction": force * number_of(joint, "newton:friction"),
        }
        return {name: x for name, x in values.items() if math.isfinite(x) and abs(x) < 1e30}

    def _offer(self, joint: Any) -> None:
        """Register a joint outside the articulation as a closure of two frames."""
        kind, name = str(joint.GetTypeName()), self._name(joint)
        if kind not in _KINDS:
            self.builder.note(who(joint), f"is a {kind} outside the articulation, which is left out")
            return
        axis = "xyz"[axis_of(joint)]
        free = {"ball": TWIST[:3], "revolute": (f"w{axis}",), "prismatic": (f"v{axis}",)}.get(_KINDS[kind], ())
        rows = " ".join(row for row in TWIST if row not in free)
        frames = []
        for k, end in enumerate(self.tree.ends[joint.GetPath()]):
            frames.append(self.builder.add_site(f"{name}:{k}", self._name(end.body), end.T, where=who(joint)))
        self.builder.add_closure(name, OfferedClosure(frames[0], frames[1], rows))
        self.builder.remark(f"{who(joint)} is left open: robot.close({frames[0]!r}, {frames[1]!r}, {rows!r}) closes it")

    def _inertia(self, body: Any) -> SpatialInertia:
        """Inertia from the MassAPI, completed by the colliders."""
        metre, kilogram = self.stage.metre, self.stage.kilogram
        mass = number_of(body, "physics:mass") * kilogram
        com = vector_of(body, "physics:centerOfMass", (-math.inf,) * 3)
        moments = vector_of(body, "physics:diagonalInertia", (0.0, 0.0, 0.0))
        R = quaternion.rotation(quaternion_of(body, "physics:principalAxes"))
        com, I = com * self.stage.pose_and_scale(body)[1] * metre, R @ np.diag(moments * kilogram * metre**2) @ R.T
        has_com, has_moments = bool(np.isfinite(com).all()), bool(moments.any())
        if mass > 0 and has_moments and not has_com and not self.stage.colliders(body):
            com, has_com = np.zeros(3), True
        if not (mass > 0 and has_moments and has_com):
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
    authored = {attribute.GetName(): attribute for attribute in prim.GetAuthoredAttributes() if attribute.HasValue()}
    names = [name for name in authored if ":" in name]
    for name in names:
        entry = unread.entry(row, name)
        if entry is None:
            unread.note_unknown(kind, name, who(prim))
        elif isinstance(entry, LeftOut) and entry.acts(_values_as_text(authored[name])):
            in_newton = name.replace("mjc:", "newton:").removesuffix("loss")
            if name.startswith("mjc:") and in_newton in names:
                continue  # converters write both; Newton's is read
            unread.note_left_out(kind, name, entry, f"{name} of {who(prim)}")
    for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():  # including those without a plugin
        entry = unread.entry(row, f"<{schema.partition(':')[0]}>")
        if isinstance(entry, LeftOut):
            unread.note_left_out(kind, schema, entry, f"{schema} of {who(prim)}")


def _values_as_text(attribute: Any) -> list[str]:
    """Value of an attribute as text; empty for an array, which may have any size."""
    if attribute.GetTypeName().isArray:
        return []
    return [str(attribute.Get())]


def _names(prims: Sequence[Any], *reserved: str) -> dict[str, str]:
    """Name of each prim by path: its name if unique, otherwise its path."""
    count = Counter([*reserved, *(prim.GetName() for prim in prims)])
    names = {}
    for prim in prims:
        path, name = str(prim.GetPath()), prim.GetName()
        if count[name] > 1:
            name = path
        names[path] = name
    return names
