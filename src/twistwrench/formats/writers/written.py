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
    """One sentence per loss; empty if reading the file gives the same robot."""


@dataclass
class Losses:
    """Properties of one model that a format cannot represent, collected while it is written."""

    found: list[str] = field(default_factory=list)
    """Sentences, in the order of writing."""

    def note(self, kind: str, name: str, text: str) -> None:
        """Note the loss of a link, joint or other named part; ``text`` is the rest of the sentence that it begins."""
        self.found.append(ModelNote(f"{kind} {name!r}", text))

    def note_joint(self, name: str, text: str) -> None:
        """Note a loss of a joint; ``text`` is the rest of the sentence that begins with the joint."""
        self.note("joint", name, text)

    def note_limits(self, joint: str, limits: Limits, *kinds: str) -> None:
        """Note the loss of those limits of a joint that are finite, among ``kinds`` (``"effort"`` and others)."""
        lost_kinds = []
        for kind in kinds:
            limit = getattr(limits, kind)[0]
            if np.isfinite(limit):
                lost_kinds.append(kind)
        if lost_kinds:
            self.note_joint(joint, f"has a limit of {listed(lost_kinds)}, which the format cannot represent")

    def say(self, text: str) -> None:
        """Note a loss that belongs to the whole robot; ``text`` is a whole sentence."""
        self.found.append(text)

    def note_mass_of_world(self, parts: ModelParts) -> None:
        """Note the loss of the mass of the root link, which is the world."""
        if parts.links[parts.root].inertia.mass:
            self.say("the mass of what stands still is left out, where the base is the world itself")

    def note_couplings(self, parts: ModelParts) -> None:
        """Note the loss of coupled drives, which no format has, and remove them from ``parts``."""
        coupling_by_joint = {joint: coupling for coupling in parts.couplings for joint in coupling.joints}
        coupled_motors = {motor for coupling in parts.couplings for motor in coupling.motors}
        for name, coupling in coupling_by_joint.items():
            motors = listed(coupling.motors)
            self.note_joint(
                name, f"is moved by coupled motors {motors}; their inertia, friction and efforts are left out"
            )
            parts.friction[name] = Friction.plain(np.zeros(1), np.zeros(1))
            parts.armature[name] = np.zeros(1)
        for k, joint in enumerate(parts.joints):
            if joint.name in coupling_by_joint:
                limits_without_effort = replace(joint.limits, effort=np.full(1, np.inf))
                parts.joints[k] = replace(joint, limits=limits_without_effort)
        parts.actuators = [actuator for actuator in parts.actuators if actuator.joint not in coupled_motors]

    def note_unwritten(self, parts: ModelParts) -> None:
        """Note the loss of named configurations and closures, which only MJCF can represent."""
        for name in configurations_of(parts):
            self.note("configuration", name, "is left out: the format has none")
        for name in parts.additions.closures:
            self.note("closure", name, "is left out: the format has none")


@dataclass(frozen=True)
class Screw:
    """Screw axis by a direction, a point on it, and a pitch."""

    direction: Array
    """Unit vector (3,) in the child's frame."""
    point: Array
    """Point (3,) of the axis nearest to the origin of the child's frame [m]; zeros for a sliding joint."""
    pitch: float
    """Pitch [m/rad]; 0 for a sliding joint."""
    turns: bool
    """False for a sliding joint."""


_MAX_LENGTH_ERROR = 1e-12
"""Difference from 1 above which the length of an axis is not a rounding error."""
_ROUND_OFF = 1e-15
"""Size up to which a pitch or the coordinate of a point is a rounding error [m/rad or m]."""


def screw_of(joint: JointEntry) -> Screw:
    """Screw axis, in the child's frame, of a joint with one degree of freedom.

    Raises :class:`~twistwrench.ModelError` for an axis that is not of unit length, as no format can represent it.
    """
    axis = joint.joint.axes[0]
    w, v = axis[:3], axis[3:]
    turns = bool(w.any())
    length = float(np.linalg.norm(w if turns else v))
    if abs(length - 1.0) > _MAX_LENGTH_ERROR:
        raise ModelError(
            f"joint {joint.name!r} has a screw axis of length {printed(length, 13)}, so that its coordinate is neither an "
            "angle nor a distance. Robot files have axes of unit length."
        )
    if not turns:
        return Screw(v, np.zeros(3), 0.0, False)
    point = so3.cross(w, v)  # v = -w x point + pitch w, and w is of length 1
    point_round_off = _ROUND_OFF * max(1.0, float(np.abs(v).max()))
    point = np.where(np.abs(point) > point_round_off, point, 0.0)
    pitch = float(w @ v)
    if abs(pitch) <= _ROUND_OFF:
        pitch = 0.0
    return Screw(w, point, pitch, True)


def translation(point: Array) -> Array:
    """Pose (4, 4) of a frame at a point, without rotation."""
    return se3.pose(np.eye(3), point)


class JointDrive(NamedTuple):
    """Damping, friction and armature of a joint, one number each."""

    damping: float = 0.0
    """Torque per velocity [N m s/rad or N s/m]."""
    friction: float = 0.0
    """Coulomb friction [N m or N]."""
    armature: float = 0.0
    """Inertia [kg m² or kg]."""


def drive_of(parts: ModelParts, joint: str, losses: Losses) -> JointDrive:
    """Damping, Coulomb friction and armature of a joint. Other properties of its drive are noted as losses."""
    joint_friction = parts.friction.get(joint)
    if joint_friction is None:  # the drive of a mimic joint is written with its leader
        return JointDrive()
    frictions = [joint_friction]
    motor = f"{joint}.motor"  # joint of the motor behind an elastic gear
    if motor in parts.friction:
        frictions.append(parts.friction[motor])
    for friction in frictions:
        if (friction.static > friction.coulomb).any():
            losses.note_joint(joint, "has static and Stribeck friction, of which the Coulomb friction alone is written")
        if friction.load.any():
            losses.note_joint(joint, "has friction that grows with the load, which is left out")
    armature = parts.armature[joint].copy()
    for actuator in parts.actuators:
        if actuator.joint == joint and actuator.rotor is not None:
            armature += actuator.ratio**2 * actuator.rotor.inertia
            losses.note_joint(joint, "has a rotor, which is written as armature: what it does to other joints is lost")
            if np.isfinite(actuator.stiffness):
                losses.note_joint(joint, "has an elastic gear, which is written as a rigid one")
    viscous = np.sum([friction.viscous for friction in frictions], axis=0)
    coulomb = np.sum([friction.coulomb for friction in frictions], axis=0)
    # Arrays of one value for each degree of freedom; their keys are the fields of JointDrive.
    values_by_quantity = {
        "damping": viscous,
        "friction": coulomb,
        "armature": armature,
    }
    means = {}
    for quantity, values in values_by_quantity.items():
        if np.ptp(values) > 0:
            losses.note_joint(joint, f"has another {quantity} in each direction, of which the mean is written")
        means[quantity] = float(np.mean(values))
    return JointDrive(**means)


def configurations_of(parts: ModelParts) -> dict[str, dict[str, Array]]:
    """Coordinates by the names of configuration and joint.

    The reference configuration ``qpos0`` is left out if it is neutral, because it is then MuJoCo's default.
    """
    neutral_q = {joint.name: joint.joint.neutral for joint in parts.joints}
    neutral_q[ROOT_JOINT] = np.r_[1.0, np.zeros(6)]  # unit quaternion, then position
    configurations = {}
    for name, positions in parts.additions.configurations.items():
        q_by_joint = {joint: np.asarray(q, float) for joint, q in positions.items()}
        is_neutral = all(np.array_equal(q, neutral_q[joint]) for joint, q in q_by_joint.items())
        if name == REFERENCE and is_neutral:
            continue
        configurations[name] = q_by_joint
    return configurations
