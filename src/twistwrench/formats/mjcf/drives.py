"""Actuators, equality constraints and fixed tendons of MJCF."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np

from ...core.errors import ValueRangeError
from ...core.numbers import number, printed
from ...core.typing import Array
from ...mechanics.lie import quaternion, se3
from ...mechanics.model.actuators import Actuator, Motor, check_actuator
from ...mechanics.model.builder import ModelBuilder
from ...mechanics.model.description import Mimic, label
from ...mechanics.model.model import OfferedClosure
from ..known_elements import ACTUATORS, LEFT_OUT
from ..xml import Element
from .bodies import WORLD, MjcfBody, MjcfJoint, limited
from .preprocess import SHORTCUT, Defaults, Settings

_LOSSES = ("damping", "frictionloss", "armature")
_POLYNOMIAL = (0.0, 0.0, 0.0)
"""Defaults of a stiffness or a damping: the linear coefficient and those of higher order."""


_UNTOLD = ("cranksite", "slidersite")
"""Attributes of actuators on a slider-crank, whose joints the file does not name."""


def motor_joints_of(root: Element, joints: Mapping[str, MjcfJoint], defaults: Defaults) -> set[str]:
    """Joints that actuators drive, directly or by a fixed tendon; empty if the joints of an actuator are unknown."""
    tendons = {
        one.attributes.get("name", "").strip(): one for section in root.all("tendon") for one in section.children
    }
    driven: set[str] = set()
    for child in (child for section in root.all("actuator") for child in section.children):
        one = defaults.apply(child)
        joint = one.attributes.get("joint", one.attributes.get("jointinparent", "")).strip()
        tendon = tendons.get(one.attributes.get("tendon", "").strip())
        if any(name in one.attributes for name in _UNTOLD) or (tendon is not None and tendon.tag != "fixed"):
            return set()
        driven |= {joint} if joint in joints else set()
        for part in tendon.all("joint") if tendon is not None else ():
            driven |= {part.text("joint")} if part.number("coef") else set()
    return driven


@dataclass(frozen=True)
class Drives:
    """Effort, armature and damping of actuators at joints of one degree, by joint."""

    efforts: dict[str, float] = field(default_factory=dict)
    """Largest torque or force to either side, if known [N m or N]."""
    armature: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    """kg m² or kg."""
    damping: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    """N m s/rad or N s/m."""
    motors: dict[str, tuple[Actuator, dict[str, float]]] = field(default_factory=dict)
    """Described motors, and their friction as it acts at the joint."""


def drives_of(
    builder: ModelBuilder, root: Element, joints: Mapping[str, MjcfJoint], settings: Settings, defaults: Defaults
) -> Drives:
    """Drives of a file's actuators at its joints, with notes for the builder.

    What the actuators of a joint give together, each gear times ``forcerange``, or, of a motor, gear times ``ctrlrange``, lies
    within the joint's own ``actuatorfrcrange``. Their armature and damping count gear squared.
    """
    totals: dict[str, Array] = {}
    drives = Drives()
    for child in (child for section in root.all("actuator") for child in section.children):
        if child.tag not in ACTUATORS:
            builder.note(child, LEFT_OUT["actuator/unknown"])
        one = defaults.apply(child)
        name = one.attributes.get("joint", one.attributes.get("jointinparent", "")).strip()
        if name and name not in joints:
            raise child.error(f"drives the joint {name!r}, which is not there.")
        gear = one.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
        if child.tag in ACTUATORS:
            _add_losses(builder, drives, one, gear, joints.get(name))
        if name:
            force = _force(one, settings)
            at_joint = np.sort(gear * force) if gear else np.zeros(2)  # a gear of zero lets nothing through
            totals[name] = totals.get(name, np.zeros(2)) + at_joint
            if one.attributes.get(SHORTCUT) == "dcmotor" and gear and joints[name].single:
                _add_motor(builder, drives, one, gear, name, float(np.abs(force).min()))
            if child.tag == "orientation":
                builder.note(one, LEFT_OUT["actuator/joint"])
    for name, joint in joints.items():
        if not joint.single:
            continue
        given = totals.get(name, ANY)
        if limited(joint.element, "actuatorfrclimited", "actuatorfrcrange", settings):
            given = np.clip(given, *_range(joint.element, "actuatorfrcrange"))
        effort, note = _effort(given)
        if note and (name in totals or effort is not None):
            builder.note(label("joint", name, joint.element.place), note)
        if effort is not None:
            drives.efforts[name] = effort
    return drives


ANY = np.array([-math.inf, math.inf])
"""Range of unknown forces."""
_PLAIN = {"gaintype": "fixed", "biastype": "none", "dyntype": "none"}
"""Types of an actuator whose force is a gain times its control."""
_UNEQUAL = 1e-3
"""Relative difference of the forces to both sides from which it is noted."""


def _effort(forces: Array) -> tuple[float | None, str]:
    """Effort that a joint gives to either side, None if unknown, and a note.

    ``forces`` are the least and the most that its actuators give, (2,).
    """
    one, other = sorted((max(-float(forces[0]), 0.0), max(float(forces[1]), 0.0)))
    if other == math.inf:
        return None, "has an actuator whose largest force is not given"
    if one == 0.0 < other:
        return other, f"is driven to one side only, by up to {number(other)}, and its limit is that of both"
    if one < (1 - _UNEQUAL) * other:
        sides = f"{number(one)} to one side and {number(other)} to the other"
        return one, f"gives {sides}, and the less is its limit of both"
    return one or None, ""


def _add_losses(builder: ModelBuilder, drives: Drives, one: Element, gear: float, joint: MjcfJoint | None) -> None:
    """Add armature and damping of an actuator, reflected to its joint."""
    for what, reflected in (("armature", drives.armature), ("damping", drives.damping)):
        value, *more = one.floats(what, _POLYNOMIAL)
        if not value and not any(more):
            continue
        if joint is None or not joint.single:
            builder.note(one, f"has a {what} that is left out")
            continue
        if any(more):
            builder.note(one, LEFT_OUT["actuator/damping"])
        reflected[joint.name] += gear**2 * value


def _force(one: Element, settings: Settings) -> Array:
    """Range of an actuator's force before its gear, infinite if it is not given."""
    kind = one.attributes.get(SHORTCUT)
    if kind in (None, "orientation"):
        return ANY
    types = {one.attributes.get(name, plain) for name, plain in _PLAIN.items()}
    plain = kind == "motor" or (kind == "general" and types <= {"fixed", "none"})
    force = ANY
    if plain and limited(one, "ctrllimited", "ctrlrange", settings):
        gain = 1.0 if kind == "motor" else one.floats("gainprm", (1.0, *([0.0] * 9)))[0]
        force = np.sort(gain * _range(one, "ctrlrange"))
    if kind == "dcmotor" and "saturation" in one.attributes:  # which stands for a range of forces
        return _saturation(one)
    if limited(one, "forcelimited", "forcerange", settings):
        return np.clip(force, *_range(one, "forcerange"))
    return force


def _saturation(one: Element) -> Array:
    """The largest torque of a ``dcmotor`` to both sides: as given, or its constant times the largest current."""
    torque, current, _ = one.floats("saturation", (0.0, 0.0, 0.0))
    most = torque or _constant(one) * current
    return np.array([-most, most]) if most else ANY


def _constant(one: Element) -> float:
    """Constant K of a ``dcmotor`` [N m/A]: geometric mean of the torque and the back-EMF constant; 0 if unknown."""
    of_torque, of_speed = one.floats("motorconst", (0.0, 0.0))
    voltage, _, speed = one.floats("nominal", (0.0, 0.0, 0.0))
    given = [x for x in (of_torque, of_speed or (voltage / speed if speed else 0.0)) if x > 0]
    return math.prod(given) ** (1.0 / len(given)) if given else 0.0


def _add_motor(builder: ModelBuilder, drives: Drives, one: Element, gear: float, joint: str, largest: float) -> None:
    """Add the motor of a ``dcmotor`` whose torque is at most ``largest`` [N m] to either side, and its friction."""
    if joint in drives.motors:
        builder.note(one, "is a second motor of its joint, whose electrical data are left out")
        return
    if one.floats("cogging", (0.0, 0.0, 0.0))[0]:
        builder.note(one, "has a cogging torque, which is left out")
    if any(one.floats("thermal", (0.0,) * 6)[:3]):
        builder.note(one, "has a thermal model, which is left out: the resistance is that of the cold motor")
    bristles, _, coulomb, static, stribeck = one.floats("lugre", (0.0,) * 5)
    friction: dict[str, float] = {}
    if bristles:  # of a rotor that turns gear times as fast as the joint
        builder.note(one, "has LuGre friction, whose bristles are left out: its Coulomb and Stribeck friction is kept")
        friction = {"coulomb": abs(gear) * coulomb, "static": abs(gear) * max(static, coulomb)}
        friction |= {"stribeck": stribeck / abs(gear)} if stribeck else {}
    if not (constant := _constant(one)):
        drives.motors[joint] = Actuator(joint, gear), friction
        return
    voltage, stall, _ = one.floats("nominal", (0.0, 0.0, 0.0))
    resistance = one.floats("resistance", (0.0,))[0] or (constant * voltage / stall if stall else 0.0)
    inductance, time = one.floats("inductance", (0.0, 0.0))
    motor = Motor(
        constant, resistance, inductance or time * resistance,
        voltage=voltage or one.floats("controller", (0.0,) * 6)[5] or math.inf, current_peak=largest / constant,
    )  # fmt: skip
    try:
        check_actuator(actuator := Actuator(joint, gear, motor=motor))
    except ValueRangeError as problem:
        raise one.error(f"cannot be a motor: {problem}") from None
    drives.motors[joint] = actuator, friction


def _range(element: Element, attribute: str) -> Array:
    return np.array(element.floats(attribute, (0.0, 0.0)))


# ── Equality constraints: mimic joints, and loops that may be closed

ROWS = {"connect": "vx vy vz", "weld": "wx wy wz vx vy vz"}
"""The rows that an equality holds."""
_SITES = ("site1", "site2")


def constraints_of(root: Element, defaults: Defaults) -> list[Element]:
    """Active equality constraints in the file's order."""
    found = [defaults.apply(one, kind="equality") for section in root.all("equality") for one in section.children]
    return [one for one in found if one.flag("active", default=True)]


def mimics(
    builder: ModelBuilder, constraints: Sequence[Element], joints: Mapping[str, MjcfJoint], kept: Set[str]
) -> dict[str, Mimic]:
    """Joints that follow another by a constant ratio, q1 - q1_ref = c0 + c1 (q2 - q2_ref); notes on the others."""
    found: dict[str, Mimic] = {}
    for one in constraints:
        if one.tag != "joint":
            continue
        follower, leader = one.text("joint1"), one.attributes.get("joint2", "").strip()
        for name in (follower, leader):
            if name and (name not in joints or not joints[name].single):
                raise one.error(f"names {name!r}, which is not a hinge or slide.")
        if not {follower, leader or follower} <= kept:
            continue
        c0, c1, *more = one.floats("polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader:
            place = printed(joints[follower].reference + c0)
            builder.note(one, f"holds joint {follower!r} at {place}, which is left out: lock it")
        elif any(more) or c1 == 0:
            builder.note(one, "makes a joint follow another by a polynomial, which is left out")
        elif follower in found or follower in _leaders(leader, found):
            builder.note(one, "is a second rule for its joints, which is left out")
        else:
            offset = joints[follower].reference + c0 - c1 * joints[leader].reference
            found[follower] = (leader, c1, offset)
    return found


def _leaders(name: str, found: Mapping[str, Mimic]) -> set[str]:
    """Names of the joint and of all that it follows."""
    met = {name}
    while name in found:
        name = found[name][0]
        met.add(name)
    return met


def add_closures(
    builder: ModelBuilder,
    constraints: Sequence[Element],
    bodies: Sequence[MjcfBody],
    poses: Sequence[Array],
    kept: Set[int],
) -> None:
    """Offer each loop as two coincident frames; ``poses`` are those of the bodies in the file."""
    numbers = {body.name: k for k, body in enumerate(bodies)}
    for k, one in enumerate(constraints):
        if one.tag == "joint":
            continue
        if one.tag not in ROWS:
            builder.note(one, f"is an equality of kind {one.tag}, which is left out")
            continue
        name, rows = one.attributes.get("name", "").strip() or f"{one.tag}{k}", ROWS[one.tag]
        if "site1" in one.attributes:
            sites = [
                next((s for s in (f"site:{x}", x) if s in builder.site_names), None) for x in map(one.text, _SITES)
            ]
        else:
            ends = [_body(one, which, numbers) for which in ("body1", "body2")]
            if not set(ends) <= kept:
                continue
            frames = zip(ends, _ends(one, *(poses[i] for i in ends)), strict=True)
            sites = [
                builder.add_site(f"{name}:{bodies[i].name}", bodies[i].name, T, where=one.place) for i, T in frames
            ]
        if None in sites:
            continue
        a, b = map(str, sites)
        builder.add_closure(name, OfferedClosure(a, b, rows))
        builder.remark(f"{one} is left open: robot.close({a!r}, {b!r}, {rows!r}) closes it")


def _body(one: Element, which: str, numbers: Mapping[str, int]) -> int:
    name = one.attributes.get(which, WORLD).strip()
    if name not in numbers:
        raise one.error(f"names the body {name!r}, which is not there.")
    return numbers[name]


def _ends(one: Element, T_1: Array, T_2: Array) -> tuple[Array, Array]:
    """Frames of the two bodies that coincide."""
    between = se3.inverse(T_1) @ T_2
    if one.tag == "connect":
        anchor = se3.pose(np.eye(3), one.numbers("anchor", 3))
        return anchor, se3.inverse(between) @ anchor
    *place, w, x, y, z = one.floats("relpose", (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    anchor = se3.pose(np.eye(3), one.floats("anchor", (0.0, 0.0, 0.0)))
    if any((w, x, y, z)):  # where the anchor is in the first body, and how the second one is turned
        return se3.pose(quaternion.rotation([w, x, y, z]), place), anchor
    return between @ anchor, anchor


# ── Fixed tendons: springs over several joints. Spatial tendons are ignored


def add_tendons(
    builder: ModelBuilder, root: Element, joints: Mapping[str, MjcfJoint], kept: Set[str], defaults: Defaults
) -> None:
    """Add springs of tendons with a stiffness, and notes on forces that are left out."""
    for child in (child for section in root.all("tendon") for child in section.children):
        one = defaults.apply(child, kind="tendon")
        if child.tag == "fixed":
            _add_fixed(builder, one, joints, kept)
        elif child.tag == "spatial" and any(any(one.floats(x, _POLYNOMIAL)) for x in ("stiffness", *_LOSSES)):
            builder.note(child, "is a spatial tendon, whose forces and inertia are left out")


def _add_fixed(builder: ModelBuilder, one: Element, joints: Mapping[str, MjcfJoint], kept: Set[str]) -> None:
    terms: dict[str, float] = defaultdict(float)
    for child in one.all("joint"):
        name = child.text("joint")
        if name not in joints or not joints[name].single:
            raise child.error(f"in {one} names {name!r}, which is not a hinge or slide.")
        terms[name] += child.number("coef")
    for what in _LOSSES:
        if any(one.floats(what, _POLYNOMIAL)):
            builder.note(one, f"has a {what}, which is left out")
    stiffness, *more = one.floats("stiffness", _POLYNOMIAL)
    if any(more):
        builder.note(one, LEFT_OUT["tendon/stiffness"])
    if any(more) or not stiffness:
        return
    if one.floats("springyield", (0.0,))[0]:
        builder.note(one, LEFT_OUT["tendon/springyield"])
    first, last = one.floats("springlength", (-1.0, -1.0))
    if len(one.attributes.get("springlength", "").split()) == 1:
        last = first
    if first == -1.0:
        first = last = sum(weight * joints[name].rest for name, weight in terms.items())
    if first != last:
        builder.note(one, "is a spring that is slack over a range of lengths, and is left out")
    elif terms.keys() <= kept:
        builder.add_spring(terms, stiffness, first, where=one.place)
