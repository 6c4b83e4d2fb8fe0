"""USD with UsdPhysics: rigid bodies, their mass properties, and the joints of an articulation.

A collider has the mass of its own MassAPI; else its volume times a density: its own, that of the body's MassAPI, that of its
material, else a tonne a cubic metre. A mass that the body has is spread over the colliders so that they have the same shape of
inertia. Meshes and planes are not weighed.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import RobotFileError
from ..lie import quaternion, se3, so3
from ..lie.labelled import TWIST
from ..model.assembly import ROOT_JOINT
from ..model.builder import ModelBuilder
from ..model.model import OfferedClosure
from ..model.notes import ModelNote
from ..typing import Array
from .known_elements import LeftOut, Unread
from .usd_stage import (
    HOW_TO_SPLIT,
    Stage,
    TreeJoint,
    UsdTree,
    axis_of,
    number_of,
    opened,
    quaternion_of,
    vector_of,
    who,
)
from .xml import MOST_BODIES

_WATER = 1000.0
"""kg/m³, the format's density."""
_ADVICE = "Give the body a PhysicsMassAPI with mass, centerOfMass, diagonalInertia and principalAxes"
_TURNS = (
    np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.eye(3),
)
"""Rotations from z, the axis of the solids, to x, y and z."""


def inertia_of_shapes(stage: Stage, body: Any, mass: float) -> SpatialInertia:
    """Inertia of the colliders of a body about its frame's origin, scaled to ``mass`` [kg] if that is above 0.

    Raises :class:`~twistwrench.RobotFileError` with the path of the prim if it has no such volume or no collider.
    """
    total, colliders = SpatialInertia.zero(), _colliders(stage, body)
    if not colliders:
        missing = "physics:diagonalInertia" if mass > 0 else "physics:mass"
        raise RobotFileError(f"{who(body)} has no {missing}, and no collider that could give it. {_ADVICE}.")
    T_sb = stage.placed(body)[0]
    for prim in colliders:
        T_sc, scale = stage.placed(prim)
        total = total + _solid(stage, prim, body, scale).in_frame(se3.inverse(T_sb) @ T_sc)
    return total if mass <= 0 else SpatialInertia.from_parameters(mass / total.mass * total.parameters)


def has_colliders(stage: Stage, body: Any) -> bool:
    """True if a body has colliders."""
    return bool(_colliders(stage, body))


def _colliders(stage: Stage, body: Any) -> list[Any]:
    from pxr import UsdPhysics

    return [prim for prim in stage.parts(body) if prim.HasAPI(UsdPhysics.CollisionAPI)]


def _solid(stage: Stage, prim: Any, body: Any, scale: Array) -> SpatialInertia:
    """Inertia in the frame of the collider."""
    given = _mass_or_density(stage, prim, body)
    kind, metres = str(prim.GetTypeName()), scale * stage.metre
    if kind == "Cube":
        return SpatialInertia.box(number_of(prim, "size", 2.0) * metres, **given)
    if kind == "Sphere":
        return SpatialInertia.ellipsoid(number_of(prim, "radius", 1.0) * metres, **given)
    if kind not in ("Cylinder", "Capsule"):
        raise RobotFileError(f"{who(prim)} is a {kind}, whose mass is not computed. {_ADVICE}.")
    k = axis_of(prim, "axis", default="Z")
    along, across = metres[k], np.delete(metres, k)
    if np.ptp(metres if kind == "Capsule" else across) > 1e-6 * along:
        raise RobotFileError(f"{who(prim)} is a {kind} scaled to another shape, whose mass is not computed. {_ADVICE}.")
    make = SpatialInertia.cylinder if kind == "Cylinder" else SpatialInertia.capsule
    radius = number_of(prim, "radius", 1.0 if kind == "Cylinder" else 0.5)
    height = number_of(prim, "height", 2.0 if kind == "Cylinder" else 1.0)
    return make(float(radius * across[0]), float(height * along), **given).in_frame(se3.pose(_TURNS[k], np.zeros(3)))


def _mass_or_density(stage: Stage, prim: Any, body: Any) -> dict[str, float]:
    mass = number_of(prim, "physics:mass") * stage.kilogram
    if mass > 0:
        return {"mass": mass}
    said = (number_of(one, "physics:density") for one in (prim, body, _material(prim)) if one)
    density = next((x for x in said if x > 0), 0.0)
    return {"density": density * stage.kilogram / stage.metre**3 if density > 0 else _WATER}


def _material(prim: Any) -> Any:
    from pxr import UsdShade

    return UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")[0].GetPrim()


# ── Reader of USD stages

# https://openusd.org/release/api/usd_physics_page_front.html
# The stage is opened by Pixar's own library, ``pxr`` of the package usd-core, which is an extra. Numbers become SI by the
# ``metersPerUnit`` and ``kilogramsPerUnit`` of the stage, angles radians; most are of single precision. Links are the rigid
# bodies, in their own frames without scale. Looks, contacts and gains of drives are passed over.

WORLD = "world"
"""Name of the link of the stage."""

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
    """Builder with the bodies and joints of one articulation, and True if its root link floats besides.

    ``model`` names the articulation's root, by its name or path, where there are several. ``floating_base`` None follows
    the file: a root that no joint holds to the world floats; False fixes it where the stage has it. Layers are read from the
    folder of the file and from ``include_paths`` only.

    Raises :class:`~twistwrench.MissingExtraError`, :class:`~twistwrench.RobotFileError` with the path of the prim, and
    :class:`~twistwrench.UnknownNameError` for an articulation that is not there.
    """
    stage = opened(path, [path.parent, *include_paths])
    return _Reader(Stage(stage, max_bodies), source, floating_base, model).read()


class _Reader:
    """Reader of one articulation."""

    def __init__(self, stage: Stage, source: str, floating_base: bool | None, model: str | None) -> None:
        self.stage, self.floating_base = stage, floating_base
        self.names = _names(stage.bodies, WORLD) | _names(stage.joints)
        self.tree = UsdTree(stage, model)
        name = stage.default.GetName() if stage.default else ""
        self.builder = ModelBuilder(name or (self.tree.root.GetName() if self.tree.root else "robot"), source)
        self.builder.gravity = stage.gravity()

    def read(self) -> tuple[ModelBuilder, bool]:
        """The builder, and True if its root floats."""
        tree, closing, start = self.tree.joints()
        members = {link.far.path for link in tree} | ({start.GetPath()} if start is not None else set())
        self.builder.add_link(WORLD)
        for body in self.stage.bodies:
            if body.GetPath() in members:
                self.builder.add_link(
                    self._name(body), self._inertia(body), where=str(body.GetPath()), shaped=self.stage.shaped(body)
                )
        if start is not None:
            self._hold(start)
        for link in tree:
            self._add(link)
        for joint in closing:
            self._offer(joint)
        left = [body for body in self.stage.bodies if body.GetPath() not in members]
        if left:
            self.builder.remark(
                f"{who(left[0])} and {len(left) - 1} other bodies are not joined to the robot, and are left out"
            )
        unread = Unread("USD")
        for kind, prims in (
            ("scene", self.stage.scenes[:1]),
            ("body", [body for body in self.stage.bodies if body.GetPath() in members]),
            ("joint", [link.joint for link in tree]),
        ):
            for prim in prims:
                _note_unread(unread, kind, prim)
        for text in unread.remarks:
            self.builder.remark(text)
        return self.builder, bool(self.floating_base) and start is None

    def _name(self, prim: Any) -> str:
        return self.names[str(prim.GetPath())]

    def _hold(self, body: Any) -> None:
        where = str(body.GetPath())
        if self.floating_base is False:
            T = self.stage.placed(body)[0]
            self.builder.add_joint(ROOT_JOINT, "fixed", WORLD, self._name(body), placement=T, where=where)
        else:
            self.builder.add_joint(ROOT_JOINT, "floating", WORLD, self._name(body), where=where)

    def _add(self, link: TreeJoint) -> None:
        joint, T_far = link.joint, link.far.T
        kind = _KINDS.get(str(joint.GetTypeName()))
        if kind is None:
            raise RobotFileError(f"{who(joint)} is a {joint.GetTypeName()}, which is not read. {HOW_TO_SPLIT}.")
        name, where = self._name(joint), str(joint.GetPath())
        parent = WORLD if link.near.body is None else self._name(link.near.body)
        child = self._name(link.far.body)
        placement = np.asarray(link.near.T @ se3.inverse(T_far))
        if kind == "ball":
            at, back = (se3.pose(np.eye(3), sign * T_far[:3, 3]) for sign in (1.0, -1.0))
            below = f"{child}:{name}" if T_far[:3, 3].any() else child
            if below != child:
                self.builder.add_link(below, hidden=True)
                self.builder.add_joint(f"{name}.fixed", "fixed", below, child, placement=back, where=where)
            self.builder.add_joint(name, kind, parent, below, placement=placement @ at, where=where)
            return
        axis = T_far[:3, axis_of(joint)] * (1.0 if link.forward else -1.0)
        S = np.r_[np.zeros(3), axis] if kind == "prismatic" else np.r_[axis, so3.cross(T_far[:3, 3], axis) + 0.0]
        options: dict[str, Any] = {} if kind == "fixed" else self._options(joint, kind)
        self.builder.add_joint(name, kind, parent, child, placement=placement, axis=S, where=where, **options)

    def _options(self, joint: Any, kind: str) -> dict[str, Any]:
        """Limits of a joint of one degree, including its drive, and the values of PhysX's and Newton's schemas."""
        turns = kind == "revolute"
        unit = math.pi / 180.0 if turns else self.stage.metre
        force = self.stage.kilogram * self.stage.metre ** (2 if turns else 1)
        drive = "drive:angular" if turns else "drive:linear"
        inertia = self.stage.kilogram * (self.stage.metre**2 if turns else 1.0)
        given = {
            "lower": unit * number_of(joint, "physics:lowerLimit", -math.inf),
            "upper": unit * number_of(joint, "physics:upperLimit", math.inf),
            "effort": force * number_of(joint, f"{drive}:physics:maxForce", math.inf),
            "velocity": unit * number_of(joint, "physxJoint:maxJointVelocity", math.inf),
            "armature": inertia * (number_of(joint, "newton:armature") or number_of(joint, "physxJoint:armature")),
            "damping": force / unit * number_of(joint, "newton:damping"),
            "friction": force * number_of(joint, "newton:friction"),
        }
        return {name: x for name, x in given.items() if math.isfinite(x) and abs(x) < 1e30}

    def _offer(self, joint: Any) -> None:
        """Offer a joint outside the articulation as a closure of two frames."""
        kind, name = str(joint.GetTypeName()), self._name(joint)
        free = {
            "PhysicsFixedJoint": "",
            "PhysicsSphericalJoint": "w",
            "PhysicsRevoluteJoint": "wx",
            "PhysicsPrismaticJoint": "vx",
        }
        if kind not in free:
            self.builder.remark(ModelNote(who(joint), f"is a {kind} outside the articulation, which is left out"))
            return
        letter = "xyz"[axis_of(joint)] if kind in ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint") else ""
        moving = free[kind].replace("x", letter)
        rows = " ".join(row for row in TWIST if not moving or not row.startswith(moving))
        frames = [
            self.builder.add_site(
                f"{name}:{k}", WORLD if end.body is None else self._name(end.body), end.T, where=who(joint)
            )
            for k, end in enumerate(self.tree.ends[joint.GetPath()])
        ]
        self.builder.add_closure(name, OfferedClosure(frames[0], frames[1], rows))
        self.builder.remark(f"{who(joint)} is left open: robot.close({frames[0]!r}, {frames[1]!r}, {rows!r}) closes it")

    def _inertia(self, body: Any) -> SpatialInertia:
        """Inertia of the MassAPI, completed by the colliders."""
        metre, kilogram = self.stage.metre, self.stage.kilogram
        mass = number_of(body, "physics:mass") * kilogram
        com = vector_of(body, "physics:centerOfMass", (-math.inf,) * 3)
        moments = vector_of(body, "physics:diagonalInertia", (0.0, 0.0, 0.0))
        R = quaternion.rotation(quaternion_of(body, "physics:principalAxes"))
        com, I = com * self.stage.placed(body)[1] * metre, R @ np.diag(moments * kilogram * metre**2) @ R.T
        has_com, has_moments = bool(np.isfinite(com).all()), bool(moments.any())
        if mass > 0 and has_moments and not has_com and not has_colliders(self.stage, body):
            com, has_com = np.zeros(3), True
        if not (mass > 0 and has_moments and has_com):
            G = inertia_of_shapes(self.stage, body, mass)
            mass, com, I = G.mass, com if has_com else G.com, I if has_moments else G.moment_about_com
        return SpatialInertia.from_com(mass, com, I)


def _note_unread(unread: Unread, kind: str, prim: Any) -> None:
    """Note attributes and schemas of a prim that are not read."""
    row = unread.row(kind)
    written = {one.GetName(): one for one in prim.GetAuthoredAttributes() if ":" in one.GetName() and one.HasValue()}
    for name, attribute in written.items():
        entry = unread.entry(row, name)
        if entry is None:
            unread.unknown(kind, name, who(prim))
        elif isinstance(entry, LeftOut) and entry.acts([str(attribute.Get())]):
            if name.replace("mjc:", "newton:").removesuffix("loss") in written and name.startswith("mjc:"):
                continue  # converters write both, and Newton's is read
            unread.left_out(kind, name, entry, f"{name} of {who(prim)}")
    for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():  # those that no plugin defines too
        entry = unread.entry(row, f"<{schema.partition(':')[0]}>")
        if isinstance(entry, LeftOut):
            unread.left_out(kind, schema, entry, f"{schema} of {who(prim)}")


def _names(prims: Sequence[Any], *taken: str) -> dict[str, str]:
    """Name of each prim by path: its own name if it is unique, else its path."""
    count = Counter([*taken, *(prim.GetName() for prim in prims)])
    return {
        str(prim.GetPath()): prim.GetName() if count[prim.GetName()] == 1 else str(prim.GetPath()) for prim in prims
    }
