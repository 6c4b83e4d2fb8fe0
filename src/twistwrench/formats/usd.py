"""USD with UsdPhysics, as simulators write robots: rigid bodies, their mass properties, and the joints of an articulation.

https://openusd.org/release/api/usd_physics_page_front.html
The stage is opened by Pixar's own library, ``pxr`` of the package usd-core, which is an extra. Numbers become SI by the
``metersPerUnit`` and ``kilogramsPerUnit`` of the stage, angles radians; most are of single precision. Links are the rigid
bodies, in their own frames without scale. Looks, contacts and gains of drives are passed over.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import RobotFileError, UnknownNameError
from ..lie import quaternion, se3, so3
from ..model.assembly import ROOT_JOINT
from ..model.builder import ModelBuilder
from ..model.closure import OfferedClosure
from ..model.remark import Remark
from .element import MOST_BODIES
from .usd_shapes import has_colliders, inertia_of_shapes
from .usd_stage import End, Stage, axis_of, number_of, opened, quaternion_of, value_of, vector_of, who

WORLD = "world"
"""The link that stands for the stage."""

_KINDS = {
    "PhysicsRevoluteJoint": "revolute", "PhysicsPrismaticJoint": "prismatic", "PhysicsSphericalJoint": "ball",
    "PhysicsFixedJoint": "fixed",
}  # fmt: skip
_SPLIT = (
    "Write it as revolute, prismatic, spherical and fixed joints with bodies between, or load the URDF or MJCF file that the "
    "stage was made of"
)


def read_usd(
    path: Path,
    source: str = "",
    *,
    include_paths: Sequence[Path] = (),
    floating_base: bool | None = None,
    model: str | None = None,
    max_bodies: int = MOST_BODIES,
) -> tuple[ModelBuilder, bool]:
    """A builder filled with the bodies and joints of one articulation, and whether its root link is to float besides.

    ``model`` names the articulation's root, by its name or path, where there are several. ``floating_base`` None means as the
    file says: what no joint holds to the world floats; False fixes it where the stage has it. Layers are read from the folder
    of the file and from ``include_paths`` only.

    Raises :class:`~twistwrench.MissingExtraError`, :class:`~twistwrench.RobotFileError` with the path of the prim, and
    :class:`~twistwrench.UnknownNameError` for an articulation that is not there.
    """
    stage = opened(path, [path.parent, *include_paths])
    return _Reader(Stage(stage, max_bodies), source, floating_base, model).read()


@dataclass(frozen=True, eq=False)
class _Link:
    """A joint from a link that is placed already to the next one."""

    joint: Any
    near: End
    far: End
    forward: bool
    """Whether the next one is the joint's body1."""


class _Reader:
    """One articulation on its way into a builder."""

    def __init__(self, stage: Stage, source: str, floating_base: bool | None, model: str | None) -> None:
        self.stage, self.floating_base = stage, floating_base
        self.ends = {joint.GetPath(): (stage.end(joint, 0), stage.end(joint, 1)) for joint in stage.joints}
        self.names = _names(stage.bodies, WORLD) | _names(stage.joints)
        self.root = self._root(model)
        name = stage.default.GetName() if stage.default else ""
        self.builder = ModelBuilder(name or (self.root.GetName() if self.root else "robot"), source)
        self.builder.gravity = stage.gravity()

    def read(self) -> tuple[ModelBuilder, bool]:
        """The builder, and whether its root is to float."""
        tree, closing, start = self._tree()
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
        return self.builder, bool(self.floating_base) and start is None

    def _name(self, prim: Any) -> str:
        return self.names[str(prim.GetPath())]

    def _root(self, model: str | None) -> Any:
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

    def _tree(self) -> tuple[list[_Link], list[Any], Any]:
        """The joints outward from the base, those that close loops, and the body that no joint holds, if there is one."""
        inside = [joint for joint in self.stage.joints if not _excluded(joint)]
        tied: dict[Any, list[Any]] = {None: []}  # the joints of each body, and of the world
        for joint in inside:
            paths = {end.path for end in self._ends(joint)}
            if len(paths) == 1:
                raise RobotFileError(f"{who(joint)} has one body at both ends. Name another one.")
            for path in paths:
                tied.setdefault(path, []).append(joint)
        within = self._within(tied)
        tied[None] = [joint for joint in tied[None] if within & {end.path for end in self._ends(joint)}]
        start = None if tied[None] else self._first(within)
        found: dict[Any, _Link] = {}  # by the path of the joint
        waiting = [None if start is None else start.GetPath()]
        met = set(waiting)
        for at in waiting:  # which grows on the way
            for joint in tied.get(at, []):
                if joint.GetPath() in found:
                    continue
                first, second = self._ends(joint)
                near, far = (first, second) if first.path == at else (second, first)
                if far.path in met:
                    raise RobotFileError(_too_many(joint, near, far, found.values()))
                met.add(far.path)
                waiting.append(far.path)
                found[joint.GetPath()] = _Link(joint, near, far, forward=near is first)
        ordered = [found[joint.GetPath()] for joint in inside if joint.GetPath() in found]
        outside = (joint for joint in self.stage.joints if _excluded(joint))
        return ordered, [joint for joint in outside if {end.path for end in self._ends(joint)} <= met | {None}], start

    def _ends(self, joint: Any) -> tuple[End, End]:
        return self.ends[joint.GetPath()]

    def _within(self, tied: dict[Any, list[Any]]) -> set[Any]:
        """The bodies of the articulation: all that hang together with one below its root, or with its joint."""
        paths = [body.GetPath() for body in self.stage.bodies]
        if not paths:
            raise RobotFileError("it has no rigid body (PhysicsRigidBodyAPI). Is it a stage of looks only?")
        if self.root:
            root = self.root.GetPath()
            joints = [joint for joint in self.stage.joints if joint.GetPath().HasPrefix(root)]
            found = {path for path in paths if path.HasPrefix(root)}
            found |= {end.path for joint in joints for end in self._ends(joint)} - {None}
        else:
            found = {next((path for path in paths if path in tied), paths[0])}
        if not found:
            raise RobotFileError(f"{who(self.root)} is the root of an articulation without a body.")
        waiting = list(found)
        for path in waiting:
            new = {end.path for joint in tied.get(path, []) for end in self._ends(joint)} - found - {None}
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

    def _hold(self, body: Any) -> None:
        where = str(body.GetPath())
        if self.floating_base is False:
            T = self.stage.placed(body)[0]
            self.builder.add_joint(ROOT_JOINT, "fixed", WORLD, self._name(body), placement=T, where=where)
        else:
            self.builder.add_joint(ROOT_JOINT, "floating", WORLD, self._name(body), where=where)

    def _add(self, link: _Link) -> None:
        joint, T_far = link.joint, link.far.T
        kind = _KINDS.get(str(joint.GetTypeName()))
        if kind is None:
            raise RobotFileError(f"{who(joint)} is a {joint.GetTypeName()}, which is not read. {_SPLIT}.")
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
            if any(number_of(joint, f"physics:coneAngle{k}Limit", -1.0) >= 0 for k in "01"):
                self.builder.remark(Remark(who(joint), "has a limit of its cone, which is not kept"))
            return
        axis = T_far[:3, axis_of(joint)] * (1.0 if link.forward else -1.0)
        S = np.r_[np.zeros(3), axis] if kind == "prismatic" else np.r_[axis, so3.cross(T_far[:3, 3], axis) + 0.0]
        options: dict[str, Any] = {} if kind == "fixed" else self._options(joint, kind)
        self.builder.add_joint(name, kind, parent, child, placement=placement, axis=S, where=where, **options)

    def _options(self, joint: Any, kind: str) -> dict[str, Any]:
        """Limits of a joint of one degree, by the drive too; and what the schemas of PhysX and Newton say besides."""
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
        """The two frames of a joint that the articulation leaves out, and what it holds."""
        kind, name = str(joint.GetTypeName()), self._name(joint)
        free = {
            "PhysicsFixedJoint": "",
            "PhysicsSphericalJoint": "w",
            "PhysicsRevoluteJoint": "wx",
            "PhysicsPrismaticJoint": "vx",
        }
        if kind not in free:
            self.builder.remark(Remark(who(joint), f"is a {kind} outside the articulation, which is left out"))
            return
        letter = "xyz"[axis_of(joint)] if kind in ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint") else ""
        moving = free[kind].replace("x", letter)
        rows = " ".join(row for row in ("wx", "wy", "wz", "vx", "vy", "vz") if not moving or not row.startswith(moving))
        frames = [
            self.builder.add_site(
                f"{name}:{k}", WORLD if end.body is None else self._name(end.body), end.T, where=who(joint)
            )
            for k, end in enumerate(self._ends(joint))
        ]
        self.builder.add_closure(name, OfferedClosure(frames[0], frames[1], rows))
        self.builder.remark(f"{who(joint)} is left open: robot.close({frames[0]!r}, {frames[1]!r}, {rows!r}) closes it")

    def _inertia(self, body: Any) -> SpatialInertia:
        """As the MassAPI says; what it leaves out comes from the colliders."""
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


def _excluded(joint: Any) -> bool:
    return bool(value_of(joint, "physics:excludeFromArticulation", default=False))


def _too_many(joint: Any, near: End, far: End, found: Iterable[_Link]) -> str:
    """What to say of a joint between two links that are joined already."""
    twin = next((one.joint for one in found if {one.near.path, one.far.path} == {near.path, far.path}), None)
    if twin is not None:
        return f"{who(joint)} and {who(twin)} join the same two bodies. {_SPLIT}."
    return f"{who(joint)} closes a loop. Cut it open there with excludeFromArticulation; robot.close closes it."


def _names(prims: Sequence[Any], *taken: str) -> dict[str, str]:
    """What each prim is called, by path: its name where that is one's only, else its path."""
    count = Counter([*taken, *(prim.GetName() for prim in prims)])
    return {
        str(prim.GetPath()): prim.GetName() if count[prim.GetName()] == 1 else str(prim.GetPath()) for prim in prims
    }
