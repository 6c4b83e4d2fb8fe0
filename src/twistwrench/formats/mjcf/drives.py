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
from .bodies import WORLD, MjcfBody, MjcfJoint, has_active_range
from .preprocess import SHORTCUT, Defaults, Settings

_LOSSES = ("damping", "frictionloss", "armature")
_POLYNOMIAL = (0.0, 0.0, 0.0)
"""Defaults of a stiffness or a damping: the linear coefficient and those of higher order."""


_SLIDER_CRANK_SITES = ("cranksite", "slidersite")
"""Attributes of actuators on a slider-crank, whose joints the file does not name."""


def _joint_name(actuator: Element) -> str:
    """Name of the joint that an actuator drives directly; empty if it drives none."""
    return actuator.attributes.get("joint", actuator.attributes.get("jointinparent", "")).strip()


def motor_joints_of(root: Element, joints: Mapping[str, MjcfJoint], defaults: Defaults) -> set[str]:
    """Joints that actuators drive, directly or by a fixed tendon; empty if the joints of an actuator are unknown."""
    tendons = {tendon.attributes.get("name", "").strip(): tendon for tendon in root.children_in("tendon")}
    motor_joints: set[str] = set()
    for child in root.children_in("actuator"):
        actuator = defaults.apply(child)
        tendon = tendons.get(actuator.attributes.get("tendon", "").strip())
        if any(name in actuator.attributes for name in _SLIDER_CRANK_SITES):
            return set()
        if tendon is not None and tendon.tag != "fixed":
            return set()
        motor_joints.add(_joint_name(actuator))
        if tendon is not None:
            motor_joints |= {part.text("joint") for part in tendon.all("joint") if part.number("coef")}
    return motor_joints & joints.keys()


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
    for child in root.children_in("actuator"):
        if child.tag not in ACTUATORS:
            builder.note(child, LEFT_OUT["actuator/unknown"])
        actuator = defaults.apply(child)
        name = _joint_name(actuator)
        if name and name not in joints:
            raise child.error(f"drives the joint {name!r}, which is not there.")
        gear = actuator.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
        if child.tag in ACTUATORS:
            _add_losses(builder, drives, actuator, gear, joints.get(name))
        if name:
            force = _force(actuator, settings)
            at_joint = np.sort(gear * force) if gear else np.zeros(2)  # a gear of zero lets nothing through
            totals[name] = totals.get(name, np.zeros(2)) + at_joint
            if actuator.attributes.get(SHORTCUT) == "dcmotor" and gear and joints[name].single:
                _add_motor(builder, drives, actuator, gear, name, float(np.abs(force).min()))
            if child.tag == "orientation":
                builder.note(actuator, LEFT_OUT["actuator/joint"])
    for name, joint in joints.items():
        if not joint.single:
            continue
        force = totals.get(name, ANY)
        if has_active_range(joint.element, "actuatorfrclimited", "actuatorfrcrange", settings):
            force = np.clip(force, *_range(joint.element, "actuatorfrcrange"))
        effort, note = _effort(force)
        if note and (name in totals or effort is not None):
            builder.note(label("joint", name, joint.element.place), note)
        if effort is not None:
            drives.efforts[name] = effort
    return drives


ANY = np.array([-math.inf, math.inf])
"""Range of unknown forces."""
_PLAIN = {"gaintype": "fixed", "biastype": "none", "dyntype": "none"}
"""Types of an actuator whose force is a gain times its control."""
_MAX_DIFFERENCE_OF_SIDES = 1e-3
"""Relative difference of the forces to both sides from which it is noted."""


def _effort(forces: Array) -> tuple[float | None, str]:
    """Effort that a joint gives to either side, None if unknown, and a note.

    ``forces`` are the least and the most that its actuators give, (2,).
    """
    smaller, larger = sorted((max(-float(forces[0]), 0.0), max(float(forces[1]), 0.0)))
    if larger == math.inf:
        return None, "has an actuator whose largest force is not given"
    if smaller == 0.0 < larger:
        return larger, f"is driven to one side only, by up to {number(larger)}, and its limit is that of both"
    if smaller < (1 - _MAX_DIFFERENCE_OF_SIDES) * larger:
        sides = f"{number(smaller)} to one side and {number(larger)} to the other"
        return smaller, f"gives {sides}, and the less is its limit of both"
    return smaller or None, ""


def _add_losses(builder: ModelBuilder, drives: Drives, actuator: Element, gear: float, joint: MjcfJoint | None) -> None:
    """Add armature and damping of an actuator, reflected to its joint."""
    for kind, reflected in (("armature", drives.armature), ("damping", drives.damping)):
        value, *higher = actuator.floats(kind, _POLYNOMIAL)
        if not value and not any(higher):
            continue
        if joint is None or not joint.single:
            builder.note(actuator, f"has a {kind} that is left out")
            continue
        if any(higher):
            builder.note(actuator, LEFT_OUT["actuator/damping"])
        reflected[joint.name] += gear**2 * value


def _force(actuator: Element, settings: Settings) -> Array:
    """Range of an actuator's force before its gear, infinite if it is not given."""
    kind = actuator.attributes.get(SHORTCUT)
    if kind in (None, "orientation"):
        return ANY
    types = {actuator.attributes.get(name, plain) for name, plain in _PLAIN.items()}
    plain = kind == "motor" or (kind == "general" and types <= {"fixed", "none"})
    force = ANY
    if plain and has_active_range(actuator, "ctrllimited", "ctrlrange", settings):
        gain = 1.0 if kind == "motor" else actuator.floats("gainprm", (1.0, *([0.0] * 9)))[0]
        force = np.sort(gain * _range(actuator, "ctrlrange"))
    if kind == "dcmotor" and "saturation" in actuator.attributes:  # which stands for a range of forces
        return _saturation(actuator)
    if has_active_range(actuator, "forcelimited", "forcerange", settings):
        return np.clip(force, *_range(actuator, "forcerange"))
    return force


def _saturation(actuator: Element) -> Array:
    """The largest torque of a ``dcmotor`` to both sides: as given, or its constant times the largest current."""
    torque, current, _ = actuator.floats("saturation", (0.0, 0.0, 0.0))
    largest = torque or _constant(actuator) * current
    return np.array([-largest, largest]) if largest else ANY


def _constant(actuator: Element) -> float:
    """Constant K of a ``dcmotor`` [N m/A]: geometric mean of the torque and the back-EMF constant; 0 if unknown."""
    torque_constant, speed_constant = actuator.floats("motorconst", (0.0, 0.0))
    voltage, _, speed = actuator.floats("nominal", (0.0, 0.0, 0.0))
    if not speed_constant and speed:
        speed_constant = voltage / speed
    constants = [constant for constant in (torque_constant, speed_constant) if constant > 0]
    return math.prod(constants) ** (1.0 / len(constants)) if constants else 0.0


def _add_motor(
    builder: ModelBuilder, drives: Drives, actuator: Element, gear: float, joint: str, largest: float
) -> None:
    """Add the motor of a ``dcmotor`` whose torque is at most ``largest`` [N m] to either side, and its friction."""
    if joint in drives.motors:
        builder.note(actuator, "is a second motor of its joint, whose electrical data are left out")
        return
    if actuator.floats("cogging", (0.0, 0.0, 0.0))[0]:
        builder.note(actuator, "has a cogging torque, which is left out")
    if any(actuator.floats("thermal", (0.0,) * 6)[:3]):
        builder.note(actuator, "has a thermal model, which is left out: the resistance is that of the cold motor")
    friction = _lugre_friction(builder, actuator, gear)
    constant = _constant(actuator)
    if not constant:
        drives.motors[joint] = Actuator(joint, gear), friction
        return
    voltage, stall_current, _ = actuator.floats("nominal", (0.0, 0.0, 0.0))
    resistance = actuator.floats("resistance", (0.0,))[0]
    if not resistance and stall_current:
        resistance = constant * voltage / stall_current
    inductance, time_constant = actuator.floats("inductance", (0.0, 0.0))
    motor = Motor(
        constant, resistance, inductance or time_constant * resistance,
        voltage=voltage or actuator.floats("controller", (0.0,) * 6)[5] or math.inf, current_peak=largest / constant,
    )  # fmt: skip
    described = Actuator(joint, gear, motor=motor)
    try:
        check_actuator(described)
    except ValueRangeError as problem:
        raise actuator.error(f"cannot be a motor: {problem}") from None
    drives.motors[joint] = described, friction


def _lugre_friction(builder: ModelBuilder, actuator: Element, gear: float) -> dict[str, float]:
    """Coulomb and Stribeck friction at the joint, of a rotor that turns gear times as fast."""
    bristles, _, coulomb, static, stribeck = actuator.floats("lugre", (0.0,) * 5)
    if not bristles:
        return {}
    builder.note(actuator, "has LuGre friction, whose bristles are left out: its Coulomb and Stribeck friction is kept")
    friction = {"coulomb": abs(gear) * coulomb, "static": abs(gear) * max(static, coulomb)}
    if stribeck:
        friction["stribeck"] = stribeck / abs(gear)
    return friction


def _range(element: Element, attribute: str) -> Array:
    return np.array(element.floats(attribute, (0.0, 0.0)))


ROWS = {"connect": "vx vy vz", "weld": "wx wy wz vx vy vz"}
"""The rows that an equality holds."""
_SITES = ("site1", "site2")


def constraints_of(root: Element, defaults: Defaults) -> list[Element]:
    """Active equality constraints in the file's order."""
    equalities = [defaults.apply(child, kind="equality") for child in root.children_in("equality")]
    return [equality for equality in equalities if equality.flag("active", default=True)]


def mimics(
    builder: ModelBuilder, constraints: Sequence[Element], joints: Mapping[str, MjcfJoint], kept: Set[str]
) -> dict[str, Mimic]:
    """Joints that follow another by a constant ratio, q1 - q1_ref = c0 + c1 (q2 - q2_ref); notes on the others."""
    mimics: dict[str, Mimic] = {}
    for constraint in constraints:
        if constraint.tag != "joint":
            continue
        follower, leader = constraint.text("joint1"), constraint.attributes.get("joint2", "").strip()
        for name in (follower, leader):
            if name and (name not in joints or not joints[name].single):
                raise constraint.error(f"names {name!r}, which is not a hinge or slide.")
        if not {follower, leader or follower} <= kept:
            continue
        c0, c1, *higher = constraint.floats("polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader:
            place = printed(joints[follower].reference + c0)
            builder.note(constraint, f"holds joint {follower!r} at {place}, which is left out: lock it")
        elif any(higher) or c1 == 0:
            builder.note(constraint, "makes a joint follow another by a polynomial, which is left out")
        elif follower in mimics or follower in _leaders(leader, mimics):
            builder.note(constraint, "is a second rule for its joints, which is left out")
        else:
            offset = joints[follower].reference + c0 - c1 * joints[leader].reference
            mimics[follower] = (leader, c1, offset)
    return mimics


def _leaders(name: str, mimics: Mapping[str, Mimic]) -> set[str]:
    """Names of the joint and of all that it follows."""
    leaders = {name}
    while name in mimics:
        name = mimics[name][0]
        leaders.add(name)
    return leaders


def add_closures(
    builder: ModelBuilder,
    constraints: Sequence[Element],
    bodies: Sequence[MjcfBody],
    poses: Sequence[Array],
    kept: Set[int],
) -> None:
    """Offer each loop as two coincident frames; ``poses`` are those of the bodies in the file."""
    numbers = {body.name: k for k, body in enumerate(bodies)}
    for k, constraint in enumerate(constraints):
        if constraint.tag == "joint":
            continue
        if constraint.tag not in ROWS:
            builder.note(constraint, f"is an equality of kind {constraint.tag}, which is left out")
            continue
        name = constraint.attributes.get("name", "").strip() or f"{constraint.tag}{k}"
        if "site1" in constraint.attributes:
            a, b = (_site(builder, constraint.text(attribute)) for attribute in _SITES)
            if not a or not b:
                continue
        else:
            ends = [_body(constraint, attribute, numbers) for attribute in ("body1", "body2")]
            if not set(ends) <= kept:
                continue
            first, second = (bodies[i].name for i in ends)
            T_first, T_second = _ends(constraint, *(poses[i] for i in ends))
            a = builder.add_site(f"{name}:{first}", first, T_first, where=constraint.place)
            b = builder.add_site(f"{name}:{second}", second, T_second, where=constraint.place)
        rows = ROWS[constraint.tag]
        builder.add_closure(name, OfferedClosure(a, b, rows))
        builder.remark(f"{constraint} is left open: robot.close({a!r}, {b!r}, {rows!r}) closes it")


def _site(builder: ModelBuilder, name: str) -> str:
    """Name of a site in the model; empty if it was not read."""
    for site in (f"site:{name}", name):
        if site in builder.site_names:
            return site
    return ""


def _body(constraint: Element, attribute: str, numbers: Mapping[str, int]) -> int:
    name = constraint.attributes.get(attribute, WORLD).strip()
    if name not in numbers:
        raise constraint.error(f"names the body {name!r}, which is not there.")
    return numbers[name]


def _ends(constraint: Element, T_1: Array, T_2: Array) -> tuple[Array, Array]:
    """Frames of the two bodies that coincide."""
    between = se3.inverse(T_1) @ T_2
    if constraint.tag == "connect":
        anchor = se3.pose(np.eye(3), constraint.numbers("anchor", 3))
        return anchor, se3.inverse(between) @ anchor
    *place, w, x, y, z = constraint.floats("relpose", (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    anchor = se3.pose(np.eye(3), constraint.floats("anchor", (0.0, 0.0, 0.0)))
    if any((w, x, y, z)):  # where the anchor is in the first body, and how the second one is turned
        return se3.pose(quaternion.rotation([w, x, y, z]), place), anchor
    return between @ anchor, anchor


def add_tendons(
    builder: ModelBuilder, root: Element, joints: Mapping[str, MjcfJoint], kept: Set[str], defaults: Defaults
) -> None:
    """Add springs of tendons with a stiffness, and notes on forces that are left out."""
    for child in root.children_in("tendon"):
        tendon = defaults.apply(child, kind="tendon")
        if child.tag == "fixed":
            _add_fixed(builder, tendon, joints, kept)
        elif child.tag == "spatial":
            forces = [tendon.floats(attribute, _POLYNOMIAL) for attribute in ("stiffness", *_LOSSES)]
            if np.any(forces):
                builder.note(child, "is a spatial tendon, whose forces and inertia are left out")


def _add_fixed(builder: ModelBuilder, tendon: Element, joints: Mapping[str, MjcfJoint], kept: Set[str]) -> None:
    terms: dict[str, float] = defaultdict(float)
    for child in tendon.all("joint"):
        name = child.text("joint")
        if name not in joints or not joints[name].single:
            raise child.error(f"in {tendon} names {name!r}, which is not a hinge or slide.")
        terms[name] += child.number("coef")
    for what in _LOSSES:
        if any(tendon.floats(what, _POLYNOMIAL)):
            builder.note(tendon, f"has a {what}, which is left out")
    stiffness, *higher = tendon.floats("stiffness", _POLYNOMIAL)
    if any(higher):
        builder.note(tendon, LEFT_OUT["tendon/stiffness"])
    if any(higher) or not stiffness:
        return
    if tendon.floats("springyield", (0.0,))[0]:
        builder.note(tendon, LEFT_OUT["tendon/springyield"])
    first, last = tendon.floats("springlength", (-1.0, -1.0))
    if len(tendon.attributes.get("springlength", "").split()) == 1:
        last = first
    if first == -1.0:
        first = last = sum(weight * joints[name].rest for name, weight in terms.items())
    if first != last:
        builder.note(tendon, "is a spring that is slack over a range of lengths, and is left out")
    elif terms.keys() <= kept:
        builder.add_spring(terms, stiffness, first, where=tendon.place)
