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

    def of_joint(self, name: str, text: str) -> None:
        """Note the loss of a joint."""
        self.note("joint", name, text)

    def note_limits(self, joint: str, limits: Limits, *kinds: str) -> None:
        """Note the loss of limits of a joint that are given."""
        if given := [kind for kind in kinds if np.isfinite(getattr(limits, kind)[0])]:
            self.of_joint(joint, f"has a limit of {listed(given)}, which the format cannot represent")

    def say(self, text: str) -> None:
        """Note the loss of the robot."""
        self.found.append(text)

    def note_mass_of_world(self, found: ModelParts) -> None:
        """Note the mass of a root link that is the world itself."""
        if found.links[found.root].inertia.mass:
            self.say("the mass of what stands still is left out, where the base is the world itself")

    def note_couplings(self, found: ModelParts) -> None:
        """Note coupled drives, which the formats do not have, and take them out of the parts."""
        coupled = {joint: c for c in found.couplings for joint in c.joints}
        for name, c in coupled.items():
            self.of_joint(
                name, f"is moved by coupled motors {listed(c.motors)}; their inertia, friction and efforts are left out"
            )
            found.friction[name], found.armature[name] = Friction.plain(np.zeros(1), np.zeros(1)), np.zeros(1)
        found.joints = [
            replace(j, limits=replace(j.limits, effort=np.full(1, np.inf))) if j.name in coupled else j
            for j in found.joints
        ]
        found.actuators = [a for a in found.actuators if not any(a.joint in c.motors for c in found.couplings)]

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


def moved(point: Array) -> Array:
    """The pose (4, 4) of a frame at a point."""
    return se3.pose(np.eye(3), point)


class AlongJoint(NamedTuple):
    """Damping, friction and armature of a joint, one number each."""

    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0


def drive_of(found: ModelParts, joint: str, losses: Losses) -> AlongJoint:
    """Damping, Coulomb friction and armature of a joint; losses are noted."""
    law = found.friction.get(joint)
    if law is None:  # the drive of a mimic joint is written with its leader
        return AlongJoint()
    laws = [law, *(found.friction[motor] for motor in (f"{joint}.motor",) if motor in found.friction)]
    for one in laws:
        if (one.static > one.coulomb).any():
            losses.of_joint(joint, "has static and Stribeck friction, of which the Coulomb friction alone is written")
        if one.load.any():
            losses.of_joint(joint, "has friction that grows with the load, which is left out")
    armature = found.armature[joint].copy()
    for actuator in found.actuators:
        if actuator.joint == joint and actuator.rotor is not None:
            armature += actuator.ratio**2 * actuator.rotor.inertia
            losses.of_joint(joint, "has a rotor, which is written as armature: what it does to other joints is lost")
            if np.isfinite(actuator.stiffness):
                losses.of_joint(joint, "has an elastic gear, which is written as a rigid one")
    viscous, coulomb = (np.sum([getattr(one, name) for one in laws], axis=0) for name in ("viscous", "coulomb"))
    along = {"damping": viscous, "friction": coulomb, "armature": armature}
    for what, values in along.items():
        if np.ptp(values) > 0:
            losses.of_joint(joint, f"has another {what} in each direction, of which the mean is written")
    return AlongJoint(**{what: float(np.mean(values)) for what, values in along.items()})


def configurations_of(found: ModelParts) -> dict[str, dict[str, Array]]:
    """Named configurations by joint, without a neutral ``qpos0``."""
    neutral = {joint.name: joint.joint.neutral for joint in found.joints} | {ROOT_JOINT: np.r_[1.0, np.zeros(6)]}
    given = {
        name: {joint: np.asarray(q, float) for joint, q in positions.items()}
        for name, positions in found.additions.configurations.items()
    }
    return {
        name: positions
        for name, positions in given.items()
        if name != REFERENCE or any(not np.array_equal(q, neutral[joint]) for joint, q in positions.items())
    }
