"""Shared parts of all writers: model parts that a file can represent, and the record of losses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ...core.errors import ModelError
from ...core.numbers import printed
from ...core.text import listed
from ...core.typing import Array
from ...mechanics.lie import se3, so3
from ...mechanics.model.assembly import ROOT_JOINT
from ...mechanics.model.description import JointEntry, ModelNote
from ...mechanics.model.limits import Friction, Limits
from ...mechanics.model.parts import ModelParts
from ..mjcf.reader import REFERENCE


@dataclass(frozen=True)
class RobotDocument:
    """Text of a robot file, and the properties that are lost in it."""

    text: str
    lost: tuple[str, ...]
    """A sentence each; empty where reading the file gives the same robot."""


@dataclass
class Losses:
    """Properties of one model that a format cannot represent, collected while it is written."""

    found: list[str] = field(default_factory=list)

    def note(self, kind: str, name: str, text: str) -> None:
        """Note the loss of a link, joint or other named part."""
        self.found.append(ModelNote(f"{kind} {name!r}", text))

    def note_joint(self, name: str, text: str) -> None:
        """Note the loss of a joint."""
        self.note("joint", name, text)

    def note_limits(self, joint: str, limits: Limits, *kinds: str) -> None:
        """Note the loss of limits of a joint that are given."""
        finite = [kind for kind in kinds if np.isfinite(getattr(limits, kind)[0])]
        if finite:
            self.note_joint(joint, f"has a limit of {listed(finite)}, which the format cannot represent")

    def say(self, text: str) -> None:
        """Note the loss of the robot."""
        self.found.append(text)

    def note_mass_of_world(self, found: ModelParts) -> None:
        """Note the mass of a root link that is the world itself."""
        if found.links[found.root].inertia.mass:
            self.say("the mass of what stands still is left out, where the base is the world itself")

    def note_couplings(self, parts: ModelParts) -> None:
        """Note coupled drives, which the formats do not have, and take them out of the parts."""
        coupled_joints = {joint: coupling for coupling in parts.couplings for joint in coupling.joints}
        motors = {motor for coupling in parts.couplings for motor in coupling.motors}
        for name, coupling in coupled_joints.items():
            names = listed(coupling.motors)
            self.note_joint(
                name, f"is moved by coupled motors {names}; their inertia, friction and efforts are left out"
            )
            parts.friction[name], parts.armature[name] = Friction.plain(np.zeros(1), np.zeros(1)), np.zeros(1)
        for k, joint in enumerate(parts.joints):
            if joint.name in coupled_joints:
                parts.joints[k] = replace(joint, limits=replace(joint.limits, effort=np.full(1, np.inf)))
        parts.actuators = [actuator for actuator in parts.actuators if actuator.joint not in motors]

    def note_unwritten(self, found: ModelParts) -> None:
        """Note what formats other than MJCF do not have: named configurations and closures."""
        for kind, names in (("configuration", configurations_of(found)), ("closure", found.additions.closures)):
            for name in names:
                self.note(kind, name, "is left out: the format has none")


@dataclass(frozen=True)
class Screw:
    """Screw axis by a direction, a point on it, and a pitch."""

    direction: Array
    point: Array
    """(3,) in the child's frame, the nearest to its origin; zero of sliding joints."""
    pitch: float
    """m/rad."""
    turns: bool


def screw_of(joint: JointEntry) -> Screw:
    """The axis of a joint of one degree in its child's frame.

    Raises :class:`~twistwrench.ModelError` for one that is not of unit length, which no format can represent.
    """
    w, v = joint.joint.axes[0, :3], joint.joint.axes[0, 3:]
    turns = bool(w.any())
    length = float(np.linalg.norm(w if turns else v))
    if abs(length - 1.0) > 1e-12:
        raise ModelError(
            f"joint {joint.name!r} has a screw axis of length {printed(length)}, so that its coordinate is neither an angle "
            "nor a distance. Robot files have axes of unit length."
        )
    if not turns:
        return Screw(v, np.zeros(3), 0.0, False)
    point = so3.cross(w, v)
    point = np.where(np.abs(point) > 1e-15 * max(1.0, float(np.abs(v).max())), point, 0.0)
    pitch = float(w @ v)
    return Screw(w, point, pitch if abs(pitch) > 1e-15 else 0.0, True)


def translation(point: Array) -> Array:
    """The pose (4, 4) of a frame at a point."""
    return se3.pose(np.eye(3), point)


class AlongJoint(NamedTuple):
    """Damping, friction and armature of a joint, one number each."""

    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0


def drive_of(parts: ModelParts, joint: str, losses: Losses) -> AlongJoint:
    """Damping, Coulomb friction and armature of a joint; losses are noted."""
    friction = parts.friction.get(joint)
    if friction is None:  # the drive of a mimic joint is written with its leader
        return AlongJoint()
    laws = [friction]
    if f"{joint}.motor" in parts.friction:
        laws.append(parts.friction[f"{joint}.motor"])
    for law in laws:
        if (law.static > law.coulomb).any():
            losses.note_joint(joint, "has static and Stribeck friction, of which the Coulomb friction alone is written")
        if law.load.any():
            losses.note_joint(joint, "has friction that grows with the load, which is left out")
    armature = parts.armature[joint].copy()
    for actuator in parts.actuators:
        if actuator.joint == joint and actuator.rotor is not None:
            armature += actuator.ratio**2 * actuator.rotor.inertia
            losses.note_joint(joint, "has a rotor, which is written as armature: what it does to other joints is lost")
            if np.isfinite(actuator.stiffness):
                losses.note_joint(joint, "has an elastic gear, which is written as a rigid one")
    viscous = np.sum([law.viscous for law in laws], axis=0)
    coulomb = np.sum([law.coulomb for law in laws], axis=0)
    along = {"damping": viscous, "friction": coulomb, "armature": armature}
    for quantity, values in along.items():
        if np.ptp(values) > 0:
            losses.note_joint(joint, f"has another {quantity} in each direction, of which the mean is written")
    return AlongJoint(**{quantity: float(np.mean(values)) for quantity, values in along.items()})


def configurations_of(parts: ModelParts) -> dict[str, dict[str, Array]]:
    """Named configurations by joint, without a neutral ``qpos0``."""
    neutral = {joint.name: joint.joint.neutral for joint in parts.joints} | {ROOT_JOINT: np.r_[1.0, np.zeros(6)]}
    configurations = {}
    for name, positions in parts.additions.configurations.items():
        arrays = {joint: np.asarray(q, float) for joint, q in positions.items()}
        if name == REFERENCE and all(np.array_equal(q, neutral[joint]) for joint, q in arrays.items()):
            continue
        configurations[name] = arrays
    return configurations
