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

_ZERO_POLYNOMIAL = (0.0, 0.0, 0.0)
"""Default coefficients of a stiffness or a damping: linear, and of higher order."""
_LOSSES = {
    "damping": ("a damping", _ZERO_POLYNOMIAL),
    "frictionloss": ("a frictionloss", (0.0,)),
    "armature": ("an armature", (0.0,)),
}
"""Words for the attributes of what loses or takes up force, and their default coefficients."""
_SLIDER_CRANK_SITES = ("cranksite", "slidersite")
"""Attributes of actuators on a slider-crank, whose joints the file does not name."""


def _joint_name(actuator: Element) -> str:
    """Name of the joint that an actuator drives directly; empty if it drives none."""
    return actuator.attributes.get("joint", actuator.attributes.get("jointinparent", "")).strip()


def motor_joints_of(root: Element, joints: Mapping[str, MjcfJoint], defaults: Defaults) -> set[str]:
    """Joints that actuators drive, directly or by a fixed tendon; empty if the joints of an actuator are unknown."""
    tendons = {child.attributes.get("name", "").strip(): child for child in root.children_in("tendon")}
    motor_joints: set[str] = set()
    for child in root.children_in("actuator"):
        actuator = defaults.apply(child)
        tendon_name = actuator.attributes.get("tendon", "").strip()
        tendon = tendons.get(tendon_name)
        if any(name in actuator.attributes for name in _SLIDER_CRANK_SITES):
            return set()
        if tendon is not None and tendon.tag != "fixed":
            return set()
        motor_joints.add(_joint_name(actuator))
        if tendon is not None:
            for part in tendon.all("joint"):
                if part.number("coef") != 0:
                    motor_joints.add(part.text("joint"))
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
        gear, *_ = actuator.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))  # the others are for ball joints
        if child.tag in ACTUATORS:
            _add_losses(builder, drives, actuator, gear, joints.get(joint_name))
        if joint_name:
            force_range = _force_range(actuator, settings)
            range_at_joint = np.zeros(2)  # a gear of zero transmits no force; infinity times zero would be nan
            if gear:
                range_at_joint = np.sort(gear * force_range)  # a negative gear exchanges the sides
            earlier_range = force_range_by_joint.get(joint_name, np.zeros(2))
            force_range_by_joint[joint_name] = earlier_range + range_at_joint
            is_motor = actuator.attributes.get(SHORTCUT) == "dcmotor"
            if is_motor and gear and joints[joint_name].single:
                largest_torque = float(np.abs(force_range).min())  # that it gives to both sides
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
        has_actuator = joint_name in force_range_by_joint
        if note and (has_actuator or effort is not None):  # without actuator and range, an unknown effort is expected
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
    negative_effort = max(-float(force_range[0]), 0.0)
    positive_effort = max(float(force_range[1]), 0.0)
    smaller_effort = min(negative_effort, positive_effort)
    larger_effort = max(negative_effort, positive_effort)
    if larger_effort == math.inf:
        return None, "has an actuator whose largest force is not given"
    if larger_effort == 0.0:
        return None, ""
    if smaller_effort == 0.0:
        note = f"is driven to one side only, by up to {number(larger_effort)}, and its limit is that of both"
        return larger_effort, note
    if smaller_effort < (1 - _MAX_DIFFERENCE_OF_SIDES) * larger_effort:
        sides = f"{number(smaller_effort)} to one side and {number(larger_effort)} to the other"
        return smaller_effort, f"gives {sides}, and the less is its limit of both"
    return smaller_effort, ""


def _add_losses(builder: ModelBuilder, drives: Drives, actuator: Element, gear: float, joint: MjcfJoint | None) -> None:
    """Add armature and damping of an actuator at its joint, by gear squared; ``joint`` is None for an actuator without one."""
    for kind, sum_by_joint in (("armature", drives.armature), ("damping", drives.damping)):
        words, default = _LOSSES[kind]
        coefficient, *higher_coefficients = actuator.floats(kind, default)
        if not coefficient and not any(higher_coefficients):
            continue
        if joint is None or not joint.single:
            builder.note(actuator, f"has {words} that is left out")
            continue
        if any(higher_coefficients):
            builder.note(actuator, LEFT_OUT["actuator/damping"])
        sum_by_joint[joint.name] += gear**2 * coefficient


def _force_range(actuator: Element, settings: Settings) -> Array:
    """Range of an actuator's force before its gear (2,), infinite if it is not given."""
    kind = actuator.attributes.get(SHORTCUT)
    if kind in (None, "orientation"):
        return UNKNOWN_RANGE
    if kind == "dcmotor" and "saturation" in actuator.attributes:  # takes the place of a force range
        return _saturation_range(actuator)
    types = {name: actuator.attributes.get(name, default) for name, default in _GAIN_ONLY_TYPES.items()}
    are_gain_only_types = all(value in ("fixed", "none") for value in types.values())
    has_gain_only = kind == "motor" or (kind == "general" and are_gain_only_types)
    force_range = UNKNOWN_RANGE
    if has_gain_only and has_active_range(actuator, "ctrllimited", "ctrlrange", settings):
        gain = 1.0
        if kind == "general":
            gain, *_ = actuator.floats(
                "gainprm", (1.0, *([0.0] * 9))
            )  # ten numbers, of which a fixed gain uses the first
        control_range = _numbers_of_range(actuator, "ctrlrange")
        force_range = np.sort(gain * control_range)  # a negative gain exchanges the sides
    if has_active_range(actuator, "forcelimited", "forcerange", settings):
        lower, upper = _numbers_of_range(actuator, "forcerange")
        return np.clip(force_range, lower, upper)
    return force_range


def _saturation_range(actuator: Element) -> Array:
    """Range of the torque of a ``dcmotor`` (2,), by its largest torque, or by its constant times its largest current.

    Zero stands for a torque or a current that is not given. The range is infinite if neither is given.
    """
    max_torque, max_current, _ = actuator.floats("saturation", (0.0, 0.0, 0.0))
    if max_torque == 0:
        max_torque = _motor_constant(actuator) * max_current
    if max_torque == 0:
        return UNKNOWN_RANGE
    return np.array([-max_torque, max_torque])


def _motor_constant(actuator: Element) -> float:
    """Constant K of a ``dcmotor`` [N m/A]: geometric mean of its torque constant and its back-EMF constant; 0 if unknown.

    The two constants are equal in SI units. Zero stands for a constant that is not given; K is then the other one.
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
    """Add the motor of a ``dcmotor`` and its friction; the motor gives ``largest_torque`` [N m] to both sides."""
    if joint in drives.motors:
        builder.note(actuator, "is a second motor of its joint, whose electrical data are left out")
        return
    cogging_amplitude, *_ = actuator.floats("cogging", (0.0, 0.0, 0.0))
    if cogging_amplitude:
        builder.note(actuator, "has a cogging torque, which is left out")
    thermal_values = actuator.floats("thermal", (0.0,) * 6)
    resistances_and_capacity = thermal_values[:3]
    if any(resistances_and_capacity):
        builder.note(actuator, "has a thermal model, which is left out: the resistance is that of the cold motor")
    friction = _lugre_friction(builder, actuator, gear)
    constant = _motor_constant(actuator)
    if constant == 0:
        drives.motors[joint] = Actuator(joint, gear), friction
        return
    # In all these attributes, zero means "not given".
    voltage, stall_torque, _ = actuator.floats("nominal", (0.0, 0.0, 0.0))
    (resistance,) = actuator.floats("resistance", (0.0,))
    if resistance == 0 and stall_torque != 0:
        resistance = constant * voltage / stall_torque
    inductance, time_constant = actuator.floats("inductance", (0.0, 0.0))
    if inductance == 0:
        inductance = time_constant * resistance
    if voltage == 0:
        *_, voltage = actuator.floats("controller", (0.0,) * 6)
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


def constraints_of(root: Element, defaults: Defaults) -> list[Element]:
    """Active equality constraints in the file's order."""
    equalities = [defaults.apply(child, kind="equality") for child in root.children_in("equality")]
    return [equality for equality in equalities if equality.flag("active", default=True)]


def mimics(
    builder: ModelBuilder, constraints: Sequence[Element], joints: Mapping[str, MjcfJoint], kept: Set[str]
) -> dict[str, Mimic]:
    """Leader, ratio and offset of each joint that follows another: q1 - q1_ref = c0 + c1 (q2 - q2_ref).

    Other equalities of joints are noted. ``kept`` are the joints of the model.
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
        c0, c1, *higher_coefficients = constraint.floats("polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader:
            position = printed(joints[follower].reference + c0)
            builder.note(constraint, f"holds joint {follower!r} at {position}, which is left out: lock it")
        elif any(higher_coefficients) or c1 == 0:
            builder.note(constraint, "makes a joint follow another by a polynomial, which is left out")
        elif follower in mimics or follower in _leaders(leader, mimics):  # a leader that follows would close a circle
            builder.note(constraint, "is a second rule for its joints, which is left out")
        else:
            offset = joints[follower].reference + c0 - c1 * joints[leader].reference
            mimics[follower] = (leader, c1, offset)
    return mimics


def _leaders(name: str, mimics: Mapping[str, Mimic]) -> set[str]:
    """Names of a joint and of all joints that it follows, directly or through others."""
    leaders = {name}
    while name in mimics:
        name, _, _ = mimics[name]
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

    ``poses`` are the poses of all bodies at the file's positions. ``kept`` are the numbers of the bodies in the model.
    """
    body_numbers = {body.name: number for number, body in enumerate(bodies)}
    for k, constraint in enumerate(constraints):
        if constraint.tag == "joint":
            continue
        if constraint.tag not in ROWS:
            builder.note(constraint, f"is an equality of kind {constraint.tag}, which is left out")
            continue
        name = constraint.attributes.get("name", "").strip() or f"{constraint.tag}{k}"
        if "site1" in constraint.attributes:
            frame_a = _read_site_name(builder, constraint.text("site1"))
            frame_b = _read_site_name(builder, constraint.text("site2"))
            if not frame_a or not frame_b:
                continue
        else:
            a = _body_number(constraint, "body1", body_numbers)
            b = _body_number(constraint, "body2", body_numbers)
            if a not in kept or b not in kept:
                continue
            name_a, name_b = bodies[a].name, bodies[b].name
            T_a, T_b = _coincident_frames(constraint, poses[a], poses[b])
            frame_a = builder.add_site(f"{name}:{name_a}", name_a, T_a, where=constraint.place)
            frame_b = builder.add_site(f"{name}:{name_b}", name_b, T_b, where=constraint.place)
        rows = ROWS[constraint.tag]
        builder.add_closure(name, OfferedClosure(frame_a, frame_b, rows))
        builder.remark(f"{constraint} is left open: robot.close({frame_a!r}, {frame_b!r}, {rows!r}) closes it")


def _read_site_name(builder: ModelBuilder, name: str) -> str:
    """Name of a site in the model, which may have a prefix there; empty if it was not read."""
    for model_name in (f"site:{name}", name):
        if model_name in builder.site_names:
            return model_name
    return ""


def _body_number(constraint: Element, attribute: str, numbers: Mapping[str, int]) -> int:
    """Number of the body that an attribute names, the world by default."""
    name = constraint.attributes.get(attribute, WORLD).strip()
    if name not in numbers:
        raise constraint.error(f"names the body {name!r}, which is not there.")
    return numbers[name]


def _coincident_frames(constraint: Element, T_1: Array, T_2: Array) -> tuple[Array, Array]:
    """Poses of two coincident frames, one in each body, for poses T_1 and T_2 of the bodies in the file.

    The file gives the anchor of "connect" in body 1, and the anchor of "weld" in body 2.
    """
    T_12 = se3.inverse(T_1) @ T_2
    if constraint.tag == "connect":
        anchor = se3.pose(np.eye(3), constraint.numbers("anchor", 3))
        return anchor, se3.inverse(T_12) @ anchor
    *position, w, x, y, z = constraint.floats("relpose", (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    anchor = se3.pose(np.eye(3), constraint.floats("anchor", (0.0, 0.0, 0.0)))
    is_pose_given = any((w, x, y, z))  # of the anchor in body 1; else the bodies keep the file's poses
    if is_pose_given:
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
            attributes = ("stiffness", *_LOSSES)
            coefficients = [tendon.floats(attribute, _ZERO_POLYNOMIAL) for attribute in attributes]
            if np.any(coefficients):
                builder.note(child, "is a spatial tendon, whose forces and inertia are left out")


def _add_fixed_tendon(builder: ModelBuilder, tendon: Element, joints: Mapping[str, MjcfJoint], kept: Set[str]) -> None:
    """Add the spring of a fixed tendon, whose length is Σ coefficient · position over joints."""
    coefficients: dict[str, float] = defaultdict(float)
    for child in tendon.all("joint"):
        name = child.text("joint")
        if name not in joints or not joints[name].single:
            raise child.error(f"in {tendon} names {name!r}, which is not a hinge or slide.")
        coefficients[name] += child.number("coef")
    for loss, (words, default) in _LOSSES.items():
        if any(tendon.floats(loss, default)):
            builder.note(tendon, f"has {words}, which is left out")
    stiffness, *higher_coefficients = tendon.floats("stiffness", _ZERO_POLYNOMIAL)
    if any(higher_coefficients):
        builder.note(tendon, LEFT_OUT["tendon/stiffness"])
        return
    if not stiffness:
        return
    (yield_force,) = tendon.floats("springyield", (0.0,))
    if yield_force:
        builder.note(tendon, LEFT_OUT["tendon/springyield"])
    shortest, longest = tendon.floats("springlength", (-1.0, -1.0))  # lengths without a force
    if len(tendon.attributes.get("springlength", "").split()) == 1:
        longest = shortest
    if shortest == -1.0:  # MuJoCo's sign for the length at rest
        shortest = sum(coefficient * joints[name].rest for name, coefficient in coefficients.items())
        longest = shortest
    if shortest != longest:
        builder.note(tendon, "is a spring that is slack over a range of lengths, and is left out")
    elif coefficients.keys() <= kept:
        builder.add_spring(coefficients, stiffness, shortest, where=tendon.place)
