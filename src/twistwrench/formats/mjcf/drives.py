"""Actuators, equality constraints and fixed tendons of MJCF."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.numbers import number, printed
from ...errors import RobotFileError
from ...lie import quaternion, se3
from ...model.builder import ModelBuilder
from ...model.description import Mimic, ModelNote, label
from ...model.model import OfferedClosure
from ...typing import Array
from ..known_elements import ACTUATORS, LEFT_OUT
from ..xml import Element
from .bodies import WORLD, MjcfBody, MjcfJoint, limited
from .preprocess import SHORTCUT, Defaults, Settings


@dataclass(frozen=True)
class Drives:
    """Effort, armature and damping of actuators at joints of one degree, by joint, and notes."""

    efforts: dict[str, float]
    """Largest torque or force to either side, if known [N m or N]."""
    armature: dict[str, float]
    """kg m² or kg."""
    damping: dict[str, float]
    """N m s/rad or N s/m."""
    remarks: list[str]


def drives_of(root: Element, joints: Mapping[str, MjcfJoint], settings: Settings, defaults: Defaults) -> Drives:
    """Drives of a file's actuators at its joints.

    What the actuators of a joint give together, each gear times ``forcerange``, or, of a motor, gear times ``ctrlrange``, lies
    within the joint's own ``actuatorfrcrange``. Their armature and damping count gear squared.
    """
    totals: dict[str, Array] = {}
    drives = Drives({}, {}, {}, [])
    for section in root.all("actuator"):
        for child in section.children:
            if child.tag not in ACTUATORS:
                drives.remarks.append(ModelNote(str(child), LEFT_OUT["actuator/unknown"]))
            one = defaults.apply(child)
            name = one.attributes.get("joint", one.attributes.get("jointinparent", "")).strip()
            if name and name not in joints:
                raise RobotFileError(f"{child} drives the joint {name!r}, which is not there.")
            if child.tag in ACTUATORS:
                _add_losses(drives, one, joints.get(name))
            if name:
                totals[name] = totals.get(name, np.zeros(2)) + _forces(one, settings)
                if child.tag == "orientation":
                    drives.remarks.append(ModelNote(str(one), LEFT_OUT["actuator/joint"]))
    for name, joint in joints.items():
        if not joint.single:
            continue
        given = totals.get(name, ANY)
        if limited(joint.element, "actuatorfrclimited", "actuatorfrcrange", settings):
            given = np.clip(given, *_range(joint.element, "actuatorfrcrange"))
        effort, remark = effort_of(given)
        if remark and (name in totals or effort is not None):
            drives.remarks.append(ModelNote(label("joint", name, joint.element.place), remark))
        if effort is not None:
            drives.efforts[name] = effort
    return drives


ANY = np.array([-math.inf, math.inf])
"""Range of unknown forces."""
_UNEQUAL = 1e-3
"""Relative difference of the forces to both sides from which it is noted."""


def effort_of(forces: Array) -> tuple[float | None, str]:
    """Effort that a joint gives to either side, None if unknown, and a note.

    ``forces`` are the least and the most that its actuators give, (2,).
    """
    one, other = sorted((max(-float(forces[0]), 0.0), max(float(forces[1]), 0.0)))
    if other == math.inf:
        return None, "has an actuator whose largest force is not given"
    if one == 0.0 < other:
        return other, f"is driven to one side only, by up to {number(other)}, and its limit is that of both"
    if one < (1 - _UNEQUAL) * other:
        return (
            one,
            f"gives {number(one)} to one side and {number(other)} to the other, and the less is its limit of both",
        )
    return one or None, ""


def _add_losses(drives: Drives, one: Element, joint: MjcfJoint | None) -> None:
    """Add armature and damping of an actuator, reflected to its joint."""
    gear = one.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
    for what, at in (("armature", drives.armature), ("damping", drives.damping)):
        value, *more = one.floats(what, (0.0, 0.0, 0.0))
        if not value and not any(more):
            continue
        if joint is None or not joint.single:
            drives.remarks.append(ModelNote(str(one), f"has a {what} that is left out"))
        else:
            if any(more):
                drives.remarks.append(ModelNote(str(one), LEFT_OUT["actuator/damping"]))
            at[joint.name] = at.get(joint.name, 0.0) + gear**2 * value


def _forces(one: Element, settings: Settings) -> Array:
    """Range of an actuator's force at its joint, infinite if it is not given."""
    gear = one.floats("gear", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))[0]
    force = ANY
    kind = one.attributes.get(SHORTCUT)
    if kind in (None, "orientation"):
        return ANY
    plain = kind == "motor" or (
        kind == "general"
        and one.attributes.get("gaintype", "fixed") == "fixed"
        and one.attributes.get("biastype", "none") == "none"
        and one.attributes.get("dyntype", "none") == "none"
    )
    if plain and limited(one, "ctrllimited", "ctrlrange", settings):
        force = np.sort((1.0 if kind == "motor" else _gain(one)) * _range(one, "ctrlrange"))
    if kind == "dcmotor" and "saturation" in one.attributes:  # which stands for a range of forces
        force = _saturation(one)
    elif limited(one, "forcelimited", "forcerange", settings):
        force = np.clip(force, *_range(one, "forcerange"))
    return at_joint(force, gear)


def at_joint(force: Array, gear: float) -> Array:
    """The least and the most force of an actuator, (2,), behind its gear; a gear of zero lets nothing through."""
    return np.sort(gear * force) if gear else np.zeros(2)


def _saturation(one: Element) -> Array:
    """The largest torque of a ``dcmotor`` to both sides: as given, or its constant times the largest current."""
    torque, current, _ = one.floats("saturation", (0.0, 0.0, 0.0))
    of_torque, of_speed = one.floats("motorconst", (0.0, 0.0))
    voltage, _, speed = one.floats("nominal", (0.0, 0.0, 0.0))
    given = [x for x in (of_torque, of_speed or (voltage / speed if speed else 0.0)) if x > 0]
    constant = math.prod(given) ** (1.0 / len(given)) if given else 0.0
    most = torque or constant * current
    return np.array([-most, most]) if most else ANY


def _gain(one: Element) -> float:
    return one.floats("gainprm", (1.0, *([0.0] * 9)))[0]


def _range(element: Element, attribute: str) -> Array:
    return np.array(element.floats(attribute, (0.0, 0.0)))


# ── Equality constraints: mimic joints, and loops that may be closed

POINT = "vx vy vz"
"""The rows that ``connect`` holds."""
ALL = "wx wy wz vx vy vz"
"""The rows that ``weld`` holds."""


def constraints_of(root: Element, defaults: Defaults) -> list[Element]:
    """Active equality constraints in the file's order."""
    found = [defaults.apply(one, kind="equality") for section in root.all("equality") for one in section.children]
    return [one for one in found if one.flag("active", default=True)]


def mimics(
    constraints: Sequence[Element], joints: Mapping[str, MjcfJoint], kept: set[str]
) -> tuple[dict[str, Mimic], list[str]]:
    """Joints that follow another by a constant ratio, q1 - q1_ref = c0 + c1 (q2 - q2_ref), and notes on the others."""
    found: dict[str, Mimic] = {}
    remarks: list[str] = []
    for one in constraints:
        if one.tag != "joint":
            continue
        follower, leader = one.text("joint1"), one.attributes.get("joint2", "").strip()
        for name in (follower, leader):
            if name and (name not in joints or not joints[name].single):
                raise RobotFileError(f"{one} names {name!r}, which is not a hinge or slide.")
        if not {follower, leader or follower} <= kept:
            continue
        c0, c1, *more = one.floats("polycoef", (0.0, 1.0, 0.0, 0.0, 0.0))
        if not leader:
            remarks.append(
                ModelNote(
                    str(one),
                    f"holds joint {follower!r} at {printed(joints[follower].reference + c0)}, which is left out: lock it",
                )
            )
        elif any(more) or c1 == 0:
            remarks.append(ModelNote(str(one), "makes a joint follow another by a polynomial, which is left out"))
        elif follower in found or follower in leaders_of(leader, found):
            remarks.append(ModelNote(str(one), "is a second rule for its joints, which is left out"))
        else:
            offset = joints[follower].reference + c0 - c1 * joints[leader].reference
            found[follower] = (leader, c1, offset)
    return found, remarks


def leaders_of(name: str, found: Mapping[str, Mimic]) -> set[str]:
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
    kept: set[int],
) -> None:
    """Offer each loop as two coincident frames; ``poses`` are those of the bodies in the file."""
    numbers = {body.name: k for k, body in enumerate(bodies)}
    for k, one in enumerate(constraints):
        if one.tag == "joint":
            continue
        if one.tag not in ("connect", "weld"):
            builder.remark(ModelNote(str(one), f"is an equality of kind {one.tag}, which is left out"))
            continue
        name = one.attributes.get("name", "").strip() or f"{one.tag}{k}"
        rows = POINT if one.tag == "connect" else ALL
        if "site1" in one.attributes:
            frames = [_site(builder, one, which) for which in ("site1", "site2")]
        else:
            first, second = (_body(one, which, numbers) for which in ("body1", "body2"))
            if not {first, second} <= kept:
                continue
            T1, T2 = _ends(one, poses[first], poses[second])
            frames = [
                builder.add_site(f"{name}:{bodies[i].name}", bodies[i].name, T, where=one.place)
                for i, T in ((first, T1), (second, T2))
            ]
        if None in frames:
            continue
        a, b = (str(frame) for frame in frames)
        builder.add_closure(name, OfferedClosure(a, b, rows))
        builder.remark(f"{one} is left open: robot.close({a!r}, {b!r}, {rows!r}) closes it")


def _site(builder: ModelBuilder, one: Element, which: str) -> str | None:
    name = one.text(which)
    return next((known for known in (f"site:{name}", name) if known in builder.site_names), None)


def _body(one: Element, which: str, numbers: Mapping[str, int]) -> int:
    name = one.attributes.get(which, WORLD).strip()
    if name not in numbers:
        raise RobotFileError(f"{one} names the body {name!r}, which is not there.")
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

_LOSSES = ("damping", "frictionloss", "armature")
"""Properties of tendons that the model does not represent."""


def add_tendons(
    builder: ModelBuilder, root: Element, joints: Mapping[str, MjcfJoint], kept: set[str], defaults: Defaults
) -> None:
    """Add springs of tendons with a stiffness, and notes on forces that are left out."""
    for section in root.all("tendon"):
        for child in section.children:
            one = defaults.apply(child, kind="tendon")
            if child.tag == "spatial":
                if any(any(one.floats(what, (0.0, 0.0, 0.0))) for what in ("stiffness", *_LOSSES)):
                    builder.remark(ModelNote(str(child), "is a spatial tendon, whose forces and inertia are left out"))
            elif child.tag == "fixed":
                _add_fixed(builder, one, joints, kept)


def _add_fixed(builder: ModelBuilder, one: Element, joints: Mapping[str, MjcfJoint], kept: set[str]) -> None:
    terms: dict[str, float] = {}
    for child in one.all("joint"):
        name = child.text("joint")
        if name not in joints or not joints[name].single:
            raise RobotFileError(f"{child} in {one} names {name!r}, which is not a hinge or slide.")
        terms[name] = terms.get(name, 0.0) + child.number("coef")
    for what in _LOSSES:
        if any(one.floats(what, (0.0, 0.0, 0.0))):
            builder.remark(ModelNote(str(one), f"has a {what}, which is left out"))
    stiffness, *more = one.floats("stiffness", (0.0, 0.0, 0.0))
    if not stiffness and not any(more):
        return
    if any(more):
        builder.remark(ModelNote(str(one), LEFT_OUT["tendon/stiffness"]))
        return
    if one.floats("springyield", (0.0,))[0]:
        builder.remark(ModelNote(str(one), LEFT_OUT["tendon/springyield"]))
    first, last = one.floats("springlength", (-1.0, -1.0))
    if "springlength" in one.attributes and len(one.attributes["springlength"].split()) == 1:
        last = first
    if first == -1.0:
        first = last = sum(weight * joints[name].rest for name, weight in terms.items())
    if first != last:
        builder.remark(ModelNote(str(one), "is a spring that is slack over a range of lengths, and is left out"))
    elif terms.keys() <= kept:
        builder.add_spring(terms, stiffness, first, where=one.place)
