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

_LOSS_ATTRIBUTES = ("damping", "frictionloss", "armature")
_ZERO_POLYNOMIAL = (0.0, 0.0, 0.0)
"""Default coefficients of a stiffness or a damping: linear, and of higher order."""
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
            moved_parts = [part for part in tendon.all("joint") if part.number("coef") != 0]
            motor_joints |= {part.text("joint") for part in moved_parts}
    return motor_joints & joints.keys()  # without the empty name


@dataclass(frozen=True)
class Drives:
    """Effort, armature and damping of actuators at joints of one degree, by joint."""

    efforts: dict[str, float] = field(default_factory=dict)
    """Largest torque or force to either side, if known [N m or N]."""
    armature: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    """Sum of the armatures at the joint [kg m² or kg]."""
    damping: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    """Sum of the dampings at the joint [N m s/rad or N s/m]."""
    motors: dict[str, tuple[Actuator, dict[str, float]]] = field(default_factory=dict)
    """Actuator with its motor, and friction as it acts at the joint, by name of the coefficient."""


def drives_of(
    builder: ModelBuilder, root: Element, joints: Mapping[str, MjcfJoint], settings: Settings, defaults: Defaults
) -> Drives:
    """Drives of a file's actuators at its joints, with notes for the builder.

    Each actuator gives a range of forces at its joint: gear times ``forcerange``, or gear times ``ctrlrange`` for a motor. The
    ranges of a joint's actuators are added, and the sum is limited to the joint's own ``actuatorfrcrange``. Armature and
    damping of an actuator are multiplied by its gear squared.
    """
    force_range_by_joint: dict[str, Array] = {}
    drives = Drives()
    for child in root.children_in("actuator"):
        if child.tag not in ACTUATORS:
            builder.note(child, LEFT_OUT["actuator/unknown"])
        actuator = defaults.apply(child)
        joint_name = _joint_name(actuator)
        if joint_name and joint_name not in joints:
            raise child.error(f"drives the joint {joint_name!r}, which is not there.")
        gear = actuator.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
        if child.tag in ACTUATORS:
            _add_losses(builder, drives, actuator, gear, joints.get(joint_name))
        if joint_name:
            force_range = _force_range(actuator, settings)
            range_at_joint = np.zeros(2)  # a gear of zero transmits no force; infinity times zero would be nan
            if gear:
                range_at_joint = np.sort(gear * force_range)  # a negative gear exchanges the sides
            force_range_by_joint[joint_name] = force_range_by_joint.get(joint_name, np.zeros(2)) + range_at_joint
            if actuator.attributes.get(SHORTCUT) == "dcmotor" and gear and joints[joint_name].single:
                largest_torque = float(np.abs(force_range).min())  # that it gives to either side
                _add_motor(builder, drives, actuator, gear, joint_name, largest_torque)
            if child.tag == "orientation":  # no such actuator drives a joint
                builder.note(actuator, LEFT_OUT["actuator/joint"])
    for joint_name, joint in joints.items():
        if not joint.single:
            continue
        force_range = force_range_by_joint.get(joint_name, UNKNOWN_RANGE)
        if has_active_range(joint.element, "actuatorfrclimited", "actuatorfrcrange", settings):
            lower, upper = _numbers_of_range(joint.element, "actuatorfrcrange")
            force_range = np.clip(force_range, lower, upper)
        effort, note = _effort_and_note(force_range)
        # A joint without actuators and without a range has no effort either, which needs no note.
        if note and (joint_name in force_range_by_joint or effort is not None):
            builder.note(label("joint", joint_name, joint.element.place), note)
        if effort is not None:
            drives.efforts[joint_name] = effort
    return drives


UNKNOWN_RANGE = np.array([-math.inf, math.inf])
"""Least and largest force of an actuator whose range is unknown."""
_GAIN_ONLY_TYPES = {"gaintype": "fixed", "biastype": "none", "dyntype": "none"}
"""Types of an actuator whose force is a gain times its control."""
_MAX_DIFFERENCE_OF_SIDES = 1e-3
"""Largest relative difference of the forces to both sides that needs no note."""


def _effort_and_note(force_range: Array) -> tuple[float | None, str]:
    """Effort that a joint gives to either side, None if unknown or zero, and a note, which may be empty.

    ``force_range`` (2,) are the least force of the joint's actuators, which is negative, and the largest one.
    """
    to_negative_side = max(-float(force_range[0]), 0.0)
    to_positive_side = max(float(force_range[1]), 0.0)
    smaller = min(to_negative_side, to_positive_side)
    larger = max(to_negative_side, to_positive_side)
    if larger == math.inf:
        return None, "has an actuator whose largest force is not given"
    if smaller == 0.0 < larger:
        return larger, f"is driven to one side only, by up to {number(larger)}, and its limit is that of both"
    if smaller < (1 - _MAX_DIFFERENCE_OF_SIDES) * larger:
        sides = f"{number(smaller)} to one side and {number(larger)} to the other"
        return smaller, f"gives {sides}, and the less is its limit of both"
    if smaller == 0.0:
        return None, ""
    return smaller, ""


def _add_losses(builder: ModelBuilder, drives: Drives, actuator: Element, gear: float, joint: MjcfJoint | None) -> None:
    """Add armature and damping of an actuator at its joint, by gear squared; None for an actuator without a joint."""
    for kind, sum_by_joint in (("armature", drives.armature), ("damping", drives.damping)):
        linear, *higher = actuator.floats(kind, _ZERO_POLYNOMIAL)
        if not linear and not any(higher):
            continue
        if joint is None or not joint.single:
            builder.note(actuator, f"has a {kind} that is left out")
            continue
        if any(higher):
            builder.note(actuator, LEFT_OUT["actuator/damping"])
        sum_by_joint[joint.name] += gear**2 * linear


def _force_range(actuator: Element, settings: Settings) -> Array:
    """Range of an actuator's force before its gear (2,), infinite if it is not given."""
    kind = actuator.attributes.get(SHORTCUT)
    if kind in (None, "orientation"):
        return UNKNOWN_RANGE
    is_general_gain = kind == "general" and all(
        actuator.attributes.get(name, default) in ("fixed", "none") for name, default in _GAIN_ONLY_TYPES.items()
    )
    force_range = UNKNOWN_RANGE
    if (kind == "motor" or is_general_gain) and has_active_range(actuator, "ctrllimited", "ctrlrange", settings):
        gain = 1.0 if kind == "motor" else actuator.floats("gainprm", (1.0, *([0.0] * 9)))[0]
        force_range = np.sort(gain * _numbers_of_range(actuator, "ctrlrange"))  # a negative gain exchanges the sides
    if kind == "dcmotor" and "saturation" in actuator.attributes:  # takes the place of a force range
        return _saturation_range(actuator)
    if has_active_range(actuator, "forcelimited", "forcerange", settings):
        lower, upper = _numbers_of_range(actuator, "forcerange")
        return np.clip(force_range, lower, upper)
    return force_range


def _saturation_range(actuator: Element) -> Array:
    """Range of the torque of a ``dcmotor``, to the largest torque or to its constant times the largest current.

    A torque or current of zero is not given in the file.
    """
    torque, current, _ = actuator.floats("saturation", (0.0, 0.0, 0.0))
    largest = torque
    if torque == 0:
        largest = _motor_constant(actuator) * current
    if largest == 0:
        return UNKNOWN_RANGE
    return np.array([-largest, largest])


def _motor_constant(actuator: Element) -> float:
    """Constant K of a ``dcmotor`` [N m/A]: geometric mean of the torque and the back-EMF constant; 0 if unknown.

    The two are equal in SI units. Zero means "not given"; if one of them is missing, K is the other one.
    """
    torque_constant, back_emf_constant = actuator.floats("motorconst", (0.0, 0.0))
    voltage, _, no_load_speed = actuator.floats("nominal", (0.0, 0.0, 0.0))
    if not back_emf_constant and no_load_speed:
        back_emf_constant = voltage / no_load_speed
    constants = [constant for constant in (torque_constant, back_emf_constant) if constant > 0]
    if not constants:
        return 0.0
    return math.prod(constants) ** (1.0 / len(constants))


def _add_motor(
    builder: ModelBuilder, drives: Drives, actuator: Element, gear: float, joint: str, largest_torque: float
) -> None:
    """Add the motor of a ``dcmotor`` and its friction; ``largest_torque`` is the one to either side [N m]."""
    if joint in drives.motors:
        builder.note(actuator, "is a second motor of its joint, whose electrical data are left out")
        return
    if actuator.floats("cogging", (0.0, 0.0, 0.0))[0]:
        builder.note(actuator, "has a cogging torque, which is left out")
    resistances_and_capacity = actuator.floats("thermal", (0.0,) * 6)[:3]
    if any(resistances_and_capacity):
        builder.note(actuator, "has a thermal model, which is left out: the resistance is that of the cold motor")
    friction = _lugre_friction(builder, actuator, gear)
    constant = _motor_constant(actuator)
    if constant == 0:
        drives.motors[joint] = Actuator(joint, gear), friction
        return
    # In all these attributes, zero means "not given".
    voltage, stall_torque, _ = actuator.floats("nominal", (0.0, 0.0, 0.0))
    resistance = actuator.floats("resistance", (0.0,))[0]
    if resistance == 0 and stall_torque != 0:
        resistance = constant * voltage / stall_torque
    inductance, time_constant = actuator.floats("inductance", (0.0, 0.0))
    if inductance == 0:
        inductance = time_constant * resistance
    if voltage == 0:
        voltage = actuator.floats("controller", (0.0,) * 6)[5]
    if voltage == 0:
        voltage = math.inf
    motor = Motor(constant, resistance, inductance, voltage=voltage, current_peak=largest_torque / constant)
    described_actuator = Actuator(joint, gear, motor=motor)
    try:
        check_actuator(described_actuator)
    except ValueRangeError as problem:
        raise actuator.error(f"cannot be a motor: {problem}") from None
    drives.motors[joint] = described_actuator, friction


def _lugre_friction(builder: ModelBuilder, actuator: Element, gear: float) -> dict[str, float]:
    """Coulomb and Stribeck friction at the joint, by name of the coefficient; empty without LuGre friction.

    The rotor turns gear times as fast as the joint: torques at the joint are larger by the gear, and speeds smaller.
    """
    bristle_stiffness, _, coulomb, static, stribeck_speed = actuator.floats("lugre", (0.0,) * 5)
    if not bristle_stiffness:  # MuJoCo then has no LuGre friction
        return {}
    builder.note(actuator, "has LuGre friction, whose bristles are left out: its Coulomb and Stribeck friction is kept")
    friction = {"coulomb": abs(gear) * coulomb, "static": abs(gear) * max(static, coulomb)}
    if stribeck_speed:
        friction["stribeck"] = stribeck_speed / abs(gear)
    return friction


def _numbers_of_range(element: Element, attribute: str) -> Array:
    """Lower and upper end of a range (2,)."""
    return np.array(element.floats(attribute, (0.0, 0.0)))


ROWS = {"connect": "vx vy vz", "weld": "wx wy wz vx vy vz"}
"""Components of the relative velocity that each kind of equality prevents."""
_SITES = ("site1", "site2")


def constraints_of(root: Element, defaults: Defaults) -> list[Element]:
    """Active equality constraints in the file's order."""
    equalities = [defaults.apply(child, kind="equality") for child in root.children_in("equality")]
    return [equality for equality in equalities if equality.flag("active", default=True)]


def mimics(
    builder: ModelBuilder, constraints: Sequence[Element], joints: Mapping[str, MjcfJoint], kept: Set[str]
) -> dict[str, Mimic]:
    """Joints that follow another by a constant ratio, q1 - q1_ref = c0 + c1 (q2 - q2_ref); notes on the others.

    ``kept`` are the joints of the model.
    """
    mimics: dict[str, Mimic] = {}
    for constraint in constraints:
        if constraint.tag != "joint":
            continue
        follower = constraint.text("joint1")
        leader = constraint.attributes.get("joint2", "").strip()  # empty: the follower is held in its position
        names = {follower, leader} - {""}
        for name in (follower, leader):
            if name and (name not in joints or not joints[name].single):
                raise constraint.error(f"names {name!r}, which is not a hinge or slide.")
        if not names <= kept:
            continue
        c0, c1, *higher = constraint.floats("polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader:
            position = printed(joints[follower].reference + c0)
            builder.note(constraint, f"holds joint {follower!r} at {position}, which is left out: lock it")
        elif any(higher) or c1 == 0:
            builder.note(constraint, "makes a joint follow another by a polynomial, which is left out")
        elif follower in mimics or follower in _leaders(leader, mimics):  # the latter would close a circle
            builder.note(constraint, "is a second rule for its joints, which is left out")
        else:
            offset = joints[follower].reference + c0 - c1 * joints[leader].reference
            mimics[follower] = (leader, c1, offset)
    return mimics


def _leaders(name: str, mimics: Mapping[str, Mimic]) -> set[str]:
    """Names of a joint and of all joints that it follows, directly or through others."""
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
    """Offer each loop as two coincident frames.

    ``poses`` are those of all bodies at the file's positions, ``kept`` the numbers of the bodies in the model.
    """
    numbers = {body.name: number for number, body in enumerate(bodies)}
    for k, constraint in enumerate(constraints):
        if constraint.tag == "joint":
            continue
        if constraint.tag not in ROWS:
            builder.note(constraint, f"is an equality of kind {constraint.tag}, which is left out")
            continue
        name = constraint.attributes.get("name", "").strip() or f"{constraint.tag}{k}"
        if "site1" in constraint.attributes:
            a, b = (_read_site_name(builder, constraint.text(attribute)) for attribute in _SITES)
            if not a or not b:
                continue
        else:
            i = _body_number(constraint, "body1", numbers)
            j = _body_number(constraint, "body2", numbers)
            if i not in kept or j not in kept:
                continue
            first, second = bodies[i].name, bodies[j].name
            T_first, T_second = _coincident_frames(constraint, poses[i], poses[j])
            a = builder.add_site(f"{name}:{first}", first, T_first, where=constraint.place)
            b = builder.add_site(f"{name}:{second}", second, T_second, where=constraint.place)
        rows = ROWS[constraint.tag]
        builder.add_closure(name, OfferedClosure(a, b, rows))
        builder.remark(f"{constraint} is left open: robot.close({a!r}, {b!r}, {rows!r}) closes it")


def _read_site_name(builder: ModelBuilder, name: str) -> str:
    """Name of a site in the model, which may have a prefix there; empty if it was not read."""
    for site in (f"site:{name}", name):
        if site in builder.site_names:
            return site
    return ""


def _body_number(constraint: Element, attribute: str, numbers: Mapping[str, int]) -> int:
    """Number of the body that an attribute names, the world by default."""
    name = constraint.attributes.get(attribute, WORLD).strip()
    if name not in numbers:
        raise constraint.error(f"names the body {name!r}, which is not there.")
    return numbers[name]


def _coincident_frames(constraint: Element, T_1: Array, T_2: Array) -> tuple[Array, Array]:
    """Frames that coincide, one in each body, for poses T_1 and T_2 of the bodies in the file.

    The anchor of "connect" is given in body 1, that of "weld" in body 2.
    """
    T_12 = se3.inverse(T_1) @ T_2
    if constraint.tag == "connect":
        anchor = se3.pose(np.eye(3), constraint.numbers("anchor", 3))
        return anchor, se3.inverse(T_12) @ anchor
    *position, w, x, y, z = constraint.floats("relpose", (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    anchor = se3.pose(np.eye(3), constraint.floats("anchor", (0.0, 0.0, 0.0)))
    if any(
        (w, x, y, z)
    ):  # the pose of the anchor in body 1 is given; a quaternion of zeros stands for the file's poses
        return se3.pose(quaternion.rotation([w, x, y, z]), position), anchor
    return T_12 @ anchor, anchor


def add_tendons(
    builder: ModelBuilder, root: Element, joints: Mapping[str, MjcfJoint], kept: Set[str], defaults: Defaults
) -> None:
    """Add springs of tendons with a stiffness, and notes on forces that are left out."""
    for child in root.children_in("tendon"):
        tendon = defaults.apply(child, kind="tendon")
        if child.tag == "fixed":
            _add_fixed_tendon(builder, tendon, joints, kept)
        elif child.tag == "spatial":
            forces = [tendon.floats(attribute, _ZERO_POLYNOMIAL) for attribute in ("stiffness", *_LOSS_ATTRIBUTES)]
            if np.any(forces):
                builder.note(child, "is a spatial tendon, whose forces and inertia are left out")


def _add_fixed_tendon(builder: ModelBuilder, tendon: Element, joints: Mapping[str, MjcfJoint], kept: Set[str]) -> None:
    """Add the spring of a fixed tendon, whose length is Σ coefficient · position over joints."""
    coefficients: dict[str, float] = defaultdict(float)
    for child in tendon.all("joint"):
        name = child.text("joint")
        if name not in joints or not joints[name].single:
            raise child.error(f"in {tendon} names {name!r}, which is not a hinge or slide.")
        coefficients[name] += child.number("coef")
    for loss in _LOSS_ATTRIBUTES:
        if any(tendon.floats(loss, _ZERO_POLYNOMIAL)):
            builder.note(tendon, f"has a {loss}, which is left out")
    stiffness, *higher = tendon.floats("stiffness", _ZERO_POLYNOMIAL)
    if any(higher):
        builder.note(tendon, LEFT_OUT["tendon/stiffness"])
    if any(higher) or not stiffness:
        return
    if tendon.floats("springyield", (0.0,))[0]:
        builder.note(tendon, LEFT_OUT["tendon/springyield"])
    shortest, longest = tendon.floats("springlength", (-1.0, -1.0))  # lengths without a force
    if len(tendon.attributes.get("springlength", "").split()) == 1:
        longest = shortest
    if shortest == -1.0:  # MuJoCo's sign for the length at rest
        shortest = longest = sum(coefficient * joints[name].rest for name, coefficient in coefficients.items())
    if shortest != longest:
        builder.note(tendon, "is a spring that is slack over a range of lengths, and is left out")
    elif coefficients.keys() <= kept:
        builder.add_spring(coefficients, stiffness, shortest, where=tendon.place)
