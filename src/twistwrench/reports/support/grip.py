"""Payload of a motion held by two fingers or a suction cup, as a question of the torque report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from ...core.answers.blocks import Table, numbers, words
from ...core.arguments import number as number_of
from ...core.arguments import parse_numbers, positive
from ...core.errors import UnknownNameError, ValueRangeError
from ...core.numbers import number, rounded_down, seconds
from ...core.text import Argument, spell
from ...core.typing import Array
from ...core.verdict import Reason, Verdict
from ...mechanics.lie import se3
from ...statics.contacts import Contact, tangents
from ...statics.feet import patch
from ...statics.support import Support, force_shares, hold
from .fingers import NO_FINGERS, FingerDrives, finger_drives

if TYPE_CHECKING:
    from ...motion.load_case import LoadCase, Payload
    from ...motion.motion import Motion

HolderGiven: TypeAlias = "str | Mapping[str, Any]"
"""``"FORCE,FRICTION[@FRAME]"``, or a mapping."""
Kind = Literal["grip", "cup"]

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Directions in which two fingers face each other, in the frame of the grip."""
_DEFAULT_WIDTH = 0.05
"""Distance of the fingers [m]."""
_DEFAULT_PAD = (0.02, 0.02)
"""Size of a pad [m]."""
_DEFAULT_RADIUS = 0.02
"""Radius of a cup [m]."""
_RING_POINTS = 8
"""Number of contact points that stand for a cup's ring."""
_MILLIMETRES = 1000  # per metre
_MAX_SHIFT_OF_PAYLOAD = 1e-6
"""Largest change of an entry of the payload's pose (4, 4) in the frame that holds it; rounding errors are below it."""
_ENTRY_NAMES: dict[Kind, tuple[str, ...]] = {
    "grip": ("force", "friction", "frame", "axis", "width", "pad"),
    "cup": ("force", "friction", "frame", "radius"),
}
"""Names of the entries of a mapping that describes a holder."""


@dataclass(frozen=True, eq=False)
class Holder:
    """Fingers or a cup at a frame that hold the payload."""

    kind: Kind
    force: float
    """Largest force of each finger, or vacuum force [N]."""
    frame: str
    """Frame of the holder."""
    contacts: tuple[Contact, ...]
    """Contacts in the frame, with normals into the payload."""
    assumed: str = ""
    """Text of dimensions that were assumed, since they are not given; empty if all are given."""

    @classmethod
    def from_given(cls, kind: Kind, given: HolderGiven, load: LoadCase) -> Holder:
        """Holder from the text or mapping of a user; without a frame, it is at the frame of the payload."""
        payload = _payload(kind, load)
        entries = _holder_entries(kind, given)
        frame = str(entries.get("frame") or payload.frame or load.robot.model.tip)
        load.robot.model.frame(frame)  # raises an error for an unknown frame
        force = positive(entries["force"], f"the force of {kind}", "N")
        friction = number_of(entries["friction"], f"the friction of {kind}")
        if not 0 <= friction < math.inf:
            raise ValueRangeError(f"{{0}}: the friction is {friction!r}. Give at least zero.", Argument(kind))
        assumed = ""
        if kind == "cup":
            radius = positive(entries.get("radius", _DEFAULT_RADIUS), "the radius of a cup", "m")
            if "radius" not in entries:
                assumed = f"a cup of {number(2 * _MILLIMETRES * radius)} mm"  # diameter
            return cls(kind, force, frame, _cup(force, friction, radius), assumed)
        axis = str(entries.get("axis", "y"))
        if axis not in _AXES:
            raise UnknownNameError.from_choices("axis of the fingers", axis, _AXES)
        width = positive(entries.get("width", _DEFAULT_WIDTH), "the width of a grip", "m")
        pad = entries.get("pad", _DEFAULT_PAD)
        if "pad" not in entries or "width" not in entries:
            length = number(_MILLIMETRES * pad[0])
            height = number(_MILLIMETRES * pad[1])
            assumed = f"pads of {length} x {height} mm"
        contacts = _fingers(force, friction, np.array(_AXES[axis]), width, pad)
        return cls(kind, force, frame, contacts, assumed)


def _payload(kind: Kind, load: LoadCase) -> Payload:
    """Payload of a load case; raises ValueRangeError unless there is exactly one, with a mass."""
    count = len(load.payloads)
    if count != 1 or not load.payloads[0].mass:
        problem = "its mass is 0" if count == 1 else f"there are {count}"
        raise ValueRangeError(
            f"{{0}} holds the payload, and {problem}. Give one with a mass, {{1}}.",
            Argument(kind),
            Argument("payload", 1.0),
        )
    return load.payloads[0]


def _expected_text(kind: Kind) -> str:
    """Form of the text that describes a holder, with an example, for messages."""
    example = {"grip": "60,0.5@tool0", "cup": "80,0.5@tool0"}[kind]
    return f"FORCE,FRICTION[@FRAME] in N, for example {example}"


def _holder_entries(kind: Kind, text_or_mapping: HolderGiven) -> dict[str, Any]:
    """Entries of a holder from its text or mapping, with force and friction."""
    if not isinstance(text_or_mapping, Mapping):
        text, _, frame = str(text_or_mapping).partition("@")
        force, friction = parse_numbers(text, kind, _expected_text(kind), 2)
        return {"force": force, "friction": friction, "frame": frame.strip()}
    for key in text_or_mapping:
        if key not in _ENTRY_NAMES[kind]:
            raise UnknownNameError.from_choices(f"entry of {kind}", key, _ENTRY_NAMES[kind])
    for key in ("force", "friction"):
        if key not in text_or_mapping:
            raise ValueRangeError(f"{{0}} lacks {key!r}. Give {_expected_text(kind)}.", Argument(kind))
    return dict(text_or_mapping)


def _fingers(force: float, friction: float, axis: Array, width: float, pad: Any) -> tuple[Contact, ...]:
    """Contacts of two pads that face each other along an axis; ``pad`` has two sides [m], ``width`` is their distance [m]."""
    signs = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])  # of the four corners
    sides = np.array([pad[0], pad[1]])
    corners = 0.5 * (signs * sides) @ tangents(axis)  # about the middle of a pad
    contacts: list[Contact] = []
    for side in (-1.0, 1.0):
        pad_corners = corners - side * 0.5 * width * axis
        contacts += patch(None, pad_corners, side * axis, friction, push=force)
    return tuple(contacts)


def _cup(force: float, friction: float, radius: float) -> tuple[Contact, ...]:
    """Contacts of a ring in the plane z = 0 that pushes along z of the frame, and pulls by its vacuum."""
    angles = 2 * np.pi * np.arange(_RING_POINTS) / _RING_POINTS
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(_RING_POINTS)], axis=1)
    ring = radius * directions
    return patch(None, ring, (0.0, 0.0, 1.0), friction, pull=force)


# ── The answer


@dataclass(frozen=True, eq=False, repr=False)
class GripSupport:
    """Support of the payload by its holder along a motion."""

    support: Support  # at each instant
    holder: Holder
    time: Array
    """(n,): times of the motion [s]."""
    needed: Array
    """(n,): needed force, the least force of the holder that would hold the payload [N]; inf if none would."""
    mass: float
    """Mass of the payload [kg]."""
    fingers: FingerDrives = NO_FINGERS
    """Drives of fingers that are not judged for the grip force."""

    @property
    def verdict(self) -> Verdict:
        """OVER LIMIT if the payload slips or comes off, with the force that it needs."""
        over_reasons, unsure_reasons = [], []
        is_failure = self.support.decided & ~self.support.holds
        if is_failure.any():
            over_reasons.append(self._failure(is_failure))
        undecided_count = int((~self.support.decided).sum())
        if undecided_count:
            unsure_reasons.append(f"rounding prevents an answer on the grip at {undecided_count} instants")
        if self.fingers.are_weaker(self.holder.force):
            limits = spell(Argument("limits", "limits.csv"))
            text = f"{self._finger_remark}, which is above the limit of a sliding finger. Give less, or its limit by {limits}"
            unsure_reasons.append(Reason(text, limits))
        return Verdict.from_reasons(over=over_reasons, unsure=unsure_reasons)

    def _failure(self, is_failure: Array) -> str:
        """Sentence on the failure with the largest needed force; ``is_failure`` is a mask (n,) of instants."""
        needed_at_failures = np.where(is_failure, self.needed, -1.0)  # below any needed force
        k = int(needed_at_failures.argmax())
        needed_force = self.needed[k]
        if self.holder.kind == "grip":
            failure = "slips in the grip"
        elif math.isfinite(float(self.support.friction[k])):  # with more friction it would hold
            failure = "slips on the cup"
        else:
            failure = "comes off the cup"
        need = "no force holds it"
        if math.isfinite(needed_force):
            need = f"it needs {_rounded_up(needed_force)} N, given {number(self.holder.force)} N"
        return f"the load {failure} at t = {seconds(float(self.time[k]))} s: {need}{self._assumption}"

    @property
    def _finger_remark(self) -> str:
        """Clause on drives of fingers that are not judged; empty if there are none."""
        return self.fingers.remark(self.holder.force)

    @property
    def _assumption(self) -> str:
        """Assumed dimensions in parentheses; empty if none were assumed."""
        return f" (with {self.holder.assumed})" if self.holder.assumed else ""

    @property
    def line(self) -> str:
        """Sentence on a payload that is held: needed force, and the largest speed and further mass that are held."""
        needed_force = float(self.needed.max(initial=0.0))
        speed = float(self.support.speed.min(initial=math.inf))
        further_mass = float(self.support.payload.min(initial=math.inf))
        text = f"The {self.holder.kind} needs {_rounded_up(needed_force)} N (given {number(self.holder.force)} N)"
        margins = []
        if math.isfinite(speed):
            margins.append(f"{rounded_down(speed)} × this speed")
        if math.isfinite(further_mass):
            margins.append(f"{rounded_down(further_mass)} kg more")
        if margins:
            text += f", and holds up to {' or '.join(margins)}"
        text += f"{self._assumption}."
        remark = self._finger_remark
        if remark:
            text += f" {remark[0].upper()}{remark[1:]}."
        return text

    def table(self) -> Table:
        """Table of the forces that the payload needs."""
        k = int(self.needed.argmax())
        return Table(
            "Grip",
            words("holder", [self.holder.kind]),
            words("frame", [self.holder.frame]),
            numbers("needed", [float(self.needed[k])], unit="N"),
            numbers("when", [float(self.time[k])], seconds, "s"),
            numbers("given", [self.holder.force], unit="N"),
            numbers("friction\nneeded", [float(self.support.friction.max(initial=0.0))]),
        )

    def columns(self) -> dict[str, Array]:
        """Columns (n,) of a written table."""
        return {"grip.needed [N]": self.needed, "grip.speed_margin": self.support.speed}


def _rounded_up(force: float) -> str:
    """Force with three digits, rounded up."""
    if force <= 0:
        return number(0.0)
    exponent = math.floor(math.log10(force))
    third_digit = 10.0 ** (exponent - 2)  # its value [N]
    count = math.ceil(force / third_digit * (1 - 1e-9))  # not up by a rounding error
    return number(count * third_digit, 3)


def grip_support(holder: Holder, load: LoadCase, motion: Motion, efforts: Array) -> GripSupport:
    """Support of the payload by its holder along the states of a motion.

    ``efforts`` (nv,) are the limits of the drives, fingers among them.
    """
    payload = _payload(holder.kind, load)
    robot = load.robot
    frame = holder.frame
    payload_frame = payload.frame or str(robot.model.tip)
    T_sf = np.asarray(robot.forward_kinematics(motion.q, frame))
    T_sp = np.asarray(robot.forward_kinematics(motion.q, payload_frame))
    T_fp = se3.inverse(T_sf) @ T_sp
    first_T_fp = T_fp[0]
    if np.abs(T_fp - first_T_fp).max(initial=0.0) > _MAX_SHIFT_OF_PAYLOAD:
        raise ValueRangeError(
            f"{{0}}: the payload is at {payload_frame!r}, which moves against {frame!r}. Hold it at a frame that is fixed to "
            "it.",
            Argument(holder.kind),
        )
    G = payload.inertia.in_frame(first_T_fp)
    wrenches, weights = _payload_wrenches(np.asarray(G.matrix), robot, motion, frame)
    support = hold(wrenches, holder.contacts, per_kilogram=wrenches / payload.mass, at_rest=weights)
    needed = holder.force * force_shares(wrenches, holder.contacts)
    fingers = NO_FINGERS
    if holder.kind == "grip":
        fingers = finger_drives(robot.model, frame, efforts, load.wrenches)
    return GripSupport(support, holder, motion.time, needed, payload.mass, fingers)


def _payload_wrenches(G: Array, robot: Any, motion: Motion, frame: str) -> tuple[Array, Array]:
    """Wrenches (n, 6) on a payload in the axes of a frame: of weight and inertia, and of weight alone.

    They are G (0, g) - G A + ad(V)' G V and G (0, g).
    """
    V = np.asarray(robot.frame_velocity(motion.q, motion.dq, frame))
    A = np.asarray(robot.frame_acceleration(motion.q, motion.dq, motion.ddq, frame))
    T = np.asarray(robot.forward_kinematics(motion.q, frame))
    R = T[:, :3, :3]
    g = np.einsum("nji,j->ni", R, robot.model.gravity)
    free_fall = np.concatenate([np.zeros_like(g), g], axis=1)  # (0, g)
    P = V @ G.T  # momentum G V
    w, v = V[:, :3], V[:, 3:]
    angular, linear = P[:, :3], P[:, 3:]
    bias_moment = np.cross(angular, w) + np.cross(linear, v)
    bias = np.concatenate([bias_moment, np.cross(linear, w)], axis=1)  # ad(V)' P
    weight = free_fall @ G.T
    return weight - A @ G.T + bias, weight
